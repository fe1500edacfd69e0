//! AlexNet and VGG16 up to their last convolution, computed in bands of rows to bound the memory.

use std::ops::Range;

use cairn::{Error, ErrorKind, Picture, Result};

use super::Net;
use super::convolution::Convolution;
use super::map::{Map, pool};
use super::weights::Weights;

/// Maximum number of values in the band of one layer. VGG16's first layers have half a gigabyte at 1920x1080.
const BAND: usize = 8 << 20;

impl Net {
    /// Kernel size and output channels of each convolution.
    pub(super) fn convolutions(self) -> &'static [(usize, usize)] {
        match self {
            Self::Alex => &[(11, 64), (5, 192), (3, 384), (3, 256), (3, 256)],
            Self::Vgg => &[
                (3, 64),
                (3, 64),
                (3, 128),
                (3, 128),
                (3, 256),
                (3, 256),
                (3, 256),
                (3, 512),
                (3, 512),
                (3, 512),
                (3, 512),
                (3, 512),
                (3, 512),
            ],
        }
    }

    /// The convolutions whose outputs are compared.
    pub(super) fn taps(self) -> [usize; 5] {
        match self {
            Self::Alex => [0, 1, 2, 3, 4],
            Self::Vgg => [1, 3, 6, 9, 12],
        }
    }

    /// The taps that are followed by max pooling; the network ends with the last tap.
    fn pools(self) -> &'static [usize] {
        match self {
            Self::Alex => &[0, 1, 4],
            Self::Vgg => &[0, 1, 2, 3, 4],
        }
    }

    /// Window size of the max pooling.
    fn pool_size(self) -> usize {
        match self {
            Self::Alex => 3,
            Self::Vgg => 2,
        }
    }

    /// Stride and padding of a convolution.
    fn geometry(self, number: usize) -> (usize, usize) {
        match (self, number) {
            (Self::Alex, 0) => (4, 2),
            (Self::Alex, 1) => (1, 2),
            _ => (1, 1),
        }
    }

    /// The smallest width and height in pixels for which every layer has an output.
    pub fn smallest_side(self) -> u32 {
        match self {
            Self::Alex => 31,
            Self::Vgg => 16,
        }
    }
}

/// A network with its weights.
pub(super) struct Network {
    net: Net,
    convolutions: Vec<Convolution>,
    /// For each tap the weight of each of its channels.
    pub(super) linear: Vec<Vec<f32>>,
    /// Maximum number of values in the band of one layer; [`BAND`] except in tests.
    pub(super) band: usize,
}

/// Output at a tap: some rows of the maps of one or two pictures.
pub(super) struct TapOutput<'a, const N: usize> {
    pub(super) tap: usize,
    pub(super) rows: Range<isize>,
    pub(super) maps: [&'a Map; N],
}

impl Network {
    pub(super) fn new(net: Net, weights: Weights) -> Self {
        let convolutions = weights.kernels.into_iter().enumerate().map(|(number, kernel)| {
            let (step, border) = net.geometry(number);
            Convolution { kernel, step, border }
        });
        Self { net, convolutions: convolutions.collect(), linear: weights.linear, band: BAND }
    }

    /// Width, height and channels of the output at each tap.
    pub(super) fn shapes(&self, (width, height): (u32, u32)) -> Result<[[usize; 3]; 5]> {
        let least = self.net.smallest_side();
        if width < least || height < least {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("LPIPS with {} needs {least} x {least} pixels, the picture has {width} x {height}", self.net),
            )
            .field("size")
            .remedy(format!("Use pictures of at least {least} x {least} pixels")));
        }
        let (mut width, mut height) = (width as usize, height as usize);
        let mut shapes = [[0; 3]; 5];
        for (number, convolution) in self.convolutions.iter().enumerate() {
            (width, height) = (convolution.side(width), convolution.side(height));
            if let Some(tap) = self.net.taps().iter().position(|after| *after == number) {
                shapes[tap] = [width, height, convolution.kernel.outputs];
                if self.net.pools().contains(&tap) {
                    (width, height) = (self.pooled(width), self.pooled(height));
                }
            }
        }
        Ok(shapes)
    }

    fn pooled(&self, side: usize) -> usize {
        (side.saturating_sub(self.net.pool_size())) / 2 + 1
    }

    /// Runs over pictures of one size in parallel, and passes on the output at the taps: the rows of each tap from the top down, not
    /// normalised.
    ///
    /// # Errors
    /// `InvalidArgument` for too small pictures, `OutOfMemory`, and errors of `take`.
    pub(super) fn run<const N: usize>(
        &self,
        pictures: [&Picture; N],
        take: &mut dyn FnMut(TapOutput<'_, N>) -> Result<()>,
    ) -> Result<()> {
        let shapes = self.shapes(pictures[0].size())?;
        let border = self.convolutions[0].border;
        let mut height = pictures[0].height() as usize;
        let mut maps = each(|n| Map::of_picture(pictures[n], border))?;
        let (mut first, mut first_tap) = (0, 0);
        for &last_tap in self.net.pools() {
            let after = self.net.taps()[last_tap];
            let stage = Stage { network: self, convolutions: first..after + 1, taps: first_tap..last_tap + 1, height };
            let next = self.convolutions.get(after + 1).map(|next| next.border);
            let [width, rows, channels] = shapes[last_tap];
            let mut pooled = match next {
                Some(border) => {
                    let (width, rows) = (self.pooled(width), self.pooled(rows));
                    let rows = -(border as isize)..(rows + border) as isize;
                    Some(each::<_, N>(|_| Map::new(width, channels, border, rows.clone()))?)
                }
                None => None,
            };
            stage.run(&maps, pooled.as_mut(), take)?;
            let Some(pooled) = pooled else { return Ok(()) };
            (maps, height) = (pooled, self.pooled(rows));
            (first, first_tap) = (after + 1, last_tap + 1);
        }
        Ok(())
    }
}

