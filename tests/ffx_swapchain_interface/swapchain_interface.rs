//! AMD's swap chain through the C interface: of the double, and of AMD's own libraries if `CAIRN_FFX_DIR` names them. On Windows,
//! or in the lab.

use std::ffi::{CStr, c_char};
use std::path::Path;
use std::ptr::{null, null_mut};

use cairn::abi::d3d12::cairn_device_create_d3d12;
use cairn::abi::device::{
    CAIRN_DEVICE_ENVIRONMENT, cairn_device, cairn_device_create_cpu, cairn_device_destroy, cairn_device_options,
};
use cairn::abi::results::*;
use cairn::abi::swapchain::{
    CAIRN_FSR_ANY, CAIRN_FSR_REQUIRE_ANALYTIC, CAIRN_FSR_REQUIRE_ML, CAIRN_INTERFACE_COPIED, CAIRN_PACING_HYBRID_SPIN,
    CAIRN_SWAPCHAIN_ASYNC, CAIRN_SWAPCHAIN_RESET, CAIRN_SWAPCHAIN_UNTRIED, cairn_swapchain, cairn_swapchain_create,
    cairn_swapchain_create_for_window, cairn_swapchain_destroy, cairn_swapchain_fit, cairn_swapchain_frame,
    cairn_swapchain_get_dxgi, cairn_swapchain_get_statistics, cairn_swapchain_options, cairn_swapchain_pacing,
    cairn_swapchain_pause, cairn_swapchain_prepare, cairn_swapchain_set_interface, cairn_swapchain_set_pacing,
    cairn_swapchain_statistics, cairn_swapchain_wait, cairn_swapchain_wrap,
};
use cairn::ffx::LibraryKind;
use cairn::ffx::bindings::Dimensions;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::*;
use cairn::gpu::windows::core::Interface as _;
use libtest_mimic::Trial;
use test_support::d3d12::engine::{self, Engine};
use test_support::d3d12::resources::{TestResource, run_list};
use test_support::ffx::double_folder::{ANALYTIC, DoubleFolder, ML};
use test_support::ffx::frame_textures::{self, Textures};
use test_support::ffx::window::{
    PRESENT, SIZE, STEP, Window, description, factory, moved, of_engine, off, one_at_a_time, panning, pixels, shown,
};
use test_support::trials;
use test_support::trials::amd_folder;

/// The result of a C call: the handle, or code and message.
type Made<T> = Result<*mut T, (cairn_result, String)>;

fn made<T>(make: impl FnOnce(*mut *mut T) -> cairn_result) -> Made<T> {
    let mut handle = null_mut();
    match make(&mut handle) {
        CAIRN_OK => Ok(handle),
        code => Err((code, message())),
    }
}

fn message() -> String {
    let mut text = [0 as c_char; 1024];
    // SAFETY: a buffer of the stated length.
    unsafe { cairn_last_error(text.as_mut_ptr(), text.len(), null_mut()) };
    text_of(&text)
}

fn text_of(text: &[c_char]) -> String {
    // SAFETY: the library ends its texts with a NUL.
    unsafe { CStr::from_ptr(text.as_ptr()) }.to_string_lossy().into_owned()
}

/// A C struct with its size set and all else zero.
macro_rules! sized {
    ($kind:ty { $($field:ident: $value:expr),* $(,)? }) => {{
        // SAFETY: structs of the interface are plain data, for which zero is a value.
        let mut made: $kind = unsafe { std::mem::zeroed() };
        made.struct_size = size_of::<$kind>() as u32;
        $(made.$field = $value;)*
        made
    }};
}

/// The double with this configuration, in the folder that a host searches.
fn set_up_double(lines: &[&str]) -> DoubleFolder {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, lines);
    named(&double.0);
    double
}

fn named(folder: &Path) {
    // SAFETY: one test at a time uses the environment, and Windows has no bare pointers into it.
    unsafe { std::env::set_var("CAIRN_FFX_DIR", folder) };
}

/// How the host's swap chain is created.
#[derive(Debug, Clone, Copy)]
enum How {
    Wrap,
    Create,
    ForWindow,
}

