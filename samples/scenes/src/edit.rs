//! The edit list of a clip: camera cuts, cross-fades, fades and flashes at world times.
//!
//! As text an edit list has an edit per line, or between semicolons; `#` begins a comment:
//!
//! ```text
//! 2      cut 12,-8,90            # the walker jumps to 12 m east, 8 m south, and looks east
//! 3..3.5 fade-out black          # the picture becomes black, and stays so until a fade-in
//! 3.5..4 fade-in black
//! 5..5.6 cross-fade 0,40,180     # both shots are drawn and mixed
//! 7..7.1 flash 0.8               # 80 % of the way to white at 7 s, fading until 7.1 s
//! ```
//!
//! Times are seconds of world time. Fades and mixtures are taken between 8-bit sRGB code values, as video editors do.

use std::ops::Range;
use std::str::FromStr;

use cairn::{Error, ErrorKind, Picture, Result};

use crate::walk::Start;

/// Colour that a picture fades to or from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FadeColour {
    /// Code value 0.
    Black,
    /// Code value 255.
    White,
}

impl FadeColour {
    fn code(self) -> f32 {
        match self {
            Self::Black => 0.0,
            Self::White => 255.0,
        }
    }
}

/// One edit. Times are seconds of world time.
#[derive(Debug, Clone, PartialEq)]
pub enum Edit {
    /// From the time `at` on, the walker is at `start`; the script goes on. Motion of the first frame after it is non-finite everywhere.
    Cut {
        /// Time of the cut, above 0. It takes place at the walker's first step at or after this time; steps are 1/120 s or shorter.
        at: f64,
        /// Where the new shot starts.
        start: Start,
    },
    /// Both shots are drawn during `time` and mixed linearly. Depth and motion are those of the incoming shot from the beginning on.
    CrossFade {
        /// First and last moment of the mixture.
        time: Range<f64>,
        /// Where the incoming shot starts.
        start: Start,
    },
    /// The picture becomes `colour` during `time` and stays so until the next fade-in.
    FadeOut {
        /// From the first change to the uniform picture.
        time: Range<f64>,
        /// The colour at its end.
        colour: FadeColour,
    },
    /// The picture is `colour` at the beginning of `time` and itself at the end.
    FadeIn {
        /// From the uniform picture to the unchanged one.
        time: Range<f64>,
        /// The colour at its beginning.
        colour: FadeColour,
    },
    /// The picture is mixed with white: `strength` at the beginning of `time`, decreasing linearly to none.
    Flash {
        /// From the brightest moment to the unchanged picture.
        time: Range<f64>,
        /// Share of white at the beginning, above 0 to 1.
        strength: f32,
    },
}

impl Edit {
    fn time(&self) -> Range<f64> {
        match self {
            Self::Cut { at, .. } => *at..*at,
            Self::CrossFade { time, .. }
            | Self::FadeOut { time, .. }
            | Self::FadeIn { time, .. }
            | Self::Flash { time, .. } => time.clone(),
        }
    }

    /// Edits of one track must not overlap: shots, fades, flashes.
    fn track(&self) -> usize {
        match self {
            Self::Cut { .. } | Self::CrossFade { .. } => 0,
            Self::FadeOut { .. } | Self::FadeIn { .. } => 1,
            Self::Flash { .. } => 2,
        }
    }
}

/// A change of shot: the time it begins and ends, equal for a cut, and the start of the new shot.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShotChange {
    pub(crate) time: Range<f64>,
    pub(crate) start: Start,
}

/// Edits in order of time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EditList {
    edits: Vec<Edit>,
}

fn refuse(cause: String, remedy: &str) -> Error {
    Error::new(ErrorKind::InvalidArgument, cause).field("edits").remedy(remedy)
}

