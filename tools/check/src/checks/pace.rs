//! A latent's time by stage, memory against the budget, and an engine's frames while latents are made.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::runtime::DirectMlOptions;
use cairn::world::{ControlInput, Rollout};
use cairn::{Error, ErrorKind, Result};

use super::adapters::gpu;
use super::clock::{Clock, Times};
use super::directml::{device, load};
use super::processor::seeded;
use super::resources::{TestResource, run_list, writable_texture};
use super::times::{Show, sizes};
use crate::outcome::{Better, Outcome};
use crate::settings::Settings;

/// Steps that are not counted: captured passes are proven in them.
const WARM_UP: u32 = 4;
/// Latents per second of the world's own time.
const LATENTS_PER_SECOND: f64 = 15.0;

/// Options of a game: captured passes, and passes that leave the queue to frames every 4 ms.
fn options() -> DirectMlOptions {
    DirectMlOptions {
        captured_passes: 16,
        longest_submission: Some(Duration::from_millis(4)),
        ..DirectMlOptions::default()
    }
}

/// Time of a latent by stage, by the GPU's clock.
pub(super) fn latent(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let world = load(&device(&gpu, options())?, None)?;
    let mut rollout = seeded(&world)?;
    for _ in 0..WARM_UP {
        rollout.step(&ControlInput::default())?;
    }
    rollout.latent()?;
    let times = |rollout: &mut Rollout| {
        let missing = || Error::new(ErrorKind::Unsupported, "the device has no clock").remedy("Update the driver");
        rollout.device_times().ok_or_else(missing)
    };
    let before = times(&mut rollout)?;
    let number = settings.pick(30, 2);
    let mut wall = Vec::new();
    for _ in 0..number {
        let began = Instant::now();
        rollout.step(&ControlInput::default())?;
        // Waits for the device.
        rollout.latent()?;
        wall.push(1e3 * began.elapsed().as_secs_f64());
    }
    // Waits for the commit of the last step too.
    rollout.save()?;
    let after = times(&mut rollout)?;
    let stages = [
        ("passes", after.passes.total - before.passes.total, after.passes.frames - before.passes.frames),
        ("decoder", after.decode.total - before.decode.total, after.decode.frames - before.decode.frames),
        ("commit", after.commit.total - before.commit.total, after.commit.frames - before.commit.frames),
    ];
    let each = |total: Duration| 1e3 * total.as_secs_f64() / f64::from(number);
    let sum: f64 = stages.iter().map(|(_, total, _)| each(*total)).sum();
    let wall = Times::new(wall);
    let real_time = 1e3 / LATENTS_PER_SECOND;
    let found = format!("a latent of the embedded world takes {sum:.2} ms of the GPU, {:.2} ms in all", wall.median);
    let outcome = if sum <= 0.0 {
        Outcome::cannot_tell("the GPU's clock stood still", "Update the graphics driver")
    } else if settings.short || wall.median <= real_time {
        Outcome::pass(found)
    } else {
        Outcome::fail(
            format!("{found}, which is longer than the {real_time:.1} ms of the world's own time"),
            "Close other programs that use the GPU, or use a faster adapter",
        )
    };
    let outcome = stages.into_iter().fold(outcome, |outcome, (name, total, runs)| {
        outcome.figure(format!("{name}, of the GPU"), each(total), "ms", Better::Lower).figure(
            format!("{name}, runs"),
            runs as f64 / f64::from(number),
            "a latent",
            Better::Neither,
        )
    });
    let captured = rollout.capture_statistics().unwrap_or_default();
    Ok(outcome
        .figure("longest pass, of the GPU", 1e3 * after.passes.longest.as_secs_f64(), "ms", Better::Lower)
        .with_figures(wall.figures("latent, in all"))
        .fact("captured passes", captured.used.to_string()))
}

/// Memory of the presenter at the largest size and of the embedded world, against the budget.
pub(super) fn memory(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let budget = || {
        gpu.budget()?.ok_or_else(|| {
            Error::new(ErrorKind::Unsupported, "the system does not report the adapter's memory")
                .remedy("Use Windows 10 or 11 with the driver of the graphics card's maker")
        })
    };
    let empty = budget()?;
    let (size, name) = sizes(settings).pop().expect("there is a size");
    let mut show = Show::new(&gpu, size, |_| Ok(()))?;
    show.frame()?;
    let with_frames = budget()?;
    let world = load(&device(&gpu, options())?, None)?;
    let mut rollout = seeded(&world)?;
    rollout.step(&ControlInput::default())?;
    rollout.latent()?;
    let all = budget()?;
    let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let found = format!(
        "{:.0} MiB of {:.0} MiB are in use with frames at {name} and the embedded world",
        mebibytes(all.used),
        mebibytes(all.granted)
    );
    let outcome = if all.used <= all.granted {
        Outcome::pass(found)
    } else {
        Outcome::fail(found, "Close other programs that use the GPU, or use frames of a smaller size")
    };
    let grown = |from: u64, to: u64| mebibytes(to.saturating_sub(from));
    Ok(outcome
        .figure("budget", mebibytes(all.granted), "MiB", Better::Neither)
        .figure(format!("frames at {name}"), grown(empty.used, with_frames.used), "MiB", Better::Lower)
        .figure("world and rollout", grown(with_frames.used, all.used), "MiB", Better::Lower))
}

/// Rates of the engine's frames, per second.
const RATES: [u32; 2] = [60, 120];
/// Part of a frame's time that the engine itself uses the GPU for.
const ENGINE_PART: f64 = 0.4;
/// Size of the textures that the engine copies.
const COPIED: (u32, u32) = (1920, 1080);

