//! The comparison figure: a crop of one frame, as every row makes it.
//!
//! Frame and crop are selected automatically: one scored frame in ten is harder, and the crop has the largest total error over all rows.

use cairn::{Picture, Result};

use super::clips::Phase;
use super::measure::{Measurements, Record};
use super::rows;
use super::store::Store;
use super::table::mean;
use crate::picture::{canvas, paste, shrink};
use crate::text::{SMALL, fit, write};

/// Columns of the figure.
const COLUMNS: u32 = 4;
/// Number of scored frames out of ten that are easier than the selected one.
const EASIER_OF_TEN: usize = 9;
/// Distance of the crop from the edges in pixels, because content that enters at an edge cannot be predicted.
const EDGE: u32 = 24;
/// Factor by which the error is brightened.
const ERROR_GAIN: u16 = 4;
/// Size of the crop in pixels, and its magnification.
const PLACE: (u32, u32) = (140, 105);
const ENLARGED: u32 = 2;
const LABEL: u32 = 24;
const GAP: u32 = 6;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];
const FRAME: [u8; 3] = [250, 210, 60];

/// The figure and its caption.
pub(super) struct Figure {
    pub(super) picture: Picture,
    pub(super) caption: String,
}

/// Draws the figure; `None` if the clips are too small or no frame was scored.
pub(super) fn draw(measured: &mut Measurements, store: &Store) -> Result<Option<Figure>> {
    let Some(chosen) = hard(&measured.records).cloned() else { return Ok(None) };
    let shown = measured.show(&chosen.clip, chosen.anchor, Phase::HALF, store)?;
    let [previous, current] = measured.ends(&chosen.clip, chosen.anchor, store)?;
    let Some((_, truth)) = shown.first() else { return Ok(None) };
    if truth.width() < PLACE.0 + 2 * EDGE || truth.height() < PLACE.1 + 2 * EDGE || shown.len() < 2 {
        return Ok(None);
    }
    let at = worst_place(truth, shown[1..].iter().map(|(_, picture)| picture));
    let mut tiles = vec![
        ("where it is, and the anchor before".to_owned(), overview(truth, at)?, enlarge(&previous, at)?),
        ("truth, and the anchor after".to_owned(), enlarge(truth, at)?, enlarge(&current, at)?),
    ];
    for (kind, picture) in &shown {
        // A repeated anchor shows nothing new beside the anchors themselves.
        if let Some(kind) = kind.filter(|kind| *kind != rows::Kind::Repeat) {
            let label = kind.label().replace(['*', '`'], "");
            tiles.push((label, enlarge(picture, at)?, enlarge(&error(truth, picture)?, at)?));
        }
    }
    let caption = format!(
        "{}, the frame in the middle between anchors {} and {}. Below each picture is its error, {ERROR_GAIN} times as bright as it \
         is: black is right. Nobody chose it by eye: of the scored frames one in ten is harder, and the place is the one where \
         all rows together err most.",
        chosen.clip,
        chosen.anchor - 1,
        chosen.anchor
    );
    Ok(Some(Figure { picture: arrange(&tiles)?, caption }))
}

/// The frame at half phase that one in ten exceeds in difficulty; from the scenes if there are any.
fn hard(records: &[Record]) -> Option<&Record> {
    let of_scenes = records.iter().any(|r| r.is_rendered);
    let mut frames: Vec<(f64, &Record)> = Vec::new();
    for record in records.iter().filter(|r| r.phase == Phase::HALF && (!of_scenes || r.is_rendered)) {
        if frames.iter().all(|(_, r)| (&r.clip, r.anchor) != (&record.clip, record.anchor)) {
            let same =
                records.iter().filter(|r| (&r.clip, r.anchor, r.phase) == (&record.clip, record.anchor, record.phase));
            let score = mean(&same.map(|r| r.score).collect::<Vec<_>>())?;
            frames.push((score.lpips.unwrap_or(-score.psnr), record));
        }
    }
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    frames.get((frames.len() * EASIER_OF_TEN / 10).min(frames.len().checked_sub(1)?)).map(|(_, record)| *record)
}

/// The upper left corner of the crop with the largest sum of absolute errors of `pictures`.
fn worst_place<'a>(truth: &Picture, pictures: impl Iterator<Item = &'a Picture>) -> (u32, u32) {
    let (width, height) = (truth.width() as usize, truth.height() as usize);
    let mut error = vec![0u64; width * height];
    for picture in pictures {
        for ((sum, a), b) in error.iter_mut().zip(truth.pixels()).zip(picture.pixels()) {
            *sum += a[..3].iter().zip(&b[..3]).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>();
        }
    }
    // Summed-area table with a row and a column of zeros in front.
    let mut above = vec![0u64; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = 0;
        for x in 0..width {
            row += error[y * width + x];
            above[(y + 1) * (width + 1) + x + 1] = above[y * (width + 1) + x + 1] + row;
        }
    }
    let (w, h) = (PLACE.0 as usize, PLACE.1 as usize);
    let mut worst = (0, (EDGE, EDGE));
    let edge = EDGE as usize;
    for y in edge..=height - h - edge {
        for x in edge..=width - w - edge {
            let at = |x: usize, y: usize| above[y * (width + 1) + x];
            let sum = at(x + w, y + h) + at(x, y) - at(x + w, y) - at(x, y + h);
            if sum > worst.0 {
                worst = (sum, (x as u32, y as u32));
            }
        }
    }
    worst.1
}

