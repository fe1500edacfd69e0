//! What a latent step really runs: counted at the interfaces of DirectML and Direct3D 12 by the test program `recorder`, and from the graphs by
//! `cairn.build costs`. The counts are kept in `xtask/counts.toml`, from which `docs/counts.md` is made.

mod measure;
mod page;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

use serde::Deserialize;

use crate::workspace::Workspace;

pub(crate) use measure::{FILE_VARIABLE, bench, from_run};

/// The counts.
pub(crate) const RECORD: &str = "xtask/counts.toml";
/// The page.
pub(crate) const PAGE: &str = "docs/counts.md";
/// The command that writes both.
const COMMAND: &str = "cargo xtask bench --lab --count --publish";

/// A count fails where it differs from the recorded one by this share or more, in percent.
const TOLERANCE: u64 = 2;

/// The world inside the library.
const MINIATURE: &str = "miniature";
/// A preset of `cairn.build` with 24 layers, of which only the graphs are counted.
const PRESET: &str = "360p";

/// All counts.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Counts {
    /// ONNX Runtime and its provider.
    runtime: String,
    /// Passes of the step.
    passes: u64,
    rows: Vec<Row>,
}

/// A row of a table of counts.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
struct Row {
    world: String,
    table: Table,
    /// What the counts are of, such as a pass, a layer of it, or a type of nodes.
    name: String,
    #[serde(flatten)]
    values: BTreeMap<String, u64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Table {
    /// Parts of a latent step.
    Parts,
    PassByLayer,
    DecodeByLayer,
    PassByNodeType,
    DecodeByNodeType,
    PassByOperatorType,
    DecodeByOperatorType,
}

impl Table {
    fn name(self) -> &'static str {
        match self {
            Self::Parts => "parts",
            Self::PassByLayer => "pass-by-layer",
            Self::DecodeByLayer => "decode-by-layer",
            Self::PassByNodeType => "pass-by-node-type",
            Self::DecodeByNodeType => "decode-by-node-type",
            Self::PassByOperatorType => "pass-by-operator-type",
            Self::DecodeByOperatorType => "decode-by-operator-type",
        }
    }
}

impl Counts {
    pub(crate) fn read(workspace: &Workspace) -> Result<Self, String> {
        Self::parse(&workspace.read(RECORD)?)
    }

    fn parse(text: &str) -> Result<Self, String> {
        toml::from_str(text).map_err(|e| format!("{RECORD}: {e}"))
    }

    /// As the record.
    fn text(&self) -> String {
        let mut text = format!(
            "# What a latent step really runs; `{COMMAND}` writes it.\n\nruntime = \"{}\"\npasses = {}\nrows = [\n",
            self.runtime, self.passes
        );
        for Row { world, table, name, values } in &self.rows {
            _ = write!(text, "  {{ world = \"{world}\", table = \"{}\", name = \"{name}\"", table.name());
            values.iter().for_each(|(count, value)| _ = write!(text, ", {count} = {value}"));
            text += " },\n";
        }
        text + "]\n"
    }

