//! Bilinear upsampling from a grid of cells to pixels: half-pixel centres, edges clamped.

/// Linear interpolation for one render row or column: two cell indices and the weight of the second.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tap {
    pub(super) first: usize,
    pub(super) second: usize,
    pub(super) weight: f32,
}

impl Tap {
    /// Interpolation for position `i` of `to`, on a grid of `from` cells.
    pub(super) fn new(i: usize, to: usize, from: usize) -> Self {
        let position = (i as f64 + 0.5) * from as f64 / to as f64 - 0.5;
        let cell = position.floor();
        let clamp = |c: f64| c.clamp(0.0, (from - 1) as f64) as usize;
        Self { first: clamp(cell), second: clamp(cell + 1.0), weight: (position - cell) as f32 }
    }

    /// Indices of the four cells around a pixel, upper pair first, on a grid `width` cells wide.
    pub(super) fn cells(row: Self, column: Self, width: usize) -> [[usize; 2]; 2] {
        [row.first, row.second].map(|r| [r * width + column.first, r * width + column.second])
    }
}

/// Bilinear interpolation of four cells, upper pair first, with the weights of the right and the lower cells.
pub(super) fn bilinear(cells: [[usize; 2]; 2], [across, down]: [f32; 2], at: impl Fn(usize) -> f32) -> f32 {
    let mixed = |a: f32, b: f32, weight: f32| a + (b - a) * weight;
    let [above, below] = cells.map(|[left, right]| mixed(at(left), at(right), across));
    mixed(above, below, down)
}
