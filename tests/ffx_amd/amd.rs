//! AMD's own libraries, in the folder that `CAIRN_FFX_DIR` names. On Windows, or in the lab.

use std::path::PathBuf;

use cairn::ErrorKind;
use cairn::ffx::bindings::{
    Coordinates, CreateFlags, CreateFrameGeneration, Dimensions, Rect, SurfaceFormat, TransferFunction,
};
use cairn::ffx::{
    Choice, Context, Effect, Family, FileVersion, FrameParams, GenerationCheck, GenerationTextures, Generator, Library,
    LibraryKind, LoadOptions, TextureGenerator, TextureOptions, memory_needed, versions,
};
use cairn::gpu::Gpu;
use cairn::gpu::windows::core::Interface;

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT_R8G8B8A8_UNORM, DXGI_FORMAT_R16G16_FLOAT};
use half::f16;
use libtest_mimic::Trial;
use test_support::d3d12::engine::Engine;
use test_support::d3d12::resources::{self, TestResource, run_list, writable_texture};
use test_support::ffx::frame_textures::Textures;
use test_support::ffx::world_in_rect;
use test_support::trials;

fn options(signed: bool) -> LoadOptions {
    let directory = std::env::var_os("CAIRN_FFX_DIR").map(PathBuf::from);
    LoadOptions { directory: Some(directory.expect("CAIRN_FFX_DIR names a folder")), signed }
}

fn head() -> CreateFrameGeneration {
    let size = Dimensions { width: 640, height: 360 };
    CreateFrameGeneration {
        flags: CreateFlags::DEBUG_CHECKING,
        display_size: size,
        max_render_size: size,
        back_buffer_format: SurfaceFormat::R8G8B8A8_UNORM,
        ..Default::default()
    }
}

/// Options for the analytic provider without the self-test.
fn untested(size: Dimensions) -> TextureOptions {
    TextureOptions {
        choice: Choice::Prefer(Family::Analytic),
        self_test: false,
        ..TextureOptions::new(size, size, SurfaceFormat::R8G8B8A8_UNORM)
    }
}

fn they_are_found_and_loaded_with_their_versions() {
    let library = Library::load(&options(false)).expect("loaded");
    for file in library.files() {
        println!("{:?} {} {:?}", file.kind, file.path.display(), file.version);
        assert!(file.fault.is_none(), "{:?}", file.fault);
        assert!(file.version.is_some_and(|version| version >= FileVersion([1, 0, 0, 0])), "{file:?}");
    }
    let split = library.files().iter().any(|file| file.kind == LibraryKind::Loader);
    let door = if split { LibraryKind::Loader } else { LibraryKind::Whole };
    assert!([Some(door), Some(LibraryKind::FrameGeneration)].contains(&library.serves(Effect::FrameGeneration)));
}

fn their_signature_is_amd_s() {
    match Library::load(&options(true)) {
        Ok(library) => {
            for file in library.files() {
                println!("{:?} is signed by {:?}", file.kind, file.signer);
                assert!(file.signer.as_ref().is_some_and(|signer| signer.starts_with("Advanced Micro Devices")));
            }
        }
        // A machine without the root of AMD's certificate cannot verify it, but can tell it from a missing signature.
        Err(refused) => {
            println!("{refused}");
            assert!(refused.cause().contains("Advanced Micro Devices"), "{refused}");
            assert!(refused.cause().contains("root"), "{refused}");
        }
    }
}

fn one_altered_byte_is_detected() {
    let library = Library::load(&options(false)).expect("loaded");
    let own =
        library.files().iter().find(|file| [LibraryKind::FrameGeneration, LibraryKind::Whole].contains(&file.kind));
    let own = own.expect("it was found");
    let place = std::env::temp_dir().join(format!("cairn-ffx-altered-{}", std::process::id()));
    std::fs::create_dir_all(&place).expect("a folder");
    let mut bytes = std::fs::read(&own.path).expect("the file");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(place.join(own.kind.file_name()), bytes).expect("the altered file");
    let refused = Library::load(&LoadOptions { directory: Some(place), signed: true }).expect_err("it was altered");
    println!("{refused}");
    assert!(refused.cause().contains("it was altered after it was signed"), "{refused}");
}

