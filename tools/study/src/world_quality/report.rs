//! Results as text.

use std::fmt::Write as _;

use super::figures::{Results, Row, WalkResult, extremes, show, show_mean};
use super::place::Group;
use super::response::{Axis, standing_speed};
use super::sheet::SHOWN;
use super::walk::{HORIZONS, Horizon};
use crate::metrics::Score;
use crate::statistics::Estimate;

/// Tables for the terminal and the page; the last line is the summary.
pub(super) fn text(results: &Results) -> String {
    let parts = [
        goals(results),
        scores(results),
        behind(&compared(results)),
        stock(results),
        seconds(results),
        recognised(results),
        distribution(results),
        poses(results),
        remembered(results),
        controls(results),
        ranking(results),
        summary(results) + "\n",
    ];
    let text = parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("\n");
    text.lines().map(str::trim_end).flat_map(|line| [line, "\n"]).collect()
}

/// A line of [`goals`]: the goal, the measured figure, and whether the goal is reached.
type Goal = (String, String, Option<bool>);

/// A figure as the table shows it, which is what counts.
fn rounded(value: f64, digits: usize) -> f64 {
    let scale = 10_f64.powi(digits as i32);
    (value * scale).round() / scale
}

/// The figures beside what they are to reach, over all levels.
fn goals(results: &Results) -> String {
    let all = Row::Levels;
    let ends = results.ends();
    let worst = |of: &dyn Fn(u32) -> Option<Estimate>, distance: &dyn Fn(f64) -> f64, digits: usize| {
        let found = ends.iter().filter_map(|end| Some((*end, of(*end)?)));
        let (end, estimate) = found.max_by(|a, b| distance(a.1.mean).total_cmp(&distance(b.1.mean)))?;
        Some((
            format!("{} in second {end}", show(Some(estimate), digits)),
            rounded(distance(rounded(estimate.mean, digits)), digits),
        ))
    };
    let within = |found: Option<(String, f64)>, limit: f64| {
        let met = found.as_ref().map(|(_, distance)| *distance <= limit);
        (found.map_or_else(|| "-".into(), |(text, _)| text), met)
    };
    let plain = |estimate: Option<Estimate>, digits: usize, is_met: &dyn Fn(f64) -> bool| {
        (show(estimate, digits), estimate.map(|e| is_met(rounded(e.mean, digits))))
    };
    let line = |name: &str, (text, met): (String, Option<bool>)| -> Goal { (name.to_owned(), text, met) };
    let first = HORIZONS[0];
    let percent = |estimate: Option<Estimate>| estimate.map(|e| e.times(100.0));
    let gain = results.horizon(all, first, |h| Some(h.world.psnr - h.repeat.psnr));
    let mut goals = vec![
        line("at 0.5 s: PSNR at least 2 dB above the last picture", plain(gain, 2, &|v| v >= 2.0)),
        line("at 0.5 s: LPIPS at most 0.25", plain(results.horizon(all, first, |h| h.world.lpips), 3, &|v| v <= 0.25)),
        line(
            "detail 0.85 to 1.15 of the truth's in every second",
            within(worst(&|end| results.second(all, end, |s| s.detail), &|v| (v - 1.0).abs(), 2), 0.15),
        ),
        line(
            "brightness within 4 %",
            within(worst(&|end| percent(results.second(all, end, |s| (s.brightness - 1.0).abs())), &|v| v, 1), 4.0),
        ),
        line("colour within 3 units", within(worst(&|end| results.second(all, end, |s| s.colour), &|v| v, 1), 3.0)),
        line(
            "the kind of place is recognised in 99 % of the pictures",
            within(
                worst(
                    &|end| percent(results.recognised(all, end, |_, kind, s| s.recognised[0].kind == kind)),
                    &|v| -v,
                    1,
                ),
                -99.0,
            ),
        ),
    ];
    let late = ends.last().filter(|end| **end > 5).and_then(|end| results.discrepancy(all, *end));
    if let (Some(early), Some(late)) = (results.discrepancy(all, 5), late) {
        let text = format!("{} to {}", show(Some(early), 3), show(Some(late), 3));
        let is_met = rounded(late.mean, 3) <= rounded(early.mean, 3);
        goals.push(line("the pictures' distribution goes no farther away after 5 s", (text, Some(is_met))));
    }
    let latest = [15.0, 5.0].into_iter().find(|s| results.pose(all, *s, |p| p.psnr[0]).is_some());
    if let Some(latest) = latest {
        let psnr = results.pose(all, latest, |p| p.psnr[0]);
        goals.push(line(
            "picture against that of the nearest true pose: at least 20 dB",
            plain(psnr, 1, &|v| v >= 20.0),
        ));
    }
    for away in results.away() {
        let name = format!("the right place after {away} s away in 95 % of the walks");
        let share = percent(results.right_place(all, away));
        goals.push(line(&name, plain(share, 0, &|v| v >= 95.0)));
    }
    goals.push(line(
        "turning: correlation with the truth's at least 0.95",
        plain(results.control(all, Axis::Turning, |f| f.correlation), 2, &|v| v >= 0.95),
    ));
    goals.push(line(
        "turning: 0.9 to 1.1 as far",
        plain(results.control(all, Axis::Turning, |f| f.slope), 2, &|v| (0.9..=1.1).contains(&v)),
    ));
    let mut text = format!("{:61} {:36} reached\n", "goal, over the walks of all levels", "here");
    for (name, figure, met) in goals {
        let met = met.map_or("-", |met| if met { "yes" } else { "no" });
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name:61} {figure:36} {met}");
    }
    text
}

