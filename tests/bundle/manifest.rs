//! Every member of the manifest, invalid in turn: the error names it and a remedy.

use cairn::ErrorKind;
use cairn::bundle::{Bundle, GraphKind, MANIFEST_NAME, Manifest, Precision};
use serde_json::{Value as Json, json};
use test_support::bundles::onnx_writer::{Dim, Model};
use test_support::bundles::toy_bundle::ToyBundle;

use crate::refusal;

/// JSON pointer of a member, an invalid value, and the field that the error names.
type Case = (&'static str, Json, &'static str);

fn cases() -> Vec<Case> {
    let long = "x".repeat(101);
    vec![
        ("/schema_version", json!("1"), "schema_version"),
        ("/schema_version", json!(-1), "schema_version"),
        ("/name", json!(""), "name"),
        ("/name", json!(long), "name"),
        ("/name", json!("a\u{7}b"), "name"),
        ("/name", json!(null), "name"),
        ("/geometry/layers", json!(0), "geometry.layers"),
        ("/geometry/layers", json!(100_000), "geometry.layers"),
        ("/geometry/layers", json!(2.5), "geometry.layers"),
        ("/geometry/layers", json!(5_000_000_000_u64), "geometry.layers"),
        ("/geometry/width", json!(16), "geometry.width"),
        ("/geometry/heads", json!(0), "geometry.heads"),
        ("/geometry/heads", json!(2), "geometry.width"),
        ("/geometry/kv_heads", json!(0), "geometry.kv_heads"),
        ("/geometry/kv_heads", json!(2), "geometry.heads"),
        ("/geometry/head_width", json!(12), "geometry.head_width"),
        ("/geometry/mlp_ratio", json!(0), "geometry.mlp_ratio"),
        ("/geometry/latent/channels", json!(0), "geometry.latent.channels"),
        ("/geometry/latent/channels", json!(65_536), "geometry.latent.channels"),
        ("/geometry/latent/height", json!(65_536), "geometry.latent.height"),
        ("/geometry/latent/width", json!(3), "geometry.latent.width"),
        ("/geometry/patch", json!([0, 2]), "geometry.patch[0]"),
        ("/geometry/patch", json!([2, 65_536]), "geometry.patch[1]"),
        ("/geometry/patch", json!([2]), "geometry.patch"),
        ("/geometry/patch", json!([2, 2, 2]), "geometry.patch"),
        ("/geometry/tokens", json!(2), "geometry.tokens"),
        ("/geometry/local/window", json!(0), "geometry.local.window"),
        ("/geometry/global/window", json!(3), "geometry.global.window"),
        ("/geometry/global/window", json!(10), "geometry.global.window"),
        ("/geometry/global/dilation", json!(0), "geometry.global.dilation"),
        ("/geometry/global/max_window", json!(9), "geometry.global.max_window"),
        ("/geometry/global/max_window", json!(1 << 30), "geometry.global.max_window"),
        ("/geometry/global/period", json!(0), "geometry.global.period"),
        ("/geometry/global/offset", json!(i32::MIN), "geometry.global.offset"),
        ("/geometry/control_period", json!(0), "geometry.control_period"),
        ("/geometry/rope/nyquist_fraction", json!(0.0), "geometry.rope.nyquist_fraction"),
        ("/geometry/rope/nyquist_fraction", json!(1.5), "geometry.rope.nyquist_fraction"),
        ("/geometry/rope/time_base", json!(1.0), "geometry.rope.time_base"),
        ("/geometry/rope/time_base", json!("NaN"), "geometry.rope.time_base"),
        ("/geometry/rope/rounding", json!("f16"), "geometry.rope.rounding"),
        ("/geometry/autoencoder/temporal", json!(8), "geometry.autoencoder.temporal"),
        ("/geometry/autoencoder/spatial", json!(8), "geometry.autoencoder.spatial"),
        ("/geometry/autoencoder/memories", json!([[1, 1, 1]]), "geometry.autoencoder.memories"),
        ("/geometry/autoencoder/memories/4", json!([1, 0, 1]), "geometry.autoencoder.memories[4][1]"),
        ("/geometry/autoencoder/memories/8", json!([1, 1, 1 << 20]), "geometry.autoencoder.memories[8][2]"),
        ("/sampler/schedule", json!([0.0]), "sampler.schedule"),
        ("/sampler/schedule", json!([1.0, 0.5, 0.5, 0.0]), "sampler.schedule"),
        ("/sampler/schedule", json!([1.0, 0.5]), "sampler.schedule"),
        ("/sampler/schedule", json!([1.5, 0.0]), "sampler.schedule"),
        ("/sampler/schedule", json!([1.0, -0.5, 0.0]), "sampler.schedule"),
        ("/sampler/schedule", json!(vec![0.5; 65]), "sampler.schedule"),
        ("/sampler/sigma_rounding", json!("f16"), "sampler.sigma_rounding"),
        ("/rates/latents_per_second", json!(0), "rates.latents_per_second"),
        ("/rates/time_multiplier", json!(0), "rates.time_multiplier"),
        ("/controls/mouse", json!(3), "controls.mouse"),
        ("/controls/buttons", json!(255), "controls.buttons"),
        ("/controls/scroll", json!(0), "controls.scroll"),
        ("/picture/decoded", json!([32, 64]), "picture.decoded[1]"),
        ("/picture/render", json!([0, 32]), "picture.render[0]"),
        ("/picture/render", json!([40, 65_536]), "picture.render[1]"),
        ("/picture/render", json!([257, 32]), "picture.render[0]"),
        ("/picture/range", json!([-1, 1]), "picture.range"),
        ("/graphs/f32/encoder", json!("absent.onnx"), "graphs.f32.encoder"),
        ("/graphs/f32/encoder", json!("decoder.f32.onnx"), "graphs.f32.decoder"),
        ("/graphs/f16", json!(null), "graphs.f16"),
        ("/graphs/f16/transformer", json!("../transformer.f32.onnx"), "graphs.f16.transformer"),
        ("/files", json!([]), "files"),
        ("/files/0/path", json!("../LICENSE.txt"), "files[0].path"),
        ("/files/0/path", json!("C:\\LICENSE.txt"), "files[0].path"),
        ("/files/0/path", json!("Cairn-World.json"), "files[0].path"),
        ("/files/1/path", json!("license.TXT"), "files[1].path"),
        ("/files/0/size", json!(-1), "files[0].size"),
        ("/files/0/sha256", json!("00"), "files[0].sha256"),
        ("/files/0/sha256", json!("A".repeat(64)), "files[0].sha256"),
        ("/licence/spdx", json!(""), "licence.spdx"),
        ("/licence/spdx", json!("MIT\n"), "licence.spdx"),
        ("/licence/file", json!("absent.txt"), "licence.file"),
        ("/provenance/tool", json!(3), "provenance.tool"),
    ]
}

