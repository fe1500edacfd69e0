//! `bindings/unreal`: Clang compiles the plugin, and the code on its pages, for each version of the engine, against declarations of its
//! public interface; its build rules are applied; and a small test engine in the lab runs it on a Direct3D 12 device, through the recorder of
//! Direct3D's calls.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::{Console, tools};

use super::Context;
use super::abi::STRICT;
use super::amd::Amd;
use super::blocks;
use super::csharp;
use super::lab;
use super::recorder;
use super::tally::{Skip, Tally};
use crate::abi::declarations;
use crate::abi::header;
use crate::dist;
use crate::shell::{Log, output};
use crate::workspace;

const DESCRIPTION: &str = "bindings/unreal/Cairn/Cairn.uplugin";
const RUNTIME: &str = "bindings/unreal/Cairn/Source/CairnRuntime";
const ENGINE: &str = "tests/unreal/engine";
const HOST: &str = "tests/unreal/host";
const HEADERS: &str = "tests/unreal/headers.txt";
const BUILD_TOOL: &str = "tests/unreal/BuildTool.cs";

/// The minor version of each Unreal Engine 5 that the plugin supports.
const VERSIONS: [u32; 8] = [1, 2, 3, 4, 5, 6, 7, 8];

/// The versions that the test engine is built as: one for each way to get command lists and write barriers, and the newest.
const ENGINE_VERSIONS: [u32; 4] = [4, 5, 6, 8];

/// Name of the test engine in the list of broken rules.
const RECORDED: &str = "unreal play";

/// Folder of the assembled plugin: its name has a space and a letter that is not Latin.
const FOLDER: &str = "a folder Ж";

/// Folder of the plugin's pages.
const PAGES: &str = "bindings/unreal/";

/// The library in the plugin.
pub(super) const LIBRARY: &str = "Binaries/ThirdParty/Cairn/Win64/cairn.dll";

/// Folder of the library in the plugin.
const LIBRARY_FOLDER: &str = "Binaries/ThirdParty/Cairn/Win64";

/// AMD's libraries, which a game may put beside the library.
const AMD_LIBRARIES: [&str; 4] = [
    "amd_fidelityfx_loader_dx12.dll",
    "amd_fidelityfx_framegeneration_dx12.dll",
    "amd_fidelityfx_upscaler_dx12.dll",
    "amd_fidelityfx_dx12.dll",
];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    let work = context.workspace.target.join("xtask").join("test").join("unreal");
    workspace::remove(&work)?;
    let tests = PluginTests { context, work };
    tests.check_descriptor(&mut tally)?;
    tests.check_headers(&mut tally)?;
    tests.compile(log, &mut tally)?;
    tests.check_build_rules(log, &mut tally)?;
    match lab::skip_unless_possible("the plugin for Unreal Engine in a small engine")? {
        Some(skip) => tally.skips.push(skip),
        None => tests.run_engine(log, &mut tally)?,
    }
    Ok(tally)
}

/// Builds the test engine as the newest version in a folder; returns the program.
pub(super) fn host(context: &Context<'_>, log: &mut Log, work: PathBuf) -> Result<PathBuf, String> {
    let tests = PluginTests { context, work };
    tests.check_headers(&mut Tally::default())?;
    let delay_imports = tests.delay_imports(log)?;
    let program = tests.engine(log, ENGINE_VERSIONS[ENGINE_VERSIONS.len() - 1], &delay_imports)?;
    program.ok_or_else(|| "the small engine does not compile".to_owned())
}

fn skip(name: &str, reason: String) -> Skip {
    Skip { name: name.to_owned(), reason }
}

/// A file in place of the library: a description, its path or `None` for no file, and the expected message.
type Replacement = (&'static str, Option<PathBuf>, &'static str);

struct PluginTests<'a> {
    context: &'a Context<'a>,
    work: PathBuf,
}

