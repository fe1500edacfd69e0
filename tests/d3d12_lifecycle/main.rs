//! Devices and worlds on Direct3D 12 release everything when they are destroyed, also if the device is removed at any stage. On Windows, or in
//! the lab.
#![cfg(windows)]

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use cairn::bundle::{Bundle, Precision};
use cairn::gpu::Gpu;
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{Rollout, World, WorldOptions};
use cairn::{ErrorKind, Picture, Result};
use gpu_testing::memory::{Memory, memory};
use gpu_testing::system_calls;
use test_support::d3d12::buffers::List;
use test_support::d3d12::engine::{Engine, reference_count, wait_for_counts};
use test_support::worlds::{bundle, controls, ort, picture, point, seeded};

/// Allowed growth of Cairn's part of the process in the median of [`TURNS`].
const DRIFT: i64 = 1 << 20;
/// The device cycles are split into turns: drivers' caches grow by megabytes at unpredictable times, and so disturb a turn or two. A leak shows
/// in every turn.
const TURNS: u64 = 5;
/// Allowed growth over all world cycles after the first ones: there are no sessions without Cairn to compare with.
const DRIFT_OF_WORLDS: i64 = 24 << 20;
/// Allowed growth of all resident memory, including an emulated device's and mapped files: the system keeps as much of the latter in RAM
/// as it likes. One leaked world is more than this.
const DRIFT_OF_ALL: i64 = 256 << 20;
/// Cycles before measuring.
const WARM_UP: u64 = 2;

/// The number of cycles: `few`, or the value of the variable `name`.
fn cycles(name: &str, few: u64) -> u64 {
    std::env::var(name).map_or(few, |text| text.parse().expect("a number of cycles"))
}

/// One test at a time: they measure the memory of the process.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A Cairn device on an engine's device, for worlds.
fn device(engine: &Engine) -> Result<Device> {
    device_with(engine, DirectMlOptions::default())
}

fn device_with(engine: &Engine, options: DirectMlOptions) -> Result<Device> {
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, Some(&engine.compute))?;
    Device::directml(&ort(), &gpu, options)
}

fn options() -> WorldOptions {
    WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() }
}

/// References to the engine's objects.
fn reference_counts(engine: &Engine) -> [u32; 3] {
    [reference_count(&engine.device), reference_count(&engine.direct), reference_count(&engine.compute)]
}

/// The growth of the process over `count` calls of `cycle`; references to the engine's objects must be `counts_before` after each.
fn growth(engine: &Engine, counts_before: [u32; 3], count: u64, cycle: impl Fn(&Engine)) -> Memory {
    let before = memory();
    for _ in 0..count {
        cycle(engine);
        wait_for_counts(|| reference_counts(engine), counts_before);
    }
    let after = memory();
    Memory { private: after.private - before.private, resident: after.resident - before.resident }
}

/// Creates and drops a Cairn device.
fn create_device(engine: &Engine) {
    let device = device(engine).expect("a device");
    let fence_point = device.gpu().expect("a Direct3D 12 device").anchors().signal().expect("a fence point");
    fence_point.wait().expect("nothing was to be done");
}

/// A software device leaks something with each creating call, also without Cairn: only Cairn's additional growth counts.
#[test]
fn devices_leak_no_more_than_the_same_system_calls_without_cairn() {
    let _alone = alone();
    let engine = Engine::create();
    let make_system_calls = |engine: &Engine| system_calls::ALL.iter().for_each(|part| part.create_and_release(engine));
    let count = cycles("CAIRN_DEVICE_CYCLES", 15).div_ceil(TURNS);
    let before = reference_counts(&engine);
    growth(&engine, before, WARM_UP, create_device);
    growth(&engine, before, WARM_UP, make_system_calls);
    // Alternating, so that one-time growth affects both.
    let turn = |_| {
        [create_device as fn(&Engine), make_system_calls].map(|cycle| growth(&engine, before, count, cycle).private)
    };
    let mut turns: Vec<[i64; 2]> = (0..TURNS).map(turn).collect();
    println!("bytes in {count} cycles of a device, and without Cairn: {turns:?}");
    // A turn in which the memory without Cairn shrinks does not require ours to shrink too.
    let beyond = |[ours, others]: &[i64; 2]| ours - others.max(&0) * 5 / 4;
    turns.sort_by_key(beyond);
    assert!(beyond(&turns[turns.len() / 2]) <= DRIFT, "bytes in {count} cycles, and without Cairn: {turns:?}");
}

