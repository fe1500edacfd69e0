//! Upscales frames into the host's textures.

use std::ffi::c_void;
use std::ptr::null_mut;

use super::bindings::{
    Coordinates, CreateUpscale, Dimensions, DispatchReactiveMask, DispatchUpscale, MemoryUsage, QualityMode,
    QueryJitter, QueryJitterPhases, QueryRenderSize, QueryUpscaleResources, ReactiveFlags, Resource,
    UpscaleCreateFlags, UpscaleFlags, UpscaleResources,
};
use super::{Api, Camera, Chain, Choice, Context, Provider, message};
use crate::{Error, ErrorKind, Result};

/// The inputs and the output of one upscaled frame.
///
/// Every resource is in its stated state when the list reaches the call, and again afterwards.
#[derive(Debug, Clone, Copy)]
pub struct UpscaleFrame {
    /// `ID3D12GraphicsCommandList`, open. The call changes its descriptor heaps, root signatures and pipelines.
    pub command_list: *mut c_void,
    /// The frame at render size.
    pub color: Resource,
    /// Device depth at render size.
    pub depth: Resource,
    /// Motion vectors from this frame to the previous one, at render size, or at display size if the upscaler was created so.
    pub motion: Resource,
    /// Exposure, a 1x1 texture whose value multiplies the frame's colours; a null resource for 1, or if the provider computes it.
    pub exposure: Resource,
    /// Reactive mask at render size, 0 to 1: how little a pixel's history may be trusted; a null resource for none.
    pub reactive: Resource,
    /// Transparency mask at render size, 0 to 1: pixels whose colour does not belong to the depth and motion there; a null resource
    /// for none.
    pub transparency: Resource,
    /// Receives the upscaled frame; written by shaders.
    pub output: Resource,
    /// The other parameters.
    pub params: UpscaleParams,
}

/// Parameters of a frame other than its textures.
#[derive(Debug, Clone, Copy)]
pub struct UpscaleParams {
    /// The render size.
    pub render_size: Dimensions,
    /// The size of the upscaled frame.
    pub shown: Dimensions,
    /// Camera jitter in render pixels; see [`Upscaler::jitter`].
    pub jitter: Coordinates,
    /// Scale from motion-texture units to render pixels (display pixels if the motion texture has display size).
    pub motion_scale: Coordinates,
    /// Strength of sharpening from 0 to 1; None for no sharpening.
    pub sharpness: Option<f32>,
    /// World time since the previous frame, in milliseconds.
    pub frame_time: f32,
    /// Factor that the frame's colours were multiplied by when it was rendered, above 0.
    pub pre_exposure: f32,
    /// Drops the history, as after a cut.
    pub reset: bool,
    /// The camera; an upscaler uses its near and far plane, field of view and unit only.
    pub camera: Camera,
    /// The colours' encoding (sRGB or PQ) if the upscaler was created for non-linear colours; else empty.
    pub encoding: UpscaleFlags,
}

impl UpscaleParams {
    /// Defaults: 1/15 s after the previous frame, no jitter, motion in pixels, no sharpening, the default camera, linear colours.
    pub fn of(render_size: Dimensions, shown: Dimensions) -> Self {
        Self {
            render_size,
            shown,
            jitter: Coordinates::default(),
            motion_scale: Coordinates { x: 1.0, y: 1.0 },
            sharpness: None,
            frame_time: 1000.0 / 15.0,
            pre_exposure: 1.0,
            reset: false,
            camera: Camera::default(),
            encoding: UpscaleFlags::empty(),
        }
    }
}

/// How a reactive mask is computed: the difference between the frame and the same frame without transparent objects, times the
/// scale.
#[derive(Debug, Clone, Copy)]
pub struct ReactiveMask {
    /// The render size.
    pub render_size: Dimensions,
    /// Factor of the difference, 0 or more.
    pub scale: f32,
    /// With [`ReactiveFlags::THRESHOLD`]: the mask is 0 up to this value.
    pub threshold: f32,
    /// With [`ReactiveFlags::THRESHOLD`]: the mask above the threshold, from 0 to 1.
    pub value: f32,
    /// How colours are compared.
    pub flags: ReactiveFlags,
}

