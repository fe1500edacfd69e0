//! The adapters that Vulkan lists, and the one among them that the provider takes where it uses Vulkan.
//!
//! The provider chooses by itself, by a preference for speed or for saving power. So what a host names is compared with that choice.

use std::ffi::CStr;
use std::path::{Path, PathBuf};
use std::ptr::{null, null_mut};

use ash::vk;

use super::WebGpuAdapter;
use crate::runtime::DeviceMemory;
use crate::{Error, ErrorKind, Result};

/// Vulkan's loader, if the provider uses Vulkan: on Windows it finds `vulkan-1.dll` only as a file in its own folder, since it loads it with
/// flags that allow full paths only. `plugin` is the provider's library.
pub(super) fn loader(plugin: Option<&Path>) -> Option<PathBuf> {
    if cfg!(windows) {
        plugin.map(|plugin| plugin.with_file_name("vulkan-1.dll")).filter(|loader| loader.is_file())
    } else {
        cfg!(target_os = "linux").then(|| PathBuf::from("libvulkan.so.1"))
    }
}

/// Kinds of adapters, as the provider ranks them for speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Discrete,
    Integrated,
    Software,
    /// Virtual ones among them; Dawn ranks them last.
    Other,
}

/// An adapter.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Adapter {
    name: String,
    /// PCI identifier of its maker.
    vendor: u32,
    kind: Kind,
    /// Bytes of its own memory.
    memory: u64,
}

/// The adapter that the provider takes.
pub(super) struct VulkanAdapter {
    pub(super) name: String,
    /// Bytes that a shader can read or write as one buffer.
    pub(super) largest_buffer: u64,
    /// Whether the provider must prefer saving power to take it.
    pub(super) low_power: bool,
    /// Whether its driver reports a budget and the memory in use.
    reports_memory: bool,
    instance: Instance,
    device: vk::PhysicalDevice,
}

/// Vulkan, with its library.
struct Instance {
    // Dropped after the instance was destroyed.
    instance: ash::Instance,
    _entry: ash::Entry,
    _library: libloading::Library,
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: nothing that was made of the instance is left.
        unsafe { self.instance.destroy_instance(None) };
    }
}

/// All adapters, in Vulkan's order, where its loader is found without the provider's library.
pub(super) fn list() -> Result<Vec<WebGpuAdapter>> {
    let Some(loader) = loader(None) else { return Ok(Vec::new()) };
    let (_, adapters) = Instance::new(&loader)?.adapters()?;
    let public = |Adapter { name, vendor, kind, memory }| {
        let software = kind == Kind::Software;
        WebGpuAdapter { name, vendor, memory, software }
    };
    Ok(adapters.into_iter().map(public).collect())
}

impl VulkanAdapter {
    /// The adapter that `wanted` names, or the fastest.
    pub(super) fn choose(loader: &Path, wanted: Option<&str>) -> Result<Self> {
        let instance = Instance::new(loader)?;
        let (devices, adapters) = instance.adapters()?;
        let (i, low_power) = choose(&adapters, wanted)?;
        // SAFETY: a device of the live instance.
        let limits = unsafe { instance.instance.get_physical_device_properties(devices[i]) }.limits;
        let largest_buffer = limits.max_storage_buffer_range.into();
        let reports_memory = instance.has_extension(devices[i], ash::ext::memory_budget::NAME)?;
        Ok(Self {
            name: adapters[i].name.clone(),
            largest_buffer,
            low_power,
            reports_memory,
            device: devices[i],
            instance,
        })
    }

    /// Its memory budget and use; `None` if the driver does not report them.
    pub(super) fn memory(&self) -> Option<DeviceMemory> {
        if !self.reports_memory {
            return None;
        }
        let instance = &self.instance.instance;
        let mut budgets = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
        let mut properties = vk::PhysicalDeviceMemoryProperties2::default().push_next(&mut budgets);
        // SAFETY: as above; the driver has the extension.
        unsafe { instance.get_physical_device_memory_properties2(self.device, &mut properties) };
        let memory = properties.memory_properties;
        let heaps = memory.memory_heaps_as_slice().iter().zip(budgets.heap_budget).zip(budgets.heap_usage);
        let local = heaps.filter(|((heap, _), _)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        let sum = local.fold((0, 0), |(granted, used), ((_, budget), usage)| {
            (u64::saturating_add(granted, budget), u64::saturating_add(used, usage))
        });
        Some(DeviceMemory { granted: sum.0, used: sum.1 })
    }
}

impl Instance {
    fn new(loader: &Path) -> Result<Self> {
        // SAFETY: Vulkan's loader, whose initialisers are trusted as the graphics driver is.
        let library = unsafe { libloading::Library::new(loader) }
            .map_err(|error| no_vulkan(&format!("{} cannot be loaded: {error}", loader.display())))?;
        // SAFETY: Vulkan's loader has this symbol with this type.
        let address = unsafe { library.get::<vk::PFN_vkGetInstanceProcAddr>(b"vkGetInstanceProcAddr\0") }
            .map_err(|error| no_vulkan(&error.to_string()))?;
        // SAFETY: the function is Vulkan's, and its library is kept as long as the instance.
        let entry = unsafe { ash::Entry::from_static_fn(ash::StaticFn { get_instance_proc_addr: *address }) };
        let application = vk::ApplicationInfo::default().application_name(c"cairn").api_version(vk::API_VERSION_1_1);
        let information = vk::InstanceCreateInfo::default().application_info(&application);
        // SAFETY: live arguments; the instance is destroyed before the library is unloaded.
        let instance = unsafe { entry.create_instance(&information, None) }
            .map_err(|error| no_vulkan(&format!("it does not start: {error}")))?;
        Ok(Self { instance, _entry: entry, _library: library })
    }

