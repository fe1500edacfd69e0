//! Transformers that are split into slices: what goes from slice to slice, and graphs that cannot be split, or not everywhere.

use cairn::bundle::{GraphKind, Manifest, Precision, check_model, slice_transformer};
use cairn::{ErrorKind, Result};
use test_support::bundles::onnx_writer::*;
use test_support::bundles::toy_bundle::ToyBundle;

const MODEL: &str = "transformer.f32.onnx";
/// The toy's stock window.
const WINDOW: u32 = 4;

fn split(toy: &ToyBundle, slices: u32) -> Result<Vec<Vec<u8>>> {
    let manifest = Manifest::parse(toy.full_manifest().to_string().as_bytes())?;
    let model = toy.models[MODEL].encode();
    check_model(&model, &manifest, GraphKind::Transformer, Precision::F32)?;
    slice_transformer(&model, &manifest, Precision::F32, WINDOW, slices)
}

fn toy() -> ToyBundle {
    ToyBundle::new()
}

/// A field of bytes of a graph: its tag, its length and the start of its contents, which for values is the name.
fn named(field: u8, name: &str) -> Vec<u8> {
    [&[field << 3 | 2][..], &[0x0A, name.len() as u8], name.as_bytes()].concat()
}

/// Whether a graph's field `field` of a model has an entry of this name. The length between tag and contents may have two bytes.
fn has(model: &[u8], field: u8, name: &str) -> bool {
    let (tag, entry) = (field << 3 | 2, &named(field, name)[1..]);
    (1..=2).any(|length| {
        model.windows(1 + length + entry.len()).any(|bytes| bytes[0] == tag && &bytes[1 + length..] == entry)
    })
}

const INPUT: u8 = 11;
const OUTPUT: u8 = 12;

#[test]
fn each_slice_has_what_its_layers_read_and_make() {
    let slices = split(&toy(), 2).unwrap();
    let [first, second] = slices.as_slice() else { panic!("{} slices", slices.len()) };
    for (field, name, is_first, is_second) in [
        (INPUT, "x", true, false),
        (INPUT, "sigma", false, false),
        (INPUT, "local_mask", true, false),
        (INPUT, "global_mask", false, true),
        (INPUT, "past.0.k", true, false),
        (INPUT, "past.1.v", false, true),
        (INPUT, "row.1", false, true),
        (OUTPUT, "row.1", true, false),
        (OUTPUT, "present.0.k", true, false),
        (OUTPUT, "present.0.v", true, false),
        (OUTPUT, "present.1.k", false, true),
        (OUTPUT, "present.1.v", false, true),
        (OUTPUT, "x_next", false, true),
    ] {
        assert_eq!((has(first, field, name), has(second, field, name)), (is_first, is_second), "{field}: {name}");
    }
}

#[test]
fn one_slice_has_the_whole_model() {
    let slices = split(&toy(), 1).unwrap();
    assert_eq!(slices.len(), 1);
    let model = toy().models[MODEL].clone();
    for tensor in &model.inputs {
        // Inputs that no node reads are left out.
        let is_read = !["sigma", "dsigma", "rope_cos", "rope_sin", "controls"].contains(&tensor.name.as_str());
        assert_eq!(has(&slices[0], INPUT, &tensor.name), is_read, "{}", tensor.name);
    }
    assert!(model.outputs.iter().all(|tensor| has(&slices[0], OUTPUT, &tensor.name)));
}

#[test]
fn an_output_that_a_later_layer_reads_goes_there_as_it_is() {
    let mut toy = toy();
    let model = toy.model(MODEL);
    // Layer 1 also adds layer 0's values, as the value residual does.
    let last = model.nodes.iter_mut().find(|node| node.outputs.iter().any(|name| name == "mix.1")).unwrap();
    last.outputs = vec!["mix.1.alone".to_owned()];
    let at = model.nodes.iter().position(|node| node.outputs.iter().any(|name| name == "mix.1.alone")).unwrap();
    model.nodes.insert(at + 1, node("Add", &["mix.1.alone", "present.0.v"], &["mix.1"], vec![]));
    let slices = split(&toy, 2).unwrap();
    assert!(has(&slices[0], OUTPUT, "present.0.v") && has(&slices[1], INPUT, "present.0.v"));
    assert!(!has(&slices[1], OUTPUT, "present.0.v"));
}

#[test]
fn interleaved_layers_stay_in_one_slice() {
    let mut toy = toy();
    let model = toy.model(MODEL);
    // Layer 1's ring is read before layer 0's.
    model.nodes.insert(0, node("Tanh", &["past.1.k"], &["early"], vec![]));
    let error = split(&toy, 2).unwrap_err();
    assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("slices")));
    assert!(error.to_string().contains("it can be split into 1 to 1"), "{error}");
    assert_eq!(split(&toy, 1).unwrap().len(), 1);
}

#[test]
fn numbers_that_a_transformer_cannot_have_are_refused() {
    for slices in [0, 3, u32::MAX] {
        let error = split(&toy(), slices).unwrap_err();
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("slices")));
        assert!(error.to_string().contains("it can be split into 1 to 2"), "{error}");
    }
    let manifest = Manifest::parse(toy().full_manifest().to_string().as_bytes()).unwrap();
    let model = toy().models[MODEL].encode();
    let error = slice_transformer(&model, &manifest, Precision::F32, 3, 1).unwrap_err();
    assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("global_window")));
}

#[test]
fn models_that_are_no_transformer_are_refused() {
    let manifest = Manifest::parse(toy().full_manifest().to_string().as_bytes()).unwrap();
    let good = toy().models[MODEL].encode();
    let cut = &good[..good.len() / 2];
    for model in [cut, &[][..], &[7][..], &toy().models["decoder.f32.onnx"].encode()] {
        let error = slice_transformer(model, &manifest, Precision::F32, WINDOW, 2).unwrap_err();
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidBundle, Some(MODEL)));
    }
}
