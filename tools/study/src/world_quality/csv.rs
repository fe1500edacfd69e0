//! Results as CSV.

use std::fmt::Write as _;

use super::endurance::second;
use super::figures::{Results, WalkResult};
use crate::metrics::Score;

/// CSV with a line for each score.
pub(super) fn scores(results: &Results) -> String {
    let mut text = String::from("place,seconds,what,psnr_db,ssim,lpips_alex\n");
    for WalkResult { place, walked, .. } in &results.all {
        let mut line = |seconds: f64, what: &str, score: &Score| {
            let lpips = score.lpips.map(|value| format!("{value:.6}")).unwrap_or_default();
            let _ = writeln!(text, "{},{seconds},{what},{:.4},{:.6},{lpips}", place.key(), score.psnr, score.ssim);
        };
        for h in &walked.horizons {
            line(h.seconds, "world", &h.world);
            line(h.seconds, "repeat", &h.repeat);
            line(h.seconds, "reconstruction", &h.reconstruction);
        }
        for (seconds, score) in &walked.few_steps {
            line(*seconds, "stock", score);
        }
    }
    text
}

/// CSV with a line for each walk and second: brightness, colour, contrast and detail relative to the truth.
pub(super) fn seconds(results: &Results) -> String {
    let mut text = String::from("place,second,brightness,colour,contrast,detail\n");
    for WalkResult { place, walked, .. } in &results.all {
        for end in results.ends() {
            let Some(s) = second(walked, end, results.latents_per_second) else { continue };
            let _ = writeln!(
                text,
                "{},{end},{:.4},{:.2},{:.4},{:.4}",
                place.key(),
                s.brightness,
                s.colour,
                s.contrast,
                s.detail
            );
        }
    }
    text
}

/// CSV with a line for each pose that was searched for.
pub(super) fn poses(results: &Results) -> String {
    let mut text = String::from(
        "place,seconds,metres,degrees,truth_metres,truth_degrees,start_metres,start_degrees,psnr_db,truth_psnr_db\n",
    );
    for WalkResult { place, walked, .. } in &results.all {
        for p in &walked.poses {
            let numbers = [p.world, p.truth, p.repeat].concat().into_iter().chain(p.psnr).map(|v| format!("{v:.2}"));
            let _ = writeln!(text, "{},{},{}", place.key(), p.seconds, numbers.collect::<Vec<_>>().join(","));
        }
    }
    text
}
