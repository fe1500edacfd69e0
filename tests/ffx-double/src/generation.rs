//! Checks the three calls of a generated frame: configure, prepare (motion and depth), generate. All three have the same frame id, which
//! goes up by one per frame.

use std::ffi::c_void;
use std::sync::Arc;

use windows::Win32::Graphics::Direct3D12::{
    D3D12_COMMAND_LIST_TYPE_COMPUTE, D3D12_COMMAND_LIST_TYPE_DIRECT, D3D12_RESOURCE_DIMENSION_TEXTURE2D,
    D3D12_RESOURCE_FLAG_ALLOW_DEPTH_STENCIL, D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET,
    D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, ID3D12GraphicsCommandList, ID3D12Resource,
};
use windows::core::{IUnknown, Interface};

use crate::config::Sdk;
use crate::field_access::get;
use crate::prepared_inputs::PrepareRequest;
use crate::shader_work::{self, CONSTANTS, Pictures, TextureArg};
use crate::swapchain::{FakeSwapchain, Settings, find_by_address};

/// Ids of the structs and of their extensions.
pub(crate) const CONFIGURE: u64 = 0x2_0002;
pub(crate) const PICTURE: u64 = 0x2_0003;
pub(crate) const PREPARE: u64 = 0x2_0004;
const DISTORTION: u64 = 0x2_0008;
const CAMERA: u64 = 0x2_000a;
pub(crate) const PREPARE_V2: u64 = 0x2_000c;

/// The flag for use without AMD's swap chain.
const NO_SWAPCHAIN: u32 = 8;

/// Creation flags of a context.
const ASYNC: u32 = 1;
const DISPLAY_RESOLUTION_MOTION: u32 = 2;
const MOTION_JITTER: u32 = 4;
const DEPTH_INVERTED: u32 = 8;
const DEPTH_INFINITE: u32 = 16;
const HIGH_DYNAMIC_RANGE: u32 = 32;

/// ffx-api formats with their DXGI formats: those that hosts use most.
const FORMATS: [(u32, i32); 9] =
    [(3, 2), (4, 10), (10, 28), (12, 29), (16, 26), (17, 24), (18, 34), (21, 54), (28, 41)];

/// Creation parameters of a context.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CreationParams {
    pub(crate) flags: u32,
    pub(crate) shown: [u32; 2],
    pub(crate) render: [u32; 2],
    pub(crate) format: u32,
    pub(crate) hudless: u32,
}

/// Whether AMD's providers compute distances from these planes. With infinite depth they take the lesser one for the near plane; with finite depth
/// they divide by the difference of this quotient from -1, in single precision, where depth is 1.
pub(crate) fn serve_as_planes(near: f32, far: f32, depth_is_infinite: bool) -> bool {
    let (least, largest) = (near.min(far), near.max(far));
    near != far && if depth_is_infinite { least == near } else { largest / (least - largest) != -1.0 }
}

impl CreationParams {
    /// The device memory that it reports, in bytes: 4 per display pixel and 8 per render pixel.
    pub(crate) fn memory(&self) -> u64 {
        let pixels = |size: [u32; 2]| u64::from(size[0]) * u64::from(size[1]);
        4 * pixels(self.shown) + 8 * pixels(self.render)
    }
}

/// State of a generator's context: the calls of the current frame and their parameters.
pub(crate) struct GeneratorState {
    made: CreationParams,
    /// Parameters of the configure call.
    hudless: Option<TextureArg>,
    distortion: Option<TextureArg>,
    rect: [i32; 4],
    is_async: bool,
    /// The double's swap chain that presents the frames, if there is one.
    presented_by: Option<Arc<FakeSwapchain>>,
    /// Parameters of the prepare call.
    prepare_params: Option<PrepareParams>,
    /// Copies of its motion and depth, once recorded.
    prepared_inputs: Option<[TextureArg; 2]>,
    /// The previous frame's jitter.
    jitter_before: [f32; 2],
    /// Ids of the current frame's configure and prepare calls, once made.
    settings: Option<u64>,
    prepared: Option<u64>,
    /// Id of the last generated picture.
    last: Option<u64>,
}

