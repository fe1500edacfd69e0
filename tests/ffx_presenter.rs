//! Presenters whose frames half way between two anchors AMD's libraries make, played by the double. On Windows, or in the lab.
#![cfg(windows)]

use std::path::Path;
use std::ptr::null_mut;
use std::sync::Arc;

use cairn::abi::anchor::{cairn_anchor, cairn_anchor_create, cairn_anchor_destroy};
use cairn::abi::d3d12::{
    cairn_d3d12_preparation, cairn_d3d12_recording, cairn_device_create_d3d12, cairn_presenter_prepare_d3d12,
    cairn_presenter_record_d3d12,
};
use cairn::abi::device::{cairn_device, cairn_device_destroy};
use cairn::abi::images::{cairn_picture, cairn_target};
use cairn::abi::presenter::*;
use cairn::abi::results::{CAIRN_ERROR_RUNTIME_MISSING, CAIRN_ERROR_UNSUPPORTED, CAIRN_OK, cairn_result};
use cairn::abi::statistics::*;
use cairn::ffx::{Choice, Effect, Part};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use cairn::gpu::{FencePoint, Gpu, Target};
use cairn::guidance::{DepthMap, Guidance, MotionField, paper};
use cairn::present::device::{DeviceDrawer, Preparation, ScaledBy};
use cairn::present::pacing::Interval;
use cairn::present::presenter::{FrameInfo, FrameSource, Presenter, PresenterOptions};
use cairn::world::KeptAnchor;
use cairn::{Colours, Picture};
use half::f16;

#[path = "d3d12/engine.rs"]
#[allow(dead_code, reason = "each test program uses its part")]
mod engine;
#[path = "ffx/enlarged.rs"]
mod enlarged;
#[path = "d3d12/handles.rs"]
#[allow(dead_code, reason = "each test program uses its part")]
mod handles;
#[path = "ffx/in_memory.rs"]
mod in_memory;
#[path = "ffx/stage.rs"]
#[allow(dead_code, reason = "each test program uses its part")]
mod stage;
#[path = "d3d12/textures.rs"]
#[allow(dead_code, reason = "each test program uses its part")]
mod textures;
use engine::Engine;
use enlarged::{LARGE, with_upscaler};
use handles::prepared;
use stage::{ANALYTIC, ML, Stage};
use textures::{Recording, Wanted};

/// Of anchors and frames.
const SIZE: (u32, u32) = (128, 96);
/// Pixels that the picture moves to the right from anchor to anchor.
const STEP: i32 = 16;
/// Nanoseconds between anchors.
const INTERVAL: u64 = 100_000_000;
/// The part of the picture into which nothing comes from outside.
const INNER: std::ops::Range<u32> = 32..96;
/// AMD's upscaler, as its library names it.
const UPSCALER: &str = "offers 0xf600000001000003 4.0.3";
/// What textures rest in.
const REST: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COMMON;

/// The picture moved to the right by so many pixels.
fn moved(by: i32) -> Picture {
    drawn(SIZE, by)
}

/// The same in another size; by pixels of its own.
fn drawn(size: (u32, u32), by: i32) -> Picture {
    let wave = |phase: f32| (128.0 + 90.0 * phase.sin()) as u8;
    let mut picture = Picture::new(size.0, size.1).expect("a picture");
    let scale = [size.0 as f32 / SIZE.0 as f32, size.1 as f32 / SIZE.1 as f32];
    for (pixel, place) in picture.pixels_mut().iter_mut().zip(0..) {
        let (x, y) = (place % size.0, place / size.0);
        let (x, y) = ((x as f32 + 0.5) / scale[0] - 0.5 - by as f32, (y as f32 + 0.5) / scale[1] - 0.5);
        *pixel = [wave(x * 0.11), wave(y * 0.13 + x * 0.05), wave(x * 0.07 - y * 0.09), 255];
    }
    picture
}

