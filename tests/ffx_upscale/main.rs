//! Upscaling with the double of AMD's libraries: each option changes pixels. On Windows, or in the lab.
#![cfg(windows)]

use cairn::ErrorKind;
use cairn::ffx::bindings::{
    Coordinates, CreateUpscale, Dimensions, QualityMode, Resource, ResourceState, UpscaleCreateFlags, UpscaleFlags,
    UpscaleResources,
};
use cairn::ffx::{
    Camera, Choice, Effect, Family, Library, LibraryKind, UpscaleFrame, UpscaleParams, Upscaler, memory_needed,
};
use cairn::gpu::Gpu;
use cairn::gpu::windows::core::Interface;
use test_support::d3d12::resources::{self, TestResource, run_list};
use test_support::ffx::double_folder::{self, DoubleFolder, in_new_process};
use test_support::ffx::frame_textures::Textures;

mod texture_upscaler;

/// AMD's upscalers as lines of the double's configuration.
const NEWEST: &str = "offers 0xf600000001000003 4.0.3";
const ANALYTIC: &str = "offers 0xf600000000c01004 3.1.4";

const SHOWN: Dimensions = Dimensions { width: 128, height: 96 };
const RENDERED: Dimensions = Dimensions { width: 64, height: 48 };

fn set_up_double(lines: &[&str]) -> (DoubleFolder, Library) {
    let lines: Vec<_> = ["effect 0x10000"].iter().chain(lines).copied().collect();
    let double = DoubleFolder::empty().with(LibraryKind::Upscaler, &lines);
    let library = double.load().expect("loaded");
    (double, library)
}

fn head(flags: UpscaleCreateFlags) -> CreateUpscale {
    CreateUpscale { flags, max_render_size: RENDERED, max_upscale_size: SHOWN, ..Default::default() }
}

fn made(gpu: &Gpu, library: &Library, flags: UpscaleCreateFlags) -> cairn::Result<Upscaler> {
    let api = library.api(Effect::Upscaling)?;
    // SAFETY: a live device, which outlives the upscaler.
    unsafe { Upscaler::create(api, gpu.device().as_raw(), Choice::Any, head(flags)) }
}

/// An engine's textures for a frame.
struct Scene {
    gpu: Gpu,
    rendered: Textures,
    shown: Textures,
    one: Textures,
    reactive: TestResource,
    transparency: TestResource,
}

/// Parameters of a frame, and which optional textures are passed.
#[derive(Clone, Copy)]
struct FrameInput {
    params: UpscaleParams,
    exposure: bool,
    reactive: bool,
    transparency: bool,
    /// Passes the motion texture of display size.
    shown_motion: bool,
}

impl FrameInput {
    fn plain() -> Self {
        let params = UpscaleParams::of(RENDERED, SHOWN);
        Self { params, exposure: false, reactive: false, transparency: false, shown_motion: false }
    }

    fn with(change: impl FnOnce(&mut UpscaleParams)) -> Self {
        let mut plain = Self::plain();
        change(&mut plain.params);
        plain
    }
}

/// An endless smooth pattern without repetition, in display pixels.
fn world(x: f32, y: f32) -> [u8; 4] {
    let wave = |phase: f32| (128.0 + 90.0 * phase.sin()) as u8;
    [wave(x * 0.11), wave(y * 0.13 + x * 0.05), wave(x * 0.07 - y * 0.09), 255]
}

fn halves(x: f32, y: f32) -> [u8; 4] {
    let [a, b] = [x, y].map(|v| half::f16::from_f32(v).to_le_bytes());
    [a[0], a[1], b[0], b[1]]
}

impl Scene {
    fn new() -> Self {
        let gpu = Gpu::on_adapter(None).expect("a device");
        let [rendered, shown] = [RENDERED, SHOWN].map(|size| Textures::new(&gpu, size));
        let one = Textures::new(&gpu, Dimensions { width: 1, height: 1 });
        let [reactive, transparency] = [(); 2].map(|()| Textures::new(&gpu, RENDERED).depth);
        // Near pixels are in every other column.
        rendered.fill(&rendered.depth, |x, _| if x.is_multiple_of(2) { 0.25_f32 } else { 0.5 }.to_le_bytes());
        rendered.fill(&rendered.motion, |x, _| halves(-4.0 - (x % 2) as f32 * 0.5, 0.0));
        shown.fill(&shown.motion, |_, _| halves(-6.0, 0.0));
        one.fill(&one.depth, |_, _| 3.0_f32.to_le_bytes());
        rendered.fill(&reactive, |_, y| (y as f32 / 48.0).to_le_bytes());
        rendered.fill(&transparency, |x, _| (x as f32 / 64.0).to_le_bytes());
        Self { gpu, rendered, shown, one, reactive, transparency }
    }

