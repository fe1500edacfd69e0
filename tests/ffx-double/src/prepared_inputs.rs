//! Copies of motion and depth, recorded by the prepare call. AMD's libraries also read the host's textures in that call's list only; frames
//! are generated from what it wrote. A swap chain generates them after the host's list, when the host may have changed the textures' states.

use std::ffi::c_void;

use windows::Win32::Graphics::Direct3D12::*;
use windows::core::{Interface, Result};

use crate::shader_work::{READ, TextureArg, committed, record_barriers, state, transition};

/// As many frames as AMD's libraries keep: one that is generated while the next is prepared.
const FRAMES: usize = 2;
/// ffx-api's value of [`READ`].
const READ_ARG: u32 = 4;

/// A checked prepare call: its list and the host's textures.
pub(crate) struct PrepareRequest {
    pub(crate) list: *mut c_void,
    pub(crate) motion: TextureArg,
    pub(crate) depth: TextureArg,
}

/// The copies of a context, in the state for shader reads.
#[derive(Default)]
pub(crate) struct PreparedInputs {
    copies: [[Option<ID3D12Resource>; 2]; FRAMES],
    /// Copies of earlier sizes, which queued frames may still use.
    retired: Vec<ID3D12Resource>,
    next: usize,
}

impl PreparedInputs {
    /// Records the copies of motion and depth; both textures return to their stated states. Returns the copies.
    ///
    /// # Safety
    /// List and textures were checked, and live until the list has run.
    pub(crate) unsafe fn record(&mut self, device: &ID3D12Device, request: &PrepareRequest) -> Result<[TextureArg; 2]> {
        // SAFETY: checked to be a list.
        let list = unsafe { ID3D12GraphicsCommandList::from_raw_borrowed(&request.list) };
        let list = list.ok_or_else(windows::core::Error::empty)?;
        let (mut before, mut after, mut copies) = (Vec::new(), Vec::new(), Vec::new());
        let mut made = [request.motion; 2];
        for (index, arg) in [&request.motion, &request.depth].into_iter().enumerate() {
            // SAFETY: checked to be a resource.
            let source = unsafe { ID3D12Resource::from_raw_borrowed(&arg.pointer) };
            let source = source.ok_or_else(windows::core::Error::empty)?;
            let copy = self.copy_for(device, source, index)?;
            let copied = D3D12_RESOURCE_STATE_COPY_SOURCE;
            if state(arg.state) != copied {
                before.push(transition(source, state(arg.state), copied));
                after.push(transition(source, copied, state(arg.state)));
            }
            before.push(transition(&copy, READ, D3D12_RESOURCE_STATE_COPY_DEST));
            after.push(transition(&copy, D3D12_RESOURCE_STATE_COPY_DEST, READ));
            made[index] = TextureArg { pointer: copy.as_raw(), state: READ_ARG };
            copies.push((copy, source));
        }
        // SAFETY: an open list, and textures that live until it has run, by the caller's promise and as the context does.
        unsafe {
            record_barriers(list, &before);
            for (copy, source) in copies {
                list.CopyResource(&copy, source);
            }
            record_barriers(list, &after);
        }
        self.next = (self.next + 1) % FRAMES;
        Ok(made)
    }

    /// This frame's copy, of the source's size and format.
    fn copy_for(&mut self, device: &ID3D12Device, source: &ID3D12Resource, index: usize) -> Result<ID3D12Resource> {
        // SAFETY: a live texture.
        let wanted = unsafe { source.GetDesc() };
        let slot = &mut self.copies[self.next][index];
        if let Some(copy) = slot {
            // SAFETY: as above.
            let had = unsafe { copy.GetDesc() };
            if (had.Width, had.Height, had.Format) == (wanted.Width, wanted.Height, wanted.Format) {
                return Ok(copy.clone());
            }
        }
        let wanted = D3D12_RESOURCE_DESC { Flags: D3D12_RESOURCE_FLAG_NONE, Alignment: 0, ..wanted };
        let copy = committed(device, D3D12_HEAP_TYPE_DEFAULT, &wanted, READ)?;
        self.retired.extend(slot.replace(copy.clone()));
        Ok(copy)
    }
}
