//! Walks recorded in ViZDoom: pictures of a game with depth and camera.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use cairn::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, Projection};
use cairn::{Error, ErrorKind, Picture, Result};
use half::f16;
use provision::Progress;

use super::{Clip, Phase, Scale, Target, evenly};
use crate::quality::rows::MAX_HISTORY;
use crate::quality::rows::program::{Scratch, not_provided, read_pictures, run};
use crate::quality::store::{Capture, Store};
use crate::sets::{self, Set};
use media::describe_io;

/// Python script that records a walk with exact depth.
const DRIVER: &str = include_str!("../../../drivers/doom.py");
/// Size of the driver's pictures.
const SIZE: (u32, u32) = (640, 360);
const TICS: usize = 112;
/// Pixels per unit of slope, and the column straight ahead, as in the driver.
const FOCAL: [f64; 2] = [240.0, 288.0];
const CENTRE: f64 = 319.5;
/// Value of [`Plane::Thing`] for what goes with the view: weapon and status bar.
const VIEW: usize = 255;
/// Values of a tic in [`Plane::Steps`]: x, y, z of every value of [`Plane::Thing`].
const STEPS: usize = 256 * 3;
/// Nearest and farthest distance of device depth, in map units; a person is 56 units high.
const NEAR: f32 = 4.0;
const FAR: f32 = 65536.0;

/// Recordings of the game under one name in `--clips`.
#[derive(Debug)]
pub(in crate::quality) struct Game {
    /// Name in `--clips` and in `sets.toml`.
    pub(in crate::quality) name: &'static str,
    walks: &'static [WalkOf],
}

/// A walk of [`TICS`] tics.
#[derive(Debug)]
struct WalkOf {
    name: &'static str,
    /// A map of Freedoom 2, or the file of a scenario of ViZDoom.
    map: &'static str,
    view: View,
    /// As the driver takes it.
    walk: &'static str,
}

/// What a recording shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum View {
    /// The empty world; things are not scored.
    World,
    /// The player's view with monsters, weapon and HUD, all of which is scored. Monsters have their own motion, the weapon has none, and
    /// status bar and messages are masked.
    Player,
}

/// Data that the driver writes for each tic besides the picture; it describes them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Plane {
    Depth,
    World,
    Thing,
    Steps,
    Overlay,
    Camera,
}

/// Ahead, with looks to both sides.
const STROLL: &str = "10:0:24,10:1.5:24,10:-2:24,10:0:12,0:2.5:14,10:0:14";

/// All recordings. Of Freedoom 2: a hall over water, an open yard, a stone vault. Nobody looked at the sealed ones.
pub(super) const GAMES: [Game; 4] = [
    Game {
        name: "vizdoom",
        walks: &[
            WalkOf { name: "vizdoom-map02", map: "map02", view: View::World, walk: STROLL },
            WalkOf { name: "vizdoom-map04", map: "map04", view: View::World, walk: STROLL },
            WalkOf { name: "vizdoom-map15", map: "map15", view: View::World, walk: STROLL },
        ],
    },
    Game {
        name: "vizdoom-player",
        walks: &[
            WalkOf {
                name: "vizdoom-corridor",
                map: "deadly_corridor.wad",
                view: View::Player,
                walk: "10:0:40,10:3:36,10:-3:36",
            },
            WalkOf { name: "vizdoom-spin", map: "map02", view: View::Player, walk: "10:12:56,10:-14:56" },
        ],
    },
    Game {
        name: "vizdoom-monsters",
        walks: &[
            WalkOf {
                name: "vizdoom-center",
                map: "defend_the_center.wad",
                view: View::Player,
                walk: "0:2:30,0:-4:52,0:5:30",
            },
            WalkOf { name: "vizdoom-map07", map: "map07", view: View::Player, walk: "10:0:60,10:2:52" },
        ],
    },
    Game {
        name: "vizdoom-gathering",
        walks: &[
            WalkOf {
                name: "vizdoom-supreme",
                map: "health_gathering_supreme.wad",
                view: View::Player,
                walk: "10:0:30,10:2:42,10:-1:40",
            },
            WalkOf { name: "vizdoom-whirl", map: "map11", view: View::Player, walk: "10:-11:40,0:15:32,10:9:40" },
        ],
    },
];