/// A host of the C interface that draws into a window.
struct Host {
    swapchain: *mut cairn_swapchain,
    device: *mut cairn_device,
    textures: Textures,
    gpu: Gpu,
    _window: Window,
    frames: i32,
}

fn device_of(engine: &Engine) -> *mut cairn_device {
    let (device, queue) = (engine.device.as_raw().cast(), engine.direct.as_raw().cast());
    let options = sized!(cairn_device_options { flags: CAIRN_DEVICE_ENVIRONMENT });
    // SAFETY: live objects, options of their size and memory for the handle.
    made(|to| unsafe { cairn_device_create_d3d12(device, queue, null_mut(), &options, to) }).expect("a device")
}

fn swapchain(
    how: How,
    engine: &Engine,
    device: *const cairn_device,
    window: &Window,
    options: *const cairn_swapchain_options,
) -> Made<cairn_swapchain> {
    let factory = factory().cast::<IDXGIFactory>().expect("an older one");
    let (of_window, raw) = (description(), factory.as_raw().cast());
    let older = DXGI_SWAP_CHAIN_DESC {
        BufferDesc: DXGI_MODE_DESC {
            Width: SIZE.width,
            Height: SIZE.height,
            Format: of_window.Format,
            ..Default::default()
        },
        SampleDesc: of_window.SampleDesc,
        BufferUsage: of_window.BufferUsage,
        BufferCount: of_window.BufferCount,
        OutputWindow: window.0,
        Windowed: true.into(),
        SwapEffect: of_window.SwapEffect,
        ..Default::default()
    };
    // SAFETY: live objects, valid structs, and memory for the handle.
    made(|to| unsafe {
        match how {
            How::Wrap => {
                let mut own = of_engine(engine, window).into_raw().cast();
                let code = cairn_swapchain_wrap(device, options, &mut own, to);
                assert_eq!(own.is_null(), code == CAIRN_OK, "it is gone where AMD's library has it");
                if !own.is_null() {
                    drop(IDXGISwapChain::from_raw(own.cast()));
                }
                code
            }
            How::Create => cairn_swapchain_create(device, options, raw, (&raw const older).cast(), to),
            How::ForWindow => {
                let description = (&raw const of_window).cast();
                cairn_swapchain_create_for_window(device, options, raw, window.0.0, description, null(), to)
            }
        }
    })
}

impl Host {
    fn new(how: How, options: Option<&cairn_swapchain_options>) -> Self {
        let (engine, window) = (Engine::create(), Window::open());
        let gpu = Gpu::of_engine(&engine.device, &engine.direct, None).expect("a device");
        let device = device_of(&engine);
        let swapchain =
            swapchain(how, &engine, device, &window, options.map_or(null(), |frame| frame)).expect("a swap chain");
        Self { swapchain, device, textures: panning(&gpu, SIZE), gpu, _window: window, frames: 0 }
    }

    /// The DXGI swap chain, with a new reference.
    fn dxgi(&self) -> IDXGISwapChain4 {
        let mut dxgi = null_mut();
        // SAFETY: memory for the pointer, which comes with a reference of ours.
        unsafe {
            assert_eq!(cairn_swapchain_get_dxgi(self.swapchain, &mut dxgi), CAIRN_OK, "{}", message());
            IDXGISwapChain4::from_raw(dxgi.cast())
        }
    }

    /// The frame struct for these textures.
    fn frame_struct(&self) -> cairn_swapchain_frame {
        let Textures { depth, motion, .. } = &self.textures;
        sized!(cairn_swapchain_frame {
            depth: depth.resource.as_raw().cast(),
            motion: motion.resource.as_raw().cast(),
            depth_state: depth.state.0.cast_unsigned(),
            motion_state: motion.state.0.cast_unsigned(),
            render_width: SIZE.width,
            render_height: SIZE.height,
            frame_time_ms: 1000.0 / 15.0,
        })
    }

