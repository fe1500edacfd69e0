//! A rollout's KV memory: the rings on the device, the slabs a pass leaves, and the commit between them.

use super::contract::Shapes;
use super::world::World;
use crate::Result;
use crate::bundle::Precision;
use crate::runtime::{BufferId, Lane, Region};

/// Which half of a layer's memory.
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
    /// `[kv_heads, T, head_width]`, bound as `present`.
    slab: BufferId,
}

/// Rings and slabs of all layers; K and V of layer i are halves 2i and 2i + 1.
pub(super) struct KvMemory {
    halves: Vec<Half>,
    shapes: Shapes,
    precision: Precision,
    /// The regions of one commit, kept for their memory.
    regions: Vec<Region>,
}

impl KvMemory {
    pub(super) fn new(lane: &mut dyn Lane, world: &World) -> Result<Self> {
        let (shapes, precision) = (world.shapes, world.precision());
        let element = crate::runtime::element_size(precision);
        let geometry = &world.manifest().geometry;
        let mut halves = Vec::with_capacity(2 * shapes.layers);
        for layer in 0..geometry.layers {
            let global = geometry.is_global(layer);
            for _ in [Part::Keys, Part::Values] {
                halves.push(Half {
                    global,
                    ring: lane.buffer(shapes.ring_len(global) * element)?,
                    slab: lane.buffer(shapes.slab_len() * element)?,
                });
            }
        }
        Ok(Self { halves, shapes, precision, regions: Vec::with_capacity(shapes.kv_heads) })
    }

    /// The rings in the order of the transformer's `past` inputs.
    pub(super) fn rings(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.halves.iter().map(|half| half.ring)
    }

    /// The slabs in the order of the transformer's `present` outputs.
    pub(super) fn slabs(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.halves.iter().map(|half| half.slab)
    }

    /// The ring of one half of a layer.
    pub(super) fn ring(&self, layer: usize, part: Part) -> Option<BufferId> {
        self.halves.get(2 * layer + usize::from(part == Part::Values)).map(|half| half.ring)
    }

    /// Whether the slabs hold finite numbers only.
    pub(super) fn slabs_finite(&self, lane: &dyn Lane) -> Result<bool> {
        self.slabs().try_fold(true, |all, slab| Ok(all && lane.finite(slab, self.precision)?))
    }

    /// Copies the slabs into ring slots, one for local and one for global layers; `None` leaves that kind alone.
    ///
    /// Rings are heads-first, so a slab is one stretch per head, and no byte more is moved.
    pub(super) fn commit(&mut self, lane: &mut dyn Lane, local: Option<usize>, global: Option<usize>) -> Result<()> {
        let s = &self.shapes;
        let element = crate::runtime::element_size(self.precision);
        let len = s.tokens * s.head_width * element;
        for half in &self.halves {
            let Some(slot) = (if half.global { global } else { local }) else { continue };
            let buckets = s.buckets(half.global);
            assert!(slot < buckets, "the plan's slot lies in the ring");
            self.regions.clear();
            self.regions.extend((0..s.kv_heads).map(|head| Region {
                to: (head * buckets + slot) * len,
                from: head * len,
                len,
            }));
            lane.copy(half.ring, half.slab, &self.regions)?;
        }
        Ok(())
    }

    /// Zeroes the rings.
    pub(super) fn reset(&self, lane: &mut dyn Lane) -> Result<()> {
        self.rings().try_for_each(|ring| lane.clear(ring))
    }
}
