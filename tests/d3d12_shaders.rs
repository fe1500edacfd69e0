//! The library's compute shaders compared with the processor's results, and the command ring that records them. On Windows, or in the lab.
#![cfg(windows)]

use cairn::ErrorKind;
use cairn::gpu::compute::{CommandRing, FRAMES_IN_FLIGHT, ResourceWithState};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{FencePoint, Gpu, Planes, Resize};
use cairn::guidance::paper::{GpuExtractor, LatentBuffer};
use gpu_testing::resize::planes;
use gpu_testing::{paper_guidance, resize};
use test_support::allocations::{CountingAllocator, allocations};
use test_support::d3d12::engine::reference_count;
use test_support::d3d12::resources::{
    TestResource, create_resource, read_texture, run_list, texture_desc, upload_buffer, writable_texture,
};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn gpu() -> Gpu {
    Gpu::on_adapter(None).expect("a device")
}

/// A fence without a signal, and the fence point at which it is signalled.
fn gate(gpu: &Gpu) -> (ID3D12Fence, FencePoint) {
    // SAFETY: values only.
    let fence: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    let fence_point = FencePoint::of_engine(gpu, &fence, 1).expect("a fence of the device");
    (fence, fence_point)
}

/// Signals the fence.
fn open(gate: &ID3D12Fence) {
    // SAFETY: a live fence.
    unsafe { gate.Signal(1) }.expect("the gate opens");
}

#[test]
fn a_decoded_picture_is_resized_as_the_processor_does() {
    resize::compare(&gpu());
}

#[test]
fn a_full_ring_waits_for_the_engines_fence_and_then_releases_resources() {
    let gpu = gpu();
    let resize = Resize::new(&gpu).expect("the shader");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 2).expect("a ring");
    let values: Vec<u8> = [1.0_f32, 0.5, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let source = upload_buffer(&gpu, &values);
    let target = writable_texture(&gpu, (4, 4), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_RENDER_TARGET);
    let before = reference_count(&target.resource);

    // Records the maximum number of frames in flight; the engine executes the list later.
    let (fence, opened) = gate(&gpu);
    run_list(&gpu, |list| {
        for _ in 0..FRAMES_IN_FLIGHT {
            let mut frame = frames.begin_in(list, &opened).expect("a frame");
            resize
                .record(&mut frame, &planes(&source, (1, 1), false, 0), &target.with_state())
                .expect("it is recorded");
        }
    });
    assert_eq!(read_texture(&gpu, &target, 16), [255, 128, 0, 255].repeat(16));
    // The engine has not signalled its fence yet.
    frames.release_completed();
    assert!(reference_count(&target.resource) > before, "the ring holds what it uses");
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| drop(frames.begin().expect("a frame")));
        std::thread::sleep(std::time::Duration::from_millis(200));
        assert!(!waiting.is_finished(), "the ring is full");
        open(&fence);
        waiting.join().expect("a frame");
    });
    frames.release_completed();
    assert_eq!(reference_count(&target.resource), before, "references are released");

    // A frame that is dropped unfinished leaves the ring unchanged.
    for _ in 0..2 * FRAMES_IN_FLIGHT {
        let mut frame = frames.begin().expect("a frame");
        resize.record(&mut frame, &planes(&source, (1, 1), false, 0), &target.with_state()).expect("it is recorded");
    }
    let refused = frames.begin().expect("a frame").submit(gpu.anchors()).expect_err("another kind of queue");
    assert_eq!(refused.offending_field(), Some("queue"));
    frames.begin().expect("a frame").submit(gpu.frames()).expect("a submission").wait().expect("it is done");
}

