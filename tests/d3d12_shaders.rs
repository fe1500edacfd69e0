//! The library's compute shaders compared with the processor's results, and the command ring that records them. On Windows, or in the lab.
#![cfg(windows)]

use cairn::gpu::compute::{CommandRing, FRAMES_IN_FLIGHT, ResourceWithState};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{FencePoint, Gpu, Planes, Resize};
use cairn::guidance::paper::{self, GpuExtractor, LatentBuffer};
use cairn::guidance::{Guidance, LatentView};
use cairn::world::Bilinear;
use cairn::{ErrorKind, Picture};
use half::f16;
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

/// Values without a pattern, some outside [0, 1].
fn numbers(len: usize) -> Vec<f32> {
    let mut state = 7_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32 * 1.2 - 0.1
    };
    (0..len).map(|_| next()).collect()
}

fn planes(buffer: &TestResource, size: (u32, u32), half: bool, picture: u32) -> Planes<'_> {
    Planes { buffer: buffer.with_state(), picture, size, half }
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
    let gpu = gpu();
    let resize = Resize::new(&gpu).expect("the shader");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 2).expect("a ring");
    let rests = [
        D3D12_RESOURCE_STATE_COMMON,
        D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE,
        D3D12_RESOURCE_STATE_UNORDERED_ACCESS,
    ];
    let (mut bytes, mut off) = (0, 0);
    for (case, (from, to)) in
        [((7, 5), (7, 5)), ((20, 12), (37, 23)), ((64, 36), (19, 40)), ((1, 1), (9, 3)), ((45, 80), (256, 144))]
            .into_iter()
            .enumerate()
    {
        let half = case % 2 == 1;
        let len = 3 * (from.0 * from.1) as usize;
        // Only the second of two pictures in the buffer.
        let mut values = numbers(2 * len);
        let contents: Vec<u8> = if half {
            let halves: Vec<f16> = values.iter().map(|v| f16::from_f32(*v)).collect();
            values = halves.iter().map(|v| v.to_f32()).collect();
            halves.iter().flat_map(|v| v.to_le_bytes()).collect()
        } else {
            values.iter().flat_map(|v| v.to_le_bytes()).collect()
        };
        let mut expected = Picture::new(to.0, to.1).expect("a picture");
        Bilinear::new(from, to).to_picture(&values[len..], &mut expected);
        let buffer = upload_buffer(&gpu, &contents);
        let row = to.0 as usize;
        let mut resized = |format, size: usize| {
            let target = writable_texture(&gpu, to, format, rests[case % rests.len()]);
            let mut frame = frames.begin().expect("a frame");
            if let Err(refused) = resize.record(&mut frame, &planes(&buffer, from, half, 1), &target.with_state()) {
                // Not every device supports UAV stores in every format.
                assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("texture")));
                return None;
            }
            frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
            Some(read_texture(&gpu, &target, row * size))
        };
        let rgba = resized(DXGI_FORMAT_R8G8B8A8_UNORM, 4).expect("every device writes it");
        if let Some(bgra) = resized(DXGI_FORMAT_B8G8R8A8_UNORM, 4) {
            let bgra = bgra.chunks(4).flat_map(|p| [p[2], p[1], p[0], p[3]]);
            assert!(bgra.eq(rgba.iter().copied()), "the order of channels is all that differs");
        }
        for (found, wanted) in rgba.iter().zip(expected.rgba()) {
            assert!(found.abs_diff(*wanted) <= 1, "{found} for {wanted} from {from:?} to {to:?}");
            bytes += 1;
            off += usize::from(found != wanted);
        }
        // Half floats match the value before it is rounded to 8 bits.
        let halves = resized(DXGI_FORMAT_R16G16B16A16_FLOAT, 8).expect("every device writes it");
        let ten = resized(DXGI_FORMAT_R10G10B10A2_UNORM, 4).expect("this one too");
        let pixels = halves.chunks_exact(8).zip(ten.chunks_exact(4)).zip(expected.pixels());
        for ((halves, ten), wanted) in pixels {
            let ten = u32::from_le_bytes([ten[0], ten[1], ten[2], ten[3]]);
            assert_eq!((&halves[6..], ten >> 30), (&f16::ONE.to_le_bytes()[..], 3), "it is opaque");
            for channel in 0..3 {
                let half = f16::from_le_bytes([halves[2 * channel], halves[2 * channel + 1]]).to_f32();
                let ten = (ten >> (10 * channel) & 1023) as f32 / 1023.0;
                let wanted = f32::from(wanted[channel]) / 255.0;
                // The sum of half a step of each format.
                assert!((half - wanted).abs() <= 0.5 / 255.0 + 0.001, "{half} for {wanted}");
                assert!((half - ten).abs() <= 0.5 / 1023.0 + 0.001, "{ten} for {half}");
            }
        }
    }
    assert!(off * 1000 <= bytes, "{off} of {bytes} bytes are not the processor's own");
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

