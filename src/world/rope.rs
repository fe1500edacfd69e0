//! The angles of rotary position embedding: `docs/bundle.md`, section 5.

use std::f64::consts::PI;

use half::bf16;

use crate::bundle::{Geometry, Rounding};
use crate::{Error, ErrorKind, Result};

/// Cosines and sines of all tokens of a latent, at any RoPE time.
///
/// Angles are computed in f64 with the pure-Rust `libm` and rounded to f32: the same bits on every system. The part that depends on
/// a token's position is stored; the part that depends on time is computed for each latent, so time is unbounded.
#[derive(Debug, Clone)]
pub struct RopeTable {
    tokens: usize,
    /// P, the number of rotation pairs of a head.
    pairs: usize,
    /// Of each token's position, `[tokens, P / 2]`: half of a row for the token's column, half for its row.
    position_cos: Vec<f32>,
    position_sin: Vec<f32>,
    /// Time frequencies, `[P / 2]`.
    f_t: Vec<f64>,
}

impl RopeTable {
    /// The table of a world of this geometry.
    ///
    /// # Errors
    /// `InvalidBundle` for an inconsistent geometry, `OutOfMemory` when the table does not fit.
    pub fn new(geometry: &Geometry) -> Result<Self> {
        let wrong = |field: &str, cause: String| Error::new(ErrorKind::InvalidBundle, cause).field(field);
        if geometry.head_width == 0 || !geometry.head_width.is_multiple_of(8) {
            return Err(wrong("geometry.head_width", format!("{} is no multiple of 8", geometry.head_width)));
        }
        if geometry.patch.contains(&0) {
            return Err(wrong("geometry.patch", "a patch has no cells".into()));
        }
        let (rows, columns) = geometry.token_grid();
        let tokens = u64::from(rows) * u64::from(columns);
        if tokens == 0 || tokens != u64::from(geometry.tokens) {
            return Err(wrong(
                "geometry.tokens",
                format!("{} tokens do not fill a grid of {rows} x {columns}", geometry.tokens),
            ));
        }
        let rope = geometry.rope;
        if !(rope.nyquist_fraction.is_finite() && rope.time_base.is_finite() && rope.time_base > 0.0) {
            return Err(wrong("geometry.rope", "the constants are not finite and positive".into()));
        }

        let (tokens, pairs) = (geometry.tokens as usize, geometry.head_width as usize / 2);
        let round = |f: f64| match rope.rounding {
            Rounding::None => f,
            Rounding::Bf16 => f64::from(bf16::from_f32(f as f32)),
        };
        let mut f_xy = spatial_frequencies(pairs / 4, f64::from(rows.min(columns)) * rope.nyquist_fraction);
        f_xy.iter_mut().for_each(|f| *f = round(*f));
        assert_eq!(f_xy.len(), pairs / 4);
        let f_t: Vec<f64> = (0..pairs / 2)
            .map(|j| round(libm::pow(rope.time_base, -((2 * (j / 2)) as f64 / (pairs / 2) as f64))))
            .collect();

        let too_large =
            |_| Error::new(ErrorKind::OutOfMemory, "the table of RoPE angles does not fit").field("geometry.tokens");
        let len = tokens.saturating_mul(pairs / 2);
        let (mut position_cos, mut position_sin) = (Vec::new(), Vec::new());
        position_cos.try_reserve_exact(len).map_err(too_large)?;
        position_sin.try_reserve_exact(len).map_err(too_large)?;
        let centre = |index: u32, count: u32| (2.0 * f64::from(index) + 1.0) / f64::from(count) - 1.0;
        for row in 0..rows {
            for column in 0..columns {
                for position in [centre(column, columns), centre(row, rows)] {
                    position_cos.extend(f_xy.iter().map(|f| libm::cos(position * f) as f32));
                    position_sin.extend(f_xy.iter().map(|f| libm::sin(position * f) as f32));
                }
            }
        }
        assert_eq!(position_cos.len(), len);
        Ok(Self { tokens, pairs, position_cos, position_sin, f_t })
    }

    /// Number of values in each of the two outputs of [`RopeTable::fill`]: `tokens * head_width / 2`.
    pub fn len(&self) -> usize {
        self.tokens * self.pairs
    }