    /// Draws the next frame, prepares it with `frame_struct`, and presents it; returns the result of the prepare call.
    fn frame(&mut self, frame: Option<&cairn_swapchain_frame>) -> cairn_result {
        self.textures.fill(&self.textures.color, moved(STEP * self.frames));
        let dxgi = self.dxgi();
        // SAFETY: a live swap chain.
        let buffer: ID3D12Resource = unsafe { dxgi.GetBuffer(dxgi.GetCurrentBackBufferIndex()) }.expect("a buffer");
        let mut answer = CAIRN_OK;
        run_list(&self.gpu, |list| {
            if let Some(frame) = frame {
                // SAFETY: an open list, and textures that live.
                answer = unsafe { cairn_swapchain_prepare(self.swapchain, list.as_raw().cast(), frame) };
            }
            frame_textures::copy(
                list,
                &self.textures.color,
                &TestResource { resource: buffer.clone(), state: PRESENT },
            );
        });
        // SAFETY: a live swap chain, whose draw calls have run.
        unsafe { dxgi.Present(0, DXGI_PRESENT(0)) }.ok().expect("presented");
        self.frames += 1;
        answer
    }

    /// Prepares and presents a frame.
    fn next(&mut self) {
        let frame = self.frame_struct();
        assert_eq!(self.frame(Some(&frame)), CAIRN_OK, "{}", message());
    }

    fn statistics(&self) -> cairn_swapchain_statistics {
        let mut figures = sized!(cairn_swapchain_statistics {});
        // SAFETY: a struct that can be written.
        let answer = unsafe { cairn_swapchain_get_statistics(self.swapchain, &mut figures) };
        assert_eq!(answer, CAIRN_OK, "{}", message());
        figures
    }

    /// Destroys all handles.
    fn end(self) {
        // SAFETY: handles of ours.
        unsafe {
            assert_eq!(cairn_swapchain_destroy(self.swapchain), CAIRN_OK, "{}", message());
            assert_eq!(cairn_swapchain_destroy(self.swapchain), CAIRN_ERROR_INVALID_HANDLE);
            assert_eq!(cairn_device_destroy(self.device), CAIRN_OK);
        }
        assert!(self.gpu.removed().is_none());
    }
}

fn a_host_presents_with_amd_s_swap_chain_from_every_source() {
    let _alone = one_at_a_time();
    for how in [How::Wrap, How::Create, How::ForWindow] {
        let double = set_up_double(&["sdk 2.1", ML]);
        let mut host = Host::new(how, None);
        (0..4).for_each(|_| host.next());
        // SAFETY: a handle of ours.
        assert_eq!(unsafe { cairn_swapchain_wait(host.swapchain) }, CAIRN_OK);
        let figures = host.statistics();
        assert_eq!((figures.generated, figures.repeated, figures.failed), (4, 0, 0));
        assert!(text_of(&figures.generator).starts_with("4.0.1"), "{}", text_of(&figures.generator));
        assert!(!text_of(&figures.pacer).is_empty() && figures.generator_bytes > 0 && figures.swapchain_bytes > 0);
        for frame in 1..4_i32 {
            let of = |place| pixels(&double, (2 * frame + place) as usize);
            assert!(off(&of(1), moved(STEP * frame - STEP / 2)) <= 2, "{how:?}: half way to frame {frame}");
            assert_eq!(off(&of(2), moved(STEP * frame)), 0, "{how:?}: frame {frame}");
        }
        // Not while the DXGI swap chain is referenced.
        let held = host.dxgi();
        // SAFETY: a handle of ours.
        assert_eq!(unsafe { cairn_swapchain_destroy(host.swapchain) }, CAIRN_ERROR_BUSY);
        assert!(message().contains("left: 1"), "{}", message());
        drop(held);
        host.next();
        assert_eq!(host.statistics().generated, 5, "and it goes on");
        assert_eq!(host.frame(None), CAIRN_OK);
        // SAFETY: a handle of ours.
        assert_eq!(unsafe { cairn_swapchain_wait(host.swapchain) }, CAIRN_OK);
        let figures = host.statistics();
        assert_eq!((figures.generated, figures.repeated), (5, 1), "a frame that was not prepared");
        host.end();
        assert_eq!(double.violations(), [""; 0], "{how:?}");
    }
}

