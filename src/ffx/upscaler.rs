//! Larger frames, into textures of the host's.

use std::ffi::c_void;
use std::ptr::null_mut;

use super::bindings::{
    Coordinates, CreateUpscale, Dimensions, DispatchReactiveMask, DispatchUpscale, MemoryUsage, QualityMode,
    QueryJitter, QueryJitterPhases, QueryRenderSize, QueryUpscaleResources, ReactiveFlags, Resource,
    UpscaleCreateFlags, UpscaleFlags, UpscaleResources,
};
use super::{Api, Camera, Chain, Choice, Context, Provider, message};
use crate::{Error, ErrorKind, Result};

/// A frame, and where the larger one is to go.
///
/// Every resource is in the state that it names when the list gets to the call, and is in it again afterwards.
#[derive(Debug, Clone, Copy)]
pub struct UpscaleFrame {
    /// `ID3D12GraphicsCommandList`, open. Descriptor heaps, root signatures and pipelines of its are others afterwards.
    pub command_list: *mut c_void,
    /// The frame, of the size rendered at.
    pub color: Resource,
    /// Device depth, of the same size.
    pub depth: Resource,
    /// From this frame to the one before, of the same size or, where the upscaler was made so, of the size shown.
    pub motion: Resource,
    /// What the frame's numbers are to be multiplied by, one pixel; a null resource for 1, or where the provider finds it.
    pub exposure: Resource,
    /// From 0 to 1, how little each pixel's past is to be trusted, of the size rendered at; a null resource for none.
    pub reactive: Resource,
    /// From 0 to 1, where what is seen is not what depth and motion are of, of the size rendered at; a null resource for none.
    pub transparency: Resource,
    /// Gets the larger frame; written by shaders.
    pub output: Resource,
    /// All else.
    pub shot: UpscaleShot,
}

/// What an upscaler is told of a frame beside its pictures.
#[derive(Debug, Clone, Copy)]
pub struct UpscaleShot {
    /// The size rendered at.
    pub render_size: Dimensions,
    /// The size of the larger frame.
    pub shown: Dimensions,
    /// Of the camera, in render pixels; see [`Upscaler::jitter`].
    pub jitter: Coordinates,
    /// What makes render pixels of what the texture of motion holds; of the size shown where motion has that.
    pub motion_scale: Coordinates,
    /// How much the larger frame is sharpened, from 0 to 1; None for not at all.
    pub sharpness: Option<f32>,
    /// Milliseconds since the frame before, of the world's time.
    pub frame_time: f32,
    /// What the frame's numbers were multiplied by when it was drawn, above 0.
    pub pre_exposure: f32,
    /// There is no frame before: a cut.
    pub reset: bool,
    /// Where it was seen from; an upscaler looks at its lens alone.
    pub camera: Camera,
    /// How the frame's light became numbers, where the upscaler was made for frames that are not linear; else nothing.
    pub encoding: UpscaleFlags,
}

impl UpscaleShot {
    /// One that follows the frame before by 1/15 s, without jitter, with motion in pixels, not sharpened, seen by the camera that
    /// is the default, in linear light.
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

/// How a mask is found from a frame and the same without what is transparent: how far the two are apart, times the scale.
#[derive(Debug, Clone, Copy)]
pub struct ReactiveMask {
    /// The size rendered at.
    pub render_size: Dimensions,
    /// What the distance is multiplied by, 0 or more.
    pub scale: f32,
    /// With [`ReactiveFlags::THRESHOLD`]: up to here the mask is 0.
    pub threshold: f32,
    /// And above, this, from 0 to 1.
    pub value: f32,
    /// How colours are compared.
    pub flags: ReactiveFlags,
}

impl ReactiveMask {
    /// One for frames of that size: the length of the difference as it is.
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

/// Makes frames larger, from what each of them and those before show. Its struct is made once, and altered for each frame.
///
/// Threads: may be sent to another thread between calls; calls take turns. What it recorded must have run before it is dropped, and
/// of its frames at most four may be on their way to the device.
pub struct Upscaler {
    context: Context<CreateUpscale>,
    dispatch: Chain<DispatchUpscale>,
    /// What the library has of the frame before can be gone on with.
    follows: bool,
}

// SAFETY: its struct points to links of its own, to the library's context, which calls of one thread after the other may use, and to
// objects of Direct3D 12, which are free-threaded.
unsafe impl Send for Upscaler {}

impl Upscaler {
    /// Makes an upscaler, as [`Context::create`] makes its context.
    ///
    /// # Errors
    /// As of [`Context::create`].
    ///
    /// # Safety
    /// `device` is a live `ID3D12Device` and outlives the upscaler.
    pub unsafe fn create(api: &Api, device: *mut c_void, choice: Choice, head: CreateUpscale) -> Result<Self> {
        let head = CreateUpscale { message: head.message.or(Some(message::receive)), ..head };
        // SAFETY: the caller's promise; nothing that points stands in the chain but the callback, which stays.
        let context = unsafe { Context::create(api, device, choice, head, |chain| chain) }?;
        Ok(Self { context, dispatch: Chain::new(DispatchUpscale::default()), follows: false })
    }