impl PluginTests<'_> {
    fn write(&self, name: &str, text: &str) -> Result<PathBuf, String> {
        let path = self.work.join(name);
        let folder = path.parent().unwrap_or(&self.work);
        fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display())).map(|()| path)
    }

    /// The repository's files below a folder with that extension.
    fn files(&self, folder: &str, ending: &str) -> Result<Vec<PathBuf>, String> {
        let files = self.context.workspace.files()?.into_iter();
        let own = files.filter(|file| file.starts_with(folder) && file.ends_with(ending));
        Ok(own.map(|file| self.context.workspace.root.join(file)).collect())
    }

    /// The plugin's descriptor is JSON, has the library's version, and names existing modules. None is called Cairn: the build tool would
    /// define that module's macro, which `cairn.h` defines too.
    fn check_descriptor(&self, tally: &mut Tally) -> Result<(), String> {
        let text = self.context.workspace.read(DESCRIPTION)?;
        let read: serde_json::Value = serde_json::from_str(&text).map_err(|e| format!("{DESCRIPTION}: {e}"))?;
        let version = read["VersionName"].as_str() == Some(env!("CARGO_PKG_VERSION"));
        tally.check((!version).then(|| format!("{DESCRIPTION} is not of version {}", env!("CARGO_PKG_VERSION"))));
        let modules: Vec<&str> =
            read["Modules"].as_array().into_iter().flatten().filter_map(|module| module["Name"].as_str()).collect();
        tally.check(modules.is_empty().then(|| format!("{DESCRIPTION} has no module")));
        for module in modules {
            let rules = format!("bindings/unreal/Cairn/Source/{module}/{module}.Build.cs");
            let there = self.context.workspace.root.join(&rules).is_file() && module != "Cairn";
            tally.check((!there).then(|| format!("{DESCRIPTION} names {module}, and {rules} must be there")));
        }
        Ok(())
    }

    /// Checks what the engine's header tool requires of headers with its macros, as far as their text shows it.
    fn check_headers(&self, tally: &mut Tally) -> Result<(), String> {
        for path in self.files(&format!("{RUNTIME}/Public/"), ".h")? {
            let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            tally.check(header_tool_error(&text, &name).map(|why| format!("{}: {why}", path.display())));
            self.write(&format!("generated/{name}.generated.h"), "")?;
        }
        let list = self.context.workspace.read(HEADERS)?;
        for (of, header) in list.lines().filter(|line| !line.starts_with('#')).filter_map(|line| line.split_once(' ')) {
            self.write(&format!("include/{}", header.trim()), &format!("#include \"{of}\"\n"))?;
        }
        Ok(())
    }

    /// The C++ blocks of the plugin's pages, as headers of a game.
    fn page_headers(&self, tally: &mut Tally) -> Result<Vec<PathBuf>, String> {
        let mut headers = Vec::new();
        for page in blocks::pages(self.context.workspace)?.iter().filter(|page| page.starts_with(PAGES)) {
            let text = self.context.workspace.read(page)?;
            for block in blocks::parse(&text).iter().filter(|block| block.language == "cpp") {
                // A header with the header tool's macros is named after its generated header.
                let generated = block.text.lines().find_map(|line| line.trim().strip_suffix(".generated.h\""));
                let name = generated.and_then(|line| line.strip_prefix("#include \"")).unwrap_or_default();
                if !name.is_empty() {
                    self.write(&format!("generated/{name}.generated.h"), "")?;
                }
                let why = header_tool_error(&block.text, name);
                tally.check(why.map(|why| format!("{page}:{}: {why}", block.line)));
                let header = format!("#line {} \"{page}\"\n{}", block.line, block.text);
                headers.push(self.write(&format!("shown/{}.h", headers.len()), &header)?);
            }
        }
        Ok(headers)
    }

    /// Arguments for every compiler of the plugin.
    fn add_flags(&self, command: &mut Command, version: u32, d3d12: bool) {
        let root = &self.context.workspace.root;
        command.arg("-std=c++17").args(STRICT).arg("-Wshadow").args(["-DUNICODE", "-D_UNICODE", "-DCAIRNRUNTIME_API="]);
        command.args(["-DENGINE_MAJOR_VERSION=5".to_owned(), format!("-DENGINE_MINOR_VERSION={version}")]);
        command.arg(format!("-DCAIRN_WITH_D3D12={}", u8::from(d3d12)));
        for folder in [self.work.join("include"), self.work.join("generated"), root.join(ENGINE), root.join(HOST)] {
            command.arg("-I").arg(folder);
        }
        for folder in ["Public", "Private"] {
            command.arg("-I").arg(root.join(RUNTIME).join(folder));
        }
        // The build tool includes ThirdParty's headers as system headers.
        command.arg("-isystem").arg(root.join("include"));
    }

    /// A source file that includes all the given ones.
    fn source_including(&self, name: &str, files: &[PathBuf]) -> Result<PathBuf, String> {
        let lines: String = files.iter().map(|file| format!("#include \"{}\"\n", file.display())).collect();
        self.write(name, &lines)
    }

    /// Compiles the plugin with Clang for each version, each of its files alone for the last one, and once without Direct3D 12.
    fn compile(&self, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        let console = Console::new();
        let mingw = tools::mingw_compiler(true, &console).map_err(|e| e.to_string())?;
        let (program, first, system) = if mingw.first.is_empty() {
            let Some(clang) = tools::clang("clang++", &console) else {
                tally.skips.push(skip("Clang on the plugin", "needs clang: apt install clang".to_owned()));
                return Ok(());
            };
            (clang, &["--target=x86_64-pc-windows-gnu"][..], system_headers(&mingw.program)?)
        } else {
            // Zig's compiler is Clang, and has its own headers.
            (mingw.program, mingw.first, Vec::new())
        };
        let sources = self.files(&format!("{RUNTIME}/Private/"), ".cpp")?;
        // The pages' code comes first, so it must include everything that it needs.
        let all = self.source_including("plugin.cpp", &[self.page_headers(tally)?, sources.clone()].concat())?;
        let cases = VERSIONS.iter().map(|version| (*version, true, &all));
        let last = VERSIONS[VERSIONS.len() - 1];
        let one_by_one = sources.iter().map(|source| (last, true, source));
        for (version, d3d12, source) in cases.chain(one_by_one).chain([(last, false, &all)]) {
            let mut command = Command::new(&program);
            command.args(first).args(["-fno-exceptions", "-fsyntax-only"]);
            self.add_flags(&mut command, version, d3d12);
            for folder in &system {
                command.arg("-isystem").arg(folder);
            }
            let accepted = log.run(command.arg(source))?.success;
            let with = if d3d12 { "with" } else { "without" };
            tally.check((!accepted).then(|| {
                format!("Clang does not take {} for Unreal Engine 5.{version} {with} Direct3D 12", source.display())
            }));
        }
        Ok(())
    }

    /// Runs the plugin's build rules, with the library in it and without.
    fn check_build_rules(&self, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        let mono = match provision::mono(&Console::new()) {
            Ok(mono) if cfg!(target_os = "linux") => mono,
            Ok(_) => return Ok(()),
            Err(e) => {
                tally.skips.push(skip("the rules of the plugin", format!("needs mono: {e}")));
                return Ok(());
            }
        };
        let workspace = self.context.workspace;
        let program = self.work.join("BuildTool.exe");
        let mut command = mono.compiler();
        command.args(["-target:exe", "-langversion:7.2", "-warnaserror+", "-warn:4"]);
        // A field that only one side of a rule reads is not an error here.
        command.arg("-nowarn:414,649").arg(format!("-out:{}", program.display())).arg(workspace.root.join(BUILD_TOOL));
        command.args(self.files(dist::UNREAL, ".Build.cs")?);
        if !log.run(&mut command)?.success {
            tally.failures.push("the rules of the plugin do not compile".to_owned());
            return Ok(());
        }
        let empty = log.run(mono.program().arg(&program).arg(workspace.root.join(dist::UNREAL)))?;
        let reported = !empty.success && empty.output.contains("error The plugin Cairn has no library");
        tally.check((!reported).then(|| format!("a plugin without a library: {:?}", empty.output)));
        let full = self.work.join("rules");
        let folder = full.join("Source/ThirdParty/CairnLibrary/include");
        fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        self.write("rules/Source/ThirdParty/CairnLibrary/include/cairn.h", "")?;
        self.write(&format!("rules/{LIBRARY}"), "")?;
        for name in AMD_LIBRARIES {
            self.write(&format!("rules/{LIBRARY_FOLDER}/{name}"), "")?;
        }
        let applied = log.run(mono.program().arg(&program).arg(&full))?;
        let (windows, linux) = applied.output.split_once("module CairnLibrary External on Linux").unwrap_or_default();
        let wanted = [
            "/Source/ThirdParty/CairnLibrary/include\n",
            "/Source/ThirdParty/CairnLibrary/lib/cairn.lib\n",
            "delayed cairn.dll\n",
            "needs $(PluginDir)/Binaries/ThirdParty/Cairn/Win64/cairn.dll\n",
            "needs $(PluginDir)/Resources/place.ppm\n",
            "depends D3D12RHI\n",
            "define CAIRN_WITH_D3D12=1\n",
        ];
        let staged = AMD_LIBRARIES.map(|name| format!("needs $(PluginDir)/{LIBRARY_FOLDER}/{name}\n"));
        for line in wanted.into_iter().chain(staged.iter().map(String::as_str)) {
            tally.check((!windows.contains(line)).then(|| format!("the rules for Windows lack {line:?}")));
        }
        let absent = windows.contains("onnxruntime.dll");
        tally.check(absent.then(|| "the rules for Windows need a library that is not there".to_owned()));
        let apart = linux.contains("define CAIRN_WITH_D3D12=0\n") && !linux.contains("D3D12RHI");
        tally.check((!apart || linux.contains("cairn.dll")).then(|| "the rules elsewhere need Windows".to_owned()));
        Ok(())
    }

    /// The test engine as a version, with the plugin's sources; `None` if it does not compile.
    fn engine(&self, log: &mut Log, version: u32, delay_imports: &Path) -> Result<Option<PathBuf>, String> {
        let sources =
            [self.files(&format!("{RUNTIME}/Private/"), ".cpp")?, self.files(&format!("{HOST}/"), ".cpp")?].concat();
        let all = self.source_including("host.cpp", &sources)?;
        let program = self.work.join(format!("host-5.{version}.exe"));
        let mingw = tools::mingw_compiler(true, &Console::new()).map_err(|e| e.to_string())?;
        let mut command = Command::new(&mingw.program);
        command.args(mingw.first);
        self.add_flags(&mut command, version, true);
        command.arg(&all).arg(delay_imports).args(["-ldelayimp", "-ld3d12", "-ldxgi", "-lshell32", "-static", "-o"]);
        Ok(log.run(command.arg(&program))?.success.then_some(program))
    }

    /// Builds the test engine around the plugin, and runs it with the library, with other files in its place, and with none.
    fn run_engine(&self, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        self.context.build_for_windows(log)?;
        let library = self.context.windows_programs();
        let plugin = self.work.join(FOLDER).join("Cairn");
        dist::assemble_unreal(self.context.workspace, &library, &plugin)?;
        // Beside the library, as the page says; the program is elsewhere.
        lab::install_runtime(&plugin.join(LIBRARY).with_file_name(""))?;
        let delay_imports = self.delay_imports(log)?;
        let mut newest = PathBuf::new();
        for version in ENGINE_VERSIONS {
            let Some(program) = self.engine(log, version, &delay_imports)? else {
                tally.failures.push(format!("the small engine does not compile as 5.{version}"));
                continue;
            };
            self.context.with_and_without_amd(tally, |amd| {
                let mut command = in_lab(&program, amd)?;
                command.env_remove("CAIRN_ONNXRUNTIME");
                command.arg(&plugin).arg("play").current_dir(&self.work);
                let (ended, broken_rules, _) = amd.beside(&plugin.join(LIBRARY).with_file_name(""), || {
                    recorder::run_program(self.context, log, &mut command, &self.work, RECORDED, amd)
                })?;
                let mut tally = Tally::default();
                let failed = || format!("the plugin in Unreal Engine 5.{version}: {}", ended.output);
                tally.test((!ended.success).then(failed));
                tally.failures.extend(broken_rules);
                Ok(tally)
            })?;
            newest = program;
        }
        for (name, library, message) in self.replacements(log)? {
            let folder = self.work.join(FOLDER).join(name);
            let file = folder.join(LIBRARY);
            fs::create_dir_all(file.parent().unwrap_or(&folder)).map_err(|e| format!("{}: {e}", file.display()))?;
            if let Some(library) = library {
                fs::copy(&library, &file).map_err(|e| format!("{}: {e}", file.display()))?;
            }
            let ended = log.run(in_lab(&newest, &Amd::None)?.arg(&folder).arg("load").current_dir(&self.work))?;
            let reported = ended.success && ended.output.contains(message) && ended.output.contains("cairn.dll");
            tally.test((!reported).then(|| format!("a plugin whose library is {name}: {:?}", ended.output)));
        }
        let second = self.work.join("second").join("cairn.dll");
        self.write("second/cairn.dll", "")?;
        fs::copy(self.work.join("other.dll"), &second).map_err(|e| format!("{}: {e}", second.display()))?;
        let ended =
            log.run(in_lab(&newest, &Amd::None)?.arg(&plugin).arg("load").arg(&second).current_dir(&self.work))?;
        // By name, Windows finds the library that was loaded first, which the plugin reports; Wine the last one, which is the plugin's own.
        let reported = ended.output.contains("the process has loaded another cairn.dll");
        let right = reported || ended.output.contains("its functions are those of the plugin's library: 1");
        tally
            .test((!ended.success || !right).then(|| format!("a plugin beside another's library: {:?}", ended.output)));
        Ok(())
    }

    /// A delay-load import library for all functions of `cairn.dll`, as a linker makes it of `cairn.lib`.
    fn delay_imports(&self, log: &mut Log) -> Result<PathBuf, String> {
        let declared = declarations::read(&self.context.workspace.read(header::HEADER)?)?;
        let names: String = declared.functions.iter().map(|function| format!("    {}\n", function.name)).collect();
        let exports = self.write("cairn.def", &format!("LIBRARY cairn.dll\nEXPORTS\n{names}"))?;
        let made = self.work.join("libcairn-late.a");
        let mut command = Command::new("x86_64-w64-mingw32-dlltool");
        command.arg("--input-def").arg(exports).args(["--dllname", "cairn.dll", "--output-delaylib"]).arg(&made);
        if log.run(&mut command)?.success { Ok(made) } else { Err("dlltool makes no imports".to_owned()) }
    }

    /// Files that may be in the library's place, and the message that each must cause.
    fn replacements(&self, log: &mut Log) -> Result<Vec<Replacement>, String> {
        let compiler = tools::mingw_compiler(false, &Console::new()).map_err(|e| e.to_string())?;
        let compile = || {
            let mut command = Command::new(&compiler.program);
            command.args(compiler.first).arg("-DCAIRN_STATIC");
            command
        };
        csharp::make_stand_ins(log, &self.context.workspace.root, &compile, "dll", &self.work)?;
        let stand_in = |name: &str| Some(self.work.join(format!("{name}.dll")));
        let text = self.write("text.dll", "no library")?;
        let processor = for_another_processor(&self.work.join("other.dll"))?;
        Ok(vec![
            ("missing", None, "the library cannot be loaded"),
            ("text", Some(text), "the library cannot be loaded"),
            ("processor", Some(processor), "it is no library of this kind of processor"),
            ("other", stand_in("other"), "this is no Cairn library"),
            ("later", stand_in("later"), "cairn_abi_version is "),
            ("older", stand_in("older"), "cairn_version is "),
            ("incomplete", stand_in("incomplete"), "the library has no "),
        ])
    }
}

