//! Numbers with names: what structs are, what calls answer, flags, formats and states.

use bitflags::bitflags;

use super::open_set;

open_set! {
    /// What a struct is: its effect above, its number within the effect below.
    StructId: u64 {
        /// Level and receiver of messages, of every effect.
        GLOBAL_DEBUG_1 = 0x1,
        /// The Direct3D 12 device.
        BACKEND_DX12 = 0x2,
        /// Which providers there are.
        GET_VERSIONS = 0x4,
        /// Which provider it is to be.
        OVERRIDE_VERSION = 0x5,
        /// Which provider it is.
        GET_PROVIDER_VERSION = 0x6,
        /// Level and receiver of messages, of one effect.
        GLOBAL_DEBUG = 0x7,
        /// An upscaler.
        UPSCALE = 0x1_0000,
        /// One frame through it.
        UPSCALE_DISPATCH = 0x1_0001,
        /// The ratio of a quality mode.
        UPSCALE_RATIO = 0x1_0002,
        /// The render size of a quality mode.
        UPSCALE_RENDER_SIZE = 0x1_0003,
        /// How many jitters a sequence has.
        UPSCALE_JITTER_PHASES = 0x1_0004,
        /// A jitter.
        UPSCALE_JITTER_OFFSET = 0x1_0005,
        /// A mask of what the upscaler should not trust its history for.
        UPSCALE_REACTIVE_MASK = 0x1_0006,
        /// A setting by its number.
        UPSCALE_KEY_VALUE = 0x1_0007,
        /// Memory of a context.
        UPSCALE_MEMORY = 0x1_0008,
        /// Memory of a context to come.
        UPSCALE_MEMORY_V2 = 0x1_0009,
        /// What a provider wants to be given.
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
        /// A setting by its number.
        FRAME_GENERATION_KEY_VALUE = 0x2_0006,
        /// Memory of a context.
        FRAME_GENERATION_MEMORY = 0x2_0007,
        /// The distortion of a lens.
        FRAME_GENERATION_DISTORTION = 0x2_0008,
        /// The format of the picture without interface.
        FRAME_GENERATION_HUDLESS = 0x2_0009,
        /// The camera of a frame.
        FRAME_GENERATION_CAMERA = 0x2_000a,
        /// Memory of a context to come.
        FRAME_GENERATION_MEMORY_V2 = 0x2_000b,
        /// Motion, depth and camera of a frame.
        FRAME_GENERATION_PREPARE_V2 = 0x2_000c,
        /// How the interface's alpha is meant.
        FRAME_GENERATION_PREMULTIPLIED = 0x2_000d,
        /// The release that a host was written for.
        FRAME_GENERATION_VERSION = 0x2_000e,
        /// A swapchain that takes over another.
        SWAPCHAIN_WRAP = 0x3_0001,
        /// The interface's picture.
        SWAPCHAIN_INTERFACE = 0x3_0002,
        /// The list to record generation into.
        SWAPCHAIN_COMMAND_LIST = 0x3_0003,
        /// The texture to generate into.
        SWAPCHAIN_TEXTURE = 0x3_0004,
        /// A new swapchain.
        SWAPCHAIN_NEW = 0x3_0005,
        /// A new swapchain of a window.
        SWAPCHAIN_FOR_WINDOW = 0x3_0006,
        /// Wait for what is to be presented.
        SWAPCHAIN_WAIT = 0x3_0007,
        /// A setting by its number.
        SWAPCHAIN_KEY_VALUE = 0x3_0008,
        /// Memory of a context.
        SWAPCHAIN_MEMORY = 0x3_0009,
        /// Memory of a context to come.
        SWAPCHAIN_MEMORY_V2 = 0x3_000a,
        /// The release that a host was written for.
        SWAPCHAIN_VERSION = 0x3_000b,
    }
}

impl StructId {
    /// The effect it belongs to. Bits above are a backend's, which releases of 2026 brought: Direct3D 12 is 0 there.
    pub fn effect(self) -> EffectId {
        EffectId(self.0 & 0x00ff_0000)
    }
}

