//! Settings of other programs, compared on the scenes' seed for tuning.

use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::{Error, ErrorKind, Result};
use scenes::LANDSCAPES;

use super::{Interval, Kind, Row, flowfps, minterpolate, rife};
use crate::metrics::{Lpips, Score};
use crate::progress::Progress;
use crate::quality::clips::{Clip, Phase, Scale, scene::SceneClip};
use crate::quality::store::Store;

/// The one seed that settings are chosen on.
const SEED: u64 = 4;
/// Every second scored interval of a clip.
const STRIDE: usize = 2;

/// Values of `minterpolate`'s options; all variants compensate motion in overlapped blocks.
const MINTERPOLATE: [&str; 11] = [
    minterpolate::SETTINGS,
    "mi_mode=mci:mc_mode=aobmc:me_mode=bidir:vsbmc=1",
    "mi_mode=mci:mc_mode=aobmc:me_mode=bidir:vsbmc=0",
    "mi_mode=mci:mc_mode=obmc:me_mode=bidir:vsbmc=1",
    "mi_mode=mci:mc_mode=aobmc:me_mode=bilat:vsbmc=1",
    "mi_mode=mci:mc_mode=aobmc:me_mode=bidir:vsbmc=1:scd=none",
    "mi_mode=mci:mc_mode=aobmc:me_mode=bidir:vsbmc=1:mb_size=8",
    "mi_mode=mci:mc_mode=aobmc:me_mode=bidir:vsbmc=1:me=umh",
    "mi_mode=mci:mc_mode=aobmc:me_mode=bidir:vsbmc=1:me=esa:search_param=16",
    "mi_mode=mci:mc_mode=aobmc:me_mode=bidir:vsbmc=1:me=esa:search_param=32",
    "mi_mode=mci:mc_mode=aobmc:me_mode=bilat:vsbmc=1:mb_size=8:me=esa:search_param=16",
];

/// Changes to the settings at the top of `flowfps.py`.
const FLOWFPS: [&str; 12] = [
    "{}",
    r#"{"ANALYSE": {"blksize": 16, "overlap": 8}, "REFINE": {"blksize": 8, "overlap": 4}}"#,
    r#"{"ANALYSE": {"blksize": 32, "overlap": 16}, "REFINE": {"blksize": 8, "overlap": 4}}"#,
    r#"{"ANALYSE": {"blksize": 32, "overlap": 16}, "REFINE": {"blksize": 16, "overlap": 8}}"#,
    r#"{"ANALYSE": {"blksize": 16, "overlap": 8}, "REFINE": {"blksize": 4, "overlap": 2}}"#,
    r#"{"ANALYSE": {"truemotion": false}, "REFINE": {"truemotion": false}}"#,
    r#"{"ANALYSE": {"searchparam": 16}, "REFINE": {"searchparam": 8}}"#,
    r#"{"ANALYSE": {"dct": 5}, "REFINE": {"dct": 5}}"#,
    r#"{"RENDER": {"mask": 0}}"#,
    r#"{"RENDER": {"mask": 1}}"#,
    r#"{"RENDER": {"mask": 2, "ml": 50.0}}"#,
    r#"{"RENDER": {"mask": 2, "ml": 200.0}}"#,
];

/// Ensemble and refinement of RIFE 4.0.
const RIFE4: [&str; 4] =
    ["--ensemble --no-refine", "--no-ensemble --no-refine", "--no-ensemble --refine", "--ensemble --refine"];

/// Settings, and the row that uses them.
type Variant = (String, Box<dyn Row>);

