//! `cargo xtask shaders`: compiles the HLSL of the library, its benchmark, and the test double of AMD's libraries to DXBC, with
//! Microsoft's compiler in the lab or on Windows.
//!
//! Each `NAME.hlsl` of a folder has its `NAME.dxbc` in the folder's `compiled/`, where `checksums.txt` records which source each blob was
//! compiled from, so that a machine without the lab also detects when only one of them has changed.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::{Console, tools};
use sha2::{Digest, Sha256};

use crate::workspace::Workspace;
use crate::{lab, shell};

/// Folder of the library's shaders.
pub(crate) const LIBRARY: &str = "src/gpu/shaders";
/// Folders of the shaders' sources.
pub(crate) const FOLDERS: [&str; 3] = [LIBRARY, "benches/gpu", "tests/ffx-double/src"];
/// The Windows program that calls the compiler.
const COMPILER: &str = "tests/lab/compile.rs";
/// Folder of the blobs and of their record, in the folder of the sources.
const COMPILED: &str = "compiled";
/// Checksums of each source and of its blob.
const RECORD: &str = "checksums.txt";
/// The first line of the record.
const RECORD_HEAD: &str = "# Written by `cargo xtask shaders`: each shader, the SHA-256 of its source with all .hlsli files of the folder, and the SHA-256 of its blob.\n";

/// The shaders of one folder.
pub(crate) struct Shaders {
    /// Folder of the sources, relative to the repository's root.
    name: &'static str,
    /// The same as an absolute path.
    folder: PathBuf,
    /// Names without extensions.
    pub(crate) names: Vec<String>,
    /// All `.hlsli` files of the folder, which each shader may include, with Linux line ends.
    included: Vec<u8>,
}

impl Shaders {
    pub(crate) fn find(workspace: &Workspace, name: &'static str) -> Result<Self, String> {
        let folder = workspace.root.join(name);
        let entries = fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        files.sort();
        let (mut names, mut included) = (Vec::new(), Vec::new());
        for file in &files {
            match file.extension().and_then(|ending| ending.to_str()) {
                Some("hlsl") => names.push(file.file_stem().unwrap_or_default().to_string_lossy().into_owned()),
                Some("hlsli") => included.extend(text(file)?),
                _ => {}
            }
        }
        Ok(Self { name, folder, names, included })
    }

    /// The source of a shader.
    pub(crate) fn source(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.hlsl"))
    }

    /// The committed blob of a shader.
    pub(crate) fn blob(&self, name: &str) -> PathBuf {
        self.compiled().join(format!("{name}.dxbc"))
    }

    /// Folder of the committed blobs and of their record.
    fn compiled(&self) -> PathBuf {
        self.folder.join(COMPILED)
    }

    /// The record's line of a shader, with the checksums of its source and its blob.
    fn line(&self, name: &str) -> Result<String, String> {
        let mut source = Sha256::new();
        source.update(text(&self.source(name))?);
        source.update(&self.included);
        let blob = self.blob(name);
        let blob = fs::read(&blob).map_err(|e| format!("{}: {e}", blob.display()))?;
        Ok(format!("{name} {} {}", hex(&source.finalize()), hex(&Sha256::digest(blob))))
    }

    /// How a shader differs from the record, if it does.
    pub(crate) fn differs(&self, name: &str) -> Option<String> {
        let remedy = "run cargo xtask shaders";
        let line = match self.line(name) {
            Ok(line) => line,
            Err(why) => return Some(format!("{why}: {remedy}")),
        };
        match self.record().map(|record| record.get(name).cloned()) {
            Ok(Some(recorded)) if recorded == line => None,
            Ok(_) => {
                Some(format!("{}/{name}: the source or the blob differs from {COMPILED}/{RECORD}: {remedy}", self.name))
            }
            Err(why) => Some(format!("{why}: {remedy}")),
        }
    }

