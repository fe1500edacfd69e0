//! Procedural scenes with ground truth: colour, device depth and exact motion, drawn on the CPU.
//!
//! A [`Scene`] is made from a [`Family`] and a seed. A [`Walker`] turns controls into a camera. [`render`] draws a [`Frame`]: colour, depth, and
//! motion to the previous frame. Everything is deterministic and independent of the thread count.
#![warn(missing_docs)]

pub mod camera;
mod clip;
mod family;
mod light;
mod material;
mod mesh;
mod noise;
mod objects;
mod raster;
mod render;
mod scene;
mod shadow;
mod terrain;
mod walk;

pub use clip::{Clip, ClipOptions, MAX_RATE};
pub use family::{Family, LANDSCAPES, Weather};
pub use render::{Frame, Moment, Quality, SurfaceKind, render};
pub use scene::Scene;
pub use walk::{EASE, EYE, MAX_PITCH, RUN, Start, TURN_PER_COUNT, WALK, Walker};
