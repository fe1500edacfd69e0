//! The result of one check: a verdict with its reason, facts and figures.

use cairn::{Error, ErrorKind};
use serde::{Deserialize, Serialize};

use crate::verdict::Verdict;

/// What a check found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub(crate) verdict: Verdict,
    /// One sentence: the result, or the cause of another verdict than [`Verdict::Pass`].
    pub(crate) found: String,
    /// What to do about it; always set if the verdict is not [`Verdict::Pass`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) remedy: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) facts: Vec<Fact>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) figures: Vec<Figure>,
}

/// A property of the machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Fact {
    pub(crate) name: String,
    pub(crate) text: String,
}

/// A measured number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figure {
    /// Unique within its check.
    pub(crate) name: String,
    pub(crate) value: f64,
    pub(crate) unit: String,
    pub(crate) better: Better,
}

/// Which of two values of a figure is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Better {
    Lower,
    Higher,
    /// Neither: it only describes.
    Neither,
}

impl Outcome {
    fn new(verdict: Verdict, found: impl Into<String>, remedy: Option<String>) -> Self {
        Self { verdict, found: found.into(), remedy, facts: Vec::new(), figures: Vec::new() }
    }

    pub(crate) fn pass(found: impl Into<String>) -> Self {
        Self::new(Verdict::Pass, found, None)
    }

    pub(crate) fn fail(cause: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(Verdict::Fail, cause, Some(remedy.into()))
    }

    pub(crate) fn cannot_tell(cause: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(Verdict::CannotTell, cause, Some(remedy.into()))
    }

    #[must_use]
    pub(crate) fn fact(mut self, name: impl Into<String>, text: impl Into<String>) -> Self {
        self.facts.push(Fact { name: name.into(), text: text.into() });
        self
    }

    #[cfg(windows)]
    #[must_use]
    pub(crate) fn with_facts(mut self, facts: impl IntoIterator<Item = Fact>) -> Self {
        self.facts.extend(facts);
        self
    }

    #[must_use]
    pub(crate) fn figure(mut self, name: impl Into<String>, value: f64, unit: &str, better: Better) -> Self {
        self.figures.push(Figure { name: name.into(), value, unit: unit.to_owned(), better });
        self
    }

    #[must_use]
    pub(crate) fn with_figures(mut self, figures: impl IntoIterator<Item = Figure>) -> Self {
        self.figures.extend(figures);
        self
    }
}

/// A missing library, adapter or feature leaves the question open; every other error of the library is a failure.
impl From<Error> for Outcome {
    fn from(error: Error) -> Self {
        let field = error.offending_field().map(|field| format!("{field}: ")).unwrap_or_default();
        let found = format!("{field}{}", error.cause());
        let remedy = error.remedy_text().map(str::to_owned);
        match error.kind() {
            ErrorKind::RuntimeMissing | ErrorKind::Unsupported => {
                Self::cannot_tell(found, remedy.unwrap_or_else(|| "Run this on a machine that has it".into()))
            }
            kind => Self::fail(
                format!("{found} ({kind:?})"),
                remedy
                    .unwrap_or_else(|| "Update the graphics driver and run this again; if it stays, report it".into()),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_become_verdicts_with_cause_and_remedy() {
        let missing = Error::new(ErrorKind::RuntimeMissing, "no library").field("onnxruntime").remedy("Put it there");
        let outcome = Outcome::from(missing);
        assert_eq!(outcome, Outcome::cannot_tell("onnxruntime: no library", "Put it there"));
        let outcome = Outcome::from(Error::new(ErrorKind::DeviceRemoved, "gone"));
        assert_eq!((outcome.verdict, outcome.found.as_str()), (Verdict::Fail, "gone (DeviceRemoved)"));
        assert!(outcome.remedy.is_some());
    }
}
