//! The KV ring of one kind of layer: which slot a latent goes to, and which slots a pass may see.
//!
//! The rules are Waypoint-1.5's. With ring clock t, dilation d and B buckets:
//!
//! ```text
//! bucket(t)     = ceil(t / d)
//! slot(t)       = bucket(t) mod B
//! write_step(t) = t mod d == 0
//! visible(t)    = written, less slot(t) on a write step: what is about to be evicted is hidden already
//! ```
//!
//! The latent being made is always visible to itself and stands outside the ring.

use crate::{Error, ErrorKind, Result};

/// The most buckets a ring may have.
pub const MAX_BUCKETS: u32 = 65_536;

/// Written flags and arithmetic of one kind of layer. It holds no keys and values; those stay on the device.
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

    /// Slots.
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

    /// The slot of ring clock `t`: where it is written on a write step.
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

    /// What every pass at ring clock `t` sees, slot by slot.
    pub fn visible(&self, t: u64) -> Vec<bool> {
        (0..self.buckets()).map(|slot| self.sees(t, slot)).collect()
    }

    /// Commits at ring clock `t`; the slot that was written, if `t` is a write step.
    pub fn commit(&mut self, t: u64) -> Option<usize> {
        let slot = self.write_step(t).then(|| self.slot(t))?;
        self.written[slot] = true;
        Some(slot)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.written.fill(false);
    }

    /// Marks `slot` as written: what a plan did is what the flags say, whoever wrote the plan.
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