fn a_provider_is_chosen_and_created_and_reports_its_version() {
    let library = Library::load(&options(false)).expect("loaded");
    let gpu = Gpu::on_adapter(None).expect("a device");
    let (api, device) = (library.api(Effect::FrameGeneration).expect("there"), gpu.device().as_raw());
    // SAFETY: a live device.
    let offered = unsafe { versions(api, Effect::FrameGeneration, device) }.expect("some");
    println!("offered: {offered:?}");
    for (choice, family) in [
        (Choice::Any, None),
        (Choice::Prefer(Family::Ml), None),
        (Choice::Require(Family::Analytic), Some(Family::Analytic)),
        (Choice::Require(Family::Ml), Some(Family::Ml)),
    ] {
        // SAFETY: a live device, which outlives the context.
        let made = unsafe { Context::create(api, device, choice, head(), |chain| chain) };
        if family.is_some_and(|family| offered.iter().all(|version| version.family() != Some(family))) {
            let refused = made.expect_err("there is none");
            println!("{choice:?}: {refused}");
            assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("provider")));
            continue;
        }
        let context = made.expect("a context");
        println!("{choice:?}: {:?}", context.provider());
        assert!(context.provider().verified);
        if let Some(family) = family {
            assert_eq!(context.provider().version.family(), Some(family));
        }
    }
    assert!(gpu.removed().is_none());
}

/// A pattern moved to the right by this many pixels.
fn moved(by: f32) -> impl Fn(u32, u32) -> [u8; 4] {
    move |x, y| {
        let (x, y) = (x as f32 - by, y as f32);
        let wave = |phase: f32| (128.0 + 100.0 * phase.sin()) as u8;
        [wave(x * 0.05), wave(y * 0.07 + x * 0.02), wave(x * 0.03 - y * 0.04), 255]
    }
}

/// PSNR of the inner part of a picture.
fn psnr(found: &[[u8; 4]], truth: impl Fn(u32, u32) -> [u8; 4], size: Dimensions) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for y in 20..size.height - 20 {
        for x in 60..size.width - 60 {
            for (a, b) in found[(y * size.width + x) as usize].iter().zip(truth(x, y)).take(3) {
                sum += (f64::from(*a) - f64::from(b)).powi(2);
                count += 1.0;
            }
        }
    }
    10.0 * (255.0 * 255.0 / (sum / count + 1e-9)).log10()
}

fn a_picture_that_pans_is_halfway_between_and_a_reset_gives_the_frame_itself() {
    const STEP: f32 = 16.0;
    let library = Library::load(&options(false)).expect("loaded");
    let gpu = Gpu::on_adapter(None).expect("a device");
    let (api, device) = (library.api(Effect::FrameGeneration).expect("there"), gpu.device().as_raw());
    // SAFETY: a live device, which outlives the generator.
    let mut generator =
        unsafe { Generator::create(api, device, Choice::Prefer(Family::Analytic), head(), None) }.expect("a generator");
    let size = head().display_size;
    let textures = Textures::new(&gpu, size);
    textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
    // (-16, 0) as half floats: from the current to the previous position.
    textures.fill(&textures.motion, |_, _| [0x00, 0xcc, 0, 0]);
    for (number, reset) in (1_u8..).zip([false, false, false, true]) {
        let now = STEP * f32::from(number);
        textures.fill(&textures.color, moved(now));
        run_list(&gpu, |list| {
            // SAFETY: an open list of the generator's device, and textures that live until it has run.
            unsafe { generator.record(&textures.frame(list, reset)) }.expect("recorded");
        });
        let found = textures.generated();
        let [before, half, after] = [now - STEP, now - STEP / 2.0, now].map(|at| psnr(&found, moved(at), size));
        println!(
            "frame {number}: {before:.1} dB to the frame before, {half:.1} dB to the truth, {after:.1} dB to the frame"
        );
        // No generation without history, at the start and after a cut.
        if number == 1 || reset {
            assert!(after > 45.0, "frame {number}: {after} dB to the frame");
        } else {
            assert!(half > 45.0 && before < 30.0 && after < 30.0, "frame {number}: {before} {half} {after} dB");
        }
    }
    assert!(gpu.removed().is_none());
}

