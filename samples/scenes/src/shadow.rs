//! Shadow maps of the sun: one of all that stands still, rendered once, and one a frame of what moves near the viewer.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::raster::{ScreenTriangle, Visibility};
use crate::scene::Chunk;

/// Texels per side.
const SIZE: usize = 3072;
/// Half side of the shadowed square, in metres; everything outside is in the sun.
const REACH: f32 = 104.0;
/// Depth bias in metres: minimum distance of an occluder in front of a surface.
const BIAS: f32 = 0.09;

/// Texels per side of a frame's own map; as large as those of the whole.
const FRAME_SIZE: usize = 1024;

/// Height towards the sun for each texel of a square of the world.
#[derive(Debug)]
pub(crate) struct ShadowMap {
    axes: [Vec3; 3],
    size: usize,
    /// Whole texels by which the square is displaced from the origin.
    origin: Vec2,
    heights: Vec<f32>,
}

impl ShadowMap {
    /// Renders `chunks` as seen from the sun in direction `sun`.
    pub(crate) fn new(chunks: &[Chunk], sun: Vec3, casts: impl Fn(&Chunk) -> bool + Sync) -> Self {
        let (u, v) = sun.any_orthonormal_pair();
        let mut this = Self { axes: [u, v, sun], size: SIZE, origin: Vec2::ZERO, heights: Vec::new() };
        let triangles: Vec<ScreenTriangle> = chunks
            .par_iter()
            .filter(|c| casts(c))
            .flat_map_iter(|c| {
                let placed: Vec<(Vec2, f32)> = c.mesh.positions.iter().map(|&p| this.texel(p)).collect();
                c.mesh.triangles.clone().into_iter().map(move |t| {
                    let corners = t.map(|i| placed[i as usize]);
                    ScreenTriangle { at: corners.map(|c| c.0), near: corners.map(|c| c.1), id: 0 }
                })
            })
            .collect();
        this.heights = Visibility::draw(SIZE, SIZE, f32::MIN, &triangles).near;
        this
    }

    /// A map of the square around `centre`, without casters yet.
    pub(crate) fn around(centre: Vec3, sun: Vec3) -> Self {
        let (u, v) = sun.any_orthonormal_pair();
        let mut this = Self { axes: [u, v, sun], size: FRAME_SIZE, origin: Vec2::ZERO, heights: Vec::new() };
        // Whole texels, so that shadows of what stands still do not shimmer while the viewer walks.
        this.origin = (this.texel(centre).0 - FRAME_SIZE as f32 * 0.5).floor();
        this
    }

    /// Whether a ball may cast a shadow into the map.
    pub(crate) fn has(&self, centre: Vec3, radius: f32) -> bool {
        let (at, _) = self.texel(centre);
        let room = radius * SIZE as f32 / (2.0 * REACH) + 2.0;
        at.min_element() > -room && at.max_element() < self.size as f32 + room
    }

    /// Renders the casters: positions and triangles of each.
    pub(crate) fn cast(&mut self, casters: &[(&[Vec3], &[[u32; 3]])]) {
        let triangles: Vec<ScreenTriangle> = casters
            .par_iter()
            .flat_map_iter(|(positions, triangles)| {
                let placed: Vec<(Vec2, f32)> = positions.iter().map(|&p| self.texel(p)).collect();
                triangles.iter().map(move |t| {
                    let corners = t.map(|i| placed[i as usize]);
                    ScreenTriangle { at: corners.map(|c| c.0), near: corners.map(|c| c.1), id: 0 }
                })
            })
            .collect();
        self.heights = Visibility::draw(self.size, self.size, f32::MIN, &triangles).near;
    }

    fn texel(&self, p: Vec3) -> (Vec2, f32) {
        let [u, v, sun] = self.axes;
        let scale = SIZE as f32 / (2.0 * REACH);
        (Vec2::new(p.dot(u), p.dot(v)) * scale + self.size as f32 * 0.5 - self.origin, p.dot(sun))
    }

    /// Sun visibility at `p` on a surface with unit `normal`, 0 to 1: a soft-edged mean over a few texels.
    pub(crate) fn sun_at(&self, p: Vec3, normal: Vec3) -> f32 {
        self.sun_within(p, normal).unwrap_or(1.0)
    }

    /// As [`sun_at`](Self::sun_at); `None` outside the map's square.
    pub(crate) fn sun_within(&self, p: Vec3, normal: Vec3) -> Option<f32> {
        let (at, height) = self.texel(p + normal * 0.05);
        let at = at - 0.5;
        let low = at.floor();
        let (i, j) = (low.x as i32, low.y as i32);
        if i < 1 || j < 1 || i + 3 > self.size as i32 || j + 3 > self.size as i32 {
            return None;
        }
        let f = at - low;
        let lit = |dx: i32, dy: i32| {
            let top = self.heights[(j + dy) as usize * self.size + (i + dx) as usize];
            if top > height + BIAS { 0.0 } else { 1.0 }
        };
        // A box filter of three texels with subpixel position: weights 1-f, 1, 1, f over four texels.
        let wx = [1.0 - f.x, 1.0, 1.0, f.x];
        let wy = [1.0 - f.y, 1.0, 1.0, f.y];
        let mut sum = 0.0;
        for (dy, wy) in wy.into_iter().enumerate() {
            for (dx, wx) in wx.into_iter().enumerate() {
                sum += wx * wy * lit(dx as i32 - 1, dy as i32 - 1);
            }
        }
        Some(sum / 9.0)
    }
}
