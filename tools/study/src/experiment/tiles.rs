//! A figure of labelled rows of pictures.

use cairn::{Picture, Result};

use crate::picture::{canvas, paste, shrink};
use crate::text::{SMALL, fit, write};

/// Height of the line of column labels.
pub(crate) const TOP: u32 = 32;
const BACKGROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];

/// Sizes of a figure in pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layout {
    /// Size of one picture.
    pub(crate) tile: (u32, u32),
    /// Space to the right of each picture and below it.
    pub(crate) gap: u32,
    /// Width of the row labels.
    pub(crate) left: u32,
}

/// A figure that is being drawn.
pub(crate) struct Tiles {
    layout: Layout,
    out: Picture,
}

impl Tiles {
    /// A figure without rows; `columns` are the labels above them.
    ///
    /// # Errors
    /// `OutOfMemory`.
    pub(crate) fn new(layout: Layout, columns: &[String], rows: u32) -> Result<Self> {
        let Layout { tile, gap, left } = layout;
        let size = (left + columns.len() as u32 * (tile.0 + gap), TOP + rows * (tile.1 + gap));
        let mut out = canvas(size, BACKGROUND)?;
        for (label, column) in columns.iter().zip(0..) {
            write(&mut out, label, (left + column * (tile.0 + gap), 8), SMALL, BRIGHT);
        }
        Ok(Self { layout, out })
    }

    /// Draws row number `row` with its label, from left to right.
    ///
    /// # Errors
    /// As [`shrink`].
    pub(crate) fn row<'p>(
        &mut self,
        row: u32,
        label: &str,
        pictures: impl IntoIterator<Item = &'p Picture>,
    ) -> Result<()> {
        let Layout { tile, gap, left } = self.layout;
        let y = TOP + row * (tile.1 + gap);
        write(&mut self.out, &fit(label, left - 24, SMALL), (16, y + 4), SMALL, BRIGHT);
        for (picture, column) in pictures.into_iter().zip(0..) {
            paste(&mut self.out, &shrink(picture, tile)?, (left + column * (tile.0 + gap), y));
        }
        Ok(())
    }

    /// The figure.
    pub(crate) fn finish(self) -> Picture {
        self.out
    }
}
