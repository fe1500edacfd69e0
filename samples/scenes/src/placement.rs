//! Places the moving things of a scene along the walk of its family's script, so that the walk meets them.

use std::f32::consts::TAU;
use std::sync::Arc;

use cairn::world::{ControlScript, WorldTime};
use glam::{Mat3, Vec2, Vec3};

use crate::actors;
use crate::animation::{Animation, Bird, Figure, Rig, RigidMotion};
use crate::cast::Cast;
use crate::family::Family;
use crate::lamp::{Lamp, Mount};
use crate::material::Material;
use crate::mesh::{Mesh, TriangleMaterial};
use crate::noise::Rng;
use crate::particles::{AirKind, Emitter};
use crate::pose::Route;
use crate::scene::{Chunk, Scene};
use crate::terrain::Terrain;
use crate::walk::Walker;

/// Seconds of the walk along which things are placed; the scripts last 15.
const SECONDS: u32 = 18;
/// Known moments of the walk per second.
const RATE: u32 = 4;
/// Steps of the walker per second, as a clip's.
const STEPS: u32 = 120;
/// Farthest distance at which a figure counts as met, in metres.
const NEARBY: f32 = 13.0;
/// Half the angle within which things count as in view, in radians: most of a 16:9 picture's width.
const HALF_VIEW: f32 = 0.62;

/// The viewer at one moment of the walk.
#[derive(Clone, Copy)]
struct Spot {
    at: Vec2,
    yaw: f32,
    eye: f32,
}

impl Spot {
    /// The point of the ground at `distance` metres, `angle` radians to the right of the view.
    fn ahead(&self, distance: f32, angle: f32) -> Vec2 {
        let (sin, cos) = (self.yaw + angle).sin_cos();
        self.at + Vec2::new(sin, cos) * distance
    }
}

/// Adds the moving things of `cast` to a scene that is complete but for its shadows.
pub(crate) fn populate(scene: &mut Scene, cast: Cast) {
    let mut placer = Placer { spots: spots(scene), ground: Arc::new(scene.terrain.clone()), scene };
    // Each kind has its own sequence of numbers, so that one does not displace another.
    let seed = placer.scene.seed ^ (placer.scene.family as u64) << 40;
    let rng = |kind: u64| Rng::new(seed ^ 0xca57_0000 ^ kind << 48);
    if cast.figures {
        placer.figures(cast.lights, &mut rng(1));
    }
    if cast.birds {
        placer.birds(&mut rng(2));
    }
    if cast.bodies {
        placer.ball(&mut rng(3));
        placer.boxes(&mut rng(4));
    }
    if cast.doors {
        placer.gates(&mut rng(5));
    }
    if cast.water {
        placer.water(&mut rng(6));
    }
    if cast.particles {
        placer.fires(&mut rng(7));
        let (kind, count) = match placer.scene.family {
            Family::Snow => (AirKind::Snow, 1400),
            Family::Town => (AirKind::Snow, 700),
            _ => (AirKind::Dust, 500),
        };
        placer.scene.emitters.push(Emitter::Air { kind, count, seed: seed as u32 });
    }
    if cast.flashes {
        let light = Vec3::new(1.0, 0.72, 0.36) * if placer.scene.family.is_dark() { 5.0 } else { 22.0 };
        placer.scene.lamps.push(Lamp { mount: Mount::Muzzle, light, reach: 12.0 });
        placer.scene.emitters.push(Emitter::Muzzle);
    }
    if cast.lights {
        let light = Vec3::new(1.0, 0.93, 0.80) * if placer.scene.family.is_dark() { 3.0 } else { 16.0 };
        placer.scene.lamps.push(Lamp { mount: Mount::Headlamp, light, reach: 16.0 });
    }
}

/// The walk of the family's script.
fn spots(scene: &Scene) -> Vec<Spot> {
    let script = ControlScript::parse(scene.family.script()).expect("the scripts of the families are tested");
    let mut walker = Walker::new(scene);
    let mut spots = Vec::new();
    for step in 0..u64::from(SECONDS * STEPS) {
        if step % u64::from(STEPS / RATE) == 0 {
            let camera = walker.moment(1.0).camera;
            let at = Vec2::new(camera.position.x, camera.position.z);
            spots.push(Spot { at, yaw: camera.yaw, eye: camera.position.y });
        }
        let input = script.span(WorldTime::new(step, STEPS), WorldTime::new(step + 1, STEPS));
        walker.step(scene, &input.expect("the scripts of the families are tested"), 1.0 / f64::from(STEPS));
    }
    spots
}

