//! Commands and code on pages (README.md, those of docs, samples and bindings): commands exist and accept the options that the text gives
//! them, and code is checked by a tool that knows its language.

use std::process::Command;

use clap::Parser;
use provision::tools::WINDOWS_TARGET;

use super::Context;
use super::blocks;
use super::tally::Tally;
use crate::cli::Cli;
use crate::shell::Log;

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    for page in blocks::pages(context.workspace)? {
        for line in commands(&context.workspace.read(&page)?) {
            let failure = check(context, log, &line)?;
            log.line(&format!("{page}: {line}: {}", failure.as_deref().unwrap_or("ok")))?;
            tally.check(failure.map(|why| format!("{page}: \"{line}\": {why}")));
        }
    }
    blocks::check(context, log, &mut tally)?;
    Ok(tally)
}

/// The lines of a page's shell blocks, without prompts and comments, continued lines joined.
pub(super) fn commands(page: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut inside = false;
    for line in page.replace("\\\n", " ").lines() {
        if let Some(fence) = line.trim().strip_prefix("```") {
            inside = !inside && matches!(fence, "sh" | "bash" | "console");
        } else if inside {
            let line = line.split(" #").next().unwrap_or_default().trim().trim_start_matches("$ ");
            if !line.is_empty() && !line.starts_with('#') {
                found.push(line.to_owned());
            }
        }
    }
    found
}

/// The error in a command of ours; other programs' commands are only checked to be known.
fn check(context: &Context<'_>, log: &mut Log, line: &str) -> Result<Option<String>, String> {
    let words: Vec<&str> =
        line.split_whitespace().skip_while(|word| word.contains('=') && !word.starts_with('-')).collect();
    match words.as_slice() {
        ["cargo", "xtask", arguments @ ..] => {
            Ok(Cli::try_parse_from(std::iter::once("xtask").chain(arguments.iter().copied()))
                .err()
                .filter(clap::Error::use_stderr)
                .map(|e| e.to_string().lines().next().unwrap_or_default().to_owned()))
        }
        ["cargo", "run", rest @ ..] => run_of_a_package(context, log, rest),
        ["cargo", "test" | "bench", "-p" | "--package", package, ..] => {
            Ok((!context.workspace.packages.iter().any(|p| p == package))
                .then(|| format!("there is no package {package}")))
        }
        [python, "-m", module @ ("cairn" | "cairn.build" | "cairn.sweep"), arguments @ ..] if is_python(python) => {
            let mut help = Command::new(context.python()?);
            help.args(["-m", module]).env("PYTHONPATH", provision::python_path());
            knows(log, help, arguments)
        }
        ["cairn-check", arguments @ ..] => {
            run_of_a_package(context, log, &[&["-p", "cairn-check", "--"], arguments].concat())
        }
        [python, "-m", "venv" | "pip" | "pytest", ..] if is_python(python) => Ok(None),
        ["cargo", "build", "--release"] | ["cargo", "build", "--release", "--target", WINDOWS_TARGET] => Ok(None),
        // The runners `host` and `host-d3d12` build and run these, and `blocks` the programs of pages.
        ["cc" | "c++" | "cmake" | "./host-c" | "./first", ..] => Ok(None),
        ["git" | "cd" | "mpv" | "ffplay" | "rustup" | "apt" | "apt-get" | "sudo" | "export", ..] => Ok(None),
        [program, ..] => Ok(Some(format!("{program} is no program these documents may ask for"))),
        [] => Ok(Some("a line of variables alone".to_owned())),
    }
}

fn is_python(program: &str) -> bool {
    matches!(program.rsplit('/').next(), Some("python" | "python3"))
}

/// `cargo run ... -p PACKAGE ... -- ARGUMENTS`, or `--example NAME`.
fn run_of_a_package(context: &Context<'_>, log: &mut Log, words: &[&str]) -> Result<Option<String>, String> {
    let after = |names: &[&str]| words.windows(2).find(|pair| names.contains(&pair[0])).map(|pair| pair[1]);
    if let Some(example) = after(&["--example"]) {
        let there = context.workspace.root.join("examples").join(format!("{example}.rs")).is_file();
        return Ok((!there).then(|| format!("there is no example {example}")));
    }
    let Some(package) = after(&["-p", "--package"]) else { return Ok(Some("it names no package".to_owned())) };
    if !context.workspace.packages.iter().any(|known| known == package) {
        return Ok(Some(format!("there is no package {package}")));
    }
    context.build_programs(log)?;
    let arguments = words.iter().position(|word| *word == "--").map_or(&[][..], |at| &words[at + 1..]);
    let mut program = Command::new(context.workspace.program("debug", package));
    if package == "study" {
        // `--dry-run` also checks the options' values.
        let ended = log.run(program.arg("--dry-run").args(arguments))?;
        let first_line = || ended.output.lines().next().unwrap_or("it is refused").to_owned();
        return Ok((!ended.success).then(first_line));
    }
    knows(log, program, arguments)
}

/// Whether `program SUBCOMMAND --help` works and mentions every option of `arguments`.
fn knows(log: &mut Log, mut program: Command, arguments: &[&str]) -> Result<Option<String>, String> {
    let subcommand = arguments.first().filter(|word| !word.starts_with('-'));
    let ended = log.run(program.args(subcommand).arg("--help"))?;
    if !ended.success {
        return Ok(Some(format!("it has no {}", subcommand.unwrap_or(&"help"))));
    }
    let known = |option: &str| {
        ended.output.split(|c: char| c.is_whitespace() || ",[]=<>|".contains(c)).any(|word| word == option)
    };
    let options = arguments.iter().filter(|word| word.starts_with('-') && word.len() > 1);
    let unknown = options.map(|option| option.split('=').next().unwrap_or(option)).find(|option| !known(option));
    Ok(unknown.map(|option| format!("it does not know {option}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn takes_commands_from_shell_blocks_only() {
        let page = "text\n```sh\n# comment\ncargo xtask demo   # see it\n$ cargo run -p study \\\n  -- rollout\n```\n```rust\nlet a;\n```\n";
        let found = commands(page);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0], "cargo xtask demo");
        assert_eq!(found[1].split_whitespace().collect::<Vec<_>>(), ["cargo", "run", "-p", "study", "--", "rollout"]);
    }
}
