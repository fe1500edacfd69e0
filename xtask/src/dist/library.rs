//! Builds the binaries of an archive: the shared library with its import libraries and its debug information as a separate file, the plugin
//! for Unity, and `cairn-check`.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::Command;

use implib::{Flavor, ImportLibrary, MachineType};
use jiff::Timestamp;
use object::elf::{DT_SONAME, FileHeader64};
use object::read::elf::{Dyn as _, FileHeader as _};
use object::read::pe::PeFile64;
use object::read::{NameOrOrdinal, ReadRef};
use object::{Endianness, Object};
use provision::{Console, tools};

use super::Platform;
use super::archive::EPOCH;
use crate::shell::pass_through;
use crate::workspace::Workspace;

/// Where an archive's library comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// Compiled for release, with source paths that do not depend on the machine.
    Release,
    /// The library that tests have built.
    Tests,
}

/// A library and its companion files, as bytes.
pub(super) struct BuiltLibrary {
    /// `cairn.dll` or `libcairn.so`, without debug information and with the name of the debug file.
    pub(super) library: Vec<u8>,
    /// The debug file.
    pub(super) debug: Vec<u8>,
    /// Import libraries for Windows programs.
    pub(super) import: Option<Import>,
    /// The same library with Unity's entry points, for Windows.
    pub(super) unity: Option<Vec<u8>>,
    /// The program `cairn-check`.
    pub(super) check: BuiltProgram,
}

/// A program, as bytes.
pub(super) struct BuiltProgram {
    /// Without symbols and debug information.
    pub(super) stripped: Vec<u8>,
    /// With symbols.
    pub(super) with_symbols: Vec<u8>,
}

/// The two kinds of import libraries.
pub(super) struct Import {
    /// `cairn.lib`, for MSVC's and LLVM's linkers.
    pub(super) msvc: Vec<u8>,
    /// `libcairn.dll.a`, for MinGW's.
    pub(super) mingw: Vec<u8>,
}

/// Names of the library and of its debug file.
pub(super) fn names(platform: Platform) -> [&'static str; 2] {
    match platform {
        Platform::Windows => ["cairn.dll", "cairn.dll.debug"],
        Platform::Linux => ["libcairn.so", "libcairn.so.debug"],
    }
}

/// File name of `cairn-check`.
pub(super) fn check_name(platform: Platform) -> &'static str {
    match platform {
        Platform::Windows => "cairn-check.exe",
        Platform::Linux => "cairn-check",
    }
}

/// File name of the plugin for Unity.
const UNITY: &str = "cairn_unity.dll";

/// The program that separates debug information from a platform's files.
fn objcopy(platform: Platform) -> &'static str {
    match platform {
        Platform::Windows => "x86_64-w64-mingw32-objcopy",
        Platform::Linux => "objcopy",
    }
}

/// The oldest glibc that the Linux library runs on: that of Debian 10, Ubuntu 20.04 and RHEL 8.
pub(super) const GLIBC: &str = "2.28";

/// Builds the library, or takes the one that tests have built.
pub(super) fn build(
    workspace: &Workspace,
    platform: Platform,
    source: Source,
    build_time: Timestamp,
) -> Result<BuiltLibrary, String> {
    // A folder of its own: two archives may be made at the same time.
    let parent = workspace.target.join("xtask");
    let work = fs::create_dir_all(&parent).and_then(|()| tempfile::Builder::new().prefix("dist-").tempdir_in(&parent));
    let work = work.map_err(|e| format!("{}: {e}", parent.display()))?;
    let work = work.path();
    let folder = match (platform, source) {
        (_, Source::Release) => compile(workspace, platform, build_time)?,
        (Platform::Windows, Source::Tests) => workspace.target.join(platform.triple()).join("debug"),
        (Platform::Linux, Source::Tests) => link(workspace, work)?,
    };
    let [library, debug] = names(platform);
    split_debug_information(platform, &folder.join(library), work, build_time)?;
    let read = |path: PathBuf| fs::read(&path).map_err(|e| format!("{}: {e}", path.display()));
    let import = match platform {
        Platform::Windows => {
            let bytes = read(folder.join(library))?;
            Some(Import { msvc: import_library(library, &bytes)?, mingw: read(folder.join("libcairn.dll.a"))? })
        }
        Platform::Linux => None,
    };
    let check = strip_program(platform, &folder.join(check_name(platform)), work, build_time)?;
    let unity = match platform {
        Platform::Windows => {
            let stripped = work.join(UNITY);
            let mut command = Command::new(objcopy(platform));
            command.args(STRIP_BUILD_SPECIFIC).arg("--strip-debug").arg(folder.join(UNITY)).arg(&stripped);
            pass_through(command.env(EPOCH, build_time.as_second().to_string()))?;
            Some(read(stripped)?)
        }
        Platform::Linux => None,
    };
    Ok(BuiltLibrary { library: read(work.join(library))?, debug: read(work.join(debug))?, import, unity, check })
}

