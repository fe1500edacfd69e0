//! Reduces per-frame series to one value per rollout, with intervals over scenes. Frames depend on each other, so none over frames.

use super::series::{Column, Series};
use super::walk::{RATE, STRIDE};
use crate::statistics::mean;

/// Samples in one segment: a second.
const SEGMENT: usize = RATE as usize;

/// Metrics of one rollout; `None` for a metric that could not be measured.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct RolloutMetrics {
    /// Mean change between consecutive frames, LPIPS. Lower is not better: a frozen picture has 0.
    pub(crate) adjacent_lpips: Option<f64>,
    /// The same with SSIM.
    pub(crate) adjacent_ssim: Option<f64>,
    /// Mean change between consecutive anchors, LPIPS.
    pub(crate) anchor_lpips: Option<f64>,
    /// The same with SSIM.
    pub(crate) anchor_ssim: Option<f64>,
    /// Mean absolute difference of the frame-to-frame change from that of the truth at the same time, LPIPS.
    pub(crate) adjacent_error: Option<f64>,
    /// The same from anchor to anchor.
    pub(crate) anchor_error: Option<f64>,
    /// Ratio of the mean changes into odd and into even frames, the larger over the smaller: 1 for even motion, infinity for a stream that
    /// shows every frame twice.
    pub(crate) asymmetry: Option<f64>,
    /// Means against the truth.
    pub(crate) psnr: Option<f64>,
    pub(crate) ssim: Option<f64>,
    pub(crate) ms_ssim: Option<f64>,
    pub(crate) lpips: Option<f64>,
    /// LPIPS against the truth at odd samples only, where a generating branch shows generated frames.
    pub(crate) odd_lpips: Option<f64>,
    /// Mean LPIPS against the truth in the last third of the walk minus that in the first third.
    pub(crate) divergence: Option<f64>,
    /// Means of generated frames against the decoder's pictures.
    pub(crate) decoder_psnr: Option<f64>,
    pub(crate) decoder_ssim: Option<f64>,
    pub(crate) decoder_lpips: Option<f64>,
    /// Largest signed difference of a second's mean brightness from the truth's, 0 to 255.
    pub(crate) brightness_drift: Option<f64>,
    /// The same of red minus blue: positive is warmer.
    pub(crate) warmth_drift: Option<f64>,
    /// Mean frame-to-frame change of brightness minus the truth's.
    pub(crate) flicker: Option<f64>,
    /// Seconds until the stream is as far from the truth as its first picture is from the second half of the walk; the full length if that
    /// never happens.
    pub(crate) horizon: Option<f64>,
    /// Seconds from the first turn command until the turn is visible.
    pub(crate) onset: Option<f64>,
}

/// Metrics of a stream against the truth of its scene.
pub(crate) fn summarise(stream: &Series, truth: &Series) -> RolloutMetrics {
    let of = |column| mean(stream.column(column));
    let error = |column| {
        let pairs = stream.column(column).zip(truth.column(column));
        mean(pairs.map(|(ours, theirs)| Some((ours? - theirs?).abs())))
    };
    let change = |series: &Series| {
        let levels: Vec<Option<f64>> = brightness(series).collect();
        mean(levels.windows(2).map(|pair| Some((pair[1]? - pair[0]?).abs())))
    };
    RolloutMetrics {
        adjacent_lpips: of(Column::AdjacentLpips),
        adjacent_ssim: of(Column::AdjacentSsim),
        anchor_lpips: of(Column::AnchorLpips),
        anchor_ssim: of(Column::AnchorSsim),
        adjacent_error: error(Column::AdjacentLpips),
        anchor_error: error(Column::AnchorLpips),
        asymmetry: asymmetry(stream),
        psnr: of(Column::Psnr),
        ssim: of(Column::Ssim),
        ms_ssim: of(Column::MsSsim),
        lpips: of(Column::Lpips),
        odd_lpips: mean(stream.column(Column::Lpips).skip(1).step_by(STRIDE as usize)),
        divergence: divergence(stream),
        decoder_psnr: of(Column::DecoderPsnr),
        decoder_ssim: of(Column::DecoderSsim),
        decoder_lpips: of(Column::DecoderLpips),
        brightness_drift: drift(brightness(stream), brightness(truth)),
        warmth_drift: drift(warmth(stream), warmth(truth)),
        flicker: change(stream).zip(change(truth)).map(|(ours, theirs)| ours - theirs),
        horizon: horizon(stream),
        // Needs the straight walk as well; see `turn_onset`.
        onset: None,
    }
}

fn divergence(stream: &Series) -> Option<f64> {
    let third = stream.rows.len() / 3;
    let of = |skipped| mean(stream.column(Column::Lpips).skip(skipped).take(third));
    Some(of(stream.rows.len() - third)? - of(0)?)
}

fn asymmetry(stream: &Series) -> Option<f64> {
    let into = |odd: bool| {
        let frames = stream.column(Column::AdjacentLpips).enumerate();
        mean(frames.filter(|(number, _)| (number % STRIDE as usize == 1) == odd).map(|(_, value)| value))
    };
    let (odd, even) = (into(true)?, into(false)?);
    // Two frozen halves count as even.
    if odd == even { Some(1.0) } else { Some(odd.max(even) / odd.min(even)) }
}

