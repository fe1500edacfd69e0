//! Structs that all effects share.

use std::ffi::{c_char, c_void};

use super::{ResourceFlags, ResourceState, ResourceType, ResourceUsage, SurfaceFormat};
use super::{ReturnCode, StructId, ffx_struct, plain};
use crate::ffx::Header;

/// A context's handle; calls get its address.
pub type RawContext = *mut c_void;

/// `ffxCreateContext`.
pub type CreateContext =
    unsafe extern "C-unwind" fn(*mut RawContext, *mut Header, *const AllocationCallbacks) -> ReturnCode;
/// `ffxDestroyContext`.
pub type DestroyContext = unsafe extern "C-unwind" fn(*mut RawContext, *const AllocationCallbacks) -> ReturnCode;
/// `ffxConfigure`; the context may be null.
pub type Configure = unsafe extern "C-unwind" fn(*mut RawContext, *const Header) -> ReturnCode;
/// `ffxQuery`; the context may be null.
pub type Query = unsafe extern "C-unwind" fn(*mut RawContext, *mut Header) -> ReturnCode;
/// `ffxDispatch`.
pub type Dispatch = unsafe extern "C-unwind" fn(*mut RawContext, *const Header) -> ReturnCode;

/// Receives a message: 0 for an error or 1 for a warning, and NUL-terminated UTF-16 text, as on Windows.
pub type MessageCallback = unsafe extern "C" fn(u32, *const u16);

plain! {
    /// The host's allocator; a null pointer to it means malloc and free.
    AllocationCallbacks, 24 align 8: {
        /// User data of both functions.
        0 8 user: *mut c_void,
        /// Takes the user data and a number of bytes.
        8 8 alloc: Option<unsafe extern "C" fn(*mut c_void, u64) -> *mut c_void>,
        /// Takes the user data and a pointer from `alloc`.
        16 8 dealloc: Option<unsafe extern "C" fn(*mut c_void, *mut c_void)>,
    }
}

plain! {
    /// A size in pixels.
    Dimensions, 8 align 4: {
        /// Width.
        0 4 width: u32,
        /// Height.
        4 4 height: u32,
    }
}

impl Dimensions {
    /// Why Direct3D 12 cannot create a texture of this size, if so.
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
        /// Points right.
        0 4 x: f32,
        /// Points down.
        4 4 y: f32,
    }
}

plain! {
    /// A rectangle of a picture, in pixels.
    Rect, 16 align 4: {
        /// The first column.
        0 4 left: i32,
        /// The first row.
        4 4 top: i32,
        /// Number of columns.
        8 4 width: i32,
        /// Number of rows.
        12 4 height: i32,
    }
}

impl Rect {
    /// Why it is no valid part of a picture of that size, if so.
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
    /// Description of a resource. Providers do not check it.
    ResourceDescription, 32 align 4: {
        /// Kind of resource.
        0 4 kind: ResourceType,
        /// Pixel format.
        4 4 format: SurfaceFormat,
        /// Pixels, or bytes of a buffer.
        8 4 width: u32,
        /// Pixels, or the stride of a buffer.
        12 4 height: u32,
        /// Pixels, elements of an array, or the alignment of a buffer.
        16 4 depth: u32,
        /// Mip levels; 0 for all.
        20 4 mips: u32,
        /// Flags of its memory.
        24 4 flags: ResourceFlags,
        /// Possible uses.
        28 4 usage: ResourceUsage,
    }
}

plain! {
    /// A resource argument of a call; null for none.
    Resource, 48 align 8: {
        /// `ID3D12Resource`.
        0 8 resource: *mut c_void,
        /// Its description.
        8 32 description: ResourceDescription,
        /// Its state when the list reaches the call, and again afterwards.
        40 4 state: ResourceState,
    }
}

impl Resource {
    /// Why it is no valid picture of that size, if so.
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
        /// Total.
        0 8 total: u64,
        /// The part that could be aliased with other resources.
        8 8 aliasable: u64,
    }
}

ffx_struct! {
    /// The device of a new context.
    CreateBackendDx12 = BACKEND_DX12, 24: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
    }
}

ffx_struct! {
    /// Queries the available providers, without a context.
    QueryVersions = GET_VERSIONS, 56: {
        /// The struct that would create the context.
        16 8 create: StructId,
        /// `ID3D12Device`.
        24 8 device: *mut c_void,
        /// In: capacity of the lists; out: number of entries written.
        32 8 count: *mut u64,
        /// Receives ids for [`OverrideVersion`].
        40 8 ids: *mut u64,
        /// Receives names, which may be freed at the next call.
        48 8 names: *mut *const c_char,
    }
}

ffx_struct! {
    /// Requests a provider.
    OverrideVersion = OVERRIDE_VERSION, 24: {
        /// An id from [`QueryVersions`] in this process.
        16 8 version_id: u64,
    }
}

ffx_struct! {
    /// Queries a context's provider. SDK 1.1.4 and later.
    QueryProviderVersion = GET_PROVIDER_VERSION, 32: {
        /// Out: 0 for none.
        16 8 version_id: u64,
        /// Out: its name.
        24 8 version_name: *const c_char,
    }
}

ffx_struct! {
    /// Sets the message callback of all effects.
    ConfigureGlobalDebug1 = GLOBAL_DEBUG_1, 32: {
        /// The callback.
        16 8 message: Option<MessageCallback>,
        /// 0: none, 1: errors, 2: warnings too, 0x0fff_ffff: all.
        24 4 level: u32,
    }
}

ffx_struct! {
    /// Sets the message callback of one effect. SDK 2.3 and later.
    ConfigureGlobalDebug = GLOBAL_DEBUG, 40: {
        /// The effect, of [`EffectId`](super::EffectId).
        16 8 effect: super::EffectId,
        /// The callback.
        24 8 message: Option<MessageCallback>,
        /// As in [`ConfigureGlobalDebug1`].
        32 4 level: u32,
    }
}
