//! Saved states continue bit for bit, also in another process. Damaged states, and states of other worlds, are refused.

use std::process::Command;

use cairn::ErrorKind;
use cairn::bundle::Precision;
use cairn::world::{OperatingPoint, Rollout, World, WorldOptions};
use sha2::{Digest, Sha256};
use test_support::fuzz_targets::{self, seeds};
use test_support::mutator::Mutator;
use test_support::worlds::{self, controls, fingerprint, picture, point, seeded, world};

/// Number of latents: both rings wrap, unless `CAIRN_TEST_SHORT` asks for a few.
fn latents() -> u64 {
    if is_short() { 6 } else { 18 }
}

/// Whether to run a few latents only.
fn is_short() -> bool {
    std::env::var_os("CAIRN_TEST_SHORT").is_some()
}

/// The bits of the rest of the run, from latent `from` on.
fn rest(rollout: &mut Rollout, from: u64) -> Vec<u8> {
    let mut bits = fingerprint(rollout).expect("bits");
    for i in from..latents() {
        rollout.step(&controls(i)).expect("a step");
        bits.extend(rollout.latent().expect("a latent").iter().flat_map(|v| v.to_bits().to_le_bytes()));
    }
    bits.extend(fingerprint(rollout).expect("bits"));
    bits
}

#[test]
fn a_restored_rollout_continues_bit_for_bit() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 11);
    let mut states = vec![(0, rollout.save().expect("a state"))];
    for i in 0..latents() {
        rollout.step(&controls(i)).expect("a step");
        // On and off a write step of the global layers, before and after both rings wrap.
        let saved: &[u64] = if is_short() { &[0, 3, 4] } else { &[0, 1, 3, 4, 15, 16] };
        if saved.contains(&i) {
            states.push((i + 1, rollout.save().expect("a state")));
        }
    }
    let end = fingerprint(&mut rollout).expect("bits");
    // A rollout with another seed, operating point and history takes over the whole state.
    let mut other = seeded(&world, &OperatingPoint { pictures_per_latent: 4, ..point(&world) }, 99);
    for (from, state) in states {
        other.append(&picture(9, 9, 2)).expect("an append");
        other.restore(&state).expect("a state");
        assert!(other.save().expect("a state") == state, "the restored rollout saves the same state");
        for i in from..latents() {
            other.step(&controls(i)).expect("a step");
        }
        assert!(fingerprint(&mut other).expect("bits") == end, "from latent {from}");
    }
}

#[test]
fn a_state_can_be_saved_before_the_first_latent() {
    let world = world("tiny");
    let state = Rollout::new(&world, &point(&world), 11).expect("a rollout").save().expect("a state");
    let mut other = seeded(&world, &point(&world), 12);
    other.restore(&state).expect("a state");
    assert_eq!(other.latent().expect_err("nothing there").kind(), ErrorKind::InvalidArgument);
    other.append(&picture(40, 30, 1)).expect("a seed");
    assert!(fingerprint(&mut other).unwrap() == fingerprint(&mut seeded(&world, &point(&world), 11)).unwrap());
}

/// This test starts itself as a second process, with a state to continue.
#[test]
fn a_state_continues_bit_for_bit_in_another_process() {
    const VARIABLE: &str = "CAIRN_TEST_STATE";
    let world = world("tiny");
    if let Some(path) = std::env::var_os(VARIABLE) {
        let mut rollout = Rollout::new(&world, &point(&world), 0).expect("a rollout");
        rollout.restore(&std::fs::read(&path).expect("the state")).expect("a state");
        let bits = rest(&mut rollout, latents() / 3);
        std::fs::write(&path, Sha256::digest(&bits)).expect("a file");
        return;
    }
    let mut rollout = seeded(&world, &point(&world), 21);
    for i in 0..latents() / 3 {
        rollout.step(&controls(i)).expect("a step");
    }
    let path = std::env::temp_dir().join(format!("cairn-state-{}", std::process::id()));
    std::fs::write(&path, rollout.save().expect("a state")).expect("a file");
    let child = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "a_state_continues_bit_for_bit_in_another_process"])
        .env(VARIABLE, &path)
        .output()
        .expect("a second process");
    let answer = std::fs::read(&path).expect("the answer");
    std::fs::remove_file(&path).expect("the file is removed");
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stdout));
    assert_eq!(answer, Sha256::digest(rest(&mut rollout, latents() / 3)).as_slice());
}

/// `state` with a correct checksum.
fn with_checksum(mut state: Vec<u8>) -> Vec<u8> {
    let body = state.len() - 32;
    let checksum = Sha256::digest(&state[..body]);
    state[body..].copy_from_slice(&checksum);
    state
}

