//! What stands still and in front in the current anchor, whatever its vectors say: letterbox bars, and what the caller says lies over it.

use super::letterbox::ActiveArea;

/// Which pixels these are. By default none.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct StaticMask<'a> {
    active_area: Option<&'a ActiveArea>,
    /// A byte to a pixel, 0 where nothing lies over it.
    overlay: Option<&'a [u8]>,
    width: usize,
}

impl<'a> StaticMask<'a> {
    /// What lies outside `active_area`, and what `overlay` says of a picture of `width` pixels across.
    pub(super) fn new(active_area: Option<&'a ActiveArea>, overlay: Option<&'a [u8]>, width: usize) -> Self {
        Self { active_area, overlay, width }
    }

    /// Whether a pixel stands still.
    pub(super) fn is_static(&self, [x, y]: [usize; 2]) -> bool {
        self.overlay.is_some_and(|overlay| overlay[y * self.width + x] != 0)
            || self.active_area.is_some_and(|active_area| !active_area.contains(x, y))
    }

    /// How many pixels of a rectangle do.
    pub(super) fn count(&self, corner: [usize; 2], extent: [usize; 2]) -> usize {
        let is_between_bars = self.active_area.is_none_or(|active_area| active_area.contains_rectangle(corner, extent));
        if self.overlay.is_none() && is_between_bars {
            return 0;
        }
        let ([x, y], [across, down]) = (corner, extent);
        let pixels = (0..down).flat_map(|j| (0..across).map(move |i| [x + i, y + j]));
        pixels.filter(|&at| self.is_static(at)).count()
    }
}
