//! AMD's swap chain in a window: of the double, which records its presents, and of AMD's own libraries if `CAIRN_FFX_DIR` names
//! them. On Windows, or in the lab.

use cairn::ErrorKind;
use cairn::ffx::bindings::{Coordinates, CreateFlags, Dimensions, Rect, ReturnCode, SurfaceFormat};
use cairn::ffx::{
    Effect, FrameParams, FrameTextures, Interface, Library, LibraryKind, LoadOptions, Pacing, Swapchain,
    SwapchainOptions, SwapchainSource,
};
use cairn::gpu::Gpu;
use cairn::gpu::compute::ResourceWithState;
use cairn::gpu::windows::Win32::Foundation::HWND;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::*;
use cairn::gpu::windows::core::Interface as _;
use libtest_mimic::Trial;
use test_support::d3d12::engine::{Engine, reference_count};
use test_support::d3d12::list_calls::count_list_calls;
use test_support::d3d12::resources::{self, TestResource, run_list, upload_texture};
use test_support::ffx::double_folder::{ANALYTIC, ANALYTIC_20, DoubleFolder, ML};
use test_support::ffx::frame_textures::{self, Textures};
use test_support::ffx::window::{
    PRESENT, SIZE, STEP, Window, description, factory, moved, of_engine, off, one_at_a_time, panning, pixels, shown,
};
use test_support::trials;

mod pacing;

/// Optional parameters of an engine's frame, in addition to depth and motion.
#[derive(Clone, Copy, Default)]
struct ExtraInputs<'a> {
    hudless: Option<&'a TestResource>,
    distortion: Option<&'a TestResource>,
    rect: Rect,
    /// A static sign is drawn in front of the world.
    sign: bool,
}

/// SDK 1.1.0, whose generator has this name.
const FIRST_RELEASE: [&str; 2] = ["sdk 1.1.0", "offers 0xf600000000401000 1.1.0"];

const SIGN: [u8; 4] = [250, 10, 240, 255];

fn in_sign(x: u32, y: u32) -> bool {
    (48..80).contains(&x) && (32..64).contains(&y)
}

/// How a swap chain is created.
#[derive(Debug, Clone, Copy)]
enum How {
    Wrap,
    New,
    ForWindow,
}

/// An engine that draws into a window. Fields are in drop order.
struct WindowedEngine {
    swapchain: Swapchain,
    textures: Textures,
    gpu: Gpu,
    _window: Window,
    frames: i32,
}

fn options() -> SwapchainOptions {
    SwapchainOptions::new(SIZE)
}

fn made(how: How, library: &Library, gpu: &Gpu, engine: &Engine, window: &Window) -> cairn::Result<Swapchain> {
    create_swapchain(&options(), how, library, gpu, engine, window)
}

fn create_swapchain(
    options: &SwapchainOptions,
    how: How,
    library: &Library,
    gpu: &Gpu,
    engine: &Engine,
    window: &Window,
) -> cairn::Result<Swapchain> {
    let factory = factory().cast::<IDXGIFactory>().expect("an older one");
    let mut own = matches!(how, How::Wrap).then(|| of_engine(engine, window));
    let from = match how {
        How::Wrap => SwapchainSource::Wrap(&mut own),
        How::New => SwapchainSource::New(&factory, older_description(window)),
        How::ForWindow => SwapchainSource::ForWindow(&factory, window.0, description(), None),
    };
    Swapchain::new(gpu, library.api(Effect::FrameGeneration)?, options, from)
}

/// The description of a swap chain for `IDXGIFactory::CreateSwapChain`.
fn older_description(window: &Window) -> DXGI_SWAP_CHAIN_DESC {
    DXGI_SWAP_CHAIN_DESC {
        BufferDesc: DXGI_MODE_DESC {
            Width: SIZE.width,
            Height: SIZE.height,
            Format: DXGI_FORMAT_R8G8B8A8_UNORM,
            ..Default::default()
        },
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        BufferUsage: DXGI_USAGE_RENDER_TARGET_OUTPUT,
        BufferCount: 3,
        OutputWindow: window.0,
        Windowed: true.into(),
        SwapEffect: DXGI_SWAP_EFFECT_FLIP_DISCARD,
        ..Default::default()
    }
}

