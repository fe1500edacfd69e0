//! The table.

use std::sync::Arc;

use cairn::ffx::{Choice, Effect, Library, LoadOptions};
use cairn::framegen::cpu::CpuGenerator;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COMMON;
use cairn::gpu::{Gpu, Target, read_texture, texture_from_picture};
use cairn::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, Projection};
use cairn::present::device::{DeviceDrawer, Preparation};
use cairn::present::pacing::Interval;
use cairn::present::presenter::{FrameSource, Presenter, PresenterOptions};
use cairn::world::{ControlScript, KeptAnchor};
use cairn::{Colours, Picture};
use half::f16;
use scenes::camera::{FAR, NEAR};
use scenes::{Clip, ClipOptions, Family, Frame, LANDSCAPES, Moment, Quality, Scene, render};

type Result<T, E = Box<dyn std::error::Error>> = std::result::Result<T, E>;

/// Anchors per second of world time, and moments in an interval.
const RATE: u32 = 15;
const STEPS: usize = 2;
/// Scene seed in each family; no other table uses it.
const SEED: u64 = 4;
/// The first anchor: 2 seconds into the script.
const FIRST: usize = 30;

/// Settings from the command line.
struct BenchSettings {
    size: (u32, u32),
    pairs: usize,
    families: &'static [Family],
    is_measured: bool,
}

impl BenchSettings {
    fn from_arguments() -> Result<Self> {
        let arguments: Vec<String> = std::env::args().skip(1).collect();
        if !arguments.iter().any(|argument| argument == "--bench") {
            return Ok(Self { size: (96, 64), pairs: 1, families: &LANDSCAPES[..1], is_measured: false });
        }
        let mut settings = Self { size: (640, 360), pairs: 8, families: &LANDSCAPES, is_measured: true };
        for pair in arguments.windows(2) {
            match pair[0].as_str() {
                "--size" => {
                    let (width, height) = pair[1].split_once('x').ok_or("--size is WIDTHxHEIGHT")?;
                    settings.size = (width.parse()?, height.parse()?);
                }
                "--pairs" => settings.pairs = pair[1].parse()?,
                _ => {}
            }
        }
        Ok(settings)
    }
}

/// A walk: anchors with their motion and depth, and the true frames half way between them.
struct Walk {
    anchors: Vec<Frame>,
    halves: Vec<Picture>,
    projection: Projection,
}

impl Walk {
    fn new(family: Family, settings: &BenchSettings) -> Result<Self> {
        let (width, height) = settings.size;
        let scene = Scene::new(family, SEED);
        let script = ControlScript::parse(family.script())?;
        let options = ClipOptions { width, height, rate: RATE * STEPS as u32, ..ClipOptions::default() };
        let mut walk = Clip::new(&scene, &script, options)?;
        let last = (FIRST + settings.pairs) * STEPS;
        let moments = (0..=last).map(|_| Ok(walk.advance()?.0)).collect::<Result<Vec<Moment>>>()?;
        let draw = |now: usize, before: usize| {
            render(&scene, &moments[now], &moments[before], width, height, Quality::default())
        };
        let anchors = (0..=settings.pairs).map(|pair| {
            let now = (FIRST + pair) * STEPS;
            draw(now, now - STEPS)
        });
        let halves = (0..settings.pairs).map(|pair| {
            let half = (FIRST + pair) * STEPS + STEPS / 2;
            draw(half, half).picture
        });
        let fov = moments[FIRST * STEPS].camera.vertical_fov;
        Ok(Self { anchors: anchors.collect(), halves: halves.collect(), projection: Projection::new(NEAR, FAR, fov)? })
    }

    /// Motion and depth of an anchor, as an engine provides them.
    fn guidance(&self, anchor: usize) -> Result<Guidance> {
        let frame = &self.anchors[anchor];
        let (width, height) = frame.picture.size();
        let finite = |v: f32| f16::from_f32(if v.is_finite() { v } else { 0.0 });
        let vectors = frame.motion.iter().map(|v| [finite(v.x), finite(v.y)]).collect();
        let motion = MotionField::from_vectors(width, height, vectors)?;
        let encoding = cairn::guidance::DepthEncoding::default();
        let depth = DepthMap::from_host(width, height, frame.depth.clone(), encoding, self.projection)?;
        Ok(Guidance::from_parts(motion, depth, MotionOrigin::Geometry)?)
    }
}

/// A frame generator that is compared.
struct Contender {
    name: String,
    presenter: Presenter,
    /// On a device, or the processor.
    drawer: Option<(Gpu, DeviceDrawer)>,
    /// PSNR of each frame in dB, with given motion and with motion found in the pictures.
    decibels: [Vec<f64>; 2],
}

impl Contender {
    /// Frames of `size`.
    fn new(name: &str, size: (u32, u32), mut drawer: Option<(Gpu, DeviceDrawer)>) -> Result<Self> {
        let options = PresenterOptions {
            interval: Some(Interval::per_second(RATE)?),
            extrapolate: false,
            decoded: false,
            ..PresenterOptions::default()
        };
        let presenter = match &mut drawer {
            Some((_, drawer)) => {
                let presenter = Presenter::new(options, None)?;
                presenter.prepare(drawer, &Preparation::new(size))?;
                presenter
            }
            None => Presenter::new(options, Some(Box::new(CpuGenerator::new())))?,
        };
        Ok(Self { name: name.to_owned(), presenter, drawer, decibels: Default::default() })
    }

