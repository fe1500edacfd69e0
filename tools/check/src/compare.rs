//! Compares two reports: verdicts, facts and figures that differ.

use crate::outcome::{Better, Figure};
use crate::page::shown;
use crate::report::{Line, Report};
use crate::verdict::Verdict;

/// The differences of two reports.
pub(crate) struct Comparison {
    /// Text lines for people.
    pub(crate) text: String,
    /// [`Verdict::Fail`] if B is worse than A in a verdict or a figure, [`Verdict::CannotTell`] if nothing can be compared.
    pub(crate) verdict: Verdict,
}

/// Compares B with A. A figure is worse if it differs by more than `tolerance`, a fraction, for the worse.
pub(crate) fn compare(a: &Report, b: &Report, tolerance: f64) -> Comparison {
    let mut text = format!(
        "A  {}, Cairn {}, {}\nB  {}, Cairn {}, {}\n\n",
        a.started,
        a.cairn,
        a.summary(),
        b.started,
        b.cairn,
        b.summary()
    );
    let (mut compared, mut worse) = (0, 0);
    let measured = !a.short && !b.short;
    for line in &b.lines {
        let Some(before) = a.lines.iter().find(|before| before.id == line.id) else {
            text += &format!("{}: only in B, {}\n", line.id, line.outcome.verdict);
            continue;
        };
        compared += 1;
        let (from, to) = (before.outcome.verdict, line.outcome.verdict);
        if from != to {
            let mark = if to > from { "WORSE " } else { "better" };
            worse += usize::from(to > from);
            text += &format!("{mark}  {}: {from} became {to}: {}\n", line.id, line.outcome.found);
        }
        text += &facts(before, line);
        for figure in &line.outcome.figures {
            let of_before = |f: &&Figure| f.name == figure.name && f.unit == figure.unit;
            let Some(old) = before.outcome.figures.iter().find(of_before) else { continue };
            let Some((mark, is_worse)) = change(old, figure, tolerance).filter(|_| measured) else { continue };
            worse += usize::from(is_worse);
            let percent = 100.0 * (figure.value / old.value - 1.0);
            text += &format!(
                "{mark}  {}: {}: {} became {} ({percent:+.0} %)\n",
                line.id,
                figure.name,
                shown(old),
                shown(figure)
            );
        }
    }
    for line in a.lines.iter().filter(|line| b.lines.iter().all(|after| after.id != line.id)) {
        text += &format!("{}: only in A, {}\n", line.id, line.outcome.verdict);
    }
    if !measured {
        text += "Figures are not compared: a report is of a short run.\n";
    }
    let verdict = match (compared, worse) {
        (0, _) => Verdict::CannotTell,
        (_, 0) => Verdict::Pass,
        _ => Verdict::Fail,
    };
    text += &format!("\n{compared} lines compared, {worse} worse in B\n");
    Comparison { text, verdict }
}

/// Facts that differ.
fn facts(before: &Line, line: &Line) -> String {
    let changed = line.outcome.facts.iter().filter_map(|fact| {
        let old = before.outcome.facts.iter().find(|old| old.name == fact.name)?;
        (old.text != fact.text)
            .then(|| format!("other   {}: {}: {} became {}\n", line.id, fact.name, old.text, fact.text))
    });
    changed.collect()
}

/// The mark of a figure that differs by more than `tolerance`, and whether it is worse.
fn change(old: &Figure, new: &Figure, tolerance: f64) -> Option<(&'static str, bool)> {
    let limit = tolerance * old.value.abs();
    let grown = new.value - old.value;
    let worse_by = match new.better {
        Better::Lower => grown,
        Better::Higher => -grown,
        Better::Neither => return None,
    };
    if worse_by > limit {
        Some(("WORSE ", true))
    } else if -worse_by > limit {
        Some(("better", false))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outcome::Outcome;
    use crate::report::tests::report;

    fn timed(milliseconds: f64, decibels: f64) -> Outcome {
        let outcome = Outcome::pass("measured").figure("4K", milliseconds, "ms", Better::Lower);
        outcome.figure("PSNR", decibels, "dB", Better::Higher).fact("driver", format!("{milliseconds}"))
    }

    #[test]
    fn worse_figures_and_verdicts_are_found_and_better_ones_are_not_held_against_b() {
        let of = |b: Outcome| compare(&report([timed(10.0, 30.0)]), &report([b]), 0.1);
        let same = of(timed(10.9, 28.0));
        assert!(same.verdict == Verdict::Pass && same.text.contains("driver: 10 became 10.9"), "{}", same.text);
        let faster = of(timed(5.0, 30.0));
        assert!(faster.verdict == Verdict::Pass && faster.text.contains("better  line-0: 4K"), "{}", faster.text);
        let slower = of(timed(12.0, 30.0));
        assert!(slower.verdict == Verdict::Fail && slower.text.contains("became 12.00 ms (+20 %)"), "{}", slower.text);
        assert_eq!(of(timed(10.0, 20.0)).verdict, Verdict::Fail);
        let broken = of(Outcome::fail("black", "report it"));
        assert!(broken.verdict == Verdict::Fail && broken.text.contains("PASS became FAIL"), "{}", broken.text);
    }

    #[test]
    fn figures_of_short_runs_are_not_compared_and_nothing_in_common_cannot_be_told() {
        let (a, mut b) = (report([timed(10.0, 30.0)]), report([timed(90.0, 30.0)]));
        b.short = true;
        assert_eq!(compare(&a, &b, 0.1).verdict, Verdict::Pass);
        b.lines[0].id = "another".into();
        let none = compare(&a, &b, 0.1);
        assert!(none.verdict == Verdict::CannotTell && none.text.contains("only in A"), "{}", none.text);
    }
}
