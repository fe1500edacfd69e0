//! The study for Windows, in the lab or on Windows itself: tests of its program, and the paper's experiment at a small size on DirectML, with
//! generated frames first by the library's shaders and then by the test double of AMD's libraries.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use serde_json::Value;

use super::amd::Amd;
use super::ffx::{AMD, DOUBLE};
use super::study::missing;
use super::tally::Tally;
use super::{Context, lab, windows_build};
use crate::shell::{CommandOutput, Log};
use crate::workspace;

/// The test programs whose results may depend on the system: processes, streams, files and their locks, videos.
const PROGRAMS: [&str; 5] = ["compare", "media", "program", "score", "sweep"];
/// Tests among these that are slow and run on the processor: the thorough part `comparison-windows` does the same on DirectML.
const LONG: [&str; 2] =
    ["a_comparison_is_made_once_and_goes_on_where_it_was_broken_off", "a_sweep_is_made_once_and_nothing_whole_again"];

/// What the double emulates: the provider that computes its frames as AMD's analytic one does.
const ROLE: &str = "sdk 2.1\noffers 0xf600000000c01006 3.1.6\n";
/// The double's log of its calls.
const CALLS: &str = "calls.txt";
const JUDGEMENT: &str = "judgement.txt";

/// A little more than a fifteenth of a second of one scene: two anchors, so one frame between them.
const SHORT: [&str; 8] = ["--scene", "sword", "--seconds", "0.0667", "--size", "128x72", "--device", "d3d12"];
const SCENE_FOLDER: &str = "sword-41";
const PICTURES: usize = 3;
/// The frame between the anchors.
const GENERATED_FRAME: u32 = 1;
/// Every branch: the number of its frames, and how many of them a generator makes.
const BRANCHES: [(&str, u64, u64); 6] = [
    ("coherence", 3, 1),
    ("coherence-best", 3, 1),
    ("baseline", 3, 0),
    ("baseline-doubled", 3, 0),
    ("heavy", 3, 1),
    ("decoded-60", 5, 0),
];
/// Libraries used on a graphics device, and whether their files contain a version: Wine's own do not.
const LIBRARIES: [(&str, bool); 3] = [("onnxruntime.dll", true), ("DirectML.dll", true), ("d3d12.dll", false)];

/// The study's own tests.
pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::skip_unless_possible("the study's own tests on Windows")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    context.with_and_without_amd(&mut tally, |amd| own_tests(context, log, amd))?;
    Ok(tally)
}

/// The comparison on DirectML, by shaders and by AMD's libraries.
pub(super) fn run_comparison(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::skip_unless_possible("the study's comparison on DirectML")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    context.build_for_windows(log)?;
    let folder = context.workspace.target.join("xtask").join("study-windows");
    workspace::remove(&folder)?;
    let comparison = Comparison::new(context, &folder)?;
    comparison.by_shaders(log, &mut tally)?;
    comparison.by_amd(log, &mut tally)?;
    if let Some(own) = Amd::own()? {
        Comparison { out: folder.join("by-amd"), amd: own, ..comparison }.run_and_check("fsr", 0, log, &mut tally)?;
    }
    Ok(tally)
}

/// The comparison by shaders in a folder of this name, which is made anew: for runs that look at its calls instead of its results.
pub(super) fn comparison_by_shaders(context: &Context<'_>, folder: &str) -> Result<Command, String> {
    let folder = context.workspace.target.join("xtask").join(folder);
    workspace::remove(&folder)?;
    Comparison::new(context, &folder)?.command("shader", &Amd::None)
}

/// The study's tests of its program.
fn own_tests(context: &Context<'_>, log: &mut Log, amd: &Amd) -> Result<Tally, String> {
    let mut command = context.windows_tests(PROGRAMS, log)?;
    // By full name: another test whose name contains one of them still runs, and so does a renamed one.
    command.args(["--", "--exact"]).args(LONG.iter().flat_map(|name| ["--skip", name]));
    run_tests(context, log, &mut command, amd)
}

/// Unit tests of the study and of other packages, which every run runs on this system.
pub(super) fn run_units(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::skip_unless_possible("unit tests on Windows")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    context.with_and_without_amd(&mut tally, |amd| {
        let mut command = context.windows_unit_tests(log)?;
        run_tests(context, log, &mut command, amd)
    })?;
    Ok(tally)
}

fn run_tests(context: &Context<'_>, log: &mut Log, command: &mut Command, amd: &Amd) -> Result<Tally, String> {
    context.provide_windows_tools(command)?;
    context.provide_lpips(command)?;
    amd.provide(command);
    windows_build::run(command, &[], log)
}

