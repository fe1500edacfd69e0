//! Worlds on DirectML give the CPU provider's results, repeat bit for bit, continue from saved states, and report every non-finite number.
//! On Windows, or in the lab.
#![cfg(windows)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use cairn::bundle::Precision;
use cairn::gpu::windows::Win32::Foundation::{E_OUTOFMEMORY, S_OK};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COMMON;
use cairn::gpu::{Gpu, read_texture};
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{KeptAnchor, KvPart, OperatingPoint, Rollout, Schedule, World, WorldOptions};
use cairn::{ErrorKind, Picture};
use test_support::child_test::run_test;
use test_support::worlds::{self, bundle, controls, fingerprint, ort, point, relative_error, seeded};

mod lost_device;
mod queue_events;

fn directml(precision: Precision, profile: Option<PathBuf>) -> Arc<World> {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let options = DirectMlOptions { deterministic: true, profile, ..Default::default() };
    let device = Device::directml(&ort(), &gpu, options).expect("DirectML");
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
        let info = rollout.step(&controls(i)).expect("a step");
        assert_eq!((info.bytes.read, info.bytes.uploaded > 0), (0, true), "a step reads nothing back");
    }
}

/// A folder that is removed on drop.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("cairn-directml-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder");
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The number of nodes that ran on each provider, from ONNX Runtime's profiles of all sessions.
fn nodes_by_provider(folder: &Path) -> BTreeMap<String, u64> {
    let mut counts = BTreeMap::new();
    for file in std::fs::read_dir(folder).expect("the folder") {
        let bytes = std::fs::read(file.expect("a file").path()).expect("a profile");
        let events: Vec<serde_json::Value> = serde_json::from_slice(&bytes).expect("a whole profile");
        for provider in events.iter().filter_map(|event| event["args"]["provider"].as_str()) {
            *counts.entry(provider.to_owned()).or_default() += 1;
        }
    }
    counts
}

#[test]
fn a_single_non_finite_number_is_found_at_any_position() {
    let world = directml(Precision::F16, None);
    let mut rollout = seeded(&world, &point(&world), 7);
    let before = fingerprint(&mut rollout).expect("bits");
    let mut latent = rollout.latent().expect("a latent").to_vec();
    for at in [0, 1, latent.len() / 2, latent.len() - 1] {
        // A float that becomes infinite as a half float.
        let kept = std::mem::replace(&mut latent[at], 1e30);
        let refused = rollout.append_latent(&latent).expect_err("the latent is invalid");
        assert_eq!(refused.kind(), ErrorKind::Device);
        assert!(refused.to_string().contains("latent 1 came out with a number that is not finite"), "{at}: {refused}");
        latent[at] = kept;
    }
    assert!(fingerprint(&mut rollout).expect("bits") == before, "the rollout is unchanged");
    rollout.append_latent(&latent).expect("all numbers are finite");
}

#[test]
fn a_latent_equals_the_cpu_providers() {
    for (precision, bound) in [(Precision::F32, 1e-4), (Precision::F16, 1e-2)] {
        let truth = latent(&load(&worlds::device(), precision));
        let folder = Folder::new(&format!("{precision:?}"));
        let found = latent(&directml(precision, Some(folder.0.join("nodes"))));
        let nodes = nodes_by_provider(&folder.0);
        assert!(nodes.get("DmlExecutionProvider").is_some_and(|count| *count >= 3), "nodes of three graphs: {nodes:?}");
        assert_eq!(nodes.len(), 1, "every node runs on DirectML: {nodes:?}");
        let error = relative_error(&found, &truth);
        assert!(error <= bound, "{precision:?}: a relative error of {error:e}");
        assert!(
            error > 0.0,
            "{precision:?}: the providers differ in rounding, so equal bits mean that one of them did not run"
        );
    }
}

#[test]
fn weights_in_8_and_4_bits_run_on_the_device() {
    // One pass: the lab emulates the device.
    let latent = |world: &Arc<World>| {
        let schedule = Schedule::Explicit(vec![0.45, 0.0]);
        let mut rollout = seeded(world, &OperatingPoint { schedule, ..point(world) }, 7);
        steps(&mut rollout, 0..1);
        rollout.latent().expect("a latent").to_vec()
    };
    for (name, bound) in [("miniature-8bit", 1e-2), ("miniature-4bit", 1e-2)] {
        let world = |device: &Device| {
            let options = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
            World::load(device, &bundle(name), options).expect("a world")
        };
        let truth = latent(&world(&worlds::device()));
        let folder = Folder::new(name);
        let gpu = Gpu::on_adapter(None).expect("a device");
        let profile = Some(folder.0.join("nodes"));
        let options = DirectMlOptions { deterministic: true, profile, ..Default::default() };
        let found = latent(&world(&Device::directml(&ort(), &gpu, options).expect("DirectML")));
        let nodes = nodes_by_provider(&folder.0);
        assert_eq!(nodes.keys().collect::<Vec<_>>(), ["DmlExecutionProvider"], "every node runs on DirectML");
        let error = relative_error(&found, &truth);
        assert!(error > 0.0 && error <= bound, "{name}: a relative error of {error:e} from the CPU provider's");
    }
}

