//! Results as text, as CSV, and as pictures side by side.

use std::fmt::Write as _;

use cairn::{Picture, Result};
use scenes::Family;

use super::endurance::{self, Second, second};
use super::memory::MemoryScore;
use super::response::{ControlFit, Response, following};
use super::walk::{Horizon, WalkScores};
use crate::metrics::Score;
use crate::picture::{paste, shrink};
use crate::scene_id::SceneId;
use crate::text::{SMALL, fit, write};

/// Measurements of one scene.
#[derive(Debug)]
pub(super) struct SceneResult {
    pub(super) scene: SceneId,
    pub(super) walked: WalkScores,
    /// The start of the same walk with the stock schedule.
    pub(super) few_steps: WalkScores,
    pub(super) remembered: Vec<MemoryScore>,
}

/// Mean over scenes; `None` without values.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Mean and sample standard deviation over scenes; `None` for fewer than two.
fn spread(values: impl Iterator<Item = f64> + Clone) -> Option<[f64; 2]> {
    let (mean, count) = (mean(values.clone())?, values.clone().count());
    let squares: f64 = values.map(|value| (value - mean).powi(2)).sum();
    (count > 1).then(|| [mean, (squares / (count - 1) as f64).sqrt()])
}

fn show(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"))
}

/// Mean frame-to-frame change of brightness: the world's and the truth's.
fn flicker(walked: &WalkScores) -> [Option<f64>; 2] {
    [0, 1].map(|i| mean(walked.statistics.windows(2).map(|pair| (pair[1][i].brightness - pair[0][i].brightness).abs())))
}

fn of_family(results: &[SceneResult], family: Family) -> impl Iterator<Item = &SceneResult> + Clone {
    results.iter().filter(move |result| result.scene.family == family)
}

fn families(results: &[SceneResult]) -> Vec<Family> {
    scenes::LANDSCAPES.into_iter().filter(|family| of_family(results, *family).next().is_some()).collect()
}

/// How all scenes of a family follow the controls along an axis.
fn follows(results: &[SceneResult], family: Family, axis: usize) -> Option<ControlFit> {
    let responses: Vec<Response> =
        of_family(results, family).flat_map(|p| p.walked.responses.iter().copied()).collect();
    following(responses.iter(), axis)
}

/// Tables for the terminal; the last line is the summary.
pub(super) fn text(results: &[SceneResult], horizons: &[f64], latents_per_second: u32) -> String {
    let mut text = String::from(
        "scene    at, s   world: PSNR  SSIM   LPIPS    last picture: PSNR  SSIM   LPIPS    its reconstruction: PSNR  SSIM   LPIPS\n",
    );
    for family in families(results) {
        for &seconds in horizons {
            let of: [fn(&Horizon) -> Score; 3] = [|h| h.world, |h| h.repeat, |h| h.reconstruction];
            let [Some(world), Some(repeat), Some(reconstruction)] =
                of.map(|of| three(of_family(results, family).map(|p| &p.walked), seconds, of))
            else {
                continue;
            };
            // Writing to a string cannot fail.
            let _ =
                writeln!(text, "{:8} {seconds:5}   {world:>23}   {repeat:>32}   {reconstruction:>38}", family.name());
        }
    }
    text += &behind(&compared(results, horizons));
    text += &few_steps(results, horizons);
    text += "\nscene    turning: correlation  size  same way   tilting: correlation   flicker (true)\n";
    for family in families(results) {
        let [turn, tilt] = [0, 1].map(|axis| follows(results, family, axis));
        let [made, true_] = [0, 1].map(|i| mean(of_family(results, family).filter_map(|p| flicker(&p.walked)[i])));
        let _ = writeln!(
            text,
            "{:8} {:>20} {:>5} {:>9}   {:>20}   {} ({})",
            family.name(),
            show(turn.map(|f| f.correlation), 2),
            show(turn.map(|f| f.slope), 2),
            show(turn.map(|f| f.same_sign), 2),
            show(tilt.map(|f| f.correlation), 2),
            show(made, 2),
            show(true_, 2)
        );
    }
    text += &lasting(results, latents_per_second);
    text += &remembered(results);
    let names =
        |results: &[&SceneResult]| results.iter().map(|result| result.scene.to_string()).collect::<Vec<_>>().join(", ");
    let [best, worst] = extremes(results);
    let _ = writeln!(text, "\nbest: {}\nworst: {}", names(&best), names(&worst));
    text + "\n" + &summary(results, horizons) + "\n"
}

