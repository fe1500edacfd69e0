//! Two reports side by side: verdicts that differ, and figures with their ratio.

use std::fmt::Write as _;

use crate::report::{Check, Figure, Report};

/// A figure of two reports.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair<'a> {
    /// Name of the check.
    pub check: &'a str,
    /// Name of the figure.
    pub name: &'a str,
    /// Its unit.
    pub unit: &'a str,
    /// Values in the first and in the second report.
    pub values: [f64; 2],
}

impl Pair<'_> {
    /// The second value in multiples of the first; none of zero.
    pub fn ratio(&self) -> Option<f64> {
        (self.values[0] != 0.0).then(|| self.values[1] / self.values[0])
    }
}

/// Figures that both reports have, in the first one's order.
pub fn figures<'a>(a: &'a Report, b: &'a Report) -> Vec<Pair<'a>> {
    let mut pairs = Vec::new();
    for (before, after) in common(a, b) {
        for figure in &before.figures {
            let same = |other: &&Figure| other.name == figure.name && other.unit == figure.unit;
            if let Some(other) = after.figures.iter().find(same) {
                let values = [figure.value, other.value];
                pairs.push(Pair { check: &before.name, name: &figure.name, unit: &figure.unit, values });
            }
        }
    }
    pairs
}

/// Checks that both reports have.
fn common<'a>(a: &'a Report, b: &'a Report) -> impl Iterator<Item = (&'a Check, &'a Check)> {
    a.checks.iter().filter_map(|check| Some((check, b.checks.iter().find(|other| other.name == check.name)?)))
}

/// The comparison as text.
pub fn text(a: &Report, b: &Report) -> String {
    let mut text = String::new();
    for (name, report) in [("A", a), ("B", b)] {
        let kind = if report.quick { ", quick" } else { "" };
        _ = writeln!(
            text,
            "{name}: {} on {}, Cairn {}{kind}",
            report.verdict,
            report.machine.adapter_name(),
            report.cairn
        );
    }
    let changed: Vec<_> = common(a, b).filter(|(a, b)| a.verdict != b.verdict).collect();
    _ = writeln!(text, "\nVerdicts that differ: {}", if changed.is_empty() { "none" } else { "" });
    for (before, after) in changed {
        _ = writeln!(text, "  {:18} {:12} {:12} {}", before.name, before.verdict, after.verdict, after.sentence);
    }
    for (name, one, other) in [("A", a, b), ("B", b, a)] {
        let only = one.checks.iter().filter(|check| !other.checks.iter().any(|found| found.name == check.name));
        let only: Vec<&str> = only.map(|check| check.name.as_str()).collect();
        if !only.is_empty() {
            _ = writeln!(text, "Only in {name}: {}", only.join(", "));
        }
    }
    let pairs = figures(a, b);
    if !pairs.is_empty() {
        _ = writeln!(text, "\n{:62} {:>12} {:>12} {:>8}", "Figures", "A", "B", "B / A");
    }
    for pair in pairs {
        let ratio = pair.ratio().map_or("-".to_owned(), |ratio| format!("{ratio:.2}"));
        let name = format!("{}: {}, {}", pair.check, pair.name, pair.unit);
        _ = writeln!(text, "{name:62} {:>12} {:>12} {ratio:>8}", number(pair.values[0]), number(pair.values[1]));
    }
    text
}

/// A value with about three significant digits.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if size > 0.0 && size < 1e-3 {
        return format!("{value:.1e}");
    }
    let digits = if size >= 100.0 || value == value.trunc() {
        0
    } else if size >= 10.0 {
        1
    } else if size >= 1.0 {
        2
    } else {
        3
    };
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Verdict;
    use crate::report::tests::{check, report};

    #[test]
    fn changed_verdicts_and_ratios_are_shown() {
        let a = report(vec![
            check("frames", Verdict::Pass, &[("1080p", 2.0), ("4K", 0.0)]),
            check("lives", Verdict::Pass, &[]),
            check("flow", Verdict::Pass, &[]),
        ]);
        let b = report(vec![
            check("frames", Verdict::Pass, &[("4K", 3.0), ("1080p", 5.0), ("720p", 1.0)]),
            check("lives", Verdict::Fail, &[]),
            check("window", Verdict::Pass, &[]),
        ]);
        let pairs = figures(&a, &b);
        assert_eq!(
            pairs.iter().map(|pair| (pair.name, pair.ratio())).collect::<Vec<_>>(),
            [("1080p", Some(2.5)), ("4K", None)]
        );
        let text = text(&a, &b);
        for part in [
            "lives              PASS         FAIL",
            "Only in A: flow",
            "Only in B: window",
            "2.50",
            "Verdicts that differ: \n",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("720p"));
        assert!(super::text(&a, &a).contains("Verdicts that differ: none"));
    }

    #[test]
    fn numbers_have_three_digits() {
        assert_eq!([0.123_45, 1.234, 12.34, 123.4, 5.0].map(number), ["0.123", "1.23", "12.3", "123", "5"]);
        assert_eq!([0.0, 9.4e-7].map(number), ["0", "9.4e-7"]);
    }
}