/// The largest difference of a channel in the inner part.
fn off(found: &[u8], wanted: &Picture) -> u8 {
    let (width, height) = wanted.size();
    let inside = |place: u32| {
        let (x, y) = (place % width * SIZE.0 / width, place / width);
        // What is larger is of the nearest pixels at its edge.
        INNER.contains(&x) && (4..height - 4).contains(&y)
    };
    let pixels = found.as_chunks::<4>().0.iter().zip(wanted.pixels()).zip(0..);
    let inner = pixels.filter(|(_, place)| inside(*place)).map(|(pair, _)| pair);
    inner.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b))).max().unwrap_or(u8::MAX)
}

/// Anchors that come one after the other, and the frames in between.
struct Stream {
    engine: Engine,
    presenter: Presenter,
    drawer: DeviceDrawer,
    prepared_for: Option<(u32, u32)>,
    anchors: u64,
}

impl Stream {
    fn new(multiplier: u32) -> Self {
        Self::of_size(multiplier, None)
    }

    /// With frames of another size.
    fn of_size(multiplier: u32, size: Option<(u32, u32)>) -> Self {
        let engine = engine::engine();
        let gpu = Gpu::of_engine(&engine.device, &engine.direct, None).expect("the engine's device");
        let options = PresenterOptions {
            interval: Some(Interval::of_ns(INTERVAL).expect("an interval")),
            multiplier,
            size,
            capacity: 8,
            ..PresenterOptions::default()
        };
        Self {
            presenter: Presenter::new(options, None).expect("a presenter"),
            drawer: DeviceDrawer::new(&gpu, SIZE, Colours::Shown).expect("a drawer"),
            prepared_for: None,
            anchors: 0,
            engine,
        }
    }

    /// Makes what frames of the present size need.
    fn prepare(&mut self) -> cairn::Result<()> {
        let size = self.presenter.size().expect("anchors have come");
        if self.prepared_for != Some(size) {
            self.drawer.prepare(&self.presenter, &Preparation::new(size))?;
            self.prepared_for = Some(size);
        }
        Ok(())
    }

    /// Has a provider of that stage's make frames.
    fn use_fsr(&mut self, stage: &Stage, is_required: bool) -> cairn::Result<()> {
        let library = stage.load().expect("loaded");
        let api = library.api(Effect::FrameGeneration).expect("there");
        self.drawer.use_fsr(api, Choice::Any, is_required)
    }

    /// The next anchor, with its motion in tiles so large, and depth in tiles so large.
    fn push(&mut self, tiles: [u32; 2]) {
        let number = self.anchors;
        let mut motion = MotionField::tiled(SIZE.0, SIZE.1, tiles[0]).expect("a field");
        motion.vectors_mut().fill([f16::from_f32(-STEP as f32), f16::ZERO]);
        let mut depth = DepthMap::tiled(SIZE.0, SIZE.1, tiles[1], paper::PROJECTION).expect("a depth map");
        depth.fill(0.5);
        let guidance = Arc::new(Guidance::from_parts(motion, depth).expect("guidance"));
        let picture = moved(STEP * i32::try_from(number).expect("few"));
        let anchor = Arc::new(KeptAnchor::of_picture(picture, number, false));
        let guidance = (number > 0).then_some(guidance);
        assert!(self.presenter.push(anchor, guidance, number * INTERVAL).expect("it is taken"));
        self.anchors += 1;
    }

    /// The frame `t` after the anchor before the last, in a list of an engine's or of ours; its pixels, where the list is run.
    fn draw(&mut self, t: f64, own: bool, runs: bool) -> (FrameInfo, Option<Vec<u8>>) {
        let now = (self.anchors - 1) * INTERVAL + (t * INTERVAL as f64) as u64;
        let size = self.presenter.size().expect("anchors have come");
        self.prepare().expect("it is prepared");
        let texture = Wanted { size, ..Wanted::default() }.make(&self.engine.device);
        let target = Target { texture: texture.clone(), before: REST, after: REST };
        let shown = if own {
            let made = self.presenter.submit(now, &mut self.drawer, &target).expect("it is made");
            let (shown, fence_point) = made.made().expect("a frame");
            fence_point.wait().expect("it has run");
            shown
        } else {
            let recording = Recording::on(&self.engine.device, &self.engine.direct);
            let until = FencePoint::of_engine(self.drawer.gpu(), recording.fence(), 1).expect("the device's");
            let made = self.presenter.record(now, &mut self.drawer, recording.list(), &target, &until);
            let shown = made.expect("it is recorded").made().expect("a frame");
            if !runs {
                recording.drop_list();
                return (shown, None);
            }
            recording.submit(&self.engine.direct);
            textures::wait(&self.engine.device, &self.engine.direct);
            shown
        };
        (shown, Some(textures::read(&self.engine.device, &self.engine.direct, &texture, REST)))
    }

