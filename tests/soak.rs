//! A long rollout: the process does not grow after the warm-up.
#![cfg(target_os = "linux")] // The process's size is read from Linux's file system `/proc`.

use test_support::process::resident_memory;
use test_support::worlds::{controls, point, seeded, world};

/// More than one wrap of both rings; later latents do the same work.
const WARM_UP: u64 = 80;

/// Allowed drift of the C library's arenas; a leak of 2 KiB per latent exceeds it within 2,000 latents.
const DRIFT: u64 = 2 << 20;

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
    let memory = resident_memory();
    for i in WARM_UP..WARM_UP + latents() {
        rollout.step(&controls(i)).expect("a step");
    }
    let grown = resident_memory().saturating_sub(memory);
    assert!(grown <= DRIFT, "{grown} bytes in {} latents", latents());
}