/// Motion that contains the change of jitter (previous minus current), which 3.1.5 ignores; and an unannounced cut, for which it
/// returns this frame and the next three unchanged, as the double does.
fn declared_jitter_in_motion_does_no_harm_and_a_detected_cut_gives_the_frame_itself() {
    const STEP: f32 = 16.0;
    let library = Library::load(&options(false)).expect("loaded");
    let api = library.api(Effect::FrameGeneration).expect("there");
    let gpu = Gpu::on_adapter(None).expect("a device");
    let size = head().display_size;
    let textures = Textures::new(&gpu, size);
    textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
    // 4 pixels to the left: -16, plus 12 for the previous jitter (6) minus the current one (-6).
    let jitters = [6.0_f32, -6.0];
    let half = |v: f32| half::f16::from_f32(v).to_le_bytes();
    let [of_flag, without] = [CreateFlags::MOTION_JITTER, CreateFlags::empty()].map(|flags| {
        let mut options = untested(size);
        options.head.flags = flags;
        let mut generator = TextureGenerator::new(&gpu, api, &options).expect("a generator");
        for number in 0_u8..4 {
            let [before, now] = [number + 1, number].map(|turn| jitters[usize::from(turn % 2)]);
            let held = half(-STEP + before - now);
            textures.fill(&textures.motion, |_, _| [held[0], held[1], 0, 0]);
            textures.fill(&textures.color, moved(STEP * f32::from(number)));
            let jitter = Coordinates { x: now, y: 0.0 };
            let params = FrameParams { reset: number == 0, jitter, ..FrameParams::of(size) };
            generator.generate(&textures.pictures(), &params).expect("generated").wait().expect("it has run");
        }
        psnr(&textures.generated(), moved(STEP * 2.5), size)
    });
    println!("motion that holds jitter: {of_flag:.1} dB to the truth where that is told, {without:.1} dB where not");
    assert!(of_flag >= without, "{of_flag} {without}");

    let mut generator = TextureGenerator::new(&gpu, api, &untested(size)).expect("a generator");
    let steps = half(-STEP);
    textures.fill(&textures.motion, |_, _| [steps[0], steps[1], 0, 0]);
    // Another pattern, and dark.
    let other = |by: f32| move |x: u32, y: u32| moved(by)(y, x).map(|v| if v == 255 { 255 } else { v / 6 });
    for number in 0_u8..16 {
        let now = STEP * f32::from(number);
        let is_other = number >= 8;
        match is_other {
            true => textures.fill(&textures.color, other(0.0)),
            false => textures.fill(&textures.color, moved(now)),
        }
        let params = FrameParams { reset: number == 0, ..FrameParams::of(size) };
        generator.generate(&textures.pictures(), &params).expect("generated").wait().expect("it has run");
        let found = textures.generated();
        let own = if is_other { psnr(&found, other(0.0), size) } else { psnr(&found, moved(now), size) };
        println!("frame {number}: {own:.1} dB to the frame itself");
        if (8..12).contains(&number) {
            assert!(own > 45.0, "frame {number}: {own} dB");
        } else if (1..8).contains(&number) {
            assert!(own < 30.0, "frame {number}: {own} dB");
        }
    }
    assert!(gpu.removed().is_none());
}

