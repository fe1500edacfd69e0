//! What stands behind the doors of Direct3D 12 where it is there.

use std::ffi::c_void;
use std::path::Path;
use std::time::Duration;

use windows::Win32::Graphics::Direct3D12 as direct3d;
use windows::core::{IUnknown, Interface};

use super::super::device::CAIRN_DEVICE_D3D12;
use super::super::presenter::{Asked, CAIRN_PREFER_NEVER, CAIRN_PREFER_REQUIRE};
use super::super::requirements::*;
use super::super::results::{Failure, Outcome};
use super::super::text::fixed_text;
use super::{
    CAIRN_D3D12_DETERMINISTIC, DeviceFigures, DeviceTimes, Guard, Guarded, ID3D12CommandQueue, ID3D12Device,
    ID3D12Resource, RolloutFigures, To, cairn_d3d12_options,
};
use crate::ffx::{self, Needed};
use crate::framegen::shader::ShaderGenerator;
use crate::gpu::compute::{Frames, Spent};
use crate::gpu::{Gpu, Moment, Target, Uploads, adapters, read_texture};
use crate::present::device::{DeviceDrawer, ScaledBy};
use crate::present::presenter::{Presenter, Shown};
use crate::runtime::{Device, DirectMlOptions, Ort};
use crate::world::{KeptAnchor, Rollout};
use crate::{Error, ErrorKind, Picture};

/// A device of an engine's objects.
///
/// # Safety
/// What is not null is an object of COM and lives during the call.
pub(in crate::abi) unsafe fn of_engine(
    d3d12: *mut ID3D12Device,
    queue: *mut ID3D12CommandQueue,
    anchors: *mut ID3D12CommandQueue,
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
    running(&Gpu::of_engine(&device, &queue, anchors.as_ref())?)
}

/// A device of our own.
pub(in crate::abi) fn on_adapter(luid: u64) -> Outcome<Device> {
    running(&Gpu::on_adapter(Some(luid))?)
}

fn running(gpu: &Gpu) -> Outcome<Device> {
    Ok(Device::directml(&Ort::find(None)?, gpu, DirectMlOptions::default())?)
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
        inside: took.elsewhere.inside,
        waited: took.elsewhere.waited,
        yields: took.elsewhere.yields,
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
    let (texture, moment) = anchor.texture(index as usize).ok_or_else(Failure::no_d3d12)?;
    Ok((texture.clone().into_raw().cast(), moment.fence().clone().into_raw().cast(), moment.value()))
}

/// Whether frames can be made by shaders.
pub(in crate::abi) const HAS_SHADERS: bool = true;

/// Why AMD's generator has not made a frame, where it is used.
const ONLY_HALF: &str = "fsr: it makes frames half way between two anchors, and no others";

/// Why AMD's upscaler is not used, where it could be.
const ONLY_LARGER: &str = "fsr: it makes anchors larger, and not those that bring all frames with them";

/// What frames are recorded with, once one is.
#[derive(Default)]
pub(in crate::abi) struct Recording {
    uploads: Option<Uploads>,
    /// Lists of our own for what is uploaded.
    lists: Option<Frames>,
    drawer: Option<DeviceDrawer>,
    /// AMD's libraries, once they were looked for, and why the drawer has no provider of theirs.
    amd: Option<crate::Result<ffx::Library>>,
    without_fsr: String,
    without_upscaler: String,
    /// Why frames of anchors of a size are not made by shaders, for lists of a queue.
    failed: Option<(Gpu, (u32, u32), Error)>,
    /// Why the last frame was made by the processor; empty where the drawer made it.
    used: Option<String>,
}

