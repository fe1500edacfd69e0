//! The provider's library, and the adapter that it uses.

use std::ffi::{CStr, c_char};
use std::path::{Path, PathBuf};
use std::ptr::null_mut;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use ort::AsPointer;
use ort::device::Device;
use ort::environment::Environment;
use ort::session::Session;
use ort::sys;

use super::super::failure::make;
use super::adapter_errors::WAIT_FAILED;
use super::adapters::{self, VulkanAdapter};
use super::value::check;
use crate::locks::Mutex;
use crate::quiet_mutex::QuietMutex;
use crate::runtime::DeviceMemory;
use crate::runtime::Ort;
use crate::{Error, ErrorKind, LibrarySearch, Result};

/// The plugin's file, beside ONNX Runtime's.
const FILE: &str =
    if cfg!(windows) { "onnxruntime_providers_webgpu.dll" } else { "libonnxruntime_providers_webgpu.so" };
/// Names the plugin's file, if the environment may name libraries.
const VARIABLE: &str = "CAIRN_WEBGPU";
/// The provider's name in ONNX Runtime.
const PROVIDER: &str = "WebGpuExecutionProvider";
/// The session option with which a session can tell which provider runs each node.
pub(super) const RECORD_PROVIDERS: &str = "session.record_ep_graph_assignment_info";

/// Held during every call that reaches the provider. It has one queue and one set of buffers for the whole process, which are not safe to use
/// from two threads.
pub(super) static LOCK: QuietMutex<()> = QuietMutex::new(());

/// The plugin's library, if it is registered with ONNX Runtime. It has one device for the whole process, which lasts as long.
static REGISTERED: QuietMutex<Option<Arc<Registration>>> = QuietMutex::new(None);

/// Held by all that uses the registered library: its sessions and its memory.
pub(super) struct Registration {
    /// The library's file.
    path: PathBuf,
}

/// The library's name in ONNX Runtime.
const LIBRARY: &CStr = c"cairn-webgpu";

/// Options of a WebGPU device.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WebGpuOptions {
    /// Uses ONNX Runtime's deterministic kernels only.
    pub deterministic: bool,
    /// The adapter: a part of its name in any case, its vendor as `0x1002`, or its number among those that Vulkan lists. `None`: the fastest,
    /// but no adapter that the processor emulates. All WebGPU devices of a process use the adapter of the first.
    ///
    /// Adapters can be named on Linux, and on Windows where the provider uses Vulkan: where `vulkan-1.dll` lies beside its library.
    pub adapter: Option<String>,
    /// Where the provider's library is: the file that [`LibrarySearch::webgpu`] names, the one in the environment variable `CAIRN_WEBGPU` if the
    /// environment may name libraries, else the one beside ONNX Runtime's own. The first device of a process decides.
    pub libraries: LibrarySearch,
}

/// The registered plugin, and the adapter.
pub(super) struct Plugin {
    ort: Ort,
    /// ONNX Runtime's descriptions of the adapter and of its memory, which last as long as the registration.
    device: *const sys::OrtEpDevice,
    memory: *const sys::OrtMemoryInfo,
    allocator: *mut sys::OrtAllocator,
    options: Vec<(String, String)>,
    description: String,
    adapter: Adapter,
    registration: Arc<Registration>,
}

// SAFETY: the pointers are to objects of ONNX Runtime's environment, which may be used from any thread, the allocator under `LOCK`.
unsafe impl Send for Plugin {}
// SAFETY: as above.
unsafe impl Sync for Plugin {}

impl Plugin {
    /// Registers the plugin that lies beside ONNX Runtime, and chooses an adapter.
    pub(super) fn load(ort: &Ort, options: &super::WebGpuOptions) -> Result<Self> {
        let registration = register(ort, &options.libraries)?;
        let adapter = Adapter::choose(options.adapter.as_deref(), Some(&registration.path))?;
        fix_adapter(&adapter.name)?;
        let device = find_device(ort)?;
        let (device, memory) = (device.ptr(), device.memory_info(false).ptr());
        let mut allocator = null_mut();
        let shared = ort::api().GetSharedAllocator;
        // SAFETY: a live environment, the description of the device's memory, and a place for the allocator.
        let status = unsafe { shared(ort.environment().ptr().cast_mut(), memory, &mut allocator) };
        check("allocate on the adapter", status)?;
        if allocator.is_null() {
            return Err(Error::new(ErrorKind::Device, "the WebGPU provider has no allocator for its adapter"));
        }
        let preference = if adapter.low_power { "low-power" } else { "high-performance" };
        let mut options = vec![
            ("powerPreference", preference),
            // Buffers outlive sessions.
            ("preserveDevice", "1"),
        ];
        if adapter.vulkan.is_some() {
            options.push(("dawnBackendType", "Vulkan"));
        }
        let options =
            options.into_iter().map(|(name, value)| (format!("{PROVIDER}.{name}"), value.to_owned())).collect();
        let description = format!("ONNX Runtime {} WebGPU {} on {}", ort.version(), version_of(device), adapter.name);
        let ort = ort.clone();
        Ok(Self { ort, device, memory, allocator, options, description, adapter, registration })
    }

