//! The report: blocks, shown as Markdown, which is also what the program prints, and as one HTML page.

mod claims;
mod costs;
mod curves;
mod measured;
mod page;
mod paper;
mod sheet;
mod table;

use cairn::Result;
use cairn::bundle::Bundle;

use super::branch::Branch;
use super::budget::Budget;
use super::make::Made;
use super::plan::Settings;
use super::score::Scored;
use super::series::Column;
pub(super) use sheet::sheet;
use table::Table;

/// The longest line of a paragraph.
const LINE: usize = 120;

/// A part of the report.
enum Block {
    Heading(String),
    Text(String),
    Table(Table),
    /// A picture.
    Picture {
        /// Where it lies from the report.
        path: String,
        /// What it shows.
        words: String,
        /// The file.
        png: Vec<u8>,
    },
    /// Curves or bars; the page alone shows them.
    Curves {
        /// What they show.
        words: String,
        /// The drawing.
        svg: String,
    },
}

impl Block {
    fn heading(words: impl Into<String>) -> Self {
        Self::Heading(words.into())
    }

    fn text(words: impl Into<String>) -> Self {
        Self::Text(words.into())
    }

    fn markdown(&self) -> String {
        match self {
            Self::Heading(words) => format!("\n## {words}\n"),
            Self::Text(words) => format!("\n{}", wrapped(words)),
            Self::Table(table) => format!("\n{}", table.markdown()),
            Self::Picture { path, words, .. } => format!("\n![{words}]({path})\n"),
            Self::Curves { .. } => String::new(),
        }
    }
}

/// The name of a place's contact sheet in its folder.
pub(super) const SHEET: &str = "sheet.png";

/// The report in both forms.
pub(super) struct Report {
    pub(super) markdown: String,
    pub(super) html: String,
}

/// Everything that was found; `sheets` are the contact sheets of the places, as PNG files.
///
/// # Errors
/// `InvalidArgument` for settings that were never checked.
pub(super) fn report(
    settings: &Settings,
    bundle: &Bundle,
    made: &Made,
    budgets: &[Budget],
    scored: &[Scored],
    sheets: Vec<Vec<u8>>,
) -> Result<Report> {
    let random = bundle.manifest().provenance.get("weights").is_some_and(|weights| weights.starts_with("random"));
    let mut blocks = head(settings, bundle, made, random);
    blocks.push(Block::heading("What the paper claims"));
    let verdicts = claims::verdicts(settings, scored, random)?;
    blocks.push(Block::Table(Table::new(3, &["claim", "scenes", "here"], verdicts)));
    blocks.push(Block::text(
        "A scene counts for a claim where the 95 % interval of its places lies on one side, or, with one place, by its sign \
         alone. Another world, other pictures and another frame generator than the paper's: what holds here supports the \
         paper's strategy, and neither confirms nor refutes its figures.",
    ));
    blocks.extend(measured::all(settings, scored));
    blocks.extend(costs::operating_points(settings));
    blocks.extend(costs::machine(made));
    blocks.extend(costs::costs(made, budgets));
    blocks.push(Block::heading("Places (Figures 3 to 6 and S1)"));
    for (scored, png) in scored.iter().zip(sheets) {
        let place = scored.place;
        let path = format!("{}-{}/{SHEET}", place.family, place.seed);
        blocks.push(Block::Picture { path, words: format!("{place}: truth and branches"), png });
        for (column, what) in [
            (Column::Lpips, "LPIPS to the truth, lower is nearer"),
            (Column::AdjacentLpips, "LPIPS from frame to frame; the truth's own is the mark"),
        ] {
            let svg = curves::curves(&scored.series, column);
            if !svg.is_empty() {
                blocks.push(Block::Curves { words: format!("{place}: {what}"), svg });
            }
        }
    }
    let markdown: String = blocks.iter().map(Block::markdown).collect();
    Ok(Report { markdown: format!("# {TITLE}\n{markdown}"), html: page::page(TITLE, &blocks) })
}

const TITLE: &str = "Fewer and better anchors, or more frames";

fn head(settings: &Settings, bundle: &Bundle, made: &Made, random: bool) -> Vec<Block> {
    let scenes: Vec<&str> = settings.scenes.iter().map(|family| family.name()).collect();
    let [width, height] = settings.size;
    let places = if settings.places == 1 { "one place".to_owned() } else { format!("{} places", settings.places) };
    let mut blocks = vec![Block::text(format!(
        "{}: {}, {places} of each, {} s in {} branches, compared at {width}x{height}. {} rollouts, {} of them kept from before.",
        bundle.manifest().name,
        scenes.join(", "),
        settings.seconds,
        Branch::ALL.len(),
        made.cells.len() + made.straight.len(),
        made.kept
    ))];
    if random {
        blocks.push(Block::text("**This world has random weights: its pictures mean nothing.**"));
    }
    blocks
}

/// A paragraph in lines of at most [`LINE`] characters.
fn wrapped(words: &str) -> String {
    let (mut text, mut length) = (String::new(), 0);
    for word in words.split_whitespace() {
        let long = word.chars().count();
        if length > 0 {
            let fits = length + 1 + long <= LINE;
            text.push(if fits { ' ' } else { '\n' });
            length = if fits { length + 1 } else { 0 };
        }
        text += word;
        length += long;
    }
    text + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paragraphs_are_wrapped_between_words() {
        let text = wrapped(&"word ".repeat(60));
        assert!(text.lines().count() == 3 && text.lines().all(|line| line.chars().count() <= LINE), "{text}");
        assert_eq!(text.split_whitespace().count(), 60);
        assert_eq!(wrapped("one"), "one\n");
    }
}