impl Recording {
    /// Records the frame that is due at `now`: by shaders where they are preferred and can, else by the processor. Without a list of
    /// an engine's the queue is given one of ours; then also what guards the target.
    ///
    /// # Safety
    /// What `to` points to are objects of COM and live during the call.
    pub(in crate::abi) unsafe fn record(
        &mut self,
        asked: &Asked<'_>,
        device: &Device,
        now: u64,
        to: &To,
    ) -> Outcome<Option<(Shown, Option<Guard>)>> {
        let presenter = asked.presenter;
        let Some((size, anchors)) = presenter.size().zip(presenter.anchor_size()) else { return Ok(None) };
        let gpu = device.gpu().ok_or_else(Failure::no_d3d12)?;
        let list: Option<direct3d::ID3D12GraphicsCommandList> = match to.list.is_null() {
            true => None,
            // SAFETY: the caller's promise.
            false => Some(unsafe { object(to.list.cast(), "list") }?),
        };
        // SAFETY: the caller's promise.
        let texture: direct3d::ID3D12Resource = unsafe { object(to.target.cast(), "target") }?;
        let [before, after] = [to.before, to.after].map(|state| direct3d::D3D12_RESOURCE_STATES(state.cast_signed()));
        let target = Target { texture, before, after };
        let is_required = [asked.fsr, asked.shader, asked.upscaler].contains(&CAIRN_PREFER_REQUIRE);
        let why = if asked.shader == CAIRN_PREFER_NEVER {
            "shader: it is not to be used, and fsr cannot be without it".to_owned()
        } else {
            match self.drawer(gpu, asked, size, anchors) {
                Ok(drawer) => {
                    let made = match &list {
                        Some(list) => presenter.record(now, drawer, list, &target)?.map(|shown| (shown, None)),
                        None => presenter.submit(now, drawer, &target)?.map(|(shown, at)| (shown, Some(guard(&at)))),
                    };
                    self.used = Some(String::new());
                    return Ok(made);
                }
                Err(why) if is_required || why.kind() == ErrorKind::DeviceRemoved => return Err(why.into()),
                Err(why) => format!("shader: {why}"),
            }
        };
        let made = self.upload(asked, gpu, now, list, target, size)?;
        self.used = Some(why);
        Ok(made)
    }

    /// The frame that is due at `now`, made by the processor.
    fn upload(
        &mut self,
        asked: &Asked<'_>,
        gpu: &Gpu,
        now: u64,
        list: Option<direct3d::ID3D12GraphicsCommandList>,
        target: Target,
        size: (u32, u32),
    ) -> Outcome<Option<(Shown, Option<Guard>)>> {
        // Lists of another queue than before need rings of their own.
        let same = |uploads: &Uploads| uploads.gpu().frames().d3d12() == gpu.frames().d3d12();
        if !self.uploads.as_ref().is_some_and(same) {
            (self.uploads, self.lists) = (None, None);
        }
        let uploads = self.uploads.get_or_insert_with(|| Uploads::new(gpu));
        let own = match list {
            Some(_) => None,
            None => {
                let lists = match &mut self.lists {
                    Some(lists) => lists,
                    none => none.insert(Frames::new(gpu, gpu.frames(), 1)?),
                };
                Some(lists.begin()?)
            }
        };
        let Some(list) = list.or_else(|| own.as_ref().map(|frame| frame.list().clone())) else { return Ok(None) };
        let (mut place, mut recorded) = (Some(uploads.place(list, target, size, asked.colours)?), Ok(()));
        let shown = asked.presenter.draw(now, size, |picture| {
            recorded = place.take().map_or(Ok(()), |place| place.fill(picture));
        })?;
        recorded?;
        let Some(shown) = shown else { return Ok(None) };
        let at = own.map(|frame| frame.submit(gpu.frames())).transpose()?;
        Ok(Some((shown, at.as_ref().map(guard))))
    }

    /// What makes frames by shaders; why that cannot be.
    fn drawer(
        &mut self,
        gpu: &Gpu,
        asked: &Asked<'_>,
        size: (u32, u32),
        anchors: (u32, u32),
    ) -> crate::Result<&mut DeviceDrawer> {
        if let Some((of, at, why)) = &self.failed
            && of.frames().d3d12() == gpu.frames().d3d12()
            && *at == anchors
        {
            return Err(why.clone());
        }
        if !self.drawer.as_ref().is_some_and(|drawer| drawer.fits(gpu, anchors)) {
            // First, as there may not be room for both.
            self.drawer = None;
            let made = DeviceDrawer::new(gpu, anchors, asked.colours);
            let made = made.and_then(|drawer| self.with_fsr(drawer, asked.fsr));
            match made.and_then(|drawer| self.with_upscaler(drawer, asked.upscaler)) {
                Ok(made) => self.drawer = Some(made),
                Err(why) => {
                    // Memory may be there the next time.
                    if matches!(why.kind(), ErrorKind::Unsupported | ErrorKind::Device) {
                        self.failed = Some((gpu.clone(), anchors, why.clone()));
                    }
                    return Err(why);
                }
            }
        }
        let drawer = self.drawer.as_mut().ok_or_else(|| Error::new(ErrorKind::InvalidState, "nothing was made"))?;
        drawer.fit(asked.presenter, size)?;
        Ok(drawer)
    }

