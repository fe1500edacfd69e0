//! Renders a presenter's frames for Direct3D 12 with AMD's generator, the library's shaders or the CPU. Windows only.

mod prepare;

use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_FORMAT_UNKNOWN};

use super::Selection;
use super::device::{DeviceDrawer, FrameResult, LISTS, RetiredFrames, ScaledBy, check_recording};
use super::presenter::{DrawMode, FrameInfo, Presenter};
pub use super::{Preference, RendererOptions};
use crate::gpu::compute::{CommandRing, GpuTimeStatistics};
use crate::gpu::{FencePoint, Gpu, Target, Uploads};
use crate::locks::{Mutex, MutexGuard};
use crate::object_count::count_created;
use crate::runtime::Device;
use crate::{Colours, Error, ErrorKind, Result};
use prepare::{Amd, PrepareRequest, UnusedReasons};

/// Sizes and formats to prepare for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PrepareOptions {
    /// Width and height of the targets in pixels; `None`: those of the presenter's frames.
    pub size: Option<(u32, u32)>,
    /// Width and height of the anchors in pixels; `None`: those of the anchors that have arrived.
    pub anchor_size: Option<(u32, u32)>,
    /// Format of the targets; `DXGI_FORMAT_UNKNOWN` for any, with memory for 8 bytes per pixel.
    pub format: DXGI_FORMAT,
    /// How many recorded frames may wait for the engine's lists to run; 0 if frames are only submitted.
    pub lists: usize,
    /// Pictures per anchor, at least 1.
    pub pictures: usize,
    /// Channels, height and width of the anchors' latents; zeros if motion is not extracted from latents.
    pub latent: [u32; 3],
}

impl Default for PrepareOptions {
    fn default() -> Self {
        let format = DXGI_FORMAT_UNKNOWN;
        Self { size: None, anchor_size: None, format, lists: LISTS, pictures: 1, latent: [0; 3] }
    }
}

/// Callback that returns the bytes of compiled pipelines, if there are any.
pub type LoadPipelines<'a> = dyn FnMut() -> Option<Vec<u8>> + 'a;

/// Callback that stores the bytes of compiled pipelines.
pub type StorePipelines<'a> = dyn FnMut(&[u8]) + 'a;

/// Callbacks that keep a device's compiled pipelines for the next run of a program.
#[derive(Default)]
pub struct PipelineCallbacks<'a> {
    /// Returns the bytes that `store` received in an earlier run, or `None`. Called once per device. Damaged bytes, and bytes of another
    /// adapter, driver or version, are ignored.
    pub load: Option<&'a mut LoadPipelines<'a>>,
    /// Receives all of the device's pipelines, if some were compiled that were neither loaded nor stored before.
    pub store: Option<&'a mut StorePipelines<'a>>,
}

/// Result of a request for a frame.
#[derive(Debug)]
pub enum RenderResult {
    /// No anchor has arrived.
    NotReady,
    /// Every slot holds a recorded frame whose list may not have run; nothing was recorded.
    QueueFull,
    /// It was recorded or submitted. A submitted one comes with the fence value that guards its target.
    Frame(FrameInfo, Option<FencePoint>),
}

/// Statistics of a renderer.
#[derive(Debug, Clone, Default)]
pub struct RendererStatistics {
    /// Submitted frames that have not run.
    pub in_flight: usize,
    /// Recorded frames whose lists may not have run.
    pub lists_pending: usize,
    /// Device time of frames.
    pub frames: GpuTimeStatistics,
    /// Device time of the lists that upload anchors and upload or extract guidance.
    pub anchors: GpuTimeStatistics,
    /// The generator of the last frame; `None` before the first frame.
    pub generator: Option<Selection>,
    /// The upscaler of the last frame; `None` if the CPU made the frame.
    pub upscaler: Option<Selection>,
}

