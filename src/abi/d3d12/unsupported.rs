//! Direct3D 12 entry points on systems without it.

use super::super::device::DeviceOptions;
use super::super::presenter::cairn_presenter_options;
use super::super::requirements::{
    CAIRN_REQUIREMENT_NOT_MET, CAIRN_REQUIREMENT_PLATFORM, cairn_adapter, cairn_requirement, platform, row,
};
use super::super::results::{Failure, Outcome};
use super::{
    DeviceStatistics, Guarded, ID3D12CommandQueue, ID3D12Device, ID3D12Resource, Recorded, RolloutStatistics, To,
    cairn_d3d12_options, cairn_d3d12_preparation,
};
use crate::present::presenter::Presenter;
use crate::runtime::Device;
use crate::world::{KeptAnchor, WorkerStatistics};
use crate::{Colours, Picture};

/// # Safety
/// None.
pub(in crate::abi) unsafe fn of_engine(
    _: *mut ID3D12Device,
    _: *mut ID3D12CommandQueue,
    _: *mut ID3D12CommandQueue,
    _: DeviceOptions,
) -> Outcome<Device> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn on_adapter(_: u64, _: DeviceOptions) -> Outcome<Device> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn parts(_: &Device) -> Option<(*mut ID3D12Device, *mut ID3D12CommandQueue)> {
    None
}

pub(in crate::abi) fn set_options(_: &Device, _: &cairn_d3d12_options) -> Outcome<()> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn rollout_statistics(_: &WorkerStatistics) -> RolloutStatistics {
    RolloutStatistics::default()
}

/// # Safety
/// None.
pub(in crate::abi) unsafe fn read(_: &Device, _: *mut ID3D12Resource, _: u32) -> Outcome<Picture> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn texture(_: &KeptAnchor, _: u32) -> Outcome<Guarded> {
    Err(Failure::no_d3d12())
}

/// Whether frames can be made by shaders.
pub(in crate::abi) const HAS_SHADERS: bool = false;

/// Stands in for the renderer; it cannot be made.
pub(in crate::abi) struct Renderer;

pub(in crate::abi) fn renderer(_: &cairn_presenter_options, _: Colours) -> Renderer {
    Renderer
}

pub(in crate::abi) fn prepare(_: &Renderer, _: &Presenter, _: &Device, _: &cairn_d3d12_preparation) -> Outcome<bool> {
    Err(Failure::no_d3d12())
}

/// # Safety
/// None.
pub(in crate::abi) unsafe fn record(_: &Renderer, _: &Presenter, _: &Device, _: u64, _: &To) -> Outcome<Recorded> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn statistics(_: &Renderer, _: &Presenter, _: bool) -> Option<DeviceStatistics> {
    Some(DeviceStatistics::default())
}

pub(in crate::abi) fn release(_: &Renderer) -> Outcome<()> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn list() -> Vec<cairn_adapter> {
    Vec::new()
}

pub(in crate::abi) fn requirements(_: DeviceOptions) -> Vec<cairn_requirement> {
    let needed = "Windows, and a build of this library with Direct3D 12";
    let found = format!("{}: {}", platform(), Failure::no_d3d12());
    vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_NOT_MET, needed, &found)]
}
