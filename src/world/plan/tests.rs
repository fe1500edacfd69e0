//! Compares the planner with a list of latents in each cache mode, and tests its saved state.

use super::*;
use crate::world::fixture::{TestRng, manifest};
use crate::world::preset::Preset;
use crate::world::schedule::Schedule;
use crate::world::time::WorldTime;
use crate::world::virtual_keys::Key;

fn point(cache_mode: CacheMode) -> OperatingPoint {
    OperatingPoint { global_window: 16, cache_mode, ..Preset::Stock.operating_point() }
}

fn planner(cache_mode: CacheMode) -> Planner {
    Planner::new(&manifest(), &point(cache_mode), 7).unwrap()
}

fn held(code: u8) -> ControlInput {
    ControlInput::new([1.0, -2.0], [Key(code)].into_iter().collect(), 1.0).unwrap()
}

const MODES: [CacheMode; 6] = [
    CacheMode::Separate,
    CacheMode::Fused,
    CacheMode::Interval(1),
    CacheMode::Interval(2),
    CacheMode::Interval(3),
    CacheMode::Interval(7),
];

#[test]
fn plans_have_the_expected_values() -> Result<()> {
    let mut planner = planner(CacheMode::Separate);
    let seed = planner.plan_append()?;
    assert_eq!((seed.latent, seed.rope_time, seed.ring_clock, seed.noise), (0, 0, 0, None));
    assert!(seed.sigmas.is_empty() && seed.dsigmas.is_empty());
    assert_eq!(seed.controls, [0.0; 259]);
    assert_eq!((seed.cache, seed.prime), (CachePass::Separate, 3));
    assert_eq!((seed.local.slot, seed.global.slot), (Some(0), Some(0)));
    assert_eq!(seed.local.visible, [false; 4]);
    planner.commit(&seed)?;

    let step = planner.plan_step(&held(87))?;
    assert_eq!((step.latent, step.rope_time, step.ring_clock), (1, 1, 1));
    assert_eq!(step.noise, Some(NoiseKey { seed: 7, latent: 1 }));
    assert_eq!(step.sigmas, [1.0, 0.898_437_5, 0.75, 0.300_781_25]);
    assert_eq!(step.dsigmas, [-0.101_562_5, -0.148_437_5, -0.449_218_75, -0.300_781_25]);
    assert_eq!((step.controls[0], step.controls[1], step.controls[2 + 87], step.controls[258]), (1.0, -2.0, 1.0, 1.0));
    assert_eq!(step.controls.iter().filter(|c| **c != 0.0).count(), 4);
    assert_eq!((step.cache, step.prime), (CachePass::Separate, 0));
    assert_eq!(step.local.visible, [true, false, false, false]);
    assert_eq!((step.local.slot, step.global.slot), (Some(1), None));
    Ok(())
}

