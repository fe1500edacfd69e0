//! Built places: walls, floors, furniture and lamps, indoors and in a town.

mod indoors;
mod town;

pub(crate) use indoors::indoors;
pub(crate) use town::town;

use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Mat3, Vec2, Vec3};

use crate::animation::{Animation, RigidMotion};
use crate::cast::Cast;
use crate::lamp::{Lamp, Mount, Walls};
use crate::material::Material;
use crate::mesh::{Mesh, TriangleMaterial};
use crate::noise::Rng;
use crate::scene::{Chunk, flexes};

/// What is built in a scene.
#[derive(Default)]
pub(crate) struct Buildings {
    pub(crate) chunks: Vec<Chunk>,
    /// Obstacles for the walker: centre (east, north) and radius, in metres.
    pub(crate) obstacles: Vec<(Vec2, f32)>,
    /// Number of objects without walls.
    pub(crate) objects: usize,
    pub(crate) lamps: Vec<Lamp>,
    /// Boxes that neither a walker nor a lamp's light passes.
    pub(crate) walls: Walls,
}

/// Length along north of the parts that are culled as a whole, in metres.
const PART: f32 = 8.0;
/// Height of doorways.
const DOORWAY: f32 = 2.1;

/// Collects what is built.
#[derive(Default)]
struct Builder {
    parts: BTreeMap<i32, Mesh>,
    buildings: Buildings,
    /// What moves.
    cast: Cast,
}

/// An opening in a wall: its extent along the wall in metres from the wall's start, and its height over the floor.
#[derive(Clone, Copy)]
struct Opening {
    along: [f32; 2],
    height: [f32; 2],
}

impl Opening {
    fn doorway(middle: f32, width: f32) -> Self {
        Self { along: [middle - width * 0.5, middle + width * 0.5], height: [0.0, DOORWAY] }
    }

    fn window(middle: f32, width: f32) -> Self {
        Self { along: [middle - width * 0.5, middle + width * 0.5], height: [0.95, 2.2] }
    }
}

/// The plane of a wall that runs along one axis.
#[derive(Clone, Copy)]
struct Wall {
    /// Whether it runs along north; else along east.
    along_north: bool,
    /// East of a wall along north, north of a wall along east: its middle, in metres.
    at: f32,
    /// Start and end along its direction.
    from: f32,
    until: f32,
    height: f32,
    thickness: f32,
    surface: TriangleMaterial,
}

impl Wall {
    /// The box from `a` to `b` along the wall, at heights `low` to `high`, `bulge` metres thicker on both sides.
    fn block(&self, a: f32, b: f32, low: f32, high: f32, bulge: f32) -> (Vec3, Vec3) {
        let half = self.thickness * 0.5 + bulge;
        let corner = |along: f32, across: f32, y: f32| {
            if self.along_north { Vec3::new(self.at + across, y, along) } else { Vec3::new(along, y, self.at + across) }
        };
        (corner(a, -half, low), corner(b, half, high))
    }
}

fn plain(material: Material, variant: u8) -> TriangleMaterial {
    TriangleMaterial { material, variant }
}

impl Builder {
    fn new(cast: Cast) -> Self {
        Self { cast, ..Self::default() }
    }

    fn part(&mut self, north: f32) -> &mut Mesh {
        self.parts.entry((north / PART).floor() as i32).or_default()
    }

    /// A box without collision.
    fn block(&mut self, low: Vec3, high: Vec3, surface: TriangleMaterial) {
        self.part((low.z + high.z) * 0.5).block(low, high, surface);
    }

    /// A box that stops walkers and lamps.
    fn solid(&mut self, low: Vec3, high: Vec3, surface: TriangleMaterial) {
        self.block(low, high, surface);
        self.buildings.walls.push((low, high));
    }

    /// A level slab, in parts that are culled apart.
    fn slab(&mut self, low: Vec3, high: Vec3, surface: TriangleMaterial) {
        let mut from = low.z;
        while from < high.z {
            let until = high.z.min(((from / PART).floor() + 1.0) * PART);
            self.block(Vec3::new(low.x, low.y, from), Vec3::new(high.x, high.y, until), surface);
            from = until;
        }
    }

    /// A wall with openings in order along it. Windows get a frame with a cross, doorways a frame.
    fn wall(&mut self, wall: Wall, openings: &[Opening]) {
        let frame = plain(Material::Paint, 4);
        let mut from = wall.from;
        for opening in openings {
            let ([a, b], [low, high]) = (opening.along, opening.height);
            self.length(wall, from, a);
            if low > 0.0 {
                let (l, h) = wall.block(a, b, 0.0, low, 0.0);
                self.solid(l, h, wall.surface);
                let (l, h) = wall.block(a - 0.04, b + 0.04, low - 0.05, low, 0.06);
                self.block(l, h, frame);
                let middle = (a + b) * 0.5;
                let bars = Wall { thickness: 0.05, ..wall };
                for (l, h) in [
                    bars.block(middle - 0.025, middle + 0.025, low, high, 0.0),
                    bars.block(a, b, (low + high) * 0.5 - 0.025, (low + high) * 0.5 + 0.025, 0.0),
                ] {
                    self.block(l, h, frame);
                }
            }
            for (l, h) in [
                wall.block(a - 0.07, a, low, high, 0.03),
                wall.block(b, b + 0.07, low, high, 0.03),
                wall.block(a - 0.07, b + 0.07, high, high + 0.07, 0.03),
            ] {
                self.block(l, h, frame);
            }
            let (l, h) = wall.block(a, b, high, wall.height, 0.0);
            self.solid(l, h, wall.surface);
            from = b;
        }
        self.length(wall, from, wall.until);
    }

