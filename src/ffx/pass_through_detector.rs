//! Checks on the GPU whether frames were really generated, or are copies of the input. Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_R16G16_FLOAT;

use super::bindings::{Coordinates, Dimensions};
use super::texture_generator::GROUP;
use crate::Result;
use crate::gpu::compute::{
    CommandRecorder, FRAMES_IN_FLIGHT, Kernel, ResourceWithState, Shape, View, WordRange, untyped,
};
use crate::gpu::{FencePoint, Gpu, Heap, MappedBuffer, buffer};

/// The result of the check of a generated frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum GenerationCheck {
    /// It differs from the input frame.
    Generated,
    /// A copy of the input frame: the provider passes frames through.
    PassedThrough,
    /// Black where the input frame is not.
    Black,
    /// Undecided: nothing moves, or the moving parts have one colour.
    Unknown,
}

/// Maximum number of samples across and down.
const SAMPLES: u32 = 256;

/// With fewer usable samples, the result is `Unknown`.
const MIN_SAMPLES: u32 = 64;

/// Counters of a frame: usable samples, samples equal to the input frame, black samples.
const COUNTS: usize = 3;
const BYTES: usize = COUNTS * 4;

/// Counts samples on the device; the counters are read back when the frame has run.
pub(super) struct PassThroughDetector {
    kernel: Kernel,
    counts: ID3D12Resource,
    zeroes: MappedBuffer,
    readback: MappedBuffer,
    /// For each slot with a frame in flight, the fence point at which it has run.
    pending: [Option<FencePoint>; FRAMES_IN_FLIGHT],
    next: usize,
    last: Option<GenerationCheck>,
}

impl PassThroughDetector {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let code = include_bytes!("../gpu/shaders/compiled/fsr_detect_pass_through.dxbc");
        let mut zeroes = MappedBuffer::new(gpu, Heap::Upload, BYTES)?;
        zeroes.write(0, &[0; BYTES]);
        Ok(Self {
            kernel: Kernel::new(gpu, code, Shape { constants: 10, inputs: 3, outputs: 1 })?,
            counts: buffer(gpu, Heap::Device, BYTES)?,
            zeroes,
            readback: MappedBuffer::new(gpu, Heap::Readback, BYTES * FRAMES_IN_FLIGHT)?,
            pending: [const { None }; FRAMES_IN_FLIGHT],
            next: 0,
            last: None,
        })
    }

    /// Records the count of samples of `generated`, which lies between `color` and the previous frame. `motion` is R16G16_FLOAT;
    /// `scale` converts it to pixels of the frames. Call [`expect_result_at`](Self::expect_result_at) next, unless the frame is abandoned.
    pub(super) fn record(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        generated: &ResourceWithState<'_>,
        color: &ResourceWithState<'_>,
        motion: &ResourceWithState<'_>,
        (display_size, moved, scale): (Dimensions, Dimensions, Coordinates),
    ) -> Result<()> {
        // The slot's previous frame has run: the ring has waited for it.
        self.collect(self.next);
        let counts = ResourceWithState { resource: &self.counts, state: D3D12_RESOURCE_STATE_COMMON };
        frame.transition_to(&counts, D3D12_RESOURCE_STATE_COPY_DEST)?;
        // SAFETY: an open list, and live buffers of that many bytes in the states of a copy.
        unsafe { frame.list().CopyBufferRegion(&self.counts, 0, self.zeroes.resource(), 0, BYTES as u64) };
        let (steps, samples) = samples(display_size);
        let constants = [
            display_size.width,
            display_size.height,
            moved.width,
            moved.height,
            scale.x.to_bits(),
            scale.y.to_bits(),
            steps.width,
            steps.height,
            samples.width,
            samples.height,
        ];
        let view = |given: &ResourceWithState<'_>| {
            // SAFETY: a live resource.
            unsafe { given.resource.GetDesc() }.Format
        };
        let inputs = [
            View::Texture(*generated, untyped(view(generated))),
            View::Texture(*color, untyped(view(color))),
            View::Texture(*motion, DXGI_FORMAT_R16G16_FLOAT),
        ];
        let output = View::Buffer(counts, WordRange { first: 0, count: COUNTS as u32 });
        let groups = [samples.width.div_ceil(GROUP), samples.height.div_ceil(GROUP), 1];
        frame.run(&self.kernel, &constants, &inputs, &[output], groups)?;
        frame.transition_to(&counts, D3D12_RESOURCE_STATE_COPY_SOURCE)?;
        let at = (self.next * BYTES) as u64;
        // SAFETY: as above.
        unsafe { frame.list().CopyBufferRegion(self.readback.resource(), at, &self.counts, 0, BYTES as u64) };
        Ok(())
    }

    /// Sets the fence point at which the last recorded frame will have run.
    pub(super) fn expect_result_at(&mut self, fence_point: &FencePoint) {
        self.pending[self.next] = Some(fence_point.clone());
        self.next = (self.next + 1) % FRAMES_IN_FLIGHT;
    }

    /// The result of the last frame that has run.
    pub(super) fn last(&mut self) -> Option<GenerationCheck> {
        // Oldest slot first.
        (0..FRAMES_IN_FLIGHT).for_each(|i| self.collect((self.next + i) % FRAMES_IN_FLIGHT));
        self.last
    }

    /// Reads the counters of a slot if its frame has run.
    fn collect(&mut self, slot: usize) {
        if self.pending[slot].take_if(|fence_point| fence_point.reached()).is_none() {
            return;
        }
        let mut bytes = [0; BYTES * FRAMES_IN_FLIGHT];
        self.readback.read(&mut bytes);
        let mut counts = [0; COUNTS];
        for (count, bytes) in counts.iter_mut().zip(bytes[slot * BYTES..].as_chunks().0) {
            *count = u32::from_le_bytes(*bytes);
        }
        let result = classify(counts);
        if self.last != Some(result) && [GenerationCheck::PassedThrough, GenerationCheck::Black].contains(&result) {
            log::warn!(target: "cairn::ffx", "generated frames are none: {result:?}");
        }
        self.last = Some(result);
    }
}