/// Random sequences of steps and appends over many wraps, for every mode: the visible slots hold exactly the newest commits of a
/// list, and a latent that does not commit changes no ring.
#[test]
fn every_cache_mode_matches_a_list_of_latents() {
    for (seed, mode) in (0..).zip(MODES.into_iter().cycle().take(18)) {
        let mut rng = TestRng(seed);
        let mut planner = planner(mode);
        // The latents that committed, in order; the ring clock is the length of this list.
        let mut commits: Vec<u64> = Vec::new();
        let (mut local, mut global) = ([None; 4], [None; 4]);
        let mut generated = 0;
        for latent in 0..200 {
            let append = latent == 0 || rng.below(12) == 0;
            let plan =
                if append { planner.plan_append() } else { planner.plan_step(&held(rng.next_u64() as u8)) }.unwrap();
            generated += u64::from(!append);
            let commit = append
                || match mode {
                    CacheMode::Separate | CacheMode::Fused => true,
                    CacheMode::Interval(k) => generated.is_multiple_of(u64::from(k)),
                    CacheMode::Joined => unreachable!("it has a test of its own"),
                };
            let expected = match mode {
                _ if !commit => CachePass::Skip,
                CacheMode::Fused if !append => CachePass::Fused,
                _ => CachePass::Separate,
            };
            assert_eq!((plan.cache, plan.noise.is_none()), (expected, append), "{mode} latent {latent}");
            assert_eq!((plan.latent, plan.rope_time, plan.ring_clock), (latent, latent, commits.len() as u64));
            assert_eq!(plan.prime, if latent == 0 { 3 } else { 0 });

            let t = commits.len();
            let newest = |kept: Vec<u64>, count: usize| kept[kept.len().saturating_sub(count)..].to_vec();
            let dilated: Vec<u64> = commits.iter().copied().step_by(4).collect();
            let visible = |ring: &RingPlan, slots: &[Option<u64>; 4]| {
                let mut latents: Vec<u64> = (0..4).filter(|s| ring.visible[*s]).map(|s| slots[s].unwrap()).collect();
                latents.sort_unstable();
                latents
            };
            assert_eq!(visible(&plan.local, &local), newest(commits.clone(), 3), "{mode} latent {latent}");
            let count = if t.is_multiple_of(4) { 3 } else { 4 };
            assert_eq!(visible(&plan.global, &global), newest(dilated, count), "{mode} latent {latent}");

            let before = planner.clone();
            planner.commit(&plan).unwrap();
            if commit {
                local[plan.local.slot.unwrap()] = Some(latent);
                assert_eq!(plan.global.slot.is_some(), t.is_multiple_of(4));
                if let Some(slot) = plan.global.slot {
                    global[slot] = Some(latent);
                }
                commits.push(latent);
            } else {
                assert_eq!((plan.local.slot, plan.global.slot), (None, None));
                assert_eq!((planner.local(), planner.global()), (before.local(), before.global()));
            }
            assert_eq!(planner.local().written().to_vec(), local.map(|slot| slot.is_some()));
            assert_eq!(planner.global().written().to_vec(), global.map(|slot| slot.is_some()));
            assert_eq!((planner.latents(), planner.generated()), (latent + 1, generated));
        }
        assert!(commits.len() > 24, "{mode}: the rings never wrapped");
    }
}

/// k counts generated latents: with interval:3 after one seed, generated latents 3, 6, 9 commit.
#[test]
fn an_interval_counts_from_the_first_generated_latent() {
    let mut planner = planner(CacheMode::Interval(3));
    let mut kept = Vec::new();
    for latent in 0..10 {
        let plan = if latent == 0 { planner.plan_append() } else { planner.plan_step(&ControlInput::IDLE) }.unwrap();
        if plan.cache == CachePass::Separate {
            kept.push(plan.latent);
        }
        planner.commit(&plan).unwrap();
    }
    assert_eq!(kept, [0, 3, 6, 9]);
    assert_eq!((planner.latents(), planner.ring_clock()), (10, 4));
}

#[test]
fn rope_time_counts_latents_times_the_multiplier() {
    let mut manifest = manifest();
    manifest.rates.time_multiplier = 2;
    let mut planner = Planner::new(&manifest, &point(CacheMode::Interval(2)), 0).unwrap();
    for latent in 0..9 {
        let plan = planner.plan_step(&ControlInput::IDLE).unwrap();
        assert_eq!(plan.rope_time, 2 * latent);
        planner.commit(&plan).unwrap();
    }
    planner.clocks.latents = u64::MAX / 2 + 1;
    assert_eq!(planner.plan_append().unwrap_err().kind(), ErrorKind::Unsupported);
}

/// In `baseline-doubled` the ring and RoPE clocks still count latents; only the script's span is shorter.
#[test]
fn a_doubled_rate_changes_no_clock() {
    let doubled = OperatingPoint { global_window: 16, ..Preset::BaselineDoubled.operating_point() };
    let plain = OperatingPoint { latents_per_second: 15, ..doubled.clone() };
    let mut a = Planner::new(&manifest(), &doubled, 1).unwrap();
    let mut b = Planner::new(&manifest(), &plain, 1).unwrap();
    for _ in 0..40 {
        let (plan, same) = (a.plan_step(&held(65)).unwrap(), b.plan_step(&held(65)).unwrap());
        assert_eq!(plan, same);
        a.commit(&plan).unwrap();
        b.commit(&same).unwrap();
    }
    assert_eq!(doubled.span_of_latent(3), (WorldTime::new(2, 30), WorldTime::new(3, 30)));
}

