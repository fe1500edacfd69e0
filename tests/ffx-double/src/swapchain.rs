//! A swap chain that presents generated frames between the host's own, as AMD's does. The host draws into separate textures, and
//! `Present` composes the shown pictures from them. Each present is kept: a line in `shown.txt`, and its pixels in `shown-N.rgba`.
//!
//! Unlike AMD's it is slow and simple: it waits for each frame, and the CPU composites the interface. As AMD's does, by its published source (SDK
//! 2.1, `FrameInterpolationSwapchainDX12.cpp`), it asks for a frame at each `Present`, shows the output whatever the callback returns, and forgets a
//! copied interface. The test `amd_s_own_swap_chain_presents_generated_frames` finds the first and the last of these in AMD's own library.

use std::ffi::c_void;
use std::io::Write;
use std::mem::ManuallyDrop;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use windows::Win32::Foundation::HWND;
use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;
use windows::Win32::Graphics::Dxgi::*;
use windows::core::{GUID, IUnknown, Interface, Result};

use crate::OK;
use crate::config::Sdk;
use crate::field_access::{get, put};
use crate::generation::texture_arg;
use crate::library::Library;
use crate::proxy::Proxy;
use crate::shader_work::{TextureArg, committed, state, transition};

/// Resting state of the host's buffers.
const REST: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COMMON;
/// Resting state of the generated texture, as AMD's swap chain has it.
const GENERATED_REST: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;
/// ffx-api's value for the presentation state.
const PRESENT: u32 = 128;
const WRITTEN: u32 = 2;
const BUFFERS: u32 = 3;

/// The host's generation callback: the struct and the user data.
type Generate = unsafe extern "C" fn(*mut u8, *mut c_void) -> u32;

/// The parts of a generator's configure call that concern its swap chain.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settings {
    pub(crate) generate: Option<Generate>,
    pub(crate) user: *mut c_void,
    pub(crate) enabled: bool,
    pub(crate) rect: [i32; 4],
    pub(crate) frame: u64,
    /// Address of the generator's context.
    pub(crate) by: usize,
}

// SAFETY: addresses that belong to the host.
unsafe impl Send for Settings {}

/// The fake swap chain.
pub(crate) struct FakeSwapchain {
    pub(crate) real: IDXGISwapChain4,
    pub(crate) device: ID3D12Device,
    queue: ID3D12CommandQueue,
    folder: PathBuf,
    pub(crate) flags: DXGI_SWAP_CHAIN_FLAG,
    state: Mutex<PresentState>,
}

/// Its changing state.
pub(crate) struct PresentState {
    /// The host's buffers and the generated texture; recreated for another size.
    pub(crate) buffers: Vec<ID3D12Resource>,
    pub(crate) generated: ID3D12Resource,
    pub(crate) next: u32,
    settings: Option<Settings>,
    /// No frame was generated since generation was turned on.
    starts: bool,
    interface: Option<InterfaceArg>,
    /// Number of presents of the real swap chain.
    pub(crate) shown: u64,
    /// The host has waited for pending presents since generation was turned on or off.
    waited: bool,
}

// SAFETY: objects of Direct3D 12 and DXGI, and addresses that belong to the host.
unsafe impl Send for PresentState {}

/// The context's part of the swap chain.
pub(crate) struct SwapchainContext {
    pub(crate) swapchain: Arc<FakeSwapchain>,
    proxy: Option<IDXGISwapChain4>,
}

/// All swap chains, by the address that configure calls use.
static ALL: Mutex<Vec<(usize, Arc<FakeSwapchain>)>> = Mutex::new(Vec::new());

/// The swap chain at an address.
pub(crate) fn find_by_address(address: usize) -> Option<Arc<FakeSwapchain>> {
    let all = ALL.lock().unwrap_or_else(PoisonError::into_inner);
    all.iter().find(|(known, _)| *known == address).map(|(_, swapchain)| swapchain.clone())
}

