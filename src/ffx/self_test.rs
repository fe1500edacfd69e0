//! Self-test of a provider: has it generate the frame between two synthetic frames, and compares the result with the right frame and
//! with typical wrong ones. The frames show a background and blocks in front of it, with known motion. Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32_FLOAT};

use super::FrameParams;
use super::bindings::{Coordinates, CreateFlags, CreateFrameGeneration, Dimensions};
use super::texture_generator::{GROUP, GenerationTextures, TextureGenerator, TextureOptions, texture};
use crate::gpu::compute::{
    self, CommandRecorder, CommandRing, Kernel, ResourceWithState, Shape, View, WordRange, untyped,
};
use crate::gpu::{Gpu, Heap, MappedBuffer, buffer};
use crate::{Error, ErrorKind, Result};

/// Mode of the pattern shader.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mode {
    /// The frame at that time: 0 and 1 are the provider's inputs.
    Frame(f32),
    /// Two values for the background and two for the foreground, each layer at its position in the frame of that number.
    Values {
        number: f32,
        background: [f32; 2],
        foreground: [f32; 2],
    },
    /// The frame that a provider generates if it assumes this motion from frame 0 to frame 1.
    Generated(AssumedMotion),
    /// The frame generated with the right motion if the depth order is reversed.
    Reversed,
    Black,
}

/// Motion that a provider may assume: each layer's true motion times `factor`, by component, plus `jitter` times the part of motion
/// that comes from the cameras' jitter.
#[derive(Debug, Clone, Copy, PartialEq)]
struct AssumedMotion {
    factor: [f32; 2],
    jitter: f32,
}

const fn generated(factor: [f32; 2], jitter: f32) -> Mode {
    Mode::Generated(AssumedMotion { factor, jitter })
}

/// Candidates for the generated frame, each with the error that it shows. The first is right.
const CANDIDATES: [(Mode, &str); 14] = [
    (generated([1.0, 1.0], 0.0), "it is far from where it belongs"),
    (Mode::Frame(1.0), "the frame itself comes back: it passes frames through"),
    (Mode::Frame(0.0), "the frame before comes back: it passes frames through"),
    (generated([0.0, 0.0], 0.0), "both frames lie over one another: motion is not used"),
    (generated([-1.0, -1.0], 0.0), "both frames are moved against the motion: the sign is wrong"),
    (generated([-1.0, 1.0], 0.0), "both frames are moved against horizontal motion: the sign is wrong"),
    (generated([1.0, -1.0], 0.0), "both frames are moved against vertical motion: the sign is wrong"),
    (Mode::Frame(1.5), "it is moved against the motion: the sign is wrong"),
    (Mode::Frame(-0.5), "it is moved against the motion: the sign is wrong"),
    (Mode::Reversed, "what is far hides what is near: the order of depths is wrong"),
    (Mode::Black, "it is black"),
    (generated([1.0, 1.0], 1.0), "jitter is taken out of motion that holds none"),
    (generated([1.0, 1.0], -2.0), "jitter that motion holds is added once more: the sign is wrong"),
    (generated([1.0, 1.0], -1.0), "jitter is added to motion: the sign is wrong"),
];

/// Index of the candidate for a provider that does not remove jitter from motion, as AMD's 3.1.5 does not. It passes if motion
/// contains jitter by the creation flags: real jitter is less than a pixel.
const JITTER_LEFT: usize = 13;

const STATE: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Number of root constants of the pattern shader.
const CONSTANTS: usize = 19;

/// Runs the test; the generator drops its history afterwards.
///
/// # Errors
/// `Unsupported` with the field `provider` for a provider that fails; errors of its calls; `DeviceRemoved`, `OutOfMemory`.
pub(super) fn run(generator: &mut TextureGenerator, options: &TextureOptions) -> Result<()> {
    let gpu = generator.gpu().clone();
    let test = SelfTest::new(&gpu, options)?;
    let tested = test.generate_pair(generator).and_then(|()| test.distances());
    generator.drop_history();
    let sums = tested?;
    log::debug!(target: "cairn::ffx", "distances of the frame between from what it may be: {sums:?}");
    judge(&sums, options.head.flags.contains(CreateFlags::MOTION_JITTER)).map_err(|why| {
        let why = format!("between two frames whose motion is known its frame is wrong: {why} (distances {sums:?})");
        Error::new(ErrorKind::Unsupported, why)
            .field("provider")
            .remedy("Use another provider, a newer release of AMD's libraries or a newer driver, or another generator")
    })
}