    fn table(&self, world: &str, table: Table) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.world == world && row.table == table)
    }

    fn row(&self, key: &Row) -> Option<&Row> {
        self.rows.iter().find(|row| (&row.world, row.table, &row.name) == (&key.world, key.table, &key.name))
    }

    /// One line for each count that differs from the recorded one by [`TOLERANCE`] or more.
    pub(crate) fn differences(recorded: &Self, counted: &Self) -> Vec<String> {
        let mut lines = Vec::new();
        let none = BTreeMap::new();
        let new = counted.rows.iter().filter(|row| recorded.row(row).is_none());
        for key in recorded.rows.iter().chain(new) {
            let values = |counts: &'_ Self| counts.row(key).map_or_else(|| none.clone(), |row| row.values.clone());
            let (before, after) = (values(recorded), values(counted));
            let names = before.keys().chain(after.keys().filter(|name| !before.contains_key(*name)));
            for name in names {
                let [before, after] = [&before, &after].map(|values| values.get(name).copied().unwrap_or(0));
                if before.abs_diff(after) * 100 < before * TOLERANCE || before == after {
                    continue;
                }
                let of = format!("{}, {}, {}: {name}", key.world, key.table.name(), key.name);
                lines.push(if after > before {
                    format!("{of} rose from {before} to {after}: lower it, or accept it by `{COMMAND}`")
                } else {
                    format!("{of} fell from {before} to {after}: record it by `{COMMAND}`, so that it stays")
                });
            }
        }
        lines
    }

    /// Writes the record and the page.
    fn publish(&self, workspace: &Workspace) -> Result<(), String> {
        for (name, text) in [(RECORD, self.text()), (PAGE, self.page())] {
            fs::write(workspace.root.join(name), text).map_err(|e| format!("{name}: {e}"))?;
        }
        Ok(())
    }
}

/// The failure if the page is not what the record says.
pub(crate) fn page_differs(workspace: &Workspace) -> Result<Option<String>, String> {
    let differs = workspace.read(PAGE)? != Counts::read(workspace)?.page();
    Ok(differs.then(|| format!("{PAGE} is not what {RECORD} says; `{COMMAND}` writes both")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded() -> Counts {
        Counts::parse(include_str!("../../counts.toml")).unwrap()
    }

    #[test]
    fn the_record_is_what_the_command_writes() {
        assert_eq!(recorded().text(), include_str!("../../counts.toml"));
        assert!(Counts::parse(&recorded().text().replace("pass-by-layer", "pass-by-name")).is_err());
    }

    #[test]
    fn any_count_that_rises_by_two_percent_is_named() {
        let recorded = recorded();
        assert_eq!(Counts::differences(&recorded, &recorded), [""; 0]);
        let mut altered = 0;
        for (i, row) in recorded.rows.iter().enumerate() {
            for (name, &value) in &row.values {
                let with = |value: u64| {
                    let mut counted = recorded.clone();
                    *counted.rows[i].values.get_mut(name).unwrap() = value;
                    Counts::differences(&recorded, &counted)
                };
                // The smallest whole number that is 2 % more.
                let risen = value + (value * 2).div_ceil(100).max(1);
                let lines = with(risen);
                let start =
                    format!("{}, {}, {}: {name} rose from {value} to {risen}: ", row.world, row.table.name(), row.name);
                assert!(lines.len() == 1 && lines[0].starts_with(&start), "{start}{lines:?}");
                assert!(lines[0].contains("lower it, or accept it by `cargo xtask bench"), "{lines:?}");
                if risen - 1 > value {
                    assert_eq!(with(risen - 1), [""; 0], "{start}less than 2 %");
                }
                altered += 1;
            }
        }
        assert!(altered > 100, "{altered} counts");
    }

    #[test]
    fn counts_that_fall_are_recorded_and_new_and_missing_rows_are_named() {
        let recorded = recorded();
        let mut counted = recorded.clone();
        let value = counted.rows[0].values.get_mut("dispatches").unwrap();
        *value /= 2;
        let lines = Counts::differences(&recorded, &counted);
        assert!(lines.len() == 1 && lines[0].contains("dispatches fell from"), "{lines:?}");

        let mut counted = recorded.clone();
        let name = "another layer".to_owned();
        counted.rows.push(Row { name, values: BTreeMap::from([("nodes".into(), 1)]), ..recorded.rows[0].clone() });
        let lines = Counts::differences(&recorded, &counted);
        assert!(lines.len() == 1 && lines[0].contains("another layer: nodes rose from 0 to 1"), "{lines:?}");
        let lines = Counts::differences(&counted, &recorded);
        assert!(lines.len() == 1 && lines[0].contains("another layer: nodes fell from 1 to 0"), "{lines:?}");
    }
}