/// Table of global picture properties, second by second.
fn lasting(results: &[SceneResult], latents_per_second: u32) -> String {
    let mut text = String::from(
        "\nscene    second   brightness: mean       ±   farthest   true places   contrast: mean  least   detail: mean  least   turning: correlation\n",
    );
    for family in families(results) {
        for (n, end) in endurance::ENDS.into_iter().enumerate() {
            let walks = || of_family(results, family).map(|p| &p.walked);
            let seconds: Vec<Second> = walks().filter_map(|w| second(w, end, latents_per_second)).collect();
            let all = |of: fn(&Second) -> f64| seconds.iter().map(of);
            let Some(brightness) = mean(all(|s| s.brightness - 1.0)) else { continue };
            // Standard error of the mean, and the spread of the truth: true scenes of a family differ in brightness.
            let error = spread(all(|s| s.brightness)).map(|[_, sd]| sd / (seconds.len() as f64).sqrt());
            let variation = spread(all(|s| s.true_brightness)).map(|[mean, sd]| sd / mean);
            let percent = |value: Option<f64>| show(value.map(|v| 100.0 * v), 1);
            let farthest = all(|s| s.brightness - 1.0).max_by(|a, b| a.abs().total_cmp(&b.abs()));
            let least = |of| all(of).min_by(f64::total_cmp);
            // Turning is measured since the previous row's second, because a single second may contain no turn.
            let since = end - if n == 0 { 0 } else { endurance::ENDS[n - 1] };
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{:8} {end:>6} {:>16.1} % {:>5} % {:>8} % {:>11} % {:>16} {:>6} {:>14} {:>6} {:>22}",
                family.name(),
                100.0 * brightness,
                percent(error),
                percent(farthest),
                percent(variation),
                show(mean(all(|s| s.contrast)), 2),
                show(least(|s: &Second| s.contrast), 2),
                show(mean(all(|s| s.detail)), 2),
                show(least(|s: &Second| s.detail), 2),
                show(endurance::turning(walks(), end, since, latents_per_second), 2)
            );
        }
    }
    text
}

/// Table of the memory test; empty if it did not run.
fn remembered(results: &[SceneResult]) -> String {
    if results.iter().all(|result| result.remembered.is_empty()) {
        return String::new();
    }
    let mut text = String::from("\nscene    away, s  window   back: PSNR  SSIM   at most   another place\n");
    for result in results {
        for r in &result.remembered {
            let _ = writeln!(
                text,
                "{:8} {:7}  g{:<6} {:>11.2} {:>5.3} {:>9.2} {:>15.2}",
                result.scene.family.name(),
                r.away,
                r.window,
                r.psnr,
                r.ssim,
                r.most,
                r.elsewhere
            );
        }
    }
    text
}

/// Table of the stock schedule beside the refined one.
fn few_steps(results: &[SceneResult], horizons: &[f64]) -> String {
    let mut text = String::from(
        "\nscene    at, s   stock schedule: PSNR  SSIM   LPIPS    refined: PSNR  SSIM   LPIPS    turning, stock: correlation\n",
    );
    for family in families(results) {
        let walks = || of_family(results, family).map(|p| &p.few_steps);
        let responses: Vec<Response> = walks().flat_map(|walked| walked.responses.iter().copied()).collect();
        let correlation = show(following(responses.iter(), 0).map(|f| f.correlation), 2);
        for &seconds in horizons {
            let stock = three(walks(), seconds, |h| h.world);
            let refined = three(of_family(results, family).map(|p| &p.walked), seconds, |h| h.world);
            if let (Some(stock), Some(refined)) = (stock, refined) {
                // Writing to a string cannot fail.
                let _ =
                    writeln!(text, "{:8} {seconds:5}   {stock:>32}   {refined:>27}   {correlation:>30}", family.name());
            }
        }
    }
    text
}

/// Mean PSNR, SSIM and LPIPS at a horizon; `None` if no walk is that long.
fn means<'a>(
    walks: impl Iterator<Item = &'a WalkScores> + Clone,
    seconds: f64,
    of: fn(&Horizon) -> Score,
) -> Option<[Option<f64>; 3]> {
    let row = || walks.clone().flat_map(|walked| &walked.horizons).filter(|h| h.seconds == seconds).map(of);
    let psnr = mean(row().map(|score| score.psnr))?;
    Some([Some(psnr), mean(row().map(|score| score.ssim)), mean(row().filter_map(|score| score.lpips))])
}

/// The same as text.
fn three<'a>(
    walks: impl Iterator<Item = &'a WalkScores> + Clone,
    seconds: f64,
    of: fn(&Horizon) -> Score,
) -> Option<String> {
    let [psnr, ssim, lpips] = means(walks, seconds, of)?;
    Some(format!("{:>6} {:>6} {:>6}", show(psnr, 2), show(ssim, 3), show(lpips, 3)))
}

/// A line of the first table: its kind of place and time, and the scores of the world, the last picture and its reconstruction.
type Line = (String, [[Option<f64>; 3]; 3]);