/// A copy of a library whose header says that it is for Arm.
fn for_another_processor(library: &Path) -> Result<PathBuf, String> {
    let made = library.with_file_name("processor.dll");
    let mut bytes = fs::read(library).map_err(|e| format!("{}: {e}", library.display()))?;
    // The offset of the PE header is at 60. The header begins with four letters, then the processor.
    let header = bytes.get(60..64).and_then(|at| at.try_into().ok()).map_or(0, u32::from_le_bytes) as usize;
    match bytes.get_mut(header + 4..header + 6) {
        Some(processor) if header > 0 => processor.copy_from_slice(&0xAA64_u16.to_le_bytes()),
        _ => return Err(format!("{} is no library", library.display())),
    }
    fs::write(&made, bytes).map_err(|e| format!("{}: {e}", made.display())).map(|()| made)
}

/// A command that runs a program in the lab, or on Windows itself.
fn in_lab(program: &Path, amd: &Amd) -> Result<Command, String> {
    let mut command = if cfg!(windows) { Command::new(program) } else { lab::lab_run()? };
    if !cfg!(windows) {
        command.arg(program);
    }
    amd.provide(&mut command);
    Ok(command)
}

/// Folders of the C++ library and the system's headers of MinGW-w64's GCC. Its own C headers are not for Clang.
fn system_headers(compiler: &Path) -> Result<Vec<PathBuf>, String> {
    let mut command = Command::new(compiler);
    command.args(["-print-file-name=include"]);
    let own = PathBuf::from(output(&mut command)?.trim());
    let library = own.join("c++");
    let root = own.ancestors().nth(5).map(|root| root.join("x86_64-w64-mingw32").join("include"));
    match root.filter(|root| root.join("d3d12.h").is_file() && library.is_dir()) {
        Some(root) => Ok(vec![library.clone(), library.join("x86_64-w64-mingw32"), root]),
        None => Err(format!("{} has its headers in other places than GCC of MinGW-w64 has", compiler.display())),
    }
}

