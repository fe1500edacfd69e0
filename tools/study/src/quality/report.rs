//! The report as Markdown.

use std::fmt::Write as _;

use super::claims::MEASURES;
use super::limits::LIMITS;
use super::measure::Measurements;
use super::rows::Kind;
use super::table::{Table, is_better, measures};
use super::{FIGURE, FRAMES, Page, SUMMARY, Settings};

/// The scenes' seed that may be used to tune the generator.
const SEED_FOR_TUNING: u64 = 4;

/// The whole text. It depends on the measurements only, so the page changes only when they do.
pub(super) fn text(page: &Page<'_>, measured: &Measurements, caption: Option<&str>) -> String {
    let Page { settings, table, claims, speed } = page;
    let mut out = "# Picture quality\n\n".to_owned();
    out += "Cairn makes the frames between two pictures, the anchors. How good are they? Here the true frame between two anchors \
            is held back, made again in several ways, by Cairn and by others, and what was made is compared with the truth.\n";
    _ = write!(out, "\n{LIMITS}");
    if settings.seeds.contains(&SEED_FOR_TUNING) {
        out += "\n**These are figures of work in progress**, on the scenes that the generator is tuned on.\n";
    }
    if let Some(caption) = caption {
        _ = write!(out, "\n![The same place as every row makes it]({FIGURE})\n\n*{caption}*\n");
    }
    if !table.multipliers().is_empty() {
        out += "\n## How to read the tables\n\nEvery cell holds three measures, and the best of each column is bold:\n\n\
                - **PSNR** in dB: more is better; 1 dB is a ninth less error, 6 dB half of it.\n\
                - **SSIM**: more is better, 1 is equal; whether shapes are where they should be.\n\
                - **LPIPS**: less is better, 0 is equal; a neural network's guess of what people see.\n\n\
                *Repeat* and *blend* are what costs nothing. *Minterpolate*, *FlowFPS* and *RIFE* see nothing but pictures, as \
                Cairn does with `picture_flow`; with true motion and depth it gets the renderer's, which are exact.\n";
    }
    for multiplier in table.multipliers() {
        tables(&mut out, table, multiplier);
    }
    if !claims.is_empty() {
        let held = claims.iter().filter(|claim| claim.held).count();
        _ = write!(
            out,
            "\n## What is claimed\n\n{held} of {} claims held; `study quality --check` fails where one does not.\n\n\
             | | claim | figures |\n|---|---|---|\n",
            claims.len()
        );
        for claim in *claims {
            let verdict = if claim.held { "held" } else { "**missed**" };
            _ = writeln!(out, "| {verdict} | {} | {} |", claim.what, claim.figures);
        }
    }
    if let Some(speed) = speed {
        out += &speed.text();
    }
    differences(&mut out, table);
    if !measured.rows.is_empty() {
        rows(&mut out, measured);
        clips(&mut out, measured);
    }
    left_out(&mut out, measured);
    method(&mut out, settings);
    out
}

/// One table of scenes and one of other clips.
fn tables(out: &mut String, table: &Table, multiplier: u32) {
    let is_scene = |group: &String| scenes::LANDSCAPES.iter().any(|family| family.name() == group);
    let (scenes, films): (Vec<String>, Vec<String>) = table.groups(multiplier).into_iter().partition(is_scene);
    for (groups, what) in [(scenes, "scenes"), (films, "film and game")] {
        if groups.is_empty() {
            continue;
        }
        _ = write!(out, "\n## {} at {multiplier} times the anchors' rate\n\n| |", capital(what));
        for group in &groups {
            let clips = table.clips(multiplier, group).len();
            _ = write!(out, " {group}{} |", if clips > 1 { format!(" ({clips})") } else { String::new() });
        }
        _ = write!(out, "\n|---|{}\n", "---|".repeat(groups.len()));
        for row in table.rows(multiplier) {
            _ = write!(out, "| {} |", row.label());
            for group in &groups {
                _ = write!(out, " {} |", cell(table, multiplier, group, row));
            }
            out.push('\n');
        }
    }
}

/// The three values of a cell; the best of each column is bold.
fn cell(table: &Table, multiplier: u32, group: &str, row: Kind) -> String {
    let Some(own) = table.group(multiplier, group, row) else { return "–".into() };
    let all: Vec<_> = table
        .rows(multiplier)
        .into_iter()
        .filter_map(|kind| Some(measures(&table.group(multiplier, group, kind)?.score)))
        .collect();
    let shown = (0..3).map(|i| {
        let Some(value) = measures(&own.score)[i] else { return "–".to_owned() };
        let text = number(i, value);
        let beaten = all.iter().filter_map(|scores| scores[i]).any(|other| is_better(i, other, value));
        if beaten || all.len() < 2 { text } else { format!("**{text}**") }
    });
    shown.collect::<Vec<_>>().join(" / ")
}

/// A value of measure `i` with its significant digits.
fn number(i: usize, value: f64) -> String {
    if i == 0 { format!("{value:.2}") } else { format!("{value:.4}") }
}

