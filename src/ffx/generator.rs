//! Frames between two, into textures of the host's: the three calls that each frame takes, without a swapchain.

use std::ffi::c_void;

use super::bindings::{
    ConfigureDistortion, ConfigureFrameGeneration, Coordinates, CreateFlags, CreateFrameGeneration,
    CreateFrameGenerationHudless, Dimensions, DispatchCamera, DispatchFrameGeneration, DispatchPrepare,
    DispatchPrepareV2, FrameFlags, MemoryUsage, Rect, Resource, SurfaceFormat, TransferFunction,
};
use super::{Api, Chain, Choice, Context, Dialect, Provider};
use crate::{Error, ErrorKind, Result};

/// Where a frame was seen from. Its vectors are in the world and of length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// In the world.
    pub position: [f32; 3],
    /// Up on the screen.
    pub up: [f32; 3],
    /// To the right on the screen.
    pub right: [f32; 3],
    /// Into the screen.
    pub forward: [f32; 3],
    /// The near plane, above 0.
    pub near: f32,
    /// The far plane, above 0; not looked at where depth is infinite.
    pub far: f32,
    /// From the bottom of the picture to its top, radians, inside (0, pi).
    pub fov: f32,
    /// Metres in a unit of the view, above 0.
    pub metres: f32,
}

impl Default for Camera {
    /// At the origin, looking along z with y up; 1 radian, from 0.1 to 100 metres.
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

impl Camera {
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

/// What a provider is told of a frame beside its pictures.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// The size rendered at.
    pub render_size: Dimensions,
    /// Of the camera, in render pixels.
    pub jitter: Coordinates,
    /// What makes render pixels of what the texture of motion holds; of the size shown where motion has that.
    pub motion_scale: Coordinates,
    /// Milliseconds since the frame before, of the world's time.
    pub frame_time: f32,
    /// Where it was seen from.
    pub camera: Camera,
    /// There is no frame before: a cut. The generated frame is then this one.
    pub reset: bool,
    /// What of the frame is the world, the rest is copied; of no size for all.
    pub rect: Rect,
    /// How the frame's light became numbers: sRGB, or one of high dynamic range where the generator was made for it.
    pub transfer: TransferFunction,
    /// Nits, the darkest and the brightest, of high dynamic range.
    pub luminance: [f32; 2],
}

impl Shot {
    /// One that follows the frame before by 1/15 s, rendered at that size without jitter, with motion in pixels, seen by the camera
    /// that is the default, all of it the world, in sRGB.
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

/// A frame, and where the one between it and the frame before is to go.
///
/// Every resource is in the state that it names when the list gets to the call, and is in it again afterwards.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// `ID3D12GraphicsCommandList`, open. Descriptor heaps, root signatures and pipelines of its are others afterwards.
    pub command_list: *mut c_void,
    /// The frame, of the size shown and the format that the generator was made for.
    pub color: Resource,
    /// Gets the generated frame, of the same size and format; written by shaders.
    pub output: Resource,
    /// Device depth, of the size rendered at.
    pub depth: Resource,
    /// From this frame to the one before, of the size rendered at or, where the generator was made so, of the size shown. Numbers
    /// that are not finite, or beyond the picture's size, may hold the device up.
    pub motion: Resource,
    /// The frame without interface, of the size shown; a null resource where it has none.
    pub hudless: Resource,
    /// Where a lens puts each pixel less where it was, in parts of the picture, of the size shown; a null resource where there is no
    /// distortion. Once one was given, every frame has one: a provider goes on with the last.
    pub distortion: Resource,
    /// All else.
    pub shot: Shot,
}

/// The structs in which a provider is told of motion and depth.
enum Prepare {
    /// Up to SDK 2.0.
    Apart(Chain<DispatchPrepare>),
    /// From SDK 2.1 on.
    InOne(Chain<DispatchPrepareV2>),
}

/// Generates frames without a swapchain. Its structs are made once, and altered for each frame.
///
/// Threads: may be sent to another thread between calls; calls take turns. What it recorded must have run before it is dropped, and
/// of its frames at most four may be on their way to the device.
pub struct Generator {
    context: Context<CreateFrameGeneration>,
    settings: Chain<ConfigureFrameGeneration>,
    prepare: Prepare,
    dispatch: Chain<DispatchFrameGeneration>,
    /// Of the last frame that was recorded whole; ids go up by one or history is dropped.
    last: u64,
    /// What the library has of the frame before can be gone on with.
    follows: bool,
}

// SAFETY: its structs point to links of their own, to the library's context, which calls of one thread after the other may use, and
// to objects of Direct3D 12, which are free-threaded.
unsafe impl Send for Generator {}

impl Generator {
    /// Makes a generator, as [`Context::create`] makes its context. `hudless` is the format of frames without interface, where it is
    /// another than that of frames.
    ///
    /// # Errors
    /// As of [`Context::create`].
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
        // SAFETY: the caller's promise; nothing that points stands in the chain.
        let context = unsafe { Context::create(api, device, choice, head, extend) }?;
        let prepare = match context.provider().dialect {
            Dialect::Sdk11 => Prepare::Apart(Chain::new(DispatchPrepare::default()).with(DispatchCamera::default())),
            Dialect::Sdk21 => Prepare::InOne(Chain::new(DispatchPrepareV2::default())),
        };
        let settings = Chain::new(ConfigureFrameGeneration::default());
        let dispatch = Chain::new(DispatchFrameGeneration::default());
        Ok(Self { context, settings, prepare, dispatch, last: 0, follows: false })
    }

