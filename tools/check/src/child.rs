//! Runs each check in a process of its own, so that a crash or a hang of a driver costs one line of the report.

use std::io::{self, Read};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::outcome::Outcome;

/// Starts the line on which a check's process prints its result; drivers may print other lines.
const MARKER: &str = "cairn-check-result ";
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// Longest part of a failed process's output in a report, in characters.
const TAIL: usize = 600;

/// Prints a result for the process that started this one.
pub(crate) fn print_result(outcome: &Outcome) {
    let text = serde_json::to_string(outcome).unwrap_or_else(|e| format!("\"{e}\""));
    println!("\n{MARKER}{text}");
}

/// Runs the command, which prints a result, for at most `limit`. If it prints none, the verdict is a failure with the reason.
pub(crate) fn run(command: &mut Command, limit: Duration) -> Outcome {
    match watch(command, limit) {
        Ok(outcome) => outcome,
        Err(e) => Outcome::fail(format!("its process cannot be run: {e}"), "Allow this program to start itself again"),
    }
}

fn watch(command: &mut Command, limit: Duration) -> io::Result<Outcome> {
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let began = Instant::now();
    // Threads, as a process whose pipe is full would wait for ever.
    let [out, err] = [
        child.stdout.take().map(|pipe| thread::spawn(move || read_all(pipe))),
        child.stderr.take().map(|pipe| thread::spawn(move || read_all(pipe))),
    ];
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break Some(status);
        }
        if began.elapsed() >= limit {
            child.kill()?;
            child.wait()?;
            break None;
        }
        thread::sleep(POLL_INTERVAL);
    };
    let Some(status) = status else {
        // Its pipes may be held open by processes that it started, so they are not waited for.
        return Ok(Outcome::fail(
            format!("it had not ended after {} s, and was stopped", limit.as_secs_f64()),
            "Close other programs that use the GPU, update the graphics driver, and run this check alone with --only",
        ));
    };
    let text = |thread: Option<thread::JoinHandle<String>>| thread.and_then(|t| t.join().ok()).unwrap_or_default();
    let (out, err) = (text(out), text(err));
    let result = out.lines().rev().find_map(|line| line.strip_prefix(MARKER));
    if let Some(outcome) = result.and_then(|text| serde_json::from_str::<Outcome>(text).ok()) {
        if status.success() {
            return Ok(outcome);
        }
        // The work was done, and the driver crashed while the process ended.
        return Ok(Outcome {
            verdict: crate::verdict::Verdict::Fail,
            found: format!("its process ended with {status} after the result: {}", outcome.found),
            remedy: outcome.remedy.clone().or_else(|| Some("Update the graphics driver".into())),
            ..outcome
        });
    }
    Ok(Outcome::fail(
        format!("its process ended without a result, with {status}; {}", tail(&err, &out)),
        "Update the graphics driver and run this check alone with --only; if it stays, report it with this page",
    ))
}

fn read_all(mut pipe: impl Read) -> String {
    let mut bytes = Vec::new();
    // What was read before an error is kept.
    _ = pipe.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The message of a panic in the output, or else its end.
fn tail(err: &str, out: &str) -> String {
    let lines: Vec<&str> = err.lines().chain(out.lines()).map(str::trim).filter(|line| !line.is_empty()).collect();
    let panic = lines.iter().position(|line| line.contains("panicked at"));
    let from = panic.unwrap_or(lines.len().saturating_sub(4));
    let shown: Vec<&str> =
        lines[from..].iter().copied().filter(|line| !line.starts_with("note: run with")).take(4).collect();
    let text: String = shown.join("; ").chars().take(TAIL).collect();
    if text.is_empty() { "it printed nothing".into() } else { format!("it printed: {text}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::Verdict;

    const VARIABLE: &str = "CAIRN_CHECK_TEST_CHILD";

    /// Not a test itself, but the process of the tests below.
    #[test]
    fn the_process_of_the_other_tests() {
        match std::env::var(VARIABLE).as_deref() {
            Ok("pass") => print_result(&Outcome::pass("all is well")),
            Ok("crash") => std::process::abort(),
            Ok("panic") => panic!("the driver gave no device"),
            Ok("hang") => thread::sleep(Duration::from_secs(600)),
            Ok("crash late") => {
                print_result(&Outcome::pass("all is well"));
                std::process::abort();
            }
            Ok("much output") => {
                print!("{}", "text of a driver\n".repeat(100_000));
                print_result(&Outcome::pass("all is well"));
            }
            _ => {}
        }
    }

    fn child(what: &str, limit: Duration) -> Outcome {
        let mut command = Command::new(std::env::current_exe().expect("this program"));
        command.args(["--exact", "child::tests::the_process_of_the_other_tests", "--nocapture"]).env(VARIABLE, what);
        run(&mut command, limit)
    }

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn a_result_comes_back_also_among_much_other_output() {
        assert_eq!(child("pass", LONG), Outcome::pass("all is well"));
        assert_eq!(child("much output", LONG), Outcome::pass("all is well"));
    }

    #[test]
    fn a_crash_a_panic_and_no_result_are_failures() {
        for (what, words) in [
            ("crash", "ended without a result"),
            ("panic", "the driver gave no device"),
            ("nothing", "ended without a result"),
            ("crash late", "after the result: all is well"),
        ] {
            let outcome = child(what, LONG);
            assert_eq!(outcome.verdict, Verdict::Fail, "{what}");
            assert!(outcome.found.contains(words) && outcome.remedy.is_some(), "{what}: {outcome:?}");
        }
    }

    #[test]
    fn a_hang_is_stopped_at_its_limit() {
        let began = Instant::now();
        let outcome = child("hang", Duration::from_secs(1));
        assert!(outcome.verdict == Verdict::Fail && outcome.found.contains("had not ended after 1 s"), "{outcome:?}");
        assert!(began.elapsed() < LONG);
    }

    #[test]
    fn a_program_that_is_not_there_is_a_failure() {
        let outcome = run(&mut Command::new("no-such-program-of-cairn"), LONG);
        assert!(outcome.verdict == Verdict::Fail && outcome.found.contains("cannot be run"), "{outcome:?}");
    }
}
