//! A long rollout: no window of latents after the warm-up leaves memory behind.
#![cfg(target_os = "linux")] // The process's size is read from Linux's file system `/proc`.

use cairn::runtime::DeviceKind;
use test_support::process::MemoryBounds;
use test_support::worlds::{controls, point, seeded, world};

/// More than one wrap of both rings; later latents do the same work.
const WARM_UP: u64 = 80;

const BOUNDS: MemoryBounds = MemoryBounds { window: 50, heap_per_item: 200, resident_per_window: 512 << 10 };

/// In 1,200 latents by the WebGPU provider the heap went up and down by 35 KB, and once by 148 KB more.
const BOUNDS_OF_WEBGPU: MemoryBounds = MemoryBounds { window: 20, heap_per_item: 200, resident_per_window: 64 << 10 };

/// `cargo xtask test --thorough` asks for 2,000.
fn latents() -> u64 {
    std::env::var("CAIRN_SOAK_LATENTS").map_or(100, |text| text.parse().expect("CAIRN_SOAK_LATENTS is a number"))
}

#[test]
fn a_long_rollout_uses_constant_memory() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 1);
    for i in 0..WARM_UP {
        rollout.step(&controls(i)).expect("a step");
    }
    let range = WARM_UP..WARM_UP + latents();
    let step = |i| {
        rollout.step(&controls(i)).expect("a step");
    };
    let (bounds, windows) = if world.device().kind() == DeviceKind::WebGpu {
        (BOUNDS_OF_WEBGPU, BOUNDS_OF_WEBGPU.check_median(range, step))
    } else {
        (BOUNDS, BOUNDS.check(range, step))
    };
    println!("growth of heap and resident memory in each {} latents: {windows:?}", bounds.window);
}
