//! `report.html`: one page that loads nothing, with the verdict on top.

use crate::outcome::Figure;
use crate::report::{Line, Report};
use crate::verdict::Verdict;

const STYLE: &str = "\
:root { color-scheme: light dark; --line: #8884; --soft: #8881; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 0 auto; padding: 1.5rem 1.25rem 5rem; }
h1 { margin: 0.5rem 0; } h2 { margin: 2.5rem 0 0.75rem; padding-top: 0.75rem; border-top: 1px solid var(--line); }
.top { border-radius: 0.5rem; padding: 0.75rem 1rem; font-size: 1.25rem; font-weight: 600; }
details { border-bottom: 1px solid var(--line); padding: 0.4rem 0; } summary { cursor: pointer; }
.verdict { display: inline-block; min-width: 8.5rem; text-align: center; border-radius: 0.75rem; padding: 0 0.6rem;
  font-weight: 600; font-size: 0.875rem; }
.pass { background: #009e7333; } .fail { background: #d55e0044; } .cannot_tell { background: #88888833; }
.found, .remedy, table { margin: 0.4rem 0 0.4rem 1.25rem; } .remedy::before { content: 'What to do: '; font-weight: 600; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.875rem; }
td { padding: 0.2rem 0.75rem; vertical-align: top; border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
td.number { text-align: right; white-space: nowrap; }
.time { opacity: 0.6; font-size: 0.8rem; }
";

/// The page of a report.
pub(crate) fn page(report: &Report) -> String {
    let mut body = String::new();
    let mut group = "";
    for line in &report.lines {
        if line.group != group {
            group = &line.group;
            body += &format!("<h2>{}</h2>\n", escaped(group));
        }
        body += &entry(line);
    }
    let short = if report.short { "<p>A short run: its figures are not to be compared.</p>\n" } else { "" };
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>cairn-check: {verdict}</title>\n\
         <style>\n{STYLE}</style>\n<h1>cairn-check</h1>\n<p class=\"top {class}\">{summary}</p>\n\
         <p>Cairn {cairn}, {started}</p>\n{short}{body}</html>\n",
        verdict = report.verdict,
        class = class(report.verdict),
        summary = escaped(&report.summary()),
        cairn = escaped(&report.cairn),
        started = escaped(&report.started),
    )
}

/// A line, which is open unless it passed without figures.
fn entry(line: &Line) -> String {
    let outcome = &line.outcome;
    let open = if outcome.verdict == Verdict::Pass && outcome.figures.is_empty() { "" } else { " open" };
    let remedy =
        outcome.remedy.as_ref().map(|text| format!("<p class=\"remedy\">{}</p>\n", escaped(text))).unwrap_or_default();
    let facts = outcome
        .facts
        .iter()
        .map(|fact| format!("<tr><td>{}</td><td>{}</td></tr>\n", escaped(&fact.name), escaped(&fact.text)));
    let figures = outcome.figures.iter().map(|figure| {
        let (name, value) = (escaped(&figure.name), shown(figure));
        format!("<tr><td>{name}</td><td class=\"number\">{value}</td></tr>\n")
    });
    let rows: String = facts.chain(figures).collect();
    let table = if rows.is_empty() { String::new() } else { format!("<table>\n{rows}</table>\n") };
    format!(
        "<details id=\"{id}\"{open}><summary><span class=\"verdict {class}\">{verdict}</span> {title} \
         <span class=\"time\">{id}, {seconds:.1} s</span></summary>\n<p class=\"found\">{found}</p>\n{remedy}{table}</details>\n",
        id = escaped(&line.id),
        class = class(outcome.verdict),
        verdict = outcome.verdict,
        title = escaped(&line.title),
        seconds = line.seconds,
        found = escaped(&outcome.found),
    )
}

/// A figure's value with its unit, to four digits.
pub(crate) fn shown(figure: &Figure) -> String {
    let whole = figure.value.abs().max(1.0).log10() as usize + 1;
    format!("{:.*} {}", 4_usize.saturating_sub(whole), figure.value, figure.unit)
}

fn class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "pass",
        Verdict::CannotTell => "cannot_tell",
        Verdict::Fail => "fail",
    }
}

/// Escapes text for an element or a quoted attribute.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outcome::{Better, Outcome};
    use crate::report::tests::report;

    #[test]
    fn the_verdict_stands_before_the_lines_and_texts_are_escaped() {
        let figures = Outcome::pass("2 < 3").figure("1080p", 1.234_56, "ms", Better::Lower);
        let text = page(&report([figures, Outcome::fail("<script>", "a \"new\" driver")]));
        let at = |words: &str| text.find(words).unwrap_or_else(|| panic!("{words} is missing: {text}"));
        assert!(at("class=\"top fail\">FAIL: 2 lines") < at("2 &lt; 3"));
        assert!(at("1.235 ms") < at("&lt;script&gt;") && at("a &quot;new&quot; driver") > 0);
        assert!(!text.contains("<script>") && !text.contains("http"), "it runs nothing and loads nothing");
    }

    #[test]
    fn figures_have_four_digits() {
        let of = |value| shown(&Figure { name: String::new(), value, unit: "ms".into(), better: Better::Lower });
        for (value, text) in [(0.01234, "0.012 ms"), (12.345_6, "12.35 ms"), (1234.5, "1234 ms"), (99999.0, "99999 ms")]
        {
            assert_eq!(of(value), text);
        }
    }
}