/// Table of scores at the horizons.
fn scores(results: &Results) -> String {
    let mut text = format!(
        "{:8} {:>5}   {:24} {:>6} {:22} {:>32} {:>38}\n",
        "row",
        "at, s",
        "world: PSNR",
        "SSIM",
        "LPIPS",
        "last picture: PSNR   SSIM  LPIPS",
        "its reconstruction: PSNR   SSIM  LPIPS"
    );
    for row in Row::all() {
        for seconds in HORIZONS {
            let of = |measure: fn(&Score) -> Option<f64>, of: fn(&Horizon) -> &Score| {
                results.horizon(row, seconds, |h| measure(of(h)))
            };
            let measures: [fn(&Score) -> Option<f64>; 3] = [|s| Some(s.psnr), |s| Some(s.ssim), |s| s.lpips];
            let [psnr, ssim, lpips] = measures.map(|measure| of(measure, |h| &h.world));
            if psnr.is_none() {
                continue;
            }
            let still = |score: fn(&Horizon) -> &Score| {
                let [psnr, ssim, lpips] = measures.map(|measure| of(measure, score));
                format!("{:>6} {:>6} {:>6}", show_mean(psnr, 2), show_mean(ssim, 3), show_mean(lpips, 3))
            };
            let _ = writeln!(
                text,
                "{:8} {seconds:5}   {:24} {:>6} {:22} {:>32} {:>38}",
                row.name(),
                show(psnr, 2),
                show_mean(ssim, 3),
                show(lpips, 3),
                still(|h| &h.repeat),
                still(|h| &h.reconstruction)
            );
        }
    }
    text
}

/// A line of the list of losses: row and time, and the scores of the world, the last picture and its reconstruction.
type Line = (String, [[Option<f64>; 3]; 3]);

/// The lines of the table of scores.
fn compared(results: &Results) -> Vec<Line> {
    let of: [fn(&Horizon) -> &Score; 3] = [|h| &h.world, |h| &h.repeat, |h| &h.reconstruction];
    let measures: [fn(&Score) -> Option<f64>; 3] = [|s| Some(s.psnr), |s| Some(s.ssim), |s| s.lpips];
    let rows = Row::all().into_iter().filter(|row| *row != Row::Levels);
    let cells = rows.flat_map(|row| HORIZONS.map(|seconds| (row, seconds)));
    let line = |(row, seconds): (Row, f64)| {
        let scores = of.map(|of| {
            measures.map(|measure| results.horizon(row, seconds, |h| measure(of(h))).map(|estimate| estimate.mean))
        });
        scores[0][0].map(|_| (format!("{} {seconds} s", row.name()), scores))
    };
    cells.filter_map(line).collect()
}

