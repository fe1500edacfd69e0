//! What stands behind the doors of Direct3D 12 where it is not there.

use std::path::Path;

use super::super::requirements::{
    CAIRN_REQUIREMENT_NOT_MET, CAIRN_REQUIREMENT_PLATFORM, cairn_adapter, cairn_requirement, platform, row,
};
use super::super::results::{Failure, Outcome};
use super::{Guarded, ID3D12CommandQueue, ID3D12Device, ID3D12Resource, To};
use crate::Picture;
use crate::runtime::Device;
use crate::world::KeptAnchor;

/// # Safety
/// Nothing is asked for.
pub(in crate::abi) unsafe fn of_engine(
    _: *mut ID3D12Device,
    _: *mut ID3D12CommandQueue,
    _: *mut ID3D12CommandQueue,
) -> Outcome<Device> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn on_adapter(_: u64) -> Outcome<Device> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn parts(_: &Device) -> Option<(*mut ID3D12Device, *mut ID3D12CommandQueue)> {
    None
}

/// # Safety
/// Nothing is asked for.
pub(in crate::abi) unsafe fn read(_: &Device, _: *mut ID3D12Resource, _: u32) -> Outcome<Picture> {
    Err(Failure::no_d3d12())
}

pub(in crate::abi) fn texture(_: &KeptAnchor, _: u32) -> Outcome<Guarded> {
    Err(Failure::no_d3d12())
}

/// What frames are recorded with: nothing.
#[derive(Default)]
pub(in crate::abi) struct Recording;

/// A place for a frame, which there never is.
pub(in crate::abi) enum Place {}

impl Recording {
    /// # Safety
    /// Nothing is asked for.
    pub(in crate::abi) unsafe fn place(&mut self, _: &Device, _: &To, _: (u32, u32), _: bool) -> Outcome<Place> {
        Err(Failure::no_d3d12())
    }
}

impl Place {
    pub(in crate::abi) fn fill(self, _: &Picture) -> Outcome<()> {
        match self {}
    }
}

pub(in crate::abi) fn list() -> Vec<cairn_adapter> {
    Vec::new()
}

pub(in crate::abi) fn requirements(_: Option<&Path>) -> Vec<cairn_requirement> {
    let needed = "Windows, and a build of this library with Direct3D 12";
    let found = format!("{}: {}", platform(), Failure::no_d3d12());
    vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_NOT_MET, needed, &found)]
}
