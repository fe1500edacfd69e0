//! Rollouts of a small world: determinism, ring, cache modes, encoder and decoder, schedules and budgets.

use std::sync::Arc;
use std::time::Duration;

use cairn::bundle::{LayerKind, Precision};
use cairn::world::{
    CacheMode, CachePass, ControlInput, Job, KvPart, MAX_POINTS, OperatingPoint, Rollout, Schedule, TicketState,
    Worker, World, WorldOptions,
};
use cairn::{ErrorKind, Picture};
use test_support::worlds::{self, controls, fingerprint, picture, point, seeded, world};

/// K and V of every layer's ring, in bytes, and the planner's clocks and flags.
fn ring(rollout: &Rollout) -> (Vec<Vec<u8>>, Vec<u8>) {
    let layers = rollout.world().manifest().geometry.layers;
    let bytes = (0..layers)
        .flat_map(|layer| [KvPart::Keys, KvPart::Values].map(|part| rollout.ring_bytes(layer, part).expect("a ring")))
        .collect();
    (bytes, rollout.planner().save())
}

fn steps(rollout: &mut Rollout, range: std::ops::Range<u64>) {
    for i in range {
        rollout.step(&controls(i)).expect("a step");
    }
}

#[test]
fn a_worker_runs_queued_steps_in_order_and_cancels_waiting_ones() {
    let world = world("tiny");
    let mut alone = seeded(&world, &point(&world), 7);
    steps(&mut alone, 0..3);
    let worker = Worker::new(seeded(&world, &point(&world), 7), 3);
    let submit = |i| worker.submit(Job::Step(controls(i))).expect("it is queued");
    let tickets = [0, 1, 2].map(|i| submit(i).expect("there is room"));
    assert_eq!(submit(3), None, "the queue is full");
    let ended = |ticket| match worker.ticket(ticket, None, false, |_| Ok::<_, cairn::Error>(())).expect("a ticket") {
        TicketState::Finished(result) => result,
        TicketState::Pending => panic!("the wait has no timeout"),
    };
    for ticket in tickets {
        assert!(ended(ticket).is_ok());
    }
    let twice = worker.ticket(tickets[0], None, false, |_| Ok::<_, cairn::Error>(()));
    assert_eq!(twice.expect_err("it is over").kind(), ErrorKind::InvalidArgument);
    assert!(
        fingerprint(&mut worker.lock_idle().expect("nothing runs").rollout).expect("bits")
            == fingerprint(&mut alone).expect("bits")
    );

    worker.pause(true);
    let waiting = submit(3).expect("there is room");
    assert_eq!(worker.lock_idle().expect_err("a step waits").kind(), ErrorKind::Busy);
    worker.cancel();
    assert_eq!(ended(waiting).expect_err("it was cancelled").kind(), ErrorKind::Cancelled);
    worker.close();
    assert_eq!(worker.submit(Job::Step(controls(3))).expect_err("it ends").kind(), ErrorKind::Cancelled);
}

#[test]
fn calls_that_read_a_rollout_wait_for_each_other_but_not_for_themselves() {
    let world = world("tiny");
    let worker = Worker::new(seeded(&world, &point(&world), 7), 3);
    let reading = worker.lock_between_steps(false).expect("no step runs");
    assert_eq!(worker.lock_between_steps(true).err().expect("it would wait for itself").kind(), ErrorKind::Busy);
    std::thread::scope(|scope| {
        let (read, result) = std::sync::mpsc::channel();
        let worker = &worker;
        scope.spawn(move || read.send(worker.lock_between_steps(false).map(drop)));
        result.recv_timeout(std::time::Duration::from_millis(50)).expect_err("the other call reads");
        drop(reading);
        result.recv().expect("a result").expect("no step runs");
    });
    let exclusive = worker.lock_idle().expect("nothing runs");
    assert_eq!(worker.lock_between_steps(false).err().expect("it is used").kind(), ErrorKind::Busy);
    drop(exclusive);
}

