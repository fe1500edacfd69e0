//! A world: a bundle loaded on one device, shared by its rollouts.

use std::sync::Arc;
use std::time::Duration;

use super::graph_spec::{self, GraphSpec, Shapes};
use super::half_precision::{HalfPrecision, Reference};
use super::loading::{MemoryFit, SessionProgress, Transformers, load_transformers};
use super::missing_operator;
use super::operating_point::{CacheMode, OperatingPoint};
use super::schedule::SigmaTable;
use super::transformer::{Transformer, TransformerSource};
use crate::bundle::{Bundle, GraphKind, LayerKind, Manifest, MemoryNeed, Precision, available_memory};
use crate::runtime::{Device, Graph};
use crate::{Error, ErrorKind, Result};

/// How a bundle is loaded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct WorldOptions {
    /// The global window g in latents: a multiple of the dilation, at most the bundle's `max_window`. `None`: the
    /// bundle's stock window. It is fixed for all rollouts of the world.
    pub global_window: Option<u32>,
    /// Precision of the graphs. `None`: the device's default.
    pub precision: Option<Precision>,
    /// Memory limit in bytes for this world, its bundle and one rollout. `None`: the available system memory.
    pub memory_limit: Option<u64>,
    /// If true and the global window does not fit in memory, the widest window that fits is used; [`World::global_window`] returns it.
    /// If false, a world that does not fit is refused.
    pub fit_window: bool,
    /// For graphs in f16: makes one latent with the f32 graphs as well, compares the two, and refuses the bundle on this device if a value passes
    /// float16's largest number or the latent's error is larger than [`MAX_LATENT_ERROR`](super::MAX_LATENT_ERROR);
    /// [`World::half_precision`] returns the comparison. While the f32 transformer is loaded, which is before all other graphs, it needs about
    /// twice the memory of the f16 graphs' weights. The result depends only on the bundle and the device, so one load of both needs it. Without an
    /// effect in f32.
    pub check_precision: bool,
    /// Number of slices of the transformer: graphs of consecutive layers that run one after the other, 1 to the number of layers. Between two
    /// slices of a pass other work of a graphics device gets its turn, and a cancelled step ends. On the processor every number of slices
    /// gives the same bits in f32. Each slice has an allocator of its own, so more of them need more memory. `None`: 1 without
    /// [`longest_submission`](Self::longest_submission).
    pub slices: Option<u32>,
    /// Limit on the time of a slice. Without `slices`, passes are measured at load, by the device's own clock if it has one, and the
    /// transformer gets the fewest slices of which the longest is within the limit, or if none is, as many as there are layers, or as fit in
    /// memory; [`World::longest_slice`] returns what was measured. That takes several times as long to load. On a graphics device, rollouts of
    /// this world also wait before they have more work than this on the queue at a time, as with
    /// `DirectMlOptions::longest_submission`.
    pub longest_submission: Option<Duration>,
    /// Whether the joined graph is loaded as well, for rollouts with [`CacheMode::Joined`](super::CacheMode::Joined). It needs one more session, and
    /// its own copy of the weights, except in f16 on DirectML. Joined passes are not divided into slices.
    pub joined: bool,
}

impl WorldOptions {
    /// Options of a world for rollouts at `point`: its window, and joined passes if it has them.
    pub fn for_point(point: &OperatingPoint) -> Self {
        let joined = point.cache_mode == CacheMode::Joined;
        Self { global_window: Some(point.global_window), joined, ..Self::default() }
    }
}

/// A loaded bundle: sessions, weights and geometry.
///
/// Threads: may be used from any thread at any time. Its rollouts may run at the same time, each on its own thread; ONNX Runtime
/// then shares the device's threads among them, and no rollout's results depend on another.
pub struct World {
    device: Device,
    manifest: Manifest,
    digest: String,
    precision: Precision,
    global_window: u32,
    need: MemoryNeed,
    half_precision: Option<HalfPrecision>,
    pub(super) shapes: Shapes,
    longest_submission: Option<Duration>,
    longest_slice: Option<Duration>,
    pub(super) transformer: Transformer,
    /// The joined graph, if it was asked for.
    pub(super) joined: Option<Transformer>,
    pub(super) encoder: Arc<Graph>,
    pub(super) decoder: Arc<Graph>,
}

