//! The table for people, as Markdown.

use std::fmt::Write as _;

use super::claims::{Claim, MEASURES};
use super::measure::Measured;
use super::rows::Kind;
use super::table::{Table, is_better, measures};
use super::{FIGURE, FRAMES, SUMMARY, Settings};

/// The whole text. It depends on nothing but what was measured, so that a change of the table is a change of figures.
pub(super) fn text(
    settings: &Settings,
    measured: &Measured,
    table: &Table,
    claims: &[Claim],
    caption: Option<&str>,
) -> String {
    let mut out = "# Picture quality\n\n".to_owned();
    out += "Frames between two anchors, made in several ways and held against the true ones. This page is written by `study quality`; \
            what it says by itself is in `samples/study/src/quality/report.rs`.\n\n";
    out += "Every cell is PSNR in dB (more is better), SSIM (more is better) and LPIPS (less is better); the best of each \
            column is bold.\n";
    if let Some(caption) = caption {
        _ = write!(out, "\n![{caption}]({FIGURE})\n\n*{caption}*\n");
    }
    for multiplier in table.multipliers() {
        tables(&mut out, table, multiplier);
    }
    differences(&mut out, table);
    if !claims.is_empty() {
        out += "\n## What is claimed\n\n| | claim | figures |\n|---|---|---|\n";
        for claim in claims {
            let verdict = if claim.held { "held" } else { "**missed**" };
            _ = writeln!(out, "| {verdict} | {} | {} |", claim.what, claim.figures);
        }
    }
    rows(&mut out, measured, table);
    clips(&mut out, measured);
    method(&mut out, settings);
    out
}

/// One table of scenes and one of other clips.
fn tables(out: &mut String, table: &Table, multiplier: u32) {
    let is_scene = |group: &String| scenes::FAMILIES.iter().any(|family| family.name() == group);
    let (scenes, films): (Vec<String>, Vec<String>) = table.groups(multiplier).into_iter().partition(is_scene);
    for (groups, what) in [(scenes, "scenes"), (films, "real pictures")] {
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

/// The three values of a cell, with the best of their column bold.
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

/// A value of measure `i` with the digits that mean something.
fn number(i: usize, value: f64) -> String {
    match i {
        0 => format!("{value:.2}"),
        1 => format!("{value:.4}"),
        _ => format!("{value:.4}"),
    }
}

/// Differences of our rows to the others, clip by clip over the scenes.
fn differences(out: &mut String, table: &Table) {
    let groups: Vec<String> = scenes::FAMILIES.iter().map(|family| family.name().to_owned()).collect();
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

fn rows(out: &mut String, measured: &Measured, table: &Table) {
    out.push_str("\n## The rows\n\n| row | how it makes its pictures | program and settings |\n|---|---|---|\n");
    for (kind, row) in &measured.rows {
        let version = row.version();
        _ = writeln!(out, "| {} (`{}`) | {} | {version} |", kind.label(), kind.name(), kind.description());
    }
    if !measured.left_out.is_empty() {
        out.push_str("\nLeft out:\n\n");
        for left_out in &measured.left_out {
            _ = writeln!(out, "- `{}`: {}", left_out.name, left_out.why.replace('\n', " "));
        }
    }
    let _ = table;
}

fn clips(out: &mut String, measured: &Measured) {
    out.push_str("\n## The clips\n\n");
    let names: Vec<&str> = measured.clips.iter().map(|clip| clip.name()).collect();
    _ = writeln!(out, "{}.", names.join(", "));
}

fn method(out: &mut String, settings: &Settings) {
    let seeds: Vec<String> = settings.seeds.iter().map(ToString::to_string).collect();
    _ = write!(
        out,
        "\n## How it was measured\n\n```sh\ncargo run --release -p study -- quality --rows {} --clips {} --seeds {} --lpips {}\n```\n\n\
         - PSNR over R, G and B; SSIM with a Gaussian window of 11x11, the mean of R, G and B; LPIPS v0.1 with the published weights; all on \
         8-bit display values at full size.\n\
         - Frames of a clip are averaged first, then the clips of a kind of place; the unit of statistics is the clip. Equal pictures \
         count as 100 dB.\n\
         - `{SUMMARY}` beside this page holds every mean; `{FRAMES}`, in the folder of the run, every frame.\n",
        settings.rows,
        settings.clips,
        seeds.join(","),
        settings.lpips,
    );
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().collect::<String>() + letters.as_str()).unwrap_or_default()
}
