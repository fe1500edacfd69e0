//! The functions that the fuzz targets call, and the targets' seed inputs. `tests/bundle/mutations.rs` calls the same functions with seeded
//! mutations of the same inputs.

use std::cell::RefCell;
use std::sync::LazyLock;

use cairn::ErrorKind;
use cairn::bundle::{GraphKind, Manifest, Precision, check_model, slice_transformer};
use cairn::world::{ControlScript, Rollout, WorldTime};
use sha2::{Digest, Sha256};

use crate::bundles::toy_bundle::ToyBundle;
use crate::worlds;

const MODELS: [(GraphKind, Precision); 8] = [
    (GraphKind::Transformer, Precision::F32),
    (GraphKind::Encoder, Precision::F32),
    (GraphKind::Decoder, Precision::F32),
    (GraphKind::Transformer, Precision::F16),
    (GraphKind::Encoder, Precision::F16),
    (GraphKind::Decoder, Precision::F16),
    (GraphKind::Joined, Precision::F32),
    (GraphKind::Joined, Precision::F16),
];

static TOY: LazyLock<Manifest> = LazyLock::new(|| {
    let text = ToyBundle::with_joined().full_manifest().to_string();
    Manifest::parse(text.as_bytes()).expect("the toy's manifest is valid")
});

/// An accepted manifest is equal to itself after it is written and read again, and its arithmetic cannot overflow.
pub fn manifest(bytes: &[u8]) {
    let Ok(manifest) = Manifest::parse(bytes) else { return };
    let written = serde_json::to_vec(&manifest).expect("a manifest can be written");
    assert_eq!(Manifest::parse(&written).expect("a written manifest is valid"), manifest);
    let g = &manifest.geometry;
    assert_eq!(u64::from(g.token_grid().0) * u64::from(g.token_grid().1), u64::from(g.tokens));
    assert!(g.check_window(g.global.window).is_ok() && g.check_window(g.global.max_window).is_ok());
}

/// The first byte chooses the model's kind and precision, the rest is the model. A transformer that is accepted is also split.
pub fn onnx(bytes: &[u8]) {
    let Some((choice, model)) = bytes.split_first() else { return };
    let (kind, precision) = MODELS[usize::from(*choice) % MODELS.len()];
    let check = |error: cairn::Error| assert!(error.offending_field().is_some() && error.to_string().len() < 2000);
    match check_model(model, &TOY, kind, precision) {
        Err(error) => check(error),
        Ok(()) if kind == GraphKind::Transformer => {
            for slices in 1..=TOY.geometry.layers {
                match slice_transformer(model, &TOY, precision, TOY.geometry.global.window, slices) {
                    Ok(models) => assert_eq!(models.len(), slices as usize),
                    Err(error) => check(error),
                }
            }
        }
        Ok(()) => {}
    }
}

/// An accepted script is equal to itself after it is written and read again, and each of its spans can be read.
pub fn control_script(bytes: &[u8]) {
    let Ok(script) = ControlScript::parse_bytes(bytes) else { return };
    let written = script.write();
    assert_eq!(ControlScript::parse(&written).expect("a written script is valid"), script);
    let end = script.duration();
    let span = |start, end| drop(script.span(start, end));
    span(WorldTime::ZERO, end);
    for latent in 0..8 {
        span(WorldTime::new(latent, 15), WorldTime::new(latent + 1, 15));
    }
}

/// Bytes of the checksum at a state's end.
const CHECKSUM: usize = 32;

/// A rollout of the test world `tiny`, and the memory within its state.
struct Restorer {
    rollout: Rollout,
    memory: Vec<u8>,
}

thread_local! {
    // libFuzzer calls a target from one thread.
    static RESTORER: RefCell<Option<Restorer>> = const { RefCell::new(None) };
}

/// Length of a state up to its memory: magic and version, then two parts, each after its length.
fn before_memory(state: &[u8]) -> usize {
    let after = |at: usize| at + 4 + u32::from_le_bytes([0, 1, 2, 3].map(|i| state[at + i])) as usize;
    after(after(12))
}

