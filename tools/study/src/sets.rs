//! The sets of clips: tuning, development and sealed.
//!
//! `sets.toml` names them. Commands that measure or compare call the `require_unsealed…` functions, so nobody tunes on the sealed set by accident;
//! [`quality`](crate::quality) alone opens it, and records each opening.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use cairn::world::ControlScript;
use cairn::{Error, ErrorKind, Result};
use scenes::Family;
use serde::Deserialize;
use sha2::{Digest, Sha256};

use media::describe_io;

/// The repository's sets.
const SETS: &str = include_str!("../sets.toml");
/// The sealed control scripts by file name.
const SCRIPTS: [(&str, &str); 6] = [
    ("forest.txt", include_str!("../../../samples/scripts/sealed/forest.txt")),
    ("sword.txt", include_str!("../../../samples/scripts/sealed/sword.txt")),
    ("desert.txt", include_str!("../../../samples/scripts/sealed/desert.txt")),
    ("snow.txt", include_str!("../../../samples/scripts/sealed/snow.txt")),
    ("indoors.txt", include_str!("../../../samples/scripts/sealed/indoors.txt")),
    ("town.txt", include_str!("../../../samples/scripts/sealed/town.txt")),
];
/// What to use instead of a sealed seed.
fn open_seeds() -> String {
    let list = |ranges: &[Seeds]| ranges.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let Sets { tuning, development, .. } = sets();
    format!(
        "Tune on seed {}, check on the development seeds {}, and leave this one to `study quality --sealed`",
        list(&tuning.seeds),
        list(&development.seeds)
    )
}

/// A set of clips, by what its figures prove.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Set {
    /// Rules and constants are fitted to it.
    Tuning,
    /// Constants are not fitted to it, but rules are kept or removed by it, and its figures are read while the work goes on.
    Development,
    /// Opened by `study quality --sealed` alone.
    Sealed,
}

impl Set {
    /// What its figures prove, as the end of a sentence.
    pub(crate) fn meaning(self) -> &'static str {
        match self {
            Self::Tuning => "the generators are fitted to it, so its figures prove nothing",
            Self::Development => {
                "constants are not fitted to it, but rules are kept or removed by it, and its figures are read while the work goes on"
            }
            Self::Sealed => {
                "no constant is fitted to it and no rule chosen by it, and the ledger lists every opening with its results"
            }
        }
    }
}

impl fmt::Display for Set {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Tuning => "tuning",
            Self::Development => "development",
            Self::Sealed => "sealed",
        })
    }
}

/// A walk through a scene of the sealed set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SealedScene {
    pub(crate) family: Family,
    pub(crate) seed: u64,
    /// Text of the control script.
    pub(crate) script: String,
    /// Width and height in pixels.
    pub(crate) size: (u32, u32),
    /// Anchors, 15 a second, that end the scored intervals.
    pub(crate) anchors: Vec<usize>,
    /// Scored multiples of the anchors' rate, 2 first.
    pub(crate) multipliers: Vec<u32>,
    /// Whether things move in it, under a head-up display.
    pub(crate) moving: bool,
}

impl SealedScene {
    /// Name of its clip, such as `forest-901` or `forest-953-1080p`.
    pub(crate) fn name(&self) -> String {
        let size = if self.size.1 == 360 { String::new() } else { format!("-{}p", self.size.1) };
        let moving = if self.moving { "moving-" } else { "" };
        format!("{moving}{}-{}{size}", self.family, self.seed)
    }
}

/// What `study quality --sealed` measures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SealedSet {
    pub(crate) scenes: Vec<SealedScene>,
    /// Names of real clips.
    pub(crate) clips: Vec<String>,
}

/// `sets.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sets {
    tuning: OpenSet,
    development: OpenSet,
    sealed: Sealed,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OpenSet {
    seeds: Vec<Seeds>,
    clips: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sealed {
    seeds: Vec<Seeds>,
    clips: Vec<String>,
    #[serde(default)]
    scene: Vec<Scene>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Scene {
    scene: String,
    seed: u64,
    script: String,
    size: (u32, u32),
    anchors: Vec<usize>,
    multipliers: Vec<u32>,
    #[serde(default)]
    moving: bool,
}

/// A file with a sealed set of its own, for trials of the mechanism.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OwnSet {
    sealed: Sealed,
}

/// A range of seeds, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
struct Seeds(u64, u64);

impl fmt::Display for Seeds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(first, last) = self;
        if first == last { write!(f, "{first}") } else { write!(f, "{first} to {last}") }
    }
}

