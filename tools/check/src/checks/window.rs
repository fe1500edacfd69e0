//! Presents in a window, and the times between them.

use std::ffi::c_void;
use std::sync::Arc;
use std::time::Instant;

use cairn::Colours;
use cairn::gpu::Target;
use cairn::gpu::windows::Win32::Foundation::HWND;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_PRESENT, ID3D12Resource};
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::*;
use cairn::gpu::windows::core::Interface as _;
use cairn::present::device::{DeviceDrawer, Preparation};
use cairn::present::presenter::Presenter;
use cairn::world::{GuidanceSource, KeptAnchor};
use gpu_testing::presenters::{INTERVAL, constant_motion, options};

use super::times::{figures_of, place_at, statistics};
use super::{DRIVER, Settings};
use crate::finding::{Checked, Finding};

const SIZE: (u32, u32) = (640, 360);
/// Pixels by which the picture moves from anchor to anchor.
const STEP: u32 = 8;
/// Presents that are not measured: the swap chain fills its queue.
const WARM_UP: usize = 20;
/// Longest interval that is no fault, in medians.
const LATE: f64 = 1.5;

#[link(name = "user32")]
unsafe extern "system" {
    fn CreateWindowExW(
        style_too: u32,
        class: *const u16,
        name: *const u16,
        style: u32,
        x: i32,
        y: i32,
        width: i32,
        height: i32,
        parent: *mut c_void,
        menu: *mut c_void,
        module: *mut c_void,
        parameter: *mut c_void,
    ) -> *mut c_void;
    fn DestroyWindow(window: *mut c_void) -> i32;
    fn PeekMessageW(message: *mut Message, window: *mut c_void, first: u32, last: u32, remove: u32) -> i32;
    fn DispatchMessageW(message: *const Message) -> isize;
}

/// `MSG`.
#[repr(C)]
struct Message {
    window: *mut c_void,
    kind: u32,
    parameters: [usize; 2],
    time: u32,
    point: [i32; 2],
}

/// A window of this thread.
struct Window(HWND);

impl Window {
    fn open() -> Option<Self> {
        let text = |text: &str| text.encode_utf16().chain([0]).collect::<Vec<_>>();
        let (class, name) = (text("STATIC"), text("cairn-check: presents"));
        let none = std::ptr::null_mut();
        let (width, height) = (SIZE.0.cast_signed(), SIZE.1.cast_signed());
        // WS_POPUP and WS_VISIBLE: what is inside is all of it.
        const STYLE: u32 = 0x9000_0000;
        // SAFETY: texts that end with zeroes and live during the call.
        let made = unsafe {
            CreateWindowExW(0, class.as_ptr(), name.as_ptr(), STYLE, 40, 40, width, height, none, none, none, none)
        };
        (!made.is_null()).then_some(Self(HWND(made)))
    }

    /// Handles the messages that have come, so that the system does not take the window for hung.
    fn handle_messages(&self) {
        let mut message = Message { window: std::ptr::null_mut(), kind: 0, parameters: [0; 2], time: 0, point: [0; 2] };
        // SAFETY: memory for a message; a window of this thread.
        while unsafe { PeekMessageW(&mut message, std::ptr::null_mut(), 0, 0, 1) } != 0 {
            // SAFETY: the message that was just written.
            unsafe { DispatchMessageW(&message) };
        }
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        // SAFETY: a window of this thread, whose swap chain was released.
        unsafe { DestroyWindow(self.0.0) };
    }
}