#[test]
fn a_reused_plan_equals_a_new_one() {
    let mut planner = planner(CacheMode::Interval(2));
    let mut reused = StepPlan::default();
    for latent in 0..20u8 {
        if latent.is_multiple_of(5) {
            planner.plan_append_into(&mut reused).unwrap();
            assert_eq!(reused, planner.plan_append().unwrap());
        } else {
            planner.plan_step_into(&held(latent), &mut reused).unwrap();
            assert_eq!(reused, planner.plan_step(&held(latent)).unwrap());
        }
        planner.commit(&reused).unwrap();
    }
}

#[test]
fn altered_plans_are_executed_or_refused_whole() {
    let mut planner = planner(CacheMode::Separate);
    planner.commit(&planner.plan_append().unwrap()).unwrap();
    let plan = planner.plan_step(&ControlInput::IDLE).unwrap();
    let before = planner.clone();
    type Alteration = (&'static str, fn(&mut StepPlan));
    let invalid: [Alteration; 8] = [
        ("plan.latent", |p| p.latent += 1),
        ("plan.sigmas", |p| p.sigmas.truncate(2)),
        ("plan.controls", |p| p.controls.truncate(8)),
        ("plan.local", |p| p.local.visible.push(true)),
        ("plan.global", |p| p.global.visible.clear()),
        ("plan.global", |p| p.global.slot = Some(4)),
        ("plan.local", |p| p.cache = CachePass::Skip),
        ("plan.cache", |p| (p.cache, p.sigmas, p.dsigmas) = (CachePass::Fused, vec![], vec![])),
    ];
    for (field, alter) in invalid {
        let mut bad = plan.clone();
        alter(&mut bad);
        let error = planner.commit(&bad).unwrap_err();
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
        assert_eq!(planner, before);
    }
    let mut moved = plan;
    moved.local.slot = Some(3);
    planner.commit(&moved).unwrap();
    assert_eq!(planner.local().written(), [true, false, false, true]);
}

/// Steps and appends see what they see with separate cache passes; each commit is that of the separate plan before.
#[test]
fn joined_plans_are_separate_ones_whose_commits_are_made_a_step_later() {
    let (mut joined, mut separate) = (planner(CacheMode::Joined), planner(CacheMode::Separate));
    let mut before: Option<StepPlan> = None;
    for latent in 0..150_u8 {
        let make = |planner: &Planner| match latent % 20 {
            0 | 7 => planner.plan_append().unwrap(),
            _ => planner.plan_step(&held(latent)).unwrap(),
        };
        let (plan, expected) = (make(&joined), make(&separate));
        let pending = before.map(|StepPlan { rope_time, controls, local, global, .. }| PendingPlan {
            rope_time,
            controls,
            local,
            global,
        });
        assert_eq!(plan.pending, pending, "latent {latent}");
        assert_eq!((plan.cache, plan.local.slot, plan.global.slot), (CachePass::Deferred, None, None));
        let without = |plan: &StepPlan| {
            let visible = |ring: &RingPlan| RingPlan { visible: ring.visible.clone(), slot: None };
            let (local, global) = (visible(&plan.local), visible(&plan.global));
            StepPlan { pending: None, cache: CachePass::Deferred, local, global, ..plan.clone() }
        };
        assert_eq!(without(&plan), without(&expected), "latent {latent}");
        joined.commit(&plan).unwrap();
        separate.commit(&expected).unwrap();
        assert_eq!(joined.ring_clock() + 1, separate.ring_clock());
        before = Some(expected);
    }
    let mut altered = joined.plan_append().unwrap();
    altered.pending = None;
    assert_eq!(joined.commit(&altered).unwrap_err().offending_field(), Some("plan.pending"));
    let mut wider =
        Planner::new(&manifest(), &OperatingPoint { global_window: 32, ..point(CacheMode::Joined) }, 7).unwrap();
    wider.take_over(&joined);
    assert_eq!(
        wider.plan_append().unwrap().pending.unwrap().controls,
        joined.plan_append().unwrap().pending.unwrap().controls
    );
}

#[test]
fn a_saved_planner_continues_with_the_same_plans() {
    for mode in MODES.into_iter().chain([CacheMode::Joined]) {
        let mut first = planner(mode);
        for latent in 0..150u8 {
            let mut second = planner(mode);
            second.restore(&first.save()).unwrap();
            assert_eq!(first, second);
            let plan =
                if latent.is_multiple_of(20) { first.plan_append() } else { first.plan_step(&held(latent)) }.unwrap();
            first.commit(&plan).unwrap();
        }
        first.reset();
        assert_eq!(first, planner(mode));
    }
}

#[test]
fn damaged_states_are_refused() {
    [CacheMode::Interval(2), CacheMode::Joined].into_iter().for_each(check_damaged_states);
}

fn check_damaged_states(mode: CacheMode) {
    let mut saved = planner(mode);
    for _ in 0..30 {
        saved.commit(&saved.plan_step(&ControlInput::IDLE).unwrap()).unwrap();
    }
    let bytes = saved.save();
    let fresh = planner(mode);
    for len in 0..bytes.len() {
        let mut target = fresh.clone();
        assert_eq!(target.restore(&bytes[..len]).unwrap_err().kind(), ErrorKind::InvalidState, "{len} bytes");
        assert_eq!(target, fresh);
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(fresh.clone().restore(&longer).is_err());
    // A state with a flipped bit is refused, or restores a consistent planner.
    for bit in 0..bytes.len() * 8 {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        let mut target = fresh.clone();
        match target.restore(&flipped) {
            Ok(()) => {
                target.plan_append().unwrap();
                assert!(target.ring_clock() <= target.latents());
            }
            Err(error) => {
                assert!(matches!(error.kind(), ErrorKind::InvalidState | ErrorKind::Unsupported));
                assert_eq!(target, fresh);
            }
        }
    }
}

#[test]
fn states_of_other_planners_are_refused() {
    let bytes = planner(CacheMode::Interval(2)).save();
    let other_window = OperatingPoint { global_window: 32, ..point(CacheMode::Interval(2)) };
    let other_schedule = OperatingPoint { schedule: Schedule::Refined(9), ..point(CacheMode::Interval(2)) };
    for mut other in [
        planner(CacheMode::Interval(3)),
        planner(CacheMode::Separate),
        Planner::new(&manifest(), &point(CacheMode::Interval(2)), 8).unwrap(),
        Planner::new(&manifest(), &other_window, 7).unwrap(),
        Planner::new(&manifest(), &other_schedule, 7).unwrap(),
    ] {
        assert_eq!(other.restore(&bytes).unwrap_err().kind(), ErrorKind::InvalidState);
    }
}

#[test]
fn points_that_do_not_fit_the_world_are_refused() {
    let stock = point(CacheMode::Separate);
    for (field, bad) in [
        ("global_window", OperatingPoint { global_window: 0, ..stock.clone() }),
        ("global_window", OperatingPoint { global_window: 18, ..stock.clone() }),
        ("global_window", OperatingPoint { global_window: 68, ..stock.clone() }),
        ("schedule", OperatingPoint { schedule: Schedule::Refined(3), ..stock.clone() }),
        ("cache_mode", OperatingPoint { cache_mode: CacheMode::Interval(0), ..stock.clone() }),
        ("latents_per_second", OperatingPoint { latents_per_second: 0, ..stock.clone() }),
        ("pictures_per_latent", OperatingPoint { pictures_per_latent: 3, ..stock.clone() }),
    ] {
        let error = Planner::new(&manifest(), &bad, 0).unwrap_err();
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
    }
    for g in [4, 16, 32, 64] {
        let planner = Planner::new(&manifest(), &OperatingPoint { global_window: g, ..stock.clone() }, 0).unwrap();
        assert_eq!(planner.global().slot_count(), g as usize / 4);
    }
    let invalid: [fn(&mut Manifest); 4] = [
        |m| m.geometry.global.dilation = 0,
        |m| m.geometry.local.window = 0,
        |m| m.geometry.autoencoder.temporal = 0,
        |m| m.controls.mouse = 3,
    ];
    for alter in invalid {
        let mut manifest = manifest();
        alter(&mut manifest);
        assert!(Planner::new(&manifest, &stock, 0).is_err());
    }
}
