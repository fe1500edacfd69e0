//! A rollout's KV cache: the rings on the device, the slabs that a pass writes, and the commit that copies slabs into rings.

use super::graph_spec::Shapes;
use super::world::World;
use crate::Result;
use crate::bundle::{LayerKind, Precision};
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
    kind: LayerKind,
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
    deferred: Option<DeferredCommits>,
}

/// Commits that are made between two passes of a later step, and that can be undone.
struct DeferredCommits {
    /// Slabs of the finished latent, bound as `present` of the joined graph.
    slabs: Vec<BufferId>,
    /// Copies for each slot of local layers, then of global ones.
    slots: [Vec<SlotCopies>; 2],
}

/// Recorded copies of one slot, of all layers of one kind.
#[derive(Clone, Copy)]
struct SlotCopies {
    /// The ring's contents to a backup.
    back_up: RecordedCopiesId,
    /// The finished latent's slabs to the ring.
    commit: RecordedCopiesId,
    /// The backup to the ring.
    undo: RecordedCopiesId,
}

/// A deferred commit that was made, and can be undone.
#[must_use]
pub(super) struct MadeCommit([Option<SlotCopies>; 2]);

impl KvCache {
    pub(super) fn new(context: &mut dyn ExecutionContext, world: &World) -> Result<Self> {
        let (shapes, element) = (world.shapes, element_size(world.precision()));
        let geometry = &world.manifest().geometry;
        let mut rings = Vec::with_capacity(2 * shapes.layers);
        let mut slabs = Vec::with_capacity(2 * shapes.layers);
        for layer in 0..geometry.layers {
            let kind = geometry.layer_kind(layer);
            for _ in [KvPart::Keys, KvPart::Values] {
                rings.push(LayerRing { kind, buffer: context.buffer(shapes.ring_len(kind) * element)? });
                slabs.push(context.buffer(shapes.slab_len() * element)?);
            }
        }
        let mut commits = |kind| {
            let slots = 0..shapes.slot_count(kind);
            let record =
                |slot| record_slot(context, (&shapes, element), &rings, &slabs, (kind, slot), Direction::ToRing);
            slots.map(record).collect::<Result<Vec<_>>>()
        };
        let commits = [commits(LayerKind::Local)?, commits(LayerKind::Global)?];
        let deferred =
            world.joined.is_some().then(|| DeferredCommits::new(context, shapes, element, &rings)).transpose()?;
        Ok(Self { rings, slabs, commits, deferred })
    }

    /// The slabs in the order of the joined graph's `present` outputs.
    pub(super) fn finished_slabs(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.deferred.iter().flat_map(|deferred| &deferred.slabs).copied()
    }

    /// Copies the finished latent's slabs into ring slots, one for local and one for global layers: all or nothing.
    pub(super) fn commit_finished(
        &self,
        context: &mut dyn ExecutionContext,
        local: Option<usize>,
        global: Option<usize>,
    ) -> Result<MadeCommit> {
        let [locals, globals] = &self.deferred.as_ref().expect("the world has the joined graph").slots;
        let made = MadeCommit([local.map(|slot| locals[slot]), global.map(|slot| globals[slot])]);
        made.with(|slot| slot.back_up, |copies| context.run_copies(copies))?;
        made.with(|slot| slot.commit, |copies| context.run_copies(copies))?;
        Ok(made)
    }

    /// Copies the backup back into the ring slots that `made` has overwritten.
    pub(super) fn undo(context: &mut dyn ExecutionContext, made: &MadeCommit) -> Result<()> {
        made.with(|slot| slot.undo, |copies| context.undo_copies(copies))
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
        self.rings.iter().any(|ring| ring.kind == LayerKind::Global && ring.buffer == buffer)
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
        // Without a list on the heap: a step allocates nothing.
        let (mut copies, mut count) = ([others; 3], 1);
        for slot in [local.map(|slot| locals[slot]), global.map(|slot| globals[slot])].into_iter().flatten() {
            copies[count] = slot;
            count += 1;
        }
        context.run_copies(&copies[..count])
    }
}

impl MadeCommit {
    /// Hands one kind of copies of its slots to `run`, if there are any.
    fn with(
        &self,
        copies: fn(&SlotCopies) -> RecordedCopiesId,
        run: impl FnOnce(&[RecordedCopiesId]) -> Result<()>,
    ) -> Result<()> {
        match &self.0 {
            [Some(local), Some(global)] => run(&[copies(local), copies(global)]),
            [Some(slot), None] | [None, Some(slot)] => run(&[copies(slot)]),
            [None, None] => Ok(()),
        }
    }
}

impl DeferredCommits {
    fn new(context: &mut dyn ExecutionContext, shapes: Shapes, element: usize, rings: &[LayerRing]) -> Result<Self> {
        let mut slabs_of_all =
            || -> Result<Vec<BufferId>> { rings.iter().map(|_| context.buffer(shapes.slab_len() * element)).collect() };
        let (slabs, backups) = (slabs_of_all()?, slabs_of_all()?);
        let mut of_kind = |kind| {
            let mut record = |slabs: &[BufferId], slot, direction| {
                record_slot(context, (&shapes, element), rings, slabs, (kind, slot), direction)
            };
            let copies = |slot| {
                Ok(SlotCopies {
                    back_up: record(&backups, slot, Direction::FromRing)?,
                    commit: record(&slabs, slot, Direction::ToRing)?,
                    undo: record(&backups, slot, Direction::ToRing)?,
                })
            };
            (0..shapes.slot_count(kind)).map(copies).collect::<Result<Vec<_>>>()
        };
        let slots = [of_kind(LayerKind::Local)?, of_kind(LayerKind::Global)?];
        Ok(Self { slabs, slots })
    }
}

/// Whether a slot is written or read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Direction {
    ToRing,
    FromRing,
}

/// Records the copies between `slabs` and one slot of the rings of all layers of one kind. Rings are heads-first, so each head is one region, and only
/// the slab's bytes are copied.
fn record_slot(
    context: &mut dyn ExecutionContext,
    (shapes, element): (&Shapes, usize),
    rings: &[LayerRing],
    slabs: &[BufferId],
    (kind, slot): (LayerKind, usize),
    direction: Direction,
) -> Result<RecordedCopiesId> {
    let len = shapes.tokens * shapes.head_width * element;
    let region = |head| {
        let (ring, slab) = ((head * shapes.slot_count(kind) + slot) * len, head * len);
        match direction {
            Direction::ToRing => Region { to: ring, from: slab, len },
            Direction::FromRing => Region { to: slab, from: ring, len },
        }
    };
    let selected = rings.iter().zip(slabs).filter(|(ring, _)| ring.kind == kind);
    let copy = |(ring, &slab): (&LayerRing, &BufferId)| {
        let (to, from) = match direction {
            Direction::ToRing => (ring.buffer, slab),
            Direction::FromRing => (slab, ring.buffer),
        };
        RecordedCopy { to, from, regions: (0..shapes.kv_heads).map(region).collect() }
    };
    context.record_copies(selected.map(copy).collect())
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
