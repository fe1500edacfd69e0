//! Placement of a picture in a frame of another size.

/// A rectangle of a frame, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Area {
    /// Its top left pixel, `(x, y)`.
    pub(super) at: (u32, u32),
    /// Width and height, at least 1.
    pub(super) size: (u32, u32),
}

impl Area {
    /// The area of a picture in a frame: the whole frame, or with `letterbox` the largest centred area of the picture's aspect ratio.
    pub(super) fn of(picture: (u32, u32), frame: (u32, u32), letterbox: bool) -> Self {
        let [[w, h], [fw, fh]] = [picture, frame].map(|(w, h)| [u64::from(w), u64::from(h)]);
        // Rounded to the nearest pixel; never larger than the frame.
        let part = |of: u64, by: u64, to: u64| (((2 * of * by + to) / (2 * to)).max(1)) as u32;
        let size = match (w * fh).cmp(&(fw * h)) {
            _ if !letterbox => frame,
            std::cmp::Ordering::Less => (part(w, fh, h).min(frame.0), frame.1),
            std::cmp::Ordering::Greater => (frame.0, part(h, fw, w).min(frame.1)),
            std::cmp::Ordering::Equal => frame,
        };
        Self { at: ((frame.0 - size.0) / 2, (frame.1 - size.1) / 2), size }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_letterboxed_or_fills_the_frame() {
        let of = |picture, frame| {
            let Area { at, size } = Area::of(picture, frame, true);
            [at.0, at.1, size.0, size.1]
        };
        assert_eq!(of((640, 360), (1920, 1080)), [0, 0, 1920, 1080]);
        assert_eq!(of((640, 360), (1920, 1200)), [0, 60, 1920, 1080]);
        assert_eq!(of((640, 360), (2560, 1080)), [320, 0, 1920, 1080]);
        assert_eq!(of((3, 2), (10, 10)), [0, 1, 10, 7]);
        // Never thinner than a pixel.
        assert_eq!(of((16_384, 1), (100, 100)), [0, 49, 100, 1]);
        assert_eq!(of((1, 16_384), (1, 1)), [0, 0, 1, 1]);
        assert_eq!(Area::of((3, 2), (10, 10), false), Area { at: (0, 0), size: (10, 10) });
    }
}
