//! Named numbers: struct ids, return codes, flags and enumerations.

use bitflags::bitflags;

use super::open_set;

open_set! {
    /// Struct ids: the effect in the upper bits, the number within the effect in the lower 16.
    StructId: u64 {
        /// Message callback and level of all effects.
        GLOBAL_DEBUG_1 = 0x1,
        /// The Direct3D 12 device.
        BACKEND_DX12 = 0x2,
        /// Query of the available providers.
        GET_VERSIONS = 0x4,
        /// Request for a provider.
        OVERRIDE_VERSION = 0x5,
        /// Query of a context's provider.
        GET_PROVIDER_VERSION = 0x6,
        /// Message callback and level of one effect.
        GLOBAL_DEBUG = 0x7,
        /// An upscaler.
        UPSCALE = 0x1_0000,
        /// One frame through it.
        UPSCALE_DISPATCH = 0x1_0001,
        /// The ratio of a quality mode.
        UPSCALE_RATIO = 0x1_0002,
        /// The render size of a quality mode.
        UPSCALE_RENDER_SIZE = 0x1_0003,
        /// The length of the jitter sequence.
        UPSCALE_JITTER_PHASES = 0x1_0004,
        /// One jitter of the sequence.
        UPSCALE_JITTER_OFFSET = 0x1_0005,
        /// A reactive mask.
        UPSCALE_REACTIVE_MASK = 0x1_0006,
        /// A setting as a key and a value.
        UPSCALE_KEY_VALUE = 0x1_0007,
        /// Device memory of a context.
        UPSCALE_MEMORY = 0x1_0008,
        /// Device memory of a context before it is created.
        UPSCALE_MEMORY_V2 = 0x1_0009,
        /// The inputs of a provider.
        UPSCALE_RESOURCES = 0x1_000a,
        /// The release that a host was written for.
        UPSCALE_VERSION = 0x1_000b,
        /// A frame generator.
        FRAME_GENERATION = 0x2_0001,
        /// Its settings for a frame.
        FRAME_GENERATION_CONFIGURE = 0x2_0002,
        /// A generated frame.
        FRAME_GENERATION_DISPATCH = 0x2_0003,
        /// Motion and depth of a frame.
        FRAME_GENERATION_PREPARE = 0x2_0004,
        /// A frame that is about to be presented.
        FRAME_GENERATION_PRESENT = 0x2_0005,
        /// A setting as a key and a value.
        FRAME_GENERATION_KEY_VALUE = 0x2_0006,
        /// Device memory of a context.
        FRAME_GENERATION_MEMORY = 0x2_0007,
        /// The distortion of a lens.
        FRAME_GENERATION_DISTORTION = 0x2_0008,
        /// The format of HUD-less pictures.
        FRAME_GENERATION_HUDLESS = 0x2_0009,
        /// The camera of a frame.
        FRAME_GENERATION_CAMERA = 0x2_000a,
        /// Device memory of a context before it is created.
        FRAME_GENERATION_MEMORY_V2 = 0x2_000b,
        /// Motion, depth and camera of a frame.
        FRAME_GENERATION_PREPARE_V2 = 0x2_000c,
        /// Whether the interface has premultiplied alpha.
        FRAME_GENERATION_PREMULTIPLIED = 0x2_000d,
        /// The release that a host was written for.
        FRAME_GENERATION_VERSION = 0x2_000e,
        /// A swap chain created from the host's.
        SWAPCHAIN_WRAP = 0x3_0001,
        /// The interface's texture.
        SWAPCHAIN_INTERFACE = 0x3_0002,
        /// The command list to record generation into.
        SWAPCHAIN_COMMAND_LIST = 0x3_0003,
        /// The texture to generate into.
        SWAPCHAIN_TEXTURE = 0x3_0004,
        /// A new swap chain.
        SWAPCHAIN_NEW = 0x3_0005,
        /// A new swap chain for a window.
        SWAPCHAIN_FOR_WINDOW = 0x3_0006,
        /// Waiting until all pending frames are presented.
        SWAPCHAIN_WAIT = 0x3_0007,
        /// A setting as a key and a value.
        SWAPCHAIN_KEY_VALUE = 0x3_0008,
        /// Device memory of a context.
        SWAPCHAIN_MEMORY = 0x3_0009,
        /// Device memory of a context before it is created.
        SWAPCHAIN_MEMORY_V2 = 0x3_000a,
        /// The release that a host was written for.
        SWAPCHAIN_VERSION = 0x3_000b,
    }
}

