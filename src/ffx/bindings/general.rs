//! What all effects share.

use std::ffi::{c_char, c_void};

use super::{ResourceFlags, ResourceState, ResourceType, ResourceUsage, SurfaceFormat};
use super::{ReturnCode, StructId, described, plain};
use crate::ffx::Header;

/// A context, which every call gets the address of.
pub type RawContext = *mut c_void;

/// `ffxCreateContext`.
pub type CreateContext = unsafe extern "C" fn(*mut RawContext, *mut Header, *const AllocationCallbacks) -> ReturnCode;
/// `ffxDestroyContext`.
pub type DestroyContext = unsafe extern "C" fn(*mut RawContext, *const AllocationCallbacks) -> ReturnCode;
/// `ffxConfigure`; the context may be null.
pub type Configure = unsafe extern "C" fn(*mut RawContext, *const Header) -> ReturnCode;
/// `ffxQuery`; the context may be null.
pub type Query = unsafe extern "C" fn(*mut RawContext, *mut Header) -> ReturnCode;
/// `ffxDispatch`.
pub type Dispatch = unsafe extern "C" fn(*mut RawContext, *const Header) -> ReturnCode;

/// Gets a message: 0 for an error or 1 for a warning, and text that ends with a zero, in UTF-16 as on Windows.
pub type MessageCallback = unsafe extern "C" fn(u32, *const u16);

plain! {
    /// Where memory comes from; a null pointer to it means malloc and free.
    AllocationCallbacks, 24 align 8: {
        /// Given to both.
        0 8 user: *mut c_void,
        /// Gets the user pointer and a number of bytes.
        8 8 alloc: Option<unsafe extern "C" fn(*mut c_void, u64) -> *mut c_void>,
        /// Gets the user pointer and what `alloc` gave.
        16 8 dealloc: Option<unsafe extern "C" fn(*mut c_void, *mut c_void)>,
    }
}

plain! {
    /// A size in pixels.
    Dimensions, 8 align 4: {
        /// From left to right.
        0 4 width: u32,
        /// From top to bottom.
        4 4 height: u32,
    }
}

impl Dimensions {
    /// What Direct3D 12 makes no texture for.
    pub(in crate::ffx) fn fault(self) -> Option<&'static str> {
        const LARGEST: u32 = 16384;
        match (self.width.min(self.height), self.width.max(self.height)) {
            (0, _) => Some("a size must be above 0"),
            (_, side) if side > LARGEST => Some("a side must be no longer than 16384"),
            _ => None,
        }
    }
}

plain! {
    /// Two coordinates.
    Coordinates, 8 align 4: {
        /// To the right.
        0 4 x: f32,
        /// Down.
        4 4 y: f32,
    }
}

plain! {
    /// A part of a picture, in pixels.
    Rect, 16 align 4: {
        /// The first column.
        0 4 left: i32,
        /// The first row.
        4 4 top: i32,
        /// Columns.
        8 4 width: i32,
        /// Rows.
        12 4 height: i32,
    }
}

impl Rect {
    /// What is wrong with it as a part of a picture of that size.
    pub(in crate::ffx) fn fault(self, whole: Dimensions) -> Option<&'static str> {
        let Self { left, top, width, height } = self;
        if left < 0 || top < 0 || width < 0 || height < 0 {
            return Some("it must not be negative");
        }
        if (width == 0) != (height == 0) {
            return Some("it must have both sides, or neither");
        }
        let end = |start: i32, length: i32| i64::from(start) + i64::from(length);
        let leaves = end(left, width) > whole.width.into() || end(top, height) > whole.height.into();
        leaves.then_some("it must lie in the picture")
    }
}

plain! {
    /// What a resource is. Providers trust it.
    ResourceDescription, 32 align 4: {
        /// Its shape.
        0 4 kind: ResourceType,
        /// Of a pixel.
        4 4 format: SurfaceFormat,
        /// Pixels, or bytes of a buffer.
        8 4 width: u32,
        /// Pixels, or the stride of a buffer.
        12 4 height: u32,
        /// Pixels, elements of an array, or the alignment of a buffer.
        16 4 depth: u32,
        /// Levels; 0 for all.
        20 4 mips: u32,
        /// What it may be.
        24 4 flags: ResourceFlags,
        /// What it can be used as.
        28 4 usage: ResourceUsage,
    }
}

plain! {
    /// A resource as a call is given it; with null there is none.
    Resource, 48 align 8: {
        /// `ID3D12Resource`.
        0 8 resource: *mut c_void,
        /// What it is.
        8 32 description: ResourceDescription,
        /// The state it is in when the list gets to the call, and in again afterwards.
        40 4 state: ResourceState,
    }
}

impl Resource {
    /// What is wrong with it as a picture of that size.
    pub(in crate::ffx) fn fault(&self, size: Dimensions) -> Option<&'static str> {
        let Self { resource, description, state, .. } = self;
        if resource.is_null() {
            return Some("there is no resource");
        }
        if description.kind != ResourceType::TEXTURE_2D || description.depth > 1 {
            return Some("it is no single picture");
        }
        if (description.width, description.height) != (size.width, size.height) {
            return Some("it is of another size");
        }
        if description.format == SurfaceFormat::UNKNOWN {
            return Some("ffx-api has not its format");
        }
        state.to_d3d12().is_none().then_some("it is in a state that ffx-api has not")
    }
}

plain! {
    /// Bytes of device memory.
    MemoryUsage, 16 align 8: {
        /// In all.
        0 8 total: u64,
        /// Of these, what could be shared with others.
        8 8 aliasable: u64,
    }
}

described! {
    /// The device that a context is made on.
    CreateBackendDx12 = BACKEND_DX12, 24: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
    }
}

described! {
    /// Asks which providers there are, with no context.
    QueryVersions = GET_VERSIONS, 56: {
        /// The struct that a context would be made with.
        16 8 create: StructId,
        /// `ID3D12Device`.
        24 8 device: *mut c_void,
        /// In: how many there is room for; out: how many were written.
        32 8 count: *mut u64,
        /// Gets what [`OverrideVersion`] takes.
        40 8 ids: *mut u64,
        /// Gets names, which may be gone after the next call.
        48 8 names: *mut *const c_char,
    }
}

described! {
    /// Which provider it is to be.
    OverrideVersion = OVERRIDE_VERSION, 24: {
        /// As [`QueryVersions`] gave it in this process.
        16 8 version_id: u64,
    }
}

described! {
    /// Asks which provider a context has. SDK 1.1.4 and later.
    QueryProviderVersion = GET_PROVIDER_VERSION, 32: {
        /// Out: 0 for none.
        16 8 version_id: u64,
        /// Out: its name.
        24 8 version_name: *const c_char,
    }
}

described! {
    /// Where messages go, of every effect.
    ConfigureGlobalDebug1 = GLOBAL_DEBUG_1, 32: {
        /// Gets them.
        16 8 message: Option<MessageCallback>,
        /// 0: none, 1: errors, 2: warnings too, 0x0fff_ffff: all.
        24 4 level: u32,
    }
}

described! {
    /// Where messages of one effect go. SDK 2.1 and later.
    ConfigureGlobalDebug = GLOBAL_DEBUG, 40: {
        /// The effect, of [`EffectId`](super::EffectId).
        16 8 effect: super::EffectId,
        /// Gets them.
        24 8 message: Option<MessageCallback>,
        /// As of [`ConfigureGlobalDebug1`].
        32 4 level: u32,
    }
}
