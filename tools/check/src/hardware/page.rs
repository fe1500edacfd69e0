//! The page of the published reports, `docs/hardware.md`.

use std::fmt::Write as _;

use super::Published;
use crate::compare::number;
use crate::finding::Verdict;
use crate::report::Report;

/// The command that makes the page.
pub(super) const COMMAND: &str = "cargo run --release -p cairn-check -- hardware hardware --page docs/hardware.md";

/// Times in the table of graphics adapters: heading, check, figure.
const TIMES: [(&str, &str, &str); 4] = [
    ("a latent, ms", "latents", "captured passes: a step, median"),
    ("a frame at 1080p, ms", "generator", "1080p, 2x"),
    ("a frame at 4K, ms", "generator", "4K, 2x"),
    ("a frame by FSR at 1080p, ms", "fsr-times", "1080p, 2x, from the call to its end"),
];

const GRAPHICS: &str = "## Graphics adapters\n\n";
const NONE: &str = "No report of a graphics adapter has been sent yet.\n\n";
const MEANING: &str = "A latent is a step of the embedded world in half floats at the preset `stock`, with captured passes, on a device that does nothing else. \
A frame is one between two anchors, by Cairn's shaders or by AMD's library. A dash means that the report does not have it.\n\n";

const EMULATED: &str = "## Adapters that a processor emulates

These reports show that the checks run, and what they find right. **Their times and memory tell nothing about GPUs**: a processor did all the
work, in a Windows with a software driver ([the lab](lab.md)), whose names of adapters Wine may invent.

";

const SENDING: &str = "## Send a report

1. On Windows 10 or 11, close other programs that use the GPU, plug a laptop in, and start `bin/cairn-check.exe` of the archive for Windows, without
   options. It takes at most five minutes. A report by `--quick` is welcome too, but its times come from few frames.
2. Look at `report.html`: it has everything that you send, and pictures.
3. Rename `report.json` after the adapter, in lower-case letters, digits and hyphens: `radeon-rx-7600.json`. If that name is taken, append what
   differs, such as the driver: `radeon-rx-7600-driver-25-3-1.json`.
4. Send it in a pull request that adds the file to the folder `hardware` and has this page made again by the command above, or attach the file to an
   issue report in the project's repository. A report with FAIL or CANNOT TELL lines is as useful as one without.

The file has names, drivers, memory and PCI identifiers of the graphics adapters; the processor's name, threads and memory; the system's version;
and every check's verdict, sentence and figures ([all fields](check.md#the-files)). It has no names of users, machines or folders, no date and no
serial number. The command refuses a file with paths, e-mail addresses, names of machines or fields that `cairn-check` does not write, and says
where they are.

To compare your adapter with a published one:

```sh
cargo run --release -p cairn-check -- compare hardware/A.json report.json
```

`python -m cairn.build rates --reports hardware` compares the rates in these reports with the estimates of [rates](rates.md).
";

/// The page.
pub fn page(reports: &[Published]) -> String {
    let (emulated, graphics): (Vec<_>, Vec<_>) = reports.iter().partition(|sent| is_emulated(&sent.report));
    let mut page = format!(
        "# Reports from graphics adapters\n\n[`cairn-check`](check.md) judged these adapters. Their reports are the files of the folder `hardware`, and this page is made \
         of them:\n\n```sh\n{COMMAND}\n```\n\n{GRAPHICS}"
    );
    if graphics.is_empty() {
        page.push_str(NONE);
    } else {
        let heads: Vec<String> = TIMES.iter().map(|(head, ..)| format!(" {head} |")).collect();
        table(&mut page, &graphics, &heads.concat(), &"--:|".repeat(TIMES.len()), |report| {
            TIMES.iter().map(|(_, check, name)| format!(" {} |", figure(report, check, name))).collect()
        });
        page.push_str(MEANING);
    }
    graphics.iter().for_each(|sent| lines(&mut page, sent, Verdict::CannotTell));
    page.push_str(EMULATED);
    if !emulated.is_empty() {
        table(&mut page, &emulated, "", "", |_| String::new());
        emulated.iter().for_each(|sent| lines(&mut page, sent, Verdict::Fail));
    }
    page.push_str(SENDING);
    page
}

/// Whether times of a report show nothing of a graphics adapter.
fn is_emulated(report: &Report) -> bool {
    let machine = &report.machine;
    machine.emulated || machine.judged.and_then(|index| machine.adapters.get(index)).is_none_or(|it| it.software)
}

