//! A swap chain of AMD's, which presents generated frames between an engine's own and spreads them over time. Windows only.
//!
//! An engine that lets AMD present gives up its swap chain for this one and draws as ever: into its buffers, with a `Present` at the
//! end. Before that it records motion and depth of the frame ([`Swapchain::prepare`]). What lies between two frames is recorded by the
//! swap chain, within `Present`, by way of a callback that hands its struct on to the generator.

mod present_fence;
mod settings;
mod taken;

use std::cell::Cell;
use std::ffi::c_void;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use parking_lot::ReentrantMutex;
use windows::Win32::Graphics::Direct3D12::{D3D12_COMMAND_LIST_TYPE_DIRECT, ID3D12GraphicsCommandList, ID3D12Resource};
use windows::Win32::Graphics::Dxgi::{
    DXGI_SWAP_CHAIN_DESC, DXGI_SWAP_CHAIN_DESC1, DXGI_SWAP_CHAIN_FULLSCREEN_DESC, IDXGISwapChain4,
};
use windows::core::Interface as _;

use super::bindings::{
    ConfigureFrameGeneration, ConfigureInterface, ConfigureSwapchainKeyValue, CreateFrameGeneration,
    CreateSwapchainForWindow, CreateSwapchainNew, CreateSwapchainWrap, Creates, Dimensions, DispatchFrameGeneration,
    DispatchWait, FrameFlags, InterfaceFlags, MemoryUsage, PacingTuning, QuerySwapchainMemory, RawContext, Resource,
    ResourceState, ReturnCode, SurfaceFormat, SwapchainKey,
};
use super::clean_motion::CleanMotion;
use super::textures::{READ, TextureGenerator, TextureOptions, motion_size_at, picture};
use super::{Api, Chain, Choice, Context, Frame, Generator, Provider, Shot};
use crate::gpu::compute::{CommandRing, ResourceWithState};
use crate::gpu::{Gpu, check_list, failed_on};
use crate::{Error, ErrorKind, Result};
use present_fence::PresentFence;
pub use settings::{
    Interface, Paced, PacedPictures, Pacing, SwapchainMemory, SwapchainOptions, swapchain_memory_needed,
};
use taken::{references, wrapped};

/// A swap chain of AMD's, with the generator of its frames.
///
/// Threads: one at a time, with `Present` and all else that is done to the DXGI swap chain; may move between them. It has threads of
/// its own, which present.
pub struct Swapchain {
    /// Dropped first: it signals what the ring waits for.
    presented: PresentFence,
    ring: CommandRing,
    gpu: Gpu,
    api: Api,
    options: SwapchainOptions,
    motion: CleanMotion,
    generator: Option<Generator>,
    /// What the callback is given; stays at its place.
    shared: Box<Shared>,
    // Dropped in this order: the swap chain, and then what paces it.
    swapchain: IDXGISwapChain4,
    /// References to it as it came, ours and the library's own.
    held_at_first: u32,
    pacer: Box<dyn Pacer>,
    /// Where the pacer was told that its swap chain, and what it is made of, is.
    _given: Box<Given>,
    interface: Option<ID3D12Resource>,
    /// What `Present` reads of the last frame.
    hudless: [Option<ID3D12Resource>; 2],
    is_on: bool,
}

/// What stands in the chain of the context that paces.
#[derive(Default)]
struct Given {
    swapchain: *mut c_void,
    description: DXGI_SWAP_CHAIN_DESC,
    of_window: DXGI_SWAP_CHAIN_DESC1,
    fullscreen: DXGI_SWAP_CHAIN_FULLSCREEN_DESC,
}

// SAFETY: the library's context and its swap chain may be used by one thread after the other, and objects of Direct3D 12 are
// free-threaded; what its own threads are given is `Shared`.
unsafe impl Send for Swapchain {}

