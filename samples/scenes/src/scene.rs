//! A place: terrain, objects, light and atmosphere, generated from a family and a seed.

use std::f32::consts::TAU;

use glam::{Mat3, Vec2, Vec3};

use crate::family::{Family, Weather};
use crate::material::Material;
use crate::mesh::{Mesh, Surface};
use crate::noise::{Dice, value2};
use crate::objects::{self, Detail};
use crate::shadow::ShadowMap;
use crate::terrain::{FINE, Terrain};

/// A part of a scene that is drawn or culled as a whole.
#[derive(Debug)]
pub struct Chunk {
    /// Its triangles, in world space or, for a held item, in view space.
    pub mesh: Mesh,
    /// Whether it is attached to the camera.
    pub held: bool,
    centre: Vec3,
    radius: f32,
    /// Index of its first triangle within the scene.
    pub first: u32,
}

impl Chunk {
    fn new(mesh: Mesh, held: bool) -> Self {
        let (low, high) = mesh
            .positions
            .iter()
            .fold((Vec3::splat(f32::MAX), Vec3::splat(f32::MIN)), |(a, b), &p| (a.min(p), b.max(p)));
        let centre = (low + high) * 0.5;
        let radius = mesh.positions.iter().map(|p| p.distance(centre)).fold(0.0, f32::max);
        Self { mesh, held, centre, radius, first: 0 }
    }

    /// Bounding sphere: centre and radius in metres.
    pub fn ball(&self) -> (Vec3, f32) {
        (self.centre, self.radius)
    }
}

/// A whole place. Immutable; any number of threads may render it.
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
    pub(crate) shadow: ShadowMap,
}

/// Collects placed objects into square cells.
struct Garden<'a> {
    terrain: &'a Terrain,
    cells: std::collections::BTreeMap<(i32, i32), Mesh>,
    obstacles: Vec<(Vec2, f32)>,
    objects: usize,
}

const CELL: f32 = 12.0;

impl Garden<'_> {
    fn put(&mut self, mesh: &Mesh, at: Vec2, turn: f32, scale: f32, sink: f32) {
        let place = self.terrain.on(at) - Vec3::Y * sink;
        let key = ((at.x / CELL).floor() as i32, (at.y / CELL).floor() as i32);
        self.cells.entry(key).or_default().place(mesh, place, Mat3::from_rotation_y(turn), Vec3::splat(scale));
    }

    /// Places an obstacle unless another one is in the way. Returns whether it was placed.
    fn solid(&mut self, mesh: &Mesh, at: Vec2, turn: f32, scale: f32, sink: f32, radius: f32) -> bool {
        if self.obstacles.iter().any(|&(p, r)| p.distance(at) < r + radius + 0.4) {
            return false;
        }
        self.put(mesh, at, turn, scale, sink);
        self.obstacles.push((at, radius));
        self.objects += 1;
        true
    }
}

/// Parameters for scattering objects of one kind.
struct Strew {
    count: usize,
    /// Minimum distance from the path's edge, in metres.
    clear: f32,
    /// Concentration of objects near the path; 0 is uniform.
    gather: f32,
    /// Half side of the square over which they are scattered.
    reach: f32,
}

impl Strew {
    /// Tries random positions until `put` has accepted `count`, at most forty times as many.
    fn over(&self, terrain: &Terrain, dice: &mut Dice, mut put: impl FnMut(Vec2, &mut Dice) -> bool) {
        let (mut done, mut tries) = (0, 0);
        while done < self.count && tries < self.count * 40 {
            tries += 1;
            let north = dice.range(-self.reach, self.reach);
            let side = dice.range(-1.0, 1.0);
            let off = side.signum() * side.abs().powf(1.0 + self.gather) * self.reach;
            let at = Vec2::new(terrain.path(north) + off, north);
            let room = terrain.off_path(at).abs() - terrain.path_half_width();
            let inside = at.abs().max_element() < FINE.max(self.reach) && at.length() > 1.5;
            if room > self.clear && inside && put(at, dice) {
                done += 1;
            }
        }
    }
}

impl Scene {
    /// Generates the place of `family` for `seed`. Takes about a second, because the shadow map is rendered here.
    pub fn new(family: Family, seed: u64) -> Self {
        let terrain = Terrain::new(family, seed);
        let mut dice = Dice::new(seed ^ (family as u64) << 40);
        let weather = family.weather(dice.range(-0.35, 0.35));
        let mut garden = Garden { terrain: &terrain, cells: Default::default(), obstacles: Vec::new(), objects: 0 };
        match family {
            Family::Forest => forest(&mut garden, &mut dice),
            Family::Sword => hillside(&mut garden, &mut dice),
            Family::Desert => desert(&mut garden, &mut dice),
            Family::Snow => snow(&mut garden, &mut dice),
        }
        let Garden { cells, obstacles, objects, .. } = garden;
        let ground = Surface { material: Material::Ground, variant: 0 };
        let mut chunks: Vec<Chunk> =
            cells.into_values().chain(terrain.tiles(ground)).map(|mesh| Chunk::new(mesh, false)).collect();
        if family == Family::Sword {
            chunks.push(Chunk::new(objects::sword(), true));
        }
        let mut first = 0;
        for chunk in &mut chunks {
            chunk.first = first;
            first += chunk.mesh.triangles.len() as u32;
        }
        let shadow = ShadowMap::new(&chunks, weather.sun);
        Self { family, seed, terrain, weather, chunks, obstacles, objects, shadow }
    }

