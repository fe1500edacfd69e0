//! What a point is judged by, and what it costs.

use std::fmt;
use std::str::FromStr;

use cairn::{Error, Result};

use super::plan::refused;
use crate::compare::budget::Budget;
use crate::compare::summary::Figures;

/// What decides which point is the better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Measure {
    /// Seconds until nothing is left of what the world knew in the beginning.
    Horizon,
    /// To the truth; lower is nearer.
    Lpips,
    /// To the truth.
    Ssim,
    /// To the truth, in dB.
    Psnr,
}

impl Measure {
    pub(super) const ALL: [Self; 4] = [Self::Horizon, Self::Lpips, Self::Ssim, Self::Psnr];

    /// As files name it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Horizon => "horizon",
            Self::Lpips => "lpips",
            Self::Ssim => "ssim",
            Self::Psnr => "psnr",
        }
    }

    /// For the axis of a drawing.
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

    /// Of one rollout; none where it was not measured.
    pub(super) fn of(self, figures: &Figures) -> Option<f64> {
        match self {
            Self::Horizon => figures.horizon,
            Self::Lpips => figures.lpips,
            Self::Ssim => figures.ssim,
            Self::Psnr => figures.psnr,
        }
    }

    /// The same number so that more of it is better.
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

/// What decides which point is the cheaper, for a second of world time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cost {
    /// Counted from the graphs: the same on every machine, without what runs outside of graphs.
    Gflop,
    /// Seconds of computing, as measured: with frame generation, and with all that shared the machine.
    Seconds,
}

impl Cost {
    pub(super) fn of(self, budget: &Budget) -> f64 {
        match self {
            Self::Gflop => budget.flops / 1e9,
            Self::Seconds => budget.times.sum(),
        }
    }

    /// For the axis of a drawing.
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
