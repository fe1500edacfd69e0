//! Decides whether a report may be published: it is one that `cairn-check` wrote, and has no personal data.

use serde_json::Value;

use crate::privacy::without_folders;
use crate::report::Report;

/// Bytes of a file. A report of all checks has about twenty thousand.
const LONGEST_FILE: usize = 1 << 20;
/// Bytes of a string in a report.
const LONGEST_TEXT: usize = 4000;
/// Remedy for a file that was edited or that another program wrote.
const AS_WRITTEN: &str = "send report.json as cairn-check wrote it";

/// Reads the text of a report to publish.
///
/// # Errors
/// The first reason not to publish it, with a remedy.
pub fn validate(file: &str, text: &str) -> Result<Report, String> {
    if !is_name(file) {
        return Err(
            "its name must have lower-case letters, digits and hyphens only; name it after the adapter, such as \
                    radeon-rx-7600.json"
                .to_owned(),
        );
    }
    if text.len() > LONGEST_FILE {
        return Err(format!("it has {} bytes, and a report has at most {LONGEST_FILE}; {AS_WRITTEN}", text.len()));
    }
    let value: Value = serde_json::from_str(text).map_err(|e| format!("it is not JSON: {e}; {AS_WRITTEN}"))?;
    private(&value, "")?;
    let report =
        Report::from_json(text).map_err(|e| format!("{e}; make it again with this repository's cairn-check"))?;
    let known = serde_json::to_value(&report).map_err(|e| e.to_string())?;
    unexpected(&value, &known, "")?;
    if report.checks.iter().any(|check| !check.pictures.is_empty()) {
        return Err(format!("it has pictures, which belong into report.html; {AS_WRITTEN}"));
    }
    let machine = &report.machine;
    if machine.judged.and_then(|index| machine.adapters.get(index)).is_none() {
        return Err("no graphics adapter was judged; run cairn-check on Windows with Direct3D 12".to_owned());
    }
    if report.checks.is_empty() || report.verdict != Report::worst(&report.checks) {
        return Err(format!("its verdict is not that of its checks; {AS_WRITTEN}"));
    }
    if !report.optimised {
        return Err(
            "the program was compiled without optimisation, so that its times are too long; use the one of an \
                    archive, or cargo run --release"
                .to_owned(),
        );
    }
    Ok(report)
}

/// Whether a file name has only lower-case letters, digits and hyphens before `.json`.
fn is_name(file: &str) -> bool {
    let stem = file.strip_suffix(".json").unwrap_or_default();
    !stem.is_empty() && stem.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
}

/// The name of a field within another.
fn inside(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// Fails if a string, or the name of a field, may name a user, a machine or a folder, or is not a line of text.
fn private(value: &Value, path: &str) -> Result<(), String> {
    match value {
        Value::String(text) => match looks_private(text) {
            Some(what) => Err(format!(
                "{path} has {what}: {text:?}; a report has no names of users, machines or folders: remove it, and report \
                 it if cairn-check wrote it"
            )),
            None if text.len() > LONGEST_TEXT || text.chars().any(char::is_control) => {
                Err(format!("{path} is not a line of text; {AS_WRITTEN}"))
            }
            None => Ok(()),
        },
        Value::Array(items) => {
            (0..).zip(items).try_for_each(|(index, item)| private(item, &format!("{path}[{index}]")))
        }
        Value::Object(fields) => fields.iter().try_for_each(|(name, field)| {
            private(&Value::String(name.clone()), &format!("the name of a field in {path}"))?;
            private(field, &inside(path, name))
        }),
        Value::Null | Value::Bool(_) | Value::Number(_) => Ok(()),
    }
}

/// What in a text may identify a user or a machine.
fn looks_private(text: &str) -> Option<&'static str> {
    let lower = text.to_lowercase();
    let is_path = without_folders(text, &[]) != text;
    if is_path || ["users\\", "users/", "home/", "home\\"].iter().any(|folder| lower.contains(folder)) {
        return Some("a path");
    }
    let is_address = |word: &str| {
        let domain = word.split_once('@').filter(|(name, _)| !name.is_empty()).map(|(_, domain)| domain);
        domain.is_some_and(|domain| domain.trim_end_matches('.').contains('.'))
    };
    if text.split_whitespace().any(is_address) {
        return Some("an e-mail address");
    }
    // Names that Windows gives to machines.
    let is_machine = |word: &str| {
        let rest = ["desktop-", "laptop-", "win-"].iter().find_map(|prefix| word.strip_prefix(prefix));
        rest.is_some_and(|rest| rest.len() >= 6 && rest.bytes().all(|b| b.is_ascii_alphanumeric()))
    };
    lower.split(|c: char| !(c.is_alphanumeric() || c == '-')).any(is_machine).then_some("a machine's name")
}

