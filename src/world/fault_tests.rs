//! Faults of the device, one at every call a step makes: none leaves a trace, and the next try works.

#[path = "../../tests/common/mod.rs"]
mod common;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::{Rollout, StepInfo};
use crate::bundle::Precision;
use crate::runtime::{BindingId, BufferId, Bytes, CopiesId, Graph, KeptCopy, Lane, Region};
use crate::{Error, ErrorKind, Result};

/// A lane whose n-th call fails, once. Copies never fail by themselves: they are submitted with what does.
struct Faulty {
    inner: Box<dyn Lane>,
    /// Calls until the fault; 0 for none.
    left: Arc<AtomicU64>,
}

impl Faulty {
    fn call(&self) -> Result<()> {
        match self.left.load(Ordering::Relaxed) {
            0 => Ok(()),
            left => {
                self.left.store(left - 1, Ordering::Relaxed);
                if left == 1 { Err(Error::new(ErrorKind::Device, "a fault made by this test")) } else { Ok(()) }
            }
        }
    }
}

impl Lane for Faulty {
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
        self.call()?;
        self.inner.upload(to, at, bytes)
    }

    fn clear(&mut self, buffer: BufferId) -> Result<()> {
        self.call()?;
        self.inner.clear(buffer)
    }

    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()> {
        self.inner.copy(to, from, regions)
    }

    fn keep(&mut self, copies: Vec<KeptCopy>) -> Result<CopiesId> {
        self.inner.keep(copies)
    }

    fn repeat(&mut self, copies: CopiesId) -> Result<()> {
        self.inner.repeat(copies)
    }

    fn run(&mut self, binding: BindingId) -> Result<()> {
        self.call()?;
        self.inner.run(binding)
    }

    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()> {
        self.call()?;
        self.inner.read(from, at, into)
    }

    fn finite(&self, of: &[BufferId], precision: Precision) -> Result<bool> {
        self.call()?;
        self.inner.finite(of, precision)
    }

    fn bytes(&self) -> Bytes {
        self.inner.bytes()
    }
}

/// Lets every call of `act` fail in turn, until it gets through; after each fault the rollout is what it was. Gives the
/// number of faults.
fn walk(rollout: &mut Rollout, fault: &AtomicU64, act: impl Fn(&mut Rollout) -> Result<StepInfo>) -> u64 {
    let before = rollout.save().expect("a state");
    for n in 1.. {
        fault.store(n, Ordering::Relaxed);
        let result = act(rollout);
        let spent = fault.swap(0, Ordering::Relaxed) == 0;
        match result {
            Ok(_) if spent => panic!("the fault of call {n} was swallowed"),
            Ok(_) => return n - 1,
            Err(error) => assert!(error.to_string().contains("a fault made"), "call {n}: {error}"),
        }
        assert!(rollout.save().expect("a state") == before, "call {n} left a trace");
    }
    unreachable!("the walk ends when the act gets through")
}

#[test]
fn no_fault_of_the_device_leaves_a_trace() {
    let world = common::world("tiny");
    let mut untroubled = Rollout::new(&world, &common::point(&world), 1).expect("a rollout");
    let mut rollout = Rollout::new(&world, &common::point(&world), 1).expect("a rollout");
    let left = Arc::new(AtomicU64::new(0));
    let idle = world.device().lane().expect("a lane");
    let inner = std::mem::replace(&mut rollout.lane, idle);
    rollout.lane = Box::new(Faulty { inner, left: left.clone() });

    // The first one primes the decoder, which writes the very memories that count.
    let seed = common::picture(20, 10, 1);
    let faults = walk(&mut rollout, &left, |r| r.append(&seed));
    assert!(faults > 14, "{faults} calls in an append");
    untroubled.append(&seed).expect("a seed");
    for i in 0..2 {
        let faults = walk(&mut rollout, &left, |r| r.step(&common::controls(i)));
        assert!(faults > 14, "{faults} calls in a step");
        untroubled.step(&common::controls(i)).expect("a step");
    }
    assert!(rollout.save().expect("a state") == untroubled.save().expect("a state"));
}
