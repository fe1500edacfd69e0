//! Cases of motion and pictures that look random, some of them hostile.

use cairn::guidance::{DepthMap, Guidance, MotionField, paper};
use half::f16;

/// Numbers that look random, from a seed (SplitMix64).
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.bits() % end
    }

    /// From -1 to 1.
    pub(crate) fn part(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// Motion of several kinds: none to wild, with surfaces that meet; some of it hostile.
pub(crate) fn guidance(dice: &mut Dice, (width, height): (u32, u32)) -> Guidance {
    let tile = [1, 1, 1, 8, 16][dice.below(5) as usize];
    let mut motion = MotionField::tiled(width, height, tile).unwrap();
    let mut depth = DepthMap::tiled(width, height, [1, tile][dice.below(2) as usize], paper::PROJECTION).unwrap();
    let (is_flat, is_wild, is_hostile) = (dice.below(4) == 0, dice.below(5) == 0, dice.below(6) == 0);
    let reach = [0.0, 1.5, 9.0, 40.0][dice.below(4) as usize];
    let ground = [dice.part() * reach, dice.part() * reach];
    let slope = [0.0, 0.02, 0.2][dice.below(3) as usize] * dice.part();
    // At times the ground is one over which a camera goes forward and turns.
    let (ahead, turn) = ([0.0, 0.0, 0.4][dice.below(3) as usize] * dice.part(), dice.part() * 0.1);
    let near = |y: u32| 0.05 + 0.9 * y as f32 / height as f32;
    let walk = |x: u32, y: u32| {
        let (fx, fy) = (x as f32 / width as f32 - 0.5, y as f32 / height as f32);
        let whole = 1.0 + turn * fx + ahead * near(y);
        let was = [((fx + turn) / whole + 0.5) * width as f32, fy / whole * height as f32];
        [was[0] - x as f32, was[1] - y as f32]
    };
    let boxes: Vec<_> = (0..dice.below(5))
        .map(|_| {
            let (x, y) = (dice.below(width.into()) as u32, dice.below(height.into()) as u32);
            let size = [1, 3, 9, 30].map(|v| v + dice.below(9) as u32)[dice.below(4) as usize];
            let vector = [dice.part() * reach, dice.part() * reach];
            (x..x + size, y..y + size, vector, dice.part().abs())
        })
        .collect();
    let on = |x: u32, y: u32| boxes.iter().find(|(across, down, ..)| across.contains(&x) && down.contains(&y));
    let columns = motion.columns();
    for (i, vector) in motion.vectors_mut().iter_mut().enumerate() {
        let (x, y) = (i as u32 % columns * tile, i as u32 / columns * tile);
        let mut v = match on(x, y) {
            Some((.., vector, _)) => *vector,
            None if ahead != 0.0 => walk(x, y),
            None => [ground[0] + slope * x as f32, ground[1] - slope * y as f32],
        };
        if is_wild {
            v = v.map(|v| v + dice.part() * 3.0);
        }
        *vector = v.map(f16::from_f32);
        if is_hostile && dice.below(40) == 0 {
            *vector = [f16::from_bits(dice.bits() as u16), f16::from_bits(dice.bits() as u16)];
        }
    }
    let (columns, tile) = (depth.columns(), depth.tile());
    for (i, z) in depth.depth_mut().iter_mut().enumerate() {
        let (x, y) = (i as u32 % columns * tile, i as u32 / columns * tile);
        *z =
            if is_flat { 0.5 } else { on(x, y).map_or(if ahead == 0.0 { 0.999 } else { 1.0 - near(y) }, |(.., z)| *z) };
        if is_hostile && !is_flat && dice.below(40) == 0 {
            *z = f32::from_bits(dice.bits() as u32);
        }
    }
    if is_flat && boxes.len() % 2 == 1 {
        // Said, not only so.
        depth.fill(0.5);
    }
    Guidance::from_parts(motion, depth).unwrap()
}

/// Depths like those of the current anchor, with something in front.
pub(crate) fn previous_depth(dice: &mut Dice, current: &DepthMap) -> DepthMap {
    let mut depth = current.clone();
    let (columns, rows) = (u64::from(depth.columns()), u64::from(depth.rows()));
    let (x, y, z) = (dice.below(columns) as usize, dice.below(rows) as usize, dice.part().abs());
    let wide = 1 + dice.below(9) as usize;
    for row in depth.depth_mut().chunks_mut(columns as usize).skip(y) {
        row.iter_mut().skip(x).take(wide).for_each(|depth| *depth = depth.min(z));
    }
    depth
}

/// What lies over a picture: a few boxes, at times all of it or nothing.
pub(crate) fn overlay(dice: &mut Dice, (width, height): (u32, u32)) -> Vec<u8> {
    let boxes: Vec<_> = (0..dice.below(4))
        .map(|_| {
            let (x, y) = (dice.below(width.into()) as u32, dice.below(height.into()) as u32);
            let side = [1, 7, 20, 200][dice.below(4) as usize];
            (x..x + side, y..y + side / 2 + 1, 1 + dice.below(255) as u8)
        })
        .collect();
    let over = |x: u32, y: u32| boxes.iter().find(|(across, down, _)| across.contains(&x) && down.contains(&y));
    (0..width * height).map(|i| over(i % width, i / width).map_or(0, |(.., value)| *value)).collect()
}

/// Two pictures that have to do with each other, at times with bars or something that stands still.
pub(crate) fn pictures(dice: &mut Dice, (width, height): (u32, u32)) -> [Vec<[f32; 4]>; 2] {
    let waves: [f32; 6] = std::array::from_fn(|_| dice.part() * 0.4);
    let (bar, hud) = (dice.below(3) as u32 * dice.below(12) as u32, dice.below(2) * 12);
    let (shift, noise) = (dice.part() * 6.0, [0.0, 1.0, 30.0, 120.0][dice.below(4) as usize]);
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
                wave + if is_hud { 0.0 } else { noise * dice.part() }
            };
            [channel(0), channel(1), channel(2), 255.0]
        };
        (0..width * height).map(pixel).collect()
    })
}
