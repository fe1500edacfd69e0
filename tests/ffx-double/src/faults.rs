//! Calls that fail on purpose, before they reach the library.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::library::Library;
use crate::{MEMORY, RUNTIME};

/// Whether calls are counted, and fail when it is their turn.
static IS_ARMED: AtomicBool = AtomicBool::new(false);
/// Calls so far while armed.
static COUNT: AtomicU64 = AtomicU64::new(0);
/// Number of the call that fails, from 1; 0 for none.
static FAILING: AtomicU64 = AtomicU64::new(0);
/// Whether all later calls fail too.
static IS_FOR_EVER: AtomicBool = AtomicBool::new(false);
/// Calls of `ffxDestroyContext` that failed.
static FAILED_DESTROYS: AtomicU64 = AtomicU64::new(0);

/// The code of this call of one of the five functions, if it fails on purpose.
pub(crate) fn injected(call: &str) -> Option<u32> {
    if !IS_ARMED.load(Ordering::SeqCst) {
        return None;
    }
    let (number, failing) = (COUNT.fetch_add(1, Ordering::SeqCst) + 1, FAILING.load(Ordering::SeqCst));
    let is_for_ever = IS_FOR_EVER.load(Ordering::SeqCst);
    if failing == 0 || number < failing || (number > failing && !is_for_ever) {
        return None;
    }
    if call == "destroy" {
        FAILED_DESTROYS.fetch_add(1, Ordering::SeqCst);
    }
    Some(if is_for_ever { RUNTIME } else { MEMORY })
}

/// While armed, makes call number `call`, from 1 on, fail: once for lack of memory, or with all later ones. 0 for no call. Calls are counted
/// anew.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn DoubleFailCall(call: u64, is_for_ever: u32) {
    COUNT.store(0, Ordering::SeqCst);
    FAILED_DESTROYS.store(0, Ordering::SeqCst);
    IS_FOR_EVER.store(is_for_ever != 0, Ordering::SeqCst);
    FAILING.store(call, Ordering::SeqCst);
}

/// Arms the failing call, or disarms it; returns the number of calls that were counted while armed.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn DoubleArmFailure(is_armed: u32) -> u64 {
    IS_ARMED.store(is_armed != 0, Ordering::SeqCst);
    COUNT.load(Ordering::SeqCst)
}

/// Number of calls of `ffxDestroyContext` that failed since [`DoubleFailCall`].
#[unsafe(no_mangle)]
pub(crate) extern "C" fn DoubleFailedDestroys() -> u64 {
    FAILED_DESTROYS.load(Ordering::SeqCst)
}

/// Of a loader: destroys all live contexts; returns their number. The device must no longer use them.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn DoubleDestroyAll() -> u64 {
    let mut count = 0;
    Library::handle("", |library| {
        // SAFETY: contexts of the effects' libraries, which nobody uses any more.
        count = unsafe { library.destroy_all() };
        crate::OK
    });
    count
}
