//! The C interface: the header and the record match the sources, every compiler accepts the header, the library exports what the header
//! declares, and C programs and one C++ program verify the documented behaviour.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::{Console, tools};

use super::Context;
use super::amd::Amd;
use super::cpp;
use super::lab;
use super::tally::{Skip, Tally};
use crate::abi::declarations::{self, Declarations};
use crate::abi::{header, record};
use crate::shell::{CommandOutput, Log, output};

/// Warning flags for every compiler.
pub(super) const STRICT: [&str; 4] = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"];

/// C programs that run against the library; each is a file of `tests/abi`.
const PROGRAMS: &str = "tests/abi";

/// Programs that have a longer form, enabled by `CAIRN_THOROUGH`.
const FAULTS: &str = "tests/abi/fail_nth.c";
const RANDOM_CALLS: &str = "tests/abi/fuzz_calls.c";

/// The table of all functions that the hostile test programs call.
const CALLS: &str = "tests/abi/calls.h";

/// Programs that also run on Windows, with an engine's device of Direct3D 12, and those of every run.
const ON_WINDOWS: [&str; 3] = ["hostile", "hostile_calls", "hostile_threads"];
const ON_WINDOWS_SHORT: [&str; 2] = ["hostile_calls", "hostile_threads"];

/// Earlier headers that hosts may have been compiled with, by their folder in `tests/abi/earlier`, and the programs that must still run
/// with them.
const EARLIER: [(&str, &[&str]); 1] = [("2", &["basics", "world", "input", "rollout"])];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let workspace = context.workspace;
    let work = workspace.target.join("xtask").join("abi");
    fs::create_dir_all(&work).map_err(|e| format!("{}: {e}", work.display()))?;
    let mut tally = Tally::default();

    let committed = workspace.read(header::HEADER)?;
    let differs = |name: &str| format!("{name} is not what the sources say; cargo xtask fix writes it");
    tally.check((header::generate(&workspace.root)? != committed).then(|| differs(header::HEADER)));
    let declared = declarations::read(&committed)?;
    let version = env!("CARGO_PKG_VERSION");
    for function in &declared.functions {
        tally.check(declarations::missing_part(function, &declared.constants, version));
    }
    tally.check(without_row(&declared, &workspace.read(CALLS)?));

    let recorded = workspace.read(record::RECORD)?;
    let layout = record::rust_layout(workspace)?;
    tally.check((record::compose(&layout, &declared) != recorded).then(|| differs(record::RECORD)));
    tally.check(unannounced_breaking_change(workspace, &recorded)?);
    check_with_compilers(context, log, &work, &committed, &declared, &recorded, &mut tally)?;

    let library = library(context, log)?;
    tally.check(exports(&library, &declared)?);
    programs(context, log, &work, &library, &mut tally, None)?;
    cpp::run(context, log, &work, &library, &declared, &mut tally)?;
    Ok(tally)
}

/// Runs the longer form of the program that fails every call once.
pub(super) fn run_faults(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_longer(context, log, FAULTS)
}

/// Runs the longer form of the program of random calls.
pub(super) fn run_calls(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_longer(context, log, RANDOM_CALLS)
}

fn run_longer(context: &Context<'_>, log: &mut Log, program: &str) -> Result<Tally, String> {
    let work = context.workspace.target.join("xtask").join("abi");
    fs::create_dir_all(&work).map_err(|e| format!("{}: {e}", work.display()))?;
    let mut tally = Tally::default();
    let library = library(context, log)?;
    programs(context, log, &work, &library, &mut tally, Some(program))?;
    Ok(tally)
}

/// Runs the programs of a hostile host on Windows, or in the lab: with a device of Direct3D 12, and worlds on the processor.
pub(super) fn run_on_windows(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_hostile(context, log, &ON_WINDOWS_SHORT, &[])
}

/// Runs all of them, and those that call every function with worlds on Direct3D 12 too.
pub(super) fn run_all_on_windows(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    if let Some(skip) = lab::skip_unless_possible("a hostile host on Direct3D 12")? {
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    }
    let mut tally = run_hostile(context, log, &ON_WINDOWS, &[])?;
    tally.add(run_hostile(context, log, &ON_WINDOWS_SHORT[..1], &[("CAIRN_TEST_DIRECTML", "1")])?);
    Ok(tally)
}

