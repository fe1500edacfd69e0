//! The embedded world on DirectML.

use std::sync::Arc;

use cairn::bundle::Precision;
use cairn::runtime::{CpuOptions, Device, DirectMlOptions, Ort};
use cairn::world::World;

use super::{DRIVER, Settings, seed};
use crate::finding::{Checked, Finding};

/// The largest relative error of a latent in the L2 norm, in single precision and in half floats.
const BOUNDS: [(Precision, &str, f64); 2] =
    [(Precision::F32, "single precision", 1e-3), (Precision::F16, "half floats", 3e-2)];

/// The device of the judged adapter for worlds.
pub(super) fn device(settings: &Settings, options: DirectMlOptions) -> Result<Device, Finding> {
    let ort = Ort::find(&settings.libraries())?;
    Ok(Device::directml(&ort, &settings.gpu()?, options)?)
}

/// For emulated adapters, the saved state of a rollout in half floats that begins in the place, made by the processor: such an adapter takes as long
/// to encode the picture and to prime the decoder as for four latents.
pub(super) fn starting_state(settings: &Settings) -> Result<Option<Vec<u8>>, Finding> {
    if settings.emulation(&settings.gpu()?).is_none() {
        return Ok(None);
    }
    let shared = settings.starting_state.as_deref();
    if let Some(state) = shared.and_then(|file| std::fs::read(file).ok()) {
        return Ok(Some(state));
    }
    let device = Device::cpu(&Ort::find(&settings.libraries())?, CpuOptions { threads: None, deterministic: true })?;
    let state = seed::rollout(&seed::world(&device, Precision::F16)?)?.save()?;
    if let Some(file) = shared {
        // A check that is ended while it writes must not leave a part under the name that others read. If it fails, the next makes its own.
        let part = file.with_extension("part");
        _ = std::fs::write(&part, &state).and_then(|()| std::fs::rename(&part, file));
    }
    Ok(Some(state))
}

fn deterministic() -> DirectMlOptions {
    DirectMlOptions { deterministic: true, ..DirectMlOptions::default() }
}

fn latent(world: &Arc<World>) -> Result<(Vec<f32>, cairn::Picture), Finding> {
    let mut rollout = seed::rollout(world)?;
    seed::walk(&mut rollout, 0..1)?;
    let picture = seed::picture(&mut rollout)?;
    let mut latent = rollout.latent()?.to_vec();
    if gpu_testing::fault::is_on() {
        latent.iter_mut().step_by(16).for_each(|v| *v = 2.0 - *v);
    }
    Ok((latent, picture))
}

/// A latent by DirectML beside the processor's.
pub(super) fn parity(settings: &Settings) -> Checked {
    let device = device(settings, deterministic())?;
    let ort = Ort::find(&settings.libraries())?;
    let processor = Device::cpu(&ort, CpuOptions { threads: None, deterministic: true })?;
    let wanted = {
        let world = seed::world(&processor, Precision::F32)?;
        let mut rollout = seed::rollout(&world)?;
        seed::walk(&mut rollout, 0..1)?;
        (rollout.latent()?.to_vec(), seed::picture(&mut rollout)?)
    };
    let mut errors = Vec::new();
    let mut shown = None;
    for (precision, name, bound) in BOUNDS {
        let (found, picture) = latent(&seed::world(&device, precision)?)?;
        errors.push((name, error(&found, &wanted.0), bound));
        shown = Some(picture);
    }
    let is_right = errors.iter().all(|(_, error, bound)| error <= bound);
    let text: Vec<String> =
        errors.iter().map(|(name, error, bound)| format!("{error:.1e} in {name} (at most {bound:.0e})")).collect();
    let sentence = format!(
        "The embedded world's latent by DirectML, relative to the processor's, has an error of {}",
        text.join(" and of ")
    );
    let mut finding = Finding::judge(is_right, sentence, DRIVER);
    for (name, error, _) in errors {
        finding = finding.figure(format!("relative error, {name}"), error, "");
    }
    if let Some(picture) = &shown {
        finding = finding.picture("by DirectML, half floats", picture);
    }
    Ok(finding.picture("by the processor", &wanted.1))
}

/// Relative error in the L2 norm.
fn error(found: &[f32], truth: &[f32]) -> f64 {
    let square = |v: f32| f64::from(v) * f64::from(v);
    let apart: f64 = found.iter().zip(truth).map(|(a, b)| square(a - b)).sum();
    (apart / truth.iter().map(|v| square(*v)).sum::<f64>()).sqrt()
}

/// A saved state goes on with the same bits.
pub(super) fn states(settings: &Settings) -> Checked {
    let state = starting_state(settings)?;
    let world = seed::world(&device(settings, deterministic())?, Precision::F16)?;
    let count = if settings.quick { 2 } else { 3 };
    let mut first = seed::begin(&world, state.as_deref())?;
    seed::walk(&mut first, 0..1)?;
    let saved = first.save()?;
    let after_first = seed::unaltered_bits(&mut first)?;
    seed::walk(&mut first, 1..count)?;
    let after_last = seed::unaltered_bits(&mut first)?;
    let mut again = seed::begin(&world, state.as_deref())?;
    seed::walk(&mut again, 0..1)?;
    let repeats = seed::bits(&mut again)? == after_first;
    let mut restored = seed::restored(&world, &saved)?;
    seed::walk(&mut restored, 1..count)?;
    let goes_on = seed::bits(&mut restored)? == after_last;
    let sentence = match (repeats, goes_on) {
        (true, true) => {
            "A latent by DirectML repeats bit for bit, and so do the next ones from its saved state".to_owned()
        }
        (false, _) => "The same latent, made twice by DirectML, has other bits".to_owned(),
        (true, false) => "Latents made from a saved state have other bits".to_owned(),
    };
    Ok(Finding::judge(repeats && goes_on, sentence, DRIVER).figure("a saved state", saved.len() as f64 / 1024.0, "KiB"))
}

/// Captured passes give the bits of normal ones.
pub(super) fn captured(settings: &Settings) -> Checked {
    let state = starting_state(settings)?;
    let device = device(settings, DirectMlOptions::default())?;
    let count = if settings.quick { 3 } else { 5 };
    let run = |captured_passes| -> Result<_, Finding> {
        device.set_directml_options(DirectMlOptions { captured_passes, ..DirectMlOptions::default() })?;
        let world = seed::world(&device, Precision::F16)?;
        let mut rollout = seed::begin(&world, state.as_deref())?;
        seed::walk(&mut rollout, 0..count)?;
        let bits = if captured_passes == 0 { seed::unaltered_bits(&mut rollout)? } else { seed::bits(&mut rollout)? };
        Ok((bits, rollout.capture_statistics().unwrap_or_default()))
    };
    let (wanted, _) = run(0)?;
    let (found, statistics) = run(16)?;
    let figures = |finding: Finding| {
        finding.figure("passes that run by capture", statistics.used as f64, "").figure(
            "passes that do not",
            (statistics.unused + statistics.unproven) as f64,
            "",
        )
    };
    if found != wanted {
        return Ok(figures(Finding::fail("Rollouts with captured passes have other bits than without", DRIVER)));
    }
    if statistics.used == 0 {
        let reason = statistics.reason.clone().unwrap_or_else(|| "none ran often enough".to_owned());
        return Ok(figures(Finding::cannot_tell(
            format!("No pass runs by capture: {reason}"),
            "Nothing needs to be done: passes are then run anew, and take more of the processor's time",
        )));
    }
    Ok(figures(Finding::pass(format!(
        "{} passes run by capture, each compared with normal ones on the device, and {count} latents have the same bits",
        statistics.used
    ))))
}
