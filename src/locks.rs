//! The locks of all modules: those of `parking_lot`. In debug builds with the feature `lock-order`, which tests enable, an order in which threads
//! take them that could deadlock ends the process with a message, although no thread has waited (`tests/lock-order`).

#[cfg(all(feature = "lock-order", debug_assertions))]
pub use lock_order::{Condvar, Mutex, MutexGuard, ReentrantMutex, RwLock};
#[cfg(not(all(feature = "lock-order", debug_assertions)))]
pub use parking_lot::{Condvar, Mutex, MutexGuard, ReentrantMutex, RwLock};