fn run_hostile(
    context: &Context<'_>,
    log: &mut Log,
    programs: &[&str],
    variables: &[(&str, &str)],
) -> Result<Tally, String> {
    context.build_for_windows(log)?;
    let root = &context.workspace.root;
    let work = context.workspace.target.join("xtask").join("abi-windows");
    let failed = |e: std::io::Error| format!("{}: {e}", work.display());
    fs::create_dir_all(&work).map_err(failed)?;
    lab::install_runtime(&work)?;
    let library = work.join("cairn.dll");
    fs::copy(context.windows_programs().join("cairn.dll"), &library).map_err(failed)?;
    let compiler = tools::mingw_compiler(false, &Console::new()).map_err(|e| e.to_string())?;
    let compile = |output: &Path, sources: &[PathBuf]| {
        let mut command = Command::new(&compiler.program);
        command.args(compiler.first).args(["-std=gnu11", "-g", "-static"]).args(STRICT);
        command.arg("-I").arg(root.join("include")).args(sources);
        command.args(["-ld3d12", "-ldxgi", "-lpthread", "-lm", "-o"]).arg(output);
        command
    };
    let sources = root.join(PROGRAMS);
    let shim = work.join("onnxruntime-shim.dll");
    if !log.run(compile(&shim, &[sources.join("shim").join("onnxruntime.c")]).arg("-shared"))?.success {
        return Err("the shim of ONNX Runtime does not compile for Windows".to_owned());
    }
    let mut tally = Tally::default();
    for name in programs {
        let program = work.join(format!("{name}.exe"));
        let given = sources.join("windows").join("given.c");
        let files = [sources.join(format!("{name}.c")), given, library.clone(), shim.clone()];
        let title = format!("{PROGRAMS}/{name}.c on Windows");
        if !log.run(&mut compile(&program, &files))?.success {
            tally.failures.push(format!("{title} does not compile"));
            continue;
        }
        let mut command = lab::lab_run()?;
        command.arg(&program).current_dir(&work).envs(variables.iter().copied());
        command.env("CAIRN_TEST_WORLD", lab::windows_path(&context.bundle("tiny")?));
        command.env("CAIRN_TEST_SHIM", lab::windows_path(&shim));
        command.env("CAIRN_ONNXRUNTIME", lab::windows_path(&work.join("onnxruntime.dll")));
        Amd::None.provide(&mut command);
        count(&title, &log.run(&mut command)?, &mut tally);
    }
    Ok(tally)
}

/// The first change of the record, in the available history or since the last commit, that breaks hosts without a new ABI version.
fn unannounced_breaking_change(workspace: &crate::workspace::Workspace, now: &str) -> Result<Option<String>, String> {
    let git = |arguments: &[&str]| output(Command::new("git").args(arguments).current_dir(&workspace.root));
    let history = git(&["log", "--first-parent", "--format=%h", "--", record::RECORD])?;
    let mut newer = ("the working tree".to_owned(), now.to_owned());
    for commit in history.lines() {
        // A commit that removed the file has no older version to compare.
        let Ok(older) = git(&["show", &format!("{commit}:{}", record::RECORD)]) else { break };
        if let Some(line) = record::breaking_change(&older, &newer.1) {
            return Ok(Some(format!("{} drops \"{line}\" and leaves CAIRN_ABI_VERSION as it was", newer.0)));
        }
        newer = (commit.to_owned(), older);
    }
    Ok(None)
}

/// A compiler to test with.
pub(super) struct Compiler {
    pub(super) program: PathBuf,
    /// Arguments that come before all others.
    pub(super) first: &'static [&'static str],
    pub(super) cpp: bool,
}

