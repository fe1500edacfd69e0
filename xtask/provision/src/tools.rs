//! Programs the build can use: found on the PATH, else installed by apt, rustup, PyPI or cargo.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use crate::python::{self, text};
use crate::{Error, Progress, Result, cache, process};

/// The Rust target of the Windows build.
pub const WINDOWS_TARGET: &str = "x86_64-pc-windows-gnu";

/// How the Windows target is linked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mingw {
    /// A MinGW-w64 GCC on the PATH; cargo finds it by itself.
    Gcc,
    /// `cargo-zigbuild` with its `ziglang`; [`by_zig`] puts them on a command's PATH.
    Zig,
}

/// Path of the program `name` if it is on the PATH.
pub fn on_path(name: &str) -> Option<PathBuf> {
    all_on_path(name).into_iter().next()
}

/// Paths of all programs `name` on the PATH, in its order.
fn all_on_path(name: &str) -> Vec<PathBuf> {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&paths).map(|folder| folder.join(&file)).filter(|path| path.is_file()).collect()
}

/// The assembler for the video encoder's fast code; `None` if neither the PATH nor apt has it. It is optional: without it
/// the encoder is slower and the pictures are the same.
pub fn nasm(progress: &dyn Progress) -> Option<PathBuf> {
    on_path("nasm").or_else(|| {
        apt("nasm", progress).ok()?;
        on_path("nasm")
    })
}

/// A Chromium that plays video, from the PATH or by apt when root; else `None`. A snap does not count: it may not use the tests' profile
/// folder.
pub fn chromium(progress: &dyn Progress) -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let find = || names.into_iter().flat_map(all_on_path).find(|path| !is_snap(path));
    find().or_else(|| {
        apt("chromium", progress).ok()?;
        find()
    })
}

/// Whether a program is a snap, or a script that starts one, as Ubuntu's `chromium-browser` is.
fn is_snap(program: &Path) -> bool {
    let is_below_snap = |path: &Path| path.starts_with("/snap") || path.starts_with("/var/lib/snapd");
    let target = std::fs::canonicalize(program).unwrap_or_else(|_| program.to_owned());
    // `/snap/bin/chromium` links to snap itself.
    if is_below_snap(program) || is_below_snap(&target) || target.ends_with("bin/snap") {
        return true;
    }
    let is_small = std::fs::metadata(&target).is_ok_and(|file| file.len() < 1 << 16);
    is_small && std::fs::read(&target).is_ok_and(|text| String::from_utf8_lossy(&text).contains("/snap/bin/"))
}

/// Clang's compiler `name` (`clang`, `clang++`), from the PATH or by apt when root; else `None`.
pub fn clang(name: &str, progress: &dyn Progress) -> Option<PathBuf> {
    on_path(name).or_else(|| {
        apt("clang", progress).ok()?;
        on_path(name)
    })
}

/// CMake, from the PATH or by apt when root; else `None`.
pub fn cmake(progress: &dyn Progress) -> Option<PathBuf> {
    on_path("cmake").or_else(|| {
        apt("cmake", progress).ok()?;
        on_path("cmake")
    })
}

/// Libraries that a window on X11 loads, and their packages in Debian.
const WINDOW_LIBRARIES: [(&str, &str); 4] = [
    ("libX11-xcb.so.1", "libx11-xcb1"),
    ("libXcursor.so.1", "libxcursor1"),
    ("libXi.so.6", "libxi6"),
    ("libxkbcommon-x11.so.0", "libxkbcommon-x11-0"),
];

/// Xvfb, an X server without a display, with the libraries that a window on it loads: from the system or by apt when root; else `None`.
pub fn xvfb(progress: &dyn Progress) -> Option<PathBuf> {
    if on_path("Xvfb").is_none() {
        apt("xvfb", progress).ok()?;
    }
    for (library, package) in WINDOW_LIBRARIES {
        if !is_loadable(library) {
            apt(package, progress).ok()?;
        }
    }
    on_path("Xvfb")
}

/// Whether the dynamic linker's cache names a library.
fn is_loadable(library: &str) -> bool {
    let known =
        |program| process::run(Command::new(program).arg("-p"), |_| {}).is_ok_and(|o| o.stdout.contains(library));
    known("ldconfig") || known("/sbin/ldconfig")
}

