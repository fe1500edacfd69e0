//! A house: a corridor that leads from room to room through a hall, with furniture, windows and lamps.

use glam::{Vec2, Vec3};

use super::{Builder, Buildings, Opening, Wall, plain};
use crate::cast::Cast;
use crate::material::Material;
use crate::mesh::{Mesh, TriangleMaterial};
use crate::noise::Rng;
use crate::objects;

/// Height of the ceiling in metres.
const CEILING: f32 = 2.8;
/// Half the width of the corridor.
const CORRIDOR: f32 = 1.35;
/// Distance of the outer walls from the corridor's middle.
const OUTER: f32 = 6.6;
/// Where the hall begins and ends along north.
const HALL: [f32; 2] = [9.0, 20.0];
/// South and north ends of the house.
const ENDS: [f32; 2] = [-5.0, 44.0];
const THICKNESS: f32 = 0.16;

/// Builds the house around the origin, where the walk starts in the corridor.
pub(crate) fn indoors(cast: Cast, rng: &mut Rng) -> Buildings {
    let mut b = Builder::new(cast);
    let [south, north] = ENDS;
    b.slab(Vec3::new(-OUTER, -0.2, south), Vec3::new(OUTER, 0.02, HALL[0]), plain(Material::Boards, 1));
    b.slab(Vec3::new(-OUTER, -0.2, HALL[0]), Vec3::new(OUTER, 0.02, HALL[1]), plain(Material::Tiles, 1));
    b.slab(Vec3::new(-OUTER, -0.2, HALL[1]), Vec3::new(OUTER, 0.02, north), plain(Material::Boards, 9));
    b.slab(
        Vec3::new(-OUTER - 0.1, CEILING, south),
        Vec3::new(OUTER + 0.1, CEILING + 0.2, north),
        plain(Material::Plaster, 3),
    );

    let wall = |along_north, at, from, until, variant| Wall {
        along_north,
        at,
        from,
        until,
        height: CEILING,
        thickness: THICKNESS,
        surface: plain(Material::Plaster, variant),
    };
    let (inner, outer) = ((rng.bits() % 2) as u8, 2 + (rng.bits() % 2) as u8);
    // Rooms of about five metres beside the corridor, south and north of the hall.
    let rooms: Vec<[f32; 2]> = [[south, 2.0], [2.0, HALL[0]], [HALL[1], 28.0], [28.0, 36.0], [36.0, north]].to_vec();
    for side in [-1.0_f32, 1.0] {
        let windows: Vec<Opening> = rooms
            .iter()
            .chain([&[HALL[0], 14.5], &[14.5, HALL[1]]])
            .map(|[a, z]| Opening::window((a + z) * 0.5, 1.9))
            .collect();
        let mut windows = windows;
        windows.sort_by(|a, b| a.along[0].total_cmp(&b.along[0]));
        b.wall(wall(true, side * OUTER, south, north, outer), &windows);
        for [from, until] in [[south, HALL[0]], [HALL[1], north]] {
            let inside = wall(true, side * CORRIDOR, from, until, inner);
            let of_part: Vec<[f32; 2]> = rooms.iter().copied().filter(|[a, z]| *a >= from && *z <= until).collect();
            let middles: Vec<f32> = of_part.iter().map(|[a, z]| (a + z) * 0.5 + rng.range(-0.8, 0.8)).collect();
            let openings: Vec<Opening> = middles.iter().map(|m| Opening::doorway(*m, 0.95)).collect();
            b.wall(inside, &openings);
            for middle in middles {
                // The walk passes here at about 1.9 m/s.
                let passes = (middle / 1.9 - 1.2).max(0.4) + rng.range(-0.4, 0.4);
                b.door(inside, middle, 0.95, passes, side * rng.range(1.2, 1.7), rng);
            }
        }
        for [_, until] in &rooms[..rooms.len() - 1] {
            if !HALL.contains(until) {
                let (a, z) = if side < 0.0 { (-OUTER, -CORRIDOR) } else { (CORRIDOR, OUTER) };
                b.wall(wall(false, *until, a, z, outer), &[]);
            }
        }
        for edge in HALL {
            let (a, z) = if side < 0.0 { (-OUTER, -CORRIDOR) } else { (CORRIDOR, OUTER) };
            b.wall(wall(false, edge, a, z, inner), &[]);
        }
        for &[a, z] in &rooms {
            room(&mut b, side, a, z, rng);
        }
    }
    // Double doors across the way, which open before the walk passes at about 1.9 m/s.
    for across in [4.6, HALL[0], HALL[1], 31.0] {
        let (partition, width) = (wall(false, across, -CORRIDOR, CORRIDOR, inner), 2.0);
        b.wall(partition, &[Opening::doorway(0.0, width)]);
        let (opens, angle) = (across / 1.9 - 0.5, rng.range(1.3, 1.6));
        b.door(partition, -width * 0.25, width * 0.5, opens, -angle, rng);
        b.door(partition, width * 0.25, -width * 0.5, opens, angle, rng);
    }
    for edge in ENDS {
        b.wall(wall(false, edge, -OUTER, OUTER, outer), &[]);
    }
    hall(&mut b, rng);
    let mut at = south + 2.5;
    while at < north {
        let in_hall = (HALL[0]..HALL[1]).contains(&at);
        if !in_hall {
            ceiling_lamp(&mut b, Vec2::new(0.0, at), 1.9);
            picture(&mut b, if rng.unit() < 0.5 { -1.0 } else { 1.0 }, at + 1.1, rng);
        }
        at += 4.4;
    }
    b.block(Vec3::new(-0.5, 0.02, south + 0.4), Vec3::new(0.5, 0.035, HALL[0] - 0.5), plain(Material::Cloth, 0));
    b.block(Vec3::new(-0.5, 0.02, HALL[1] + 0.5), Vec3::new(0.5, 0.035, north - 0.4), plain(Material::Cloth, 1));
    b.finish()
}

