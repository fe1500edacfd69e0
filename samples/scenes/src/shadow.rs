//! Shadow map of the sun. Nothing in the world moves, so it is rendered once.

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

/// Height towards the sun for each texel of a square of the world.
#[derive(Debug)]
pub(crate) struct ShadowMap {
    axes: [Vec3; 3],
    heights: Vec<f32>,
}

impl ShadowMap {
    /// Renders `chunks` as seen from the sun in direction `sun`.
    pub(crate) fn new(chunks: &[Chunk], sun: Vec3) -> Self {
        let (u, v) = sun.any_orthonormal_pair();
        let mut this = Self { axes: [u, v, sun], heights: Vec::new() };
        let triangles: Vec<ScreenTriangle> = chunks
            .par_iter()
            .filter(|c| !c.held)
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

    fn texel(&self, p: Vec3) -> (Vec2, f32) {
        let [u, v, sun] = self.axes;
        let scale = SIZE as f32 / (2.0 * REACH);
        (Vec2::new(p.dot(u), p.dot(v)) * scale + SIZE as f32 * 0.5, p.dot(sun))
    }

    /// Sun visibility at `p` on a surface with unit `normal`, 0 to 1: a soft-edged mean over a few texels.
    pub(crate) fn sun_at(&self, p: Vec3, normal: Vec3) -> f32 {
        let (at, height) = self.texel(p + normal * 0.05);
        let at = at - 0.5;
        let low = at.floor();
        let (i, j) = (low.x as i32, low.y as i32);
        if i < 1 || j < 1 || i + 3 > SIZE as i32 || j + 3 > SIZE as i32 {
            return 1.0;
        }
        let f = at - low;
        let lit = |dx: i32, dy: i32| {
            let top = self.heights[(j + dy) as usize * SIZE + (i + dx) as usize];
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
        sum / 9.0
    }
}
