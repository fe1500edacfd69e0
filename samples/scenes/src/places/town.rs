//! A street at night between two rows of houses, with lit windows, street lamps and parked cars.

use glam::{Vec2, Vec3};

use super::{Builder, Buildings, Opening, Wall, plain};
use crate::cast::Cast;
use crate::material::Material;
use crate::mesh::{Mesh, TriangleMaterial};
use crate::noise::Rng;
use crate::objects::{self, Detail};

/// Half the width of the roadway in metres.
const ROAD: f32 = 3.6;
/// Distance of the facades from the middle of the street.
const FRONT: f32 = 6.3;
/// South and north ends of the street.
const ENDS: [f32; 2] = [-28.0, 84.0];
/// Depth of the houses.
const DEPTH: f32 = 9.0;
const STOREY: f32 = 3.0;

/// Builds the street along north through the origin.
pub(crate) fn town(cast: Cast, rng: &mut Rng) -> Buildings {
    let mut b = Builder::new(cast);
    let [south, north] = ENDS;
    b.slab(Vec3::new(-ROAD, -0.3, south), Vec3::new(ROAD, 0.02, north), plain(Material::Asphalt, 1));
    for side in [-1.0_f32, 1.0] {
        let (a, z) = if side < 0.0 { (-FRONT - 0.2, -ROAD) } else { (ROAD, FRONT + 0.2) };
        b.slab(Vec3::new(a, -0.3, south), Vec3::new(z, 0.12, north), plain(Material::Tiles, 3));
        let (a, z) = if side < 0.0 { (-ROAD, -ROAD + 0.14) } else { (ROAD - 0.14, ROAD) };
        b.slab(Vec3::new(a, -0.3, south), Vec3::new(z, 0.125, north), plain(Material::Rock, 40));
    }
    let mut dash = south;
    while dash < north {
        b.block(Vec3::new(-0.07, 0.02, dash), Vec3::new(0.07, 0.026, dash + 2.0), plain(Material::Plaster, 3));
        dash += 5.0;
    }
    for side in [-1.0_f32, 1.0] {
        let mut from = south;
        while from < north - 5.0 {
            let wide = rng.range(6.5, 10.5).min(north - from);
            house(&mut b, side, from, from + wide, rng);
            from += wide;
            if rng.unit() < 0.25 {
                alley(&mut b, side, from, rng);
                from += 2.4;
            }
        }
        // What closes the street at both ends.
        for (edge, thick) in [(south, -1.0_f32), (north, 1.0)] {
            let (low, high) = (edge.min(edge + thick), edge.max(edge + thick));
            b.solid(
                Vec3::new(-FRONT - DEPTH, 0.0, low),
                Vec3::new(FRONT + DEPTH, 7.0, high),
                plain(Material::Brick, 1),
            );
        }
    }
    let mut k = 0;
    let mut at = south + 4.0;
    while at < north {
        let side = if k % 2 == 0 { -1.0 } else { 1.0 };
        street_lamp(&mut b, side, at);
        at += 9.5;
        k += 1;
    }
    furnish(&mut b, rng);
    b.finish()
}

fn street_lamp(b: &mut Builder, side: f32, north: f32) {
    let mut mesh = Mesh::default();
    let iron = plain(Material::Leather, 5);
    mesh.tube(&[(Vec3::Y * 0.1, 0.09), (Vec3::Y * 0.5, 0.06), (Vec3::Y * 4.6, 0.045)], 8, 0.0, 1, iron);
    let reach = -side * 1.3;
    mesh.tube(
        &[(Vec3::Y * 4.5, 0.04), (Vec3::new(reach * 0.5, 4.85, 0.0), 0.035), (Vec3::new(reach, 4.85, 0.0), 0.03)],
        6,
        0.0,
        1,
        iron,
    );
    mesh.block(Vec3::new(reach - 0.16, 4.80, -0.12), Vec3::new(reach + 0.16, 4.88, 0.12), iron);
    mesh.block(Vec3::new(reach - 0.13, 4.70, -0.09), Vec3::new(reach + 0.13, 4.80, 0.09), plain(Material::Glow, 0));
    let at = Vec2::new(side * (ROAD + 0.45), north);
    b.stand(&mesh, at, 0, 0.12);
    b.lamp(Vec3::new(at.x + reach, 4.62, north), Vec3::new(1.0, 0.76, 0.46) * 13.0, 15.0);
}

/// A narrow gap between two houses with a fence.
fn alley(b: &mut Builder, side: f32, from: f32, rng: &mut Rng) {
    let x = side * (FRONT + 0.5);
    let wood = plain(Material::Wood, (rng.bits() & 255) as u8);
    b.solid(Vec3::new(x - 0.06, 0.0, from), Vec3::new(x + 0.06, 2.2, from + 2.4), wood);
}