    /// Blobs and lines of the record without a shader.
    pub(crate) fn left_over(&self) -> Result<Vec<String>, String> {
        let folder = self.compiled();
        let entries = fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        let blobs =
            entries.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "dxbc"));
        let blobs = blobs.map(|path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
        let known = |name: &String| self.names.contains(name);
        Ok(blobs.chain(self.record()?.into_keys()).filter(|name| !known(name)).collect())
    }

    fn record(&self) -> Result<BTreeMap<String, String>, String> {
        let lines = text(&self.compiled().join(RECORD))?;
        let lines = String::from_utf8_lossy(&lines).into_owned();
        let named = |line: &str| Some((line.split_once(' ')?.0.to_owned(), line.to_owned()));
        Ok(lines.lines().filter(|line| !line.starts_with('#')).filter_map(named).collect())
    }

    /// A command that compiles all of them into `out`; builds the compiling program first.
    pub(crate) fn compiler(&self, workspace: &Workspace, out: &Path) -> Result<Command, String> {
        let console = Console::new();
        let library = provision::d3dcompiler(&console).map_err(|e| e.to_string())?;
        fs::create_dir_all(out).map_err(|e| format!("{}: {e}", out.display()))?;
        let program = out.join("compile.exe");
        let mut rustc = Command::new("rustc");
        rustc.args(["--edition=2024", "-o"]).arg(&program).arg(COMPILER).current_dir(&workspace.root);
        if !cfg!(windows) {
            tools::rust_target(tools::WINDOWS_TARGET, &console).map_err(|e| e.to_string())?;
            tools::mingw(&console).map_err(|e| e.to_string())?;
            rustc.args(["--target", tools::WINDOWS_TARGET]);
        }
        shell::output(&mut rustc)?;
        let mut command = lab::command(&program)?;
        // Wine's own compiler is another one, and must not be used.
        command.env("WINEDLLOVERRIDES", "mscoree,mshtml=;d3dcompiler_47=n").arg(library);
        for name in &self.names {
            command.arg(self.source(name)).arg(output(out, name));
        }
        Ok(command)
    }
}

/// Path of the blob that [`Shaders::compiler`] writes.
pub(crate) fn output(out: &Path, name: &str) -> PathBuf {
    out.join(format!("{name}.dxbc"))
}

/// File of the constants that the library's shaders share with its code for the processor, made of those in Rust by a test of the library.
const CONSTANTS: &str = "src/gpu/shaders/constants.hlsli";
const CONSTANTS_TEST: &str = "shader_constants::tests::the_shaders_have_the_constants_of_the_processors_code";
/// Tells the test where to write the file, which it otherwise compares.
const WRITE_CONSTANTS: &str = "CAIRN_WRITE_SHADER_CONSTANTS";

/// Writes the constants; compiles every shader, and rewrites blobs and records.
pub(crate) fn compile(workspace: &Workspace) -> Result<(), String> {
    let mut constants = workspace.cargo(["test", "--package", "cairn", "--lib", "--", "--exact", CONSTANTS_TEST]);
    shell::pass_through(constants.env(WRITE_CONSTANTS, workspace.root.join(CONSTANTS)))?;
    for folder in FOLDERS {
        let shaders = Shaders::find(workspace, folder)?;
        let out = workspace.target.join("xtask").join("shaders");
        let compiled = shaders.compiled();
        fs::create_dir_all(&compiled).map_err(|e| format!("{}: {e}", compiled.display()))?;
        shell::pass_through(&mut shaders.compiler(workspace, &out)?)?;
        let mut record = RECORD_HEAD.to_owned();
        for name in &shaders.names {
            let (from, to) = (output(&out, name), shaders.blob(name));
            fs::copy(&from, &to).map_err(|e| format!("{}: {e}", to.display()))?;
            record += &shaders.line(name)?;
            record.push('\n');
        }
        for name in shaders.left_over().unwrap_or_default() {
            _ = fs::remove_file(shaders.blob(&name));
        }
        let path = compiled.join(RECORD);
        fs::write(&path, record).map_err(|e| format!("{}: {e}", path.display()))?;
        eprintln!("{} shaders compiled into {folder}/{COMPILED}", shaders.names.len());
    }
    Ok(())
}

/// A source with Linux line ends, so that a checkout on Windows has the same checksum.
fn text(path: &Path) -> Result<Vec<u8>, String> {
    let bytes = fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(bytes.into_iter().filter(|byte| *byte != b'\r').collect())
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