struct Placer<'a> {
    scene: &'a mut Scene,
    spots: Vec<Spot>,
    ground: Arc<Terrain>,
}

impl Placer<'_> {
    fn spot(&self, time: f32) -> Spot {
        self.spots[((time * RATE as f32) as usize).min(self.spots.len() - 1)]
    }

    /// Times of the walk's known moments.
    fn times(&self) -> impl Iterator<Item = (f32, Spot)> + '_ {
        self.spots.iter().enumerate().map(|(n, spot)| (n as f32 / RATE as f32, *spot))
    }

    /// Whether something of half width `room` has no place at `at`.
    fn is_taken(&self, at: Vec2, room: f32) -> bool {
        self.scene.obstacles.iter().any(|&(centre, radius)| centre.distance(at) < radius + room)
            || self.scene.walls.iter().any(|&(low, high)| {
                let nearest = at.clamp(Vec2::new(low.x, low.z), Vec2::new(high.x, high.z));
                let floor = self.ground.height(at);
                low.y < floor + 1.7 && high.y > floor + 0.1 && nearest.distance(at) < room
            })
    }

    /// Whether an obstacle or a wall is between the viewer and `at`.
    fn is_hidden(&self, spot: &Spot, at: Vec2) -> bool {
        let (way, far) = (at - spot.at, at.distance(spot.at));
        let along = way / far.max(1e-3);
        self.scene.obstacles.iter().any(|&(centre, radius)| {
            let to = centre - spot.at;
            let depth = to.dot(along);
            depth > 0.3 && depth < far - 0.3 && (to - along * depth).length() < radius
        }) || self.scene.walls.iter().any(|&(low, high)| {
            low.y < spot.eye && high.y > spot.eye && {
                let inverse = way.recip();
                let (s, t) =
                    ((Vec2::new(low.x, low.z) - spot.at) * inverse, (Vec2::new(high.x, high.z) - spot.at) * inverse);
                let (enters, leaves) = (s.min(t).max_element(), s.max(t).min_element());
                enters < leaves && leaves > 0.0 && enters < 1.0
            }
        })
    }

    /// How many known moments show a thing that is at `position` of the time.
    fn meetings(&self, position: impl Fn(f32) -> Vec2) -> i32 {
        let seen = |time: f32, spot: &Spot| {
            let at = position(time);
            let (sin, cos) = spot.yaw.sin_cos();
            let to = at - spot.at;
            let (right, depth) = (to.x * cos - to.y * sin, to.x * sin + to.y * cos);
            (1.6..NEARBY).contains(&depth) && right.abs() < depth * HALF_VIEW.tan() && !self.is_hidden(spot, at)
        };
        self.times().filter(|(time, spot)| seen(*time, spot)).count() as i32
    }

    fn push(&mut self, mesh: Mesh, animation: Animation) -> usize {
        self.scene.chunks.push(Chunk::animated(mesh, animation));
        self.scene.chunks.len() - 1
    }

    /// Figures that walk to and fro; of many routes for each, the one on which the walk sees it longest.
    fn figures(&mut self, lights: bool, rng: &mut Rng) {
        const COUNT: u32 = 7;
        for k in 0..COUNT {
            let lantern = lights && k == 0;
            let time = 0.8 + k as f32 * 14.0 / COUNT as f32;
            let spot = self.spot(time);
            let (speed, scale) = (rng.range(1.05, 1.5), rng.range(0.92, 1.08));
            let mut best: Option<(i32, Route, f32)> = None;
            for _ in 0..48 {
                let middle = spot.ahead(rng.range(3.2, 7.5), rng.range(-0.4, 0.4));
                let angle = match self.scene.family {
                    Family::Indoors | Family::Town => (rng.bits() % 4) as f32 * TAU / 4.0,
                    _ => rng.range(0.0, TAU),
                };
                let along = Vec2::from_angle(angle) * rng.range(2.5, 8.0);
                let side = along.perp().normalize() * 0.4;
                let corners =
                    [middle - along - side, middle + along - side, middle + along + side, middle - along + side];
                let route = Route::closed(corners.to_vec());
                let start = along.length() - speed * time;
                let at = |time: f32| route.at(start + speed * time).0;
                let samples = (route.length() / 0.4) as u32;
                let hits = (0..samples).filter(|n| self.is_taken(route.at(*n as f32 * 0.4).0, 0.38)).count() as i32;
                let bumps = self.times().filter(|(t, spot)| at(*t).distance(spot.at) < 1.3).count() as i32;
                let score = self.meetings(at) - 4 * hits - 3 * bumps;
                if best.as_ref().is_none_or(|(least, ..)| score > *least) {
                    best = Some((score, route, start));
                }
            }
            let Some((_, route, start)) = best else { continue };
            let skin = actors::figure(scale, lantern, rng);
            let figure = Figure { route, ground: Arc::clone(&self.ground), start, speed, scale, lantern };
            let chunk = self.push(skin.mesh, Animation::Skeleton { rig: Rig::Figure(figure), bones: skin.bones });
            if lantern {
                let light = Vec3::new(1.0, 0.66, 0.30) * if self.scene.family.is_dark() { 4.5 } else { 9.0 };
                self.scene.lamps.push(Lamp { mount: Mount::Lantern(chunk), light, reach: 8.0 });
            }
        }
    }

    /// A flock that flies to and fro in front of the viewer.
    fn birds(&mut self, rng: &mut Rng) {
        let indoors = self.scene.family == Family::Indoors;
        // Butterflies indoors: smaller, nearer, slower.
        let (size, far, high, weave, count) =
            if indoors { (0.22, 3.2, 0.25, 0.7, 6) } else { (1.5, 15.0, 4.2, 6.0, 12) };
        let flock: Vec<Vec3> = (0..SECONDS)
            .map(|second| {
                // The mean direction of view of two seconds, so that the flock does not jerk with the viewer's head.
                let around: Vec<Spot> = (0..=8).map(|n| self.spot(second as f32 + (n as f32 - 4.0) * 0.25)).collect();
                let yaw = around.iter().map(|spot| spot.yaw).sum::<f32>() / around.len() as f32;
                let spot = Spot { yaw, ..around[4] };
                let at = spot.ahead(far, 0.0);
                Vec3::new(at.x, (spot.eye + high).max(self.ground.height(at) + high * 0.8), at.y)
            })
            .collect();
        let flock: Arc<[Vec3]> = flock.into();
        for _ in 0..count {
            let spread = rng.direction() * Vec3::new(1.0, 0.45, 1.0) * rng.range(0.2, 0.55) * weave;
            let scale = size * rng.range(0.85, 1.15);
            let skin = actors::bird(scale, rng);
            let bird = Bird {
                flock: Arc::clone(&flock),
                offset: spread,
                phase: rng.range(0.0, TAU),
                beats: rng.range(2.6, 3.4),
                weave,
                scale,
            };
            self.push(skin.mesh, Animation::Skeleton { rig: Rig::Bird(bird), bones: skin.bones });
        }
    }

    /// A ball that rolls ahead of the viewer.
    fn ball(&mut self, rng: &mut Rng) {
        let radius = if self.scene.family == Family::Indoors { 0.16 } else { 0.3 };
        let mut way: Vec<Vec2> = self.spots.iter().step_by(4).map(|spot| spot.at).collect();
        way.dedup_by(|a, b| a.distance(*b) < 0.3);
        let [.., before, last] = way[..] else { return };
        let onward = (last - before).normalize_or(Vec2::Y);
        let mut end = last;
        while end.distance(last) < 12.0 && !self.is_taken(end + onward * 0.4, radius + 0.1) {
            end += onward * 0.4;
        }
        way.push(end);
        let route = Route::open(way);
        let (lead, walk) = (4.0, route.length() - end.distance(last));
        // The speed of the walk on average, so that the ball stays ahead.
        let body =
            RigidMotion::Roll { route, ground: Arc::clone(&self.ground), start: lead, speed: walk / 15.0, radius };
        let mesh = actors::ball(radius, rng);
        self.push(mesh, Animation::Rigid(body));
    }

    /// Wooden boxes that fall and bounce beside the walk.
    fn boxes(&mut self, rng: &mut Rng) {
        let half = 0.24;
        let low = self.scene.family == Family::Indoors;
        for k in 0..5 {
            let spot = self.spot(0.6 + 3.2 * k as f32);
            let mut best: Option<(i32, Vec2)> = None;
            for _ in 0..32 {
                let at = spot.ahead(rng.range(3.4, 7.0), rng.range(-0.5, 0.5));
                let bumps = self.times().filter(|(_, spot)| spot.at.distance(at) < 0.9).count() as i32;
                let score = self.meetings(|_| at) - 20 * i32::from(self.is_taken(at, 0.5)) - 4 * bumps;
                if best.is_none_or(|(least, _)| score > least) {
                    best = Some((score, at));
                }
            }
            let Some((_, at)) = best else { continue };
            // A spinning box touches the ground with its corners: its centre stays as far up as they reach.
            let floor = Vec3::new(at.x, self.ground.mesh_height(at) + half * 1.6, at.y);
            let heights = if low { [1.2, 0.8, 0.5, 0.3] } else { [2.4, 1.5, 0.9, 0.5] };
            let body = RigidMotion::Bounce { floor, heights, offset: rng.range(0.0, 4.0), spin: rng.range(1.2, 2.4) };
            let mesh = actors::crate_box(half, rng);
            self.push(mesh, Animation::Rigid(body));
        }
    }

    /// Water beside the walk: a stone basin or, on a street, puddles. All of it lies at one height, so that one mirror image serves it.
    fn water(&mut self, rng: &mut Rng) {
        let surface = TriangleMaterial { material: Material::Water, variant: 0 };
        let mut mesh = Mesh::default();
        if self.scene.family == Family::Town {
            let height = 0.034;
            for k in 0..14 {
                let at = self.spot(k as f32).ahead(rng.range(3.0, 7.0), rng.range(-0.45, 0.45));
                pool(&mut mesh, Vec3::new(at.x, height, at.y), rng.range(0.5, 1.3), 0.28, rng, surface);
            }
            self.scene.water = Some(height);
        } else {
            let radius = if self.scene.family == Family::Indoors { 1.1 } else { 2.0 };
            let mut best: Option<(i32, Vec2)> = None;
            for _ in 0..96 {
                let spot = self.spot(rng.range(0.5, 12.0));
                let at = spot.ahead(rng.range(4.0, 8.0), rng.range(-0.55, 0.55));
                let bumps = self.times().filter(|(_, spot)| spot.at.distance(at) < radius + 0.8).count() as i32;
                let score = self.meetings(|_| at) - 30 * i32::from(self.is_taken(at, radius + 0.3)) - 6 * bumps;
                if best.is_none_or(|(least, _)| score > least) {
                    best = Some((score, at));
                }
            }
            let Some((_, at)) = best else { return };
            let ring = (0..12).map(|n| Vec2::from_angle(n as f32 * TAU / 12.0) * radius + at);
            let (low, high) = ring
                .chain([at])
                .map(|p| self.ground.mesh_height(p))
                .fold((f32::MAX, f32::MIN), |(low, high), h| (low.min(h), high.max(h)));
            let height = high + 0.24;
            pool(&mut mesh, Vec3::new(at.x, height, at.y), radius, 0.0, rng, surface);
            let mut rim = Mesh::default();
            for n in 0..16 {
                let turn = n as f32 * TAU / 16.0;
                let mut stone = Mesh::default();
                let half = radius * (TAU / 32.0).tan() * 1.02;
                let block = TriangleMaterial { material: Material::Rock, variant: (rng.bits() & 255) as u8 };
                stone.block(
                    Vec3::new(-half, low - height - 0.3, -0.16),
                    Vec3::new(half, rng.range(0.09, 0.12), 0.16),
                    block,
                );
                let centre = Vec2::new(turn.sin(), turn.cos()) * (radius + 0.1) + at;
                rim.add_instance(&stone, Vec3::new(centre.x, height, centre.y), Mat3::from_rotation_y(turn), Vec3::ONE);
            }
            self.scene.chunks.push(Chunk::new(rim));
            self.scene.obstacles.push((at, radius + 0.2));
            self.scene.water = Some(height);
        }
        self.scene.chunks.push(Chunk::new(mesh));
    }

    /// Small fires beside the walk.
    fn fires(&mut self, rng: &mut Rng) {
        for k in 0..4 {
            let spot = self.spot(1.0 + 3.5 * k as f32);
            let mut best: Option<(i32, Vec2)> = None;
            for _ in 0..32 {
                let at = spot.ahead(rng.range(4.0, 8.0), rng.range(-0.55, 0.55));
                let bumps = self.times().filter(|(_, spot)| spot.at.distance(at) < 1.0).count() as i32;
                let score = self.meetings(|_| at) - 20 * i32::from(self.is_taken(at, 0.5)) - 4 * bumps;
                if best.is_none_or(|(least, _)| score > least) {
                    best = Some((score, at));
                }
            }
            let Some((_, at)) = best else { continue };
            let foot = Vec3::new(at.x, self.ground.mesh_height(at), at.y);
            let mut bowl = Mesh::default();
            let iron = TriangleMaterial { material: Material::Leather, variant: 6 };
            bowl.tube(&[(foot, 0.1), (foot + Vec3::Y * 0.35, 0.12), (foot + Vec3::Y * 0.55, 0.3)], 12, 0.0, 1, iron);
            let ember = TriangleMaterial { material: Material::Glow, variant: 0 };
            bowl.block(foot + Vec3::new(-0.17, 0.55, -0.17), foot + Vec3::new(0.17, 0.69, 0.17), ember);
            self.scene.chunks.push(Chunk::new(bowl));
            self.scene.emitters.push(Emitter::Fire { at: foot + Vec3::Y * 0.65, seed: rng.bits() });
        }
    }

    /// Gates across the walk that open before the viewer.
    fn gates(&mut self, rng: &mut Rng) {
        if matches!(self.scene.family, Family::Indoors | Family::Town) {
            return;
        }
        let width = 1.7;
        for time in [3.0, 6.2, 9.0, 12.5, 15.0] {
            let (here, next) = (self.spot(time), self.spot(time + 0.5));
            let way = next.at - here.at;
            if way.length() < 0.3 {
                continue;
            }
            let along = way.normalize();
            let across = along.perp();
            let hinge = here.at + across * width * 0.5;
            let at = Vec3::new(hinge.x, self.ground.mesh_height(hinge), hinge.y);
            // The gate's x axis leads from the hinge across the way.
            let yaw = across.y.atan2(-across.x);
            let mut posts = Mesh::default();
            posts.add_instance(&actors::gate_posts(width, rng), at, Mat3::from_rotation_y(yaw), Vec3::ONE);
            self.scene.chunks.push(Chunk::new(posts));
            let body = RigidMotion::Hinge { at, yaw, angle: 1.6, opens: time, period: 7.0 };
            let leaf = actors::gate_leaf(width, rng);
            self.push(leaf, Animation::Rigid(body));
        }
    }
}

/// A level surface of about `radius` metres with an outline that varies by the fraction `rough`.
fn pool(mesh: &mut Mesh, centre: Vec3, radius: f32, rough: f32, rng: &mut Rng, surface: TriangleMaterial) {
    const SIDES: u32 = 32;
    let phases = [rng.range(0.0, TAU), rng.range(0.0, TAU)];
    let middle = mesh.vertex(centre, Vec3::Y);
    let rim: Vec<u32> = (0..SIDES)
        .map(|n| {
            let turn = n as f32 * TAU / SIDES as f32;
            let out = radius * (1.0 + rough * ((2.0 * turn + phases[0]).sin() + 0.6 * (5.0 * turn + phases[1]).sin()));
            mesh.vertex(centre + Vec3::new(turn.sin(), 0.0, turn.cos()) * out, Vec3::Y)
        })
        .collect();
    for n in 0..rim.len() {
        mesh.triangle([middle, rim[n], rim[(n + 1) % rim.len()]], surface);
    }
}
