//! `cargo xtask test`: runs named runners, two beside each other once everything is built, and sums up their results.

mod abi;
mod amd;
mod archive;
mod archive_check;
mod blocks;
mod book;
mod browser;
mod cargo;
mod check;
mod cpp;
mod csharp;
mod directml;
mod disk_space;
mod dist;
mod ffx;
mod host;
mod junit;
mod lab;
mod nightly;
mod python;
mod quality;
mod readme;
mod recorder;
mod repository;
mod shaders;
mod skips;
mod study;
mod study_windows;
mod tally;
mod thorough;
mod thorough_record;
mod unity;
mod unreal;
mod validation;
mod wheels;
mod windows_build;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::Instant;

use provision::Console;

use crate::cli::TestOptions;
use crate::shell::Log;
use crate::workspace::Workspace;
use skips::Allowed;
use tally::Tally;
use thorough_record::Record;

pub(crate) use cargo::DENY_VERSION;
pub(crate) use lab::for_windows;
pub(crate) use recorder::with_recorder;

/// A named part of the tests. Its tally is counted; an error instead of a tally counts as one failure.
struct Runner {
    name: &'static str,
    what: &'static str,
    run: fn(&Context<'_>, &mut Log) -> Result<Tally, String>,
}

/// Before all others: quick and often failing ones, then builds whose compiled code the others use.
const FIRST: &[Runner] = &[
    Runner { name: "fmt", what: "the code is formatted", run: cargo::fmt },
    Runner {
        name: "repository",
        what: "words for unfinished work, links, dependencies between modules",
        run: repository::run,
    },
    Runner { name: "clippy", what: "no warning, all targets, for this system and for Windows", run: cargo::clippy },
    Runner { name: "docs", what: "documentation without a warning", run: cargo::docs },
    Runner { name: "build", what: "libraries, programs and tests build for this system", run: cargo::build },
    Runner {
        name: "link-windows",
        what: "libraries, programs and tests build and link for Windows",
        run: windows_build::link,
    },
];

/// After those, two groups beside each other: one runner alone leaves a processor idle much of the time. Runners of a group run in turn.
const GROUPS: &[&[Runner]] = &[
    // They put other libraries beside the same Windows programs.
    &[
        Runner { name: "lab", what: "Windows programs run, with Direct3D 12 and DirectML", run: lab::run },
        Runner {
            name: "validation",
            what: "Direct3D 12 over Vulkan's validation layer, which must find mutants; some of its tests",
            run: validation::run,
        },
        Runner {
            name: "recorder",
            what: "Direct3D 12 through a recorder of its calls, which must find misuse and mutants; some of its tests",
            run: recorder::run,
        },
        Runner {
            name: "directml",
            what: "parity with the oracle, saved states and budgets on DirectML, in short",
            run: directml::run,
        },
        Runner { name: "study-windows", what: "the study's program on Windows", run: study_windows::run },
        Runner {
            name: "cairn-check",
            what: "cairn-check in the lab: altered results must fail, right ones pass, and its window is on the display",
            run: check::run,
        },
        Runner { name: "host-d3d12", what: "samples/host-d3d12 shows a world on a display", run: host::run_windows },
        Runner {
            name: "unreal",
            what: "the plugin for Unreal Engine 5.1 to 5.8, by declarations of it and in a small engine",
            run: unreal::run,
        },
        Runner {
            name: "ffx",
            what: "AMD's ffx-api: a double of each release, and AMD's own where CAIRN_FFX_DIR is",
            run: ffx::run,
        },
    ],
    &[Runner { name: "cargo", what: "unit, integration, example and doc tests of the workspace", run: cargo::tests }],
    // The browser plays the video of the study.
    &[
        Runner {
            name: "study",
            what: "a short video, its replay, which motion is best, a small sweep and a small quality table, through the program",
            run: study::run,
        },
        Runner { name: "browser", what: "the video and the report of a comparison, in Chromium", run: browser::run },
    ],
    &[Runner {
        name: "abi",
        what: "the C and C++ headers, the record of the interface, and programs that use them",
        run: abi::run,
    }],
    &[Runner { name: "host", what: "C programs load and use the library, and write a video", run: host::run }],
    &[Runner {
        name: "pytest",
        what: "the Python package, parity with the oracle, and the training's short tests",
        run: python::run,
    }],
    &[Runner { name: "races", what: "submit and poll under ThreadSanitizer", run: nightly::races }],
    &[Runner {
        name: "dist",
        what: "archives are the same each time, and hosts are built and run from them alone",
        run: dist::run,
    }],
    &[Runner {
        name: "wheels",
        what: "Python wheels: what is in them, whom pip gives them to, and that they run, on Windows in the lab",
        run: wheels::run,
    }],
    &[Runner {
        name: "csharp",
        what: "the C# binding against the library, on Mono and .NET; the package for Unity compiles",
        run: csharp::run,
    }],
    &[Runner {
        name: "shaders",
        what: "compiled shaders are what their sources compile to, and the sources compile to SPIR-V",
        run: shaders::run,
    }],
    &[Runner { name: "cluster", what: "a sweep through Ray, on an instance of this machine", run: python::cluster }],
    &[Runner { name: "readme", what: "what the documents show: commands exist, code compiles", run: readme::run }],
    &[Runner { name: "book", what: "the documentation as a book: chapters, links, names, results", run: book::run }],
    &[Runner { name: "deny", what: "licences and sources of the dependencies", run: cargo::deny }],
];

/// The runners of every run.
fn runners() -> impl Iterator<Item = &'static Runner> {
    FIRST.iter().chain(GROUPS.iter().copied().flatten())
}

