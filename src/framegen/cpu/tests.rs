//! Tests on scenes whose true frames are known, and against a reference implementation.

mod bounds;
mod oracle;
mod reference;
mod scenes;
pub(super) mod synthetic;
