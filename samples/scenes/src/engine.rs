//! Motion and depth as game engines give them: the truth after each engine's habits, as independent switches.
//!
//! A frame passes these steps: motion of skinned meshes from the camera alone, removal of the camera's jitter, dilation, a lower resolution, the
//! texture's format, and composition over several frames. [`Frame`] itself already has what all engines have in common: alpha-blended particles,
//! shadows and a head-up display have no motion of their own, and pixels under them have the motion and depth of the surface behind.

use std::collections::VecDeque;

use cairn::guidance::{DepthEncoding, DepthMap, Guidance, MotionField, MotionOrigin, Projection};
use cairn::{Error, ErrorKind, Picture, Result};
use glam::Vec2;
use half::f16;

use crate::camera::{FAR, NEAR, view_distance};
use crate::render::{Frame, Moment, MotionKind};

/// How a motion texture stores a vector. All formats store both components alike.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum MotionFormat {
    /// 32-bit floats in pixels: exact.
    #[default]
    Float32,
    /// 16-bit floats in parts of the picture's size, as Unity's `RenderTextureFormat.RGHalf`.
    Half,
    /// 16-bit unsigned integers, as Unreal Engine 4: `v * 0.2495 + 32767 / 65535`, where `v` is the motion in clip space, -2 to 2, of which the
    /// picture's side is 2.
    Unorm16,
    /// 16-bit unsigned integers of a square root, as Unreal Engine 5: as [`Unorm16`](Self::Unorm16) of `sign(v) sqrt(2 |v|)`.
    Unorm16Root,
    /// 8-bit unsigned integers of a square root, as CryENGINE 3: `sign(v) sqrt(|v|) / 2 + 127 / 255`, where `v` is in parts of the picture's
    /// size, -1 to 1.
    Unorm8Root,
}

/// Scale and zero of Unreal's encoding.
const UNREAL_SCALE: f64 = 0.499 * 0.5;
const UNREAL_ZERO: f64 = 32767.0;
/// Largest code of 16 bits.
const CODES_16: f64 = 65535.0;
/// Zero and largest code of CryENGINE's encoding.
const CRY_ZERO: f64 = 127.0;
const CODES_8: f64 = 255.0;

impl MotionFormat {
    /// Stores `motion`, in pixels of a picture of `size`, and loads it again. Vectors longer than the format's range are clamped to it, and
    /// non-finite ones become 0.
    pub fn round_trip(self, motion: Vec2, size: Vec2) -> Vec2 {
        if !motion.is_finite() {
            return Vec2::ZERO;
        }
        // Unreal stores current minus previous with y up: the negated x and the y of ours. Its zero is not in the middle of the codes.
        let x = -self.round_trip_component(-motion.x, size.x);
        Vec2::new(x, self.round_trip_component(motion.y, size.y))
    }

    /// One component of a vector, in pixels of a picture that is `side` pixels long.
    fn round_trip_component(self, pixels: f32, side: f32) -> f32 {
        let root = |v: f64| v.signum() * v.abs().sqrt();
        let square = |v: f64| v * v.abs();
        let code = |v: f64, scale: f64, zero: f64, last: f64| {
            ((v * scale * last + zero).round().clamp(0.0, last) - zero) / last / scale
        };
        let unreal = |v: f64| code(v, UNREAL_SCALE, UNREAL_ZERO, CODES_16);
        let part = f64::from(pixels) / f64::from(side);
        let clip = (part * 2.0).clamp(-2.0, 2.0);
        let stored = match self {
            Self::Float32 => return pixels,
            Self::Half => f16::from_f64(part).to_f64(),
            Self::Unorm16 => unreal(clip) * 0.5,
            Self::Unorm16Root => square(unreal(root(2.0 * clip))) * 0.25,
            Self::Unorm8Root => square(code(root(part.clamp(-1.0, 1.0)), 0.5, CRY_ZERO, CODES_8)),
        };
        (stored * f64::from(side)) as f32
    }

    /// Maximum error of each component of `motion` in pixels, for vectors within the format's range: half a step between codes.
    pub fn error_bound(self, motion: Vec2, size: Vec2) -> Vec2 {
        let half_code_16 = (0.5 / CODES_16 / UNREAL_SCALE) as f32;
        match self {
            Self::Float32 => Vec2::ZERO,
            // 11 significant bits; subnormal numbers are multiples of 2^-24.
            Self::Half => motion.abs() * 2_f32.powi(-11) + size * 2_f32.powi(-25),
            Self::Unorm16 => size * 0.5 * half_code_16,
            Self::Unorm16Root => {
                let stored = (motion.abs() * 2.0 / size * 2.0).map(f32::sqrt);
                (stored * half_code_16 + half_code_16 * half_code_16 * 0.5) * size * 0.5
            }
            Self::Unorm8Root => {
                let half_code = (1.0 / CODES_8) as f32;
                let stored = (motion.abs() / size).map(f32::sqrt);
                (stored * 2.0 * half_code + half_code * half_code) * size
            }
        }
    }
}

