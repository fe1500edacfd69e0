//! The smallest bundle that conforms to `docs/bundle.md`: one token, two layers, a decoder with one convolution.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde_json::{Value as Json, json};
use sha2::{Digest, Sha256};

use super::onnx_writer::*;

/// Name of the file of weights.
pub const WEIGHTS: &str = "weights.bin";
/// Size of the file of weights, in bytes.
pub const WEIGHT_BYTES: usize = 7000;

/// A bundle whose parts can be changed before its files are written.
#[derive(Clone)]
pub struct ToyBundle {
    /// Without `files`, which [`ToyBundle::full_manifest`] adds.
    pub manifest: Json,
    /// Models by file name.
    pub models: BTreeMap<String, Model>,
    /// Contents of the other files by name: weights and licence.
    pub data: BTreeMap<String, Vec<u8>>,
}

/// Names and contents of files.
pub type Files = Vec<(String, Cow<'static, [u8]>)>;

impl ToyBundle {
    /// A valid bundle in both precisions.
    pub fn new() -> Self {
        let mut models = BTreeMap::new();
        for (precision, f) in [("f32", F32), ("f16", F16)] {
            models.insert(format!("transformer.{precision}.onnx"), transformer(f));
            models.insert(format!("encoder.{precision}.onnx"), encoder(f));
            models.insert(format!("decoder.{precision}.onnx"), decoder(f));
        }
        let weights = (0..WEIGHT_BYTES).map(|i| (i * 31 % 56) as u8).collect();
        let data = [(WEIGHTS.to_owned(), weights), ("LICENSE.txt".to_owned(), b"Do as you like.".to_vec())];
        Self { manifest: manifest(), models, data: data.into() }
    }

    /// A valid bundle with joined graphs.
    pub fn with_joined() -> Self {
        let mut toy = Self::new();
        for (precision, f) in [("f32", F32), ("f16", F16)] {
            let name = format!("joined.{precision}.onnx");
            toy.manifest["graphs"][precision]["joined"] = name.as_str().into();
            toy.models.insert(name, joined(f));
        }
        toy
    }

    /// The model with this file name.
    pub fn model(&mut self, name: &str) -> &mut Model {
        self.models.get_mut(name).expect("the toy bundle has this model")
    }

    /// All files except the manifest, by name.
    pub fn contents(&self) -> BTreeMap<String, Vec<u8>> {
        let models = self.models.iter().map(|(name, model)| (name.clone(), model.encode()));
        models.chain(self.data.clone()).collect()
    }

    /// The manifest with the list of all files, their sizes and checksums.
    pub fn full_manifest(&self) -> Json {
        let entry =
            |(path, bytes): (String, Vec<u8>)| json!({ "path": path, "size": bytes.len(), "sha256": sha256(&bytes) });
        let mut manifest = self.manifest.clone();
        manifest["files"] = self.contents().into_iter().map(entry).collect();
        manifest
    }

    /// All files, with the manifest that `edit` has changed.
    pub fn files_with(&self, edit: impl FnOnce(&mut Json)) -> Files {
        let mut manifest = self.full_manifest();
        edit(&mut manifest);
        let manifest = serde_json::to_vec(&manifest).expect("a JSON value can be written");
        let all = self.contents().into_iter().chain([(cairn::bundle::MANIFEST_NAME.to_owned(), manifest)]);
        all.map(|(name, bytes)| (name, Cow::Owned(bytes))).collect()
    }

    /// All files.
    pub fn files(&self) -> Files {
        self.files_with(|_| ())
    }
}

impl Default for ToyBundle {
    fn default() -> Self {
        Self::new()
    }
}

/// The SHA-256 checksum in hexadecimal digits.
fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}

fn manifest() -> Json {
    let graphs = |p: &str| {
        json!({
            "transformer": format!("transformer.{p}.onnx"),
            "encoder": format!("encoder.{p}.onnx"),
            "decoder": format!("decoder.{p}.onnx"),
        })
    };
    json!({
        "schema_version": 1,
        "name": "Toy",
        "model_type": "waypoint-1.5",
        "geometry": {
            "layers": 2, "width": 8, "heads": 1, "kv_heads": 1, "head_width": 8, "mlp_ratio": 1,
            "latent": { "channels": 1, "height": 2, "width": 2 },
            "patch": [2, 2],
            "tokens": 1,
            "local": { "window": 2 },
            "global": { "window": 4, "dilation": 2, "max_window": 8, "period": 2, "offset": -1 },
            "control_period": 3,
            "rope": { "nyquist_fraction": 0.8, "time_base": 10000.0, "rounding": "none" },
            "autoencoder": { "temporal": 4, "spatial": 16, "memories": vec![[1, 1, 1]; 9] },
        },
        "sampler": { "schedule": [1.0, 0.5, 0.0], "sigma_rounding": "none" },
        "rates": { "latents_per_second": 15, "time_multiplier": 1 },
        "controls": { "mouse": 2, "buttons": 256, "scroll": 1 },
        "picture": { "decoded": [32, 32], "render": [40, 32], "range": [0, 1] },
        "graphs": { "f32": graphs("f32"), "f16": graphs("f16") },
        "licence": { "spdx": "CC0-1.0", "file": "LICENSE.txt" },
        "provenance": { "tool": "tests" },
    })
}

