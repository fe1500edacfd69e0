//! `manifest.json`: inputs, outputs, and everything needed to make the same files again.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use cairn::{Error, ErrorKind, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::machine::Versions;
use crate::settings::Settings;
use media::describe_io;

/// The version that this program writes, and the newest that it reads.
pub const MANIFEST_VERSION: u32 = 1;
/// Maximum size of a manifest in bytes: enough for a day of PNG frames.
const MAX_BYTES: u64 = 1 << 30;

/// A whole manifest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`MANIFEST_VERSION`].
    pub manifest_version: u32,
    /// Whether the rollout finished and every file is complete.
    pub complete: bool,
    /// Reason, if the rollout did not finish.
    pub stopped_by: Option<String>,
    /// Note for the reader, e.g. that the weights are random.
    pub note: Option<String>,
    /// Settings of the rollout.
    pub settings: Settings,
    /// Input files.
    pub inputs: Inputs,
    /// Counters.
    pub counts: Counts,
    /// Every file beside this one.
    pub outputs: Vec<Output>,
    /// Software and hardware.
    pub versions: Versions,
    /// Durations in seconds. The only part that depends on a clock.
    pub timings: std::collections::BTreeMap<String, f64>,
}

/// All inputs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    /// The bundle. The checksum is that of the bundle's manifest, which has those of its files.
    pub world: Input,
    /// The seed picture.
    pub seed_picture: Input,
    /// The control script.
    pub script: Input,
    /// Stored latents, if none are made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latents: Option<Input>,
    /// The ONNX Runtime library.
    pub onnxruntime: Input,
}

/// One input.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// Absolute path, or a name in angle brackets for an input inside this program.
    pub path: String,
    /// Bytes.
    pub size: u64,
    /// 64 hex digits.
    pub sha256: String,
}

/// Counters of a rollout.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Latents, including the seed's own.
    pub latents: u64,
    /// Passes of the transformer.
    pub passes: u64,
    /// Decoded pictures that were presented.
    pub anchors: u64,
    /// Frames generated between anchors.
    pub generated: u64,
    /// Generated frames that show the nearer anchor because of a cut between the two.
    pub cut_fallbacks: u64,
    /// Frames presented, all kinds.
    pub presented: u64,
    /// Frames that were requested.
    pub planned: u64,
}

/// One file that was made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Output {
    /// Path relative to the manifest, with `/`.
    pub path: String,
    /// `mp4`, `png`, `y4m`, `latents` or `contact-sheet`.
    pub kind: String,
    /// Frames or latents in it.
    pub frames: u64,
    /// Whether it has everything that was presented.
    pub complete: bool,
    /// Bytes.
    pub size: u64,
    /// 64 hex digits.
    pub sha256: String,
}

impl Manifest {
    /// Reads `path`.
    ///
    /// # Errors
    /// `Io`; `Unsupported` for a newer version; `InvalidArgument` for an invalid manifest.
    pub fn read(path: &Path) -> Result<Self> {
        read_manifest(path, "a rollout", "study rollout")
    }
}

/// Job name in the manifest at `path`; `None` for a rollout's manifest, which has none.
///
/// # Errors
/// As [`Manifest::read`].
pub(crate) fn job_of(path: &Path) -> Result<Option<String>> {
    #[derive(Deserialize)]
    struct Head {
        job: Option<String>,
    }
    read_manifest::<Head>(path, "a rollout or a reconstruct", "study").map(|head| head.job)
}

/// Reads a manifest of kind `what`, written by the command `writer`.
///
/// # Errors
/// As [`Manifest::read`].
pub(crate) fn read_manifest<T: DeserializeOwned>(path: &Path, what: &str, writer: &str) -> Result<T> {
    #[derive(Deserialize)]
    struct Version {
        manifest_version: u32,
    }
    let field = || path.display().to_string();
    let bytes = read_bounded(path, MAX_BYTES)?;
    let wrong = |e: serde_json::Error| {
        Error::new(ErrorKind::InvalidArgument, format!("it is no manifest of {what}: {e}"))
            .field(field())
            .remedy(format!("Name the manifest.json that {writer} wrote"))
    };
    let Version { manifest_version } = serde_json::from_slice(&bytes).map_err(wrong)?;
    if manifest_version != MANIFEST_VERSION {
        return Err(Error::new(
            ErrorKind::Unsupported,
            format!("the manifest has version {manifest_version}, this program reads {MANIFEST_VERSION}"),
        )
        .field(field())
        .remedy("Use the version of study that wrote it"));
    }
    serde_json::from_slice(&bytes).map_err(wrong)
}

/// A manifest as indented JSON.
pub(crate) fn to_json(manifest: &impl Serialize) -> Result<Vec<u8>> {
    let mut json = serde_json::to_vec_pretty(manifest)
        .map_err(|e| Error::new(ErrorKind::InvalidArgument, format!("the manifest cannot be written: {e}")))?;
    json.push(b'\n');
    Ok(json)
}

/// SHA-256 of `bytes` as 64 lower-case hex digits.
pub fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(digest: &[u8]) -> String {
    digest.iter().map(|b| format!("{b:02x}")).collect()
}

/// Size and SHA-256 of a file.
pub(crate) fn digest_file(path: &Path) -> Result<(u64, String)> {
    let failed = |e: io::Error| describe_io("cannot be read", path, &e);
    let mut file = File::open(path).map_err(failed)?;
    let (mut hash, mut size, mut part) = (Sha256::new(), 0, vec![0; 1 << 18]);
    loop {
        match file.read(&mut part).map_err(failed)? {
            0 => return Ok((size, hex(&hash.finalize()))),
            n => {
                hash.update(&part[..n]);
                size += n as u64;
            }
        }
    }
}

/// Reads a whole file of at most `limit` bytes.
pub(crate) fn read_bounded(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let failed = |e: io::Error| describe_io("cannot be read", path, &e);
    let file = File::open(path).map_err(failed)?;
    if file.metadata().map_err(failed)?.is_dir() {
        return Err(
            Error::new(ErrorKind::InvalidArgument, "it is a folder, not a file").field(path.display().to_string())
        );
    }
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limit {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("it has more than {limit} bytes"))
            .field(path.display().to_string()));
    }
    Ok(bytes)
}

/// `path` without symbolic links where it exists, else made absolute.
pub(crate) fn absolute(path: &Path) -> PathBuf {
    path.canonicalize().or_else(|_| std::path::absolute(path)).unwrap_or_else(|_| path.to_owned())
}
