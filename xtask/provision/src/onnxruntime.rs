//! The ONNX Runtime library, taken out of its PyPI wheel.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::python::{self, Python, text};
use crate::{Error, Progress, Result, cache, process};

/// The version Cairn is built for and tested with.
pub const VERSION: &str = "1.24.4";

/// A platform's wheel, and the expected files in it.
struct Source {
    /// Name on PyPI.
    package: &'static str,
    /// pip's platform tag.
    platform: &'static str,
    /// The folder in the wheel.
    folder: &'static str,
    /// Files of that folder with their SHA-256; the library itself is the first.
    files: &'static [(&'static str, &'static str)],
}

/// Wheels differ between Python versions, the library in them does not: with one fixed tag one file is fetched.
const PYTHON_TAG: [&str; 6] = ["--python-version", "3.11", "--implementation", "cp", "--abi", "cp311"];

const LINUX_X86_64: Source = Source {
    package: "onnxruntime",
    platform: "manylinux_2_28_x86_64",
    folder: "onnxruntime/capi",
    files: &[("libonnxruntime.so.1.24.4", "2d518e11c7767f9fdc4413bdbeb45acf30db504ff76a82fc19d9238a3f9f6c24")],
};
const LINUX_AARCH64: Source = Source {
    package: "onnxruntime",
    platform: "manylinux_2_28_aarch64",
    folder: "onnxruntime/capi",
    files: &[("libonnxruntime.so.1.24.4", "f373ae5fd4d878ed17ebea26e5480bd3d0a15e3bd6bc94b878e6c1b73998d22a")],
};
const MACOS_AARCH64: Source = Source {
    package: "onnxruntime",
    platform: "macosx_14_0_arm64",
    folder: "onnxruntime/capi",
    files: &[("libonnxruntime.1.24.4.dylib", "f7a4418c1fbbb12705f26991c52cd9e4a90c54d4802c487d0facb20897790fe9")],
};
const WINDOWS_X86_64: Source = Source {
    package: "onnxruntime-directml",
    platform: "win_amd64",
    folder: "onnxruntime/capi",
    files: &[
        ("onnxruntime.dll", "0a49bb13573807ad309aa9967a46471c07d6495bab5b279d1fad474aefd8ef4b"),
        ("DirectML.dll", "c07cb8c2f870f0152bfb690f64c4b048e78bbc219efad420a9758fc896cbecb0"),
    ],
};
/// The licence files of the Windows library, in the same wheel.
const WINDOWS_TERMS: Source = Source {
    package: "onnxruntime-directml",
    platform: "win_amd64",
    folder: "onnxruntime",
    files: &[
        ("LICENSE", "c250d6278f0b47a6439fb7592b08b58a55eb9f535aa49a1db63211c3f982b674"),
        ("ThirdPartyNotices.txt", "fb0af774b4d7cffc5b9d046f2aaeade2f37df2f80abf8033c95dfffcc77a8866"),
    ],
};

fn source(os: &str, architecture: &str) -> Option<&'static Source> {
    match (os, architecture) {
        ("linux", "x86_64") => Some(&LINUX_X86_64),
        ("linux", "aarch64") => Some(&LINUX_AARCH64),
        ("macos", "aarch64") => Some(&MACOS_AARCH64),
        ("windows", "x86_64") => Some(&WINDOWS_X86_64),
        _ => None,
    }
}

/// Path of the ONNX Runtime library for this machine; fetched from PyPI and checked on first use.
///
/// On Windows it is the DirectML build, with `DirectML.dll` beside it.
///
/// # Errors
/// No wheel for this platform, no Python with pip, an unreachable index, or a library that is not the pinned one.
pub fn onnxruntime(progress: &dyn Progress) -> Result<PathBuf> {
    let Some(source) = source(std::env::consts::OS, std::env::consts::ARCH) else {
        return Err(Error::new(
            format!("ONNX Runtime {VERSION}"),
            format!("PyPI has no build for {} on {}", std::env::consts::OS, std::env::consts::ARCH),
            "Use Linux (x86-64, AArch64), Windows (x86-64) or macOS (AArch64)",
        ));
    };
    fetch(source, &format!("onnxruntime-{VERSION}"), progress)
}

/// Path of `onnxruntime.dll` with `DirectML.dll` beside it, for programs that run in the [`lab`](crate::lab) or on Windows.
///
/// # Errors
/// As [`onnxruntime`].
pub fn onnxruntime_for_windows(progress: &dyn Progress) -> Result<PathBuf> {
    if cfg!(windows) {
        onnxruntime(progress)
    } else {
        fetch(&WINDOWS_X86_64, &format!("onnxruntime-directml-{VERSION}"), progress)
    }
}