/// What the callback that generates a frame needs.
struct Shared {
    api: Api,
    /// The generator's context; calls of it take turns.
    context: ReentrantMutex<Cell<RawContext>>,
    /// The frame that starts anew; 0 for none.
    reset: AtomicU64,
    /// Frames that were generated.
    generated: AtomicU64,
    /// What the last one was answered that was not.
    failed: AtomicU32,
}

// SAFETY: the context is only used under its lock.
unsafe impl Send for Shared {}
// SAFETY: as above.
unsafe impl Sync for Shared {}

/// A context that paces, whatever it was made with.
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

thread_local! {
    /// Whether AMD's library generates a frame on this thread for a swap chain, whose end waits for that.
    static GENERATES: Cell<bool> = const { Cell::new(false) };
}

/// Whether this is a thread that presents for AMD's library, in a message of a frame that it generates.
pub(crate) fn is_presenting_thread() -> bool {
    GENERATES.get()
}

/// Hands the struct of a frame on to the generator.
unsafe extern "C" fn generate(asked: *mut DispatchFrameGeneration, user: *mut c_void) -> ReturnCode {
    if asked.is_null() || user.is_null() {
        return ReturnCode::PARAMETER;
    }
    // SAFETY: what `prepare` told, which stays until generation was turned off.
    let shared = unsafe { &*user.cast::<Shared>() };
    let lock = shared.context.lock();
    let context = lock.get();
    if context.is_null() {
        return ReturnCode::ERROR;
    }
    // SAFETY: the library's own struct, which it lets be altered.
    unsafe {
        if (*asked).frame_id == shared.reset.load(Ordering::Relaxed) {
            (*asked).reset = true;
        }
    }
    let before = GENERATES.replace(true);
    // SAFETY: a live context, and the struct that the library has just handed over.
    let code = unsafe { shared.api.forward(context, asked.cast()) };
    GENERATES.set(before);
    if code == ReturnCode::OK {
        shared.generated.fetch_add(1, Ordering::Relaxed);
    } else {
        shared.failed.store(code.0, Ordering::Relaxed);
    }
    code
}

impl Swapchain {
    /// Makes a swap chain of AMD's on `gpu`, whose queue for frames is the direct queue that the engine draws on.
    ///
    /// All else is made first: where that fails, a swap chain that was to be taken over is whole and its owner's. Of one that AMD's
    /// library has been given nothing is left, also where it fails.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for what AMD's library would fail, hang or crash on: a queue that is not direct, a swap
    /// chain that is full screen, of no size, or that somebody else holds; `Unsupported`, of `provider`, when no generator stands the
    /// test; what the library answers; `OutOfMemory`, `DeviceRemoved`.
    pub fn new(gpu: &Gpu, api: &Api, options: &SwapchainOptions, from: Paced<'_>) -> Result<Self> {
        let refuse = |field: &str, why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        if gpu.frames().kind() != D3D12_COMMAND_LIST_TYPE_DIRECT {
            return refuse("queue", "AMD's swap chain draws on it, and it is not direct");
        }
        let mut given = Box::<Given>::default();
        let shown = match &from {
            Paced::Wrap(Some(swapchain)) => wrapped(gpu, swapchain)?,
            Paced::Wrap(None) => return refuse("swapchain", "there is none"),
            Paced::New(_, desc) => {
                given.description = *desc;
                if !desc.Windowed.as_bool() {
                    return refuse("description.Windowed", "AMD's swap chain lives in a window");
                }
                if desc.OutputWindow.is_invalid() {
                    return refuse("description.OutputWindow", "there is no window");
                }
                let mode = desc.BufferDesc;
                (mode.Width, mode.Height, mode.Format)
            }
            Paced::ForWindow(_, window, desc, fullscreen) => {
                given.of_window = *desc;
                given.fullscreen = fullscreen.unwrap_or_default();
                if fullscreen.is_some_and(|fullscreen| !fullscreen.Windowed.as_bool()) {
                    return refuse("fullscreen.Windowed", "AMD's swap chain lives in a window");
                }
                if window.is_invalid() {
                    return refuse("window", "there is none");
                }
                (desc.Width, desc.Height, desc.Format)
            }
        };
        let options = *options;
        let head = head_of(&options, (shown.0, shown.1), SurfaceFormat::from_dxgi(shown.2.0.cast_unsigned()));
        let generator = generator(gpu, api, &options, head)?;
        let shared = Box::new(Shared {
            api: *api,
            context: ReentrantMutex::new(Cell::new(generator.context().raw())),
            reset: AtomicU64::new(0),
            generated: AtomicU64::new(0),
            failed: AtomicU32::new(0),
        });
        let (presented, ring) = (PresentFence::new(gpu)?, CommandRing::new(gpu, gpu.frames(), CleanMotion::ROOM)?);
        let motion = CleanMotion::new(gpu, motion_size_at(&head, head.max_render_size))?;
        let pacer = pace(gpu, api, &mut given, from)?;
        if given.swapchain.is_null() {
            return Err(Error::new(ErrorKind::Device, "AMD's library says that it succeeded, and gave no swap chain"));
        }
        // SAFETY: the library has written a swap chain there, with a reference for its host.
        let swapchain = unsafe { IDXGISwapChain4::from_raw(given.swapchain) };
        Ok(Self {
            held_at_first: references(&swapchain),
            swapchain,
            pacer,
            presented,
            ring,
            gpu: gpu.clone(),
            api: *api,
            options,
            motion,
            generator: Some(generator),
            shared,
            _given: given,
            interface: None,
            hudless: [None, None],
            is_on: false,
        })
    }