/// Why the engine's header tool would refuse a header: it allows no `#if` around its macros, and no macros without the generated header.
fn header_tool_error(text: &str, name: &str) -> Option<String> {
    let marked = ["UCLASS(", "USTRUCT(", "UENUM("].iter().map(|mark| text.matches(mark).count()).sum::<usize>();
    let includes: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("#include ")).collect();
    let own = format!("\"{name}.generated.h\"");
    match marked {
        0 if includes.contains(&own.as_str()) => {
            Some("nothing is marked, and it includes a generated header".to_owned())
        }
        0 => None,
        _ if includes.last() != Some(&own.as_str()) => Some(format!("{own} is not what it includes last")),
        _ if text.lines().any(|line| line.starts_with("#if")) => Some("has conditions".to_owned()),
        _ if text.matches("GENERATED_BODY()").count() + text.matches("UENUM(").count() != marked => {
            Some("each marked class and struct has one GENERATED_BODY()".to_owned())
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_tool_errors_are_reported() {
        let good = "#pragma once\n#include \"CoreMinimal.h\"\n#include \"A.generated.h\"\nUCLASS()\nclass A { GENERATED_BODY() };\n";
        assert_eq!(header_tool_error(good, "A"), None);
        assert_eq!(header_tool_error("#include \"CoreMinimal.h\"\nclass A;\n", "A"), None);
        for (from, to) in [
            ("GENERATED_BODY()", ""),
            ("#include \"A.g", "#include \"B.g"),
            ("UCLASS()", "#if X\nUCLASS()"),
            ("UCLASS()", ""),
        ] {
            assert!(header_tool_error(&good.replace(from, to), "A").is_some(), "{from} as {to}");
        }
    }
}