impl EditList {
    /// Sorts and checks `edits`.
    ///
    /// # Errors
    /// `InvalidArgument` for a time that is negative or not finite, a cut or cross-fade at 0, a duration of 0 or less, a strength outside
    /// (0, 1], or two changes of shot, two fades or two flashes that overlap.
    pub fn new(mut edits: Vec<Edit>) -> Result<Self> {
        for edit in &edits {
            let time = edit.time();
            if !(time.start >= 0.0 && time.end.is_finite()) {
                return Err(refuse(format!("{edit:?} is at no time"), "Use seconds from 0 on"));
            }
            let instant = matches!(edit, Edit::Cut { .. });
            if !instant && time.end <= time.start {
                return Err(refuse(format!("{edit:?} takes no time"), "Let it end after it begins"));
            }
            if edit.track() == 0 && time.start <= 0.0 {
                return Err(refuse(format!("{edit:?} is at the start of the clip"), "Start the clip there instead"));
            }
            if matches!(edit, Edit::Flash { strength, .. } if !(*strength > 0.0 && *strength <= 1.0)) {
                return Err(refuse(format!("{edit:?} has no strength from 0 to 1"), "Use 1 for a white picture"));
            }
        }
        edits.sort_by(|a, b| a.time().start.total_cmp(&b.time().start));
        for track in 0..3 {
            let of_track: Vec<&Edit> = edits.iter().filter(|e| e.track() == track).collect();
            for pair in of_track.windows(2) {
                let (first, second) = (pair[0].time(), pair[1].time());
                if second.start < first.end || second.start == first.start {
                    let cause = format!("{:?} begins before the end of {:?}", pair[1], pair[0]);
                    return Err(refuse(cause, "Let the edits follow one another"));
                }
            }
        }
        Ok(Self { edits })
    }

    /// The edits in order of time.
    pub fn edits(&self) -> &[Edit] {
        &self.edits
    }

    /// All edits of both lists.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn joined(mut self, other: Self) -> Result<Self> {
        self.edits.extend(other.edits);
        Self::new(self.edits)
    }

    pub(crate) fn shot_changes(&self) -> Vec<ShotChange> {
        let change = |edit: &Edit| match edit {
            Edit::Cut { start, .. } | Edit::CrossFade { start, .. } => {
                Some(ShotChange { time: edit.time(), start: *start })
            }
            _ => None,
        };
        self.edits.iter().filter_map(change).collect()
    }

    /// How fades and flashes change a picture at world time `seconds`.
    pub fn grade(&self, seconds: f64) -> Grade {
        let mut grade = Grade::default();
        for edit in self.edits.iter().take_while(|edit| edit.time().start <= seconds) {
            let time = edit.time();
            let part = ((seconds - time.start) / (time.end - time.start)).min(1.0) as f32;
            match edit {
                Edit::FadeOut { colour, .. } => grade.fade = (*colour, part),
                Edit::FadeIn { colour, .. } => grade.fade = (*colour, 1.0 - part),
                Edit::Flash { strength, .. } => grade.flash = strength * (1.0 - part),
                Edit::Cut { .. } | Edit::CrossFade { .. } => {}
            }
        }
        grade
    }
}

impl FromStr for EditList {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let lines =
            text.lines().map(|line| line.split('#').next().unwrap_or_default()).flat_map(|line| line.split(';'));
        Self::new(lines.map(str::trim).filter(|line| !line.is_empty()).map(parse_edit).collect::<Result<_>>()?)
    }
}

fn parse_edit(line: &str) -> Result<Edit> {
    const REMEDY: &str = "Write `2 cut EAST,NORTH,YAW`, `5..5.6 cross-fade EAST,NORTH,YAW`, `3..3.5 fade-out black`, \
                          `3.5..4 fade-in white` or `7..7.1 flash 0.8`, with times in seconds";
    let wrong = |why: &str| refuse(format!("`{line}` is no edit: {why}"), REMEDY);
    let words: Vec<&str> = line.split_whitespace().collect();
    let &[when, what, how] = words.as_slice() else { return Err(wrong("it has not three words")) };
    let seconds = |text: &str| text.parse::<f64>().map_err(|_| wrong(&format!("{text} is no time")));
    let span = || {
        let (from, until) = when.split_once("..").ok_or_else(|| wrong("it needs two times, FROM..UNTIL"))?;
        Ok(seconds(from)?..seconds(until)?)
    };
    let start = || how.parse::<Start>().map_err(|why| wrong(&why));
    let colour = || match how {
        "black" => Ok(FadeColour::Black),
        "white" => Ok(FadeColour::White),
        _ => Err(wrong("the colour is black or white")),
    };
    Ok(match what {
        "cut" => Edit::Cut { at: seconds(when)?, start: start()? },
        "cross-fade" => Edit::CrossFade { time: span()?, start: start()? },
        "fade-out" => Edit::FadeOut { time: span()?, colour: colour()? },
        "fade-in" => Edit::FadeIn { time: span()?, colour: colour()? },
        "flash" => {
            let strength = how.parse().map_err(|_| wrong("the strength is no number"))?;
            Edit::Flash { time: span()?, strength }
        }
        _ => return Err(wrong(&format!("{what} is not known"))),
    })
}

/// Fade and flash of one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grade {
    /// A colour and its share, 0 for the unchanged picture to 1 for the colour alone.
    pub fade: (FadeColour, f32),
    /// Share of white that a flash adds after the fade, 0 to 1.
    pub flash: f32,
}

