//! Generates `include/cairn.h` with cbindgen from the files of `src/abi`, one after the other, so that it reads as a course.

use std::path::Path;

use cbindgen::{Builder, Config};

/// Path in the repository.
pub(crate) const HEADER: &str = "include/cairn.h";

/// Chapters, and the files of `src/abi` that each is made of.
const CHAPTERS: &[(&str, &[&str])] = &[
    ("Version", &["version"]),
    ("Results", &["results"]),
    ("Logging", &["logging"]),
    ("Threads", &["threads"]),
    ("Create: devices", &["device", "requirements"]),
    ("Create: worlds", &["world"]),
    ("Per frame: pictures and controls", &["images", "controls"]),
    ("Per frame: anchors", &["anchor"]),
    ("Per frame: rollouts", &["rollout"]),
    ("Per frame: the queue of a rollout", &["steps"]),
    ("Per frame: the state of a rollout", &["state"]),
    ("Per frame: guidance", &["guidance"]),
    ("Per frame: presenters", &["presenter"]),
    ("Per frame: budgets", &["budget"]),
    ("Per frame: input written down, and played again", &["script", "recorder"]),
    ("Queries: statistics", &["statistics"]),
    ("Experimental: Direct3D 12", &["d3d12"]),
    ("Experimental: AMD's swap chain", &["swapchain/structs", "swapchain"]),
];

const OPENING: &str = "\
#ifndef CAIRN_H
#define CAIRN_H

#include <stddef.h>
#include <stdint.h>

/* Define CAIRN_STATIC where the library is linked statically. */
#if defined(_WIN32) && !defined(CAIRN_STATIC)
#define CAIRN_API __declspec(dllimport)
#else
#define CAIRN_API
#endif

#ifdef __cplusplus
extern \"C\" {
#endif
";

const CLOSING: &str = "
#ifdef __cplusplus
} /* extern \"C\" */
#endif

#endif /* CAIRN_H */
";

/// Generates the header's text from the sources in `root`.
pub(crate) fn generate(root: &Path) -> Result<String, String> {
    let folder = root.join("src").join("abi");
    let read = |path: &Path| std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()));
    let config = Config::from_file(root.join("cbindgen.toml"))?;
    let mut header = String::from("/* Made from src/abi by `cargo xtask fix`; changes here are lost. */\n\n");
    header.push_str(&read(&folder.join("preamble.h"))?);
    header.push('\n');
    header.push_str(OPENING);
    for (number, (title, files)) in (1..).zip(CHAPTERS) {
        let title = format!("{number}. {title}");
        header.push_str(&format!("\n/* ---- {title} {} */\n", "-".repeat(108_usize.saturating_sub(title.len()))));
        for file in *files {
            let path = folder.join(format!("{file}.rs"));
            header.push('\n');
            header.push_str(section(&config, &path, &read(&path)?)?.trim());
            header.push('\n');
        }
    }
    header.push_str(CLOSING);
    Ok(header)
}

/// Constants, types and functions of one file.
fn section(config: &Config, path: &Path, source: &str) -> Result<String, String> {
    let mut config = config.clone();
    config.export.include = types(source);
    let failed = |e: cbindgen::Error| format!("cbindgen cannot read {}: {e}", path.display());
    let bindings = Builder::new().with_config(config).with_src(path).generate().map_err(failed)?;
    let mut text = Vec::new();
    bindings.write(&mut text);
    Ok(tidy(&String::from_utf8(text).map_err(|e| format!("{}: {e}", path.display()))?))
}

/// Maximum line length of comments and prototypes.
const WIDTH: usize = 120;

