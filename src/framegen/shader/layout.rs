//! Root constants of a frame's shaders, and the layout of their memory.

/// Side of a tile, in pixels.
pub(super) const TILE: u32 = 8;
/// Largest side of the reduced pictures for cut detection, in pixels.
const SMALL_SIDE: u32 = 320;
/// Reduction factor from those to the tiny pictures in which the global motion is searched.
const TINY_FACTOR: u32 = 4;
/// Side of the blocks of the reduced pictures, in pixels.
const BLOCK: u32 = 16;
/// Bytes reserved for single-word results.
const STATE: u32 = 1024;
/// Step between the rows whose brightness is summed.
const SPARSE: u32 = 8;

/// Root constants of all shaders of a frame, in the order of `frame.hlsli`, which documents them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Constants {
    pub(super) size: [u32; 2],
    pub(super) tiles: [u32; 2],
    pub(super) reduced: [u32; 2],
    pub(super) factor: u32,
    pub(super) is_pair: u32,
    pub(super) guidance_tiles: [u32; 2],
    pub(super) past_tile: u32,
    pub(super) is_float: u32,
    pub(super) is_light: u32,
    pub(super) writes_light: u32,
    pub(super) is_stated: u32,
    pub(super) has_hud: u32,
    pub(super) phase: i32,
    pub(super) landing_phase: i32,
    pub(super) borrows: u32,
    pub(super) mark: u32,
    pub(super) turn: u32,
    pub(super) written: u32,
    pub(super) pitch: u32,
    pub(super) nearer_is_current: u32,
    pub(super) cut_shows_current: u32,
    pub(super) is_even: u32,
    pub(super) at_given_tiles: u32,
    pub(super) at_field_tiles: u32,
    pub(super) at_owner_tiles: u32,
    pub(super) at_tiles: u32,
    pub(super) at_covers: u32,
    pub(super) at_levels: u32,
    pub(super) at_hidden: u32,
    pub(super) at_known: u32,
    pub(super) at_cells: u32,
    pub(super) at_runs: u32,
    pub(super) at_joined: u32,
    pub(super) at_rows: u32,
    pub(super) at_lumas: u32,
    pub(super) at_details: u32,
    pub(super) at_blocks: u32,
    pub(super) at_tiny: u32,
    pub(super) at_shifts: u32,
}

/// Number of 32-bit words of [`Constants`].
pub(super) const WORDS: usize = 43;

impl Constants {
    /// The words in the order in which shaders read them.
    pub(super) fn words(&self) -> [u32; WORDS] {
        [
            self.size[0],
            self.size[1],
            self.tiles[0],
            self.tiles[1],
            self.reduced[0],
            self.reduced[1],
            self.factor,
            self.is_pair,
            self.guidance_tiles[0],
            self.guidance_tiles[1],
            self.past_tile,
            self.is_float,
            self.is_light,
            self.writes_light,
            self.is_stated,
            self.has_hud,
            self.phase as u32,
            self.landing_phase as u32,
            self.borrows,
            self.mark,
            self.turn,
            self.written,
            self.pitch,
            self.nearer_is_current,
            self.cut_shows_current,
            self.is_even,
            self.at_given_tiles,
            self.at_field_tiles,
            self.at_owner_tiles,
            self.at_tiles,
            self.at_covers,
            self.at_levels,
            self.at_hidden,
            self.at_known,
            self.at_cells,
            self.at_runs,
            self.at_joined,
            self.at_rows,
            self.at_lumas,
            self.at_details,
            self.at_blocks,
            self.at_tiny,
            self.at_shifts,
        ]
    }
}

/// Layout of the memory for one picture size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// Constants with all values that depend on the size only.
    pub(super) constants: Constants,
    /// Byte offset of the tiles of the splat destination between the anchors.
    pub(super) at_place_tiles: u32,
    /// Bytes of the buffer for everything except the per-pixel keys.
    pub(super) small: u64,
    /// Pixels of the splat scratch buffer: the tiles plus a border of one pixel.
    pub(super) places: u64,
    /// Columns and rows of blocks of the reduced pictures.
    pub(super) blocks: [u32; 2],
    /// Size of the tiny pictures, in pixels.
    pub(super) tiny: [u32; 2],
    /// Columns and rows of compared shifts of the tiny pictures.
    pub(super) shifts: [u32; 2],
}

impl Layout {
    pub(super) fn new((width, height): (u32, u32)) -> Self {
        let size = [width, height];
        let tiles = size.map(|len| len.div_ceil(TILE));
        let factor = width.max(height).div_ceil(SMALL_SIDE);
        let reduced = size.map(|len| len.div_ceil(factor));
        let blocks = reduced.map(|len| len.div_ceil(BLOCK));
        let tiny = reduced.map(|len| len.div_ceil(TINY_FACTOR));
        let shifts = [2 * (tiny[0] / 2) + 1, 2 * (tiny[1] / 4) + 1];

        let mut end = u64::from(STATE);
        let mut take = |bytes: u64| {
            let start = end;
            end += bytes.next_multiple_of(16);
            // A layout of more than 4 GiB is rejected in `Memory::new`.
            start as u32
        };
        let area = |[across, down]: [u32; 2]| u64::from(across) * u64::from(down);
        let ends = 2 * (u64::from(width) + u64::from(height));
        let (count, mut levels, mut level) = (area(tiles), 0, tiles);
        while level != [1, 1] {
            level = level.map(|len| len.div_ceil(2));
            levels += 8 * area(level);
        }
        let constants = Constants {
            size,
            tiles,
            reduced,
            factor,
            at_given_tiles: take(16 * count),
            at_field_tiles: take(16 * count),
            at_owner_tiles: take(16 * count),
            at_covers: take(40 * count),
            at_levels: take(levels),
            at_hidden: take(8 * count),
            at_known: take(20 * count),
            at_cells: take(20 * count),
            at_runs: take(16 * ends),
            at_joined: take(16 * ends),
            at_rows: take(32 * u64::from(height.div_ceil(SPARSE))),
            at_lumas: take(8 * area(reduced)),
            at_details: take(8 * area(reduced)),
            at_blocks: take(4 * area(blocks)),
            at_tiny: take(8 * area(tiny)),
            at_shifts: take(4 * area(shifts)),
            ..Constants::default()
        };
        let at_place_tiles = take(16 * count);
        let places = tiles.map(|tiles| u64::from(TILE * tiles + 2));
        Self { constants, at_place_tiles, small: end, places: places[0] * places[1], blocks, tiny, shifts }
    }
}
