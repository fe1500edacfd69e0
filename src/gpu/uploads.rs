//! Pictures from the processor's memory in an engine's textures.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::compute::FRAMES_IN_FLIGHT;
use super::memory::{Heap, Shared};
use super::texture::{barrier, copy, first_level, layout, names_state, placed};
use super::{Gpu, Moment};
use crate::texels::{Encoder, Texel};
use crate::{Error, ErrorKind, Picture, Result};

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

/// An engine's texture, the state it is in when a list comes to it, and the one it is left in.
#[derive(Debug, Clone)]
pub struct Target {
    /// Of two dimensions with one level, slice and sample: R8G8B8A8 or B8G8R8A8 (UNORM, UNORM_SRGB or typeless), R10G10B10A2 (UNORM
    /// or typeless) or R16G16B16A16 (FLOAT or typeless).
    pub texture: ID3D12Resource,
    /// On entry.
    pub before: D3D12_RESOURCE_STATES,
    /// On exit.
    pub after: D3D12_RESOURCE_STATES,
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
    linear: bool,
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

    /// Prepares for a picture of `size` to be copied by `list`, an engine's open one, into `target`, in `linear` light if so. Waits
    /// where three lists before it have not run.
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
        linear: bool,
    ) -> Result<Place<'_>> {
        if let Some(gone) = self.gpu.removed() {
            return Err(gone);
        }
        self.gpu.owns(&list, "list")?;
        // SAFETY: a live list.
        let kind = unsafe { list.GetType() };
        if kind != self.gpu.frames().kind() {
            let why = "the list is of another type than the device's queue";
            return Err(refuse("list", why).remedy("Record into a list of the queue's type"));
        }
        self.gpu.owns(&target.texture, "target")?;
        // SAFETY: a live resource.
        let desc = unsafe { target.texture.GetDesc() };
        let texel = check(&desc, size)?;
        if linear && texel != Texel::Rgba16F {
            return Err(refuse("target", "linear light needs more bits").remedy("Use R16G16B16A16_FLOAT"));
        }
        for (field, state) in [("before", target.before), ("after", target.after)] {
            check_state(field, state, &desc, kind)?;
        }
        let (layout, bytes) = layout(&self.gpu, &desc);
        let slot = self.free_next(bytes)?;
        Ok(Place { uploads: self, slot, list, target, layout, size, texel, linear })
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
        let Self { uploads, slot, list, target, layout, size, texel, linear } = self;
        assert_eq!(picture.size(), size, "the size that was checked");
        let Some((memory, _)) = &mut uploads.slots[slot].memory else {
            return Err(Error::new(ErrorKind::InvalidState, "the place has no memory"));
        };
        let (encoder, len) = (Encoder::new(texel, linear), size.0 as usize * texel.bytes());
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

fn refuse(field: &str, why: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidArgument, why.into()).field(field)
}

/// What a texture's pixels are; refuses one that a frame of `size` cannot be copied into.
fn check(desc: &D3D12_RESOURCE_DESC, (width, height): (u32, u32)) -> Result<Texel> {
    let one = desc.DepthOrArraySize == 1 && desc.MipLevels == 1 && desc.SampleDesc.Count == 1;
    if desc.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D || !one {
        return Err(refuse("target", "it is no texture of two dimensions with one level, slice and sample"));
    }
    if (desc.Width, desc.Height) != (u64::from(width), height) {
        let why = format!("{} x {} pixels where frames have {width} x {height}", desc.Width, desc.Height);
        return Err(refuse("target", why).remedy("Set the size of the frames in the presenter's options"));
    }
    match desc.Format {
        DXGI_FORMAT_R8G8B8A8_UNORM | DXGI_FORMAT_R8G8B8A8_UNORM_SRGB | DXGI_FORMAT_R8G8B8A8_TYPELESS => {
            Ok(Texel::Rgba8)
        }
        DXGI_FORMAT_B8G8R8A8_UNORM | DXGI_FORMAT_B8G8R8A8_UNORM_SRGB | DXGI_FORMAT_B8G8R8A8_TYPELESS => {
            Ok(Texel::Bgra8)
        }
        DXGI_FORMAT_R10G10B10A2_UNORM | DXGI_FORMAT_R10G10B10A2_TYPELESS => Ok(Texel::Rgb10A2),
        DXGI_FORMAT_R16G16B16A16_FLOAT | DXGI_FORMAT_R16G16B16A16_TYPELESS => Ok(Texel::Rgba16F),
        other => Err(refuse("target", format!("frames are not written in DXGI_FORMAT {}", other.0))
            .remedy("Use RGBA8, BGRA8, RGB10A2 or RGBA16F")),
    }
}

/// Refuses a state that a texture cannot be in, or that a list of the type cannot name: a barrier with one removes the device.
fn check_state(
    field: &str,
    state: D3D12_RESOURCE_STATES,
    desc: &D3D12_RESOURCE_DESC,
    kind: D3D12_COMMAND_LIST_TYPE,
) -> Result<()> {
    const READS: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATES(
        D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE.0
            | D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE.0
            | D3D12_RESOURCE_STATE_COPY_SOURCE.0
            | D3D12_RESOURCE_STATE_RESOLVE_SOURCE.0,
    );
    let shaders = D3D12_RESOURCE_STATE_ALL_SHADER_RESOURCE;
    let has = |flag| desc.Flags & flag != D3D12_RESOURCE_FLAG_NONE;
    let name = state.0.cast_unsigned();
    let cannot = |why: &str| Err(refuse(field, format!("D3D12_RESOURCE_STATES {name:#x}: {why}")));
    match state {
        D3D12_RESOURCE_STATE_COMMON | D3D12_RESOURCE_STATE_COPY_DEST => {}
        D3D12_RESOURCE_STATE_RENDER_TARGET => {
            if !has(D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET) {
                return cannot("the texture was not made to be a render target");
            }
        }
        D3D12_RESOURCE_STATE_UNORDERED_ACCESS => {
            if !has(D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS) {
                return cannot("the texture was not made to be written by shaders");
            }
        }
        D3D12_RESOURCE_STATE_RESOLVE_DEST => {}
        reads if reads & READS == reads => {
            let shown = reads & shaders != D3D12_RESOURCE_STATE_COMMON;
            if shown && has(D3D12_RESOURCE_FLAG_DENY_SHADER_RESOURCE) {
                return cannot("the texture was made not to be read by shaders");
            }
        }
        _ => return cannot("no texture of colours can be in it"),
    }
    if !names_state(kind, state) {
        return cannot("a compute list cannot name it");
    }
    Ok(())
}
