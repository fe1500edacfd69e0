//! Upscaling in an engine's textures.

use cairn::ffx::bindings::ReactiveFlags;
use cairn::ffx::{ReactiveMask, TextureUpscaler, UpscaleTextures};
use cairn::gpu::FencePoint;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_R8G8B8A8_UNORM;

use test_support::d3d12::list_calls::count_list_calls;

use super::*;

fn in_textures(gpu: &Gpu, library: &Library) -> cairn::Result<TextureUpscaler> {
    TextureUpscaler::new(gpu, library.api(Effect::Upscaling)?, Choice::Any, head(UpscaleCreateFlags::empty()))
}

impl Scene {
    fn pictures(&self) -> UpscaleTextures<'_> {
        UpscaleTextures {
            color: self.rendered.color.with_state(),
            depth: self.rendered.depth.with_state(),
            motion: self.rendered.motion.with_state(),
            exposure: None,
            reactive: None,
            transparency: None,
            output: self.shown.output.with_state(),
        }
    }

    /// Upscales two frames as [`pair`](Self::pair) does, through textures.
    fn pair_of(&self, upscaler: &mut TextureUpscaler, pictures: &UpscaleTextures<'_>) -> cairn::Result<()> {
        for (number, by) in [(0, 0.0), (1, 8.0)] {
            self.draw(by, Coordinates::default());
            let params = UpscaleParams { reset: number == 0, ..UpscaleParams::of(RENDERED, SHOWN) };
            upscaler.upscale(pictures, &params)?.wait()?;
        }
        Ok(())
    }
}

