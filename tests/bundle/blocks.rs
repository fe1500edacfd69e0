//! Matrices in 8 or 4 bits: valid forms are read, and every invalid one is refused with the tensor or node and the reason.

use cairn::ErrorKind;
use cairn::bundle::{Bundle, Precision, Processor};
use serde_json::json;
use test_support::bundles::onnx_writer::*;
use test_support::bundles::toy_bundle::{ToyBundle, WEIGHTS};

use crate::refusal;

const MODELS: [&str; 2] = ["transformer.f32.onnx", "transformer.f16.onnx"];
/// Offset of the scales in the file of weights, and their count.
const SCALES: (usize, usize) = (512, 16);

/// Name of a case, a change of a model, and a part of the error's text.
type Case = (&'static str, fn(&mut Model), &'static str);

/// A stored tensor of bytes.
fn bytes(name: &str, dims: &[i64], offset: u64) -> Tensor {
    let mut tensor = external(name, dims, WEIGHTS, offset);
    tensor.data_type = U8;
    set_length(&mut tensor, dims.iter().product());
    tensor
}

fn set_length(tensor: &mut Tensor, length: i64) {
    let Data::External(entries) = &mut tensor.data else { panic!("an external tensor") };
    entries.iter_mut().find(|(key, _)| key == "length").expect("a length").1 = length.to_string();
}

/// The first 256 controls and the noise level, times a matrix of 256 rows and 2 columns, in `bits` and blocks of 32. It runs in each pass, because it
/// depends on both.
fn with_product(bits: i64) -> ToyBundle {
    let mut toy = ToyBundle::new();
    toy.manifest["quantisation"] =
        json!({ "bits": bits, "block": 32, "activation_bits": 16, "kept_in_16_bits": ["blocks.0"] });
    for name in MODELS {
        let m = toy.model(name);
        m.opsets.push(("com.microsoft".to_owned(), 1));
        for (name, bound) in [("from", 0), ("to", 256), ("axis", 1)] {
            m.tensors.push(inside_ints(name, &[bound]));
        }
        m.nodes.push(node("Slice", &["controls", "from", "to", "axis"], &["first"], vec![]));
        m.nodes.push(node("Add", &["first", "sigma"], &["row"], vec![]));
        m.tensors.push(bytes("numbers", &[2, 8, 4 * bits], 0));
        m.tensors.push(external("scales", &[2, 8], WEIGHTS, SCALES.0 as u64));
        m.nodes.push(node("Cast", &["scales"], &["scales.f32"], vec![int("to", F32)]));
        let sizes = [("K", 256), ("N", 2), ("bits", bits), ("block_size", 32), ("accuracy_level", 0)];
        let attributes = sizes.map(|(name, value)| int(name, value)).to_vec();
        let product = node("MatMulNBits", &["row", "numbers", "scales.f32"], &["product"], attributes);
        m.nodes.push(Node { domain: Some("com.microsoft".to_owned()), ..product });
    }
    toy
}

fn product(m: &mut Model) -> &mut Node {
    m.node("MatMulNBits")
}

fn tensor<'a>(m: &'a mut Model, name: &str) -> &'a mut Tensor {
    m.tensors.iter_mut().find(|tensor| tensor.name == name).expect("the tensor")
}

/// Sets the attribute at `i` of the product: K, N, bits, block_size or accuracy_level.
fn set(m: &mut Model, i: usize, value: i64) {
    let name = ["K", "N", "bits", "block_size", "accuracy_level"][i];
    product(m).attributes[i] = int(name, value);
}

/// Checks that each change is refused with its text, and that the error names the model's file.
#[track_caller]
fn check(cases: &[Case]) {
    for (case, change, part) in cases {
        let mut toy = with_product(8);
        change(toy.model(MODELS[0]));
        let error = refusal(case, Bundle::from_memory(toy.files()));
        assert_eq!(
            (error.kind(), error.offending_field()),
            (ErrorKind::InvalidBundle, Some(MODELS[0])),
            "{case}: {error}"
        );
        assert!(error.to_string().contains(part), "{case}: `{error}` does not say `{part}`");
    }
}

