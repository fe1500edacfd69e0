//! Counts of a run of the test program, and of the graphs.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use provision::Console;
use serde::Deserialize;

use super::{Counts, MINIATURE, PAGE, PRESET, RECORD, Row, Table};
use crate::shell::Log;
use crate::test::{for_windows, with_recorder};
use crate::workspace::{self, Workspace};

/// The variable that names the file in which the test program writes its counts.
pub(crate) const FILE_VARIABLE: &str = "CAIRN_COUNTS";
/// The test of the program `recorder` that counts.
const TEST: &str = "counts::a_step_runs_its_passes_and_its_decode_and_nothing_else_dispatches";
/// The bundle of the world inside the library.
const BUNDLE: &str = "samples/worlds/miniature.cairn";

/// Parts of a latent step, by the names of their events, and the graph that runs in each.
const PARTS: [(&str, &str, Option<&str>); 6] = [
    ("controls", "Cairn: controls", Some("controls")),
    ("pass", "Cairn: transformer", Some("transformer")),
    ("decode", "Cairn: decoder", Some("decoder")),
    ("finite check", "Cairn: check for NaN and infinity", None),
    ("commit", "Cairn: commit", None),
    ("uploads and timestamps", "", None),
];

/// What the test program writes.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Run {
    device: String,
    window: u64,
    passes: u64,
    /// By the name of the event, then of the count.
    step: BTreeMap<String, BTreeMap<String, u64>>,
    /// Name and type of DirectML's operators, by graph.
    operators: BTreeMap<String, Vec<(String, String)>>,
    /// Costs of the graphs, which the library counts.
    costs: BTreeMap<String, GraphCost>,
}

#[derive(Debug, PartialEq, Eq, Deserialize)]
struct GraphCost {
    multiply_adds: u64,
    bytes: u64,
}

/// What `cairn.build costs` prints of a world.
#[derive(Debug, Deserialize)]
struct WorldCosts {
    window: u64,
    graphs: BTreeMap<String, Vec<NodeCost>>,
}

/// A node of a graph that runs: name, operator, name of its first output, multiply-adds, bytes read and bytes written.
#[derive(Debug, Deserialize)]
struct NodeCost(String, String, String, u64, u64, u64);

impl NodeCost {
    /// Adds the node to counts.
    fn add_to(&self, values: &mut BTreeMap<String, u64>) {
        let counts = [("nodes", 1), ("multiply_adds", self.3), ("bytes_read", self.4), ("bytes_written", self.5)];
        for (name, count) in counts {
            *values.entry(name.to_owned()).or_default() += count;
        }
    }
}

/// Layer of a node by its name, such as `blocks.3` or `decoder.10`.
fn layer(node: &str) -> String {
    let mut parts = node.split('/').next().unwrap_or_default().split('.');
    match (parts.next(), parts.next()) {
        (Some(kind @ ("blocks" | "decoder")), Some(number)) if number.parse::<u32>().is_ok() => {
            format!("{kind}.{number}")
        }
        _ => "outside".to_owned(),
    }
}

/// The name of the ONNX value that an operator computes.
fn value_of(operator: &str) -> &str {
    operator.rsplit_once("_dmlEp_").map_or(operator, |(value, _)| value)
}

/// Rows of a graph by layer, by type of node and by type of operator.
fn rows(
    world: &str,
    nodes: &[NodeCost],
    operators: &[(String, String)],
    [by_layer, by_node_type, by_operator_type]: [Table; 3],
) -> Vec<Row> {
    let mut groups: Vec<Row> = Vec::new();
    let mut group = |table, name: &str| -> usize {
        let found = groups.iter().position(|row| row.table == table && row.name == name);
        found.unwrap_or_else(|| {
            groups.push(Row { world: world.into(), table, name: name.into(), values: BTreeMap::new() });
            groups.len() - 1
        })
    };
    let mut nodes_in = Vec::new();
    for node in nodes {
        nodes_in.push((group(by_layer, &layer(&node.0)), group(by_node_type, &node.1), node));
    }
    let mut operators_in = Vec::new();
    for (name, kind) in operators {
        let node = nodes.iter().find(|node| node.2 == value_of(name));
        let layer = node.map_or_else(|| layer(name), |node| layer(&node.0));
        operators_in.push([group(by_layer, &layer), group(by_operator_type, kind)]);
    }
    for (layer, kind, node) in nodes_in {
        [layer, kind].into_iter().for_each(|i| node.add_to(&mut groups[i].values));
    }
    for i in operators_in.into_iter().flatten() {
        *groups[i].values.entry("operators".into()).or_default() += 1;
    }
    // In the order of the layers; types by their number.
    groups.sort_by_key(|row| {
        let number = row.name.split('.').nth(1).and_then(|number| number.parse::<u64>().ok());
        let count = row.values.get("nodes").or(row.values.get("operators")).copied().unwrap_or(0);
        let place = if row.table == by_layer { number.unwrap_or(u64::MAX) } else { u64::MAX - count };
        (row.table.name(), place, row.name.clone())
    });
    groups
}

