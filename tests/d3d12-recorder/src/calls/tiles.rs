//! Tiles of reserved resources, and their memory.

use std::ffi::c_void;

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::Interface;

use crate::recorder::HeapRange;
use crate::timeline::Id;

/// Bytes of a tile.
const TILE: u64 = 64 * 1024;

/// A tile of a resource by its number, with its memory from now on.
pub(super) type Mapping = (u32, Option<HeapRange>);

/// Arguments of `UpdateTileMappings`.
pub(super) struct Update {
    pub(super) regions: u32,
    pub(super) starts: *const D3D12_TILED_RESOURCE_COORDINATE,
    pub(super) sizes: *const D3D12_TILE_REGION_SIZE,
    pub(super) ranges: u32,
    pub(super) flags: *const D3D12_TILE_RANGE_FLAGS,
    pub(super) heap_starts: *const u32,
    pub(super) counts: *const u32,
}

/// Numbers of a resource's tiles.
struct Tiling {
    total: u32,
    first_packed: u32,
    subresources: Vec<D3D12_SUBRESOURCE_TILING>,
}

impl Tiling {
    /// # Safety
    /// A live reserved resource.
    unsafe fn of(resource: *mut c_void) -> Option<Self> {
        // SAFETY: the caller's promise; nothing is released.
        let resource = unsafe { ID3D12Resource::from_raw_borrowed(&resource) }?;
        let mut device: Option<ID3D12Device> = None;
        // SAFETY: a live resource, and a variable that lives during the call.
        unsafe { resource.GetDevice(&mut device) }.ok()?;
        // SAFETY: a live resource.
        let desc = unsafe { resource.GetDesc() };
        let is_volume = desc.Dimension == D3D12_RESOURCE_DIMENSION_TEXTURE3D;
        let slices = if is_volume { 1 } else { u32::from(desc.DepthOrArraySize) };
        let mut count = u32::from(desc.MipLevels).max(1) * slices;
        let mut subresources = vec![D3D12_SUBRESOURCE_TILING::default(); count as usize];
        let (mut total, mut packed) = (0, D3D12_PACKED_MIP_INFO::default());
        // SAFETY: a live device and resource, and variables that live during the call.
        unsafe {
            device?.GetResourceTiling(
                resource,
                Some(&mut total),
                Some(&mut packed),
                None,
                Some(&mut count),
                0,
                subresources.as_mut_ptr(),
            );
        }
        Some(Self { total, first_packed: packed.StartTileIndexInOverallResource, subresources })
    }

    fn number(&self, at: &D3D12_TILED_RESOURCE_COORDINATE) -> u32 {
        match self.subresources.get(at.Subresource as usize) {
            Some(tiling) if tiling.StartTileIndexInOverallResource != D3D12_PACKED_TILE => {
                let (width, height) = (tiling.WidthInTiles, u32::from(tiling.HeightInTiles));
                tiling.StartTileIndexInOverallResource + at.X + width * (at.Y + height * at.Z)
            }
            _ => self.first_packed + at.X,
        }
    }

    /// Tiles of a region, in their order.
    fn region(&self, start: &D3D12_TILED_RESOURCE_COORDINATE, size: &D3D12_TILE_REGION_SIZE) -> Vec<u32> {
        if !size.UseBox.as_bool() {
            let first = self.number(start);
            return (first..first.saturating_add(size.NumTiles).min(self.total)).collect();
        }
        let (width, height, depth) = (size.Width, u32::from(size.Height), u32::from(size.Depth));
        let at = |x, y, z| D3D12_TILED_RESOURCE_COORDINATE { X: start.X + x, Y: start.Y + y, Z: start.Z + z, ..*start };
        let rows = (0..depth).flat_map(|z| (0..height).map(move |y| (y, z)));
        rows.flat_map(|(y, z)| (0..width).map(move |x| (x, y, z))).map(|(x, y, z)| self.number(&at(x, y, z))).collect()
    }
}

/// The tiles whose memory changes.
///
/// # Safety
/// A live reserved resource, and arrays as long as `UpdateTileMappings` requires, or null where it allows that.
pub(super) unsafe fn mappings(resource: *mut c_void, heap: Option<Id>, update: &Update) -> Vec<Mapping> {
    // SAFETY: the caller's promise.
    let Some(tiling) = (unsafe { Tiling::of(resource) }) else { return Vec::new() };
    // SAFETY: the caller's promise: each array has this element or is null.
    unsafe fn element<T: Copy>(array: *const T, i: usize) -> Option<T> {
        // SAFETY: as above.
        (!array.is_null()).then(|| unsafe { *array.add(i) })
    }
    let region = |i: usize| {
        // SAFETY: one of the regions.
        let (start, size) = unsafe { (element(update.starts, i), element(update.sizes, i)) };
        let all = if start.is_none() { tiling.total } else { 1 };
        let size = size.unwrap_or(D3D12_TILE_REGION_SIZE { NumTiles: all, ..Default::default() });
        tiling.region(&start.unwrap_or_default(), &size)
    };
    let mut tiles = (0..update.regions.max(1) as usize).flat_map(region).collect::<Vec<u32>>().into_iter();
    let mut mappings = Vec::new();
    for i in 0..update.ranges as usize {
        // SAFETY: one of the ranges.
        let (flags, first, count) =
            unsafe { (element(update.flags, i), element(update.heap_starts, i), element(update.counts, i)) };
        let flags = flags.unwrap_or(D3D12_TILE_RANGE_FLAG_NONE);
        let count = count.map_or(tiles.len(), |count| count as usize);
        for (j, tile) in tiles.by_ref().take(count).enumerate() {
            let offset = if flags == D3D12_TILE_RANGE_FLAG_REUSE_SINGLE_TILE { 0 } else { j as u64 };
            let start = TILE * (u64::from(first.unwrap_or_default()) + offset);
            let memory = heap.map(|heap| HeapRange { heap, bytes: start..start + TILE });
            match flags {
                D3D12_TILE_RANGE_FLAG_SKIP => {}
                D3D12_TILE_RANGE_FLAG_NULL => mappings.push((tile, None)),
                _ => mappings.push((tile, memory)),
            }
        }
    }
    mappings
}

/// Arguments of `CopyTileMappings`.
pub(super) struct MappingCopy {
    pub(super) to: *mut c_void,
    pub(super) to_start: *const D3D12_TILED_RESOURCE_COORDINATE,
    pub(super) from: *mut c_void,
    pub(super) from_start: *const D3D12_TILED_RESOURCE_COORDINATE,
    pub(super) size: *const D3D12_TILE_REGION_SIZE,
}

/// The tiles that get another's memory, each with that other one.
///
/// # Safety
/// Live reserved resources, and structs as `CopyTileMappings` requires.
pub(super) unsafe fn copies(copy: &MappingCopy) -> Vec<(u32, u32)> {
    // SAFETY: the caller's promise.
    let region = |resource, start: *const D3D12_TILED_RESOURCE_COORDINATE| unsafe {
        Some(Tiling::of(resource)?.region(start.as_ref()?, copy.size.as_ref()?))
    };
    let (to, from) = (region(copy.to, copy.to_start), region(copy.from, copy.from_start));
    to.unwrap_or_default().into_iter().zip(from.unwrap_or_default()).collect()
}
