//! Measurements: the paper's Tables 6 to 8, and further tables.

use scenes::Family;

use super::super::branch::Branch;
use super::super::plan::Settings;
use super::super::score::SceneScores;
use super::super::summary::RolloutMetrics;
use super::super::walk::straight_seconds;
use super::claims::{advantage, advantage_of_all};
use super::paper::{PaperScores, published};
use super::{Block, Table};
use crate::statistics::{Estimate, estimate};

/// One value of a rollout.
type Value = fn(&RolloutMetrics) -> Option<f64>;

/// All blocks, in order.
pub(super) fn all(settings: &Settings, scored: &[SceneScores]) -> Vec<Block> {
    let mut blocks = Vec::new();
    blocks.extend(beside_the_paper(
        settings,
        scored,
        "Table 6: temporal LPIPS",
        [|f| f.anchor_lpips, |f| f.adjacent_lpips],
        |p| [p.anchor_lpips, p.adjacent_lpips],
        false,
    ));
    blocks.push(Block::text(
        "Comparable with the paper's: the sign of each difference, and by what part one branch is below the other. Not comparable: \
         the figures themselves, which depend on the pictures, their size and how fast the walks are. And lower is not better by \
         itself: a stream that repeats or blurs its pictures changes less. \"Change from frame to frame\" below says how near each \
         stream's changes are to those of the truth, and how even they are.",
    ));
    blocks.extend(beside_the_paper(
        settings,
        scored,
        "Table 7: temporal SSIM",
        [|f| f.anchor_ssim, |f| f.adjacent_ssim],
        |p| [p.anchor_ssim, p.adjacent_ssim],
        true,
    ));
    blocks.push(Block::text(
        "As in Table 6, and higher is not better by itself. The paper calls its anchor-aligned SSIM mixed: at 15 Hz a lower one can \
         be a place that truly changes.",
    ));
    blocks.extend(onsets(settings, scored));
    blocks.extend(motion(settings, scored));
    blocks.extend(truth(settings, scored));
    blocks.extend(decoder(settings, scored));
    blocks
}

fn scenes(scored: &[SceneScores], family: Family) -> impl Iterator<Item = &SceneScores> {
    scored.iter().filter(move |scored| scored.scene.family == family)
}

/// Mean over the scenes of a family.
pub(super) fn of_branch(scored: &[SceneScores], family: Family, branch: Branch, value: Value) -> Option<Estimate> {
    let figures = scenes(scored, family).flat_map(|scored| &scored.branches);
    let values: Vec<f64> = figures.filter(|(b, _)| *b == branch).filter_map(|(_, f)| value(f)).collect();
    estimate(&values)
}

/// Mean over all scenes of all families.
fn of_all(scored: &[SceneScores], branch: Branch, value: Value) -> Option<Estimate> {
    let figures = scored.iter().flat_map(|scored| &scored.branches);
    estimate(&figures.filter(|(b, _)| *b == branch).filter_map(|(_, f)| value(f)).collect::<Vec<_>>())
}

fn of_truth(scored: &[SceneScores], family: Family, value: Value) -> Option<Estimate> {
    estimate(&scenes(scored, family).filter_map(|scored| value(&scored.truth)).collect::<Vec<_>>())
}

fn show(estimate: Option<Estimate>, digits: usize) -> String {
    estimate.map_or_else(|| "-".into(), |estimate| number(estimate.mean, digits))
}

fn number(value: f64, digits: usize) -> String {
    if value.is_infinite() { "inf".into() } else { format!("{value:.digits$}") }
}

/// An advantage with its interval, or a note that there is none.
fn with_interval(estimate: Option<Estimate>, digits: usize) -> String {
    match estimate {
        None => "-".into(),
        Some(Estimate { mean, interval: None }) => format!("{mean:+.digits$} (one place: no interval)"),
        Some(Estimate { mean, interval: Some([low, high]) }) => {
            format!("{mean:+.digits$} ({low:+.digits$} to {high:+.digits$})")
        }
    }
}