impl ReactiveMask {
    /// Defaults for frames of that size: the length of the colour difference, unscaled.
    pub fn of(render_size: Dimensions) -> Self {
        Self { render_size, scale: 1.0, threshold: 0.2, value: 0.9, flags: ReactiveFlags::empty() }
    }

    fn fault(&self) -> Option<(&'static str, &'static str)> {
        let known = ReactiveFlags::TONEMAP
            | ReactiveFlags::INVERSE_TONEMAP
            | ReactiveFlags::THRESHOLD
            | ReactiveFlags::COMPONENTS_MAX;
        if let Some(why) = self.render_size.fault() {
            return Some(("render_size", why));
        }
        if !(self.scale.is_finite() && self.scale >= 0.0) {
            return Some(("scale", "it must be 0 or more"));
        }
        if !(0.0..=1.0).contains(&self.threshold) {
            return Some(("threshold", "it must be from 0 to 1"));
        }
        if !(0.0..=1.0).contains(&self.value) {
            return Some(("value", "it must be from 0 to 1"));
        }
        (!(self.flags - known).is_empty()).then_some(("flags", "there is one that is not known"))
    }
}

/// A temporal upscaler. Its dispatch struct is created once and changed for each frame.
///
/// Threads: may be sent to another thread between calls; one call at a time. Its recorded work must have run before it is dropped,
/// and at most four of its frames may be in flight.
pub struct Upscaler {
    context: Context<CreateUpscale>,
    dispatch: Chain<DispatchUpscale>,
    /// The library's history is valid for the next frame.
    has_history: bool,
}

// SAFETY: its struct points to its own links, to the library's context, which one thread at a time may use, and to objects of
// Direct3D 12, which are free-threaded.
unsafe impl Send for Upscaler {}

impl Upscaler {
    /// Creates an upscaler, as [`Context::create`] creates its context.
    ///
    /// # Errors
    /// As of [`Context::create`].
    ///
    /// # Safety
    /// `device` is a live `ID3D12Device` and outlives the upscaler.
    pub unsafe fn create(api: &Api, device: *mut c_void, choice: Choice, head: CreateUpscale) -> Result<Self> {
        let head = CreateUpscale { message: head.message.or(Some(message::receive)), ..head };
        // SAFETY: the caller's promise; the only pointer in the chain is the callback, which is static.
        let context = unsafe { Context::create(api, device, choice, head, |chain| chain) }?;
        Ok(Self { context, dispatch: Chain::new(DispatchUpscale::default()), has_history: false })
    }

