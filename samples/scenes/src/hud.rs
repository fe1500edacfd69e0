//! A head-up display over a picture: score, timer, health, ammunition, a crosshair, and a minimap that turns with the walker.
//!
//! It is drawn after tone mapping and blended between code values, as engines draw their interface. Sizes follow the picture's height; edges are
//! anti-aliased. Depth and motion stay those of the world behind it.

use cairn::Picture;
use glam::{Vec2, Vec3, Vec4};
use spleen_font::FONT_32X64;

use crate::render::Moment;
use crate::scene::Scene;

/// Side of the glyph cells of the font, in dots.
const CELL: Vec2 = Vec2::new(32.0, 64.0);
/// Bytes before the glyphs of a PSF 2 font, which come in order of their codes.
const FONT_HEADER: usize = 32;
/// Height of the picture in the units of the layout.
const HEIGHT: f32 = 360.0;
/// Radius of the minimap's terrain in metres.
const MAP_REACH: f32 = 28.0;
/// Rounds in a full magazine.
const MAGAZINE: u32 = 30;
/// Seconds between two rounds.
const ROUND: f32 = 0.35;

/// What the head-up display shows at one moment: all of it follows from the time and the walk.
#[derive(Debug, Clone, PartialEq)]
pub struct HudValues {
    /// Points: ten for each metre walked, and a hundred every two seconds.
    pub score: u32,
    /// Rounds left in the magazine, 1 to 30.
    pub rounds: u32,
    /// Rounds left outside the magazine.
    pub reserve: u32,
    /// Health, 0 to 1.
    pub health: f32,
    /// Minutes, seconds and hundredths since the start.
    pub timer: [u32; 3],
}

impl HudValues {
    /// The values at `moment`.
    pub fn at(moment: &Moment) -> Self {
        let time = moment.time.max(0.0);
        let shots = (time / ROUND) as u32;
        let hundredths = (f64::from(time) * 100.0).round() as u32;
        Self {
            score: (moment.walked * 10.0) as u32 + (time / 2.0) as u32 * 100,
            rounds: MAGAZINE - shots % MAGAZINE,
            reserve: 240_u32.saturating_sub(shots / MAGAZINE * MAGAZINE),
            health: 0.62 + 0.38 * (time * 0.8).cos(),
            timer: [hundredths / 6000, hundredths / 100 % 60, hundredths % 100],
        }
    }
}

/// Draws the head-up display of `moment` over `picture`. Returns its opacity over each pixel, 0 to 255: pixels of opacity 0 are unchanged.
pub fn draw(picture: &mut Picture, scene: &Scene, moment: &Moment) -> Vec<u8> {
    let mut canvas = Canvas::new(picture.width(), picture.height());
    let values = HudValues::at(moment);
    let (right, white) = (canvas.right(), Vec3::ONE);
    canvas.panel(Vec2::new(8.0, 8.0), Vec2::new(128.0, 30.0));
    canvas.text(Vec2::new(13.0, 10.0), 18.0, &format!("SCORE {:06}", values.score), white);
    let [minutes, seconds, hundredths] = values.timer;
    let timer = format!("{minutes:02}:{seconds:02}.{hundredths:02}");
    canvas.panel(Vec2::new(right * 0.5 - 41.0, 8.0), Vec2::new(right * 0.5 + 41.0, 30.0));
    canvas.text(Vec2::new(right * 0.5 - 36.0, 10.0), 18.0, &timer, Vec3::new(1.0, 0.92, 0.6));

    let bar = Vec2::new(8.0, HEIGHT - 26.0);
    canvas.panel(bar - Vec2::new(0.0, 20.0), bar + Vec2::new(132.0, 18.0));
    canvas.text(bar + Vec2::new(5.0, -19.0), 18.0, &format!("HP {:3.0}", values.health * 100.0), white);
    let (inner, length) = (bar + Vec2::new(5.0, 1.0), 122.0);
    canvas.rectangle(inner, inner + Vec2::new(length, 11.0), Vec3::splat(0.12), 0.85);
    let colour = Vec3::new(0.85, 0.18, 0.12).lerp(Vec3::new(0.25, 0.8, 0.3), values.health);
    canvas.rectangle(inner, inner + Vec2::new(length * values.health, 11.0), colour, 0.95);

    let ammunition = format!("{:2}/{:3}", values.rounds, values.reserve);
    canvas.panel(Vec2::new(right - 90.0, HEIGHT - 38.0), Vec2::new(right - 8.0, HEIGHT - 8.0));
    canvas.text(Vec2::new(right - 85.0, HEIGHT - 35.0), 24.0, &ammunition, white);

    canvas.crosshair();
    canvas.minimap(scene, moment, Vec2::new(right - 52.0, 52.0), 44.0);
    canvas.blend_over(picture)
}

