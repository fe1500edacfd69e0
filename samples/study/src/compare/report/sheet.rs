//! The contact sheet of a place: truth and branches below each other, a column for each moment (the paper's Figures 3 to 5).

use cairn::{Picture, Result};

use super::super::branch::Branch;
use super::super::plan::{Place, Settings};
use super::super::series::RATE;
use super::super::truth::{FOLDER, frame};
use crate::manifest::read_bounded;
use crate::picture::{decode, shrink};
use crate::sheet::paste;
use crate::text::{SMALL, fit, write};

/// Moments, evenly from the first to the last.
const COLUMNS: u64 = 6;
const TILE: (u32, u32) = (240, 135);
const GAP: u32 = 8;
const LEFT: u32 = 152;
const TOP: u32 = 32;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];
/// The largest frame, in bytes of its file.
const MAX_FRAME: u64 = 512 << 20;

/// Draws the sheet of a place with `count` looks.
///
/// # Errors
/// `Io` for a frame that is not there; `OutOfMemory`.
pub(in crate::compare) fn sheet(place: Place, count: u64, settings: &Settings) -> Result<Picture> {
    let folder = place.folder(&settings.out);
    let truth = (FOLDER, 1);
    let branches =
        Branch::ALL.map(|branch| (branch.name(), u64::from(branch.point(place.family).presented_rate() / RATE).max(1)));
    let rows: Vec<(&str, u64)> = std::iter::once(truth).chain(branches).collect();
    let width = LEFT + COLUMNS as u32 * (TILE.0 + GAP);
    let mut sheet = Picture::new(width, TOP + rows.len() as u32 * (TILE.1 + GAP))?;
    sheet.pixels_mut().iter_mut().for_each(|px| px[..3].copy_from_slice(&GROUND));
    for ((name, step), row) in rows.into_iter().zip(0..) {
        let y = TOP + row * (TILE.1 + GAP);
        write(&mut sheet, &fit(name, LEFT - 20, SMALL), (12, y + 4), SMALL, BRIGHT);
        for column in 0..COLUMNS {
            let look = (count - 1) * column / (COLUMNS - 1);
            let x = LEFT + column as u32 * (TILE.0 + GAP);
            if row == 0 {
                let label = format!("{:.1} s", look as f64 / f64::from(RATE));
                write(&mut sheet, &label, (x, 8), SMALL, BRIGHT);
            }
            let path = frame(&folder.join(name), look * step);
            let picture = decode(&read_bounded(&path, MAX_FRAME)?).map_err(|e| e.field(path.display().to_string()))?;
            paste(&mut sheet, &shrink(&picture, TILE)?, (x, y));
        }
    }
    Ok(sheet)
}
