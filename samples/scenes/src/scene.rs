//! A scene: terrain, objects, light and atmosphere, generated from a family and a seed.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::f32::consts::TAU;

use glam::{Mat3, Vec2, Vec3};

use crate::animation::{Animation, Flex};
use crate::cast::Cast;
use crate::family::{Family, Weather};
use crate::lamp::{Lamp, Walls};
use crate::material::Material;
use crate::mesh::{Mesh, TriangleMaterial};
use crate::noise::{Rng, value2};
use crate::objects::{self, Detail};
use crate::particles::Emitter;
use crate::placement;
use crate::places::{self, Buildings};
use crate::shadow::ShadowMap;
use crate::terrain::{FINE, Terrain};

/// A part of a scene that is drawn or culled as a whole.
#[derive(Debug)]
pub struct Chunk {
    /// Its triangles, in world space or, for a held item, in view space; at rest, or in the frames of its bones, if it moves
    /// ([`positions_at`](Self::positions_at)).
    pub mesh: Mesh,
    /// Whether it is attached to the camera.
    pub held: bool,
    centre: Vec3,
    radius: f32,
    /// Index of its first triangle within the scene.
    pub first: u32,
    pub(crate) animation: Animation,
}

impl Chunk {
    /// A chunk that does not move.
    pub(crate) fn new(mesh: Mesh) -> Self {
        let (low, high) = mesh
            .positions
            .iter()
            .fold((Vec3::splat(f32::MAX), Vec3::splat(f32::MIN)), |(a, b), &p| (a.min(p), b.max(p)));
        let centre = (low + high) * 0.5;
        let radius = mesh.positions.iter().map(|p| p.distance(centre)).fold(0.0, f32::max);
        Self { mesh, held: false, centre, radius, first: 0, animation: Animation::Still }
    }

    /// A chunk that moves with time.
    pub(crate) fn animated(mesh: Mesh, animation: Animation) -> Self {
        Self { animation, ..Self::new(mesh) }
    }

    /// A chunk that is attached to the camera, in view space.
    pub(crate) fn held_item(mesh: Mesh) -> Self {
        Self { held: true, ..Self::new(mesh) }
    }

    /// Positions of the mesh's vertices at `time` seconds, in metres, in world space; a held item's are in view space and do not change.
    pub fn positions_at(&self, time: f32) -> Cow<'_, [Vec3]> {
        if self.animation.is_still() {
            Cow::Borrowed(&self.mesh.positions)
        } else {
            Cow::Owned(self.animation.positions(&self.mesh, time))
        }
    }

    /// Unit normals of the vertices at `time` seconds, in world space; a held item's are in view space.
    pub(crate) fn normals_at(&self, time: f32) -> Vec<Vec3> {
        self.animation.normals(&self.mesh, time)
    }

    /// Whether it stands where its mesh lies, and only bends there.
    pub(crate) fn is_rooted(&self) -> bool {
        matches!(self.animation, Animation::Wind(_))
    }

    /// Whether it is one rigid body that moves.
    pub(crate) fn is_rigid(&self) -> bool {
        matches!(self.animation, Animation::Rigid(_))
    }

    /// Whether its vertices move through the world.
    pub fn moves(&self) -> bool {
        !self.animation.is_still()
    }

    /// Bounding sphere of the mesh: centre and radius in metres.
    pub fn ball(&self) -> (Vec3, f32) {
        (self.centre, self.radius)
    }
}

/// A whole scene. Immutable; any number of threads may render it.
#[derive(Debug)]
pub struct Scene {
    /// Its kind.
    pub family: Family,
    /// The seed it was made from.
    pub seed: u64,
    /// The ground.
    pub terrain: Terrain,
    /// Light and atmosphere.
    pub weather: Weather,
    /// All geometry.
    pub chunks: Vec<Chunk>,
    /// Obstacles for the walker: centre (east, north) and radius, in metres.
    pub obstacles: Vec<(Vec2, f32)>,
    /// Number of placed objects, without grass and pebbles.
    pub objects: usize,
    /// What moves.
    pub cast: Cast,
    pub(crate) lamps: Vec<Lamp>,
    /// Boxes that neither a walker nor a lamp's light passes.
    pub(crate) walls: Walls,
    pub(crate) emitters: Vec<Emitter>,
    /// Height of all water in the scene, in metres.
    pub(crate) water: Option<f32>,
    pub(crate) shadow: ShadowMap,
    /// Shadows of the plants that the wind bends, at rest: for what is too far away for a frame's own map.
    pub(crate) rest_shadow: Option<ShadowMap>,
}

