//! AMD's FSR frame generation: AMD's own DLLs, called through Cairn by a driver on Direct3D 12, on Windows or in the lab.

use std::cell::RefCell;
use std::ffi::OsString;
use std::fs;
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::rc::{Rc, Weak};

use cairn::framegen::AnchorPair;
use cairn::guidance::{Guidance, picture_flow};
use cairn::{Error, ErrorKind, Picture, Result};
use fsr_driver::{INTERVAL_MS, Request, read_frame, read_greeting};
use provision::{lab, tools};

use super::program::not_provided;
use super::{Interval, Row};
use crate::progress::Progress;
use crate::quality::clips::Phase;
use crate::quality::store::digest_of_sources;
use media::describe_io;

/// Anchors before the interval's two that the provider gets first, the first of them with a reset, where [`CHECKED`] says so. Provider 3.1.5
/// makes the same frames bit for bit without them, which takes a third of the time.
pub(super) const HISTORY: usize = 2;
/// Of so many intervals one is made with and without earlier anchors, and both frames must be equal.
const CHECKED: usize = 8;

/// The variable with the folder of AMD's libraries.
const VARIABLE: &str = "CAIRN_FFX_DIR";
/// AMD's library with the provider.
const LIBRARY: &str = "amd_fidelityfx_framegeneration_dx12.dll";
const REMEDY: &str = "Set CAIRN_FFX_DIR to the folder of AMD's signed DLLs (docs/fsr.md), or leave the rows fsr out";
/// The driver's package and program.
const DRIVER: &str = "fsr-driver";
/// Name in errors.
const NAME: &str = "AMD FSR";
/// Sources that decide a frame besides its anchors, motion and depth: the driver, and Cairn's use of AMD's libraries.
const SOURCES: [&str; 3] = ["tools/study/drivers/fsr/src", "src/ffx", "src/gpu"];
/// Single files of them.
const FILES: [&str; 3] = ["src/framegen/fsr.rs", "src/framegen/device.rs", "src/framegen/densify.rs"];

/// Sources of `picture_flow`.
const FLOW: &str = "src/guidance";

/// Where motion and depth come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Motion {
    /// The interval, true or as an engine gives them.
    Given,
    /// `picture_flow`, with constant depth.
    Found,
}

pub(super) struct Fsr {
    motion: Motion,
    driver: Rc<RefCell<Driver>>,
    key: String,
    extractor: picture_flow::Extractor,
    /// Intervals of which frames were made.
    made: usize,
}

impl Fsr {
    /// Starts the driver, or takes that of another row.
    ///
    /// # Errors
    /// `CAIRN_FFX_DIR` names no folder with AMD's libraries, there is no Windows and no lab, the driver does not build, or the libraries
    /// have no provider that works.
    pub(super) fn open(motion: Motion, progress: &Progress) -> Result<Self> {
        let folder = libraries(std::env::var_os(VARIABLE))?;
        let driver = Driver::shared(&folder, progress)?;
        let repository = provision::repository();
        let mut parts = vec![vec![HISTORY as u8], driver.borrow().version.clone().into_bytes()];
        for path in FILES.map(|file| repository.join(file)).into_iter().chain([folder.join(LIBRARY)]) {
            parts.push(fs::read(&path).map_err(|e| describe_io("cannot be read", &path, &e))?);
        }
        let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
        let flow = (motion == Motion::Found).then_some(FLOW);
        let sources: Vec<PathBuf> = SOURCES.into_iter().chain(flow).map(|source| repository.join(source)).collect();
        let key = digest_of_sources(&sources, &parts)?;
        Ok(Self { motion, driver, key, extractor: picture_flow::Extractor::new(), made: 0 })
    }

    /// The frame of an interval after up to `earlier` anchors before it.
    fn frame(&mut self, interval: &Interval<'_>, earlier: usize) -> Result<Picture> {
        let anchors = &interval.anchors[interval.at.saturating_sub(earlier)..=interval.at + 1];
        let known: Vec<Guidance> = match self.motion {
            Motion::Given => given(interval, anchors.len() - 1)?.into_iter().cloned().collect(),
            Motion::Found => {
                anchors.windows(2).map(|pair| self.found(&pair[0], &pair[1])).collect::<Result<Vec<Guidance>>>()?
            }
        };
        // Each anchor but the first has guidance.
        let anchors = &anchors[anchors.len() - 1 - known.len()..];
        let mut frame = None;
        for (number, (pair, guidance)) in anchors.windows(2).zip(&known).enumerate() {
            let pair = AnchorPair::new(&pair[0], &pair[1], guidance)?;
            frame = Some(self.driver.borrow_mut().generate(&pair, number == 0)?);
        }
        frame.ok_or_else(|| Error::new(ErrorKind::InvalidArgument, "an interval has two anchors"))
    }

