//! Direct3D 12 entry points on Windows.

mod adapters;

use std::ffi::c_void;
use std::time::Duration;

use windows::Win32::Graphics::Direct3D12 as direct3d;
use windows::Win32::Graphics::Dxgi::Common as Dxgi;
use windows::core::{IUnknown, Interface};

use super::super::device::{CAIRN_DEVICE_D3D12, DeviceOptions};
use super::super::presenter::{CAIRN_PREFER_NEVER, CAIRN_PREFER_REQUIRE, cairn_presenter_options};
use super::super::requirements::*;
use super::super::results::{Failure, Outcome};
use super::super::text::fixed_text;
use super::{
    CAIRN_D3D12_DETERMINISTIC, CAIRN_PREPARE_SUBMIT_ONLY, DeviceStatistics, DeviceTimes, Guard, Guarded,
    ID3D12CommandQueue, ID3D12Device, ID3D12Resource, Recorded, RolloutStatistics, To, cairn_d3d12_options,
    cairn_d3d12_preparation,
};
use crate::ffx::{self, Needed};
use crate::framegen::shader::ShaderGenerator;
use crate::gpu::compute::Spent;
use crate::gpu::{FencePoint, Gpu, Target, read_texture};
use crate::present::d3d12::{self, PipelineCallbacks, Preference, PrepareOptions, Rendered, RendererOptions};
use crate::present::presenter::Presenter;
use crate::runtime::{Device, DirectMlOptions, Ort};
use crate::world::{KeptAnchor, WorkerStatistics};
use crate::{Colours, Picture};
use adapters::loaded_pipelines;
pub(in crate::abi) use adapters::{list, requirements};

/// A device made from an engine's objects.
///
/// # Safety
/// Pointers that are not null are COM objects that live during the call.
pub(in crate::abi) unsafe fn of_engine(
    d3d12: *mut ID3D12Device,
    queue: *mut ID3D12CommandQueue,
    anchors: *mut ID3D12CommandQueue,
    options: DeviceOptions,
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
    Ok(running(&Gpu::of_engine(&device, &queue, anchors.as_ref())?, options)?.0)
}

/// A device of the library's own.
pub(in crate::abi) fn on_adapter(luid: u64, options: DeviceOptions) -> Outcome<Device> {
    Ok(running(&Gpu::on_adapter(Some(luid))?, options)?.0)
}

/// The runtime device on a Direct3D device, and the ONNX Runtime it uses.
fn running(gpu: &Gpu, options: DeviceOptions) -> crate::Result<(Device, Ort)> {
    let ort = Ort::find(&options.libraries)?;
    let directml = DirectMlOptions { deterministic: options.cpu.deterministic, ..DirectMlOptions::default() };
    let device = Device::directml(&ort, gpu, directml)?;
    Ok((device.with_library_search(options.libraries), ort))
}

/// The Direct3D device and queue, each with an added reference; `None` for a CPU device.
pub(in crate::abi) fn parts(device: &Device) -> Option<(*mut ID3D12Device, *mut ID3D12CommandQueue)> {
    let gpu = device.gpu()?;
    Some((gpu.device().clone().into_raw().cast(), gpu.frames().d3d12().clone().into_raw().cast()))
}

/// Sets the options for worlds loaded from now on.
pub(in crate::abi) fn set_options(device: &Device, options: &cairn_d3d12_options) -> Outcome<()> {
    let longest = Some(options.longest_submission_us).filter(|microseconds| *microseconds > 0);
    let options = DirectMlOptions {
        deterministic: options.flags & CAIRN_D3D12_DETERMINISTIC != 0,
        captured_passes: options.captured_passes as usize,
        longest_submission: longest.map(|microseconds| Duration::from_micros(microseconds.into())),
        ..DirectMlOptions::default()
    };
    Ok(device.set_directml_options(options)?)
}

/// Statistics of a rollout on the device; zeroes on any other than a Direct3D 12 device.
pub(in crate::abi) fn rollout_statistics(statistics: &WorkerStatistics) -> RolloutStatistics {
    let Some((took, captured)) = &statistics.device else { return RolloutStatistics::default() };
    RolloutStatistics {
        passes: times(took.passes),
        decodes: times(took.decode),
        commits: times(took.commit),
        inside: took.external.inside,
        waited: took.external.waited,
        yields: took.external.yields,
        captured: captured.used,
        others: captured.unproven + captured.unused,
    }
}

/// Reads the contents of a texture in state `state`.
///
/// # Safety
/// Pointers that are not null are COM objects that live during the call.
pub(in crate::abi) unsafe fn read(device: &Device, texture: *mut ID3D12Resource, state: u32) -> Outcome<Picture> {
    let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
    // SAFETY: the caller's promise.
    let texture: direct3d::ID3D12Resource = unsafe { object(texture.cast(), "picture") }?;
    let state = direct3d::D3D12_RESOURCE_STATES(state.cast_signed());
    Ok(read_texture(gpu, &texture, state)?)
}

/// A picture of an anchor on the device that made it.
pub(in crate::abi) fn texture(anchor: &KeptAnchor, index: u32) -> Outcome<Guarded> {
    let (texture, fence_point) = anchor.texture(index as usize).ok_or_else(Failure::no_d3d12)?;
    Ok((texture.clone().into_raw().cast(), fence_point.fence().clone().into_raw().cast(), fence_point.value()))
}

/// Whether frames can be made by shaders.
pub(in crate::abi) const HAS_SHADERS: bool = true;

/// Renderer of a presenter's frames.
pub(in crate::abi) type Renderer = d3d12::Renderer;