/// Plants of a cell, and how each of their vertices bends.
#[derive(Default)]
struct Plants {
    mesh: Mesh,
    flexes: Vec<Flex>,
}

/// Collects placed objects into square cells.
struct SceneBuilder<'a> {
    terrain: &'a Terrain,
    cells: BTreeMap<(i32, i32), Mesh>,
    /// Plants that bend, apart, if there is wind.
    plants: Option<BTreeMap<(i32, i32), Plants>>,
    obstacles: Vec<(Vec2, f32)>,
    objects: usize,
}

const CELL: f32 = 12.0;

impl SceneBuilder<'_> {
    fn add(&mut self, mesh: &Mesh, at: Vec2, rotation: f32, scale: f32, sink: f32) {
        let position = self.terrain.on(at) - Vec3::Y * sink;
        let key = ((at.x / CELL).floor() as i32, (at.y / CELL).floor() as i32);
        if let (Some(plants), Some(flexes)) = (&mut self.plants, flexes(mesh, scale)) {
            let cell = plants.entry(key).or_default();
            cell.mesh.add_instance(mesh, position, Mat3::from_rotation_y(rotation), Vec3::splat(scale));
            cell.flexes.extend(flexes);
            return;
        }
        self.cells.entry(key).or_default().add_instance(
            mesh,
            position,
            Mat3::from_rotation_y(rotation),
            Vec3::splat(scale),
        );
    }

    /// Places an obstacle unless another one is in the way. Returns whether it was placed.
    fn add_obstacle(&mut self, mesh: &Mesh, at: Vec2, rotation: f32, scale: f32, sink: f32, radius: f32) -> bool {
        if self.obstacles.iter().any(|&(p, r)| p.distance(at) < r + radius + 0.4) {
            return false;
        }
        self.add(mesh, at, rotation, scale, sink);
        self.obstacles.push((at, radius));
        self.objects += 1;
        true
    }
}

/// Parameters for scattering objects of one kind.
struct Scatter {
    count: usize,
    /// Minimum distance from the path's edge, in metres.
    clear: f32,
    /// Concentration of objects near the path; 0 is uniform.
    gather: f32,
    /// Half side of the square over which they are scattered.
    reach: f32,
}

impl Scatter {
    /// Tries random positions until `put` has accepted `count`, at most forty times as many.
    fn over(&self, terrain: &Terrain, rng: &mut Rng, mut put: impl FnMut(Vec2, &mut Rng) -> bool) {
        let (mut done, mut tries) = (0, 0);
        while done < self.count && tries < self.count * 40 {
            tries += 1;
            let north = rng.range(-self.reach, self.reach);
            let side = rng.range(-1.0, 1.0);
            let off = side.signum() * side.abs().powf(1.0 + self.gather) * self.reach;
            let at = Vec2::new(terrain.path(north) + off, north);
            let room = terrain.path_offset(at).abs() - terrain.path_half_width();
            let inside = at.abs().max_element() < FINE.max(self.reach) && at.length() > 1.5;
            if room > self.clear && inside && put(at, rng) {
                done += 1;
            }
        }
    }
}

impl Scene {
    /// Generates the scene of `family` for `seed` in which nothing moves. Takes about a second, because the shadow map is rendered here.
    pub fn new(family: Family, seed: u64) -> Self {
        Self::with_cast(family, seed, Cast::none())
    }

    /// Generates the scene of `family` for `seed` with the moving things of `cast`. The place itself is the same for every cast, except that gates
    /// add posts, fires add bowls, and water outside of the town adds a basin, which is an obstacle.
    pub fn with_cast(family: Family, seed: u64, cast: Cast) -> Self {
        Self::on(Terrain::new(family, seed), family, seed, cast)
    }

    /// As [`with_cast`](Self::with_cast), and closed: hills of the ground's own material rise about 50 m east, west, north and south of the origin, and
    /// a walker stops at them. Within 40 m of the origin the ground and what stands on it are those of the scene that is not closed.
    /// Walls close the kinds of place indoors and in the town; nothing changes there.
    pub fn level(family: Family, seed: u64, cast: Cast) -> Self {
        Self::on(Terrain::level(family, seed), family, seed, cast)
    }

