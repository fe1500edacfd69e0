//! Worlds and rollouts of the test bundles, on the processor or on Direct3D 12. They need ONNX Runtime and the test bundles, which
//! `cargo xtask setup` makes, and fail without them.

use std::path::PathBuf;
use std::sync::Arc;

use cairn::bundle::{Bundle, Precision, Processor};
use cairn::runtime::{CpuOptions, Device, Ort, WebGpuOptions};
use cairn::world::{
    CacheMode, ControlInput, Key, KeySet, OperatingPoint, Preset, Rollout, Schedule, World, WorldOptions,
};
use cairn::{LibrarySearch, Picture, Result};

/// ONNX Runtime, found as the library finds it for tools.
pub fn ort() -> Ort {
    Ort::find(&LibrarySearch::for_tools()).unwrap_or_else(|e| panic!("this test runs a world: {e}"))
}

/// The test bundle `name`: in the folder `CAIRN_TEST_BUNDLE` if that is set, else the one that `cargo xtask setup` keeps in the user's cache.
pub fn bundle(name: &str) -> Arc<Bundle> {
    let path = bundle_path(name);
    Bundle::open(&path).unwrap_or_else(|e| panic!("{}: {e}; run `cargo xtask setup`", path.display()))
}

/// Path of the test bundle `name`.
pub fn bundle_path(name: &str) -> PathBuf {
    match std::env::var_os("CAIRN_TEST_BUNDLE").filter(|v| !v.is_empty()) {
        Some(folder) => PathBuf::from(folder).join(name),
        None => provision::bundle(name, &provision::Silent)
            .unwrap_or_else(|e| panic!("this test runs a bundle that `cargo xtask setup` makes: {e}")),
    }
}

/// The processor with two threads, so that results do not depend on the machine's number of cores. If `CAIRN_TEST_DEVICE` is `webgpu`, the
/// adapter of [`webgpu`]; on Windows, if it is `d3d12`, a Direct3D 12 adapter.
pub fn device() -> Device {
    if std::env::var_os("CAIRN_TEST_DEVICE").is_some_and(|name| name == "webgpu") {
        return webgpu();
    }
    #[cfg(windows)]
    if std::env::var_os("CAIRN_TEST_DEVICE").is_some_and(|name| name == "d3d12") {
        let gpu = cairn::gpu::Gpu::on_adapter(None).expect("an adapter");
        let options = cairn::runtime::DirectMlOptions { deterministic: true, ..Default::default() };
        return Device::directml(&ort(), &gpu, options).expect("DirectML");
    }
    Device::cpu(&ort(), CpuOptions { threads: Some(2), deterministic: true }).expect("a CPU device")
}

/// The adapter that the lab's driver emulates, or the one that `CAIRN_TEST_ADAPTER` names, by the WebGPU provider.
pub fn webgpu() -> Device {
    let adapter = std::env::var("CAIRN_TEST_ADAPTER").unwrap_or_else(|_| "llvmpipe".to_owned());
    let options = WebGpuOptions { deterministic: true, adapter: Some(adapter), ..WebGpuOptions::default() };
    Device::webgpu(&ort(), &options).expect("an adapter, and the plugin beside ONNX Runtime")
}

/// The kind of processor whose figures of [`Bundle::memory_need`] hold on `device`.
pub fn processor(device: &Device) -> Processor {
    if device.is_gpu() { Processor::Gpu } else { Processor::Cpu }
}

/// The world of the test bundle `name` at its default window, in single precision on every device.
pub fn world(name: &str) -> Arc<World> {
    let options = WorldOptions { precision: Some(Precision::F32), ..WorldOptions::default() };
    World::load(&device(), &bundle(name), options).expect("a world")
}

/// An operating point of four passes and one picture per latent, at the world's own window.
pub fn point(world: &World) -> OperatingPoint {
    OperatingPoint {
        global_window: world.global_window(),
        schedule: Schedule::Stock,
        cache_mode: CacheMode::Separate,
        latents_per_second: 15,
        pictures_per_latent: 1,
        ..Preset::Decoded60.operating_point()
    }
}

/// A rollout to which a seed picture is appended.
pub fn seeded(world: &Arc<World>, point: &OperatingPoint, seed: u64) -> Rollout {
    let mut rollout = Rollout::new(world, point, seed).expect("a rollout");
    rollout.append(&picture(40, 30, 1)).expect("a seed");
    rollout
}

/// A picture with a pattern in every channel, which depends on `kind`.
pub fn picture(width: u32, height: u32, kind: u32) -> Picture {
    let mut picture = Picture::new(width, height).expect("a picture");
    for (i, pixel) in (0u32..).zip(picture.pixels_mut()) {
        let (x, y) = (i % width, i / width);
        *pixel = [(x * 255 / width) as u8, (y * 255 / height) as u8, ((x ^ y) * 8 * kind) as u8, 255];
    }
    picture
}

/// The first frame of a walk through the desert's level, under the sky, at 320 x 180 pixels: a seed for the embedded world.
pub fn desert_picture() -> Picture {
    let file = include_bytes!("../../../samples/worlds/place.ppm");
    let pixels = file.strip_prefix(b"P6\n320 180\n255\n").expect("a PPM of that size");
    Picture::from_rgba(320, 180, pixels.chunks_exact(3).flat_map(|px| [px[0], px[1], px[2], 255]).collect())
        .expect("a picture")
}

/// Controls of step `i`, which differ from step to step.
pub fn controls(i: u64) -> ControlInput {
    let mut keys = KeySet::NONE;
    keys.insert(Key(65 + (i % 20) as u8));
    ControlInput::new([i as f32 * 0.5 - 3.0, -(i as f32)], keys, i as f32 - 2.0).expect("controls")
}

/// Relative error in the L2 norm.
pub fn relative_error(found: &[f32], truth: &[f32]) -> f64 {
    let square = |v: f32| f64::from(v) * f64::from(v);
    let apart: f64 = found.iter().zip(truth).map(|(a, b)| square(a - b)).sum();
    (apart / truth.iter().map(|v| square(*v)).sum::<f64>()).sqrt()
}

/// The bits of a rollout: its saved state, its latent and its pictures.
pub fn fingerprint(rollout: &mut Rollout) -> Result<Vec<u8>> {
    let mut all = rollout.save()?;
    all.extend(rollout.latent()?.iter().flat_map(|v| v.to_bits().to_le_bytes()));
    let mut picture = Picture::new(1, 1)?;
    for i in 0..rollout.operating_point().pictures_per_latent {
        rollout.read_picture(i, &mut picture)?;
        all.extend_from_slice(picture.rgba());
    }
    Ok(all)
}
