//! `cairn-check` on Windows or in the lab: its own tests, which alter results on purpose, and a run whose report and window are looked at.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;

use super::amd::Amd;
use super::ffx::{AMD, DOUBLE};
use super::host::screen;
use super::tally::Tally;
use super::{Context, lab, windows_build};
use crate::shell::Log;
use crate::workspace;

/// Its test program.
const TESTS: &str = "check";
/// The window's place on the display and its size, as the program opens it.
const WINDOW: [usize; 4] = [40, 40, 640, 360];
/// Interval at which the display is read.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Checks that pass in the lab, apart from those that the tests of the program run.
const RIGHT: [&str; 2] = ["adapters", "libraries"];
/// Those that the tests of the program run.
const RIGHT_IN_TESTS: [&str; 7] = ["cpu-frames", "resize", "guidance", "flow", "frames", "truth", "formats"];
/// Those with worlds, and many devices.
const RIGHT_OF_WORLDS: [&str; 6] = ["cpu-world", "directml", "states", "captured", "removal", "lives"];
/// Checks of times: of an emulated adapter they show nothing.
const TIMES: [&str; 2] = ["first-frame", "window"];
const TIMES_OF_WORLDS: [&str; 4] = ["latents", "generator", "memory", "engine"];
/// Checks of AMD's frame generation, and of its times.
const FSR: [&str; 2] = ["fsr", "fsr-truth"];
const FSR_TIMES: [&str; 1] = ["fsr-times"];
/// What the double emulates: the provider that computes its frames as AMD's analytic one does.
const ROLE: &str = "sdk 2.1\noffers 0xf600000000c01006 3.1.6\n";
/// Checks that need what the lab lacks: the debug layer.
const MISSING: [&str; 3] = ["debug-layer", "layer", "layer-on-gpu"];

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::skip_unless_possible("cairn-check on Windows")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    let mut command = context.windows_tests([TESTS], log)?;
    context.provide_windows_tools(&mut command)?;
    tally.add(windows_build::run(&mut command, &[], log)?);
    report(context, log, &[&RIGHT], &[&TIMES, &MISSING], &mut tally)?;
    by_double(context, log, &mut tally)?;
    Ok(tally)
}

/// The checks of AMD's frame generation, with the test double of its library.
fn by_double(context: &Context<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let work = context.workspace.target.join("xtask").join("cairn-check-amd");
    // A report of an earlier run must not be judged.
    workspace::make_empty(&work)?;
    place_double(context, &work)?;
    let mut command = lab::lab_run()?;
    command.arg(context.windows_programs().join("cairn-check.exe")).args(["--quick", "--minutes", "60", "--only"]);
    command.arg([&FSR[..], &FSR_TIMES].concat().join(",")).arg("--out").arg(&work);
    context.provide_windows_tools(&mut command)?;
    Amd::Double(work.clone()).provide(&mut command);
    let ended = log.run(&mut command)?;
    let verdicts = Verdicts::read(&work)?;
    verdicts.require(&FSR, &FSR_TIMES, tally);
    verdicts.require_status(ended.success, tally);
    Ok(())
}

/// Puts the double into a folder, under the name of AMD's library.
pub(super) fn place_double(context: &Context<'_>, folder: &Path) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    fs::copy(context.windows_programs().join(DOUBLE), folder.join(AMD)).map_err(failed)?;
    fs::write(folder.join(format!("{AMD}.txt")), ROLE).map_err(failed)
}

/// The verdicts of a `report.json`.
pub(super) struct Verdicts(Value);

impl Verdicts {
    pub(super) fn read(folder: &Path) -> Result<Self, String> {
        let path = folder.join("report.json");
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        serde_json::from_str(&text).map(Self).map_err(|e| format!("{}: {e}", path.display()))
    }

    pub(super) fn of(&self, name: &str) -> &str {
        let mut checks = self.0["checks"].as_array().into_iter().flatten();
        checks.find(|check| check["name"] == name).and_then(|check| check["verdict"].as_str()).unwrap_or("no line")
    }