    /// The frame half way between the last two anchors, and who made it.
    fn half(&mut self, own: bool) -> Option<String> {
        let (shown, pixels) = self.draw(0.5, own, true);
        assert_eq!((shown.source, shown.t), (FrameSource::Generated, 0.5));
        let place = STEP * i32::try_from(self.anchors).expect("few") - 3 * STEP / 2;
        let error = off(&pixels.expect("it has run"), &moved(place));
        assert!(error <= 3, "anchor {}: {error} off", self.anchors);
        self.made_by()
    }

    fn made_by(&self) -> Option<String> {
        self.drawer.made_by_fsr().map(|version| version.name.clone())
    }
}

/// Pictures that were asked for.
fn pictures(stage: &Stage) -> usize {
    stage.calls().iter().filter(|call| call.starts_with("dispatch 20003 ")).count()
}

fn version() -> Option<String> {
    Some("4.0.1".to_owned())
}

#[test]
fn frames_half_way_are_a_provider_s_and_all_others_the_shaders() {
    let stage = Stage::empty().with(Part::FrameGeneration, &["sdk 2.1", ML]);
    let mut stream = Stream::new(4);
    stream.use_fsr(&stage, true).expect("a provider");
    assert_eq!(stream.made_by(), version(), "who will make them");
    let mut asked = pictures(&stage);
    stream.push([1, 1]);
    for (pair, tiles) in [[1, 1], [8, 1], [16, 16], [1, 16]].into_iter().enumerate() {
        stream.push(tiles);
        for (quarter, made) in [(1, None), (2, version()), (3, None)] {
            let own = (pair + quarter) % 2 == 0;
            let (shown, pixels) = stream.draw(quarter as f64 / 4.0, own, true);
            assert_eq!(shown.source, FrameSource::Generated);
            let place = STEP * i32::try_from(pair).expect("few") + STEP * quarter as i32 / 4;
            let error = off(&pixels.expect("it has run"), &moved(place));
            assert!(error <= 3, "{tiles:?}, {quarter} of 4: {error} off");
            assert_eq!(stream.made_by(), made, "{tiles:?}, {quarter} of 4");
        }
        // The first pair has no history: the earlier anchor is shown first.
        let now = pictures(&stage);
        assert_eq!(now - asked, if pair == 0 { 2 } else { 1 }, "{tiles:?}");
        asked = now;
    }
    // Shown again it is not made again.
    stream.push([1, 1]);
    let (first, second) = (stream.draw(0.5, true, true), stream.draw(0.5, false, true));
    assert!(!first.0.repeated && second.0.repeated && first.1 == second.1);
    assert_eq!(pictures(&stage) - asked, 1);
    // What is late is extrapolated by shaders.
    let (shown, _) = stream.draw(1.25, true, true);
    assert_eq!((shown.source, stream.made_by()), (FrameSource::Extrapolated, None));
    assert!(stream.drawer.fsr_failed().is_none());
    assert_eq!(stage.judgement(), [""; 0]);
}