/// The number of half float steps between two values; those near 0 count as neighbours of the smallest normal half float.
fn half_steps(a: f32, b: f32) -> f32 {
    let size = a.abs().max(b.abs()).max(f16::MIN_POSITIVE.to_f32());
    (a - b).abs() / (size.log2().floor() - 10.0).exp2()
}

#[test]
fn the_papers_guidance_equals_the_processors_within_two_half_float_steps() {
    let gpu = gpu();
    let mut frames = CommandRing::new(&gpu, gpu.frames(), 6).expect("a ring");
    let bytes = |values: &[f32], half: bool| -> Vec<u8> {
        if half {
            values.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes()).collect()
        } else {
            values.iter().flat_map(|v| v.to_le_bytes()).collect()
        }
    };
    for (case, (shape, render)) in
        [([16, 9, 16], (128, 72)), ([32, 20, 33], (77, 123)), ([3, 1, 5], (20, 1)), ([1, 4, 4], (2, 3))]
            .into_iter()
            .enumerate()
    {
        for (kind, change) in [
            // Latents with a small relative difference, with NaN among them, and with the largest values.
            (|v: f32, _: usize| v * 50.0 + 1e-3) as fn(f32, usize) -> f32,
            |v, i| {
                if i % 37 == 5 { [f32::NAN, f32::INFINITY, -f32::INFINITY][i % 3] } else { v + (i % 7) as f32 * 0.1 }
            },
            |v, i| if i % 2 == 0 { v * 3e38 } else { -v * 1e30 },
            |v, _| v,
        ]
        .into_iter()
        .enumerate()
        {
            let half = (case + kind) % 2 == 1 && kind != 2;
            let len: usize = shape.iter().product();
            let as_stored = |v: f32| if half { f16::from_f32(v).to_f32() } else { v };
            let z0: Vec<f32> = numbers(len).into_iter().map(|v| as_stored(v * 50.0)).collect();
            let z1: Vec<f32> = numbers(len).into_iter().enumerate().map(|(i, v)| as_stored(change(v, i))).collect();
            let mut expected = Guidance::new(render.0, render.1, paper::PROJECTION).expect("guidance");
            let view = |z| LatentView::new(shape[0], shape[1], shape[2], z).expect("a latent");
            paper::extract(view(&z0), view(&z1), render, &mut expected).expect("an extraction");

            // Both in one buffer, the current one first.
            let both = upload_buffer(&gpu, &[bytes(&z1, half), bytes(&z0, half)].concat());
            let latent = |first: usize| LatentBuffer { buffer: both.with_state(), first: first as u32 };
            let motion =
                writable_texture(&gpu, render, DXGI_FORMAT_R16G16_FLOAT, D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE);
            let depth = writable_texture(&gpu, render, DXGI_FORMAT_R32_FLOAT, D3D12_RESOURCE_STATE_COMMON);
            let extractor = GpuExtractor::new(&gpu, shape, half).expect("the shaders");
            let mut frame = frames.begin().expect("a frame");
            extractor
                .record(&mut frame, &latent(len), &latent(0), &motion.with_state(), &depth.with_state())
                .expect("recorded");
            frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");

            let row = render.0 as usize * 4;
            let found = read_texture(&gpu, &motion, row);
            let wanted = expected.motion().vectors().iter().flatten();
            for (i, (found, wanted)) in found.chunks_exact(2).zip(wanted).enumerate() {
                let (found, wanted) = (f16::from_le_bytes([found[0], found[1]]).to_f32(), wanted.to_f32());
                assert!(
                    half_steps(found, wanted) <= 2.0,
                    "motion {found} for {wanted} at {i} of {shape:?}, kind {kind}"
                );
            }
            let found = read_texture(&gpu, &depth, row);
            for (i, (found, wanted)) in found.chunks_exact(4).zip(expected.depth().depth()).enumerate() {
                let found = f32::from_le_bytes([found[0], found[1], found[2], found[3]]);
                assert!(
                    half_steps(found, *wanted) <= 2.0,
                    "depth {found} for {wanted} at {i} of {shape:?}, kind {kind}"
                );
            }
        }
    }
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
