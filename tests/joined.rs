//! Worlds with joined passes: the numbers are those of separate cache passes but for rounding, states continue with the same bits, and what such
//! worlds cannot do is refused.

use std::sync::Arc;
use std::time::Duration;

use cairn::ErrorKind;
use cairn::bundle::{Passes, Precision};
use cairn::world::{CacheMode, CachePass, OperatingPoint, Rollout, StepInfo, StepPlan, World, WorldOptions};
use test_support::worlds::{bundle, controls, device, fingerprint, picture, point, processor, relative_error, seeded};

/// Steps after which all rings of the test world were overwritten; an emulated graphics device gets fewer.
const STEPS: u64 = 40;
const STEPS_ON_GPU: u64 = 16;

/// Bound of the relative error of a latent, after all steps.
const MAX_ERROR: f64 = 1e-3;

fn load(global_window: Option<u32>, precision: Precision) -> Arc<World> {
    let options = WorldOptions { global_window, precision: Some(precision), joined: true, ..WorldOptions::default() };
    World::load(&device(), &bundle("joined"), options).expect("a world")
}

fn joined(world: &World) -> OperatingPoint {
    OperatingPoint { cache_mode: CacheMode::Joined, ..point(world) }
}

#[test]
fn joined_passes_give_the_latents_of_separate_ones() {
    let world = load(None, Precision::F32);
    let mut rollout = seeded(&world, &joined(&world), 3);
    let mut expected = seeded(&world, &point(&world), 3);
    let mut worst = 0.0_f64;
    let steps = if world.device().is_gpu() { STEPS_ON_GPU } else { STEPS };
    for i in 0..steps {
        let (info, reference) = match i {
            // An append commits the latent before it, too.
            13 => (rollout.append(&picture(20, 10, 2)), expected.append(&picture(20, 10, 2))),
            _ => (rollout.step(&controls(i)), expected.step(&controls(i))),
        };
        let (info, reference) = (info.expect("a step"), reference.expect("a step"));
        assert_eq!((info.latent, info.committed), (reference.latent, true));
        let passes = |info: &StepInfo| (info.stages.denoise.count, info.stages.cache.count);
        assert_eq!(passes(&info), passes(&reference));
        let error = relative_error(rollout.latent().expect("a latent"), expected.latent().expect("a latent"));
        worst = worst.max(error);
        assert!(error < MAX_ERROR, "latent {}: {error}", info.latent);
    }
    println!("the worst of {steps} latents is {worst:e} off");

    let plan = rollout.planner().plan_step(&controls(1)).expect("a plan");
    let latent = rollout.latent().expect("a latent").to_vec();
    let refused = rollout.probe(&plan, 0.5, &latent).expect_err("the ring lacks a latent");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("plan.pending")));

    rollout.reset().expect("a reset");
    expected.reset().expect("a reset");
    for rollout in [&mut rollout, &mut expected] {
        rollout.append(&picture(40, 30, 1)).expect("a seed");
        rollout.step(&controls(1)).expect("a step");
    }
    assert!(relative_error(rollout.latent().expect("one"), expected.latent().expect("one")) < MAX_ERROR);
}

/// The only pass of a step is the joined one, and the ring of a global layer has one slot, which the next latent overwrites.
#[test]
fn one_pass_and_one_slot_are_enough() {
    let world = load(Some(4), Precision::F32);
    let at =
        |cache_mode| OperatingPoint { cache_mode, schedule: "explicit:1:0".parse().expect("one"), ..point(&world) };
    let [mut rollout, mut expected] = [CacheMode::Joined, CacheMode::Separate].map(|mode| seeded(&world, &at(mode), 3));
    for i in 0..12 {
        for rollout in [&mut rollout, &mut expected] {
            rollout.step(&controls(i)).expect("a step");
        }
        let error = relative_error(rollout.latent().expect("one"), expected.latent().expect("one"));
        assert!(error < MAX_ERROR, "step {i}: {error}");
    }
}

#[test]
fn plans_that_would_leave_the_ring_wrong_are_refused() {
    let world = load(None, Precision::F32);
    let mut rollouts = [seeded(&world, &point(&world), 3), seeded(&world, &joined(&world), 3)];
    let altered = |rollout: &Rollout, alter: fn(&mut StepPlan)| {
        let mut plan = rollout.planner().plan_step(&controls(0)).expect("a plan");
        alter(&mut plan);
        plan
    };
    for (which, field, alter) in [
        (0, "plan.cache", (|plan| plan.cache = CachePass::Deferred) as fn(&mut StepPlan)),
        (1, "plan.cache", |plan| plan.cache = CachePass::Fused),
        (1, "plan.cache", |plan| plan.cache = CachePass::Separate),
        (1, "plan.pending", |plan| plan.pending = None),
        (1, "plan.pending", |plan| plan.pending.as_mut().expect("one").local.slot = Some(3)),
    ] {
        let rollout = &mut rollouts[which];
        let before = rollout.save().expect("a state");
        let plan = altered(rollout, alter);
        let error = rollout.execute(&plan).expect_err("refused");
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
        assert!(rollout.save().expect("a state") == before);
    }
    // A latent that is not committed at all is possible.
    let [_, mut rollout] = rollouts;
    let plan = altered(&rollout, |plan| plan.cache = CachePass::Skip);
    rollout.execute(&plan).expect("a step");
    let plan = rollout.planner().plan_step(&controls(1)).expect("a plan");
    assert_eq!(plan.pending, None);
    rollout.execute(&plan).expect("a step");
}

