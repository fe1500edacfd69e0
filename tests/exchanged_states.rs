//! A saved state of one device goes on alike on every other. Each run leaves a state in the folder `CAIRN_EXCHANGED_STATES` and continues those
//! that runs on other devices left there; without the folder, only its own. `cargo xtask test --thorough webgpu-all` runs it on the processor, on
//! WebGPU on Linux and Windows, and on DirectML.

use std::ops::Range;
use std::path::PathBuf;

use cairn::runtime::DeviceKind;
use cairn::world::Rollout;
use test_support::worlds::{controls, point, relative_error, seeded, world};

/// Largest relative error of a float32 latent from another device's.
const BOUND: f64 = 1e-4;

/// Steps before the state is saved, and all steps.
const STEPS: [u64; 2] = [2, 4];

fn steps(rollout: &mut Rollout, range: Range<u64>) {
    for i in range {
        rollout.step(&controls(i)).expect("a step");
    }
}

/// The latent some steps after the state.
fn go_on(rollout: &mut Rollout) -> Vec<f32> {
    steps(rollout, STEPS[0]..STEPS[1]);
    rollout.latent().expect("a latent").to_vec()
}

#[test]
fn a_state_of_another_device_goes_on_alike() {
    let own_folder = tempfile::tempdir().expect("a folder");
    let folder = std::env::var_os("CAIRN_EXCHANGED_STATES").map_or_else(|| own_folder.path().to_owned(), PathBuf::from);
    let world = world("tiny");
    let device = match world.device().kind() {
        DeviceKind::Cpu => "cpu",
        DeviceKind::Direct3d12 => "directml",
        DeviceKind::WebGpu => "webgpu",
    };
    let own = format!("{device}-{}", std::env::consts::OS);
    let mut rollout = seeded(&world, &point(&world), 7);
    steps(&mut rollout, 0..STEPS[0]);
    let saved = rollout.save().expect("a state");
    let latent: Vec<u8> = go_on(&mut rollout).iter().flat_map(|v| v.to_le_bytes()).collect();
    // The latent first: a run that is stopped leaves no state without it.
    for (kind, bytes) in [("latent", &latent), ("state", &saved)] {
        std::fs::write(folder.join(&own).with_extension(kind), bytes).expect("a file");
    }
    for file in folder.read_dir().expect("a folder") {
        let path = file.expect("a file").path();
        if path.extension().is_none_or(|kind| kind != "state") {
            continue;
        }
        let latent = std::fs::read(path.with_extension("latent")).expect("a latent");
        let truth: Vec<f32> = latent.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        let mut moved = Rollout::new(&world, &point(&world), 1).expect("a rollout");
        moved.restore(&std::fs::read(&path).expect("a state")).expect("the state fits");
        let error = relative_error(&go_on(&mut moved), &truth);
        let other = path.file_stem().expect("a name").to_string_lossy().into_owned();
        println!("{own} continues the state of {other}: a relative error of {error:e}");
        let is_right = match other.split_once('-') {
            _ if other == own => error == 0.0,
            // Linux and Windows may run the same driver.
            Some((kind, _)) if kind == device => error <= BOUND,
            // Devices of two kinds never have the same bits.
            _ => error > 0.0 && error <= BOUND,
        };
        assert!(is_right, "{other}: {error:e}");
    }
}