/// Fails for a field of `value` that `known`, the same report as this program writes it, lacks.
fn unexpected(value: &Value, known: &Value, path: &str) -> Result<(), String> {
    match (value, known) {
        (Value::Object(fields), Value::Object(known)) => fields.iter().try_for_each(|(name, field)| {
            let path = inside(path, name);
            let known = known.get(name).ok_or_else(|| {
                format!(
                    "{path} is no field of a report; remove it, or use the repository of the cairn-check that wrote it"
                )
            })?;
            unexpected(field, known, &path)
        }),
        (Value::Array(items), Value::Array(known)) => items
            .iter()
            .zip(known)
            .enumerate()
            .try_for_each(|(index, (item, known))| unexpected(item, known, &format!("{path}[{index}]"))),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Verdict;
    use crate::report::PictureOfCheck;
    use crate::report::tests::{check, of_adapter, report};

    const FILE: &str = "radeon-rx-7600.json";

    fn sent() -> Report {
        of_adapter("AMD Radeon RX 7600", report(vec![check("frames", Verdict::Pass, &[("1080p", 2.0)])]))
    }

    #[test]
    fn a_report_as_written_is_accepted() {
        let sent = sent();
        assert_eq!(validate(FILE, &sent.to_json().unwrap()), Ok(sent));
    }

    #[test]
    fn files_that_are_no_reports_are_refused() {
        let text = sent().to_json().unwrap();
        let newer = text.replace("\"schema\": 1", "\"schema\": 2");
        let long = format!("{text}{}", " ".repeat(LONGEST_FILE));
        for (file, text, cause, remedy) in [
            ("Radeon RX.json", text.as_str(), "lower-case", "such as radeon-rx-7600.json"),
            (".json", &text, "lower-case", "such as radeon-rx-7600.json"),
            (FILE, "latents: 12", "it is not JSON", AS_WRITTEN),
            (FILE, "{\"a\": 1}", "no report of cairn-check", "make it again"),
            (FILE, &newer, "its schema is 2", "make it again"),
            (FILE, &long, "bytes", AS_WRITTEN),
        ] {
            let why = validate(file, text).unwrap_err();
            assert!(why.contains(cause) && why.contains(remedy), "{why}");
        }
    }

    #[test]
    fn edited_reports_are_refused() {
        type Edit = fn(&mut Report);
        let edits: [(&str, Edit); 5] = [
            ("verdict is not that of its checks", |report| report.verdict = Verdict::Fail),
            ("verdict is not that of its checks", |report| report.checks.clear()),
            ("without optimisation", |report| report.optimised = false),
            ("no graphics adapter was judged", |report| report.machine.judged = Some(7)),
            ("not a line of text", |report| report.checks[0].sentence = "one\ntwo".to_owned()),
        ];
        for (cause, edit) in edits {
            let mut edited = sent();
            edit(&mut edited);
            let why = validate(FILE, &edited.to_json().unwrap()).unwrap_err();
            assert!(why.contains(cause) && why.contains("; "), "{why}");
        }
        let mut value = serde_json::to_value(sent()).unwrap();
        let picture = PictureOfCheck { caption: "a pixel".to_owned(), png: String::new() };
        value["checks"][0]["pictures"] = serde_json::to_value([picture]).unwrap();
        assert!(validate(FILE, &value.to_string()).unwrap_err().contains("it has pictures"));
    }

    #[test]
    fn fields_of_others_and_personal_data_are_refused() {
        let with = |field: &str, text: &str| {
            let mut value = serde_json::to_value(sent()).unwrap();
            value["machine"][field] = text.into();
            validate(FILE, &value.to_string()).unwrap_err()
        };
        let why = with("owner", "somebody");
        assert!(why.contains("machine.owner is no field of a report; remove it"), "{why}");
        for (text, what) in [
            (r"C:\Users\somebody", "a path"),
            ("/home/somebody/cairn", "a path"),
            (r"Users\somebody", "a path"),
            ("somebody@example.org", "an e-mail address"),
            ("on DESKTOP-1A2B3C4", "a machine's name"),
        ] {
            for field in ["owner", "processor"] {
                let why = with(field, text);
                assert!(why.contains(&format!("machine.{field} has {what}")) && why.contains("remove it"), "{why}");
            }
        }
        let named = sent().to_json().unwrap().replace("\"processor\"", "\"/home/somebody\"");
        assert!(validate(FILE, &named).unwrap_err().contains("the name of a field in machine has a path"));
        for harmless in ["AMD Ryzen 7 7840U w/ Radeon 780M", "12 of 300 px/s", "@ 3.2 GHz", "docs/performance.md"] {
            assert_eq!(looks_private(harmless), None, "{harmless}");
        }
    }
}
