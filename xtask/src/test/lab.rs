//! Windows programs in the lab, or on Windows itself: what `lab run` passes through, for Linux programs too, Direct3D 12, and ONNX
//! Runtime with DirectML.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use provision::{Console, tools};

use super::Context;
use super::abi;
use super::amd::Amd;
use super::tally::{Skip, Tally};
use super::{recorder, windows_build};
use crate::dist::MINGW_NOTICES;
use crate::shell::Log;

/// Time limit for a program to start and, after its end was requested, to exit.
const TIMEOUT: Duration = Duration::from_secs(120);

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = skip_unless_possible("everything of Windows: its own tests, Direct3D 12, DirectML")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    if !cfg!(windows) {
        check_pass_through(context, log, &mut tally)?;
    }
    context.with_and_without_amd(&mut tally, |amd| own_tests(context, log, amd))?;
    tally.add(host_tests(context, log)?);
    tally.add(abi::run_on_windows(context, log)?);
    Ok(tally)
}

/// The command that runs a program in the lab, or natively on Windows.
pub(super) fn lab_run() -> Result<Command, String> {
    // A build of the workspace may have replaced this program's file since it started; Linux keeps the running one as
    // `/proc/PID/exe`.
    let own = if cfg!(target_os = "linux") {
        PathBuf::from(format!("/proc/{}/exe", std::process::id()))
    } else {
        std::env::current_exe().map_err(|e| format!("our own program: {e}"))?
    };
    let mut command = Command::new(own);
    command.args(["lab", "run"]);
    Ok(command)
}

/// The library's tests of Direct3D 12 and DirectML, and the plugin's in the Unity test host, built for Windows.
fn own_tests(context: &Context<'_>, log: &mut Log, amd: &Amd) -> Result<Tally, String> {
    let mut command = context.windows_tests(own_programs(amd), log)?;
    context.provide_windows_worlds(&mut command)?;
    amd.provide(&mut command);
    // Folder of the test programs, where the plugin linked into two of them looks for AMD's libraries.
    let programs = context.windows_programs().join("deps");
    fs::create_dir_all(&programs).map_err(|e| format!("{}: {e}", programs.display()))?;
    let mut in_unity = context.windows_tests([IN_UNITY], log)?;
    context.provide_windows_worlds(&mut in_unity)?;
    amd.provide(&mut in_unity);
    if let Amd::None = amd {
        windows_build::copy_descriptors(&mut in_unity);
    }
    in_unity.arg("--");
    amd.beside(&programs, || {
        let mut tally = windows_build::run(&mut command, &[], log)?;
        tally.add(recorder::run_tests(context, log, &mut in_unity, &[IN_UNITY], amd)?);
        Ok(tally)
    })
}

/// Programs that run here with AMD's own libraries only, and else in the thorough part `recorder-all`: they load a world for each test.
const RECORDED_WHEN_THOROUGH: [&str; 2] = ["d3d12_memory", "d3d12_residency"];

/// Their programs. Without AMD's libraries, those that the runner `recorder` always runs are not run a second time.
fn own_programs(amd: &Amd) -> Vec<&'static str> {
    let is_own = matches!(amd, Amd::Own(_));
    let with_recorder = recorder::short().filter(|_| is_own);
    let own = recorder::LONG.into_iter().filter(|program| is_own || !RECORDED_WHEN_THOROUGH.contains(program));
    let programs = own.chain(["d3d12_hostile", "hostile"]).chain(with_recorder);
    programs.filter(|program| *program != "recorder").collect()
}

/// The plugin's tests in Unity's test double, which uses the rules of the recorder of Direct3D's calls.
const IN_UNITY: &str = "host";
/// Tests of a host that need no choice among AMD's libraries: unloading, callbacks, and the recorded order of locks.
fn host_tests(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut command = context.windows_tests(["unload", "callbacks", "lock_order", "order"], log)?;
    context.provide_windows_worlds(&mut command)?;
    Amd::None.provide(&mut command);
    windows_build::run(&mut command, &[], log)
}