fn a_host_s_frame_parameters_change_the_presented_frames() {
    let _alone = one_at_a_time();
    let double = set_up_double(&["sdk 2.1", ML, ANALYTIC]);
    let options = sized!(cairn_swapchain_options {
        flags: CAIRN_SWAPCHAIN_UNTRIED,
        provider: CAIRN_FSR_REQUIRE_ML,
        hudless_format: DXGI_FORMAT_R8G8B8A8_UNORM.0.cast_unsigned(),
        max_render_width: SIZE.width,
        max_render_height: SIZE.height,
    });
    let mut host = Host::new(How::ForWindow, Some(&options));
    let plain = host.frame_struct();
    let shows = |host: &mut Host, frame: &cairn_swapchain_frame, by: i32| {
        assert_eq!(host.frame(Some(frame)), CAIRN_OK, "{}", message());
        let generated = shown(&double).len() - 1;
        let frame = host.frames - 1;
        let error = off(&pixels(&double, generated), moved(STEP * frame - by));
        assert!(error <= 2, "frame {frame}: {error} off");
    };
    // The first frame and the frame after a cut have no history.
    shows(&mut host, &plain, 0);
    shows(&mut host, &plain, STEP / 2);
    shows(&mut host, &cairn_swapchain_frame { flags: CAIRN_SWAPCHAIN_RESET, ..plain }, 0);
    shows(&mut host, &plain, STEP / 2);
    // Motion in units of half pixels, with that scale.
    host.textures.fill(&host.textures.motion, |_, _| {
        let [x, y] = [-2.0 * STEP as f32, 0.0].map(|v| half::f16::from_f32(v).to_le_bytes());
        [x[0], x[1], y[0], y[1]]
    });
    shows(&mut host, &cairn_swapchain_frame { motion_scale_x: 0.5, motion_scale_y: 0.5, ..plain }, STEP / 2);
    // A HUD-less frame: it is used for generation in place of the buffer.
    let hudless = Textures::new(&host.gpu, SIZE);
    let with_hudless = cairn_swapchain_frame {
        hudless: hudless.color.resource.as_raw().cast(),
        hudless_state: hudless.color.state.0.cast_unsigned(),
        motion_scale_x: 0.5,
        motion_scale_y: 0.5,
        ..plain
    };
    for _ in 0..2 {
        hudless.fill(&hudless.color, moved(STEP * host.frames));
        shows(&mut host, &with_hudless, STEP / 2);
    }
    // An invalid frame struct is rejected, and the frame is presented nevertheless.
    let text = |frame: &cairn_swapchain_frame, host: &mut Host| {
        let answer = host.frame(Some(frame));
        (answer, message())
    };
    let (gone, no) = (null_mut(), f32::NAN);
    for (field, frame) in [
        ("frame.depth", cairn_swapchain_frame { depth: gone, ..plain }),
        ("frame.jitter_x", cairn_swapchain_frame { jitter_x: no, ..plain }),
        ("frame_time", cairn_swapchain_frame { frame_time_ms: 0.0, ..plain }),
        ("depth", cairn_swapchain_frame { render_width: SIZE.width + 1, ..plain }),
        (
            "camera.near",
            cairn_swapchain_frame {
                vertical_fov: 1.0,
                up: [0.0, 1.0, 0.0],
                right: [1.0, 0.0, 0.0],
                forward: [0.0, 0.0, 1.0],
                ..plain
            },
        ),
        ("rect", cairn_swapchain_frame { world_width: 1, ..plain }),
    ] {
        let (answer, why) = text(&frame, &mut host);
        assert_eq!(answer, CAIRN_ERROR_INVALID_ARGUMENT, "{field}: {why}");
        assert!(why.contains(field), "{field}: {why}");
    }
    host.end();
    let violations = double.violations();
    assert!(violations.iter().all(|line| line.contains("presented again, unprepared")), "{violations:?}");
}

