//! Optical flow between two pictures on the device, compared with the processor's.

use cairn::Picture;
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::D3D12_RESOURCE_STATE_COMMON;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{Gpu, System};
use cairn::guidance::picture_flow::{self, DESCRIPTORS, FLAT_DEPTH, GpuExtractor};
use cairn::guidance::{Guidance, paper};
use half::f16;

use crate::frame_cases::Random;
use crate::resources::{TestResource, read_texture, upload_texture, writable_texture};

/// Motion in pixels, pixel by pixel.
pub type Vectors = Vec<[f32; 2]>;

/// The picture in a texture that shaders only read.
pub fn upload_picture(gpu: &Gpu, picture: &Picture) -> TestResource {
    upload_texture(gpu, picture.size(), DXGI_FORMAT_R8G8B8A8_UNORM, picture.rgba())
}

/// An extractor with its output textures.
pub struct Extraction<'g> {
    gpu: &'g Gpu,
    /// The extractor.
    pub extractor: GpuExtractor,
    /// Its command lists.
    pub frames: CommandRing,
    /// Motion.
    pub motion: TestResource,
    /// Depth, a texel for each tile.
    pub depth: TestResource,
    size: (u32, u32),
    tile: u32,
}

impl<'g> Extraction<'g> {
    /// An extractor for pictures of `size`, with motion in that format and depth in tiles.
    pub fn new(gpu: &'g Gpu, size: (u32, u32), motion: DXGI_FORMAT, tile: u32) -> Self {
        let state = D3D12_RESOURCE_STATE_COMMON;
        let depth_size = (size.0.div_ceil(tile), size.1.div_ceil(tile));
        Self {
            gpu,
            extractor: GpuExtractor::new(gpu, size).expect("an extractor"),
            frames: CommandRing::new(gpu, gpu.frames(), DESCRIPTORS).expect("a ring"),
            motion: writable_texture(gpu, size, motion, state),
            depth: writable_texture(gpu, depth_size, DXGI_FORMAT_R32_FLOAT, state),
            size,
            tile,
        }
    }

    /// The bytes of the texture with the device's motion, of `texel` bytes per pixel.
    pub fn bytes(&mut self, [previous, current]: [&TestResource; 2], texel: usize) -> Vec<u8> {
        let mut frame = self.frames.begin().expect("a frame");
        let (motion, depth) = (self.motion.with_state(), self.depth.with_state());
        self.extractor
            .record(&mut frame, &previous.with_state(), &current.with_state(), &motion, &depth)
            .expect("it is recorded");
        frame.submit(self.gpu.frames()).expect("a submission").wait().expect("it is done");
        read_texture(self.gpu, &self.motion, self.size.0 as usize * texel)
    }

    /// The device's motion in pixels. Also checks the depth against the documented value.
    pub fn vectors(&mut self, pair: [&Picture; 2]) -> Vectors {
        let textures = pair.map(|picture| upload_picture(self.gpu, picture));
        let halves = self.bytes([&textures[0], &textures[1]], 4);
        let depth = read_texture(self.gpu, &self.depth, self.size.0.div_ceil(self.tile) as usize * 4);
        assert!(depth.chunks(4).all(|bytes| bytes == FLAT_DEPTH.to_le_bytes()));
        let half = |bytes: &[u8]| f16::from_le_bytes([bytes[0], bytes[1]]).to_f32();
        halves.chunks(4).map(|vector| [half(vector), half(&vector[2..])]).collect()
    }
}

/// The processor's motion.
pub fn expected(previous: &Picture, current: &Picture) -> Vectors {
    let mut out = Guidance::new(1, 1, paper::PROJECTION).expect("a guidance");
    picture_flow::extract(previous, current, &mut out).expect("motion");
    out.motion().vectors().iter().map(|vector| vector.map(f16::to_f32)).collect()
}

/// Distances between two motion fields, pixel by pixel, in ascending order.
pub fn distances(found: &[[f32; 2]], wanted: &[[f32; 2]]) -> Vec<f32> {
    assert_eq!(found.len(), wanted.len());
    let mut apart: Vec<f32> = found.iter().zip(wanted).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).collect();
    apart.sort_by(f32::total_cmp);
    apart
}