fn model(inputs: Vec<Value>, outputs: Vec<Value>) -> Model {
    Model {
        ir_version: 8,
        opsets: vec![(String::new(), 18)],
        nodes: Vec::new(),
        tensors: Vec::new(),
        inputs,
        outputs,
        value_info: Vec::new(),
        more_graph: Message::default(),
        more: Message::default(),
    }
}

impl Model {
    fn add(&mut self, operator: &str, inputs: &[&str], output: &str, attributes: Vec<Message>) {
        self.nodes.push(node(operator, inputs, &[output], attributes));
    }

    /// A stored weight in the graph's type, under `name` + `.w`.
    fn weight(&mut self, name: &str, f: i64, dims: &[i64], offset: u64) {
        self.tensors.push(external(name, dims, WEIGHTS, offset));
        self.add("Cast", &[name], &format!("{name}.w"), vec![int("to", f)]);
    }
}

/// A value whose dimensions are numbers or names.
fn symbolic(name: &str, f: i64, dims: [&str; 4]) -> Value {
    Value {
        name: name.to_owned(),
        data_type: f,
        dims: dims.iter().map(|d| d.parse().map_or_else(|_| Dim::Symbol((*d).to_owned()), Dim::Number)).collect(),
    }
}

/// A model with these inputs and those and the outputs of two layers, of which the second is global: (1 - -1) mod 2 is 0.
fn with_layers(f: i64, mut inputs: Vec<Value>) -> Model {
    let mut outputs = vec![value("x_next", f, &[1, 1, 2, 2])];
    for (i, past) in [(0, "local_past"), (1, "global_past")] {
        for half in ["k", "v"] {
            inputs.push(symbolic(&format!("past.{i}.{half}"), f, ["1", "1", past, "8"]));
            outputs.push(value(&format!("present.{i}.{half}"), f, &[1, 1, 1, 8]));
        }
    }
    model(inputs, outputs)
}

/// Two tokens, of the finished latent and of the next one.
fn joined(f: i64) -> Model {
    let inputs = vec![
        value("x", f, &[1, 1, 2, 2]),
        value("finished", f, &[1, 1, 2, 2]),
        value("sigma", F32, &[2]),
        value("dsigma", F32, &[1]),
        value("rope_cos", F32, &[1, 1, 2, 4]),
        value("rope_sin", F32, &[1, 1, 2, 4]),
        value("controls", F32, &[2, 259]),
        symbolic("local_mask", f, ["1", "2", "1", "local_keys"]),
        symbolic("global_mask", f, ["1", "2", "1", "global_keys"]),
    ];
    let mut m = with_layers(f, inputs);
    for (name, numbers) in [
        ("rows.shape", &[1, 1, 2, -1][..]),
        ("latents.shape", &[1, 2, 1, -1]),
        ("latent.shape", &[1, 1, 2, 2]),
        ("at.0", &[0]),
        ("at.1", &[1]),
        ("at.2", &[2]),
    ] {
        m.tensors.push(inside_ints(name, numbers));
    }
    for (i, name) in ["q", "k", "v"].into_iter().enumerate() {
        m.weight(name, f, &[4, 8], 64 * i as u64);
    }
    m.weight("out", f, &[8, 4], 192);
    m.add("Concat", &["finished", "x"], "latents", vec![int("axis", 0)]);
    m.add("Reshape", &["latents", "rows.shape"], "row.0", vec![]);
    for (i, mask) in [(0, "local_mask"), (1, "global_mask")] {
        let n = |name: &str| format!("{name}.{i}");
        for half in ["q", "k", "v"] {
            m.add("MatMul", &[&n("row"), &format!("{half}.w")], &n(half), vec![]);
        }
        for (half, all) in [("k", "keys"), ("v", "values")] {
            m.add("Slice", &[&n(half), "at.0", "at.1", "at.2"], &format!("present.{i}.{half}"), vec![]);
            m.add("Concat", &[&format!("past.{i}.{half}"), &n(half)], &n(all), vec![int("axis", 2)]);
        }
        m.add("Transpose", &[&n("keys")], &n("turned"), vec![ints("perm", &[0, 1, 3, 2])]);
        m.add("MatMul", &[&n("q"), &n("turned")], &n("scores"), vec![]);
        m.add("Reshape", &[&n("scores"), "latents.shape"], &n("each"), vec![]);
        m.add("Add", &[&n("each"), mask], &n("masked"), vec![]);
        m.add("Reshape", &[&n("masked"), "rows.shape"], &n("rows"), vec![]);
        m.add("Softmax", &[&n("rows")], &n("shares"), vec![int("axis", -1)]);
        m.add("MatMul", &[&n("shares"), &n("values")], &n("mix"), vec![]);
        m.add("MatMul", &[&n("mix"), "out.w"], &n("out"), vec![]);
        m.add("Add", &[&n("row"), &n("out")], &format!("row.{}", i + 1), vec![]);
    }
    m.add("Slice", &["row.2", "at.1", "at.2", "at.2"], "next", vec![]);
    m.add("Reshape", &["next", "latent.shape"], "x_next", vec![]);
    m
}

