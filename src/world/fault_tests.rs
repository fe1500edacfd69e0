//! Injects device faults at every call in turn, once or permanently: a failed step changes nothing, and the next attempt works.

#[path = "../../tests/common/mod.rs"]
mod common;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::Rollout;
use crate::bundle::Precision;
use crate::runtime::{
    Backup, BindingId, BufferId, Bytes, ExecutionContext, FiniteCheckId, Graph, RecordedCopiesId, RecordedCopy, Region,
};
use crate::{Error, ErrorKind, Result};

/// Which calls fail.
#[derive(Default)]
struct Fault {
    /// Calls up to and including the next failing one; 0 for none.
    left: AtomicU64,
    /// Whether all later calls fail as well.
    lasts: AtomicBool,
    /// Whether a call has failed.
    came: AtomicBool,
}

impl Fault {
    fn call(&self) -> Result<()> {
        let left = self.left.load(Ordering::Relaxed);
        if left > 1 || !self.lasts.load(Ordering::Relaxed) {
            self.left.store(left.saturating_sub(1), Ordering::Relaxed);
        }
        if left != 1 {
            return Ok(());
        }
        self.came.store(true, Ordering::Relaxed);
        Err(Error::new(ErrorKind::Device, "a fault made by this test"))
    }
}

/// A context with injected faults. Calls that allocate or record, and `restore_backup`, which runs after a failure, never fail.
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
        self.inner.upload(to, at, bytes)
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

    fn keep(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId> {
        self.inner.keep(copies)
    }

    fn repeat(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        self.fault.call()?;
        self.inner.repeat(copies)
    }

    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup> {
        self.fault.call()?;
        self.inner.back_up(of)
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

    fn not_finite(&mut self, look: FiniteCheckId) -> Result<Option<usize>> {
        self.fault.call()?;
        self.inner.not_finite(look)
    }

    fn bytes(&self) -> Bytes {
        self.inner.bytes()
    }
}

/// Makes every call of `act` fail in turn, once and permanently, until `act` succeeds; after each fault the rollout must be
/// unchanged. Returns the number of calls.
fn walk<T>(rollout: &mut Rollout, fault: &Fault, act: impl Fn(&mut Rollout) -> Result<T>) -> u64 {
    let before = rollout.save().expect("a state");
    for n in 1.. {
        for lasts in [true, false] {
            fault.lasts.store(lasts, Ordering::Relaxed);
            fault.left.store(n, Ordering::Relaxed);
            let result = act(rollout);
            fault.left.store(0, Ordering::Relaxed);
            let came = fault.came.swap(false, Ordering::Relaxed);
            match result {
                Ok(_) if came => panic!("the fault of call {n} was swallowed"),
                Ok(_) => return n - 1,
                Err(error) => assert!(error.to_string().contains("a fault made"), "call {n}: {error}"),
            }
            assert!(rollout.save().expect("a state") == before, "call {n} left a trace");
        }
    }
    unreachable!("the walk ends when the act gets through")
}

#[test]
fn no_fault_of_the_device_leaves_a_trace() {
    let world = common::world("tiny");
    let mut untroubled = Rollout::new(&world, &common::point(&world), 1).expect("a rollout");
    let mut rollout = Rollout::new(&world, &common::point(&world), 1).expect("a rollout");
    let fault = Arc::new(Fault::default());
    let idle = world.device().context().expect("a context");
    let inner = std::mem::replace(&mut rollout.context, idle);
    rollout.context = Box::new(Faulty { inner, fault: fault.clone() });

    // The first append primes the decoder, which overwrites the committed memories.
    let seed = common::picture(20, 10, 1);
    let faults = walk(&mut rollout, &fault, |r| r.append(&seed));
    assert!(faults > 14, "{faults} calls in an append");
    untroubled.append(&seed).expect("a seed");
    for i in 0..2 {
        let faults = walk(&mut rollout, &fault, |r| r.step(&common::controls(i)));
        assert!(faults > 14, "{faults} calls in a step");
        untroubled.step(&common::controls(i)).expect("a step");
    }
    let saved = untroubled.save().expect("a state");
    assert!(rollout.save().expect("a state") == saved);

    assert_eq!(walk(&mut rollout, &fault, |r| r.reset()), 1, "calls in a reset");
    assert!(rollout.save().expect("a state") != saved);
    assert_eq!(walk(&mut rollout, &fault, |r| r.restore(&saved)), 1, "calls in going on from a state");
    assert!(rollout.save().expect("a state") == saved);
}
