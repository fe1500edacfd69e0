//! Invalid calls of a rollout are refused, and a failure leaves it unchanged.

use cairn::bundle::Precision;
use cairn::runtime::{CpuOptions, Device};
use cairn::world::{ControlInput, KeySet, OperatingPoint, Rollout, World, WorldOptions};
use cairn::{Error, ErrorKind, Picture};
use test_support::worlds::{self, controls, fingerprint, picture, point, processor, seeded, world};

/// Runs a call that must fail, and checks that the rollout is unchanged.
fn expect_failure(rollout: &mut Rollout, what: impl FnOnce(&mut Rollout) -> Result<(), Error>) -> Error {
    let before = fingerprint(rollout).expect("bits");
    let error = what(rollout).expect_err("a failure");
    assert!(fingerprint(rollout).expect("bits") == before, "changed by: {error}");
    error
}

#[test]
fn infinite_results_are_a_device_error_that_names_the_latent() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 1);
    for i in 0..3 {
        rollout.step(&controls(i)).expect("a step");
    }
    let error = expect_failure(&mut rollout, |r| {
        let mut plan = r.planner().plan_step(&controls(3))?;
        plan.dsigmas.fill(f32::MAX);
        r.execute(&plan).map(drop)
    });
    assert_eq!(error.kind(), ErrorKind::Device);
    assert!(error.to_string().contains("latent 4"), "{error}");

    // After the failures, the rollout is equal to one that did not try.
    let mut untried = seeded(&world, &point(&world), 1);
    for i in 0..5 {
        untried.step(&controls(i)).expect("a step");
    }
    rollout.step(&controls(3)).expect("a step");
    rollout.step(&controls(4)).expect("a step");
    assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut untried).expect("bits"));
}

#[test]
fn a_failed_first_step_leaves_a_new_rollout_unchanged() {
    let world = world("tiny");
    let mut rollout = Rollout::new(&world, &point(&world), 1).expect("a rollout");
    let before = rollout.save().expect("a state");
    let mut plan = rollout.planner().plan_step(&controls(0)).expect("a plan");
    plan.dsigmas.fill(f32::MAX);
    assert_eq!(rollout.execute(&plan).expect_err("a failure").kind(), ErrorKind::Device);
    assert!(rollout.save().expect("a state") == before);
    rollout.append(&picture(40, 30, 1)).expect("a seed");
    let mut untried = seeded(&world, &point(&world), 1);
    assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut untried).expect("bits"));
}

#[test]
fn numbers_that_are_not_finite_are_refused_by_name() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 1);
    for bad in [f32::NAN, f32::INFINITY] {
        assert_eq!(
            ControlInput::new([bad, 0.0], KeySet::NONE, 0.0).expect_err("NaN").kind(),
            ErrorKind::InvalidArgument
        );
        let error = expect_failure(&mut rollout, |r| {
            let mut plan = r.planner().plan_step(&controls(0))?;
            plan.controls[3] = bad;
            r.execute(&plan).map(drop)
        });
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("plan.controls")));
        let error = expect_failure(&mut rollout, |r| {
            let mut latent = vec![0.0; r.world().latent_len()];
            latent[5] = bad;
            r.append_latent(&latent).map(drop)
        });
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("latent")));
        let error = expect_failure(&mut rollout, |r| {
            let plan = r.planner().plan_step(&controls(0))?;
            r.probe(&plan, bad, &vec![0.0; r.world().latent_len()]).map(drop)
        });
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("sigma")));
    }
}

#[test]
fn sizes_that_do_not_fit_are_refused() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 1);
    for size in [0, 65_536] {
        assert_eq!(Picture::new(size, 8).expect_err("a size").kind(), ErrorKind::InvalidArgument);
        let error = expect_failure(&mut rollout, |r| r.append_latent(&vec![0.0; size as usize]).map(drop));
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("latent")));
    }
    for (width, height) in [(1, 1), (1, 997), (2048, 3)] {
        rollout.append(&picture(width, height, 1)).expect("any size is resized");
    }
    for (field, change) in [
        ("plan.controls", (|p| p.controls.push(0.0)) as fn(&mut cairn::world::StepPlan)),
        ("plan.local", |p| p.local.visible.push(true)),
        ("plan.global", |p| p.global.visible.clear()),
        ("plan.local", |p| p.local.slot = Some(usize::MAX)),
        ("plan.sigmas", |p| p.sigmas.push(0.0)),
        ("plan.sigmas", |p| {
            p.sigmas = vec![0.5; 64];
            p.dsigmas = vec![0.0; 64]
        }),
        ("plan.latent", |p| p.latent += 1),
        ("plan.noise", |p| p.noise = None),
    ] {
        let error = expect_failure(&mut rollout, |r| {
            let mut plan = r.planner().plan_step(&controls(0))?;
            change(&mut plan);
            r.execute(&plan).map(drop)
        });
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some(field)), "{error}");
    }
}

#[test]
fn an_operating_point_of_another_window_is_refused() {
    let world = world("tiny");
    let error = Rollout::new(&world, &OperatingPoint { global_window: 8, ..point(&world) }, 0).expect_err("another g");
    assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("global_window")));
}

#[test]
fn worlds_larger_than_memory_are_refused_with_sizes_before_loading() {
    let (device, bundle) = (worlds::device(), worlds::bundle("tiny"));
    let precision = Precision::F32;
    let need = bundle.memory_need(precision, processor(&device), 64).expect("figures");
    let load = |limit| {
        let options = WorldOptions { global_window: Some(64), memory_limit: Some(limit), ..Default::default() };
        World::load(&device, &bundle, WorldOptions { precision: Some(precision), ..options })
    };
    let error = load(need.total - 1).expect_err("one byte too few");
    assert_eq!(error.kind(), ErrorKind::OutOfMemory);
    assert!(error.to_string().matches("MiB").count() == 2 && error.to_string().contains("ring"), "{error}");
    assert_eq!(load(need.total).expect("it fits").memory_need(), &need);
}

#[test]
fn a_window_is_narrowed_to_the_available_memory_on_request() {
    let (device, bundle) = (worlds::device(), worlds::bundle("tiny"));
    let precision = Precision::F32;
    let need = |g| bundle.memory_need(precision, processor(&device), g).expect("figures").total;
    let load = |limit| {
        let options = WorldOptions { global_window: Some(64), memory_limit: Some(limit), ..Default::default() };
        World::load(&device, &bundle, WorldOptions { precision: Some(precision), fit_window: true, ..options })
    };
    assert_eq!(load(need(64)).expect("all of it").global_window(), 64);
    let narrow = load(need(32)).expect("half of it");
    assert_eq!((narrow.global_window(), narrow.memory_need().total), (32, need(32)));
    let mut rollout = worlds::seeded(&narrow, &worlds::point(&narrow), 7);
    rollout.step(&worlds::controls(0)).expect("a step");
    // Not even the narrowest window fits: the error names the requested one.
    assert_eq!(load(1).expect_err("nothing").kind(), ErrorKind::OutOfMemory);
}

#[test]
fn a_thread_count_out_of_range_is_refused() {
    let ort = worlds::ort();
    for threads in [0, 1025] {
        let error =
            Device::cpu(&ort, CpuOptions { threads: Some(threads), ..Default::default() }).expect_err("threads");
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("threads")));
    }
    assert!(Device::cpu(&ort, CpuOptions::default()).expect("a device").threads() >= 1);
}
