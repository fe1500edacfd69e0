//! Frames on Unity's Direct3D 12 device.
//!
//! The presenter writes a frame into a texture of the view's ring. Ring textures have the size of Unity's texture and rest in the state COMMON.
//! A command list of Unity's copies the newest one and may execute frames later. Unity's frame fence, and some frames more, say when it has
//! executed; until then nobody writes to that texture. So Unity need not flush anything or wait for a thread. The plugin requests Unity's texture in COPY_DEST
//! only: from version 8 on by `RequestResourceState` and `NotifyResourceState` in the list that Unity records, before that by the states
//! passed to `ExecuteCommandList` with a list of the plugin's own.

use std::ffi::c_void;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cairn::abi::d3d12::cairn_presenter_submit_d3d12;
use cairn::abi::presenter::cairn_presenter;
use cairn::abi::results::{CAIRN_ERROR_DEVICE, CAIRN_ERROR_INVALID_ARGUMENT, CAIRN_OK, cairn_last_error};
use cairn::gpu::compute::transition;
use cairn::gpu::windows::Win32::Foundation::HMODULE;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_SAMPLE_DESC};
use cairn::gpu::windows::Win32::System::LibraryLoader::{
    GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT, GetModuleFileNameW,
    GetModuleHandleExW,
};
use cairn::gpu::windows::core::{IUnknown, Interface, PCWSTR};
use cairn::locks::Mutex;

use crate::interfaces::{Direct3d12, Notify, Recording, RecordingState, Request, ResourceState};
use crate::views::{EventResult, View, no_frame};

/// Time limit for work on the queue before the device's resources are freed. What is still in use then is leaked.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Maximum number of the plugin's own lists in flight. Unity has two or three frames in flight, each with one list per view.
const LISTS: usize = 256;

/// Maximum number of textures in a view's ring. Unity has two or three frames in flight, and its submission thread may be one behind. More
/// are in use when lists wait long for the device, for example while a window is minimised.
const RING: usize = 8;

/// Number of frames to wait beyond the fence value that Unity gives for a command list, before the list's resources are reused. By Unity's header the
/// list has executed when the fence reaches the value. But Unity has two or three frames in flight, and the value can be that of an earlier one.
/// Unity's own sample (`RenderAPI_D3D12.cpp` of NativeRenderingPlugin) adds three to the completed value.
const FRAMES_IN_FLIGHT: u64 = 3;

/// Unity's device, queue and fence, and the functions used to draw with them.
pub(crate) struct Drawing {
    api: Direct3d12,
    device: ID3D12Device,
    queue: ID3D12CommandQueue,
    frame_fence: ID3D12Fence,
    in_use: Arc<Mutex<InUse>>,
}

// SAFETY: the functions are Unity's, called on the threads that its events run on; objects of Direct3D 12 are free-threaded.
unsafe impl Send for Drawing {}
// SAFETY: as above.
unsafe impl Sync for Drawing {}

/// Resources that Unity's queue still uses. A later event or view releases them; the shutdown waits for them.
#[derive(Default)]
struct InUse {
    textures: Vec<(FencePoint, ID3D12Resource)>,
    lists: Vec<List>,
}

impl InUse {
    /// Releases what the queue no longer uses.
    fn release_finished(&mut self) {
        self.textures.retain(|(until, _)| !until.is_reached());
    }
}

impl Drop for InUse {
    fn drop(&mut self) {
        let end = Instant::now() + TIMEOUT;
        for (until, texture) in self.textures.drain(..) {
            if !until.wait_reached(end) {
                std::mem::forget(texture);
            }
        }
        for list in self.lists.drain(..) {
            if !list.until.wait_reached(end) {
                std::mem::forget(list);
            }
        }
    }
}

/// A fence and a value. A fence of a removed device has reached every value.
#[derive(Clone)]
struct FencePoint {
    fence: ID3D12Fence,
    value: u64,
    /// Added to the value.
    margin: u64,
}

impl FencePoint {
    /// The end of a frame of Unity's, to which a list belongs, by the value that Unity gives for it.
    fn of_frame(fence: &ID3D12Fence, value: u64) -> Self {
        // SAFETY: a live fence.
        let value = value.max(unsafe { fence.GetCompletedValue() });
        Self { fence: fence.clone(), value, margin: FRAMES_IN_FLIGHT }
    }

    fn is_reached(&self) -> bool {
        // SAFETY: a live fence.
        unsafe { self.fence.GetCompletedValue() >= self.value.saturating_add(self.margin) }
    }