impl WindowedEngine {
    fn new(how: How, library: &Library) -> cairn::Result<Self> {
        Self::with(&options(), how, library)
    }

    fn with(options: &SwapchainOptions, how: How, library: &Library) -> cairn::Result<Self> {
        let (engine, window) = (Engine::create(), Window::open());
        let gpu = Gpu::of_engine(&engine.device, &engine.direct, None)?;
        let swapchain = create_swapchain(options, how, library, &gpu, &engine, &window)?;
        Ok(Self { swapchain, textures: panning(&gpu, SIZE), gpu, _window: window, frames: 0 })
    }

    /// Prepares a frame that is not presented.
    fn prepare(&mut self) -> cairn::Result<()> {
        let Self { swapchain, textures, gpu, .. } = self;
        let depth_and_motion = FrameTextures {
            depth: textures.depth.with_state(),
            motion: textures.motion.with_state(),
            hudless: None,
            distortion: None,
        };
        let mut prepared = Ok(());
        run_list(gpu, |list| prepared = swapchain.prepare(list, &depth_and_motion, &FrameParams::of(SIZE)));
        prepared
    }

    /// Draws the next frame, prepares it if `is_prepared`, and presents it.
    fn frame(&mut self, is_prepared: bool) -> cairn::Result<()> {
        self.frame_with(is_prepared, &ExtraInputs::default())
    }

    /// The same with optional parameters; a HUD-less frame is drawn too.
    fn frame_with(&mut self, is_prepared: bool, extra: &ExtraInputs<'_>) -> cairn::Result<()> {
        let world = moved(STEP * self.frames);
        let Self { swapchain, textures, gpu, .. } = self;
        textures.fill(&textures.color, |x, y| if extra.sign && in_sign(x, y) { SIGN } else { world(x, y) });
        if let Some(hudless) = extra.hudless {
            textures.fill(hudless, &world);
        }
        let depth_and_motion = FrameTextures {
            depth: textures.depth.with_state(),
            motion: textures.motion.with_state(),
            hudless: extra.hudless.map(TestResource::with_state),
            distortion: extra.distortion.map(TestResource::with_state),
        };
        let params = FrameParams { rect: extra.rect, ..FrameParams::of(SIZE) };
        let dxgi = swapchain.dxgi().clone();
        // SAFETY: a live swap chain.
        let buffer: ID3D12Resource = unsafe { dxgi.GetBuffer(dxgi.GetCurrentBackBufferIndex()) }.expect("a buffer");
        let mut prepared = Ok(());
        run_list(gpu, |list| {
            if is_prepared {
                let calls = count_list_calls(list, || prepared = swapchain.prepare(list, &depth_and_motion, &params));
                assert!(prepared.is_err() || calls > 0, "a frame that is not refused is recorded");
            }
            let to = TestResource { resource: buffer.clone(), state: PRESENT };
            frame_textures::copy(list, &textures.color, &to);
        });
        prepared?;
        // SAFETY: a live swap chain, whose draw calls have run.
        unsafe { dxgi.Present(0, DXGI_PRESENT(0)) }.ok().expect("presented");
        self.frames += 1;
        Ok(())
    }
}

fn set_up_double(lines: &[&str]) -> (DoubleFolder, Library) {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, lines);
    let library = double.load().expect("loaded");
    (double, library)
}

