//! AMD's swap chain on Windows.

use std::ffi::c_void;
use std::mem::ManuallyDrop;

use windows::Win32::Foundation::HWND;
use windows::Win32::Graphics::Direct3D12 as direct3d;
use windows::Win32::Graphics::Dxgi as dxgi;
use windows::core::{IUnknown, Interface as _};

use super::*;
use crate::abi::d3d12::backend::com_object;
use crate::abi::results::AbiResult;
use crate::abi::text::fixed_text;
use crate::ffx::bindings::{Dimensions, MemoryUsage};
pub(super) use crate::ffx::is_presenting_thread;
use crate::ffx::{
    Api, Effect, FrameTextures, Interface, Library, LoadOptions, Pacing, Swapchain, SwapchainOptions, SwapchainSource,
};
use crate::gpu::compute::ResourceWithState;
use crate::runtime::Device;

/// The object of a swap chain's handle.
pub(in crate::abi) struct SwapchainObject {
    swapchain: Swapchain,
    /// Keeps AMD's modules loaded; dropped after the swap chain.
    _library: Library,
}

/// Wraps an engine's swap chain.
///
/// # Safety
/// `own` points to null or to a swap chain with a reference of the caller's; it becomes null when that reference is gone.
pub(super) unsafe fn wrap(
    device: &Device,
    options: &cairn_swapchain_options,
    own: &mut *mut IDXGISwapChain,
) -> AbiResult<SwapchainObject> {
    let raw = *own;
    // SAFETY: the caller's promise.
    let mut engine_swapchain: Option<dxgi::IDXGISwapChain4> = Some(unsafe { com_object(raw.cast(), "own") }?);
    // SAFETY: the caller's reference. `engine_swapchain` has a second one now, which AMD's library requires to be the only one.
    drop(unsafe { IUnknown::from_raw(raw.cast()) });
    let made = make(device, options, SwapchainSource::Wrap(&mut engine_swapchain));
    match engine_swapchain {
        None => *own = std::ptr::null_mut(),
        Some(_) => {
            // SAFETY: kept alive by `engine_swapchain`. The caller gets back the reference that was dropped above.
            let alive = ManuallyDrop::new(unsafe { IUnknown::from_raw(raw.cast()) });
            std::mem::forget(IUnknown::clone(&alive));
        }
    }
    made
}

/// Makes a swap chain through the factory.
///
/// # Safety
/// `factory` is a COM object, and `description` can be read.
pub(super) unsafe fn create(
    device: &Device,
    options: &cairn_swapchain_options,
    factory: *mut IDXGIFactory,
    description: *const DXGI_SWAP_CHAIN_DESC,
) -> AbiResult<SwapchainObject> {
    // SAFETY: the caller's promise.
    let factory: dxgi::IDXGIFactory = unsafe { com_object(factory.cast(), "factory") }?;
    // SAFETY: the caller's promise.
    let description = unsafe { read_struct(description.cast::<dxgi::DXGI_SWAP_CHAIN_DESC>(), "description") }?;
    make(device, options, SwapchainSource::New(&factory, description))
}

/// Makes a swap chain for a window.
///
/// # Safety
/// `factory` is a COM object; the structs can be read, or `fullscreen` is null.
pub(super) unsafe fn create_for_window(
    device: &Device,
    options: &cairn_swapchain_options,
    factory: *mut IDXGIFactory,
    window: *mut c_void,
    description: *const DXGI_SWAP_CHAIN_DESC1,
    fullscreen: *const DXGI_SWAP_CHAIN_FULLSCREEN_DESC,
) -> AbiResult<SwapchainObject> {
    // SAFETY: the caller's promise.
    let factory: dxgi::IDXGIFactory = unsafe { com_object(factory.cast(), "factory") }?;
    // SAFETY: the caller's promise.
    let description = unsafe { read_struct(description.cast::<dxgi::DXGI_SWAP_CHAIN_DESC1>(), "description") }?;
    let fullscreen = fullscreen.cast::<dxgi::DXGI_SWAP_CHAIN_FULLSCREEN_DESC>();
    let fullscreen = match fullscreen.is_null() {
        true => None,
        // SAFETY: the caller's promise.
        false => Some(unsafe { read_struct(fullscreen, "fullscreen") }?),
    };
    make(device, options, SwapchainSource::ForWindow(&factory, HWND(window), description, fullscreen))
}

/// Reads one of DXGI's structs; a misaligned pointer is an error.
///
/// # Safety
/// `from` is not null, and can be read if it is aligned.
unsafe fn read_struct<T: Copy>(from: *const T, name: &str) -> AbiResult<T> {
    check_out(from.cast_mut(), name)?;
    // SAFETY: aligned, and the caller's promise.
    Ok(unsafe { from.read() })
}

fn make(device: &Device, options: &cairn_swapchain_options, from: SwapchainSource<'_>) -> AbiResult<SwapchainObject> {
    let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
    let options = swapchain_options(options)?;
    let library = Library::load(&LoadOptions::of_host(device.library_search()))?;
    let api: Api = *library.api(Effect::FrameGeneration)?;
    Ok(SwapchainObject { swapchain: Swapchain::new(gpu, &api, &options, from)?, _library: library })
}

fn swapchain_options(options: &cairn_swapchain_options) -> AbiResult<SwapchainOptions> {
    let (width, height) = (options.max_render_width, options.max_render_height);
    Ok(SwapchainOptions {
        choice: convert::choice(options.provider),
        max_render_size: (width > 0).then_some(Dimensions { width, height }),
        flags: convert::flags(options.flags),
        hudless: convert::hudless(options.hudless_format)?,
        self_test: options.flags & CAIRN_SWAPCHAIN_UNTRIED == 0,
    })
}

