//! What stands behind the doors of Direct3D 12 where it is there.

use std::ffi::c_void;
use std::path::Path;

use windows::Win32::Graphics::Direct3D12 as direct3d;
use windows::core::{IUnknown, Interface};

use super::super::device::CAIRN_DEVICE_D3D12;
use super::super::requirements::*;
use super::super::results::{Failure, Outcome};
use super::super::text::fixed_text;
use super::{Guarded, ID3D12CommandQueue, ID3D12Device, ID3D12Resource, To};
use crate::Picture;
use crate::ffx::{self, Needed};
use crate::gpu::{self, Gpu, Uploads, adapters, read_texture};
use crate::runtime::{Device, DirectMlOptions, Ort};
use crate::world::KeptAnchor;

/// A device of an engine's objects.
///
/// # Safety
/// What is not null is an object of COM and lives during the call.
pub(in crate::abi) unsafe fn of_engine(
    d3d12: *mut ID3D12Device,
    queue: *mut ID3D12CommandQueue,
    anchors: *mut ID3D12CommandQueue,
) -> Outcome<Device> {
    // SAFETY: the caller's promise.
    let device: direct3d::ID3D12Device = unsafe { object(d3d12.cast(), "d3d12") }?;
    // SAFETY: the caller's promise.
    let queue: direct3d::ID3D12CommandQueue = unsafe { object(queue.cast(), "queue") }?;
    let anchors: Option<direct3d::ID3D12CommandQueue> = match anchors.is_null() {
        true => None,
        // SAFETY: the caller's promise.
        false => Some(unsafe { object(anchors.cast(), "anchors") }?),
    };
    running(&Gpu::of_engine(&device, &queue, anchors.as_ref())?)
}

/// A device of our own.
pub(in crate::abi) fn on_adapter(luid: u64) -> Outcome<Device> {
    running(&Gpu::on_adapter(Some(luid))?)
}

fn running(gpu: &Gpu) -> Outcome<Device> {
    Ok(Device::directml(&Ort::find(None)?, gpu, DirectMlOptions::default())?)
}

/// What a device runs on, each with a reference more; none for a CPU device.
pub(in crate::abi) fn parts(device: &Device) -> Option<(*mut ID3D12Device, *mut ID3D12CommandQueue)> {
    let gpu = device.gpu()?;
    Some((gpu.device().clone().into_raw().cast(), gpu.frames().d3d12().clone().into_raw().cast()))
}

/// What a texture holds that is in `state`.
///
/// # Safety
/// What is not null is an object of COM and lives during the call.
pub(in crate::abi) unsafe fn read(device: &Device, texture: *mut ID3D12Resource, state: u32) -> Outcome<Picture> {
    let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
    // SAFETY: the caller's promise.
    let texture: direct3d::ID3D12Resource = unsafe { object(texture.cast(), "picture") }?;
    let state = direct3d::D3D12_RESOURCE_STATES(state.cast_signed());
    Ok(read_texture(gpu, &texture, state)?)
}

/// A picture of an anchor where it was made.
pub(in crate::abi) fn texture(anchor: &KeptAnchor, index: u32) -> Outcome<Guarded> {
    let (texture, moment) = anchor.texture(index as usize).ok_or_else(Failure::no_d3d12)?;
    Ok((texture.clone().into_raw().cast(), moment.fence().clone().into_raw().cast(), moment.value()))
}

/// What frames are recorded with, once one is.
#[derive(Default)]
pub(in crate::abi) struct Recording(Option<Uploads>);

impl Recording {
    /// A place for a frame of `size` in an engine's list.
    ///
    /// # Safety
    /// What `to` points to are objects of COM and live during the call.
    pub(in crate::abi) unsafe fn place(
        &mut self,
        device: &Device,
        to: &To,
        size: (u32, u32),
        linear: bool,
    ) -> Outcome<gpu::Place<'_>> {
        let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
        // SAFETY: the caller's promise.
        let list: direct3d::ID3D12GraphicsCommandList = unsafe { object(to.list.cast(), "list") }?;
        // SAFETY: the caller's promise.
        let texture: direct3d::ID3D12Resource = unsafe { object(to.target.cast(), "target") }?;
        let [before, after] = [to.before, to.after].map(|state| direct3d::D3D12_RESOURCE_STATES(state.cast_signed()));
        // Lists of another queue than before need a ring of their own.
        let same = |uploads: &Uploads| uploads.gpu().frames().d3d12() == gpu.frames().d3d12();
        if !self.0.as_ref().is_some_and(same) {
            self.0 = None;
        }
        let uploads = self.0.get_or_insert_with(|| Uploads::new(gpu));
        Ok(uploads.place(list, gpu::Target { texture, before, after }, size, linear)?)
    }
}

/// The adapters, in the system's order.
pub(in crate::abi) fn list() -> Vec<cairn_adapter> {
    let found = adapters().unwrap_or_else(|e| {
        log::warn!("the adapters of Direct3D 12 cannot be listed: {e}");
        Vec::new()
    });
    let row = |(index, adapter): (u32, crate::gpu::Adapter)| cairn_adapter {
        struct_size: 0,
        kind: CAIRN_DEVICE_D3D12,
        index,
        reserved: 0,
        luid: adapter.luid,
        memory: adapter.memory,
        name: fixed_text(&adapter.description),
    };
    (0..).zip(found).map(row).collect()
}

/// What a device on the first adapter needs, and what of AMD's could run on it.
pub(in crate::abi) fn requirements(onnxruntime_at: Option<&Path>) -> Vec<cairn_requirement> {
    let needed = "a Direct3D 12 adapter";
    let gpu = match Gpu::on_adapter(None) {
        Ok(gpu) => gpu,
        Err(error) => {
            let found = format!("{}: {error}", platform());
            return vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_NOT_MET, needed, &found)];
        }
    };
    let found = format!("{}, adapter {:#x}", platform(), gpu.luid());
    let tried =
        Ort::find(onnxruntime_at).and_then(|ort| Device::directml(&ort, &gpu, DirectMlOptions::default()).map(|_| ort));
    let mut rows =
        vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_MET, needed, &found), onnxruntime(tried), memory()];
    rows.extend(ffx::requirements(&ffx::LoadOptions::from_environment(), &gpu).iter().map(|of_amd| {
        let what = match of_amd.what {
            Needed::Libraries => CAIRN_REQUIREMENT_FSR_LIBRARIES,
            Needed::Provider => CAIRN_REQUIREMENT_FSR_PROVIDER,
            Needed::System => CAIRN_REQUIREMENT_FSR_SYSTEM,
            Needed::Direct3d => CAIRN_REQUIREMENT_FSR_DIRECT3D,
            Needed::ShaderModel => CAIRN_REQUIREMENT_FSR_SHADER_MODEL,
        };
        let status = if of_amd.met { CAIRN_REQUIREMENT_MET } else { CAIRN_REQUIREMENT_OPTIONAL };
        row(what, status, of_amd.needed, &of_amd.found)
    }));
    rows
}

/// The interface `I` of a COM object that is not null.
///
/// # Safety
/// The pointer is of an object of COM, which lives during the call.
unsafe fn object<I: Interface>(pointer: *mut c_void, name: &str) -> Outcome<I> {
    // SAFETY: the caller's promise; every interface of COM starts with IUnknown, and no reference is taken.
    let unknown = unsafe { IUnknown::from_raw_borrowed(&pointer) };
    let cast = unknown.and_then(|unknown| unknown.cast().ok());
    cast.ok_or_else(|| Failure::argument(name, "it is an object of another kind"))
}
