//! Truth, generated frame and their difference, side by side.

use cairn::{Picture, Result};

use crate::picture::{paste, shrink};
use crate::text::{SMALL, fit, write};

/// Maximum width of a panel in pixels; larger pictures are scaled down.
const WIDEST: u32 = 640;
const GAP: u32 = 4;
const LABEL: u32 = 24;
/// Factor by which the difference is amplified.
const STRENGTH: u8 = 4;
const GROUND: [u8; 4] = [24, 26, 30, 255];
const BRIGHT: [u8; 3] = [235, 235, 230];

/// Draws three panels for pictures of one size.
pub(super) struct Panels {
    from: (u32, u32),
    tile: (u32, u32),
    difference: Picture,
}

impl Panels {
    pub(super) fn new(from: (u32, u32)) -> Result<Self> {
        let tile = if from.0 <= WIDEST {
            from
        } else {
            (WIDEST, (u64::from(from.1) * u64::from(WIDEST) / u64::from(from.0)).max(1) as u32)
        };
        Ok(Self { from, tile, difference: Picture::new(from.0, from.1)? })
    }

    /// `(width, height)` of the drawing.
    pub(super) fn size(&self) -> (u32, u32) {
        (3 * self.tile.0 + 2 * GAP, LABEL + self.tile.1)
    }

    /// Draws truth, generated frame and difference into `out`, with their upper edge at line `top`; the labels are above the first two.
    pub(super) fn draw(
        &mut self,
        [truth, made]: [&Picture; 2],
        [truth_label, made_label]: [&str; 2],
        out: &mut Picture,
        top: u32,
    ) -> Result<()> {
        let pixels = truth.pixels().iter().zip(made.pixels());
        for (out, (a, b)) in self.difference.pixels_mut().iter_mut().zip(pixels) {
            for c in 0..3 {
                out[c] = a[c].abs_diff(b[c]).saturating_mul(STRENGTH);
            }
        }
        let strength = format!("difference x {STRENGTH}");
        let panels = [(truth_label, truth), (made_label, made), (strength.as_str(), &self.difference)];
        for ((label, picture), n) in panels.into_iter().zip(0..) {
            let left = n * (self.tile.0 + GAP);
            write(out, &fit(label, self.tile.0, SMALL), (left + 4, top + 4), SMALL, BRIGHT);
            if self.tile == self.from {
                paste(out, picture, (left, top + LABEL));
            } else {
                paste(out, &shrink(picture, self.tile)?, (left, top + LABEL));
            }
        }
        Ok(())
    }

    /// Clears the label line.
    pub(super) fn clear(&self, out: &mut Picture) {
        out.pixels_mut().fill(GROUND);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_three_are_there() {
        let grey = |size: (u32, u32), value: u8| {
            let mut picture = Picture::new(size.0, size.1).unwrap();
            picture.pixels_mut().fill([value, value, value, 255]);
            picture
        };
        for size in [(40, 30), (1280, 720)] {
            let mut panels = Panels::new(size).unwrap();
            let (width, height) = panels.size();
            assert!(width <= 3 * WIDEST + 2 * GAP);
            let mut out = Picture::new(width, height).unwrap();
            panels.clear(&mut out);
            panels.draw([&grey(size, 100), &grey(size, 90)], ["true", "made"], &mut out, 0).unwrap();
            let centre = |n: u32| {
                let x = n * (panels.tile.0 + GAP) + panels.tile.0 / 2;
                out.pixels()[((LABEL + panels.tile.1 / 2) * width + x) as usize][0]
            };
            assert_eq!([centre(0), centre(1), centre(2)], [100, 90, 40]);
        }
    }
}
