//! A first run from the Windows archive: with the unpacked files alone, and with an empty environment, hosts of every kind show a picture
//! of the embedded world and exit cleanly. If this machine has AMD's own libraries, they run again with those beside the library. The log
//! has the time that each takes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use provision::{Console, DotNet};

use super::amd::Amd;
use super::tally::{Skip, Tally};
use super::{Context, csharp, lab, unreal};
use crate::shell::Log;

/// Number of frames that the sample makes.
const FRAMES: usize = 6;

const CSHARP: &str = "tests/host/Picture.cs";

/// Runs a C++ host built from the archive, a C# program, the test host for Unity and the test engine for Unreal. The wheels' runner tests
/// the wheel.
pub(super) fn run(
    context: &Context<'_>,
    log: &mut Log,
    root: &Path,
    sample: &Path,
    work: &Path,
    tally: &mut Tally,
) -> Result<(), String> {
    let hosts = Hosts { context, root, work: work.join("first minute Ж") };
    fs::create_dir_all(&hosts.work).map_err(|e| format!("{}: {e}", hosts.work.display()))?;
    hosts.cpp(log, sample, tally)?;
    hosts.csharp(log, tally)?;
    hosts.unity(log, tally)?;
    hosts.unreal(log, tally)
}

struct Hosts<'a> {
    context: &'a Context<'a>,
    /// Root of the unpacked archive.
    root: &'a Path,
    work: PathBuf,
}

/// A program that shows the embedded world.
struct Host<'a> {
    name: &'a str,
    command: Command,
    /// Folder of the library, in which the library looks for AMD's.
    folder: &'a Path,
    /// The picture that it writes; `None` if it compares its pictures itself.
    picture: Option<&'a Path>,
    /// Whether it prints the name of its frame generator. In C++ and in Unity the last frame is half way between two anchors.
    names_generator: bool,
}