/// A command that runs a program as [`lab_run`] does, with only Windows' own variables in its environment.
pub(super) fn with_empty_environment(program: &Path) -> Result<Command, String> {
    let mut command = crate::lab::command(program)?;
    let own: Vec<_> =
        command.get_envs().filter_map(|(name, value)| Some((name.to_owned(), value?.to_owned()))).collect();
    command.env_clear().envs(own);
    // Variables that starting the lab, or Windows, requires.
    for name in if cfg!(windows) { ["SystemRoot", "SystemDrive"] } else { ["PATH", "TERM"] } {
        if let Some(value) = std::env::var_os(name) {
            command.env(name, value);
        }
    }
    Ok(command)
}

/// A path of this machine as programs in the lab, or on Windows, see it.
pub(super) fn windows_path(path: &Path) -> PathBuf {
    if cfg!(windows) {
        return path.to_owned();
    }
    // The lab maps the machine's root to this drive.
    format!("Z:{}", path.display().to_string().replace('/', "\\")).into()
}

/// Puts Microsoft's libraries into a folder, where a program or our library looks for them first.
pub(super) fn install_runtime(folder: &Path) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    let library = provision::onnxruntime_for_windows(&Console::new()).map_err(|e| e.to_string())?;
    fs::create_dir_all(folder).map_err(failed)?;
    for name in ["onnxruntime.dll", "DirectML.dll"] {
        let (from, to) = (library.with_file_name(name), folder.join(name));
        let size = |path: &Path| fs::metadata(path).map(|file| file.len()).ok();
        if size(&to).is_some() && size(&to) == size(&from) {
            continue;
        }
        _ = fs::remove_file(&to);
        // A hard link takes no space; not every file system has them.
        if fs::hard_link(&from, &to).is_err() {
            fs::copy(&from, &to).map_err(failed)?;
        }
    }
    Ok(())
}

/// Numbers of create-destroy cycles of a device, and of a world, in the long run.
const DEVICES: &str = "1000";
const WORLDS: &str = "20";
/// The tests that run them.
const DEVICE_CYCLES: &str = "devices_leak_no_more_than_the_same_system_calls_without_cairn";
const WORLD_CYCLES: &str = "loading_worlds_repeatedly_uses_constant_memory";

pub(super) fn run_device_cycles(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_cycles(context, log, DEVICE_CYCLES)
}

pub(super) fn run_world_cycles(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    run_cycles(context, log, WORLD_CYCLES)
}

fn run_cycles(context: &Context<'_>, log: &mut Log, test: &str) -> Result<Tally, String> {
    if let Some(skip) = skip_unless_possible("lives of devices and worlds on Direct3D 12")? {
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    }
    let mut command = context.windows_tests(["d3d12_lifecycle"], log)?;
    command.args(["--", "--exact", test]);
    context.provide_windows_worlds(&mut command)?;
    command.env("CAIRN_DEVICE_CYCLES", DEVICES).env("CAIRN_WORLD_CYCLES", WORLDS);
    windows_build::run(&mut command, &[test], log)
}

/// Makes a complete cargo command build for Windows and run the programs in the lab.
pub(crate) fn for_windows(command: &mut Command) -> Result<(), String> {
    if cfg!(windows) {
        return Ok(());
    }
    let console = Console::new();
    tools::rust_target(tools::WINDOWS_TARGET, &console).map_err(|e| e.to_string())?;
    if tools::mingw(&console).map_err(|e| e.to_string())? != tools::Mingw::Gcc {
        return Err(
            "MinGW-w64's GCC is needed to link programs for the lab: apt install gcc-mingw-w64-x86-64".to_owned()
        );
    }
    command.args(["--target", tools::WINDOWS_TARGET]);
    run_in_lab(command, tools::WINDOWS_TARGET)
}

/// A skip with its reason if this machine cannot link or pack everything for Windows: zig links only the shipped DLLs, and archives and
/// wheels contain MinGW-w64's notices, which are read where Debian's package has them.
pub(super) fn skip_without_mingw(what: &str) -> Result<Option<Skip>, String> {
    let has_gcc = tools::mingw(&Console::new()).map_err(|e| e.to_string())? == tools::Mingw::Gcc;
    let reason = match (has_gcc, Path::new(MINGW_NOTICES).is_file()) {
        (true, true) => return Ok(None),
        (false, _) => "needs mingw: apt install gcc-mingw-w64-x86-64".to_owned(),
        (true, false) => {
            format!("needs mingw of Debian or Ubuntu: there is no {MINGW_NOTICES}: apt install mingw-w64-common")
        }
    };
    Ok(Some(Skip { name: what.to_owned(), reason }))
}

