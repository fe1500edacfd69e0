//! Renders a scene: colour, device depth and exact motion.

use std::sync::Arc;

use cairn::Picture;
use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use crate::camera::{Camera, FAR, NEAR, View, device_depth};
use crate::geometry::{FrameGeometry, MovedChunk};
use crate::lamp::LitLamp;
use crate::light::{SurfacePoint, srgb, tone_map};
use crate::material::{Material, emission, material_at};
use crate::particles::ParticleLayer;
use crate::pose::Pose;
use crate::raster::{SKY, ScreenTriangle, Visibility, clip};
use crate::scene::{Chunk, Scene};
use crate::shadow::ShadowMap;
use crate::water;

/// Camera and walk state at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The camera.
    pub camera: Camera,
    /// Metres walked so far; a held item sways with the steps.
    pub walked: f32,
    /// Seconds since the start; a held item also moves slightly with time.
    pub time: f32,
    /// Number of the shot, counted from 0. A camera cut begins another one, and no point has motion from one shot to another.
    pub shot: u32,
    /// Shift of the picture's content in pixels, right and down: the sub-pixel camera jitter of temporal anti-aliasing. Zero without jitter.
    pub jitter: Vec2,
}

impl Moment {
    /// The camera's view for a picture of `width` x `height` pixels, with the jitter.
    pub fn view(&self, width: u32, height: u32) -> View {
        let view = self.camera.view(width, height);
        View { centre: view.centre + self.jitter, ..view }
    }

    /// A moment on the straight line from this one to `later` of the same shot: at share `part`, 0 to 1, of camera position, angles, walk and
    /// time. Everything else is that of `later`.
    pub fn towards(&self, later: &Self, part: f32) -> Self {
        let mix = |from: f32, to: f32| from + (to - from) * part;
        Self {
            camera: Camera {
                position: self.camera.position.lerp(later.camera.position, part),
                yaw: mix(self.camera.yaw, later.camera.yaw),
                pitch: mix(self.camera.pitch, later.camera.pitch),
                ..later.camera
            },
            walked: mix(self.walked, later.walked),
            time: mix(self.time, later.time),
            ..*later
        }
    }
}

/// One picture with its ground truth.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Display-referred sRGB.
    pub picture: Picture,
    /// Device depth of each pixel's centre, 0 at [`NEAR`] and 1 at [`crate::camera::FAR`]; the sky is 1.
    pub depth: Vec<f32>,
    /// Motion of each pixel's centre, in pixels and y down: position of the same point in the previous picture minus its current position,
    /// each with its picture's jitter. Non-finite if the point was behind the eye, and everywhere if the previous picture is of another shot.
    pub motion: Vec<Vec2>,
    /// The part of [`motion`](Self::motion) that the camera alone causes: motion of a point that stands still in the world. Same units and sign.
    pub camera_motion: Vec<Vec2>,
    /// What each pixel's centre shows.
    pub surfaces: Vec<MotionKind>,
    /// Whether the colour at the pixel's centre may change without motion: a moving shadow or a moving lamp falls on it, or its surface mirrors what
    /// is around it (gloss above [`MIRRORS`]), which depends on the direction of view.
    pub changing_light: Vec<bool>,
    /// Share of alpha-blended particles in each pixel's colour, 0 to 1.
    pub particle_cover: Vec<f32>,
}

/// What a pixel shows, as a game engine's renderer tells its passes apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MotionKind {
    /// Nothing but the sky.
    Sky,
    /// Geometry at rest in the world.
    Still,
    /// A rigid body that moves through the world.
    Rigid,
    /// Geometry that bends: limbs of a figure, wings, grass and leaves in the wind.
    Skinned,
    /// An item held in view, at rest relative to the camera except for its own sway.
    Held,
}

/// Gloss above which a surface visibly mirrors what is around it.
pub const MIRRORS: f32 = 0.1;

/// Render quality.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quality {
    /// Colour samples per pixel and axis, 1 to 8. Use at least two for pictures that people look at.
    pub samples: u32,
}

impl Default for Quality {
    fn default() -> Self {
        Self { samples: 2 }
    }
}

