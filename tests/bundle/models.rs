//! Invalid models: each is refused before anything runs, and the error names its file.

use cairn::ErrorKind;
use cairn::bundle::{Bundle, operators};
use test_support::bundles::onnx_writer::*;
use test_support::bundles::toy_bundle::{ToyBundle, WEIGHT_BYTES, WEIGHTS};

use crate::refusal;

const TRANSFORMER: &str = "transformer.f32.onnx";
const ENCODER: &str = "encoder.f32.onnx";
const DECODER: &str = "decoder.f16.onnx";

/// Name of a case, a model, a change of it, and a part of the error's text.
type Case = (&'static str, &'static str, fn(&mut Model), &'static str);

/// Checks that each case is refused with its text, and that the error names the model's file.
#[track_caller]
fn check(cases: &[Case]) {
    for (case, name, change, part) in cases {
        let mut toy = ToyBundle::new();
        change(toy.model(name));
        let error = refusal(case, Bundle::from_memory(toy.files()));
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidBundle, Some(*name)), "{case}: {error}");
        assert!(error.to_string().contains(part), "{case}: `{error}` does not say `{part}`");
    }
}

fn message() -> Message {
    Message::default()
}

/// Inserts a node before all others.
fn insert_node(m: &mut Model, operator: &str, attributes: Vec<Message>) {
    m.nodes.insert(0, node(operator, &["x"], &["added"], attributes));
}

/// Version of the domain of ONNX Runtime's own operators.
fn contrib() -> (String, i64) {
    ("com.microsoft".to_owned(), 1)
}

/// Adds a node that multiplies the first layer's queries by its keys, in `domain`.
fn add_scores(m: &mut Model, domain: Option<String>) {
    m.opsets.push(contrib());
    let attributes = vec![float("alpha", 0.125), int("transB", 1)];
    m.nodes.push(Node { domain, ..node("FusedMatMul", &["q.0", "keys.0"], &["added"], attributes) });
}

/// Adds a norm of the first layer's queries, with a gain of `width`.
fn add_norm(m: &mut Model, width: i64, attributes: Vec<Message>) {
    m.tensors.push(inside_floats("gain", &[width], &vec![1.0; width as usize]));
    m.nodes.push(node("SimplifiedLayerNormalization", &["q.0", "gain"], &["added"], attributes));
}

/// Adds a rotation of the first layer's queries from position `start` on, by a table of the dimensions `table`.
fn add_rotation(m: &mut Model, start: i64, table: &[i64], attributes: Vec<Message>) {
    m.opsets.push(contrib());
    m.tensors.push(inside_ints("start", &[start]));
    m.tensors.push(inside_ints("table.shape", table));
    for name in ["rope_cos", "rope_sin"] {
        m.nodes.push(node("Reshape", &[name, "table.shape"], &[&format!("{name}.table")], vec![]));
    }
    let inputs = ["q.0", "start", "rope_cos.table", "rope_sin.table"];
    let domain = Some(contrib().0);
    m.nodes.push(Node { domain, ..node("RotaryEmbedding", &inputs, &["added"], attributes) });
}