/// Presents generated frames at each refresh of the display.
pub(super) fn presents(settings: &Settings) -> Checked {
    let gpu = settings.gpu()?;
    let count = match settings.quick {
        true if settings.emulation(&gpu).is_some() => 30,
        true => 60,
        false => 480,
    };
    let no_display = |what: String| Finding::cannot_tell(what, "Run it in a session with a display");
    let window = Window::open().ok_or_else(|| no_display("No window can be opened".to_owned()))?;
    let chain = swap_chain(&gpu, &window).map_err(|e| no_display(format!("The window has no swap chain: {e}")))?;
    let presenter = Presenter::new(options(GuidanceSource::PictureFlow), None)?;
    let mut drawer = DeviceDrawer::new(&gpu, SIZE, Colours::Srgb)?;
    presenter.prepare(&mut drawer, &Preparation::new(SIZE))?;
    let push = |number: u64, now: u64| -> cairn::Result<bool> {
        let picture = place_at(SIZE, STEP * number as u32)?;
        let guidance = (number > 0).then(|| constant_motion(SIZE, STEP as f32));
        presenter.push(Arc::new(KeptAnchor::of_picture(picture, number, false)), guidance, now)
    };
    let (start, mut number) = (Instant::now(), 0);
    let (mut ends, mut generated) = (Vec::new(), 0_usize);
    for _ in 0..count + WARM_UP {
        window.handle_messages();
        let now = start.elapsed().as_nanos() as u64;
        while number * INTERVAL <= now {
            push(number, now)?;
            number += 1;
        }
        // SAFETY: a live swap chain.
        let index = unsafe { chain.GetCurrentBackBufferIndex() };
        // SAFETY: as above, and one of its buffers.
        let texture: ID3D12Resource =
            unsafe { chain.GetBuffer(index) }.map_err(|e| Finding::fail(format!("A buffer: {e}"), DRIVER))?;
        let state = D3D12_RESOURCE_STATE_PRESENT;
        let target = Target { texture, before: state, after: state };
        if let Some((_, done)) = presenter.submit(now, &mut drawer, &target)?.made() {
            generated += 1;
            done.wait()?;
        }
        // SAFETY: a live swap chain, whose buffer is in the state PRESENT.
        unsafe { chain.Present(1, DXGI_PRESENT(0)) }
            .ok()
            .map_err(|e| Finding::fail(format!("A present: {e}"), DRIVER))?;
        ends.push(start.elapsed().as_secs_f64() * 1e3);
    }
    drop(drawer);
    drop(chain);
    let intervals: Vec<f64> = ends[WARM_UP..].windows(2).map(|pair| pair[1] - pair[0]).collect();
    let [median, most, longest] = statistics(&intervals);
    let late = intervals.iter().filter(|interval| **interval > LATE * median).count();
    let sentence = format!(
        "{generated} frames in a window: from present to present {median:.2} ms in the median, {most:.2} ms in 99 of 100, {longest:.2} ms at most; {late} of {} are \
         later than {LATE} medians",
        intervals.len()
    );
    // In a window other programs take a refresh now and then.
    let is_even = late * 50 <= intervals.len();
    let remedy = "Close other programs that draw, and run it again; if it stays so, send this report";
    let finding = Finding::judge(is_even, sentence, remedy)
        .figures(figures_of("from present to present", &intervals))
        .figure("later than 1.5 medians", late as f64, "presents");
    Ok(settings.about_times(&gpu, finding))
}

fn swap_chain(gpu: &cairn::gpu::Gpu, window: &Window) -> Result<IDXGISwapChain3, cairn::gpu::windows::core::Error> {
    // SAFETY: no flags.
    let factory: IDXGIFactory2 = unsafe { CreateDXGIFactory2(DXGI_CREATE_FACTORY_FLAGS(0)) }?;
    let wanted = DXGI_SWAP_CHAIN_DESC1 {
        Width: SIZE.0,
        Height: SIZE.1,
        Format: DXGI_FORMAT_R8G8B8A8_UNORM,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        BufferUsage: DXGI_USAGE_RENDER_TARGET_OUTPUT,
        BufferCount: 3,
        SwapEffect: DXGI_SWAP_EFFECT_FLIP_DISCARD,
        ..Default::default()
    };
    // SAFETY: live objects, and a description that lives during the call.
    let chain = unsafe { factory.CreateSwapChainForHwnd(gpu.frames().d3d12(), window.0, &wanted, None, None) }?;
    chain.cast()
}
