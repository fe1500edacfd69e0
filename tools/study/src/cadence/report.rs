//! Tables, CSV and page.

use std::fmt::Write as _;

use super::measure::{CADENCES, Cadence, METHODS, Method, Record, Source};
use crate::experiment::{Measurements, seed_list};
use crate::losses::{self, losses};
use crate::statistics::{Estimate, estimate, scene_means};
use crate::table::Table;

/// A value of a frame, for example its PSNR.
type Value = fn(&Record) -> Option<f64>;

const VALUES: [(Value, usize); 3] =
    [(|record| Some(record.score.psnr), 2), (|record| Some(record.score.ssim), 4), (|record| record.score.lpips, 4)];

/// Mean over scenes of each scene's mean over the frames selected by `of`.
fn over_scenes(records: &[Record], value: Value, of: impl Fn(&Record) -> bool) -> Option<Estimate> {
    let values = records.iter().filter(|record| of(record)).filter_map(|record| Some((record.scene, value(record)?)));
    estimate(&scene_means(values).into_iter().map(|(_, mean)| mean).collect::<Vec<_>>())
}

fn number(value: Option<Estimate>, digits: usize) -> String {
    match value {
        None => "–".into(),
        Some(Estimate { mean, interval: None }) => format!("{mean:.digits$}"),
        Some(Estimate { mean, interval: Some([low, high]) }) => {
            format!("{mean:.digits$} ({low:.digits$} to {high:.digits$})")
        }
    }
}

/// Table of every cadence and method, over all phases.
fn table(records: &[Record], source: Source) -> Table {
    let mut lines = Vec::new();
    for cadence in CADENCES {
        for method in
            METHODS.into_iter().filter(|method| records.iter().any(|r| (r.source, r.method) == (source, *method)))
        {
            let of = |r: &Record| (r.source, r.cadence, r.method) == (source, cadence, method);
            let mut line = vec![cadence.to_string(), method.name().to_owned()];
            line.extend(VALUES.map(|(value, digits)| number(over_scenes(records, value, of), digits)));
            lines.push(line);
        }
    }
    Table::new(2, &["cadence", "motion", "PSNR, dB", "SSIM", "LPIPS"], lines)
}

/// Table of the first cadence by phase, with optical flow.
fn by_phase(records: &[Record], source: Source) -> Table {
    let cadence: Cadence = CADENCES[0];
    let lines = (1..cadence.multiplier()).map(|part| {
        let mut line = vec![format!("{part}/{}", cadence.multiplier())];
        line.extend(VALUES.map(|(value, digits)| {
            let of = |r: &Record| (r.source, r.cadence, r.method, r.part) == (source, cadence, Method::Pictures, part);
            over_scenes(records, value, of).map_or("–".into(), |estimate| format!("{:.digits$}", estimate.mean))
        }));
        line
    });
    Table::new(1, &["phase", "PSNR, dB", "SSIM", "LPIPS"], lines.collect())
}

/// Scores of a method at a cadence.
fn scores(records: &[Record], source: Source, cadence: Cadence, method: Method) -> losses::Row {
    let of = |r: &Record| (r.source, r.cadence, r.method) == (source, cadence, method);
    losses::Row::of(method.name(), VALUES.map(|(value, _)| over_scenes(records, value, of)))
}

/// Where repeating the nearer anchor is better than generating with optical flow, for each cadence's rows of the two.
fn words(rows: &[(Cadence, [losses::Row; 2])]) -> String {
    let lost = rows.iter().filter_map(|(cadence, [repeat, flow])| {
        Some(format!("from {} to {} it loses {}", cadence.anchors, cadence.frames, losses(flow, &[repeat])?))
    });
    let lost: Vec<String> = lost.collect();
    if lost.is_empty() {
        return "`repeat` is better than `picture-flow` in no measure at any cadence.\n".into();
    }
    format!("**Where ours loses:** `picture-flow` is better than `repeat` but for this: {}.\n", lost.join("; "))
}

/// The rows that [`words`] compares.
fn compared(records: &[Record], source: Source) -> Vec<(Cadence, [losses::Row; 2])> {
    let of = |cadence| [Method::Repeat, Method::Pictures].map(|method| scores(records, source, cadence, method));
    CADENCES.into_iter().map(|cadence| (cadence, of(cadence))).collect()
}

/// Summary for the terminal.
pub(super) fn summary(measured: &Measurements<'_, Record>) -> String {
    format!(
        "{}, {} places\n\nbetween the renderer's anchors:\n\n{}\nbetween the world's own:\n\n{}",
        measured.world,
        measured.scenes.len(),
        table(measured.records, Source::Drawn).markdown(),
        table(measured.records, Source::World).markdown()
    )
}

