//! Turn onset: the delay from the first turn command of the script until the turn is visible in a stream (the paper's Table 8).
//!
//! A walk has motion of its own, which a detector on one video would mistake for turns. So the same walk is made again without the mouse: the
//! difference of the two horizontal motions is the turn alone, and before the command both walks are identical.
//!
//! Horizontal motion of a frame is the median, over the middle half of the picture in each direction, of the optical flow to the previous
//! frame, in picture widths. After a median filter over three frames, the onset is the first of three frames (a tenth of a second) whose
//! differences have the same sign and all exceed 0.03 widths a second.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use cairn::guidance::{Guidance, paper, picture_flow};
use cairn::{Picture, Result};

use super::paths::frame;
use super::walk::{RATE, SECONDS_AFTER_TURN};
use crate::manifest::read_bounded;
use crate::picture::{decode, shrink};
use crate::progress::check_stop;

/// Size to which pictures are scaled: 16:9.
const SIZE: (u32, u32) = (320, 180);
/// Threshold in picture widths a second.
const THRESHOLD: f64 = 0.03;
/// Number of consecutive frames above the threshold.
const HOLD: usize = 3;
/// The largest frame, in bytes of its file.
const MAX_FRAME: u64 = 512 << 20;

/// Result of the detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Onset {
    /// Seconds from the command to the onset; `None` if no turn was seen within two seconds.
    pub(super) latency: Option<f64>,
    /// Whether both walks were identical until the command, as they must be.
    pub(super) same_before: bool,
}

/// Compares every `step`-th frame in `turned` with that in `straight`; the command is at `command` seconds.
///
/// # Errors
/// `Io` for a missing frame; `Cancelled` when `stop` was set.
pub(super) fn onset(turned: &Path, straight: &Path, step: u64, command: f64, stop: &AtomicBool) -> Result<Onset> {
    let count = ((command + SECONDS_AFTER_TURN) * f64::from(RATE)).floor() as usize + 1;
    let (turned, straight) = (Motion::of(turned, step, count, stop)?, Motion::of(straight, step, count, stop)?);
    Ok(compare(&turned, &straight, command))
}

fn compare(turned: &Motion, straight: &Motion, command: f64) -> Onset {
    let at = (command * f64::from(RATE)).floor() as usize;
    let before = |motion: &Motion| motion.pictures.iter().take(at + 1).cloned().collect::<Vec<_>>();
    let differences: Vec<f64> = turned.shifts.iter().zip(&straight.shifts).map(|(a, b)| a - b).collect();
    Onset {
        latency: first_run(&differences, at).map(|n| (n as f64) / f64::from(RATE) - command),
        same_before: before(turned) == before(straight),
    }
}

/// Horizontal motion into each frame from the second on, and the digest of each frame.
struct Motion {
    shifts: Vec<f64>,
    pictures: Vec<String>,
}

impl Motion {
    fn of(folder: &Path, step: u64, count: usize, stop: &AtomicBool) -> Result<Self> {
        let mut motion = Self { shifts: vec![0.0], pictures: Vec::new() };
        let mut guidance = Guidance::new(SIZE.0, SIZE.1, paper::PROJECTION)?;
        let mut flow = picture_flow::Extractor::new();
        let mut before: Option<Picture> = None;
        for number in 0..count as u64 {
            check_stop(stop)?;
            let path: PathBuf = frame(folder, number * step);
            let bytes = read_bounded(&path, MAX_FRAME)?;
            motion.pictures.push(crate::manifest::sha256(&bytes));
            let picture = shrink(&decode(&bytes).map_err(|e| e.field(path.display().to_string()))?, SIZE)?;
            if let Some(before) = &before {
                flow.extract(before, &picture, &mut guidance)?;
                motion.shifts.push(shift(&guidance));
            }
            before = Some(picture);
        }
        Ok(motion)
    }
}

