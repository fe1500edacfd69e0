//! Direct3D 12 backend on Windows.

mod adapters;

use std::ffi::c_void;

use windows::Win32::Graphics::Direct3D12 as direct3d;
use windows::Win32::Graphics::Dxgi::Common as Dxgi;
use windows::core::{IUnknown, Interface};

use super::super::device::{CAIRN_DEVICE_D3D12, DeviceOptions};
use super::super::requirements::*;
use super::super::results::{AbiResult, Failure};
use super::super::text::fixed_text;
use super::types::{
    AnchorTexture, FenceValue, FramePreparation, FrameResult, FrameStatistics, FrameTarget, RolloutStatistics,
    WorldOptions,
};
use crate::Picture;
use crate::ffx::{self, RequirementKind};
use crate::framegen::shader::ShaderGenerator;
use crate::gpu::{FencePoint, Gpu, Target};
use crate::present::d3d12::{self, PipelineCallbacks, PrepareOptions, RenderResult, RendererOptions};
use crate::present::presenter::Presenter;
use crate::runtime::{Device, DirectMlOptions, Ort};
use crate::world::{KeptAnchor, WorkerStatistics};
use adapters::loaded_pipelines;
pub(in crate::abi) use adapters::{adapters, requirements};

/// A device made from an engine's objects: an ID3D12Device, its queue for frames, and its queue for anchors, which may be null.
///
/// # Safety
/// Pointers that are not null are COM objects that live during the call.
pub(in crate::abi) unsafe fn of_engine(
    d3d12: *mut c_void,
    queue: *mut c_void,
    anchors: *mut c_void,
    options: DeviceOptions,
) -> AbiResult<Device> {
    // SAFETY: the caller's promise.
    let device: direct3d::ID3D12Device = unsafe { com_object(d3d12, "d3d12") }?;
    // SAFETY: the caller's promise.
    let queue: direct3d::ID3D12CommandQueue = unsafe { com_object(queue, "queue") }?;
    let anchors: Option<direct3d::ID3D12CommandQueue> = match anchors.is_null() {
        true => None,
        // SAFETY: the caller's promise.
        false => Some(unsafe { com_object(anchors, "anchors") }?),
    };
    Ok(directml_device(&Gpu::of_engine(&device, &queue, anchors.as_ref())?, options)?.0)
}

/// A device on an adapter, without an engine.
pub(in crate::abi) fn on_adapter(luid: u64, options: DeviceOptions) -> AbiResult<Device> {
    Ok(directml_device(&Gpu::on_adapter(Some(luid))?, options)?.0)
}

/// The runtime device on a Direct3D device, and the ONNX Runtime it uses.
fn directml_device(gpu: &Gpu, options: DeviceOptions) -> crate::Result<(Device, Ort)> {
    let ort = Ort::find(&options.libraries)?;
    let directml = DirectMlOptions { deterministic: options.cpu.deterministic, ..DirectMlOptions::default() };
    let device = Device::directml(&ort, gpu, directml)?;
    Ok((device.with_library_search(options.libraries), ort))
}

/// The ID3D12Device and its ID3D12CommandQueue for frames, each with an added reference; `None` for a CPU device.
pub(in crate::abi) fn device_and_queue(device: &Device) -> Option<(*mut c_void, *mut c_void)> {
    let gpu = device.gpu()?;
    Some((gpu.device().clone().into_raw(), gpu.frames().d3d12().clone().into_raw()))
}

/// Sets the options for worlds loaded from now on.
pub(in crate::abi) fn set_options(device: &Device, options: &WorldOptions) -> AbiResult<()> {
    let WorldOptions { deterministic, captured_passes, longest_submission } = *options;
    let options = DirectMlOptions { deterministic, captured_passes, longest_submission, ..DirectMlOptions::default() };
    Ok(device.set_directml_options(options)?)
}

/// Statistics of a rollout on the device; zeroes on any other than a Direct3D 12 device.
pub(in crate::abi) fn rollout_statistics(statistics: &WorkerStatistics) -> RolloutStatistics {
    let Some((took, captured)) = &statistics.device else { return RolloutStatistics::default() };
    RolloutStatistics {
        passes: took.passes,
        decodes: took.decode,
        commits: took.commit,
        in_onnxruntime: took.external.in_onnxruntime,
        waiting_for_device: took.external.waiting_for_device,
        yields: took.external.yields,
        captured: captured.used,
        others: captured.unproven + captured.unused,
    }
}

/// Reads the contents of a texture in state `state`.
///
/// # Safety
/// Pointers that are not null are COM objects that live during the call.
pub(in crate::abi) unsafe fn read_texture(device: &Device, texture: *mut c_void, state: u32) -> AbiResult<Picture> {
    let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
    // SAFETY: the caller's promise.
    let texture: direct3d::ID3D12Resource = unsafe { com_object(texture, "picture") }?;
    let state = direct3d::D3D12_RESOURCE_STATES(state.cast_signed());
    Ok(crate::gpu::read_texture(gpu, &texture, state)?)
}

