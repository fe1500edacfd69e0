//! Scores of every generated frame against the true one.

use std::fmt::Write as _;

use cairn::framegen::Outcome;
use cairn::{Picture, Result};
use serde::{Deserialize, Serialize};

use crate::metrics::{Lpips, MAX_PSNR, psnr, ssim};

/// One generated frame against the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Score {
    /// Peak signal-to-noise ratio in dB.
    pub(super) psnr: f64,
    pub(super) ssim: f64,
    pub(super) lpips: Option<f64>,
    /// PSNR of the nearer anchor, which would be shown without generation.
    pub(super) psnr_of_anchor: f64,
}

impl Score {
    pub(super) fn of(made: &Picture, truth: &Picture, anchor: &Picture, lpips: Option<&Lpips>) -> Result<Self> {
        Ok(Self {
            psnr: psnr(truth, made)?,
            ssim: ssim(truth, made)?,
            lpips: lpips.map(|lpips| lpips.compare(truth, made)).transpose()?,
            psnr_of_anchor: psnr(truth, anchor)?,
        })
    }
}

/// A frame of the stream.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    pub(super) frame: u64,
    /// Number of the anchor at the interval's end, and the frame's index within the interval: `None` for the anchor itself.
    pub(super) anchor: u64,
    pub(super) part: Option<(u32, Score, Outcome)>,
}

/// All frames, in order.
#[derive(Debug, Default)]
pub(super) struct Scores {
    pub(super) entries: Vec<Entry>,
}

/// Summary over all generated frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Mean over the frames; an equal frame counts 100.
    pub psnr_db: f64,
    /// PSNR of the median frame.
    pub median_psnr_db: f64,
    /// PSNR of the worst frame.
    pub worst_psnr_db: f64,
    /// Number of the worst frame.
    pub worst_frame: u64,
    /// Mean.
    pub ssim: f64,
    /// Mean LPIPS with AlexNet, if its weights are installed.
    pub lpips: Option<f64>,
    /// Mean PSNR of showing the nearer anchor instead.
    pub psnr_of_anchor_db: f64,
}

impl Scores {
    fn generated(&self) -> impl Iterator<Item = (&Entry, &Score)> {
        self.entries.iter().filter_map(|entry| entry.part.as_ref().map(|(_, score, _)| (entry, score)))
    }

    /// Generated frames from the worst to the best.
    fn ranked(&self) -> Vec<&Entry> {
        let mut ranked: Vec<_> = self.generated().collect();
        ranked.sort_by(|a, b| a.1.psnr.total_cmp(&b.1.psnr).then(a.0.frame.cmp(&b.0.frame)));
        ranked.into_iter().map(|(entry, _)| entry).collect()
    }

    /// The median frame and the worst one.
    pub(super) fn median_and_worst(&self) -> Vec<(&'static str, Entry)> {
        let ranked = self.ranked();
        let middle = ranked.get(ranked.len() / 2).map(|entry| ("median", **entry));
        let worst = ranked.first().map(|entry| ("worst", **entry));
        middle.into_iter().chain(worst).collect()
    }

    pub(super) fn summary(&self) -> Option<Summary> {
        let mean = |value: &dyn Fn(&Score) -> f64| {
            let (sum, count) = self.generated().fold((0.0, 0u32), |(sum, count), (_, s)| (sum + value(s), count + 1));
            sum / f64::from(count)
        };
        let ranked = self.ranked();
        let psnr_at = |entry: &Entry| entry.part.map_or(MAX_PSNR, |(_, score, _)| score.psnr.min(MAX_PSNR));
        let worst = *ranked.first()?;
        // Six decimals, which survive a round trip through JSON.
        let short = |value: f64| (value * 1e6).round() / 1e6;
        let measured = self.generated().all(|(_, s)| s.lpips.is_some());
        Some(Summary {
            psnr_db: short(mean(&|s| s.psnr.min(MAX_PSNR))),
            median_psnr_db: short(psnr_at(ranked[ranked.len() / 2])),
            worst_psnr_db: short(psnr_at(worst)),
            worst_frame: worst.frame,
            ssim: short(mean(&|s| s.ssim)),
            lpips: measured.then(|| short(mean(&|s| s.lpips.unwrap_or(0.0)))),
            psnr_of_anchor_db: short(mean(&|s| s.psnr_of_anchor.min(MAX_PSNR))),
        })
    }

    /// One line per frame. Missing values are empty.
    pub(super) fn csv(&self, multiplier: u32, rate: u32) -> String {
        let mut text = "frame,time_s,kind,phase,psnr_db,ssim,lpips_alex,psnr_of_anchor_db\n".to_owned();
        for Entry { frame, part, .. } in &self.entries {
            let time = *frame as f64 / f64::from(rate);
            // Writing to a string cannot fail.
            let _ = match part {
                None => writeln!(text, "{frame},{time:.6},anchor,,,,,"),
                Some((part, score, outcome)) => {
                    let kind = if *outcome == Outcome::Generated { "generated" } else { "cut" };
                    let lpips = score.lpips.map(|value| format!("{value:.6}")).unwrap_or_default();
                    let Score { psnr, ssim, psnr_of_anchor, .. } = score;
                    writeln!(
                        text,
                        "{frame},{time:.6},{kind},{part}/{multiplier},{psnr:.4},{ssim:.6},{lpips},{psnr_of_anchor:.4}"
                    )
                }
            };
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scores(values: &[f64]) -> Scores {
        let entry = |(frame, psnr): (u64, &f64)| {
            let score = Score { psnr: *psnr, ssim: psnr / 50.0, lpips: None, psnr_of_anchor: 20.0 };
            Entry { frame, anchor: frame, part: Some((1, score, Outcome::Generated)) }
        };
        let anchor = Entry { frame: 0, anchor: 0, part: None };
        Scores { entries: std::iter::once(anchor).chain((1..).zip(values).map(entry)).collect() }
    }

    #[test]
    fn the_summary_names_the_middle_and_the_worst() {
        let scores = scores(&[30.0, 20.0, f64::INFINITY, 40.0]);
        let summary = scores.summary().unwrap();
        assert_eq!((summary.psnr_db, summary.median_psnr_db), ((30.0 + 20.0 + 100.0 + 40.0) / 4.0, 40.0));
        assert_eq!((summary.worst_psnr_db, summary.worst_frame), (20.0, 2));
        assert_eq!((summary.lpips, summary.psnr_of_anchor_db), (None, 20.0));
        let shown: Vec<_> = scores.median_and_worst().iter().map(|(name, entry)| (*name, entry.frame)).collect();
        assert_eq!(shown, [("median", 4), ("worst", 2)]);
        assert_eq!(super::Scores::default().summary(), None);
    }

    #[test]
    fn the_table_has_a_line_to_a_frame() {
        let text = scores(&[30.0, f64::INFINITY]).csv(2, 30);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 4);
        assert_eq!(lines[1], "0,0.000000,anchor,,,,,");
        assert_eq!(lines[2], "1,0.033333,generated,1/2,30.0000,0.600000,,20.0000");
        assert!(lines[3].contains(",inf,"));
        assert!(lines.iter().all(|line| line.split(',').count() == 8));
    }
}
