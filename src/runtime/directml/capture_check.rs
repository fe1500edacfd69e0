//! Compares the outputs of a captured run with those of a normal run, on the device, bit by bit.

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;

use super::capture::{CaptureRunOptions, CaptureState};
use super::context::{DirectMlContext, groups_for};
use super::graph_data::DirectMlGraph;
use crate::Result;
use crate::gpu::{Heap, buffer};
use crate::runtime::execution_context::{BindingId, BufferId, Region};

impl DirectMlContext {
    /// Runs a binding without capture, then with it, and decides how it runs from now on. If the two differ or the captured run
    /// fails, the binding runs once more without capture, so that the outputs are always those of a valid run.
    pub(super) fn run_and_compare(&mut self, id: BindingId) -> Result<()> {
        self.run_uncaptured(id)?;
        let bound = &mut self.bindings[id.0];
        let (name, times) = match std::mem::replace(&mut bound.capture, CaptureState::Untried) {
            CaptureState::Checked(name, times) => (name, times),
            _ => match DirectMlGraph::of(&bound.graph).captures().next_capture() {
                Some(name) => (name, 0),
                None => {
                    bound.capture = CaptureState::Never("as many passes are captured as may be".to_owned());
                    return Ok(());
                }
            },
        };
        let is_same = self.captured_outputs_match(id, &name, times == 0);
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        self.bindings[id.0].capture = match &is_same {
            Ok(is_same) => CaptureState::after_comparison(name, times, *is_same),
            Err(e) => CaptureState::Never(format!("a captured pass failed: {e}")),
        };
        if is_same.is_ok_and(|is_same| is_same) {
            return Ok(());
        }
        if let CaptureState::Never(why) = &self.bindings[id.0].capture {
            log::warn!("{why}");
        }
        self.run_uncaptured(id)
    }

    /// Copies a binding's outputs, runs the binding by capture, and compares its outputs with the copies on the device.
    fn captured_outputs_match(&mut self, id: BindingId, name: &CaptureRunOptions, is_new: bool) -> Result<bool> {
        let outputs = self.bindings[id.0].outputs.clone();
        let mut expected = Vec::with_capacity(outputs.len());
        for output in &outputs {
            let (resource, bytes) = self.padded_buffer(*output);
            let copy = buffer(&self.gpu, Heap::Device, bytes)?;
            let whole = Region { to: 0, from: 0, len: bytes };
            self.recorder.get_mut().copy(&copy, &resource, std::iter::once(whole))?;
            // The context holds the copy even if this function fails: the open command list refers to it.
            self.expected.push(copy.clone());
            expected.push((copy, resource, bytes));
        }
        if is_new {
            // The first run with a new name executes normally and records the commands.
            self.run_named(id, name)?;
        }
        // Clears the outputs: old contents would hide that the captured run wrote nothing.
        outputs.iter().try_for_each(|output| self.clear_buffer(*output))?;
        self.run_named(id, name)?;
        let word = std::iter::once(Region { to: 0, from: 0, len: size_of::<u32>() });
        let fence_point = {
            let recorder = self.recorder.get_mut();
            recorder.copy_from_upload(&self.check_result, self.zeroes.resource(), word.clone())?;
            for (copy, resource, bytes) in &expected {
                let words = u32::try_from(bytes / size_of::<u32>()).unwrap_or(u32::MAX);
                let (groups, threads) = groups_for(words);
                let reads = [resource, copy];
                recorder.dispatch(&self.kernels.equal, &[words, threads], &reads, &[&self.check_result], groups);
            }
            recorder.copy(self.check_readback.resource(), &self.check_result, word)?;
            recorder.submit_and_signal()?
        };
        self.wait(&fence_point)?;
        self.expected.clear();
        let mut check_result = [0; size_of::<u32>()];
        self.check_readback.read(&mut check_result);
        Ok(u32::from_ne_bytes(check_result) == 0)
    }

    /// A buffer, and its size in bytes rounded up to whole 32-bit words.
    fn padded_buffer(&self, of: BufferId) -> (ID3D12Resource, usize) {
        let buffer = &self.buffers[of.0];
        (buffer.resource.clone(), buffer.bytes.next_multiple_of(size_of::<u32>()))
    }
}
