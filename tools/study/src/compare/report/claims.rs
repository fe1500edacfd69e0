//! The paper's claims, and whether the results support them.

use cairn::Result;
use scenes::{Family, LANDSCAPES};

use super::super::branch::Branch;
use super::super::score::SceneScores;
use super::super::summary::RolloutMetrics;
use super::Results;
use crate::statistics::{Estimate, estimate};

/// Shorter walks cannot support a claim about duration.
const LEAST_SECONDS: f64 = 5.0;

/// One claim.
struct Claim {
    words: &'static str,
    /// The compared value and the two branches; the first should be better.
    value: fn(&RolloutMetrics) -> Option<f64>,
    of: [Branch; 2],
    /// Whether larger values are better.
    more: bool,
    /// Families for which it is claimed.
    families: &'static [Family],
    /// Whether the value depends on which pictures of a latent are shown. Then a difference counts only where it is larger than that
    /// from [`Branch::Decoded60`], which shows the same latents.
    depends_on_pictures: bool,
}

const MAIN: [Branch; 2] = [Branch::Coherence, Branch::Baseline];

const CLAIMS: [Claim; 9] = [
    Claim {
        words: "Frames change less from one to the next: lower adjacent LPIPS in every scene (Table 6)",
        value: |f| f.adjacent_lpips,
        of: MAIN,
        more: false,
        families: &LANDSCAPES,
        depends_on_pictures: false,
    },
    Claim {
        words: "Anchors change less, too: lower LPIPS at 15 Hz in every scene (Table 6)",
        value: |f| f.anchor_lpips,
        of: MAIN,
        more: false,
        families: &LANDSCAPES,
        depends_on_pictures: false,
    },
    Claim {
        words: "Presented frames are more alike: higher adjacent SSIM in every scene (Table 7)",
        value: |f| f.adjacent_ssim,
        of: MAIN,
        more: true,
        families: &LANDSCAPES,
        depends_on_pictures: false,
    },
    Claim {
        words: "The world stays coherent longer (section 7): a later horizon in every scene, by more than that of decoded-60 differs",
        value: |f| f.horizon,
        of: MAIN,
        more: true,
        families: &LANDSCAPES,
        depends_on_pictures: true,
    },
    Claim {
        words: "The gain grows over time (section 7): the distance from the truth grows less in every scene",
        value: |f| f.divergence,
        of: MAIN,
        more: false,
        families: &LANDSCAPES,
        depends_on_pictures: false,
    },
    Claim {
        words: "Reconstruction is not what fails first (section 2): generated frames are nearer to the truth than the baseline's of \
                the same times in every scene",
        value: |f| f.odd_lpips,
        of: MAIN,
        more: false,
        families: &LANDSCAPES,
        depends_on_pictures: false,
    },
    Claim {
        words: "The baseline drifts in brightness (section 7): less drift in every scene",
        value: |f| f.brightness_drift.map(f64::abs),
        of: MAIN,
        more: false,
        families: &LANDSCAPES,
        depends_on_pictures: false,
    },
    Claim {
        words: "Turns are seen earlier (Table 8) in forest, desert and snow",
        value: |f| f.onset,
        of: MAIN,
        more: false,
        families: &[Family::Forest, Family::Desert, Family::Snow],
        depends_on_pictures: false,
    },
    Claim {
        words: "More is not always better (section 7.4): in the sword scene the heavy point is farther from the truth",
        value: |f| f.lpips,
        of: [Branch::Coherence, Branch::Heavy],
        more: false,
        families: &[Family::Sword],
        depends_on_pictures: false,
    },
];

/// Verdict on a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Holds,
    DoesNot,
    CannotBeTold,
}

/// Advantage over all scenes of all families.
pub(super) fn advantage_of_all(
    scored: &[SceneScores],
    branches: [Branch; 2],
    value: fn(&RolloutMetrics) -> Option<f64>,
    more: bool,
) -> Option<Estimate> {
    advantage_of(scored.iter(), branches, value, more)
}

/// Advantage of the first branch of a pair over the second in a family: mean over scenes, paired.
pub(super) fn advantage(
    scored: &[SceneScores],
    family: Family,
    branches: [Branch; 2],
    value: fn(&RolloutMetrics) -> Option<f64>,
    more: bool,
) -> Option<Estimate> {
    advantage_of(scored.iter().filter(|scored| scored.scene.family == family), branches, value, more)
}

