//! A walk through a scene: from a control script to frames.

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;

use cairn::world::{ControlScript, WorldTime};
use cairn::{Error, ErrorKind, Picture, Result};
use glam::Vec2;

use crate::edit::{self, EditList, ShotChange};
use crate::film::{FilmOptions, TemporalAntiAliasing, halton_jitter, mean_picture};
use crate::hud;
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

/// Post-processing of a clip's frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Effects {
    /// Camera cuts, cross-fades, fades and flashes.
    pub edits: EditList,
    /// Motion blur, temporal anti-aliasing and grain.
    pub film: FilmOptions,
    /// Phases of the camera's jitter, as of [`halton_jitter`]; `None` for no jitter, or [`TAA_PHASES`] with temporal anti-aliasing.
    pub jitter: Option<u32>,
    /// Whether a head-up display is drawn over the pictures; see [`hud`](crate::hud).
    pub hud: bool,
}

/// Phases of the camera's jitter that temporal anti-aliasing uses unless another number is given.
pub const TAA_PHASES: u32 = 8;

/// A frame of a clip, and the moments it is of.
#[derive(Debug, Clone)]
pub struct ClipFrame {
    /// The frame, with all effects in its picture.
    pub frame: Frame,
    /// Its number in the clip, from 0.
    pub number: u64,
    /// Its moment.
    pub now: Moment,
    /// The moment that its motion points to.
    pub before: Moment,
    /// Opacity of the head-up display over each pixel, 0 to 255, if one is drawn.
    pub hud: Option<Vec<u8>>,
}

/// A walk from one cut to the next.
struct Shot {
    walker: Walker,
    number: u32,
    before: Option<Moment>,
    /// Moments of the last steps and their times in seconds, the latest last; kept for motion blur.
    trail: VecDeque<(f64, Moment)>,
}

impl Shot {
    fn new(walker: Walker, number: u32) -> Self {
        Self { walker, number, before: None, trail: VecDeque::new() }
    }

    /// The moment `seconds`, on the straight line between two steps; the first step for times before it.
    fn moment_at(&self, seconds: f64) -> Option<Moment> {
        let later = self.trail.iter().position(|(time, _)| *time >= seconds).unwrap_or(self.trail.len() - 1);
        let (end, later_moment) = self.trail.get(later)?;
        let Some((start, earlier)) = later.checked_sub(1).and_then(|k| self.trail.get(k)) else {
            return Some(*later_moment);
        };
        Some(earlier.towards(later_moment, ((seconds - start) / (end - start)) as f32))
    }
}

/// One of the shots that a frame shows.
struct Layer {
    now: Moment,
    before: Moment,
    /// Moments of its sub-frames; empty without motion blur.
    exposure: Vec<Moment>,
    /// Share in the picture over those before it.
    share: f32,
}

/// The frames of a walk in order of time, without end: after the script's end no control is pressed.
///
/// Frame n shows world time n / rate; its motion points to frame n - 1. Frame 0 has zero motion, and the first frame after a cut non-finite motion.
pub struct Clip<'a> {
    scene: &'a Scene,
    script: &'a ControlScript,
    options: ClipOptions,
    effects: Effects,
    changes: VecDeque<ShotChange>,
    /// One shot, or two during a cross-fade: the incoming one last.
    shots: Vec<Shot>,
    /// Time of the current cross-fade.
    cross_fade: Range<f64>,
    histories: BTreeMap<u32, TemporalAntiAliasing>,
    /// Steps per second.
    steps_per_second: u32,
    steps: u64,
    /// Number of the next frame.
    number: u64,
    before: Option<Moment>,
}

impl<'a> Clip<'a> {
    /// A walk from its start.
    ///
    /// # Errors
    /// `InvalidArgument` for a rate that is out of range.
    pub fn new(scene: &'a Scene, script: &'a ControlScript, options: ClipOptions) -> Result<Self> {
        Self::with_effects(scene, script, options, Effects::default())
    }

