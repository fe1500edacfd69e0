//! A rollout's KV cache: the rings on the device, the slabs that a pass writes, and the commit that copies slabs into rings.

use super::graph_spec::Shapes;
use super::world::World;
use crate::Result;
use crate::bundle::Precision;
use crate::runtime::{BufferId, ExecutionContext, RecordedCopiesId, RecordedCopy, Region, element_size};

/// Keys or values: half of a layer's KV cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum KvPart {
    /// Keys, after norm and RoPE.
    Keys,
    /// Values, after the value residual.
    Values,
}

/// The ring of K, or of V, of one layer.
struct LayerRing {
    global: bool,
    /// `[kv_heads, slots * T, head_width]`, bound as `past`.
    buffer: BufferId,
}

/// Rings and slabs of all layers; K and V of layer i are at 2i and 2i + 1.
pub(super) struct KvCache {
    rings: Vec<LayerRing>,
    /// One slab for each ring, `[kv_heads, T, head_width]`, bound as `present`.
    slabs: Vec<BufferId>,
    /// For each slot, the recorded copies of all local layers' slabs to it; then the same for global layers.
    commits: [Vec<RecordedCopiesId>; 2],
}

impl KvCache {
    pub(super) fn new(context: &mut dyn ExecutionContext, world: &World) -> Result<Self> {
        let (shapes, element) = (world.shapes, element_size(world.precision()));
        let geometry = &world.manifest().geometry;
        let mut rings = Vec::with_capacity(2 * shapes.layers);
        let mut slabs = Vec::with_capacity(2 * shapes.layers);
        for layer in 0..geometry.layers {
            let global = geometry.is_global(layer);
            for _ in [KvPart::Keys, KvPart::Values] {
                rings.push(LayerRing { global, buffer: context.buffer(shapes.ring_len(global) * element)? });
                slabs.push(context.buffer(shapes.slab_len() * element)?);
            }
        }
        let mut commits = |global: bool| {
            let to_slot = |slot: usize| {
                let selected = rings.iter().zip(&slabs).filter(|(ring, _)| ring.global == global);
                let copy = |(ring, slab): (&LayerRing, &BufferId)| RecordedCopy {
                    to: ring.buffer,
                    from: *slab,
                    regions: regions(&shapes, element, global, slot),
                };
                context.record_copies(selected.map(copy).collect())
            };
            (0..shapes.slot_count(global)).map(to_slot).collect::<Result<Vec<_>>>()
        };
        let commits = [commits(false)?, commits(true)?];
        Ok(Self { rings, slabs, commits })
    }

    /// The rings in the order of the transformer's `past` inputs.
    pub(super) fn rings(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.rings.iter().map(|ring| ring.buffer)
    }

    /// The slabs in the order of the transformer's `present` outputs.
    pub(super) fn slabs(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.slabs.iter().copied()
    }

    /// The ring of K or V of one layer.
    pub(super) fn ring(&self, layer: usize, part: KvPart) -> Option<BufferId> {
        self.rings.get(2 * layer + usize::from(part == KvPart::Values)).map(|ring| ring.buffer)
    }

    /// Whether `buffer` is the ring of a global layer.
    pub(super) fn is_global_ring(&self, buffer: BufferId) -> bool {
        self.rings.iter().any(|ring| ring.global && ring.buffer == buffer)
    }

    /// Copies the slabs into ring slots, one for local and one for global layers (`None` leaves that kind unchanged), and runs the
    /// copies `others`: all or nothing.
    pub(super) fn commit(
        &self,
        context: &mut dyn ExecutionContext,
        local: Option<usize>,
        global: Option<usize>,
        others: RecordedCopiesId,
    ) -> Result<()> {
        let [locals, globals] = &self.commits;
        match (local.map(|slot| locals[slot]), global.map(|slot| globals[slot])) {
            (Some(local), Some(global)) => context.run_copies(&[local, global, others]),
            (Some(slot), None) | (None, Some(slot)) => context.run_copies(&[slot, others]),
            (None, None) => context.run_copies(&[others]),
        }
    }
}

/// The copy regions from a slab to a ring's slot. Rings are heads-first, so each head is one region, and only the slab's bytes are
/// copied.
fn regions(shapes: &Shapes, element: usize, global: bool, slot: usize) -> Vec<Region> {
    let len = shapes.tokens * shapes.head_width * element;
    let to = |head| (head * shapes.slot_count(global) + slot) * len;
    (0..shapes.kv_heads).map(|head| Region { to: to(head), from: head * len, len }).collect()
}

/// Copies slots of K or V of a global layer between rings of different sizes. `slots` are pairs of a source and a destination slot.
pub(super) fn copy_slots(shapes: &Shapes, precision: Precision, from: &[u8], to: &mut [u8], slots: &[(usize, usize)]) {
    let len = shapes.tokens * shapes.head_width * element_size(precision);
    let heads = from.chunks_exact(from.len() / shapes.kv_heads).zip(to.chunks_exact_mut(to.len() / shapes.kv_heads));
    for (from, to) in heads {
        for (source, destination) in slots {
            to[destination * len..][..len].copy_from_slice(&from[source * len..][..len]);
        }
    }
}
