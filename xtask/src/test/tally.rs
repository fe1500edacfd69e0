//! A runner's counts.

use std::fmt;

/// A test that was not run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Skip {
    pub(super) name: String,
    pub(super) reason: String,
}

/// Counts of one runner, or of all.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub(super) passed: usize,
    /// One line each.
    pub(super) failures: Vec<String>,
    pub(super) skips: Vec<Skip>,
}

impl Tally {
    /// A runner that could not run: one failure.
    pub(super) fn broken(why: impl Into<String>) -> Self {
        Self { failures: vec![why.into()], ..Self::default() }
    }

    /// One check that passed or, with `failure`, did not.
    pub(super) fn check(&mut self, failure: Option<String>) {
        match failure {
            None => self.passed += 1,
            Some(failure) => self.failures.push(failure),
        }
    }

    /// A check of a single command.
    pub(super) fn of_command(success: bool, failure: &str) -> Self {
        let mut tally = Self::default();
        tally.check((!success).then(|| failure.to_owned()));
        tally
    }

    pub(super) fn is_empty(&self) -> bool {
        self.passed == 0 && self.failures.is_empty() && self.skips.is_empty()
    }

    pub(super) fn add(&mut self, other: Self) {
        self.passed += other.passed;
        self.failures.extend(other.failures);
        self.skips.extend(other.skips);
    }

    /// Turns every skip that is not allowed into a failure.
    pub(super) fn fail_skips_unless(&mut self, allowed: impl Fn(&Skip) -> bool) {
        let (kept, refused) = std::mem::take(&mut self.skips).into_iter().partition(|skip| allowed(skip));
        self.skips = kept;
        let refused: Vec<Skip> = refused;
        self.failures.extend(
            refused.into_iter().map(|skip| {
                format!("{} was skipped ({}), which xtask/skips.toml does not allow", skip.name, skip.reason)
            }),
        );
    }

    /// The three numbers as columns of the table.
    pub(super) fn columns(&self) -> String {
        format!("{:>8}{:>8}{:>9}", self.passed, self.failures.len(), self.skips.len())
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} passed, {} failed, {} skipped", self.passed, self.failures.len(), self.skips.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_skip_that_is_not_allowed_fails() {
        let skip = |name: &str| Skip { name: name.to_owned(), reason: "why".to_owned() };
        let mut tally = Tally { passed: 1, skips: vec![skip("a"), skip("b")], ..Tally::default() };
        tally.fail_skips_unless(|skip| skip.name == "a");
        assert_eq!(tally.to_string(), "1 passed, 1 failed, 1 skipped");
        assert!(tally.failures[0].starts_with("b was skipped"));
    }
}
