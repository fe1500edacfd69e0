//! The optional rules of the search, which measurements leave out one at a time.

use crate::rule_set;

/// A rule without which motion is still found. The library applies all of them; `study ablate` measures what each one gains.
#[doc(hidden)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Compares all motions nearby on small levels where the match is poor.
    WideSearch,
    /// Searches again from the smoothed motion and from the neighbours' on all levels but the finest.
    RepeatedSearch,
    /// Fits one motion to the whole picture and starts from it as well.
    GlobalModel,
    /// Replaces motion that the flow in the other direction contradicts.
    ConsistencyCheck,
    /// Extrapolates the motion that fills holes along its gradient.
    FillByGradient,
}

impl Rule {
    /// All rules, in the order in which they apply.
    pub const ALL: [Self; 5] =
        [Self::WideSearch, Self::RepeatedSearch, Self::GlobalModel, Self::ConsistencyCheck, Self::FillByGradient];
}

impl rule_set::Rule for Rule {
    fn index(self) -> u32 {
        self as u32
    }
}

/// The rules that an extractor applies.
pub(super) type Rules = rule_set::RuleSet<Rule>;
