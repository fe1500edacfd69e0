//! The rollout: controls, noise, schedule, KV ring, sampler, autoencoder, state.

mod controls;
mod keys;
mod noise;
mod operating_point;
mod plan;
mod plan_state;
mod preset;
mod ring;
mod rope;
mod schedule;
mod time;

pub use controls::{ControlInput, MAX_MOUSE};
pub use keys::{Key, KeySet};
pub use noise::{NoiseKey, fill_noise};
pub use operating_point::{
    CacheMode, Counts, GuidanceSource, MAX_INTERVAL, MAX_LATENT_RATE, MAX_PRESENTED_RATE, OperatingPoint, Presentation,
    global_buckets, parse_global_window,
};
pub use plan::{CachePass, Planner, RingPlan, StepPlan};
pub use preset::Preset;
pub use ring::{MAX_BUCKETS, Ring};
pub use rope::RopeTable;
pub use schedule::{MAX_POINTS, Schedule, SigmaTable};
pub use time::{MAX_SECONDS, WorldTime};