/// Parameters of a prepare call.
#[derive(Debug, Clone, Copy)]
struct PrepareParams {
    size: [u32; 2],
    jitter: [f32; 2],
    scale: [f32; 2],
    /// The reset flag, if the struct has one.
    reset: Option<u8>,
}

// SAFETY: addresses of the caller's objects, which are free-threaded.
unsafe impl Send for GeneratorState {}

/// A checked request for a picture: its command list, its textures and the shader's constants.
pub(crate) struct PictureRequest {
    pub(crate) list: *mut c_void,
    pub(crate) pictures: Pictures,
    pub(crate) constants: [u32; CONSTANTS],
}

/// A dispatch that passed the checks.
pub(crate) enum Request {
    Prepare(PrepareRequest),
    Picture(PictureRequest),
}

impl GeneratorState {
    pub(crate) fn new(made: CreationParams) -> Self {
        Self {
            made,
            hudless: None,
            distortion: None,
            rect: [0; 4],
            is_async: false,
            presented_by: None,
            prepare_params: None,
            prepared_inputs: None,
            jitter_before: [0.0; 2],
            settings: None,
            prepared: None,
            last: None,
        }
    }

    pub(crate) fn memory(&self) -> u64 {
        self.made.memory()
    }

    /// The swap chain that it generates for.
    pub(crate) fn presented_by(&self) -> Option<&Arc<FakeSwapchain>> {
        self.presented_by.as_ref()
    }

    /// Checks one call and reports violations to `fault`. Returns the work to record, if the call records some.
    ///
    /// # Safety
    /// A chain of structs whose types match their ids.
    pub(crate) unsafe fn check(
        &mut self,
        sdk: Sdk,
        context: usize,
        chain: &[(u64, *const u8)],
        fault: &mut dyn FnMut(String),
    ) -> Option<Request> {
        let (first, head) = chain[0];
        let may_follow = match first {
            CONFIGURE => &[DISTORTION][..],
            PREPARE => &[CAMERA][..],
            _ => &[],
        };
        let mut faults = 0;
        let fault = &mut |why| {
            faults += 1;
            fault(why);
        };
        for (link, _) in &chain[1..] {
            if !may_follow.contains(link) {
                fault(format!("{link:x} does not belong behind {first:x}"));
            }
        }
        let before = self.last;
        // SAFETY: the caller's promise; each function reads its own struct's offsets.
        unsafe {
            match first {
                CONFIGURE => self.settings(context, head, chain.get(1).map(|(_, at)| *at), fault),
                PREPARE | PREPARE_V2 => {
                    return self.prepare(head, first == PREPARE_V2, chain, sdk, fault).map(Request::Prepare);
                }
                _ => {
                    let request = self.picture(head, fault);
                    // A rejected call does not count as a frame.
                    if faults > 0 {
                        self.last = before;
                    }
                    return request.map(Request::Picture);
                }
            }
        }
        None
    }