fn generated_frames_are_presented_with_every_swap_chain_source() {
    let _alone = one_at_a_time();
    let releases = [["sdk 1.1.4", ANALYTIC_20], ["sdk 2.0", ANALYTIC_20], ["sdk 2.1", ANALYTIC], ["sdk 2.1", ML]];
    for (how, release) in [How::Wrap, How::New, How::ForWindow, How::Wrap].into_iter().zip(releases) {
        let (double, library) = set_up_double(&release);
        let mut show = WindowedEngine::new(how, &library).expect("a swap chain");
        assert_eq!(show.swapchain.provider().expect("a generator").version, show.swapchain.pacer().version);
        // Without `prepare` there is no generated frame.
        show.frame(false).expect("presented");
        for _ in 0..4 {
            show.frame(true).expect("presented");
        }
        show.swapchain.wait().expect("all are shown");
        assert_eq!((show.swapchain.generated(), show.swapchain.failed()), (4, None));
        let wanted = ["1 real 0", "2 generated 1", "3 real 1", "4 generated 2", "5 real 2"];
        assert_eq!(shown(&double)[..5], wanted, "{how:?}, {release:?}");
        for pair in 0..5 {
            let real = off(&pixels(&double, 2 * pair + 1), moved(STEP * i32::try_from(pair).expect("few")));
            assert_eq!(real, 0, "{how:?}, {release:?}: frame {pair}");
        }
        // The first generated frame has no history and copies the input. The others are half way.
        for pair in 1..5_i32 {
            let by = if pair == 1 { STEP } else { STEP * pair - STEP / 2 };
            let error = off(&pixels(&double, 2 * pair as usize), moved(by));
            assert!(error <= 2, "{how:?}, {release:?}: {error} off before frame {pair}");
        }
        let memory = show.swapchain.memory().expect("an answer");
        assert!(memory.generator.is_some() && memory.swapchain.is_some(), "{release:?}: {memory:?}");
        drop(show);
        assert_eq!(double.violations(), [""; 0], "{how:?}, {release:?}");
    }
}

fn an_interface_is_drawn_over_real_and_generated_frames() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML]);
    let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
    let interface = Textures::new(&show.gpu, SIZE);
    let glass = |x: u32, _: u32| if x < 64 { [200, 40, 0, 128] } else { [0; 4] };
    interface.fill(&interface.color, glass);
    show.frame(true).expect("presented");
    show.frame(true).expect("presented");
    let mut number = 4;
    for (premultiplied, copied) in [(false, true), (true, false), (true, true)] {
        let overlay = Interface { picture: interface.color.with_state(), premultiplied, copied };
        show.swapchain.set_interface(Some(overlay)).expect("told");
        // It stays, although AMD's swap chain forgets a copied one within `Present`.
        for _ in 0..2 {
            show.frame(true).expect("presented");
            let by = STEP * (show.frames - 1);
            for (of, place) in [(by - STEP / 2, 1), (by, 2)] {
                let under = moved(of);
                let error = off(&pixels(&double, number + place), |x, y| {
                    let (under, over) = (under(x, y), glass(x, y));
                    let alpha = f32::from(over[3]) / 255.0;
                    let own = if premultiplied { 1.0 } else { alpha };
                    let mixed = |c: usize| f32::from(over[c]) * own + f32::from(under[c]) * (1.0 - alpha);
                    [mixed(0), mixed(1), mixed(2), 255.0].map(|v| v.round().min(255.0) as u8)
                });
                assert!(error <= 2, "{premultiplied}, {copied}: {error} off");
            }
            number += 2;
        }
    }
    show.swapchain.set_interface(None).expect("told");
    show.frame(true).expect("presented");
    assert_eq!(off(&pixels(&double, number + 2), moved(STEP * (show.frames - 1))), 0);
    // Another size, or a state that ffx-api has no value for.
    let small = Textures::new(&show.gpu, Dimensions { width: 64, height: 48 });
    let depth_read = ResourceWithState { resource: &interface.color.resource, state: D3D12_RESOURCE_STATE_DEPTH_READ };
    for picture in [small.color.with_state(), depth_read] {
        let overlay = Interface { picture, premultiplied: false, copied: false };
        let refused = show.swapchain.set_interface(Some(overlay)).expect_err("no interface");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("interface")));
    }
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
}

