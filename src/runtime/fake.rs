//! A backend for tests whose device memory the host cannot read: it shows that worlds use a device through [`ExecutionContext`] alone.
//!
//! Graphs run on the CPU provider. Contents of buffers are encoded, and the CPU context's buffers have them only while a graph or a finite
//! check runs. Work is queued until a call waits for it.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::cpu::{CpuBackend, CpuOptions};
use super::device::{Backend, DeviceKind};
use super::execution_context::{
    Backup, BindingId, BufferId, Bytes, ContextLimits, ExecutionContext, FiniteCheckId, RecordedCopiesId, RecordedCopy,
    Region,
};
use super::graph::TensorSpec;
use super::{Device, Graph, Ort};
use crate::Result;
use crate::bundle::{ModelSource, Precision};
use crate::locks::Mutex;

/// Encodes bytes, and decodes them.
const KEY: u8 = 0x5A;

/// What contexts of a device have done.
#[derive(Debug, Default)]
pub(crate) struct FakeCounts {
    /// Calls that waited for queued work.
    pub(crate) waits: AtomicU64,
    /// Most work that was queued at one time.
    pub(crate) longest_queue: AtomicU64,
    /// Graphs that ran.
    pub(crate) runs: AtomicU64,
}

/// A device that counts as a graphics device, with the CPU options `options` for its graphs.
pub(crate) fn device(ort: &Ort, options: CpuOptions, counts: &Arc<FakeCounts>) -> Result<Device> {
    Ok(Device::of(Arc::new(FakeBackend { inner: CpuBackend::new(ort, options)?, counts: counts.clone() })))
}

struct FakeBackend {
    inner: CpuBackend,
    counts: Arc<FakeCounts>,
}

impl Backend for FakeBackend {
    fn describe(&self) -> String {
        format!("a test's device over {}", self.inner.describe())
    }

    fn precision(&self) -> Precision {
        self.inner.precision()
    }

    fn threads(&self) -> usize {
        self.inner.threads()
    }

    fn graph(
        &self,
        what: &str,
        model: &ModelSource<'_>,
        dimensions: &[(&str, usize)],
        inputs: Vec<TensorSpec>,
        outputs: Vec<TensorSpec>,
        shared: Option<&Arc<Graph>>,
    ) -> Result<Arc<Graph>> {
        self.inner.graph(what, model, dimensions, inputs, outputs, shared)
    }

    fn context(&self, limits: ContextLimits) -> Result<Box<dyn ExecutionContext>> {
        let queue = Queue {
            // Work that was queued runs also after a stop.
            inner: self.inner.context(ContextLimits::default())?,
            memories: Vec::new(),
            bindings: Vec::new(),
            finite_checks: Vec::new(),
            work: Vec::new(),
            counts: self.counts.clone(),
        };
        Ok(Box::new(FakeContext {
            queue: RefCell::new(queue),
            limits,
            recorded: Vec::new(),
            bytes: Bytes::default(),
            read: 0.into(),
        }))
    }

    fn kind(&self) -> DeviceKind {
        DeviceKind::WebGpu
    }
}

struct FakeContext {
    queue: RefCell<Queue>,
    limits: ContextLimits,
    recorded: Vec<Vec<RecordedCopy>>,
    bytes: Bytes,
    read: AtomicU64,
}

/// Device memory, and the work that was submitted. Handles are those of the CPU context.
struct Queue {
    inner: Box<dyn ExecutionContext>,
    /// Encoded contents of the buffers.
    memories: Vec<Box<[u8]>>,
    /// Inputs and outputs of bound graphs.
    bindings: Vec<[Vec<BufferId>; 2]>,
    finite_checks: Vec<Vec<BufferId>>,
    work: Vec<Work>,
    counts: Arc<FakeCounts>,
}

/// Buffers with encoded copies of their contents, which are made when the queue runs.
type FakeBackup = Arc<Mutex<Vec<(BufferId, Box<[u8]>)>>>;

enum Work {
    Write { to: BufferId, at: usize, encoded: Vec<u8> },
    Clear(BufferId),
    Copy(RecordedCopy),
    BackUp { of: Vec<BufferId>, to: FakeBackup },
    Restore(FakeBackup),
    Run(BindingId),
}

fn coded(bytes: &[u8]) -> Vec<u8> {
    bytes.iter().map(|byte| byte ^ KEY).collect()
}

impl Queue {
    fn submit(&mut self, work: Work) {
        self.work.push(work);
        self.counts.longest_queue.fetch_max(self.work.len() as u64, Ordering::Relaxed);
    }

    /// Runs all submitted work. What follows a failure is dropped.
    fn wait(&mut self) -> Result<()> {
        self.counts.waits.fetch_add(1, Ordering::Relaxed);
        std::mem::take(&mut self.work).into_iter().try_for_each(|work| self.execute(work))
    }

