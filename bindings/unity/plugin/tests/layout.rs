//! Unity's interfaces: GUIDs, order of functions and layout of structs, compared with a separately written table of facts.

use std::mem::{align_of, offset_of, size_of};

use cairn_unity::interfaces::*;

/// Checks the position of each function, counted in pointers, and the number of functions.
macro_rules! order {
    ($table:ty, $count:literal, $($name:ident = $place:literal),* $(,)?) => {
        assert_eq!(size_of::<$table>(), $count * size_of::<usize>(), stringify!($table));
        assert_eq!(align_of::<$table>(), align_of::<usize>());
        $(assert_eq!(offset_of!($table, $name), $place * size_of::<usize>(), "{}.{}", stringify!($table), stringify!($name));)*
    };
}

#[test]
fn functions_have_unitys_order() {
    order!(Interfaces, 4, get = 0, register = 1, get_split = 2, register_split = 3);
    order!(Graphics, 4, get_renderer = 0, register_device_event = 1, unregister_device_event = 2, reserve_events = 3);
    order!(
        Direct3d12V5,
        7,
        get_device = 0,
        get_frame_fence = 1,
        get_next_frame_fence_value = 2,
        execute_command_list = 3,
        get_command_queue = 5,
    );
    order!(
        Direct3d12V6,
        10,
        get_device = 0,
        get_frame_fence = 1,
        get_next_frame_fence_value = 2,
        execute_command_list = 3,
        get_command_queue = 5,
        configure_event = 8,
        command_recording_state = 9,
    );
    order!(
        Direct3d12V7,
        13,
        get_device = 0,
        get_frame_fence = 4,
        get_next_frame_fence_value = 5,
        execute_command_list = 6,
        get_command_queue = 8,
        configure_event = 11,
        command_recording_state = 12,
    );
    order!(
        Direct3d12V8,
        15,
        get_device = 0,
        get_frame_fence = 4,
        get_next_frame_fence_value = 5,
        execute_command_list = 6,
        get_command_queue = 8,
        configure_event = 11,
        command_recording_state = 12,
        request_resource_state = 13,
        notify_resource_state = 14,
    );
}

#[test]
fn structs_have_the_layout_of_unitys_compilers() {
    assert_eq!((size_of::<Guid>(), offset_of!(Guid, low)), (16, 8));
    assert_eq!((size_of::<ResourceState>(), offset_of!(ResourceState, expected)), (16, 8));
    assert_eq!(offset_of!(ResourceState, current), 12);
    assert_eq!(size_of::<RecordingState>(), 8);
    assert_eq!((size_of::<EventConfig>(), offset_of!(EventConfig, flags)), (12, 4));
    assert_eq!(offset_of!(EventConfig, binds_render_texture), 8);
}

#[test]
fn constants_have_unitys_values() {
    let numbers = [
        (Graphics::GUID, "7cba0a9ca4ddb544", "8c5ad4926eb17b11"),
        (Direct3d12V5::GUID, "f5c8d8a37d37bc42", "b02dfe93b5064a27"),
        (Direct3d12V6::GUID, "a396dce58cac4d78", "afdd9b281f20b840"),
        (Direct3d12V7::GUID, "4624b0da41b64aac", "915aabcb9bc3f0d3"),
        (Direct3d12V8::GUID, "9d303045d00d4cfd", "8febb42968b423b6"),
    ];
    for (guid, high, low) in numbers {
        assert_eq!((format!("{:016x}", guid.high), format!("{:016x}", guid.low)), (high.to_owned(), low.to_owned()));
    }
    let versions = [Direct3d12V5::NUMBER, Direct3d12V6::NUMBER, Direct3d12V7::NUMBER, Direct3d12V8::NUMBER];
    assert_eq!(versions, [5, 6, 7, 8]);
    assert_eq!((QUEUE_LEFT_ALONE, QUEUE_ALLOWED), (0, 1));
    assert_eq!((FLUSH_COMMAND_BUFFERS, SYNC_WORKER_THREADS, MODIFIES_COMMAND_BUFFERS), (2, 4, 8));
    assert_eq!((RENDERER_D3D11, RENDERER_NULL, RENDERER_D3D12, RENDERER_VULKAN), (2, 4, 18, 21));
    assert_eq!((RENDERER_OPENGL_ES, RENDERER_METAL, RENDERER_OPENGL), (11, 16, 17));
    let events = [DEVICE_INITIALISE, DEVICE_SHUTDOWN, DEVICE_BEFORE_RESET, DEVICE_AFTER_RESET];
    assert_eq!(events, [0, 1, 2, 3]);
}
