//! A walk through a scene: from a control script to frames.

use cairn::Result;
use cairn::world::{ControlScript, WorldTime};

use crate::render::{Frame, Moment, Quality, render};
use crate::scene::Scene;
use crate::walk::{Start, Walker};

/// The walker takes as many steps per second as the least common multiple of this and the rate: pictures are drawn at steps, never between two.
const STEPS: u32 = 120;
/// Maximum number of pictures per second of world time.
pub const MAX_RATE: u32 = 960;

/// Settings of a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipOptions {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Pictures per second of world time, 1 to [`MAX_RATE`]. Walks at rates that divide 120 have bit-identical paths; others take finer steps and
    /// deviate minimally.
    pub rate: u32,
    /// Aspect ratio of the view; a size of another ratio has non-square pixels.
    pub aspect: f32,
    /// Render quality.
    pub quality: Quality,
    /// Start of the walk; `None` for the path at the origin.
    pub start: Option<Start>,
}

impl Default for ClipOptions {
    fn default() -> Self {
        Self { width: 640, height: 360, rate: 30, aspect: 16.0 / 9.0, quality: Quality::default(), start: None }
    }
}

/// The frames of a walk in order of time, without end: after the script's end no control is pressed.
///
/// Frame n shows world time n / rate; its motion points to frame n - 1. Frame 0 has zero motion.
pub struct Clip<'a> {
    scene: &'a Scene,
    script: &'a ControlScript,
    options: ClipOptions,
    walker: Walker,
    /// Steps per second.
    pace: u32,
    steps: u64,
    before: Option<Moment>,
}

impl<'a> Clip<'a> {
    /// A walk from its start. `None` if the rate is out of range.
    pub fn new(scene: &'a Scene, script: &'a ControlScript, options: ClipOptions) -> Option<Self> {
        let pace = (1..=MAX_RATE).contains(&options.rate).then(|| common_multiple(STEPS, options.rate))?;
        let walker = options.start.map_or_else(|| Walker::new(scene), |start| Walker::starting_at(scene, start));
        Some(Self { scene, script, options, walker, pace, steps: 0, before: None })
    }

    /// Walks to the next frame's time. Returns the moments of that frame and of the previous one.
    ///
    /// # Errors
    /// `InvalidArgument` when the script moves the mouse farther in one step than controls allow.
    pub fn advance(&mut self) -> Result<(Moment, Moment)> {
        if self.before.is_some() {
            for _ in 0..self.pace / self.options.rate {
                let (from, until) = (WorldTime::new(self.steps, self.pace), WorldTime::new(self.steps + 1, self.pace));
                self.walker.step(self.scene, &self.script.span(from, until)?, 1.0 / f64::from(self.pace));
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

/// The least common multiple.
fn common_multiple(a: u32, b: u32) -> u32 {
    let (mut divisor, mut rest) = (a, b);
    while rest != 0 {
        (divisor, rest) = (rest, divisor % rest);
    }
    a / divisor * b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Family;

    fn walk(rate: u32, seconds: u32) -> Option<Moment> {
        let script = ControlScript::parse("cairn-controls 1\n0..2 hold W\n0..2 mouse 300 0\n2 end\n").unwrap();
        let scene = Scene::new(Family::Desert, 1);
        let mut clip = Clip::new(&scene, &script, ClipOptions { rate, ..ClipOptions::default() })?;
        (0..=rate * seconds).map(|_| clip.advance().unwrap().0).last()
    }

    #[test]
    fn every_rate_walks_the_same_way() {
        let usual = walk(15, 1).unwrap();
        for rate in [1, 30, 60, 120] {
            assert_eq!(walk(rate, 1), Some(usual), "{rate}");
        }
        for rate in [45, 75, 90, 105, 180, MAX_RATE] {
            let other = walk(rate, 1).unwrap();
            let apart = usual.camera.position.distance(other.camera.position);
            assert!(apart < 0.02 && (usual.camera.yaw - other.camera.yaw).abs() < 1e-4, "{rate}: {apart} m");
        }
    }

    #[test]
    fn a_walk_starts_where_it_is_told() {
        let script = ControlScript::parse("cairn-controls 1\n0..1 hold W\n1 end\n").unwrap();
        let scene = Scene::new(Family::Desert, 1);
        let start = Start { at: glam::Vec2::new(-31.0, 17.0), yaw: std::f32::consts::FRAC_PI_2 };
        let options = ClipOptions { start: Some(start), ..ClipOptions::default() };
        let mut clip = Clip::new(&scene, &script, options).unwrap();
        let first = clip.advance().unwrap().0.camera;
        assert_eq!((first.position.x, first.position.z, first.yaw), (-31.0, 17.0, start.yaw));
        let last = (0..30).map(|_| clip.advance().unwrap().0.camera).last().unwrap();
        let east = last.position.x - first.position.x;
        assert!((1.2..2.0).contains(&east) && (last.position.z - first.position.z).abs() < 0.5, "{last:?}");
    }

    #[test]
    fn rates_out_of_range_are_refused() {
        assert!(walk(0, 1).is_none() && walk(MAX_RATE + 1, 1).is_none() && walk(u32::MAX, 1).is_none());
    }
}