/// Takes over a swap chain, or creates one; rule violations are added to `faults`.
///
/// # Safety
/// A struct of that id with valid objects.
pub(crate) unsafe fn make(
    id: u64,
    head: *const u8,
    sdk: Sdk,
    folder: PathBuf,
    faults: &mut Vec<String>,
) -> Option<(SwapchainContext, *mut c_void)> {
    // SAFETY: fields of the struct, here and below.
    let pointer = unsafe { get::<*mut *mut c_void>(head, 16) };
    if pointer.is_null() {
        faults.push("there is no place for the swap chain".to_owned());
        return None;
    }
    let queue_at = match id {
        0x3_0001 => 24,
        0x3_0005 => 40,
        _ => 56,
    };
    // SAFETY: as above; null or objects of COM.
    let queue = unsafe { object::<ID3D12CommandQueue>(get(head, queue_at)) };
    let Some(queue) = queue else {
        faults.push("there is no queue".to_owned());
        return None;
    };
    // SAFETY: a live queue.
    if unsafe { queue.GetDesc() }.Type != D3D12_COMMAND_LIST_TYPE_DIRECT {
        faults.push("the queue is not direct".to_owned());
    }
    // SAFETY: as above.
    let wanted = unsafe {
        match id {
            0x3_0001 => take_over(*pointer, faults),
            0x3_0005 => window_and_desc(get(head, 24)).zip(object(get(head, 32))),
            _ => {
                let (window, desc) = (get::<*mut c_void>(head, 24), get::<*const DXGI_SWAP_CHAIN_DESC1>(head, 32));
                let desc = (!desc.is_null() && !window.is_null()).then(|| (HWND(window), *desc));
                let fullscreen = get::<*const DXGI_SWAP_CHAIN_FULLSCREEN_DESC>(head, 40);
                if !fullscreen.is_null()
                    && !(*fullscreen).Windowed.as_bool()
                    && (*fullscreen).RefreshRate.Denominator != 0
                {
                    faults.push("it is full screen".to_owned());
                }
                desc.zip(object(get(head, 48)))
            }
        }
    };
    let Some(((window, desc), factory)) = wanted else {
        faults.push("there is no description, window or factory".to_owned());
        return None;
    };
    // AMD's swap chain reads or writes past its arrays with another number of buffers.
    if desc.Width == 0 || desc.Height == 0 || !(2..=sdk.most_buffers()).contains(&desc.BufferCount) {
        faults.push(format!("{} buffers of {} x {}", desc.BufferCount, desc.Width, desc.Height));
        return None;
    }
    match FakeSwapchain::new(&factory, window, &desc, queue, folder) {
        Ok(swapchain) => {
            let swapchain = Arc::new(swapchain);
            let proxy: IDXGISwapChain4 = Proxy { swapchain: swapchain.clone() }.into();
            let address = proxy.as_raw() as usize;
            ALL.lock().unwrap_or_else(PoisonError::into_inner).push((address, swapchain.clone()));
            let for_host = proxy.clone().into_raw();
            // SAFETY: the host's memory.
            unsafe { *pointer = for_host };
            Some((SwapchainContext { swapchain, proxy: Some(proxy) }, for_host))
        }
        Err(e) => {
            // The host can do nothing about a removed device.
            if e.code() != DXGI_ERROR_DEVICE_REMOVED {
                faults.push(format!("the swap chain cannot be made: {e}"));
            }
            None
        }
    }
}

/// A window, the description of its swap chain, and the factory.
type Wanted = ((HWND, DXGI_SWAP_CHAIN_DESC1), IDXGIFactory);

/// Reads the description of the host's swap chain, and releases it.
unsafe fn take_over(swapchain: *mut c_void, faults: &mut Vec<String>) -> Option<Wanted> {
    if swapchain.is_null() {
        return None;
    }
    // SAFETY: the caller's object, whose reference is taken.
    let given = unsafe { IUnknown::from_raw(swapchain) };
    let swapchain: IDXGISwapChain4 = given.cast().ok()?;
    drop(given);
    // SAFETY: a live swap chain.
    unsafe {
        let (desc, window) = (swapchain.GetDesc1().ok()?, swapchain.GetHwnd().ok()?);
        if !swapchain.GetFullscreenDesc().ok()?.Windowed.as_bool() {
            faults.push("it is full screen".to_owned());
        }
        let factory: IDXGIFactory = swapchain.GetParent().ok()?;
        let left = release_count(swapchain);
        if left > 0 {
            faults.push(format!("{left} references to the swap chain are left"));
        }
        Some(((window, desc), factory))
    }
}

