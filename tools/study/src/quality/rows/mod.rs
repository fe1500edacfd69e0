//! Rows of the comparison: methods to make pictures between two anchors.

mod flowfps;
mod fsr;
pub(super) mod minterpolate;
mod ours;
pub(super) mod program;
mod rife;
mod simple;
pub(super) mod tune;

use cairn::guidance::Guidance;
use cairn::{Error, ErrorKind, Picture, Result};

use self::ours::Ours;
use super::clips::Phase;
use crate::progress::Progress;

/// A method, in the order of the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Kind {
    Repeat,
    Blend,
    Minterpolate,
    FlowFps,
    Rife,
    Rife4,
    FsrFlow,
    FsrEngine,
    Fsr,
    NoMotion,
    Paper,
    Flow,
    Engine,
    Truth,
}

/// All methods, in the order of the tables.
pub(super) const KINDS: [Kind; 14] = [
    Kind::Repeat,
    Kind::Blend,
    Kind::Minterpolate,
    Kind::FlowFps,
    Kind::Rife,
    Kind::Rife4,
    Kind::FsrFlow,
    Kind::FsrEngine,
    Kind::Fsr,
    Kind::NoMotion,
    Kind::Paper,
    Kind::Flow,
    Kind::Engine,
    Kind::Truth,
];

/// Largest [`Kind::history`].
pub(super) const MAX_HISTORY: usize = fsr::HISTORY;

