//! Pixels for phase t from the two anchors.

use rayon::prelude::*;

use super::fill::{Filler, Vector};
use super::sample::Bicubic;
use super::splat::{Splat, nearest};
use super::surface::Surfaces;
use crate::Picture;

/// Writes the picture at phase `t` between `previous` and `current`.
pub(super) fn between(
    previous: &Picture,
    current: &Picture,
    t: f32,
    surfaces: &Surfaces,
    filler: &Filler,
    at_previous: &Splat,
    out: &mut Picture,
) {
    let (width, height) = (out.width() as usize, out.height() as usize);
    let (before, after) = (Bicubic::new(previous), Bicubic::new(current));

    // Whether the previous anchor shows the surface of `pixel` at a position: nothing that moves differently is in
    // front there.
    let shown_before = |at: [f32; 2], pixel: usize| {
        before.contains(at) && at_previous.owner_at(at).is_none_or(|owner| surfaces.move_alike(owner, pixel))
    };
    // The same for the current anchor. What landed there by itself is visible in it.
    let shown_after = |at: [f32; 2], pixel: usize, borrowed: bool| {
        after.contains(at)
            && (!borrowed || nearest(at, width, height).is_none_or(|there| surfaces.move_alike(there, pixel)))
    };

    out.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let place = [x as f32, y as f32];
            let (source, borrowed) = match filler.vector(y * width + x) {
                Vector::Own(source) => (source, false),
                Vector::Borrowed(source) => (source, true),
                Vector::Missing => {
                    *pixel = rounded(mixed(before.at(place), after.at(place), t));
                    continue;
                }
            };
            let [mx, my] = surfaces.vector(source);
            let from = [place[0] + t * mx, place[1] + t * my];
            let to = [place[0] - (1.0 - t) * mx, place[1] - (1.0 - t) * my];
            *pixel = rounded(match (shown_before(from, source), shown_after(to, source, borrowed)) {
                (true, true) => mixed(before.at(from), after.at(to), t),
                (true, false) => before.at(from),
                (false, true) => after.at(to),
                // Neither shows it: the nearer in time, rather than a double image.
                (false, false) if t < 0.5 => before.at(from),
                (false, false) => after.at(to),
            });
        }
    });
}

/// Writes the picture `t` intervals after `current`.
pub(super) fn beyond(current: &Picture, t: f32, surfaces: &Surfaces, filler: &Filler, out: &mut Picture) {
    let width = out.width() as usize;
    let after = Bicubic::new(current);
    out.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let [mx, my] = match filler.vector(y * width + x) {
                Vector::Own(source) | Vector::Borrowed(source) => surfaces.vector(source),
                Vector::Missing => [0.0; 2],
            };
            *pixel = rounded(after.at([x as f32 + t * mx, y as f32 + t * my]));
        }
    });
}

fn mixed(before: [f32; 4], after: [f32; 4], t: f32) -> [f32; 4] {
    std::array::from_fn(|c| before[c] + (after[c] - before[c]) * t)
}

/// To the nearest level; the cast cuts what the cubic overshoots.
fn rounded(values: [f32; 4]) -> [u8; 4] {
    values.map(|v| (v + 0.5) as u8)
}