/// An output texture of display size.
fn target(gpu: &Gpu, flags: D3D12_RESOURCE_FLAGS, state: D3D12_RESOURCE_STATES) -> TestResource {
    let wanted = resources::texture_desc((SHOWN.width, SHOWN.height), DXGI_FORMAT_R8G8B8A8_UNORM, flags);
    TestResource { resource: resources::create_resource(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state }
}

#[test]
fn textures_in_any_state_are_upscaled_as_with_raw_calls() {
    let (double, library) = set_up_double(&["sdk 2.1", NEWEST]);
    let scene = Scene::new();
    let wanted = {
        let mut plain = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
        scene.pair(&mut plain, &FrameInput::plain())
    };
    let mut upscaler = in_textures(&scene.gpu, &library).expect("an upscaler");
    let (written, none) = (D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, D3D12_RESOURCE_FLAG_NONE);
    for (flags, state) in [(written, D3D12_RESOURCE_STATE_RENDER_TARGET), (none, D3D12_RESOURCE_STATE_PRESENT)] {
        let flags = flags | D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET;
        let target = target(&scene.gpu, flags, state);
        let pictures = UpscaleTextures { output: target.with_state(), ..scene.pictures() };
        scene.pair_of(&mut upscaler, &pictures).expect("upscaled");
        assert!(scene.shown.pixels(&target) == wanted, "{flags:?}");
    }
    // An engine's list stays empty after parameters that are refused.
    let invalid = UpscaleParams { frame_time: 0.0, ..UpscaleParams::of(RENDERED, SHOWN) };
    run_list(&scene.gpu, |list| {
        let until = scene.gpu.frames().signal().expect("a fence point");
        let mut refused = None;
        let calls =
            count_list_calls(list, || refused = upscaler.record(list, &until, &scene.pictures(), &invalid).err());
        assert_eq!((refused.expect("a time").offending_field(), calls), (Some("frame_time"), 0));
    });
    // Into an engine's list, with the previous frames as history.
    let fence: ID3D12Fence = {
        // SAFETY: values only.
        unsafe { scene.gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence")
    };
    for (number, by) in [(0, 0.0), (1, 8.0)] {
        scene.draw(by, Coordinates::default());
        let until = FencePoint::of_engine(&scene.gpu, &fence, number + 1).expect("its own");
        let params = UpscaleParams { reset: number == 0, ..UpscaleParams::of(RENDERED, SHOWN) };
        run_list(&scene.gpu, |list| {
            let mut recorded = Ok(());
            let record = || recorded = upscaler.record(list, &until, &scene.pictures(), &params);
            assert!(count_list_calls(list, record) > 0, "a frame that is not refused is recorded");
            recorded.expect("recorded");
        });
        // SAFETY: a live fence, and the list has run.
        unsafe { fence.Signal(number + 1) }.expect("signalled");
    }
    assert!(scene.shown.generated() == wanted, "in a list of an engine's");

    // Invalid motion becomes zero, or is clamped to the picture's size.
    scene.rendered.fill(&scene.rendered.motion, |x, _| match x % 3 {
        0 => halves(f32::NAN, f32::INFINITY),
        1 => halves(-60000.0, 0.0),
        _ => halves(0.0, 0.0),
    });
    scene.pair_of(&mut upscaler, &scene.pictures()).expect("upscaled");
    let wild = scene.shown.generated();
    scene.rendered.fill(&scene.rendered.motion, |x, _| if x % 3 == 1 { halves(-64.0, 0.0) } else { halves(0.0, 0.0) });
    scene.pair_of(&mut upscaler, &scene.pictures()).expect("upscaled");
    assert!(scene.shown.generated() == wild);
    let memory = upscaler.memory().expect("an answer");
    assert!(memory.own > 0 && memory.provider.is_some());
    drop(upscaler);
    assert!(scene.gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn four_frames_at_once_wait_for_one_another() {
    let (double, library) = set_up_double(&["sdk 2.1", NEWEST]);
    let scene = Scene::new();
    let mut upscaler = in_textures(&scene.gpu, &library).expect("an upscaler");
    scene.draw(0.0, Coordinates::default());
    // The double counts frames in flight; AMD's libraries support four.
    let params = UpscaleParams::of(RENDERED, SHOWN);
    let all: Vec<_> = (0..8).map(|_| upscaler.upscale(&scene.pictures(), &params).expect("submitted")).collect();
    drop(upscaler);
    assert!(all.iter().all(FencePoint::reached), "a frame that is under way is waited for");
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn a_reactive_mask_is_the_scaled_colour_difference() {
    let (double, library) = set_up_double(&["sdk 2.1", NEWEST]);
    let scene = Scene::new();
    let mut upscaler = in_textures(&scene.gpu, &library).expect("an upscaler");
    let opaque = Textures::new(&scene.gpu, RENDERED);
    let shade = |x: u32, y: u32| [(x * 4) as u8, (y * 5) as u8, 40, 255];
    let glass = |x: u32, y: u32| if x < 32 { shade(x, y) } else { [shade(x, y)[0] / 2, shade(x, y)[1], 200, 255] };
    opaque.fill(&opaque.color, shade);
    scene.rendered.fill(&scene.rendered.color, glass);
    let (threshold, max) = (ReactiveFlags::THRESHOLD, ReactiveFlags::COMPONENTS_MAX);
    let (mapped, back) = (ReactiveFlags::TONEMAP, ReactiveFlags::INVERSE_TONEMAP);
    for flags in [ReactiveFlags::empty(), max, mapped, back, threshold | max] {
        let mask = ReactiveMask { scale: 0.75, threshold: 0.3, value: 0.8, flags, ..ReactiveMask::of(RENDERED) };
        let (from, color) = (opaque.color.with_state(), scene.rendered.color.with_state());
        let fence_point = upscaler.find_reactive(&from, &color, &scene.reactive.with_state(), &mask);
        fence_point.expect("found").wait().expect("it is there");
        let colour = |pixel: [u8; 4]| {
            let unit = [0, 1, 2].map(|c| f32::from(pixel[c]) / 255.0);
            let brightest = unit.iter().copied().fold(0.0, f32::max);
            let divisor = match () {
                () if flags.contains(mapped) => brightest + 1.0,
                () if flags.contains(back) => (1.0 - brightest).max(1.0 / 32.0),
                () => 1.0,
            };
            unit.map(|c| c / divisor)
        };
        for (found, place) in scene.rendered.pixels(&scene.reactive).into_iter().zip(0..) {
            let (x, y) = (place % RENDERED.width, place / RENDERED.width);
            let (a, b) = (colour(shade(x, y)), colour(glass(x, y)));
            let apart = [0, 1, 2].map(|c| (a[c] - b[c]).abs());
            let length = apart.iter().map(|c| c * c).sum::<f32>().sqrt();
            let all = 0.75 * if flags.contains(max) { apart.into_iter().fold(0.0, f32::max) } else { length };
            let wanted = match () {
                () if !flags.contains(threshold) => all,
                () if all < 0.3 => 0.0,
                () => 0.8,
            };
            let found = f32::from_le_bytes(found);
            let near_threshold = flags.contains(threshold) && (all - 0.3).abs() < 1e-4;
            assert!((found - wanted).abs() < 1e-3 || near_threshold, "{flags:?} at {x}, {y}: {found}, not {wanted}");
        }
    }
    // The effect of a reactive mask on the upscaled frame.
    scene.pair_of(&mut upscaler, &scene.pictures()).expect("upscaled");
    let without = scene.shown.generated();
    let masked = UpscaleTextures { reactive: Some(scene.reactive.with_state()), ..scene.pictures() };
    scene.rendered.fill(&scene.rendered.motion, |_, _| halves(-3.0, 0.0));
    scene.pair_of(&mut upscaler, &scene.pictures()).expect("upscaled");
    let apart = scene.shown.generated();
    scene.pair_of(&mut upscaler, &masked).expect("upscaled");
    assert!(without != apart && scene.shown.generated() != apart, "the mask is used");
    for (field, mask) in [
        ("scale", ReactiveMask { scale: f32::NAN, ..ReactiveMask::of(RENDERED) }),
        ("threshold", ReactiveMask { threshold: -0.1, ..ReactiveMask::of(RENDERED) }),
        ("value", ReactiveMask { value: 1.1, ..ReactiveMask::of(RENDERED) }),
        ("flags", ReactiveMask { flags: ReactiveFlags::from_bits_retain(16), ..ReactiveMask::of(RENDERED) }),
        ("opaque", ReactiveMask::of(SHOWN)),
    ] {
        let (from, color) = (opaque.color.with_state(), scene.rendered.color.with_state());
        let refused = upscaler.find_reactive(&from, &color, &scene.reactive.with_state(), &mask).expect_err(field);
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
    }
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn a_provider_is_given_what_it_requires() {
    let scene = Scene::new();
    scene.draw(0.0, Coordinates::default());
    let (double, library) = set_up_double(&["sdk 2.1", NEWEST, "requires 0x17"]);
    let mut upscaler = in_textures(&scene.gpu, &library).expect("an upscaler");
    assert!(upscaler.required().contains(UpscaleResources::REACTIVE));
    let params = UpscaleParams::of(RENDERED, SHOWN);
    let refused = upscaler.upscale(&scene.pictures(), &params).expect_err("there is no mask");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("reactive")));
    let masked = UpscaleTextures { reactive: Some(scene.reactive.with_state()), ..scene.pictures() };
    upscaler.upscale(&masked, &params).expect("upscaled").wait().expect("it is there");
    assert_eq!(double.violations(), [""; 0]);
    // A provider that requires an unknown kind of input is rejected.
    let (_, library) = set_up_double(&["sdk 2.1", NEWEST, "requires 0x47"]);
    let refused = in_textures(&scene.gpu, &library).expect_err("a kind to come");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("provider")));
    // Textures of another device, of another size, or with an unsupported motion format.
    let (_, library) = set_up_double(&["sdk 2.0", ANALYTIC]);
    let mut upscaler = in_textures(&scene.gpu, &library).expect("an upscaler");
    let pictures = scene.pictures();
    for (field, invalid) in [
        ("color", UpscaleTextures { color: scene.shown.color.with_state(), ..pictures }),
        ("depth", UpscaleTextures { depth: scene.one.depth.with_state(), ..pictures }),
        ("motion", UpscaleTextures { motion: scene.rendered.color.with_state(), ..pictures }),
        ("exposure", UpscaleTextures { exposure: Some(scene.reactive.with_state()), ..pictures }),
        ("output", UpscaleTextures { output: scene.rendered.output.with_state(), ..pictures }),
    ] {
        let refused = upscaler.upscale(&invalid, &params).expect_err(field);
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
    }
    upscaler.upscale(&pictures, &params).expect("upscaled").wait().expect("it is there");
}