/// A lamp under the ceiling.
fn ceiling_lamp(b: &mut Builder, at: Vec2, strength: f32) {
    let (low, high) = (CEILING - 0.34, CEILING - 0.14);
    b.block(
        Vec3::new(at.x - 0.012, high, at.y - 0.012),
        Vec3::new(at.x + 0.012, CEILING, at.y + 0.012),
        plain(Material::Steel, 2),
    );
    b.block(
        Vec3::new(at.x - 0.16, low, at.y - 0.16),
        Vec3::new(at.x + 0.16, high, at.y + 0.16),
        plain(Material::Glow, 0),
    );
    b.lamp(Vec3::new(at.x, low - 0.06, at.y), Vec3::new(1.0, 0.83, 0.60) * strength, 7.5);
}

/// A framed picture on a wall of the corridor.
fn picture(b: &mut Builder, side: f32, north: f32, rng: &mut Rng) {
    let x = side * (CORRIDOR - THICKNESS * 0.5);
    let (half, low, high) = (rng.range(0.25, 0.42), 1.25, rng.range(1.75, 2.0));
    let depth = |d: f32| if side < 0.0 { (x, x + d) } else { (x - d, x) };
    let (a, z) = depth(0.03);
    b.block(Vec3::new(a, low, north - half), Vec3::new(z, high, north + half), plain(Material::Gold, 4));
    let (a, z) = depth(0.036);
    let canvas = TriangleMaterial { material: Material::Cloth, variant: (rng.bits() & 255) as u8 };
    b.block(Vec3::new(a, low + 0.05, north - half + 0.05), Vec3::new(z, high - 0.05, north + half - 0.05), canvas);
}

fn table(top: Vec2, height: f32, surface: TriangleMaterial) -> Vec<(Vec3, Vec3, TriangleMaterial)> {
    let (x, z) = (top.x * 0.5, top.y * 0.5);
    let mut parts = vec![(Vec3::new(-x, height - 0.05, -z), Vec3::new(x, height, z), surface)];
    for (sx, sz) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let leg = Vec2::new(sx * (x - 0.07), sz * (z - 0.07));
        parts.push((
            Vec3::new(leg.x - 0.03, 0.0, leg.y - 0.03),
            Vec3::new(leg.x + 0.03, height - 0.05, leg.y + 0.03),
            surface,
        ));
    }
    parts
}

fn chair(surface: TriangleMaterial, seat: TriangleMaterial) -> Vec<(Vec3, Vec3, TriangleMaterial)> {
    let mut parts = table(Vec2::splat(0.44), 0.46, surface);
    parts.push((Vec3::new(-0.20, 0.46, -0.20), Vec3::new(0.20, 0.51, 0.20), seat));
    parts.push((Vec3::new(-0.21, 0.46, 0.18), Vec3::new(0.21, 1.0, 0.22), surface));
    parts
}

fn sofa(cloth: TriangleMaterial) -> Vec<(Vec3, Vec3, TriangleMaterial)> {
    vec![
        (Vec3::new(-1.0, 0.08, -0.42), Vec3::new(1.0, 0.44, 0.42), cloth),
        (Vec3::new(-1.0, 0.44, 0.22), Vec3::new(1.0, 0.90, 0.42), cloth),
        (Vec3::new(-1.0, 0.44, -0.42), Vec3::new(-0.82, 0.64, 0.22), cloth),
        (Vec3::new(0.82, 0.44, -0.42), Vec3::new(1.0, 0.64, 0.22), cloth),
    ]
}

