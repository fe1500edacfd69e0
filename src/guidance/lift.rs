//! From a grid of cells to pixels: bilinear, half-pixel centres, edges clamped.

/// The two cells and the weight of the second that one render row or column is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tap {
    pub(super) first: usize,
    pub(super) second: usize,
    pub(super) weight: f32,
}

impl Tap {
    /// What position `i` of `to` is made of on a grid of `from` cells.
    pub(super) fn new(i: usize, to: usize, from: usize) -> Self {
        let position = (i as f64 + 0.5) * from as f64 / to as f64 - 0.5;
        let cell = position.floor();
        let clamp = |c: f64| c.clamp(0.0, (from - 1) as f64) as usize;
        Self { first: clamp(cell), second: clamp(cell + 1.0), weight: (position - cell) as f32 }
    }

    /// The four cells of a grid `width` cells wide, two above and two below, that the pixel of `row` and `column` lies between.
    pub(super) fn cells(row: Self, column: Self, width: usize) -> [[usize; 2]; 2] {
        [row.first, row.second].map(|r| [r * width + column.first, r * width + column.second])
    }
}

/// The mixture of four cells, two above and two below, by the weights of the right and the lower ones.
pub(super) fn bilinear(cells: [[usize; 2]; 2], [across, down]: [f32; 2], at: impl Fn(usize) -> f32) -> f32 {
    let mixed = |a: f32, b: f32, weight: f32| a + (b - a) * weight;
    let [above, below] = cells.map(|[left, right]| mixed(at(left), at(right), across));
    mixed(above, below, down)
}
