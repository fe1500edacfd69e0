//! A device with its two queues.

use std::sync::{Arc, OnceLock};

use windows::Win32::Graphics::Direct3D::D3D_FEATURE_LEVEL_11_0;
use windows::Win32::Graphics::Direct3D12::{
    D3D12_COMMAND_LIST_TYPE_COMPUTE, D3D12_COMMAND_LIST_TYPE_DIRECT, D3D12CreateDevice, ID3D12CommandQueue,
    ID3D12Device, ID3D12DeviceChild,
};
use windows::Win32::Graphics::Dxgi::IDXGIAdapter1;
use windows::core::{IUnknown, Interface};

use super::failure::{failed, failed_on, removed};
use super::{Adapter, PipelineCache, Queue, adapter};
use crate::{Error, ErrorKind, Result};

/// A Direct3D 12 device, an engine's or our own, with a queue for frames and one for anchors. Cheap to clone; every clone is the
/// same device. Holds references to the engine's objects until the last clone is dropped.
///
/// Threads: may be used from any thread at any time.
#[derive(Clone)]
pub struct Gpu(Arc<Inner>);

struct Inner {
    frames: Queue,
    anchors: Queue,
    device: ID3D12Device,
    luid: u64,
    /// Cached, as each search creates a DXGI factory.
    adapter: OnceLock<(IDXGIAdapter1, Adapter)>,
    pipelines: PipelineCache,
}

impl Gpu {
    /// Wraps an engine's device. Frames are generated and copied on `queue`, of type direct or compute. The world's passes run on
    /// `anchors`, a compute queue of the same device; without it, on a compute queue of our own.
    ///
    /// # Errors
    /// `InvalidArgument` for a queue of another type or of another device, `DeviceRemoved` for a removed device.
    pub fn of_engine(
        device: &ID3D12Device,
        queue: &ID3D12CommandQueue,
        anchors: Option<&ID3D12CommandQueue>,
    ) -> Result<Self> {
        if let Some(gone) = removed(device) {
            return Err(gone);
        }
        let refuse = |field: &str, why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        owns(device, queue, "queue")?;
        let frames = Queue::of_engine(device, queue)?;
        if ![D3D12_COMMAND_LIST_TYPE_DIRECT, D3D12_COMMAND_LIST_TYPE_COMPUTE].contains(&frames.kind()) {
            return refuse("queue", "the queue is of no type that runs shaders; it must be direct or compute");
        }
        let anchors = match anchors {
            None => Queue::for_anchors(device)?,
            Some(anchors) => {
                owns(device, anchors, "anchors")?;
                let anchors = Queue::of_engine(device, anchors)?;
                if anchors.kind() != D3D12_COMMAND_LIST_TYPE_COMPUTE {
                    return refuse("anchors", "the queue for anchors is of another type than compute");
                }
                anchors
            }
        };
        // SAFETY: a live device.
        let luid = adapter::luid_number(unsafe { device.GetAdapterLuid() });
        let (device, adapter, pipelines) = (device.clone(), OnceLock::new(), PipelineCache::default());
        Ok(Self(Arc::new(Inner { frames, anchors, device, luid, adapter, pipelines })))
    }

    /// Creates a device on the adapter with `luid`, as listed by [`adapters`](super::adapters); without a LUID on the first hardware
    /// adapter, else on the first adapter.
    ///
    /// # Errors
    /// `InvalidArgument` if no adapter has the LUID, `Unsupported` if there is no adapter or it is below feature level 11_0,
    /// `Device` when its driver fails.
    pub fn on_adapter(luid: Option<u64>) -> Result<Self> {
        let (adapter, described) = adapter::find(luid)?;
        let mut device: Option<ID3D12Device> = None;
        // SAFETY: a live adapter, and an output pointer that lives during the call.
        unsafe { D3D12CreateDevice(&adapter, D3D_FEATURE_LEVEL_11_0, &mut device) }.map_err(|e| {
            let why = failed("D3D12CreateDevice", &e);
            Error::new(ErrorKind::Unsupported, format!("{} on {}", why.cause(), described.description))
                .remedy("Use another adapter with a Direct3D 12 driver, or a CPU device")
        })?;
        let device = device.ok_or_else(|| Error::new(ErrorKind::Device, "D3D12CreateDevice gave no device"))?;
        let frames = Queue::for_frames(&device)?;
        let anchors = Queue::for_anchors(&device)?;
        let (luid, adapter) = (described.luid, OnceLock::from((adapter, described)));
        Ok(Self(Arc::new(Inner { frames, anchors, device, luid, adapter, pipelines: PipelineCache::default() })))
    }

