//! The Direct3D 12 device: an engine's objects and our own, two queues, two devices, and a removed device. On Windows, or in the
//! lab.
#![cfg(windows)]

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use cairn::gpu::{FencePoint, Gpu, adapters, read_texture, texture_from_picture};
use cairn::{ErrorKind, Picture};
use test_support::d3d12::buffers::{Buffers, List, bytes};
use test_support::d3d12::engine::{Engine, queue, reference_count, wait_for_counts};

#[test]
fn adapters_are_listed_and_a_device_is_made_on_each() {
    let adapters = adapters().expect("DXGI works");
    assert!(!adapters.is_empty(), "there is an adapter");
    for adapter in &adapters {
        assert!(!adapter.description.is_empty(), "{adapter:?}");
        let gpu = Gpu::on_adapter(Some(adapter.luid)).expect("a device on it");
        assert_eq!(gpu.luid(), adapter.luid);
        assert_eq!(gpu.frames().kind(), D3D12_COMMAND_LIST_TYPE_DIRECT);
        assert_eq!(gpu.anchors().kind(), D3D12_COMMAND_LIST_TYPE_COMPUTE);
        assert!(gpu.removed().is_none());
        let budget = gpu.budget().expect("the adapter is there").expect("DXGI says");
        assert!(budget.available() > 16 << 20 && budget.available() <= budget.granted, "{budget:?}");
    }
    let refused = Gpu::on_adapter(Some(0x1234_5678_9abc_def0)).expect_err("no adapter has it");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("luid")));
}

#[test]
fn a_device_releases_all_references_to_an_engines_objects() {
    let engine = Engine::create();
    let count = || [reference_count(&engine.device), reference_count(&engine.direct), reference_count(&engine.compute)];
    let before = count();
    for anchors in [None, Some(&engine.compute)] {
        let gpu = Gpu::of_engine(&engine.device, &engine.direct, anchors).expect("an engine's device");
        assert_eq!(gpu.device().as_raw(), engine.device.as_raw());
        assert_eq!(gpu.frames().d3d12().as_raw(), engine.direct.as_raw());
        let own = gpu.anchors().d3d12().as_raw();
        assert_eq!(own == engine.compute.as_raw(), anchors.is_some());
        let clone = gpu.clone();
        drop(gpu);
        let fence_point = clone.anchors().signal().expect("a fence point");
        fence_point.wait().expect("nothing was to be done");
        assert!(count().iter().zip(before).any(|(now, before)| *now > before), "it holds what it uses");
        drop((clone, fence_point));
        wait_for_counts(count, before);
    }
    // Refused calls keep no references either.
    let other = Engine::create();
    let copy = queue(&engine.device, D3D12_COMMAND_LIST_TYPE_COPY);
    for (queue, anchors, field) in [
        (&copy, None, "queue"),
        (&other.direct, None, "queue"),
        (&engine.direct, Some(&copy), "anchors"),
        (&engine.direct, Some(&engine.direct), "anchors"),
        (&engine.direct, Some(&other.compute), "anchors"),
    ] {
        let refused = Gpu::of_engine(&engine.device, queue, anchors).expect_err("a queue that cannot serve");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)), "{refused}");
    }
    drop(copy);
    wait_for_counts(count, before);
}

#[test]
fn one_queue_waits_for_a_fence_point_of_the_other() {
    let engine = Engine::create();
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, Some(&engine.compute)).expect("an engine's device");
    let buffers = Buffers::new(gpu.device(), 3);
    buffers.upload(b"before: ");
    // The engine's queue waits for a fence that the processor signals; our work is queued behind it.
    // SAFETY: values only.
    let gate: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    gpu.frames().wait(&FencePoint::of_engine(&gpu, &gate, 1).expect("a fence of the device")).expect("a wait");
    let first = List::new(gpu.device(), gpu.frames().kind());
    let written = gpu.frames().submit(&[first.copy(&buffers, 0, 1)]).expect("a submission");
    gpu.anchors().wait(&written).expect("a wait");
    let second = List::new(gpu.device(), gpu.anchors().kind());
    let read = gpu.anchors().submit(&[second.copy(&buffers, 1, 2)]).expect("a submission");
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!(!written.reached() && !read.reached(), "nothing runs before the fence is signalled");
    // Without the wait, the second copy would have copied zeroes by now.
    buffers.upload(b"at last!");
    // SAFETY: a live fence.
    unsafe { gate.Signal(1) }.expect("the gate opens");
    for fence_point in [&read, &written] {
        fence_point.wait().expect("both are done");
        assert!(fence_point.reached());
    }
    assert_eq!(&bytes(&buffers.read), b"at last!");

    let other = Engine::create();
    // SAFETY: values only.
    let foreign: ID3D12Fence = unsafe { other.device.CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    let refused = FencePoint::of_engine(&gpu, &foreign, 1).expect_err("another device's");
    assert_eq!(refused.offending_field(), Some("fence"));
}