    /// The render size of a quality mode for the display size `shown`.
    ///
    /// # Errors
    /// `InvalidArgument` for a size with a side of 0 or above 16384. The library's own errors.
    pub fn render_size(api: &Api, shown: Dimensions, mode: QualityMode) -> Result<Dimensions> {
        if let Some(why) = shown.fault() {
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("shown"));
        }
        let (mut width, mut height) = (0, 0);
        let mut query = Chain::new(QueryRenderSize {
            display_width: shown.width,
            display_height: shown.height,
            mode,
            render_width: &mut width,
            render_height: &mut height,
            ..Default::default()
        });
        // SAFETY: no context, and memory for the answers that lives during the call.
        unsafe { api.query(null_mut(), &mut query) }.map_err(|failure| failure.error())?;
        let answer = Dimensions { width, height };
        match answer.fault() {
            Some(why) => Err(Error::new(ErrorKind::Device, format!("a render size of {width} x {height}: {why}"))),
            None => Ok(answer),
        }
    }

    /// Length of the jitter sequence for frames of that render width and display width.
    ///
    /// # Errors
    /// `InvalidArgument` for a width of 0. The library's own errors.
    pub fn jitter_phases(api: &Api, render_width: u32, shown_width: u32) -> Result<u32> {
        for (field, width) in [("render_width", render_width), ("shown_width", shown_width)] {
            if width == 0 {
                return Err(Error::new(ErrorKind::InvalidArgument, "it must be above 0").field(field));
            }
        }
        let mut count = 0;
        let mut query = Chain::new(QueryJitterPhases {
            render_width,
            display_width: shown_width,
            count: &mut count,
            ..Default::default()
        });
        // SAFETY: no context, and memory for the answer that lives during the call.
        unsafe { api.query(null_mut(), &mut query) }.map_err(|failure| failure.error())?;
        u32::try_from(count)
            .ok()
            .filter(|count| *count > 0)
            .ok_or_else(|| Error::new(ErrorKind::Device, format!("a sequence of {count} jitters is none")))
    }

    /// Jitter of frame `index` in a sequence of `phases`, in render pixels, within half a pixel in x and y. Offset the camera's
    /// projection by `(2 x / width, -2 y / height)`, with the render size.
    ///
    /// # Errors
    /// `InvalidArgument` for a sequence without entries. The library's own errors.
    pub fn jitter(api: &Api, index: u64, phases: u32) -> Result<Coordinates> {
        let Some(count) = i32::try_from(phases).ok().filter(|count| *count > 0) else {
            return Err(Error::new(ErrorKind::InvalidArgument, "it must be from 1 to 2147483647").field("phases"));
        };
        let (mut x, mut y) = (0.0, 0.0);
        let mut query = Chain::new(QueryJitter {
            index: (index % u64::from(phases)) as i32,
            count,
            x: &mut x,
            y: &mut y,
            ..Default::default()
        });
        // SAFETY: no context, and memory for the answers that lives during the call.
        unsafe { api.query(null_mut(), &mut query) }.map_err(|failure| failure.error())?;
        let answer = Coordinates { x, y };
        if !(x.abs() <= 1.0 && y.abs() <= 1.0) {
            return Err(Error::new(ErrorKind::Device, format!("a jitter of {answer:?} is none")));
        }
        Ok(answer)
    }

    /// The provider in use.
    pub fn provider(&self) -> &Provider {
        self.context.provider()
    }

    /// The struct it was created with.
    pub fn creation(&self) -> &CreateUpscale {
        self.context.creation()
    }

    /// The provider's device memory, as it reports it; None if it cannot.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn memory(&mut self) -> Result<Option<MemoryUsage>> {
        self.context.memory()
    }

    /// The textures that the provider requires, and those that it can use in addition. None if it cannot say: SDK 2.0 and later
    /// can, but AMD's FSR 3 answers with every bit. An exposure that the provider finds itself, as it was made to
    /// ([`UpscaleCreateFlags::AUTO_EXPOSURE`]), is in neither, though AMD's FSR 2 names it.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn resources(&mut self) -> Result<Option<[UpscaleResources; 2]>> {
        let mut query = Chain::new(QueryUpscaleResources::default());
        // SAFETY: our own context; the answer is written into the chain.
        let known = super::memory_usage::is_known(unsafe { self.context.try_query(&mut query) })?;
        let says = known && query.head().required.bits() != u64::MAX;
        let is_given = if self.creation().flags.contains(UpscaleCreateFlags::AUTO_EXPOSURE) {
            !UpscaleResources::EXPOSURE
        } else {
            UpscaleResources::all()
        };
        Ok(says.then(|| [query.head().required & is_given, query.head().optional & is_given]))
    }

    /// Checks a frame as [`record`](Self::record) does.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for input on which a provider would fail, hang or crash.
    pub fn check(&self, frame: &UpscaleFrame) -> Result<()> {
        fault(frame, self.context.creation())
            .map_or(Ok(()), |(field, why)| Err(Error::new(ErrorKind::InvalidArgument, why).field(field)))
    }

    /// Records the upscaled frame into its list. The first frame, and one after a failure, drops the history as
    /// [`UpscaleParams::reset`] does.
    ///
    /// # Errors
    /// `InvalidArgument` with the field, before anything is recorded, for input on which a provider would fail, hang or crash. Else
    /// the library's own errors, after which the list may hold part of the work.
    ///
    /// # Safety
    /// The list is open and of the upscaler's device, and so are the resources, whose descriptions are right; they and the upscaler
    /// live until the list has run.
    pub unsafe fn record(&mut self, frame: &UpscaleFrame) -> Result<()> {
        self.check(frame)?;
        let params = &frame.params;
        *self.dispatch.head_mut() = DispatchUpscale {
            command_list: frame.command_list,
            color: frame.color,
            depth: frame.depth,
            motion: frame.motion,
            exposure: frame.exposure,
            reactive: frame.reactive,
            transparency: frame.transparency,
            output: frame.output,
            jitter: params.jitter,
            motion_scale: params.motion_scale,
            render_size: params.render_size,
            upscale_size: params.shown,
            sharpen: params.sharpness.is_some(),
            sharpness: params.sharpness.unwrap_or(0.0),
            frame_time: params.frame_time,
            pre_exposure: params.pre_exposure,
            reset: params.reset || !self.has_history,
            camera_near: params.camera.near,
            camera_far: params
                .camera
                .far_plane(self.context.creation().flags.contains(UpscaleCreateFlags::DEPTH_INFINITE)),
            camera_fov: params.camera.fov,
            metres: params.camera.metres,
            flags: params.encoding,
            ..Default::default()
        };
        self.has_history = false;
        // SAFETY: the caller's promise about the list and the resources; the context is our own.
        unsafe { self.context.dispatch(&mut self.dispatch) }?;
        self.has_history = true;
        Ok(())
    }

    /// Records a reactive mask at render size into `command_list`, for [`UpscaleFrame::reactive`], from the frame `color` and the
    /// same frame without transparent objects.
    ///
    /// # Errors
    /// `InvalidArgument` with the field, before anything is recorded, for input on which a provider would fail. The library's own
    /// errors.
    ///
    /// # Safety
    /// As [`record`](Self::record).
    pub unsafe fn find_reactive(
        &mut self,
        command_list: *mut c_void,
        opaque: Resource,
        color: Resource,
        output: Resource,
        mask: &ReactiveMask,
    ) -> Result<()> {
        let refuse = |field: &str, why: &str| Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        if command_list.is_null() {
            return refuse("command_list", "it is null");
        }
        if let Some((field, why)) = mask.fault() {
            return refuse(field, why);
        }
        let (size, largest) = (mask.render_size, self.context.creation().max_render_size);
        if size.width > largest.width || size.height > largest.height {
            return refuse("render_size", "it is larger than what the upscaler was made for");
        }
        for (field, resource) in [("opaque", &opaque), ("color", &color), ("output", &output)] {
            if let Some(why) = resource.fault(size) {
                return refuse(field, why);
            }
        }
        if [opaque.resource, color.resource].contains(&output.resource) {
            return refuse("output", "it is one of the frames");
        }
        let mut dispatch = Chain::new(DispatchReactiveMask {
            command_list,
            opaque,
            color,
            output,
            render_size: size,
            scale: mask.scale,
            threshold: mask.threshold,
            value: mask.value,
            flags: mask.flags,
            ..Default::default()
        });
        // SAFETY: the caller's promise about the list and the resources; the context is our own.
        unsafe { self.context.dispatch(&mut dispatch) }
    }

    /// Drops the history at the next frame, as [`UpscaleParams::reset`] does.
    pub fn drop_history(&mut self) {
        self.has_history = false;
    }
}