/// Rec. 709 luma of the gamma-encoded bytes.
fn brightness(series: &Series) -> impl Iterator<Item = Option<f64>> + '_ {
    series.rows.iter().map(|row| {
        let of = |column: Column| row[column as usize];
        Some(0.2126 * of(Column::Red)? + 0.7152 * of(Column::Green)? + 0.0722 * of(Column::Blue)?)
    })
}

fn warmth(series: &Series) -> impl Iterator<Item = Option<f64>> + '_ {
    series.rows.iter().map(|row| Some(row[Column::Red as usize]? - row[Column::Blue as usize]?))
}

/// Means over whole seconds; a single mean for a shorter video.
fn segments(values: impl Iterator<Item = Option<f64>>) -> Vec<Option<f64>> {
    let all: Vec<Option<f64>> = values.collect();
    let whole = (all.len() / SEGMENT).max(1) * SEGMENT;
    all.chunks(SEGMENT).take(whole / SEGMENT).map(|segment| mean(segment.iter().copied())).collect()
}

/// The largest difference of a segment, signed.
fn drift(ours: impl Iterator<Item = Option<f64>>, truth: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let differences = segments(ours.zip(truth).map(|(ours, truth)| Some(ours? - truth?)));
    differences.into_iter().flatten().max_by(|a, b| a.abs().total_cmp(&b.abs()))
}

/// Start of the first second that is as far from the truth as the stream's first picture is, on average, from the second half of the walk:
/// by then nothing of the first view remains.
fn horizon(stream: &Series) -> Option<f64> {
    let lost = mean(stream.column(Column::HeldLpips).skip(stream.rows.len() / 2))?;
    let far = segments(stream.column(Column::Lpips));
    let first = far.iter().position(|level| level.is_some_and(|level| level >= lost));
    let whole = (stream.rows.len().saturating_sub(1)) as f64 / f64::from(RATE);
    Some(first.map_or(whole, |segment| segment as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::series::Row;

    /// A stream with a given change into frame n and a given distance from the truth.
    fn stream(frames: usize, change: impl Fn(usize) -> f64, far: impl Fn(usize) -> f64) -> Series {
        let rows = (0..frames)
            .map(|n| {
                let mut row = Row::default();
                row[Column::AdjacentLpips as usize] = (n > 0).then(|| change(n));
                row[Column::Lpips as usize] = Some(far(n));
                row[Column::HeldLpips as usize] = Some(if n < frames / 2 { 0.0 } else { 0.5 });
                row[Column::Red as usize] = Some(100.0 + far(n));
                row[Column::Green as usize] = Some(100.0);
                row[Column::Blue as usize] = Some(100.0);
                row
            })
            .collect();
        Series { name: "test".into(), rows }
    }

    /// A pitfall of mean adjacent LPIPS: a stream that shows every picture twice has half of the changes or fewer (LPIPS saturates), and would
    /// win.
    #[test]
    fn holding_frames_does_not_win() {
        let truth = stream(61, |_| 0.1, |_| 0.0);
        let moving = summarise(&stream(61, |n| 0.1 + 0.01 * (n % 3) as f64, |_| 0.0), &truth);
        let held = summarise(&stream(61, |n| if n % 2 == 1 { 0.0 } else { 0.16 }, |_| 0.0), &truth);
        let frozen = summarise(&stream(61, |_| 0.0, |_| 0.0), &truth);
        assert!(held.adjacent_lpips < moving.adjacent_lpips, "the plain mean falls for it");
        assert!(held.adjacent_error > moving.adjacent_error, "the distance from the truth's change does not");
        assert_eq!((held.asymmetry, frozen.asymmetry), (Some(f64::INFINITY), Some(1.0)));
        assert!(moving.asymmetry.unwrap() < 1.2);
        assert!(frozen.adjacent_error > moving.adjacent_error);
    }

    #[test]
    fn drift_is_the_farthest_second_with_its_sign() {
        let truth = stream(91, |_| 0.1, |_| 0.0);
        // Warmer by 10 in the second second only: comparing start and end would miss it.
        let drifted = summarise(&stream(91, |_| 0.1, |n| if n / 30 == 1 { 10.0 } else { 1.0 }), &truth);
        assert!((drifted.warmth_drift.unwrap() - 10.0).abs() < 1e-9);
        assert!((drifted.brightness_drift.unwrap() - 2.126).abs() < 1e-9);
        assert_eq!(summarise(&truth, &truth).warmth_drift, Some(0.0));
    }

    #[test]
    fn what_grows_and_what_is_generated_are_told_apart() {
        let truth = stream(61, |_| 0.1, |_| 0.0);
        let found = summarise(&stream(61, |_| 0.1, |n| n as f64 / 100.0 + if n % 2 == 1 { 0.5 } else { 0.0 }), &truth);
        assert!((found.divergence.unwrap() - 0.41).abs() < 0.03, "{:?}", found.divergence);
        assert!((found.odd_lpips.unwrap() - 0.8).abs() < 1e-9, "{:?}", found.odd_lpips);
    }

    #[test]
    fn the_horizon_is_the_first_lost_second() {
        let of = |far: &dyn Fn(usize) -> f64| horizon(&stream(151, |_| 0.0, far)).unwrap();
        assert_eq!(of(&|n| if n >= 60 { 0.6 } else { 0.1 }), 2.0);
        assert_eq!(of(&|_| 0.49), 5.0, "never lost: the whole length");
        assert_eq!(of(&|_| 0.5), 0.0);
        assert_eq!(horizon(&stream(20, |_| 0.0, |_| 0.1)), Some(19.0 / 30.0), "shorter than a segment");
    }
}