#[test]
fn onnx_runtimes_operators_are_read_in_the_forms_of_the_format() {
    let forms: [fn(&mut Model); 5] = [
        |m| add_scores(m, Some(contrib().0)),
        |m| add_norm(m, 8, vec![float("epsilon", 1e-6), int("axis", -1)]),
        |m| add_norm(m, 8, vec![int("axis", 3)]),
        |m| add_rotation(m, 0, &[1, 4], vec![int("interleaved", 0)]),
        |m| m.opsets.push(contrib()),
    ];
    for (i, change) in forms.into_iter().enumerate() {
        let mut toy = ToyBundle::new();
        change(toy.model(TRANSFORMER));
        Bundle::from_memory(toy.files()).unwrap_or_else(|e| panic!("form {i}: {e}"));
    }
    check(&[
        ("a gain of another width", TRANSFORMER, |m| add_norm(m, 4, vec![]), "with a gain [4]"),
        ("a norm over more axes", TRANSFORMER, |m| add_norm(m, 8, vec![int("axis", 2)]), "normalises axis 2"),
        ("a NaN epsilon", TRANSFORMER, |m| add_norm(m, 8, vec![float("epsilon", f32::NAN)]), "epsilon"),
        ("a norm with a stash_type", TRANSFORMER, |m| add_norm(m, 8, vec![int("stash_type", 1)]), "attribute"),
        ("a table of more tokens", TRANSFORMER, |m| add_rotation(m, 0, &[2, 2], vec![]), "by a table [2, 2]"),
        ("a table of another rank", TRANSFORMER, |m| add_rotation(m, 0, &[4], vec![]), "by a table [4]"),
        ("a rotation behind the table", TRANSFORMER, |m| add_rotation(m, 1, &[1, 4], vec![]), "position 0"),
        ("neighbours", TRANSFORMER, |m| add_rotation(m, 0, &[1, 4], vec![int("interleaved", 1)]), "neighbours"),
        (
            "a position that is no constant",
            TRANSFORMER,
            |m| {
                add_rotation(m, 0, &[1, 4], vec![]);
                m.nodes.last_mut().unwrap().inputs[1] = "sigma".into();
            },
            "input 1",
        ),
        (
            "keys that are not transposed",
            TRANSFORMER,
            |m| {
                add_scores(m, Some(contrib().0));
                m.node("FusedMatMul").attributes.pop();
            },
            "FusedMatMul multiplies",
        ),
        (
            "transB 2",
            TRANSFORMER,
            |m| {
                add_scores(m, Some(contrib().0));
                m.node("FusedMatMul").attributes[1] = int("transB", 2);
            },
            "transB 2",
        ),
        (
            "an infinite factor",
            TRANSFORMER,
            |m| {
                add_scores(m, Some(contrib().0));
                m.node("FusedMatMul").attributes[0] = float("alpha", f32::INFINITY);
            },
            "alpha",
        ),
    ]);
}

#[test]
fn control_flow_functions_and_domains_are_refused() {
    check(&[
        ("Loop", TRANSFORMER, |m| insert_node(m, "Loop", vec![subgraph("body")]), "subgraph"),
        ("If", TRANSFORMER, |m| insert_node(m, "If", vec![subgraph("then_branch")]), "subgraph"),
        ("Scan", TRANSFORMER, |m| insert_node(m, "Scan", vec![subgraph("body")]), "subgraph"),
        ("Loop without a body", TRANSFORMER, |m| insert_node(m, "Loop", vec![]), "not on the list"),
        (
            "subgraph on an allowed operator",
            TRANSFORMER,
            |m| insert_node(m, "Tanh", vec![subgraph("body")]),
            "subgraph",
        ),
        (
            "subgraphs",
            TRANSFORMER,
            |m| insert_node(m, "Tanh", vec![message().bytes(1, "g").int(20, 10).bytes(11, "")]),
            "subgraph",
        ),
        ("unknown operator", TRANSFORMER, |m| insert_node(m, "Tanhh", vec![]), "not on the list"),
        ("operator of another case", TRANSFORMER, |m| insert_node(m, "tanh", vec![]), "not on the list"),
        ("random numbers", TRANSFORMER, |m| insert_node(m, "RandomNormalLike", vec![]), "not on the list"),
        ("ConstantOfShape", TRANSFORMER, |m| insert_node(m, "ConstantOfShape", vec![]), "not on the list"),
        ("Expand", TRANSFORMER, |m| insert_node(m, "Expand", vec![]), "not on the list"),
        ("Tile", TRANSFORMER, |m| insert_node(m, "Tile", vec![]), "not on the list"),
        (
            "custom domain on a node",
            TRANSFORMER,
            |m| m.node("Softmax").domain = Some("com.example".into()),
            "custom domain",
        ),
        (
            "an operator of the default domain in ONNX Runtime's",
            TRANSFORMER,
            |m| {
                m.opsets.push(contrib());
                m.node("Softmax").domain = Some(contrib().0);
            },
            "wrong domain",
        ),
        ("an operator of ONNX Runtime's in the default domain", TRANSFORMER, |m| add_scores(m, None), "wrong domain"),
        (
            "a domain that the model does not name",
            TRANSFORMER,
            |m| {
                add_scores(m, Some(contrib().0));
                m.opsets.pop();
            },
            "does not name",
        ),
        ("another custom opset", ENCODER, |m| m.opsets.push(("com.example".into(), 1)), "the default domain, 17"),
        ("another version of it", ENCODER, |m| m.opsets.push((contrib().0, 2)), "the default domain, 17"),
        ("it alone", ENCODER, |m| m.opsets = vec![contrib()], "the default domain, 17"),
        ("two default opsets", ENCODER, |m| m.opsets.push(("ai.onnx".into(), 18)), "the default domain, 17"),
        ("no opset", ENCODER, |m| m.opsets.clear(), "the default domain, 17"),
        ("opset 16", ENCODER, |m| m.opsets[0].1 = 16, "17 to 20"),
        ("opset 21", ENCODER, |m| m.opsets[0].1 = 21, "17 to 20"),
        ("IR 7", DECODER, |m| m.ir_version = 7, "IR version"),
        ("IR 11", DECODER, |m| m.ir_version = 11, "IR version"),
        ("IR 2^63", DECODER, |m| m.ir_version = i64::MIN, "IR version"),
        ("function", DECODER, |m| m.more = message().message(25, message().bytes(1, "f")), "functions"),
        ("training information", DECODER, |m| m.more = message().bytes(20, ""), "training"),
        ("metadata", DECODER, |m| m.more = message().bytes(14, ""), "metadata"),
        ("device configuration", DECODER, |m| m.more = message().bytes(26, ""), "unknown part"),
        ("sparse initializer", DECODER, |m| m.more_graph = message().bytes(15, ""), "sparse"),
        ("quantization", DECODER, |m| m.more_graph = message().bytes(14, ""), "unknown part"),
        ("overload", DECODER, |m| m.nodes[0].more = message().bytes(8, "f"), "unknown part"),
        ("node metadata", DECODER, |m| m.nodes[0].more = message().bytes(9, ""), "unknown part"),
        ("a second graph", DECODER, |m| m.more = message().bytes(7, ""), "twice"),
        ("a second IR version", DECODER, |m| m.more = message().int(1, 9), "twice"),
        ("a second operator", DECODER, |m| m.nodes[0].more = message().bytes(4, "Loop"), "twice"),
    ]);
}

