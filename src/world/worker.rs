//! A rollout with a queue of steps, which run in order, one at a time, on the caller's thread or on a worker thread.

use std::collections::VecDeque;
use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{JoinHandle, ThreadId};
use std::time::{Duration, Instant};

use crate::locks::{Condvar, Mutex, MutexGuard};

use super::anchor::KeptAnchor;
use super::controls::ControlInput;
use super::governor::{Budget, Governor, GovernorStatistics};
#[cfg(windows)]
use super::rollout::DeviceTimes;
use super::rollout::Rollout;
use super::statistics::{Statistics, StepInfo};
use super::world::World;
use crate::error::catch_panic;
use crate::quiet_mutex::Delay;
#[cfg(windows)]
use crate::runtime::CaptureStatistics;
use crate::tasks::calling_thread;
use crate::{Error, ErrorKind, Picture, Result};

/// A rollout whose steps are queued and run on a thread of their own, which the first [`submit`](Self::submit) starts, or run one
/// at a time on the caller's thread.
///
/// Threads: may be used from any thread at any time; calls that need exclusive access to the rollout return `Busy` instead of
/// waiting.
pub struct Worker {
    shared: Arc<Shared>,
    /// The worker thread, which the first submit starts.
    thread: Mutex<Option<JoinHandle<()>>>,
    capacity: usize,
}

/// State shared by the callers' threads and the worker thread.
struct Shared {
    rollout: Mutex<QueuedRollout>,
    queue: Mutex<Queue>,
    changed: Condvar,
    /// Set by the worker thread when it starts.
    thread_id: OnceLock<ThreadId>,
    /// Stops the step in progress; set and cleared with the queue locked.
    stop: Arc<AtomicBool>,
    /// Whether the rollout's memory is on a graphics device.
    has_device_memory: bool,
    /// Whether a step on the worker thread ended with an internal error. Calls that use the rollout fail then.
    broken: AtomicBool,
    /// As of the end of the last step, so that reading them does not wait for a step.
    statistics: Mutex<WorkerStatistics>,
}

/// Statistics of a rollout as of the end of its last step.
#[derive(Debug, Clone, Default)]
pub struct WorkerStatistics {
    /// Statistics of the rollout.
    pub rollout: Statistics,
    /// Device times on a Direct3D 12 device, and how many passes are captured there.
    #[cfg(windows)]
    pub device: Option<(DeviceTimes, CaptureStatistics)>,
    /// Statistics of its governor, or of the last one that it had.
    pub governor: GovernorStatistics,
}

/// A worker's rollout, and whether its motion is continuous.
#[derive(Debug)]
pub struct QueuedRollout {
    /// The rollout.
    pub rollout: Rollout,
    /// Whether there is no continuous motion from the latent before the last to the last one.
    last_is_cut: bool,
    /// Whether there will be no continuous motion from the last latent to the next one.
    pub next_is_cut: bool,
}

/// A rollout between its steps, locked for a call that only reads it.
pub struct ReadGuard<'a> {
    rollout: ManuallyDrop<MutexGuard<'a, QueuedRollout>>,
    shared: &'a Shared,
    /// Messages reach the host's callback once other calls need not wait for this one any more.
    _delay: Delay,
}

impl Deref for ReadGuard<'_> {
    type Target = QueuedRollout;

    fn deref(&self) -> &QueuedRollout {
        &self.rollout
    }
}

impl DerefMut for ReadGuard<'_> {
    fn deref_mut(&mut self) -> &mut QueuedRollout {
        &mut self.rollout
    }
}

impl Drop for ReadGuard<'_> {
    fn drop(&mut self) {
        // SAFETY: dropped once, here, and not used afterwards.
        unsafe { ManuallyDrop::drop(&mut self.rollout) };
        self.shared.queue.lock().readers -= 1;
        self.shared.changed.notify_all();
    }
}

