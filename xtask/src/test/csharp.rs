//! `bindings/csharp`: its declarations match `include/cairn.h`, it compiles without warnings and documents every public item, and its tests
//! run against the library on Mono and on .NET.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::{Console, DotNet, Mono};

use super::Context;
use super::abi;
use super::blocks;
use super::tally::{Skip, Tally};
use super::unity;
use crate::abi::declarations::{self, Declarations};
use crate::abi::{csharp, header, record};
use crate::shell::Log;
use crate::workspace::{self, Workspace};

const PROJECT: &str = "bindings/csharp/Cairn.csproj";
const STAND_IN: &str = "tests/host/stand_in.c";

/// Folder of library and assemblies: its name has a space and a letter that is not Latin.
const FOLDER: &str = "a folder Ж";

/// Libraries that differ from Cairn in one respect each, and the compiler flags for that.
const STAND_INS: [(&str, &[&str]); 5] = [
    ("other", &[]),
    ("later", &["-DSTAND_IN_ABI=CAIRN_ABI_VERSION+1"]),
    ("earlier", &["-DSTAND_IN_ABI=CAIRN_ABI_VERSION-1"]),
    ("older", &["-DSTAND_IN_ABI=CAIRN_ABI_VERSION", "-DSTAND_IN_VERSION=CAIRN_VERSION-1"]),
    ("incomplete", &["-DSTAND_IN_ABI=CAIRN_ABI_VERSION", "-DSTAND_IN_VERSION=CAIRN_VERSION"]),
];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let workspace = context.workspace;
    let mut tally = Tally::default();
    let declared = declarations::read(&workspace.read(header::HEADER)?)?;
    let differs = csharp::generate(&declared)? != workspace.read(csharp::NATIVE)?;
    tally.check(
        differs.then(|| format!("{} is not what the header says; cargo xtask fix --abi writes it", csharp::NATIVE)),
    );
    tally.check(not_used(&declared, &classes(workspace)?));
    let version = format!("<Version>{}</Version>", env!("CARGO_PKG_VERSION"));
    let stale = !workspace.read(PROJECT)?.contains(&version);
    tally.check(stale.then(|| format!("{PROJECT} does not have {version}")));

    let skip = |name: &str, reason: String| Skip { name: name.to_owned(), reason };
    if !cfg!(target_os = "linux") {
        tally.skips.push(skip("C#", "needs linux: elsewhere no Mono is fetched".to_owned()));
        return Ok(tally);
    }
    let mono = match provision::mono(&Console::new()) {
        Ok(mono) => mono,
        Err(e) => {
            tally.skips.push(skip("C#", format!("needs mono: {e}")));
            return Ok(tally);
        }
    };
    let library = abi::library(context, log)?;
    let tests = BindingTests { context, mono, work: workspace.target.join("xtask").join("test").join("csharp") };
    tests.make_stand_ins(log)?;
    let on_mono = tests.mono_runtime()?;
    tests.check(log, &library, &on_mono, &mut tally)?;
    let binding = on_mono.folder.join("Cairn.dll");
    if binding.is_file() {
        unity::check(workspace, &tests.mono, log, &binding, &mut tally)?;
    }
    match provision::dotnet(&Console::new()) {
        Ok(dotnet) => tests.check(log, &library, &tests.dotnet_runtime(&dotnet)?, &mut tally)?,
        Err(e) => tally.skips.push(skip("C# on .NET", format!("needs dotnet: {e}"))),
    }
    Ok(tally)
}

/// The source text of the hand-written classes.
fn classes(workspace: &Workspace) -> Result<String, String> {
    let files = workspace.files()?;
    let own = files.iter().filter(|file| file.starts_with("bindings/csharp/src/") && *file != csharp::NATIVE);
    own.map(|file| workspace.read(file)).collect()
}

/// Functions of `cairn.h` that no class calls.
fn not_used(declared: &Declarations, classes: &str) -> Option<String> {
    // Result codes are an enumeration.
    let functions =
        declared.functions.iter().filter(|function| !function.experimental && function.name != "cairn_result_name");
    let called = |name: &str| {
        let short = name.trim_start_matches("cairn_");
        classes.contains(&format!(".{short}(")) || classes.contains(&format!("\"{name}\""))
    };
    let missing: Vec<_> = functions.map(|function| function.name.as_str()).filter(|name| !called(name)).collect();
    (!missing.is_empty()).then(|| format!("no class of C# calls {}", missing.join(", ")))
}