/// Pose of a held item in view space.
fn held_pose(moment: &Moment) -> Pose {
    let step = moment.walked * 4.2;
    let breath = moment.time * 1.7;
    let translation = Vec3::new(0.006 * (step * 0.5).sin(), 0.004 * step.sin() + 0.002 * breath.sin(), 0.0);
    Pose {
        rotation: Mat3::from_rotation_z(0.008 * (step * 0.5).sin()) * Mat3::from_rotation_x(0.004 * breath.sin()),
        translation,
    }
}

/// Renders `scene` as seen at `now`, with motion to `before`, at `width` x `height` pixels.
///
/// Uses all threads of the current rayon pool; the result does not depend on their number.
pub fn render(scene: &Scene, now: &Moment, before: &Moment, width: u32, height: u32, quality: Quality) -> Frame {
    draw(scene, now, before, width, height, quality, Outputs::All)
}

/// The picture of [`render`] alone, bit for bit: without depth, motion and the rest it takes three quarters of the time.
pub fn render_picture(scene: &Scene, now: &Moment, width: u32, height: u32, quality: Quality) -> Picture {
    draw(scene, now, now, width, height, quality, Outputs::PictureOnly).picture
}

/// Which parts of a frame are rendered.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Outputs {
    All,
    /// The other parts of the frame are not valid.
    PictureOnly,
}

/// Renders a frame.
fn draw(
    scene: &Scene,
    now: &Moment,
    before: &Moment,
    width: u32,
    height: u32,
    quality: Quality,
    outputs: Outputs,
) -> Frame {
    let s = quality.samples.clamp(1, 8);
    let view = now.view(width, height);
    let pose = held_pose(now);
    let frustum = Frustum::new(&view, width, height);
    let mut moving_shadow = scene.chunks.iter().any(Chunk::moves).then(|| {
        let ahead = Vec3::new(view.axes[2].x, 0.0, view.axes[2].z).normalize_or_zero();
        ShadowMap::around(view.eye + ahead * SHADOW_LEAD, scene.weather.sun)
    });
    let geometry = FrameGeometry::new(scene, now.time, before.time, |centre, radius| {
        frustum.shows(&view, centre, radius) || moving_shadow.as_ref().is_some_and(|map| map.has(centre, radius))
    });
    if let Some(map) = &mut moving_shadow {
        let casters: Vec<(&[Vec3], &[[u32; 3]])> = geometry
            .all_moved()
            .filter(|(_, moved)| map.has(moved.ball.0, moved.ball.1))
            .map(|(n, moved)| (moved.now.as_slice(), scene.chunks[n].mesh.triangles.as_slice()))
            .collect();
        map.cast(&casters);
    }
    let triangles = project(&geometry, &view, &frustum, &pose, None);
    let (w, h) = (width as usize, height as usize);
    let needs_centres = outputs == Outputs::All || s == 1 || !scene.emitters.is_empty();
    let centres = needs_centres.then(|| Visibility::draw(w, h, 0.0, &triangles));
    let fine = (s > 1).then(|| {
        let mut scaled = triangles;
        scaled.par_iter_mut().for_each(|t| t.at.iter_mut().for_each(|p| *p *= s as f32));
        Visibility::draw(w * s as usize, h * s as usize, 0.0, &scaled)
    });
    let lamps: Vec<LitLamp> = scene.lamps.iter().map(|lamp| lamp.at(now, &scene.chunks, &scene.walls)).collect();
    let mut painter = FrameRenderer {
        scene,
        geometry: &geometry,
        moving_shadow: moving_shadow.as_ref(),
        lamps: &lamps,
        view,
        pose,
        previous: before.view(width, height),
        old_pose: held_pose(before),
        time: now.time,
        reflection: None,
    };
    if let Some(level) = scene.water.filter(|level| *level < view.eye.y && geometry.shows_water(&view, &frustum)) {
        let mirrored = water::mirrored_view(&view, level);
        let above = project(&geometry, &mirrored, &frustum, &pose, Some(level + ABOVE_WATER));
        let renderer = FrameRenderer { view: mirrored, ..painter.clone() };
        painter.reflection = Some(Arc::new(Reflection { seen: Visibility::draw(w, h, 0.0, &above), renderer }));
    }
    let particles = (!scene.emitters.is_empty())
        .then(|| ParticleLayer::new(&scene.emitters, now, &view, height, |p| painter.particle_light(p)));

    let mut picture = vec![[0_u8; 4]; w * h];
    let mut depth = vec![1.0_f32; w * h];
    let mut motion = vec![[Vec2::ZERO; 2]; w * h];
    let mut seen = vec![(MotionKind::Sky, false, 0.0); w * h];
    let rows = picture.par_chunks_mut(w).zip(depth.par_chunks_mut(w)).zip(motion.par_chunks_mut(w));
    rows.zip(seen.par_chunks_mut(w)).enumerate().for_each(|(y, (((colours, depths), motions), seen))| {
        for x in 0..w {
            let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let hit = centres.as_ref().and_then(|centres| painter.hit(centres.ids[y * w + x], at));
            let mut light = match &fine {
                None => tone_map(painter.light(hit.as_ref(), at)),
                Some(fine) => painter.mean(fine, x, y, s as usize),
            };
            let mut cover = 0.0;
            if let Some(particles) = &particles {
                (light, cover) = particles.over(light, at, hit.as_ref().map_or(FAR, |h| h.view.z));
            }
            colours[x] = srgb(light);
            if outputs == Outputs::PictureOnly {
                continue;
            }
            depths[x] = hit.as_ref().map_or(1.0, |h| device_depth(h.view.z));
            motions[x] = [painter.motion(hit.as_ref(), at), painter.camera_motion(hit.as_ref(), at)];
            seen[x] = match &hit {
                None => (MotionKind::Sky, false, cover),
                Some(h) => (h.kind(), painter.has_changing_light(h), cover),
            };
        }
    });
    let rgba = picture.into_flattened();
    let picture = Picture::from_rgba(width, height, rgba).expect("the buffer has the size that was asked for");
    if now.shot != before.shot {
        motion.fill([Vec2::NAN; 2]);
    }
    let (motion, camera_motion) = motion.into_iter().map(|[all, camera]| (all, camera)).unzip();
    let surfaces = seen.iter().map(|(kind, ..)| *kind).collect();
    let changing_light = seen.iter().map(|(_, changes, _)| *changes).collect();
    let particle_cover = seen.iter().map(|(.., cover)| *cover).collect();
    Frame { picture, depth, motion, camera_motion, surfaces, changing_light, particle_cover }
}