/// Judges the generated frame by its distance from each candidate; the error is the text of the nearest.
fn judge(sums: &[u32; CANDIDATES.len()], motion_holds_jitter: bool) -> Result<(), &'static str> {
    let is_right = |index: usize| index == 0 || (index == JITTER_LEFT && motion_holds_jitter);
    let least = |right: bool| {
        let of_kind = sums.iter().enumerate().filter(|(index, _)| is_right(*index) == right);
        of_kind.map(|(_, sum)| *sum).min().unwrap_or(0)
    };
    // Less than half the distance to any wrong candidate: providers sharpen and filter in different ways.
    if u64::from(least(true)) * 2 < u64::from(least(false)) {
        return Ok(());
    }
    Err(sums.iter().zip(CANDIDATES).min_by_key(|(sum, _)| **sum).map_or("", |(_, (_, why))| why))
}

/// The test's textures, kernels and parameters.
struct SelfTest<'a> {
    gpu: &'a Gpu,
    options: &'a TextureOptions,
    format: DXGI_FORMAT,
    /// Motion from frame 0 to frame 1 in display pixels: of the background, and of the blocks.
    moved: [[f32; 2]; 2],
    /// Camera jitter of frame 0 in display pixels; frame 1 has its negative.
    jitter: [f32; 2],
    pattern: Kernel,
    compare: Kernel,
    color: ID3D12Resource,
    output: ID3D12Resource,
    candidate: ID3D12Resource,
    depth: ID3D12Resource,
    motion: ID3D12Resource,
    sums: ID3D12Resource,
    readback: MappedBuffer,
}

impl<'a> SelfTest<'a> {
    fn new(gpu: &'a Gpu, options: &'a TextureOptions) -> Result<Self> {
        let head = &options.head;
        let (display_size, rendered) = (head.display_size, head.max_render_size);
        let format = untyped(DXGI_FORMAT(head.back_buffer_format.to_dxgi().cast_signed()));
        let frame = || texture(gpu, display_size, format);
        let bytes = CANDIDATES.len() * 4;
        // A multiple of four, so that half of each component is a whole number of pixels.
        let step = (4 * (pattern_width(display_size) / 160)).clamp(4, 64) as f32;
        let pattern = Shape { constants: CONSTANTS as u32, inputs: 1, outputs: 1 };
        let compare = Shape { constants: 7, inputs: 2, outputs: 1 };
        let made = Self {
            gpu,
            options,
            format,
            // Not opposite to each other, so that each wrong assumption puts the blocks somewhere else.
            moved: [[step, -step / 2.0], [-step, -step]],
            jitter: [step / 8.0, -step / 8.0],
            pattern: Kernel::new(gpu, include_bytes!("../gpu/shaders/compiled/fsr_pattern.dxbc"), pattern)?,
            compare: Kernel::new(gpu, include_bytes!("../gpu/shaders/compiled/fsr_compare.dxbc"), compare)?,
            color: frame()?,
            output: frame()?,
            candidate: frame()?,
            depth: texture(gpu, rendered, DXGI_FORMAT_R32_FLOAT)?,
            motion: texture(gpu, motion_size(head), DXGI_FORMAT_R16G16_FLOAT)?,
            sums: buffer(gpu, Heap::Device, bytes)?,
            readback: MappedBuffer::new(gpu, Heap::Readback, bytes)?,
        };
        // Fails if shaders cannot write textures of this format.
        compute::texture(gpu, &with_state(&made.output), &[format], "back_buffer_format")?;
        Ok(made)
    }