/// The window of a description, and the description as `DXGI_SWAP_CHAIN_DESC1`.
unsafe fn window_and_desc(desc: *const DXGI_SWAP_CHAIN_DESC) -> Option<(HWND, DXGI_SWAP_CHAIN_DESC1)> {
    // SAFETY: null or a description, by the caller's promise.
    let desc = unsafe { desc.as_ref() }?;
    let made = DXGI_SWAP_CHAIN_DESC1 {
        Width: desc.BufferDesc.Width,
        Height: desc.BufferDesc.Height,
        Format: desc.BufferDesc.Format,
        SampleDesc: desc.SampleDesc,
        BufferUsage: desc.BufferUsage,
        BufferCount: desc.BufferCount,
        SwapEffect: desc.SwapEffect,
        Flags: desc.Flags,
        ..Default::default()
    };
    (!desc.OutputWindow.is_invalid()).then_some((desc.OutputWindow, made))
}

/// Queries another interface of a COM object, if it is not null; the caller keeps its reference.
unsafe fn object<I: Interface>(pointer: *mut c_void) -> Option<I> {
    // SAFETY: the caller's promise.
    unsafe { IUnknown::from_raw_borrowed(&pointer) }.and_then(|object| object.cast().ok())
}

/// Releases a reference; returns the remaining count.
pub(crate) fn release_count<I: Interface>(object: I) -> u32 {
    let raw = object.into_raw();
    // SAFETY: the reference that was handed over; every interface of COM starts with IUnknown's functions.
    unsafe { ((*(*raw.cast::<*const windows::core::IUnknown_Vtbl>())).Release)(raw) }
}

impl FakeSwapchain {
    fn new(
        factory: &IDXGIFactory,
        window: HWND,
        desc: &DXGI_SWAP_CHAIN_DESC1,
        queue: ID3D12CommandQueue,
        folder: PathBuf,
    ) -> Result<Self> {
        let mut device: Option<ID3D12Device> = None;
        // SAFETY: live objects, valid memory for results, and a description that lives during the call.
        unsafe {
            queue.GetDevice(&mut device)?;
            let device = device.ok_or_else(windows::core::Error::empty)?;
            let wanted =
                DXGI_SWAP_CHAIN_DESC1 { BufferCount: BUFFERS, SwapEffect: DXGI_SWAP_EFFECT_FLIP_DISCARD, ..*desc };
            let factory: IDXGIFactory2 = factory.cast()?;
            let real: IDXGISwapChain4 = factory.CreateSwapChainForHwnd(&queue, window, &wanted, None, None)?.cast()?;
            let (buffers, generated) = textures(&device, desc.BufferCount, desc)?;
            let now = PresentState {
                buffers,
                generated,
                next: 0,
                settings: None,
                starts: true,
                interface: None,
                shown: 0,
                waited: true,
            };
            let flags = DXGI_SWAP_CHAIN_FLAG(desc.Flags as i32);
            Ok(Self { real, device, queue, folder, flags, state: Mutex::new(now) })
        }
    }

    pub(crate) fn state(&self) -> MutexGuard<'_, PresentState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The display size and format.
    pub(crate) fn shown(&self) -> ([u32; 2], DXGI_FORMAT) {
        // SAFETY: a live texture.
        let desc = unsafe { self.state().generated.GetDesc() };
        ([desc.Width as u32, desc.Height], desc.Format)
    }

    /// Applies a generator's configure call; returns a rule violation, if any.
    pub(crate) fn apply(&self, settings: Settings) -> Option<String> {
        let mut now = self.state();
        let before = now.settings.replace(settings);
        if before.is_none_or(|before| before.enabled != settings.enabled) {
            (now.starts, now.waited) = (true, false);
        }
        (settings.enabled && settings.generate.is_none()).then(|| "nobody generates frames".to_owned())
    }

    /// Sets the interface drawn over frames.
    pub(crate) fn set_interface(&self, interface: Option<InterfaceArg>) {
        self.state().interface = interface;
    }

    /// The wait call; presents here are synchronous, so there is nothing to wait for.
    pub(crate) fn wait(&self) {
        self.state().waited = true;
    }

    /// Removes the generator of a destroyed context; returns a rule violation, if any.
    pub(crate) fn remove_generator(&self, context: usize) -> Option<String> {
        let mut now = self.state();
        let settings = now.settings.filter(|settings| settings.by == context)?;
        let (enabled, waited) = (settings.enabled, now.waited);
        now.settings = None;
        match (enabled, waited) {
            (true, _) => Some("its swap chain still generates frames".to_owned()),
            (false, false) => Some("it was not waited for what its swap chain is to show".to_owned()),
            (false, true) => None,
        }
    }

    /// Whether a generator is still configured.
    fn has_generator(&self) -> bool {
        self.state().settings.is_some()
    }

