//! The program from its command line to its report, with all checks that need no adapter; on Windows, and in the lab, also with a fault on
//! purpose in each check of results.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Output};

use cairn_check::finding::Verdict;
use cairn_check::report::Report;
use libtest_mimic::{Arguments, Failed, Trial};

/// First argument of this program as a `cairn-check` whose results from the device are altered.
const FAULTY: &str = "--as-faulty-check";

/// First argument of this program as a `cairn-check` whose checks end their processes.
const CRASHING: &str = "--as-crashing-check";

/// Checks of an adapter's results that need no other libraries.
const ALTERED: [&str; 6] = ["resize", "guidance", "flow", "frames", "truth", "formats"];

fn main() -> ExitCode {
    let mut arguments = std::env::args_os();
    let first = arguments.nth(1);
    if first.as_ref().is_some_and(|first| first == CRASHING) {
        if arguments.next().is_some_and(|verb| verb == "run-one") {
            std::process::abort();
        }
        let all = std::env::args_os().enumerate().filter(|(index, _)| *index != 1).map(|(_, argument)| argument);
        return cairn_check::run_as(all, &[CRASHING.into()]);
    }
    if first.is_some_and(|first| first == FAULTY) {
        gpu_testing::fault::turn_on();
        let all = std::iter::once(OsString::from("cairn-check")).chain(arguments);
        return cairn_check::run_as(all, &[FAULTY.into()]);
    }
    let mut trials = vec![
        Trial::test("the_help_teaches", the_help_teaches),
        Trial::test("what_a_machine_lacks_has_a_cause_and_a_remedy", what_a_machine_lacks),
        Trial::test("an_unknown_name_is_refused", unknown_names),
        Trial::test("a_check_that_ends_its_process_is_a_failed_line", crashes_are_lines),
        Trial::test("altered_results_of_the_processor_fail", || fault_fails(&["cpu-frames"])),
        Trial::test("reports_are_compared", reports_are_compared),
    ];
    if cfg!(windows) {
        trials.push(Trial::test("altered_results_of_the_adapter_fail", || fault_fails(&ALTERED)));
        trials.push(Trial::test("results_of_the_adapter_are_right", results_are_right));
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}

/// A folder that is removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("cairn-check-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder");
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        _ = std::fs::remove_dir_all(&self.0);
    }
}

fn program(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cairn-check")).args(arguments).output().expect("the program starts")
}

/// The report of a run, and its exit status.
fn run(program: &Path, before: &[&str], only: &str, folder: &Folder) -> (Report, Option<i32>) {
    let mut command = Command::new(program);
    command.args(before).args(["--quick", "--only", only, "--out"]).arg(&folder.0);
    let ended = command.output().expect("the program starts");
    let text = std::fs::read_to_string(folder.0.join("report.json"));
    let text = text.unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&ended.stderr)));
    (Report::from_json(&text).expect("a report"), ended.status.code())
}

type Tested = Result<(), Failed>;

fn ensure(is_right: bool, what: impl std::fmt::Debug) -> Tested {
    if is_right { Ok(()) } else { Err(format!("{what:?}").into()) }
}

fn the_help_teaches() -> Tested {
    let help = String::from_utf8(program(&["--help"]).stdout).expect("text");
    for word in ["report.html", "exit status is 0", "--only", "--quick", "--adapter", "compare"] {
        ensure(help.contains(word), word)?;
    }
    ensure(!help.contains("run-one"), "hidden commands are not in the help")
}

