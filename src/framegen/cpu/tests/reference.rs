//! Reference implementation of the generator: pixel by pixel over whole pictures, without bands, early outs, threads
//! and instruction sets.
//!
//! It shares with the generator the definition of keys (`splat_key`), the tests of single pixels (`StaticMask`,
//! `Anchors`, `colour_distance`, `match_error`), the reprojection of single pixels, the camera
//! fit and inpainting, which have no other form.

use crate::Raster;
use crate::framegen::cpu::camera_fit::CameraFit;
use crate::framegen::cpu::colour::Colour;
use crate::framegen::cpu::edge_antialiasing::{EDGE_MOTION, NEIGHBOUR_WEIGHT};
use crate::framegen::cpu::field::{
    self, DILATION_TOLERANCE, UNIFORM_RANGE as UNIFORM_GUIDANCE_RANGE, UNKNOWN_MATCH_ERROR,
};
use crate::framegen::cpu::hole_filling::{FillInputs, SEARCH_RADIUS};
use crate::framegen::cpu::inpaint::Inpainter;
use crate::framegen::cpu::kernels::{BLOCK, MergeRule, SimdLevel, Source, TILE, WarpedRow, warp_row};
use crate::framegen::cpu::key_buffer::{Grid, KeyBuffer, Tile, TileKind};
use crate::framegen::cpu::letterbox::ActiveArea;
use crate::framegen::cpu::render::{
    DISTINCT_MOTION, MAX_EQUAL_DIFFERENCE, STRICT_DOUBT_THRESHOLD, colour_difference, doubt_threshold,
    occluded_difference,
};
use crate::framegen::cpu::reprojection::Reprojection;
use crate::framegen::cpu::splat::UNIFORM_RANGE as UNIFORM_SPLAT_RANGE;
use crate::framegen::cpu::splat_key::{
    self, EMPTY, HOLE, Key, MAX_COMPONENT, PHASE_ONE, PREVIOUS_ONLY, SLOPE_DEPTH_KEYS, SLOPE_MOTION, is_in_front,
    same_slope, scaled, similar_motion, warped,
};
use crate::framegen::cpu::static_overlay::Anchors;
use crate::framegen::cpu::warp::{Warp, WarpTime};
use crate::framegen::cpu::{source, static_mask::StaticMask, tests::oracle::EDGE_TOLERANCE};
use crate::framegen::{Anchor, AnchorPair};
use crate::guidance::Guidance;

/// The picture at `phase` (1 / [`PHASE_ONE`]) between two anchors without a cut, and the share of pixels to which no
/// visible pixel of the current anchor is splatted.
pub(super) fn interpolated<P: Colour>(pair: &AnchorPair<'_, P>, phase: i32) -> (Raster<P>, f32) {
    let (previous, current) = (source(pair.previous()), source(pair.current()));
    let active_area = ActiveArea::find(SimdLevel::SCALAR, previous, current);
    let static_mask = StaticMask::new(Some(&active_area), pair.overlay(), current.width);
    let field = motion_field(pair.guidance(), Some((previous, current)), &static_mask);

    let mut previous_keys = splatted(&field, &splats_of(&field), Warp::from_current(WarpTime::previous_anchor()));
    let is_optical_flow = pair.guidance().origin().is_optical_flow();
    let camera = CameraFit::fit(pair.guidance(), &static_mask);
    let reprojection = Reprojection::new(&camera, pair.previous_depth(), pair.guidance().depth());
    if let Some(reprojection) = &reprojection {
        clear_occluded(&mut previous_keys, &field, reprojection);
    }
    let inputs = FillInputs {
        field: &field,
        warp: Warp::from_current(WarpTime::previous_anchor()),
        picture: Some(previous),
        reprojection: reprojection.as_ref(),
        follows_neighbours: true,
        tag: PREVIOUS_ONLY,
    };
    fill_holes(&mut previous_keys, &inputs);

    // The field, and the pixels that only the previous anchor shows, are splatted to phase t.
    let time = WarpTime::new(phase, camera.depth_change);
    let [warp, from_previous] = [Warp::from_current(time), Warp::from_previous(time)];
    let mut splats: Vec<_> = splats_of(&field).into_iter().map(|splat| splat.warped_by(warp)).collect();
    splats.extend(inherited_splats_of(&previous_keys).into_iter().map(|splat| splat.warped_by(from_previous)));
    let mut frame_keys = resolved(field.grid, &splats);
    fill_holes(&mut frame_keys, &FillInputs::<P>::in_frame(&field, warp));

    render(&ReferenceFrame {
        previous,
        current,
        frame_keys: &frame_keys,
        field: &field,
        previous_keys: &previous_keys,
        phase,
        time,
        is_optical_flow,
        finds_overlays: pair.overlay().is_none(),
    })
}

