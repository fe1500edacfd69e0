//! A walk through a scene: from a control script to frames.

use cairn::Result;
use cairn::world::{ControlScript, WorldTime};

use crate::render::{Frame, Moment, Quality, render};
use crate::scene::Scene;
use crate::walk::Walker;

/// Steps of the walker in a second of world time.
const STEPS: u32 = 120;

/// What is drawn of a walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipOptions {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Pictures per second of world time; must divide 120.
    pub rate: u32,
    /// Width over height of what is shown; a size of another ratio has pixels that are not square.
    pub aspect: f32,
    /// How it is drawn.
    pub quality: Quality,
}

impl Default for ClipOptions {
    fn default() -> Self {
        Self { width: 640, height: 360, rate: 30, aspect: 16.0 / 9.0, quality: Quality::default() }
    }
}

/// The frames of a walk, in order of time, without end: after the script's end nothing is pressed.
///
/// Frame n shows world time n / rate; its motion points to frame n - 1, and that of frame 0 is nil.
pub struct Clip<'a> {
    scene: &'a Scene,
    script: &'a ControlScript,
    options: ClipOptions,
    walker: Walker,
    steps: u64,
    before: Option<Moment>,
}

impl<'a> Clip<'a> {
    /// A walk that starts on the path. None when `rate` does not divide 120: times between steps would have to be
    /// guessed.
    pub fn new(scene: &'a Scene, script: &'a ControlScript, options: ClipOptions) -> Option<Self> {
        let fits = options.rate > 0 && STEPS.is_multiple_of(options.rate);
        fits.then(|| Self { scene, script, options, walker: Walker::new(scene), steps: 0, before: None })
    }

    /// Walks to the next frame's time and says what is seen there, and what was seen in the frame before.
    ///
    /// # Errors
    /// `InvalidArgument` when the script moves the mouse farther in one step than a step can hold.
    pub fn advance(&mut self) -> Result<(Moment, Moment)> {
        if self.before.is_some() {
            for _ in 0..STEPS / self.options.rate {
                let (from, until) = (WorldTime::new(self.steps, STEPS), WorldTime::new(self.steps + 1, STEPS));
                self.walker.step(self.scene, &self.script.span(from, until)?, 1.0 / f64::from(STEPS));
                self.steps += 1;
            }
        }
        let now = self.walker.moment(self.options.aspect);
        let before = self.before.replace(now).unwrap_or(now);
        Ok((now, before))
    }

    /// The next frame.
    ///
    /// # Errors
    /// As [`advance`](Self::advance).
    pub fn frame(&mut self) -> Result<Frame> {
        let (now, before) = self.advance()?;
        let ClipOptions { width, height, quality, .. } = self.options;
        Ok(render(self.scene, &now, &before, width, height, quality))
    }
}
