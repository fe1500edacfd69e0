//! Is there room on the disk for everything? Half an hour later is too late to say no.

use std::fs;

use crate::workspace::Workspace;

/// Of bytes.
const GB: u64 = 1_000_000_000;
/// What the whole set writes into a target directory that has nothing: 11 GB measured, and some to spare.
const FROM_NOTHING: u64 = 13 * GB;
/// What it writes where all was built before, by reckoning: programs and logs.
const BUILT_BEFORE: u64 = 2 * GB;

/// Refuses to begin where the target directory's disk is too full for all runners.
pub(super) fn require(workspace: &Workspace) -> Result<(), String> {
    fs::create_dir_all(&workspace.target).map_err(|e| format!("{}: {e}", workspace.target.display()))?;
    // A file system that does not tell is not a reason to stop.
    let Ok(free) = fs4::available_space(&workspace.target) else { return Ok(()) };
    // Built last of all compiled code.
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
