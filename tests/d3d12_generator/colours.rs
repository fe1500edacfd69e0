//! Frames in every format, and of linear colours.

use cairn::PictureF16;
use cairn::gpu::compute::Transfer;

use super::*;

/// Values of ten bits, and an alpha of two.
fn ten_bits_of(levels: [f32; 4]) -> [u32; 4] {
    let [r, g, b, a] = levels.map(|v| v.floor() / 255.0);
    let of = |v: f32, most: f32| (v * most + 0.5) as u32;
    [of(r, 1023.0), of(g, 1023.0), of(b, 1023.0), of(a, 3.0)]
}

#[test]
fn every_format_is_read_and_written() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let scene = Scene::new(&gpu);
    let mut generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let wanted: Picture = scene.processor_frame(0.4, bytes_of_levels);
    let swapped = |bytes: &[u8]| bytes.chunks(4).flat_map(|p| [p[2], p[1], p[0], p[3]]).collect::<Vec<_>>();

    let bgra_of = |levels| {
        let [r, g, b, a] = bytes_of_levels(levels);
        [b, g, r, a]
    };
    for anchors in [
        scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_TYPELESS, bytes_of_levels),
        scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM_SRGB, bytes_of_levels),
        scene.anchors(&gpu, DXGI_FORMAT_B8G8R8A8_UNORM, bgra_of),
        scene.anchors(&gpu, DXGI_FORMAT_B8G8R8A8_UNORM_SRGB, bgra_of),
    ] {
        for (format, is_swapped) in [
            (DXGI_FORMAT_R8G8B8A8_UNORM, false),
            (DXGI_FORMAT_R8G8B8A8_UNORM_SRGB, false),
            (DXGI_FORMAT_R8G8B8A8_TYPELESS, false),
            (DXGI_FORMAT_B8G8R8A8_UNORM, true),
            (DXGI_FORMAT_B8G8R8A8_UNORM_SRGB, true),
        ] {
            let out = target(&gpu, SIZE, format);
            let found = generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &out, 4);
            assert_eq!(if is_swapped { swapped(&found) } else { found }, wanted.rgba(), "{format:?}");
        }
    }

    // Ten-bit values are computed as half floats, which represent them exactly.
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R10G10B10A2_UNORM, |levels| {
        let [r, g, b, a] = ten_bits_of(levels);
        (r | g << 10 | b << 20 | a << 30).to_le_bytes()
    });
    let wanted: PictureF16 = scene.processor_frame(0.4, |levels| {
        let [r, g, b, a] = ten_bits_of(levels).map(|v| v as f32);
        [r / 1023.0, g / 1023.0, b / 1023.0, a / 3.0].map(f16::from_f32)
    });
    for format in [DXGI_FORMAT_R10G10B10A2_UNORM, DXGI_FORMAT_R16G16B16A16_FLOAT, DXGI_FORMAT_R8G8B8A8_UNORM] {
        let out = target(&gpu, SIZE, format);
        let size = if format == DXGI_FORMAT_R16G16B16A16_FLOAT { 8 } else { 4 };
        let found = generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &out, size);
        let far = found.chunks(size).zip(wanted.pixels()).filter(|(found, wanted)| {
            let part = |c: usize| match format {
                DXGI_FORMAT_R10G10B10A2_UNORM => {
                    let word = u32::from_le_bytes([found[0], found[1], found[2], found[3]]);
                    (word >> (10 * c) & 1023) as f32 / 1023.0
                }
                DXGI_FORMAT_R8G8B8A8_UNORM => f32::from(found[c]) / 255.0,
                _ => f16::from_le_bytes([found[2 * c], found[2 * c + 1]]).to_f32(),
            };
            (0..3).any(|c| (part(c) - wanted[c].to_f32().clamp(0.0, 1.0)).abs() > 1.0 / 255.0)
        });
        assert!(1000 * far.count() <= wanted.pixels().len(), "{format:?}");
    }
}

/// The encoding curve of sRGB, mirrored below 0 and continued above 1.
fn encode_srgb(light: f64) -> f64 {
    let a = light.abs();
    (if a <= 0.0031308 { 12.92 * a } else { 1.055 * a.powf(1.0 / 2.4) - 0.055 }).copysign(light)
}

/// The inverse of [`encode_srgb`].
fn decode_srgb(shown: f64) -> f64 {
    let a = shown.abs();
    (if a <= 0.04045 { a / 12.92 } else { ((a + 0.055) / 1.055).powf(2.4) }).copysign(shown)
}

