//! What every generator must do, on scenes whose in-between pictures are known.

#[path = "../tests/bounds.rs"]
mod bounds;
#[path = "../tests/scenes.rs"]
mod scenes;
#[path = "../tests/world.rs"]
mod world;

use super::SegmentGenerator as Generator;