/// A recorded walk. Anchors are every second tic, 17.5 a second.
pub(in crate::quality) struct Recorded {
    game: &'static Game,
    walk: &'static WalkOf,
    targets: Vec<Target>,
    python: PathBuf,
    capture: Capture,
}

/// Position and direction of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Camera {
    position: [f64; 3],
    /// In radians, counter-clockwise from the x axis.
    angle: f64,
    /// The row straight ahead: that in the middle of the view, which ends above the status bar.
    middle: f64,
}

/// Output of the driver, tic by tic.
struct Recording {
    pictures: Vec<Picture>,
    /// The values of each [`Plane`], in the order of [`PLANES`].
    planes: [Vec<f32>; PLANES.len()],
}

const PLANES: [Plane; 6] = [Plane::Depth, Plane::World, Plane::Thing, Plane::Steps, Plane::Overlay, Plane::Camera];

impl Plane {
    /// The driver's file; its ending is the type of the values.
    fn file(self) -> &'static str {
        match self {
            Self::Depth => "depth.f32",
            Self::World => "world.u8",
            Self::Thing => "thing.u8",
            Self::Steps => "steps.f64",
            Self::Overlay => "overlay.u8",
            Self::Camera => "camera.f64",
        }
    }

    /// Number of values of one tic.
    fn values(self) -> usize {
        match self {
            Self::Steps => STEPS,
            Self::Camera => 5,
            _ => (SIZE.0 * SIZE.1) as usize,
        }
    }

    fn decode(self, bytes: &[u8]) -> Vec<f32> {
        match self {
            Self::Depth => bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
            Self::Steps | Self::Camera => {
                let value = |b: &[u8]| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f32;
                bytes.chunks_exact(8).map(value).collect()
            }
            Self::World | Self::Thing | Self::Overlay => bytes.iter().copied().map(f32::from).collect(),
        }
    }
}

impl Recording {
    /// The values of one tic.
    fn of_tic(&self, plane: Plane, tic: usize) -> Vec<f32> {
        let values = PLANES.iter().zip(&self.planes).find(|(kind, _)| **kind == plane).map(|(_, values)| values);
        values.and_then(|values| values.chunks_exact(plane.values()).nth(tic)).unwrap_or_default().to_vec()
    }
}

impl Game {
    /// Its walks; the first alone at [`Scale::Smoke`].
    ///
    /// # Errors
    /// ViZDoom is not available.
    pub(in crate::quality) fn open(&'static self, scale: Scale, progress: &dyn Progress) -> Result<Vec<Recorded>> {
        let python = provision::baselines::vizdoom(progress).map_err(|e| not_provided(&e))?;
        let recorded = |walk: &'static WalkOf| {
            let WalkOf { map, view, walk: stretches, .. } = walk;
            let capture = Capture::of(&format!("{map} {view:?} {stretches} {DRIVER}"));
            Recorded { game: self, walk, targets: evenly(TICS / 2, scale), python: python.clone(), capture }
        };
        let count = if scale == Scale::Smoke { 1 } else { self.walks.len() };
        Ok(self.walks.iter().take(count).map(recorded).collect())
    }
}