    /// Whether the table is empty; never true.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Writes `rope_cos` and `rope_sin`, each `[tokens, head_width / 2]`, for a latent at RoPE time `time`.
    ///
    /// # Errors
    /// `InvalidArgument` when an output has another length than [`RopeTable::len`].
    pub fn fill(&self, time: u64, cos: &mut [f32], sin: &mut [f32]) -> Result<()> {
        if cos.len() != self.len() || sin.len() != self.len() {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("RoPE angles need {} numbers, the outputs have {} and {}", self.len(), cos.len(), sin.len()),
            )
            .field("rope"));
        }
        let half = self.pairs / 2;
        for (out, spatial, function) in [
            (cos, &self.position_cos, libm::cos as fn(f64) -> f64),
            (sin, &self.position_sin, libm::sin as fn(f64) -> f64),
        ] {
            let (first, others) = out.split_at_mut(self.pairs);
            for (o, f) in first[half..].iter_mut().zip(&self.f_t) {
                *o = function(time as f64 * f) as f32;
            }
            for (token, row) in others.chunks_exact_mut(self.pairs).enumerate() {
                row[..half].copy_from_slice(&spatial[(token + 1) * half..][..half]);
                row[half..].copy_from_slice(&first[half..]);
            }
            first[..half].copy_from_slice(&spatial[..half]);
        }
        Ok(())
    }
}

