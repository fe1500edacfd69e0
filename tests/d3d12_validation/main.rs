//! Programs for Vulkan's validation layer below Direct3D 12: frames of the library, with one of its calls altered where
//! `CAIRN_VALIDATION_MUTANT` names a mutant, and the same sorts of calls without the library. `cargo xtask test validation` judges the layer's
//! messages. In the lab.
#![cfg(windows)]

use cairn::Picture;
use cairn::framegen::shader::{GuidanceTextures, ShaderGenerator, TexturePair};
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{FencePoint, Gpu, Planes, Resize, texture_from_picture};
use cairn::guidance::MotionOrigin;
use test_support::d3d12::resources::{TestResource, upload_buffer, upload_texture, writable_texture};

mod mutants;
mod system_calls;
use mutants::Mutant;

const SIZE: (u32, u32) = (96, 64);

/// Two frames are in flight: each resizes a decoded picture into a texture, which the generator reads in the same list.
#[test]
fn frames_in_flight_read_what_earlier_dispatches_write() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    if let Some(mutant) = Mutant::from_environment() {
        mutants::install(mutant, &gpu);
    }
    let resize = Resize::new(&gpu).expect("the shader");
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), mutants::DESCRIPTORS_OF_FRAME).expect("a ring");

    let pixel = |x: u32, y: u32| [(x * 5 + y) as u8, (y * 3 + x * x / 16) as u8, (x ^ y) as u8, 255];
    let bytes: Vec<u8> = (0..SIZE.1).flat_map(|y| (0..SIZE.0).flat_map(move |x| pixel(x, y))).collect();
    let mut picture = Picture::new(SIZE.0, SIZE.1).expect("a picture");
    picture.rgba_mut().copy_from_slice(&bytes);
    let (current, _) = texture_from_picture(&gpu, &picture).expect("a texture");
    let current = TestResource { resource: current, state: D3D12_RESOURCE_STATE_COMMON };
    // The same picture as planes of floats, so that it is no cut.
    let plane = |channel: usize| bytes.iter().skip(channel).step_by(4).map(|&byte| f32::from(byte) / 255.0);
    let planes: Vec<u8> = (0..3).flat_map(plane).flat_map(f32::to_le_bytes).collect();
    let decoded = upload_buffer(&gpu, &planes);
    let resized = writable_texture(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON);
    let tiles = (SIZE.0 / 8, SIZE.1 / 8);
    let count = (tiles.0 * tiles.1) as usize;
    let motion = upload_texture(&gpu, tiles, DXGI_FORMAT_R16G16_FLOAT, &[0, 0x40, 0, 0].repeat(count));
    let depth = upload_texture(&gpu, tiles, DXGI_FORMAT_R32_FLOAT, &0.5_f32.to_le_bytes().repeat(count));
    let guidance = GuidanceTextures {
        motion: motion.with_state(),
        motion_tile: 8,
        depth: depth.with_state(),
        depth_tile: 8,
        motion_origin: MotionOrigin::OpticalFlow,
        hud: None,
    };
    let out = writable_texture(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON);

    // The queue waits for this fence, so that the first frame is in flight while the second is recorded.
    // SAFETY: values only.
    let gate: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    gpu.frames().wait(&FencePoint::of_engine(&gpu, &gate, 1).expect("a fence of the device")).expect("a wait");
    let mut points = Vec::new();
    for t in [0.25, 0.75] {
        let mut frame = frames.begin().expect("a frame");
        let planes = Planes { buffer: decoded.with_state(), picture: 0, size: SIZE, half: false };
        resize.record(&mut frame, &planes, &resized.with_state()).expect("it is recorded");
        let pair = TexturePair {
            previous: resized.with_state(),
            current: current.with_state(),
            guidance,
            previous_depth: None,
            cut: false,
        };
        generator.generate(&mut frame, &pair, t, &out.with_state()).expect("it is recorded");
        points.push(frame.submit(gpu.frames()).expect("a submission"));
    }
    assert!(points.iter().all(|point| !point.reached()), "both are in flight");
    // SAFETY: a live fence.
    unsafe { gate.Signal(1) }.expect("the gate opens");
    points.iter().for_each(|point| point.wait().expect("it is done"));
}
