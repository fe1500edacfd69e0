//! Upscaling.

use std::ffi::c_void;

use super::{Coordinates, Creates, Dimensions, MemoryUsage, MessageCallback, Resource, described, open_set};
use super::{QualityMode, ReactiveFlags, UpscaleCreateFlags, UpscaleFlags, UpscaleResources};
use crate::ffx::Chain;

open_set! {
    /// What [`ConfigureUpscaleKeyValue`] sets; its pointer leads to an `f32`.
    UpscaleKey: u64 {
        /// How far motion rules history out.
        VELOCITY_FACTOR = 0,
        /// What the reactive mask is multiplied by.
        REACTIVENESS_SCALE = 1,
        /// What changes of shading are multiplied by.
        SHADING_CHANGE_SCALE = 2,
        /// How fast history is trusted.
        ACCUMULATION_ADDED = 3,
        /// How much of what was just uncovered is trusted.
        MIN_DISOCCLUSION_ACCUMULATION = 4,
    }
}

described! {
    /// Makes an upscaler.
    CreateUpscale = UPSCALE, 48: {
        /// How.
        16 4 flags: UpscaleCreateFlags,
        /// The largest size rendered at.
        20 8 max_render_size: Dimensions,
        /// The largest size upscaled to.
        28 8 max_upscale_size: Dimensions,
        /// Gets messages.
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

described! {
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

described! {
    /// One frame through an upscaler.
    DispatchUpscale = UPSCALE_DISPATCH, 432: {
        /// `ID3D12GraphicsCommandList`, open.
        16 8 command_list: *mut c_void,
        /// The picture, of the render size.
        24 48 color: Resource,
        /// Its depth.
        72 48 depth: Resource,
        /// From this frame to the one before.
        120 48 motion: Resource,
        /// Of one pixel; may be none.
        168 48 exposure: Resource,
        /// What not to trust history for; may be none.
        216 48 reactive: Resource,
        /// Where things are transparent; may be none.
        264 48 transparency: Resource,
        /// Gets the upscaled picture.
        312 48 output: Resource,
        /// Of this frame's camera, in render pixels.
        360 8 jitter: Coordinates,
        /// What makes pixels of motion.
        368 8 motion_scale: Coordinates,
        /// The size rendered at.
        376 8 render_size: Dimensions,
        /// The size upscaled to; 0 for the largest.
        384 8 upscale_size: Dimensions,
        /// Whether it is sharpened.
        392 1 sharpen: bool,
        /// How much, 0 to 1.
        396 4 sharpness: f32,
        /// Milliseconds since the frame before.
        400 4 frame_time: f32,
        /// What the picture was multiplied by, above 0.
        404 4 pre_exposure: f32,
        /// There is no frame before.
        408 1 reset: bool,
        /// The near plane.
        412 4 camera_near: f32,
        /// The far plane.
        416 4 camera_far: f32,
        /// From bottom to top, radians.
        420 4 camera_fov: f32,
        /// What makes metres of the view's units; 0 for 1.
        424 4 metres: f32,
        /// How.
        428 4 flags: UpscaleFlags,
    }
}

described! {
    /// Finds a reactive mask.
    DispatchReactiveMask = UPSCALE_REACTIVE_MASK, 192: {
        /// `ID3D12GraphicsCommandList`, open.
        16 8 command_list: *mut c_void,
        /// The picture without what is transparent.
        24 48 opaque: Resource,
        /// The picture with it.
        72 48 color: Resource,
        /// Gets the mask.
        120 48 output: Resource,
        /// The size rendered at.
        168 8 render_size: Dimensions,
        /// What the mask is multiplied by.
        176 4 scale: f32,
        /// Below this there is none.
        180 4 threshold: f32,
        /// Its value above.
        184 4 value: f32,
        /// How.
        188 4 flags: ReactiveFlags,
    }
}

described! {
    /// A setting by its number.
    ConfigureUpscaleKeyValue = UPSCALE_KEY_VALUE, 40: {
        /// Which.
        16 8 key: UpscaleKey,
        /// Its value, where that is a number.
        24 8 number: u64,
        /// Its value, where that is something else.
        32 8 pointer: *mut c_void,
    }
}

described! {
    /// Asks for the ratio of a quality mode.
    QueryUpscaleRatio = UPSCALE_RATIO, 32: {
        /// The mode.
        16 4 mode: QualityMode,
        /// Gets the ratio of sides.
        24 8 ratio: *mut f32,
    }
}

described! {
    /// Asks for the render size of a quality mode.
    QueryRenderSize = UPSCALE_RENDER_SIZE, 48: {
        /// The width shown.
        16 4 display_width: u32,
        /// The height shown.
        20 4 display_height: u32,
        /// The mode.
        24 4 mode: QualityMode,
        /// Gets the width to render at.
        32 8 render_width: *mut u32,
        /// Gets the height to render at.
        40 8 render_height: *mut u32,
    }
}

described! {
    /// Asks how many jitters a sequence has.
    QueryJitterPhases = UPSCALE_JITTER_PHASES, 32: {
        /// The width rendered at.
        16 4 render_width: u32,
        /// The width shown.
        20 4 display_width: u32,
        /// Gets the count.
        24 8 count: *mut i32,
    }
}

described! {
    /// Asks for a jitter.
    QueryJitter = UPSCALE_JITTER_OFFSET, 40: {
        /// Which of the sequence.
        16 4 index: i32,
        /// How many the sequence has.
        20 4 count: i32,
        /// Gets it, in render pixels.
        24 8 x: *mut f32,
        /// Gets it, in render pixels.
        32 8 y: *mut f32,
    }
}

described! {
    /// Asks for the memory of a context. SDK 1.1.2 and later.
    QueryUpscaleMemory = UPSCALE_MEMORY, 24: {
        /// Gets it.
        16 8 usage: *mut MemoryUsage,
    }
}

described! {
    /// Asks for the memory of a context to come. SDK 2.0 and later.
    QueryUpscaleMemoryV2 = UPSCALE_MEMORY_V2, 56: {
        /// `ID3D12Device`.
        16 8 device: *mut c_void,
        /// The largest size rendered at.
        24 8 max_render_size: Dimensions,
        /// The largest size upscaled to.
        32 8 max_upscale_size: Dimensions,
        /// How it would be made.
        40 4 flags: UpscaleCreateFlags,
        /// Gets it.
        48 8 usage: *mut MemoryUsage,
    }
}

described! {
    /// Asks what a provider wants to be given. SDK 2.0 and later.
    QueryUpscaleResources = UPSCALE_RESOURCES, 32: {
        /// Out: what it must be given.
        16 8 required: UpscaleResources,
        /// Out: what it can use.
        24 8 optional: UpscaleResources,
    }
}
