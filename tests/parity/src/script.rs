//! The script of every trace: pictures and controls that differ from latent to latent and are equal on every machine.

use cairn::world::{ControlInput, Key, KeySet};
use cairn::{Picture, Result};

/// A small generator of whole numbers (xorshift64*), seeded by the latent.
struct Numbers(u64);

impl Numbers {
    fn new(latent: u64) -> Self {
        let mut numbers = Self((latent + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        // The first results of neighbouring seeds are similar.
        (0..4).for_each(|_| _ = numbers.below(2));
        numbers
    }

    /// 0 to `limit - 1`.
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32) % limit
    }
}

/// Controls of latent `latent`: mouse up to 32 counts each way in halves, up to four keys, and the wheel.
///
/// # Errors
/// None for these ranges; the type is [`ControlInput::new`]'s.
pub(crate) fn controls(latent: u64) -> Result<ControlInput> {
    let mut numbers = Numbers::new(latent);
    let mut counts = || numbers.below(129) as f32 / 2.0 - 32.0;
    let mouse = [counts(), counts()];
    let held = numbers.below(5);
    let keys: KeySet = (0..held).map(|_| Key(numbers.below(256) as u8)).collect();
    ControlInput::new(mouse, keys, numbers.below(3) as f32 - 1.0)
}

/// The picture appended as latent `latent`: a coloured ramp with speckles. Its size is not the autoencoder's, so
/// it must be resized: the first to more pixels, later ones to fewer.
///
/// # Errors
/// `OutOfMemory` when it cannot be allocated.
pub(crate) fn picture(latent: u64) -> Result<Picture> {
    let (width, height) = if latent == 0 { (96, 54) } else { (210, 130) };
    let mut numbers = Numbers::new(latent);
    let base: [u64; 3] = [numbers.below(128), numbers.below(128), numbers.below(128)];
    let mut picture = Picture::new(width, height)?;
    for (i, pixel) in (0u64..).zip(picture.pixels_mut()) {
        let ramp = [i % u64::from(width), i / u64::from(width), i % 64];
        for channel in 0..3 {
            pixel[channel] = (base[channel] + ramp[channel] / 2 + numbers.below(48)).min(255) as u8;
        }
    }
    Ok(picture)
}
