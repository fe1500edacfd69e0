//! The optional rules of the search, which measurements leave out one at a time.

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

/// The rules that an extractor applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rules(u8);

impl Default for Rules {
    /// All of them.
    fn default() -> Self {
        Self(u8::MAX)
    }
}

impl Rules {
    pub(super) fn without(self, rule: Rule) -> Self {
        Self(self.0 & !(1 << rule as u8))
    }

    pub(super) fn has(self, rule: Rule) -> bool {
        self.0 >> rule as u8 & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_rule_is_left_out_and_no_other() {
        for left_out in Rule::ALL {
            let rules = Rules::default().without(left_out);
            assert!(Rule::ALL.iter().all(|rule| rules.has(*rule) == (*rule != left_out)));
        }
    }
}