/// The files that accompany a program for Windows: `onnxruntime.dll`, `DirectML.dll`, and ONNX Runtime's licence files.
///
/// # Errors
/// As [`onnxruntime`].
pub fn onnxruntime_with_terms(progress: &dyn Progress) -> Result<Vec<PathBuf>> {
    let library = onnxruntime_for_windows(progress)?;
    let terms = fetch(&WINDOWS_TERMS, &format!("onnxruntime-directml-terms-{VERSION}"), progress)?;
    let beside = |first: &Path, source: &Source| -> Vec<PathBuf> {
        source.files.iter().map(|(file, _)| first.with_file_name(file)).collect()
    };
    Ok([beside(&library, &WINDOWS_X86_64), beside(&terms, &WINDOWS_TERMS)].concat())
}

/// The first file of `source`, kept in the cache as `name`.
fn fetch(source: &Source, name: &str, progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = format!("ONNX Runtime {VERSION}");
    let folder = cache::cache_dir()?.join(name);
    let library = folder.join(source.files[0].0);
    let complete = || source.files.iter().all(|(file, _)| folder.join(file).is_file());
    if complete() {
        return Ok(library);
    }

    let held = cache::lock(name, progress)?;
    if complete() {
        return Ok(library);
    }
    let python = python::find()?;
    progress.start(&format!("fetching {wanted} (package {} from PyPI)", source.package));
    let scratch = cache::scratch(name, &held)?;
    let requirement = format!("{}=={VERSION}", source.package);
    let mut arguments = vec!["download", "--quiet", "--no-deps", "--only-binary=:all:", "--platform", source.platform];
    arguments.extend(PYTHON_TAG);
    arguments.extend(["--dest", text(&scratch)?, &requirement]);
    python::pip(&python, &arguments, &wanted, &scratch, progress)?;
    unpack(&python, source, &wanted, &scratch)?;
    let unpacked = scratch.join("library");
    for (file, pinned) in source.files {
        let found = cache::sha256_of(&unpacked.join(file))?;
        if found != *pinned {
            return Err(Error::new(
                wanted,
                format!("{file} has SHA-256 {found}, not {pinned}"),
                "The package index served another file than the published one: check pip's configuration",
            ));
        }
    }
    cache::publish(&unpacked, &folder)?;
    cache::remove(&scratch)?;
    progress.done(&format!("{wanted}: {}", library.display()));
    Ok(library)
}

/// Extracts the library's files from the only wheel in `scratch`. A wheel is a ZIP file, which Python can read.
fn unpack(python: &Python, source: &Source, wanted: &str, scratch: &Path) -> Result<()> {
    const SCRIPT: &str = "import pathlib, sys, zipfile\n\
        folder = pathlib.Path(sys.argv[1])\n\
        target = folder / 'library'\n\
        target.mkdir()\n\
        (wheel,) = folder.glob('*.whl')\n\
        with zipfile.ZipFile(wheel) as archive:\n\
        \x20   for name in sys.argv[3:]:\n\
        \x20       (target / name).write_bytes(archive.read(sys.argv[2] + '/' + name))\n";
    let mut command = Command::new(&python.program);
    command.args(["-I", "-c", SCRIPT]).arg(scratch).arg(source.folder).args(source.files.iter().map(|(file, _)| file));
    let outcome = process::run(&mut command, |_| {}).map_err(|e| Error::io(&python.program, &e))?;
    if outcome.status.success() {
        return fs::metadata(scratch.join("library")).map(drop).map_err(|e| Error::io(scratch, &e));
    }
    Err(Error::new(
        wanted,
        format!("its wheel cannot be unpacked:\n{}\n", outcome.tail(2)),
        "Make room on the disk and run the command again; if it stays, clear pip's cache (pip cache purge)",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn library_names_carry_the_version_and_sums_are_sha256() {
        for source in [&LINUX_X86_64, &LINUX_AARCH64, &MACOS_AARCH64, &WINDOWS_X86_64] {
            let (library, _) = source.files[0];
            assert!(library == "onnxruntime.dll" || library.contains(VERSION), "{library}");
            for (file, sum) in source.files {
                assert!(sum.len() == 64 && sum.bytes().all(|b| b.is_ascii_hexdigit()), "{file}");
            }
        }
    }
}
