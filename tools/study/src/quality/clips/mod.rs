//! Clips for the comparison: scenes with a known truth, and real captures of which every other picture is held back.

mod film;
mod game;
pub(super) mod scene;

use std::fmt;

use cairn::guidance::Guidance;
use cairn::{Error, ErrorKind, Picture, Result};
use provision::Progress;
use scenes::{FAMILIES, LANDSCAPES};

use super::store::Store;
use crate::sets::{self, SealedScene, SealedSet, Set};
use film::{FILMS, Film};
use game::{GAMES, Game};
pub(super) use scene::SceneClip;

/// A time between two anchors, as a fraction of the interval in lowest terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Phase {
    part: u32,
    of: u32,
}

impl Phase {
    /// The middle of the interval.
    pub(super) const HALF: Self = Self { part: 1, of: 2 };
    /// The middle of the interval's first half.
    pub(super) const QUARTER: Self = Self { part: 1, of: 4 };
    /// The middle of its second half.
    pub(super) const THREE_QUARTERS: Self = Self { part: 3, of: 4 };

    /// All phases that take a stream to `multiplier` times its rate, in order of time.
    pub(super) fn all(multiplier: u32) -> impl Iterator<Item = Self> {
        (1..multiplier).map(move |part| {
            let divisor =
                (1..=part).rev().find(|d| part.is_multiple_of(*d) && multiplier.is_multiple_of(*d)).unwrap_or(1);
            Self { part: part / divisor, of: multiplier / divisor }
        })
    }

    /// Whether a stream at `multiplier` times its rate shows this phase.
    pub(super) fn belongs_to(self, multiplier: u32) -> bool {
        multiplier.is_multiple_of(self.of)
    }

    /// The smallest number of equal steps of an interval that contains all of `phases`.
    pub(super) fn common(phases: &[Self]) -> u32 {
        let on_all = |steps: &u32| phases.iter().all(|phase| phase.belongs_to(*steps));
        (1..).find(on_all).unwrap_or(1)
    }

    /// As a number inside (0, 1).
    pub(super) fn value(self) -> f32 {
        self.part as f32 / self.of as f32
    }

    /// Fails for every phase except the middle: real captures have no other.
    fn must_be_half(self) -> Result<()> {
        if self == Self::HALF {
            return Ok(());
        }
        Err(Error::new(ErrorKind::InvalidArgument, format!("only the middle between its anchors is known, not {self}")))
    }

    /// Index of this phase among `steps` equal steps of an interval.
    ///
    /// `None` if it lies between two of them.
    pub(super) fn step(self, steps: u32) -> Option<u32> {
        self.belongs_to(steps).then(|| self.part * (steps / self.of))
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.part, self.of)
    }
}

/// An interval whose frames are generated and scored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Target {
    /// Number of the anchor at the interval's end.
    pub(super) anchor: usize,
    /// Multiples of the anchors' rate that are scored on this interval, 2 first.
    pub(super) multipliers: Vec<u32>,
}

impl Target {
    /// All phases without duplicates, in order of time.
    pub(super) fn phases(&self) -> Vec<Phase> {
        let mut all: Vec<Phase> = self.multipliers.iter().flat_map(|m| Phase::all(*m)).collect();
        all.sort_by(|a, b| a.value().total_cmp(&b.value()));
        all.dedup();
        all
    }
}

/// Anchors and the true pictures between them.
pub(super) trait Clip {
    /// Short name, such as `forest-5`.
    fn name(&self) -> &str;

    /// Group over which it is averaged: the family of a scene. A real or a sealed clip is a group of its own.
    fn group(&self) -> &str;

    /// The set that it belongs to.
    fn set(&self) -> Set;

    /// Whether the scenes rendered it; all others are real captures.
    fn is_rendered(&self) -> bool {
        false
    }

    /// Description for the report.
    fn description(&self) -> String;

    /// The intervals that are scored.
    fn targets(&self) -> &[Target];

    /// Number of anchors, counted from 0.
    fn anchors(&self) -> usize;

    /// An anchor.
    fn anchor(&mut self, number: usize, store: &Store) -> Result<Picture>;

    /// The true picture at `phase` between anchor `number - 1` and anchor `number`.
    fn truth(&mut self, number: usize, phase: Phase, store: &Store) -> Result<Picture>;

    /// True motion from anchor `number` to the previous one, and its depth; `None` if unknown.
    fn guidance(&mut self, number: usize, store: &Store) -> Result<Option<Guidance>>;

    /// Opacity of the head-up display over each pixel of anchor `number`, which an engine knows; `None` if there is none.
    fn overlay(&mut self, _number: usize, _store: &Store) -> Result<Option<Vec<u8>>> {
        Ok(None)
    }

    /// As [`guidance`](Self::guidance), but motion and depth as a game engine gives them; `None` if no engine drew the clip.
    fn engine_guidance(&mut self, _number: usize) -> Result<Option<Guidance>> {
        Ok(None)
    }