    /// Draws the pattern, moved to the right by display pixels, with that camera jitter.
    fn draw(&self, by: f32, jitter: Coordinates) {
        self.rendered.fill(&self.rendered.color, |x, y| {
            let at = |v: u32, jitter: f32| (v as f32 + 0.5 - jitter) * 2.0 - 0.5;
            world(at(x, jitter.x) - by, at(y, jitter.y))
        });
    }

    /// Upscales a frame with these parameters.
    fn upscale(&self, upscaler: &mut Upscaler, input: &FrameInput) -> cairn::Result<Vec<[u8; 4]>> {
        let resource = |kept: &TestResource| Resource::of(&kept.resource, ResourceState::UNORDERED_ACCESS);
        let optional =
            |is_given: bool, kept: &TestResource| if is_given { resource(kept) } else { Resource::default() };
        let mut answer = Ok(());
        run_list(&self.gpu, |list| {
            let frame = UpscaleFrame {
                command_list: list.as_raw(),
                color: resource(&self.rendered.color),
                depth: resource(&self.rendered.depth),
                motion: resource(if input.shown_motion { &self.shown.motion } else { &self.rendered.motion }),
                exposure: optional(input.exposure, &self.one.depth),
                reactive: optional(input.reactive, &self.reactive),
                transparency: optional(input.transparency, &self.transparency),
                output: resource(&self.shown.output),
                params: input.params,
            };
            // SAFETY: an open list of the upscaler's device, and textures that live until it has run.
            answer = unsafe { upscaler.record(&frame) };
        });
        answer.map(|()| self.shown.generated())
    }

    /// Upscales two frames, between which the world moves by 8 pixels; returns the second.
    fn pair(&self, upscaler: &mut Upscaler, input: &FrameInput) -> Vec<[u8; 4]> {
        self.draw(0.0, Coordinates::default());
        let first = FrameInput { params: UpscaleParams { reset: true, ..input.params }, ..*input };
        self.upscale(upscaler, &first).expect("upscaled");
        self.draw(8.0, Coordinates::default());
        self.upscale(upscaler, input).expect("upscaled")
    }
}

/// Mean difference of a channel from the expected pixels, away from the borders.
fn off(found: &[[u8; 4]], expected: impl Fn(u32, u32) -> [u8; 4]) -> f64 {
    let places = (8..SHOWN.height - 8).flat_map(|y| (16..SHOWN.width - 16).map(move |x| (x, y)));
    let all: Vec<f64> = places
        .flat_map(|(x, y)| {
            let (a, b) = (found[(y * SHOWN.width + x) as usize], expected(x, y));
            a.into_iter().zip(b).take(3).map(|(a, b)| f64::from(a.abs_diff(b)))
        })
        .collect();
    all.iter().sum::<f64>() / all.len() as f64
}

fn moved(by: f32) -> impl Fn(u32, u32) -> [u8; 4] {
    move |x, y| world(x as f32 - by, y as f32)
}

