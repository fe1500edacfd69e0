//! The library, built for an archive: what hosts load, what they link, and what debuggers read, apart from each other.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::Command;

use implib::{Flavor, ImportLibrary, MachineType};
use jiff::Timestamp;
use object::Object;
use object::read::pe::PeFile64;
use object::read::{NameOrOrdinal, ReadRef};
use provision::{Console, tools};

use super::Platform;
use super::archive::EPOCH;
use crate::shell::pass_through;
use crate::workspace::Workspace;

/// Where an archive's library comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// It is compiled for hosts' users, with what it was compiled from named the same wherever that is.
    Release,
    /// The one that tests have built.
    Tests,
}

/// A library and what belongs to it, as bytes of files.
pub(super) struct Built {
    /// `cairn.dll` or `libcairn.so`, without debug information and with the name of the file that has it.
    pub(super) library: Vec<u8>,
    /// That file.
    pub(super) debug: Vec<u8>,
    /// What Windows programs are linked with.
    pub(super) import: Option<Import>,
    /// The same library with Unity's doors, of Windows.
    pub(super) unity: Option<Vec<u8>>,
}

/// The two kinds of import libraries.
pub(super) struct Import {
    /// `cairn.lib`, for MSVC's and LLVM's linkers.
    pub(super) msvc: Vec<u8>,
    /// `libcairn.dll.a`, for MinGW's.
    pub(super) mingw: Vec<u8>,
}

/// Names of the library and of the file with its debug information.
pub(super) fn names(platform: Platform) -> [&'static str; 2] {
    match platform {
        Platform::Windows => ["cairn.dll", "cairn.dll.debug"],
        Platform::Linux => ["libcairn.so", "libcairn.so.debug"],
    }
}

/// The plugin for Unity.
const UNITY: &str = "cairn_unity.dll";

/// What takes debug information out of a platform's files.
fn objcopy(platform: Platform) -> &'static str {
    match platform {
        Platform::Windows => "x86_64-w64-mingw32-objcopy",
        Platform::Linux => "objcopy",
    }
}

/// The oldest glibc that the Linux library runs on: that of Debian 10, Ubuntu 20.04 and RHEL 8.
pub(super) const GLIBC: &str = "2.28";

/// Builds it, or takes the one that is there.
pub(super) fn build(
    workspace: &Workspace,
    platform: Platform,
    source: Source,
    moment: Timestamp,
) -> Result<Built, String> {
    let work = workspace.target.join("xtask").join("dist").join(platform.name());
    fs::create_dir_all(&work).map_err(|e| format!("{}: {e}", work.display()))?;
    let folder = match (platform, source) {
        (_, Source::Release) => compile(workspace, platform, moment)?,
        (Platform::Windows, Source::Tests) => workspace.target.join(platform.triple()).join("debug"),
        (Platform::Linux, Source::Tests) => link(workspace, &work)?,
    };
    let [library, debug] = names(platform);
    split(platform, &folder.join(library), &work, moment)?;
    let read = |path: PathBuf| fs::read(&path).map_err(|e| format!("{}: {e}", path.display()));
    let import = match platform {
        Platform::Windows => {
            let bytes = read(folder.join(library))?;
            Some(Import { msvc: import_library(library, &bytes)?, mingw: read(folder.join("libcairn.dll.a"))? })
        }
        Platform::Linux => None,
    };
    let unity = match platform {
        Platform::Windows => {
            let stripped = work.join(UNITY);
            let mut command = Command::new(objcopy(platform));
            command.args(PASSING).arg("--strip-debug").arg(folder.join(UNITY)).arg(&stripped);
            pass_through(command.env(EPOCH, moment.as_second().to_string()))?;
            Some(read(stripped)?)
        }
        Platform::Linux => None,
    };
    Ok(Built { library: read(work.join(library))?, debug: read(work.join(debug))?, import, unity })
}

/// Compiles it for hosts' users; the folder of what came out.
fn compile(workspace: &Workspace, platform: Platform, moment: Timestamp) -> Result<PathBuf, String> {
    let console = Console::new();
    // Compiled with other flags than everything else, it would replace what is there.
    let apart = workspace.target.join("dist").join("build");
    tools::rust_target(platform.triple(), &console).map_err(|e| e.to_string())?;
    let (verb, target) = match platform {
        Platform::Windows => ("build", platform.triple().to_owned()),
        // Linked with stand-ins of an older C library than this machine's.
        Platform::Linux => ("zigbuild", format!("{}.{GLIBC}", platform.triple())),
    };
    let mut command = workspace.cargo([verb, "--release", "--package", "cairn", "--lib", "--target", &target]);
    command.arg("--target-dir").arg(&apart).env("CARGO_ENCODED_RUSTFLAGS", flags(workspace)?);
    command.env(EPOCH, moment.as_second().to_string());
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
    Ok(apart.join(platform.triple()).join("release"))
}