impl Default for Grade {
    /// The unchanged picture.
    fn default() -> Self {
        Self { fade: (FadeColour::Black, 0.0), flash: 0.0 }
    }
}

impl Grade {
    /// Whether pictures stay as they are.
    pub fn is_neutral(&self) -> bool {
        self.fade.1 == 0.0 && self.flash == 0.0
    }

    /// Mixes each code value of `picture` with the fade's colour, then with white.
    pub fn apply(&self, picture: &mut Picture) {
        if self.is_neutral() {
            return;
        }
        let (colour, share) = self.fade;
        let curve: Vec<u8> = (0..=255_u8)
            .map(|code| {
                let faded = f32::from(code) + (colour.code() - f32::from(code)) * share;
                (faded + (255.0 - faded) * self.flash + 0.5) as u8
            })
            .collect();
        for pixel in picture.pixels_mut() {
            for code in &mut pixel[..3] {
                *code = curve[usize::from(*code)];
            }
        }
    }
}

/// Mixes `over` into `picture` with a share of 0 to 1, between code values. Both have the same size.
pub(crate) fn mix(picture: &mut Picture, over: &Picture, share: f32) {
    for (below, above) in picture.pixels_mut().iter_mut().zip(over.pixels()) {
        for (b, a) in below.iter_mut().zip(above) {
            *b = (f32::from(*b) + (f32::from(*a) - f32::from(*b)) * share + 0.5) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_read_in_any_order() {
        let list: EditList =
            "7..7.1 flash 0.8; 3..3.5 fade-out black # dark\n\n2 cut 12,-8,90\n5..5.6 cross-fade 0,40,180"
                .parse()
                .unwrap();
        let start = |text: &str| text.parse::<Start>().unwrap();
        assert_eq!(
            list.edits(),
            [
                Edit::Cut { at: 2.0, start: start("12,-8,90") },
                Edit::FadeOut { time: 3.0..3.5, colour: FadeColour::Black },
                Edit::CrossFade { time: 5.0..5.6, start: start("0,40,180") },
                Edit::Flash { time: 7.0..7.1, strength: 0.8 },
            ]
        );
        assert_eq!(EditList::default(), "# nothing".parse().unwrap());
    }

    #[test]
    fn wrong_edits_are_refused_with_a_remedy() {
        for wrong in [
            "2 cut",
            "2..3 cut 0,0,0",
            "0 cut 0,0,0",
            "-1 cut 0,0,0",
            "NaN cut 0,0,0",
            "2 cut 0,0",
            "2 fade-out black",
            "2..2 fade-out black",
            "2..3 fade-out red",
            "2..3 flash 0",
            "2..3 flash 1.5",
            "2..inf flash 1",
            "2..3 wipe 1",
            "2..3 fade-out black; 2.5..4 fade-in black",
            "2..3 cross-fade 0,0,0; 2.5 cut 1,1,1",
            "2 cut 0,0,0; 2 cut 1,1,1",
        ] {
            let error = wrong.parse::<EditList>().expect_err(wrong);
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::InvalidArgument, Some("edits")), "{wrong}");
            assert!(error.remedy_text().is_some(), "{wrong}");
        }
        // Different tracks may overlap, and edits may follow each other without a gap.
        "2..3 fade-out black; 3..4 fade-in black; 2.5 cut 0,0,0; 2.4..2.6 flash 1".parse::<EditList>().unwrap();
    }

    #[test]
    fn fades_have_their_brightness_at_their_times() {
        let list: EditList = "1..2 fade-out black; 3..5 fade-in white; 6..7 flash 0.5".parse().unwrap();
        let code = |seconds: f64| {
            let mut picture = Picture::from_rgba(1, 1, vec![200, 100, 0, 255]).unwrap();
            list.grade(seconds).apply(&mut picture);
            picture.pixels()[0]
        };
        assert_eq!(code(0.5), [200, 100, 0, 255]);
        assert_eq!(code(1.25), [150, 75, 0, 255]);
        assert_eq!(code(1.5), [100, 50, 0, 255]);
        assert_eq!(code(2.0), [0, 0, 0, 255]);
        assert_eq!(code(2.9), [0, 0, 0, 255]);
        assert_eq!(code(3.0), [255; 4]);
        assert_eq!(code(4.0), [228, 178, 128, 255]);
        assert_eq!(code(5.5), [200, 100, 0, 255]);
        assert_eq!(code(6.0), [228, 178, 128, 255]);
        assert_eq!(code(6.5), [214, 139, 64, 255]);
        assert_eq!(code(7.0), [200, 100, 0, 255]);
    }
}
