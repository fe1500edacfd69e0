//! A rollout with its queue: steps in order, one at a time, on the caller's thread or on a worker's.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{JoinHandle, ThreadId};
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

#[cfg(windows)]
use super::DeviceTimes;
use super::{Budget, ControlInput, Governor, GovernorStatistics, KeptAnchor, Rollout, Statistics, StepInfo, World};
use crate::error::catch_panic;
#[cfg(windows)]
use crate::runtime::Captured;
use crate::tasks::calling_thread;
use crate::{Error, ErrorKind, Picture, Result};

/// A rollout whose steps are queued and run on a thread of their own, which the first [`submit`](Self::submit) starts, or run one at a time on
/// the caller's.
///
/// Threads: may be used from any thread at any time; what needs the rollout to itself says `Busy` instead of waiting.
pub struct Worker {
    shared: Arc<Shared>,
    /// Started by the first submit.
    worker: Mutex<Option<JoinHandle<()>>>,
    capacity: usize,
}

/// What the caller's threads and the worker share.
struct Shared {
    core: Mutex<QueuedRollout>,
    queue: Mutex<Queue>,
    changed: Condvar,
    /// The worker's thread.
    thread: OnceLock<ThreadId>,
    /// Ends the step in progress; set and cleared with the queue locked.
    stop: Arc<AtomicBool>,
    /// Whether its memory is a graphics device's.
    has_device_memory: bool,
    /// A step on the worker ended by a fault of the library.
    broken: AtomicBool,
    /// As of the end of the last step, so that asking does not wait for one.
    statistics: Mutex<WorkerStatistics>,
}

/// What a rollout has done as of its last step's end.
#[derive(Debug, Clone, Default)]
pub struct WorkerStatistics {
    /// What the rollout has done.
    pub done: Statistics,
    /// What that took on a Direct3D 12 device, and which passes are captured there.
    #[cfg(windows)]
    pub device: Option<(DeviceTimes, Captured)>,
    /// What its governor has done, or the last one that it had.
    pub governor: GovernorStatistics,
}

/// A worker's rollout, and whether its pictures continue the ones before.
#[derive(Debug)]
pub struct QueuedRollout {
    /// The rollout.
    pub rollout: Rollout,
    /// Whether the last latent does not continue the one before.
    cut: bool,
    /// Whether the next latent will not continue the last one.
    pub cut_next: bool,
}

/// What waits, what runs, and what nobody has asked for yet.
#[derive(Default)]
struct Queue {
    tickets: u64,
    waiting: VecDeque<(u64, Job)>,
    running: Option<u64>,
    done: VecDeque<(u64, Result<StepResult>)>,
    paused: bool,
    /// Whether the rollout is to rest once the step in progress has ended.
    rests: bool,
    /// Steps that may run although it is paused.
    singles: usize,
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

/// What a queued step made.
#[derive(Debug, Clone)]
pub struct StepResult {
    /// What the step did.
    pub info: StepInfo,
    /// Its pictures, kept.
    pub anchor: Arc<KeptAnchor>,
}

/// State of a queued step.
#[derive(Debug)]
pub enum TicketState {
    /// The step waits or runs.
    Open,
    /// The step has ended. Its ticket is no longer valid.
    Over(Result<StepResult>),
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.close();
        if let Some(worker) = self.worker.lock().take() {
            // Its panics end in `catch_panic`.
            _ = worker.join();
        }
    }
}

impl Worker {
    /// A worker for `rollout` whose queue has room for `capacity` steps that wait, run or were not asked for.
    pub fn new(rollout: Rollout, capacity: usize) -> Self {
        let (stop, has_device_memory) = (rollout.stop_flag().clone(), rollout.world().device().is_gpu());
        let core = Mutex::new(QueuedRollout { rollout, cut: true, cut_next: true });
        let shared = Shared {
            core,
            queue: Mutex::default(),
            changed: Condvar::new(),
            thread: OnceLock::new(),
            stop,
            has_device_memory,
            broken: AtomicBool::new(false),
            statistics: Mutex::default(),
        };
        Self { shared: Arc::new(shared), worker: Mutex::new(None), capacity }
    }

    /// Ends the step in progress before its next pass, and all that are queued, for good: calls that wait for them return.
    pub fn close(&self) {
        let mut queue = self.shared.queue.lock();
        queue.closing = true;
        self.shared.stop.store(true, Ordering::SeqCst);
        queue.give_up("its rollout was destroyed");
        self.shared.changed.notify_all();
    }

