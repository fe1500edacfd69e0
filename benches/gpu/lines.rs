//! The measurements.

use cairn::framegen::shader::{self, GuidanceTextures, ShaderGenerator, TexturePair};
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{Gpu, adapters};
use cairn::guidance::MotionOrigin;
use cairn::guidance::picture_flow::{self, GpuExtractor};
use half::f16;

use gpu_testing::blend::{Blend, Clock};
use test_support::d3d12::resources::{TestResource, upload_texture, writable_texture};

/// Turns of each line.
const TURNS: usize = 9;
/// Bytes per pixel that a blend moves: two pictures, and their mean.
const BLENDED: f64 = 12.0;
/// Lower bound for a frame, in bytes per pixel: two pictures, motion in half floats, depth in floats, and the frame.
const MIN_FRAME_BYTES: f64 = 20.0;
/// Lower bound for optical flow: two pictures, and motion in half floats.
const MIN_MOTION_BYTES: f64 = 12.0;
/// Phases of the frames between two anchors at four frames per anchor.
const PHASES: [f32; 3] = [0.25, 0.5, 0.75];

/// Pictures, motion and depth of a ground that moves by 12 pixels, behind pillars that move by 4 pixels in the opposite direction.
fn scene((width, height): (u32, u32)) -> ([Vec<u8>; 2], Vec<f16>, Vec<f32>) {
    let is_pillar = |x: i32| x / 40 % 8 == 3;
    let ground = |x: i32, y: i32| {
        let wave = (x as f32 * 0.11).sin() + (y as f32 * 0.17 + x as f32 * 0.03).sin();
        [128.0 + 60.0 * wave, 120.0 + 40.0 * wave, 90.0 + ((x ^ y) & 15) as f32, 255.0].map(|v| v as u8)
    };
    let pixel = |x: i32, y: i32, is_previous: bool| {
        let (pillar, ground_x) = if is_previous { (x + 4, x - 12) } else { (x, x) };
        if is_pillar(pillar) { ground(7 * pillar + 1000, 5 * y) } else { ground(ground_x, y) }
    };
    let pixels = || (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| (x, y)));
    let pictures = [true, false].map(|is_previous| pixels().flat_map(|(x, y)| pixel(x, y, is_previous)).collect());
    let motion = pixels().flat_map(|(x, _)| [if is_pillar(x) { -4.0 } else { 12.0 }, 0.0]).map(f16::from_f32).collect();
    (pictures, motion, pixels().map(|(x, _)| if is_pillar(x) { 0.4 } else { 0.99 }).collect())
}

fn guidance<'a>(motion: &'a TestResource, depth: &'a TestResource, depth_tile: u32) -> GuidanceTextures<'a> {
    GuidanceTextures {
        motion: motion.with_state(),
        motion_tile: 1,
        depth: depth.with_state(),
        depth_tile,
        motion_origin: MotionOrigin::default(),
        hud: None,
    }
}

struct Line<'a> {
    name: &'static str,
    /// Bytes per pixel that must be moved.
    min_bytes: f64,
    record: Box<dyn FnMut(&ID3D12GraphicsCommandList) + 'a>,
    seconds: Vec<f64>,
}

