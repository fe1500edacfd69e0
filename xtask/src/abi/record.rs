//! `abi.txt`: one line for each thing that hosts rely on. Additions add lines; a removed or changed line breaks hosts.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::process::Command;

use super::declarations::Declarations;
use crate::shell::{output, pass_through};
use crate::workspace::Workspace;

/// Path in the repository.
pub(crate) const RECORD: &str = "abi.txt";

const INTRODUCTION: &str = "\
# What hosts of the library rely on, written by `cargo xtask fix` and compared by `cargo xtask test abi` with what a C compiler
# makes of include/cairn.h. New lines are welcome. A line that goes or changes breaks hosts: CAIRN_ABI_VERSION must rise with it,
# but for what is experimental.
";

/// Constants and struct layouts as Rust has them.
pub(crate) fn rust_layout(workspace: &Workspace) -> Result<String, String> {
    // Chosen from the whole workspace: of the package alone, its dependencies would have other features, and be compiled again.
    pass_through(&mut workspace.cargo(["build", "--quiet", "--workspace", "--example", "interface"]))?;
    let name = format!("interface{}", std::env::consts::EXE_SUFFIX);
    output(&mut Command::new(workspace.target.join("debug").join("examples").join(name)))
}

/// The whole record: the layout, and the declarations that have no layout.
pub(crate) fn compose(layout: &str, declarations: &Declarations) -> String {
    let mut record = format!("{INTRODUCTION}{layout}");
    for line in &declarations.typedefs {
        _ = writeln!(record, "type {line}");
    }
    for function in &declarations.functions {
        let kind = if function.experimental { "experimental" } else { "function" };
        _ = writeln!(record, "{kind} {}", function.prototype);
    }
    record
}

/// A C program that prints the layout as a C compiler has it, in the Rust side's format.
pub(crate) fn c_program(declarations: &Declarations) -> String {
    let mut program = String::from(
        "#include <stdio.h>\n#include <stddef.h>\n#include \"cairn.h\"\n\nint main(void)\n{\n    cairn_result wide = 0;\n",
    );
    for (name, _) in &declarations.constants {
        _ = writeln!(program, "    printf(\"constant {name} %lld\\n\", (long long){name});");
    }
    _ = writeln!(program, "    printf(\"cairn_result %u\\n\", (unsigned)sizeof wide);");
    for structure in declarations.structs.iter().filter(|s| !s.fields.is_empty()) {
        let name = &structure.name;
        _ = writeln!(program, "    printf(\"struct {name} %u\\n\", (unsigned)_Alignof({name}));");
        _ = writeln!(program, "    printf(\"size {name} %u\\n\", (unsigned)sizeof({name}));");
        for field in &structure.fields {
            _ = writeln!(
                program,
                "    printf(\"field {name}.{field} %u %u\\n\", (unsigned)offsetof({name}, {field}), \
                 (unsigned)sizeof((({name} *)0)->{field}));"
            );
        }
    }
    program.push_str("    return 0;\n}\n");
    program
}

/// A C or C++ source that compiles only if sizes, offsets and values match the record. It is for compilers whose programs do not
/// run here.
pub(crate) fn assertions(record: &str) -> String {
    let mut source = String::from(
        "#include <stddef.h>\n#include \"cairn.h\"\n\n#ifdef __cplusplus\n#define HOLDS(what) static_assert(what, #what)\n\
         #else\n#define HOLDS(what) _Static_assert(what, #what)\n#endif\n\n",
    );
    let mut last_size = None;
    for line in record.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let now = match words[..] {
            // A struct may have several recorded sizes; the last is the current one.
            ["size", name, size] => {
                last_size = Some(format!("HOLDS(sizeof({name}) == {size});\n"));
                continue;
            }
            ["constant", name, value] => format!("HOLDS((long long){name} == {value});\n"),
            ["cairn_result", size] => format!("HOLDS(sizeof(cairn_result) == {size});\n"),
            ["field", path, offset, size] => match path.split_once('.') {
                Some((name, field)) => format!(
                    "HOLDS(offsetof({name}, {field}) == {offset});\nHOLDS(sizeof((({name} *)0)->{field}) == {size});\n"
                ),
                None => continue,
            },
            _ => continue,
        };
        source.extend(last_size.take());
        source.push_str(&now);
    }
    source.extend(last_size);
    source
}

