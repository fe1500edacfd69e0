//! Parameters of AMD's swap chain, and handling of its errors.

use cairn::ffx::{Choice, Family, swapchain_memory_needed};

use super::*;

pub(super) fn hudless_frames_rects_and_lens_distortion_change_generated_frames() {
    let _alone = one_at_a_time();
    let rest = D3D12_RESOURCE_STATE_COMMON;
    let size = (SIZE.width, SIZE.height);
    type Wanted = fn(i32, u32, u32) -> [u8; 4];
    let cases: [(bool, bool, Rect, Wanted); 3] = [
        (true, false, Rect::default(), |by, x, y| if in_sign(x, y) { SIGN } else { moved(by - STEP / 2)(x, y) }),
        (false, true, Rect::default(), |by, x, y| moved(by - STEP / 2 + 4)(x, y)),
        (false, false, Rect { left: 0, top: 16, width: 128, height: 64 }, |by, x, y| {
            let is_world = (16..80).contains(&y);
            moved(if is_world { by - STEP / 2 } else { by })(x, y)
        }),
    ];
    for (has_world, has_lens, rect, wanted) in cases {
        let (double, library) = set_up_double(&["sdk 2.1", ML]);
        let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
        let world = resources::writable_texture(&show.gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, rest);
        let lens = resources::writable_texture(&show.gpu, size, DXGI_FORMAT_R16G16_FLOAT, rest);
        let [x, y] = [-4.0 / SIZE.width as f32, 0.0].map(|v| half::f16::from_f32(v).to_le_bytes());
        show.textures.fill(&lens, |_, _| [x[0], x[1], y[0], y[1]]);
        let extra = ExtraInputs {
            hudless: has_world.then_some(&world),
            distortion: has_lens.then_some(&lens),
            rect,
            sign: has_world,
        };
        for number in 0..3_usize {
            show.frame_with(true, &extra).expect("presented");
            let by = STEP * i32::try_from(number).expect("few");
            let error = off(&pixels(&double, 2 * number + 1), |x, y| wanted(by, x, y));
            assert!(number == 0 || error <= 2, "{has_world}, {has_lens}, frame {number}: {error} off");
        }
        // The next frame has none of them.
        show.frame(true).expect("presented");
        let error = off(&pixels(&double, 7), moved(3 * STEP - STEP / 2));
        assert!(error <= 2, "{has_world}, {has_lens}: {error} off without them");
        show.swapchain.wait().expect("all are shown");
        drop(show);
        assert_eq!(double.violations(), [""; 0]);
    }
}

/// AMD's libraries keep bare pointers to them.
pub(super) fn pictures_are_held_until_the_next_present_has_read_them() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.0", ANALYTIC_20]);
    let mut show = WindowedEngine::new(How::New, &library).expect("a swap chain");
    let distortion = |gpu: &Gpu| panning(gpu, SIZE).motion;
    let (first, second) = (distortion(&show.gpu), distortion(&show.gpu));
    let hudless = [(); 2].map(|()| Textures::new(&show.gpu, SIZE).color);
    let counts = || [&first, &hudless[0]].map(|texture| reference_count(&texture.resource));
    let before = counts();
    let textures = panning(&show.gpu, SIZE);
    let mut present = |hudless: &TestResource, distortion: &TestResource| {
        let pictures = FrameTextures {
            depth: textures.depth.with_state(),
            motion: textures.motion.with_state(),
            hudless: Some(hudless.with_state()),
            distortion: Some(distortion.with_state()),
        };
        let WindowedEngine { swapchain, gpu, .. } = &mut show;
        run_list(gpu, |list| swapchain.prepare(list, &pictures, &FrameParams::of(SIZE)).expect("prepared"));
        // SAFETY: a live swap chain; its picture does not matter.
        unsafe { swapchain.dxgi().Present(0, DXGI_PRESENT(0)) }.ok().expect("presented");
    };
    present(&hudless[0], &first);
    let held = counts();
    assert!(held.iter().zip(before).all(|(held, before)| *held > before), "{held:?} {before:?}");
    // A frame later they may still be read.
    present(&hudless[1], &second);
    assert!(counts().iter().zip(before).all(|(held, before)| *held > before));
    (0..4).for_each(|_| present(&hudless[1], &second));
    drop(show);
    assert_eq!(counts(), before, "all are given back");
    assert_eq!(double.violations(), [""; 0]);
}