/// debootstrap, which installs a Debian into a folder, from the PATH or by apt when root.
pub(crate) fn debootstrap(progress: &dyn Progress) -> Result<PathBuf> {
    const NAME: &str = "debootstrap";
    if on_path(NAME).is_none() {
        apt(NAME, progress)?;
    }
    let remedy = "Install it by hand: apt install debootstrap";
    on_path(NAME).ok_or_else(|| Error::new(NAME, "apt installed it, and it is not on the PATH", remedy))
}

/// A C or C++ compiler for Windows, and its first arguments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MingwCompiler {
    /// The program.
    pub program: PathBuf,
    /// Its first arguments.
    pub first: &'static [&'static str],
}

/// A C compiler for Windows, or with `cpp` a C++ compiler: MinGW-w64's from the PATH or by apt when root, else `ziglang`'s.
///
/// # Errors
/// Neither is available; the error has the reason.
pub fn mingw_compiler(cpp: bool, progress: &dyn Progress) -> Result<MingwCompiler> {
    let (name, package) = match cpp {
        false => ("x86_64-w64-mingw32-gcc", "gcc-mingw-w64-x86-64"),
        true => ("x86_64-w64-mingw32-g++", "g++-mingw-w64-x86-64"),
    };
    let found = on_path(name).or_else(|| {
        apt(package, progress).ok()?;
        on_path(name)
    });
    if let Some(program) = found {
        return Ok(MingwCompiler { program, first: &[] });
    }
    let programs = zigbuild(progress)?.programs();
    let first: &[&str] = match cpp {
        false => &["-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"],
        true => &["-m", "ziglang", "c++", "-target", "x86_64-windows-gnu"],
    };
    Ok(MingwCompiler { program: programs.join(if cfg!(windows) { "python.exe" } else { "python" }), first })
}

/// A linker for [`WINDOWS_TARGET`]: MinGW from the PATH, by apt when root, else `ziglang` from PyPI.
///
/// # Errors
/// Neither is available; the error has the reason.
pub fn mingw(progress: &dyn Progress) -> Result<Mingw> {
    const COMPILER: &str = "x86_64-w64-mingw32-gcc";
    if on_path(COMPILER).is_some() || (apt("gcc-mingw-w64-x86-64", progress).is_ok() && on_path(COMPILER).is_some()) {
        return Ok(Mingw::Gcc);
    }
    zigbuild(progress).map(|_| Mingw::Zig)
}

/// Installs a Debian package; fails where there is no apt-get, or where we are not root.
fn apt(package: &str, progress: &dyn Progress) -> Result<()> {
    let wanted = format!("the package {package}");
    let fail = |cause: String| Error::new(wanted.clone(), cause, format!("Install it by hand: apt install {package}"));
    if on_path("apt-get").is_none() {
        return Err(fail("there is no apt-get here".to_owned()));
    }
    if !is_root() {
        return Err(fail("apt-get needs root".to_owned()));
    }
    progress.start(&format!("installing {package} with apt-get"));
    update_apt_lists(progress)?;
    let _held = cache::lock("apt", progress)?;
    let mut command = apt_get();
    command.args(["install", "-qq", "-y", "--no-install-recommends", package]);
    let outcome =
        process::run(&mut command, |line| progress.detail(line)).map_err(|e| fail(format!("apt-get: {e}")))?;
    if !outcome.status.success() {
        let error = fail(format!("apt-get install failed:\n{}\n", outcome.tail(3)));
        progress.done(&format!("{package} could not be installed; going on without it"));
        return Err(error);
    }
    progress.done(&format!("{package} is installed"));
    Ok(())
}

/// A command of apt-get that asks nothing and waits for a while if another program installs packages.
fn apt_get() -> Command {
    let mut command = Command::new("apt-get");
    command.args(["-o", "DPkg::Lock::Timeout=300"]).env("DEBIAN_FRONTEND", "noninteractive");
    command
}

