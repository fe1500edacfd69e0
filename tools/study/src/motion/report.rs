//! Tables, CSV and page.

use std::fmt::Write as _;

use cairn::world::GuidanceSource;
use scenes::LANDSCAPES;

use super::TUNING;
use super::measure::{Anchors, Record};
use super::sources::{Depth, MOTIONS, Motion, ROWS, Row};
use crate::experiment::{Measurements, seed_list};
use crate::losses::{self, list, losses};
use crate::scene_id::SceneId;
use crate::statistics::{Estimate, estimate, scene_means};
use crate::table::Table;

/// Number of rows that compare sources; the rest of [`ROWS`] compares depths.
const SOURCES: usize = MOTIONS.len();

/// A value of a frame.
type Value = fn(&Record) -> Option<f64>;

const END_POINT: Value = |record| Some(record.end_point.mean);
const NEAR: Value = |record| Some(100.0 * record.end_point.near);
const PSNR: Value = |record| Some(record.score.psnr);
const SSIM: Value = |record| Some(record.score.ssim);
const LPIPS: Value = |record| record.score.lpips;

/// Means per scene.
fn by_scene(records: &[Record], anchors: Anchors, row: Row, value: Value) -> Vec<(SceneId, f64)> {
    let all = records.iter().filter(|r| (r.anchors, r.row) == (anchors, row));
    scene_means(all.filter_map(|r| Some((r.scene, value(r)?))))
}

fn over_scenes(records: &[Record], anchors: Anchors, row: Row, value: Value) -> Option<Estimate> {
    estimate(&by_scene(records, anchors, row, value).iter().map(|(_, mean)| *mean).collect::<Vec<_>>())
}

/// The source, of those that need anchors only, whose frames are closest to the truth between the renderer's anchors: by LPIPS if measured,
/// otherwise by PSNR.
pub(super) fn best(records: &[Record]) -> Option<GuidanceSource> {
    let score = |row: Row| {
        let of = |value| over_scenes(records, Anchors::Drawn, row, value).map(|estimate| estimate.mean);
        of(LPIPS).or_else(|| Some(-of(PSNR)?))
    };
    let sources = ROWS.iter().take(SOURCES).filter_map(|row| Some((score(*row)?, row.motion.guidance_source()?)));
    sources.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, source)| source)
}

/// The sources of motion with their scores between `anchors`.
fn scores(records: &[Record], anchors: Anchors) -> Vec<losses::Row> {
    let of = |row: &Row| {
        let scores = [PSNR, SSIM, LPIPS].map(|value| over_scenes(records, anchors, *row, value));
        losses::Row::of(row.motion.name(), scores)
    };
    ROWS.iter().take(SOURCES).map(of).collect()
}

/// The first row in each measure, of the sources that need anchors only. A tie is of the source that `best` selects.
fn winners(rows: &[losses::Row]) -> Vec<(&'static str, GuidanceSource)> {
    let source = |name: &str| MOTIONS.into_iter().find(|m| m.name() == name).and_then(Motion::guidance_source);
    let sources: Vec<&losses::Row> = rows.iter().filter(|row| source(row.name).is_some()).collect();
    let first = losses::winners(&sources, Motion::Pictures.name());
    first.into_iter().filter_map(|(measure, row)| Some((measure, source(row.name)?))).collect()
}

/// The source that is first in most measures between the autoencoder's pictures; `None` if none is first in more than half of them.
pub(super) fn best_decoded(records: &[Record]) -> Option<GuidanceSource> {
    let first = winners(&scores(records, Anchors::Decoded));
    let wins = |source: GuidanceSource| first.iter().filter(|(_, other)| *other == source).count();
    first.iter().map(|(_, source)| *source).find(|source| 2 * wins(*source) > first.len())
}