#[test]
fn a_rollout_repeats_bit_for_bit_also_from_a_saved_state() {
    let world = directml(Precision::F16, None);
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

/// ONNX Runtime's provider keeps a session's lists and buffers without locks.
#[test]
fn rollouts_of_one_world_step_at_the_same_time() {
    let world = directml(Precision::F16, None);
    let rollout = |seed| {
        let mut rollout = seeded(&world, &point(&world), seed);
        steps(&mut rollout, 0..4);
        fingerprint(&mut rollout).expect("bits")
    };
    let alone = [7, 8, 9].map(rollout);
    let together = std::thread::scope(|scope| {
        let started = [7, 8, 9].map(|seed| scope.spawn(move || rollout(seed)));
        started.map(|thread| thread.join().expect("a rollout"))
    });
    assert!(alone == together, "each has its own bits");
}

#[test]
fn passes_are_timed_on_the_device_and_named_on_the_queue() {
    let world = directml(Precision::F16, None);
    let mut rollout = seeded(&world, &point(&world), 7);
    // Waits for the commit of the seed, whose time is then known.
    rollout.latent().expect("a latent");
    let before = rollout.device_times().expect("a Direct3D 12 device");
    let queue = world.device().gpu().expect("a Direct3D 12 device").anchors().d3d12().clone();
    queue_events::record_events(&queue);
    queue_events::take_names(&queue);
    let start = std::time::Instant::now();
    steps(&mut rollout, 0..2);
    // The names that GPU profiling tools show.
    let [controls, pass, decode] = ["controls", "transformer", "decoder"];
    let [check, commit] = ["check for NaN and infinity", "commit"];
    let names_of_a_step =
        [controls, pass, pass, pass, pass, pass, decode, check, commit].map(|name| format!("Cairn: {name}"));
    assert_eq!(queue_events::take_names(&queue), [names_of_a_step.clone(), names_of_a_step].concat());
    // Waits for all submitted work, including the last commit.
    rollout.latent().expect("a latent");
    rollout.ring_bytes(0, KvPart::Keys).expect("a ring");
    let elapsed = start.elapsed();
    let after = rollout.device_times().expect("a Direct3D 12 device");
    let [encode, passes, decode, commit] = [
        (after.encode, before.encode),
        (after.passes, before.passes),
        (after.decode, before.decode),
        (after.commit, before.commit),
    ]
    .map(|(after, before)| (after.count - before.count, after.total - before.total));
    assert_eq!(
        (encode.0, passes.0, decode.0, commit.0),
        (0, 2 * 5, 2, 2),
        "four denoise passes, one cache pass, a decode and a commit, each step"
    );
    for (count, total) in [passes, decode, commit] {
        assert!(count > 0 && !total.is_zero(), "{count} of them took {total:?}");
    }
    let all = passes.1 + decode.1 + commit.1;
    assert!(all <= elapsed, "one after the other on one queue: {all:?} within {elapsed:?}");
    assert!(after.passes.longest >= after.passes.last && after.passes.total >= after.passes.longest, "{after:?}");
    let captured = rollout.capture_statistics().expect("a Direct3D 12 device");
    assert_eq!(captured.reason.as_deref(), Some("the device is deterministic"), "{captured:?}");
    // The processor has no such timer.
    let cpu = load(&worlds::device(), Precision::F32);
    let mut rollout = Rollout::new(&cpu, &point(&cpu), 1).expect("a rollout");
    assert_eq!((rollout.device_times(), rollout.capture_statistics()), (None, None));
}

#[test]
fn a_submission_limit_yields_the_queue_between_passes() {
    let world = directml(Precision::F16, None);
    let options = world.device().directml_options().expect("DirectML");
    let yields = |longest_submission| {
        let options = DirectMlOptions { longest_submission, ..options.clone() };
        world.device().set_directml_options(options).expect("DirectML");
        let mut rollout = seeded(&world, &point(&world), 7);
        steps(&mut rollout, 0..1);
        let before = rollout.device_times().expect("a Direct3D 12 device").external.yields;
        steps(&mut rollout, 1..2);
        let after = rollout.device_times().expect("a Direct3D 12 device").external.yields;
        (after - before, fingerprint(&mut rollout).expect("bits"))
    };
    let (none, tight, wide) =
        (yields(None), yields(Some(Duration::from_nanos(1))), yields(Some(Duration::from_secs(3600))));
    // The embedding of controls, five passes and the decoder: before each but the first.
    assert_eq!((none.0, tight.0, wide.0), (0, 6, 0));
    assert!(none.1 == tight.1 && none.1 == wide.1, "the same bits");
    assert!(worlds::device().set_directml_options(options).is_err(), "the processor has none");
}

#[test]
fn slices_yield_the_queue_within_a_pass() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let options = DirectMlOptions { deterministic: true, ..Default::default() };
    let device = Device::directml(&ort(), &gpu, options).expect("DirectML");
    let bundle = bundle("tiny");
    // One world at a time: each session takes memory of the device.
    let run = |slices, longest_submission| {
        let precision = Some(Precision::F16);
        let options = WorldOptions { precision, slices, longest_submission, ..WorldOptions::default() };
        let world = World::load(&device, &bundle, options).expect("a world");
        let mut rollout = seeded(&world, &point(&world), 7);
        steps(&mut rollout, 0..1);
        rollout.latent().expect("a latent");
        let before = rollout.device_times().expect("a Direct3D 12 device");
        steps(&mut rollout, 1..2);
        let bits = fingerprint(&mut rollout).expect("bits");
        let after = rollout.device_times().expect("a Direct3D 12 device");
        assert_eq!(after.passes.count - before.passes.count, 5, "passes, not slices");
        (bits, world.slices(), world.longest_slice(), after.external.yields - before.external.yields)
    };
    let (whole, slices, longest, yields) = run(None, None);
    assert_eq!((slices, longest, yields), (1, None, 0));
    let (bits, slices, longest, yields) = run(Some(4), None);
    assert_eq!((slices, longest, yields), (4, None, 0));
    assert!(bits == whole, "the same bits in four slices");
    // No slice takes so little, so every layer is one, and each waits for what is before it: the embedding of controls, five passes, the decoder.
    let (bits, slices, longest, yields) = run(None, Some(Duration::from_nanos(1)));
    let layers = bundle.geometry().layers;
    assert_eq!((slices, yields), (layers, 5 * u64::from(layers) + 1));
    assert!(longest.is_some_and(|longest| !longest.is_zero()), "a measured time");
    assert!(bits == whole, "the same bits in a slice for each layer");
}

