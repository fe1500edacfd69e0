//! The page of the counts.

use std::fmt::Write as _;

use super::{COMMAND, Counts, MINIATURE, PRESET, RECORD, Row, TOLERANCE, Table};

/// What a count is of a table's row, and how it is shown.
struct Column {
    title: &'static str,
    count: &'static str,
    show: fn(u64) -> String,
}

const fn column(title: &'static str, count: &'static str, show: fn(u64) -> String) -> Column {
    Column { title, count, show }
}

/// Counts of the parts of a step.
const PARTS: [Column; 14] = [
    column("ONNX nodes that run", "nodes", number),
    column("DirectML operators", "operators", number),
    column("dispatches", "dispatches", number),
    column("calls that record barriers", "barrier_calls", number),
    column("UAV barriers", "uav_barriers", number),
    column("transitions", "transitions", number),
    column("submissions", "submissions", number),
    column("command lists", "lists", number),
    column("copies", "copies", number),
    column("copied, kB", "copied_bytes", kilobytes),
    column("bound by dispatches, MB", "bound", megabytes),
    column("read by nodes, MB", "bytes_read", megabytes),
    column("written by nodes, MB", "bytes_written", megabytes),
    column("operations, millions", "multiply_adds", operations),
];

/// Counts of layers and of types of nodes.
const NODES: [Column; 4] = [
    column("nodes", "nodes", number),
    column("operations, millions", "multiply_adds", operations),
    column("read, MB", "bytes_read", megabytes),
    column("written, MB", "bytes_written", megabytes),
];
const OPERATORS: Column = column("operators", "operators", number);

