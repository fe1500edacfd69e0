//! `samples/host-d3d12`: built by CMake, run without a window and in one, in the lab or on Windows; its output and the display are
//! read and compared.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

use provision::{Console, tools};

use super::frames::{Numbers, Ppm, hdr10, scrgb};
use super::screen::{self, Rectangle};
use crate::shell::Log;
use crate::test::abi::STRICT;
use crate::test::amd::Amd;
use crate::test::tally::{Skip, Tally};
use crate::test::{Context, lab, recorder};
use crate::workspace;

const SAMPLE: &str = "samples/host-d3d12";
/// Its name in the list of broken rules.
const RECORDED: &str = "host-d3d12 record";
const SCRIPT: &str = "samples/scripts/walk.txt";
const RENDERER: &str = "tests/host/renderer.c";
const INPUT_SENDER: &str = "tests/host/hands.c";

/// Number of recorded frames, and of frames per anchor.
const FRAMES: usize = 24;
const MULTIPLIER: usize = 4;

/// Size of the embedded world's pictures and of the sample's frames: nothing is resized.
const SIZE: (usize, usize) = (320, 180);

/// Position of the frame-time graph in a frame of that size, as the sample draws it.
const GRAPH: Rectangle = Rectangle { left: 8, top: SIZE.1 - 64 - 8, width: 256, height: 64 };

/// Interval at which the display is read.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

pub(in crate::test) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if let Some(skip) = lab::skip_unless_possible(SAMPLE)? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    let Some(cmake) = tools::cmake(&Console::new()) else {
        tally.skips.push(Skip { name: SAMPLE.into(), reason: "needs cmake: apt install cmake".into() });
        return Ok(tally);
    };
    let folder = context.workspace.target.join("xtask").join("host-d3d12");
    let mut built = None;
    context.with_and_without_amd(&mut tally, |amd| {
        let work = folder.join(if matches!(amd, Amd::None) { "plain" } else { "amd" });
        let program = match &built {
            Some(program) => PathBuf::clone(program),
            None => built.insert(build_in_empty_folder(context, log, &cmake, &folder)?).clone(),
        };
        fs::create_dir_all(&work).map_err(|e| format!("{}: {e}", work.display()))?;
        check_sample(&Host { context, work, program, amd }, log)
    })?;
    Ok(tally)
}

/// The sample, built in an empty folder.
fn build_in_empty_folder(context: &Context<'_>, log: &mut Log, cmake: &Path, work: &Path) -> Result<PathBuf, String> {
    workspace::make_empty(work)?;
    let program = build(context, log, cmake, work)?;
    lab::install_runtime(&program.with_file_name(""))?;
    Ok(program)
}

/// Tests the sample's output and the display.
fn check_sample(host: &Host<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    recorded_frames(host, log, &mut tally)?;
    hdr_frames(host, log, &mut tally)?;
    device_anchors(host, log, &mut tally)?;
    scene_anchors(host, log, &mut tally)?;
    invalid_arguments(host, log, &mut tally)?;
    window_on_display(host, log, &mut tally)?;
    keyboard_and_mouse(host, log, &mut tally)?;
    Ok(tally)
}

/// Builds the library, and the sample against it.
fn build(context: &Context<'_>, log: &mut Log, cmake: &Path, work: &Path) -> Result<PathBuf, String> {
    context.build_for_windows(log)?;
    let library_folder = format!("-DCAIRN_LIBRARY_DIR={}", context.windows_programs().display());
    by_cmake(log, cmake, &context.workspace.root.join(SAMPLE), &work.join("build"), &[&library_folder])
}

