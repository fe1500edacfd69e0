//! The embedded world with weights in 8 and 4 bits: its latents stay near those of the 16-bit weights, from the same past.

use std::sync::Arc;

use cairn::bundle::{Bundle, Precision, Processor};
use cairn::world::{OperatingPoint, Rollout, Schedule, World, WorldOptions};
use test_support::worlds::{bundle, controls, desert_picture, device, ort, point, processor, relative_error};

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/worlds");
/// Latents of the common past, after the seed.
const PAST: u64 = 4;
/// The widest interval of the stock schedule, as the only pass of a step.
const WIDEST: f64 = 0.45;

fn load(bundle: &Arc<Bundle>) -> Arc<World> {
    let options = WorldOptions { precision: Some(Precision::F32), ..WorldOptions::default() };
    World::load(&device(), bundle, options).expect("a world")
}

fn seeded(world: &Arc<World>, point: &OperatingPoint) -> Rollout {
    let mut rollout = Rollout::new(world, point, 7).expect("a rollout");
    rollout.append(&desert_picture()).expect("a seed");
    rollout
}

/// The latent of one step by `schedule`, after the same latents of the past.
fn next_latent(world: &Arc<World>, past: &[Vec<f32>], schedule: &Schedule) -> Vec<f32> {
    let mut rollout = seeded(world, &OperatingPoint { schedule: schedule.clone(), ..point(world) });
    for latent in past {
        rollout.append_latent(latent).expect("a latent");
    }
    rollout.step(&controls(PAST)).expect("a step");
    rollout.latent().expect("a latent").to_vec()
}

#[test]
fn small_weights_change_a_latent_little() {
    let full = load(&Bundle::open(format!("{FOLDER}/miniature.cairn").as_ref()).expect("the embedded world"));
    let mut rollout = seeded(&full, &point(&full));
    let mut past = Vec::new();
    for i in 0..PAST {
        rollout.step(&controls(i)).expect("a step");
        past.push(rollout.latent().expect("a latent").to_vec());
    }
    // For one pass and for a whole step, after a past whose keys and values differ, too: more than the error of a pass from equal inputs.
    let mut needs = vec![full.memory_need().weights];
    for (name, bits, bounds) in [("miniature-8bit", 8, [0.015, 0.02]), ("miniature-4bit", 4, [0.2, 0.3])] {
        let bundle = bundle(name);
        assert_eq!(bundle.manifest().quantisation.as_ref().map(|q| (q.bits, q.block)), Some((bits, 32)));
        let small = load(&bundle);
        for (schedule, bound) in [Schedule::Explicit(vec![WIDEST, 0.0]), Schedule::Stock].into_iter().zip(bounds) {
            let error = relative_error(&next_latent(&small, &past, &schedule), &next_latent(&full, &past, &schedule));
            println!("{name}, {schedule:?}: {:.3} %", 100.0 * error);
            assert!(error > 0.0 && error <= bound, "{name}, {schedule:?}: a relative error of {error:e}");
        }
        needs.push(small.memory_need().weights);
    }
    assert!(needs.is_sorted_by(|more, less| more > less), "fewer bits need less memory: {needs:?}");
}

/// As `cairn.build` counts it: `bindings/python/tests/test_quantise.py`.
#[test]
fn memory_counts_the_largest_matrix_that_is_unpacked() {
    for (name, bits) in [("miniature-8bit", 8), ("miniature-4bit", 4)] {
        let bundle = bundle(name);
        let geometry = bundle.geometry();
        let window = geometry.global.window;
        // The largest of a pass, and the largest that embeds controls, which are of another graph.
        let numbers = u64::from(geometry.width * geometry.width * (geometry.mlp_ratio + 1));
        let need = |precision, on| bundle.memory_need(precision, on, window).expect("figures").unpacked;
        assert_eq!(need(Precision::F16, Processor::Gpu), 2 * numbers, "{name}");
        assert_eq!(need(Precision::F32, Processor::Gpu), 4 * numbers, "{name}");
        let on_cpu = Precision::ALL.map(|precision| need(precision, Processor::Cpu));
        assert_eq!(on_cpu, [if bits == 8 { 4 * numbers } else { 0 }; 2], "{name}");
        let of_world = need(Precision::F32, processor(&device()));
        assert_eq!(load(&bundle).memory_need().unpacked, of_world, "{name}: a world in float32");
    }
}

/// The library tells that a provider lacks the operator by texts in ONNX Runtime's messages (`src/world/missing_operator.rs`).
#[test]
fn onnx_runtime_has_the_texts_of_a_missing_operator() {
    let file = std::fs::read(ort().path()).expect("ONNX Runtime's file");
    for text in ["MatMulNBits", "but fallback to CPU EP has been explicitly disabled by the user"] {
        assert!(file.windows(text.len()).any(|bytes| bytes == text.as_bytes()), "{text}");
    }
}