/// A saved state is refused and changes nothing, or it is saved again as it was and the rollout goes on from it.
///
/// The first byte tells what follows: a whole state if it is odd; else the part before the memory, to which the memory of a saved rollout and a valid
/// checksum are added, so that changes get past the checksum. It needs ONNX Runtime and the test worlds. Returns whether the state was restored.
pub fn saved_state(bytes: &[u8]) -> bool {
    let Some((choice, rest)) = bytes.split_first() else { return false };
    RESTORER.with_borrow_mut(|restorer| {
        let Restorer { rollout, memory } = restorer.get_or_insert_with(|| {
            let world = worlds::world("tiny");
            let mut rollout = worlds::seeded(&world, &worlds::point(&world), 1);
            rollout.step(&worlds::controls(0)).expect("a step");
            let state = rollout.save().expect("a state");
            Restorer { memory: state[before_memory(&state)..state.len() - CHECKSUM].to_vec(), rollout }
        });
        let mut state = rest.to_vec();
        if choice % 2 == 0 {
            state.extend_from_slice(memory);
            let checksum = Sha256::digest(&state);
            state.extend_from_slice(&checksum);
        }
        let before = rollout.save().expect("a state");
        match rollout.restore(&state) {
            Ok(()) => {
                let again = rollout.save().expect("a state");
                assert!(
                    again[before_memory(&again)..again.len() - CHECKSUM]
                        == state[before_memory(&state)..state.len() - CHECKSUM]
                );
                rollout.restore(&again).expect("a state that this rollout saved");
                assert!(rollout.save().expect("a state") == again, "a state is saved as it was restored");
                rollout.step(&worlds::controls(1)).expect("a step");
                true
            }
            Err(error) => {
                assert!(matches!(error.kind(), ErrorKind::InvalidState | ErrorKind::Unsupported), "{error}");
                assert!(error.offending_field().is_some() && rollout.save().expect("a state") == before, "{error}");
                false
            }
        }
    })
}

/// Seed inputs of each target.
pub mod seeds {
    use super::{MODELS, ToyBundle, before_memory, worlds};

    /// The toy bundle's manifest, compact and indented.
    pub fn manifest() -> Vec<Vec<u8>> {
        let full = ToyBundle::new().full_manifest();
        vec![full.to_string().into_bytes(), serde_json::to_vec_pretty(&full).expect("JSON can be written")]
    }

    /// The toy bundle's models, each after the byte that selects it.
    pub fn onnx() -> Vec<Vec<u8>> {
        let contents = ToyBundle::with_joined().contents();
        let seed = |(i, (kind, precision))| {
            let mut bytes = vec![i as u8];
            bytes.extend(&contents[&format!("{kind}.{precision}.onnx")]);
            bytes
        };
        MODELS.into_iter().enumerate().map(seed).collect()
    }

    /// The control scripts of the samples.
    pub fn control_script() -> Vec<Vec<u8>> {
        let walk = include_bytes!("../../../samples/scripts/walk.txt");
        let look = include_bytes!("../../../samples/scripts/look-around.txt");
        vec![walk.to_vec(), look.to_vec()]
    }

    /// States of the test world `tiny`, before its first step and after some: each up to its memory, and one whole.
    pub fn saved_state() -> Vec<Vec<u8>> {
        let world = worlds::world("tiny");
        let mut rollout = worlds::seeded(&world, &worlds::point(&world), 7);
        let mut states = Vec::new();
        for step in 0..6 {
            states.push(rollout.save().expect("a state"));
            rollout.step(&worlds::controls(step)).expect("a step");
        }
        let input = |choice: u8, state: &[u8]| [&[choice], state].concat();
        let whole = input(1, &states[5]);
        states.iter().map(|state| input(0, &state[..before_memory(state)])).chain([whole]).collect()
    }
}