/// Waiting and running steps, and results that nobody has fetched.
#[derive(Default)]
struct Queue {
    tickets: u64,
    waiting: VecDeque<(u64, Job)>,
    running: Option<u64>,
    done: VecDeque<(u64, Result<StepResult>)>,
    paused: bool,
    /// Whether to evict the rollout's device memory once the step in progress has ended.
    rest_requested: bool,
    /// Number of steps that may run although the queue is paused.
    single_steps: usize,
    /// Steps with tickets up to this one were cancelled.
    cancelled_up_to: u64,
    /// Number of calls that read the rollout between steps, or evict its memory: others of them wait.
    readers: usize,
    closing: bool,
}

/// A step that can be queued.
#[derive(Debug)]
pub enum Job {
    /// [`Rollout::step`] with these controls.
    Step(ControlInput),
    /// [`Rollout::append_pictures`]: one picture, or as many as a latent has.
    Append(Vec<Picture>),
}

/// Result of a queued step.
#[derive(Debug, Clone)]
pub struct StepResult {
    /// Statistics of the step.
    pub info: StepInfo,
    /// A copy of its anchor.
    pub anchor: Arc<KeptAnchor>,
}

/// State of a queued step.
#[derive(Debug)]
pub enum TicketState {
    /// The step waits or runs.
    Pending,
    /// The step has ended. Its ticket is no longer valid.
    Finished(Result<StepResult>),
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.close();
        if let Some(thread) = self.thread.lock().take() {
            // Panics on the thread do not pass `catch_panic`.
            _ = thread.join();
        }
    }
}

impl Worker {
    /// A worker for `rollout`. At most `capacity` steps may be waiting, running, or finished with a result that nobody has fetched.
    pub fn new(rollout: Rollout, capacity: usize) -> Self {
        let (stop, has_device_memory) = (rollout.stop_flag().clone(), rollout.world().device().is_gpu());
        let rollout = Mutex::new(QueuedRollout { rollout, last_is_cut: true, next_is_cut: true });
        let shared = Shared {
            rollout,
            queue: Mutex::default(),
            changed: Condvar::new(),
            thread_id: OnceLock::new(),
            stop,
            has_device_memory,
            broken: AtomicBool::new(false),
            statistics: Mutex::default(),
        };
        Self { shared: Arc::new(shared), thread: Mutex::new(None), capacity }
    }

    /// Stops the step in progress before its next pass or slice of one, cancels all queued ones and accepts no more. Calls that wait for steps return.
    pub fn close(&self) {
        let mut queue = self.shared.queue.lock();
        queue.closing = true;
        self.shared.stop.store(true, Ordering::SeqCst);
        queue.cancel_waiting("its rollout was destroyed");
        self.shared.changed.notify_all();
    }

    /// Whether the calling thread is the worker thread, as in a callback of a step that runs there.
    pub fn is_on_own_thread(&self) -> bool {
        self.shared.thread_id.get() == Some(&calling_thread())
    }