#[test]
fn captured_passes_give_the_same_bits_and_others_report_the_reason() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let world = |captured_passes| {
        let options = DirectMlOptions { captured_passes, ..DirectMlOptions::default() };
        load(&Device::directml(&ort(), &gpu, options).expect("DirectML"), Precision::F16)
    };
    let run = |world: &Arc<World>| {
        let mut rollout = seeded(world, &point(world), 7);
        steps(&mut rollout, 0..4);
        (fingerprint(&mut rollout).expect("bits"), rollout.capture_statistics().expect("a Direct3D 12 device"))
    };
    let (truth, off) = run(&world(0));
    assert_eq!(
        (off.used, off.unproven, off.unused),
        (0, 0, 6),
        "encoder, controls, and transformer and decoder both ways"
    );
    assert_eq!(off.reason.as_deref(), Some("it is turned off"));

    let world = world(2);
    let (bits, captured) = run(&world);
    assert!(bits == truth, "the same bits: {captured:?}");
    assert_eq!((captured.used, captured.unused), (5, 0), "all that ran often enough: {captured:?}");
    let (bits, captured) = run(&world);
    assert!(bits == truth, "the same bits: {captured:?}");
    // Of each graph as many are captured as may be. The first rollout took them, but for one of the graph that embeds controls, which has one each.
    assert_eq!((captured.used, captured.unused), (1, 4), "{captured:?}");
    assert!(captured.reason.is_some_and(|why| why.contains("as many passes are captured as may be")));
}

