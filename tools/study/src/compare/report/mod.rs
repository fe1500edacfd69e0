//! The report as a document.
//!
//! Tables and figures have the paper's numbers and order.

mod claims;
mod costs;
mod curves;
mod evidence;
mod measured;
mod paper;
mod pipeline;

use std::path::PathBuf;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::world::WorldTime;
use scenes::Family;

use super::branch::Branch;
use super::budget::Budget;
use super::make::Rollouts;
use super::panels::{self, StreamId};
use super::plan::Settings;
use super::score::SceneScores;
use super::series::Column;
use super::walk::RATE;
use crate::document::{Asset, Block, Document};
use crate::scene_id::SceneId;
use crate::table::Table;

const TITLE: &str = "Fewer and better anchors, or more frames";
/// Times of the paper's sword figure, as fractions of the walk: 2.5, 9 and 11 seconds of 15.
const MOMENTS: [f64; 3] = [1.0 / 6.0, 3.0 / 5.0, 11.0 / 15.0];
/// Width of a tile of a figure.
const TILE: u32 = 400;

/// All results.
pub(super) struct Results<'a> {
    pub(super) settings: &'a Settings,
    pub(super) bundle: &'a Bundle,
    pub(super) made: &'a Rollouts,
    /// Of all cells, in order.
    pub(super) budgets: &'a [Budget],
    pub(super) scored: &'a [SceneScores],
    /// The first place of each kind, and the path of its side-by-side video.
    pub(super) videos: &'a [(&'a SceneScores, PathBuf)],
}

impl Results<'_> {
    /// Whether the weights are random.
    fn is_random(&self) -> bool {
        self.bundle.manifest().provenance.get("weights").is_some_and(|weights| weights.starts_with("random"))
    }

    fn seconds(&self) -> Result<f64> {
        Ok(WorldTime::parse(&self.settings.seconds)?.seconds())
    }
}

/// Writes the report.
///
/// # Errors
/// `InvalidArgument` for settings that were not checked; `Io` for a missing frame.
pub(super) fn report(found: &Results<'_>) -> Result<Document> {
    let Results { settings, made, budgets, scored, .. } = *found;
    let mut blocks = head(found);
    blocks.push(Block::heading("What the paper claims"));
    blocks.push(Block::Table(Table::verdicts(&["claim", "scenes", "here"], claims::verdicts(found)?)));
    blocks.push(Block::text(
        "A scene counts for a claim where the 95 % interval of its places lies on one side; the interval is in brackets. With one \
         place there is none: the verdict is by the sign alone, and another place may differ. coherence and decoded-60 show the same \
         latents, so the world has lasted equally long in both: a horizon counts only where it differs by more than theirs. Another world, other pictures and another frame generator than the paper's: what holds here supports the \
         paper's strategy, and neither confirms nor refutes its figures.",
    ));
    blocks.push(Block::text(
        "The same claims with the best motion instead of the paper's: coherence-best has the latents of coherence, and motion from \
         pictures.",
    ));
    blocks.push(Block::Table(Table::verdicts(&["claim", "scenes", "here"], claims::verdicts_by_best_motion(found)?)));
    blocks.push(Block::heading("Figure 1: from controls to frames"));
    blocks.push(Block::figure(
        Asset::svg("figure-1", pipeline::drawing(settings)),
        "Above, the coherence-first branch: fewer latents, more passes and context for each, and every second frame generated \
         between two anchors. Below, the baseline: what the decoder makes is what is shown. Both have the same seed picture, \
         controls and noise.",
    ));
    blocks.extend(costs::operating_points(settings));
    blocks.extend(costs::machine(found));
    blocks.extend(costs::costs(made, budgets));
    blocks.extend(seeds(found)?);
    blocks.extend(evidence::table(settings, scored));
    for (scene, figure) in figures(found) {
        blocks.extend(pair(scene, figure, found)?);
    }
    blocks.extend(measured::all(settings, scored));
    blocks.push(Block::heading("The first place of each kind"));
    blocks.push(Block::text(
        "All streams of a place in step, a contact sheet of six moments, and how each stream goes over time: means of half a \
         second. The folder of every place has its video, and in series.csv the figures of every frame.",
    ));
    for (place, video) in found.videos {
        blocks.extend(of_scene(place, video, settings)?);
    }
    Ok(Document::new(TITLE, &blocks))
}