impl TryFrom<String> for Seeds {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        let (first, last) = text.split_once("..").unwrap_or((&text, &text));
        match (first.parse(), last.parse()) {
            (Ok(first), Ok(last)) if first <= last => Ok(Self(first, last)),
            _ => Err(format!("{text:?} is no range of seeds; write 5 or 5..7")),
        }
    }
}

fn includes(ranges: &[Seeds], seed: u64) -> bool {
    ranges.iter().any(|Seeds(first, last)| (*first..=*last).contains(&seed))
}

/// The repository's sets.
fn sets() -> &'static Sets {
    static PARSED: OnceLock<Sets> = OnceLock::new();
    PARSED.get_or_init(|| toml::from_str(SETS).unwrap_or_else(|e| panic!("tools/study/sets.toml: {e}")))
}

/// The set of a scene seed. One in no set counts as tuning, because nothing prevents its use there.
pub(crate) fn of_seed(seed: u64) -> Set {
    let Sets { development, sealed, .. } = sets();
    match () {
        () if includes(&sealed.seeds, seed) => Set::Sealed,
        () if includes(&development.seeds, seed) => Set::Development,
        () => Set::Tuning,
    }
}

/// The set of a group of real clips, by its name.
pub(crate) fn of_clips(name: &str) -> Set {
    let named = |clips: &[String]| clips.iter().any(|clip| clip == name);
    match () {
        () if named(&sets().sealed.clips) => Set::Sealed,
        () if named(&sets().development.clips) => Set::Development,
        () => Set::Tuning,
    }
}

/// Refuses sealed scene seeds; `field` is the option that they come from.
///
/// # Errors
/// `InvalidArgument`.
pub(crate) fn require_unsealed(seeds: &[u64], field: &str) -> Result<()> {
    match seeds.iter().find(|seed| of_seed(**seed) == Set::Sealed) {
        None => Ok(()),
        Some(seed) => Err(refusal(&format!("scene seed {seed}"), field).remedy(open_seeds())),
    }
}

/// Refuses the text of a sealed control script, under whatever name its file has; spaces, comments and line ends do not matter.
///
/// # Errors
/// `InvalidArgument`.
pub(crate) fn require_unsealed_script(script: &ControlScript, field: &str) -> Result<()> {
    static SEALED: OnceLock<Vec<ControlScript>> = OnceLock::new();
    let sealed =
        SEALED.get_or_init(|| SCRIPTS.iter().filter_map(|(_, text)| ControlScript::parse(text).ok()).collect());
    if !sealed.contains(script) {
        return Ok(());
    }
    Err(refusal("this control script", field).remedy("Use a script of samples/scripts, or write one of your own"))
}

/// Refuses a sealed group of real clips.
///
/// # Errors
/// `InvalidArgument`.
pub(crate) fn require_unsealed_clips(name: &str, field: &str) -> Result<()> {
    if of_clips(name) != Set::Sealed {
        return Ok(());
    }
    let open = sets().development.clips.join(", ");
    Err(refusal(&format!("the clip {name:?}"), field)
        .remedy(format!("Use clips of the development set ({open}), and leave this one to `study quality --sealed`")))
}

/// Refuses the file of a sealed film, under whatever name.
///
/// # Errors
/// `InvalidArgument`; `Io`.
pub(crate) fn require_unsealed_film(file: &Path) -> Result<()> {
    require_none_of(file, &provision::baselines::SEALED_FILMS)
}

/// Refuses a file whose SHA-256 is among `sealed`.
fn require_none_of(file: &Path, sealed: &[&str]) -> Result<()> {
    let unreadable = |e: io::Error| describe_io("cannot be read", file, &e);
    let mut hash = Sha256::new();
    let mut open = BufReader::with_capacity(1 << 20, File::open(file).map_err(unreadable)?);
    loop {
        let part = open.fill_buf().map_err(unreadable)?;
        if part.is_empty() {
            break;
        }
        hash.update(part);
        let read = part.len();
        open.consume(read);
    }
    let found: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    if !sealed.contains(&found.as_str()) {
        return Ok(());
    }
    Err(refusal("this film", &file.display().to_string())
        .remedy("Use another film, such as one of the development set"))
}

/// The error for a part of the sealed set.
pub(crate) fn refusal(what: &str, field: &str) -> Error {
    let why = "figures on it prove something only while nobody tunes on it";
    Error::new(ErrorKind::InvalidArgument, format!("{what} belongs to the sealed test set: {why}")).field(field)
}

