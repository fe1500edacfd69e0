//! The manifest `cairn-world.json`: types that mirror `docs/bundle.md`, sections 2 and 3.

use serde::{Deserialize, Serialize};

/// The schema version this library reads and the builder writes.
pub const SCHEMA_VERSION: u32 = 1;

/// A whole manifest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Name for people to read.
    pub name: String,
    /// `waypoint-1.5`.
    pub model_type: String,
    /// Shapes of the model.
    pub geometry: Geometry,
    /// Noise levels.
    pub sampler: Sampler,
    /// Clocks.
    pub rates: Rates,
    /// Counts of control numbers.
    pub controls: ControlCounts,
    /// Picture sizes.
    pub picture: PictureFormat,
    /// File names of the models.
    pub graphs: Graphs,
    /// Type of the residual stream of the f16 transformer; `None` for float16.
    #[serde(default, deserialize_with = "non_null", skip_serializing_if = "Option::is_none")]
    pub residual: Option<Residual>,
    /// How the matrices of the transformer's layers are stored in fewer than 16 bits; `None` where all weights have 16.
    #[serde(default, deserialize_with = "non_null", skip_serializing_if = "Option::is_none")]
    pub quantisation: Option<Quantisation>,
    /// Every file of the bundle but the manifest.
    pub files: Vec<FileEntry>,
    /// Terms of use.
    pub licence: Licence,
    /// Who made it, from what.
    pub provenance: std::collections::BTreeMap<String, String>,
}

/// Shapes of the model; `docs/bundle.md` section 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// Transformer blocks.
    pub layers: u32,
    /// Model width D.
    pub width: u32,
    /// Query heads.
    pub heads: u32,
    /// Key/value heads.
    pub kv_heads: u32,
    /// Width of one head.
    pub head_width: u32,
    /// Hidden width of the MLP over D.
    pub mlp_ratio: u32,
    /// Shape of one latent.
    pub latent: LatentShape,
    /// Latent cells per token: rows, columns.
    pub patch: [u32; 2],
    /// Tokens per latent.
    pub tokens: u32,
    /// Local attention.
    pub local: LocalWindow,
    /// Global attention.
    pub global: GlobalWindow,
    /// Layer i sees the controls when `i % control_period == 0`.
    pub control_period: u32,
    /// Rotary position embedding.
    pub rope: Rope,
    /// The autoencoder.
    pub autoencoder: AutoencoderShapes,
}

/// Channels, rows and columns of one latent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatentShape {
    /// C.
    pub channels: u32,
    /// h.
    pub height: u32,
    /// w.
    pub width: u32,
}

/// Context of local layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocalWindow {
    /// Number of latents, which is also the number of slots.
    pub window: u32,
}

/// Context of global layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GlobalWindow {
    /// The stock window g, in latents.
    pub window: u32,
    /// Every `dilation`-th latent is kept.
    pub dilation: u32,
    /// The largest g that the bundle allows.
    pub max_window: u32,
    /// Layer i is global when `(i - offset) mod period == 0`.
    pub period: u32,
    /// See `period`.
    pub offset: i32,
}

/// Constants of `docs/bundle.md` section 5.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rope {
    /// Highest spatial frequency over the shorter side's Nyquist limit.
    pub nyquist_fraction: f64,
    /// Base of the geometric series of time frequencies.
    pub time_base: f64,
    /// Rounding of the frequencies.
    pub rounding: Rounding,
}

/// Shapes of the autoencoder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AutoencoderShapes {
    /// Pictures per latent.
    pub temporal: u32,
    /// Decoded pixels per latent cell, each way.
    pub spatial: u32,
    /// `[channels, height, width]` of each decoder memory.
    pub memories: Vec<[u32; 3]>,
    /// `[channels, height, width]` of each encoder memory. Empty if the encoder's graph has no memory inputs; each clip then starts at zero.
    #[serde(default, deserialize_with = "non_empty", skip_serializing_if = "Vec::is_empty")]
    pub encoder_memories: Vec<[u32; 3]>,
}

/// Noise levels the model was trained for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sampler {
    /// The stock schedule, descending to 0.
    pub schedule: Vec<f64>,
    /// Rounding of the finished list and its differences.
    pub sigma_rounding: Rounding,
}

