//! Format of a video: size, frame rate, pixel aspect.

use std::fmt;

use cairn::{Error, ErrorKind, Result};

/// Frames per second as an exact fraction in lowest terms, such as 30000/1001.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRate {
    numerator: u32,
    denominator: u32,
}

impl FrameRate {
    /// The highest rate, in frames per second.
    pub const MAX: u32 = 960;

    /// `numerator / denominator` frames per second.
    ///
    /// # Errors
    /// `InvalidArgument` for a rate of 0, above [`MAX`](Self::MAX), or of less than one frame an hour.
    pub fn new(numerator: u64, denominator: u64) -> Result<Self> {
        let refused = || {
            Error::new(
                ErrorKind::InvalidArgument,
                format!("{numerator}/{denominator} frames per second cannot be stored"),
            )
            .field("rate")
            .remedy(format!("Use a rate above 0 and at most {}, such as 30 or 30000/1001", Self::MAX))
        };
        if numerator == 0 || denominator == 0 {
            return Err(refused());
        }
        let common = greatest_common_divisor(numerator, denominator);
        let (n, d) = (numerator / common, denominator / common);
        let in_range = n <= d.saturating_mul(Self::MAX.into()) && d / n <= 3600;
        let (Ok(n), Ok(d), true) = (u32::try_from(n), u32::try_from(d), in_range) else { return Err(refused()) };
        Ok(Self { numerator: n, denominator: d })
    }

    /// Milliseconds between two frames.
    pub fn interval_ms(self) -> f32 {
        (1000.0 * f64::from(self.denominator) / f64::from(self.numerator)) as f32
    }

    /// Reads `30`, `30000/1001`, `30000:1001` or `29.97`.
    ///
    /// # Errors
    /// `InvalidArgument` when it is none of these, and as [`new`](Self::new).
    pub fn parse(text: &str) -> Result<Self> {
        let digits = |t: &str| t.parse::<u64>().ok().filter(|_| t.len() <= 12 && !t.starts_with('+'));
        let fraction = if let Some((n, d)) = text.split_once(['/', ':']) {
            digits(n).zip(digits(d))
        } else if let Some((whole, part)) = text.split_once('.') {
            let scale = 10_u64.pow(part.len().min(6) as u32);
            let decimal = digits(whole).zip(digits(part)).filter(|_| part.len() <= 6);
            decimal.and_then(|(w, p)| Some((w.checked_mul(scale)?.checked_add(p)?, scale)))
        } else {
            digits(text).map(|n| (n, 1))
        };
        let (n, d) = fraction.ok_or_else(|| {
            Error::new(ErrorKind::InvalidArgument, format!("{text:?} is no frame rate"))
                .field("rate")
                .remedy("Write frames per second, such as 30, 29.97 or 30000/1001")
        })?;
        Self::new(n, d)
    }

    /// `factor` times this rate, exactly.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn times(self, factor: u32) -> Result<Self> {
        Self::new(u64::from(self.numerator) * u64::from(factor), self.denominator.into())
    }

    /// Ticks per second of a clock on which every frame lasts [`denominator`](Self::denominator) ticks.
    pub fn numerator(self) -> u32 {
        self.numerator
    }

    /// See [`numerator`](Self::numerator).
    pub fn denominator(self) -> u32 {
        self.denominator
    }

    /// Frames per second, rounded up; at least 1.
    pub fn ceil(self) -> u32 {
        self.numerator.div_ceil(self.denominator)
    }

    /// Frames per second, to the nearest number a double can hold.
    pub fn per_second(self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }
}

impl fmt::Display for FrameRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.denominator {
            1 => write!(f, "{}", self.numerator),
            denominator => write!(f, "{}/{denominator}", self.numerator),
        }
    }
}

fn greatest_common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

/// Properties common to all frames of a video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VideoFormat {
    /// `(width, height)` in pixels.
    pub size: (u32, u32),
    /// Constant over the whole video.
    pub rate: FrameRate,
    /// Width over height of one pixel as shown; `(1, 1)` for square ones. Neither is 0.
    pub pixel_aspect: (u32, u32),
    /// AV1 quantiser, 0 (best) to 255.
    pub quantiser: u8,
}

impl VideoFormat {
    /// A quantiser at which 1080p is visually clean, about 4 Mbit/s for natural pictures.
    pub const CLEAN: u8 = 70;
    /// A quantiser for pages with many videos: a third of the bytes, and fine texture is a little softer.
    pub const SMALL: u8 = 120;

    /// Square pixels, visually clean.
    pub fn new(size: (u32, u32), rate: FrameRate) -> Self {
        Self { size, rate, pixel_aspect: (1, 1), quantiser: Self::CLEAN }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_exact_and_in_lowest_terms() {
        for (text, n, d) in [
            ("30", 30, 1),
            ("30000/1001", 30_000, 1001),
            ("60000:2002", 30_000, 1001),
            ("23.976", 2997, 125),
            ("29.97", 2997, 100),
            ("0.5", 1, 2),
        ] {
            let rate = FrameRate::parse(text).unwrap();
            assert_eq!((rate.numerator(), rate.denominator()), (n, d), "{text}");
        }
        let rate = FrameRate::parse("30000/1001").unwrap().times(4).unwrap();
        assert_eq!((rate.to_string(), rate.ceil()), ("120000/1001".into(), 120));
        assert_eq!(FrameRate::new(25, 1).unwrap().times(2).unwrap().to_string(), "50");
    }

    #[test]
    fn what_is_no_rate_is_refused_with_a_remedy() {
        for text in
            ["", "0", "30/0", "0:0", "-5", "+5", "1e9", "961", "fast", "30.", ".5", "1/3601", "99999999999999/1"]
        {
            let error = FrameRate::parse(text).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidArgument, "{text}");
            assert!(error.to_string().contains("30000/1001"), "{text}: {error}");
        }
        assert!(FrameRate::new(480, 1).unwrap().times(4).is_err());
    }
}
