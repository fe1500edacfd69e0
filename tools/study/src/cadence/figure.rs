//! Figure of one interval from 10 to 60 frames a second: true frames above generated ones, for the renderer's anchors and the world's own.

use cairn::{Picture, Result};

use super::measure::{Source, Strip};
use crate::motion::Place;
use crate::picture::{put, shrink};
use crate::text::{SMALL, fit, write};

const TILE: (u32, u32) = (160, 90);
const GAP: u32 = 6;
const LEFT: u32 = 128;
const TOP: u32 = 32;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];

/// Caption of the figure.
pub(super) fn caption(place: Place) -> String {
    format!(
        "{} {}: the first interval that was scored. Left and right are the anchors; between them, above what is true and below what \
         was made of the anchors, with motion from pictures.",
        place.family, place.seed
    )
}

/// Draws the strips, two rows each.
pub(super) fn draw(strips: &[Strip]) -> Result<Picture> {
    let columns = strips.iter().map(|strip| strip.truth.len()).max().unwrap_or(0).max(1) as u32;
    let rows = 2 * strips.len().max(1) as u32;
    let mut out = Picture::new(LEFT + columns * (TILE.0 + GAP), TOP + rows * (TILE.1 + GAP))?;
    out.pixels_mut().fill([GROUND[0], GROUND[1], GROUND[2], 255]);
    for n in 0..columns {
        let label = match n {
            0 => "anchor".into(),
            n if n + 1 == columns => "next anchor".into(),
            n => format!("{n}/{}", columns - 1),
        };
        write(&mut out, &label, (LEFT + n * (TILE.0 + GAP), 8), SMALL, BRIGHT);
    }
    for (strip, first) in strips.iter().zip((0..).step_by(2)) {
        let names = match strip.source {
            Source::Drawn => ["renderer", "made"],
            Source::World => ["decoder", "made"],
        };
        for ((pictures, name), row) in [&strip.truth, &strip.made].into_iter().zip(names).zip(first..) {
            let y = TOP + row * (TILE.1 + GAP);
            write(&mut out, &fit(name, LEFT - 24, SMALL), (16, y + 4), SMALL, BRIGHT);
            for (picture, column) in pictures.iter().zip(0..) {
                put(&mut out, &shrink(picture, TILE)?, (LEFT + column * (TILE.0 + GAP), y));
            }
        }
    }
    Ok(out)
}