open_set! {
    /// A part of the interface.
    EffectId: u64 {
        /// What all have in common.
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
    /// What a call answered.
    ReturnCode: u32 {
        /// It is done.
        OK = 0,
        /// It failed; nothing more is said.
        ERROR = 1,
        /// A struct that this call or context does not know.
        UNKNOWN_STRUCT = 2,
        /// Direct3D, or the effect itself, failed.
        RUNTIME_ERROR = 3,
        /// Nothing in the libraries that are there does this.
        NO_PROVIDER = 4,
        /// Memory could not be had.
        MEMORY = 5,
        /// A null pointer, an empty resource, a value outside its set.
        PARAMETER = 6,
        /// A struct newer than the provider. SDK 2.0 and later.
        STRUCT_TOO_NEW = 7,
    }
}

bitflags! {
    /// How a frame generator is made.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct CreateFlags: u32 {
        /// Generation may be recorded into a list of a compute queue.
        const ASYNC_WORKLOAD = 1;
        /// Motion has the size of the picture shown, not the size it was rendered at.
        const DISPLAY_RESOLUTION_MOTION = 2;
        /// Motion holds the jitter.
        const MOTION_JITTER = 4;
        /// 1 is near.
        const DEPTH_INVERTED = 8;
        /// The far plane is nowhere.
        const DEPTH_INFINITE = 16;
        /// Pictures are of high dynamic range.
        const HIGH_DYNAMIC_RANGE = 32;
        /// The provider looks at what it is given and says what it finds.
        const DEBUG_CHECKING = 64;
        const _ = !0;
    }

    /// How a frame is generated.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct FrameFlags: u32 {
        /// Bars at the side that show tearing.
        const TEAR_LINES = 1;
        /// Marks where history was dropped.
        const RESET_INDICATORS = 2;
        /// The generator's own fields in place of a picture.
        const DEBUG_VIEW = 4;
        /// There is no swapchain of AMD's.
        const NO_SWAPCHAIN = 8;
        /// Bars at the side that show when frames are presented.
        const PACING_LINES = 16;
        const _ = !0;
    }

    /// How the interface is laid over frames.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct InterfaceFlags: u32 {
        /// Its colours are multiplied by its alpha.
        const PREMULTIPLIED = 1;
        /// The swapchain keeps a copy, so that the host may draw the next.
        const DOUBLE_BUFFERED = 2;
        const _ = !0;
    }

    /// How an upscaler is made.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct UpscaleCreateFlags: u32 {
        /// Pictures are of high dynamic range.
        const HIGH_DYNAMIC_RANGE = 1;
        /// Motion has the size of the picture shown.
        const DISPLAY_RESOLUTION_MOTION = 2;
        /// Motion holds the jitter.
        const MOTION_JITTER = 4;
        /// 1 is near.
        const DEPTH_INVERTED = 8;
        /// The far plane is nowhere.
        const DEPTH_INFINITE = 16;
        /// Exposure is found in the picture.
        const AUTO_EXPOSURE = 32;
        /// The render size may change from frame to frame.
        const DYNAMIC_RESOLUTION = 64;
        /// The provider looks at what it is given and says what it finds.
        const DEBUG_CHECKING = 128;
        /// Pictures are not linear.
        const NON_LINEAR_COLOR = 256;
        /// The debug view may be asked for.
        const DEBUG_VISUALIZATION = 512;
        const _ = !0;
    }

    /// How a frame is upscaled.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct UpscaleFlags: u32 {
        /// The upscaler's own fields in place of a picture.
        const DEBUG_VIEW = 1;
        /// The picture is in sRGB.
        const COLOR_SRGB = 2;
        /// The picture is in PQ.
        const COLOR_PQ = 4;
        const _ = !0;
    }

    /// How a reactive mask is found.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct ReactiveFlags: u32 {
        /// Compare tone-mapped colours.
        const TONEMAP = 1;
        /// Compare colours with their tone mapping undone.
        const INVERSE_TONEMAP = 2;
        /// The mask is nothing or all.
        const THRESHOLD = 4;
        /// The greatest difference of a channel counts, not the length of all.
        const COMPONENTS_MAX = 8;
        const _ = !0;
    }

    /// Pictures that an upscaler can be given.
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
        /// What not to trust history for.
        const REACTIVE = 16;
        /// Where things are transparent.
        const TRANSPARENCY = 32;
        const _ = !0;
    }

    /// What a resource may be.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct ResourceFlags: u32 {
        /// Its memory may be another's too.
        const ALIASABLE = 1;
        /// What it holds need not be kept.
        const UNDEFINED = 2;
        const _ = !0;
    }

    /// What a resource can be used as, beside being read.
    #[repr(transparent)]
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct ResourceUsage: u32 {
        /// A render target.
        const RENDER_TARGET = 1;
        /// Written by shaders anywhere.
        const UNORDERED_ACCESS = 2;
        /// A depth target.
        const DEPTH_TARGET = 4;
        /// Arguments of draws.
        const INDIRECT = 8;
        /// Seen as an array.
        const ARRAY_VIEW = 16;
        /// A stencil target.
        const STENCIL_TARGET = 32;
        /// A compressed render target.
        const COMPRESSED_RENDER_TARGET = 0x8000;
        const _ = !0;
    }
}

open_set! {
    /// How light became numbers.
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
    /// The shape of a resource.
    ResourceType: u32 {
        /// Bytes.
        BUFFER = 0,
        /// A line.
        TEXTURE_1D = 1,
        /// A picture.
        TEXTURE_2D = 2,
        /// Six pictures.
        TEXTURE_CUBE = 3,
        /// A volume.
        TEXTURE_3D = 4,
    }
}

open_set! {
    /// The size a quality mode renders at.
    QualityMode: u32 {
        /// As it is shown.
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
