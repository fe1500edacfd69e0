//! What every generator must do, on scenes whose in-between pictures are known.

mod bounds;
mod oracle;
mod reference;
mod scenes;
pub(super) mod synthetic;
