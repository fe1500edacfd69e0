//! Documents: blocks, shown as Markdown, which is also what the program prints, and as one HTML page.

mod page;

use std::path::{Path, PathBuf};

use cairn::Result;

use crate::media::{RealDisk, describe_io, encode_jpeg, write_whole};
use crate::table::Table;

pub(crate) use page::escaped;

/// The longest line of a paragraph.
const LINE: usize = 120;

/// A part of a document.
pub(crate) enum Block {
    /// With the word that links to it lead.
    Heading(String),
    Text(String),
    Table(Table),
    /// A picture or a drawing of a file of its own, beside the document.
    Figure {
        file: Asset,
        /// What it shows.
        words: String,
    },
    /// A video, of which the page alone has the player.
    Player {
        words: String,
        video: Vec<u8>,
        /// Frames a second.
        rate: u32,
    },
}

/// A file beside the document, which the page has inside.
#[derive(Clone)]
pub(crate) struct Asset {
    /// Where it lies from the document.
    pub(crate) path: String,
    pub(crate) bytes: Vec<u8>,
}

impl Asset {
    /// A picture.
    pub(crate) fn jpeg(name: &str, picture: &cairn::Picture) -> Result<Self> {
        Ok(Self { path: format!("{FIGURES}/{name}.jpg"), bytes: encode_jpeg(picture)? })
    }

    /// A drawing.
    pub(crate) fn svg(name: &str, svg: String) -> Self {
        Self { path: format!("{FIGURES}/{name}.svg"), bytes: svg.into_bytes() }
    }

    fn is_svg(&self) -> bool {
        self.path.ends_with(".svg")
    }
}

/// The folder of those files.
const FIGURES: &str = "figures";

impl Block {
    pub(crate) fn heading(words: impl Into<String>) -> Self {
        Self::Heading(words.into())
    }

    pub(crate) fn text(words: impl Into<String>) -> Self {
        Self::Text(words.into())
    }

    pub(crate) fn figure(file: Asset, words: impl Into<String>) -> Self {
        Self::Figure { file, words: words.into() }
    }

    fn markdown(&self) -> String {
        match self {
            Self::Heading(words) => format!("\n## {words}\n"),
            Self::Text(words) => format!("\n{}", wrapped(words)),
            Self::Table(table) => format!("\n{}", table.markdown()),
            Self::Figure { file, words } => format!("\n![{words}]({})\n\n{}", file.path, wrapped(words)),
            Self::Player { words, .. } => format!("\n{}", wrapped(&format!("{words} It plays in the page."))),
        }
    }
}

/// A document in both forms, and the files beside it.
pub(crate) struct Document {
    pub(crate) markdown: String,
    pub(crate) html: String,
    pub(crate) assets: Vec<Asset>,
}

impl Document {
    /// Puts `blocks` together.
    pub(crate) fn new(title: &str, blocks: &[Block]) -> Self {
        let assets = blocks.iter().filter_map(|block| match block {
            Block::Figure { file, .. } => Some(file.clone()),
            _ => None,
        });
        Self {
            markdown: format!("# {title}\n{}", blocks.iter().map(Block::markdown).collect::<String>()),
            html: page::page(title, blocks),
            assets: assets.collect(),
        }
    }

    /// Writes it into `folder` as `NAME.md` and `NAME.html`, with what it has beside it; what was written.
    ///
    /// # Errors
    /// `Io`.
    pub(crate) fn write(&self, folder: &Path, name: &str) -> Result<Vec<PathBuf>> {
        let figures = folder.join(FIGURES);
        std::fs::create_dir_all(&figures).map_err(|e| describe_io("cannot be made", &figures, &e))?;
        let texts = [(format!("{name}.md"), self.markdown.as_bytes()), (format!("{name}.html"), self.html.as_bytes())];
        let all = texts.into_iter().chain(self.assets.iter().map(|asset| (asset.path.clone(), &asset.bytes[..])));
        all.map(|(name, bytes)| {
            let path = folder.join(name);
            write_whole(&RealDisk, &path, bytes)?;
            Ok(path)
        })
        .collect()
    }
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