/// Builds the sample in `source` by its CMake file; returns the program.
pub(in crate::test) fn by_cmake(
    log: &mut Log,
    cmake: &Path,
    source: &Path,
    build: &Path,
    options: &[&str],
) -> Result<PathBuf, String> {
    let mut configure = Command::new(cmake);
    configure.arg("-S").arg(source).arg("-B").arg(build).args(options);
    if !cfg!(windows) {
        let tools::MingwCompiler { program, first } =
            tools::mingw_compiler(true, &Console::new()).map_err(|e| e.to_string())?;
        if !first.is_empty() {
            return Err("MinGW-w64's G++ is needed: apt install g++-mingw-w64-x86-64".to_owned());
        }
        configure.args(["-DCMAKE_SYSTEM_NAME=Windows", "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_CXX_FLAGS=-Werror"]);
        configure.arg(format!("-DCMAKE_CXX_COMPILER={}", program.display()));
    }
    let configured = log.run(&mut configure)?.success;
    let built = configured
        && log.run(Command::new(cmake).arg("--build").arg(build).args(["--config", "Release", "--parallel"]))?.success;
    let candidates = [build.join("host-d3d12.exe"), build.join("Release").join("host-d3d12.exe")];
    let program = candidates.into_iter().find(|program| built && program.is_file());
    program.ok_or_else(|| "CMake does not build the sample".to_owned())
}

/// A built sample.
struct Host<'a> {
    context: &'a Context<'a>,
    work: PathBuf,
    program: PathBuf,
    amd: &'a Amd,
}

impl Host<'_> {
    /// The sample in the lab, run in the output folder.
    fn command(&self, arguments: &[&str]) -> Result<Command, String> {
        let mut command = if cfg!(windows) { Command::new(&self.program) } else { lab::lab_run()? };
        if !cfg!(windows) {
            command.arg(&self.program);
        }
        command.args(arguments).current_dir(&self.work).env_remove("CAIRN_ONNXRUNTIME");
        self.amd.provide(&mut command);
        Ok(command)
    }

    /// Reads a recorded picture from a folder.
    fn picture(&self, folder: &str, name: &str, number: usize) -> Result<Ppm, String> {
        Ppm::read(&self.work.join(folder).join(format!("{name}-{number:05}.ppm")))
    }

    fn script(&self) -> String {
        self.context.workspace.root.join(SCRIPT).display().to_string()
    }
}

/// Records frames without a window, with the anchors they are made from, through the recorder of Direct3D's calls.
fn recorded_frames(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let frames = FRAMES.to_string();
    let script = host.script();
    let arguments = ["--headless", &frames, "--record", "walk", "--anchors", "cpu", "--script", &script];
    let mut command = host.command(&arguments)?;
    let folder = host.program.with_file_name("");
    let (ended, broken_rules, _) = recorder::run_program(host.context, log, &mut command, &folder, RECORDED, host.amd)?;
    if !ended.success {
        return Err("the sample does not record".to_owned());
    }
    tally.failures.extend(broken_rules);
    let read = |name, count| (0..count).map(|i| host.picture("walk", name, i)).collect::<Result<Vec<_>, _>>();
    let (frames, anchors) = (read("frame", FRAMES)?, read("anchor", FRAMES.div_ceil(MULTIPLIER))?);
    let table =
        fs::read_to_string(host.work.join("walk").join("frames.csv")).map_err(|e| format!("frames.csv: {e}"))?;
    let sources: Vec<&str> = table.lines().skip(1).filter_map(|line| line.split(',').nth(1)).collect();
    tally.test((sources.len() != FRAMES).then(|| format!("frames.csv has {} frames", sources.len())));
    for (i, frame) in frames.iter().enumerate() {
        let source = sources.get(i).copied().unwrap_or_default();
        let anchor = (i % MULTIPLIER == 0).then(|| &anchors[i / MULTIPLIER]);
        let wrong = match anchor {
            _ if (frame.width, frame.height) != SIZE => Some("has another size"),
            _ if is_flat(frame) => Some("is of one colour"),
            Some(_) if source != "anchor" => Some("is said to be no anchor"),
            Some(anchor) if frame.pixels != anchor.pixels => Some("is not the anchor's picture"),
            None if source != "generated" => Some("is said not to be generated"),
            _ if i > 0 && frame.pixels == frames[i - 1].pixels => Some("is the one before"),
            _ => None,
        };
        tally.test(wrong.map(|what| format!("frame {i} {what}")));
    }
    Ok(())
}

