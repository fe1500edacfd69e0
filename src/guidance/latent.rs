//! A latent as the extractors read it.

use crate::{Error, ErrorKind, Result};

/// A borrowed latent of shape `[channels, height, width]`, the last index running fastest.
#[derive(Clone, Copy)]
pub struct LatentView<'a> {
    channels: usize,
    height: usize,
    width: usize,
    values: &'a [f32],
}

impl<'a> LatentView<'a> {
    /// Views `values` as a latent of that shape.
    ///
    /// # Errors
    /// `InvalidArgument` when a dimension is 0 or the shape does not have as many values.
    pub fn new(channels: usize, height: usize, width: usize, values: &'a [f32]) -> Result<Self> {
        let len = channels.checked_mul(height).and_then(|n| n.checked_mul(width));
        if len != Some(values.len()) || values.is_empty() {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("a latent of shape [{channels}, {height}, {width}] cannot have {} values", values.len()),
            )
            .field("latent"));
        }
        Ok(Self { channels, height, width, values })
    }

    /// `[channels, height, width]`.
    pub fn shape(&self) -> [usize; 3] {
        [self.channels, self.height, self.width]
    }

    /// Channel `c`, `height * width` values.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn channel(&self, c: usize) -> &'a [f32] {
        let cells = self.height * self.width;
        &self.values[c * cells..(c + 1) * cells]
    }
}

impl std::fmt::Debug for LatentView<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "LatentView({:?})", self.shape())
    }
}