/// Makes a presenter's frames for Direct3D 12.
///
/// [`prepare`](Self::prepare) creates pipelines, textures, memory and AMD's contexts on a loading thread. Until it is done, and for frames of
/// another size, format or device, frames show the nearest anchor. A renderer belongs to one presenter; pass the same one to all calls.
///
/// Threads: any; one frame at a time, while another thread may prepare.
pub struct Renderer {
    options: RendererOptions,
    /// Held while the previous preparation is destroyed. Locked before `state`.
    replacing: Mutex<()>,
    state: Mutex<State>,
    /// Locked by the preparing thread. Keeps AMD's libraries loaded, so it must be dropped after everything that uses them.
    amd: Mutex<Amd>,
}

/// The reason that is reported if AMD's generator is in use and did not make a frame.
const ONLY_HALF_WAY: &str = "fsr: it makes frames half way between two anchors, and no others";

/// The reason that is reported if AMD's upscaler is available and not used.
const ONLY_UPSCALES: &str = "fsr: it upscales anchors, except those whose decoded pictures are all frames";

/// The reason that is reported if an anchor replaces a frame. It names the call of the C interface that hosts lack.
const NOT_PREPARED: &str =
    "not prepared: cairn_presenter_prepare_d3d12 was not called for this device, and these sizes and formats";

/// Resources and results, locked while a frame is recorded.
#[derive(Default)]
struct State {
    prepared: Option<Prepared>,
    /// Makes the anchors that replace unprepared frames.
    anchors: Option<CpuRenderer>,
    /// Frames of earlier preparations that the engine's lists may still read.
    retired: RetiredFrames,
    /// Upload memory of earlier preparations that the engine's lists may still read.
    retired_uploads: Vec<Uploads>,
    /// Device time of earlier preparations: for frames and for anchors.
    earlier_times: [GpuTimeStatistics; 2],
    /// Why the CPU made the last frame; empty if shaders made it, `None` before the first frame.
    cpu_reason: Option<String>,
}

/// Resources for frames of one size.
struct Prepared {
    gpu: Gpu,
    path: RenderPath,
    /// Why AMD's generator and upscaler are not used.
    unused: UnusedReasons,
}

/// How the frames of a preparation are made.
enum RenderPath {
    Shaders(Box<DeviceDrawer>),
    Cpu(Box<CpuPath>),
}

/// Frame generation on the CPU.
struct CpuPath {
    renderer: CpuRenderer,
    /// Size of the targets.
    size: (u32, u32),
    /// Largest number of bytes per pixel of the targets.
    pixel_bytes: u32,
    /// Why shaders are not used.
    reason: String,
}

/// Makes frames on the CPU and copies them into targets.
struct CpuRenderer {
    /// Upload memory that lists copy from.
    uploads: Uploads,
    /// Command lists for submitted frames.
    lists: CommandRing,
}

impl Renderer {
    /// Creates a renderer without a preparation.
    pub fn new(options: RendererOptions) -> Self {
        Self { options, replacing: Mutex::default(), state: Mutex::default(), amd: Mutex::default() }
    }

    /// Creates all resources for frames and uses them from then on; `false` if the size of the anchors is unknown, from anchors or `options`. May
    /// take seconds. Meanwhile frames use the preparation before.
    ///
    /// # Errors
    /// `Busy` while another thread prepares; `InvalidArgument` for an unsupported format; `Unsupported` for a device other than Direct3D 12; this or
    /// `RuntimeMissing` if a required generator or upscaler cannot be used; `OutOfMemory`, `Device`, `DeviceRemoved`.
    pub fn prepare(
        &self,
        presenter: &Presenter,
        device: &Device,
        options: &PrepareOptions,
        pipelines: PipelineCallbacks<'_>,
    ) -> Result<bool> {
        let gpu = device.gpu().ok_or_else(|| Error::new(ErrorKind::Unsupported, "it is no Direct3D 12 device"))?;
        let Some(mut amd) = self.amd.try_lock() else {
            return Err(Error::new(ErrorKind::Busy, "another thread prepares the presenter")
                .remedy("Wait for that call to return"));
        };
        amd.set_search(device.library_search());
        let mut request =
            PrepareRequest { preferences: &self.options, presenter, gpu, options, amd: &mut amd, pipelines };
        let made = match request.prepare() {
            Err(error) if error.kind() == ErrorKind::OutOfMemory && self.replace(None) => {
                log::info!("what was prepared before is released, as there is no memory for both");
                request.prepare()
            }
            made => made,
        }?;
        let is_known = made.is_some();
        if is_known {
            self.replace(made);
        }
        Ok(is_known)
    }

