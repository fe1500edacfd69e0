//! Cairn's claims about its pictures, checked against the table.

use std::fmt;

use super::rows::Kind;
use super::table::{Table, is_better, measures};

/// Names of the measures.
pub(super) const MEASURES: [&str; 3] = ["PSNR", "SSIM", "LPIPS"];

/// What the measurements say about a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Held,
    Missed,
    /// They decide nothing.
    NotJudged,
}

impl Verdict {
    pub(super) fn of(holds: bool) -> Self {
        if holds { Self::Held } else { Self::Missed }
    }

    /// The cell of the page.
    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Held => "held",
            Self::Missed => "**missed**",
            Self::NotJudged => "not judged",
        }
    }
}

/// A claim, such as that a row is better than others on a group of clips, and the verdict on it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Claim {
    pub(super) what: String,
    pub(super) verdict: Verdict,
    /// The values that decide it, or why none do.
    pub(super) figures: String,
}

/// Number of claims with each verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tally {
    pub(super) held: usize,
    pub(super) missed: usize,
    pub(super) not_judged: usize,
}

impl Tally {
    pub(super) fn of(claims: &[Claim]) -> Self {
        let count = |verdict| claims.iter().filter(|claim| claim.verdict == verdict).count();
        Self { held: count(Verdict::Held), missed: count(Verdict::Missed), not_judged: count(Verdict::NotJudged) }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} claims held", self.held, self.held + self.missed)?;
        if self.not_judged > 0 { write!(f, ", {} not judged", self.not_judged) } else { Ok(()) }
    }
}

impl fmt::Display for Claim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match self.verdict {
            Verdict::Held => "held  ",
            Verdict::Missed => "MISSED",
            Verdict::NotJudged => "not judged",
        };
        write!(f, "{verdict}  {}: {}", self.what, self.figures)
    }
}

/// All claims that the table can decide, at twice the anchors' rate: with true motion and depth the generator is better than every other row in
/// every measure; with `picture_flow` it is better in every measure than the rows without a neural network that get no more than pictures, and
/// better than RIFE in PSNR, where things move in SSIM too. There it is also better with an engine's motion and depth than the rows without a
/// network that get no better motion.
pub(super) fn judge(table: &Table) -> Vec<Claim> {
    let mut claims = Vec::new();
    for group in table.groups(2) {
        let own = [Kind::Engine, Kind::Truth];
        let others: Vec<Kind> = table.rows(2).into_iter().filter(|row| !own.contains(row)).collect();
        claims.extend(better(table, &group, Kind::Truth, &others, &[0, 1, 2]));
        let learned = [Kind::Rife, Kind::Rife4];
        let without_network: Vec<Kind> =
            others.iter().copied().filter(|row| *row != Kind::Flow && !learned.contains(row)).collect();
        let plain: Vec<Kind> = without_network.iter().copied().filter(|row| !row.needs_guidance()).collect();
        claims.extend(better(table, &group, Kind::Flow, &plain, &[0, 1, 2]));
        let is_moving = group.starts_with("moving-");
        claims.extend(better(table, &group, Kind::Flow, &learned, if is_moving { &[0, 1] } else { &[0] }));
        if is_moving {
            let rivals: Vec<Kind> = without_network.into_iter().filter(|row| *row != Kind::Fsr).collect();
            claims.extend(better(table, &group, Kind::Engine, &rivals, &[0, 1, 2]));
        }
    }
    claims
}

/// The claim that `row` beats each of `others` on `group` in each of the `which` measures; `None` if there is nothing to compare.
fn better(table: &Table, group: &str, row: Kind, others: &[Kind], which: &[usize]) -> Option<Claim> {
    let own = measures(&table.group(2, group, row)?.score);
    let rivals: Vec<_> =
        others.iter().filter_map(|kind| Some((*kind, measures(&table.group(2, group, *kind)?.score)))).collect();
    let mut figures = Vec::new();
    let mut held = true;
    for &i in which {
        let Some(own) = own[i] else { continue };
        let of = |(kind, scores): &(Kind, [Option<f64>; 3])| Some((*kind, scores[i]?));
        let (digits, unit) = if i == 0 { (2, 0.01) } else { (4, 0.0001) };
        // Of rivals that are equal in the digits shown the first is named, so that page and table name the same one.
        let shown = |value: f64| (value / unit).round();
        let is_nearer = |a: f64, b: f64| is_better(i, shown(a), shown(b));
        let nearest = rivals.iter().filter_map(of).reduce(|a, b| if is_nearer(b.1, a.1) { b } else { a });
        let Some((kind, rival)) = nearest else { continue };
        let wins = rivals.iter().filter_map(of).all(|(_, rival)| is_better(i, own, rival));
        held &= wins;
        let sign = if wins { "" } else { "not " };
        figures.push(format!("{} {own:.digits$}, {sign}better than {rival:.digits$} of {}", MEASURES[i], kind.name()));
    }
    let lost = lost(table, group, row, others, which);
    if !lost.is_empty() {
        figures.push(format!("lost on {}", lost.join(", ")));
    }
    let names: Vec<&str> = rivals.iter().map(|(kind, _)| kind.name()).collect();
    let claimed: Vec<&str> = which.iter().map(|i| MEASURES[*i]).collect();
    let what = format!("{group}: {} beats {} in {}", row.name(), names.join(", "), claimed.join(", "));
    (!figures.is_empty()).then(|| Claim { what, verdict: Verdict::of(held), figures: figures.join("; ") })
}

