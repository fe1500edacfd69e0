//! Frame generation.

use std::ffi::c_void;

use super::{Coordinates, Dimensions, MemoryUsage, Rect, Resource, described};
use super::{CreateFlags, Creates, FrameFlags, ReturnCode, SurfaceFormat, TransferFunction};
use crate::ffx::Chain;

/// Composes a frame that is about to be presented.
pub type PresentCallback = unsafe extern "C" fn(*mut CallbackPresent, *mut c_void) -> ReturnCode;
/// Records generation; usually hands the struct on to `ffxDispatch`.
pub type GenerateCallback = unsafe extern "C" fn(*mut DispatchFrameGeneration, *mut c_void) -> ReturnCode;

described! {
    /// Makes a frame generator.
    CreateFrameGeneration = FRAME_GENERATION, 40: {
        /// How.
        16 4 flags: CreateFlags,
        /// The size shown.
        20 8 display_size: Dimensions,
        /// The largest size rendered at.
        28 8 max_render_size: Dimensions,
        /// Of pictures in and out.
        36 4 back_buffer_format: SurfaceFormat,
    }
}

impl CreateFrameGeneration {
    /// The shortest side of a picture shown, in pixels. AMD's optical flow keeps copies of it down to a 64th of its size, and a
    /// texture without a pixel crashes the process: Direct3D 12 refuses to make it, and the library throws through its own interface.
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

described! {
    /// Tells for which release the host was written: major << 22 | minor << 12 | patch. SDK 2.1 and later.
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

described! {
    /// The format of pictures without interface, where it is another. SDK 1.1.3 and later.
    CreateFrameGenerationHudless = FRAME_GENERATION_HUDLESS extends [CreateFrameGeneration], 24: {
        /// That format.
        16 4 format: SurfaceFormat,
    }
}

described! {
    /// Settings for a frame.
    ConfigureFrameGeneration = FRAME_GENERATION_CONFIGURE, 144: {
        /// AMD's swapchain; null with [`FrameFlags::NO_SWAPCHAIN`].
        16 8 swapchain: *mut c_void,
        /// Composes frames, on a thread of the swapchain's.
        24 8 present: Option<PresentCallback>,
        /// Given to it.
        32 8 present_user: *mut c_void,
        /// Records generation, when the swapchain wants it.
        40 8 generate: Option<GenerateCallback>,
        /// Given to it.
        48 8 generate_user: *mut c_void,
        /// Whether frames are generated.
        56 1 enabled: bool,
        /// Whether generation may run beside rendering.
        57 1 allow_async: bool,
        /// The picture without interface, as shown; may be none. Kept for later dispatches.
        64 48 hudless: Resource,
        /// How.
        112 4 flags: FrameFlags,
        /// Shows generated frames only.
        116 1 only_generated: bool,
        /// What of the picture is the world; of no size: all.
        120 16 rect: Rect,
        /// One more than of the frame before, or history is dropped.
        136 8 frame_id: u64,
    }
}

described! {
    /// The distortion of a lens: where a pixel is after it less where it was before, of the picture's size. SDK 1.1.2 and later.
    ConfigureDistortion = FRAME_GENERATION_DISTORTION extends [ConfigureFrameGeneration], 64: {
        /// Two channels.
        16 48 field: Resource,
    }
}

described! {
    /// A setting by its number.
    ConfigureFrameGenerationKeyValue = FRAME_GENERATION_KEY_VALUE, 40: {
        /// Which.
        16 8 key: u64,
        /// Its value, where that is a number.
        24 8 number: u64,
        /// Its value, where that is something else.
        32 8 pointer: *mut c_void,
    }
}

described! {
    /// Motion and depth of a frame. Replaced by [`DispatchPrepareV2`] in SDK 2.1.
    DispatchPrepare = FRAME_GENERATION_PREPARE, 184: {
        /// Of the frame.
        16 8 frame_id: u64,
        /// How.
        24 4 flags: FrameFlags,
        /// `ID3D12GraphicsCommandList`, open.
        32 8 command_list: *mut c_void,
        /// The size rendered at.
        40 8 render_size: Dimensions,
        /// Of this frame's camera, in render pixels.
        48 8 jitter: Coordinates,
        /// What makes pixels of motion.
        56 8 motion_scale: Coordinates,
        /// Milliseconds since the frame before.
        64 4 frame_time: f32,
        /// Not looked at.
        68 1 unused_reset: bool,
        /// The near plane.
        72 4 camera_near: f32,
        /// The far plane.
        76 4 camera_far: f32,
        /// From bottom to top, radians.
        80 4 camera_fov: f32,
        /// What makes metres of the view's units; 0 for 1.
        84 4 metres: f32,
        /// Depth, of the render size.
        88 48 depth: Resource,
        /// From this frame to the one before.
        136 48 motion: Resource,
    }
}

described! {
    /// The camera of a frame. SDK 1.1.4 to 2.0.
    DispatchCamera = FRAME_GENERATION_CAMERA extends [DispatchPrepare], 64: {
        /// In the world.
        16 12 position: [f32; 3],
        /// Of length 1.
        28 12 up: [f32; 3],
        /// Of length 1.
        40 12 right: [f32; 3],
        /// Of length 1.
        52 12 forward: [f32; 3],
    }
}

described! {
    /// Motion, depth and camera of a frame. SDK 2.1 and later.
    DispatchPrepareV2 = FRAME_GENERATION_PREPARE_V2, 232: {
        /// Of the frame.
        16 8 frame_id: u64,
        /// How.
        24 4 flags: FrameFlags,
        /// `ID3D12GraphicsCommandList`, open.
        32 8 command_list: *mut c_void,
        /// The size rendered at.
        40 8 render_size: Dimensions,
        /// Of this frame's camera, in render pixels.
        48 8 jitter: Coordinates,
        /// What makes pixels of motion.
        56 8 motion_scale: Coordinates,
        /// Milliseconds since the frame before.
        64 4 frame_time: f32,
        /// There is no frame before.
        68 1 reset: bool,
        /// The near plane.
        72 4 camera_near: f32,
        /// The far plane.
        76 4 camera_far: f32,
        /// From bottom to top, radians.
        80 4 camera_fov: f32,
        /// What makes metres of the view's units; 0 for 1.
        84 4 metres: f32,
        /// Depth, of the render size.
        88 48 depth: Resource,
        /// From this frame to the one before.
        136 48 motion: Resource,
        /// In the world.
        184 12 camera_position: [f32; 3],
        /// Of length 1.
        196 12 camera_up: [f32; 3],
        /// Of length 1.
        208 12 camera_right: [f32; 3],
        /// Of length 1.
        220 12 camera_forward: [f32; 3],
    }
}

described! {
    /// A generated frame.
    DispatchFrameGeneration = FRAME_GENERATION_DISPATCH, 312: {
        /// `ID3D12GraphicsCommandList`, open.
        16 8 command_list: *mut c_void,
        /// This frame, as shown.
        24 48 present_color: Resource,
        /// Where generated frames go; providers so far fill the first only.
        72 192 outputs: [Resource; 4],
        /// 1.
        264 4 frames: u32,
        /// There is no frame before.
        268 1 reset: bool,
        /// How the picture's light became numbers.
        272 4 transfer: TransferFunction,
        /// Nits, of high dynamic range.
        276 8 luminance: [f32; 2],
        /// What of the picture is the world; of no size: all.
        284 16 rect: Rect,
        /// Of the frame.
        304 8 frame_id: u64,
    }
}

described! {
    /// A frame that is about to be presented, as the host's callback is given it. Whatever is not 0 is true.
    CallbackPresent = FRAME_GENERATION_PRESENT, 192: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
        /// `ID3D12GraphicsCommandList`, open.
        24 8 command_list: *mut c_void,
        /// The frame.
        32 48 back_buffer: Resource,
        /// The interface; may be none.
        80 48 interface: Resource,
        /// What will be presented.
        128 48 output: Resource,
        /// Whether it is a generated frame.
        176 1 is_generated: u8,
        /// Of the frame.
        184 8 frame_id: u64,
    }
}

described! {
    /// How the interface's alpha is meant. SDK 2.1 and later. Whatever is not 0 is true.
    CallbackPremultiplied = FRAME_GENERATION_PREMULTIPLIED extends [CallbackPresent], 24: {
        /// Its colours are multiplied by it.
        16 1 premultiplied: u8,
    }
}

described! {
    /// Asks for the memory of a context. SDK 1.1.2 and later.
    QueryFrameGenerationMemory = FRAME_GENERATION_MEMORY, 24: {
        /// Gets it.
        16 8 usage: *mut MemoryUsage,
    }
}

described! {
    /// Asks for the memory of a context to come. SDK 2.0 and later.
    QueryFrameGenerationMemoryV2 = FRAME_GENERATION_MEMORY_V2, 64: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
        /// The largest size rendered at.
        24 8 max_render_size: Dimensions,
        /// The size shown.
        32 8 display_size: Dimensions,
        /// How it would be made.
        40 4 create_flags: CreateFlags,
        /// How frames would be generated.
        44 4 frame_flags: FrameFlags,
        /// Of pictures in and out.
        48 4 back_buffer_format: SurfaceFormat,
        /// Of pictures without interface; unknown for none.
        52 4 hudless_format: SurfaceFormat,
        /// Gets it.
        56 8 usage: *mut MemoryUsage,
    }
}
