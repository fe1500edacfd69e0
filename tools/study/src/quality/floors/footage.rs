//! Single intervals in which the rules of frame generation matter: moving things, pans, borders, cuts, fades, and motion as engines give it.

use cairn::guidance::{DepthEncoding, DepthMap, Guidance, MotionField, MotionOrigin, Projection};
use cairn::world::ControlScript;
use cairn::{Error, ErrorKind, Picture, Result};
use half::f16;
use scenes::camera::{FAR, NEAR};
use scenes::edit::EditList;
use scenes::engine::{Engine, EngineOptions, MotionFormat};
use scenes::{Cast, ClipOptions, Effects, Family, Frame, Moment, Quality, Scene, hud, render};

use super::{Input, SEED};
use crate::quality::clips::Phase;
use crate::quality::store::{Capture, Store};

const SIZE: (u32, u32) = (640, 360);
/// Moments per second of world time.
const STEPS: u32 = 180;
/// Moments from one anchor to the next at 15 anchors a second.
const INTERVAL: usize = 12;

/// Motion and depth as Unreal Engine 5 gives them, for skinned meshes without velocity.
const ENGINE: EngineOptions = EngineOptions {
    frames: 2,
    format: MotionFormat::Unorm16Root,
    dilate: true,
    keep_jitter: false,
    skinned_from_camera: true,
    texel: 1,
    depth: DepthEncoding { inverted: true, linear: false },
};
/// Exact motion, one vector per 16 x 16 pixels.
const TILES: EngineOptions = EngineOptions {
    frames: 2,
    format: MotionFormat::Float32,
    dilate: false,
    keep_jitter: false,
    skinned_from_camera: false,
    texel: 16,
    depth: DepthEncoding { inverted: false, linear: false },
};

/// An interval between two anchors of a walk.
pub(super) struct Footage {
    pub(super) name: &'static str,
    family: Family,
    /// Whether everything moves that can, under a head-up display.
    moving: bool,
    /// Control script; the family's own if empty.
    script: &'static str,
    /// Edits, as [`EditList`] reads them.
    edits: &'static str,
    /// Rows of black bars at top and bottom.
    bars: u32,
    /// Moment of the later anchor, and moments between the two.
    end: usize,
    length: usize,
    pub(super) phase: Phase,
    pub(super) inputs: &'static [Input],
}

const PAN: &str = "cairn-controls 1\n0..4 hold W\n0..4 mouse 2400 0\n4 end\n";
const TILT: &str = "cairn-controls 1\n0..4 hold W D\n0..4 mouse -600 300\n4 end\n";
const RUN: &str = "cairn-controls 1\n0..6 hold W SHIFT\n6 end\n";

/// A walk past moving things.
const fn moving(name: &'static str, family: Family, end: usize, phase: Phase) -> Footage {
    let inputs = &[Input::Flow, Input::Truth, Input::Engine];
    Footage { name, family, moving: true, script: "", edits: "", bars: 0, end, length: INTERVAL, phase, inputs }
}

/// A walk through a landscape in which the camera alone moves.
const fn still(name: &'static str, family: Family, script: &'static str, phase: Phase) -> Footage {
    let inputs = &[Input::Flow, Input::Truth];
    let (end, length) = (30 * INTERVAL, INTERVAL);
    Footage { name, family, moving: false, script, edits: "", bars: 0, end, length, phase, inputs }
}

/// All of them.
pub(super) const FOOTAGE: [Footage; 12] = [
    moving("moving-forest", Family::Forest, 41 * INTERVAL, Phase::HALF),
    moving("moving-desert", Family::Desert, 97 * INTERVAL, Phase::QUARTER),
    moving("moving-snow", Family::Snow, 69 * INTERVAL, Phase::THREE_QUARTERS),
    moving("moving-indoors", Family::Indoors, 69 * INTERVAL, Phase::QUARTER),
    moving("moving-town", Family::Town, 41 * INTERVAL, Phase::HALF),
    Footage { inputs: &[Input::Truth, Input::Tiles], ..still("pan-sword", Family::Sword, PAN, Phase::THREE_QUARTERS) },
    still("pan-forest", Family::Forest, PAN, Phase::QUARTER),
    Footage { length: 3 * INTERVAL, ..still("run-forest", Family::Forest, RUN, Phase::HALF) },
    Footage {
        length: 2 * INTERVAL,
        inputs: &[Input::Truth, Input::Tiles],
        ..still("tilt-desert", Family::Desert, TILT, Phase::QUARTER)
    },
    Footage { bars: 44, ..still("bars-snow", Family::Snow, TILT, Phase::HALF) },
    Footage { edits: "1.9..2.3 fade-out black", ..still("fade-sword", Family::Sword, TILT, Phase::HALF) },
    // Half way between the anchors, and the frame is a quarter of the way. Motion does not exist across a cut.
    Footage {
        edits: "1.966 cut 0,40,180",
        inputs: &[Input::Flow],
        ..still("cut-forest", Family::Forest, RUN, Phase::QUARTER)
    },
];

/// The pictures of a [`Footage`], and what its inputs are made from.
pub(super) struct Walk<'a> {
    footage: &'a Footage,
    scene: Scene,
    edits: EditList,
    moments: Vec<Moment>,
    capture: Capture,
}