#[test]
fn an_anchor_stays_on_the_device_until_it_is_read() {
    let world = directml(Precision::F16, None);
    let mut rollout = seeded(&world, &point(&world), 7);
    let gpu = world.device().gpu().expect("a Direct3D 12 device").clone();
    let bytes_read = |rollout: &Rollout| rollout.statistics().bytes.read;
    let before = bytes_read(&rollout);
    steps(&mut rollout, 0..1);
    let anchor = KeptAnchor::of(&mut rollout, false).expect("an anchor");
    let shown = |i| {
        let (texture, fence_point) = anchor.texture(i).expect("a texture");
        fence_point.wait().expect("it is there");
        read_texture(&gpu, texture, D3D12_RESOURCE_STATE_COMMON).expect("a picture")
    };
    let pictures: Vec<_> = (0..anchor.count()).map(shown).collect();
    assert!(anchor.texture(anchor.count()).is_none(), "there is no more");
    assert_eq!(bytes_read(&rollout), before, "a host has the pictures, and nothing was read back for them");

    // The rollout continues, and the anchor does not change.
    let mut expected = Vec::new();
    for i in 0..anchor.count() {
        let mut picture = Picture::new(1, 1).expect("a picture");
        rollout.read_picture(i as u32, &mut picture).expect("a picture");
        expected.push(picture);
    }
    let latent = rollout.latent().expect("a latent").to_vec();
    steps(&mut rollout, 1..2);
    let before = bytes_read(&rollout);
    for (i, (texture, expected)) in pictures.iter().zip(&expected).enumerate() {
        let read = anchor.read(i).expect("a picture");
        assert!(read == texture && std::ptr::eq(read, anchor.read(i).expect("again")), "the texture, read once");
        let apart = read.rgba().iter().zip(expected.rgba()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(apart <= Some(1), "picture {i} is {apart:?} steps of 255 from the processor's");
    }
    assert!(anchor.latent().expect("a latent") == latent, "the latent's bits");
    let bytes: usize = expected.iter().map(|picture| picture.rgba().len()).sum();
    assert_eq!(bytes_read(&rollout) - before, (bytes + 2 * latent.len()) as u64, "what was read is counted");
}

/// This test starts itself as a second process: libraries that are loaded stay.
#[test]
fn a_directml_that_the_engine_has_loaded_does_not_matter() {
    const VARIABLE: &str = "CAIRN_TEST_DIRECTML";
    if let Some(path) = std::env::var_os(VARIABLE) {
        // SAFETY: runs the initialisers of Microsoft's own library.
        std::mem::forget(unsafe { libloading::Library::new(&path) }.expect("it loads"));
        let world = directml(Precision::F16, None);
        assert!(latent(&world).iter().all(|value| value.is_finite()));
        return;
    }
    // An older one would lack something else; this one lacks what every device is made by.
    let mut bytes = std::fs::read(ort().path().with_file_name("DirectML.dll")).expect("the library");
    let name = b"DMLCreateDevice1\0";
    let at = bytes.windows(name.len()).position(|text| text == name).expect("its name among the exports");
    bytes[at + name.len() - 2] = b'X';
    let folder = Folder::new("an engine's");
    let path = folder.0.join("DirectML.dll");
    std::fs::write(&path, bytes).expect("a copy");
    run_test("a_directml_that_the_engine_has_loaded_does_not_matter", |command| {
        command.env(VARIABLE, &path);
    });
}

/// A device of DirectML can be lost alone; then calls on it and on what was made of it do nothing.
#[test]
fn a_lost_device_of_directml_is_reported() {
    const VARIABLE: &str = "CAIRN_TEST_LOST_DIRECTML";
    if std::env::var_os(VARIABLE).is_none() {
        run_test("a_lost_device_of_directml_is_reported", |command| {
            command.env(VARIABLE, "1");
        });
        return;
    }
    let world = directml(Precision::F16, None);
    let mut rollout = seeded(&world, &point(&world), 7);
    steps(&mut rollout, 0..1);
    let before = fingerprint(&mut rollout).expect("a state");
    lost_device::install(world.device().gpu().expect("a Direct3D device"));
    lost_device::lose(E_OUTOFMEMORY);
    let failed = rollout.step(&controls(1)).expect_err("it is lost");
    assert_eq!(failed.kind(), ErrorKind::DeviceRemoved, "{failed}");
    assert!(failed.to_string().contains("DirectML") && failed.to_string().contains("0x8007000e"), "{failed}");
    let options = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
    let failed = World::load(world.device(), &bundle("tiny"), options).expect_err("it is lost");
    assert_eq!(failed.kind(), ErrorKind::DeviceRemoved, "{failed}");
    // Nothing of the failed step is left.
    lost_device::lose(S_OK);
    assert_eq!(fingerprint(&mut rollout).expect("a state"), before);
    steps(&mut rollout, 1..2);
}
