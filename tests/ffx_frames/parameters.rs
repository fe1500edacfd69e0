//! Parameters that do not change the double's pictures reach the provider, and its errors are reported.

use std::collections::BTreeMap;

use cairn::ffx::Camera;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::D3D12_COMMAND_LIST_TYPE_COMPUTE;

use super::*;

/// The last logged struct of each of these ids.
fn last(double: &DoubleFolder, ids: &[u64]) -> BTreeMap<String, String> {
    ids.iter().flat_map(|id| double.parameters(*id).pop().unwrap_or_default()).collect()
}

#[test]
fn time_and_camera_reach_the_provider_of_each_release() {
    for (release, ids) in [(["sdk 2.0", ANALYTIC_20], &[0x2_0004, 0x2_000a][..]), (["sdk 2.1", ML], &[0x2_000c])] {
        let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &release);
        let (gpu, library) = (gpu(), double.load().expect("loaded"));
        let mut generator = made(&gpu, &library, &options()).expect("a generator");
        let textures = panning(&gpu);
        textures.fill(&textures.color, moved(0));
        let mut logged = |params: &FrameParams| {
            generator.generate(&of(&textures), params).expect("generated").wait().expect("it has run");
            last(&double, ids)
        };
        let plain = FrameParams::of(SIZE);
        let before = logged(&plain);
        assert_eq!(logged(&plain), before, "it is told the same each time");
        let with_camera = |camera: Camera| FrameParams { camera, ..plain };
        let camera = Camera::default();
        let options: [(FrameParams, &[(&str, &str)]); 9] = [
            (FrameParams { frame_time: 33.5, ..plain }, &[("time", "33.5")]),
            (FrameParams { jitter: Coordinates { x: 0.25, y: -0.5 }, ..plain }, &[("jitter", "0.25,-0.5")]),
            (with_camera(Camera { near: 0.25, ..camera }), &[("near", "0.25")]),
            (with_camera(Camera { far: 250.0, ..camera }), &[("far", "250")]),
            (with_camera(Camera { fov: 0.75, ..camera }), &[("fov", "0.75")]),
            (with_camera(Camera { metres: 0.5, ..camera }), &[("metres", "0.5")]),
            (with_camera(Camera { position: [1.0, 2.0, -3.0], ..camera }), &[("position", "1,2,-3")]),
            (
                with_camera(Camera { up: [0.0, 0.0, 1.0], forward: [0.0, -1.0, 0.0], ..camera }),
                &[("forward", "0,-1,0"), ("up", "0,0,1")],
            ),
            (
                with_camera(Camera { right: [0.0, 0.0, 1.0], forward: [1.0, 0.0, 0.0], ..camera }),
                &[("forward", "1,0,0"), ("right", "0,0,1")],
            ),
        ];
        for (params, expected) in options {
            let mut wanted = before.clone();
            wanted.extend(expected.iter().map(|(field, value)| ((*field).to_owned(), (*value).to_owned())));
            assert_eq!(logged(&params), wanted, "{release:?}: {expected:?}, and nothing else");
            assert!(wanted != before, "{expected:?}");
        }
        assert_eq!(double.violations(), [""; 0]);
    }
}

