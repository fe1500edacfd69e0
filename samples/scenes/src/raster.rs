//! A depth-buffered rasteriser that works in bands of rows.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Identifier for no triangle: the sky.
pub(crate) const SKY: u32 = u32::MAX;

/// A screen-space triangle: positions in samples, depth keys, and its number.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScreenTriangle {
    /// Corners in samples.
    pub at: [Vec2; 3],
    /// Depth key: interpolated linearly on the screen, the larger one wins; 1/z for a perspective view.
    pub near: [f32; 3],
    /// Its number.
    pub id: u32,
}

/// The nearest triangle at every sample.
#[derive(Debug)]
pub(crate) struct Visibility {
    width: usize,
    /// Triangle numbers or [`SKY`], row by row.
    pub ids: Vec<u32>,
    /// The largest `near` at every sample.
    pub near: Vec<f32>,
}

/// Rows per band: small enough to balance threads, large enough that most triangles touch few bands.
const BAND: usize = 16;

impl Visibility {
    /// Rasterises `triangles` at `width` x `height` samples; sample (i, j) lies at (i + 0.5, j + 0.5). `floor` is the depth key of the background.
    /// Of two triangles with equal keys the earlier one wins, for any thread count.
    pub(crate) fn draw(width: usize, height: usize, floor: f32, triangles: &[ScreenTriangle]) -> Self {
        let mut this = Self { width, ids: vec![SKY; width * height], near: vec![floor; width * height] };
        let bands = height.div_ceil(BAND);
        let mut bins: Vec<Vec<u32>> = vec![Vec::new(); bands];
        for (k, t) in triangles.iter().enumerate() {
            let (low, high) = min_max(t.at.map(|p| p.y));
            if high < 0.0 || low >= height as f32 {
                continue;
            }
            let first = low.max(0.0) as usize / BAND;
            let last = (high.min(height as f32 - 1.0).max(0.0) as usize / BAND).min(bands - 1);
            bins[first..=last].iter_mut().for_each(|b| b.push(k as u32));
        }
        this.ids
            .par_chunks_mut(BAND * width)
            .zip(this.near.par_chunks_mut(BAND * width))
            .zip(bins.par_iter())
            .enumerate()
            .for_each(|(band, ((ids, near), bin))| {
                for &k in bin {
                    fill(&triangles[k as usize], band * BAND, width, ids, near);
                }
            });
        this
    }

    /// Samples in a row.
    pub(crate) fn width(&self) -> usize {
        self.width
    }
}

fn min_max(v: [f32; 3]) -> (f32, f32) {
    (v[0].min(v[1]).min(v[2]), v[0].max(v[1]).max(v[2]))
}

/// Rasterises one triangle into a band that starts at row `top`.
fn fill(t: &ScreenTriangle, top: usize, width: usize, ids: &mut [u32], near: &mut [f32]) {
    let [a, b, c] = t.at;
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let rows = ids.len() / width;
    let (ylow, yhigh) = min_max([a.y, b.y, c.y]);
    let (xlow, xhigh) = min_max([a.x, b.x, c.x]);
    let j0 = ((ylow - 0.5).ceil().max(top as f32)) as usize;
    let j1 = (yhigh - 0.5).floor().min((top + rows) as f32 - 1.0);
    let i0 = ((xlow - 0.5).ceil().max(0.0)) as usize;
    let i1 = (xhigh - 0.5).floor().min(width as f32 - 1.0);
    if j1 < j0 as f32 || i1 < i0 as f32 {
        return;
    }
    let (j1, i1) = (j1 as usize, i1 as usize);
    // Barycentric weights are linear on the screen: w = w0 + x dx + y dy, all non-negative inside.
    let inverse = 1.0 / area;
    let plane = |p: Vec2, q: Vec2| {
        let (dx, dy) = (-(q.y - p.y) * inverse, (q.x - p.x) * inverse);
        (dx, dy, -(dx * p.x + dy * p.y))
    };
    let edges = [plane(b, c), plane(c, a), plane(a, b)];
    let depth = |k: usize| [edges[0], edges[1], edges[2]].map(|e| [e.0, e.1, e.2][k]);
    let dot = |w: [f32; 3]| w[0] * t.near[0] + w[1] * t.near[1] + w[2] * t.near[2];
    let (zx, zy, z0) = (dot(depth(0)), dot(depth(1)), dot(depth(2)));
    for j in j0..=j1 {
        let y = j as f32 + 0.5;
        let row = (j - top) * width;
        // Estimates the span with non-negative weights from the edges, then checks each sample.
        let (mut left, mut right) = (i0 as f32, i1 as f32);
        for (dx, dy, w0) in edges {
            let at_zero = w0 + dy * y + dx * 0.5;
            if dx > 0.0 {
                left = left.max((-at_zero / dx).ceil() - 1.0);
            } else if dx < 0.0 {
                right = right.min((-at_zero / dx).floor() + 1.0);
            } else if at_zero < 0.0 {
                right = -1.0;
            }
        }
        if right < left {
            continue;
        }
        for i in left.max(i0 as f32) as usize..=(right.max(0.0) as usize).min(i1) {
            let x = i as f32 + 0.5;
            let inside = edges.iter().all(|&(dx, dy, w0)| w0 + dx * x + dy * y >= 0.0);
            let z = z0 + zx * x + zy * y;
            if inside && z > near[row + i] {
                near[row + i] = z;
                ids[row + i] = t.id;
            }
        }
    }
}

/// Clips a triangle at the plane on which the coordinate `axis` is `limit`, and passes on the parts beyond it.
pub(crate) fn clip(corners: [Vec3; 3], axis: usize, limit: f32, mut keep: impl FnMut([Vec3; 3])) {
    let outside = corners.iter().filter(|p| p[axis] < limit).count();
    match outside {
        0 => keep(corners),
        3 => {}
        _ => {
            let mut polygon = [Vec3::ZERO; 4];
            let mut n = 0;
            for k in 0..3 {
                let (p, q) = (corners[k], corners[(k + 1) % 3]);
                if p[axis] >= limit {
                    polygon[n] = p;
                    n += 1;
                }
                if (p[axis] < limit) != (q[axis] < limit) {
                    polygon[n] = p + (q - p) * ((limit - p[axis]) / (q[axis] - p[axis]));
                    n += 1;
                }
            }
            keep([polygon[0], polygon[1], polygon[2]]);
            if n == 4 {
                keep([polygon[0], polygon[2], polygon[3]]);
            }
        }
    }
}
