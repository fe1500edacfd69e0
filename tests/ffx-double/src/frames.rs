//! The three calls of a frame, judged: settings, then motion and depth, then the picture, with one id that goes up by one.

use std::ffi::c_void;

use windows::Win32::Graphics::Direct3D12::{
    D3D12_COMMAND_LIST_TYPE_COMPUTE, D3D12_COMMAND_LIST_TYPE_DIRECT, D3D12_RESOURCE_DIMENSION_TEXTURE2D,
    D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, ID3D12GraphicsCommandList, ID3D12Resource,
};
use windows::core::{IUnknown, Interface};

use crate::memory::get;
use crate::role::Sdk;

/// Ids of the structs, and of those that may follow them.
pub(crate) const CONFIGURE: u64 = 0x2_0002;
pub(crate) const PICTURE: u64 = 0x2_0003;
pub(crate) const PREPARE: u64 = 0x2_0004;
const DISTORTION: u64 = 0x2_0008;
const CAMERA: u64 = 0x2_000a;
pub(crate) const PREPARE_V2: u64 = 0x2_000c;

/// No swapchain of AMD's is told.
const NO_SWAPCHAIN: u32 = 8;

/// What a context was made for, and where in a frame it is.
#[derive(Debug, Clone)]
pub(crate) struct Frames {
    shown: [u32; 2],
    render: [u32; 2],
    format: u32,
    /// What was called of the present frame, with its id.
    settings: Option<u64>,
    prepared: Option<u64>,
    /// Of the last picture.
    last: Option<u64>,
}

impl Frames {
    /// Of a context for pictures of that size and format, rendered at most so large.
    pub(crate) fn new(shown: [u32; 2], render: [u32; 2], format: u32) -> Self {
        Self { shown, render, format, settings: None, prepared: None, last: None }
    }

    /// Judges one call; faults go to `fault`.
    ///
    /// # Safety
    /// A chain of structs that are what their ids say.
    pub(crate) unsafe fn judge(&mut self, sdk: Sdk, chain: &[(u64, *const u8)], fault: &mut dyn FnMut(String)) {
        let (first, head) = chain[0];
        let may_follow = match first {
            CONFIGURE => &[DISTORTION][..],
            PREPARE => &[CAMERA][..],
            _ => &[],
        };
        for (link, _) in &chain[1..] {
            if !may_follow.contains(link) {
                fault(format!("{link:x} does not belong behind {first:x}"));
            }
        }
        // SAFETY: the caller's promise; each reads at its own struct's offsets.
        unsafe {
            match first {
                CONFIGURE => self.settings(head, fault),
                PREPARE | PREPARE_V2 => self.prepare(head, first == PREPARE_V2, chain, sdk, fault),
                _ => self.picture(head, fault),
            }
        }
    }

