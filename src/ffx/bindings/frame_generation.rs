//! Frame generation.

use std::ffi::c_void;

use super::{Coordinates, Dimensions, MemoryUsage, Rect, Resource, ffx_struct};
use super::{CreateFlags, Creates, FrameFlags, ReturnCode, SurfaceFormat, TransferFunction};
use crate::ffx::Chain;

/// Composes a frame that is about to be presented.
pub type PresentCallback = unsafe extern "C" fn(*mut CallbackPresent, *mut c_void) -> ReturnCode;
/// Records generation; usually forwards the struct to `ffxDispatch`.
pub type GenerateCallback = unsafe extern "C" fn(*mut DispatchFrameGeneration, *mut c_void) -> ReturnCode;

ffx_struct! {
    /// Creates a frame generator.
    CreateFrameGeneration = FRAME_GENERATION, 40: {
        /// Creation flags.
        16 4 flags: CreateFlags,
        /// The display size.
        20 8 display_size: Dimensions,
        /// The maximum render size.
        28 8 max_render_size: Dimensions,
        /// The format of input and output pictures.
        36 4 back_buffer_format: SurfaceFormat,
    }
}

impl CreateFrameGeneration {
    /// The minimum side of the display size in pixels. AMD's optical flow keeps copies down to 1/64 of the size, and a texture
    /// without a pixel crashes the process: Direct3D 12 does not create it, and the library throws an exception through its C
    /// interface.
    pub const SHORTEST_SIDE: u32 = 64;
}

impl Creates for CreateFrameGeneration {
    type Version = CreateFrameGenerationVersion;
    /// 4.0.0, of SDK 2.1.
    const WRITTEN_FOR: u32 = 4 << 22;

    fn fault(chain: &Chain<Self>) -> Option<(&'static str, &'static str)> {
        let head = chain.head();
        if let Some(why) = head.display_size.fault() {
            return Some(("display_size", why));
        }
        if head.display_size.width.min(head.display_size.height) < Self::SHORTEST_SIDE {
            return Some(("display_size", "AMD's libraries crash on pictures with a side of less than 64 pixels"));
        }
        if let Some(why) = head.max_render_size.fault() {
            return Some(("max_render_size", why));
        }
        let Some(precision) = head.back_buffer_format.precision() else {
            return Some(("back_buffer_format", "a frame generator takes no pictures of this format"));
        };
        match chain.link::<CreateFrameGenerationHudless>() {
            Some(hudless) if hudless.format.precision() != Some(precision) => {
                Some(("format", "pictures with and without interface must be of one precision"))
            }
            _ => None,
        }
    }
}

ffx_struct! {
    /// The release that the host was written for: major << 22 | minor << 12 | patch. SDK 2.1 and later.
    CreateFrameGenerationVersion = FRAME_GENERATION_VERSION extends [CreateFrameGeneration], 24: {
        /// That number.
        16 4 version: u32,
    }
}

impl From<u32> for CreateFrameGenerationVersion {
    fn from(version: u32) -> Self {
        Self { version, ..Self::default() }
    }
}

ffx_struct! {
    /// The format of HUD-less pictures, if it differs. SDK 1.1.3 and later.
    CreateFrameGenerationHudless = FRAME_GENERATION_HUDLESS extends [CreateFrameGeneration], 24: {
        /// That format.
        16 4 format: SurfaceFormat,
    }
}

ffx_struct! {
    /// Settings for a frame.
    ConfigureFrameGeneration = FRAME_GENERATION_CONFIGURE, 144: {
        /// AMD's swap chain; null with [`FrameFlags::NO_SWAPCHAIN`].
        16 8 swapchain: *mut c_void,
        /// Composes frames, on a thread of the swap chain's.
        24 8 present: Option<PresentCallback>,
        /// User data of `present`.
        32 8 present_user: *mut c_void,
        /// Records generation, when the swap chain calls it.
        40 8 generate: Option<GenerateCallback>,
        /// User data of `generate`.
        48 8 generate_user: *mut c_void,
        /// Whether frames are generated.
        56 1 enabled: bool,
        /// Whether generation may run asynchronously to rendering.
        57 1 allow_async: bool,
        /// The HUD-less picture at display size; may be null. Kept for later dispatches.
        64 48 hudless: Resource,
        /// Flags of the frame.
        112 4 flags: FrameFlags,
        /// Shows generated frames only.
        116 1 only_generated: bool,
        /// The part that is generated, the rest is copied; a size of 0 means all.
        120 16 rect: Rect,
        /// The previous frame's id plus 1, or the history is dropped.
        136 8 frame_id: u64,
    }
}

ffx_struct! {
    /// The lens distortion field: distorted minus undistorted position of a pixel, as a fraction of the picture's size. SDK 1.1.2
    /// and later.
    ConfigureDistortion = FRAME_GENERATION_DISTORTION extends [ConfigureFrameGeneration], 64: {
        /// A texture with two channels.
        16 48 field: Resource,
    }
}

ffx_struct! {
    /// A setting as a key and a value.
    ConfigureFrameGenerationKeyValue = FRAME_GENERATION_KEY_VALUE, 40: {
        /// The key.
        16 8 key: u64,
        /// The value, if it is a number.
        24 8 number: u64,
        /// The value, if it is not a number.
        32 8 pointer: *mut c_void,
    }
}

