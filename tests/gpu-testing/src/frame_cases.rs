//! Pseudo-random pairs of pictures with motion and depth. Some have invalid values.

use cairn::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, paper};
use half::f16;

/// Pseudo-random numbers from a seed (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `end`.
    pub fn below(&mut self, end: u64) -> u64 {
        self.next_u64() % end
    }

    /// A number from -1 to 1.
    pub fn signed_unit(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// Motion and depth of a ground with moving boxes in front of it: without motion, smooth or noisy, and sometimes with NaN, infinities and
/// depths outside of 0 to 1.
pub fn guidance(random: &mut Random, (width, height): (u32, u32)) -> Guidance {
    let tile = [1, 1, 1, 8, 16][random.below(5) as usize];
    let mut motion = MotionField::tiled(width, height, tile).unwrap();
    let mut depth = DepthMap::tiled(width, height, [1, tile][random.below(2) as usize], paper::PROJECTION).unwrap();
    let (is_flat, is_noisy, has_invalid_values) = (random.below(4) == 0, random.below(5) == 0, random.below(6) == 0);
    let reach = [0.0, 1.5, 9.0, 40.0][random.below(4) as usize];
    let ground = [random.signed_unit() * reach, random.signed_unit() * reach];
    let slope = [0.0, 0.02, 0.2][random.below(3) as usize] * random.signed_unit();
    // In some cases the motion of the ground is that of a camera that moves forward and turns.
    let (ahead, turn) = ([0.0, 0.0, 0.4][random.below(3) as usize] * random.signed_unit(), random.signed_unit() * 0.1);
    let near = |y: u32| 0.05 + 0.9 * y as f32 / height as f32;
    let camera_motion = |x: u32, y: u32| {
        let (fx, fy) = (x as f32 / width as f32 - 0.5, y as f32 / height as f32);
        let whole = 1.0 + turn * fx + ahead * near(y);
        let was = [((fx + turn) / whole + 0.5) * width as f32, fy / whole * height as f32];
        [was[0] - x as f32, was[1] - y as f32]
    };
    let boxes: Vec<_> = (0..random.below(5))
        .map(|_| {
            let (x, y) = (random.below(width.into()) as u32, random.below(height.into()) as u32);
            let size = [1, 3, 9, 30].map(|v| v + random.below(9) as u32)[random.below(4) as usize];
            let vector = [random.signed_unit() * reach, random.signed_unit() * reach];
            (x..x + size, y..y + size, vector, random.signed_unit().abs())
        })
        .collect();
    let on = |x: u32, y: u32| boxes.iter().find(|(across, down, ..)| across.contains(&x) && down.contains(&y));
    let columns = motion.columns();
    for (i, vector) in motion.vectors_mut().iter_mut().enumerate() {
        let (x, y) = (i as u32 % columns * tile, i as u32 / columns * tile);
        let mut v = match on(x, y) {
            Some((.., vector, _)) => *vector,
            None if ahead != 0.0 => camera_motion(x, y),
            None => [ground[0] + slope * x as f32, ground[1] - slope * y as f32],
        };
        if is_noisy {
            v = v.map(|v| v + random.signed_unit() * 3.0);
        }
        *vector = v.map(f16::from_f32);
        if has_invalid_values && random.below(40) == 0 {
            *vector = [f16::from_bits(random.next_u64() as u16), f16::from_bits(random.next_u64() as u16)];
        }
    }
    let (columns, tile) = (depth.columns(), depth.tile());
    for (i, z) in depth.depth_mut().iter_mut().enumerate() {
        let (x, y) = (i as u32 % columns * tile, i as u32 / columns * tile);
        *z =
            if is_flat { 0.5 } else { on(x, y).map_or(if ahead == 0.0 { 0.999 } else { 1.0 - near(y) }, |(.., z)| *z) };
        if has_invalid_values && !is_flat && random.below(40) == 0 {
            *z = f32::from_bits(random.next_u64() as u32);
        }
    }
    let mut origin = MotionOrigin::Geometry;
    if is_flat && boxes.len() % 2 == 1 {
        // Marks the depth as constant. A depth map whose values only happen to be equal is not marked.
        depth.fill(0.5);
        origin = MotionOrigin::OpticalFlow;
    }
    Guidance::from_parts(motion, depth, origin).unwrap()
}

/// The depths of the current anchor, with a box in front of them.
pub fn previous_depth(random: &mut Random, current: &DepthMap) -> DepthMap {
    let mut depth = current.clone();
    let (columns, rows) = (u64::from(depth.columns()), u64::from(depth.rows()));
    let (x, y, z) = (random.below(columns) as usize, random.below(rows) as usize, random.signed_unit().abs());
    let wide = 1 + random.below(9) as usize;
    for row in depth.depth_mut().chunks_mut(columns as usize).skip(y) {
        row.iter_mut().skip(x).take(wide).for_each(|depth| *depth = depth.min(z));
    }
    depth
}

/// An overlay mask: up to three boxes, which may cover the whole picture.
pub fn overlay(random: &mut Random, (width, height): (u32, u32)) -> Vec<u8> {
    let boxes: Vec<_> = (0..random.below(4))
        .map(|_| {
            let (x, y) = (random.below(width.into()) as u32, random.below(height.into()) as u32);
            let side = [1, 7, 20, 200][random.below(4) as usize];
            (x..x + side, y..y + side / 2 + 1, 1 + random.below(255) as u8)
        })
        .collect();
    let over = |x: u32, y: u32| boxes.iter().find(|(across, down, _)| across.contains(&x) && down.contains(&y));
    (0..width * height).map(|i| over(i % width, i / width).map_or(0, |(.., value)| *value)).collect()
}

/// Two related pictures of waves, some with noise, with black bars at the top and bottom or with a static overlay.
pub fn pictures(random: &mut Random, (width, height): (u32, u32)) -> [Vec<[f32; 4]>; 2] {
    let waves: [f32; 6] = std::array::from_fn(|_| random.signed_unit() * 0.4);
    let (bar, hud) = (random.below(3) as u32 * random.below(12) as u32, random.below(2) * 12);
    let (shift, noise) = (random.signed_unit() * 6.0, [0.0, 1.0, 30.0, 120.0][random.below(4) as usize]);
    [0.0, shift].map(|shift| {
        let pixel = |i: u32| {
            let (x, y) = (i % width, i / width);
            if y < bar || y + bar >= height && bar > 0 {
                return [0.0, 0.0, 0.0, 255.0];
            }
            let is_hud = u64::from(x) < hud && u64::from(y) < hud + 10;
            let (fx, fy) = (x as f32 - if is_hud { 0.0 } else { shift }, y as f32);
            let mut channel = |c: usize| {
                let wave = 127.0 + 100.0 * (fx * waves[c] + fy * waves[c + 3]).sin();
                wave + if is_hud { 0.0 } else { noise * random.signed_unit() }
            };
            [channel(0), channel(1), channel(2), 255.0]
        };
        (0..width * height).map(pixel).collect()
    })
}
