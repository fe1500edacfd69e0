//! The measurements.

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use cairn::bundle::{Bundle, LayerKind, Precision};
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_UNORDERED_ACCESS;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_R8G8B8A8_UNORM;
use cairn::runtime::{Device, DirectMlOptions, Ort};
use cairn::world::{
    CacheMode, ControlInput, DeviceTimes, OperatingPoint, Preset, Rollout, Schedule, World, WorldOptions,
};
use cairn::{LibrarySearch, Picture};

use gpu_testing::blend::Blend;
use test_support::d3d12::resources::{self, TestResource, upload_texture, writable_texture};

/// Steps before the measurement, in which passes are captured and verified.
const WARM_UP: u64 = 4;
const STEPS: u64 = 12;
/// Frames of the engine, and the number of two-texture blends in each.
const FRAMES: usize = 100;
const BLENDS: usize = 4;
const SIZE: (u32, u32) = (1280, 720);

type Result<T, E = Box<dyn Error>> = std::result::Result<T, E>;

pub(crate) fn run() -> Result<()> {
    let ort = Ort::find(&LibrarySearch::for_tools())?;
    let folder = std::env::var_os("CAIRN_TEST_BUNDLE").map(PathBuf::from);
    let folder = folder.ok_or("CAIRN_TEST_BUNDLE names no folder with the test worlds: cargo xtask bench sets it")?;
    let bundle = Bundle::open(&folder.join("tiny"))?;
    let gpu = Gpu::on_adapter(None)?;
    let device = Device::directml(&ort, &gpu, DirectMlOptions::default())?;
    println!("{}", device.describe());
    for (name, options) in [
        ("passes run anew", DirectMlOptions::default()),
        ("captured passes", DirectMlOptions { captured_passes: 16, ..DirectMlOptions::default() }),
    ] {
        device.set_directml_options(options.clone())?;
        let load = |slices| {
            let precision = Some(Precision::F16);
            World::load(&device, &bundle, WorldOptions { precision, slices, ..WorldOptions::default() })
        };
        let world = load(None)?;
        println!("\n{name}: {world:?}");
        step_costs(&world)?;
        drop(world);
        let engine = Engine::new(&gpu);
        engine.frames();
        let slices = [1, 4, bundle.geometry().layers];
        for slices in slices.into_iter().take(if options.captured_passes == 0 { 3 } else { 1 }) {
            // One world at a time: a session takes gigabytes where the processor emulates the device.
            frame_times_beside_rollout(&engine, &load(Some(slices))?, &options)?;
        }
    }
    Ok(())
}

fn rollout(world: &Arc<World>) -> Result<Rollout> {
    let point = OperatingPoint {
        global_window: world.global_window(),
        schedule: Schedule::Stock,
        cache_mode: CacheMode::Separate,
        latents_per_second: 15,
        pictures_per_latent: 1,
        ..Preset::Decoded60.operating_point()
    };
    let mut rollout = Rollout::new(world, &point, 1)?;
    rollout.append(&Picture::from_rgba(64, 36, vec![128; 64 * 36 * 4])?)?;
    Ok(rollout)
}

/// Measures a latent step's time outside ONNX Runtime, and the bytes that it moves.
fn step_costs(world: &Arc<World>) -> Result<()> {
    let mut rollout = rollout(world)?;
    for _ in 0..WARM_UP {
        rollout.step(&ControlInput::default())?;
    }
    // Waits for all submitted work, so that its device times are complete.
    rollout.latent()?;
    let first = times(&mut rollout)?;
    let (mut took, mut own, mut inside) = (Vec::new(), Vec::new(), Vec::new());
    let (mut ring, mut uploaded, mut copied, mut read, mut lower_bound) = (0, 0, 0, 0, 0);
    for _ in 0..STEPS {
        let commits_global = rollout.planner().plan_step(&ControlInput::default())?.global.slot.is_some();
        let kinds = if commits_global { &LayerKind::ALL[..] } else { &[LayerKind::Local] };
        let before = times(&mut rollout)?.external;
        let start = Instant::now();
        let made = rollout.step(&ControlInput::default())?;
        took.push(start.elapsed());
        let after = times(&mut rollout)?.external;
        let (inside_now, waited) =
            (after.in_onnxruntime - before.in_onnxruntime, after.waiting_for_device - before.waiting_for_device);
        own.push(took[took.len() - 1].saturating_sub(inside_now).saturating_sub(waited));
        inside.push(inside_now);
        ring += made.ring_bytes;
        (uploaded, copied, read) = (uploaded + made.bytes.uploaded, copied + made.bytes.copied, read + made.bytes.read);
        lower_bound += world.slab_bytes(kinds);
    }
    rollout.latent()?;
    let last = times(&mut rollout)?;
    // Medians, because a device that the processor emulates sometimes takes processor time during a call.
    let [took, own, inside] = [took, own, inside].map(median);
    let on_device = last.passes.total - first.passes.total + last.decode.total - first.decode.total;
    let on_device = on_device / STEPS as u32;
    let of = |whole: Duration| 100.0 * own.as_secs_f64() / whole.as_secs_f64();
    println!("  a latent step                              {:>10.2} ms", ms(took));
    println!("  of it inside ONNX Runtime's calls          {:>10.2} ms", ms(inside));
    println!("  its passes on the device, by its clock     {:>10.2} ms", ms(on_device));
    println!("  the library's own time                     {:>10.3} ms", ms(own));
    // Calls may return when the work is submitted, or wait until it is done.
    println!("  of ONNX Runtime's, calls or passes (aim: 3 %) {:>7.2} %", of(inside.max(on_device)));
    println!("  of its calls alone                         {:>10.2} %", of(inside));
    println!(
        "  into the ring, of the new K and V          {:>10} bytes, {:.3}",
        ring / STEPS,
        ring as f64 / lower_bound as f64
    );
    println!("  copied besides: latents, noise levels      {:>10} bytes", (copied - ring) / STEPS);
    println!("  up: noise, angles, masks, controls         {:>10} bytes", uploaded / STEPS);
    println!("  down                                       {:>10} bytes", read / STEPS);
    println!("  {:?}", rollout.capture_statistics().ok_or("no Direct3D 12 device")?);
    Ok(())
}