impl Recorded {
    fn record(&self) -> Result<Recording> {
        let scratch = Scratch::new()?;
        let mut command = Command::new(&self.python);
        // The game writes its settings to its working directory.
        let folder = scratch.path("");
        let WalkOf { map, view, walk, .. } = self.walk;
        let view = if *view == View::World { "world" } else { "player" };
        command.current_dir(&folder).arg(scratch.text("doom.py", DRIVER)?).args([map, view, walk]).arg(&folder);
        run("ViZDoom", &mut command)?;
        let read = |plane: Plane| {
            let path = scratch.path(plane.file());
            let bytes = fs::read(&path).map_err(|e| describe_io("cannot be read", &path, &e))?;
            Ok(plane.decode(&bytes))
        };
        let mut planes: [Vec<f32>; PLANES.len()] = Default::default();
        for (values, plane) in planes.iter_mut().zip(PLANES) {
            *values = read(plane)?;
        }
        let recording = Recording { pictures: read_pictures(&scratch.path("pictures.rgb"), SIZE)?, planes };
        let tics = recording.pictures.len();
        let whole = PLANES.iter().zip(&recording.planes).all(|(plane, values)| values.len() == TICS * plane.values());
        if tics == TICS && whole {
            return Ok(recording);
        }
        Err(Error::new(ErrorKind::Unsupported, format!("it gave {tics} tics of {TICS} of {}", self.walk.name))
            .field("ViZDoom"))
    }

    /// Stores everything needed for scores.
    fn keep(&self, recording: &Recording, store: &Store) -> Result<()> {
        for (tic, picture) in recording.pictures.iter().enumerate() {
            store.picture(&self.capture, &tic.to_string(), || Ok(picture.clone()))?;
        }
        let put = |plane: Plane, tic: usize| {
            let make = || Ok(recording.of_tic(plane, tic));
            store.numbers(&self.capture, &stored_as(plane, tic), plane.values(), make)
        };
        for target in &self.targets {
            put(Plane::World, 2 * target.anchor - 1)?;
            for anchor in target.anchor.saturating_sub(1 + MAX_HISTORY)..=target.anchor {
                let tic = 2 * anchor;
                for plane in [Plane::Depth, Plane::Thing, Plane::Steps, Plane::Overlay] {
                    put(plane, tic)?;
                }
            }
        }
        Ok(())
    }

    /// The cameras of all tics. If they are missing, the walk is recorded and stored with everything needed for scores.
    fn cameras(&self, store: &Store) -> Result<Vec<Camera>> {
        let count = Plane::Camera.values();
        let values = store.numbers(&self.capture, "cameras", count * TICS, || {
            let recording = self.record()?;
            self.keep(&recording, store)?;
            Ok((0..TICS).flat_map(|tic| recording.of_tic(Plane::Camera, tic)).collect())
        })?;
        Ok(values.chunks_exact(count).map(Camera::new).collect())
    }

    /// The values of a tic.
    fn plane(&self, plane: Plane, tic: usize, store: &Store) -> Result<Vec<f32>> {
        self.cameras(store)?;
        store.numbers(&self.capture, &stored_as(plane, tic), plane.values(), || {
            // Replaying takes long, and if one tic is missing, so are others: all are stored.
            let recording = self.record()?;
            self.keep(&recording, store)?;
            Ok(recording.of_tic(plane, tic))
        })
    }

    fn picture(&self, tic: usize, store: &Store) -> Result<Picture> {
        self.cameras(store)?;
        store.picture(&self.capture, &tic.to_string(), || Ok(self.record()?.pictures.swap_remove(tic)))
    }
}

/// Name of stored values.
fn stored_as(plane: Plane, tic: usize) -> String {
    let file = plane.file();
    format!("{tic}.{}", file.split_once('.').map_or(file, |(name, _)| name))
}

impl Clip for Recorded {
    fn name(&self) -> &str {
        self.walk.name
    }

    fn group(&self) -> &str {
        self.walk.name
    }

    fn set(&self) -> Set {
        sets::of_clips(self.game.name)
    }

    fn description(&self) -> String {
        let WalkOf { map, view, .. } = self.walk;
        let of = if map.ends_with(".wad") { "the scenario" } else { "Freedoom 2," };
        let what = match view {
            View::World => "motion by re-projection, scored where the world is static",
            View::Player => {
                "with monsters, weapon and HUD; motion by re-projection of world and monsters, none of the weapon; scored everywhere"
            }
        };
        format!(
            "ViZDoom 1.3.2, {of} {map}, drawn at 1920x1080 and reduced to {}x{}, every second tic of 35 a second; {what}",
            SIZE.0, SIZE.1
        )
    }