pub(super) fn creation_and_pacing_parameters_reach_the_library() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML, ANALYTIC]);
    let last = |id: u64| double.parameters(id).pop().unwrap_or_default();
    let small = Dimensions { width: 64, height: 48 };
    let mut wanted = SwapchainOptions::new(small);
    wanted.choice = Choice::Require(Family::Analytic);
    wanted.hudless = Some(SurfaceFormat::B8G8R8A8_UNORM);
    for flags in [CreateFlags::empty(), CreateFlags::ASYNC_WORKLOAD, CreateFlags::DISPLAY_RESOLUTION_MOTION] {
        wanted.flags = flags;
        let mut show = WindowedEngine::with(&wanted, How::ForWindow, &library).expect("a swap chain");
        assert_eq!(show.swapchain.provider().expect("a generator").version.name, "3.1.6");
        let logged = last(0x2_0001);
        let expected = [flags.bits().to_string(), "128,96".to_owned(), "64,48".to_owned()];
        assert_eq!(["flags", "shown", "render"].map(|field| logged[field].clone()), expected);
        assert_eq!(last(0x2_0009)["hudless"], "14");
        // Depth at render size; motion at render or display size.
        let depth = panning(&show.gpu, small);
        let of_motion = if flags == CreateFlags::DISPLAY_RESOLUTION_MOTION { SIZE } else { small };
        let motion = panning(&show.gpu, of_motion);
        let bytes = vec![0; 4 * (SIZE.width * SIZE.height) as usize];
        let hudless = upload_texture(&show.gpu, (SIZE.width, SIZE.height), DXGI_FORMAT_B8G8R8A8_UNORM, &bytes);
        let WindowedEngine { swapchain, gpu, .. } = &mut show;
        let pictures = FrameTextures {
            depth: depth.depth.with_state(),
            motion: motion.motion.with_state(),
            hudless: Some(hudless.with_state()),
            distortion: None,
        };
        let of_drawing = ResourceWithState { state: D3D12_RESOURCE_STATE_RENDER_TARGET, ..hudless.with_state() };
        let refused = [
            (None, true),
            // Only the compute queue does not know this state.
            (Some(of_drawing), flags == CreateFlags::ASYNC_WORKLOAD),
        ];
        for (hudless, _) in refused.into_iter().filter(|(_, is_refused)| *is_refused) {
            run_list(gpu, |list| {
                let spoilt = FrameTextures { hudless, ..pictures };
                let refused =
                    swapchain.prepare(list, &spoilt, &FrameParams::of(small)).expect_err("a HUD-less picture");
                assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("hudless")));
            });
        }
        run_list(gpu, |list| swapchain.prepare(list, &pictures, &FrameParams::of(small)).expect("prepared"));
        // SAFETY: a live swap chain; its picture does not matter.
        unsafe { swapchain.dxgi().Present(0, DXGI_PRESENT(0)) }.ok().expect("presented");
        let is_async = flags == CreateFlags::ASYNC_WORKLOAD;
        assert_eq!(last(0x2_0002)["async"], u32::from(is_async).to_string(), "{flags:?}");
        assert_eq!(swapchain.generated(), 1);
        for (pacing, logged) in [
            (Pacing::default(), "0.1,0.1,0,2,0"),
            (Pacing::LOOSE, "0.01,0.3,0,2,0"),
            (Pacing { hybrid_spin: Some(3), ..Pacing::LOOSE }, "0.01,0.3,1,3,0"),
            (Pacing { wait_on_fence: true, ..Pacing::default() }, "0.1,0.1,0,2,1"),
        ] {
            swapchain.set_pacing(&pacing).expect("told");
            assert_eq!(last(0x3_0008)["pacing"], logged);
        }
        let interface = Textures::new(gpu, SIZE);
        for (premultiplied, copied, logged) in [(false, false, "0"), (true, false, "1"), (false, true, "2")] {
            let picture = interface.color.with_state();
            swapchain.set_interface(Some(Interface { picture, premultiplied, copied })).expect("told");
            assert_eq!(last(0x3_0002)["flags"], logged);
        }
        drop(show);
    }
    assert_eq!(double.violations(), [""; 0]);
    // Without the self-test a provider that fails it is accepted.
    let (_, library) = set_up_double(&["sdk 2.1", ML, "plays through"]);
    let untested = SwapchainOptions { self_test: false, ..options() };
    assert!(WindowedEngine::new(How::New, &library).is_err());
    assert!(WindowedEngine::with(&untested, How::New, &library).is_ok());
}

