//! Static foreground of the current anchor, whatever its motion vectors: letterbox bars, and the caller's overlay mask.

use super::letterbox::ActiveArea;

/// Mask of static pixels; by default empty.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct StaticMask<'a> {
    active_area: Option<&'a ActiveArea>,
    /// One byte per pixel, not 0 for an overlay.
    overlay: Option<&'a [u8]>,
    width: usize,
}

impl<'a> StaticMask<'a> {
    /// Pixels outside `active_area`, and pixels of `overlay`, a mask of `width` columns.
    pub(super) fn new(active_area: Option<&'a ActiveArea>, overlay: Option<&'a [u8]>, width: usize) -> Self {
        Self { active_area, overlay, width }
    }

    /// Whether a pixel is static.
    pub(super) fn is_static(&self, [x, y]: [usize; 2]) -> bool {
        self.overlay.is_some_and(|overlay| overlay[y * self.width + x] != 0)
            || self.active_area.is_some_and(|active_area| !active_area.contains(x, y))
    }

    /// Number of static pixels in a rectangle.
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