    fn targets(&self) -> &[Target] {
        &self.targets
    }

    fn anchors(&self) -> usize {
        TICS / 2
    }

    fn anchor(&mut self, number: usize, store: &Store) -> Result<Picture> {
        self.picture(2 * number, store)
    }

    fn truth(&mut self, number: usize, phase: Phase, store: &Store) -> Result<Picture> {
        phase.must_be_half()?;
        self.picture(2 * number - 1, store)
    }

    fn guidance(&mut self, number: usize, store: &Store) -> Result<Option<Guidance>> {
        let cameras = self.cameras(store)?;
        let (now, before) = (cameras[2 * number], cameras[2 * number - 2]);
        let distances = self.plane(Plane::Depth, 2 * number, store)?;
        let things = self.plane(Plane::Thing, 2 * number, store)?;
        let steps = self.plane(Plane::Steps, 2 * number, store)?;
        let vectors = (0..).zip(&distances).zip(&things).map(|((i, distance), thing)| {
            let pixel = [f64::from(i % SIZE.0), f64::from(i / SIZE.0)];
            let thing = *thing as usize;
            if thing == VIEW {
                return [f16::ZERO; 2];
            }
            let moved = [0, 1, 2].map(|axis| f64::from(steps[3 * thing + axis]));
            now.motion(pixel, f64::from(*distance), moved, &before).map(f16::from_f64)
        });
        let motion = MotionField::from_vectors(SIZE.0, SIZE.1, vectors.collect())?;
        let vertical_fov = 2.0 * (f64::from(SIZE.1) / 2.0 / FOCAL[1]).atan();
        let projection = Projection::new(NEAR, FAR, vertical_fov as f32)?;
        let depth = distances.iter().map(|distance| projection.device_depth(distance.min(FAR))).collect();
        let depth = DepthMap::from_host(SIZE.0, SIZE.1, depth, Default::default(), projection)?;
        Guidance::from_parts(motion, depth, MotionOrigin::Geometry).map(Some)
    }

    fn overlay(&mut self, number: usize, store: &Store) -> Result<Option<Vec<u8>>> {
        if self.walk.view == View::World {
            return Ok(None);
        }
        let opacity = self.plane(Plane::Overlay, 2 * number, store)?;
        Ok(Some(opacity.into_iter().map(|value| value as u8).collect()))
    }

    fn scored(&mut self, number: usize, _phase: Phase, store: &Store) -> Result<Option<Vec<bool>>> {
        if self.walk.view == View::Player {
            return Ok(None);
        }
        let world = self.plane(Plane::World, 2 * number - 1, store)?;
        Ok(Some(world.iter().map(|value| *value > 0.0).collect()))
    }
}

impl Camera {
    /// From x, y, z, the angle in degrees and the row straight ahead.
    fn new(values: &[f32]) -> Self {
        let [x, y, z, angle, middle] = [0, 1, 2, 3, 4].map(|i| values.get(i).copied().map_or(0.0, f64::from));
        Self { position: [x, y, z], angle: angle.to_radians(), middle }
    }

    /// The axes ahead and to the right, from above.
    fn axes(&self) -> [[f64; 2]; 2] {
        let (sin, cos) = self.angle.sin_cos();
        [[cos, sin], [sin, -cos]]
    }