    /// Draws both frames and passes them to the generator.
    fn generate_pair(&self, generator: &mut TextureGenerator) -> Result<()> {
        const DESCRIPTORS: u32 = 2;
        let mut ring = CommandRing::new(self.gpu, self.gpu.frames(), 3 * DESCRIPTORS)?;
        let (motion, depth) = (with_state(&self.motion), with_state(&self.depth));
        let head = &self.options.head;
        let (display_size, rendered, of_motion) = (head.display_size, head.max_render_size, motion_size(head));
        let holds_jitter = head.flags.contains(CreateFlags::MOTION_JITTER);
        let scaled = |[x, y]: [f32; 2], to: Dimensions| {
            [x * to.width as f32 / display_size.width as f32, y * to.height as f32 / display_size.height as f32]
        };
        for (number, sign) in [(0.0, 1.0), (1.0, -1.0)] {
            let jitter = self.jitter.map(|jitter| jitter * sign);
            // Motion from this frame to the previous one, plus the previous jitter minus this one if motion contains jitter.
            let to_before = self.moved.map(|moved| {
                let held = if holds_jitter { self.jitter_in_motion() } else { [0.0; 2] };
                scaled([held[0] - moved[0], held[1] - moved[1]], of_motion)
            });
            let mut frame = ring.begin()?;
            let values = |[background, foreground]: [[f32; 2]; 2]| Mode::Values { number, background, foreground };
            self.draw(&mut frame, &motion, DXGI_FORMAT_R16G16_FLOAT, values(to_before), scaled(jitter, of_motion))?;
            let depths = [BACKGROUND, FOREGROUND].map(|distance| [device_depth(distance, head.flags), 0.0]);
            self.draw(&mut frame, &depth, DXGI_FORMAT_R32_FLOAT, values(depths), scaled(jitter, rendered))?;
            self.draw(&mut frame, &with_state(&self.color), self.format, Mode::Frame(number), [0.0; 2])?;
            frame.submit(self.gpu.frames())?;
            let pictures = GenerationTextures {
                color: with_state(&self.color),
                output: with_state(&self.output),
                depth,
                motion,
                hudless: None,
                distortion: None,
            };
            let [x, y] = scaled(jitter, rendered);
            let params =
                FrameParams { reset: number == 0.0, jitter: Coordinates { x, y }, ..FrameParams::of(rendered) };
            generator.generate(&pictures, &params)?;
        }
        Ok(())
    }

    /// The part of frame 1's motion that comes from jitter: the previous jitter minus this one, in display pixels.
    fn jitter_in_motion(&self) -> [f32; 2] {
        self.jitter.map(|jitter| 2.0 * jitter)
    }

    /// The distance of the generated frame from each candidate.
    fn distances(&self) -> Result<[u32; CANDIDATES.len()]> {
        const DESCRIPTORS: u32 = 5;
        let mut ring = CommandRing::new(self.gpu, self.gpu.frames(), DESCRIPTORS * CANDIDATES.len() as u32)?;
        let mut frame = ring.begin()?;
        let display_size = self.options.head.display_size;
        // The inner part only: content that enters the picture at its borders is unknown.
        let first = Dimensions { width: display_size.width / 8, height: display_size.height / 8 };
        let inner =
            Dimensions { width: display_size.width - 2 * first.width, height: display_size.height - 2 * first.height };
        let step = Dimensions { width: inner.width.div_ceil(512), height: inner.height.div_ceil(512) };
        let samples = Dimensions { width: inner.width / step.width, height: inner.height / step.height };
        let groups = [samples.width.div_ceil(GROUP), samples.height.div_ceil(GROUP), 1];
        let sums = ResourceWithState { resource: &self.sums, state: D3D12_RESOURCE_STATE_COMMON };
        let bytes = CANDIDATES.len() * 4;
        let mut zeroes = MappedBuffer::new(self.gpu, Heap::Upload, bytes)?;
        zeroes.write(0, &[0; CANDIDATES.len() * 4]);
        frame.transition_to(&sums, D3D12_RESOURCE_STATE_COPY_DEST)?;
        // SAFETY: an open list, and buffers of that many bytes that live until it has run.
        unsafe { frame.list().CopyBufferRegion(&self.sums, 0, zeroes.resource(), 0, bytes as u64) };
        for (index, (mode, _)) in (0..).zip(CANDIDATES) {
            let candidate = with_state(&self.candidate);
            self.draw(&mut frame, &candidate, self.format, mode, [0.0; 2])?;
            let inputs = [View::Texture(with_state(&self.output), self.format), View::Texture(candidate, self.format)];
            let output = View::Buffer(sums, WordRange { first: 0, count: CANDIDATES.len() as u32 });
            let constants =
                [first.width, first.height, step.width, step.height, samples.width, samples.height, index * 4];
            frame.run(&self.compare, &constants, &inputs, &[output], groups)?;
        }
        frame.transition_to(&sums, D3D12_RESOURCE_STATE_COPY_SOURCE)?;
        // SAFETY: as above.
        unsafe { frame.list().CopyBufferRegion(self.readback.resource(), 0, &self.sums, 0, bytes as u64) };
        frame.submit(self.gpu.frames())?.wait()?;
        let mut found = [0; CANDIDATES.len() * 4];
        self.readback.read(&mut found);
        let mut sums = [0; CANDIDATES.len()];
        sums.iter_mut().zip(found.as_chunks().0).for_each(|(sum, bytes)| *sum = u32::from_le_bytes(*bytes));
        Ok(sums)
    }

