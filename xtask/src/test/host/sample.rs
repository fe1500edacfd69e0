//! `samples/host-c`: built as its page says, by CMake, and with the sanitizers; its output is read and compared.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::{Console, tools};

use super::frames::{Ppm, Video};
use super::{HostSetup, check_compiles};
use crate::shell::{CommandOutput, Log};
use crate::test::tally::{Skip, Tally};
use crate::test::{Context, abi};

const SAMPLE: &str = "samples/host-c";
const SCRIPT: &str = "samples/scripts/walk.txt";

pub(super) fn run(context: &Context<'_>, log: &mut Log, setup: &HostSetup, tally: &mut Tally) -> Result<(), String> {
    let is_source = |file: &String| file.starts_with(SAMPLE) && file.ends_with(".c");
    let sources: Vec<PathBuf> = context
        .workspace
        .files()?
        .into_iter()
        .filter(is_source)
        .map(|file| context.workspace.root.join(file))
        .collect();
    for compiler in abi::available_compilers(&mut Tally::default()).iter().filter(|compiler| !compiler.cpp) {
        for source in &sources {
            check_compiles(log, compiler, &setup.include, source, tally)?;
        }
    }
    let program = build_as_written(context, log, setup)?;
    let host = Host { context, program, setup };
    videos(&host, log, tally)?;
    pictures(&host, log, tally)?;
    without_a_world(&host, log, tally)?;
    refusals(&host, log, tally)?;
    cmake(&host, log, tally)?;
    sanitizers(&host, log, &sources, tally)
}

/// Builds by the command line in the sample's page and source, against the existing library.
fn build_as_written(context: &Context<'_>, log: &mut Log, setup: &HostSetup) -> Result<PathBuf, String> {
    let page = context.workspace.read(&format!("{SAMPLE}/README.md"))?;
    let line = page.lines().find(|line| line.starts_with("cc ")).ok_or("the sample's page has no line with cc")?;
    if !context.workspace.read(&format!("{SAMPLE}/main.c"))?.contains(line) {
        return Err("the sample's source shows another line with cc than its page".to_owned());
    }
    let program = setup.work.join("host-c");
    // By variables of the shell, since the paths may have spaces.
    let line = line
        .replace("$PWD/target/release", "$LIBRARY_FOLDER")
        .replace("target/release", "\"$LIBRARY_FOLDER\"")
        .replace("-o host-c", "-o \"$PROGRAM\"");
    let mut command = Command::new("sh");
    command.args(["-c", &line]).current_dir(&context.workspace.root);
    let ended = log.run(command.env("LIBRARY_FOLDER", setup.library_folder()).env("PROGRAM", &program))?;
    if ended.success { Ok(program) } else { Err("the sample does not build as its page says".to_owned()) }
}

/// A built sample.
struct Host<'a> {
    context: &'a Context<'a>,
    program: PathBuf,
    setup: &'a HostSetup,
}

impl Host<'_> {
    fn command(&self, program: &Path) -> Result<Command, String> {
        let mut command = Command::new(program);
        command.current_dir(&self.setup.work);
        self.context.provide_worlds(&mut command)?;
        Ok(command)
    }

    /// Walks for `seconds` and writes `out`.
    fn walk(
        &self,
        log: &mut Log,
        seconds: &str,
        seed: &str,
        out: &str,
        more: &[&Path],
    ) -> Result<CommandOutput, String> {
        let mut command = self.command(&self.program)?;
        command.arg(self.context.bundle("tiny")?).arg("--script").arg(self.context.workspace.root.join(SCRIPT));
        command.args(["--seconds", seconds, "--seed", seed, "--out", out]).args(more);
        log.run(&mut command)
    }

    fn video(&self, name: &str) -> Result<Video, String> {
        Video::read(&self.setup.work.join(name))
    }
}

/// A whole second: all pictures are there, no two consecutive ones are equal, and the seed changes them.
fn videos(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let ended = host.walk(log, "1", "7", "walk.y4m", &[])?;
    tally.test((!ended.success).then(|| "the rollout failed".to_owned()));
    for message in ["reading", "preparing", "100 %", "latent 15 of 15", "16 latents", "61 pictures written"] {
        tally.check((!ended.output.contains(message)).then(|| format!("the rollout does not say \"{message}\"")));
    }
    let video = host.video("walk.y4m")?;
    let facts = (video.width, video.height, video.rate.as_str(), video.frames.len());
    tally.test((facts != (128, 72, "60:1", 61)).then(|| format!("the video is {facts:?}")));
    let still = video.frames.windows(2).filter(|pair| pair[0] == pair[1]).count();
    tally.test((still > 0).then(|| format!("{still} pictures are as the one before")));
    for (seed, alike) in [("7", true), ("8", false)] {
        host.walk(log, "0.2", seed, "again.y4m", &[])?;
        let again = host.video("again.y4m")?;
        let wrong = again.frames.len() != 13 || (again.frames[..] == video.frames[..again.frames.len()]) != alike;
        tally.test(wrong.then(|| format!("seed {seed}: the beginning is alike or not, against the seeds")));
    }
    Ok(())
}

