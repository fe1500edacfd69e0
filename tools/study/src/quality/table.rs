//! Reduces frames to tables: frames are averaged to clips, clips to groups, and differences are paired by clip.

use std::fmt::Write as _;

use cairn::{Error, ErrorKind, Result};

use super::measure::Record;
use super::rows;
use crate::metrics::Score;

/// A mean over one row's pictures.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cell {
    pub(super) multiplier: u32,
    pub(super) group: String,
    /// `None` for the mean over the group's clips.
    pub(super) clip: Option<String>,
    pub(super) row: rows::Kind,
    /// Number of pictures, or of clips for a mean over clips.
    pub(super) count: usize,
    pub(super) score: Score,
}

/// All means.
#[derive(Debug, Default)]
pub(super) struct Table {
    /// Means over pictures, one per clip, row and multiple.
    clips: Vec<Cell>,
    /// Means over clips, one per group, row and multiple.
    groups: Vec<Cell>,
    /// Groups of clips that the scenes rendered.
    rendered: Vec<String>,
}

/// Differences between two rows over clips, `a - b`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PairedDifference {
    pub(super) clips: usize,
    /// Clips on which `a` is better, for PSNR, SSIM and LPIPS.
    pub(super) wins: [usize; 3],
    /// Mean, smallest and largest difference, for PSNR, SSIM and LPIPS; `None` for a measure that is missing somewhere.
    pub(super) differences: [Option<[f64; 3]>; 3],
}

/// PSNR, SSIM and LPIPS; `None` for a metric that was not measured.
pub(super) fn measures(score: &Score) -> [Option<f64>; 3] {
    [Some(score.psnr), Some(score.ssim), score.lpips]
}

/// Whether `a` is better than `b` in measure `i` of [`measures`].
pub(super) fn is_better(i: usize, a: f64, b: f64) -> bool {
    if i == 2 { a < b } else { a > b }
}

impl Table {
    pub(super) fn new(records: &[Record]) -> Self {
        let rendered = unique(records.iter().filter(|r| r.is_rendered).map(|r| r.group.clone()));
        let mut table = Self { rendered, ..Self::default() };
        let of_record = |r: &Record| {
            let key = (r.group.clone(), r.clip.clone(), r.row);
            r.multipliers.iter().map(move |m| (*m, key.clone())).collect::<Vec<_>>()
        };
        for (multiplier, (group, clip, row)) in unique(records.iter().flat_map(of_record)) {
            let of = records.iter().filter(|r| r.clip == clip && r.row == row && r.multipliers.contains(&multiplier));
            let scores: Vec<Score> = of.map(|r| r.score).collect();
            if let Some(score) = mean(&scores) {
                table.clips.push(Cell { multiplier, group, clip: Some(clip), row, count: scores.len(), score });
            }
        }
        // A row that cannot make all phases of a multiple would be averaged over easier or harder pictures than the others, so it is left out.
        let most = |cells: &[Cell], c: &Cell| {
            let same = cells.iter().filter(|o| (o.multiplier, &o.clip) == (c.multiplier, &c.clip));
            same.map(|o| o.count).max().unwrap_or(0)
        };
        let all = table.clips.clone();
        table.clips.retain(|cell| cell.count == most(&all, cell));
        for (multiplier, group, row) in unique(table.clips.iter().map(|c| (c.multiplier, c.group.clone(), c.row))) {
            let of = table.clips.iter().filter(|c| c.multiplier == multiplier && c.group == group && c.row == row);
            let scores: Vec<Score> = of.map(|c| c.score).collect();
            if let Some(score) = mean(&scores) {
                table.groups.push(Cell { multiplier, group, clip: None, row, count: scores.len(), score });
            }
        }
        table
    }

    /// The multiples of the anchors' rate that were scored, in order.
    pub(super) fn multipliers(&self) -> Vec<u32> {
        let mut all = unique(self.groups.iter().map(|c| c.multiplier));
        all.sort_unstable();
        all
    }

    /// The groups that were scored at `multiplier`.
    pub(super) fn groups(&self, multiplier: u32) -> Vec<String> {
        unique(self.groups.iter().filter(|c| c.multiplier == multiplier).map(|c| c.group.clone()))
    }

    /// Whether the scenes rendered the clips of a group.
    pub(super) fn is_rendered(&self, group: &str) -> bool {
        self.rendered.iter().any(|rendered| rendered == group)
    }