impl World {
    /// Loads `bundle` on `device`: compares its memory need with the available memory, makes the sessions and checks their
    /// tensors against the manifest's geometry. Takes seconds to minutes with real weights. The bundle's bytes are not needed
    /// afterwards.
    ///
    /// # Errors
    /// `InvalidArgument` for a global window that the bundle does not support, and for a number of slices that the transformer cannot have;
    /// `Unsupported` for a precision that it does not contain, for weights of fewer than 16 bits that the device's provider has no operator for, and for a bundle that f16 is not enough for if
    /// that is checked, with the tensor or layer; `OutOfMemory`, with figures, when it does not fit; `InvalidBundle` when the graphs contradict
    /// the manifest; `Device` when ONNX Runtime refuses a graph.
    pub fn load(device: &Device, bundle: &Arc<Bundle>, options: WorldOptions) -> Result<Arc<World>> {
        Self::load_with(device, bundle, options, &|_| Ok(()))
    }

    /// As [`World::load`], with progress: `proceed` is called with the total number of sessions, before each session is created and
    /// after the last. An error from it stops loading. The total grows when the transformer is split because of
    /// [`longest_submission`](WorldOptions::longest_submission).
    ///
    /// # Errors
    /// As [`World::load`], and the errors of `proceed`.
    pub fn load_with(
        device: &Device,
        bundle: &Arc<Bundle>,
        options: WorldOptions,
        proceed: &dyn Fn(u64) -> Result<()>,
    ) -> Result<Arc<World>> {
        let manifest = bundle.manifest();
        let geometry = bundle.geometry();
        let precision = options.precision.unwrap_or_else(|| device.precision());
        if !bundle.has(precision) {
            return Err(Error::new(ErrorKind::Unsupported, format!("the bundle has no {precision:?} graphs"))
                .field("precision")
                .remedy("Use another precision, or build the bundle with it"));
        }
        if options.joined && (options.slices.is_some_and(|slices| slices > 1) || options.longest_submission.is_some()) {
            return Err(Error::new(ErrorKind::InvalidArgument, "joined passes are not divided into slices")
                .field("joined")
                .remedy("Load it without a limit on submissions and in one slice, or without joined passes"));
        }
        let memory = MemoryFit { device, bundle, options: &options, precision };
        let (global_window, mut need) = memory.window()?;
        let shapes = Shapes::new(manifest, global_window);
        let is_checked = options.check_precision && precision == Precision::F16;
        // Encoder, decoder, and what the transformer and the check add.
        let others = 2 + u64::from(is_checked) + u64::from(options.joined);
        let progress = SessionProgress::new(others + u64::from(options.slices.unwrap_or(1)), proceed);
        let explain = |error| missing_operator::explain(error, manifest, &device.describe());
        let reference = match is_checked {
            true => {
                memory.check_reference()?;
                progress.next()?;
                Some(Reference::make(device, bundle).map_err(explain)?)
            }
            false => None,
        };
        let source = TransformerSource { device, bundle, precision, shapes: &shapes, global_window };
        let Transformers { transformer, joined, longest_slice } =
            load_transformers(&source, &memory, &progress).map_err(explain)?;
        if longest_slice.is_some() {
            need = memory.check(precision, global_window, memory.passes(transformer.slices()))?;
        }
        let half_precision = reference.map(|made| made.compare(device, &transformer, manifest, &shapes)).transpose()?;
        if let Some(found) = &half_precision {
            log::info!("f16 beside f32 on {}: {found:?}", device.describe());
            found.check()?;
        }
        let graph = |kind, what, spec: GraphSpec| {
            progress.next()?;
            let made = device.graph(what, &bundle.model(kind, precision)?, &[], spec.inputs, spec.outputs, None);
            made.map_err(explain)
        };
        let encoder = graph(GraphKind::Encoder, "encoder", graph_spec::encoder(geometry, &shapes, precision))?;
        let decoder = graph(GraphKind::Decoder, "decoder", graph_spec::decoder(geometry, &shapes, precision))?;
        progress.next()?;
        Ok(Arc::new(World {
            device: device.clone(),
            manifest: manifest.clone(),
            digest: bundle.digest().to_owned(),
            precision,
            global_window,
            need,
            half_precision,
            shapes,
            longest_submission: options.longest_submission,
            longest_slice,
            transformer,
            joined,
            encoder,
            decoder,
        }))
    }

    /// Computes what passes need of the noise levels of a schedule, so that no step makes a session for it.
    pub(super) fn prepare_levels(&self, table: &SigmaTable) -> Result<()> {
        self.transformer.prepare_levels(GraphKind::Transformer, table)?;
        self.joined.as_ref().map_or(Ok(()), |joined| joined.prepare_levels(GraphKind::Joined, table))
    }

