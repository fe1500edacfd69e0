//! Decides whether a cell is complete: its manifest matches settings and inputs, and its files match the manifest.

use std::path::Path;

use cairn::{Error, ErrorKind, Result};

use crate::device::DeviceChoice;
use crate::manifest::{Input, Inputs, Manifest};
use crate::output::MANIFEST;
use crate::settings::Settings;

/// State of a cell's folder.
#[derive(Debug)]
pub(crate) enum CellState {
    /// Complete, with the same settings and inputs.
    Complete(Box<Manifest>),
    /// Must be made, with the reason for the terminal.
    Missing(String),
}

/// SHA-256 of every input of a cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Digests {
    pub(crate) world: String,
    pub(crate) seed_picture: String,
    pub(crate) script: String,
    pub(crate) onnxruntime: String,
    /// Of stored latents that are decoded, if none are made.
    pub(crate) latents: Option<String>,
}

impl Digests {
    fn of(inputs: &Inputs) -> Self {
        let sha256 = |input: &Input| input.sha256.clone();
        Self {
            world: sha256(&inputs.world),
            seed_picture: sha256(&inputs.seed_picture),
            script: sha256(&inputs.script),
            onnxruntime: sha256(&inputs.onnxruntime),
            latents: inputs.latents.as_ref().map(sha256),
        }
    }
}

/// Checks whether `folder` holds the complete rollout of `wanted` and `digests`.
///
/// # Errors
/// `Unsupported` for a manifest of a newer version, which is not overwritten; `Io` when a file cannot be read.
pub(crate) fn find_rollout(folder: &Path, wanted: &Settings, digests: &Digests) -> Result<CellState> {
    let missing = |why: &str| Ok(CellState::Missing(why.to_owned()));
    let path = folder.join(MANIFEST);
    if !path.exists() {
        return missing("it was never made");
    }
    let manifest = match Manifest::read(&path) {
        Ok(manifest) => manifest,
        // Manifests are written atomically, so this is a manifest of another kind.
        Err(error) if error.kind() == ErrorKind::InvalidArgument => return missing("its manifest cannot be read"),
        Err(error) => return Err(error),
    };
    if !manifest.complete {
        return missing("it was not finished");
    }
    if !manifest.settings.device.is_what(wanted.device) || comparable(&manifest.settings) != comparable(wanted) {
        return missing("its settings are others");
    }
    if Digests::of(&manifest.inputs) != *digests {
        return missing("it was made from other inputs");
    }
    if manifest.versions.cairn != env!("CARGO_PKG_VERSION") {
        return missing("another version of this program made it");
    }
    for output in &manifest.outputs {
        let size = std::fs::metadata(folder.join(&output.path)).map(|data| data.len());
        if size.ok() != Some(output.size) {
            return missing(&format!("{} is not there, or has another size", output.path));
        }
    }
    Ok(CellState::Complete(Box::new(manifest)))
}

/// Settings without the parts that do not affect a result: preset names, input paths (their checksums are compared), and the requested
/// device (the manifest names the one used).
fn comparable(settings: &Settings) -> Settings {
    Settings {
        world: None,
        seed_picture: None,
        script: None,
        latents: None,
        preset: None,
        device: DeviceChoice::Cpu,
        ..settings.clone()
    }
}

