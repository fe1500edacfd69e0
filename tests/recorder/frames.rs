//! Frames of the library: pictures are resized on the queue for anchors, and frames are generated from them on the queue for frames, which
//! waits for it.

use cairn::Picture;
use cairn::Result;
use cairn::framegen::shader::{DESCRIPTORS, GuidanceTextures, ShaderGenerator, TexturePair};
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{Gpu, Planes, Resize, read_texture, texture_from_picture};
use cairn::guidance::MotionOrigin;
use test_support::d3d12::resources::{TestResource, upload_buffer, upload_texture, writable_texture};

use crate::mutants::{self, Mutant};

const SIZE: (u32, u32) = (96, 64);
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
    let mut generator = ShaderGenerator::new(&gpu, SIZE)?;
    let mut anchors = CommandRing::new(&gpu, gpu.anchors(), OF_ANCHOR)?;
    let mut frames = CommandRing::new(&gpu, gpu.frames(), OF_FRAME)?;

    let pixel = |x: u32, y: u32| [(x * 5 + y) as u8, (y * 3 + x * x / 16) as u8, (x ^ y) as u8, 255];
    let bytes: Vec<u8> = (0..SIZE.1).flat_map(|y| (0..SIZE.0).flat_map(move |x| pixel(x, y))).collect();
    let mut picture = Picture::new(SIZE.0, SIZE.1)?;
    picture.rgba_mut().copy_from_slice(&bytes);
    let (current, _) = texture_from_picture(&gpu, &picture)?;
    let current = TestResource { resource: current, state: D3D12_RESOURCE_STATE_COMMON };
    let plane = |channel: usize| bytes.iter().skip(channel).step_by(4).map(|&byte| f32::from(byte) / 255.0);
    let planes: Vec<u8> = (0..3).flat_map(plane).flat_map(f32::to_le_bytes).collect();
    let decoded = upload_buffer(&gpu, &planes);
    let resized = writable_texture(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON);
    let count = (SIZE.0 / 8 * (SIZE.1 / 8)) as usize;
    let tiles = (SIZE.0 / 8, SIZE.1 / 8);
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

    let _active = mutants::activate(&gpu, mutant);
    for number in 0..FRAMES {
        let mut anchor = anchors.begin()?;
        let planes = Planes { buffer: decoded.with_state(), picture: 0, size: SIZE, half: false };
        resize.record(&mut anchor, &planes, &resized.with_state())?;
        let made = anchor.submit(gpu.anchors())?;
        gpu.frames().wait(&made)?;
        let mut frame = frames.begin()?;
        let pair = TexturePair {
            previous: resized.with_state(),
            current: current.with_state(),
            guidance,
            previous_depth: None,
            cut: false,
        };
        let t = (number + 1) as f32 / (FRAMES + 1) as f32;
        generator.generate(&mut frame, &pair, t, &out.with_state())?;
        let shown = frame.submit(gpu.frames())?;
        gpu.anchors().wait(&shown)?;
    }
    read_texture(&gpu, &out.resource, out.state)?;
    Ok(())
}
