//! The library's compute shaders on this adapter, against the processor's results of the same input.

use std::fmt::Debug;

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::shader::{DESCRIPTORS, GuidanceTextures, ShaderGenerator, TexturePair};
use cairn::framegen::{Anchor, AnchorPair, FrameGenerator};
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{Gpu, Planes, Resize};
use cairn::guidance::picture_flow::{self, GpuExtractor};
use cairn::guidance::{Guidance, paper};
use cairn::world::Bilinear;
use cairn::{Picture, Pixel, Raster, Result};
use half::f16;
use scenes::Family;

use super::adapters::gpu;
use super::frame_cases::{self, Random};
use super::resources::{TestResource, read_texture, upload_buffer, upload_texture, writable_texture};
use super::walk::Walk;
use crate::outcome::{Better, Outcome};
use crate::settings::Settings;

const REMEDY: &str = "Update the graphics driver; if it stays, report it with this page";
const COMMON: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COMMON;

/// Decoded pictures are resized as on the processor, into every format of a target.
pub(super) fn resize(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    resize_on(&gpu)
}

/// Largest part of the bytes that may differ, by a level of 255: the rounding of halves.
const UNEQUAL_BYTES: f64 = 1e-3;

pub(super) fn resize_on(gpu: &Gpu) -> Result<Outcome> {
    let resize = Resize::new(gpu)?;
    let mut ring = CommandRing::new(gpu, gpu.frames(), 2)?;
    let (mut bytes, mut unequal, mut far, mut worst_half) = (0_u64, 0_u64, 0_u64, 0.0_f32);
    let mut random = Random(7);
    for (from, to) in [((7, 5), (7, 5)), ((20, 12), (37, 23)), ((64, 36), (19, 40)), ((160, 90), (640, 360))] {
        let values: Vec<f32> = (0..3 * from.0 * from.1).map(|_| 0.5 + 0.6 * random.signed_unit()).collect();
        let mut wanted = Picture::new(to.0, to.1)?;
        Bilinear::new(from, to).to_picture(&values, &mut wanted);
        let buffer = upload_buffer(gpu, bytemuck::cast_slice(&values));
        let planes = || Planes { buffer: buffer.with_state(), picture: 0, size: from, half: false };
        let mut resized = |format, size: usize| {
            let target = writable_texture(gpu, to, format, COMMON);
            let mut frame = ring.begin()?;
            resize.record(&mut frame, &planes(), &target.with_state())?;
            frame.submit(gpu.frames())?.wait()?;
            Ok(read_texture(gpu, &target, to.0 as usize * size))
        };
        let found: Result<Vec<u8>> = resized(DXGI_FORMAT_R8G8B8A8_UNORM, 4);
        for (found, wanted) in found?.iter().zip(wanted.rgba()) {
            bytes += 1;
            unequal += u64::from(found != wanted);
            far += u64::from(found.abs_diff(*wanted) > 1);
        }
        let halves = resized(DXGI_FORMAT_R16G16B16A16_FLOAT, 8)?;
        let halves = halves.chunks_exact(2).map(|half| f16::from_le_bytes([half[0], half[1]]).to_f32());
        let levels = wanted.rgba().iter().map(|level| f32::from(*level) / 255.0);
        worst_half = halves.zip(levels).map(|(half, level)| (half - level).abs()).fold(worst_half, f32::max);
    }
    let part = unequal as f64 / bytes as f64;
    // Half a level of 255, and the precision of a half float.
    let is_right = far == 0 && part <= UNEQUAL_BYTES && worst_half <= 0.5 / 255.0 + 0.001;
    let found = format!(
        "{unequal} of {bytes} bytes differ from the processor's, {far} of them by more than a level; half floats by at most {worst_half:.4}"
    );
    let outcome = if is_right { Outcome::pass(found) } else { Outcome::fail(found, REMEDY) };
    Ok(outcome.figure("bytes that differ", 100.0 * part, "%", Better::Lower))
}

/// Optical flow between frames of scenes is as on the processor.
pub(super) fn flow(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    flow_on(&gpu, settings.pick((320, 180), (160, 90)))
}

/// Parts of the pixels, and the distance that they may have from the processor's motion, in pixels: a device rounds quotients as it likes,
/// and a search that starts a little differently may end elsewhere.
const NEAR: [(f64, f32); 2] = [(0.99, 0.25), (0.9, 0.01)];