#[test]
fn a_frame_is_upscaled_with_the_history_of_the_previous_one() {
    for release in [["sdk 1.1.4", ANALYTIC], ["sdk 2.0", ANALYTIC], ["sdk 2.1", NEWEST]] {
        let (double, library) = set_up_double(&release);
        let scene = Scene::new();
        let mut upscaler = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
        // A frame without history, with camera jitter: aligned if the jitter is passed, and shifted if not.
        let jitter = Coordinates { x: 0.4, y: -0.3 };
        scene.draw(0.0, jitter);
        let right = scene.upscale(&mut upscaler, &FrameInput::with(|params| params.jitter = jitter)).expect("upscaled");
        let beside = scene.upscale(&mut upscaler, &FrameInput::with(|params| params.reset = true)).expect("upscaled");
        let (right, beside) = (off(&right, moved(0.0)), off(&beside, moved(0.0)));
        assert!(right < 1.0 && beside > 2.0 * right, "{release:?}: {right} {beside}");
        // The previous frame is blended in along the near pixels' motion, 4 render pixels to the left.
        let together = off(&scene.pair(&mut upscaler, &FrameInput::plain()), moved(8.0));
        let wrong = FrameInput::with(|params| params.motion_scale = Coordinates { x: -1.0, y: 1.0 });
        let apart = off(&scene.pair(&mut upscaler, &wrong), moved(8.0));
        assert!(together < 1.0 && apart > 5.0, "{release:?}: {together} {apart}");
        drop(upscaler);
        assert!(scene.gpu.removed().is_none());
        assert_eq!(double.violations(), [""; 0]);
    }
}

