//! Worlds whose transformer runs in slices: every number of slices gives the same bits, from step to step and from a saved state of another
//! number, and numbers that the transformer cannot have are refused.

use std::sync::Arc;
use std::time::Duration;

use cairn::ErrorKind;
use cairn::bundle::{Bundle, GraphKind, Passes, Precision, Processor, slice_transformer};
use cairn::world::{Rollout, World, WorldOptions};
use test_support::worlds::{bundle, controls, device, fingerprint, point, relative_error, seeded};

const EMBEDDED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/worlds/miniature.cairn");

fn in_slices(bundle: &Arc<Bundle>, slices: Option<u32>, precision: Precision) -> Arc<World> {
    let options = WorldOptions { slices, precision: Some(precision), ..WorldOptions::default() };
    World::load(&device(), bundle, options).expect("a world")
}

fn embedded() -> Arc<Bundle> {
    Bundle::open(EMBEDDED.as_ref()).expect("the embedded world")
}

/// Fingerprints after the seed and after each step.
fn walk(rollout: &mut Rollout, steps: std::ops::Range<u64>) -> Vec<Vec<u8>> {
    let mut step = |i| {
        rollout.step(&controls(i)).expect("a step");
        fingerprint(rollout).expect("a fingerprint")
    };
    steps.map(&mut step).collect()
}

/// Compares worlds of these numbers of slices with the whole one. `steps` follow the seed, and as many a saved state.
fn compare(bundle: &Arc<Bundle>, numbers: &[u32], steps: u64) {
    let name = bundle.manifest().name.as_str();
    let whole = in_slices(bundle, None, Precision::F32);
    assert_eq!(whole.slices(), 1);
    let mut rollout = seeded(&whole, &point(&whole), 3);
    let first = fingerprint(&mut rollout).expect("a fingerprint");
    let (expected, then) = (walk(&mut rollout, 0..steps), walk(&mut rollout, steps..2 * steps));
    assert!(expected.last() != Some(&first) && expected != then);

    let mut before = rollout;
    for &slices in numbers {
        let world = in_slices(bundle, Some(slices), Precision::F32);
        assert_eq!((world.slices(), world.longest_slice()), (slices, None));
        let mut rollout = seeded(&world, &point(&world), 3);
        assert!(fingerprint(&mut rollout).expect("a fingerprint") == first, "{name} in {slices} slices: the seed");
        assert!(walk(&mut rollout, 0..steps) == expected, "{name} in {slices} slices");

        // From a saved state, into a rollout with another past, and from a world with another number of slices.
        let state = rollout.save().expect("a state");
        walk(&mut rollout, 7..8);
        rollout.restore(&state).expect("a state");
        assert!(walk(&mut rollout, steps..2 * steps) == then, "{name} in {slices} slices, restored");
        before.restore(&state).expect("a state");
        before.move_to(&world).expect("a world of the same window");
        assert!(walk(&mut before, steps..2 * steps) == then, "{name}, moved to {slices} slices");
        before = rollout;
    }
}

#[test]
fn every_number_of_slices_gives_the_same_bits() {
    let tiny = bundle("tiny");
    compare(&tiny, &[1, 2, 3, 4, tiny.geometry().layers], 2);
}

#[test]
fn the_embedded_world_has_the_same_bits_in_slices() {
    let world = embedded();
    compare(&world, &[4, world.geometry().layers], 1);
}

#[test]
fn weights_in_8_bits_give_the_same_bits_in_slices() {
    let world = bundle("miniature-8bit");
    compare(&world, &[world.geometry().layers], 1);
}

/// The CPU provider keeps values in float32 within a graph, and a slice hands them over in float16: also beside a float32 residual stream, such as
/// layer 0's values.
#[test]
fn float16_latents_of_slices_are_near_those_of_the_whole() {
    for name in ["tiny", "tiny-residual"] {
        let bundle = bundle(name);
        let latent = |slices| {
            let world = in_slices(&bundle, slices, Precision::F16);
            let mut rollout = seeded(&world, &point(&world), 3);
            walk(&mut rollout, 0..1);
            rollout.latent().expect("a latent").to_vec()
        };
        let whole = latent(None);
        for slices in [2, bundle.geometry().layers] {
            let error = relative_error(&latent(Some(slices)), &whole);
            println!("{name} in {slices} slices: {:.4} %", 100.0 * error);
            assert!(error < 0.01, "{name} in {slices} slices: a relative error of {error:e}");
        }
    }
}

#[test]
fn frozen_passes_of_slices_give_the_same_bits() {
    let bundle = bundle("tiny");
    let probe = |slices| {
        let world = in_slices(&bundle, Some(slices), Precision::F32);
        let rollout = &mut seeded(&world, &point(&world), 3);
        let mut plan = cairn::world::StepPlan::default();
        rollout.planner().plan_step_into(&controls(1), &mut plan).expect("a plan");
        let x: Vec<f32> = (0..world.latent_len()).map(|i| (i as f32).sin()).collect();
        rollout.probe(&plan, 0.5, &x).expect("a pass")
    };
    let whole = probe(1);
    assert!(probe(3) == whole && probe(bundle.geometry().layers) == whole);
}

