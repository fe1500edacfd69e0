//! The inputs and outputs of a bundle's graphs, from its geometry: `docs/bundle.md`, section 4.

use crate::bundle::{Geometry, LayerKind, Manifest, Precision};
use crate::runtime::TensorSpec;

/// Inputs and outputs of one graph, in order.
#[derive(Clone)]
pub(super) struct GraphSpec {
    pub(super) inputs: Vec<TensorSpec>,
    pub(super) outputs: Vec<TensorSpec>,
}

/// The shapes of the rollout's computations, as `usize`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shapes {
    /// `[C, h, w]`.
    pub(super) latent: [usize; 3],
    /// T, the tokens of one latent.
    pub(super) tokens: usize,
    pub(super) layers: usize,
    pub(super) kv_heads: usize,
    pub(super) head_width: usize,
    /// Slots of a local layer's ring.
    pub(super) local_slots: usize,
    /// Slots of a global layer's ring.
    pub(super) global_slots: usize,
    /// Control values of one step.
    pub(super) controls: usize,
    /// Pictures per latent.
    pub(super) pictures: usize,
    /// `[H, W]` of a decoded picture.
    pub(super) decoded: [usize; 2],
}

impl Shapes {
    /// The shapes of `manifest` at global window `g`, which [`Bundle`](crate::bundle::Bundle) has checked.
    pub(super) fn new(manifest: &Manifest, g: u32) -> Self {
        let geometry = &manifest.geometry;
        let [width, height] = manifest.picture.decoded;
        Self {
            latent: [geometry.latent.channels, geometry.latent.height, geometry.latent.width].map(|n| n as usize),
            tokens: geometry.tokens as usize,
            layers: geometry.layers as usize,
            kv_heads: geometry.kv_heads as usize,
            head_width: geometry.head_width as usize,
            local_slots: geometry.local.window as usize,
            global_slots: (g / geometry.global.dilation) as usize,
            controls: manifest.controls.len(),
            pictures: geometry.autoencoder.temporal as usize,
            decoded: [height as usize, width as usize],
        }
    }

    /// Values of one latent.
    pub(super) fn latent_len(&self) -> usize {
        self.latent.iter().product()
    }

    /// Slots of a layer's ring.
    pub(super) fn slot_count(&self, kind: LayerKind) -> usize {
        match kind {
            LayerKind::Local => self.local_slots,
            LayerKind::Global => self.global_slots,
        }
    }

    /// Keys a layer attends to: its ring and the current latent.
    pub(super) fn attended_keys(&self, kind: LayerKind) -> usize {
        self.keys_with(kind, 1)
    }

    /// Keys of a layer's ring and of so many latents.
    pub(super) fn keys_with(&self, kind: LayerKind, latents: usize) -> usize {
        (self.slot_count(kind) + latents) * self.tokens
    }

    /// Values of K, or of V, of one latent in one layer: `[kv_heads, T, head_width]`.
    pub(super) fn slab_len(&self) -> usize {
        self.kv_heads * self.tokens * self.head_width
    }

    /// Values of K, or of V, in a layer's ring: `[kv_heads, slots * T, head_width]`.
    pub(super) fn ring_len(&self, kind: LayerKind) -> usize {
        self.slot_count(kind) * self.slab_len()
    }

    /// Number of cosines, or of sines, of one latent: `[T, head_width / 2]`.
    pub(super) fn rope_len(&self) -> usize {
        self.tokens * self.head_width / 2
    }

    /// Values of one decoded picture: `[3, H, W]`.
    pub(super) fn picture_len(&self) -> usize {
        3 * self.decoded[0] * self.decoded[1]
    }
}

/// Latents that a joined graph runs.
pub(super) const JOINED_LATENTS: usize = 2;