    fn on(terrain: Terrain, family: Family, seed: u64, cast: Cast) -> Self {
        let mut rng = Rng::new(seed ^ (family as u64) << 40);
        let weather = family.weather(rng.range(-0.35, 0.35));
        let mut builder = SceneBuilder {
            terrain: &terrain,
            cells: BTreeMap::new(),
            plants: cast.wind.then(BTreeMap::new),
            obstacles: Vec::new(),
            objects: 0,
        };
        let mut place = Buildings::default();
        match family {
            Family::Forest => forest(&mut builder, &mut rng),
            Family::Sword => hillside(&mut builder, &mut rng),
            Family::Desert => desert(&mut builder, &mut rng),
            Family::Snow => snow(&mut builder, &mut rng),
            Family::Indoors => place = places::indoors(cast, &mut rng),
            Family::Town => place = places::town(cast, &mut rng),
        }
        let SceneBuilder { cells, plants, obstacles, objects, .. } = builder;
        let ground = TriangleMaterial { material: Material::Ground, variant: 0 };
        let mut chunks: Vec<Chunk> = cells.into_values().chain(terrain.tiles(ground)).map(Chunk::new).collect();
        if family == Family::Sword {
            chunks.push(Chunk::held_item(objects::sword()));
        }
        let wind = plants.into_iter().flat_map(BTreeMap::into_values);
        chunks.extend(wind.map(|plants| Chunk::animated(plants.mesh, Animation::Wind(plants.flexes))));
        chunks.extend(place.chunks);
        let shadow = ShadowMap::around(Vec3::ZERO, weather.sun);
        let mut scene = Self {
            family,
            seed,
            terrain,
            weather,
            chunks,
            obstacles: if place.obstacles.is_empty() { obstacles } else { place.obstacles },
            objects: objects + place.objects,
            cast,
            lamps: place.lamps,
            walls: place.walls,
            emitters: Vec::new(),
            water: None,
            shadow,
            rest_shadow: None,
        };
        if cast != Cast::none() {
            placement::populate(&mut scene, cast);
        }
        let mut first = 0;
        for chunk in &mut scene.chunks {
            chunk.first = first;
            first += chunk.mesh.triangles.len() as u32;
        }
        scene.shadow = ShadowMap::new(&scene.chunks, weather.sun, |c| !c.held && !c.moves());
        if scene.chunks.iter().any(Chunk::is_rooted) {
            scene.rest_shadow = Some(ShadowMap::new(&scene.chunks, weather.sun, Chunk::is_rooted));
        }
        scene
    }

    /// Total number of triangles.
    pub fn triangles(&self) -> usize {
        self.chunks.iter().map(|c| c.mesh.triangles.len()).sum()
    }
}

/// How the wind bends each vertex of a plant of `scale` times its size; `None` for what does not bend.
///
/// A plant bends with the square of the height over its root: grass and bushes by a third of their height at the tip, trees, which have bark, by
/// about one part in eighty, and their leaves flutter.
pub(crate) fn flexes(mesh: &Mesh, scale: f32) -> Option<Vec<Flex>> {
    let is_leaf = |m: Material| {
        matches!(m, Material::Leaf | Material::Needle | Material::SnowyNeedle | Material::Grass | Material::Scrub)
    };
    let tall = scale * mesh.positions.iter().map(|p| p.y).fold(0.0, f32::max);
    let has_bark = mesh.materials.iter().any(|s| s.material == Material::Bark);
    // Moss on a fallen trunk does not bend.
    if !mesh.materials.iter().any(|s| is_leaf(s.material)) || (has_bark && tall < 2.5) {
        return None;
    }
    let give = if has_bark { 0.0007 } else { 0.34 / tall };
    let mut all: Vec<Flex> = (mesh.positions.iter())
        .map(|p| (p.y * scale).max(0.0))
        .map(|h| Flex { reach: give * h * h, slope: 2.0 * give * h, flutter: 0.0 })
        .collect();
    if has_bark {
        for (corners, surface) in mesh.triangles.iter().zip(&mesh.materials) {
            if is_leaf(surface.material) {
                corners.iter().for_each(|&i| all[i as usize].flutter = 0.022);
            }
        }
    }
    Some(all)
}

/// A few generated variants to choose from, to save memory and start-up time.
fn grove(count: usize, rng: &mut Rng, mut grow: impl FnMut(&mut Rng) -> Mesh) -> Vec<Mesh> {
    (0..count).map(|_| grow(rng)).collect()
}

fn pick<'a>(from: &'a [Mesh], rng: &mut Rng) -> &'a Mesh {
    &from[rng.bits() as usize % from.len()]
}

fn random_angle(rng: &mut Rng) -> f32 {
    rng.range(0.0, TAU)
}

