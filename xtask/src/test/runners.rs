//! The runners: those of every run, and the parts of the thorough tests.

use super::tally::Tally;
use super::{
    Context, abi, book, browser, cargo, check, csharp, directml, dist, ffx, host, lab, nightly, python, readme,
    recorder, repository, shaders, study, study_windows, thorough, unreal, validation, webgpu, wheels, windows_build,
};
use crate::shell::Log;

/// A named part of the tests. Its tally is counted; an error instead of a tally counts as one failure.
pub(super) struct Runner {
    pub(super) name: &'static str,
    pub(super) what: &'static str,
    pub(super) run: fn(&Context<'_>, &mut Log) -> Result<Tally, String>,
}

/// Before all others: quick and often failing ones, then builds whose compiled code the others use.
pub(super) const FIRST: &[Runner] = &[
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
pub(super) const GROUPS: &[&[Runner]] = &[
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
    &[Runner {
        name: "webgpu",
        what: "worlds on ONNX Runtime's WebGPU provider, over a software Vulkan driver",
        run: webgpu::run,
    }],
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
pub(super) fn runners() -> impl Iterator<Item = &'static Runner> {
    FIRST.iter().chain(GROUPS.iter().copied().flatten())
}

/// The runners that run with `--thorough` only.
pub(super) fn parts() -> impl Iterator<Item = &'static Runner> {
    THOROUGH.iter().map(|part| &part.runner)
}

/// A part of the thorough tests, of at most [`LONGEST`](super::thorough_record::LONGEST) minutes.
pub(super) struct Part {
    pub(super) runner: Runner,
    /// Estimate for two cores, with the compiler's time; recorded durations replace it.
    pub(super) minutes: u32,
}

/// Run with `--thorough` only.
pub(super) const THOROUGH: &[Part] = &[
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
            name: "webgpu-all",
            what: "worlds on WebGPU: all their tests, 500 latents, states of other devices, failing calls, and parity with the oracle",
            run: webgpu::run_thorough,
        },
        minutes: 40,
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
            name: "faults-amd-swapchain",
            what: "every call of AMD's swap chain fails, once and for ever, and every call to Direct3D beneath it",
            run: recorder::run_faults_amd_swapchain,
        },
        minutes: 30,
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
