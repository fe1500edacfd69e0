//! Rollouts whose window changes, and budgets of time and memory.

use std::sync::Arc;
use std::time::{Duration, Instant};

use cairn::ErrorKind;
use cairn::bundle::Precision;
use cairn::runtime::{CpuOptions, Device};
use cairn::world::{Budget, GovernorStatistics, Rollout, Schedule, World, WorldOptions};
use test_support::worlds::{bundle, controls, device, fingerprint, ort, point, seeded};

const HOUR: Duration = Duration::from_secs(3600);
/// The test world's dilation, and the windows that it is loaded with.
const DILATION: u64 = 4;
const WIDE: u32 = 32;
const NARROW: u32 = 8;

fn world_on(device: &Device, window: u32) -> Arc<World> {
    let options =
        WorldOptions { precision: Some(Precision::F32), global_window: Some(window), ..WorldOptions::default() };
    World::load(device, &bundle("tiny"), options).expect("a world")
}

/// The bundle with both windows, on one device.
fn worlds() -> [Arc<World>; 2] {
    let device = device();
    [WIDE, NARROW].map(|window| world_on(&device, window))
}

/// Whether to run only the most important cases, as on a device that the processor emulates.
fn is_short() -> bool {
    std::env::var_os("CAIRN_TEST_SHORT").is_some()
}

fn steps(rollout: &mut Rollout, count: u64) {
    (0..count).for_each(|i| _ = rollout.step(&controls(i)).expect("a step"));
}

/// The largest difference of two latents.
fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn a_narrower_window_sees_the_newest_latents_and_a_wider_one_forgets_none() {
    let [wide, narrow] = worlds();
    let slots = u64::from(NARROW) / DILATION;
    // On a write step of the global layers, and between two such steps.
    for latents in if is_short() { &[11][..] } else { &[23, 25] }.iter().copied() {
        let mut whole = seeded(&wide, &point(&wide), 3);
        steps(&mut whole, latents);
        let state = whole.save().expect("a state");
        let mut moved = seeded(&wide, &point(&wide), 9);
        moved.restore(&state).expect("a state");
        moved.move_to(&narrow).expect("a narrower world");
        assert_eq!((moved.world().global_window(), moved.operating_point().global_window), (NARROW, NARROW));
        assert_eq!(moved.planner().latents(), latents + 1);
        assert_eq!(moved.latent().expect("a latent"), whole.latent().expect("a latent"));
        assert!(moved.decoded().expect("pictures") == whole.decoded().expect("pictures"));

        // The same pass in the wide world, with all slots masked that the narrow world lacks.
        let mut plan = whole.planner().plan_step(&controls(77)).expect("a plan");
        let clock = whole.planner().ring_clock();
        let newest = (clock - 1) / DILATION;
        // The slot that is about to be overwritten is masked already.
        let seen = if clock.is_multiple_of(DILATION) { slots - 1 } else { slots };
        let slot = |bucket: u64| (bucket % u64::from(WIDE / DILATION as u32)) as usize;
        let visible: Vec<_> = (newest + 1 - seen..=newest).map(slot).collect();
        let all = plan.global.visible.clone();
        for (slot, sees) in plan.global.visible.iter_mut().enumerate() {
            *sees &= visible.contains(&slot);
        }
        assert!(plan.global.visible != all, "the wide window sees more");
        whole.execute(&plan).expect("a step");
        moved.step(&controls(77)).expect("a step");
        let difference = largest_difference(moved.latent().expect("a latent"), whole.latent().expect("a latent"));
        assert!(difference < 1e-4, "{difference} after {latents} latents");
        // The result differs from that of the wide world without the mask.
        whole.restore(&state).expect("a state");
        whole.step(&controls(77)).expect("a step");
        let difference = largest_difference(moved.latent().expect("a latent"), whole.latent().expect("a latent"));
        assert!(difference > 1e-3, "{difference} after {latents} latents");
    }
}

#[test]
fn moving_to_another_window_and_back_changes_nothing() {
    let [wide, narrow] = worlds();
    let mut rollout = seeded(&narrow, &point(&narrow), 4);
    steps(&mut rollout, 21);
    let before = (fingerprint(&mut rollout).expect("bits"), rollout.statistics());
    rollout.move_to(&wide).expect("a wider world");
    assert_eq!(rollout.statistics().latents, before.1.latents);
    assert!(rollout.statistics().bytes.copied >= before.1.bytes.copied, "counting continues");
    rollout.move_to(&narrow).expect("the first world");
    assert!(fingerprint(&mut rollout).expect("bits") == before.0);
    // A stop flag from before the move still works.
    rollout.stop_flag().store(true, std::sync::atomic::Ordering::SeqCst);
    assert_eq!(rollout.step(&controls(0)).expect_err("it is stopped").kind(), ErrorKind::Cancelled);
    rollout.stop_flag().store(false, std::sync::atomic::Ordering::SeqCst);
    let half = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
    let half = World::load(&device(), &bundle("tiny"), half).expect("the same bundle in half floats");
    let refused = rollout.move_to(&half).expect_err("another precision");
    assert_eq!(refused.offending_field(), Some("world"), "{refused}");
    assert!(fingerprint(&mut rollout).expect("bits") == before.0);
}

