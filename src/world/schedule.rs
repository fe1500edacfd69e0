//! Noise schedules: the noise levels of a latent step, exact first, then rounded as in training.

use std::fmt;
use std::str::FromStr;

use half::bf16;

use crate::bundle::{Rounding, Sampler};
use crate::world::time::clip;
use crate::{Error, ErrorKind, Result};

/// Maximum number of points of a schedule, its final 0 included.
pub const MAX_POINTS: usize = 64;

/// How the noise levels of a latent step are chosen.
#[derive(Debug, Clone, PartialEq)]
pub enum Schedule {
    /// The bundle's own list.
    Stock,
    /// The bundle's list, whose widest interval is split at its middle (ties: the earlier one) until there are this many denoise
    /// passes: from the stock number of passes, at least 4, to 63. The paper does not define its schedule; this is our
    /// interpretation.
    Refined(u32),
    /// A custom list: 2 to 64 finite numbers, strictly descending, the first at most 1, the last exactly 0.
    Explicit(Vec<f64>),
}

/// Noise levels as passed to the graphs: n + 1 levels and the n differences of neighbours.
#[derive(Debug, Clone, PartialEq)]
pub struct SigmaTable {
    /// Strictly descending, the last is 0.
    pub sigmas: Vec<f32>,
    /// `sigmas[i + 1] - sigmas[i]`, all negative.
    pub dsigmas: Vec<f32>,
}

impl SigmaTable {
    /// Denoise passes of a latent step.
    pub fn passes(&self) -> usize {
        self.dsigmas.len()
    }
}

impl Schedule {
    /// The complete list before rounding: each point is the f64 nearest to its exact value.
    ///
    /// # Errors
    /// `InvalidArgument` when the schedule, or the stock list that it starts from, breaks the rules of its variant.
    pub fn points(&self, sampler: &Sampler) -> Result<Vec<f64>> {
        let (list, field) = match self {
            Self::Stock | Self::Refined(_) => (&sampler.schedule, "sampler.schedule"),
            Self::Explicit(points) => (points, "schedule"),
        };
        check_points(list, field)?;
        match self {
            Self::Refined(passes) => refine(list, *passes),
            // Normalises -0 to 0.
            Self::Stock | Self::Explicit(_) => Ok(list.iter().map(|point| point.abs()).collect()),
        }
    }

    /// The complete list and its differences, rounded as `sampler.sigma_rounding` says. The differences are computed from the
    /// rounded levels and rounded to the same type, as the released engine does.
    ///
    /// # Errors
    /// As [`Schedule::points`], and `InvalidArgument` when two neighbours become equal by the rounding.
    pub fn table(&self, sampler: &Sampler) -> Result<SigmaTable> {
        let round = |x: f32| match sampler.sigma_rounding {
            Rounding::None => x,
            Rounding::Bf16 => bf16::from_f32(x).to_f32(),
        };
        let sigmas: Vec<f32> = self.points(sampler)?.into_iter().map(|p| round(p as f32)).collect();
        let dsigmas: Vec<f32> = sigmas.windows(2).map(|pair| round(pair[1] - pair[0])).collect();
        if let Some(i) = dsigmas.iter().position(|d| *d >= 0.0) {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("points {i} and {} of the schedule are equal after rounding", i + 1),
            )
            .field("schedule")
            .remedy("Use fewer points, or points that lie farther apart"));
        }
        Ok(SigmaTable { sigmas, dsigmas })
    }
}

/// Maximum number of schedules that a budget may choose from.
const MAX_ALTERNATIVES: usize = 8;

/// The number of passes of each of `schedules`, which must descend. `field` names the schedules in errors.
pub(super) fn pass_counts(schedules: &[Schedule], sampler: &Sampler, field: &str) -> Result<Vec<u32>> {
    let refuse = |why: String| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
    if schedules.len() > MAX_ALTERNATIVES {
        return refuse(format!("{} are more than {MAX_ALTERNATIVES}", schedules.len()));
    }
    let passes = |schedule: &Schedule| Ok(schedule.table(sampler)?.passes() as u32);
    let passes = schedules.iter().map(passes).collect::<Result<Vec<_>>>()?;
    if !passes.windows(2).all(|pair| pair[0] > pair[1]) {
        return refuse(format!("{passes:?} passes: each must have fewer than the one before"));
    }
    Ok(passes)
}

