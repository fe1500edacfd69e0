//! MVTools' FlowFPS in VapourSynth.

use std::path::PathBuf;
use std::process::Command;

use cairn::{Picture, Result};
use provision::Progress;

use super::program::{Scratch, not_provided, read_pictures, run};
use super::{Interval, Row};
use crate::quality::clips::Phase;
use crate::quality::store::digest;

/// Python script that runs it, with all its settings.
const DRIVER: &str = include_str!("../../../drivers/flowfps.py");

pub(super) struct FlowFps {
    python: PathBuf,
    /// Changes to the driver's settings, as JSON.
    settings: String,
}

impl FlowFps {
    pub(super) fn open(progress: &dyn Progress) -> Result<Self> {
        Self::with("{}", progress)
    }

    /// With changes to the driver's settings, as JSON: `{"RENDER": {"mask": 0}}`.
    pub(super) fn with(settings: &str, progress: &dyn Progress) -> Result<Self> {
        let python = provision::baselines::mvtools(progress).map_err(|e| not_provided(&e))?;
        Ok(Self { python, settings: settings.to_owned() })
    }
}

impl Row for FlowFps {
    fn version(&self) -> String {
        "VapourSynth 81, MVTools 29, the settings of `tools/study/drivers/flowfps.py`".into()
    }

    fn key(&self) -> String {
        format!("{} {}", self.version(), digest([DRIVER.as_bytes()]))
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let scratch = Scratch::new()?;
        let (width, height) = interval.current().size();
        let multiplier = Phase::common(phases);
        let numbers = [width, height, multiplier, interval.at as u32].map(|number| number.to_string());
        let output = scratch.path("frames.rgb");
        let mut command = Command::new(&self.python);
        command.arg(scratch.text("flowfps.py", DRIVER)?).args(numbers);
        command.arg(scratch.pictures("anchors.rgb", interval.anchors)?).arg(&output).arg(&self.settings);
        run("MVTools", &mut command)?;
        super::at_phases("MVTools", &read_pictures(&output, (width, height))?, phases)
    }
}
