//! The paper's guidance extracted on the device, compared with the processor's.

use cairn::gpu::Gpu;
use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::guidance::paper::{self, GpuExtractor, LatentBuffer};
use cairn::guidance::{Guidance, LatentView};
use half::f16;

use crate::resize::numbers;
use crate::resources::{read_texture, upload_buffer, writable_texture};

/// The number of half float steps between two values; those near 0 count as neighbours of the smallest normal half float.
fn half_steps(a: f32, b: f32) -> f32 {
    let size = a.abs().max(b.abs()).max(f16::MIN_POSITIVE.to_f32());
    (a - b).abs() / (size.log2().floor() - 10.0).exp2()
}

/// Extracts motion and depth from pairs of latents, and checks that each value is within two half-float steps of the processor's. Returns the
/// number of values.
pub fn compare(gpu: &Gpu) -> usize {
    let mut values = 0;
    let mut frames = CommandRing::new(gpu, gpu.frames(), 6).expect("a ring");
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
            let both = upload_buffer(gpu, &[bytes(&z1, half), bytes(&z0, half)].concat());
            let latent = |first: usize| LatentBuffer { buffer: both.with_state(), first: first as u32 };
            let motion =
                writable_texture(gpu, render, DXGI_FORMAT_R16G16_FLOAT, D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE);
            let depth = writable_texture(gpu, render, DXGI_FORMAT_R32_FLOAT, D3D12_RESOURCE_STATE_COMMON);
            let extractor = GpuExtractor::new(gpu, shape, half).expect("the shaders");
            let mut frame = frames.begin().expect("a frame");
            extractor
                .record(&mut frame, &latent(len), &latent(0), &motion.with_state(), &depth.with_state())
                .expect("recorded");
            frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");

            let row = render.0 as usize * 4;
            let found = read_texture(gpu, &motion, row);
            let wanted = expected.motion().vectors().iter().flatten();
            for (i, (found, wanted)) in found.chunks_exact(2).zip(wanted).enumerate() {
                let (found, wanted) = (f16::from_le_bytes([found[0], found[1]]).to_f32(), wanted.to_f32());
                values += 1;
                assert!(
                    half_steps(found, wanted) <= 2.0,
                    "motion {found} for {wanted} at {i} of {shape:?}, kind {kind}"
                );
            }
            let found = read_texture(gpu, &depth, row);
            for (i, (found, wanted)) in found.chunks_exact(4).zip(expected.depth().depth()).enumerate() {
                let found = f32::from_le_bytes([found[0], found[1], found[2], found[3]]);
                values += 1;
                assert!(
                    half_steps(found, *wanted) <= 2.0,
                    "depth {found} for {wanted} at {i} of {shape:?}, kind {kind}"
                );
            }
        }
    }
    values
}
