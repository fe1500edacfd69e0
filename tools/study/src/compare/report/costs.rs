//! Operating points, machine and budgets: the paper's Tables 2 to 4.

use std::collections::BTreeSet;

use super::super::branch::{Branch, cadence};
use super::super::budget::{Budget, Times, is_half};
use super::super::make::Rollouts;
use super::super::plan::{Cell, Settings};
use super::curves::bars;
use super::paper::{STACK, point};
use super::{Asset, Block, Results, Table};
use crate::machine::{LibraryVersion, Versions};

/// The paper's Table 2.
pub(super) fn operating_points(settings: &Settings) -> Vec<Block> {
    let rows: Vec<Vec<String>> = Branch::ALL
        .into_iter()
        .map(|branch| {
            let points: Vec<_> = settings.families.iter().map(|&family| branch.point(family)).collect();
            let windows: BTreeSet<u32> = points.iter().map(|point| point.global_window).collect();
            let windows: Vec<String> = windows.iter().map(|g| format!("g{g}")).collect();
            let first =
                points.first().map(|point| (format!("{}, {}", point.schedule, point.cache_mode), cadence(point)));
            let (schedule, cadence) = first.unwrap_or_default();
            let theirs = point(branch).unwrap_or("not there").to_owned();
            vec![branch.name().into(), windows.join(", "), schedule, cadence, branch.role().into(), theirs]
        })
        .collect();
    let head = ["branch", "context", "schedule, cache", "cadence and presentation", "role", "paper"];
    vec![
        Block::heading("Table 2: operating points"),
        Block::Table(Table::new(head.len(), &head, rows)),
        Block::text(
            "Context, passes and cache mode are the paper's to the letter; its \"refined schedule\" it does not define, and \
             refined:N is our reading of it. \"About 30 FPS natively\" can be read in two ways, so there are two baselines: two \
             decoded pictures of each latent, and twice as many latents.",
        ),
    ]
}

/// The paper's Table 3, from the manifests.
pub(super) fn machine(found: &Results<'_>) -> Vec<Block> {
    let cells = &found.made.cells;
    let of = |of: &dyn Fn(&Versions) -> Option<String>| {
        let found: BTreeSet<String> = cells.iter().filter_map(|(_, manifest)| of(&manifest.versions)).collect();
        found.into_iter().collect::<Vec<_>>().join("; ")
    };
    let or = |text: String, none: &str| if text.is_empty() { none.to_owned() } else { text };
    let half = cells.iter().any(|(_, manifest)| is_half(manifest, found.bundle));
    let generators = of(&|v| Some(v.generator.clone()));
    let bridge = format!("{generators}; upscaling: {}", found.settings.upscaler);
    // Each library once; some branches load more of them than others.
    let named = |l: &LibraryVersion| format!("{} {}", l.name, l.version.as_deref().unwrap_or("of no version"));
    let libraries = cells.iter().flat_map(|(_, manifest)| manifest.versions.libraries.iter().map(named));
    let libraries = libraries.collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>().join(", ");
    let row = |item: &str, theirs: &str, ours: String| vec![item.to_owned(), theirs.to_owned(), ours];
    let rows = vec![
        row("GPU", STACK.gpu, or(of(&|v| Some(v.adapter.as_ref()?.name.clone())), "none: the processor")),
        row("driver", STACK.driver, or(of(&|v| v.adapter.as_ref()?.driver.clone()), "none")),
        row("operating system", STACK.system, of(&|v| Some(v.os.clone()))),
        row("world-model runtime", STACK.runtime, of(&|v| v.device.clone())),
        row("precision of the model", STACK.precision, if half { "f16" } else { "f32" }.into()),
        row("presentation", STACK.bridge, bridge),
        row("libraries of others", "", or(libraries, "none but ONNX Runtime")),
        row("processor", "", of(&|v| Some(v.cpu.clone()))),
        row("threads of a pass", "", of(&|v| v.threads.map(|n| n.to_string()))),
        row("this library", "", of(&|v| Some(v.cairn.clone()))),
        row("optimised build", "", of(&|v| Some(if v.optimised_build { "yes" } else { "no" }.into()))),
    ];
    vec![
        Block::heading("Table 3: hardware and software"),
        Block::Table(Table::new(3, &["item", "paper", "here"], rows)),
        Block::text(
            "As the manifests of all rollouts recorded it. Times and frame rates of the two columns have nothing to do with each \
             other; what the model computes from the same weights may be compared.",
        ),
    ]
}

/// The paper's Table 4 with numbers: cost of a second of world time.
pub(super) fn costs(made: &Rollouts, budgets: &[Budget]) -> Vec<Block> {
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
                show(&|b| b.flops / 1e9 / b.native, 2),
                show(&|b| b.bytes / 1e9, 2),
            ]
        })
        .collect();
    let head = [
        "branch",
        "latents",
        "passes",
        "frames shown",
        "GFLOP",
        "over baseline",
        "GFLOP of a native frame",
        "GB moved",
    ];
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
        Block::heading("Table 4: cadence and budget of a second of world time"),
        Block::Table(counted),
        Block::text(
            "GFLOP are those of matrix products and convolutions, GB what the graphs' nodes read and write, each node on its \
             own: both are counted from the graphs. Frame generation and scaling run outside of graphs and are in the times \
             alone. coherence-best and decoded-60 are charged with the latents that they share with coherence. The paper's \"compute-normalized\" is \
             an equal time scale, not an equal number of operations; the column \"over baseline\" says how far from equal the \
             operations are. A native frame is one that the world made; the paper gives it \"roughly twice the generation \
             budget\" in coherence.",
        ),
        Block::figure(Asset::svg("budget", bars(&flops, "GFLOP")), "GFLOP of a second of world time."),
        Block::heading("Seconds of computing for a second of world time"),
        Block::Table(Table::new(1, &head_of_times(), rows_of_times)),
        Block::text(
            "As measured, means over all places. Rollouts that were made at the same time, and other programs, shared the \
             machine: with --jobs 1 on an idle one the times are a branch's own. The paper has no such times, and says that its \
             frame rates are those of the presentation.",
        ),
    ]
}

fn head_of_times() -> [&'static str; 7] {
    ["branch", "world", "decoding", "motion", "generation", "scaling", "all"]
}