    /// The drawer with a provider of AMD's, where that is wanted and can be.
    fn with_fsr(&mut self, mut drawer: DeviceDrawer, preference: u32) -> crate::Result<DeviceDrawer> {
        self.without_fsr = "fsr: it is not to be used".to_owned();
        if preference == CAIRN_PREFER_NEVER {
            return Ok(drawer);
        }
        let is_required = preference == CAIRN_PREFER_REQUIRE;
        let api = self.amd(ffx::Effect::FrameGeneration);
        match api.and_then(|api| drawer.use_fsr(&api, ffx::Choice::Any, is_required)) {
            Ok(()) => self.without_fsr.clear(),
            Err(why) if is_required || why.kind() == ErrorKind::DeviceRemoved => return Err(why),
            Err(why) => self.without_fsr = format!("fsr: {why}"),
        }
        Ok(drawer)
    }

    /// The same with AMD's upscaler, which is tried where frames are larger than anchors.
    fn with_upscaler(&mut self, mut drawer: DeviceDrawer, preference: u32) -> crate::Result<DeviceDrawer> {
        self.without_upscaler = "fsr: it is not to be used".to_owned();
        if preference == CAIRN_PREFER_NEVER {
            return Ok(drawer);
        }
        let is_required = preference == CAIRN_PREFER_REQUIRE;
        match self.amd(ffx::Effect::Upscaling) {
            Ok(api) => {
                drawer.use_fsr_upscaler(&api, ffx::Choice::Any, is_required);
                self.without_upscaler.clear();
            }
            Err(why) if is_required => return Err(why),
            Err(why) => self.without_upscaler = format!("fsr: {why}"),
        }
        Ok(drawer)
    }

    /// AMD's functions for an effect.
    fn amd(&mut self, effect: ffx::Effect) -> crate::Result<ffx::Api> {
        let amd = self.amd.get_or_insert_with(|| ffx::Library::load(&ffx::LoadOptions::of_host()));
        amd.as_ref().map_err(Error::clone).and_then(|library| library.api(effect)).copied()
    }

    /// What brings frames to their size, and why AMD's upscaler does not; none where the processor makes them.
    pub(in crate::abi) fn scaled_by(&mut self) -> Option<(String, String)> {
        let drawer = self.drawer.as_ref().filter(|_| self.used.as_ref().is_some_and(String::is_empty))?;
        Some(match (drawer.scaled_by(), drawer.upscaler_failed()) {
            (ScaledBy::Nothing, _) => (String::new(), String::new()),
            (ScaledBy::Amd(version), _) => (format!("fsr {}", version.name), String::new()),
            (ScaledBy::Space, Some(failed)) => ("spatial".to_owned(), format!("fsr: {failed}")),
            (ScaledBy::Space, None) if self.without_upscaler.is_empty() => {
                ("spatial".to_owned(), ONLY_LARGER.to_owned())
            }
            (ScaledBy::Space, None) => ("spatial".to_owned(), self.without_upscaler.clone()),
        })
    }

    /// Waits until all frames have run, and lets go of their targets.
    pub(in crate::abi) fn release(&mut self) -> Outcome<()> {
        Ok(self.drawer.as_mut().map_or(Ok(()), DeviceDrawer::finish)?)
    }

    /// What frames have taken on the device.
    pub(in crate::abi) fn figures(&mut self) -> DeviceFigures {
        let uploaded = self.lists.as_ref().map_or(0, Frames::under_way);
        let Some(drawer) = &mut self.drawer else {
            return DeviceFigures { under_way: uploaded as u32, ..DeviceFigures::default() };
        };
        DeviceFigures {
            under_way: (drawer.under_way() + uploaded) as u32,
            frames: times(drawer.spent()),
            lists: times(drawer.spent_on_anchors()),
        }
    }

