//! The Direct3D 12 functions of the C interface, called as by an engine in C. On Windows, or in the lab.
#![cfg(windows)]

use std::ffi::CString;
use std::ptr::{null, null_mut};

use cairn::abi::anchor::cairn_anchor_destroy;
use cairn::abi::d3d12::{
    cairn_anchor_get_d3d12, cairn_d3d12_options, cairn_device_create_adapter, cairn_device_create_d3d12,
    cairn_device_get_d3d12, cairn_device_set_d3d12, cairn_rollout_append_d3d12,
};
use cairn::abi::device::{CAIRN_DEVICE_D3D12, cairn_device_destroy, cairn_device_get_info, cairn_device_info};
use cairn::abi::images::cairn_picture;
use cairn::abi::requirements::{cairn_adapter, cairn_adapters};
use cairn::abi::results::{CAIRN_ERROR_INVALID_ARGUMENT, CAIRN_OK};
use cairn::abi::rollout::{
    cairn_rollout_append, cairn_rollout_create, cairn_rollout_destroy, cairn_rollout_get_anchor,
};
use cairn::abi::statistics::{cairn_rollout_get_statistics, cairn_rollout_statistics};
use cairn::abi::world::{cairn_world_destroy, cairn_world_load, cairn_world_options};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::{
    D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_DEPTH_WRITE, D3D12_RESOURCE_STATE_RENDER_TARGET,
    D3D12_RESOURCE_STATES, ID3D12Fence, ID3D12Resource,
};
use cairn::gpu::windows::core::Interface;
use cairn::gpu::{FencePoint, Gpu, read_texture, texture_from_picture};
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::d3d12::engine::{reference_count, wait_for_counts};
use test_support::worlds::{self, bundle_path};

#[test]
fn devices_are_created_from_an_engines_objects() {
    let engine = Gpu::on_adapter(None).expect("a device that stands for an engine's");
    let (d3d12, queue, compute) = (engine.device(), engine.frames().d3d12(), engine.anchors().d3d12());
    let before = [reference_count(d3d12), reference_count(queue), reference_count(compute)];
    let mut device = null_mut();
    let create = |d3d12, queue, anchors, device: &mut _| {
        // SAFETY: live objects, or null, options of their size and a variable for the handle.
        unsafe { cairn_device_create_d3d12(d3d12, queue, anchors, &tool_device_options(), device) }
    };
    let (raw_device, raw_queue) = (d3d12.as_raw().cast(), queue.as_raw().cast());
    // Null for required objects, and objects of the wrong type.
    for (d3d12, queue, anchors) in [
        (null_mut(), raw_queue, null_mut()),
        (raw_device, null_mut(), null_mut()),
        (queue.as_raw().cast(), raw_queue, null_mut()),
        (raw_device, d3d12.as_raw().cast(), null_mut()),
        (raw_device, raw_queue, d3d12.as_raw().cast()),
        (raw_device, raw_queue, queue.as_raw().cast()),
    ] {
        assert_eq!(create(d3d12, queue, anchors, &mut device), CAIRN_ERROR_INVALID_ARGUMENT);
        assert!(device.is_null(), "nothing is written on failure");
    }
    let mut wrong = tool_device_options();
    wrong.flags = 4;
    // SAFETY: live objects, options of their size and a variable for the handle.
    let refused = unsafe { cairn_device_create_d3d12(raw_device, raw_queue, null_mut(), &wrong, &mut device) };
    assert_eq!((refused, device.is_null()), (CAIRN_ERROR_INVALID_ARGUMENT, true));
    assert_eq!(create(raw_device, raw_queue, compute.as_raw().cast(), &mut device), CAIRN_OK);

    let (mut own, mut frames) = (null_mut(), null_mut());
    // SAFETY: a live handle and variables for both.
    assert_eq!(unsafe { cairn_device_get_d3d12(device, &mut own, &mut frames) }, CAIRN_OK);
    assert_eq!((own, frames), (raw_device, raw_queue));
    // SAFETY: the references that the call gave, used once.
    drop(unsafe {
        (
            cairn::gpu::windows::core::IUnknown::from_raw(own.cast()),
            cairn::gpu::windows::core::IUnknown::from_raw(frames.cast()),
        )
    });
    let mut info: cairn_device_info = with_struct_size(|info: &mut cairn_device_info| &mut info.struct_size);
    // SAFETY: a live handle and a struct of its size.
    assert_eq!(unsafe { cairn_device_get_info(device, &mut info) }, CAIRN_OK);
    assert_eq!(info.kind, CAIRN_DEVICE_D3D12);
    // SAFETY: a live handle.
    assert_eq!(unsafe { cairn_device_destroy(device) }, CAIRN_OK);
    wait_for_counts(|| [reference_count(d3d12), reference_count(queue), reference_count(compute)], before);
}