    /// All adapters, with their descriptions.
    fn adapters(&self) -> Result<(Vec<vk::PhysicalDevice>, Vec<Adapter>)> {
        // SAFETY: a live instance.
        let devices = unsafe { self.instance.enumerate_physical_devices() }
            .map_err(|error| no_vulkan(&format!("its adapters cannot be listed: {error}")))?;
        let adapters = devices.iter().map(|device| self.describe(*device)).collect();
        Ok((devices, adapters))
    }

    /// Whether a device has an extension. Not by `ash`'s function, whose list of the driver's length is allocated or ends the program.
    fn has_extension(&self, device: vk::PhysicalDevice, name: &CStr) -> Result<bool> {
        let list = self.instance.fp_v1_0().enumerate_device_extension_properties;
        let mut extensions = Vec::<vk::ExtensionProperties>::new();
        loop {
            let mut count = 0;
            // SAFETY: a device of the live instance, and a place for the number.
            let counted = unsafe { list(device, null(), &mut count, null_mut()) };
            extensions.try_reserve_exact(count as usize).map_err(|_| {
                Error::new(ErrorKind::OutOfMemory, format!("a list of {count} Vulkan extensions cannot be allocated"))
            })?;
            // SAFETY: as above, and room for that many.
            let listed = unsafe { list(device, null(), &mut count, extensions.as_mut_ptr()) };
            match (counted, listed) {
                (vk::Result::SUCCESS, vk::Result::SUCCESS) => {
                    // SAFETY: that many were written.
                    unsafe { extensions.set_len(count as usize) };
                    return Ok(extensions.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name)));
                }
                // It became longer in between.
                (vk::Result::SUCCESS, vk::Result::INCOMPLETE) => {}
                (vk::Result::SUCCESS, error) | (error, _) => return Err(no_vulkan(&error.to_string())),
            }
        }
    }

    fn describe(&self, device: vk::PhysicalDevice) -> Adapter {
        // SAFETY: a device of the live instance.
        let properties = unsafe { self.instance.get_physical_device_properties(device) };
        let name = properties.device_name_as_c_str().map(CStr::to_string_lossy).unwrap_or_default().into_owned();
        let kind = match properties.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => Kind::Discrete,
            vk::PhysicalDeviceType::INTEGRATED_GPU => Kind::Integrated,
            vk::PhysicalDeviceType::CPU => Kind::Software,
            _ => Kind::Other,
        };
        // SAFETY: as above.
        let memory = unsafe { self.instance.get_physical_device_memory_properties(device) };
        let local = memory.memory_heaps_as_slice().iter();
        let local = local.filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        Adapter {
            name,
            vendor: properties.vendor_id,
            kind,
            memory: local.map(|heap| heap.size).fold(0, u64::saturating_add),
        }
    }
}

/// The adapter that the provider takes, of those that Vulkan lists, and whether it must prefer saving power for that.
fn choose(adapters: &[Adapter], wanted: Option<&str>) -> Result<(usize, bool)> {
    // The first of the best kind.
    let taken = |low_power: bool| {
        let rank = |kind| match (low_power, kind) {
            (true, Kind::Discrete) => Kind::Integrated,
            (true, Kind::Integrated) => Kind::Discrete,
            (_, kind) => kind,
        };
        (0..adapters.len()).min_by_key(|i| rank(adapters[*i].kind))
    };
    let (Some(fast), Some(low)) = (taken(false), taken(true)) else {
        return Err(no_vulkan("it lists no adapter"));
    };
    let Some(wanted) = wanted else {
        return match adapters[fast].kind {
            Kind::Software => Err(Error::new(
                ErrorKind::Unsupported,
                format!("the only adapter is {}, by which the processor emulates one", adapters[fast].name),
            )
            .remedy(
                "Install the driver of your graphics adapter, use a CPU device, or name this adapter to use it anyway",
            )),
            _ => Ok((fast, false)),
        };
    };
    let matches = |i: usize| is_named(adapters, i, wanted);
    if matches(fast) {
        return Ok((fast, false));
    }
    if matches(low) {
        return Ok((low, true));
    }
    let list: Vec<_> = adapters
        .iter()
        .enumerate()
        .map(|(i, adapter)| format!("{i}: {} (vendor {:#06x})", adapter.name, adapter.vendor))
        .collect();
    let list = list.join("; ");
    Err(match (0..adapters.len()).find(|i| matches(*i)) {
        Some(i) => Error::new(
            ErrorKind::Unsupported,
            format!("ONNX Runtime takes {} and not {}", adapters[fast].name, adapters[i].name),
        )
        .remedy("Hide the other adapters from the program: the environment variable VK_DRIVER_FILES names the driver to use"),
        None => Error::new(ErrorKind::InvalidArgument, format!("no adapter is named {wanted:?}. There are {list}"))
            .remedy("Give a part of a name, a vendor such as 0x1002, or a number of this list"),
    }
    .field("adapter"))
}