#[test]
fn half_precision_is_as_near_as_a_single_pass() {
    let world = load(None, Precision::F16);
    let (mut rollout, mut expected) = (seeded(&world, &joined(&world), 3), seeded(&world, &point(&world), 3));
    for i in 0..3 {
        rollout.step(&controls(i)).expect("a step");
        expected.step(&controls(i)).expect("a step");
    }
    let error = relative_error(rollout.latent().expect("one"), expected.latent().expect("one"));
    // Chains of float16 are rounded elsewhere; slices have such errors, too.
    assert!(error < 0.02, "{error}");
}

#[test]
fn a_state_continues_with_the_same_bits() {
    let world = load(None, Precision::F32);
    let mut rollout = seeded(&world, &joined(&world), 3);
    let mut other = seeded(&world, &joined(&world), 4);
    for i in 0..12 {
        let state = rollout.save().expect("a state");
        assert_eq!(state.len(), rollout.state_len().expect("a size"));
        other.step(&controls(90)).expect("a step");
        other.restore(&state).expect("a state");
        for rollout in [&mut rollout, &mut other] {
            rollout.step(&controls(i)).expect("a step");
        }
        assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut other).expect("bits"), "step {i}");
    }
    // The operating point is the state's: a world without the joined graph refuses it.
    let options = WorldOptions { precision: Some(Precision::F32), ..WorldOptions::default() };
    let without = World::load(&device(), &bundle("joined"), options).expect("a world");
    let refused =
        seeded(&without, &point(&without), 1).restore(&rollout.save().expect("a state")).expect_err("refused");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidState, Some("state.operating_point")));
    // And a state of separate passes continues as one.
    let mut separate = seeded(&without, &point(&without), 5);
    other.restore(&separate.save().expect("a state")).expect("a state");
    for rollout in [&mut separate, &mut other] {
        rollout.step(&controls(1)).expect("a step");
    }
    assert!(fingerprint(&mut separate).expect("bits") == fingerprint(&mut other).expect("bits"));
}

#[test]
fn a_rollout_moves_to_another_window_with_its_pending_commit() {
    let (narrow, wide) = (load(Some(8), Precision::F32), load(Some(32), Precision::F32));
    let moved = |point: fn(&World) -> OperatingPoint| {
        let mut rollout = seeded(&narrow, &point(&narrow), 3);
        for i in 0..12 {
            match i {
                5 => rollout.move_to(&wide).expect("a wider window"),
                9 => rollout.move_to(&narrow).expect("a narrower window"),
                _ => {}
            }
            rollout.step(&controls(i)).expect("a step");
        }
        rollout.latent().expect("a latent").to_vec()
    };
    let error = relative_error(&moved(joined), &moved(point));
    assert!(error < MAX_ERROR, "{error}");
}

#[test]
fn what_has_no_joined_passes_is_refused() {
    let options = |options: WorldOptions| WorldOptions { precision: Some(Precision::F32), joined: true, ..options };
    let refused = |name: &str, given: WorldOptions| {
        let error = World::load(&device(), &bundle(name), options(given)).expect_err("refused");
        (error.kind(), error.offending_field().map(str::to_owned))
    };
    let limit = Some(Duration::from_millis(5));
    for given in [
        WorldOptions { slices: Some(2), ..WorldOptions::default() },
        WorldOptions { longest_submission: limit, ..WorldOptions::default() },
    ] {
        assert_eq!(refused("joined", given), (ErrorKind::InvalidArgument, Some("joined".to_owned())));
    }
    let missing = refused("tiny", WorldOptions::default());
    assert_eq!(missing, (ErrorKind::Unsupported, Some("graphs.f32.joined".to_owned())));

    let options = WorldOptions { precision: Some(Precision::F32), ..WorldOptions::default() };
    let without = World::load(&device(), &bundle("joined"), options).expect("a world");
    let error = Rollout::new(&without, &joined(&without), 1).expect_err("refused");
    assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("cache_mode")));
}

#[test]
fn the_memory_of_joined_passes_is_counted() {
    let device = device();
    let bundle = bundle("joined");
    let need = |passes| bundle.memory_need_in(Precision::F32, processor(&device), 16, passes).expect("a need");
    let [whole, joined, shared] =
        [Passes::Slices(1), Passes::Joined { shared_weights: false }, Passes::Joined { shared_weights: true }]
            .map(need);
    assert_eq!(load(None, Precision::F32).memory_need(), &joined);
    assert_eq!(joined.slabs, 3 * whole.slabs);
    assert!(joined.intermediates > 2 * whole.intermediates && joined.ring == whole.ring);
    assert!(joined.weights > whole.weights && shared.weights == whole.weights);
}
