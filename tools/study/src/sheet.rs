//! The contact sheet: anchors, generated frames, motion and depth of one rollout side by side.

use cairn::guidance::{DepthMap, Guidance, MotionField, visual};
use cairn::{Picture, Result};

use crate::picture::{canvas, paste, shrink};
use crate::text::{LARGE, SMALL, fit, write};

/// Maximum number of columns; a shorter rollout has as many as it has pairs of anchors.
const COLUMNS: usize = 8;
/// Maximum number of columns kept while the rollout's length is unknown.
const KEPT: usize = 2 * COLUMNS;
/// Width of one picture; the height follows the aspect.
const TILE: u32 = 240;
const GAP: u32 = 8;
const LEFT: u32 = 128;
const TOP: u32 = 104;
const BOTTOM: u32 = 96;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];
const DIM: [u8; 3] = [150, 154, 160];
const WARN: [u8; 3] = [240, 190, 90];
const NOTHING: [u8; 3] = [36, 39, 44];

/// Data kept of one anchor.
struct Column {
    latent: u64,
    time: f64,
    anchor: Picture,
    between: Option<(f32, Picture)>,
    /// Motion, and a picture of the depth; `None` where motion was found in pictures, which have none.
    guidance: Option<(MotionField, Option<Picture>)>,
}

/// Collects columns during a rollout and draws them at the end.
///
/// The selection depends on the frames that were made, not on the plan: an interrupted rollout has a full sheet, and its replay has the same.
pub(crate) struct Sheet {
    tile: (u32, u32),
    noun: &'static str,
    stride: u64,
    columns: Vec<Column>,
}

impl Sheet {
    /// For pictures of size `render`; `noun` names the numbered items.
    pub(crate) fn new(render: (u32, u32), noun: &'static str) -> Self {
        let height = (u64::from(TILE) * u64::from(render.1) / u64::from(render.0)).clamp(1, 4096) as u32;
        Self { tile: (TILE, height), noun, stride: 1, columns: Vec::new() }
    }

    /// Whether latent number `latent` gets a column, which may be dropped later.
    pub(crate) fn wants(&self, latent: u64) -> bool {
        latent == 0 || (latent - 1).is_multiple_of(self.stride)
    }

    /// Keeps an anchor, and motion and depth from the one before it.
    pub(crate) fn add(&mut self, latent: u64, time: f64, anchor: &Picture, guidance: Option<&Guidance>) -> Result<()> {
        let anchor = shrink(anchor, self.tile)?;
        let with_depth = |guidance: &Guidance| {
            let has_depth = !guidance.origin().is_optical_flow();
            let depth = has_depth.then(|| depth_tile(guidance.depth(), self.tile)).transpose()?;
            Ok((guidance.motion().clone(), depth))
        };
        let guidance = guidance.map(with_depth).transpose()?;
        // The seed's own latent has no pair: it is shown only if it is the only one.
        self.columns.retain(|column| column.latent > 0);
        if self.columns.len() >= KEPT {
            self.stride *= 2;
            self.columns.retain(|column| (column.latent - 1).is_multiple_of(self.stride));
        }
        if self.wants(latent) {
            self.columns.push(Column { latent, time, anchor, between: None, guidance });
        }
        Ok(())
    }

    /// The columns to draw: evenly spaced from the first to the last.
    fn displayed_columns(&self) -> Vec<&Column> {
        let (have, show) = (self.columns.len(), self.columns.len().min(COLUMNS));
        (0..show).map(|i| &self.columns[i * (have - 1) / (show - 1).max(1)]).collect()
    }

    /// Keeps the frame at phase `t` before the last added anchor, unless a kept one is closer to the middle.
    pub(crate) fn add_between(&mut self, latent: u64, t: f32, frame: &Picture) -> Result<()> {
        if let Some(column) = self.columns.last_mut().filter(|c| c.latent == latent) {
            let nearer = column.between.as_ref().is_none_or(|(old, _)| (t - 0.5).abs() < (old - 0.5).abs());
            if nearer {
                column.between = Some((t, shrink(frame, self.tile)?));
            }
        }
        Ok(())
    }