impl StructId {
    /// The effect it belongs to. Higher bits, used by releases of 2026, are the backend; Direct3D 12 is 0.
    pub fn effect(self) -> EffectId {
        EffectId(self.0 & 0x00ff_0000)
    }
}

open_set! {
    /// An effect.
    EffectId: u64 {
        /// Shared by all effects.
        GENERAL = 0,
        /// Upscaling.
        UPSCALE = 0x1_0000,
        /// Frame generation.
        FRAME_GENERATION = 0x2_0000,
        /// Presenting generated frames.
        SWAPCHAIN = 0x3_0000,
    }
}

open_set! {
    /// The return code of a call.
    ReturnCode: u32 {
        /// Success.
        OK = 0,
        /// Failure without further information.
        ERROR = 1,
        /// A struct that this call or context does not know.
        UNKNOWN_STRUCT = 2,
        /// Direct3D, or the effect itself, failed.
        RUNTIME_ERROR = 3,
        /// No provider in the loaded libraries does this.
        NO_PROVIDER = 4,
        /// Out of memory.
        MEMORY = 5,
        /// A null pointer, an empty resource, a value outside its set.
        PARAMETER = 6,
        /// A struct newer than the provider. SDK 2.0 and later.
        STRUCT_TOO_NEW = 7,
    }
}

