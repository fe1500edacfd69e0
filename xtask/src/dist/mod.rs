//! `cargo xtask dist`: archives and Python wheels for users, byte for byte the same for the same commit and compiler.

mod archive;
mod contents;
mod dependencies;
mod library;
mod runtime;
mod sbom;
pub(crate) mod tree;
pub(crate) mod unity;
mod unreal;
mod wheel;

use std::fs;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use provision::{Console, Progress};
use sha2::{Digest, Sha256};

use crate::cli::DistOptions;
use crate::workspace::Workspace;

pub(crate) use contents::{DIRECTML_TERMS, TERMS};
use dependencies::Part;
pub(crate) use library::{Source, exports, soname};
pub(crate) use runtime::MINGW_NOTICES;
use sbom::Classification;
use tree::Tree;
pub(crate) use unreal::{PLUGIN as UNREAL, assemble as assemble_unreal};

/// The platform that an archive is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Platform {
    /// Windows 10 and 11 on x86-64
    #[value(name = "windows-x64")]
    Windows,
    /// Linux on x86-64, with glibc 2.28 or later
    #[value(name = "linux-x64")]
    Linux,
}

impl Platform {
    const ALL: [Self; 2] = [Self::Linux, Self::Windows];

    fn name(self) -> &'static str {
        match self {
            Self::Windows => "windows-x64",
            Self::Linux => "linux-x64",
        }
    }

    /// The target triple as rustc names it.
    fn triple(self) -> &'static str {
        match self {
            Self::Windows => provision::tools::WINDOWS_TARGET,
            Self::Linux => "x86_64-unknown-linux-gnu",
        }
    }
}

/// What to make for a platform.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Parts {
    /// Archives and Python wheels.
    All,
    Archives,
    Wheels,
}

/// File name of the list of the archives' checksums, beside them.
const SUMS: &str = "SHA256SUMS";

/// Builds the library, packs what `options` choose, and prints the result.
pub(crate) fn run(workspace: &Workspace, options: &DistOptions) -> Result<(), String> {
    let folder = options.out.clone().unwrap_or_else(|| workspace.target.join("dist"));
    let platforms = if options.platforms.is_empty() { &Platform::ALL[..] } else { &options.platforms };
    let parts = if options.wheels { Parts::Wheels } else { Parts::All };
    let made = make(workspace, platforms, parts, Source::Release, &folder)?;
    for archive in &made {
        println!("{:>7.1} MB  {}", archive.bytes as f64 / 1e6, archive.path.display());
    }
    println!("            {}", folder.join(SUMS).display());
    Ok(())
}

/// An archive that was written.
pub(crate) struct PackedFile {
    pub(crate) path: PathBuf,
    pub(crate) bytes: u64,
    pub(crate) sha256: String,
}

/// Writes `parts` for `platforms` into `folder`, the wheel last for each platform; existing files of the same names are replaced.
pub(crate) fn make(
    workspace: &Workspace,
    platforms: &[Platform],
    parts: Parts,
    source: Source,
    folder: &Path,
) -> Result<Vec<PackedFile>, String> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return Err("archives are made on Linux on x86-64, for Windows too: MinGW-w64 links them. On Windows take \
                    target\\release after cargo build --release"
            .to_owned());
    }
    let console = Console::new();
    fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let build_time = archive::build_time(workspace)?;
    let mut made = Vec::new();
    for &platform in platforms {
        console.start(&format!("{}: building the library and cairn-check", platform.name()));
        let built = library::build(workspace, platform, source, build_time)?;
        console.start(&format!("{}: licences of what is in it", platform.name()));
        let library = listed(workspace, platform, "cairn", &built.debug, Classification::Library, build_time)?;
        let symbols = &built.check.with_symbols;
        let check = listed(workspace, platform, "cairn-check", symbols, Classification::Application, build_time)?;
        let mut write = |tree: &Tree, pack: fn(&Tree, Timestamp) -> Result<Vec<u8>, String>, ending: &str| {
            console.start(&format!("packing {}", tree.name()));
            let path = folder.join(format!("{}{ending}", tree.name()));
            let packed = pack(tree, build_time)?;
            fs::write(&path, &packed).map_err(|e| format!("{}: {e}", path.display()))?;
            let sha256 = Sha256::digest(&packed).iter().map(|byte| format!("{byte:02x}")).collect();
            console.done(&format!("{}: {} files", tree.name(), tree.files().count()));
            made.push(PackedFile { path, bytes: packed.len() as u64, sha256 });
            Ok::<(), String>(())
        };
        if parts != Parts::Wheels {
            for slim in [false, true] {
                let tree = contents::archive_tree(workspace, platform, &built, &library, &check, slim)?;
                let Some(tree) = tree else { continue };
                match platform {
                    Platform::Windows => write(&tree, archive::zip, ".zip")?,
                    Platform::Linux => write(&tree, archive::tar_gz, ".tar.gz")?,
                }
            }
        }
        if parts != Parts::Archives {
            let tree = wheel::wheel_tree(workspace, platform, &built, &library.parts, &library.bill)?;
            write(&tree, archive::zip, "")?;
        }
    }
    let lines: String =
        made.iter().map(|archive| format!("{}  {}\n", archive.sha256, file_name(&archive.path))).collect();
    let sums = folder.join(SUMS);
    fs::write(&sums, lines).map_err(|e| format!("{}: {e}", sums.display()))?;
    Ok(made)
}

/// The components of a library or program, and their bill of materials.
struct Components {
    /// Itself first.
    parts: Vec<Part>,
    bill: Vec<u8>,
}

/// The components of a `package`: crates, and the compilers' runtime parts, which are found in its `debug` information.
fn listed(
    workspace: &Workspace,
    platform: Platform,
    package: &str,
    debug: &[u8],
    class: Classification,
    build_time: Timestamp,
) -> Result<Components, String> {
    let mut parts = dependencies::crates(workspace, platform, package)?;
    let runtimes = runtime::parts(workspace, platform, debug)?;
    let own = parts.first_mut().ok_or("a package of no crates")?;
    own.uses.extend(runtimes.iter().map(Part::reference));
    parts.extend(runtimes);
    Ok(Components { bill: sbom::write(&parts, class, build_time)?, parts })
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