pub(crate) fn run() {
    let is_measured = std::env::args().any(|argument| argument == "--bench");
    let (size, turns) = if is_measured { ((1920, 1080), TURNS) } else { ((64, 40), 1) };
    let gpu = &Gpu::on_adapter(None).expect("a device");
    let (pictures, motion, depth) = scene(size);
    let [before, after] = pictures.each_ref().map(|rows| upload_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, rows));
    let motion = upload_texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT, bytemuck::cast_slice(&motion));
    let depth = upload_texture(gpu, size, DXGI_FORMAT_R32_FLOAT, bytemuck::cast_slice(&depth));
    let out = writable_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
    let found = writable_texture(gpu, size, DXGI_FORMAT_R16G16_FLOAT, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
    let tiles = (size.0.div_ceil(16), size.1.div_ceil(16));
    let flat = writable_texture(gpu, tiles, DXGI_FORMAT_R32_FLOAT, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
    let pair = TexturePair {
        previous: before.with_state(),
        current: after.with_state(),
        guidance: guidance(&motion, &depth, 1),
        previous_depth: None,
        cut: false,
    };
    let flow_pair = TexturePair { guidance: guidance(&found, &flat, 16), ..pair };

    let generator = || ShaderGenerator::new(gpu, size).expect("a generator");
    let ring = |descriptors| CommandRing::new(gpu, gpu.frames(), descriptors).expect("a ring");
    let line = |name, min_bytes, record| Line { name, min_bytes, record, seconds: Vec::new() };
    let blend = Blend::new(gpu, [&before, &after, &out], size);
    let (one_frame, mut ring_of_one_frame) = (&mut generator(), ring(shader::DESCRIPTORS));
    let (three_frames, mut ring_of_three_frames) = (&mut generator(), ring(2 * shader::DESCRIPTORS));
    let (extrapolator, mut ring_of_extrapolator) = (&mut generator(), ring(shader::DESCRIPTORS));
    let (with_flow, mut ring_of_with_flow) = (&mut generator(), ring(shader::DESCRIPTORS + picture_flow::DESCRIPTORS));
    let (extractor, mut ring_of_flow) =
        (&GpuExtractor::new(gpu, size).expect("an extractor"), ring(picture_flow::DESCRIPTORS));
    let mut lines: Vec<Line<'_>> = vec![
        line("a blend of two textures", BLENDED, Box::new(|list| blend.record(list))),
        line(
            "a frame between two anchors",
            MIN_FRAME_BYTES,
            Box::new(|list| {
                let now = gpu.frames().signal().expect("a fence point");
                let mut frame = ring_of_one_frame.begin_in(list, &now).expect("a frame");
                one_frame.generate(&mut frame, &pair, 0.5, &out.with_state()).expect("it is recorded");
            }),
        ),
        line(
            "three frames of one pair",
            3.0 * MIN_FRAME_BYTES,
            Box::new(|list| {
                let now = gpu.frames().signal().expect("a fence point");
                let mut frame = ring_of_three_frames.begin_in(list, &now).expect("a frame");
                three_frames.prepare(&mut frame, &pair).expect("it is recorded");
                for t in PHASES {
                    three_frames.interpolate(&mut frame, &pair, t, &out.with_state()).expect("it is recorded");
                }
            }),
        ),
        line(
            "a frame beyond the last anchor",
            MIN_FRAME_BYTES - 4.0,
            Box::new(|list| {
                let now = gpu.frames().signal().expect("a fence point");
                let mut frame = ring_of_extrapolator.begin_in(list, &now).expect("a frame");
                let (current, guidance) = (&pair.current, &pair.guidance);
                extrapolator
                    .extrapolate(&mut frame, current, guidance, false, 0.5, &out.with_state())
                    .expect("it is recorded");
            }),
        ),
        line(
            "motion of two pictures",
            MIN_MOTION_BYTES,
            Box::new(|list| {
                let now = gpu.frames().signal().expect("a fence point");
                let mut frame = ring_of_flow.begin_in(list, &now).expect("a frame");
                let (motion, depth) = (found.with_state(), flat.with_state());
                extractor.record(&mut frame, &pair.previous, &pair.current, &motion, &depth).expect("it is recorded");
            }),
        ),
        line(
            "that motion, and a frame",
            MIN_MOTION_BYTES + MIN_FRAME_BYTES,
            Box::new(|list| {
                let now = gpu.frames().signal().expect("a fence point");
                let mut frame = ring_of_with_flow.begin_in(list, &now).expect("a frame");
                let (motion, depth) = (found.with_state(), flat.with_state());
                extractor.record(&mut frame, &pair.previous, &pair.current, &motion, &depth).expect("it is recorded");
                with_flow.generate(&mut frame, &flow_pair, 0.5, &out.with_state()).expect("it is recorded");
            }),
        ),
    ];

    let clock = Clock::new(gpu);
    // The first turn is not counted, because drivers allocate at first use.
    for turn in 0..=turns {
        for line in &mut lines {
            let seconds = clock.time(gpu, &mut line.record);
            if turn > 0 {
                line.seconds.push(seconds);
            }
        }
    }
    if !is_measured {
        return;
    }
    let adapters = adapters().expect("adapters");
    let name =
        adapters.iter().find(|adapter| adapter.luid == gpu.luid()).map_or("a device", |found| &found.description);
    println!("{} x {} on what calls itself {name}, {turns} turns", size.0, size.1);
    println!("{:32} {:>10} {:>9} {:>24}", "", "ms", "blends", "bytes a pixel (least)");
    let mut blended = 0.0;
    for line in &mut lines {
        line.seconds.sort_by(f64::total_cmp);
        let median = line.seconds[line.seconds.len() / 2];
        blended = if blended == 0.0 { median } else { blended };
        let ratio = median / blended;
        let bytes = format!("{:.0} ({})", ratio * BLENDED, line.min_bytes);
        println!("{:32} {:>10.3} {ratio:>9.2} {bytes:>24}", line.name, 1e3 * median);
    }
}
