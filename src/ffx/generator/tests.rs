//! Frame generation with a fake library: which inputs are rejected, and what each call receives.

use super::super::bindings::*;
use super::super::fake_library::{ANALYTIC_20, FAKE, FakeLibrary, ML, api, count, head};
use super::*;

const SIZE: Dimensions = Dimensions { width: 640, height: 360 };

fn picture(address: usize, format: SurfaceFormat) -> Resource {
    let description = ResourceDescription {
        kind: ResourceType::TEXTURE_2D,
        format,
        width: SIZE.width,
        height: SIZE.height,
        depth: 1,
        mips: 1,
        ..Default::default()
    };
    Resource { resource: address as *mut c_void, description, state: ResourceState::UNORDERED_ACCESS }
}

fn frame() -> Frame {
    Frame {
        command_list: 0x10 as *mut c_void,
        color: picture(0x100, SurfaceFormat::R8G8B8A8_UNORM),
        output: picture(0x200, SurfaceFormat::R8G8B8A8_UNORM),
        depth: picture(0x300, SurfaceFormat::R32_FLOAT),
        motion: picture(0x400, SurfaceFormat::R16G16_FLOAT),
        hudless: Resource::default(),
        distortion: Resource::default(),
        params: FrameParams::of(SIZE),
    }
}

/// A frame with changed parameters.
fn frame_with(change: impl FnOnce(&mut FrameParams)) -> Frame {
    let mut frame = frame();
    change(&mut frame.params);
    frame
}

