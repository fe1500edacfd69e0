//! Long-term stability of a world: global properties of its pictures, second by second, relative to the true ones.

use cairn::Picture;
use serde::{Deserialize, Serialize};

use super::walk::WalkScores;

/// Ends of the examined seconds of a walk.
pub(super) const ENDS: [u32; 9] = [1, 2, 5, 10, 15, 20, 30, 45, 60];

/// Global properties of a picture, independent of its content.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct PictureStatistics {
    /// Mean Rec. 709 luma of the gamma-encoded bytes, 0 to 255.
    pub(super) brightness: f64,
    /// Mean of red, green and blue, 0 to 255.
    pub(super) colour: [f64; 3],
    /// Standard deviation of luma, 0 to 128.
    pub(super) contrast: f64,
    /// Mean absolute luma difference of horizontal and vertical neighbours, 0 to 255.
    pub(super) detail: f64,
}

impl PictureStatistics {
    pub(super) fn of(picture: &Picture) -> Self {
        let luma = |[r, g, b, _]: &[u8; 4]| 0.2126 * f64::from(*r) + 0.7152 * f64::from(*g) + 0.0722 * f64::from(*b);
        let lumas: Vec<f64> = picture.pixels().iter().map(luma).collect();
        let count = lumas.len() as f64;
        let brightness = lumas.iter().sum::<f64>() / count;
        let variance = lumas.iter().map(|l| (l - brightness).powi(2)).sum::<f64>() / count;
        let rows: Vec<&[f64]> = lumas.chunks_exact(picture.width() as usize).collect();
        let across = rows.iter().flat_map(|row| row.windows(2).map(|l| (l[1] - l[0]).abs()));
        let down = rows.windows(2).flat_map(|pair| pair[0].iter().zip(pair[1]).map(|(a, b)| (a - b).abs()));
        let (sum, steps) = across.chain(down).fold((0.0, 0_u32), |(sum, n), step| (sum + step, n + 1));
        let colour = [0, 1, 2].map(|c| picture.pixels().iter().map(|px| f64::from(px[c])).sum::<f64>() / count);
        Self { brightness, colour, contrast: variance.sqrt(), detail: sum / f64::from(steps.max(1)) }
    }
}

/// A second of a walk: the world's properties against the true ones, as means over the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Second {
    /// Ratio to the truth; 1 is as bright.
    pub(super) brightness: f64,
    /// Largest difference of the mean red, green or blue, in units of a byte.
    pub(super) colour: f64,
    /// Ratio to the truth.
    pub(super) contrast: f64,
    /// Ratio to the truth.
    pub(super) detail: f64,
    /// Detail of the first true picture and of its reconstruction: ratios to the truth of this second.
    pub(super) still_detail: [f64; 2],
}

/// The second that ends after `end` seconds of a walk; `None` if the walk is shorter or the truth is black or flat.
pub(super) fn second(walked: &WalkScores, end: u32, latents_per_second: u32) -> Option<Second> {
    let [first, last] = [end.saturating_sub(1), end].map(|second| (second * latents_per_second) as usize);
    // The first entry belongs to the picture before the first step.
    let statistics = walked.statistics.get(first + 1..=last)?;
    let mean = |of: &dyn Fn(&PictureStatistics) -> f64| {
        [0, 1].map(|i| statistics.iter().map(|pair| of(&pair[i])).sum::<f64>() / statistics.len() as f64)
    };
    let ratio = |of: &dyn Fn(&PictureStatistics) -> f64| {
        let [made, true_] = mean(of);
        (true_ > 0.0).then(|| made / true_)
    };
    let differences = [0, 1, 2].map(|c| {
        let [made, true_] = mean(&|look: &PictureStatistics| look.colour[c]);
        (made - true_).abs()
    });
    let [_, true_detail] = mean(&|look| look.detail);
    Some(Second {
        brightness: ratio(&|look| look.brightness)?,
        colour: differences.into_iter().fold(0.0, f64::max),
        contrast: ratio(&|look| look.contrast)?,
        detail: ratio(&|look| look.detail)?,
        still_detail: walked.still.map(|still| still.detail / true_detail),
    })
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
        let look = PictureStatistics::of(&striped(80, 80, 8));
        assert!((look.brightness - 80.0).abs() < 1e-9 && look.contrast < 1e-9 && look.detail < 1e-9, "{look:?}");
        assert_eq!(look.colour, [80.0; 3]);
    }

    #[test]
    fn fine_stripes_have_the_contrast_of_broad_ones_and_more_detail() {
        let [fine, broad] = [16, 64].map(|width| PictureStatistics::of(&striped(40, 120, width)));
        assert!((fine.brightness - 80.0).abs() < 1e-9 && (fine.contrast - broad.contrast).abs() < 1e-9, "{fine:?}");
        // 15 edges across instead of 3, of 80 each, among 255 steps; none among the 143 steps down.
        let expected = |edges: f64| 80.0 * edges * 144.0 / (255.0 * 144.0 + 143.0 * 256.0);
        assert!((fine.detail - expected(15.0)).abs() < 1e-9 && (broad.detail - expected(3.0)).abs() < 1e-9, "{fine:?}");
    }

    fn look(brightness: f64, contrast: f64, detail: f64) -> PictureStatistics {
        PictureStatistics { brightness, colour: [brightness, brightness + 3.0, 10.0], contrast, detail }
    }

    fn walk(made: PictureStatistics, truth: PictureStatistics, steps: usize) -> WalkScores {
        let mut statistics = vec![[look(50.0, 20.0, 5.0); 2]; steps - 3];
        statistics.extend([[made, truth]; 4]);
        WalkScores { statistics, ..WalkScores::empty(look(50.0, 20.0, 4.0)) }
    }

    #[test]
    fn only_the_second_asked_for_counts() {
        // Four latent steps a second for three seconds; in the last one the picture fades.
        let walked = walk(look(40.0, 5.0, 1.0), look(50.0, 20.0, 5.0), 12);
        let [even, fading] = [2, 3].map(|end| second(&walked, end, 4).unwrap());
        let right = Second { brightness: 1.0, colour: 0.0, contrast: 1.0, detail: 1.0, still_detail: [0.8; 2] };
        assert_eq!(even, right);
        assert_eq!(fading, Second { brightness: 0.8, colour: 10.0, contrast: 0.25, detail: 0.2, ..right });
        assert_eq!(second(&walked, 4, 4), None);
    }
}