#[test]
fn frames_that_are_left_out_or_never_run_do_not_break_history() {
    let stage = Stage::empty().with(Part::FrameGeneration, &["sdk 2.1", ML]);
    let mut stream = Stream::new(2);
    stream.use_fsr(&stage, true).expect("a provider");
    (0..2).for_each(|_| stream.push([1, 1]));
    assert_eq!(stream.half(false), version());
    let asked = pictures(&stage);
    // An engine drops its list: what the provider was shown it was shown.
    stream.push([1, 1]);
    assert_eq!(stream.draw(0.5, false, false).0.source, FrameSource::Generated);
    stream.push([1, 1]);
    assert_eq!(stream.half(false), version());
    assert_eq!(pictures(&stage) - asked, 2, "one to a pair");
    // Nobody draws between two anchors.
    (0..2).for_each(|_| stream.push([8, 8]));
    assert_eq!(stream.half(true), version());
    assert_eq!(pictures(&stage) - asked, 4, "the earlier anchor is shown first");
    // Another stream.
    stream.presenter.reset();
    stream.anchors = 0;
    (0..2).for_each(|_| stream.push([1, 1]));
    assert_eq!(stream.half(false), version());
    assert_eq!(pictures(&stage) - asked, 6, "nothing of the stream before is gone on with");
    assert_eq!(stage.judgement(), [""; 0]);
}

#[test]
fn shaders_make_what_a_provider_does_not() {
    // One that fails its test is not taken.
    let stage = Stage::empty().with(Part::FrameGeneration, &["sdk 2.1", ML, "plays through"]);
    let mut stream = Stream::new(2);
    let why = stream.use_fsr(&stage, false).expect_err("it passes frames through");
    assert!(why.to_string().contains("passes frames through"), "{why}");
    (0..2).for_each(|_| stream.push([1, 1]));
    assert_eq!(stream.half(false), None);

    // Two pictures are the test's, two the first pair's; the fifth fails.
    for is_required in [false, true] {
        let stage = Stage::empty().with(Part::FrameGeneration, &["sdk 2.1", ANALYTIC, "breaks 5"]);
        let mut stream = Stream::new(2);
        stream.use_fsr(&stage, is_required).expect("a provider");
        (0..2).for_each(|_| stream.push([1, 1]));
        assert_eq!(stream.half(true).as_deref(), Some("3.1.6"));
        stream.push([1, 1]);
        if is_required {
            let texture = Wanted { size: SIZE, ..Wanted::default() }.make(&stream.engine.device);
            let target = Target { texture, before: REST, after: REST };
            let failed = stream.presenter.submit(2 * INTERVAL + INTERVAL / 2, &mut stream.drawer, &target);
            assert!(failed.expect_err("nobody else may").to_string().contains("ffxDispatch"));
            assert!(stream.drawer.fsr_failed().is_none());
        } else {
            assert_eq!(stream.half(true), None, "shaders make it");
            let why = stream.drawer.fsr_failed().expect("a reason");
            assert!(why.to_string().contains("ffxDispatch"), "{why}");
        }
        assert_eq!(stage.judgement(), [""; 0]);
    }
}

/// A handle that a call of the interface makes.
fn made<T>(make: impl FnOnce(*mut *mut T) -> cairn_result) -> Result<*mut T, cairn_result> {
    let mut handle = null_mut();
    match make(&mut handle) {
        CAIRN_OK => Ok(handle),
        other => Err(other),
    }
}

/// A presenter of two anchors, four frames to an anchor.
fn host_s(fsr: u32, shader: u32) -> Result<*mut cairn_presenter, cairn_result> {
    host_of((0, 0), [fsr, shader, CAIRN_PREFER_AUTO])
}

/// The same with frames of a size, and preferences for generators and upscaler.
fn host_of(size: (u32, u32), [fsr, shader, upscaler]: [u32; 3]) -> Result<*mut cairn_presenter, cairn_result> {
    let mut options: cairn_presenter_options = prepared(|o: &mut cairn_presenter_options| &mut o.struct_size);
    (options.multiplier, options.interval_ns, options.motion) = (4, INTERVAL, 0);
    (options.fsr, options.shader, options.upscaler) = (fsr, shader, upscaler);
    (options.width, options.height) = size;
    // SAFETY: options of their size and a place for the handle.
    let presenter = made(|to| unsafe { cairn_presenter_create(&options, to) })?;
    for number in 0..2 {
        let picture = moved(STEP * number);
        let number = u64::from(number.cast_unsigned());
        let mut given: cairn_picture = prepared(|picture: &mut cairn_picture| &mut picture.struct_size);
        (given.width, given.height) = SIZE;
        (given.pixels, given.size) = (picture.rgba().as_ptr().cast(), picture.rgba().len() as u64);
        // SAFETY: a picture that lives during the call, and a place for the handle.
        let anchor: *mut cairn_anchor =
            made(|to| unsafe { cairn_anchor_create(&given, number, 0, to) }).expect("an anchor");
        // SAFETY: live handles.
        let pushed = unsafe { cairn_presenter_push(presenter, anchor, std::ptr::null(), number * INTERVAL) };
        // SAFETY: a live handle.
        assert_eq!([pushed, unsafe { cairn_anchor_destroy(anchor) }], [CAIRN_OK; 2]);
    }
    Ok(presenter)
}