#[test]
fn textures_are_appended_and_anchors_are_read_as_textures() {
    let gpu = Gpu::on_adapter(None).expect("a device that stands for an engine's");
    let (d3d12, queue) = (gpu.device().as_raw().cast(), gpu.frames().d3d12().as_raw().cast());
    // SAFETY: live objects, options of their size and a variable for the handle.
    let device =
        create_handle(|to| unsafe { cairn_device_create_d3d12(d3d12, queue, null_mut(), &tool_device_options(), to) });
    let path = CString::new(bundle_path("tiny").to_str().expect("text")).expect("no NUL");
    let mut options: cairn_world_options =
        with_struct_size(|options: &mut cairn_world_options| &mut options.struct_size);
    options.path = path.as_ptr();
    // SAFETY: a live handle, options of their size, and a variable for the handle.
    let world = create_handle(|to| unsafe { cairn_world_load(device, &options, to) });
    let seed = worlds::picture(40, 30, 1);
    let (texture, _) = texture_from_picture(&gpu, &seed).expect("a texture");
    let mut options: cairn_d3d12_options =
        with_struct_size(|options: &mut cairn_d3d12_options| &mut options.struct_size);
    options.flags = 2;
    // SAFETY: a live handle and options of their size.
    assert_eq!(unsafe { cairn_device_set_d3d12(device, &options) }, CAIRN_ERROR_INVALID_ARGUMENT);
    (options.flags, options.captured_passes, options.longest_submission_us) = (0, 16, 1);
    // SAFETY: as above.
    assert_eq!(unsafe { cairn_device_set_d3d12(device, &options) }, CAIRN_OK);
    let mut shown = Vec::new();
    for from_texture in [true, false] {
        // SAFETY: a live handle and a variable for the handle.
        let rollout = create_handle(|to| unsafe { cairn_rollout_create(world, null(), to) });
        // A state that the texture was not made for; a barrier from it would remove the device.
        for state in [D3D12_RESOURCE_STATE_RENDER_TARGET, D3D12_RESOURCE_STATE_DEPTH_WRITE, D3D12_RESOURCE_STATES(-1)] {
            let raw = texture.as_raw().cast();
            // SAFETY: a live handle and a live texture.
            let refused = unsafe { cairn_rollout_append_d3d12(rollout, raw, state.0.cast_unsigned(), null_mut()) };
            assert_eq!(refused, CAIRN_ERROR_INVALID_ARGUMENT, "{state:?}");
        }
        let appended = if from_texture {
            // SAFETY: a live handle and a live texture in the state COMMON.
            unsafe { cairn_rollout_append_d3d12(rollout, texture.as_raw().cast(), 0, null_mut()) }
        } else {
            let mut picture: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
            (picture.width, picture.height) = seed.size();
            (picture.pixels, picture.size) = (seed.rgba().as_ptr().cast(), seed.rgba().len() as u64);
            // SAFETY: a live handle and a picture that lives during the call.
            unsafe { cairn_rollout_append(rollout, &picture, null_mut()) }
        };
        assert_eq!(appended, CAIRN_OK);
        let mut did: cairn_rollout_statistics =
            with_struct_size(|did: &mut cairn_rollout_statistics| &mut did.struct_size);
        // SAFETY: a live handle and a struct of its size.
        assert_eq!(unsafe { cairn_rollout_get_statistics(rollout, &mut did) }, CAIRN_OK);
        // The world was loaded before capturing was enabled, and its device's timer ran.
        let passes = [did.device_passes, did.device_decodes, did.cache_passes, did.captured_passes.into()];
        assert_eq!(passes, [1, did.decode_passes, 1, 0], "{did:?}");
        assert!(did.device_passes_ns > 0 && did.device_decode_longest_ns > 0 && did.runtime_ns > 0, "{did:?}");
        assert!(did.waited_ns > 0 && did.yields > 0 && did.other_passes > 0, "{did:?}");
        // SAFETY: a live handle and a variable for the handle.
        let anchor = create_handle(|to| unsafe { cairn_rollout_get_anchor(rollout, to) });
        let (mut picture, mut fence, mut value) = (null_mut(), null_mut(), 0);
        // SAFETY: a live handle and variables for the results.
        assert_eq!(unsafe { cairn_anchor_get_d3d12(anchor, 0, &mut picture, &mut fence, &mut value) }, CAIRN_OK);
        // SAFETY: the references that the call gave, used once.
        let (picture, fence) =
            unsafe { (ID3D12Resource::from_raw(picture.cast()), ID3D12Fence::from_raw(fence.cast())) };
        FencePoint::of_engine(&gpu, &fence, value).expect("a fence of the device").wait().expect("it is there");
        shown.push(read_texture(&gpu, &picture, D3D12_RESOURCE_STATE_COMMON).expect("a picture"));
        // SAFETY: live handles.
        assert_eq!(unsafe { [cairn_anchor_destroy(anchor), cairn_rollout_destroy(rollout)] }, [CAIRN_OK; 2]);
    }
    assert!(shown[0].rgba().iter().any(|byte| *byte != shown[0].rgba()[0]), "the picture is not uniform");
    assert!(shown[0] == shown[1], "appending a texture equals appending its picture");
    // SAFETY: live handles.
    assert_eq!(unsafe { [cairn_world_destroy(world), cairn_device_destroy(device)] }, [CAIRN_OK; 2]);
}