#[test]
fn each_wrong_member_is_named() {
    for (pointer, wrong, field) in cases() {
        let case = format!("{pointer} = {wrong}");
        let files = ToyBundle::new().files_with(|manifest| {
            *manifest.pointer_mut(pointer).expect("the manifest has this member") = wrong.clone();
        });
        let error = refusal(&case, Bundle::from_memory(files));
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidBundle, Some(field)), "{case}: {error}");
    }
}

/// Calls `visit` with the pointer of every object in `value`.
fn objects(value: &Json, at: &str, visit: &mut dyn FnMut(&str, &serde_json::Map<String, Json>)) {
    match value {
        Json::Object(members) => {
            visit(at, members);
            members.iter().for_each(|(name, inner)| objects(inner, &format!("{at}/{name}"), visit));
        }
        Json::Array(items) => {
            items.iter().enumerate().for_each(|(i, inner)| objects(inner, &format!("{at}/{i}"), visit))
        }
        _ => {}
    }
}

#[test]
fn each_missing_and_each_unknown_member_is_named() {
    let full = ToyBundle::new().full_manifest();
    let (mut missing, mut unknown) = (0, 0);
    objects(&full, "", &mut |at, members| {
        if at == "/provenance" {
            return;
        }
        let parse_edited = |edit: &dyn Fn(&mut serde_json::Map<String, Json>)| {
            let mut manifest = full.clone();
            edit(manifest.pointer_mut(at).and_then(Json::as_object_mut).expect("an object"));
            Manifest::parse(&serde_json::to_vec(&manifest).expect("JSON"))
                .map_err(|error| (error.offending_field().map(str::to_owned), error))
        };
        for name in members.keys().filter(|name| format!("{at}/{name}") != "/graphs/f16") {
            let (field, error) = parse_edited(&|object| drop(object.remove(name))).expect_err(name);
            assert!(field.is_some_and(|field| field.ends_with(name.as_str())), "{at}/{name} missing: {error}");
            missing += 1;
        }
        let (field, error) = parse_edited(&|object| drop(object.insert("surprise".into(), json!(1)))).expect_err(at);
        assert!(field.is_some_and(|field| field.ends_with("surprise")), "{at}/surprise: {error}");
        unknown += 1;
    });
    assert!(missing > 60 && unknown > 15, "{missing} and {unknown} cases");
}