fn check_points(points: &[f64], field: &str) -> Result<()> {
    let wrong = |cause: String| {
        Error::new(ErrorKind::InvalidArgument, cause)
            .field(field)
            .remedy("Give 2 to 64 finite numbers, strictly descending, the first at most 1 and the last exactly 0")
    };
    if points.len() < 2 || points.len() > MAX_POINTS {
        return Err(wrong(format!("a schedule of {} points cannot be used", points.len())));
    }
    if let Some(i) = points.iter().position(|p| !p.is_finite()) {
        return Err(wrong(format!("point {i} of the schedule is not finite")));
    }
    if points[0] > 1.0 {
        return Err(wrong(format!("the schedule starts at {}", points[0])));
    }
    if let Some(i) = points.windows(2).position(|pair| pair[0] <= pair[1]) {
        return Err(wrong(format!("the schedule does not descend from point {i} to point {}", i + 1)));
    }
    match points.last() {
        Some(last) if *last == 0.0 => Ok(()),
        last => Err(wrong(format!("the schedule ends at {last:?}"))),
    }
}

/// Decimals of a stock point that are represented exactly. A point with more is an error.
const DECIMALS: u32 = 17;
/// Refinement computes in fixed-point numbers with this many units in 1. A stock point is a decimal, and no point is the result of
/// more than 63 halvings, so all points are exact.
const UNIT: u128 = 10u128.pow(DECIMALS) << 63;

fn refine(stock: &[f64], passes: u32) -> Result<Vec<f64>> {
    let (min, max) = ((stock.len() - 1).max(4), MAX_POINTS - 1);
    let wanted = passes as usize;
    if wanted < min || wanted > max {
        return Err(Error::new(ErrorKind::InvalidArgument, format!("refined:{passes} is out of range"))
            .field("schedule")
            .remedy(format!("Use refined:{min} to refined:{max}")));
    }
    let mut points = Vec::with_capacity(wanted + 1);
    for &point in stock {
        points.push(to_fixed_point(point.abs())?);
    }
    while points.len() <= wanted {
        let mut widest = 0;
        for i in 1..points.len() - 1 {
            if points[i] - points[i + 1] > points[widest] - points[widest + 1] {
                widest = i;
            }
        }
        // Exact: a sum of two points is odd only after 63 halvings in a row.
        let middle = (points[widest] + points[widest + 1]) / 2;
        points.insert(widest + 1, middle);
    }
    Ok(points.into_iter().map(nearest_f64).collect())
}

/// A point in units of 1 / [`UNIT`], read from the shortest decimal that parses to `point`.
fn to_fixed_point(point: f64) -> Result<u128> {
    let text = point.to_string();
    let (whole, decimals) = text.split_once('.').unwrap_or((&text, ""));
    let numerator = (decimals.len() <= DECIMALS as usize)
        .then(|| format!("{whole}{decimals:0<width$}", width = DECIMALS as usize).parse::<u128>().ok())
        .flatten();
    // At most 1, so at most 10^17 before the shift.
    numerator.map(|n| n << 63).ok_or_else(|| {
        Error::new(ErrorKind::InvalidArgument, format!("{point} has more than {DECIMALS} decimals"))
            .field("sampler.schedule")
            .remedy("Shorten the number, or use an explicit schedule")
    })
}

/// The f64 nearest to `units / UNIT`, ties to even; `units` is at most [`UNIT`]. Long division, bit by bit.
fn nearest_f64(units: u128) -> f64 {
    if units == 0 {
        return 0.0;
    }
    let (mut remainder, mut exponent) = (units, 0);
    while remainder < UNIT {
        remainder *= 2;
        exponent -= 1;
    }
    remainder -= UNIT;
    let mut mantissa = 1u64;
    for _ in 0..52 {
        remainder *= 2;
        mantissa *= 2;
        if remainder >= UNIT {
            remainder -= UNIT;
            mantissa += 1;
        }
    }
    remainder *= 2;
    if remainder > UNIT || (remainder == UNIT && mantissa % 2 == 1) {
        mantissa += 1;
    }
    mantissa as f64 * 2f64.powi(exponent - 52)
}

