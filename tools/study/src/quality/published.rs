//! The published page against the table beside it, and its claims against what is measured now.
//!
//! `docs/quality.md` and `docs/quality.csv` are written by one run. The tests read both again, so that neither is changed alone and no
//! verdict differs from its figures.

use std::fs;

use cairn::{Error, ErrorKind, Result};

use super::claims::{self, Claim, MEASURES, Tally, Verdict};
use super::rows::KINDS;
use super::table::{Table, is_better, measures};
use super::{REPORT, SUMMARY, report, speed};
use crate::experiment::files::docs;
use media::describe_io;

/// The claims of a page: the verdict, the claim, and the figures that decide it.
fn claims_of(page: &str) -> Vec<Claim> {
    let claim = |line: &str| {
        let mut cells = line.strip_prefix("| ")?.strip_suffix(" |")?.split(" | ");
        let cell = cells.next()?;
        let all = [Verdict::Held, Verdict::Missed, Verdict::NotJudged];
        let verdict = all.into_iter().find(|verdict| verdict.label() == cell)?;
        Some(Claim { what: cells.next()?.to_owned(), verdict, figures: cells.next()?.to_owned() })
    };
    page.lines().filter_map(claim).collect()
}

/// Every difference between the published page and the table beside it.
///
/// # Errors
/// `Io`; `InvalidArgument` for a damaged table.
pub(super) fn disagreements() -> Result<Vec<String>> {
    differences(&read(REPORT)?, &read(SUMMARY)?)
}

fn read(name: &str) -> Result<String> {
    let path = docs().join(name);
    fs::read_to_string(&path).map_err(|e| describe_io("cannot be read", &path, &e))
}

/// Every difference between a page and the table that it was made from, and every verdict that its figures contradict.
fn differences(page: &str, csv: &str) -> Result<Vec<String>> {
    let table = Table::parse(csv)?;
    let mut found = Vec::new();
    let lines: Vec<&str> = page.lines().collect();
    for wanted in report::of_table(&table).lines().filter(|line| line.starts_with('|')) {
        if !lines.iter().any(|line| is_same(line, wanted)) {
            found.push(format!("{REPORT} lacks a line that {SUMMARY} gives: {wanted}"));
        }
    }
    let (judged, stated) = (claims::judge(&table), claims_of(page));
    for claim in &judged {
        match stated.iter().find(|c| c.what == claim.what) {
            None => found.push(format!("{REPORT} does not state the claim \"{}\"", claim.what)),
            Some(c) if c.verdict != claim.verdict => {
                found.push(format!("{REPORT} says otherwise than {SUMMARY}: {claim}"));
            }
            Some(c) if !is_same(&c.figures, &claim.figures) => {
                found.push(format!("{REPORT} has other figures than {SUMMARY}: {claim}"));
            }
            Some(_) => {}
        }
    }
    for claim in stated.iter().filter(|c| !judged.iter().any(|j| j.what == c.what)) {
        match speed::verdict(&claim.what, &claim.figures) {
            None => found.push(format!("{REPORT} states a claim that nothing decides: \"{}\"", claim.what)),
            Some(verdict) if verdict != claim.verdict => {
                found.push(format!("{REPORT} says otherwise than its own figure: {claim}"));
            }
            Some(_) => {}
        }
    }
    let count = format!("\n{};", Tally::of(&stated));
    if !page.contains(&count) {
        found.push(format!("{REPORT} does not say that {}", Tally::of(&stated)));
    }
    Ok(found)
}

/// Whether two lines are equal but for emphasis and rounding: a number of the table was rounded once before it is rounded for the page.
fn is_same(a: &str, b: &str) -> bool {
    let plain = |line: &str| line.replace("**", "");
    let (a, b) = (plain(a), plain(b));
    let (a, b): (Vec<&str>, Vec<&str>) = (a.split_whitespace().collect(), b.split_whitespace().collect());
    a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| a == b || is_near(a, b))
}

