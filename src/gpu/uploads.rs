//! Copies pictures from CPU memory into an engine's textures.

use windows::Win32::Graphics::Direct3D12::*;

use super::buffers::{Heap, MappedBuffer};
use super::fenced_slots::FencedSlots;
use super::target::{Target, check_list};
use super::texture::layout;
use super::{FencePoint, Gpu};
use crate::allocate;
use crate::pixel_format::{PixelConverter, PixelFormat};
use crate::{Colours, Error, ErrorKind, Picture, Result};

/// Upload heaps from which command lists copy pictures into an engine's textures. The texture needs no view and no unordered
/// access.
///
/// Threads: one at a time; may move between them.
pub struct Uploads {
    gpu: Gpu,
    slots: FencedSlots<Option<MappedBuffer>>,
    /// The slot of the last copy, and its content.
    last: Option<(usize, Content)>,
    row: Vec<u8>,
}

/// The picture in a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Content {
    /// Number of the picture; 0 before it is known.
    picture: u64,
    texel: PixelFormat,
    colours: Colours,
    size: (u32, u32),
}

/// A checked copy of a picture into a target that is yet to be recorded.
pub struct PendingUpload<'a> {
    uploads: &'a mut Uploads,
    slot: usize,
    list: ID3D12GraphicsCommandList,
    target: Target,
    layout: D3D12_PLACED_SUBRESOURCE_FOOTPRINT,
    content: Content,
}

impl Uploads {
    /// `lists` slots: the number of pictures that lists may read at a time. The memory is allocated for the first pictures, or by
    /// [`prepare`](Self::prepare).
    pub fn new(gpu: &Gpu, lists: usize) -> Result<Self> {
        let slots = FencedSlots::new(lists, || Ok(None))?;
        Ok(Self { gpu: gpu.clone(), slots, last: None, row: Vec::new() })
    }

    /// Allocates memory for targets of `size` with `pixel` bytes per pixel.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`.
    pub fn prepare(&mut self, lists: usize, size: (u32, u32), pixel: u32) -> Result<()> {
        let pitch = (size.0 as usize * pixel as usize).next_multiple_of(D3D12_TEXTURE_DATA_PITCH_ALIGNMENT as usize);
        let bytes = pitch * size.1 as usize;
        self.slots = FencedSlots::new(lists, || MappedBuffer::new(&self.gpu, Heap::Upload, bytes).map(Some))?;
        self.last = None;
        self.grow_row(size.0 as usize * pixel as usize)
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Checks that `list`, an open list, can copy a picture of `size` in `colours` into `target`, and reserves a slot; `None` if lists
    /// may still read every slot.
    ///
    /// # Errors
    /// `InvalidArgument` for a list of another type than the queue for frames or of another device, for a texture of another kind,
    /// size, format or device, and for states that the texture cannot be in or the list cannot name; `OutOfMemory`;
    /// `DeviceRemoved`.
    pub fn begin(
        &mut self,
        list: ID3D12GraphicsCommandList,
        target: Target,
        size: (u32, u32),
        colours: Colours,
    ) -> Result<Option<PendingUpload<'_>>> {
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        let kind = check_list(&self.gpu, &list)?;
        let (desc, texel) = target.check(&self.gpu, kind, size, colours)?;
        let (layout, bytes) = layout(&self.gpu, &desc);
        let Some(slot) = self.slots.free() else { return Ok(None) };
        let memory = self.slots.memory_mut(slot);
        if memory.as_ref().is_none_or(|memory| memory.len() < bytes) {
            *memory = None;
            *memory = Some(MappedBuffer::new(&self.gpu, Heap::Upload, bytes)?);
        }
        let content = Content { picture: 0, texel, colours, size };
        Ok(Some(PendingUpload { uploads: self, slot, list, target, layout, content }))
    }

    /// Records that the list of the last copy has run when `until` is reached.
    pub fn mark_in_use_until(&mut self, until: &FencePoint) {
        if let Some((slot, _)) = self.last {
            self.slots.mark_in_use_until(slot, until);
        }
    }

    /// Number of pictures that lists may still read.
    pub fn pending(&self) -> usize {
        self.slots.pending()
    }

    /// Waits for the queue and releases all slots. Every list must have been submitted, or must never run.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn release(&mut self) -> Result<()> {
        self.gpu.frames().signal()?.wait()?;
        self.slots.release();
        Ok(())
    }

    fn grow_row(&mut self, len: usize) -> Result<()> {
        allocate::reserve(&mut self.row, len)?;
        self.row.resize(len, 0);
        Ok(())
    }
}

impl PendingUpload<'_> {
    /// Writes the picture, which has the checked size, and records its copy. `number` differs between pictures; that of the previous copy
    /// is not written again. Call [`mark_in_use_until`](Uploads::mark_in_use_until) afterwards with the fence point at which the list has run.
    pub fn record(self, picture: &Picture, number: u64) -> Result<()> {
        let Self { uploads, mut slot, list, target, layout, content } = self;
        let content = Content { picture: number, ..content };
        assert_eq!(picture.size(), content.size, "the size that was checked");
        match uploads.last.filter(|(_, last)| *last == content) {
            Some((last, _)) => slot = last,
            None => {
                uploads.last = None;
                let len = content.size.0 as usize * content.texel.bytes();
                uploads.grow_row(len)?;
                let memory = uploads.slots.memory_mut(slot).as_mut().ok_or_else(no_memory)?;
                let converter = PixelConverter::new(content.texel, content.colours);
                let rows = picture.rgba().chunks_exact(content.size.0 as usize * 4);
                for (y, from) in rows.enumerate() {
                    converter.row(from, &mut uploads.row);
                    memory.write(layout.Offset as usize + y * layout.Footprint.RowPitch as usize, &uploads.row);
                }
            }
        }
        let memory = uploads.slots.memory(slot).as_ref().ok_or_else(no_memory)?;
        target.record_copy(&list, memory.resource(), layout);
        uploads.last = Some((slot, content));
        Ok(())
    }
}

fn no_memory() -> Error {
    Error::new(ErrorKind::InvalidState, "the copy has no memory")
}

impl Drop for Uploads {
    fn drop(&mut self) {
        // The queue may still read the memory that is freed next. The engine must drop unsubmitted lists first.
        self.gpu.frames().wait_ignoring_loss();
    }
}

impl std::fmt::Debug for Uploads {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Uploads({:?})", self.gpu)
    }
}