    /// The Direct3D device.
    pub fn device(&self) -> &ID3D12Device {
        &self.0.device
    }

    /// The queue on which frames are generated and copied.
    pub fn frames(&self) -> &Queue {
        &self.0.frames
    }

    /// The queue on which a world's passes run.
    pub fn anchors(&self) -> &Queue {
        &self.0.anchors
    }

    /// The LUID of its adapter.
    pub fn luid(&self) -> u64 {
        self.0.luid
    }

    /// Its adapter, cached at the first call. Tries no other adapter, and creates no device.
    ///
    /// # Errors
    /// `InvalidArgument` when the adapter is gone.
    pub fn adapter(&self) -> Result<Adapter> {
        self.adapter_entry().map(|(_, described)| described.clone())
    }

    /// The description of its adapter. Tries no other adapter, and creates no device.
    pub(crate) fn adapter_name(&self) -> Option<String> {
        self.adapter_entry().ok().map(|(_, described)| described.description.clone())
    }

    /// The cache of its compute pipelines.
    pub(crate) fn pipelines(&self) -> &PipelineCache {
        &self.0.pipelines
    }

    /// The DXGI adapter and its description, cached at the first call.
    pub(super) fn adapter_entry(&self) -> Result<&(IDXGIAdapter1, Adapter)> {
        let cell = &self.0.adapter;
        match cell.get() {
            Some(found) => Ok(found),
            None => {
                let found = adapter::find(Some(self.luid()))?;
                Ok(cell.get_or_init(|| found))
            }
        }
    }

    /// The removal reason if the device was removed: driver replaced, command hung, adapter taken out. Nothing created on it
    /// works any more; everything can still be released, and a new device can be created.
    pub fn removed(&self) -> Option<Error> {
        removed(&self.0.device)
    }

    /// The removal reason in the place of `error` if the device was removed and `error` is of a library that does not say so.
    pub(crate) fn or_removed(&self, error: Error) -> Error {
        error.or_removed(|| self.removed())
    }

    /// Checks that an object belongs to this device.
    pub(crate) fn owns(&self, object: &impl Interface, name: &str) -> Result<()> {
        owns(&self.0.device, object, name)
    }
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Gpu(adapter {:#x}{})", self.0.luid, if self.removed().is_some() { ", removed" } else { "" })
    }
}

/// Checks that an object belongs to `device`. COM objects are the same if their IUnknown pointers are equal.
fn owns(device: &ID3D12Device, object: &impl Interface, name: &str) -> Result<()> {
    let refuse = |why: &str| Error::new(ErrorKind::InvalidArgument, why).field(name);
    let child: ID3D12DeviceChild = object.cast().map_err(|_| refuse("it is no object of Direct3D 12"))?;
    let mut parent: Option<ID3D12Device> = None;
    // SAFETY: a live object, and an output pointer that lives during the call.
    unsafe { child.GetDevice(&mut parent) }.map_err(|e| failed_on(device, "ID3D12DeviceChild::GetDevice", &e))?;
    let identity = |device: &ID3D12Device| device.cast::<IUnknown>().map(|unknown| unknown.as_raw());
    match parent.as_ref().map(identity) {
        Some(Ok(parent)) if Ok(parent) == identity(device) => Ok(()),
        _ => Err(refuse("it belongs to another device")),
    }
}
