//! Forward warp of segments to another time, and visibility there. In: segments of one or two times, and how far each goes. Out: the segments that
//! are visible at the other time; pixels that none reaches are in none.

use parking_lot::Mutex;

use super::super::kernels::TILE;
use super::super::layer::{self, Grid, Key, ONE_SURFACE, SLOPE, is_nearer, landed, slopes};
use super::super::perspective::Way;
use super::super::sized;
use super::tiles::{SLOTS, Segment, Segments, inside, shifted_left, shifted_right, split};
use crate::Result;
use crate::tasks::{self, Parallel};

/// Rows of tiles that are filled together.
const BAND: usize = 4;
/// Arrivals that a tile keeps: the nearest ones.
const ARRIVALS: usize = 32;
/// Segments that arrive in a tile with vectors that differ by no more than this become one, in 1/64 px.
const JOIN: i32 = 48;

/// Segments to warp.
#[derive(Clone, Copy)]
pub(super) struct Pass<'a> {
    pub(super) segments: &'a Segments,
    pub(super) way: Way,
    /// Only segments that this accepts.
    pub(super) is_of_pass: fn(&Segment) -> bool,
}

/// A part of a segment that has arrived in a tile. The key is all of the segment but its mask.
#[derive(Debug, Clone, Copy, Default)]
struct Arrival {
    key: Key,
    mask: u64,
}

/// What has arrived in a tile, the nearest first.
#[derive(Debug, Clone)]
struct Arrivals {
    count: usize,
    parts: [Arrival; ARRIVALS],
}

impl Arrivals {
    /// Adds a part. The order of calls does not matter: parts with equal keys are joined, and the nearest distinct ones are kept.
    #[inline(always)]
    fn add(&mut self, part: Arrival) {
        let mut at = self.count;
        while at > 0 {
            let other = self.parts[at - 1].key;
            if other == part.key {
                self.parts[at - 1].mask |= part.mask;
                return;
            }
            if other < part.key {
                break;
            }
            at -= 1;
        }
        if at == ARRIVALS {
            return;
        }
        let end = self.count.min(ARRIVALS - 1);
        for i in (at..end).rev() {
            self.parts[i + 1] = self.parts[i];
        }
        self.parts[at] = part;
        self.count = end + 1;
    }
}

/// Working memory: the arrivals of a band for each thread.
#[derive(Debug, Default)]
pub(super) struct Bands {
    of_threads: Vec<Mutex<Vec<Arrivals>>>,
}

impl Bands {
    pub(super) fn reserve(&mut self, grid: Grid) -> Result<()> {
        let threads = tasks::concurrency();
        if self.of_threads.len() < threads {
            super::super::reserve(&mut self.of_threads, threads)?;
            self.of_threads.resize_with(threads, Mutex::default);
        }
        for band in &mut self.of_threads {
            let empty = Arrivals { count: 0, parts: [Arrival::default(); ARRIVALS] };
            sized(band.get_mut(), BAND * grid.columns, empty)?;
        }
        Ok(())
    }
}

