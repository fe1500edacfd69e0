//! Memory of an adapter as the system grants it to this process.

use windows::Win32::Graphics::Dxgi::{DXGI_MEMORY_SEGMENT_GROUP_LOCAL, DXGI_QUERY_VIDEO_MEMORY_INFO, IDXGIAdapter3};
use windows::core::Interface;

use super::Gpu;
use super::failure::failed;
use crate::Result;

/// What this process may use of an adapter's own memory, at this moment: others take and give. In bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Beyond this the system makes room by moving things out, and everything is slow.
    pub granted: u64,
    /// What the process uses already, an engine's textures and worlds alike.
    pub used: u64,
}

impl Budget {
    /// What is left.
    pub fn room(&self) -> u64 {
        self.granted.saturating_sub(self.used)
    }
}

impl Gpu {
    /// What may be used of the adapter's memory, as DXGI says; none where it does not say.
    ///
    /// # Errors
    /// `Device` when DXGI does not start, `InvalidArgument` when the adapter is gone.
    pub fn budget(&self) -> Result<Option<Budget>> {
        let (adapter, _) = self.found()?;
        let Ok(adapter) = adapter.cast::<IDXGIAdapter3>() else { return Ok(None) };
        let mut told = DXGI_QUERY_VIDEO_MEMORY_INFO::default();
        // SAFETY: a live adapter, and a place that lives during the call.
        unsafe { adapter.QueryVideoMemoryInfo(0, DXGI_MEMORY_SEGMENT_GROUP_LOCAL, &mut told) }
            .map_err(|e| failed("IDXGIAdapter3::QueryVideoMemoryInfo", &e))?;
        Ok((told.Budget > 0).then_some(Budget { granted: told.Budget, used: told.CurrentUsage }))
    }
}
