//! Notification of changes of the video memory budget.

use windows::Win32::Foundation::{CloseHandle, HANDLE, WAIT_OBJECT_0};
use windows::Win32::Graphics::Dxgi::IDXGIAdapter3;
use windows::Win32::System::Threading::{CreateEventW, WaitForSingleObject};
use windows::core::Interface;

use super::Gpu;

/// Detects changes of an adapter's memory budget.
///
/// Threads: may be used from any thread at any time.
pub(crate) struct BudgetChanges {
    adapter: IDXGIAdapter3,
    event: HANDLE,
    cookie: u32,
}

// SAFETY: an adapter and an event of the system's may be used from any thread.
unsafe impl Send for BudgetChanges {}
// SAFETY: as above.
unsafe impl Sync for BudgetChanges {}

impl BudgetChanges {
    /// `None` if the system has no notification.
    pub(crate) fn of(gpu: &Gpu) -> Option<Self> {
        let adapter = gpu.adapter_entry().ok()?.0.cast::<IDXGIAdapter3>().ok()?;
        // SAFETY: no name and no security attributes are given. The event resets itself when a wait consumes a signal.
        let event = unsafe { CreateEventW(None, false, false, None) }.ok()?;
        // SAFETY: a live adapter, and an event that is closed after it was unregistered.
        match unsafe { adapter.RegisterVideoMemoryBudgetChangeNotificationEvent(event) } {
            Ok(cookie) => Some(Self { adapter, event, cookie }),
            Err(e) => {
                log::debug!("IDXGIAdapter3::RegisterVideoMemoryBudgetChangeNotificationEvent failed: {e}");
                // SAFETY: the handle is open and owned by this code.
                _ = unsafe { CloseHandle(event) };
                None
            }
        }
    }

    /// Whether the budget has changed since the last call. Does not wait.
    pub(crate) fn changed(&self) -> bool {
        // SAFETY: the handle is open.
        unsafe { WaitForSingleObject(self.event, 0) == WAIT_OBJECT_0 }
    }
}

impl Drop for BudgetChanges {
    fn drop(&mut self) {
        // SAFETY: a live adapter and the cookie of its registration.
        unsafe { self.adapter.UnregisterVideoMemoryBudgetChangeNotification(self.cookie) };
        // SAFETY: the handle is open and owned by this code.
        _ = unsafe { CloseHandle(self.event) };
    }
}

impl std::fmt::Debug for BudgetChanges {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "BudgetChanges({})", self.cookie)
    }
}