    /// Presents one frame of the host's.
    pub(crate) fn present(&self, sync: u32, flags: DXGI_PRESENT) -> Result<()> {
        if flags.contains(DXGI_PRESENT_TEST) {
            // SAFETY: a live swap chain.
            return unsafe { self.real.Present(sync, flags) }.ok();
        }
        let (settings, color, generated, starts) = {
            let now = self.state();
            (now.settings, now.buffers[now.next as usize].clone(), now.generated.clone(), now.starts)
        };
        if let Some(settings) = settings.filter(|settings| settings.enabled)
            // Also where the host has not prepared this frame: with the id of the last one.
            && let Some((code, list)) = self.generate(&settings, &color, &generated, starts)?
        {
            if code == OK {
                self.run(&list)?;
            } else {
                // As AMD's swap chain does.
                let why = "the callback failed, so its list stays open, and its output is shown as it is";
                Library::handle("present", |library| library.report_violation("present", why, OK));
            }
            self.state().starts = false;
            self.show((&generated, GENERATED_REST), "generated", settings.frame)?;
        }
        self.show((&color, REST), "real", settings.map_or(0, |settings| settings.frame))?;
        let mut now = self.state();
        now.next = (now.next + 1) % now.buffers.len() as u32;
        // AMD's swap chain copies it once, and forgets it.
        now.interface = now.interface.filter(|interface| !interface.copied);
        Ok(())
    }

    /// Calls the host's generation callback, if there is one; returns its code and the list.
    fn generate(
        &self,
        settings: &Settings,
        color: &ID3D12Resource,
        generated: &ID3D12Resource,
        starts: bool,
    ) -> Result<Option<(u32, ID3D12GraphicsCommandList)>> {
        let Some(generate) = settings.generate else { return Ok(None) };
        let list = self.list()?;
        let mut request = [0_u64; 39];
        let head = request.as_mut_ptr().cast::<u8>();
        // SAFETY: fields of the struct, which has 312 bytes.
        unsafe {
            put(head, 0, 0x2_0003_u64);
            put(head, 16, list.as_raw());
            for (at, resource, state) in [(24, color, PRESENT), (72, generated, WRITTEN)] {
                let desc = resource.GetDesc();
                let format = if desc.Format == DXGI_FORMAT_R8G8B8A8_UNORM { 10_u32 } else { 4 };
                put(head, at, resource.as_raw());
                // Usage flags: 2 for unordered access, 1 for a render target.
                let words = [2, format, desc.Width as u32, desc.Height, 1, 1, 0, 3_u32];
                for (index, word) in words.into_iter().enumerate() {
                    put(head, at + 8 + 4 * index, word);
                }
                put(head, at + 40, state);
            }
            put(head, 264, 1_u32);
            put(head, 268, u8::from(starts));
            put(head, 280, 100.0_f32);
            put(head, 284, settings.rect);
            put(head, 304, settings.frame);
        }
        // SAFETY: the host's function with its user data.
        let code = unsafe { generate(head, settings.user) };
        Ok(Some((code, list)))
    }

    /// Creates an open list.
    fn list(&self) -> Result<ID3D12GraphicsCommandList> {
        let kind = D3D12_COMMAND_LIST_TYPE_DIRECT;
        // SAFETY: a live device. The allocator is kept by the list.
        unsafe {
            let allocator: ID3D12CommandAllocator = self.device.CreateCommandAllocator(kind)?;
            let list: ID3D12GraphicsCommandList = self.device.CreateCommandList(0, kind, &allocator, None)?;
            list.SetPrivateDataInterface(&GUID::from_u128(0x0063_6169_726e), &allocator)?;
            Ok(list)
        }
    }

    /// Runs a list, and waits for it.
    fn run(&self, list: &ID3D12GraphicsCommandList) -> Result<()> {
        // SAFETY: live objects of one device.
        unsafe {
            list.Close()?;
            self.queue.ExecuteCommandLists(&[Some(list.cast()?)]);
            let fence: ID3D12Fence = self.device.CreateFence(0, D3D12_FENCE_FLAG_NONE)?;
            self.queue.Signal(&fence, 1)?;
            while fence.GetCompletedValue() == 0 {
                std::thread::yield_now();
            }
            self.device.GetDeviceRemovedReason()
        }
    }