/// Whether `wanted` is the adapter's number, its vendor in hexadecimal, or a part of its name in any case. A number beyond the list, such as 9070, is
/// a part of a name.
fn is_named(adapters: &[Adapter], number: usize, wanted: &str) -> bool {
    let adapter = &adapters[number];
    if let Some(vendor) = wanted.strip_prefix("0x") {
        return u32::from_str_radix(vendor, 16).is_ok_and(|vendor| vendor == adapter.vendor);
    }
    match wanted.parse::<usize>() {
        Ok(wanted) if wanted < adapters.len() => wanted == number,
        _ => !wanted.is_empty() && adapter.name.to_lowercase().contains(&wanted.to_lowercase()),
    }
}

fn no_vulkan(cause: &str) -> Error {
    Error::new(ErrorKind::Unsupported, format!("there is no graphics adapter by Vulkan: {cause}")).remedy(
        if cfg!(windows) {
            "Install the adapter's newest driver, or use Direct3D 12: remove vulkan-1.dll beside the provider's library"
        } else {
            "Install the adapter's Vulkan driver and the package libvulkan1, or use a CPU device"
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapters() -> Vec<Adapter> {
        [("llvmpipe (LLVM 19)", 0x10005, Kind::Software), ("AMD Radeon 780M", 0x1002, Kind::Integrated)]
            .into_iter()
            .chain([
                ("NVIDIA GeForce RTX 4090", 0x10de, Kind::Discrete),
                ("AMD Radeon RX 9070", 0x1002, Kind::Discrete),
            ])
            .map(|(name, vendor, kind)| Adapter { name: name.to_owned(), vendor, kind, memory: 0 })
            .collect()
    }

    #[test]
    fn an_adapter_is_chosen_by_name_vendor_or_number() {
        let all = adapters();
        for (wanted, chosen) in [
            (None, (2, false)),
            (Some("geforce"), (2, false)),
            (Some("0x10de"), (2, false)),
            (Some("2"), (2, false)),
            (Some("radeon"), (1, true)),
            (Some("0x1002"), (1, true)),
        ] {
            assert_eq!(choose(&all, wanted).unwrap(), chosen, "{wanted:?}");
        }
    }

    /// As Dawn ranks them.
    #[test]
    fn an_adapter_of_another_kind_is_taken_after_the_processor() {
        let adapter = |name: &str, kind| Adapter { name: name.to_owned(), vendor: 1, kind, memory: 0 };
        let all = [adapter("virtual", Kind::Other), adapter("llvmpipe", Kind::Software)];
        assert_eq!(choose(&all, Some("llvmpipe")).unwrap(), (1, false));
        assert!(choose(&all, None).is_err() && choose(&all, Some("virtual")).is_err());
        assert_eq!(choose(&all[..1], None).unwrap(), (0, false));
    }

    #[test]
    fn what_the_provider_does_not_take_is_refused() {
        let all = adapters();
        let error = choose(&all, Some("9070")).unwrap_err();
        assert!(error.to_string().contains("takes NVIDIA GeForce RTX 4090 and not AMD Radeon RX 9070"), "{error}");
        let error = choose(&all, Some("voodoo")).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        assert!(error.to_string().contains("3: AMD Radeon RX 9070 (vendor 0x1002)"), "{error}");
        assert_eq!(choose(&all, Some("")).unwrap_err().kind(), ErrorKind::InvalidArgument);
        assert_eq!(choose(&[], None).unwrap_err().kind(), ErrorKind::Unsupported);
    }

    #[test]
    fn a_software_adapter_is_taken_only_by_name() {
        let only = &adapters()[..1];
        let error = choose(only, None).unwrap_err();
        assert!(error.to_string().contains("llvmpipe (LLVM 19), by which the processor emulates one"), "{error}");
        assert_eq!(choose(only, Some("llvmpipe")).unwrap(), (0, false));
    }
}
