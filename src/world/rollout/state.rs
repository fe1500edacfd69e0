//! Saves a rollout's complete state as bytes and restores it.
//!
//! ```text
//! 8 bytes   "CairnRol"
//! u32       version, 1
//! u32       length of the head
//! head      JSON: the bundle's digest, precision, operating point and seed
//! u32       length of the planner's state, and the state
//! payload   rings (K, V of layer 0, of layer 1, ...), last latent, decoder memories, decoded pictures, and the encoder's
//!           memories where its stream is kept: the device's bytes, sizes as the bundle's geometry has them
//! 32 bytes  SHA-256 of all before
//! ```
//!
//! All numbers are little-endian. A restored state continues bit for bit on the same kind of device, in any process.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::Rollout;
use super::limits::Limits;
use crate::allocate;
use crate::error::printable;
use crate::runtime::all_finite;
use crate::world::operating_point::OperatingPoint;
use crate::world::plan::Planner;
use crate::{Error, ErrorKind, Result};

const MAGIC: &[u8; 8] = b"CairnRol";
const VERSION: u32 = 1;
const CHECKSUM: usize = 32;

/// The world and settings that a state belongs to.
#[derive(Serialize, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Head {
    bundle: String,
    precision: String,
    operating_point: String,
    seed: u64,
    /// Whether the encoder's stream is kept. Older states lack this member, which means false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    encoder_stream: bool,
}

impl Rollout {
    /// The complete state: rings, clocks, flags, seed, operating point, decoder memories, last latent and its pictures. Waits for
    /// the device.
    ///
    /// # Errors
    /// `OutOfMemory` when the copy does not fit; `Device` when the device cannot be read.
    pub fn save(&self) -> Result<Vec<u8>> {
        self.device.check_restored()?;
        let (head, planner) = self.head_and_planner()?;
        let len = self.len_with(&head, &planner);
        let mut out = Vec::new();
        allocate::reserve(&mut out, len)?;
        out.extend_from_slice(MAGIC);
        out.extend_from_slice(&VERSION.to_le_bytes());
        for part in [&head, &planner] {
            out.extend_from_slice(&(part.len() as u32).to_le_bytes());
            out.extend_from_slice(part);
        }
        for buffer in self.device.state_buffers() {
            let start = out.len();
            out.resize(start + self.device.context.size(buffer), 0);
            self.device.context.read(buffer, 0, &mut out[start..])?;
        }
        let checksum = Sha256::digest(&out);
        out.extend_from_slice(&checksum);
        Ok(out)
    }

    /// Size in bytes of a state that [`save`](Self::save) makes now. It depends only on the world, the operating point, the seed
    /// and whether the encoder's stream is kept.
    ///
    /// # Errors
    /// None that a caller can cause.
    pub fn state_len(&self) -> Result<usize> {
        let (head, planner) = self.head_and_planner()?;
        Ok(self.len_with(&head, &planner))
    }

    /// The encoded head and the planner's state.
    fn head_and_planner(&self) -> Result<(Vec<u8>, Vec<u8>)> {
        let head =
            serde_json::to_vec(&self.head()).map_err(|e| damaged(&format!("the head cannot be written: {e}")))?;
        Ok((head, self.planner.save()))
    }

    fn len_with(&self, head: &[u8], planner: &[u8]) -> usize {
        MAGIC.len() + 12 + head.len() + planner.len() + self.payload_len() + CHECKSUM
    }

    fn payload_len(&self) -> usize {
        self.device.state_buffers().map(|buffer| self.device.context.size(buffer)).sum()
    }