    /// Whether the calling thread is the worker's: a callback of a step that runs there.
    pub fn is_on_own_thread(&self) -> bool {
        self.shared.thread.get() == Some(&calling_thread())
    }

    /// The rollout for a call on the caller's own thread, while nothing is queued.
    pub fn alone(&self) -> Result<MutexGuard<'_, QueuedRollout>> {
        self.shared.check()?;
        let queue = self.shared.queue.lock();
        if queue.running.is_some() || !queue.waiting.is_empty() {
            return Err(busy("steps are queued on it").remedy("Wait for them, or cancel them"));
        }
        let core = self.shared.core.try_lock().ok_or_else(|| busy("another call is using it"))?;
        // What was cancelled before has ended.
        self.shared.stop.store(queue.closing, Ordering::SeqCst);
        Ok(core)
    }

    /// The rollout for a call that only looks, while no step is running.
    pub fn look(&self) -> Result<MutexGuard<'_, QueuedRollout>> {
        self.shared.check()?;
        self.shared.core.try_lock().ok_or_else(|| busy("a step is running"))
    }

    /// Does one step on the caller's own thread.
    pub fn run(&self, job: &Job) -> Result<StepInfo> {
        let mut core = self.alone()?;
        let result = core.run(job);
        core.tell(&self.shared.statistics);
        result
    }

    /// Queues a step; none when the queue is full.
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

    /// What has become of a ticket, after waiting for it at most `timeout`; `None` waits for ever. `take` gets what its step
    /// made, and only when that works the ticket is over. A thread that the step needs, as the worker's or, where the call `is_nested`,
    /// one that is inside another call on the rollout, does not wait.
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
                    Some((_, result)) => Ok(TicketState::Over(result)),
                    None => Ok(TicketState::Open),
                };
            }
            let open = queue.running == Some(ticket) || queue.waiting.iter().any(|(waiting, _)| *waiting == ticket);
            if !open {
                return Err(argument("ticket", format!("{ticket} is none, or was asked for already")).into());
            }
            if may_not_wait {
                let why = "this is a callback of a call or a step of its own, which would wait for itself";
                return Err(busy(why).remedy("Wait on another thread, or after the callback").into());
            }
            match deadline {
                Some(deadline) => {
                    if self.shared.changed.wait_until(&mut queue, deadline).timed_out() {
                        return Ok(TicketState::Open);
                    }
                }
                // Also where the deadline lies beyond what the clock can show.
                None => self.shared.changed.wait(&mut queue),
            }
        }
    }

    /// Ends the step in progress before its next pass, on whatever thread, and all that are queued.
    pub fn cancel(&self) {
        let mut queue = self.shared.queue.lock();
        self.shared.stop.store(true, Ordering::SeqCst);
        queue.give_up("it was cancelled");
        self.shared.changed.notify_all();
    }

    /// Holds the queue after the step in progress, or lets it go on.
    pub fn pause(&self, paused: bool) {
        let mut queue = self.shared.queue.lock();
        queue.paused = paused;
        queue.rests = paused && self.shared.has_device_memory;
        queue.singles = 0;
        self.shared.changed.notify_all();
    }

    /// Lets one queued step run although the queue is held; `false` when there is none left to run.
    pub fn single(&self) -> Result<bool> {
        let mut queue = self.shared.queue.lock();
        if !queue.paused {
            return Err(argument("rollout", "it is not paused").remedy("Pause it first"));
        }
        if queue.singles >= queue.waiting.len() {
            return Ok(false);
        }
        queue.singles += 1;
        self.shared.changed.notify_all();
        Ok(true)
    }

    /// WorkerStatistics as of the last step's end, and steps that wait or run.
    pub fn statistics(&self) -> (WorkerStatistics, usize) {
        let depth = self.shared.queue.lock().depth();
        (self.shared.statistics.lock().clone(), depth)
    }

    /// Holds the rollout to a budget.
    pub fn govern(&self, budget: &Budget, worlds: &[Arc<World>]) -> Result<Arc<Governor>> {
        let mut core = self.alone()?;
        let governor = core.rollout.govern(budget, worlds)?;
        self.shared.statistics.lock().governor = governor.statistics();
        Ok(governor)
    }

    /// Holds it to none.
    pub fn ungovern(&self) -> Result<()> {
        self.alone()?.rollout.ungovern();
        Ok(())
    }

    fn start(&self) -> Result<()> {
        let mut worker = self.worker.lock();
        if worker.is_some() {
            return Ok(());
        }
        // Room for all that can be queued, so that nothing later can fail for want of it.
        let full = || Error::new(ErrorKind::OutOfMemory, "the queue cannot be allocated");
        {
            let mut queue = self.shared.queue.lock();
            queue.waiting.try_reserve(self.capacity).map_err(|_| full())?;
            queue.done.try_reserve(self.capacity).map_err(|_| full())?;
        }
        let shared = self.shared.clone();
        let thread = std::thread::Builder::new().name("cairn-rollout".into()).spawn(move || shared.work());
        let thread = thread.map_err(|e| {
            Error::new(ErrorKind::OutOfMemory, format!("the system gives no thread for the queue: {e}"))
        })?;
        *worker = Some(thread);
        Ok(())
    }
}

