//! Carrying the current anchor's pixels along their vectors.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::reserve;
use super::sample::split;
use super::surface::Surfaces;
use crate::Result;

/// For each place of a picture, the pixel of the current anchor that lands there.
///
/// A place holds the rank of that pixel above its index, and the smallest wins. This is a total order, so the result
/// does not depend on who came first.
#[derive(Debug, Default)]
pub(super) struct Splat {
    places: Vec<AtomicU64>,
    width: usize,
    height: usize,
}

const EMPTY: u64 = u64::MAX;

impl Splat {
    /// Carries every pixel by `reach` times its vector: 1 is the previous anchor, 0 the current one, -1 the one to
    /// come.
    pub(super) fn splat(&mut self, surfaces: &Surfaces, size: (u32, u32), reach: f32) -> Result<()> {
        (self.width, self.height) = (size.0 as usize, size.1 as usize);
        let (width, height) = (self.width, self.height);
        reserve(&mut self.places, width * height)?;
        self.places.resize_with(width * height, || AtomicU64::new(EMPTY));
        self.places.par_iter_mut().for_each(|place| *place.get_mut() = EMPTY);

        let places = &self.places;
        (0..height).into_par_iter().for_each(|y| {
            for x in 0..width {
                let pixel = y * width + x;
                let [mx, my] = surfaces.vector(pixel);
                let at = [x as f32 + reach * mx, y as f32 + reach * my];
                if let Some(place) = nearest(at, width, height) {
                    let key = u64::from(surfaces.rank(pixel)) << 32 | pixel as u64;
                    places[place].fetch_min(key, Ordering::Relaxed);
                }
            }
        });
        Ok(())
    }

    /// The pixel that lands on a place.
    pub(super) fn owner(&self, place: usize) -> Option<usize> {
        let key = self.places[place].load(Ordering::Relaxed);
        (key != EMPTY).then_some((key & 0xffff_ffff) as usize)
    }

    /// The pixel that lands nearest to a position, where that is on the picture.
    pub(super) fn owner_at(&self, at: [f32; 2]) -> Option<usize> {
        nearest(at, self.width, self.height).and_then(|place| self.owner(place))
    }
}

/// The index of the pixel nearest to a position, halves going up; `None` off the picture.
pub(super) fn nearest([x, y]: [f32; 2], width: usize, height: usize) -> Option<usize> {
    let ((x, _), (y, _)) = (split(x + 0.5), split(y + 0.5));
    let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
    (x < width && y < height).then(|| y * width + x)
}