#[test]
fn creation_parameters_reach_the_provider() {
    let (double, library) = set_up_double(&[]);
    let engine = Engine::create();
    let on = |queue| Gpu::of_engine(&engine.device, queue, None).expect("a device");
    let [direct, compute] = [on(&engine.direct), on(&engine.compute)];
    let flags = |gpu: &Gpu, flags| {
        let mut options = options();
        options.head.flags = flags;
        drop(made(gpu, &library, &options).expect("a generator"));
        last(&double, &[0x2_0001])["flags"].clone()
    };
    for flag in [
        CreateFlags::empty(),
        CreateFlags::DISPLAY_RESOLUTION_MOTION,
        CreateFlags::MOTION_JITTER,
        CreateFlags::DEPTH_INVERTED,
        CreateFlags::DEPTH_INFINITE,
        CreateFlags::HIGH_DYNAMIC_RANGE,
        CreateFlags::DEBUG_CHECKING,
    ] {
        assert_eq!(flags(&direct, flag), flag.bits().to_string());
        // Only the queue's type decides whether generation is asynchronous.
        let on_compute = flag | CreateFlags::ASYNC_WORKLOAD;
        assert_eq!(flags(&compute, flag), on_compute.bits().to_string());
        assert_eq!(flags(&direct, on_compute), flag.bits().to_string());
    }
    // Render size, display size and formats.
    let (large, small) = (Dimensions { width: 320, height: 200 }, Dimensions { width: 160, height: 100 });
    let format = SurfaceFormat::R16G16B16A16_FLOAT;
    let options = TextureOptions { self_test: false, ..TextureOptions::new(large, small, format) };
    drop(made(&direct, &library, &options).expect("a generator"));
    let logged = last(&double, &[0x2_0001]);
    assert_eq!(["shown", "render", "format"].map(|field| &*logged[field]), ["320,200", "160,100", "4"]);
    let options = TextureOptions { hudless: Some(SurfaceFormat::R11G11B10_FLOAT), ..options };
    let refused = made(&direct, &library, &options).expect_err("of another precision");
    assert_eq!(refused.offending_field(), Some("format"));
    let options = TextureOptions { hudless: Some(format), ..options };
    drop(made(&direct, &library, &options).expect("a generator"));
    assert_eq!(last(&double, &[0x2_0009])["hudless"], "4");

    // The configure call repeats it for each frame. With infinite depth the far plane may be infinite.
    for gpu in [&direct, &compute] {
        let mut options = self::options();
        options.head.flags = CreateFlags::DEPTH_INFINITE;
        let mut generator = made(gpu, &library, &options).expect("a generator");
        let textures = panning(gpu);
        let camera = Camera { far: f32::INFINITY, ..Camera::default() };
        let found = pair(&mut generator, &textures, &of(&textures), &FrameParams { camera, ..FrameParams::of(SIZE) });
        assert!(off(&found, INNER, moved(HALF)) <= 2);
        let is_compute = gpu.frames().kind() == D3D12_COMMAND_LIST_TYPE_COMPUTE;
        assert_eq!(last(&double, &[0x2_0002])["async"], u32::from(is_compute).to_string());
        assert_eq!(
            last(&double, &[0x2_000c])["far"],
            f32::MAX.to_string(),
            "AMD's providers take the lesser plane for the near one"
        );
    }
    assert_eq!(double.violations(), [""; 0]);
}

/// Every return code at every call of a frame gives an error with call, field and parameters; nothing is submitted, and the next
/// frame has no history.
#[test]
fn every_error_of_a_frame_is_reported_and_the_next_frame_is_generated() {
    for (release, prepare) in
        [(["sdk 2.0", ANALYTIC_20, "refusing"], 0x2_0004), (["sdk 2.1", ML, "refusing"], 0x2_000c)]
    {
        let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &release);
        let (gpu, library) = (gpu(), double.load().expect("loaded"));
        let mut generator = made(&gpu, &library, &options()).expect("a generator");
        let textures = panning(&gpu);
        pair(&mut generator, &textures, &of(&textures), &FrameParams::of(SIZE));
        for (id, call, suspects) in [
            (0x2_0002, "ffxConfigure", ["flags", "device"]),
            (prepare, "ffxDispatch", ["depth", "command_list"]),
            (0x2_0003, "ffxDispatch", ["color", "command_list"]),
        ] {
            for code in (1..=8).chain([u32::MAX]) {
                double.reject_calls(id, code);
                let failed = generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect_err("it fails");
                double.accept_calls();
                let suspect = match code {
                    2 | 4 | 7 => "provider",
                    5 => "device",
                    6 => suspects[0],
                    _ => suspects[1],
                };
                assert_eq!(failed.offending_field(), Some(suspect), "{failed}");
                for part in [&*format!("{call} answered {code} "), "frame_id: ", "the library says: so there"] {
                    assert!(failed.cause().contains(part), "{part}: {failed}");
                }
                generator
                    .generate(&of(&textures), &FrameParams::of(SIZE))
                    .expect("generated")
                    .wait()
                    .expect("it has run");
                assert_eq!(off(&textures.generated(), INNER, moved(STEP)), 0, "{id:x} {code}: there is none before it");
            }
        }
        assert!(gpu.removed().is_none());
        assert_eq!(double.violations(), [""; 0]);
        // Errors while the context is created.
        for id in [0x2_0001, 4] {
            double.reject_calls(id, 3);
            let failed = made(&gpu, &library, &options()).expect_err("it fails");
            assert_eq!(failed.offending_field(), Some("device"), "{failed}");
            double.accept_calls();
        }
        assert!(made(&gpu, &library, &options()).is_ok());
    }
}