impl Kind {
    /// Name in `--rows` and in CSV files.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Repeat => "repeat",
            Self::Blend => "blend",
            Self::Minterpolate => "minterpolate",
            Self::FlowFps => "flowfps",
            Self::Rife => "rife",
            Self::Rife4 => "rife4",
            Self::FsrFlow => "fsr-flow",
            Self::FsrEngine => "fsr-engine",
            Self::Fsr => "fsr",
            Self::NoMotion => "none",
            Self::Paper => "paper",
            Self::Flow => "cairn-flow",
            Self::Engine => "cairn-engine",
            Self::Truth => "cairn-truth",
        }
    }

    /// Name in the report's tables.
    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Repeat => "repeat",
            Self::Blend => "blend",
            Self::Minterpolate => "ffmpeg minterpolate",
            Self::FlowFps => "MVTools FlowFPS",
            Self::Rife => "RIFE HDv3",
            Self::Rife4 => "RIFE 4.0",
            Self::FsrFlow => "AMD FSR, `picture_flow`",
            Self::FsrEngine => "AMD FSR, an engine's motion and depth",
            Self::Fsr => "AMD FSR, true motion and depth",
            Self::NoMotion => "Cairn's generator, no motion",
            Self::Paper => "Cairn's generator, the paper's motion",
            Self::Flow => "**Cairn**, `picture_flow`",
            Self::Engine => "**Cairn**, an engine's motion and depth",
            Self::Truth => "**Cairn**, true motion and depth",
        }
    }

    /// Description in one sentence.
    pub(super) fn description(self) -> &'static str {
        match self {
            Self::Repeat => "The nearer anchor once more; the earlier one in the middle.",
            Self::Blend => "The mean of both anchors, weighted by the phase.",
            Self::Minterpolate => {
                "Block motion, found once for both directions, overlapped blocks; given two anchors on either side."
            }
            Self::FlowFps => "Block motion in both directions, refined and made dense, with an occlusion mask.",
            Self::Rife => "A neural network of 3 million parameters that estimates flow and a mask; the middle only.",
            Self::Rife4 => "Its successor for any phase: four blocks, each run in both directions of time.",
            Self::FsrFlow => {
                "AMD's frame generation, its own DLLs called through Cairn, with motion found by `picture_flow` and constant depth; the \
                 middle only."
            }
            Self::FsrEngine => {
                "The same with motion and depth as an engine gives them, those of the row `cairn-engine`; the middle only."
            }
            Self::Fsr => "The same with the clip's own motion and depth; the middle only.",
            Self::NoMotion => "The `cpu` generator with zero motion and constant depth.",
            Self::Paper => {
                "The `cpu` generator with `paper`: motion and depth as published, from the latents that the embedded world's \
                 encoder makes of the two anchors."
            }
            Self::Flow => "The `cpu` generator with motion found by `picture_flow` in the two anchors, and no depth.",
            Self::Engine => {
                "The `cpu` generator with motion and depth as an engine gives them: one-frame vectors in 16 bits, dilated and composed \
                 over two frames, the camera's alone for what bends; reversed depth; the mask of the head-up display where there is one."
            }
            Self::Truth => {
                "The `cpu` generator with the clip's own motion and depth, and the mask of the head-up display where there is one."
            }
        }
    }

    /// Whether it needs no other program.
    pub(super) fn is_built_in(self) -> bool {
        matches!(
            self,
            Self::Repeat | Self::Blend | Self::NoMotion | Self::Paper | Self::Flow | Self::Engine | Self::Truth
        )
    }

    /// Whether another maker's program or network makes its pictures.
    pub(super) fn is_of_others(self) -> bool {
        !self.is_built_in()
    }

    /// Whether it can make a picture at `phase`.
    pub(super) fn can_do(self, phase: Phase) -> bool {
        phase == Phase::HALF || !matches!(self, Self::Rife | Self::FsrFlow | Self::FsrEngine | Self::Fsr)
    }

    /// Whether it needs the motion and depth of a clip, true or as an engine gives them.
    pub(super) fn needs_guidance(self) -> bool {
        matches!(self, Self::FsrEngine | Self::Fsr | Self::Engine | Self::Truth)
    }

    /// Whether the motion and depth that it needs are those that an engine gives.
    pub(super) fn needs_engine(self) -> bool {
        matches!(self, Self::FsrEngine | Self::Engine)
    }

    /// Number of anchors before and after the interval that it uses.
    pub(super) fn margin(self) -> usize {
        match self {
            Self::Minterpolate | Self::FlowFps => 2,
            _ => 0,
        }
    }

    /// Number of anchors before the interval that it plays first, because it keeps a history.
    pub(super) fn history(self) -> usize {
        match self {
            Self::FsrFlow | Self::FsrEngine | Self::Fsr => fsr::HISTORY,
            _ => 0,
        }
    }

    /// Prepares it for work.
    ///
    /// # Errors
    /// Something that it needs is not available; the error has the reason and a remedy.
    pub(super) fn open(self, progress: &Progress) -> Result<Box<dyn Row>> {
        match self {
            Self::Repeat => Ok(Box::new(simple::Repeat)),
            Self::Blend => Ok(Box::new(simple::Blend)),
            Self::Minterpolate => Ok(Box::new(minterpolate::Minterpolate::open(progress)?)),
            Self::FlowFps => Ok(Box::new(flowfps::FlowFps::open(progress)?)),
            Self::Rife => Ok(Box::new(rife::Rife::open(progress)?)),
            Self::Rife4 => Ok(Box::new(rife::Rife4::open(progress)?)),
            Self::FsrFlow => Ok(Box::new(fsr::Fsr::open(fsr::Motion::Found, progress)?)),
            Self::FsrEngine | Self::Fsr => Ok(Box::new(fsr::Fsr::open(fsr::Motion::Given, progress)?)),
            Self::NoMotion => Ok(Box::new(Ours::no_motion()?)),
            Self::Paper => Ok(Box::new(Ours::paper(progress)?)),
            Self::Flow => Ok(Box::new(Ours::flow()?)),
            Self::Engine | Self::Truth => Ok(Box::new(Ours::of_clip()?)),
        }
    }
}