    fn found(&mut self, previous: &Picture, current: &Picture) -> Result<Guidance> {
        let (width, height) = current.size();
        let mut guidance = Guidance::new(width, height, picture_flow::PROJECTION)?;
        self.extractor.extract(previous, current, &mut guidance)?;
        Ok(guidance)
    }
}

impl Row for Fsr {
    fn version(&self) -> String {
        let place = if cfg!(windows) { "" } else { " on the lab's software Direct3D 12" };
        format!(
            "provider {}{place}, of AMD's signed DLLs; motion in pixels, depth with 0 near, sRGB in 8 bits, {INTERVAL_MS:.1} ms between \
             anchors; one frame in {CHECKED} made again after up to {HISTORY} earlier anchors, with the same bits",
            self.driver.borrow().version
        )
    }

    fn key(&self) -> String {
        self.key.clone()
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let frame = self.frame(interval, 0)?;
        if self.made.is_multiple_of(CHECKED) && self.frame(interval, HISTORY)?.rgba() != frame.rgba() {
            return Err(fail(format!(
                "this provider, {}, makes another frame after earlier anchors than without them",
                self.driver.borrow().version
            ))
            .remedy("Leave the rows fsr out, or give every interval its earlier anchors (tools/study/src/quality/rows/fsr.rs)"));
        }
        self.made += 1;
        Ok(vec![frame; phases.len()])
    }
}

/// Motion and depth of the later anchor of each of the last `pairs` pairs up to the interval, whose own are last. Without those of the interval's
/// earlier anchor they are the only ones.
fn given<'a>(interval: &Interval<'a>, pairs: usize) -> Result<Vec<&'a Guidance>> {
    let last = interval
        .guidance
        .ok_or_else(|| Error::new(ErrorKind::InvalidArgument, "nobody knows the clip's motion and depth"))?;
    let history = if interval.before.is_some() { interval.history } else { &[] };
    let played = history.iter().chain(interval.before).chain([last]);
    Ok(played.clone().skip(played.count().saturating_sub(pairs)).collect())
}

/// The folder of AMD's libraries in the variable's value.
///
/// # Errors
/// `Unsupported` if it names none.
fn libraries(value: Option<OsString>) -> Result<PathBuf> {
    let refuse = |cause: String| Error::new(ErrorKind::Unsupported, cause).field(VARIABLE).remedy(REMEDY);
    let folder = value.filter(|folder| !folder.is_empty()).map(PathBuf::from);
    let folder =
        folder.ok_or_else(|| refuse("it names no folder of AMD's DLLs, which may not be redistributed".into()))?;
    let folder = std::path::absolute(&folder).map_err(|e| refuse(e.to_string()))?;
    if !folder.join(LIBRARY).is_file() {
        return Err(refuse(format!("there is no {LIBRARY} in {}", folder.display())));
    }
    Ok(folder)
}

thread_local! {
    /// The driver of this thread's rows: it has one provider, and a program in the lab takes seconds to start.
    static DRIVER_IN_USE: RefCell<Weak<RefCell<Driver>>> = const { RefCell::new(Weak::new()) };
}

/// The driver's process, which ends when it is dropped.
struct Driver {
    child: Child,
    to: BufWriter<ChildStdin>,
    from: BufReader<ChildStdout>,
    /// The provider's version.
    version: String,
}

impl Driver {
    fn shared(folder: &Path, progress: &Progress) -> Result<Rc<RefCell<Self>>> {
        DRIVER_IN_USE.with(|known| {
            if let Some(driver) = known.borrow().upgrade() {
                return Ok(driver);
            }
            let driver = Rc::new(RefCell::new(Self::start(folder, progress)?));
            *known.borrow_mut() = Rc::downgrade(&driver);
            Ok(driver)
        })
    }

    fn start(folder: &Path, progress: &Progress) -> Result<Self> {
        let mut command = if cfg!(windows) {
            Command::new(build(progress)?)
        } else {
            lab::possible().map_err(|e| not_provided(&e))?;
            let lab = lab::lab(progress).map_err(|e| not_provided(&e))?;
            lab.command(&build(progress)?).map_err(|e| not_provided(&e))?
        };
        progress.phase("starting AMD's FSR");
        // Ctrl-C must reach this program only, which then ends the driver.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        command.env(VARIABLE, folder).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().map_err(|e| fail(format!("the driver does not start: {e}")))?;
        let (Some(to), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(fail("the driver has no pipes".into()));
        };
        let (to, mut from) = (BufWriter::new(to), BufReader::new(from));
        let version = read_greeting(&mut from).map_err(|e| fail(e.to_string()).remedy(REMEDY))?;
        Ok(Self { child, to, from, version })
    }