/// The repository's sealed set.
///
/// # Errors
/// As [`own`]; a test reads the file, so none in a released program.
pub(crate) fn sealed() -> Result<SealedSet> {
    let script = |name: &str| {
        let found = SCRIPTS.iter().find(|(file, _)| *file == name);
        found.map(|(_, text)| (*text).to_owned()).ok_or_else(|| {
            Error::new(ErrorKind::InvalidArgument, format!("there is no sealed script {name:?}")).field("sets.toml")
        })
    };
    read(&sets().sealed, &script)
}

/// A sealed set from a file of its own, whose scripts lie beside it: to try the mechanism without opening the repository's set.
///
/// # Errors
/// `Io`, and `InvalidArgument` for a text in another form or for parts of the repository's sealed set.
pub(crate) fn own(file: &Path) -> Result<SealedSet> {
    let name = file.display().to_string();
    let text = fs::read_to_string(file).map_err(|e| describe_io("cannot be read", file, &e))?;
    let OwnSet { sealed } = toml::from_str(&text)
        .map_err(|e| Error::new(ErrorKind::InvalidArgument, e.message().to_owned()).field(&*name))?;
    require_unsealed(&sealed.scene.iter().map(|scene| scene.seed).collect::<Vec<_>>(), &name)?;
    for clips in &sealed.clips {
        require_unsealed_clips(clips, &name)?;
    }
    let script = |script: &str| {
        let path: PathBuf = file.with_file_name(script);
        let text = fs::read_to_string(&path).map_err(|e| describe_io("cannot be read", &path, &e))?;
        require_unsealed_script(&ControlScript::parse(&text)?, script)?;
        Ok(text)
    };
    read(&sealed, &script)
}