    /// Locks the rollout for a call on the caller's own thread. Returns `Busy` while steps are queued or another call uses it.
    pub fn lock_idle(&self) -> Result<MutexGuard<'_, QueuedRollout>> {
        self.shared.check()?;
        let queue = self.shared.queue.lock();
        if queue.running.is_some() || !queue.waiting.is_empty() {
            return Err(busy("steps are queued on it").remedy("Wait for them, or cancel them"));
        }
        let rollout = self.shared.rollout.try_lock().ok_or_else(|| busy("another call is using it"))?;
        // All cancelled steps have ended, so the stop flag can be cleared, unless the worker is closed.
        self.shared.stop.store(queue.closing, Ordering::SeqCst);
        Ok(rollout)
    }

    /// Locks the rollout for a call that only reads it, after waiting for other such calls. Returns `Busy` while a step runs, and instead of
    /// waiting if `is_nested`: on a thread inside another call on the rollout.
    pub fn lock_between_steps(&self, is_nested: bool) -> Result<ReadGuard<'_>> {
        self.shared.check()?;
        let mut queue = self.shared.queue.lock();
        loop {
            if let Some(rollout) = self.shared.rollout.try_lock() {
                queue.readers += 1;
                let rollout = ManuallyDrop::new(rollout);
                return Ok(ReadGuard { rollout, shared: &self.shared, _delay: Delay::new() });
            }
            if is_nested || queue.readers == 0 {
                return Err(busy("a step is running"));
            }
            self.shared.changed.wait(&mut queue);
        }
    }

    /// Runs one step on the caller's own thread.
    pub fn run(&self, job: &Job) -> Result<StepInfo> {
        let mut rollout = self.lock_idle()?;
        if matches!(job, Job::Step(_)) {
            rollout.rollout.apply_decision();
        }
        let result = rollout.run(job);
        rollout.publish_statistics(&self.shared.statistics);
        result
    }

    /// Queues a step and returns its ticket; `None` when the queue is full.
    pub fn submit(&self, job: Job) -> Result<Option<u64>> {
        self.shared.check()?;
        self.start()?;
        let mut queue = self.shared.queue.lock();
        if queue.depth() + queue.done.len() >= self.capacity {
            return Ok(None);
        }
        if queue.closing {
            return Err(Error::new(ErrorKind::Cancelled, "the rollout is being destroyed"));
        }
        queue.tickets += 1;
        let ticket = queue.tickets;
        queue.waiting.push_back((ticket, job));
        self.shared.changed.notify_all();
        Ok(Some(ticket))
    }

    /// The state of a ticket, after waiting for it at most `timeout`; `None` waits without limit. `take` is called with the result of a
    /// step that succeeded; the ticket stays valid if `take` fails. The call returns `Busy` instead of waiting on a thread that the
    /// step needs: the worker thread or, if `is_nested`, a thread inside another call on the rollout.
    pub fn ticket<E: From<Error>>(
        &self,
        ticket: u64,
        timeout: Option<Duration>,
        is_nested: bool,
        take: impl FnOnce(&StepResult) -> Result<(), E>,
    ) -> Result<TicketState, E> {
        let may_not_wait = timeout != Some(Duration::ZERO) && (is_nested || self.is_on_own_thread());
        let deadline = timeout.and_then(|timeout| Instant::now().checked_add(timeout));
        let mut queue = self.shared.queue.lock();
        loop {
            if let Some(at) = queue.done.iter().position(|(done, _)| *done == ticket) {
                if let Ok(done) = &queue.done[at].1 {
                    take(done)?;
                }
                return match queue.done.remove(at) {
                    Some((_, result)) => Ok(TicketState::Finished(result)),
                    None => Ok(TicketState::Pending),
                };
            }
            let is_pending =
                queue.running == Some(ticket) || queue.waiting.iter().any(|(waiting, _)| *waiting == ticket);
            if !is_pending {
                return Err(argument("ticket", format!("{ticket} is none, or was asked for already")).into());
            }
            if may_not_wait {
                let why = "this is a callback of a call or a step of its own, which would wait for itself";
                return Err(busy(why).remedy("Wait on another thread, or after the callback").into());
            }
            match deadline {
                Some(deadline) => {
                    if self.shared.changed.wait_until(&mut queue, deadline).timed_out() {
                        return Ok(TicketState::Pending);
                    }
                }
                // Also if the deadline is beyond the clock's range.
                None => self.shared.changed.wait(&mut queue),
            }
        }
    }

    /// Stops the step in progress before its next pass or slice of one, on whatever thread it runs, and cancels all queued ones.
    pub fn cancel(&self) {
        let mut queue = self.shared.queue.lock();
        self.shared.stop.store(true, Ordering::SeqCst);
        queue.cancelled_up_to = queue.tickets;
        queue.cancel_waiting("it was cancelled");
        self.shared.changed.notify_all();
    }

    /// Pauses the queue after the step in progress, or resumes it. A paused rollout on a graphics device rests.
    pub fn pause(&self, paused: bool) {
        let mut queue = self.shared.queue.lock();
        queue.paused = paused;
        queue.rest_requested = paused && self.shared.has_device_memory;
        queue.single_steps = 0;
        self.shared.changed.notify_all();
    }

    /// Lets one queued step run while the queue is paused. Returns `false` if all queued steps may run already.
    pub fn single_step(&self) -> Result<bool> {
        let mut queue = self.shared.queue.lock();
        if !queue.paused {
            return Err(argument("rollout", "it is not paused").remedy("Pause it first"));
        }
        if queue.single_steps >= queue.waiting.len() {
            return Ok(false);
        }
        queue.single_steps += 1;
        self.shared.changed.notify_all();
        Ok(true)
    }

    /// Statistics as of the end of the last step, and the number of waiting and running steps.
    pub fn statistics(&self) -> (WorkerStatistics, usize) {
        let depth = self.shared.queue.lock().depth();
        (self.shared.statistics.lock().clone(), depth)
    }

    /// Sets the rollout's budget; see [`Rollout::govern`].
    pub fn govern(&self, budget: &Budget, worlds: &[Arc<World>]) -> Result<Arc<Governor>> {
        let mut rollout = self.lock_idle()?;
        let governor = rollout.rollout.govern(budget, worlds)?;
        self.shared.statistics.lock().governor = governor.statistics();
        Ok(governor)
    }

    /// Removes the rollout's budget; see [`Rollout::ungovern`].
    pub fn ungovern(&self) -> Result<()> {
        self.lock_idle()?.rollout.ungovern();
        Ok(())
    }

    fn start(&self) -> Result<()> {
        let mut thread = self.thread.lock();
        if thread.is_some() {
            return Ok(());
        }
        // Allocates the whole queue, so that it never grows in a later call, which could fail.
        let out_of_memory = || Error::new(ErrorKind::OutOfMemory, "the queue cannot be allocated");
        {
            let mut queue = self.shared.queue.lock();
            queue.waiting.try_reserve(self.capacity).map_err(|_| out_of_memory())?;
            queue.done.try_reserve(self.capacity).map_err(|_| out_of_memory())?;
        }
        let shared = self.shared.clone();
        let started = std::thread::Builder::new().name("cairn-rollout".into()).spawn(move || shared.work());
        let started = started.map_err(|e| {
            Error::new(ErrorKind::OutOfMemory, format!("the system gives no thread for the queue: {e}"))
        })?;
        *thread = Some(started);
        Ok(())
    }
}