pub(super) fn flow_on(gpu: &Gpu, size: (u32, u32)) -> Result<Outcome> {
    let tile = 16;
    let extractor = GpuExtractor::new(gpu, size)?;
    let mut ring = CommandRing::new(gpu, gpu.frames(), picture_flow::DESCRIPTORS)?;
    let motion = writable_texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT, COMMON);
    let depth = writable_texture(gpu, (size.0.div_ceil(tile), size.1.div_ceil(tile)), DXGI_FORMAT_R32_FLOAT, COMMON);
    let mut distances = Vec::new();
    for family in [Family::Forest, Family::Desert] {
        let walk = Walk::new(family, size, 1)?;
        let pair = [walk.picture(0), walk.picture(1)];
        let mut wanted = Guidance::new(1, 1, paper::PROJECTION)?;
        picture_flow::extract(pair[0], pair[1], &mut wanted)?;
        let [before, after] = pair.map(|picture| upload_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, picture.rgba()));
        let mut frame = ring.begin()?;
        extractor.record(
            &mut frame,
            &before.with_state(),
            &after.with_state(),
            &motion.with_state(),
            &depth.with_state(),
        )?;
        frame.submit(gpu.frames())?.wait()?;
        let found = read_texture(gpu, &motion, size.0 as usize * 4);
        let half = |bytes: &[u8]| f16::from_le_bytes([bytes[0], bytes[1]]).to_f32();
        let found = found.chunks_exact(4).map(|vector| [half(vector), half(&vector[2..])]);
        distances.extend(found.zip(wanted.motion().vectors()).map(|(found, wanted)| {
            let [u, v] = wanted.map(f16::to_f32);
            (found[0] - u).hypot(found[1] - v)
        }));
    }
    distances.sort_by(f32::total_cmp);
    let at = |part: f64| distances[((distances.len() - 1) as f64 * part) as usize];
    let is_right = NEAR.iter().all(|(part, limit)| at(*part) <= *limit);
    let unequal = distances.iter().filter(|distance| **distance != 0.0).count();
    let found = format!(
        "{unequal} of {} vectors differ from the processor's; 90 % by at most {:.4} px, 99 % by at most {:.4} px",
        distances.len(),
        at(0.9),
        at(0.99)
    );
    let outcome = if is_right { Outcome::pass(found) } else { Outcome::fail(found, REMEDY) };
    Ok(outcome.figure("99 % of the vectors are within", f64::from(at(0.99)), "px", Better::Lower))
}

/// A pixel format that frames are compared in.
trait ComparablePixel: Pixel + bytemuck::Pod + Debug {
    /// The texture format of such pixels.
    const FORMAT: DXGI_FORMAT;
    /// The pixel with these levels of 255.
    fn from_levels(levels: [f32; 4]) -> Self;
    /// Whether two pixels differ by at most one level of 255.
    fn is_near(self, other: Self) -> bool;
}

impl ComparablePixel for [u8; 4] {
    const FORMAT: DXGI_FORMAT = DXGI_FORMAT_R8G8B8A8_UNORM;

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| (v + 0.5) as u8)
    }

    fn is_near(self, other: Self) -> bool {
        self.iter().zip(other).all(|(a, b)| a.abs_diff(b) <= 1)
    }
}

impl ComparablePixel for [f16; 4] {
    const FORMAT: DXGI_FORMAT = DXGI_FORMAT_R16G16B16A16_FLOAT;

    fn from_levels(levels: [f32; 4]) -> Self {
        levels.map(|v| f16::from_f32(v / 255.0))
    }

    fn is_near(self, other: Self) -> bool {
        self.iter().zip(other).all(|(a, b)| (a.to_f32() - b.to_f32()).abs() <= 1.0 / 255.0)
    }
}

/// Largest part of the pixels that may differ from the processor's by more than a level.
const FAR_PIXELS: f64 = 1e-3;

/// Generated and extrapolated frames of random cases, in bytes and in half floats.
pub(super) fn generator(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    generator_on(&gpu, settings.pick(60, 8))
}

pub(super) fn generator_on(gpu: &Gpu, cases: u64) -> Result<Outcome> {
    let mut differences = Differences::default();
    differences.compare::<[u8; 4]>(gpu, cases)?;
    differences.compare::<[f16; 4]>(gpu, cases / 2)?;
    let Differences { frames, pixels, far, worst } = differences;
    let part = far as f64 / pixels as f64;
    let found = format!("{far} of {pixels} pixels of {frames} frames differ by more than a level from the processor's");
    let outcome = if part <= FAR_PIXELS {
        Outcome::pass(found)
    } else {
        Outcome::fail(format!("{found}, most of them in {}", worst.map_or(String::new(), |(_, case)| case)), REMEDY)
    };
    Ok(outcome.figure("pixels that differ", 100.0 * part, "%", Better::Lower))
}

/// Numbers of compared frames and pixels, and of pixels that differ by more than a level.
#[derive(Default)]
struct Differences {
    frames: usize,
    pixels: usize,
    far: usize,
    /// Most of such pixels in one frame, and what it was.
    worst: Option<(usize, String)>,
}

