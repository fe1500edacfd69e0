//! Frame generation into the host's textures, without a swap chain: three calls for each frame.

use std::ffi::c_void;

use super::bindings::{
    ConfigureDistortion, ConfigureFrameGeneration, Coordinates, CreateFlags, CreateFrameGeneration,
    CreateFrameGenerationHudless, Dimensions, DispatchCamera, DispatchFrameGeneration, DispatchPrepare,
    DispatchPrepareV2, FrameFlags, MemoryUsage, Rect, Resource, SurfaceFormat, TransferFunction,
};
use super::{Api, Chain, Choice, Context, Dialect, Provider};
use crate::{Error, ErrorKind, Result};

/// A frame's camera. Its vectors are in world space and of length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position in world space.
    pub position: [f32; 3],
    /// Up on the screen.
    pub up: [f32; 3],
    /// To the right on the screen.
    pub right: [f32; 3],
    /// Into the screen.
    pub forward: [f32; 3],
    /// The near plane, above 0.
    pub near: f32,
    /// The far plane, above 0; ignored if depth is infinite. Its ratio to the near plane is limited to a million, beyond which AMD's providers
    /// have no precision left.
    pub far: f32,
    /// Vertical field of view in radians, inside (0, pi).
    pub fov: f32,
    /// Metres per unit of view space, above 0.
    pub metres: f32,
}

impl Default for Camera {
    /// At the origin, looking along z with y up; a field of view of 1 radian, planes at 0.1 and 100 metres.
    fn default() -> Self {
        Self {
            position: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            right: [1.0, 0.0, 0.0],
            forward: [0.0, 0.0, 1.0],
            near: 0.1,
            far: 100.0,
            fov: 1.0,
            metres: 1.0,
        }
    }
}

/// Largest ratio of the planes that is passed to a provider. AMD's compute `far / (near - far)` in single precision, which rounds to -1 from a ratio
/// of 3e7 on. The distance of depth 1 is then minus infinity, so that the far plane counts as nearer than all else
/// (`setupDeviceDepthToViewSpaceDepthParams` of their published source).
const MAX_PLANE_RATIO: f32 = 1e6;

impl Camera {
    /// The far plane for a provider. AMD's take the lesser of both planes for the near one, with infinite depth too.
    pub(super) fn far_plane(&self, depth_is_infinite: bool) -> f32 {
        if depth_is_infinite {
            return f32::MAX;
        }
        self.far.clamp(self.near / MAX_PLANE_RATIO, (self.near * MAX_PLANE_RATIO).min(f32::MAX))
    }