/// The habits of an engine, independent of each other. The default is the exact truth without the camera's jitter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EngineOptions {
    /// Frames that a vector spans, 1 to 64: above 1, one-frame vectors are composed by following them, sampled bilinearly.
    pub frames: u32,
    /// Format of the one-frame motion textures.
    pub format: MotionFormat,
    /// Whether each pixel takes the vector of the nearest depth among its 3 x 3 neighbours. Of equal depths the pixel itself wins, then the first one
    /// in order of rows.
    pub dilate: bool,
    /// Whether vectors contain the difference of the two pictures' camera jitter.
    pub keep_jitter: bool,
    /// Whether skinned meshes have the camera's motion only, as where their previous pose is not kept.
    pub skinned_from_camera: bool,
    /// Pixels per side of the square that shares a vector: 1, 2 (half resolution), 8 or 16. The vector is that of the pixel right and below of the
    /// square's middle, or of the last pixel of a square that the picture's border cuts.
    pub texel: u32,
    /// Encoding of depth.
    pub depth: DepthEncoding,
}

impl Default for EngineOptions {
    fn default() -> Self {
        Self {
            frames: 1,
            format: MotionFormat::default(),
            dilate: false,
            keep_jitter: false,
            skinned_from_camera: false,
            texel: 1,
            depth: DepthEncoding::default(),
        }
    }
}

/// Motion vectors of a picture, one per square of `texel` x `texel` pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionTexture {
    /// Pixels per side of a square.
    pub texel: u32,
    /// Squares in a row. The last column and row may extend outside the picture.
    pub columns: u32,
    /// Rows of squares.
    pub rows: u32,
    /// The vectors row by row: pixels of the whole picture, y down, from the current picture to the previous one. Always finite.
    pub vectors: Vec<Vec2>,
}

impl MotionTexture {
    fn new(width: u32, height: u32, texel: u32, vector: impl Fn(usize, usize) -> Vec2) -> Self {
        let (columns, rows) = (width.div_ceil(texel), height.div_ceil(texel));
        let place = |index: u32, side: u32| (index * texel + texel / 2).min(side - 1) as usize;
        let vectors =
            (0..columns * rows).map(|k| vector(place(k % columns, width), place(k / columns, height))).collect();
        Self { texel, columns, rows, vectors }
    }

    /// The vector of pixel (x, y).
    pub fn at(&self, x: u32, y: u32) -> Vec2 {
        self.vectors[(y / self.texel * self.columns + x / self.texel) as usize]
    }

    /// Bilinear sample at a pixel position; positions outside are clamped to the border.
    fn sample(&self, at: Vec2) -> Vec2 {
        let at = at / self.texel as f32 - 0.5;
        let last = Vec2::new((self.columns - 1) as f32, (self.rows - 1) as f32);
        let at = at.clamp(Vec2::ZERO, last);
        let low = at.floor();
        let part = at - low;
        let (x, y) = (low.x as u32, low.y as u32);
        let (right, below) = ((x + 1).min(self.columns - 1), (y + 1).min(self.rows - 1));
        let texel = |x: u32, y: u32| self.vectors[(y * self.columns + x) as usize];
        let top = texel(x, y).lerp(texel(right, y), part.x);
        top.lerp(texel(x, below).lerp(texel(right, below), part.x), part.y)
    }
}

/// What an engine hands to a frame generator for one frame.
#[derive(Debug, Clone)]
pub struct EngineInputs {
    /// The picture.
    pub picture: Picture,
    /// Depth of each pixel's centre in [`depth_encoding`](Self::depth_encoding). Linear depth is in metres; the sky is at [`FAR`].
    pub depth: Vec<f32>,
    /// Encoding of the depth. Reversed depth is 1 minus the frame's, and has no more precision than that.
    pub depth_encoding: DepthEncoding,
    /// Motion to the picture [`EngineOptions::frames`] frames earlier; 0 where the truth is not finite, and everywhere at a reset.
    pub motion: MotionTexture,
    /// Jitter of the picture's camera in pixels, right and down.
    pub jitter: Vec2,
    /// Whether there is no picture of the same shot that many frames earlier: at the start and after a camera cut.
    pub reset: bool,
    vertical_fov: f32,
}

