//! How long frames take on this adapter: the generator by the GPU's clock, the first frame, and AMD's generator beside it.

use std::sync::Arc;
use std::time::Instant;

use cairn::framegen::shader::{DESCRIPTORS, ShaderGenerator, TexturePair};
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{Gpu, GpuTimeStatistics, Target};
use cairn::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, paper};
use cairn::present::device::DeviceDrawer;
use cairn::world::KeptAnchor;
use cairn::{Picture, Result};
use half::f16;

use super::adapters::gpu;
use super::clock::{Clock, Times};
use super::frames::device_presenter;
use super::fsr;
use super::resources::{upload_texture, writable_texture};
use super::shaders::DeviceGuidance;
use crate::outcome::{Better, Figure, Outcome};
use crate::settings::Settings;

/// Sizes of frames: of a whole run, and of a short one.
pub(super) fn sizes(settings: &Settings) -> Vec<((u32, u32), &'static str)> {
    settings.pick(
        vec![((1920, 1080), "1080p"), ((2560, 1440), "1440p"), ((3840, 2160), "4K")],
        vec![((160, 90), "160x90"), ((320, 180), "320x180")],
    )
}

/// Frames presented per anchor.
const MULTIPLIERS: std::ops::RangeInclusive<u32> = 2..=6;

/// Pictures and guidance of a ground that moves by 12 pixels, behind pillars that move by 4 pixels in the opposite direction.
struct Pillars {
    pictures: [Picture; 2],
    guidance: Guidance,
}

impl Pillars {
    fn new((width, height): (u32, u32)) -> Result<Self> {
        let is_pillar = |x: i32| x / 40 % 8 == 3;
        let ground = |x: i32, y: i32| {
            let wave = (x as f32 * 0.11).sin() + (y as f32 * 0.17 + x as f32 * 0.03).sin();
            [128.0 + 60.0 * wave, 120.0 + 40.0 * wave, 90.0 + ((x ^ y) & 15) as f32, 255.0].map(|v| v as u8)
        };
        let pixel = |x: i32, y: i32, is_previous: bool| {
            let (pillar, ground_x) = if is_previous { (x + 4, x - 12) } else { (x, x) };
            if is_pillar(pillar) { ground(7 * pillar + 1000, 5 * y) } else { ground(ground_x, y) }
        };
        let pixels = || (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| (x, y)));
        let picture = |is_previous| {
            Picture::from_rgba(width, height, pixels().flat_map(|(x, y)| pixel(x, y, is_previous)).collect())
        };
        let vector = |x| [f16::from_f32(if is_pillar(x) { -4.0 } else { 12.0 }), f16::ZERO];
        let motion = MotionField::from_vectors(width, height, pixels().map(|(x, _)| vector(x)).collect())?;
        let mut depth = DepthMap::tiled(width, height, 1, paper::PROJECTION)?;
        for (value, (x, _)) in depth.depth_mut().iter_mut().zip(pixels()) {
            *value = if is_pillar(x) { 0.4 } else { 0.99 };
        }
        Ok(Self {
            pictures: [picture(true)?, picture(false)?],
            guidance: Guidance::from_parts(motion, depth, MotionOrigin::Geometry)?,
        })
    }
}