/// From a seed picture, once as pictures and once as a video: both are equal.
fn pictures(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let pixels = (0..100 * 60).flat_map(|i| [(i % 256) as u8, (i / 100 * 4) as u8, 200]).collect();
    let seed = host.setup.work.join("seed.ppm");
    Ppm { width: 100, height: 60, pixels }.write(&seed)?;
    let more = [Path::new("--seed-picture"), seed.as_path()];
    for out in ["pictures.y4m", "pictures.ppm"] {
        let ended = host.walk(log, "0.2", "1", out, &more)?;
        tally.test((!ended.success).then(|| format!("{out} was not written")));
    }
    let video = host.video("pictures.y4m")?;
    let plain = host.video("again.y4m")?;
    tally.test((video.frames[0] == plain.frames[0]).then(|| "the seed picture changes nothing".to_owned()));
    let mut written = 0;
    for (number, frame) in video.frames.iter().enumerate() {
        let picture = Ppm::read(&host.setup.work.join(format!("pictures-{number:05}.ppm")))?;
        let off = picture.distance(frame);
        // Rounding to 8 bits, and the standard's coefficients with three digits.
        let wrong = (picture.width, picture.height) != (video.width, video.height) || off > 0.51;
        tally.test(wrong.then(|| format!("picture {number} and the video's frame are {off:.2} apart")));
        written += 1;
    }
    let more = host.setup.work.join(format!("pictures-{written:05}.ppm")).exists();
    tally.test((written != 13 || more).then(|| format!("{written} pictures were written, or more")));
    Ok(())
}

/// A shorter form of the command line on the sample's page: through the embedded world, from its known place.
fn without_a_world(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let root = &host.context.workspace.root;
    let mut command = host.command(&host.program)?;
    command.arg("--seed-picture").arg(root.join("samples/worlds/place.ppm")).arg("--script").arg(root.join(SCRIPT));
    let ended = log.run(command.args(["--seconds", "0.2", "--out", "embedded.y4m"]))?;
    let wrong = !ended.success || !ended.output.contains("world:   Miniature");
    tally.test(wrong.then(|| "without a world, host-c does not walk through the embedded one".to_owned()));
    let video = host.video("embedded.y4m")?;
    let facts = (video.width, video.height, video.frames.len());
    tally.test((facts != (320, 180, 13)).then(|| format!("the embedded world's video is {facts:?}")));
    Ok(())
}

/// Invalid requests fail with a message that names the remedy.
fn refusals(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let world = host.context.bundle("tiny")?;
    let world = world.to_str().ok_or("the test world's path is not UTF-8")?;
    let script = host.setup.work.join("wrong.txt");
    fs::write(&script, "cairn-controls 1\n0..1 hold NOSUCHKEY\n").map_err(|e| format!("{}: {e}", script.display()))?;
    let script = script.to_str().ok_or("the work folder's path is not UTF-8")?;
    for (arguments, message_parts) in [
        (&[world, world][..], &["there is a world already", "--help"][..]),
        (&[world, "--sceonds", "1"], &["--sceonds", "no such option"]),
        (&[world, "--seconds", "soon"], &["soon", "seconds"]),
        (&[world, "--out", "walk.avi"], &["walk.avi", ".y4m"]),
        (&["nowhere"], &["cairn_world_load: ", "nowhere", "CAIRN_ERROR_"]),
        (&[world, "--preset", "fastest"], &["fastest", "CAIRN_ERROR_INVALID_ARGUMENT"]),
        (&[world, "--script", script], &["cairn_script_create: ", "NOSUCHKEY", "CAIRN_ERROR_INVALID_ARGUMENT"]),
        (
            &[world, "--onnxruntime", "nowhere.so"],
            &["cairn_device_create_cpu: ", "CAIRN_ERROR_RUNTIME_MISSING", "MISSING  needed: ONNX Runtime"],
        ),
    ] {
        let ended = log.run(host.command(&host.program)?.args(arguments))?;
        let lacks = message_parts.iter().find(|part| !ended.output.contains(**part));
        let wrong = ended.success || lacks.is_some();
        tally.test(wrong.then(|| format!("host-c {arguments:?} does not fail with {lacks:?}")));
    }
    Ok(())
}