/// Clips of a group of several on which `row` does not beat all of `others`, with the measures: a mean hides none.
fn lost(table: &Table, group: &str, row: Kind, others: &[Kind], which: &[usize]) -> Vec<String> {
    let clips = table.clips(2, group);
    if clips.len() < 2 {
        return Vec::new();
    }
    let lost_in = |clip: &String| {
        let of = |kind: Kind, i: usize| table.clip(2, clip, kind).and_then(|cell| measures(&cell.score)[i]);
        let is_lost = |i: &&usize| {
            let Some(own) = of(row, **i) else { return false };
            others.iter().filter_map(|kind| of(*kind, **i)).any(|rival| !is_better(**i, own, rival))
        };
        let names: Vec<&str> = which.iter().filter(is_lost).map(|i| MEASURES[*i]).collect();
        (!names.is_empty()).then(|| format!("{clip} ({})", names.join(", ")))
    };
    clips.iter().filter_map(lost_in).collect()
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::record;
    use super::*;

    #[test]
    fn a_miss_is_told_with_the_figures_that_decide_it() {
        let table = Table::new(&[
            record("snow-5", Kind::Truth, 40.0, Some(0.01)),
            record("snow-5", Kind::Flow, 30.0, Some(0.02)),
            record("snow-5", Kind::Blend, 25.0, Some(0.015)),
            record("snow-5", Kind::Rife, 29.0, Some(0.005)),
        ]);
        let claims = judge(&table);
        let told: Vec<(Verdict, &str)> = claims.iter().map(|c| (c.verdict, c.what.as_str())).collect();
        assert_eq!(
            told,
            [
                (Verdict::Missed, "snow: cairn-truth beats blend, rife, cairn-flow in PSNR, SSIM, LPIPS"),
                (Verdict::Missed, "snow: cairn-flow beats blend in PSNR, SSIM, LPIPS"),
                (Verdict::Held, "snow: cairn-flow beats rife in PSNR"),
            ]
        );
        assert!(claims[0].figures.contains("LPIPS 0.0100, not better than 0.0050 of rife"), "{}", claims[0]);
        assert!(claims[1].to_string().starts_with("MISSED"), "{}", claims[1]);
    }

    #[test]
    fn a_row_is_held_against_those_that_get_the_same_or_less() {
        let kinds = [Kind::Blend, Kind::FsrFlow, Kind::FsrEngine, Kind::Fsr, Kind::Flow, Kind::Engine, Kind::Truth];
        let records: Vec<_> = kinds.iter().map(|kind| record("moving-snow-5", *kind, 30.0, None)).collect();
        let claims = judge(&Table::new(&records));
        let told: Vec<&str> = claims.iter().map(|claim| claim.what.as_str()).collect();
        assert_eq!(
            told,
            [
                "moving-snow-5: cairn-truth beats blend, fsr-flow, fsr-engine, fsr, cairn-flow in PSNR, SSIM, LPIPS",
                "moving-snow-5: cairn-flow beats blend, fsr-flow in PSNR, SSIM, LPIPS",
                "moving-snow-5: cairn-engine beats blend, fsr-flow, fsr-engine in PSNR, SSIM, LPIPS",
            ]
        );
    }

    #[test]
    fn a_mean_hides_no_lost_clip_and_real_clips_are_judged_one_by_one() {
        let table = Table::new(&[
            record("snow-5", Kind::Flow, 30.0, None),
            record("snow-5", Kind::Blend, 20.0, None),
            record("snow-6", Kind::Flow, 30.0, None),
            record("snow-6", Kind::Blend, 31.0, None),
            record("bunny-bird", Kind::Flow, 40.0, None),
            record("bunny-bird", Kind::Blend, 20.0, None),
            record("bunny-brook", Kind::Flow, 30.0, None),
            record("bunny-brook", Kind::Blend, 31.0, None),
        ]);
        let claims: Vec<String> = judge(&table).iter().map(ToString::to_string).collect();
        assert_eq!(claims.len(), 3, "{claims:?}");
        assert!(claims[0].starts_with("held") && claims[0].ends_with("; lost on snow-6 (PSNR, SSIM)"), "{claims:?}");
        assert!(claims[1].starts_with("held    bunny-bird: cairn-flow beats blend"), "{claims:?}");
        assert!(claims[2].starts_with("MISSED  bunny-brook: cairn-flow beats blend"), "{claims:?}");
    }

    #[test]
    fn of_rivals_that_are_equal_as_shown_the_first_is_named() {
        let of = |blend: f64, flowfps: f64| {
            let table = Table::new(&[
                record("snow-5", Kind::Blend, blend, None),
                record("snow-5", Kind::FlowFps, flowfps, None),
                record("snow-5", Kind::Flow, 40.0, None),
            ]);
            judge(&table).swap_remove(0)
        };
        assert!(of(30.001, 30.002).figures.contains("better than 30.00 of blend"));
        assert!(of(30.001, 30.02).figures.contains("better than 30.02 of flowfps"));
        // The verdict is of exact values.
        assert_eq!([of(39.0, 40.001).verdict, of(39.0, 39.999).verdict], [Verdict::Missed, Verdict::Held]);
    }

    #[test]
    fn nothing_is_claimed_where_nothing_can_be_compared() {
        assert_eq!(judge(&Table::new(&[record("snow-5", Kind::Truth, 40.0, None)])), []);
        assert_eq!(judge(&Table::new(&[record("snow-5", Kind::Blend, 40.0, None)])), []);
        // A missing measure is left out; the others are judged.
        let table =
            Table::new(&[record("snow-5", Kind::Flow, 40.0, None), record("snow-5", Kind::Blend, 30.0, Some(0.1))]);
        let claims = judge(&table);
        assert!(
            claims.len() == 1 && claims[0].verdict == Verdict::Held && !claims[0].figures.contains("LPIPS"),
            "{claims:?}"
        );
    }
}