/// Where a still picture is nearer to the truth than the world, in the digits of the table.
fn behind(lines: &[Line]) -> String {
    let mut text = String::from("where a still picture is nearer to the truth than the world:\n");
    for (other, name) in [(1, "last picture"), (2, "its reconstruction")] {
        for (i, (measure, digits)) in [("PSNR", 2), ("SSIM", 3), ("LPIPS", 3)].into_iter().enumerate() {
            let shown = |value: Option<f64>| value.map(|value| format!("{value:.digits$}"))?.parse::<f64>().ok();
            let is_lost = |scores: &[[Option<f64>; 3]; 3]| {
                let (world, still) = (shown(scores[0][i])?, shown(scores[other][i])?);
                Some(if measure == "LPIPS" { still < world } else { still > world })
            };
            let known = lines.iter().filter(|(_, scores)| is_lost(scores).is_some()).count();
            let lost = lines.iter().filter(|(_, scores)| is_lost(scores) == Some(true));
            let lost: Vec<&str> = lost.map(|(name, _)| name.as_str()).collect();
            let which = match lost.len() {
                _ if known == 0 => continue,
                0 => "nowhere".to_owned(),
                all if all == known => "everywhere".to_owned(),
                _ => lost.join(", "),
            };
            let _ = writeln!(text, "{name:18}  {measure:5}  {which}");
        }
    }
    text
}

/// Table of the stock schedule beside the refined one.
fn stock(results: &Results) -> String {
    let mut text =
        format!("{:8} {:>5}   {:32} {:32}\n", "row", "at, s", "stock schedule: PSNR   LPIPS", "refined: PSNR   LPIPS");
    for row in Row::all() {
        for seconds in HORIZONS {
            let psnr = results.stock(row, seconds, |s| Some(s.psnr));
            if psnr.is_none() {
                continue;
            }
            let pair = |psnr, lpips| format!("{} {:>7}", show_mean(psnr, 2), show_mean(lpips, 3));
            let stock = pair(psnr, results.stock(row, seconds, |s| s.lpips));
            let refined = pair(
                results.horizon(row, seconds, |h| Some(h.world.psnr)),
                results.horizon(row, seconds, |h| h.world.lpips),
            );
            let _ = writeln!(text, "{:8} {seconds:5}   {stock:>28} {refined:>25}", row.name());
        }
    }
    text
}

/// Table of global picture properties, second by second.
fn seconds(results: &Results) -> String {
    let mut text = format!(
        "{:8} {:>6}   {:22} {:22} {:22} {:22} {:>12} {:>15}\n",
        "row",
        "second",
        "brightness off by, %",
        "colour off by",
        "contrast",
        "detail: world",
        "last picture",
        "reconstruction"
    );
    for row in Row::all() {
        for end in results.ends() {
            let of = |measure: &dyn Fn(&super::endurance::Second) -> f64, digits| {
                show(results.second(row, end, measure), digits)
            };
            if results.second(row, end, |s| s.detail).is_none() {
                continue;
            }
            let still = |i: usize| show_mean(results.second(row, end, |s| s.still_detail[i]), 2);
            let _ = writeln!(
                text,
                "{:8} {end:>6}   {:22} {:22} {:22} {:22} {:>12} {:>15}",
                row.name(),
                of(&|s| 100.0 * (s.brightness - 1.0).abs(), 1),
                of(&|s| s.colour, 1),
                of(&|s| s.contrast, 2),
                of(&|s| s.detail, 2),
                still(0),
                still(1)
            );
        }
    }
    text
}

/// Table of what classifiers see; empty without them.
fn recognised(results: &Results) -> String {
    let mut text = format!(
        "{:8} {:>6}   {:24} {:>6} {:>14}   {:24} {:>6} {:>14}\n",
        "row",
        "until",
        "kind right, %: world",
        "truth",
        "last picture",
        "patch right, %: world",
        "truth",
        "last picture"
    );
    let mut lines = 0;
    for row in Row::all() {
        for end in results.ends() {
            let share = |is_right: &dyn Fn(&super::walk::WalkScores, usize, &super::walk::Sample) -> bool| {
                results.recognised(row, end, is_right).map(|e| e.times(100.0))
            };
            let kinds = [0, 1].map(|i| share(&|_, kind, s| s.recognised[i].kind == kind));
            if kinds[0].is_none() {
                continue;
            }
            let still = share(&|walked, kind, _| walked.still_recognised.is_some_and(|still| still[0].kind == kind));
            let patches = [0, 1].map(|i| share(&|_, _, s| s.recognised[i].patch == s.patch));
            let still_patch =
                share(&|walked, _, s| walked.still_recognised.is_some_and(|still| still[0].patch == s.patch));
            let has_patches = row != Row::Group(Group::Unseen);
            let patch = |estimate: Option<Estimate>| estimate.filter(|_| has_patches);
            let _ = writeln!(
                text,
                "{:8} {end:>6}   {:24} {:>6} {:>14}   {:24} {:>6} {:>14}",
                row.name(),
                show(kinds[0], 1),
                show_mean(kinds[1], 1),
                show_mean(still, 1),
                show(patch(patches[0]), 1),
                show_mean(patch(patches[1]), 1),
                show_mean(patch(still_patch), 1)
            );
            lines += 1;
        }
    }
    if lines > 0 { text } else { String::new() }
}