    /// Restores a state that [`save`](Self::save) made in a rollout of the same bundle, precision and global window, in this
    /// process or another. The operating point and the seed become the state's. All later results are bit for bit those of the
    /// saved rollout.
    ///
    /// # Errors
    /// `Unsupported` for a state of another version; `InvalidState` when it is damaged, belongs to another bundle, precision or
    /// global window, or holds a value that is not finite. The rollout is unchanged then.
    pub fn restore(&mut self, state: &[u8]) -> Result<()> {
        let (head, planner_state, payload) = split(state)?;
        let head: Head = serde_json::from_slice(head)
            .map_err(|e| damaged(&format!("its head is not valid: {}", printable(&e.to_string()))))?;
        let own = self.head();
        for (field, found, expected) in
            [("bundle", &head.bundle, &own.bundle), ("precision", &head.precision, &own.precision)]
        {
            if found != expected {
                return Err(mismatch(field, &format!("the state is of {field} {found:?}, this world of {expected:?}")));
            }
        }
        if head.encoder_stream != own.encoder_stream {
            let describe =
                |kept: bool| if kept { "keeps the encoder's stream" } else { "does not keep the encoder's stream" };
            let why = format!(
                "the rollout of the state {}, this one {}",
                describe(head.encoder_stream),
                describe(own.encoder_stream)
            );
            return Err(mismatch("encoder_stream", &why));
        }
        let point: OperatingPoint =
            head.operating_point.parse().map_err(|e: Error| damaged(&format!("its operating point: {e}")))?;
        self.world.check_point(&point).map_err(|e| mismatch("operating_point", &e.to_string()))?;
        let mut planner = Planner::new(self.world.manifest(), &point, head.seed)
            .map_err(|e| mismatch("operating_point", &e.to_string()))?;
        planner.restore(planner_state)?;
        let expected = self.payload_len();
        if payload.len() != expected {
            return Err(damaged(&format!("it holds {} bytes of memory, this world has {expected}", payload.len())));
        }
        if !all_finite(payload, self.world.precision()) {
            return Err(damaged("it holds a number that is not finite"));
        }
        // The state is valid from here on.
        let mut rest = payload;
        let of_buffer = |buffer| {
            let (bytes, tail) = rest.split_at(self.device.context.size(buffer));
            rest = tail;
            (buffer, bytes)
        };
        let contents: Vec<_> = self.device.state_buffers().map(of_buffer).collect();
        self.device.context.replace(&contents)?;
        self.planner = planner;
        self.point = point;
        self.limits = Limits::None;
        self.readback.forget_latent();
        Ok(())
    }

    fn head(&self) -> Head {
        Head {
            bundle: self.world.digest().to_owned(),
            precision: format!("{:?}", self.world.precision()).to_lowercase(),
            operating_point: self.point.to_string(),
            seed: self.planner.seed(),
            encoder_stream: self.device.keeps_encoder_stream(),
        }
    }
}

/// Checks magic, version, checksum and lengths. Returns head, planner's state and payload.
fn split(state: &[u8]) -> Result<(&[u8], &[u8], &[u8])> {
    let short = || damaged("it ends too early");
    let (magic, rest) = state.split_first_chunk::<8>().ok_or_else(short)?;
    if magic != MAGIC {
        return Err(damaged("these bytes are no state of a rollout"));
    }
    let (version, rest) = rest.split_first_chunk::<4>().ok_or_else(short)?;
    let version = u32::from_le_bytes(*version);
    if version != VERSION {
        return Err(Error::new(
            ErrorKind::Unsupported,
            format!("the state has version {version}, this library reads version {VERSION}"),
        )
        .field("state.version")
        .remedy("Use the version of the library that saved it"));
    }
    let body = rest.len().checked_sub(CHECKSUM).ok_or_else(short)?;
    let (rest, checksum) = rest.split_at(body);
    if Sha256::digest(&state[..state.len() - CHECKSUM]).as_slice() != checksum {
        return Err(damaged("its checksum is wrong: it was cut short or changed"));
    }
    let (head, rest) = split_part(rest).ok_or_else(short)?;
    let (planner, payload) = split_part(rest).ok_or_else(short)?;
    Ok((head, planner, payload))
}

/// Splits off a part that is preceded by its length. Returns the part and the bytes after it.
fn split_part(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (len, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(u32::from_le_bytes(*len) as usize)
}

fn damaged(why: &str) -> Error {
    Error::new(ErrorKind::InvalidState, format!("the saved state cannot be used: {why}"))
        .field("state")
        .remedy("Use a state as it was saved")
}

fn mismatch(field: &str, why: &str) -> Error {
    Error::new(ErrorKind::InvalidState, why.to_owned())
        .field(format!("state.{field}"))
        .remedy("Restore into a rollout of the world that saved it")
}