impl Hosts<'_> {
    /// Runs a host without AMD's own libraries and with them.
    fn check_host(&self, log: &mut Log, host: &mut Host<'_>, tally: &mut Tally) -> Result<(), String> {
        host.command.current_dir(&self.work);
        self.context.with_and_without_amd(tally, |amd| {
            if let Some(earlier) = host.picture.filter(|earlier| earlier.exists()) {
                fs::remove_file(earlier).map_err(|e| format!("{}: {e}", earlier.display()))?;
            }
            let began = Instant::now();
            let ended = amd.beside(host.folder, || log.run(&mut host.command))?;
            let name = host.name;
            log.line(&format!("{name}: started, shown and ended in {:.1} s, {amd:?}", began.elapsed().as_secs_f64()))?;
            let generator = if matches!(amd, Amd::None) { "generator shader" } else { "generator fsr" };
            let why = if !ended.success {
                Some("does not end well".to_owned())
            } else if host.picture.is_some_and(|picture| is_flat(&fs::read(picture).unwrap_or_default())) {
                Some("shows nothing".to_owned())
            } else if host.names_generator && !ended.output.contains(generator) {
                Some(format!("does not say \"{generator}\""))
            } else {
                None
            };
            let mut tally = Tally::default();
            tally.test(why.map(|why| format!("{name} from the Windows archive alone {why}: {}", ended.output)));
            Ok(tally)
        })
    }

    fn folder(&self, name: &str) -> Result<PathBuf, String> {
        let folder = self.work.join(name);
        fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display())).map(|()| folder)
    }

    /// Copies files of the archive's folder into another.
    fn copy(&self, from: &str, names: &[&str], into: &Path) -> Result<(), String> {
        for name in names {
            let file = self.root.join(from).join(name);
            fs::copy(&file, into.join(name)).map_err(|e| format!("{}: {e}", file.display()))?;
        }
        Ok(())
    }

    /// The sample, built as its page says, with the libraries that CMake copied beside it.
    fn cpp(&self, log: &mut Log, sample: &Path, tally: &mut Tally) -> Result<(), String> {
        let (script, seed) = (self.root.join("samples/scripts/walk.txt"), self.root.join("samples/worlds/place.ppm"));
        let mut command = lab::with_empty_environment(sample)?;
        command.args(["--headless", &FRAMES.to_string(), "--record", "walk", "--anchors", "cpu", "--multiplier", "2"]);
        command.arg("--script").arg(script);
        command.arg("--seed-picture").arg(seed);
        let last = self.work.join("walk").join(format!("frame-{:05}.ppm", FRAMES - 1));
        let (name, folder, picture) = ("a host in C++", &sample.with_file_name(""), Some(last.as_path()));
        let mut host = Host { name, command, folder, picture, names_generator: true };
        self.check_host(log, &mut host, tally)
    }

    /// A C# program on .NET for Windows, built from the archive's sources of the binding, with all libraries beside it.
    fn csharp(&self, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        let console = Console::new();
        let (mono, dotnet) = match (provision::mono(&console), provision::dotnet_for_windows(&console)) {
            (Ok(mono), Ok(dotnet)) => (mono, dotnet),
            (mono, dotnet) => {
                let why = mono.err().or(dotnet.err()).map(|e| e.to_string()).unwrap_or_default();
                let reason = format!("needs mono and .NET for Windows: {why}");
                tally.skips.push(Skip { name: "a program in C# from the Windows archive".to_owned(), reason });
                return Ok(());
            }
        };
        let folder = self.folder("csharp")?;
        let program = folder.join("Picture.dll");
        let mut command = mono.compiler();
        command.args(["-target:exe", "-langversion:7.2", "-unsafe", "-nostdlib", "-noconfig", "-nowarn:1702"]);
        let framework = dotnet.framework();
        command.args(csharp::FRAMEWORK.map(|name| format!("-r:{}", framework.join(format!("{name}.dll")).display())));
        command.arg(format!("-out:{}", program.display())).arg(self.context.workspace.root.join(CSHARP));
        let sources = self.root.join("bindings/csharp/src");
        command.arg(format!("-recurse:{}/*.cs", sources.display()));
        if !log.run(&mut command)?.success {
            tally.failures.push(format!("{CSHARP} does not compile with the archive's binding"));
            return Ok(());
        }
        let settings = folder.join("Picture.runtimeconfig.json");
        fs::write(&settings, DotNet::SETTINGS).map_err(|e| format!("{}: {e}", settings.display()))?;
        self.copy("bin", &["cairn.dll"], &folder)?;
        self.copy("runtime", &["onnxruntime.dll", "DirectML.dll"], &folder)?;
        let picture = folder.join("picture.ppm");
        let mut command = lab::with_empty_environment(dotnet.program().get_program().as_ref())?;
        command.arg(lab::windows_path(&program)).arg(lab::windows_path(&picture));
        let (name, folder, picture) = ("a program in C#", folder.as_path(), Some(picture.as_path()));
        let mut host = Host { name, command, folder, picture, names_generator: false };
        self.check_host(log, &mut host, tally)
    }

    /// The archive's package for Unity, in the test host of the plugin's tests, which was built with the library.
    fn unity(&self, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        let program = self.context.windows_programs().join("examples").join("show.exe");
        let plugin = self.root.join("unity/com.cairn.unity/Plugins/x86_64/cairn_unity.dll");
        let picture = self.folder("unity")?.join("picture.ppm");
        let mut command = lab::with_empty_environment(&program)?;
        command.arg(lab::windows_path(&plugin)).arg(lab::windows_path(&picture));
        let (name, folder, picture) = ("the package for Unity", &plugin.with_file_name(""), Some(picture.as_path()));
        let mut host = Host { name, command, folder, picture, names_generator: true };
        self.check_host(log, &mut host, tally)
    }

    /// The archive's plugin for Unreal Engine with `runtime/` beside its library, as its page says, in the test engine, which compares its
    /// pictures with the library's.
    fn unreal(&self, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
        let program = unreal::host(self.context, log, self.work.join("engine"))?;
        let plugin = self.work.join("Game").join("Plugins").join("Cairn");
        copy_all(&self.root.join("unreal").join("Cairn"), &plugin)?;
        let beside = plugin.join(unreal::LIBRARY).with_file_name("");
        self.copy("runtime", &["onnxruntime.dll", "DirectML.dll"], &beside)?;
        let mut command = lab::with_empty_environment(&program)?;
        command.arg(&plugin).arg("show");
        let (name, folder, picture) = ("the plugin for Unreal Engine", beside.as_path(), None);
        let mut host = Host { name, command, folder, picture, names_generator: true };
        self.check_host(log, &mut host, tally)
    }
}

/// Copies a folder recursively.
fn copy_all(from: &Path, to: &Path) -> Result<(), String> {
    fs::create_dir_all(to).map_err(|e| format!("{}: {e}", to.display()))?;
    for entry in fs::read_dir(from).map_err(|e| format!("{}: {e}", from.display()))? {
        let entry = entry.map_err(|e| format!("{}: {e}", from.display()))?;
        let (path, copy) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy_all(&path, &copy)?;
        } else {
            fs::copy(&path, &copy).map_err(|e| format!("{}: {e}", path.display()))?;
        }
    }
    Ok(())
}

/// Whether a PPM is uniform: fewer than sixteen levels between the darkest and the brightest byte, or no pixels at all.
fn is_flat(ppm: &[u8]) -> bool {
    let mut lines = ppm.splitn(4, |byte| *byte == b'\n');
    let (kind, pixels) = (lines.next(), lines.nth(2).unwrap_or_default());
    let (least, most) = pixels.iter().fold((u8::MAX, 0), |(least, most), v| (least.min(*v), most.max(*v)));
    kind != Some(b"P6") || most.saturating_sub(least) < 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_one_colour_or_without_pixels_is_flat() {
        let picture = |pixels: &[u8]| [b"P6\n2 1\n255\n", pixels].concat();
        assert!(!is_flat(&picture(&[0, 0, 0, 255, 255, 255])));
        assert!(is_flat(&picture(&[9, 9, 9, 12, 12, 12])));
        assert!(is_flat(b"P6\n2 1\n255\n") && is_flat(b"") && is_flat(b"P5\n2 1\n255\n\x00\xff"));
    }
}
