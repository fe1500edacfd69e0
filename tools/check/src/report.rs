//! The report: what `report.json` holds. `docs/check.md` describes its fields.

use base64::Engine as _;
use cairn::Picture;
use serde::{Deserialize, Serialize};

use crate::finding::Verdict;

/// Version of the fields of `report.json`. It rises when a field changes its meaning or goes; new fields do not raise it.
pub const SCHEMA: u32 = 1;

/// A report of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// [`SCHEMA`] of the program that wrote it.
    pub schema: u32,
    /// Version of Cairn.
    pub cairn: String,
    /// Whether the program was compiled with optimisation. Times of the processor without it are those of nobody.
    pub optimised: bool,
    /// Whether fewer cases were run and shorter times measured.
    pub quick: bool,
    /// Seconds that the run took.
    pub seconds: f64,
    /// The worst verdict.
    pub verdict: Verdict,
    /// The machine.
    pub machine: Machine,
    /// The checks, in the order in which they ran.
    pub checks: Vec<Check>,
}

/// The machine, without names of it or of its user.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// The operating system and its version.
    pub system: String,
    /// The processor's name.
    pub processor: String,
    /// Threads that the processor runs at a time.
    pub threads: usize,
    /// Bytes of the system's memory.
    pub memory: u64,
    /// Every adapter with Direct3D 12, the system's first choice first.
    pub adapters: Vec<Adapter>,
    /// Whether a processor may emulate the judged adapter: it is a software adapter, or Wine's.
    pub emulated: bool,
    /// Index in `adapters` of the one that was judged; none without one.
    pub judged: Option<usize>,
}

impl Machine {
    /// Name of the judged adapter.
    pub fn adapter_name(&self) -> &str {
        self.judged.and_then(|index| self.adapters.get(index)).map_or("no adapter", |adapter| &adapter.name)
    }
}

/// A graphics adapter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Adapter {
    /// Its name.
    pub name: String,
    /// PCI vendor and device id.
    pub ids: [u32; 2],
    /// Bytes of its own memory.
    pub memory: u64,
    /// Version of its driver.
    pub driver: Option<String>,
    /// Whether the processor emulates it.
    pub software: bool,
    /// The highest feature level, such as `12_1`; none where no device can be made.
    pub feature_level: Option<String>,
    /// The highest shader model, such as `6.6`.
    pub shader_model: Option<String>,
}

/// A line of the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// Its name on the command line.
    pub name: String,
    /// Name of its group.
    pub group: String,
    /// What it looks at.
    pub title: String,
    /// The verdict.
    pub verdict: Verdict,
    /// What was seen, in a sentence.
    pub sentence: String,
    /// What to do, unless it passed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
    /// Seconds that it took.
    pub seconds: f64,
    /// Measured values.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub figures: Vec<Figure>,
    /// Pictures: in `report.html` only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<PictureOfCheck>,
}

/// A measured value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// What was measured.
    pub name: String,
    /// The value.
    pub value: f64,
    /// Its unit.
    pub unit: String,
}

/// A picture with its caption.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PictureOfCheck {
    /// What it shows.
    pub caption: String,
    /// The picture as PNG, in base64; not in `report.json`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub png: String,
}

impl PictureOfCheck {
    /// Encodes a picture without its alpha; `None` if that fails.
    pub(crate) fn new(caption: String, picture: &Picture) -> Option<Self> {
        let rgb = picture.pixels().iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
        let image = image::RgbImage::from_raw(picture.width(), picture.height(), rgb)?;
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, image::ImageFormat::Png).ok()?;
        Some(Self { caption, png: base64::engine::general_purpose::STANDARD.encode(bytes.into_inner()) })
    }
}

impl Report {
    /// The text of `report.json`: without pictures, which are in the page.
    ///
    /// # Errors
    /// Those of serde: none for a report of this program.
    pub fn to_json(&self) -> Result<String, String> {
        let mut short = self.clone();
        short.checks.iter_mut().for_each(|check| check.pictures.clear());
        serde_json::to_string_pretty(&short).map(|text| text + "\n").map_err(|e| e.to_string())
    }