/// Makes a cargo command run this target's programs in the lab.
pub(super) fn run_in_lab(command: &mut Command, target: &str) -> Result<(), String> {
    let runner = lab_run()?;
    let words: Vec<_> = std::iter::once(runner.get_program()).chain(runner.get_args()).map(quoted).collect();
    command.args(["--config", &format!("target.{target}.runner=[{}]", words.join(","))]);
    Ok(())
}

/// Builds the lab if it is missing; returns a skip with its reason if this machine cannot have the lab.
pub(super) fn skip_unless_possible(what: &str) -> Result<Option<Skip>, String> {
    if cfg!(windows) {
        return Ok(None);
    }
    if let Err(why) = provision::lab::possible() {
        return Ok(Some(Skip { name: what.to_owned(), reason: format!("needs lab: {why}") }));
    }
    provision::lab::lab(&Console::new()).map_err(|e| e.to_string())?;
    Ok(None)
}

/// A TOML string.
fn quoted(word: &std::ffi::OsStr) -> String {
    format!("\"{}\"", word.to_string_lossy().replace('\\', "\\\\").replace('"', "\\\""))
}

/// Tests that arguments, streams, variables, the working directory, paths and exit statuses pass through the lab, and that a run leaves no
/// process and no mount behind. Most cases run a Windows program, some a Linux program.
fn check_pass_through(context: &Context<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let folder = context.workspace.target.join("xtask").join("lab").join("a folder");
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let program = folder.join("echo.exe");
    tools::rust_target(tools::WINDOWS_TARGET, &Console::new()).map_err(|e| e.to_string())?;
    let mut rustc = Command::new("rustc");
    rustc.args(["--edition=2024", "--target", tools::WINDOWS_TARGET, "-o"]).arg(&program);
    if !log.run(rustc.arg("tests/lab/echo.rs").current_dir(&context.workspace.root))?.success {
        return Err("the program that tells what it was given does not build".to_owned());
    }
    let echo = Echo { program, folder };
    let before = mounts()?;
    for (what, found, expected) in [
        (
            "arguments",
            echo.run(&["arguments", "", "two words", "a\"b\\", "--help", "ä€"], b"")?,
            EchoOutput::new(0, "\ntwo words\na\"b\\\n--help\nä€\n", ""),
        ),
        (
            "both streams, byte for byte",
            echo.run(&["copy"], b"\x00\xff\r\n\n\x1a")?,
            EchoOutput { status: Some(0), out: b"\x00\xff\r\n\n\x1a".to_vec(), err: b"6 bytes".to_vec() },
        ),
        ("a variable", echo.run(&["variable", "CAIRN_ECHO"], b"")?, EchoOutput::new(0, "a value\n", "")),
        (
            "the working directory",
            echo.run(&["folder"], b"")?,
            EchoOutput::new(0, &format!("Z:{}\n", echo.folder.display()).replace('/', "\\"), ""),
        ),
        (
            "a path of the machine",
            echo.run(&["file", &write_file(&echo, "text", "in it")?], b"")?,
            EchoOutput::new(0, "in it", ""),
        ),
        ("exit status 3", echo.run(&["exit", "3"], b"")?, EchoOutput::new(3, "", "")),
        ("exit status 255", echo.run(&["exit", "255"], b"")?, EchoOutput::new(255, "", "")),
        ("exit status 512, which is not success", echo.run(&["exit", "512"], b"")?, EchoOutput::new(1, "", "")),
    ] {
        log.line(&format!("{what}: {found:?}"))?;
        tally.test((found != expected).then(|| format!("{what}: {found:?}, not {expected:?}")));
    }
    let shell = Echo { program: "/bin/sh".into(), folder: echo.folder.clone() };
    let script = r#"printf '%s\n' "$@" "$CAIRN_ECHO" "$PWD"; cat; echo error >&2; exit 3"#;
    let printed = format!("\ntwo words\n--help\na value\n{}\ninput", shell.folder.display());
    for (what, found, expected) in [
        (
            "what a Linux program is given",
            shell.run(&["-c", script, "sh", "", "two words", "--help"], b"input")?,
            EchoOutput::new(3, &printed, "error\n"),
        ),
        (
            "the GPU of a Linux program",
            shell.run(&["-c", "cd -P /sys/class/drm/card*/device && pwd && cat vendor device"], b"")?,
            EchoOutput::new(0, "/sys/devices/pci0000:00/0000:00:01.0\n0x1af4\n0x1050\n", ""),
        ),
        (
            "a Linux program that a signal ends",
            shell.run(&["-c", "kill -s KILL $$"], b"")?,
            EchoOutput::new(137, "", "Killed\n"),
        ),
    ] {
        log.line(&format!("{what}: {found:?}"))?;
        tally.test((found != expected).then(|| format!("{what}: {found:?}, not {expected:?}")));
    }
    let crashed = echo.run(&["crash"], b"")?;
    tally.test(
        (crashed.status == Some(0))
            .then(|| format!("a program that crashes is told from one that does not: {crashed:?}")),
    );
    tally.test(echo.stream_holders(log)?);
    tally.test(echo.ended_by(Signal::Kill, None, log)?);
    tally.test(echo.ended_by(Signal::Interrupt, Some(130), log)?);
    tally.test((mounts()? != before).then(|| "something stays mounted".to_owned()));
    Ok(())
}

