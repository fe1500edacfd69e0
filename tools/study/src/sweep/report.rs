//! Results of a sweep as a document and as CSV.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use cairn::bundle::Bundle;
use cairn::world::{Presentation, WorldTime};

use super::chart::{Chart, Group, Mark};
use super::front::{Score, front, moves, within};
use super::measure::{Cost, Measure};
use super::plan::{Cell, Settings};
use super::point::Point;
use crate::compare::budget::Budget;
use crate::compare::summary::RolloutMetrics;
use crate::document::{Asset, Block, Document};
use crate::statistics::Estimate;
use crate::table::Table;

/// Maximum number of lines in the table of steps with worse results.
const MOST_FALLS: usize = 20;
/// Maximum number of lines in a chart.
const MOST_LINES: usize = 7;

/// Measurements of a cell.
pub(super) struct CellResult<'a> {
    pub(super) cell: Cell<'a>,
    /// Denoise passes per latent.
    pub(super) passes: u32,
    pub(super) budget: Budget,
    pub(super) metrics: RolloutMetrics,
}

/// All results.
pub(super) struct Sweep<'a> {
    pub(super) settings: &'a Settings,
    pub(super) bundle: &'a Bundle,
    /// In the order of the cells.
    pub(super) found: &'a [CellResult<'a>],
    /// Number of cells that were complete already.
    pub(super) kept: usize,
}

impl<'a> Sweep<'a> {
    /// Scores of every point over its scenes.
    fn scores(&self) -> Vec<Score<'a>> {
        let of = |point: &'a Point| {
            let all: Vec<&CellResult<'_>> = self.found.iter().filter(|found| found.cell.point == point).collect();
            let mean = |of: &dyn Fn(&Budget) -> f64| {
                all.iter().map(|found| of(&found.budget)).sum::<f64>() / all.len().max(1) as f64
            };
            Score {
                point,
                passes: all.first().map_or(0, |found| found.passes),
                cost: mean(&|budget| self.settings.cost.of(budget)),
                bytes: mean(&|budget| budget.bytes),
                seconds: mean(&|budget| budget.times.sum()),
                values: Measure::ALL.map(|measure| all.iter().filter_map(|found| measure.of(&found.metrics)).collect()),
            }
        };
        self.settings.points.iter().map(of).collect()
    }
}

/// A mean, with its interval if it has one.
fn formatted(value: Option<Estimate>, digits: usize) -> String {
    match value {
        None => "–".into(),
        Some(Estimate { mean, interval: None }) => format!("{mean:.digits$}"),
        Some(Estimate { mean, interval: Some([low, high]) }) => {
            format!("{mean:.digits$} ({low:.digits$} to {high:.digits$})")
        }
    }
}

/// The document.
pub(super) fn document(sweep: &Sweep<'_>) -> Document {
    let Sweep { settings, .. } = sweep;
    let scores = sweep.scores();
    let mut blocks = head(sweep);
    let mut measures = vec![settings.measure];
    let beside = if settings.lpips { Measure::Lpips } else { Measure::Psnr };
    measures.extend((beside != settings.measure).then_some(beside));
    for &measure in &measures {
        blocks.extend(pareto(&scores, measure, settings));
    }
    blocks.extend(budgets(&scores, settings));
    blocks.extend(curves(&scores, settings));
    blocks.extend(falls(&scores, settings));
    blocks.push(Block::heading("All points"));
    blocks.push(Block::Table(all(&scores, settings)));
    blocks.push(Block::text(
        "Means over places, in brackets the 95 % interval of places; one place has none. Every rollout is in the CSV \
         beside this page. GFLOP and GB are counted from the graphs, which frame generation and scaling are no part of; they \
         are in the seconds of computing, which other rollouts and other programs on the machine lengthen.",
    ));
    Document::new(&format!("Sweep {}", settings.name()), &blocks)
}