impl QueuedRollout {
    /// Runs a job. The caller has applied the governor's decision.
    fn run(&mut self, job: &Job) -> Result<StepInfo> {
        let (info, appended) = match job {
            Job::Step(controls) => (self.rollout.step_as_decided(controls)?, false),
            Job::Append(pictures) => (self.rollout.append_pictures(pictures)?, true),
        };
        self.last_is_cut = appended || self.next_is_cut;
        self.next_is_cut = false;
        Ok(info)
    }

    /// Stores the current statistics and device times where [`Worker::statistics`] reads them.
    fn publish_statistics(&mut self, published: &Mutex<WorkerStatistics>) {
        let rollout = self.rollout.statistics();
        #[cfg(windows)]
        let device = self.rollout.device_times().zip(self.rollout.capture_statistics());
        let governor = self.rollout.governor().map(|governor| governor.statistics());
        let mut published = published.lock();
        let governor = governor.unwrap_or(published.governor);
        *published = WorkerStatistics {
            rollout,
            #[cfg(windows)]
            device,
            governor,
        };
    }

    /// Makes the last latent a cut, as after a state was restored.
    pub fn mark_cut(&mut self) {
        self.last_is_cut = true;
        self.next_is_cut = false;
    }

    /// A copy of the last step's anchor.
    pub fn anchor(&mut self) -> Result<KeptAnchor> {
        KeptAnchor::of(&mut self.rollout, self.last_is_cut)
    }
}

impl Shared {
    fn check(&self) -> Result<()> {
        if self.broken.load(Ordering::SeqCst) {
            let why = "a step of this rollout ended by a fault of the library";
            return Err(Error::new(ErrorKind::Poisoned, why).remedy("Destroy it"));
        }
        Ok(())
    }

