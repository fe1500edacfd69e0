//! Decoded pictures resized on the device, compared with the processor's.

use cairn::gpu::compute::CommandRing;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{Gpu, Planes, Resize};
use cairn::world::Bilinear;
use cairn::{ErrorKind, Picture};
use half::f16;

use crate::resources::{TestResource, read_texture, upload_buffer, writable_texture};

/// Values without a pattern, some outside [0, 1].
pub fn numbers(len: usize) -> Vec<f32> {
    let mut state = 7_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32 * 1.2 - 0.1
    };
    (0..len).map(|_| next()).collect()
}

/// A picture of a buffer of planes.
pub fn planes(buffer: &TestResource, size: (u32, u32), half: bool, picture: u32) -> Planes<'_> {
    Planes { buffer: buffer.with_state(), picture, size, half }
}

/// Resized pictures, compared byte by byte with the processor's.
#[derive(Debug, Clone, Copy)]
pub struct ResizeComparison {
    /// Compared bytes.
    pub bytes: usize,
    /// Bytes that differ, each by one level of 255.
    pub unequal: usize,
}

/// Resizes decoded pictures in four formats, and checks that bytes differ from the processor's by a level at most, one in a thousand at most.
pub fn compare(gpu: &Gpu) -> ResizeComparison {
    let resize = Resize::new(gpu).expect("the shader");
    let mut frames = CommandRing::new(gpu, gpu.frames(), 2).expect("a ring");
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
        let buffer = upload_buffer(gpu, &contents);
        let row = to.0 as usize;
        let mut resized = |format, size: usize| {
            let target = writable_texture(gpu, to, format, rests[case % rests.len()]);
            let mut frame = frames.begin().expect("a frame");
            if let Err(refused) = resize.record(&mut frame, &planes(&buffer, from, half, 1), &target.with_state()) {
                // Not every device supports UAV stores in every format.
                assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("texture")));
                return None;
            }
            frame.submit(gpu.frames()).expect("a submission").wait().expect("it is done");
            Some(read_texture(gpu, &target, row * size))
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
    ResizeComparison { bytes, unequal: off }
}