    pub(super) fn fault(&self, depth_is_infinite: bool) -> Option<(&'static str, &'static str)> {
        let is_positive = |value: f32| value.is_finite() && value > 0.0;
        let is_unit = |v: [f32; 3]| (v.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-2;
        let far_counts = !depth_is_infinite;
        [
            (!self.position.iter().all(|x| x.is_finite()), "camera.position", "it must be finite"),
            (!is_unit(self.up), "camera.up", "it must have length 1"),
            (!is_unit(self.right), "camera.right", "it must have length 1"),
            (!is_unit(self.forward), "camera.forward", "it must have length 1"),
            (!is_positive(self.near), "camera.near", "it must be above 0"),
            (far_counts && !is_positive(self.far), "camera.far", "it must be above 0"),
            (far_counts && self.far == self.near, "camera.far", "it must not be the near plane"),
            (!(self.fov > 0.0 && self.fov < std::f32::consts::PI), "camera.fov", "it must be inside (0, pi)"),
            (!is_positive(self.metres), "camera.metres", "it must be above 0"),
        ]
        .into_iter()
        .find(|(is_wrong, ..)| *is_wrong)
        .map(|(_, field, why)| (field, why))
    }
}

/// Parameters of a frame other than its textures.
#[derive(Debug, Clone, Copy)]
pub struct FrameParams {
    /// The render size.
    pub render_size: Dimensions,
    /// Camera jitter in render pixels.
    pub jitter: Coordinates,
    /// Scale from motion-texture units to render pixels (display pixels if the motion texture has display size).
    pub motion_scale: Coordinates,
    /// World time since the previous frame, in milliseconds.
    pub frame_time: f32,
    /// The camera.
    pub camera: Camera,
    /// Drops the history, as after a cut. The generated frame is then a copy of this one.
    pub reset: bool,
    /// The part of the frame that is generated; the rest is copied. A size of 0 means all of it. Depth and motion cover this part and
    /// nothing else: a provider maps the render size onto it.
    pub rect: Rect,
    /// The colours' transfer function: sRGB, or one for high dynamic range if the generator was created for it.
    pub transfer: TransferFunction,
    /// Minimum and maximum luminance in nits, for high dynamic range.
    pub luminance: [f32; 2],
}

impl FrameParams {
    /// Defaults: 1/15 s after the previous frame, no jitter, motion in pixels, the default camera, the whole frame generated, sRGB.
    pub fn of(render_size: Dimensions) -> Self {
        Self {
            render_size,
            jitter: Coordinates::default(),
            motion_scale: Coordinates { x: 1.0, y: 1.0 },
            frame_time: 1000.0 / 15.0,
            camera: Camera::default(),
            reset: false,
            rect: Rect::default(),
            transfer: TransferFunction::SRGB,
            luminance: [0.0, 100.0],
        }
    }
}

/// The inputs of one generated frame and its output. The generated frame lies half way between this frame and the previous one.
///
/// Every resource is in its stated state when the list reaches the call, and again afterwards.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// `ID3D12GraphicsCommandList`, open. The call changes its descriptor heaps, root signatures and pipelines.
    pub command_list: *mut c_void,
    /// The frame at display size, in the format that the generator was created for.
    pub color: Resource,
    /// Receives the generated frame, of the same size and format; written by shaders.
    pub output: Resource,
    /// Device depth at render size.
    pub depth: Resource,
    /// Motion vectors from this frame to the previous one, at render size, or at display size if the generator was created so.
    /// Values that are not finite or larger than the picture can hang the device.
    pub motion: Resource,
    /// The HUD-less frame at display size; a null resource for none. Required if the generator was created for HUD-less frames with a format
    /// of their own.
    pub hudless: Resource,
    /// Lens distortion field at display size: distorted minus undistorted position of each pixel, as a fraction of the picture; a
    /// null resource for none.
    pub distortion: Resource,
    /// The other parameters.
    pub params: FrameParams,
}

/// The first provider that reads [`CreateFrameGenerationHudless`]: the frame interpolation 1.1.2 of SDK 1.1.3.
const HUDLESS_FORMAT_SINCE: [u32; 3] = [1, 1, 2];

/// The structs that carry motion and depth, by SDK release.
enum Prepare {
    /// Up to SDK 2.0: the camera is a link of its own.
    Separate(Chain<DispatchPrepare>),
    /// From SDK 2.1 on: one struct with the camera.
    Combined(Chain<DispatchPrepareV2>),
}

/// A frame generator without a swap chain. Its structs are created once and changed for each frame.
///
/// Threads: may be sent to another thread between calls; one call at a time. Its recorded work must have run before it is dropped,
/// and at most four of its frames may be in flight.
pub struct Generator {
    context: Context<CreateFrameGeneration>,
    settings: Chain<ConfigureFrameGeneration>,
    prepare: Prepare,
    dispatch: Chain<DispatchFrameGeneration>,
    /// Id of the last fully recorded frame. Ids must go up by one, or the history is dropped.
    last: u64,
    /// The library's history is valid for the next frame.
    has_history: bool,
}

// SAFETY: its structs point to their own links, to the library's context, which one thread at a time may use, and to objects of
// Direct3D 12, which are free-threaded.
unsafe impl Send for Generator {}

impl Generator {
    /// Creates a generator, as [`Context::create`] creates its context. `hudless` is the format of HUD-less frames, if it differs
    /// from that of frames.
    ///
    /// # Errors
    /// As of [`Context::create`]; `Unsupported` with the field `hudless` for a format of its own and a provider of SDK 1.1.2 or earlier.
    ///
    /// # Safety
    /// `device` is a live `ID3D12Device` and outlives the generator.
    pub unsafe fn create(
        api: &Api,
        device: *mut c_void,
        choice: Choice,
        head: CreateFrameGeneration,
        hudless: Option<SurfaceFormat>,
    ) -> Result<Self> {
        let extend = |chain: Chain<_>| match hudless {
            Some(format) => chain.with(CreateFrameGenerationHudless { format, ..Default::default() }),
            None => chain,
        };
        // SAFETY: the caller's promise; the chain holds no pointer.
        let context = unsafe { Context::create(api, device, choice, head, extend) }?;
        let version = &context.provider().version;
        // Earlier providers would copy between textures of two formats.
        let ignores_format = version.number().is_some_and(|number| number < HUDLESS_FORMAT_SINCE);
        if ignores_format && hudless.is_some_and(|format| format != head.back_buffer_format) {
            let why = format!("{version} takes HUD-less frames only in the format of frames");
            return Err(Error::new(ErrorKind::Unsupported, why)
                .field("hudless")
                .remedy("Use that format, or AMD's libraries of SDK 1.1.3 or later"));
        }
        let prepare = match context.provider().dialect {
            Dialect::Sdk11 => Prepare::Separate(Chain::new(DispatchPrepare::default()).with(DispatchCamera::default())),
            Dialect::Sdk21 => Prepare::Combined(Chain::new(DispatchPrepareV2::default())),
        };
        let settings = Chain::new(ConfigureFrameGeneration::default());
        let dispatch = Chain::new(DispatchFrameGeneration::default());
        Ok(Self { context, settings, prepare, dispatch, last: 0, has_history: false })
    }

