//! Inputs and outputs that each graph must have: the tables of `docs/bundle.md` section 4 for a manifest's geometry.

use super::proto::{Dim, ValueInfo};
use super::{CheckResult, DataType, Fault, Shape, quoted};
use crate::bundle::{GraphKind, LayerKind, Manifest, Precision};

/// Pictures per run of the autoencoder.
const PICTURES: u32 = 4;

/// An input or output that the format prescribes.
#[derive(Debug, Clone)]
pub(super) struct Port {
    pub(super) name: String,
    element: DataType,
    dims: Vec<PortDim>,
}

/// One dimension: a fixed number, or one of the transformer's four symbols.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PortDim {
    Fixed(u32),
    Past {
        kind: LayerKind,
    },
    /// Keys of the past and of the latents that a run is of.
    Keys {
        kind: LayerKind,
        latents: u32,
    },
}

impl PortDim {
    fn symbol(self) -> Option<&'static str> {
        match self {
            Self::Fixed(_) => None,
            Self::Past { kind: LayerKind::Local } => Some("local_past"),
            Self::Past { kind: LayerKind::Global } => Some("global_past"),
            Self::Keys { kind: LayerKind::Local, .. } => Some("local_keys"),
            Self::Keys { kind: LayerKind::Global, .. } => Some("global_keys"),
        }
    }
}

/// Inputs and outputs of one graph.
pub(super) struct Interface {
    pub(super) inputs: Vec<Port>,
    pub(super) outputs: Vec<Port>,
}

impl Interface {
    pub(super) fn of(kind: GraphKind, precision: Precision, manifest: &Manifest) -> Self {
        let f = DataType::from(precision);
        match kind {
            GraphKind::Transformer | GraphKind::Joined => transformer(f, kind, manifest),
            GraphKind::Encoder => encoder(f, manifest),
            GraphKind::Decoder => decoder(f, manifest),
        }
    }

    /// Compares the model's inputs and outputs with the format's: names, order, types, ranks, dimensions.
    pub(super) fn check(&self, inputs: &[ValueInfo<'_>], outputs: &[ValueInfo<'_>]) -> CheckResult<()> {
        compare("input", &self.inputs, inputs)?;
        compare("output", &self.outputs, outputs)
    }
}

impl Port {
    fn new(name: impl Into<String>, element: DataType, dims: Vec<PortDim>) -> Self {
        Self { name: name.into(), element, dims }
    }

    fn fixed(name: impl Into<String>, element: DataType, dims: &[u32]) -> Self {
        Self::new(name, element, dims.iter().map(|&n| PortDim::Fixed(n)).collect())
    }

    /// The shape at a global window of `g` latents.
    pub(super) fn shape(&self, manifest: &Manifest, g: u32) -> Shape {
        let geometry = &manifest.geometry;
        let length = |dim: &PortDim| match *dim {
            PortDim::Fixed(n) => u64::from(n),
            PortDim::Past { kind } => geometry.slot_count(kind, g) * u64::from(geometry.tokens),
            PortDim::Keys { kind, latents } => {
                (geometry.slot_count(kind, g) + u64::from(latents)) * u64::from(geometry.tokens)
            }
        };
        Shape { element: self.element, dims: self.dims.iter().map(length).collect() }
    }
}

fn latent(name: &str, f: DataType, m: &Manifest) -> Port {
    let shape = m.geometry.latent;
    Port::fixed(name, f, &[1, shape.channels, shape.height, shape.width])
}

fn rgb(f: DataType, m: &Manifest) -> Port {
    let [width, height] = m.picture.decoded;
    Port::fixed("rgb", f, &[PICTURES, 3, height, width])
}