#[test]
fn a_frame_allocates_nothing() {
    let gpu = gpu();
    let resize = Resize::new(&gpu).expect("the shader");
    let mut frames = CommandRing::new(&gpu, gpu.anchors(), 2).expect("a ring");
    let source = upload_buffer(&gpu, &[0; 12]);
    let target = writable_texture(&gpu, (64, 64), DXGI_FORMAT_R16G16B16A16_FLOAT, D3D12_RESOURCE_STATE_COMMON);
    let mut one = || {
        let mut frame = frames.begin().expect("a frame");
        resize.record(&mut frame, &planes(&source, (1, 1), false, 0), &target.with_state()).expect("it is recorded");
        frame.submit(gpu.anchors()).expect("a submission")
    };
    one();
    let before = allocations();
    let last = (0..10).map(|_| one()).last().expect("ten frames");
    assert_eq!(allocations(), before);
    last.wait().expect("it is done");
}

#[test]
fn invalid_arguments_are_refused_by_name() {
    let (gpu, other) = (gpu(), self::gpu());
    let resize = Resize::new(&gpu).expect("the shader");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 4).expect("a ring");
    let source = upload_buffer(&gpu, &[0; 4 * 3 * 6]);
    let common = D3D12_RESOURCE_STATE_COMMON;
    // Refused calls state another state than the texture's own.
    let good = writable_texture(&gpu, (4, 4), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_RENDER_TARGET);
    let good = TestResource { state: common, ..good };
    let foreign =
        (upload_buffer(&other, &[0; 72]), writable_texture(&other, (4, 4), DXGI_FORMAT_R8G8B8A8_UNORM, common));
    let unwritable = texture_desc((4, 4), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_FLAG_NONE);
    let unwritable =
        TestResource { resource: create_resource(&gpu, D3D12_HEAP_TYPE_DEFAULT, &unwritable, common), state: common };
    let mut levels = texture_desc((4, 4), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS);
    levels.MipLevels = 2;
    let levels =
        TestResource { resource: create_resource(&gpu, D3D12_HEAP_TYPE_DEFAULT, &levels, common), state: common };
    let floats = writable_texture(&gpu, (4, 4), DXGI_FORMAT_R32G32B32A32_FLOAT, common);
    let fits = planes(&source, (2, 3), false, 0);
    for (planes, target, field) in [
        (Planes { size: (0, 3), ..fits }, &good, "size"),
        (Planes { size: (2, 16_385), ..fits }, &good, "size"),
        (Planes { picture: 1, ..fits }, &good, "buffer"),
        (Planes { picture: u32::MAX, ..fits }, &good, "picture"),
        (Planes { size: (3, 3), ..fits }, &good, "buffer"),
        (Planes { buffer: good.with_state(), ..fits }, &good, "buffer"),
        (Planes { buffer: foreign.0.with_state(), ..fits }, &good, "buffer"),
        (fits, &source, "texture"),
        (fits, &foreign.1, "texture"),
        (fits, &unwritable, "texture"),
        (fits, &levels, "texture"),
        (fits, &floats, "texture"),
    ] {
        let mut frame = frames.begin().expect("a frame");
        let refused = resize.record(&mut frame, &planes, &target.with_state()).expect_err("it cannot be");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)), "{refused}");
        // Had anything been recorded, this would not be the first use of the texture.
        let rendered = ResourceWithState { resource: &good.resource, state: D3D12_RESOURCE_STATE_RENDER_TARGET };
        resize.record(&mut frame, &fits, &rendered).expect("it fits");
        let refused = resize.record(&mut frame, &fits, &good.with_state()).expect_err("two states");
        assert_eq!(refused.offending_field(), Some("state"));
        resize.record(&mut frame, &fits, &rendered).expect("it fits twice");
        let refused = resize.record(&mut frame, &fits, &rendered).expect_err("it is full");
        assert_eq!(refused.kind(), ErrorKind::Unsupported);
    }
    let mut frames = CommandRing::new(&gpu, gpu.anchors(), 2).expect("a ring");
    let rendered = ResourceWithState { resource: &good.resource, state: D3D12_RESOURCE_STATE_RENDER_TARGET };
    let refused = resize.record(&mut frames.begin().expect("a frame"), &fits, &rendered).expect_err("a compute queue");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("state")));
    run_list(&gpu, |list| {
        let (_, opened) = gate(&gpu);
        assert_eq!(frames.begin_in(list, &opened).expect_err("a direct list").offending_field(), Some("list"));
    });
    for descriptors in [0, 400_000, u32::MAX] {
        let refused = CommandRing::new(&gpu, gpu.frames(), descriptors).expect_err("no such heap");
        assert_eq!(refused.offending_field(), Some("descriptors"));
    }
}