#[test]
fn both_widths_are_read_and_counted() {
    let plain = Bundle::from_memory(ToyBundle::new().files()).unwrap();
    for bits in [8, 4] {
        let bundle = Bundle::from_memory(with_product(bits).files()).unwrap();
        let stated = bundle.manifest().quantisation.as_ref().unwrap();
        assert_eq!((i64::from(stated.bits), stated.block, stated.activation_bits), (bits, 32, 16));
        for precision in Precision::ALL {
            let [with, without] = [&bundle, &plain].map(|bundle| bundle.cost(precision, 4).unwrap().pass);
            assert_eq!(with.multiply_adds - without.multiply_adds, 2 * 256);
            let need = |bundle: &Bundle, processor| bundle.memory_need(precision, processor, 4).unwrap();
            let held = [&bundle, &plain].map(|bundle| need(bundle, Processor::Cpu).weights);
            // Integers as stored, scales in f32, and the bounds of the slice.
            assert_eq!(held[0] - held[1], 64 * bits.unsigned_abs() + 4 * 16 + 3 * 8);
        }
    }
}

#[test]
fn memory_counts_the_matrix_that_a_processor_unpacks() {
    let with = |bits: i64, rounds: bool| {
        let mut toy = with_product(bits);
        if rounds {
            toy.manifest["quantisation"]["activation_bits"] = json!(8);
            MODELS.iter().for_each(|name| set(toy.model(name), 4, 4));
        }
        Bundle::from_memory(toy.files()).unwrap()
    };
    let plain = Bundle::from_memory(ToyBundle::new().files()).unwrap();
    // The product's activations are the controls, which are float32 in both models.
    let matrix = 256 * 2 * 4;
    for precision in Precision::ALL {
        let unpacked = |bundle: &Bundle| {
            [Processor::Cpu, Processor::Gpu].map(|on| {
                let need = bundle.memory_need(precision, on, 4).unwrap();
                let parts = need.bundle + need.weights + need.ring + need.slabs + need.intermediates + need.autoencoder;
                assert_eq!(need.total, parts + need.arena + need.unpacked);
                need.unpacked
            })
        };
        assert_eq!(unpacked(&plain), [0, 0]);
        assert_eq!(unpacked(&with(8, false)), [matrix, matrix]);
        // With 8-bit activations, and with 4 bits, the CPU provider multiplies by the matrix as it is stored.
        assert_eq!(unpacked(&with(8, true)), [0, matrix]);
        assert_eq!(unpacked(&with(4, false)), [0, matrix]);
    }
}

#[test]
fn an_invalid_product_is_refused() {
    let cases: [Case; 20] = [
        ("5 bits", |m| set(m, 2, 5), "has the bits 5"),
        ("other bits than stated", |m| set(m, 2, 4), "has the bits 4, the manifest states 8"),
        ("blocks of 24", |m| set(m, 3, 24), "block_size 24"),
        ("blocks of 0", |m| set(m, 3, 0), "block_size 0"),
        ("negative blocks", |m| set(m, 3, -32), "block_size -32"),
        ("another block than stated", |m| set(m, 3, 64), "block_size 64, the manifest states 32"),
        ("another accuracy", |m| set(m, 4, 1), "accuracy_level 1"),
        ("rounded activations", |m| set(m, 4, 4), "rounds activations to 8 bits, the manifest states 16"),
        ("more rows", |m| set(m, 0, 288), "by 288 rows"),
        ("a size that overflows", |m| set(m, 0, i64::MAX), "rows in blocks of 32"),
        ("no columns", |m| set(m, 1, 0), "no positive K and N"),
        ("more columns", |m| set(m, 1, 3), "ask for uint8 [3, 8, 32]"),
        ("columns that overflow", |m| set(m, 1, i64::MAX), "ask for uint8"),
        (
            "zero points",
            |m| {
                m.tensors.push(bytes("zeros", &[2, 8], 0));
                product(m).inputs.push("zeros".into());
            },
            "has the zero points `zeros`",
        ),
        ("fewer scales", |m| tensor(m, "scales").dims = vec![2, 7], "initializer `scales`"),
        (
            "scales of another shape",
            |m| tensor(m, "scales").dims = vec![8, 2],
            "scales float32 [8, 2], its attributes ask for float32 [2, 8]",
        ),
        (
            "integers of another shape",
            |m| tensor(m, "numbers").dims = vec![8, 2, 32],
            "integers uint8 [8, 2, 32], its attributes ask for uint8 [2, 8, 32]",
        ),
        ("integers outside their file", |m| *tensor(m, "numbers") = bytes("numbers", &[2, 8, 32], 6600), "bytes 6600"),
        ("sizes that overflow", |m| tensor(m, "numbers").dims = vec![1 << 32, 1 << 32, 32], "initializer `numbers`"),
        ("integers that are computed with", |m| product(m).inputs[0] = "numbers".into(), "MatMulNBits"),
    ];
    check(&cases);
}