/// A comparison that is run twice in one folder.
struct Comparison<'a> {
    context: &'a Context<'a>,
    program: PathBuf,
    out: PathBuf,
    /// The double, or AMD's own libraries.
    amd: Amd,
}

impl<'a> Comparison<'a> {
    /// Copies the double under AMD's file name into a folder of its own.
    fn new(context: &'a Context<'a>, folder: &Path) -> Result<Self, String> {
        let built = context.windows_programs();
        let amd = folder.join("amd");
        let failed = |e: std::io::Error| format!("{}: {e}", amd.display());
        fs::create_dir_all(&amd).map_err(failed)?;
        fs::copy(built.join(DOUBLE), amd.join(AMD)).map_err(failed)?;
        fs::write(amd.join(format!("{AMD}.txt")), ROLE).map_err(failed)?;
        Ok(Self { context, program: built.join("study.exe"), out: folder.join("compare"), amd: Amd::Double(amd) })
    }

    /// The comparison with these libraries of AMD's.
    fn command(&self, generator: &str, amd: &Amd) -> Result<Command, String> {
        let mut command = lab::lab_run()?;
        command.arg(&self.program).arg("compare").args(SHORT).args(["--quiet", "--generator", generator]);
        command.arg("--out").arg(&self.out).current_dir(&self.context.workspace.root);
        amd.provide(&mut command);
        self.context.provide_windows_tools(&mut command)?;
        self.context.provide_lpips(&mut command)?;
        Ok(command)
    }

    /// Runs the comparison with these libraries of AMD's.
    fn run(&self, generator: &str, amd: &Amd, log: &mut Log) -> Result<CommandOutput, String> {
        log.run(&mut self.command(generator, amd)?)
    }

    /// Runs it, requires success, and returns its output.
    fn compare(&self, generator: &str, log: &mut Log) -> Result<String, String> {
        let ended = self.run(generator, &self.amd, log)?;
        if ended.success { Ok(ended.output) } else { Err(format!("the comparison with {generator} failed")) }
    }

    /// Runs it where `kept` branches exist already, and checks all of its output.
    fn run_and_check(&self, generator: &str, kept: u32, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        let output = self.compare(generator, log)?;
        tally.check(lacks(&output, &format!("6 rollouts, {kept} of them kept")));
        self.manifests(generator, tally)?;
        self.anchors(tally)?;
        self.series(tally)?;
        self.report(generator, tally)
    }

    fn scene_folder(&self) -> PathBuf {
        self.out.join(SCENE_FOLDER)
    }

    /// Every branch on DirectML, with generated frames by shaders.
    fn by_shaders(&self, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        self.run_and_check("shader", 0, log, tally)?;
        tally.test((self.calls()? != [0, 0]).then(|| "shaders ask AMD's libraries for frames".to_owned()));
        Ok(())
    }

    /// The same folder with AMD's libraries: branches that do not depend on them are kept.
    fn by_amd(&self, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        let (before, frames) = (files(&self.scene_folder())?, self.generated_frames()?);
        // Missing libraries are reported, and nothing that exists is lost.
        let nowhere = self.run("fsr", &Amd::Double(self.out.join("figures")), log)?;
        tally.test(nowhere.success.then(|| "frames were made by libraries that are not there".to_owned()));
        for words in ["sword 41, coherence: ", AMD, "AMD's libraries were not found"] {
            tally.check(lacks(&nowhere.output, words));
        }
        tally
            .test((files(&self.scene_folder())? != before).then(|| "missing libraries cost what was there".to_owned()));

        self.run_and_check("fsr", 3, log, tally)?;
        let after = files(&self.scene_folder())?;
        for (branch, _, generated) in BRANCHES.into_iter().chain([("truth", 0, 0)]) {
            let files_of =
                |all: &[FileStamp]| all.iter().filter(|file| file.is_in(branch)).cloned().collect::<Vec<_>>();
            let (before, after) = (files_of(&before), files_of(&after));
            if generated == 0 {
                tally.test((before != after || before.is_empty()).then(|| format!("{branch} was made again")));
            } else {
                let kept = after.iter().filter(|file| before.contains(file)).count();
                tally.test((kept > 0).then(|| format!("{kept} files of {branch} were kept of another generator")));
            }
        }
        for ((branch, shader), (_, amd)) in frames.iter().zip(self.generated_frames()?) {
            tally
                .test((*shader == amd).then(|| format!("{branch} has the same frame by shaders and by AMD's library")));
        }
        let [calls, complaints] = self.calls()?;
        tally.test((calls == 0).then(|| "AMD's library was never asked".to_owned()));
        tally.test((complaints > 0).then(|| format!("{complaints} calls of AMD's library were not as they must be")));

        // A further run makes nothing again: neither rollouts nor metrics nor the video.
        let output = self.compare("fsr", log)?;
        tally.check(lacks(&output, "6 rollouts, 6 of them kept"));
        tally.test(
            (files(&self.scene_folder())? != after).then(|| "something was made again that was whole".to_owned()),
        );
        tally.test((self.calls()? != [calls, 0]).then(|| "AMD's library was asked for what was there".to_owned()));
        Ok(())
    }

