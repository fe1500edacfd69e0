//! Devices and worlds on Direct3D 12 come and go, and nothing of them stays. On Windows, or in the lab.
#![cfg(windows)]

use std::sync::{Mutex, PoisonError};

use cairn::Result;
use cairn::bundle::Precision;
use cairn::gpu::Gpu;
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{World, WorldOptions};

mod common;
use common::{bundle, controls, ort, point, seeded};
#[path = "d3d12/engine.rs"]
mod engine;
use engine::{Engine, comes_back, references};

/// What the process may grow by in the few cycles of every run: a world that stayed would be more. In the lab each life of a
/// device leaves some 250 KB behind, ours or the driver's, so many lives need more room.
const DRIFT: u64 = 24 << 20;

/// How many cycles: the few of every run, or as many as the variable `name` asks for.
fn cycles(name: &str, few: u64) -> u64 {
    std::env::var(name).map_or(few, |text| text.parse().expect("a number of cycles"))
}

/// Memory of this process that is in RAM, in bytes.
fn resident() -> u64 {
    #[repr(C)]
    #[derive(Default)]
    struct Counters {
        size: u32,
        page_faults: u32,
        peak_working_set: usize,
        working_set: usize,
        others: [usize; 6],
    }
    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn GetCurrentProcess() -> *mut std::ffi::c_void;
        fn K32GetProcessMemoryInfo(process: *mut std::ffi::c_void, counters: *mut Counters, size: u32) -> i32;
    }
    let mut counters = Counters { size: size_of::<Counters>() as u32, ..Counters::default() };
    // SAFETY: the process's own handle, and a struct of the size told.
    let told = unsafe { K32GetProcessMemoryInfo(GetCurrentProcess(), &mut counters, size_of::<Counters>() as u32) };
    assert!(told != 0 && counters.working_set > 0, "the process's size is known");
    counters.working_set as u64
}

/// The library's view of an engine's device, for worlds.
fn device(engine: &Engine) -> Result<Device> {
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, Some(&engine.compute))?;
    Device::directml(&ort(), &gpu, DirectMlOptions::default())
}

fn options() -> WorldOptions {
    WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() }
}

/// References to the engine's objects.
fn held(engine: &Engine) -> [u32; 3] {
    [references(&engine.device), references(&engine.direct), references(&engine.compute)]
}

/// Does `cycle` for an engine's objects so many times; their references come back each time, and no life stays in memory.
fn come_and_go(count: u64, cycle: impl Fn(&Engine)) {
    const WARM_UP: u64 = 2;
    // One test at a time: the process's memory is all of theirs.
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let engine = engine::engine();
    let before = held(&engine);
    let mut memory = 0;
    for i in 0..count + WARM_UP {
        if i == WARM_UP {
            memory = resident();
        }
        cycle(&engine);
        comes_back(|| held(&engine), before);
    }
    let grown = resident().saturating_sub(memory);
    println!("{count} cycles: {memory} bytes, then {grown} more");
    assert!(grown <= DRIFT, "{grown} bytes in {count} cycles");
}

#[test]
fn devices_come_and_go_and_give_back_what_they_held() {
    come_and_go(cycles("CAIRN_DEVICE_CYCLES", 10), |engine| {
        let device = device(engine).expect("a device");
        let moment = device.gpu().expect("a Direct3D 12 device").anchors().now().expect("a moment");
        moment.wait().expect("nothing was to be done");
    });
}

#[test]
fn worlds_come_and_go_and_give_back_what_they_held() {
    let bundle = bundle("tiny");
    come_and_go(cycles("CAIRN_WORLD_CYCLES", 1), |engine| {
        let world = World::load(&device(engine).expect("a device"), &bundle, options()).expect("a world");
        let mut rollout = seeded(&world, &point(&world), 1);
        rollout.step(&controls(0)).expect("a step");
    });
}