#[test]
fn loading_worlds_repeatedly_uses_constant_memory() {
    let _alone = alone();
    let (engine, bundle) = (Engine::create(), bundle("tiny"));
    let cycle = |engine: &Engine| {
        let world = World::load(&device(engine).expect("a device"), &bundle, options()).expect("a world");
        let mut rollout = seeded(&world, &point(&world), 1);
        rollout.step(&controls(0)).expect("a step");
    };
    let before = reference_counts(&engine);
    growth(&engine, before, WARM_UP, cycle);
    let count = cycles("CAIRN_WORLD_CYCLES", 1);
    let growth = growth(&engine, before, count, cycle);
    println!("{count} cycles of a world: {growth:?}");
    assert!(growth.private <= DRIFT_OF_WORLDS, "{growth:?} in {count} cycles of a world");
    assert!(growth.resident <= DRIFT_OF_ALL, "{growth:?} in {count} cycles of a world");
}

/// Removes the device: executing a list that is still open does that.
fn remove(gpu: &Gpu) {
    let open = List::new(gpu.device(), gpu.frames().kind());
    let gone = gpu.frames().submit(&[open.still_open()]).expect_err("the device is gone");
    assert_eq!(gone.kind(), ErrorKind::DeviceRemoved, "{gone}");
}

/// Checks that a call fails since the device is removed.
fn gone<T>(stage: &str, result: Result<T>) {
    let error = result.err().unwrap_or_else(|| panic!("{stage} works on a device that is gone"));
    assert_eq!(error.kind(), ErrorKind::DeviceRemoved, "{stage}: {error}");
}

/// Loads a world whose device is removed before its `stage`-th session is made; 3 is after the last.
fn load_and_remove(engine: &Engine, bundle: &Arc<Bundle>, stage: u64) -> Result<Arc<World>> {
    let device = device(engine).expect("a device");
    let calls = AtomicU64::new(0);
    World::load_with(&device, bundle, options(), &|_| {
        if calls.fetch_add(1, Ordering::Relaxed) == stage {
            remove(device.gpu().expect("a Direct3D 12 device"));
        }
        Ok(())
    })
}

#[test]
fn a_device_may_be_removed_while_a_world_is_loaded() {
    let _alone = alone();
    let bundle = bundle("tiny");
    for stage in 0..=3 {
        let engine = Engine::create();
        let before = reference_counts(&engine);
        match load_and_remove(&engine, &bundle, stage) {
            Ok(world) => {
                assert_eq!(stage, 3, "a session was made on a device that is gone");
                gone("a rollout", Rollout::new(&world, &point(&world), 1));
            }
            failed => gone("loading", failed),
        }
        gone("another device", device(&engine));
        wait_for_counts(|| reference_counts(&engine), before);
    }
}