/// The assemblies of .NET that the binding and its tests use.
pub(super) const FRAMEWORK: [&str; 14] = [
    "Microsoft.Win32.Primitives",
    "System.Collections",
    "System.Console",
    "System.IO.FileSystem",
    "System.Linq",
    "System.Memory",
    "System.Private.CoreLib",
    "System.Runtime",
    "System.Runtime.Extensions",
    "System.Runtime.InteropServices",
    "System.Runtime.InteropServices.RuntimeInformation",
    "System.Text.Encoding.Extensions",
    "System.Threading",
    "System.Threading.Thread",
];

/// A runtime for C# programs.
struct Runtime {
    name: &'static str,
    /// Folder of the library and the assemblies.
    folder: PathBuf,
    /// Compiler arguments for the runtime's own assemblies.
    references: Vec<String>,
    /// Takes the program to run as its argument.
    program: Command,
}

/// Compiles the libraries that differ from Cairn into an existing folder.
pub(super) fn make_stand_ins(
    log: &mut Log,
    root: &Path,
    compiler: &dyn Fn() -> Command,
    ending: &str,
    into: &Path,
) -> Result<(), String> {
    for (name, defines) in STAND_INS {
        let mut command = compiler();
        command.args(["-std=c11", "-shared", "-fPIC", "-include", "cairn.h"]).args(defines);
        command.arg("-I").arg(root.join("include")).arg(root.join(STAND_IN));
        command.arg("-o").arg(into.join(format!("{name}.{ending}")));
        if !log.run(&mut command)?.success {
            return Err(format!("{STAND_IN} does not compile as {name}"));
        }
    }
    Ok(())
}

struct BindingTests<'a> {
    context: &'a Context<'a>,
    mono: Mono,
    work: PathBuf,
}

