//! Residency of our GPU memory: its priority below the engine's, and its eviction while it is unused.

use windows::Win32::Foundation::E_NOTIMPL;
use windows::Win32::Graphics::Direct3D12::{
    D3D12_FENCE_FLAG_NONE, D3D12_RESIDENCY_FLAG_NONE, D3D12_RESIDENCY_PRIORITY_LOW, ID3D12Device1, ID3D12Device3,
    ID3D12Fence, ID3D12Pageable, ID3D12Resource,
};
use windows::core::Interface;

use super::failure::failed_on;
use super::{FencePoint, Gpu, Queue};
use crate::{Error, ErrorKind, Result};

/// A set of resources that are made resident and evicted together. Their residency priority is low, below the default of an engine's
/// memory (`D3D12_RESIDENCY_PRIORITY_NORMAL`): when memory is short, the system evicts this set first.
pub(crate) struct ResidencySet {
    objects: Vec<Option<ID3D12Pageable>>,
    is_resident: bool,
    /// Fence of `EnqueueMakeResident` and its last value; `None` before the first call.
    fence: Option<(ID3D12Fence, u64)>,
}

impl ResidencySet {
    pub(crate) fn new() -> Self {
        Self { objects: Vec::new(), is_resident: true, fence: None }
    }

    pub(crate) fn is_resident(&self) -> bool {
        self.is_resident
    }

    /// Adds a resident resource; new resources are resident. The set must be resident.
    pub(crate) fn add(&mut self, gpu: &Gpu, resource: &ID3D12Resource) -> Result<()> {
        assert!(self.is_resident, "a resident set");
        let object: ID3D12Pageable =
            resource.cast().map_err(|e| failed_on(gpu.device(), "IUnknown::QueryInterface", &e))?;
        let object = Some(object);
        // Windows before 1709 has no priorities. The memory then ranks like the engine's, which matters only when memory is short.
        if let Ok(device) = gpu.device().cast::<ID3D12Device1>() {
            // SAFETY: a live device, and one object with one priority, which live during the call.
            let set = unsafe { device.SetResidencyPriority(1, &object, &D3D12_RESIDENCY_PRIORITY_LOW) };
            if let Err(e) = set {
                log::debug!("ID3D12Device1::SetResidencyPriority failed: {e}");
            }
        }
        self.objects.push(object);
        Ok(())
    }

    /// Evicts the memory from the device; the contents are kept. No work on the device may use it any more.
    ///
    /// # Errors
    /// `Device`, `DeviceRemoved`. The set stays resident then.
    pub(crate) fn evict(&mut self, gpu: &Gpu) -> Result<()> {
        if self.is_resident && !self.objects.is_empty() {
            // SAFETY: a live device and live objects, each resident once and used by nothing.
            unsafe { gpu.device().Evict(&self.objects) }
                .map_err(|e| failed_on(gpu.device(), "ID3D12Device::Evict", &e))?;
            self.is_resident = false;
        }
        Ok(())
    }

    /// Makes the memory resident for later work of `queue`. The queue waits for it on the device; this thread does not wait, except on a
    /// Windows without `EnqueueMakeResident`.
    ///
    /// # Errors
    /// `OutOfMemory` if it does not fit; `Device`, `DeviceRemoved`. The set stays evicted then, with its contents, and the next call tries
    /// again.
    pub(crate) fn make_resident(&mut self, gpu: &Gpu, queue: &Queue) -> Result<()> {
        if self.is_resident {
            return Ok(());
        }
        match self.enqueue(gpu)? {
            // The queue waits until the memory is resident.
            Some(fence_point) => queue.wait(&fence_point),
            None => {
                // SAFETY: a live device and live objects.
                unsafe { gpu.device().MakeResident(&self.objects) }
                    .map_err(|e| with_remedy(failed_on(gpu.device(), "ID3D12Device::MakeResident", &e)))?;
                self.is_resident = true;
                Ok(())
            }
        }
    }

    /// Starts making the memory resident; returns the fence point of its completion, or `None` if the system cannot do it asynchronously.
    fn enqueue(&mut self, gpu: &Gpu) -> Result<Option<FencePoint>> {
        let device = gpu.device();
        let Ok(newer) = device.cast::<ID3D12Device3>() else { return Ok(None) };
        let (fence, value) = match &self.fence {
            Some((fence, last)) => (fence.clone(), last + 1),
            None => {
                // SAFETY: a live device; the call takes values only.
                let fence = unsafe { device.CreateFence(0, D3D12_FENCE_FLAG_NONE) };
                (fence.map_err(|e| failed_on(device, "ID3D12Device::CreateFence", &e))?, 1)
            }
        };
        // SAFETY: a live device, live objects, and a fence of the device whose value has not been used.
        match unsafe { newer.EnqueueMakeResident(D3D12_RESIDENCY_FLAG_NONE, &self.objects, &fence, value) } {
            Ok(()) => {}
            Err(e) if e.code() == E_NOTIMPL => return Ok(None),
            Err(e) => return Err(with_remedy(failed_on(device, "ID3D12Device3::EnqueueMakeResident", &e))),
        }
        self.is_resident = true;
        let fence_point = FencePoint::new(&fence, value, device);
        self.fence = Some((fence, value));
        Ok(Some(fence_point))
    }
}

/// Adds a remedy to an `OutOfMemory` error.
fn with_remedy(error: Error) -> Error {
    if error.kind() != ErrorKind::OutOfMemory {
        return error;
    }
    Error::new(ErrorKind::OutOfMemory, format!("a resting rollout's memory finds no place: {}", error.cause()))
        .remedy("Free memory of the device, or let other rollouts rest, and try again")
}

impl std::fmt::Debug for ResidencySet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "ResidencySet({} objects, {})",
            self.objects.len(),
            if self.is_resident { "resident" } else { "evicted" }
        )
    }
}
