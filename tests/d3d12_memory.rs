//! Memory of a Direct3D 12 device runs out, at each allocation in turn: the creating call fails with a typed error and leaks nothing, existing
//! objects keep working, and the next attempt succeeds. On Windows, or in the lab.
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

/// Makes every `stride`-th allocation of `act` fail in turn, until `act` makes no more; returns a lower bound of their number.
fn walk<T>(stride: usize, act: impl Fn() -> Result<T>) -> u64 {
    for n in (1..).step_by(stride) {
        faults::fail_at(n);
        let result = act();
        let is_left = faults::is_left();
        match result {
            Ok(_) if is_left => return n - 1,
            // The caller had an alternative: DirectML's pools allocate a larger or a smaller piece.
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

    // Devices and command rings: all allocations of this library itself.
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

    // A rollout, which this library allocates, and its steps, in which ONNX Runtime allocates as well.
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
        // The first step primes the decoder, which writes exactly the memories under test.
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

/// Makes the allocations of `act` fail in turn, once or all from there on, with pools as they are and with pools that have nothing
/// free. After each failure the rollout must be unchanged. At the end `act` succeeds.
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
                // The caller had an alternative, or there are fewer allocations.
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