/// The picture `phase` (1 / [`PHASE_ONE`]) after an anchor, and the same share.
pub(super) fn extrapolated<P: Colour>(anchor: &Anchor<'_, P>, phase: i32) -> (Raster<P>, f32) {
    let current = source(anchor.picture());
    let static_mask = StaticMask::new(None, anchor.overlay(), current.width);
    let field = motion_field::<P>(anchor.guidance(), None, &static_mask);
    let time = WarpTime::new(PHASE_ONE + phase, CameraFit::fit(anchor.guidance(), &static_mask).depth_change);
    let warp = Warp::from_current(time);
    let mut frame_keys = splatted(&field, &splats_of(&field), warp);
    fill_holes(&mut frame_keys, &FillInputs::<P>::in_frame(&field, warp));

    let grid = field.grid;
    let mut out = anchor.picture().clone();
    let (mut hidden, mut uncovered) = (vec![0; grid.tiles()], 0);
    for [x, y] in pixels(grid) {
        let (own, tile, index) = (frame_keys.own_key(x, y), grid.locate(x, y).0, grid.locate(x, y).1);
        let key = if own == EMPTY { frame_keys.inherited[tile][index] } else { own };
        let vector = splat_key::vector(key);
        let phase = phase_at(&frame_keys, &time, [x, y], key, true) - PHASE_ONE;
        let from = [64 * x as i32 + scaled(vector[0], phase), 64 * y as i32 + scaled(vector[1], phase)];
        out.pixels_mut()[y * grid.width + x] = P::sample(current, from);
        if own == EMPTY {
            uncovered += 1;
            let key_there = grid.nearest_pixel(from).map(|[u, v]| field.own_key(u, v));
            let is_occluded = key_there.is_some_and(|other| !similar_motion(other, key) && is_in_front(other, key));
            hidden[tile] |= u64::from(is_occluded) << index;
        }
    }
    inpainted(grid, &hidden, &mut out);
    (out, uncovered as f32 / (grid.width * grid.height) as f32)
}

fn pixels(grid: Grid) -> impl Iterator<Item = [usize; 2]> {
    (0..grid.height).flat_map(move |y| (0..grid.width).map(move |x| [x, y]))
}

fn tiles(grid: Grid) -> impl Iterator<Item = (usize, [usize; 2])> {
    (0..grid.tiles()).map(move |tile| (tile, [tile % grid.columns, tile / grid.columns]))
}

/// The pixels of a tile.
fn pixels_of(grid: Grid, [column, row]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    let [across, down] = grid.extent(column, row);
    (0..down).flat_map(move |j| (0..across).map(move |i| [column * TILE + i, row * TILE + j]))
}

fn empty_buffer(grid: Grid) -> KeyBuffer {
    let mut keys = KeyBuffer::default();
    keys.reserve(grid).unwrap();
    keys.inherited = vec![[EMPTY; BLOCK]; grid.tiles()];
    keys
}

