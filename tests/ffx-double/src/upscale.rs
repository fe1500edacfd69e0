//! Checks an upscaling call and its parameters.

use std::ffi::c_void;

use crate::field_access::get;
use crate::generation::{PictureRequest, check_list, check_resource, serve_as_planes, texture_arg};
use crate::shader_work::{CONSTANTS, Pictures, TextureArg};

/// The struct's id.
pub(crate) const UPSCALE: u64 = 0x1_0001;
/// The id of the struct for a reactive mask.
pub(crate) const MASK: u64 = 0x1_0006;

/// Creation flags of a context.
const HIGH_DYNAMIC_RANGE: u32 = 1;
const DISPLAY_RESOLUTION_MOTION: u32 = 2;
const MOTION_JITTER: u32 = 4;
const DEPTH_INVERTED: u32 = 8;
const DEPTH_INFINITE: u32 = 16;
const AUTO_EXPOSURE: u32 = 32;
const DYNAMIC_RESOLUTION: u32 = 64;
const NON_LINEAR: u32 = 256;

/// Flags of a frame.
const OF_SRGB: u32 = 2;
const OF_PQ: u32 = 4;

/// Flags of the shader.
const RESET: u32 = 1;
const EXPOSED: u32 = 2;
const REACTIVE: u32 = 4;
const TRANSPARENT: u32 = 8;
const INVERTED: u32 = 16;
const SRGB: u32 = 32;
const PQ: u32 = 64;
const JITTERED: u32 = 128;

/// Creation parameters and state of an upscaler's context.
#[derive(Debug)]
pub(crate) struct UpscalerState {
    pub(crate) flags: u32,
    pub(crate) render: [u32; 2],
    pub(crate) shown: [u32; 2],
    /// There is history.
    pub(crate) follows: bool,
    /// The previous frame's jitter.
    pub(crate) jitter: [f32; 2],
}

impl UpscalerState {
    /// The device memory that it reports, in bytes.
    pub(crate) fn memory(render: [u32; 2], shown: [u32; 2]) -> u64 {
        let pixels = |size: [u32; 2]| u64::from(size[0]) * u64::from(size[1]);
        16 * pixels(shown) + 8 * pixels(render)
    }

    /// Checks one call and reports violations to `fault`. Returns the work to record; its constants lack the size of motion.
    ///
    /// # Safety
    /// A struct of the type that its id says, alone in its chain.
    pub(crate) unsafe fn check(&mut self, head: *const u8, fault: &mut dyn FnMut(String)) -> Option<PictureRequest> {
        let has = |flag| self.flags & flag != 0;
        // SAFETY: fields of the struct, here and below.
        let (list, render, shown) = unsafe {
            (
                get::<*mut c_void>(head, 16),
                [376, 380].map(|at| get::<u32>(head, at)),
                [384, 388].map(|at| get::<u32>(head, at)),
            )
        };
        // SAFETY: the caller's list.
        unsafe { check_list(list, true, fault) };
        let shown = if shown == [0; 2] { self.shown } else { shown };
        for (name, size, largest) in [("render", render, self.render), ("upscale", shown, self.shown)] {
            if size.contains(&0) || size[0] > largest[0] || size[1] > largest[1] {
                fault(format!("{name} size {size:?} of {largest:?}"));
            }
        }
        if render != self.render && !has(DYNAMIC_RESOLUTION) {
            fault(format!("rendered at {render:?}, where sizes do not change"));
        }
        let of_motion = if has(DISPLAY_RESOLUTION_MOTION) { shown } else { render };
        for (name, at, size, is_needed, is_written) in [
            ("color", 24, render, true, false),
            ("depth", 72, render, true, false),
            ("motion", 120, of_motion, true, false),
            ("exposure", 168, [1, 1], false, false),
            ("reactive", 216, render, false, false),
            ("transparency", 264, render, false, false),
            ("output", 312, shown, true, true),
        ] {
            // SAFETY: the struct has a resource there.
            unsafe {
                if is_needed || get::<usize>(head, at) != 0 {
                    check_resource(head, at, size, None, is_written, &mut |why| fault(format!("{name}: {why}")));
                } else if (0..44).step_by(4).any(|of| get::<u32>(head, at + of) != 0) {
                    fault(format!("{name}: a description of nothing"));
                }
            }
        }
        // SAFETY: as above.
        let pictures = unsafe { [24, 72, 120, 168, 216, 264, 312].map(|at| texture_arg(head, at)) };
        if has(AUTO_EXPOSURE) && pictures[3].is_some() {
            fault("exposure is told and is to be found".to_owned());
        }
        // SAFETY: as above.
        let (pairs, numbers) = unsafe {
            (
                [360, 364, 368, 372].map(|at| get::<f32>(head, at)),
                [400, 404, 412, 416, 420, 424].map(|at| get::<f32>(head, at)),
            )
        };
        // SAFETY: as above.
        let (sharpen, sharpness, reset, flags) =
            unsafe { (get::<u8>(head, 392), get::<f32>(head, 396), get::<u8>(head, 408), get::<u32>(head, 428)) };
        let [_, exposure, near, far, fov, _] = numbers;
        let is_above_0 = |number: &f32| number.is_finite() && *number > 0.0;
        let are_planes = serve_as_planes(near, far, has(DEPTH_INFINITE));
        if !numbers.iter().all(is_above_0) || !are_planes || fov >= std::f32::consts::PI {
            fault(format!("time, exposure and camera {numbers:?}"));
        }
        if !pairs.iter().all(|number| number.is_finite()) {
            fault(format!("jitter and scale {pairs:?}"));
        }
        if sharpen > 1 || !(0.0..=1.0).contains(&sharpness) || (sharpen == 0 && sharpness != 0.0) {
            fault(format!("sharpening {sharpen}, {sharpness}"));
        }
        if reset > 1 || (reset == 0 && !self.follows) {
            fault(format!("reset {reset}, follows {}", self.follows));
        }
        // sRGB cannot encode light brighter than white.
        let is_of_both = flags == OF_SRGB && has(HIGH_DYNAMIC_RANGE);
        if ![0, OF_SRGB, OF_PQ].contains(&flags) || (flags != 0) != has(NON_LINEAR) || is_of_both {
            fault(format!("flags {flags} of a context with {}", self.flags));
        }
        let [color, depth, motion, exposed, reactive, transparent, output] = pictures;
        let (color, depth, motion, output): (TextureArg, TextureArg, TextureArg, TextureArg) =
            (color?, depth?, motion?, output?);
        let inputs = [
            color,
            exposed.unwrap_or(depth),
            color,
            motion,
            depth,
            reactive.unwrap_or(depth),
            transparent.unwrap_or(depth),
        ];
        let flags: u32 = [
            (reset != 0, RESET),
            (exposed.is_some(), EXPOSED),
            (reactive.is_some(), REACTIVE),
            (transparent.is_some(), TRANSPARENT),
            (has(DEPTH_INVERTED), INVERTED),
            (flags == OF_SRGB, SRGB),
            (flags == OF_PQ, PQ),
            (has(MOTION_JITTER), JITTERED),
        ]
        .into_iter()
        .map(|(is_set, flag)| if is_set { flag } else { 0 })
        .sum();
        // Motion contains the previous jitter minus this one, which AMD's libraries subtract.
        let now = [pairs[0], pairs[1]];
        let held = std::mem::replace(&mut self.jitter, now);
        let [held_x, held_y] = [held[0] - now[0], held[1] - now[1]].map(f32::to_bits);
        let [jitter_x, jitter_y, scale_x, scale_y] = pairs.map(f32::to_bits);
        let words = [
            shown[0],
            shown[1],
            render[0],
            render[1],
            0,
            0,
            scale_x,
            scale_y,
            jitter_x,
            jitter_y,
            sharpness.to_bits(),
            exposure.to_bits(),
            flags,
            held_x,
            held_y,
        ];
        let mut constants = [0; CONSTANTS];
        constants[..words.len()].copy_from_slice(&words);
        Some(PictureRequest { list, pictures: Pictures { inputs, motion: 3, output, kept: None }, constants })
    }
}