    unsafe fn settings(
        &mut self,
        context: usize,
        head: *const u8,
        distortion: Option<*const u8>,
        fault: &mut dyn FnMut(String),
    ) {
        // SAFETY: fields of the struct.
        let (swapchain, flags, id) = unsafe { (get::<usize>(head, 16), get::<u32>(head, 112), get::<u64>(head, 136)) };
        // SAFETY: as above.
        let (callbacks, enabled) = unsafe { ([24, 40].map(|at| get::<usize>(head, at)), get::<u8>(head, 56)) };
        if swapchain != 0 {
            self.presented_by = find_by_address(swapchain);
            if self.presented_by.is_none() || flags != 0 || callbacks[0] != 0 || enabled > 1 {
                fault(format!("swapchain {swapchain:x}, flags {flags:x}, callbacks {callbacks:x?}, on {enabled}"));
            }
            // SAFETY: as above; null, or a function of that type.
            let (generate, user) = unsafe { (get(head, 40), get(head, 48)) };
            // SAFETY: as above.
            let rect = unsafe { [120, 124, 128, 132].map(|at| get(head, at)) };
            let settings = Settings { generate, user, enabled: enabled == 1, rect, frame: id, by: context };
            if let Some(why) = self.presented_by.as_ref().and_then(|swapchain| swapchain.apply(settings)) {
                fault(why);
            }
            if enabled == 0 {
                // A frame that was prepared but not presented leaves no history.
                (self.settings, self.prepared, self.hudless) = (None, None, None);
                return;
            }
        } else if flags != NO_SWAPCHAIN || callbacks != [0; 2] || self.presented_by.is_some() {
            fault(format!("swapchain {swapchain:x}, flags {flags:x}, callbacks {callbacks:x?}"));
        }
        if enabled != 1 {
            fault("generation is off".to_owned());
        }
        // SAFETY: as above.
        let (is_async, only_generated) = unsafe { (get::<u8>(head, 57), get::<u8>(head, 116)) };
        if (is_async != 0) != (self.made.flags & ASYNC != 0) || only_generated != 0 {
            fault(format!(
                "asynchronous {is_async} of a context with flags {}, only generated {only_generated}",
                self.made.flags
            ));
        }
        self.is_async = is_async != 0;
        // SAFETY: as above.
        self.rect = unsafe { [120, 124, 128, 132].map(|at| get(head, at)) };
        let [left, top, width, height] = self.rect.map(i64::from);
        let [columns, rows] = self.made.shown.map(i64::from);
        if left < 0 || top < 0 || width < 0 || height < 0 || left + width > columns || top + height > rows {
            fault(format!("the part {:?} of {:?}", self.rect, self.made.shown));
        }
        // SAFETY: as above; the struct has a resource there, which may be null.
        self.hudless = unsafe { texture_arg(head, 64) };
        if self.hudless.is_some() {
            let mut fault = |why| fault(format!("without interface: {why}"));
            // SAFETY: as above.
            unsafe { check_resource(head, 64, self.made.shown, Some(self.made.hudless), false, &mut fault) };
        }
        // AMD's libraries forget the distortion field at each configure call.
        self.distortion = None;
        if let Some(link) = distortion {
            let mut fault = |why| fault(format!("distortion: {why}"));
            // SAFETY: the struct has a resource there.
            unsafe {
                check_resource(link, 16, self.made.shown, None, false, &mut fault);
                self.distortion = texture_arg(link, 16);
            }
        }
        (self.settings, self.prepared) = (Some(id), None);
    }