impl fmt::Display for Schedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stock => f.write_str("stock"),
            Self::Refined(passes) => write!(f, "refined:{passes}"),
            Self::Explicit(points) => {
                f.write_str("explicit")?;
                points.iter().try_for_each(|point| write!(f, ":{point}"))
            }
        }
    }
}

impl FromStr for Schedule {
    type Err = Error;

    /// Reads `stock`, `refined:10` or `explicit:1:0.9:0.75:0.3:0`.
    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::new(ErrorKind::InvalidArgument, format!("{:?} is no schedule", clip(text)))
                .field("schedule")
                .remedy("Write stock, refined:10, or explicit:1:0.9:0.75:0.3:0")
        };
        if text == "stock" {
            return Ok(Self::Stock);
        }
        if let Some(passes) = text.strip_prefix("refined:") {
            return passes.parse().map(Self::Refined).map_err(|_| wrong());
        }
        let list = text.strip_prefix("explicit:").ok_or_else(wrong)?;
        if list.split(':').count() > MAX_POINTS {
            return Err(wrong());
        }
        let points = list.split(':').map(|p| p.parse::<f64>().map_err(|_| wrong())).collect::<Result<Vec<_>>>()?;
        check_points(&points, "schedule")?;
        Ok(Self::Explicit(points))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waypoint(sigma_rounding: Rounding) -> Sampler {
        Sampler { schedule: vec![1.0, 0.9, 0.75, 0.3, 0.0], sigma_rounding }
    }

    fn refined(passes: u32) -> Vec<f64> {
        Schedule::Refined(passes).points(&waypoint(Rounding::None)).unwrap()
    }

    #[test]
    fn refined_schedules_have_the_documented_points() {
        assert_eq!(refined(4), [1.0, 0.9, 0.75, 0.3, 0.0]);
        assert_eq!(refined(9), [1.0, 0.9, 0.825, 0.75, 0.6375, 0.525, 0.4125, 0.3, 0.15, 0.0]);
        assert_eq!(refined(10), [1.0, 0.9, 0.825, 0.75, 0.6375, 0.525, 0.4125, 0.3, 0.225, 0.15, 0.0]);
        assert_eq!(refined(12), [1.0, 0.9, 0.825, 0.75, 0.69375, 0.6375, 0.525, 0.4125, 0.3, 0.225, 0.15, 0.075, 0.0]);
    }

    /// 0.9 - 0.75 and 0.3 - 0.15 are equal as decimals but not as floats: only exact arithmetic breaks the tie early.
    #[test]
    fn ties_are_broken_by_exact_values() {
        assert_eq!(refined(8), [1.0, 0.9, 0.75, 0.6375, 0.525, 0.4125, 0.3, 0.15, 0.0]);
        let thirds = Sampler { schedule: vec![0.9, 0.6, 0.3, 0.0], sigma_rounding: Rounding::None };
        assert_eq!(Schedule::Refined(4).points(&thirds).unwrap(), [0.9, 0.75, 0.6, 0.3, 0.0]);
        assert_eq!(Schedule::Refined(5).points(&thirds).unwrap(), [0.9, 0.75, 0.6, 0.45, 0.3, 0.0]);
    }

    /// Compares with a second implementation that keeps fractions as numerators over 2^20 * 1000.
    #[test]
    fn every_refinement_matches_a_second_implementation() {
        let mut fractions: Vec<u64> = [1000u64, 900, 750, 300, 0].map(|p| p << 20).to_vec();
        for passes in 4..=63 {
            let ours = refined(passes);
            assert_eq!(ours.len(), passes as usize + 1);
            for (a, b) in ours.iter().zip(&fractions) {
                assert_eq!(*a, *b as f64 / f64::from(1000 << 20));
            }
            let (at, _) = fractions.windows(2).enumerate().fold((0, 0), |(best, width), (i, w)| {
                if w[0] - w[1] > width { (i, w[0] - w[1]) } else { (best, width) }
            });
            fractions.insert(at + 1, u64::midpoint(fractions[at], fractions[at + 1]));
        }
    }

    #[test]
    fn bf16_rounding_gives_the_reference_values() {
        let table = Schedule::Stock.table(&waypoint(Rounding::Bf16)).unwrap();
        assert_eq!(table.sigmas, [1.0, 0.898_437_5, 0.75, 0.300_781_25, 0.0]);
        assert_eq!(table.dsigmas, [-0.101_562_5, -0.148_437_5, -0.449_218_75, -0.300_781_25]);
        assert_eq!(table.passes(), 4);
    }

    #[test]
    fn without_rounding_levels_are_f32() {
        let table = Schedule::Stock.table(&waypoint(Rounding::None)).unwrap();
        assert_eq!(table.sigmas, [1.0f32, 0.9, 0.75, 0.3, 0.0]);
        for (d, expected) in table.dsigmas.iter().zip([-0.1f32, -0.15, -0.45, -0.3]) {
            assert!((d - expected).abs() < 1e-7);
        }
    }

    #[test]
    fn points_that_are_equal_after_rounding_are_refused() {
        let close = Schedule::Explicit(vec![1.0, 0.9, 0.8999, 0.0]);
        assert!(close.table(&waypoint(Rounding::None)).is_ok());
        let error = close.table(&waypoint(Rounding::Bf16)).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        assert_eq!(error.offending_field(), Some("schedule"));
    }

    #[test]
    fn a_negative_zero_is_zero() {
        let sampler = Sampler { schedule: vec![1.0, 0.9, 0.75, 0.3, -0.0], sigma_rounding: Rounding::None };
        for schedule in [Schedule::Stock, Schedule::Refined(5), "explicit:1:0.5:-0".parse().unwrap()] {
            assert_eq!(schedule.table(&sampler).unwrap().sigmas.last().unwrap().to_bits(), 0);
        }
    }

    #[test]
    fn invalid_lists_are_refused() {
        let nan = f64::NAN;
        for bad in [
            vec![],
            vec![0.0],
            vec![1.0, 0.5],
            vec![1.1, 0.0],
            vec![1.0, 1.0, 0.0],
            vec![0.5, 0.6, 0.0],
            vec![1.0, nan, 0.0],
            vec![f64::INFINITY, 0.0],
            vec![1.0, 1e-300],
            vec![1.0, 0.0, -1.0],
            (0..=64).map(|i| 1.0 - f64::from(i) / 64.0).collect(),
        ] {
            assert!(Schedule::Explicit(bad.clone()).table(&waypoint(Rounding::None)).is_err(), "{bad:?}");
            let sampler = Sampler { schedule: bad, sigma_rounding: Rounding::None };
            assert!(Schedule::Stock.table(&sampler).is_err());
            assert!(Schedule::Refined(9).table(&sampler).is_err());
        }
        for passes in [0, 3, 64, u32::MAX] {
            assert!(Schedule::Refined(passes).table(&waypoint(Rounding::None)).is_err());
        }
        let tiny = Sampler { schedule: vec![1.0, 1e-300, 0.0], sigma_rounding: Rounding::None };
        assert!(Schedule::Refined(9).points(&tiny).is_err());
    }

    #[test]
    fn conversion_to_f64_rounds_as_the_decimal_parser_does() {
        for text in ["0.1", "0.3", "0.6375", "0.86113630000000001", "0.00000000000000001", "1", "0.99999999999999999"] {
            let value: f64 = text.parse().unwrap();
            let (whole, decimals) = text.split_once('.').unwrap_or((text, ""));
            let units = format!("{whole}{decimals:0<17}").parse::<u128>().unwrap() << 63;
            assert_eq!(nearest_f64(units), value, "{text}");
        }
    }

    #[test]
    fn text_reads_back() {
        for text in ["stock", "refined:10", "explicit:1:0.9:0.75:0.3:0"] {
            assert_eq!(text.parse::<Schedule>().unwrap().to_string(), text);
        }
        for bad in ["", "Stock", "refined", "refined:", "refined:-1", "explicit:", "explicit:1:nan:0", "explicit:0.9"] {
            assert!(bad.parse::<Schedule>().is_err(), "{bad:?}");
        }
    }
}
