//! Verdicts, and the exit status that they give.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The result of a check. Ordered from best to worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// As it must be.
    Pass,
    /// Something that the check needs is missing here.
    CannotTell,
    /// Not as it must be.
    Fail,
}

impl Verdict {
    /// The worst of several; nothing to judge cannot be told.
    pub(crate) fn worst(all: impl IntoIterator<Item = Self>) -> Self {
        all.into_iter().max().unwrap_or(Self::CannotTell)
    }

    /// Exit status of the program: 0, 1 for a failure, 2 where nothing failed but something cannot be told.
    pub(crate) fn exit_status(self) -> u8 {
        match self {
            Self::Pass => 0,
            Self::Fail => 1,
            Self::CannotTell => 2,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_verdict_decides_the_exit_status() {
        use Verdict::{CannotTell, Fail, Pass};
        for (all, worst, status) in [
            (&[Pass, Pass][..], Pass, 0),
            (&[Pass, Fail, CannotTell], Fail, 1),
            (&[CannotTell, Pass], CannotTell, 2),
            (&[], CannotTell, 2),
        ] {
            let found = Verdict::worst(all.iter().copied());
            assert_eq!((found, found.exit_status()), (worst, status), "{all:?}");
        }
    }
}
