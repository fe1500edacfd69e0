//! Text in pictures, in the Spleen bitmap font.

use cairn::Picture;
use spleen_font::{FONT_8X16, FONT_12X24};

/// For labels.
pub(crate) const SMALL: Font = Font { width: 8, height: 16, header: 4, font: FONT_8X16 };
/// For headings.
pub(crate) const LARGE: Font = Font { width: 12, height: 24, header: 32, font: FONT_12X24 };

/// A font size in pixels and its file: a PSF 1 or PSF 2 header, then the glyphs, ASCII first and in order.
#[derive(Clone, Copy)]
pub(crate) struct Font {
    pub(crate) width: u32,
    pub(crate) height: u32,
    header: usize,
    font: &'static [u8],
}

impl Font {
    /// Rows of whole bytes with the leftmost pixel in the highest bit. Non-ASCII characters give a question mark.
    fn glyph(self, letter: char) -> impl Iterator<Item = &'static [u8]> {
        let row = self.width.div_ceil(8) as usize;
        let code = if letter.is_ascii_graphic() || letter == ' ' { letter as usize } else { '?' as usize };
        let bytes = row * self.height as usize;
        let start = self.header + code * bytes;
        self.font.get(start..start + bytes).unwrap_or_default().chunks_exact(row)
    }
}

/// Writes one line with its upper left corner at `at`, clipped to the picture. Returns the column after it.
pub(crate) fn write(out: &mut Picture, text: &str, at: (u32, u32), size: Font, colour: [u8; 3]) -> u32 {
    let (width, height) = out.size();
    let mut x = at.0;
    for letter in text.chars() {
        for (row, bits) in (at.1..height).zip(size.glyph(letter)) {
            for (column, bit) in (x..width).zip(0..size.width) {
                if bits[bit as usize / 8] & (0x80 >> (bit % 8)) != 0 {
                    out.pixels_mut()[(row * width + column) as usize][..3].copy_from_slice(&colour);
                }
            }
        }
        x = x.saturating_add(size.width);
    }
    x
}

/// The start of `text` that fits `width` pixels, with `...` if it is shortened.
pub(crate) fn fit(text: &str, width: u32, size: Font) -> String {
    let room = (width / size.width) as usize;
    if text.chars().count() <= room {
        return text.to_owned();
    }
    let mut cut: String = text.chars().take(room.saturating_sub(3)).collect();
    cut.push_str("...");
    cut
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_fill_their_cells_and_differ() {
        for size in [SMALL, LARGE] {
            let drawn = |text: &str| {
                let mut picture = Picture::new(4 * size.width, size.height).unwrap();
                assert_eq!(write(&mut picture, text, (0, 0), size, [255; 3]), text.len() as u32 * size.width);
                picture
            };
            let (h, i) = (drawn("H"), drawn("i"));
            assert!(h != i);
            // Both stems of an H span most of its height.
            let lit =
                |row: u32| (0..size.width).filter(|x| h.pixels()[(row * 4 * size.width + x) as usize][0] > 0).count();
            let rows = (0..size.height).filter(|&row| lit(row) >= 2).count() as u32;
            assert!(rows >= size.height / 2, "{rows} rows");
            // Text outside the picture is clipped.
            write(&mut drawn("x"), "cut off", (3 * size.width, size.height - 3), size, [255; 3]);
        }
    }

    #[test]
    fn long_text_is_cut_with_dots() {
        assert_eq!(fit("anchor", 100, SMALL), "anchor");
        assert_eq!(fit("operating point", 80, SMALL), "operati...");
    }
}
