//! Measures of coherence and of cost.

use std::fmt;
use std::str::FromStr;

use cairn::{Error, Result};

use super::point::refused;
use crate::compare::budget::Budget;
use crate::compare::summary::RolloutMetrics;

/// Measure that ranks points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Measure {
    /// Seconds until nothing of the first view remains; see `RolloutMetrics::horizon`.
    Horizon,
    /// LPIPS against the truth; lower is better.
    Lpips,
    /// SSIM against the truth.
    Ssim,
    /// PSNR against the truth, in dB.
    Psnr,
}

impl Measure {
    pub(super) const ALL: [Self; 4] = [Self::Horizon, Self::Lpips, Self::Ssim, Self::Psnr];

    /// Name in files.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Horizon => "horizon",
            Self::Lpips => "lpips",
            Self::Ssim => "ssim",
            Self::Psnr => "psnr",
        }
    }

    /// Title of a chart's axis.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Horizon => "coherence horizon, s",
            Self::Lpips => "LPIPS to the truth",
            Self::Ssim => "SSIM to the truth",
            Self::Psnr => "PSNR to the truth, dB",
        }
    }

    pub(super) fn digits(self) -> usize {
        match self {
            Self::Horizon | Self::Psnr => 2,
            Self::Lpips | Self::Ssim => 4,
        }
    }

    pub(super) fn needs_lpips(self) -> bool {
        matches!(self, Self::Horizon | Self::Lpips)
    }

    /// Value of one rollout; `None` if it was not measured.
    pub(super) fn of(self, metrics: &RolloutMetrics) -> Option<f64> {
        match self {
            Self::Horizon => metrics.horizon,
            Self::Lpips => metrics.lpips,
            Self::Ssim => metrics.ssim,
            Self::Psnr => metrics.psnr,
        }
    }

    /// The value with the sign changed where needed, so that larger is better.
    pub(super) fn goodness(self, value: f64) -> f64 {
        if self == Self::Lpips { -value } else { value }
    }
}

impl fmt::Display for Measure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Measure {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|measure| measure.name() == text);
        found.map_or_else(
            || refused(format!("{text:?} is no measure"), "measure", "Use horizon, lpips, ssim or psnr"),
            Ok,
        )
    }
}

/// Measure of cost per second of world time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cost {
    /// Operations counted from the graphs: the same on every machine, without work outside of graphs.
    Gflop,
    /// Measured seconds of computing, including frame generation; affected by other load on the machine.
    Seconds,
}

impl Cost {
    pub(super) fn of(self, budget: &Budget) -> f64 {
        match self {
            Self::Gflop => budget.flops / 1e9,
            Self::Seconds => budget.times.sum(),
        }
    }

    /// Title of a chart's axis.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Gflop => "GFLOP for a second of world time",
            Self::Seconds => "seconds of computing for a second of world time",
        }
    }

    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Gflop => "GFLOP",
            Self::Seconds => "s",
        }
    }
}

impl FromStr for Cost {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "gflop" => Ok(Self::Gflop),
            "seconds" => Ok(Self::Seconds),
            _ => refused(format!("{text:?} is nothing to count compute in"), "cost", "Use gflop or seconds"),
        }
    }
}
