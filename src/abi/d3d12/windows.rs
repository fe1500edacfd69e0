//! What stands behind the doors of Direct3D 12 where it is there.

mod adapters;

use std::ffi::c_void;
use std::time::Duration;

use parking_lot::Mutex;
use windows::Win32::Graphics::Direct3D12 as direct3d;
use windows::Win32::Graphics::Dxgi::Common as Dxgi;
use windows::core::{IUnknown, Interface};

use super::super::device::{CAIRN_DEVICE_D3D12, DeviceOptions};
use super::super::presenter::{CAIRN_PREFER_NEVER, CAIRN_PREFER_REQUIRE, RenderRequest};
use super::super::requirements::*;
use super::super::results::{Failure, Outcome};
use super::super::text::fixed_text;
use super::{
    CAIRN_D3D12_DETERMINISTIC, CAIRN_PREPARE_SUBMIT_ONLY, DeviceFigures, DeviceTimes, Guard, Guarded,
    ID3D12CommandQueue, ID3D12Device, ID3D12Resource, Recorded, RolloutFigures, To, cairn_d3d12_options,
    cairn_d3d12_preparation,
};
use crate::ffx::{self, Needed};
use crate::framegen::shader::ShaderGenerator;
use crate::gpu::compute::pictures::Format;
use crate::gpu::compute::{CommandRing, Spent};
use crate::gpu::{FencePoint, Gpu, Target, Uploads, read_texture};
use crate::object_count::counted;
use crate::present::device::{DeviceDrawer, FrameResult, LISTS, Preparation, RetiredFrames, ScaledBy, check_recording};
use crate::present::presenter::{Draws, Presenter};
use crate::runtime::{Device, DirectMlOptions, Ort};
use crate::world::{KeptAnchor, Rollout};
use crate::{ErrorKind, LibrarySearch, Picture};
use adapters::load_pipelines;
pub(in crate::abi) use adapters::{list, requirements};

/// A device of an engine's objects.
///
/// # Safety
/// What is not null is an object of COM and lives during the call.
pub(in crate::abi) unsafe fn of_engine(
    d3d12: *mut ID3D12Device,
    queue: *mut ID3D12CommandQueue,
    anchors: *mut ID3D12CommandQueue,
    options: DeviceOptions,
) -> Outcome<Device> {
    // SAFETY: the caller's promise.
    let device: direct3d::ID3D12Device = unsafe { object(d3d12.cast(), "d3d12") }?;
    // SAFETY: the caller's promise.
    let queue: direct3d::ID3D12CommandQueue = unsafe { object(queue.cast(), "queue") }?;
    let anchors: Option<direct3d::ID3D12CommandQueue> = match anchors.is_null() {
        true => None,
        // SAFETY: the caller's promise.
        false => Some(unsafe { object(anchors.cast(), "anchors") }?),
    };
    Ok(running(&Gpu::of_engine(&device, &queue, anchors.as_ref())?, options)?.0)
}

/// A device of our own.
pub(in crate::abi) fn on_adapter(luid: u64, options: DeviceOptions) -> Outcome<Device> {
    Ok(running(&Gpu::on_adapter(Some(luid))?, options)?.0)
}

/// What runs worlds on a Direct3D device, and the ONNX Runtime it uses.
fn running(gpu: &Gpu, options: DeviceOptions) -> crate::Result<(Device, Ort)> {
    let ort = Ort::find(&options.libraries)?;
    let directml = DirectMlOptions { deterministic: options.cpu.deterministic, ..DirectMlOptions::default() };
    let device = Device::directml(&ort, gpu, directml)?;
    Ok((device.with_library_search(options.libraries), ort))
}

/// What a device runs on, each with a reference more; none for a CPU device.
pub(in crate::abi) fn parts(device: &Device) -> Option<(*mut ID3D12Device, *mut ID3D12CommandQueue)> {
    let gpu = device.gpu()?;
    Some((gpu.device().clone().into_raw().cast(), gpu.frames().d3d12().clone().into_raw().cast()))
}