    /// The swap chain itself, to be drawn into and presented by. Every reference that an engine takes, and those to its buffers, it
    /// lets go of before this is dropped.
    pub fn dxgi(&self) -> &IDXGISwapChain4 {
        &self.swapchain
    }

    /// How many references to it others hold, that are to be let go of before this is dropped. Of its buffers it does not say.
    pub fn held_by_others(&self) -> u32 {
        references(&self.swapchain).saturating_sub(self.held_at_first)
    }

    /// Who generates frames.
    ///
    /// # Errors
    /// `InvalidState` after [`fit`](Self::fit) has failed.
    pub fn provider(&self) -> Result<&Provider> {
        self.generator.as_ref().map(Generator::provider).ok_or_else(no_generator)
    }

    /// Who presents them.
    pub fn pacer(&self) -> &Provider {
        self.pacer.provider()
    }

    /// Frames that were generated so far.
    pub fn generated(&self) -> u64 {
        self.shared.generated.load(Ordering::Relaxed)
    }

    /// What the generator has answered last within `Present` where it failed: frames are presented without one between then.
    pub fn failed(&self) -> Option<ReturnCode> {
        Some(ReturnCode(self.shared.failed.load(Ordering::Relaxed))).filter(|code| *code != ReturnCode::OK)
    }

    /// What both keep on the device.
    ///
    /// # Errors
    /// What the library answers.
    pub fn memory(&mut self) -> Result<SwapchainMemory> {
        let lock = self.shared.context.lock();
        let generator = self.generator.as_mut().map(Generator::memory).transpose()?.flatten();
        drop(lock);
        let mut usage = MemoryUsage::default();
        let mut query = Chain::new(QuerySwapchainMemory { usage: &mut usage, ..Default::default() });
        let pacer = &self.pacer;
        // SAFETY: our own context, and a place for the answer that lives during the call.
        let known = super::memory::known(unsafe { pacer.api().query(pacer.raw(), &mut query) })?;
        Ok(SwapchainMemory { generator, swapchain: known.then_some(usage) })
    }

