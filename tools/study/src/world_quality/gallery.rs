//! True pictures of a level from everywhere in it, and the search for the pose whose true picture is nearest to a given one.

use cairn::{Picture, Result};
use glam::Vec2;
use rayon::prelude::*;
use scenes::{Family, Quality, Scene, Start, Walker, render_picture};

use crate::level::{self, REACH};
use crate::metrics::{Lpips, mean_squared_error};
use crate::picture::shrink;

/// Distance of neighbouring positions in metres.
const SPACING: f32 = 5.0;
/// Directions at each position.
const DIRECTIONS: u32 = 12;
/// Size of the pictures that the network sees and that poses are refined with.
pub(super) const SIZE: (u32, u32) = (80, 45);
/// Size of the pictures of the search's first stage, as columns and rows.
const SMALL: (usize, usize) = (20, 11);
/// Largest shift down and across, in pixels of [`SMALL`]: 4 rows are 24 degrees of tilt; 3 columns are about half the angle between neighbouring
/// directions.
const MAX_SHIFT: [isize; 2] = [4, 3];
/// Poses of the first stage that are refined; fewer where there are fewer positions.
const CANDIDATES: usize = 24;
/// Refined poses that are refined further.
const FINALISTS: usize = 3;
/// First steps of the refinement: metres, then radians of yaw and pitch.
const FIRST_STEPS: [f32; 3] = [1.6, 0.14, 0.08];
/// Halvings of the steps for all candidates, and for the finalists.
const HALVINGS: [u32; 2] = [1, 5];
/// Aspect ratio of the view.
const ASPECT: f32 = 16.0 / 9.0;
/// Side of a patch of a level in metres; walks stay within [`REACH`].
const PATCH: f32 = 25.0;
/// Patches along each side of a level.
const PATCHES: usize = (2.0 * REACH / PATCH) as usize;

/// A standing walker's pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    /// East and north of the origin, in metres.
    pub(super) at: Vec2,
    /// Direction of view in radians, 0 is north, positive to the east.
    pub(super) yaw: f32,
    /// Tilt in radians, positive is up.
    pub(super) pitch: f32,
}

impl Pose {
    /// The picture from this pose; a position within an obstacle is moved beside it.
    fn picture(&self, scene: &Scene, (width, height): (u32, u32), samples: u32) -> Picture {
        let mut moment = Walker::starting_at(scene, Start { at: self.at, yaw: self.yaw }).moment(ASPECT);
        moment.camera.pitch = self.pitch;
        render_picture(scene, &moment, width, height, Quality { samples })
    }

    /// Metres to another pose, and degrees between the directions of view, 0 to 180.
    pub(super) fn error(&self, other: &Self) -> [f64; 2] {
        let turn = (self.yaw - other.yaw).rem_euclid(std::f32::consts::TAU);
        let turn = turn.min(std::f32::consts::TAU - turn);
        [self.at.distance(other.at).into(), turn.to_degrees().into()]
    }
}

/// Number of patches in a level.
pub(super) const PATCH_COUNT: usize = PATCHES * PATCHES;

/// Index of the patch at a position.
pub(super) fn patch(at: Vec2) -> usize {
    let along = |metres: f32| (((metres + REACH) / PATCH) as usize).min(PATCHES - 1);
    along(at.y) * PATCHES + along(at.x)
}

/// A level's pictures.
pub(super) struct Gallery {
    scene: Scene,
    poses: Vec<Pose>,
    /// [`SMALL`] picture of each pose.
    small: Vec<Vec<f32>>,
    /// Poses that are refined.
    candidates: usize,
}

impl Gallery {
    /// Renders the pictures of a level, from `spacing` times as sparse a grid as usual.
    ///
    /// # Errors
    /// `OutOfMemory`; with `lpips` its errors. Also returns the pictures' [channel means](Lpips::channel_means).
    pub(super) fn new(family: Family, lpips: Option<&Lpips>, spacing: f32) -> Result<(Self, Vec<Vec<f32>>)> {
        let scene = level::scene(family);
        let side = (2.0 * REACH / (SPACING * spacing)) as u32;
        let along = |n: u32| REACH * (2.0 * n as f32 / side as f32 - 1.0);
        let poses = (0..=side).flat_map(|north| (0..=side).map(move |east| (east, north))).flat_map(|(east, north)| {
            (0..DIRECTIONS).map(move |direction| Pose {
                at: Vec2::new(along(east), along(north)),
                yaw: std::f32::consts::TAU * direction as f32 / DIRECTIONS as f32,
                pitch: 0.0,
            })
        });
        let poses: Vec<Pose> = poses.collect();
        let made = poses.par_iter().map(|pose| {
            let picture = pose.picture(&scene, SIZE, 1);
            let features = lpips.map(|lpips| lpips.channel_means(&picture)).transpose()?;
            Ok((small(&picture)?, features))
        });
        let made: Vec<(Vec<f32>, Option<Vec<f32>>)> = made.collect::<Result<_>>()?;
        let (small, features): (Vec<_>, Vec<_>) = made.into_iter().unzip();
        let candidates = (CANDIDATES as f32 / spacing) as usize;
        Ok((Self { scene, poses, small, candidates }, features.into_iter().flatten().collect()))
    }

