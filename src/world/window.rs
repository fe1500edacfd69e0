//! Moves a rollout to another world of the same bundle, with a longer or a shorter context window.

use std::sync::Arc;

use super::kv_memory::Part;
use super::operating_point::OperatingPoint;
use super::ring::Ring;
use super::rollout::Rollout;
use super::world::World;
use crate::runtime::BufferId;
use crate::{Error, ErrorKind, Result};

impl Rollout {
    /// Continues in `world`: the same bundle at the same precision, loaded with another global window. With a shorter window the
    /// oldest latents are forgotten; with a longer one nothing is, and the memory lasts longer from now on. Clocks, seed, schedule,
    /// the last latent and its pictures, and the decoder's memories stay. A pass sees the same as in a world that had this window
    /// from the start, except for latents that a shorter window has already forgotten.
    ///
    /// The rings are copied through host memory, and two rollouts' memory is allocated during the call: call it rarely, as once in
    /// many seconds.
    ///
    /// # Errors
    /// `InvalidArgument` for a world of another bundle or precision; otherwise as [`Rollout::new`], and `Device` when the memory
    /// cannot be read. The rollout is unchanged then.
    pub fn move_to(&mut self, world: &Arc<World>) -> Result<()> {
        let refuse = |cause: &str| Err(Error::new(ErrorKind::InvalidArgument, cause).field("world"));
        if world.digest() != self.world.digest() {
            return refuse("it is another bundle's");
        }
        if world.precision() != self.world.precision() {
            return refuse("it computes in another precision");
        }
        let point = OperatingPoint { global_window: world.global_window(), ..self.point.clone() };
        let freed = self.world.need_of_rollout();
        let mut moved = Self::with_stop(world, &point, self.planner.seed(), self.stop_flag().clone(), freed)?;
        moved.keep_encoder_stream(self.keeps_encoder_stream())?;
        let slots = moved.planner.take_over(&self.planner);
        let mut contents = Vec::new();
        for (to, from) in moved.state_buffers().zip(self.state_buffers()) {
            let mut bytes = super::convert::zeroed(self.context.size(from))?;
            self.context.read(from, 0, &mut bytes)?;
            if self.is_global_ring(from) {
                let mut other = super::convert::zeroed(moved.context.size(to))?;
                self.world.shapes.move_slots(self.world.precision(), &bytes, &mut other, &slots);
                bytes = other;
            }
            contents.push((to, bytes));
        }
        let contents: Vec<_> = contents.iter().map(|(to, bytes)| (*to, bytes.as_slice())).collect();
        moved.context.replace(&contents)?;
        moved.continue_statistics(self);
        (moved.budget, moved.governed) = (self.budget.take(), self.governed.take());
        *self = moved;
        Ok(())
    }

    fn is_global_ring(&self, buffer: BufferId) -> bool {
        let geometry = &self.world.manifest().geometry;
        let mut global = (0..geometry.layers).filter(|layer| geometry.is_global(*layer));
        global.any(|layer| {
            [Part::Keys, Part::Values].iter().any(|part| self.kv.ring(layer as usize, *part) == Some(buffer))
        })
    }
}

impl Ring {
    /// Takes over the contents of `other`, a ring of another size after `commits` commits: the newest latents that fit. Returns
    /// pairs of slots, in `other` and in this ring, whose contents must be copied.
    pub(super) fn take_over(&mut self, other: &Ring, commits: u64) -> Vec<(usize, usize)> {
        self.clear();
        let Some(last) = commits.checked_sub(1).map(|last| last / u64::from(self.dilation())) else {
            return Vec::new();
        };
        let (from, to) = (other.buckets() as u64, self.buckets() as u64);
        let first = (last + 1).saturating_sub(from.min(to));
        let held = (first..=last).map(|bucket| ((bucket % from) as usize, (bucket % to) as usize));
        let moved: Vec<_> = held.filter(|(slot, _)| other.written()[*slot]).collect();
        let mut written = vec![false; self.buckets()];
        moved.iter().for_each(|(_, slot)| written[*slot] = true);
        self.set_written(&written);
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring after `commits` commits, and the ring clock stored in each slot.
    fn filled(buckets: u32, dilation: u32, commits: u64) -> (Ring, Vec<Option<u64>>) {
        let mut ring = Ring::new(buckets, dilation).expect("a ring");
        let mut held = vec![None; buckets as usize];
        for t in 0..commits {
            if let Some(slot) = ring.commit(t) {
                held[slot] = Some(t);
            }
        }
        (ring, held)
    }

    #[test]
    fn what_was_moved_lies_where_a_ring_of_that_size_would_have_it() {
        for (from, to, dilation) in [(6, 3, 1), (6, 3, 4), (3, 6, 4), (5, 4, 3), (4, 4, 2), (8, 1, 8), (1, 8, 8)] {
            for commits in 0..120 {
                let (ring, held) = filled(from, dilation, commits);
                let (expected, held_there) = filled(to, dilation, commits);
                let mut moved = Ring::new(to, dilation).expect("a ring");
                let slots = moved.take_over(&ring, commits);
                let mut lies = vec![None; to as usize];
                slots.iter().for_each(|(there, here)| lies[*here] = held[*there]);
                let newest: Vec<_> = held_there.iter().filter(|t| held.contains(t)).collect();
                let name = format!("{from} to {to} slots, {commits} commits of {dilation}");
                // A longer ring lacks only the latents that the shorter one had forgotten.
                let expected_there = held_there.iter().map(|t| t.filter(|t| held.contains(&Some(*t))));
                assert_eq!(lies, expected_there.collect::<Vec<_>>(), "{name}: {newest:?}");
                for (slot, t) in lies.iter().enumerate() {
                    assert_eq!(moved.written()[slot], t.is_some(), "{name}");
                    assert!(t.is_none() || expected.sees(commits, slot) == moved.sees(commits, slot), "{name}");
                }
            }
        }
    }
}