/// HDR frames: frames at anchors are the anchors' pictures at the requested brightness. The lab's display has no HDR, which the
/// sample must report.
fn hdr_frames(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let script = host.script();
    let shared = ["--multiplier", "1", "--anchors", "cpu", "--script", &script];
    type Pixel = fn([f64; 3], f64) -> [f64; 3];
    // Tolerances: one step of ten bits, and one of a half float near white; each value is rounded to nearest.
    let kinds: [(&str, &str, f64, Pixel, f64); 2] =
        [("hdr10", "ppm", 203.0, hdr10, 1.01), ("scrgb", "pfm", 400.0, scrgb, 0.003)];
    for (colours, ending, white, pixel, near) in kinds {
        let bright = white.to_string();
        let arguments = ["--headless", "2", "--record", colours, "--colours", colours, "--white", &bright];
        if !log.run(&mut host.command(&[&arguments[..], &shared].concat())?)?.success {
            tally.failures.push(format!("the sample does not record {colours}"));
            continue;
        }
        for i in 0..2 {
            let frame = Numbers::read(&host.work.join(colours).join(format!("frame-{i:05}.{ending}")))?;
            let anchor = host.picture(colours, "anchor", i)?;
            let (off, dark) =
                (frame.distance(&anchor, |p| pixel(p, white)), frame.distance(&anchor, |p| pixel(p, 80.0)));
            log.line(&format!("{colours}, frame {i}: {off} off, {dark} off another white"))?;
            tally.test((off > near).then(|| format!("{colours}: frame {i} is {off} off its anchor's picture")));
            tally.test((dark < 10.0 * near).then(|| format!("{colours}: frame {i} is as bright as any")));
        }
        if !cfg!(windows) {
            let window = ["--frames", "1", "--colours", colours];
            let ended = log.run(&mut host.command(&[&window[..], &shared].concat())?)?;
            let reported = ended.output.contains("host-d3d12: this display does not show");
            tally.test((ended.success || !reported).then(|| format!("{colours} in a window: {:?}", ended.output)));
        }
    }
    Ok(())
}

/// Anchors from DirectML, on the device that shows them: close to those of the processor.
fn device_anchors(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let script = host.script();
    let arguments =
        ["--headless", "2", "--record", "device", "--anchors", "gpu", "--script", &script, "--multiplier", "1"];
    let ended = log.run(&mut host.command(&arguments)?)?;
    if !ended.success || !ended.output.contains("DirectML") {
        tally.failures.push(format!("anchors of DirectML: {:?}", ended.output));
        return Ok(());
    }
    for i in 0..2 {
        let (device, processor) = (host.picture("device", "anchor", i)?, host.picture("walk", "anchor", i)?);
        let shown = host.picture("device", "frame", i)?;
        let pairs = device.pixels.iter().zip(&processor.pixels);
        let squares: f64 = pairs.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
        let decibels = 10.0 * (255.0_f64.powi(2) * device.pixels.len() as f64 / squares.max(1.0)).log10();
        log.line(&format!("anchor {i} of DirectML: {decibels:.1} dB from the processor's"))?;
        tally.test((decibels < 40.0).then(|| format!("anchor {i} of DirectML is {decibels:.1} dB off")));
        tally.test((shown.pixels != device.pixels).then(|| format!("anchor {i} of DirectML is not what is shown")));
    }
    Ok(())
}

/// Whether a picture is uniform: fewer than sixteen levels between the darkest and the brightest byte.
fn is_flat(picture: &Ppm) -> bool {
    let (least, most) = picture.pixels.iter().fold((u8::MAX, 0), |(least, most), v| (least.min(*v), most.max(*v)));
    most.saturating_sub(least) < 16
}

