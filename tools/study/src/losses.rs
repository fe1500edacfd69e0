//! Sentences that say in which measures a row of a table loses to other rows.

use crate::statistics::Estimate;

/// Name, digits in tables, and whether more is better.
const MEASURES: [(&str, usize, bool); 3] = [("PSNR", 2, true), ("SSIM", 4, true), ("LPIPS", 4, false)];

/// A row as its table shows it.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    /// PSNR in dB, SSIM and LPIPS, rounded to the table's digits; `None` if not measured.
    shown: [Option<f64>; 3],
}

impl Row {
    /// A row with the means of PSNR in dB, SSIM and LPIPS.
    pub(crate) fn new(name: &'static str, scores: [Option<f64>; 3]) -> Self {
        let mut shown = scores;
        for (value, (_, digits, _)) in shown.iter_mut().zip(MEASURES) {
            // Rounded, so that no sentence contradicts its table.
            *value = value.and_then(|value| format!("{value:.digits$}").parse().ok());
        }
        Self { name, shown }
    }

    /// A row with the means of three estimates.
    pub(crate) fn of(name: &'static str, scores: [Option<Estimate>; 3]) -> Self {
        Self::new(name, scores.map(|score| score.map(|estimate| estimate.mean)))
    }

    /// Whether this row is better than `other` in measure `i`.
    fn beats(&self, other: &Self, i: usize) -> bool {
        let more = MEASURES[i].2;
        matches!((self.shown[i], other.shown[i]), (Some(own), Some(other)) if if more { own > other } else { own < other })
    }

    fn number(&self, i: usize) -> String {
        self.shown[i].map_or_else(|| "–".into(), |value| format!("{value:.*}", MEASURES[i].1))
    }
}

/// Where `own` loses to which of `others`, as in "in LPIPS (0.0289) to `repeat` (0.0251)"; `None` where no other row is better.
pub(crate) fn losses(own: &Row, others: &[&Row]) -> Option<String> {
    let parts = (0..3).filter_map(|i| {
        let better = others.iter().filter(|other| other.beats(own, i));
        let names: Vec<String> = better.map(|other| format!("`{}` ({})", other.name, other.number(i))).collect();
        (!names.is_empty()).then(|| format!("in {} ({}) to {}", MEASURES[i].0, own.number(i), list(&names)))
    });
    let parts: Vec<String> = parts.collect();
    (!parts.is_empty()).then(|| parts.join(", and "))
}

/// The best row in each measure, and the measure's name. `preferred` is the best of those it is equal to.
pub(crate) fn winners<'a>(rows: &[&'a Row], preferred: &str) -> Vec<(&'static str, &'a Row)> {
    let of = |i: usize| {
        let best = rows.iter().filter(|row| row.shown[i].is_some() && !rows.iter().any(|other| other.beats(row, i)));
        best.min_by_key(|row| row.name != preferred).map(|row| (MEASURES[i].0, *row))
    };
    (0..3).filter_map(of).collect()
}

/// "a", "a and b", "a, b and c".
pub(crate) fn list(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [only] => only.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The cells of the first table after `heading` in a page of `docs`, without its head.
    pub(crate) fn published(page: &str, heading: &str) -> Vec<Vec<String>> {
        let (_, after) = page.split_once(&format!("\n{heading}\n")).expect("the heading");
        let lines = after.lines().skip_while(|line| !line.starts_with('|')).take_while(|line| line.starts_with('|'));
        lines
            .skip(2)
            .map(|line| line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect())
            .collect()
    }

    /// The number that a cell begins with.
    pub(crate) fn value(cell: &str) -> Option<f64> {
        cell.split(' ').next()?.parse().ok()
    }

    #[test]
    fn a_row_loses_where_another_is_better_by_a_digit_that_is_shown() {
        let own = Row::new("own", [Some(40.001), Some(0.98), Some(0.0289)]);
        let near = Row::new("near", [Some(40.004), Some(0.98), Some(0.0251)]);
        let far = Row::new("far", [Some(41.0), Some(0.9), Some(0.0288)]);
        assert_eq!(losses(&own, &[&near]).unwrap(), "in LPIPS (0.0289) to `near` (0.0251)");
        let both = losses(&own, &[&near, &far]).unwrap();
        assert_eq!(
            both,
            "in PSNR (40.00) to `far` (41.00), and in LPIPS (0.0289) to `near` (0.0251) and `far` (0.0288)"
        );
        assert_eq!(losses(&far, &[&Row::new("none", [None; 3])]), None);
        let best: Vec<_> = winners(&[&near, &own, &far], "own").into_iter().map(|(_, row)| row.name).collect();
        assert_eq!(best, ["far", "own", "near"], "a tie is of the preferred one");
    }
}
