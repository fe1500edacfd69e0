//! The page `report.html`: the verdict, then a table by group, with pictures where people look. One file without scripts or links.

use std::fmt::Write as _;

use crate::checks::Group;
use crate::compare::number;
use crate::finding::Verdict;
use crate::report::{Check, Report};

const STYLE: &str = include_str!("page.css");

/// The page of a report.
pub fn html(report: &Report) -> String {
    let mut page = String::new();
    let machine = &report.machine;
    let count = |verdict| report.checks.iter().filter(|check| check.verdict == verdict).count();
    _ = write!(
        page,
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>cairn-check: {0} on {1}</title>\n<style>{STYLE}</style></head>\n\
         <body><h1 class=\"{2}\">{0}</h1>\n<p class=\"adapter\">{1}</p>\n",
        report.verdict,
        escaped(machine.adapter_name()),
        class(report.verdict)
    );
    _ = writeln!(
        page,
        "<p>{} passed, {} failed, {} could not tell. Cairn {}, {:.0} s{}{}.</p>",
        count(Verdict::Pass),
        count(Verdict::Fail),
        count(Verdict::CannotTell),
        escaped(&report.cairn),
        report.seconds,
        if report.quick { ", quick: fewer cases" } else { "" },
        if report.optimised { "" } else { ", compiled without optimisation: times of the processor are too long" }
    );
    _ = writeln!(
        page,
        "<p>{}; {}, {} threads; {} MiB of memory.</p>",
        escaped(&machine.system),
        escaped(&machine.processor),
        machine.threads,
        machine.memory >> 20
    );
    adapters(&mut page, report);
    for group in Group::ALL {
        let checks: Vec<&Check> = report.checks.iter().filter(|check| check.group == group.name()).collect();
        if checks.is_empty() {
            continue;
        }
        _ = writeln!(page, "<h2>{}</h2>\n<table>", escaped(group.title()));
        for check in checks {
            row(&mut page, check);
        }
        page.push_str("</table>\n");
    }
    page.push_str("</body></html>\n");
    page
}

fn adapters(page: &mut String, report: &Report) {
    if report.machine.adapters.is_empty() {
        return;
    }
    page.push_str(
        "<table><tr><th>Adapter</th><th>Driver</th><th>Memory</th><th>Feature level</th><th>Shader model</th></tr>\n",
    );
    for (index, adapter) in report.machine.adapters.iter().enumerate() {
        let judged = if report.machine.judged == Some(index) { " (judged)" } else { "" };
        let software = if adapter.software { ", emulated by the processor" } else { "" };
        let or_unknown = |text: &Option<String>| escaped(text.as_deref().unwrap_or("unknown"));
        _ = writeln!(
            page,
            "<tr><td>{}{software}{judged}</td><td>{}</td><td>{} MiB</td><td>{}</td><td>{}</td></tr>",
            escaped(&adapter.name),
            or_unknown(&adapter.driver),
            adapter.memory >> 20,
            or_unknown(&adapter.feature_level),
            or_unknown(&adapter.shader_model)
        );
    }
    page.push_str("</table>\n");
}

fn row(page: &mut String, check: &Check) {
    _ = write!(
        page,
        "<tr><td class=\"verdict {}\">{}</td><td><b>{}</b><br><code>{}</code></td><td>{}",
        class(check.verdict),
        check.verdict,
        escaped(&check.title),
        escaped(&check.name),
        escaped(&check.sentence)
    );
    if let Some(remedy) = &check.remedy {
        _ = write!(page, "<br><i>What to do: {}</i>", escaped(remedy));
    }
    if !check.figures.is_empty() {
        page.push_str("<table class=\"figures\">");
        for figure in &check.figures {
            let (name, unit) = (escaped(&figure.name), escaped(&figure.unit));
            _ = write!(
                page,
                "<tr><td>{name}</td><td class=\"number\">{}</td><td>{unit}</td></tr>",
                number(figure.value)
            );
        }
        page.push_str("</table>");
    }
    if !check.pictures.is_empty() {
        page.push_str("<div class=\"pictures\">");
        for picture in &check.pictures {
            let caption = escaped(&picture.caption);
            _ = write!(
                page,
                "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{}\"><figcaption>{caption}</figcaption></figure>",
                picture.png
            );
        }
        page.push_str("</div>");
    }
    page.push_str("</td></tr>\n");
}

fn class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "pass",
        Verdict::CannotTell => "unknown",
        Verdict::Fail => "fail",
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::{check, report};

    #[test]
    fn the_verdict_is_first_and_text_is_escaped() {
        let mut failed = check("frames", Verdict::Fail, &[("1080p", 2.0)]);
        failed.sentence = "<b> & \"c\"".to_owned();
        let page = html(&report(vec![failed]));
        let at = |text: &str| page.find(text).unwrap_or_else(|| panic!("{text}: {page}"));
        assert!(at("<h1 class=\"fail\">FAIL") < at("<h2>"));
        assert!(at("&lt;b&gt; &amp; &quot;c&quot;") < at("1080p"));
        assert!(!page.contains("http"), "it needs nothing else");
    }
}