#[test]
fn a_step_that_is_submitted_after_a_cancellation_does_not_undo_it() {
    let world = world("tiny");
    let worker = Worker::new(seeded(&world, &point(&world), 7), 3);
    // In place of a step on another thread, which looks at the flag when it can stop.
    let mut other = worker.lock_idle().expect("nothing runs");
    worker.cancel();
    let ticket = worker.submit(Job::Step(controls(0))).expect("it is queued").expect("there is room");
    std::thread::sleep(std::time::Duration::from_millis(100));
    assert_eq!(other.rollout.step(&controls(0)).expect_err("it was cancelled").kind(), ErrorKind::Cancelled);
    drop(other);
    let ended = worker.ticket(ticket, None, false, |_| Ok::<_, cairn::Error>(())).expect("a ticket");
    assert!(matches!(ended, TicketState::Finished(Ok(_))), "{ended:?}");
}

#[test]
fn the_same_seed_and_controls_give_the_same_bits_and_others_do_not() {
    let world = world("tiny");
    let run = |seed, shift| {
        let mut rollout = seeded(&world, &point(&world), seed);
        steps(&mut rollout, shift..shift + 5);
        fingerprint(&mut rollout).expect("bits")
    };
    let first = run(7, 0);
    assert!(first == run(7, 0), "the same again");
    assert!(first != run(8, 0), "another seed");
    assert!(first != run(7, 1), "other controls");
}

#[test]
fn rollouts_of_one_world_run_independently_on_several_threads() {
    fn send<T: Send>() {}
    fn send_and_sync<T: Send + Sync>() {}
    send::<Rollout>();
    send_and_sync::<World>();

    let world = world("tiny");
    let run = |world: &Arc<World>, seed| {
        let mut rollout = seeded(world, &point(world), seed);
        steps(&mut rollout, 0..6);
        fingerprint(&mut rollout).expect("bits")
    };
    let alone: Vec<_> = (0..3).map(|seed| run(&world, seed)).collect();
    let together: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..3)
            .map(|seed| {
                scope.spawn({
                    let world = &world;
                    move || run(world, seed)
                })
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().expect("a thread")).collect()
    });
    assert!(alone == together);
}

#[test]
fn a_rollout_may_move_between_threads_midway() {
    let world = world("tiny");
    let mut still = seeded(&world, &point(&world), 1);
    steps(&mut still, 0..4);
    let mut moved = seeded(&world, &point(&world), 1);
    steps(&mut moved, 0..2);
    let mut moved = std::thread::spawn(move || {
        steps(&mut moved, 2..4);
        moved
    })
    .join()
    .expect("a thread");
    assert!(fingerprint(&mut still).expect("bits") == fingerprint(&mut moved).expect("bits"));
}

#[test]
fn a_frozen_pass_changes_no_byte_or_flag_of_the_ring() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 3);
    for i in 0..9 {
        let before = ring(&rollout);
        let plan = rollout.planner().plan_step(&controls(i)).expect("a plan");
        let x = vec![0.25; world.latent_len()];
        let probe = rollout.probe(&plan, 0.75, &x).expect("a pass");
        assert!(probe.velocity.iter().any(|v| *v != 0.0));
        assert_eq!((probe.keys.len(), probe.values.len()), (8, 8));
        assert!(ring(&rollout) == before, "latent {i}");
        // A second probe gives the same result, and does not change the step after it.
        assert_eq!(rollout.probe(&plan, 0.75, &x).expect("a pass"), probe);
        rollout.step(&controls(i)).expect("a step");
        assert!(ring(&rollout) != before, "the step itself commits");
    }
    let mut unprobed = seeded(&world, &point(&world), 3);
    steps(&mut unprobed, 0..9);
    assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut unprobed).expect("bits"));
}