/// Writes a file into the program's folder; returns its path.
fn write_file(echo: &Echo, name: &str, text: &str) -> Result<String, String> {
    let path = echo.folder.join(name);
    fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(path.display().to_string())
}

/// The test program and its folder, which is also its working directory.
struct Echo {
    program: PathBuf,
    folder: PathBuf,
}

/// How a run is ended from outside.
#[derive(Debug, Clone, Copy)]
enum Signal {
    /// SIGKILL, which no process can handle.
    Kill,
    /// Ctrl-C.
    Interrupt,
}

/// How a run ended.
#[derive(PartialEq)]
struct EchoOutput {
    status: Option<i32>,
    out: Vec<u8>,
    err: Vec<u8>,
}

impl EchoOutput {
    fn new(status: i32, out: &str, err: &str) -> Self {
        Self { status: Some(status), out: out.into(), err: err.into() }
    }
}

impl std::fmt::Debug for EchoOutput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?} \"{}\" \"{}\"", self.status, self.out.escape_ascii(), self.err.escape_ascii())
    }
}

impl Echo {
    fn command(&self, arguments: &[&str]) -> Result<Command, String> {
        let mut command = lab_run()?;
        command.arg(&self.program).args(arguments).current_dir(&self.folder).env("CAIRN_ECHO", "a value");
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        Ok(command)
    }

    /// Runs the program to its end.
    fn run(&self, arguments: &[&str], input: &[u8]) -> Result<EchoOutput, String> {
        let failed = |e: std::io::Error| format!("the lab with {arguments:?}: {e}");
        let mut child = self.command(arguments)?.spawn().map_err(failed)?;
        let mut stdin = child.stdin.take().ok_or("no standard input")?;
        // A program that does not read its input may have exited before all is written.
        _ = stdin.write_all(input);
        drop(stdin);
        let Output { status, stdout, stderr } = child.wait_with_output().map_err(failed)?;
        Ok(EchoOutput { status: status.code(), out: stdout, err: stderr })
    }

    /// Fails if one of Windows' own processes holds the program's output streams.
    fn stream_holders(&self, log: &mut Log) -> Result<Option<String>, String> {
        let mark = self.folder.join("started");
        _ = fs::remove_file(&mark);
        let mut child = self.command(&["stay", "started"])?.spawn().map_err(|e| e.to_string())?;
        let started = wait_until(TIMEOUT, || mark.is_file());
        let of_windows = processes(|line| line.starts_with("C:\\"));
        let stream = |process: u32, number: u8| fs::read_link(format!("/proc/{process}/fd/{number}")).ok();
        let own = [stream(child.id(), 1), stream(child.id(), 2)];
        let inherits = |process: u32| [1, 2].into_iter().any(|number| own.contains(&stream(process, number)));
        let holders: Vec<_> = of_windows.iter().filter(|(process, _)| inherits(*process)).collect();
        log.line(&format!("beside {own:?}: {of_windows:?}"))?;
        _ = child.kill();
        child.wait().map_err(|e| e.to_string())?;
        if !started || of_windows.is_empty() || own.contains(&None) {
            return Ok(Some(format!("the program did not start, or Windows not: {of_windows:?}, {own:?}")));
        }
        Ok((!holders.is_empty()).then(|| format!("Windows' own processes have the program's streams: {holders:?}")))
    }