pub(super) fn every_code_at_every_call_is_reported_and_the_next_call_succeeds() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML, "refusing"]);
    type Call = fn(&mut WindowedEngine, &Textures) -> cairn::Result<()>;
    let calls: [(u64, &str, Call, [&str; 2]); 6] = [
        (0x2_0002, "ffxConfigure", |show, _| show.frame(true), ["swapchain"; 2]),
        (0x2_000c, "ffxDispatch", |show, _| show.frame(true), ["depth", "command_list"]),
        (0x3_0007, "ffxDispatch", |show, _| show.swapchain.wait(), ["provider", "device"]),
        (0x3_0008, "ffxConfigure", |show, _| show.swapchain.set_pacing(&Pacing::LOOSE), ["key", "device"]),
        (0x3_0009, "ffxQuery", |show, _| show.swapchain.memory().map(drop), ["provider", "device"]),
        (
            0x3_0002,
            "ffxConfigure",
            |show, interface| {
                let picture = interface.color.with_state();
                show.swapchain.set_interface(Some(Interface { picture, premultiplied: false, copied: true }))
            },
            ["interface"; 2],
        ),
    ];
    let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
    let interface = Textures::new(&show.gpu, SIZE);
    show.frame(true).expect("presented");
    for (id, call, act, [of_value, of_work]) in calls {
        for code in (1..=8).chain([u32::MAX]) {
            double.reject_calls(id, code);
            let answer = act(&mut show, &interface);
            double.accept_calls();
            // An unknown memory query is not an error.
            if id == 0x3_0009 && [1, 2, 6, 7].contains(&code) {
                answer.expect("an answer");
                continue;
            }
            let failed = answer.expect_err("it fails");
            let suspect = match code {
                2 | 4 | 7 => "provider",
                5 => "device",
                6 => of_value,
                _ => of_work,
            };
            assert_eq!(failed.offending_field(), Some(suspect), "{failed}");
            assert!(failed.cause().starts_with(&format!("{call} answered {code} ")), "{failed}");
            act(&mut show, &interface).expect("the next one");
        }
    }
    // Errors within `Present`.
    for code in [1, 3, 6] {
        double.reject_calls(0x2_0003, code);
        show.frame(true).expect("presented");
        double.accept_calls();
        assert_eq!(show.swapchain.failed(), Some(ReturnCode(code)));
        show.frame(true).expect("presented");
    }
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
    // Errors of creation; another swap chain can be created for the window afterwards.
    for (how, id, suspects) in
        [(How::New, 0x3_0005, ["description", "window"]), (How::ForWindow, 0x3_0006, ["description", "window"])]
    {
        for (code, suspect) in [(6, suspects[0]), (3, suspects[1]), (4, "device"), (2, "provider")] {
            double.reject_calls(id, code);
            let failed = WindowedEngine::new(how, &library).err().expect("it fails");
            double.accept_calls();
            assert_eq!(failed.offending_field(), Some(suspect), "{failed}");
            assert!(failed.cause().starts_with(&format!("ffxCreateContext answered {code} ")), "{failed}");
        }
        assert!(WindowedEngine::new(how, &library).is_ok(), "{how:?}");
    }
    assert_eq!(double.violations(), [""; 0]);
}

pub(super) fn memory_can_be_queried_before_creation() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    for (release, is_known) in [(["sdk 1.1.4", ANALYTIC_20], false), (["sdk 2.0", ANALYTIC_20], true)] {
        let (double, library) = set_up_double(&release);
        let api = library.api(Effect::FrameGeneration).expect("there");
        let format = SurfaceFormat::R8G8B8A8_UNORM;
        let plain = swapchain_memory_needed(&gpu, api, SIZE, format, 3, None).expect("an answer");
        let more = swapchain_memory_needed(&gpu, api, SIZE, format, 3, Some(format)).expect("an answer");
        assert_eq!([plain.is_some(), more.is_some()], [is_known; 2]);
        assert!(plain.zip(more).is_none_or(|(plain, more)| plain.total < more.total));
        assert_eq!(double.violations(), [""; 0]);
    }
}

/// In SDK 1.1.0 the generator answers every query with `ERROR`, and the swap chain has no settings of pacing.
pub(super) fn the_first_release_cannot_report_memory_set_pacing_or_have_another_hudless_format() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&FIRST_RELEASE);
    let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
    let pacer = show.swapchain.pacer().version.name.clone();
    assert_eq!(
        (show.swapchain.provider().expect("a generator").version.name.as_str(), pacer.as_str()),
        ("1.1.0", "1.0")
    );
    (0..2).for_each(|_| show.frame(true).expect("presented"));
    let memory = show.swapchain.memory().expect("an answer");
    assert!(memory.generator.is_none() && memory.swapchain.is_none(), "{memory:?}");
    let refused = show.swapchain.set_pacing(&Pacing::LOOSE).expect_err("it has no pacing");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("provider")));
    show.frame(true).expect("presented");
    assert_eq!((show.swapchain.generated(), show.swapchain.failed()), (3, None));
    drop(show);
    let hudless = SwapchainOptions { hudless: Some(SurfaceFormat::B8G8R8A8_UNORM), ..options() };
    let refused = WindowedEngine::with(&hudless, How::ForWindow, &library).err().expect("its format is ignored");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("hudless")));
    assert_eq!(double.violations(), [""; 0]);
}

