//! AMD's frame-pacing swap chain: presents generated frames between an engine's own and spreads them over time. Windows only.
//!
//! The engine replaces its swap chain by this one and goes on as before: it draws into the back buffers and calls `Present`. Before
//! `Present` it records motion and depth of the frame ([`Swapchain::prepare`]). Within `Present`, AMD's swap chain records the
//! generated frame through a callback, which forwards its struct to the generator.

mod generation;
mod present_fence;
mod settings;
mod takeover;

use std::cell::Cell;
use std::ffi::c_void;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

use crate::locks::ReentrantMutex;
use windows::Win32::Graphics::Direct3D12::{D3D12_COMMAND_LIST_TYPE_DIRECT, ID3D12GraphicsCommandList, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::{
    DXGI_SWAP_CHAIN_DESC, DXGI_SWAP_CHAIN_DESC1, DXGI_SWAP_CHAIN_FULLSCREEN_DESC, IDXGISwapChain4,
};
use windows::core::Interface as _;

use super::bindings::{
    ConfigureFrameGeneration, ConfigureInterface, ConfigureSwapchainKeyValue, CreateFlags, CreateFrameGeneration,
    CreateSwapchainForWindow, CreateSwapchainNew, CreateSwapchainWrap, Creates, Dimensions, DispatchWait, FrameFlags,
    InterfaceFlags, MemoryUsage, PacingTuning, QuerySwapchainMemory, RawContext, Resource, ResourceState, ReturnCode,
    StructId, SurfaceFormat, SwapchainKey,
};
use super::sanitised_motion::SanitisedMotion;
use super::texture_generator::{READ, TextureGenerator, TextureOptions, motion_size_at, picture};
use super::{Api, Chain, Choice, Context, FfxStruct, Frame, FrameParams, Generator, Provider};
use crate::gpu::compute::{CommandRing, ResourceWithState, compute_queue_knows};
use crate::gpu::{Gpu, check_list, failed_on};
use crate::{Error, ErrorKind, Result};
pub(crate) use generation::is_presenting_thread;
use generation::{CallbackData, generate};
use present_fence::PresentFence;
pub use settings::{
    FrameTextures, Interface, Pacing, SwapchainMemory, SwapchainOptions, SwapchainSource, swapchain_memory_needed,
};
use takeover::{check_buffer_count, check_wrappable, references};

/// The first swap chain whose pacing can be set: that of SDK 1.1.3. Earlier ones are named 1.0.
const PACING_SINCE: [u32; 3] = [1, 1, 2];

/// AMD's swap chain with its frame generator.
///
/// Threads: one at a time, counting `Present` and all other calls on the DXGI swap chain; may move between threads. AMD's library
/// presents on threads of its own.
pub struct Swapchain {
    /// Dropped first: it signals the fence that the ring waits for.
    presented: PresentFence,
    ring: CommandRing,
    api: Api,
    options: SwapchainOptions,
    motion: SanitisedMotion,
    generator: Option<Generator>,
    /// User data of the `generate` callback; boxed, so that its address stays the same.
    callback_data: Box<CallbackData>,
    // Dropped in this order: the swap chain, then the context that paces it.
    swapchain: IDXGISwapChain4,
    /// The swap chain's reference count after creation: our reference and the library's own.
    initial_references: u32,
    pacer: Box<dyn Pacer>,
    /// Structs that the pacer's creation chain points to.
    _creation_structs: Box<CreationStructs>,
    /// After the swap chain, which holds no reference to its queue and signals it when it ends.
    gpu: Gpu,
    interface: Option<HeldInterface>,
    /// HUD-less pictures and distortion fields of this frame and the previous one, which `Present` may still read.
    read_later: [[Option<ID3D12Resource>; 2]; 2],
    is_on: bool,
    /// Id of the last frame of the generators before.
    last_id: u64,
    /// Generation was turned off, and frames from before may not be on the screen.
    must_wait: bool,
}

/// Structs that the creation chain of the pacing context points to.
#[derive(Default)]
struct CreationStructs {
    swapchain: *mut c_void,
    description: DXGI_SWAP_CHAIN_DESC,
    of_window: DXGI_SWAP_CHAIN_DESC1,
    fullscreen: DXGI_SWAP_CHAIN_FULLSCREEN_DESC,
}

// SAFETY: the library's context and its swap chain may be used by one thread after the other, and objects of Direct3D 12 are
// free-threaded; the library's own threads get `CallbackData` only.
unsafe impl Send for Swapchain {}

/// The interface that was set last.
struct HeldInterface {
    picture: ID3D12Resource,
    size: Dimensions,
    state: ResourceState,
    flags: InterfaceFlags,
}

/// A pacing context, whichever struct created it.
trait Pacer {
    fn raw(&self) -> RawContext;
    fn provider(&self) -> &Provider;
    fn api(&self) -> &Api;
}

impl<Head: Creates> Pacer for Context<Head> {
    fn raw(&self) -> RawContext {
        Self::raw(self)
    }

    fn provider(&self) -> &Provider {
        Self::provider(self)
    }

    fn api(&self) -> &Api {
        Self::api(self)
    }
}

/// State of the inputs while AMD's library reads them.
const INPUT: ResourceState = ResourceState::COMPUTE_READ;

impl Swapchain {
    /// Creates AMD's swap chain on `gpu`. The frame queue of `gpu` must be the direct queue that the engine draws on.
    ///
    /// Everything else is created first: if that fails, the swap chain in [`SwapchainSource::Wrap`] is unchanged and still the caller's. Once
    /// AMD's library has it, it is gone, even if the library fails.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for input on which AMD's library would fail, hang or crash: a queue that is not direct, a
    /// swap chain that is full screen, has no size, is referenced elsewhere or has a number of buffers other than 2 to 16, with SDK 1.1
    /// 2 to 6. `Unsupported` with the field `provider` when no generator passes the self-test, and with the field `hudless` as of
    /// [`Generator::create`]. The library's own errors; `OutOfMemory`, `DeviceRemoved`.
    pub fn new(gpu: &Gpu, api: &Api, options: &SwapchainOptions, from: SwapchainSource<'_>) -> Result<Self> {
        let refuse = |field: &str, why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        if gpu.frames().kind() != D3D12_COMMAND_LIST_TYPE_DIRECT {
            return refuse("queue", "AMD's swap chain draws on it, and it is not direct");
        }
        let mut structs = Box::<CreationStructs>::default();
        let (size, format, buffers) = match &from {
            SwapchainSource::Wrap(Some(swapchain)) => {
                let desc = check_wrappable(gpu, swapchain)?;
                ((desc.Width, desc.Height), desc.Format, (desc.BufferCount, "swapchain"))
            }
            SwapchainSource::Wrap(None) => return refuse("swapchain", "there is none"),
            SwapchainSource::New(_, desc) => {
                structs.description = *desc;
                if !desc.Windowed.as_bool() {
                    return refuse("description.Windowed", "AMD's swap chain lives in a window");
                }
                if desc.OutputWindow.is_invalid() {
                    return refuse("description.OutputWindow", "there is no window");
                }
                let mode = desc.BufferDesc;
                ((mode.Width, mode.Height), mode.Format, (desc.BufferCount, "description.BufferCount"))
            }
            SwapchainSource::ForWindow(_, window, desc, fullscreen) => {
                structs.of_window = *desc;
                structs.fullscreen = fullscreen.unwrap_or_default();
                if fullscreen.is_some_and(|fullscreen| !fullscreen.Windowed.as_bool()) {
                    return refuse("fullscreen.Windowed", "AMD's swap chain lives in a window");
                }
                if window.is_invalid() {
                    return refuse("window", "there is none");
                }
                ((desc.Width, desc.Height), desc.Format, (desc.BufferCount, "description.BufferCount"))
            }
        };
        check_buffer_count(gpu, api, creation_struct(&from), buffers).map_err(|error| gpu.or_removed(error))?;
        let mut options = *options;
        let head = head_of(&options, size, SurfaceFormat::from_dxgi(format.0.cast_unsigned()));
        let generator = generator(gpu, api, &options, head).map_err(|error| gpu.or_removed(error))?;
        if let (true, Some(family)) = (options.self_test, generator.provider().version.family()) {
            // `fit` creates another one without a test, so of the family that has passed it.
            options.choice = Choice::Require(family);
        }
        let callback_data = Box::new(CallbackData {
            api: *api,
            context: ReentrantMutex::new(Cell::new(generator.context().raw())),
            prepared: AtomicU64::new(0),
            reset: AtomicU64::new(0),
            generated: AtomicU64::new(0),
            repeated: AtomicU64::new(0),
            failed: AtomicU32::new(0),
            has_gap: AtomicBool::new(false),
        });
        let (presented, ring) =
            (PresentFence::new(gpu)?, CommandRing::new(gpu, gpu.frames(), SanitisedMotion::DESCRIPTORS)?);
        let motion = SanitisedMotion::new(gpu, motion_size_at(&head, head.max_render_size))?;
        let pacer = create_pacing_context(gpu, api, &mut structs, from).map_err(|error| gpu.or_removed(error))?;
        if structs.swapchain.is_null() {
            return Err(Error::new(ErrorKind::Device, "AMD's library says that it succeeded, and gave no swap chain"));
        }
        // SAFETY: the library has written a swap chain there, with a reference for its host.
        let swapchain = unsafe { IDXGISwapChain4::from_raw(structs.swapchain) };
        Ok(Self {
            initial_references: references(&swapchain),
            swapchain,
            pacer,
            presented,
            ring,
            gpu: gpu.clone(),
            api: *api,
            options,
            motion,
            generator: Some(generator),
            callback_data,
            _creation_structs: structs,
            interface: None,
            read_later: Default::default(),
            is_on: false,
            last_id: 0,
            must_wait: false,
        })
    }

    /// The DXGI swap chain, for drawing and presenting. The engine must release all references to it and to its buffers before this
    /// is dropped.
    pub fn dxgi(&self) -> &IDXGISwapChain4 {
        &self.swapchain
    }

    /// Number of external references to the swap chain; all must be released before it is dropped. Back buffers are not counted.
    pub fn external_references(&self) -> u32 {
        references(&self.swapchain).saturating_sub(self.initial_references)
    }

    /// The provider that generates frames.
    ///
    /// # Errors
    /// `InvalidState` if [`fit`](Self::fit) could not create one.
    pub fn provider(&self) -> Result<&Provider> {
        self.generator.as_ref().map(Generator::provider).ok_or_else(no_generator)
    }

    /// The provider that presents frames.
    pub fn pacer(&self) -> &Provider {
        self.pacer.provider()
    }

    /// Number of frames generated so far.
    pub fn generated(&self) -> u64 {
        self.callback_data.generated.load(Ordering::Relaxed)
    }

    /// Number of frames so far that were shown twice, because their generation failed or they were not prepared.
    pub fn repeated(&self) -> u64 {
        self.callback_data.repeated.load(Ordering::Relaxed)
    }

    /// The last error that the generator returned within `Present`, if any. A frame whose generation fails is presented twice.
    pub fn failed(&self) -> Option<ReturnCode> {
        Some(ReturnCode(self.callback_data.failed.load(Ordering::Relaxed))).filter(|code| *code != ReturnCode::OK)
    }

    /// Device memory of the generator and the swap chain.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn memory(&mut self) -> Result<SwapchainMemory> {
        let lock = self.callback_data.context.lock();
        let generator = self.generator.as_mut().map(Generator::memory).transpose()?.flatten();
        drop(lock);
        let mut usage = MemoryUsage::default();
        let mut query = Chain::new(QuerySwapchainMemory { usage: &mut usage, ..Default::default() });
        let pacer = &self.pacer;
        // SAFETY: our own context, and memory for the answer that lives during the call.
        let known = super::memory_usage::is_known(unsafe { pacer.api().query(pacer.raw(), &mut query) })?;
        Ok(SwapchainMemory { generator, swapchain: known.then_some(usage) })
    }

    /// Records motion and depth of the next frame into `list`, an open list of the engine, which must submit it to its queue before
    /// `Present`. `Present` then also shows a frame between this one and the previous one, unless `params.reset` is set. A frame that is
    /// not prepared is shown twice, unless generation is paused, and the next one has no history.
    ///
    /// Ignores `params.transfer` and `params.luminance`: AMD's swap chain takes them from `SetColorSpace1` and `SetHDRMetaData`.
    ///
    /// Changes the list's descriptor heaps, compute root signature and pipeline, and no other state.
    ///
    /// # Errors
    /// `InvalidArgument` with the field, before anything is recorded, for input on which a provider would fail, hang or crash.
    /// `InvalidState` if the buffers have another size or format and [`fit`](Self::fit) has not succeeded since. The library's own errors, after which the
    /// list may hold part of the work.
    pub fn prepare(
        &mut self,
        list: &ID3D12GraphicsCommandList,
        pictures: &FrameTextures<'_>,
        params: &FrameParams,
    ) -> Result<()> {
        check_list(&self.gpu, list)?;
        let made = *self.generator.as_ref().ok_or_else(no_generator)?.creation();
        self.check_buffers(&made)?;
        let motion_size = motion_size_at(&made, params.render_size);
        let request = self.request(list, pictures, params, &made, motion_size)?;
        // Before anything is recorded.
        self.generator.as_ref().ok_or_else(no_generator)?.check_presented(&request)?;
        // AMD's swap chain forgets a copied interface within `Present` (`copyUiResource` in its published source).
        if let Some(interface) =
            self.interface.as_ref().filter(|held| held.flags.contains(InterfaceFlags::DOUBLE_BUFFERED))
        {
            self.configure_interface(Some(interface))?;
        }
        // The engine has submitted the previous frame's list by now.
        self.presented.signal_presented()?;
        let until = self.presented.next()?;
        let mut frame = self.ring.begin_in(list, &until)?;
        let clean = self.motion.record(&mut frame, &pictures.motion, motion_size, params.motion_scale)?;
        frame.transition_to(&clean, READ)?;
        frame.transition_to(&pictures.depth, READ)?;
        let generator = self.generator.as_mut().ok_or_else(no_generator)?;
        let settings = ConfigureFrameGeneration {
            swapchain: self.swapchain.as_raw(),
            generate: Some(generate),
            generate_user: std::ptr::from_ref(&*self.callback_data).cast_mut().cast(),
            flags: FrameFlags::empty(),
            ..Default::default()
        };
        let lock = self.callback_data.context.lock();
        if self.callback_data.has_gap.swap(false, Ordering::Relaxed) {
            generator.drop_history();
        }
        // The configure call turns generation on, also if the prepare call after it fails.
        self.is_on = true;
        // SAFETY: the frame's open list; its resources belong to the device, are in the stated states and are held by the frame or
        // by `self`; the swap chain and the callback's data outlive generation, which is turned off first.
        let prepared = unsafe { generator.prepare(&request, settings) };
        let (id, reset) = prepared.map_err(|error| self.gpu.or_removed(error))?;
        self.callback_data.prepared.store(id, Ordering::Relaxed);
        self.callback_data.reset.store(if reset { id } else { 0 }, Ordering::Relaxed);
        drop(lock);
        frame.resume();
        // Keeps the pictures that `Present` will read, and the previous ones, which it may still be reading.
        let [last, _] = std::mem::take(&mut self.read_later);
        let now = [pictures.hudless, pictures.distortion].map(|given| given.map(|given| given.resource.clone()));
        self.read_later = [now, last];
        Ok(())
    }

    /// Checks that the buffers are those that the generator was made for.
    fn check_buffers(&self, made: &CreateFrameGeneration) -> Result<()> {
        let (size, format) = self.buffers()?;
        let changed = |why| {
            Err(Error::new(ErrorKind::InvalidState, why).field("swapchain").remedy("Call fit after ResizeBuffers"))
        };
        if !same_size(size, made.display_size) {
            let (of, now) = (made.display_size, size);
            return changed(format!(
                "it was {} x {} pixels and is {} x {}",
                of.width, of.height, now.width, now.height
            ));
        }
        if format != made.back_buffer_format {
            return changed("its buffers have another format now".to_owned());
        }
        Ok(())
    }

    /// The frame that AMD's library gets. Prepares the texture for its motion, and records nothing.
    fn request(
        &mut self,
        list: &ID3D12GraphicsCommandList,
        pictures: &FrameTextures<'_>,
        params: &FrameParams,
        made: &CreateFrameGeneration,
        motion_size: Dimensions,
    ) -> Result<Frame> {
        let check_and_describe = |given: &ResourceWithState<'_>, size, field: &str, state| {
            picture(&self.gpu, given, size, field).map(|()| Resource::of(given.resource, state))
        };
        let depth = check_and_describe(&pictures.depth, params.render_size, "depth", INPUT)?;
        check_and_describe(&pictures.motion, motion_size, "motion", INPUT)?;
        let describe = |given: &ResourceWithState<'_>, field: &str| {
            let state = ResourceState::from_d3d12(given.state.0.cast_unsigned());
            let state = state.ok_or_else(|| {
                Error::new(ErrorKind::InvalidArgument, "AMD's swap chain has no word for its state").field(field)
            })?;
            if made.flags.contains(CreateFlags::ASYNC_WORKLOAD) && !compute_queue_knows(given.state) {
                let why = "with asynchronous work it is read on a compute queue, which does not know this state";
                return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
            }
            check_and_describe(given, made.display_size, field, state)
        };
        // `Present` reads these later, in the states that were given with them.
        let optional = |given: &Option<ResourceWithState<'_>>, field: &str| {
            given.as_ref().map_or(Ok(Resource::default()), |given| describe(given, field))
        };
        let (hudless, distortion) =
            (optional(&pictures.hudless, "hudless")?, optional(&pictures.distortion, "distortion")?);
        self.motion.prepare(&self.gpu, &pictures.motion, motion_size)?;
        Ok(Frame {
            command_list: list.as_raw(),
            color: Resource::default(),
            output: Resource::default(),
            depth,
            motion: Resource::of(self.motion.texture(), INPUT),
            hudless,
            distortion,
            params: *params,
        })
    }

    /// Stops generating: frames are presented unchanged until one is prepared again.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn pause(&mut self) -> Result<()> {
        if let Some(generator) = self.generator.as_mut().filter(|_| self.is_on) {
            // Without the lock: the library may wait here for a frame that its callback is generating.
            // SAFETY: a live swap chain of the library's.
            unsafe { generator.turn_off(self.swapchain.as_raw()) }.map_err(|error| self.gpu.or_removed(error))?;
            (self.is_on, self.must_wait) = (false, true);
        }
        // Also where an earlier call could not wait.
        if self.must_wait { self.wait() } else { Ok(()) }
    }

    /// Waits until all frames passed to `Present` are on the screen.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn wait(&mut self) -> Result<()> {
        let pacer = &self.pacer;
        // SAFETY: our own context; the chain has one struct.
        unsafe { pacer.api().dispatch(pacer.raw(), &mut Chain::new(DispatchWait::default())) }
            .map_err(|failure| self.gpu.or_removed(failure.error()))?;
        self.must_wait = false;
        Ok(())
    }

    /// Sets the interface that is drawn over frames from the next `Present` on; None for none. Waits for frames that show the
    /// previous one.
    ///
    /// # Errors
    /// `InvalidArgument` for a picture of another size or device, or in a state that ffx-api has no value for. The library's own
    /// errors.
    pub fn set_interface(&mut self, interface: Option<Interface<'_>>) -> Result<()> {
        let next = interface.map(|interface| self.checked_interface(&interface)).transpose()?;
        let stays = |picture: &ID3D12Resource| next.as_ref().is_some_and(|next| next.picture == *picture);
        if self.interface.as_ref().is_some_and(|held| !stays(&held.picture)) {
            self.wait()?;
        }
        self.configure_interface(next.as_ref())?;
        self.interface = next;
        Ok(())
    }

    fn checked_interface(&self, interface: &Interface<'_>) -> Result<HeldInterface> {
        let refuse = |why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field("interface"));
        let Interface { picture: given, premultiplied, copied } = interface;
        let (size, _) = self.buffers()?;
        picture(&self.gpu, given, size, "interface")?;
        let Some(state) = ResourceState::from_d3d12(given.state.0.cast_unsigned()) else {
            return refuse("AMD's swap chain has no word for its state");
        };
        if let Some(why) = Resource::of(given.resource, state).fault(size) {
            return refuse(why);
        }
        let mut flags = InterfaceFlags::empty();
        flags.set(InterfaceFlags::PREMULTIPLIED, *premultiplied);
        flags.set(InterfaceFlags::DOUBLE_BUFFERED, *copied);
        Ok(HeldInterface { picture: given.resource.clone(), size, state, flags })
    }

    /// Tells AMD's swap chain of an interface, which the caller holds until another is set.
    fn configure_interface(&self, interface: Option<&HeldInterface>) -> Result<()> {
        let config = interface.map_or_else(ConfigureInterface::default, |held| ConfigureInterface {
            interface: Resource::of(&held.picture, held.state),
            flags: held.flags,
            ..Default::default()
        });
        // SAFETY: our own context; the caller's promise.
        unsafe { self.pacer.api().configure(self.pacer.raw(), &mut Chain::new(config)) }
            .map_err(|failure| self.gpu.or_removed(failure.error()))
    }

    /// Sets the pacing of presents.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for a value out of range; `Unsupported` with the field `provider` for SDK 1.1.2 and earlier; the
    /// library's own errors.
    pub fn set_pacing(&mut self, pacing: &Pacing) -> Result<()> {
        let refuse = |field: &str, why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        let version = &self.pacer.provider().version;
        // That of SDK 1.1.0 refuses the struct; those of 1.1.1 and 1.1.2 ignore the key and return OK.
        if version.number().is_some_and(|number| number < PACING_SINCE) {
            return Err(Error::new(
                ErrorKind::Unsupported,
                format!("the swap chain {version} has no settings of pacing"),
            )
            .field("provider")
            .remedy("Use AMD's libraries of SDK 1.1.3 or later"));
        }
        if !(pacing.safety_margin_ms.is_finite() && pacing.safety_margin_ms >= 0.0) {
            return refuse("safety_margin_ms", "it must be 0 or more");
        }
        if !(0.0..=1.0).contains(&pacing.variance_factor) {
            return refuse("variance_factor", "it must be from 0 to 1");
        }
        let mut tuning = PacingTuning {
            safety_margin: pacing.safety_margin_ms,
            variance_factor: pacing.variance_factor,
            hybrid_spin: pacing.hybrid_spin.is_some(),
            hybrid_spin_time: pacing.hybrid_spin.unwrap_or(2),
            wait_on_fence: pacing.wait_on_fence,
        };
        let key = SwapchainKey::PACING_TUNING;
        let pointer = std::ptr::from_mut(&mut tuning).cast();
        let mut chain = Chain::new(ConfigureSwapchainKeyValue { key, pointer, ..Default::default() });
        let pacer = &self.pacer;
        // SAFETY: our own context, and a struct that is read during the call.
        unsafe { pacer.api().configure(pacer.raw(), &mut chain) }
            .map_err(|failure| self.gpu.or_removed(failure.error()))
    }

    /// Adapts the generator to the size and format of the buffers, and removes an interface of another size: AMD's swap chain would draw it on a
    /// part of the frame. Call it after `ResizeBuffers`, before the next frame. If it fails, frames are presented without generated ones until a
    /// later call succeeds.
    ///
    /// # Errors
    /// As [`new`](Self::new), for the generator.
    pub fn fit(&mut self) -> Result<()> {
        let (size, format) = self.buffers()?;
        if self.interface.as_ref().is_some_and(|held| !same_size(held.size, size)) {
            self.set_interface(None)?;
        }
        let fits =
            |made: &CreateFrameGeneration| same_size(made.display_size, size) && made.back_buffer_format == format;
        if self.generator.as_ref().is_some_and(|generator| fits(generator.creation())) {
            return Ok(());
        }
        // A generator must not end while the swap chain calls it.
        self.pause()?;
        self.end_generator()?;
        let options = SwapchainOptions { self_test: false, ..self.options };
        let head = head_of(&options, (size.width, size.height), format);
        let mut made = generator(&self.gpu, &self.api, &options, head).map_err(|error| self.gpu.or_removed(error))?;
        made.continue_after(self.last_id);
        self.callback_data.context.lock().set(made.context().raw());
        self.generator = Some(made);
        Ok(())
    }

    /// Waits until the device no longer uses the generator, and destroys it. Generation must be off.
    fn end_generator(&mut self) -> Result<()> {
        self.presented.signal_presented()?;
        // Generated frames run on the engine's queue.
        self.gpu.frames().signal()?.wait()?;
        self.ring.finish()?;
        self.callback_data.context.lock().set(null_mut());
        if let Some(generator) = self.generator.take() {
            self.last_id = generator.last_id();
        }
        self.read_later = Default::default();
        Ok(())
    }

    /// The swap chain's description.
    fn description(&self) -> Result<DXGI_SWAP_CHAIN_DESC1> {
        // SAFETY: a live swap chain.
        unsafe { self.swapchain.GetDesc1() }.map_err(|e| failed_on(self.gpu.device(), "IDXGISwapChain1::GetDesc1", &e))
    }

    /// Size and format of the back buffers.
    fn buffers(&self) -> Result<(Dimensions, SurfaceFormat)> {
        let DXGI_SWAP_CHAIN_DESC1 { Width: width, Height: height, Format: format, .. } = self.description()?;
        Ok((Dimensions { width, height }, SurfaceFormat::from_dxgi(format.0.cast_unsigned())))
    }
}