/// The absolute error of `picture`, brightened.
pub(super) fn error(truth: &Picture, picture: &Picture) -> Result<Picture> {
    let mut out = truth.clone();
    for ((out, a), b) in out.pixels_mut().iter_mut().zip(truth.pixels()).zip(picture.pixels()) {
        for i in 0..3 {
            out[i] = (u16::from(a[i].abs_diff(b[i])) * ERROR_GAIN).min(255) as u8;
        }
    }
    Ok(out)
}

/// The crop at `at`, magnified by pixel replication.
fn enlarge(picture: &Picture, at: (u32, u32)) -> Result<Picture> {
    let mut tile = Picture::new(PLACE.0 * ENLARGED, PLACE.1 * ENLARGED)?;
    let (tile_width, width) = (tile.width() as usize, picture.width() as usize);
    for (i, pixel) in tile.pixels_mut().iter_mut().enumerate() {
        let (x, y) = ((i % tile_width) as u32 / ENLARGED, (i / tile_width) as u32 / ENLARGED);
        *pixel = picture.pixels()[(at.1 + y) as usize * width + (at.0 + x) as usize];
    }
    Ok(tile)
}

/// The whole picture with a frame around the crop.
fn overview(picture: &Picture, at: (u32, u32)) -> Result<Picture> {
    let room = (PLACE.0 * ENLARGED, PLACE.1 * ENLARGED);
    let scale = (f64::from(room.0) / f64::from(picture.width())).min(f64::from(room.1) / f64::from(picture.height()));
    let scaled = |v: u32| ((f64::from(v) * scale) as u32).max(1);
    let mut small = shrink(picture, (scaled(picture.width()), scaled(picture.height())))?;
    let (width, height) = small.size();
    let (left, top) = (scaled(at.0) - 1, scaled(at.1) - 1);
    let (right, bottom) = (scaled(at.0 + PLACE.0).min(width) - 1, scaled(at.1 + PLACE.1).min(height) - 1);
    for y in top..=bottom {
        for x in left..=right {
            if x == left || x == right || y == top || y == bottom {
                small.pixels_mut()[(y * width + x) as usize][..3].copy_from_slice(&FRAME);
            }
        }
    }
    Ok(small)
}

/// Arranges pairs of tiles in rows, one tile above the other, with labels above them.
fn arrange(tiles: &[(String, Picture, Picture)]) -> Result<Picture> {
    let tile = (PLACE.0 * ENLARGED, PLACE.1 * ENLARGED);
    let lines = (tiles.len() as u32).div_ceil(COLUMNS);
    let line = LABEL + 2 * (tile.1 + GAP) + GAP;
    let mut out = canvas((COLUMNS * (tile.0 + GAP) + GAP, lines * line + GAP), GROUND)?;
    for (i, (label, upper, lower)) in tiles.iter().enumerate() {
        let (left, top) = (GAP + i as u32 % COLUMNS * (tile.0 + GAP), GAP + i as u32 / COLUMNS * line);
        write(&mut out, &fit(label, tile.0, SMALL), (left, top + 4), SMALL, BRIGHT);
        paste(&mut out, upper, (left, top + LABEL));
        paste(&mut out, lower, (left, top + LABEL + tile.1 + GAP));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::record;
    use super::*;

    #[test]
    fn one_frame_in_ten_is_harder() {
        let kind = rows::Kind::Blend;
        let records: Vec<Record> = (0..20).map(|i| record(&format!("snow-{i}"), kind, f64::from(i), None)).collect();
        // Of twenty frames, two have a PSNR as low or lower.
        assert_eq!(hard(&records).unwrap().clip, "snow-1");
        assert_eq!(hard(&records[..1]).unwrap().clip, "snow-0");
        // Frames of scenes take precedence.
        let with_film = [record("film", kind, 5.0, None), record("snow-6", kind, 10.0, None)];
        assert_eq!(hard(&with_film).unwrap().clip, "snow-6");
        assert!(hard(&[]).is_none());
    }

    #[test]
    fn the_place_is_where_the_errors_are() {
        let truth = Picture::new(320, 240).unwrap();
        let mut other = truth.clone();
        other.pixels_mut()[200 * 320 + 290] = [255, 255, 255, 255];
        let (x, y) = worst_place(&truth, [&other].into_iter());
        assert!((x..x + PLACE.0).contains(&290) && (y..y + PLACE.1).contains(&200), "{x} {y}");
        assert_eq!(worst_place(&truth, [&truth].into_iter()), (EDGE, EDGE));
        assert_eq!(error(&truth, &other).unwrap().pixels()[200 * 320 + 290], [255, 255, 255, truth.pixels()[0][3]]);
        assert_eq!(enlarge(&other, (x, y)).unwrap().size(), (PLACE.0 * ENLARGED, PLACE.1 * ENLARGED));
        overview(&other, (x, y)).unwrap();
    }
}