bitflags! {
    /// Flags of a new frame generator.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct CreateFlags: u32 {
        /// Generation may be recorded into a list of a compute queue.
        const ASYNC_WORKLOAD = 1;
        /// Motion has display size, not render size.
        const DISPLAY_RESOLUTION_MOTION = 2;
        /// Motion vectors include the jitter.
        const MOTION_JITTER = 4;
        /// Reversed depth: 1 is near.
        const DEPTH_INVERTED = 8;
        /// The far plane is at infinity.
        const DEPTH_INFINITE = 16;
        /// Pictures are of high dynamic range.
        const HIGH_DYNAMIC_RANGE = 32;
        /// The provider checks its inputs and reports errors as messages.
        const DEBUG_CHECKING = 64;
        const _ = !0;
    }

    /// Flags of a generated frame.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct FrameFlags: u32 {
        /// Bars at the side that show tearing.
        const TEAR_LINES = 1;
        /// Markers in frames whose history was dropped.
        const RESET_INDICATORS = 2;
        /// The generator's internal textures instead of the picture.
        const DEBUG_VIEW = 4;
        /// AMD's swap chain is not used.
        const NO_SWAPCHAIN = 8;
        /// Bars at the side that show when frames are presented.
        const PACING_LINES = 16;
        const _ = !0;
    }

    /// How the interface is drawn over frames.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct InterfaceFlags: u32 {
        /// Its colours are multiplied by its alpha.
        const PREMULTIPLIED = 1;
        /// The swap chain keeps a copy, so that the host may draw the next one.
        const DOUBLE_BUFFERED = 2;
        const _ = !0;
    }

    /// Flags of a new upscaler.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct UpscaleCreateFlags: u32 {
        /// Pictures are of high dynamic range.
        const HIGH_DYNAMIC_RANGE = 1;
        /// Motion has display size.
        const DISPLAY_RESOLUTION_MOTION = 2;
        /// Motion vectors include the jitter.
        const MOTION_JITTER = 4;
        /// Reversed depth: 1 is near.
        const DEPTH_INVERTED = 8;
        /// The far plane is at infinity.
        const DEPTH_INFINITE = 16;
        /// The upscaler computes exposure from the picture.
        const AUTO_EXPOSURE = 32;
        /// The render size may change from frame to frame.
        const DYNAMIC_RESOLUTION = 64;
        /// The provider checks its inputs and reports errors as messages.
        const DEBUG_CHECKING = 128;
        /// Colours are not linear.
        const NON_LINEAR_COLOR = 256;
        /// Frames may request the debug view.
        const DEBUG_VISUALIZATION = 512;
        const _ = !0;
    }

    /// Flags of an upscaled frame.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct UpscaleFlags: u32 {
        /// The upscaler's internal textures instead of the picture.
        const DEBUG_VIEW = 1;
        /// The picture is in sRGB.
        const COLOR_SRGB = 2;
        /// The picture is in PQ.
        const COLOR_PQ = 4;
        const _ = !0;
    }

    /// Flags of a reactive mask.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct ReactiveFlags: u32 {
        /// Compare tone-mapped colours.
        const TONEMAP = 1;
        /// Compare colours with their tone mapping undone.
        const INVERSE_TONEMAP = 2;
        /// The mask is 0 or `value`.
        const THRESHOLD = 4;
        /// Uses the greatest difference of a channel, not the length of the difference.
        const COMPONENTS_MAX = 8;
        const _ = !0;
    }

    /// Inputs of an upscaler.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct UpscaleResources: u64 {
        /// The picture.
        const COLOR = 1;
        /// Its depth.
        const DEPTH = 2;
        /// Its motion.
        const MOTION = 4;
        /// Its exposure.
        const EXPOSURE = 8;
        /// The reactive mask.
        const REACTIVE = 16;
        /// The transparency mask.
        const TRANSPARENCY = 32;
        const _ = !0;
    }

    /// Flags of a resource's memory.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct ResourceFlags: u32 {
        /// Its memory may be aliased.
        const ALIASABLE = 1;
        /// Its contents need not be kept.
        const UNDEFINED = 2;
        const _ = !0;
    }

    /// Uses of a resource other than reading.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct ResourceUsage: u32 {
        /// A render target.
        const RENDER_TARGET = 1;
        /// Unordered access by shaders.
        const UNORDERED_ACCESS = 2;
        /// A depth target.
        const DEPTH_TARGET = 4;
        /// Arguments of indirect draws.
        const INDIRECT = 8;
        /// An array view.
        const ARRAY_VIEW = 16;
        /// A stencil target.
        const STENCIL_TARGET = 32;
        /// A compressed render target.
        const COMPRESSED_RENDER_TARGET = 0x8000;
        const _ = !0;
    }
}

open_set! {
    /// Transfer functions.
    TransferFunction: u32 {
        /// sRGB.
        SRGB = 0,
        /// SMPTE ST 2084.
        PQ = 1,
        /// Linear, 1 is 80 nits.
        SCRGB = 2,
    }
}

open_set! {
    /// Kinds of resources.
    ResourceType: u32 {
        /// A buffer.
        BUFFER = 0,
        /// A 1D texture.
        TEXTURE_1D = 1,
        /// A 2D texture.
        TEXTURE_2D = 2,
        /// A cube texture.
        TEXTURE_CUBE = 3,
        /// A 3D texture.
        TEXTURE_3D = 4,
    }
}

open_set! {
    /// Quality modes, by their render size.
    QualityMode: u32 {
        /// The display size.
        NATIVE = 0,
        /// 1/1.5 of each side.
        QUALITY = 1,
        /// 1/1.7.
        BALANCED = 2,
        /// 1/2.
        PERFORMANCE = 3,
        /// 1/3.
        ULTRA_PERFORMANCE = 4,
    }
}
