//! Whether a provider does what it is for: two frames of two layers that move by known ways, one in front of the other, and where
//! both are in the frame between. Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32_FLOAT};

use super::Shot;
use super::bindings::{Coordinates, CreateFlags, CreateFrameGeneration, Dimensions};
use super::textures::{GROUP, Pictures, TextureGenerator, TextureOptions, texture};
use crate::gpu::compute::{self, CommandRecorder, CommandRing, Kernel, ResourceWithState, Shape, View, Words, untyped};
use crate::gpu::{Gpu, Heap, Shared, buffer};
use crate::{Error, ErrorKind, Result};

/// What the shader writes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mode {
    /// The frame of that number: 0 and 1 are shown to the provider.
    CommandRecorder(f32),
    /// Two numbers for the background and two for the foreground, where both are in the frame of that number.
    Values {
        number: f32,
        background: [f32; 2],
        foreground: [f32; 2],
    },
    /// What a provider makes that believes in such motion from frame 0 to frame 1.
    Generated(Believed),
    /// What one makes of the right motion that takes near for far.
    Reversed,
    Black,
}

/// Motion that a provider may believe in: that of each layer times `factor`, component by component, plus `jitter` times what the
/// cameras' jitter adds to motion.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Believed {
    factor: [f32; 2],
    jitter: f32,
}

const fn generated(factor: [f32; 2], jitter: f32) -> Mode {
    Mode::Generated(Believed { factor, jitter })
}

/// What the frame between may be. The first is right.
const CANDIDATES: [(Mode, &str); 14] = [
    (generated([1.0, 1.0], 0.0), "it is far from where it belongs"),
    (Mode::CommandRecorder(1.0), "the frame itself comes back: it passes frames through"),
    (Mode::CommandRecorder(0.0), "the frame before comes back: it passes frames through"),
    (generated([0.0, 0.0], 0.0), "both frames lie over one another: motion is not used"),
    (generated([-1.0, -1.0], 0.0), "both frames are moved against the motion: the sign is wrong"),
    (generated([-1.0, 1.0], 0.0), "both frames are moved against horizontal motion: the sign is wrong"),
    (generated([1.0, -1.0], 0.0), "both frames are moved against vertical motion: the sign is wrong"),
    (Mode::CommandRecorder(1.5), "it is moved against the motion: the sign is wrong"),
    (Mode::CommandRecorder(-0.5), "it is moved against the motion: the sign is wrong"),
    (Mode::Reversed, "what is far hides what is near: the order of depths is wrong"),
    (Mode::Black, "it is black"),
    (generated([1.0, 1.0], 1.0), "jitter is taken out of motion that holds none"),
    (generated([1.0, 1.0], -2.0), "jitter that motion holds is added once more: the sign is wrong"),
    (generated([1.0, 1.0], -1.0), "jitter is added to motion: the sign is wrong"),
];

/// The candidate of a provider that leaves in motion what jitter has added to it, as AMD's 3.1.5 does. Where motion is said to hold
/// jitter this is no reason to refuse one: real jitter is less than a pixel.
const JITTER_LEFT: usize = 13;

const STATE: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Words of constants of the shader that draws.
const CONSTANTS: usize = 19;

/// Generates, compares, and leaves the generator as it was.
///
/// # Errors
/// `Unsupported`, of `provider`, for one that fails; what its calls answer; `DeviceRemoved`, `OutOfMemory`.
pub(super) fn run(generator: &mut TextureGenerator, options: &TextureOptions) -> Result<()> {
    let gpu = generator.gpu().clone();
    let stage = Stage::new(&gpu, options)?;
    let tested = stage.frames(generator).and_then(|()| stage.found());
    generator.forget();
    let sums = tested?;
    log::debug!(target: "cairn::ffx", "distances of the frame between from what it may be: {sums:?}");
    judge(&sums, options.head.flags.contains(CreateFlags::MOTION_JITTER)).map_err(|why| {
        let why = format!("between two frames whose motion is known its frame is wrong: {why} (distances {sums:?})");
        Error::new(ErrorKind::Unsupported, why)
            .field("provider")
            .remedy("Use another provider, a newer release of AMD's libraries or a newer driver, or another generator")
    })
}