    /// Draws the sheet with `title` and `subtitle` at the top, and `warning` beside them in another colour.
    pub(crate) fn draw(&self, title: &str, subtitle: &str, warning: Option<&str>) -> Result<Picture> {
        let (tile_width, tile_height) = self.tile;
        let shown = self.displayed_columns();
        let columns = shown.len().max(1) as u32;
        let width = (LEFT + columns * (tile_width + GAP) + GAP).max(900);
        let has_depth = shown.iter().any(|column| matches!(column.guidance, Some((_, Some(_)))));
        let names = [&["anchor"][..], &["frame", "between"], &["motion"], &["depth"]];
        let names = &names[..if has_depth { 4 } else { 3 }];
        let rows = names.len() as u32;
        let height = TOP + rows * (tile_height + GAP) + BOTTOM;
        let mut sheet = canvas((width, height), GROUND)?;
        let room = width - 2 * GAP - 8;
        write(&mut sheet, &fit(title, room, LARGE), (16, 14), LARGE, BRIGHT);
        write(&mut sheet, &fit(subtitle, room, SMALL), (16, 42), SMALL, DIM);
        if let Some(warning) = warning {
            write(&mut sheet, &fit(warning, room, SMALL), (16, 60), SMALL, WARN);
        }
        let scale = full_scale(shown.iter().filter_map(|c| c.guidance.as_ref()).map(|(motion, _)| motion));
        let row = |i: u32| TOP + i * (tile_height + GAP);
        for (i, lines) in names.iter().enumerate() {
            for (n, line) in lines.iter().enumerate() {
                write(&mut sheet, line, (16, row(i as u32) + 4 + 18 * n as u32), SMALL, BRIGHT);
            }
        }
        for (i, column) in shown.into_iter().enumerate() {
            let x = LEFT + i as u32 * (tile_width + GAP);
            let label = format!("{} {}  {:.2} s", self.noun, column.latent, column.time);
            write(&mut sheet, &fit(&label, tile_width, SMALL), (x, TOP - 20), SMALL, BRIGHT);
            paste(&mut sheet, &column.anchor, (x, row(0)));
            match &column.between {
                Some((t, frame)) => {
                    paste(&mut sheet, frame, (x, row(1)));
                    tag(&mut sheet, &format!("t = {t:.2}"), (x, row(1) + tile_height));
                }
                None => fill(&mut sheet, (x, row(1)), self.tile, NOTHING),
            }
            match &column.guidance {
                Some((motion, depth)) => {
                    paste(&mut sheet, &motion_tile(motion, scale, self.tile)?, (x, row(2)));
                    if let Some(depth) = depth {
                        paste(&mut sheet, depth, (x, row(3)));
                    }
                }
                None => (2..rows).for_each(|r| fill(&mut sheet, (x, row(r)), self.tile, NOTHING)),
            }
        }
        legend(&mut sheet, row(rows) + 8, scale, has_depth)?;
        Ok(sheet)
    }
}

/// The colour wheel of motion and its explanation, from line `y` on.
fn legend(sheet: &mut Picture, y: u32, scale: f32, has_depth: bool) -> Result<()> {
    let wheel = visual::wheel(72)?;
    for (i, px) in wheel.pixels().iter().enumerate().filter(|(_, px)| px[3] > 0) {
        let (x, y) = (LEFT + i as u32 % 72, y + i as u32 / 72);
        let at = (y * sheet.width() + x) as usize;
        if let Some(out) = sheet.pixels_mut().get_mut(at) {
            out[..3].copy_from_slice(&px[..3]);
        }
    }
    let lines = [
        format!("motion: from this picture back to the one before; the rim is {} render pixels or more", number(scale)),
        "white: at rest    red: right    yellow-green: down    cyan: left    blue-violet: up".into(),
        if has_depth {
            "depth: white is near, black is far"
        } else {
            "motion was found in the pictures; they have no depth"
        }
        .into(),
    ];
    for (line, n) in lines.iter().zip(0..) {
        write(sheet, line, (LEFT + 88, y + 9 + 18 * n), SMALL, DIM);
    }
    Ok(())
}

fn number(value: f32) -> String {
    if value < 10.0 { format!("{value:.2}") } else { format!("{value:.0}") }
}

/// A length that nearly all vectors stay below, so that a single long one does not fade the others.
fn full_scale<'a>(fields: impl Iterator<Item = &'a MotionField>) -> f32 {
    let mut lengths: Vec<f32> = fields
        .flat_map(|field| field.vectors().iter().step_by(7))
        .map(|[x, y]| x.to_f32().hypot(y.to_f32()))
        .filter(|length| length.is_finite())
        .collect();
    if lengths.is_empty() {
        return 1.0;
    }
    let rank = (lengths.len() - 1) * 98 / 100;
    let (_, length, _) = lengths.select_nth_unstable_by(rank, f32::total_cmp);
    length.max(0.01)
}