#[test]
fn damaged_states_are_refused_and_leave_the_rollout_unchanged() {
    let world = world("tiny");
    let mut rollout = seeded(&world, &point(&world), 1);
    rollout.step(&controls(0)).expect("a step");
    let state = rollout.save().expect("a state");
    rollout.step(&controls(1)).expect("a step");
    let before = fingerprint(&mut rollout).expect("bits");
    let mut refused = |bytes: &[u8], what: &str| {
        let error = rollout.restore(bytes).expect_err(what);
        assert!(matches!(error.kind(), ErrorKind::InvalidState | ErrorKind::Unsupported), "{what}: {error}");
        assert!(error.offending_field().is_some_and(|field| field.starts_with("state")), "{what}: {error}");
        error
    };
    for len in (0..400).chain([state.len() / 2, state.len() - 33, state.len() - 32, state.len() - 1]) {
        refused(&state[..len], "cut short");
    }
    refused(&[&state[..], &[0]].concat(), "too long");
    // Bits of the header, of the planner's state, and of samples of the memory.
    for at in (0..600).chain((600..state.len()).step_by(state.len() / 37)) {
        let mut flipped = state.clone();
        flipped[at] ^= 1 << (at % 8);
        refused(&flipped, "a flipped bit");
    }
    // With a correct checksum, the contents are checked.
    let mut newer = state.clone();
    newer[8] = 2;
    assert_eq!(refused(&with_checksum(newer), "a newer version").kind(), ErrorKind::Unsupported);
    for len in [u32::MAX, state.len() as u32, 0, 1] {
        let mut wrong = state.clone();
        wrong[12..16].copy_from_slice(&len.to_le_bytes());
        refused(&with_checksum(wrong), "a wrong length");
    }
    let middle = (state.len() / 2) & !3;
    let mut poisoned = state.clone();
    // Eight bytes cover a whole number at any alignment.
    poisoned[middle..middle + 8].fill(0xff);
    assert!(refused(&with_checksum(poisoned), "a NaN").to_string().contains("not finite"));
    refused(&with_checksum(state[..state.len() - 4].to_vec()), "four bytes less");
    refused(&with_checksum([&state[..], &[0; 4]].concat()), "four bytes more");
    // A header that is not JSON, and one with members that this version does not know.
    let head_len = u32::from_le_bytes(state[12..16].try_into().unwrap()) as usize;
    let head = String::from_utf8(state[16..16 + head_len].to_vec()).expect("JSON");
    for wrong in [
        "{}".to_owned(),
        "[".repeat(100_000),
        head.replacen('{', "{\"extra\":1,", 1),
        head.replace("separate", "thrice"),
    ] {
        let bytes =
            [&state[..12], &(wrong.len() as u32).to_le_bytes(), wrong.as_bytes(), &state[16 + head_len..]].concat();
        refused(&with_checksum(bytes), "a wrong head");
    }
    assert!(fingerprint(&mut rollout).expect("bits") == before);
    rollout.restore(&state).expect("the undamaged state");
}

#[test]
fn states_of_another_world_are_refused() {
    let tiny = world("tiny");
    let mut rollout = seeded(&tiny, &point(&tiny), 1);
    let before = fingerprint(&mut rollout).expect("bits");
    let window = world("window");
    let (device, bundle) = (worlds::device(), worlds::bundle("tiny"));
    let load = |options| World::load(&device, &bundle, options).expect("a world");
    // In f32 like the first world, which is not every device's default.
    let wider = load(WorldOptions { global_window: Some(32), precision: Some(Precision::F32), ..Default::default() });
    let half = load(WorldOptions { precision: Some(Precision::F16), ..Default::default() });
    for (other, field) in [(window, "state.bundle"), (wider, "state.operating_point"), (half, "state.precision")] {
        let state = seeded(&other, &point(&other), 1).save().expect("a state");
        let error = rollout.restore(&state).expect_err("foreign");
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidState, Some(field)), "{error}");
    }
    assert!(fingerprint(&mut rollout).expect("bits") == before);
}

#[test]
fn seeded_mutations_of_states_are_refused_or_restored_whole() {
    let seeds = seeds::saved_state();
    let mut mutator = Mutator(1);
    let mut refused = 0;
    for seed in &seeds {
        assert!(fuzz_targets::saved_state(seed), "a seed is a state of this world");
        let mutations = if is_short() { 10 } else { 100 };
        refused += (0..mutations).filter(|_| !fuzz_targets::saved_state(&mutator.mutate(seed, &seeds))).count();
    }
    assert!(refused > seeds.len(), "only {refused} mutations were refused");
}
