//! Python wheels: writing twice gives the same bytes, they contain what they list, pip accepts them on matching platforms only, and they
//! run in otherwise empty environments, also in the lab.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use provision::{Console, tools, wheels};

use super::Context;
use super::abi;
use super::csharp;
use super::dist::fresh;
use super::lab;
use super::python;
use super::tally::{Skip, Tally};
use crate::dist::{self, PackedFile, Parts, Platform, Source};
use crate::shell::Log;

/// Folder of the wheels' programs and tests.
const FOLDER: &str = "bindings/python";
const PROGRAMS: &str = "bindings/python/wheel";

/// Folder of the environments: its name has a space and a letter that is not Latin.
const ENVIRONMENTS: &str = "a folder Ж";

/// pip's platform names, and whether the Linux wheel fits.
const LINUXES: [(&str, bool); 4] = [
    ("manylinux_2_28_x86_64", true),
    ("manylinux2014_x86_64", false),
    ("manylinux_2_28_aarch64", false),
    ("musllinux_1_2_x86_64", false),
];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        let reason = "needs linux: they are made on Linux on x86-64".to_owned();
        tally.skips.push(Skip { name: "wheels".to_owned(), reason });
        return Ok(tally);
    }
    if let Some(skip) = lab::skip_without_mingw("wheels")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    context.build_programs(log)?;
    context.build_for_windows(log)?;
    let work = fresh(context, "wheels")?;
    let make = |name| {
        let platforms = [Platform::Windows, Platform::Linux];
        dist::make(context.workspace, &platforms, Parts::Wheels, Source::Tests, &work.join(name))
    };
    let (first, second) = (make("first")?, make("second")?);
    for (one, other) in first.iter().zip(second) {
        let differs = one.sha256 != other.sha256;
        tally.check(differs.then(|| format!("{} is another file the second time", one.path.display())));
    }
    check(context, log, &work, &first.iter().collect::<Vec<_>>(), &mut tally)?;
    Ok(tally)
}

/// Checks a Windows and a Linux wheel.
pub(super) fn check(
    context: &Context<'_>,
    log: &mut Log,
    work: &Path,
    made: &[&PackedFile],
    tally: &mut Tally,
) -> Result<(), String> {
    let [windows, linux] = made else {
        return Err(format!("{} wheels were made, not two", made.len()));
    };
    let tests = WheelTests { context, work };
    tests.contents(log, &linux.path, tally)?;
    tests.audit(log, &linux.path, tally)?;
    tests.fits(&windows.path, &linux.path, tally)?;
    let stand_ins = work.join("stand-ins");
    let python = wheels::install(&linux.path, &work.join(ENVIRONMENTS).join("env"), &Console::new());
    match python {
        Ok(python) => tests.on_linux(log, &python, &stand_ins.join("linux"), tally)?,
        Err(why) => tally.failures.push(format!("pip does not install the Linux wheel: {why}")),
    }
    match lab::skip_unless_possible("the Windows wheel")? {
        Some(skip) => tally.skips.push(skip),
        None => tests.on_windows(log, &windows.path, &stand_ins.join("windows"), tally)?,
    }
    Ok(())
}

struct WheelTests<'a> {
    context: &'a Context<'a>,
    work: &'a Path,
}

