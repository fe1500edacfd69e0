//! Words in pictures.

use cairn::Picture;
use spleen_font::{FONT_8X16, FONT_12X24, PSF2Font};

/// Height and advance of the two sizes, in pixels.
pub(crate) const SMALL: Size = Size { width: 8, height: 16 };
/// For headings.
pub(crate) const LARGE: Size = Size { width: 12, height: 24 };

/// A size of the font.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Size {
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// Writes one line with its upper left corner at `at`; what does not fit is cut off. Returns the column behind it.
pub(crate) fn write(out: &mut Picture, text: &str, at: (u32, u32), size: Size, colour: [u8; 3]) -> u32 {
    let Ok(mut font) = PSF2Font::new(if size == LARGE { FONT_12X24 } else { FONT_8X16 }) else { return at.0 };
    let (width, height) = out.size();
    let mut x = at.0;
    for letter in text.chars() {
        let mut utf8 = [0; 4];
        if let Some(glyph) = font.glyph_for_utf8(letter.encode_utf8(&mut utf8).as_bytes()) {
            for (row, bits) in (at.1..height).zip(glyph) {
                for (column, on) in (x..width).zip(bits) {
                    if on {
                        out.pixels_mut()[(row * width + column) as usize][..3].copy_from_slice(&colour);
                    }
                }
            }
        }
        x = x.saturating_add(size.width);
    }
    x
}

/// As much of `text` as fits `width` pixels, with `...` where something is missing.
pub(crate) fn fit(text: &str, width: u32, size: Size) -> String {
    let room = (width / size.width) as usize;
    if text.chars().count() <= room {
        return text.to_owned();
    }
    let mut cut: String = text.chars().take(room.saturating_sub(3)).collect();
    cut.push_str("...");
    cut
}