    /// The manifests name the device and the generator, and their files exist.
    fn manifests(&self, generator: &str, tally: &mut Tally) -> Result<(), String> {
        for (branch, presented, generated) in BRANCHES {
            let folder = self.scene_folder().join(branch);
            let manifest = json(&folder.join("manifest.json"))?;
            let generator = if generated > 0 { generator } else { "cpu" };
            let versions = &manifest["versions"];
            let mut equal = |what: &str, found: &Value, expected: Value| {
                tally.check((*found != expected).then(|| format!("{branch}: {what} is {found}, not {expected}")));
            };
            equal("complete", &manifest["complete"], true.into());
            equal("the frames presented", &manifest["counts"]["presented"], presented.into());
            equal("the frames generated", &manifest["counts"]["generated"], generated.into());
            equal("the generator", &versions["generator"], generator.into());
            // A manifest without a generator means the processor.
            let named = if generated > 0 { generator.into() } else { Value::Null };
            equal("the generator asked for", &manifest["settings"]["generator"], named);

            let contains = |item: &Value, words: &str| item.as_str().is_some_and(|text| text.contains(words));
            let device = &manifest["settings"]["device"];
            tally.check((!contains(device, "d3d12:")).then(|| format!("{branch}: the device is {device}")));
            let runtime = &versions["device"];
            tally.check((!contains(runtime, "DirectML on ")).then(|| format!("{branch}: the world ran on {runtime}")));
            let adapter = &versions["adapter"];
            let named =
                ["name", "driver"].iter().all(|item| adapter[item].as_str().is_some_and(|text| !text.is_empty()));
            tally.check((!named).then(|| format!("{branch}: the adapter is {adapter}")));
            tally.check((!contains(&versions["os"], "Windows")).then(|| format!("{branch}: {}", versions["os"])));
            let libraries = versions["libraries"].as_array().map(Vec::as_slice).unwrap_or_default();
            let version = |name: &str| {
                let named = |library: &&Value| library["name"].as_str().is_some_and(|n| n.eq_ignore_ascii_case(name));
                libraries.iter().find(named).map(|library| library["version"].is_string())
            };
            for (name, has_version) in LIBRARIES {
                let found = version(name);
                let is_right = found.is_some_and(|found_version| found_version || !has_version);
                tally.check((!is_right).then(|| format!("{branch}: {name}, version told: {found:?}")));
            }
            let amd = version(AMD).is_some();
            tally.check((amd != (generator == "fsr")).then(|| format!("{branch}: {AMD} is among {libraries:?}")));
            tally.check(outputs(&folder, &manifest));
        }
        Ok(())
    }

    /// Pictures decoded from the same latents are equal, bit for bit, and a generated frame differs from both of its anchors.
    fn anchors(&self, tally: &mut Tally) -> Result<(), String> {
        for anchor in 0..2 {
            let [shown, decoded] = [self.frame("coherence", 2 * anchor)?, self.frame("decoded-60", 4 * anchor)?];
            tally.test((shown != decoded).then(|| format!("anchor {anchor} of coherence is not that of decoded-60")));
        }
        for (branch, frame) in self.generated_frames()? {
            let anchors = [self.frame(branch, GENERATED_FRAME - 1)?, self.frame(branch, GENERATED_FRAME + 1)?];
            tally.test(anchors.contains(&frame).then(|| format!("what {branch} generated is one of its anchors")));
        }
        Ok(())
    }