    /// Mask of the pixels of the true picture at `phase` that are scored, row by row; `None` for all.
    fn scored(&mut self, _number: usize, _phase: Phase, _store: &Store) -> Result<Option<Vec<bool>>> {
        Ok(None)
    }
}

/// Anchors before the first and after the last scored interval of a clip.
const MARGIN: usize = 4;

/// Values of `--clips`.
#[derive(Debug, Clone)]
pub(super) enum Kind {
    Scene(scenes::Family),
    /// A scene in which everything that can move does, under a head-up display.
    Moving(scenes::Family),
    /// Shots of a film.
    Film(&'static Film),
    /// Walks recorded in a game.
    Game(&'static Game),
    /// A walk of the sealed set.
    Sealed(SealedScene),
}

/// Every kind that is not sealed, in the order of the tables.
pub(super) fn kinds() -> Vec<Kind> {
    let scenes = LANDSCAPES.into_iter().map(Kind::Scene).chain(FAMILIES.into_iter().map(Kind::Moving));
    scenes.chain(real().filter(|kind| kind.set() != Set::Sealed)).collect()
}

/// All captures that were not rendered by this program, those of the sealed set included.
fn real() -> impl Iterator<Item = Kind> {
    FILMS.iter().map(Kind::Film).chain(GAMES.iter().map(Kind::Game))
}

impl Kind {
    /// Name in `--clips`.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Scene(family) => family.name().to_owned(),
            Self::Moving(family) => format!("moving-{family}"),
            Self::Film(film) => film.name.to_owned(),
            Self::Game(game) => game.name.to_owned(),
            Self::Sealed(scene) => scene.name(),
        }
    }

    /// The set of real clips; scenes have one for each seed.
    fn set(&self) -> Set {
        if matches!(self, Self::Sealed(_)) { Set::Sealed } else { sets::of_clips(&self.name()) }
    }

    fn is_real(&self) -> bool {
        matches!(self, Self::Film(_) | Self::Game(_))
    }

    /// Opens its clips, one per seed if it has seeds.
    ///
    /// # Errors
    /// The source is not available; the error has the reason and a remedy.
    pub(super) fn open(&self, seeds: &[u64], scale: Scale, progress: &dyn Progress) -> Result<Vec<Box<dyn Clip>>> {
        match self {
            Self::Scene(family) => {
                seeds.iter().map(|seed| Ok(Box::new(SceneClip::new(*family, *seed, scale)?) as Box<dyn Clip>)).collect()
            }
            Self::Moving(family) => {
                let open = |seed: &u64| Ok(Box::new(SceneClip::moving(*family, *seed, scale)?) as Box<dyn Clip>);
                seeds.iter().map(open).collect()
            }
            Self::Film(film) => Ok(boxed(film.open(scale, progress)?)),
            Self::Game(game) => Ok(boxed(game.open(scale, progress)?)),
            Self::Sealed(scene) => Ok(vec![Box::new(SceneClip::sealed(scene)?)]),
        }
    }
}

fn boxed(clips: Vec<impl Clip + 'static>) -> Vec<Box<dyn Clip>> {
    clips.into_iter().map(|clip| Box::new(clip) as Box<dyn Clip>).collect()
}

/// Evenly spaced intervals over a clip of `anchors`, with a margin for rows that use further anchors.
fn evenly(anchors: usize, scale: Scale) -> Vec<Target> {
    let count = if scale == Scale::Full { 6 } else { 2 };
    let (first, last) = (1 + MARGIN, anchors - 1 - MARGIN);
    let anchor = |i| first + i * (last - first) / (count - 1);
    (0..count).map(|i| Target { anchor: anchor(i), multipliers: vec![2] }).collect()
}

/// Amount of scored material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// For the tables.
    Full,
    /// Small pictures and two intervals, to check that everything works.
    Smoke,
    /// Three intervals of a scene, for the [floors](super::floors()).
    Floors,
    /// One interval of a scene at 1920x1080, timed and not scored.
    Timed,
}

/// Parses a list such as `forest,snow`; `all`, `scenes`, `moving` and `real` stand for several, `none` for no clip.
///
/// # Errors
/// `InvalidArgument` for an unknown name, and for clips of the sealed set.
pub(super) fn parse(list: &str) -> Result<Vec<Kind>> {
    for name in list.split(',').map(str::trim) {
        sets::require_unsealed_clips(name, "--clips")?;
    }
    select(list, &kinds())
}

/// Parses a list of clips of a sealed set, as [`parse`] does.
///
/// # Errors
/// `InvalidArgument` for a clip that the set does not have.
pub(super) fn parse_sealed(list: &str, set: &SealedSet) -> Result<Vec<Kind>> {
    let mut all: Vec<Kind> = set.scenes.iter().cloned().map(Kind::Sealed).collect();
    for name in &set.clips {
        let found = real().find(|kind| kind.name() == *name);
        all.push(found.ok_or_else(|| {
            Error::new(ErrorKind::InvalidArgument, format!("there is no clip {name:?}")).field("sealed.clips")
        })?);
    }
    select(list, &all)
}

