//! `bindings/unity`: every C# file of the package, and every script on its pages, compiles against declarations of Unity's interface for
//! each input system that a project can have; its components work with test doubles of Unity and of the plugin; its manifests are correct; and
//! the scripts declare the plugin's functions by their right names.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::Mono;
use serde_json::Value;

use super::abi;
use super::blocks;
use super::tally::Tally;
use crate::dist::unity::{PACKAGE, is_package};
use crate::shell::Log;
use crate::workspace::Workspace;

/// Unity's defines: without input, with an earlier and a later Input System in an earlier and a later Unity, with the Input Manager. Later checks
/// use the assemblies compiled with the last.
const INPUTS: [&[&str]; 5] = [
    &[],
    &["-define:ENABLE_INPUT_SYSTEM", "-define:CAIRN_INPUT_SYSTEM"],
    &["-define:ENABLE_INPUT_SYSTEM", "-define:CAIRN_INPUT_SYSTEM", "-define:UNITY_2023_2_OR_NEWER"],
    &[
        "-define:ENABLE_INPUT_SYSTEM",
        "-define:CAIRN_INPUT_SYSTEM",
        "-define:CAIRN_INPUT_SYSTEM_1_9",
        "-define:CAIRN_SCROLL_SETTING",
    ],
    &["-define:ENABLE_LEGACY_INPUT_MANAGER"],
];

/// Assemblies of the package by their folders, without the binding, in the order they are compiled in.
const ASSEMBLIES: [(&str, &str); 3] =
    [("Runtime/", "Cairn.Unity"), ("Editor/", "Cairn.Unity.Editor"), ("Samples~/Walk/", "Cairn.Unity.Samples.Walk")];

/// Assemblies that come from elsewhere, or that a project may lack.
const FOREIGN: [&str; 1] = ["Unity.InputSystem"];

/// The components' assembly, and the sources of its tests.
const COMPONENTS: &str = "Cairn.Unity";
const TESTS: [&str; 2] = ["bindings/csharp/tests/Harness.cs", "bindings/unity/tests/ComponentTests.cs"];

/// The program of these tests.
const RUN: &str = "Cairn.Unity.Tests";

/// The test double of the plugin.
const PLUGIN: &str = "bindings/unity/tests/plugin.c";

const ENTRY_POINTS: &str = "bindings/unity/plugin/src/entry_points.rs";
const SCRIPT: &str = "bindings/unity/Runtime/Plugin.cs";

