//! `include/cairn.hpp`: it covers all of `cairn.h`, every compiler accepts it with exceptions and without, and programs verify its
//! behaviour.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::Context;
use super::abi::{self, STRICT};
use super::tally::{Skip, Tally};
use crate::abi::declarations::Declarations;
use crate::shell::Log;
use provision::tools;

const HEADER: &str = "include/cairn.hpp";
const PROGRAM: &str = "tests/abi/wrapper.cpp";

/// The program whose functions of `cairn.h` are test doubles; it does not need the library.
const DOUBLE: &str = "tests/abi/wrapper_double.cpp";

/// The program that is compiled in both ways and linked as one.
const MIXED: &str = "tests/abi/wrapper_mixed.cpp";

/// With exceptions, which is the default, and without.
const WAYS: [(&str, &[&str]); 2] = [("with exceptions", &[]), ("without exceptions", &["-fno-exceptions"])];

pub(super) fn run(
    context: &Context<'_>,
    log: &mut Log,
    work: &Path,
    library: &Path,
    declared: &Declarations,
    tally: &mut Tally,
) -> Result<(), String> {
    let header = context.workspace.read(HEADER)?;
    tally.check(not_wrapped(declared, &header));
    let write = |name: &str, text: &str| {
        let path = work.join(name);
        fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display())).map(|()| path)
    };
    let twice = "#include \"cairn.hpp\"\n#include \"cairn.hpp\"\n\nint cairn_test_header();\n\
                 int cairn_test_header()\n{\n    return cairn::device() ? 1 : 0;\n}\n";
    let root = &context.workspace.root;
    let programs = [PROGRAM, MIXED].map(|program| root.join(program));
    let mut sources = vec![write("alone-hpp.cpp", twice)?, write("loop-hpp.cpp", &example(&header)?)?];
    sources.extend(programs);
    let strict = |command: &mut Command| {
        // Hosts may use stricter flags than we do for our own sources.
        command.arg("-std=c++17").args(STRICT).arg("-Wshadow").arg("-I").arg(root.join("include"));
    };
    for compiler in abi::available_compilers(&mut Tally::default()).iter().filter(|compiler| compiler.cpp) {
        for ((how, flags), source) in WAYS.iter().flat_map(|way| sources.iter().map(move |source| (way, source))) {
            let mut command = Command::new(&compiler.program);
            command.args(compiler.first);
            strict(&mut command);
            let ended = log.run(command.args(*flags).arg("-fsyntax-only").arg(source))?;
            let name = compiler.program.display();
            tally.check((!ended.success).then(|| format!("{name} does not take {} {how}", source.display())));
        }
    }
    let Some(compiler) = tools::on_path("g++") else {
        tally.skips.push(Skip { name: PROGRAM.into(), reason: "needs g++: install it".into() });
        return Ok(());
    };
    let folder = library.parent().unwrap_or(Path::new("."));
    let run_path = format!("-Wl,-rpath,{}", folder.display());
    let compile = |flags: &[&str], source: &str| {
        let mut command = Command::new(&compiler);
        strict(&mut command);
        command.args(flags).arg("-g").arg(root.join(source));
        command
    };
    for (how, flags) in WAYS {
        for (source, linked) in [(PROGRAM, true), (DOUBLE, false)] {
            let stem = Path::new(source).file_stem().unwrap_or_default().to_string_lossy();
            let program = work.join(format!("{stem}-{}", how.replace(' ', "-")));
            let mut command = compile(flags, source);
            if linked {
                command.arg(library).arg(&run_path);
            }
            let name = format!("{source} {how}");
            if !log.run(command.arg("-o").arg(&program))?.success {
                tally.failures.push(format!("{name} does not compile"));
                continue;
            }
            let mut command = Command::new(&program);
            context.provide_worlds(command.current_dir(work))?;
            abi::count(&name, &log.run(&mut command)?, tally);
        }
    }
    // The part without exceptions comes first: of two functions of the same name, the linker keeps the first.
    let [with, without] = ["with", "without"].map(|how| work.join(format!("wrapper_mixed-{how}.o")));
    let program = work.join("wrapper_mixed");
    let mut link = Command::new(&compiler);
    link.args([&without, &with]).arg(library).arg(&run_path).arg("-o").arg(&program);
    let built = log.run(compile(WAYS[0].1, MIXED).arg("-c").arg("-o").arg(&with))?.success
        && log.run(compile(WAYS[1].1, MIXED).arg("-c").arg("-o").arg(&without))?.success
        && log.run(&mut link)?.success;
    if built {
        abi::count(MIXED, &log.run(&mut Command::new(&program))?, tally);
    } else {
        tally.failures.push(format!("{MIXED} does not compile"));
    }
    Ok(())
}

/// Declarations of `cairn.h` that the wrapper does not use.
fn not_wrapped(declared: &Declarations, header: &str) -> Option<String> {
    // Names in comments do not count.
    let code: String =
        header.lines().filter(|line| !line.trim_start().starts_with(['*', '/'])).collect::<Vec<_>>().join("\n");
    let calls = declared.functions.iter().map(|function| format!("{}(", function.name));
    let sized = declared.structs.iter().filter(|found| found.fields.iter().any(|field| field == "struct_size"));
    // Only the library creates these.
    let sized = sized.filter(|found| found.name != "cairn_load_progress").map(|found| format!("sized<{}>", found.name));
    let missing: Vec<_> = calls.chain(sized).filter(|name| !code.contains(name)).collect();
    (!missing.is_empty()).then(|| format!("{HEADER} does not have {}", missing.join(", ")))
}

/// The example in the header's first comment, as a source file.
fn example(header: &str) -> Result<String, String> {
    let code: Vec<&str> =
        header.lines().take_while(|line| *line != " */").filter_map(|line| line.strip_prefix(" *     ")).collect();
    let first =
        code.first().filter(|line| line.starts_with("void ")).ok_or("the wrapper's first comment has no example")?;
    Ok(format!("#include \"cairn.hpp\"\n\n{first};\n{}\n", code.join("\n")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::abi::declarations;

    #[test]
    fn a_function_or_struct_that_is_not_wrapped_is_named() {
        let declared = declarations::read(include_str!("../../../include/cairn.h")).unwrap();
        let header = include_str!("../../../include/cairn.hpp");
        assert_eq!(not_wrapped(&declared, header), None);
        for name in ["cairn_rollout_step(", "cairn_presenter_record_d3d12(", "sized<cairn_frame>"] {
            let without = header.lines().filter(|line| !line.contains(name) || line.trim_start().starts_with('*'));
            let without: Vec<_> = without.collect();
            assert_eq!(not_wrapped(&declared, &without.join("\n")), Some(format!("{HEADER} does not have {name}")));
        }
    }
}
