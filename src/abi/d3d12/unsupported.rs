//! Direct3D 12 backend of systems without it: every function fails or returns nothing.

use std::ffi::c_void;

use super::super::device::DeviceOptions;
use super::super::requirements::{
    CAIRN_REQUIREMENT_NOT_MET, CAIRN_REQUIREMENT_PLATFORM, cairn_adapter, cairn_requirement, platform, row,
};
use super::super::results::{AbiResult, Failure};
use super::types::{
    AnchorTexture, FramePreparation, FrameResult, FrameStatistics, FrameTarget, RolloutStatistics, WorldOptions,
};
use crate::Picture;
use crate::present::RendererOptions;
use crate::present::presenter::Presenter;
use crate::runtime::Device;
use crate::world::{KeptAnchor, WorkerStatistics};

/// # Safety
/// None.
pub(in crate::abi) unsafe fn of_engine(
    _: *mut c_void,
    _: *mut c_void,
    _: *mut c_void,
    _: DeviceOptions,
) -> AbiResult<Device> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn on_adapter(_: u64, _: DeviceOptions) -> AbiResult<Device> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn device_and_queue(_: &Device) -> Option<(*mut c_void, *mut c_void)> {
    None
}

pub(in crate::abi) fn set_options(_: &Device, _: &WorldOptions) -> AbiResult<()> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn rollout_statistics(_: &WorkerStatistics) -> RolloutStatistics {
    RolloutStatistics::default()
}

/// # Safety
/// None.
pub(in crate::abi) unsafe fn read_texture(_: &Device, _: *mut c_void, _: u32) -> AbiResult<Picture> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn anchor_texture(_: &KeptAnchor, _: u32) -> AbiResult<AnchorTexture> {
    Err(Failure::no_d3d12())
}

/// Whether frames can be made by shaders.
pub(in crate::abi) const HAS_SHADERS: bool = false;

/// Placeholder for the renderer: it makes no frames.
pub(in crate::abi) struct Renderer;

pub(in crate::abi) fn renderer(_: RendererOptions) -> Renderer {
    Renderer
}

pub(in crate::abi) fn prepare(_: &Renderer, _: &Presenter, _: &Device, _: &FramePreparation) -> AbiResult<bool> {
    Err(Failure::no_d3d12())
}

/// # Safety
/// None.
pub(in crate::abi) unsafe fn record(
    _: &Renderer,
    _: &Presenter,
    _: &Device,
    _: u64,
    _: &FrameTarget,
) -> AbiResult<FrameResult> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn statistics(_: &Renderer, _: &Presenter, _: bool) -> Option<FrameStatistics> {
    Some(FrameStatistics::default())
}

pub(in crate::abi) fn release(_: &Renderer) -> AbiResult<()> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn adapters() -> Vec<cairn_adapter> {
    Vec::new()
}

pub(in crate::abi) fn requirements(_: DeviceOptions) -> Vec<cairn_requirement> {
    let needed = "Windows, and a build of this library with Direct3D 12";
    let found = format!("{}: {}", platform(), Failure::no_d3d12());
    vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_NOT_MET, needed, &found)]
}