impl QueuedRollout {
    fn run(&mut self, job: &Job) -> Result<StepInfo> {
        let (info, appended) = match job {
            Job::Step(controls) => (self.rollout.step(controls)?, false),
            Job::Append(pictures) => (self.rollout.append_pictures(pictures)?, true),
        };
        self.cut = appended || self.cut_next;
        self.cut_next = false;
        Ok(info)
    }

    /// Says what it has done, and what that took on the device.
    fn tell(&mut self, figures: &Mutex<WorkerStatistics>) {
        let done = self.rollout.statistics();
        #[cfg(windows)]
        let device = self.rollout.device_times().zip(self.rollout.captured());
        let governor = self.rollout.governor().map(|governor| governor.statistics());
        let mut figures = figures.lock();
        let governor = governor.unwrap_or(figures.governor);
        *figures = WorkerStatistics {
            done,
            #[cfg(windows)]
            device,
            governor,
        };
    }

    /// Notes that the past is another one.
    pub fn restored(&mut self) {
        self.cut = true;
        self.cut_next = false;
    }

    /// The anchor that the last step made.
    pub fn anchor(&mut self) -> Result<KeptAnchor> {
        KeptAnchor::of(&mut self.rollout, self.cut)
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

    /// The worker's life: one step after the other until the rollout is destroyed.
    fn work(&self) {
        _ = self.thread.set(std::thread::current().id());
        while let Some((ticket, job)) = self.next() {
            let result: Result<StepResult> = catch_panic(|| {
                let mut core = self.core.lock();
                // A move to another world takes its room along, and is made first.
                core.rollout.obey();
                // A step whose anchor found no room would be made, and yet fail.
                let mut anchor = KeptAnchor::room(&mut core.rollout)?;
                let info = core.run(&job)?;
                core.tell(&self.statistics);
                let cut = core.cut;
                anchor.copy(&mut core.rollout, cut)?;
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
                // Their controls were meant for a world that did not come about.
                queue.give_up("a step before it failed");
            }
            self.changed.notify_all();
        }
    }

    fn next(&self) -> Option<(u64, Job)> {
        let mut queue = self.queue.lock();
        loop {
            if queue.closing {
                return None;
            }
            let held = queue.paused && queue.singles == 0;
            if let Some((ticket, job)) = (!held).then(|| queue.waiting.pop_front()).flatten() {
                queue.singles = queue.singles.saturating_sub(1);
                queue.rests = false;
                queue.running = Some(ticket);
                self.stop.store(false, Ordering::SeqCst);
                return Some((ticket, job));
            }
            if std::mem::take(&mut queue.rests) {
                MutexGuard::unlocked(&mut queue, || self.rest());
                continue;
            }
            self.changed.wait(&mut queue);
        }
    }

    /// Lets the device's memory of a held rollout be used by others. One that is in use by another call is not held.
    fn rest(&self) {
        let result: Result<()> = catch_panic(|| match self.core.try_lock() {
            Some(mut core) => Ok(core.rollout.rest()?),
            None => Ok(()),
        });
        if let Err(failure) = result {
            log::warn!("a paused rollout keeps its place in the device's memory: {failure}");
        }
    }
}

impl Queue {
    /// Steps that wait or run.
    fn depth(&self) -> usize {
        self.waiting.len() + usize::from(self.running.is_some())
    }

    /// Ends what waits.
    fn give_up(&mut self, why: &str) {
        self.singles = 0;
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