fn generation_is_paused_and_goes_on() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML]);
    let mut show = WindowedEngine::new(How::Wrap, &library).expect("a swap chain");
    (0..2).for_each(|_| show.frame(true).expect("presented"));
    show.swapchain.pause().expect("paused");
    show.swapchain.pause().expect("paused already");
    (0..2).for_each(|_| show.frame(false).expect("presented"));
    (0..2).for_each(|_| show.frame(true).expect("presented"));
    let kinds: Vec<_> = shown(&double).iter().map(|line| line.split(' ').nth(1).unwrap_or("").to_owned()).collect();
    let [r, g] = ["real", "generated"];
    assert_eq!(kinds, [g, r, g, r, r, r, g, r, g, r]);
    // The first generated frame has no history, the next has.
    assert!(off(&pixels(&double, 7), moved(STEP * 4)) <= 2);
    assert!(off(&pixels(&double, 9), moved(STEP * 5 - STEP / 2)) <= 2);
    for pacing in
        [Pacing::default(), Pacing::LOOSE, Pacing { hybrid_spin: Some(3), wait_on_fence: true, ..Pacing::LOOSE }]
    {
        show.swapchain.set_pacing(&pacing).expect("told");
    }
    for (field, pacing) in [
        ("safety_margin_ms", Pacing { safety_margin_ms: f32::NAN, ..Pacing::default() }),
        ("safety_margin_ms", Pacing { safety_margin_ms: -0.1, ..Pacing::default() }),
        ("variance_factor", Pacing { variance_factor: 1.5, ..Pacing::default() }),
    ] {
        let refused = show.swapchain.set_pacing(&pacing).expect_err(field);
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
    }
    show.frame(true).expect("presented");
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
}

fn resized_buffers_get_a_new_generator_and_lose_their_interface() {
    const GREEN: [u8; 3] = [0, 200, 40];
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.0", ANALYTIC_20]);
    let mut show = WindowedEngine::new(How::New, &library).expect("a swap chain");
    (0..3).for_each(|_| show.frame(true).expect("presented"));
    let size = Dimensions { width: 160, height: 80 };
    let interface = Textures::new(&show.gpu, SIZE);
    interface.fill(&interface.color, |_, _| [200, 40, 0, 255]);
    let overlay = Interface { picture: interface.color.with_state(), premultiplied: false, copied: false };
    show.swapchain.set_interface(Some(overlay)).expect("told");
    show.swapchain.pause().expect("paused");
    // SAFETY: a live swap chain whose buffers nobody holds.
    unsafe {
        show.swapchain.dxgi().ResizeBuffers(3, size.width, size.height, DXGI_FORMAT_UNKNOWN, DXGI_SWAP_CHAIN_FLAG(0))
    }
    .expect("resized");
    let refused = {
        let pictures = FrameTextures {
            depth: show.textures.depth.with_state(),
            motion: show.textures.motion.with_state(),
            hudless: None,
            distortion: None,
        };
        let mut refused = None;
        run_list(&show.gpu, |list| refused = show.swapchain.prepare(list, &pictures, &FrameParams::of(SIZE)).err());
        refused.expect("the generator is of the size before")
    };
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidState, Some("swapchain")));
    show.swapchain.fit().expect("it fits");
    show.swapchain.fit().expect("it fits already");
    let before = shown(&double).len();
    let color = Textures::new(&show.gpu, size);
    let [red, green, blue] = GREEN;
    color.fill(&color.color, |_, _| [red, green, blue, 255]);
    for _ in 0..2 {
        let dxgi = show.swapchain.dxgi().clone();
        // SAFETY: a live swap chain.
        let buffer: ID3D12Resource = unsafe { dxgi.GetBuffer(dxgi.GetCurrentBackBufferIndex()) }.expect("a buffer");
        let pictures = show.pictures_of();
        run_list(&show.gpu, |list| {
            let (depth, motion) = (pictures.0.with_state(), pictures.1.with_state());
            let textures = FrameTextures { depth, motion, hudless: None, distortion: None };
            show.swapchain.prepare(list, &textures, &FrameParams::of(SIZE)).expect("prepared");
            frame_textures::copy(list, &color.color, &TestResource { resource: buffer.clone(), state: PRESENT });
        });
        // SAFETY: a live swap chain, whose draw calls have run.
        unsafe { dxgi.Present(0, DXGI_PRESENT(0)) }.ok().expect("presented");
    }
    assert_eq!(shown(&double).len() - before, 4);
    let last = pixels(&double, before + 3);
    assert_eq!(last.len(), 160 * 80);
    let other = last.iter().find(|pixel| pixel[..3] != GREEN);
    assert_eq!(other, None, "the interface of the size before is gone");
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
}

impl WindowedEngine {
    /// Depth and motion textures for frames without others.
    fn pictures_of(&self) -> (TestResource, TestResource) {
        let kept = |of: &TestResource| TestResource { resource: of.resource.clone(), state: of.state };
        (kept(&self.textures.depth), kept(&self.textures.motion))
    }
}

