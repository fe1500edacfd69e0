//! Platforms without Direct3D 12: nothing is drawn.

use std::ffi::c_void;

use crate::interfaces::Direct3d12;
use crate::views::{EventResult, View};

/// Never exists on this platform.
pub(crate) enum Drawing {}

/// A texture of Unity's. Never exists on this platform.
#[derive(Clone)]
pub(crate) enum Target {}

impl Target {
    /// # Safety
    /// None: no pointer is read.
    pub(crate) unsafe fn of_unity(_: *mut c_void) -> Option<Self> {
        None
    }
}

/// Ring of textures for a view's frames. Empty on this platform.
#[derive(Default)]
pub(crate) struct TargetRing;

impl TargetRing {
    pub(crate) fn release(&mut self) {}
}

impl Drawing {
    pub(crate) fn new(_: Direct3d12) -> Result<Self, String> {
        Err("this library has no Direct3D 12 in it: Cairn for Unity needs Windows".to_owned())
    }

    pub(crate) fn version(&self) -> u32 {
        match *self {}
    }

    /// Device and queue, without adding a reference.
    pub(crate) fn parts(&self) -> (*mut c_void, *mut c_void) {
        match *self {}
    }

    pub(crate) fn make(&self, _: &View) -> EventResult {
        match *self {}
    }

    pub(crate) fn show(&self, _: &View) -> EventResult {
        match *self {}
    }

    pub(crate) fn release_finished(&self) {
        match *self {}
    }

    pub(crate) fn finish(&self) {
        match *self {}
    }
}

/// Path of this library's file. Only Windows asks for it.
pub(crate) fn own_path() -> Option<String> {
    None
}
