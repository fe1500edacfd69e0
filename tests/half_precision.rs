//! The check at load that float16 is enough for a bundle: of worlds for which it is, and of the same worlds with larger weights, whose residual
//! stream passes float16's largest number.

use std::borrow::Cow;
use std::sync::Arc;

use cairn::bundle::{Bundle, MANIFEST_NAME, Precision};
use cairn::runtime::DeviceKind;
use cairn::world::{HalfPrecision, MAX_LATENT_ERROR, Rollout, World, WorldOptions};
use cairn::{ErrorKind, Result};
use half::f16;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use test_support::worlds::{bundle, bundle_path, controls, device, picture, point};

const WEIGHTS: &str = "transformer.bin";

fn checked(bundle: &Arc<Bundle>) -> Result<Arc<World>> {
    let options = WorldOptions { precision: Some(Precision::F16), check_precision: true, ..WorldOptions::default() };
    World::load(&device(), bundle, options)
}

fn comparison(name: &str) -> HalfPrecision {
    let world = checked(&bundle(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
    let found = world.half_precision().expect("a comparison").clone();
    println!("{name}: {found:?}");
    found
}

/// The number that follows `key` in the external data of the tensor `name` of a model's bytes.
fn external(model: &[u8], name: &str, key: &str) -> usize {
    let find = |from: usize, text: &[u8]| {
        from + model[from..].windows(text.len()).position(|bytes| bytes == text).expect("the text") + text.len()
    };
    // Of the places with this name, the first is not always the tensor: fields are a tag, a length and the text.
    let tensor = find(0, &[&[0x42, name.len() as u8], name.as_bytes()].concat());
    let value = find(tensor, &[&[0x0A, key.len() as u8], key.as_bytes()].concat());
    let digits = &model[value + 2..][..usize::from(model[value + 1])];
    std::str::from_utf8(digits).expect("digits").parse().expect("a number")
}

/// The bundle `name` with the last matrices of each branch multiplied by `factor`.
fn louder(name: &str, factor: f32) -> Arc<Bundle> {
    let folder = bundle_path(name);
    let read = |file: &str| std::fs::read(folder.join(file)).expect("a file of the bundle");
    let mut manifest: Value = serde_json::from_slice(&read(MANIFEST_NAME)).expect("a manifest");
    let model = read("transformer.f16.onnx");
    let mut weights = read(WEIGHTS);
    for layer in 0..manifest["geometry"]["layers"].as_u64().expect("a number") {
        for matrix in ["attn.out_proj", "mlp.fc2"] {
            let tensor = format!("blocks.{layer}.{matrix}.weight");
            let [offset, length] = ["offset", "length"].map(|key| external(&model, &tensor, key));
            for bytes in weights[offset..][..length].as_chunks_mut::<2>().0 {
                *bytes = f16::from_f32(f16::from_le_bytes(*bytes).to_f32() * factor).to_le_bytes();
            }
        }
    }
    let digest: String = Sha256::digest(&weights).iter().map(|byte| format!("{byte:02x}")).collect();
    let mut files = Vec::new();
    for entry in manifest["files"].as_array_mut().expect("a list") {
        let path = entry["path"].as_str().expect("a path").to_owned();
        if path == WEIGHTS {
            entry["sha256"] = json!(digest);
        } else {
            files.push((path.clone(), Cow::Owned(read(&path))));
        }
    }
    files.push((WEIGHTS.to_owned(), Cow::Owned(weights)));
    files.push((MANIFEST_NAME.to_owned(), Cow::Owned(serde_json::to_vec(&manifest).expect("a manifest"))));
    Bundle::from_memory(files).expect("a bundle")
}

#[test]
fn float16_is_enough_for_the_test_worlds() {
    for (name, is_wide) in [("tiny", false), ("tiny-residual", true), ("miniature-8bit", false)] {
        let found = comparison(name);
        assert_eq!(found.is_residual_wide, is_wide);
        println!("{name}: errors of {:e}, and of {:e} in a layer", found.latent_error, found.worst_layer.1);
        // The WebGPU provider adds products of 8-bit weights in float16.
        let factor = if device().kind() == DeviceKind::WebGpu { 1.25 } else { 1.0 };
        let (most, most_of_a_layer) = (factor * MAX_LATENT_ERROR / 3.0, MAX_LATENT_ERROR);
        assert!(found.latent_error > 0.0 && found.latent_error < most, "{name}");
        assert!(found.worst_layer.1 > 0.0 && found.worst_layer.1 < most_of_a_layer, "{name}");
        let peak = found.peak.expect("transformers that name their values alike");
        assert!(peak.magnitude > 1.0 && peak.magnitude < 65504.0, "{name}: {peak:?}");
    }
}

#[test]
fn a_world_is_checked_only_on_request_and_only_in_float16() {
    let tiny = bundle("tiny");
    let load = |precision, check_precision| {
        let options = WorldOptions { precision: Some(precision), check_precision, ..WorldOptions::default() };
        World::load(&device(), &tiny, options).expect("a world").half_precision().cloned()
    };
    assert_eq!((load(Precision::F16, false), load(Precision::F32, true)), (None, None));
    let (first, again) = (load(Precision::F16, true), load(Precision::F16, true));
    assert!(first.is_some() && first == again, "the same bundle and device give the same numbers");
}

#[test]
fn sums_that_pass_float16_are_named_and_float32_mends_them() {
    let loud = louder("tiny", 5e4);
    let error = checked(&loud).expect_err("an overflow");
    println!("{error}");
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    let tensor = error.offending_field().expect("a tensor");
    assert!(tensor.starts_with("blocks.") && tensor.ends_with(".sum"), "{tensor}");
    assert!(error.to_string().contains("a sum of the residual stream reaches"), "{error}");
    assert!(error.remedy_text().is_some_and(|text| text.contains("--residual float32")), "{error}");

    // A graphics adapter computes in float16, so a rollout would have failed. The processor's provider computes the sums in float32.
    if device().is_gpu() {
        let options = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
        let world = World::load(&device(), &loud, options).expect("a world");
        let mut rollout = Rollout::new(&world, &point(&world), 1).expect("a rollout");
        let made = rollout.append(&picture(40, 30, 1)).and_then(|_| rollout.step(&controls(0)));
        assert_eq!(made.expect_err("infinite sums").kind(), ErrorKind::Device);
    }

    let world = checked(&louder("tiny-residual", 5e4)).expect("a world");
    let found = world.half_precision().expect("a comparison");
    println!("{found:?}");
    assert!(
        found.peak.as_ref().is_some_and(|peak| !peak.is_residual && peak.magnitude > 2e4 && peak.magnitude < 65504.0)
    );
    assert!(found.latent_error < MAX_LATENT_ERROR / 3.0);
    let mut rollout = Rollout::new(&world, &point(&world), 1).expect("a rollout");
    rollout.append(&picture(40, 30, 1)).expect("a seed");
    rollout.step(&controls(0)).expect("a step");
}

#[test]
fn branches_that_pass_float16_need_float32_graphs() {
    // Attention's last product alone passes 65504, which a wider residual stream does not mend.
    let error = checked(&louder("tiny-residual", 2e5)).expect_err("an overflow");
    println!("{error}");
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("a value of the transformer reaches"), "{error}");
    assert_eq!(error.remedy_text(), Some("Load it in f32"));
}