fn motion_tile(field: &MotionField, scale: f32, tile: (u32, u32)) -> Result<Picture> {
    let mut picture = Picture::new(field.width(), field.height())?;
    visual::motion(field, scale, &mut picture)?;
    shrink(&picture, tile)
}

fn depth_tile(map: &DepthMap, tile: (u32, u32)) -> Result<Picture> {
    let mut picture = Picture::new(map.width(), map.height())?;
    visual::depth(map, &mut picture)?;
    shrink(&picture, tile)
}

fn fill(sheet: &mut Picture, at: (u32, u32), size: (u32, u32), colour: [u8; 3]) {
    let width = sheet.width();
    for row in at.1..at.1 + size.1 {
        let start = (row * width + at.0) as usize;
        sheet.pixels_mut()[start..start + size.0 as usize].iter_mut().for_each(|px| px[..3].copy_from_slice(&colour));
    }
}

/// A word on a dark background in the lower left corner of a picture that ends at line `below`.
fn tag(sheet: &mut Picture, text: &str, (x, below): (u32, u32)) {
    let size = (text.chars().count() as u32 * SMALL.width + 8, SMALL.height + 2);
    if below >= size.1 && x + size.0 <= sheet.width() {
        fill(sheet, (x, below - size.1), size, GROUND);
        write(sheet, text, (x + 4, below - size.1 + 1), SMALL, BRIGHT);
    }
}

#[cfg(test)]
mod tests {
    use cairn::guidance::{MotionOrigin, Projection};

    use super::*;

    fn latents_shown(made: u64) -> Vec<u64> {
        let mut sheet = Sheet::new((64, 36), "latent");
        let picture = Picture::new(64, 36).unwrap();
        for latent in 0..made {
            if sheet.wants(latent) {
                sheet.add(latent, 0.0, &picture, None).unwrap();
            }
        }
        sheet.displayed_columns().iter().map(|column| column.latent).collect()
    }

    #[test]
    fn columns_are_spread_over_what_was_made() {
        assert_eq!(latents_shown(1), [0]);
        assert_eq!(latents_shown(4), [1, 2, 3]);
        assert_eq!(latents_shown(61), [1, 9, 17, 25, 33, 41, 49, 57]);
        for made in [100, 226, 451, 9_001] {
            let shown = latents_shown(made);
            assert!(shown.len() == 8 && shown[0] == 1 && shown[7] >= made / 2, "{made}: {shown:?}");
        }
    }

    #[test]
    fn a_sheet_without_columns_can_be_drawn() {
        let sheet = Sheet::new((128, 72), "latent").draw("title", "subtitle", Some("warning")).unwrap();
        assert!(sheet.pixels().iter().any(|px| px[..3] == BRIGHT) && sheet.pixels().iter().any(|px| px[..3] == WARN));
    }

    #[test]
    fn a_row_of_depth_is_drawn_where_there_is_depth() {
        let drawn_with = |origin| {
            let mut sheet = Sheet::new((64, 36), "latent");
            let blank = Guidance::new(64, 36, Projection::new(0.1, 100.0, 1.0).unwrap()).unwrap();
            let (motion, depth) = (blank.motion().clone(), blank.depth().clone());
            let guidance = Guidance::from_parts(motion, depth, origin).unwrap();
            sheet.add(1, 0.0, &Picture::new(64, 36).unwrap(), Some(&guidance)).unwrap();
            sheet.draw("title", "subtitle", None).unwrap().height()
        };
        let row = TILE * 36 / 64 + GAP;
        assert_eq!(drawn_with(MotionOrigin::Geometry), drawn_with(MotionOrigin::OpticalFlow) + row);
    }

    #[test]
    fn the_frame_nearest_the_middle_is_kept() {
        let grey = |v: u8| {
            let mut picture = Picture::new(64, 36).unwrap();
            picture.pixels_mut().iter_mut().for_each(|px| px[..3].copy_from_slice(&[v; 3]));
            picture
        };
        let mut sheet = Sheet::new((64, 36), "latent");
        sheet.add(1, 0.1, &grey(9), None).unwrap();
        for (t, v) in [(0.25, 10), (0.5, 20), (0.75, 30)] {
            sheet.add_between(1, t, &grey(v)).unwrap();
        }
        let (t, picture) = sheet.columns[0].between.as_ref().unwrap();
        assert_eq!((*t, picture.pixels()[0][0]), (0.5, 20));
    }
}