fn transformer(f: i64) -> Model {
    let inputs = vec![
        value("x", f, &[1, 1, 2, 2]),
        value("sigma", F32, &[1]),
        value("dsigma", F32, &[1]),
        value("rope_cos", F32, &[1, 1, 1, 4]),
        value("rope_sin", F32, &[1, 1, 1, 4]),
        value("controls", F32, &[1, 259]),
        symbolic("local_mask", f, ["1", "1", "1", "local_keys"]),
        symbolic("global_mask", f, ["1", "1", "1", "global_keys"]),
    ];
    let mut m = with_layers(f, inputs);
    m.tensors.push(inside_ints("row.shape", &[1, 1, 1, -1]));
    m.tensors.push(inside_ints("latent.shape", &[1, 1, 2, 2]));
    for (i, name) in ["q", "k", "v"].into_iter().enumerate() {
        m.weight(name, f, &[4, 8], 64 * i as u64);
    }
    m.weight("out", f, &[8, 4], 192);
    m.add("Reshape", &["x", "row.shape"], "row.0", vec![]);
    for (i, mask) in [(0, "local_mask"), (1, "global_mask")] {
        let n = |name: &str| format!("{name}.{i}");
        let (k, v) = (format!("present.{i}.k"), format!("present.{i}.v"));
        m.add("MatMul", &[&n("row"), "q.w"], &n("q"), vec![]);
        m.add("MatMul", &[&n("row"), "k.w"], &k, vec![]);
        m.add("MatMul", &[&n("row"), "v.w"], &v, vec![]);
        m.add("Concat", &[&format!("past.{i}.k"), &k], &n("keys"), vec![int("axis", 2)]);
        m.add("Concat", &[&format!("past.{i}.v"), &v], &n("values"), vec![int("axis", 2)]);
        m.add("Transpose", &[&n("keys")], &n("turned"), vec![ints("perm", &[0, 1, 3, 2])]);
        m.add("MatMul", &[&n("q"), &n("turned")], &n("scores"), vec![]);
        m.add("Add", &[&n("scores"), mask], &n("masked"), vec![]);
        m.add("Softmax", &[&n("masked")], &n("shares"), vec![int("axis", -1)]);
        m.add("MatMul", &[&n("shares"), &n("values")], &n("mix"), vec![]);
        m.add("MatMul", &[&n("mix"), "out.w"], &n("out"), vec![]);
        m.add("Add", &[&n("row"), &n("out")], &format!("row.{}", i + 1), vec![]);
    }
    m.add("Reshape", &["row.2", "latent.shape"], "x_next", vec![]);
    m
}

fn encoder(f: i64) -> Model {
    let mut m = model(vec![value("rgb", f, &[4, 3, 32, 32])], vec![value("latent", f, &[1, 1, 2, 2])]);
    m.tensors.push(inside_ints("joined.shape", &[1, 12, 32, 32]));
    m.weight("conv", f, &[1, 12, 16, 16], 256);
    m.add("Reshape", &["rgb", "joined.shape"], "joined", vec![]);
    m.add("Conv", &["joined", "conv.w"], "latent", vec![ints("kernel_shape", &[16, 16]), ints("strides", &[16, 16])]);
    m
}

fn decoder(f: i64) -> Model {
    let mut inputs = vec![value("latent", f, &[1, 1, 2, 2])];
    let mut outputs = vec![value("rgb", f, &[4, 3, 32, 32])];
    for j in 0..9 {
        inputs.push(value(&format!("past_mem.{j}"), f, &[1, 1, 1, 1]));
        outputs.push(value(&format!("present_mem.{j}"), f, &[1, 1, 1, 1]));
    }
    let mut m = model(inputs, outputs);
    m.tensors.push(inside_floats("scales", &[4], &[1.0, 1.0, 2.0, 2.0]));
    m.tensors.push(inside_ints("pictures.shape", &[4, 3, 32, 32]));
    m.weight("grow", f, &[12, 1, 1, 1], 6500);
    let mut last = "latent".to_owned();
    for step in 0..4 {
        let next = format!("up.{step}");
        m.add("Resize", &[&last, "", "scales"], &next, vec![text("mode", "nearest")]);
        last = next;
    }
    m.add("Conv", &[&last, "grow.w"], "grown", vec![]);
    m.add("Reshape", &["grown", "pictures.shape"], "raw", vec![]);
    m.add("Clip", &["raw"], "rgb", vec![]);
    for j in 0..9 {
        m.add("Tanh", &[&format!("past_mem.{j}")], &format!("present_mem.{j}"), vec![]);
    }
    m
}
