//! Lists constants and structs of the interface with Rust's values and layouts, to be compared with those of a C compiler.

use std::fmt::Write as _;

use super::structs::Struct;
use super::{
    anchor::*, budget::*, controls::*, d3d12::*, device::*, guidance::*, images::*, logging::*, presenter::*,
    requirements::*, results::*, rollout::*, statistics::*, steps::*, swapchain::*, threads::*, version::*, world::*,
};

/// Constants and structs, in the format of `abi.txt`.
#[doc(hidden)]
pub fn layout() -> String {
    let mut text = String::new();
    for (name, value) in constants() {
        _ = writeln!(text, "constant {name} {value}");
    }
    _ = writeln!(text, "cairn_result {}", size_of::<cairn_result>());
    write_structs(&mut text);
    text
}

macro_rules! constants {
    ($($name:ident)*) => { [$((stringify!($name), $name as i64)),*] };
}

fn constants() -> impl IntoIterator<Item = (&'static str, i64)> {
    constants![
        CAIRN_ABI_VERSION CAIRN_VERSION
        CAIRN_OK CAIRN_NOT_READY CAIRN_TRUNCATED CAIRN_QUEUE_FULL
        CAIRN_ERROR_INVALID_ARGUMENT CAIRN_ERROR_INVALID_HANDLE CAIRN_ERROR_STRUCT_SIZE CAIRN_ERROR_BUSY
        CAIRN_ERROR_UNSUPPORTED CAIRN_ERROR_OUT_OF_MEMORY CAIRN_ERROR_IO CAIRN_ERROR_INVALID_BUNDLE
        CAIRN_ERROR_RUNTIME_MISSING CAIRN_ERROR_DEVICE CAIRN_ERROR_INVALID_STATE CAIRN_ERROR_CANCELLED
        CAIRN_ERROR_POISONED CAIRN_ERROR_INTERNAL CAIRN_ERROR_DEVICE_REMOVED
        CAIRN_LAST_ERROR_FUNCTION CAIRN_LAST_ERROR_FIELD CAIRN_LAST_ERROR_CAUSE CAIRN_LAST_ERROR_REMEDY
        CAIRN_LOG_OFF CAIRN_LOG_ERROR CAIRN_LOG_WARNING CAIRN_LOG_INFO CAIRN_LOG_DEBUG CAIRN_LOG_TRACE
        CAIRN_PRIORITY_BELOW_NORMAL CAIRN_PRIORITY_NORMAL CAIRN_PRIORITY_LOWEST CAIRN_MAX_THREADS
        CAIRN_DEVICE_CPU CAIRN_DEVICE_D3D12 CAIRN_DEVICE_WEBGPU CAIRN_PRECISION_F32 CAIRN_PRECISION_F16
        CAIRN_DEVICE_DETERMINISTIC CAIRN_DEVICE_ENVIRONMENT
        CAIRN_REQUIREMENT_PLATFORM CAIRN_REQUIREMENT_ONNXRUNTIME CAIRN_REQUIREMENT_MEMORY
        CAIRN_REQUIREMENT_FSR_LIBRARIES CAIRN_REQUIREMENT_FSR_PROVIDER CAIRN_REQUIREMENT_FSR_SYSTEM
        CAIRN_REQUIREMENT_FSR_DIRECT3D CAIRN_REQUIREMENT_FSR_SHADER_MODEL CAIRN_REQUIREMENT_SHADERS CAIRN_REQUIREMENT_WEBGPU
        CAIRN_REQUIREMENT_ADAPTER
        CAIRN_REQUIREMENT_MET CAIRN_REQUIREMENT_NOT_MET CAIRN_REQUIREMENT_UNKNOWN CAIRN_REQUIREMENT_OPTIONAL
        CAIRN_LOAD_READING CAIRN_LOAD_PREPARING CAIRN_WORLD_FIT_WINDOW CAIRN_WORLD_CHECK_PRECISION
        CAIRN_FORMAT_RGBA8 CAIRN_FORMAT_BGRA8 CAIRN_FORMAT_RGBA16F CAIRN_FORMAT_RGB10A2
        CAIRN_MAX_QUEUE CAIRN_STEP_COMMITTED CAIRN_FOREVER CAIRN_ANCHOR_CUT
        CAIRN_MOTION_AUTO CAIRN_MOTION_PICTURES CAIRN_MOTION_PAPER CAIRN_MOTION_LATENTS CAIRN_DEPTH_INVERTED CAIRN_DEPTH_LINEAR
        CAIRN_PREFER_AUTO CAIRN_PREFER_REQUIRE CAIRN_PREFER_NEVER
        CAIRN_PRESENTER_HOLD_LATE CAIRN_PRESENTER_CATCH_UP CAIRN_PRESENTER_NO_DECODED CAIRN_PRESENTER_LETTERBOX
        CAIRN_COLOUR_SRGB CAIRN_COLOUR_LINEAR CAIRN_COLOUR_SCRGB CAIRN_COLOUR_HDR10
        CAIRN_FRAME_ANCHOR CAIRN_FRAME_DECODED CAIRN_FRAME_GENERATED CAIRN_FRAME_EXTRAPOLATED CAIRN_FRAME_HELD
        CAIRN_FRAME_CUT CAIRN_FRAME_REPEATED CAIRN_FRAME_UNPREPARED CAIRN_MAX_LISTS CAIRN_PREPARE_SUBMIT_ONLY CAIRN_D3D12_DETERMINISTIC
        CAIRN_FSR_ANY CAIRN_FSR_PREFER_ML CAIRN_FSR_PREFER_ANALYTIC CAIRN_FSR_REQUIRE_ML CAIRN_FSR_REQUIRE_ANALYTIC
        CAIRN_SWAPCHAIN_ASYNC CAIRN_SWAPCHAIN_SHOWN_MOTION CAIRN_SWAPCHAIN_JITTERED_MOTION CAIRN_SWAPCHAIN_INVERTED_DEPTH
        CAIRN_SWAPCHAIN_INFINITE_DEPTH CAIRN_SWAPCHAIN_HDR CAIRN_SWAPCHAIN_CHECKED CAIRN_SWAPCHAIN_UNTRIED
        CAIRN_SWAPCHAIN_RESET CAIRN_INTERFACE_PREMULTIPLIED CAIRN_INTERFACE_COPIED
        CAIRN_MAX_BUDGET_WORLDS
        CAIRN_PACING_HYBRID_SPIN CAIRN_PACING_WAIT_ON_FENCE
    ]
}

