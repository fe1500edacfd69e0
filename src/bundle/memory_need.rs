//! Estimate of the memory that a world needs, computed before anything is loaded.

use super::onnx::{ConditioningModel, ConditioningModels, Footprint, ModelContext, Slices, footprint};
use super::{Bundle, Geometry, GraphKind, Precision};
use crate::{Error, ErrorKind, Result};

/// Noise levels whose conditioning a world keeps in the host's memory, at most.
pub(crate) const KEPT_LEVELS: usize = 64;

/// The kind of processor that runs a world's graphs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Processor {
    /// The host's processor.
    Cpu,
    /// A graphics adapter.
    Gpu,
}

/// Memory of one world with one rollout at one global window, in bytes.
///
/// With F the bytes of one number of the graphs' precision:
///
/// ```text
/// ring          = sum over layers of 2 * kv_heads * slots * T * head_width * F
/// slabs         = layers * 2 * kv_heads * T * head_width * F
/// weights       = every constant that a run reads, in the type in which it reads it: an f32 graph holds f16 weights as f32
/// conditioning  = in the host's memory: the weights of the nodes that depend on noise levels alone, as they are stored, and these nodes' results
///                 at up to 64 levels
/// intermediates = peak of the transformer's live intermediate values over all nodes; a value lives from the node that produces
///                 it to the last node that reads it, and `Reshape` shares its input's memory
/// unpacked      = the largest matrix that a processor unpacks from 8 or 4 bits to multiply by it: one at a time in each session, so the largest of
///                 a pass plus the largest of the embedding of controls
/// autoencoder   = the same as intermediates for encoder and decoder, + their inputs and outputs
/// arena         = intermediates + encoder's and decoder's intermediate values, a second time
/// total         = bundle + the sum of these
/// ```
///
/// The nodes that depend on a noise level alone run once for each level, in a session of their own. The world drops this session before it makes those
/// of the passes, so `weights` does not count it. Each rollout keeps the results for the levels of the stock schedule, which `intermediates` counts. A
/// schedule with levels that no preset has needs the session again for a moment. The session that embeds controls stays, and is counted with the
/// transformer's.
///
/// With joined passes, `weights`, `intermediates` and `unpacked` are the sums of both graphs, except for weights that they share; there are three
/// times the slabs.
///
/// `arena` is the overhead of the runtime's allocator: it grows during the first run and from the second on holds one planned block
/// as well (measured with ONNX Runtime 1.24: 2.3 times the intermediates in total). During loading the runtime briefly holds weights
/// in both types.
///
/// In several slices, `weights`, `intermediates` and `unpacked` are the sums of all slices, because each has an allocator of its own, which keeps
/// what it needed once; `intermediates` also has the values that slices hand over, and `arena` those of all slices.
///
/// `unpacked` was measured, too (`docs/bundle.md`, section 4). A CPU unpacks a matrix of 8 bits to float32, in graphs of both precisions, unless
/// its activations have 8 bits as well; it multiplies by one of 4 bits as it is stored. A GPU unpacks every such matrix to F.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryNeed {
    /// The bundle's own files, which are in memory as long as the bundle is.
    pub bundle: u64,
    /// Weights as the runtime holds them, of all models.
    pub weights: u64,
    /// Weights and results of the nodes that depend on noise levels alone, in the host's memory.
    pub conditioning: u64,
    /// Keys and values of one rollout's ring.
    pub ring: u64,
    /// Keys and values of the current frame.
    pub slabs: u64,
    /// Intermediate values of a transformer pass.
    pub intermediates: u64,
    /// The largest single intermediate value; included in `intermediates`.
    pub largest_intermediate: u64,
    /// The largest matrix in 8 or 4 bits, as a pass unpacks it; 0 if none is unpacked.
    pub unpacked: u64,
    /// Intermediate values, pictures, latents and memories of encoder and decoder.
    pub autoencoder: u64,
    /// Overhead of the runtime's allocator.
    pub arena: u64,
    /// The sum.
    pub total: u64,
}