    /// Reads the text of a `report.json`.
    ///
    /// # Errors
    /// What is wrong with it: it is no report, or one of a newer schema.
    pub fn from_json(text: &str) -> Result<Self, String> {
        /// What every schema has.
        #[derive(Deserialize)]
        struct Version {
            schema: u32,
        }
        let version: Version =
            serde_json::from_str(text).map_err(|e| format!("it is no report of cairn-check: {e}"))?;
        if version.schema != SCHEMA {
            return Err(format!(
                "its schema is {}, and this program reads {SCHEMA}: use the cairn-check of the version that wrote it",
                version.schema
            ));
        }
        serde_json::from_str(text).map_err(|e| format!("it is no report of cairn-check: {e}"))
    }

    /// The worst verdict of some checks; `CannotTell` of none.
    pub fn worst(checks: &[Check]) -> Verdict {
        checks.iter().map(|check| check.verdict).max().unwrap_or(Verdict::CannotTell)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn check(name: &str, verdict: Verdict, figures: &[(&str, f64)]) -> Check {
        Check {
            name: name.to_owned(),
            group: "times".to_owned(),
            title: format!("the title of {name}"),
            verdict,
            sentence: format!("what {name} saw"),
            remedy: (verdict != Verdict::Pass).then(|| "Do something".to_owned()),
            seconds: 1.5,
            figures: figures
                .iter()
                .map(|(name, value)| Figure { name: (*name).to_owned(), value: *value, unit: "ms".to_owned() })
                .collect(),
            pictures: Vec::new(),
        }
    }

    pub(crate) fn report(checks: Vec<Check>) -> Report {
        Report {
            schema: SCHEMA,
            cairn: "0.1.0".to_owned(),
            optimised: true,
            quick: false,
            seconds: 60.0,
            verdict: Report::worst(&checks),
            machine: Machine::default(),
            checks,
        }
    }

    /// A report of one adapter on Windows.
    pub(crate) fn of_adapter(name: &str, mut report: Report) -> Report {
        let adapter = Adapter {
            name: name.to_owned(),
            ids: [0x1002, 0x7480],
            memory: 8 << 30,
            driver: Some("1.2.3".to_owned()),
            software: false,
            feature_level: Some("12_1".to_owned()),
            shader_model: None,
        };
        report.machine = Machine {
            system: "Windows 10".to_owned(),
            processor: "a processor".to_owned(),
            adapters: vec![adapter],
            judged: Some(0),
            ..Machine::default()
        };
        report
    }

    #[test]
    fn a_report_is_read_as_it_was_written_without_its_pictures() {
        let mut written = report(vec![check("a", Verdict::Pass, &[("time", 2.0)]), check("b", Verdict::Fail, &[])]);
        written.checks[0].pictures =
            PictureOfCheck::new("a pixel".to_owned(), &Picture::new(1, 1).unwrap()).into_iter().collect();
        assert!(!written.checks[0].pictures[0].png.is_empty());
        let text = written.to_json().unwrap();
        let read = Report::from_json(&text).unwrap();
        written.checks[0].pictures.clear();
        assert_eq!(read, written);
        assert!(text.contains("\"verdict\": \"fail\""), "{text}");
    }

    #[test]
    fn other_files_and_schemas_are_refused() {
        assert!(Report::from_json("{}").unwrap_err().contains("no report of cairn-check"));
        let newer = report(Vec::new()).to_json().unwrap().replace("\"schema\": 1", "\"schema\": 2");
        assert!(Report::from_json(&newer).unwrap_err().contains("its schema is 2"));
    }

    #[test]
    fn the_worst_verdict_counts_and_no_check_shows_nothing() {
        use Verdict::{CannotTell, Fail, Pass};
        let worst = |verdicts: &[Verdict]| {
            Report::worst(&verdicts.iter().map(|verdict| check("a", *verdict, &[])).collect::<Vec<_>>())
        };
        assert_eq!(worst(&[Pass, Fail, CannotTell]), Fail);
        assert_eq!(worst(&[Pass, CannotTell]), CannotTell);
        assert_eq!(worst(&[Pass]), Pass);
        assert_eq!(worst(&[]), CannotTell);
        assert_eq!([Pass, CannotTell, Fail].map(Verdict::exit_status), [0, 3, 1]);
    }
}
