//! The first demonstration after cloning the repository: walks through the four levels, a rollout that can be made again, and two seconds of
//! frame generation compared with the truth.

pub(crate) mod levels;

use std::path::Path;

use crate::job::JobOutcome;
use crate::output::{MANIFEST, SHEET, VIDEO};
use crate::progress::duration;
use crate::reconstruct::ReconstructSettings;

/// Printed before the demo starts.
pub(crate) const WELCOME: &str = "\
Part 1: a walk through each of the four levels that the small world inside the library knows. It gets one picture and the controls.
Left, it makes all 60 frames a second; right, it makes 15 anchors a second and frames are generated between them.
";

/// Printed before the rollout.
pub(crate) const SECOND_PART: &str = "
Part 2: the same world as a rollout with a manifest: 15 anchors a second and a generated frame after each, from optical flow.
";

/// Printed before the frame generation part.
pub(crate) const THIRD_PART: &str = "
Part 3: frame generation alone, between sharp anchors: a walk rendered 15 times a second and shown 60 times,
with every generated frame beside the rendered one of the same time.
";

/// Folder of the frame generation part within that of the demo.
pub(crate) const RECONSTRUCT: &str = "reconstruct";

/// Small, so that it takes seconds; without LPIPS, so that the result does not depend on whether its weights are installed.
pub(crate) fn reconstruct() -> ReconstructSettings {
    ReconstructSettings { scene: "sword".into(), size: [384, 216], ..ReconstructSettings::default() }
}

/// Text that lists the results and the files to open.
pub(crate) fn summary(outcome: &JobOutcome, out: &Path) -> String {
    let counts = outcome.manifest.counts;
    let seconds = outcome.manifest.timings.get("total").copied().unwrap_or(0.0);
    let mut text = format!(
        "{} frames from {} anchors ({} generated) and {} passes of the transformer in {}\n",
        counts.presented,
        counts.anchors,
        counts.generated,
        counts.passes,
        duration(seconds),
    );
    let of = |name: &str| crate::manifest::absolute(&out.join(name)).display().to_string();
    if outcome.manifest.outputs.iter().any(|o| o.path == VIDEO) {
        text += &format!("  {}   open it in a browser\n", of(VIDEO));
    }
    if outcome.manifest.outputs.iter().any(|o| o.path == SHEET) {
        text += &format!("  {}   anchors, generated frames, motion, depth\n", of(SHEET));
    }
    text += &format!("  {}   all settings and checksums; `study replay` makes the same files from it\n", of(MANIFEST));
    text
}