    unsafe fn prepare(
        &mut self,
        head: *const u8,
        is_v2: bool,
        chain: &[(u64, *const u8)],
        sdk: Sdk,
        fault: &mut dyn FnMut(String),
    ) -> Option<PrepareRequest> {
        if is_v2 != (sdk >= Sdk::V21) {
            fault(format!("motion and depth are told as another release than {sdk:?} wants"));
        }
        // SAFETY: fields that both structs have at the same offsets.
        let (id, list, size) =
            unsafe { (get::<u64>(head, 16), get::<*mut c_void>(head, 32), [40, 44].map(|at| get::<u32>(head, at))) };
        if self.settings != Some(id) {
            fault(format!("motion and depth of frame {id} after settings of {:?}", self.settings));
        }
        // SAFETY: the caller's list.
        unsafe { check_list(list, self.is_async, fault) };
        if size[0] == 0 || size[1] == 0 || size[0] > self.made.render[0] || size[1] > self.made.render[1] {
            fault(format!("render size {size:?} of {:?}", self.made.render));
        }
        // SAFETY: as above.
        let (flags, reset) = unsafe { (get::<u32>(head, 24), get::<u8>(head, 68)) };
        let wanted = if self.presented_by.is_some() { 0 } else { NO_SWAPCHAIN };
        if flags != wanted || (!is_v2 && reset != 0) {
            fault(format!("flags {flags:x}, reset {reset}"));
        }
        // SAFETY: as above.
        let numbers = unsafe { [48, 52, 56, 60, 64, 72, 76, 80, 84].map(|at| get::<f32>(head, at)) };
        let [.., time, near, far, fov, metres] = numbers;
        let above_0 = [time, near, far, fov, metres].into_iter().all(|number| number > 0.0 && number.is_finite());
        let is_finite = numbers[..4].iter().all(|number| number.is_finite());
        let are_planes = serve_as_planes(near, far, self.made.flags & DEPTH_INFINITE != 0);
        if !is_finite || !above_0 || !are_planes || fov >= std::f32::consts::PI {
            fault(format!("jitter, scale, time and camera {numbers:?}"));
        }
        let of_motion = if self.made.flags & DISPLAY_RESOLUTION_MOTION != 0 { self.made.shown } else { size };
        for (name, at, size) in [("depth", 88, size), ("motion", 136, of_motion)] {
            // SAFETY: the struct has a resource there.
            unsafe { check_resource(head, at, size, None, false, &mut |why| fault(format!("{name}: {why}"))) };
        }
        let camera = if is_v2 { Some((head, 184)) } else { chain.get(1).map(|(_, at)| (*at, 16)) };
        match camera {
            Some((pointer, at)) => {
                // SAFETY: the struct has four vectors of three floats there.
                let [position, up, right, forward] = [0, 12, 24, 36]
                    .map(|vector| [0, 4, 8].map(|axis| unsafe { get::<f32>(pointer, at + vector + axis) }));
                if !position.iter().all(|x| x.is_finite()) {
                    fault(format!("the camera is at {position:?}"));
                }
                let dot = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f32>();
                for (a, b, wanted) in [
                    (up, up, 1.0),
                    (right, right, 1.0),
                    (forward, forward, 1.0),
                    (up, right, 0.0),
                    (right, forward, 0.0),
                    (forward, up, 0.0),
                ] {
                    let found = dot(a, b);
                    if (found - wanted).abs().partial_cmp(&0.02).is_none_or(|order| order.is_gt()) {
                        fault(format!("the product of {a:?} and {b:?} of the camera is {found}"));
                    }
                }
            }
            None => fault("there is no camera".to_owned()),
        }
        // SAFETY: as above.
        let pictures = unsafe { [88, 136].map(|at| texture_arg(head, at)) };
        (self.prepared, self.prepared_inputs) = (Some(id), None);
        let [Some(depth), Some(motion)] = pictures else { return None };
        let [a, b, c, d, ..] = numbers;
        let reset = is_v2.then_some(reset);
        self.jitter_before = self.prepare_params.map_or([0.0; 2], |prepare_params| prepare_params.jitter);
        self.prepare_params = Some(PrepareParams { size, jitter: [a, b], scale: [c, d], reset });
        Some(PrepareRequest { list, motion, depth })
    }

    /// Sets the recorded copies of motion and depth.
    pub(crate) fn set_prepared_inputs(&mut self, inputs: [TextureArg; 2]) {
        self.prepared_inputs = Some(inputs);
    }

