//! Whether a provider does what it is for: two frames of a picture that moves by a known way, and where it is in the one between.
//! Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32_FLOAT};

use super::Shot;
use super::bindings::{CreateFlags, Dimensions};
use super::textures::{GROUP, Pictures, TextureGenerator, TextureOptions, texture};
use crate::gpu::compute::{self, Frame, Frames, Kernel, Resting, Shape, View, Words, untyped};
use crate::gpu::{Gpu, Heap, Shared, buffer};
use crate::{Error, ErrorKind, Result};

/// Frames with a shorter side are too small to tell.
const SMALLEST: u32 = 64;

/// What the frame between may be: the picture so many steps from where it is in the first frame, and how many steps apart two of it lie
/// over one another; without a place, black. The first is right.
const CANDIDATES: [(Option<[f32; 2]>, &str); 8] = [
    (Some([0.5, 0.0]), "it is far from where it belongs"),
    (Some([1.0, 0.0]), "the frame itself comes back: it passes frames through"),
    (Some([0.0, 0.0]), "the frame before comes back: it passes frames through"),
    (Some([0.5, 0.5]), "both frames lie over one another: motion is not used"),
    (Some([0.5, 1.0]), "both frames are moved against the motion: the sign is wrong"),
    (Some([1.5, 0.0]), "it is moved against the motion: the sign is wrong"),
    (Some([-0.5, 0.0]), "it is moved against the motion: the sign is wrong"),
    (None, "it is black"),
];

const STATE: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Generates, compares, and leaves the generator as it was.
///
/// # Errors
/// `Unsupported`, of `provider`, for one that fails; what its calls answer; `DeviceRemoved`, `OutOfMemory`.
pub(super) fn run(generator: &mut TextureGenerator, options: &TextureOptions) -> Result<()> {
    let shown = options.head.display_size;
    if shown.width.min(shown.height) < SMALLEST {
        log::debug!(target: "cairn::ffx", "frames of {shown:?} are too small for a test");
        return Ok(());
    }
    let gpu = generator.gpu().clone();
    let stage = Stage::new(&gpu, options)?;
    let tested = stage.frames(generator).and_then(|()| stage.found());
    generator.forget();
    let sums = tested?;
    let right = sums[0];
    let nearest = sums.iter().zip(CANDIDATES).min_by_key(|(sum, _)| **sum).map_or("", |(_, (_, why))| why);
    let others = sums[1..].iter().min().copied().unwrap_or(0);
    // Twice as near as to anything else: providers sharpen and filter, each in its way.
    if u64::from(right) * 2 < u64::from(others) {
        return Ok(());
    }
    let why =
        format!("of a picture that moves by a known way the frame between is wrong: {nearest} (distances {sums:?})");
    Err(Error::new(ErrorKind::Unsupported, why)
        .field("provider")
        .remedy("Use another provider, a newer release of AMD's libraries or a newer driver, or another generator"))
}

/// What the frames are made in.
struct Stage<'a> {
    gpu: &'a Gpu,
    options: &'a TextureOptions,
    format: DXGI_FORMAT,
    /// Pixels from one frame to the next, to the right.
    step: f32,
    pattern: Kernel,
    compare: Kernel,
    color: ID3D12Resource,
    output: ID3D12Resource,
    candidate: ID3D12Resource,
    depth: ID3D12Resource,
    motion: ID3D12Resource,
    sums: ID3D12Resource,
    back: Shared,
}

impl<'a> Stage<'a> {
    fn new(gpu: &'a Gpu, options: &'a TextureOptions) -> Result<Self> {
        let head = &options.head;
        let (shown, rendered) = (head.display_size, head.max_render_size);
        let moved = if head.flags.contains(CreateFlags::DISPLAY_RESOLUTION_MOTION) { shown } else { rendered };
        let format = untyped(DXGI_FORMAT(head.back_buffer_format.to_dxgi().cast_signed()));
        let frame = || texture(gpu, shown, format);
        let bytes = CANDIDATES.len() * 4;
        let pattern = Shape { constants: 8, inputs: 0, outputs: 1 };
        let compare = Shape { constants: 7, inputs: 2, outputs: 1 };
        let made = Self {
            gpu,
            options,
            format,
            step: (2 * (shown.width / 80)).clamp(2, 64) as f32,
            pattern: Kernel::new(gpu, include_bytes!("../gpu/shaders/fsr_pattern.dxbc"), pattern)?,
            compare: Kernel::new(gpu, include_bytes!("../gpu/shaders/fsr_compare.dxbc"), compare)?,
            color: frame()?,
            output: frame()?,
            candidate: frame()?,
            depth: texture(gpu, rendered, DXGI_FORMAT_R32_FLOAT)?,
            motion: texture(gpu, moved, DXGI_FORMAT_R16G16_FLOAT)?,
            sums: buffer(gpu, Heap::Device, bytes)?,
            back: Shared::new(gpu, Heap::Readback, bytes)?,
        };
        // Whether shaders can write frames of that format here.
        compute::texture(gpu, &resting(&made.output), &[format], "back_buffer_format")?;
        Ok(made)
    }

