//! Renders a document as one self-contained HTML page.

use super::{Asset, Block};
use crate::table::Table;

const STYLE: &str = "\
:root { color-scheme: light dark; --line: #8884; --soft: #8881; --link: light-dark(#0060a0, #6cb6ff); }
* { box-sizing: border-box; }
body { font: 16px/1.55 system-ui, sans-serif; max-width: 76rem; margin: 0 auto; padding: 1.5rem 1.25rem 5rem; }
h1, h2 { line-height: 1.2; text-wrap: balance; } h1 { margin: 0.5rem 0 1rem; }
h2 { margin: 3rem 0 0.75rem; padding-top: 0.75rem; border-top: 1px solid var(--line); scroll-margin-top: 1rem; }
p { max-width: 52rem; }
a { color: var(--link); }
nav { columns: 18rem; column-gap: 2rem; font-size: 0.875rem; background: var(--soft); border-radius: 0.5rem; padding: 0.75rem 1rem; }
nav a { display: block; text-decoration: none; padding: 0.1rem 0; break-inside: avoid; }
nav a:hover { text-decoration: underline; }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.875rem; min-width: 32rem; }
th, td { padding: 0.35rem 0.75rem; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); }
th { border-bottom: 2px solid #8888; vertical-align: bottom; font-weight: 600; }
tr:nth-child(odd) td { background: var(--soft); }
.number { text-align: right; white-space: nowrap; }
.verdict span { display: inline-block; border-radius: 0.75rem; padding: 0.05rem 0.65rem; font-weight: 600; }
.holds span { background: #009e7333; } .fails span { background: #d55e0033; } .open span { background: #88888833; }
figure { margin: 1.5rem 0; } figure img, figure svg, figure video { display: block; max-width: 100%; height: auto; }
figure img, figure video { border-radius: 0.4rem; background: #181a1e; }
figcaption { font-size: 0.875rem; max-width: 52rem; margin-top: 0.4rem; opacity: 0.85; }
svg text { font: 12px system-ui, sans-serif; fill: currentColor; }
.player { display: flex; flex-wrap: wrap; gap: 0.4rem; align-items: center; margin-top: 0.4rem; font-size: 0.875rem; }
.player button, .player select { font: inherit; padding: 0.15rem 0.6rem; }
.player input { flex: 1 1 16rem; } .player output { min-width: 8rem; font-variant-numeric: tabular-nums; }
";

/// Script that steps a player by frames, at the sample rate of all videos.
const SCRIPT: &str = "\
for (const player of document.querySelectorAll('.player')) {
  const video = player.closest('figure').querySelector('video');
  const [back, play, on] = player.querySelectorAll('button');
  const bar = player.querySelector('input'), speed = player.querySelector('select'), time = player.querySelector('output');
  const frame = 1 / Number(player.dataset.rate);
  const seek = to => { video.pause(); video.currentTime = Math.min(Math.max(to, 0), video.duration - frame / 2); };
  const step = by => seek((Math.round(video.currentTime / frame - 0.5) + by + 0.5) * frame);
  back.onclick = () => step(-1);
  on.onclick = () => step(1);
  play.onclick = () => video.paused ? video.play() : video.pause();
  video.onplay = video.onpause = () => { play.textContent = video.paused ? 'play' : 'pause'; };
  speed.onchange = () => { video.playbackRate = Number(speed.value); };
  bar.oninput = () => seek(bar.value / 1000 * video.duration);
  const tell = () => {
    bar.value = 1000 * video.currentTime / (video.duration || 1);
    time.textContent = `${video.currentTime.toFixed(2)} s, frame ${Math.floor(video.currentTime / frame + 1e-3)}`;
  };
  video.ontimeupdate = video.onseeked = video.onloadeddata = tell;
}
";

/// The page. It loads nothing from anywhere.
pub(super) fn page(title: &str, blocks: &[Block]) -> String {
    let body: String = blocks.iter().enumerate().map(|(number, block)| show(number, block)).collect();
    let links = blocks.iter().enumerate().filter_map(|(number, block)| match block {
        Block::Heading(words) => Some(format!("<a href=\"#s{number}\">{}</a>", escaped(words))),
        _ => None,
    });
    let links: String = links.collect();
    let title = escaped(title);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n\
         <h1>{title}</h1>\n<nav>{links}</nav>\n{body}<script>\n{SCRIPT}</script>\n</html>\n"
    )
}

fn show(number: usize, block: &Block) -> String {
    match block {
        Block::Heading(words) => format!("<h2 id=\"s{number}\">{}</h2>\n", escaped(words)),
        Block::Text(words) => format!("<p>{}</p>\n", strong(&escaped(words))),
        Block::Table(table) => format!("<div class=\"wide\"><table>\n{}</table></div>\n", rows(table)),
        Block::Figure { file: file @ Asset { bytes, .. }, words } => {
            if file.is_svg() {
                figure(&String::from_utf8_lossy(bytes), words)
            } else {
                let source = format!("data:image/jpeg;base64,{}", base64(bytes));
                figure(&format!("<img alt=\"{}\" src=\"{source}\">", escaped(words)), words)
            }
        }
        Block::Player { words, video, rate } => {
            let player = format!(
                "<video muted loop playsinline preload=\"auto\" src=\"data:video/mp4;base64,{}\"></video>\
                 <div class=\"player\" data-rate=\"{rate}\"><button title=\"one frame back\">-1</button><button>play</button>\
                 <button title=\"one frame on\">+1</button><select title=\"speed\"><option value=\"0.1\">x 1/10</option>\
                 <option value=\"0.25\">x 1/4</option><option value=\"0.5\">x 1/2</option><option value=\"1\" selected>x 1</option></select>\
                 <input type=\"range\" min=\"0\" max=\"1000\" value=\"0\" title=\"time\"><output>0.00 s, frame 0</output></div>",
                base64(video)
            );
            figure(&player, words)
        }
    }
}

fn rows(table: &Table) -> String {
    let last = table.head.len().saturating_sub(1);
    let row = |cells: &[String], tag: &str| {
        let cells = cells.iter().enumerate().map(|(column, cell)| {
            let cell = escaped(cell);
            if table.judges && column == last && tag == "td" {
                return format!("<td class=\"verdict {}\"><span>{cell}</span></td>", kind(&cell));
            }
            let kind = if column < table.words { "" } else { " class=\"number\"" };
            format!("<{tag}{kind}>{cell}</{tag}>")
        });
        format!("<tr>{}</tr>\n", cells.collect::<String>())
    };
    row(&table.head, "th") + &table.rows.iter().map(|cells| row(cells, "td")).collect::<String>()
}

/// CSS class of a verdict.
fn kind(verdict: &str) -> &'static str {
    if verdict.starts_with("holds") {
        "holds"
    } else if verdict.starts_with("does not") {
        "fails"
    } else {
        "open"
    }
}

