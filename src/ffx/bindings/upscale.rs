//! Upscaling.

use std::ffi::c_void;

use super::{Coordinates, Creates, Dimensions, MemoryUsage, MessageCallback, Resource, ffx_struct, open_set};
use super::{QualityMode, ReactiveFlags, UpscaleCreateFlags, UpscaleFlags, UpscaleResources};
use crate::ffx::Chain;

open_set! {
    /// Keys of [`ConfigureUpscaleKeyValue`], whose pointer points to an `f32`.
    UpscaleKey: u64 {
        /// How strongly motion rejects history.
        VELOCITY_FACTOR = 0,
        /// Factor of the reactive mask.
        REACTIVENESS_SCALE = 1,
        /// Factor of detected shading changes.
        SHADING_CHANGE_SCALE = 2,
        /// How fast the weight of history grows.
        ACCUMULATION_ADDED = 3,
        /// Minimum weight of history in disoccluded pixels.
        MIN_DISOCCLUSION_ACCUMULATION = 4,
    }
}

ffx_struct! {
    /// Creates an upscaler.
    CreateUpscale = UPSCALE, 48: {
        /// Creation flags.
        16 4 flags: UpscaleCreateFlags,
        /// The maximum render size.
        20 8 max_render_size: Dimensions,
        /// The maximum upscaled size.
        28 8 max_upscale_size: Dimensions,
        /// Receives messages.
        40 8 message: Option<MessageCallback>,
    }
}

impl Creates for CreateUpscale {
    type Version = CreateUpscaleVersion;
    /// 4.0.3, of SDK 2.1.
    const WRITTEN_FOR: u32 = 4 << 22 | 3;

    fn fault(chain: &Chain<Self>) -> Option<(&'static str, &'static str)> {
        let head = chain.head();
        if head.flags.contains(UpscaleCreateFlags::DEBUG_VISUALIZATION) {
            return Some(("flags", "frames cannot be asked for as the upscaler's own fields"));
        }
        let render = head.max_render_size.fault().map(|why| ("max_render_size", why));
        render.or_else(|| head.max_upscale_size.fault().map(|why| ("max_upscale_size", why)))
    }
}

ffx_struct! {
    /// As [`CreateFrameGenerationVersion`](super::CreateFrameGenerationVersion).
    CreateUpscaleVersion = UPSCALE_VERSION extends [CreateUpscale], 24: {
        /// That number.
        16 4 version: u32,
    }
}

impl From<u32> for CreateUpscaleVersion {
    fn from(version: u32) -> Self {
        Self { version, ..Self::default() }
    }
}

ffx_struct! {
    /// One frame through an upscaler.
    DispatchUpscale = UPSCALE_DISPATCH, 432: {
        /// `ID3D12GraphicsCommandList`, open.
        16 8 command_list: *mut c_void,
        /// The picture at render size.
        24 48 color: Resource,
        /// Its depth.
        72 48 depth: Resource,
        /// Motion vectors from this frame to the previous one.
        120 48 motion: Resource,
        /// Exposure, a 1x1 texture; may be null.
        168 48 exposure: Resource,
        /// Reactive mask: where history is not to be trusted; may be null.
        216 48 reactive: Resource,
        /// Transparency mask; may be null.
        264 48 transparency: Resource,
        /// Receives the upscaled picture.
        312 48 output: Resource,
        /// Camera jitter in render pixels.
        360 8 jitter: Coordinates,
        /// Scale from motion-texture units to pixels.
        368 8 motion_scale: Coordinates,
        /// The render size.
        376 8 render_size: Dimensions,
        /// The upscaled size; 0 for the maximum.
        384 8 upscale_size: Dimensions,
        /// Whether the output is sharpened.
        392 1 sharpen: bool,
        /// Strength of sharpening, 0 to 1.
        396 4 sharpness: f32,
        /// Time since the previous frame in milliseconds.
        400 4 frame_time: f32,
        /// Factor that the picture was multiplied by, above 0.
        404 4 pre_exposure: f32,
        /// Drops the history.
        408 1 reset: bool,
        /// The near plane.
        412 4 camera_near: f32,
        /// The far plane.
        416 4 camera_far: f32,
        /// Vertical field of view in radians.
        420 4 camera_fov: f32,
        /// Metres per unit of view space; 0 for 1.
        424 4 metres: f32,
        /// Flags of the frame.
        428 4 flags: UpscaleFlags,
    }
}