/// Anchors from the renderer equal the pictures that it draws by itself. Here it runs natively on this machine, and a stand-in with the
/// renderer's arguments passes them to the sample.
fn scene_anchors(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let context = host.context;
    context.build_programs(log)?;
    let raw = host.work.join("forest.rgb");
    let arguments_for_clip =
        ["clip", "--scene", "forest", "--seconds", "600", "--rate", "15", "--size", "160x96", "--raw", "-"];
    let mut scenes = Command::new(context.workspace.program("debug", "scenes"));
    scenes.args(
        arguments_for_clip.map(|word| if word == "600" { "0.2" } else { word }).iter().filter(|word| **word != "-"),
    );
    if !log.run(scenes.arg(&raw))?.success {
        return Err("the scenes are not drawn".to_owned());
    }
    let pictures = fs::read(&raw).map_err(|e| format!("{}: {e}", raw.display()))?;
    let renderer = host.work.join("renderer.exe");
    if !cfg!(windows) {
        compile(context, log, RENDERER, &renderer)?;
    }
    let program = if cfg!(windows) { context.workspace.program("debug", "scenes") } else { renderer };
    let program = program.display().to_string();
    let arguments =
        ["--source", "scene:forest", "--scenes", &program, "--size", "160x96", "--headless", "5", "--record", "forest"];
    let mut command = host.command(&arguments)?;
    command.env("CAIRN_TEST_ARGUMENTS", host.work.join("arguments.txt")).env("CAIRN_TEST_PICTURES", &raw);
    if !log.run(&mut command)?.success {
        tally.failures.push("the sample does not show a scene".to_owned());
        return Ok(());
    }
    for (i, picture) in pictures.chunks_exact(160 * 96 * 3).take(2).enumerate() {
        let shown = host.picture("forest", "frame", i * MULTIPLIER)?;
        tally.test((shown.pixels != picture).then(|| format!("anchor {i} is not the scene's picture")));
    }
    if !cfg!(windows) {
        let received =
            fs::read_to_string(host.work.join("arguments.txt")).map_err(|e| format!("arguments.txt: {e}"))?;
        tally.test((!received.lines().eq(arguments_for_clip)).then(|| format!("the renderer is given {received:?}")));
    }
    Ok(())
}

/// Compiles a single-file program for the lab.
fn compile(context: &Context<'_>, log: &mut Log, source: &str, program: &Path) -> Result<(), String> {
    let compiler = tools::mingw_compiler(false, &Console::new()).map_err(|e| e.to_string())?;
    let mut compile = Command::new(&compiler.program);
    compile.args(compiler.first).arg("-std=c11").args(STRICT);
    match log.run(compile.arg(context.workspace.root.join(source)).arg("-o").arg(program))?.success {
        true => Ok(()),
        false => Err(format!("{source} does not compile")),
    }
}

/// Invalid command lines and missing files: an exit status, and a message that names the fault.
fn invalid_arguments(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    for (arguments, message) in [
        (&["--size", "3"][..], "--size: \"3\" is no size. Write it as 960x540. See host-d3d12 --help"),
        (&["--white", "300"], "--white: is for --colours hdr10 or scrgb. See host-d3d12 --help"),
        (&["--headless", "2", "--seed-picture", "nowhere.ppm", "--anchors", "cpu"], "nowhere.ppm: cannot be read"),
    ] {
        let ended = log.run(&mut host.command(arguments)?)?;
        let fine = !ended.success && ended.output.contains(&format!("host-d3d12: {message}"));
        tally.test((!fine).then(|| format!("{arguments:?}: {:?}", ended.output)));
    }
    Ok(())
}

