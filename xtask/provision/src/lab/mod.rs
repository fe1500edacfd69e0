//! The lab: a Windows with Direct3D 12 and DirectML on a Linux machine that has neither.
//!
//! It is Wine and a software Vulkan driver in a Debian of their own. Two files of Wine are rebuilt from Debian's source so that
//! Microsoft's DirectML runs and programs have enough time to end. Debian's packages come through debootstrap from the
//! mirror that the machine's own apt uses. Linux programs can use its Vulkan driver too.

mod build;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use sha2::{Digest, Sha256};

use crate::{Error, Progress, Result, Silent, cache, process, tools};

/// The Debian release whose Wine runs Rust programs and is new enough for Direct3D 12.
const RELEASE: &str = "trixie";

const PACKAGES: &str = include_str!("packages.sh");
const WINE: &str = include_str!("wine.sh");
const PREFIX: &str = include_str!("prefix.sh");
const ENTER: &str = include_str!("enter.sh");
const INSIDE: &str = include_str!("inside.sh");
const LINUX: &str = include_str!("linux.sh");
const OVERLAY: &str = include_str!("overlay.sh");
const LAYER: &str = include_str!("layer.sh");
const SPIRV: &str = include_str!("spirv.sh");

/// Value of `Error::wanted` in every error here.
const WANTED: &str = "the Windows lab";

/// An installed lab.
#[derive(Debug, Clone)]
pub struct Lab {
    folder: PathBuf,
}

impl Lab {
    /// The folder that contains it.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// A command that runs a Windows program in the lab, with a display of its own. Arguments, working directory, variables and
    /// streams are passed as for any command, and paths are the machine's. Its exit status is the program's; of one with
    /// more than eight bits the lowest eight, or 1 if these are 0.
    ///
    /// Everything that the program starts ends with it, and it ends with the thread that started the command; no mount remains.
    /// Files that it writes below `C:\` are lost. One empty folder remains, `/tmp/.wine-0`: removing it would take it from
    /// concurrent runs.
    ///
    /// # Errors
    /// `program` does not exist.
    pub fn command(&self, program: &Path) -> Result<Command> {
        let program = fs::canonicalize(program)
            .map_err(|e| Error::new(program.display().to_string(), e.to_string(), "Name a program"))?;
        Ok(self.enter(&program, INSIDE))
    }

    /// A command that runs a Linux program in the lab, on its software Vulkan driver and with its system libraries. It passes the
    /// same through as [`Self::command`], has no display, and ends with everything that it started in the same way. The exit status
    /// of a program that a signal ended is 128 plus the signal's number. `/sys` contains nothing but a GPU, because ONNX Runtime
    /// searches for GPUs there.
    ///
    /// # Errors
    /// `program` does not exist.
    pub fn linux_command(&self, program: &Path) -> Result<Command> {
        // Links are kept: the Python of a virtual environment finds its packages by the path that it is started with.
        let program = fs::metadata(program)
            .and_then(|_| std::path::absolute(program))
            .map_err(|e| Error::new(program.display().to_string(), e.to_string(), "Name a program"))?;
        Ok(self.enter(&program, LINUX))
    }

    /// A command that enters the lab and runs the script `inside` there, with the program's path and arguments.
    fn enter(&self, program: &Path, inside: &str) -> Command {
        let mut command = isolated_command();
        command.args(["sh", "-euc", ENTER, "sh"]).arg(&self.folder).arg(program).env("LAB_INSIDE", inside);
        command
    }

    /// The folder of Vulkan's validation layer, for programs in the lab: its manifest and its library. It is fetched on first use (6 MB)
    /// and kept in the lab's folder, so that a lab of an earlier version gets it without being built again.
    ///
    /// # Errors
    /// As [`possible`]; the mirror cannot be reached; the package does not contain the layer. The error has the last lines of output.
    pub fn validation_layer(&self, progress: &dyn Progress) -> Result<PathBuf> {
        self.fetched("layer", LAYER, "Vulkan's validation layer", progress)
    }

    /// Programs that compile HLSL to SPIR-V and validate it. They are fetched on first use (20 MB) and kept in the lab's folder.
    ///
    /// # Errors
    /// As [`Self::validation_layer`].
    pub fn spirv_tools(&self, progress: &dyn Progress) -> Result<SpirvTools> {
        self.fetched("spirv", SPIRV, "a compiler and a validator of SPIR-V", progress)
            .map(|folder| SpirvTools { folder })
    }

    /// The folder of something from packages of the lab's Debian, which `script` copies there on first use.
    fn fetched(&self, name: &str, script: &str, what: &str, progress: &dyn Progress) -> Result<PathBuf> {
        let item = format!("{name}-{}", key(&[OVERLAY, script]));
        let folder = self.folder.join(&item);
        if folder.is_dir() {
            return Ok(folder);
        }
        possible()?;
        let held = cache::lock(&item, progress)?;
        if folder.is_dir() {
            return Ok(folder);
        }
        progress.start(&format!("the lab: fetching {what}"));
        let scratch = cache::scratch(&item, &held)?;
        build::copy_from_packages(script, &self.folder, &scratch, progress)?;
        cache::publish(&scratch, &folder)?;
        progress.done(&format!("the lab: fetching {what}: done"));
        Ok(folder)
    }
}