#[test]
fn a_device_may_be_removed_between_the_calls_of_a_rollout() {
    let _alone = alone();
    let engine = Engine::create();
    let before = reference_counts(&engine);
    {
        let world = World::load(&device(&engine).expect("a device"), &bundle("tiny"), options()).expect("a world");
        let mut rollout = seeded(&world, &point(&world), 1);
        rollout.step(&controls(0)).expect("a step");
        let saved = rollout.save().expect("a state");
        remove(world.device().gpu().expect("a Direct3D 12 device"));
        gone("a step", rollout.step(&controls(1)));
        gone("an append", rollout.append(&picture(8, 8, 1)));
        gone("a picture", rollout.read_picture(0, &mut Picture::new(1, 1).expect("a picture")));
        gone("a state", rollout.save());
        gone("restoring a state", rollout.restore(&saved));
        gone("another rollout", Rollout::new(&world, &point(&world), 1));
    }
    wait_for_counts(|| reference_counts(&engine), before);
    // A new device of the same adapter works.
    let world =
        World::load(&device(&Engine::create()).expect("a device"), &bundle("tiny"), options()).expect("a world");
    seeded(&world, &point(&world), 1).step(&controls(0)).expect("a step");
}

/// Removes the device during the step after `steps` more, or shortly before or after it. Returns the error of the step that fails.
fn removed_while_stepping(rollout: &mut Rollout, steps: u64) -> cairn::Error {
    let world = rollout.world().clone();
    let stepping = AtomicU64::new(0);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while stepping.load(Ordering::Relaxed) < steps {
                std::thread::yield_now();
            }
            remove(world.device().gpu().expect("a Direct3D 12 device"));
        });
        let step = |i| {
            stepping.store(i, Ordering::Relaxed);
            rollout.step(&controls(i)).err()
        };
        (0_u64..).find_map(step).expect("the device is removed")
    })
}

#[test]
fn a_device_may_be_removed_while_a_rollout_steps() {
    let _alone = alone();
    let engine = Engine::create();
    let before = reference_counts(&engine);
    {
        let world = World::load(&device(&engine).expect("a device"), &bundle("tiny"), options()).expect("a world");
        let mut rollout = seeded(&world, &point(&world), 1);
        let ended = removed_while_stepping(&mut rollout, 2);
        assert_eq!(ended.kind(), ErrorKind::DeviceRemoved, "{ended}");
    }
    wait_for_counts(|| reference_counts(&engine), before);
}

#[test]
fn a_device_may_be_removed_while_passes_are_captured_and_replayed() {
    let _alone = alone();
    let captured = || DirectMlOptions { captured_passes: 16, ..DirectMlOptions::default() };
    let load = |engine: &Engine| {
        let device = device_with(engine, captured()).expect("a device");
        let world = World::load(&device, &bundle("tiny"), options()).expect("a world");
        let rollout = seeded(&world, &point(&world), 1);
        (world, rollout)
    };
    // Once while captured passes are being verified, and once when only captured passes run.
    for steps in [0, 4] {
        let engine = Engine::create();
        let before = reference_counts(&engine);
        {
            let (world, mut rollout) = load(&engine);
            (0..steps).for_each(|i| _ = rollout.step(&controls(i)).expect("a step"));
            let captures = rollout.capture_statistics().expect("a Direct3D 12 device");
            assert!(
                captures.unused == 0 && captures.unproven > 0 && (captures.used >= 4) == (steps > 0),
                "{captures:?}"
            );
            let ended = removed_while_stepping(&mut rollout, 1);
            assert_eq!(ended.kind(), ErrorKind::DeviceRemoved, "{ended}");
            gone("a step", rollout.step(&controls(1)));
            gone("an append", rollout.append(&picture(8, 8, 1)));
            gone("a state", rollout.save());
            gone("another rollout", Rollout::new(&world, &point(&world), 1));
        }
        wait_for_counts(|| reference_counts(&engine), before);
    }
    // Capturing works on a new device of the same adapter.
    let engine = Engine::create();
    let before = reference_counts(&engine);
    {
        let (_world, mut rollout) = load(&engine);
        (0..4).for_each(|i| _ = rollout.step(&controls(i)).expect("a step"));
        let captures = rollout.capture_statistics().expect("a Direct3D 12 device");
        assert!(captures.used > 0 && captures.unused == 0, "{captures:?}");
    }
    wait_for_counts(|| reference_counts(&engine), before);
}
