//! Worlds on ONNX Runtime's WebGPU provider give the CPU provider's results, repeat bit for bit, continue saved states of the processor, and
//! report every number that is not finite. In the lab, with the driver by which the processor emulates an adapter: `cargo xtask test webgpu`.
#![cfg(target_os = "linux")]

use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use cairn::bundle::{Bundle, OpenOptions, Precision};
use cairn::runtime::{CpuOptions, Device, DeviceKind, WebGpuOptions, webgpu_adapters};
use cairn::world::{Bilinear, KvPart, OperatingPoint, Rollout, Schedule, World, WorldOptions};
use cairn::{Error, ErrorKind, LibrarySearch, Picture};
use serde_json::Value;
use test_support::child_test::run_test;
use test_support::worlds::{self, bundle, controls, fingerprint, ort, point, relative_error, seeded, webgpu};

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

/// The first latent of a rollout, by one pass: the processor emulates the adapter.
fn latent(world: &Arc<World>) -> Vec<f32> {
    let schedule = Schedule::Explicit(vec![0.45, 0.0]);
    let mut rollout = seeded(world, &OperatingPoint { schedule, ..point(world) }, 7);
    steps(&mut rollout, 0..1);
    rollout.latent().expect("a latent").to_vec()
}

#[test]
fn latents_of_each_world_are_near_the_cpu_providers() {
    let embedded = Bundle::embedded(&OpenOptions::default()).expect("it");
    let (f32, f16) = ((Precision::F32, 1e-4), (Precision::F16, 1e-2));
    let all: [(_, &[_]); 5] = [
        (bundle("tiny"), &[f32, f16]),
        (bundle("demo"), &[f32, f16]),
        (embedded, &[f32, f16]),
        (bundle("miniature-8bit"), &[f16]),
        (bundle("miniature-4bit"), &[f16]),
    ];
    for (bundle, precisions) in all {
        for (precision, bound) in precisions {
            let options = WorldOptions { precision: Some(*precision), ..WorldOptions::default() };
            let truth = latent(&World::load(&worlds::device(), &bundle, options.clone()).expect("a world"));
            let found =
                latent(&World::load(&webgpu(), &bundle, options).expect("a world with every node on the adapter"));
            let error = relative_error(&found, &truth);
            let what = format!("{}, {precision:?}: a relative error of {error:e}", bundle.manifest().name);
            println!("{what}");
            assert!(error <= *bound, "{what}");
            assert!(error > 0.0, "{what}: equal bits mean that one of the providers did not run");
        }
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

#[test]
fn a_state_moves_between_the_processor_and_the_adapter() {
    let [cpu, gpu] = [worlds::device(), webgpu()].map(|device| load(&device, "tiny", Precision::F32));
    for (from, to) in [(&cpu, &gpu), (&gpu, &cpu)] {
        let mut rollout = seeded(from, &point(from), 7);
        steps(&mut rollout, 0..2);
        let saved = rollout.save().expect("a state");
        let mut moved = Rollout::new(to, &point(to), 1).expect("a rollout");
        moved.restore(&saved).expect("the state fits");
        assert!(moved.save().expect("a state") == saved, "every byte has moved");
        for rollout in [&mut rollout, &mut moved] {
            steps(rollout, 2..4);
        }
        let error = relative_error(moved.latent().expect("a latent"), rollout.latent().expect("a latent"));
        assert!(error > 0.0 && error <= 1e-4, "both go on alike: a relative error of {error:e}");
    }
}

#[test]
fn a_single_number_that_is_not_finite_is_found_at_any_position() {
    let world = load(&webgpu(), "tiny", Precision::F16);
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
fn only_controls_go_up_and_one_picture_comes_down() {
    let world = load(&webgpu(), "tiny", Precision::F16);
    let mut rollout = seeded(&world, &point(&world), 7);
    steps(&mut rollout, 0..1);
    let uploaded = rollout.step(&controls(1)).expect("a step").bytes.uploaded;
    let geometry = &world.manifest().geometry;
    let ring = rollout.ring_bytes(0, KvPart::Keys).expect("a ring").len() as u64 * 2 * u64::from(geometry.layers);
    assert!(uploaded < ring / 2, "{uploaded} bytes went up; the rings have {ring}");
    let mut picture = Picture::new(1, 1).expect("a picture");
    let before = rollout.statistics().bytes.read;
    rollout.read_picture(0, &mut picture).expect("a picture");
    assert_eq!(picture.size(), world.render_size());
    let read = rollout.statistics().bytes.read - before;
    assert_eq!(
        read,
        picture.rgba().len() as u64,
        "the picture came down with 8 bits for each channel, and nothing else"
    );
}

#[test]
fn the_adapter_resizes_pictures_as_the_processor_does() {
    // A whole latent has several pictures; the decoder's sides take turns.
    for precision in [Precision::F32, Precision::F16] {
        let world = load(&webgpu(), "tiny", precision);
        let every =
            OperatingPoint { pictures_per_latent: world.manifest().geometry.autoencoder.temporal, ..point(&world) };
        let mut rollout = seeded(&world, &every, 7);
        for i in 0..3 {
            steps(&mut rollout, i..i + 1);
            let decoded = rollout.decoded().expect("planes");
            let resize = Bilinear::new(world.decoded_size(), world.render_size());
            let [mut found, mut expected] =
                [world.render_size(); 2].map(|(w, h)| Picture::new(w, h).expect("a picture"));
            let mut seen = Vec::new();
            for (k, planes) in (0..).zip(decoded.chunks_exact(decoded.len() / every.pictures_per_latent as usize)) {
                rollout.read_picture(k, &mut found).expect("a picture");
                resize.to_picture(planes, &mut expected);
                let apart = found.rgba().iter().zip(expected.rgba()).map(|(a, b)| a.abs_diff(*b)).max();
                assert!(apart <= Some(1), "{precision:?}, latent {i}, picture {k}: {apart:?} steps of 255 apart");
                assert!(!seen.contains(&found), "pictures differ");
                seen.push(found.clone());
            }
        }
    }
}

#[test]
fn two_rollouts_on_two_threads_take_turns() {
    let device = webgpu();
    let world = load(&device, "tiny", Precision::F16);
    let run = || {
        let mut rollout = seeded(&world, &point(&world), 7);
        steps(&mut rollout, 0..3);
        fingerprint(&mut rollout).expect("bits")
    };
    let alone = run();
    std::thread::scope(|scope| {
        let threads = [scope.spawn(run), scope.spawn(run)];
        // Sessions come and go at the same time.
        drop(load(&webgpu(), "tiny", Precision::F16));
        for thread in threads {
            assert!(thread.join().expect("no panic") == alone, "the same bits beside other work");
        }
    });
}

#[test]
fn a_device_says_what_it_is() {
    let device = webgpu();
    assert_eq!((device.kind(), device.precision(), device.is_gpu()), (DeviceKind::WebGpu, Precision::F16, true));
    let text = device.describe();
    assert!(text.starts_with("ONNX Runtime 1.") && text.contains(" WebGPU 0.") && text.contains("llvmpipe"), "{text}");
    let memory = device.memory().expect("the driver reports its memory");
    assert!(memory.granted > 1 << 20, "{memory:?}");
}

fn refusal(adapter: Option<&str>) -> Error {
    let options = WebGpuOptions { adapter: adapter.map(str::to_owned), ..WebGpuOptions::default() };
    Device::webgpu(&ort(), &options).expect_err("no such adapter")
}

#[test]
fn the_best_device_is_never_software_and_says_why_it_is_the_processor() {
    let adapters = webgpu_adapters();
    let [only] = &adapters[..] else { panic!("one adapter, and not {adapters:?}") };
    assert!(only.name.contains("llvmpipe") && only.software && only.memory > 1 << 20, "{only:?}");
    let options = CpuOptions { threads: Some(2), ..CpuOptions::default() };
    let (device, refusals) = Device::auto(&ort(), options, &LibrarySearch::default()).expect("the processor");
    assert_eq!((device.kind(), device.threads()), (DeviceKind::Cpu, 2));
    let [(DeviceKind::WebGpu, why)] = &refusals[..] else { panic!("{refusals:?}") };
    assert!(why.to_string().contains("by which the processor emulates one"), "{why}");
}

#[test]
fn adapters_that_are_not_there_and_unnamed_software_are_refused() {
    let error = refusal(Some("voodoo"));
    assert_eq!(error.kind(), ErrorKind::InvalidArgument);
    assert!(error.to_string().contains("0: llvmpipe"), "{error}");
    let error = refusal(None);
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("by which the processor emulates one"), "{error}");
}

/// Runs one of this program's tests in a process of its own, with other variables.
fn in_a_process(test: &str, with: impl FnOnce(&mut Command)) {
    run_test(test, |command| with(command.env("WEBGPU_TEST_PART", "1")));
}

/// Whether this is the process that [`in_a_process`] started.
fn is_part() -> bool {
    std::env::var_os("WEBGPU_TEST_PART").is_some()
}

#[test]
fn a_missing_plugin_is_named() {
    if !is_part() {
        let folder = std::env::temp_dir().join(format!("cairn-no-plugin-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let library = ort().path().to_owned();
        let alone = folder.join(library.file_name().expect("a name"));
        std::fs::copy(&library, &alone).expect("a copy");
        in_a_process("a_missing_plugin_is_named", |command| {
            command.env("CAIRN_ONNXRUNTIME", &alone);
        });
        return std::fs::remove_dir_all(&folder).expect("removed");
    }
    let error = refusal(Some("llvmpipe"));
    assert_eq!(error.kind(), ErrorKind::RuntimeMissing);
    assert!(error.to_string().contains("libonnxruntime_providers_webgpu.so"), "{error}");
}

#[test]
fn a_machine_without_an_adapter_is_named() {
    if !is_part() {
        return in_a_process("a_machine_without_an_adapter_is_named", |command| {
            command.env("VK_DRIVER_FILES", "/nowhere.json");
        });
    }
    let error = refusal(Some("llvmpipe"));
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("there is no graphics adapter by Vulkan"), "{error}");
}

/// A driver that fails while the file exists that `switch` names, over the driver of this process, as files in `folder`; sets a command's variables
/// for it.
fn use_failing_driver(command: &mut Command, folder: &Path, switch: &str) {
    let own = std::env::var("VK_DRIVER_FILES").expect("the lab names its driver");
    let text = std::fs::read_to_string(own).expect("a driver's manifest");
    let mut manifest: Value = serde_json::from_str(&text).expect("JSON");
    let driver = manifest["ICD"]["library_path"].as_str().expect("a path").to_owned();
    let program = std::env::current_exe().expect("this program");
    let double = program.parent().and_then(Path::parent).expect("cargo's folder").join("libvulkan_double.so");
    manifest["ICD"]["library_path"] = double.to_str().expect("a path").into();
    let file = folder.join("driver.json");
    std::fs::write(&file, manifest.to_string()).expect("a manifest");
    command.env("VK_DRIVER_FILES", file).env("VULKAN_DOUBLE_DRIVER", driver).env(switch, folder.join("fails"));
}

#[test]
fn a_lost_device_is_a_typed_error_and_a_new_one_works() {
    if !is_part() {
        let folder = tempfile::tempdir().expect("a folder");
        return in_a_process("a_lost_device_is_a_typed_error_and_a_new_one_works", |command| {
            use_failing_driver(command, folder.path(), "VULKAN_DOUBLE_LOST");
        });
    }
    let lost = std::env::var_os("VULKAN_DOUBLE_LOST").expect("set by this test's other process");
    let device = webgpu();
    let world = load(&device, "tiny", Precision::F16);
    let mut rollout = seeded(&world, &point(&world), 7);
    steps(&mut rollout, 0..2);
    let before = fingerprint(&mut rollout).expect("bits");
    std::fs::write(&lost, "").expect("a file");
    let is_lost = |error: Error| assert_eq!(error.kind(), ErrorKind::DeviceRemoved, "{error}");
    is_lost(rollout.step(&controls(2)).expect_err("the device is lost"));
    is_lost(rollout.save().expect_err("its memory cannot be read"));
    std::fs::remove_file(&lost).expect("removed");
    is_lost(rollout.step(&controls(2)).expect_err("the driver works again, but the device stays lost"));
    let options =
        WebGpuOptions { deterministic: true, adapter: Some("llvmpipe".to_owned()), ..WebGpuOptions::default() };
    let error = Device::webgpu(&ort(), &options).expect_err("the process has one device, which is lost");
    assert!(error.to_string().contains("something that was made on it is still there"), "{error}");
    is_lost(error);
    drop((rollout, world, device));
    // A new device works, again and again.
    for _ in 0..2 {
        let world = load(&webgpu(), "tiny", Precision::F16);
        let mut again = seeded(&world, &point(&world), 7);
        steps(&mut again, 0..2);
        assert!(fingerprint(&mut again).expect("bits") == before, "the same bits on the new device");
        std::fs::write(&lost, "").expect("a file");
        is_lost(again.step(&controls(2)).expect_err("the device is lost"));
        std::fs::remove_file(&lost).expect("removed");
    }
}

/// A wait that fails leaves the provider unable to be unloaded.
#[test]
fn a_device_that_is_lost_while_it_is_waited_for_is_a_typed_error() {
    if !is_part() {
        let folder = tempfile::tempdir().expect("a folder");
        return in_a_process("a_device_that_is_lost_while_it_is_waited_for_is_a_typed_error", |command| {
            use_failing_driver(command, folder.path(), "VULKAN_DOUBLE_HUNG");
        });
    }
    let hung = std::env::var_os("VULKAN_DOUBLE_HUNG").expect("set by this test's other process");
    let world = load(&webgpu(), "tiny", Precision::F16);
    let mut rollout = seeded(&world, &point(&world), 7);
    steps(&mut rollout, 0..1);
    std::fs::write(&hung, "").expect("a file");
    let is_lost = |error: Error| assert_eq!(error.kind(), ErrorKind::DeviceRemoved, "{error}");
    is_lost(rollout.step(&controls(1)).and_then(|_| rollout.latent().map(drop)).expect_err("the device is lost"));
    is_lost(rollout.save().expect_err("its memory cannot be read"));
    std::fs::remove_file(&hung).expect("removed");
    drop((rollout, world));
    let options =
        WebGpuOptions { deterministic: true, adapter: Some("llvmpipe".to_owned()), ..WebGpuOptions::default() };
    let error = Device::webgpu(&ort(), &options).expect_err("the process has one device, which is lost");
    assert!(error.to_string().contains("Start the program again"), "{error}");
    is_lost(error);
}

/// The adapter has no memory: WebGPU gives a buffer all the same, and drops the work that names it.
#[test]
fn memory_that_the_adapter_does_not_have_is_an_error() {
    if !is_part() {
        let folder = tempfile::tempdir().expect("a folder");
        return in_a_process("memory_that_the_adapter_does_not_have_is_an_error", |command| {
            use_failing_driver(command, folder.path(), "VULKAN_DOUBLE_EXHAUSTED");
        });
    }
    let exhausted = std::env::var_os("VULKAN_DOUBLE_EXHAUSTED").expect("set by this test's other process");
    let device = webgpu();
    let world = load(&device, "tiny", Precision::F16);
    let mut rollout = seeded(&world, &point(&world), 7);
    steps(&mut rollout, 0..1);
    let before = fingerprint(&mut rollout).expect("bits");
    std::fs::write(&exhausted, "").expect("a file");
    let options = WorldOptions { precision: Some(Precision::F32), ..WorldOptions::default() };
    let refused = World::load(&device, &bundle("demo"), options.clone()).expect_err("there is no memory");
    assert_eq!(refused.kind(), ErrorKind::OutOfMemory, "{refused}");
    std::fs::remove_file(&exhausted).expect("removed");
    // Nothing else is harmed, and there is memory again.
    assert!(fingerprint(&mut rollout).expect("bits") == before);
    steps(&mut rollout, 1..2);
    World::load(&device, &bundle("demo"), options).expect("a world");
}