/// The motion field of the current anchor.
fn motion_field<P: Colour>(
    guidance: &Guidance,
    anchors: Option<(Source<'_, P>, Source<'_, P>)>,
    static_mask: &StaticMask<'_>,
) -> KeyBuffer {
    let grid = Grid::new(guidance.size());
    let limit = [grid.width, grid.height].map(|side| (side as i32 * 64).min(MAX_COMPONENT));
    let guidance_key = |[x, y]: [usize; 2]| {
        let mut warped_row = WarpedRow::default();
        let vector = guidance.motion().at(x as u32, y as u32);
        let map = guidance.depth();
        let tile = map.tile() as usize;
        let depth = map.depth()[y / tile * map.columns() as usize + x / tile];
        warp_row(SimdLevel::SCALAR, &[vector], &[depth], [0; 2], 0, limit, &mut warped_row);
        warped_row.keys[0]
    };
    let depth_key = |at| splat_key::depth_key(guidance_key(at));
    let is_flat = pixels(grid).all(|at| depth_key(at) == depth_key([0, 0]));

    let mut guidance_tiles = empty_buffer(grid);
    for (tile, at) in tiles(grid) {
        let static_count = pixels_of(grid, at).filter(|&at| static_mask.is_static(at)).count();
        let ([low, high], near) =
            (range(pixels_of(grid, at).map(guidance_key)), pixels_of(grid, at).map(depth_key).min().unwrap());
        if static_count == pixels_of(grid, at).count() {
            guidance_tiles.tiles[tile].key = splat_key::pack(0, 0, [0; 2]);
        } else if static_count == 0 && (0..2).all(|c| high[c] - low[c] <= UNIFORM_GUIDANCE_RANGE) {
            guidance_tiles.tiles[tile].key = splat_key::pack(near, 0, [0, 1].map(|c| (low[c] + high[c]).div_euclid(2)));
        } else {
            guidance_tiles.tiles[tile].kind = TileKind::Mixed;
            for pixel in pixels_of(grid, at) {
                let key =
                    if static_mask.is_static(pixel) { splat_key::pack(0, 0, [0; 2]) } else { guidance_key(pixel) };
                guidance_tiles.keys[tile][grid.locate(pixel[0], pixel[1]).1] = key;
            }
        }
    }

    // At edges, foreground is dilated; without depth, pixels are tagged with their match error.
    let mut field = empty_buffer(grid);
    let can_dilate = !is_flat && guidance.motion().tile() == 1;
    for (tile, at) in tiles(grid) {
        field.tiles[tile] = guidance_tiles.tiles[tile];
        let key = guidance_tiles.tiles[tile].key;
        let is_uniform = guidance_tiles.tiles[tile].kind == TileKind::Uniform;
        let neighbours = tiles(grid).filter(|(_, other)| (0..2).all(|c| other[c].abs_diff(at[c]) <= 1));
        let moves_differently = |(other, _): (usize, _)| {
            guidance_tiles.tiles[other].kind == TileKind::Mixed || !similar_motion(guidance_tiles.tiles[other].key, key)
        };
        let is_refined = can_dilate || is_flat && anchors.is_some();
        if is_uniform && !(is_refined && { neighbours }.any(moves_differently)) {
            if is_flat {
                field.tiles[tile].key = splat_key::with_tag(key, UNKNOWN_MATCH_ERROR);
            }
            continue;
        }
        let mut is_changed = !is_uniform;
        for [x, y] in pixels_of(grid, at) {
            let own = guidance_tiles.own_key(x, y);
            let neighbours = (y.saturating_sub(1)..(y + 2).min(grid.height))
                .flat_map(|v| (x.saturating_sub(1)..(x + 2).min(grid.width)).map(move |u| [u, v]));
            let nearest = neighbours.map(|[u, v]| guidance_tiles.own_key(u, v)).min().unwrap();
            let key = match anchors {
                Some((previous, current)) if is_flat => {
                    is_changed = true;
                    splat_key::with_tag(own, field::match_error(previous, current, [x, y], own))
                }
                _ if can_dilate && is_in_front(nearest, own) && !similar_motion(nearest, own) => {
                    let fits = anchors.is_none_or(|(previous, current)| {
                        let colour_distance = |key| field::colour_distance(previous, current, [x, y], key);
                        colour_distance(nearest) <= DILATION_TOLERANCE
                            && colour_distance(nearest) < colour_distance(own)
                    });
                    is_changed |= fits;
                    if fits { nearest } else { own }
                }
                _ => own,
            };
            field.keys[tile][grid.locate(x, y).1] = key;
        }
        if is_changed {
            field.tiles[tile] = Tile { kind: TileKind::Mixed, key: EMPTY, ..Tile::default() };
        }
    }
    field
}

/// Minimum and maximum of each component of the keys' motion vectors.
fn range(keys: impl Iterator<Item = Key>) -> [[i32; 2]; 2] {
    keys.map(splat_key::vector).fold([[i32::MAX; 2], [i32::MIN; 2]], |[low, high], vector| {
        [[0, 1].map(|c| low[c].min(vector[c])), [0, 1].map(|c| high[c].max(vector[c]))]
    })
}

/// A uniform tile or a pixel to splat.
#[derive(Clone, Copy)]
struct Splat {
    key: Key,
    /// Its position.
    at: [i32; 2],
    /// Width and height of a uniform tile.
    extent: Option<[usize; 2]>,
}