#[test]
fn operands_that_are_not_stored_are_refused() {
    let cases: [Case; 3] = [
        (
            "scales that are an input",
            |m| {
                m.tensors.push(inside_ints("shape", &[2, 8]));
                for (name, bound) in [("s.from", 0), ("s.to", 16)] {
                    m.tensors.push(inside_ints(name, &[bound]));
                }
                m.nodes.insert(0, node("Slice", &["controls", "s.from", "s.to", "axis"], &["sixteen"], vec![]));
                m.nodes.insert(1, node("Reshape", &["sixteen", "shape"], &["given"], vec![]));
                product(m).inputs[2] = "given".into();
            },
            "reads `given`, which is no stored tensor of float16",
        ),
        ("half floats as integers", |m| product(m).inputs[1] = "scales".into(), "no stored tensor of uint8"),
        ("bytes in a sum", |m| m.nodes.push(node("Add", &["numbers", "numbers"], &["sum"], vec![])), "integers"),
    ];
    check(&cases);
}

#[test]
fn scales_that_are_not_positive_are_refused() {
    // Half floats: not a number, infinite, 0, and -1.
    for (bits, text) in [(0x7E00_u16, "NaN"), (0x7C00, "inf"), (0, "0"), (0xBC00, "-1")] {
        for at in [0, SCALES.1 - 1] {
            let mut toy = with_product(8);
            let file = toy.data.get_mut(WEIGHTS).unwrap();
            file[SCALES.0 + 2 * at..][..2].copy_from_slice(&bits.to_le_bytes());
            let error = refusal(text, Bundle::from_memory(toy.files()));
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidBundle, Some(MODELS[0])), "{error}");
            let expected = format!("initializer `scales`: scale {at} is {text}, a scale is finite and above 0");
            assert!(error.to_string().contains(&expected), "{error}");
        }
    }
    let mut toy = with_product(8);
    for name in MODELS {
        let scales = tensor(toy.model(name), "scales");
        scales.data = Data::Inside([1_u8, 0, 0, 0].repeat(8));
    }
    let error = refusal("a scale inside the model", Bundle::from_memory(toy.files()));
    assert!(error.to_string().contains("initializer `scales`: scale 1 is 0"), "{error}");
}

#[test]
fn a_manifest_that_states_something_else_is_refused() {
    let mut silent = with_product(8);
    silent.manifest.as_object_mut().unwrap().remove("quantisation");
    let error = refusal("no statement", Bundle::from_memory(silent.files()));
    assert!(error.to_string().contains("the manifest states no `quantisation`"), "{error}");
    let mut empty = ToyBundle::new();
    empty.manifest["quantisation"] = with_product(8).manifest["quantisation"].clone();
    let error = refusal("no product", Bundle::from_memory(empty.files()));
    assert!(error.to_string().contains("the graph has no MatMulNBits"), "{error}");

    for (member, value) in [
        ("bits", json!(5)),
        ("bits", json!(-8)),
        ("bits", json!(4_294_967_304_u64)),
        ("block", json!(48)),
        ("activation_bits", json!(4)),
        ("kept_in_16_bits", json!(["two words"])),
        ("kept_in_16_bits", json!([""])),
        ("kept_in_16_bits", json!("blocks.0")),
        ("zero_point", json!(8)),
    ] {
        let mut toy = with_product(8);
        toy.manifest["quantisation"][member] = value.clone();
        let error = refusal(member, Bundle::from_memory(toy.files()));
        let field = error.offending_field().unwrap_or_default();
        let wanted = format!("quantisation.{member}");
        assert_eq!((error.kind(), field.contains(&wanted)), (ErrorKind::InvalidBundle, true), "{value}: {error}");
    }
    let mut toy = with_product(8);
    toy.manifest["quantisation"] = json!(null);
    assert_eq!(refusal("null", Bundle::from_memory(toy.files())).kind(), ErrorKind::InvalidBundle);
}
