//! Finds and reads the inputs of a rollout, and fetches missing ones.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use cairn::bundle::{Bundle, OpenOptions};
use cairn::runtime::Ort;
use cairn::world::ControlScript;
use cairn::{Error, ErrorKind, LibrarySearch, Picture, Result};

use crate::latents::Latents;
use crate::level;
use crate::manifest::{Input, Inputs, absolute, digest_file, read_bounded, sha256};
use crate::metrics::{Lpips, Net};
use crate::picture;
use crate::progress::Progress;
use crate::seed_picture;
use crate::sets;
use crate::settings::Settings;

/// The default script.
const DEMO_SCRIPT: &str = include_str!("../../../samples/scripts/demo.txt");
/// Maximum file size of a seed picture, in bytes.
const MAX_PICTURE: u64 = 512 << 20;
/// The library's own limit on scripts plus one byte, so that the library reports the error.
const MAX_SCRIPT: u64 = (4 << 20) + 1;
/// Maximum file size of latents, in bytes: hours of a large world.
const MAX_LATENTS: u64 = 16 << 30;

/// Replacement paths for a manifest's inputs.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// For the bundle.
    pub world: Option<PathBuf>,
    /// For the seed picture.
    pub seed_picture: Option<PathBuf>,
    /// For the script.
    pub script: Option<PathBuf>,
}

/// All inputs, read and checked, with their descriptions.
pub(crate) struct LoadedInputs {
    pub(crate) bundle: Arc<Bundle>,
    pub(crate) ort: Ort,
    pub(crate) script: ControlScript,
    /// At render size.
    pub(crate) seed: Picture,
    /// Latents to decode, if none are made.
    pub(crate) latents: Option<Latents>,
    pub(crate) inputs: Inputs,
}

/// Reads all inputs, the small ones first, so that mistakes in them are reported before anything is fetched.
pub(crate) fn load(settings: &Settings, progress: &Progress) -> Result<LoadedInputs> {
    let (script_bytes, script_path) = match &settings.script {
        Some(path) => (read_bounded(path, MAX_SCRIPT)?, absolute(path).display().to_string()),
        None => (DEMO_SCRIPT.as_bytes().to_vec(), "<built-in demo script>".into()),
    };
    let script = ControlScript::parse_bytes(&script_bytes).map_err(|e| in_file(&e, "--script", &script_path))?;
    sets::require_unsealed_script(&script, "--script")?;
    let picture = match &settings.seed_picture {
        Some(path) => {
            let bytes = read_bounded(path, MAX_PICTURE)?;
            let name = absolute(path).display().to_string();
            let picture = picture::decode(&bytes).map_err(|e| in_file(&e, "--seed-picture", &name))?;
            Some((picture, describe(name, &bytes)))
        }
        None => None,
    };
    let latents = settings.latents.as_deref().map(stored_latents).transpose()?;
    let (ort, onnxruntime) = onnxruntime(progress)?;
    let (bundle, world) = world(settings.world.as_deref(), progress)?;
    let render = bundle.manifest().picture.render;
    let (seed, seed_picture) = match picture {
        Some((picture, input)) => (picture::cover(&picture, render.into())?, input),
        None => {
            let picture = seed_picture::draw(&level::scene(seed_picture::FAMILY), render[0], render[1])?;
            let input = describe(format!("<level of {}>", seed_picture::FAMILY), picture.rgba());
            (picture, input)
        }
    };
    let script_input = describe(script_path, &script_bytes);
    let (latents, latents_input) = latents.unzip();
    let inputs = Inputs { world, seed_picture, script: script_input, latents: latents_input, onnxruntime };
    Ok(LoadedInputs { bundle, ort, script, seed, latents, inputs })
}

/// The latents of an earlier rollout.
fn stored_latents(path: &Path) -> Result<(Latents, Input)> {
    let bytes = read_bounded(path, MAX_LATENTS)?;
    let name = absolute(path).display().to_string();
    let latents = Latents::parse(&bytes).map_err(|e| in_file(&e, "--latents", &name))?;
    Ok((latents, describe(name, &bytes)))
}

fn describe(path: String, bytes: &[u8]) -> Input {
    Input { path, size: bytes.len() as u64, sha256: sha256(bytes) }
}

/// Adds option and file name in front of an error's position.
fn in_file(error: &Error, option: &str, path: &str) -> Error {
    Error::new(error.kind(), format!("{path}: {error}")).field(option)
}

/// ONNX Runtime; fetched if it is missing and no path is given.
pub(crate) fn onnxruntime(progress: &Progress) -> Result<(Ort, Input)> {
    let explicit = std::env::var_os("CAIRN_ONNXRUNTIME").is_some_and(|v| !v.is_empty());
    let ort = if explicit {
        Ort::find(&LibrarySearch::for_tools())?
    } else {
        Ort::load(&provision::onnxruntime(progress).map_err(|e| not_provided(&e, ErrorKind::RuntimeMissing))?)?
    };
    let (size, sha256) = digest_file(ort.path())?;
    let input = Input { path: ort.path().display().to_string(), size, sha256 };
    Ok((ort, input))
}

/// The world at `path`; without a path, the embedded one.
pub(crate) fn world(path: Option<&Path>, progress: &Progress) -> Result<(Arc<Bundle>, Input)> {
    progress.phase("reading the world");
    let (bundle, path) = match path {
        Some(path) => (Bundle::open(path)?, absolute(path).display().to_string()),
        None => (Bundle::embedded(&OpenOptions::default())?, "embedded".to_owned()),
    };
    let size = bundle.manifest().files.iter().map(|f| f.size).sum();
    let input = Input { path, size, sha256: bundle.digest().to_owned() };
    Ok((bundle, input))
}

/// A network of LPIPS. Missing weights are fetched, but never into a folder that the user named.
pub(crate) fn lpips(net: Net, progress: &Progress) -> Result<Lpips> {
    if std::env::var_os("CAIRN_LPIPS").is_none_or(|folder| folder.is_empty()) {
        provision::lpips_weights(progress).map_err(|e| {
            let remedy = format!("{}, or leave LPIPS out", e.remedy);
            not_provided(&e, ErrorKind::Io).remedy(remedy)
        })?;
    }
    Lpips::find(net)
}

/// Converts a fetch error.
pub(crate) fn not_provided(error: &provision::Error, kind: ErrorKind) -> Error {
    Error::new(kind, error.cause.trim_end_matches(['.', '\n']).to_owned())
        .field(error.wanted.clone())
        .remedy(error.remedy.clone())
}