    fn frame(&self, branch: &str, number: u32) -> Result<Vec<u8>, String> {
        let path = self.scene_folder().join(branch).join("frames").join(format!("{number:06}.png"));
        fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))
    }

    /// The generated frame of each branch that has one.
    fn generated_frames(&self) -> Result<Vec<(&'static str, Vec<u8>)>, String> {
        let branches = BRANCHES.into_iter().filter(|(_, _, generated)| *generated > 0);
        branches.map(|(branch, ..)| Ok((branch, self.frame(branch, GENERATED_FRAME)?))).collect()
    }

    /// The metrics of every frame of truth and branches: none is NaN.
    fn series(&self, tally: &mut Tally) -> Result<(), String> {
        let path = self.scene_folder().join("series.csv");
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let lines: Vec<&str> = text.lines().collect();
        let expected = 2 + (1 + BRANCHES.len()) * PICTURES;
        tally.check((lines.len() != expected).then(|| format!("{} lines of figures, not {expected}", lines.len())));
        let bad = lines.iter().find(|line| line.contains("NaN") || line.contains("inf"));
        tally.check(bad.map(|line| format!("a figure is no number: {line}")));
        Ok(())
    }

    /// The report exists, and names the adapter, the libraries and the generator of the manifests.
    fn report(&self, generator: &str, tally: &mut Tally) -> Result<(), String> {
        let path = self.out.join("report.md");
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        for number in 2..=7 {
            tally.check(lacks(&text, &format!("## Table {number}: ")));
        }
        for number in ["1", "2", "4", "6"] {
            tally.check(lacks(&text, &format!("## Figure {number}: ")));
        }
        let hardware =
            text.split("## Table 3: ").nth(1).and_then(|rest| rest.split("\n## ").next()).unwrap_or_default();
        let adapter = json(&self.scene_folder().join("coherence").join("manifest.json"))?;
        let adapter = adapter["versions"]["adapter"]["name"].as_str().unwrap_or("no name").to_owned();
        for words in ["DirectML on", &adapter, generator, "DirectML.dll 1.", "Windows"] {
            tally.check(lacks(hardware, words).map(|why| format!("Table 3 {why}")));
        }
        tally.check((hardware.contains(AMD) != (generator == "fsr")).then(|| format!("Table 3 and {AMD}: {hardware}")));
        for name in text.lines().filter_map(|line| line.strip_prefix("![")?.rsplit_once("](")?.1.strip_suffix(')')) {
            tally.check(missing(&self.out.join(name)));
        }
        let page = self.out.join("report.html");
        let html = fs::read_to_string(&page).map_err(|e| format!("{}: {e}", page.display()))?;
        for words in ["<video", "DirectML on", "data:image/jpeg"] {
            tally.check(lacks(&html, words).map(|why| format!("report.html {why}")));
        }
        let video = self.scene_folder().join("side-by-side.mp4");
        let bytes = fs::read(&video).map_err(|e| format!("{}: {e}", video.display()))?;
        tally.check((bytes.get(4..8) != Some(b"ftyp")).then(|| format!("{} is no MP4 file", video.display())));
        Ok(())
    }

    /// The number of the double's calls, and of its complaints.
    fn calls(&self) -> Result<[usize; 2], String> {
        let Amd::Double(amd) = &self.amd else { return Ok([0; 2]) };
        let lines = |name: &str| {
            let path = amd.join(name);
            match fs::read_to_string(&path) {
                Ok(text) => Ok(text.lines().count()),
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(0),
                Err(e) => Err(format!("{}: {e}", path.display())),
            }
        };
        Ok([lines(CALLS)?, lines(JUDGEMENT)?])
    }
}

/// A file's path, its length, and when it was written.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct FileStamp {
    path: PathBuf,
    length: u64,
    modified: SystemTime,
}

impl FileStamp {
    fn is_in(&self, folder: &str) -> bool {
        self.path.parent().is_some_and(|parent| parent.iter().any(|part| part == folder))
    }
}

/// All files below `folder`, sorted by path.
fn files(folder: &Path) -> Result<Vec<FileStamp>, String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let data = entry.metadata().map_err(failed)?;
        if data.is_dir() {
            all.extend(files(&entry.path())?);
        } else {
            all.push(FileStamp { path: entry.path(), length: data.len(), modified: data.modified().map_err(failed)? });
        }
    }
    all.sort();
    Ok(all)
}

/// The first output of a manifest that is missing or has another size; a manifest without outputs is an error too.
fn outputs(folder: &Path, manifest: &Value) -> Option<String> {
    let outputs = manifest["outputs"].as_array().map(Vec::as_slice).unwrap_or_default();
    let there = |output: &Value| {
        let size = output["path"].as_str().and_then(|path| fs::metadata(folder.join(path)).ok()).map(|data| data.len());
        size.is_some() && size == output["size"].as_u64()
    };
    match outputs.iter().find(|output| !there(output)) {
        Some(output) => Some(format!("{}: {output} is not there so", folder.display())),
        None => outputs.is_empty().then(|| format!("{}: the manifest lists no file", folder.display())),
    }
}

fn json(path: &Path) -> Result<Value, String> {
    let bytes = fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    serde_json::from_slice(&bytes).map_err(|e| format!("{}: {e}", path.display()))
}

/// The error if `text` does not contain `words`.
fn lacks(text: &str, words: &str) -> Option<String> {
    (!text.contains(words)).then(|| format!("lacks \"{words}\""))
}