/// Scores every variant of the row called `name` on seed 4 of the scenes: a table, best PSNR first. The first variant of each
/// list is the one in use.
///
/// # Errors
/// A row without settings, or one that is not available or fails.
pub(in crate::quality) fn table(
    name: &str,
    lpips: Option<&Lpips>,
    store: &Store,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<String> {
    let (kind, mut rows) = variants(name, progress)?;
    let clips = LANDSCAPES.into_iter().map(|family| SceneClip::new(family, SEED, Scale::Full));
    let mut clips = clips.collect::<Result<Vec<_>>>()?;
    let intervals: usize = clips.iter().map(|clip| clip.targets().len().div_ceil(STRIDE)).sum();
    progress.begin((intervals * rows.len()) as u64);
    let mut sums = vec![[0.0; 3]; rows.len()];
    let mut done = 0;
    for clip in &mut clips {
        let ends: Vec<usize> = clip.targets().iter().step_by(STRIDE).map(|target| target.anchor).collect();
        let weight = 1.0 / (ends.len() * LANDSCAPES.len()) as f64;
        for end in ends {
            let first = end - 1 - kind.margin();
            let anchors = (first..=end + kind.margin()).map(|number| clip.anchor(number, store));
            let anchors = anchors.collect::<Result<Vec<_>>>()?;
            let interval = Interval {
                anchors: &anchors,
                at: kind.margin(),
                guidance: None,
                before: None,
                overlay: None,
                history: &[],
            };
            let truth = clip.truth(end, Phase::HALF, store)?;
            let features = lpips.map(|lpips| lpips.features(&truth)).transpose()?;
            for ((_, row), sum) in rows.iter_mut().zip(&mut sums) {
                if stop.load(Ordering::SeqCst) {
                    return Err(Error::new(ErrorKind::Cancelled, "interrupted"));
                }
                let made = row.make(&interval, &[Phase::HALF])?.remove(0);
                let distance = lpips.zip(features.as_ref()).map(|(lpips, truth)| lpips.distance_to(truth, &made));
                let score = Score::new(&truth, &made, distance.transpose()?)?;
                let values = [score.psnr, score.ssim, score.lpips.unwrap_or(f64::NAN)];
                sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
                done += 1;
                progress.frames(done);
            }
        }
    }
    progress.end();
    Ok(text(rows.iter().map(|(settings, _)| settings.as_str()).zip(sums)))
}

/// The row's variants with their settings.
fn variants(name: &str, progress: &Progress) -> Result<(Kind, Vec<Variant>)> {
    let owned = |settings: &str| settings.to_owned();
    match name {
        "minterpolate" => {
            let open =
                |s: &&str| Ok((owned(s), Box::new(minterpolate::Minterpolate::with(s, progress)?) as Box<dyn Row>));
            Ok((Kind::Minterpolate, MINTERPOLATE.iter().map(open).collect::<Result<_>>()?))
        }
        "flowfps" => {
            let open = |s: &&str| Ok((owned(s), Box::new(flowfps::FlowFps::with(s, progress)?) as Box<dyn Row>));
            Ok((Kind::FlowFps, FLOWFPS.iter().map(open).collect::<Result<_>>()?))
        }
        "rife4" => {
            let open = |s: &&str| Ok((owned(s), Box::new(rife::Rife4::with(s, progress)?) as Box<dyn Row>));
            Ok((Kind::Rife4, RIFE4.iter().map(open).collect::<Result<_>>()?))
        }
        _ => Err(Error::new(ErrorKind::InvalidArgument, format!("the row {name:?} has no settings to choose from"))
            .field("--tune")
            .remedy("Use minterpolate, flowfps or rife4")),
    }
}

/// Means as Markdown, best PSNR first.
fn text<'a>(means: impl Iterator<Item = (&'a str, [f64; 3])>) -> String {
    let mut means: Vec<_> = means.enumerate().collect();
    means.sort_by(|a, b| b.1.1[0].total_cmp(&a.1.1[0]));
    let mut text = String::from("| settings | PSNR | SSIM | LPIPS |\n|---|--:|--:|--:|\n");
    for (number, (settings, [psnr, ssim, lpips])) in means {
        let used = if number == 0 { " (in use)" } else { "" };
        // Cannot fail: a string grows.
        let _ = writeln!(text, "| `{settings}`{used} | {psnr:.2} | {ssim:.4} | {lpips:.4} |");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_variant_comes_first_and_the_used_one_is_marked() {
        let made = text([("a", [30.0, 0.9, 0.1]), ("b", [31.0, 0.8, 0.2])].into_iter());
        let lines: Vec<&str> = made.lines().collect();
        assert_eq!(lines[2..], ["| `b` | 31.00 | 0.8000 | 0.2000 |", "| `a` (in use) | 30.00 | 0.9000 | 0.1000 |"]);
    }
}