impl Splat {
    fn warped_by(self, warp: Warp) -> Self {
        let vector = splat_key::vector(self.key);
        // A uniform tile moves like its centre.
        let middle = if self.extent.is_some() { TILE as i32 / 2 } else { 0 };
        let fraction = warp.fraction(self.key, self.at.map(|at| at + middle));
        Self { at: [0, 1].map(|c| warped(self.at[c], vector[c], fraction)), ..self }
    }

    fn pixels(self) -> impl Iterator<Item = [i32; 2]> {
        let [across, down] = self.extent.unwrap_or([1, 1]).map(|v| v as i32);
        (0..down).flat_map(move |j| (0..across).map(move |i| [self.at[0] + i, self.at[1] + j]))
    }
}

/// The splats of a buffer's own keys.
fn splats_of(keys: &KeyBuffer) -> Vec<Splat> {
    let grid = keys.grid;
    let mut splats = Vec::new();
    for (tile, at) in tiles(grid) {
        if keys.tiles[tile].kind == TileKind::Uniform {
            let corner = at.map(|v| (v * TILE) as i32);
            splats.push(Splat { key: keys.tiles[tile].key, at: corner, extent: Some(grid.extent(at[0], at[1])) });
        } else {
            splats.extend(pixels_of(grid, at).map(|[x, y]| (keys.own_key(x, y), [x, y])).filter_map(pixel));
        }
    }
    splats
}

/// The splats of its inherited keys.
fn inherited_splats_of(keys: &KeyBuffer) -> Vec<Splat> {
    let inherited = pixels(keys.grid).map(|[x, y]| {
        let (tile, index) = keys.grid.locate(x, y);
        (keys.inherited[tile][index], [x, y])
    });
    inherited.filter_map(pixel).collect()
}

fn pixel((key, at): (Key, [usize; 2])) -> Option<Splat> {
    (key != EMPTY).then_some(Splat { key, at: at.map(|v| v as i32), extent: None })
}

/// Warps splats and resolves them.
fn splatted(field: &KeyBuffer, splats: &[Splat], warp: Warp) -> KeyBuffer {
    resolved(field.grid, &splats.iter().map(|splat| splat.warped_by(warp)).collect::<Vec<_>>())
}

/// Keys of the destination: a tile is uniform if uniform tiles cover most of it with similar motion; in others each
/// pixel has the nearest key, with cracks closed.
fn resolved(grid: Grid, splats: &[Splat]) -> KeyBuffer {
    let (across, down) = ((grid.columns * TILE) as i32, (grid.rows * TILE) as i32);
    let tile_at = |[x, y]: [i32; 2]| {
        ((0..across).contains(&x) && (0..down).contains(&y))
            .then(|| y as usize / TILE * grid.columns + x as usize / TILE)
    };
    let mut warped = vec![Vec::new(); grid.tiles()];
    let mut has_pixels = vec![false; grid.tiles()];
    // With a border of one pixel, so that cracks can be closed at the edges.
    let stride = across as usize + 2;
    let mut nearest = vec![EMPTY; stride * (down as usize + 2)];
    for splat in splats {
        for at in splat.pixels() {
            if let Some(tile) = tile_at(at) {
                warped[tile].push(splat.key);
                has_pixels[tile] |= splat.extent.is_none();
            }
            if (-1..=across).contains(&at[0]) && (-1..=down).contains(&at[1]) {
                let pixel = &mut nearest[(at[1] + 1) as usize * stride + (at[0] + 1) as usize];
                *pixel = (*pixel).min(splat.key);
            }
        }
    }
    let at = |x: usize, y: usize, dx: usize, dy: usize| nearest[(y + dy) * stride + x + dx];

    let mut buffer = empty_buffer(grid);
    for (tile, position) in tiles(grid) {
        let keys = &warped[tile];
        let whole = pixels_of(grid, position).count();
        let [low, high] = range(keys.iter().copied());
        let is_covered = 4 * keys.len() >= 3 * whole;
        let depth_keys = || keys.iter().map(|&key| splat_key::depth_key(key));
        let is_one_slope = is_covered && depth_keys().max().unwrap() - depth_keys().min().unwrap() <= SLOPE_DEPTH_KEYS;
        let max_range = if is_one_slope { SLOPE_MOTION } else { UNIFORM_SPLAT_RANGE };
        if !has_pixels[tile] && is_covered && (0..2).all(|c| high[c] - low[c] <= max_range) {
            let nearest_key = *keys.iter().min().unwrap();
            let mean = [0, 1].map(|c| {
                let sum: i64 = keys.iter().map(|&key| i64::from(splat_key::vector(key)[c])).sum();
                (2 * sum + keys.len() as i64).div_euclid(2 * keys.len() as i64) as i32
            });
            buffer.tiles[tile].key =
                splat_key::pack(splat_key::depth_key(nearest_key), splat_key::tag(nearest_key), mean);
            continue;
        }
        buffer.tiles[tile].kind = TileKind::Mixed;
        for [x, y] in pixels_of(grid, position) {
            let mut own = at(x, y, 1, 1);
            for [a, b] in [[at(x, y, 0, 1), at(x, y, 2, 1)], [at(x, y, 1, 0), at(x, y, 1, 2)]] {
                let is_surface = a != EMPTY && b != EMPTY && similar_motion(a, b);
                if is_surface && (own == EMPTY || is_in_front(a.max(b), own) && !similar_motion(a.min(b), own)) {
                    own = a.min(b);
                }
            }
            buffer.keys[tile][grid.locate(x, y).1] = own;
        }
        let splats = pixels_of(grid, position).map(|[x, y]| buffer.own_key(x, y));
        let (holes, splats): (Vec<_>, Vec<_>) = splats.partition(|&key| key == EMPTY);
        buffer.tiles[tile].holes = holes.len() as u8;
        buffer.tiles[tile].key = splats.into_iter().max().unwrap_or(EMPTY);
    }
    buffer
}