/// Colour and opacity over a picture, in floats, with positions in units of 1/360 of its height.
struct Canvas {
    width: usize,
    height: usize,
    /// Pixels per unit.
    scale: f32,
    /// Premultiplied colour, 0 to 1, and opacity.
    pixels: Vec<Vec4>,
}

impl Canvas {
    fn new(width: u32, height: u32) -> Self {
        let (width, height) = (width as usize, height as usize);
        Self { width, height, scale: height as f32 / HEIGHT, pixels: vec![Vec4::ZERO; width * height] }
    }

    /// The right border in units.
    fn right(&self) -> f32 {
        self.width as f32 / self.scale
    }

    /// Paints what is `inside` between two corners. Coverage is the mean of 4 x 4 points per pixel.
    fn fill(&mut self, from: Vec2, to: Vec2, colour: Vec3, opacity: f32, inside: impl Fn(Vec2) -> bool) {
        const POINTS: usize = 4;
        let (low, high) = ((from * self.scale).floor().max(Vec2::ZERO), (to * self.scale).ceil().max(Vec2::ZERO));
        for y in low.y as usize..(high.y as usize).min(self.height) {
            for x in low.x as usize..(high.x as usize).min(self.width) {
                let hits = (0..POINTS * POINTS)
                    .filter(|k| {
                        let offset = (Vec2::new((k % POINTS) as f32, (k / POINTS) as f32) + 0.5) / POINTS as f32;
                        inside((Vec2::new(x as f32, y as f32) + offset) / self.scale)
                    })
                    .count();
                let alpha = opacity * hits as f32 / (POINTS * POINTS) as f32;
                let pixel = &mut self.pixels[y * self.width + x];
                *pixel = colour.extend(1.0) * alpha + *pixel * (1.0 - alpha);
            }
        }
    }

    fn rectangle(&mut self, from: Vec2, to: Vec2, colour: Vec3, opacity: f32) {
        self.fill(from, to, colour, opacity, |p| p.cmpge(from).all() && p.cmple(to).all());
    }

    /// A dark translucent rectangle behind text.
    fn panel(&mut self, from: Vec2, to: Vec2) {
        self.rectangle(from, to, Vec3::splat(0.05), 0.45);
    }

    fn disc(&mut self, centre: Vec2, radius: f32, colour: Vec3, opacity: f32, inside: impl Fn(Vec2) -> bool) {
        let within = |p: Vec2| p.distance_squared(centre) <= radius * radius && inside(p);
        self.fill(centre - radius, centre + radius, colour, opacity, within);
    }

    /// One line of ASCII text with its upper left corner at `at`, `size` units high and half as wide per character.
    fn text(&mut self, at: Vec2, size: f32, text: &str, colour: Vec3) {
        let scale = CELL.y / size;
        for (k, code) in text.bytes().enumerate() {
            let corner = at + Vec2::new(k as f32 * size * 0.5, 0.0);
            let bytes = (CELL.x * CELL.y) as usize / 8;
            let start = FONT_HEADER + usize::from(code) * bytes;
            let glyph = FONT_32X64.get(start..start + bytes).unwrap_or_default();
            let dot = |p: Vec2| {
                let p = (p - corner) * scale;
                if p.cmplt(Vec2::ZERO).any() || p.cmpge(CELL).any() {
                    return false;
                }
                let (x, y) = (p.x as usize, p.y as usize);
                glyph.get(y * CELL.x as usize / 8 + x / 8).is_some_and(|byte| byte & (0x80 >> (x % 8)) != 0)
            };
            let shade = Vec2::splat(size / 16.0);
            let end = corner + Vec2::new(size * 0.5, size);
            self.fill(corner + shade, end + shade, Vec3::ZERO, 0.6, |p| dot(p - shade));
            self.fill(corner, end, colour, 1.0, dot);
        }
    }