    /// Waits for the value, without the margin, until `end` at most. For the shutdown: the queue's work has completed, and no frame follows. Returns
    /// whether it was reached.
    fn wait_reached(&self, end: Instant) -> bool {
        let last = Self { margin: 0, ..self.clone() };
        while !last.is_reached() {
            if Instant::now() >= end {
                return false;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        true
    }
}

/// A list of the plugin's own, for interface versions that pass texture states with a list only.
struct List {
    allocator: ID3D12CommandAllocator,
    list: ID3D12GraphicsCommandList,
    /// Reached when the list has executed.
    until: FencePoint,
}

/// A texture of Unity's. Holds a reference.
#[derive(Clone)]
pub(crate) struct Target(ID3D12Resource);

impl Target {
    /// # Safety
    /// The pointer is null or a COM object that lives during the call.
    pub(crate) unsafe fn of_unity(texture: *mut c_void) -> Option<Self> {
        // SAFETY: the caller's promise; no reference is taken.
        let unknown = unsafe { IUnknown::from_raw_borrowed(&texture) }?;
        unknown.cast().ok().map(Self)
    }
}

/// Ring of textures that a view's frames are written to.
#[derive(Default)]
pub(crate) struct TargetRing(Option<Ring>);

struct Ring {
    slots: Vec<Slot>,
    /// Index of the slot with the newest frame.
    newest: Option<usize>,
    /// Width, height and format of all textures.
    shape: (u64, u32, DXGI_FORMAT),
    in_use: Arc<Mutex<InUse>>,
}

struct Slot {
    texture: ID3D12Resource,
    /// Reached when the frame in the texture is complete.
    written: Option<FencePoint>,
    /// Reached when the last copy from the texture has executed.
    read: Option<FencePoint>,
}

impl Slot {
    fn is_free(&self) -> bool {
        self.read.as_ref().is_none_or(FencePoint::is_reached)
    }
}

impl Drop for Ring {
    /// The queue may still use the textures, so they are not freed here.
    fn drop(&mut self) {
        let mut in_use = self.in_use.lock();
        for Slot { texture, written, read } in self.slots.drain(..) {
            in_use.textures.extend([written, read].into_iter().flatten().map(|until| (until, texture.clone())));
        }
    }
}

impl TargetRing {
    /// Releases the textures.
    pub(crate) fn release(&mut self) {
        self.0 = None;
    }

    /// The slot with the newest frame, if it has the size and format of `target`.
    fn newest(&mut self, target: &ID3D12Resource) -> Option<&mut Slot> {
        let ring = self.0.as_mut().filter(|ring| ring.shape == shape(&desc_of(target)))?;
        ring.slots.get_mut(ring.newest?)
    }

    /// A slot that no list reads, with a texture of `target`'s size and format. `None` if all `RING` slots are in use.
    fn free(&mut self, drawing: &Drawing, target: &ID3D12Resource) -> Result<Option<(usize, ID3D12Resource)>, String> {
        let wanted = desc_of(target);
        if self.0.as_ref().is_none_or(|ring| ring.shape != shape(&wanted)) {
            if let Some(why) = unsupported_reason(&wanted) {
                return Err(why);
            }
            let in_use = drawing.in_use.clone();
            self.0 = Some(Ring { slots: Vec::new(), newest: None, shape: shape(&wanted), in_use });
        }
        let Some(Ring { slots, .. }) = &mut self.0 else { return Ok(None) };
        let index = match slots.iter().position(Slot::is_free) {
            Some(index) => index,
            None if slots.len() < RING => {
                slots.push(Slot { texture: texture_like(&wanted, &drawing.device)?, written: None, read: None });
                slots.len() - 1
            }
            None => return Ok(None),
        };
        Ok(Some((index, slots[index].texture.clone())))
    }

    /// Marks a slot as holding the newest frame, complete once `written` is reached.
    fn set_newest(&mut self, index: usize, written: FencePoint) {
        if let Some(ring) = &mut self.0 {
            ring.slots[index].written = Some(written);
            ring.newest = Some(index);
        }
    }
}

fn desc_of(texture: &ID3D12Resource) -> D3D12_RESOURCE_DESC {
    // SAFETY: a live texture.
    unsafe { texture.GetDesc() }
}

fn shape(desc: &D3D12_RESOURCE_DESC) -> (u64, u32, DXGI_FORMAT) {
    (desc.Width, desc.Height, desc.Format)
}

/// Creates a texture of a size and format in the state COMMON.
fn texture_like(wanted: &D3D12_RESOURCE_DESC, device: &ID3D12Device) -> Result<ID3D12Resource, String> {
    let desc = D3D12_RESOURCE_DESC {
        Dimension: D3D12_RESOURCE_DIMENSION_TEXTURE2D,
        Width: wanted.Width,
        Height: wanted.Height,
        DepthOrArraySize: 1,
        MipLevels: 1,
        Format: wanted.Format,
        SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
        ..Default::default()
    };
    let heap = D3D12_HEAP_PROPERTIES { Type: D3D12_HEAP_TYPE_DEFAULT, ..Default::default() };
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: a live device; the descriptions and the output live during the call.
    let result = unsafe {
        let rest = D3D12_RESOURCE_STATE_COMMON;
        device.CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &desc, rest, None, &mut made)
    };
    let why = result.err().map_or_else(String::new, |e| format!(": {e}"));
    made.ok_or_else(|| format!("ID3D12Device::CreateCommittedResource made no texture{why}"))
}

/// The reason why no frame can be copied into such a texture, or `None`.
fn unsupported_reason(wanted: &D3D12_RESOURCE_DESC) -> Option<String> {
    let what = if wanted.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D || wanted.DepthOrArraySize != 1 {
        "it is no texture of two dimensions with one slice"
    } else if wanted.MipLevels != 1 {
        "it has mip maps: set useMipMap to false"
    } else if wanted.SampleDesc.Count != 1 {
        "it is multisampled: set antiAliasing to 1"
    } else {
        return None;
    };
    Some(format!("texture: {what}"))
}

impl Drawing {
    pub(crate) fn new(api: Direct3d12) -> Result<Self, String> {
        let missing = |what: &str| format!("Unity's IUnityGraphicsD3D12v{} gives no {what}", api.version);
        // SAFETY: Unity's functions, called while the device is initialised. Unity keeps its references; one is added.
        let [device, queue, fence] = [api.get_device, api.get_command_queue, api.get_frame_fence]
            .map(|get| get.and_then(|get| unsafe { Target::object(get()) }));
        Ok(Self {
            api,
            device: device.and_then(|found| found.cast().ok()).ok_or_else(|| missing("device"))?,
            queue: queue.and_then(|found| found.cast().ok()).ok_or_else(|| missing("command queue"))?,
            frame_fence: fence.and_then(|found| found.cast().ok()).ok_or_else(|| missing("frame fence"))?,
            in_use: Arc::default(),
        })
    }

