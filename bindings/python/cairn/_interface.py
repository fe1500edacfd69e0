"""`include/cairn.h` in ctypes: constants, structs, callbacks and functions, with the header's names without the prefix `cairn_`.

The experimental functions that the package uses are in `EXPERIMENTAL`: they may change within a version of the interface. The others are left out. A
test compares all of it with `abi.txt`.
"""

from __future__ import annotations

from ctypes import (
    CFUNCTYPE,
    POINTER,
    Structure,
    c_char,
    c_char_p,
    c_float,
    c_int32,
    c_size_t,
    c_uint8,
    c_uint16,
    c_uint32,
    c_uint64,
    c_void_p,
    sizeof,
)
from typing import Any

ABI_VERSION = 2
VERSION = 1000

OK = 0
NOT_READY = 1
TRUNCATED = 2
QUEUE_FULL = 3
ERROR_INVALID_ARGUMENT = -1
ERROR_INVALID_HANDLE = -2
ERROR_STRUCT_SIZE = -3
ERROR_BUSY = -4
ERROR_UNSUPPORTED = -5
ERROR_OUT_OF_MEMORY = -6
ERROR_IO = -7
ERROR_INVALID_BUNDLE = -8
ERROR_RUNTIME_MISSING = -9
ERROR_DEVICE = -10
ERROR_INVALID_STATE = -11
ERROR_CANCELLED = -12
ERROR_POISONED = -13
ERROR_INTERNAL = -14
ERROR_DEVICE_REMOVED = -15

LAST_ERROR_FUNCTION = 1
LAST_ERROR_FIELD = 2
LAST_ERROR_CAUSE = 3
LAST_ERROR_REMEDY = 4

LOG_OFF = 0
LOG_ERROR = 1
LOG_WARNING = 2
LOG_INFO = 3
LOG_DEBUG = 4
LOG_TRACE = 5

PRIORITY_BELOW_NORMAL = 0
PRIORITY_NORMAL = 1
PRIORITY_LOWEST = 2
MAX_THREADS = 1024

DEVICE_CPU = 1
DEVICE_D3D12 = 2
DEVICE_WEBGPU = 3
PRECISION_F32 = 1
PRECISION_F16 = 2
DEVICE_DETERMINISTIC = 1
DEVICE_ENVIRONMENT = 2

REQUIREMENT_PLATFORM = 1
REQUIREMENT_ONNXRUNTIME = 2
REQUIREMENT_MEMORY = 3
REQUIREMENT_FSR_LIBRARIES = 4
REQUIREMENT_FSR_PROVIDER = 5
REQUIREMENT_FSR_SYSTEM = 6
REQUIREMENT_FSR_DIRECT3D = 7
REQUIREMENT_FSR_SHADER_MODEL = 8
REQUIREMENT_SHADERS = 9
REQUIREMENT_WEBGPU = 10
REQUIREMENT_ADAPTER = 11
REQUIREMENT_MET = 1
REQUIREMENT_NOT_MET = 2
REQUIREMENT_UNKNOWN = 3
REQUIREMENT_OPTIONAL = 4

LOAD_READING = 1
LOAD_PREPARING = 2
WORLD_FIT_WINDOW = 1
WORLD_CHECK_PRECISION = 2
FORMAT_RGBA8 = 0
FORMAT_BGRA8 = 1
FORMAT_RGBA16F = 2
FORMAT_RGB10A2 = 3
MAX_QUEUE = 64
STEP_COMMITTED = 1
FOREVER = 0xFFFFFFFFFFFFFFFF
ANCHOR_CUT = 1

MOTION_AUTO = 0
MOTION_PICTURES = 1
MOTION_PAPER = 2
MOTION_LATENTS = 3
DEPTH_INVERTED = 1
DEPTH_LINEAR = 2

PREFER_AUTO = 0
PREFER_REQUIRE = 1
PREFER_NEVER = 2
PRESENTER_HOLD_LATE = 1
PRESENTER_CATCH_UP = 2
PRESENTER_NO_DECODED = 4
PRESENTER_LETTERBOX = 8
COLOUR_SRGB = 0
COLOUR_LINEAR = 1
COLOUR_SCRGB = 2
COLOUR_HDR10 = 3
FRAME_ANCHOR = 1
FRAME_DECODED = 2
FRAME_GENERATED = 3
FRAME_EXTRAPOLATED = 4
FRAME_HELD = 5
FRAME_CUT = 1
FRAME_REPEATED = 2
FRAME_UNPREPARED = 4