    fn crosshair(&mut self) {
        let centre = Vec2::new(self.right(), HEIGHT) * 0.5;
        for (grow, colour, opacity) in [(0.8, Vec3::ZERO, 0.5), (0.0, Vec3::new(0.9, 1.0, 0.9), 0.9)] {
            for direction in [Vec2::X, -Vec2::X, Vec2::Y, -Vec2::Y] {
                let (near, far) = (centre + direction * (4.0 - grow), centre + direction * (11.0 + grow));
                let side = direction.perp().abs() * (0.75 + grow);
                self.rectangle(near.min(far) - side, near.max(far) + side, colour, opacity);
            }
            self.disc(centre, 1.0 + grow, colour, opacity, |_| true);
        }
    }

    /// The surroundings from above, with the walker's view upwards: the path, obstacles, and north.
    fn minimap(&mut self, scene: &Scene, moment: &Moment, centre: Vec2, radius: f32) {
        let here = Vec2::new(moment.camera.position.x, moment.camera.position.z);
        let (sin, cos) = moment.camera.yaw.sin_cos();
        let (ahead, aside) = (Vec2::new(sin, cos), Vec2::new(cos, -sin));
        let metres = MAP_REACH / radius;
        let to_world = |p: Vec2| here + (aside * (p.x - centre.x) + ahead * (centre.y - p.y)) * metres;
        let to_map = |d: Vec2| centre + Vec2::new(d.dot(aside), -d.dot(ahead)) / metres;
        let within = |p: Vec2| p.distance(centre) <= radius;
        self.disc(centre, radius, Vec3::new(0.07, 0.1, 0.08), 0.6, |_| true);
        let half_width = scene.terrain.path_half_width();
        let path = Vec3::new(0.75, 0.68, 0.5);
        self.disc(centre, radius, path, 0.8, |p| scene.terrain.path_offset(to_world(p)).abs() < half_width);
        for &(at, size) in &scene.obstacles {
            let dot = (size / metres).max(0.9);
            let place = to_map(at - here);
            if place.distance(centre) < radius + dot {
                self.disc(place, dot, Vec3::new(0.35, 0.62, 0.35), 0.9, within);
            }
        }
        let ring = |p: Vec2| p.distance(centre) > radius - 1.6;
        self.disc(centre, radius, Vec3::splat(0.9), 0.8, ring);
        let north = centre + Vec2::new(Vec2::Y.dot(aside), -Vec2::Y.dot(ahead)) * (radius - 1.0);
        self.disc(north, 5.5, Vec3::splat(0.05), 0.8, |_| true);
        self.text(north - Vec2::new(2.75, 5.5), 11.0, "N", Vec3::new(1.0, 0.45, 0.35));
        // The walker: an arrowhead that points up.
        let arrow = |p: Vec2| {
            let d = p - centre;
            d.y > -6.0 && d.y < 4.5 && d.x.abs() < (d.y + 6.0) * 0.42 && d.y < 2.0 + d.x.abs() * 0.7
        };
        self.fill(centre - 7.0, centre + 7.0, Vec3::new(1.0, 0.85, 0.2), 1.0, arrow);
    }

    fn blend_over(&self, picture: &mut Picture) -> Vec<u8> {
        let blend = |(paint, pixel): (&Vec4, &mut [u8; 4])| {
            let opacity = (paint.w * 255.0 + 0.5) as u8;
            if opacity > 0 {
                let (share, colour) = (f32::from(opacity) / 255.0, paint.truncate() / paint.w);
                for (code, colour) in pixel.iter_mut().zip(colour.to_array()) {
                    // A whole code value, so that what changes does not depend on rounding.
                    let target = (colour * 255.0).round();
                    *code = (f32::from(*code) + (target - f32::from(*code)) * share + 0.5) as u8;
                }
            }
            opacity
        };
        self.pixels.iter().zip(picture.pixels_mut()).map(blend).collect()
    }
}