/// A house from `from` to `until` along the street.
fn house(b: &mut Builder, side: f32, from: f32, until: f32, rng: &mut Rng) {
    let storeys = 2 + rng.bits() % 3;
    let height = storeys as f32 * STOREY + 0.6;
    let surface = if rng.unit() < 0.6 {
        plain(Material::Brick, (rng.bits() & 255) as u8)
    } else {
        plain(Material::Plaster, (rng.bits() & 255) as u8)
    };
    let x = side * FRONT;
    let (a, z) = if side < 0.0 { (x - DEPTH, x - 0.35) } else { (x + 0.35, x + DEPTH) };
    // The body behind the facade, and the facade with its openings.
    b.solid(Vec3::new(a, 0.0, from), Vec3::new(z, height, until), surface);
    let wall = Wall { along_north: true, at: x + side * 0.18, from, until, height, thickness: 0.36, surface };
    let columns = ((until - from) / 2.2) as u32;
    let pitch = (until - from) / columns as f32;
    let door = rng.bits() % columns;
    let middles: Vec<f32> = (0..columns).map(|k| from + (k as f32 + 0.5) * pitch).collect();
    let openings: Vec<Opening> = (middles.iter().enumerate())
        .map(|(k, m)| if k as u32 == door { Opening::doorway(*m, 1.0) } else { Opening::window(*m, 1.15) })
        .collect();
    let ground = Wall { height: STOREY, ..wall };
    b.wall(ground, &openings);
    let face = |depth: f32| x + side * depth;
    let pane = |b: &mut Builder, middle: f32, half: f32, low: f32, high: f32, rng: &mut Rng| {
        let lit = rng.unit() < 0.55;
        let glass = if lit { plain(Material::Glow, 2 + (rng.bits() % 2) as u8) } else { plain(Material::Steel, 30) };
        let (l, h) = (face(0.30).min(face(0.36)), face(0.30).max(face(0.36)));
        b.block(Vec3::new(l, low, middle - half), Vec3::new(h, high, middle + half), glass);
        if lit && low < STOREY && rng.unit() < 0.7 {
            b.lamp(Vec3::new(face(-0.35), (low + high) * 0.5, middle), Vec3::new(1.0, 0.70, 0.38) * 0.8, 4.5);
        }
    };
    for (k, m) in middles.iter().enumerate() {
        if k as u32 == door {
            let (l, h) = (face(0.30).min(face(0.36)), face(0.30).max(face(0.36)));
            b.block(Vec3::new(l, 0.0, m - 0.5), Vec3::new(h, 2.1, m + 0.5), plain(Material::Glow, 2));
            let passes = (m / 1.9 - 1.5).max(0.3) + rng.range(-0.5, 0.5);
            let leaf = Wall { at: face(0.12), ..ground };
            b.door(leaf, *m, 1.0, passes, -side * rng.range(1.1, 1.5), rng);
            b.block(
                Vec3::new(face(-0.5).min(face(0.0)), 2.25, m - 0.8),
                Vec3::new(face(-0.5).max(face(0.0)), 2.33, m + 0.8),
                plain(Material::Leather, 30),
            );
        } else {
            pane(b, *m, 0.58, 0.95, 2.2, rng);
        }
    }
    for storey in 1..storeys {
        let floor = storey as f32 * STOREY;
        let shift = |o: &Opening| Opening { along: o.along, height: [floor + 0.8, floor + 2.2] };
        let upper: Vec<Opening> = middles.iter().map(|m| shift(&Opening::window(*m, 1.0))).collect();
        storey_wall(b, wall, floor, (floor + STOREY).min(height), &upper);
        for m in &middles {
            pane(b, *m, 0.5, floor + 0.8, floor + 2.2, rng);
        }
    }
    // Cornice and roof edge.
    let (l, h) = (face(-0.14).min(face(0.4)), face(-0.14).max(face(0.4)));
    b.block(Vec3::new(l, height - 0.05, from), Vec3::new(h, height + 0.22, until), plain(Material::Rock, 90));
    b.block(Vec3::new(l, STOREY - 0.06, from), Vec3::new(h, STOREY + 0.06, until), plain(Material::Rock, 90));
    b.buildings.objects += 1;
}

