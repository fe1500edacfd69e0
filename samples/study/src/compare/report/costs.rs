//! Operating points, machine and budgets: Tables 2 to 4 of the paper.

use std::collections::BTreeSet;

use super::super::branch::{Branch, cadence};
use super::super::budget::{Budget, Times};
use super::super::make::Made;
use super::super::plan::{Cell, Settings};
use super::curves::bars;
use super::{Block, Table};

/// The paper's Table 2.
pub(super) fn operating_points(settings: &Settings) -> Vec<Block> {
    let rows: Vec<Vec<String>> = Branch::ALL
        .into_iter()
        .map(|branch| {
            let points: Vec<_> = settings.scenes.iter().map(|&family| branch.point(family)).collect();
            let windows: BTreeSet<u32> = points.iter().map(|point| point.global_window).collect();
            let windows: Vec<String> = windows.iter().map(|g| format!("g{g}")).collect();
            let first = points.first().map(|point| (point.schedule.to_string(), cadence(point))).unwrap_or_default();
            vec![branch.name().into(), windows.join(", "), first.0, first.1, branch.role().into()]
        })
        .collect();
    let head = ["branch", "context", "schedule", "cadence and presentation", "role"];
    vec![Block::heading("Operating points (the paper's Table 2)"), Block::Table(Table::new(head.len(), &head, rows))]
}

/// The paper's Table 3, as the manifests recorded it.
pub(super) fn machine(made: &Made) -> Vec<Block> {
    let item = |name: &str, of: &dyn Fn(&crate::machine::Versions) -> Option<String>| {
        let found: BTreeSet<String> = made.cells.iter().filter_map(|(_, manifest)| of(&manifest.versions)).collect();
        vec![name.to_owned(), found.into_iter().collect::<Vec<_>>().join("; ")]
    };
    let rows = vec![
        item("processor", &|v| Some(v.cpu.clone())),
        item("device of the world", &|v| v.device.clone()),
        item("operating system", &|v| Some(v.os.clone())),
        item("ONNX Runtime", &|v| v.onnxruntime.clone()),
        item("frame generation", &|v| Some(v.generator.clone())),
        item("this library", &|v| Some(v.cairn.clone())),
        item("threads of a pass", &|v| v.threads.map(|n| n.to_string())),
        item("optimised build", &|v| Some(if v.optimised_build { "yes" } else { "no" }.into())),
    ];
    vec![
        Block::heading("Hardware and software (Table 3)"),
        Block::Table(Table::new(2, &["item", "recorded value"], rows)),
        Block::text("As the manifests of all rollouts recorded it."),
    ]
}

/// The paper's Table 4 with figures: what a second of world time takes.
pub(super) fn costs(made: &Made, budgets: &[Budget]) -> Vec<Block> {
    let of = |branch: Branch| -> Vec<&Budget> {
        let pairs = made.cells.iter().zip(budgets);
        pairs.filter(|((cell, _), _): &(&(Cell, _), _)| cell.branch == branch).map(|(_, budget)| budget).collect()
    };
    let mean = |branch: Branch, value: &dyn Fn(&Budget) -> f64| {
        let all = of(branch);
        all.iter().map(|budget| value(budget)).sum::<f64>() / all.len().max(1) as f64
    };
    let baseline = mean(Branch::Baseline, &|budget| budget.flops);
    let rows: Vec<Vec<String>> = Branch::ALL
        .into_iter()
        .map(|branch| {
            let show = |value: &dyn Fn(&Budget) -> f64, digits: usize| format!("{:.digits$}", mean(branch, value));
            vec![
                branch.name().into(),
                show(&|b| b.latents, 1),
                show(&|b| b.passes, 0),
                show(&|b| b.presented, 1),
                show(&|b| b.flops / 1e9, 2),
                format!("{:.2}", mean(branch, &|b| b.flops) / baseline),
                show(&|b| b.bytes / 1e9, 2),
            ]
        })
        .collect();
    let head = ["branch", "latents", "passes", "frames shown", "GFLOP", "over baseline", "GB moved"];
    let counted = Table::new(1, &head, rows);
    let flops = Branch::ALL.map(|branch| (branch.name(), mean(branch, &|budget| budget.flops / 1e9)));

    let rows_of_times: Vec<Vec<String>> = Branch::ALL
        .into_iter()
        .map(|branch| {
            let of: [fn(&Times) -> f64; 6] =
                [|t| t.world, |t| t.decode, |t| t.guidance, |t| t.generation, |t| t.upscaling, Times::sum];
            let times = of.map(|of| format!("{:.2}", mean(branch, &|budget| of(&budget.times))));
            [branch.name().to_owned()].into_iter().chain(times).collect()
        })
        .collect();
    vec![
        Block::heading("Budget of a second of world time (Table 4), counted"),
        Block::Table(counted),
        Block::text(
            "GFLOP are those of matrix products and convolutions, GB what the graphs' nodes read and write, each node on its \
             own: both are counted from the graphs. Frame generation and scaling run outside of graphs and are in the times \
             alone. decoded-60 is charged with the latents that it shares with coherence. The paper's \"compute-normalized\" is \
             an equal time scale, not an equal number of operations; the column \"over baseline\" says how far from equal the \
             operations are.",
        ),
        Block::Curves { words: "GFLOP of a second of world time".into(), svg: bars(&flops, "GFLOP") },
        Block::heading("Seconds of computing for a second of world time, measured"),
        Block::Table(Table::new(1, &head_of_times(), rows_of_times)),
        Block::text(
            "Means over all places. Rollouts that were made at the same time shared the machine: with --jobs 1 the times are a \
             branch's own.",
        ),
    ]
}

fn head_of_times() -> [&'static str; 7] {
    ["branch", "world", "decoding", "motion", "generation", "scaling", "all"]
}