#[test]
fn numbers_of_slices_that_a_transformer_cannot_have_are_refused() {
    let bundle = bundle("tiny");
    let layers = bundle.geometry().layers;
    for slices in [0, layers + 1, u32::MAX] {
        let options = WorldOptions { slices: Some(slices), ..WorldOptions::default() };
        let error = World::load(&device(), &bundle, options).unwrap_err();
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("slices")));
        let text = error.to_string();
        assert!(text.contains(&format!("{slices} slices")) && text.contains(&format!("1 to {layers}")), "{text}");
    }
}

#[test]
fn a_limit_chooses_the_number_of_slices() {
    let bundle = embedded();
    let with_limit = |limit| {
        let options = WorldOptions {
            longest_submission: Some(limit),
            precision: Some(Precision::F32),
            ..WorldOptions::default()
        };
        let calls = std::cell::RefCell::new(Vec::new());
        let proceed = |total| {
            calls.borrow_mut().push(total);
            Ok(())
        };
        let world = World::load_with(&device(), &bundle, options, &proceed).expect("a world");
        let calls = calls.into_inner();
        // Every session was announced, and the last call says that all are made.
        assert_eq!(calls.last(), Some(&(calls.len() as u64 - 1)), "{calls:?}");
        assert!(calls.iter().enumerate().all(|(done, total)| done as u64 <= *total) && calls.is_sorted());
        world
    };
    let world = with_limit(Duration::from_secs(600));
    assert_eq!(world.slices(), 1);
    let whole = world.longest_slice().expect("a time");
    assert!(!whole.is_zero());
    // No slice takes so little, so every layer is one.
    let world = with_limit(Duration::from_nanos(1));
    assert_eq!(world.slices(), bundle.geometry().layers);
    assert!(world.longest_slice().is_some_and(|longest| !longest.is_zero()));
    let mut rollout = seeded(&world, &point(&world), 3);
    let reference = in_slices(&bundle, None, Precision::F32);
    let mut expected = seeded(&reference, &point(&reference), 3);
    assert!(walk(&mut rollout, 0..1) == walk(&mut expected, 0..1));
}

#[test]
fn more_slices_need_more_memory_and_a_refused_number_is_not_loaded() {
    let bundle = embedded();
    let need =
        |slices| bundle.memory_need_in(Precision::F32, Processor::Cpu, 128, Passes::Slices(slices)).expect("a need");
    let whole = bundle.memory_need(Precision::F32, Processor::Cpu, 128).expect("a need");
    assert_eq!(need(1), whole);
    let layers = bundle.geometry().layers;
    assert!(need(layers).intermediates > need(2).intermediates && need(2).intermediates > whole.intermediates);
    assert_eq!((need(layers).ring, need(layers).slabs), (whole.ring, whole.slabs));
    // Layers share only small constants.
    assert!(need(layers).weights - whole.weights < whole.weights / 100);
    let options = WorldOptions {
        slices: Some(layers),
        memory_limit: Some(whole.total),
        precision: Some(Precision::F32),
        ..WorldOptions::default()
    };
    assert_eq!(World::load(&device(), &bundle, options).unwrap_err().kind(), ErrorKind::OutOfMemory);
}

#[test]
fn slices_are_models_whose_layers_are_those_of_the_whole() {
    let bundle = embedded();
    let onnx = bundle.model(GraphKind::Transformer, Precision::F32).expect("a model").onnx;
    let layers = bundle.geometry().layers;
    let models = slice_transformer(onnx, bundle.manifest(), Precision::F32, 128, layers).expect("slices");
    let [of_levels, of_controls, slices @ ..] = &models[..] else { panic!("models") };
    assert_eq!(slices.len(), layers as usize);
    let has = |slice: &[u8], text: &str| slice.windows(text.len()).any(|bytes| bytes == text.as_bytes());
    let in_slices = |text: &str| slices.iter().any(|slice| has(slice, text));
    for weight in ["denoise_step_emb.mlp.fc2.weight", "cond_head.cond_proj.weight", "out_norm.fc.weight"] {
        assert_eq!(
            [has(of_levels, weight), has(of_controls, weight), in_slices(weight)],
            [true, false, false],
            "{weight}"
        );
    }
    for weight in ["ctrl_emb.mlp.fc1.weight", "ctrl_mlpfusion.fc1_c.weight"] {
        assert_eq!(
            [has(of_levels, weight), has(of_controls, weight), in_slices(weight)],
            [false, true, false],
            "{weight}"
        );
    }
    for (input, expected) in
        [("sigma", [true, false, false]), ("controls", [false, true, false]), ("past.0.k", [false, false, true])]
    {
        // As protobuf writes a name: the field's number and type, and the length.
        let name = format!("\n{}{input}", char::from(input.len() as u8));
        assert_eq!([has(of_levels, &name), has(of_controls, &name), in_slices(&name)], expected, "{input}");
    }
    for (i, slice) in slices.iter().enumerate() {
        for layer in 0..layers as usize {
            // The ring and the weights of a layer belong to its slice alone.
            for text in [format!("past.{layer}.k"), format!("blocks.{layer}.mlp.fc1.weight")] {
                assert_eq!(has(slice, &text), layer == i, "{text} in slice {i}");
            }
        }
        assert_eq!((has(slice, "\u{F}patchify.weight"), has(slice, "x_next")), (i == 0, i + 1 == slices.len()), "{i}");
    }
}