/// Schedules of four, two and one pass.
fn schedules() -> Vec<Schedule> {
    vec![Schedule::Stock, Schedule::Explicit(vec![1.0, 0.5, 0.0]), Schedule::Explicit(vec![1.0, 0.0])]
}

/// Makes `count` latents; returns the number of passes and the window of each.
fn passes_and_windows(rollout: &mut Rollout, count: u64) -> Vec<(u64, u32)> {
    let mut one = |i| {
        let passes = rollout.step(&controls(i)).expect("a step").stages.denoise.count;
        (passes, rollout.world().global_window())
    };
    (0..count).map(&mut one).collect()
}

#[test]
fn a_time_budget_reduces_passes_and_the_window() {
    let [wide, narrow] = worlds();
    let mut rollout = seeded(&wide, &point(&wide), 7);
    let budget = |frame| Budget { frame: Some(frame), multiplier: 4, schedules: schedules(), ..Budget::default() };
    let governor = rollout.govern(&budget(HOUR), std::slice::from_ref(&narrow)).expect("a budget");
    assert_eq!(passes_and_windows(&mut rollout, 7), [(4, WIDE); 7], "the budget is large");
    let done = governor.statistics();
    assert!(done.frame > Duration::ZERO);
    let expected = GovernorStatistics { frame: done.frame, latents: 7, passes: 4, window: WIDE, generated: 4, ..done };
    assert_eq!((done, done.reductions + done.increases + done.over_budget), (expected, 0));

    let governor = rollout.govern(&budget(Duration::from_nanos(1)), std::slice::from_ref(&narrow)).expect("a budget");
    let latents = passes_and_windows(&mut rollout, 8);
    assert_eq!(latents, [[(4, WIDE); 3].as_slice(), &[(1, NARROW); 5]].concat(), "the budget is too small");
    let done = governor.statistics();
    assert_eq!((done.reductions, done.increases, done.passes, done.window, done.generated), (1, 0, 1, NARROW, 4));
    assert_eq!(rollout.operating_point().schedule, schedules()[2]);
    assert!(passes_and_windows(&mut rollout, 6).iter().all(|one| *one == (1, NARROW)));
    assert!(governor.statistics().over_budget > 0, "nothing can be reduced further");

    // A state belongs to its window: restoring it ends the budget, as do another budget and the governor's end.
    let state = rollout.save().expect("a state");
    rollout.govern(&budget(HOUR), std::slice::from_ref(&wide)).expect("a budget");
    rollout.restore(&state).expect("a state");
    assert!(rollout.governor().is_none());
    rollout.govern(&budget(HOUR), &[]).expect("a budget");
    rollout.set_budget(HOUR, &schedules()).expect("a budget");
    assert!(rollout.governor().is_none());
    rollout.govern(&budget(HOUR), &[]).expect("a budget");
    rollout.ungovern();
    assert!(rollout.governor().is_none());
}

#[test]
fn latent_times_come_from_the_devices_clock() {
    let [wide, narrow] = worlds();
    let mut rollout = seeded(&wide, &point(&wide), 7);
    let budget = |frame| Budget { frame: Some(frame), multiplier: 1, schedules: schedules(), ..Budget::default() };
    #[cfg(windows)]
    let spent = |rollout: &mut Rollout| {
        let times = rollout.device_times()?;
        let total = times.encode.total + times.passes.total + times.decode.total + times.commit.total;
        (!total.is_zero()).then_some(total)
    };
    #[cfg(not(windows))]
    let spent = |_: &mut Rollout| None::<Duration>;
    let governor = rollout.govern(&budget(HOUR), std::slice::from_ref(&narrow)).expect("a budget");
    let (start, before) = (Instant::now(), spent(&mut rollout));
    assert_eq!(passes_and_windows(&mut rollout, 3), [(4, WIDE); 3]);
    let (wall, spent) = (start.elapsed(), spent(&mut rollout).zip(before).map(|(now, before)| now - before));
    // The mean of the three.
    let reported = governor.statistics().frame * 3;
    println!("{reported:?} reported, {spent:?} on the device, {wall:?} in all");
    match spent {
        // The end of the last latent's work may be known a little later.
        Some(spent) => {
            assert!(
                reported <= spent && reported >= spent / 2 && spent <= wall,
                "{reported:?} of {spent:?} in {wall:?}"
            )
        }
        None => assert!(reported > Duration::ZERO && reported <= wall, "{reported:?} in {wall:?}"),
    }
    // It moves to the other window and back.
    let narrower = rollout.govern(&budget(Duration::from_nanos(1)), std::slice::from_ref(&narrow)).expect("a budget");
    assert_eq!(
        passes_and_windows(&mut rollout, 4),
        [(4, WIDE), (4, WIDE), (4, WIDE), (1, NARROW)],
        "the budget is too small"
    );
    assert_eq!((narrower.statistics().reductions, narrower.statistics().window), (1, NARROW));
    rollout.govern(&budget(HOUR), std::slice::from_ref(&wide)).expect("a budget");
    assert_eq!(passes_and_windows(&mut rollout, 1), [(4, WIDE)], "the budget is large");
}

