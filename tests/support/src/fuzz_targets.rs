//! The functions that the fuzz targets call, and the targets' seed inputs. `tests/bundle/mutations.rs` calls the same functions with seeded
//! mutations of the same inputs.

use std::sync::LazyLock;

use cairn::bundle::{GraphKind, Manifest, Precision, check_model};
use cairn::world::{ControlScript, WorldTime};

use crate::bundles::toy_bundle::ToyBundle;

const MODELS: [(GraphKind, Precision); 6] = [
    (GraphKind::Transformer, Precision::F32),
    (GraphKind::Encoder, Precision::F32),
    (GraphKind::Decoder, Precision::F32),
    (GraphKind::Transformer, Precision::F16),
    (GraphKind::Encoder, Precision::F16),
    (GraphKind::Decoder, Precision::F16),
];

static TOY: LazyLock<Manifest> = LazyLock::new(|| {
    let text = ToyBundle::new().full_manifest().to_string();
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

/// The first byte chooses the model's kind and precision, the rest is the model.
pub fn onnx(bytes: &[u8]) {
    let Some((choice, model)) = bytes.split_first() else { return };
    let (kind, precision) = MODELS[usize::from(*choice) % MODELS.len()];
    if let Err(error) = check_model(model, &TOY, kind, precision) {
        assert!(error.offending_field().is_some() && error.to_string().len() < 2000);
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

/// Seed inputs of each target.
pub mod seeds {
    use super::{MODELS, ToyBundle};

    /// The toy bundle's manifest, compact and indented.
    pub fn manifest() -> Vec<Vec<u8>> {
        let full = ToyBundle::new().full_manifest();
        vec![full.to_string().into_bytes(), serde_json::to_vec_pretty(&full).expect("JSON can be written")]
    }

    /// The toy bundle's models, each after the byte that selects it.
    pub fn onnx() -> Vec<Vec<u8>> {
        let contents = ToyBundle::new().contents();
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
}