#[test]
fn a_commit_writes_its_slot_with_the_slabs_and_nothing_else() {
    let world = world("tiny");
    let geometry = world.manifest().geometry.clone();
    let mut rollout = seeded(&world, &point(&world), 4);
    // More latents than either ring holds.
    for i in 0..20 {
        let plan = rollout.planner().plan_step(&controls(i)).expect("a plan");
        let (before, _) = ring(&rollout);
        let info = rollout.execute(&plan).expect("a step");
        let (after, _) = ring(&rollout);
        // The cache pass at sigma 0 on the finished latent computed the committed K and V.
        let latent = rollout.latent().expect("a latent").to_vec();
        let mut changed = 0;
        for layer in 0..geometry.layers {
            let global = geometry.is_global(layer);
            let (slot, buckets) = if global {
                (plan.global.slot, plan.global.visible.len())
            } else {
                (plan.local.slot, plan.local.visible.len())
            };
            let slab_len = (geometry.tokens * geometry.head_width * 4) as usize;
            for part in 0..2 {
                let index = (2 * layer + part) as usize;
                let pairs = before[index].chunks_exact(slab_len).zip(after[index].chunks_exact(slab_len));
                for (n, (old, new)) in pairs.enumerate() {
                    if Some(n % buckets) == slot {
                        assert!(old != new, "latent {i}, layer {layer}: slot {slot:?} is written");
                        changed += slab_len as u64;
                    } else {
                        assert!(old == new, "latent {i}, layer {layer}: slab {n} is unchanged");
                    }
                }
            }
        }
        assert!(latent.iter().all(|v| v.is_finite()));
        assert_eq!(info.ring_bytes, changed, "exactly the changed bytes are counted");
        assert_eq!(
            info.ring_bytes,
            world.slab_bytes(if plan.global.slot.is_some() { &LayerKind::ALL } else { &[LayerKind::Local] })
        );
    }
}

#[test]
fn each_cache_mode_commits_its_latents() {
    let world = world("tiny");
    let run = |cache_mode, count| {
        let mut rollout = seeded(&world, &OperatingPoint { cache_mode, ..point(&world) }, 5);
        let committed: Vec<_> =
            (0..count).map(|i| rollout.step(&controls(i)).expect("a step")).map(|info| info.committed).collect();
        (committed, rollout)
    };
    let (all, separate) = run(CacheMode::Separate, 4);
    assert_eq!(all, [true; 4]);
    assert_eq!(separate.statistics().stages.cache.count, 5, "the seed's and four");
    let (all, fused) = run(CacheMode::Fused, 4);
    assert_eq!(all, [true; 4]);
    assert_eq!(fused.statistics().stages.cache.count, 1, "only the seed has a cache pass");
    assert!(ring(&fused).0 != ring(&separate).0, "K and V of a noisy latent differ");
    let (some, every_third) = run(CacheMode::Interval(3), 7);
    assert_eq!(some, [false, false, true, false, false, true, false]);
    assert_eq!((every_third.planner().latents(), every_third.planner().ring_clock()), (8, 3));

    // A latent without a commit leaves every slot and flag unchanged.
    let mut rollout = seeded(&world, &OperatingPoint { cache_mode: CacheMode::Interval(2), ..point(&world) }, 5);
    let before = ring(&rollout).0;
    let info = rollout.step(&controls(0)).expect("a step");
    assert_eq!((info.committed, info.ring_bytes), (false, 0));
    assert!(ring(&rollout).0 == before);
    assert_eq!(rollout.planner().ring_clock(), 1);
}