/// Makes apt fetch its lists, unless this process has done so. Failing is no error: apt may have lists already.
///
/// # Errors
/// The lock of apt cannot be made.
pub(crate) fn update_apt_lists(progress: &dyn Progress) -> Result<()> {
    static IS_UPDATED: Mutex<bool> = Mutex::new(false);
    let mut is_updated = IS_UPDATED.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if !*is_updated {
        // Two of them at once would fail: apt-get waits only for the lock of installing.
        let _held = cache::lock("apt", progress)?;
        // The option makes it fail if it cannot reach a mirror, so that the next call tries again.
        let mut command = apt_get();
        command.args(["update", "-qq", "-o", "APT::Update::Error-Mode=any"]);
        *is_updated =
            process::run(&mut command, |line| progress.detail(line)).is_ok_and(|ended| ended.status.success());
    }
    Ok(())
}

/// Whether we may install system packages. The `id` program gives the user id, as std has no call for it.
pub(crate) fn is_root() -> bool {
    cfg!(unix) && process::run(Command::new("id").arg("-u"), |_| {}).is_ok_and(|outcome| outcome.stdout.trim() == "0")
}

/// The version of zig, which links for other systems.
pub const ZIG: &str = "0.16.0";

/// Pinned: the linker wrapper and the compiler it drives.
const ZIG_PACKAGES: &str = "cargo-zigbuild==0.23.4\nziglang==0.16.0\n";

/// The environment of `cargo-zigbuild` and `ziglang`, in the cache. It also has the objects that zig has compiled.
#[derive(Debug, Clone)]
pub struct ZigEnvironment {
    folder: PathBuf,
}

impl ZigEnvironment {
    /// Its folder in the cache. It may be copied into another cache.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The folder with `cargo-zigbuild` and a `python` that has `ziglang`.
    pub fn programs(&self) -> PathBuf {
        self.folder.join(if cfg!(windows) { "Scripts" } else { "bin" })
    }

    /// The folder of the objects that zig has compiled; it may be removed.
    pub fn objects(&self) -> PathBuf {
        self.folder.join("objects")
    }
}

/// `cargo-zigbuild` and `ziglang` in an environment of their own; fetched on first use (90 MB).
///
/// # Errors
/// No Python with pip, or an unreachable index.
pub fn zigbuild(progress: &dyn Progress) -> Result<ZigEnvironment> {
    let wanted = "a linker for other systems";
    python::environment("zigbuild", &python::find()?, ZIG_PACKAGES, wanted, progress)
        .map(|folder| ZigEnvironment { folder })
}

/// The folder of the sources that zig compiles while it links: the unwinder and the C libraries.
///
/// # Errors
/// As [`zigbuild`], or its package has no such folder.
pub fn zig_sources(progress: &dyn Progress) -> Result<PathBuf> {
    let environment = zigbuild(progress)?;
    let folder = environment.folder();
    let packages = match cfg!(windows) {
        true => vec![folder.join("Lib")],
        // It is below a folder named after the Python version.
        false => {
            let library = folder.join("lib");
            let entries = std::fs::read_dir(&library).map_err(|e| Error::io(&library, &e))?;
            entries.flatten().map(|entry| entry.path()).collect()
        }
    };
    let mut found = packages.iter().map(|folder| folder.join("site-packages/ziglang/lib"));
    found.find(|folder| folder.join("libunwind").is_dir()).ok_or_else(|| {
        let remedy = format!("Remove {} and run the command again", folder.display());
        Error::new("zig's sources", "its package has no folder of them", remedy)
    })
}

/// Makes zig compile its own sources without debug information, which would name them by their path in the cache and the working folder.
/// Clang's driver reads arguments from this variable, the only way to reach compilations that zig starts itself; the `#` suppresses the
/// driver's message about them.
const NO_DEBUG: (&str, &str) = ("CCC_OVERRIDE_OPTIONS", "#+-g0");

/// Puts `cargo-zigbuild` and its zig, fetched on first use, at the front of a command's PATH.
///
/// # Errors
/// As [`zigbuild`], or a cache whose folder cannot be on a PATH.
pub fn by_zig(command: &mut Command, progress: &dyn Progress) -> Result<()> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let environment = zigbuild(progress)?;
    let folders = std::iter::once(environment.programs()).chain(std::env::split_paths(&path));
    let remedy = "Set CAIRN_CACHE_DIR to a folder with a plain name";
    let joined = std::env::join_paths(folders).map_err(|e| Error::new("PATH", e.to_string(), remedy))?;
    // Their compiled files have a cache of their own: zig reuses them whatever flags they were compiled with.
    let compiled = environment.objects();
    command.env("PATH", joined).env("ZIG_GLOBAL_CACHE_DIR", compiled.join("global"));
    command.env("CARGO_ZIGBUILD_CACHE_DIR", compiled.join("wrappers")).env(NO_DEBUG.0, NO_DEBUG.1);
    Ok(())
}