/// The runners that run with `--thorough` only.
fn parts() -> impl Iterator<Item = &'static Runner> {
    THOROUGH.iter().map(|part| &part.runner)
}

/// A part of the thorough tests, of at most [`thorough_record::LONGEST`] minutes.
struct Part {
    runner: Runner,
    /// Estimate for two cores, with the compiler's time; recorded durations replace it.
    minutes: u32,
}

/// Run with `--thorough` only.
const THOROUGH: &[Part] = &[
    Part {
        runner: Runner {
            name: "fuzz",
            what: "clippy for the fuzz targets, and each of them for a minute",
            run: thorough::fuzz,
        },
        minutes: 30,
    },
    Part {
        runner: Runner {
            name: "miri",
            what: "the C interface's tests without foreign code, under Miri",
            run: nightly::miri,
        },
        minutes: 10,
    },
    Part {
        runner: Runner {
            name: "long",
            what: "tests of the study and of the scenes that take a minute or more",
            run: cargo::long_tests,
        },
        minutes: 10,
    },
    Part {
        runner: Runner {
            name: "training",
            what: "the training's tests that take minutes, from nothing to a world among them",
            run: python::long_training,
        },
        minutes: 15,
    },
    Part {
        runner: Runner { name: "faults", what: "every fault at every call, in C", run: abi::run_faults },
        minutes: 30,
    },
    Part {
        runner: Runner { name: "calls", what: "long random call sequences in C", run: abi::run_calls },
        minutes: 30,
    },
    Part {
        runner: Runner { name: "directml-states", what: "saved states on DirectML", run: directml::run_states },
        minutes: 45,
    },
    Part {
        runner: Runner {
            name: "directml-budgets",
            what: "budgets, and the check of float16, on DirectML",
            run: directml::run_budgets,
        },
        minutes: 45,
    },
    Part {
        runner: Runner {
            name: "directml-parity",
            what: "parity with the oracle on DirectML",
            run: directml::run_parity,
        },
        minutes: 60,
    },
    Part {
        runner: Runner {
            name: "cairn-check-all",
            what: "every check of cairn-check on an adapter that a processor emulates",
            run: check::run_all,
        },
        minutes: 20,
    },
    Part {
        runner: Runner {
            name: "validation-all",
            what: "the other tests of Direct3D 12 over Vulkan's validation layer, worlds included",
            run: validation::run_all,
        },
        minutes: 20,
    },
    Part {
        runner: Runner {
            name: "recorder-all",
            what: "the other tests of Direct3D 12 through the recorder of its calls, worlds included",
            run: recorder::run_all,
        },
        minutes: 20,
    },
    Part {
        runner: Runner {
            name: "recorder-amd",
            what: "programs with doubles of AMD's libraries, and the study's comparison, through the recorder",
            run: recorder::run_amd_and_study,
        },
        minutes: 40,
    },
    Part {
        runner: Runner {
            name: "faults-frames",
            what: "every call to Direct3D fails, once and as on a removed device, while a host makes frames",
            run: recorder::run_faults_frames,
        },
        minutes: 30,
    },
    Part {
        runner: Runner {
            name: "faults-amd",
            what: "every call of AMD's libraries fails, once and for ever, and every call to Direct3D beneath them",
            run: recorder::run_faults_amd,
        },
        minutes: 45,
    },
    Part {
        runner: Runner {
            name: "faults-worlds",
            what: "a call of each place that calls Direct3D, DirectML or ONNX Runtime fails while a world runs on DirectML",
            run: recorder::run_faults_worlds,
        },
        minutes: 60,
    },
    Part {
        runner: Runner {
            name: "hostile-windows",
            what: "a hostile host in C on Direct3D 12, also with a world on DirectML",
            run: abi::run_all_on_windows,
        },
        minutes: 30,
    },
    Part {
        runner: Runner {
            name: "units-windows",
            what: "unit tests of the study and of other packages on Windows",
            run: study_windows::run_units,
        },
        minutes: 15,
    },
    Part {
        runner: Runner {
            name: "comparison-windows",
            what: "the study's comparison on DirectML, by shaders and by a double of AMD's library",
            run: study_windows::run_comparison,
        },
        minutes: 15,
    },
    Part {
        runner: Runner {
            name: "cycles-devices",
            what: "1,000 devices on Direct3D 12 come and go",
            run: lab::run_device_cycles,
        },
        minutes: 45,
    },
    Part {
        runner: Runner {
            name: "cycles-worlds",
            what: "20 worlds on Direct3D 12 come and go",
            run: lab::run_world_cycles,
        },
        minutes: 45,
    },
    Part {
        runner: Runner {
            name: "dist-release",
            what: "two clones in two places make the same archives",
            run: dist::run_release,
        },
        minutes: 60,
    },
    Part {
        runner: Runner { name: "soak-latents", what: "2,000 latents with flat memory", run: thorough::soak_latents },
        minutes: 15,
    },
    Part {
        runner: Runner {
            name: "soak-frames",
            what: "10,000 generated frames with flat memory",
            run: thorough::soak_frames,
        },
        minutes: 15,
    },
];