    /// Records motion and depth of the frame that is presented next into `list`, an engine's open one for its queue, which is given to it
    /// before `Present`. That presents a frame between this one and the one before, unless `shot` says that there is none before.
    ///
    /// Of `shot` transfer and luminance are not looked at: AMD's swap chain has them of `SetColorSpace1` and `SetHDRMetaData`.
    ///
    /// Left bound are others than before: descriptor heaps, compute root signature and pipeline, and nothing else.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for what a provider would fail, hang or crash on, before anything is recorded; `InvalidState`
    /// where the swap chain's buffers were resized and [`fit`](Self::fit) was not called; what the library answers, and then the list
    /// may hold a part of the work.
    pub fn prepare(
        &mut self,
        list: &ID3D12GraphicsCommandList,
        pictures: &PacedPictures<'_>,
        shot: &Shot,
    ) -> Result<()> {
        check_list(&self.gpu, list)?;
        let made = *self.generator.as_ref().ok_or_else(no_generator)?.made_with();
        let size = self.size()?;
        if !same(size, made.display_size) {
            let (of, now) = (made.display_size, size);
            let why = format!("it was {} x {} pixels and is {} x {}", of.width, of.height, now.width, now.height);
            return Err(Error::new(ErrorKind::InvalidState, why).field("swapchain").remedy("Call fit after a resize"));
        }
        const INPUT: ResourceState = ResourceState::COMPUTE_READ;
        let told = |resting: &ResourceWithState<'_>, size, field: &str, state| {
            picture(&self.gpu, resting, size, field).map(|()| Resource::of(resting.resource, state))
        };
        let motion_size = motion_size_at(&made, shot.render_size);
        let depth = told(&pictures.depth, shot.render_size, "depth", INPUT)?;
        told(&pictures.motion, motion_size, "motion", INPUT)?;
        let resting = |given: &ResourceWithState<'_>, field: &str| {
            let state = ResourceState::from_d3d12(given.state.0.cast_unsigned());
            let state = state.ok_or_else(|| {
                Error::new(ErrorKind::InvalidArgument, "AMD's swap chain has no word for its state").field(field)
            })?;
            told(given, size, field, state)
        };
        // These are read later, in the state that they rest in.
        let late = |given: &Option<ResourceWithState<'_>>, field: &str| {
            given.as_ref().map_or(Ok(Resource::default()), |given| resting(given, field))
        };
        let (hudless, distortion) = (late(&pictures.hudless, "hudless")?, late(&pictures.distortion, "distortion")?);
        // The list before this one has been given to the queue.
        self.presented.presented()?;
        let until = self.presented.next()?;
        let mut frame = self.ring.begin_in(list, &until)?;
        let clean = self.motion.record(&self.gpu, &mut frame, &pictures.motion, motion_size, shot.motion_scale)?;
        frame.bring(&clean, READ)?;
        frame.bring(&pictures.depth, READ)?;
        let asked = Frame {
            command_list: frame.list().as_raw(),
            color: Resource::default(),
            output: Resource::default(),
            depth,
            motion: Resource::of(clean.resource, INPUT),
            hudless,
            distortion,
            shot: *shot,
        };
        let generator = self.generator.as_mut().ok_or_else(no_generator)?;
        let settings = ConfigureFrameGeneration {
            swapchain: self.swapchain.as_raw(),
            generate: Some(generate),
            generate_user: std::ptr::from_ref(&*self.shared).cast_mut().cast(),
            flags: FrameFlags::empty(),
            ..Default::default()
        };
        let lock = self.shared.context.lock();
        // SAFETY: the frame's open list; what it uses is of the device, in the states that were told, and held by the frame or by this;
        // the swap chain and what its callback is given outlive generation, which is turned off first.
        let (id, reset) = unsafe { generator.prepare(&asked, settings) }?;
        self.shared.reset.store(if reset { id } else { 0 }, Ordering::Relaxed);
        drop(lock);
        frame.resume();
        self.is_on = true;
        // What `Present` reads now, and may still read of the one before.
        let [last, _] = std::mem::take(&mut self.hudless);
        self.hudless = [pictures.hudless.map(|given| given.resource.clone()), last];
        Ok(())
    }

    /// Presents frames as they come from now on, none between them, until one is prepared again.
    ///
    /// # Errors
    /// What the library answers.
    pub fn pause(&mut self) -> Result<()> {
        let Some(generator) = self.generator.as_mut().filter(|_| self.is_on) else { return Ok(()) };
        // Without the lock: the library may wait here for a frame that is being generated.
        // SAFETY: a live swap chain of the library's.
        unsafe { generator.turn_off(self.swapchain.as_raw()) }?;
        self.is_on = false;
        self.wait()
    }

    /// Waits until all frames that were given to `Present` are shown.
    ///
    /// # Errors
    /// What the library answers.
    pub fn wait(&mut self) -> Result<()> {
        let pacer = &self.pacer;
        // SAFETY: our own context; the struct is alone.
        unsafe { pacer.api().dispatch(pacer.raw(), &mut Chain::new(DispatchWait::default())) }
            .map_err(|failure| failure.error())
    }

    /// Says what is laid over frames from the next `Present` on; None for nothing. Waits for frames that show the one before.
    ///
    /// # Errors
    /// `InvalidArgument` for a picture of another size or device, or in a state that AMD's library has no word for; what it answers.
    pub fn set_interface(&mut self, interface: Option<Interface<'_>>) -> Result<()> {
        let mut told = ConfigureInterface::default();
        if let Some(Interface { picture: given, premultiplied, copied }) = &interface {
            picture(&self.gpu, given, self.size()?, "interface")?;
            let state = ResourceState::from_d3d12(given.state.0.cast_unsigned()).ok_or_else(|| {
                Error::new(ErrorKind::InvalidArgument, "AMD's swap chain has no word for its state").field("interface")
            })?;
            told.interface = Resource::of(given.resource, state);
            if let Some(why) = told.interface.fault(self.size()?) {
                return Err(Error::new(ErrorKind::InvalidArgument, why).field("interface"));
            }
            told.flags.set(InterfaceFlags::PREMULTIPLIED, *premultiplied);
            told.flags.set(InterfaceFlags::DOUBLE_BUFFERED, *copied);
        }
        let next = interface.map(|interface| interface.picture.resource.clone());
        if self.interface.is_some() && self.interface != next {
            self.wait()?;
        }
        let pacer = &self.pacer;
        // SAFETY: our own context; the picture is held until another is told.
        unsafe { pacer.api().configure(pacer.raw(), &mut Chain::new(told)) }.map_err(|failure| failure.error())?;
        self.interface = next;
        Ok(())
    }

    /// Says how presents are spread over time.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for what is outside its range; what the library answers: `Unsupported` of SDK 1.1.1 and earlier.
    pub fn set_pacing(&mut self, pacing: &Pacing) -> Result<()> {
        let refuse = |field: &str, why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
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
        let mut told = Chain::new(ConfigureSwapchainKeyValue { key, pointer, ..Default::default() });
        let pacer = &self.pacer;
        // SAFETY: our own context, and a struct that is read during the call.
        unsafe { pacer.api().configure(pacer.raw(), &mut told) }.map_err(|failure| failure.error())
    }

    /// Makes it ready for the size and format that its buffers have now: after `ResizeBuffers`, before the next frame. Where it fails
    /// frames are presented as they come, until it succeeds.
    ///
    /// # Errors
    /// As of [`new`](Self::new), for the generator.
    pub fn fit(&mut self) -> Result<()> {
        let size = self.size()?;
        let format = SurfaceFormat::from_dxgi(self.description()?.Format.0.cast_unsigned());
        let fits = |made: &CreateFrameGeneration| same(made.display_size, size) && made.back_buffer_format == format;
        if self.generator.as_ref().is_some_and(|generator| fits(generator.made_with())) {
            return Ok(());
        }
        self.end_generator()?;
        let options = SwapchainOptions { self_test: false, ..self.options };
        let head = head_of(&options, (size.width, size.height), format);
        let made = generator(&self.gpu, &self.api, &options, head)?;
        self.shared.context.lock().set(made.context().raw());
        self.generator = Some(made);
        Ok(())
    }

    /// Turns generation off and lets the generator go, once nothing uses it any more.
    fn end_generator(&mut self) -> Result<()> {
        let off = self.pause();
        self.presented.presented()?;
        // What it generated was on the engine's queue.
        self.gpu.frames().now()?.wait()?;
        self.ring.finish()?;
        self.shared.context.lock().set(null_mut());
        self.generator = None;
        self.hudless = [None, None];
        off
    }

    /// What the swap chain says that it is.
    fn description(&self) -> Result<DXGI_SWAP_CHAIN_DESC1> {
        // SAFETY: a live swap chain.
        unsafe { self.swapchain.GetDesc1() }.map_err(|e| failed_on(self.gpu.device(), "IDXGISwapChain1::GetDesc1", &e))
    }

    /// The size shown.
    fn size(&self) -> Result<Dimensions> {
        let DXGI_SWAP_CHAIN_DESC1 { Width: width, Height: height, .. } = self.description()?;
        Ok(Dimensions { width, height })
    }
}

