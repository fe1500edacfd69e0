//! A walk through a scene: anchors with their true motion and depth, and the true frames half way between them. A presenter shows it, and
//! its frames are compared with the true ones.

use std::sync::Arc;

use cairn::framegen::cpu::CpuGenerator;
use cairn::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, Projection};
use cairn::present::pacing::Interval;
use cairn::present::presenter::{FrameInfo, FrameSource, Presenter, PresenterOptions};
use cairn::world::{ControlScript, KeptAnchor};
use cairn::{Error, ErrorKind, Picture, Result};
use half::f16;
use scenes::camera::{FAR, NEAR};
use scenes::{Clip, ClipOptions, Family, Frame, Moment, Quality, Scene, render};

/// Anchors per second of world time, and moments in an interval.
const RATE: u32 = 15;
const STEPS: usize = 2;
/// Seed of the scenes.
const SEED: u64 = 4;
/// The first anchor: 2 seconds into the script, where the camera moves.
const FIRST: usize = 30;

/// Anchors and true frames of a scene.
pub(super) struct Walk {
    anchors: Vec<Frame>,
    halves: Vec<Picture>,
    projection: Projection,
}

/// A fault of the checks themselves.
fn internal(why: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Internal, why.to_string()).remedy("Report it")
}

impl Walk {
    /// `pairs` pairs of anchors of that size, in a family's scene.
    pub(super) fn new(family: Family, (width, height): (u32, u32), pairs: usize) -> Result<Self> {
        let scene = Scene::new(family, SEED);
        let script = ControlScript::parse(family.script()).map_err(internal)?;
        let options = ClipOptions { width, height, rate: RATE * STEPS as u32, ..ClipOptions::default() };
        let mut walk = Clip::new(&scene, &script, options).ok_or_else(|| internal("the rate is out of range"))?;
        let last = (FIRST + pairs) * STEPS;
        let moments = (0..=last).map(|_| Ok(walk.advance().map_err(internal)?.0)).collect::<Result<Vec<Moment>>>()?;
        let draw = |now: usize, before: usize| {
            render(&scene, &moments[now], &moments[before], width, height, Quality::default())
        };
        let anchors = (0..=pairs).map(|pair| {
            let now = (FIRST + pair) * STEPS;
            draw(now, now - STEPS)
        });
        let halves = (0..pairs).map(|pair| {
            let half = (FIRST + pair) * STEPS + STEPS / 2;
            draw(half, half).picture
        });
        let fov = moments[FIRST * STEPS].camera.vertical_fov;
        Ok(Self { anchors: anchors.collect(), halves: halves.collect(), projection: Projection::new(NEAR, FAR, fov)? })
    }

    /// Size of the pictures.
    pub(super) fn size(&self) -> (u32, u32) {
        self.anchors[0].picture.size()
    }

    /// The true frames half way.
    pub(super) fn halves(&self) -> &[Picture] {
        &self.halves
    }

    /// Pictures of the anchors.
    #[cfg(windows)]
    pub(super) fn picture(&self, anchor: usize) -> &Picture {
        &self.anchors[anchor].picture
    }

    /// Motion and depth of an anchor, as an engine provides them.
    pub(super) fn guidance(&self, anchor: usize) -> Result<Guidance> {
        let frame = &self.anchors[anchor];
        let (width, height) = frame.picture.size();
        let finite = |v: f32| f16::from_f32(if v.is_finite() { v } else { 0.0 });
        let vectors = frame.motion.iter().map(|v| [finite(v.x), finite(v.y)]).collect();
        let motion = MotionField::from_vectors(width, height, vectors)?;
        let encoding = cairn::guidance::DepthEncoding::default();
        let depth = DepthMap::from_host(width, height, frame.depth.clone(), encoding, self.projection)?;
        Guidance::from_parts(motion, depth, MotionOrigin::Geometry)
    }

    /// Has the presenter show the walk; `draw` makes the frame that is due at a time in nanoseconds. Returns the frames half way.
    pub(super) fn show(
        &self,
        presenter: &Presenter,
        mut draw: impl FnMut(u64) -> Result<(Option<FrameInfo>, Option<Picture>)>,
    ) -> Result<Vec<Picture>> {
        presenter.reset();
        let interval = 1_000_000_000 / u64::from(RATE);
        let mut made = Vec::new();
        for (number, frame) in self.anchors.iter().enumerate() {
            let now = number as u64 * interval;
            let anchor = Arc::new(KeptAnchor::of_picture(frame.picture.clone(), number as u64, false));
            let guidance = (number > 0).then(|| self.guidance(number)).transpose()?;
            if !presenter.push(anchor, guidance.map(Arc::new), now)? {
                return Err(internal("an anchor is not taken"));
            }
            if number > 0 {
                // Within the frame half way, which is shown for half an interval.
                match draw(now + interval * 3 / 4)? {
                    (Some(shown), Some(picture)) if shown.t == 0.5 && shown.source != FrameSource::Anchor => {
                        made.push(picture);
                    }
                    (shown, _) => return Err(internal(format!("{shown:?} is not a frame half way"))),
                }
            }
        }
        Ok(made)
    }

    /// The frames half way by the processor's generator, through the presenter.
    pub(super) fn by_processor(&self) -> Result<Vec<Picture>> {
        let presenter = presenter(Some(Box::new(CpuGenerator::new())))?;
        self.show(&presenter, |now| {
            let mut made = None;
            let shown = presenter.draw(now, self.size(), |picture| made = Some(picture.clone()))?;
            Ok((shown, made))
        })
    }

    /// Mean PSNR of frames half way against the true ones, in dB.
    pub(super) fn quality(&self, frames: &[Picture]) -> f64 {
        let all = frames.iter().zip(&self.halves).map(|(made, truth)| psnr(made, truth));
        all.sum::<f64>() / frames.len() as f64
    }
}

/// A presenter of two frames per anchor, with a generator of the processor or for a device.
pub(super) fn presenter(generator: Option<Box<dyn cairn::framegen::FrameGenerator>>) -> Result<Presenter> {
    let options = PresenterOptions {
        interval: Some(Interval::per_second(RATE)?),
        extrapolate: false,
        decoded: false,
        ..PresenterOptions::default()
    };
    Presenter::new(options, generator)
}

/// Peak signal-to-noise ratio over red, green and blue in dB, at most that of one wrong step in all of a picture.
pub(super) fn psnr(made: &Picture, truth: &Picture) -> f64 {
    let steps = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).map(|c| f64::from(a[c].abs_diff(b[c])).powi(2)).sum::<f64>();
    let sum: f64 = made.pixels().iter().zip(truth.pixels()).map(steps).sum();
    let mean = sum.max(1.0) / (3 * truth.pixels().len()) as f64;
    10.0 * (255.0 * 255.0 / mean).log10()
}

/// Size of a walk whose quality is judged, and its number of pairs: whole, and for a short run.
pub(super) const SIZES: [((u32, u32), usize); 2] = [((640, 360), 2), ((160, 90), 1)];

/// Least quality of generated frames in each family, in dB: whole, and in a short run. The generator's own, rounded down by 0.2 dB: the
/// scenes are the same everywhere, to the bit on one processor and almost on another.
pub(super) const FLOORS: [(Family, [f64; 2]); 4] = [
    (Family::Forest, [39.4, 35.9]),
    (Family::Sword, [37.2, 34.8]),
    (Family::Desert, [36.9, 33.2]),
    (Family::Snow, [38.6, 36.1]),
];
