//! The report as one HTML page that needs nothing beside it.

use super::Block;

const STYLE: &str = "\
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2.5rem; }
p { max-width: 48rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.875rem; }
th, td { padding: 0.3rem 0.7rem; text-align: left; border-bottom: 1px solid #8885; }
th { border-bottom: 2px solid #8888; }
.number { text-align: right; }
figure { margin: 1.5rem 0; } img, svg { max-width: 100%; height: auto; } figcaption { font-size: 0.875rem; }
svg text { font: 12px system-ui, sans-serif; fill: currentColor; }
";

/// The page. Nothing in it is fetched from anywhere.
pub(super) fn page(title: &str, blocks: &[Block]) -> String {
    let body: String = blocks.iter().map(block).collect();
    let title = escaped(title);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n\
         <h1>{title}</h1>\n{body}</html>\n"
    )
}

fn block(block: &Block) -> String {
    match block {
        Block::Heading(words) => format!("<h2>{}</h2>\n", escaped(words)),
        Block::Text(words) => format!("<p>{}</p>\n", escaped(words)),
        Block::Table(table) => {
            let row = |cells: &[String], tag: &str| {
                let cells = cells.iter().enumerate().map(|(column, cell)| {
                    let kind = if column < table.words { "" } else { " class=\"number\"" };
                    format!("<{tag}{kind}>{}</{tag}>", escaped(cell))
                });
                format!("<tr>{}</tr>\n", cells.collect::<String>())
            };
            let rows: String = table.rows.iter().map(|cells| row(cells, "td")).collect();
            format!("<div class=\"wide\"><table>\n{}{rows}</table></div>\n", row(&table.head, "th"))
        }
        Block::Picture { words, png, .. } => {
            figure(&format!("<img alt=\"{}\" src=\"data:image/png;base64,{}\">", escaped(words), base64(png)), words)
        }
        Block::Curves { words, svg } => figure(svg, words),
    }
}

fn figure(inner: &str, words: &str) -> String {
    format!("<figure>{inner}<figcaption>{}</figcaption></figure>\n", escaped(words))
}

/// Text as it may stand in an element or in a quoted attribute.
pub(super) fn escaped(text: &str) -> String {
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
    use super::super::Table;
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
        let blocks = [
            Block::heading("a < b & \"c\""),
            Block::Table(Table::new(1, &["<scene>", "x"], vec![vec!["forest".into(), "1".into()]])),
            Block::Picture { path: "there.png".into(), words: "a \"sheet\"".into(), png: b"foobar".to_vec() },
        ];
        let page = page("Title", &blocks);
        assert!(page.contains("a &lt; b &amp; &quot;c&quot;") && page.contains("<th>&lt;scene&gt;</th>"));
        assert!(page.contains("data:image/png;base64,Zm9vYmFy") && page.contains("alt=\"a &quot;sheet&quot;\""));
        assert!(!page.contains("there.png") && !page.contains("http"));
    }
}