/// Builds by CMake against header and library in a folder of their own, as in a release.
fn cmake(host: &Host<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let Some(cmake) = tools::cmake(&Console::new()) else {
        tally.skips.push(Skip { name: "host-c by CMake".into(), reason: "needs cmake: apt install cmake".into() });
        return Ok(());
    };
    let release = host.setup.work.join("release");
    for (from, folder) in [(&host.setup.include.join("cairn.h"), "include"), (&host.setup.library, "lib")] {
        let folder = release.join(folder);
        let to = folder.join(from.file_name().unwrap_or_default());
        let copied = fs::create_dir_all(&folder).and_then(|()| fs::copy(from, &to));
        copied.map_err(|e| format!("{}: {e}", to.display()))?;
    }
    let build = host.setup.work.join("build");
    let mut configure = Command::new(&cmake);
    configure.arg("-S").arg(host.context.workspace.root.join(SAMPLE)).arg("-B").arg(&build);
    configure.arg(format!("-DCAIRN_ROOT={}", release.display())).arg("-DCMAKE_C_FLAGS=-Werror");
    let ended = log.run(&mut configure)?;
    let built = ended.success && log.run(Command::new(&cmake).arg("--build").arg(&build))?.success;
    tally.test((!built).then(|| "CMake does not build the sample".to_owned()));
    if built {
        let mut command = host.command(&build.join("host-c"))?;
        let ended = log.run(command.arg(host.context.bundle("tiny")?).args(["--seconds", "0.1"]))?;
        tally.test((!ended.success).then(|| "the sample built by CMake does not run".to_owned()));
    }
    Ok(())
}

/// With AddressSanitizer, LeakSanitizer and UndefinedBehaviorSanitizer: no error in a rollout, nor in a failing one. The library
/// allocates with malloc, so its leaks are detected as well.
fn sanitizers(host: &Host<'_>, log: &mut Log, sources: &[PathBuf], tally: &mut Tally) -> Result<(), String> {
    let sanitized = |output: &Path| {
        let mut command = host.setup.compile();
        command.args(["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-o"]);
        command.arg(output);
        command
    };
    // A control: the sanitizer must detect this leak.
    let leak = host.setup.work.join("leak.c");
    let text = "#include <stdlib.h>\n\nint main(void)\n{\n    volatile char *lost = malloc(7);\n    lost[0] = 1;\n    \
                lost = NULL;\n    return 0;\n}\n";
    fs::write(&leak, text).map_err(|e| format!("{}: {e}", leak.display()))?;
    let program = host.setup.work.join("leak");
    if !log.run(sanitized(&program).arg(&leak))?.success {
        let reason = "needs sanitizers: apt install gcc with libasan and libubsan".into();
        tally.skips.push(Skip { name: "host-c with sanitizers".into(), reason });
        return Ok(());
    }
    let found = log.run(&mut host.command(&program)?)?;
    tally.test((found.success || !found.output.contains("LeakSanitizer")).then(|| "a leak is not found".to_owned()));

    let program = host.setup.work.join("host-c-sanitized");
    let mut command = sanitized(&program);
    command.args(sources).arg("-L").arg(host.setup.library_folder()).args(["-lcairn", "-lm"]);
    command.arg(format!("-Wl,-rpath,{}", host.setup.library_folder().display()));
    if !log.run(&mut command)?.success {
        return Err("the sample does not build with sanitizers".to_owned());
    }
    let world = host.context.bundle("tiny")?;
    let script = host.context.workspace.root.join(SCRIPT);
    let (world, script) = (world.to_string_lossy(), script.to_string_lossy());
    for (arguments, works) in [
        (&[&*world, "--script", &*script, "--seconds", "0.3", "--verbose", "--out", "sanitized.y4m"][..], true),
        (&[&*world, "--seconds", "0.1", "--seed-picture", "seed.ppm", "--out", "sanitized.ppm"], true),
        (&[&*world, "--seconds", "0.1", "--out", "no/such/folder.y4m"], false),
        (&[&*world, "--seed-picture", "leak.c"], false),
        (&[&*world, "--script", "leak.c"], false),
        (&[&*world, "--preset", "fastest"], false),
        (&["leak.c"], false),
    ] {
        let ended = log.run(host.command(&program)?.args(arguments))?;
        let found = ["Sanitizer", "runtime error"].iter().any(|word| ended.output.contains(word));
        let wrong = found || ended.success != works;
        tally.test(
            wrong.then(|| format!("with sanitizers, host-c {arguments:?}: found {found}, works {}", ended.success)),
        );
    }
    Ok(())
}