    /// A stretch of wall without an opening, in parts that are culled apart, with a skirting board.
    fn length(&mut self, wall: Wall, from: f32, until: f32) {
        let mut a = from;
        while until - a > 1e-3 {
            let b = if wall.along_north { until.min(((a / PART).floor() + 1.0) * PART) } else { until };
            let (low, high) = wall.block(a, b, 0.0, wall.height, 0.0);
            self.solid(low, high, wall.surface);
            let (low, high) = wall.block(a, b, 0.0, 0.11, 0.02);
            self.block(low, high, plain(Material::Paint, 5));
            a = b;
        }
    }

    /// A door's leaf in the opening of `wall` around `middle`, hinged at its start or, with a negative width, at its end. It opens by `angle` at
    /// `opens` seconds if doors move, else stands ajar.
    fn door(&mut self, wall: Wall, middle: f32, width: f32, opens: f32, angle: f32, rng: &mut Rng) {
        let mut mesh = Mesh::default();
        let (leaf, trim) = (plain(Material::Paint, (rng.bits() % 8) as u8), plain(Material::Gold, 3));
        let far = width.abs();
        mesh.block(Vec3::new(0.02, 0.03, -0.02), Vec3::new(far - 0.02, DOORWAY - 0.02, 0.02), leaf);
        for (low, high) in [(0.22, 0.95), (1.12, 1.88)] {
            mesh.block(Vec3::new(0.14, low, -0.032), Vec3::new(far - 0.14, high, 0.032), leaf);
        }
        mesh.block(Vec3::new(far - 0.12, 1.0, -0.07), Vec3::new(far - 0.07, 1.05, 0.07), trim);
        let hinge = middle - width * 0.5;
        // The leaf's x axis leads along the wall: rotation about y takes x to north at -90 degrees.
        let turned = if width < 0.0 { PI } else { 0.0 };
        let (at, yaw) = if wall.along_north {
            (Vec3::new(wall.at, 0.0, hinge), turned - FRAC_PI_2)
        } else {
            (Vec3::new(hinge, 0.0, wall.at), turned)
        };
        let body = RigidMotion::Hinge { at, yaw, angle, opens, period: 7.0 };
        if self.cast.doors {
            self.buildings.chunks.push(Chunk::animated(mesh, Animation::Rigid(body)));
        } else {
            let pose = body.pose(opens - 1.2);
            let mut ajar = Mesh::default();
            ajar.add_instance(&mesh, pose.translation, pose.rotation, Vec3::ONE);
            self.buildings.chunks.push(Chunk::new(ajar));
        }
        self.buildings.objects += 1;
    }

    /// A lamp at rest.
    fn lamp(&mut self, at: Vec3, light: Vec3, reach: f32) {
        self.buildings.lamps.push(Lamp { mount: Mount::Fixed(at), light, reach });
    }

    /// A thing made of boxes that stands on the floor: `parts` are corners and surfaces around the origin, turned by quarter turns.
    fn furniture(&mut self, at: Vec2, quarter: u32, radius: f32, parts: &[(Vec3, Vec3, TriangleMaterial)]) {
        let mut mesh = Mesh::default();
        for &(low, high, surface) in parts {
            mesh.block(low, high, surface);
        }
        self.stand(&mesh, at, quarter, radius);
    }

    /// A mesh that stands on the floor, turned by quarter turns, and an obstacle of `radius` metres; 0 for none.
    fn stand(&mut self, mesh: &Mesh, at: Vec2, quarter: u32, radius: f32) {
        let rotation = Mat3::from_rotation_y(quarter as f32 * FRAC_PI_2);
        self.part(at.y).add_instance(mesh, Vec3::new(at.x, 0.02, at.y), rotation, Vec3::ONE);
        if radius > 0.0 {
            self.buildings.obstacles.push((at, radius));
        }
        self.buildings.objects += 1;
    }

    /// A tree, which bends if there is wind.
    fn tree(&mut self, mesh: &Mesh, at: Vec2, quarter: u32) {
        match flexes(mesh, 1.0).filter(|_| self.cast.wind) {
            Some(all) => {
                let rotation = Mat3::from_rotation_y(quarter as f32 * FRAC_PI_2);
                let mut placed = Mesh::default();
                placed.add_instance(mesh, Vec3::new(at.x, 0.02, at.y), rotation, Vec3::ONE);
                self.buildings.chunks.push(Chunk::animated(placed, Animation::Wind(all)));
                self.buildings.obstacles.push((at, 0.3));
                self.buildings.objects += 1;
            }
            None => self.stand(mesh, at, quarter, 0.3),
        }
    }

    fn finish(mut self) -> Buildings {
        self.buildings.chunks.extend(self.parts.into_values().map(Chunk::new));
        self.buildings
    }
}