    /// The provider in use.
    pub fn provider(&self) -> &Provider {
        self.context.provider()
    }

    /// The provider's device memory, as it reports it; None if it cannot.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn memory(&mut self) -> Result<Option<MemoryUsage>> {
        self.context.memory()
    }

    /// Records the frame between `frame` and the previous one into its list. Three calls share one id: configure, prepare (motion
    /// and depth), generate. The first frame, and one after a failure, drops the history as [`FrameParams::reset`] does.
    ///
    /// # Errors
    /// `InvalidArgument` with the field, before anything is recorded, for input on which a provider would fail, hang or crash. Else
    /// the library's own errors, after which the list may hold part of the work.
    ///
    /// # Safety
    /// The list is open and of the generator's device, and so are the resources, whose descriptions are right; they and the
    /// generator live until the list has run.
    pub unsafe fn record(&mut self, frame: &Frame) -> Result<()> {
        self.check(frame)?;
        let FrameParams { rect, transfer, luminance, .. } = frame.params;
        let without = ConfigureFrameGeneration { flags: FrameFlags::NO_SWAPCHAIN, ..Default::default() };
        // SAFETY: the caller's promise.
        let (id, reset) = unsafe { self.begin(frame, without) }?;
        *self.dispatch.head_mut() = DispatchFrameGeneration {
            command_list: frame.command_list,
            present_color: frame.color,
            outputs: [frame.output, Resource::default(), Resource::default(), Resource::default()],
            frames: 1,
            reset,
            transfer,
            luminance,
            rect,
            frame_id: id,
            ..Default::default()
        };
        // SAFETY: the caller's promise about the list and the resources; the context is our own.
        unsafe { self.context.dispatch(&mut self.dispatch) }?;
        (self.last, self.has_history) = (id, true);
        Ok(())
    }

    /// Checks a frame as [`record`](Self::record) does.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for input on which a provider would fail, hang or crash.
    pub fn check(&self, frame: &Frame) -> Result<()> {
        let made = self.context.creation();
        let fault = fault_of_pictures(frame, made).or_else(|| fault(frame, made, self.hudless_format(), false));
        fault.map_or(Ok(()), |(field, why)| Err(Error::new(ErrorKind::InvalidArgument, why).field(field)))
    }

    /// Checks a frame for [`prepare`](Self::prepare).
    ///
    /// # Errors
    /// As [`check`](Self::check).
    #[cfg(windows)]
    pub(super) fn check_presented(&self, frame: &Frame) -> Result<()> {
        let fault = fault(frame, self.context.creation(), self.hudless_format(), true);
        fault.map_or(Ok(()), |(field, why)| Err(Error::new(ErrorKind::InvalidArgument, why).field(field)))
    }

    /// Makes the configure and prepare calls of a frame that [`check_presented`](Self::check_presented) has accepted; AMD's swap chain makes the third when the frame is presented. Returns the
    /// frame's id, and whether it drops the history. Ignores color, output, transfer and luminance.
    ///
    /// # Errors
    /// As [`record`](Self::record).
    ///
    /// # Safety
    /// As [`record`](Self::record); the swap chain and the callback's user data live until the next configure call replaces them.
    #[cfg(windows)]
    pub(super) unsafe fn prepare(&mut self, frame: &Frame, settings: ConfigureFrameGeneration) -> Result<(u64, bool)> {
        // SAFETY: the caller's promise.
        let prepared = unsafe { self.begin(frame, settings) }?;
        (self.last, self.has_history) = (prepared.0, true);
        Ok(prepared)
    }

    /// Turns generation off for AMD's swap chain. Afterwards it has no frame of this generator in flight.
    ///
    /// # Errors
    /// The library's own errors.
    ///
    /// # Safety
    /// `swapchain` is a live swap chain of AMD's.
    #[cfg(windows)]
    pub(super) unsafe fn turn_off(&mut self, swapchain: *mut c_void) -> Result<()> {
        self.has_history = false;
        *self.settings.head_mut() =
            ConfigureFrameGeneration { swapchain, frame_id: self.last + 1, ..Default::default() };
        // SAFETY: the caller's promise; the context is our own.
        unsafe { self.context.configure(&mut self.settings) }
    }

    /// Its ffx-api context.
    #[cfg(windows)]
    pub(super) fn context(&self) -> &Context<CreateFrameGeneration> {
        &self.context
    }

    /// Makes the configure call, with the swap chain, callback and flags of `settings`, and then the prepare call, for a frame that was checked.
    unsafe fn begin(&mut self, frame: &Frame, settings: ConfigureFrameGeneration) -> Result<(u64, bool)> {
        let made = self.context.creation();
        let reset = frame.params.reset || !self.has_history;
        let id = self.last + 1;
        self.has_history = false;
        *self.settings.head_mut() = ConfigureFrameGeneration {
            enabled: true,
            allow_async: made.flags.contains(CreateFlags::ASYNC_WORKLOAD),
            hudless: frame.hudless,
            rect: frame.params.rect,
            frame_id: id,
            ..settings
        };
        // A provider forgets the field at each configure call.
        if frame.distortion.resource.is_null() {
            self.settings.remove::<ConfigureDistortion>();
        } else {
            self.settings.set(ConfigureDistortion { field: frame.distortion, ..Default::default() });
        }
        let far = frame.params.camera.far_plane(made.flags.contains(CreateFlags::DEPTH_INFINITE));
        // SAFETY: the caller's promise about the list and the resources; the context is our own.
        unsafe {
            self.context.configure(&mut self.settings)?;
            match &mut self.prepare {
                Prepare::Separate(chain) => {
                    *chain.head_mut() = DispatchPrepare { flags: settings.flags, ..prepare_struct(frame, id, far) };
                    if let Some(link) = chain.link_mut::<DispatchCamera>() {
                        let Camera { position, up, right, forward, .. } = frame.params.camera;
                        *link = DispatchCamera { position, up, right, forward, ..Default::default() };
                    }
                    self.context.dispatch(chain)?;
                }
                Prepare::Combined(chain) => {
                    *chain.head_mut() =
                        DispatchPrepareV2 { flags: settings.flags, ..prepare_struct_v2(frame, id, reset, far) };
                    self.context.dispatch(chain)?;
                }
            }
        }
        Ok((id, reset))
    }

    /// Drops the history at the next frame, as [`FrameParams::reset`] does.
    #[cfg(windows)]
    pub(super) fn drop_history(&mut self) {
        self.has_history = false;
    }

    /// Id of the last frame.
    #[cfg(windows)]
    pub(super) fn last_id(&self) -> u64 {
        self.last
    }

    /// Makes ids of frames go on after `id`: a swap chain does not present the same id twice, also of another generator.
    #[cfg(windows)]
    pub(super) fn continue_after(&mut self, id: u64) {
        self.last = id;
    }

    /// Whether the next frame uses the history.
    #[cfg(windows)]
    pub(super) fn has_history(&self) -> bool {
        self.has_history
    }

    /// The struct it was created with.
    #[cfg(windows)]
    pub(super) fn creation(&self) -> &CreateFrameGeneration {
        self.context.creation()
    }

    /// The format of HUD-less frames.
    fn hudless_format(&self) -> SurfaceFormat {
        let other = self.context.creation_link::<CreateFrameGenerationHudless>().map(|link| link.format);
        other.unwrap_or(self.context.creation().back_buffer_format)
    }
}