fn write_structs(text: &mut String) {
    write_struct::<cairn_thread_options>(text);
    write_struct::<cairn_scheduler>(text);
    write_struct::<cairn_device_options>(text);
    write_struct::<cairn_device_info>(text);
    write_struct::<cairn_adapter>(text);
    write_struct::<cairn_requirement>(text);
    write_struct::<cairn_load_progress>(text);
    write_struct::<cairn_world_options>(text);
    write_struct::<cairn_world_info>(text);
    write_struct::<cairn_world_memory>(text);
    write_struct::<cairn_picture>(text);
    write_struct::<cairn_target>(text);
    write_struct::<cairn_controls>(text);
    write_struct::<cairn_rollout_options>(text);
    write_struct::<cairn_rollout_info>(text);
    write_struct::<cairn_step_info>(text);
    write_struct::<cairn_anchor_info>(text);
    write_struct::<cairn_guidance_data>(text);
    write_struct::<cairn_guidance_info>(text);
    write_struct::<cairn_presenter_options>(text);
    write_struct::<cairn_frame>(text);
    write_struct::<cairn_presenter_statistics>(text);
    write_struct::<cairn_rollout_statistics>(text);
    write_struct::<cairn_budget>(text);
    write_struct::<cairn_d3d12_options>(text);
    write_struct::<cairn_d3d12_preparation>(text);
    write_struct::<cairn_d3d12_recording>(text);
    write_struct::<cairn_swapchain_options>(text);
    write_struct::<cairn_swapchain_frame>(text);
    write_struct::<cairn_swapchain_pacing>(text);
    write_struct::<cairn_swapchain_statistics>(text);
}

fn write_struct<T: Struct>(text: &mut String) {
    _ = writeln!(text, "struct {} {}", T::NAME, align_of::<T>());
    for size in T::SIZES {
        _ = writeln!(text, "size {} {size}", T::NAME);
    }
    let mut end = 0;
    for field in T::FIELDS {
        // Padding would pass uninitialised bytes across the interface.
        assert_eq!(field.offset, end, "{}.{} follows the field before it", T::NAME, field.name);
        end += field.size;
        _ = writeln!(text, "field {}.{} {} {}", T::NAME, field.name, field.offset, field.size);
    }
    assert_eq!(end, size_of::<T>(), "{} ends with its last field", T::NAME);
}

#[cfg(test)]
mod tests {
    #[test]
    fn no_struct_has_a_gap() {
        assert!(super::layout().contains("field cairn_picture.struct_size 0 4"));
    }
}