/// Table of the distance of distributions; empty without features.
fn distribution(results: &Results) -> String {
    let mut text = format!("{:8} {:>6}   {:28} {:28}\n", "row", "until", "discrepancy: world", "another walk's truth");
    let mut lines = 0;
    for row in Row::all() {
        for end in results.ends() {
            let world = results.discrepancy(row, end);
            if world.is_none() {
                continue;
            }
            let other = show(results.discrepancy_of_walks(row, end), 3);
            let _ = writeln!(text, "{:8} {end:>6}   {:28} {other:28}", row.name(), show(world, 3));
            lines += 1;
        }
    }
    if lines > 0 { text } else { String::new() }
}

/// Table of the nearest true poses.
fn poses(results: &Results) -> String {
    let mut text = format!(
        "{:8} {:>5}   {:24} {:>8} {:>6}   {:24} {:>8} {:>6}   {:22} {:>6}\n",
        "row",
        "at, s",
        "median m off: world",
        "truth",
        "start",
        "median degrees off: world",
        "truth",
        "start",
        "against its pose, dB",
        "truth"
    );
    let mut lines = 0;
    for row in Row::all() {
        for seconds in HORIZONS {
            let of = |measure: &dyn Fn(&super::walk::PoseScore) -> f64| results.pose(row, seconds, measure);
            if of(&|p| p.world[0]).is_none() {
                continue;
            }
            let cells = |i: usize, digits: usize| {
                let world = show(of(&|p| p.world[i]), digits);
                let [truth, start] = [of(&|p| p.truth[i]), of(&|p| p.repeat[i])].map(|e| show_mean(e, digits));
                format!("{world:24} {truth:>8} {start:>6}")
            };
            let psnr = [0, 1].map(|i| of(&|p| p.psnr[i]));
            let _ = writeln!(
                text,
                "{:8} {seconds:5}   {}   {}    {:22} {:>6}",
                row.name(),
                cells(0, 1),
                cells(1, 0),
                show(psnr[0], 1),
                show_mean(psnr[1], 1)
            );
            lines += 1;
        }
    }
    if lines > 0 { text } else { String::new() }
}

/// Table of the memory test; empty if it did not run.
fn remembered(results: &Results) -> String {
    let mut text = format!(
        "{:8} {:>7}   {:20} {:24} {:>6} {:>8} {:>16}\n",
        "row", "away, s", "right place, %", "back: PSNR", "SSIM", "at most", "another place"
    );
    let all_away = results.away();
    if all_away.is_empty() {
        return String::new();
    }
    for row in Row::all() {
        for away in all_away.iter().copied() {
            let of = |measure: &dyn Fn(&super::memory::MemoryScore) -> f64| results.memory(row, away, measure);
            let Some(right) = results.right_place(row, away) else { continue };
            let _ = writeln!(
                text,
                "{:8} {away:7}   {:20} {:24} {:>6} {:>8} {:>16}",
                row.name(),
                show(Some(right.times(100.0)), 0),
                show(of(&|m| m.psnr), 2),
                show_mean(of(&|m| m.ssim), 3),
                show_mean(of(&|m| m.most), 2),
                show_mean(of(&|m| m.elsewhere), 2)
            );
        }
    }
    text
}

