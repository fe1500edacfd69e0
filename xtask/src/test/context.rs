//! What runners share: everything that is built or fetched for them once.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use provision::Console;

use super::lab;
use crate::shell::Log;
use crate::workspace::Workspace;

/// Shared state of the runners: the workspace, and the libraries, worlds and environments that were fetched for them.
pub(super) struct Context<'a> {
    pub(super) workspace: &'a Workspace,
    pub(super) library: OnceLock<Result<PathBuf, String>>,
    pub(super) bundles: OnceLock<Result<PathBuf, String>>,
    pub(super) lpips: OnceLock<Result<PathBuf, String>>,
    pub(super) python: OnceLock<Result<PathBuf, String>>,
    pub(super) training: OnceLock<Result<PathBuf, String>>,
    pub(super) cluster: OnceLock<Result<PathBuf, String>>,
    pub(super) built: OnceLock<Result<String, String>>,
    pub(super) built_for_windows: OnceLock<Result<String, String>>,
    /// Whether the absence of AMD's own libraries was reported already.
    pub(super) amd_skipped: AtomicBool,
}

impl<'a> Context<'a> {
    pub(super) fn new(workspace: &'a Workspace) -> Self {
        let (library, bundles, lpips) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        let (python, training, cluster) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        let (built, built_for_windows, amd_skipped) = (OnceLock::new(), OnceLock::new(), AtomicBool::new(false));
        Self { workspace, library, bundles, lpips, python, training, cluster, built, built_for_windows, amd_skipped }
    }

    /// Provides something once. A failure is cached too, so that an unreachable index is tried only once.
    pub(super) fn provide(
        cell: &OnceLock<Result<PathBuf, String>>,
        how: fn(&dyn provision::Progress) -> provision::Result<PathBuf>,
    ) -> Result<&Path, String> {
        cell.get_or_init(|| how(&Console::new()).map_err(|e| e.to_string())).as_deref().map_err(String::clone)
    }

    /// The Python with the builder's and the tests' packages.
    pub(super) fn python(&self) -> Result<&Path, String> {
        Self::provide(&self.python, provision::python_env)
    }

    /// The Python with JAX, for training.
    pub(super) fn training_python(&self) -> Result<&Path, String> {
        Self::provide(&self.training, provision::training_env)
    }

    /// The Python with Ray.
    pub(super) fn cluster_python(&self) -> Result<&Path, String> {
        Self::provide(&self.cluster, provision::cluster_env)
    }

    /// The random-weight world `name`.
    pub(super) fn bundle(&self, name: &str) -> Result<PathBuf, String> {
        Ok(Self::provide(&self.bundles, provision::test_bundles)?.join(name))
    }

    /// Sets a command's variables for ONNX Runtime and the test worlds.
    pub(super) fn provide_worlds(&self, command: &mut Command) -> Result<(), String> {
        command.env("CAIRN_ONNXRUNTIME", Self::provide(&self.library, provision::onnxruntime)?);
        command.env("CAIRN_TEST_BUNDLE", Self::provide(&self.bundles, provision::test_bundles)?);
        Ok(())
    }

    /// The same for a command that runs cargo's programs for Windows: Microsoft's libraries are put beside them, as beside a game, and no
    /// variable names them.
    pub(super) fn provide_windows_worlds(&self, command: &mut Command) -> Result<(), String> {
        let built = self.windows_programs();
        lab::install_runtime(&built)?;
        lab::install_runtime(&built.join("deps"))?;
        command.env_remove("CAIRN_ONNXRUNTIME");
        command.env("CAIRN_TEST_BUNDLE", Self::provide(&self.bundles, provision::test_bundles)?);
        Ok(())
    }

    /// The same for a program that would fetch ONNX Runtime itself without the variable.
    pub(super) fn provide_windows_tools(&self, command: &mut Command) -> Result<(), String> {
        let library = provision::onnxruntime_for_windows(&Console::new()).map_err(|e| e.to_string())?;
        command.env("CAIRN_ONNXRUNTIME", library);
        command.env("CAIRN_TEST_BUNDLE", Self::provide(&self.bundles, provision::test_bundles)?);
        Ok(())
    }

    /// Sets a command's variables for the test worlds and for an ONNX Runtime that has the plugin of its WebGPU provider beside it.
    pub(super) fn provide_webgpu_worlds(&self, command: &mut Command) -> Result<(), String> {
        let library = provision::onnxruntime_with_webgpu(&Console::new()).map_err(|e| e.to_string())?;
        command.env("CAIRN_ONNXRUNTIME", library);
        command.env("CAIRN_TEST_BUNDLE", Self::provide(&self.bundles, provision::test_bundles)?);
        Ok(())
    }

    /// Cargo's folder of programs for Windows; test programs are in its folder `deps`.
    pub(super) fn windows_programs(&self) -> PathBuf {
        self.workspace.windows_programs()
    }

    /// Sets a command's variable for the weights of LPIPS.
    pub(super) fn provide_lpips(&self, command: &mut Command) -> Result<(), String> {
        command.env("CAIRN_LPIPS", Self::provide(&self.lpips, provision::lpips_weights)?);
        Ok(())
    }

    /// Builds the workspace's libraries and programs, once; returns what cargo printed. `--lib` is needed because cargo puts only named targets beside the programs;
    /// `--tests` makes the features those of `cargo test`, so that nothing heavy is compiled a second time.
    pub(super) fn build_programs(&self, log: &mut Log) -> Result<&str, String> {
        let build = || {
            let mut command = self.workspace.cargo(["build", "--workspace", "--lib", "--bins", "--tests"]);
            // Windows replaces no program that runs, as this one does.
            if cfg!(windows) {
                command.args(["--exclude", "xtask"]);
            }
            let ended = log.run(&mut command)?;
            if ended.success { Ok(ended.output) } else { Err("the workspace does not build".to_owned()) }
        };
        self.built.get_or_init(build).as_deref().map_err(String::clone)
    }
}