/// Counts from what the test program wrote and what `cairn.build costs` printed.
///
/// Fails where the two count the embedded world's graphs differently.
fn counts(run: &str, costs: &str) -> Result<Counts, String> {
    let run: Run = serde_json::from_str(run).map_err(|e| format!("the counts of the step: {e}"))?;
    let costs: BTreeMap<String, WorldCosts> =
        serde_json::from_str(costs).map_err(|e| format!("the costs of the graphs: {e}"))?;
    let world = |name: &str| costs.get(name).ok_or_else(|| format!("there are no costs of the world {name}"));
    let nodes = |name: &str, graph: &str| -> Result<&[NodeCost], String> {
        world(name)?.graphs.get(graph).map(Vec::as_slice).ok_or_else(|| format!("{name} has no graph {graph}"))
    };
    if world(MINIATURE)?.window != run.window {
        return Err(format!("the step ran at window {}, not at {}", run.window, world(MINIATURE)?.window));
    }
    for (graph, library) in &run.costs {
        let all = nodes(MINIATURE, graph)?;
        let builder = GraphCost {
            multiply_adds: all.iter().map(|node| node.3).sum(),
            bytes: all.iter().map(|node| node.4 + node.5).sum(),
        };
        if builder != *library {
            return Err(format!("the {graph}: the library counts {library:?}, the builder {builder:?}"));
        }
    }
    let mut all = Vec::new();
    for (name, event, graph) in PARTS {
        let mut values = run.step.get(event).cloned().ok_or_else(|| format!("nothing ran in {event:?}"))?;
        let runs = values.remove("events").unwrap_or_default().max(1);
        values.values_mut().for_each(|value| *value /= runs);
        if let Some(graph) = graph {
            nodes(MINIATURE, graph)?.iter().for_each(|node| node.add_to(&mut values));
            let operators = run.operators.get(graph).map_or(0, Vec::len) as u64;
            values.insert("operators".into(), operators);
        }
        all.push(Row { world: MINIATURE.into(), table: Table::Parts, name: name.into(), values });
    }
    let tables = [
        ("pass", "transformer", [Table::PassByLayer, Table::PassByNodeType, Table::PassByOperatorType]),
        ("decode", "decoder", [Table::DecodeByLayer, Table::DecodeByNodeType, Table::DecodeByOperatorType]),
    ];
    for (_, graph, tables) in tables {
        let operators = run.operators.get(graph).ok_or_else(|| format!("there are no operators of the {graph}"))?;
        all.extend(rows(MINIATURE, nodes(MINIATURE, graph)?, operators, tables));
    }
    let mut of_controls = BTreeMap::new();
    nodes(PRESET, "controls")?.iter().for_each(|node| node.add_to(&mut of_controls));
    all.push(Row { world: PRESET.into(), table: Table::Parts, name: "controls".into(), values: of_controls });
    for (name, graph, tables) in tables {
        let mut values = BTreeMap::new();
        nodes(PRESET, graph)?.iter().for_each(|node| node.add_to(&mut values));
        all.push(Row { world: PRESET.into(), table: Table::Parts, name: name.into(), values });
        all.extend(rows(PRESET, nodes(PRESET, graph)?, &[], tables));
    }
    // The adapter's name is one that Wine invents.
    let runtime = run.device.split(" on ").next().unwrap_or_default().to_owned();
    Ok(Counts { runtime, passes: run.passes, rows: all })
}

/// Counts of a run of the test program, which wrote `file`. `python` has the packages of the builder.
pub(crate) fn from_run(workspace: &Workspace, file: &Path, python: &Path, log: &mut Log) -> Result<Counts, String> {
    let mut command = Command::new(python);
    command.args(["-m", "cairn.build", "costs", BUNDLE, "--preset", PRESET]);
    let ended = log.run(command.current_dir(&workspace.root).env("PYTHONPATH", provision::python_path()))?;
    if !ended.success {
        return Err(format!("cairn.build costs failed: {}", ended.output));
    }
    let run = std::fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
    counts(&run, &ended.output)
}

