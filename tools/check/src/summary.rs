//! What the program prints.

use std::io::IsTerminal as _;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::checks::CheckDefinition;
use crate::finding::Verdict;
use crate::report::{Check, Report};

/// Width of the lines.
const WIDTH: usize = 110;

/// The bar while checks run, on standard error, and the line of each.
pub(crate) struct Progress {
    bar: ProgressBar,
    /// Whether the bar is visible: standard error is a terminal.
    is_shown: bool,
}

impl Progress {
    /// A bar for these checks.
    pub(crate) fn new(count: usize) -> Self {
        let is_shown = std::io::stderr().is_terminal();
        let bar = if is_shown { ProgressBar::new(count as u64) } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len}  {elapsed}  {msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Self { bar, is_shown }
    }

    /// A check starts.
    pub(crate) fn start(&self, check: &CheckDefinition) {
        self.bar.set_message(check.title);
    }

    /// It has ended.
    pub(crate) fn done(&self, check: &Check) {
        self.bar.inc(1);
        self.print(&text_of(check));
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn print(&self, text: &str) {
        if self.is_shown {
            self.bar.suspend(|| println!("{text}"));
        } else {
            println!("{text}");
        }
    }
}

/// The lines of a check.
fn text_of(check: &Check) -> String {
    let head = format!("{:12}{:18}", check.verdict, check.name);
    let mut text = wrapped(&head, &check.sentence);
    if let Some(remedy) = &check.remedy {
        text.push('\n');
        text.push_str(&wrapped(&" ".repeat(head.len()), &format!("What to do: {remedy}")));
    }
    text
}

/// `text` in lines after `head`.
fn wrapped(head: &str, text: &str) -> String {
    let (mut lines, mut line) = (Vec::new(), String::new());
    let room = WIDTH.saturating_sub(head.len()).max(30);
    for word in text.split_whitespace() {
        if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > room {
            lines.push(std::mem::take(&mut line));
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    lines.push(line);
    format!("{head}{}", lines.join(&format!("\n{}", " ".repeat(head.len()))))
}

/// The last lines.
pub(crate) fn totals(report: &Report) -> String {
    let count = |verdict| report.checks.iter().filter(|check| check.verdict == verdict).count();
    let [pass, fail, unknown] = [Verdict::Pass, Verdict::Fail, Verdict::CannotTell].map(count);
    format!(
        "{} on {}: {pass} passed, {fail} failed, {unknown} could not tell, in {:.0} s",
        report.verdict,
        report.machine.adapter_name(),
        report.seconds
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::{check, report};

    #[test]
    fn a_line_has_verdict_name_sentence_and_remedy() {
        let mut failed = check("frames", Verdict::Fail, &[]);
        failed.sentence = "word ".repeat(40);
        let text = text_of(&failed);
        assert!(text.starts_with("FAIL        frames            word"), "{text}");
        assert!(text.lines().all(|line| line.len() <= WIDTH) && text.lines().count() >= 3, "{text}");
        assert!(text.contains("What to do: Do something"));
    }

    #[test]
    fn the_last_line_counts_verdicts() {
        let all = report(vec![check("a", Verdict::Pass, &[]), check("b", Verdict::CannotTell, &[])]);
        assert_eq!(totals(&all), "CANNOT TELL on no adapter: 1 passed, 0 failed, 1 could not tell, in 60 s");
    }
}