    pub(crate) fn version(&self) -> u32 {
        self.api.version
    }

    /// Device and queue, without adding a reference.
    pub(crate) fn parts(&self) -> (*mut c_void, *mut c_void) {
        (self.device.as_raw(), self.queue.as_raw())
    }

    /// Writes the frame that is due into a texture of the view's ring, on Unity's queue.
    pub(crate) fn make(&self, view: &View) -> EventResult {
        // Read under the lock: whoever ends the view takes the lock and so waits for this event.
        let mut ring = view.ring.lock();
        let Some((now, Target(target))) = view.next_frame() else { return EventResult::Nothing };
        self.release_finished();
        let (index, texture) = match ring.free(self, &target) {
            Ok(Some(found)) => found,
            // The next frame is written once Unity's queue has executed the copies of earlier ones.
            Ok(None) => return EventResult::Nothing,
            Err(why) => return EventResult::Failed(CAIRN_ERROR_INVALID_ARGUMENT, why),
        };
        let (mut frame, mut fence, mut value) = (no_frame(), std::ptr::null_mut(), 0);
        let rest = D3D12_RESOURCE_STATE_COMMON.0.cast_unsigned();
        let presenter = std::ptr::without_provenance_mut::<cairn_presenter>(view.presenter);
        let device = std::ptr::without_provenance(view.device);
        let raw = texture.as_raw().cast();
        // SAFETY: handles are looked up; a live texture in the stated state; writable outputs.
        let result = unsafe {
            cairn_presenter_submit_d3d12(presenter, device, now, raw, rest, rest, &mut frame, &mut fence, &mut value)
        };
        match result {
            CAIRN_OK => {
                // SAFETY: the reference returned by the call, used once.
                let fence = unsafe { ID3D12Fence::from_raw(fence.cast()) };
                ring.set_newest(index, FencePoint { fence, value, margin: 0 });
                EventResult::Made(frame)
            }
            not_ready if not_ready > 0 => EventResult::Nothing,
            failed => EventResult::Failed(failed, last_error()),
        }
    }