/// How numbers that the host computes for the graphs are rounded before use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rounding {
    /// None: the numbers are used as f32.
    None,
    /// To bfloat16, as the released engine runs.
    Bf16,
}

/// Rates of the clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rates {
    /// Latents per second of world time.
    pub latents_per_second: u32,
    /// RoPE time of latent q is q times this.
    pub time_multiplier: u32,
}

/// How many control numbers of each kind, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlCounts {
    /// dx and dy.
    pub mouse: u32,
    /// One for each Windows virtual key.
    pub buttons: u32,
    /// Sign of the wheel.
    pub scroll: u32,
}

/// Sizes in pixels, `[width, height]`, and value range of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureFormat {
    /// Size of the autoencoder's pictures.
    pub decoded: [u32; 2],
    /// The same picture in square pixels.
    pub render: [u32; 2],
    /// Value range of `rgb`: `[0, 1]`.
    pub range: [f64; 2],
}

/// Models by precision.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Graphs {
    /// Computes in float32: for the CPU provider.
    pub f32: GraphFiles,
    /// Computes in float16: for DirectML.
    #[serde(default, deserialize_with = "non_null", skip_serializing_if = "Option::is_none")]
    pub f16: Option<GraphFiles>,
}

/// A list that may be missing, but not empty.
fn non_empty<'de, T: Deserialize<'de>, D: serde::Deserializer<'de>>(value: D) -> Result<Vec<T>, D::Error> {
    let list = Vec::deserialize(value)?;
    if list.is_empty() { Err(serde::de::Error::custom("an empty list: leave it out")) } else { Ok(list) }
}

/// A member that may be missing, but not null.
fn non_null<'de, T: Deserialize<'de>, D: serde::Deserializer<'de>>(value: D) -> Result<Option<T>, D::Error> {
    T::deserialize(value).map(Some)
}

/// A type of the residual stream that differs from the other values of an f16 transformer: `docs/bundle.md` section 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Residual {
    /// float32: where the sums of the layers would pass float16's largest number, or are not accurate enough.
    Float32,
}

/// Storage of matrices in fewer than 16 bits: `docs/bundle.md` section 4.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quantisation {
    /// Bits of a stored number: 8 or 4.
    pub bits: u32,
    /// Rows of a column that share a scale: 16, 32, 64, 128 or 256.
    pub block: u32,
    /// Bits of the activations that the CPU provider multiplies such matrices by in f32 graphs: 8, or 16 for the graph's own precision.
    pub activation_bits: u32,
    /// Layers and matrices that stay in 16 bits, by the start of their names.
    pub kept_in_16_bits: Vec<String>,
}

/// File names of the models in one precision.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraphFiles {
    /// The world model.
    pub transformer: String,
    /// Pictures to latent.
    pub encoder: String,
    /// Latent to pictures.
    pub decoder: String,
    /// The transformer with two latents at once, if the bundle has it: in both precisions or in none.
    #[serde(default, deserialize_with = "non_null", skip_serializing_if = "Option::is_none")]
    pub joined: Option<String>,
}

/// One file of the bundle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileEntry {
    /// Relative, with `/`.
    pub path: String,
    /// Bytes.
    pub size: u64,
    /// 64 lower-case hex digits.
    pub sha256: String,
}

/// Terms of use.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Licence {
    /// SPDX expression.
    pub spdx: String,
    /// The file with the text.
    #[serde(deserialize_with = "Option::deserialize")] // so that it may be null, but not missing
    pub file: Option<String>,
}

impl Manifest {
    /// Parses a manifest and makes all checks that need no other file.
    ///
    /// # Errors
    /// `InvalidBundle` with the offending member, or `Unsupported` for a newer or older schema or another kind of model.
    pub fn parse(bytes: &[u8]) -> crate::Result<Self> {
        super::manifest_check::read_manifest(bytes)
    }

    /// The entry of the file `path`, if it is listed.
    pub fn file(&self, path: &str) -> Option<&FileEntry> {
        self.files.iter().find(|entry| entry.path == path)
    }
}