pub(super) fn numbers_of_buffers_that_overrun_amd_s_arrays_are_refused() {
    let _alone = one_at_a_time();
    let (engine, window) = (Engine::create(), Window::open());
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, None).expect("a device");
    let factory = factory().cast::<IDXGIFactory>().expect("an older one");
    let format = SurfaceFormat::R8G8B8A8_UNORM;
    for (release, most) in
        [(FIRST_RELEASE, 6), (["sdk 1.1.4", "offers 0xf600000000401003 1.1.3"], 6), (["sdk 2.1", ML], 16)]
    {
        let (double, library) = set_up_double(&release);
        let api = library.api(Effect::FrameGeneration).expect("there");
        let refusal = |made: cairn::Result<Swapchain>| {
            made.err().map(|refused| (refused.kind(), refused.offending_field().unwrap_or_default().to_owned()))
        };
        for count in [0, 1, 2, most, most + 1, u32::MAX] {
            let wanted =
                |field: &str| (!(2..=most).contains(&count)).then(|| (ErrorKind::InvalidArgument, field.to_owned()));
            let of_window = DXGI_SWAP_CHAIN_DESC1 { BufferCount: count, ..description() };
            let older = DXGI_SWAP_CHAIN_DESC { BufferCount: count, ..older_description(&window) };
            for from in
                [SwapchainSource::ForWindow(&factory, window.0, of_window, None), SwapchainSource::New(&factory, older)]
            {
                let found = refusal(Swapchain::new(&gpu, api, &options(), from));
                assert_eq!(found, wanted("description.BufferCount"), "{release:?}, {count}");
            }
            let needed = swapchain_memory_needed(&gpu, api, SIZE, format, count, None).err();
            let needed =
                needed.map(|refused| (refused.kind(), refused.offending_field().unwrap_or_default().to_owned()));
            assert_eq!(needed, wanted("back_buffers"), "{release:?}, {count}");
        }
        // One that is taken over: its owner keeps it.
        let large = DXGI_SWAP_CHAIN_DESC1 { BufferCount: 7, ..description() };
        // SAFETY: live objects, and a description that lives during the call.
        let own = unsafe { self::factory().CreateSwapChainForHwnd(&engine.direct, window.0, &large, None, None) };
        let mut own = Some(own.expect("a swap chain").cast().expect("a newer one"));
        let found = refusal(Swapchain::new(&gpu, api, &options(), SwapchainSource::Wrap(&mut own)));
        let wanted = (most < 7).then(|| (ErrorKind::InvalidArgument, "swapchain".to_owned()));
        assert_eq!((found, own.is_some()), (wanted, most < 7), "{release:?}");
        assert_eq!(double.violations(), [""; 0], "{release:?}");
    }
}

/// The configure call succeeds and turns generation on, and the prepare call after it fails.
pub(super) fn generation_of_a_frame_that_is_not_prepared_is_turned_off() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML, "refusing"]);
    for is_paused in [false, true] {
        let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
        double.reject_calls(0x2_000c, 3);
        show.frame(true).expect_err("it is not prepared");
        double.accept_calls();
        if is_paused {
            show.swapchain.pause().expect("paused");
            let before = shown(&double).len();
            show.frame(false).expect("presented");
            assert_eq!(shown(&double).len() - before, 1, "alone");
        }
        drop(show);
        assert_eq!(double.violations(), [""; 0], "{is_paused}");
    }
}

pub(super) fn a_generator_that_cannot_be_turned_off_stays() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML, "refusing"]);
    let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
    (0..2).for_each(|_| show.frame(true).expect("presented"));
    let resize = |show: &WindowedEngine, (width, height), format| {
        // SAFETY: a live swap chain whose buffers nobody holds.
        unsafe { show.swapchain.dxgi().ResizeBuffers(3, width, height, format, DXGI_SWAP_CHAIN_FLAG(0)) }
            .expect("resized");
    };
    resize(&show, (SIZE.width, SIZE.height), DXGI_FORMAT_R10G10B10A2_UNORM);
    double.reject_calls(0x2_0002, 3);
    show.swapchain.fit().expect_err("generation is not off");
    double.accept_calls();
    assert_eq!(show.prepare().expect_err("it is of another format").kind(), ErrorKind::InvalidState);
    resize(&show, (160, 80), DXGI_FORMAT_R8G8B8A8_UNORM);
    for id in [0x2_0002, 0x3_0007] {
        double.reject_calls(id, 3);
        show.swapchain.fit().expect_err("generation is not off");
        double.accept_calls();
        assert!(show.swapchain.provider().is_ok());
        assert_eq!(double.violations(), [""; 0], "{id:x}");
    }
    show.swapchain.fit().expect("it fits");
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
}
