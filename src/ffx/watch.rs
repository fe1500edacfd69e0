//! Whether generated frames are frames between, or the ones that were given. Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_R16G16_FLOAT;

use super::bindings::{Coordinates, Dimensions};
use super::textures::GROUP;
use crate::Result;
use crate::gpu::compute::{CommandRecorder, FRAMES_IN_FLIGHT, Kernel, ResourceWithState, Shape, View, Words, untyped};
use crate::gpu::{FencePoint, Gpu, Heap, Shared, buffer};

/// What a generated frame turned out to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Seen {
    /// One between.
    Between,
    /// The frame that was given: the provider passes frames through.
    PassedThrough,
    /// Black where the frame is not.
    Black,
    /// It cannot be told: nothing moves, or what moves is of one colour.
    Unknown,
}

/// Samples across and down, at most.
const SAMPLES: u32 = 256;

/// Fewer samples where it shows are too few.
const ENOUGH: u32 = 64;

/// Numbers of a frame: all samples where it shows, and of these the frame's own and the black ones.
const COUNTS: usize = 3;
const BYTES: usize = COUNTS * 4;

/// Looks at frames on the device; the counts come when the frame has run.
pub(super) struct Watch {
    kernel: Kernel,
    counts: ID3D12Resource,
    zeroes: Shared,
    back: Shared,
    /// For each frame under way, when it has run.
    comes: [Option<FencePoint>; FRAMES_IN_FLIGHT],
    next: usize,
    last: Option<Seen>,
}

impl Watch {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let code = include_bytes!("../gpu/shaders/fsr_watch.dxbc");
        let mut zeroes = Shared::new(gpu, Heap::Upload, BYTES)?;
        zeroes.write(0, &[0; BYTES]);
        Ok(Self {
            kernel: Kernel::new(gpu, code, Shape { constants: 10, inputs: 3, outputs: 1 })?,
            counts: buffer(gpu, Heap::Device, BYTES)?,
            zeroes,
            back: Shared::new(gpu, Heap::Readback, BYTES * FRAMES_IN_FLIGHT)?,
            comes: [const { None }; FRAMES_IN_FLIGHT],
            next: 0,
            last: None,
        })
    }

    /// Records a look at `generated`, between `color` and the frame before, by motion in halves. `scale` makes pixels of the frames of
    /// it. To be followed by [`comes`](Self::comes), unless the frame is given up.
    pub(super) fn record(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        generated: &ResourceWithState<'_>,
        color: &ResourceWithState<'_>,
        motion: &ResourceWithState<'_>,
        (shown, moved, scale): (Dimensions, Dimensions, Coordinates),
    ) -> Result<()> {
        // As many frames later the ring had waited for this one.
        self.harvest(self.next);
        let counts = ResourceWithState { resource: &self.counts, state: D3D12_RESOURCE_STATE_COMMON };
        frame.bring(&counts, D3D12_RESOURCE_STATE_COPY_DEST)?;
        // SAFETY: an open list, and live buffers of that many bytes in the states of a copy.
        unsafe { frame.list().CopyBufferRegion(&self.counts, 0, self.zeroes.resource(), 0, BYTES as u64) };
        let (steps, samples) = samples(shown);
        let constants = [
            shown.width,
            shown.height,
            moved.width,
            moved.height,
            scale.x.to_bits(),
            scale.y.to_bits(),
            steps.width,
            steps.height,
            samples.width,
            samples.height,
        ];
        let view = |resting: &ResourceWithState<'_>| {
            // SAFETY: a live resource.
            unsafe { resting.resource.GetDesc() }.Format
        };
        let inputs = [
            View::Texture(*generated, untyped(view(generated))),
            View::Texture(*color, untyped(view(color))),
            View::Texture(*motion, DXGI_FORMAT_R16G16_FLOAT),
        ];
        let output = View::Buffer(counts, Words { first: 0, count: COUNTS as u32 });
        let groups = [samples.width.div_ceil(GROUP), samples.height.div_ceil(GROUP), 1];
        frame.run(&self.kernel, &constants, &inputs, &[output], groups)?;
        frame.bring(&counts, D3D12_RESOURCE_STATE_COPY_SOURCE)?;
        let at = (self.next * BYTES) as u64;
        // SAFETY: as above.
        unsafe { frame.list().CopyBufferRegion(self.back.resource(), at, &self.counts, 0, BYTES as u64) };
        Ok(())
    }

    /// Says when the frame that was recorded last has run.
    pub(super) fn comes(&mut self, fence_point: &FencePoint) {
        self.comes[self.next] = Some(fence_point.clone());
        self.next = (self.next + 1) % FRAMES_IN_FLIGHT;
    }

    /// What the last frame that has run was.
    pub(super) fn last(&mut self) -> Option<Seen> {
        // From the oldest on.
        (0..FRAMES_IN_FLIGHT).for_each(|i| self.harvest((self.next + i) % FRAMES_IN_FLIGHT));
        self.last
    }

    /// Takes what a frame that has run has counted.
    fn harvest(&mut self, slot: usize) {
        if self.comes[slot].take_if(|fence_point| fence_point.reached()).is_none() {
            return;
        }
        let mut bytes = [0; BYTES * FRAMES_IN_FLIGHT];
        self.back.read(&mut bytes);
        let mut counts = [0; COUNTS];
        for (count, bytes) in counts.iter_mut().zip(bytes[slot * BYTES..].as_chunks().0) {
            *count = u32::from_le_bytes(*bytes);
        }
        let seen = judged(counts);
        if self.last != Some(seen) && [Seen::PassedThrough, Seen::Black].contains(&seen) {
            log::warn!(target: "cairn::ffx", "generated frames are none: {seen:?}");
        }
        self.last = Some(seen);
    }
}

fn judged([all, same, black]: [u32; COUNTS]) -> Seen {
    let nearly_all = |count: u32| u64::from(count) * 100 >= u64::from(all) * 95;
    match () {
        () if all < ENOUGH => Seen::Unknown,
        () if nearly_all(same) => Seen::PassedThrough,
        () if nearly_all(black) => Seen::Black,
        () => Seen::Between,
    }
}

/// Pixels from one sample to the next, and how many there are.
fn samples(shown: Dimensions) -> (Dimensions, Dimensions) {
    let step = |side: u32| side.div_ceil(SAMPLES);
    let steps = Dimensions { width: step(shown.width), height: step(shown.height) };
    (steps, Dimensions { width: shown.width / steps.width, height: shown.height / steps.height })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_judged_by_nearly_all_of_the_samples_that_tell() {
        assert_eq!(judged([ENOUGH - 1, ENOUGH - 1, 0]), Seen::Unknown);
        assert_eq!(judged([100, 94, 0]), Seen::Between);
        assert_eq!(judged([100, 95, 0]), Seen::PassedThrough);
        assert_eq!(judged([100, 0, 95]), Seen::Black);
        assert_eq!(judged([u32::MAX; COUNTS]), Seen::PassedThrough);
    }

    #[test]
    fn samples_lie_inside_the_frame() {
        for side in [1, 2, 255, 256, 257, 511, 513, 1080, 16384] {
            let (steps, samples) = samples(Dimensions { width: side, height: 16384 });
            assert!((1..=SAMPLES).contains(&samples.width) && samples.width * steps.width <= side, "{side}");
        }
    }
}