    /// Copies the newest frame into Unity's texture, in the order of Unity's own lists.
    pub(crate) fn show(&self, view: &View) -> EventResult {
        // As in `make`.
        let mut ring = view.ring.lock();
        let Some((_, Target(target))) = view.next_frame() else { return EventResult::Nothing };
        // The view may have got another texture between the two events. The next frame is made for it.
        let Some(slot) = ring.newest(&target) else { return EventResult::Nothing };
        let mut in_use = self.in_use.lock();
        in_use.release_finished();
        let Direct3d12 { command_recording_state, request_resource_state, notify_resource_state, .. } = self.api;
        let done = match (command_recording_state, request_resource_state.zip(notify_resource_state)) {
            (Some(recording), Some(states)) => self.record(recording, states, &slot.texture, &target),
            _ => Ok(None),
        };
        // Unity may have no list open, for instance within another event.
        let done = match done {
            Ok(None) => self.execute(&mut in_use.lists, &slot.texture, &target),
            Ok(Some(until)) => Ok(until),
            Err(why) => Err(why),
        };
        match done {
            Ok(until) => {
                slot.read = Some(until.clone());
                in_use.textures.push((until, target));
                EventResult::Shown
            }
            Err(why) => EventResult::Failed(CAIRN_ERROR_DEVICE, why),
        }
    }

    /// Records the copy in the list that Unity has open. Returns the end of its frame, or `None` if no list is open.
    fn record(
        &self,
        recording: Recording,
        (request, notify): (Request, Notify),
        from: &ID3D12Resource,
        target: &ID3D12Resource,
    ) -> Result<Option<FencePoint>, String> {
        let mut state = RecordingState { list: std::ptr::null_mut() };
        // SAFETY: a function of Unity's, called on the thread it requires; the struct lives during the call.
        if unsafe { recording(&mut state) } == 0 {
            return Ok(None);
        }
        // SAFETY: null or Unity's list, which is alive and open during the event.
        let Some(list) = (unsafe { ID3D12GraphicsCommandList::from_raw_borrowed(&state.list) }) else {
            return Ok(None);
        };
        let to = D3D12_RESOURCE_STATE_COPY_DEST.0;
        // SAFETY: a live texture of Unity's.
        unsafe { request(target.as_raw(), to) };
        copy(list, from, target);
        // SAFETY: as above.
        unsafe { notify(target.as_raw(), to, 0) };
        self.end_of_frame().map(Some)
    }

    /// Records the copy in a list of the plugin's own, which Unity executes between its lists. Returns the end of its frame.
    fn execute(
        &self,
        lists: &mut Vec<List>,
        from: &ID3D12Resource,
        target: &ID3D12Resource,
    ) -> Result<FencePoint, String> {
        let index = match lists.iter().position(|list| list.until.is_reached()) {
            Some(index) => index,
            None if lists.len() < LISTS => {
                lists.push(List::new(&self.device, &self.frame_fence)?);
                lists.len() - 1
            }
            None => return Err(format!("{LISTS} lists wait for Unity, which does not come to the end of its frames")),
        };
        let List { allocator, list, until } = &mut lists[index];
        let failed = |call: &str, e: &dyn std::fmt::Display| format!("{call}: {e}");
        // SAFETY: the list that used it has executed.
        unsafe { allocator.Reset() }.map_err(|e| failed("ID3D12CommandAllocator::Reset", &e))?;
        // SAFETY: a closed list that has executed.
        unsafe { list.Reset(&*allocator, None) }.map_err(|e| failed("ID3D12GraphicsCommandList::Reset", &e))?;
        copy(list, from, target);
        // SAFETY: an open list.
        unsafe { list.Close() }.map_err(|e| failed("ID3D12GraphicsCommandList::Close", &e))?;
        let state = D3D12_RESOURCE_STATE_COPY_DEST.0;
        let mut states = ResourceState { resource: target.as_raw(), expected: state, current: state };
        let Some(execute) = self.api.execute_command_list else { return Err("no ExecuteCommandList".to_owned()) };
        // SAFETY: a function of Unity's; a closed direct list, and the stated number of states, which live during the call.
        *until = FencePoint::of_frame(&self.frame_fence, unsafe { execute(list.as_raw(), 1, &mut states) });
        Ok(until.clone())
    }