/// The rollout keeps what it computed of a few noise levels, and the world that of more.
#[test]
fn probes_at_many_noise_levels_give_what_one_gives_and_change_no_step() {
    let world = world("tiny");
    let (mut probed, mut plain) = (seeded(&world, &point(&world), 6), seeded(&world, &point(&world), 6));
    let plan = probed.planner().plan_step(&controls(0)).expect("a plan");
    let x = vec![0.5; world.latent_len()];
    let levels: Vec<f32> = (0..MAX_POINTS as u32 + 10).map(|i| 1.0 - i as f32 / 128.0).collect();
    let mut velocities = Vec::new();
    for &level in levels.iter().chain(&levels[..3]) {
        velocities.push(probed.probe(&plan, level, &x).expect("a pass").velocity);
    }
    assert!(velocities.windows(2).all(|pair| pair[0] != pair[1]), "a level has a velocity of its own");
    assert!(velocities[..3] == velocities[levels.len()..]);
    let other = seeded(&world, &point(&world), 6).probe(&plan, levels[40], &x).expect("a pass");
    assert!(other.velocity == velocities[40]);
    for latent in 0..3 {
        probed.step(&controls(latent)).expect("a step");
        plain.step(&controls(latent)).expect("a step");
        assert!(probed.latent().expect("a latent") == plain.latent().expect("a latent"), "latent {latent}");
    }
}

#[test]
fn fused_commits_the_slabs_of_the_last_denoise_pass() {
    let world = world("tiny");
    let mut fused = seeded(&world, &OperatingPoint { cache_mode: CacheMode::Fused, ..point(&world) }, 6);
    let mut separate = seeded(&world, &point(&world), 6);
    let plan = fused.planner().plan_step(&controls(0)).expect("a plan");
    assert_eq!(plan.cache, CachePass::Fused);
    fused.step(&controls(0)).expect("a step");
    separate.step(&controls(0)).expect("a step");
    // The latent itself does not depend on the cache mode.
    assert_eq!(fused.latent().expect("a latent"), separate.latent().expect("a latent"));
    // Denoising with one pass less, probed at the last level, gives the committed K and V.
    let (sigma, dsigma) = (plan.sigmas[3], plan.dsigmas[3]);
    let mut shorter = seeded(&world, &point(&world), 6);
    let mut cut = plan.clone();
    cut.sigmas.truncate(3);
    cut.dsigmas.truncate(3);
    cut.cache = CachePass::Skip;
    (cut.local.slot, cut.global.slot) = (None, None);
    shorter.execute(&cut).expect("a step");
    let before_last = shorter.latent().expect("a latent").to_vec();
    let probe = seeded(&world, &point(&world), 6).probe(&plan, sigma, &before_last).expect("a pass");
    let x = before_last.iter().zip(&probe.velocity).map(|(x, v)| x + dsigma * v);
    let largest_difference = x.zip(fused.latent().expect("a latent")).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest_difference < 1e-4, "the last pass equals the probed one: {largest_difference}");
    let slot = plan.local.slot.expect("local layers take every latent");
    let slab_len = (world.manifest().geometry.tokens * world.manifest().geometry.head_width) as usize;
    let ring: Vec<f32> = fused
        .ring_bytes(0, KvPart::Keys)
        .expect("a ring")
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect();
    let buckets = plan.local.visible.len();
    for (head, keys) in probe.keys[0].chunks_exact(slab_len).enumerate() {
        assert_eq!(keys, &ring[(head * buckets + slot) * slab_len..][..slab_len], "head {head}");
    }
}

#[test]
fn a_picture_may_be_appended_at_any_time_and_is_committed_in_every_mode() {
    let world = world("tiny");
    for cache_mode in [CacheMode::Separate, CacheMode::Fused, CacheMode::Interval(100)] {
        let mut rollout = seeded(&world, &OperatingPoint { cache_mode, ..point(&world) }, 9);
        steps(&mut rollout, 0..3);
        let before = rollout.planner().ring_clock();
        let info = rollout.append(&picture(301, 77, 3)).expect("an append");
        assert!(info.committed && info.stages.encode.count == 1 && info.stages.denoise.count == 0);
        assert_eq!((info.latent, rollout.planner().ring_clock()), (4, before + 1));
        // The appended latent is the encoder's, and can itself be appended.
        let encoded = rollout.encode(&picture(301, 77, 3)).expect("a latent");
        assert_eq!(rollout.latent().expect("a latent"), encoded);
        let mut other = seeded(&world, &OperatingPoint { cache_mode, ..point(&world) }, 9);
        steps(&mut other, 0..3);
        other.append_latent(&encoded).expect("an append");
        assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut other).expect("bits"));
        steps(&mut rollout, 3..5);
    }
}

