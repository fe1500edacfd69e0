//! Which of its optional rules an algorithm applies. The library applies all; measurements leave out one at a time.

use std::marker::PhantomData;

/// An enum of at most 16 rules.
pub(crate) trait Rule: Copy {
    /// The number of the variant.
    fn index(self) -> u32;
}

/// The rules that apply; by default all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RuleSet<R> {
    bits: u16,
    rules: PhantomData<R>,
}

impl<R> Default for RuleSet<R> {
    fn default() -> Self {
        Self { bits: u16::MAX, rules: PhantomData }
    }
}

impl<R: Rule> RuleSet<R> {
    pub(crate) fn without(self, rule: R) -> Self {
        Self { bits: self.bits & !(1 << rule.index()), ..self }
    }

    pub(crate) fn has(self, rule: R) -> bool {
        self.bits >> rule.index() & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framegen::cpu::Rule as GeneratorRule;
    use crate::guidance::picture_flow::Rule as FlowRule;

    fn one_is_left_out<R: Rule + PartialEq + std::fmt::Debug>(all: &[R]) {
        for left_out in all {
            let rules = RuleSet::default().without(*left_out);
            for rule in all {
                assert_eq!(rules.has(*rule), rule != left_out, "{rule:?} without {left_out:?}");
            }
        }
    }

    #[test]
    fn one_rule_is_left_out_and_no_other() {
        one_is_left_out(&GeneratorRule::ALL);
        one_is_left_out(&FlowRule::ALL);
    }
}