/// An engine's own work on the GPU: copies of a texture, as many as fill a given time.
struct EngineWork {
    textures: [TestResource; 2],
    copies: u32,
}

impl EngineWork {
    /// Work of about that time in milliseconds.
    fn new(gpu: &Gpu, clock: &Clock, time: f64) -> Result<Self> {
        const MEASURED: u32 = 16;
        let states = [D3D12_RESOURCE_STATE_COPY_SOURCE, D3D12_RESOURCE_STATE_COPY_DEST];
        let textures = states.map(|state| writable_texture(gpu, COPIED, DXGI_FORMAT_R8G8B8A8_UNORM, state));
        let mut work = Self { textures, copies: MEASURED };
        let mut took = Vec::new();
        for _ in 0..5 {
            took.push(clock.time(gpu, |list| {
                work.record(list);
                Ok(())
            })?);
        }
        let each = Times::new(took).median / f64::from(MEASURED);
        work.copies = (time / each.max(1e-4)).clamp(1.0, 10_000.0) as u32;
        Ok(work)
    }

    fn record(&self, list: &ID3D12GraphicsCommandList) {
        let [from, to] = &self.textures;
        for _ in 0..self.copies {
            // SAFETY: an open list; both textures live until it has run, and are in the states for it.
            unsafe { list.CopyResource(&to.resource, &from.resource) };
        }
    }
}

/// Frames of an engine at 60 and 120 Hz, without and with latents at the same time: from the start of a frame until the GPU is done.
pub(super) fn engine(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let clock = Clock::new(&gpu)?;
    let world = load(&device(&gpu, options())?, None)?;
    let mut rollout = seeded(&world)?;
    for _ in 0..WARM_UP {
        rollout.step(&ControlInput::default())?;
    }
    rollout.latent()?;
    let (size, name) = sizes(settings)[0];
    let mut show = Show::new(&gpu, size, |_| Ok(()))?;
    for _ in 0..8 {
        show.frame()?;
    }
    let mut outcome = Outcome::pass(format!("an engine's frames at {name} keep their rate while latents are made"));
    for rate in RATES {
        let interval = Duration::from_secs(1) / rate;
        let work = EngineWork::new(&gpu, &clock, 1e3 * interval.as_secs_f64() * ENGINE_PART)?;
        let frames = rate * settings.pick(5, 1) / settings.pick(1, 10);
        let alone = run_frames(&gpu, &mut show, &work, interval, frames)?;
        let stop = AtomicBool::new(false);
        let (beside, latents) = std::thread::scope(|scope| {
            let made = scope.spawn(|| make_latents(&mut rollout, &stop));
            let frames = run_frames(&gpu, &mut show, &work, interval, frames);
            stop.store(true, Ordering::Relaxed);
            (frames, made.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
        let (beside, latents) = (beside?, latents?);
        let limit = 1e3 * interval.as_secs_f64();
        if !settings.short && outcome.verdict == crate::verdict::Verdict::Pass {
            let judged = if alone.percentile_99 > limit {
                Some(Outcome::cannot_tell(
                    format!("at {rate} Hz the engine's frames do not keep their rate even without latents"),
                    "Close other programs that use the GPU and run this again on mains power",
                ))
            } else if beside.percentile_99 > limit {
                Some(Outcome::fail(
                    format!(
                        "at {rate} Hz latents delay an engine's frames: the 99th percentile is {:.2} ms, and {:.2} ms without",
                        beside.percentile_99, alone.percentile_99
                    ),
                    "Update the graphics driver; if it stays, report it with this page",
                ))
            } else {
                None
            };
            if let Some(judged) = judged {
                outcome = Outcome { figures: outcome.figures, ..judged };
            }
        }
        outcome = outcome
            .with_figures(alone.figures(&format!("{rate} Hz, without latents")))
            .with_figures(beside.figures(&format!("{rate} Hz, with latents")))
            .figure(format!("{rate} Hz, latents"), f64::from(latents), "made", Better::Neither);
    }
    Ok(outcome)
}

/// Makes frames at their rate; the times are from the start of each until the GPU is done.
fn run_frames(gpu: &Gpu, show: &mut Show, work: &EngineWork, interval: Duration, frames: u32) -> Result<Times> {
    let mut times = Vec::new();
    let mut due = Instant::now();
    for _ in 0..frames.max(1) {
        sleep_until(due);
        let began = Instant::now();
        submit(gpu, work)?;
        show.frame()?;
        times.push(1e3 * began.elapsed().as_secs_f64());
        // A frame that was late does not make the next ones early.
        due = (due + interval).max(Instant::now());
    }
    Ok(Times::new(times))
}

fn submit(gpu: &Gpu, work: &EngineWork) -> Result<()> {
    run_list(gpu, |list| work.record(list));
    Ok(())
}

/// Sleeps most of the time and then spins: the system's timer is too coarse for 120 Hz.
fn sleep_until(due: Instant) {
    const COARSE: Duration = Duration::from_millis(2);
    std::thread::sleep(due.saturating_duration_since(Instant::now()).saturating_sub(COARSE));
    while Instant::now() < due {
        std::hint::spin_loop();
    }
}

/// Makes latents at the world's own rate until it is to stop; returns how many.
fn make_latents(rollout: &mut Rollout, stop: &AtomicBool) -> Result<u32> {
    let interval = Duration::from_secs_f64(1.0 / LATENTS_PER_SECOND);
    let mut due = Instant::now();
    let mut made = 0;
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        rollout.step(&ControlInput::default())?;
        made += 1;
        due = (due + interval).max(Instant::now());
    }
    rollout.latent()?;
    Ok(made)
}