MAX_LISTS = 16
PREPARE_SUBMIT_ONLY = 1

D3D12_DETERMINISTIC = 1

FSR_ANY = 0
FSR_PREFER_ML = 1
FSR_PREFER_ANALYTIC = 2
FSR_REQUIRE_ML = 3
FSR_REQUIRE_ANALYTIC = 4
SWAPCHAIN_ASYNC = 1
SWAPCHAIN_SHOWN_MOTION = 2
SWAPCHAIN_JITTERED_MOTION = 4
SWAPCHAIN_INVERTED_DEPTH = 8
SWAPCHAIN_INFINITE_DEPTH = 16
SWAPCHAIN_HDR = 32
SWAPCHAIN_CHECKED = 64
SWAPCHAIN_UNTRIED = 128
SWAPCHAIN_RESET = 1
INTERFACE_PREMULTIPLIED = 1
INTERFACE_COPIED = 2
MAX_BUDGET_WORLDS = 8
PACING_HYBRID_SPIN = 1
PACING_WAIT_ON_FENCE = 2


def _each(kind: Any, names: str) -> list[tuple[str, Any]]:
    """Consecutive fields of one type."""
    return [(name, kind) for name in names.split()]


class Sized(Structure):
    """A struct that begins with its size. The constructor sets the size; fields that are not given are zero."""

    def __init__(self, **fields: Any) -> None:
        super().__init__(struct_size=sizeof(type(self)), **fields)


class DeviceOptions(Sized):
    _fields_ = [*_each(c_uint32, "struct_size threads flags reserved"), *_each(c_char_p, "onnxruntime ffx webgpu")]


class DeviceInfo(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size kind precision threads"),
        ("description", c_char * 128),
        *_each(c_uint32, "memory_budget_mib memory_used_mib"),
    ]


class Adapter(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size kind index reserved"),
        *_each(c_uint64, "luid memory"),
        ("name", c_char * 128),
    ]


class Requirement(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size what status reserved"),
        ("needed", c_char * 96),
        ("found", c_char * 512),
    ]


class LoadProgress(Sized):
    _fields_ = [*_each(c_uint32, "struct_size stage"), *_each(c_uint64, "done total")]


load_callback = CFUNCTYPE(c_uint32, POINTER(LoadProgress), c_void_p)
log_callback = CFUNCTYPE(None, c_uint32, c_char_p, c_char_p, c_void_p)
job = CFUNCTYPE(None, c_void_p)
run_callback = CFUNCTYPE(None, c_void_p, c_uint32, job, c_void_p)
pipelines_load_callback = CFUNCTYPE(c_uint64, c_void_p, c_uint64, c_void_p)
pipelines_store_callback = CFUNCTYPE(None, c_void_p, c_uint64, c_void_p)


class ThreadOptions(Sized):
    _fields_ = _each(c_uint32, "struct_size threads priority reserved")


class Scheduler(Sized):
    _fields_ = [*_each(c_uint32, "struct_size concurrency"), ("run", run_callback), ("user", c_void_p)]


class WorldOptions(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size precision"),
        *_each(c_char_p, "path operating_point"),
        ("memory_limit", c_uint64),
        ("progress", load_callback),
        ("user", c_void_p),
        *_each(c_uint32, "flags reserved slices longest_submission_us"),
    ]


class WorldInfo(Sized):
    _fields_ = [
        *_each(
            c_uint32,
            "struct_size precision render_width render_height decoded_width decoded_height latent_channels "
            "latent_height latent_width tokens layers pictures_per_latent local_window global_window "
            "max_global_window global_dilation latents_per_second keys",
        ),
        ("name", c_char * 128),
        ("licence", c_char * 64),
        ("digest", c_char * 72),
        *_each(c_uint32, "slices longest_slice_us"),
    ]


class WorldMemory(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size reserved"),
        *_each(c_uint64, "bundle weights ring slabs intermediates autoencoder arena total"),
    ]