/// Parses a list such as `blend,cairn-flow`; `all` and `built-in` stand for several.
///
/// # Errors
/// `InvalidArgument` for an unknown name.
pub(super) fn parse(list: &str) -> Result<Vec<Kind>> {
    let mut chosen = Vec::new();
    for name in list.split(',').map(str::trim) {
        let found: Vec<Kind> = match name {
            "all" => KINDS.to_vec(),
            "built-in" => KINDS.into_iter().filter(|kind| kind.is_built_in()).collect(),
            name => KINDS.into_iter().filter(|kind| kind.name() == name).collect(),
        };
        if found.is_empty() {
            let names = KINDS.map(Kind::name).join(", ");
            return Err(Error::new(ErrorKind::InvalidArgument, format!("there is no row {name:?}"))
                .field("--rows")
                .remedy(format!("Use all, built-in, or any of {names}, with commas between")));
        }
        chosen.extend(found);
    }
    chosen.sort_unstable();
    chosen.dedup();
    Ok(chosen)
}

/// An interval and its surrounding anchors.
pub(super) struct Interval<'a> {
    /// Consecutive anchors.
    pub(super) anchors: &'a [Picture],
    /// The interval lies between `anchors[at]` and `anchors[at + 1]`.
    pub(super) at: usize,
    /// True motion and depth of the later anchor.
    pub(super) guidance: Option<&'a Guidance>,
    /// The same of the earlier one, if it has a predecessor.
    pub(super) before: Option<&'a Guidance>,
    /// Mask of the later anchor's head-up display: one byte per pixel, 0 where there is none.
    pub(super) overlay: Option<&'a [u8]>,
    /// The same of each anchor before the earlier one, in order up to it, as far as the row's history needs and the clip knows them.
    pub(super) history: &'a [Guidance],
}

impl Interval<'_> {
    /// The anchor before the interval.
    pub(super) fn previous(&self) -> &Picture {
        &self.anchors[self.at]
    }

    /// The anchor after the interval.
    pub(super) fn current(&self) -> &Picture {
        &self.anchors[self.at + 1]
    }
}

/// A method that is ready for work.
pub(super) trait Row {
    /// Program, version and settings for the report.
    fn version(&self) -> String;

    /// Changes with everything besides the anchors that affects its pictures.
    fn key(&self) -> String {
        self.version()
    }

    /// The pictures at `phases` of an interval, in that order.
    ///
    /// # Errors
    /// The program failed, or its output is not pictures of the anchors' size.
    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>>;
}

/// Selects those at `phases` from pictures at equal steps between two anchors.
fn at_phases(name: &str, made: &[Picture], phases: &[Phase]) -> Result<Vec<Picture>> {
    let steps = Phase::common(phases);
    let found = phases.iter().map(|phase| made.get(phase.step(steps)? as usize - 1).cloned());
    found.collect::<Option<Vec<Picture>>>().ok_or_else(|| {
        let cause = format!("it gave {} pictures of {}", made.len(), steps - 1);
        Error::new(ErrorKind::Unsupported, cause).field(name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amds_rows_are_of_another_program_that_makes_the_middle_after_earlier_anchors() {
        for kind in KINDS.into_iter().filter(|kind| kind.name().starts_with("fsr")) {
            assert!(!kind.is_built_in() && kind.history() > 0);
            assert!(kind.can_do(Phase::HALF) && !kind.can_do(Phase::QUARTER));
        }
        let given =
            [Kind::Fsr, Kind::FsrEngine, Kind::FsrFlow].map(|kind| (kind.needs_guidance(), kind.needs_engine()));
        assert_eq!(given, [(true, false), (true, true), (false, false)]);
    }

    #[test]
    fn lists_of_rows_follow_the_tables_order_and_slips_are_named() {
        assert_eq!(parse("cairn-flow, blend,cairn-flow").unwrap(), [Kind::Blend, Kind::Flow]);
        assert_eq!(parse("all").unwrap(), KINDS);
        assert!(parse("built-in").unwrap().iter().all(|kind| kind.is_built_in()));
        assert_eq!(parse("fsr,cairn-engine,fsr-flow").unwrap(), [Kind::FsrFlow, Kind::Fsr, Kind::Engine]);
        let error = parse("blend,best").unwrap_err();
        assert!(error.to_string().contains("cairn-truth"), "{error}");
    }
}