/// Shared state of the runners: the workspace, and the libraries, worlds and environments that were fetched for them.
struct Context<'a> {
    workspace: &'a Workspace,
    library: OnceLock<Result<PathBuf, String>>,
    bundles: OnceLock<Result<PathBuf, String>>,
    lpips: OnceLock<Result<PathBuf, String>>,
    python: OnceLock<Result<PathBuf, String>>,
    training: OnceLock<Result<PathBuf, String>>,
    cluster: OnceLock<Result<PathBuf, String>>,
    built: OnceLock<Result<String, String>>,
    built_for_windows: OnceLock<Result<String, String>>,
    /// Whether the absence of AMD's own libraries was reported already.
    amd_skipped: AtomicBool,
}

impl<'a> Context<'a> {
    fn new(workspace: &'a Workspace) -> Self {
        let (library, bundles, lpips) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        let (python, training, cluster) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        let (built, built_for_windows, amd_skipped) = (OnceLock::new(), OnceLock::new(), AtomicBool::new(false));
        Self { workspace, library, bundles, lpips, python, training, cluster, built, built_for_windows, amd_skipped }
    }

    /// Provides something once. A failure is cached too, so that an unreachable index is tried only once.
    fn provide(
        cell: &OnceLock<Result<PathBuf, String>>,
        how: fn(&dyn provision::Progress) -> provision::Result<PathBuf>,
    ) -> Result<&Path, String> {
        cell.get_or_init(|| how(&Console::new()).map_err(|e| e.to_string())).as_deref().map_err(String::clone)
    }

    /// The Python with the builder's and the tests' packages.
    fn python(&self) -> Result<&Path, String> {
        Self::provide(&self.python, provision::python_env)
    }

    /// The Python with JAX, for training.
    fn training_python(&self) -> Result<&Path, String> {
        Self::provide(&self.training, provision::training_env)
    }

    /// The Python with Ray.
    fn cluster_python(&self) -> Result<&Path, String> {
        Self::provide(&self.cluster, provision::cluster_env)
    }

    /// The random-weight world `name`.
    fn bundle(&self, name: &str) -> Result<PathBuf, String> {
        Ok(Self::provide(&self.bundles, provision::test_bundles)?.join(name))
    }

    /// Sets a command's variables for ONNX Runtime and the test worlds.
    fn provide_worlds(&self, command: &mut Command) -> Result<(), String> {
        command.env("CAIRN_ONNXRUNTIME", Self::provide(&self.library, provision::onnxruntime)?);
        command.env("CAIRN_TEST_BUNDLE", Self::provide(&self.bundles, provision::test_bundles)?);
        Ok(())
    }