#[test]
fn malformed_protobuf_is_refused() {
    fn more(m: &mut Model, bytes: &[u8]) {
        m.more = message().raw(bytes);
    }
    check(&[
        ("group", DECODER, |m| more(m, &[0x0B, 0x0C]), "wire type"),
        ("64-bit field", DECODER, |m| more(m, &[0x09, 0, 0, 0, 0, 0, 0, 0, 0]), "wire type"),
        ("field 0", DECODER, |m| more(m, &[0x00, 0]), "out of range"),
        ("varint of 11 bytes", DECODER, |m| more(m, &[0x80; 11]), "64 bits"),
        (
            "length of 2^64 - 1",
            DECODER,
            |m| more(m, &[0x12, 255, 255, 255, 255, 255, 255, 255, 255, 255, 1]),
            "ends inside",
        ),
        ("length beyond the end", DECODER, |m| more(m, &[0x1A, 100, 1, 2]), "ends inside"),
        ("text of the wrong type", DECODER, |m| more(m, &[0x18, 1]), "is not bytes"),
        ("text that is no UTF-8", DECODER, |m| more(m, &[0x1A, 2, 0xC3, 0x28]), "UTF-8"),
        ("a long name", DECODER, |m| m.nodes[0].more = message().bytes(3, "n".repeat(513)), "at most"),
        ("a thousand attributes", ENCODER, |m| m.node("Conv").attributes = vec![int("group", 1); 1000], "more than"),
        (
            "a million numbers",
            ENCODER,
            |m| m.node("Conv").attributes = vec![message().bytes(1, "pads").int(20, 7).bytes(8, vec![1; 1 << 20])],
            "more than",
        ),
        ("a rank of 1000", ENCODER, |m| m.tensor("conv").dims = vec![1; 1000], "more than"),
        ("100,000 nodes", ENCODER, |m| m.nodes = vec![node("Relu", &["a"], &["b"], vec![]); 100_000], "more than"),
        ("100,000 initializers", ENCODER, |m| m.tensors = vec![inside_ints("n", &[1]); 100_000], "more than"),
    ]);
    // Nesting is refused at its first level, which is an unknown field.
    let deep = (0..20_000).fold(message(), |inner, _| message().message(7, inner));
    let mut toy = ToyBundle::new();
    toy.model(DECODER).more_graph = deep;
    refusal("deep nesting", Bundle::from_memory(toy.files()));
}

