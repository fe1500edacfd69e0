//! Tables, CSV and page.

use std::fmt::Write as _;

use super::measure::{CADENCES, Cadence, METHODS, Method, Record, Source};
use crate::experiment::{Measurements, seed_list};
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
    out += "\nFrom 10 to 60 by phase, with motion from pictures:\n\n";
    out += &by_phase(records, Source::Drawn).markdown();
    out += "\n## Between the world's own pictures\n\n\
            The decoder makes sixty pictures a second from fifteen latents. Here every sixth, fourth or second of them is an anchor, \
            and the others are the true frames. Only anchors at 15 a second have a latent each, so motion comes from pictures. The world's \
            pictures are softer than the renderer's and easier to approximate: the two tables cannot be compared.\n\n";
    out += &table(records, Source::World).markdown();
    out += "\nFrom 10 to 60 by phase, with motion from pictures:\n\n";
    out += &by_phase(records, Source::World).markdown();
    _ = write!(
        out,
        "\nAll values are means over the places, with the 95 % bootstrap interval in brackets; a single place has none.\n\n\
         ## How it was measured\n\n\
         {} places: seeds {} of every kind, all held out from training, under the scripts of `samples/scripts`. The world is *{world}* at \
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