    /// The same for a command that runs cargo's programs for Windows: Microsoft's libraries are put beside them, as beside a game, and no
    /// variable names them.
    fn provide_windows_worlds(&self, command: &mut Command) -> Result<(), String> {
        let built = self.windows_programs();
        lab::install_runtime(&built)?;
        lab::install_runtime(&built.join("deps"))?;
        command.env_remove("CAIRN_ONNXRUNTIME");
        command.env("CAIRN_TEST_BUNDLE", Self::provide(&self.bundles, provision::test_bundles)?);
        Ok(())
    }

    /// The same for a program that would fetch ONNX Runtime itself without the variable.
    fn provide_windows_tools(&self, command: &mut Command) -> Result<(), String> {
        let library = provision::onnxruntime_for_windows(&Console::new()).map_err(|e| e.to_string())?;
        command.env("CAIRN_ONNXRUNTIME", library);
        command.env("CAIRN_TEST_BUNDLE", Self::provide(&self.bundles, provision::test_bundles)?);
        Ok(())
    }

    /// Cargo's folder of programs for Windows; test programs are in its folder `deps`.
    fn windows_programs(&self) -> PathBuf {
        self.workspace.windows_programs()
    }

    /// Sets a command's variable for the weights of LPIPS.
    fn provide_lpips(&self, command: &mut Command) -> Result<(), String> {
        command.env("CAIRN_LPIPS", Self::provide(&self.lpips, provision::lpips_weights)?);
        Ok(())
    }

    /// Builds the workspace's libraries and programs, once; returns what cargo printed. `--lib` is needed because cargo puts only named targets beside the programs;
    /// `--tests` makes the features those of `cargo test`, so that nothing heavy is compiled a second time.
    fn build_programs(&self, log: &mut Log) -> Result<&str, String> {
        let build = || {
            let ended = log.run(&mut self.workspace.cargo(["build", "--workspace", "--lib", "--bins", "--tests"]))?;
            if ended.success { Ok(ended.output) } else { Err("the workspace does not build".to_owned()) }
        };
        self.built.get_or_init(build).as_deref().map_err(String::clone)
    }
}

/// What [`run`] and the threads that run its runners share.
struct Session<'a> {
    context: Context<'a>,
    /// Numbers of the runners are of these.
    chosen: Vec<&'static Runner>,
    /// The skips that are allowed; none if every skip is.
    allowed: Option<Allowed>,
    /// The commit that the record of thorough parts names, if they are recorded.
    commit: Option<String>,
}

/// What a runner has found, with its log.
struct Outcome {
    /// Among the chosen ones.
    place: usize,
    name: &'static str,
    tally: Tally,
    seconds: f64,
    log: PathBuf,
}

impl Session<'_> {
    /// Runs those of `runners` that are chosen, one after the other.
    fn run<'r>(&self, runners: impl IntoIterator<Item = &'r Runner>) -> Result<Vec<Outcome>, String> {
        let chosen = runners.into_iter().filter_map(|runner| {
            let place = self.chosen.iter().position(|chosen| chosen.name == runner.name)?;
            Some(self.run_one(place))
        });
        chosen.collect()
    }

    /// Runs the runner at this place of the chosen ones.
    fn run_one(&self, place: usize) -> Result<Outcome, String> {
        let (runner, workspace) = (self.chosen[place], self.context.workspace);
        let began = Instant::now();
        let path = workspace.target.join("xtask").join(format!("{}.log", runner.name));
        let title = format!("[{}/{}] {}: {}", place + 1, self.chosen.len(), runner.name, runner.what);
        let mut log = Log::new(&path, &title)?;
        let mut tally = (runner.run)(&self.context, &mut log).unwrap_or_else(Tally::broken);
        if tally.is_empty() {
            tally = Tally::broken("it ran no test and no check");
        }
        let (seconds, is_part) = (began.elapsed().as_secs(), parts().any(|part| part.name == runner.name));
        if is_part && seconds > 60 * thorough_record::LONGEST {
            let longest = thorough_record::LONGEST;
            tally.failures.push(format!("it took {} minutes, and a part may take {longest}: split it", seconds / 60));
        }
        if let Some(allowed) = &self.allowed {
            tally.fail_skips_unless(|skip| allowed.covers(skip));
        }
        if let Some(commit) = self.commit.as_ref().filter(|_| is_part) {
            thorough_record::append(workspace, runner.name, commit, seconds, &tally)?;
        }
        for failure in &tally.failures {
            log.line(&format!("failed: {failure}"))?;
        }
        log.end(&format!("{}: {}", runner.name, tally.with_checks()));
        Ok(Outcome { place, name: runner.name, tally, seconds: began.elapsed().as_secs_f64(), log: path })
    }
}