ffx_struct! {
    /// Computes a reactive mask.
    DispatchReactiveMask = UPSCALE_REACTIVE_MASK, 192: {
        /// `ID3D12GraphicsCommandList`, open.
        16 8 command_list: *mut c_void,
        /// The picture without transparent objects.
        24 48 opaque: Resource,
        /// The picture with transparent objects.
        72 48 color: Resource,
        /// Receives the mask.
        120 48 output: Resource,
        /// The render size.
        168 8 render_size: Dimensions,
        /// Factor of the mask.
        176 4 scale: f32,
        /// Below this threshold the mask is 0.
        180 4 threshold: f32,
        /// The mask above the threshold.
        184 4 value: f32,
        /// Flags of the mask.
        188 4 flags: ReactiveFlags,
    }
}

ffx_struct! {
    /// A setting as a key and a value.
    ConfigureUpscaleKeyValue = UPSCALE_KEY_VALUE, 40: {
        /// The key.
        16 8 key: UpscaleKey,
        /// The value, if it is a number.
        24 8 number: u64,
        /// The value, if it is not a number.
        32 8 pointer: *mut c_void,
    }
}

ffx_struct! {
    /// Queries the ratio of a quality mode.
    QueryUpscaleRatio = UPSCALE_RATIO, 32: {
        /// The mode.
        16 4 mode: QualityMode,
        /// Receives the ratio of display to render side.
        24 8 ratio: *mut f32,
    }
}

ffx_struct! {
    /// Queries the render size of a quality mode.
    QueryRenderSize = UPSCALE_RENDER_SIZE, 48: {
        /// The display width.
        16 4 display_width: u32,
        /// The display height.
        20 4 display_height: u32,
        /// The mode.
        24 4 mode: QualityMode,
        /// Receives the render width.
        32 8 render_width: *mut u32,
        /// Receives the render height.
        40 8 render_height: *mut u32,
    }
}

ffx_struct! {
    /// Queries the length of the jitter sequence.
    QueryJitterPhases = UPSCALE_JITTER_PHASES, 32: {
        /// The render width.
        16 4 render_width: u32,
        /// The display width.
        20 4 display_width: u32,
        /// Receives the length.
        24 8 count: *mut i32,
    }
}

ffx_struct! {
    /// Queries one jitter of a sequence.
    QueryJitter = UPSCALE_JITTER_OFFSET, 40: {
        /// Index in the sequence.
        16 4 index: i32,
        /// Length of the sequence.
        20 4 count: i32,
        /// Receives x in render pixels.
        24 8 x: *mut f32,
        /// Receives y in render pixels.
        32 8 y: *mut f32,
    }
}

ffx_struct! {
    /// Queries the device memory of a context. SDK 1.1.2 and later.
    QueryUpscaleMemory = UPSCALE_MEMORY, 24: {
        /// Receives the answer.
        16 8 usage: *mut MemoryUsage,
    }
}

ffx_struct! {
    /// Queries the device memory of a context before it is created. SDK 2.0 and later.
    QueryUpscaleMemoryV2 = UPSCALE_MEMORY_V2, 56: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
        /// The maximum render size.
        24 8 max_render_size: Dimensions,
        /// The maximum upscaled size.
        32 8 max_upscale_size: Dimensions,
        /// Its creation flags.
        40 4 flags: UpscaleCreateFlags,
        /// Receives the answer.
        48 8 usage: *mut MemoryUsage,
    }
}

ffx_struct! {
    /// Queries the inputs of a provider. SDK 2.0 and later.
    QueryUpscaleResources = UPSCALE_RESOURCES, 32: {
        /// Out: required inputs.
        16 8 required: UpscaleResources,
        /// Out: optional inputs.
        24 8 optional: UpscaleResources,
    }
}