/// Manifest of a cell that was just made.
///
/// # Errors
/// `InvalidState` with the reason if it does not match the request.
pub(crate) fn expect_rollout(name: &str, folder: &Path, wanted: &Settings, digests: &Digests) -> Result<Manifest> {
    match find_rollout(folder, wanted, digests)? {
        CellState::Complete(manifest) => Ok(*manifest),
        CellState::Missing(why) => Err(Error::new(ErrorKind::InvalidState, format!("{name} was made, but {why}"))
            .field(folder.display().to_string())
            .remedy("See that nothing else writes into that folder, and run the command again")),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::compare::branch::Branch;
    use crate::compare::plan::{Cell, tests::settings};
    use crate::generator::GeneratorChoice;
    use crate::machine::Versions;
    use crate::manifest::{Counts, MANIFEST_VERSION, Output, to_json};

    fn digests() -> Digests {
        let [world, seed_picture, script, onnxruntime] = ["w", "p", "s", "o"].map(str::to_owned);
        Digests { world, seed_picture, script, onnxruntime, latents: None }
    }

    fn manifest(wanted: &Settings, digests: &Digests) -> Manifest {
        let input = |sha256: &str| Input { path: "there".into(), size: 1, sha256: sha256.into() };
        Manifest {
            manifest_version: MANIFEST_VERSION,
            complete: true,
            stopped_by: None,
            note: None,
            settings: Settings { preset: Some("coherence".into()), world: Some("elsewhere".into()), ..wanted.clone() },
            inputs: Inputs {
                world: input(&digests.world),
                seed_picture: input(&digests.seed_picture),
                script: input(&digests.script),
                latents: digests.latents.as_deref().map(input),
                onnxruntime: input(&digests.onnxruntime),
            },
            counts: Counts::default(),
            outputs: vec![Output {
                path: "frame.png".into(),
                kind: "png".into(),
                frames: 1,
                complete: true,
                size: 3,
                sha256: "x".into(),
            }],
            versions: Versions::without_world(GeneratorChoice::Cpu),
            timings: BTreeMap::new(),
        }
    }

    #[test]
    fn only_a_whole_cell_of_the_same_making_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let common = settings(folder.path());
        let cell = Cell { scene: common.scenes().next().unwrap(), branch: Branch::Coherence, straight: false };
        let wanted = cell.rollout(&common);
        let path = folder.path();
        let found = |manifest: &Manifest| {
            std::fs::write(path.join(MANIFEST), to_json(manifest).unwrap()).unwrap();
            match find_rollout(path, &wanted, &digests()) {
                Ok(CellState::Complete(found)) if *found == *manifest => "whole".to_owned(),
                Ok(CellState::Missing(why)) => why,
                other => panic!("{other:?}"),
            }
        };
        assert!(
            matches!(find_rollout(path, &wanted, &digests()).unwrap(), CellState::Missing(why) if why.contains("never"))
        );
        let good = manifest(&wanted, &digests());
        assert!(found(&good).contains("frame.png"), "the file is not there yet");
        std::fs::write(path.join("frame.png"), "12").unwrap();
        assert!(found(&good).contains("another size"));
        std::fs::write(path.join("frame.png"), "123").unwrap();
        assert_eq!(found(&good), "whole");

        assert!(found(&Manifest { complete: false, ..good.clone() }).contains("not finished"));
        for other in [
            Settings { seed: 9, ..wanted.clone() },
            Settings { threads: Some(2), ..wanted.clone() },
            Settings { operating_point: Branch::Heavy.point(cell.scene.family).to_string(), ..wanted.clone() },
            Settings { seconds: "2".into(), ..wanted.clone() },
        ] {
            assert!(found(&Manifest { settings: other, ..good.clone() }).contains("settings"));
        }
        let other_script = Digests { script: "t".into(), ..digests() };
        assert!(found(&manifest(&wanted, &other_script)).contains("inputs"));
        let versions = Versions { cairn: "0.0.0".into(), ..good.versions.clone() };
        assert!(found(&Manifest { versions, ..good.clone() }).contains("version"));

        std::fs::write(path.join(MANIFEST), "{ half").unwrap();
        assert!(
            matches!(find_rollout(path, &wanted, &digests()).unwrap(), CellState::Missing(why) if why.contains("read"))
        );
        let newer = to_json(&Manifest { manifest_version: MANIFEST_VERSION + 1, ..good }).unwrap();
        std::fs::write(path.join(MANIFEST), newer).unwrap();
        let error = find_rollout(path, &wanted, &digests()).unwrap_err();
        assert!(error.kind() == ErrorKind::Unsupported && error.to_string().contains("wrote it"), "{error}");
    }
}
