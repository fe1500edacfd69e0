//! The report of a run: its JSON file, whose schema docs/check.md describes.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::outcome::Outcome;
use crate::privacy::Scrubber;
use crate::verdict::Verdict;

/// Version of the schema; a program refuses reports of another.
pub(crate) const SCHEMA: u32 = 1;

/// A run of the program.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Report {
    /// [`SCHEMA`]
    pub(crate) schema: u32,
    /// Version of Cairn.
    pub(crate) cairn: String,
    /// When the run began, in UTC to the second, e.g. `2026-01-31T12:00:00Z`.
    pub(crate) started: String,
    /// Duration of the run.
    pub(crate) seconds: f64,
    /// Whether it was a run with `--short`, whose figures are not to be compared.
    pub(crate) short: bool,
    /// The worst of the lines.
    pub(crate) verdict: Verdict,
    pub(crate) lines: Vec<Line>,
}

/// A check with its result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Line {
    /// Identifies the check in all versions of the program.
    pub(crate) id: String,
    pub(crate) group: String,
    pub(crate) title: String,
    /// Duration of the check, with the start of its process.
    pub(crate) seconds: f64,
    #[serde(flatten)]
    pub(crate) outcome: Outcome,
}

impl Report {
    /// Removes personal data from all texts.
    pub(crate) fn scrub(&mut self, scrubber: &Scrubber) {
        for outcome in self.lines.iter_mut().map(|line| &mut line.outcome) {
            outcome.found = scrubber.scrub(&outcome.found);
            outcome.remedy = outcome.remedy.take().map(|text| scrubber.scrub(&text));
            for fact in &mut outcome.facts {
                fact.text = scrubber.scrub(&fact.text);
            }
        }
    }

    /// How many lines have this verdict.
    pub(crate) fn count(&self, verdict: Verdict) -> usize {
        self.lines.iter().filter(|line| line.outcome.verdict == verdict).count()
    }

    /// One sentence with the verdict and the number of lines of each.
    pub(crate) fn summary(&self) -> String {
        let counts = [Verdict::Pass, Verdict::Fail, Verdict::CannotTell].map(|v| format!("{} {v}", self.count(v)));
        format!("{}: {} lines, {}; {:.0} s", self.verdict, self.lines.len(), counts.join(", "), self.seconds)
    }

    pub(crate) fn json(&self) -> String {
        // Strings, numbers and lists only, which serialisation cannot refuse; a number that is not finite becomes null.
        serde_json::to_string_pretty(self).expect("a report is plain data") + "\n"
    }

    /// Reads a report from a file.
    ///
    /// # Errors
    /// Text with cause and remedy.
    pub(crate) fn read(path: &Path) -> Result<Self, String> {
        let shown = path.display();
        let text =
            std::fs::read_to_string(path).map_err(|e| format!("{shown}: {e}. Give the path of a report.json"))?;
        #[derive(Deserialize)]
        struct Version {
            schema: u32,
        }
        let wrong = |e: serde_json::Error| format!("{shown} is no report of this program: {e}. Give a report.json");
        let Version { schema } = serde_json::from_str(&text).map_err(wrong)?;
        if schema != SCHEMA {
            return Err(format!(
                "{shown} has schema {schema}, and this program reads {SCHEMA}. Make both reports with one version"
            ));
        }
        serde_json::from_str(&text).map_err(wrong)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::outcome::Better;

    /// A report with one line per outcome, named `line-0` and so on.
    pub(crate) fn report(outcomes: impl IntoIterator<Item = Outcome>) -> Report {
        let lines: Vec<Line> = (0..)
            .zip(outcomes)
            .map(|(i, outcome)| Line {
                id: format!("line-{i}"),
                group: "there".into(),
                title: format!("Line {i}"),
                seconds: 0.5,
                outcome,
            })
            .collect();
        Report {
            schema: SCHEMA,
            cairn: "0.1.0".into(),
            started: "2026-01-31T12:00:00Z".into(),
            seconds: 3.0,
            short: false,
            verdict: Verdict::worst(lines.iter().map(|line| line.outcome.verdict)),
            lines,
        }
    }

    #[test]
    fn a_report_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("report.json");
        let outcome = Outcome::pass("fast").fact("adapter", "one").figure("4K, 2x", 1.25, "ms", Better::Lower);
        let written = report([outcome, Outcome::fail("wrong", "repair it")]);
        std::fs::write(&path, written.json()).expect("a file");
        assert_eq!(Report::read(&path), Ok(written.clone()));
        assert_eq!(written.summary(), "FAIL: 2 lines, 1 PASS, 1 FAIL, 0 CANNOT TELL; 3 s");

        let other = written.json().replace("\"schema\": 1", "\"schema\": 2");
        std::fs::write(&path, other).expect("a file");
        assert!(Report::read(&path).is_err_and(|e| e.contains("schema 2")));
        std::fs::write(&path, "{}").expect("a file");
        assert!(Report::read(&path).is_err_and(|e| e.contains("no report")));
        assert!(Report::read(&folder.path().join("none")).is_err_and(|e| e.contains("report.json")));
    }
}