#[test]
fn four_pictures_make_one_latent_and_a_single_one_is_repeated() {
    let world = world("tiny");
    let [first, second] = [1, 2].map(|seed| picture(64, 40, seed));
    let latent_of = |pictures: &[&Picture]| {
        let mut rollout = Rollout::new(&world, &point(&world), 9).expect("a rollout");
        let info = rollout.append_pictures(pictures).expect("an append");
        assert_eq!((info.latent, info.committed, info.stages.encode.count), (0, true, 1));
        (rollout.latent().expect("a latent").to_vec(), fingerprint(&mut rollout).expect("bits"))
    };
    let still = latent_of(&[&first]);
    assert!(still == latent_of(&[&first; 4]), "a single picture is repeated four times");
    let moving = latent_of(&[&first, &first, &second, &second]);
    assert!(moving.0 != still.0 && moving.0 != latent_of(&[&second]).0);
    assert!(moving.0 != latent_of(&[&second, &second, &first, &first]).0, "their order counts");
    let mut rollout = Rollout::new(&world, &point(&world), 9).expect("a rollout");
    for count in [0, 2, 3, 5] {
        let error = rollout.append_pictures(&vec![&first; count]).expect_err("no latent");
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("pictures")), "{count}");
        assert_eq!(rollout.planner().latents(), 0);
    }
}

#[test]
fn the_encoder_stream_continues_only_if_it_is_kept() {
    let world = world("stream");
    let pictures = [1, 2, 3].map(|seed| picture(64, 40, seed));
    let start = || Rollout::new(&world, &point(&world), 9).expect("a rollout");
    let streaming = || {
        let mut rollout = start();
        rollout.keep_encoder_stream(true).expect("a stream");
        assert!(rollout.keeps_encoder_stream());
        rollout
    };
    let appended = |rollout: &mut Rollout, i: usize| {
        // An encoding without an append changes nothing, and equals what an append would make.
        let encoded = rollout.encode(&pictures[i]).expect("a latent");
        rollout.append(&pictures[i]).expect("an append");
        assert_eq!(rollout.latent().expect("a latent"), encoded);
        encoded
    };
    let latents = |mut rollout: Rollout| [0, 1, 2].map(|i| appended(&mut rollout, i));
    let (fresh, kept) = (latents(start()), latents(streaming()));
    let mut begun_twice = streaming();
    appended(&mut begun_twice, 0);
    begun_twice.keep_encoder_stream(true).expect("a stream");
    assert_eq!(appended(&mut begun_twice, 1), fresh[1], "each call starts the stream anew");
    assert_eq!(fresh[0], kept[0], "both start at zero");
    assert!(fresh[1] != kept[1] && fresh[2] != kept[2]);
    assert_eq!(fresh[2], appended(&mut start(), 2), "without a stream a picture does not depend on earlier ones");

    // The encoder stream is part of a saved state, and a failed append leaves it unchanged.
    let mut rollout = streaming();
    appended(&mut rollout, 0);
    let state = rollout.save().expect("a state");
    assert_eq!(state.len(), rollout.state_len().expect("a length"));
    rollout.stop_flag().store(true, std::sync::atomic::Ordering::SeqCst);
    assert_eq!(rollout.append(&pictures[2]).expect_err("it is stopped").kind(), ErrorKind::Cancelled);
    rollout.stop_flag().store(false, std::sync::atomic::Ordering::SeqCst);
    assert_eq!(appended(&mut rollout, 1), kept[1]);
    let mut other = streaming();
    other.restore(&state).expect("a state");
    assert_eq!([appended(&mut other, 1), appended(&mut other, 2)], [kept[1].clone(), kept[2].clone()]);
    let refused = start().restore(&state).expect_err("it has no stream");
    assert_eq!(refused.offending_field(), Some("state.encoder_stream"), "{refused}");

    // A reset and another stream start without history.
    other.reset().expect("a reset");
    assert_eq!([appended(&mut other, 0), appended(&mut other, 1)], [kept[0].clone(), kept[1].clone()]);
    other.keep_encoder_stream(false).expect("none");
    assert_eq!(appended(&mut other, 2), fresh[2]);
    other.keep_encoder_stream(true).expect("a stream");
    assert_eq!(appended(&mut other, 1), fresh[1]);

    // Moving to another window keeps the stream.
    let options = WorldOptions { global_window: Some(8), precision: Some(Precision::F32), ..Default::default() };
    let narrow = World::load(&worlds::device(), &worlds::bundle("stream"), options).expect("a world");
    let mut moved = streaming();
    appended(&mut moved, 0);
    moved.move_to(&narrow).expect("a narrower world");
    assert_eq!(appended(&mut moved, 1), kept[1]);

    let without = Rollout::new(&worlds::world("tiny"), &point(&world), 1).expect("a rollout").keep_encoder_stream(true);
    assert_eq!(without.expect_err("its encoder has none").kind(), ErrorKind::Unsupported);
}