/// Adds nodes that have documentation of the greatest length, 64 KiB.
fn add_documented_nodes(m: &mut Model, count: usize) {
    for i in 0..count {
        let mut documented = node("Tanh", &["rgb"], &[&format!("added.{i}")], vec![]);
        documented.more = message().bytes(6, vec![b' '; 1 << 16]);
        m.nodes.push(documented);
    }
}

#[test]
fn models_of_more_than_8_mib_are_refused() {
    let mut toy = ToyBundle::new();
    add_documented_nodes(toy.model(ENCODER), 127);
    Bundle::from_memory(toy.files()).expect("a model of less than 8 MiB");
    check(&[("128 nodes of more than 64 KiB", ENCODER, |m| add_documented_nodes(m, 128), "at most 8388608 are read")]);
}

#[test]
fn inputs_and_outputs_must_match_the_bundle_format() {
    check(&[
        ("wrong name", TRANSFORMER, |m| m.inputs[1].name = "noise".into(), "must be `sigma`"),
        ("wrong order", TRANSFORMER, |m| m.inputs.swap(3, 4), "must be `rope_cos`"),
        ("wrong order of outputs", TRANSFORMER, |m| m.outputs.swap(1, 2), "must be `present.0.k`"),
        ("wrong type", TRANSFORMER, |m| m.inputs[0].data_type = F16, "element type"),
        ("wrong type in f16", DECODER, |m| m.inputs[0].data_type = F32, "element type"),
        ("string type", TRANSFORMER, |m| m.inputs[0].data_type = 8, "element type"),
        ("wrong rank", TRANSFORMER, |m| drop(m.inputs[0].dims.pop()), "rank"),
        ("wrong dimension", TRANSFORMER, |m| m.inputs[5].dims[1] = Dim::Number(260), "dimension 1 is 260"),
        ("negative dimension", TRANSFORMER, |m| m.inputs[5].dims[1] = Dim::Number(-259), "dimension 1"),
        ("open dimension", TRANSFORMER, |m| m.inputs[5].dims[0] = Dim::Open, "open"),
        ("symbol for a number", TRANSFORMER, |m| m.inputs[0].dims[0] = Dim::Symbol("batch".into()), "batch"),
        ("number for a symbol", TRANSFORMER, |m| m.inputs[8].dims[2] = Dim::Number(2), "local_past"),
        ("another symbol", TRANSFORMER, |m| m.inputs[8].dims[2] = Dim::Symbol("global_past".into()), "local_past"),
        ("an input too few", TRANSFORMER, |m| drop(m.inputs.pop()), "inputs"),
        ("an input too many", ENCODER, |m| m.inputs.push(value("more", F32, &[1])), "inputs"),
        ("an output too few", ENCODER, |m| m.outputs.clear(), "outputs"),
        ("an output twice", DECODER, |m| m.outputs.push(value("rgb", F16, &[1])), "outputs"),
        (
            "an output that nothing makes",
            ENCODER,
            |m| m.node("Conv").outputs = strings(&["other"]),
            "before it is made",
        ),
        (
            "an output of another size",
            ENCODER,
            |m| m.node("Conv").attributes = vec![ints("strides", &[8, 8])],
            "comes out as",
        ),
        (
            "an output that is an input",
            DECODER,
            |m| {
                m.nodes.retain(|n| n.outputs[0] != "present_mem.0");
                m.outputs[1].name = "past_mem.0".into();
            },
            "must be `present_mem.0`",
        ),
        (
            "an output that is a weight",
            DECODER,
            |m| {
                m.nodes.retain(|n| n.outputs[0] != "present_mem.0");
                m.tensors.push(external("present_mem.0", &[1, 1, 1, 1], WEIGHTS, 0));
            },
            "does not depend",
        ),
        ("an input with a default value", ENCODER, |m| m.tensors.push(external("rgb", &[1], WEIGHTS, 0)), "made twice"),
    ]);
}