/// All compilers to test with; a missing one is skipped by name.
pub(super) fn available_compilers(tally: &mut Tally) -> Vec<Compiler> {
    let console = Console::new();
    let mut all = Vec::new();
    for (name, cpp) in [("gcc", false), ("g++", true)] {
        match tools::on_path(name) {
            Some(program) => all.push(Compiler { program, first: &[], cpp }),
            None => tally.skips.push(Skip { name: name.into(), reason: format!("needs {name}: install it") }),
        }
    }
    for (name, cpp) in [("clang", false), ("clang++", true)] {
        match tools::clang(name, &console) {
            Some(program) => all.push(Compiler { program, first: &[], cpp }),
            None => tally.skips.push(Skip { name: name.into(), reason: "needs clang: apt install clang".into() }),
        }
    }
    for (name, cpp) in [("x86_64-w64-mingw32-gcc", false), ("x86_64-w64-mingw32-g++", true)] {
        match tools::mingw_compiler(cpp, &console) {
            Ok(tools::MingwCompiler { program, first }) => all.push(Compiler { program, first, cpp }),
            Err(e) => tally.skips.push(Skip { name: name.into(), reason: format!("needs mingw: {e}") }),
        }
    }
    all
}

/// Compiles the header, its example and the record of its layout with each compiler.
fn check_with_compilers(
    context: &Context<'_>,
    log: &mut Log,
    work: &Path,
    header: &str,
    declared: &Declarations,
    recorded: &str,
    tally: &mut Tally,
) -> Result<(), String> {
    let write = |name: &str, text: &str| {
        let path = work.join(name);
        fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display())).map(|()| path)
    };
    // Included twice, as two headers of a host may do, and before any other header.
    let alone = "#include \"cairn.h\"\n#include \"cairn.h\"\n\nint cairn_test_header(void);\n\
                 int cairn_test_header(void)\n{\n    return CAIRN_ABI_VERSION + CAIRN_ERROR_INTERNAL;\n}\n";
    let c = [
        write("alone.c", alone)?,
        write("layout.c", &record::assertions(recorded))?,
        write("loop.c", &example(header)?)?,
    ];
    let cpp = [write("alone.cpp", alone)?, write("layout.cpp", &record::assertions(recorded))?];
    for compiler in available_compilers(tally) {
        for source in if compiler.cpp { &cpp[..] } else { &c[..] } {
            let mut command = Command::new(&compiler.program);
            command.args(compiler.first).arg(if compiler.cpp { "-std=c++17" } else { "-std=c11" }).args(STRICT);
            command.arg("-I").arg(context.workspace.root.join("include")).arg("-fsyntax-only").arg(source);
            let ended = log.run(&mut command)?;
            let name = compiler.program.display();
            tally.check((!ended.success).then(|| format!("{name} does not take {}", source.display())));
        }
    }
    let program = work.join("layout");
    let source = write("print_layout.c", &record::c_program(declared))?;
    let mut command = c_compiler();
    command.arg("-I").arg(context.workspace.root.join("include")).arg(source).arg("-o").arg(&program);
    if !log.run(&mut command)?.success {
        tally.failures.push("the program that prints the layout does not compile".to_owned());
        return Ok(());
    }
    tally.check(record::difference(recorded, &output(&mut Command::new(program))?));
    Ok(())
}

/// The example in the header's first comment, as a source file.
pub(super) fn example(header: &str) -> Result<String, String> {
    let code: Vec<&str> =
        header.lines().take_while(|line| *line != " */").filter_map(|line| line.strip_prefix(" *     ")).collect();
    if code.len() < 10 {
        return Err("the header's first comment has no example".to_owned());
    }
    let prototype = code.iter().find(|line| line.starts_with("cairn_result ")).ok_or("the example has no function")?;
    Ok(format!("#include \"cairn.h\"\n\n{prototype};\n\n{}\n", code.join("\n")))
}

fn c_compiler() -> Command {
    let mut command = Command::new("gcc");
    command.arg("-std=c11").args(STRICT).args(["-g", "-D_GNU_SOURCE"]);
    command
}