/// `TextureGenerator` with the panning picture, after its self-test: on a queue of either kind, with invalid motion vectors, and
/// into a target that shaders cannot write.
fn it_passes_the_self_test_and_generates_on_both_kinds_of_queue() {
    const STEP: f32 = 16.0;
    let library = Library::load(&options(false)).expect("loaded");
    let api = library.api(Effect::FrameGeneration).expect("there");
    let engine = Engine::create();
    let size = head().display_size;
    for queue in [&engine.direct, &engine.compute] {
        let gpu = Gpu::of_engine(&engine.device, queue, None).expect("a device");
        let kind = gpu.frames().kind();
        let options = TextureOptions {
            choice: Choice::Prefer(Family::Analytic),
            detect_pass_through: true,
            ..TextureOptions::new(size, size, SurfaceFormat::R8G8B8A8_UNORM)
        };
        let mut generator = TextureGenerator::new(&gpu, api, &options).expect("it stands the test");
        assert!(generator.refused().is_empty());
        let textures = Textures::new(&gpu, size);
        textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
        // A column of NaN among vectors of (-16, 0), as half floats.
        textures.fill(&textures.motion, |x, _| if x == 3 { [0xff, 0x7f, 0xff, 0x7f] } else { [0x00, 0xcc, 0, 0] });
        let wanted = resources::texture_desc(
            (size.width, size.height),
            DXGI_FORMAT_R8G8B8A8_UNORM,
            D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET,
        );
        let state = D3D12_RESOURCE_STATE_PRESENT;
        let target =
            TestResource { resource: resources::create_resource(&gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state };
        for number in 1_u8..=3 {
            let now = STEP * f32::from(number);
            textures.fill(&textures.color, moved(now));
            let pictures = GenerationTextures { output: target.with_state(), ..textures.pictures() };
            generator.generate(&pictures, &FrameParams::of(size)).expect("generated").wait().expect("it has run");
            let found = textures.pixels(&target);
            let [before, half, after] = [now - STEP, now - STEP / 2.0, now].map(|at| psnr(&found, moved(at), size));
            println!(
                "queue of type {}, frame {number}: {before:.1} dB to the frame before, {half:.1} dB to the truth, {after:.1} dB to the frame",
                kind.0
            );
            if number > 1 {
                assert!(half > 45.0 && before < 30.0 && after < 30.0, "frame {number}: {before} {half} {after} dB");
                assert_eq!(generator.last_check(), Some(GenerationCheck::Generated));
            }
        }
        drop(generator);
        assert!(gpu.removed().is_none());
    }
}

/// Inputs of frames beside a panning world.
#[derive(Clone, Copy, Default)]
struct Extras {
    /// An interface that is drawn in front of the world.
    sign: Option<[u8; 4]>,
    /// Whether the world without it is passed too.
    hudless: bool,
    /// Lens distortion of every pixel, as a fraction of the picture.
    lens: Option<[f32; 2]>,
}

/// Generates frames of a world that pans by 16 pixels with AMD's libraries, as `params` says; returns the last generated frame.
fn panned(
    gpu: &Gpu,
    generator: &mut TextureGenerator,
    params: &FrameParams,
    Extras { sign, hudless, lens }: Extras,
) -> Vec<[u8; 4]> {
    const STEP: f32 = 16.0;
    let size = head().display_size;
    let textures = Textures::new(gpu, size);
    let world = Textures::new(gpu, size).color;
    textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
    textures.fill(&textures.motion, |_, _| [0x00, 0xcc, 0, 0]);
    let field = lens.map(|shift| {
        let field =
            writable_texture(gpu, (size.width, size.height), DXGI_FORMAT_R16G16_FLOAT, D3D12_RESOURCE_STATE_COMMON);
        let [x, y] = shift.map(|part| f16::from_f32(part).to_le_bytes());
        textures.fill(&field, |_, _| [x[0], x[1], y[0], y[1]]);
        field
    });
    for number in 1_u8..=3 {
        let now = moved(STEP * f32::from(number));
        textures.fill(&world, &now);
        textures.fill(&textures.color, |x, y| sign.filter(|_| in_sign(x, y)).unwrap_or_else(|| now(x, y)));
        let pictures = GenerationTextures {
            hudless: hudless.then(|| world.with_state()),
            distortion: field.as_ref().map(TestResource::with_state),
            ..textures.pictures()
        };
        let params = FrameParams { reset: number == 1, ..*params };
        generator.generate(&pictures, &params).expect("generated").wait().expect("it has run");
    }
    textures.generated()
}

/// Whether a pixel is in the interface.
fn in_sign(x: u32, y: u32) -> bool {
    (280..360).contains(&x) && (150..210).contains(&y)
}

/// Maximum difference of a channel over the pixels in `part`.
fn off(found: &[[u8; 4]], part: impl Fn(u32, u32) -> bool, expected: impl Fn(u32, u32) -> [u8; 4]) -> u8 {
    let Dimensions { width, height } = head().display_size;
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|(x, y)| part(*x, *y));
    let differences = places.flat_map(|(x, y)| {
        let (a, b) = (found[(y * width + x) as usize], expected(x, y));
        a.into_iter().zip(b).take(3).map(|(a, b)| a.abs_diff(b))
    });
    differences.max().unwrap_or(0)
}