/// Adds `target` to the pinned toolchain if it is missing.
///
/// # Errors
/// The target's standard library is missing and rustup cannot add it.
pub fn rust_target(target: &str, progress: &dyn Progress) -> Result<()> {
    let libraries = process::run(Command::new("rustc").args(["--print", "target-libdir", "--target", target]), |_| {})
        .map_err(|e| Error::new("rustc", e.to_string(), "Install Rust with rustup (rustup.rs)"))?;
    if libraries.status.success() && Path::new(libraries.stdout.trim()).is_dir() {
        return Ok(());
    }
    rustup(&["target", "add", target], &format!("the Rust target {target}"), progress)
}

/// Adds the toolchain component behind `program` (`rustfmt`, `clippy`) if it is missing.
///
/// # Errors
/// It is missing and rustup cannot add it.
pub fn rust_component(component: &str, program: &str, progress: &dyn Progress) -> Result<()> {
    if process::run(Command::new(program).arg("--version"), |_| {}).is_ok_and(|outcome| outcome.status.success()) {
        return Ok(());
    }
    rustup(&["component", "add", component], &format!("the toolchain component {component}"), progress)
}

/// The nightly toolchain for Miri, the sanitizers and the fuzz targets, and the date that its compiler reports.
const NIGHTLY: (&str, &str) = ("nightly-2026-05-20", "2026-05-19");

/// The pinned nightly toolchain with `components` (`miri`, `rust-src`); returns its name for `rustup run`. If the machine's `nightly` is
/// the same version, that one; if the pinned one is unavailable and the machine has another nightly, that one.
///
/// # Errors
/// There is no such toolchain, or a component is missing, and rustup cannot add it.
pub fn nightly(components: &[&str], progress: &dyn Progress) -> Result<&'static str> {
    let (pinned, day) = NIGHTLY;
    let own = version_line("nightly");
    if own.as_ref().is_some_and(|line| line.contains(day)) {
        return rustup_components("nightly", components, progress).map(|()| "nightly");
    }
    let mut install = vec!["toolchain", "install", pinned, "--profile", "minimal", "--no-self-update"];
    install.extend(components.iter().flat_map(|component| ["--component", component]));
    let had = match version_line(pinned) {
        Some(_) => rustup_components(pinned, components, progress),
        None => rustup(&install, &format!("the toolchain {pinned}"), progress),
    };
    match (had, own) {
        (Ok(()), _) => Ok(pinned),
        (Err(_), Some(_)) => rustup_components("nightly", components, progress).map(|()| "nightly"),
        (Err(e), None) => Err(e),
    }
}

/// The version line of an installed toolchain's compiler; `None` if it is not installed.
fn version_line(toolchain: &str) -> Option<String> {
    let outcome = process::run(rustup_run(toolchain).args(["rustc", "--version"]), |_| {}).ok()?;
    outcome.status.success().then_some(outcome.stdout)
}

/// Adds those of `components` that an installed toolchain lacks.
fn rustup_components(toolchain: &str, components: &[&str], progress: &dyn Progress) -> Result<()> {
    let list = process::run(
        Command::new("rustup").args(["component", "list", "--installed", "--toolchain", toolchain]),
        |_| {},
    );
    let installed =
        list.map_err(|e| Error::new(toolchain, format!("rustup does not run: {e}"), "Install rustup"))?.stdout;
    // Listed with the platform after the name, if the component has one.
    let has = |component: &&&str| {
        installed
            .lines()
            .any(|line| line.strip_prefix(**component).is_some_and(|rest| rest.is_empty() || rest.starts_with('-')))
    };
    let missing: Vec<&str> = components.iter().filter(|component| !has(component)).copied().collect();
    if missing.is_empty() {
        return Ok(());
    }
    let mut arguments = vec!["component", "add", "--toolchain", toolchain];
    arguments.extend(&missing);
    rustup(&arguments, &format!("{} of the toolchain {toolchain}", missing.join(" and ")), progress)
}