/// What `best` is worth between the autoencoder's pictures, and where it loses, from the table's rows.
fn decoded_words(rows: &[losses::Row]) -> String {
    let first = winners(rows);
    let mut sources: Vec<GuidanceSource> = Vec::new();
    first.iter().for_each(|(_, source)| {
        if !sources.contains(source) {
            sources.push(*source)
        }
    });
    let of = |source: &GuidanceSource| {
        let measures = first.iter().filter(|(_, other)| other == source).map(|(measure, _)| (*measure).to_owned());
        format!("`{source}` is first in {}", list(&measures.collect::<Vec<_>>()))
    };
    let mut out = format!(
        "Of the sources that need anchors only, {}. `best` selects `{}`. These are means over the places, without intervals.",
        list(&sources.iter().map(of).collect::<Vec<_>>()),
        GuidanceSource::BEST
    );
    let row = |motion: Motion| rows.iter().find(|row| row.name == motion.name());
    let cheaper = [Motion::None, Motion::Paper, Motion::Calibrated, Motion::Latents, Motion::Controls];
    let cheaper: Vec<&losses::Row> = cheaper.into_iter().filter_map(row).collect();
    let Some((found, lost)) = row(Motion::Pictures).and_then(|own| Some((own, losses(own, &cheaper)?))) else {
        return out + " No cheaper row is better than `picture-flow` in any measure.\n";
    };
    _ = write!(out, "\n\n**Where ours loses:** `{}` loses {lost}.", found.name);
    if let Some(lost) = row(Motion::Truth).and_then(|truth| losses(truth, &cheaper)) {
        _ = write!(out, " So does the true motion: {lost}.");
    }
    out + "\n"
}

fn digits(value: f64, digits: usize) -> String {
    // Avoids a negative zero.
    let text = format!("{value:.digits$}");
    if text.trim_start_matches(['-', '0', '.']).is_empty() { text.trim_start_matches('-').into() } else { text }
}

fn number(value: Option<Estimate>, decimals: usize) -> String {
    value.map_or("–".into(), |estimate| digits(estimate.mean, decimals))
}

/// Table of the sources, or of the depths.
fn table(records: &[Record], anchors: Anchors, rows: &[Row], with_depth: bool) -> Table {
    let lines = rows.iter().map(|row| {
        let of = |value, decimals| number(over_scenes(records, anchors, *row, value), decimals);
        let cuts = records.iter().filter(|r| (r.anchors, r.row, r.cut) == (anchors, *row, true)).count();
        let mut line = vec![row.motion.name().to_owned()];
        if with_depth {
            line.push(row.depth.name().to_owned());
        } else {
            line.extend([of(END_POINT, 2), of(NEAR, 0)]);
        }
        line.extend([of(PSNR, 2), of(SSIM, 4), of(LPIPS, 4)]);
        if !with_depth {
            line.push(cuts.to_string());
        }
        line
    });
    let lines = lines.collect();
    if with_depth {
        Table::new(2, &["motion", "depth", "PSNR, dB", "SSIM", "LPIPS"], lines)
    } else {
        let head = ["motion", "error, pixels", "within 1, %", "PSNR, dB", "SSIM", "LPIPS", "cuts"];
        Table::new(1, &head, lines)
    }
}

/// Table of sources by family: end-point error, or frames.
fn by_family(records: &[Record], value: Value, decimals: usize) -> Table {
    let mut head = vec!["motion"];
    head.extend(LANDSCAPES.map(|family| family.name()));
    let lines = ROWS.iter().take(SOURCES).map(|row| {
        let values = by_scene(records, Anchors::Drawn, *row, value);
        let mut line = vec![row.motion.name().to_owned()];
        line.extend(LANDSCAPES.map(|family| {
            let of: Vec<f64> = values.iter().filter(|(scene, _)| scene.family == family).map(|(_, v)| *v).collect();
            number(estimate(&of), decimals)
        }));
        line
    });
    Table::new(1, &head, lines.collect())
}

