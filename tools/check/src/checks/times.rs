//! How long work takes on the judged adapter, by its own clock where it has one, and how much memory it uses.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use cairn::bundle::Precision;
use cairn::framegen::AnchorId;
use cairn::framegen::fsr::PairParams;
use cairn::framegen::shader::{self, GuidanceTextures, ShaderGenerator, TexturePair};
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{Gpu, Target};
use cairn::guidance::{MotionOrigin, paper};
use cairn::present::device::{DeviceDrawer, Preparation};
use cairn::present::presenter::Presenter;
use cairn::runtime::{Device, DirectMlOptions, Ort};
use cairn::world::{ControlInput, DeviceTimes, GuidanceSource, KeptAnchor, World};
use cairn::{Colours, Picture};
use gpu_testing::blend::{Blend, Clock};
use gpu_testing::engine::Engine;
use gpu_testing::presenters::{INTERVAL, PRESENT, constant_motion, moving, options};
use gpu_testing::resources::{TestResource, run_list, upload_texture, writable_texture};
use gpu_testing::textures::TextureDesc;
use half::f16;

use super::{DRIVER, Settings, fsr, seed, world};
use crate::finding::{Checked, Finding, Verdict};
use crate::report::Figure;

/// Sizes of frames, by the names that people use.
const SIZES: [(&str, (u32, u32)); 3] = [("1080p", (1920, 1080)), ("1440p", (2560, 1440)), ("4K", (3840, 2160))];
/// The size for quick runs.
const SMALL: (&str, (u32, u32)) = ("360p", (640, 360));
/// The size for quick runs where a processor may emulate the adapter.
const SMALLEST: (&str, (u32, u32)) = ("180p", (320, 180));
/// A frame at 60 Hz, in milliseconds: what a hitch must not reach.
const HITCH: f64 = 1000.0 / 60.0;
/// Anchors a second of the world.
const RATE: u32 = 15;

fn sizes(settings: &Settings, gpu: &Gpu) -> &'static [(&'static str, (u32, u32))] {
    match settings.quick {
        true if settings.emulation(gpu).is_some() => std::slice::from_ref(&SMALLEST),
        true => std::slice::from_ref(&SMALL),
        false => &SIZES,
    }
}

fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// Median, 99th percentile and longest of some times, which must not be empty.
pub(super) fn statistics(times: &[f64]) -> [f64; 3] {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |part: f64| sorted[((sorted.len() - 1) as f64 * part).round() as usize];
    [at(0.5), at(0.99), at(1.0)]
}

/// Three figures of the same times.
pub(super) fn figures_of(what: &str, times: &[f64]) -> Vec<Figure> {
    let names = ["median", "99th percentile", "longest"];
    let figure = |(name, value): (&str, f64)| Figure { name: format!("{what}, {name}"), value, unit: "ms".to_owned() };
    names.into_iter().zip(statistics(times)).map(figure).collect()
}

/// A latent step by stage, with passes run anew and captured.
pub(super) fn latents(settings: &Settings) -> Checked {
    let state = world::starting_state(settings)?;
    let gpu = settings.gpu()?;
    let device = Device::directml(&Ort::find(&settings.libraries())?, &gpu, DirectMlOptions::default())?;
    // Passes are captured and verified in the first latents.
    let (anew, captured, steps) = if settings.quick { (1, 2, 1) } else { (4, 4, 60) };
    let mut figures = Vec::new();
    let (mut fastest, mut is_consistent) = (f64::INFINITY, true);
    for (name, captured_passes, warm_up) in [("passes run anew", 0, anew), ("captured passes", 16, captured)] {
        device.set_directml_options(DirectMlOptions { captured_passes, ..DirectMlOptions::default() })?;
        let world = seed::world(&device, Precision::F16)?;
        let mut rollout = seed::begin(&world, state.as_deref())?;
        seed::walk(&mut rollout, 0..warm_up)?;
        rollout.latent()?;
        let before = rollout.device_times().unwrap_or_default();
        let (start, mut walls) = (Instant::now(), Vec::new());
        for i in 0..steps {
            let start = Instant::now();
            seed::walk(&mut rollout, i..i + 1)?;
            // Waits for the device.
            rollout.latent()?;
            walls.push(ms(start.elapsed()));
        }
        let elapsed = start.elapsed();
        let after = rollout.device_times().unwrap_or_default();
        let stage = |of: fn(&DeviceTimes) -> Duration| of(&after).saturating_sub(of(&before));
        let [passes, decode, commit] =
            [stage(|t| t.passes.total), stage(|t| t.decode.total), stage(|t| t.commit.total)];
        let on_device = passes + decode + commit;
        is_consistent &= on_device > Duration::ZERO && on_device <= elapsed.mul_f64(1.05);
        fastest = fastest.min(statistics(&walls)[0]);
        figures.extend(figures_of(&format!("{name}: a step"), &walls));
        for (stage, time) in [("denoising and cache passes", passes), ("decoder", decode), ("commit", commit)] {
            let value = ms(time) / steps as f64;
            figures.push(Figure { name: format!("{name}: {stage} on the device"), value, unit: "ms".to_owned() });
        }
    }
    let finding = if is_consistent {
        Finding::pass(format!(
            "A latent of the embedded world takes {fastest:.1} ms; it has {:.0} ms at {RATE} a second. Times of stages are the device's own",
            1000.0 / f64::from(RATE)
        ))
    } else {
        Finding::fail(
            "The device's clock contradicts the processor's: stages take no time, or longer than the steps",
            DRIVER,
        )
    };
    Ok(settings.about_times(&gpu, finding.figures(figures)))
}