/// A picture of an anchor on the device that made it.
pub(in crate::abi) fn anchor_texture(anchor: &KeptAnchor, index: u32) -> AbiResult<AnchorTexture> {
    let (texture, fence_point) = anchor.texture(index as usize).ok_or_else(Failure::no_d3d12)?;
    Ok(AnchorTexture { texture: texture.clone().into_raw(), guard: fence_value(fence_point) })
}

/// Whether frames can be made by shaders.
pub(in crate::abi) const HAS_SHADERS: bool = true;

/// Renderer of a presenter's frames.
pub(in crate::abi) type Renderer = d3d12::Renderer;

/// A renderer without a preparation.
pub(in crate::abi) fn renderer(options: RendererOptions) -> Renderer {
    Renderer::new(options)
}

/// Makes everything that frames need; false if the anchors' size is not known yet.
pub(in crate::abi) fn prepare(
    renderer: &Renderer,
    presenter: &Presenter,
    device: &Device,
    preparation: &FramePreparation,
) -> AbiResult<bool> {
    let FramePreparation { size, anchor_size, format, lists, pictures, latent, load, store, user } = *preparation;
    let options = PrepareOptions {
        size,
        anchor_size,
        format: Dxgi::DXGI_FORMAT(format.cast_signed()),
        lists: lists.unwrap_or(PrepareOptions::default().lists),
        pictures,
        latent,
    };
    let mut load = load.map(|load| move || loaded_pipelines(load, user));
    let mut store = store.map(|store| {
        // SAFETY: a function of the host's; the bytes live during the call.
        move |bytes: &[u8]| unsafe { store(bytes.as_ptr().cast(), bytes.len() as u64, user) }
    });
    let callbacks = PipelineCallbacks {
        load: load.as_mut().map(|load| load as &mut dyn FnMut() -> Option<Vec<u8>>),
        store: store.as_mut().map(|store| store as &mut dyn FnMut(&[u8])),
    };
    Ok(renderer.prepare(presenter, device, &options, callbacks)?)
}

/// Records the frame due at `now` into the list of `to`, or submits it if there is none.
///
/// # Safety
/// Pointers in `to` are COM objects that live during the call.
pub(in crate::abi) unsafe fn record(
    renderer: &Renderer,
    presenter: &Presenter,
    device: &Device,
    now: u64,
    to: &FrameTarget,
) -> AbiResult<FrameResult> {
    let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
    let list = match &to.list {
        None => None,
        Some((list, FenceValue { fence, value })) => {
            // SAFETY: the caller's promise.
            let list: direct3d::ID3D12GraphicsCommandList = unsafe { com_object(*list, "recording.list") }?;
            // SAFETY: the caller's promise.
            let fence: direct3d::ID3D12Fence = unsafe { com_object(*fence, "recording.fence") }?;
            Some((list, FencePoint::of_engine(gpu, &fence, *value)?))
        }
    };
    // SAFETY: the caller's promise.
    let texture: direct3d::ID3D12Resource = unsafe { com_object(to.texture, "target") }?;
    let [before, after] = [to.before, to.after].map(|state| direct3d::D3D12_RESOURCE_STATES(state.cast_signed()));
    let target = Target { texture, before, after };
    let rendered = match &list {
        Some((list, until)) => renderer.record(presenter, gpu, now, list, until, target)?,
        None => renderer.submit(presenter, gpu, now, target)?,
    };
    Ok(match rendered {
        RenderResult::NotReady => FrameResult::NotReady,
        RenderResult::QueueFull => FrameResult::QueueFull,
        RenderResult::Frame(info, fence_point) => FrameResult::Frame(info, fence_point.as_ref().map(fence_value)),
    })
}

/// Statistics of frames on the device; `None` if the call is nested in one that records.
pub(in crate::abi) fn statistics(
    renderer: &Renderer,
    presenter: &Presenter,
    is_nested: bool,
) -> Option<FrameStatistics> {
    let statistics = match is_nested {
        true => renderer.try_statistics(presenter)?,
        false => renderer.statistics(presenter),
    };
    Some(FrameStatistics {
        in_flight: statistics.in_flight as u32,
        lists_pending: statistics.lists_pending as u32,
        frames: statistics.frames,
        lists: statistics.anchors,
        generator: statistics.generator,
        upscaler: statistics.upscaler,
    })
}

/// Waits until all frames have run, and releases their targets.
pub(in crate::abi) fn release(renderer: &Renderer) -> AbiResult<()> {
    Ok(renderer.release()?)
}

/// A fence point as the engine waits for it, with an added reference.
fn fence_value(fence_point: &FencePoint) -> FenceValue {
    FenceValue { fence: fence_point.fence().clone().into_raw(), value: fence_point.value() }
}

/// Casts a COM object to the interface `I`; a null pointer is an error.
///
/// # Safety
/// The pointer is null or a COM object that lives during the call.
pub(in crate::abi) unsafe fn com_object<I: Interface>(pointer: *mut c_void, name: &str) -> AbiResult<I> {
    // SAFETY: the caller's promise; every interface of COM starts with IUnknown, and no reference is taken.
    let unknown = unsafe { IUnknown::from_raw_borrowed(&pointer) };
    let cast = unknown.and_then(|unknown| unknown.cast().ok());
    cast.ok_or_else(|| Failure::argument(name, "it is an object of another kind"))
}