/// Motion of a pair on the device, and its distances from the processor's in ascending order. In the lab, whose device rounds quotients
/// correctly, both must be equal to the bit: the same operations, in the same order.
pub fn compare(extraction: &mut Extraction<'_>, pair: [&Picture; 2], what: &str) -> (Vectors, Vec<f32>) {
    let (found, wanted) = (extraction.vectors(pair), expected(pair[0], pair[1]));
    let apart = distances(&found, &wanted);
    let (last, far) = (apart.len() - 1, apart.iter().filter(|&&d| d > 0.25).count());
    let longest = wanted.iter().map(|[u, v]| u.hypot(*v)).fold(0.0, f32::max);
    let differing = apart.iter().filter(|&&d| d > 0.0).count();
    println!(
        "{what}: motion up to {longest:.1} px, {differing} of {} differ, {far} are far, {:?} at most",
        last + 1,
        apart[last]
    );
    let is_in_lab = System::current().wine.is_some();
    assert!(!is_in_lab || differing == 0, "{what}: {differing} of {} pixels differ", last + 1);
    (found, apart)
}

/// As [`compare`], of two pictures of one scene. On a device of other quotients 99 % of the pixels are within a quarter of a pixel, and
/// 90 % within 0.01 px.
pub fn compare_scene(extraction: &mut Extraction<'_>, pair: [&Picture; 2], what: &str) {
    let (_, apart) = compare(extraction, pair, what);
    let last = apart.len() - 1;
    assert!(apart[last * 99 / 100] <= 0.25, "{what}: {} px", apart[last * 99 / 100]);
    assert!(apart[last * 9 / 10] <= 0.01, "{what}: {} px", apart[last * 9 / 10]);
}

/// A procedural texture of waves with pseudo-random detail, defined at any position.
pub fn ground(x: f32, y: f32) -> [f32; 3] {
    let waves = [(0.11, 0.07, 0.3), (-0.19, 0.23, 1.7), (0.31, 0.13, 4.1), (0.05, -0.29, 2.2), (0.41, -0.37, 5.0)];
    let grey = 128.0 + waves.iter().map(|(a, b, phase)| 18.0 * (a * x + b * y + phase).sin()).sum::<f32>();
    [grey, 0.8 * grey + 20.0 * (0.05 * x).sin(), 0.6 * grey + 30.0]
}

/// A picture of colours in levels of 255, by position.
pub fn picture(size: (u32, u32), colour: impl Fn(f32, f32) -> [f32; 3]) -> Picture {
    let mut picture = Picture::new(size.0, size.1).expect("a picture");
    for (k, pixel) in (0..).zip(picture.pixels_mut()) {
        let [r, g, b] = colour((k % size.0) as f32, (k / size.0) as f32).map(|v| (v + 0.5).clamp(0.0, 255.0) as u8);
        *pixel = [r, g, b, 255];
    }
    picture
}

/// Two pictures of a camera that moves forward and turns, in a scene with an independently moving object in front.
pub fn moving_scene(random: &mut Random, size: (u32, u32)) -> [Picture; 2] {
    let (grows, turn) = (1.0 + 0.06 * random.signed_unit(), [9.0 * random.signed_unit(), 4.0 * random.signed_unit()]);
    let (object, moved) = (
        [0.3, 0.4].map(|part| part + 0.2 * random.signed_unit()),
        [12.0 * random.signed_unit(), 7.0 * random.signed_unit()],
    );
    let (middle, side) = ([size.0 as f32 / 2.0, size.1 as f32 / 2.0], 0.2 * size.0 as f32);
    [true, false].map(|is_previous| {
        picture(size, |x, y| {
            let corner =
                [0, 1].map(|axis| object[axis] * 2.0 * middle[axis] + if is_previous { moved[axis] } else { 0.0 });
            let [u, v] = [x - corner[0], y - corner[1]];
            if (0.0..side).contains(&u) && (0.0..side).contains(&v) {
                let [r, g, b] = ground(2.0 * u + 300.0, 2.0 * v - 170.0);
                return [255.0 - 0.5 * r, 0.4 * g, b];
            }
            if is_previous {
                return ground(x, y);
            }
            ground(middle[0] + grows * (x - middle[0]) + turn[0], middle[1] + grows * (y - middle[1]) + turn[1])
        })
    })
}
