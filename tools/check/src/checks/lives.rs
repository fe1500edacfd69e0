//! Removal of the device and recovery from it, and many devices one after the other.

use std::time::{Duration, Instant};

use cairn::bundle::Precision;
use cairn::framegen::shader::ShaderGenerator;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface as _;
use cairn::runtime::{Device, DirectMlOptions, Ort};
use cairn::{ErrorKind, Result};
use gpu_testing::engine::{Engine, reference_count};

use super::{DRIVER, Settings, seed};
use crate::finding::{Checked, Finding};

/// Growth of the process's private memory per life that still passes, in bytes: a driver's caches grow too.
const GROWTH: i64 = 256 << 10;
/// Lives before memory is measured.
const WARM_UP: u64 = 10;
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
    let ort = Ort::find(&settings.libraries())?;
    let adapter = settings.gpu()?.luid();
    let engine = Engine::of(&Gpu::on_adapter(Some(adapter))?);
    let before = reference_counts(&engine);
    {
        let gpu = Gpu::of_engine(&engine.device, &engine.direct, Some(&engine.compute))?;
        let device = Device::directml(&ort, &gpu, DirectMlOptions::default())?;
        let world = seed::world(&device, Precision::F16)?;
        let mut rollout = seed::rollout(&world)?;
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
    let mut rollout = seed::rollout(&seed::world(&again, Precision::F16)?)?;
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

/// Private memory of this process in bytes.
fn private_memory() -> i64 {
    #[repr(C)]
    #[derive(Default)]
    struct Counters {
        size: u32,
        page_faults: u32,
        peak_working_set: usize,
        working_set: usize,
        pools: [usize; 4],
        page_file: usize,
        peak_page_file: usize,
    }
    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn GetCurrentProcess() -> *mut std::ffi::c_void;
        fn K32GetProcessMemoryInfo(process: *mut std::ffi::c_void, counters: *mut Counters, size: u32) -> i32;
    }
    let mut counters = Counters { size: size_of::<Counters>() as u32, ..Counters::default() };
    // SAFETY: the process's own handle, and a struct of the given size.
    unsafe { K32GetProcessMemoryInfo(GetCurrentProcess(), &mut counters, size_of::<Counters>() as u32) };
    counters.page_file.cast_signed() as i64
}

/// Devices with their shaders, one after the other, on one engine's device; two of them with a world.
pub(super) fn lives(settings: &Settings) -> Checked {
    let count = if settings.quick { 30 } else { 200 };
    let ort = Ort::find(&settings.libraries())?;
    let engine = Engine::of(&settings.gpu()?);
    let life = |with_world: bool| -> std::result::Result<(), Finding> {
        let gpu = Gpu::of_engine(&engine.device, &engine.direct, Some(&engine.compute))?;
        let device = Device::directml(&ort, &gpu, DirectMlOptions::default())?;
        ShaderGenerator::new(&gpu, (96, 64))?;
        gpu_testing::resize::compare(&gpu);
        if with_world {
            let mut rollout = seed::rollout(&seed::world(&device, Precision::F16)?)?;
            seed::walk(&mut rollout, 0..1)?;
        }
        Ok(())
    };
    // The first of each kind makes what the driver keeps.
    life(true)?;
    let before = reference_counts(&engine);
    let (mut start, mut used) = (0, None);
    let began = Instant::now();
    for number in 0..count {
        life(number == count / 2)?;
        if !come_back(&engine, before) {
            return Ok(Finding::fail(format!("After life {number} references to the engine's objects remain"), DRIVER));
        }
        if number == WARM_UP {
            start = private_memory();
            used = settings.gpu()?.budget()?.map(|budget| budget.used);
        }
    }
    let lives = count - WARM_UP - 1;
    let grown = (private_memory() - start) / lives as i64;
    let video = match (used, settings.gpu()?.budget()?) {
        (Some(before), Some(now)) => Some((now.used as f64 - before as f64) / lives as f64 / 1024.0),
        _ => None,
    };
    let sentence = format!(
        "{count} devices with shaders and DirectML, and a world, were made and released: each gave all of the engine's objects back, and the process grew by {} KiB \
         per life (at most {} KiB)",
        grown >> 10,
        GROWTH >> 10
    );
    let mut finding = Finding::judge(grown <= GROWTH, sentence, DRIVER)
        .figure("growth of the process per life", grown as f64 / 1024.0, "KiB")
        .figure("a life", 1e3 * began.elapsed().as_secs_f64() / count as f64, "ms");
    if let Some(video) = video {
        finding = finding.figure("growth of the adapter's memory per life", video, "KiB");
    }
    Ok(finding)
}