impl UpscalerState {
    /// Checks a call for a reactive mask, as [`check`](Self::check) checks one for an upscaled frame.
    ///
    /// # Safety
    /// A struct of the type that its id says, alone in its chain.
    pub(crate) unsafe fn check_mask(
        &mut self,
        head: *const u8,
        fault: &mut dyn FnMut(String),
    ) -> Option<PictureRequest> {
        // SAFETY: fields of the struct, here and below.
        let (list, size) = unsafe { (get::<*mut c_void>(head, 16), [168, 172].map(|at| get::<u32>(head, at))) };
        // SAFETY: the caller's list.
        unsafe { check_list(list, true, fault) };
        if size.contains(&0) || size[0] > self.render[0] || size[1] > self.render[1] {
            fault(format!("a mask of {size:?} for frames of {:?}", self.render));
        }
        for (name, at, is_written) in [("opaque", 24, false), ("color", 72, false), ("mask", 120, true)] {
            // SAFETY: the struct has a resource there.
            unsafe { check_resource(head, at, size, None, is_written, &mut |why| fault(format!("{name}: {why}"))) };
        }
        // SAFETY: as above.
        let (numbers, flags) = unsafe { ([176, 180, 184].map(|at| get::<f32>(head, at)), get::<u32>(head, 188)) };
        let [scale, threshold, value] = numbers;
        let in_range = scale.is_finite() && scale >= 0.0 && [threshold, value].iter().all(|n| (0.0..=1.0).contains(n));
        if !in_range || flags > 15 {
            fault(format!("scale, threshold and value {numbers:?}, flags {flags}"));
        }
        // SAFETY: as above.
        let [opaque, color, output] = unsafe { [24, 72, 120].map(|at| texture_arg(head, at)) };
        let (opaque, color, output): (TextureArg, TextureArg, TextureArg) = (opaque?, color?, output?);
        let inputs = [opaque, color, color, color, color, color, color];
        let mut constants = [0; CONSTANTS];
        let words =
            [size[0], size[1], size[0], size[1], 0, 0, scale.to_bits(), threshold.to_bits(), value.to_bits(), flags];
        constants[..words.len()].copy_from_slice(&words);
        Some(PictureRequest { list, pictures: Pictures { inputs, motion: 3, output, kept: None }, constants })
    }
}

/// The render size of a quality mode.
pub(crate) fn render_size(shown: [u32; 2], mode: u32) -> Option<[u32; 2]> {
    let ratio = [1.0, 1.5, 1.7, 2.0, 3.0_f32].get(mode as usize)?;
    Some(shown.map(|side| (side as f32 / ratio) as u32))
}

/// The jitter of a sequence: Halton numbers of bases 2 and 3, minus 0.5.
pub(crate) fn jitter(index: i32, count: i32) -> Option<[f32; 2]> {
    let index = u32::try_from(index).ok()?.checked_rem(u32::try_from(count).ok()?)? + 1;
    Some([2, 3].map(|base: u32| {
        let (mut left, mut part, mut sum) = (index, 1.0, 0.0_f32);
        while left > 0 {
            part /= base as f32;
            sum += part * (left % base) as f32;
            left /= base;
        }
        sum - 0.5
    }))
}
