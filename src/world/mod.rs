//! Runs worlds.
//!
//! A [`World`] is a bundle loaded on a device; a [`Rollout`] is one running instance of it. A [`Planner`] decides what a latent step
//! does, from an [`OperatingPoint`], controls, clocks and KV rings, without a device; the rollout executes its plans. A [`Governor`]
//! keeps a rollout and its frames within a budget, and a [`Worker`] runs queued steps on a thread.

mod anchor;
mod autoencoder;
mod bound_transformer;
mod conditioning;
mod controls;
mod convert;
#[cfg(test)]
mod fixture;
mod governor;
mod graph_spec;
mod half_precision;
mod joined_pass;
mod kv_cache;
mod latent_budget;
mod latent_time;
mod loading;
mod missing_operator;
mod noise;
mod operating_point;
mod passes;
mod plan;
mod preset;
mod resize;
mod ring;
mod rollout;
mod rope;
mod schedule;
mod script;
mod statistics;
mod time;
mod transformer;
mod virtual_keys;
mod worker;
#[expect(clippy::module_inception, reason = "the module's main type is the world")]
mod world;

pub use anchor::KeptAnchor;
pub use controls::{ControlInput, MAX_MOUSE};
pub use governor::{Budget, Governor, GovernorStatistics};
pub use half_precision::{HalfPrecision, MAX_LATENT_ERROR, Peak};
pub use kv_cache::KvPart;
#[cfg(test)]
pub(crate) use latent_time::LatentTime;
pub use noise::{NoiseKey, fill_noise};
pub use operating_point::{
    CacheMode, Counts, GuidanceSource, MAX_INTERVAL, MAX_LATENT_RATE, MAX_PRESENTED_RATE, OperatingPoint, Presentation,
    parse_global_window,
};
pub use plan::{CachePass, PendingPlan, Planner, RingPlan, StepPlan};
pub use preset::Preset;
pub use resize::Bilinear;
pub use ring::{MAX_SLOTS, Ring};
#[cfg(windows)]
pub use rollout::DeviceTimes;
pub use rollout::{Probe, Rollout};
pub use rope::RopeTable;
pub use schedule::{MAX_POINTS, Schedule, SigmaTable};
pub use script::{
    Action, ControlScript, MAX_EVENT_MOUSE, MAX_EVENT_SCROLL, MAX_EVENTS, MAX_SCRIPT_BYTES, SCRIPT_VERSION,
    ScriptEvent, ScriptRecorder,
};
pub use statistics::{StageTotals, Stages, Statistics, StepInfo};
pub use time::{MAX_SECONDS, WorldTime};
pub use virtual_keys::{Key, KeySet};
pub use worker::{Job, QueuedRollout, ReadGuard, StepResult, TicketState, Worker, WorkerStatistics};
pub use world::{World, WorldOptions};
