//! Frames of several streams in one picture, each under its name: for the report's figures and the side-by-side videos.

use std::path::Path;

use cairn::{Picture, Result};

use super::branch::Branch;
use super::paths::{TRUTH, frame};
use super::plan::Settings;
use super::walk::{RATE, STRIDE};
use crate::manifest::read_bounded;
use crate::picture::{canvas, decode, paste, shrink};
use crate::scene_id::SceneId;
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
/// Number of moments on a contact sheet.
const MOMENTS: u64 = 6;
/// The largest frame, in bytes of its file.
const MAX_FRAME: u64 = 512 << 20;

/// A stream of frames of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StreamId {
    /// The renderer's frames.
    Truth,
    /// Frames of a branch.
    Branch(Branch),
}

impl StreamId {
    /// Truth and all branches, in display order.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        std::iter::once(Self::Truth).chain(Branch::ALL.map(Self::Branch))
    }

    /// Name of the stream and of its folder.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Truth => TRUTH,
            Self::Branch(branch) => branch.name(),
        }
    }

    /// Frame of the stream at sample `number`.
    fn read(self, scene: SceneId, number: u64, settings: &Settings) -> Result<Picture> {
        let step = match self {
            Self::Truth => 1,
            Self::Branch(branch) => u64::from(branch.point(scene.family).presented_rate() / RATE).max(1),
        };
        read(&frame(&scene.folder(&settings.out).join(self.name()), number * step))
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

fn seconds(sample: u64) -> String {
    format!("{:.1} s", sample as f64 / f64::from(RATE))
}

/// A grid with a column for each of `columns` and a row for each sample of `samples`, laid out like the paper's figures.
pub(super) fn grid(
    scene: SceneId,
    columns: &[StreamId],
    samples: &[u64],
    width: u32,
    settings: &Settings,
) -> Result<Picture> {
    let tile = tile(settings, width);
    let mut out =
        canvas((SIDE + columns.len() as u32 * (tile.0 + GAP), LABEL + samples.len() as u32 * (tile.1 + GAP)), GROUND)?;
    for (column, x) in columns.iter().zip((SIDE..).step_by((tile.0 + GAP) as usize)) {
        write(&mut out, &fit(column.name(), tile.0, SMALL), (x, 4), SMALL, BRIGHT);
        for (&sample, y) in samples.iter().zip((LABEL..).step_by((tile.1 + GAP) as usize)) {
            write(&mut out, &seconds(sample), (4, y + 4), SMALL, DIM);
            paste(&mut out, &shrink(&column.read(scene, sample, settings)?, tile)?, (x, y));
        }
    }
    Ok(out)
}

/// Truth and all branches below each other, with a column for each of six of the `count` samples.
pub(super) fn sheet(scene: SceneId, count: u64, settings: &Settings) -> Result<Picture> {
    let tile = tile(settings, 240);
    let side = 2 * SIDE + GAP;
    let rows: Vec<StreamId> = StreamId::all().collect();
    let mut out = canvas((side + MOMENTS as u32 * (tile.0 + GAP), LABEL + rows.len() as u32 * (tile.1 + GAP)), GROUND)?;
    for (row, y) in rows.into_iter().zip((LABEL..).step_by((tile.1 + GAP) as usize)) {
        write(&mut out, &fit(row.name(), side - GAP, SMALL), (4, y + 4), SMALL, BRIGHT);
        for (moment, x) in (0..MOMENTS).zip((side..).step_by((tile.0 + GAP) as usize)) {
            let sample = (count - 1) * moment / (MOMENTS - 1);
            if row == StreamId::Truth {
                write(&mut out, &seconds(sample), (x, 4), SMALL, DIM);
            }
            paste(&mut out, &shrink(&row.read(scene, sample, settings)?, tile)?, (x, y));
        }
    }
    Ok(out)
}

/// The seed pictures of `scenes`, side by side.
pub(super) fn seeds(scenes: &[SceneId], settings: &Settings) -> Result<Picture> {
    let tile = tile(&Settings { size: [1920, 1080], ..settings.clone() }, 300);
    let mut out = canvas((scenes.len().max(1) as u32 * (tile.0 + GAP), LABEL + tile.1 + GAP), GROUND)?;
    for (scene, x) in scenes.iter().zip((GAP / 2..).step_by((tile.0 + GAP) as usize)) {
        write(&mut out, &fit(&scene.to_string(), tile.0, SMALL), (x, 4), SMALL, BRIGHT);
        paste(&mut out, &shrink(&read(&scene.seed_picture(&settings.out))?, tile)?, (x, LABEL));
    }
    Ok(out)
}

/// Draws all streams of a scene at one time, for a video.
pub(super) struct SideBySide<'a> {
    scene: SceneId,
    settings: &'a Settings,
    tile: (u32, u32),
}

impl<'a> SideBySide<'a> {
    pub(super) fn new(scene: SceneId, settings: &'a Settings) -> Self {
        Self { scene, settings, tile: tile(settings, 320) }
    }

    /// `(width, height)` of the drawing.
    pub(super) fn size(&self) -> (u32, u32) {
        let rows = (StreamId::all().count() as u32).div_ceil(ACROSS);
        (ACROSS * self.tile.0, rows * (self.tile.1 + LABEL))
    }

    /// Draws sample `number` into `out`, which has that size.
    pub(super) fn draw(&self, number: u64, out: &mut Picture) -> Result<()> {
        out.pixels_mut().iter_mut().for_each(|px| px[..3].copy_from_slice(&GROUND));
        for (shown, n) in StreamId::all().zip(0..) {
            let (x, y) = (n % ACROSS * self.tile.0, n / ACROSS * (self.tile.1 + LABEL));
            // Labels a generated frame differently from one of the world's own.
            let kind = match shown {
                StreamId::Branch(Branch::Coherence | Branch::CoherenceBest | Branch::Heavy)
                    if !number.is_multiple_of(STRIDE) =>
                {
                    ", generated"
                }
                StreamId::Truth => "",
                StreamId::Branch(_) => ", decoded",
            };
            let words = format!("{}{kind}", shown.name());
            write(out, &fit(&words, self.tile.0 - 72, SMALL), (x + 4, y + 4), SMALL, BRIGHT);
            if shown == StreamId::Truth {
                write(out, &seconds(number), (x + self.tile.0 - 64, y + 4), SMALL, DIM);
            }
            let picture = shown.read(self.scene, number, self.settings)?;
            paste(out, &shrink(&picture, self.tile)?, (x, y + LABEL));
        }
        Ok(())
    }
}