    /// As [`new`](Self::new), with effects.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_effects(
        scene: &'a Scene,
        script: &'a ControlScript,
        options: ClipOptions,
        mut effects: Effects,
    ) -> Result<Self> {
        if !(1..=MAX_RATE).contains(&options.rate) {
            let cause = format!("a scene cannot be walked at {} pictures a second", options.rate);
            let remedy = format!("Use 1 to {MAX_RATE}");
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("rate").remedy(remedy));
        }
        let steps_per_second = lcm(STEPS, options.rate);
        let walker = options.start.map_or_else(|| Walker::new(scene), |start| Walker::starting_at(scene, start));
        effects.jitter = effects.jitter.or(effects.film.anti_aliasing.map(|_| TAA_PHASES));
        let mut this = Self {
            scene,
            script,
            options,
            changes: effects.edits.shot_changes().into(),
            effects,
            shots: vec![Shot::new(walker, 0)],
            cross_fade: 0.0..0.0,
            histories: BTreeMap::new(),
            steps_per_second,
            steps: 0,
            number: 0,
            before: None,
        };
        this.record_trail();
        Ok(this)
    }

    /// World time of the walkers in seconds.
    fn seconds(&self) -> f64 {
        self.steps as f64 / f64::from(self.steps_per_second)
    }

    /// Takes one step with each shot's walker, then begins and ends shots.
    fn step(&mut self) -> Result<()> {
        let (from, until) =
            (WorldTime::new(self.steps, self.steps_per_second), WorldTime::new(self.steps + 1, self.steps_per_second));
        let input = self.script.span(from, until)?;
        for shot in &mut self.shots {
            shot.walker.step(self.scene, &input, 1.0 / f64::from(self.steps_per_second));
        }
        self.steps += 1;
        // Times that are no multiple of a step have a rounding error.
        let now = self.seconds() + 1e-9;
        if self.shots.len() > 1 && self.cross_fade.end <= now {
            self.shots.drain(..self.shots.len() - 1);
        }
        while let Some(change) = self.changes.pop_front_if(|change| change.time.start <= now) {
            let Some(last) = self.shots.last() else { break };
            let shot = Shot::new(last.walker.jumped(self.scene, change.start), last.number + 1);
            if change.time.end <= now {
                self.shots.clear();
            }
            self.shots.push(shot);
            self.cross_fade = change.time;
        }
        self.record_trail();
        Ok(())
    }

    fn record_trail(&mut self) {
        let Some(blur) = self.effects.film.blur else { return };
        let (seconds, aspect) = (self.seconds(), self.options.aspect);
        for shot in &mut self.shots {
            shot.trail.push_back((seconds, Moment { shot: shot.number, ..shot.walker.moment(aspect) }));
            // One step before the exposure remains, because sub-frames lie between steps.
            while shot.trail.get(1).is_some_and(|(time, _)| *time <= seconds - blur.exposure) {
                shot.trail.pop_front();
            }
        }
    }

    /// Walks to the next frame's time. Returns what the frame shows, the incoming shot last.
    fn advance_shots(&mut self) -> Result<Vec<Layer>> {
        if self.number > 0 {
            for _ in 0..self.steps_per_second / self.options.rate {
                self.step()?;
            }
        }
        let jitter = self.effects.jitter.map_or(Vec2::ZERO, |phases| halton_jitter(self.number, phases));
        let (seconds, aspect) = (self.seconds(), self.options.aspect);
        let mixed = (seconds - self.cross_fade.start) / (self.cross_fade.end - self.cross_fade.start);
        let mut layers = Vec::with_capacity(self.shots.len());
        let last_shown = self.before;
        for shot in &mut self.shots {
            let jittered = |moment: Moment| Moment { shot: shot.number, jitter, ..moment };
            let now = jittered(shot.walker.moment(aspect));
            let exposure = self.effects.film.blur.map_or_else(Vec::new, |blur| {
                blur.offsets().filter_map(|offset| shot.moment_at(seconds + offset)).map(jittered).collect()
            });
            let before = shot.before.replace(now).or(last_shown).unwrap_or(now);
            let share = if layers.is_empty() { 1.0 } else { mixed.clamp(0.0, 1.0) as f32 };
            layers.push(Layer { now, before, exposure, share });
            self.before = Some(now);
        }
        self.number += 1;
        Ok(layers)
    }

    /// Walks to the next frame's time. Returns the moments of that frame and of the previous one: in a cross-fade those of the incoming shot. After a
    /// cut the previous moment is one of the previous shot.
    ///
    /// # Errors
    /// `InvalidArgument` when the script moves the mouse farther in one step than controls allow.
    pub fn advance(&mut self) -> Result<(Moment, Moment)> {
        let layers = self.advance_shots()?;
        let incoming = layers.last().expect("a clip always has a shot");
        Ok((incoming.now, incoming.before))
    }

    /// The next frame.
    ///
    /// # Errors
    /// As [`advance`](Self::advance).
    pub fn frame(&mut self) -> Result<Frame> {
        Ok(self.next_frame()?.frame)
    }

    /// The next frame with its moments. Its picture has the effects in this order: blur and temporal anti-aliasing of each shot, the mixture of a
    /// cross-fade, grain, fades and flashes, the head-up display.
    ///
    /// # Errors
    /// As [`advance`](Self::advance).
    pub fn next_frame(&mut self) -> Result<ClipFrame> {
        let ClipOptions { width, height, quality, .. } = self.options;
        let layers = self.advance_shots()?;
        let number = self.number - 1;
        let film = self.effects.film;
        let mut outgoing: Option<Picture> = None;
        let mut shown = None;
        for layer in &layers {
            let Layer { now, before, .. } = layer;
            let mut frame = render(self.scene, now, before, width, height, quality);
            if !layer.exposure.is_empty() {
                frame.picture = mean_picture(self.scene, &layer.exposure, width, height, quality);
            }
            if let Some(frames) = film.anti_aliasing {
                let history = self.histories.entry(now.shot).or_insert_with(|| TemporalAntiAliasing::new(frames));
                frame.picture = history.resolve(&frame, now, before);
            }
            if let Some(mut below) = outgoing.take() {
                edit::mix(&mut below, &frame.picture, layer.share);
                frame.picture = below;
            }
            outgoing = Some(frame.picture.clone());
            shown = Some((frame, layer));
        }
        self.histories.retain(|shot, _| layers.iter().any(|layer| layer.now.shot == *shot));
        let (mut frame, &Layer { now, before, .. }) = shown.expect("a clip always has a shot");
        if let Some(grain) = film.grain {
            grain.apply(&mut frame.picture, number);
        }
        self.effects.edits.grade(self.seconds()).apply(&mut frame.picture);
        let hud = self.effects.hud.then(|| hud::draw(&mut frame.picture, self.scene, &now));
        Ok(ClipFrame { frame, number, now, before, hud })
    }
}

/// The least common multiple.
fn lcm(a: u32, b: u32) -> u32 {
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
        let mut clip = Clip::new(&scene, &script, ClipOptions { rate, ..ClipOptions::default() }).ok()?;
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