impl MemoryNeed {
    /// Refuses a need of more than `limit` bytes.
    ///
    /// # Errors
    /// `OutOfMemory`, with the numbers.
    pub fn check_fits(&self, limit: u64) -> Result<()> {
        if self.total <= limit {
            return Ok(());
        }
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        let cause = format!(
            "{} MiB are needed (bundle {}, weights {}, conditioning {}, ring {}, slabs {}, intermediates {}, unpacked {}, autoencoder {}, arena {}), {} MiB are available",
            mib(self.total),
            mib(self.bundle),
            mib(self.weights),
            mib(self.conditioning),
            mib(self.ring),
            mib(self.slabs),
            mib(self.intermediates),
            mib(self.unpacked),
            mib(self.autoencoder),
            mib(self.arena),
            limit >> 20
        );
        Err(Error::new(ErrorKind::OutOfMemory, cause)
            .field("global_window")
            .remedy("Choose a smaller global window or a smaller bundle, or free memory"))
    }

    /// Refuses a need of more than `available` bytes on a graphics device, which holds everything except the bundle's files and the conditioning.
    ///
    /// # Errors
    /// `OutOfMemory`, with the numbers.
    pub fn check_fits_on_device(&self, available: u64) -> Result<()> {
        let needed = self.total.saturating_sub(self.bundle).saturating_sub(self.conditioning);
        if needed <= available {
            return Ok(());
        }
        let (needed, available) = (needed.div_ceil(1 << 20), available >> 20);
        Err(Error::new(
            ErrorKind::OutOfMemory,
            format!("{needed} MiB of the adapter are needed, {available} MiB are left"),
        )
        .field("global_window")
        .remedy("Choose a smaller global window or another adapter, or have the engine free memory"))
    }
}

impl Geometry {
    /// Checks that a global window of `g` latents is a multiple of the dilation, from the dilation to the largest window allowed.
    ///
    /// # Errors
    /// `InvalidArgument` otherwise.
    pub fn check_window(&self, g: u32) -> Result<()> {
        let (dilation, most) = (self.global.dilation, self.global.max_window);
        if g > 0 && g.is_multiple_of(dilation) && g <= most {
            return Ok(());
        }
        Err(Error::new(ErrorKind::InvalidArgument, format!("g{g} is no window of this world"))
            .field("global_window")
            .remedy(format!("Use a multiple of {dilation} up to {most}")))
    }

    /// Number of elements of K, or of V, of one layer at the global window `g`.
    fn past_len(&self, layer: u32, g: u32) -> u64 {
        self.slot_count(self.layer_kind(layer), g) * self.slab_len()
    }

    /// Number of elements of K, or of V, of one layer for one latent.
    fn slab_len(&self) -> u64 {
        u64::from(self.kv_heads) * u64::from(self.tokens) * u64::from(self.head_width)
    }
}

/// The graphs that a world's passes are run with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Passes {
    /// The transformer as it is stored, with its conditioning: the reference of [`WorldOptions::check_precision`](crate::world::WorldOptions::check_precision).
    Whole,
    /// The transformer in so many slices, at least 1.
    Slices(u32),
    /// The transformer and the joined graph. `shared_weights`: both use the same weights, as f16 graphs do on DirectML.
    Joined {
        /// See above.
        shared_weights: bool,
    },
}

/// Memory of the transformer, of all slices.
struct TransformerMemory {
    weights: u64,
    peak: u64,
    largest: u64,
    unpacked: u64,
    /// Intermediate tensors between slices.
    between_slices: u64,
    /// Weights of the conditioning, as they are stored.
    conditioning: u64,
    /// What it makes of the noise levels of a pass.
    conditioning_values: u64,
}

impl TransformerMemory {
    fn of(footprints: &[Footprint], processor: Processor) -> Self {
        let sum =
            |part: fn(&Footprint) -> u64| footprints.iter().map(part).fold(0, |sum: u64, n| sum.saturating_add(n));
        Self {
            weights: sum(|f| f.weights),
            peak: sum(|f| f.peak),
            largest: footprints.iter().map(|f| f.largest).max().unwrap_or(0),
            unpacked: footprints.iter().map(|f| f.unpacked.on(processor)).fold(0, u64::saturating_add),
            between_slices: 0,
            conditioning: 0,
            conditioning_values: 0,
        }
    }

