//! Worlds on DirectML: the CPU provider's numbers, the same bits again, and a saved state that goes on. On Windows, or in the lab.
#![cfg(windows)]

use std::sync::Arc;

use cairn::bundle::Precision;
use cairn::gpu::Gpu;
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{Rollout, World, WorldOptions};

mod common;
use common::{bundle, controls, fingerprint, ort, point, seeded};

fn directml(precision: Precision) -> Arc<World> {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let device = Device::directml(&ort(), &gpu, DirectMlOptions { deterministic: true }).expect("DirectML");
    assert!(device.describe().contains("DirectML on"), "{}", device.describe());
    load(&device, precision)
}

fn load(device: &Device, precision: Precision) -> Arc<World> {
    let options = WorldOptions { precision: Some(precision), ..WorldOptions::default() };
    World::load(device, &bundle("tiny"), options).expect("a world")
}

/// The first latent of a rollout.
fn latent(world: &Arc<World>) -> Vec<f32> {
    let mut rollout = seeded(world, &point(world), 7);
    steps(&mut rollout, 0..1);
    rollout.latent().expect("a latent").to_vec()
}

fn steps(rollout: &mut Rollout, range: std::ops::Range<u64>) {
    for i in range {
        rollout.step(&controls(i)).expect("a step");
    }
}

/// Relative error in the L2 norm.
fn error(found: &[f32], truth: &[f32]) -> f64 {
    let square = |v: f32| f64::from(v) * f64::from(v);
    let apart: f64 = found.iter().zip(truth).map(|(a, b)| square(a - b)).sum();
    (apart / truth.iter().map(|v| square(*v)).sum::<f64>()).sqrt()
}

#[test]
fn a_latent_is_the_cpu_provider_s() {
    for (precision, bound) in [(Precision::F32, 1e-4), (Precision::F16, 1e-2)] {
        let truth = latent(&load(&common::device(), precision));
        let found = latent(&directml(precision));
        let error = error(&found, &truth);
        assert!(error <= bound, "{precision:?}: a relative error of {error:e}");
        assert!(error > 0.0, "{precision:?}: the two do not compute alike to the last bit, so one of them did not run");
    }
}

#[test]
fn the_same_rollout_has_the_same_bits_and_goes_on_from_a_saved_state() {
    let world = directml(Precision::F16);
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