impl Graphs {
    /// The models of one precision, if the bundle has them.
    pub fn of(&self, precision: Precision) -> Option<&GraphFiles> {
        match precision {
            Precision::F32 => Some(&self.f32),
            Precision::F16 => self.f16.as_ref(),
        }
    }

    /// Every model: precision, kind, file name.
    pub fn paths(&self) -> impl Iterator<Item = (Precision, GraphKind, &str)> {
        Precision::ALL
            .into_iter()
            .filter_map(|p| self.of(p).map(|files| (p, files)))
            .flat_map(|(p, files)| GraphKind::ALL.into_iter().filter_map(move |kind| Some((p, kind, files.of(kind)?))))
    }
}

impl GraphFiles {
    /// The file name of one model; `None` if there is none of that kind.
    pub fn of(&self, kind: GraphKind) -> Option<&str> {
        match kind {
            GraphKind::Transformer => Some(&self.transformer),
            GraphKind::Encoder => Some(&self.encoder),
            GraphKind::Decoder => Some(&self.decoder),
            GraphKind::Joined => self.joined.as_deref(),
        }
    }
}

/// The number type a graph computes in: type F of `docs/bundle.md` section 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Precision {
    /// float32.
    F32,
    /// float16.
    F16,
}

impl Precision {
    /// Both, in the order of the manifest.
    pub const ALL: [Self; 2] = [Self::F32, Self::F16];

    /// Bytes of one number.
    pub fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
        }
    }
}

impl std::fmt::Display for Precision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
        })
    }
}

/// One of the graphs of a bundle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum GraphKind {
    /// One pass of the world model.
    Transformer,
    /// Pictures to latent.
    Encoder,
    /// Latent to pictures.
    Decoder,
    /// The cache pass of one latent and the first denoise pass of the next at once. Not every bundle has it.
    Joined,
}

impl GraphKind {
    /// All, in the order of the manifest.
    pub const ALL: [Self; 4] = [Self::Transformer, Self::Encoder, Self::Decoder, Self::Joined];

    /// Those that every bundle has, in the order of the manifest.
    pub const REQUIRED: [Self; 3] = [Self::Transformer, Self::Encoder, Self::Decoder];

    /// Latents of one run.
    pub(crate) fn latents(self) -> u32 {
        if self == Self::Joined { 2 } else { 1 }
    }
}

impl std::fmt::Display for GraphKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Transformer => "transformer",
            Self::Encoder => "encoder",
            Self::Decoder => "decoder",
            Self::Joined => "joined",
        })
    }
}

/// Which earlier latents a layer of the transformer attends to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayerKind {
    /// The most recent ones, those of the local window.
    Local,
    /// Those of the global window.
    Global,
}

impl LayerKind {
    /// All kinds.
    pub const ALL: [Self; 2] = [Self::Local, Self::Global];
}

impl Geometry {
    /// What layer `layer` attends to.
    pub fn layer_kind(&self, layer: u32) -> LayerKind {
        let distance = i64::from(layer) - i64::from(self.global.offset);
        if distance.rem_euclid(i64::from(self.global.period)) == 0 { LayerKind::Global } else { LayerKind::Local }
    }

    /// Whether layer `layer` attends globally.
    pub fn is_global(&self, layer: u32) -> bool {
        self.layer_kind(layer) == LayerKind::Global
    }

    /// Number of slots, one latent each, in the ring of a layer at a global window of `g` latents.
    pub fn slot_count(&self, kind: LayerKind, g: u32) -> u64 {
        u64::from(match kind {
            LayerKind::Local => self.local.window,
            LayerKind::Global => g / self.global.dilation,
        })
    }

    /// Numbers in one latent.
    pub fn latent_len(&self) -> usize {
        self.latent.channels as usize * self.latent.height as usize * self.latent.width as usize
    }

    /// Rows and columns of the token grid.
    pub fn token_grid(&self) -> (u32, u32) {
        (self.latent.height / self.patch[0], self.latent.width / self.patch[1])
    }
}

impl ControlCounts {
    /// All control numbers of one latent step.
    pub fn len(&self) -> usize {
        (self.mouse + self.buttons + self.scroll) as usize
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