/// `N` values, or the first error.
fn each<T, const N: usize>(mut make: impl FnMut(usize) -> Result<T>) -> Result<[T; N]> {
    let made: Vec<T> = (0..N).map(&mut make).collect::<Result<_>>()?;
    Ok(made.try_into().unwrap_or_else(|_| unreachable!("there are N of them")))
}

/// Convolutions between two poolings.
struct Stage<'a> {
    network: &'a Network,
    convolutions: Range<usize>,
    taps: Range<usize>,
    /// Number of input rows.
    height: usize,
}

impl Stage<'_> {
    fn run<const N: usize>(
        &self,
        inputs: &[Map; N],
        mut pooled: Option<&mut [Map; N]>,
        take: &mut dyn FnMut(TapOutput<'_, N>) -> Result<()>,
    ) -> Result<()> {
        let convolutions = &self.network.convolutions[self.convolutions.clone()];
        let Some(last) = convolutions.last() else { return Ok(()) };
        let sides = |side: usize| {
            convolutions.iter().scan(side, |side, convolution| {
                *side = convolution.side(*side);
                Some(*side)
            })
        };
        let widths: Vec<usize> = sides(inputs[0].width).collect();
        let heights: Vec<usize> = sides(self.height).collect();
        // All convolutions of a stage have the same size except the very first one, so one height is enough.
        let height = heights[heights.len() - 1];
        let line = convolutions.iter().zip(&widths).map(|(c, width)| (width + 2 * c.border) * c.kernel.outputs).max();
        // An even number, because pooling has stride 2.
        let band = (2 * (self.network.band / 2 / line.unwrap_or(1))).max(2).min(height.next_multiple_of(2));
        // A pooling window may be larger than its stride.
        let more = self.network.net.pool_size() - 2;

        let mut layers: Vec<[Map; N]> = Vec::new();
        for (number, (convolution, width)) in convolutions.iter().zip(&widths).enumerate() {
            // Each later convolution needs its padding of rows.
            let rows = band + more + 2 * (convolutions.len() - 1 - number) * last.border;
            let (outputs, border) = (convolution.kernel.outputs, convolution.border);
            layers.push(each(|_| Map::new(*width, outputs, border, 0..rows as isize))?);
        }
        for start in (0..height).step_by(band) {
            let end = (start + band).min(height);
            let mut needed = start as isize..(end + more).min(height) as isize;
            for (number, layer) in layers.iter_mut().enumerate().rev() {
                layer.iter_mut().for_each(|map| map.move_to(needed.clone(), heights[number]));
                needed = convolutions[number].needs(needed);
            }
            for (number, convolution) in convolutions.iter().enumerate() {
                let (before, this) = layers.split_at_mut(number);
                let inputs = before.last().unwrap_or(inputs);
                for (input, output) in inputs.iter().zip(&mut this[0]) {
                    let inside = output.rows.start.max(0)..output.rows.end.min(heights[number] as isize);
                    convolution.apply(input, output, inside);
                }
                let after = self.convolutions.start + number;
                if let Some(tap) = self.taps.clone().find(|tap| self.network.net.taps()[*tap] == after) {
                    let rows = start as isize..end as isize;
                    take(TapOutput { tap, rows, maps: this[0].each_ref() })?;
                }
            }
            if let (Some(pooled), Some(outputs)) = (pooled.as_deref_mut(), layers.last()) {
                for (pooled, output) in pooled.iter_mut().zip(outputs) {
                    let pooled_height = self.network.pooled(height);
                    pool(output, self.network.net.pool_size(), start as isize..end as isize, pooled, pooled_height);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::weights::Kernel;
    use super::*;

    /// A network with random weights.
    fn network(net: Net, band: usize) -> Network {
        let mut state = 1u32;
        let mut noise = move |count: usize, scale: f32| -> Vec<f32> {
            let numbers = (0..count).map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                ((state >> 8) as f32 / (1 << 23) as f32 - 1.0) * scale
            });
            numbers.collect()
        };
        let mut inputs = 3;
        let mut kernels = Vec::new();
        for &(size, outputs) in net.convolutions() {
            let seen = size * size * inputs;
            let kernel = noise(seen * outputs, (3.0 / seen as f32).sqrt() * 1.5);
            kernels.push(Kernel { size, inputs, outputs, kernel, bias: noise(outputs, 0.1) });
            inputs = outputs;
        }
        let linear = net.taps().iter().map(|after| vec![1.0; net.convolutions()[*after].1]).collect();
        Network { band, ..Network::new(net, Weights { kernels, linear }) }
    }

    fn picture(width: u32, height: u32) -> Picture {
        let mut picture = Picture::new(width, height).unwrap();
        for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            *px = [(x * 11 + y * 3) as u8, (x * y) as u8, (x * x / 3 + y) as u8, 255];
        }
        picture
    }

    /// All rows of all taps, one after the other.
    fn taps(network: &Network, picture: &Picture) -> [Vec<f32>; 5] {
        let mut found = [const { Vec::new() }; 5];
        let mut take = |TapOutput { tap, rows, maps: [map] }: TapOutput<'_, 1>| {
            rows.for_each(|y| found[tap].extend_from_slice(map.row(y)));
            Ok(())
        };
        network.run([picture], &mut take).unwrap();
        found
    }

    #[test]
    fn bands_and_threads_do_not_show() {
        for (net, size) in [(Net::Alex, (75, 203)), (Net::Vgg, (33, 71))] {
            let picture = picture(size.0, size.1);
            let whole = taps(&network(net, BAND), &picture);
            for (tap, (found, [width, height, channels])) in
                whole.iter().zip(network(net, BAND).shapes(size).unwrap()).enumerate()
            {
                assert_eq!(found.len(), width * height * channels, "{net}, tap {tap}");
                assert!(found.iter().any(|v| *v > 0.0) && found.iter().all(|v| v.is_finite()), "{net}, tap {tap}");
            }
            let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
            for band in [1, 20_000, 60_000] {
                let found = pool.install(|| taps(&network(net, band), &picture));
                assert!(found == whole, "{net} in bands of {band} numbers");
            }
        }
    }

    #[test]
    fn a_layer_is_its_definition() {
        let (network, picture) = (network(Net::Alex, BAND), picture(53, 47));
        let found = &taps(&network, &picture)[0];
        let first = &network.convolutions[0].kernel;
        let input = Map::of_picture(&picture, 0).unwrap();
        let [width, height, channels] = network.shapes((53, 47)).unwrap()[0];
        assert_eq!(found.len(), width * height * channels);
        for (place, found) in found.iter().enumerate() {
            let (out, x, y) = (place % channels, place / channels % width, place / channels / width);
            let mut sum = f64::from(first.bias[out]);
            for k in 0..first.size * first.size * 3 {
                let (ky, kx, channel) = (k / 3 / first.size, k / 3 % first.size, k % 3);
                let (at_x, at_y) = ((4 * x + kx) as isize - 2, (4 * y + ky) as isize - 2);
                if (0..53).contains(&at_x) && (0..47).contains(&at_y) {
                    let value = input.row(at_y)[at_x as usize * 3 + channel];
                    sum += f64::from(value) * f64::from(first.kernel[k * channels + out]);
                }
            }
            let expected = sum.max(0.0);
            assert!((f64::from(*found) - expected).abs() < 1e-4, "{x}, {y}, {out}: {found} {expected}");
        }
    }

    #[test]
    fn the_smallest_picture_reaches_the_end_and_a_smaller_one_is_refused() {
        for net in [Net::Alex, Net::Vgg] {
            let (network, least) = (network(net, BAND), net.smallest_side());
            let found = taps(&network, &picture(least, least));
            assert_eq!(found[4].len(), net.convolutions()[net.taps()[4]].1, "one pixel is left");
            for (width, height) in [(least - 1, 64), (64, least - 1), (1, 1)] {
                let error = network.run([&picture(width, height)], &mut |_| Ok(())).unwrap_err();
                assert_eq!(error.kind(), ErrorKind::InvalidArgument);
                assert!(error.to_string().contains(&format!("at least {least} x {least}")), "{error}");
            }
        }
    }
}
