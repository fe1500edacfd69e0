//! What stands still and in front in the current anchor, whatever its vectors say: letterbox bars, and what the caller says lies over it.

use super::letterbox::Inside;

/// Which pixels these are. By default none.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Standing<'a> {
    inside: Option<&'a Inside>,
    /// A byte to a pixel, 0 where nothing lies over it.
    overlay: Option<&'a [u8]>,
    width: usize,
}

impl<'a> Standing<'a> {
    /// What lies outside `inside`, and what `overlay` says of a picture of `width` pixels across.
    pub(super) fn new(inside: Option<&'a Inside>, overlay: Option<&'a [u8]>, width: usize) -> Self {
        Self { inside, overlay, width }
    }

    /// Whether a pixel stands still.
    pub(super) fn is_at(&self, [x, y]: [usize; 2]) -> bool {
        self.overlay.is_some_and(|overlay| overlay[y * self.width + x] != 0)
            || self.inside.is_some_and(|inside| !inside.contains(x, y))
    }

    /// How many pixels of a rectangle do.
    pub(super) fn count(&self, corner: [usize; 2], extent: [usize; 2]) -> usize {
        let is_between_bars = self.inside.is_none_or(|inside| inside.holds(corner, extent));
        if self.overlay.is_none() && is_between_bars {
            return 0;
        }
        let ([x, y], [across, down]) = (corner, extent);
        let pixels = (0..down).flat_map(|j| (0..across).map(move |i| [x + i, y + j]));
        pixels.filter(|&at| self.is_at(at)).count()
    }
}