/// Compiles library and programs for release; returns the output folder.
fn compile(workspace: &Workspace, platform: Platform, build_time: Timestamp) -> Result<PathBuf, String> {
    let console = Console::new();
    // It has other flags than all other builds, and would replace their files.
    let target_dir = workspace.target.join("dist").join("build");
    tools::rust_target(platform.triple(), &console).map_err(|e| e.to_string())?;
    let (verb, target) = match platform {
        Platform::Windows => ("build", platform.triple().to_owned()),
        // Linked with stubs of an older C library than this machine's.
        Platform::Linux => ("zigbuild", format!("{}.{GLIBC}", platform.triple())),
    };
    let mut command = workspace.cargo([verb, "--release", "--package", "cairn", "--lib", "--target", &target]);
    // In one command with the library: by itself it would compile the library again, with other features of shared dependencies.
    command.args(["--package", "cairn-check", "--bin", "cairn-check"]);
    command.arg("--target-dir").arg(&target_dir).env("CARGO_ENCODED_RUSTFLAGS", flags(workspace)?);
    command.env(EPOCH, build_time.as_second().to_string());
    match platform {
        Platform::Windows => {
            command.args(["--package", "cairn-unity"]);
            if tools::mingw(&console).map_err(|e| e.to_string())? != tools::Mingw::Gcc {
                return Err("MinGW-w64's GCC and binutils are needed: apt install gcc-mingw-w64-x86-64".to_owned());
            }
        }
        Platform::Linux => tools::by_zig(&mut command, &console).map_err(|e| e.to_string())?,
    }
    pass_through(&mut command)?;
    Ok(target_dir.join(platform.triple()).join("release"))
}

/// A library that re-exports all of Cairn: a `cdylib` made of an `rlib` also exports the `rlib`'s C functions.
const REEXPORT: &str = "extern crate cairn as _;\n";

/// Links the `rlib`s that tests have compiled as [`compile`] links them; returns the output folder. Compiled code does not depend on the C
/// library's version, so only the link step differs.
fn link(workspace: &Workspace, work: &Path) -> Result<PathBuf, String> {
    let write = |name: &str, text: &str| {
        let path = work.join(name);
        fs::write(&path, text).map(|()| path.clone()).map_err(|e| format!("{}: {e}", path.display()))
    };
    let linker = write(
        "link.sh",
        &format!("#!/bin/sh\nexec cargo-zigbuild zig cc -- -target x86_64-linux-gnu.{GLIBC} \"$@\"\n"),
    )?;
    executable(&linker).map_err(|e| format!("{}: {e}", linker.display()))?;
    let library = write("nothing.rs", REEXPORT)?;
    let program = workspace.root.join("tools/check/src/main.rs");
    let linked = work.join("linked");
    fs::create_dir_all(&linked).map_err(|e| format!("{}: {e}", linked.display()))?;
    let compiled = workspace.target.join("debug");
    let crates =
        [("cairn", "cdylib", "cairn", &library), (check_name(Platform::Linux), "bin", "cairn_check", &program)];
    for (name, kind, uses, source) in crates {
        let mut command = Command::new("rustc");
        command.args(["--edition=2024", "-Copt-level=1"]).arg(format!("--crate-type={kind}"));
        command.arg(format!("--crate-name={}", name.replace('-', "_")));
        command.arg("-Clinker-flavor=gcc").arg(format!("-Clinker={}", linker.display())).arg("--extern");
        command.arg(format!("{uses}={}", compiled.join(format!("lib{uses}.rlib")).display()));
        command.arg("-L").arg(format!("dependency={}", compiled.join("deps").display()));
        match kind {
            "bin" => command.arg("-o").arg(linked.join(name)),
            // As the package's build script does for cargo.
            _ => command
                .arg(format!("-Clink-arg=-Wl,-soname,{}", names(Platform::Linux)[0]))
                .arg("--out-dir")
                .arg(&linked),
        };
        tools::by_zig(command.arg(source).current_dir(&workspace.root), &Console::new()).map_err(|e| e.to_string())?;
        pass_through(&mut command)?;
    }
    Ok(linked)
}

/// Makes a file executable.
fn executable(file: &Path) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        fs::set_permissions(file, fs::Permissions::from_mode(0o755))?;
    }
    fs::metadata(file).map(drop)
}

/// Compiler flags that make source paths the same wherever the repository and cargo's sources are; separated as in
/// `CARGO_ENCODED_RUSTFLAGS`.
fn flags(workspace: &Workspace) -> Result<String, String> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| std::env::home_dir().map(|home| home.join(".cargo"))).ok_or("no home directory")?;
    let remap = |from: &Path, to: &str| format!("--remap-path-prefix={}={to}", from.display());
    // The last matching flag wins, and the repository may be below the home directory.
    Ok([remap(&home, "cargo"), remap(&workspace.root, "cairn")].join("\u{1f}"))
}

