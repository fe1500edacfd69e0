//! Bundles, models and manifests with changed, truncated and pseudo-randomly mutated bytes are refused or equal; nothing panics.

use cairn::bundle::{Bundle, GraphKind, Manifest, Precision, check_model};
use test_support::bundles::toy_bundle::{ToyBundle, WEIGHTS};
use test_support::bundles::zip_writer::Zip;
use test_support::fuzz_targets::{self, seeds};
use test_support::mutator::Mutator;

/// A toy bundle of one precision, for speed.
fn small() -> ToyBundle {
    let mut toy = ToyBundle::new();
    toy.manifest["graphs"].as_object_mut().unwrap().remove("f16");
    toy.models.retain(|name, _| name.contains("f32"));
    toy
}

#[test]
fn every_flipped_byte_of_an_archive_is_refused_or_harmless() {
    let files = small().files();
    let bytes = Zip::of(files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_ref()))).encode();
    let expected = Bundle::from_archive(bytes.clone()).unwrap();
    let weights = files.iter().find(|(name, _)| name == WEIGHTS).unwrap().1.to_vec();
    let start = bytes.windows(weights.len()).position(|window| window == weights).unwrap();
    let sampled = |at: &usize| !(start + 64..start + weights.len() - 64).contains(at) || at.is_multiple_of(97);
    let (mut tried, mut refused) = (0, 0);
    for at in (0..bytes.len()).filter(sampled) {
        let mut changed = bytes.clone();
        changed[at] ^= 1 << (at % 8);
        tried += 1;
        match Bundle::from_archive(changed) {
            Ok(bundle) => assert_eq!(bundle.digest(), expected.digest(), "byte {at}"),
            Err(_) => refused += 1,
        }
    }
    // Times, attributes and the like in an archive's headers are ignored; every other change is detected.
    assert!(tried > 5000 && refused > tried * 9 / 10, "{refused} of {tried}");
}

#[test]
fn every_truncated_model_is_refused() {
    let toy = ToyBundle::new();
    let manifest = parsed(&toy);
    for (name, kind, precision) in models() {
        let bytes = toy.contents()[&name].clone();
        check_model(&bytes, &manifest, kind, precision).unwrap();
        for len in 0..bytes.len() {
            // The opset comes last in the file, so no truncated model is complete.
            assert!(check_model(&bytes[..len], &manifest, kind, precision).is_err(), "{name} cut to {len}");
        }
    }
}

#[test]
fn models_with_flipped_bytes_never_panic() {
    let toy = ToyBundle::new();
    let manifest = parsed(&toy);
    for (name, kind, precision) in models() {
        let bytes = toy.contents()[&name].clone();
        for at in 0..bytes.len() {
            for mask in [1 << (at % 8), 0x80, 0xFF] {
                let mut changed = bytes.clone();
                changed[at] ^= mask;
                // A flip inside a name is not an error here; the checksums of a bundle detect it.
                drop(check_model(&changed, &manifest, kind, precision));
            }
        }
    }
}

#[test]
fn truncated_and_flipped_manifests_are_refused_or_written_back_equal() {
    let bytes = serde_json::to_vec(&ToyBundle::new().full_manifest()).unwrap();
    for len in 0..bytes.len() {
        assert!(Manifest::parse(&bytes[..len]).is_err(), "cut to {len}");
    }
    for at in 0..bytes.len() {
        for mask in [1 << (at % 8), 0x80] {
            let mut changed = bytes.clone();
            changed[at] ^= mask;
            fuzz_targets::manifest(&changed);
        }
    }
}

#[test]
fn fuzz_targets_accept_seeded_mutations_of_their_seeds() {
    for (target, seeds) in [
        (fuzz_targets::manifest as fn(&[u8]), seeds::manifest()),
        (fuzz_targets::onnx, seeds::onnx()),
        (fuzz_targets::control_script, seeds::control_script()),
    ] {
        let mut mutator = Mutator(1);
        for seed in &seeds {
            target(seed);
            for _ in 0..300 {
                target(&mutator.mutate(seed, &seeds));
            }
        }
    }
}

fn parsed(toy: &ToyBundle) -> Manifest {
    Manifest::parse(&serde_json::to_vec(&toy.full_manifest()).unwrap()).unwrap()
}

fn models() -> Vec<(String, GraphKind, Precision)> {
    let all =
        Precision::ALL.into_iter().flat_map(|p| GraphKind::REQUIRED.map(|kind| (format!("{kind}.{p}.onnx"), kind, p)));
    all.collect()
}