/// Differences between our rows and the others, paired by clip, over the scenes.
fn differences(out: &mut String, table: &Table) {
    let groups: Vec<String> = scenes::LANDSCAPES.iter().map(|family| family.name().to_owned()).collect();
    let mut lines = String::new();
    for own in [Kind::Flow, Kind::Truth] {
        for other in table.rows(2).into_iter().filter(|row| *row != own && *row != Kind::Truth) {
            let Some(paired) = table.paired(2, &groups, own, other) else { continue };
            _ = write!(lines, "| {} | {} |", own.label(), other.label());
            for i in 0..3 {
                match paired.differences[i] {
                    Some([mean, least, greatest]) => {
                        let digits = if i == 0 { 2 } else { 4 };
                        let wins = paired.wins[i];
                        _ = write!(
                            lines,
                            " {mean:+.digits$} ({least:+.digits$} to {greatest:+.digits$}), {wins} of {} |",
                            paired.clips
                        );
                    }
                    None => lines += " – |",
                }
            }
            lines.push('\n');
        }
    }
    if !lines.is_empty() {
        _ = write!(
            out,
            "\n## Differences clip by clip\n\nOver the clips of all scenes at twice the anchors' rate: the mean of the differences \
             between two rows on the same clip, the least and the greatest, and on how many clips the first is better.\n\n\
             | | against | {} | {} | {} |\n|---|---|---|---|---|\n{lines}",
            MEASURES[0], MEASURES[1], MEASURES[2]
        );
    }
}

fn rows(out: &mut String, measured: &Measurements) {
    out.push_str("\n## The rows\n\n| row | how it makes its pictures | program and settings |\n|---|---|---|\n");
    for (kind, row) in &measured.rows {
        let version = row.version();
        _ = writeln!(out, "| {} (`{}`) | {} | {version} |", kind.label(), kind.name(), kind.description());
    }
}

fn clips(out: &mut String, measured: &Measurements) {
    out.push_str("\n## The clips\n\n| clip | what it is | frames |\n|---|---|---|\n");
    for clip in &measured.clips {
        let frames: usize = clip.targets().iter().map(|target| target.phases().len()).sum();
        _ = writeln!(out, "| {} | {} | {frames} |", clip.name(), clip.description());
    }
}

fn left_out(out: &mut String, measured: &Measurements) {
    if !measured.left_out.is_empty() {
        out.push_str("\n## What is missing\n\n");
        for left_out in &measured.left_out {
            _ = writeln!(out, "- `{}`: {}", left_out.name, left_out.why.replace('\n', " "));
        }
    }
}

fn method(out: &mut String, settings: &Settings) {
    let Settings { rows, clips, lpips, .. } = settings;
    let seeds: Vec<String> = settings.seeds.iter().map(ToString::to_string).collect();
    let speed = if settings.speed { " --speed" } else { "" };
    let tuned = if settings.seeds.contains(&SEED_FOR_TUNING) {
        "The generator and `picture_flow` are tuned on seed 4 of the scenes, which is among these."
    } else {
        "The constants of the generator and of `picture_flow` were tuned on seed 4 of the scenes alone. The clips shown here are \
         development sets: their results were seen while rules were chosen."
    };
    _ = write!(
        out,
        "\n## How it was measured\n\nThis page was written by\n\n```sh\n\
         cargo run --release -p study -- quality --rows {rows} --clips {clips} --seeds {} --lpips {lpips}{speed}\n```\n\n\
         - {tuned}\n\
         - PSNR over R, G and B; SSIM with a Gaussian window of 11x11, the mean of R, G and B; LPIPS v0.1 with the published \
         weights; all on 8-bit display values at full size.\n\
         - Frames of a clip are averaged first, then the clips of a kind of place; the unit of statistics is the clip. Equal \
         pictures count as 100 dB.\n\
         - In ViZDoom, pixels of the true frame that show things instead of the world are made equal in every row before it is \
         measured. Motion follows from depth and camera; the depth buffer's steps of 7 and 16 map units are refined by the \
         map's own lines and heights, and where the two contradict each other the buffer counts.\n\
         - `{SUMMARY}` beside this page holds every mean; `{FRAMES}`, in the folder of the run, every frame.\n",
        seeds.join(","),
    );
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().collect::<String>() + letters.as_str()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::super::claims;
    use super::super::measure::Unavailable;
    use super::super::table::tests::record;
    use super::*;

    #[test]
    fn a_page_shows_the_best_in_bold_and_tells_what_is_missing_and_how_it_was_made() {
        let records = vec![
            record("snow-4", Kind::Blend, 30.0, Some(0.1)),
            record("snow-4", Kind::Flow, 35.0, Some(0.2)),
            record("bunny-bird", Kind::Blend, 31.0, None),
        ];
        let table = Table::new(&records);
        let claims = claims::judge(&table);
        let settings = Settings {
            rows: "all".into(),
            clips: "all".into(),
            seeds: vec![4, 8],
            lpips: "alex".into(),
            smoke: false,
            speed: true,
            fresh: false,
            publish: false,
            out: "out".into(),
        };
        let measured = Measurements {
            records,
            left_out: vec![Unavailable { name: "rife".into(), why: "no\nnetwork".into() }],
            rows: Vec::new(),
            clips: Vec::new(),
            lpips: None,
            computed: 0,
            kept: 0,
            interrupted: false,
        };
        let page = Page { settings: &settings, table: &table, claims: &claims, speed: None };
        let text = text(&page, &measured, Some("A place."));
        for part in [
            "](quality.png)",
            "## Scenes at 2 times",
            "| blend | 30.00 / 0.3000 / **0.1000** |",
            "| **Cairn**, `picture_flow` | **35.00** / **0.3500** / 0.2000 |",
            "## Film and game at 2 times",
            "| blend | 31.00 / 0.3100 / – |",
            "0 of 1 claims held",
            "| **missed** | snow: cairn-flow beats blend",
            "- `rife`: no network",
            "quality --rows all --clips all --seeds 4,8 --lpips alex --speed\n",
            "work in progress",
        ] {
            assert!(text.contains(part), "{part} is not in\n{text}");
        }
    }
}