/// The shared library as cargo's tests build it.
pub(super) fn library(context: &Context<'_>, log: &mut Log) -> Result<PathBuf, String> {
    context.build_programs(log)?;
    let (prefix, suffix) = (std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    Ok(context.workspace.target.join("debug").join(format!("{prefix}cairn{suffix}")))
}

/// Functions that the library exports and the header does not declare, or the other way round.
fn exports(library: &Path, declared: &Declarations) -> Result<Option<String>, String> {
    let symbols = output(Command::new("nm").args(["-D", "--defined-only", "--format=posix"]).arg(library))?;
    let exported: BTreeSet<&str> = symbols.lines().filter_map(|line| line.split(' ').next()).collect();
    let declared: BTreeSet<&str> = declared.functions.iter().map(|function| function.name.as_str()).collect();
    let wrong: Vec<_> = exported.symmetric_difference(&declared).copied().collect();
    Ok((!wrong.is_empty()).then(|| format!("exported or declared, but not both: {}", wrong.join(", "))))
}

/// Functions that can return an error and have no row in the table of the hostile test programs.
fn without_row(declared: &Declarations, calls: &str) -> Option<String> {
    let refuses = declared.functions.iter().filter(|function| function.prototype.starts_with("cairn_result "));
    let missing: Vec<_> = refuses
        .map(|function| function.name.as_str())
        .filter(|name| !calls.lines().any(|line| line.trim_start().get(2..).is_some_and(|row| is_row(row, name))))
        .collect();
    (!missing.is_empty()).then(|| format!("{CALLS} has no row for {}", missing.join(", ")))
}

/// Whether the text after the macro's name, such as `(cairn_version, ...)`, is the row of `name`.
fn is_row(row: &str, name: &str) -> bool {
    row.strip_prefix('(').and_then(|row| row.strip_prefix(name)).is_some_and(|rest| rest.starts_with([',', ')']))
}

/// Compiles and runs every C program against the library, and some of them also with an earlier header; or the longer form of one. Each
/// prints one line per test, as Rust's test programs do.
fn programs(
    context: &Context<'_>,
    log: &mut Log,
    work: &Path,
    library: &Path,
    tally: &mut Tally,
    longer: Option<&str>,
) -> Result<(), String> {
    let root = &context.workspace.root;
    let is_program = |file: &&String| {
        let name = file.strip_prefix(PROGRAMS).and_then(|rest| rest.strip_prefix('/'));
        name.is_some_and(|name| name.ends_with(".c") && !name.contains('/'))
    };
    let files = context.workspace.files()?;
    let sources: Vec<&String> = files.iter().filter(is_program).collect();
    if sources.is_empty() {
        return Err(format!("{PROGRAMS} has no programs"));
    }
    let shim = shim(context, log, work)?;
    let include = root.join("include");
    let mut hosts: Vec<(String, &Path, String)> =
        sources.into_iter().map(|source| (source.clone(), include.as_path(), source.clone())).collect();
    let earlier: Vec<(PathBuf, &[&str])> = EARLIER
        .iter()
        .map(|(number, programs)| (root.join(PROGRAMS).join("earlier").join(number), *programs))
        .collect();
    for (header, programs) in &earlier {
        let name = |program: &str| format!("{program} with {}", header.strip_prefix(root).unwrap_or(header).display());
        hosts.extend(programs.iter().map(|program| {
            let source = format!("{PROGRAMS}/{program}.c");
            (name(&source), header.as_path(), source)
        }));
    }
    if let Some(longer) = longer {
        hosts.retain(|(name, ..)| name == longer);
    }
    for (number, (name, header, source)) in hosts.iter().enumerate() {
        let program = work.join(format!("program-{number}"));
        let has_shim = context.workspace.read(source)?.contains("shim/onnxruntime.h");
        let mut command = compile(&root.join(source), header, library, has_shim.then_some(&shim));
        if !log.run(command.arg("-o").arg(&program))?.success {
            tally.failures.push(format!("{name} does not compile"));
            continue;
        }
        let mut command = Command::new(&program);
        command.current_dir(work).env("CAIRN_TEST_WORLD", context.bundle("tiny")?).env("CAIRN_TEST_SHIM", &shim);
        if longer.is_some() {
            command.env("CAIRN_THOROUGH", "1");
        }
        context.provide_worlds(&mut command)?;
        let ended = log.run(&mut command)?;
        count(name, &ended, tally);
    }
    Ok(())
}

/// A command that compiles a program against the library, and against the shim of ONNX Runtime if it reads its internals.
fn compile(source: &Path, header: &Path, library: &Path, shim: Option<&PathBuf>) -> Command {
    let mut command = c_compiler();
    command.arg("-I").arg(header).arg(source).arg(library);
    if let Some(library) = shim {
        command.arg(library);
    }
    for library in std::iter::once(library).chain(shim.map(PathBuf::as_path)) {
        command.arg(format!("-Wl,-rpath,{}", library.parent().unwrap_or(Path::new(".")).display()));
    }
    command.args(["-lpthread", "-lm"]);
    command
}

/// Runs the program of faults in the lab, with a rollout on the WebGPU provider: of each kind of call about twenty fail.
pub(super) fn run_faults_on_webgpu(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let work = context.workspace.target.join("xtask").join("webgpu-faults");
    fs::create_dir_all(&work).map_err(|e| format!("{}: {e}", work.display()))?;
    let (library, shim) = (library(context, log)?, shim(context, log, &work)?);
    let (root, program) = (&context.workspace.root, work.join("faults"));
    let mut command = compile(&root.join(FAULTS), &root.join("include"), &library, Some(&shim));
    if !log.run(command.arg("-o").arg(&program))?.success {
        return Err(format!("{FAULTS} does not compile"));
    }
    let mut command = lab::lab_run()?;
    command.arg(&program).current_dir(&work);
    command.env("CAIRN_TEST_WORLD", context.bundle("tiny")?).env("CAIRN_TEST_SHIM", &shim);
    command.env("CAIRN_TEST_DEVICE", "webgpu");
    context.provide_webgpu_worlds(&mut command)?;
    let runtime = provision::onnxruntime_with_webgpu(&Console::new()).map_err(|e| e.to_string())?;
    command.env("CAIRN_WEBGPU", runtime.with_file_name("libonnxruntime_providers_webgpu.so"));
    let mut tally = Tally::default();
    count(FAULTS, &log.run(&mut command)?, &mut tally);
    Ok(tally)
}

/// Counts the test results that a program printed.
pub(super) fn count(name: &str, ended: &CommandOutput, tally: &mut Tally) {
    let (mut passed, mut failed) = (0, 0);
    for line in ended.output.lines() {
        if let Some(test) = line.strip_prefix("test ").and_then(|line| line.strip_suffix(" ... FAILED")) {
            tally.failures.push(format!("{name}: {test}"));
            failed += 1;
        } else if line.starts_with("test ") && line.ends_with(" ... ok") {
            passed += 1;
        }
    }
    tally.passed += passed;
    let broken = passed + failed == 0 || ended.success != (failed == 0);
    tally.failures.extend(broken.then(|| format!("{name} ended before its tests did")));
}

/// The ONNX Runtime shim whose internals test programs can read.
fn shim(context: &Context<'_>, log: &mut Log, work: &Path) -> Result<PathBuf, String> {
    let library = work.join("libonnxruntime-shim.so");
    let mut command = c_compiler();
    command.args(["-shared", "-fPIC"]).arg(context.workspace.root.join(PROGRAMS).join("shim").join("onnxruntime.c"));
    let made = log.run(command.args(["-ldl", "-o"]).arg(&library))?.success;
    if made { Ok(library) } else { Err("the shim of ONNX Runtime does not compile".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_function_without_a_row_is_named() {
        let declared = declarations::read(include_str!("../../../include/cairn.h")).unwrap();
        let calls = include_str!("../../../tests/abi/calls.h");
        assert_eq!(without_row(&declared, calls), None);
        for name in ["cairn_rollout_step", "cairn_anchor_destroy"] {
            let without: Vec<_> = calls.lines().filter(|line| !line.contains(&format!("({name},"))).collect();
            assert_eq!(without_row(&declared, &without.join("\n")), Some(format!("{CALLS} has no row for {name}")));
        }
    }
}