    /// The patch of each pose.
    pub(super) fn patches(&self) -> Vec<usize> {
        self.poses.iter().map(|pose| patch(pose.at)).collect()
    }

    /// The pose whose true picture is nearest to `picture`: by squared difference over the grid of poses at [`SMALL`], then by a pattern search
    /// from the best of them at [`SIZE`].
    ///
    /// # Errors
    /// As [`shrink`].
    pub(super) fn nearest_pose(&self, picture: &Picture) -> Result<Pose> {
        let target = small(picture)?;
        let mut coarse: Vec<(f32, Pose)> = (self.poses.par_iter().zip(&self.small))
            .map(|(pose, small)| {
                let [rows, columns] = MAX_SHIFT.map(|most| -most..=most);
                let shifts = rows.flat_map(|down| columns.clone().map(move |right| [down, right]));
                let errors = shifts.map(|shift| (difference(&target, small, shift), shift));
                let (error, [down, right]) = errors.min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are shifts");
                (
                    error,
                    Pose { pitch: angle(down, SMALL.1, 1.0), yaw: pose.yaw - angle(right, SMALL.0, ASPECT), ..*pose },
                )
            })
            .collect();
        coarse.sort_by(|a, b| a.0.total_cmp(&b.0));
        let target = shrink(picture, SIZE)?;
        let refine = |pose: Pose, halvings: std::ops::Range<u32>| self.refine(&target, pose, halvings);
        let candidates: Vec<Pose> = coarse.iter().take(self.candidates).map(|(_, pose)| *pose).collect();
        let mut found: Vec<(f64, Pose)> =
            candidates.into_par_iter().map(|pose| refine(pose, 0..HALVINGS[0])).collect::<Result<_>>()?;
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.truncate(FINALISTS);
        let found: Vec<(f64, Pose)> =
            found.into_par_iter().map(|(_, pose)| refine(pose, HALVINGS[0]..HALVINGS[1])).collect::<Result<_>>()?;
        let best = found.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        Ok(best.map_or(self.poses[0], |(_, pose)| pose))
    }

    /// Pattern search: steps to and fro along each coordinate while one of them gains, with steps halved as often as given.
    fn refine(&self, target: &Picture, mut pose: Pose, halvings: std::ops::Range<u32>) -> Result<(f64, Pose)> {
        let error = |pose: &Pose| mean_squared_error(target, &pose.picture(&self.scene, SIZE, 1));
        let mut least = error(&pose)?;
        for halving in halvings {
            let [metres, yaw, pitch] = FIRST_STEPS.map(|step| step / (1 << halving) as f32);
            loop {
                let (sin, cos) = pose.yaw.sin_cos();
                let (ahead, right) = (Vec2::new(sin, cos) * metres, Vec2::new(cos, -sin) * metres);
                let moved = |at: Vec2, yaw: f32, pitch: f32| Pose {
                    at: (pose.at + at).clamp(Vec2::splat(-REACH), Vec2::splat(REACH)),
                    yaw: pose.yaw + yaw,
                    pitch: pose.pitch + pitch,
                };
                let near = [-1.0, 1.0].into_iter().flat_map(|sign| {
                    [
                        moved(ahead * sign, 0.0, 0.0),
                        moved(right * sign, 0.0, 0.0),
                        moved(Vec2::ZERO, yaw * sign, 0.0),
                        moved(Vec2::ZERO, 0.0, pitch * sign),
                    ]
                });
                let mut best = None;
                for other in near {
                    let error = error(&other)?;
                    if error < least {
                        (least, best) = (error, Some(other));
                    }
                }
                match best {
                    Some(better) => pose = better,
                    None => break,
                }
            }
        }
        Ok((least, pose))
    }

    /// The true picture from `pose`.
    pub(super) fn picture(&self, pose: &Pose, size: (u32, u32)) -> Picture {
        pose.picture(&self.scene, size, Quality::default().samples)
    }
}

/// A [`SMALL`] picture as numbers, row by row.
fn small(picture: &Picture) -> Result<Vec<f32>> {
    let small = shrink(picture, (SMALL.0 as u32, SMALL.1 as u32))?;
    Ok(small.pixels().iter().flat_map(|px| [px[0], px[1], px[2]].map(f32::from)).collect())
}

