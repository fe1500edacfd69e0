//! The locks of `parking_lot`, which record in which order each thread takes them. Two threads that take two locks in opposite orders can
//! deadlock, but seldom do. Here the second order, on whatever thread and however much later, is reported, and ends the process.
//!
//! Locks are nodes of a graph. A thread that takes a lock adds an edge to it from each lock that it holds; an edge that closes a cycle is an order
//! that could deadlock. A lock that is only tried never waits, so that it gets no edge, but once held it counts like any other.

mod graph;

use std::time::{Duration, Instant};

use graph::Lock;
use parking_lot::lock_api;

/// A lock that takes part in the order.
pub struct Recorded<R> {
    inner: R,
    lock: Lock,
}

/// As `parking_lot::Mutex`.
pub type Mutex<T> = lock_api::Mutex<Recorded<parking_lot::RawMutex>, T>;
/// As `parking_lot::MutexGuard`.
pub type MutexGuard<'a, T> = lock_api::MutexGuard<'a, Recorded<parking_lot::RawMutex>, T>;
/// As `parking_lot::ReentrantMutex`. A thread that has it takes it again without waiting, which is no change of the order.
pub type ReentrantMutex<T> = lock_api::ReentrantMutex<Recorded<parking_lot::RawMutex>, parking_lot::RawThreadId, T>;
/// As `parking_lot::RwLock`. Readers count as writers: a reader waits for a writer that waits for another reader.
pub type RwLock<T> = lock_api::RwLock<Recorded<parking_lot::RawRwLock>, T>;
/// As `parking_lot::Condvar`.
pub type Condvar = lock_api::Condvar<RecordedCondvar>;

// SAFETY: every function takes, tries or releases the wrapped lock, as its own does.
unsafe impl<R: lock_api::RawMutex> lock_api::RawMutex for Recorded<R> {
    #[allow(clippy::declare_interior_mutable_const, reason = "the trait's own")]
    const INIT: Self = Self { inner: R::INIT, lock: Lock::NEW };

    type Guard = R::Guard;

    fn lock(&self) -> R::Guard {
        self.lock.before();
        let guard = self.inner.lock();
        self.lock.taken();
        guard
    }

    fn try_lock(&self) -> Option<R::Guard> {
        self.inner.try_lock().inspect(|_| self.lock.taken())
    }

    unsafe fn unlock(&self, guard: R::Guard) {
        self.lock.released();
        // SAFETY: the caller's promise.
        unsafe { self.inner.unlock(guard) };
    }

    fn is_locked(&self) -> bool {
        self.inner.is_locked()
    }
}

// SAFETY: as above.
unsafe impl<R: lock_api::RawMutexTimed> lock_api::RawMutexTimed for Recorded<R> {
    type Duration = R::Duration;
    type Instant = R::Instant;

    fn try_lock_for(&self, timeout: R::Duration) -> Option<R::Guard> {
        self.inner.try_lock_for(timeout).inspect(|_| self.lock.taken())
    }

    fn try_lock_until(&self, timeout: R::Instant) -> Option<R::Guard> {
        self.inner.try_lock_until(timeout).inspect(|_| self.lock.taken())
    }
}

// SAFETY: as above.
unsafe impl<R: lock_api::RawRwLock> lock_api::RawRwLock for Recorded<R> {
    #[allow(clippy::declare_interior_mutable_const, reason = "the trait's own")]
    const INIT: Self = Self { inner: R::INIT, lock: Lock::NEW };

    type SharedGuard = R::SharedGuard;
    type ExclusiveGuard = R::ExclusiveGuard;

    fn lock_shared(&self) -> R::SharedGuard {
        self.lock.before();
        let guard = self.inner.lock_shared();
        self.lock.taken();
        guard
    }

    fn try_lock_shared(&self) -> Option<R::SharedGuard> {
        self.inner.try_lock_shared().inspect(|_| self.lock.taken())
    }

    unsafe fn unlock_shared(&self, guard: R::SharedGuard) {
        self.lock.released();
        // SAFETY: the caller's promise.
        unsafe { self.inner.unlock_shared(guard) };
    }

    fn lock_exclusive(&self) -> R::ExclusiveGuard {
        self.lock.before();
        let guard = self.inner.lock_exclusive();
        self.lock.taken();
        guard
    }

    fn try_lock_exclusive(&self) -> Option<R::ExclusiveGuard> {
        self.inner.try_lock_exclusive().inspect(|_| self.lock.taken())
    }

    unsafe fn unlock_exclusive(&self, guard: R::ExclusiveGuard) {
        self.lock.released();
        // SAFETY: the caller's promise.
        unsafe { self.inner.unlock_exclusive(guard) };
    }

    fn is_locked(&self) -> bool {
        self.inner.is_locked()
    }

    fn is_locked_exclusive(&self) -> bool {
        self.inner.is_locked_exclusive()
    }
}

/// A condition variable for [`Mutex`].
pub struct RecordedCondvar(parking_lot::RawCondvar);

impl RecordedCondvar {
    /// A thread that waits takes the lock again at the end, while it holds what it has taken since.
    fn before(mutex: &Recorded<parking_lot::RawMutex>) {
        mutex.lock.released();
        mutex.lock.before();
        mutex.lock.taken();
    }
}

// SAFETY: every function is the wrapped one's, on the wrapped lock.
unsafe impl lock_api::RawCondvar for RecordedCondvar {
    #[allow(clippy::declare_interior_mutable_const, reason = "the trait's own")]
    const INIT: Self = Self(<parking_lot::RawCondvar as lock_api::RawCondvar>::INIT);

    type RawMutex = Recorded<parking_lot::RawMutex>;

    unsafe fn wait(&self, mutex: &Self::RawMutex, guard: &mut <Self::RawMutex as lock_api::RawMutex>::Guard) {
        Self::before(mutex);
        // SAFETY: the caller's promise.
        unsafe { self.0.wait(&mutex.inner, guard) };
    }

    fn notify_one(&self) -> bool {
        self.0.notify_one()
    }

    fn notify_all(&self) -> usize {
        self.0.notify_all()
    }
}

// SAFETY: as above.
unsafe impl lock_api::RawCondvarTimed for RecordedCondvar {
    fn checked_duration_to_instant(timeout: &Duration) -> Option<Instant> {
        <parking_lot::RawCondvar as lock_api::RawCondvarTimed>::checked_duration_to_instant(timeout)
    }

    unsafe fn wait_until(
        &self,
        mutex: &Self::RawMutex,
        guard: &mut <Self::RawMutex as lock_api::RawMutex>::Guard,
        timeout: &Instant,
    ) -> bool {
        Self::before(mutex);
        // SAFETY: the caller's promise.
        unsafe { self.0.wait_until(&mutex.inner, guard, timeout) }
    }
}
