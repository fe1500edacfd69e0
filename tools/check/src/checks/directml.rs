//! The embedded world on DirectML: parity with the processor, repetition, saved states and captured passes.

use std::sync::Arc;

use cairn::bundle::{Bundle, OpenOptions, Precision};
use cairn::gpu::Gpu;
use cairn::runtime::{CpuOptions, Device, DirectMlOptions, Ort};
use cairn::world::{ControlInput, World, WorldOptions};
use cairn::{LibrarySearch, Result};

use super::adapters::gpu;
use super::processor::{judge_world, seeded};
use crate::outcome::{Better, Outcome};
use crate::settings::Settings;

const REMEDY: &str = "Update the graphics driver and DirectML.dll; if it stays, report it with this page";

/// The embedded world on a device.
pub(super) fn load(device: &Device, precision: Option<Precision>) -> Result<Arc<World>> {
    let bundle = Bundle::embedded(&OpenOptions::default())?;
    World::load(device, &bundle, WorldOptions { precision, ..WorldOptions::default() })
}

pub(super) fn device(gpu: &Gpu, options: DirectMlOptions) -> Result<Device> {
    Device::directml(&Ort::find(&LibrarySearch::for_tools())?, gpu, options)
}

/// The first latent of a rollout.
fn latent(world: &Arc<World>) -> Result<Vec<f32>> {
    let mut rollout = seeded(world)?;
    rollout.step(&ControlInput::default())?;
    Ok(rollout.latent()?.to_vec())
}

/// Relative error in the L2 norm.
fn relative_error(found: &[f32], truth: &[f32]) -> f64 {
    let square = |v: f32| f64::from(v) * f64::from(v);
    let apart: f64 = found.iter().zip(truth).map(|(a, b)| square(a - b)).sum();
    (apart / truth.iter().map(|v| square(*v)).sum::<f64>()).sqrt()
}

/// Largest relative error of a latent in the L2 norm, by the precision of the graphs.
const BOUNDS: [(Precision, f64); 2] = [(Precision::F32, 1e-4), (Precision::F16, 1e-2)];

/// A latent equals that of the processor's provider, in each precision that the world has.
pub(super) fn parity(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let ort = Ort::find(&LibrarySearch::for_tools())?;
    let processor = Device::cpu(&ort, CpuOptions { threads: None, deterministic: true })?;
    let adapter = device(&gpu, DirectMlOptions { deterministic: true, ..Default::default() })?;
    let (mut faults, mut figures) = (Vec::new(), Vec::new());
    let truth = latent(&load(&processor, Some(Precision::F32))?)?;
    for (precision, bound) in BOUNDS {
        let world = match load(&adapter, Some(precision)) {
            Ok(world) => world,
            // A bundle may hold one precision only.
            Err(e) if e.kind() == cairn::ErrorKind::Unsupported => continue,
            Err(e) => return Err(e),
        };
        let error = relative_error(&latent(&world)?, &truth);
        // A comparison that a NaN fails.
        if !(error <= bound) {
            faults.push(format!("{precision:?}: a relative error of {error:.1e}, which is more than {bound:.0e}"));
        }
        figures.push((format!("relative error, {precision:?}"), error));
    }
    let outcome = match (figures.len(), faults.is_empty()) {
        (0, _) => Outcome::fail("the embedded world has graphs of no precision that DirectML takes", REMEDY),
        (_, true) => Outcome::pass("a latent on DirectML equals the processor's within rounding"),
        _ => Outcome::fail(faults.join("; "), REMEDY),
    };
    let outcome = outcome.fact("device", adapter.describe());
    Ok(figures
        .into_iter()
        .fold(outcome, |outcome, (name, error)| outcome.figure(name, 1e6 * error, "millionths", Better::Lower)))
}

/// Steps repeat to the bit, also from a saved state.
pub(super) fn repeat(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    judge_world(&load(&device(&gpu, DirectMlOptions { deterministic: true, ..Default::default() })?, None)?)
}

/// Steps until every pass has shown that its capture gives the same bits.
const STEPS: u64 = 4;

/// Captured passes give the same bits as normal ones.
pub(super) fn captured(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let run = |captured_passes| {
        let options = DirectMlOptions { captured_passes, ..DirectMlOptions::default() };
        let world = load(&device(&gpu, options)?, None)?;
        let mut rollout = seeded(&world)?;
        for _ in 0..STEPS {
            rollout.step(&ControlInput::default())?;
        }
        Ok((rollout.latent()?.to_vec(), rollout.capture_statistics()))
    };
    let (normal, _) = run(0)?;
    let (captured, statistics): (Vec<f32>, _) = run(16)?;
    let statistics = statistics.unwrap_or_default();
    let reason = statistics.reason.clone().unwrap_or_else(|| "no reason is given".into());
    let counts =
        format!("{} passes captured, {} not proven, {} not", statistics.used, statistics.unproven, statistics.unused);
    Ok(if captured != normal {
        Outcome::fail(format!("captured passes give other bits than normal ones ({counts})"), REMEDY)
    } else if statistics.used == 0 {
        Outcome::cannot_tell(
            format!("no pass was captured: {reason}"),
            "Nothing needs to be done: passes run as usual, and take more of the processor's time",
        )
    } else {
        Outcome::pass(format!("the same bits, {counts}"))
    })
}