fn prepare_struct(frame: &Frame, frame_id: u64, far: f32) -> DispatchPrepare {
    DispatchPrepare {
        frame_id,
        command_list: frame.command_list,
        render_size: frame.params.render_size,
        jitter: frame.params.jitter,
        motion_scale: frame.params.motion_scale,
        frame_time: frame.params.frame_time,
        camera_near: frame.params.camera.near,
        camera_far: far,
        camera_fov: frame.params.camera.fov,
        metres: frame.params.camera.metres,
        depth: frame.depth,
        motion: frame.motion,
        ..Default::default()
    }
}

fn prepare_struct_v2(frame: &Frame, frame_id: u64, reset: bool, far: f32) -> DispatchPrepareV2 {
    DispatchPrepareV2 {
        frame_id,
        command_list: frame.command_list,
        render_size: frame.params.render_size,
        jitter: frame.params.jitter,
        motion_scale: frame.params.motion_scale,
        frame_time: frame.params.frame_time,
        reset,
        camera_near: frame.params.camera.near,
        camera_far: far,
        camera_fov: frame.params.camera.fov,
        metres: frame.params.camera.metres,
        depth: frame.depth,
        motion: frame.motion,
        camera_position: frame.params.camera.position,
        camera_up: frame.params.camera.up,
        camera_right: frame.params.camera.right,
        camera_forward: frame.params.camera.forward,
        ..Default::default()
    }
}