fn resized_buffers_keep_the_provider_that_has_passed_the_self_test() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML, ANALYTIC, "plays through", "only 4.0.1"]);
    let options = SwapchainOptions { self_test: true, ..options() };
    let mut show = WindowedEngine::with(&options, How::ForWindow, &library).expect("a swap chain");
    assert_eq!(show.swapchain.provider().expect("one").version.name, "3.1.6");
    let flags = DXGI_SWAP_CHAIN_FLAG(0);
    // SAFETY: a live swap chain whose buffers nobody holds.
    unsafe { show.swapchain.dxgi().ResizeBuffers(3, 160, 80, DXGI_FORMAT_UNKNOWN, flags) }.expect("resized");
    show.swapchain.fit().expect("it fits");
    assert_eq!(show.swapchain.provider().expect("one").version.name, "3.1.6");
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
}

fn a_refused_frame_leaves_the_list_empty() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML]);
    let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
    let valid = FrameParams::of(SIZE);
    for (params, field) in [
        (FrameParams { frame_time: 0.0, ..valid }, "frame_time"),
        (FrameParams { motion_scale: Coordinates { x: 1.0, y: f32::INFINITY }, ..valid }, "motion_scale"),
    ] {
        let WindowedEngine { swapchain, textures, gpu, .. } = &mut show;
        let (depth, motion) = (textures.depth.with_state(), textures.motion.with_state());
        let pictures = FrameTextures { depth, motion, hudless: None, distortion: None };
        run_list(gpu, |list| {
            let mut refused = None;
            let calls = count_list_calls(list, || refused = swapchain.prepare(list, &pictures, &params).err());
            assert_eq!((refused.expect(field).offending_field(), calls), (Some(field), 0));
        });
    }
    show.frame(true).expect("a frame");
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
}

fn an_unsuitable_swap_chain_is_refused_and_unchanged() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML]);
    let api = library.api(Effect::FrameGeneration).expect("there");
    let (engine, window) = (Engine::create(), Window::open());
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, None).expect("a device");
    let on_compute = Gpu::of_engine(&engine.device, &engine.compute, None).expect("a device");
    let factory = factory().cast::<IDXGIFactory>().expect("an older one");
    let for_window = |desc, window| SwapchainSource::ForWindow(&factory, window, desc, None);
    let wrong_size = DXGI_SWAP_CHAIN_DESC1 { Width: 0, ..description() };
    let wrong_format = DXGI_SWAP_CHAIN_DESC1 { Format: DXGI_FORMAT_R8_UNORM, ..description() };
    let full = DXGI_SWAP_CHAIN_FULLSCREEN_DESC { Windowed: false.into(), ..Default::default() };
    for (field, gpu, from) in [
        ("queue", &on_compute, for_window(description(), window.0)),
        ("display_size", &gpu, for_window(wrong_size, window.0)),
        ("back_buffer_format", &gpu, for_window(wrong_format, window.0)),
        ("window", &gpu, for_window(description(), HWND::default())),
        ("fullscreen.Windowed", &gpu, SwapchainSource::ForWindow(&factory, window.0, description(), Some(full))),
        ("description.Windowed", &gpu, SwapchainSource::New(&factory, DXGI_SWAP_CHAIN_DESC::default())),
        (
            "description.OutputWindow",
            &gpu,
            SwapchainSource::New(&factory, DXGI_SWAP_CHAIN_DESC { Windowed: true.into(), ..Default::default() }),
        ),
    ] {
        let refused = Swapchain::new(gpu, api, &options(), from).expect_err(field);
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
    }
    // Another reference exists, or no generator passes the self-test: the swap chain is not changed.
    let own = of_engine(&engine, &window);
    let mut again = Some(own.clone());
    let refused = Swapchain::new(&gpu, api, &options(), SwapchainSource::Wrap(&mut again)).expect_err("two references");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("swapchain")));
    assert!(again.take().is_some_and(|again| again == own), "it is its owner's as before");
    let refused = Swapchain::new(&gpu, api, &options(), SwapchainSource::Wrap(&mut None)).expect_err("no swap chain");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("swapchain")));
    // SAFETY: a live swap chain.
    unsafe { own.Present(0, DXGI_PRESENT(0)) }.ok().expect("it presents");
    assert_eq!(double.violations(), [""; 0]);
    drop(own);
    let (double, library) = set_up_double(&["sdk 2.1", ML, "plays through"]);
    let refused = made(How::ForWindow, &library, &gpu, &engine, &window).expect_err("it passes frames through");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("provider")));
    assert_eq!(double.violations(), [""; 0]);
}