/// Removes keys of the previous anchor's pixels that a nearer surface occludes there.
fn clear_occluded(previous_keys: &mut KeyBuffer, field: &KeyBuffer, reprojection: &Reprojection<'_>) {
    let grid = field.grid;
    let occluder_inverse_depth = |[x, y]: [usize; 2]| {
        let is_uniform = previous_keys.tiles[grid.locate(x, y).0].kind == TileKind::Uniform;
        let middle = [x, y].map(|at| at / TILE * TILE + TILE / 2);
        reprojection.occluder_inverse_depth(previous_keys.own_key(x, y), if is_uniform { middle } else { [x, y] })
    };
    let covered = pixels(grid).filter(|&[x, y]| previous_keys.own_key(x, y) != EMPTY);
    let occluded: Vec<_> =
        covered.filter(|&at| reprojection.is_occluded(field, at, occluder_inverse_depth(at))).collect();
    occluded.into_iter().for_each(|[x, y]| previous_keys.clear_pixel(x, y));
}

/// Gives every hole an inherited key.
fn fill_holes<P: Colour>(keys: &mut KeyBuffer, inputs: &FillInputs<'_, P>) {
    let grid = keys.grid;
    for (tile, position) in tiles(grid) {
        for [x, y] in pixels_of(grid, position) {
            if keys.own_key(x, y) != EMPTY {
                continue;
            }
            // Left, right, above, below: the first covered pixel.
            let steps = [[-1, 0], [1, 0], [0, -1], [0, 1]];
            let candidates = steps.into_iter().filter_map(|[dx, dy]| {
                (1..=SEARCH_RADIUS).find_map(|step| {
                    let u = x.checked_add_signed(dx * step as isize).filter(|&u| u < grid.width)?;
                    let v = y.checked_add_signed(dy * step as isize).filter(|&v| v < grid.height)?;
                    let key = keys.own_key(u, v);
                    (key != EMPTY).then(|| (cost(inputs, grid, [x, y], key, step, [u, v]), key))
                })
            });
            // For equal costs the first wins.
            let best = candidates.reduce(|best, other| if other.0 < best.0 { other } else { best });
            let found = best.map_or(EMPTY, |(_, key)| key);
            let found = inputs.reprojection.map_or(found, |reprojection| {
                reprojection.key_or(inputs.field, [x, y], reprojection.key_at([x, y]), found)
            });
            let key = if found == EMPTY { farthest_around(keys, position) } else { found };
            keys.inherited[tile][grid.locate(x, y).1] = splat_key::with_tag(key, inputs.tag);
        }
    }
}