    fn execute(&mut self, work: Work) -> Result<()> {
        match work {
            Work::Write { to, at, encoded } => {
                self.memories[to.0][at..at + encoded.len()].copy_from_slice(&encoded);
            }
            Work::Clear(buffer) => self.memories[buffer.0].fill(KEY),
            Work::Copy(RecordedCopy { to, from, regions }) => {
                let [to, from] = self.memories.get_disjoint_mut([to.0, from.0]).expect("two buffers");
                regions.iter().for_each(|r| to[r.to..r.to + r.len].copy_from_slice(&from[r.from..r.from + r.len]));
            }
            Work::BackUp { of, to } => {
                *to.lock() = of.iter().map(|buffer| (*buffer, self.memories[buffer.0].clone())).collect();
            }
            Work::Restore(backup) => {
                backup.lock().iter().for_each(|(to, copy)| self.memories[to.0].copy_from_slice(copy));
            }
            Work::Run(binding) => {
                let [inputs, outputs] = self.bindings[binding.0].clone();
                self.reveal(&inputs)?;
                self.inner.run(binding)?;
                for output in &outputs {
                    let mut found = vec![0; self.memories[output.0].len()];
                    self.inner.read(*output, 0, &mut found)?;
                    self.memories[output.0] = coded(&found).into();
                }
                self.hide(inputs.iter().chain(&outputs))?;
                self.counts.runs.fetch_add(1, Ordering::Relaxed);
            }
        }
        Ok(())
    }

    /// Gives the contents of buffers to the CPU context.
    fn reveal(&mut self, buffers: &[BufferId]) -> Result<()> {
        buffers.iter().try_for_each(|buffer| self.inner.upload(*buffer, 0, &coded(&self.memories[buffer.0])))
    }

    /// Overwrites buffers of the CPU context, with bytes that are not finite in any precision.
    fn hide<'a>(&mut self, mut buffers: impl Iterator<Item = &'a BufferId>) -> Result<()> {
        buffers.try_for_each(|buffer| self.inner.upload(*buffer, 0, &vec![0xFF; self.memories[buffer.0].len()]))
    }
}

impl ExecutionContext for FakeContext {
    fn buffer(&mut self, bytes: usize) -> Result<BufferId> {
        let queue = self.queue.get_mut();
        let buffer = queue.inner.buffer(bytes)?;
        queue.memories.push(vec![KEY; bytes].into());
        queue.hide([buffer].iter())?;
        Ok(buffer)
    }

    fn size(&self, of: BufferId) -> usize {
        self.queue.borrow().memories[of.0].len()
    }

    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId> {
        let queue = self.queue.get_mut();
        let binding = queue.inner.bind(graph, tensors)?;
        let (inputs, outputs) = tensors.split_at(graph.input_count());
        queue.bindings.push([inputs.to_vec(), outputs.to_vec()]);
        Ok(binding)
    }

    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()> {
        self.queue.get_mut().submit(Work::Write { to, at, encoded: coded(bytes) });
        self.bytes.uploaded += bytes.len() as u64;
        Ok(())
    }

    fn replace(&mut self, contents: &[(BufferId, &[u8])]) -> Result<()> {
        contents.iter().try_for_each(|(to, bytes)| {
            assert_eq!(bytes.len(), self.size(*to), "a whole buffer");
            self.upload(*to, 0, bytes)
        })
    }

    fn clear(&mut self, buffers: &[BufferId]) -> Result<()> {
        buffers.iter().for_each(|buffer| self.queue.get_mut().submit(Work::Clear(*buffer)));
        Ok(())
    }

    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()> {
        self.queue.get_mut().submit(Work::Copy(RecordedCopy { to, from, regions: regions.to_vec() }));
        self.bytes.copied += regions.iter().map(|r| r.len as u64).sum::<u64>();
        Ok(())
    }

    fn record_copies(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId> {
        self.recorded.push(copies);
        Ok(RecordedCopiesId(self.recorded.len() - 1))
    }

    fn run_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        let copies: Vec<_> = copies.iter().flat_map(|copies| self.recorded[copies.0].clone()).collect();
        copies.iter().try_for_each(|copy| self.copy(copy.to, copy.from, &copy.regions))
    }

    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup> {
        let backup = FakeBackup::default();
        self.queue.get_mut().submit(Work::BackUp { of: of.to_vec(), to: backup.clone() });
        Ok(Backup::new(backup))
    }

    fn restore_backup(&mut self, backup: Backup) -> Result<()> {
        self.queue.get_mut().submit(Work::Restore(*backup.into_contents::<FakeBackup>()));
        Ok(())
    }

    fn run(&mut self, binding: BindingId) -> Result<()> {
        self.limits.check_stop()?;
        self.queue.get_mut().submit(Work::Run(binding));
        Ok(())
    }

    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()> {
        let mut queue = self.queue.borrow_mut();
        queue.wait()?;
        into.copy_from_slice(&coded(&queue.memories[from.0][at..at + into.len()]));
        self.read.fetch_add(into.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    fn add_finite_check(&mut self, groups: &[&[BufferId]], precision: Precision) -> Result<FiniteCheckId> {
        let queue = self.queue.get_mut();
        queue.finite_checks.push(groups.concat());
        queue.inner.add_finite_check(groups, precision)
    }

    fn find_not_finite(&mut self, check: FiniteCheckId) -> Result<Option<usize>> {
        let queue = self.queue.get_mut();
        queue.wait()?;
        let buffers = queue.finite_checks[check.0].clone();
        queue.reveal(&buffers)?;
        let found = queue.inner.find_not_finite(check)?;
        queue.hide(buffers.iter())?;
        Ok(found)
    }

    fn rest(&mut self) -> Result<()> {
        self.queue.get_mut().wait()
    }

    fn bytes(&self) -> Bytes {
        Bytes { read: self.read.load(Ordering::Relaxed), ..self.bytes }
    }
}
