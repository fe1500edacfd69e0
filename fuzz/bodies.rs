//! What the fuzz targets do with their bytes, and where they start from. A quick test of the library runs the same bodies
//! over seeded mutations of the same seeds.

use std::sync::LazyLock;

use cairn::bundle::{GraphKind, Manifest, Precision, check_model};
use cairn::world::{ControlScript, WorldTime};

use crate::support::toy_bundle::ToyBundle;

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

/// A manifest that is accepted says the same when it is written and read again, and its arithmetic cannot overflow.
pub(crate) fn manifest(bytes: &[u8]) {
    let Ok(manifest) = Manifest::parse(bytes) else { return };
    let written = serde_json::to_vec(&manifest).expect("a manifest can be written");
    assert_eq!(Manifest::parse(&written).expect("a written manifest is valid"), manifest);
    let g = &manifest.geometry;
    assert_eq!(u64::from(g.token_grid().0) * u64::from(g.token_grid().1), u64::from(g.tokens));
    assert!(g.check_window(g.global.window).is_ok() && g.check_window(g.global.max_window).is_ok());
}

/// The first byte chooses the model's kind and precision, the rest is the model.
pub(crate) fn onnx(bytes: &[u8]) {
    let Some((choice, model)) = bytes.split_first() else { return };
    let (kind, precision) = MODELS[usize::from(*choice) % MODELS.len()];
    if let Err(error) = check_model(model, &TOY, kind, precision) {
        assert!(error.offending_field().is_some() && error.to_string().len() < 2000);
    }
}

/// A script that is accepted says the same when it is written and read again, and every span of it can be asked for.
pub(crate) fn control_script(bytes: &[u8]) {
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

/// Starting points of each target.
pub(crate) mod seeds {
    use super::{MODELS, ToyBundle};

    pub(crate) fn manifest() -> Vec<Vec<u8>> {
        let full = ToyBundle::new().full_manifest();
        vec![full.to_string().into_bytes(), serde_json::to_vec_pretty(&full).expect("JSON can be written")]
    }

    pub(crate) fn onnx() -> Vec<Vec<u8>> {
        let contents = ToyBundle::new().contents();
        let seed = |(i, (kind, precision))| {
            let mut bytes = vec![i as u8];
            bytes.extend(&contents[&format!("{kind}.{precision}.onnx")]);
            bytes
        };
        MODELS.into_iter().enumerate().map(seed).collect()
    }

    pub(crate) fn control_script() -> Vec<Vec<u8>> {
        let walk = include_bytes!("../samples/scripts/walk.txt");
        let look = include_bytes!("../samples/scripts/look-around.txt");
        vec![walk.to_vec(), look.to_vec()]
    }
}