/// The generator of the last frame, and why it is not another one.
fn used(presenter: *mut cairn_presenter) -> (String, String) {
    let [generator, preference, ..] = said(presenter);
    (generator, preference)
}

/// The same, and what brings frames to their size, and why AMD's upscaler does not.
fn said(presenter: *mut cairn_presenter) -> [String; 4] {
    let mut done: cairn_presenter_statistics = prepared(|done: &mut cairn_presenter_statistics| &mut done.struct_size);
    // SAFETY: a live handle, and a place for the figures.
    assert_eq!(unsafe { cairn_presenter_get_statistics(presenter, &mut done) }, CAIRN_OK);
    let text = |text: &[std::ffi::c_char]| {
        let bytes: Vec<u8> = text.iter().take_while(|c| **c != 0).map(|c| c.cast_unsigned()).collect();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    [text(&done.generator), text(&done.preference), text(&done.upscaler), text(&done.upscaling)]
}

/// Records the frame at `now`.
fn record(engine: &Engine, device: *mut cairn_device, presenter: *mut cairn_presenter, now: u64) -> cairn_result {
    record_of(SIZE, engine, device, presenter, now)
}

/// The same in another size.
fn record_of(
    size: (u32, u32),
    engine: &Engine,
    device: *mut cairn_device,
    presenter: *mut cairn_presenter,
    now: u64,
) -> cairn_result {
    let texture = Wanted { size, ..Wanted::default() }.make(&engine.device);
    let recording = Recording::on(&engine.device, &engine.direct);
    let wanted: cairn_d3d12_preparation = prepared(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
    // SAFETY: live handles, and a struct of its size.
    let result = unsafe { cairn_presenter_prepare_d3d12(presenter, device, &wanted) };
    if result != CAIRN_OK {
        return result;
    }
    let mut told: cairn_d3d12_recording = prepared(|r: &mut cairn_d3d12_recording| &mut r.struct_size);
    (told.list, told.target) = (recording.list().as_raw().cast(), texture.as_raw().cast());
    (told.fence, told.fence_value) = (recording.fence().as_raw().cast(), 1);
    // SAFETY: live handles and objects.
    let result = unsafe { cairn_presenter_record_d3d12(presenter, device, now, &told, null_mut()) };
    if result == CAIRN_OK {
        recording.submit(&engine.direct);
        textures::wait(&engine.device, &engine.direct);
    }
    result
}

#[test]
fn a_host_prefers_requires_or_never_uses_it_and_learns_who_made_a_frame() {
    let test = "a_host_prefers_requires_or_never_uses_it_and_learns_who_made_a_frame";
    stage::alone(test, || {
        let stage = Stage::empty().with(Part::FrameGeneration, &["sdk 2.1", ML]);
        let named = |folder: &Path| {
            // SAFETY: this process runs one test, and no other thread reads the environment now.
            unsafe { std::env::set_var("CAIRN_FFX_DIR", folder) };
        };
        let engine = engine::engine();
        let (device, queue) = (engine.device.as_raw().cast(), engine.direct.as_raw().cast());
        let options = handles::of_a_tool();
        // SAFETY: live objects, options of their size and a place for the handle.
        let device = made(|to| unsafe { cairn_device_create_d3d12(device, queue, null_mut(), &options, to) });
        let device = device.expect("a device");
        let [quarter, half] = [INTERVAL * 5 / 4, INTERVAL * 3 / 2];
        let (auto, require, never) = (CAIRN_PREFER_AUTO, CAIRN_PREFER_REQUIRE, CAIRN_PREFER_NEVER);
        let fsr = "fsr 4.0.1";
        named(&stage.0);
        for (preference, at, name, why) in [
            (auto, half, fsr, ""),
            (require, half, fsr, ""),
            (auto, quarter, "shader", "half way between two anchors"),
            (never, half, "shader", "not to be used"),
        ] {
            let presenter = host_s(preference, auto).expect("a presenter");
            assert_eq!(record(&engine, device, presenter, at), CAIRN_OK);
            let (used, reason) = used(presenter);
            assert!(used == name && reason.contains(why) && why.is_empty() == reason.is_empty(), "{used}: {reason}");
            // SAFETY: a live handle; the queue was waited for.
            assert_eq!(unsafe { cairn_presenter_destroy(presenter) }, CAIRN_OK);
        }
        // Frames that are larger are AMD's upscaler's, or resized in space.
        let both = with_upscaler(&[]);
        named(&both.0);
        for (size, upscaler, by, why) in [
            (LARGE, auto, "fsr 4.0.3", ""),
            (LARGE, require, "fsr 4.0.3", ""),
            (LARGE, never, "spatial", "not to be used"),
            ((64, 48), auto, "spatial", "makes anchors larger"),
            (SIZE, auto, "", ""),
        ] {
            let presenter = host_of(size, [auto, auto, upscaler]).expect("a presenter");
            assert_eq!(record_of(size, &engine, device, presenter, half), CAIRN_OK);
            let [generator, _, scaled, reason] = said(presenter);
            assert!(generator == fsr && scaled == by && reason.contains(why), "{generator}, {scaled}: {reason}");
            assert_eq!(why.is_empty(), reason.is_empty(), "{reason}");
            // SAFETY: a live handle; the queue was waited for.
            assert_eq!(unsafe { cairn_presenter_destroy(presenter) }, CAIRN_OK);
        }
        assert_eq!(both.judgement(), [""; 0]);
        // Where the libraries are not there it is said, unless they are required.
        named(&std::env::temp_dir().join("cairn-ffx-there-is-none"));
        let presenter = host_s(auto, auto).expect("a presenter");
        assert_eq!(record(&engine, device, presenter, half), CAIRN_OK);
        let (name, reason) = used(presenter);
        assert!(name == "shader" && reason.contains("were not found"), "{name}: {reason}");
        let required = host_s(require, auto).expect("a presenter");
        assert_eq!(record(&engine, device, required, half), CAIRN_ERROR_RUNTIME_MISSING);
        let upscaled = host_of(LARGE, [never, auto, require]).expect("a presenter");
        assert_eq!(record_of(LARGE, &engine, device, upscaled, half), CAIRN_ERROR_RUNTIME_MISSING);
        // SAFETY: a live handle.
        assert_eq!(unsafe { cairn_presenter_destroy(upscaled) }, CAIRN_OK);
        assert_eq!(host_of(LARGE, [never, never, require]), Err(CAIRN_ERROR_UNSUPPORTED));
        // It makes nothing in memory, and is nothing without shaders.
        let mut pixels = vec![0_u8; (4 * SIZE.0 * SIZE.1) as usize];
        let mut target: cairn_target = prepared(|target: &mut cairn_target| &mut target.struct_size);
        (target.width, target.height) = SIZE;
        (target.pixels, target.size) = (pixels.as_mut_ptr().cast(), pixels.len() as u64);
        // SAFETY: a live handle and a target that lives during the call.
        let drawn = unsafe { cairn_presenter_draw(required, half, &target, null_mut()) };
        assert_eq!(drawn, CAIRN_ERROR_UNSUPPORTED);
        assert_eq!(host_s(require, never), Err(CAIRN_ERROR_UNSUPPORTED));
        for presenter in [presenter, required] {
            // SAFETY: a live handle; the queue was waited for.
            assert_eq!(unsafe { cairn_presenter_destroy(presenter) }, CAIRN_OK);
        }
        // SAFETY: a live handle.
        assert_eq!(unsafe { cairn_device_destroy(device) }, CAIRN_OK);
        assert_eq!(stage.judgement(), [""; 0]);
    });
}