/// The lines of the first table.
fn compared(results: &[SceneResult], horizons: &[f64]) -> Vec<Line> {
    let of: [fn(&Horizon) -> Score; 3] = [|h| h.world, |h| h.repeat, |h| h.reconstruction];
    let lines = families(results).into_iter().flat_map(|family| horizons.iter().map(move |seconds| (family, *seconds)));
    let line = |(family, seconds): (Family, f64)| {
        let [world, repeat, reconstruction] =
            of.map(|of| means(of_family(results, family).map(|p| &p.walked), seconds, of));
        Some((format!("{} {seconds} s", family.name()), [world?, repeat?, reconstruction?]))
    };
    lines.filter_map(line).collect()
}

/// Where a still picture is nearer to the truth than the world, in the digits of the table.
fn behind(lines: &[Line]) -> String {
    let mut text = String::from("\nwhere a still picture is nearer to the truth than the world:\n");
    for (other, name) in [(1, "last picture"), (2, "its reconstruction")] {
        for (i, (measure, digits)) in [("PSNR", 2), ("SSIM", 3), ("LPIPS", 3)].into_iter().enumerate() {
            let shown = |value: Option<f64>| show(value, digits).parse::<f64>().ok();
            let lost = lines.iter().filter(|(_, scores)| match (shown(scores[0][i]), shown(scores[other][i])) {
                (Some(world), Some(still)) if i == 2 => still < world,
                (Some(world), Some(still)) => still > world,
                _ => false,
            });
            let lost: Vec<&str> = lost.map(|(name, _)| name.as_str()).collect();
            let which = match lost.len() {
                0 => "nowhere".to_owned(),
                all if all == lines.len() => "everywhere".to_owned(),
                _ => lost.join(", "),
            };
            let _ = writeln!(text, "{name:18}  {measure:5}  {which}");
        }
    }
    text
}

/// One line with every scene at the first horizon.
fn summary(results: &[SceneResult], horizons: &[f64]) -> String {
    let first = horizons.first().copied().unwrap_or_default();
    let scene = |family: &Family| {
        let row = || of_family(results, *family).flat_map(|p| &p.walked.horizons).filter(|h| h.seconds == first);
        format!(
            "{} {} dB (last picture {}, reconstruction {}), correlation {}",
            family.name(),
            show(mean(row().map(|h| h.world.psnr)), 2),
            show(mean(row().map(|h| h.repeat.psnr)), 2),
            show(mean(row().map(|h| h.reconstruction.psnr)), 2),
            show(follows(results, *family, 0).map(|f| f.correlation), 2)
        )
    };
    format!("at {first} s: {}", families(results).iter().map(scene).collect::<Vec<_>>().join("; "))
}

/// CSV with a line for each score.
pub(super) fn csv(results: &[SceneResult]) -> String {
    let mut text = String::from("scene,seed,seconds,what,psnr_db,ssim,lpips_alex\n");
    for result in results {
        let mut line = |seconds: f64, what: &str, score: Score| {
            let lpips = score.lpips.map(|value| format!("{value:.6}")).unwrap_or_default();
            let SceneId { family, seed } = result.scene;
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{family},{seed},{seconds},{what},{:.4},{:.6},{lpips}", score.psnr, score.ssim);
        };
        for h in &result.walked.horizons {
            line(h.seconds, "world", h.world);
            line(h.seconds, "repeat", h.repeat);
            line(h.seconds, "reconstruction", h.reconstruction);
        }
        for h in &result.few_steps.horizons {
            line(h.seconds, "stock", h.world);
        }
    }
    text
}

/// CSV with a line for each scene and second: brightness, contrast and detail relative to the truth, and the truth's brightness.
pub(super) fn lasting_csv(results: &[SceneResult], latents_per_second: u32) -> String {
    let mut text = String::from("scene,seed,second,brightness,contrast,detail,true_luma\n");
    for SceneResult { scene, walked, .. } in results {
        let SceneId { family, seed } = scene;
        for end in endurance::ENDS {
            let Some(s) = second(walked, end, latents_per_second) else { continue };
            let Second { brightness, true_brightness, contrast, detail } = s;
            // Writing to a string cannot fail.
            let _ =
                writeln!(text, "{family},{seed},{end},{brightness:.4},{contrast:.4},{detail:.4},{true_brightness:.2}");
        }
    }
    text
}

/// Number of scenes on each sheet.
const SHOWN: usize = 4;
const TILE: (u32, u32) = (240, 135);
const GAP: u32 = 8;
const LEFT: u32 = 128;
const TOP: u32 = 32;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];