/// The page `docs/cadence.md`. Depends on the measurements only.
pub(super) fn page(measured: &Measurements<'_, Record>, caption: Option<&str>) -> String {
    let Measurements { settings, world, seeds, scenes, records } = *measured;
    let mut out = String::from(
        "# From 10 to 60\n\n\
         With ten anchors and sixty frames a second, five of six frames are generated. This page compares each of them with the true \
         frame of its time, and does the same for 15 to 60, 15 to 30 and 30 to 60. The `cpu` generator makes the frames. *repeat* shows the \
         nearer anchor again, *picture-flow* is optical flow between the two anchors' pictures, and *truth* is the renderer's motion and \
         depth.\n",
    );
    if let Some(caption) = caption {
        _ = write!(out, "\n![one interval from 10 to 60](cadence.png)\n\n*{caption}*\n");
    }
    out += "\n## Between the renderer's anchors\n\nThe true frames are rendered at their times.\n\n";
    out += &table(records, Source::Drawn).markdown();
    _ = write!(out, "\n{}", words(&compared(records, Source::Drawn)));
    out += "\nFrom 10 to 60 by phase, with motion from pictures:\n\n";
    out += &by_phase(records, Source::Drawn).markdown();
    out += "\n## Between the world's own pictures\n\n\
            The decoder makes sixty pictures a second from fifteen latents. Here every sixth, fourth or second of them is an anchor, \
            and the others are the true frames. Only anchors at 15 a second have a latent each, so motion comes from pictures. The world's \
            pictures are softer than the renderer's and easier to approximate: the two tables cannot be compared.\n\n";
    out += &table(records, Source::World).markdown();
    _ = write!(out, "\n{}", words(&compared(records, Source::World)));
    out += "\nFrom 10 to 60 by phase, with motion from pictures:\n\n";
    out += &by_phase(records, Source::World).markdown();
    _ = write!(
        out,
        "\nAll values are means over the places, with the 95 % interval in brackets; a single place has none.\n\n\
         ## How it was measured\n\n\
         {} places: seeds {} of every kind, all held out from training, under the scripts of `samples/scripts`. They are our own scenes, in which \
         only the camera and a held item move: other footage was not measured here. The world is *{world}* at \
         the paper's operating point, all four pictures of each latent. The command also writes a CSV with every frame.\n\n\
         ```sh\n{}\n```\n",
        scenes.len(),
        seed_list(seeds, ", "),
        settings.command("cadence")
    );
    out
}

/// CSV with a line for every frame.
pub(super) fn csv(records: &[Record]) -> String {
    let mut text = String::from("scene,place,anchors,cadence,motion,end,part,psnr,ssim,lpips\n");
    for Record { scene, source, cadence, method, end, part, score } in records {
        let anchors = if *source == Source::Drawn { "drawn" } else { "world" };
        let lpips = score.lpips.map_or(String::new(), |lpips| format!("{lpips:.6}"));
        _ = writeln!(
            text,
            "{},{},{anchors},{}-{},{},{end},{part},{:.4},{:.6},{lpips}",
            scene.family,
            scene.seed,
            cadence.anchors,
            cadence.frames,
            method.name(),
            score.psnr,
            score.ssim
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::tests::{published, value};

    #[test]
    fn the_page_says_where_ours_loses_to_repeating() {
        let page = include_str!("../../../../docs/cadence.md");
        for (heading, methods) in [("## Between the renderer's anchors", 3), ("## Between the world's own pictures", 2)]
        {
            let table = published(page, heading);
            assert_eq!(table.len(), methods * CADENCES.len());
            let rows = CADENCES.into_iter().zip(table.chunks(methods)).map(|(cadence, rows)| {
                assert_eq!(rows[0][0], cadence.to_string());
                let row = |n: usize, method: Method| {
                    assert_eq!(rows[n][1], method.name());
                    losses::Row::new(method.name(), [2, 3, 4].map(|i| value(&rows[n][i])))
                };
                (cadence, [row(0, Method::Repeat), row(1, Method::Pictures)])
            });
            let words = words(&rows.collect::<Vec<_>>());
            assert!(page.contains(&words), "{heading}: {words}");
        }
    }

    #[test]
    fn every_cadence_that_loses_is_named() {
        let row = |name, psnr, lpips| losses::Row::new(name, [Some(psnr), Some(0.9), Some(lpips)]);
        let rows = [
            (CADENCES[0], [row("repeat", 30.0, 0.1), row("picture-flow", 31.0, 0.2)]),
            (CADENCES[1], [row("repeat", 30.0, 0.1), row("picture-flow", 31.0, 0.1)]),
            (CADENCES[3], [row("repeat", 30.0, 0.1), row("picture-flow", 29.0, 0.05)]),
        ];
        let text = words(&rows);
        assert!(
            text.contains(
                "from 10 to 60 it loses in LPIPS (0.2000) to `repeat` (0.1000); from 30 to 60 it loses in PSNR"
            ),
            "{text}"
        );
        assert!(!text.contains("15 to 60"), "{text}");
        assert!(words(&rows[1..2]).contains("in no measure at any cadence"), "equal is no loss");
    }
}