fn advantage_of<'a>(
    scored: impl Iterator<Item = &'a SceneScores>,
    [first, second]: [Branch; 2],
    value: fn(&RolloutMetrics) -> Option<f64>,
    more: bool,
) -> Option<Estimate> {
    let differences: Vec<f64> = scored
        .filter_map(|scored| {
            let of = |branch| scored.branches.iter().find(|(b, _)| *b == branch).and_then(|(_, f)| value(f));
            let difference = of(first)? - of(second)?;
            Some(if more { difference } else { -difference })
        })
        .collect();
    estimate(&differences)
}

/// Verdict for one family: by its interval or, with a single scene, by its value. An interval that contains zero decides nothing.
fn in_scene(advantage: Option<Estimate>) -> Verdict {
    match advantage {
        Some(Estimate { interval: Some([low, _]), .. }) if low > 0.0 => Verdict::Holds,
        Some(Estimate { interval: Some([_, high]), .. }) if high < 0.0 => Verdict::DoesNot,
        Some(Estimate { interval: None, mean }) if mean > 0.0 => Verdict::Holds,
        Some(Estimate { interval: None, mean }) if mean < 0.0 => Verdict::DoesNot,
        _ => Verdict::CannotBeTold,
    }
}

/// Verdict for one family on an advantage that says something only beyond the difference between two ways to show the same latents.
fn beyond(advantage: Option<Estimate>, same_latents: Option<Estimate>) -> Verdict {
    match (advantage, same_latents) {
        (Some(found), Some(same)) if found.mean.abs() > same.mean.abs() => in_scene(advantage),
        _ => Verdict::CannotBeTold,
    }
}

/// A claim about several scenes holds if it holds in each, and fails if it fails in one.
fn overall(families: &[Verdict]) -> Verdict {
    if families.contains(&Verdict::DoesNot) {
        Verdict::DoesNot
    } else if families.is_empty() || families.contains(&Verdict::CannotBeTold) {
        Verdict::CannotBeTold
    } else {
        Verdict::Holds
    }
}

/// A line per claim: text, scenes, verdict.
pub(super) fn verdicts(found: &Results<'_>) -> Result<Vec<Vec<String>>> {
    let mut lines = of_figures(&CLAIMS, found, found.seconds()?);
    lines.push(budget(found));
    Ok(lines)
}

/// The claims about the two main branches, with the best motion instead of the paper's.
pub(super) fn verdicts_by_best_motion(found: &Results<'_>) -> Result<Vec<Vec<String>>> {
    Ok(of_figures(&by_best_motion(), found, found.seconds()?))
}

fn by_best_motion() -> Vec<Claim> {
    let main = CLAIMS.into_iter().filter(|claim| claim.of == MAIN);
    main.map(|claim| Claim { of: [Branch::CoherenceBest, Branch::Baseline], ..claim }).collect()
}

/// Maximum operations per second, relative to `coherence`, that still count as the same budget.
const SAME: f64 = 1.1;

/// Whether the two main branches cost the same, for both readings of the baseline.
fn budget(found: &Results<'_>) -> Vec<String> {
    let flops = |branch| {
        let cells = found.made.cells.iter().zip(found.budgets);
        let of = cells.filter(|((cell, _), _)| cell.branch == branch).map(|(_, budget)| budget.flops);
        let all: Vec<f64> = of.collect();
        all.iter().sum::<f64>() / all.len().max(1) as f64
    };
    let ours = flops(Branch::Coherence);
    budget_line([ours / flops(Branch::Baseline), ours / flops(Branch::BaselineDoubled)])
}

fn budget_line([native, doubled]: [f64; 2]) -> Vec<String> {
    let verdict = match [native, doubled].map(|ratio| ratio <= SAME) {
        [true, true] => "holds",
        [false, true] => "holds for baseline-doubled alone",
        [true, false] => "holds for baseline alone",
        [false, false] => "does not hold",
    };
    vec![
        "Both branches cost about the same (Table 4): coherence takes no more operations a second, within a tenth"
            .into(),
        format!("over baseline {native:.2}, over baseline-doubled {doubled:.2}"),
        verdict.into(),
    ]
}