    unsafe fn picture(&mut self, head: *const u8, fault: &mut dyn FnMut(String)) -> Option<PictureRequest> {
        // SAFETY: fields of the struct.
        let (list, frames, reset, id) = unsafe {
            (get::<*mut c_void>(head, 16), get::<u32>(head, 264), get::<u8>(head, 268), get::<u64>(head, 304))
        };
        // SAFETY: the caller's list.
        unsafe { check_list(list, self.is_async, fault) };
        if [self.settings, self.prepared] != [Some(id); 2] {
            fault(format!("a picture of frame {id} after {:?} and {:?}", self.settings, self.prepared));
        }
        if frames != 1 || reset > 1 || (self.last.is_none() && reset == 0) {
            fault(format!("{frames} frames, reset {reset} after {:?}", self.last));
        }
        // A frame whose list was not submitted may be generated again; AMD's swap chain submits every list.
        if self.presented_by.is_some() && self.last == Some(id) {
            fault(format!("frame {id} is generated again, unprepared"));
        }
        // AMD's libraries drop the history at any other id, so a host that does not ask for that has lost count. Where AMD's swap chain presents,
        // it generates no frame for some ids.
        if reset == 0 && self.presented_by.is_none() && self.last.is_some_and(|last| id != last.wrapping_add(1)) {
            fault(format!("frame {id} follows {:?} without a reset", self.last));
        }
        if let Some(prepared) = self.prepare_params.and_then(|prepare_params| prepare_params.reset)
            && prepared != reset
        {
            fault(format!("reset {reset}, and {prepared} with motion and depth"));
        }
        for (name, at, is_written) in [("color", 24, false), ("output", 72, true)] {
            let mut fault = |why| fault(format!("{name}: {why}"));
            // SAFETY: the struct has a resource there.
            unsafe { check_resource(head, at, self.made.shown, Some(self.made.format), is_written, &mut fault) };
        }
        // SAFETY: the struct has three more outputs behind the first.
        if [120, 168, 216].iter().any(|of| (0..44).step_by(4).any(|at| unsafe { get::<u32>(head, of + at) } != 0)) {
            fault("more outputs than frames".to_owned());
        }
        // SAFETY: fields of the struct.
        let (transfer, luminance, rect) = unsafe {
            (
                get::<u32>(head, 272),
                [276, 280].map(|at| get::<f32>(head, at)),
                [284, 288, 292, 296].map(|at| get::<i32>(head, at)),
            )
        };
        if rect != self.rect {
            fault(format!("the part {rect:?} after settings of {:?}", self.rect));
        }
        let is_hdr = self.made.flags & HIGH_DYNAMIC_RANGE != 0;
        let goes_up = luminance[0] >= 0.0 && luminance[1] > luminance[0];
        if transfer > 2 || (transfer != 0 && !(is_hdr && goes_up)) {
            fault(format!("transfer function {transfer}, luminance {luminance:?}, flags {}", self.made.flags));
        }
        self.last = Some(id);
        // SAFETY: the struct has resources there.
        let (shown, output) = unsafe { (texture_arg(head, 24)?, texture_arg(head, 72)?) };
        let (prepare_params, [motion, depth]) = (self.prepare_params?, self.prepared_inputs?);
        // Missing textures are replaced by others, which the shader does not read.
        let source = self.hudless.unwrap_or(shown);
        let inputs = [shown, source, shown, motion, depth, self.distortion.unwrap_or(motion), shown];
        let pictures = Pictures { inputs, motion: 3, output, kept: Some(1) };
        let [left, top, width, height] = rect;
        let [columns, rows] = self.made.shown.map(u32::cast_signed);
        let (right, bottom) = (left.saturating_add(width), top.saturating_add(height));
        let part = if width == 0 { [0, 0, columns, rows] } else { [left, top, right, bottom] };
        // Motion contains the previous jitter minus this one, which AMD's libraries subtract.
        let [before, now] = [self.jitter_before, prepare_params.jitter];
        let has_jitter = self.made.flags & MOTION_JITTER != 0;
        let jitter = if has_jitter { [before[0] - now[0], before[1] - now[1]] } else { [0.0; 2] };
        let flags: u32 = [
            (reset != 0, shader_work::RESET),
            (self.hudless.is_some(), shader_work::HUDLESS),
            (self.distortion.is_some(), shader_work::DISTORTED),
            (self.made.flags & DEPTH_INVERTED != 0, shader_work::INVERTED),
        ]
        .into_iter()
        .map(|(is_set, flag)| if is_set { flag } else { 0 })
        .sum();
        let mut constants = [0; CONSTANTS];
        let words = self
            .made
            .shown
            .into_iter()
            .chain(prepare_params.size)
            .chain([0; 2])
            .chain(prepare_params.scale.map(f32::to_bits));
        let words = words.chain(part.map(i32::cast_unsigned)).chain(jitter.map(f32::to_bits));
        let words = words.chain(luminance.map(f32::to_bits)).chain([transfer, flags, 0]);
        constants.iter_mut().zip(words).for_each(|(pointer, word)| *pointer = word);
        Some(PictureRequest { list, pictures, constants })
    }
}