#[test]
fn linear_frames_equal_the_frames_of_the_displayed_values() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let mut scene = Scene::new(&gpu);
    // Up to five times as bright as white, and colours outside sRGB.
    let wide = |levels: [f32; 4]| [2.2 * levels[0] - 30.0, 1.6 * levels[1], levels[2] - 20.0, 255.0];
    scene.levels.iter_mut().flatten().for_each(|levels| *levels = wide(*levels));
    let in_light = |levels: [f32; 4]| {
        let [r, g, b, a] = levels.map(|level| f64::from(level) / 255.0);
        [decode_srgb(r), decode_srgb(g), decode_srgb(b), a].map(f16::from_f64)
    };
    let anchors = scene.anchors(&gpu, DXGI_FORMAT_R16G16B16A16_FLOAT, |levels| {
        let halves = in_light(levels).map(f16::to_le_bytes);
        <[u8; 8]>::try_from(halves.as_flattened()).expect("eight bytes")
    });
    let generator = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut generator = generator.with_transfer(Transfer::Linear);
    let shown = |held: [f16; 4]| {
        let [r, g, b, a] = held.map(f16::to_f64);
        [encode_srgb(r), encode_srgb(g), encode_srgb(b), a]
    };
    let wanted: PictureF16 = scene.processor_frame(0.4, |levels| shown(in_light(levels)).map(f16::from_f64));
    let halves = target(&gpu, SIZE, DXGI_FORMAT_R16G16B16A16_FLOAT);
    let found = generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &halves, 8);
    let (mut far, mut bright) = (0, 0);
    for (found, wanted) in found.chunks(8).zip(wanted.pixels()) {
        let held: [f16; 4] = std::array::from_fn(|c| f16::from_le_bytes([found[2 * c], found[2 * c + 1]]));
        let apart = |(found, wanted): (f64, &f16)| (found - wanted.to_f64()).abs() > 1.0 / 255.0;
        far += usize::from(shown(held).into_iter().zip(wanted).any(apart));
        bright += usize::from(held[0] > f16::from_f32(1.5) || held[0] < f16::ZERO);
    }
    assert!(bright > 100 && 1000 * far <= wanted.pixels().len(), "{far} of {}, {bright} bright", wanted.pixels().len());

    // An 8-bit target gets the sRGB values, clamped at white.
    let bytes = target(&gpu, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM);
    let found = generated(&gpu, &mut generator, &scene.pair(&anchors), 0.4, &bytes, 4);
    let far = found.chunks(4).zip(wanted.pixels()).filter(|(found, wanted)| {
        (0..4).any(|c| (f32::from(found[c]) - 255.0 * wanted[c].to_f32().clamp(0.0, 1.0)).abs() > 1.5)
    });
    assert!(1000 * far.count() <= wanted.pixels().len());

    // A window in scRGB shows anchors in sRGB unchanged.
    let eight =
        scene.anchors(&gpu, DXGI_FORMAT_R8G8B8A8_UNORM, |levels| bytes_of_levels(levels.map(|v| v.clamp(0.0, 255.0))));
    let single = ShaderGenerator::new(&gpu, SIZE).expect("a generator");
    let mut single = single.with_target_transfer(Transfer::Linear);
    let found = generated(&gpu, &mut single, &scene.pair(&eight), 0.4, &halves, 8);
    let shown = generated(&gpu, &mut single, &scene.pair(&eight), 0.4, &bytes, 4);
    for (light, shown) in found.chunks(2).zip(&shown).enumerate().filter(|(i, _)| i % 4 < 3).map(|(_, both)| both) {
        let (found, wanted) = (f16::from_le_bytes([light[0], light[1]]), decode_srgb(f64::from(*shown) / 255.0));
        assert!((found.to_f64() - wanted).abs() <= 6e-4 * wanted, "{found} for {shown}");
    }

    // A static picture is unchanged, to the bit.
    let still = TexturePair { previous: anchors[1].with_state(), ..scene.pair(&anchors) };
    let no_motion = Guidance::new(SIZE.0, SIZE.1, cairn::guidance::paper::PROJECTION).expect("a guidance");
    let no_motion = DeviceGuidance::new(&gpu, &no_motion);
    let still = TexturePair { guidance: no_motion.textures(), ..still };
    let found = generated(&gpu, &mut generator, &still, 0.4, &halves, 8);
    assert!(found == read_texture(&gpu, &anchors[1], SIZE.0 as usize * 8));

    let mut frames = CommandRing::new(&gpu, gpu.frames(), DESCRIPTORS).expect("a ring");
    let mut frame = frames.begin().expect("a frame");
    let refused = generator.prepare(&mut frame, &scene.pair(&eight)).expect_err("bytes cannot hold linear values");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("current")));
}