    /// Requires the program to have succeeded if and only if every check passed. Counted only if it fails.
    fn require_status(&self, success: bool, tally: &mut Tally) {
        let mut checks = self.0["checks"].as_array().into_iter().flatten();
        let expected = checks.all(|check| check["verdict"] == "pass");
        if success != expected {
            let [is, should] = [success, expected].map(|success| if success { "succeeded" } else { "failed" });
            tally.failures.push(format!("by its exit status cairn-check {is}, by its report it {should}"));
        }
    }

    /// Requires the checks in `right` to pass, and those in `unknown` to say that they cannot tell; on Windows itself the latter may pass.
    pub(super) fn require(&self, right: &[&str], unknown: &[&str], tally: &mut Tally) {
        for name in right {
            let verdict = self.of(name);
            tally.test((verdict != "pass").then(|| format!("cairn-check, {name}: {verdict}")));
        }
        for name in unknown {
            let verdict = self.of(name);
            let fits = verdict == "cannot-tell" || cfg!(windows) && verdict == "pass";
            tally.test((!fits).then(|| format!("cairn-check, {name}: {verdict}")));
        }
    }
}

/// Every check.
pub(super) fn run_all(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::skip_unless_possible("every check of cairn-check on Windows")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    context.build_for_windows(log)?;
    let right: [&[&str]; 3] = [&RIGHT, &RIGHT_IN_TESTS, &RIGHT_OF_WORLDS];
    // Without AMD's libraries nothing is said of them.
    report(context, log, &right, &[&TIMES, &TIMES_OF_WORLDS, &MISSING, &FSR, &FSR_TIMES], &mut tally)?;
    Ok(tally)
}

/// Runs checks, and requires those in `right` to pass. On a Windows with an adapter and a debug layer those in `unknown` may pass too.
fn report(
    context: &Context<'_>,
    log: &mut Log,
    right: &[&[&str]],
    unknown: &[&[&str]],
    tally: &mut Tally,
) -> Result<(), String> {
    let work = context.workspace.target.join("xtask").join("cairn-check");
    workspace::make_empty(&work)?;
    let [right, unknown] = [right, unknown].map(|names| names.concat());
    let mut command = lab::lab_run()?;
    command.arg(context.windows_programs().join("cairn-check.exe")).args(["--quick", "--minutes", "60", "--only"]);
    command.arg([&*right, &*unknown].concat().join(",")).arg("--out").arg(&work).env("CAIRN_LAB_SCREEN", &work);
    context.provide_windows_tools(&mut command)?;
    Amd::None.provide(&mut command);
    let (is_over, display) = (AtomicBool::new(false), work.join("Xvfb_screen0"));
    let (ended, seen) = std::thread::scope(|scope| {
        let watch = scope.spawn(|| window_moves(&display, &work, &is_over));
        let ended = log.run(&mut command);
        is_over.store(true, Ordering::Relaxed);
        (ended, watch.join())
    });
    let ended = ended?;
    let verdicts = Verdicts::read(&work)?;
    verdicts.require(&right, &unknown, tally);
    verdicts.require_status(ended.success, tally);
    if !cfg!(windows) {
        let seen = seen.map_err(|_| "the display cannot be watched")?;
        tally.test((!seen).then(|| "the window of cairn-check shows no moving picture on the display".to_owned()));
    }
    Ok(())
}

/// Waits until two different pictures were in the window's place on the display, and writes the second screen into `work`; `false` if the run is
/// over before.
fn window_moves(display: &Path, work: &Path, is_over: &AtomicBool) -> bool {
    let mut first: Option<Vec<u8>> = None;
    while !is_over.load(Ordering::Relaxed) {
        if let Some(screen) = screen::read(display).filter(|screen| screen.width > 700 && screen.height > 400) {
            let [left, top, width, height] = WINDOW;
            let row = |y: usize| &screen.pixels[(y * screen.width + left) * 3..][..width * 3];
            let inside = (top..top + height).flat_map(row).copied().collect::<Vec<u8>>();
            // An empty display, and a window that was not drawn, have one colour.
            let differing = inside.windows(6).step_by(3).filter(|two| two[..3] != two[3..]).count();
            if differing > width * height / 10 {
                match &first {
                    Some(before) if *before != inside => {
                        let file: PathBuf = work.join("screen.ppm");
                        return screen.write(&file).is_ok();
                    }
                    Some(_) => {}
                    None => first = Some(inside),
                }
            }
        }
        sleep(POLL_INTERVAL);
    }
    false
}
