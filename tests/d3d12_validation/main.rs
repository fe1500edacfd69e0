//! Programs for Vulkan's validation layer below Direct3D 12: frames of the library, with one of its calls altered where
//! `CAIRN_VALIDATION_MUTANT` names a mutant, and the same sorts of calls without the library. `cargo xtask test validation` judges the layer's
//! messages. In the lab.
#![cfg(windows)]

use cairn::framegen::shader::ShaderGenerator;
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::{FencePoint, Gpu, Resize};
use test_support::d3d12::frame_scene::FrameScene;

mod mutants;
mod system_calls;
use mutants::Mutant;

/// Two frames are in flight: each resizes a decoded picture into a texture, which the generator reads in the same list.
#[test]
fn frames_in_flight_read_what_earlier_dispatches_write() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    if let Some(mutant) = Mutant::from_environment() {
        mutants::install(mutant, &gpu);
    }
    let resize = Resize::new(&gpu).expect("the shader");
    let mut generator = ShaderGenerator::new(&gpu, FrameScene::SIZE).expect("a generator");
    let mut frames = CommandRing::new(&gpu, gpu.frames(), mutants::DESCRIPTORS_OF_FRAME).expect("a ring");
    let scene = FrameScene::new(&gpu).expect("textures");

    // The queue waits for this fence, so that the first frame is in flight while the second is recorded.
    // SAFETY: values only.
    let gate: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    gpu.frames().wait(&FencePoint::of_engine(&gpu, &gate, 1).expect("a fence of the device")).expect("a wait");
    let mut points = Vec::new();
    for t in [0.25, 0.75] {
        let mut frame = frames.begin().expect("a frame");
        resize.record(&mut frame, &scene.planes(), &scene.resized.with_state()).expect("it is recorded");
        generator.generate(&mut frame, &scene.pair(), t, &scene.out.with_state()).expect("it is recorded");
        points.push(frame.submit(gpu.frames()).expect("a submission"));
    }
    assert!(points.iter().all(|point| !point.reached()), "both are in flight");
    // SAFETY: a live fence.
    unsafe { gate.Signal(1) }.expect("the gate opens");
    points.iter().for_each(|point| point.wait().expect("it is done"));
}
