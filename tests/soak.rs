//! A long rollout: the process does not grow after the warm-up.
#![cfg(target_os = "linux")] // The process's size is read where Linux shows it.

mod common;
use common::{controls, point, seeded, world};

/// More than one wrap of both rings; later latents do the same work.
const WARM_UP: u64 = 80;

/// Allowed drift of the C library's arenas; a leak of 2 KiB per latent exceeds it within 2,000 latents.
const DRIFT: u64 = 2 << 20;

/// `cargo xtask test --thorough` asks for 2,000.
fn latents() -> u64 {
    std::env::var("CAIRN_SOAK_LATENTS").map_or(100, |text| text.parse().expect("CAIRN_SOAK_LATENTS is a number"))
}

/// Resident memory of this process in bytes.
fn resident() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").expect("the process's status");
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its resident size");
    line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("a number") * 1024
}

#[test]
fn a_long_rollout_is_flat() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 1);
    for i in 0..WARM_UP {
        rollout.step(&controls(i)).expect("a step");
    }
    let memory = resident();
    for i in WARM_UP..WARM_UP + latents() {
        rollout.step(&controls(i)).expect("a step");
    }
    let grown = resident().saturating_sub(memory);
    assert!(grown <= DRIFT, "{grown} bytes in {} latents", latents());
}
