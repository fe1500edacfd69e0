// Made from include/cairn.h by `cargo xtask fix`; changes here are lost.

using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    // The library writes the fields that nothing here does.
#pragma warning disable 169, 649
    /// <summary>
    /// The C interface: constants, structs, callbacks and functions by their names in cairn.h, without "cairn_". The experimental
    /// chapters are left out: they may change within a version of the interface.
    /// </summary>
    internal static unsafe class Native
    {
        internal const int ABI_VERSION = 2;
        internal const int VERSION = 1000;
        internal const int LAST_ERROR_FUNCTION = 1;
        internal const int LAST_ERROR_FIELD = 2;
        internal const int LAST_ERROR_CAUSE = 3;
        internal const int LAST_ERROR_REMEDY = 4;
        internal const int OK = 0;
        internal const int NOT_READY = 1;
        internal const int TRUNCATED = 2;
        internal const int QUEUE_FULL = 3;
        internal const int ERROR_INVALID_ARGUMENT = -1;
        internal const int ERROR_INVALID_HANDLE = -2;
        internal const int ERROR_STRUCT_SIZE = -3;
        internal const int ERROR_BUSY = -4;
        internal const int ERROR_UNSUPPORTED = -5;
        internal const int ERROR_OUT_OF_MEMORY = -6;
        internal const int ERROR_IO = -7;
        internal const int ERROR_INVALID_BUNDLE = -8;
        internal const int ERROR_RUNTIME_MISSING = -9;
        internal const int ERROR_DEVICE = -10;
        internal const int ERROR_INVALID_STATE = -11;
        internal const int ERROR_CANCELLED = -12;
        internal const int ERROR_POISONED = -13;
        internal const int ERROR_INTERNAL = -14;
        internal const int ERROR_DEVICE_REMOVED = -15;
        internal const int LOG_OFF = 0;
        internal const int LOG_ERROR = 1;
        internal const int LOG_WARNING = 2;
        internal const int LOG_INFO = 3;
        internal const int LOG_DEBUG = 4;
        internal const int LOG_TRACE = 5;
        internal const int PRIORITY_BELOW_NORMAL = 0;
        internal const int PRIORITY_NORMAL = 1;
        internal const int PRIORITY_LOWEST = 2;
        internal const int MAX_THREADS = 1024;
        internal const int DEVICE_CPU = 1;
        internal const int DEVICE_D3D12 = 2;
        internal const int DEVICE_WEBGPU = 3;
        internal const int PRECISION_F32 = 1;
        internal const int PRECISION_F16 = 2;
        internal const int DEVICE_DETERMINISTIC = 1;
        internal const int DEVICE_ENVIRONMENT = 2;
        internal const int REQUIREMENT_PLATFORM = 1;
        internal const int REQUIREMENT_ONNXRUNTIME = 2;
        internal const int REQUIREMENT_MEMORY = 3;
        internal const int REQUIREMENT_FSR_LIBRARIES = 4;
        internal const int REQUIREMENT_FSR_PROVIDER = 5;
        internal const int REQUIREMENT_FSR_SYSTEM = 6;
        internal const int REQUIREMENT_FSR_DIRECT3D = 7;
        internal const int REQUIREMENT_FSR_SHADER_MODEL = 8;
        internal const int REQUIREMENT_SHADERS = 9;
        internal const int REQUIREMENT_WEBGPU = 10;
        internal const int REQUIREMENT_ADAPTER = 11;
        internal const int REQUIREMENT_MET = 1;
        internal const int REQUIREMENT_NOT_MET = 2;
        internal const int REQUIREMENT_UNKNOWN = 3;
        internal const int REQUIREMENT_OPTIONAL = 4;
        internal const int LOAD_READING = 1;
        internal const int LOAD_PREPARING = 2;
        internal const int WORLD_FIT_WINDOW = 1;
        internal const int WORLD_CHECK_PRECISION = 2;
        internal const int FORMAT_RGBA8 = 0;
        internal const int FORMAT_BGRA8 = 1;
        internal const int FORMAT_RGBA16F = 2;
        internal const int FORMAT_RGB10A2 = 3;
        internal const int ANCHOR_CUT = 1;
        internal const int MAX_QUEUE = 64;
        internal const int STEP_COMMITTED = 1;
        internal const ulong FOREVER = ulong.MaxValue;
        internal const int MOTION_AUTO = 0;
        internal const int MOTION_PICTURES = 1;
        internal const int MOTION_PAPER = 2;
        internal const int MOTION_LATENTS = 3;
        internal const int DEPTH_INVERTED = 1;
        internal const int DEPTH_LINEAR = 2;
        internal const int PREFER_AUTO = 0;
        internal const int PREFER_REQUIRE = 1;
        internal const int PREFER_NEVER = 2;
        internal const int PRESENTER_HOLD_LATE = 1;
        internal const int PRESENTER_CATCH_UP = 2;
        internal const int PRESENTER_NO_DECODED = 4;
        internal const int PRESENTER_LETTERBOX = 8;
        internal const int COLOUR_SRGB = 0;
        internal const int COLOUR_LINEAR = 1;
        internal const int COLOUR_SCRGB = 2;
        internal const int COLOUR_HDR10 = 3;
        internal const int FRAME_ANCHOR = 1;
        internal const int FRAME_DECODED = 2;
        internal const int FRAME_GENERATED = 3;
        internal const int FRAME_EXTRAPOLATED = 4;
        internal const int FRAME_HELD = 5;
        internal const int FRAME_CUT = 1;
        internal const int FRAME_REPEATED = 2;
        internal const int FRAME_UNPREPARED = 4;
        internal const int MAX_BUDGET_WORLDS = 8;
        internal const int D3D12_DETERMINISTIC = 1;
        internal const int MAX_LISTS = 16;
        internal const int PREPARE_SUBMIT_ONLY = 1;
        internal const int FSR_ANY = 0;
        internal const int FSR_PREFER_ML = 1;
        internal const int FSR_PREFER_ANALYTIC = 2;
        internal const int FSR_REQUIRE_ML = 3;
        internal const int FSR_REQUIRE_ANALYTIC = 4;
        internal const int SWAPCHAIN_ASYNC = 1;
        internal const int SWAPCHAIN_SHOWN_MOTION = 2;
        internal const int SWAPCHAIN_JITTERED_MOTION = 4;
        internal const int SWAPCHAIN_INVERTED_DEPTH = 8;
        internal const int SWAPCHAIN_INFINITE_DEPTH = 16;
        internal const int SWAPCHAIN_HDR = 32;
        internal const int SWAPCHAIN_CHECKED = 64;
        internal const int SWAPCHAIN_UNTRIED = 128;
        internal const int SWAPCHAIN_RESET = 1;
        internal const int INTERFACE_PREMULTIPLIED = 1;
        internal const int INTERFACE_COPIED = 2;
        internal const int PACING_HYBRID_SPIN = 1;
        internal const int PACING_WAIT_ON_FENCE = 2;

        [StructLayout(LayoutKind.Sequential)]
        internal struct thread_options
        {
            internal uint struct_size;
            internal uint threads;
            internal uint priority;
            internal uint reserved;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct scheduler
        {
            internal uint struct_size;
            internal uint concurrency;
            internal IntPtr run;
            internal void* user;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct device_options
        {
            internal uint struct_size;
            internal uint threads;
            internal uint flags;
            internal uint reserved;
            internal byte* onnxruntime;
            internal byte* ffx;
            internal byte* webgpu;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct device_info
        {
            internal uint struct_size;
            internal uint kind;
            internal uint precision;
            internal uint threads;
            internal fixed byte description[128];
            internal uint memory_budget_mib;
            internal uint memory_used_mib;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct adapter
        {
            internal uint struct_size;
            internal uint kind;
            internal uint index;
            internal uint reserved;
            internal ulong luid;
            internal ulong memory;
            internal fixed byte name[128];
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct requirement
        {
            internal uint struct_size;
            internal uint what;
            internal uint status;
            internal uint reserved;
            internal fixed byte needed[96];
            internal fixed byte found[512];
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct load_progress
        {
            internal uint struct_size;
            internal uint stage;
            internal ulong done;
            internal ulong total;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct world_options
        {
            internal uint struct_size;
            internal uint precision;
            internal byte* path;
            internal byte* operating_point;
            internal ulong memory_limit;
            internal IntPtr progress;
            internal void* user;
            internal uint flags;
            internal uint reserved;
            internal uint slices;
            internal uint longest_submission_us;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct world_info
        {
            internal uint struct_size;
            internal uint precision;
            internal uint render_width;
            internal uint render_height;
            internal uint decoded_width;
            internal uint decoded_height;
            internal uint latent_channels;
            internal uint latent_height;
            internal uint latent_width;
            internal uint tokens;
            internal uint layers;
            internal uint pictures_per_latent;
            internal uint local_window;
            internal uint global_window;
            internal uint max_global_window;
            internal uint global_dilation;
            internal uint latents_per_second;
            internal uint keys;
            internal fixed byte name[128];
            internal fixed byte licence[64];
            internal fixed byte digest[72];
            internal uint slices;
            internal uint longest_slice_us;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct world_memory
        {
            internal uint struct_size;
            internal uint reserved;
            internal ulong bundle;
            internal ulong weights;
            internal ulong ring;
            internal ulong slabs;
            internal ulong intermediates;
            internal ulong autoencoder;
            internal ulong arena;
            internal ulong total;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct picture
        {
            internal uint struct_size;
            internal uint format;
            internal uint width;
            internal uint height;
            internal void* pixels;
            internal ulong size;
            internal ulong row_pitch;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct target
        {
            internal uint struct_size;
            internal uint format;
            internal uint width;
            internal uint height;
            internal void* pixels;
            internal ulong size;
            internal ulong row_pitch;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct controls
        {
            internal uint struct_size;
            internal float mouse_dx;
            internal float mouse_dy;
            internal float scroll;
            internal fixed ulong keys[4];
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct anchor_info
        {
            internal uint struct_size;
            internal uint flags;
            internal ulong latent;
            internal uint latents_per_second;
            internal uint pictures;
            internal uint width;
            internal uint height;
            internal uint latent_channels;
            internal uint latent_height;
            internal uint latent_width;
            internal uint reserved;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct rollout_options
        {
            internal uint struct_size;
            internal uint queue_capacity;
            internal ulong seed;
            internal byte* operating_point;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct rollout_info
        {
            internal uint struct_size;
            internal uint pictures_per_latent;
            internal ulong latents;
            internal ulong seed;
            internal uint latents_per_second;
            internal uint presented_rate;
            internal fixed byte operating_point[192];
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct step_info
        {
            internal uint struct_size;
            internal uint flags;
            internal ulong latent;
            internal uint denoise_passes;
            internal uint cache_passes;
            internal ulong encode_ns;
            internal ulong denoise_ns;
            internal ulong cache_ns;
            internal ulong commit_ns;
            internal ulong decode_ns;
            internal ulong ring_bytes;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct guidance_data
        {
            internal uint struct_size;
            internal uint flags;
            internal uint width;
            internal uint height;
            internal ushort* motion;
            internal ulong motion_count;
            internal float* depth;
            internal ulong depth_count;
            internal float near_plane;
            internal float far_plane;
            internal float vertical_fov;
            internal uint reserved;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct guidance_info
        {
            internal uint struct_size;
            internal uint width;
            internal uint height;
            internal float near_plane;
            internal float far_plane;
            internal float vertical_fov;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct presenter_options
        {
            internal uint struct_size;
            internal uint multiplier;
            internal uint width;
            internal uint height;
            internal ulong interval_ns;
            internal ulong delay_ns;
            internal uint flags;
            internal uint capacity;
            internal uint motion;
            internal uint colour_space;
            internal uint fsr;
            internal uint shader;
            internal uint cpu;
            internal uint reserved;
            internal uint white_nits;
            internal uint reserved_too;
            internal uint upscaler;
            internal uint reserved_also;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct frame
        {
            internal uint struct_size;
            internal uint source;
            internal ulong position;
            internal ulong since_ns;
            internal ulong until_ns;
            internal ulong previous;
            internal ulong current;
            internal float t;
            internal uint flags;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct budget
        {
            internal uint struct_size;
            internal uint multiplier;
            internal ulong frame_ns;
            internal ulong memory_mib;
            internal byte* schedules;
            internal IntPtr* worlds;
            internal uint world_count;
            internal uint reserved;
            internal IntPtr presenter;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct rollout_statistics
        {
            internal uint struct_size;
            internal uint queue_depth;
            internal ulong latents;
            internal ulong denoise_passes;
            internal ulong cache_passes;
            internal ulong decode_passes;
            internal ulong encode_ns;
            internal ulong denoise_ns;
            internal ulong cache_ns;
            internal ulong commit_ns;
            internal ulong decode_ns;
            internal ulong resize_ns;
            internal ulong uploaded_bytes;
            internal ulong copied_bytes;
            internal ulong read_bytes;
            internal ulong ring_bytes;
            internal ulong device_passes;
            internal ulong device_passes_ns;
            internal ulong device_pass_longest_ns;
            internal ulong device_decodes;
            internal ulong device_decodes_ns;
            internal ulong device_decode_longest_ns;
            internal ulong device_commits;
            internal ulong device_commits_ns;
            internal ulong runtime_ns;
            internal ulong waited_ns;
            internal ulong yields;
            internal uint captured_passes;
            internal uint other_passes;
            internal ulong governed_frame_ns;
            internal ulong governed_latents;
            internal ulong governed_frames;
            internal ulong governed_less;
            internal ulong governed_more;
            internal ulong governed_short_of_memory;
            internal ulong governed_beyond;
            internal uint governed_passes;
            internal uint governed_window;
            internal uint governed_made;
            internal uint reserved;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct presenter_statistics
        {
            internal uint struct_size;
            internal uint reserved;
            internal ulong anchors;
            internal ulong late_anchors;
            internal ulong slipped_ns;
            internal ulong shown_anchors;
            internal ulong shown_decoded;
            internal ulong shown_generated;
            internal ulong shown_extrapolated;
            internal ulong shown_held;
            internal ulong repeated;
            internal ulong cuts;
            internal ulong guidance_ns;
            internal ulong generate_ns;
            internal ulong resize_ns;
            internal fixed byte generator[32];
            internal fixed byte preference[160];
            internal uint waiting;
            internal uint under_way;
            internal ulong device_frames;
            internal ulong device_frames_ns;
            internal ulong device_frame_longest_ns;
            internal ulong device_frame_last_ns;
            internal ulong device_lists;
            internal ulong device_lists_ns;
            internal ulong device_list_longest_ns;
            internal uint made_to_anchor;
            internal uint budget_changes;
            internal fixed byte upscaler[32];
            internal fixed byte upscaling[160];
            internal ulong unprepared;
            internal ulong objects_made;
            internal uint lists_pending;
            internal uint anchors_under_way;
        }

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate void log_callback(uint level, byte* target, byte* message, void* user);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate void job(void* data);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate void run_callback(void* user, uint jobs, IntPtr job, void* data);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate uint load_callback(load_progress* progress, void* user);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate ulong pipelines_load_callback(void* bytes, ulong capacity, void* user);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate void pipelines_store_callback(void* bytes, ulong size, void* user);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate uint abi_version_function();

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate uint version_function();

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate byte* result_name_function(int result);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int last_error_function(byte* text, UIntPtr capacity, UIntPtr* length);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int last_error_part_function(uint part, byte* text, UIntPtr capacity, UIntPtr* length);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int set_log_callback_function(uint level, IntPtr callback, void* user);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int set_threads_function(thread_options* options);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int set_scheduler_function(scheduler* scheduler);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int device_create_cpu_function(device_options* options, IntPtr* device);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int device_create_gpu_function(byte* adapter, device_options* options, IntPtr* device);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int device_create_auto_function(device_options* options, byte* refusals, UIntPtr capacity, UIntPtr* length, IntPtr* device);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int device_get_info_function(IntPtr device, device_info* info);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int device_destroy_function(IntPtr device);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int adapters_function(adapter* adapters, UIntPtr stride, uint capacity, uint* count);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int device_requirements_function(uint kind, device_options* options, requirement* requirements, UIntPtr stride, uint capacity, uint* count);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int world_load_function(IntPtr device, world_options* options, IntPtr* world);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int world_get_info_function(IntPtr world, world_info* info);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int world_get_memory_function(IntPtr world, world_memory* memory);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int world_get_licence_function(IntPtr world, byte* text, UIntPtr capacity, UIntPtr* length);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int world_destroy_function(IntPtr world);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int anchor_create_function(picture* picture, ulong number, uint flags, IntPtr* anchor);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int anchor_get_info_function(IntPtr anchor, anchor_info* info);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int anchor_read_picture_function(IntPtr anchor, uint index, target* target);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int anchor_read_latent_function(IntPtr anchor, float* values, UIntPtr count);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int anchor_destroy_function(IntPtr anchor);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_create_function(IntPtr world, rollout_options* options, IntPtr* rollout);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_destroy_function(IntPtr rollout);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_get_info_function(IntPtr rollout, rollout_info* info);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_append_function(IntPtr rollout, picture* picture, step_info* info);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_append_pictures_function(IntPtr rollout, picture* pictures, uint count, step_info* info);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_keep_encoder_stream_function(IntPtr rollout, uint keep);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_step_function(IntPtr rollout, controls* controls, step_info* info);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_reset_function(IntPtr rollout);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_rest_function(IntPtr rollout);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_set_budget_function(IntPtr rollout, ulong latent_ns, byte* schedules);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_get_anchor_function(IntPtr rollout, IntPtr* anchor);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_submit_function(IntPtr rollout, controls* controls, ulong* ticket);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_submit_picture_function(IntPtr rollout, picture* picture, ulong* ticket);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_submit_pictures_function(IntPtr rollout, picture* pictures, uint count, ulong* ticket);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_poll_function(IntPtr rollout, ulong ticket, step_info* info, IntPtr* anchor);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_wait_function(IntPtr rollout, ulong ticket, ulong timeout_ns, step_info* info, IntPtr* anchor);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_cancel_function(IntPtr rollout);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_pause_function(IntPtr rollout);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_resume_function(IntPtr rollout);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_single_step_function(IntPtr rollout);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_save_function(IntPtr rollout, void* bytes, UIntPtr capacity, UIntPtr* size);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_save_file_function(IntPtr rollout, byte* path);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_restore_function(IntPtr rollout, void* bytes, UIntPtr size);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_restore_file_function(IntPtr rollout, byte* path);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int guidance_create_function(IntPtr previous, IntPtr current, uint source, IntPtr* guidance);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int guidance_create_from_host_function(guidance_data* data, IntPtr* guidance);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int guidance_get_info_function(IntPtr guidance, guidance_info* info);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int guidance_read_motion_function(IntPtr guidance, ushort* values, UIntPtr count);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int guidance_read_depth_function(IntPtr guidance, float* values, UIntPtr count);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int guidance_destroy_function(IntPtr guidance);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_create_function(presenter_options* options, IntPtr* presenter);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_push_function(IntPtr presenter, IntPtr anchor, IntPtr guidance, ulong now_ns);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_query_function(IntPtr presenter, ulong now_ns, frame* frame);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_draw_function(IntPtr presenter, ulong now_ns, target* target, frame* frame);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_resize_function(IntPtr presenter, uint width, uint height);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_set_overlay_function(IntPtr presenter, byte* mask, UIntPtr size, uint width, uint height);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_set_budget_function(IntPtr presenter, ulong frame_ns);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_reset_function(IntPtr presenter);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_destroy_function(IntPtr presenter);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_govern_function(IntPtr rollout, budget* budget);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int script_create_function(byte* text, UIntPtr length, IntPtr* script);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int script_get_controls_function(IntPtr script, ulong latent, uint latents_per_second, controls* controls);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int script_get_duration_function(IntPtr script, ulong* microseconds);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int script_get_text_function(IntPtr script, byte* text, UIntPtr capacity, UIntPtr* length);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int script_destroy_function(IntPtr script);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int recorder_create_function(IntPtr* recorder);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int recorder_key_function(IntPtr recorder, ulong microseconds, uint key, uint down);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int recorder_mouse_function(IntPtr recorder, ulong microseconds, float dx, float dy);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int recorder_scroll_function(IntPtr recorder, ulong microseconds, int notches);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int recorder_step_function(IntPtr recorder, ulong latent, uint latents_per_second, controls* controls);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int recorder_make_script_function(IntPtr recorder, ulong microseconds, IntPtr* script);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int recorder_destroy_function(IntPtr recorder);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int rollout_get_statistics_function(IntPtr rollout, rollout_statistics* statistics);

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        internal delegate int presenter_get_statistics_function(IntPtr presenter, presenter_statistics* statistics);

        /// <summary>Gives functions of a library by name, or throws.</summary>
        internal interface IResolver
        {
            T Resolve<T>(string name) where T : class;
        }

        /// <summary>
        /// The experimental functions of a loaded library. Each throws if the library is of another version, in which it may have other
        /// parameters.
        /// </summary>
        internal abstract class ExperimentalFunctions
        {
            private readonly IResolver library;

            protected ExperimentalFunctions(IResolver library)
            {
                this.library = library;
            }

            internal device_create_gpu_function device_create_gpu
            {
                get { return Resolve<device_create_gpu_function>("cairn_device_create_gpu"); }
            }

            internal device_create_auto_function device_create_auto
            {
                get { return Resolve<device_create_auto_function>("cairn_device_create_auto"); }
            }

            private T Resolve<T>(string name) where T : class
            {
                if (library.Resolve<version_function>("cairn_version")() == VERSION) return library.Resolve<T>(name);
                string cause = $"it is experimental, and the library is not of version {Library.Dotted(VERSION)}";
                const string Remedy = "Use library and assembly of the same release";
                throw new CairnException(Result.Unsupported, $"{name}: {cause}. {Remedy}", name, "", cause, Remedy);
            }
        }

        /// <summary>Every function of a loaded library.</summary>
        internal sealed class Functions : ExperimentalFunctions
        {
            internal readonly abi_version_function abi_version;
            internal readonly version_function version;
            internal readonly result_name_function result_name;
            internal readonly last_error_function last_error;
            internal readonly last_error_part_function last_error_part;
            internal readonly set_log_callback_function set_log_callback;
            internal readonly set_threads_function set_threads;
            internal readonly set_scheduler_function set_scheduler;
            internal readonly device_create_cpu_function device_create_cpu;
            internal readonly device_get_info_function device_get_info;
            internal readonly device_destroy_function device_destroy;
            internal readonly adapters_function adapters;
            internal readonly device_requirements_function device_requirements;
            internal readonly world_load_function world_load;
            internal readonly world_get_info_function world_get_info;
            internal readonly world_get_memory_function world_get_memory;
            internal readonly world_get_licence_function world_get_licence;
            internal readonly world_destroy_function world_destroy;
            internal readonly anchor_create_function anchor_create;
            internal readonly anchor_get_info_function anchor_get_info;
            internal readonly anchor_read_picture_function anchor_read_picture;
            internal readonly anchor_read_latent_function anchor_read_latent;
            internal readonly anchor_destroy_function anchor_destroy;
            internal readonly rollout_create_function rollout_create;
            internal readonly rollout_destroy_function rollout_destroy;
            internal readonly rollout_get_info_function rollout_get_info;
            internal readonly rollout_append_function rollout_append;
            internal readonly rollout_append_pictures_function rollout_append_pictures;
            internal readonly rollout_keep_encoder_stream_function rollout_keep_encoder_stream;
            internal readonly rollout_step_function rollout_step;
            internal readonly rollout_reset_function rollout_reset;
            internal readonly rollout_rest_function rollout_rest;
            internal readonly rollout_set_budget_function rollout_set_budget;
            internal readonly rollout_get_anchor_function rollout_get_anchor;
            internal readonly rollout_submit_function rollout_submit;
            internal readonly rollout_submit_picture_function rollout_submit_picture;
            internal readonly rollout_submit_pictures_function rollout_submit_pictures;
            internal readonly rollout_poll_function rollout_poll;
            internal readonly rollout_wait_function rollout_wait;
            internal readonly rollout_cancel_function rollout_cancel;
            internal readonly rollout_pause_function rollout_pause;
            internal readonly rollout_resume_function rollout_resume;
            internal readonly rollout_single_step_function rollout_single_step;
            internal readonly rollout_save_function rollout_save;
            internal readonly rollout_save_file_function rollout_save_file;
            internal readonly rollout_restore_function rollout_restore;
            internal readonly rollout_restore_file_function rollout_restore_file;
            internal readonly guidance_create_function guidance_create;
            internal readonly guidance_create_from_host_function guidance_create_from_host;
            internal readonly guidance_get_info_function guidance_get_info;
            internal readonly guidance_read_motion_function guidance_read_motion;
            internal readonly guidance_read_depth_function guidance_read_depth;
            internal readonly guidance_destroy_function guidance_destroy;
            internal readonly presenter_create_function presenter_create;
            internal readonly presenter_push_function presenter_push;
            internal readonly presenter_query_function presenter_query;
            internal readonly presenter_draw_function presenter_draw;
            internal readonly presenter_resize_function presenter_resize;
            internal readonly presenter_set_overlay_function presenter_set_overlay;
            internal readonly presenter_set_budget_function presenter_set_budget;
            internal readonly presenter_reset_function presenter_reset;
            internal readonly presenter_destroy_function presenter_destroy;
            internal readonly rollout_govern_function rollout_govern;
            internal readonly script_create_function script_create;
            internal readonly script_get_controls_function script_get_controls;
            internal readonly script_get_duration_function script_get_duration;
            internal readonly script_get_text_function script_get_text;
            internal readonly script_destroy_function script_destroy;
            internal readonly recorder_create_function recorder_create;
            internal readonly recorder_key_function recorder_key;
            internal readonly recorder_mouse_function recorder_mouse;
            internal readonly recorder_scroll_function recorder_scroll;
            internal readonly recorder_step_function recorder_step;
            internal readonly recorder_make_script_function recorder_make_script;
            internal readonly recorder_destroy_function recorder_destroy;
            internal readonly rollout_get_statistics_function rollout_get_statistics;
            internal readonly presenter_get_statistics_function presenter_get_statistics;

            internal Functions(IResolver library) : base(library)
            {
                abi_version = library.Resolve<abi_version_function>("cairn_abi_version");
                version = library.Resolve<version_function>("cairn_version");
                result_name = library.Resolve<result_name_function>("cairn_result_name");
                last_error = library.Resolve<last_error_function>("cairn_last_error");
                last_error_part = library.Resolve<last_error_part_function>("cairn_last_error_part");
                set_log_callback = library.Resolve<set_log_callback_function>("cairn_set_log_callback");
                set_threads = library.Resolve<set_threads_function>("cairn_set_threads");
                set_scheduler = library.Resolve<set_scheduler_function>("cairn_set_scheduler");
                device_create_cpu = library.Resolve<device_create_cpu_function>("cairn_device_create_cpu");
                device_get_info = library.Resolve<device_get_info_function>("cairn_device_get_info");
                device_destroy = library.Resolve<device_destroy_function>("cairn_device_destroy");
                adapters = library.Resolve<adapters_function>("cairn_adapters");
                device_requirements = library.Resolve<device_requirements_function>("cairn_device_requirements");
                world_load = library.Resolve<world_load_function>("cairn_world_load");
                world_get_info = library.Resolve<world_get_info_function>("cairn_world_get_info");
                world_get_memory = library.Resolve<world_get_memory_function>("cairn_world_get_memory");
                world_get_licence = library.Resolve<world_get_licence_function>("cairn_world_get_licence");
                world_destroy = library.Resolve<world_destroy_function>("cairn_world_destroy");
                anchor_create = library.Resolve<anchor_create_function>("cairn_anchor_create");
                anchor_get_info = library.Resolve<anchor_get_info_function>("cairn_anchor_get_info");
                anchor_read_picture = library.Resolve<anchor_read_picture_function>("cairn_anchor_read_picture");
                anchor_read_latent = library.Resolve<anchor_read_latent_function>("cairn_anchor_read_latent");
                anchor_destroy = library.Resolve<anchor_destroy_function>("cairn_anchor_destroy");
                rollout_create = library.Resolve<rollout_create_function>("cairn_rollout_create");
                rollout_destroy = library.Resolve<rollout_destroy_function>("cairn_rollout_destroy");
                rollout_get_info = library.Resolve<rollout_get_info_function>("cairn_rollout_get_info");
                rollout_append = library.Resolve<rollout_append_function>("cairn_rollout_append");
                rollout_append_pictures = library.Resolve<rollout_append_pictures_function>("cairn_rollout_append_pictures");
                rollout_keep_encoder_stream = library.Resolve<rollout_keep_encoder_stream_function>("cairn_rollout_keep_encoder_stream");
                rollout_step = library.Resolve<rollout_step_function>("cairn_rollout_step");
                rollout_reset = library.Resolve<rollout_reset_function>("cairn_rollout_reset");
                rollout_rest = library.Resolve<rollout_rest_function>("cairn_rollout_rest");
                rollout_set_budget = library.Resolve<rollout_set_budget_function>("cairn_rollout_set_budget");
                rollout_get_anchor = library.Resolve<rollout_get_anchor_function>("cairn_rollout_get_anchor");
                rollout_submit = library.Resolve<rollout_submit_function>("cairn_rollout_submit");
                rollout_submit_picture = library.Resolve<rollout_submit_picture_function>("cairn_rollout_submit_picture");
                rollout_submit_pictures = library.Resolve<rollout_submit_pictures_function>("cairn_rollout_submit_pictures");
                rollout_poll = library.Resolve<rollout_poll_function>("cairn_rollout_poll");
                rollout_wait = library.Resolve<rollout_wait_function>("cairn_rollout_wait");
                rollout_cancel = library.Resolve<rollout_cancel_function>("cairn_rollout_cancel");
                rollout_pause = library.Resolve<rollout_pause_function>("cairn_rollout_pause");
                rollout_resume = library.Resolve<rollout_resume_function>("cairn_rollout_resume");
                rollout_single_step = library.Resolve<rollout_single_step_function>("cairn_rollout_single_step");
                rollout_save = library.Resolve<rollout_save_function>("cairn_rollout_save");
                rollout_save_file = library.Resolve<rollout_save_file_function>("cairn_rollout_save_file");
                rollout_restore = library.Resolve<rollout_restore_function>("cairn_rollout_restore");
                rollout_restore_file = library.Resolve<rollout_restore_file_function>("cairn_rollout_restore_file");
                guidance_create = library.Resolve<guidance_create_function>("cairn_guidance_create");
                guidance_create_from_host = library.Resolve<guidance_create_from_host_function>("cairn_guidance_create_from_host");
                guidance_get_info = library.Resolve<guidance_get_info_function>("cairn_guidance_get_info");
                guidance_read_motion = library.Resolve<guidance_read_motion_function>("cairn_guidance_read_motion");
                guidance_read_depth = library.Resolve<guidance_read_depth_function>("cairn_guidance_read_depth");
                guidance_destroy = library.Resolve<guidance_destroy_function>("cairn_guidance_destroy");
                presenter_create = library.Resolve<presenter_create_function>("cairn_presenter_create");
                presenter_push = library.Resolve<presenter_push_function>("cairn_presenter_push");
                presenter_query = library.Resolve<presenter_query_function>("cairn_presenter_query");
                presenter_draw = library.Resolve<presenter_draw_function>("cairn_presenter_draw");
                presenter_resize = library.Resolve<presenter_resize_function>("cairn_presenter_resize");
                presenter_set_overlay = library.Resolve<presenter_set_overlay_function>("cairn_presenter_set_overlay");
                presenter_set_budget = library.Resolve<presenter_set_budget_function>("cairn_presenter_set_budget");
                presenter_reset = library.Resolve<presenter_reset_function>("cairn_presenter_reset");
                presenter_destroy = library.Resolve<presenter_destroy_function>("cairn_presenter_destroy");
                rollout_govern = library.Resolve<rollout_govern_function>("cairn_rollout_govern");
                script_create = library.Resolve<script_create_function>("cairn_script_create");
                script_get_controls = library.Resolve<script_get_controls_function>("cairn_script_get_controls");
                script_get_duration = library.Resolve<script_get_duration_function>("cairn_script_get_duration");
                script_get_text = library.Resolve<script_get_text_function>("cairn_script_get_text");
                script_destroy = library.Resolve<script_destroy_function>("cairn_script_destroy");
                recorder_create = library.Resolve<recorder_create_function>("cairn_recorder_create");
                recorder_key = library.Resolve<recorder_key_function>("cairn_recorder_key");
                recorder_mouse = library.Resolve<recorder_mouse_function>("cairn_recorder_mouse");
                recorder_scroll = library.Resolve<recorder_scroll_function>("cairn_recorder_scroll");
                recorder_step = library.Resolve<recorder_step_function>("cairn_recorder_step");
                recorder_make_script = library.Resolve<recorder_make_script_function>("cairn_recorder_make_script");
                recorder_destroy = library.Resolve<recorder_destroy_function>("cairn_recorder_destroy");
                rollout_get_statistics = library.Resolve<rollout_get_statistics_function>("cairn_rollout_get_statistics");
                presenter_get_statistics = library.Resolve<presenter_get_statistics_function>("cairn_presenter_get_statistics");
            }
        }
    }
#pragma warning restore 169, 649
}