/// A library that is Cairn's whole: what an `rlib` exports to C, a library made of it does too.
const NOTHING: &str = "extern crate cairn as _;\n";

/// Links what tests have compiled as [`compile`] links it; the folder of what came out. Compiled code knows nothing of the C library's
/// age, so that only the last step is another.
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
    let source = write("nothing.rs", NOTHING)?;
    let linked = work.join("linked");
    fs::create_dir_all(&linked).map_err(|e| format!("{}: {e}", linked.display()))?;
    let compiled = workspace.target.join("debug");
    let mut command = Command::new("rustc");
    command.args(["--edition=2024", "--crate-name=cairn", "--crate-type=cdylib", "-Copt-level=1"]);
    command.arg("-Clinker-flavor=gcc").arg(format!("-Clinker={}", linker.display())).arg("--extern");
    command.arg(format!("cairn={}", compiled.join("libcairn.rlib").display()));
    command.arg("-L").arg(format!("dependency={}", compiled.join("deps").display()));
    command.arg("--out-dir").arg(&linked).arg(source).current_dir(&workspace.root);
    tools::by_zig(&mut command, &Console::new()).map_err(|e| e.to_string())?;
    pass_through(&mut command)?;
    Ok(linked)
}

/// Lets a file be run.
fn executable(file: &Path) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        fs::set_permissions(file, fs::Permissions::from_mode(0o755))?;
    }
    fs::metadata(file).map(drop)
}

/// Flags that have the compiler name every source the same, wherever the clone and cargo's sources lie; separated as
/// `CARGO_ENCODED_RUSTFLAGS` wants it.
fn flags(workspace: &Workspace) -> Result<String, String> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| std::env::home_dir().map(|home| home.join(".cargo"))).ok_or("no home directory")?;
    let remap = |from: &Path, to: &str| format!("--remap-path-prefix={}={to}", from.display());
    // The later of two that fit is taken, and the clone may lie below the home.
    Ok([remap(&home, "cargo"), remap(&workspace.root, "cairn")].join("\u{1f}"))
}

/// Takes out symbols that are other ones in every build, and that nobody looks for. LLVM numbers what it shares among parts of a crate by
/// how the compiler wrote these down, which is not always the same; debug information has the names without numbers. And `dlltool`
/// calls the import libraries that rustc makes while it compiles by where they lay; such a symbol names no code.
const PASSING: [&str; 4] = [
    "--wildcard",
    "--strip-symbol=*.llvm.[0-9]*",
    "--strip-symbol=*_dll_imports_lib_iname",
    "--strip-symbol=_head_*_dll_imports_lib",
];

/// Puts the library without its debug information into `work`, and that information beside it. A Windows file tells when it was
/// made: at `moment`.
fn split(platform: Platform, library: &Path, work: &Path, moment: Timestamp) -> Result<(), String> {
    let program = objcopy(platform);
    let [name, debug] = names(platform);
    let run = |arguments: &[&str], files: &[&Path]| {
        // The link names the other file as it is given: in its own folder it is a name alone.
        let mut command = Command::new(program);
        command.args(PASSING).args(arguments).args(files).current_dir(work).env(EPOCH, moment.as_second().to_string());
        pass_through(&mut command)
    };
    run(&["--only-keep-debug"], &[library, Path::new(debug)])?;
    let link = format!("--add-gnu-debuglink={debug}");
    run(&["--strip-debug", &link], &[library, Path::new(name)])
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

/// Names of what a DLL exports.
pub(crate) fn exports<'data>(dll: impl ReadRef<'data>) -> Result<Vec<String>, String> {
    let file = PeFile64::parse(dll).map_err(|e| format!("the built library is no DLL: {e}"))?;
    let failed = |e: object::read::Error| format!("the DLL's exports: {e}");
    let mut names = Vec::new();
    for export in file.exports().map_err(failed)? {
        // What has a number only is no function of ours.
        if let NameOrOrdinal::Name(name) = export.map_err(failed)?.name() {
            names.push(String::from_utf8_lossy(name).into_owned());
        }
    }
    Ok(names)
}