fn figure(inner: &str, words: &str) -> String {
    format!("<figure>{inner}<figcaption>{}</figcaption></figure>\n", escaped(words))
}

/// Converts Markdown's pairs of stars to bold text.
fn strong(text: &str) -> String {
    let parts = text.split("**").enumerate();
    parts.map(|(n, part)| if n % 2 == 1 { format!("<strong>{part}</strong>") } else { part.to_owned() }).collect()
}

/// Escapes text for an element or a quoted attribute.
pub(crate) fn escaped(text: &str) -> String {
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

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let bits = three.iter().enumerate().fold(0_u32, |bits, (i, byte)| bits | u32::from(*byte) << (16 - 8 * i));
        for i in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= three.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        // The test vectors of RFC 4648, section 10.
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xbf]), "+/+/");
    }

    #[test]
    fn a_page_holds_everything_and_asks_nobody() {
        let asset = |path: &str, bytes: &[u8]| Asset { path: path.into(), bytes: bytes.to_vec(), compressed: None };
        let blocks = [
            Block::heading("a < b & \"c\""),
            Block::Table(Table::new(1, &["<scene>", "x"], vec![vec!["forest".into(), "1".into()]])),
            Block::Table(Table::verdicts(&["claim", "here"], vec![vec!["it".into(), "does not hold".into()]])),
            Block::text("**loud** and not"),
            Block::figure(asset("there.jpg", b"foobar"), "a \"sheet\""),
            Block::figure(asset("there.svg", b"<svg><text>x</text></svg>"), "a drawing"),
            Block::Player { words: "a film".into(), video: b"foo".to_vec(), rate: 30 },
        ];
        let page = page("Title", &blocks);
        for part in [
            "<h2 id=\"s0\">a &lt; b &amp; &quot;c&quot;</h2>",
            "<a href=\"#s0\">",
            "<th>&lt;scene&gt;</th>",
            "<td class=\"verdict fails\"><span>does not hold",
            "<strong>loud</strong> and not",
            "data:image/jpeg;base64,Zm9vYmFy",
            "alt=\"a &quot;sheet&quot;\"",
            "<svg><text>x</text></svg>",
            "data:video/mp4;base64,Zm9v",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("there.") && !page.contains("http"));
    }
}