fn number(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A value over a unit, with three significant digits where it is small.
fn over(value: u64, unit: u64) -> String {
    match value {
        0 => "0".to_owned(),
        _ if value >= 100 * unit => number((value + unit / 2) / unit),
        _ if value >= unit => format!("{:.1}", value as f64 / unit as f64),
        _ => format!("{:.3}", value as f64 / unit as f64),
    }
}

fn kilobytes(value: u64) -> String {
    over(value, 1_000)
}

fn megabytes(value: u64) -> String {
    over(value, 1_000_000)
}

/// Two operations for each multiply-add.
fn operations(multiply_adds: u64) -> String {
    over(2 * multiply_adds, 1_000_000)
}

impl Row {
    /// A count; `bound` is the sum of the bytes of both kinds of views.
    fn value(&self, count: &str) -> Option<u64> {
        match count {
            "bound" => Some(self.value("read_views")? + self.value("write_views")?),
            _ => self.values.get(count).copied(),
        }
    }
}

/// Names of rows with equal counts, such as `blocks 1, 2, 4, each`.
fn joined(names: &[&str]) -> String {
    let numbered: Vec<_> = names.iter().filter_map(|name| name.split_once('.')).collect();
    let Some((kind, _)) = numbered.first() else { return names.join(", ") };
    let numbers: Vec<_> = numbered.iter().map(|(_, number)| *number).collect();
    let each = if names.len() > 1 { ", each" } else { "" };
    format!("{kind} {}{each}", numbers.join(", "))
}

impl Counts {
    /// A table with a row for each group of rows of equal counts.
    fn rows_of(&self, world: &str, table: Table, head: &str, columns: &[Column]) -> String {
        let mut groups: Vec<(Vec<&str>, &Row)> = Vec::new();
        for row in self.table(world, table) {
            // Layers repeat; types of nodes have their own rows.
            let is_same =
                |other: &Row| row.name.contains('.') && other.name.contains('.') && other.values == row.values;
            match groups.iter_mut().find(|(_, first)| is_same(first)) {
                Some((names, _)) => names.push(&row.name),
                None => groups.push((vec![&row.name], row)),
            }
        }
        let mut text = format!("| {head} |");
        columns.iter().for_each(|column| _ = write!(text, " {} |", column.title));
        text += "\n|---|";
        columns.iter().for_each(|_| text += "--:|");
        text.push('\n');
        for (names, row) in groups {
            _ = write!(text, "| {} |", joined(&names));
            for column in columns {
                _ = write!(text, " {} |", row.value(column.count).map_or_else(String::new, column.show));
            }
            text.push('\n');
        }
        text
    }

    /// The table of a step's parts: a column for each part, and one for their sum if the step's passes are known.
    fn parts(&self, world: &str, passes: Option<u64>) -> String {
        let parts: Vec<&Row> = self.table(world, Table::Parts).collect();
        let mut text = "| |".to_owned();
        parts.iter().for_each(|part| _ = write!(text, " {} |", part.name));
        text += if passes.is_some() { " step |\n|---|--:|" } else { "\n|---|" };
        parts.iter().for_each(|_| text += "--:|");
        text.push('\n');
        for Column { title, count, show } in &PARTS {
            let values: Vec<_> = parts.iter().map(|part| part.value(count)).collect();
            if values.iter().all(Option::is_none) {
                continue;
            }
            _ = write!(text, "| {title} |");
            values.iter().for_each(|value| _ = write!(text, " {} |", value.map_or_else(String::new, show)));
            if let Some(passes) = passes {
                let times = |part: &Row| if part.name == "pass" { passes } else { 1 };
                let sum = parts.iter().zip(&values).map(|(part, value)| times(part) * value.unwrap_or(0)).sum();
                _ = write!(text, " {} |", show(sum));
            }
            text.push('\n');
        }
        text
    }

    /// The page.
    pub(super) fn page(&self) -> String {
        let with_operators = |by: &[Column; 4]| -> Vec<Column> {
            let [nodes, rest @ ..] = by;
            let copy = |c: &Column| column(c.title, c.count, c.show);
            [copy(nodes), OPERATORS].into_iter().chain(rest.iter().map(copy)).collect()
        };
        let layers = with_operators(&NODES);
        let of = |world, table, head, columns: &[Column]| self.rows_of(world, table, head, columns);
        format!(
            "# What a latent step really runs\n\n\
             What embeds a step's controls, one denoise or cache pass, one decode, and the rest of a latent step of [the world inside the library](world.md), at float16 and its \
             stock window, by {runtime} in [the lab](lab.md). The counts come from `{RECORD}`; both files are written by\n\n\
             ```sh\n{COMMAND}\n```\n\n\
             Without `--publish` the command prints this page. `cargo xtask test recorder` counts again, and fails where a count of the record has \
             risen by {TOLERANCE} % or more, or has fallen by as much and is not recorded.\n\n\
             ## A latent step\n\n\
             A step of {passes} passes, with passes that are not captured:\n\n{parts}\n\
             - **Dispatches, barriers, submissions, lists and copies** are counted below DirectML and ONNX Runtime, in the function tables of \
             Direct3D 12, when a list is executed ([the recorder](lab.md#a-recorder-of-direct3d-12-calls)). A GPU's driver may have metacommands, \
             which DirectML runs in place of some of its dispatches; the lab's has none.\n\
             - **DirectML operators** are the operator nodes of the graphs that ONNX Runtime gives to `IDMLDevice1::CompileGraph`. DirectML compiles \
             each of these graphs as one operator. Its dispatches have no names, so they are counted for a whole pass and not for its layers. \
             In the tables an operator belongs to the node whose value it computes; one that ONNX Runtime fuses from a `Conv` and its `Relu` belongs to \
             the `Relu`.\n\
             - **Bound by dispatches** is the sum of the ranges of buffers that dispatches have descriptors of: a range that several dispatches read or \
             write counts for each, and DirectML does not say which it reads and which it writes.\n\
             - **Nodes, bytes and operations** are those of the ONNX graphs: each node reads its inputs, weights included, and writes its outputs; a \
             `Reshape` moves nothing. Nodes that depend on weights only are computed when the world is loaded, and \
             nodes that depend on noise levels only once for each level: neither are counted. A multiply-add of `MatMul` or `Conv` \
             is two operations; others are not counted. `Bundle::cost` and `cairn.build costs` count them independently, and must agree.\n\n\
             ### A pass by layer\n\n{pass_by_layer}\n\
             ### A decode by layer\n\n{decode_by_layer}\n\
             ### A pass by type of node\n\n{pass_by_type}\n\
             ### A decode by type of node\n\n{decode_by_type}\n\
             ### A pass by type of DirectML operator\n\n{pass_by_operator}\n\
             ### A decode by type of DirectML operator\n\n{decode_by_operator}\n\
             ## Waypoint-1.5 at 360p\n\n\
             The graphs of the preset `{PRESET}`, 24 layers, at float16 and its stock window. The repository has no weights for it, so only the graphs \
             are counted.\n\n{preset_parts}\n\
             ### Its pass by layer\n\n{preset_pass_by_layer}\n\
             ### Its pass by type of node\n\n{preset_pass_by_type}\n\
             ### Its decode by type of node\n\n{preset_decode_by_type}",
            runtime = self.runtime,
            passes = self.passes,
            parts = self.parts(MINIATURE, Some(self.passes)),
            pass_by_layer = of(MINIATURE, Table::PassByLayer, "layer", &layers),
            decode_by_layer = of(MINIATURE, Table::DecodeByLayer, "layer", &layers),
            pass_by_type = of(MINIATURE, Table::PassByNodeType, "type", &NODES),
            decode_by_type = of(MINIATURE, Table::DecodeByNodeType, "type", &NODES),
            pass_by_operator = of(MINIATURE, Table::PassByOperatorType, "type", &[OPERATORS]),
            decode_by_operator = of(MINIATURE, Table::DecodeByOperatorType, "type", &[OPERATORS]),
            preset_parts = self.parts(PRESET, None),
            preset_pass_by_layer = of(PRESET, Table::PassByLayer, "layer", &NODES),
            preset_pass_by_type = of(PRESET, Table::PassByNodeType, "type", &NODES),
            preset_decode_by_type = of(PRESET, Table::DecodeByNodeType, "type", &NODES),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_groups_of_digits_and_units() {
        assert_eq!([0, 999, 1_000, 1_234_567].map(number), ["0", "999", "1,000", "1,234,567"]);
        assert_eq!([0, 512, 19_676, 139_264].map(kilobytes), ["0", "0.512", "19.7", "139"]);
        assert_eq!(operations(275_319_808), "551");
    }

    #[test]
    fn layers_of_equal_counts_share_a_row() {
        assert_eq!(joined(&["blocks.1", "blocks.2"]), "blocks 1, 2, each");
        assert_eq!(joined(&["blocks.3"]), "blocks 3");
        assert_eq!(joined(&["outside"]), "outside");
    }
}