/// Pictures, motion and depth of a ground that moves behind pillars that move the other way.
struct Inputs {
    pictures: [TestResource; 2],
    motion: TestResource,
    depth: TestResource,
    out: TestResource,
}

impl Inputs {
    fn new(gpu: &Gpu, size: (u32, u32)) -> Self {
        let is_pillar = |x: u32| x / 40 % 8 == 3;
        let pixel = |x: u32, y: u32, shift: u32| {
            let x = if is_pillar(x) { 7 * x + 1000 - shift / 3 } else { x + shift };
            [(x * 5 + y) as u8, (y * 3 + x / 4) as u8, (x ^ y) as u8, 255]
        };
        let all = || (0..size.1).flat_map(move |y| (0..size.0).map(move |x| (x, y)));
        let pictures = [12, 0].map(|shift| {
            let bytes: Vec<u8> = all().flat_map(|(x, y)| pixel(x, y, shift)).collect();
            upload_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, &bytes)
        });
        let vector = |x: u32| [f16::from_f32(if is_pillar(x) { -4.0 } else { 12.0 }), f16::ZERO];
        let motion: Vec<u8> = all().flat_map(|(x, _)| vector(x)).flat_map(f16::to_le_bytes).collect();
        let depth: Vec<u8> = all().flat_map(|(x, _)| if is_pillar(x) { 0.4_f32 } else { 0.99 }.to_le_bytes()).collect();
        Self {
            pictures,
            motion: upload_texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT, &motion),
            depth: upload_texture(gpu, size, DXGI_FORMAT_R32_FLOAT, &depth),
            out: writable_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_UNORDERED_ACCESS),
        }
    }

    fn pair(&self) -> TexturePair<'_> {
        let [previous, current] = self.pictures.each_ref().map(TestResource::with_state);
        TexturePair {
            previous,
            current,
            guidance: GuidanceTextures {
                motion: self.motion.with_state(),
                motion_tile: 1,
                depth: self.depth.with_state(),
                depth_tile: 1,
                motion_origin: MotionOrigin::Geometry,
                hud: None,
            },
            previous_depth: None,
            cut: false,
        }
    }
}