class Picture(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size format width height"),
        ("pixels", c_void_p),
        *_each(c_uint64, "size row_pitch"),
    ]


class Target(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("format", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("pixels", c_void_p),
        ("size", c_uint64),
        ("row_pitch", c_uint64),
    ]


class Controls(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("mouse_dx", c_float),
        ("mouse_dy", c_float),
        ("scroll", c_float),
        ("keys", c_uint64 * 4),
    ]


class AnchorInfo(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("flags", c_uint32),
        ("latent", c_uint64),
        *_each(c_uint32, "latents_per_second pictures width height latent_channels latent_height latent_width reserved"),
    ]


class RolloutOptions(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("queue_capacity", c_uint32),
        ("seed", c_uint64),
        ("operating_point", c_char_p),
    ]


class RolloutInfo(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("pictures_per_latent", c_uint32),
        ("latents", c_uint64),
        ("seed", c_uint64),
        ("latents_per_second", c_uint32),
        ("presented_rate", c_uint32),
        ("operating_point", c_char * 192),
    ]


class StepInfo(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("flags", c_uint32),
        ("latent", c_uint64),
        ("denoise_passes", c_uint32),
        ("cache_passes", c_uint32),
        *_each(c_uint64, "encode_ns denoise_ns cache_ns commit_ns decode_ns ring_bytes"),
    ]


class RolloutStatistics(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("queue_depth", c_uint32),
        *_each(
            c_uint64,
            "latents denoise_passes cache_passes decode_passes encode_ns denoise_ns cache_ns commit_ns decode_ns "
            "resize_ns uploaded_bytes copied_bytes read_bytes ring_bytes device_passes device_passes_ns "
            "device_pass_longest_ns device_decodes device_decodes_ns device_decode_longest_ns device_commits "
            "device_commits_ns runtime_ns waited_ns yields",
        ),
        ("captured_passes", c_uint32),
        ("other_passes", c_uint32),
        *_each(
            c_uint64,
            "governed_frame_ns governed_latents governed_frames governed_less governed_more governed_short_of_memory "
            "governed_beyond",
        ),
        *_each(c_uint32, "governed_passes governed_window governed_made reserved"),
    ]


class Budget(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("multiplier", c_uint32),
        ("frame_ns", c_uint64),
        ("memory_mib", c_uint64),
        ("schedules", c_char_p),
        ("worlds", POINTER(c_void_p)),
        ("world_count", c_uint32),
        ("reserved", c_uint32),
        ("presenter", c_void_p),
    ]


class D3d12Options(Sized):
    _fields_ = _each(c_uint32, "struct_size flags captured_passes longest_submission_us")


class D3d12Preparation(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size format width height anchor_width anchor_height anchor_pictures"),
        *_each(c_uint32, "latent_channels latent_height latent_width lists flags"),
        ("load", pipelines_load_callback),
        ("store", pipelines_store_callback),
        ("user", c_void_p),
    ]


class D3d12Recording(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size state_before state_after reserved"),
        *_each(c_void_p, "list target fence"),
        ("fence_value", c_uint64),
    ]


class SwapchainOptions(Sized):
    _fields_ = _each(c_uint32, "struct_size flags provider hudless_format max_render_width max_render_height")


class SwapchainFrame(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("flags", c_uint32),
        ("depth", c_void_p),
        ("motion", c_void_p),
        ("hudless", c_void_p),
        ("distortion", c_void_p),
        *_each(
            c_uint32,
            "depth_state motion_state hudless_state distortion_state render_width render_height world_left "
            "world_top world_width world_height",
        ),
        *_each(
            c_float,
            "jitter_x jitter_y motion_scale_x motion_scale_y frame_time_ms vertical_fov near_plane far_plane "
            "metres",
        ),
        ("position", c_float * 3),
        ("up", c_float * 3),
        ("right", c_float * 3),
        ("forward", c_float * 3),
        ("reserved", c_uint32),
    ]


class SwapchainPacing(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("flags", c_uint32),
        ("safety_margin_ms", c_float),
        ("variance_factor", c_float),
        ("spin_ticks", c_uint32),
    ]


class SwapchainStatistics(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("failed", c_uint32),
        ("generated", c_uint64),
        ("generator_bytes", c_uint64),
        ("generator_aliasable_bytes", c_uint64),
        ("swapchain_bytes", c_uint64),
        ("swapchain_aliasable_bytes", c_uint64),
        ("generator", c_char * 64),
        ("pacer", c_char * 64),
        ("repeated", c_uint64),
    ]


class GuidanceData(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("flags", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("motion", c_void_p),
        ("motion_count", c_uint64),
        ("depth", c_void_p),
        ("depth_count", c_uint64),
        ("near_plane", c_float),
        ("far_plane", c_float),
        ("vertical_fov", c_float),
        ("reserved", c_uint32),
    ]


class GuidanceInfo(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("near_plane", c_float),
        ("far_plane", c_float),
        ("vertical_fov", c_float),
    ]


class PresenterOptions(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("multiplier", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("interval_ns", c_uint64),
        ("delay_ns", c_uint64),
        *_each(
            c_uint32,
            "flags capacity motion colour_space fsr shader cpu reserved white_nits reserved_too upscaler "
            "reserved_also",
        ),
    ]


class Frame(Sized):
    _fields_ = [
        ("struct_size", c_uint32),
        ("source", c_uint32),
        ("position", c_uint64),
        ("since_ns", c_uint64),
        ("until_ns", c_uint64),
        ("previous", c_uint64),
        ("current", c_uint64),
        ("t", c_float),
        ("flags", c_uint32),
    ]


class PresenterStatistics(Sized):
    _fields_ = [
        *_each(c_uint32, "struct_size reserved"),
        *_each(
            c_uint64,
            "anchors late_anchors slipped_ns shown_anchors shown_decoded shown_generated shown_extrapolated "
            "shown_held repeated cuts guidance_ns generate_ns resize_ns",
        ),
        ("generator", c_char * 32),
        ("preference", c_char * 160),
        ("waiting", c_uint32),
        ("under_way", c_uint32),
        *_each(
            c_uint64,
            "device_frames device_frames_ns device_frame_longest_ns device_frame_last_ns device_lists "
            "device_lists_ns device_list_longest_ns",
        ),
        ("made_to_anchor", c_uint32),
        ("budget_changes", c_uint32),
        ("upscaler", c_char * 32),
        ("upscaling", c_char * 160),
        *_each(c_uint64, "unprepared objects_made"),
        *_each(c_uint32, "lists_pending anchors_under_way"),
    ]


# A handle is an opaque number.
_handle = c_void_p
_new = POINTER(c_void_p)
_text = c_char_p
_length = POINTER(c_size_t)
_count = POINTER(c_uint32)
_ticket = POINTER(c_uint64)

# Functions of a library of exactly this version.
EXPERIMENTAL = frozenset({"device_create_gpu", "device_create_auto"})

# Parameter types of every function. Each returns a result unless RETURNS says otherwise.
FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "abi_version": (),
    "version": (),
    "result_name": (c_int32,),
    "last_error": (_text, c_size_t, _length),
    "last_error_part": (c_uint32, _text, c_size_t, _length),
    "set_log_callback": (c_uint32, log_callback, c_void_p),
    "set_threads": (POINTER(ThreadOptions),),
    "set_scheduler": (POINTER(Scheduler),),
    "device_create_cpu": (POINTER(DeviceOptions), _new),
    "device_create_gpu": (c_char_p, POINTER(DeviceOptions), _new),
    "device_create_auto": (POINTER(DeviceOptions), _text, c_size_t, _length, _new),
    "device_get_info": (_handle, POINTER(DeviceInfo)),
    "device_destroy": (_handle,),
    "adapters": (POINTER(Adapter), c_size_t, c_uint32, _count),
    "device_requirements": (c_uint32, POINTER(DeviceOptions), POINTER(Requirement), c_size_t, c_uint32, _count),
    "world_load": (_handle, POINTER(WorldOptions), _new),
    "world_get_info": (_handle, POINTER(WorldInfo)),
    "world_get_memory": (_handle, POINTER(WorldMemory)),
    "world_get_licence": (_handle, _text, c_size_t, _length),
    "world_destroy": (_handle,),
    "anchor_create": (POINTER(Picture), c_uint64, c_uint32, _new),
    "anchor_get_info": (_handle, POINTER(AnchorInfo)),
    "anchor_read_picture": (_handle, c_uint32, POINTER(Target)),
    "anchor_read_latent": (_handle, POINTER(c_float), c_size_t),
    "anchor_destroy": (_handle,),
    "rollout_create": (_handle, POINTER(RolloutOptions), _new),
    "rollout_destroy": (_handle,),
    "rollout_get_info": (_handle, POINTER(RolloutInfo)),
    "rollout_append": (_handle, POINTER(Picture), POINTER(StepInfo)),
    "rollout_append_pictures": (_handle, POINTER(Picture), c_uint32, POINTER(StepInfo)),
    "rollout_keep_encoder_stream": (_handle, c_uint32),
    "rollout_rest": (_handle,),
    "rollout_step": (_handle, POINTER(Controls), POINTER(StepInfo)),
    "rollout_set_budget": (_handle, c_uint64, _text),
    "rollout_govern": (_handle, POINTER(Budget)),
    "rollout_reset": (_handle,),
    "rollout_get_anchor": (_handle, _new),
    "rollout_submit": (_handle, POINTER(Controls), _ticket),
    "rollout_submit_picture": (_handle, POINTER(Picture), _ticket),
    "rollout_submit_pictures": (_handle, POINTER(Picture), c_uint32, _ticket),
    "rollout_poll": (_handle, c_uint64, POINTER(StepInfo), _new),
    "rollout_wait": (_handle, c_uint64, c_uint64, POINTER(StepInfo), _new),
    "rollout_cancel": (_handle,),
    "rollout_pause": (_handle,),
    "rollout_resume": (_handle,),
    "rollout_single_step": (_handle,),
    "rollout_save": (_handle, c_void_p, c_size_t, _length),
    "rollout_save_file": (_handle, _text),
    "rollout_restore": (_handle, c_void_p, c_size_t),
    "rollout_restore_file": (_handle, _text),
    "guidance_create": (_handle, _handle, c_uint32, _new),
    "guidance_create_from_host": (POINTER(GuidanceData), _new),
    "guidance_get_info": (_handle, POINTER(GuidanceInfo)),
    "guidance_read_motion": (_handle, POINTER(c_uint16), c_size_t),
    "guidance_read_depth": (_handle, POINTER(c_float), c_size_t),
    "guidance_destroy": (_handle,),
    "presenter_create": (POINTER(PresenterOptions), _new),
    "presenter_push": (_handle, _handle, _handle, c_uint64),
    "presenter_query": (_handle, c_uint64, POINTER(Frame)),
    "presenter_draw": (_handle, c_uint64, POINTER(Target), POINTER(Frame)),
    "presenter_resize": (_handle, c_uint32, c_uint32),
    "presenter_set_overlay": (_handle, POINTER(c_uint8), c_size_t, c_uint32, c_uint32),
    "presenter_set_budget": (_handle, c_uint64),
    "presenter_reset": (_handle,),
    "presenter_get_statistics": (_handle, POINTER(PresenterStatistics)),
    "presenter_destroy": (_handle,),
    "script_create": (_text, c_size_t, _new),
    "script_get_controls": (_handle, c_uint64, c_uint32, POINTER(Controls)),
    "script_get_duration": (_handle, POINTER(c_uint64)),
    "script_get_text": (_handle, _text, c_size_t, _length),
    "script_destroy": (_handle,),
    "recorder_create": (_new,),
    "recorder_key": (_handle, c_uint64, c_uint32, c_uint32),
    "recorder_mouse": (_handle, c_uint64, c_float, c_float),
    "recorder_scroll": (_handle, c_uint64, c_int32),
    "recorder_step": (_handle, c_uint64, c_uint32, POINTER(Controls)),
    "recorder_make_script": (_handle, c_uint64, _new),
    "recorder_destroy": (_handle,),
    "rollout_get_statistics": (_handle, POINTER(RolloutStatistics)),
}

RETURNS: dict[str, Any] = {"abi_version": c_uint32, "version": c_uint32, "result_name": c_char_p}