/// Runs the runners that `options` choose; returns whether nothing failed.
pub(crate) fn run(workspace: &Workspace, options: &TestOptions) -> Result<bool, String> {
    if options.list {
        runners().for_each(|runner| println!("{:18}{}", runner.name, runner.what));
        println!("\nWith --thorough only:");
        let record = Record::read(workspace)?;
        for part in THOROUGH {
            println!("{:18}{} ({})", part.runner.name, part.runner.what, record.duration(part));
        }
        return Ok(true);
    }
    let all: Vec<&Runner> = runners().chain(parts().filter(|_| options.thorough)).collect();
    if let Some(filter) = options.filters.iter().find(|f| !all.iter().any(|runner| runner.name.contains(f.as_str()))) {
        let [names, thorough] = [runners().collect::<Vec<_>>(), parts().collect()]
            .map(|runners| runners.iter().map(|runner| runner.name).collect::<Vec<_>>().join(", "));
        return Err(format!("no runner's name holds {filter:?}. There are {names}; with --thorough also {thorough}"));
    }
    let commit = if options.record { Some(thorough_record::commit(workspace)?) } else { None };
    let is_chosen = |runner: &&Runner| {
        options.filters.is_empty() || options.filters.iter().any(|filter| runner.name.contains(filter.as_str()))
    };
    let chosen: Vec<&Runner> = all.into_iter().filter(is_chosen).collect();
    if options.filters.is_empty() {
        disk_space::require(workspace)?;
    }
    let must_allow = std::env::var_os("CI").is_some_and(|value| value == "true" || value == "1");
    // A mistake in the list is reported everywhere.
    let allowed = Some(Allowed::read(&workspace.read("xtask/skips.toml")?)?).filter(|_| must_allow);

    if options.filters.is_empty() {
        prefetch(workspace);
    }
    let session = Session { context: Context::new(workspace), chosen, allowed, commit };
    let mut outcomes = session.run(FIRST)?;
    let queue = Mutex::new(GROUPS.iter());
    let next_group = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
    let run_groups = || session.run(std::iter::from_fn(next_group).copied().flatten());
    let both = thread::scope(|scope| {
        let (one, other) = (scope.spawn(run_groups), run_groups());
        [one.join().map_err(|_| "a runner has panicked".to_owned()).flatten(), other]
    });
    for of_one in both {
        outcomes.extend(of_one?);
    }
    outcomes.sort_by_key(|outcome| outcome.place);
    outcomes.extend(session.run(parts())?);
    Ok(report(outcomes))
}

/// Prints failures with their logs, a table of the runners, and what was skipped; returns whether nothing failed.
fn report(outcomes: Vec<Outcome>) -> bool {
    for outcome in outcomes.iter().filter(|outcome| !outcome.tally.failures.is_empty()) {
        println!("{}", describe_failures(outcome));
    }
    println!("\n{:18}{}{:>11}", "runner", Tally::column_heads(), "time");
    let mut skipped = String::new();
    let mut total = Tally::default();
    for Outcome { name, tally, seconds, .. } in outcomes {
        println!("{name:18}{}{seconds:>9.1} s", tally.columns());
        for skip in &tally.skips {
            _ = writeln!(skipped, "  {name}: {} ({})", skip.name, skip.reason);
        }
        total.add(tally);
    }
    println!("{:18}{}", "all", total.columns());
    if !skipped.is_empty() {
        println!("\nSkipped:\n{skipped}");
    }
    println!("\n{total}");
    total.failures.is_empty()
}

/// Fetches the runners' tools and packages on another thread, while the first runners compile. A runner that needs an item before it is
/// complete waits for its lock. Errors are ignored here: the runner that needs the item tries again and reports them.
fn prefetch(workspace: &Workspace) {
    let workspace = workspace.clone();
    thread::spawn(move || _ = crate::demo::provide_all(&workspace, &provision::Silent));
}

/// A failed runner's whole log, and its failures.
fn describe_failures(Outcome { name, tally, log, .. }: &Outcome) -> String {
    let output = std::fs::read_to_string(log).unwrap_or_else(|e| format!("the log is lost: {e}\n"));
    let mut text = format!("\n---- {name}: {} ----\n{output}\n", log.display());
    for failure in &tally.failures {
        _ = writeln!(text, "{name} failed: {failure}");
    }
    text
}