#[test]
fn shapes_must_be_consistent() {
    check(&[
        ("a value made twice", TRANSFORMER, |m| m.nodes.push(node("Tanh", &["x"], &["row.0"], vec![])), "made twice"),
        (
            "a value without a name",
            TRANSFORMER,
            |m| m.nodes.push(node("Tanh", &["x"], &[""], vec![])),
            "without a name",
        ),
        ("nodes out of order", TRANSFORMER, |m| m.nodes.reverse(), "before it is made"),
        ("a cycle", TRANSFORMER, |m| m.node("MatMul").inputs[0] = "row.1".into(), "before it is made"),
        ("too few inputs", TRANSFORMER, |m| drop(m.node("MatMul").inputs.pop()), "inputs"),
        ("too many inputs", TRANSFORMER, |m| m.node("Softmax").inputs.push("x".into()), "inputs"),
        ("a hole in the inputs", TRANSFORMER, |m| m.node("MatMul").inputs[0].clear(), "inputs"),
        ("too many outputs", TRANSFORMER, |m| m.node("Softmax").outputs.push("more".into()), "outputs"),
        ("unknown attribute", TRANSFORMER, |m| m.node("Softmax").attributes.push(int("axes", 1)), "attribute"),
        ("repeated attribute", TRANSFORMER, |m| m.node("Softmax").attributes.push(int("axis", 1)), "attribute"),
        ("mistyped attribute", TRANSFORMER, |m| m.node("Softmax").attributes = vec![float("axis", 1.0)], "attribute"),
        (
            "attribute of two values",
            TRANSFORMER,
            |m| m.node("Softmax").attributes = vec![int("axis", 1).float(2, 1.0)],
            "exactly one",
        ),
        (
            "attribute without a type",
            TRANSFORMER,
            |m| m.node("Softmax").attributes = vec![message().bytes(1, "axis").int(3, 1)],
            "exactly one",
        ),
        ("axis out of range", TRANSFORMER, |m| m.node("Softmax").attributes = vec![int("axis", i64::MIN)], "axis"),
        ("types mixed", TRANSFORMER, |m| m.node("MatMul").inputs[1] = "q".into(), "float16"),
        ("sizes that do not match", TRANSFORMER, |m| m.node("MatMul").inputs[1] = "out.w".into(), "MatMul multiplies"),
        ("cast to an integer", TRANSFORMER, |m| m.node("Cast").attributes = vec![int("to", I64)], "integer"),
        ("cast to a string", TRANSFORMER, |m| m.node("Cast").attributes = vec![int("to", 8)], "element type 8"),
        (
            "a reshape to more",
            TRANSFORMER,
            |m| *m.tensor("row.shape") = inside_ints("row.shape", &[1, 1, 1, 1 << 62]),
            "Reshape turns",
        ),
        (
            "a reshape with an overflow",
            TRANSFORMER,
            |m| *m.tensor("row.shape") = inside_ints("row.shape", &[1 << 62, 1 << 62, 4, 4]),
            "Reshape turns",
        ),
        (
            "a reshape with two open sides",
            TRANSFORMER,
            |m| *m.tensor("row.shape") = inside_ints("row.shape", &[1, 1, -1, -1]),
            "Reshape turns",
        ),
        (
            "a reshape that is computed",
            TRANSFORMER,
            |m| m.node("Reshape").inputs[1] = "sigma".into(),
            "inside the model",
        ),
        (
            "a permutation that repeats",
            TRANSFORMER,
            |m| m.node("Transpose").attributes = vec![ints("perm", &[0, 1, 1, 3])],
            "Transpose orders",
        ),
        ("a stride of 0", ENCODER, |m| m.node("Conv").attributes = vec![ints("strides", &[0, 16])], "strides"),
        ("a negative pad", ENCODER, |m| m.node("Conv").attributes.push(ints("pads", &[0, 0, -1, 0])), "pads"),
        ("a pad of 2^62", ENCODER, |m| m.node("Conv").attributes.push(ints("pads", &[0, 0, 1 << 62, 0])), "pads"),
        ("0 groups", ENCODER, |m| m.node("Conv").attributes.push(int("group", 0)), "groups"),
        (
            "a kernel that lies",
            ENCODER,
            |m| m.node("Conv").attributes = vec![ints("kernel_shape", &[3, 3]), ints("strides", &[16, 16])],
            "kernel_shape",
        ),
        (
            "a scale of 1000",
            DECODER,
            |m| *m.tensor("scales") = inside_floats("scales", &[4], &[1.0, 1.0, 1000.0, 1000.0]),
            "scale 1000",
        ),
        (
            "a scale of NaN",
            DECODER,
            |m| *m.tensor("scales") = inside_floats("scales", &[4], &[1.0, f32::NAN, 1.0, 1.0]),
            "scale NaN",
        ),
        (
            "a scale of 0",
            DECODER,
            |m| *m.tensor("scales") = inside_floats("scales", &[4], &[1.0, 0.0, 1.0, 1.0]),
            "scale 0",
        ),
        ("a region of interest", DECODER, |m| m.node("Resize").inputs[1] = "scales".into(), "region"),
        (
            "a value of another stated type",
            DECODER,
            |m| m.value_info.push(value("raw", F16, &[4, 3, 32, 33])),
            "states",
        ),
        ("a stated type of nothing", DECODER, |m| m.value_info.push(value("nothing", F16, &[1])), "before it is made"),
    ]);
}