/// A renderer for a presenter's options, which were checked.
pub(in crate::abi) fn renderer(options: &cairn_presenter_options, colours: Colours) -> Renderer {
    let [fsr, shader, upscaler] = [options.fsr, options.shader, options.upscaler].map(|preference| match preference {
        CAIRN_PREFER_REQUIRE => Preference::Require,
        CAIRN_PREFER_NEVER => Preference::Never,
        _ => Preference::Auto,
    });
    Renderer::new(RendererOptions { colours, fsr, shader, upscaler })
}

/// Makes everything that frames need; false if the anchors' size is not known yet.
pub(in crate::abi) fn prepare(
    renderer: &Renderer,
    presenter: &Presenter,
    device: &Device,
    wanted: &cairn_d3d12_preparation,
) -> Outcome<bool> {
    let given = |size: (u32, u32)| (size != (0, 0)).then_some(size);
    let options = PrepareOptions {
        size: given((wanted.width, wanted.height)),
        anchor_size: given((wanted.anchor_width, wanted.anchor_height)),
        format: Dxgi::DXGI_FORMAT(wanted.format.cast_signed()),
        lists: match wanted.lists {
            _ if wanted.flags & CAIRN_PREPARE_SUBMIT_ONLY != 0 => 0,
            0 => PrepareOptions::default().lists,
            lists => lists as usize,
        },
        pictures: wanted.anchor_pictures as usize,
        latent: [wanted.latent_channels, wanted.latent_height, wanted.latent_width],
    };
    let user = wanted.user;
    let mut load = wanted.load.map(|load| move || loaded_pipelines(load, user));
    let mut store = wanted.store.map(|store| {
        // SAFETY: a function of the host's; the bytes live during the call.
        move |bytes: &[u8]| unsafe { store(bytes.as_ptr().cast(), bytes.len() as u64, user) }
    });
    let callbacks = PipelineCallbacks {
        load: load.as_mut().map(|load| load as &mut dyn FnMut() -> Option<Vec<u8>>),
        store: store.as_mut().map(|store| store as &mut dyn FnMut(&[u8])),
    };
    Ok(renderer.prepare(presenter, device, &options, callbacks)?)
}

/// Records the frame due at `now`, or submits it where no list is given and then also returns the fence point that guards the target.
///
/// # Safety
/// Pointers in `to` are COM objects that live during the call.
pub(in crate::abi) unsafe fn record(
    renderer: &Renderer,
    presenter: &Presenter,
    device: &Device,
    now: u64,
    to: &To,
) -> Outcome<Recorded> {
    let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
    let list = match &to.list {
        None => None,
        Some((list, Guard { fence, value })) => {
            // SAFETY: the caller's promise.
            let list: direct3d::ID3D12GraphicsCommandList = unsafe { object(list.cast(), "recording.list") }?;
            // SAFETY: the caller's promise.
            let fence: direct3d::ID3D12Fence = unsafe { object(fence.cast(), "recording.fence") }?;
            Some((list, FencePoint::of_engine(gpu, &fence, *value)?))
        }
    };
    // SAFETY: the caller's promise.
    let texture: direct3d::ID3D12Resource = unsafe { object(to.target.cast(), "target") }?;
    let [before, after] = [to.before, to.after].map(|state| direct3d::D3D12_RESOURCE_STATES(state.cast_signed()));
    let target = Target { texture, before, after };
    let rendered = match &list {
        Some((list, until)) => renderer.record(presenter, gpu, now, list, until, target)?,
        None => renderer.submit(presenter, gpu, now, target)?,
    };
    Ok(match rendered {
        Rendered::NotReady => Recorded::NotReady,
        Rendered::QueueFull => Recorded::QueueFull,
        Rendered::Frame(shown, at) => Recorded::Frame(shown, at.as_ref().map(guard)),
    })
}

/// Statistics of frames on the device; `None` if the call is nested in one that records.
pub(in crate::abi) fn statistics(
    renderer: &Renderer,
    presenter: &Presenter,
    is_nested: bool,
) -> Option<DeviceStatistics> {
    let done = match is_nested {
        true => renderer.try_statistics(presenter)?,
        false => renderer.statistics(presenter),
    };
    Some(DeviceStatistics {
        under_way: done.in_flight as u32,
        lists_pending: done.lists_pending as u32,
        frames: times(done.frames),
        lists: times(done.anchors),
        generator: done.generator,
        upscaler: done.upscaler,
    })
}

/// Waits until all frames have run, and releases their targets.
pub(in crate::abi) fn release(renderer: &Renderer) -> Outcome<()> {
    Ok(renderer.release()?)
}

fn times(spent: Spent) -> DeviceTimes {
    let Spent { frames: count, total, longest, last } = spent;
    DeviceTimes { count, total, longest, last }
}

/// A fence point as the engine waits for it, with an added reference.
fn guard(fence_point: &FencePoint) -> Guard {
    Guard { fence: fence_point.fence().clone().into_raw().cast(), value: fence_point.value() }
}

/// The interface `I` of a COM object that is not null.
///
/// # Safety
/// The pointer is a COM object that lives during the call.
pub(in crate::abi) unsafe fn object<I: Interface>(pointer: *mut c_void, name: &str) -> Outcome<I> {
    // SAFETY: the caller's promise; every interface of COM starts with IUnknown, and no reference is taken.
    let unknown = unsafe { IUnknown::from_raw_borrowed(&pointer) };
    let cast = unknown.and_then(|unknown| unknown.cast().ok());
    cast.ok_or_else(|| Failure::argument(name, "it is an object of another kind"))
}