/// Mean squared difference of the pixels that both have when `other` is moved by `[down, right]`.
fn difference(target: &[f32], other: &[f32], [down, right]: [isize; 2]) -> f32 {
    let line = 3 * SMALL.0;
    let shared = line - 3 * right.unsigned_abs();
    let [above, below] = [down.max(0), (-down).max(0)].map(|rows| rows as usize * line);
    let [target_left, other_left] = [right.max(0), (-right).max(0)].map(|columns| 3 * columns as usize);
    let rows = target[above..].chunks_exact(line).zip(other[below..].chunks_exact(line));
    let (mut sum, mut count) = (0.0, 0);
    for (target, other) in rows {
        let pairs = target[target_left..target_left + shared].iter().zip(&other[other_left..other_left + shared]);
        sum += pairs.map(|(a, b)| (a - b).powi(2)).sum::<f32>();
        count += shared;
    }
    sum / count as f32
}

/// Camera rotation in radians that moves the picture by `pixels` of the `all` pixels along an axis, half of which spans
/// `aspect * tan(vertical_fov / 2)`.
fn angle(pixels: isize, all: usize, aspect: f32) -> f32 {
    let half = aspect * (62_f32.to_radians() / 2.0).tan();
    (2.0 * half * pixels as f32 / all as f32).atan()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_poses_are_found_from_their_pictures_alone() {
        let (gallery, features) = Gallery::new(Family::Desert, None, 1.4).unwrap();
        assert!(features.is_empty() && gallery.poses.len() == 15 * 15 * DIRECTIONS as usize);
        let found = [
            ((12.0, -7.0), 100.0_f32, 0.05),
            ((-31.0, 22.5), 250.0, -0.1),
            ((3.0, 3.0), 20.0, 0.1),
            ((27.5, 13.0), 310.0, 0.0),
            ((-8.0, -36.0), 170.0, -0.03),
        ]
        .map(|(at, degrees, pitch)| {
            let pose = Pose { at: at.into(), yaw: degrees.to_radians(), pitch };
            let found = gallery.nearest_pose(&gallery.picture(&pose, (320, 180))).unwrap();
            let [metres, turn] = found.error(&pose);
            (metres, turn, (found.pitch - pitch).abs())
        });
        let right = found.iter().filter(|(metres, turn, tilt)| *metres < 1.5 && *turn < 4.0 && *tilt < 0.05).count();
        assert!(right >= 3, "metres, degrees and tilt off: {found:?}");
    }

    #[test]
    fn a_picture_that_is_moved_is_found_again() {
        let columns = SMALL.0 as isize;
        let at = |row: isize, column: isize| ((row * 37 + column * 11) % 23) as f32;
        let made = |down: isize, right: isize| -> Vec<f32> {
            let places = (0..SMALL.1 as isize).flat_map(|row| (0..columns).map(move |column| (row, column)));
            places.flat_map(|(row, column)| [at(row - down + 50, column - right + 50); 3]).collect()
        };
        assert_eq!(difference(&made(2, -3), &made(0, 0), [2, -3]), 0.0);
        assert_eq!(difference(&made(-4, 1), &made(0, 0), [-4, 1]), 0.0);
        assert!(difference(&made(2, -3), &made(0, 0), [2, 3]) > 10.0);
        // Half of the 62 degrees that are seen from top to bottom is half of the rows.
        assert!((angle(5, 10, 1.0).to_degrees() - 31.0).abs() < 1e-3, "{}", angle(5, 10, 1.0).to_degrees());
    }

    #[test]
    fn errors_are_metres_and_the_smaller_angle() {
        let pose = |east: f32, degrees: f32| Pose { at: Vec2::new(east, 0.0), yaw: degrees.to_radians(), pitch: 0.0 };
        let [metres, degrees] = pose(1.0, 350.0).error(&pose(4.0, 10.0));
        assert!((metres - 3.0).abs() < 1e-6 && (degrees - 20.0).abs() < 1e-3, "{metres} {degrees}");
        let [_, degrees] = pose(0.0, -720.0 + 180.0).error(&pose(0.0, 0.0));
        assert!((degrees - 180.0).abs() < 1e-3, "{degrees}");
    }

    #[test]
    fn patches_cover_a_level() {
        assert_eq!(
            [(-50.0, -50.0), (49.9, -50.0), (-50.0, 49.9), (52.0, 52.0)].map(|at| patch(at.into())),
            [0, 3, 12, 15]
        );
        assert_eq!(patch(Vec2::new(1.0, -1.0)), 6);
    }
}
