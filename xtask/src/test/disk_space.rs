//! Checks for enough disk space before the tests start, rather than failing half an hour later.

use std::fs;

use crate::workspace::Workspace;

/// In bytes.
const GB: u64 = 1_000_000_000;
/// What the whole set writes into an empty target directory: 11 GB measured, plus a margin.
const FROM_NOTHING: u64 = 13 * GB;
/// An estimate of what it writes if everything was built before: programs and logs.
const BUILT_BEFORE: u64 = 2 * GB;

/// Refuses to start if the target directory's disk has too little space for all runners.
pub(super) fn require(workspace: &Workspace) -> Result<(), String> {
    fs::create_dir_all(&workspace.target).map_err(|e| format!("{}: {e}", workspace.target.display()))?;
    // A file system that does not report its free space is not a reason to stop.
    let Ok(free) = fs4::available_space(&workspace.target) else { return Ok(()) };
    // A folder that is built late.
    let built = workspace.target.join("tsan").is_dir();
    let needed = if built { BUILT_BEFORE } else { FROM_NOTHING };
    if free >= needed {
        return Ok(());
    }
    Err(format!(
        "all tests need about {} GB in {}, and {:.1} GB are free there. Make room, or let CARGO_TARGET_DIR name a folder on \
         another disk; `cargo xtask test RUNNER` runs a part that needs less",
        needed / GB,
        workspace.target.display(),
        free as f64 / GB as f64
    ))
}