    /// What runs.
    pub fn provider(&self) -> &Provider {
        self.context.provider()
    }

    /// What the provider keeps on the device, as it reports it; None where it cannot say.
    ///
    /// # Errors
    /// What the library answers.
    pub fn memory(&mut self) -> Result<Option<MemoryUsage>> {
        self.context.memory()
    }

    /// Records the frame between `frame` and the one before into its list: settings, then motion and depth, then the picture, under
    /// one id. The first frame, and one after a failure, starts anew as [`Shot::reset`] does.
    ///
    /// # Errors
    /// `InvalidArgument` with the field, before anything is recorded, for what a provider would fail, hang or crash on; else what the
    /// library answers, and then the list may hold a part of the work.
    ///
    /// # Safety
    /// The list is open and of the generator's device, and so are the resources, which are what they are said to be; they and the
    /// generator live until the list has run.
    pub unsafe fn record(&mut self, frame: &Frame) -> Result<()> {
        if let Some((field, why)) = fault_of_pictures(frame, self.context.made_with()) {
            return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        }
        let Shot { rect, transfer, luminance, .. } = frame.shot;
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
        (self.last, self.follows) = (id, true);
        Ok(())
    }

    /// Records the first two of a frame's calls, the other one of which AMD's swapchain has made once the frame is presented; the
    /// frame's id, and whether it starts anew. Color, output, transfer and luminance are not looked at.
    ///
    /// # Errors
    /// As of [`record`](Self::record).
    ///
    /// # Safety
    /// As of [`record`](Self::record), and the swapchain and the callback's context live until another is told.
    #[cfg(windows)]
    pub(super) unsafe fn prepare(&mut self, frame: &Frame, told: ConfigureFrameGeneration) -> Result<(u64, bool)> {
        // SAFETY: the caller's promise.
        let begun = unsafe { self.begin(frame, told) }?;
        (self.last, self.follows) = (begun.0, true);
        Ok(begun)
    }

    /// Turns generation off for a swapchain of AMD's, which then has no frame of this generator's under way.
    ///
    /// # Errors
    /// What the library answers.
    ///
    /// # Safety
    /// A live swapchain of AMD's.
    #[cfg(windows)]
    pub(super) unsafe fn turn_off(&mut self, swapchain: *mut c_void) -> Result<()> {
        self.follows = false;
        *self.settings.head_mut() =
            ConfigureFrameGeneration { swapchain, frame_id: self.last + 1, ..Default::default() };
        // SAFETY: the caller's promise; the context is our own.
        unsafe { self.context.configure(&mut self.settings) }
    }