fn generator(runs: (u64, &'static std::ffi::CStr)) -> Generator {
    made(runs, head(), None)
}

fn made(
    runs: (u64, &'static std::ffi::CStr),
    head: CreateFrameGeneration,
    hudless: Option<SurfaceFormat>,
) -> Generator {
    FAKE.set(FakeLibrary { providers: vec![runs], running_provider: Some(runs), ..FakeLibrary::default() });
    // SAFETY: the fake library uses no device.
    let made = unsafe { Generator::create(&api(), 0x1000 as *mut c_void, Choice::Any, head, hudless) };
    FAKE.with_borrow_mut(|fake| fake.calls.clear());
    made.expect("a generator")
}

fn record(generator: &mut Generator, frame: &Frame) -> Result<()> {
    // SAFETY: the fake library reads ids only.
    unsafe { generator.record(frame) }
}

/// Frame id and reset flag of the last generation call.
fn last_generation(generator: &Generator) -> (u64, bool) {
    let head = generator.dispatch.head();
    assert_eq!(generator.settings.head().frame_id, head.frame_id, "one id in all calls");
    let (prepared, reset) = match &generator.prepare {
        Prepare::Separate(chain) => (chain.head().frame_id, head.reset),
        Prepare::Combined(chain) => (chain.head().frame_id, chain.head().reset),
    };
    assert_eq!((prepared, reset), (head.frame_id, head.reset));
    (head.frame_id, head.reset)
}

#[test]
fn each_release_gets_its_structs_in_its_order() {
    for (runs, prepare) in [(ANALYTIC_20, vec![0x2_0004, 0x2_000a]), (ML, vec![0x2_000c])] {
        let mut generator = generator(runs);
        record(&mut generator, &frame()).expect("recorded");
        let calls = FAKE.with_borrow(|fake| fake.calls.clone());
        let expected = [("configure", vec![0x2_0002], 0), ("dispatch", prepare, 0), ("dispatch", vec![0x2_0003], 0)];
        assert_eq!(calls, expected);
        let settings = generator.settings.head();
        assert!(settings.enabled && settings.swapchain.is_null() && settings.generate.is_none());
        assert_eq!(settings.flags, FrameFlags::NO_SWAPCHAIN);
    }
}

#[test]
fn lens_distortion_can_be_turned_off() {
    let mut generator = generator(ML);
    let with = Frame { distortion: picture(0x600, SurfaceFormat::R16G16_FLOAT), ..frame() };
    for frame in [frame(), with, with, frame(), with] {
        record(&mut generator, &frame).expect("recorded");
    }
    let calls = FAKE.with_borrow(|fake| fake.calls.clone());
    let has_field = calls.iter().filter(|(call, ..)| *call == "configure").map(|(_, ids, _)| ids.contains(&0x2_0008));
    assert_eq!(has_field.collect::<Vec<_>>(), [false, true, true, false, true]);
}

#[test]
fn providers_that_ignore_the_format_of_hud_less_frames_are_refused_with_another() {
    let (same, other) = (head().back_buffer_format, SurfaceFormat::B8G8R8A8_UNORM);
    for (name, hudless, is_refused) in [
        (c"1.1.0", Some(other), true),
        (c"1.1.1", Some(other), true),
        (c"1.1.1", Some(same), false),
        (c"1.1.1", None, false),
        (c"1.1.2", Some(other), false),
        (c"3.1.5", Some(other), false),
    ] {
        // These releases do not report a context's provider.
        FAKE.set(FakeLibrary { providers: vec![(7, name)], ..FakeLibrary::default() });
        // SAFETY: the fake library uses no device.
        let made = unsafe { Generator::create(&api(), 0x1000 as *mut c_void, Choice::Any, head(), hudless) };
        let refused = made.err().map(|refused| (refused.kind(), refused.offending_field().map(str::to_owned)));
        let wanted = is_refused.then(|| (ErrorKind::Unsupported, Some("hudless".to_owned())));
        assert_eq!(refused, wanted, "{name:?}, {hudless:?}");
        assert_eq!(count("destroy"), 1, "its context is not kept");
    }
}

#[test]
fn ids_go_up_by_one_and_history_is_dropped_at_the_start_at_cuts_and_after_a_failure() {
    for runs in [ANALYTIC_20, ML] {
        let mut generator = generator(runs);
        let ask = |generator: &mut Generator, reset| {
            record(generator, &frame_with(|params| params.reset = reset)).map(|()| last_generation(generator))
        };
        assert_eq!(ask(&mut generator, false).expect("recorded"), (1, true));
        assert_eq!(ask(&mut generator, false).expect("recorded"), (2, false));
        assert_eq!(ask(&mut generator, true).expect("recorded"), (3, true));
        assert_eq!(ask(&mut generator, false).expect("recorded"), (4, false));
        // An input rejected before any call does not change the history.
        assert!(record(&mut generator, &frame_with(|params| params.frame_time = 0.0)).is_err());
        assert_eq!(ask(&mut generator, false).expect("recorded"), (5, false));
        FAKE.with_borrow_mut(|fake| fake.rejects = vec![(StructId::FRAME_GENERATION_DISPATCH, ReturnCode(3))]);
        assert_eq!(ask(&mut generator, false).expect_err("it fails").kind(), ErrorKind::Device);
        FAKE.with_borrow_mut(|fake| fake.rejects.clear());
        assert!(ask(&mut generator, false).expect("recorded").1, "what the library has of it nobody knows");
        assert!(!ask(&mut generator, false).expect("recorded").1);
    }
}

#[test]
fn every_error_of_a_frame_names_the_call_and_drops_the_history() {
    for (runs, prepare) in
        [(ANALYTIC_20, StructId::FRAME_GENERATION_PREPARE), (ML, StructId::FRAME_GENERATION_PREPARE_V2)]
    {
        let mut generator = generator(runs);
        record(&mut generator, &frame()).expect("recorded");
        for (call, id) in [
            ("ffxConfigure", StructId::FRAME_GENERATION_CONFIGURE),
            ("ffxDispatch", prepare),
            ("ffxDispatch", StructId::FRAME_GENERATION_DISPATCH),
        ] {
            for code in (1..=8).chain([u32::MAX]) {
                record(&mut generator, &frame()).expect("recorded");
                FAKE.with_borrow_mut(|fake| fake.rejects = vec![(id, ReturnCode(code))]);
                let failed = record(&mut generator, &frame()).expect_err("it fails");
                assert!(failed.cause().starts_with(&format!("{call} answered {code} ")), "{failed}");
                assert!(failed.cause().contains("frame_id") && failed.offending_field().is_some(), "{failed}");
                FAKE.with_borrow_mut(|fake| fake.rejects.clear());
                record(&mut generator, &frame()).expect("recorded");
                assert!(last_generation(&generator).1, "{call} {code}");
            }
        }
    }
}

/// The parameters of a frame decide which field is suspected.
#[test]
fn textures_in_the_settings_are_suspected_first() {
    for (frame, field) in [
        (frame(), "flags"),
        (Frame { distortion: picture(0x600, SurfaceFormat::R16G16_FLOAT), ..frame() }, "distortion"),
        (Frame { hudless: picture(0x500, SurfaceFormat::R8G8B8A8_UNORM), ..frame() }, "hudless"),
    ] {
        let mut generator = generator(ML);
        FAKE.with_borrow_mut(|fake| {
            fake.rejects = vec![(StructId::FRAME_GENERATION_CONFIGURE, ReturnCode::PARAMETER)];
        });
        let failed = record(&mut generator, &frame).expect_err("it fails");
        assert_eq!(failed.offending_field(), Some(field), "{failed}");
    }
}

#[test]
fn everything_of_a_frame_reaches_the_library() {
    let camera = Camera {
        position: [1.0, 2.0, 3.0],
        up: [0.0, 0.0, 1.0],
        right: [0.0, 1.0, 0.0],
        forward: [1.0, 0.0, 0.0],
        near: 0.5,
        far: 50.0,
        fov: 0.75,
        metres: 2.0,
    };
    let frame = Frame {
        hudless: picture(0x500, SurfaceFormat::B8G8R8A8_UNORM),
        distortion: picture(0x600, SurfaceFormat::R16G16_FLOAT),
        params: FrameParams {
            camera,
            jitter: Coordinates { x: 0.25, y: -0.25 },
            motion_scale: Coordinates { x: 640.0, y: -360.0 },
            rect: Rect { left: 10, top: 20, width: 620, height: 320 },
            transfer: TransferFunction::PQ,
            luminance: [0.25, 800.0],
            ..FrameParams::of(SIZE)
        },
        ..frame()
    };
    let params = frame.params;
    let shared = format!(
        "{:?} {:?} {:?} {:?} {:?}",
        params.jitter, params.motion_scale, params.frame_time, frame.depth.resource, frame.motion.resource
    );
    for runs in [ANALYTIC_20, ML] {
        let flags = CreateFlags::HIGH_DYNAMIC_RANGE | CreateFlags::ASYNC_WORKLOAD;
        let hudless = Some(SurfaceFormat::B8G8R8A8_UNORM);
        let mut generator = made(runs, CreateFrameGeneration { flags, ..head() }, hudless);
        record(&mut generator, &frame).expect("recorded");
        let (settings, picture) = (generator.settings.head(), generator.dispatch.head());
        assert_eq!(settings.hudless.resource, frame.hudless.resource);
        assert!(settings.allow_async);
        let link = generator.settings.link::<ConfigureDistortion>().expect("a distortion");
        assert_eq!(link.field.resource, frame.distortion.resource);
        assert_eq!((settings.rect.left, picture.rect.height), (10, 320));
        assert_eq!((picture.transfer, picture.luminance, picture.frames), (params.transfer, params.luminance, 1));
        assert_eq!(
            [picture.present_color.resource, picture.outputs[0].resource],
            [frame.color.resource, frame.output.resource]
        );
        let (sent, camera_sent) = match &generator.prepare {
            Prepare::Separate(chain) => {
                let (a, b) = (chain.head(), chain.link::<DispatchCamera>().expect("a camera"));
                let sent = format!(
                    "{:?} {:?} {:?} {:?} {:?}",
                    a.jitter, a.motion_scale, a.frame_time, a.depth.resource, a.motion.resource
                );
                let &DispatchCamera { position, up, right, forward, .. } = b;
                let (near, far, fov, metres) = (a.camera_near, a.camera_far, a.camera_fov, a.metres);
                (sent, Camera { position, up, right, forward, near, far, fov, metres })
            }
            Prepare::Combined(chain) => {
                let a = chain.head();
                let sent = format!(
                    "{:?} {:?} {:?} {:?} {:?}",
                    a.jitter, a.motion_scale, a.frame_time, a.depth.resource, a.motion.resource
                );
                let (position, up, right, forward) = (a.camera_position, a.camera_up, a.camera_right, a.camera_forward);
                let (near, far, fov, metres) = (a.camera_near, a.camera_far, a.camera_fov, a.metres);
                (sent, Camera { position, up, right, forward, near, far, fov, metres })
            }
        };
        assert_eq!((sent, camera_sent), (shared.clone(), camera));
    }
}

#[test]
fn invalid_inputs_are_refused_before_any_call() {
    type Spoil = fn(&mut Frame);
    let spoils: &[(Spoil, &str)] = &[
        (|f| f.command_list = std::ptr::null_mut(), "command_list"),
        (|f| f.params.render_size.width = 0, "render_size"),
        (|f| f.params.render_size.width = 641, "render_size"),
        (|f| f.color.resource = std::ptr::null_mut(), "color"),
        (|f| f.color.description.format = SurfaceFormat::B8G8R8A8_UNORM, "color"),
        (|f| f.color.description.height = 359, "color"),
        (|f| f.color.state = ResourceState(3), "color"),
        (|f| f.output.resource = std::ptr::null_mut(), "output"),
        (|f| f.output.resource = f.color.resource, "output"),
        (|f| f.output.description.format = SurfaceFormat::R16G16B16A16_FLOAT, "output"),
        (|f| f.output.description.width = 1280, "output"),
        (|f| f.depth.resource = std::ptr::null_mut(), "depth"),
        (|f| f.depth.description.kind = ResourceType::TEXTURE_3D, "depth"),
        (|f| f.depth.description.format = SurfaceFormat::UNKNOWN, "depth"),
        (|f| f.depth.description.depth = 6, "depth"),
        (|f| f.motion.resource = std::ptr::null_mut(), "motion"),
        (|f| f.motion.description.width = 320, "motion"),
        (|f| f.motion.state = ResourceState(0), "motion"),
        (|f| f.hudless = Resource { state: ResourceState(3), ..f.color }, "hudless"),
        (|f| f.hudless = picture(0x500, SurfaceFormat::B8G8R8A8_UNORM), "hudless"),
        (|f| f.distortion = Resource { state: ResourceState(3), ..f.motion }, "distortion"),
        (|f| f.params.jitter.x = f32::NAN, "jitter"),
        (|f| f.params.motion_scale.y = f32::INFINITY, "motion_scale"),
        (|f| f.params.luminance[1] = f32::NAN, "luminance"),
        (|f| f.params.transfer = TransferFunction::PQ, "transfer"),
        (|f| f.params.transfer = TransferFunction(3), "transfer"),
        (|f| f.params.frame_time = 0.0, "frame_time"),
        (|f| f.params.frame_time = f32::NAN, "frame_time"),
        (|f| f.params.frame_time = f32::INFINITY, "frame_time"),
        (|f| f.params.rect.left = -1, "rect"),
        (|f| f.params.rect.width = 10, "rect"),
        (|f| f.params.rect = Rect { left: i32::MAX, top: 0, width: i32::MAX, height: 1 }, "rect"),
        (|f| f.params.rect = Rect { left: 1, top: 0, width: 640, height: 360 }, "rect"),
        (|f| f.params.camera.position[2] = f32::NAN, "camera.position"),
        (|f| f.params.camera.up = [0.0; 3], "camera.up"),
        (|f| f.params.camera.right = [2.0, 0.0, 0.0], "camera.right"),
        (|f| f.params.camera.forward[0] = f32::NAN, "camera.forward"),
        (|f| f.params.camera.near = 0.0, "camera.near"),
        (|f| f.params.camera.far = f.params.camera.near, "camera.far"),
        (|f| f.params.camera.far = f32::NAN, "camera.far"),
        (|f| f.params.camera.fov = std::f32::consts::PI, "camera.fov"),
        (|f| f.params.camera.fov = 0.0, "camera.fov"),
        (|f| f.params.camera.metres = 0.0, "camera.metres"),
    ];
    let mut generator = generator(ML);
    for (spoil, field) in spoils {
        let mut frame = frame();
        spoil(&mut frame);
        let refused = record(&mut generator, &frame).expect_err(field);
        assert_eq!(
            (refused.kind(), refused.offending_field()),
            (ErrorKind::InvalidArgument, Some(*field)),
            "{refused}"
        );
    }
    assert!(FAKE.with_borrow(|fake| fake.calls.is_empty()), "the library was not asked");
    record(&mut generator, &frame()).expect("a frame that was not spoilt");
}

/// What AMD's provider 3.1.5 computes from the planes in `setupDeviceDepthToViewSpaceDepthParams`, for depth that is not inverted.
#[test]
fn planes_are_such_that_amd_s_providers_can_compute_distances() {
    for near in [0.001, 0.01, 0.1, 1.0, 3.0, 1e30] {
        for far in [near * 1e-9, near * 0.5, near * 1.5, near * 1e3, near * 1e6, near * 1e7, near * 1e8, f32::MAX] {
            let camera = Camera { near, far, ..Camera::default() };
            let passed = camera.far_plane(false);
            let (least, largest) = (near.min(passed), near.max(passed));
            let quotient = largest / (least - largest);
            assert!(quotient < -1.0 && passed > 0.0, "{near} {far}: {passed}, {quotient}");
            assert!(passed == far || !(1e-6..=1e6).contains(&(far / near)), "{near} {far}: {passed}");
        }
        for far in [0.0, f32::NAN, f32::INFINITY, near / 2.0] {
            assert_eq!(near.min(Camera { near, far, ..Camera::default() }.far_plane(true)), near);
        }
    }
}

#[test]
fn frames_of_another_format_than_the_hud_less_ones_need_one() {
    let other = SurfaceFormat::R10G10B10A2_UNORM;
    let wrong = |frame: &Frame| fault(frame, &head(), other, false).map(|(field, _)| field);
    let without = Frame { hudless: Resource::default(), ..frame() };
    assert_eq!(wrong(&without), Some("hudless"));
    let mut with = frame();
    with.hudless = with.color;
    with.hudless.description.format = other;
    assert_eq!(wrong(&with), None);
}

#[test]
fn creation_flags_decide_which_inputs_are_valid() {
    let format = head().back_buffer_format;
    let wrong = |frame: &Frame, flags| {
        fault(frame, &CreateFrameGeneration { flags, ..head() }, format, false).map(|(field, _)| field)
    };
    let endless = frame_with(|params| params.camera.far = f32::INFINITY);
    assert_eq!(wrong(&endless, CreateFlags::empty()), Some("camera.far"));
    assert_eq!(wrong(&endless, CreateFlags::DEPTH_INFINITE), None);
    let half = Dimensions { width: 320, height: 180 };
    let mut small = frame_with(|params| params.render_size = half);
    (small.depth.description.width, small.depth.description.height) = (half.width, half.height);
    assert_eq!(wrong(&small, CreateFlags::empty()), Some("motion"));
    assert_eq!(wrong(&small, CreateFlags::DISPLAY_RESOLUTION_MOTION), None);
    let bright =
        |luminance| frame_with(|params| (params.transfer, params.luminance) = (TransferFunction::SCRGB, luminance));
    assert_eq!(wrong(&bright([0.0, 400.0]), CreateFlags::empty()), Some("transfer"));
    assert_eq!(wrong(&bright([0.0, 400.0]), CreateFlags::HIGH_DYNAMIC_RANGE), None);
    for luminance in [[400.0, 400.0], [-1.0, 400.0]] {
        assert_eq!(wrong(&bright(luminance), CreateFlags::HIGH_DYNAMIC_RANGE), Some("luminance"));
    }
    // For a presented frame, the swap chain knows the transfer function.
    let presented = fault(&bright([400.0, 0.0]), &head(), format, true);
    assert_eq!(presented, None);
}