#[test]
fn every_window_that_divides_by_the_dilation_runs_and_a_wider_one_remembers_more() {
    let (device, bundle) = (worlds::device(), worlds::bundle("tiny"));
    let load = |g| World::load(&device, &bundle, WorldOptions { global_window: Some(g), ..Default::default() });
    // Ages of the latents that affect the next one through the global layers: each slot of the ring is masked in turn.
    let remembered = |g: u32| -> Vec<u64> {
        let world = load(g).expect("a world");
        let geometry = &world.manifest().geometry;
        let (dilation, buckets) = (u64::from(geometry.global.dilation), u64::from(g / geometry.global.dilation));
        let one_pass = OperatingPoint { schedule: Schedule::Explicit(vec![1.0, 0.0]), ..point(&world) };
        let mut rollout = seeded(&world, &one_pass, 2);
        // More latents than the widest window holds, and not at a write step of the global layers.
        steps(&mut rollout, 0..u64::from(WIDEST) + dilation / 2);
        let plan = rollout.planner().plan_step(&controls(77)).expect("a plan");
        let mut noise = vec![0.0; world.latent_len()];
        plan.noise.expect("noise").fill(&mut noise);
        let all = rollout.probe(&plan, 1.0, &noise).expect("a pass").velocity;
        let newest = (rollout.planner().ring_clock() - 1) / dilation;
        let changes = |&age: &u64| {
            let mut less = plan.clone();
            let slot = &mut less.global.visible[((newest - age) % buckets) as usize];
            let was_visible = std::mem::replace(slot, false);
            let without = rollout.probe(&less, 1.0, &noise).expect("a pass").velocity;
            let largest_difference = without.iter().zip(&all).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert_eq!(
                was_visible,
                largest_difference > 1e-6,
                "g{g}, bucket {age} before the newest: {largest_difference}"
            );
            was_visible
        };
        (0..buckets).filter(changes).map(|age| age * dilation).collect()
    };
    assert_eq!(remembered(4), [0]);
    assert_eq!(remembered(16), [0, 4, 8, 12]);
    assert_eq!(remembered(WIDEST), (0..16).map(|bucket| 4 * bucket).collect::<Vec<u64>>());
    for g in [0, 3, 18, 68] {
        let error = load(g).expect_err("no such window");
        assert_eq!(error.kind(), ErrorKind::InvalidArgument, "g{g}: {error}");
    }
}

/// The widest window of the test world, in latents.
const WIDEST: u32 = 64;