/// A table of the paper, at 15 and at 30 Hz: our values, then the published ones.
fn beside_the_paper(
    settings: &Settings,
    scored: &[SceneScores],
    title: &str,
    values: [Value; 2],
    theirs: fn(&PaperScores) -> [[f64; 2]; 2],
    more: bool,
) -> Vec<Block> {
    let main = [Branch::Coherence, Branch::Baseline];
    let mut rows: Vec<Vec<String>> = settings
        .families
        .iter()
        .map(|&family| {
            let ours = |branch, i: usize| show(of_branch(scored, family, branch, values[i]), 4);
            let [anchor, full] =
                theirs(&published(family)).map(|pair| pair.map(|value| format!("{value:.4}")).join(" / "));
            let mut row = vec![family.name().to_owned()];
            row.extend((0..2).flat_map(|i| main.map(|branch| ours(branch, i))));
            row.push(with_interval(advantage(scored, family, main, values[1], more), 4));
            row.extend([anchor, full]);
            row
        })
        .collect();
    if settings.families.len() > 1 {
        let all = |branch, i: usize| show(of_all(scored, branch, values[i]), 4);
        let mut row = vec!["all".to_owned()];
        row.extend((0..2).flat_map(|i| main.map(|branch| all(branch, i))));
        row.push(with_interval(advantage_of_all(scored, main, values[1], more), 4));
        let means = [0, 1].map(|i| {
            let of = |branch: usize| {
                let sum: f64 = settings.families.iter().map(|&family| theirs(&published(family))[i][branch]).sum();
                format!("{:.4}", sum / settings.families.len() as f64)
            };
            format!("{} / {}", of(0), of(1))
        });
        row.extend(means);
        rows.push(row);
    }
    let head = [
        "scene",
        "anchors: coherence",
        "baseline",
        "full stream: coherence",
        "baseline",
        "advantage (95 %)",
        "paper, anchors",
        "paper, full",
    ];
    vec![Block::heading(title), Block::Table(Table::new(1, &head, rows))]
}

/// Table of the properties of motion that a mean change does not show.
fn motion(settings: &Settings, scored: &[SceneScores]) -> Vec<Block> {
    let mut rows = Vec::new();
    for &family in &settings.families {
        let true_change = show(of_truth(scored, family, |f| f.adjacent_lpips), 4);
        let true_anchor = show(of_truth(scored, family, |f| f.anchor_lpips), 4);
        rows.push(vec![
            family.name().into(),
            "truth".into(),
            true_change,
            true_anchor,
            "0".into(),
            "0".into(),
            String::new(),
        ]);
        for branch in Branch::ALL {
            let of = |value: Value, digits| show(of_branch(scored, family, branch, value), digits);
            rows.push(vec![
                String::new(),
                branch.name().into(),
                of(|f| f.adjacent_lpips, 4),
                of(|f| f.anchor_lpips, 4),
                of(|f| f.adjacent_error, 4),
                of(|f| f.anchor_error, 4),
                of(|f| f.asymmetry, 2),
            ]);
        }
    }
    let head = ["scene", "stream", "LPIPS at 30 Hz", "at 15 Hz", "off the truth's, 30 Hz", "15 Hz", "odd over even"];
    vec![
        Block::heading("Change from frame to frame"),
        Block::Table(Table::new(2, &head, rows)),
        Block::text(
            "Off the truth's: mean distance of each change from the truth's change at the same time, nearer to 0 is better. Odd \
             over even: mean change into every other frame over that into the rest, the larger over the smaller; 1 is even \
             motion, a stream that shows every frame twice has infinity. Of decoded-60 every second frame is looked at.",
        ),
    ]
}

