//! What every generator must do, on scenes whose in-between pictures are known.

mod bounds;
mod scenes;
pub(super) mod world;
