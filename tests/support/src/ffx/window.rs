//! A window for presents, the pattern shown in it, and the presents that the double recorded.

use std::ffi::c_void;
use std::sync::{Mutex, MutexGuard, PoisonError};

use cairn::ffx::bindings::Dimensions;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Foundation::HWND;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::*;
use cairn::gpu::windows::core::Interface as _;

use super::double_folder::DoubleFolder;
use super::frame_textures::Textures;
use crate::d3d12::engine::Engine;

/// Size of the window, in pixels.
pub const SIZE: Dimensions = Dimensions { width: 128, height: 96 };
/// Motion of the picture from frame to frame, in pixels to the right.
pub const STEP: i32 = 16;
/// Columns that are inside the picture in every frame.
pub const INNER: std::ops::Range<u32> = 32..96;
/// The resting state of a swap chain's buffer.
pub const PRESENT: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_PRESENT;

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
}

/// Runs one test at a time: a window that opens or closes notifies the foreground window and waits for its thread, which handles no
/// messages while it waits for the device.
pub fn one_at_a_time() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A window without a message loop: it gets no input.
pub struct Window(pub HWND);

impl Window {
    /// Opens a window.
    pub fn open() -> Self {
        let text = |text: &str| text.encode_utf16().chain([0]).collect::<Vec<_>>();
        let (class, name) = (text("STATIC"), text("frames"));
        let nothing = std::ptr::null_mut();
        let (width, height) = (SIZE.width.cast_signed(), SIZE.height.cast_signed());
        // WS_OVERLAPPEDWINDOW and WS_VISIBLE.
        const STYLE: u32 = 0x10cf_0000;
        // SAFETY: texts that end with zeroes and live during the call.
        let made = unsafe {
            CreateWindowExW(
                0,
                class.as_ptr(),
                name.as_ptr(),
                STYLE,
                0,
                0,
                width,
                height,
                nothing,
                nothing,
                nothing,
                nothing,
            )
        };
        assert!(!made.is_null(), "a window");
        Self(HWND(made))
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        // SAFETY: a window of this thread, which nothing uses any more.
        unsafe { DestroyWindow(self.0.0) };
    }
}

/// DXGI's factory.
pub fn factory() -> IDXGIFactory2 {
    // SAFETY: no flags.
    unsafe { CreateDXGIFactory2(DXGI_CREATE_FACTORY_FLAGS(0)) }.expect("a factory")
}

/// An engine's swap chain description.
pub fn description() -> DXGI_SWAP_CHAIN_DESC1 {
    DXGI_SWAP_CHAIN_DESC1 {
        Width: SIZE.width,
        Height: SIZE.height,
        Format: DXGI_FORMAT_R8G8B8A8_UNORM,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        BufferUsage: DXGI_USAGE_RENDER_TARGET_OUTPUT,
        BufferCount: 3,
        SwapEffect: DXGI_SWAP_EFFECT_FLIP_DISCARD,
        ..Default::default()
    }
}

/// A swap chain of the engine's own, without AMD's libraries.
pub fn of_engine(engine: &Engine, window: &Window) -> IDXGISwapChain4 {
    // SAFETY: live objects, and a description that lives during the call.
    let made = unsafe { factory().CreateSwapChainForHwnd(&engine.direct, window.0, &description(), None, None) };
    made.expect("a swap chain").cast().expect("a newer one")
}

/// A smooth pattern that does not repeat, moved to the right by `by` pixels.
pub fn moved(by: i32) -> impl Fn(u32, u32) -> [u8; 4] {
    let wave = |phase: f32| (128.0 + 90.0 * phase.sin()) as u8;
    move |x, y| {
        let (x, y) = ((x.cast_signed() - by) as f32, y as f32);
        [wave(x * 0.11), wave(y * 0.13 + x * 0.05), wave(x * 0.07 - y * 0.09), 255]
    }
}

/// Textures with depth and motion of the pattern.
pub fn panning(gpu: &Gpu, size: Dimensions) -> Textures {
    let textures = Textures::new(gpu, size);
    textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
    let [x, y] = [-STEP as f32, 0.0].map(|v| half::f16::from_f32(v).to_le_bytes());
    textures.fill(&textures.motion, |_, _| [x[0], x[1], y[0], y[1]]);
    textures
}

/// The recorded presents, one line each: number, kind and frame id.
pub fn shown(double: &DoubleFolder) -> Vec<String> {
    let text = std::fs::read_to_string(double.0.join("shown.txt")).unwrap_or_default();
    text.lines().map(str::to_owned).collect()
}

/// The pixels of a present.
pub fn pixels(double: &DoubleFolder, number: usize) -> Vec<[u8; 4]> {
    let bytes = std::fs::read(double.0.join(format!("shown-{number}.rgba"))).expect("it was shown");
    bytes.as_chunks::<4>().0.to_vec()
}

/// Maximum difference of a colour channel in the inner columns.
pub fn off(found: &[[u8; 4]], wanted: impl Fn(u32, u32) -> [u8; 4]) -> u8 {
    let places = (0..SIZE.height).flat_map(|y| INNER.map(move |x| (x, y)));
    let apart = |(x, y): (u32, u32)| {
        let (a, b) = (found[(y * SIZE.width + x) as usize], wanted(x, y));
        a.into_iter().zip(b).take(3).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
    };
    places.map(apart).max().unwrap_or(0)
}
