//! Tables that are readable as plain text and as Markdown.

/// A table with a header row.
pub(crate) struct Table {
    pub(crate) head: Vec<String>,
    pub(crate) rows: Vec<Vec<String>>,
    /// Number of left-aligned text columns; the following ones have right-aligned numbers.
    pub(crate) words: usize,
    /// Whether the last column has verdicts, which the page colours.
    pub(crate) judges: bool,
}

impl Table {
    /// A table whose first `words` columns are text.
    pub(crate) fn new(words: usize, head: &[&str], rows: Vec<Vec<String>>) -> Self {
        Self { head: head.iter().map(|&cell| cell.to_owned()).collect(), rows, words, judges: false }
    }

    /// A table of text whose last column has verdicts.
    pub(crate) fn verdicts(head: &[&str], rows: Vec<Vec<String>>) -> Self {
        Self { judges: true, ..Self::new(head.len(), head, rows) }
    }

    /// The table as Markdown, with columns padded to their longest cell.
    pub(crate) fn markdown(&self) -> String {
        let length = |text: &str| text.chars().count();
        let widths: Vec<usize> = (0..self.head.len())
            .map(|column| {
                let cells = self.rows.iter().filter_map(|row| row.get(column)).map(|cell| length(cell));
                cells.chain([length(&self.head[column]), 3]).max().unwrap_or(3)
            })
            .collect();
        let right = |column: usize| column >= self.words;
        let line = |cells: &[String]| {
            let padded = widths.iter().enumerate().map(|(column, width)| {
                let cell = cells.get(column).map_or("", String::as_str);
                let space = " ".repeat(width.saturating_sub(length(cell)));
                if right(column) { format!("{space}{cell}") } else { format!("{cell}{space}") }
            });
            format!("| {} |\n", padded.collect::<Vec<_>>().join(" | "))
        };
        let rule = widths.iter().enumerate().map(|(column, width)| {
            let dashes = "-".repeat(width - 1);
            if right(column) { format!("{dashes}:") } else { format!("{dashes}-") }
        });
        let rule: Vec<String> = rule.collect();
        line(&self.head) + &line(&rule) + &self.rows.iter().map(|row| line(row)).collect::<String>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_longest_cell() {
        let rows = vec![vec!["forest".into(), "0.1".into()], vec!["snow".into()]];
        let text = Table::new(1, &["scene", "LPIPS"], rows.clone()).markdown();
        assert_eq!(text, "| scene  | LPIPS |\n| ------ | ----: |\n| forest |   0.1 |\n| snow   |       |\n");
        let text = Table::new(2, &["scene", "LPIPS"], rows).markdown();
        assert_eq!(text, "| scene  | LPIPS |\n| ------ | ----- |\n| forest | 0.1   |\n| snow   |       |\n");
    }
}