fn times(rollout: &mut Rollout) -> Result<DeviceTimes> {
    rollout.device_times().ok_or_else(|| "no Direct3D 12 device".into())
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort();
    times[times.len() / 2]
}

/// An engine whose frames blend two textures.
struct Engine<'a> {
    gpu: &'a Gpu,
    blend: Blend,
    /// What the blends read and write.
    _textures: [TestResource; 3],
}

impl<'a> Engine<'a> {
    fn new(gpu: &'a Gpu) -> Self {
        let pixels = vec![127; SIZE.0 as usize * SIZE.1 as usize * 4];
        let [before, after] = [(); 2].map(|()| upload_texture(gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, &pixels));
        let out = writable_texture(gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
        let blend = Blend::new(gpu, [&before, &after, &out], SIZE);
        Self { gpu, blend, _textures: [before, after, out] }
    }

    /// Times of frames that follow each other: the median, and the times that 90 and 99 of 100 stay within.
    fn frames(&self) -> [Duration; 3] {
        let frame = |_| {
            let start = Instant::now();
            resources::run_list(self.gpu, |list| (0..BLENDS).for_each(|_| self.blend.record(list)));
            start.elapsed()
        };
        let mut times: Vec<_> = (0..FRAMES).map(frame).collect();
        times.sort();
        [times[FRAMES / 2], times[FRAMES * 9 / 10], times[FRAMES * 99 / 100]]
    }
}

/// Measures an engine's frames while a rollout makes latents, relative to those just before: without a limit on queued work, and with one.
fn frame_times_beside_rollout(engine: &Engine<'_>, world: &Arc<World>, options: &DirectMlOptions) -> Result<()> {
    for longest_submission in [None, Some(Duration::from_millis(1))] {
        world.device().set_directml_options(DirectMlOptions { longest_submission, ..options.clone() })?;
        let mut rollout = rollout(world)?;
        for _ in 0..WARM_UP {
            rollout.step(&ControlInput::default())?;
        }
        rollout.latent()?;
        let alone = engine.frames();
        let (over, steps) = (AtomicBool::new(false), AtomicU64::new(0));
        let with_rollout = std::thread::scope(|scope| {
            let stepping = scope.spawn(|| {
                while !over.load(Ordering::Relaxed) {
                    rollout.step(&ControlInput::default()).map_err(|e| e.to_string())?;
                    steps.fetch_add(1, Ordering::Relaxed);
                }
                Ok::<(), String>(())
            });
            let start = Instant::now();
            let with_rollout = engine.frames();
            let took = start.elapsed();
            over.store(true, Ordering::Relaxed);
            stepping.join().map_err(|_| "the rollout's thread ended".to_owned())??;
            Ok::<_, String>((with_rollout, took))
        });
        let (with_rollout, took) = with_rollout?;
        let [half, most, nearly_all] = std::array::from_fn(|i| with_rollout[i].as_secs_f64() / alone[i].as_secs_f64());
        let (slices, longest) = (world.slices(), ms(times(&mut rollout)?.passes.longest));
        let name = if longest_submission.is_some() { "yielding after 1 ms" } else { "as they come" };
        let rate = steps.load(Ordering::Relaxed) as f64 / took.as_secs_f64();
        println!(
            "  beside latents in {slices} slices, {name:<20} {half:>6.2} x, {most:.2} x, {nearly_all:.2} x; \
             {rate:.2} latents a second, the longest slice {longest:.2} ms"
        );
    }
    world.device().set_directml_options(options.clone())?;
    Ok(())
}

fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}