ffx_struct! {
    /// Motion and depth of a frame. Replaced by [`DispatchPrepareV2`] in SDK 2.1.
    DispatchPrepare = FRAME_GENERATION_PREPARE, 184: {
        /// The frame's id.
        16 8 frame_id: u64,
        /// Flags of the frame.
        24 4 flags: FrameFlags,
        /// `ID3D12GraphicsCommandList`, open.
        32 8 command_list: *mut c_void,
        /// The render size.
        40 8 render_size: Dimensions,
        /// Camera jitter in render pixels.
        48 8 jitter: Coordinates,
        /// Scale from motion-texture units to pixels.
        56 8 motion_scale: Coordinates,
        /// Time since the previous frame in milliseconds.
        64 4 frame_time: f32,
        /// Ignored.
        68 1 unused_reset: bool,
        /// The near plane.
        72 4 camera_near: f32,
        /// The far plane.
        76 4 camera_far: f32,
        /// Vertical field of view in radians.
        80 4 camera_fov: f32,
        /// Metres per unit of view space; 0 for 1.
        84 4 metres: f32,
        /// Depth at render size.
        88 48 depth: Resource,
        /// Motion vectors from this frame to the previous one.
        136 48 motion: Resource,
    }
}

ffx_struct! {
    /// The camera of a frame. SDK 1.1.4 to 2.0.
    DispatchCamera = FRAME_GENERATION_CAMERA extends [DispatchPrepare], 64: {
        /// Position in world space.
        16 12 position: [f32; 3],
        /// Unit vector up on the screen.
        28 12 up: [f32; 3],
        /// Unit vector to the right on the screen.
        40 12 right: [f32; 3],
        /// Unit vector into the screen.
        52 12 forward: [f32; 3],
    }
}

ffx_struct! {
    /// Motion, depth and camera of a frame. SDK 2.1 and later.
    DispatchPrepareV2 = FRAME_GENERATION_PREPARE_V2, 232: {
        /// The frame's id.
        16 8 frame_id: u64,
        /// Flags of the frame.
        24 4 flags: FrameFlags,
        /// `ID3D12GraphicsCommandList`, open.
        32 8 command_list: *mut c_void,
        /// The render size.
        40 8 render_size: Dimensions,
        /// Camera jitter in render pixels.
        48 8 jitter: Coordinates,
        /// Scale from motion-texture units to pixels.
        56 8 motion_scale: Coordinates,
        /// Time since the previous frame in milliseconds.
        64 4 frame_time: f32,
        /// Drops the history.
        68 1 reset: bool,
        /// The near plane.
        72 4 camera_near: f32,
        /// The far plane.
        76 4 camera_far: f32,
        /// Vertical field of view in radians.
        80 4 camera_fov: f32,
        /// Metres per unit of view space; 0 for 1.
        84 4 metres: f32,
        /// Depth at render size.
        88 48 depth: Resource,
        /// Motion vectors from this frame to the previous one.
        136 48 motion: Resource,
        /// Position in world space.
        184 12 camera_position: [f32; 3],
        /// Unit vector up on the screen.
        196 12 camera_up: [f32; 3],
        /// Unit vector to the right on the screen.
        208 12 camera_right: [f32; 3],
        /// Unit vector into the screen.
        220 12 camera_forward: [f32; 3],
    }
}

ffx_struct! {
    /// A generated frame.
    DispatchFrameGeneration = FRAME_GENERATION_DISPATCH, 312: {
        /// `ID3D12GraphicsCommandList`, open.
        16 8 command_list: *mut c_void,
        /// This frame at display size.
        24 48 present_color: Resource,
        /// Outputs for generated frames; providers so far fill the first only.
        72 192 outputs: [Resource; 4],
        /// The number of generated frames: 1.
        264 4 frames: u32,
        /// Drops the history.
        268 1 reset: bool,
        /// The colours' transfer function.
        272 4 transfer: TransferFunction,
        /// Minimum and maximum luminance in nits, for high dynamic range.
        276 8 luminance: [f32; 2],
        /// The part that is generated, the rest is copied; a size of 0 means all.
        284 16 rect: Rect,
        /// The frame's id.
        304 8 frame_id: u64,
    }
}

ffx_struct! {
    /// A frame that is about to be presented: the struct passed to the host's callback. Any value but 0 is true.
    CallbackPresent = FRAME_GENERATION_PRESENT, 192: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
        /// `ID3D12GraphicsCommandList`, open.
        24 8 command_list: *mut c_void,
        /// The frame.
        32 48 back_buffer: Resource,
        /// The interface; may be null.
        80 48 interface: Resource,
        /// The texture that will be presented.
        128 48 output: Resource,
        /// Whether the frame is generated.
        176 1 is_generated: u8,
        /// The frame's id.
        184 8 frame_id: u64,
    }
}

ffx_struct! {
    /// Whether the interface has premultiplied alpha. SDK 2.1 and later. Any value but 0 is true.
    CallbackPremultiplied = FRAME_GENERATION_PREMULTIPLIED extends [CallbackPresent], 24: {
        /// The interface's colours are multiplied by its alpha.
        16 1 premultiplied: u8,
    }
}

ffx_struct! {
    /// Queries the device memory of a context. SDK 1.1.2 and later.
    QueryFrameGenerationMemory = FRAME_GENERATION_MEMORY, 24: {
        /// Receives the answer.
        16 8 usage: *mut MemoryUsage,
    }
}

ffx_struct! {
    /// Queries the device memory of a context before it is created. SDK 2.0 and later.
    QueryFrameGenerationMemoryV2 = FRAME_GENERATION_MEMORY_V2, 64: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
        /// The maximum render size.
        24 8 max_render_size: Dimensions,
        /// The display size.
        32 8 display_size: Dimensions,
        /// Its creation flags.
        40 4 create_flags: CreateFlags,
        /// Flags of its frames.
        44 4 frame_flags: FrameFlags,
        /// The format of input and output pictures.
        48 4 back_buffer_format: SurfaceFormat,
        /// The format of HUD-less pictures; `UNKNOWN` for none.
        52 4 hudless_format: SurfaceFormat,
        /// Receives the answer.
        56 8 usage: *mut MemoryUsage,
    }
}