    /// The rows that were scored at `multiplier`, in the order of the tables.
    pub(super) fn rows(&self, multiplier: u32) -> Vec<rows::Kind> {
        let mut all = unique(self.groups.iter().filter(|c| c.multiplier == multiplier).map(|c| c.row));
        all.sort_unstable();
        all
    }

    /// The mean of a row over the clips of a group.
    pub(super) fn group(&self, multiplier: u32, group: &str, row: rows::Kind) -> Option<&Cell> {
        self.groups.iter().find(|c| c.multiplier == multiplier && c.group == group && c.row == row)
    }

    /// The clips of a group at `multiplier`.
    pub(super) fn clips(&self, multiplier: u32, group: &str) -> Vec<String> {
        let of = self.clips.iter().filter(|c| c.multiplier == multiplier && c.group == group);
        unique(of.filter_map(|c| c.clip.clone()))
    }

    /// The mean of a row over the pictures of a clip.
    pub(super) fn clip(&self, multiplier: u32, clip: &str, row: rows::Kind) -> Option<&Cell> {
        self.clips.iter().find(|c| c.multiplier == multiplier && c.clip.as_deref() == Some(clip) && c.row == row)
    }

    /// Compares two rows over the clips of `groups` that both have; `None` if there is no such clip.
    pub(super) fn paired(
        &self,
        multiplier: u32,
        groups: &[String],
        a: rows::Kind,
        b: rows::Kind,
    ) -> Option<PairedDifference> {
        let clips = groups.iter().flat_map(|group| self.clips(multiplier, group));
        let pairs: Vec<(Score, Score)> = clips
            .filter_map(|clip| Some((self.clip(multiplier, &clip, a)?.score, self.clip(multiplier, &clip, b)?.score)))
            .collect();
        if pairs.is_empty() {
            return None;
        }
        let mut paired = PairedDifference { clips: pairs.len(), wins: [0; 3], differences: [None; 3] };
        for i in 0..3 {
            let of = |(a, b): &(Score, Score)| Some((measures(a)[i]?, measures(b)[i]?));
            let values: Vec<(f64, f64)> = pairs.iter().filter_map(of).collect();
            paired.wins[i] = values.iter().filter(|(a, b)| is_better(i, *a, *b)).count();
            if values.len() == pairs.len() {
                let all = values.iter().map(|(a, b)| a - b);
                let mean = all.clone().sum::<f64>() / values.len() as f64;
                paired.differences[i] =
                    Some([mean, all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max)]);
            }
        }
        Some(paired)
    }

    /// Reads what [`csv`](Self::csv) wrote. Numbers have the digits of the file.
    ///
    /// # Errors
    /// `InvalidArgument` for another file.
    pub(super) fn parse(csv: &str) -> Result<Self> {
        let mut table = Self::default();
        for line in csv.lines().skip(1) {
            let cell = cell(line).ok_or_else(|| {
                Error::new(ErrorKind::InvalidArgument, format!("\"{line}\" is no line of a table of quality"))
            })?;
            if cell.clip.is_some() { table.clips.push(cell) } else { table.groups.push(cell) }
        }
        // Names of rendered groups contain that of their kind of scene: forest, moving-forest, forest-901.
        let is_rendered =
            |group: &String| group.split('-').any(|part| scenes::FAMILIES.iter().any(|family| family.name() == part));
        table.rendered =
            unique(table.groups.iter().map(|cell| cell.group.clone())).into_iter().filter(is_rendered).collect();
        Ok(table)
    }

    /// All means as CSV: clips first, then groups, whose `clip` is empty.
    pub(super) fn csv(&self) -> String {
        let mut text = "multiplier,group,clip,row,count,psnr,ssim,lpips\n".to_owned();
        for cell in self.clips.iter().chain(&self.groups) {
            let Cell { multiplier, group, clip, row, count, score } = cell;
            let lpips = score.lpips.map_or_else(String::new, |v| format!("{v:.5}"));
            let (clip, row) = (clip.as_deref().unwrap_or_default(), row.name());
            _ = writeln!(text, "{multiplier},{group},{clip},{row},{count},{:.4},{:.5},{lpips}", score.psnr, score.ssim);
        }
        text
    }
}

