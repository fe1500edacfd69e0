//! The type of the residual stream: float16 without a statement of the manifest, float32 with one, and nothing between the two.

use cairn::ErrorKind;
use cairn::bundle::{Bundle, Residual};
use serde_json::json;
use test_support::bundles::onnx_writer::*;
use test_support::bundles::toy_bundle::{ToyBundle, WEIGHTS};

use crate::refusal;

const MODEL: &str = "transformer.f16.onnx";

/// A transformer of two layers whose residual stream has sums of these types, `sum.0`, `sum.1` and so on.
fn with_sums(types: &[i64], is_stated: bool) -> ToyBundle {
    let mut toy = ToyBundle::new();
    if is_stated {
        toy.manifest["residual"] = json!("float32");
    }
    let m = toy.model(MODEL);
    let mut add = |operator, inputs: &[&str], output: &str, attributes| {
        m.nodes.push(node(operator, inputs, &[output], attributes));
    };
    add("Reshape", &["x", "patches.shape"], "patches", vec![]);
    add("MatMul", &["patches", "embedding"], "stream.0", vec![]);

    for (i, &element) in types.iter().enumerate() {
        let (stream, branch, sum) = (format!("stream.{i}"), format!("branch.{i}"), format!("sum.{i}"));
        add("Tanh", &[&stream], &branch, vec![]);
        let cast = [&stream, &branch].map(|name| format!("{name}.cast"));
        add("Cast", &[&stream], &cast[0], vec![int("to", element)]);
        add("Cast", &[&branch], &cast[1], vec![int("to", element)]);
        add("Add", &[&cast[0], &cast[1]], &sum, vec![]);
        add("Reshape", &[&sum, "tokens.shape"], &format!("stream.{}", i + 1), vec![]);
    }

    m.tensors.push(inside_ints("patches.shape", &[1, 1, 4]));
    m.tensors.push(inside_ints("tokens.shape", &[1, 1, 8]));
    m.tensors.push(external("embedding", &[4, 8], WEIGHTS, 0));
    toy
}

#[test]
fn both_types_are_read() {
    for (types, is_stated) in [([F16; 4], false), ([F32; 4], true)] {
        let bundle = Bundle::from_memory(with_sums(&types, is_stated).files()).unwrap();
        assert_eq!(bundle.manifest().residual, is_stated.then_some(Residual::Float32));
    }
    // A transformer of another converter may have a stream that is not found. It is read as before.
    assert_eq!(Bundle::from_memory(ToyBundle::new().files()).unwrap().manifest().residual, None);
}

#[test]
fn sums_of_another_type_than_stated_are_refused() {
    for (types, is_stated, part) in [
        (
            &[F32; 4][..],
            false,
            "the sum `sum.0` of the residual stream is float32, and the manifest states no `residual`",
        ),
        (&[F16, F16, F32, F16], false, "the sum `sum.2` of the residual stream is float32"),
        (
            &[F16; 4],
            true,
            "the sum `sum.0` of the residual stream is float16, and the manifest states the `residual` float32",
        ),
        (&[F32, F32, F32, F16], true, "the sum `sum.3` of the residual stream is float16"),
        (&[F32; 3], true, "the residual stream has 3 sums; 2 layers have 4"),
        (&[], true, "the residual stream has 0 sums; 2 layers have 4"),
    ] {
        let error = refusal(part, Bundle::from_memory(with_sums(types, is_stated).files()));
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidBundle, Some(MODEL)), "{error}");
        assert!(error.to_string().contains(part), "`{error}` does not say `{part}`");
    }
}

#[test]
fn other_statements_are_refused() {
    for value in [json!("float16"), json!("f32"), json!(null), json!(32)] {
        let mut toy = with_sums(&[F32; 4], true);
        toy.manifest["residual"] = value.clone();
        let error = refusal("a value", Bundle::from_memory(toy.files()));
        assert_eq!(
            (error.kind(), error.offending_field()),
            (ErrorKind::InvalidBundle, Some("residual")),
            "{value}: {error}"
        );
    }
    let mut toy = ToyBundle::new();
    toy.manifest["residual"] = json!("float32");
    toy.manifest["graphs"].as_object_mut().unwrap().remove("f16");
    let error = refusal("no f16 graphs", Bundle::from_memory(toy.files()));
    assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidBundle, Some("residual")), "{error}");
}
