//! A rollout's KV cache: the rings on the device, the slabs that a pass writes, and the commit that copies slabs into rings.

use super::contract::Shapes;
use super::world::World;
use crate::Result;
use crate::bundle::Precision;
use crate::runtime::{BufferId, ExecutionContext, RecordedCopiesId, RecordedCopy, Region, element_size};

/// Half of a layer's KV cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Part {
    /// Keys, after norm and RoPE.
    Keys,
    /// Values, after the value residual.
    Values,
}

/// K or V of one layer.
struct Half {
    global: bool,
    /// `[kv_heads, buckets * T, head_width]`, bound as `past`.
    ring: BufferId,
}

/// Rings and slabs of all layers; K and V of layer i are halves 2i and 2i + 1.
pub(super) struct KvMemory {
    halves: Vec<Half>,
    /// One slab for each half, `[kv_heads, T, head_width]`, bound as `present`.
    slabs: Vec<BufferId>,
    /// For each slot, the recorded copies of all local layers' slabs to it; then the same for global layers.
    commits: [Vec<RecordedCopiesId>; 2],
}

impl KvMemory {
    pub(super) fn new(context: &mut dyn ExecutionContext, world: &World) -> Result<Self> {
        let (shapes, element) = (world.shapes, element_size(world.precision()));
        let geometry = &world.manifest().geometry;
        let mut halves = Vec::with_capacity(2 * shapes.layers);
        let mut slabs = Vec::with_capacity(2 * shapes.layers);
        for layer in 0..geometry.layers {
            let global = geometry.is_global(layer);
            for _ in [Part::Keys, Part::Values] {
                halves.push(Half { global, ring: context.buffer(shapes.ring_len(global) * element)? });
                slabs.push(context.buffer(shapes.slab_len() * element)?);
            }
        }
        let mut commits = |global: bool| {
            let to_slot = |slot: usize| {
                let ours = halves.iter().zip(&slabs).filter(|(half, _)| half.global == global);
                let copy = |(half, slab): (&Half, &BufferId)| RecordedCopy {
                    to: half.ring,
                    from: *slab,
                    regions: regions(&shapes, element, global, slot),
                };
                context.keep(ours.map(copy).collect())
            };
            (0..shapes.buckets(global)).map(to_slot).collect::<Result<Vec<_>>>()
        };
        let commits = [commits(false)?, commits(true)?];
        Ok(Self { halves, slabs, commits })
    }

    /// The rings in the order of the transformer's `past` inputs.
    pub(super) fn rings(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.halves.iter().map(|half| half.ring)
    }

    /// The slabs in the order of the transformer's `present` outputs.
    pub(super) fn slabs(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.slabs.iter().copied()
    }

    /// The ring of one half of a layer.
    pub(super) fn ring(&self, layer: usize, part: Part) -> Option<BufferId> {
        self.halves.get(2 * layer + usize::from(part == Part::Values)).map(|half| half.ring)
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
            (Some(local), Some(global)) => context.repeat(&[local, global, others]),
            (Some(slot), None) | (None, Some(slot)) => context.repeat(&[slot, others]),
            (None, None) => context.repeat(&[others]),
        }
    }
}

/// The copy regions from a slab to a ring's slot. Rings are heads-first, so each head is one region, and only the slab's bytes are
/// copied.
fn regions(shapes: &Shapes, element: usize, global: bool, slot: usize) -> Vec<Region> {
    let len = shapes.tokens * shapes.head_width * element;
    let to = |head| (head * shapes.buckets(global) + slot) * len;
    (0..shapes.kv_heads).map(|head| Region { to: to(head), from: head * len, len }).collect()
}

impl Shapes {
    /// Copies slots of K or V of a global layer between rings of different sizes. `slots` are pairs of a source and a destination
    /// slot.
    pub(super) fn move_slots(&self, precision: Precision, from: &[u8], to: &mut [u8], slots: &[(usize, usize)]) {
        let len = self.tokens * self.head_width * element_size(precision);
        let heads = from.chunks_exact(from.len() / self.kv_heads).zip(to.chunks_exact_mut(to.len() / self.kv_heads));
        for (from, to) in heads {
            for (there, here) in slots {
                to[here * len..][..len].copy_from_slice(&from[there * len..][..len]);
            }
        }
    }
}