fn interface_pacing_pauses_and_resizes_reach_the_library() {
    let _alone = one_at_a_time();
    let double = set_up_double(&["sdk 2.1", ANALYTIC]);
    let options =
        sized!(cairn_swapchain_options { flags: CAIRN_SWAPCHAIN_ASYNC, provider: CAIRN_FSR_REQUIRE_ANALYTIC });
    let mut host = Host::new(How::Create, Some(&options));
    assert!(text_of(&host.statistics().generator).starts_with("3.1.6"));
    let interface = Textures::new(&host.gpu, SIZE);
    interface.fill(&interface.color, |_, _| [9, 8, 7, 255]);
    let (picture, state) = (interface.color.resource.as_raw().cast(), interface.color.state.0.cast_unsigned());
    // SAFETY: handles and objects of ours, here and below.
    let set_interface =
        |picture, flags| unsafe { cairn_swapchain_set_interface(host.swapchain, picture, state, flags) };
    assert_eq!(set_interface(picture, CAIRN_INTERFACE_COPIED), CAIRN_OK, "{}", message());
    assert_eq!(set_interface(picture, 4), CAIRN_ERROR_INVALID_ARGUMENT);
    host.next();
    assert_eq!(off(&pixels(&double, 2), |_, _| [9, 8, 7, 255]), 0, "it covers the frame");
    // SAFETY: as above.
    assert_eq!(unsafe { cairn_swapchain_set_interface(host.swapchain, null_mut(), 0, 0) }, CAIRN_OK);
    host.next();
    assert_eq!(off(&pixels(&double, 4), moved(STEP)), 0, "it is gone");
    let pacing = sized!(cairn_swapchain_pacing {
        flags: CAIRN_PACING_HYBRID_SPIN,
        safety_margin_ms: 0.01,
        variance_factor: 0.3,
        spin_ticks: 3,
    });
    let outside = cairn_swapchain_pacing { variance_factor: 1.5, ..pacing };
    // SAFETY: as above.
    unsafe {
        assert_eq!(cairn_swapchain_set_pacing(host.swapchain, &pacing), CAIRN_OK);
        assert_eq!(cairn_swapchain_set_pacing(host.swapchain, null()), CAIRN_OK);
        assert_eq!(cairn_swapchain_set_pacing(host.swapchain, &outside), CAIRN_ERROR_INVALID_ARGUMENT);
        assert_eq!(cairn_swapchain_pause(host.swapchain), CAIRN_OK);
    }
    let before = shown(&double).len();
    host.frame(None);
    assert_eq!(shown(&double).len() - before, 1, "alone");
    // Other sizes.
    let dxgi = host.dxgi();
    // SAFETY: a live swap chain whose buffers nobody holds.
    unsafe { dxgi.ResizeBuffers(3, 160, 80, DXGI_FORMAT_UNKNOWN, DXGI_SWAP_CHAIN_FLAG(0)) }.expect("resized");
    drop(dxgi);
    host.textures = panning(&host.gpu, Dimensions { width: 160, height: 80 });
    let larger = cairn_swapchain_frame { render_width: 160, render_height: 80, ..host.frame_struct() };
    assert_eq!(host.frame(Some(&larger)), CAIRN_ERROR_INVALID_STATE, "{}", message());
    // SAFETY: as above.
    assert_eq!(unsafe { cairn_swapchain_fit(host.swapchain) }, CAIRN_OK, "{}", message());
    let before = host.statistics();
    // The maximum render size follows the buffers' size.
    assert_eq!(host.frame(Some(&larger)), CAIRN_OK, "{}", message());
    let after = host.statistics();
    assert_eq!((after.generated, after.repeated), (before.generated + 1, before.repeated));
    host.end();
    assert_eq!(double.violations(), [""; 0]);
}