#[test]
fn the_widest_window_that_the_memory_allows_is_used() {
    let [wide, narrow] = worlds();
    let mut rollout = seeded(&wide, &point(&wide), 7);
    let need = |world: &World| world.memory_need().total;
    let budget = |memory| Budget { memory: Some(memory), multiplier: 1, ..Budget::default() };
    for (memory, expected) in [(need(&wide), WIDE), (need(&wide) - 1, NARROW), (need(&narrow), NARROW)] {
        let governor = rollout.govern(&budget(memory), &[wide.clone(), narrow.clone()]).expect("a budget");
        assert_eq!(passes_and_windows(&mut rollout, 5), [(4, expected); 5], "{memory} bytes");
        assert_eq!(governor.statistics().window, expected);
    }
    let refused = rollout.govern(&budget(need(&narrow) - 1), &[]).expect_err("too little for any");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::OutOfMemory, Some("worlds")), "{refused}");
    assert!(refused.to_string().contains(&format!("g{NARROW}")), "{refused}");
    assert!(rollout.governor().is_some(), "nothing has changed");
}

#[test]
fn a_window_whose_slices_are_too_long_is_used_only_where_no_other_is() {
    // Not an emulated graphics device, on which the sessions of all slices would take more memory than machines have.
    let device = Device::cpu(&ort(), CpuOptions { threads: Some(2), deterministic: true }).expect("a CPU device");
    let limited = |window, limit| {
        let options = WorldOptions {
            precision: Some(Precision::F32),
            global_window: Some(window),
            longest_submission: Some(limit),
            ..WorldOptions::default()
        };
        World::load(&device, &bundle("tiny"), options).expect("a world")
    };
    // No slice of any number takes a nanosecond.
    let [wide, narrow] = [limited(WIDE, Duration::from_nanos(1)), limited(NARROW, HOUR)];
    let budget = Budget { frame: Some(HOUR), multiplier: 1, ..Budget::default() };
    let mut rollout = seeded(&wide, &point(&wide), 7);
    let governor = rollout.govern(&budget, std::slice::from_ref(&narrow)).expect("a budget");
    assert_eq!(passes_and_windows(&mut rollout, 5), [(4, NARROW); 5]);
    assert_eq!(governor.statistics().window, NARROW);
    let mut rollout = seeded(&wide, &point(&wide), 7);
    rollout.govern(&budget, &[limited(NARROW, Duration::from_nanos(1))]).expect("a budget");
    assert_eq!(passes_and_windows(&mut rollout, 2), [(4, WIDE); 2], "none keeps to the limit");
}

#[test]
fn invalid_budgets_are_refused() {
    let device = device();
    let wide = world_on(&device, WIDE);
    let mut rollout = seeded(&wide, &point(&wide), 7);
    let good = Budget { frame: Some(HOUR), multiplier: 4, schedules: schedules(), ..Budget::default() };
    let swapped = vec![schedules()[1].clone(), schedules()[0].clone()];
    let same = [(); 2].map(|()| world_on(&device, WIDE));
    for (budget, worlds, field) in [
        (Budget { frame: None, ..good.clone() }, &[][..], "budget"),
        (Budget { frame: Some(Duration::ZERO), ..good.clone() }, &[], "budget.frame"),
        (Budget { multiplier: 0, ..good.clone() }, &[], "budget.multiplier"),
        (Budget { multiplier: 65, ..good.clone() }, &[], "budget.multiplier"),
        (Budget { schedules: swapped, ..good.clone() }, &[], "budget.schedules"),
        (Budget { schedules: vec![Schedule::Stock; 9], ..good.clone() }, &[], "budget.schedules"),
        (good.clone(), &same, "worlds"),
    ] {
        let refused = rollout.govern(&budget, worlds).expect_err(field);
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
    }
    assert!(rollout.governor().is_none());
}