/// A row for each report, ending in the cells of `more`.
fn table(page: &mut String, reports: &[&Published], heads: &str, rules: &str, more: impl Fn(&Report) -> String) {
    _ = writeln!(page, "| report | adapter | driver | system | Cairn | passed | could not tell | failed |{heads}");
    _ = writeln!(page, "|---|---|---|---|---|--:|--:|--:|{rules}");
    for Published { file, report } in reports {
        let machine = &report.machine;
        let driver = machine.judged.and_then(|index| machine.adapters.get(index)?.driver.as_deref());
        let count = |verdict| report.checks.iter().filter(|check| check.verdict == verdict).count();
        let [pass, unknown, fail] = [Verdict::Pass, Verdict::CannotTell, Verdict::Fail].map(count);
        _ = writeln!(
            page,
            "| `hardware/{file}`{} | {} | {} | {} | {} | {pass} | {unknown} | {fail} |{}",
            if report.quick { ", quick" } else { "" },
            escaped(machine.adapter_name()),
            escaped(driver.unwrap_or("-")),
            escaped(&machine.system),
            escaped(&report.cairn),
            more(report)
        );
    }
    page.push('\n');
}

/// The checks of a report whose verdicts are `from` or worse.
fn lines(page: &mut String, Published { file, report }: &Published, from: Verdict) {
    let checks: Vec<_> = report.checks.iter().filter(|check| check.verdict >= from).collect();
    if checks.is_empty() {
        return;
    }
    _ = writeln!(page, "Of `hardware/{file}`:\n\n| check | verdict | what was seen |\n|---|---|---|");
    for check in checks {
        _ = writeln!(page, "| `{}` | {} | {} |", check.name.replace('`', "'"), check.verdict, escaped(&check.sentence));
    }
    page.push('\n');
}

/// A measured time, or a dash.
fn figure(report: &Report, check: &str, name: &str) -> String {
    let check = report.checks.iter().find(|found| found.name == check);
    let figure = check.and_then(|check| check.figures.iter().find(|figure| figure.name == name && figure.unit == "ms"));
    figure.map_or_else(|| "-".to_owned(), |figure| number(figure.value))
}

/// A text in a cell of a table: its characters have no meaning in Markdown.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => out.push_str("&lt;"),
            '&' => out.push_str("&amp;"),
            '|' | '[' | ']' | '*' | '_' | '`' | '\\' | '!' => out.extend(['\\', c]),
            _ => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::{check, of_adapter, report};

    fn sent(file: &str, adapter: &str, emulated: bool) -> Published {
        let checks = vec![
            check("latents", Verdict::Pass, &[("captured passes: a step, median", 12.5)]),
            check("generator", Verdict::Pass, &[("1080p, 2x", 0.8), ("4K, 2x", 3.0)]),
            check("window", if emulated { Verdict::CannotTell } else { Verdict::Fail }, &[]),
        ];
        let mut report = of_adapter(adapter, report(checks));
        report.machine.emulated = emulated;
        Published { file: file.to_owned(), report }
    }

    #[test]
    fn adapters_and_emulated_ones_are_apart() {
        let page = page(&[sent("a.json", "Radeon | RX <7600>", false), sent("lab.json", "llvmpipe", true)]);
        let (graphics, emulated) = page.split_once("## Adapters that a processor emulates").unwrap();
        let row = graphics.lines().find(|line| line.starts_with("| `hardware/a.json` |")).unwrap();
        assert!(row.contains(r"| Radeon \| RX &lt;7600> | 1.2.3 | Windows 10 | 0.1.0 | 2 | 0 | 1 |"), "{row}");
        assert!(row.ends_with("| 12.5 | 0.800 | 3 | - |"), "{row}");
        assert!(graphics.contains("| `window` | FAIL | what window saw |") && !graphics.contains(NONE), "{graphics}");
        assert!(!graphics.contains("llvmpipe") && emulated.contains("| `hardware/lab.json` | llvmpipe |"), "{page}");
        assert!(!emulated.contains("12.5") && !emulated.contains("what window saw"), "{emulated}");
    }

    #[test]
    fn without_reports_of_graphics_adapters_the_page_says_so() {
        let mut software = sent("warp.json", "Basic Render", false);
        software.report.machine.adapters[0].software = true;
        for reports in [Vec::new(), vec![sent("lab.json", "llvmpipe", true)], vec![software]] {
            let page = page(&reports);
            assert!(page.contains(NONE) && page.contains("tell nothing about GPUs") && page.contains(COMMAND));
        }
    }
}
