//! Each allocation of memory on a Direct3D 12 device fails in turn: the creating call returns a typed error and leaks nothing, existing
//! objects keep working, and the next attempt succeeds. On Windows, or in the lab.
#![cfg(windows)]

use cairn::bundle::Precision;
use cairn::gpu::Gpu;
use cairn::gpu::compute::CommandRing;
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{Rollout, World, WorldOptions};
use cairn::{ErrorKind, Result};
use test_support::d3d12::engine::{Engine, reference_count, wait_for_counts};
use test_support::worlds::{bundle, controls, fingerprint, ort, picture, point};

mod faults;

/// References to the engine's objects.
fn references(engine: &Engine) -> [u32; 3] {
    [reference_count(&engine.device), reference_count(&engine.direct), reference_count(&engine.compute)]
}

/// Makes every `stride`-th allocation of `act` fail in turn until `act` succeeds without a failure. Returns a lower bound of the number of
/// allocations.
fn fail_each_allocation<T>(stride: usize, act: impl Fn() -> Result<T>) -> u64 {
    for n in (1..).step_by(stride) {
        faults::fail_at(n);
        let result = act();
        let none_failed = faults::stop();
        match result {
            Ok(_) if none_failed => return n - 1,
            // The caller had an alternative: DirectML's pools allocate a larger or a smaller piece.
            Ok(_) => {}
            Err(error) => {
                assert!(!none_failed, "allocation {n} did not fail: {error}");
                let is_typed =
                    matches!(error.kind(), ErrorKind::OutOfMemory | ErrorKind::Device | ErrorKind::Unsupported);
                assert!(is_typed && !error.to_string().is_empty(), "allocation {n}: {error}");
            }
        }
    }
    unreachable!("the loop ends when no allocation fails")
}

fn gpu(engine: &Engine) -> Result<Gpu> {
    Gpu::of_engine(&engine.device, &engine.direct, None)
}

#[test]
fn each_allocation_may_fail() {
    let engine = Engine::create();
    faults::install(&engine.device);
    let before = references(&engine);

    // Devices and command rings: all allocations of this library itself.
    let count = fail_each_allocation(1, || gpu(&engine));
    assert!(count >= 3, "{count} allocations make a device");
    wait_for_counts(|| references(&engine), before);
    let count = fail_each_allocation(1, || {
        let gpu = gpu(&engine)?;
        CommandRing::new(&gpu, gpu.frames(), 8)
    });
    assert!(count > 6, "{count} allocations make a ring");
    wait_for_counts(|| references(&engine), before);
    let count = fail_each_allocation(1, || Device::directml(&ort(), &gpu(&engine)?, DirectMlOptions::default()));
    assert!(count > 4, "{count} allocations make a device for worlds");
    wait_for_counts(|| references(&engine), before);

    // This library allocates a rollout; in its steps ONNX Runtime allocates as well.
    {
        let options = DirectMlOptions { deterministic: true, ..DirectMlOptions::default() };
        let gpu = gpu(&engine).expect("a device");
        faults::watch(&gpu);
        let device = Device::directml(&ort(), &gpu, options).expect("DirectML");
        let options = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
        let world = World::load(&device, &bundle("tiny"), options).expect("a world");
        let count = fail_each_allocation(3, || Rollout::new(&world, &point(&world), 7));
        assert!(count > 50, "{count} allocations make a rollout");

        let mut rollout = Rollout::new(&world, &point(&world), 7).expect("a rollout");
        let mut undisturbed = Rollout::new(&world, &point(&world), 7).expect("a rollout");
        // The first step primes the decoder, which writes exactly the memories under test.
        let seed = picture(40, 22, 9);
        check_failures(&mut rollout, |rollout| rollout.append(&seed));
        undisturbed.append(&seed).expect("a seed");
        for i in 0..2 {
            check_failures(&mut rollout, |rollout| rollout.step(&controls(i)));
            undisturbed.step(&controls(i)).expect("a step");
        }
        assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut undisturbed).expect("bits"));
        let saved = rollout.save().expect("a state");
        check_failures(&mut rollout, Rollout::reset);
        check_failures(&mut rollout, |rollout| rollout.restore(&saved));
        assert!(rollout.save().expect("a state") == saved);
    }
    wait_for_counts(|| references(&engine), before);
}

/// Makes the allocations of `act` fail in turn, once or all from there on, with pools as they are and with pools without free memory. After
/// each failure the rollout must be unchanged. At the end `act` succeeds.
fn check_failures<T>(rollout: &mut Rollout, act: impl Fn(&mut Rollout) -> Result<T>) {
    let before = rollout.save().expect("a state");
    for (hidden, permanent) in [(true, false), (true, true), (false, false)] {
        for n in 1.. {
            faults::hide_completed_work(hidden);
            if permanent {
                faults::fail_from(n)
            } else {
                faults::fail_at(n)
            }
            let result = act(rollout).map(drop);
            let none_failed = faults::stop();
            faults::hide_completed_work(false);
            match &result {
                // The caller had an alternative, or there are fewer allocations.
                Ok(()) => rollout.restore(&before).expect("the state fits"),
                Err(error) => assert!(!none_failed, "allocation {n} did not fail: {error}"),
            }
            let how = format!("allocation {n}, completed work hidden: {hidden}, permanent: {permanent}");
            assert!(rollout.save().expect("a state") == before, "{how}, left a trace: {result:?}");
            if none_failed {
                println!("{} allocations; completed work hidden: {hidden}", n - 1);
                break;
            }
        }
    }
    act(rollout).expect("all goes on");
}