/// Median horizontal motion in the middle of the picture, in picture widths.
fn shift(guidance: &Guidance) -> f64 {
    let motion = guidance.motion();
    let (width, height) = (motion.width() as usize, motion.height() as usize);
    let rows = motion.vectors().chunks_exact(width).skip(height / 4).take(height / 2);
    let mut all: Vec<f32> =
        rows.flat_map(|row| &row[width / 4..width / 4 + width / 2]).map(|[x, _]| x.to_f32()).collect();
    if all.is_empty() {
        return 0.0;
    }
    let middle = all.len() / 2;
    let (_, median, _) = all.select_nth_unstable_by(middle, f32::total_cmp);
    f64::from(*median) / f64::from(SIZE.0)
}

/// The first frame after `command` that starts [`HOLD`] differences of one sign above the threshold.
fn first_run(differences: &[f64], command: usize) -> Option<usize> {
    let threshold = THRESHOLD / f64::from(RATE);
    let median = |n: usize| {
        let mut three =
            [differences[n.saturating_sub(1)], differences[n], differences[(n + 1).min(differences.len() - 1)]];
        three.sort_by(f64::total_cmp);
        three[1]
    };
    let smooth: Vec<f64> = (0..differences.len()).map(median).collect();
    (command..smooth.len().saturating_sub(HOLD - 1)).find(|&n| {
        let run = &smooth[n..n + HOLD];
        run.iter().all(|v| *v > threshold) || run.iter().all(|v| *v < -threshold)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::FRAMES;
    use media::encode_png;

    /// Frames of a texture that moves down steadily and turns by `turn` pixels a frame from frame `from` on.
    fn film(folder: &Path, turn: i64, from: u64) -> Motion {
        const COUNT: u64 = 60;
        std::fs::create_dir_all(folder.join(FRAMES)).unwrap();
        for number in 0..COUNT {
            let dx = turn * number.saturating_sub(from) as i64;
            let mut picture = Picture::new(SIZE.0, SIZE.1).unwrap();
            for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
                let (x, y) = (i as i64 % i64::from(SIZE.0) + dx, i as i64 / i64::from(SIZE.0) - number as i64);
                let (x, y) = (x as f64, y as f64);
                let value = 128.0 + 50.0 * (x * 0.11 + y * 0.03).sin() + 50.0 * (y * 0.13 - x * 0.05).sin();
                *px = [value as u8, value as u8, value as u8, 255];
            }
            std::fs::write(frame(folder, number), encode_png(&picture).unwrap()).unwrap();
        }
        Motion::of(folder, 1, COUNT as usize, &AtomicBool::new(false)).unwrap()
    }

    #[test]
    fn a_turn_is_seen_when_it_begins_and_no_turn_never() {
        let folder = tempfile::tempdir().unwrap();
        let straight = film(&folder.path().join("straight"), 0, 0);
        // The command is at frame 36; the stream follows six frames later.
        let right = film(&folder.path().join("right"), 2, 42);
        let Onset { latency, same_before } = compare(&right, &straight, 1.2);
        assert!(same_before && (latency.unwrap() - 7.0 / 30.0).abs() < 1.01 / 30.0, "{latency:?}");
        let left = compare(&straight, &right, 1.2);
        assert_eq!(left.latency, latency, "either way");
        assert_eq!(compare(&straight, &straight, 1.2), Onset { latency: None, same_before: true });
        assert!(!compare(&right, &straight, 1.6).same_before, "it turned before it was told to");
    }

    #[test]
    fn a_single_frame_or_a_swing_is_no_turn() {
        let step = 2.0 * THRESHOLD / f64::from(RATE);
        let with = |values: &[(usize, f64)]| {
            let mut all = vec![0.0; 40];
            values.iter().for_each(|(n, v)| all[*n] = *v);
            first_run(&all, 10)
        };
        assert_eq!(with(&[(20, 9.0 * step)]), None);
        assert_eq!(with(&[(20, step), (21, step), (22, -step), (23, -step)]), None);
        assert_eq!(with(&[(20, -step), (21, -step), (22, -step), (23, -step)]), Some(20));
        assert_eq!(with(&[(3, step), (4, step), (5, step), (6, step)]), None, "before the command");
    }
}
