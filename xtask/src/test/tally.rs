//! A runner's counts of tests and of checks.
//!
//! A test runs the library or a program and judges the result. A check reads a text, a list of files or a compiler's verdict: words, links,
//! options, code blocks, formatting. A failure of either counts as failed; passed tests and passed checks are counted separately.

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
    /// Number of tests that passed.
    pub(super) passed: usize,
    /// Number of checks that passed.
    pub(super) checks: usize,
    /// One line for each test or check that failed.
    pub(super) failures: Vec<String>,
    pub(super) skips: Vec<Skip>,
}

impl Tally {
    /// A runner that could not run: one failure.
    pub(super) fn broken(why: impl Into<String>) -> Self {
        Self { failures: vec![why.into()], ..Self::default() }
    }

    /// Counts a test, which failed if there is a `failure`.
    pub(super) fn test(&mut self, failure: Option<String>) {
        match failure {
            None => self.passed += 1,
            Some(failure) => self.failures.push(failure),
        }
    }

    /// Counts a check, which failed if there is a `failure`.
    pub(super) fn check(&mut self, failure: Option<String>) {
        match failure {
            None => self.checks += 1,
            Some(failure) => self.failures.push(failure),
        }
    }

    /// A single check, which passed if its command succeeded.
    pub(super) fn checked(success: bool, failure: &str) -> Self {
        let mut tally = Self::default();
        tally.check((!success).then(|| failure.to_owned()));
        tally
    }

    /// Whether no test and no check ran or was skipped.
    pub(super) fn is_empty(&self) -> bool {
        self.passed == 0 && self.checks == 0 && self.failures.is_empty() && self.skips.is_empty()
    }

    pub(super) fn add(&mut self, other: Self) {
        self.passed += other.passed;
        self.checks += other.checks;
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

    /// The heads of [`Tally::columns`].
    pub(super) fn column_heads() -> String {
        format!("{:>8}{:>8}{:>9}{:>8}", "passed", "failed", "skipped", "checks")
    }

    /// The numbers as columns of the closing table.
    pub(super) fn columns(&self) -> String {
        format!("{:>8}{:>8}{:>9}{:>8}", self.passed, self.failures.len(), self.skips.len(), self.checks)
    }

    /// The result of one runner: tests, then checks.
    pub(super) fn with_checks(&self) -> String {
        format!("{self}, {} check{}", self.checks, if self.checks == 1 { "" } else { "s" })
    }
}

/// The last line of a run, which continuous integration reads: passed checks are not in it.
impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} passed, {} failed, {} skipped", self.passed, self.failures.len(), self.skips.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_and_checks_are_counted_apart_and_fail_alike() {
        let mut tally = Tally::default();
        tally.test(None);
        tally.check(None);
        tally.check(None);
        assert_eq!(tally.to_string(), "1 passed, 0 failed, 0 skipped");
        assert_eq!(tally.with_checks(), "1 passed, 0 failed, 0 skipped, 2 checks");
        tally.test(Some("a test".to_owned()));
        tally.check(Some("a check".to_owned()));
        assert_eq!(tally.with_checks(), "1 passed, 2 failed, 0 skipped, 2 checks");
        assert_eq!(tally.failures, ["a test", "a check"]);
    }

    #[test]
    fn a_runner_with_checks_alone_is_not_empty() {
        assert!(Tally::default().is_empty());
        let readme = Tally { checks: 232, ..Tally::default() };
        assert!(!readme.is_empty());
        assert_eq!(readme.with_checks(), "0 passed, 0 failed, 0 skipped, 232 checks");
        assert!(!Tally::checked(true, "why").is_empty());
        assert_eq!(Tally::checked(false, "why").to_string(), "0 passed, 1 failed, 0 skipped");
    }

    #[test]
    fn the_sum_of_runners_has_all_their_tests_and_checks() {
        let mut total = Tally::default();
        total.add(Tally { passed: 3, ..Tally::default() });
        total.add(Tally { checks: 5, failures: vec!["a link".to_owned()], ..Tally::default() });
        assert_eq!(total.to_string(), "3 passed, 1 failed, 0 skipped");
        assert_eq!(total.checks, 5);
        // A column for each head, in its order.
        let heads = Tally::column_heads();
        assert_eq!(heads.split_whitespace().collect::<Vec<_>>(), ["passed", "failed", "skipped", "checks"]);
        assert_eq!(total.columns().split_whitespace().collect::<Vec<_>>(), ["3", "1", "0", "5"]);
        assert_eq!(total.columns().len(), heads.len());
    }

    #[test]
    fn a_skip_that_is_not_allowed_fails() {
        let skip = |name: &str| Skip { name: name.to_owned(), reason: "why".to_owned() };
        let mut tally = Tally { passed: 1, skips: vec![skip("a"), skip("b")], ..Tally::default() };
        tally.fail_skips_unless(|skip| skip.name == "a");
        assert_eq!(tally.to_string(), "1 passed, 1 failed, 1 skipped");
        assert!(tally.failures[0].starts_with("b was skipped"));
    }
}