    /// Motion of the point at `pixel` and `distance` along the view axis, in pixels, to its position for the camera `before`, since when
    /// it has itself moved by `moved`.
    ///
    /// The sky, at infinite distance, rotates with the camera and keeps its row, because the game paints it on a cylinder.
    fn motion(&self, pixel: [f64; 2], distance: f64, moved: [f64; 3], before: &Self) -> [f64; 2] {
        let slope = [(pixel[0] - CENTRE) / FOCAL[0], (self.middle - pixel[1]) / FOCAL[1]];
        let is_sky = distance.is_infinite();
        let ([ahead, right], reach) = (self.axes(), if is_sky { 1.0 } else { distance });
        let step = |i: usize| if is_sky { 0.0 } else { self.position[i] - before.position[i] - moved[i] };
        let at = [0, 1].map(|i| step(i) + reach * (ahead[i] + slope[0] * right[i]));
        let along = |axis: [f64; 2]| at[0] * axis[0] + at[1] * axis[1];
        let [ahead, right] = before.axes().map(along);
        if ahead <= 0.0 {
            // The point is behind the earlier camera.
            return [f64::INFINITY; 2];
        }
        let x = CENTRE + FOCAL[0] * right / ahead - pixel[0];
        let y = before.middle - FOCAL[1] * (step(2) + reach * slope[1]) / ahead - pixel[1];
        [x, if is_sky { 0.0 } else { y }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pixel at which a camera sees a point.
    fn seen(camera: &Camera, point: [f64; 3]) -> [f64; 2] {
        let from = [0, 1, 2].map(|i| point[i] - camera.position[i]);
        let [ahead, right] = camera.axes().map(|axis| from[0] * axis[0] + from[1] * axis[1]);
        [CENTRE + FOCAL[0] * right / ahead, camera.middle - FOCAL[1] * from[2] / ahead]
    }

    #[test]
    fn every_walk_has_all_tics() {
        for walk in GAMES.iter().flat_map(|game| game.walks) {
            let stretches = walk.walk.split(',').map(|stretch| stretch.split(':').collect::<Vec<_>>());
            let tics: usize = stretches.map(|stretch| stretch[2].parse::<usize>().unwrap()).sum();
            assert_eq!(tics, TICS, "{}", walk.name);
        }
    }

    #[test]
    fn motion_leads_to_where_the_earlier_camera_saw_the_point() {
        let now = Camera::new(&[10.0, -5.0, 41.0, 93.0, 150.5]);
        let before = Camera::new(&[8.0, -11.0, 40.0, 90.0, 150.5]);
        let moved = [3.0, -2.0, 1.0];
        for (point, moved) in [
            ([12.0, 60.0, 0.0], [0.0; 3]),
            ([-40.0, 300.0, 90.0], moved),
            ([10.0, 80.0, 41.0], [0.0; 3]),
            ([12.0, 60.0, 0.0], moved),
        ] {
            let earlier = [0, 1, 2].map(|i| point[i] - moved[i]);
            let (pixel, expected) = (seen(&now, point), seen(&before, earlier));
            let ahead = now.axes()[0];
            let distance = (point[0] - now.position[0]) * ahead[0] + (point[1] - now.position[1]) * ahead[1];
            let motion = now.motion(pixel, distance, moved, &before);
            for i in 0..2 {
                assert!((pixel[i] + motion[i] - expected[i]).abs() < 1e-9, "{point:?}: {motion:?}");
            }
        }
    }

    #[test]
    fn the_sky_turns_with_the_camera_and_no_step_moves_it() {
        let now = Camera::new(&[500.0, 0.0, 41.0, 90.0, 150.5]);
        let before = Camera::new(&[0.0, 0.0, 20.0, 84.0, 150.5]);
        let motion = now.motion([CENTRE, 20.0], f64::INFINITY, [0.0; 3], &before);
        // After a turn to the left by 6 degrees, the point ahead was 6 degrees to the left before.
        assert!((motion[0] + FOCAL[0] * 6f64.to_radians().tan()).abs() < 1e-9 && motion[1] == 0.0, "{motion:?}");
        let near = now.motion([CENTRE, 20.0], 1.0, [0.0; 3], &Camera::new(&[500.0, 90.0, 41.0, 90.0, 150.5]));
        assert!(near[0].is_infinite());
    }
}