    /// Of two graphs, each with sessions of its own.
    fn with(&self, other: &Self) -> Self {
        Self {
            weights: self.weights.saturating_add(other.weights),
            peak: self.peak.saturating_add(other.peak),
            largest: self.largest.max(other.largest),
            unpacked: self.unpacked.saturating_add(other.unpacked),
            between_slices: self.between_slices.saturating_add(other.between_slices),
            conditioning: self.conditioning.saturating_add(other.conditioning),
            conditioning_values: self.conditioning_values.saturating_add(other.conditioning_values),
        }
    }

    fn in_slices(slices: &Slices, conditioning: &ConditioningModels, processor: Processor) -> Self {
        let ConditioningModels { of_levels, of_controls } = conditioning;
        let (of_levels, of_controls) = (of_levels.as_ref(), of_controls.as_ref());
        let footprints = slices.models.iter().map(|model| model.footprint);
        let footprints: Vec<Footprint> = footprints.chain(of_controls.map(|model| model.footprint)).collect();
        let values = |model: &ConditioningModel| model.values.iter().map(|value| value.bytes() as u64).sum::<u64>();
        let between_slices = slices.buffer_sizes.iter().map(|&bytes| bytes as u64).fold(0, u64::saturating_add);
        Self {
            between_slices: between_slices.saturating_add(of_controls.map_or(0, values)),
            conditioning: of_levels.map_or(0, |model| model.stored_weights),
            conditioning_values: of_levels.map_or(0, values),
            ..Self::of(&footprints, processor)
        }
    }
}

impl Bundle {
    /// The memory that a world and one rollout need on `processor` at a global window of `g` latents.
    ///
    /// # Errors
    /// `InvalidArgument` for a window that the bundle does not allow; `Unsupported` if it lacks the precision; `InvalidBundle` if a graph's
    /// shapes are inconsistent at this window.
    pub fn memory_need(&self, precision: Precision, processor: Processor, g: u32) -> Result<MemoryNeed> {
        self.memory_need_in(precision, processor, g, Passes::Slices(1))
    }

    /// As [`memory_need`](Self::memory_need), with the transformer loaded for such `passes`.
    ///
    /// # Errors
    /// As [`memory_need`](Self::memory_need), `InvalidArgument` for a number of slices that the transformer cannot have, and `Unsupported` for
    /// joined passes if the bundle has no joined graphs.
    pub fn memory_need_in(
        &self,
        precision: Precision,
        processor: Processor,
        g: u32,
        passes: Passes,
    ) -> Result<MemoryNeed> {
        let geometry = self.geometry();
        geometry.check_window(g)?;
        let [encoder, decoder] =
            [GraphKind::Encoder, GraphKind::Decoder].map(|kind| self.footprint(kind, precision, g));
        let (encoder, decoder) = (encoder?, decoder?);
        let in_slices = |kind, slices| {
            let splitting = self.splitting(kind, precision, g)?;
            let (split, conditioning) = (splitting.split(slices)?, splitting.conditioning()?);
            Ok::<_, Error>(TransformerMemory::in_slices(&split, &conditioning, processor))
        };
        let transformer = match passes {
            Passes::Whole => TransformerMemory::of(&[self.footprint(GraphKind::Transformer, precision, g)?], processor),
            Passes::Slices(slices) => in_slices(GraphKind::Transformer, slices)?,
            Passes::Joined { shared_weights } => {
                let transformer = in_slices(GraphKind::Transformer, 1)?;
                let both = transformer.with(&in_slices(GraphKind::Joined, 1)?);
                if shared_weights { TransformerMemory { weights: transformer.weights, ..both } } else { both }
            }
        };

        let number = precision.bytes() as u64;
        let pairs = 2 * number;
        // Products cannot overflow: the manifest's limits keep each below 2^60. Sums saturate.
        let ring = (0..geometry.layers).map(|i| geometry.past_len(i, g) * pairs).fold(0, u64::saturating_add);
        let slabs = u64::from(geometry.layers).saturating_mul(geometry.slab_len() * pairs);
        // Those of a finished latent, and those that its commit replaces.
        let slabs = slabs.saturating_mul(if matches!(passes, Passes::Joined { .. }) { 3 } else { 1 });
        let others = [&encoder, &decoder];
        let weights = others.map(|f: &Footprint| f.weights).into_iter().fold(transformer.weights, u64::saturating_add);
        let unpacked = others.map(|f| f.unpacked.on(processor)).into_iter().fold(transformer.unpacked, u64::max);
        let coding = encoder.peak.saturating_add(decoder.peak);
        let autoencoder = coding.saturating_add(self.autoencoder_ports() * number);
        let arena = coding.saturating_add(transformer.peak);
        // Of each level of the stock schedule, 0 among them, and those that passes read.
        let levels = self.manifest.sampler.schedule.len() as u64 + 1;
        let conditioning_values = transformer.conditioning_values.saturating_mul(levels);
        let intermediates =
            transformer.peak.saturating_add(transformer.between_slices).saturating_add(conditioning_values);
        let bundle = self.files.values().map(|bytes| bytes.len() as u64).fold(0, u64::saturating_add);
        let kept = transformer.conditioning_values.saturating_mul(KEPT_LEVELS as u64);
        let conditioning = transformer.conditioning.saturating_add(kept);
        let parts = [bundle, weights, conditioning, ring, slabs, intermediates, unpacked, autoencoder, arena];
        Ok(MemoryNeed {
            bundle,
            weights,
            conditioning,
            ring,
            slabs,
            intermediates,
            largest_intermediate: transformer.largest,
            unpacked,
            autoencoder,
            arena,
            total: parts.into_iter().fold(0, u64::saturating_add),
        })
    }