/// Checks the package; `binding` is the assembly of `bindings/csharp/src`, beside the library that the components run with.
pub(super) fn check(
    workspace: &Workspace,
    mono: &Mono,
    log: &mut Log,
    binding: &Path,
    tally: &mut Tally,
) -> Result<(), String> {
    let files: Vec<String> = workspace.files()?.into_iter().filter(|file| is_package(file)).collect();
    tally.check(manifests(workspace, &files)?);
    tally.check(names(&workspace.read(ENTRY_POINTS)?, &workspace.read(SCRIPT)?));

    let work = binding.with_file_name("unity");
    fs::create_dir_all(&work).map_err(|e| format!("{}: {e}", work.display()))?;
    let compile =
        |log: &mut Log, name: &str, sources: &[PathBuf], references: &[PathBuf], defines: &[&str], words: bool| {
            let out = work.join(format!("{name}.dll"));
            let mut command = mono.compiler();
            command.arg(if name == RUN { "-target:exe" } else { "-target:library" });
            command.args(["-langversion:7.2", "-unsafe", "-warnaserror+", "-warn:4", "-r:System.Core.dll"]);
            command.args(defines).args(sources).arg(format!("-out:{}", out.display()));
            command.args(references.iter().map(|reference| format!("-r:{}", reference.display())));
            if words {
                // With `-doc` an undocumented public item is a warning, and so an error.
                command.arg(format!("-doc:{}", work.join(format!("{name}.xml")).display()));
            }
            let compiled = log.run(&mut command)?.success;
            Ok::<_, String>((
                out,
                (!compiled).then(|| format!("{name} of {PACKAGE} does not compile, with {defines:?}")),
            ))
        };
    make_plugin(workspace, log, binding, &work)?;
    let declared = |file: &str| [workspace.root.join(PACKAGE).join("tests").join(file)];
    let (engine, failure) = compile(log, "UnityEngine", &declared("UnityEngine.cs"), &[], &[], false)?;
    tally.check(failure);
    let (editor, failure) =
        compile(log, "UnityEditor", &declared("UnityEditor.cs"), std::slice::from_ref(&engine), &[], false)?;
    tally.check(failure);
    let mut references = vec![engine, editor, binding.to_owned()];
    let mut compiled = 0;
    for (folder, name) in ASSEMBLIES {
        let is_own = |file: &&String| {
            file.strip_prefix(PACKAGE)
                .and_then(|file| file.strip_prefix(folder))
                .is_some_and(|file| file.ends_with(".cs"))
        };
        let sources: Vec<PathBuf> = files.iter().filter(is_own).map(|file| workspace.root.join(file)).collect();
        compiled += sources.len();
        let inputs = if name == COMPONENTS { &INPUTS[..] } else { &INPUTS[INPUTS.len() - 1..] };
        let mut made = None;
        for defines in inputs {
            let (out, failure) = compile(log, name, &sources, &references, defines, true)?;
            let is_compiled = failure.is_none();
            tally.check(failure);
            if name == COMPONENTS && is_compiled && !defines.is_empty() {
                let references = [references.as_slice(), std::slice::from_ref(&out)].concat();
                let (tests, failure) =
                    compile(log, RUN, &TESTS.map(|file| workspace.root.join(file)), &references, defines, false)?;
                match failure {
                    Some(failure) => tally.failures.push(failure),
                    None => run_components(mono, log, &tests, defines, tally)?,
                }
            }
            made = Some(out);
        }
        references.extend(made);
    }
    let all = files.iter().filter(|file| file.ends_with(".cs")).count();
    tally.check((compiled != all).then(|| format!("{compiled} of {all} C# files of {PACKAGE} are in an assembly")));

    let mut shown = Vec::new();
    for page in blocks::pages(workspace)?.into_iter().filter(|page| page.starts_with(PACKAGE)) {
        for (line, text) in scripts(&page, &workspace.read(&page)?) {
            let path = work.join(format!("{}-{line}.cs", page.replace(['/', '.', '~'], "-")));
            fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
            shown.push(path);
        }
    }
    tally.check(shown.is_empty().then(|| format!("no page of {PACKAGE} shows a script")));
    let (_, failure) = compile(log, "Pages", &shown, &references, &[], false)?;
    tally.check(failure);
    Ok(())
}

/// Compiles the test double of the plugin into a folder. It is linked with the library beside the binding.
fn make_plugin(workspace: &Workspace, log: &mut Log, binding: &Path, work: &Path) -> Result<(), String> {
    // The program finds assemblies in its own folder only.
    let copy = work.join(binding.file_name().unwrap_or_default());
    fs::copy(binding, &copy).map_err(|e| format!("{}: {e}", copy.display()))?;
    let library = binding.with_file_name("");
    let mut command = Command::new("cc");
    command.args(["-std=c11", "-shared", "-fPIC"]).args(abi::STRICT).arg("-I").arg(workspace.root.join("include"));
    command.arg(workspace.root.join(PLUGIN)).arg("-L").arg(&library).args(["-lcairn", "-ldl", "-Wl,-rpath,$ORIGIN/.."]);
    let made = log.run(command.arg("-o").arg(work.join("libcairn_unity.so")))?.success;
    if made { Ok(()) } else { Err(format!("{PLUGIN} does not compile")) }
}

/// Runs the components' tests as compiled with `defines`: all of them with the Input Manager, those of input with each input system.
fn run_components(mono: &Mono, log: &mut Log, tests: &Path, defines: &[&str], tally: &mut Tally) -> Result<(), String> {
    let mut command = mono.program();
    command.arg("--debug").arg(tests).current_dir(tests.with_file_name("")).env_remove("CAIRN_LIBRARY");
    if defines != INPUTS[INPUTS.len() - 1] {
        command.arg("input");
    }
    abi::count(&format!("{COMPONENTS} with {}", defines.join(" ")), &log.run(&mut command)?, tally);
    Ok(())
}

/// The scripts on a page, each as a file that keeps the page's line numbers, and the lines where they begin.
fn scripts(page: &str, text: &str) -> Vec<(usize, String)> {
    let shown = blocks::parse(text).into_iter().filter(|block| block.language == "csharp" && block.from.is_none());
    shown.map(|block| (block.line, format!("#line {} \"{page}\"\n{}", block.line, block.text))).collect()
}