fn depth_and_motion_cover_the_part_that_is_generated() {
    let library = Library::load(&options(false)).expect("loaded");
    let api = library.api(Effect::FrameGeneration).expect("there");
    let gpu = Gpu::on_adapter(None).expect("a device");
    let size = head().display_size;
    let mut generator = TextureGenerator::new(&gpu, api, &untested(size)).expect("a generator");
    world_in_rect::check(&gpu, &mut generator, size);
}

fn interface_letterbox_lens_and_transfer_function_change_amd_s_frame() {
    let library = Library::load(&options(false)).expect("loaded");
    let api = library.api(Effect::FrameGeneration).expect("there");
    let gpu = Gpu::on_adapter(None).expect("a device");
    let size = head().display_size;
    let made = |flags| {
        let mut options = untested(size);
        options.head.flags = flags;
        // SAFETY: a live device.
        let needed = unsafe { memory_needed(api, gpu.device().as_raw(), &options.head, None) }.expect("an answer");
        let mut generator = TextureGenerator::new(&gpu, api, &options).expect("a generator");
        let memory = generator.memory().expect("an answer");
        println!("{} x {}: {memory:?}, {needed:?} before", size.width, size.height);
        generator
    };
    let half = moved(40.0);
    let inner = |x: u32, y: u32| (60..size.width - 60).contains(&x) && (60..size.height - 60).contains(&y);

    let mut generator = made(CreateFlags::empty());
    let whole = panned(&gpu, &mut generator, &FrameParams::of(size), Extras::default());
    let rect = Rect { left: 0, top: 40, width: size.width.cast_signed(), height: size.height.cast_signed() - 80 };
    let barred = panned(&gpu, &mut generator, &FrameParams { rect, ..FrameParams::of(size) }, Extras::default());
    let bars = |_: u32, y: u32| y < 40 || y >= size.height - 40;
    println!(
        "letterbox: bars {} off the frame with it, {} without; the world {} off the half step",
        off(&barred, bars, moved(48.0)),
        off(&whole, bars, moved(48.0)),
        off(&barred, inner, &half)
    );
    assert!(off(&barred, bars, moved(48.0)) <= 1 && off(&whole, bars, moved(48.0)) > 20);
    assert!(off(&barred, inner, &half) <= 2);

    let sign = [250, 10, 240, 255];
    let drawn = Extras { sign: Some(sign), ..Extras::default() };
    let without = panned(&gpu, &mut generator, &FrameParams::of(size), drawn);
    let with = panned(&gpu, &mut generator, &FrameParams::of(size), Extras { hudless: true, ..drawn });
    let around = |x: u32, y: u32| inner(x, y) && !in_sign(x, y);
    println!(
        "interface: {} off the sign with the world alone, {} without; around it {} and {} off the half step",
        off(&with, in_sign, |_, _| sign),
        off(&without, in_sign, |_, _| sign),
        off(&with, around, &half),
        off(&without, around, &half)
    );
    assert!(off(&with, in_sign, |_, _| sign) <= 2, "it stands");
    assert!(off(&with, around, &half) < off(&without, around, &half), "and leaves less of a trail");

    // A lens that moves everything by 8 pixels, and then frames without it. The frames are given as the lens shows them, so a world that pans as
    // one is halfway in either case; the lens shows at its edges.
    let lens = Extras { lens: Some([-8.0 / size.width as f32, 0.0]), ..Extras::default() };
    let [distorted, after] =
        [lens, Extras::default()].map(|lens| panned(&gpu, &mut generator, &FrameParams::of(size), lens));
    let changed = |found: &[[u8; 4]]| found.iter().zip(&whole).filter(|(a, b)| a != b).count();
    println!("of {} pixels, {} change with a lens, {} after it", whole.len(), changed(&distorted), changed(&after));
    assert!(changed(&distorted) > 0 && changed(&after) == 0);
    assert!(off(&distorted, inner, &half) <= 2 && off(&after, inner, &half) <= 2);
    drop(generator);

    // High dynamic range: the same code values are other light. This matters where a provider estimates optical flow itself: the
    // world moves without motion vectors, after the first frames, in which it estimates none.
    let mut generator = made(CreateFlags::HIGH_DYNAMIC_RANGE);
    let [srgb, pq, scrgb] = [TransferFunction::SRGB, TransferFunction::PQ, TransferFunction::SCRGB].map(|transfer| {
        let textures = Textures::new(&gpu, size);
        textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
        textures.fill(&textures.motion, |_, _| [0; 4]);
        for number in 0_u8..16 {
            textures.fill(&textures.color, moved(6.0 * f32::from(number)));
            let pictures = textures.pictures();
            let params =
                FrameParams { reset: number == 0, transfer, luminance: [0.0, 1000.0], ..FrameParams::of(size) };
            generator.generate(&pictures, &params).expect("generated").wait().expect("it has run");
        }
        textures.generated()
    });
    let [pq, scrgb] = [pq, scrgb].map(|found| found.iter().zip(&srgb).filter(|(a, b)| a != b).count());
    println!("of {} pixels, {pq} are others in PQ than in sRGB, and {scrgb} in scRGB", srgb.len());
    assert!(pq > 0);
    assert!(gpu.removed().is_none());
}