/// Warps `passes` to another time. With `is_tiled`, motion was given in tiles, so that the mean of those of one surface that meet is nearer to the truth
/// than the step between them.
pub(super) fn warp(passes: &[Pass<'_>], is_tiled: bool, bands: &Bands, to: &mut Segments) -> Result<()> {
    let grid = passes[0].segments.grid;
    to.reserve(grid)?;
    let slots = bands.of_threads.len();
    to.par_rows_mut(BAND).enumerate().for_each_in_slot(slots, |slot, (number, mut tiles)| {
        let mut arrivals = bands.of_threads[slot].lock();
        let band = Band { grid, first: number * BAND, rows: tiles.rows() };
        arrivals.iter_mut().for_each(|tile| tile.count = 0);
        for pass in passes {
            band.collect(pass, &mut arrivals);
        }
        for j in 0..tiles.rows() {
            for column in 0..grid.columns {
                let extent = grid.extent(column, band.first + j);
                let mut visible = [Segment::default(); SLOTS];
                let count = resolve(&arrivals[j * grid.columns + column], inside(extent), is_tiled, &mut visible);
                tiles.set(j * grid.columns + column, &visible[..count]);
            }
        }
    });
    Ok(())
}

/// Rows of tiles that are filled together.
struct Band {
    grid: Grid,
    first: usize,
    rows: usize,
}

impl Band {
    /// Adds what lands in this band.
    fn collect(&self, pass: &Pass<'_>, arrivals: &mut [Arrivals]) {
        let Pass { segments, way, is_of_pass } = *pass;
        let columns = self.grid.columns as i32;
        let bounds = way.bounds();
        let (top, end) = ((self.first * TILE) as i32, ((self.first + self.rows) * TILE) as i32);
        for row in 0..self.grid.rows {
            let span = segments.span(row);
            if span[0] > span[1] {
                continue;
            }
            let y = (row * TILE) as i32;
            let ends = bounds.map(|reach| span.map(|v| landed(y, v, reach)));
            let least = ends.as_flattened().iter().copied().min().unwrap_or(y);
            let most = ends.as_flattened().iter().copied().max().unwrap_or(y);
            if most.saturating_add(TILE as i32) <= top || least >= end {
                continue;
            }
            for column in 0..self.grid.columns {
                let corner = [column * TILE, row * TILE];
                for segment in segments.of(row * self.grid.columns + column).filter(|s| s.mask != 0 && is_of_pass(s)) {
                    let key = segment.key();
                    let reach = way.reach_of_tile(key, corner);
                    let u = landed(corner[0] as i32, segment.vector[0], reach);
                    let v = landed(corner[1] as i32, segment.vector[1], reach);
                    let (across, down) = (u >> 3, (v >> 3) - self.first as i32);
                    if !(-1..columns).contains(&across) || !(-1..self.rows as i32).contains(&down) {
                        continue;
                    }
                    let parts = split(segment.mask, (u & 7) as u32, (v & 7) as u32);
                    for (part, [dx, dy]) in parts.into_iter().zip([[0, 0], [1, 0], [0, 1], [1, 1]]) {
                        let [x, y] = [across + dx, down + dy];
                        if part != 0 && (0..columns).contains(&x) && (0..self.rows as i32).contains(&y) {
                            arrivals[(y * columns + x) as usize].add(Arrival { key, mask: part });
                        }
                    }
                }
            }
        }
    }
}

/// A segment that is being made of several.
#[derive(Clone, Copy, Default)]
struct Joined {
    segment: Segment,
    sum: [i64; 2],
}

/// Which of a tile's arrivals are visible, the nearest first; returns their number.
#[inline(always)]
fn resolve(arrivals: &Arrivals, inside: u64, is_tiled: bool, visible: &mut [Segment; SLOTS]) -> usize {
    if arrivals.count == 1 {
        let Arrival { key, mask } = arrivals.parts[0];
        visible[0] = Segment::new(key, mask & inside);
        return 1;
    }
    resolve_several(arrivals, inside, is_tiled, visible)
}

fn resolve_several(arrivals: &Arrivals, inside: u64, is_tiled: bool, visible: &mut [Segment; SLOTS]) -> usize {
    let mut joined = [Joined::default(); SLOTS];
    let (mut count, mut left) = (0, inside);
    for part in &arrivals.parts[..arrivals.count] {
        let mask = part.mask & left;
        if mask == 0 {
            continue;
        }
        let arrival = &Segment::new(part.key, 0);
        left &= !mask;
        let can_join = |joined: &Joined| {
            let other = &joined.segment;
            let is_surface = other.rank.abs_diff(arrival.rank) <= ONE_SURFACE;
            let limit = if is_tiled { SLOPE } else { JOIN };
            is_kind(other.mark) == is_kind(arrival.mark) && is_surface && other.moves_within(arrival, limit)
        };
        let apart =
            |joined: &Joined| -> i32 { (0..2).map(|c| (joined.segment.vector[c] - arrival.vector[c]).abs()).sum() };
        let found = match joined[..count].iter().position(can_join) {
            Some(found) => found,
            None if count < SLOTS => {
                joined[count].segment = Segment { mask: 0, ..*arrival };
                count += 1;
                count - 1
            }
            None => (0..SLOTS).min_by_key(|&i| apart(&joined[i])).unwrap_or(0),
        };
        let area = i64::from(mask.count_ones());
        joined[found].segment.mask |= mask;
        (0..2).for_each(|c| joined[found].sum[c] += area * i64::from(arrival.vector[c]));
        if left == 0 {
            break;
        }
    }
    for (to, joined) in visible.iter_mut().zip(&joined[..count]) {
        let area = i64::from(joined.segment.mask.count_ones());
        let vector = joined.sum.map(|sum| (2 * sum + area).div_euclid(2 * area) as i32);
        *to = Segment { vector, ..joined.segment };
    }
    if count > 1 {
        close_cracks(&mut visible[..count]);
    }
    count
}

/// Gives pixels between two of a surface to that, where something farther shows through: a surface that comes nearer tears otherwise.
fn close_cracks(visible: &mut [Segment]) {
    for front in 0..visible.len() {
        let (key, mask) = (visible[front].key(), visible[front].mask);
        if !visible[front + 1..].iter().any(|other| is_nearer(key, other.key())) {
            continue;
        }
        let of_surface = |other: &&Segment| slopes(key, other.key());
        let surface = visible.iter().filter(of_surface).fold(0, |all, other| all | other.mask);
        let beside = |mask: u64| [shifted_right(mask, 1), shifted_left(mask, 1), mask << 8, mask >> 8];
        let [left, right, above, below] = beside(surface);
        let crack = (left & right | above & below) & !surface & beside(mask).into_iter().fold(0, |all, m| all | m);
        if crack == 0 {
            continue;
        }
        for other in front + 1..visible.len() {
            let taken = if is_nearer(key, visible[other].key()) { visible[other].mask & crack } else { 0 };
            visible[other].mask &= !taken;
            visible[front].mask |= taken;
        }
    }
}

/// What a mark says of a segment, without its matching error.
fn is_kind(mark: u8) -> u8 {
    mark.max(layer::WORST_MATCH)
}
