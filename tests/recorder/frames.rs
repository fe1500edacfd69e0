//! Frames of the library: pictures are resized on the queue for anchors, and frames are generated from them on the queue for frames, which
//! waits for it.

use cairn::Result;
use cairn::framegen::shader::{DESCRIPTORS, ShaderGenerator};
use cairn::gpu::compute::CommandRing;
use cairn::gpu::{Gpu, Resize, read_texture};
use test_support::d3d12::frame_scene::FrameScene;

use crate::mutants::{self, Mutant};

/// More than are in flight, so that allocators and descriptors are used again.
const FRAMES: u32 = 5;

/// Descriptors of a frame of each ring.
pub(crate) const OF_ANCHOR: u32 = 2;
pub(crate) const OF_FRAME: u32 = DESCRIPTORS;

/// Runs the frames, with a mutant of the library's calls from the first of them on.
pub(crate) fn run(mutant: Option<Mutant>) -> Result<()> {
    let gpu = Gpu::on_adapter(None)?;
    mutants::install(&gpu);
    let resize = Resize::new(&gpu)?;
    let mut generator = ShaderGenerator::new(&gpu, FrameScene::SIZE)?;
    let mut anchors = CommandRing::new(&gpu, gpu.anchors(), OF_ANCHOR)?;
    let mut frames = CommandRing::new(&gpu, gpu.frames(), OF_FRAME)?;
    let scene = FrameScene::new(&gpu)?;

    let _active = mutants::activate(&gpu, mutant);
    for number in 0..FRAMES {
        let mut anchor = anchors.begin()?;
        resize.record(&mut anchor, &scene.planes(), &scene.resized.with_state())?;
        let made = anchor.submit(gpu.anchors())?;
        gpu.frames().wait(&made)?;
        let mut frame = frames.begin()?;
        let t = (number + 1) as f32 / (FRAMES + 1) as f32;
        generator.generate(&mut frame, &scene.pair(), t, &scene.out.with_state())?;
        let shown = frame.submit(gpu.frames())?;
        gpu.anchors().wait(&shown)?;
    }
    read_texture(&gpu, &scene.out.resource, scene.out.state)?;
    Ok(())
}
