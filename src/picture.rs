//! Pictures: rows of RGBA pixels in memory.

use bytemuck::{Pod, Zeroable, cast_slice, cast_slice_mut};
use half::f16;

use crate::{Error, ErrorKind, Result};

/// Maximum width and height of a picture, in pixels.
pub const MAX_SIDE: u32 = 16_384;

/// An 8-bit RGBA picture. Colour is display-referred sRGB.
pub type Picture = Raster<[u8; 4]>;

/// An RGBA picture in half floats. Whether colour is linear or display-referred is up to its producer; values may lie outside
/// [0, 1].
pub type PictureF16 = Raster<[f16; 4]>;

/// Pixel type of a [`Raster`]: `[u8; 4]` or `[f16; 4]`, red, green, blue and alpha.
pub trait Pixel: Pod + PartialEq + std::fmt::Debug + Send + Sync + sealed::Sealed {
    /// Type of one channel.
    type Channel: Pod + PartialEq + std::fmt::Debug + Send + Sync;

    /// Opaque black.
    const OPAQUE_BLACK: Self;

    #[doc(hidden)]
    const RASTER: &str;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for [u8; 4] {}
    impl Sealed for [half::f16; 4] {}
}

impl Pixel for [u8; 4] {
    type Channel = u8;
    const OPAQUE_BLACK: Self = [0, 0, 0, 255];
    const RASTER: &str = "Picture";
}

impl Pixel for [f16; 4] {
    type Channel = f16;
    const OPAQUE_BLACK: Self = [f16::ZERO, f16::ZERO, f16::ZERO, f16::ONE];
    const RASTER: &str = "PictureF16";
}

/// A picture of RGBA pixels. Rows run top to bottom without padding.
#[derive(Clone, PartialEq, Eq)]
pub struct Raster<P: Pixel> {
    width: u32,
    height: u32,
    channels: Vec<P::Channel>,
}

impl<P: Pixel> Raster<P> {
    /// An opaque black picture of `width` x `height` pixels, each 1 to [`MAX_SIDE`].
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside that range, `OutOfMemory` when it cannot be allocated.
    pub fn new(width: u32, height: u32) -> Result<Self> {
        let len = checked_len(width, height)?;
        let mut channels = Vec::new();
        channels.try_reserve_exact(len).map_err(|_| {
            let bytes = len * size_of::<P::Channel>();
            Error::new(ErrorKind::OutOfMemory, format!("a picture of {width} x {height} needs {bytes} bytes"))
        })?;
        channels.resize(len, Zeroable::zeroed());
        let mut raster = Self { width, height, channels };
        raster.pixels_mut().fill(P::OPAQUE_BLACK);
        Ok(raster)
    }

    /// A picture from `channels`: `width * height * 4` values of tightly packed rows.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`] or a buffer of another length.
    pub fn from_channels(width: u32, height: u32, channels: Vec<P::Channel>) -> Result<Self> {
        let len = checked_len(width, height)?;
        if channels.len() != len {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a picture of {width} x {height} has {len} channel values, the buffer has {}", channels.len()),
            ));
        }
        Ok(Self { width, height, channels })
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// `(width, height)` in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// All values, row by row, four to a pixel.
    pub fn channels(&self) -> &[P::Channel] {
        &self.channels
    }

    /// All values, writable.
    pub fn channels_mut(&mut self) -> &mut [P::Channel] {
        &mut self.channels
    }

    /// The pixels, row by row.
    pub fn pixels(&self) -> &[P] {
        cast_slice(&self.channels)
    }

    /// The pixels, writable.
    pub fn pixels_mut(&mut self) -> &mut [P] {
        cast_slice_mut(&mut self.channels)
    }
}

impl Picture {
    /// A picture from `rgba`: `width * height * 4` bytes of tightly packed rows.
    ///
    /// # Errors
    /// As [`from_channels`](Self::from_channels).
    pub fn from_rgba(width: u32, height: u32, rgba: Vec<u8>) -> Result<Self> {
        Self::from_channels(width, height, rgba)
    }

    /// All bytes, row by row, four to a pixel.
    pub fn rgba(&self) -> &[u8] {
        self.channels()
    }

    /// All bytes, writable.
    pub fn rgba_mut(&mut self) -> &mut [u8] {
        self.channels_mut()
    }
}

/// The number of channel values of a picture.
fn checked_len(width: u32, height: u32) -> Result<usize> {
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        return Err(Error::new(
            ErrorKind::InvalidArgument,
            format!("a picture of {width} x {height} pixels cannot be made"),
        )
        .field("size")
        .remedy(format!("Use a width and a height from 1 to {MAX_SIDE}")));
    }
    Ok(width as usize * height as usize * 4)
}

impl<P: Pixel> std::fmt::Debug for Raster<P> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}({} x {})", P::RASTER, self.width, self.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_picture_is_opaque_black() {
        assert!(Picture::new(3, 2).unwrap().pixels().iter().all(|p| *p == [0, 0, 0, 255]));
        let half = PictureF16::new(3, 2).unwrap();
        assert_eq!((half.size(), half.channels().len(), half.pixels().len()), ((3, 2), 24, 6));
        assert!(half.pixels().iter().all(|p| *p == [f16::ZERO, f16::ZERO, f16::ZERO, f16::ONE]));
        assert_eq!(format!("{half:?}"), "PictureF16(3 x 2)");
    }

    #[test]
    fn buffers_of_another_length_and_impossible_sizes_are_refused() {
        assert_eq!(Picture::from_rgba(3, 2, vec![0; 23]).unwrap_err().kind(), ErrorKind::InvalidArgument);
        assert!(PictureF16::from_channels(3, 2, vec![f16::ONE; 24]).is_ok());
        for (width, height) in [(0, 1), (1, 0), (MAX_SIDE + 1, 1)] {
            assert_eq!(PictureF16::new(width, height).unwrap_err().offending_field(), Some("size"));
        }
    }
}