    /// Replaces the preparation and drops the one before, without blocking recording; returns whether there was one.
    fn replace(&self, prepared: Option<Prepared>) -> bool {
        // Held until the previous preparation's frames have released their targets, because `release` must not return before.
        let _replacing = self.replacing.lock();
        let mut state = self.state.lock();
        let Some(before) = std::mem::replace(&mut state.prepared, prepared) else { return false };
        match before.path {
            RenderPath::Shaders(mut drawer) => {
                let [frames, anchors] = [drawer.gpu_time(), drawer.gpu_time_of_anchors()];
                state.earlier_times = [state.earlier_times[0].merge(frames), state.earlier_times[1].merge(anchors)];
                drop(state);
                // Waits for the drawer's frames, except those that the engine's lists may still read.
                let retired = drawer.retire();
                self.state.lock().retired.append(retired);
            }
            RenderPath::Cpu(path) => state.retired_uploads.push(path.renderer.uploads),
        }
        true
    }

    /// Records the frame due at `now` into an engine's open list, which has run once `until` is reached. If the frame is not prepared, records
    /// the nearest anchor.
    ///
    /// # Errors
    /// `InvalidArgument` for a list, fence or target that does not fit; `Unsupported`, `OutOfMemory`, `Device`, `DeviceRemoved`.
    pub fn record(
        &self,
        presenter: &Presenter,
        gpu: &Gpu,
        now: u64,
        list: &ID3D12GraphicsCommandList,
        until: &FencePoint,
        target: Target,
    ) -> Result<RenderResult> {
        self.render(presenter, gpu, now, Some((list, until)), target)
    }

    /// Submits the frame due at `now` in a list of the renderer to the device's queue for frames.
    ///
    /// # Errors
    /// As [`record`](Self::record).
    pub fn submit(&self, presenter: &Presenter, gpu: &Gpu, now: u64, target: Target) -> Result<RenderResult> {
        self.render(presenter, gpu, now, None, target)
    }

    fn render(
        &self,
        presenter: &Presenter,
        gpu: &Gpu,
        now: u64,
        list: Option<(&ID3D12GraphicsCommandList, &FencePoint)>,
        target: Target,
    ) -> Result<RenderResult> {
        let mut state = self.state.lock();
        state.retired.pending();
        state.retired_uploads.retain(|uploads| uploads.pending() > 0);
        let (made, objects) = count_created(|| state.render(presenter, gpu, now, list, target, self.options.colours));
        presenter.count_objects(objects);
        made
    }

    /// Waits until all frames have run and releases their targets. Every list must have been submitted, or must never run.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn release(&self) -> Result<()> {
        let _replacing = self.replacing.lock();
        let mut state = self.state.lock();
        let State { prepared, anchors, retired_uploads, retired, .. } = &mut *state;
        let mut uploads: Vec<&mut Uploads> = retired_uploads.iter_mut().collect();
        uploads.extend(anchors.as_mut().map(|renderer| &mut renderer.uploads));
        match prepared.as_mut().map(|prepared| &mut prepared.path) {
            Some(RenderPath::Shaders(drawer)) => drawer.finish()?,
            Some(RenderPath::Cpu(path)) => uploads.push(&mut path.renderer.uploads),
            None => {}
        }
        uploads.into_iter().try_for_each(Uploads::release)?;
        retired_uploads.clear();
        retired.release();
        Ok(())
    }

    /// Returns the statistics. Waits for a recording thread.
    pub fn statistics(&self, presenter: &Presenter) -> RendererStatistics {
        Self::statistics_of(self.state.lock(), presenter)
    }

    /// Returns the statistics without waiting; `None` while a frame is recorded.
    pub fn try_statistics(&self, presenter: &Presenter) -> Option<RendererStatistics> {
        self.state.try_lock().map(|state| Self::statistics_of(state, presenter))
    }

    fn statistics_of(mut state: MutexGuard<'_, State>, presenter: &Presenter) -> RendererStatistics {
        // First, because it reads reports of finished frames.
        let generator = state.generator(presenter);
        let upscaler = state.upscaler();
        RendererStatistics { generator, upscaler, ..state.times() }
    }
}