/// Checks the frame's colour and output textures; returns the wrong field and the reason.
fn fault_of_pictures(frame: &Frame, made: &CreateFrameGeneration) -> Option<(&'static str, &'static str)> {
    for (field, resource) in [("color", &frame.color), ("output", &frame.output)] {
        if let Some(why) = resource.fault(made.display_size) {
            return Some((field, why));
        }
        if resource.description.format != made.back_buffer_format {
            return Some((field, "its format is not the one that the generator was made for"));
        }
    }
    (frame.color.resource == frame.output.resource).then_some(("output", "it is the frame itself"))
}

/// Checks a frame against the generator's creation struct; returns the wrong field and the reason. For a presented frame the
/// transfer function is not checked.
fn fault(
    frame: &Frame,
    made: &CreateFrameGeneration,
    hudless: SurfaceFormat,
    is_presented: bool,
) -> Option<(&'static str, &'static str)> {
    if frame.command_list.is_null() {
        return Some(("command_list", "it is null"));
    }
    if let Some(why) = frame.params.render_size.fault() {
        return Some(("render_size", why));
    }
    let (render, largest, display_size) = (frame.params.render_size, made.max_render_size, made.display_size);
    if render.width > largest.width || render.height > largest.height {
        return Some(("render_size", "it is larger than what the generator was made for"));
    }
    let motion = if made.flags.contains(CreateFlags::DISPLAY_RESOLUTION_MOTION) { display_size } else { render };
    for (field, resource, size) in [("depth", &frame.depth, render), ("motion", &frame.motion, motion)] {
        if let Some(why) = resource.fault(size) {
            return Some((field, why));
        }
    }
    for (field, resource) in [("hudless", &frame.hudless), ("distortion", &frame.distortion)] {
        if !resource.resource.is_null()
            && let Some(why) = resource.fault(display_size)
        {
            return Some((field, why));
        }
    }
    if frame.hudless.resource.is_null() {
        // AMD's provider would copy the frame into textures of the other format.
        if hudless != made.back_buffer_format {
            return Some((
                "hudless",
                "it is null, and the generator was made for HUD-less frames with a format of their own",
            ));
        }
    } else if frame.hudless.description.format != hudless {
        return Some(("hudless", "its format is not the one that the generator was made for"));
    }
    let numbers = [
        ("jitter", frame.params.jitter),
        ("motion_scale", frame.params.motion_scale),
        ("luminance", Coordinates { x: frame.params.luminance[0], y: frame.params.luminance[1] }),
    ];
    if let Some((field, _)) = numbers.into_iter().find(|(_, pair)| !pair.x.is_finite() || !pair.y.is_finite()) {
        return Some((field, "it must be finite"));
    }
    if !(frame.params.frame_time.is_finite() && frame.params.frame_time > 0.0) {
        return Some(("frame_time", "it must be above 0"));
    }
    if let Some(why) = frame.params.rect.fault(display_size) {
        return Some(("rect", why));
    }
    let is_hdr = made.flags.contains(CreateFlags::HIGH_DYNAMIC_RANGE);
    match frame.params.transfer {
        _ if is_presented => {}
        TransferFunction::SRGB => {}
        TransferFunction::PQ | TransferFunction::SCRGB if is_hdr => {
            let [darkest, brightest] = frame.params.luminance;
            if !(darkest >= 0.0 && brightest > darkest) {
                return Some(("luminance", "it must go up from 0 or more"));
            }
        }
        TransferFunction::PQ | TransferFunction::SCRGB => {
            return Some(("transfer", "the generator was not made for high dynamic range"));
        }
        _ => return Some(("transfer", "it is none that is known")),
    }
    frame.params.camera.fault(made.flags.contains(CreateFlags::DEPTH_INFINITE))
}

#[cfg(test)]
mod tests;
