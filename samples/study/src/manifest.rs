//! `manifest.json`: what went in, what came out, and what is needed to make it again.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use cairn::{Error, ErrorKind, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::machine::Versions;
use crate::media::describe_io;
use crate::settings::Settings;

/// The version this program writes, and the newest it reads.
pub const MANIFEST_VERSION: u32 = 1;
/// The longest manifest, in bytes: a day of PNG frames fits.
const MAX_BYTES: u64 = 1 << 30;

/// A whole manifest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`MANIFEST_VERSION`].
    pub manifest_version: u32,
    /// The rollout went to its end and every file is whole.
    pub complete: bool,
    /// Why not, where it did not.
    pub stopped_by: Option<String>,
    /// What a reader should know, e.g. that the weights are random.
    pub note: Option<String>,
    /// What to do.
    pub settings: Settings,
    /// With what.
    pub inputs: Inputs,
    /// How many of what were made.
    pub counts: Counts,
    /// Every file beside this one.
    pub outputs: Vec<Output>,
    /// By what.
    pub versions: Versions,
    /// How long it took, in seconds. Nothing else depends on the clock.
    pub timings: std::collections::BTreeMap<String, f64>,
}

/// All inputs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    /// The bundle; its checksum is that of its manifest, which holds those of its files.
    pub world: Input,
    /// The picture the rollout starts from.
    pub seed_picture: Input,
    /// The controls.
    pub script: Input,
    /// The latents, where they are not made anew.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latents: Option<Input>,
    /// The ONNX Runtime library.
    pub onnxruntime: Input,
}

/// One input.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// Its absolute path, or a name in angle brackets for what is part of this program.
    pub path: String,
    /// Bytes.
    pub size: u64,
    /// 64 hex digits.
    pub sha256: String,
}

/// How many were made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Latents, the seed's own included.
    pub latents: u64,
    /// Passes of the transformer.
    pub passes: u64,
    /// Decoded pictures that were used.
    pub anchors: u64,
    /// Frames generated between anchors.
    pub generated: u64,
    /// Of these, how many show the nearer anchor unchanged, because a cut lies between the two.
    pub cut_fallbacks: u64,
    /// Frames presented, all kinds.
    pub presented: u64,
    /// Frames that were asked for.
    pub planned: u64,
}

/// One file that was made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Output {
    /// Beside the manifest, with `/`.
    pub path: String,
    /// `mp4`, `png`, `y4m`, `latents` or `contact-sheet`.
    pub kind: String,
    /// Frames or latents in it.
    pub frames: u64,
    /// Whether it holds everything presented.
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
    /// `Io`; `Unsupported` for a newer version; `InvalidArgument` when it is no manifest.
    pub fn read(path: &Path) -> Result<Self> {
        read_manifest(path, "a rollout", "study rollout")
    }
}

/// Whether the manifest at `path` names a job: that of a rollout names none.
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

/// Reads a manifest of `what`, which the command `writer` makes.
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

/// A manifest as JSON for people.
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

/// A whole file of at most `limit` bytes.
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
