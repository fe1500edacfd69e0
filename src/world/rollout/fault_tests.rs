//! Injects device faults at every call in turn, once or permanently: a failed step changes nothing, and the next attempt works.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::{Rollout, worlds};
use crate::bundle::Precision;
use crate::runtime::{
    Backup, BindingId, BufferId, Bytes, ContextLimits, ExecutionContext, FiniteCheckId, Graph, RecordedCopiesId,
    RecordedCopy, Region,
};
use crate::world::{CacheMode, OperatingPoint, Schedule, World, WorldOptions};
use crate::{Error, ErrorKind, Result};

/// Which calls fail.
#[derive(Default)]
struct Fault {
    /// Calls up to and including the next one that fails; 0 for none.
    calls_left: AtomicU64,
    /// Whether all later calls fail as well.
    is_permanent: AtomicBool,
    /// Whether a call has failed.
    has_failed: AtomicBool,
    /// Whether uploads are lost, as those are that were recorded before a submission failed.
    loses_uploads: AtomicBool,
    /// Number of lost uploads.
    lost: AtomicU64,
    /// Set instead, so that the rollout is stopped at the call that would fail.
    stop: Option<Arc<AtomicBool>>,
}

impl Fault {
    fn call(&self) -> Result<()> {
        let calls_left = self.calls_left.load(Ordering::Relaxed);
        if calls_left > 1 || !self.is_permanent.load(Ordering::Relaxed) {
            self.calls_left.store(calls_left.saturating_sub(1), Ordering::Relaxed);
        }
        if calls_left != 1 {
            return Ok(());
        }
        self.has_failed.store(true, Ordering::Relaxed);
        if let Some(stop) = &self.stop {
            stop.store(true, Ordering::SeqCst);
            return Ok(());
        }
        Err(Error::new(ErrorKind::Device, "a fault made by this test"))
    }
}

/// A context with injected faults. Calls that allocate or record, and those that run after a failure, `restore_backup` and `undo_copies`, never
/// fail.
struct Faulty {
    inner: Box<dyn ExecutionContext>,
    fault: Arc<Fault>,
}

impl ExecutionContext for Faulty {
    fn buffer(&mut self, bytes: usize) -> Result<BufferId> {
        self.inner.buffer(bytes)
    }

    fn size(&self, of: BufferId) -> usize {
        self.inner.size(of)
    }

    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId> {
        self.inner.bind(graph, tensors)
    }

    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()> {
        self.fault.call()?;
        if self.fault.loses_uploads.load(Ordering::Relaxed) {
            self.fault.lost.fetch_add(1, Ordering::Relaxed);
            return Ok(());
        }
        self.inner.upload(to, at, bytes)
    }

    fn lost_submissions(&self) -> u64 {
        self.fault.lost.load(Ordering::Relaxed)
    }

    fn replace(&mut self, contents: &[(BufferId, &[u8])]) -> Result<()> {
        self.fault.call()?;
        self.inner.replace(contents)
    }

    fn clear(&mut self, buffers: &[BufferId]) -> Result<()> {
        self.fault.call()?;
        self.inner.clear(buffers)
    }

    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()> {
        self.fault.call()?;
        self.inner.copy(to, from, regions)
    }

    fn record_copies(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId> {
        self.inner.record_copies(copies)
    }

    fn run_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        self.fault.call()?;
        self.inner.run_copies(copies)
    }

    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup> {
        self.fault.call()?;
        self.inner.back_up(of)
    }

    fn undo_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        self.inner.undo_copies(copies)
    }

    fn restore_backup(&mut self, backup: Backup) -> Result<()> {
        self.inner.restore_backup(backup)
    }

    fn run(&mut self, binding: BindingId) -> Result<()> {
        self.fault.call()?;
        self.inner.run(binding)
    }

    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()> {
        self.fault.call()?;
        self.inner.read(from, at, into)
    }

    fn add_finite_check(&mut self, groups: &[&[BufferId]], precision: Precision) -> Result<FiniteCheckId> {
        self.inner.add_finite_check(groups, precision)
    }

    fn find_not_finite(&mut self, check: FiniteCheckId) -> Result<Option<usize>> {
        self.fault.call()?;
        self.inner.find_not_finite(check)
    }

    fn bytes(&self) -> Bytes {
        self.inner.bytes()
    }
}

/// Makes every call of `act` fail in turn, once and permanently, until `act` succeeds; after each fault the rollout must be
/// unchanged. Returns the number of calls.
fn fail_each_call<T>(rollout: &mut Rollout, fault: &Fault, act: impl Fn(&mut Rollout) -> Result<T>) -> u64 {
    let before = rollout.save().expect("a state");
    for n in 1.. {
        for is_permanent in [true, false] {
            fault.is_permanent.store(is_permanent, Ordering::Relaxed);
            fault.calls_left.store(n, Ordering::Relaxed);
            let result = act(rollout);
            fault.calls_left.store(0, Ordering::Relaxed);
            let has_failed = fault.has_failed.swap(false, Ordering::Relaxed);
            match result {
                Ok(_) if has_failed => panic!("the fault of call {n} was not reported"),
                Ok(_) => return n - 1,
                Err(error) => assert!(error.to_string().contains("a fault made"), "call {n}: {error}"),
            }
            assert!(rollout.save().expect("a state") == before, "call {n} changed the rollout");
        }
    }
    unreachable!("`act` makes a finite number of calls")
}