impl BindingTests<'_> {
    fn mono_runtime(&self) -> Result<Runtime, String> {
        let mut program = self.mono.program();
        program.arg("--debug");
        let folder = self.folder("mono")?;
        Ok(Runtime { name: "C# on Mono", folder, references: vec!["-r:System.Core.dll".to_owned()], program })
    }

    fn dotnet_runtime(&self, dotnet: &DotNet) -> Result<Runtime, String> {
        let folder = self.folder("dotnet")?;
        let settings = folder.join("Cairn.Tests.runtimeconfig.json");
        fs::write(&settings, DotNet::SETTINGS).map_err(|e| format!("{}: {e}", settings.display()))?;
        let own = dotnet.framework();
        // Its assemblies reference each other by differing versions, for which the compiler warns.
        let mut references: Vec<String> = ["-nostdlib", "-noconfig", "-nowarn:1702"].map(str::to_owned).into();
        references.extend(FRAMEWORK.iter().map(|name| format!("-r:{}", own.join(format!("{name}.dll")).display())));
        Ok(Runtime { name: "C# on .NET", folder, references, program: dotnet.program() })
    }

    fn folder(&self, name: &str) -> Result<PathBuf, String> {
        let folder = self.work.join(FOLDER).join(name);
        fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        Ok(folder)
    }

    /// The libraries that differ from Cairn, in a new folder.
    fn make_stand_ins(&self, log: &mut Log) -> Result<(), String> {
        workspace::make_empty(&self.work)?;
        make_stand_ins(log, &self.context.workspace.root, &|| Command::new("cc"), "so", &self.work)
    }

    /// Compiles everything for a runtime, beside the library, and runs the tests.
    fn check(&self, log: &mut Log, library: &Path, runtime: &Runtime, tally: &mut Tally) -> Result<(), String> {
        let own = runtime.folder.join(library.file_name().unwrap_or_default());
        // A hard link takes no space; not every file system has them.
        if fs::hard_link(library, &own).is_err() {
            fs::copy(library, &own).map_err(|e| format!("{}: {e}", own.display()))?;
        }
        // Beside the library, as in a game.
        let onnxruntime = Context::provide(&self.context.library, provision::onnxruntime)?;
        let copy = runtime.folder.join(onnxruntime.file_name().unwrap_or_default());
        if fs::hard_link(onnxruntime, &copy).is_err() {
            fs::copy(onnxruntime, &copy).map_err(|e| format!("{}: {e}", copy.display()))?;
        }
        let tests = runtime.folder.join("Cairn.Tests.dll");
        if let Some(failure) = self.compile(log, runtime, &tests)? {
            tally.failures.push(format!("{}: {failure}", runtime.name));
            return Ok(());
        }
        let mut command = Command::new(runtime.program.get_program());
        command.args(runtime.program.get_args()).arg(&tests).current_dir(&runtime.folder);
        command.envs(runtime.program.get_envs().filter_map(|(name, value)| Some((name, value?))));
        command.env("CAIRN_TEST_RECORD", self.context.workspace.root.join(record::RECORD));
        command.env("CAIRN_TEST_STAND_INS", &self.work).env_remove("CAIRN_LIBRARY");
        self.context.provide_worlds(&mut command)?;
        // Only tools may use the path in this variable.
        command.env("CAIRN_ONNXRUNTIME", self.work.join("there is none"));
        abi::count(runtime.name, &log.run(&mut command)?, tally);
        Ok(())
    }

    /// Compiles the assembly, its documentation and its tests; returns the error, if any.
    fn compile(&self, log: &mut Log, runtime: &Runtime, tests: &Path) -> Result<Option<String>, String> {
        // Mono's compiler supports no later version; a .NET project compiles the sources as 7.3.
        const STRICT: [&str; 4] = ["-langversion:7.2", "-unsafe", "-warnaserror+", "-warn:4"];
        let workspace = self.context.workspace;
        let files = workspace.files()?;
        let below = |folder: &str| -> Vec<PathBuf> {
            let files = files.iter().filter(|file| file.starts_with(folder) && file.ends_with(".cs"));
            files.map(|file| workspace.root.join(file)).collect()
        };
        let option = |name: &str, file: &Path| format!("-{name}:{}", file.display());
        let assembly = runtime.folder.join("Cairn.dll");
        let mut command = self.mono.compiler();
        command.arg("-target:library").args(STRICT).args(&runtime.references).args(below("bindings/csharp/src/"));
        // With `-doc` an undocumented public item is a warning, and so an error.
        command.arg(option("doc", &runtime.folder.join("Cairn.xml"))).arg(option("out", &assembly));
        if !log.run(&mut command)?.success {
            return Ok(Some("bindings/csharp/src does not compile".to_owned()));
        }
        let page = self.work.join("Page.cs");
        let pages = blocks::pages(workspace)?.into_iter().filter(|page| !blocks::is_of_engine(page));
        let shown = pages.map(|page| workspace.read(&page)).collect::<Result<Vec<_>, _>>()?;
        fs::write(&page, examples(&shown)?).map_err(|e| format!("{}: {e}", page.display()))?;
        let mut command = self.mono.compiler();
        command.arg("-target:exe").args(STRICT).args(&runtime.references).arg(option("r", &assembly));
        command.args(below("bindings/csharp/tests/")).arg(&page).arg(option("out", tests));
        let compiled = log.run(&mut command)?.success;
        Ok((!compiled).then(|| "bindings/csharp/tests, or an example of a page, does not compile".to_owned()))
    }
}

/// The C# examples of pages as one source file, one after the other. Excerpts of other files are left out.
fn examples(pages: &[String]) -> Result<String, String> {
    let shown = pages.iter().flat_map(|page| blocks::parse(page));
    let own = shown.filter(|block| block.language == "csharp" && block.from.is_none());
    let body: String = own.map(|block| format!("{{\n{}}}\n", block.text)).collect();
    if body.is_empty() {
        return Err("no page has an example in C#".to_owned());
    }
    Ok(format!(
        "using System;\n\nnamespace Cairn.Tests\n{{\ninternal static class Page\n{{\ninternal static void Run()\n{{\n{body}}}\n}}\n}}\n"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_function_that_no_class_calls_is_named() {
        let declared =
            declarations::read("CAIRN_API cairn_result cairn_a(void);\nCAIRN_API cairn_result cairn_b(void);\n")
                .unwrap();
        assert_eq!(not_used(&declared, "Done(C.a(Value)); C.b(1);"), None);
        assert_eq!(not_used(&declared, "Done(C.a(Value));").as_deref(), Some("no class of C# calls cairn_b"));
    }

    #[test]
    fn every_example_of_the_pages_is_compiled_once() {
        let pages = [
            "text\n```csharp\nA();\n```\n```sh\nls\n```\n",
            "```csharp\nB();\n```\n<!-- from a.md -->\n```csharp\nA();\n```\n",
        ];
        let text = examples(&pages.map(str::to_owned)).unwrap();
        assert!(text.contains("{\nA();\n}\n{\nB();\n}\n}") && !text.contains("ls"), "{text}");
        assert!(examples(&["no example".to_owned()]).is_err());
    }
}
