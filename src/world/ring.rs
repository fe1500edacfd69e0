//! The KV ring of one kind of layer: which slot a latent goes to, and which slots a pass may see.
//!
//! The rules are Waypoint-1.5's. With ring clock t, dilation d and B buckets:
//!
//! ```text
//! bucket(t)     = ceil(t / d)
//! slot(t)       = bucket(t) mod B
//! write_step(t) = t mod d == 0
//! visible(t)    = written, less slot(t) on a write step: the slot that will be overwritten is hidden already
//! ```
//!
//! The latent being made is always visible to itself and is not part of the ring.

use crate::{Error, ErrorKind, Result};

/// Maximum number of buckets of a ring.
pub const MAX_BUCKETS: u32 = 65_536;

/// Written flags and slot arithmetic of one kind of layer. Keys and values stay on the device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ring {
    dilation: u32,
    written: Vec<bool>,
}

impl Ring {
    /// An empty ring of `buckets` slots (1 to [`MAX_BUCKETS`]) that keeps every `dilation`-th latent (at least 1).
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside those ranges.
    pub fn new(buckets: u32, dilation: u32) -> Result<Self> {
        if buckets == 0 || buckets > MAX_BUCKETS || dilation == 0 {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a ring of {buckets} buckets with dilation {dilation} cannot be made"),
            )
            .field("geometry")
            .remedy(format!("Use 1 to {MAX_BUCKETS} buckets and a dilation of at least 1")));
        }
        Ok(Self { dilation, written: vec![false; buckets as usize] })
    }

    /// Number of slots.
    pub fn buckets(&self) -> usize {
        self.written.len()
    }

    /// Latents per bucket.
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

    /// Whether a commit at ring clock `t` is kept.
    pub fn write_step(&self, t: u64) -> bool {
        t.is_multiple_of(u64::from(self.dilation))
    }

    /// Whether every pass at ring clock `t`, frozen or not, sees slot `slot`.
    pub fn sees(&self, t: u64, slot: usize) -> bool {
        self.written.get(slot).is_some_and(|written| *written) && !(self.write_step(t) && slot == self.slot(t))
    }

    /// Which slots every pass at ring clock `t` sees.
    pub fn visible(&self, t: u64) -> Vec<bool> {
        (0..self.buckets()).map(|slot| self.sees(t, slot)).collect()
    }

    /// Commits at ring clock `t`; returns the written slot if `t` is a write step.
    pub fn commit(&mut self, t: u64) -> Option<usize> {
        let slot = self.write_step(t).then(|| self.slot(t))?;
        self.written[slot] = true;
        Some(slot)
    }

    /// Marks all slots as not written.
    pub fn clear(&mut self) {
        self.written.fill(false);
    }

    /// Marks `slot` as written. An executed plan sets the flags by its own slots, whoever made it.
    pub(crate) fn mark(&mut self, slot: usize) -> Result<()> {
        let buckets = self.buckets();
        match self.written.get_mut(slot) {
            Some(written) => {
                *written = true;
                Ok(())
            }
            None => Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("slot {slot} does not exist in a ring of {buckets}"),
            )
            .field("plan.slot")),
        }
    }

    /// Replaces all flags; `flags` has one for each slot.
    pub(crate) fn set_written(&mut self, flags: &[bool]) {
        self.written.copy_from_slice(flags);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference: a list of the kept frames, oldest first, instead of slots.
    struct Frames {
        buckets: usize,
        dilation: u64,
        kept: Vec<u64>,
    }

    impl Frames {
        /// The frames a pass at `t` may see: the newest, one fewer on a step that will evict.
        fn visible(&self, t: u64) -> Vec<u64> {
            let many = if t.is_multiple_of(self.dilation) { self.buckets - 1 } else { self.buckets };
            self.kept[self.kept.len().saturating_sub(many)..].to_vec()
        }

        fn commit(&mut self, t: u64) {
            if t.is_multiple_of(self.dilation) {
                self.kept.push(t);
            }
        }
    }

    #[test]
    fn slots_hold_the_frames_of_the_list_over_many_wraps() {
        for (buckets, dilation) in [(16, 1), (16, 8), (4, 1), (4, 4), (14, 8), (48, 8), (64, 8), (1, 1), (1, 3), (5, 7)]
        {
            let mut ring = Ring::new(buckets, dilation).unwrap();
            let mut frames = Frames { buckets: buckets as usize, dilation: dilation.into(), kept: Vec::new() };
            let mut slots = vec![None; buckets as usize];
            for t in 0..u64::from(buckets * dilation) * 6 + 3 {
                let seen = ring.visible(t);
                let mut ours: Vec<u64> = (0..seen.len()).filter(|s| seen[*s]).map(|s| slots[s].unwrap()).collect();
                ours.sort_unstable();
                assert_eq!(ours, frames.visible(t), "{buckets} buckets, dilation {dilation}, t {t}");
                let before = ring.clone();
                let written = ring.commit(t);
                assert_eq!(written.is_some(), ring.write_step(t));
                match written {
                    Some(slot) => {
                        assert!(!seen[slot], "a slot about to be overwritten was visible");
                        slots[slot] = Some(t);
                    }
                    None => assert_eq!(ring, before),
                }
                frames.commit(t);
            }
        }
    }

    /// Waypoint-1.5's parameters: 16 local slots, 16 global ones with dilation 8.
    #[test]
    fn warm_rings_see_fifteen_or_sixteen_latents() {
        let (mut local, mut global) = (Ring::new(16, 1).unwrap(), Ring::new(16, 8).unwrap());
        for t in 0..1000 {
            let count = |ring: &Ring| ring.visible(t).iter().filter(|seen| **seen).count() as u64;
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
        for (buckets, dilation) in [(0, 1), (1, 0), (MAX_BUCKETS + 1, 1), (u32::MAX, u32::MAX)] {
            assert_eq!(Ring::new(buckets, dilation).unwrap_err().kind(), ErrorKind::InvalidArgument);
        }
        let mut ring = Ring::new(4, 1).unwrap();
        assert!(ring.mark(4).is_err() && !ring.sees(1, 4));
        ring.mark(3).unwrap();
        assert_eq!(ring.written(), [false, false, false, true]);
        ring.clear();
        assert_eq!(ring, Ring::new(4, 1).unwrap());
    }
}