/// Table of the response to the controls.
fn controls(results: &Results) -> String {
    let mut text = format!(
        "{:8} {:26} {:22} {:>8}   {:26} {:22} {:>20}   {:22} {:>14}\n",
        "row",
        "turning: correlation",
        "size",
        "same way",
        "walking: correlation",
        "size",
        "tilting: correlation",
        "standing: pixels a step",
        "flicker (true)"
    );
    for row in Row::all() {
        let turning = |of: fn(&super::response::ControlFit) -> f64| results.control(row, Axis::Turning, of);
        let walking = |of: fn(&super::response::ControlFit) -> f64| results.control(row, Axis::Walking, of);
        let flicker = [0, 1].map(|i| {
            results.mean(row, |walked| {
                let changes: Vec<f64> = walked
                    .statistics
                    .windows(2)
                    .map(|pair| (pair[1][i].brightness - pair[0][i].brightness).abs())
                    .collect();
                (!changes.is_empty()).then(|| changes.iter().sum::<f64>() / changes.len() as f64)
            })
        });
        if flicker[0].is_none() {
            continue;
        }
        let _ = writeln!(
            text,
            "{:8} {:26} {:22} {:>8}   {:26} {:22} {:>20}   {:22} {:>14}",
            row.name(),
            show(turning(|f| f.correlation), 2),
            show(turning(|f| f.slope), 2),
            show_mean(turning(|f| f.same_sign), 2),
            show(walking(|f| f.correlation), 2),
            show(walking(|f| f.slope), 2),
            show_mean(results.control(row, Axis::Tilting, |f| f.correlation), 2),
            show(results.mean(row, |walked| standing_speed(&walked.responses)), 2),
            format!("{} ({})", show_mean(flicker[0], 2), show_mean(flicker[1], 2))
        );
    }
    text
}

fn ranking(results: &Results) -> String {
    let names = |results: &[&WalkResult]| results.iter().map(|r| r.place.to_string()).collect::<Vec<_>>().join(", ");
    let [best, worst] = extremes(&results.all, SHOWN);
    format!("best: {}\nworst: {}\n", names(&best), names(&worst))
}

/// One line with every row at the first horizon.
fn summary(results: &Results) -> String {
    let first = HORIZONS[0];
    let row = |row: Row| {
        let psnr = |of: fn(&Horizon) -> &Score| show_mean(results.horizon(row, first, |h| Some(of(h).psnr)), 2);
        results.horizon(row, first, |h| Some(h.world.psnr))?;
        Some(format!(
            "{} {} dB (last picture {}, reconstruction {}), correlation {}",
            row.name(),
            psnr(|h| &h.world),
            psnr(|h| &h.repeat),
            psnr(|h| &h.reconstruction),
            show_mean(results.control(row, Axis::Turning, |f| f.correlation), 2)
        ))
    };
    format!("at {first} s: {}", Row::all().into_iter().filter_map(row).collect::<Vec<_>>().join("; "))
}

#[cfg(test)]
mod tests {
    use scenes::Family;

    use super::*;
    use crate::world_quality::endurance::PictureStatistics;
    use crate::world_quality::place::{Recognised, TestWalk};
    use crate::world_quality::response::{MeanMotion, Response};
    use crate::world_quality::walk::{PoseScore, Sample, WalkScores};

    /// A second of a walk whose pictures have the given detail, where the truth has 5, and half of which are taken for snow.
    fn walk(place: TestWalk, detail: f64) -> WalkResult {
        let look =
            |detail: f64| PictureStatistics { brightness: 100.0, colour: [90.0, 100.0, 110.0], contrast: 20.0, detail };
        let score = |psnr: f64| Score { psnr, ssim: 0.5, lpips: Some(1.0 - psnr / 100.0) };
        let flow = |turn: f64| MeanMotion { mean: [turn, 0.0], expansion: 0.0, speed: turn.abs() };
        let turns = [1.0, -2.0, 3.0, -4.0, 0.0].into_iter().cycle().take(15);
        let sample = |step: u64| Sample {
            step,
            recognised: [
                Recognised { kind: if step < 10 { 3 } else { 0 }, patch: 7 },
                Recognised { kind: 3, patch: 1 },
            ],
            patch: 1,
            features: [vec![step as u16 * 900, 100], vec![step as u16 * 900, 90]],
        };
        let walked = WalkScores {
            horizons: vec![Horizon {
                seconds: 0.5,
                world: score(24.0),
                repeat: score(21.0),
                reconstruction: score(25.0),
            }],
            responses: turns.map(|turn| Response { seen: flow(0.5 * turn), meant: flow(turn) }).collect(),
            statistics: vec![[look(detail), look(5.0)]; 16],
            samples: (1..=15).map(sample).collect(),
            poses: vec![PoseScore {
                seconds: 5.0,
                world: [3.0, 10.0],
                truth: [0.5, 1.0],
                repeat: [9.0, 90.0],
                psnr: [19.94, 30.0],
            }],
            ..WalkScores::empty(look(5.0))
        };
        WalkResult { place, walked, shown: Vec::new() }
    }