/// Table against the renderer's truth.
fn truth(settings: &Settings, scored: &[SceneScores]) -> Vec<Block> {
    let mut rows = Vec::new();
    for &family in &settings.families {
        for branch in Branch::ALL {
            let of = |value: Value, digits| show(of_branch(scored, family, branch, value), digits);
            let scene = if branch == Branch::ALL[0] { family.name() } else { "" };
            rows.push(vec![
                scene.into(),
                branch.name().into(),
                of(|f| f.psnr, 2),
                of(|f| f.ssim, 3),
                of(|f| f.ms_ssim, 3),
                of(|f| f.lpips, 3),
                of(|f| f.horizon, 1),
                of(|f| f.brightness_drift, 1),
                of(|f| f.warmth_drift, 1),
                of(|f| f.flicker, 2),
            ]);
        }
    }
    let head = [
        "scene",
        "branch",
        "PSNR, dB",
        "SSIM",
        "MS-SSIM",
        "LPIPS",
        "horizon, s",
        "brightness drift",
        "warmth drift",
        "flicker",
    ];
    vec![
        Block::heading("Against the renderer's truth"),
        Block::Table(Table::new(2, &head, rows)),
        Block::text(
            "Means over all frames of a walk, then over places. The horizon is the first second whose mean LPIPS to the truth \
             reaches what the stream's own first picture has, on average, to the second half of the walk; the whole length where \
             that never comes. It depends on which pictures are shown: coherence and decoded-60 are the same latents, so where their \
             horizons differ, that says nothing about the world, and neither does a difference of that size between other branches. \
             Drifts are those of the farthest second, in steps of 0 to 255: brightness, and red less blue. \
             Flicker is the mean change of brightness from frame to frame beyond the truth's.",
        ),
    ]
}

/// Table of generated frames against the decoder's own.
fn decoder(settings: &Settings, scored: &[SceneScores]) -> Vec<Block> {
    let mut rows = Vec::new();
    for &family in &settings.families {
        for (branch, scene) in [(Branch::Coherence, family.name()), (Branch::CoherenceBest, "")] {
            let of = |value: Value, digits| show(of_branch(scored, family, branch, value), digits);
            rows.push(vec![
                scene.into(),
                branch.name().into(),
                of(|f| f.decoder_psnr, 2),
                of(|f| f.decoder_ssim, 3),
                of(|f| f.decoder_lpips, 3),
            ]);
        }
    }
    vec![
        Block::heading("Generated frames against the decoder's own in-betweens"),
        Block::Table(Table::new(2, &["scene", "branch", "PSNR, dB", "SSIM", "LPIPS"], rows)),
        Block::text(
            "Each branch beside decoded-60: the same latents, the same times, half-way between two anchors. The paper's motion is \
             that of coherence, motion from pictures that of coherence-best.",
        ),
    ]
}

/// The paper's Table 8; empty if no walk has a turn.
fn onsets(settings: &Settings, scored: &[SceneScores]) -> Vec<Block> {
    let turned = |family| straight_seconds(family, &settings.seconds).is_ok_and(|seconds| seconds.is_some());
    let rows: Vec<Vec<String>> = settings
        .families
        .iter()
        .filter(|family| turned(**family))
        .map(|&family| {
            let main = [Branch::Coherence, Branch::Baseline];
            let of = |branch| match of_branch(scored, family, branch, |f| f.onset) {
                Some(onset) => number(onset.mean, 3),
                None => "not seen".into(),
            };
            let [coherence, baseline] = published(family).onset;
            let truth = of_truth(scored, family, |f| f.onset);
            vec![
                family.name().into(),
                truth.map_or_else(|| "not seen".into(), |onset| number(onset.mean, 3)),
                of(main[0]),
                of(Branch::CoherenceBest),
                of(main[1]),
                with_interval(advantage(scored, family, main, |f| f.onset, false), 3),
                format!("{coherence:.3} / {baseline:.3}"),
            ]
        })
        .collect();
    if rows.is_empty() {
        return Vec::new();
    }
    let head = ["scene", "truth, s", "coherence, s", "coherence-best, s", "baseline, s", "earlier by, s", "paper"];
    let mut blocks = vec![
        Block::heading("Table 8: seconds until a turn is seen"),
        Block::Table(Table::new(1, &head, rows)),
        Block::text(
            "From the first command of the mouse to the first frame of a tenth of a second in which the picture moves sideways \
             otherwise than in the same walk without the mouse; within a frame, 1/30 s. In presentation time a stream with generated \
             frames shows everything one anchor later than it is made. The truth obeys at once: what the same detector takes to see \
             that is its own delay. The paper looked at one video without such a control, and its walks were others: only the sign \
             of a difference may be compared.",
        ),
    ];
    if scored.iter().any(|scored| !scored.same_before_turn) {
        blocks.push(Block::text(
            "Before the command the two walks of some place differ, which they must not: its figures here mean nothing.",
        ));
    }
    blocks
}