fn transformer(f: DataType, kind: GraphKind, m: &Manifest) -> Interface {
    let g = &m.geometry;
    let latents = kind.latents();
    let angles = [1, 1, latents * g.tokens, g.head_width / 2];
    let mask = |name, kind| {
        let keys = PortDim::Keys { kind, latents };
        Port::new(name, f, vec![PortDim::Fixed(1), PortDim::Fixed(latents), PortDim::Fixed(1), keys])
    };
    let controls = m.controls.mouse + m.controls.buttons + m.controls.scroll;
    let mut inputs = vec![latent("x", f, m)];
    if kind == GraphKind::Joined {
        inputs.push(latent("finished", f, m));
    }
    inputs.extend([
        Port::fixed("sigma", DataType::F32, &[latents]),
        Port::fixed("dsigma", DataType::F32, &[1]),
        Port::fixed("rope_cos", DataType::F32, &angles),
        Port::fixed("rope_sin", DataType::F32, &angles),
        Port::fixed("controls", DataType::F32, &[latents, controls]),
        mask("local_mask", LayerKind::Local),
        mask("global_mask", LayerKind::Global),
    ]);
    let mut outputs = vec![latent("x_next", f, m)];
    for i in 0..g.layers {
        let past = PortDim::Past { kind: g.layer_kind(i) };
        for part in ["k", "v"] {
            let dims = vec![PortDim::Fixed(1), PortDim::Fixed(g.kv_heads), past, PortDim::Fixed(g.head_width)];
            inputs.push(Port::new(format!("past.{i}.{part}"), f, dims));
            outputs.push(Port::fixed(format!("present.{i}.{part}"), f, &[1, g.kv_heads, g.tokens, g.head_width]));
        }
    }
    Interface { inputs, outputs }
}

fn encoder(f: DataType, m: &Manifest) -> Interface {
    with_memories(f, &m.geometry.autoencoder.encoder_memories, rgb(f, m), latent("latent", f, m))
}

fn decoder(f: DataType, m: &Manifest) -> Interface {
    with_memories(f, &m.geometry.autoencoder.memories, latent("latent", f, m), rgb(f, m))
}

/// Interface of a graph from `input` to `output` that also takes and returns memories of `shapes`, each `[channels, height, width]`.
fn with_memories(f: DataType, shapes: &[[u32; 3]], input: Port, output: Port) -> Interface {
    let ports = |first, prefix: &str| {
        let memory = |(j, &[c, h, w]): (usize, &[u32; 3])| Port::fixed(format!("{prefix}.{j}"), f, &[1, c, h, w]);
        std::iter::once(first).chain(shapes.iter().enumerate().map(memory)).collect()
    };
    Interface { inputs: ports(input, "past_mem"), outputs: ports(output, "present_mem") }
}

fn compare(role: &str, expected: &[Port], found: &[ValueInfo<'_>]) -> CheckResult<()> {
    for (i, (port, value)) in expected.iter().zip(found).enumerate() {
        let fault = |what: &str| Fault::new(format!("{role} {i} must be `{}` {}; {what}", port.name, describe(port)));
        if value.name != port.name {
            return Err(fault(&format!("it is {}", quoted(value.name))));
        }
        if value.data_type != port.element as i64 {
            return Err(fault(&format!("its element type is {}", value.data_type)));
        }
        if value.dims.len() != port.dims.len() {
            return Err(fault(&format!("its rank is {}", value.dims.len())));
        }
        for (axis, (expected, dim)) in port.dims.iter().zip(&value.dims).enumerate() {
            let fits = match (expected, dim) {
                (PortDim::Fixed(n), Dim::Number(found)) => i64::from(*n) == *found,
                (expected, Dim::Symbol(found)) => expected.symbol() == Some(*found),
                _ => false,
            };
            if !fits {
                return Err(fault(&format!("its dimension {axis} is {}", describe_dim(dim))));
            }
        }
    }
    if expected.len() == found.len() {
        return Ok(());
    }
    Err(Fault::new(format!("there are {} {role}s, there must be {}", found.len(), expected.len())))
}

fn describe(port: &Port) -> String {
    let dims: Vec<String> = port
        .dims
        .iter()
        .map(|dim| match dim {
            PortDim::Fixed(n) => n.to_string(),
            other => other.symbol().unwrap_or_default().to_owned(),
        })
        .collect();
    format!("{} [{}]", port.element, dims.join(", "))
}

fn describe_dim(dim: &Dim<'_>) -> String {
    match dim {
        Dim::Number(n) => n.to_string(),
        Dim::Symbol(name) => quoted(name),
        Dim::Unknown => "open".to_owned(),
    }
}