/// A rollout whose device fails as `fault` says, or that is stopped.
fn faulty(world: &Arc<World>, fault: &Arc<Fault>) -> Rollout {
    faulty_at(world, &worlds::point(world), fault)
}

fn faulty_at(world: &Arc<World>, point: &OperatingPoint, fault: &Arc<Fault>) -> Rollout {
    let stop = fault.stop.clone().unwrap_or_default();
    let mut rollout = Rollout::with_stop(world, point, 1, stop, 0).expect("a rollout");
    let placeholder = world.device().context(ContextLimits::default()).expect("a context");
    let inner = std::mem::replace(&mut rollout.device.context, placeholder);
    rollout.device.context = Box::new(Faulty { inner, fault: fault.clone() });
    rollout
}

/// The test world `tiny` in `slices` slices.
fn in_slices(slices: u32) -> Arc<World> {
    let precision = Some(Precision::F32);
    let options = WorldOptions { precision, slices: Some(slices), ..WorldOptions::default() };
    World::load(&worlds::device(), &worlds::bundle("tiny"), options).expect("a world")
}

#[test]
fn a_failed_slice_changes_nothing() {
    const SLICES: u64 = 3;
    let world = in_slices(SLICES as u32);
    let fault = Arc::new(Fault::default());
    let mut rollout = faulty(&world, &fault);
    let mut reference = worlds::seeded(&worlds::world("tiny"), &worlds::point(&world), 1);
    rollout.append(&worlds::picture(40, 30, 1)).expect("a seed");
    let faults = fail_each_call(&mut rollout, &fault, |r| r.step(&worlds::controls(0)));
    assert!(faults > 14 + 4 * (SLICES - 1), "{faults} calls in a step");
    reference.step(&worlds::controls(0)).expect("a step");
    assert!(rollout.save().expect("a state") == reference.save().expect("a state"));
}

/// The conditioning of a schedule is uploaded when the schedule is set. If the next submission fails, the upload does not reach the device: that of a
/// step, or of anything else.
#[test]
fn noise_levels_that_a_failed_call_has_lost_are_uploaded_again() {
    type Call = fn(&mut Rollout) -> Result<()>;
    let step: Call = |rollout| rollout.step(&worlds::controls(0)).map(drop);
    let append: Call = |rollout| rollout.append(&worlds::picture(40, 30, 1)).map(drop);
    let read: Call = |rollout| rollout.save().map(drop);
    for (name, failing, call) in [("step", step, 12), ("append", append, 3), ("save", read, 1)] {
        let world = in_slices(1);
        let fault = Arc::new(Fault::default());
        let mut rollout = faulty(&world, &fault);
        let mut reference = worlds::seeded(&world, &worlds::point(&world), 1);
        rollout.append(&worlds::picture(40, 30, 1)).expect("a seed");
        fault.loses_uploads.store(true, Ordering::Relaxed);
        let schedule = Schedule::Refined(7);
        rollout.set_schedule(&schedule).expect("a schedule");
        fault.calls_left.store(call, Ordering::Relaxed);
        assert!(failing(&mut rollout).is_err() && fault.has_failed.load(Ordering::Relaxed), "{name}");
        fault.loses_uploads.store(false, Ordering::Relaxed);
        reference.set_schedule(&schedule).expect("a schedule");
        for i in 0..2 {
            rollout.step(&worlds::controls(i)).expect("a step");
            reference.step(&worlds::controls(i)).expect("a step");
            assert!(rollout.save().expect("a state") == reference.save().expect("a state"), "{name}, step {i}");
        }
    }
}

#[test]
fn a_step_is_cancelled_between_slices_and_changes_nothing() {
    const SLICES: u64 = 4;
    let world = in_slices(SLICES as u32);
    let stop: Arc<AtomicBool> = Arc::default();
    let fault = Arc::new(Fault { stop: Some(stop.clone()), ..Fault::default() });
    let mut rollout = faulty(&world, &fault);
    rollout.append(&worlds::picture(40, 30, 1)).expect("a seed");
    let before = rollout.save().expect("a state");
    let mut cancelled = 0;
    for call in 1.. {
        fault.calls_left.store(call, Ordering::Relaxed);
        let result = rollout.step(&worlds::controls(0));
        fault.calls_left.store(0, Ordering::Relaxed);
        stop.store(false, Ordering::SeqCst);
        match result {
            Err(error) => assert_eq!(error.kind(), ErrorKind::Cancelled, "call {call}: {error}"),
            Ok(_) => break,
        }
        cancelled += 1;
        assert!(rollout.save().expect("a state") == before, "call {call} changed the rollout");
    }
    // Four denoise passes and a cache pass, each in slices.
    assert!(cancelled >= 5 * SLICES, "a step was cancelled at {cancelled} calls");
    rollout.restore(&before).expect("a state");
    rollout.step(&worlds::controls(0)).expect("a step");
    let mut reference = worlds::seeded(&world, &worlds::point(&world), 1);
    reference.step(&worlds::controls(0)).expect("a step");
    assert!(rollout.save().expect("a state") == reference.save().expect("a state"));
}