impl Drop for Swapchain {
    /// In the order that AMD's documents want: generation off, all presented, the generator, the swap chain, what paces it.
    fn drop(&mut self) {
        if let Err(why) = self.end_generator() {
            log::error!(target: "cairn::ffx", "a swap chain ends while frames may be under way: {why}");
        }
        self.generator = None;
        // And then the fields that follow.
    }
}

impl std::fmt::Debug for Swapchain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let version = |provider: Result<&Provider>| provider.map(|provider| provider.version.to_string()).ok();
        write!(f, "Swapchain({:?}, {:?})", version(self.provider()), version(Ok(self.pacer())))
    }
}

/// Makes the context that paces.
fn pace(gpu: &Gpu, api: &Api, given: &mut Given, from: Paced<'_>) -> Result<Box<dyn Pacer>> {
    let (device, queue) = (gpu.device().as_raw(), gpu.frames().d3d12().as_raw());
    let fullscreen = std::ptr::from_mut(&mut given.fullscreen).cast();
    // SAFETY: a live device and queue, which the caller holds; what the chains point to stays at its place as long as the context.
    Ok(unsafe {
        match from {
            Paced::Wrap(wrapped) => {
                // The library's from here on, whatever it answers: it may have let go of it before it failed.
                given.swapchain = wrapped.take().map_or(null_mut(), IDXGISwapChain4::into_raw);
                let swapchain = &raw mut given.swapchain;
                let head = CreateSwapchainWrap { swapchain, queue, ..Default::default() };
                Box::new(Context::create(api, device, Choice::Any, head, |chain| chain)?)
            }
            Paced::New(factory, _) => {
                let (swapchain, factory) = (&raw mut given.swapchain, factory.as_raw());
                let description = std::ptr::from_mut(&mut given.description).cast();
                let head = CreateSwapchainNew { swapchain, description, factory, queue, ..Default::default() };
                Box::new(Context::create(api, device, Choice::Any, head, |chain| chain)?)
            }
            Paced::ForWindow(factory, window, ..) => {
                let head = CreateSwapchainForWindow {
                    swapchain: &raw mut given.swapchain,
                    window: window.0,
                    description: std::ptr::from_mut(&mut given.of_window).cast(),
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

fn same(a: Dimensions, b: Dimensions) -> bool {
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

/// The generator, of a provider that stands the test.
fn generator(gpu: &Gpu, api: &Api, options: &SwapchainOptions, head: CreateFrameGeneration) -> Result<Generator> {
    let mut choice = options.choice;
    if options.self_test {
        let tested = TextureOptions { choice, head, hudless: options.hudless, self_test: true, watch: false };
        let tested = TextureGenerator::new(gpu, api, &tested)?;
        choice = tested.provider().version.family().map_or(choice, Choice::Require);
    }
    // SAFETY: a live device, of which the swap chain holds a reference as long as the context lives.
    unsafe { Generator::create(api, gpu.device().as_raw(), choice, head, options.hudless) }
}

/// Cannot come about but after a failed [`Swapchain::fit`].
fn no_generator() -> Error {
    Error::new(ErrorKind::InvalidState, "there is no generator for the size of the buffers")
        .field("swapchain")
        .remedy("Call fit, which says why")
}