/// The generator's frames of a pair, from one to five of them.
pub(super) fn generator(settings: &Settings) -> Checked {
    let gpu = settings.gpu()?;
    let clock = Clock::new(&gpu);
    let turns = if settings.quick { 1 } else { 9 };
    let mut figures = Vec::new();
    let (mut is_consistent, mut shown) = (true, String::new());
    for (name, size) in sizes(settings, &gpu) {
        let inputs = Inputs::new(&gpu, *size);
        let (pair, out) = (inputs.pair(), inputs.out.with_state());
        let mut generator = ShaderGenerator::new(&gpu, *size)?;
        let mut ring = CommandRing::new(&gpu, gpu.frames(), 6 * shader::DESCRIPTORS)?;
        for multiplier in 2_u32..=6 {
            let mut times = Vec::new();
            // The first turn is not measured.
            for turn in 0..=turns {
                let now = gpu.frames().signal()?;
                let start = Instant::now();
                let mut recorded = Ok(());
                let time = clock.time(&gpu, |list| {
                    recorded = (|| {
                        let mut frame = ring.begin_in(list, &now)?;
                        generator.prepare(&mut frame, &pair)?;
                        (1..multiplier).try_for_each(|part| {
                            generator.interpolate(&mut frame, &pair, part as f32 / multiplier as f32, &out)
                        })
                    })();
                });
                recorded?;
                is_consistent &= time > 0.0 && time <= 1.05 * start.elapsed().as_secs_f64();
                if turn > 0 {
                    times.push(1e3 * time);
                }
            }
            let median = statistics(&times)[0];
            if multiplier == 2 {
                shown = format!("{shown}{}{median:.2} ms at {name}", if shown.is_empty() { "" } else { ", " });
            }
            figures.push(Figure { name: format!("{name}, {multiplier}x"), value: median, unit: "ms".to_owned() });
        }
    }
    let finding = if is_consistent {
        Finding::pass(format!(
            "One frame between two anchors takes {shown} by the device's clock; 3x to 6x are two to five frames"
        ))
    } else {
        Finding::fail(
            "The device's clock contradicts the processor's: frames take no time, or longer than the call",
            DRIVER,
        )
    };
    Ok(settings.about_times(&gpu, finding.figures(figures)))
}

/// FSR's frames of the same pairs.
pub(super) fn fsr(settings: &Settings) -> Checked {
    let api = fsr::api(settings)?;
    let gpu = settings.gpu()?;
    let count = if settings.quick { 4 } else { 30 };
    let mut figures = Vec::new();
    let mut version = String::new();
    for (name, size) in sizes(settings, &gpu) {
        let inputs = Inputs::new(&gpu, *size);
        let mut generator = fsr::generator(&gpu, &api, *size)?;
        version.clone_from(&generator.version().name);
        let mut times = Vec::new();
        for index in 0..count {
            let params = PairParams {
                anchor: AnchorId { epoch: 0, index },
                projection: paper::PROJECTION,
                interval_ms: 1000.0 / RATE as f32,
            };
            let start = Instant::now();
            let (_, done) = generator.generate(&inputs.pair(), &params)?;
            done.wait()?;
            // The first two set the provider's history up.
            if index > 1 {
                times.push(ms(start.elapsed()));
            }
        }
        let value = statistics(&times)[0];
        figures.push(Figure { name: format!("{name}, 2x, from the call to its end"), value, unit: "ms".to_owned() });
    }
    let finding = Finding::pass(format!(
        "Frames by AMD's provider {version}, from the call to the end of the work on the device"
    ));
    Ok(settings.about_times(&gpu, finding.figures(figures)))
}

/// The first frame beside the ones after it.
pub(super) fn first_frame(settings: &Settings) -> Checked {
    let gpu = settings.gpu()?;
    let engine = Engine::of(&gpu);
    let (name, size) = sizes(settings, &gpu)[0];
    let presenter = Presenter::new(options(GuidanceSource::PictureFlow), None)?;
    let push = |number: u64| -> cairn::Result<bool> {
        let anchor = Arc::new(KeptAnchor::of_picture(moving(size, number, 3), number, false));
        presenter.push(anchor, (number > 0).then(|| constant_motion(size, 3.0)), number * INTERVAL)
    };
    push(0)?;
    let start = Instant::now();
    let mut drawer = DeviceDrawer::new(&gpu, size, Colours::Srgb)?;
    presenter.prepare(&mut drawer, &Preparation::new(size))?;
    let preparation = ms(start.elapsed());
    let texture = TextureDesc { size, ..TextureDesc::default() }.create(&engine.device);
    let target = Target { texture, before: PRESENT, after: PRESENT };
    let mut times = Vec::new();
    // The first frame of each pair, which uploads an anchor and its motion.
    for number in 1..if settings.quick { 5 } else { 30 } {
        push(number)?;
        let start = Instant::now();
        let made = presenter.submit(number * INTERVAL + INTERVAL / 4, &mut drawer, &target)?.made();
        let (_, done) = made.ok_or_else(|| Finding::fail("A prepared frame was not made", DRIVER))?;
        done.wait()?;
        times.push(ms(start.elapsed()));
    }
    let (first, later) = (times[0], statistics(&times[1..])[0]);
    let sentence = format!(
        "After a preparation of {preparation:.0} ms the first frame at {name} takes {first:.1} ms, and the first of each later pair of anchors {later:.1} ms"
    );
    let remedy = "Send this report: after the preparation no frame compiles or makes anything";
    let finding = Finding::judge(first - later < HITCH, sentence, remedy)
        .figure("preparation", preparation, "ms")
        .figure("first frame", first, "ms")
        .figure("first frame of a later pair, median", later, "ms");
    Ok(settings.about_times(&gpu, finding))
}