/// Runs the sample in a window, and looks for the world on the display.
fn window_on_display(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let (script, size) = (host.script(), format!("{}x{}", SIZE.0, SIZE.1));
    let mut arguments: Vec<&str> = "--frames 30 --rate 2 --anchors cpu --record window --script".split(' ').collect();
    arguments.extend([&*script, "--size", &*size]);
    let mut command = host.command(&arguments)?;
    command.env("CAIRN_LAB_SCREEN", &host.work);
    let (over, display) = (AtomicBool::new(false), host.work.join("Xvfb_screen0"));
    let made = host.work.join("window");
    let (ended, found) = std::thread::scope(|scope| {
        let watch = scope.spawn(|| find_anchors(&display, &made, &over));
        let ended = log.run(&mut command);
        over.store(true, Ordering::Relaxed);
        (ended, watch.join())
    });
    tally.test((!ended?.success).then(|| "the sample ends with a failure in a window".to_owned()));
    if cfg!(windows) {
        return Ok(());
    }
    match found.map_err(|_| "the display cannot be watched")? {
        Some(DisplayMatch { anchors, position: (left, top), screen }) => {
            log.line(&format!("anchors {anchors:?} stand at {left}, {top} of the display"))?;
            screen.write(&host.work.join("screen.ppm"))?;
            let graph = |x: usize, y: usize| {
                let at = ((top + GRAPH.top + y) * screen.width + left + GRAPH.left + x) * 3;
                [screen.pixels[at], screen.pixels[at + 1], screen.pixels[at + 2]]
            };
            // The graph's background beside the number; no frame has this colour.
            let there = graph(GRAPH.width - 1, 0) == [0x10, 0x18, 0x20];
            tally.test((!there).then(|| "the graph is not in the picture".to_owned()));
        }
        None => tally.failures.push("no two anchors of the world were seen on the display".to_owned()),
    }
    Ok(())
}

/// Plays in a window with keys and mouse, and leaves by Esc; the received input is logged.
fn keyboard_and_mouse(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    // On a Windows desktop a user may be typing.
    if cfg!(windows) {
        return Ok(());
    }
    let program = host.work.join("hands.exe");
    compile(host.context, log, INPUT_SENDER, &program)?;
    let mut command = lab::lab_run()?;
    command.arg(&program).arg("played/controls.txt").arg(&host.program);
    command.args(["--anchors", "cpu", "--rate", "4", "--record", "played"]);
    host.amd.provide(&mut command);
    let ended = log.run(command.current_dir(&host.work).env_remove("CAIRN_ONNXRUNTIME"))?;
    tally.test((!ended.success).then(|| format!("keyboard and mouse: {}", ended.output)));
    let script = fs::read_to_string(host.work.join("played").join("controls.txt")).unwrap_or_default();
    let logged = script.contains(" down W") && script.contains(" mouse ");
    tally.test((!logged).then(|| format!("the sample writes down as what the player did: {script:?}")));
    Ok(())
}

/// What was found on the display.
struct DisplayMatch {
    /// Indices of two anchors: the world advances.
    anchors: [usize; 2],
    /// Position of the second one's top left pixel.
    position: (usize, usize),
    /// The whole screen with the second one.
    screen: Ppm,
}

/// Reads the display until two of the anchors that the sample writes into `made` were found, or the run is over.
fn find_anchors(display: &Path, made: &Path, over: &AtomicBool) -> Option<DisplayMatch> {
    let mut anchors: Vec<Ppm> = Vec::new();
    let mut first = None;
    while !over.load(Ordering::Relaxed) {
        // An anchor that is still being written is read next time.
        while let Ok(anchor) = Ppm::read(&made.join(format!("anchor-{:05}.ppm", anchors.len()))) {
            anchors.push(anchor);
        }
        if let Some(screen) = screen::read(display) {
            let position_of = |picture| match first {
                None => screen::find(&screen, picture, GRAPH),
                Some((_, position)) => screen::is_at(&screen, picture, position, GRAPH).then_some(position),
            };
            let found = anchors.iter().enumerate().find_map(|(i, picture)| Some((i, position_of(picture)?)));
            if let Some((anchor, position)) = found {
                let (before, _) = *first.get_or_insert((anchor, position));
                if before != anchor {
                    return Some(DisplayMatch { anchors: [before, anchor], position, screen });
                }
            }
        }
        sleep(POLL_INTERVAL);
    }
    None
}