/// Without adapter or libraries the program says so, and writes its files.
fn what_a_machine_lacks() -> Tested {
    let folder = Folder::new("lacks");
    let (report, status) = run(Path::new(env!("CARGO_BIN_EXE_cairn-check")), &[], "there,cpu-frames,fsr", &folder);
    ensure(report.checks.len() == 5 && report.quick, &report.checks)?;
    for check in &report.checks {
        ensure(!check.sentence.is_empty(), check)?;
        ensure((check.verdict == Verdict::Pass) == check.remedy.is_none(), check)?;
    }
    let frames = report.checks.iter().find(|check| check.name == "cpu-frames").expect("its line");
    ensure(frames.verdict == Verdict::Pass && frames.figures.len() == 2, frames)?;
    if !cfg!(windows) {
        let rest: Vec<_> = report.checks.iter().filter(|check| check.name != "cpu-frames").collect();
        ensure(rest.iter().all(|check| check.verdict == Verdict::CannotTell), &rest)?;
    }
    ensure(status == Some(i32::from(report.verdict.exit_status())), status)?;
    let page = std::fs::read_to_string(folder.0.join("report.html")).expect("the page");
    ensure(
        page.contains(&report.verdict.to_string()) && page.contains("Generated frames beside the true ones"),
        "the page",
    )?;
    // No names of folders or users.
    let json = std::fs::read_to_string(folder.0.join("report.json")).expect("the report");
    let home = std::env::home_dir().map_or(String::new(), |home| home.display().to_string());
    let private = [folder.0.display().to_string(), home].into_iter().filter(|text| text.len() > 5);
    for text in private {
        ensure(!json.contains(&text) && !page.contains(&text), text)?;
    }
    let others = std::fs::read_dir(&folder.0).expect("the folder").count();
    ensure(others == 2, "nothing else is left")
}

fn unknown_names() -> Tested {
    let ended = program(&["--only", "nothing"]);
    let text = String::from_utf8_lossy(&ended.stderr).into_owned();
    ensure(ended.status.code() == Some(2) && text.contains("there is no check or group nothing"), text)
}

/// Checks whose results are altered must fail.
fn fault_fails(names: &[&str]) -> Tested {
    let folder = Folder::new("fault");
    let own = std::env::current_exe().expect("this program");
    let (report, status) = run(&own, &[FAULTY], &names.join(","), &folder);
    ensure(report.checks.len() == names.len() && status == Some(1), &report.checks)?;
    ensure(report.checks.iter().all(|check| check.verdict == Verdict::Fail), &report.checks)
}

/// A process that ends without a finding is a failed line, and the next check runs.
fn crashes_are_lines() -> Tested {
    let folder = Folder::new("crash");
    let own = std::env::current_exe().expect("this program");
    let (report, status) = run(&own, &[CRASHING], "cpu-frames,cpu-world", &folder);
    ensure(report.checks.len() == 2 && status == Some(1), &report.checks)?;
    let is_crash = |check: &cairn_check::report::Check| {
        check.verdict == Verdict::Fail && check.sentence.starts_with("its process ended with")
    };
    ensure(report.checks.iter().all(is_crash), &report.checks)
}

/// The same checks pass when nothing is altered.
fn results_are_right() -> Tested {
    let folder = Folder::new("right");
    let (report, _) = run(Path::new(env!("CARGO_BIN_EXE_cairn-check")), &[], &ALTERED.join(","), &folder);
    ensure(report.checks.len() == ALTERED.len() && report.verdict == Verdict::Pass, &report.checks)?;
    let page = std::fs::read_to_string(folder.0.join("report.html")).expect("the page");
    ensure(page.matches("data:image/png;base64,").count() >= 2, "generated and true frames are shown")
}

fn reports_are_compared() -> Tested {
    let folder = Folder::new("compare");
    let (report, _) = run(Path::new(env!("CARGO_BIN_EXE_cairn-check")), &[], "cpu-frames", &folder);
    let mut other = report.clone();
    other.checks[0].figures[0].value *= 2.0;
    other.checks[0].verdict = Verdict::Fail;
    let [a, b] = ["a.json", "b.json"].map(|name| folder.0.join(name).display().to_string());
    std::fs::write(&a, report.to_json()?).expect("a file");
    std::fs::write(&b, other.to_json()?).expect("a file");
    let ended = program(&["compare", &a, &b]);
    let text = String::from_utf8_lossy(&ended.stdout).into_owned();
    let has = |words: &str| text.lines().any(|line| words.split(' ').all(|word| line.contains(word)));
    ensure(ended.status.code() == Some(0) && has("cpu-frames PASS FAIL") && has("generated 2.00"), text)?;
    let missing = program(&["compare", &a, "nowhere.json"]);
    ensure(missing.status.code() == Some(2), missing)
}