fn memory_of_each_size_is_reported() {
    let library = Library::load(&options(false)).expect("loaded");
    let api = library.api(Effect::FrameGeneration).expect("there");
    let gpu = Gpu::on_adapter(None).expect("a device");
    for (width, height) in [(640, 360), (1280, 720), (1920, 1080)] {
        let size = Dimensions { width, height };
        let made = CreateFrameGeneration { display_size: size, max_render_size: size, ..head() };
        // SAFETY: a live device, which outlives the generator.
        let (needed, generator) = unsafe {
            let device = gpu.device().as_raw();
            let needed = memory_needed(api, device, &made, None).expect("an answer");
            (needed, Generator::create(api, device, Choice::Prefer(Family::Analytic), made, None))
        };
        let reported = generator.expect("a generator").memory().expect("an answer");
        println!("{width} x {height}: {reported:?}; before it was made: {needed:?}");
        assert!(reported.is_some_and(|reported| reported.total > u64::from(4 * width * height)));
    }
}

/// The tests of this program.
pub(crate) fn trials() -> Vec<Trial> {
    trials![
        with_amd: they_are_found_and_loaded_with_their_versions,
        their_signature_is_amd_s,
        one_altered_byte_is_detected,
        a_provider_is_chosen_and_created_and_reports_its_version,
        a_picture_that_pans_is_halfway_between_and_a_reset_gives_the_frame_itself,
        declared_jitter_in_motion_does_no_harm_and_a_detected_cut_gives_the_frame_itself,
        it_passes_the_self_test_and_generates_on_both_kinds_of_queue,
        interface_letterbox_lens_and_transfer_function_change_amd_s_frame,
        depth_and_motion_cover_the_part_that_is_generated,
        memory_of_each_size_is_reported,
    ]
}
