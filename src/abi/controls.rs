//! The player's controls in one latent step.

use super::results::AbiResult;
use super::structs::{describe, read};
use crate::world::{ControlInput, KeySet};

/// Controls of one latent step. All zero: nothing moves, no key is held.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_controls {
    /// sizeof(cairn_controls)
    pub struct_size: u32,
    /// Horizontal mouse motion in raw counts, summed over the step, right positive; -32768 to 32768.
    pub mouse_dx: f32,
    /// Vertical mouse motion, down positive; otherwise as mouse_dx.
    pub mouse_dy: f32,
    /// Wheel motion, up positive; any finite number. Only its sign counts.
    pub scroll: f32,
    /// Keys and mouse buttons held at any time during the step, by Windows virtual-key code: bit code % 64 of word code / 64.
    /// W is 0x57: bit 23 of the second word.
    pub keys: [u64; 4],
}
describe!(cairn_controls, [], { struct_size, mouse_dx, mouse_dy, scroll, keys });

/// Reads and checks the host's controls.
///
/// # Safety
/// `from` is null or points to a readable struct.
pub(super) unsafe fn read_controls(from: *const cairn_controls, name: &str) -> AbiResult<ControlInput> {
    // SAFETY: the caller's promise is the same.
    let from = unsafe { read(from, name) }?;
    Ok(ControlInput::new([from.mouse_dx, from.mouse_dy], KeySet(from.keys), from.scroll)?)
}

/// Converts controls to the header's struct. Its struct_size is 0: `Out::write` keeps the host's.
pub(super) fn to_header(input: &ControlInput) -> cairn_controls {
    let [mouse_dx, mouse_dy] = input.mouse();
    cairn_controls { struct_size: 0, mouse_dx, mouse_dy, scroll: input.scroll(), keys: input.keys().0 }
}
