//! Geometry of one frame: where the vertices of moving chunks are at the frame's time and at the previous frame's.

use glam::Vec3;
use rayon::prelude::*;

use crate::camera::View;
use crate::material::Material;
use crate::render::Frustum;
use crate::scene::{Chunk, Scene};

/// A bounding sphere: centre and radius in metres.
pub(crate) type Ball = (Vec3, f32);

/// A moving chunk at both times of a frame.
pub(crate) struct MovedChunk {
    /// Positions of the vertices at the frame's time, in the world.
    pub(crate) now: Vec<Vec3>,
    /// Positions at the previous frame's time.
    pub(crate) before: Vec<Vec3>,
    /// Unit normals at the frame's time.
    pub(crate) normals: Vec<Vec3>,
    /// Bounding sphere at the frame's time.
    pub(crate) ball: Ball,
}

/// All chunks of a scene at both times of a frame.
pub(crate) struct FrameGeometry<'a> {
    pub(crate) chunks: &'a [Chunk],
    /// One entry for each chunk; `None` for what stands still or is too far away to be seen or to cast a shadow that is seen.
    moved: Vec<Option<MovedChunk>>,
}

/// How far the wind moves a vertex at most, in metres.
const SWAY: f32 = 1.0;

impl<'a> FrameGeometry<'a> {
    /// Evaluates the moving chunks that `is_near` accepts by their bounding sphere.
    pub(crate) fn new(scene: &'a Scene, now: f32, before: f32, is_near: impl Fn(Vec3, f32) -> bool + Sync) -> Self {
        let place = |chunk: &Chunk| {
            if !chunk.moves() {
                return None;
            }
            // Plants stay where they grow; everything else has to be placed before it is known to be near.
            let (centre, radius) = chunk.ball();
            if chunk.is_rooted() && !is_near(centre, radius + SWAY) {
                return None;
            }
            let positions = chunk.positions_at(now).into_owned();
            let ball = bounding_ball(&positions);
            is_near(ball.0, ball.1).then(|| MovedChunk {
                before: chunk.positions_at(before).into_owned(),
                normals: chunk.normals_at(now),
                now: positions,
                ball,
            })
        };
        Self { chunks: &scene.chunks, moved: scene.chunks.par_iter().map(place).collect() }
    }

    /// The chunk of triangle `id`, and the triangle's number in it.
    pub(crate) fn locate(&self, id: u32) -> (usize, usize) {
        let chunk = self.chunks.partition_point(|c| c.first <= id) - 1;
        (chunk, (id - self.chunks[chunk].first) as usize)
    }

    /// Whether water may be in view.
    pub(crate) fn shows_water(&self, view: &View, frustum: &Frustum) -> bool {
        let is_water = |chunk: &&Chunk| chunk.mesh.materials.first().is_some_and(|s| s.material == Material::Water);
        self.chunks.iter().filter(is_water).any(|chunk| frustum.shows(view, chunk.ball().0, chunk.ball().1))
    }

    /// The chunk at both times, if it moves and is near.
    pub(crate) fn moved(&self, chunk: usize) -> Option<&MovedChunk> {
        self.moved[chunk].as_ref()
    }

    /// All moving chunks that are near, with their numbers.
    pub(crate) fn all_moved(&self) -> impl Iterator<Item = (usize, &MovedChunk)> {
        self.moved.iter().enumerate().filter_map(|(n, moved)| Some((n, moved.as_ref()?)))
    }

    /// Positions of the chunk's vertices at the frame's time, and its bounding sphere; `None` for a moving chunk that is not near.
    pub(crate) fn placed(&self, chunk: usize) -> Option<(&[Vec3], Ball)> {
        match &self.moved[chunk] {
            Some(moved) => Some((&moved.now, moved.ball)),
            None if self.chunks[chunk].moves() => None,
            None => Some((&self.chunks[chunk].mesh.positions, self.chunks[chunk].ball())),
        }
    }
}

fn bounding_ball(positions: &[Vec3]) -> Ball {
    let (low, high) =
        positions.iter().fold((Vec3::splat(f32::MAX), Vec3::splat(f32::MIN)), |(a, b), &p| (a.min(p), b.max(p)));
    let centre = (low + high) * 0.5;
    (centre, positions.iter().map(|p| p.distance(centre)).fold(0.0, f32::max))
}