#[test]
fn one_two_or_four_pictures_of_a_latent_can_be_read() {
    let world = world("tiny");
    let read = |pictures_per_latent| {
        let mut rollout = seeded(&world, &OperatingPoint { pictures_per_latent, ..point(&world) }, 5);
        steps(&mut rollout, 0..2);
        let pictures: Vec<_> = (0..pictures_per_latent)
            .map(|i| {
                let mut picture = Picture::new(1, 1).expect("a picture");
                rollout.read_picture(i, &mut picture).expect("a picture");
                assert_eq!(picture.size(), world.render_size());
                picture.rgba().to_vec()
            })
            .collect();
        let error =
            rollout.read_picture(pictures_per_latent, &mut Picture::new(1, 1).unwrap()).expect_err("no such picture");
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        pictures
    };
    let all = read(4);
    assert!(all[0] != all[3]);
    assert!(read(2) == [all[1].clone(), all[3].clone()]);
    assert!(read(1) == [all[3].clone()]);
}

#[test]
fn only_the_first_decode_after_a_reset_is_primed() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 5);
    assert_eq!(rollout.statistics().stages.decode.count, 4);
    let first = fingerprint(&mut rollout).expect("bits");
    steps(&mut rollout, 0..2);
    assert_eq!(rollout.statistics().stages.decode.count, 6);
    rollout.reset().expect("a reset");
    assert!(rollout.decoder_memories().expect("memories").iter().flatten().all(|v| *v == 0.0));
    assert_eq!(rollout.latent().expect_err("nothing there").kind(), ErrorKind::InvalidArgument);
    rollout.append(&picture(40, 30, 1)).expect("a seed");
    assert_eq!(rollout.statistics().stages.decode.count, 10);
    assert!(fingerprint(&mut rollout).expect("bits") == first, "a reset rollout is a new one");

    // Without priming the pictures differ; the latent does not.
    let mut plan = Rollout::new(&world, &point(&world), 5).expect("a rollout").planner().plan_append().expect("a plan");
    let latent = rollout.latent().expect("a latent").to_vec();
    plan.prime = 0;
    let mut unprimed = Rollout::new(&world, &point(&world), 5).expect("a rollout");
    unprimed.execute_append(&plan, &latent).expect("an append");
    assert!(unprimed.decoded().expect("pictures") != rollout.decoded().expect("pictures"));
}

#[test]
fn schedules_of_any_length_give_the_euler_steps_result() {
    let world = world("tiny");
    for points in [vec![1.0, 0.0], vec![1.0, 0.5, 0.0], vec![1.0, 0.9, 0.5, 0.0]] {
        let passes = points.len() as u64 - 1;
        let mut rollout = seeded(&world, &OperatingPoint { schedule: Schedule::Explicit(points), ..point(&world) }, 5);
        let plan = rollout.planner().plan_step(&ControlInput::IDLE).expect("a plan");
        // The same Euler steps, computed here.
        let mut x = vec![0.0; world.latent_len()];
        plan.noise.expect("noise").fill(&mut x);
        for (&sigma, &dsigma) in plan.sigmas.iter().zip(&plan.dsigmas) {
            let probe = rollout.probe(&plan, sigma, &x).expect("a pass");
            x.iter_mut().zip(&probe.velocity).for_each(|(x, v)| *x += dsigma * v);
        }
        let info = rollout.step(&ControlInput::IDLE).expect("a step");
        assert_eq!(info.stages.denoise.count, passes);
        let norm = x.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
        let latent = rollout.latent().expect("a latent");
        let error = x.iter().zip(latent).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
        assert!(error < 1e-5 * norm, "{passes} passes: {error} of {norm}");
    }
}

