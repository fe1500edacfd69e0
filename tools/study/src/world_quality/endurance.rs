//! Long-term stability of a world: global properties of its pictures, second by second, relative to the true ones.

use cairn::{Picture, Result};

use super::response::{Response, following};
use super::walk::WalkScores;
use crate::picture::shrink;

/// Ends of the examined seconds of a walk.
pub(super) const ENDS: [u32; 5] = [1, 2, 5, 10, 15];

/// Pictures are scaled down to this size, at which the autoencoder's blur, present from the first picture, hardly matters.
const SIZE: (u32, u32) = (64, 36);

/// Global properties of a picture, independent of its content.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PictureStatistics {
    /// Mean Rec. 709 luma of the gamma-encoded bytes, 0 to 255.
    pub(super) brightness: f64,
    /// Standard deviation of luma, 0 to 128.
    pub(super) contrast: f64,
    /// Mean absolute luma difference of horizontal and vertical neighbours, 0 to 255.
    pub(super) detail: f64,
}

impl PictureStatistics {
    /// # Errors
    /// As [`shrink`].
    pub(super) fn of(picture: &Picture) -> Result<Self> {
        let small = shrink(picture, SIZE)?;
        let luma = |[r, g, b, _]: &[u8; 4]| 0.2126 * f64::from(*r) + 0.7152 * f64::from(*g) + 0.0722 * f64::from(*b);
        let lumas: Vec<f64> = small.pixels().iter().map(luma).collect();
        let count = lumas.len() as f64;
        let brightness = lumas.iter().sum::<f64>() / count;
        let variance = lumas.iter().map(|l| (l - brightness).powi(2)).sum::<f64>() / count;
        let rows: Vec<&[f64]> = lumas.chunks_exact(SIZE.0 as usize).collect();
        let across = rows.iter().flat_map(|row| row.windows(2).map(|l| (l[1] - l[0]).abs()));
        let down = rows.windows(2).flat_map(|pair| pair[0].iter().zip(pair[1]).map(|(a, b)| (a - b).abs()));
        let (sum, steps) = across.chain(down).fold((0.0, 0_u32), |(sum, n), step| (sum + step, n + 1));
        Ok(Self { brightness, contrast: variance.sqrt(), detail: sum / f64::from(steps) })
    }
}

/// A second of a walk: ratios of the world's properties to the true ones, as means over the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Second {
    /// 1 is as bright as the truth.
    pub(super) brightness: f64,
    /// Mean luma of the truth in this second, 0 to 255.
    pub(super) true_brightness: f64,
    pub(super) contrast: f64,
    pub(super) detail: f64,
}

/// The second that ends after `end` seconds of a walk; `None` if the walk is shorter or the truth is black or flat.
pub(super) fn second(walked: &WalkScores, end: u32, latents_per_second: u32) -> Option<Second> {
    let steps = steps(end, 1, latents_per_second);
    // The first entry belongs to the picture before the first step.
    let statistics = walked.statistics.get(steps.start + 1..=steps.end)?;
    let ratio = |of: fn(&PictureStatistics) -> f64| {
        let [made, true_] = [0, 1].map(|i| statistics.iter().map(|pair| of(&pair[i])).sum::<f64>());
        (true_ > 0.0).then(|| made / true_)
    };
    Some(Second {
        brightness: ratio(|look| look.brightness)?,
        true_brightness: statistics.iter().map(|pair| pair[1].brightness).sum::<f64>() / statistics.len() as f64,
        contrast: ratio(|look| look.contrast)?,
        detail: ratio(|look| look.detail)?,
    })
}

/// Correlation of turning with the controls in the `seconds` before `end`: Pearson's, over the steps of all walks.
pub(super) fn turning<'a>(
    walks: impl Iterator<Item = &'a WalkScores>,
    end: u32,
    seconds: u32,
    latents_per_second: u32,
) -> Option<f64> {
    let steps = steps(end, seconds, latents_per_second);
    let responses: Vec<Response> = walks.filter_map(|w| w.responses.get(steps.clone())).flatten().copied().collect();
    following(responses.iter(), 0).map(|found| found.correlation)
}

/// Indices of the latent steps in the `seconds` before `end`.
fn steps(end: u32, seconds: u32, latents_per_second: u32) -> std::ops::Range<usize> {
    let at = |second: u32| (second * latents_per_second) as usize;
    at(end.saturating_sub(seconds))..at(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn striped(low: u8, high: u8, width: u32) -> Picture {
        let mut picture = Picture::new(256, 144).unwrap();
        for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
            let bright = (i as u32 % 256) / width % 2 == 1;
            *px = if bright { [high, high, high, 255] } else { [low, low, low, 255] };
        }
        picture
    }

    #[test]
    fn a_flat_picture_has_neither_contrast_nor_detail() {
        let look = PictureStatistics::of(&striped(80, 80, 8)).unwrap();
        assert!((look.brightness - 80.0).abs() < 1e-9 && look.contrast < 1e-9 && look.detail < 1e-9, "{look:?}");
    }

    #[test]
    fn fine_stripes_have_the_contrast_of_broad_ones_and_more_detail() {
        let (fine, broad) = (
            PictureStatistics::of(&striped(40, 120, 16)).unwrap(),
            PictureStatistics::of(&striped(40, 120, 64)).unwrap(),
        );
        assert!(
            (fine.brightness - 80.0).abs() < 1.0 && (fine.contrast - broad.contrast).abs() < 6.0,
            "{fine:?} {broad:?}"
        );
        assert!(fine.detail > 3.0 * broad.detail, "{fine:?} {broad:?}");
    }

    fn walk(made: [f64; 3], truth: [f64; 3], steps: usize) -> WalkScores {
        let look = |[brightness, contrast, detail]: [f64; 3]| PictureStatistics { brightness, contrast, detail };
        let alike = [look([50.0, 20.0, 5.0]); 2];
        let mut statistics = vec![alike; steps - 3];
        statistics.extend([[look(made), look(truth)]; 4]);
        let turn = |n: usize| f64::from(n as u32 % 5) - 2.0;
        let response = |n: usize| Response {
            seen: [if n < steps - 4 { 1.0 } else { -1.0 } * turn(n), 0.0],
            meant: [turn(n), 0.0],
        };
        WalkScores { horizons: Vec::new(), responses: (0..steps).map(response).collect(), statistics }
    }

    #[test]
    fn only_the_second_asked_for_counts() {
        // Four latent steps a second for three seconds; in the last one the picture fades and turns the wrong way.
        let walked = walk([40.0, 5.0, 1.0], [50.0, 20.0, 5.0], 12);
        let [even, fading] = [2, 3].map(|end| second(&walked, end, 4).unwrap());
        assert_eq!(even, Second { brightness: 1.0, true_brightness: 50.0, contrast: 1.0, detail: 1.0 });
        assert_eq!(fading, Second { brightness: 0.8, true_brightness: 50.0, contrast: 0.25, detail: 0.2 });
        assert_eq!(second(&walked, 4, 4), None);
        let [well, badly] = [2, 3].map(|end| turning(std::iter::once(&walked), end, 1, 4).unwrap());
        assert!(well > 0.999 && badly < -0.999, "{well} {badly}");
    }
}