/// The symbolic dimensions of the inputs of a transformer that runs `latents` latents, and their values.
pub(super) fn dimensions(s: &Shapes, latents: usize) -> [(&'static str, usize); 4] {
    [
        ("local_past", s.local_slots * s.tokens),
        ("local_keys", s.keys_with(LayerKind::Local, latents)),
        ("global_past", s.global_slots * s.tokens),
        ("global_keys", s.keys_with(LayerKind::Global, latents)),
    ]
}

pub(super) fn transformer(geometry: &Geometry, s: &Shapes, f: Precision) -> GraphSpec {
    passes(geometry, s, f, 1)
}

/// The joined graph: the transformer with a finished latent beside the one that it makes.
pub(super) fn joined(geometry: &Geometry, s: &Shapes, f: Precision) -> GraphSpec {
    let mut spec = passes(geometry, s, f, JOINED_LATENTS);
    let [c, h, w] = s.latent;
    spec.inputs.insert(1, TensorSpec::new("finished", f, &[1, c, h, w]));
    spec
}

fn passes(geometry: &Geometry, s: &Shapes, f: Precision, latents: usize) -> GraphSpec {
    let [c, h, w] = s.latent;
    let rope = [1, 1, latents * s.tokens, s.head_width / 2];
    let mut inputs = vec![
        TensorSpec::new("x", f, &[1, c, h, w]),
        TensorSpec::new("sigma", Precision::F32, &[latents]),
        TensorSpec::new("dsigma", Precision::F32, &[1]),
        TensorSpec::new("rope_cos", Precision::F32, &rope),
        TensorSpec::new("rope_sin", Precision::F32, &rope),
        TensorSpec::new("controls", Precision::F32, &[latents, s.controls]),
        TensorSpec::new("local_mask", f, &[1, latents, 1, s.keys_with(LayerKind::Local, latents)]),
        TensorSpec::new("global_mask", f, &[1, latents, 1, s.keys_with(LayerKind::Global, latents)]),
    ];
    let mut outputs = vec![TensorSpec::new("x_next", f, &[1, c, h, w])];
    for i in 0..geometry.layers {
        let past = [1, s.kv_heads, s.slot_count(geometry.layer_kind(i)) * s.tokens, s.head_width];
        let present = [1, s.kv_heads, s.tokens, s.head_width];
        for part in ["k", "v"] {
            inputs.push(TensorSpec::new(format!("past.{i}.{part}"), f, &past));
            outputs.push(TensorSpec::new(format!("present.{i}.{part}"), f, &present));
        }
    }
    GraphSpec { inputs, outputs }
}

pub(super) fn encoder(geometry: &Geometry, s: &Shapes, f: Precision) -> GraphSpec {
    with_memories(f, &geometry.autoencoder.encoder_memories, pictures(s, f), latent(s, f))
}

pub(super) fn decoder(geometry: &Geometry, s: &Shapes, f: Precision) -> GraphSpec {
    with_memories(f, &geometry.autoencoder.memories, latent(s, f), pictures(s, f))
}

fn latent(s: &Shapes, f: Precision) -> TensorSpec {
    let [c, h, w] = s.latent;
    TensorSpec::new("latent", f, &[1, c, h, w])
}

fn pictures(s: &Shapes, f: Precision) -> TensorSpec {
    let [height, width] = s.decoded;
    TensorSpec::new("rgb", f, &[s.pictures, 3, height, width])
}

/// A graph from `input` to `output` that takes memories of these shapes, `[channels, height, width]`, as inputs and returns the
/// next ones as outputs.
fn with_memories(f: Precision, shapes: &[[u32; 3]], input: TensorSpec, output: TensorSpec) -> GraphSpec {
    let (mut inputs, mut outputs) = (vec![input], vec![output]);
    for (j, memory) in shapes.iter().enumerate() {
        let shape = [1, memory[0] as usize, memory[1] as usize, memory[2] as usize];
        inputs.push(TensorSpec::new(format!("past_mem.{j}"), f, &shape));
        outputs.push(TensorSpec::new(format!("present_mem.{j}"), f, &shape));
    }
    GraphSpec { inputs, outputs }
}
