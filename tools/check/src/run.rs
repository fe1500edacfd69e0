//! Runs checks one after the other, shows their lines, and writes the report.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::checks::Check;
use crate::child;
use crate::outcome::Outcome;
use crate::page::page;
use crate::privacy::Scrubber;
use crate::report::{Line, Report, SCHEMA};
use crate::settings::Settings;
use crate::verdict::Verdict;

/// Longest duration of all checks together.
const WHOLE: Duration = Duration::from_secs(300);

/// Runs the checks and writes `report.html` and `report.json` into the folder `out`.
///
/// # Errors
/// Text with cause and remedy: the folder cannot be written, or this program has no path.
pub(crate) fn run(checks: &[&'static Check], settings: &Settings, out: &Path) -> Result<Report, String> {
    let failed = |e: std::io::Error| format!("--out {}: {e}. Name a folder that can be written", out.display());
    // Before the checks: nobody waits five minutes for a report that cannot be written.
    std::fs::create_dir_all(out).map_err(failed)?;
    let program =
        std::env::current_exe().map_err(|e| format!("this program's own path: {e}. Start it from a local disk"))?;
    let began = Instant::now();
    let started = jiff::Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string();
    let bar = ProgressBar::new(checks.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("[{elapsed_precise}] {bar:30} {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    let scrubber = Scrubber::of_this_process();
    let mut lines = Vec::new();
    for check in checks {
        bar.set_message(check.title);
        let at = Instant::now();
        let left = WHOLE.saturating_sub(began.elapsed());
        let outcome = if left < Duration::from_secs(1) {
            Outcome::cannot_tell(
                format!("the {} s for all checks were used up", WHOLE.as_secs()),
                format!("Run it alone: --only {}", check.id),
            )
        } else {
            let mut command = Command::new(&program);
            command.args(["run-check", check.id]).args(settings.arguments());
            child::run(&mut command, check.limit.min(left))
        };
        let line = Line {
            id: check.id.into(),
            group: check.group.title().into(),
            title: check.title.into(),
            seconds: at.elapsed().as_secs_f64(),
            outcome,
        };
        bar.suspend(|| println!("{}", console(&line, &scrubber)));
        lines.push(line);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut report = Report {
        schema: SCHEMA,
        cairn: env!("CARGO_PKG_VERSION").into(),
        started,
        seconds: began.elapsed().as_secs_f64(),
        short: settings.short,
        verdict: Verdict::worst(lines.iter().map(|line| line.outcome.verdict)),
        lines,
    };
    report.scrub(&scrubber);
    std::fs::write(out.join("report.json"), report.json()).map_err(failed)?;
    std::fs::write(out.join("report.html"), page(&report)).map_err(failed)?;
    println!("\n{}\n{}", report.summary(), out.join("report.html").display());
    Ok(report)
}

/// A line for the console: verdict, title and result, and what to do below it.
fn console(line: &Line, scrubber: &Scrubber) -> String {
    let outcome = &line.outcome;
    let remedy = outcome.remedy.as_ref().map(|text| format!("\n{:13}What to do: {text}", "")).unwrap_or_default();
    scrubber.scrub(&format!("{:11}  {}: {}{remedy}", outcome.verdict, line.title, outcome.found))
}