    fn generate(&mut self, pair: &AnchorPair<'_>, starts: bool) -> Result<Picture> {
        Request::write(pair, starts, &mut self.to)?;
        read_frame(&mut self.from, pair.size()).map_err(|e| fail(e.to_string()))
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn fail(cause: String) -> Error {
    Error::new(ErrorKind::Unsupported, cause).field(NAME)
}

/// Builds the driver for Windows with the workspace's cargo, if it is not built yet; returns its path.
///
/// # Errors
/// No cargo, no linker for Windows, or it does not compile.
fn build(progress: &Progress) -> Result<PathBuf> {
    progress.phase("building the driver of AMD's FSR for Windows");
    let mut command = Command::new(tools::cargo());
    command.args(["build", "--release", "--package", DRIVER, "--message-format", "json-render-diagnostics"]);
    if !cfg!(windows) {
        tools::rust_target(tools::WINDOWS_TARGET, progress).map_err(|e| not_provided(&e))?;
        if tools::mingw(progress).map_err(|e| not_provided(&e))? != tools::Mingw::Gcc {
            return Err(fail("MinGW-w64's GCC is needed to link programs for the lab".into())
                .remedy("apt install gcc-mingw-w64-x86-64"));
        }
        command.args(["--target", tools::WINDOWS_TARGET]);
    }
    let printed = super::program::run("cargo", command.current_dir(provision::repository()))?;
    program_in(&printed).ok_or_else(|| fail("cargo names no program that it built".into()))
}

/// The driver's path in cargo's messages.
fn program_in(messages: &str) -> Option<PathBuf> {
    let mut messages = messages.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    let driver = |message: serde_json::Value| {
        (message["target"]["name"] == DRIVER).then(|| message["executable"].as_str().map(PathBuf::from)).flatten()
    };
    messages.find_map(driver)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_amds_libraries_the_reason_and_a_remedy_are_given() {
        let empty = tempfile::tempdir().unwrap();
        for (value, part) in [
            (None, "names no folder"),
            (Some(OsString::new()), "names no folder"),
            (Some(empty.path().into()), LIBRARY),
        ] {
            let error = libraries(value).unwrap_err();
            assert_eq!((error.kind(), error.offending_field()), (ErrorKind::Unsupported, Some(VARIABLE)));
            assert!(error.to_string().contains(part), "{error}");
            assert!(error.remedy_text().is_some_and(|remedy| remedy.contains("docs/fsr.md")), "{error}");
        }
        fs::write(empty.path().join(LIBRARY), "MZ").unwrap();
        assert_eq!(libraries(Some(empty.path().into())).unwrap(), empty.path());
    }

    #[test]
    fn the_program_is_the_one_that_cargo_names() {
        let messages = r#"{"reason":"compiler-artifact","target":{"name":"cairn"},"executable":null}
{"reason":"compiler-artifact","target":{"name":"fsr_driver"},"executable":null}
{"reason":"compiler-artifact","target":{"name":"fsr-driver"},"executable":"/t/release/fsr-driver.exe"}
{"reason":"build-finished","success":true}
no message"#;
        assert_eq!(program_in(messages), Some("/t/release/fsr-driver.exe".into()));
        assert_eq!(program_in(r#"{"target":{"name":"fsr-driver"},"executable":null}"#), None);
    }

    #[test]
    fn every_played_anchor_has_its_own_motion_and_a_gap_ends_the_history() {
        let guidance = |depth: f32| {
            let mut guidance = Guidance::new(4, 4, picture_flow::PROJECTION).unwrap();
            guidance.depth_mut().fill(depth);
            guidance
        };
        let history = [guidance(0.1), guidance(0.2)];
        let (before, last) = (guidance(0.3), guidance(0.4));
        let anchors = vec![Picture::new(4, 4).unwrap(); 5];
        let depths = |interval: &Interval<'_>| {
            let played = given(interval, interval.at + 1).unwrap();
            played.iter().map(|guidance| guidance.depth().depth()[0]).collect::<Vec<f32>>()
        };
        let interval = Interval {
            anchors: &anchors,
            at: 3,
            guidance: Some(&last),
            before: Some(&before),
            overlay: None,
            history: &history,
        };
        assert_eq!(depths(&interval), [0.1, 0.2, 0.3, 0.4]);
        assert_eq!(depths(&Interval { before: None, ..interval }), [0.4]);
        let interval = Interval {
            anchors: &anchors[2..],
            at: 1,
            guidance: Some(&last),
            before: Some(&before),
            overlay: None,
            history: &history,
        };
        assert_eq!(depths(&interval), [0.3, 0.4]);
        assert_eq!(given(&interval, 1).unwrap()[0].depth().depth()[0], 0.4);
        assert!(given(&Interval { guidance: None, ..interval }, 1).is_err());
    }
}
