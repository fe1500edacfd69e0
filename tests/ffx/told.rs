//! Parameters that do not change the double's pictures, and handling of the provider's errors.

use std::collections::BTreeMap;

use cairn::ffx::Camera;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::D3D12_COMMAND_LIST_TYPE_COMPUTE;

use super::*;

/// The last logged struct of each of these ids.
fn last(stage: &Stage, ids: &[u64]) -> BTreeMap<String, String> {
    ids.iter().flat_map(|id| stage.told(*id).pop().unwrap_or_default()).collect()
}

#[test]
fn time_and_camera_reach_the_provider_of_each_release() {
    for (release, ids) in [(["sdk 2.0", ANALYTIC_20], &[0x2_0004, 0x2_000a][..]), (["sdk 2.1", ML], &[0x2_000c])] {
        let stage = Stage::empty().with(Part::FrameGeneration, &release);
        let (gpu, library) = (gpu(), stage.load().expect("loaded"));
        let mut generator = made(&gpu, &library, &options()).expect("a generator");
        let textures = panning(&gpu);
        textures.fill(&textures.color, moved(0));
        let mut told = |shot: &FrameParams| {
            generator.generate(&of(&textures), shot).expect("generated").wait().expect("it has run");
            last(&stage, ids)
        };
        let plain = FrameParams::of(SIZE);
        let before = told(&plain);
        assert_eq!(told(&plain), before, "it is told the same each time");
        let seen = |camera: Camera| FrameParams { camera, ..plain };
        let camera = Camera::default();
        let options: [(FrameParams, &[(&str, &str)]); 9] = [
            (FrameParams { frame_time: 33.5, ..plain }, &[("time", "33.5")]),
            (FrameParams { jitter: Coordinates { x: 0.25, y: -0.5 }, ..plain }, &[("jitter", "0.25,-0.5")]),
            (seen(Camera { near: 0.25, ..camera }), &[("near", "0.25")]),
            (seen(Camera { far: 250.0, ..camera }), &[("far", "250")]),
            (seen(Camera { fov: 0.75, ..camera }), &[("fov", "0.75")]),
            (seen(Camera { metres: 0.5, ..camera }), &[("metres", "0.5")]),
            (seen(Camera { position: [1.0, 2.0, -3.0], ..camera }), &[("position", "1,2,-3")]),
            (
                seen(Camera { up: [0.0, 0.0, 1.0], forward: [0.0, -1.0, 0.0], ..camera }),
                &[("forward", "0,-1,0"), ("up", "0,0,1")],
            ),
            (
                seen(Camera { right: [0.0, 0.0, 1.0], forward: [1.0, 0.0, 0.0], ..camera }),
                &[("forward", "1,0,0"), ("right", "0,0,1")],
            ),
        ];
        for (shot, expected) in options {
            let mut wanted = before.clone();
            wanted.extend(expected.iter().map(|(field, value)| ((*field).to_owned(), (*value).to_owned())));
            assert_eq!(told(&shot), wanted, "{release:?}: {expected:?}, and nothing else");
            assert!(wanted != before, "{expected:?}");
        }
        assert_eq!(stage.judgement(), [""; 0]);
    }
}

#[test]
fn how_a_generator_is_made_reaches_the_provider() {
    let (stage, library) = playing(&[]);
    let engine = engine::engine();
    let on = |queue| Gpu::of_engine(&engine.device, queue, None).expect("a device");
    let [direct, compute] = [on(&engine.direct), on(&engine.compute)];
    let flags = |gpu: &Gpu, flags| {
        let mut options = options();
        options.head.flags = flags;
        drop(made(gpu, &library, &options).expect("a generator"));
        last(&stage, &[0x2_0001])["flags"].clone()
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
    let told = last(&stage, &[0x2_0001]);
    assert_eq!(["shown", "render", "format"].map(|field| &*told[field]), ["320,200", "160,100", "4"]);
    let options = TextureOptions { hudless: Some(SurfaceFormat::R11G11B10_FLOAT), ..options };
    let refused = made(&direct, &library, &options).expect_err("of another precision");
    assert_eq!(refused.offending_field(), Some("format"));
    let options = TextureOptions { hudless: Some(format), ..options };
    drop(made(&direct, &library, &options).expect("a generator"));
    assert_eq!(last(&stage, &[0x2_0009])["hudless"], "4");

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
        assert_eq!(last(&stage, &[0x2_0002])["async"], u32::from(is_compute).to_string());
        assert_eq!(last(&stage, &[0x2_000c])["far"], "inf");
    }
    assert_eq!(stage.judgement(), [""; 0]);
}

/// Every return code at every call of a frame gives an error with call, field and parameters; nothing is submitted, and the next
/// frame has no history.
#[test]
fn every_code_at_every_call_of_a_frame_is_reported_and_the_next_frame_is_made() {
    for (release, prepare) in
        [(["sdk 2.0", ANALYTIC_20, "refusing"], 0x2_0004), (["sdk 2.1", ML, "refusing"], 0x2_000c)]
    {
        let stage = Stage::empty().with(Part::FrameGeneration, &release);
        let (gpu, library) = (gpu(), stage.load().expect("loaded"));
        let mut generator = made(&gpu, &library, &options()).expect("a generator");
        let textures = panning(&gpu);
        pair(&mut generator, &textures, &of(&textures), &FrameParams::of(SIZE));
        for (id, call, suspects) in [
            (0x2_0002, "ffxConfigure", ["flags", "device"]),
            (prepare, "ffxDispatch", ["depth", "command_list"]),
            (0x2_0003, "ffxDispatch", ["color", "command_list"]),
        ] {
            for code in (1..=8).chain([u32::MAX]) {
                stage.refuse(id, code);
                let failed = generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect_err("it fails");
                stage.answer();
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
        assert_eq!(stage.judgement(), [""; 0]);
        // Errors while the context is created.
        for id in [0x2_0001, 4] {
            stage.refuse(id, 3);
            let failed = made(&gpu, &library, &options()).expect_err("it fails");
            assert_eq!(failed.offending_field(), Some("device"), "{failed}");
            stage.answer();
        }
        assert!(made(&gpu, &library, &options()).is_ok());
    }
}