/// `linspace(1, max_freq / 2, n) * pi`, each value twice, cut to `count`; `n = (count + 1) / 2`.
fn spatial_frequencies(count: usize, max_freq: f64) -> Vec<f64> {
    let n = count.div_ceil(2);
    let step = if n > 1 { (max_freq / 2.0 - 1.0) / (n - 1) as f64 } else { 0.0 };
    (0..count).map(|j| (1.0 + (j / 2) as f64 * step) * PI).collect()
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_1_SQRT_2;

    use super::*;
    use crate::world::fixture;

    fn geometry(rows: u32, columns: u32, head_width: u32) -> Geometry {
        let mut geometry = fixture::manifest().geometry;
        (geometry.latent.height, geometry.latent.width) = (rows * geometry.patch[0], columns * geometry.patch[1]);
        (geometry.tokens, geometry.head_width) = (rows * columns, head_width);
        geometry
    }

    fn angles(geometry: &Geometry, time: u64) -> (Vec<f32>, Vec<f32>) {
        let table = RopeTable::new(geometry).unwrap();
        let (mut cos, mut sin) = (vec![9.0; table.len()], vec![9.0; table.len()]);
        table.fill(time, &mut cos, &mut sin).unwrap();
        (cos, sin)
    }

    /// The formulas of docs/bundle.md, computed token by token without a table.
    #[test]
    fn the_table_follows_the_formula() {
        for (rows, columns, head_width) in [(16, 32, 64), (2, 4, 16), (8, 16, 24), (3, 5, 8), (1, 1, 40)] {
            for time in [0, 1, 17, 4096, 1_000_003] {
                let (cos, sin) = angles(&geometry(rows, columns, head_width), time);
                let pairs = head_width as usize / 2;
                for token in 0..rows * columns {
                    let (row, column) = (token / columns, token % columns);
                    for pair in 0..pairs {
                        let angle = if pair < pairs / 2 {
                            let (j, q) = (pair % (pairs / 4), pairs / 4);
                            let (index, count) = if pair < q { (column, columns) } else { (row, rows) };
                            let n = q.div_ceil(2);
                            let highest = f64::from(rows.min(columns)) * 0.8 / 2.0;
                            let part = if n == 1 { 0.0 } else { (j / 2) as f64 / (n - 1) as f64 };
                            let f = (1.0 + part * (highest - 1.0)) * PI;
                            (f64::from(2 * index + 1) / f64::from(count) - 1.0) * f
                        } else {
                            let j = pair - pairs / 2;
                            time as f64 * 10_000f64.powf(-((2 * (j / 2)) as f64) / (pairs / 2) as f64)
                        };
                        let at = token as usize * pairs + pair;
                        assert!((f64::from(cos[at]) - angle.cos()).abs() < 1e-7, "{rows}x{columns} {token} {pair}");
                        assert!((f64::from(sin[at]) - angle.sin()).abs() < 1e-7, "{rows}x{columns} {token} {pair}");
                    }
                }
            }
        }
    }

    /// Rows computed by numpy: for 720p geometry at a large time, and for the smallest head.
    #[test]
    fn rows_have_numpys_values() {
        let (cos, sin) = angles(&geometry(16, 32, 64), 1_000_003);
        let (row_cos, row_sin) = (&cos[77 * 32..78 * 32], &sin[77 * 32..78 * 32]);
        let golden_cos = [
            0.881_921_3,
            0.195_090_3,
            -0.634_393_3,
            -1.0,
            -0.555_570_2,
            0.972_369_9,
            -0.872_496,
            0.309_017,
            -0.877_986_5,
            -0.652_272_6,
            -0.965_290_3,
            0.920_990_5,
            -0.942_559_9,
            -0.270_720_3,
            0.559_895_9,
            -0.478_243,
        ];
        let golden_sin = [
            -0.471_396_7,
            -0.980_785_3,
            -0.773_010_4,
            0.0,
            -0.831_469_6,
            0.233_445_4,
            0.488_621_2,
            -0.951_056_5,
            0.478_685_4,
            0.757_984_5,
            -0.261_179_2,
            -0.389_585_1,
            -0.334_037_2,
            0.962_658,
            0.828_563,
            0.878_227_5,
        ];
        for pair in 0..32 {
            assert!((row_cos[pair] - golden_cos[pair / 2]).abs() < 1e-6, "cos {pair}");
            assert!((row_sin[pair] - golden_sin[pair / 2]).abs() < 1e-6, "sin {pair}");
        }
        let (cos, sin) = angles(&geometry(2, 4, 8), 5);
        for (row, golden) in [
            (&cos[24..28], [FRAC_1_SQRT_2, 0.0, 0.283_662_2, 0.283_662_2]),
            (&sin[24..28], [FRAC_1_SQRT_2, 1.0, -0.958_924_3, -0.958_924_3]),
        ] {
            for (ours, golden) in row.iter().zip(golden) {
                assert!((ours - golden).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn time_is_unbounded_and_rotates_only_its_own_pairs() {
        let geometry = geometry(2, 4, 16);
        let (early, _) = angles(&geometry, 0);
        let (late, late_sin) = angles(&geometry, u64::MAX);
        for (at, (a, b)) in early.iter().zip(&late).enumerate() {
            assert!(b.is_finite() && (at % 8 >= 4 || a == b));
        }
        assert!(late_sin.iter().all(|s| s.abs() <= 1.0));
        // Neighbouring times differ even where f32 cannot distinguish them.
        let time = 1 << 30;
        assert_ne!(angles(&geometry, time), angles(&geometry, time + 1));
    }

    #[test]
    fn bfloat16_frequencies_are_those_of_the_released_engine() {
        let mut geometry = geometry(2, 4, 16);
        geometry.rope.rounding = Rounding::Bf16;
        let table = RopeTable::new(&geometry).unwrap();
        // 10000 ^ -(0, 0, 1/2, 1/2): 0.01 is 0x3c24 in bfloat16.
        assert_eq!(table.f_t, [1.0, 1.0, 0.010_009_765_625, 0.010_009_765_625]);
        // pi is 0x4049 in bfloat16; the column centres of four are -3/4, -1/4, 1/4, 3/4.
        let (cos, _) = angles(&geometry, 0);
        assert_eq!(cos[0], libm::cos(0.75 * 3.140_625) as f32);
    }

    #[test]
    fn invalid_geometries_and_lengths_are_refused() {
        let good = geometry(2, 4, 16);
        let invalid: [fn(&mut Geometry); 7] = [
            |g| g.tokens = 7,
            |g| g.tokens = 0,
            |g| g.head_width = 12,
            |g| g.head_width = 0,
            |g| g.patch = [0, 2],
            |g| g.rope.time_base = 0.0,
            |g| g.rope.nyquist_fraction = f64::NAN,
        ];
        for alter in invalid {
            let mut bad = good.clone();
            alter(&mut bad);
            assert_eq!(RopeTable::new(&bad).unwrap_err().kind(), ErrorKind::InvalidBundle);
        }
        let table = RopeTable::new(&good).unwrap();
        assert!(!table.is_empty());
        assert!(table.fill(0, &mut vec![0.0; table.len() - 1], &mut vec![0.0; table.len()]).is_err());
        assert!(table.fill(0, &mut vec![0.0; table.len()], &mut vec![0.0; table.len() + 1]).is_err());
    }
}
