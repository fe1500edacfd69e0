//! Root constants of a frame's shaders, and the layout of their memory.

use super::super::cpu::{self, kernels};

/// Side of a tile, in pixels.
pub(super) const TILE: u32 = kernels::TILE as u32;
/// Largest side of the reduced pictures for cut detection, in pixels.
const REDUCED_SIDE: u32 = cpu::REDUCED_SIDE as u32;
/// Reduction factor from those to the tiny pictures in which the global motion is searched.
const TINY_FACTOR: u32 = cpu::TINY_FACTOR as u32;
/// Side of the blocks of the reduced pictures, in pixels.
const BLOCK: u32 = cpu::CUT_BLOCK as u32;
/// Bytes reserved for single-word results.
const STATE: u32 = 1024;

/// Root constants of all shaders of a frame, in the order of `frame.hlsli`. `at_` marks a byte offset into the buffer `small`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Constants {
    /// Width and height of the pictures, in pixels.
    pub(super) size: [u32; 2],
    /// Columns and rows of tiles.
    pub(super) tiles: [u32; 2],
    /// Width and height of the reduced pictures for cut detection, in pixels.
    pub(super) reduced: [u32; 2],
    /// Reduction factor of these.
    pub(super) factor: u32,
    /// 1 for a pair of anchors, 0 for one that is extrapolated.
    pub(super) is_pair: u32,
    /// Tile sizes of motion and depth, in pixels.
    pub(super) guidance_tiles: [u32; 2],
    /// Tile size of the previous anchor's depth in pixels; 0 if there is none.
    pub(super) previous_depth_tile: u32,
    /// 1 if pixels of anchors are floats, 0 if they are bytes.
    pub(super) is_float: u32,
    /// 1 if anchors are linear.
    pub(super) is_linear: u32,
    /// 1 if the target is linear.
    pub(super) writes_linear: u32,
    /// 1 if the caller states a cut between the anchors.
    pub(super) is_cut_stated: u32,
    /// 1 if there is an overlay mask.
    pub(super) has_hud: u32,
    /// Phase of the frame, a numerator over `PHASE_ONE`.
    pub(super) phase: i32,
    /// Phase to which pixels are splatted, a numerator over `PHASE_ONE`.
    pub(super) splat_phase: i32,
    /// 1 if pixels with inherited motion are splatted as well.
    pub(super) splats_inherited: u32,
    /// Tag of keys with inherited motion.
    pub(super) inherited_tag: u32,
    /// Number of the run of a shader that runs several times, from 0.
    pub(super) run: u32,
    /// Pixel layout of the finished picture, as [`PictureFormat`](crate::gpu::compute::picture_formats::PictureFormat) has it.
    pub(super) target_format: u32,
    /// Bytes per row of the finished picture.
    pub(super) pitch: u32,
    /// 1 if the current anchor is the nearer one in time.
    pub(super) nearer_is_current: u32,
    /// 1 if the current anchor is shown across a cut.
    pub(super) cut_shows_current: u32,
    /// 1 if motion is optical flow.
    pub(super) is_optical_flow: u32,
    /// 1 if static overlays are found in the pictures.
    pub(super) finds_overlays: u32,
    /// Tiles of the guidance.
    pub(super) at_guidance_tiles: u32,
    /// Tiles of the current anchor's motion.
    pub(super) at_field_tiles: u32,
    /// Tiles of the previous anchor's coverage.
    pub(super) at_previous_tiles: u32,
    /// Tiles of the splat destination.
    pub(super) at_splat_tiles: u32,
    /// Coverage of each tile during splatting.
    pub(super) at_coverage: u32,
    /// Pyramid of the farthest keys.
    pub(super) at_levels: u32,
    /// Pixels that neither anchor shows, 64 bits per tile.
    pub(super) at_hidden: u32,
    /// Sums of the colours of each tile.
    pub(super) at_colour_sums: u32,
    /// Colours of tiles with which hidden pixels are filled.
    pub(super) at_tile_colours: u32,
    /// Reduced pictures.
    pub(super) at_lumas: u32,
    /// Reduced pictures without the local mean.
    pub(super) at_details: u32,
    /// Results of cut detection per block of the reduced pictures.
    pub(super) at_blocks: u32,
    /// Tiny pictures.
    pub(super) at_tiny: u32,
    /// Correlation of the tiny pictures per shift.
    pub(super) at_shifts: u32,
}

/// Number of 32-bit words of [`Constants`].
pub(super) const WORDS: usize = 41;

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
            self.previous_depth_tile,
            self.is_float,
            self.is_linear,
            self.writes_linear,
            self.is_cut_stated,
            self.has_hud,
            self.phase as u32,
            self.splat_phase as u32,
            self.splats_inherited,
            self.inherited_tag,
            self.run,
            self.target_format,
            self.pitch,
            self.nearer_is_current,
            self.cut_shows_current,
            self.is_optical_flow,
            self.finds_overlays,
            self.at_guidance_tiles,
            self.at_field_tiles,
            self.at_previous_tiles,
            self.at_splat_tiles,
            self.at_coverage,
            self.at_levels,
            self.at_hidden,
            self.at_colour_sums,
            self.at_tile_colours,
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
    pub(super) at_frame_tiles: u32,
    /// Bytes of the buffer `small`: everything except the per-pixel keys.
    pub(super) small: u64,
    /// Pixels of the splat scratch buffer: the tiles plus a border of one pixel.
    pub(super) splat_pixels: u64,
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
        let factor = width.max(height).div_ceil(REDUCED_SIDE);
        let reduced = size.map(|len| len.div_ceil(factor));
        let blocks = reduced.map(|len| len.div_ceil(BLOCK));
        let tiny = reduced.map(|len| len.div_ceil(TINY_FACTOR));
        let shifts = [2 * (tiny[0] / 2) + 1, 2 * (tiny[1] / 4) + 1];

        let mut end = u64::from(STATE);
        let mut reserve = |bytes: u64| {
            let start = end;
            end += bytes.next_multiple_of(16);
            // A layout of more than 4 GiB is rejected in `Memory::new`.
            start as u32
        };
        let area = |[across, down]: [u32; 2]| u64::from(across) * u64::from(down);
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
            at_guidance_tiles: reserve(16 * count),
            at_field_tiles: reserve(16 * count),
            at_previous_tiles: reserve(16 * count),
            at_coverage: reserve(40 * count),
            at_levels: reserve(levels),
            at_hidden: reserve(8 * count),
            at_colour_sums: reserve(20 * count),
            at_tile_colours: reserve(20 * count),
            at_lumas: reserve(8 * area(reduced)),
            at_details: reserve(8 * area(reduced)),
            at_blocks: reserve(4 * area(blocks)),
            at_tiny: reserve(8 * area(tiny)),
            at_shifts: reserve(4 * area(shifts)),
            ..Constants::default()
        };
        let at_frame_tiles = reserve(16 * count);
        let splat_pixels = tiles.map(|tiles| u64::from(TILE * tiles + 2));
        Self {
            constants,
            at_frame_tiles,
            small: end,
            splat_pixels: splat_pixels[0] * splat_pixels[1],
            blocks,
            tiny,
            shifts,
        }
    }
}