/// Cost of a candidate at distance `step` at `from`, most significant value first: whether the current anchor
/// contradicts it (it would have covered the hole unless it is occluded or outside there); then luma difference plus
/// distance where an anchor shows the hole, depth otherwise.
fn cost<P: Colour>(
    inputs: &FillInputs<'_, P>,
    grid: Grid,
    [x, y]: [usize; 2],
    key: Key,
    step: usize,
    from: [usize; 2],
) -> (bool, u64, u64) {
    let [vx, vy] = splat_key::vector(key);
    let fraction = inputs.warp.fraction(key, [x as i32, y as i32]);
    let position = [64 * x as i32 - scaled(vx, fraction), 64 * y as i32 - scaled(vy, fraction)];
    let is_contradicted = grid.nearest_pixel(position).is_some_and(|[u, v]| {
        let key_there = inputs.field.own_key(u, v);
        similar_motion(key_there, key) || is_in_front(key, key_there)
    });
    let far_first = u64::from(u16::MAX - splat_key::depth_key(key));
    match inputs.picture {
        Some(picture) => {
            let luma = |[x, y]: [usize; 2]| picture.pixels[y * grid.width + x].luma();
            let luma_difference = (luma([x, y]) - luma(from)).abs().min(255.0) as u64;
            (is_contradicted, luma_difference + step as u64, far_first)
        }
        None => (is_contradicted, far_first, step as u64),
    }
}

/// The farthest key in the smallest square of 1, 2x2, 4x4, ... tiles that has any.
fn farthest_around(keys: &KeyBuffer, [column, row]: [usize; 2]) -> Key {
    let grid = keys.grid;
    let squares = (0..).map(|power| {
        let in_square = |at: [usize; 2]| at[0] >> power == column >> power && at[1] >> power == row >> power;
        let keys = tiles(grid).filter(|&(_, at)| in_square(at)).map(|(tile, _)| keys.tiles[tile].key);
        (keys.filter(|&key| key != EMPTY).max(), 1 << power >= grid.columns.max(grid.rows))
    });
    for (key, is_all) in squares {
        match key {
            Some(key) => return key,
            None if is_all => break,
            None => {}
        }
    }
    splat_key::pack(u16::MAX, 0, [0; 2])
}

/// Inputs of a frame between two anchors.
struct ReferenceFrame<'a, P> {
    previous: Source<'a, P>,
    current: Source<'a, P>,
    frame_keys: &'a KeyBuffer,
    field: &'a KeyBuffer,
    previous_keys: &'a KeyBuffer,
    phase: i32,
    time: WarpTime,
    /// Whether motion is optical flow, which comes without depth.
    is_optical_flow: bool,
    finds_overlays: bool,
}

/// Phase of a pixel with linear motion; with `is_whole` that of its tile if the tile is uniform.
fn phase_at(frame_keys: &KeyBuffer, time: &WarpTime, [x, y]: [usize; 2], key: Key, is_whole: bool) -> i32 {
    let grid = frame_keys.grid;
    let corner = [x, y].map(|at| at / TILE * TILE);
    let tile = grid.locate(x, y).0;
    let is_full = grid.extent(x / TILE, y / TILE) == [TILE, TILE];
    let is_one = is_whole && is_full && frame_keys.tiles[tile].kind == TileKind::Uniform;
    let at = if is_one { corner.map(|at| at + TILE / 2) } else { [x, y] };
    time.phase(key, at.map(|at| at as i32))
}

fn render<P: Colour>(frame: &ReferenceFrame<'_, P>) -> (Raster<P>, f32) {
    let grid = frame.frame_keys.grid;
    let mut out = Raster::new(grid.width as u32, grid.height as u32).unwrap();
    let (mut hidden, mut static_drawn, mut uncovered) = (vec![0; grid.tiles()], vec![0; grid.tiles()], 0);
    for [x, y] in pixels(grid) {
        let (tile, index) = grid.locate(x, y);
        let own = frame.frame_keys.own_key(x, y);
        let key = if own == EMPTY { frame.frame_keys.inherited[tile][index] } else { own };
        uncovered += usize::from(own == EMPTY || splat_key::tag(own) == PREVIOUS_ONLY);
        match frame.pixel([x, y], tile, own, key) {
            Some((pixel, is_static_pixel)) => {
                out.pixels_mut()[y * grid.width + x] = pixel;
                static_drawn[tile] |= u64::from(is_static_pixel) << index;
            }
            None => hidden[tile] |= 1 << index,
        }
    }
    let sharp = out.clone();
    for (tile, at) in tiles(grid) {
        frame.antialias(tile, at, [hidden[tile], static_drawn[tile]], &sharp, &mut out);
    }
    inpainted(grid, &hidden, &mut out);
    (out, uncovered as f32 / (grid.width * grid.height) as f32)
}

