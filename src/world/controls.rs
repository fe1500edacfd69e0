//! The player's controls during one latent step.

use crate::bundle::ControlCounts;
use crate::world::virtual_keys::{Key, KeySet};
use crate::{Error, ErrorKind, Result};

/// Maximum mouse motion of one latent step, in counts, on either axis and in either direction.
pub const MAX_MOUSE: f32 = 32_768.0;

/// Controls of one latent step, always valid: mouse motion in raw counts summed over the step, keys held in it, and
/// the sign of the wheel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ControlInput {
    mouse: [f32; 2],
    keys: KeySet,
    scroll: f32,
}

impl ControlInput {
    /// No motion, no key held.
    pub const IDLE: Self = Self { mouse: [0.0; 2], keys: KeySet::NONE, scroll: 0.0 };

    /// Makes controls. `mouse` is dx (right positive) and dy (down positive), each from -[`MAX_MOUSE`] to [`MAX_MOUSE`]. `scroll`
    /// is any finite number, of which only the sign is kept (up positive).
    ///
    /// # Errors
    /// `InvalidArgument` for a value that is not finite or a motion outside the range.
    pub fn new(mouse: [f32; 2], keys: KeySet, scroll: f32) -> Result<Self> {
        for (value, field) in mouse.into_iter().zip(["mouse.dx", "mouse.dy"]) {
            if value.is_nan() || value.abs() > MAX_MOUSE {
                return Err(Error::new(ErrorKind::InvalidArgument, format!("a motion of {value} counts is no input"))
                    .field(field)
                    .remedy(format!("Give a finite number of counts from -{MAX_MOUSE} to {MAX_MOUSE}")));
            }
        }
        if !scroll.is_finite() {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a wheel motion of {scroll} is no input"))
                .field("scroll")
                .remedy("Give a finite number; its sign counts"));
        }
        // Normalises -0 to 0, so that the same input has the same bits in the graph and in a saved file.
        let normalised = |x: f32| if x == 0.0 { 0.0 } else { x };
        let sign = if scroll == 0.0 { 0.0 } else { scroll.signum() };
        Ok(Self { mouse: mouse.map(normalised), keys, scroll: sign })
    }

    /// Mouse motion dx and dy, in counts.
    pub fn mouse(&self) -> [f32; 2] {
        self.mouse
    }

    /// The keys held in the step.
    pub fn keys(&self) -> KeySet {
        self.keys
    }

    /// Sign of the wheel motion: -1, 0 or 1.
    pub fn scroll(&self) -> f32 {
        self.scroll
    }

    /// Writes the values in the order of the transformer's `controls` input: mouse, buttons, scroll.
    ///
    /// # Errors
    /// `InvalidArgument` when the length of `out` is not `controls.len()`; `Unsupported` when the world's control layout does not
    /// have 2 mouse and 1 scroll values and at most 256 buttons, or when a held key's code is outside of its buttons.
    pub fn write(&self, controls: &ControlCounts, out: &mut [f32]) -> Result<()> {
        if controls.mouse != 2 || controls.scroll != 1 || controls.buttons > 256 {
            return Err(Error::new(
                ErrorKind::Unsupported,
                format!(
                    "a world with {} mouse, {} button and {} scroll numbers cannot be steered",
                    controls.mouse, controls.buttons, controls.scroll
                ),
            )
            .field("controls")
            .remedy("Use a world with 2 mouse, up to 256 button and 1 scroll numbers"));
        }
        if out.len() != controls.len() {
            return Err(Error::new(
                ErrorKind::InvalidArgument,
                format!("the controls are {} numbers, the output has {}", controls.len(), out.len()),
            )
            .field("controls"));
        }
        let buttons = controls.buttons as usize;
        if let Some(key) = self.keys.iter().find(|key| usize::from(key.0) >= buttons) {
            return Err(Error::new(ErrorKind::Unsupported, format!("this world knows {buttons} keys, {key} is none"))
                .field("keys")
                .remedy("Release the key"));
        }
        out[..2].copy_from_slice(&self.mouse);
        for (code, value) in (0..=255).zip(&mut out[2..2 + buttons]) {
            *value = f32::from(u8::from(self.keys.contains(Key(code))));
        }
        out[2 + buttons] = self.scroll;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WAYPOINT: ControlCounts = ControlCounts { mouse: 2, buttons: 256, scroll: 1 };

    #[test]
    fn values_are_in_the_order_mouse_buttons_scroll() {
        let keys: KeySet = [Key(0), Key(87), Key(255)].into_iter().collect();
        let input = ControlInput::new([3.5, -2.0], keys, -120.0).unwrap();
        let mut out = [9.0; 259];
        input.write(&WAYPOINT, &mut out).unwrap();
        assert_eq!(out[..2], [3.5, -2.0]);
        for code in 0..256 {
            assert_eq!(out[2 + code], if [0, 87, 255].contains(&code) { 1.0 } else { 0.0 });
        }
        assert_eq!(out[258], -1.0);
        ControlInput::IDLE.write(&WAYPOINT, &mut out).unwrap();
        assert!(out.iter().all(|value| value.to_bits() == 0));
    }

    #[test]
    fn values_out_of_range_are_refused() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 32_769.0, -40_000.0] {
            for mouse in [[bad, 0.0], [0.0, bad]] {
                let error = ControlInput::new(mouse, KeySet::NONE, 0.0).unwrap_err();
                assert_eq!(error.kind(), ErrorKind::InvalidArgument);
                assert!(error.offending_field().unwrap().starts_with("mouse."));
            }
        }
        for bad in [f32::NAN, f32::INFINITY] {
            assert!(ControlInput::new([0.0; 2], KeySet::NONE, bad).is_err());
        }
        assert!(ControlInput::new([MAX_MOUSE, -MAX_MOUSE], KeySet::NONE, f32::MAX).is_ok());
        assert_eq!(ControlInput::new([-0.0; 2], KeySet::NONE, -0.0).unwrap().mouse[0].to_bits(), 0);
    }

    #[test]
    fn keys_that_the_world_lacks_are_refused() {
        let few = ControlCounts { buttons: 8, ..WAYPOINT };
        let held = |code| ControlInput::new([0.0; 2], [Key(code)].into_iter().collect(), 0.0).unwrap();
        let mut out = [0.0; 11];
        held(7).write(&few, &mut out).unwrap();
        assert_eq!(out[9], 1.0);
        assert_eq!(held(8).write(&few, &mut out).unwrap_err().kind(), ErrorKind::Unsupported);
        assert!(held(7).write(&few, &mut out[..10]).is_err());
        assert!(held(7).write(&ControlCounts { mouse: 3, ..few }, &mut [0.0; 12]).is_err());
    }
}