/// Has worlds run otherwise from now on.
pub(in crate::abi) fn set_options(device: &Device, options: &cairn_d3d12_options) -> Outcome<()> {
    let longest = Some(options.longest_submission_us).filter(|microseconds| *microseconds > 0);
    let options = DirectMlOptions {
        deterministic: options.flags & CAIRN_D3D12_DETERMINISTIC != 0,
        captured_passes: options.captured_passes as usize,
        longest_submission: longest.map(|microseconds| Duration::from_micros(microseconds.into())),
        ..DirectMlOptions::default()
    };
    Ok(device.set_directml_options(options)?)
}

/// What a rollout has taken on the device; nothing on one that is no Direct3D 12 one.
pub(in crate::abi) fn rollout_figures(rollout: &mut Rollout) -> RolloutFigures {
    let Some((took, captured)) = rollout.device_times().zip(rollout.captured()) else {
        return RolloutFigures::default();
    };
    RolloutFigures {
        passes: times(took.passes),
        decodes: times(took.decode),
        commits: times(took.commit),
        inside: took.external.inside,
        waited: took.external.waited,
        yields: took.external.yields,
        captured: captured.used,
        others: captured.unproven + captured.unused,
    }
}

/// What a texture holds that is in `state`.
///
/// # Safety
/// What is not null is an object of COM and lives during the call.
pub(in crate::abi) unsafe fn read(device: &Device, texture: *mut ID3D12Resource, state: u32) -> Outcome<Picture> {
    let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
    // SAFETY: the caller's promise.
    let texture: direct3d::ID3D12Resource = unsafe { object(texture.cast(), "picture") }?;
    let state = direct3d::D3D12_RESOURCE_STATES(state.cast_signed());
    Ok(read_texture(gpu, &texture, state)?)
}

/// A picture of an anchor where it was made.
pub(in crate::abi) fn texture(anchor: &KeptAnchor, index: u32) -> Outcome<Guarded> {
    let (texture, fence_point) = anchor.texture(index as usize).ok_or_else(Failure::no_d3d12)?;
    Ok((texture.clone().into_raw().cast(), fence_point.fence().clone().into_raw().cast(), fence_point.value()))
}

/// Whether frames can be made by shaders.
pub(in crate::abi) const HAS_SHADERS: bool = true;

/// Why AMD's generator has not made a frame, where it is used.
const ONLY_HALF: &str = "fsr: it makes frames half way between two anchors, and no others";

/// Why AMD's upscaler is not used, where it could be.
const ONLY_LARGER: &str = "fsr: it makes anchors larger, and not those that bring all frames with them";

/// What frames are recorded with.
#[derive(Default)]
pub(in crate::abi) struct Recording {
    prepared: Option<Prepared>,
    /// Copies anchors that are shown in place of frames that are not prepared.
    anchors: Option<Upload>,
    /// What lists of the engine's may still read of what was prepared before.
    retired: RetiredFrames,
    retired_uploads: Vec<Uploads>,
    /// Time on the device of what was prepared before.
    spent: [Spent; 2],
    /// Why the last frame was made by the processor; empty where shaders made it.
    used: Option<String>,
}

/// AMD's libraries, once they were found.
#[derive(Default)]
pub(in crate::abi) struct Amd {
    /// Where they are searched: as the device says that is prepared for.
    search: LibrarySearch,
    library: Option<ffx::Library>,
}

/// All that frames of one size need.
pub(in crate::abi) struct Prepared {
    gpu: Gpu,
    made_by: MadeBy,
    without: Without,
}

/// Why nothing of AMD's is used; empty where it is.
#[derive(Default)]
struct Without {
    fsr: String,
    upscaler: String,
}

/// Who makes frames.
enum MadeBy {
    Shaders(Box<DeviceDrawer>),
    Processor(Box<OnProcessor>),
}

/// Frames that the processor makes.
struct OnProcessor {
    upload: Upload,
    size: (u32, u32),
    pixel_bytes: u32,
    /// Why no shaders do.
    why: String,
}

/// What copies pictures of the processor's.
struct Upload {
    uploads: Uploads,
    /// Lists of our own, for frames that are submitted.
    lists: CommandRing,
}

impl Upload {
    fn new(gpu: &Gpu) -> Outcome<Self> {
        Ok(Self { uploads: Uploads::new(gpu, LISTS)?, lists: CommandRing::new(gpu, gpu.frames(), 1)? })
    }