/// The first difference between the C program's output and the record. Only the record has sizes of earlier releases.
pub(crate) fn difference(record: &str, printed: &str) -> Option<String> {
    let layout = ["constant ", "cairn_result ", "struct ", "size ", "field "];
    let is_layout = |line: &&str| layout.iter().any(|start| line.starts_with(start));
    let recorded: BTreeSet<&str> = record.lines().filter(is_layout).collect();
    let printed: BTreeSet<&str> = printed.lines().map(str::trim_end).collect();
    let earlier = |line: &str| line.starts_with("size ");
    let lost = recorded
        .difference(&printed)
        .find(|line| !earlier(line))
        .map(|line| format!("missing in the C layout: {line}"));
    let added = printed.difference(&recorded).next().map(|line| format!("missing in the record: {line}"));
    lost.or(added)
}

/// Functions that were always experimental by their comments, but that earlier records list without that.
const RECORDED_AS_STABLE: [&str; 2] = ["cairn_device_create_gpu", "cairn_device_create_auto"];

/// The first line that `new` lacks without a higher `CAIRN_ABI_VERSION`; `None` when the change only adds.
pub(crate) fn breaking_change(old: &str, new: &str) -> Option<String> {
    let number = |record: &str| {
        record.lines().find_map(|line| line.strip_prefix("constant CAIRN_ABI_VERSION ")?.parse::<u64>().ok())
    };
    let lines: BTreeSet<&str> = new.lines().collect();
    // The library's own version, experimental items and the introduction may change.
    let free = ["#", "constant CAIRN_VERSION ", "experimental "];
    let promised = |line: &&str| !free.iter().any(|start| line.starts_with(start));
    let corrected = |line: &&str| {
        line.strip_prefix("function ").is_some_and(|prototype| {
            RECORDED_AS_STABLE.iter().any(|name| prototype.contains(&format!(" {name}(")))
                && lines.contains(format!("experimental {prototype}").as_str())
        })
    };
    let lost = old.lines().filter(promised).find(|line| !lines.contains(line) && !corrected(line))?;
    (number(new) <= number(old)).then(|| lost.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::abi::declarations::read;

    #[test]
    fn only_additions_keep_the_abi_version() {
        let old = "constant CAIRN_ABI_VERSION 1\nconstant CAIRN_VERSION 1\nsize cairn_a 8\nfunction int f(void)\n";
        assert_eq!(breaking_change(old, &format!("# x\n{old}size cairn_a 16\n")), None);
        assert_eq!(breaking_change(old, &old.replace("CAIRN_VERSION 1", "CAIRN_VERSION 2")), None);
        let changed = old.replace("size cairn_a 8", "size cairn_a 16");
        assert_eq!(breaking_change(old, &changed).as_deref(), Some("size cairn_a 8"));
        assert_eq!(breaking_change(old, &changed.replace("ABI_VERSION 1", "ABI_VERSION 2")), None);
        assert!(breaking_change(old, &old.replace("int f", "void f")).is_some());
        assert_eq!(breaking_change(&format!("{old}experimental int g(void)\n"), old), None);
        assert!(breaking_change(old, &old.replace("function int f", "experimental int f")).is_some());
        let stable = old.replace("int f(", "int cairn_device_create_gpu(");
        assert_eq!(breaking_change(&stable, &stable.replace("function", "experimental")), None);
        assert!(breaking_change(&stable, &stable.replace("function int", "experimental void")).is_some());
    }

    #[test]
    fn both_sides_are_compared() {
        let record = "# x\nconstant A 1\nsize s 8\nsize s 16\nfunction f\n";
        assert_eq!(difference(record, "constant A 1\nsize s 16\n"), None);
        assert!(difference(record, "constant A 2\nsize s 16\n").is_some());
        assert!(difference(record, "size s 16\n").is_some());
        assert!(difference(record, "constant A 1\nsize s 24\n").is_some());
        let program =
            c_program(&read("#define CAIRN_OK 0\ntypedef struct cairn_a {\n    int b;\n} cairn_a;\n").unwrap());
        assert!(program.contains("constant CAIRN_OK") && program.contains("field cairn_a.b"), "{program}");
    }
}