/// Distance ahead of the viewer of the centre of the moving things' shadow map, in metres.
const SHADOW_LEAD: f32 = 22.0;

/// Height over the water from which on things are mirrored, in metres: what is level with it is not.
const ABOVE_WATER: f32 = 0.004;

/// The pyramid that a view shows.
pub(crate) struct Frustum {
    /// Slopes of the sides.
    slope: Vec2,
    /// Lengths of the sides' normals.
    length: Vec2,
}

impl Frustum {
    fn new(view: &View, width: u32, height: u32) -> Self {
        let size = Vec2::new(width as f32, height as f32);
        let slope = (size * 0.5 + (view.centre - size * 0.5).abs()) / view.focal;
        Self { slope, length: (slope * slope + Vec2::ONE).map(f32::sqrt) }
    }

    /// Whether a ball may be in view.
    pub(crate) fn shows(&self, view: &View, centre: Vec3, radius: f32) -> bool {
        let v = view.to_view(centre);
        v.z > NEAR - radius
            && v.x.abs() < v.z * self.slope.x + radius * self.length.x
            && v.y.abs() < v.z * self.slope.y + radius * self.length.y
    }
}

/// All triangles in front of the eye, in the scene's order. `above`: only what is higher than this, in metres, and not held.
fn project(
    geometry: &FrameGeometry<'_>,
    view: &View,
    frustum: &Frustum,
    pose: &Pose,
    above: Option<f32>,
) -> Vec<ScreenTriangle> {
    let parts: Vec<Vec<ScreenTriangle>> = (geometry.chunks.par_iter().enumerate())
        .filter_map(|(n, chunk)| {
            let (positions, (centre, radius)) = geometry.placed(n)?;
            if !chunk.held && !frustum.shows(view, centre, radius) || above.is_some() && chunk.held {
                return None;
            }
            let above = above.filter(|level| centre.y - radius < *level);
            let placed: Vec<Vec3> =
                positions.iter().map(|&p| if chunk.held { pose.apply(p) } else { view.to_view(p) }).collect();
            let mut out = Vec::with_capacity(chunk.mesh.triangles.len());
            for (k, t) in chunk.mesh.triangles.iter().enumerate() {
                let mut add = |corners: [Vec3; 3]| {
                    clip(corners, 2, NEAR, |corners| {
                        let at = corners.map(|p| view.project(p));
                        let near = corners.map(|p| 1.0 / p.z);
                        out.push(ScreenTriangle { at, near, id: chunk.first + k as u32 });
                    });
                };
                match above {
                    None => add(t.map(|i| placed[i as usize])),
                    Some(level) => {
                        clip(t.map(|i| positions[i as usize]), 1, level, |parts| add(parts.map(|p| view.to_view(p))));
                    }
                }
            }
            Some(out)
        })
        .collect();
    parts.concat()
}