    /// The frame that is due at `now`, or the nearest anchor, made by the processor.
    fn record(
        &mut self,
        request: &RenderRequest<'_>,
        draws: Draws,
        now: u64,
        list: Option<&(direct3d::ID3D12GraphicsCommandList, FencePoint)>,
        target: Target,
    ) -> Outcome<Recorded> {
        let Self { uploads, lists } = self;
        let Some(size) = request.presenter.size() else { return Ok(Recorded::NotReady) };
        let own = match list {
            Some((list, until)) => {
                check_recording(uploads.gpu(), list, until)?;
                None
            }
            None => Some(lists.begin()?),
        };
        let recorded_in = list.map(|(list, _)| list).or_else(|| own.as_ref().map(|frame| frame.list()));
        let Some(recorded_in) = recorded_in.cloned() else { return Ok(Recorded::NotReady) };
        let Some(place) = uploads.place(recorded_in, target, size, request.colours)? else {
            return Ok(Recorded::QueueFull);
        };
        let (mut place, mut recorded) = (Some(place), Ok(()));
        let shown = request.presenter.draw_of(draws, now, size, |picture, is_repeated| {
            recorded = place.take().map_or(Ok(()), |place| place.fill(picture, is_repeated));
        })?;
        drop(place);
        recorded?;
        let Some(shown) = shown else { return Ok(Recorded::NotReady) };
        let at = own.map(|frame| frame.submit(uploads.gpu().frames())).transpose()?;
        list.map(|(_, until)| until).or(at.as_ref()).into_iter().for_each(|until| uploads.read_until(until));
        Ok(Recorded::Frame(shown, at.as_ref().map(guard)))
    }
}

impl Prepared {
    /// Makes it. None where no anchor has come and nobody says how large anchors are.
    pub(in crate::abi) fn new(
        request: &RenderRequest<'_>,
        device: &Device,
        wanted: &cairn_d3d12_preparation,
        amd: &mut Amd,
    ) -> Outcome<Option<Self>> {
        let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
        let presenter = request.presenter;
        let given = |size: (u32, u32)| (size != (0, 0)).then_some(size);
        let Some(anchors) = given((wanted.anchor_width, wanted.anchor_height)).or_else(|| presenter.anchor_size())
        else {
            return Ok(None);
        };
        let size = given((wanted.width, wanted.height)).or_else(|| presenter.wanted_size()).unwrap_or(anchors);
        let pixel_bytes = match Dxgi::DXGI_FORMAT(wanted.format.cast_signed()) {
            Dxgi::DXGI_FORMAT_UNKNOWN => 8,
            format => Format::of(format).map(|format| format.bytes).ok_or_else(|| {
                let why = format!("frames are not written in DXGI_FORMAT {}", format.0);
                Failure::argument("preparation.format", why).remedy("Use RGBA8, BGRA8, RGB10A2 or RGBA16F")
            })?,
        };
        let lists = match wanted.lists {
            _ if wanted.flags & CAIRN_PREPARE_SUBMIT_ONLY != 0 => 0,
            0 => LISTS,
            lists => lists as usize,
        };
        let preparation = Preparation {
            size,
            pixel_bytes,
            lists,
            pictures: wanted.anchor_pictures.max(1) as usize,
            latent: [wanted.latent_channels, wanted.latent_height, wanted.latent_width],
        };
        if let Some(load) = wanted.load
            && gpu.pipelines().asks()
        {
            load_pipelines(gpu, load, wanted.user);
        }
        amd.set_search(device.library_search());
        let mut without = Without::default();
        let is_required = [request.fsr, request.shader, request.upscaler].contains(&CAIRN_PREFER_REQUIRE);
        let drawer = match request.shader {
            CAIRN_PREFER_NEVER => Err("shader: it is not to be used, and fsr cannot be without it".to_owned()),
            _ => match without.drawer(gpu, anchors, request, &preparation, amd) {
                Ok(drawer) => Ok(drawer),
                Err(why) if is_required || [ErrorKind::DeviceRemoved, ErrorKind::OutOfMemory].contains(&why.kind()) => {
                    return Err(why.into());
                }
                Err(why) => Err(format!("shader: {why}")),
            },
        };
        let made_by = match drawer {
            Ok(drawer) => MadeBy::Shaders(Box::new(drawer)),
            Err(why) => {
                let mut upload = Upload::new(gpu)?;
                // Frames that are submitted need memory as well.
                upload.uploads.prepare(lists.max(LISTS), size, pixel_bytes)?;
                MadeBy::Processor(Box::new(OnProcessor { upload, size, pixel_bytes, why }))
            }
        };
        if let Some(store) = wanted.store
            && let Some(bytes) = gpu.pipelines().serialised(gpu)
        {
            // SAFETY: a function of the host's; the bytes live during the call.
            unsafe { store(bytes.as_ptr().cast(), bytes.len() as u64, wanted.user) };
        }
        Ok(Some(Self { gpu: gpu.clone(), made_by, without }))
    }
}

