//! Renders a presenter's frames for Direct3D 12 with AMD's generator, the library's shaders or the CPU. Windows only.

mod prepare;

use parking_lot::{Mutex, MutexGuard};
use windows::Win32::Graphics::Direct3D12::ID3D12GraphicsCommandList;
use windows::Win32::Graphics::Dxgi::Common::{DXGI_FORMAT, DXGI_FORMAT_UNKNOWN};

use super::Selection;
use super::device::{DeviceDrawer, FrameResult, LISTS, RetiredFrames, ScaledBy, check_recording};
use super::presenter::{Draws, FrameInfo, Presenter};
use crate::gpu::compute::{CommandRing, Spent};
use crate::gpu::{FencePoint, Gpu, Target, Uploads};
use crate::object_count::counted;
use crate::runtime::Device;
use crate::{Colours, Error, ErrorKind, Result};
use prepare::{Amd, Request, Without};

/// Whether a generator or an upscaler is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Preference {
    /// If possible.
    #[default]
    Auto,
    /// Always: preparation fails if it cannot be used.
    Require,
    /// Never.
    Never,
}

/// Which generators and upscalers a [`Renderer`] may use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RendererOptions {
    /// Encoding of the targets' colours.
    pub colours: Colours,
    /// AMD's frame generation, for frames half way between two anchors. Needs the shaders, which make all others.
    pub fsr: Preference,
    /// The library's own shaders.
    pub shader: Preference,
    /// AMD's upscaling, for frames larger than the anchors. Needs the shaders.
    pub upscaler: Preference,
}

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
pub enum Rendered {
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
    pub frames: Spent,
    /// Device time of the lists that upload anchors and upload or extract guidance.
    pub anchors: Spent,
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
    state: Mutex<State>,
    /// Locked by the preparing thread. Keeps AMD's libraries loaded, so it must be dropped after everything that uses them.
    amd: Mutex<Amd>,
}

/// The reason that is reported if AMD's generator is in use and did not make a frame.
const ONLY_HALF: &str = "fsr: it makes frames half way between two anchors, and no others";

/// The reason that is reported if AMD's upscaler is available and not used.
const ONLY_LARGER: &str = "fsr: it makes anchors larger, and not those that bring all frames with them";

/// The reason that is reported if an anchor replaces a frame. It names the call of the C interface that hosts lack.
const NOT_PREPARED: &str =
    "not prepared: cairn_presenter_prepare_d3d12 was not called for this device, and these sizes and formats";

#[derive(Default)]
struct State {
    prepared: Option<Prepared>,
    /// Copies anchors that replace unprepared frames.
    anchors: Option<Upload>,
    /// Earlier preparations that the engine's lists may still read.
    retired: RetiredFrames,
    retired_uploads: Vec<Uploads>,
    /// Device time of earlier preparations: for frames and for anchors.
    spent: [Spent; 2],
    /// Why the CPU made the last frame; empty if shaders made it.
    used: Option<String>,
}

/// Resources for frames of one size.
struct Prepared {
    gpu: Gpu,
    made_by: MadeBy,
    without: Without,
}

enum MadeBy {
    Shaders(Box<DeviceDrawer>),
    Processor(Box<OnProcessor>),
}

/// Frame generation on the CPU.
struct OnProcessor {
    upload: Upload,
    size: (u32, u32),
    pixel_bytes: u32,
    /// Why shaders are not used.
    why: String,
}

/// Copies pictures from CPU memory into targets.
struct Upload {
    uploads: Uploads,
    /// Command lists for submitted frames.
    lists: CommandRing,
}