fn head(found: &Results<'_>) -> Vec<Block> {
    let Results { settings, made, bundle, .. } = found;
    let families: Vec<&str> = settings.families.iter().map(|family| family.name()).collect();
    let [width, height] = settings.size;
    let scenes = if settings.scenes_per_family == 1 {
        "one place".to_owned()
    } else {
        format!("{} places", settings.scenes_per_family)
    };
    let mut blocks = vec![Block::text(format!(
        "{}: {}, {scenes} of each, {} s in {} branches, compared at {width}x{height}. {} rollouts, {} of them kept from before.",
        bundle.manifest().name,
        families.join(", "),
        settings.seconds,
        Branch::ALL.len(),
        made.cells.len() + made.straight.len(),
        made.kept
    ))];
    blocks.push(Block::text(
        "The experiment of \"Fewer, Better Frames\", table by table and figure by figure, with the paper's published numbers \
         beside ours and with what the paper could not have: the renderer's own pictures of the same walks. What each figure \
         is, is told in docs/study.md.",
    ));
    if found.is_random() {
        blocks.push(Block::text("**This world has random weights: its pictures mean nothing.**"));
    }
    blocks
}

/// The paper's Figure 2.
fn seeds(found: &Results<'_>) -> Result<Vec<Block>> {
    let scenes: Vec<SceneId> =
        found.settings.families.iter().filter_map(|&family| found.settings.first_place(family)).collect();
    let file = Asset::jpeg("figure-2", &panels::seeds(&scenes, found.settings)?)?;
    Ok(vec![
        Block::heading("Figure 2: seed pictures"),
        Block::figure(
            file,
            "Where the walks start, drawn by the scenes' renderer. All branches of a place share the picture, the control \
             script and the seed of the noise.",
        ),
    ])
}

/// A figure of the paper that shows two branches side by side.
struct Pair {
    number: &'static str,
    of: [Branch; 2],
    words: &'static str,
}

/// Figures 3 to 6 and S1, for the scenes that were run.
fn figures<'a>(found: &'a Results<'_>) -> impl Iterator<Item = (SceneId, Pair)> + 'a {
    const MAIN: [Branch; 2] = [Branch::Coherence, Branch::Baseline];
    let all = [
        (Family::Forest, "3", MAIN, "the paper's clearest result: path, trunks and layers of fog."),
        (Family::Sword, "4", MAIN, "a held item in front of a place that moves."),
        (Family::Desert, "5", MAIN, "large shapes with little between them."),
        (
            Family::Sword,
            "6",
            [Branch::Coherence, Branch::Heavy],
            "a probe outside the main comparison: more context and passes.",
        ),
        (Family::Snow, "S1", MAIN, "bright and without texture, hard for both."),
    ];
    all.into_iter().filter_map(|(family, number, of, words)| {
        Some((found.settings.first_place(family)?, Pair { number, of, words }))
    })
}

fn pair(scene: SceneId, Pair { number, of, words }: Pair, found: &Results<'_>) -> Result<Vec<Block>> {
    let whole = found.seconds()? * f64::from(RATE);
    // Even samples only: at odd ones one branch shows generated frames and the other decoded ones.
    let samples = MOMENTS.map(|share| (whole * share) as u64 & !1);
    let columns = [StreamId::Branch(of[0]), StreamId::Branch(of[1]), StreamId::Truth];
    let picture = panels::grid(scene, &columns, &samples, TILE, found.settings)?;
    let file = Asset::jpeg(&format!("figure-{}", number.to_lowercase()), &picture)?;
    let [left, right] = of.map(Branch::name);
    Ok(vec![
        Block::heading(format!("Figure {number}: {scene}, {left} and {right}")),
        Block::figure(
            file,
            format!("Left {left}, middle {right}, right what the renderer draws of the same walk: {words}"),
        ),
    ])
}

fn of_scene(scored: &SceneScores, video: &std::path::Path, settings: &Settings) -> Result<Vec<Block>> {
    let scene = scored.scene;
    let name = format!("{}-{}", scene.family, scene.seed);
    let count = scored.series.first().map_or(1, |series| series.rows.len() as u64);
    let sheet = Asset::jpeg(&format!("sheet-{name}"), &panels::sheet(scene, count, settings)?)?;
    let mut blocks = vec![
        Block::Player {
            words: format!(
                "{scene}: truth and all branches in step, {RATE} frames a second; {name}/{} by itself.",
                super::video::VIDEO
            ),
            video: crate::manifest::read_bounded(video, u64::from(u32::MAX))?,
            rate: RATE,
        },
        Block::figure(sheet, format!("{scene}: truth and all branches at six moments.")),
    ];
    for (column, file, what) in [
        (Column::Lpips, "truth", "LPIPS to the truth; lower is nearer."),
        (Column::AdjacentLpips, "change", "LPIPS from frame to frame; the truth's own is the mark."),
        (Column::Ssim, "ssim", "SSIM to the truth; higher is nearer."),
    ] {
        let svg = curves::curves(&scored.series, column);
        if !svg.is_empty() {
            blocks.push(Block::figure(Asset::svg(&format!("{file}-{name}"), svg), format!("{scene}: {what}")));
        }
    }
    Ok(blocks)
}
