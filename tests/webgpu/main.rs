//! Worlds on ONNX Runtime's WebGPU provider give the CPU provider's results, repeat bit for bit, continue from saved states of any device, and
//! report every non-finite number. On Linux with a graphics adapter, or in the lab: `cargo xtask test webgpu`.
#![cfg(target_os = "linux")]

use std::sync::Arc;

use cairn::bundle::Precision;
use cairn::runtime::{Device, WebGpuOptions};
use cairn::world::{Rollout, World, WorldOptions};
use test_support::worlds::{self, bundle, controls, fingerprint, ort, point, seeded};

fn webgpu() -> Device {
    let options = WebGpuOptions { deterministic: true, adapter: Some("llvmpipe".to_owned()) };
    Device::webgpu(&ort(), &options).expect("an adapter, and the plugin beside ONNX Runtime")
}

fn load(device: &Device, name: &str, precision: Precision) -> Arc<World> {
    let options = WorldOptions { precision: Some(precision), ..WorldOptions::default() };
    World::load(device, &bundle(name), options).expect("a world")
}

fn steps(rollout: &mut Rollout, range: std::ops::Range<u64>) {
    for i in range {
        let info = rollout.step(&controls(i)).expect("a step");
        assert_eq!((info.bytes.read, info.bytes.uploaded > 0), (0, true), "a step reads nothing back");
    }
}

/// The first latent of a rollout.
fn latent(world: &Arc<World>) -> Vec<f32> {
    let mut rollout = seeded(world, &point(world), 7);
    steps(&mut rollout, 0..1);
    rollout.latent().expect("a latent").to_vec()
}

/// Relative error in the L2 norm.
fn error(found: &[f32], truth: &[f32]) -> f64 {
    let square = |v: f32| f64::from(v) * f64::from(v);
    let apart: f64 = found.iter().zip(truth).map(|(a, b)| square(a - b)).sum();
    (apart / truth.iter().map(|v| square(*v)).sum::<f64>()).sqrt()
}

#[test]
fn a_latent_equals_the_cpu_providers() {
    for (precision, bound) in [(Precision::F32, 1e-4), (Precision::F16, 1e-2)] {
        let truth = latent(&load(&worlds::device(), "tiny", precision));
        let found = latent(&load(&webgpu(), "tiny", precision));
        let error = error(&found, &truth);
        println!("{precision:?}: a relative error of {error:e}");
        assert!(error <= bound, "{precision:?}: a relative error of {error:e}");
        assert!(error > 0.0, "{precision:?}: equal bits mean that one of the providers did not run");
    }
}

#[test]
fn a_rollout_repeats_bit_for_bit_also_from_a_saved_state() {
    let world = load(&webgpu(), "tiny", Precision::F16);
    let bits = |rollout: &mut Rollout| fingerprint(rollout).expect("bits");
    let mut first = seeded(&world, &point(&world), 7);
    steps(&mut first, 0..1);
    let saved = first.save().expect("a state");
    steps(&mut first, 1..3);

    let mut again = seeded(&world, &point(&world), 7);
    steps(&mut again, 0..3);
    assert!(bits(&mut first) == bits(&mut again), "the same again");

    let mut restored = Rollout::new(&world, &point(&world), 1).expect("a rollout");
    restored.restore(&saved).expect("the state fits");
    steps(&mut restored, 1..3);
    assert!(bits(&mut first) == bits(&mut restored), "the state holds everything");
}