    /// The size that a quality mode renders at for frames shown at `shown`.
    ///
    /// # Errors
    /// `InvalidArgument` for a size without a side; what the library answers.
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
        // SAFETY: no context, and places for the answers that live during the call.
        unsafe { api.query(null_mut(), &mut query) }.map_err(|failure| failure.error())?;
        let answer = Dimensions { width, height };
        match answer.fault() {
            Some(why) => Err(Error::new(ErrorKind::Device, format!("a render size of {width} x {height}: {why}"))),
            None => Ok(answer),
        }
    }

    /// How many jitters a sequence has for frames rendered and shown that wide.
    ///
    /// # Errors
    /// `InvalidArgument` for a width of 0; what the library answers.
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
        // SAFETY: no context, and a place for the answer that lives during the call.
        unsafe { api.query(null_mut(), &mut query) }.map_err(|failure| failure.error())?;
        u32::try_from(count)
            .ok()
            .filter(|count| *count > 0)
            .ok_or_else(|| Error::new(ErrorKind::Device, format!("a sequence of {count} jitters is none")))
    }

    /// The jitter of the frame `index` of a sequence of `phases`, in render pixels, inside half a pixel each way: what a camera's
    /// projection is moved by is `(2 x / width, -2 y / height)` of the size rendered at.
    ///
    /// # Errors
    /// `InvalidArgument` for a sequence of none; what the library answers.
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
        // SAFETY: no context, and places for the answers that live during the call.
        unsafe { api.query(null_mut(), &mut query) }.map_err(|failure| failure.error())?;
        let answer = Coordinates { x, y };
        if !(x.abs() <= 1.0 && y.abs() <= 1.0) {
            return Err(Error::new(ErrorKind::Device, format!("a jitter of {answer:?} is none")));
        }
        Ok(answer)
    }

    /// What runs.
    pub fn provider(&self) -> &Provider {
        self.context.provider()
    }

    /// What it was made with.
    pub fn made_with(&self) -> &CreateUpscale {
        self.context.made_with()
    }

    /// What the provider keeps on the device, as it reports it; None where it cannot say.
    ///
    /// # Errors
    /// What the library answers.
    pub fn memory(&mut self) -> Result<Option<MemoryUsage>> {
        self.context.memory()
    }

    /// The pictures that the provider must be given, and those that it can use besides. None where it cannot say: SDK 2.0 and later
    /// can.
    ///
    /// # Errors
    /// What the library answers.
    pub fn resources(&mut self) -> Result<Option<[UpscaleResources; 2]>> {
        let mut query = Chain::new(QueryUpscaleResources::default());
        // SAFETY: our own context; the answer is written into the chain.
        let known = super::memory::known(unsafe { self.context.ask(&mut query) })?;
        Ok(known.then(|| [query.head().required, query.head().optional]))
    }

    /// Records the larger frame into its list. The first frame, and one after a failure, starts anew as [`UpscaleShot::reset`] does.
    ///
    /// # Errors
    /// `InvalidArgument` with the field, before anything is recorded, for what a provider would fail, hang or crash on; else what the
    /// library answers, and then the list may hold a part of the work.
    ///
    /// # Safety
    /// The list is open and of the upscaler's device, and so are the resources, which are what they are said to be; they and the
    /// upscaler live until the list has run.
    pub unsafe fn record(&mut self, frame: &UpscaleFrame) -> Result<()> {
        if let Some((field, why)) = fault(frame, self.context.made_with()) {
            return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        }
        let shot = &frame.shot;
        *self.dispatch.head_mut() = DispatchUpscale {
            command_list: frame.command_list,
            color: frame.color,
            depth: frame.depth,
            motion: frame.motion,
            exposure: frame.exposure,
            reactive: frame.reactive,
            transparency: frame.transparency,
            output: frame.output,
            jitter: shot.jitter,
            motion_scale: shot.motion_scale,
            render_size: shot.render_size,
            upscale_size: shot.shown,
            sharpen: shot.sharpness.is_some(),
            sharpness: shot.sharpness.unwrap_or(0.0),
            frame_time: shot.frame_time,
            pre_exposure: shot.pre_exposure,
            reset: shot.reset || !self.follows,
            camera_near: shot.camera.near,
            camera_far: shot.camera.far,
            camera_fov: shot.camera.fov,
            metres: shot.camera.metres,
            flags: shot.encoding,
            ..Default::default()
        };
        self.follows = false;
        // SAFETY: the caller's promise about the list and the resources; the context is our own.
        unsafe { self.context.dispatch(&mut self.dispatch) }?;
        self.follows = true;
        Ok(())
    }

    /// Records where a frame's past is not to be trusted into `command_list`: a mask of the size rendered at, for
    /// [`UpscaleFrame::reactive`], from the frame `color` and the same without what is transparent.
    ///
    /// # Errors
    /// `InvalidArgument` with the field, before anything is recorded, for what a provider would fail on; else what the library answers.
    ///
    /// # Safety
    /// As of [`record`](Self::record).
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
        let (size, largest) = (mask.render_size, self.context.made_with().max_render_size);
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

    /// Lets the next frame start anew, as [`UpscaleShot::reset`] does.
    pub fn forget(&mut self) {
        self.follows = false;
    }
}