    /// Total number of triangles.
    pub fn triangles(&self) -> usize {
        self.chunks.iter().map(|c| c.mesh.triangles.len()).sum()
    }
}

/// A few generated variants to choose from, to save memory and start-up time.
fn grove(count: usize, dice: &mut Dice, mut grow: impl FnMut(&mut Dice) -> Mesh) -> Vec<Mesh> {
    (0..count).map(|_| grow(dice)).collect()
}

fn pick<'a>(from: &'a [Mesh], dice: &mut Dice) -> &'a Mesh {
    &from[dice.bits() as usize % from.len()]
}

fn turn(dice: &mut Dice) -> f32 {
    dice.range(0.0, TAU)
}

fn forest(garden: &mut Garden<'_>, dice: &mut Dice) {
    let terrain = garden.terrain;
    let trees = grove(8, dice, |d| objects::broadleaf(d.range(13.0, 22.0), Detail::Fine, d));
    let distant = grove(6, dice, |d| objects::broadleaf(d.range(13.0, 22.0), Detail::Coarse, d));
    let firs = grove(4, dice, |d| objects::fir(d.range(9.0, 17.0), false, d));
    Strew { count: 300, clear: 1.2, gather: 0.9, reach: 80.0 }.over(terrain, dice, |at, d| {
        let kind = value2(at / 25.0, 5) > 0.45;
        let near = terrain.off_path(at).abs() < 14.0;
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
        garden.solid(tree, at, turn(d), d.range(0.75, 1.2), 0.1, 0.45)
    });
    let rocks = grove(5, dice, |d| objects::rock(d.range(0.5, 1.6), Material::Rock, d));
    Strew { count: 50, clear: 0.3, gather: 1.5, reach: 60.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&rocks, d), at, turn(d), d.range(0.5, 1.2), 0.08, 0.5));
    let logs = grove(3, dice, |d| objects::log(d.range(2.5, 6.0), d));
    Strew { count: 14, clear: 2.5, gather: 1.2, reach: 55.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&logs, d), at, turn(d), 1.0, 0.05, 0.8));
    let bushes = grove(5, dice, |d| objects::bush(d.range(0.7, 1.5), Material::Leaf, d));
    Strew { count: 90, clear: 0.5, gather: 1.2, reach: 60.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&bushes, d), at, turn(d), d.range(0.6, 1.2), 0.1, 0.2));
    let ferns = grove(6, dice, |d| objects::fern(d.range(0.4, 0.8), d));
    Strew { count: 420, clear: 0.1, gather: 1.6, reach: 50.0 }.over(terrain, dice, |at, d| {
        garden.put(pick(&ferns, d), at, turn(d), d.range(0.7, 1.3), 0.02);
        true
    });
    let caps = grove(3, dice, |d| objects::mushroom(d.range(0.12, 0.3), d));
    Strew { count: 40, clear: 0.0, gather: 2.0, reach: 30.0 }.over(terrain, dice, |at, d| {
        garden.put(pick(&caps, d), at, turn(d), d.range(0.7, 1.3), 0.02);
        true
    });
}

fn hillside(garden: &mut Garden<'_>, dice: &mut Dice) {
    let terrain = garden.terrain;
    let rocks = grove(8, dice, |d| objects::rock(d.range(0.8, 3.2), Material::Rock, d));
    // Rocks lie in groups.
    Strew { count: 170, clear: 0.8, gather: 0.7, reach: 75.0 }.over(terrain, dice, |at, d| {
        value2(at / 13.0, 21) > 0.1 && garden.solid(pick(&rocks, d), at, turn(d), d.range(0.4, 1.4), 0.15, 0.9)
    });
    let trees = grove(5, dice, |d| objects::broadleaf(d.range(6.0, 11.0), Detail::Fine, d));
    let firs = grove(3, dice, |d| objects::fir(d.range(6.0, 12.0), false, d));
    Strew { count: 70, clear: 5.0, gather: 0.2, reach: 92.0 }.over(terrain, dice, |at, d| {
        let tree = pick(if d.unit() < 0.4 { &firs } else { &trees }, d);
        garden.solid(tree, at, turn(d), d.range(0.7, 1.3), 0.1, 0.4)
    });
    let bushes = grove(4, dice, |d| objects::bush(d.range(0.6, 1.2), Material::Leaf, d));
    Strew { count: 80, clear: 0.8, gather: 0.6, reach: 70.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&bushes, d), at, turn(d), d.range(0.6, 1.2), 0.1, 0.3));
    let fence = objects::fence(5, dice);
    Strew { count: 5, clear: 2.0, gather: 2.0, reach: 50.0 }
        .over(terrain, dice, |at, d| garden.solid(&fence, at, turn(d), 1.0, 0.1, 1.0));
    let tufts = grove(6, dice, |d| objects::grass(d.range(0.2, 0.42), Material::Grass, d));
    Strew { count: 2200, clear: -0.25, gather: 1.6, reach: 46.0 }.over(terrain, dice, |at, d| {
        garden.put(pick(&tufts, d), at, turn(d), d.range(0.7, 1.3), 0.02);
        true
    });
    let caps = grove(3, dice, |d| objects::mushroom(d.range(0.2, 0.3), d));
    Strew { count: 120, clear: 0.2, gather: 1.4, reach: 40.0 }.over(terrain, dice, |at, d| {
        garden.put(pick(&caps, d), at, turn(d), d.range(0.5, 0.9), 0.02);
        true
    });
}

