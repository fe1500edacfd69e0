//! The contents of the lab's display: the X root window in XWD format.

use std::path::Path;

use super::frames::Ppm;

/// Indices of the XWD header's words that are read here. All are big-endian, 32 bits.
mod word {
    pub(super) const HEADER_SIZE: usize = 0;
    pub(super) const VERSION: usize = 1;
    pub(super) const PIXMAP_FORMAT: usize = 2;
    pub(super) const WIDTH: usize = 4;
    pub(super) const HEIGHT: usize = 5;
    pub(super) const BYTE_ORDER: usize = 7;
    pub(super) const BITS_PER_PIXEL: usize = 11;
    pub(super) const BYTES_PER_LINE: usize = 12;
    pub(super) const RED_MASK: usize = 14;
    pub(super) const COLOURS: usize = 19;
}

/// A rectangle in pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rectangle {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Rectangle {
    fn contains(&self, x: usize, y: usize) -> bool {
        (self.left..self.left + self.width).contains(&x) && (self.top..self.top + self.height).contains(&y)
    }
}

/// Reads the root window; `None` for a display that is just starting or ending.
pub(in crate::test) fn read(path: &Path) -> Option<Ppm> {
    parse(&std::fs::read(path).ok()?)
}

fn parse(bytes: &[u8]) -> Option<Ppm> {
    let word = |index: usize| {
        let bytes = bytes.get(index * 4..index * 4 + 4)?;
        usize::try_from(u32::from_be_bytes(bytes.try_into().ok()?)).ok()
    };
    let [width, height, pitch] = [word(word::WIDTH)?, word(word::HEIGHT)?, word(word::BYTES_PER_LINE)?];
    // Version 7, a Z pixmap of 32 bits with the least significant byte, blue, first: what Xvfb has at a depth of 24.
    let known = word(word::VERSION)? == 7
        && word(word::PIXMAP_FORMAT)? == 2
        && word(word::BYTE_ORDER)? == 0
        && word(word::BITS_PER_PIXEL)? == 32
        && word(word::RED_MASK)? == 0xFF_0000;
    let start = word(word::HEADER_SIZE)?.checked_add(word(word::COLOURS)?.checked_mul(12)?)?;
    let rows = bytes.get(start..start.checked_add(pitch.checked_mul(height)?)?)?;
    if !known || pitch < width.checked_mul(4)? || width == 0 {
        return None;
    }
    let mut pixels = Vec::with_capacity(width * height * 3);
    for row in rows.chunks_exact(pitch) {
        pixels.extend(row[..width * 4].chunks_exact(4).flat_map(|pixel| [pixel[2], pixel[1], pixel[0]]));
    }
    Some(Ppm { width, height, pixels })
}

/// Position of `picture` in `screen`: all pixels match, except those inside `over`.
pub(super) fn find(screen: &Ppm, picture: &Ppm, over: Rectangle) -> Option<(usize, usize)> {
    // A row that `over` does not cover is searched for first.
    let first_row = (0..picture.height).find(|y| !(over.top..over.top + over.height).contains(y))?;
    let wanted = &picture.pixels[row(picture, first_row)];
    for top in 0..(screen.height + 1).checked_sub(picture.height)? {
        let line = &screen.pixels[row(screen, top + first_row)];
        // Skips black rows, which most of a display consists of.
        if line.iter().all(|byte| *byte == 0) {
            continue;
        }
        let positions = line.windows(wanted.len()).step_by(3).enumerate();
        let mut positions = positions.filter(|(_, there)| there == &wanted).map(|(left, _)| (left, top));
        if let Some(position) = positions.find(|position| is_at(screen, picture, *position, over)) {
            return Some(position);
        }
    }
    None
}

/// Whether `picture` is at that position of `screen`, except for the pixels inside `over`.
pub(super) fn is_at(screen: &Ppm, picture: &Ppm, (left, top): (usize, usize), over: Rectangle) -> bool {
    if left + picture.width > screen.width || top + picture.height > screen.height {
        return false;
    }
    let pixel = |of: &Ppm, x: usize, y: usize| {
        let at = (y * of.width + x) * 3;
        [of.pixels[at], of.pixels[at + 1], of.pixels[at + 2]]
    };
    let same = |x, y| over.contains(x, y) || pixel(picture, x, y) == pixel(screen, left + x, top + y);
    (0..picture.height).all(|y| (0..picture.width).all(|x| same(x, y)))
}

/// Byte range of a row.
fn row(picture: &Ppm, y: usize) -> std::ops::Range<usize> {
    y * picture.width * 3..(y + 1) * picture.width * 3
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: Rectangle = Rectangle { left: 0, top: 0, width: 0, height: 0 };

    fn screen() -> Ppm {
        let pixels = (0..6 * 4 * 3).map(|i| (i * 37 % 251) as u8).collect();
        Ppm { width: 6, height: 4, pixels }
    }

    /// A small picture cut out of a screen at (2, 1).
    fn part(of: &Ppm) -> Ppm {
        let rows = (1..4).flat_map(|y| of.pixels[(y * 6 + 2) * 3..(y * 6 + 5) * 3].to_vec());
        Ppm { width: 3, height: 3, pixels: rows.collect() }
    }

    #[test]
    fn a_picture_is_found_where_it_is_and_nowhere_else() {
        let (screen, mut picture) = (screen(), part(&screen()));
        assert_eq!(find(&screen, &picture, NOTHING), Some((2, 1)));
        picture.pixels[(2 * 3 + 1) * 3] ^= 1;
        assert_eq!(find(&screen, &picture, NOTHING), None);
        let over = Rectangle { left: 1, top: 2, width: 1, height: 1 };
        assert_eq!(find(&screen, &picture, over), Some((2, 1)));
        let larger = Ppm { width: 6, height: 5, pixels: vec![0; 90] };
        assert_eq!(find(&screen, &larger, NOTHING), None);
    }

    #[test]
    fn a_screen_is_read_whole_or_not() {
        let mut words = [0u32; 25];
        words[word::HEADER_SIZE] = 100;
        words[word::VERSION] = 7;
        words[word::PIXMAP_FORMAT] = 2;
        (words[word::WIDTH], words[word::HEIGHT], words[word::BYTES_PER_LINE]) = (1, 2, 8);
        (words[word::BITS_PER_PIXEL], words[word::RED_MASK], words[word::COLOURS]) = (32, 0xFF_0000, 1);
        let mut bytes: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        bytes.extend([0; 12]);
        bytes.extend(*b"bgr.....BGR.....");
        let read = parse(&bytes).unwrap();
        assert_eq!((read.width, read.height, read.pixels.as_slice()), (1, 2, &b"rgbRGB"[..]));
        assert!(parse(&bytes[..bytes.len() - 1]).is_none() && parse(&bytes[..60]).is_none());
        bytes[word::VERSION * 4 + 3] = 6;
        assert!(parse(&bytes).is_none());
    }
}