#[test]
fn adapters_are_listed_with_the_luid_that_creates_a_device() {
    let mut rows = [(); 8].map(|()| with_struct_size(|row: &mut cairn_adapter| &mut row.struct_size));
    let mut count = 0;
    // SAFETY: an array of the capacity named, and a variable for the count.
    let listed = unsafe { cairn_adapters(rows.as_mut_ptr(), size_of::<cairn_adapter>(), 8, &mut count) };
    assert_eq!(listed, CAIRN_OK);
    let found: Vec<_> = rows[..count as usize].iter().filter(|row| row.kind == CAIRN_DEVICE_D3D12).collect();
    assert!(!found.is_empty(), "there is an adapter beside the processor");
    for (index, row) in (0..).zip(found) {
        assert_eq!(row.index, index);
        let mut device = null_mut();
        // SAFETY: options of their size and a variable for the handle.
        assert_eq!(unsafe { cairn_device_create_adapter(row.luid, &tool_device_options(), &mut device) }, CAIRN_OK);
        // SAFETY: a live handle.
        assert_eq!(unsafe { cairn_device_destroy(device) }, CAIRN_OK);
    }
    let mut device = null_mut();
    // SAFETY: a variable for the handle.
    let refused = unsafe { cairn_device_create_adapter(0x1234_5678_9abc_def0, null(), &mut device) };
    assert_eq!((refused, device.is_null()), (CAIRN_ERROR_INVALID_ARGUMENT, true));
}