    /// Its context.
    #[cfg(windows)]
    pub(super) fn context(&self) -> &Context<CreateFrameGeneration> {
        &self.context
    }

    /// Settings, with those of `told` that are not the frame's, then motion and depth.
    unsafe fn begin(&mut self, frame: &Frame, told: ConfigureFrameGeneration) -> Result<(u64, bool)> {
        let had_distortion = self.settings.link::<ConfigureDistortion>().is_some();
        let is_presented = !told.flags.contains(FrameFlags::NO_SWAPCHAIN);
        let (made, hudless) = (self.context.made_with(), self.hudless_format());
        if let Some((field, why)) = fault(frame, made, hudless, had_distortion, is_presented) {
            return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        }
        let reset = frame.shot.reset || !self.follows;
        let id = self.last + 1;
        self.follows = false;
        *self.settings.head_mut() = ConfigureFrameGeneration {
            enabled: true,
            allow_async: made.flags.contains(CreateFlags::ASYNC_WORKLOAD),
            hudless: frame.hudless,
            rect: frame.shot.rect,
            frame_id: id,
            ..told
        };
        if !frame.distortion.resource.is_null() {
            self.settings.set(ConfigureDistortion { field: frame.distortion, ..Default::default() });
        }
        // SAFETY: the caller's promise about the list and the resources; the context is our own.
        unsafe {
            self.context.configure(&mut self.settings)?;
            match &mut self.prepare {
                Prepare::Apart(chain) => {
                    *chain.head_mut() = DispatchPrepare { flags: told.flags, ..apart(frame, id) };
                    if let Some(link) = chain.link_mut::<DispatchCamera>() {
                        let Camera { position, up, right, forward, .. } = frame.shot.camera;
                        *link = DispatchCamera { position, up, right, forward, ..Default::default() };
                    }
                    self.context.dispatch(chain)?;
                }
                Prepare::InOne(chain) => {
                    *chain.head_mut() = DispatchPrepareV2 { flags: told.flags, ..in_one(frame, id, reset) };
                    self.context.dispatch(chain)?;
                }
            }
        }
        Ok((id, reset))
    }

    /// Lets the next frame start anew, as [`Shot::reset`] does.
    #[cfg(windows)]
    pub(super) fn forget(&mut self) {
        self.follows = false;
    }

    /// Whether the next frame goes on from the one before.
    #[cfg(windows)]
    pub(super) fn follows(&self) -> bool {
        self.follows
    }

    /// What it was made for.
    #[cfg(windows)]
    pub(super) fn made_with(&self) -> &CreateFrameGeneration {
        self.context.made_with()
    }

    /// The format that frames without interface have.
    fn hudless_format(&self) -> SurfaceFormat {
        let other = self.context.made_with_link::<CreateFrameGenerationHudless>().map(|link| link.format);
        other.unwrap_or(self.context.made_with().back_buffer_format)
    }
}

fn apart(frame: &Frame, frame_id: u64) -> DispatchPrepare {
    DispatchPrepare {
        frame_id,
        command_list: frame.command_list,
        render_size: frame.shot.render_size,
        jitter: frame.shot.jitter,
        motion_scale: frame.shot.motion_scale,
        frame_time: frame.shot.frame_time,
        camera_near: frame.shot.camera.near,
        camera_far: frame.shot.camera.far,
        camera_fov: frame.shot.camera.fov,
        metres: frame.shot.camera.metres,
        depth: frame.depth,
        motion: frame.motion,
        ..Default::default()
    }
}

