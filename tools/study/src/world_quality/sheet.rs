//! Pictures of walks side by side.

use cairn::{Picture, Result};

use super::figures::WalkResult;
use crate::picture::{canvas, paste, shrink};
use crate::text::{SMALL, fit, write};

/// Number of walks on each sheet.
pub(super) const SHOWN: usize = 4;
const TILE: (u32, u32) = (240, 135);
const GAP: u32 = 8;
const LEFT: u32 = 160;
const TOP: u32 = 32;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];

/// Sheet with a column per horizon and two rows per walk, truth above the world's pictures, in the given order.
pub(super) fn draw(results: &[&WalkResult]) -> Result<Picture> {
    let columns = results.iter().map(|p| p.shown.len()).max().unwrap_or(0).max(1) as u32;
    let rows = 2 * results.len().max(1) as u32;
    let mut sheet = canvas((LEFT + columns * (TILE.0 + GAP) + GAP, TOP + rows * (TILE.1 + GAP)), GROUND)?;
    for (result, row) in results.iter().zip((0..).step_by(2)) {
        let y = |row: u32| TOP + row * (TILE.1 + GAP);
        for (n, line) in [result.place.to_string(), "truth".into()].iter().enumerate() {
            write(&mut sheet, &fit(line, LEFT - 24, SMALL), (16, y(row) + 4 + 18 * n as u32), SMALL, BRIGHT);
        }
        write(&mut sheet, "world", (16, y(row + 1) + 4), SMALL, BRIGHT);
        let horizons = result.walked.horizons.iter().zip(&result.shown);
        for ((h, [truth, picture]), column) in horizons.zip(0..) {
            let x = LEFT + column * (TILE.0 + GAP);
            if row == 0 {
                write(&mut sheet, &format!("{} s", h.seconds), (x, 8), SMALL, BRIGHT);
            }
            paste(&mut sheet, &shrink(truth, TILE)?, (x, y(row)));
            paste(&mut sheet, &shrink(picture, TILE)?, (x, y(row + 1)));
        }
    }
    Ok(sheet)
}
