//! What stands behind the doors of Direct3D 12 where it is not there.

use parking_lot::Mutex;

use super::super::device::DeviceOptions;
use super::super::presenter::RenderRequest;
use super::super::requirements::{
    CAIRN_REQUIREMENT_NOT_MET, CAIRN_REQUIREMENT_PLATFORM, cairn_adapter, cairn_requirement, platform, row,
};
use super::super::results::{Failure, Outcome};
use super::{
    DeviceFigures, Guarded, ID3D12CommandQueue, ID3D12Device, ID3D12Resource, Recorded, RolloutFigures, To,
    cairn_d3d12_options, cairn_d3d12_preparation,
};
use crate::Picture;
use crate::present::presenter::Presenter;
use crate::runtime::Device;
use crate::world::{KeptAnchor, Rollout};

/// # Safety
/// Nothing is asked for.
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

pub(in crate::abi) fn rollout_figures(_: &mut Rollout) -> RolloutFigures {
    RolloutFigures::default()
}

/// # Safety
/// Nothing is asked for.
pub(in crate::abi) unsafe fn read(_: &Device, _: *mut ID3D12Resource, _: u32) -> Outcome<Picture> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn texture(_: &KeptAnchor, _: u32) -> Outcome<Guarded> {
    Err(Failure::no_d3d12())
}

/// Whether frames can be made by shaders.
pub(in crate::abi) const HAS_SHADERS: bool = false;

/// AMD's libraries: none.
#[derive(Default)]
pub(in crate::abi) struct Amd;

/// All that frames need: there is no such thing.
pub(in crate::abi) enum Prepared {}

impl Prepared {
    pub(in crate::abi) fn new(
        _: &RenderRequest<'_>,
        _: &Device,
        _: &cairn_d3d12_preparation,
        _: &mut Amd,
    ) -> Outcome<Option<Self>> {
        Err(Failure::no_d3d12())
    }
}

pub(in crate::abi) fn put(_: &Mutex<Recording>, _: Option<Prepared>) -> bool {
    false
}

/// What frames are recorded with: nothing.
#[derive(Default)]
pub(in crate::abi) struct Recording;

impl Recording {
    /// # Safety
    /// Nothing is asked for.
    pub(in crate::abi) unsafe fn record(
        &mut self,
        _: &RenderRequest<'_>,
        _: &Device,
        _: u64,
        _: &To,
    ) -> Outcome<Recorded> {
        Err(Failure::no_d3d12())
    }

    pub(in crate::abi) fn release(&mut self) -> Outcome<()> {
        Err(Failure::no_d3d12())
    }

    pub(in crate::abi) fn figures(&mut self) -> DeviceFigures {
        DeviceFigures::default()
    }

    pub(in crate::abi) fn scaled_by(&mut self) -> Option<(String, String)> {
        None
    }

    pub(in crate::abi) fn used(&mut self, _: &Presenter) -> Option<(Option<String>, String)> {
        None
    }
}

pub(in crate::abi) fn list() -> Vec<cairn_adapter> {
    Vec::new()
}

pub(in crate::abi) fn requirements(_: DeviceOptions) -> Vec<cairn_requirement> {
    let needed = "Windows, and a build of this library with Direct3D 12";
    let found = format!("{}: {}", platform(), Failure::no_d3d12());
    vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_NOT_MET, needed, &found)]
}