/// The resource at an offset, with its state; None if it is null.
pub(crate) unsafe fn texture_arg(head: *const u8, at: usize) -> Option<TextureArg> {
    // SAFETY: the struct has a resource there, by the caller's promise.
    let (pointer, state) = unsafe { (get::<*mut c_void>(head, at), get::<u32>(head, at + 40)) };
    (!pointer.is_null()).then_some(TextureArg { pointer, state })
}

/// Checks that generation can be recorded into the list.
pub(crate) unsafe fn check_list(list: *mut c_void, is_async: bool, fault: &mut dyn FnMut(String)) {
    // SAFETY: null or an object of COM, by the caller's promise.
    let object = unsafe { IUnknown::from_raw_borrowed(&list) };
    let Some(list) = object.and_then(|object| object.cast::<ID3D12GraphicsCommandList>().ok()) else {
        return fault("there is no command list".to_owned());
    };
    // SAFETY: a live list.
    let kind = unsafe { list.GetType() };
    if ![D3D12_COMMAND_LIST_TYPE_DIRECT, D3D12_COMMAND_LIST_TYPE_COMPUTE].contains(&kind) {
        fault(format!("a list of type {}", kind.0));
    }
    if kind == D3D12_COMMAND_LIST_TYPE_COMPUTE && !is_async {
        fault("a list of a compute queue, which was not told before".to_owned());
    }
}

/// Checks a texture argument: the object must match its description and have a valid state.
pub(crate) unsafe fn check_resource(
    head: *const u8,
    at: usize,
    size: [u32; 2],
    format: Option<u32>,
    is_written: bool,
    fault: &mut dyn FnMut(String),
) {
    // SAFETY: the struct has a resource there.
    let (pointer, words) =
        unsafe { (get::<*mut c_void>(head, at), [8, 12, 16, 20, 24, 28, 32, 36].map(|of| get::<u32>(head, at + of))) };
    // SAFETY: as above; null or an object of COM, by the caller's promise.
    let (state, object) = unsafe { (get::<u32>(head, at + 40), IUnknown::from_raw_borrowed(&pointer)) };
    let Some(resource) = object.and_then(|object| object.cast::<ID3D12Resource>().ok()) else {
        return fault("there is no resource".to_owned());
    };
    // SAFETY: a live resource.
    let real = unsafe { resource.GetDesc() };
    let stated = [words[2], words[3]];
    if words[0] != 2 || real.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D {
        fault(format!("it is told to be of shape {}", words[0]));
    }
    if stated != size || [real.Width, real.Height.into()] != size.map(u64::from) {
        fault(format!("{} x {}, told {stated:?}, wanted {size:?}", real.Width, real.Height));
    }
    let uses = [
        (D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET, 1),
        (D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, 2),
        (D3D12_RESOURCE_FLAG_ALLOW_DEPTH_STENCIL, 4),
    ];
    let usage = uses.iter().map(|(flag, usage)| if real.Flags.contains(*flag) { *usage } else { 0 }).sum::<u32>();
    if words[4..] != [real.DepthOrArraySize.into(), real.MipLevels.into(), 0, usage] {
        fault(format!("layers, levels, flags and uses {:?}", &words[4..]));
    }
    let real_format = FORMATS.iter().find(|(_, dxgi)| *dxgi == real.Format.0).map(|(format, _)| *format);
    if real_format.is_some_and(|format| format != words[1]) {
        fault(format!("format {} of DXGI format {}", words[1], real.Format.0));
    }
    if words[1] == 0 || format.is_some_and(|format| format != words[1]) {
        fault(format!("format {}, wanted {format:?}", words[1]));
    }
    if ![1, 2, 4, 8, 12, 16, 20, 32, 64, 128, 256, 512].contains(&state) {
        fault(format!("state {state}"));
    }
    if is_written && !real.Flags.contains(D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS) {
        fault("shaders cannot write it".to_owned());
    }
}