impl Differences {
    fn add<P: ComparablePixel>(&mut self, found: &[u8], wanted: &Raster<P>, what: impl FnOnce() -> String) {
        let found: &[P] = bytemuck::cast_slice(found);
        let far = found.iter().zip(wanted.pixels()).filter(|(found, wanted)| !found.is_near(**wanted)).count();
        self.frames += 1;
        self.pixels += wanted.pixels().len();
        self.far += far;
        if far > self.worst.as_ref().map_or(0, |(most, _)| *most) {
            self.worst = Some((far, what()));
        }
    }

    /// Compares a generated and an extrapolated frame of each random case.
    fn compare<P: ComparablePixel>(&mut self, gpu: &Gpu, cases: u64) -> Result<()>
    where
        CpuGenerator: FrameGenerator<P>,
    {
        let mut ring = CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?;
        let mut cpu = CpuGenerator::new();
        for seed in 0..cases {
            let mut random = Random(seed);
            let sizes = [(8, 8), (16, 24), (33, 17), (64, 40), (95, 70), (130, 81)];
            let size = sizes[random.below(sizes.len() as u64) as usize];
            let guidance = frame_cases::guidance(&mut random, size);
            let pictures = frame_cases::pictures(&mut random, size);
            let mut rasters = Vec::new();
            for levels in &pictures {
                let mut picture = Raster::<P>::new(size.0, size.1)?;
                picture.pixels_mut().iter_mut().zip(levels).for_each(|(pixel, l)| *pixel = P::from_levels(*l));
                rasters.push(picture);
            }
            let t = [0.5, 1.0 / 3.0, 0.25, 0.75, 0.1, 0.9][random.below(6) as usize];
            let mut wanted = rasters[0].clone();
            let pair = AnchorPair::new(&rasters[0], &rasters[1], &guidance)?;
            FrameGenerator::<P>::generate(&mut cpu, &pair, t, &mut wanted)?;

            let mut generator = ShaderGenerator::new(gpu, size)?;
            let upload =
                |raster: &Raster<P>| upload_texture(gpu, size, P::FORMAT, bytemuck::cast_slice(raster.pixels()));
            let (before, after) = (upload(&rasters[0]), upload(&rasters[1]));
            let guided = DeviceGuidance::new(gpu, &guidance);
            let textures = TexturePair {
                previous: before.with_state(),
                current: after.with_state(),
                guidance: guided.textures(),
                previous_depth: None,
                cut: false,
            };
            let out = writable_texture(gpu, size, P::FORMAT, COMMON);
            let row = size.0 as usize * size_of::<P>();
            let mut frame = ring.begin()?;
            generator.generate(&mut frame, &textures, t, &out.with_state())?;
            frame.submit(gpu.frames())?.wait()?;
            let what = || format!("case {seed}, {size:?} at {t}");
            self.add(&read_texture(gpu, &out, row), &wanted, what);

            let anchor = Anchor::new(&rasters[1], &guidance)?;
            FrameGenerator::<P>::extrapolate(&mut cpu, &anchor, t, &mut wanted)?;
            let mut frame = ring.begin()?;
            generator.extrapolate(&mut frame, &textures.current, &textures.guidance, false, t, &out.with_state())?;
            frame.submit(gpu.frames())?.wait()?;
            self.add(&read_texture(gpu, &out, row), &wanted, || format!("{}, extrapolated", what()));
        }
        Ok(())
    }
}

/// Guidance in textures.
pub(super) struct DeviceGuidance {
    motion: TestResource,
    depth: TestResource,
    tiles: [u32; 2],
    origin: cairn::guidance::MotionOrigin,
}

impl DeviceGuidance {
    pub(super) fn new(gpu: &Gpu, guidance: &Guidance) -> Self {
        let (field, depth) = (guidance.motion(), guidance.depth());
        let size = (field.columns(), field.vectors().len() as u32 / field.columns());
        let depth_size = (depth.columns(), depth.rows());
        Self {
            motion: upload_texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT, bytemuck::cast_slice(field.vectors())),
            depth: upload_texture(gpu, depth_size, DXGI_FORMAT_R32_FLOAT, bytemuck::cast_slice(depth.depth())),
            tiles: [field.tile(), depth.tile()],
            origin: guidance.origin(),
        }
    }

    pub(super) fn textures(&self) -> GuidanceTextures<'_> {
        GuidanceTextures {
            motion: self.motion.with_state(),
            motion_tile: self.tiles[0],
            depth: self.depth.with_state(),
            depth_tile: self.tiles[1],
            motion_origin: self.origin,
            hud: None,
        }
    }
}