impl EngineInputs {
    /// The inputs as this library's guidance. Motion of half resolution is expanded to pixels.
    ///
    /// # Errors
    /// `InvalidArgument` for pictures that are larger than guidance may be, `OutOfMemory`.
    pub fn guidance(&self) -> Result<Guidance> {
        let (width, height) = self.picture.size();
        let projection = Projection::new(NEAR, FAR, self.vertical_fov)?;
        let depth = DepthMap::from_host(width, height, self.depth.clone(), self.depth_encoding, projection)?;
        let tile = if self.motion.texel == 2 { 1 } else { self.motion.texel };
        let mut motion = MotionField::tiled(width, height, tile)?;
        let columns = width.div_ceil(tile);
        for (k, vector) in motion.vectors_mut().iter_mut().enumerate() {
            let (x, y) = (k as u32 % columns * tile, k as u32 / columns * tile);
            *vector = self.motion.at(x, y).to_array().map(f16::from_f32);
        }
        Guidance::from_parts(motion, depth, MotionOrigin::Geometry)
    }
}

/// Turns true frames into an engine's inputs. It is given every frame in order.
#[derive(Debug)]
pub struct Engine {
    options: EngineOptions,
    /// One-frame motion of the last frames, the latest first.
    past: VecDeque<MotionTexture>,
    /// Shots of the last frames, the latest first.
    shots: VecDeque<u32>,
}

impl Engine {
    /// An engine with the habits `options`.
    ///
    /// # Errors
    /// `InvalidArgument` for a number of frames outside 1 to 64, a texel other than 1, 2, 8 or 16, or depth that is both inverted and linear.
    pub fn new(options: EngineOptions) -> Result<Self> {
        let refuse = |cause: String, field: &str, remedy: &str| {
            Err(Error::new(ErrorKind::InvalidArgument, cause).field(field).remedy(remedy))
        };
        if !(1..=64).contains(&options.frames) {
            return refuse(format!("motion over {} frames", options.frames), "frames", "Use 1 to 64 frames");
        }
        if ![1, 2, 8, 16].contains(&options.texel) {
            return refuse(format!("one vector for {0} x {0} pixels", options.texel), "texel", "Use 1, 2, 8 or 16");
        }
        if options.depth.inverted && options.depth.linear {
            return refuse("depth cannot be both inverted and linear".into(), "depth", "Clear `inverted`");
        }
        Ok(Self { options, past: VecDeque::new(), shots: VecDeque::new() })
    }

    /// The inputs of `frame`, rendered at `now` with motion to `before`, the moment of the frame before it.
    pub fn push(&mut self, frame: &Frame, now: &Moment, before: &Moment) -> EngineInputs {
        let options = self.options;
        let (width, height) = frame.picture.size();
        let size = Vec2::new(width as f32, height as f32);
        let jitter = if options.keep_jitter { Vec2::ZERO } else { before.jitter - now.jitter };
        let of_pixel = |k: usize| {
            let camera_only = options.skinned_from_camera && frame.surfaces[k] == MotionKind::Skinned;
            let motion = if camera_only { frame.camera_motion[k] } else { frame.motion[k] };
            options.format.round_trip(motion - jitter, size)
        };
        let (w, h) = (width as usize, height as usize);
        let latest = MotionTexture::new(width, height, options.texel, |x, y| {
            let centre = y * w + x;
            if !options.dilate {
                return of_pixel(centre);
            }
            let neighbours = (y.saturating_sub(1)..(y + 2).min(h))
                .flat_map(|j| (x.saturating_sub(1)..(x + 2).min(w)).map(move |i| j * w + i));
            let nearer = |best: usize, k: usize| if frame.depth[k] < frame.depth[best] { k } else { best };
            of_pixel(neighbours.fold(centre, nearer))
        });

        let reset = self.shots.get(options.frames as usize - 1) != Some(&now.shot);
        let motion = if reset {
            MotionTexture { vectors: vec![Vec2::ZERO; latest.vectors.len()], ..latest }
        } else {
            MotionTexture::new(width, height, options.texel, |x, y| {
                let mut motion = latest.at(x as u32, y as u32);
                let centre = Vec2::new(x as f32, y as f32) + 0.5;
                for earlier in &self.past {
                    motion += earlier.sample(centre + motion);
                }
                motion
            })
        };
        self.past.push_front(latest);
        self.past.truncate(options.frames as usize - 1);
        self.shots.push_front(now.shot);
        self.shots.truncate(options.frames as usize);

        let convert = |depth: &f32| match options.depth {
            DepthEncoding { linear: true, .. } => view_distance(*depth),
            DepthEncoding { inverted: true, .. } => 1.0 - depth,
            DepthEncoding { .. } => *depth,
        };
        EngineInputs {
            picture: frame.picture.clone(),
            depth: frame.depth.iter().map(convert).collect(),
            depth_encoding: options.depth,
            motion,
            jitter: now.jitter,
            reset,
            vertical_fov: now.camera.vertical_fov,
        }
    }
}