impl std::fmt::Debug for Upscaler {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Upscaler({})", self.provider().version)
    }
}

/// What is wrong with a frame for an upscaler that was made so: the field, and why.
fn fault(frame: &UpscaleFrame, made: &CreateUpscale) -> Option<(&'static str, &'static str)> {
    let shot = &frame.shot;
    if frame.command_list.is_null() {
        return Some(("command_list", "it is null"));
    }
    let has = |flag| made.flags.contains(flag);
    for (field, size, largest) in
        [("render_size", shot.render_size, made.max_render_size), ("shown", shot.shown, made.max_upscale_size)]
    {
        if let Some(why) = size.fault() {
            return Some((field, why));
        }
        if size.width > largest.width || size.height > largest.height {
            return Some((field, "it is larger than what the upscaler was made for"));
        }
    }
    let largest = made.max_render_size;
    let is_largest = (shot.render_size.width, shot.render_size.height) == (largest.width, largest.height);
    if !is_largest && !has(UpscaleCreateFlags::DYNAMIC_RESOLUTION) {
        return Some(("render_size", "the upscaler was not made for sizes that change"));
    }
    if shot.render_size.width > shot.shown.width || shot.render_size.height > shot.shown.height {
        return Some(("shown", "it is smaller than what was rendered"));
    }
    let motion = if has(UpscaleCreateFlags::DISPLAY_RESOLUTION_MOTION) { shot.shown } else { shot.render_size };
    for (field, resource, size) in [
        ("color", &frame.color, shot.render_size),
        ("depth", &frame.depth, shot.render_size),
        ("motion", &frame.motion, motion),
        ("output", &frame.output, shot.shown),
    ] {
        if let Some(why) = resource.fault(size) {
            return Some((field, why));
        }
    }
    let one = Dimensions { width: 1, height: 1 };
    for (field, resource, size) in [
        ("exposure", &frame.exposure, one),
        ("reactive", &frame.reactive, shot.render_size),
        ("transparency", &frame.transparency, shot.render_size),
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
    for (field, pair) in [("jitter", shot.jitter), ("motion_scale", shot.motion_scale)] {
        if !pair.x.is_finite() || !pair.y.is_finite() {
            return Some((field, "it must be finite"));
        }
    }
    if shot.sharpness.is_some_and(|sharpness| !(0.0..=1.0).contains(&sharpness)) {
        return Some(("sharpness", "it must be from 0 to 1"));
    }
    for (field, number) in [("frame_time", shot.frame_time), ("pre_exposure", shot.pre_exposure)] {
        if !(number.is_finite() && number > 0.0) {
            return Some((field, "it must be above 0"));
        }
    }
    let encodings = [UpscaleFlags::empty(), UpscaleFlags::COLOR_SRGB, UpscaleFlags::COLOR_PQ];
    if !encodings.contains(&shot.encoding) {
        return Some(("encoding", "it is none, sRGB or PQ"));
    }
    if shot.encoding.is_empty() == has(UpscaleCreateFlags::NON_LINEAR_COLOR) {
        return Some(("encoding", "it is not what the upscaler was made for"));
    }
    if shot.encoding == UpscaleFlags::COLOR_SRGB && has(UpscaleCreateFlags::HIGH_DYNAMIC_RANGE) {
        return Some(("encoding", "sRGB has no light of high dynamic range"));
    }
    shot.camera.fault(has(UpscaleCreateFlags::DEPTH_INFINITE))
}

#[cfg(test)]
mod tests;
