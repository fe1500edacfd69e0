//! What every generator must do, on scenes whose in-between pictures are known.

#[path = "../tests/bounds.rs"]
mod bounds;
#[path = "../tests/scenes.rs"]
mod scenes;
#[path = "../tests/world.rs"]
mod world;

use super::SegmentGenerator as Generator;

use super::super::kernels::{BLOCK, Level, TILE};
use super::super::layer::{Grid, HOLE, Key, WHOLE, key};
use super::super::perspective::{Moment, Perspective, Way};
use super::field::cluster;
use super::holes::{Covers, Evidence};
use super::tiles::{SLOTS, Segment, Segments, block, split};
use super::warp::{Bands, Pass, warp};
use crate::guidance::{DepthMap, paper};
use crate::tasks::Parallel;

/// Pixels of a box without depth whose colours fit another place by chance.
const BY_CHANCE: usize = 1;
/// Mean difference of a rotated picture, in levels.
const ROTATED: f64 = 0.77;

const SIZE: (u32, u32) = (32, 16);
const NEAR: u16 = 20_000;
const FAR: u16 = 40_000;

/// A field of one segment for each tile.
fn segments(segment: impl Fn([usize; 2]) -> Vec<Segment> + Sync) -> Segments {
    let mut segments = Segments::default();
    segments.reserve(Grid::new(SIZE)).unwrap();
    let columns = segments.grid.columns;
    segments.par_rows_mut(1).enumerate().for_each(|(row, mut tiles)| {
        for column in 0..columns {
            tiles.set(column, &segment([column, row]));
        }
        tiles.find_spans();
    });
    segments
}

fn warped(field: &Segments, way: Way) -> Segments {
    let (mut bands, mut to) = (Bands::default(), Segments::default());
    bands.reserve(field.grid).unwrap();
    warp(&[Pass { segments: field, way, is_of_pass: |_| true }], false, &bands, &mut to).unwrap();
    to
}

#[test]
fn masks_split_into_the_tiles_that_they_reach() {
    for (s, t) in (0..8).flat_map(|t| (0..8).map(move |s| (s, t))) {
        let mask = 0x8040_2010_0804_0281;
        let parts = split(mask, s, t);
        let mut expected = [0; 4];
        for p in (0..BLOCK).filter(|p| mask >> p & 1 == 1) {
            let [x, y] = [p % TILE + s as usize, p / TILE + t as usize];
            expected[x / TILE + 2 * (y / TILE)] |= 1 << (y % TILE * TILE + x % TILE);
        }
        assert_eq!(parts, expected, "{s}, {t}");
        // The block at the moved corner is the mask again.
        let grid = Grid::new((16, 16));
        assert_eq!(block(grid, [s as i32, t as i32], |column, row| parts[column + 2 * row]), mask, "{s}, {t}");
    }
}

#[test]
fn clusters_part_what_moves_or_lies_apart_and_keep_every_pixel() {
    let keys: [Key; BLOCK] = std::array::from_fn(|p| match p % TILE {
        0..3 => key(NEAR, 0, [640 + p as i32 / 8, 0]),
        3..6 => key(FAR, 0, [640, 0]),
        _ => key(FAR, 0, [0, -200]),
    });
    let mut made = [Segment::default(); SLOTS];
    for level in Level::available() {
        assert_eq!(cluster(level, &keys, u64::MAX, &mut made, 0), 3);
        let masks = [0x07, 0x38, 0xc0].map(|row: u64| row * 0x0101_0101_0101_0101);
        let mut found: Vec<_> = made[..3].iter().map(|s| (s.rank, s.vector, s.mask)).collect();
        found.sort_by_key(|(_, _, mask)| *mask);
        assert_eq!(found, [(NEAR, [644, 0], masks[0]), (FAR, [640, 0], masks[1]), (FAR, [0, -200], masks[2])]);
        // More motions than segments: all pixels are in one all the same.
        let many: [Key; BLOCK] = std::array::from_fn(|p| key(FAR, 0, [100 * p as i32, 0]));
        let count = cluster(level, &many, u64::MAX, &mut made, 0);
        assert_eq!(made[..count].iter().fold(0, |all, s| all ^ s.mask), u64::MAX);
    }
}

#[test]
fn what_is_nearer_covers_what_it_is_warped_over() {
    // The first column of tiles moves by half a tile over the others, which stand.
    let field = segments(|[column, _]| {
        let (rank, vector) = if column == 0 { (NEAR, [-512, 0]) } else { (FAR, [0; 2]) };
        vec![Segment { mask: u64::MAX, vector, rank, mark: 0 }]
    });
    // To the middle, things go half of the way back; the vector leads 8 pixels to the left.
    let shown = warped(&field, Way::from_current(Moment::new(WHOLE / 2, Perspective::default())));
    for x in 0..32 {
        let rank = shown.at([x, 3]).map(|segment| segment.rank);
        assert_eq!(
            rank,
            if x < 4 {
                Some(NEAR)
            } else if x < 8 {
                None
            } else {
                Some(FAR)
            },
            "{x}"
        );
    }
}

#[test]
fn a_surface_that_grows_lets_nothing_show_through() {
    // Two halves of a near tile part by a pixel, over ground that stands.
    let field = segments(|[column, _]| match column {
        1 => vec![
            Segment { mask: 0x0f * 0x0101_0101_0101_0101, vector: [0; 2], rank: NEAR, mark: 0 },
            Segment { mask: 0xf0 * 0x0101_0101_0101_0101, vector: [64, 0], rank: NEAR, mark: 0 },
        ],
        0 => vec![Segment { mask: u64::MAX, vector: [512, 0], rank: FAR, mark: 0 }],
        _ => vec![Segment { mask: u64::MAX, vector: [0; 2], rank: FAR, mark: 0 }],
    });
    let owners = warped(&field, Way::from_current(Moment::previous()));
    for x in 8..17 {
        assert_eq!(owners.at([x, 5]).map(|segment| segment.rank), Some(NEAR), "{x}");
    }
}

#[test]
fn holes_continue_the_farther_surface_beside_them() {
    let depth = DepthMap::new(SIZE.0, SIZE.1, paper::PROJECTION).unwrap();
    let whole = |rank, x| Segment { mask: u64::MAX, vector: [x, 0], rank, mark: 0 };
    let field = segments(|[column, _]| vec![if column == 0 { whole(NEAR, 0) } else { whole(FAR, 900) }]);
    let mut shown = segments(|[column, _]| match column {
        0 => vec![whole(NEAR, 0)],
        3 => vec![whole(FAR, 900)],
        _ => Vec::new(),
    });
    let (mut covers, mut added) = (Covers::default(), Segments::default());
    covers.find(&shown).unwrap();
    assert_eq!(covers.holes(), 16 * 16);
    let way = Way::from_current(Moment::new(WHOLE / 2, Perspective::default()));
    let evidence = Evidence::<[u8; 4]> {
        field: &field,
        way,
        depth: &depth,
        shown: None,
        past: None,
        leaving: None,
        level: Level::detect(),
    };
    evidence.fill(&mut shown, &covers, &mut added).unwrap();
    for (x, y) in (8..24).flat_map(|x| (0..16).map(move |y| (x, y))) {
        let segment = shown.at([x, y]).unwrap();
        assert_eq!((segment.mark, segment.rank, segment.vector), (HOLE, FAR, [900, 0]), "({x}, {y})");
    }
    covers.find(&shown).unwrap();
    assert_eq!(covers.holes(), 0);
}