/// An upper storey's wall with windows, without collision.
fn storey_wall(b: &mut Builder, wall: Wall, low: f32, high: f32, windows: &[Opening]) {
    let mut from = wall.from;
    let frame = plain(Material::Paint, 4);
    for window in windows {
        let ([a, z], [sill, lintel]) = (window.along, window.height);
        for (l, h, surface) in
            [(from, a, None), (a, z, Some((low, sill))), (a, z, Some((lintel, high)))].map(|(from, until, span)| {
                let (low, high) = span.unwrap_or((low, high));
                let (l, h) = wall.block(from, until, low, high, 0.0);
                (l, h, wall.surface)
            })
        {
            b.block(l, h, surface);
        }
        let (l, h) = wall.block(a - 0.06, z + 0.06, sill - 0.06, sill, 0.07);
        b.block(l, h, frame);
        from = z;
    }
    let (l, h) = wall.block(from, wall.until, low, high, 0.0);
    b.block(l, h, wall.surface);
}

/// A parked car along z, its middle at the origin.
fn car(paint: TriangleMaterial) -> Mesh {
    let mut mesh = Mesh::default();
    let (tyre, glass) = (plain(Material::Leather, 3), plain(Material::Steel, 20));
    mesh.block(Vec3::new(-0.85, 0.32, -2.05), Vec3::new(0.85, 0.82, 2.05), paint);
    mesh.block(Vec3::new(-0.74, 0.82, -1.15), Vec3::new(0.74, 1.36, 0.85), glass);
    mesh.block(Vec3::new(-0.76, 1.36, -1.1), Vec3::new(0.76, 1.44, 0.8), paint);
    for x in [-0.76_f32, 0.76] {
        for z in [-1.1_f32, 0.8] {
            mesh.block(Vec3::new(x - 0.03, 0.82, z - 0.05), Vec3::new(x + 0.03, 1.38, z + 0.05), paint);
        }
        for z in [-1.3_f32, 1.3] {
            mesh.tube(&[(Vec3::new(x - 0.1, 0.33, z), 0.33), (Vec3::new(x + 0.1, 0.33, z), 0.33)], 14, 0.0, 1, tyre);
        }
        mesh.block(
            Vec3::new(x * 0.8 - 0.14, 0.55, 2.05),
            Vec3::new(x * 0.8 + 0.14, 0.68, 2.07),
            plain(Material::Plaster, 3),
        );
        mesh.block(
            Vec3::new(x * 0.8 - 0.14, 0.58, -2.07),
            Vec3::new(x * 0.8 + 0.14, 0.68, -2.05),
            plain(Material::Paint, 0),
        );
    }
    mesh
}

/// Cars, trees, benches, bins and bollards.
fn furnish(b: &mut Builder, rng: &mut Rng) {
    let [south, north] = ENDS;
    let trees: Vec<Mesh> = (0..3).map(|_| objects::broadleaf(rng.range(5.0, 6.5), Detail::Fine, rng)).collect();
    for side in [-1.0_f32, 1.0] {
        let mut at = south + rng.range(3.0, 8.0);
        while at < north - 4.0 {
            let kerb = side * (ROAD - 1.05);
            match rng.bits() % 3 {
                0 | 1 => {
                    let mesh = car(plain(Material::Paint, (rng.bits() % 8) as u8));
                    b.stand(&mesh, Vec2::new(kerb, at), if side < 0.0 { 0 } else { 2 }, 0.0);
                    b.buildings.obstacles.extend([-1.3, 0.0, 1.3].map(|z| (Vec2::new(kerb, at + z), 0.95)));
                }
                _ => {
                    let tree = &trees[rng.bits() as usize % trees.len()];
                    b.tree(tree, Vec2::new(side * (ROAD + 1.3), at), rng.bits() % 4);
                }
            }
            let pavement = side * (FRONT - 0.75);
            let wood = plain(Material::Wood, 80);
            let iron = plain(Material::Leather, 8);
            match rng.bits() % 3 {
                0 => b.furniture(
                    Vec2::new(pavement, at + 2.5),
                    0,
                    0.6,
                    &[
                        (Vec3::new(-0.22, 0.48, -0.8), Vec3::new(0.22, 0.54, 0.8), wood),
                        (Vec3::new(-0.2, 0.1, -0.7), Vec3::new(0.2, 0.48, -0.62), iron),
                        (Vec3::new(-0.2, 0.1, 0.62), Vec3::new(0.2, 0.48, 0.7), iron),
                    ],
                ),
                1 => b.furniture(
                    Vec2::new(pavement, at + 2.2),
                    0,
                    0.3,
                    &[(Vec3::new(-0.25, 0.1, -0.25), Vec3::new(0.25, 1.0, 0.25), plain(Material::Paint, 3))],
                ),
                _ => {}
            }
            b.furniture(
                Vec2::new(side * (ROAD + 0.35), at + 3.4),
                0,
                0.1,
                &[(Vec3::new(-0.07, 0.1, -0.07), Vec3::new(0.07, 0.85, 0.07), iron)],
            );
            at += rng.range(6.0, 9.0);
        }
    }
}