impl std::fmt::Debug for Upscaler {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Upscaler({})", self.provider().version)
    }
}

/// Checks a frame against the upscaler's creation struct; returns the wrong field and the reason.
fn fault(frame: &UpscaleFrame, made: &CreateUpscale) -> Option<(&'static str, &'static str)> {
    let params = &frame.params;
    if frame.command_list.is_null() {
        return Some(("command_list", "it is null"));
    }
    let has = |flag| made.flags.contains(flag);
    for (field, size, largest) in
        [("render_size", params.render_size, made.max_render_size), ("shown", params.shown, made.max_upscale_size)]
    {
        if let Some(why) = size.fault() {
            return Some((field, why));
        }
        if size.width > largest.width || size.height > largest.height {
            return Some((field, "it is larger than what the upscaler was made for"));
        }
    }
    let largest = made.max_render_size;
    let is_largest = (params.render_size.width, params.render_size.height) == (largest.width, largest.height);
    if !is_largest && !has(UpscaleCreateFlags::DYNAMIC_RESOLUTION) {
        return Some(("render_size", "the upscaler was not made for sizes that change"));
    }
    if params.render_size.width > params.shown.width || params.render_size.height > params.shown.height {
        return Some(("shown", "it is smaller than what was rendered"));
    }
    let motion = if has(UpscaleCreateFlags::DISPLAY_RESOLUTION_MOTION) { params.shown } else { params.render_size };
    for (field, resource, size) in [
        ("color", &frame.color, params.render_size),
        ("depth", &frame.depth, params.render_size),
        ("motion", &frame.motion, motion),
        ("output", &frame.output, params.shown),
    ] {
        if let Some(why) = resource.fault(size) {
            return Some((field, why));
        }
    }
    let one = Dimensions { width: 1, height: 1 };
    for (field, resource, size) in [
        ("exposure", &frame.exposure, one),
        ("reactive", &frame.reactive, params.render_size),
        ("transparency", &frame.transparency, params.render_size),
    ] {
        if !resource.resource.is_null()
            && let Some(why) = resource.fault(size)
        {
            return Some((field, why));
        }
    }
    if has(UpscaleCreateFlags::AUTO_EXPOSURE) && !frame.exposure.resource.is_null() {
        return Some(("exposure", "the upscaler was made to find it in the frame"));
    }
    if frame.color.resource == frame.output.resource {
        return Some(("output", "it is the frame itself"));
    }
    for (field, pair) in [("jitter", params.jitter), ("motion_scale", params.motion_scale)] {
        if !pair.x.is_finite() || !pair.y.is_finite() {
            return Some((field, "it must be finite"));
        }
    }
    if params.sharpness.is_some_and(|sharpness| !(0.0..=1.0).contains(&sharpness)) {
        return Some(("sharpness", "it must be from 0 to 1"));
    }
    for (field, number) in [("frame_time", params.frame_time), ("pre_exposure", params.pre_exposure)] {
        if !(number.is_finite() && number > 0.0) {
            return Some((field, "it must be above 0"));
        }
    }
    let encodings = [UpscaleFlags::empty(), UpscaleFlags::COLOR_SRGB, UpscaleFlags::COLOR_PQ];
    if !encodings.contains(&params.encoding) {
        return Some(("encoding", "it is none, sRGB or PQ"));
    }
    if params.encoding.is_empty() == has(UpscaleCreateFlags::NON_LINEAR_COLOR) {
        return Some(("encoding", "it is not what the upscaler was made for"));
    }
    if params.encoding == UpscaleFlags::COLOR_SRGB && has(UpscaleCreateFlags::HIGH_DYNAMIC_RANGE) {
        return Some(("encoding", "sRGB has no light of high dynamic range"));
    }
    params.camera.fault(has(UpscaleCreateFlags::DEPTH_INFINITE))
}

#[cfg(test)]
mod tests;