    pub(super) fn describe(&self) -> &str {
        &self.description
    }

    /// What keeps the provider's sessions valid.
    pub(super) fn registration(&self) -> Arc<Registration> {
        self.registration.clone()
    }

    pub(super) fn environment(&self) -> &Environment {
        self.ort.environment()
    }

    pub(super) fn environment_ptr(&self) -> *mut sys::OrtEnv {
        self.environment().ptr().cast_mut()
    }

    /// The adapter, for session options.
    pub(super) fn device(&self) -> Device<'_> {
        let mut all = self.environment().devices();
        all.find(|device| device.ptr() == self.device).expect("adapters stay listed")
    }

    /// The provider's options, for session options.
    pub(super) fn provider_options(&self) -> &[(String, String)] {
        &self.options
    }

    /// The description of the adapter's memory.
    pub(super) fn memory(&self) -> *const sys::OrtMemoryInfo {
        self.memory
    }

    /// The adapter's memory budget and use.
    pub(super) fn memory_use(&self) -> Option<DeviceMemory> {
        self.adapter.vulkan.as_ref()?.memory()
    }

    /// Refuses a graph that holds more in one buffer than the adapter can use.
    pub(super) fn check_fits(&self, what: &str, tensor: &str, bytes: u64) -> Result<()> {
        match &self.adapter.vulkan {
            Some(vulkan) => check_fits(vulkan.largest_buffer, what, tensor, bytes),
            None => Ok(()),
        }
    }

    pub(super) fn allocator(&self) -> *mut sys::OrtAllocator {
        self.allocator
    }
}

/// The adapter that the provider takes.
struct Adapter {
    name: String,
    /// Whether the provider must prefer saving power to take it.
    low_power: bool,
    /// What Vulkan knows of it, if the provider uses Vulkan.
    vulkan: Option<VulkanAdapter>,
}

impl Adapter {
    /// `plugin` is the provider's library.
    fn choose(wanted: Option<&str>, plugin: Option<&Path>) -> Result<Self> {
        if let Some(loader) = adapters::loader(plugin) {
            let vulkan = VulkanAdapter::choose(&loader, wanted)?;
            return Ok(Self { name: vulkan.name.clone(), low_power: vulkan.low_power, vulkan: Some(vulkan) });
        }
        match wanted {
            None => Ok(Self {
                name: "the system's fastest adapter".to_owned(),
                low_power: false,
                vulkan: None,
            }),
            Some(_) => Err(Error::new(ErrorKind::Unsupported, "an adapter can be named only where the provider uses Vulkan")
                .field("adapter")
                .remedy(if cfg!(windows) {
                    "Leave the choice to ONNX Runtime, or put vulkan-1.dll of the system's folder beside the provider's library"
                } else {
                    "Leave the choice to ONNX Runtime"
                })),
        }
    }
}

/// Notes the adapter of the process's first device, and refuses another one: the provider has one device for the whole process.
fn fix_adapter(name: &str) -> Result<()> {
    static ADAPTER: Mutex<Option<String>> = Mutex::new(None);
    let mut adapter = ADAPTER.lock();
    match adapter.get_or_insert_with(|| name.to_owned()) {
        first if first == name => Ok(()),
        first => Err(Error::new(ErrorKind::Unsupported, format!("this process already uses the adapter {first}"))
            .field("adapter")
            .remedy("Use one adapter in one process")),
    }
}

/// Registers the plugin's library, if it is not registered.
fn register(ort: &Ort, search: &LibrarySearch) -> Result<Arc<Registration>> {
    let mut registered = REGISTERED.lock();
    if let Some(registration) = &*registered {
        return Ok(registration.clone());
    }
    let named = search.webgpu.clone().or_else(|| search.variable(VARIABLE));
    let path = named.unwrap_or_else(|| ort.path().with_file_name(FILE));
    if !path.is_file() {
        return Err(missing(&path, "is not there"));
    }
    let name = LIBRARY.to_string_lossy();
    make("load its WebGPU provider", || ort.environment().register_ep_library(name, &path))
        .map_err(|error| missing(&path, error.cause()))?;
    Ok(registered.insert(Arc::new(Registration { path })).clone())
}