fn forest(builder: &mut SceneBuilder<'_>, rng: &mut Rng) {
    let terrain = builder.terrain;
    let trees = grove(8, rng, |d| objects::broadleaf(d.range(13.0, 22.0), Detail::Fine, d));
    let distant = grove(6, rng, |d| objects::broadleaf(d.range(13.0, 22.0), Detail::Coarse, d));
    let firs = grove(4, rng, |d| objects::fir(d.range(9.0, 17.0), false, d));
    Scatter { count: 300, clear: 1.2, gather: 0.9, reach: 80.0 }.over(terrain, rng, |at, d| {
        let kind = value2(at / 25.0, 5) > 0.45;
        let near = terrain.path_offset(at).abs() < 14.0;
        let tree = pick(
            if kind {
                &firs
            } else if near {
                &trees
            } else {
                &distant
            },
            d,
        );
        builder.add_obstacle(tree, at, random_angle(d), d.range(0.75, 1.2), 0.1, 0.45)
    });
    let rocks = grove(5, rng, |d| objects::rock(d.range(0.5, 1.6), Material::Rock, d));
    Scatter { count: 50, clear: 0.3, gather: 1.5, reach: 60.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&rocks, d), at, random_angle(d), d.range(0.5, 1.2), 0.08, 0.5)
    });
    let logs = grove(3, rng, |d| objects::log(d.range(2.5, 6.0), d));
    Scatter { count: 14, clear: 2.5, gather: 1.2, reach: 55.0 }
        .over(terrain, rng, |at, d| builder.add_obstacle(pick(&logs, d), at, random_angle(d), 1.0, 0.05, 0.8));
    let bushes = grove(5, rng, |d| objects::bush(d.range(0.7, 1.5), Material::Leaf, d));
    Scatter { count: 90, clear: 0.5, gather: 1.2, reach: 60.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&bushes, d), at, random_angle(d), d.range(0.6, 1.2), 0.1, 0.2)
    });
    let ferns = grove(6, rng, |d| objects::fern(d.range(0.4, 0.8), d));
    Scatter { count: 420, clear: 0.1, gather: 1.6, reach: 50.0 }.over(terrain, rng, |at, d| {
        builder.add(pick(&ferns, d), at, random_angle(d), d.range(0.7, 1.3), 0.02);
        true
    });
    let caps = grove(3, rng, |d| objects::mushroom(d.range(0.12, 0.3), d));
    Scatter { count: 40, clear: 0.0, gather: 2.0, reach: 30.0 }.over(terrain, rng, |at, d| {
        builder.add(pick(&caps, d), at, random_angle(d), d.range(0.7, 1.3), 0.02);
        true
    });
}

fn hillside(builder: &mut SceneBuilder<'_>, rng: &mut Rng) {
    let terrain = builder.terrain;
    let rocks = grove(8, rng, |d| objects::rock(d.range(0.8, 3.2), Material::Rock, d));
    // Rocks lie in groups.
    Scatter { count: 170, clear: 0.8, gather: 0.7, reach: 75.0 }.over(terrain, rng, |at, d| {
        value2(at / 13.0, 21) > 0.1
            && builder.add_obstacle(pick(&rocks, d), at, random_angle(d), d.range(0.4, 1.4), 0.15, 0.9)
    });
    let trees = grove(5, rng, |d| objects::broadleaf(d.range(6.0, 11.0), Detail::Fine, d));
    let firs = grove(3, rng, |d| objects::fir(d.range(6.0, 12.0), false, d));
    Scatter { count: 70, clear: 5.0, gather: 0.2, reach: 92.0 }.over(terrain, rng, |at, d| {
        let tree = pick(if d.unit() < 0.4 { &firs } else { &trees }, d);
        builder.add_obstacle(tree, at, random_angle(d), d.range(0.7, 1.3), 0.1, 0.4)
    });
    let bushes = grove(4, rng, |d| objects::bush(d.range(0.6, 1.2), Material::Leaf, d));
    Scatter { count: 80, clear: 0.8, gather: 0.6, reach: 70.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&bushes, d), at, random_angle(d), d.range(0.6, 1.2), 0.1, 0.3)
    });
    let fence = objects::fence(5, rng);
    Scatter { count: 5, clear: 2.0, gather: 2.0, reach: 50.0 }
        .over(terrain, rng, |at, d| builder.add_obstacle(&fence, at, random_angle(d), 1.0, 0.1, 1.0));
    let tufts = grove(6, rng, |d| objects::grass(d.range(0.2, 0.42), Material::Grass, d));
    Scatter { count: 2200, clear: -0.25, gather: 1.6, reach: 46.0 }.over(terrain, rng, |at, d| {
        builder.add(pick(&tufts, d), at, random_angle(d), d.range(0.7, 1.3), 0.02);
        true
    });
    let caps = grove(3, rng, |d| objects::mushroom(d.range(0.2, 0.3), d));
    Scatter { count: 120, clear: 0.2, gather: 1.4, reach: 40.0 }.over(terrain, rng, |at, d| {
        builder.add(pick(&caps, d), at, random_angle(d), d.range(0.5, 0.9), 0.02);
        true
    });
}