    fn results(details: [f64; 2]) -> Results {
        let all = (0..).zip(details).map(|(number, detail)| walk(TestWalk::Level(Family::Snow, number), detail));
        Results { all: all.collect(), latents_per_second: 15 }
    }

    /// The cells of the line that begins with `start`, without intervals.
    fn cells(text: &str, start: &str) -> Vec<String> {
        let line = text.lines().find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("{start}: {text}"));
        without_intervals(line).split_whitespace().map(str::to_owned).collect()
    }

    fn without_intervals(line: &str) -> String {
        let parts = line.split('[').enumerate();
        parts.map(|(i, part)| if i == 0 { part } else { part.split_once(']').map_or("", |(_, rest)| rest) }).collect()
    }

    #[test]
    fn goals_are_judged_by_the_digits_that_are_shown() {
        let text = goals(&results([4.5, 4.0]));
        for (goal, figure, verdict) in [
            ("at 0.5 s: PSNR", "3.00 [3.00, 3.00]", "yes"),
            ("at 0.5 s: LPIPS", "0.760 [0.760, 0.760]", "no"),
            ("detail", "0.85 [0.21, 1.49] in second 1", "yes"),
            ("brightness", "0.0 [0.0, 0.0] in second 1", "yes"),
            ("the kind", "60.0 [13.2, 93.7] in second 1", "no"),
            // 19.94 dB are shown as 19.9; a median of two places has no interval.
            ("picture against", " 19.9 ", "no"),
            ("turning: correlation", "1.00 [1.00, 1.00]", "yes"),
            ("turning: 0.9", "0.50 [0.50, 0.50]", "no"),
        ] {
            let line = text.lines().find(|line| line.starts_with(goal)).unwrap_or_else(|| panic!("{goal}: {text}"));
            assert!(line.contains(figure) && line.ends_with(&format!(" {verdict}")), "{line}");
        }
        let worse = goals(&results([4.2, 4.2]));
        assert!(worse.lines().any(|line| line.starts_with("detail") && line.ends_with(" no")), "{worse}");
    }

    #[test]
    fn tables_have_a_line_for_each_row_with_walks() {
        let results = results([4.5, 4.0]);
        assert_eq!(
            cells(&scores(&results), "snow"),
            ["snow", "0.5", "24.00", "0.500", "0.760", "21.00", "0.500", "0.790", "25.00", "0.500", "0.750"]
        );
        assert_eq!(cells(&seconds(&results), "levels"), ["levels", "1", "0.0", "0.0", "1.00", "0.85", "1.00", "1.00"]);
        assert_eq!(cells(&recognised(&results), "snow"), ["snow", "1", "60.0", "100.0", "0.0", "0.0", "100.0", "0.0"]);
        assert_eq!(
            cells(&poses(&results), "snow"),
            ["snow", "5", "3.0", "0.5", "9.0", "10", "1", "90", "19.9", "30.0"]
        );
        let distribution = cells(&distribution(&results), "snow");
        // Both walks have the same features, so that another walk is as near as chance has it.
        assert!(distribution[2].parse::<f64>().unwrap().abs() < 0.2 && distribution.len() == 4, "{distribution:?}");
        assert!(!text(&results).contains("forest"), "no walk went through the forest");
        assert_eq!(remembered(&results), "");
    }

    #[test]
    fn the_page_says_where_the_world_is_behind_a_still_picture() {
        let page = include_str!("../../../../docs/world.md");
        let table = page.lines().skip_while(|line| !line.starts_with("row      at, s   world: PSNR")).skip(1);
        let lines: Vec<Line> = table
            .take_while(|line| !line.is_empty())
            .map(without_intervals)
            .filter(|line| !line.starts_with("levels"))
            .map(|line| {
                let cells: Vec<&str> = line.split_whitespace().collect();
                let of = |n: usize| [0, 1, 2].map(|i| cells[2 + 3 * n + i].parse().ok());
                (format!("{} {} s", cells[0], cells[1]), [of(0), of(1), of(2)])
            })
            .collect();
        assert_eq!(lines.len(), 5 * 5, "five rows at .5, 1, 2, 5 and 15 s");
        assert!(page.contains(&behind(&lines)), "{}", behind(&lines));
        assert!(behind(&lines[..1]).contains("last picture        PSNR   nowhere"), "{}", behind(&lines[..1]));
    }
}
