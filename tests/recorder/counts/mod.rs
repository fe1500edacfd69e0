//! The work that a latent step of the embedded world gives to the device, counted at the interfaces of DirectML and of Direct3D 12.
//!
//! `cargo xtask test recorder` compares the counts with `xtask/counts.toml`; `cargo xtask bench --lab --count` prints them.

mod operators;

use std::collections::BTreeMap;

use cairn::bundle::{Bundle, GraphCost, OpenOptions, Precision};
use cairn::gpu::Gpu;
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{World, WorldOptions};
use serde_json::json;
use test_support::d3d12::recorder::take_counts;
use test_support::worlds::{controls, ort, point, seeded};

use operators::Operator;

/// Name of the file for the counts, if they are wanted.
const FILE: &str = "CAIRN_COUNTS";

/// Passes of a step: four denoise passes and the cache pass.
const PASSES: u64 = 5;

/// The graphs, each with the start of a name that only its operators have.
const GRAPHS: [(&str, &str); 4] =
    [("transformer", "blocks.0.attn"), ("controls", "ctrl."), ("encoder", "encoder."), ("decoder", "decoder.")];

#[test]
fn a_step_runs_its_passes_and_its_decode_and_nothing_else_dispatches() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let device = Device::directml(&ort(), &gpu, DirectMlOptions::default()).expect("DirectML");
    operators::install(&gpu);
    let bundle = Bundle::embedded(&OpenOptions::default()).expect("it is inside");
    let options = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
    let world = World::load(&device, &bundle, options).expect("a world");
    let mut rollout = seeded(&world, &point(&world), 7);
    take_counts();
    rollout.step(&controls(0)).expect("a step");
    let step = take_counts();
    // Waits for all submitted work before the rollout's end.
    rollout.latent().expect("a latent");

    let events: BTreeMap<&str, u64> = step.iter().map(|(name, counts)| (name.as_str(), counts["events"])).collect();
    let expected = [
        ("", 0),
        ("Cairn: commit", 1),
        ("Cairn: controls", 1),
        ("Cairn: decoder", 1),
        ("Cairn: check for NaN and infinity", 1),
        ("Cairn: transformer", PASSES),
    ];
    assert_eq!(events, BTreeMap::from(expected));
    for name in ["", "Cairn: commit"] {
        assert_eq!(step[name]["dispatches"], 0, "{name:?} only copies");
    }
    for (name, count) in &step["Cairn: transformer"] {
        assert_eq!(count % PASSES, 0, "{name}: every pass of a step submits the same");
    }

    let cost = bundle.cost(Precision::F16, world.global_window()).expect("a cost");
    let of = |cost: GraphCost| json!({ "multiply_adds": cost.multiply_adds, "bytes": cost.bytes });
    let counts = json!({
        "device": device.describe(),
        "window": world.global_window(),
        "passes": PASSES,
        "step": step,
        "operators": operators_by_graph(),
        "costs": {
            "transformer": of(cost.pass),
            "controls": of(cost.controls),
            "encoder": of(cost.encode), "decoder": of(cost.decode),
        },
    });
    if let Some(file) = std::env::var_os(FILE) {
        std::fs::write(&file, counts.to_string()).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    }
}

/// The operators of the world's graphs, each as its name and its type. DirectML compiles each graph as one operator.
fn operators_by_graph() -> BTreeMap<&'static str, Vec<[String; 2]>> {
    let compiled = operators::recorded_graphs();
    let graph = |(graph, start): (&'static str, &str)| {
        let is_of = |operators: &&Vec<Operator>| operators.iter().any(|operator| operator.name.starts_with(start));
        let mut found = compiled.iter().filter(is_of);
        let operators = found.next().unwrap_or_else(|| panic!("DirectML compiled and ran the {graph} as a graph"));
        assert!(found.next().is_none(), "the {graph} is one graph for DirectML");
        (graph, operators.iter().map(|operator| [operator.name.clone(), operator.kind_name()]).collect())
    };
    GRAPHS.into_iter().map(graph).collect()
}
