//! Builds the lab in steps that each run once, so that an interrupted build resumes with the step it was at.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::{OVERLAY, PACKAGES, PREFIX, RELEASE, WANTED, WINE, isolated_command};
use crate::{Error, Progress, Result, cache, process, tools};

/// Files in Debian that are replaced, and their names in the build folder.
const REPLACED: [(&str, &str); 2] = [
    ("usr/lib/x86_64-linux-gnu/wine/x86_64-windows/wined3d.dll", "root/wined3d.dll"),
    ("usr/lib/wine/wineserver64", "root/wineserver64"),
];

/// Variable that names a Debian mirror if apt knows none, as on other distributions.
const MIRROR_VARIABLE: &str = "CAIRN_DEBIAN_MIRROR";

/// Builds the lab in `folder`, whose lock the caller holds.
pub(super) fn build(folder: &Path, progress: &dyn Progress) -> Result<()> {
    let (root, build_root, archives) = (folder.join("root"), folder.join("workshop"), folder.join("archives"));
    for folder in ["run", "archives", "steps"].map(|name| folder.join(name)) {
        fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, &e))?;
    }
    let steps = BuildSteps { folder, progress };
    steps.once("1-debian", "fetching a small Debian", || {
        cache::remove(&root)?;
        let (bootstrap, mirror) = (tools::debootstrap(progress)?, mirror(progress)?);
        let mut command = isolated_command();
        command.arg(bootstrap).args(["--variant=minbase", "--include=ca-certificates"]);
        command.arg(format!("--cache-dir={}", archives.display())).arg(RELEASE).arg(&root).arg(mirror);
        steps.run(&mut command)?;
        fs::write(root.join("etc/apt/apt.conf.d/90machine"), apt_settings()).map_err(|e| Error::io(&root, &e))
    })?;
    // Compilers are installed into a copy that is thrown away, so that the lab itself stays small.
    steps.once("2-workshop", "copying it for the compilers", || {
        cache::remove(&build_root)?;
        steps.run(Command::new("cp").arg("-a").args([&root, &build_root])).map(drop)
    })?;
    steps.once("3-packages", "installing Wine and a software Vulkan driver", || {
        steps.run(&mut in_debian(&root, PACKAGES, &[])).map(drop)
    })?;
    steps.once("4-wine", "compiling two parts of Wine from Debian's source", || {
        let version = steps.run(&mut in_debian(&root, "dpkg-query -W -f '${source:Version}' wine", &[]))?;
        steps.run(&mut in_debian(&build_root, WINE, &[version.trim()]))?;
        for (theirs, ours) in REPLACED {
            let theirs = root.join(theirs);
            // The file must exist already: Wine would not load the copy from another path.
            fs::metadata(&theirs).map_err(|e| Error::io(&theirs, &e))?;
            fs::copy(build_root.join(ours), &theirs).map_err(|e| Error::io(&theirs, &e))?;
        }
        Ok(())
    })?;
    steps
        .once("5-windows", "letting Wine make a Windows", || steps.run(&mut in_debian(&root, PREFIX, &[])).map(drop))?;
    cache::remove(&build_root)?;
    cache::remove(&archives)
}

/// Copies something from packages of the Debian of the lab in `folder` into the folder `to`, as `script` does.
pub(super) fn copy_from_packages(script: &str, folder: &Path, to: &Path, progress: &dyn Progress) -> Result<()> {
    let mut command = isolated_command();
    command.args(["sh", "-euc", &format!("{OVERLAY}{script}"), "sh"]).args([folder, to]);
    BuildSteps { folder, progress }.run(clean(&mut command)).map(drop)
}

/// The steps of one build.
struct BuildSteps<'a> {
    folder: &'a Path,
    progress: &'a dyn Progress,
}

