//! Whether a captured pass gives the same bits: it is run both ways, and the device compares.

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;

use super::capture::{Capture, Named};
use super::context::{DirectMlContext, groups_for};
use crate::Result;
use crate::gpu::{Heap, buffer};
use crate::runtime::execution_context::{BindingId, Region};

impl DirectMlContext {
    /// Runs a binding as ever, then by capture, and decides how it is run from now on. Whatever comes of it, the outputs are those of
    /// a run.
    pub(super) fn run_both_ways(&mut self, id: BindingId) -> Result<()> {
        self.run_as_ever(id)?;
        let bound = &mut self.bindings[id.0];
        let (name, times) = match std::mem::replace(&mut bound.capture, Capture::Untried) {
            Capture::Checked(name, times) => (name, times),
            _ => match bound.graph.captures().take() {
                Some(name) => (name, 0),
                None => {
                    bound.capture = Capture::Never("as many passes are captured as may be".to_owned());
                    return Ok(());
                }
            },
        };
        let is_same = self.gives_the_same(id, &name, times == 0);
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        self.bindings[id.0].capture = match &is_same {
            Ok(is_same) => Capture::judged(name, times, *is_same),
            Err(e) => Capture::Never(format!("a captured pass failed: {e}")),
        };
        if is_same.is_ok_and(|is_same| is_same) {
            return Ok(());
        }
        if let Capture::Never(why) = &self.bindings[id.0].capture {
            log::warn!("{why}");
        }
        self.run_as_ever(id)
    }

    /// Runs a binding by capture, whose outputs are what a run has left, and compares.
    fn gives_the_same(&mut self, id: BindingId, name: &Named, is_new: bool) -> Result<bool> {
        let outputs = self.bindings[id.0].outputs.clone();
        let mut expected = Vec::with_capacity(outputs.len());
        for output in &outputs {
            let (resource, words) = self.words(*output);
            let copy = buffer(&self.gpu, Heap::Device, words)?;
            let whole = Region { to: 0, from: 0, len: words };
            self.recorder.get_mut().copy(&copy, &resource, std::iter::once(whole))?;
            // Held by the context in whatever way this ends: the open list has its address.
            self.expected.push(copy.clone());
            expected.push((copy, resource, words));
        }
        if is_new {
            // Runs as ever, and writes the commands down.
            self.run_named(id, name)?;
        }
        // What is left there would hide that nothing was written.
        outputs.iter().try_for_each(|output| self.blank(*output))?;
        self.run_named(id, name)?;
        let word = std::iter::once(Region { to: 0, from: 0, len: size_of::<u32>() });
        let fence_point = {
            let recorder = self.recorder.get_mut();
            recorder.fill(&self.verdict, self.zeroes.resource(), word.clone())?;
            for (copy, resource, bytes) in &expected {
                let words = u32::try_from(bytes / size_of::<u32>()).unwrap_or(u32::MAX);
                let (groups, threads) = groups_for(words);
                let reads = [resource, copy];
                recorder.dispatch(&self.kernels.equal, &[words, threads], &reads, &[&self.verdict], groups);
            }
            recorder.copy(self.answer.resource(), &self.verdict, word)?;
            recorder.now()?
        };
        self.wait(&fence_point)?;
        self.expected.clear();
        let mut verdict = [0; size_of::<u32>()];
        self.answer.read(&mut verdict);
        Ok(u32::from_ne_bytes(verdict) == 0)
    }

    /// A buffer with what fills its last word up, in bytes.
    fn words(&self, of: crate::runtime::execution_context::BufferId) -> (ID3D12Resource, usize) {
        let buffer = &self.buffers[of.0];
        (buffer.resource.clone(), buffer.bytes.next_multiple_of(size_of::<u32>()))
    }
}