/// Advantage of `picture_flow` over every other source, paired by scene.
fn differences(records: &[Record], anchors: Anchors) -> Table {
    let own = Row { motion: Motion::Pictures, depth: Depth::Flat };
    let lines = ROWS.iter().take(SOURCES).filter(|row| **row != own).map(|row| {
        let of = |value: Value, decimals: usize| {
            let [ours, theirs] = [own, *row].map(|row| by_scene(records, anchors, row, value));
            let pairs = ours.iter().filter_map(|(scene, ours)| {
                theirs.iter().find(|(other, _)| other == scene).map(|(_, theirs)| ours - theirs)
            });
            let pairs: Vec<f64> = pairs.collect();
            let signed = |value: f64| {
                let text = digits(value, decimals);
                if value > 0.0 && text.contains(|c: char| ('1'..='9').contains(&c)) { format!("+{text}") } else { text }
            };
            estimate(&pairs).map_or("–".into(), |estimate| match estimate.interval {
                Some([low, high]) => {
                    format!("{} ({} to {})", signed(estimate.mean), signed(low), signed(high))
                }
                None => format!("{} (one place: no interval)", signed(estimate.mean)),
            })
        };
        vec![row.motion.name().to_owned(), of(PSNR, 2), of(SSIM, 4), of(LPIPS, 4)]
    });
    Table::new(1, &["picture-flow minus", "PSNR, dB", "SSIM", "LPIPS"], lines.collect())
}

/// The result in one sentence.
fn verdict(records: &[Record]) -> String {
    let Some(best) = best(records) else { return String::new() };
    let chosen = GuidanceSource::BEST;
    if best == chosen {
        format!(
            "Between the renderer's anchors, of the sources that need anchors only, `{best}` gives the most accurate frames, and `best` selects it."
        )
    } else {
        format!(
            "**Between the renderer's anchors, of the sources that need anchors only, `{best}` gives the most accurate frames, but `best` selects `{chosen}`.**"
        )
    }
}

/// Summary for the terminal.
pub(super) fn summary(measured: &Measurements<'_, Record>, scale: f32) -> String {
    format!(
        "{}, {} places, paper's scale calibrated to {}\n\n{}\n{}\n",
        measured.world,
        measured.scenes.len(),
        digits(f64::from(scale), 2),
        table(measured.records, Anchors::Drawn, &ROWS[..SOURCES], false).markdown(),
        verdict(measured.records)
            + "\n\nBetween the autoencoder's pictures: "
            + &decoded_words(&scores(measured.records, Anchors::Decoded))
    )
}

/// Share of the true motion that each source explains: the reduction of the end-point error relative to zero motion.
fn explained(records: &[Record]) -> String {
    let off = |row: Row| over_scenes(records, Anchors::Drawn, row, END_POINT).map(|estimate| estimate.mean);
    let Some(none) = off(ROWS[0]).filter(|none| *none > 0.0) else { return String::new() };
    let known = ROWS[1..SOURCES]
        .iter()
        .filter_map(|row| Some(format!("`{}` {} %", row.motion.name(), digits(100.0 * (1.0 - off(*row)? / none), 0))));
    format!(
        "\nShare of the true motion that each source explains, as the reduction of the error of zero motion ({} pixels): {}.\n",
        digits(none, 2),
        known.collect::<Vec<_>>().join(", ")
    )
}

