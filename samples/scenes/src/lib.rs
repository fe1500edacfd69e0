//! Procedural scenes with ground truth: colour, device depth and exact motion, drawn on the CPU.
//!
//! A [`Scene`] is made from a [`Family`], a seed and a [`Cast`]: the things that move in it. A [`Walker`] turns controls into a camera. [`render`]
//! draws a [`Frame`]: colour, depth, and motion to the previous frame. Everything is deterministic and independent of the thread count.
#![warn(missing_docs)]

mod actors;
mod animation;
pub mod camera;
mod cast;
mod clip;
pub mod edit;
pub mod engine;
mod family;
pub mod film;
mod geometry;
pub mod hud;
mod lamp;
mod light;
mod material;
mod mesh;
mod noise;
mod objects;
mod particles;
mod placement;
mod places;
mod pose;
mod raster;
mod render;
mod scene;
mod shadow;
mod terrain;
mod walk;
mod water;

pub use cast::Cast;
pub use clip::{Clip, ClipFrame, ClipOptions, Effects, MAX_RATE, TAA_PHASES};
pub use family::{FAMILIES, Family, LANDSCAPES, Weather};
pub use render::{Frame, MIRRORS, Moment, MotionKind, Quality, render, render_picture};
pub use scene::Scene;
pub use walk::{EASE, EYE, MAX_PITCH, RUN, Start, TURN_PER_COUNT, WALK, Walker};