#[test]
fn two_devices_work_side_by_side() {
    let gpus = [Gpu::on_adapter(None).expect("a device"), Gpu::on_adapter(None).expect("another device")];
    std::thread::scope(|scope| {
        for (gpu, text) in gpus.iter().zip([b"number 1", b"number 2"]) {
            scope.spawn(move || {
                for round in 0..20 {
                    let buffers = Buffers::new(gpu.device(), 3);
                    buffers.upload(text);
                    let queue = if round % 2 == 0 { gpu.frames() } else { gpu.anchors() };
                    let lists = [List::new(gpu.device(), queue.kind()), List::new(gpu.device(), queue.kind())];
                    let both = [lists[0].copy(&buffers, 0, 1), lists[1].copy_written(&buffers, 1, 2)];
                    queue.submit(&both).expect("a submission").wait().expect("it is done");
                    assert_eq!(&bytes(&buffers.read), text);
                }
            });
        }
    });
}

#[test]
fn a_picture_is_uploaded_to_a_texture_and_read_back() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    // A row is not a multiple of 256 bytes, the row pitch alignment of textures in buffers.
    let mut picture = Picture::new(75, 31).expect("a picture");
    for (i, byte) in (0u32..).zip(picture.rgba_mut()) {
        *byte = (i.wrapping_mul(2_654_435_761) >> 24) as u8;
    }
    let (texture, fence_point) = texture_from_picture(&gpu, &picture).expect("a texture");
    assert!(fence_point.reached());
    for _ in 0..2 {
        // Twice: the first read leaves the texture in its former state.
        let found = read_texture(&gpu, &texture, D3D12_RESOURCE_STATE_COMMON).expect("a picture");
        assert!(found == picture, "every pixel comes back");
    }
    let buffers = Buffers::new(gpu.device(), 2);
    let other = Gpu::on_adapter(None).expect("another device");
    for (gpu, resource) in [(&gpu, &buffers.read), (&other, &texture)] {
        let refused = read_texture(gpu, resource, D3D12_RESOURCE_STATE_COMMON).expect_err("no texture of this device");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("texture")));
    }
    // An engine that has a compute queue only.
    let compute = Gpu::of_engine(gpu.device(), gpu.anchors().d3d12(), None).expect("a device");
    assert!(read_texture(&compute, &texture, D3D12_RESOURCE_STATE_COMMON).expect("a picture") == picture);
    let refused = read_texture(&compute, &texture, D3D12_RESOURCE_STATE_RENDER_TARGET).expect_err("a state of drawing");
    assert_eq!(refused.offending_field(), Some("state"));
}

#[test]
fn a_removed_device_reports_the_reason_and_a_new_one_works() {
    let engine = Engine::create();
    let untouched = [reference_count(&engine.device), reference_count(&engine.direct)];
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, None).expect("an engine's device");
    let buffers = Buffers::new(gpu.device(), 3);
    let earlier = gpu.frames().signal().expect("a fence point");
    // Behind a fence that is never signalled: only device removal ends this wait.
    // SAFETY: values only.
    let gate: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    gpu.anchors().wait(&FencePoint::of_engine(&gpu, &gate, 1).expect("a fence of the device")).expect("a wait");
    let stuck = gpu.anchors().signal().expect("a fence point");
    let waiting = std::thread::spawn({
        let stuck = stuck.clone();
        move || stuck.wait()
    });

    // Executing a list that is still open removes the device.
    let open = List::new(gpu.device(), gpu.frames().kind());
    let gone = gpu.frames().submit(&[open.still_open()]).expect_err("the device is gone");
    assert_eq!(gone.kind(), ErrorKind::DeviceRemoved, "{gone}");
    assert!(gone.to_string().contains("0x887a0001"), "the reason has its number: {gone}");
    assert!(gone.remedy_text().is_some_and(|text| text.contains("new device")), "{gone}");
    assert_eq!(gpu.removed().map(|error| error.kind()), Some(ErrorKind::DeviceRemoved));
    for result in [waiting.join().expect("no panic"), earlier.wait(), gpu.anchors().signal().map(drop)] {
        assert_eq!(result.expect_err("nothing works on it").kind(), ErrorKind::DeviceRemoved);
    }
    let refused = Gpu::of_engine(&engine.device, &engine.direct, None).expect_err("a device that is gone");
    assert_eq!(refused.kind(), ErrorKind::DeviceRemoved);

    // A driver that continues regardless can finish, and none of its threads holds a reference.
    // SAFETY: a live fence.
    _ = unsafe { gate.Signal(1) };
    wait_for_counts(|| [u32::from(stuck.reached())], [1]);
    drop((buffers, open, gate, earlier, stuck, gpu));
    wait_for_counts(|| [reference_count(&engine.device), reference_count(&engine.direct)], untouched);
    drop(engine);

    let gpu = Gpu::on_adapter(None).expect("a new device");
    let buffers = Buffers::new(gpu.device(), 2);
    buffers.upload(b"it works");
    let list = List::new(gpu.device(), gpu.frames().kind());
    gpu.frames().submit(&[list.copy(&buffers, 0, 1)]).expect("a submission").wait().expect("it is done");
    assert_eq!(&bytes(&buffers.read), b"it works");
}