impl Without {
    /// What makes frames by shaders; why that cannot be.
    fn drawer(
        &mut self,
        gpu: &Gpu,
        anchors: (u32, u32),
        request: &RenderRequest<'_>,
        wanted: &Preparation,
        amd: &mut Amd,
    ) -> crate::Result<DeviceDrawer> {
        let drawer = DeviceDrawer::new(gpu, anchors, request.colours)?;
        let drawer = self.with_fsr(drawer, request.fsr, amd)?;
        let mut drawer = self.with_upscaler(drawer, request.upscaler, amd)?;
        drawer.prepare(request.presenter, wanted)?;
        Ok(drawer)
    }

    /// The drawer with a provider of AMD's, where that is wanted and can be.
    fn with_fsr(&mut self, mut drawer: DeviceDrawer, preference: u32, amd: &mut Amd) -> crate::Result<DeviceDrawer> {
        self.fsr = "fsr: it is not to be used".to_owned();
        if preference == CAIRN_PREFER_NEVER {
            return Ok(drawer);
        }
        let is_required = preference == CAIRN_PREFER_REQUIRE;
        let api = amd.api(ffx::Effect::FrameGeneration);
        match api.and_then(|api| drawer.use_fsr(&api, ffx::Choice::Any, is_required)) {
            Ok(()) => self.fsr.clear(),
            Err(why) if is_required || why.kind() == ErrorKind::DeviceRemoved => return Err(why),
            Err(why) => self.fsr = format!("fsr: {why}"),
        }
        Ok(drawer)
    }

    /// The same with AMD's upscaler, which is tried where frames are larger than anchors.
    fn with_upscaler(
        &mut self,
        mut drawer: DeviceDrawer,
        preference: u32,
        amd: &mut Amd,
    ) -> crate::Result<DeviceDrawer> {
        self.upscaler = "fsr: it is not to be used".to_owned();
        if preference == CAIRN_PREFER_NEVER {
            return Ok(drawer);
        }
        let is_required = preference == CAIRN_PREFER_REQUIRE;
        match amd.api(ffx::Effect::Upscaling) {
            Ok(api) => {
                drawer.use_fsr_upscaler(&api, ffx::Choice::Any, is_required);
                self.upscaler.clear();
            }
            Err(why) if is_required => return Err(why),
            Err(why) => self.upscaler = format!("fsr: {why}"),
        }
        Ok(drawer)
    }
}

impl Amd {
    /// Searches where `search` says from now on; libraries found by another search are released.
    fn set_search(&mut self, search: &LibrarySearch) {
        if self.search != *search {
            *self = Self { search: search.clone(), library: None };
        }
    }

    /// AMD's functions for an effect.
    fn api(&mut self, effect: ffx::Effect) -> crate::Result<ffx::Api> {
        let library = match &mut self.library {
            Some(library) => library,
            none => none.insert(ffx::Library::load(&ffx::LoadOptions::of_host(&self.search))?),
        };
        library.api(effect).copied()
    }
}

impl Recording {
    /// Records the frame that is due at `now` as it was prepared, or else the nearest anchor. Without a list of an engine's the queue is
    /// given one of ours; then also what guards the target.
    ///
    /// # Safety
    /// What `to` points to are objects of COM and live during the call.
    pub(in crate::abi) unsafe fn record(
        &mut self,
        request: &RenderRequest<'_>,
        device: &Device,
        now: u64,
        to: &To,
    ) -> Outcome<Recorded> {
        let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
        let list = match &to.list {
            None => None,
            Some((list, Guard { fence, value })) => {
                // SAFETY: the caller's promise.
                let list: direct3d::ID3D12GraphicsCommandList = unsafe { object(list.cast(), "recording.list") }?;
                // SAFETY: the caller's promise.
                let fence: direct3d::ID3D12Fence = unsafe { object(fence.cast(), "recording.fence") }?;
                Some((list, FencePoint::of_engine(gpu, &fence, *value)?))
            }
        };
        // SAFETY: the caller's promise.
        let texture: direct3d::ID3D12Resource = unsafe { object(to.target.cast(), "target") }?;
        let [before, after] = [to.before, to.after].map(|state| direct3d::D3D12_RESOURCE_STATES(state.cast_signed()));
        let target = Target { texture, before, after };
        self.retired.pending();
        self.retired_uploads.retain(|uploads| uploads.pending() > 0);
        let (made, objects) = counted(|| self.record_with(request, gpu, now, list.as_ref(), target));
        request.presenter.count_objects(objects);
        made
    }

