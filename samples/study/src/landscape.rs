//! The built-in seed picture: a painted landscape, the same on every machine.

use cairn::{Picture, Result};

/// Hills behind one another, from the horizon to the viewer: base line, height, waves across, shift, colour.
const HILLS: [(f64, f64, f64, f64, [f64; 3]); 4] = [
    (0.52, 0.10, 2.3, 0.4, [0.52, 0.60, 0.74]),
    (0.60, 0.09, 3.1, 2.1, [0.38, 0.52, 0.56]),
    (0.70, 0.08, 2.2, 4.0, [0.29, 0.45, 0.33]),
    (0.84, 0.07, 1.7, 0.9, [0.22, 0.36, 0.18]),
];

const SUN: (f64, f64, f64) = (0.68, 0.27, 0.055);

/// Paints the landscape at `width` x `height` pixels. Sums of 3 x 3 samples smooth the edges.
///
/// # Errors
/// As [`Picture::new`].
pub(crate) fn paint(width: u32, height: u32) -> Result<Picture> {
    const GRID: u32 = 3;
    let mut picture = Picture::new(width, height)?;
    let aspect = f64::from(width) / f64::from(height);
    for (row, pixels) in picture.pixels_mut().chunks_exact_mut(width as usize).enumerate() {
        for (column, px) in pixels.iter_mut().enumerate() {
            let mut sum = [0.0; 3];
            for sample in 0..GRID * GRID {
                let at = |i: usize, part: u32| i as f64 + (f64::from(part) + 0.5) / f64::from(GRID);
                let x = at(column, sample % GRID) / f64::from(height);
                let y = at(row, sample / GRID) / f64::from(height);
                let colour = colour(x, y, aspect);
                (0..3).for_each(|c| sum[c] += colour[c]);
            }
            for c in 0..3 {
                px[c] = (255.0 * sum[c] / f64::from(GRID * GRID)).round().clamp(0.0, 255.0) as u8;
            }
        }
    }
    Ok(picture)
}

/// The colour at a place: x from 0 to `aspect`, y from 0 to 1, both in picture heights.
fn colour(x: f64, y: f64, aspect: f64) -> [f64; 3] {
    let mut paint = sky(x, y, aspect);
    for (i, (base, height, waves, shift, tint)) in HILLS.into_iter().enumerate() {
        let ridge = base - height * (wave(x * waves + shift) * 0.7 + wave(x * waves * 2.7 + shift * 3.0) * 0.3);
        if y > ridge {
            // Darker away from the ridge, with a faint grain of grass that grows towards the viewer.
            let depth = (y - ridge).min(0.3);
            let bend = 2.0 * wave(x * 3.7 + y * 1.3) + wave(y * 9.1 - x * 2.9);
            let grain = 0.012 * i as f64 * (wave(x * 41.0 + y * 13.0 + bend) + wave(x * 17.0 - y * 67.0 - 1.7 * bend));
            paint = tint.map(|c| c * (1.0 - 0.9 * depth) + grain);
        }
    }
    path(x, y, aspect, paint)
}

fn sky(x: f64, y: f64, aspect: f64) -> [f64; 3] {
    let t = (y / 0.6).min(1.0);
    let mut paint = mix([0.25, 0.45, 0.78], [0.95, 0.84, 0.70], t * t);
    let (dx, dy) = (x - SUN.0 * aspect, y - SUN.1);
    let distance = (dx * dx + dy * dy).sqrt();
    if distance < SUN.2 {
        return [1.0, 0.95, 0.80];
    }
    let glow = (1.0 - (distance - SUN.2) / 0.35).max(0.0);
    paint = mix(paint, [1.0, 0.92, 0.75], 0.5 * glow * glow);
    // Two flat clouds.
    for (cx, cy, long) in [(0.24, 0.18, 0.20), (0.47, 0.10, 0.13)] {
        let (u, v) = ((x - cx * aspect) / long, (y - cy) / 0.035);
        let edge = 1.0 - u * u - v * v + 0.35 * wave(x * 19.0 + cy * 40.0);
        paint = mix(paint, [0.99, 0.97, 0.95], (edge * 1.5).clamp(0.0, 0.85));
    }
    paint
}

/// A path that winds from the viewer to the third hill.
fn path(x: f64, y: f64, aspect: f64, ground: [f64; 3]) -> [f64; 3] {
    if y < 0.70 {
        return ground;
    }
    let near = (y - 0.70) / 0.30;
    let centre = 0.5 * aspect + 0.18 * wave(near * 1.3 + 0.2) * (1.0 - 0.5 * near);
    let half = 0.012 + 0.13 * near * near;
    let inside = 1.0 - ((x - centre) / half).abs();
    mix(ground, [0.72, 0.62, 0.45], (inside * 8.0).clamp(0.0, 1.0) * (0.35 + 0.65 * near).min(1.0))
}

fn mix(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * t)
}

/// A smooth wave of period 2 between -1 and 1. Only sums and products: the same bits with every maths library.
fn wave(x: f64) -> f64 {
    let phase = x - 2.0 * (x * 0.5).floor();
    let (half, sign) = if phase < 1.0 { (phase, 1.0) } else { (phase - 1.0, -1.0) };
    sign * 4.0 * half * (1.0 - half)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_landscape_is_the_same_everywhere() {
        let picture = paint(160, 90).unwrap();
        assert_eq!(crate::sha256(picture.rgba()), GOLDEN);
    }

    const GOLDEN: &str = "7bd874b4e2f10b266f7757b01594b0b0b4c1e5023d85cf765ba90e22f22e192e";

    #[test]
    fn it_has_sky_above_and_ground_below() {
        let picture = paint(64, 36).unwrap();
        let (top, bottom) = (picture.pixels()[0], picture.pixels()[64 * 36 - 1]);
        assert!(top[2] > top[0] && bottom[1] > bottom[2], "{top:?} {bottom:?}");
    }
}
