//! Runs each check in a process of its own: a crash of a driver, or one that hangs, is a line of the report.

use std::ffi::OsString;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use crate::checks::{CheckDefinition, Settings};
use crate::finding::{Finding, Verdict};
use crate::privacy::{known_folders, without_folders};
use crate::report::{Check, Machine};

/// Factor of the checks' limits where a processor emulates the adapter.
pub(crate) const PATIENCE_WITH_EMULATION: u32 = 8;
/// Interval at which a process's end is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Time for the description of the machine.
const DESCRIPTION_LIMIT: Duration = Duration::from_secs(60);
/// Bytes of a process's last words in the report.
const LAST_WORDS: usize = 600;

/// Starts processes that run one check each.
#[derive(Debug, Clone)]
pub struct Runner {
    /// The program, which hands its arguments to [`crate::run`].
    pub program: PathBuf,
    /// Arguments before those of the check.
    pub arguments: Vec<OsString>,
    /// Passed on to each check.
    pub settings: Settings,
    /// When the whole run must be over.
    pub deadline: Instant,
    /// Factor of the checks' limits.
    pub patience: u32,
    /// Folder of this run alone, for the processes' results.
    pub folder: PathBuf,
}

impl Runner {
    /// Runs a check and returns its line.
    pub fn run(&self, check: &CheckDefinition) -> Check {
        let start = Instant::now();
        let left = self.deadline.saturating_duration_since(start);
        let finding = if left.is_zero() {
            Finding::cannot_tell(
                "the time of this run was used up before",
                format!("Run it alone: cairn-check --only {}", check.name),
            )
        } else {
            self.run_process(check, left.min(self.limit(check)))
        };
        line(check, finding, start.elapsed())
    }

    /// The machine, as a process of its own describes it; without its adapters if that process fails.
    pub fn describe(&self) -> Machine {
        let result = self.folder.join("machine");
        let mut command = self.command("describe", &result);
        let ended = command.spawn().and_then(|child| wait(child, DESCRIPTION_LIMIT));
        let text = std::fs::read_to_string(&result).unwrap_or_default();
        match (ended, serde_json::from_str(&text)) {
            (Ok(_), Ok(machine)) => machine,
            _ => crate::checks::machine::without_adapters(),
        }
    }

    /// A process that runs a hidden command with this run's settings.
    fn command(&self, verb: &str, result: &Path) -> Command {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).arg(verb).arg("--result").arg(result).args(self.settings.arguments());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    /// Time after which a check is taken to hang.
    fn limit(&self, check: &CheckDefinition) -> Duration {
        Duration::from_secs(check.seconds) * self.patience
    }

    fn run_process(&self, check: &CheckDefinition, limit: Duration) -> Finding {
        let result = self.folder.join(check.name);
        let mut command = self.command("run-one", &result);
        command.arg(check.name);
        let ended = command.spawn().and_then(|child| wait(child, limit));
        let text = std::fs::read_to_string(&result).ok();
        let finding = text.and_then(|text| serde_json::from_str::<Finding>(&text).ok());
        match (ended, finding) {
            (Err(e), _) => Finding::cannot_tell(format!("its process did not start: {e}"), "Start the program again"),
            (Ok((None, _)), _) if limit < self.limit(check) => Finding::cannot_tell(
                "the time of this run was used up before it ended",
                format!("Run it alone: cairn-check --only {}", check.name),
            ),
            (Ok((None, _)), _) => Finding::fail(
                format!(
                    "it did not end within {} s, and was ended: it hung, or the adapter is too slow by far",
                    limit.as_secs()
                ),
                crate::checks::DRIVER,
            ),
            (Ok((Some(_), _)), Some(finding)) => finding,
            (Ok((Some(status), words)), None) => {
                let words = if words.is_empty() { String::new() } else { format!("; its last words: {words}") };
                Finding::fail(format!("its process ended with {}{words}", described(status)), crate::checks::DRIVER)
            }
        }
    }
}

/// The line of a finding.
fn line(check: &CheckDefinition, mut finding: Finding, took: Duration) -> Check {
    if finding.verdict != Verdict::Pass && finding.remedy.is_none() {
        finding.remedy = Some(crate::checks::DRIVER.to_owned());
    }
    let known = known_folders();
    let clean = |text: &str| without_folders(text, &known);
    Check {
        name: check.name.to_owned(),
        group: check.group.name().to_owned(),
        title: check.title.to_owned(),
        verdict: finding.verdict,
        sentence: clean(&finding.sentence),
        remedy: finding.remedy.filter(|_| finding.verdict != Verdict::Pass).map(|remedy| clean(&remedy)),
        seconds: took.as_secs_f64(),
        figures: finding.figures,
        pictures: finding.pictures,
    }
}

/// Waits for a process, and ends it after `limit`. Returns its status, or none if it was ended, and its last words.
fn wait(mut child: Child, limit: Duration) -> std::io::Result<(Option<ExitStatus>, String)> {
    let start = Instant::now();
    let stderr = child.stderr.take();
    // Read all the time: a full pipe would stop the process.
    let reader = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut stderr) = stderr {
            _ = stderr.read_to_end(&mut bytes);
        }
        bytes
    });
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break Some(status);
        }
        if start.elapsed() >= limit {
            child.kill()?;
            child.wait()?;
            break None;
        }
        std::thread::sleep(POLL_INTERVAL);
    };
    let bytes = reader.join().unwrap_or_default();
    let words = String::from_utf8_lossy(&bytes[bytes.len().saturating_sub(LAST_WORDS)..]).trim().to_owned();
    Ok((status, words))
}

/// An exit status, with the names of common crashes.
fn described(status: ExitStatus) -> String {
    let Some(code) = status.code() else { return status.to_string() };
    let name = match code.cast_unsigned() {
        0xc000_0005 => " (an access violation)",
        0xc000_00fd => " (a stack overflow)",
        0xc000_0409 => " (an abort)",
        0xc000_0374 => " (a damaged heap)",
        _ => "",
    };
    if name.is_empty() { format!("status {code}") } else { format!("status {code:#010x}{name}") }
}

/// What the process of `run-one` does: runs the check and writes its finding to `result`. A panic is a failed check.
pub fn run_one(check: &CheckDefinition, settings: &Settings, result: &Path) -> Result<(), String> {
    let place = std::sync::Arc::new(std::sync::Mutex::new(String::new()));
    let noted = place.clone();
    std::panic::set_hook(Box::new(move |panic| {
        let file = panic.location().map_or(String::new(), |at| {
            let file = Path::new(at.file()).file_name().unwrap_or_default().to_string_lossy();
            format!(" ({file}, line {})", at.line())
        });
        if let Ok(mut noted) = noted.lock() {
            // The first panic is the cause of those in other threads.
            if noted.is_empty() {
                *noted = format!("{}{file}", panic.payload_as_str().unwrap_or("it panicked"));
            }
        }
    }));
    let finding = match std::panic::catch_unwind(|| (check.run)(settings)) {
        Ok(Ok(finding) | Err(finding)) => finding,
        Err(_) => {
            let cause = place.lock().map(|cause| cause.clone()).unwrap_or_default();
            Finding::fail(cause, crate::checks::DRIVER)
        }
    };
    let text = serde_json::to_string(&finding).map_err(|e| e.to_string())?;
    std::fs::write(result, text).map_err(|e| format!("{}: {e}", result.display()))
}