fn head(sweep: &Sweep<'_>) -> Vec<Block> {
    let Sweep { settings, bundle, found, kept } = sweep;
    let families: Vec<&str> = settings.families.iter().map(|family| family.name()).collect();
    let scenes = if settings.scenes_per_family == 1 {
        "one place".to_owned()
    } else {
        format!("{} places", settings.scenes_per_family)
    };
    let [width, height] = settings.size;
    let mut blocks = vec![Block::text(format!(
        "{}: {} operating points in {scenes} each of {}, {} s of world time, compared at {width}x{height}. {} rollouts, {kept} of \
         them kept from before.",
        bundle.manifest().name,
        settings.points.len(),
        families.join(", "),
        settings.seconds,
        found.len()
    ))];
    blocks.push(Block::text(
        "A rollout of every point goes through every place, from the same seed picture with the same controls and noise, and is \
         measured against what the renderer draws of the same walk. What each figure is, docs/sweep.md and docs/study.md tell.",
    ));
    blocks.extend(whole_walks(settings));
    if bundle.manifest().provenance.get("weights").is_some_and(|weights| weights.starts_with("random")) {
        blocks.push(Block::text("**This world has random weights: its pictures mean nothing.**"));
    }
    blocks
}

/// Note on the windows that no walk of this length fills, if the sweep has several: their points cannot differ.
fn whole_walks(settings: &Settings) -> Option<Block> {
    let duration = WorldTime::parse(&settings.seconds).ok()?;
    let points = settings.points.iter().map(|point| &point.point);
    let never_full = points.clone().filter(|point| u64::from(point.global_window) >= point.counts(duration).latents);
    let windows: BTreeSet<u32> = never_full.map(|point| point.global_window).collect();
    let latents = points.map(|point| point.counts(duration).latents).max()?;
    (windows.len() > 1).then(|| {
        let windows: Vec<String> = windows.iter().map(|window| format!("g{window}")).collect();
        Block::text(format!(
            "A walk has {latents} latents at most, so {} hold all of it: points that differ in nothing but such windows make the same \
             frames. They are charged for the whole window, which their graphs work through.",
            windows.join(", ")
        ))
    })
}

fn asset(settings: &Settings, name: &str, svg: String) -> Asset {
    Asset::svg(&format!("{}-{name}", settings.name()), svg)
}

/// A point as a mark in a chart.
fn mark(score: &Score<'_>, measure: Measure, label: String) -> Option<Mark> {
    let estimate = score.estimate(measure).filter(|estimate| estimate.mean.is_finite())?;
    let words = format!("{}: {}", score.point, formatted(Some(estimate), measure.digits()));
    Some(Mark { x: score.cost, y: estimate.mean, interval: estimate.interval, words, label })
}