/// Whether two words are numbers with the same digits but for one unit of the last.
fn is_near(a: &str, b: &str) -> bool {
    const AROUND: [char; 5] = ['(', ')', ',', ';', '+'];
    let trim = |word: &str| word.trim_matches(AROUND).to_owned();
    let places = |word: &str| word.split_once('.').map(|(_, digits)| digits.len());
    let (a, b) = (trim(a), trim(b));
    let (Some(x), Some(y)) = (places(&a), places(&b)) else { return false };
    let numbers = a.parse::<f64>().ok().zip(b.parse::<f64>().ok());
    x == y && numbers.is_some_and(|(a, b)| (a - b).abs() < 1.5 * 10_f64.powi(-(x as i32)))
}

/// What a few frames of other footage say about a claim of the published page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Evidence {
    /// They agree with the page.
    Agrees,
    /// A row that the page calls better is behind, by less than the clips of the page differ among themselves.
    TooClose(String),
    /// It is behind by more.
    Contradicts(String),
}

/// How far behind a rival a row of a held claim may be on a few frames: PSNR in dB, SSIM, LPIPS. On the page's own clips of one kind of
/// place, the lead of true motion over `picture_flow` ranges over 0.18 dB, 0.0002 and 0.0002 (desert-5 to desert-7).
const TOLERANCES: [f64; 3] = [0.1, 0.0005, 0.0005];

/// Each claim of the published page that `table` can decide, and whether the table agrees. The table may have fewer rows than the page.
///
/// # Errors
/// `Io`; `InvalidState` if the page states no claim.
pub(super) fn evidence(table: &Table) -> Result<Vec<(String, Evidence)>> {
    let stated = claims_of(&read(REPORT)?);
    if stated.is_empty() {
        return Err(Error::new(ErrorKind::InvalidState, "the published page states no claim").field(REPORT));
    }
    let decided = claims::judge(table).into_iter().filter_map(|now| {
        let (mine, rivals) = parts(&now.what)?;
        let same = |claim: &&Claim| {
            parts(&claim.what).is_some_and(|(c, all)| c == mine && rivals.iter().all(|rival| all.contains(rival)))
        };
        let claim = stated.iter().find(same)?;
        let is_lost = (claim.verdict, now.verdict) == (Verdict::Held, Verdict::Missed);
        let evidence = match (is_lost, is_behind(table, mine, &rivals)?) {
            (false, _) => Evidence::Agrees,
            (true, false) => Evidence::TooClose(now.figures),
            (true, true) => Evidence::Contradicts(format!("{REPORT} says that it holds, and here: {}", now.figures)),
        };
        Some((format!("claim {}", now.what), evidence))
    });
    Ok(decided.collect())
}

/// Whether the row of a claim is behind any of `rivals` by more than [`TOLERANCES`] in a measure that the claim names; `None` if the table
/// lacks the row.
fn is_behind(table: &Table, [row, claimed]: [&str; 2], rivals: &[&str]) -> Option<bool> {
    let (group, row) = row.split_once(": ")?;
    let scores = |name: &str| {
        let kind = KINDS.into_iter().find(|kind| kind.name() == name)?;
        Some(measures(&table.group(2, group, kind)?.score))
    };
    let own = scores(row)?;
    Some(rivals.iter().filter_map(|rival| scores(rival)).any(|rival| {
        (0..MEASURES.len()).filter(|i| claimed.split(", ").any(|name| name == MEASURES[*i])).any(|i| {
            let pair = own[i].zip(rival[i]);
            pair.is_some_and(|(own, rival)| is_better(i, rival, own) && (rival - own).abs() > TOLERANCES[i])
        })
    }))
}

/// A claim about pictures without its rivals, such as `snow: cairn-flow` and `PSNR`, and the rivals.
fn parts(what: &str) -> Option<([&str; 2], Vec<&str>)> {
    let (row, rest) = what.split_once(" beats ")?;
    let (rivals, measures) = rest.split_once(" in ")?;
    Some(([row, measures], rivals.split(", ").collect()))
}