/// Intersection of a ray.
struct Hit<'a> {
    chunk: &'a Chunk,
    /// The chunk at both times, if it moves.
    moved: Option<&'a MovedChunk>,
    triangle: usize,
    /// Position in view space.
    view: Vec3,
    /// Position in the world.
    world: Vec3,
    /// Position where the texture is fixed: in the world, in a held item's own frame, or at rest if it moves.
    position: Vec3,
    /// Barycentric coordinates in the triangle.
    weights: [f32; 3],
}

impl Hit<'_> {
    fn kind(&self) -> MotionKind {
        match self.moved {
            _ if self.chunk.held => MotionKind::Held,
            None => MotionKind::Still,
            Some(_) if self.chunk.is_rigid() => MotionKind::Rigid,
            Some(_) => MotionKind::Skinned,
        }
    }

    /// The value at the hit of what is given at the mesh's vertices.
    fn interpolate(&self, values: &[Vec3]) -> Vec3 {
        let corners = self.chunk.mesh.triangles[self.triangle];
        (0..3).map(|k| values[corners[k] as usize] * self.weights[k]).sum()
    }
}

#[derive(Clone)]
struct FrameRenderer<'a> {
    scene: &'a Scene,
    geometry: &'a FrameGeometry<'a>,
    /// Shadows of what moves near the viewer, if anything in the scene moves.
    moving_shadow: Option<&'a ShadowMap>,
    lamps: &'a [LitLamp],
    view: View,
    pose: Pose,
    previous: View,
    old_pose: Pose,
    /// Seconds since the start.
    time: f32,
    /// What water in view mirrors.
    reflection: Option<Arc<Reflection<'a>>>,
}

/// The scene as water mirrors it, at the pixels at which it is mirrored.
struct Reflection<'a> {
    seen: Visibility,
    renderer: FrameRenderer<'a>,
}

