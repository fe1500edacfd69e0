//! Mono: a C# compiler and a runtime.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::{Error, Progress, Result, cache, process, tools};

const WANTED: &str = "Mono, which compiles and runs C#";

/// The packages to install; apt adds their dependencies.
const PACKAGES: [&str; 2] = ["mono-mcs", "mono-runtime"];

/// An installed Mono.
#[derive(Debug, Clone)]
pub struct Mono {
    /// Folder of its unpacked packages; `None` for the machine's own Mono.
    unpacked: Option<PathBuf>,
}

impl Mono {
    /// The compiler's command; the caller adds arguments.
    pub fn compiler(&self) -> Command {
        match &self.unpacked {
            None => Command::new("mcs"),
            Some(root) => {
                let mut command = self.program();
                command.arg(root.join(COMPILER));
                command
            }
        }
    }

    /// A command that runs a C# program; the caller adds the program's file and arguments.
    pub fn program(&self) -> Command {
        let mut command = match &self.unpacked {
            None => Command::new("mono"),
            Some(root) => {
                // It finds its assemblies relative to its own path; the other paths are passed here.
                let mut command = Command::new(root.join(RUNTIME));
                command.env("MONO_CFG_DIR", root.join("etc"));
                let libraries = fs::read_dir(root.join("usr/lib")).into_iter().flatten().flatten();
                let triplet =
                    libraries.map(|entry| entry.path()).find(|path| path.to_string_lossy().contains("-linux-"));
                if let Some(folder) = triplet {
                    command.env("LD_LIBRARY_PATH", folder);
                }
                command
            }
        };
        // In another locale file names may have Latin letters only.
        command.env("LC_ALL", "C.UTF-8");
        command
    }
}

const RUNTIME: &str = "usr/bin/mono-sgen";
const COMPILER: &str = "usr/lib/mono/4.5/mcs.exe";

/// Mono from the PATH, else Debian's packages (7 MB) by the machine's own apt, unpacked in the cache: nothing is installed, and root is
/// not needed where apt has its lists.
///
/// # Errors
/// No apt that has Mono, or an unreachable mirror.
pub fn mono(progress: &dyn Progress) -> Result<Mono> {
    if tools::on_path("mono").is_some() && tools::on_path("mcs").is_some() {
        return Ok(Mono { unpacked: None });
    }
    let fail = |cause: String| {
        Error::new(WANTED, cause, "Install it by hand, so that mono and mcs are on the PATH (apt install mono-mcs)")
    };
    for program in ["apt-get", "apt-cache", "dpkg-deb"] {
        if tools::on_path(program).is_none() {
            return Err(fail(format!("there is no {program} here")));
        }
    }
    let mut version = candidate();
    if version.is_none() {
        // apt knows the version only after it has fetched the lists, for which it needs root.
        progress.start("asking apt for Mono");
        tools::update_apt_lists(progress)?;
        version = candidate();
    }
    let version = version.ok_or_else(|| fail("the machine's apt has no package mono-mcs".to_owned()))?;
    let item = format!("mono-{}", version.replace(|c: char| !(c.is_alphanumeric() || ".+-".contains(c)), "-"));
    let folder = cache::cache_dir()?.join(&item);
    let found = || Mono { unpacked: Some(folder.clone()) };
    if folder.is_dir() {
        return Ok(found());
    }
    let held = cache::lock(&item, progress)?;
    if folder.is_dir() {
        return Ok(found());
    }
    progress.start(&format!("fetching Mono {version} (7 MB of Debian packages)"));
    let scratch = cache::scratch(&item, &held)?;
    let (archives, root) = (scratch.join("archives"), scratch.join("root"));
    for folder in [&archives, &root] {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
    }
    let mut command = Command::new("apt-get");
    command.args(["download", "-q"]).args(packages_to_unpack().map_err(&fail)?).current_dir(&archives);
    run(&mut command, progress).map_err(&fail)?;
    for entry in fs::read_dir(&archives).map_err(|e| Error::io(&archives, &e))? {
        let archive = entry.map_err(|e| Error::io(&archives, &e))?.path();
        run(Command::new("dpkg-deb").arg("-x").arg(&archive).arg(&root), progress).map_err(&fail)?;
    }
    if let Some(missing) = [RUNTIME, COMPILER].into_iter().find(|file| !root.join(file).is_file()) {
        return Err(fail(format!("the packages of version {version} have no {missing}")));
    }
    cache::publish(&root, &folder)?;
    cache::remove(&scratch)?;
    progress.done(&format!("Mono {version}: {}", folder.display()));
    Ok(found())
}

/// The version that apt would install.
fn candidate() -> Option<String> {
    let outcome =
        process::run(Command::new("apt-cache").args(["policy", PACKAGES[0]]).env("LC_ALL", "C"), |_| {}).ok()?;
    candidate_of(&outcome.stdout)
}

fn candidate_of(policy: &str) -> Option<String> {
    let version = policy.lines().find_map(|line| line.trim().strip_prefix("Candidate: "))?;
    (version != "(none)").then(|| version.to_owned())
}

/// The packages to unpack: Mono's own even if installed, and their dependencies that the machine lacks.
fn packages_to_unpack() -> std::result::Result<Vec<String>, String> {
    let simulated = |state: &[&str]| {
        let mut command = Command::new("apt-get");
        command.args(["install", "--simulate", "-q", "--no-install-recommends"]).args(state).args(PACKAGES);
        let outcome = process::run(command.env("LC_ALL", "C"), |_| {}).map_err(|e| format!("apt-get: {e}"))?;
        if outcome.status.success() { Ok(installs(&outcome.stdout)) } else { Err(outcome.tail(4)) }
    };
    let mut packages = simulated(&["-o", "Dir::State::status=/dev/null"])?;
    packages.retain(|package| package.starts_with("mono-") || package.starts_with("libmono-"));
    for package in simulated(&[])? {
        if !packages.contains(&package) {
            packages.push(package);
        }
    }
    Ok(packages)
}

/// `NAME=VERSION` of each package that a simulated apt run would install.
fn installs(output: &str) -> Vec<String> {
    let package = |line: &str| {
        let (name, rest) = line.strip_prefix("Inst ")?.split_once(" ")?;
        // The installed version is in brackets, the new one in parentheses.
        let version = rest.split_once('(')?.1.split([' ', ')']).next()?;
        Some(format!("{name}={version}"))
    };
    output.lines().filter_map(package).collect()
}

fn run(command: &mut Command, progress: &dyn Progress) -> std::result::Result<(), String> {
    let name = Path::new(command.get_program()).display().to_string();
    let outcome = process::run(command, |line| progress.detail(line)).map_err(|e| format!("{name}: {e}"))?;
    if outcome.status.success() { Ok(()) } else { Err(format!("{name} failed:\n{}\n", outcome.tail(4))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_from_apt_output() {
        let policy = "mono-mcs:\n  Installed: (none)\n  Candidate: 6.8.0+dfsg-3\n  Version table:\n";
        assert_eq!(candidate_of(policy).as_deref(), Some("6.8.0+dfsg-3"));
        assert_eq!(candidate_of("mono-mcs:\n  Installed: (none)\n  Candidate: (none)\n"), None);
        assert_eq!(candidate_of(""), None);
        let simulated = "Inst mono-mcs (6.8-3 Debian:12/stable [all])\nInst zlib1g [1.1] (1:1.2 Debian:12/stable [amd64]) []\n\
                         Conf mono-mcs (6.8-3 Debian:12/stable [all])\n";
        assert_eq!(installs(simulated), ["mono-mcs=6.8-3", "zlib1g=1:1.2"]);
    }
}
