//! Shared by the tests.
#![allow(dead_code, unreachable_pub)]

pub mod clips;
pub mod decoder;
pub mod pairs;
pub mod small_disk;
pub mod weights;
pub mod worlds;
