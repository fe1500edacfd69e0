//! The report as Markdown.

use std::fmt::Write as _;

use super::claims::{MEASURES, Tally};
use super::ledger::{GENERATOR, LEDGER};
use super::limits::LIMITS;
use super::measure::Measurements;
use super::rows::Kind;
use super::table::{Table, is_better, measures};
use super::{FIGURE, FRAMES, Opening, Page, Settings};
use crate::losses::list;
use crate::sets::{self, Set};

/// The whole text. It depends on the measurements only, so the page changes only when they do.
pub(super) fn text(page: &Page<'_>, measured: &Measurements, caption: Option<&str>) -> String {
    let Page { settings, table, claims, speed, .. } = page;
    let title = if page.opening.is_some() { "Picture quality on the sealed set" } else { "Picture quality" };
    let mut out = format!("# {title}\n\n");
    out += "Cairn makes the frames between two pictures, the anchors. How good are they? Here the true frame between two anchors \
            is held back, made again in several ways, by Cairn and by others, and what was made is compared with the truth.\n";
    if let Some(opening) = page.opening {
        sealed(&mut out, opening);
    } else {
        _ = write!(out, "\n{LIMITS}");
    }
    if page.opening.is_none() && is_tuned(settings) {
        out += "\n**These are figures of work in progress**, on the scenes that the generator is tuned on.\n";
    }
    if let Some(caption) = caption {
        _ = write!(out, "\n![The same place as every row makes it]({FIGURE})\n\n*{caption}*\n");
    }
    if !table.multipliers().is_empty() {
        out += "\n## How to read the tables\n\nEvery cell holds three measures, and the best for each clip or kind of scene is bold:\n\n\
                - **PSNR** in dB: more is better; 1 dB is a ninth less error, 6 dB half of it.\n\
                - **SSIM**: more is better, 1 is equal; whether shapes are where they should be.\n\
                - **LPIPS**: less is better, 0 is equal; a neural network's guess of what people see.\n\n\
                *Repeat* and *blend* are what costs nothing. *Minterpolate*, *FlowFPS* and *RIFE* see nothing but pictures, as \
                Cairn does with `picture_flow`; with true motion and depth it gets the renderer's, which are exact. *AMD FSR* gets motion \
                and depth from the same three sources as Cairn; AMD recommends it for 30 anchors a second and more, and these are \
                fewer. Where there is a head-up display, AMD's rows get it within the picture and Cairn's a mask of it; a game gives AMD its interface \
                apart, so that their figures there are lower than a game would see.\n";
    }
    where_behind(&mut out, table);
    for multiplier in table.multipliers() {
        tables(&mut out, table, multiplier, &sets_of(measured));
    }
    if !claims.is_empty() {
        _ = write!(
            out,
            "\n## What is claimed\n\n{}; `study quality --check` fails where one is missed.\n\n\
             | | claim | figures |\n|---|---|---|\n",
            Tally::of(claims)
        );
        for claim in *claims {
            _ = writeln!(out, "| {} | {} | {} |", claim.verdict.label(), claim.what, claim.figures);
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
    method(&mut out, page);
    out
}

/// The parts of the text that the table alone decides: its tables, and the differences clip by clip.
pub(super) fn of_table(table: &Table) -> String {
    let mut out = String::new();
    where_behind(&mut out, table);
    table.multipliers().into_iter().for_each(|multiplier| tables(&mut out, table, multiplier, &[]));
    differences(&mut out, table);
    out
}

/// For our rows at twice the anchors' rate: on which clips or kinds of scene a row that sees pictures alone is nearer to the truth.
fn where_behind(out: &mut String, table: &Table) {
    let (multiplier, rows) = (2, table.rows(2));
    let others: Vec<Kind> = rows.iter().copied().filter(|row| row.is_of_others()).collect();
    let ours = [Kind::Flow, Kind::Engine, Kind::Truth].into_iter().filter(|row| rows.contains(row));
    let groups = table.groups(multiplier);
    let mut lines = String::new();
    for row in ours {
        for (i, measure) in MEASURES.into_iter().enumerate() {
            let value = |group: &str, row: Kind| measures(&table.group(multiplier, group, row)?.score)[i];
            let (mut behind, mut count) = (Vec::new(), 0);
            for group in &groups {
                let Some(own) = value(group, row) else { continue };
                count += 1;
                if others.iter().filter_map(|other| value(group, *other)).any(|other| is_better(i, other, own)) {
                    behind.push(group.as_str());
                }
            }
            if !behind.is_empty() {
                _ = writeln!(
                    lines,
                    "| {} | {measure} | {} of {count} | {} |",
                    row.label(),
                    behind.len(),
                    behind.join(", ")
                );
            }
        }
    }
    if !lines.is_empty() {
        out.push_str("\n## Where ours is behind\n\nAt twice the anchors' rate, a row of another maker is nearer to the truth on:\n\n| | | | |\n|---|---|---|---|\n");
        out.push_str(&lines);
    }
}

/// Whether scenes of the tuning set are among those that were asked for.
fn is_tuned(settings: &Settings) -> bool {
    settings.seeds.iter().any(|seed| sets::of_seed(*seed) == Set::Tuning)
}

/// How the sealed set is kept, and this opening of it.
fn sealed(out: &mut String, opening: &Opening) {
    let date = opening.entry.date.strftime("%Y-%m-%d, %H:%M UTC");
    let sources = &opening.entry.sources;
    let folders = GENERATOR.map(|folder| format!("`{folder}`")).join(" and ");
    _ = write!(
        out,
        "\n**These clips are sealed.** Every command refuses their seeds, control scripts and films; `study quality --sealed` alone opens \
         them. It shows means of clips only, no picture and no frame's score, and each time it appends date, commit and results to the \
         ledger, [`{LEDGER}`](sealed-ledger.csv), before it shows anything. Lines of the ledger are never changed, and a test checks that.\n\n\
         This is opening {} of the set: {date}, commit `{}`, work tree {}, ledger digest of {folders}, tests and comments included, `{}`.\n",
        opening.number, sources.commit, sources.work_tree, sources.generator
    );
}

/// The set of each clip.
fn sets_of(measured: &Measurements) -> Vec<(String, Set)> {
    measured.clips.iter().map(|clip| (clip.name().to_owned(), clip.set())).collect()
}

/// One table of scenes, and one of real clips in which each clip has a line of its own. On the sealed set all clips have.
fn tables(out: &mut String, table: &Table, multiplier: u32, sets: &[(String, Set)]) {
    let groups = table.groups(multiplier);
    let is_family = |group: &String| scenes::LANDSCAPES.iter().any(|family| family.name() == group);
    let moves = |group: &String| scenes::FAMILIES.iter().any(|family| *group == format!("moving-{family}"));
    let (means, others): (Vec<String>, Vec<String>) = groups.into_iter().partition(is_family);
    let (moving, single): (Vec<String>, Vec<String>) = others.into_iter().partition(moves);
    let (walks, films): (Vec<String>, Vec<String>) = single.into_iter().partition(|group| table.is_rendered(group));
    kind_by_kind(out, table, multiplier, sets, &means, "Scenes");
    kind_by_kind(out, table, multiplier, sets, &moving, "Scenes in which things move, under a head-up display,");
    clip_by_clip(out, table, multiplier, sets, &walks, "scenes");
    clip_by_clip(out, table, multiplier, sets, &films, "film and game");
}

/// A table with a column for each kind of scene, the mean over its clips.
fn kind_by_kind(
    out: &mut String,
    table: &Table,
    multiplier: u32,
    sets: &[(String, Set)],
    groups: &[String],
    what: &str,
) {
    if groups.is_empty() {
        return;
    }
    let clips: Vec<String> = groups.iter().flat_map(|group| table.clips(multiplier, group)).collect();
    _ = write!(out, "\n## {what} at {multiplier} times the anchors' rate\n\n{}| |", set_of(&clips, sets));
    for group in groups {
        let clips = table.clips(multiplier, group).len();
        _ = write!(out, " {group}{} |", if clips > 1 { format!(" ({clips})") } else { String::new() });
    }
    _ = write!(out, "\n|---|{}\n", "---|".repeat(groups.len()));
    for row in table.rows(multiplier) {
        let cells: Vec<String> = groups.iter().map(|group| cell(table, multiplier, group, row)).collect();
        _ = writeln!(out, "| {} | {} |", row.label(), cells.join(" | "));
    }
}

/// A table with a line for each clip and a column for each row of the comparison.
fn clip_by_clip(
    out: &mut String,
    table: &Table,
    multiplier: u32,
    sets: &[(String, Set)],
    groups: &[String],
    what: &str,
) {
    if groups.is_empty() {
        return;
    }
    let rows = table.rows(multiplier);
    let labels: Vec<&str> = rows.iter().map(|row| row.label()).collect();
    _ = write!(
        out,
        "\n## {} at {multiplier} times the anchors' rate\n\n{}| | {} |\n|---|{}\n",
        capital(what),
        set_of(groups, sets),
        labels.join(" | "),
        "---|".repeat(rows.len())
    );
    for group in groups {
        let cells: Vec<String> = rows.iter().map(|row| cell(table, multiplier, group, *row)).collect();
        _ = writeln!(out, "| {group} | {} |", cells.join(" | "));
    }
}

/// The sentence before a table that says which sets its clips are from; nothing if no set is known.
fn set_of(clips: &[String], sets: &[(String, Set)]) -> String {
    let mut found: Vec<Set> = sets.iter().filter(|(clip, _)| clips.contains(clip)).map(|(_, set)| *set).collect();
    found.sort();
    found.dedup();
    found.iter().map(|set| format!("From the {set} set: {}.\n", set.meaning())).collect::<String>()
        + if found.is_empty() { "" } else { "\n" }
}

/// The three values of a cell; the best of all rows is bold.
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
    let groups: Vec<String> = table.groups(2).into_iter().filter(|group| table.is_rendered(group)).collect();
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
    out.push_str("\n## The clips\n\n| clip | set | what it is | frames |\n|---|---|---|---|\n");
    for clip in &measured.clips {
        let frames: usize = clip.targets().iter().map(|target| target.phases().len()).sum();
        _ = writeln!(out, "| {} | {} | {} | {frames} |", clip.name(), clip.set(), clip.description());
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

fn method(out: &mut String, page: &Page<'_>) {
    let settings = page.settings;
    let Settings { rows, clips, lpips, .. } = settings;
    let seeds: Vec<String> = settings.seeds.iter().map(ToString::to_string).collect();
    let speed = if settings.speed { " --speed" } else { "" };
    const CONSTANTS: &str =
        "The constants of the generator and of `picture_flow` were tuned on seed 4 of the scenes alone.";
    let tuned = if let Some(opening) = page.opening {
        format!("{CONSTANTS} {}", earlier_openings(opening.number, settings.own_set.is_none()))
    } else if is_tuned(settings) {
        "The generator and `picture_flow` are tuned on seed 4 of the scenes, and seeds of the tuning set are among these.".into()
    } else {
        format!(
            "{CONSTANTS} The clips shown here are development sets: rules were kept or removed by their results, which were read \
             while the work went on."
        )
    };
    let which = if page.opening.is_some() { "--sealed".to_owned() } else { format!("--seeds {}", seeds.join(",")) };
    let frames = match page.opening {
        Some(_) => "no frame's score is kept in a file".to_owned(),
        None => format!("`{FRAMES}`, in the folder of the run, every frame"),
    };
    let summary = page.names().summary;
    _ = write!(
        out,
        "\n## How it was measured\n\nThis page was written by\n\n```sh\n\
         cargo run --release -p study -- quality {which} --rows {rows} --clips {clips} --lpips {lpips}{speed}\n```\n\n\
         - {tuned}\n\
         - PSNR over R, G and B; SSIM with a Gaussian window of 11x11, the mean of R, G and B; LPIPS v0.1 with the published \
         weights; all on 8-bit display values at full size.\n\
         - Frames of a clip are averaged first, then the clips of a kind of place; the unit of statistics is the clip. Equal \
         pictures count as 100 dB.\n\
         - `tools/study/sets.toml` names the sets. A real clip is a line of its own and is judged alone; a claim on a kind of scene is one on \
         the mean, and names the clips on which it does not hold.\n\
         - In ViZDoom without a player's view, pixels of the true frame that show things instead of the world are made equal in every row before it is \
         measured. Motion follows from depth and camera; the depth buffer's steps of 7 and 16 map units are refined by the \
         map's own lines and heights, and where the two contradict each other the buffer counts.\n\
         - `{summary}` beside this page holds every mean; {frames}.\n",
    );
}

/// The rules that changed after an opening of the repository's sealed set, by the number of the opening, with their commits. The changelog
/// has the figures that they were judged by.
const CHANGED_RULES: [(usize, &str); 3] = [
    (1, "the wide search of `picture_flow` (`fe2438cc`)"),
    (1, "the removal of three rules (`f06a00ac`)"),
    (2, "the test for static overlays (`d67434f1`)"),
];

/// What was known of the sealed clips before opening `number`.
fn earlier_openings(number: usize, is_repositorys: bool) -> String {
    let earlier: Vec<String> = (1..number).map(|n| n.to_string()).collect();
    let openings = match earlier.len() {
        0 => return "No result on the clips shown here was seen before.".into(),
        1 => "opening 1".to_owned(),
        _ => format!("openings {}", list(&earlier)),
    };
    let changed = |opening: usize| {
        let of = CHANGED_RULES.iter().filter(|(after, _)| *after == opening && is_repositorys);
        let rules: Vec<String> = of.map(|(_, rule)| (*rule).to_owned()).collect();
        (!rules.is_empty()).then(|| format!("after opening {opening} {}", list(&rules)))
    };
    let changes: Vec<String> = (1..number).filter_map(changed).collect();
    let mut out = format!("But the clips were not unseen: the results of {openings}, clip by clip, are in the ledger");
    if !changes.is_empty() {
        _ = write!(
            out,
            ", and rules changed after they were published: {}. These changes were judged on clips of the tuning and development sets",
            changes.join(", ")
        );
    }
    out + "."
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
            sealed: false,
            own_set: None,
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
        let page = Page { settings: &settings, table: &table, claims: &claims, speed: None, opening: None };
        let text = text(&page, &measured, Some("A place."));
        for part in [
            "](quality.png)",
            "## Scenes at 2 times",
            "| blend | 30.00 / 0.3000 / **0.1000** |",
            "| **Cairn**, `picture_flow` | **35.00** / **0.3500** / 0.2000 |",
            "## Film and game at 2 times",
            "| | blend | **Cairn**, `picture_flow` |\n|---|---|---|\n| bunny-bird | 31.00 / 0.3100 / – | – |\n",
            "0 of 1 claims held",
            "| **missed** | snow: cairn-flow beats blend",
            "- `rife`: no network",
            "quality --seeds 4,8 --rows all --clips all --lpips alex --speed\n",
            "work in progress",
        ] {
            assert!(text.contains(part), "{part} is not in\n{text}");
        }
    }

    #[test]
    fn the_sealed_page_says_which_rules_changed_after_its_results_were_known() {
        let page = include_str!("../../../../docs/quality-sealed.md");
        let (_, after) = page.split_once("This is opening ").unwrap();
        let number: usize = after.split(' ').next().unwrap().parse().unwrap();
        assert!(page.contains(&earlier_openings(number, true)), "{}", earlier_openings(number, true));
        assert!(number > 1 && !page.contains("No result"));
        assert_eq!(earlier_openings(1, true), "No result on the clips shown here was seen before.");
        assert!(
            earlier_openings(2, true)
                .contains("results of opening 1, clip by clip, are in the ledger, and rules changed")
        );
        assert!(!earlier_openings(2, true).contains("d67434f1") && earlier_openings(3, true).contains("d67434f1"));
        // Another set has another ledger.
        assert!(earlier_openings(3, false).ends_with("openings 1 and 2, clip by clip, are in the ledger."));
    }

    #[test]
    fn the_page_says_what_the_development_sets_were_used_for() {
        let page = include_str!("../../../../docs/quality.md");
        assert!(page.contains(LIMITS), "{LIMITS}");
        assert!(page.contains(&format!("From the development set: {}.", Set::Development.meaning())));
        let sealed = include_str!("../../../../docs/quality-sealed.md");
        assert!(sealed.contains(&format!("From the sealed set: {}.", Set::Sealed.meaning())));
        assert!(sealed.contains("ledger digest of `src/framegen` and `src/guidance`, tests and comments included, `"));
    }

    #[test]
    fn each_table_names_the_sets_of_its_clips() {
        let sets =
            [("snow-4".to_owned(), Set::Tuning), ("snow-5".into(), Set::Development), ("city".into(), Set::Sealed)];
        let of = |clips: &[&str]| set_of(&clips.iter().map(|clip| (*clip).to_owned()).collect::<Vec<_>>(), &sets);
        assert!(of(&["snow-4"]).starts_with("From the tuning set: "));
        let both = of(&["snow-5", "snow-4"]);
        assert!(
            both.contains("tuning set: ") && both.contains("\nFrom the development set: ") && both.ends_with("\n\n")
        );
        assert!(of(&["city"]).starts_with("From the sealed set: ") && of(&["other"]).is_empty());
    }
}