#[test]
fn a_removed_device_is_reported_by_every_call_and_all_is_released() {
    let gpu = gpu();
    let resize = Resize::new(&gpu).expect("the shader");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 2).expect("a ring");
    let source = upload_buffer(&gpu, &[0; 12]);
    let target = writable_texture(&gpu, (4, 4), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON);
    let mut frame = frames.begin().expect("a frame");
    resize.record(&mut frame, &planes(&source, (1, 1), false, 0), &target.with_state()).expect("it is recorded");
    // Executing a list that is still open removes the device.
    // SAFETY: a live device.
    let allocator: ID3D12CommandAllocator =
        unsafe { gpu.device().CreateCommandAllocator(gpu.frames().kind()) }.expect("an allocator");
    // SAFETY: a live device and allocator.
    let list: ID3D12CommandList =
        unsafe { gpu.device().CreateCommandList(0, gpu.frames().kind(), &allocator, None) }.expect("a list");
    assert_eq!(gpu.frames().submit(&[list]).expect_err("the device is gone").kind(), ErrorKind::DeviceRemoved);
    assert_eq!(frame.submit(gpu.frames()).expect_err("the device is gone").kind(), ErrorKind::DeviceRemoved);
    assert_eq!(frames.begin().expect_err("the device is gone").kind(), ErrorKind::DeviceRemoved);
    drop((frames, resize));
    assert_eq!(reference_count(&target.resource), 1, "nothing else holds it");
    for made in [Resize::new(&gpu).map(drop), CommandRing::new(&gpu, gpu.frames(), 2).map(drop)] {
        // A driver may still create objects; if it refuses, the error must be device removal.
        assert!(made.is_ok() || made.is_err_and(|e| e.kind() == ErrorKind::DeviceRemoved));
    }
}

#[test]
fn the_papers_guidance_equals_the_processors_within_two_half_float_steps() {
    paper_guidance::compare(&gpu());
}

#[test]
fn latents_and_textures_that_do_not_fit_are_refused_by_name() {
    let gpu = gpu();
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 6).expect("a ring");
    for shape in [[0, 4, 4], [1, 0, 4], [1, 4, 20_000], [usize::MAX, 2, 2]] {
        assert_eq!(GpuExtractor::new(&gpu, shape, false).expect_err("no latent").offending_field(), Some("latent"));
    }
    let extractor = GpuExtractor::new(&gpu, [1, 4, 4], false).expect("the shaders");
    let latents = upload_buffer(&gpu, &[0; 64]);
    let short = LatentBuffer { buffer: latents.with_state(), first: 1 };
    let fits = LatentBuffer { first: 0, ..short };
    let common = D3D12_RESOURCE_STATE_COMMON;
    let motion = writable_texture(&gpu, (8, 8), DXGI_FORMAT_R16G16_FLOAT, common);
    let depth = writable_texture(&gpu, (8, 8), DXGI_FORMAT_R32_FLOAT, common);
    let smaller = writable_texture(&gpu, (8, 4), DXGI_FORMAT_R32_FLOAT, common);
    let mut frame = frames.begin().expect("a frame");
    for (z0, z1, motion, depth, field) in [
        (short, fits, &motion, &depth, "z0"),
        (fits, LatentBuffer { first: u32::MAX, ..fits }, &motion, &depth, "z1"),
        (fits, fits, &depth, &depth, "motion"),
        (fits, fits, &motion, &motion, "depth"),
        (fits, fits, &motion, &smaller, "depth"),
    ] {
        let refused = extractor.record(&mut frame, &z0, &z1, &motion.with_state(), &depth.with_state());
        assert_eq!(refused.expect_err("it cannot be").offending_field(), Some(field));
    }
}
