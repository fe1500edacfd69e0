//! Memory of a Direct3D 12 device runs out, at each allocation in turn: what is made fails with a typed error and leaves nothing, what
//! was there goes on, and the next try works. On Windows, or in the lab.
#![cfg(windows)]

use cairn::bundle::Precision;
use cairn::gpu::Gpu;
use cairn::gpu::compute::CommandRing;
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{Rollout, World, WorldOptions};
use cairn::{ErrorKind, Result};

mod common;
use common::{bundle, controls, fingerprint, ort, picture, point};
#[path = "d3d12/engine.rs"]
#[allow(dead_code, reason = "each test program uses its part")]
mod engine;
use engine::{Engine, comes_back, engine, references};
#[path = "d3d12/faults.rs"]
mod faults;
#[path = "d3d12/tables.rs"]
mod tables;

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
        CommandRing::new(&gpu, gpu.frames(), 8)
    });
    assert!(count > 6, "{count} allocations make a ring");
    comes_back(|| held(&engine), before);
    let count = walk(1, || Device::directml(&ort(), &gpu(&engine)?, DirectMlOptions::default()));
    assert!(count > 4, "{count} allocations make a device for worlds");
    comes_back(|| held(&engine), before);

    // A rollout, which is ours, and its steps, in which ONNX Runtime allocates as well.
    {
        let options = DirectMlOptions { deterministic: true, ..DirectMlOptions::default() };
        let gpu = gpu(&engine).expect("a device");
        faults::watch(&gpu);
        let device = Device::directml(&ort(), &gpu, options).expect("DirectML");
        let options = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
        let world = World::load(&device, &bundle("tiny"), options).expect("a world");
        let count = walk(3, || Rollout::new(&world, &point(&world), 7));
        assert!(count > 50, "{count} allocations make a rollout");

        let mut rollout = Rollout::new(&world, &point(&world), 7).expect("a rollout");
        let mut untroubled = Rollout::new(&world, &point(&world), 7).expect("a rollout");
        // The first one primes the decoder, which writes the very memories that count.
        let seed = picture(40, 22, 9);
        hold_out(&mut rollout, |rollout| rollout.append(&seed));
        untroubled.append(&seed).expect("a seed");
        for i in 0..2 {
            hold_out(&mut rollout, |rollout| rollout.step(&controls(i)));
            untroubled.step(&controls(i)).expect("a step");
        }
        assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut untroubled).expect("bits"));
        let saved = rollout.save().expect("a state");
        hold_out(&mut rollout, Rollout::reset);
        hold_out(&mut rollout, |rollout| rollout.restore(&saved));
        assert!(rollout.save().expect("a state") == saved);
    }
    comes_back(|| held(&engine), before);
}

/// Lets the allocations of `act` fail in turn, once or from there on, with pools as they happen to be and with none that has
/// anything free; whenever it fails, the rollout is what it was. Then `act` is done.
fn hold_out<T>(rollout: &mut Rollout, act: impl Fn(&mut Rollout) -> Result<T>) {
    let before = rollout.save().expect("a state");
    for (stands, lasts) in [(true, false), (true, true), (false, false)] {
        for n in 1.. {
            faults::time_stands(stands);
            if lasts {
                faults::fail_from(n)
            } else {
                faults::fail_at(n)
            }
            let result = act(rollout).map(drop);
            let is_left = faults::is_left();
            faults::time_stands(false);
            match &result {
                // Who asked has another way, or nobody asked for so many.
                Ok(()) => rollout.restore(&before).expect("the state fits"),
                Err(error) => assert!(!is_left, "allocation {n} did not fail: {error}"),
            }
            let how = format!("allocation {n}, time stands: {stands}, for good: {lasts}");
            assert!(rollout.save().expect("a state") == before, "{how}, left a trace: {result:?}");
            if is_left {
                println!("{} allocations; time stands: {stands}", n - 1);
                break;
            }
        }
    }
    act(rollout).expect("all goes on");
}
