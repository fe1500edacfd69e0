//! Documents: lists of blocks, rendered as Markdown (which the program also prints) and as one HTML page.

mod page;

use std::path::{Path, PathBuf};

use cairn::Result;

use crate::experiment::provenance::stamped_with;
use crate::manifest::Manifest;
use crate::table::Table;
use media::{JpegQuality, RealDisk, describe_io, encode_jpeg, write_whole};

pub(crate) use page::escaped;

/// Maximum line length of a paragraph.
const LINE: usize = 120;

/// A part of a document.
pub(crate) enum Block {
    /// Also an anchor that links can name.
    Heading(String),
    Text(String),
    Table(Table),
    /// A picture or drawing in a file beside the document.
    Figure {
        file: Asset,
        /// Caption.
        words: String,
    },
    /// A video; only the HTML page has a player for it.
    Player {
        words: String,
        video: Vec<u8>,
        /// Frames a second.
        rate: u32,
    },
}

/// A file beside the Markdown document, embedded in the HTML page.
#[derive(Clone)]
pub(crate) struct Asset {
    /// Path relative to the document.
    pub(crate) path: String,
    pub(crate) bytes: Vec<u8>,
    /// The same, compressed for a repository; `None` if `bytes` are small.
    pub(crate) compressed: Option<Vec<u8>>,
}

impl Asset {
    /// A picture, as JPEG.
    pub(crate) fn jpeg(name: &str, picture: &cairn::Picture) -> Result<Self> {
        let [bytes, compressed] =
            [JpegQuality::Page, JpegQuality::Repository].map(|quality| encode_jpeg(picture, quality));
        Ok(Self { path: format!("{FIGURES}/{name}.jpg"), bytes: bytes?, compressed: Some(compressed?) })
    }

    /// A drawing, as SVG.
    pub(crate) fn svg(name: &str, svg: String) -> Self {
        Self { path: format!("{FIGURES}/{name}.svg"), bytes: svg.into_bytes(), compressed: None }
    }

    fn is_svg(&self) -> bool {
        self.path.ends_with(".svg")
    }
}

/// Folder of the assets.
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

/// A document in both forms, and its assets.
pub(crate) struct Document {
    pub(crate) markdown: String,
    pub(crate) html: String,
    pub(crate) assets: Vec<Asset>,
}

impl Document {
    /// Renders `blocks`.
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

    /// The same, with the commits, generators and worlds of the rollouts that it shows [stated](stamped_with) in the Markdown.
    pub(crate) fn stamped<'a>(self, rollouts: impl IntoIterator<Item = &'a Manifest>) -> Self {
        let source = |manifest: &'a Manifest| (&manifest.versions.source, Some(manifest.inputs.world.sha256.as_str()));
        let sources = rollouts.into_iter().map(source);
        Self { markdown: stamped_with(&self.markdown, sources), ..self }
    }

    /// Writes `NAME.md`, `NAME.html` and the assets into `folder`. Returns the written files.
    ///
    /// # Errors
    /// `Io`.
    pub(crate) fn write(&self, folder: &Path, name: &str) -> Result<Vec<PathBuf>> {
        let texts = [(format!("{name}.md"), self.markdown.as_bytes()), (format!("{name}.html"), self.html.as_bytes())];
        write_files(
            folder,
            texts.into_iter().chain(self.assets.iter().map(|asset| (asset.path.clone(), &asset.bytes[..]))),
        )
    }

    /// Writes `NAME.md` and the compressed assets into `folder`, without the page. Returns the written files.
    ///
    /// # Errors
    /// `Io`.
    pub(crate) fn write_compressed(&self, folder: &Path, name: &str) -> Result<Vec<PathBuf>> {
        let assets = self.assets.iter().map(|asset| {
            let bytes = asset.compressed.as_deref().unwrap_or(&asset.bytes);
            (asset.path.clone(), bytes)
        });
        write_files(folder, std::iter::once((format!("{name}.md"), self.markdown.as_bytes())).chain(assets))
    }
}

/// Writes files by their paths below `folder`, and makes the folder of the assets.
fn write_files<'a>(folder: &Path, files: impl Iterator<Item = (String, &'a [u8])>) -> Result<Vec<PathBuf>> {
    let figures = folder.join(FIGURES);
    std::fs::create_dir_all(&figures).map_err(|e| describe_io("cannot be made", &figures, &e))?;
    let write = |(name, bytes): (String, &[u8])| {
        let path = folder.join(name);
        write_whole(&RealDisk, &path, bytes)?;
        Ok(path)
    };
    files.map(write).collect()
}

/// Wraps a paragraph at [`LINE`] characters.
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