/// Those of `all` that `list` names.
fn select(list: &str, all: &[Kind]) -> Result<Vec<Kind>> {
    let mut chosen: Vec<Kind> = Vec::new();
    if list.trim() == "none" {
        return Ok(chosen);
    }
    for name in list.split(',').map(str::trim) {
        let is_meant = |kind: &&Kind| match name {
            "all" => true,
            "scenes" => !kind.is_real(),
            "moving" => kind.name().starts_with("moving-"),
            "real" => kind.is_real(),
            name => kind.name() == name,
        };
        let found: Vec<&Kind> = all.iter().filter(is_meant).collect();
        if found.is_empty() {
            let names: Vec<String> = all.iter().map(Kind::name).collect();
            return Err(Error::new(ErrorKind::InvalidArgument, format!("there is no clip {name:?}"))
                .field("--clips")
                .remedy(format!(
                    "Use all, scenes, moving, real, or any of {}, with commas between",
                    names.join(", ")
                )));
        }
        for kind in found {
            if chosen.iter().all(|other| other.name() != kind.name()) {
                chosen.push(kind.clone());
            }
        }
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_are_in_lowest_terms_and_in_order() {
        let shown = |m| Phase::all(m).map(|p| p.to_string()).collect::<Vec<_>>().join(" ");
        assert_eq!((shown(2), shown(4), shown(6)), ("1/2".into(), "1/4 1/2 3/4".into(), "1/6 1/3 1/2 2/3 5/6".into()));
        let all = Target { anchor: 1, multipliers: vec![2, 4, 6] }.phases();
        let values: Vec<String> = all.iter().map(ToString::to_string).collect();
        assert_eq!(values.join(" "), "1/6 1/4 1/3 1/2 2/3 3/4 5/6");
        assert_eq!(all.iter().filter(|p| p.belongs_to(4)).count(), 3);
        assert_eq!((Phase::common(&all), Phase::common(&[Phase::HALF]), Phase::common(&[])), (12, 2, 1));
        assert_eq!((Phase::HALF.step(12), Phase::HALF.step(3)), (Some(6), None));
    }

    #[test]
    fn intervals_lie_evenly_with_room_at_both_ends() {
        let at = |anchors, scale| evenly(anchors, scale).iter().map(|t| t.anchor).collect::<Vec<_>>();
        assert_eq!(at(56, Scale::Full), [5, 14, 23, 32, 41, 51]);
        assert_eq!(at(47, Scale::Smoke), [5, 42]);
        assert!(Phase::HALF.must_be_half().is_ok());
        assert!(Target { anchor: 1, multipliers: vec![4] }.phases()[0].must_be_half().is_err());
    }

    #[test]
    fn lists_of_clips_are_read_once_each_and_slips_are_named() {
        let names = |list: &str| parse(list).unwrap().iter().map(Kind::name).collect::<Vec<_>>();
        let all: Vec<String> = kinds().iter().map(Kind::name).collect();
        assert_eq!(names("snow, forest,snow"), ["snow", "forest"]);
        assert_eq!(names("all"), all);
        assert_eq!([names("scenes"), names("real")].concat(), all);
        assert_eq!(names("none"), [""; 0]);
        let error = parse("forrest").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        assert!(error.to_string().contains("forest"), "{error}");
    }

    #[test]
    fn every_real_clip_is_in_a_set_and_sealed_ones_are_refused_by_name() {
        let sealed: Vec<String> = real().filter(|kind| kind.set() == Set::Sealed).map(|kind| kind.name()).collect();
        assert!(sealed.len() >= 2 && real().all(|kind| kind.set() != Set::Tuning));
        for name in sealed {
            let error = parse(&format!("snow,{name}")).unwrap_err();
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("--clips")));
            assert!(error.to_string().contains("sealed") && error.to_string().contains("bunny"), "{error}");
            assert!(["all", "real"].iter().all(|list| parse(list).unwrap().iter().all(|kind| kind.name() != name)));
        }
        // The repository's set names clips that there are.
        let set = sets::sealed().unwrap();
        let all = parse_sealed("all", &set).unwrap();
        assert_eq!(all.len(), set.scenes.len() + set.clips.len());
        assert!(all.iter().all(|kind| kind.set() == Set::Sealed));
        let one = parse_sealed("forest-901", &set).unwrap();
        assert_eq!(one.iter().map(Kind::name).collect::<Vec<_>>(), ["forest-901"]);
        assert!(parse_sealed("bunny", &set).unwrap_err().to_string().contains("forest-901"));
        assert!(parse_sealed("all", &SealedSet { scenes: Vec::new(), clips: vec!["none such".into()] }).is_err());
    }
}
