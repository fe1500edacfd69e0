//! Hosts, built and run as their authors do: the loader header, `samples/host-c` with its video, and `samples/host-d3d12`.

mod frames;
mod loader;
mod sample;
pub(super) mod screen;
mod windows;

use std::path::{Path, PathBuf};
use std::process::Command;

use provision::tools;

use super::Context;
use super::abi::{self, Compiler, STRICT};
use super::tally::{Skip, Tally};
use crate::shell::Log;
use crate::workspace;

pub(super) use windows::{by_cmake as windows_sample, run as run_windows};

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let work = context.workspace.target.join("xtask").join("host");
    workspace::make_empty(&work)?;
    let library = abi::library(context, log)?;
    let mut tally = Tally::default();
    let Some(cc) = tools::on_path("cc") else {
        tally.skips.push(Skip { name: "hosts in C".into(), reason: "needs cc: install a C compiler".into() });
        return Ok(tally);
    };
    let setup = HostSetup { include: context.workspace.root.join("include"), work, library, cc };
    loader::run(context, log, &setup, &mut tally)?;
    sample::run(context, log, &setup, &mut tally)?;
    Ok(tally)
}

/// Folders and tools of these tests.
struct HostSetup {
    include: PathBuf,
    /// An empty folder for output.
    work: PathBuf,
    /// Cairn's shared library.
    library: PathBuf,
    /// The system's C compiler.
    cc: PathBuf,
}

impl HostSetup {
    /// The C11 compiler with strict warnings.
    fn compile(&self) -> Command {
        let mut command = Command::new(&self.cc);
        command.arg("-std=c11").args(STRICT).arg("-g").arg("-I").arg(&self.include);
        command
    }

    fn library_folder(&self) -> &Path {
        self.library.parent().unwrap_or(Path::new("."))
    }
}

/// Whether `compiler` accepts a source, with every warning an error.
fn check_compiles(
    log: &mut Log,
    compiler: &Compiler,
    include: &Path,
    source: &Path,
    tally: &mut Tally,
) -> Result<(), String> {
    let mut command = Command::new(&compiler.program);
    command.args(compiler.first).args(if compiler.cpp { ["-std=c++17", "-xc++"] } else { ["-std=c11", "-xc"] });
    command.args(STRICT).arg("-I").arg(include).arg("-fsyntax-only").arg(source);
    let ended = log.run(&mut command)?;
    let name = compiler.program.display();
    tally.check((!ended.success).then(|| format!("{name} does not take {}", source.display())));
    Ok(())
}