fn desert(builder: &mut SceneBuilder<'_>, rng: &mut Rng) {
    let terrain = builder.terrain;
    let cacti = grove(7, rng, |d| objects::saguaro(d.range(2.6, 6.5), d));
    Scatter { count: 95, clear: 1.5, gather: 0.5, reach: 92.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&cacti, d), at, random_angle(d), d.range(0.7, 1.15), 0.1, 0.4)
    });
    let barrels = grove(5, rng, |d| objects::barrel(d.range(0.5, 1.1), d));
    Scatter { count: 70, clear: 0.6, gather: 0.9, reach: 60.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&barrels, d), at, random_angle(d), d.range(0.7, 1.2), 0.05, 0.4)
    });
    let rocks = grove(7, rng, |d| objects::rock(d.range(0.4, 2.6), Material::Sandstone, d));
    Scatter { count: 120, clear: 0.6, gather: 0.6, reach: 80.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&rocks, d), at, random_angle(d), d.range(0.3, 1.2), 0.1, 0.7)
    });
    let scrubs = grove(6, rng, |d| objects::bush(d.range(0.4, 0.9), Material::Scrub, d));
    Scatter { count: 170, clear: 0.4, gather: 0.8, reach: 75.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&scrubs, d), at, random_angle(d), d.range(0.6, 1.3), 0.08, 0.25)
    });
    let signs = grove(2, rng, objects::sign);
    Scatter { count: 4, clear: 0.8, gather: 4.0, reach: 60.0 }
        .over(terrain, rng, |at, d| builder.add_obstacle(pick(&signs, d), at, d.range(-0.3, 0.3), 1.0, 0.0, 0.3));
    let tufts = grove(5, rng, |d| objects::grass(d.range(0.15, 0.35), Material::Scrub, d));
    Scatter { count: 700, clear: 0.1, gather: 1.2, reach: 50.0 }.over(terrain, rng, |at, d| {
        builder.add(pick(&tufts, d), at, random_angle(d), d.range(0.7, 1.3), 0.02);
        true
    });
}

fn snow(builder: &mut SceneBuilder<'_>, rng: &mut Rng) {
    let terrain = builder.terrain;
    let firs = grove(8, rng, |d| objects::fir(d.range(6.0, 15.0), true, d));
    Scatter { count: 230, clear: 2.2, gather: 0.35, reach: 92.0 }.over(terrain, rng, |at, d| {
        value2(at / 30.0, 8) > -0.35
            && builder.add_obstacle(pick(&firs, d), at, random_angle(d), d.range(0.6, 1.25), 0.15, 0.5)
    });
    let rocks = grove(5, rng, |d| objects::rock(d.range(0.6, 2.4), Material::SnowyRock, d));
    Scatter { count: 80, clear: 0.8, gather: 0.8, reach: 70.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&rocks, d), at, random_angle(d), d.range(0.4, 1.2), 0.15, 0.7)
    });
    let fence = objects::fence(6, rng);
    Scatter { count: 7, clear: 1.2, gather: 3.0, reach: 60.0 }
        .over(terrain, rng, |at, d| builder.add_obstacle(&fence, at, d.range(1.3, 1.8), 1.0, 0.1, 1.0));
    let scrubs = grove(5, rng, |d| objects::bush(d.range(0.4, 0.9), Material::Scrub, d));
    Scatter { count: 70, clear: 0.8, gather: 0.8, reach: 60.0 }.over(terrain, rng, |at, d| {
        builder.add_obstacle(pick(&scrubs, d), at, random_angle(d), d.range(0.6, 1.2), 0.12, 0.25)
    });
    let tufts = grove(5, rng, |d| objects::grass(d.range(0.2, 0.45), Material::Scrub, d));
    Scatter { count: 350, clear: 0.1, gather: 1.3, reach: 45.0 }.over(terrain, rng, |at, d| {
        builder.add(pick(&tufts, d), at, random_angle(d), d.range(0.6, 1.2), 0.06);
        true
    });
}