fn in_one(frame: &Frame, frame_id: u64, reset: bool) -> DispatchPrepareV2 {
    DispatchPrepareV2 {
        frame_id,
        command_list: frame.command_list,
        render_size: frame.shot.render_size,
        jitter: frame.shot.jitter,
        motion_scale: frame.shot.motion_scale,
        frame_time: frame.shot.frame_time,
        reset,
        camera_near: frame.shot.camera.near,
        camera_far: frame.shot.camera.far,
        camera_fov: frame.shot.camera.fov,
        metres: frame.shot.camera.metres,
        depth: frame.depth,
        motion: frame.motion,
        camera_position: frame.shot.camera.position,
        camera_up: frame.shot.camera.up,
        camera_right: frame.shot.camera.right,
        camera_forward: frame.shot.camera.forward,
        ..Default::default()
    }
}

/// What is wrong with the frame itself, and with where the generated one is to go.
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

/// What is wrong with a frame for a generator that was made so: the field, and why. One that `is_presented` says less of itself.
fn fault(
    frame: &Frame,
    made: &CreateFrameGeneration,
    hudless: SurfaceFormat,
    had_distortion: bool,
    is_presented: bool,
) -> Option<(&'static str, &'static str)> {
    if frame.command_list.is_null() {
        return Some(("command_list", "it is null"));
    }
    if let Some(why) = frame.shot.render_size.fault() {
        return Some(("render_size", why));
    }
    let (render, largest, shown) = (frame.shot.render_size, made.max_render_size, made.display_size);
    if render.width > largest.width || render.height > largest.height {
        return Some(("render_size", "it is larger than what the generator was made for"));
    }
    let motion = if made.flags.contains(CreateFlags::DISPLAY_RESOLUTION_MOTION) { shown } else { render };
    for (field, resource, size) in [("depth", &frame.depth, render), ("motion", &frame.motion, motion)] {
        if let Some(why) = resource.fault(size) {
            return Some((field, why));
        }
    }
    if frame.distortion.resource.is_null() && had_distortion {
        return Some(("distortion", "frames before had one, and a provider goes on with the last"));
    }
    for (field, resource) in [("hudless", &frame.hudless), ("distortion", &frame.distortion)] {
        if !resource.resource.is_null()
            && let Some(why) = resource.fault(shown)
        {
            return Some((field, why));
        }
    }
    if !frame.hudless.resource.is_null() && frame.hudless.description.format != hudless {
        return Some(("hudless", "its format is not the one that the generator was made for"));
    }
    let numbers = [
        ("jitter", frame.shot.jitter),
        ("motion_scale", frame.shot.motion_scale),
        ("luminance", Coordinates { x: frame.shot.luminance[0], y: frame.shot.luminance[1] }),
    ];
    if let Some((field, _)) = numbers.into_iter().find(|(_, pair)| !pair.x.is_finite() || !pair.y.is_finite()) {
        return Some((field, "it must be finite"));
    }
    if !(frame.shot.frame_time.is_finite() && frame.shot.frame_time > 0.0) {
        return Some(("frame_time", "it must be above 0"));
    }
    if let Some(why) = frame.shot.rect.fault(shown) {
        return Some(("rect", why));
    }
    let is_hdr = made.flags.contains(CreateFlags::HIGH_DYNAMIC_RANGE);
    match frame.shot.transfer {
        _ if is_presented => {}
        TransferFunction::SRGB => {}
        TransferFunction::PQ | TransferFunction::SCRGB if is_hdr => {
            let [darkest, brightest] = frame.shot.luminance;
            if !(darkest >= 0.0 && brightest > darkest) {
                return Some(("luminance", "it must go up from 0 or more"));
            }
        }
        TransferFunction::PQ | TransferFunction::SCRGB => {
            return Some(("transfer", "the generator was not made for high dynamic range"));
        }
        _ => return Some(("transfer", "it is none that is known")),
    }
    frame.shot.camera.fault(made.flags.contains(CreateFlags::DEPTH_INFINITE))
}

#[cfg(test)]
mod tests;