/// The page `docs/motion.md`. Depends on the measurements only.
pub(super) fn page(measured: &Measurements<'_, Record>, scale: f32, caption: Option<&str>) -> String {
    let Measurements { settings, world, seeds, scenes, records } = *measured;
    let frames = records.iter().filter(|r| r.anchors == Anchors::Drawn && r.row == ROWS[0]).count();
    let mut out = format!(
        "# Which motion is best?\n\n\
         The frame generator needs motion between anchors. This page compares every source of motion in the library with the scenes' \
         [exact motion](scenes.md). It also compares the frame that the `cpu` generator makes from each, half way between two anchors a \
         fifteenth of a second apart, with the renderer's picture of that moment.\n\n{}\n\n",
        verdict(records)
    );
    for motion in MOTIONS {
        _ = writeln!(out, "- `{}`: {}", motion.name(), motion.description());
    }
    out += "\n*Error* is the mean end-point error in pixels of the world's pictures, over the pixels visible in both anchors; \
            *within 1* is the share of pixels with an error of one pixel at most. *Cuts* counts frames whose motion explained so little that the \
            generator detected a cut and repeated the nearer anchor.\n";
    if let Some(caption) = caption {
        _ = write!(out, "\n![every source's motion and frame](motion.png)\n\n*{caption}*\n");
    }
    out += "\n## Between the renderer's anchors\n\n";
    out += &table(records, Anchors::Drawn, &ROWS[..SOURCES], false).markdown();
    _ = write!(
        out,
        "\nThe calibrated factor is {}; the paper's is {}. It is a least-squares fit over place {TUNING} of each kind, on which \
         `picture_flow` was tuned as well. The constants of `latent_flow` were not tuned. No place of the tables was used for tuning.\n\n",
        digits(f64::from(scale), 2),
        cairn::guidance::paper::COMPRESSION
    );
    out += &differences(records, Anchors::Drawn).markdown();
    out += "\nMeans over the places, with the 95 % interval of the mean difference in brackets.\n";
    out += &explained(records);
    out += "\n## By kind of place\n\nError, in pixels:\n\n";
    out += &by_family(records, END_POINT, 2).markdown();
    out += "\nPSNR of the frames, in dB:\n\n";
    out += &by_family(records, PSNR, 2).markdown();
    out += "\n## Between the autoencoder's pictures\n\n\
            A world's anchors are decoded latents. Here the same anchors are encoded one by one, and each is decoded after the three \
            before it. The reference is still the renderer's picture, so every line contains the autoencoder's blur, even the one with the true \
            motion.\n\n";
    out += &table(records, Anchors::Decoded, &ROWS[..SOURCES], false).markdown();
    _ = write!(out, "\n{}", decoded_words(&scores(records, Anchors::Decoded)));
    out += "\n## What depth is worth\n\n";
    let depths: Vec<Row> = [1, 7, 5, 8, 9, 6, 10, 11].map(|n: usize| ROWS[n]).to_vec();
    out += &table(records, Anchors::Drawn, &depths, true).markdown();
    _ = write!(
        out,
        "\n## How it was measured\n\n\
         {frames} frames of {} places: {} of every kind, all held out from training, under the scripts of `samples/scripts`; latents \
         of the world *{world}*, whose encoder gets each anchor as a still picture. They are our own scenes, in which only the camera and a \
         held item move: on other footage the order may be another. The camera of `controls` has the scenes' turn per mouse \
         count, speed, height and field of view, which a world does not state. The command also writes a CSV with every frame.\n\n\
         ```sh\n{}\n```\n",
        scenes.len(),
        seed_list(seeds, ", "),
        settings.command("motion")
    );
    out
}