/// `rustup run TOOLCHAIN`, without the variables of the pinned toolchain that runs this program.
pub fn rustup_run(toolchain: &str) -> Command {
    let mut command = Command::new("rustup");
    command.args(["run", toolchain]).env_remove("RUSTUP_TOOLCHAIN").env_remove("CARGO").env_remove("RUSTC");
    command
}

fn rustup(arguments: &[&str], wanted: &str, progress: &dyn Progress) -> Result<()> {
    let by_hand = || format!("Run by hand: rustup {}", arguments.join(" "));
    let _held = cache::lock("rustup", progress)?;
    progress.start(&format!("adding {wanted} with rustup"));
    let outcome = process::run(Command::new("rustup").args(arguments), |line| progress.detail(line))
        .map_err(|e| Error::new(wanted, format!("rustup does not run: {e}"), by_hand()))?;
    if !outcome.status.success() {
        return Err(Error::new(wanted, format!("rustup failed:\n{}\n", outcome.tail(3)), by_hand()));
    }
    progress.done(&format!("{wanted} is there"));
    Ok(())
}

/// The program of a Cargo subcommand at a pinned version: the one on the PATH when it is that version, else one installed
/// into the cache by `cargo install --locked`, which compiles it and takes some minutes.
///
/// # Errors
/// It does not compile, or crates cannot be fetched.
pub fn cargo_program(name: &str, version: &str, progress: &dyn Progress) -> Result<PathBuf> {
    let is_it = |path: &Path| {
        process::run(Command::new(path).arg("--version"), |_| {}).is_ok_and(|outcome| {
            outcome.status.success() && outcome.stdout.split_whitespace().any(|word| word == version)
        })
    };
    if let Some(found) = on_path(name).filter(|path| is_it(path)) {
        return Ok(found);
    }
    let item = format!("{name}-{version}");
    let folder = cache::cache_dir()?.join(&item);
    let program = folder.join("bin").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    if program.is_file() {
        return Ok(program);
    }
    let held = cache::lock(&item, progress)?;
    if program.is_file() {
        return Ok(program);
    }
    progress.start(&format!("compiling {name} {version} (cargo install; some minutes, once)"));
    let scratch = cache::scratch(&item, &held)?;
    let mut command = Command::new(cargo());
    command
        .args(["install", "--locked", "--no-track", "--version", version, name, "--root", text(&scratch)?])
        // Without optimisation it compiles in half of the time, and checks this workspace in two seconds.
        .args(["--debug", "--config", "profile.dev.debug=false"])
        // A folder outside the repository, whose configuration, flags and target folder do not apply to this crate.
        .current_dir(&scratch)
        .env("CARGO_TARGET_DIR", scratch.join("target"))
        .env_remove("RUSTFLAGS");
    let outcome = process::run(&mut command, |line| progress.detail(line))
        .map_err(|e| Error::new(&item, format!("cargo does not run: {e}"), "Install Rust with rustup (rustup.rs)"))?;
    if !outcome.status.success() {
        let cause = format!("cargo install failed:\n{}\n", outcome.tail(6));
        return Err(Error::new(&item, cause, format!("Mend that, or install it by hand: cargo install {name}")));
    }
    cache::remove(&scratch.join("target"))?;
    cache::publish(&scratch, &folder)?;
    progress.done(&format!("{name} {version}: {}", program.display()));
    Ok(program)
}

/// The cargo that runs us, else the one on the PATH.
pub fn cargo() -> PathBuf {
    std::env::var_os("CARGO").map_or_else(|| PathBuf::from("cargo"), PathBuf::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_on_the_path_are_found_and_others_are_not() {
        assert!(on_path("cargo").is_some());
        assert!(on_path("no-such-program-of-ours").is_none());
    }

    #[test]
    fn zig_versions_agree() {
        assert!(ZIG_PACKAGES.lines().any(|line| line == format!("ziglang=={ZIG}")));
    }

    #[test]
    fn a_missing_toolchain_has_no_version() {
        assert!(version_line("no-such-toolchain-of-ours").is_none());
    }
}