    /// Shows a walk's frames half way, with the scene's own motion or what is found.
    fn show(&mut self, walk: &Walk, is_given: bool) -> Result<()> {
        self.presenter.reset();
        let interval = 1_000_000_000 / u64::from(RATE);
        for (number, frame) in walk.anchors.iter().enumerate() {
            let now = number as u64 * interval;
            let anchor = Arc::new(KeptAnchor::of_picture(frame.picture.clone(), number as u64, false));
            let guidance = (is_given && number > 0).then(|| walk.guidance(number)).transpose()?;
            if !self.presenter.push(anchor, guidance.map(Arc::new), now)? {
                return Err("an anchor is not taken".into());
            }
            if let Some(half) = number.checked_sub(1) {
                // Within the frame half way, which is shown for half an interval.
                let made = self.half(now + interval * 3 / 4, walk.halves[half].size())?;
                self.decibels[usize::from(!is_given)].push(psnr(&made, &walk.halves[half]));
            }
        }
        Ok(())
    }

    fn half(&mut self, now: u64, size: (u32, u32)) -> Result<Picture> {
        let mut made = None;
        let shown = match &mut self.drawer {
            None => self.presenter.draw(now, size, |picture| made = Some(picture.clone()))?,
            Some((gpu, drawer)) => {
                let (texture, moment) = texture_from_picture(gpu, &Picture::new(size.0, size.1)?)?;
                moment.wait()?;
                let rest = D3D12_RESOURCE_STATE_COMMON;
                let target = Target { texture: texture.clone(), before: rest, after: rest };
                let shown = self.presenter.submit(now, drawer, &target)?.made().map(|(shown, _)| shown);
                made = Some(read_texture(gpu, &texture, rest)?);
                shown
            }
        };
        match (shown, made) {
            (Some(shown), Some(made)) if shown.t == 0.5 && shown.source != FrameSource::Anchor => Ok(made),
            (shown, _) => Err(format!("{}: {shown:?} is not half way", self.name).into()),
        }
    }
}

pub(crate) fn run() -> Result<()> {
    let settings = BenchSettings::from_arguments()?;
    let gpu = Gpu::on_adapter(None)?;
    let drawer = || DeviceDrawer::new(&gpu, settings.size, Colours::Srgb);
    let mut contenders = Vec::new();
    match Library::load(&LoadOptions::from_environment()) {
        Ok(library) => {
            let mut drawer = drawer()?;
            drawer.use_fsr(library.api(Effect::FrameGeneration)?, Choice::Any, true)?;
            let version = drawer.made_by_fsr().map(|version| version.name.clone()).unwrap_or_default();
            contenders.push(Contender::new(&format!("fsr {version}"), settings.size, Some((gpu.clone(), drawer)))?);
        }
        Err(why) => eprintln!("without fsr: {why}"),
    }
    contenders.push(Contender::new("shader", settings.size, Some((gpu.clone(), drawer()?)))?);
    contenders.push(Contender::new("cpu", settings.size, None)?);
    for family in settings.families {
        let walk = Walk::new(*family, &settings)?;
        for contender in &mut contenders {
            for is_given in [true, false] {
                contender.show(&walk, is_given)?;
            }
        }
    }
    if !settings.is_measured {
        return Ok(());
    }
    let (width, height) = settings.size;
    println!(
        "PSNR in dB of frames half way between anchors 1/15 s apart, {width}x{height}, {} to a scene.",
        settings.pairs
    );
    println!("Seed {SEED} of each; motion and depth the scene's own, then found in the pictures.\n");
    let heads: Vec<String> = settings.families.iter().map(|family| format!(" {family} |")).collect();
    println!("| generator | motion |{} mean | worst |", heads.concat());
    println!("|---|---|{}---:|---:|", "---:|".repeat(heads.len()));
    for contender in &contenders {
        for (of, decibels) in ["given", "found"].into_iter().zip(&contender.decibels) {
            let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
            let families: String =
                decibels.chunks(settings.pairs).map(|family| format!(" {:.2} |", mean(family))).collect();
            let worst = decibels.iter().copied().fold(f64::INFINITY, f64::min);
            println!("| {} | {of} |{families} {:.2} | {worst:.2} |", contender.name, mean(decibels));
        }
    }
    Ok(())
}

/// Peak signal-to-noise ratio over red, green and blue, at most that of one wrong step in all of a picture.
fn psnr(made: &Picture, truth: &Picture) -> f64 {
    let steps = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).map(|c| f64::from(a[c].abs_diff(b[c])).powi(2)).sum::<f64>();
    let sum: f64 = made.pixels().iter().zip(truth.pixels()).map(steps).sum();
    let mean = sum.max(1.0) / (3 * truth.pixels().len()) as f64;
    10.0 * (255.0 * 255.0 / mean).log10()
}