impl CpuRenderer {
    fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self { uploads: Uploads::new(gpu, LISTS)?, lists: CommandRing::new(gpu, gpu.frames(), 1)? })
    }

    /// Renders the frame due at `now`, or the nearest anchor, on the CPU.
    fn render(
        &mut self,
        presenter: &Presenter,
        mode: DrawMode,
        now: u64,
        list: Option<(&ID3D12GraphicsCommandList, &FencePoint)>,
        target: Target,
        colours: Colours,
    ) -> Result<RenderResult> {
        let Self { uploads, lists } = self;
        let Some(size) = presenter.size() else { return Ok(RenderResult::NotReady) };
        let own = match list {
            Some((list, until)) => {
                check_recording(uploads.gpu(), list, until)?;
                None
            }
            None => Some(lists.begin()?),
        };
        let recorded_in = list.map(|(list, _)| list).or_else(|| own.as_ref().map(|frame| frame.list()));
        let Some(recorded_in) = recorded_in.cloned() else { return Ok(RenderResult::NotReady) };
        let Some(upload) = uploads.begin(recorded_in, target, size, colours)? else {
            return Ok(RenderResult::QueueFull);
        };
        let (mut upload, mut recorded) = (Some(upload), Ok(()));
        let info = presenter.draw_in_mode(mode, now, size, |picture, number| {
            recorded = upload.take().map_or(Ok(()), |upload| upload.record(picture, number));
        })?;
        drop(upload);
        recorded?;
        let Some(info) = info else { return Ok(RenderResult::NotReady) };
        let fence_point = own.map(|frame| frame.submit(uploads.gpu().frames())).transpose()?;
        let until = list.map(|(_, until)| until).or(fence_point.as_ref());
        until.into_iter().for_each(|until| uploads.mark_in_use_until(until));
        Ok(RenderResult::Frame(info, fence_point))
    }
}

impl State {
    fn render(
        &mut self,
        presenter: &Presenter,
        gpu: &Gpu,
        now: u64,
        list: Option<(&ID3D12GraphicsCommandList, &FencePoint)>,
        target: Target,
        colours: Colours,
    ) -> Result<RenderResult> {
        let is_for_queue = |prepared: &&mut Prepared| prepared.gpu.frames().d3d12() == gpu.frames().d3d12();
        match self.prepared.as_mut().filter(is_for_queue).map(|prepared| &mut prepared.path) {
            Some(RenderPath::Shaders(drawer)) => {
                let made = match list {
                    Some((list, until)) => {
                        render_result(presenter.record(now, drawer, list, &target, until)?, |info| {
                            RenderResult::Frame(info, None)
                        })
                    }
                    None => render_result(presenter.submit(now, drawer, &target)?, |(info, fence_point)| {
                        RenderResult::Frame(info, Some(fence_point))
                    }),
                };
                if let Some(made) = made {
                    self.cpu_reason = Some(String::new());
                    return Ok(made);
                }
            }
            Some(RenderPath::Cpu(path)) => {
                let CpuPath { renderer, size, pixel_bytes, reason } = &mut **path;
                let fits = target.pixel_bytes().is_some_and(|bytes| bytes <= *pixel_bytes);
                if fits && presenter.size() == Some(*size) {
                    let made = renderer.render(presenter, DrawMode::AllFrames, now, list, target, colours)?;
                    self.cpu_reason = Some(reason.clone());
                    return Ok(made);
                }
            }
            None => {}
        }
        // Another queue needs upload memory of its own.
        if let Some(other) =
            self.anchors.take_if(|renderer| renderer.uploads.gpu().frames().d3d12() != gpu.frames().d3d12())
        {
            self.retired_uploads.push(other.uploads);
        }
        let renderer = match &mut self.anchors {
            Some(renderer) => renderer,
            none => none.insert(CpuRenderer::new(gpu)?),
        };
        let made = renderer.render(presenter, DrawMode::AnchorsOnly, now, list, target, colours)?;
        self.cpu_reason = Some(NOT_PREPARED.to_owned());
        Ok(made)
    }