    /// Both frames, through the generator.
    fn frames(&self, generator: &mut TextureGenerator) -> Result<()> {
        let mut ring = Frames::new(self.gpu, self.gpu.frames(), 4)?;
        let (motion, depth) = (resting(&self.motion), resting(&self.depth));
        let shown = self.options.head.display_size;
        for number in [0, 1] {
            let mut frame = ring.begin()?;
            if number == 0 {
                let pixels = self.step * self.motion_size().width as f32 / shown.width as f32;
                self.draw(&mut frame, &motion, DXGI_FORMAT_R16G16_FLOAT, [-pixels, 0.0, 0.0, 0.0, 0.0])?;
                self.draw(&mut frame, &depth, DXGI_FORMAT_R32_FLOAT, [0.5, 0.0, 0.0, 0.0, 0.0])?;
            }
            self.picture(&mut frame, &resting(&self.color), Some([number as f32, 0.0]))?;
            frame.submit(self.gpu.frames())?;
            let pictures = Pictures {
                color: resting(&self.color),
                output: resting(&self.output),
                depth,
                motion,
                hudless: None,
                distortion: None,
            };
            let shot = Shot { reset: number == 0, ..Shot::of(self.options.head.max_render_size) };
            generator.generate(&pictures, &shot)?;
        }
        Ok(())
    }

    /// How far the frame between is from each candidate.
    fn found(&self) -> Result<[u32; CANDIDATES.len()]> {
        const DESCRIPTORS: u32 = 4;
        let mut ring = Frames::new(self.gpu, self.gpu.frames(), DESCRIPTORS * CANDIDATES.len() as u32)?;
        let mut frame = ring.begin()?;
        let shown = self.options.head.display_size;
        // The inner part: what comes into the picture nobody can know.
        let first = Dimensions { width: shown.width / 8, height: shown.height / 8 };
        let inner = Dimensions { width: shown.width - 2 * first.width, height: shown.height - 2 * first.height };
        let step = Dimensions { width: inner.width.div_ceil(512), height: inner.height.div_ceil(512) };
        let samples = Dimensions { width: inner.width / step.width, height: inner.height / step.height };
        let groups = [samples.width.div_ceil(GROUP), samples.height.div_ceil(GROUP), 1];
        let sums = Resting { resource: &self.sums, state: D3D12_RESOURCE_STATE_COMMON };
        let bytes = CANDIDATES.len() * 4;
        let mut zeroes = Shared::new(self.gpu, Heap::Upload, bytes)?;
        zeroes.write(0, &[0; CANDIDATES.len() * 4]);
        frame.bring(&sums, D3D12_RESOURCE_STATE_COPY_DEST)?;
        // SAFETY: an open list, and buffers of that many bytes that live until it has run.
        unsafe { frame.list().CopyBufferRegion(&self.sums, 0, zeroes.resource(), 0, bytes as u64) };
        for (index, (place, _)) in (0..).zip(CANDIDATES) {
            let candidate = resting(&self.candidate);
            self.picture(&mut frame, &candidate, place)?;
            let inputs = [View::Texture(resting(&self.output), self.format), View::Texture(candidate, self.format)];
            let output = View::Buffer(sums, Words { first: 0, count: CANDIDATES.len() as u32 });
            let constants =
                [first.width, first.height, step.width, step.height, samples.width, samples.height, index * 4];
            frame.run(&self.compare, &constants, &inputs, &[output], groups)?;
        }
        frame.bring(&sums, D3D12_RESOURCE_STATE_COPY_SOURCE)?;
        // SAFETY: as above.
        unsafe { frame.list().CopyBufferRegion(self.back.resource(), 0, &self.sums, 0, bytes as u64) };
        frame.submit(self.gpu.frames())?.wait()?;
        let mut found = [0; CANDIDATES.len() * 4];
        self.back.read(&mut found);
        let mut sums = [0; CANDIDATES.len()];
        sums.iter_mut().zip(found.as_chunks().0).for_each(|(sum, bytes)| *sum = u32::from_le_bytes(*bytes));
        Ok(sums)
    }

    /// The picture as [`CANDIDATES`] says.
    fn picture(&self, frame: &mut Frame<'_>, to: &Resting<'_>, place: Option<[f32; 2]>) -> Result<()> {
        let told = place.map_or([0.0; 5], |[place, apart]| [0.5, 0.5, place * self.step, 0.4, apart * self.step]);
        self.draw(frame, to, self.format, told)
    }

    /// Base of red and of the others, pixels moved, height of the waves, pixels apart.
    fn draw(&self, frame: &mut Frame<'_>, to: &Resting<'_>, format: DXGI_FORMAT, told: [f32; 5]) -> Result<()> {
        // SAFETY: a live resource.
        let size = unsafe { to.resource.GetDesc() };
        let (width, height) = (size.Width as u32, size.Height);
        let [red, others, moved, waves, apart] = told.map(f32::to_bits);
        let scale = 640.0 / self.options.head.display_size.width as f32;
        let constants = [width, height, red, others, moved, waves, scale.to_bits(), apart];
        let groups = [width.div_ceil(GROUP), height.div_ceil(GROUP), 1];
        frame.run(&self.pattern, &constants, &[], &[View::Texture(*to, format)], groups)
    }

    fn motion_size(&self) -> Dimensions {
        let head = &self.options.head;
        if head.flags.contains(CreateFlags::DISPLAY_RESOLUTION_MOTION) {
            head.display_size
        } else {
            head.max_render_size
        }
    }
}

fn resting(resource: &ID3D12Resource) -> Resting<'_> {
    Resting { resource, state: STATE }
}