#[test]
fn joined_graphs_are_in_both_precisions_or_in_none() {
    let toy = ToyBundle::with_joined();
    let bundle = Bundle::from_memory(toy.files()).unwrap();
    assert!(bundle.model(GraphKind::Joined, Precision::F16).is_ok());
    for (pointer, wrong, field) in [
        ("/graphs/f32/joined", json!(null), "graphs.f32.joined"),
        ("/graphs/f32/joined", json!("none.onnx"), "graphs.f32.joined"),
        ("/graphs/f32/joined", json!("decoder.f32.onnx"), "graphs.f32.joined"),
        ("/graphs/f32/joined", json!("transformer.f16.onnx"), "graphs.f16.transformer"),
    ] {
        let edit = |manifest: &mut serde_json::Value| *manifest.pointer_mut(pointer).unwrap() = wrong.clone();
        let error = refusal(&wrong.to_string(), Bundle::from_memory(toy.files_with(edit)));
        assert_eq!(error.offending_field(), Some(field), "{wrong}: {error}");
    }
    for precision in ["f32", "f16"] {
        let files =
            toy.files_with(|manifest| drop(manifest["graphs"][precision].as_object_mut().unwrap().remove("joined")));
        assert_eq!(refusal(precision, Bundle::from_memory(files)).offending_field(), Some("graphs.f16.joined"));
    }
    let wrong = |edit: fn(&mut Model)| {
        let mut toy = toy.clone();
        edit(toy.model("joined.f16.onnx"));
        refusal("a wrong joined graph", Bundle::from_memory(toy.files())).to_string()
    };
    assert!(wrong(|model| drop(model.inputs.remove(1))).contains("`finished`"));
    assert!(wrong(|model| model.inputs[6].dims.truncate(1)).contains("`controls`"));
    // Keys of the next latent in place of those of the finished one have another shape.
    assert!(wrong(|model| model.outputs[1].dims[2] = Dim::Number(2)).contains("`present.0.k`"));
}

#[test]
fn unsupported_versions_and_model_types_are_refused() {
    for (found, age, remedy) in [(2, "newer", "Update"), (0, "older", "Build"), (u64::MAX, "newer", "Update")] {
        // A newer manifest may have members unknown here, and lack known ones.
        let text = format!("{{\"schema_version\": {found}, \"surprise\": [1]}}");
        let error = Manifest::parse(text.as_bytes()).unwrap_err();
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::Unsupported, Some("schema_version")));
        assert!(error.to_string().contains(age) && error.to_string().contains(remedy), "{error}");
    }
    let files = ToyBundle::new().files_with(|manifest| manifest["model_type"] = json!("waypoint-1"));
    let error = refusal("model type", Bundle::from_memory(files));
    assert_eq!((error.kind(), error.offending_field()), (ErrorKind::Unsupported, Some("model_type")));
}

#[test]
fn text_that_is_no_manifest_is_refused() {
    let full = serde_json::to_string(&ToyBundle::new().full_manifest()).unwrap();
    let deep = "[".repeat(100_000);
    let twice = full.replacen("\"name\":", "\"name\":\"a\",\"name\":", 1);
    let infinite = full.replacen("10000.0", "1e999", 1);
    let trailing = format!("{full} x");
    let padded = format!("{full}{}", " ".repeat(1 << 20));
    for text in
        ["", "null", "[]", "{}", "{\"schema_version\":1}", "\u{feff}{}", &deep, &twice, &infinite, &trailing, &padded]
    {
        let error = Manifest::parse(text.as_bytes()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidBundle, "{error}");
        assert!(error.offending_field().is_some() && error.to_string().len() < 1000);
    }
    let error = Manifest::parse(&[b'{', 0xFF, 0xFE]).unwrap_err();
    assert_eq!(error.offending_field(), Some(MANIFEST_NAME));
}
