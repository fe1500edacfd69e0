//! The KV ring of one kind of layer: the slot that a latent is written to, and the slots that are visible to a pass.
//!
//! The rules are Waypoint-1.5's. With ring clock t, dilation d and S slots:
//!
//! ```text
//! bucket(t)     = ceil(t / d)
//! slot(t)       = bucket(t) mod S
//! write_step(t) = t mod d == 0
//! visible(t)    = the written slots, without slot(t) on a write step, because that slot is about to be overwritten
//! ```
//!
//! The latent that a step makes is always visible to itself and is not part of the ring.

use crate::{Error, ErrorKind, Result};

/// Maximum number of slots of a ring.
pub const MAX_SLOTS: u32 = 65_536;

/// Written flags and slot arithmetic of one kind of layer. Keys and values stay on the device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ring {
    dilation: u32,
    written: Vec<bool>,
}

impl Ring {
    /// An empty ring of `slots` slots (1 to [`MAX_SLOTS`]) that keeps every `dilation`-th latent (at least 1).
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside those ranges.
    pub fn new(slots: u32, dilation: u32) -> Result<Self> {
        if slots == 0 || slots > MAX_SLOTS || dilation == 0 {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a ring of {slots} slots with dilation {dilation} cannot be made"),
            )
            .field("geometry")
            .remedy(format!("Use 1 to {MAX_SLOTS} slots and a dilation of at least 1")));
        }
        Ok(Self { dilation, written: vec![false; slots as usize] })
    }

    /// Number of slots.
    pub fn slot_count(&self) -> usize {
        self.written.len()
    }

    /// Every `dilation`-th latent is kept.
    pub fn dilation(&self) -> u32 {
        self.dilation
    }

    /// The written flag of every slot.
    pub fn written(&self) -> &[bool] {
        &self.written
    }

    /// The slot for ring clock `t`; a write step writes there.
    pub fn slot(&self, t: u64) -> usize {
        // In range: the remainder of a division by the number of slots.
        (t.div_ceil(u64::from(self.dilation)) % self.written.len() as u64) as usize
    }

    /// Whether a commit at ring clock `t` writes a slot.
    pub fn is_write_step(&self, t: u64) -> bool {
        t.is_multiple_of(u64::from(self.dilation))
    }

    /// Whether slot `slot` is visible to all passes at ring clock `t`, frozen or not.
    pub fn is_visible(&self, t: u64, slot: usize) -> bool {
        self.written.get(slot).is_some_and(|written| *written) && !(self.is_write_step(t) && slot == self.slot(t))
    }

    /// For each slot, whether it is visible to all passes at ring clock `t`.
    pub fn visible(&self, t: u64) -> Vec<bool> {
        (0..self.slot_count()).map(|slot| self.is_visible(t, slot)).collect()
    }

    /// Commits at ring clock `t`; returns the written slot if `t` is a write step.
    pub fn commit(&mut self, t: u64) -> Option<usize> {
        let slot = self.is_write_step(t).then(|| self.slot(t))?;
        self.written[slot] = true;
        Some(slot)
    }

    /// Marks all slots as not written.
    pub fn clear(&mut self) {
        self.written.fill(false);
    }

    /// Marks `slot` as written. The slot comes from the plan that was executed, which need not be the planner's own.
    pub(crate) fn mark_written(&mut self, slot: usize) -> Result<()> {
        let slots = self.slot_count();
        match self.written.get_mut(slot) {
            Some(written) => {
                *written = true;
                Ok(())
            }
            None => {
                Err(Error::new(ErrorKind::InvalidArgument, format!("slot {slot} does not exist in a ring of {slots}"))
                    .field("plan.slot"))
            }
        }
    }

    /// Replaces all flags; `flags` has one for each slot.
    pub(crate) fn set_written(&mut self, flags: &[bool]) {
        self.written.copy_from_slice(flags);
    }

    /// Takes over the flags of `other`, a ring of another size after `commits` commits, for the newest latents that fit. Returns pairs
    /// of slots, in `other` and in this ring, whose contents must be copied.
    pub(super) fn take_over(&mut self, other: &Ring, commits: u64) -> Vec<(usize, usize)> {
        self.clear();
        let Some(last) = commits.checked_sub(1).map(|last| last / u64::from(self.dilation())) else {
            return Vec::new();
        };
        let (from, to) = (other.slot_count() as u64, self.slot_count() as u64);
        let first = (last + 1).saturating_sub(from.min(to));
        let kept = (first..=last).map(|bucket| ((bucket % from) as usize, (bucket % to) as usize));
        let moved: Vec<_> = kept.filter(|(slot, _)| other.written()[*slot]).collect();
        let mut written = vec![false; self.slot_count()];
        moved.iter().for_each(|(_, slot)| written[*slot] = true);
        self.set_written(&written);
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A second implementation: a list of the kept latents, oldest first, instead of slots.
    struct LatentList {
        buckets: usize,
        dilation: u64,
        kept: Vec<u64>,
    }

    impl LatentList {
        /// The latents visible at `t`: the newest, one fewer on a write step.
        fn visible(&self, t: u64) -> Vec<u64> {
            let count = if t.is_multiple_of(self.dilation) { self.buckets - 1 } else { self.buckets };
            self.kept[self.kept.len().saturating_sub(count)..].to_vec()
        }

        fn commit(&mut self, t: u64) {
            if t.is_multiple_of(self.dilation) {
                self.kept.push(t);
            }
        }
    }

    #[test]
    fn slots_hold_the_latents_of_the_list_over_many_wraps() {
        for (buckets, dilation) in [(16, 1), (16, 8), (4, 1), (4, 4), (14, 8), (48, 8), (64, 8), (1, 1), (1, 3), (5, 7)]
        {
            let mut ring = Ring::new(buckets, dilation).unwrap();
            let mut latents = LatentList { buckets: buckets as usize, dilation: dilation.into(), kept: Vec::new() };
            let mut slots = vec![None; buckets as usize];
            for t in 0..u64::from(buckets * dilation) * 6 + 3 {
                let visible = ring.visible(t);
                let mut found: Vec<u64> =
                    (0..visible.len()).filter(|s| visible[*s]).map(|s| slots[s].unwrap()).collect();
                found.sort_unstable();
                assert_eq!(found, latents.visible(t), "{buckets} buckets, dilation {dilation}, t {t}");
                let before = ring.clone();
                let written = ring.commit(t);
                assert_eq!(written.is_some(), ring.is_write_step(t));
                match written {
                    Some(slot) => {
                        assert!(!visible[slot], "a slot about to be overwritten was visible");
                        slots[slot] = Some(t);
                    }
                    None => assert_eq!(ring, before),
                }
                latents.commit(t);
            }
        }
    }

    /// Waypoint-1.5's parameters: 16 local slots, 16 global ones with dilation 8.
    #[test]
    fn full_rings_show_fifteen_or_sixteen_latents() {
        let (mut local, mut global) = (Ring::new(16, 1).unwrap(), Ring::new(16, 8).unwrap());
        for t in 0..1000 {
            let count = |ring: &Ring| ring.visible(t).iter().filter(|visible| **visible).count() as u64;
            assert_eq!(count(&local), t.min(15));
            let kept = t.div_ceil(8);
            assert_eq!(count(&global), if t % 8 == 0 { kept.min(15) } else { kept.min(16) });
            local.commit(t);
            global.commit(t);
        }
    }

    #[test]
    fn buckets_are_rounded_up() {
        let ring = Ring::new(16, 8).unwrap();
        let expected = [(0, 0), (1, 1), (7, 1), (8, 1), (9, 2), (120, 15), (121, 0), (128, 0), (129, 1)];
        for (t, slot) in expected {
            assert_eq!(ring.slot(t), slot, "t {t}");
        }
        assert!(ring.slot(u64::MAX) < 16);
    }

    #[test]
    fn impossible_rings_are_refused() {
        for (buckets, dilation) in [(0, 1), (1, 0), (MAX_SLOTS + 1, 1), (u32::MAX, u32::MAX)] {
            assert_eq!(Ring::new(buckets, dilation).unwrap_err().kind(), ErrorKind::InvalidArgument);
        }
        let mut ring = Ring::new(4, 1).unwrap();
        assert!(ring.mark_written(4).is_err() && !ring.is_visible(1, 4));
        ring.mark_written(3).unwrap();
        assert_eq!(ring.written(), [false, false, false, true]);
        ring.clear();
        assert_eq!(ring, Ring::new(4, 1).unwrap());
    }

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
    fn a_ring_that_takes_over_equals_one_that_had_its_size_from_the_start() {
        for (from, to, dilation) in [(6, 3, 1), (6, 3, 4), (3, 6, 4), (5, 4, 3), (4, 4, 2), (8, 1, 8), (1, 8, 8)] {
            for commits in 0..120 {
                let (ring, held) = filled(from, dilation, commits);
                let (expected, expected_held) = filled(to, dilation, commits);
                let mut moved = Ring::new(to, dilation).expect("a ring");
                let slots = moved.take_over(&ring, commits);
                let mut found = vec![None; to as usize];
                slots.iter().for_each(|(source, destination)| found[*destination] = held[*source]);
                let newest: Vec<_> = expected_held.iter().filter(|t| held.contains(t)).collect();
                let name = format!("{from} to {to} slots, {commits} commits of {dilation}");
                // A longer ring lacks only the latents that the shorter one had forgotten.
                let expected_found = expected_held.iter().map(|t| t.filter(|t| held.contains(&Some(*t))));
                assert_eq!(found, expected_found.collect::<Vec<_>>(), "{name}: {newest:?}");
                for (slot, t) in found.iter().enumerate() {
                    assert_eq!(moved.written()[slot], t.is_some(), "{name}");
                    assert!(
                        t.is_none() || expected.is_visible(commits, slot) == moved.is_visible(commits, slot),
                        "{name}"
                    );
                }
            }
        }
    }
}