/// 12 times the float32 nearest to 5/12 is less than 5, and rounds to 5 in float32.
fn resize_in_float32(m: &mut Model, size: i64) {
    m.nodes.push(node("Concat", &["rgb"; 3], &["twelve"], vec![int("axis", 0)]));
    m.tensors.push(inside_floats("five.twelfths", &[4], &[5.0 / 12.0, 1.0, 1.0, 1.0]));
    m.nodes.push(node("Resize", &["twelve", "", "five.twelfths"], &["five"], vec![]));
    let [height, width] = [32; 2];
    m.value_info.push(value("five", m.inputs[0].data_type, &[size, 3, height, width]));
}

#[test]
fn sizes_are_scaled_in_float32_as_the_runtime_does() {
    let mut toy = ToyBundle::new();
    resize_in_float32(toy.model(ENCODER), 5);
    Bundle::from_memory(toy.files()).expect("the runtime's size");
    check(&[("the size by a wider type", ENCODER, |m| resize_in_float32(m, 4), "states")]);
}

#[test]
fn size_bombs_are_refused() {
    check(&[
        (
            "doubled until it bursts",
            DECODER,
            |m| {
                let mut last = "latent".to_owned();
                for step in 0..40 {
                    let next = format!("bomb.{step}");
                    m.nodes.push(node("Resize", &[&last, "", "scales"], &[&next], vec![]));
                    last = next;
                }
            },
            "passes 256 MiB",
        ),
        // ONNX Runtime drops the axis for every number but 1, so that later sums are larger than a kept axis would make them.
        (
            "an axis that is kept by the number 2",
            ENCODER,
            |m| {
                m.tensors.push(inside_ints("axes", &[1]));
                m.nodes.push(node("ReduceMean", &["rgb", "axes"], &["mean"], vec![int("keepdims", 2)]));
            },
            "keepdims 2",
        ),
        (
            "joined with itself until it bursts",
            ENCODER,
            |m| {
                let mut last = "rgb".to_owned();
                for step in 0..80 {
                    let next = format!("bomb.{step}");
                    m.nodes.push(node("Concat", &[&last, &last], &[&next], vec![int("axis", 0)]));
                    last = next;
                }
            },
            "passes 256 MiB",
        ),
        (
            "an outer product",
            ENCODER,
            |m| {
                m.tensors.push(inside_ints("column", &[12_288, 1]));
                m.tensors.push(inside_ints("line", &[1, 12_288]));
                m.nodes.push(node("Reshape", &["rgb", "column"], &["tall"], vec![]));
                m.nodes.push(node("Reshape", &["rgb", "line"], &["wide"], vec![]));
                m.nodes.push(node("Mul", &["tall", "wide"], &["square"], vec![]));
            },
            "passes 256 MiB",
        ),
        (
            "an initializer of 2^60 elements",
            ENCODER,
            |m| m.tensor("conv").dims = vec![1 << 20, 1 << 20, 1 << 20],
            "passes 256 MiB",
        ),
        (
            "an initializer of 2^128 elements",
            ENCODER,
            |m| m.tensor("conv").dims = vec![1 << 62, 1 << 62, 1 << 4],
            "passes 256 MiB",
        ),
        ("an initializer of a negative size", ENCODER, |m| m.tensor("conv").dims[0] = -1, "dimensions"),
        ("an empty initializer", ENCODER, |m| m.tensor("conv").dims[0] = 0, "empty"),
        (
            "numbers inside the model",
            ENCODER,
            |m| m.tensors.push(inside_ints("many", &vec![0; 10_000])),
            "at most 65536",
        ),
    ]);
}

