//! The buffers of a generator.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};

use super::layout::Layout;
use crate::gpu::compute::pictures::pitch;
use crate::gpu::compute::{ResourceWithState, View, Words};
use crate::gpu::{Gpu, Heap, buffer};
use crate::{Error, ErrorKind, Result};

/// Largest number of splat pixels: 65535 thread groups of 1024.
const MOST_PLACES: u64 = 65_535 * 1024;

/// The buffers: about 50 bytes per pixel, allocated once.
pub(super) struct Memory {
    small: ID3D12Resource,
    scratch: ID3D12Resource,
    field: ID3D12Resource,
    owners: ID3D12Resource,
    places: ID3D12Resource,
    picture: ID3D12Resource,
    sizes: [u64; 4],
}

impl Memory {
    /// # Errors
    /// `Unsupported` for pictures of more than about 64 million pixels; `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn new(gpu: &Gpu, layout: &Layout) -> Result<Self> {
        let [width, height] = layout.constants.size;
        // Half floats are the widest format.
        let picture = u64::from(pitch(width, 8)) * u64::from(height);
        let keys = 8 * u64::from(width) * u64::from(height);
        let sizes = [layout.small, 8 * layout.places, keys, picture];
        if layout.places > MOST_PLACES || sizes.iter().any(|&bytes| bytes / 4 > 1 << 27) {
            return Err(Error::new(ErrorKind::Unsupported, format!("frames of {width} x {height} pixels"))
                .field("size")
                .remedy("Generate at a smaller size and scale up"));
        }
        let make = |bytes: u64| buffer(gpu, Heap::Device, bytes as usize);
        Ok(Self {
            small: make(sizes[0])?,
            scratch: make(sizes[1])?,
            field: make(sizes[2])?,
            owners: make(sizes[2])?,
            places: make(sizes[2])?,
            picture: make(sizes[3])?,
            sizes,
        })
    }

    /// The views that shaders write. The splat destination is the previous anchor if `swapped`, otherwise the frame.
    pub(super) fn views(&self, swapped: bool) -> [View<'_>; 6] {
        let [small, scratch, keys, picture] = self.sizes;
        let (owners, places) = if swapped { (&self.places, &self.owners) } else { (&self.owners, &self.places) };
        [
            view(&self.small, small),
            view(&self.scratch, scratch),
            view(&self.field, keys),
            view(owners, keys),
            view(places, keys),
            view(&self.picture, picture),
        ]
    }

    /// The finished picture.
    pub(super) fn picture(&self) -> ResourceWithState<'_> {
        resting(&self.picture)
    }

    /// The buffer with the single-word results.
    pub(super) fn small(&self) -> ResourceWithState<'_> {
        resting(&self.small)
    }
}

fn resting(resource: &ID3D12Resource) -> ResourceWithState<'_> {
    ResourceWithState { resource, state: D3D12_RESOURCE_STATE_COMMON }
}

fn view(resource: &ID3D12Resource, bytes: u64) -> View<'_> {
    View::Buffer(resting(resource), Words { first: 0, count: bytes.div_ceil(4) as u32 })
}