fn read(sealed: &Sealed, script: &dyn Fn(&str) -> Result<String>) -> Result<SealedSet> {
    let scene = |scene: &Scene| {
        let refused = |cause: String| Err(Error::new(ErrorKind::InvalidArgument, cause).field("sealed.scene"));
        let Ok(family) = scene.scene.parse::<Family>() else {
            return refused(format!("there is no scene {:?}", scene.scene));
        };
        if !includes(&sealed.seeds, scene.seed) {
            return refused(format!("seed {} of a sealed scene is not among the sealed seeds", scene.seed));
        }
        // The first scored interval needs its own two anchors, one before, and the margin of rows that use more.
        if scene.anchors.is_empty() || scene.anchors.iter().any(|anchor| *anchor < 5) {
            return refused(format!("{} {}: the first scored interval ends at anchor 5 or later", family, scene.seed));
        }
        if scene.multipliers.first() != Some(&2) || scene.multipliers.iter().any(|m| ![2, 4, 6].contains(m)) {
            return refused(format!("{} {}: multipliers are 2, 4 and 6, 2 first", family, scene.seed));
        }
        let Scene { seed, size, moving, .. } = *scene;
        let (anchors, multipliers) = (scene.anchors.clone(), scene.multipliers.clone());
        Ok(SealedScene { family, seed, script: script(&scene.script)?, size, anchors, multipliers, moving })
    };
    let scenes = sealed.scene.iter().map(scene).collect::<Result<Vec<_>>>()?;
    Ok(SealedSet { scenes, clips: sealed.clips.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::held_out;

    #[test]
    fn sealed_seeds_are_refused_with_reason_and_remedy_and_others_are_not() {
        require_unsealed(&[4, 5, 6, 7, 41, 899, 1000], "--seeds").unwrap();
        let error = require_unsealed(&[5, 900], "--seeds").unwrap_err();
        assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("--seeds")));
        let text = error.to_string();
        assert!(text.contains("900") && text.contains("sealed") && text.contains("--sealed"), "{text}");
        assert_eq!([4, 5, 901, 123].map(of_seed), [Set::Tuning, Set::Development, Set::Sealed, Set::Tuning]);
    }

    #[test]
    fn sealed_scripts_are_recognised_by_content() {
        for (name, text) in SCRIPTS {
            let error = require_unsealed_script(&ControlScript::parse(text).unwrap(), "--script").unwrap_err();
            assert!(error.to_string().contains("sealed"), "{name}: {error}");
        }
        // Comments and spaces do not change a walk.
        let other = format!("{}# other words\n", SCRIPTS[0].1.replace("hold  ", "hold "));
        require_unsealed_script(&ControlScript::parse(&other).unwrap(), "--script").unwrap_err();
        for open in [include_str!("../../../samples/scripts/forest.txt"), "cairn-controls 1\n0..2 hold W\n3 end\n"] {
            require_unsealed_script(&ControlScript::parse(open).unwrap(), "--script").unwrap();
        }
    }

    #[test]
    fn a_sealed_film_is_recognised_by_content() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("holiday.mp4");
        fs::write(&file, "abc").unwrap();
        require_unsealed_film(&file).unwrap();
        // The SHA-256 of "abc", FIPS 180-2, appendix B.1.
        let sum = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let error = require_none_of(&file, &[sum]).unwrap_err().to_string();
        assert!(error.contains("holiday.mp4") && error.contains("sealed"), "{error}");
        fs::write(&file, "abd").unwrap();
        require_none_of(&file, &[sum]).unwrap();
    }

    #[test]
    fn the_repositorys_set_is_whole_and_no_world_was_trained_on_it() {
        let set = sealed().unwrap();
        let seeds: Vec<u64> = set.scenes.iter().map(|scene| scene.seed).collect();
        held_out::require(&seeds).unwrap();
        let Seeds(first, last) = sets().sealed.seeds[0];
        held_out::require(&(first..=last).collect::<Vec<_>>()).unwrap();
        assert!(seeds.iter().all(|seed| of_seed(*seed) == Set::Sealed));
        for size in [(640, 360), (1920, 1080)] {
            for family in scenes::FAMILIES {
                assert!(set.scenes.iter().any(|s| (s.family, s.size) == (family, size)), "{family} at {size:?}");
            }
        }
        let mut names: Vec<String> = set.scenes.iter().map(SealedScene::name).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), set.scenes.len());
        // Every file of the folder is sealed, and every walk lasts until its last scored interval.
        let folder = provision::repository().join("samples/scripts/sealed");
        let files = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name());
        let files: Vec<String> = files.map(|name| name.into_string().unwrap()).collect();
        assert_eq!(files.len(), SCRIPTS.len());
        assert!(files.iter().all(|file| SCRIPTS.iter().any(|(name, _)| name == file)), "{files:?}");
        for scene in &set.scenes {
            assert!(scene.anchors.iter().all(|anchor| anchor + 5 < 13 * 15), "{}", scene.name());
        }
        let (tuning, development) = (&sets().tuning, &sets().development);
        assert!(tuning.seeds.contains(&Seeds(4, 4)) && development.seeds.contains(&Seeds(5, 7)));
        assert!(set.clips.iter().all(|clip| !tuning.clips.contains(clip) && !development.clips.contains(clip)));
    }

    #[test]
    fn a_set_of_ones_own_cannot_hold_parts_of_the_repositorys() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sets.toml");
        fs::write(folder.path().join("walk.txt"), "cairn-controls 1\n0..2 hold W\n3 end\n").unwrap();
        fs::write(folder.path().join("copy.txt"), SCRIPTS[1].1).unwrap();
        let write = |seed: u64, seeds: &str, script: &str, clips: &str, anchors: &str| {
            let text = format!(
                "[sealed]\nseeds = [\"{seeds}\"]\nclips = [{clips}]\n[[sealed.scene]]\nscene = \"snow\"\nseed = {seed}\n\
                 script = \"{script}\"\nsize = [96, 54]\nanchors = {anchors}\nmultipliers = [2]\n"
            );
            fs::write(&file, text).unwrap();
            own(&file)
        };
        let set = write(801, "801..802", "walk.txt", "", "[6]").unwrap();
        assert_eq!((set.scenes[0].name(), set.scenes[0].size), ("snow-801-54p".into(), (96, 54)));
        let refused = |set: Result<SealedSet>| set.unwrap_err().to_string();
        assert!(refused(write(901, "901", "walk.txt", "", "[6]")).contains("sealed test set"));
        assert!(refused(write(801, "801", "copy.txt", "", "[6]")).contains("sealed test set"));
        assert!(refused(write(803, "801..802", "walk.txt", "", "[6]")).contains("not among"));
        assert!(refused(write(801, "801", "walk.txt", "", "[4]")).contains("anchor 5"));
        assert!(refused(write(801, "x", "walk.txt", "", "[6]")).contains("no range"));
        assert_eq!(own(&folder.path().join("none.toml")).unwrap_err().kind(), ErrorKind::Io);
    }
}