    /// Draws into a texture of any size, with a camera jitter in pixels of that texture.
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
        let display_size = head.display_size;
        let scale = [display_size.width as f32 / width as f32, display_size.height as f32 / height as f32];
        let motion_of = |AssumedMotion { factor, jitter }: AssumedMotion| {
            let held = self.jitter_in_motion();
            self.moved.map(|moved| [0, 1].map(|axis| moved[axis] * factor[axis] + held[axis] * jitter))
        };
        let is_drawn = matches!(mode, Mode::Frame(_)) && to.resource == &self.color;
        let (kind, number, [background, foreground]) = match mode {
            Mode::Frame(number) if is_drawn => (0, number, self.moved),
            Mode::Values { number, background, foreground } => (1, number, [background, foreground]),
            Mode::Frame(number) => (2, number, self.moved),
            Mode::Generated(motion) => (2, BETWEEN, motion_of(motion)),
            Mode::Reversed => (3, BETWEEN, self.moved),
            Mode::Black => (4, 0.0, self.moved),
        };
        // Providers use the nearest depth of the neighbouring pixels, and jitter moves edges: pixels near block edges are not
        // compared.
        let of_render = display_size
            .width
            .div_ceil(head.max_render_size.width)
            .max(display_size.height.div_ceil(head.max_render_size.height));
        let margin = 1.0 + of_render as f32 + self.jitter[0].abs();
        let numbers = [number].into_iter().chain(self.moved.into_iter().flatten());
        let numbers = numbers.chain(background).chain(foreground);
        let numbers = numbers.chain([self.side(), 640.0 / pattern_width(display_size) as f32, margin]);
        let words = scale.into_iter().chain(jitter).map(f32::to_bits);
        let words = [width, height].into_iter().chain(words).chain([kind]).chain(numbers.map(f32::to_bits));
        let mut constants = [0; CONSTANTS];
        constants.iter_mut().zip(words).for_each(|(constant, word)| *constant = word);
        let groups = [width.div_ceil(GROUP), height.div_ceil(GROUP), 1];
        let found = View::Texture(with_state(&self.output), self.format);
        frame.run(&self.pattern, &constants, &[found], &[View::Texture(*to, format)], groups)
    }

    /// Side of a block in display pixels. At this size, a background drawn in front by mistake hides more than half of a block.
    fn side(&self) -> f32 {
        2.0 * self.moved[0][0]
    }
}

/// The time of the generated frame, as in the shader.
const BETWEEN: f32 = 0.5;

/// Distances of both layers from the camera, in metres.
const BACKGROUND: f32 = 10.0;
const FOREGROUND: f32 = 1.0;

/// Device depth at `distance` metres from [`Camera::default`](super::Camera::default).
fn device_depth(distance: f32, flags: CreateFlags) -> f32 {
    let super::Camera { near, far, .. } = super::Camera::default();
    let of_infinite = 1.0 - near / distance;
    let depth =
        if flags.contains(CreateFlags::DEPTH_INFINITE) { of_infinite } else { of_infinite * far / (far - near) };
    if flags.contains(CreateFlags::DEPTH_INVERTED) { 1.0 - depth } else { depth }
}

/// The width that the pattern scales with: the frame's, limited to twice its height.
fn pattern_width(display_size: Dimensions) -> u32 {
    display_size.width.min(2 * display_size.height)
}

fn motion_size(head: &CreateFrameGeneration) -> Dimensions {
    super::texture_generator::motion_size_at(head, head.max_render_size)
}

fn with_state(resource: &ID3D12Resource) -> ResourceWithState<'_> {
    ResourceWithState { resource, state: STATE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_right_frame_passes_or_one_with_jitter_if_motion_contains_it() {
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
    fn near_depths_are_in_front_in_every_kind_of_depth() {
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