    /// Presents a picture, which rests in a state, with the interface drawn over it.
    fn show(&self, picture: (&ID3D12Resource, D3D12_RESOURCE_STATES), what: &str, frame: u64) -> Result<()> {
        let mut pixels = self.read(picture.0, picture.1)?;
        let interface = self.state().interface;
        if let Some(InterfaceArg { arg, premultiplied, .. }) = interface
            // SAFETY: checked to be a resource, which the host keeps until it sets another.
            && let Some(resource) = unsafe { ID3D12Resource::from_raw_borrowed(&arg.pointer) }
        {
            for (under, over) in pixels.iter_mut().zip(self.read(resource, state(arg.state))?) {
                let alpha = f32::from(over[3]) / 255.0;
                for channel in 0..3 {
                    let own = if premultiplied { 1.0 } else { alpha };
                    let mixed = f32::from(over[channel]) * own + f32::from(under[channel]) * (1.0 - alpha);
                    under[channel] = mixed.round().min(255.0) as u8;
                }
            }
        }
        let number = {
            let mut now = self.state();
            now.shown += 1;
            now.shown
        };
        let bytes: Vec<u8> = pixels.iter().flatten().copied().collect();
        let kept = std::fs::write(self.folder.join(format!("shown-{number}.rgba")), &bytes).and_then(|()| {
            let open = std::fs::OpenOptions::new().create(true).append(true).open(self.folder.join("shown.txt"));
            writeln!(open?, "{number} {what} {frame}")
        });
        if let Err(e) = kept {
            eprintln!("ffx-double: what is shown: {e}");
        }
        self.write(&pixels)?;
        // SAFETY: a live swap chain.
        unsafe { self.real.Present(0, DXGI_PRESENT(0)) }.ok()
    }

    /// Reads a texture back.
    fn read(&self, from: &ID3D12Resource, rests: D3D12_RESOURCE_STATES) -> Result<Vec<[u8; 4]>> {
        // SAFETY: a live texture.
        let desc = unsafe { from.GetDesc() };
        let (buffer, rows) = self.rows(&desc, D3D12_HEAP_TYPE_READBACK)?;
        let list = self.list()?;
        let copied = D3D12_RESOURCE_STATE_COPY_SOURCE;
        // SAFETY: an open list, and live resources in the stated states.
        unsafe {
            list.ResourceBarrier(&[transition(from, rests, copied)]);
            list.CopyTextureRegion(&placed(&buffer, rows), 0, 0, 0, &whole(from), None);
            list.ResourceBarrier(&[transition(from, copied, rests)]);
        }
        self.run(&list)?;
        let (width, height, pitch) = (desc.Width as usize, desc.Height as usize, rows.Footprint.RowPitch as usize);
        let mut pixels = Vec::with_capacity(width * height);
        let mut pointer = std::ptr::null_mut();
        // SAFETY: a readback buffer with that many rows of that many bytes.
        unsafe {
            buffer.Map(0, None, Some(&mut pointer))?;
            for y in 0..height {
                let row = std::slice::from_raw_parts(pointer.cast::<u8>().add(y * pitch), width * 4);
                pixels.extend(row.as_chunks::<4>().0);
            }
            buffer.Unmap(0, None);
        }
        Ok(pixels)
    }

    /// Writes pixels to the current back buffer of the real swap chain.
    fn write(&self, pixels: &[[u8; 4]]) -> Result<()> {
        // SAFETY: a live swap chain.
        let to: ID3D12Resource = unsafe { self.real.GetBuffer(self.real.GetCurrentBackBufferIndex()) }?;
        // SAFETY: a live texture.
        let desc = unsafe { to.GetDesc() };
        let (buffer, rows) = self.rows(&desc, D3D12_HEAP_TYPE_UPLOAD)?;
        let (width, pitch) = (desc.Width as usize, rows.Footprint.RowPitch as usize);
        let mut pointer = std::ptr::null_mut();
        // SAFETY: an upload buffer with room for these rows.
        unsafe {
            buffer.Map(0, None, Some(&mut pointer))?;
            for (y, row) in pixels.chunks_exact(width).enumerate() {
                std::ptr::copy_nonoverlapping(row.as_ptr(), pointer.cast::<u8>().add(y * pitch).cast(), width);
            }
            buffer.Unmap(0, None);
        }
        let list = self.list()?;
        let (rests, copied) = (D3D12_RESOURCE_STATE_PRESENT, D3D12_RESOURCE_STATE_COPY_DEST);
        // SAFETY: an open list, and live resources in the stated states.
        unsafe {
            list.ResourceBarrier(&[transition(&to, rests, copied)]);
            list.CopyTextureRegion(&whole(&to), 0, 0, 0, &placed(&buffer, rows), None);
            list.ResourceBarrier(&[transition(&to, copied, rests)]);
        }
        self.run(&list)
    }