#[test]
fn external_data_stays_inside_the_bundle() {
    fn tensor(m: &mut Model) -> &mut Vec<(String, String)> {
        match &mut m.tensor("conv").data {
            Data::External(entries) => entries,
            Data::Inside(_) => unreachable!("the weight is external"),
        }
    }
    for location in [
        "../weights.bin",
        "./weights.bin",
        "/etc/passwd",
        "//host/share",
        "\\\\host\\share",
        "C:\\weights.bin",
        "C:weights.bin",
        "a/../weights.bin",
        "weights.bin/",
        "weights.bin/.",
        "weights.bin\0",
        "weights.bin ",
        "WEIGHTS.BIN",
        "absent.bin",
        "file:///etc/passwd",
        "*/_ORT_MEM_ADDR_/*",
        "",
        "NUL",
        "weights.bin:stream",
        "encoder.f32.onnx",
        "cairn-world.json",
        "%2e%2e/weights.bin",
        "..\u{2215}weights.bin",
        "～/weights.bin",
        &"a/".repeat(200),
    ] {
        let mut toy = ToyBundle::new();
        tensor(toy.model(ENCODER))[0].1 = location.to_owned();
        let error = refusal(location, Bundle::from_memory(toy.files()));
        assert_eq!(error.offending_field(), Some(ENCODER), "{location:?}: {error}");
    }
    check(&[
        ("offset beyond the end", ENCODER, |m| tensor(m)[1].1 = WEIGHT_BYTES.to_string(), "which has 7000"),
        ("end beyond the end", ENCODER, |m| tensor(m)[1].1 = (WEIGHT_BYTES - 6144 + 2).to_string(), "which has 7000"),
        ("offset that overflows", ENCODER, |m| tensor(m)[1].1 = u64::MAX.to_string(), "bytes 18446744073709551615"),
        ("odd offset", ENCODER, |m| tensor(m)[1].1 = "3".into(), "bytes 3"),
        ("offset of 2^70", ENCODER, |m| tensor(m)[1].1 = (1_u128 << 70).to_string(), "decimal"),
        ("negative offset", ENCODER, |m| tensor(m)[1].1 = "-2".into(), "decimal"),
        ("signed offset", ENCODER, |m| tensor(m)[1].1 = "+2".into(), "decimal"),
        ("offset in hex", ENCODER, |m| tensor(m)[1].1 = "0x2".into(), "decimal"),
        ("spaced offset", ENCODER, |m| tensor(m)[1].1 = " 2".into(), "decimal"),
        ("length too small", ENCODER, |m| tensor(m)[2].1 = "6142".into(), "6142 bytes of data"),
        ("length too large", ENCODER, |m| tensor(m)[2].1 = "6146".into(), "6146 bytes of data"),
        ("no length", ENCODER, |m| drop(tensor(m).pop()), "decimal"),
        ("no location", ENCODER, |m| drop(tensor(m).remove(0)), "location"),
        ("two locations", ENCODER, |m| tensor(m).push(("location".into(), WEIGHTS.into())), "twice"),
        ("a checksum entry", ENCODER, |m| tensor(m).push(("checksum".into(), "0".into())), "beside"),
        ("data inside and outside", ENCODER, |m| m.tensor("conv").more = message().bytes(9, [0; 2]), "neither"),
        ("external without entries", ENCODER, |m| tensor(m).clear(), "neither"),
        ("float32 outside", ENCODER, |m| m.tensor("conv").data_type = F32, "float16"),
        ("segment", ENCODER, |m| m.tensor("conv").more = message().bytes(3, ""), "unknown part"),
        ("floats outside raw data", ENCODER, |m| m.tensor("conv").more = message().bytes(4, [0; 4]), "raw_data"),
        ("a type that is none", ENCODER, |m| m.tensor("conv").data_type = 0, "element type 0"),
        ("too few bytes inside", ENCODER, |m| m.tensor("joined.shape").dims = vec![5], "32 bytes of data"),
    ]);
}

#[test]
fn the_documented_operators_are_the_accepted_ones() {
    let book = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/bundle.md")).unwrap();
    let list = book.split("Operators must be on this list:").nth(1).and_then(|rest| rest.split('.').next()).unwrap();
    let named: Vec<&str> = list.split('`').skip(1).step_by(2).collect();
    assert_eq!(named, operators().collect::<Vec<_>>());
}