/// What is wrong, by the distance from each candidate.
fn judge(sums: &[u32; CANDIDATES.len()], motion_holds_jitter: bool) -> Result<(), &'static str> {
    let is_right = |index: usize| index == 0 || (index == JITTER_LEFT && motion_holds_jitter);
    let least = |right: bool| {
        let of_kind = sums.iter().enumerate().filter(|(index, _)| is_right(*index) == right);
        of_kind.map(|(_, sum)| *sum).min().unwrap_or(0)
    };
    // Twice as near as to anything else: providers sharpen and filter, each in its way.
    if u64::from(least(true)) * 2 < u64::from(least(false)) {
        return Ok(());
    }
    Err(sums.iter().zip(CANDIDATES).min_by_key(|(sum, _)| **sum).map_or("", |(_, (_, why))| why))
}

/// What the frames are made in.
struct Stage<'a> {
    gpu: &'a Gpu,
    options: &'a TextureOptions,
    format: DXGI_FORMAT,
    /// From one frame to the next, in pixels: of the background, and of the blocks in front of it.
    moved: [[f32; 2]; 2],
    /// Of the camera in frame 0, in pixels shown; in frame 1 it is minus that.
    jitter: [f32; 2],
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
        let format = untyped(DXGI_FORMAT(head.back_buffer_format.to_dxgi().cast_signed()));
        let frame = || texture(gpu, shown, format);
        let bytes = CANDIDATES.len() * 4;
        // A number of four, so that halves of both components are whole pixels.
        let step = (4 * (breadth(shown) / 160)).clamp(4, 64) as f32;
        let pattern = Shape { constants: CONSTANTS as u32, inputs: 1, outputs: 1 };
        let compare = Shape { constants: 7, inputs: 2, outputs: 1 };
        let made = Self {
            gpu,
            options,
            format,
            // Far from opposite, so that each wrong belief puts the blocks elsewhere.
            moved: [[step, -step / 2.0], [-step, -step]],
            jitter: [step / 8.0, -step / 8.0],
            pattern: Kernel::new(gpu, include_bytes!("../gpu/shaders/fsr_pattern.dxbc"), pattern)?,
            compare: Kernel::new(gpu, include_bytes!("../gpu/shaders/fsr_compare.dxbc"), compare)?,
            color: frame()?,
            output: frame()?,
            candidate: frame()?,
            depth: texture(gpu, rendered, DXGI_FORMAT_R32_FLOAT)?,
            motion: texture(gpu, motion_size(head), DXGI_FORMAT_R16G16_FLOAT)?,
            sums: buffer(gpu, Heap::Device, bytes)?,
            back: Shared::new(gpu, Heap::Readback, bytes)?,
        };
        // Whether shaders can write frames of that format here.
        compute::texture(gpu, &resting(&made.output), &[format], "back_buffer_format")?;
        Ok(made)
    }

    /// Both frames, through the generator.
    fn frames(&self, generator: &mut TextureGenerator) -> Result<()> {
        const DESCRIPTORS: u32 = 2;
        let mut ring = CommandRing::new(self.gpu, self.gpu.frames(), 3 * DESCRIPTORS)?;
        let (motion, depth) = (resting(&self.motion), resting(&self.depth));
        let head = &self.options.head;
        let (shown, rendered, of_motion) = (head.display_size, head.max_render_size, motion_size(head));
        let holds_jitter = head.flags.contains(CreateFlags::MOTION_JITTER);
        let scaled = |[x, y]: [f32; 2], to: Dimensions| {
            [x * to.width as f32 / shown.width as f32, y * to.height as f32 / shown.height as f32]
        };
        for (number, sign) in [(0.0, 1.0), (1.0, -1.0)] {
            let jitter = self.jitter.map(|jitter| jitter * sign);
            // From this frame to the one before; with what jitter was less what it is, where motion holds it.
            let to_before = self.moved.map(|moved| {
                let held = if holds_jitter { self.jitter_in_motion() } else { [0.0; 2] };
                scaled([held[0] - moved[0], held[1] - moved[1]], of_motion)
            });
            let mut frame = ring.begin()?;
            let values = |[background, foreground]: [[f32; 2]; 2]| Mode::Values { number, background, foreground };
            self.draw(&mut frame, &motion, DXGI_FORMAT_R16G16_FLOAT, values(to_before), scaled(jitter, of_motion))?;
            let depths = [BACKGROUND, FOREGROUND].map(|distance| [device_depth(distance, head.flags), 0.0]);
            self.draw(&mut frame, &depth, DXGI_FORMAT_R32_FLOAT, values(depths), scaled(jitter, rendered))?;
            self.draw(&mut frame, &resting(&self.color), self.format, Mode::CommandRecorder(number), [0.0; 2])?;
            frame.submit(self.gpu.frames())?;
            let pictures = Pictures {
                color: resting(&self.color),
                output: resting(&self.output),
                depth,
                motion,
                hudless: None,
                distortion: None,
            };
            let [x, y] = scaled(jitter, rendered);
            let shot = Shot { reset: number == 0.0, jitter: Coordinates { x, y }, ..Shot::of(rendered) };
            generator.generate(&pictures, &shot)?;
        }
        Ok(())
    }

    /// What jitter adds to the motion of frame 1 where motion holds it, in pixels shown: what it was less what it is.
    fn jitter_in_motion(&self) -> [f32; 2] {
        self.jitter.map(|jitter| 2.0 * jitter)
    }

    /// How far the frame between is from each candidate.
    fn found(&self) -> Result<[u32; CANDIDATES.len()]> {
        const DESCRIPTORS: u32 = 5;
        let mut ring = CommandRing::new(self.gpu, self.gpu.frames(), DESCRIPTORS * CANDIDATES.len() as u32)?;
        let mut frame = ring.begin()?;
        let shown = self.options.head.display_size;
        // The inner part: what comes into the picture nobody can know.
        let first = Dimensions { width: shown.width / 8, height: shown.height / 8 };
        let inner = Dimensions { width: shown.width - 2 * first.width, height: shown.height - 2 * first.height };
        let step = Dimensions { width: inner.width.div_ceil(512), height: inner.height.div_ceil(512) };
        let samples = Dimensions { width: inner.width / step.width, height: inner.height / step.height };
        let groups = [samples.width.div_ceil(GROUP), samples.height.div_ceil(GROUP), 1];
        let sums = ResourceWithState { resource: &self.sums, state: D3D12_RESOURCE_STATE_COMMON };
        let bytes = CANDIDATES.len() * 4;
        let mut zeroes = Shared::new(self.gpu, Heap::Upload, bytes)?;
        zeroes.write(0, &[0; CANDIDATES.len() * 4]);
        frame.bring(&sums, D3D12_RESOURCE_STATE_COPY_DEST)?;
        // SAFETY: an open list, and buffers of that many bytes that live until it has run.
        unsafe { frame.list().CopyBufferRegion(&self.sums, 0, zeroes.resource(), 0, bytes as u64) };
        for (index, (mode, _)) in (0..).zip(CANDIDATES) {
            let candidate = resting(&self.candidate);
            self.draw(&mut frame, &candidate, self.format, mode, [0.0; 2])?;
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

    /// Draws into a texture of any size, seen with such a jitter in its pixels.
    fn draw(
        &self,
        frame: &mut CommandRecorder<'_>,
        to: &ResourceWithState<'_>,
        format: DXGI_FORMAT,
        mode: Mode,
        jitter: [f32; 2],
    ) -> Result<()> {
        // SAFETY: a live resource.
        let size = unsafe { to.resource.GetDesc() };
        let (width, height) = (size.Width as u32, size.Height);
        let head = &self.options.head;
        let shown = head.display_size;
        let scale = [shown.width as f32 / width as f32, shown.height as f32 / height as f32];
        let believed = |Believed { factor, jitter }: Believed| {
            let held = self.jitter_in_motion();
            self.moved.map(|moved| [0, 1].map(|axis| moved[axis] * factor[axis] + held[axis] * jitter))
        };
        let is_drawn = matches!(mode, Mode::CommandRecorder(_)) && to.resource == &self.color;
        let (kind, number, [background, foreground]) = match mode {
            Mode::CommandRecorder(number) if is_drawn => (0, number, self.moved),
            Mode::Values { number, background, foreground } => (1, number, [background, foreground]),
            Mode::CommandRecorder(number) => (2, number, self.moved),
            Mode::Generated(motion) => (2, BETWEEN, believed(motion)),
            Mode::Reversed => (3, BETWEEN, self.moved),
            Mode::Black => (4, 0.0, self.moved),
        };
        // Providers take the nearest depth of the neighbours, and what jitter moves is beside its edge.
        let of_render =
            shown.width.div_ceil(head.max_render_size.width).max(shown.height.div_ceil(head.max_render_size.height));
        let margin = 1.0 + of_render as f32 + self.jitter[0].abs();
        let numbers = [number].into_iter().chain(self.moved.into_iter().flatten());
        let numbers = numbers.chain(background).chain(foreground);
        let numbers = numbers.chain([self.side(), 640.0 / breadth(shown) as f32, margin]);
        let words = scale.into_iter().chain(jitter).map(f32::to_bits);
        let words = [width, height].into_iter().chain(words).chain([kind]).chain(numbers.map(f32::to_bits));
        let mut constants = [0; CONSTANTS];
        constants.iter_mut().zip(words).for_each(|(constant, word)| *constant = word);
        let groups = [width.div_ceil(GROUP), height.div_ceil(GROUP), 1];
        let found = View::Texture(resting(&self.output), self.format);
        frame.run(&self.pattern, &constants, &[found], &[View::Texture(*to, format)], groups)
    }

    /// Of a block, in pixels: so that what moves the other way behind it would hide more than half of it.
    fn side(&self) -> f32 {
        2.0 * self.moved[0][0]
    }
}

/// The frame half way, as the shader has it.
const BETWEEN: f32 = 0.5;

/// How far away both layers are, in metres.
const BACKGROUND: f32 = 10.0;
const FOREGROUND: f32 = 1.0;

/// Device depth of what is so many metres away from [`Camera::default`](super::Camera::default).
fn device_depth(distance: f32, flags: CreateFlags) -> f32 {
    let super::Camera { near, far, .. } = super::Camera::default();
    let of_infinite = 1.0 - near / distance;
    let depth =
        if flags.contains(CreateFlags::DEPTH_INFINITE) { of_infinite } else { of_infinite * far / (far - near) };
    if flags.contains(CreateFlags::DEPTH_INVERTED) { 1.0 - depth } else { depth }
}

/// By what the pattern is scaled: the width of a frame that is not far wider than high.
fn breadth(shown: Dimensions) -> u32 {
    shown.width.min(2 * shown.height)
}

fn motion_size(head: &CreateFrameGeneration) -> Dimensions {
    super::textures::motion_size_at(head, head.max_render_size)
}

fn resting(resource: &ID3D12Resource) -> ResourceWithState<'_> {
    ResourceWithState { resource, state: STATE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_right_frame_is_taken_and_one_with_jitter_where_motion_holds_it() {
        for near in 0..CANDIDATES.len() {
            let mut sums = [100; CANDIDATES.len()];
            sums[near] = 49;
            assert_eq!(judge(&sums, false).is_ok(), near == 0, "{near}");
            assert_eq!(judge(&sums, true).is_ok(), near == 0 || near == JITTER_LEFT, "{near}");
            sums[near] = 50;
            assert_eq!(judge(&sums, true), Err(CANDIDATES[near].1));
        }
        assert!(judge(&[0; CANDIDATES.len()], false).is_err(), "a picture that tells nothing");
    }

    #[test]
    fn near_is_near_in_every_kind_of_depth() {
        let (inverted, infinite) = (CreateFlags::DEPTH_INVERTED, CreateFlags::DEPTH_INFINITE);
        for flags in [CreateFlags::empty(), infinite] {
            let [near, far] = [FOREGROUND, BACKGROUND].map(|distance| device_depth(distance, flags));
            assert!(0.0 < near && near < far && far < 1.0, "{near} {far}");
            let [near, far] = [FOREGROUND, BACKGROUND].map(|distance| device_depth(distance, flags | inverted));
            assert!(1.0 > near && near > far && far > 0.0, "{near} {far}");
        }
        assert!((device_depth(0.1, CreateFlags::empty())).abs() < 1e-6);
        assert!((device_depth(100.0, CreateFlags::empty()) - 1.0).abs() < 1e-6);
    }
}