    /// The end of the current frame.
    fn end_of_frame(&self) -> Result<FencePoint, String> {
        let get = self.api.get_next_frame_fence_value.ok_or("no GetNextFrameFenceValue")?;
        // SAFETY: a function of Unity's, called on the thread it requires.
        Ok(FencePoint::of_frame(&self.frame_fence, unsafe { get() }))
    }

    /// Releases what the queue no longer uses.
    pub(crate) fn release_finished(&self) {
        self.in_use.lock().release_finished();
    }

    /// Waits until the work that was submitted to Unity's queue has completed.
    fn wait_for_queue(&self) {
        // SAFETY: a live device.
        let Ok(fence) = (unsafe { self.device.CreateFence::<ID3D12Fence>(0, D3D12_FENCE_FLAG_NONE) }) else { return };
        // SAFETY: a live queue and a fence of its device.
        if unsafe { self.queue.Signal(&fence, 1) }.is_ok() {
            FencePoint { fence, value: 1, margin: 0 }.wait_reached(Instant::now() + TIMEOUT);
        }
    }

    /// Waits until Unity's queue has finished with the plugin's resources.
    pub(crate) fn finish(&self) {
        let in_use = std::mem::take(&mut *self.in_use.lock());
        self.wait_for_queue();
        drop(in_use);
    }
}

impl Target {
    /// A COM object that somebody else holds, with a reference added.
    ///
    /// # Safety
    /// The pointer is null or a COM object that lives during the call.
    unsafe fn object(pointer: *mut c_void) -> Option<IUnknown> {
        // SAFETY: the caller's promise.
        unsafe { IUnknown::from_raw_borrowed(&pointer) }.cloned()
    }
}

impl List {
    /// Creates a closed, empty list.
    fn new(device: &ID3D12Device, fence: &ID3D12Fence) -> Result<Self, String> {
        let kind = D3D12_COMMAND_LIST_TYPE_DIRECT;
        // SAFETY: a live device.
        let allocator: ID3D12CommandAllocator = unsafe { device.CreateCommandAllocator(kind) }
            .map_err(|e| format!("ID3D12Device::CreateCommandAllocator: {e}"))?;
        // SAFETY: a live device and allocator.
        let list: ID3D12GraphicsCommandList = unsafe { device.CreateCommandList(0, kind, &allocator, None) }
            .map_err(|e| format!("ID3D12Device::CreateCommandList: {e}"))?;
        // SAFETY: an open, empty list.
        unsafe { list.Close() }.map_err(|e| format!("ID3D12GraphicsCommandList::Close: {e}"))?;
        Ok(Self { allocator, list, until: FencePoint { fence: fence.clone(), value: 0, margin: 0 } })
    }
}

/// Records a copy from a texture in COMMON to a texture in COPY_DEST.
fn copy(list: &ID3D12GraphicsCommandList, from: &ID3D12Resource, to: &ID3D12Resource) {
    let (rest, read) = (D3D12_RESOURCE_STATE_COMMON, D3D12_RESOURCE_STATE_COPY_SOURCE);
    // SAFETY: an open list, and live textures of equal size and format in the stated states.
    unsafe {
        list.ResourceBarrier(&[transition(from, rest, read)]);
        list.CopyResource(to, from);
        list.ResourceBarrier(&[transition(from, read, rest)]);
    }
}

/// Message of this thread's last failed call to Cairn.
fn last_error() -> String {
    let mut text = [0_u8; 1024];
    let mut length = 0;
    // SAFETY: a buffer of the stated capacity, and a writable length.
    _ = unsafe { cairn_last_error(text.as_mut_ptr().cast(), text.len(), &mut length) };
    String::from_utf8_lossy(&text[..length.min(text.len() - 1)]).into_owned()
}

/// Path of this library's file.
pub(crate) fn own_path() -> Option<String> {
    let mut module = HMODULE::default();
    let flags = GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT;
    let own: fn() -> Option<String> = own_path;
    // SAFETY: an address in this library, and a writable module handle.
    unsafe { GetModuleHandleExW(flags, PCWSTR(own as *const u16), &mut module) }.ok()?;
    let mut path = vec![0_u16; 32768];
    // SAFETY: a module that stays loaded, and a buffer for its name.
    let length = unsafe { GetModuleFileNameW(Some(module), &mut path) } as usize;
    (length > 0 && length < path.len()).then(|| String::from_utf16_lossy(&path[..length]))
}