/// Formats cbindgen's text: short comments and prototypes on one line, tables of constants without gaps,
/// negative numbers in parentheses, handles by their short name.
fn tidy(text: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    let mut rest = text.lines().map(str::trim_end);
    while let Some(line) = rest.next() {
        match line.trim() {
            "/**" => {
                let comment: Vec<&str> = rest.by_ref().take_while(|line| line.trim() != "*/").collect();
                let indent = &line[..line.len() - 3];
                let short = comment.first().map(|only| format!("{indent}/**{} */", &only.trim()[1..]));
                match short.filter(|short| comment.len() == 1 && short.len() <= WIDTH) {
                    Some(short) => lines.push(short),
                    None => {
                        lines.push(line.to_owned());
                        lines.extend(comment.into_iter().map(str::to_owned));
                        lines.push(format!("{indent} */"));
                    }
                }
            }
            start if start.starts_with("CAIRN_API") => {
                let mut prototype = vec![start];
                while !prototype.last().is_some_and(|line| line.ends_with(';')) {
                    let Some(line) = rest.next() else { break };
                    prototype.push(line.trim());
                }
                lines.extend(wrapped(&prototype.join(" ").replace("struct cairn_", "cairn_")));
            }
            other => {
                let define = other.strip_prefix("#define ").and_then(|rest| rest.rsplit_once(' '));
                match define.filter(|(_, value)| value.starts_with('-')) {
                    Some((name, value)) => lines.push(format!("#define {name} ({value})")),
                    None => lines.push(line.to_owned()),
                }
            }
        }
    }
    let mut tidied = String::new();
    for (i, line) in lines.iter().enumerate() {
        let is = |at: usize, start: &str| lines.get(at).is_some_and(|line| line.starts_with(start));
        let in_table = i > 0 && is(i - 1, "#define") && is(i + 1, "/** ") && is(i + 2, "#define");
        let again = line.is_empty() && i > 0 && lines[i - 1].is_empty();
        if !(again || line.is_empty() && in_table) {
            tidied.push_str(line);
            tidied.push('\n');
        }
    }
    tidied
}

/// A prototype on one line if it fits, else with its parameters on an indented line.
fn wrapped(line: &str) -> Vec<String> {
    if line.len() <= WIDTH {
        return vec![line.to_owned()];
    }
    let (head, parameters) = line.split_once('(').unwrap_or((line, ""));
    let mut lines = vec![format!("{head}(")];
    for parameter in parameters.split_inclusive(", ") {
        let last = lines.len() - 1;
        if last > 0 && lines[last].len() + parameter.trim_end().len() <= WIDTH {
            lines[last].push_str(parameter);
        } else {
            lines.push(format!("    {parameter}"));
        }
    }
    lines.into_iter().map(|line| line.trim_end().to_owned()).collect()
}

/// The public types that a file of `src/abi` defines, including those that no function of it uses.
fn types(source: &str) -> Vec<String> {
    let name = |line: &str| {
        let rest = line.strip_prefix("pub struct ").or_else(|| line.strip_prefix("pub type "))?;
        rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().map(str::to_owned)
    };
    source.lines().filter_map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hand_of_the_header() {
        let text = "/**\n * One.\n */\n#define A 0\n\n/**\n * Two.\n */\n#define B -1\n\n\n/**\n * A.\n * B.\n */\nCAIRN_API\n\
                    cairn_result f(const struct cairn_a *a,\n               size_t b);\n";
        assert_eq!(
            tidy(text),
            "/** One. */\n#define A 0\n/** Two. */\n#define B (-1)\n\n/**\n * A.\n * B.\n */\n\
             CAIRN_API cairn_result f(const cairn_a *a, size_t b);\n"
        );
        let (a, b) = ("a".repeat(60), "b".repeat(60));
        let long = wrapped(&format!("CAIRN_API cairn_result f(int {a}, int {b});"));
        assert_eq!(long.len(), 3);
        assert_eq!(long[0], "CAIRN_API cairn_result f(");
    }

    #[test]
    fn public_types_are_found() {
        let source = "pub struct cairn_a(());\npub(super) struct B;\n    pub struct C;\npub type cairn_d =\n";
        assert_eq!(types(source), ["cairn_a", "cairn_d"]);
    }
}