/// CSV with a line for every frame.
pub(super) fn csv(records: &[Record]) -> String {
    let mut text = String::from("scene,place,anchors,anchor,motion,depth,off,within_1,psnr,ssim,lpips,given_up\n");
    for record in records {
        let anchors = if record.anchors == Anchors::Drawn { "drawn" } else { "decoded" };
        let Record { scene, anchor, row, end_point, score, cut, .. } = record;
        let lpips = score.lpips.map_or(String::new(), |lpips| format!("{lpips:.6}"));
        _ = writeln!(
            text,
            "{},{},{anchors},{anchor},{},{},{:.4},{:.5},{:.4},{:.6},{lpips},{}",
            scene.family,
            scene.seed,
            row.motion.name(),
            row.depth.name(),
            end_point.mean,
            end_point.near,
            score.psnr,
            score.ssim,
            u8::from(*cut)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use scenes::Family;

    use super::super::measure::EndPoint;
    use super::*;
    use crate::losses::tests::{published, value};
    use crate::metrics::Score;

    #[test]
    fn the_page_says_where_ours_loses_between_the_autoencoders_pictures() {
        let page = include_str!("../../../../docs/motion.md");
        let table = published(page, "## Between the autoencoder's pictures");
        let row = |(motion, cells): (Motion, &Vec<String>)| {
            assert_eq!(cells[0], motion.name());
            losses::Row::new(motion.name(), [3, 4, 5].map(|i| value(&cells[i])))
        };
        let rows: Vec<losses::Row> = MOTIONS.into_iter().zip(&table).map(row).collect();
        assert!(page.contains(&decoded_words(&rows)), "{}", decoded_words(&rows));
    }

    #[test]
    fn losses_are_those_of_the_run_and_nothing_else_is_said_about_them() {
        let row = |name, psnr, lpips| losses::Row::new(name, [Some(psnr), Some(0.75), Some(lpips)]);
        let words = |lpips: f64, truth: f64| {
            decoded_words(&[row("paper", 26.0, 0.2), row("picture-flow", 27.0, lpips), row("truth", 28.0, truth)])
        };
        let lost = "**Where ours loses:** `picture-flow` loses in LPIPS (0.3000) to `paper` (0.2000).";
        assert!(words(0.3, 0.1).ends_with(&format!("\n\n{lost}\n")), "{}", words(0.3, 0.1));
        let both = format!("\n\n{lost} So does the true motion: in LPIPS (0.2500) to `paper` (0.2000).\n");
        assert!(words(0.3, 0.25).ends_with(&both), "{}", words(0.3, 0.25));
        let none = words(0.2, 0.25);
        assert!(none.ends_with(" No cheaper row is better than `picture-flow` in any measure.\n"), "{none}");
    }

    #[test]
    fn between_the_autoencoders_pictures_most_measures_decide() {
        let decoded =
            |row: Row, psnr, lpips| Record { anchors: Anchors::Decoded, ..record(41, row, psnr, Some(lpips)) };
        // SSIM is a tie, which is of the source that `best` selects.
        let ours = decoded(ROWS[5], 30.0, 0.3);
        assert_eq!(best_decoded(&[ours, decoded(ROWS[1], 29.0, 0.1)]), Some(GuidanceSource::PictureFlow));
        assert_eq!(best_decoded(&[ours, decoded(ROWS[1], 31.0, 0.1)]), Some(GuidanceSource::Paper));
        assert_eq!(best_decoded(&[ours, decoded(ROWS[1], 31.0, 0.4), decoded(ROWS[3], 29.0, 0.1)]), None);
        assert_eq!(best_decoded(&[]), None);
    }

    fn record(seed: u64, row: Row, psnr: f64, lpips: Option<f64>) -> Record {
        let (end_point, score) = (EndPoint { mean: 1.0, near: 0.5 }, Score { psnr, ssim: 0.9, lpips });
        let scene = SceneId { family: Family::Snow, seed };
        Record { scene, anchors: Anchors::Drawn, row, anchor: 14, end_point, score, cut: false }
    }

    #[test]
    fn the_best_needs_nothing_but_anchors_and_is_nearest_in_lpips() {
        let with = |psnr: [f64; 4], lpips: [Option<f64>; 4]| {
            let rows = [ROWS[6], ROWS[1], ROWS[3], ROWS[5]];
            (0..4).map(|n| record(41, rows[n], psnr[n], lpips[n])).collect::<Vec<_>>()
        };
        // The truth is better than all sources, and is none itself.
        let all = with([50.0, 30.0, 31.0, 32.0], [Some(0.0), Some(0.1), Some(0.3), Some(0.2)]);
        assert_eq!(best(&all), Some(GuidanceSource::Paper), "by LPIPS");
        let all = with([50.0, 30.0, 33.0, 32.0], [None; 4]);
        assert_eq!(best(&all), Some(GuidanceSource::LatentFlow), "by PSNR");
        assert_eq!(best(&[]), None);
    }

    #[test]
    fn differences_are_taken_scene_by_scene() {
        let records = [
            record(41, ROWS[5], 40.0, None),
            record(41, ROWS[1], 38.0, None),
            record(42, ROWS[5], 30.0, None),
            record(42, ROWS[1], 27.0, None),
            // A scene that one of the two lacks is left out for both.
            record(43, ROWS[1], 90.0, None),
        ];
        let text = differences(&records, Anchors::Drawn).markdown();
        let line = text.lines().find(|line| line.contains("| paper ")).unwrap();
        assert!(line.contains("+2.50 (-3.85 to +8.85)"), "{text}");
        assert_eq!((digits(-0.001, 2), digits(-0.01, 2)), ("0.00".into(), "-0.01".into()));
    }
}