    /// Checks that rollouts of this world can run at `point`.
    pub(super) fn check_point(&self, point: &OperatingPoint) -> Result<()> {
        point.check_for(&self.manifest.geometry)?;
        if point.global_window != self.global_window {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("the world was loaded at g{}, not at g{}", self.global_window, point.global_window),
            )
            .field("global_window")
            .remedy("Load the world with the operating point's global window"));
        }
        if point.cache_mode == CacheMode::Joined && self.joined.is_none() {
            return Err(Error::new(ErrorKind::InvalidArgument, "the world was loaded without joined passes")
                .field("cache_mode")
                .remedy("Load the world with them, or use the cache mode separate"));
        }
        Ok(())
    }

    /// Noise levels whose conditioning every rollout has memory for: those of the stock schedule, which ends in 0.
    pub(super) fn kept_levels(&self) -> usize {
        self.manifest.sampler.schedule.len()
    }

    /// Bytes of a rollout's rings, slabs, conditioning and values that slices hand over.
    pub(super) fn rollout_need(&self) -> u64 {
        let of_joined = self.joined.as_ref().map_or(0, |joined| joined.intermediate_bytes(1));
        let between = self.transformer.intermediate_bytes(self.kept_levels()).saturating_add(of_joined);
        self.need.ring.saturating_add(self.need.slabs).saturating_add(between)
    }

    /// The limit on a rollout's queued work.
    pub(super) fn longest_submission(&self) -> Option<Duration> {
        self.longest_submission
    }

    /// Whether each slice was within that limit when the world was loaded; yes if none was measured.
    pub(super) fn keeps_longest_submission(&self) -> bool {
        self.longest_slice.zip(self.longest_submission).is_none_or(|(longest, limit)| longest <= limit)
    }

    /// Checks that the memory of one more rollout is available, before it is allocated. `freed` bytes count as available, because the
    /// new rollout replaces one of that size.
    pub(super) fn check_rollout_fits(&self, freed: u64) -> Result<()> {
        let need = self.rollout_need();
        match self.device.available_memory().or_else(available_memory).map(|available| available.saturating_add(freed))
        {
            Some(available) if available < need => Err(Error::new(
                ErrorKind::OutOfMemory,
                format!(
                    "a rollout needs {} MiB for its ring, slabs and conditioning, {} MiB are available",
                    need.div_ceil(1 << 20),
                    available >> 20
                ),
            )
            .field("global_window")
            .remedy("Drop another rollout, or load the world at a smaller global window")),
            _ => Ok(()),
        }
    }

    /// The device it runs on.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The bundle's manifest.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The bundle's identity: SHA-256 of its manifest, hexadecimal.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// Precision of the graphs.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The comparison of f16 with f32, if [`WorldOptions::check_precision`] asked for it.
    pub fn half_precision(&self) -> Option<&HalfPrecision> {
        self.half_precision.as_ref()
    }

    /// The global window g, in latents.
    pub fn global_window(&self) -> u32 {
        self.global_window
    }

    /// Number of slices of the transformer.
    pub fn slices(&self) -> u32 {
        self.transformer.slices()
    }

    /// The time of the longest slice as it was measured at load; `None` if no number of slices had to be chosen.
    pub fn longest_slice(&self) -> Option<Duration> {
        self.longest_slice
    }

    /// Memory that this world and one rollout need.
    pub fn memory_need(&self) -> &MemoryNeed {
        &self.need
    }

    /// Number of values of one latent, `C * h * w`.
    pub fn latent_len(&self) -> usize {
        self.shapes.latent_len()
    }

    /// `(width, height)` of a decoded picture.
    pub fn decoded_size(&self) -> (u32, u32) {
        self.manifest.picture.decoded.into()
    }

    /// `(width, height)` of a picture in square pixels, as rollouts return it.
    pub fn render_size(&self) -> (u32, u32) {
        self.manifest.picture.render.into()
    }

    /// Bytes that a commit of one latent's K and V copies into the rings of layers of these kinds.
    pub fn slab_bytes(&self, kinds: &[LayerKind]) -> u64 {
        let geometry = &self.manifest.geometry;
        let layers = (0..geometry.layers).filter(|&i| kinds.contains(&geometry.layer_kind(i))).count();
        let element = crate::runtime::element_size(self.precision);
        (layers * 2 * self.shapes.slab_len() * element) as u64
    }

    /// Bytes that the transformer's concatenation of past and present K and V moves in one pass, computed from its shapes: every
    /// ring and the current latent of every layer, read and written once.
    pub fn concat_bytes_per_pass(&self) -> u64 {
        let geometry = &self.manifest.geometry;
        let numbers: usize = (0..geometry.layers)
            .map(|i| 2 * (self.shapes.ring_len(geometry.layer_kind(i)) + self.shapes.slab_len()))
            .sum();
        (numbers * crate::runtime::element_size(self.precision)) as u64
    }
}

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "World({} g{} {:?} on {})",
            self.manifest.name,
            self.global_window,
            self.precision,
            self.device.describe()
        )
    }
}