fn classify([all, same, black]: [u32; COUNTS]) -> GenerationCheck {
    let nearly_all = |count: u32| u64::from(count) * 100 >= u64::from(all) * 95;
    match () {
        () if all < MIN_SAMPLES => GenerationCheck::Unknown,
        () if nearly_all(same) => GenerationCheck::PassedThrough,
        () if nearly_all(black) => GenerationCheck::Black,
        () => GenerationCheck::Generated,
    }
}

/// The distance between samples in pixels, and the number of samples.
fn samples(display_size: Dimensions) -> (Dimensions, Dimensions) {
    let step = |side: u32| side.div_ceil(SAMPLES);
    let steps = Dimensions { width: step(display_size.width), height: step(display_size.height) };
    (steps, Dimensions { width: display_size.width / steps.width, height: display_size.height / steps.height })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_classified_by_95_percent_of_the_usable_samples() {
        assert_eq!(classify([MIN_SAMPLES - 1, MIN_SAMPLES - 1, 0]), GenerationCheck::Unknown);
        assert_eq!(classify([100, 94, 0]), GenerationCheck::Generated);
        assert_eq!(classify([100, 95, 0]), GenerationCheck::PassedThrough);
        assert_eq!(classify([100, 0, 95]), GenerationCheck::Black);
        assert_eq!(classify([u32::MAX; COUNTS]), GenerationCheck::PassedThrough);
    }

    #[test]
    fn samples_lie_inside_the_frame() {
        for side in [1, 2, 255, 256, 257, 511, 513, 1080, 16384] {
            let (steps, samples) = samples(Dimensions { width: side, height: 16384 });
            assert!((1..=SAMPLES).contains(&samples.width) && samples.width * steps.width <= side, "{side}");
        }
    }
}