impl Drop for Swapchain {
    /// In the order that AMD's documentation asks for: generation off, all frames presented, the generator, the swap chain, the
    /// pacing context.
    fn drop(&mut self) {
        // Nobody presents any more, so that a generator that could not be turned off is not called.
        let off = self.pause();
        let ended = self.end_generator();
        if let Err(why) = off.and(ended) {
            log::error!(target: "cairn::ffx", "a swap chain ends while frames may be under way: {why}");
        }
        self.generator = None;
        // The remaining fields are dropped after this, in order.
    }
}

impl std::fmt::Debug for Swapchain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let version = |provider: Result<&Provider>| provider.map(|provider| provider.version.to_string()).ok();
        write!(f, "Swapchain({:?}, {:?})", version(self.provider()), version(Ok(self.pacer())))
    }
}

/// Creates the pacing context.
fn create_pacing_context(
    gpu: &Gpu,
    api: &Api,
    structs: &mut CreationStructs,
    from: SwapchainSource<'_>,
) -> Result<Box<dyn Pacer>> {
    let (device, queue) = (gpu.device().as_raw(), gpu.frames().d3d12().as_raw());
    let fullscreen = std::ptr::from_mut(&mut structs.fullscreen).cast();
    // SAFETY: a live device and queue, which the caller holds; what the chains point to keeps its address as long as the context
    // lives.
    Ok(unsafe {
        match from {
            SwapchainSource::Wrap(wrapped) => {
                // The library owns it from here on, whatever it returns: it may have released it before it failed.
                structs.swapchain = wrapped.take().map_or(null_mut(), IDXGISwapChain4::into_raw);
                let swapchain = &raw mut structs.swapchain;
                let head = CreateSwapchainWrap { swapchain, queue, ..Default::default() };
                Box::new(Context::create(api, device, Choice::Any, head, |chain| chain)?)
            }
            SwapchainSource::New(factory, _) => {
                let (swapchain, factory) = (&raw mut structs.swapchain, factory.as_raw());
                let description = std::ptr::from_mut(&mut structs.description).cast();
                let head = CreateSwapchainNew { swapchain, description, factory, queue, ..Default::default() };
                Box::new(Context::create(api, device, Choice::Any, head, |chain| chain)?)
            }
            SwapchainSource::ForWindow(factory, window, ..) => {
                let head = CreateSwapchainForWindow {
                    swapchain: &raw mut structs.swapchain,
                    window: window.0,
                    description: std::ptr::from_mut(&mut structs.of_window).cast(),
                    fullscreen,
                    factory: factory.as_raw(),
                    queue,
                    ..Default::default()
                };
                Box::new(Context::create(api, device, Choice::Any, head, |chain| chain)?)
            }
        }
    })
}

