//! The video memory budget that the system grants to this process.

use windows::Win32::Graphics::Dxgi::{DXGI_MEMORY_SEGMENT_GROUP_LOCAL, DXGI_QUERY_VIDEO_MEMORY_INFO, IDXGIAdapter3};
use windows::core::Interface;

use super::Gpu;
use super::failure::failed;
use crate::Result;

/// Current budget of an adapter's local memory for this process, in bytes. It changes with the needs of other processes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryBudget {
    /// Above this amount the system evicts memory, and all GPU work becomes slow.
    pub granted: u64,
    /// Current usage of the process, including the engine's textures and worlds.
    pub used: u64,
}

impl MemoryBudget {
    /// Bytes of the budget that are not in use.
    pub fn available(&self) -> u64 {
        self.granted.saturating_sub(self.used)
    }
}

impl Gpu {
    /// The adapter's memory budget from DXGI; `None` if DXGI does not report it.
    ///
    /// # Errors
    /// `Device` when DXGI does not start, `InvalidArgument` when the adapter is gone.
    pub fn budget(&self) -> Result<Option<MemoryBudget>> {
        let (adapter, _) = self.adapter_entry()?;
        let Ok(adapter) = adapter.cast::<IDXGIAdapter3>() else { return Ok(None) };
        let mut info = DXGI_QUERY_VIDEO_MEMORY_INFO::default();
        // SAFETY: a live adapter, and an output struct that lives during the call.
        unsafe { adapter.QueryVideoMemoryInfo(0, DXGI_MEMORY_SEGMENT_GROUP_LOCAL, &mut info) }
            .map_err(|e| failed("IDXGIAdapter3::QueryVideoMemoryInfo", &e))?;
        Ok((info.Budget > 0).then_some(MemoryBudget { granted: info.Budget, used: info.CurrentUsage }))
    }
}