/// Counts a latent step in the lab, or on Windows itself, and prints the page, or writes the record and the page.
pub(crate) fn bench(workspace: &Workspace, is_published: bool) -> Result<(), String> {
    if is_published && cfg!(windows) {
        return Err("the record has the lab's counts, which a GPU's driver may change: publish on Linux".to_owned());
    }
    let console = Console::new();
    let failed = |e: provision::Error| e.to_string();
    let (library, python) = (
        provision::onnxruntime_for_windows(&console).map_err(failed)?,
        provision::python_env(&console).map_err(failed)?,
    );
    let folder = workspace.target.join("xtask");
    let mut log = Log::new(&folder.join("count.log"), "counting a latent step")?;
    let mut build = workspace.cargo(["build", "--package", "d3d12-recorder", "--lib"]);
    for_windows(&mut build)?;
    let mut test = workspace.cargo(["test", "--package", "cairn", "--test", "recorder"]);
    for_windows(&mut test)?;
    let file = folder.join("count.json");
    workspace::remove(&file)?;
    test.args(["--", "--exact", TEST]);
    test.env("CAIRN_ONNXRUNTIME", library).env(FILE_VARIABLE, &file);
    let mut must_run = |command: &mut Command| -> Result<(), String> {
        match log.run(command)? {
            ended if ended.success => Ok(()),
            _ => Err(format!("counting failed: {} says why", folder.join("count.log").display())),
        }
    };
    must_run(&mut build)?;
    with_recorder(&workspace.windows_programs(), &mut test, must_run)?;
    let counts = from_run(workspace, &file, &python, &mut log)?;
    if is_published {
        counts.publish(workspace)?;
        log.end(&format!("wrote {RECORD} and {PAGE}"));
    } else {
        log.end("counted");
        print!("{}", counts.page());
        Counts::differences(&Counts::read(workspace)?, &counts).iter().for_each(|line| println!("{line}"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the test program writes of a step of two passes, with this many multiply-adds of the transformer.
    fn run(multiply_adds: u64) -> String {
        let event = |events: u64, dispatches: u64| format!("{{\"events\": {events}, \"dispatches\": {dispatches}}}");
        format!(
            "{{\"device\": \"DirectML on a GPU\", \"window\": 16, \"passes\": 2,
            \"step\": {{\"Cairn: controls\": {}, \"Cairn: transformer\": {}, \"Cairn: decoder\": {}, \"Cairn: check for NaN and infinity\": {}, \"Cairn: commit\": {}, \"\": {}}},
            \"operators\": {{\"transformer\": [[\"y_dmlEp_0\", \"GEMM\"], [\"y_dmlEp_1\", \"CAST\"]], \"decoder\": []}},
            \"costs\": {{\"transformer\": {{\"multiply_adds\": {multiply_adds}, \"bytes\": 12}}}}}}",
            event(1, 2),
            event(2, 10),
            event(1, 3),
            event(1, 1),
            event(1, 0),
            event(0, 0),
        )
    }

    /// What the builder prints: a product in a layer, and a node outside.
    fn costs() -> String {
        let world = r#"{"window": 16, "graphs": {"transformer": [["blocks.1.q/MatMul", "MatMul", "y", 8, 6, 2], ["sigma/Mul", "Mul", "s", 0, 3, 1]], "controls": [["ctrl.emb/MatMul", "MatMul", "c", 4, 4, 1]], "decoder": []}}"#;
        format!("{{\"{MINIATURE}\": {world}, \"{PRESET}\": {world}}}")
    }

    #[test]
    fn passes_are_divided_and_operators_follow_the_nodes_whose_values_they_compute() {
        let counts = counts(&run(8), &costs()).unwrap();
        let row = |table, name: &str| {
            let found = counts.table(MINIATURE, table).find(|row| row.name == name);
            found.unwrap_or_else(|| panic!("{name} in {counts:?}")).values.clone()
        };
        let values =
            |list: &[(&str, u64)]| list.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect::<BTreeMap<_, _>>();
        let sums = [("nodes", 2), ("multiply_adds", 8), ("bytes_read", 9), ("bytes_written", 3)];
        assert_eq!(row(Table::Parts, "pass"), values(&[&[("dispatches", 5), ("operators", 2)], &sums[..]].concat()));
        assert_eq!(row(Table::Parts, "decode")["dispatches"], 3);
        assert_eq!(
            (row(Table::Parts, "controls")["dispatches"], row(Table::Parts, "controls")["multiply_adds"]),
            (2, 4)
        );
        let in_layer = [("nodes", 1), ("multiply_adds", 8), ("bytes_read", 6), ("bytes_written", 2), ("operators", 2)];
        assert_eq!(row(Table::PassByLayer, "blocks.1"), values(&in_layer));
        assert_eq!(row(Table::PassByLayer, "outside")["nodes"], 1);
        assert_eq!(row(Table::PassByOperatorType, "GEMM"), values(&[("operators", 1)]));
        assert_eq!(counts.runtime, "DirectML");
    }

    #[test]
    fn counts_on_which_library_and_builder_disagree_are_refused() {
        let why = counts(&run(9), &costs()).unwrap_err();
        assert!(why.starts_with("the transformer: the library counts") && why.contains("multiply_adds: 9"), "{why}");
        let why = counts(&run(8).replace("\"window\": 16", "\"window\": 8"), &costs()).unwrap_err();
        assert!(why.contains("window 8, not at 16"), "{why}");
        let why = counts(&run(8).replace("Cairn: decoder", "Cairn: else"), &costs()).unwrap_err();
        assert!(why.contains("Cairn: decoder"), "{why}");
    }
}
