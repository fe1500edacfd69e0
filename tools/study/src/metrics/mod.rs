//! Distance of a picture from the true one.
//!
//! | measure | range, better towards | what it is |
//! |---|---|---|
//! | [`psnr`] | 0 to infinity dB, up | peak signal-to-noise ratio over R, G and B, peak 255 |
//! | [`ssim`] | -1 to 1, up | structural similarity, Gaussian window of 11x11, mean of R, G and B |
//! | [`ms_ssim`] | 0 to 1, up | the same at five scales, each half of the one before |
//! | [`Lpips`] | 0 to about 1, down | LPIPS v0.1 with AlexNet or VGG16: how different people would find them |
//!
//! All of them read the three colour bytes as they are (display-referred sRGB) and leave alpha out. Both pictures must
//! have the same size. Every function may be called from any thread; the number of threads does not change a result.

mod lpips;
mod ms_ssim;
mod psnr;
mod score;
mod ssim;

use cairn::{Error, ErrorKind, Picture, Result};

pub use lpips::{Features, Lpips, Net};
pub(crate) use lpips::{check_weights, small_weights};
pub use ms_ssim::{MS_SSIM_SIDE, ms_ssim};
pub use psnr::{mean_squared_error, psnr};
pub use score::{MAX_PSNR, Score};
pub use ssim::{WINDOW as SSIM_WINDOW, ssim, ssim_rgb};

/// `InvalidArgument` unless both pictures have the same size.
fn same_size(truth: &Picture, picture: &Picture) -> Result<()> {
    if truth.size() == picture.size() {
        return Ok(());
    }
    Err(Error::new(
        ErrorKind::InvalidArgument,
        format!(
            "a picture of {} x {} pixels cannot be compared with a true one of {} x {}",
            picture.width(),
            picture.height(),
            truth.width(),
            truth.height()
        ),
    )
    .field("size")
    .remedy("Make both at the same size; scaling one of them would be measured as well"))
}