impl Renderer {
    /// A renderer without a preparation.
    pub fn new(options: RendererOptions) -> Self {
        Self { options, state: Mutex::default(), amd: Mutex::default() }
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
        let mut request = Request { renderer: &self.options, presenter, gpu, options, amd: &mut amd, pipelines };
        let made = match request.prepare() {
            Err(why) if why.kind() == ErrorKind::OutOfMemory && self.replace(None) => {
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
        let mut state = self.state.lock();
        let Some(before) = std::mem::replace(&mut state.prepared, prepared) else { return false };
        match before.made_by {
            MadeBy::Shaders(mut drawer) => {
                let [frames, anchors] = [drawer.spent(), drawer.spent_on_anchors()];
                state.spent = [state.spent[0].and(frames), state.spent[1].and(anchors)];
                drop(state);
                // Waits for the drawer's frames, except those that the engine's lists may still read.
                let retired = drawer.retire();
                self.state.lock().retired.append(retired);
            }
            MadeBy::Processor(made_by) => state.retired_uploads.push(made_by.upload.uploads),
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
    ) -> Result<Rendered> {
        self.render(presenter, gpu, now, Some((list, until)), target)
    }

    /// Submits the frame due at `now` in a list of the renderer to the device's queue for frames.
    ///
    /// # Errors
    /// As [`record`](Self::record).
    pub fn submit(&self, presenter: &Presenter, gpu: &Gpu, now: u64, target: Target) -> Result<Rendered> {
        self.render(presenter, gpu, now, None, target)
    }

    fn render(
        &self,
        presenter: &Presenter,
        gpu: &Gpu,
        now: u64,
        list: Option<(&ID3D12GraphicsCommandList, &FencePoint)>,
        target: Target,
    ) -> Result<Rendered> {
        let mut state = self.state.lock();
        state.retired.pending();
        state.retired_uploads.retain(|uploads| uploads.pending() > 0);
        let (made, objects) = counted(|| state.render(presenter, gpu, now, list, target, self.options.colours));
        presenter.count_objects(objects);
        made
    }

    /// Waits until all frames have run and releases their targets. Every list must have been submitted, or must never run.
    ///
    /// # Errors
    /// `DeviceRemoved`.
    pub fn release(&self) -> Result<()> {
        let mut state = self.state.lock();
        let State { prepared, anchors, retired_uploads, retired, .. } = &mut *state;
        let mut uploads: Vec<&mut Uploads> = retired_uploads.iter_mut().collect();
        uploads.extend(anchors.as_mut().map(|upload| &mut upload.uploads));
        match prepared.as_mut().map(|prepared| &mut prepared.made_by) {
            Some(MadeBy::Shaders(drawer)) => drawer.finish()?,
            Some(MadeBy::Processor(made_by)) => uploads.push(&mut made_by.upload.uploads),
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
        // First, as it reads reports of finished frames.
        let generator = state.generator(presenter);
        let upscaler = state.upscaler();
        RendererStatistics { generator, upscaler, ..state.times() }
    }
}

impl Upload {
    fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self { uploads: Uploads::new(gpu, LISTS)?, lists: CommandRing::new(gpu, gpu.frames(), 1)? })
    }

    /// Renders the frame due at `now`, or the nearest anchor, on the CPU.
    fn render(
        &mut self,
        presenter: &Presenter,
        draws: Draws,
        now: u64,
        list: Option<(&ID3D12GraphicsCommandList, &FencePoint)>,
        target: Target,
        colours: Colours,
    ) -> Result<Rendered> {
        let Self { uploads, lists } = self;
        let Some(size) = presenter.size() else { return Ok(Rendered::NotReady) };
        let own = match list {
            Some((list, until)) => {
                check_recording(uploads.gpu(), list, until)?;
                None
            }
            None => Some(lists.begin()?),
        };
        let recorded_in = list.map(|(list, _)| list).or_else(|| own.as_ref().map(|frame| frame.list()));
        let Some(recorded_in) = recorded_in.cloned() else { return Ok(Rendered::NotReady) };
        let Some(place) = uploads.place(recorded_in, target, size, colours)? else { return Ok(Rendered::QueueFull) };
        let (mut place, mut recorded) = (Some(place), Ok(()));
        let shown = presenter.draw_of(draws, now, size, |picture, is_repeated| {
            recorded = place.take().map_or(Ok(()), |place| place.fill(picture, is_repeated));
        })?;
        drop(place);
        recorded?;
        let Some(shown) = shown else { return Ok(Rendered::NotReady) };
        let at = own.map(|frame| frame.submit(uploads.gpu().frames())).transpose()?;
        list.map(|(_, until)| until).or(at.as_ref()).into_iter().for_each(|until| uploads.read_until(until));
        Ok(Rendered::Frame(shown, at))
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
    ) -> Result<Rendered> {
        let is_prepared = |prepared: &&mut Prepared| prepared.gpu.frames().d3d12() == gpu.frames().d3d12();
        match self.prepared.as_mut().filter(is_prepared).map(|prepared| &mut prepared.made_by) {
            Some(MadeBy::Shaders(drawer)) => {
                let made = match list {
                    Some((list, until)) => rendered(presenter.record(now, drawer, list, &target, until)?, |shown| {
                        Rendered::Frame(shown, None)
                    }),
                    None => rendered(presenter.submit(now, drawer, &target)?, |(shown, at)| {
                        Rendered::Frame(shown, Some(at))
                    }),
                };
                if let Some(made) = made {
                    self.used = Some(String::new());
                    return Ok(made);
                }
            }
            Some(MadeBy::Processor(made_by)) => {
                let OnProcessor { upload, size, pixel_bytes, why } = &mut **made_by;
                let fits = target.pixel_bytes().is_some_and(|bytes| bytes <= *pixel_bytes);
                if fits && presenter.size() == Some(*size) {
                    let made = upload.render(presenter, Draws::Frames, now, list, target, colours)?;
                    self.used = Some(why.clone());
                    return Ok(made);
                }
            }
            None => {}
        }
        // Another queue needs upload memory of its own.
        if let Some(other) =
            self.anchors.take_if(|upload| upload.uploads.gpu().frames().d3d12() != gpu.frames().d3d12())
        {
            self.retired_uploads.push(other.uploads);
        }
        let upload = match &mut self.anchors {
            Some(upload) => upload,
            none => none.insert(Upload::new(gpu)?),
        };
        let made = upload.render(presenter, Draws::Anchors, now, list, target, colours)?;
        self.used = Some(NOT_PREPARED.to_owned());
        Ok(made)
    }

    fn upscaler(&self) -> Option<Selection> {
        let prepared = self.prepared.as_ref().filter(|_| self.used.as_ref().is_some_and(String::is_empty))?;
        let MadeBy::Shaders(drawer) = &prepared.made_by else { return None };
        let (name, reason) = match (drawer.scaled_by(), drawer.upscaler_failed()) {
            (ScaledBy::Nothing, _) => (String::new(), String::new()),
            (ScaledBy::Amd(version), _) => (format!("fsr {}", version.name), String::new()),
            (ScaledBy::Space, Some(failed)) => ("spatial".to_owned(), format!("fsr: {failed}")),
            (ScaledBy::Space, None) if prepared.without.upscaler.is_empty() => {
                ("spatial".to_owned(), ONLY_LARGER.to_owned())
            }
            (ScaledBy::Space, None) => ("spatial".to_owned(), prepared.without.upscaler.clone()),
        };
        Some(Selection { name, reason })
    }

    fn generator(&mut self, presenter: &Presenter) -> Option<Selection> {
        let prepared = self.prepared.as_mut();
        if let Some(MadeBy::Shaders(drawer)) = prepared.map(|prepared| &mut prepared.made_by) {
            presenter.collect_reports(drawer);
        }
        let why = self.used.as_ref()?;
        let prepared = self.prepared.as_ref().filter(|_| why.is_empty());
        let Some(Prepared { made_by: MadeBy::Shaders(drawer), without, .. }) = prepared else {
            return Some(Selection { name: String::new(), reason: why.clone() });
        };
        let (name, reason) = match (drawer.made_by_fsr(), drawer.fsr_failed()) {
            (Some(version), _) => (format!("fsr {}", version.name), String::new()),
            (None, Some(failed)) => ("shader".to_owned(), format!("fsr: {failed}")),
            (None, None) if without.fsr.is_empty() => ("shader".to_owned(), ONLY_HALF.to_owned()),
            (None, None) => ("shader".to_owned(), without.fsr.clone()),
        };
        Some(Selection { name, reason })
    }

    /// Frames in flight, pending lists and device times.
    fn times(&mut self) -> RendererStatistics {
        let Self { prepared, anchors, retired, retired_uploads, spent, .. } = self;
        let mut in_flight = 0;
        let mut uploads: Vec<&Upload> = anchors.iter().collect();
        let mut pending = retired.pending() + retired_uploads.iter().map(Uploads::pending).sum::<usize>();
        let [mut frames, mut converted] = *spent;
        match prepared.as_mut().map(|prepared| &mut prepared.made_by) {
            Some(MadeBy::Shaders(drawer)) => {
                in_flight = drawer.under_way();
                pending += drawer.pending();
                (frames, converted) = (frames.and(drawer.spent()), converted.and(drawer.spent_on_anchors()));
            }
            Some(MadeBy::Processor(made_by)) => uploads.push(&made_by.upload),
            None => {}
        }
        for Upload { uploads, lists } in uploads {
            in_flight += lists.under_way();
            // Copies in our own lists count as in flight.
            pending += uploads.pending().saturating_sub(lists.under_way());
        }
        RendererStatistics { in_flight, lists_pending: pending, frames, anchors: converted, ..Default::default() }
    }
}

/// Converts the result of a prepared frame; `None` if it was not prepared.
fn rendered<T>(result: FrameResult<T>, made: impl FnOnce(T) -> Rendered) -> Option<Rendered> {
    match result {
        FrameResult::Made(frame) => Some(made(frame)),
        FrameResult::NoAnchor => Some(Rendered::NotReady),
        FrameResult::QueueFull => Some(Rendered::QueueFull),
        FrameResult::NotPrepared => None,
    }
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Renderer").field("options", &self.options).finish_non_exhaustive()
    }
}