impl BuildSteps<'_> {
    /// Runs a step unless an earlier build has completed it.
    fn once(&self, name: &str, what: &str, act: impl FnOnce() -> Result<()>) -> Result<()> {
        let done = self.folder.join("steps").join(name);
        if done.is_file() {
            return Ok(());
        }
        self.progress.start(&format!("the lab: {what}"));
        act()?;
        fs::write(&done, "").map_err(|e| Error::io(&done, &e))?;
        self.progress.done(&format!("the lab: {what}: done"));
        Ok(())
    }

    /// Runs a command of a step; returns its output.
    fn run(&self, command: &mut Command) -> Result<String> {
        let outcome = process::run(command, |line| self.progress.detail(&line.chars().take(60).collect::<String>()))
            .map_err(|e| Error::io(Path::new(command.get_program()), &e))?;
        if outcome.status.success() {
            return Ok(outcome.stdout);
        }
        let cause = format!("a step ended with {}:\n{}\n", outcome.status, outcome.tail(12));
        Err(Error::new(WANTED, cause, "Mend what it names and run the command again: it goes on where it was"))
    }
}

/// A shell script run in the Debian at `root`, with its arguments.
fn in_debian(root: &Path, script: &str, arguments: &[&str]) -> Command {
    const MOUNTS: &str =
        "mount -t proc proc \"$0/proc\"; mount --rbind /dev \"$0/dev\"; exec chroot \"$0\" sh -euc \"$@\"";
    let mut command = isolated_command();
    command.args(["sh", "-euc", MOUNTS]).arg(root).args([script, "sh"]).args(arguments);
    clean(&mut command);
    command
}

/// Gives a command the environment variables of the Debian, where the user's do not apply.
fn clean(command: &mut Command) -> &mut Command {
    command.env("PATH", "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin").env("HOME", "/root");
    for name in ["LD_PRELOAD", "LD_LIBRARY_PATH", "MAKEFLAGS", "CFLAGS", "CROSSCFLAGS", "CC", "CROSSCC", "TMPDIR"] {
        command.env_remove(name);
    }
    command.env("LC_ALL", "C.UTF-8")
}

/// The Debian mirror that the machine's own apt uses, else the one of `CAIRN_DEBIAN_MIRROR`.
pub(super) fn mirror(progress: &dyn Progress) -> Result<String> {
    if let Some(own) = std::env::var_os(MIRROR_VARIABLE).filter(|value| !value.is_empty()) {
        return Ok(own.to_string_lossy().into_owned());
    }
    // `None` also where there is no apt.
    let mirror_of_apt = || {
        let mut command = Command::new("apt-get");
        command.args([
            "indextargets",
            "--format",
            "$(ORIGIN) $(LABEL) $(COMPONENT) $(REPO_URI)",
            "Created-By: Packages",
        ]);
        process::run(&mut command, |_| {}).ok().and_then(|outcome| debian_mirror(&outcome.stdout))
    };
    if let Some(found) = mirror_of_apt() {
        return Ok(found);
    }
    // apt knows the origins only after it has fetched the lists.
    tools::update_apt_lists(progress)?;
    mirror_of_apt().ok_or_else(|| {
        let remedy = format!("Set {MIRROR_VARIABLE} to the address of a Debian mirror");
        Error::new(WANTED, "the machine has no apt that knows a Debian mirror", remedy)
    })
}

/// The address of Debian's main archive among apt's index targets.
fn debian_mirror(targets: &str) -> Option<String> {
    targets.lines().find_map(|line| line.strip_prefix("Debian Debian main ").map(|uri| uri.trim().to_owned()))
}

/// The machine's apt settings that a Debian inside it needs to reach the same mirror; empty where there is no apt.
fn apt_settings() -> String {
    let mut command = Command::new("apt-config");
    command.args(["dump", "--format", "%F \"%v\";%n", "Acquire"]);
    let Ok(outcome) = process::run(&mut command, |_| {}) else { return String::new() };
    let wanted = |line: &&str| ["Proxy", "Check-Valid-Until", "Retries"].iter().any(|word| line.contains(word));
    outcome.stdout.lines().filter(wanted).map(|line| format!("{line}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_main_archive_is_recognised() {
        let targets = "Debian Debian-Security main http://a/debian-security/\nOther Other main http://b/\n\
                       Debian Debian contrib http://c/debian/\nDebian Debian main http://d/debian/\n";
        assert_eq!(debian_mirror(targets).as_deref(), Some("http://d/debian/"));
        assert_eq!(debian_mirror("Ubuntu Ubuntu main http://e/ubuntu/\n"), None);
    }
}
