//! Clips for the comparison: scenes with a known truth, and real captures of which every other picture is held back.

mod film;
mod game;
pub(super) mod scene;

use std::fmt;

use cairn::guidance::Guidance;
use cairn::{Error, ErrorKind, Picture, Result};
use provision::Progress;
use scenes::LANDSCAPES;

use super::store::Store;
use film::Film;
use game::Game;
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

    /// Group over which it is averaged: the family, or its own name.
    fn group(&self) -> &str;

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

    /// Mask of the pixels of the true picture at `phase` that are scored, row by row; `None` for all.
    fn scored(&mut self, _number: usize, _phase: Phase, _store: &Store) -> Result<Option<Vec<bool>>> {
        Ok(None)
    }
}

/// Anchors before the first and after the last scored interval of a clip.
const MARGIN: usize = 4;

/// Values of `--clips`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Scene(scenes::Family),
    /// Shots of Big Buck Bunny.
    Film,
    /// Walks in ViZDoom.
    Game,
}

/// Every kind, in the order of the tables.
pub(super) fn kinds() -> Vec<Kind> {
    LANDSCAPES.into_iter().map(Kind::Scene).chain(REAL).collect()
}

/// Captures that were not rendered by this program.
const REAL: [Kind; 2] = [Kind::Film, Kind::Game];

impl Kind {
    /// Name in `--clips`.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Scene(family) => family.name(),
            Self::Film => "bunny",
            Self::Game => "vizdoom",
        }
    }

    /// Opens its clips, one per seed if it has seeds.
    ///
    /// # Errors
    /// The source is not available; the error has the reason and a remedy.
    pub(super) fn open(self, seeds: &[u64], scale: Scale, progress: &dyn Progress) -> Result<Vec<Box<dyn Clip>>> {
        match self {
            Self::Scene(family) => {
                seeds.iter().map(|seed| Ok(Box::new(SceneClip::new(family, *seed, scale)?) as Box<dyn Clip>)).collect()
            }
            Self::Film => Ok(boxed(Film::shots(scale, progress)?)),
            Self::Game => Ok(boxed(Game::walks(scale, progress)?)),
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
    /// One interval of a scene at 1920x1080, timed and not scored.
    Timed,
}

/// Parses a list such as `forest,snow`; `all`, `scenes` and `real` stand for several, `none` for no clip.
///
/// # Errors
/// `InvalidArgument` for an unknown name.
pub(super) fn parse(list: &str) -> Result<Vec<Kind>> {
    let mut chosen = Vec::new();
    if list.trim() == "none" {
        return Ok(chosen);
    }
    for name in list.split(',').map(str::trim) {
        let found: Vec<Kind> = match name {
            "all" => kinds(),
            "scenes" => LANDSCAPES.into_iter().map(Kind::Scene).collect(),
            "real" => REAL.to_vec(),
            name => kinds().into_iter().filter(|kind| kind.name() == name).collect(),
        };
        if found.is_empty() {
            let names: Vec<&str> = kinds().iter().map(|kind| kind.name()).collect();
            return Err(Error::new(ErrorKind::InvalidArgument, format!("there is no clip {name:?}"))
                .field("--clips")
                .remedy(format!("Use all, scenes, real, or any of {}, with commas between", names.join(", "))));
        }
        for kind in found {
            if !chosen.contains(&kind) {
                chosen.push(kind);
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
        assert_eq!(
            parse("snow, forest,snow").unwrap().iter().map(|k| k.name()).collect::<Vec<_>>(),
            ["snow", "forest"]
        );
        assert_eq!(parse("all").unwrap(), kinds());
        assert_eq!([parse("scenes").unwrap(), parse("real").unwrap()].concat(), kinds());
        assert_eq!(parse("none").unwrap(), []);
        let error = parse("forrest").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        assert!(error.to_string().contains("forest"), "{error}");
    }
}