    unsafe fn settings(&mut self, head: *const u8, fault: &mut dyn FnMut(String)) {
        // SAFETY: fields of the struct.
        let (swapchain, flags, id) = unsafe { (get::<usize>(head, 16), get::<u32>(head, 112), get::<u64>(head, 136)) };
        // SAFETY: as above.
        let (callbacks, enabled) = unsafe { ([24, 40].map(|at| get::<usize>(head, at)), get::<u8>(head, 56)) };
        if swapchain != 0 || flags != NO_SWAPCHAIN || callbacks != [0; 2] {
            fault(format!("swapchain {swapchain:x}, flags {flags:x}, callbacks {callbacks:x?}"));
        }
        if enabled != 1 {
            fault("generation is off".to_owned());
        }
        if self.last.is_some_and(|last| id != last + 1) {
            fault(format!("frame {id} follows {:?}", self.last));
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
    ) {
        if is_v2 != (sdk >= Sdk::V21) {
            fault(format!("motion and depth are told as another release than {sdk:?} wants"));
        }
        // SAFETY: fields that both structs have at the same places.
        let (id, list, size) =
            unsafe { (get::<u64>(head, 16), get::<*mut c_void>(head, 32), [40, 44].map(|at| get::<u32>(head, at))) };
        if self.settings != Some(id) {
            fault(format!("motion and depth of frame {id} after settings of {:?}", self.settings));
        }
        // SAFETY: the caller's list.
        unsafe { judge_list(list, fault) };
        if size[0] == 0 || size[1] == 0 || size[0] > self.render[0] || size[1] > self.render[1] {
            fault(format!("render size {size:?} of {:?}", self.render));
        }
        // SAFETY: as above.
        let numbers = unsafe { [48, 52, 56, 60, 64, 72, 76, 80, 84].map(|at| get::<f32>(head, at)) };
        if !numbers.iter().all(|number| number.is_finite()) || numbers[4] <= 0.0 || numbers[7] <= 0.0 {
            fault(format!("jitter, scale, time and camera {numbers:?}"));
        }
        for (name, at) in [("depth", 88), ("motion", 136)] {
            // SAFETY: a resource stands there.
            unsafe { judge_resource(head, at, size, None, false, &mut |why| fault(format!("{name}: {why}"))) };
        }
        let camera = if is_v2 { Some((head, 184)) } else { chain.get(1).map(|(_, at)| (*at, 16)) };
        match camera {
            Some((place, at)) => {
                for vector in 1..4 {
                    // SAFETY: four vectors of three stand there.
                    let v = [0, 4, 8].map(|axis| unsafe { get::<f32>(place, at + 12 * vector + axis) });
                    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
                    if (length - 1.0).abs() > 0.01 {
                        fault(format!("a vector of the camera is {length} long"));
                    }
                }
            }
            None => fault("there is no camera".to_owned()),
        }
        self.prepared = Some(id);
    }

    unsafe fn picture(&mut self, head: *const u8, fault: &mut dyn FnMut(String)) {
        // SAFETY: fields of the struct.
        let (list, frames, reset, id) = unsafe {
            (get::<*mut c_void>(head, 16), get::<u32>(head, 264), get::<u8>(head, 268), get::<u64>(head, 304))
        };
        // SAFETY: the caller's list.
        unsafe { judge_list(list, fault) };
        if [self.settings, self.prepared] != [Some(id); 2] {
            fault(format!("a picture of frame {id} after {:?} and {:?}", self.settings, self.prepared));
        }
        if frames != 1 || reset > 1 || (self.last.is_none() && reset == 0) {
            fault(format!("{frames} frames, reset {reset} after {:?}", self.last));
        }
        for (name, at, is_written) in [("color", 24, false), ("output", 72, true)] {
            let mut fault = |why| fault(format!("{name}: {why}"));
            // SAFETY: a resource stands there.
            unsafe { judge_resource(head, at, self.shown, Some(self.format), is_written, &mut fault) };
        }
        // SAFETY: three more outputs stand behind the first.
        if [120, 168, 216].iter().any(|at| unsafe { get::<usize>(head, *at) } != 0) {
            fault("more outputs than frames".to_owned());
        }
        self.last = Some(id);
    }
}

/// A list that generation can be recorded into.
unsafe fn judge_list(list: *mut c_void, fault: &mut dyn FnMut(String)) {
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
}

/// A picture: an object that is what its description says, in a state that there is.
unsafe fn judge_resource(
    head: *const u8,
    at: usize,
    size: [u32; 2],
    format: Option<u32>,
    is_written: bool,
    fault: &mut dyn FnMut(String),
) {
    // SAFETY: the fields of a resource stand there.
    let (place, words) = unsafe { (get::<*mut c_void>(head, at), [8, 12, 16, 20].map(|of| get::<u32>(head, at + of))) };
    // SAFETY: as above; null or an object of COM, by the caller's promise.
    let (state, object) = unsafe { (get::<u32>(head, at + 40), IUnknown::from_raw_borrowed(&place)) };
    let Some(resource) = object.and_then(|object| object.cast::<ID3D12Resource>().ok()) else {
        return fault("there is no resource".to_owned());
    };
    // SAFETY: a live resource.
    let real = unsafe { resource.GetDesc() };
    let told = [words[2], words[3]];
    if words[0] != 2 || real.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D {
        fault(format!("it is told to be of shape {}", words[0]));
    }
    if told != size || [real.Width, real.Height.into()] != size.map(u64::from) {
        fault(format!("{} x {}, told {told:?}, wanted {size:?}", real.Width, real.Height));
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
