//! Clips rendered from the procedural scenes, with known motion and depth at every time between anchors.

use cairn::guidance::{DepthEncoding, DepthMap, Guidance, MotionField, MotionOrigin, Projection};
use cairn::world::ControlScript;
use cairn::{Error, ErrorKind, Picture, Result};
use half::f16;
use scenes::camera::{FAR, NEAR};
use scenes::engine::{Engine, EngineOptions, MotionFormat};
use scenes::{Cast, ClipOptions, Family, Frame, Moment, Quality, Scene, hud, render};

use super::{Clip, MARGIN, Phase, Scale, Target};
use crate::quality::store::{Capture, Store};
use crate::sets::{self, SealedScene, Set};

/// Anchors per second of world time.
const RATE: u32 = 15;
/// Steps of an interval between anchors: all phases of 2, 4 and 6 times the rate are among them.
const STEPS: u32 = 12;
/// Anchors that end the scored intervals: every 1.85 seconds of the script, independent of its content.
const TARGETS: [usize; 8] = [14, 41, 69, 97, 125, 152, 180, 208];
/// Indices into [`TARGETS`] of the intervals that are also scored at 4 and 6 times the rate.
const DENSE: [usize; 2] = [1, 5];

/// Indices into [`TARGETS`] of the intervals of a clip in which things move.
const MOVING: [usize; 4] = [0, 2, 4, 6];
/// Habits of the engine that gives motion and depth to the row `cairn-engine`: those of Unreal Engine 5, with skinned meshes that have no velocity.
const ENGINE: EngineOptions = EngineOptions {
    frames: 2,
    format: MotionFormat::Unorm16Root,
    dilate: true,
    keep_jitter: false,
    skinned_from_camera: true,
    texel: 1,
    depth: DepthEncoding { inverted: true, linear: false },
};

/// A walk through a scene under a control script.
pub(in crate::quality) struct SceneClip {
    name: String,
    group: String,
    set: Set,
    scene: Scene,
    size: (u32, u32),
    /// Whether its cast moves, under a head-up display.
    moving: bool,
    moments: Vec<Moment>,
    targets: Vec<Target>,
    capture: Capture,
}

impl SceneClip {
    /// A walk under the scene's own script.
    pub(in crate::quality) fn new(family: Family, seed: u64, scale: Scale) -> Result<Self> {
        let (size, targets) = match scale {
            Scale::Full => ((640, 360), TARGETS.to_vec()),
            Scale::Smoke => ((160, 90), TARGETS[..2].to_vec()),
            Scale::Floors => ((640, 360), TARGETS[..3].to_vec()),
            Scale::Timed => ((1920, 1080), TARGETS[1..2].to_vec()),
        };
        let targets = targets
            .iter()
            .enumerate()
            .map(|(i, &anchor)| {
                let dense = DENSE.contains(&i) && scale == Scale::Full;
                Target { anchor, multipliers: if dense { vec![2, 4, 6] } else { vec![2] } }
            })
            .collect();
        let clip = Self {
            name: format!("{family}-{seed}"),
            group: family.name().to_owned(),
            set: sets::of_seed(seed),
            scene: Scene::new(family, seed),
            moving: false,
            size,
            moments: Vec::new(),
            targets,
            capture: Capture::of(""),
        };
        clip.walked(family.script())
    }

    /// A walk under the scene's own script past everything that can move, under a head-up display.
    pub(in crate::quality) fn moving(family: Family, seed: u64, scale: Scale) -> Result<Self> {
        let (size, count) = if scale == Scale::Full { ((640, 360), MOVING.len()) } else { ((160, 90), 1) };
        let clip = Self {
            name: format!("moving-{family}-{seed}"),
            group: format!("moving-{family}"),
            set: sets::of_seed(seed),
            scene: Scene::with_cast(family, seed, Cast::all()),
            moving: true,
            size,
            moments: Vec::new(),
            targets: MOVING[..count].iter().map(|i| Target { anchor: TARGETS[*i], multipliers: vec![2] }).collect(),
            capture: Capture::of(""),
        };
        clip.walked(family.script())
    }

    /// A clip of the sealed set, which is a group of its own.
    pub(in crate::quality) fn sealed(sealed: &SealedScene) -> Result<Self> {
        let target = |&anchor: &usize| Target { anchor, multipliers: sealed.multipliers.clone() };
        let clip = Self {
            name: sealed.name(),
            group: sealed.name(),
            set: Set::Sealed,
            scene: Scene::with_cast(sealed.family, sealed.seed, if sealed.moving { Cast::all() } else { Cast::none() }),
            moving: sealed.moving,
            size: sealed.size,
            moments: Vec::new(),
            targets: sealed.anchors.iter().map(target).collect(),
            capture: Capture::of(""),
        };
        clip.walked(&sealed.script)
    }