    pub(super) fn footprint(&self, kind: GraphKind, precision: Precision, g: u32) -> Result<Footprint> {
        footprint(self.model(kind, precision)?.onnx, ModelContext { manifest: &self.manifest, kind, precision }, g)
    }

    /// Number of elements in the inputs and outputs of encoder and decoder: four pictures and a latent each, the decoder's memories twice,
    /// the encoder's three times.
    fn autoencoder_ports(&self) -> u64 {
        let geometry = self.geometry();
        let [width, height] = self.manifest.picture.decoded.map(u64::from);
        let numbers = |shapes: &[[u32; 3]]| -> u64 {
            shapes.iter().map(|m| m.iter().map(|&n| u64::from(n)).product::<u64>()).sum()
        };
        let memories = numbers(&geometry.autoencoder.memories);
        // Input, output, and the zeroes that each clip starts with.
        let of_encoder = 3 * numbers(&geometry.autoencoder.encoder_memories);
        let pictures = u64::from(geometry.autoencoder.temporal) * 3 * width * height;
        2 * (pictures + geometry.latent_len() as u64 + memories) + of_encoder
    }
}

/// Memory that this process can still allocate without swapping, in bytes; `None` if the system does not report it.
///
/// The system's available memory or, on Linux, the control group's limit minus its resident memory, whichever is less.
pub fn available_memory() -> Option<u64> {
    let mut system = sysinfo::System::new().ok()?;
    system.refresh_memory_specifics(sysinfo::MemoryRefreshKind::nothing().with_ram());
    let available = Some(system.available_memory()).filter(|&bytes| bytes > 0)?;
    let group = system.cgroup_limits().map(|limits| limits.total_memory.saturating_sub(limits.rss));
    Some(group.map_or(available, |left| left.min(available)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_need_above_the_limit_is_refused_with_its_parts() {
        let need = MemoryNeed {
            bundle: 1 << 20,
            weights: 1 << 20,
            conditioning: 1 << 20,
            ring: 3 << 20,
            slabs: 0,
            intermediates: 4 << 20,
            largest_intermediate: 1 << 20,
            unpacked: 0,
            autoencoder: 0,
            arena: 0,
            total: 10 << 20,
        };
        assert!(need.check_fits(10 << 20).is_ok());
        let error = need.check_fits((10 << 20) - 1).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::OutOfMemory);
        let text = error.to_string();
        assert!(
            text.contains("10 MiB are needed") && text.contains("ring 3") && text.contains("9 MiB are available"),
            "{text}"
        );
        // The bundle's files and the conditioning are in system memory and not in the adapter's.
        assert!(need.check_fits_on_device(8 << 20).is_ok());
        let error = need.check_fits_on_device((8 << 20) - 1).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::OutOfMemory);
        let text = error.to_string();
        assert!(text.contains("8 MiB of the adapter are needed, 7 MiB are left"), "{text}");
    }

    #[cfg(any(target_os = "linux", windows))]
    #[test]
    fn available_memory_is_reported() {
        assert!(available_memory().is_some_and(|bytes| bytes > 1 << 20));
    }
}