    /// The upscaler of the last frame; `None` if the CPU made the frame.
    fn upscaler(&self) -> Option<Selection> {
        let prepared = self.prepared.as_ref().filter(|_| self.cpu_reason.as_ref().is_some_and(String::is_empty))?;
        let RenderPath::Shaders(drawer) = &prepared.path else { return None };
        let (name, reason) = match (drawer.scaled_by(), drawer.upscaler_failed()) {
            (ScaledBy::Nothing, _) => (String::new(), String::new()),
            (ScaledBy::Amd(version), _) => (format!("fsr {}", version.name), String::new()),
            (ScaledBy::Space, Some(failed)) => ("spatial".to_owned(), format!("fsr: {failed}")),
            (ScaledBy::Space, None) if prepared.unused.upscaler.is_empty() => {
                ("spatial".to_owned(), ONLY_UPSCALES.to_owned())
            }
            (ScaledBy::Space, None) => ("spatial".to_owned(), prepared.unused.upscaler.clone()),
        };
        Some(Selection { name, reason })
    }

    /// The generator of the last frame, after the reports of finished frames were read; `None` before the first frame.
    fn generator(&mut self, presenter: &Presenter) -> Option<Selection> {
        let prepared = self.prepared.as_mut();
        if let Some(RenderPath::Shaders(drawer)) = prepared.map(|prepared| &mut prepared.path) {
            presenter.collect_reports(drawer);
        }
        let reason = self.cpu_reason.as_ref()?;
        let prepared = self.prepared.as_ref().filter(|_| reason.is_empty());
        let Some(Prepared { path: RenderPath::Shaders(drawer), unused, .. }) = prepared else {
            return Some(Selection { name: String::new(), reason: reason.clone() });
        };
        let (name, reason) = match (drawer.made_by_fsr(), drawer.fsr_failed()) {
            (Some(version), _) => (format!("fsr {}", version.name), String::new()),
            (None, Some(failed)) => ("shader".to_owned(), format!("fsr: {failed}")),
            (None, None) if unused.fsr.is_empty() => ("shader".to_owned(), ONLY_HALF_WAY.to_owned()),
            (None, None) => ("shader".to_owned(), unused.fsr.clone()),
        };
        Some(Selection { name, reason })
    }

    /// Frames in flight, pending lists and device times.
    fn times(&mut self) -> RendererStatistics {
        let Self { prepared, anchors, retired, retired_uploads, earlier_times, .. } = self;
        let mut in_flight = 0;
        let mut renderers: Vec<&CpuRenderer> = anchors.iter().collect();
        let mut pending = retired.pending() + retired_uploads.iter().map(Uploads::pending).sum::<usize>();
        let [mut frames, mut anchor_work] = *earlier_times;
        match prepared.as_mut().map(|prepared| &mut prepared.path) {
            Some(RenderPath::Shaders(drawer)) => {
                in_flight = drawer.in_flight();
                pending += drawer.pending();
                (frames, anchor_work) =
                    (frames.merge(drawer.gpu_time()), anchor_work.merge(drawer.gpu_time_of_anchors()));
            }
            Some(RenderPath::Cpu(path)) => renderers.push(&path.renderer),
            None => {}
        }
        for CpuRenderer { uploads, lists } in renderers {
            in_flight += lists.in_flight();
            // Copies in our own lists count as in flight.
            pending += uploads.pending().saturating_sub(lists.in_flight());
        }
        RendererStatistics { in_flight, lists_pending: pending, frames, anchors: anchor_work, ..Default::default() }
    }
}

/// Converts the result of a prepared frame; `None` if it was not prepared.
fn render_result<T>(result: FrameResult<T>, made: impl FnOnce(T) -> RenderResult) -> Option<RenderResult> {
    match result {
        FrameResult::Made(frame) => Some(made(frame)),
        FrameResult::NoAnchor => Some(RenderResult::NotReady),
        FrameResult::QueueFull => Some(RenderResult::QueueFull),
        FrameResult::NotPrepared => None,
    }
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Renderer").field("options", &self.options).finish_non_exhaustive()
    }
}
