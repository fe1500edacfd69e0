//! Memory of a Direct3D 12 device runs out, at each allocation in turn: what is made fails with a typed error and leaves nothing, what
//! was there goes on, and the next try works. On Windows, or in the lab.
#![cfg(windows)]

use cairn::bundle::Precision;
use cairn::gpu::Gpu;
use cairn::gpu::compute::Frames;
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{Rollout, World, WorldOptions};
use cairn::{ErrorKind, Result};

mod common;
use common::{bundle, controls, fingerprint, ort, point, seeded};
#[path = "d3d12/engine.rs"]
mod engine;
use engine::{Engine, comes_back, engine, references};
#[path = "d3d12/faults.rs"]
mod faults;

/// References to the engine's objects.
fn held(engine: &Engine) -> [u32; 3] {
    [references(&engine.device), references(&engine.direct), references(&engine.compute)]
}

/// Lets the allocations of `act` fail in turn, every `stride`-th of them, until it gets through; how many there were at least.
fn walk<T>(stride: usize, act: impl Fn() -> Result<T>) -> u64 {
    for n in (1..).step_by(stride) {
        faults::fail_at(n);
        let result = act();
        let is_left = faults::is_left();
        match result {
            Ok(_) if is_left => return n - 1,
            // Who asked has another way: DirectML's pools take a larger or a smaller piece.
            Ok(_) => {}
            Err(error) => {
                assert!(!is_left, "allocation {n} did not fail: {error}");
                let is_typed =
                    matches!(error.kind(), ErrorKind::OutOfMemory | ErrorKind::Device | ErrorKind::Unsupported);
                assert!(is_typed && !error.to_string().is_empty(), "allocation {n}: {error}");
            }
        }
    }
    unreachable!("the walk ends when the act gets through")
}

fn gpu(engine: &Engine) -> Result<Gpu> {
    Gpu::of_engine(&engine.device, &engine.direct, None)
}

#[test]
fn memory_runs_out_at_each_allocation() {
    let engine = engine();
    faults::install(&engine.device);
    let before = held(&engine);

    // Devices and rings of frames: all that this library asks for itself.
    let count = walk(1, || gpu(&engine));
    assert!(count >= 3, "{count} allocations make a device");
    comes_back(|| held(&engine), before);
    let count = walk(1, || {
        let gpu = gpu(&engine)?;
        Frames::new(&gpu, gpu.frames(), 8)
    });
    assert!(count > 6, "{count} allocations make a ring");
    comes_back(|| held(&engine), before);
    let count = walk(1, || Device::directml(&ort(), &gpu(&engine)?, DirectMlOptions::default()));
    assert!(count > 4, "{count} allocations make a device for worlds");
    comes_back(|| held(&engine), before);

    // A rollout, which is ours, and its steps, in which ONNX Runtime allocates as well.
    {
        let options = DirectMlOptions { deterministic: true, ..DirectMlOptions::default() };
        let device = Device::directml(&ort(), &gpu(&engine).expect("a device"), options).expect("DirectML");
        let options = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
        let world = World::load(&device, &bundle("tiny"), options).expect("a world");
        let count = walk(3, || Rollout::new(&world, &point(&world), 7));
        assert!(count > 50, "{count} allocations make a rollout");

        let mut rollout = seeded(&world, &point(&world), 7);
        let mut untroubled = seeded(&world, &point(&world), 7);
        rollout.step(&controls(0)).expect("a step");
        untroubled.step(&controls(0)).expect("a step");
        let saved = rollout.save().expect("a state");
        for n in 1..=4 {
            faults::fail_at(n);
            let result = rollout.step(&controls(1));
            faults::fail_at(0);
            if result.is_ok() {
                rollout.restore(&saved).expect("the state fits");
            }
            assert!(rollout.save().expect("a state") == saved, "allocation {n} left a trace: {result:?}");
        }
        rollout.step(&controls(1)).expect("a step");
        untroubled.step(&controls(1)).expect("a step");
        assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut untroubled).expect("bits"));
    }
    comes_back(|| held(&engine), before);
}