/// A compiler of HLSL to SPIR-V (glslang) and SPIR-V's validator, with their own libraries, so that they run on every machine that can have
/// the lab.
#[derive(Debug, Clone)]
pub struct SpirvTools {
    folder: PathBuf,
}

impl SpirvTools {
    /// The command of the compiler; arguments as `glslangValidator --help` lists them.
    pub fn compiler(&self) -> Command {
        self.program("glslangValidator")
    }

    /// The command of the validator; arguments as `spirv-val --help` lists them.
    pub fn validator(&self) -> Command {
        self.program("spirv-val")
    }

    fn program(&self, name: &str) -> Command {
        let mut command = Command::new(self.folder.join("ld-linux-x86-64.so.2"));
        command.arg("--library-path").arg(&self.folder).arg(self.folder.join(name));
        command
    }
}

/// A key of what something is made from, for its name in the cache.
fn key(parts: &[&str]) -> String {
    let mut hash = Sha256::new();
    parts.iter().for_each(|part| hash.update(part));
    cache::hex(&hash.finalize())[..12].to_owned()
}

/// The first part of a command with mount and process namespaces of its own: its mounts and processes end with it, and it ends with the
/// thread that starts it.
fn isolated_command() -> Command {
    let mut command = Command::new("setpriv");
    command.args(["--pdeathsig", "KILL", "unshare", "--mount", "--propagation", "private"]);
    command.args(["--pid", "--fork", "--kill-child=KILL"]);
    command
}

/// Whether this machine can have the lab. Examined once per process.
///
/// # Errors
/// Why it cannot: it is not Linux on x86-64, we are not root, mounting is forbidden, or the lab is not built and there is no Debian mirror or
/// no debootstrap.
pub fn possible() -> Result<()> {
    static ANSWER: OnceLock<Result<()>> = OnceLock::new();
    ANSWER.get_or_init(find_obstacle).clone()
}

/// Looks for a reason why this machine cannot have the lab, and returns it as an error.
fn find_obstacle() -> Result<()> {
    let refuse = |cause: String, remedy: &str| Err(Error::new(WANTED, cause, remedy));
    let (os, architecture) = (std::env::consts::OS, std::env::consts::ARCH);
    if (os, architecture) != ("linux", "x86_64") {
        return refuse(format!("this is {os} on {architecture}"), "Use Linux on x86-64");
    }
    if !tools::is_root() {
        return refuse(
            "root is needed to make it and to run in it".to_owned(),
            "Run the command as root, or in a container",
        );
    }
    for program in ["setpriv", "unshare", "chroot", "mount"] {
        if tools::on_path(program).is_none() {
            return refuse(format!("there is no {program} on the PATH"), "Install util-linux");
        }
    }
    let try_it = "mount -t tmpfs lab /mnt && mkdir /mnt/l /mnt/u /mnt/w /mnt/r && cd /mnt && \
                  mount -t overlay -o lowerdir=l,upperdir=u,workdir=w lab r";
    let tried = process::run(isolated_command().args(["sh", "-c", try_it]), |_| {})
        .map_err(|e| Error::io(Path::new("setpriv"), &e))?;
    if !tried.status.success() {
        let cause = format!("this machine lets nobody mount: {}", tried.tail(1));
        return refuse(cause, "Run the command where root may mount (a container needs the capability SYS_ADMIN)");
    }
    if folder().is_ok_and(|folder| is_complete(&folder)) {
        return Ok(());
    }
    if ["debootstrap", "apt-get"].into_iter().all(|program| tools::on_path(program).is_none()) {
        return refuse("there is no debootstrap on the PATH".to_owned(), "Install debootstrap");
    }
    build::mirror(&Silent).map(drop)
}

/// The lab's folder in the cache.
fn folder() -> Result<PathBuf> {
    Ok(cache::cache_dir()?.join(item()))
}

/// The lab's name in the cache.
fn item() -> String {
    format!("lab-{}", key(&[RELEASE, PACKAGES, WINE, PREFIX]))
}

/// The file that a complete lab has.
fn completion(folder: &Path) -> PathBuf {
    folder.join("complete")
}

fn is_complete(folder: &Path) -> bool {
    completion(folder).is_file()
}

/// The lab; built on first use, which takes some five minutes and 2.5 GB of disk, 4 GB while it is built. A build that was
/// interrupted goes on where it was.
///
/// # Errors
/// As [`possible`], an unreachable mirror, or a step that failed, with its last words.
pub fn lab(progress: &dyn Progress) -> Result<Lab> {
    let lab = Lab { folder: folder()? };
    if is_complete(&lab.folder) {
        return Ok(lab);
    }
    possible()?;
    let _held = cache::lock(&item(), progress)?;
    if is_complete(&lab.folder) {
        return Ok(lab);
    }
    build::build(&lab.folder, progress)?;
    let complete = completion(&lab.folder);
    fs::write(&complete, "").map_err(|e| Error::io(&complete, &e))?;
    Ok(lab)
}