#[cfg(test)]
mod tests {
    use super::super::rows::Kind;
    use super::super::table::tests::record;
    use super::*;

    #[test]
    fn the_published_page_says_what_the_table_beside_it_says() {
        let found = disagreements().unwrap();
        assert!(found.is_empty(), "make both anew with `study quality --speed --publish`:\n{}", found.join("\n"));
    }

    #[test]
    fn a_changed_figure_or_verdict_of_page_or_table_is_found() {
        let (page, csv) = (read(REPORT).unwrap(), read(SUMMARY).unwrap());
        let stated = claims_of(&page);
        let wrong = |page: &str, csv: &str| !differences(page, csv).unwrap().is_empty();
        let with_verdict = |claim: &Claim, other: Verdict| {
            let [from, to] = [claim.verdict, other].map(|verdict| format!("| {} | {}", verdict.label(), claim.what));
            page.replace(&from, &to)
        };
        // Each verdict, changed alone.
        for claim in &stated {
            let other = if claim.verdict == Verdict::Held { Verdict::Missed } else { Verdict::Held };
            let changed = with_verdict(claim, other);
            assert!(changed != page && wrong(&changed, &csv), "{claim}");
        }
        // A claim that is judged is not said not to be.
        for claim in [stated.first(), stated.last()].into_iter().flatten() {
            assert!(
                claim.verdict != Verdict::NotJudged && wrong(&with_verdict(claim, Verdict::NotJudged), &csv),
                "{claim}"
            );
        }
        // A group's mean of the table, moved by a hundredth of a dB.
        let line = csv.lines().find(|line| line.starts_with("2,snow,,cairn-flow,")).unwrap();
        let psnr = line.split(',').nth(5).unwrap();
        let moved = line.replace(psnr, &format!("{:.4}", psnr.parse::<f64>().unwrap() - 0.04));
        assert!(wrong(&page, &csv.replace(line, &moved)));
        assert!(wrong(&page.replace(" claims held", " claims stand"), &csv));
        let known = stated[0].what.clone();
        assert!(wrong(&page.replace(&known, "meadow: cairn-truth beats blend in PSNR"), &csv));
    }

    #[test]
    fn numbers_may_differ_by_one_unit_of_their_last_digit() {
        assert!(is_same("| **39.71** / 0.9830 |", "| 39.72 / 0.9830 |"));
        assert!(is_same("PSNR 39.71, better than 39.42 of rife;", "PSNR 39.70, better than 39.42 of rife;"));
        assert!(
            !is_same("| 39.71 |", "| 39.73 |")
                && !is_same("| 39.71 |", "| 39.7 |")
                && !is_same("| rife |", "| blend |")
        );
        assert!(!is_same("12 of 12", "11 of 12"));
    }

    #[test]
    fn a_claim_that_is_stated_and_not_held_now_is_named() {
        let stated = claims_of(&read(REPORT).unwrap());
        let held =
            stated.iter().find(|c| c.verdict == Verdict::Held && c.what.starts_with("snow: cairn-truth")).unwrap();
        assert!(parts(&held.what).unwrap().1.contains(&"rife"));
        let snow = |truth: f64| {
            let table = Table::new(&[
                record("snow-4", Kind::Blend, 25.0, Some(0.02)),
                record("snow-4", Kind::Flow, 30.0, Some(0.02)),
                record("snow-4", Kind::Truth, truth, Some(0.01)),
            ]);
            let mut found = evidence(&table).unwrap();
            assert_eq!(found.len(), 2);
            let (what, evidence) = found.swap_remove(0);
            assert!(what.starts_with("claim snow: cairn-truth beats blend, cairn-flow in PSNR"), "{what}");
            evidence
        };
        assert_eq!(snow(35.0), Evidence::Agrees);
        assert!(matches!(snow(29.97), Evidence::TooClose(figures) if figures.contains("29.97, not better than 30.00")));
        assert!(matches!(snow(29.8), Evidence::Contradicts(why) if why.contains("29.80, not better than 30.00")));
    }
}