    /// Ends a run by a signal while the program and its child wait. Fails if a process stays behind, or if the exit status is not
    /// `expected`.
    fn ended_by(&self, signal: Signal, expected: Option<i32>, log: &mut Log) -> Result<Option<String>, String> {
        let mark = self.folder.join("started");
        _ = fs::remove_file(&mark);
        let mut child = self.command(&["stay", "started"])?.spawn().map_err(|e| e.to_string())?;
        let started = wait_until(TIMEOUT, || mark.is_file());
        let running = self.running();
        match signal {
            Signal::Kill => _ = child.kill(),
            // To this process only: the others must end without the signal that a terminal's Ctrl-C sends them too.
            Signal::Interrupt => {
                let kill = format!("kill -INT {}", child.id());
                Command::new("sh").args(["-c", &kill]).status().map_err(|e| format!("{kill}: {e}"))?;
            }
        }
        let status = child.wait().map_err(|e| e.to_string())?.code();
        log.line(&format!("before {signal:?}: {running:?}; exit status {status:?}"))?;
        if !started || running.len() < 2 {
            return Ok(Some(format!("the program and its child did not start: {running:?}")));
        }
        if status != expected {
            return Ok(Some(format!("{signal:?} gives the exit status {status:?}, not {expected:?}")));
        }
        let gone = wait_until(TIMEOUT, || self.running().is_empty());
        Ok((!gone).then(|| format!("processes stay behind a run that ended by {signal:?}: {:?}", self.running())))
    }

    /// Command lines of processes that name the program.
    fn running(&self) -> Vec<String> {
        let name = self.program.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let lines = processes(|line| line.contains(&name) && line.contains("stay"));
        lines.into_iter().map(|(_, line)| line).collect()
    }
}

/// Processes of this machine whose command line `is_wanted`, with their ids.
fn processes(is_wanted: impl Fn(&str) -> bool) -> Vec<(u32, String)> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let numbers = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let lines = numbers.filter_map(|number: u32| Some((number, fs::read(format!("/proc/{number}/cmdline")).ok()?)));
    let lines = lines.map(|(number, line)| (number, String::from_utf8_lossy(&line).replace('\0', " ")));
    lines.filter(|(_, line)| is_wanted(line)).collect()
}

/// Whether `condition` becomes true before the time limit.
fn wait_until(time: Duration, condition: impl Fn() -> bool) -> bool {
    let end = Instant::now() + time;
    while Instant::now() < end {
        if condition() {
            return true;
        }
        sleep(Duration::from_millis(100));
    }
    false
}

/// The mounted file systems.
fn mounts() -> Result<Vec<String>, String> {
    let path = Path::new("/proc/self/mounts");
    let text = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(text.lines().filter(|line| line.contains("lab")).map(str::to_owned).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_program_on_direct3d_12_runs_in_one_runner_at_least() {
        let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests");
        let names = fs::read_dir(tests).expect("the tests").map(|entry| entry.expect("an entry").path());
        let stems = names.map(|path| path.file_stem().expect("a name").to_string_lossy().into_owned());
        let programs: Vec<String> =
            stems.filter(|name| name.starts_with("d3d12") && name != "d3d12-recorder").collect();
        assert!(programs.len() > 10, "{programs:?}");
        let here = own_programs(&Amd::None);
        for program in &programs {
            let (is_here, is_recorded) =
                (here.contains(&program.as_str()), recorder::short().any(|short| short == program));
            let is_thorough =
                RECORDED_WHEN_THOROUGH.iter().any(|name| name == program && recorder::LONG.contains(name));
            assert!(is_here || is_recorded || is_thorough, "no runner starts {program}");
        }
        let with_amd = own_programs(&Amd::Own(PathBuf::new()));
        assert!(programs.iter().all(|program| with_amd.contains(&program.as_str())));
    }
}