#[test]
fn a_value_that_is_bound_to_the_memory_of_another_is_noticed() {
    let latent = |world: &Arc<World>| {
        let mut rollout = worlds::seeded(world, &worlds::point(world), 1);
        rollout.step(&worlds::controls(0)).expect("a step");
        rollout.latent().expect("a latent").to_vec()
    };
    let expected = latent(&worlds::world("tiny"));
    let count = in_slices(3).transformer.mutants();
    assert!(count > 10, "{count} pairs of values that could be confused");
    // Not all of them: each loads the world again.
    for mutant in (0..count).step_by(count.div_ceil(10)) {
        let mut world = Arc::into_inner(in_slices(3)).expect("the only owner");
        world.transformer.mutate(mutant);
        assert!(latent(&Arc::new(world)) != expected, "mutant {mutant} of {count}");
    }
}

#[test]
fn a_failed_or_cancelled_joined_pass_changes_nothing() {
    let options = WorldOptions { precision: Some(Precision::F32), joined: true, ..WorldOptions::default() };
    let world = World::load(&worlds::device(), &worlds::bundle("joined"), options).expect("a world");
    let point = OperatingPoint { cache_mode: CacheMode::Joined, ..worlds::point(&world) };
    let mut reference = worlds::seeded(&world, &point, 1);
    let fault = Arc::new(Fault::default());
    let mut rollout = faulty_at(&world, &point, &fault);
    rollout.append(&worlds::picture(40, 30, 1)).expect("a seed");
    for i in 0..6 {
        let act = |rollout: &mut Rollout| match i {
            4 => rollout.append(&worlds::picture(20, 10, 1)),
            _ => rollout.step(&worlds::controls(i)),
        };
        let faults = fail_each_call(&mut rollout, &fault, act);
        assert!(faults > 14, "{faults} calls in step {i}");
        act(&mut reference).expect("a step");
        assert!(rollout.save().expect("a state") == reference.save().expect("a state"), "step {i}");
    }

    let stop: Arc<AtomicBool> = Arc::default();
    let fault = Arc::new(Fault { stop: Some(stop.clone()), ..Fault::default() });
    let mut rollout = faulty_at(&world, &point, &fault);
    rollout.append(&worlds::picture(40, 30, 1)).expect("a seed");
    rollout.step(&worlds::controls(0)).expect("a step");
    let before = rollout.save().expect("a state");
    for call in 1.. {
        fault.calls_left.store(call, Ordering::Relaxed);
        let result = rollout.step(&worlds::controls(1));
        fault.calls_left.store(0, Ordering::Relaxed);
        stop.store(false, Ordering::SeqCst);
        let Err(error) = result else { break };
        assert_eq!(error.kind(), ErrorKind::Cancelled, "call {call}: {error}");
        assert!(rollout.save().expect("a state") == before, "call {call} changed the rollout");
    }
}

#[test]
fn a_failed_device_call_changes_nothing() {
    let world = worlds::world("tiny");
    let mut reference = Rollout::new(&world, &worlds::point(&world), 1).expect("a rollout");
    let fault = Arc::new(Fault::default());
    let mut rollout = faulty(&world, &fault);

    // The first append primes the decoder, which overwrites the committed memories.
    let seed = worlds::picture(20, 10, 1);
    let faults = fail_each_call(&mut rollout, &fault, |r| r.append(&seed));
    assert!(faults > 14, "{faults} calls in an append");
    reference.append(&seed).expect("a seed");
    for i in 0..2 {
        let faults = fail_each_call(&mut rollout, &fault, |r| r.step(&worlds::controls(i)));
        assert!(faults > 14, "{faults} calls in a step");
        reference.step(&worlds::controls(i)).expect("a step");
    }
    let saved = reference.save().expect("a state");
    assert!(rollout.save().expect("a state") == saved);

    assert_eq!(fail_each_call(&mut rollout, &fault, |r| r.reset()), 1, "calls in a reset");
    assert!(rollout.save().expect("a state") != saved);
    assert_eq!(fail_each_call(&mut rollout, &fault, |r| r.restore(&saved)), 1, "calls in a restore");
    assert!(rollout.save().expect("a state") == saved);
}
