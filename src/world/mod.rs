//! The rollout: controls, noise, schedule, KV ring, sampler, autoencoder, state.

mod anchor;
mod autoencoder;
mod budget;
mod contract;
mod controls;
mod convert;
#[cfg(windows)]
mod device_times;
#[cfg(test)]
mod fault_tests;
#[cfg(test)]
mod fixture;
mod governor;
mod keys;
mod kv_memory;
mod noise;
mod operating_point;
mod passes;
mod plan;
mod plan_state;
#[cfg(test)]
mod plan_tests;
mod preset;
mod resize;
mod ring;
mod rollout;
mod rope;
mod schedule;
mod script;
mod state;
mod statistics;
mod time;
mod window;
mod worker;
#[expect(clippy::module_inception, reason = "a world is what this room is about")]
mod world;

pub use anchor::KeptAnchor;
pub use controls::{ControlInput, MAX_MOUSE};
#[cfg(windows)]
pub use device_times::DeviceTimes;
pub use governor::{Budget, Governor, GovernorStatistics};
pub use keys::{Key, KeySet};
pub use kv_memory::Part;
pub use noise::{NoiseKey, fill_noise};
pub use operating_point::{
    CacheMode, Counts, GuidanceSource, MAX_INTERVAL, MAX_LATENT_RATE, MAX_PRESENTED_RATE, OperatingPoint, Presentation,
    global_buckets, parse_global_window,
};
pub use plan::{CachePass, Planner, RingPlan, StepPlan};
pub use preset::Preset;
pub use resize::Bilinear;
pub use ring::{MAX_BUCKETS, Ring};
pub use rollout::{Probe, Rollout};
pub use rope::RopeTable;
pub use schedule::{MAX_POINTS, Schedule, SigmaTable};
pub use script::{
    Action, ControlScript, MAX_EVENT_MOUSE, MAX_EVENT_SCROLL, MAX_EVENTS, MAX_SCRIPT_BYTES, SCRIPT_VERSION,
    ScriptEvent, ScriptRecorder,
};
pub use statistics::{Stage, Stages, Statistics, StepInfo};
pub use time::{MAX_SECONDS, WorldTime};
pub use worker::{Job, QueuedRollout, StepResult, TicketState, Worker, WorkerStatistics};
pub use world::{World, WorldOptions};