/// Options of objcopy that strip symbols which differ between builds and which no program needs. LLVM numbers the symbols that parts of a
/// crate share by the order in which the compiler emits them, which varies; the debug information has the names without numbers. `dlltool`
/// names symbols of rustc's temporary import libraries after their paths; these symbols name no code.
const STRIP_BUILD_SPECIFIC: [&str; 4] = [
    "--wildcard",
    "--strip-symbol=*.llvm.[0-9]*",
    // With the letters that the import names its DLL by: `SHELL32.DLL`, `kernel32.dll`.
    "--strip-symbol=*_[dD][lL][lL]_imports_lib_iname",
    "--strip-symbol=_head_*_[dD][lL][lL]_imports_lib",
];

/// Writes the stripped library into `work`, and its debug information beside it. `build_time` is the time stamp that a Windows file
/// contains.
fn split_debug_information(
    platform: Platform,
    library: &Path,
    work: &Path,
    build_time: Timestamp,
) -> Result<(), String> {
    let program = objcopy(platform);
    let [name, debug] = names(platform);
    let run = |arguments: &[&str], files: &[&Path]| {
        // The debug link stores the path as given, so the file is named relative to its own folder.
        let mut command = Command::new(program);
        command
            .args(STRIP_BUILD_SPECIFIC)
            .args(arguments)
            .args(files)
            .current_dir(work)
            .env(EPOCH, build_time.as_second().to_string());
        pass_through(&mut command)
    };
    run(&["--only-keep-debug"], &[library, Path::new(debug)])?;
    let link = format!("--add-gnu-debuglink={debug}");
    run(&["--strip-debug", &link], &[library, Path::new(name)])
}

/// The program in `file`, stripped into `work`.
fn strip_program(platform: Platform, file: &Path, work: &Path, build_time: Timestamp) -> Result<BuiltProgram, String> {
    let stripped = work.join(check_name(platform));
    let mut command = Command::new(objcopy(platform));
    command.arg("--strip-all").arg(file).arg(&stripped).env(EPOCH, build_time.as_second().to_string());
    pass_through(&mut command)?;
    let read = |path: &Path| fs::read(path).map_err(|e| format!("{}: {e}", path.display()));
    Ok(BuiltProgram { stripped: read(&stripped)?, with_symbols: read(file)? })
}

/// An import library of all that a DLL exports.
fn import_library(name: &str, dll: &[u8]) -> Result<Vec<u8>, String> {
    let failed = |e: &dyn std::fmt::Display| format!("the import library of {name}: {e}");
    let mut definition = format!("LIBRARY {name}\nEXPORTS\n");
    for function in exports(dll)? {
        definition.push_str(&function);
        definition.push('\n');
    }
    let library = ImportLibrary::new(&definition, MachineType::AMD64, Flavor::Msvc).map_err(|e| failed(&e))?;
    let mut bytes = Cursor::new(Vec::new());
    library.write_to(&mut bytes).map_err(|e| failed(&e))?;
    Ok(bytes.into_inner())
}

/// The `DT_SONAME` of a shared library for Linux: the name by which programs that are linked with it look for it.
pub(crate) fn soname(library: &[u8]) -> Result<Option<String>, String> {
    let failed = |e: object::read::Error| format!("the built library is no ELF file: {e}");
    let header = FileHeader64::<Endianness>::parse(library).map_err(failed)?;
    let endian = header.endian().map_err(failed)?;
    let sections = header.sections(endian, library).map_err(failed)?;
    let Some((entries, strings)) = sections.dynamic(endian, library).map_err(failed)? else { return Ok(None) };
    let strings = sections.strings(endian, library, strings).map_err(failed)?;
    let Some(entry) = entries.iter().find(|entry| entry.tag(endian) == DT_SONAME) else { return Ok(None) };
    let name = entry.string(endian, strings).map_err(failed)?;
    Ok(Some(String::from_utf8_lossy(name).into_owned()))
}

/// Names of a DLL's exports.
pub(crate) fn exports<'data>(dll: impl ReadRef<'data>) -> Result<Vec<String>, String> {
    let file = PeFile64::parse(dll).map_err(|e| format!("the built library is no DLL: {e}"))?;
    let failed = |e: object::read::Error| format!("the DLL's exports: {e}");
    let mut names = Vec::new();
    for export in file.exports().map_err(failed)? {
        // An export with an ordinal only is not one of our functions.
        if let NameOrOrdinal::Name(name) = export.map_err(failed)?.name() {
            names.push(String::from_utf8_lossy(name).into_owned());
        }
    }
    Ok(names)
}
