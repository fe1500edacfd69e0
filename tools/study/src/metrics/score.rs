//! The three measures of one picture together.

use cairn::{Picture, Result};
use serde::{Deserialize, Serialize};

use super::{psnr, ssim};

/// PSNR of equal pictures in means, in dB. No other pair of 8-bit pictures reaches it.
pub const MAX_PSNR: f64 = 100.0;

/// PSNR, SSIM and LPIPS of a picture against the true one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// In dB.
    pub psnr: f64,
    /// Structural similarity, -1 to 1.
    pub ssim: f64,
    /// `None` if LPIPS is not measured.
    pub lpips: Option<f64>,
}

impl Score {
    /// Scores `picture` with a PSNR of at most [`MAX_PSNR`], beside the `lpips` that the caller measured.
    ///
    /// # Errors
    /// `InvalidArgument` for pictures of different sizes.
    pub fn new(truth: &Picture, picture: &Picture, lpips: Option<f64>) -> Result<Self> {
        Ok(Self { psnr: psnr(truth, picture)?.min(MAX_PSNR), ssim: ssim(truth, picture)?, lpips })
    }
}