fn of_figures(claims: &[Claim], found: &Results<'_>, seconds: f64) -> Vec<Vec<String>> {
    lines(claims, &found.settings.families, found.scored, seconds, found.is_random())
}

fn lines(
    claims: &[Claim],
    families: &[Family],
    scored: &[SceneScores],
    seconds: f64,
    random: bool,
) -> Vec<Vec<String>> {
    let line = |claim: &Claim| {
        let asked: Vec<Family> = claim.families.iter().copied().filter(|f| families.contains(f)).collect();
        let found: Vec<(Family, Option<Estimate>, Verdict)> = asked
            .iter()
            .map(|&family| {
                let of = |branches| advantage(scored, family, branches, claim.value, claim.more);
                let found = of(claim.of);
                let verdict = if claim.depends_on_pictures {
                    beyond(found, of([claim.of[0], Branch::Decoded60]))
                } else {
                    in_scene(found)
                };
                (family, found, verdict)
            })
            .collect();
        let verdicts: Vec<Verdict> = found.iter().map(|(_, _, verdict)| *verdict).collect();
        let one_place = found.iter().any(|(_, found, _)| matches!(found, Some(Estimate { interval: None, .. })));
        let places = if one_place { " (one place, no interval)" } else { "" };
        let reason = if random {
            Some("random weights".to_owned())
        } else if seconds < LEAST_SECONDS {
            Some(format!("too short a walk, {seconds} s"))
        } else if asked.len() < claim.families.len() {
            Some("not all of its scenes were run".to_owned())
        } else {
            None
        };
        let verdict = match (&reason, overall(&verdicts)) {
            (Some(reason), _) => format!("cannot be told: {reason}"),
            (None, Verdict::Holds) => format!("holds{places}"),
            (None, Verdict::DoesNot) => format!("does not hold{places}"),
            (None, Verdict::CannotBeTold) => format!("cannot be told{places}"),
        };
        let families = found.iter().map(|(family, found, verdict)| {
            let sign = match verdict {
                Verdict::Holds => "yes",
                Verdict::DoesNot => "no",
                Verdict::CannotBeTold => "open",
            };
            match found.and_then(|found| found.interval) {
                Some([low, high]) => format!("{family} {sign} ({low:+.3} to {high:+.3})"),
                None => format!("{family} {sign}"),
            }
        });
        vec![claim.words.to_owned(), families.collect::<Vec<_>>().join(", "), verdict]
    };
    claims.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::scene_id::SceneId;

    fn scored(family: Family, seed: u64, coherence: f64, baseline: f64) -> SceneScores {
        let figures = |value| RolloutMetrics {
            adjacent_lpips: Some(value),
            lpips: Some(value),
            horizon: Some(-value),
            ..RolloutMetrics::default()
        };
        SceneScores {
            scene: SceneId { family, seed },
            key: String::new(),
            truth: RolloutMetrics::default(),
            branches: vec![
                (Branch::Coherence, figures(coherence)),
                (Branch::Baseline, figures(baseline)),
                (Branch::Heavy, figures(baseline)),
            ],
            series: Vec::new(),
            same_before_turn: true,
            file: PathBuf::new(),
        }
    }

    fn first_verdict(scored: &[SceneScores], seconds: f64, random: bool) -> String {
        let lines = lines(&CLAIMS, &LANDSCAPES, scored, seconds, random);
        assert_eq!(lines.len(), CLAIMS.len());
        lines[0][2].clone()
    }

    #[test]
    fn a_claim_holds_where_it_holds_in_every_scene() {
        let all = |worst: f64| -> Vec<SceneScores> {
            let value = |family| if family == Family::Snow { worst } else { 0.1 };
            LANDSCAPES.into_iter().map(|family| scored(family, 41, value(family), 0.2)).collect()
        };
        assert_eq!(first_verdict(&all(0.1), 15.0, false), "holds (one place, no interval)");
        assert_eq!(first_verdict(&all(0.3), 15.0, false), "does not hold (one place, no interval)");
        assert_eq!(first_verdict(&all(0.2), 15.0, false), "cannot be told (one place, no interval)", "a tie");
        assert!(first_verdict(&all(0.1), 15.0, true).contains("random"));
        assert!(first_verdict(&all(0.1), 1.0, false).contains("too short a walk, 1 s"));
        assert_eq!(first_verdict(&[], 15.0, false), "cannot be told");
    }

    #[test]
    fn a_budget_may_be_the_same_in_one_reading_alone() {
        for (ratios, verdict) in [
            ([1.0, 0.6], "holds"),
            ([1.4, 0.7], "holds for baseline-doubled alone"),
            ([1.4, 1.2], "does not hold"),
            ([0.9, 1.2], "holds for baseline alone"),
        ] {
            assert_eq!(budget_line(ratios)[2], verdict);
        }
    }

    #[test]
    fn places_that_disagree_leave_a_scene_open() {
        let scenes = [scored(Family::Snow, 41, 0.1, 0.2), scored(Family::Snow, 42, 0.2, 0.1)];
        let found = advantage(&scenes, Family::Snow, MAIN, |f| f.adjacent_lpips, false);
        assert_eq!(in_scene(found), Verdict::CannotBeTold);
        // Two differences that agree in their sign alone: with a single degree of freedom the interval holds nothing.
        let two = [scored(Family::Snow, 41, 0.1, 0.2), scored(Family::Snow, 42, 0.1, 0.3)];
        let found = advantage(&two, Family::Snow, MAIN, |f| f.horizon, true);
        assert_eq!(in_scene(found), Verdict::CannotBeTold);
        let scenes = [scored(Family::Snow, 41, 0.1, 0.3), scored(Family::Snow, 42, 0.1, 0.31)];
        let found = advantage(&scenes, Family::Snow, MAIN, |f| f.horizon, true);
        assert_eq!(in_scene(found), Verdict::Holds);
    }

    #[test]
    fn several_places_show_their_interval_and_no_note() {
        let places = LANDSCAPES
            .into_iter()
            .flat_map(|family| [(41, 0.3), (42, 0.31)].map(|(seed, b)| scored(family, seed, 0.1, b)));
        let lines = lines(&CLAIMS, &LANDSCAPES, &places.collect::<Vec<_>>(), 15.0, false);
        assert_eq!(lines[0][2], "holds");
        assert!(lines[0][1].starts_with("forest yes (+0.141 to +0.269), sword yes"), "{}", lines[0][1]);
    }

    #[test]
    fn the_best_motion_takes_the_papers_place_in_the_main_claims_alone() {
        let claims = by_best_motion();
        assert_eq!(claims.len(), CLAIMS.len() - 1, "all but that about the heavy point");
        let all: Vec<SceneScores> = LANDSCAPES
            .into_iter()
            .map(|family| {
                // Worse than the baseline by the paper's motion, better by the best.
                let mut scored = scored(family, 41, 0.3, 0.2);
                let figures = RolloutMetrics { adjacent_lpips: Some(0.1), ..RolloutMetrics::default() };
                scored.branches.push((Branch::CoherenceBest, figures));
                scored
            })
            .collect();
        let verdict = |claims| lines(claims, &LANDSCAPES, &all, 15.0, false)[0][2].clone();
        assert_eq!(verdict(&CLAIMS), "does not hold (one place, no interval)");
        assert_eq!(verdict(&claims), "holds (one place, no interval)");
    }

    #[test]
    fn a_horizon_counts_only_beyond_what_the_same_latents_differ_by() {
        let line = |decoded: f64| {
            let all = LANDSCAPES.into_iter().map(|family| {
                let mut scored = scored(family, 41, -3.0, -1.0);
                let figures = RolloutMetrics { horizon: Some(decoded), ..RolloutMetrics::default() };
                scored.branches.push((Branch::Decoded60, figures));
                scored
            });
            let lines = lines(&CLAIMS, &LANDSCAPES, &all.collect::<Vec<_>>(), 15.0, false);
            let line = lines.iter().find(|line| line[0].contains("coherent longer")).unwrap();
            line[2].clone()
        };
        assert_eq!(line(2.5), "holds (one place, no interval)");
        // The same latents, shown in another way, differ by as much.
        assert_eq!(line(1.0), "cannot be told (one place, no interval)");
        assert_eq!(line(5.0), "cannot be told (one place, no interval)");
    }
}