fn a_refused_swap_chain_is_returned_unchanged() {
    let _alone = one_at_a_time();
    let (engine, window) = (Engine::create(), Window::open());
    let device = device_of(&engine);
    let double = set_up_double(&["sdk 2.1", ML]);
    let own = of_engine(&engine, &window);
    let wrapped = |options: *const cairn_swapchain_options, device| {
        let mut given = own.clone().into_raw().cast();
        // SAFETY: a swap chain with a reference of ours, and memory for the handle.
        let answer = made(|to| unsafe { cairn_swapchain_wrap(device, options, &mut given, to) });
        assert!(!given.is_null(), "it is ours as before");
        // SAFETY: that reference.
        drop(unsafe { IDXGISwapChain::from_raw(given.cast()) });
        answer.expect_err("refused")
    };
    // `own` is another reference to it.
    let (code, why) = wrapped(null(), device);
    assert_eq!(code, CAIRN_ERROR_INVALID_ARGUMENT);
    assert!(why.contains("1 references"), "{why}");
    for (field, options) in [
        ("options.flags", sized!(cairn_swapchain_options { flags: 256 })),
        ("options.provider", sized!(cairn_swapchain_options { provider: 5 })),
        ("options.hudless_format", sized!(cairn_swapchain_options { hudless_format: 35 })),
        ("options.max_render_height", sized!(cairn_swapchain_options { max_render_width: 8 })),
        ("options", sized!(cairn_swapchain_options { struct_size: 7 })),
    ] {
        let (code, why) = wrapped(&options, device);
        let wanted = if field == "options" { CAIRN_ERROR_STRUCT_SIZE } else { CAIRN_ERROR_INVALID_ARGUMENT };
        assert_eq!(code, wanted, "{why}");
        assert!(why.contains(field), "{why}");
    }
    assert_eq!(engine::reference_count(&own), 1);
    // SAFETY: a live swap chain.
    unsafe { own.Present(0, DXGI_PRESENT(0)) }.ok().expect("it presents");
    drop(own);
    // Unsupported requests, and missing objects.
    let required = sized!(cairn_swapchain_options { provider: CAIRN_FSR_REQUIRE_ANALYTIC });
    let tool = sized!(cairn_device_options { flags: CAIRN_DEVICE_ENVIRONMENT });
    // SAFETY: options of their size and memory for the handle.
    let cpu = made(|to| unsafe { cairn_device_create_cpu(&tool, to) }).expect("a device");
    let nowhere = std::env::temp_dir().join("cairn-ffx-there-is-none");
    for (device, options, folder, code) in [
        (device, &raw const required, &double.0, CAIRN_ERROR_UNSUPPORTED),
        (cpu, null(), &double.0, CAIRN_ERROR_UNSUPPORTED),
        (device, null(), &nowhere, CAIRN_ERROR_RUNTIME_MISSING),
    ] {
        named(folder);
        let refused = swapchain(How::Wrap, &engine, device, &window, options).expect_err("refused");
        assert_eq!(refused.0, code, "{}", refused.1);
    }
    // SAFETY: handles of ours, and no handle at all.
    unsafe {
        assert_eq!(cairn_device_destroy(cpu), CAIRN_OK);
        assert_eq!(cairn_device_destroy(device), CAIRN_OK);
        assert_eq!(cairn_swapchain_destroy(null_mut()), CAIRN_OK);
    }
    assert_eq!(double.violations(), [""; 0]);
}

fn amd_s_own_swap_chain_works_through_the_c_interface() {
    let _alone = one_at_a_time();
    named(Path::new(amd_folder().expect("CAIRN_FFX_DIR names a folder")));
    for how in [How::Wrap, How::Create, How::ForWindow] {
        let options = sized!(cairn_swapchain_options { provider: CAIRN_FSR_ANY });
        let mut host = Host::new(how, Some(&options));
        (0..4).for_each(|_| host.next());
        assert_eq!(host.frame(None), CAIRN_OK);
        // SAFETY: a handle of ours.
        assert_eq!(unsafe { cairn_swapchain_wait(host.swapchain) }, CAIRN_OK);
        let figures = host.statistics();
        println!("{how:?}: {}, {} bytes", text_of(&figures.generator), figures.generator_bytes);
        assert_eq!((figures.generated, figures.repeated, figures.failed), (4, 1, 0));
        let held = host.dxgi();
        // SAFETY: as above.
        assert_eq!(unsafe { cairn_swapchain_destroy(host.swapchain) }, CAIRN_ERROR_BUSY);
        drop(held);
        host.end();
    }
}

/// The tests of this program.
pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = trials![
        always: a_host_presents_with_amd_s_swap_chain_from_every_source,
        a_host_s_frame_parameters_change_the_presented_frames,
        interface_pacing_pauses_and_resizes_reach_the_library,
        a_refused_swap_chain_is_returned_unchanged,
    ];
    trials.extend(trials![with_amd: amd_s_own_swap_chain_works_through_the_c_interface]);
    trials
}