/// A shelf of books along x, its back at z = 0.17.
fn shelf(rng: &mut Rng) -> Vec<(Vec3, Vec3, TriangleMaterial)> {
    let wood = plain(Material::Wood, 60);
    let mut parts = vec![
        (Vec3::new(-0.95, 0.0, 0.14), Vec3::new(0.95, 2.05, 0.17), wood),
        (Vec3::new(-0.97, 0.0, -0.17), Vec3::new(-0.93, 2.05, 0.17), wood),
        (Vec3::new(0.93, 0.0, -0.17), Vec3::new(0.97, 2.05, 0.17), wood),
    ];
    for level in 0..6 {
        let y = 0.06 + 0.39 * level as f32;
        parts.push((Vec3::new(-0.95, y, -0.17), Vec3::new(0.95, y + 0.03, 0.17), wood));
        if level == 5 {
            break;
        }
        let mut x = -0.91;
        while x < 0.84 {
            let (wide, tall) = (rng.range(0.03, 0.08), rng.range(0.20, 0.33));
            if rng.unit() > 0.12 {
                let cover = plain(Material::Paint, (rng.bits() % 8) as u8);
                let deep = rng.range(-0.14, -0.05);
                parts.push((Vec3::new(x, y + 0.03, deep), Vec3::new(x + wide, y + 0.03 + tall, 0.12), cover));
            }
            x += wide + 0.004;
        }
    }
    parts
}

/// A plant in a pot.
fn pot_plant(rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.tube(&[(Vec3::ZERO, 0.13), (Vec3::Y * 0.3, 0.18)], 14, 0.0, 1, plain(Material::Paint, 7));
    let bush = objects::bush(0.75, Material::Leaf, rng);
    mesh.add_instance(&bush, Vec3::Y * 0.3, glam::Mat3::IDENTITY, Vec3::new(0.45, 0.8, 0.45));
    mesh
}

/// Furniture of the room between two walls on one side of the corridor.
fn room(b: &mut Builder, side: f32, from: f32, until: f32, rng: &mut Rng) {
    let (x, z) = (side * (CORRIDOR + OUTER) * 0.5, (from + until) * 0.5);
    ceiling_lamp(b, Vec2::new(x, z), 2.4);
    let facing = if side < 0.0 { 1 } else { 3 };
    match rng.bits() % 3 {
        0 => {
            let wood = plain(Material::Wood, (rng.bits() & 255) as u8);
            b.furniture(Vec2::new(x + side * 0.5, z), 0, 0.8, &table(Vec2::new(1.0, 1.7), 0.74, wood));
            let seat = plain(Material::Cloth, (rng.bits() & 255) as u8);
            for (dx, dz, quarter) in [(0.75, -0.4, 1), (0.75, 0.4, 1), (-0.75, -0.4, 3), (-0.75, 0.4, 3)] {
                b.furniture(Vec2::new(x + side * 0.5 + dx, z + dz), quarter, 0.25, &chair(wood, seat));
            }
        }
        1 => {
            let cloth = plain(Material::Cloth, (rng.bits() & 255) as u8);
            b.furniture(Vec2::new(side * (OUTER - 0.6), z), facing + 2, 0.9, &sofa(cloth));
            let wood = plain(Material::Wood, (rng.bits() & 255) as u8);
            b.furniture(Vec2::new(side * (OUTER - 1.9), z), 0, 0.45, &table(Vec2::new(0.6, 1.1), 0.42, wood));
        }
        _ => {
            let wood = plain(Material::Wood, (rng.bits() & 255) as u8);
            b.furniture(Vec2::new(side * (OUTER - 0.5), z), 0, 0.7, &table(Vec2::new(0.7, 1.5), 0.76, wood));
            b.furniture(Vec2::new(side * (OUTER - 1.2), z), facing, 0.25, &chair(wood, plain(Material::Cloth, 5)));
        }
    }
    b.furniture(Vec2::new(x, from + 0.28), 2, 0.5, &shelf(rng));
    let plant = pot_plant(rng);
    b.stand(&plant, Vec2::new(side * (OUTER - 0.5), until - 0.6), 0, 0.3);
    b.block(
        Vec3::new(x - 1.2, 0.02, z - 1.5),
        Vec3::new(x + 1.2, 0.034, z + 1.5),
        plain(Material::Cloth, (rng.bits() & 255) as u8),
    );
}

/// The hall: pillars, benches, plants and two rows of lamps.
fn hall(b: &mut Builder, rng: &mut Rng) {
    let [from, until] = HALL;
    for z in [from + 2.6, until - 2.6] {
        for x in [-3.4_f32, 3.4] {
            b.solid(Vec3::new(x - 0.2, 0.0, z - 0.2), Vec3::new(x + 0.2, CEILING, z + 0.2), plain(Material::Brick, 2));
            ceiling_lamp(b, Vec2::new(x * 0.55, z), 2.6);
        }
        for x in [-5.2_f32, 5.2] {
            let cloth = plain(Material::Cloth, (rng.bits() & 255) as u8);
            b.furniture(Vec2::new(x, z), if x < 0.0 { 3 } else { 1 }, 0.9, &sofa(cloth));
        }
    }
    for x in [-2.2_f32, 2.2] {
        let plant = pot_plant(rng);
        b.stand(&plant, Vec2::new(x, from + 0.7), 0, 0.3);
        let wood = plain(Material::Wood, (rng.bits() & 255) as u8);
        b.furniture(Vec2::new(x * 1.5, (from + until) * 0.5), 0, 0.6, &table(Vec2::new(0.9, 1.2), 0.74, wood));
    }
}