/// The best scenes, best first, and the worst, worst first, ranked by PSNR gain over repeating the last true picture. At most half of all scenes
/// and at most [`SHOWN`] each.
pub(super) fn extremes(results: &[SceneResult]) -> [Vec<&SceneResult>; 2] {
    let gain = |result: &SceneResult| mean(result.walked.horizons.iter().map(|h| h.world.psnr - h.repeat.psnr));
    let mut ranked: Vec<&SceneResult> = results.iter().collect();
    ranked.sort_by(|a, b| gain(b).unwrap_or_default().total_cmp(&gain(a).unwrap_or_default()));
    let (best, worst) = (ranked.len().div_ceil(2).min(SHOWN), (ranked.len() / 2).min(SHOWN));
    [ranked[..best].to_vec(), ranked.iter().rev().take(worst).copied().collect()]
}

/// Sheet with a column per horizon and two rows per scene, truth above the world's pictures, in the given order.
pub(super) fn sheet(results: &[&SceneResult]) -> Result<Picture> {
    let columns = results.iter().map(|p| p.walked.horizons.len()).max().unwrap_or(0).max(1) as u32;
    let rows = 2 * results.len().max(1) as u32;
    let mut sheet = Picture::new(LEFT + columns * (TILE.0 + GAP) + GAP, TOP + rows * (TILE.1 + GAP))?;
    sheet.pixels_mut().iter_mut().for_each(|px| px[..3].copy_from_slice(&GROUND));
    for (result, row) in results.iter().zip((0..).step_by(2)) {
        let y = |row: u32| TOP + row * (TILE.1 + GAP);
        for (n, line) in [result.scene.to_string(), "truth".into()].iter().enumerate() {
            write(&mut sheet, &fit(line, LEFT - 24, SMALL), (16, y(row) + 4 + 18 * n as u32), SMALL, BRIGHT);
        }
        write(&mut sheet, "world", (16, y(row + 1) + 4), SMALL, BRIGHT);
        for (h, column) in result.walked.horizons.iter().zip(0..) {
            let x = LEFT + column * (TILE.0 + GAP);
            if row == 0 {
                write(&mut sheet, &format!("{} s", h.seconds), (x, 8), SMALL, BRIGHT);
            }
            paste(&mut sheet, &shrink(&h.truth_picture, TILE)?, (x, y(row)));
            paste(&mut sheet, &shrink(&h.picture, TILE)?, (x, y(row + 1)));
        }
    }
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world_quality::endurance::PictureStatistics;

    /// Two scenes with the given brightness of the world's pictures and the true ones.
    fn results(brightness: [[f64; 2]; 2]) -> Vec<SceneResult> {
        let walked = |brightness: [f64; 2]| WalkScores {
            horizons: Vec::new(),
            responses: Vec::new(),
            statistics: vec![
                brightness.map(|brightness| PictureStatistics { brightness, contrast: 20.0, detail: 5.0 });
                16
            ],
        };
        let result = |(seed, brightness)| SceneResult {
            scene: SceneId { family: Family::Snow, seed },
            walked: walked(brightness),
            few_steps: walked(brightness),
            remembered: Vec::new(),
        };
        (41..).zip(brightness).map(result).collect()
    }

    #[test]
    fn a_mean_has_its_error_and_what_the_truth_differs_by() {
        let results = results([[110.0, 100.0], [135.0, 150.0]]);
        // 10 % too bright and 10 % too dark: 0 % on average, give or take 14.1 % / sqrt 2; the truth differs by 35.4 of 125.
        let text = lasting(&results, 15);
        let row: Vec<&str> = text.lines().nth(2).unwrap().split_whitespace().collect();
        assert_eq!(row[..10], ["snow", "1", "0.0", "%", "10.0", "%", "10.0", "%", "28.3", "%"], "{text}");
        // A single scene gives no standard error.
        let alone = lasting(&results[..1], 15);
        let row: Vec<&str> = alone.lines().nth(2).unwrap().split_whitespace().collect();
        assert_eq!(row[..10], ["snow", "1", "10.0", "%", "-", "%", "10.0", "%", "-", "%"], "{alone}");
        let csv = lasting_csv(&results, 15);
        assert!(csv.contains("\nsnow,42,1,0.9000,1.0000,1.0000,150.00\n"), "{csv}");
    }

    #[test]
    fn the_page_says_where_the_world_is_behind_a_still_picture() {
        let page = include_str!("../../../../docs/world.md");
        let table =
            page.split_once("its reconstruction: PSNR").unwrap().1.lines().skip(1).take_while(|l| !l.is_empty());
        let lines: Vec<Line> = table
            .map(|line| {
                let cells: Vec<&str> = line.split_whitespace().collect();
                let of = |n: usize| [0, 1, 2].map(|i| cells[2 + 3 * n + i].parse().ok());
                (format!("{} {} s", cells[0], cells[1]), [of(0), of(1), of(2)])
            })
            .collect();
        assert_eq!(lines.len(), 20);
        assert!(page.contains(&behind(&lines)), "{}", behind(&lines));
        assert!(behind(&lines[..1]).contains("last picture        PSNR   nowhere"), "{}", behind(&lines[..1]));
    }
}