/// The adapter as the provider offers it.
fn find_device(ort: &Ort) -> Result<Device<'_>> {
    let mut devices = ort.environment().devices().filter(|device| device.ep().is_ok_and(|name| name == PROVIDER));
    devices.next().ok_or_else(no_adapter)
}

/// The file of the plugin's library, which is registered, and the name of the adapter that a device would use.
pub(super) fn requirements(ort: &Ort, search: &LibrarySearch) -> (Result<PathBuf>, Result<String>) {
    let library = register(ort, search).map(|registration| registration.path.clone());
    let adapter = Adapter::choose(None, library.as_deref().ok()).and_then(|adapter| {
        if library.is_ok() {
            find_device(ort)?;
        }
        Ok(adapter.name)
    });
    (library, adapter)
}

/// Unloads the plugin's library with its device, which is lost, so that the next one that is loaded makes another device.
///
/// # Errors
/// `DeviceRemoved` while anything is left that was made on the lost device, and if it was lost while it was waited for.
pub(super) fn unload_lost_device(ort: &Ort) -> Result<()> {
    if WAIT_FAILED.load(Ordering::Relaxed) {
        let cause =
            "the process's WebGPU device was lost while it was waited for, after which its provider cannot be unloaded";
        return Err(Error::new(ErrorKind::DeviceRemoved, cause).remedy("Start the program again, or use a CPU device"));
    }
    let mut registered = REGISTERED.lock();
    let Some(registration) = &*registered else { return Ok(()) };
    if Arc::strong_count(registration) > 1 {
        let cause = "the process's WebGPU device is lost, and something that was made on it is still there";
        return Err(Error::new(ErrorKind::DeviceRemoved, cause)
            .remedy("Release all rollouts, worlds and devices on it, then make a new device"));
    }
    let unregister = ort::api().UnregisterExecutionProviderLibrary;
    let _held = LOCK.lock();
    // SAFETY: a live environment, and the name of a library whose sessions and memory are gone.
    let status = unsafe { unregister(ort.environment().ptr().cast_mut(), LIBRARY.as_ptr()) };
    check("unload its WebGPU provider", status)?;
    *registered = None;
    Ok(())
}

fn missing(path: &Path, why: &str) -> Error {
    Error::new(ErrorKind::RuntimeMissing, format!("ONNX Runtime's WebGPU provider cannot be used: {why}"))
        .field(path.display().to_string())
        .remedy(format!(
            "Put {FILE} of the PyPI package onnxruntime-ep-webgpu 0.4.0 beside ONNX Runtime's own library \
             (`cargo xtask setup --all` fetches both), name it in the device's options, or use a CPU device"
        ))
}

fn check_fits(largest: u64, what: &str, tensor: &str, bytes: u64) -> Result<()> {
    if bytes <= largest {
        return Ok(());
    }
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let cause = format!(
        "{tensor} of the {what} has {:.1} MiB, and the adapter uses at most {:.1} MiB as one buffer",
        mib(bytes),
        mib(largest)
    );
    Err(Error::new(ErrorKind::Unsupported, cause)
        .field(tensor.to_owned())
        .remedy("Use a bundle with weights in 8 or 4 bits, a narrower window, another adapter, or a CPU device"))
}

fn no_adapter() -> Error {
    let (cause, remedy) = if cfg!(target_os = "linux") {
        (
            "ONNX Runtime finds no graphics adapter under /sys/class/drm",
            "Install the adapter's driver; in a container, let it see the adapter (--device /dev/dri); where a card there has no device/vendor, \
             as on WSL2 and some boards, set ORT_WEBGPU_EP_ALLOW_SOFTWARE_ADAPTER=1; or use a CPU device",
        )
    } else {
        ("ONNX Runtime finds no graphics adapter", "Install the adapter's driver, or use a CPU device")
    };
    Error::new(ErrorKind::Unsupported, cause).remedy(remedy)
}

/// The version that the plugin gives for itself.
fn version_of(device: *const sys::OrtEpDevice) -> String {
    // SAFETY: a device of the environment, whose metadata lives as long; the key is NUL-terminated.
    let value = unsafe {
        let metadata = (ort::api().EpDevice_EpMetadata)(device);
        (ort::api().GetKeyValue)(metadata, c"version".as_ptr())
    };
    // SAFETY: null or a text that lives as long as the metadata.
    unsafe { text(value) }.unwrap_or_else(|| "of an unknown version".to_owned())
}

