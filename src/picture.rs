//! The picture every room passes on: 8-bit RGBA rows in memory.

use crate::{Error, ErrorKind, Result};

/// The largest width or height a picture may have, in pixels.
pub const MAX_SIDE: u32 = 16_384;

/// An 8-bit RGBA picture. Colour is display-referred sRGB, rows run top to bottom without padding.
#[derive(Clone, PartialEq, Eq)]
pub struct Picture {
    width: u32,
    height: u32,
    rgba: Vec<u8>,
}

impl Picture {
    /// An opaque black picture of `width` x `height` pixels, each 1 to [`MAX_SIDE`].
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside that range, `OutOfMemory` when it cannot be allocated.
    pub fn new(width: u32, height: u32) -> Result<Self> {
        let len = Self::checked_len(width, height)?;
        let mut rgba = Vec::new();
        rgba.try_reserve_exact(len).map_err(|_| {
            Error::new(ErrorKind::OutOfMemory, format!("a picture of {width} x {height} needs {len} bytes"))
        })?;
        rgba.resize(len, 0);
        rgba.as_chunks_mut::<4>().0.iter_mut().for_each(|px| px[3] = 255);
        Ok(Self { width, height, rgba })
    }

    /// Takes `rgba`, `width * height * 4` bytes of tightly packed rows.
    ///
    /// # Errors
    /// `InvalidArgument` for a size outside 1 to [`MAX_SIDE`] or a buffer of another length.
    pub fn from_rgba(width: u32, height: u32, rgba: Vec<u8>) -> Result<Self> {
        let len = Self::checked_len(width, height)?;
        if rgba.len() != len {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a picture of {width} x {height} has {len} bytes, the buffer has {}", rgba.len()),
            ));
        }
        Ok(Self { width, height, rgba })
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

    /// All bytes, row by row, four to a pixel.
    pub fn rgba(&self) -> &[u8] {
        &self.rgba
    }

    /// All bytes, writable.
    pub fn rgba_mut(&mut self) -> &mut [u8] {
        &mut self.rgba
    }

    /// The pixels, four bytes each.
    pub fn pixels(&self) -> &[[u8; 4]] {
        self.rgba.as_chunks::<4>().0
    }

    /// The pixels, writable.
    pub fn pixels_mut(&mut self) -> &mut [[u8; 4]] {
        self.rgba.as_chunks_mut::<4>().0
    }

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
}

impl std::fmt::Debug for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Picture({} x {})", self.width, self.height)
    }
}