fn a_frame_whose_generation_fails_is_shown_twice() {
    let _alone = one_at_a_time();
    // The self-test generates two pictures, and two more are shown.
    let (double, library) = set_up_double(&["sdk 2.1", ML, "breaks 5"]);
    let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
    (0..4).for_each(|_| show.frame(true).expect("presented"));
    assert_eq!((show.swapchain.generated(), show.swapchain.failed()), (2, Some(ReturnCode::RUNTIME_ERROR)));
    assert_eq!(show.swapchain.repeated(), 2);
    for frame in 0..4 {
        let [between, real] = [1, 2].map(|number| pixels(&double, 2 * frame + number));
        let at = STEP * i32::try_from(frame).expect("few");
        assert_eq!(off(&real, moved(at)), 0, "frame {frame}");
        // The first generated frame has no history and copies the input.
        let error = off(&between, moved(if frame == 1 { at - STEP / 2 } else { at }));
        assert!(error <= 2, "{error} off before frame {frame}");
        assert!(frame < 2 || between == real, "frame {frame} is shown twice");
    }
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
}

fn the_double_detects_a_wrong_order_of_calls() {
    let _alone = one_at_a_time();
    // The swap chain is still referenced when its pacing context is destroyed.
    let (double, library) = set_up_double(&["sdk 2.1", ML]);
    let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
    show.frame(true).expect("presented");
    let held = show.swapchain.dxgi().clone();
    drop(show);
    let violations = double.violations();
    assert!(violations.len() == 1 && violations[0].contains("references to its swap chain are left"), "{violations:?}");
    drop(held);
}

fn an_unprepared_frame_is_shown_twice() {
    let _alone = one_at_a_time();
    let (double, library) = set_up_double(&["sdk 2.1", ML]);
    let mut show = WindowedEngine::new(How::ForWindow, &library).expect("a swap chain");
    for is_prepared in [true, true, false, true, true] {
        show.frame(is_prepared).expect("presented");
    }
    let swapchain = &show.swapchain;
    assert_eq!((swapchain.generated(), swapchain.repeated(), swapchain.failed()), (4, 1, None));
    // The third has neither motion nor depth, so the fourth has no history.
    for (frame, halfway) in [false, true, false, false, true].into_iter().enumerate() {
        let by = STEP * i32::try_from(frame).expect("few");
        let error = off(&pixels(&double, 2 * frame + 1), moved(if halfway { by - STEP / 2 } else { by }));
        assert!(error <= 2, "{error} off before frame {frame}");
        assert_eq!(off(&pixels(&double, 2 * frame + 2), moved(by)), 0, "frame {frame}");
    }
    drop(show);
    assert_eq!(double.violations(), [""; 0]);
}