    /// Who made the last frame, none for the processor, and why no other generator made it; none before the first.
    pub(in crate::abi) fn used(&mut self, presenter: &Presenter) -> Option<(Option<String>, String)> {
        if let Some(drawer) = &mut self.drawer {
            presenter.look(drawer);
        }
        let why = self.used.as_ref()?;
        let Some(drawer) = self.drawer.as_ref().filter(|_| why.is_empty()) else { return Some((None, why.clone())) };
        Some(match (drawer.made_by_fsr(), drawer.fsr_failed()) {
            (Some(version), _) => (Some(format!("fsr {}", version.name)), String::new()),
            (None, Some(failed)) => (Some("shader".to_owned()), format!("fsr: {failed}")),
            (None, None) if self.without_fsr.is_empty() => (Some("shader".to_owned()), ONLY_HALF.to_owned()),
            (None, None) => (Some("shader".to_owned()), self.without_fsr.clone()),
        })
    }
}

fn times(spent: Spent) -> DeviceTimes {
    let Spent { frames: count, total, longest, last } = spent;
    DeviceTimes { count, total, longest, last }
}

/// A moment as an engine waits for it, with a reference.
fn guard(moment: &Moment) -> Guard {
    Guard { fence: moment.fence().clone().into_raw().cast(), value: moment.value() }
}

/// The adapters, in the system's order.
pub(in crate::abi) fn list() -> Vec<cairn_adapter> {
    let found = adapters().unwrap_or_else(|e| {
        log::warn!("the adapters of Direct3D 12 cannot be listed: {e}");
        Vec::new()
    });
    let row = |(index, adapter): (u32, crate::gpu::Adapter)| cairn_adapter {
        struct_size: 0,
        kind: CAIRN_DEVICE_D3D12,
        index,
        reserved: 0,
        luid: adapter.luid,
        memory: adapter.memory,
        name: fixed_text(&adapter.description),
    };
    (0..).zip(found).map(row).collect()
}

/// What a device on the first adapter needs, and what of AMD's could run on it.
pub(in crate::abi) fn requirements(onnxruntime_at: Option<&Path>) -> Vec<cairn_requirement> {
    let needed = "a Direct3D 12 adapter";
    let gpu = match Gpu::on_adapter(None) {
        Ok(gpu) => gpu,
        Err(error) => {
            let found = format!("{}: {error}", platform());
            return vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_NOT_MET, needed, &found)];
        }
    };
    let found = format!("{}, adapter {:#x}", platform(), gpu.luid());
    let tried =
        Ort::find(onnxruntime_at).and_then(|ort| Device::directml(&ort, &gpu, DirectMlOptions::default()).map(|_| ort));
    let mut rows =
        vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_MET, needed, &found), onnxruntime(tried), memory()];
    // Of a small size: what may be refused does not depend on it.
    let (status, found) = match ShaderGenerator::new(&gpu, (64, 64)) {
        Ok(_) => (CAIRN_REQUIREMENT_MET, "they run".to_owned()),
        Err(why) => (CAIRN_REQUIREMENT_OPTIONAL, why.to_string()),
    };
    let needed = "compute shaders, for frames that the device makes; else the processor makes them";
    rows.push(row(CAIRN_REQUIREMENT_SHADERS, status, needed, &found));
    rows.extend(ffx::requirements(&ffx::LoadOptions::of_host(), &gpu).iter().map(|of_amd| {
        let what = match of_amd.what {
            Needed::Libraries => CAIRN_REQUIREMENT_FSR_LIBRARIES,
            Needed::Provider => CAIRN_REQUIREMENT_FSR_PROVIDER,
            Needed::System => CAIRN_REQUIREMENT_FSR_SYSTEM,
            Needed::Direct3d => CAIRN_REQUIREMENT_FSR_DIRECT3D,
            Needed::ShaderModel => CAIRN_REQUIREMENT_FSR_SHADER_MODEL,
        };
        let status = if of_amd.met { CAIRN_REQUIREMENT_MET } else { CAIRN_REQUIREMENT_OPTIONAL };
        row(what, status, of_amd.needed, &of_amd.found)
    }));
    rows
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
