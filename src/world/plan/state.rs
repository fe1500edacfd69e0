//! Saves a planner as bytes and restores it: clocks and ring flags, and the settings that they belong to.
//!
//! ```text
//! 8 bytes   "CairnPln"
//! u32       version, 1
//! u64       seed
//! u32 x 5   cache mode (0 separate, 1 fused, 2 interval, 3 joined), k or 0, RoPE time multiplier, dilation, denoise passes
//! f32       n + 1 noise levels
//! u64 x 3   latents, generated latents, commits
//! 2 x       u32 slots, then one byte for each slot: 0 or 1 (local, then global)
//! joined    one byte, 1 if the last latent's commit is pending, else 0; then f32 x the world's controls: that latent's, or 0
//! ```
//!
//! All numbers are little-endian.

use super::{Clocks, Planner};
use crate::world::operating_point::CacheMode;
use crate::world::ring::Ring;
use crate::{Error, ErrorKind, Result};

const MAGIC: &[u8; 8] = b"CairnPln";
const VERSION: u32 = 1;

impl Planner {
    /// The state as bytes, for [`Planner::restore`] of an equal planner.
    pub fn save(&self) -> Vec<u8> {
        let mut out = self.identity();
        let Clocks { latents, generated, commits } = self.clocks;
        for clock in [latents, generated, commits] {
            out.extend_from_slice(&clock.to_le_bytes());
        }
        for ring in [&self.local, &self.global] {
            out.extend_from_slice(&(ring.slot_count() as u32).to_le_bytes());
            out.extend(ring.written().iter().map(|written| u8::from(*written)));
        }
        if self.cache_mode == CacheMode::Joined {
            out.push(u8::from(self.pending.is_some()));
            let idle = vec![0.0; self.controls.len()];
            out.extend(self.pending.as_ref().unwrap_or(&idle).iter().flat_map(|number| number.to_le_bytes()));
        }
        out
    }

    /// Restores a state that [`Planner::save`] made. The planner must have been made for the same world, operating point and seed.
    ///
    /// # Errors
    /// `Unsupported` for a state of another version; `InvalidState` when it is damaged, too short or too long, belongs
    /// to another planner, or its clocks and flags contradict each other. The planner is unchanged then.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<()> {
        let mut rest = bytes;
        let magic: [u8; 8] = read_array(&mut rest)?;
        if &magic != MAGIC {
            return Err(invalid("the bytes are no state of a planner"));
        }
        let version = u32::from_le_bytes(read_array(&mut rest)?);
        if version != VERSION {
            return Err(Error::new(
                ErrorKind::Unsupported,
                format!("the state has version {version}, this library reads version {VERSION}"),
            )
            .field("state.planner")
            .remedy("Use the version of the library that saved it"));
        }
        let identity = self.identity();
        if bytes.get(..identity.len()) != Some(&identity[..]) {
            return Err(invalid("the state belongs to another seed or operating point"));
        }
        rest = &bytes[identity.len()..];
        let mut clock = || Ok(u64::from_le_bytes(read_array(&mut rest)?));
        let clocks = Clocks { latents: clock()?, generated: clock()?, commits: clock()? };
        let local = read_flags(&mut rest, &self.local)?;
        let global = read_flags(&mut rest, &self.global)?;
        let pending = if self.cache_mode == CacheMode::Joined { self.read_pending(&mut rest)? } else { None };
        if !rest.is_empty() {
            return Err(invalid("bytes follow the end of the state"));
        }
        let appended = clocks.latents.checked_sub(clocks.generated);
        // A pending commit counts, too.
        let commits = clocks.commits.checked_add(u64::from(pending.is_some()));
        let contradicts = |appended| commits.is_none_or(|commits| commits < appended || commits > clocks.latents);
        if appended.is_none_or(contradicts) {
            return Err(invalid("the clocks contradict each other"));
        }
        for flags in [&local, &global] {
            let written = flags.iter().filter(|written| **written).count() as u64;
            if written > clocks.commits {
                return Err(invalid("more slots are written than latents were committed"));
            }
        }
        self.clocks = clocks;
        self.local.set_written(&local);
        self.global.set_written(&global);
        self.pending = pending;
        Ok(())
    }

    /// The controls of a latent whose commit is pending, if one is.
    fn read_pending(&self, rest: &mut &[u8]) -> Result<Option<Vec<f32>>> {
        let [is_pending] = read_array(rest)?;
        let controls = (0..self.controls.len())
            .map(|_| Ok(f32::from_le_bytes(read_array(rest)?)))
            .collect::<Result<Vec<f32>>>()?;
        match is_pending {
            0 if controls.iter().all(|&number| number == 0.0) => Ok(None),
            1 if controls.iter().all(|number| number.is_finite()) => Ok(Some(controls)),
            _ => Err(invalid("a pending commit's mark or its controls are wrong")),
        }
    }

    /// The first bytes of a state: the settings that must be equal in the planner that restores it.
    fn identity(&self) -> Vec<u8> {
        let (mode, k) = match self.cache_mode {
            CacheMode::Separate => (0, 0),
            CacheMode::Fused => (1, 0),
            CacheMode::Interval(k) => (2, k),
            CacheMode::Joined => (3, 0),
        };
        let table = &self.table;
        let mut out = MAGIC.to_vec();
        out.extend_from_slice(&VERSION.to_le_bytes());
        out.extend_from_slice(&self.seed.to_le_bytes());
        for number in [mode, k, self.time_multiplier, self.global.dilation(), table.passes() as u32] {
            out.extend_from_slice(&number.to_le_bytes());
        }
        out.extend(table.sigmas.iter().flat_map(|sigma| sigma.to_le_bytes()));
        out
    }
}

fn read_array<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N]> {
    let (head, tail) = rest.split_first_chunk::<N>().ok_or_else(|| invalid("the state ends too early"))?;
    *rest = tail;
    Ok(*head)
}

fn read_flags(rest: &mut &[u8], ring: &Ring) -> Result<Vec<bool>> {
    let slots = u32::from_le_bytes(read_array(rest)?);
    if slots as usize != ring.slot_count() {
        return Err(invalid("the state belongs to another context window"));
    }
    let (head, tail) = rest.split_at_checked(ring.slot_count()).ok_or_else(|| invalid("the state ends too early"))?;
    *rest = tail;
    head.iter()
        .map(|byte| match byte {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(invalid("a slot's flag is neither 0 nor 1")),
        })
        .collect()
}

fn invalid(cause: &str) -> Error {
    Error::new(ErrorKind::InvalidState, cause)
        .field("state.planner")
        .remedy("Restore a state that was saved by the same world, operating point and seed")
}