    /// Creates an upload or readback buffer for a texture; returns its footprint too.
    fn rows(
        &self,
        desc: &D3D12_RESOURCE_DESC,
        heap: D3D12_HEAP_TYPE,
    ) -> Result<(ID3D12Resource, D3D12_PLACED_SUBRESOURCE_FOOTPRINT)> {
        let (mut rows, mut bytes) = (D3D12_PLACED_SUBRESOURCE_FOOTPRINT::default(), 0);
        // SAFETY: a live device, and memory for the results that lives during the call.
        unsafe { self.device.GetCopyableFootprints(desc, 0, 1, 0, Some(&mut rows), None, None, Some(&mut bytes)) };
        let wanted = D3D12_RESOURCE_DESC {
            Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
            Width: bytes,
            Height: 1,
            DepthOrArraySize: 1,
            MipLevels: 1,
            SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
            Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
            ..Default::default()
        };
        let rests = match heap {
            D3D12_HEAP_TYPE_UPLOAD => D3D12_RESOURCE_STATE_GENERIC_READ,
            _ => D3D12_RESOURCE_STATE_COPY_DEST,
        };
        Ok((committed(&self.device, heap, &wanted, rests)?, rows))
    }
}

impl SwapchainContext {
    /// Destroys the context; returns rule violations.
    pub(crate) fn end(mut self) -> Vec<String> {
        let mut faults = Vec::new();
        if self.swapchain.has_generator() {
            faults.push("its generator is still there".to_owned());
        }
        ALL.lock()
            .unwrap_or_else(PoisonError::into_inner)
            .retain(|(_, swapchain)| !Arc::ptr_eq(swapchain, &self.swapchain));
        if let Some(proxy) = self.proxy.take() {
            let left = release_count(proxy);
            if left > 0 {
                faults.push(format!("{left} references to its swap chain are left"));
            }
        }
        faults
    }
}

/// Creates the host's buffers and the generated texture.
pub(crate) fn textures(
    device: &ID3D12Device,
    count: u32,
    desc: &DXGI_SWAP_CHAIN_DESC1,
) -> Result<(Vec<ID3D12Resource>, ID3D12Resource)> {
    let wanted = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_TEXTURE2D,
        Width: desc.Width.into(),
        Height: desc.Height,
        DepthOrArraySize: 1,
        MipLevels: 1,
        Format: desc.Format,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        Flags: D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET | D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS,
        ..Default::default()
    };
    let made = |rests| committed(device, D3D12_HEAP_TYPE_DEFAULT, &wanted, rests);
    Ok(((0..count).map(|_| made(REST)).collect::<Result<_>>()?, made(GENERATED_REST)?))
}

fn whole(resource: &ID3D12Resource) -> D3D12_TEXTURE_COPY_LOCATION {
    D3D12_TEXTURE_COPY_LOCATION {
        // SAFETY: the same pointer; it is never dropped, so no reference is released.
        pResource: ManuallyDrop::new(Some(unsafe { std::mem::transmute_copy(resource) })),
        Type: D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX,
        Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { SubresourceIndex: 0 },
    }
}

fn placed(buffer: &ID3D12Resource, rows: D3D12_PLACED_SUBRESOURCE_FOOTPRINT) -> D3D12_TEXTURE_COPY_LOCATION {
    D3D12_TEXTURE_COPY_LOCATION {
        Type: D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT,
        Anonymous: D3D12_TEXTURE_COPY_LOCATION_0 { PlacedFootprint: rows },
        ..whole(buffer)
    }
}

/// The interface drawn over frames.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InterfaceArg {
    arg: TextureArg,
    /// Its colours are premultiplied by its alpha.
    premultiplied: bool,
    /// It is copied within the next present.
    copied: bool,
}

/// The interface of a configure call; `None` for none.
///
/// # Safety
/// A struct with a resource at 16 and flags at 64.
pub(crate) unsafe fn interface(head: *const u8) -> Option<InterfaceArg> {
    // SAFETY: the caller's promise.
    let (arg, flags) = unsafe { (texture_arg(head, 16)?, get::<u32>(head, 64)) };
    Some(InterfaceArg { arg, premultiplied: flags & 1 != 0, copied: flags & 2 != 0 })
}