impl WheelTests<'_> {
    /// Compares the wheel's files with its list, and with setuptools' wheel of the package.
    fn contents(&self, log: &mut Log, wheel: &Path, tally: &mut Tally) -> Result<(), String> {
        let built = self.work.join("built");
        let built = provision::build_package(&built).map_err(|e| e.to_string())?;
        let mut command = Command::new(self.context.python()?);
        command.env("CAIRN_WHEELS", wheel.with_file_name("")).env("CAIRN_BUILT", built);
        command.env("PYTHONPATH", provision::python_path());
        tally.add(python::pytest(self.context, log, command, FOLDER, ("bindings-python-wheel", &["wheel"]))?);
        Ok(())
    }

    /// The system requirements of the Linux wheel's library, by auditwheel.
    fn audit(&self, log: &mut Log, wheel: &Path, tally: &mut Tally) -> Result<(), String> {
        let python = wheels::audit_env(&Console::new()).map_err(|e| e.to_string())?;
        let ended = log.run(Command::new(python).args(["-m", "auditwheel", "show"]).arg(wheel))?;
        let flat: Vec<_> = ended.output.split_whitespace().collect();
        let right = ended.success && flat.join(" ").contains("platform tag: \"manylinux_2_28_x86_64\"");
        tally.check((!right).then(|| "auditwheel does not say manylinux_2_28_x86_64 of the Linux wheel".to_owned()));
        Ok(())
    }

    /// Which platforms pip accepts the wheels for.
    fn fits(&self, windows: &Path, linux: &Path, tally: &mut Tally) -> Result<(), String> {
        let cases = LINUXES.map(|(platform, right)| (linux, platform, right));
        let others = [(linux, "win_amd64", false), (windows, "win_amd64", true), (windows, "win_arm64", false)];
        for (wheel, platform, right) in cases.into_iter().chain(others) {
            let accepted = wheels::fits(wheel, platform, &self.work.join("fits"), &Console::new());
            let accepted = accepted.map_err(|e| e.to_string())?;
            let verb = if accepted { "takes" } else { "refuses" };
            tally.check((accepted != right).then(|| format!("pip {verb} {} for {platform}", wheel.display())));
        }
        Ok(())
    }

    /// A program of ours that uses an installed wheel, run in an empty folder, without our environment variables.
    fn program(&self, mut python: Command, name: &str, folder: &Path) -> Result<Command, String> {
        fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        python.arg(self.context.workspace.root.join(PROGRAMS).join(name)).arg(folder).current_dir(folder);
        for variable in ["CAIRN_LIBRARY", "CAIRN_ONNXRUNTIME", "PYTHONPATH"] {
            python.env_remove(variable);
        }
        python.env("PYTHONDONTWRITEBYTECODE", "1");
        Ok(python)
    }

    fn on_linux(&self, log: &mut Log, python: &Path, stand_ins: &Path, tally: &mut Tally) -> Result<(), String> {
        self.stand_ins(log, &|| Command::new("cc"), "so", stand_ins)?;
        let folder = self.work.join(ENVIRONMENTS);
        // The cache must not help either, so it is empty. The lab has another cache anyway; this machine's contains the lab itself.
        let no_cache = folder.join("no cache");
        let mut walk = self.program(Command::new(python), "walk.py", &folder.join("walk"))?;
        walk.env("CAIRN_CACHE_DIR", &no_cache);
        abi::count("the Linux wheel", &log.run(&mut walk)?, tally);
        let mut wrong = self.program(Command::new(python), "wrong.py", &folder.join("wrong"))?;
        abi::count("what the Linux wheel says", &log.run(wrong.arg(stand_ins))?, tally);
        let mut doctor = Command::new(python);
        doctor.args(["-m", "cairn", "doctor"]).current_dir(&folder).env_remove("CAIRN_LIBRARY");
        doctor.env_remove("CAIRN_ONNXRUNTIME").env_remove("PYTHONPATH").env("CAIRN_CACHE_DIR", &no_cache);
        let ended = log.run(&mut doctor)?;
        let well = ended.success && ended.output.contains("All is well.");
        tally.test((!well).then(|| "the doctor of the Linux wheel finds something".to_owned()));
        Ok(())
    }

    /// Libraries that differ from Cairn in one respect each.
    fn stand_ins(
        &self,
        log: &mut Log,
        compiler: &dyn Fn() -> Command,
        ending: &str,
        into: &Path,
    ) -> Result<(), String> {
        fs::create_dir_all(into).map_err(|e| format!("{}: {e}", into.display()))?;
        csharp::make_stand_ins(log, &self.context.workspace.root, compiler, ending, into)
    }

    /// Python for Windows with the wheel, in the lab.
    fn on_windows(&self, log: &mut Log, wheel: &Path, stand_ins: &Path, tally: &mut Tally) -> Result<(), String> {
        let console = Console::new();
        let python = wheels::windows_python(&console).map_err(|e| e.to_string())?;
        let site = self.work.join(ENVIRONMENTS).join("site");
        wheels::unpack_for_windows(wheel, &site, &console).map_err(|e| e.to_string())?;
        let program = self.windows_environment(&python, &site)?;
        let compiler = tools::mingw_compiler(false, &console).map_err(|e| e.to_string())?;
        let start = || {
            let mut command = Command::new(&compiler.program);
            command.args(compiler.first);
            command
        };
        self.stand_ins(log, &start, "dll", stand_ins)?;
        let folder = self.work.join(ENVIRONMENTS);
        let lab = |name, into: &str| self.program(lab::with_empty_environment(&program)?, name, &folder.join(into));
        let began = Instant::now();
        abi::count("the Windows wheel", &log.run(&mut lab("walk.py", "walk-windows")?)?, tally);
        log.line(&format!("the Windows wheel: started, shown and ended in {:.1} s", began.elapsed().as_secs_f64()))?;
        let mut wrong = lab("wrong.py", "wrong-windows")?;
        abi::count("what the Windows wheel says", &log.run(wrong.arg(stand_ins))?, tally);
        Ok(())
    }

    /// A Python for Windows that finds the packages of `site`, as an environment does; returns its program.
    fn windows_environment(&self, python: &wheels::WindowsPython, site: &Path) -> Result<PathBuf, String> {
        let from = python.program.with_file_name("");
        let into = self.work.join(ENVIRONMENTS).join("python");
        fs::create_dir_all(&into).map_err(|e| format!("{}: {e}", into.display()))?;
        for entry in fs::read_dir(&from).map_err(|e| format!("{}: {e}", from.display()))? {
            let entry = entry.map_err(|e| format!("{}: {e}", from.display()))?;
            let copy = into.join(entry.file_name());
            fs::copy(entry.path(), &copy).map_err(|e| format!("{}: {e}", copy.display()))?;
        }
        let paths = into.join("python312._pth");
        let text = [lab::windows_path(site), lab::windows_path(&python.packages)]
            .map(|path| path.display().to_string())
            .join("\r\n");
        let text = format!("python312.zip\r\n.\r\n{text}\r\n");
        fs::write(&paths, text).map_err(|e| format!("{}: {e}", paths.display()))?;
        Ok(into.join("python.exe"))
    }
}