/// Memory of a world, a rollout and a generator, against the budget.
pub(super) fn memory(settings: &Settings) -> Checked {
    const MIB: f64 = 1024.0 * 1024.0;
    let gpu = settings.gpu()?;
    let unknown = || {
        Finding::cannot_tell(
            "The system reports no memory budget for the adapter",
            "Use Windows 10 or 11 with a WDDM 2 driver",
        )
    };
    let state = world::starting_state(settings)?;
    let before = gpu.budget()?.ok_or_else(unknown)?;
    let device = Device::directml(&Ort::find(&settings.libraries())?, &gpu, DirectMlOptions::default())?;
    let world = seed::world(&device, Precision::F16)?;
    let mut rollout = seed::begin(&world, state.as_deref())?;
    seed::walk(&mut rollout, 0..1)?;
    let with_world = gpu.budget()?.ok_or_else(unknown)?;
    let (name, size) = sizes(settings, &gpu)[0];
    let inputs = Inputs::new(&gpu, size);
    let mut generator = ShaderGenerator::new(&gpu, size)?;
    let mut ring = CommandRing::new(&gpu, gpu.frames(), shader::DESCRIPTORS)?;
    let mut frame = ring.begin()?;
    generator.generate(&mut frame, &inputs.pair(), 0.5, &inputs.out.with_state())?;
    frame.submit(gpu.frames())?.wait()?;
    let all = gpu.budget()?.ok_or_else(unknown)?;
    let grown = |to: u64, from: u64| (to as f64 - from as f64) / MIB;
    let sentence = format!(
        "A rollout of the embedded world and a generator at {name} use {:.0} MiB of the adapter's memory, of a budget of {:.0} MiB",
        all.used as f64 / MIB,
        all.granted as f64 / MIB
    );
    let finding = Finding::judge(
        all.used <= all.granted,
        sentence,
        "Close other programs; docs/performance.md says what needs memory",
    )
    .figure("budget", all.granted as f64 / MIB, "MiB")
    .figure("used in all", all.used as f64 / MIB, "MiB")
    .figure("world and rollout", grown(with_world.used, before.used), "MiB")
    .figure("the same by the library's estimate", world.memory_need().total as f64 / MIB, "MiB")
    .figure(format!("generator and its pictures at {name}"), grown(all.used, with_world.used), "MiB");
    Ok(settings.about_times(&gpu, finding))
}

/// A synthetic engine: each frame blends two textures so often that the device works for about a third of the frame's time.
struct SyntheticEngine<'a> {
    gpu: &'a Gpu,
    blend: Blend,
    blends: usize,
    interval: Duration,
}

impl SyntheticEngine<'_> {
    /// Times in milliseconds from the start of a frame to the end of its work.
    fn frames(&self, duration: Duration) -> Vec<f64> {
        let (start, mut times, mut due) = (Instant::now(), Vec::new(), Instant::now());
        while start.elapsed() < duration || times.len() < 4 {
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let begun = Instant::now();
            run_list(self.gpu, |list| (0..self.blends).for_each(|_| self.blend.record(list)));
            times.push(ms(begun.elapsed()));
            // The next one of the display's refreshes that has not passed.
            while due <= Instant::now() {
                due += self.interval;
            }
        }
        times
    }
}

