//! Recorded walks: a control script whose comments say where it was walked, and the checksum of the latents that it gave.

use std::path::{Path, PathBuf};

use cairn::world::ControlScript;
use cairn::{Error, ErrorKind, Result};

use crate::manifest::read_bounded;
use media::{RealDisk, describe_io, write_whole};

/// The largest script, plus one byte so that the library reports the error.
const MAX_BYTES: u64 = (4 << 20) + 1;

/// A walk to write or to repeat. Comments that a script lacks are `None`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WalkFile {
    pub(crate) script: ControlScript,
    /// Name of the level.
    pub(crate) level: Option<String>,
    /// Checksum of the world.
    pub(crate) world: Option<String>,
    /// In text form.
    pub(crate) operating_point: Option<String>,
    /// Seed of the noise.
    pub(crate) seed: Option<u64>,
    /// Number of latents after the first, and the SHA-256 of all of them.
    pub(crate) latents: Option<(u64, String)>,
}

impl WalkFile {
    /// The file's text.
    pub(crate) fn write(&self) -> String {
        let script = self.script.write();
        let (first, events) = script.split_once('\n').unwrap_or((&script, ""));
        let seed = self.seed.map(|seed| seed.to_string());
        let latents = self.latents.as_ref().map(|(count, sha256)| format!("{count} {sha256}"));
        let comments = [
            ("level", &self.level),
            ("world", &self.world),
            ("point", &self.operating_point),
            ("seed", &seed),
            ("latents", &latents),
        ];
        let lines = comments.iter().filter_map(|(name, value)| Some(format!("# {name} {}\n", value.as_ref()?)));
        format!("{first}\n{}{events}", lines.collect::<String>())
    }

    /// Reads a text; any control script is one.
    ///
    /// # Errors
    /// `InvalidArgument` if the text is not a control script, or a comment of a recording cannot be read.
    pub(crate) fn parse(text: &str) -> Result<Self> {
        let comment = |name: &str| {
            let found = text.lines().find_map(|line| line.strip_prefix("# ")?.strip_prefix(name)?.strip_prefix(' '));
            found.map(|value| value.trim().to_owned())
        };
        let wrong = |name: &str, value: &str| {
            Error::new(ErrorKind::InvalidArgument, format!("the comment \"# {name} {value}\" cannot be read"))
                .remedy("Remove it, or record the walk anew")
        };
        let seed = comment("seed").map(|value| value.parse().map_err(|_| wrong("seed", &value)));
        let latents = comment("latents").map(|value| {
            let parts =
                value.split_once(' ').and_then(|(count, sha256)| Some((count.parse().ok()?, sha256.to_owned())));
            parts.ok_or_else(|| wrong("latents", &value))
        });
        Ok(Self {
            script: ControlScript::parse(text)?,
            level: comment("level"),
            world: comment("world"),
            operating_point: comment("point"),
            seed: seed.transpose()?,
            latents: latents.transpose()?,
        })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// `Io`, and as [`parse`](Self::parse).
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes = read_bounded(path, MAX_BYTES)?;
        let text = String::from_utf8(bytes)
            .map_err(|_| Error::new(ErrorKind::InvalidArgument, "it is not UTF-8").field(path.display().to_string()))?;
        Self::parse(&text).map_err(|e| Error::new(e.kind(), format!("{}: {e}", path.display())).field("--replay"))
    }

    /// Writes a new file `walk-LEVEL-N.txt` into `folder`, which is made if it is missing. Returns its path.
    ///
    /// # Errors
    /// `Io`.
    pub(crate) fn save(&self, folder: &Path) -> Result<PathBuf> {
        std::fs::create_dir_all(folder).map_err(|e| describe_io("cannot be made", folder, &e))?;
        let name = |number: u32| folder.join(format!("walk-{}-{number}.txt", self.level.as_deref().unwrap_or("world")));
        let path = (1..).map(name).find(|path| !path.exists()).unwrap_or_else(|| name(0));
        write_whole(&RealDisk, &path, self.write().as_bytes())?;
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walk_is_read_as_it_is_written() {
        let script = ControlScript::parse("cairn-controls 1\n0..1 hold W\n0.5 mouse 3 -4\n2 end\n").unwrap();
        let walk = WalkFile {
            script,
            level: Some("snow".into()),
            world: Some("ab12".into()),
            operating_point: Some("g128,stock".into()),
            seed: Some(7),
            latents: Some((30, "cd34".into())),
        };
        assert_eq!(WalkFile::parse(&walk.write()).unwrap(), walk);
        let folder = tempfile::tempdir().unwrap();
        let [first, second] = [(); 2].map(|()| walk.save(folder.path()).unwrap());
        assert_ne!(first, second);
        assert_eq!(WalkFile::read(&second).unwrap(), walk);
    }

    #[test]
    fn any_control_script_is_a_walk() {
        let walk = WalkFile::parse("cairn-controls 1\n# a walk by hand\n1 end\n").unwrap();
        assert_eq!((walk.level, walk.latents), (None, None));
        let error = WalkFile::parse("cairn-controls 1\n# seed many\n1 end\n").unwrap_err();
        assert!(error.to_string().contains("seed many"), "{error}");
    }
}