/// The error in the package's manifest or in those of its assemblies.
fn manifests(workspace: &Workspace, files: &[String]) -> Result<Option<String>, String> {
    let read = |file: &str| -> Result<Value, String> {
        serde_json::from_str(&workspace.read(file)?).map_err(|e| format!("{file}: {e}"))
    };
    let package = read(&format!("{PACKAGE}package.json"))?;
    let mut wrong = Vec::new();
    if package["version"] != env!("CARGO_PKG_VERSION") {
        wrong.push(format!("package.json has the version {}", package["version"]));
    }
    for sample in package["samples"].as_array().into_iter().flatten() {
        let path = sample["path"].as_str().unwrap_or_default();
        if !workspace.root.join(PACKAGE).join(path).is_dir() {
            wrong.push(format!("package.json names {path}"));
        }
    }
    let assemblies: Vec<(String, Value)> = files
        .iter()
        .filter(|file| file.ends_with(".asmdef"))
        .map(|file| Ok((file.clone(), read(file)?)))
        .collect::<Result<_, String>>()?;
    let name = |assembly: &Value| assembly["name"].as_str().unwrap_or_default().to_owned();
    let known: BTreeSet<String> = assemblies.iter().map(|(_, assembly)| name(assembly)).collect();
    for (file, assembly) in &assemblies {
        if !file.ends_with(&format!("/{}.asmdef", name(assembly))) {
            wrong.push(format!("{file} is called {}", name(assembly)));
        }
        for reference in assembly["references"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            if !known.contains(reference) && !FOREIGN.contains(&reference) {
                wrong.push(format!("{file} references {reference}"));
            }
        }
    }
    let expected: BTreeSet<String> =
        ASSEMBLIES.iter().map(|(_, name)| *name).chain(["Cairn"]).map(str::to_owned).collect();
    if known != expected {
        wrong.push(format!("the package has the assemblies {known:?}"));
    }
    Ok((!wrong.is_empty()).then(|| wrong.join("; ")))
}

/// How the plugin's functions and version differ from the scripts' declarations.
fn names(entry_points: &str, script: &str) -> Option<String> {
    let exported: BTreeSet<&str> =
        entry_points.split("extern \"C\" fn ").skip(1).filter_map(|rest| rest.split('(').next()).collect();
    let declared: BTreeSet<&str> = script
        .lines()
        .filter_map(|line| line.split_once("static extern ")?.1.split('(').next()?.split(' ').next_back())
        .collect();
    let number = |text: &str, before: &str| text.split_once(before)?.1.split(';').next().map(str::to_owned);
    let versions = [number(entry_points, "CAIRN_UNITY_VERSION: u32 = "), number(script, "const uint Version = ")];
    if exported.is_empty() || exported != declared {
        let apart: Vec<_> = exported.symmetric_difference(&declared).copied().collect();
        return Some(format!("{ENTRY_POINTS} and {SCRIPT} differ: {}", apart.join(", ")));
    }
    (versions[0].is_none() || versions[0] != versions[1])
        .then(|| format!("{ENTRY_POINTS} and {SCRIPT} have versions {versions:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scripts_keep_the_line_numbers_of_their_page() {
        let text = "text\n```csharp\nclass A\n{\n}\n```\n```sh\nls\n```\n<!-- from B.cs -->\n```csharp\nclass B\n```\n";
        assert_eq!(scripts("a.md", text), [(3, "#line 3 \"a.md\"\nclass A\n{\n}\n".to_owned())]);
    }

    #[test]
    fn a_function_that_one_side_lacks_is_named() {
        let entry_points =
            "pub const CAIRN_UNITY_VERSION: u32 = 1;\npub extern \"C\" fn a() {}\npub unsafe extern \"C\" fn b(\n";
        let script =
            "const uint Version = 1;\ninternal static extern int a();\n internal static extern IntPtr b(int c);\n";
        assert_eq!(names(entry_points, script), None);
        assert!(names(entry_points, &script.replace("b(", "c(")).is_some_and(|why| why.contains("b, c")));
        assert!(
            names(entry_points, &script.replace("Version = 1", "Version = 2"))
                .is_some_and(|why| why.contains("versions"))
        );
        assert!(names("", "").is_some());
    }
}