/// Time of all generated frames of a pair of anchors, by size and frames per anchor.
pub(super) fn generator(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let clock = Clock::new(&gpu)?;
    let turns = settings.pick(50, 2);
    let mut outcome = Outcome::pass(format!(
        "time of all generated frames between two anchors, by the GPU's clock, {turns} turns each"
    ));
    for (size, name) in sizes(settings) {
        let scene = Pillars::new(size)?;
        let [before, after] = scene
            .pictures
            .each_ref()
            .map(|picture| upload_texture(&gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, picture.rgba()));
        let guided = DeviceGuidance::new(&gpu, &scene.guidance);
        let out = writable_texture(&gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
        let pair = TexturePair {
            previous: before.with_state(),
            current: after.with_state(),
            guidance: guided.textures(),
            previous_depth: None,
            cut: false,
        };
        let mut generator = ShaderGenerator::new(&gpu, size)?;
        for multiplier in MULTIPLIERS {
            let mut ring = CommandRing::new(&gpu, gpu.frames(), multiplier * DESCRIPTORS)?;
            let mut times = Vec::new();
            // The first turn is not counted, because drivers allocate at first use.
            for turn in 0..=turns {
                let took = clock.time(&gpu, |list| {
                    let now = gpu.frames().signal()?;
                    let mut frame = ring.begin_in(list, &now)?;
                    generator.prepare(&mut frame, &pair)?;
                    for i in 1..multiplier {
                        let t = i as f32 / multiplier as f32;
                        generator.interpolate(&mut frame, &pair, t, &out.with_state())?;
                    }
                    Ok(())
                })?;
                if turn > 0 {
                    times.push(took);
                }
            }
            let times = Times::new(times);
            if times.longest <= 0.0 {
                return Ok(Outcome::cannot_tell(
                    format!("the GPU's clock stood still during {name}, {multiplier}x"),
                    "Update the graphics driver",
                ));
            }
            outcome = outcome.with_figures(times.figures(&format!("{name}, {multiplier}x")));
        }
    }
    Ok(outcome)
}

/// Time between anchors, in nanoseconds: 15 a second.
const INTERVAL: u64 = 1_000_000_000 / 15;

/// A presenter on the device that shows the same two anchors over and over.
pub(super) struct Show {
    presenter: cairn::present::presenter::Presenter,
    drawer: DeviceDrawer,
    anchors: [Arc<KeptAnchor>; 2],
    guidance: Arc<Guidance>,
    target: Target,
    pushed: u64,
}

impl Show {
    pub(super) fn new(
        gpu: &Gpu,
        size: (u32, u32),
        choose: impl FnOnce(&mut DeviceDrawer) -> Result<()>,
    ) -> Result<Self> {
        let Pillars { pictures, guidance } = Pillars::new(size)?;
        let (presenter, drawer) = device_presenter(gpu, size, choose)?;
        let state = D3D12_RESOURCE_STATE_RENDER_TARGET;
        let texture = writable_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, state).resource;
        let mut number = 0;
        let anchors = pictures.map(|picture| {
            number += 1;
            Arc::new(KeptAnchor::of_picture(picture, number, false))
        });
        let target = Target { texture, before: state, after: state };
        let mut show = Self { presenter, drawer, anchors, guidance: Arc::new(guidance), target, pushed: 0 };
        show.push()?;
        Ok(show)
    }

    /// Pushes the next anchor; the pair's motion is only right in one direction, and takes as long in both.
    fn push(&mut self) -> Result<u64> {
        let now = self.pushed * INTERVAL;
        let guidance = (self.pushed > 0).then(|| self.guidance.clone());
        self.presenter.push(self.anchors[(self.pushed % 2) as usize].clone(), guidance, now)?;
        self.pushed += 1;
        Ok(now)
    }

    /// Pushes an anchor, and makes the frame half way to it. Returns the wall time until the GPU has made the frame, in milliseconds.
    pub(super) fn frame(&mut self) -> Result<f64> {
        let now = self.push()?;
        let began = Instant::now();
        if let Some((_, fence_point)) =
            self.presenter.submit(now + INTERVAL * 3 / 4, &mut self.drawer, &self.target)?.made()
        {
            fence_point.wait()?;
        }
        Ok(1e3 * began.elapsed().as_secs_f64())
    }

    /// The GPU's times of the frames so far.
    fn gpu_time(&mut self) -> GpuTimeStatistics {
        self.drawer.gpu_time()
    }
}

/// Largest time by which the first frame may exceed a later one, in milliseconds: a frame at 60 Hz.
const HITCH: f64 = 1000.0 / 60.0;

/// Time of the first frame after the preparation, against later ones.
pub(super) fn first_frame(settings: &Settings) -> Result<Outcome> {
    let (size, name) = sizes(settings)[0];
    let began = Instant::now();
    let gpu = gpu(settings)?;
    let device = 1e3 * began.elapsed().as_secs_f64();
    let began = Instant::now();
    let mut show = Show::new(&gpu, size, |_| Ok(()))?;
    let prepared = 1e3 * began.elapsed().as_secs_f64();
    let first = show.frame()?;
    let later = (0..settings.pick(30, 2)).map(|_| show.frame()).collect::<Result<Vec<f64>>>()?;
    let later = Times::new(later);
    let hitch = first - later.median;
    let found = format!(
        "at {name} the first frame takes {first:.1} ms with its anchor's upload, a later one {:.1} ms",
        later.median
    );
    let outcome = if settings.short || hitch <= HITCH {
        Outcome::pass(found)
    } else {
        Outcome::fail(format!("{found}: it would be seen at 60 Hz"), "Report it with this page")
    };
    Ok(outcome
        .figure("device", device, "ms", Better::Lower)
        .figure("preparation, with test pictures", prepared, "ms", Better::Lower)
        .figure("first frame", first, "ms", Better::Lower)
        .with_figures(later.figures("later frame")))
}

/// AMD's generator beside the library's own, half way between two anchors.
pub(super) fn fsr_beside(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let library = fsr::library()?;
    let mut outcome = Outcome::pass("time of a frame half way between two anchors, by the GPU's clock");
    for (size, name) in sizes(settings) {
        let [shaders, amd] = [false, true].map(|is_amd| {
            let mut show = Show::new(&gpu, size, |drawer| if is_amd { fsr::choose(&library, drawer) } else { Ok(()) })?;
            for _ in 0..settings.pick(30, 2) {
                show.frame()?;
            }
            Ok(show.gpu_time())
        });
        for (maker, times) in [("shaders", shaders?), ("AMD", amd?)] {
            let times: GpuTimeStatistics = times;
            let mean = 1e3 * times.total.as_secs_f64() / times.frames.max(1) as f64;
            let longest = 1e3 * times.longest.as_secs_f64();
            outcome = outcome.with_figures([("mean", mean), ("longest", longest)].map(|(of, value)| Figure {
                name: format!("{name}, {maker}, {of}"),
                value,
                unit: "ms".into(),
                better: Better::Lower,
            }));
        }
    }
    Ok(outcome)
}
