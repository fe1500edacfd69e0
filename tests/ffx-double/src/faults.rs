//! Calls that fail on purpose, before they reach the library.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

use windows::Win32::System::Diagnostics::Debug::RaiseException;

use crate::library::Library;
use crate::{MEMORY, RUNTIME, THREW};

/// Whether calls are counted, and fail when it is their turn.
static IS_ARMED: AtomicBool = AtomicBool::new(false);
/// Calls so far while armed.
static COUNT: AtomicU64 = AtomicU64::new(0);
/// Number of the call that fails, from 1; 0 for none.
static FAILING: AtomicU64 = AtomicU64::new(0);
/// How it fails: one of the numbers below.
static MANNER: AtomicU32 = AtomicU32::new(ONCE);
/// For lack of memory.
const ONCE: u32 = 0;
/// With all later ones.
const FOR_EVER: u32 = 1;
/// By a C++ exception, as AMD's libraries fail where Direct3D does.
const THROWING: u32 = 2;
/// Calls of `ffxDestroyContext` that failed.
static FAILED_DESTROYS: AtomicU64 = AtomicU64::new(0);

/// The code of this call of one of the five functions, if it fails on purpose.
pub(crate) fn injected(call: &str) -> Option<u32> {
    if !IS_ARMED.load(Ordering::SeqCst) {
        return None;
    }
    let (number, failing) = (COUNT.fetch_add(1, Ordering::SeqCst) + 1, FAILING.load(Ordering::SeqCst));
    let manner = MANNER.load(Ordering::SeqCst);
    if failing == 0 || number < failing || (number > failing && manner != FOR_EVER) {
        return None;
    }
    if call == "destroy" {
        FAILED_DESTROYS.fetch_add(1, Ordering::SeqCst);
    }
    Some(match manner {
        FOR_EVER => RUNTIME,
        THROWING => THREW,
        _ => MEMORY,
    })
}

/// Throws a C++ exception as Microsoft's compilers do.
pub(crate) fn throw() {
    /// Its code, flag, and first argument (Microsoft, `ehdata.h`).
    const CPP_EXCEPTION: u32 = 0xE06D_7363;
    const NONCONTINUABLE: u32 = 1;
    const MAGIC: usize = 0x1993_0520;
    // SAFETY: four numbers; no handler reads an object through them.
    unsafe { RaiseException(CPP_EXCEPTION, NONCONTINUABLE, Some(&[MAGIC, 0, 0, 0])) };
}

/// While armed, makes call number `call`, from 1 on, fail in a manner: 0 once for lack of memory, 1 with all later ones, 2 once by a C++
/// exception. 0 for no call. Calls are counted anew.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn DoubleFailCall(call: u64, manner: u32) {
    COUNT.store(0, Ordering::SeqCst);
    FAILED_DESTROYS.store(0, Ordering::SeqCst);
    MANNER.store(manner, Ordering::SeqCst);
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