    fn record_with(
        &mut self,
        request: &RenderRequest<'_>,
        gpu: &Gpu,
        now: u64,
        list: Option<&(direct3d::ID3D12GraphicsCommandList, FencePoint)>,
        target: Target,
    ) -> Outcome<Recorded> {
        let presenter = request.presenter;
        let is_prepared = |prepared: &&mut Prepared| prepared.gpu.frames().d3d12() == gpu.frames().d3d12();
        match self.prepared.as_mut().filter(is_prepared).map(|prepared| &mut prepared.made_by) {
            Some(MadeBy::Shaders(drawer)) => {
                let made = match list {
                    Some((list, until)) => recorded(presenter.record(now, drawer, list, &target, until)?, |shown| {
                        Recorded::Frame(shown, None)
                    }),
                    None => recorded(presenter.submit(now, drawer, &target)?, |(shown, at)| {
                        Recorded::Frame(shown, Some(guard(&at)))
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
                    let made = upload.record(request, Draws::Frames, now, list, target)?;
                    self.used = Some(why.clone());
                    return Ok(made);
                }
            }
            None => {}
        }
        // Lists of another queue than before need memory of their own.
        if let Some(other) =
            self.anchors.take_if(|upload| upload.uploads.gpu().frames().d3d12() != gpu.frames().d3d12())
        {
            self.retired_uploads.push(other.uploads);
        }
        let upload = match &mut self.anchors {
            Some(upload) => upload,
            none => none.insert(Upload::new(gpu)?),
        };
        let made = upload.record(request, Draws::Anchors, now, list, target)?;
        self.used = Some(NOT_PREPARED.to_owned());
        Ok(made)
    }

    /// What brings frames to their size, and why AMD's upscaler does not; none where the processor makes them.
    pub(in crate::abi) fn scaled_by(&mut self) -> Option<(String, String)> {
        let prepared = self.prepared.as_ref().filter(|_| self.used.as_ref().is_some_and(String::is_empty))?;
        let MadeBy::Shaders(drawer) = &prepared.made_by else { return None };
        Some(match (drawer.scaled_by(), drawer.upscaler_failed()) {
            (ScaledBy::Nothing, _) => (String::new(), String::new()),
            (ScaledBy::Amd(version), _) => (format!("fsr {}", version.name), String::new()),
            (ScaledBy::Space, Some(failed)) => ("spatial".to_owned(), format!("fsr: {failed}")),
            (ScaledBy::Space, None) if prepared.without.upscaler.is_empty() => {
                ("spatial".to_owned(), ONLY_LARGER.to_owned())
            }
            (ScaledBy::Space, None) => ("spatial".to_owned(), prepared.without.upscaler.clone()),
        })
    }

    /// Waits until all frames have run, and releases their targets and what lists that were dropped would have read.
    pub(in crate::abi) fn release(&mut self) -> Outcome<()> {
        let Self { prepared, anchors, retired_uploads, retired, .. } = self;
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

    /// What frames have taken on the device.
    pub(in crate::abi) fn figures(&mut self) -> DeviceFigures {
        let Self { prepared, anchors, retired, retired_uploads, spent, .. } = self;
        let mut figures = DeviceFigures::default();
        let mut uploads: Vec<&Upload> = anchors.iter().collect();
        let mut pending = retired.pending() + retired_uploads.iter().map(Uploads::pending).sum::<usize>();
        let mut took = *spent;
        match prepared.as_mut().map(|prepared| &mut prepared.made_by) {
            Some(MadeBy::Shaders(drawer)) => {
                figures.under_way = drawer.under_way() as u32;
                pending += drawer.pending();
                took = [took[0].and(drawer.spent()), took[1].and(drawer.spent_on_anchors())];
            }
            Some(MadeBy::Processor(made_by)) => uploads.push(&made_by.upload),
            None => {}
        }
        for Upload { uploads, lists } in uploads {
            figures.under_way += lists.under_way() as u32;
            // Those in lists of ours are under way.
            pending += uploads.pending().saturating_sub(lists.under_way());
        }
        let [frames, lists] = took.map(times);
        DeviceFigures { lists_pending: pending as u32, frames, lists, ..figures }
    }

    /// Who made the last frame, none for the processor, and why no other generator made it; none before the first.
    pub(in crate::abi) fn used(&mut self, presenter: &Presenter) -> Option<(Option<String>, String)> {
        let prepared = self.prepared.as_mut();
        if let Some(MadeBy::Shaders(drawer)) = prepared.map(|prepared| &mut prepared.made_by) {
            presenter.look(drawer);
        }
        let why = self.used.as_ref()?;
        let Some(prepared) = self.prepared.as_ref().filter(|_| why.is_empty()) else {
            return Some((None, why.clone()));
        };
        let MadeBy::Shaders(drawer) = &prepared.made_by else { return Some((None, why.clone())) };
        Some(match (drawer.made_by_fsr(), drawer.fsr_failed()) {
            (Some(version), _) => (Some(format!("fsr {}", version.name)), String::new()),
            (None, Some(failed)) => (Some("shader".to_owned()), format!("fsr: {failed}")),
            (None, None) if prepared.without.fsr.is_empty() => (Some("shader".to_owned()), ONLY_HALF.to_owned()),
            (None, None) => (Some("shader".to_owned()), prepared.without.fsr.clone()),
        })
    }
}

/// Uses what was prepared from now on, and drops what was before, for which recording does not wait; whether that has freed memory.
pub(in crate::abi) fn put(recording: &Mutex<Recording>, prepared: Option<Prepared>) -> bool {
    let mut lock = recording.lock();
    let Some(before) = std::mem::replace(&mut lock.prepared, prepared) else { return false };
    match before.made_by {
        MadeBy::Shaders(mut drawer) => {
            let [frames, anchors] = [drawer.spent(), drawer.spent_on_anchors()];
            lock.spent = [lock.spent[0].and(frames), lock.spent[1].and(anchors)];
            drop(lock);
            // Waits for its frames, but for those that lists of the engine's may still read.
            let retired = drawer.retire();
            recording.lock().retired.append(retired);
        }
        MadeBy::Processor(made_by) => lock.retired_uploads.push(made_by.upload.uploads),
    }
    true
}

/// What became of a frame, where it was prepared.
fn recorded<T>(result: FrameResult<T>, made: impl FnOnce(T) -> Recorded) -> Option<Recorded> {
    match result {
        FrameResult::Made(frame) => Some(made(frame)),
        FrameResult::NoAnchor => Some(Recorded::NotReady),
        FrameResult::QueueFull => Some(Recorded::QueueFull),
        FrameResult::NotPrepared => None,
    }
}

/// Why an anchor is shown in place of a frame.
const NOT_PREPARED: &str =
    "not prepared: cairn_presenter_prepare_d3d12 was not called for this device, and these sizes and formats";

fn times(spent: Spent) -> DeviceTimes {
    let Spent { frames: count, total, longest, last } = spent;
    DeviceTimes { count, total, longest, last }
}

/// A moment as an engine waits for it, with a reference.
fn guard(fence_point: &FencePoint) -> Guard {
    Guard { fence: fence_point.fence().clone().into_raw().cast(), value: fence_point.value() }
}

/// The interface `I` of a COM object that is not null.
///
/// # Safety
/// The pointer is of an object of COM, which lives during the call.
pub(in crate::abi) unsafe fn object<I: Interface>(pointer: *mut c_void, name: &str) -> Outcome<I> {
    // SAFETY: the caller's promise; every interface of COM starts with IUnknown, and no reference is taken.
    let unknown = unsafe { IUnknown::from_raw_borrowed(&pointer) };
    let cast = unknown.and_then(|unknown| unknown.cast().ok());
    cast.ok_or_else(|| Failure::argument(name, "it is an object of another kind"))
}