/// Reads a line of [`Table::csv`].
fn cell(line: &str) -> Option<Cell> {
    let [multiplier, group, clip, row, count, psnr, ssim, lpips] =
        line.split(',').collect::<Vec<_>>().try_into().ok()?;
    let number = |text: &str| text.parse::<f64>().ok();
    let lpips = if lpips.is_empty() { None } else { Some(number(lpips)?) };
    Some(Cell {
        multiplier: multiplier.parse().ok()?,
        group: group.to_owned(),
        clip: (!clip.is_empty()).then(|| clip.to_owned()),
        row: rows::KINDS.into_iter().find(|kind| kind.name() == row)?,
        count: count.parse().ok()?,
        score: Score { psnr: number(psnr)?, ssim: number(ssim)?, lpips },
    })
}

/// The distinct values in order of first occurrence.
fn unique<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for value in values {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

/// The mean of scores; LPIPS only where all have it.
pub(super) fn mean(scores: &[Score]) -> Option<Score> {
    if scores.is_empty() {
        return None;
    }
    let n = scores.len() as f64;
    let over = |value: fn(&Score) -> f64| scores.iter().map(value).sum::<f64>() / n;
    let lpips: Option<Vec<f64>> = scores.iter().map(|s| s.lpips).collect();
    Some(Score { psnr: over(|s| s.psnr), ssim: over(|s| s.ssim), lpips: lpips.map(|all| all.iter().sum::<f64>() / n) })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::quality::clips::Phase;

    /// A picture of `clip`: of a scene, whose group is the part before its hyphen, or of a real clip, which is a group of its own.
    pub(in crate::quality) fn record(clip: &str, row: rows::Kind, psnr: f64, lpips: Option<f64>) -> Record {
        let family = clip.split('-').next().unwrap_or_default();
        let is_rendered = scenes::FAMILIES.iter().any(|known| known.name() == family);
        Record {
            clip: clip.into(),
            group: if is_rendered { family } else { clip }.into(),
            is_rendered,
            row,
            anchor: 1,
            phase: Phase::HALF,
            multipliers: vec![2],
            score: Score { psnr, ssim: psnr / 100.0, lpips },
        }
    }

    #[test]
    fn a_clip_with_many_frames_weighs_no_more_than_one_with_few() {
        let kind = rows::Kind::Blend;
        let mut records = vec![record("snow-5", kind, 40.0, Some(0.1))];
        records.extend((0..9).map(|_| record("snow-6", kind, 20.0, Some(0.3))));
        let table = Table::new(&records);
        let cell = table.group(2, "snow", kind).unwrap();
        assert_eq!((cell.count, cell.score.psnr), (2, 30.0));
        assert!((cell.score.lpips.unwrap() - 0.2).abs() < 1e-12);
        assert_eq!(table.clip(2, "snow-6", kind).unwrap().count, 9);
        let csv = table.csv();
        assert_eq!(csv.lines().count(), 1 + 2 + 1);
        assert_eq!(Table::parse(&csv).unwrap().csv(), csv);
        assert!(Table::parse("head\n2,snow,,meadow,1,2,3,4").is_err());
        assert!(table.group(4, "snow", kind).is_none());
    }

    #[test]
    fn a_row_that_cannot_do_all_phases_is_left_out_of_that_multiple() {
        let mut records = Vec::new();
        for phase in Phase::all(4) {
            let multipliers = if phase == Phase::HALF { vec![2, 4] } else { vec![4] };
            let blend = Record { phase, multipliers, ..record("snow-5", rows::Kind::Blend, 30.0, None) };
            if phase == Phase::HALF {
                records.push(Record { row: rows::Kind::Rife, ..blend.clone() });
            }
            records.push(blend);
        }
        let table = Table::new(&records);
        assert_eq!(table.rows(2), [rows::Kind::Blend, rows::Kind::Rife]);
        assert_eq!(table.rows(4), [rows::Kind::Blend]);
    }

    #[test]
    fn differences_are_taken_clip_by_clip() {
        let (a, b) = (rows::Kind::Flow, rows::Kind::Blend);
        let records = [
            record("snow-5", a, 30.0, Some(0.1)),
            record("snow-5", b, 28.0, Some(0.2)),
            record("snow-6", a, 20.0, None),
            record("snow-6", b, 21.0, Some(0.2)),
            record("desert-5", a, 50.0, Some(0.0)),
        ];
        let table = Table::new(&records);
        let groups = [String::from("snow"), String::from("desert")];
        let paired = table.paired(2, &groups, a, b).unwrap();
        assert_eq!((paired.clips, paired.wins), (2, [1, 1, 1]));
        assert_eq!(paired.differences[0], Some([0.5, -1.0, 2.0]));
        assert_eq!(paired.differences[2], None);
        assert!(table.paired(2, &groups[1..], a, b).is_none());
    }
}