/// A host's texture with its resource state; `None` for a null pointer.
type TextureWithState = Option<(direct3d::ID3D12Resource, direct3d::D3D12_RESOURCE_STATES)>;

/// # Safety
/// A pointer that is not null is a COM object that lives during the call.
unsafe fn texture_with_state(texture: *mut ID3D12Resource, state: u32, name: &str) -> AbiResult<TextureWithState> {
    if texture.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's promise.
    let texture = unsafe { com_object(texture.cast(), name) }?;
    Ok(Some((texture, direct3d::D3D12_RESOURCE_STATES(state.cast_signed()))))
}

fn resource_with_state(texture: &TextureWithState) -> Option<ResourceWithState<'_>> {
    texture.as_ref().map(|(resource, state)| ResourceWithState { resource, state: *state })
}

impl SwapchainObject {
    /// The DXGI swap chain, with a new reference that the caller releases.
    pub(super) fn dxgi(&self) -> *mut IDXGISwapChain4 {
        self.swapchain.dxgi().clone().into_raw().cast()
    }

    pub(super) fn external_references(&self) -> u32 {
        self.swapchain.external_references()
    }

    /// # Safety
    /// Pointers in `list` and `frame` are null or COM objects, and live as long as the header demands.
    pub(super) unsafe fn prepare(
        &mut self,
        list: *mut ID3D12GraphicsCommandList,
        frame: &cairn_swapchain_frame,
    ) -> AbiResult<()> {
        // SAFETY: the caller's promise.
        let list: direct3d::ID3D12GraphicsCommandList = unsafe { com_object(list.cast(), "list") }?;
        // SAFETY: the caller's promise.
        let [depth, motion, hudless, distortion] = unsafe {
            [
                texture_with_state(frame.depth, frame.depth_state, "frame.depth")?,
                texture_with_state(frame.motion, frame.motion_state, "frame.motion")?,
                texture_with_state(frame.hudless, frame.hudless_state, "frame.hudless")?,
                texture_with_state(frame.distortion, frame.distortion_state, "frame.distortion")?,
            ]
        };
        let missing = |name| move || Failure::argument(name, "a null pointer");
        let textures = FrameTextures {
            depth: resource_with_state(&depth).ok_or_else(missing("frame.depth"))?,
            motion: resource_with_state(&motion).ok_or_else(missing("frame.motion"))?,
            hudless: resource_with_state(&hudless),
            distortion: resource_with_state(&distortion),
        };
        Ok(self.swapchain.prepare(&list, &textures, &convert::frame_params(frame))?)
    }

    /// # Safety
    /// A pointer that is not null is a COM object that lives during the call.
    pub(super) unsafe fn set_interface(
        &mut self,
        picture: *mut ID3D12Resource,
        state: u32,
        flags: u32,
    ) -> AbiResult<()> {
        // SAFETY: the caller's promise.
        let picture = unsafe { texture_with_state(picture, state, "picture") }?;
        let interface = resource_with_state(&picture).map(|picture| Interface {
            picture,
            premultiplied: flags & CAIRN_INTERFACE_PREMULTIPLIED != 0,
            copied: flags & CAIRN_INTERFACE_COPIED != 0,
        });
        Ok(self.swapchain.set_interface(interface)?)
    }

    pub(super) fn set_pacing(&mut self, pacing: Option<&cairn_swapchain_pacing>) -> AbiResult<()> {
        let pacing = pacing.map_or_else(Pacing::default, |pacing| Pacing {
            safety_margin_ms: pacing.safety_margin_ms,
            variance_factor: pacing.variance_factor,
            hybrid_spin: (pacing.flags & CAIRN_PACING_HYBRID_SPIN != 0).then_some(pacing.spin_ticks),
            wait_on_fence: pacing.flags & CAIRN_PACING_WAIT_ON_FENCE != 0,
        });
        Ok(self.swapchain.set_pacing(&pacing)?)
    }

    pub(super) fn pause(&mut self) -> AbiResult<()> {
        Ok(self.swapchain.pause()?)
    }

    pub(super) fn wait(&mut self) -> AbiResult<()> {
        Ok(self.swapchain.wait()?)
    }

    pub(super) fn fit(&mut self) -> AbiResult<()> {
        Ok(self.swapchain.fit()?)
    }

    pub(super) fn statistics(&mut self) -> AbiResult<cairn_swapchain_statistics> {
        let memory = self.swapchain.memory()?;
        let bytes = |usage: Option<MemoryUsage>| usage.map_or((0, 0), |usage| (usage.total, usage.aliasable));
        let ((generator_bytes, generator_aliasable_bytes), (swapchain_bytes, swapchain_aliasable_bytes)) =
            (bytes(memory.generator), bytes(memory.swapchain));
        let generator = self.swapchain.provider().map_or_else(|_| String::new(), |found| found.version.to_string());
        Ok(cairn_swapchain_statistics {
            struct_size: 0,
            failed: self.swapchain.failed().map_or(0, |code| code.0),
            generated: self.swapchain.generated(),
            generator_bytes,
            generator_aliasable_bytes,
            swapchain_bytes,
            swapchain_aliasable_bytes,
            generator: fixed_text(&generator),
            pacer: fixed_text(&self.swapchain.pacer().version.to_string()),
            repeated: self.swapchain.repeated(),
        })
    }
}
