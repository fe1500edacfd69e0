//! Parts of resources: ranges of bytes in buffers, rectangles of mipmap levels and array slices in textures.

use std::ops::Range;

/// A part of one resource.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Region {
    /// The whole resource.
    All,
    /// Bytes of a buffer.
    Bytes(Range<u64>),
    /// Subresources of a texture: mipmap levels of array slices, all planes.
    Subresources {
        /// Mipmap levels.
        levels: Range<u32>,
        /// Array slices.
        slices: Range<u32>,
    },
}

impl Region {
    /// One subresource, by its number in a texture with `levels` levels and `slices` slices.
    pub fn subresource(number: u32, levels: u32, slices: u32) -> Self {
        let (level, slice) = (number % levels.max(1), number / levels.max(1) % slices.max(1));
        Self::Subresources { levels: level..level + 1, slices: slice..slice + 1 }
    }

    /// Whether a resource of these bytes, or of a shape of levels, slices and planes, has it. Subresources without an end are those that
    /// there are.
    pub fn is_within(&self, bytes: u64, [levels, slices, _]: [u32; 3]) -> bool {
        let has = |range: &Range<u32>, count: u32| range.start < count && (range.end <= count || range.end == u32::MAX);
        match self {
            Self::All => true,
            Self::Bytes(range) => range.end <= bytes,
            Self::Subresources { levels: l, slices: s } => has(l, levels) && has(s, slices),
        }
    }

    /// Whether both have something in common.
    pub fn overlaps(&self, other: &Self) -> bool {
        fn meet<T: Ord>(a: &Range<T>, b: &Range<T>) -> bool {
            a.start < b.end && b.start < a.end
        }
        match (self, other) {
            (Self::Bytes(a), Self::Bytes(b)) => meet(a, b),
            (Self::Subresources { levels: a, slices: c }, Self::Subresources { levels: b, slices: d }) => {
                meet(a, b) && meet(c, d)
            }
            _ => true,
        }
    }

    /// Numbers of the subresources in a resource with `levels` levels, `slices` slices and `planes` planes.
    pub fn numbers(&self, levels: u32, slices: u32, planes: u32) -> Vec<usize> {
        let (chosen_levels, chosen_slices) = match self {
            Self::Subresources { levels: l, slices: s } => (l.start..l.end.min(levels), s.start..s.end.min(slices)),
            Self::All | Self::Bytes(_) => (0..levels, 0..slices),
        };
        let number = |plane: u32, slice: u32, level: u32| (level + levels * (slice + slices * plane)) as usize;
        let of_slice = |plane, slice| chosen_levels.clone().map(move |level| (plane, slice, level)).collect::<Vec<_>>();
        let of_plane = |plane| chosen_slices.clone().flat_map(move |slice| of_slice(plane, slice)).collect::<Vec<_>>();
        (0..planes).flat_map(of_plane).map(|(plane, slice, level)| number(plane, slice, level)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_overlap_only_inside_their_ends() {
        assert!(Region::Bytes(0..8).overlaps(&Region::Bytes(7..9)));
        assert!(!Region::Bytes(0..8).overlaps(&Region::Bytes(8..9)));
        assert!(Region::All.overlaps(&Region::Bytes(8..9)));
    }

    #[test]
    fn subresources_are_numbered_by_level_then_slice_then_plane() {
        let second_level = Region::Subresources { levels: 1..2, slices: 0..u32::MAX };
        assert_eq!(second_level.numbers(3, 2, 1), [1, 4]);
        assert_eq!(Region::All.numbers(2, 2, 2), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(Region::subresource(4, 3, 2).numbers(3, 2, 1), [4]);
        assert!(!Region::subresource(4, 3, 2).overlaps(&Region::subresource(1, 3, 2)));
        assert!(second_level.overlaps(&Region::subresource(4, 3, 2)));
    }
}
