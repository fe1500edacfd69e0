//! The buffers of a generator.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};

use super::layout::Layout;
use crate::gpu::compute::picture_formats::pitch;
use crate::gpu::compute::{ResourceWithState, View, WordRange};
use crate::gpu::{Gpu, Heap, buffer};
use crate::{Error, ErrorKind, Result};

/// Largest number of splat pixels: 65535 thread groups of 1024.
const MAX_SPLAT_PIXELS: u64 = 65_535 * 1024;

/// Buffers of a generator: about 50 bytes per pixel, allocated once.
pub(super) struct Memory {
    /// Results of one word and per tile, at the offsets of the layout.
    small: ID3D12Resource,
    /// Keys during splatting.
    scratch: ID3D12Resource,
    /// Keys of the current anchor's pixels.
    field: ID3D12Resource,
    /// Keys of the previous anchor's pixels.
    previous_keys: ID3D12Resource,
    /// Keys of the frame's pixels.
    frame_keys: ID3D12Resource,
    picture: ID3D12Resource,
    /// Bytes of `small`, `scratch`, each buffer of keys, and `picture`.
    sizes: [u64; 4],
}

impl Memory {
    /// Allocates the buffers.
    ///
    /// # Errors
    /// `Unsupported` for pictures of more than about 64 million pixels; `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn new(gpu: &Gpu, layout: &Layout) -> Result<Self> {
        let [width, height] = layout.constants.size;
        // Half floats are the widest format.
        let picture = u64::from(pitch(width, 8)) * u64::from(height);
        let keys = 8 * u64::from(width) * u64::from(height);
        let sizes = [layout.small, 8 * layout.splat_pixels, keys, picture];
        if layout.splat_pixels > MAX_SPLAT_PIXELS || sizes.iter().any(|&bytes| bytes / 4 > 1 << 27) {
            return Err(Error::new(ErrorKind::Unsupported, format!("frames of {width} x {height} pixels"))
                .field("size")
                .remedy("Generate at a smaller size and scale up"));
        }
        let make = |bytes: u64| buffer(gpu, Heap::Device, bytes as usize);
        Ok(Self {
            small: make(sizes[0])?,
            scratch: make(sizes[1])?,
            field: make(sizes[2])?,
            previous_keys: make(sizes[2])?,
            frame_keys: make(sizes[2])?,
            picture: make(sizes[3])?,
            sizes,
        })
    }

    /// The views that shaders write. The splat destination is the previous anchor if `swapped`, otherwise the frame.
    pub(super) fn views(&self, swapped: bool) -> [View<'_>; 6] {
        let [small, scratch, keys, picture] = self.sizes;
        let (source, destination) = match swapped {
            true => (&self.frame_keys, &self.previous_keys),
            false => (&self.previous_keys, &self.frame_keys),
        };
        [
            view(&self.small, small),
            view(&self.scratch, scratch),
            view(&self.field, keys),
            view(source, keys),
            view(destination, keys),
            view(&self.picture, picture),
        ]
    }

    /// The finished picture.
    pub(super) fn picture(&self) -> ResourceWithState<'_> {
        in_common_state(&self.picture)
    }

    /// The buffer with the results of one word.
    pub(super) fn small(&self) -> ResourceWithState<'_> {
        in_common_state(&self.small)
    }
}

fn in_common_state(resource: &ID3D12Resource) -> ResourceWithState<'_> {
    ResourceWithState { resource, state: D3D12_RESOURCE_STATE_COMMON }
}

fn view(resource: &ID3D12Resource, bytes: u64) -> View<'_> {
    View::Buffer(in_common_state(resource), WordRange { first: 0, count: bytes.div_ceil(4) as u32 })
}
