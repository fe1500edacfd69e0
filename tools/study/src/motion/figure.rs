//! Figure of one interval for every source: its motion, the frame generated with it, and that frame's error.
//!
//! The interval is selected automatically: one scored frame in ten is harder to blend.

use cairn::guidance::visual;
use cairn::{Picture, Result};

use super::measure::{Anchors, Place, Record, Shown};
use super::sources::{Motion, ROWS};
use crate::picture::{put, shrink};
use crate::text::{SMALL, fit, write};

const TILE: (u32, u32) = (240, 135);
const GAP: u32 = 8;
const LEFT: u32 = 160;
const TOP: u32 = 32;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];
/// Factor by which the error is brightened.
const ERROR_GAIN: u16 = 4;
/// Number of scored frames out of ten that are easier than the selected one.
const EASIER_OF_TEN: usize = 9;

/// Place and anchor of the selected frame: one scored frame in ten is harder to blend.
pub(super) fn hard(records: &[Record]) -> Option<(Place, u64)> {
    let blended = records.iter().filter(|r| r.row == ROWS[0] && r.anchors == Anchors::Drawn);
    let mut frames: Vec<(f64, Place, u64)> =
        blended.map(|r| (r.score.lpips.unwrap_or(-r.score.psnr), r.place, r.anchor)).collect();
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = (frames.len() * EASIER_OF_TEN / 10).min(frames.len().checked_sub(1)?);
    frames.get(at).map(|(_, place, anchor)| (*place, *anchor))
}

/// Caption of the figure.
pub(super) fn caption(shown: &Shown) -> String {
    format!(
        "{} {}, between anchors {} and {}. Left, motion back to the anchor before: its direction as colour, full from {} pixels on \
         (red points right, cyan left). Then the frame made with it, and its error, {ERROR_GAIN} times as bright as it is: black is right. \
         Nobody chose it by eye: of the scored frames one in ten is harder to blend.",
        shown.place.family,
        shown.place.seed,
        shown.anchor - 1,
        shown.anchor,
        full_scale(shown).round()
    )
}

/// The motion length shown in full colour: the 90th percentile of the true motion.
fn full_scale(shown: &Shown) -> f32 {
    let truth = shown.rows.iter().find(|(motion, ..)| *motion == Motion::Truth);
    let mut lengths: Vec<f32> = truth
        .iter()
        .flat_map(|(_, field, _)| field.vectors().iter().map(|[x, y]| x.to_f32().hypot(y.to_f32())))
        .filter(|length| length.is_finite())
        .collect();
    lengths.sort_by(f32::total_cmp);
    lengths.get(lengths.len() * 9 / 10).copied().unwrap_or(1.0).max(1.0)
}

/// Draws the figure: a row for each source.
pub(super) fn draw(shown: &Shown) -> Result<Picture> {
    let rows = shown.rows.len() as u32;
    let mut out = Picture::new(LEFT + 3 * (TILE.0 + GAP), TOP + rows * (TILE.1 + GAP))?;
    out.pixels_mut().fill([GROUND[0], GROUND[1], GROUND[2], 255]);
    for (n, label) in ["motion", "frame", "error"].into_iter().enumerate() {
        write(&mut out, label, (LEFT + n as u32 * (TILE.0 + GAP), 8), SMALL, BRIGHT);
    }
    let scale = full_scale(shown);
    for ((motion, field, made), row) in shown.rows.iter().zip(0..) {
        let y = TOP + row * (TILE.1 + GAP);
        write(&mut out, &fit(motion.name(), LEFT - 24, SMALL), (16, y + 4), SMALL, BRIGHT);
        let mut wheel = made.clone();
        visual::motion(field, scale, &mut wheel)?;
        let mut error = shown.truth.clone();
        for ((out, a), b) in error.pixels_mut().iter_mut().zip(shown.truth.pixels()).zip(made.pixels()) {
            for i in 0..3 {
                out[i] = (u16::from(a[i].abs_diff(b[i])) * ERROR_GAIN).min(255) as u8;
            }
        }
        for (picture, column) in [&wheel, made, &error].into_iter().zip(0..) {
            put(&mut out, &shrink(picture, TILE)?, (LEFT + column * (TILE.0 + GAP), y));
        }
    }
    Ok(out)
}
