//! The result of a check.

use std::fmt;

use cairn::{Error, ErrorKind, Picture};
use serde::{Deserialize, Serialize};

use crate::report::{Figure, PictureOfCheck};

/// What a check says of the machine, from the best to the worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// All that the check looks at is right.
    Pass,
    /// Something that the check needs is missing, so that it shows nothing.
    CannotTell,
    /// Something is wrong.
    Fail,
}

impl Verdict {
    /// The exit status of the program whose worst verdict this is: 0, 3 and 1. A wrong command line has 2.
    pub fn exit_status(self) -> u8 {
        match self {
            Self::Pass => 0,
            Self::CannotTell => 3,
            Self::Fail => 1,
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Pass => "PASS",
            Self::CannotTell => "CANNOT TELL",
            Self::Fail => "FAIL",
        })
    }
}

/// A verdict with its grounds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// The verdict.
    pub verdict: Verdict,
    /// What was seen, in a sentence.
    pub sentence: String,
    /// What to do, unless the check passed.
    pub remedy: Option<String>,
    /// Measured values.
    pub figures: Vec<Figure>,
    /// Pictures that show what was compared.
    pub pictures: Vec<PictureOfCheck>,
}

/// Result of a check's function. Both sides are findings: a check returns early with `?` where it cannot go on.
pub type Checked = Result<Finding, Finding>;

impl Finding {
    fn new(verdict: Verdict, sentence: impl Into<String>, remedy: Option<String>) -> Self {
        Self { verdict, sentence: sentence.into(), remedy, figures: Vec::new(), pictures: Vec::new() }
    }

    /// A check that passed.
    pub fn pass(sentence: impl Into<String>) -> Self {
        Self::new(Verdict::Pass, sentence, None)
    }

    /// A check that failed.
    pub fn fail(sentence: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(Verdict::Fail, sentence, Some(remedy.into()))
    }

    /// A check that shows nothing here.
    pub fn cannot_tell(sentence: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(Verdict::CannotTell, sentence, Some(remedy.into()))
    }

    /// `passed` or `failed` by a condition.
    pub fn judge(is_right: bool, sentence: impl Into<String>, remedy: &str) -> Self {
        if is_right { Self::pass(sentence) } else { Self::fail(sentence, remedy) }
    }

    /// Adds a measured value.
    #[must_use]
    pub fn figure(mut self, name: impl Into<String>, value: f64, unit: &str) -> Self {
        self.figures.push(Figure { name: name.into(), value, unit: unit.to_owned() });
        self
    }

    /// Adds measured values.
    #[must_use]
    pub fn figures(mut self, figures: impl IntoIterator<Item = Figure>) -> Self {
        self.figures.extend(figures);
        self
    }

    /// Adds a picture. One that cannot be encoded is left out.
    #[must_use]
    pub fn picture(mut self, caption: impl Into<String>, picture: &Picture) -> Self {
        self.pictures.extend(PictureOfCheck::new(caption.into(), picture));
        self
    }
}

/// What is missing is no fault of the machine; all other errors are.
impl From<Error> for Finding {
    fn from(error: Error) -> Self {
        let is_missing = matches!(error.kind(), ErrorKind::RuntimeMissing | ErrorKind::Unsupported);
        let place = error.offending_field().map_or(String::new(), |field| format!("{field}: "));
        let sentence = format!("{place}{}", error.cause());
        let remedy = error.remedy_text().map(str::to_owned);
        if is_missing {
            Self::new(
                Verdict::CannotTell,
                sentence,
                remedy.or_else(|| Some("Use another adapter or driver".to_owned())),
            )
        } else {
            Self::new(Verdict::Fail, sentence, remedy.or_else(|| Some(crate::checks::DRIVER.to_owned())))
        }
    }
}
