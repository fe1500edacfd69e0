//! Figure of one interval for every source: its motion, the frame generated with it, and that frame's error.
//!
//! The interval is selected automatically: one scored frame in ten is harder to blend.

use cairn::guidance::visual;
use cairn::{Picture, Result};

use super::measure::{Anchors, IntervalPictures, Record};
use super::sources::{Motion, ROWS};
use crate::experiment::tiles::{Layout, Tiles};
use crate::scene_id::SceneId;

const LAYOUT: Layout = Layout { tile: (240, 135), gap: 8, left: 160 };
/// Factor by which the error is brightened.
const ERROR_GAIN: u16 = 4;
/// Number of scored frames out of ten that are easier than the selected one.
const EASIER_OF_TEN: usize = 9;

/// Scene and anchor of the selected frame: one scored frame in ten is harder to blend.
pub(super) fn hard_frame(records: &[Record]) -> Option<(SceneId, u64)> {
    let blended = records.iter().filter(|r| r.row == ROWS[0] && r.anchors == Anchors::Drawn);
    let mut frames: Vec<(f64, SceneId, u64)> =
        blended.map(|r| (r.score.lpips.unwrap_or(-r.score.psnr), r.scene, r.anchor)).collect();
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = (frames.len() * EASIER_OF_TEN / 10).min(frames.len().checked_sub(1)?);
    frames.get(at).map(|(_, scene, anchor)| (*scene, *anchor))
}

/// Caption of the figure.
pub(super) fn caption(interval: &IntervalPictures) -> String {
    format!(
        "{} {}, between anchors {} and {}. Left, motion back to the anchor before: its direction as colour, full from {} pixels on \
         (red points right, cyan left). Then the frame made with it, and its error, {ERROR_GAIN} times as bright as it is: black is right. \
         Nobody chose it by eye: of the scored frames one in ten is harder to blend.",
        interval.scene.family,
        interval.scene.seed,
        interval.anchor - 1,
        interval.anchor,
        full_scale(interval).round()
    )
}

/// The motion length shown in full colour: the 90th percentile of the true motion.
fn full_scale(interval: &IntervalPictures) -> f32 {
    let truth = interval.rows.iter().find(|(motion, ..)| *motion == Motion::Truth);
    let mut lengths: Vec<f32> = truth
        .iter()
        .flat_map(|(_, field, _)| field.vectors().iter().map(|[x, y]| x.to_f32().hypot(y.to_f32())))
        .filter(|length| length.is_finite())
        .collect();
    lengths.sort_by(f32::total_cmp);
    lengths.get(lengths.len() * 9 / 10).copied().unwrap_or(1.0).max(1.0)
}

/// Draws the figure: a row for each source.
pub(super) fn draw(interval: &IntervalPictures) -> Result<Picture> {
    let columns = ["motion", "frame", "error"].map(str::to_owned);
    let mut tiles = Tiles::new(LAYOUT, &columns, interval.rows.len() as u32)?;
    let scale = full_scale(interval);
    for ((motion, field, made), row) in interval.rows.iter().zip(0..) {
        let mut wheel = made.clone();
        visual::motion(field, scale, &mut wheel)?;
        let mut error = interval.truth.clone();
        for ((out, a), b) in error.pixels_mut().iter_mut().zip(interval.truth.pixels()).zip(made.pixels()) {
            for i in 0..3 {
                out[i] = (u16::from(a[i].abs_diff(b[i])) * ERROR_GAIN).min(255) as u8;
            }
        }
        tiles.row(row, motion.name(), [&wheel, made, &error])?;
    }
    Ok(tiles.finish())
}