    /// With the moments of a walk under the control script `text`.
    fn walked(mut self, text: &str) -> Result<Self> {
        let options =
            ClipOptions { width: self.size.0, height: self.size.1, rate: RATE * STEPS, ..ClipOptions::default() };
        let script = ControlScript::parse(text)?;
        let mut walk = scenes::Clip::new(&self.scene, &script, options)?;
        let anchors = self.targets.iter().map(|target| target.anchor).max().unwrap_or(0) + MARGIN + 1;
        self.moments =
            (0..=(anchors - 1) * STEPS as usize).map(|_| Ok(walk.advance()?.0)).collect::<Result<Vec<Moment>>>()?;
        let samples = Quality::default().samples;
        let Self { name, size, .. } = &self;
        self.capture = Capture::of_scenes(&format!("{name} {}x{} samples {samples}\n{text}", size.0, size.1))?;
        Ok(self)
    }

    fn draw(&self, now: usize, before: usize) -> Frame {
        let [now, before] = [now, before].map(|n| &self.moments[n]);
        render(&self.scene, now, before, self.size.0, self.size.1, Quality::default())
    }

    fn picture(&self, moment: usize, store: &Store) -> Result<Picture> {
        store.picture(&self.capture, &moment.to_string(), || {
            let mut picture = self.draw(moment, moment).picture;
            if self.moving {
                hud::draw(&mut picture, &self.scene, &self.moments[moment]);
            }
            Ok(picture)
        })
    }
}

impl Clip for SceneClip {
    fn name(&self) -> &str {
        &self.name
    }

    fn group(&self) -> &str {
        &self.group
    }

    fn set(&self) -> Set {
        self.set
    }

    fn is_rendered(&self) -> bool {
        true
    }

    fn description(&self) -> String {
        let (width, height) = self.size;
        let moving = if self.moving { " with its whole cast and a head-up display" } else { "" };
        format!("the scene `{}`{moving}, {width}x{height}, anchors at {RATE} a second of its script", self.name)
    }

    fn targets(&self) -> &[Target] {
        &self.targets
    }

    fn anchors(&self) -> usize {
        self.moments.len().div_ceil(STEPS as usize)
    }

    fn anchor(&mut self, number: usize, store: &Store) -> Result<Picture> {
        self.picture(number * STEPS as usize, store)
    }

    fn truth(&mut self, number: usize, phase: Phase, store: &Store) -> Result<Picture> {
        let step = phase.step(STEPS).ok_or_else(|| {
            Error::new(
                ErrorKind::InvalidArgument,
                format!("scenes are drawn at {STEPS} steps, none of which is {phase}"),
            )
        })?;
        self.picture((number - 1) * STEPS as usize + step as usize, store)
    }

    fn guidance(&mut self, number: usize, store: &Store) -> Result<Option<Guidance>> {
        let (now, before) = (number * STEPS as usize, (number - 1) * STEPS as usize);
        let moment = &self.moments[now];
        let projection = Projection::new(NEAR, FAR, moment.camera.vertical_fov)?;
        let values = store.numbers(
            &self.capture,
            &format!("{now}.guidance"),
            self.size.0 as usize * self.size.1 as usize * 3,
            || {
                let frame = self.draw(now, before);
                let pixels = frame.motion.iter().zip(&frame.depth);
                Ok(pixels.flat_map(|(motion, depth)| [motion.x, motion.y, *depth]).collect())
            },
        )?;
        let vectors = values.chunks_exact(3).map(|v| [f16::from_f32(v[0]), f16::from_f32(v[1])]).collect();
        let depth = values.chunks_exact(3).map(|v| v[2]).collect();
        let motion = MotionField::from_vectors(self.size.0, self.size.1, vectors)?;
        let depth = DepthMap::from_host(self.size.0, self.size.1, depth, Default::default(), projection)?;
        Guidance::from_parts(motion, depth, MotionOrigin::Geometry).map(Some)
    }

    fn overlay(&mut self, number: usize, _store: &Store) -> Result<Option<Vec<u8>>> {
        let Some(moment) = self.moments.get(number * STEPS as usize).filter(|_| self.moving) else { return Ok(None) };
        let mut blank = Picture::new(self.size.0, self.size.1)?;
        Ok(Some(hud::draw(&mut blank, &self.scene, moment)))
    }

    fn engine_guidance(&mut self, number: usize) -> Result<Option<Guidance>> {
        // Two frames an interval, and the frame before them, from which the first has its motion.
        let (last, half) = (number * STEPS as usize, STEPS as usize / 2);
        let Some(first) = last.checked_sub(2 * half) else { return Ok(None) };
        let mut engine = Engine::new(ENGINE)?;
        let mut inputs = None;
        for moment in [first, first + half, last] {
            let before = moment.saturating_sub(half);
            let frame = self.draw(moment, before);
            inputs = Some(engine.push(&frame, &self.moments[moment], &self.moments[before]));
        }
        inputs.map(|inputs| inputs.guidance()).transpose()
    }
}