/// The struct that creates a pacing context.
fn creation_struct(from: &SwapchainSource<'_>) -> StructId {
    match from {
        SwapchainSource::Wrap(_) => CreateSwapchainWrap::ID,
        SwapchainSource::New(..) => CreateSwapchainNew::ID,
        SwapchainSource::ForWindow(..) => CreateSwapchainForWindow::ID,
    }
}

fn same_size(a: Dimensions, b: Dimensions) -> bool {
    (a.width, a.height) == (b.width, b.height)
}

fn head_of(options: &SwapchainOptions, (width, height): (u32, u32), format: SurfaceFormat) -> CreateFrameGeneration {
    CreateFrameGeneration {
        flags: options.flags,
        display_size: Dimensions { width, height },
        max_render_size: options.max_render_size.unwrap_or(Dimensions { width, height }),
        back_buffer_format: format,
        ..Default::default()
    }
}

/// Creates the generator; with `options.self_test`, of a provider that passes the self-test.
fn generator(gpu: &Gpu, api: &Api, options: &SwapchainOptions, head: CreateFrameGeneration) -> Result<Generator> {
    let mut choice = options.choice;
    if options.self_test {
        let tested =
            TextureOptions { choice, head, hudless: options.hudless, self_test: true, detect_pass_through: false };
        let tested = TextureGenerator::new(gpu, api, &tested)?;
        choice = tested.provider().version.family().map_or(choice, Choice::Require);
    }
    // SAFETY: a live device, of which the swap chain holds a reference as long as the context lives.
    unsafe { Generator::create(api, gpu.device().as_raw(), choice, head, options.hudless) }
}

/// The error of calls after a failed [`Swapchain::fit`].
fn no_generator() -> Error {
    Error::new(ErrorKind::InvalidState, "there is no generator for the size of the buffers")
        .field("swapchain")
        .remedy("Call fit, which says why")
}
