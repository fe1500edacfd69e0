//! Pictures from the processor's memory in an engine's textures.

use windows::Win32::Graphics::Direct3D12::*;

use super::compute::FRAMES_IN_FLIGHT;
use super::memory::{Heap, Shared};
use super::target::{Target, check_list};
use super::texture::{barrier, copy, first_level, layout, placed};
use super::{Gpu, Moment};
use crate::texels::{Encoder, Texel};
use crate::{Colours, Error, ErrorKind, Picture, Result};

/// A ring of memory from which command lists of an engine's copy pictures into its textures. A copy needs nothing of a texture but
/// that it is one: no view, and no access for shaders.
///
/// Each list must have been given to the device's queue for frames before the next one is recorded: what the queue has done then
/// says which memory is free.
///
/// Threads: one at a time; may move between them.
pub struct Uploads {
    gpu: Gpu,
    slots: [Slot; FRAMES_IN_FLIGHT],
    next: usize,
    /// The slot that was recorded last, until the queue is asked when it is free.
    recorded: Option<usize>,
    row: Vec<u8>,
}

#[derive(Default)]
struct Slot {
    memory: Option<(Shared, usize)>,
    busy: Option<Moment>,
}

/// A place in a list for a picture: everything about it is checked, and nothing is recorded yet.
pub struct Place<'a> {
    uploads: &'a mut Uploads,
    slot: usize,
    list: ID3D12GraphicsCommandList,
    target: Target,
    layout: D3D12_PLACED_SUBRESOURCE_FOOTPRINT,
    size: (u32, u32),
    texel: Texel,
    colours: Colours,
}

impl Uploads {
    /// A ring for an engine's lists of the type of the queue for frames. Its memory is made with the first pictures.
    pub fn new(gpu: &Gpu) -> Self {
        let slots = std::array::from_fn(|_| Slot::default());
        Self { gpu: gpu.clone(), slots, next: 0, recorded: None, row: Vec::new() }
    }

    /// The device that it is for.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Prepares for a picture of `size` to be copied by `list`, an engine's open one, into `target`, in `colours`.
    /// Waits where three lists before it have not run.
    ///
    /// # Errors
    /// `InvalidArgument` for a list of another type than the queue for frames or of another device, for a texture of another kind,
    /// size, format or device, and for states that the texture cannot be in or the list cannot name; `OutOfMemory`;
    /// `DeviceRemoved`.
    pub fn place(
        &mut self,
        list: ID3D12GraphicsCommandList,
        target: Target,
        size: (u32, u32),
        colours: Colours,
    ) -> Result<Place<'_>> {
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        let kind = check_list(&self.gpu, &list)?;
        let (desc, texel) = target.check(&self.gpu, kind, size, colours)?;
        let (layout, bytes) = layout(&self.gpu, &desc);
        let slot = self.free_next(bytes)?;
        Ok(Place { uploads: self, slot, list, target, layout, size, texel, colours })
    }

    /// A slot with room for so many bytes that no list uses.
    fn free_next(&mut self, bytes: usize) -> Result<usize> {
        if let Some(recorded) = self.recorded.take() {
            self.slots[recorded].busy = Some(self.gpu.frames().now()?);
        }
        let slot = &mut self.slots[self.next];
        if let Some(busy) = &slot.busy {
            busy.wait()?;
        }
        slot.busy = None;
        if slot.memory.as_ref().is_none_or(|(_, len)| *len < bytes) {
            slot.memory = None;
            slot.memory = Some((Shared::new(&self.gpu, Heap::Upload, bytes)?, bytes));
        }
        Ok(self.next)
    }
}

impl Place<'_> {
    /// Writes the picture, which has the size that was said, and records its copy.
    pub fn fill(self, picture: &Picture) -> Result<()> {
        let Self { uploads, slot, list, target, layout, size, texel, colours } = self;
        assert_eq!(picture.size(), size, "the size that was checked");
        let Some((memory, _)) = &mut uploads.slots[slot].memory else {
            return Err(Error::new(ErrorKind::InvalidState, "the place has no memory"));
        };
        let (encoder, len) = (Encoder::new(texel, colours), size.0 as usize * texel.bytes());
        let more = len.saturating_sub(uploads.row.len());
        uploads
            .row
            .try_reserve_exact(more)
            .map_err(|_| Error::new(ErrorKind::OutOfMemory, format!("a row of {len} bytes cannot be allocated")))?;
        uploads.row.resize(len, 0);
        for (y, from) in picture.rgba().chunks_exact(size.0 as usize * 4).enumerate() {
            encoder.row(from, &mut uploads.row);
            memory.write(layout.Offset as usize + y * layout.Footprint.RowPitch as usize, &uploads.row);
        }
        if target.before != D3D12_RESOURCE_STATE_COPY_DEST {
            barrier(&list, &target.texture, target.before, D3D12_RESOURCE_STATE_COPY_DEST);
        }
        copy(&list, &first_level(&target.texture), &placed(memory.resource(), layout));
        if target.after != D3D12_RESOURCE_STATE_COPY_DEST {
            barrier(&list, &target.texture, D3D12_RESOURCE_STATE_COPY_DEST, target.after);
        }
        uploads.recorded = Some(slot);
        uploads.next = (slot + 1) % FRAMES_IN_FLIGHT;
        Ok(())
    }
}

impl Drop for Uploads {
    fn drop(&mut self) {
        // The queue may still read what is freed next.
        if self.recorded.is_some() || self.slots.iter().any(|slot| slot.busy.is_some()) {
            self.gpu.frames().settle();
        }
    }
}

impl std::fmt::Debug for Uploads {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Uploads({:?})", self.gpu)
    }
}