impl FrameRenderer<'_> {
    /// Intersection of the ray through `at` with the plane of triangle `id`.
    fn hit(&self, id: u32, at: Vec2) -> Option<Hit<'_>> {
        if id == SKY {
            return None;
        }
        let (n, triangle) = self.geometry.locate(id);
        let (chunk, moved) = (&self.geometry.chunks[n], self.geometry.moved(n));
        let positions = moved.map_or(&chunk.mesh.positions, |moved| &moved.now);
        let corners = chunk.mesh.triangles[triangle].map(|i| positions[i as usize]);
        let ray = self.view.ray(at);
        let (view, world, position) = if chunk.held {
            let [a, b, c] = corners.map(|p| self.pose.apply(p));
            let normal = (b - a).cross(c - a);
            let z = a.dot(normal) / ray.dot(normal);
            let view = ray * if z.is_finite() { z.max(NEAR) } else { a.z };
            (view, self.view.eye + self.view.to_world(view), self.pose.apply_inverse(view))
        } else {
            let [a, b, c] = corners;
            let normal = (b - a).cross(c - a);
            let along = self.view.to_world(ray);
            let z = (a - self.view.eye).dot(normal) / along.dot(normal);
            let z = if z.is_finite() { z.max(NEAR) } else { self.view.to_view(a).z };
            let world = self.view.eye + along * z;
            (ray * z, world, world)
        };
        let weights = barycentric(corners, position);
        let mut hit = Hit { chunk, moved, triangle, view, world, position, weights };
        if moved.is_some() {
            hit.position = hit.interpolate(&chunk.mesh.positions);
        }
        Some(hit)
    }

    /// Motion of the point seen at `at`: previous minus current pixel position.
    fn motion(&self, hit: Option<&Hit<'_>>, at: Vec2) -> Vec2 {
        match hit {
            Some(h) if h.chunk.held => self.motion_from(self.old_pose.apply(h.position), at),
            Some(h) => match h.moved {
                Some(moved) => self.motion_from(self.previous.to_view(h.interpolate(&moved.before)), at),
                None => self.camera_motion(hit, at),
            },
            None => self.camera_motion(hit, at),
        }
    }

    /// Motion of the point seen at `at` if it stood still in the world.
    fn camera_motion(&self, hit: Option<&Hit<'_>>, at: Vec2) -> Vec2 {
        let was = match hit {
            None => self.previous.rotate(self.view.to_world(self.view.ray(at))),
            Some(h) => self.previous.to_view(h.world),
        };
        self.motion_from(was, at)
    }

    /// Motion to `at` from `was` in the previous view.
    fn motion_from(&self, was: Vec3, at: Vec2) -> Vec2 {
        if was.z <= 1e-4 { Vec2::NAN } else { self.previous.project(was) - at }
    }

    /// Mean of the samples of pixel (x, y), taken after tone mapping, so that bright edges stay anti-aliased.
    fn mean(&self, fine: &Visibility, x: usize, y: usize, s: usize) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for j in 0..s {
            for i in 0..s {
                let id = fine.ids[(y * s + j) * fine.width() + x * s + i];
                let at = (Vec2::new((x * s + i) as f32, (y * s + j) as f32) + 0.5) / s as f32;
                sum += tone_map(self.light(self.hit(id, at).as_ref(), at));
            }
        }
        sum / (s * s) as f32
    }

    /// Unit normal at a hit in the world or, for a held item, in its own frame.
    fn normal(&self, hit: &Hit<'_>) -> Vec3 {
        let normals = hit.moved.map_or(&hit.chunk.mesh.normals, |moved| &moved.normals);
        hit.interpolate(normals).normalize_or(Vec3::Y)
    }

    /// Sun visibility, 0 to 1, behind all that stands still and all that moves.
    fn sun(&self, world: Vec3, normal: Vec3) -> f32 {
        self.scene.shadow.sun_at(world, normal) * self.sun_past_moving(world, normal)
    }

    fn sun_past_moving(&self, world: Vec3, normal: Vec3) -> f32 {
        let Some(map) = self.moving_shadow else { return 1.0 };
        let at_rest = || self.scene.rest_shadow.as_ref().map_or(1.0, |map| map.sun_at(world, normal));
        map.sun_within(world, normal).unwrap_or_else(at_rest)
    }

    /// Whether a moving shadow falls on the hit, a moving lamp lights it, or it mirrors.
    fn has_changing_light(&self, hit: &Hit<'_>) -> bool {
        let towards = self.view.to_world(hit.view);
        let normal = self.normal(hit);
        let facing = if normal.dot(towards) > 0.0 { -normal } else { normal };
        let is_shaded = !hit.chunk.held
            && self.sun_past_moving(hit.world, facing) < 1.0
            && self.scene.shadow.sun_at(hit.world, facing) > 0.0;
        let surface = hit.chunk.mesh.materials[hit.triangle];
        let gloss = match surface.material {
            Material::Ground => 0.0,
            material => material_at(material, surface.variant, hit.position, normal, 0.0).gloss,
        };
        is_shaded
            || gloss > MIRRORS
            || self.lamps.iter().any(|lamp| lamp.moves && lamp.arriving(hit.world, facing).is_some())
    }

    /// Light through `at`, with exposure applied.
    fn light(&self, hit: Option<&Hit<'_>>, at: Vec2) -> Vec3 {
        let weather = &self.scene.weather;
        let ray = self.view.to_world(self.view.ray(at));
        let towards = ray.normalize();
        // The texture filter is one pixel wide for any number of samples: the samples anti-alias edges, not textures.
        let angle = 1.0 / self.view.focal.max_element();
        let Some(hit) = hit else {
            return weather.sky(towards, angle) * weather.exposure;
        };
        let normal = self.normal(hit);
        let surface = hit.chunk.mesh.materials[hit.triangle];
        // Size of a pixel on the surface, larger at grazing angles.
        let slant = normal.dot(towards).abs().clamp(0.25, 1.0);
        let distance = hit.view.length();
        let footprint = distance * angle / slant;
        if surface.material == Material::Water {
            return self.water_light(hit, at, towards, footprint);
        }
        let (mut sample, mut normal) = match surface.material {
            Material::Ground => {
                let (ground, bumps) = self.scene.terrain.surface_at(hit.position, normal, footprint);
                (ground, (normal - Vec3::new(bumps.x, 0.0, bumps.y)).normalize())
            }
            material => (material_at(material, surface.variant, hit.position, normal, footprint), normal),
        };
        sample.albedo = sample.albedo.max(Vec3::ZERO);
        let sun = if hit.chunk.held {
            normal = self.view.to_world(self.pose.rotation * normal);
            1.0
        } else {
            self.sun(hit.world, if normal.dot(towards) > 0.0 { -normal } else { normal })
        };
        if normal.dot(towards) > 0.0 && sample.translucency == 0.0 {
            normal = (normal - towards * (1.02 * normal.dot(towards))).normalize();
        }
        let (lamps, glints) = self.lamp_light(hit.world, normal, towards);
        let emission = emission(surface, hit.position);
        let point = SurfacePoint { material: sample, normal, towards, distance, sun, lamps, glints, emission };
        weather.shade(&point) * weather.exposure
    }

    /// Light of water: what it mirrors, displaced by its ripples, and its own colour.
    fn water_light(&self, hit: &Hit<'_>, at: Vec2, towards: Vec3, footprint: f32) -> Vec3 {
        let weather = &self.scene.weather;
        let slope = water::slope(hit.world, self.time, footprint);
        let normal = Vec3::new(-slope.x, 1.0, -slope.y).normalize();
        let share = water::mirrored_share(-towards.dot(normal));
        let (lamps, _) = self.lamp_light(hit.world, normal, towards);
        let sample = material_at(Material::Water, 0, hit.position, normal, footprint);
        let sun = weather.sun_light * normal.dot(weather.sun).max(0.0) * self.sun(hit.world, normal);
        let body = sample.albedo * (sun + weather.sky_light + lamps) * weather.exposure;
        let Some(reflection) = &self.reflection else { return body };
        // A slope turns the mirrored ray by twice its angle.
        let tilt = Vec3::new(slope.x, 0.0, slope.y) * 2.0;
        let shift = Vec2::new(tilt.dot(self.view.axes[0]), tilt.dot(self.view.axes[2])) * self.view.focal;
        let seen = &reflection.seen;
        let last = Vec2::new(seen.width() as f32, (seen.ids.len() / seen.width()) as f32) - 0.5;
        let there = (at + shift).clamp(Vec2::splat(0.5), last);
        let id = seen.ids[there.y as usize * seen.width() + there.x as usize];
        let mirrored = reflection.renderer.light(reflection.renderer.hit(id, there).as_ref(), there);
        body * (1.0 - share) + mirrored * share
    }

    /// Light that falls on a particle, with exposure applied.
    fn particle_light(&self, p: Vec3) -> Vec3 {
        let weather = &self.scene.weather;
        let sun = weather.sun_light * (0.55 * self.sun(p, Vec3::Y));
        let (lamps, _) = self.lamp_light(p, Vec3::Y, -Vec3::Y);
        (sun + (weather.sky_light + weather.ground_light) * 0.5 + lamps) * weather.exposure
    }

    /// Diffuse and mirrored light of all lamps at a point.
    fn lamp_light(&self, world: Vec3, normal: Vec3, towards: Vec3) -> (Vec3, Vec3) {
        let facing = if normal.dot(towards) > 0.0 { -normal } else { normal };
        let mirror = towards - normal * (2.0 * towards.dot(normal));
        let (mut diffuse, mut glints) = (Vec3::ZERO, Vec3::ZERO);
        for lamp in self.lamps {
            if let Some((light, direction)) = lamp.arriving(world, facing) {
                diffuse += light * facing.dot(direction).max(0.0);
                glints += light * mirror.dot(direction).max(0.0).powi(48) * 2.0;
            }
        }
        (diffuse, glints)
    }
}

/// Barycentric coordinates of a point in a triangle's plane.
fn barycentric([a, b, c]: [Vec3; 3], p: Vec3) -> [f32; 3] {
    let (u, v, w) = (b - a, c - a, p - a);
    let (uu, uv, vv, wu, wv) = (u.dot(u), u.dot(v), v.dot(v), w.dot(u), w.dot(v));
    let d = uu * vv - uv * uv;
    if d.abs() < 1e-12 {
        return [1.0, 0.0, 0.0];
    }
    let s = (vv * wu - uv * wv) / d;
    let t = (uu * wv - uv * wu) / d;
    [1.0 - s - t, s, t]
}
