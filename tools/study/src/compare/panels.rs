//! Frames of several streams in one picture, each under its name: for the report's figures and the side-by-side videos.

use std::path::Path;

use cairn::{Picture, Result};

use super::branch::Branch;
use super::plan::{Place, Settings};
use super::series::{RATE, STRIDE};
use super::truth::{FOLDER, frame};
use crate::manifest::read_bounded;
use crate::picture::{decode, shrink};
use crate::sheet::paste;
use crate::text::{SMALL, fit, write};

/// Height of a text line above tiles.
const LABEL: u32 = 24;
const GAP: u32 = 8;
/// Width of the text beside a row.
const SIDE: u32 = 64;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];
const DIM: [u8; 3] = [150, 154, 160];
/// Columns of the side-by-side video.
const ACROSS: u32 = 3;
/// Number of times shown on a contact sheet.
const MOMENTS: u64 = 6;
/// The largest frame, in bytes of its file.
const MAX_FRAME: u64 = 512 << 20;

/// A stream of frames of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shown {
    /// The renderer's frames.
    Truth,
    /// Frames of a branch.
    Branch(Branch),
}

impl Shown {
    /// Truth and all branches, in display order.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        std::iter::once(Self::Truth).chain(Branch::ALL.map(Self::Branch))
    }

    /// Name of the stream and of its folder.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Truth => FOLDER,
            Self::Branch(branch) => branch.name(),
        }
    }

    /// Frame of the stream at sample `number`.
    fn read(self, place: Place, number: u64, settings: &Settings) -> Result<Picture> {
        let step = match self {
            Self::Truth => 1,
            Self::Branch(branch) => u64::from(branch.point(place.family).presented_rate() / RATE).max(1),
        };
        read(&frame(&place.folder(&settings.out).join(self.name()), number * step))
    }
}

fn read(path: &Path) -> Result<Picture> {
    decode(&read_bounded(path, MAX_FRAME)?).map_err(|e| e.field(path.display().to_string()))
}

/// Size of a tile at most `width` wide, with the aspect of the compared frames; even, as video requires.
fn tile(settings: &Settings, width: u32) -> (u32, u32) {
    let [full, height] = settings.size;
    let width = full.min(width).max(16) & !1;
    (width, (u64::from(width) * u64::from(height) / u64::from(full)).max(16) as u32 & !1)
}

fn ground(width: u32, height: u32) -> Result<Picture> {
    let mut picture = Picture::new(width, height)?;
    picture.pixels_mut().iter_mut().for_each(|px| px[..3].copy_from_slice(&GROUND));
    Ok(picture)
}

fn seconds(look: u64) -> String {
    format!("{:.1} s", look as f64 / f64::from(RATE))
}

/// A grid with a column for each of `columns` and a row for each sample of `looks`, laid out like the paper's figures.
pub(super) fn grid(place: Place, columns: &[Shown], looks: &[u64], width: u32, settings: &Settings) -> Result<Picture> {
    let tile = tile(settings, width);
    let mut out = ground(SIDE + columns.len() as u32 * (tile.0 + GAP), LABEL + looks.len() as u32 * (tile.1 + GAP))?;
    for (column, x) in columns.iter().zip((SIDE..).step_by((tile.0 + GAP) as usize)) {
        write(&mut out, &fit(column.name(), tile.0, SMALL), (x, 4), SMALL, BRIGHT);
        for (&look, y) in looks.iter().zip((LABEL..).step_by((tile.1 + GAP) as usize)) {
            write(&mut out, &seconds(look), (4, y + 4), SMALL, DIM);
            paste(&mut out, &shrink(&column.read(place, look, settings)?, tile)?, (x, y));
        }
    }
    Ok(out)
}

/// Truth and all branches below each other, with a column for each of six of the `count` samples.
pub(super) fn sheet(place: Place, count: u64, settings: &Settings) -> Result<Picture> {
    let tile = tile(settings, 240);
    let side = 2 * SIDE + GAP;
    let rows: Vec<Shown> = Shown::all().collect();
    let mut out = ground(side + MOMENTS as u32 * (tile.0 + GAP), LABEL + rows.len() as u32 * (tile.1 + GAP))?;
    for (row, y) in rows.into_iter().zip((LABEL..).step_by((tile.1 + GAP) as usize)) {
        write(&mut out, &fit(row.name(), side - GAP, SMALL), (4, y + 4), SMALL, BRIGHT);
        for (moment, x) in (0..MOMENTS).zip((side..).step_by((tile.0 + GAP) as usize)) {
            let look = (count - 1) * moment / (MOMENTS - 1);
            if row == Shown::Truth {
                write(&mut out, &seconds(look), (x, 4), SMALL, DIM);
            }
            paste(&mut out, &shrink(&row.read(place, look, settings)?, tile)?, (x, y));
        }
    }
    Ok(out)
}

/// The seed pictures of `places`, side by side.
pub(super) fn seeds(places: &[Place], settings: &Settings) -> Result<Picture> {
    let tile = tile(&Settings { size: [1920, 1080], ..settings.clone() }, 300);
    let mut out = ground(places.len().max(1) as u32 * (tile.0 + GAP), LABEL + tile.1 + GAP)?;
    for (place, x) in places.iter().zip((GAP / 2..).step_by((tile.0 + GAP) as usize)) {
        write(&mut out, &fit(&place.to_string(), tile.0, SMALL), (x, 4), SMALL, BRIGHT);
        paste(&mut out, &shrink(&read(&place.seed_picture(&settings.out))?, tile)?, (x, LABEL));
    }
    Ok(out)
}

/// Draws all streams of a place at one time, for a video.
pub(super) struct SideBySide<'a> {
    place: Place,
    settings: &'a Settings,
    tile: (u32, u32),
}

impl<'a> SideBySide<'a> {
    pub(super) fn new(place: Place, settings: &'a Settings) -> Self {
        Self { place, settings, tile: tile(settings, 320) }
    }

    /// `(width, height)` of the drawing.
    pub(super) fn size(&self) -> (u32, u32) {
        let rows = (Shown::all().count() as u32).div_ceil(ACROSS);
        (ACROSS * self.tile.0, rows * (self.tile.1 + LABEL))
    }

    /// Draws sample `number` into `out`, which has that size.
    pub(super) fn draw(&self, number: u64, out: &mut Picture) -> Result<()> {
        out.pixels_mut().iter_mut().for_each(|px| px[..3].copy_from_slice(&GROUND));
        for (shown, n) in Shown::all().zip(0..) {
            let (x, y) = (n % ACROSS * self.tile.0, n / ACROSS * (self.tile.1 + LABEL));
            // Labels a generated frame differently from one of the world's own.
            let kind = match shown {
                Shown::Branch(Branch::Coherence | Branch::Heavy) if !number.is_multiple_of(STRIDE) => ", generated",
                Shown::Truth => "",
                Shown::Branch(_) => ", decoded",
            };
            let words = format!("{}{kind}", shown.name());
            write(out, &fit(&words, self.tile.0 - 72, SMALL), (x + 4, y + 4), SMALL, BRIGHT);
            if shown == Shown::Truth {
                write(out, &seconds(number), (x + self.tile.0 - 64, y + 4), SMALL, DIM);
            }
            let picture = shown.read(self.place, number, self.settings)?;
            paste(out, &shrink(&picture, self.tile)?, (x, y + LABEL));
        }
        Ok(())
    }
}