    /// Main function of the worker thread: runs one step after the other until the worker is closed.
    fn work(&self) {
        _ = self.thread_id.set(std::thread::current().id());
        while let Some((ticket, job)) = self.next() {
            let result: Result<StepResult> = catch_panic(|| {
                let mut queued = self.rollout.lock();
                let queued = &mut *queued;
                // Only now: until here a step on another thread may have run, which its cancellation must still stop.
                self.clear_stop(ticket);
                // Done first: a move to another world replaces the context that the anchor's memory belongs to.
                queued.rollout.apply_decision();
                // Allocated before the step: otherwise the step could succeed and its anchor still fail for want of memory.
                let mut anchor = KeptAnchor::allocate(&mut queued.rollout)?;
                let info = queued.run(&job)?;
                queued.publish_statistics(&self.statistics);
                anchor.fill(&mut queued.rollout, queued.last_is_cut)?;
                Ok(StepResult { info, anchor: Arc::new(anchor) })
            });
            let mut queue = self.queue.lock();
            queue.running = None;
            let failed = result.is_err();
            if result.as_ref().is_err_and(|failure| failure.kind() == ErrorKind::Internal) {
                self.broken.store(true, Ordering::SeqCst);
            }
            queue.done.push_back((ticket, result));
            if failed {
                // The controls of later steps assume that this step succeeded.
                queue.cancel_waiting("a step before it failed");
            }
            self.changed.notify_all();
        }
    }

    /// Clears the stop flag for the step with this ticket, unless it was cancelled or the worker is closed.
    fn clear_stop(&self, ticket: u64) {
        let queue = self.queue.lock();
        self.stop.store(queue.closing || ticket <= queue.cancelled_up_to, Ordering::SeqCst);
    }

    fn next(&self) -> Option<(u64, Job)> {
        let mut queue = self.queue.lock();
        loop {
            if queue.closing {
                return None;
            }
            let may_run = !queue.paused || queue.single_steps > 0;
            if let Some((ticket, job)) = may_run.then(|| queue.waiting.pop_front()).flatten() {
                queue.single_steps = queue.single_steps.saturating_sub(1);
                queue.rest_requested = false;
                queue.running = Some(ticket);
                return Some((ticket, job));
            }
            if std::mem::take(&mut queue.rest_requested) {
                queue.readers += 1;
                let delay = Delay::new();
                MutexGuard::unlocked(&mut queue, || self.rest());
                queue.readers -= 1;
                self.changed.notify_all();
                MutexGuard::unlocked(&mut queue, || drop(delay));
                continue;
            }
            self.changed.wait(&mut queue);
        }
    }

    /// Evicts the device memory of a paused rollout. Does nothing while another call uses the rollout.
    fn rest(&self) {
        let result: Result<()> = catch_panic(|| match self.rollout.try_lock() {
            Some(mut queued) => Ok(queued.rollout.rest()?),
            None => Ok(()),
        });
        if let Err(failure) = result {
            log::warn!("a paused rollout keeps its place in the device's memory: {failure}");
        }
    }
}

impl Queue {
    /// Number of waiting and running steps.
    fn depth(&self) -> usize {
        self.waiting.len() + usize::from(self.running.is_some())
    }

    /// Cancels all waiting steps.
    fn cancel_waiting(&mut self, why: &str) {
        self.single_steps = 0;
        while let Some((ticket, _)) = self.waiting.pop_front() {
            let failure = Error::new(ErrorKind::Cancelled, format!("the queued step was not made: {why}"));
            self.done.push_back((ticket, Err(failure)));
        }
    }
}

fn busy(why: &str) -> Error {
    Error::new(ErrorKind::Busy, format!("the rollout is in use: {why}"))
}

fn argument(name: &str, why: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidArgument, why).field(name)
}

impl std::fmt::Debug for Worker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Worker").field("capacity", &self.capacity).finish_non_exhaustive()
    }
}