fn desert(garden: &mut Garden<'_>, dice: &mut Dice) {
    let terrain = garden.terrain;
    let cacti = grove(7, dice, |d| objects::saguaro(d.range(2.6, 6.5), d));
    Strew { count: 95, clear: 1.5, gather: 0.5, reach: 92.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&cacti, d), at, turn(d), d.range(0.7, 1.15), 0.1, 0.4));
    let barrels = grove(5, dice, |d| objects::barrel(d.range(0.5, 1.1), d));
    Strew { count: 70, clear: 0.6, gather: 0.9, reach: 60.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&barrels, d), at, turn(d), d.range(0.7, 1.2), 0.05, 0.4));
    let rocks = grove(7, dice, |d| objects::rock(d.range(0.4, 2.6), Material::Sandstone, d));
    Strew { count: 120, clear: 0.6, gather: 0.6, reach: 80.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&rocks, d), at, turn(d), d.range(0.3, 1.2), 0.1, 0.7));
    let scrubs = grove(6, dice, |d| objects::bush(d.range(0.4, 0.9), Material::Scrub, d));
    Strew { count: 170, clear: 0.4, gather: 0.8, reach: 75.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&scrubs, d), at, turn(d), d.range(0.6, 1.3), 0.08, 0.25));
    let signs = grove(2, dice, objects::sign);
    Strew { count: 4, clear: 0.8, gather: 4.0, reach: 60.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&signs, d), at, d.range(-0.3, 0.3), 1.0, 0.0, 0.3));
    let tufts = grove(5, dice, |d| objects::grass(d.range(0.15, 0.35), Material::Scrub, d));
    Strew { count: 700, clear: 0.1, gather: 1.2, reach: 50.0 }.over(terrain, dice, |at, d| {
        garden.put(pick(&tufts, d), at, turn(d), d.range(0.7, 1.3), 0.02);
        true
    });
}

fn snow(garden: &mut Garden<'_>, dice: &mut Dice) {
    let terrain = garden.terrain;
    let firs = grove(8, dice, |d| objects::fir(d.range(6.0, 15.0), true, d));
    Strew { count: 230, clear: 2.2, gather: 0.35, reach: 92.0 }.over(terrain, dice, |at, d| {
        value2(at / 30.0, 8) > -0.35 && garden.solid(pick(&firs, d), at, turn(d), d.range(0.6, 1.25), 0.15, 0.5)
    });
    let rocks = grove(5, dice, |d| objects::rock(d.range(0.6, 2.4), Material::SnowyRock, d));
    Strew { count: 80, clear: 0.8, gather: 0.8, reach: 70.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&rocks, d), at, turn(d), d.range(0.4, 1.2), 0.15, 0.7));
    let fence = objects::fence(6, dice);
    Strew { count: 7, clear: 1.2, gather: 3.0, reach: 60.0 }
        .over(terrain, dice, |at, d| garden.solid(&fence, at, d.range(1.3, 1.8), 1.0, 0.1, 1.0));
    let scrubs = grove(5, dice, |d| objects::bush(d.range(0.4, 0.9), Material::Scrub, d));
    Strew { count: 70, clear: 0.8, gather: 0.8, reach: 60.0 }
        .over(terrain, dice, |at, d| garden.solid(pick(&scrubs, d), at, turn(d), d.range(0.6, 1.2), 0.12, 0.25));
    let tufts = grove(5, dice, |d| objects::grass(d.range(0.2, 0.45), Material::Scrub, d));
    Strew { count: 350, clear: 0.1, gather: 1.3, reach: 45.0 }.over(terrain, dice, |at, d| {
        garden.put(pick(&tufts, d), at, turn(d), d.range(0.6, 1.2), 0.06);
        true
    });
}