fn amd_s_own_swap_chain_presents_generated_frames() {
    let _alone = one_at_a_time();
    let folder = std::env::var_os("CAIRN_FFX_DIR").expect("CAIRN_FFX_DIR names a folder");
    let options = LoadOptions { directory: Some(folder.into()), signed: true };
    let library = Library::load(&options).expect("AMD's libraries");
    for how in [How::ForWindow, How::Wrap, How::New] {
        let mut show = WindowedEngine::new(how, &library).expect("a swap chain");
        println!("{how:?}: {:?}", show.swapchain);
        show.swapchain.set_pacing(&Pacing::LOOSE).expect("told");
        (0..6).for_each(|_| show.frame(true).expect("presented"));
        show.swapchain.wait().expect("all are shown");
        assert_eq!((show.swapchain.generated(), show.swapchain.failed()), (6, None), "{how:?}");
        println!("{how:?}: {:?}", show.swapchain.memory().expect("an answer"));
        let interface = Textures::new(&show.gpu, SIZE);
        interface.fill(&interface.color, |x, _| if x < 64 { [200, 40, 0, 128] } else { [0; 4] });
        let overlay = Interface { picture: interface.color.with_state(), premultiplied: false, copied: true };
        // AMD's copy of the interface counts in its memory. A frame that is not prepared shows that AMD forgets the interface.
        let bytes = |show: &mut WindowedEngine| {
            show.swapchain.wait().expect("all are shown");
            show.swapchain.memory().expect("an answer").swapchain.expect("the swap chain's").total
        };
        let without = bytes(&mut show);
        show.swapchain.set_interface(Some(overlay)).expect("told");
        let drawn = [true, true, false, true].map(|is_prepared| {
            show.frame(is_prepared).expect("presented");
            bytes(&mut show) > without
        });
        assert_eq!(drawn, [true, true, false, true], "{how:?}: where the interface is drawn");
        show.swapchain.pause().expect("paused");
        (0..2).for_each(|_| show.frame(false).expect("presented"));
        // AMD's swap chain asked for a frame before the one that was not prepared, and for none while paused.
        assert_eq!((show.swapchain.generated(), show.swapchain.repeated()), (9, 1), "{how:?}");
        assert!(show.gpu.removed().is_none());
        drop(show);
    }
    let mut asynchronous = SwapchainOptions::new(SIZE);
    asynchronous.flags = CreateFlags::ASYNC_WORKLOAD;
    let (engine, window) = (Engine::create(), Window::open());
    let gpu = Gpu::of_engine(&engine.device, &engine.direct, None).expect("a device");
    let factory = factory().cast::<IDXGIFactory>().expect("an older one");
    let from = SwapchainSource::ForWindow(&factory, window.0, description(), None);
    let api = library.api(Effect::FrameGeneration).expect("there");
    let swapchain = Swapchain::new(&gpu, api, &asynchronous, from).expect("a swap chain");
    let mut show = WindowedEngine { swapchain, textures: panning(&gpu, SIZE), gpu, _window: window, frames: 0 };
    (0..4).for_each(|_| show.frame(true).expect("presented"));
    show.swapchain.wait().expect("all are shown");
    assert_eq!((show.swapchain.generated(), show.swapchain.failed()), (4, None), "on a queue of its own");
}

/// The tests of this program.
pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = trials![
        always: generated_frames_are_presented_with_every_swap_chain_source,
        an_interface_is_drawn_over_real_and_generated_frames,
        generation_is_paused_and_goes_on,
        resized_buffers_get_a_new_generator_and_lose_their_interface,
        resized_buffers_keep_the_provider_that_has_passed_the_self_test,
        a_refused_frame_leaves_the_list_empty,
        an_unsuitable_swap_chain_is_refused_and_unchanged,
        a_frame_whose_generation_fails_is_shown_twice,
        the_double_detects_a_wrong_order_of_calls,
        an_unprepared_frame_is_shown_twice,
    ];
    trials.extend(paced_trials());
    trials.extend(trials![with_amd: amd_s_own_swap_chain_presents_generated_frames]);
    trials
}

fn paced_trials() -> Vec<Trial> {
    use pacing::{
        a_generator_that_cannot_be_turned_off_stays, creation_and_pacing_parameters_reach_the_library,
        every_code_at_every_call_is_reported_and_the_next_call_succeeds,
        generation_of_a_frame_that_is_not_prepared_is_turned_off,
        hudless_frames_rects_and_lens_distortion_change_generated_frames, memory_can_be_queried_before_creation,
        numbers_of_buffers_that_overrun_amd_s_arrays_are_refused,
        pictures_are_held_until_the_next_present_has_read_them,
        the_first_release_cannot_report_memory_set_pacing_or_have_another_hudless_format,
    };
    trials![
        always: hudless_frames_rects_and_lens_distortion_change_generated_frames,
        creation_and_pacing_parameters_reach_the_library,
        pictures_are_held_until_the_next_present_has_read_them,
        every_code_at_every_call_is_reported_and_the_next_call_succeeds,
        memory_can_be_queried_before_creation,
        the_first_release_cannot_report_memory_set_pacing_or_have_another_hudless_format,
        numbers_of_buffers_that_overrun_amd_s_arrays_are_refused,
        generation_of_a_frame_that_is_not_prepared_is_turned_off,
        a_generator_that_cannot_be_turned_off_stays,
    ]
}