#[test]
fn every_option_changes_the_upscaled_frame() {
    let (double, library) = set_up_double(&["sdk 2.1", NEWEST]);
    let scene = Scene::new();
    let mut upscaler = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
    let plain = scene.pair(&mut upscaler, &FrameInput::plain());
    assert!(scene.pair(&mut upscaler, &FrameInput::plain()) == plain, "it does the same each time");
    let pair = |x, y| Coordinates { x, y };
    for (name, input) in [
        ("jitter", FrameInput::with(|params| params.jitter = pair(0.25, 0.0))),
        ("motion_scale", FrameInput::with(|params| params.motion_scale = pair(0.5, 1.0))),
        ("sharpness", FrameInput::with(|params| params.sharpness = Some(0.8))),
        ("pre_exposure", FrameInput::with(|params| params.pre_exposure = 0.25)),
        ("reset", FrameInput::with(|params| params.reset = true)),
        ("exposure", FrameInput { exposure: true, ..FrameInput::plain() }),
        ("reactive", FrameInput { reactive: true, ..FrameInput::plain() }),
        ("transparency", FrameInput { transparency: true, ..FrameInput::plain() }),
    ] {
        // Slightly wrong motion, so that both frames differ.
        let off_by_one = |input: FrameInput| FrameInput {
            params: UpscaleParams { motion_scale: pair(input.params.motion_scale.x * 0.75, 1.0), ..input.params },
            ..input
        };
        let base = scene.pair(&mut upscaler, &off_by_one(FrameInput::plain()));
        assert!(scene.pair(&mut upscaler, &off_by_one(input)) != base, "{name}");
    }
    drop(upscaler);
    for (name, flags, input) in [
        ("depth", UpscaleCreateFlags::DEPTH_INVERTED, FrameInput::plain()),
        (
            "motion shown",
            UpscaleCreateFlags::DISPLAY_RESOLUTION_MOTION,
            FrameInput { shown_motion: true, ..FrameInput::plain() },
        ),
        (
            "sRGB",
            UpscaleCreateFlags::NON_LINEAR_COLOR,
            FrameInput::with(|params| params.encoding = UpscaleFlags::COLOR_SRGB),
        ),
        (
            "PQ",
            UpscaleCreateFlags::NON_LINEAR_COLOR,
            FrameInput::with(|params| params.encoding = UpscaleFlags::COLOR_PQ),
        ),
    ] {
        let mut without = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
        let mut with = made(&scene.gpu, &library, flags).expect("an upscaler");
        let of = FrameInput {
            params: UpscaleParams { encoding: UpscaleFlags::empty(), ..input.params },
            shown_motion: false,
            ..input
        };
        assert!(scene.pair(&mut with, &input) != scene.pair(&mut without, &of), "{name}");
    }
    // Motion that consists only of the change of jitter.
    let [before, now] = [pair(2.0, 0.5), pair(-2.0, 0.5)];
    scene.rendered.fill(&scene.rendered.motion, |_, _| halves(-4.0 + before.x - now.x, 0.0));
    let [with_flag, without_flag] = [UpscaleCreateFlags::MOTION_JITTER, UpscaleCreateFlags::empty()].map(|flags| {
        let mut upscaler = made(&scene.gpu, &library, flags).expect("an upscaler");
        scene.draw(0.0, before);
        let first = FrameInput::with(|params| (params.jitter, params.reset) = (before, true));
        scene.upscale(&mut upscaler, &first).expect("upscaled");
        scene.draw(8.0, now);
        let larger = scene.upscale(&mut upscaler, &FrameInput::with(|params| params.jitter = now)).expect("upscaled");
        off(&larger, moved(8.0))
    });
    assert!(with_flag < 1.0 && without_flag > 5.0, "{with_flag} {without_flag}");
    // Rendered below the maximum render size.
    let small = Dimensions { width: 32, height: 24 };
    let mut fixed = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
    let refused =
        scene.upscale(&mut fixed, &FrameInput::with(|params| params.render_size = small)).expect_err("of one size");
    assert_eq!(refused.offending_field(), Some("render_size"));
    assert!(scene.gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn parameters_without_effect_on_pictures_reach_the_provider() {
    let (double, library) = set_up_double(&["sdk 2.1", NEWEST]);
    let scene = Scene::new();
    let last = |id| double.parameters(id).pop().expect("it was told");
    let mut upscaler = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
    scene.draw(0.0, Coordinates::default());
    let mut input = |input: &FrameInput| {
        scene.upscale(&mut upscaler, input).expect("upscaled");
        last(0x1_0001)
    };
    let plain = input(&FrameInput::plain());
    let with_camera = |camera: Camera| FrameInput::with(|params| params.camera = camera);
    let camera = Camera::default();
    for (of, expected) in [
        (FrameInput::with(|params| params.frame_time = 33.5), ("time", "33.5")),
        (with_camera(Camera { near: 0.25, ..camera }), ("near", "0.25")),
        (with_camera(Camera { far: 250.0, ..camera }), ("far", "250")),
        (with_camera(Camera { fov: 0.75, ..camera }), ("fov", "0.75")),
        (with_camera(Camera { metres: 0.5, ..camera }), ("metres", "0.5")),
    ] {
        let mut wanted = plain.clone();
        let before = wanted.insert(expected.0.to_owned(), expected.1.to_owned());
        assert_eq!(input(&of), wanted, "{expected:?}, and nothing else");
        assert_ne!(before.as_deref(), Some(expected.1));
    }
    drop(upscaler);
    // The creation parameters.
    let small = Dimensions { width: 32, height: 24 };
    let of_small = Textures::new(&scene.gpu, small);
    for flag in [
        UpscaleCreateFlags::HIGH_DYNAMIC_RANGE,
        UpscaleCreateFlags::DISPLAY_RESOLUTION_MOTION,
        UpscaleCreateFlags::MOTION_JITTER,
        UpscaleCreateFlags::DEPTH_INVERTED,
        UpscaleCreateFlags::DEPTH_INFINITE,
        UpscaleCreateFlags::AUTO_EXPOSURE,
        UpscaleCreateFlags::DYNAMIC_RESOLUTION,
        UpscaleCreateFlags::DEBUG_CHECKING,
        UpscaleCreateFlags::NON_LINEAR_COLOR,
    ] {
        let mut upscaler = made(&scene.gpu, &library, flag).expect("an upscaler");
        let creation = last(0x1_0000);
        let expected = [flag.bits().to_string(), "64,48".to_owned(), "128,96".to_owned()];
        assert_eq!(["flags", "render", "shown"].map(|field| creation[field].clone()), expected);
        // A frame parameter whose validity the flag changes.
        let (field, otherwise) = match flag {
            UpscaleCreateFlags::DEPTH_INFINITE => {
                ("camera.far", with_camera(Camera { far: f32::INFINITY, ..Camera::default() }))
            }
            UpscaleCreateFlags::AUTO_EXPOSURE => ("exposure", FrameInput { exposure: true, ..FrameInput::plain() }),
            _ => continue,
        };
        let mut other = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
        let mut answers = [scene.upscale(&mut upscaler, &otherwise), scene.upscale(&mut other, &otherwise)];
        if flag == UpscaleCreateFlags::AUTO_EXPOSURE {
            answers.reverse();
        }
        let [taken, refused] = answers;
        assert!(taken.is_ok(), "{flag:?}");
        assert_eq!(refused.expect_err("refused").offending_field(), Some(field), "{flag:?}");
    }
    // Rendered below the maximum render size.
    let mut upscaler = made(&scene.gpu, &library, UpscaleCreateFlags::DYNAMIC_RESOLUTION).expect("an upscaler");
    of_small.fill(&of_small.color, |x, y| world(x as f32 * 4.0 + 1.5, y as f32 * 4.0 + 1.5));
    of_small.fill(&of_small.depth, |_, _| 0.5_f32.to_le_bytes());
    run_list(&scene.gpu, |list| {
        let resource = |kept: &TestResource| Resource::of(&kept.resource, ResourceState::UNORDERED_ACCESS);
        let frame = UpscaleFrame {
            command_list: list.as_raw(),
            color: resource(&of_small.color),
            depth: resource(&of_small.depth),
            motion: resource(&of_small.motion),
            exposure: Resource::default(),
            reactive: Resource::default(),
            transparency: Resource::default(),
            output: resource(&scene.shown.output),
            params: UpscaleParams::of(small, SHOWN),
        };
        // SAFETY: an open list of the upscaler's device, and textures that live until it has run.
        unsafe { upscaler.record(&frame) }.expect("recorded");
    });
    let error = off(&scene.shown.generated(), moved(0.0));
    assert!(error < 3.0, "{error}");
    assert_eq!(last(0x1_0001)["render_size"], "32,24");
    drop(upscaler);
    assert!(scene.gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn the_inputs_that_a_provider_names_can_be_queried() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let frame = UpscaleResources::COLOR | UpscaleResources::DEPTH | UpscaleResources::MOTION;
    let exposure = UpscaleResources::EXPOSURE;
    for (release, flags, required) in [
        (["sdk 1.1.4", ANALYTIC], UpscaleCreateFlags::empty(), None),
        (["sdk 2.0", ANALYTIC], UpscaleCreateFlags::empty(), Some(frame | exposure)),
        // What it finds itself need not be given, as AMD's header says.
        (["sdk 2.0", ANALYTIC], UpscaleCreateFlags::AUTO_EXPOSURE, Some(frame)),
        (["sdk 2.1", NEWEST], UpscaleCreateFlags::empty(), Some(frame | exposure)),
    ] {
        let (double, library) = set_up_double(&[release[0], release[1], "requires 0xf"]);
        let found = made(&gpu, &library, flags).expect("an upscaler").resources().expect("an answer");
        assert_eq!(found.map(|[required, _]| required), required, "{release:?}");
        assert!(found.is_none_or(|[_, optional]| optional.contains(UpscaleResources::REACTIVE)));
        assert_eq!(double.violations(), [""; 0]);
    }
}

#[test]
fn sizes_jitters_and_memory_can_be_queried() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    for (release, before) in
        [(["sdk 1.1.4", ANALYTIC], false), (["sdk 2.0", ANALYTIC], true), (["sdk 2.1", NEWEST], true)]
    {
        let (double, library) = set_up_double(&release);
        let api = library.api(Effect::Upscaling).expect("there");
        let shown = Dimensions { width: 1920, height: 1080 };
        for (mode, width, height) in [
            (QualityMode::NATIVE, 1920, 1080),
            (QualityMode::QUALITY, 1280, 720),
            (QualityMode::BALANCED, 1129, 635),
            (QualityMode::PERFORMANCE, 960, 540),
            (QualityMode::ULTRA_PERFORMANCE, 640, 360),
        ] {
            let size = Upscaler::render_size(api, shown, mode).expect("a size");
            assert_eq!((size.width, size.height), (width, height), "{mode:?}");
        }
        let phases = Upscaler::jitter_phases(api, 960, 1920).expect("a count");
        assert_eq!(phases, 32);
        let all: Vec<_> =
            (0..u64::from(phases)).map(|index| Upscaler::jitter(api, index, phases).expect("a jitter")).collect();
        let mean = |of: fn(&Coordinates) -> f32| all.iter().map(of).sum::<f32>() / all.len() as f32;
        assert!(mean(|j| j.x).abs() < 0.05 && mean(|j| j.y).abs() < 0.05);
        assert!(all.iter().all(|j| j.x.abs() <= 0.5 && j.y.abs() <= 0.5));
        let again = Upscaler::jitter(api, u64::from(phases) * 5 + 3, phases).expect("a jitter");
        assert_eq!((again.x, again.y), (all[3].x, all[3].y), "it comes round");
        let mut upscaler = made(&gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
        assert_eq!(upscaler.resources().expect("an answer"), None, "{release:?}: FSR 3 answers with every bit");
        let reported = upscaler.memory().expect("an answer").expect("it can say");
        // SAFETY: a live device.
        let needed = unsafe { memory_needed(api, gpu.device().as_raw(), upscaler.creation(), None) };
        let needed = needed.expect("an answer");
        assert_eq!(needed.is_some(), before, "{release:?}");
        assert!(needed.is_none_or(|needed| needed.total == reported.total));
        for (field, refused) in [
            ("shown", Upscaler::render_size(api, Dimensions::default(), QualityMode::QUALITY).err()),
            ("render_width", Upscaler::jitter_phases(api, 0, 1).err()),
            ("phases", Upscaler::jitter(api, 0, 0).err()),
        ] {
            assert_eq!(refused.expect(field).offending_field(), Some(field));
        }
        assert_eq!(double.violations(), [""; 0]);
        // The library rejects an unknown mode.
        assert!(Upscaler::render_size(api, shown, QualityMode(9)).is_err());
    }
}

#[test]
fn an_upscaler_is_used_through_the_loader() {
    in_new_process("an_upscaler_is_used_through_the_loader", || {
        let double = DoubleFolder::empty()
            .with(LibraryKind::Loader, &["loader"])
            .with(LibraryKind::FrameGeneration, &["sdk 2.1", double_folder::ML])
            .with(LibraryKind::Upscaler, &["sdk 2.1", "effect 0x10000", NEWEST]);
        let library = double.load().expect("loaded");
        assert_eq!(library.serves(Effect::Upscaling), Some(LibraryKind::Loader));
        let scene = Scene::new();
        let mut upscaler = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
        assert_eq!(upscaler.provider().version.family(), Some(Family::Ml));
        assert!(off(&scene.pair(&mut upscaler, &FrameInput::plain()), moved(8.0)) < 1.0);
        drop(upscaler);
        assert_eq!(double.violations(), [""; 0]);
        let without = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", double_folder::ML]);
        let missing = made(&scene.gpu, &without.load().expect("loaded"), UpscaleCreateFlags::empty());
        assert_eq!(missing.expect_err("it is not there").kind(), ErrorKind::RuntimeMissing);
    });
}

#[test]
fn invalid_inputs_are_refused_with_the_field_s_name() {
    let (double, library) = set_up_double(&["sdk 2.1", NEWEST]);
    let scene = Scene::new();
    let mut upscaler = made(&scene.gpu, &library, UpscaleCreateFlags::empty()).expect("an upscaler");
    let large = Dimensions { width: 129, height: 96 };
    for (field, input) in [
        ("render_size", FrameInput::with(|params| params.render_size = Dimensions::default())),
        ("shown", FrameInput::with(|params| params.shown = large)),
        ("shown", FrameInput::with(|params| params.shown = Dimensions { width: 32, height: 96 })),
        ("output", FrameInput::with(|params| params.shown = Dimensions { width: 100, height: 90 })),
        ("motion", FrameInput { shown_motion: true, ..FrameInput::plain() }),
        ("jitter", FrameInput::with(|params| params.jitter.x = f32::NAN)),
        ("motion_scale", FrameInput::with(|params| params.motion_scale.y = f32::INFINITY)),
        ("sharpness", FrameInput::with(|params| params.sharpness = Some(1.5))),
        ("frame_time", FrameInput::with(|params| params.frame_time = 0.0)),
        ("pre_exposure", FrameInput::with(|params| params.pre_exposure = -1.0)),
        ("encoding", FrameInput::with(|params| params.encoding = UpscaleFlags::COLOR_SRGB)),
        ("encoding", FrameInput::with(|params| params.encoding = UpscaleFlags::DEBUG_VIEW)),
        ("camera.fov", FrameInput::with(|params| params.camera = Camera { fov: 4.0, ..Camera::default() })),
    ] {
        let refused = scene.upscale(&mut upscaler, &input).expect_err(field);
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
    }
    assert!(off(&scene.pair(&mut upscaler, &FrameInput::plain()), moved(8.0)) < 1.0, "it is as it was");
    assert_eq!(double.violations(), [""; 0]);
}
