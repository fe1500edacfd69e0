//! Removal of the device and recovery from it, and many devices one after the other.

use std::time::{Duration, Instant};

use cairn::bundle::Precision;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface as _;
use cairn::runtime::{Device, DirectMlOptions, Ort};
use cairn::{ErrorKind, Result};
use gpu_testing::engine::{Engine, reference_count};
use gpu_testing::memory::memory;
use gpu_testing::system_calls;

use super::{DRIVER, Settings, seed, world};
use crate::finding::{Checked, Finding};

/// Growth of the process in a turn, beyond that of the same system calls, that still passes, in bytes.
const GROWTH: i64 = 1 << 20;
/// The lives are split into turns: drivers' caches grow at times of their own, and so disturb a turn or two. A leak shows in every turn.
const TURNS: i64 = 5;
/// Lives before memory is measured.
const WARM_UP: i64 = 2;
/// Time for a driver's threads to let go of an engine's objects.
const PATIENCE: Duration = Duration::from_secs(30);

/// Removes a device: executing a list that is still open does that.
fn remove(gpu: &Gpu) -> Result<()> {
    let kind = gpu.frames().kind();
    // SAFETY: a live device.
    let allocator: ID3D12CommandAllocator =
        unsafe { gpu.device().CreateCommandAllocator(kind) }.expect("a command allocator");
    // SAFETY: a live device and allocator.
    let list: ID3D12GraphicsCommandList =
        unsafe { gpu.device().CreateCommandList(0, kind, &allocator, None) }.expect("a command list");
    gpu.frames().submit(&[list.cast().expect("a command list")]).map(|_| ())
}

fn reference_counts(engine: &Engine) -> [u32; 3] {
    [reference_count(&engine.device), reference_count(&engine.direct), reference_count(&engine.compute)]
}

/// Whether the counts come back.
fn come_back(engine: &Engine, wanted: [u32; 3]) -> bool {
    let start = Instant::now();
    while reference_counts(engine) != wanted {
        if start.elapsed() > PATIENCE {
            return false;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    true
}

/// A rollout's device is removed; a new one works.
pub(super) fn removal(settings: &Settings) -> Checked {
    let state = world::starting_state(settings)?;
    let ort = Ort::find(&settings.libraries())?;
    let adapter = settings.gpu()?.luid();
    let engine = Engine::of(&Gpu::on_adapter(Some(adapter))?);
    let before = reference_counts(&engine);
    {
        let gpu = Gpu::of_engine(&engine.device, &engine.direct, Some(&engine.compute))?;
        let device = Device::directml(&ort, &gpu, DirectMlOptions::default())?;
        let world = seed::world(&device, Precision::F16)?;
        let mut rollout = seed::begin(&world, state.as_deref())?;
        seed::walk(&mut rollout, 0..1)?;
        let removed = remove(&gpu);
        if !removed.as_ref().is_err_and(|e| e.kind() == ErrorKind::DeviceRemoved) {
            return Ok(Finding::cannot_tell(
                "The device was not removed by a command list that was executed while open",
                "Nothing: this driver cannot be made to lose its device so",
            ));
        }
        for (what, result) in [("a step", seed::walk(&mut rollout, 1..2)), ("a state", rollout.save().map(drop))] {
            match result {
                Err(e) if e.kind() == ErrorKind::DeviceRemoved => {}
                Err(e) => {
                    return Ok(Finding::fail(format!("After the device was removed, {what} fails with {e}"), DRIVER));
                }
                Ok(()) => {
                    return Ok(Finding::fail(format!("After the device was removed, {what} still succeeds"), DRIVER));
                }
            }
        }
    }
    let are_released = come_back(&engine, before);
    drop(engine);
    let again = Device::directml(&ort, &Gpu::on_adapter(Some(adapter))?, DirectMlOptions::default())?;
    let mut rollout = seed::begin(&seed::world(&again, Precision::F16)?, state.as_deref())?;
    seed::walk(&mut rollout, 0..1)?;
    Ok(Finding::judge(
        are_released,
        if are_released {
            "A device was removed under a rollout: each call said so, all of the engine's objects were released, and a new device made a latent"
        } else {
            "After the device was removed, references to the engine's objects remain"
        },
        DRIVER,
    ))
}

/// A device with DirectML and its shaders, made and released.
fn create_device(ort: &Ort, engine: &Engine) -> Result<()> {
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, Some(&engine.compute))?;
    let device = Device::directml(ort, &gpu, DirectMlOptions::default())?;
    gpu.anchors().signal()?.wait()?;
    drop(device);
    Ok(())
}

/// A world on such a device, with a rollout that makes a latent.
fn use_world(ort: &Ort, engine: &Engine, state: Option<&[u8]>) -> std::result::Result<(), Finding> {
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, Some(&engine.compute))?;
    let device = Device::directml(ort, &gpu, DirectMlOptions::default())?;
    let mut rollout = seed::begin(&seed::world(&device, Precision::F16)?, state)?;
    Ok(seed::walk(&mut rollout, 0..1)?)
}

/// Devices one after the other on one engine's device, in turn with the same system calls without Cairn: drivers keep memory of both.
pub(super) fn lives(settings: &Settings) -> Checked {
    let count = if settings.quick { 20 } else { 200 } / TURNS;
    let state = world::starting_state(settings)?;
    let ort = Ort::find(&settings.libraries())?;
    let engine = Engine::of(&settings.gpu()?);
    // Drivers keep some objects from the first work on.
    if !settings.quick {
        use_world(&ort, &engine, state.as_deref())?;
    }
    let before = reference_counts(&engine);
    let released = |what: &str| -> std::result::Result<(), Finding> {
        let remain =
            || Finding::fail(format!("After {what} was released, references to the engine's objects remain"), DRIVER);
        come_back(&engine, before).then_some(()).ok_or_else(remain)
    };
    let own = |count: i64| -> std::result::Result<i64, Finding> {
        let start = memory().private;
        for _ in 0..count {
            create_device(&ort, &engine)?;
            released("a device")?;
        }
        Ok(memory().private - start)
    };
    let system = |count: i64| -> std::result::Result<i64, Finding> {
        let start = memory().private;
        for _ in 0..count {
            system_calls::ALL.iter().for_each(|part| part.create_and_release(&engine));
            released("what the same system calls made")?;
        }
        Ok(memory().private - start)
    };
    own(WARM_UP)?;
    system(WARM_UP)?;
    let began = Instant::now();
    let mut beyond = Vec::new();
    for _ in 0..TURNS {
        let (own, system) = (own(count)?, system(count)?);
        // A turn in which the memory without Cairn shrinks does not require Cairn's to shrink too.
        beyond.push(own - system.max(0) * 5 / 4);
    }
    let took = began.elapsed();
    use_world(&ort, &engine, state.as_deref())?;
    released("a world")?;
    beyond.sort_unstable();
    let grown = beyond[beyond.len() / 2];
    let sentence = format!(
        "{} devices with DirectML and {} were made and released: each gave all of the engine's objects back, and {count} of them leave {} KiB more in the \
         process than the same system calls without Cairn (at most {} KiB)",
        TURNS * count,
        if settings.quick { "a world" } else { "two worlds" },
        grown.max(0) >> 10,
        GROWTH >> 10
    );
    Ok(Finding::judge(grown <= GROWTH, sentence, DRIVER)
        .figure("growth of the process per life, beyond the system's own", grown as f64 / count as f64 / 1024.0, "KiB")
        .figure("a life, and the same system calls", 1e3 * took.as_secs_f64() / (TURNS * count) as f64, "ms"))
}