/// Coherence against compute, with the Pareto front.
fn pareto(scores: &[Score<'_>], measure: Measure, settings: &Settings) -> Vec<Block> {
    let front = front(scores, measure);
    let number = |n: usize| front.iter().position(|&on| on == n).map(|rank| (rank + 1).to_string());
    let group = |name: &str, wanted: bool| {
        let marks = (0..scores.len()).filter(|&n| number(n).is_some() == wanted);
        let marks = marks.filter_map(|n| mark(&scores[n], measure, number(n).unwrap_or_default()));
        Group { name: name.into(), marks: marks.collect() }
    };
    let groups = [group("on the front", true), group("beaten", false)];
    let mut steps: Vec<[f64; 2]> = groups[0].marks.iter().map(|mark| [mark.x, mark.y]).collect();
    steps.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let chart = Chart {
        x: settings.cost.title(),
        y: measure.title(),
        groups: &groups,
        joined: false,
        front: &steps,
        budgets: &settings.budgets,
    };
    let mut blocks = vec![Block::heading(format!("Coherence against compute: {measure}"))];
    if steps.is_empty() {
        blocks.push(Block::text("It could not be measured."));
        return blocks;
    }
    blocks.push(Block::figure(
        asset(settings, &format!("pareto-{measure}"), chart.draw()),
        format!(
            "Every point is an operating point, the line the front: for what lies on it no cheaper point is as good. Upright lines \
             are budgets.{}",
            if measure == Measure::Lpips { " Lower is nearer to the truth." } else { "" }
        ),
    ));
    let unit = settings.cost.unit();
    let rows = front.iter().enumerate().map(|(rank, &n)| {
        let cost = format!("{:.2}", scores[n].cost);
        vec![
            (rank + 1).to_string(),
            scores[n].point.to_string(),
            cost,
            formatted(scores[n].estimate(measure), measure.digits()),
        ]
    });
    let head = ["", "from this budget on this point is the best", unit, measure.name()];
    blocks.push(Block::Table(Table::new(2, &head, rows.collect())));
    blocks
}

/// The best operating point for each budget of the file.
fn budgets(scores: &[Score<'_>], settings: &Settings) -> Vec<Block> {
    if settings.budgets.is_empty() {
        return Vec::new();
    }
    let measure = settings.measure;
    let rows = settings.budgets.iter().map(|&budget| match within(scores, measure, budget) {
        None => vec![format!("{budget}"), "none is so cheap".into(), "–".into(), "–".into()],
        Some(n) => vec![
            format!("{budget}"),
            scores[n].point.to_string(),
            format!("{:.2}", scores[n].cost),
            formatted(scores[n].estimate(measure), measure.digits()),
        ],
    });
    let unit = settings.cost.unit();
    let (given, used) = (format!("budget, {unit}"), format!("{unit} used"));
    let head = [given.as_str(), "operating point", used.as_str(), measure.name()];
    vec![Block::heading("The operating point for a budget"), Block::Table(Table::new(2, &head, rows.collect()))]
}

/// An axis of a chart: its title, its value, and the legend of a line.
type Axis = (&'static str, fn(&Score<'_>) -> u32, fn(&Point) -> String);

const AXES: [Axis; 2] = [
    ("passes", |s| s.passes, |p| format!("g{}", p.point.global_window)),
    ("window", |s| s.point.point.global_window, |p| p.point.schedule.to_string()),
];

/// Coherence over compute along one axis, for example the paper's step from g384 with 10 passes to g512 with 12.
fn curves(scores: &[Score<'_>], settings: &Settings) -> Vec<Block> {
    let measure = settings.measure;
    let Some(first) = settings.points.first() else { return Vec::new() };
    // Only points that share the first point's other settings, so that lines do not cross.
    let alike = |point: &Point| {
        let (a, b) = (&point.point, &first.point);
        (a.cache_mode, a.latents_per_second, a.presentation, point.generator)
            == (b.cache_mode, b.latents_per_second, b.presentation, first.generator)
    };
    let mut blocks = Vec::new();
    for (name, value, line) in AXES {
        let mut along: Vec<&Score<'_>> = scores.iter().filter(|score| alike(score.point)).collect();
        along.sort_by_key(|score| value(score));
        let values: BTreeSet<u32> = along.iter().map(|score| value(score)).collect();
        if values.len() < 2 {
            continue;
        }
        let mut groups: Vec<Group> = Vec::new();
        for score in along {
            let Some(mark) = mark(score, measure, value(score).to_string()) else { continue };
            let name = line(score.point);
            match groups.iter_mut().find(|group| group.name == name) {
                Some(group) => group.marks.push(mark),
                None => groups.push(Group { name, marks: vec![mark] }),
            }
        }
        groups.truncate(MOST_LINES);
        let chart = Chart {
            x: settings.cost.title(),
            y: measure.title(),
            groups: &groups,
            joined: true,
            front: &[],
            budgets: &[],
        };
        let svg = chart.draw();
        if svg.is_empty() {
            continue;
        }
        if blocks.is_empty() {
            blocks.push(Block::heading("Is more compute better?"));
        }
        let words = format!(
            "{measure} as the {name} {}, all else as in {first}: the number beside a point is its own, a line's is at the right. A \
             line that falls is what the paper calls non-monotonic.",
            if name == "passes" { "of a latent grow" } else { "grows" }
        );
        blocks.push(Block::figure(asset(settings, &format!("curve-{name}"), svg), words));
    }
    blocks
}

/// Steps to more compute with worse results.
fn falls(scores: &[Score<'_>], settings: &Settings) -> Vec<Block> {
    let measure = settings.measure;
    let all = moves(scores, measure);
    if all.is_empty() {
        return Vec::new();
    }
    let mut worse: Vec<_> = all.iter().filter(|step| step.is_worse()).collect();
    worse.sort_by(|a, b| a.gain.mean.total_cmp(&b.gain.mean));
    let surely = worse.iter().filter(|step| step.is_surely_worse()).count();
    let sure = match settings.families.len() as u64 * settings.scenes_per_family {
        1 => "With one place nobody can tell how sure that is.".to_owned(),
        _ => format!("For {surely} of these the whole 95 % interval of places lies below zero."),
    };
    let words = format!(
        "Of {} steps to the next window, the next schedule, the next anchor rate, or several of them at once, {} make the \
         {measure} worse. {sure}",
        all.len(),
        worse.len(),
    );
    let mut blocks = vec![Block::heading("Where more compute is worse"), Block::text(words)];
    let unit = settings.cost.unit();
    let rows = worse.iter().take(MOST_FALLS).map(|step| {
        let (from, to) = (&scores[step.from], &scores[step.to]);
        vec![
            from.point.to_string(),
            to.point.to_string(),
            format!("{:.2} to {:.2}", from.cost, to.cost),
            formatted(Some(step.gain), measure.digits()),
        ]
    });
    let rows: Vec<Vec<String>> = rows.collect();
    if !rows.is_empty() {
        let gain = format!("gain in {measure}");
        let head = ["from", "to", unit, gain.as_str()];
        blocks.push(Block::Table(Table::new(2, &head, rows)));
    }
    blocks
}

fn all(scores: &[Score<'_>], settings: &Settings) -> Table {
    let front = front(scores, settings.measure);
    let rows = scores.iter().enumerate().map(|(n, score)| {
        let mut row = vec![
            score.point.to_string(),
            if front.contains(&n) { "yes" } else { "" }.to_owned(),
            format!("{:.2}", score.cost),
            format!("{:.2}", score.bytes / 1e9),
            format!("{:.2}", score.seconds),
        ];
        row.extend(Measure::ALL.map(|measure| formatted(score.estimate(measure), measure.digits())));
        row
    });
    let cost = if settings.cost == Cost::Gflop { "GFLOP" } else { "cost, s" };
    let head = ["operating point", "on the front", cost, "GB", "s", "horizon, s", "LPIPS", "SSIM", "PSNR, dB"];
    Table::new(2, &head, rows.collect())
}

/// CSV with a line per rollout. Timings are the last columns.
pub(super) fn csv(found: &[CellResult<'_>]) -> String {
    let mut text = String::from(
        "scene,place,window,schedule,passes,cache,anchor_rate,multiplier,motion,generator,gflop,gb,horizon_s,lpips,ssim,psnr_db,\
         ms_ssim,adjacent_error,brightness_drift,flicker,seconds\n",
    );
    for CellResult { cell, passes, budget, metrics } in found {
        let (point, scene) = (&cell.point.point, cell.scene);
        let motion = match point.presentation {
            Presentation::Native => String::new(),
            Presentation::Generated { guidance, .. } => guidance.to_string(),
        };
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{},{},{},{},{passes},{},{},{},{motion},{},{:.6},{:.6}",
            scene.family,
            scene.seed,
            point.global_window,
            point.schedule,
            point.cache_mode,
            point.latents_per_second,
            cell.point.multiplier(),
            if motion.is_empty() { String::new() } else { cell.point.generator.to_string() },
            budget.flops / 1e9,
            budget.bytes / 1e9
        );
        let RolloutMetrics { horizon, lpips, ssim, psnr, ms_ssim, adjacent_error, brightness_drift, flicker, .. } =
            metrics;
        for value in [horizon, lpips, ssim, psnr, ms_ssim, adjacent_error, brightness_drift, flicker] {
            text.push(',');
            if let Some(value) = value {
                let _ = write!(text, "{value:.6}");
            }
        }
        let _ = writeln!(text, ",{:.3}", budget.times.sum());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::front::tests::{grid, passes, scores};
    use super::*;

    fn words(blocks: &[Block]) -> String {
        Document::new("test", blocks).markdown
    }

    #[test]
    fn every_budget_is_answered() {
        let settings = Settings { budgets: vec![1.0, 50.0], ..grid() };
        let scores = scores(&settings, |point, _| f64::from(passes(point)) / 20.0);
        let text = words(&budgets(&scores, &settings));
        assert!(text.contains("none is so cheap") && text.contains("g128,refined:12"), "{text}");
        assert!(budgets(&scores, &grid()).is_empty());
    }

    #[test]
    fn the_front_is_a_drawing_and_a_table() {
        let settings = grid();
        let scores = scores(&settings, |point, scene| f64::from(passes(point)) / 20.0 + scene as f64 / 100.0);
        let blocks = pareto(&scores, Measure::Ssim, &settings);
        let document = Document::new("test", &blocks);
        assert_eq!(document.assets.len(), 1);
        let svg = String::from_utf8(document.assets[0].bytes.clone()).unwrap();
        assert_eq!(svg.matches("<title>").count(), 9, "each point is there once");
        // Here only the number of passes affects the score, so only the smallest window is on the front.
        let rows: Vec<&str> = document.markdown.lines().filter(|line| line.contains("| g")).collect();
        assert!(rows.len() == 3 && rows.iter().all(|row| row.contains("g128")), "{rows:?}");
        assert!(words(&pareto(&scores, Measure::Horizon, &settings)).contains("could not be measured"));
    }

    #[test]
    fn windows_that_no_walk_fills_are_named() {
        let lasting = |seconds: &str| Settings { seconds: seconds.into(), ..grid() };
        let text = words(&Vec::from_iter(whole_walks(&lasting("15"))));
        assert!(text.contains("226 latents") && text.contains("g384, g512 hold"), "{text}");
        // Only one window is never full, so there is no other with the same frames.
        assert!(whole_walks(&lasting("30")).is_none());
    }

    #[test]
    fn curves_go_along_what_was_swept() {
        let settings = grid();
        let found = scores(&settings, |point, _| f64::from(point.point.global_window) / 1000.0);
        let document = Document::new("test", &curves(&found, &settings));
        assert_eq!(document.assets.len(), 2);
        for asset in &document.assets {
            let svg = String::from_utf8(asset.bytes.clone()).unwrap();
            assert_eq!(svg.matches("stroke-width=\"1.5\"").count(), 3, "{}", asset.path);
        }
        let one = super::super::plan::tests::parse("").unwrap();
        assert!(curves(&scores(&one, |_, _| 0.5), &one).is_empty());
        assert!(falls(&scores(&one, |_, _| 0.5), &one).is_empty());
    }

    #[test]
    fn falls_are_counted_and_shown() {
        let settings = grid();
        let found = scores(&settings, |point, _| if point.point.global_window == 512 { 0.2 } else { 0.5 });
        let text = words(&falls(&found, &settings));
        assert!(text.contains("Of 16 steps") && text.contains("g384,refined:8") && text.contains("-0.3000"), "{text}");
    }
}