/// # Safety
/// Null, or a live NUL-terminated text.
unsafe fn text(value: *const c_char) -> Option<String> {
    // SAFETY: the caller's promise.
    (!value.is_null()).then(|| unsafe { CStr::from_ptr(value) }.to_string_lossy().into_owned())
}

/// Refuses a session that runs nodes elsewhere than on the adapter: each would copy its values to the host and back in every pass.
pub(super) fn refuse_other_providers(session: &Session, what: &str, device: &str) -> Result<()> {
    let unsupported = unsupported_nodes(session)?;
    let Some((name, operator, provider)) = unsupported.first() else { return Ok(()) };
    let more = if unsupported.len() > 1 { format!(" and {} more", unsupported.len() - 1) } else { String::new() };
    Err(Error::new(
        ErrorKind::Unsupported,
        format!("{device} has no {operator} for the node {name}{more} of the {what}, which {provider} would run"),
    )
    .remedy("Use a CPU device, or a newer plugin"))
}

/// Name, operator and provider of the nodes that another provider runs.
fn unsupported_nodes(session: &Session) -> Result<Vec<(String, String, String)>> {
    let api = ort::api();
    let (mut parts, mut count) = (std::ptr::null(), 0);
    // SAFETY: a live session, and places for the list, which the session owns.
    let status = unsafe { (api.Session_GetEpGraphAssignmentInfo)(session.ptr(), &mut parts, &mut count) };
    check("tell which provider runs each node", status)?;
    let mut unsupported = Vec::new();
    for i in 0..count {
        // SAFETY: one of the list's `count` parts.
        let part = unsafe { *parts.add(i) };
        let mut provider = std::ptr::null();
        // SAFETY: a live part, and a place for its text.
        check("name a provider", unsafe { (api.EpAssignedSubgraph_GetEpName)(part, &mut provider) })?;
        // SAFETY: a text of the part.
        let provider = unsafe { text(provider) }.unwrap_or_default();
        if provider == PROVIDER {
            continue;
        }
        let (mut nodes, mut node_count) = (std::ptr::null(), 0);
        // SAFETY: a live part, and places for its nodes.
        check("list nodes", unsafe { (api.EpAssignedSubgraph_GetNodes)(part, &mut nodes, &mut node_count) })?;
        for j in 0..node_count {
            // SAFETY: one of the part's nodes.
            let node = unsafe { *nodes.add(j) };
            let (mut name, mut operator) = (std::ptr::null(), std::ptr::null());
            // SAFETY: a live node, and a place for its text.
            check("name a node", unsafe { (api.EpAssignedNode_GetName)(node, &mut name) })?;
            // SAFETY: as above.
            check("name an operator", unsafe { (api.EpAssignedNode_GetOperatorType)(node, &mut operator) })?;
            // SAFETY: texts of the node.
            let (name, operator) = unsafe { (text(name), text(operator)) };
            unsupported.push((name.unwrap_or_default(), operator.unwrap_or_default(), provider.clone()));
        }
    }
    Ok(unsupported)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::Precision;
    use crate::runtime::self_test;

    #[test]
    fn a_tensor_that_is_too_large_is_refused_with_figures() {
        check_fits(1 << 20, "decoder", "conv.weight", 1 << 20).expect("it fits");
        check_fits(1 << 20, "decoder", "conv.weight", (1 << 20) + 1).expect_err("one byte too many");
        let error = check_fits(1 << 20, "decoder", "conv.weight", 3 << 19).expect_err("half as much again");
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::Unsupported, Some("conv.weight")));
        assert!(error.cause().ends_with("has 1.5 MiB, and the adapter uses at most 1.0 MiB as one buffer"), "{error}");
    }

    #[test]
    fn nodes_that_another_provider_runs_are_refused_by_name() {
        let ort = Ort::find(&LibrarySearch::for_tools()).expect("ONNX Runtime: run `cargo xtask setup`");
        // Without the plugin, the processor runs every node.
        let builder = Session::builder(ort.environment()).and_then(|b| Ok(b.with_config_entry(RECORD_PROVIDERS, "1")?));
        let model = self_test::model(Precision::F32);
        let session = builder.and_then(|mut builder| builder.commit_from_memory(&model)).expect("a session");
        let refused = refuse_other_providers(&session, "decoder", "the adapter").expect_err("no node is on an adapter");
        assert_eq!(refused.kind(), ErrorKind::Unsupported);
        let cause = "the adapter has no Add for the node y of the decoder, which CPUExecutionProvider would run";
        assert_eq!(refused.cause(), cause);
    }
}
