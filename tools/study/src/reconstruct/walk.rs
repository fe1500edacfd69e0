//! The truth: a walk through a scene, with any of its frames and the exact motion between anchors.

use cairn::guidance::{Guidance, Projection};
use cairn::world::ControlScript;
use cairn::{Picture, Result};
use half::f16;
use scenes::camera::{Camera, FAR, NEAR};
use scenes::{ClipOptions, Family, Frame, Moment, Quality, Scene};

/// A walk under the scene's own script; frame n shows world time n / (rate multiplier), anchor n world time n / rate.
pub(crate) struct Walk {
    scene: Scene,
    moments: Vec<Moment>,
    size: (u32, u32),
    multiplier: u32,
}

impl Walk {
    /// A walk of `frames` frames, of which every `multiplier`-th is an anchor, `rate` anchors a second. Renders nothing yet.
    pub(crate) fn new(
        family: Family,
        seed: u64,
        size: (u32, u32),
        [rate, multiplier]: [u32; 2],
        frames: u64,
    ) -> Result<Self> {
        let scene = Scene::new(family, seed);
        let script = ControlScript::parse(family.script())?;
        let rate = rate * multiplier;
        let aspect = size.0 as f32 / size.1 as f32;
        let options = ClipOptions { width: size.0, height: size.1, rate, aspect, ..ClipOptions::default() };
        let mut clip = scenes::Clip::new(&scene, &script, options)?;
        let moments = (0..frames).map(|_| Ok(clip.advance()?.0)).collect::<Result<Vec<Moment>>>()?;
        Ok(Self { scene, moments, size, multiplier })
    }

    /// Renders frame `index`; `None` after the end of the walk.
    pub(crate) fn truth(&self, index: u64) -> Option<Picture> {
        let moment = self.moments.get(usize::try_from(index).ok()?)?;
        Some(self.draw(moment, moment).picture)
    }

    /// Anchor `number`, with its motion to the previous one.
    pub(crate) fn anchor(&self, number: u64) -> Option<Frame> {
        let at = |number: u64| self.moments.get(usize::try_from(number.checked_mul(self.multiplier.into())?).ok()?);
        Some(self.draw(at(number)?, at(number.saturating_sub(1))?))
    }

    fn draw(&self, now: &Moment, before: &Moment) -> Frame {
        scenes::render(&self.scene, now, before, self.size.0, self.size.1, Quality::default())
    }

    /// Camera at the start.
    pub(crate) fn start(&self) -> Option<&Camera> {
        self.moments.first().map(|moment| &moment.camera)
    }

    /// Allocates guidance for the true motion and depth.
    pub(crate) fn guidance(&self) -> Result<Guidance> {
        // The walker never zooms, so the first field of view holds for all.
        let fov = self.moments.first().map_or(1.0, |moment| moment.camera.vertical_fov);
        Guidance::new(self.size.0, self.size.1, Projection::new(NEAR, FAR, fov)?)
    }
}

/// Copies the truth of an anchor into `guidance`, which has the anchor's size and one vector per pixel.
pub(crate) fn write_guidance(frame: &Frame, guidance: &mut Guidance) {
    for (vector, motion) in guidance.motion_mut().vectors_mut().iter_mut().zip(&frame.motion) {
        *vector = [f16::from_f32(motion.x), f16::from_f32(motion.y)];
    }
    guidance.depth_mut().depth_mut().copy_from_slice(&frame.depth);
}