/// Frames of a synthetic engine at 60 and 120 Hz, with latents beside them and without.
pub(super) fn engine(settings: &Settings) -> Checked {
    let state = world::starting_state(settings)?;
    let gpu = settings.gpu()?;
    let options = DirectMlOptions {
        captured_passes: 16,
        longest_submission: Some(Duration::from_millis(2)),
        ..DirectMlOptions::default()
    };
    let device = Device::directml(&Ort::find(&settings.libraries())?, &gpu, options)?;
    let world = seed::world(&device, Precision::F16)?;
    let size = if settings.emulation(&gpu).is_some() { SMALLEST.1 } else { SMALL.1 };
    let inputs = Inputs::new(&gpu, size);
    let (duration, warm_up) = if settings.quick { (Duration::from_secs(1), 1) } else { (Duration::from_secs(8), 4) };
    let mut finding = Finding::pass("");
    let mut parts = Vec::new();
    for rate in [60, 120] {
        let interval = Duration::from_secs(1) / rate;
        let [before, after] = &inputs.pictures;
        let blend = Blend::new(&gpu, [before, after, &inputs.out], size);
        let clock = Clock::new(&gpu);
        let once = |count: usize| clock.time(&gpu, |list| (0..count).for_each(|_| blend.record(list)));
        once(8);
        let one = once(8) / 8.0;
        let blends = ((interval.as_secs_f64() / 3.0 / one.max(1e-7)) as usize).clamp(1, 20_000);
        let engine = SyntheticEngine { gpu: &gpu, blend, blends, interval };
        let alone = engine.frames(duration);
        let (beside, latents) = beside_latents(&world, state.as_deref(), warm_up, || engine.frames(duration))?;
        let [[_, alone_99, _], [_, beside_99, _]] = [&alone, &beside].map(|times| statistics(times));
        let limit = ms(interval);
        parts.push(format!("at {rate} Hz 99 of 100 frames take {alone_99:.1} ms alone and {beside_99:.1} ms beside {latents:.1} latents a second, of {limit:.1} ms"));
        if latents == 0.0 {
            finding.verdict = finding.verdict.max(Verdict::CannotTell);
            finding.remedy = Some("Use an adapter that makes a latent within seconds".to_owned());
        } else if alone_99 <= limit && beside_99 > limit {
            finding.verdict = Verdict::Fail;
            finding.remedy = Some("Fewer latents a second, or a budget: docs/performance.md".to_owned());
        }
        finding = finding
            .figures(figures_of(&format!("{rate} Hz, alone"), &alone))
            .figures(figures_of(&format!("{rate} Hz, beside latents"), &beside))
            .figure(format!("{rate} Hz, latents"), latents, "a second");
        // Nor would there be one at the next rate.
        if latents == 0.0 {
            break;
        }
    }
    finding.sentence = format!("A synthetic engine: {}", parts.join("; "));
    Ok(settings.about_times(&gpu, finding))
}

/// After `warm_up` latents, calls `frames` while a rollout makes latents at its rate, or as fast as it can; also returns the latents a second.
fn beside_latents(
    world: &Arc<World>,
    state: Option<&[u8]>,
    warm_up: u64,
    frames: impl FnOnce() -> Vec<f64>,
) -> Result<(Vec<f64>, f64), Finding> {
    let mut rollout = seed::begin(world, state)?;
    seed::walk(&mut rollout, 0..warm_up)?;
    let (is_over, steps) = (AtomicBool::new(false), AtomicU64::new(0));
    std::thread::scope(|scope| {
        let stepping = scope.spawn(|| -> cairn::Result<()> {
            let interval = Duration::from_secs(1) / RATE;
            let mut due = Instant::now();
            while !is_over.load(Ordering::Relaxed) {
                rollout.step(&ControlInput::default())?;
                steps.fetch_add(1, Ordering::Relaxed);
                due = (due + interval).max(Instant::now());
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
            Ok(())
        });
        let start = Instant::now();
        let times = frames();
        let rate = steps.load(Ordering::Relaxed) as f64 / start.elapsed().as_secs_f64();
        is_over.store(true, Ordering::Relaxed);
        match stepping.join() {
            Ok(ended) => ended?,
            Err(_) => return Err(Finding::fail("The rollout's thread ended", DRIVER)),
        }
        Ok((times, rate))
    })
}

/// A picture of the place at the size of frames, for the window.
pub(super) fn place_at(size: (u32, u32), shift: u32) -> cairn::Result<Picture> {
    let place = seed::place()?;
    let mut picture = Picture::new(size.0, size.1)?;
    for (i, pixel) in (0_u32..).zip(picture.pixels_mut()) {
        let (x, y) = ((i % size.0 + shift) % size.0, i / size.0);
        let (x, y) = (x * place.width() / size.0, y * place.height() / size.1);
        *pixel = place.pixels()[(y * place.width() + x) as usize];
    }
    Ok(picture)
}