fn inpainted<P: Colour>(grid: Grid, hidden: &[u64], out: &mut Raster<P>) {
    if hidden.iter().any(|&tile| tile != 0) {
        Inpainter::default().paint(grid, hidden, out).unwrap();
    }
}

impl<P: Colour> ReferenceFrame<'_, P> {
    fn rule(&self, doubt_threshold: u8) -> MergeRule {
        let weight = ((self.phase + 16) / 32).clamp(1, 127) as u8;
        MergeRule {
            weight,
            nearer_is_current: 2 * self.phase >= PHASE_ONE,
            max_equal_difference: MAX_EQUAL_DIFFERENCE,
            doubt_threshold,
        }
    }

    /// Positions of a pixel in the two anchors, with the phase of its tile if that is uniform.
    fn source_positions(&self, [x, y]: [usize; 2], key: Key, is_whole: bool) -> [[i32; 2]; 2] {
        let (vector, phase) = (splat_key::vector(key), phase_at(self.frame_keys, &self.time, [x, y], key, is_whole));
        let previous_position = [64 * x as i32 + scaled(vector[0], phase), 64 * y as i32 + scaled(vector[1], phase)];
        [previous_position, [previous_position[0] - vector[0], previous_position[1] - vector[1]]]
    }

    /// Blends edges of a tile that no depth confirms.
    fn antialias(
        &self,
        tile: usize,
        at: [usize; 2],
        [hidden, static_drawn]: [u64; 2],
        sharp: &Raster<P>,
        out: &mut Raster<P>,
    ) {
        let grid = self.frame_keys.grid;
        if !self.is_optical_flow
            || self.frame_keys.tiles[tile].kind != TileKind::Mixed
            || grid.extent(at[0], at[1]) != [TILE, TILE]
        {
            return;
        }
        let keys: Vec<Key> = pixels_of(grid, at).map(|[x, y]| self.frame_keys.key_at(x, y)).collect();
        let is_edge = (0..2).any(|axis| {
            let along = || keys.iter().map(|&key| splat_key::vector(key)[axis]);
            along().max().unwrap() - along().min().unwrap() > EDGE_MOTION
        });
        let is_in = |mask: u64, x: usize, y: usize| mask >> grid.locate(x, y).1 & 1 == 1;
        for ([x, y], &key) in pixels_of(grid, at).zip(&keys) {
            let is_uncovered = splat_key::tag(key) == PREVIOUS_ONLY || splat_key::tag(key) == HOLE;
            if !(is_edge || is_uncovered) || is_in(hidden | static_drawn, x, y) {
                continue;
            }
            let neighbours = [[x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]].map(|[u, v]| {
                let is_own = [u / TILE, v / TILE] == at && !is_in(hidden, u, v);
                let [u, v] = if is_own { [u, v] } else { [x, y] };
                sharp.pixels()[v * grid.width + u]
            });
            out.pixels_mut()[y * grid.width + x] =
                sharp.pixels()[y * grid.width + x].blended(neighbours, NEIGHBOUR_WEIGHT);
        }
    }

    /// Colour of a pixel if an anchor shows it, and whether it is a static overlay.
    fn pixel(&self, at: [usize; 2], tile: usize, own: Key, key: Key) -> Option<(P, bool)> {
        let grid = self.frame_keys.grid;
        let [previous_position, current_position] = self.source_positions(at, key, true);
        let (of_previous, of_current) =
            (P::sample(self.previous, previous_position), P::sample(self.current, current_position));
        let rule = self.rule(doubt_threshold(self.is_optical_flow));
        let (merged, is_far_apart) = P::merge(of_previous, of_current, &rule);
        let (from, to) = (grid.nearest_pixel(previous_position), grid.nearest_pixel(current_position));
        let is_doubtful =
            is_far_apart || own == EMPTY || splat_key::tag(own) == PREVIOUS_ONLY || from.is_none() || to.is_none();
        let is_close = !P::merge(of_previous, of_current, &self.rule(STRICT_DOUBT_THRESHOLD)).1;
        if !is_doubtful && (is_close || self.is_visible_tile(tile)) {
            return Some((merged, false));
        }
        // Beside foreground (without depth, beside any other motion) a pixel belongs to that if the anchors then agree
        // better.
        let moves_otherwise = |other: Key| !splat_key::motion_within(other, key, DISTINCT_MOTION);
        let neighbours = (at[1].saturating_sub(1)..(at[1] + 2).min(grid.height)).flat_map(|y| {
            (at[0].saturating_sub(1)..(at[0] + 2).min(grid.width)).map(move |x| self.frame_keys.key_at(x, y))
        });
        let foreground = neighbours.filter(|&key| !self.is_optical_flow || moves_otherwise(key)).min().unwrap_or(key);
        let [foreground_previous, foreground_current] = self.source_positions(at, foreground, false);
        let has_foreground = (self.is_optical_flow || is_in_front(foreground, key))
            && moves_otherwise(foreground)
            && !self.is_visible_tile(tile);
        if has_foreground && grid.contains_position(foreground_previous) && grid.contains_position(foreground_current) {
            let (a, b) = (P::sample(self.previous, foreground_previous), P::sample(self.current, foreground_current));
            let is_visible = from.is_some_and(|[x, y]| similar_motion(self.previous_keys.key_at(x, y), key))
                && to.is_some_and(|[x, y]| similar_motion(self.field.own_key(x, y), key));
            let own = if is_visible {
                colour_difference(of_previous, of_current)
            } else {
                occluded_difference(self.is_optical_flow)
            };
            if colour_difference(a, b) <= EDGE_TOLERANCE && colour_difference(a, b) < own {
                return Some((P::merge(a, b, &rule).0, false));
            }
        }
        let tag = splat_key::tag(key);
        let mut in_previous = from.is_some_and(|[x, y]| {
            let key_there = self.previous_keys.key_at(x, y);
            tag == PREVIOUS_ONLY
                || similar_motion(key_there, key)
                || splat_key::tag(key_there) == PREVIOUS_ONLY && !is_in_front(key_there, key)
        });
        let mut in_current = to.is_some_and(|[x, y]| {
            let key_there = self.field.own_key(x, y);
            similar_motion(key_there, key) || tag != PREVIOUS_ONLY && tag != HOLE && is_in_front(key, key_there)
        });
        if is_doubtful && self.finds_overlays && (in_previous == in_current || from.is_none() || to.is_none()) {
            let anchors = Anchors { previous: self.previous, current: self.current };
            let vector = splat_key::vector(key);
            if anchors.is_overlay_in_current(at, vector) {
                let index = at[1] * grid.width + at[0];
                return Some((P::merge(self.previous.pixels[index], self.current.pixels[index], &rule).0, true));
            }
            in_previous = in_previous && !from.is_some_and(|from| anchors.is_overlay_in_previous(from, vector));
            in_current = in_current && !to.is_some_and(|to| anchors.is_overlay_in_current(to, vector));
        }
        match (in_previous, in_current) {
            (true, true) => Some((merged, false)),
            (true, false) => Some((of_previous, false)),
            (false, true) => Some((of_current, false)),
            (false, false) => None,
        }
    }

    /// Whether a tile is uniform and visible in both anchors: it overlaps only uniform tiles with similar motion.
    fn is_visible_tile(&self, tile: usize) -> bool {
        let grid = self.frame_keys.grid;
        let at = [tile % grid.columns, tile / grid.columns];
        let Tile { kind, key, .. } = self.frame_keys.tiles[tile];
        kind == TileKind::Uniform
            && grid.extent(at[0], at[1]) == [TILE, TILE]
            && pixels_of(grid, at).all(|pixel| {
                let is_visible = |keys: &KeyBuffer, position| {
                    grid.nearest_pixel(position).is_some_and(|[x, y]| {
                        let tile_there = keys.tiles[grid.locate(x, y).0];
                        tile_there.kind == TileKind::Uniform
                            && (similar_motion(tile_there.key, key) || same_slope(tile_there.key, key))
                    })
                };
                let [previous_position, current_position] = self.source_positions(pixel, key, true);
                is_visible(self.previous_keys, previous_position) && is_visible(self.field, current_position)
            })
    }
}