#[test]
fn single_and_half_precision_agree() {
    let (device, bundle) = (worlds::device(), worlds::bundle("tiny"));
    let load = |precision| {
        World::load(&device, &bundle, WorldOptions { precision: Some(precision), ..Default::default() })
            .expect("a world")
    };
    let (single, half) = (load(cairn::bundle::Precision::F32), load(cairn::bundle::Precision::F16));
    let (mut a, mut b) = (seeded(&single, &point(&single), 1), seeded(&half, &point(&half), 1));
    let latent = a.latent().expect("a latent").to_vec();
    let distance = |a: &[f32], b: &[f32]| {
        let norm: f64 = a.iter().map(|v| f64::from(*v).powi(2)).sum();
        (a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / norm).sqrt()
    };
    assert!(distance(&latent, b.latent().expect("a latent")) < 1e-2);
    let plan = a.planner().plan_step(&controls(1)).expect("a plan");
    let (v, w) = (a.probe(&plan, 0.9, &latent).expect("a pass"), b.probe(&plan, 0.9, &latent).expect("a pass"));
    assert!(distance(&v.velocity, &w.velocity) < 1e-2, "{}", distance(&v.velocity, &w.velocity));
    assert_eq!(b.ring_bytes(0, KvPart::Keys).unwrap().len() * 2, a.ring_bytes(0, KvPart::Keys).unwrap().len());
    b.step(&controls(1)).expect("a step");
}

#[test]
fn noise_levels_may_change_between_latents_and_are_saved() {
    let world = world("tiny");
    let few = Schedule::Explicit(vec![1.0, 0.5, 0.0]);
    let mut rollout = seeded(&world, &point(&world), 7);
    steps(&mut rollout, 0..2);
    rollout.set_schedule(&few).expect("a schedule");
    let info = rollout.step(&controls(2)).expect("a step");
    assert_eq!(info.stages.denoise.count, 2);
    assert_eq!(rollout.operating_point().schedule, few);
    let state = rollout.save().expect("a state");
    steps(&mut rollout, 3..5);
    // A rollout that continues from the state has the noise levels of that time.
    let mut again = seeded(&world, &point(&world), 1);
    again.restore(&state).expect("a state of this world");
    assert_eq!(again.operating_point(), rollout.operating_point());
    steps(&mut again, 3..5);
    assert!(fingerprint(&mut again).expect("bits") == fingerprint(&mut rollout).expect("bits"));
    // A rollout that was created with them has them from the start.
    let refused = rollout.set_schedule(&Schedule::Explicit(vec![0.5, 1.0])).expect_err("levels that rise");
    assert_eq!((refused.kind(), &rollout.operating_point().schedule), (ErrorKind::InvalidArgument, &few));
}

#[test]
fn a_time_budget_reduces_the_number_of_passes() {
    const HOUR: Duration = Duration::from_secs(3600);
    let world = world("tiny");
    let schedules = [Schedule::Stock, Schedule::Explicit(vec![1.0, 0.5, 0.0]), Schedule::Explicit(vec![1.0, 0.0])];
    let mut rollout = seeded(&world, &point(&world), 7);
    let passes = |rollout: &mut Rollout, count: u64| -> Vec<u64> {
        let one = |i| rollout.step(&controls(i)).expect("a step").stages.denoise.count;
        (0..count).map(one).collect()
    };
    rollout.set_budget(HOUR, &schedules).expect("a budget");
    assert_eq!(passes(&mut rollout, 7), [4; 7], "the budget is large");
    rollout.set_budget(Duration::from_nanos(1), &schedules).expect("a budget");
    assert_eq!(passes(&mut rollout, 6), [4, 4, 4, 1, 1, 1], "the budget is too small");
    assert_eq!(rollout.operating_point().schedule, schedules[2]);
    // The budget ends at the current setting, and on restoring another state.
    rollout.set_budget(HOUR, &[]).expect("no budget");
    assert_eq!(passes(&mut rollout, 4), [1; 4]);
    let state = rollout.save().expect("a state");
    rollout.set_budget(HOUR, &schedules).expect("a budget");
    rollout.restore(&state).expect("a state");
    assert_eq!(passes(&mut rollout, 4), [1; 4]);
    for (wrong, field) in [
        (rollout.set_budget(Duration::ZERO, &schedules), "per_latent"),
        (rollout.set_budget(HOUR, &[schedules[1].clone(), schedules[0].clone()]), "schedules"),
        (rollout.set_budget(HOUR, &vec![Schedule::Stock; 9]), "schedules"),
    ] {
        assert_eq!(wrong.expect_err("it is refused").offending_field(), Some(field));
    }
}