impl Footage {
    /// Walks to its end.
    pub(super) fn walk(&self) -> Result<Walk<'_>> {
        let &Self { name, family, moving, bars, .. } = self;
        let scene = Scene::with_cast(family, SEED, if moving { Cast::all() } else { Cast::none() });
        let text = if self.script.is_empty() { family.script() } else { self.script };
        let (script, edits): (_, EditList) = (ControlScript::parse(text)?, self.edits.parse()?);
        let options = ClipOptions { width: SIZE.0, height: SIZE.1, rate: STEPS, ..ClipOptions::default() };
        let effects = Effects { edits: edits.clone(), ..Effects::default() };
        let mut clip = scenes::Clip::with_effects(&scene, &script, options, effects)?;
        let moments = (0..=self.end).map(|_| Ok(clip.advance()?.0)).collect::<Result<Vec<Moment>>>()?;
        drop(clip);
        let samples = Quality::default().samples;
        let capture = Capture::of_scenes(&format!(
            "floors {name} {family} {SEED} {SIZE:?} moving {moving} bars {bars} samples {samples}\n{text}\n{}",
            self.edits
        ))?;
        Ok(Walk { footage: self, scene, edits, moments, capture })
    }
}

impl Walk<'_> {
    fn start(&self) -> usize {
        self.footage.end - self.footage.length
    }

    fn draw(&self, now: usize, before: usize) -> Frame {
        let [now, before] = [now, before].map(|n| &self.moments[n]);
        render(&self.scene, now, before, SIZE.0, SIZE.1, Quality::default())
    }

    /// The anchors.
    pub(super) fn anchors(&self, store: &Store) -> Result<[Picture; 2]> {
        Ok([self.picture(self.start(), store)?, self.picture(self.footage.end, store)?])
    }

    /// The true picture of the phase.
    pub(super) fn truth(&self, store: &Store) -> Result<Picture> {
        let steps = self.footage.length as u32;
        let step = self.footage.phase.step(steps).ok_or_else(|| {
            Error::new(ErrorKind::InvalidArgument, format!("none of {steps} moments is {}", self.footage.phase))
        })?;
        self.picture(self.start() + step as usize, store)
    }

    fn picture(&self, moment: usize, store: &Store) -> Result<Picture> {
        store.picture(&self.capture, &moment.to_string(), || {
            let mut picture = self.draw(moment, moment).picture;
            self.edits.grade(moment as f64 / f64::from(STEPS)).apply(&mut picture);
            if self.footage.moving {
                hud::draw(&mut picture, &self.scene, &self.moments[moment]);
            }
            let (width, bar) = (SIZE.0 as usize, (self.footage.bars * SIZE.0) as usize);
            let last = width * SIZE.1 as usize - bar;
            let pixels = picture.pixels_mut();
            pixels[..bar].fill([0, 0, 0, 255]);
            pixels[last..].fill([0, 0, 0, 255]);
            Ok(picture)
        })
    }

    /// Motion and depth of the later anchor, and those of the earlier one, which has its depth from them; none for optical flow.
    pub(super) fn guidance(&self, input: Input, store: &Store) -> Result<[Option<Guidance>; 2]> {
        let ends = [self.start(), self.footage.end];
        let [before, now] = match input {
            Input::Flow => return Ok([None, None]),
            Input::Truth => ends.map(|moment| self.exact(moment, store)),
            Input::Engine => ends.map(|moment| self.of_engine("engine", ENGINE, moment, store)),
            Input::Tiles => ends.map(|moment| self.of_engine("tiles", TILES, moment, store)),
        };
        Ok([Some(before?), Some(now?)])
    }

    /// True motion over an interval, and depth.
    fn exact(&self, moment: usize, store: &Store) -> Result<Guidance> {
        let values = store.numbers(&self.capture, &format!("{moment}.guidance"), 3 * area(1), || {
            let frame = self.draw(moment, moment - self.footage.length);
            Ok(joined(frame.motion.iter().map(|motion| motion.to_array()), &frame.depth))
        })?;
        self.guidance_of(&values, 1, DepthEncoding::default(), moment)
    }

    /// Motion of an engine that draws one frame between the anchors.
    fn of_engine(&self, name: &str, options: EngineOptions, moment: usize, store: &Store) -> Result<Guidance> {
        let half = self.footage.length / 2;
        let count = 2 * area(options.texel) + area(1);
        let values = store.numbers(&self.capture, &format!("{moment}.{name} {options:?}"), count, || {
            let mut engine = Engine::new(options)?;
            let mut inputs = None;
            for now in [moment - 2 * half, moment - half, moment] {
                let frame = self.draw(now, now - half);
                inputs = Some(engine.push(&frame, &self.moments[now], &self.moments[now - half]));
            }
            let inputs = inputs.ok_or_else(|| Error::new(ErrorKind::InvalidState, "the engine drew no frame"))?;
            Ok(joined(inputs.motion.vectors.iter().map(|motion| motion.to_array()), &inputs.depth))
        })?;
        self.guidance_of(&values, options.texel, options.depth, moment)
    }

    fn guidance_of(&self, values: &[f32], tile: u32, encoding: DepthEncoding, moment: usize) -> Result<Guidance> {
        let (width, height) = SIZE;
        let (vectors, depth) = values.split_at(2 * area(tile));
        let projection = Projection::new(NEAR, FAR, self.moments[moment].camera.vertical_fov)?;
        let mut motion = MotionField::tiled(width, height, tile)?;
        for (vector, value) in motion.vectors_mut().iter_mut().zip(vectors.chunks_exact(2)) {
            *vector = [f16::from_f32(value[0]), f16::from_f32(value[1])];
        }
        let depth = DepthMap::from_host(width, height, depth.to_vec(), encoding, projection)?;
        Guidance::from_parts(motion, depth, MotionOrigin::Geometry)
    }
}

/// Number of squares of `texel` x `texel` pixels in a picture.
fn area(texel: u32) -> usize {
    (SIZE.0.div_ceil(texel) * SIZE.1.div_ceil(texel)) as usize
}

fn joined(vectors: impl Iterator<Item = [f32; 2]>, depth: &[f32]) -> Vec<f32> {
    vectors.flatten().chain(depth.iter().copied()).collect()
}
