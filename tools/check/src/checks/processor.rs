//! Results of the processor, which need no GPU.

use cairn::bundle::{Bundle, OpenOptions};
use cairn::runtime::{CpuOptions, Device, Ort};
use cairn::world::{CacheMode, ControlInput, KeySet, OperatingPoint, Preset, Rollout, Schedule, World, WorldOptions};
use cairn::{LibrarySearch, Picture, Result};

use super::walk::{self, Walk};
use crate::outcome::{Better, Figure, Outcome};
use crate::settings::Settings;

/// Generated frames against the true frames of four scenes.
pub(super) fn generator(settings: &Settings) -> Result<Outcome> {
    judge_quality(settings, |walk| walk.by_processor(), "the processor")
}

/// Compares the frames of every family's walk with the true ones.
pub(super) fn judge_quality(
    settings: &Settings,
    mut frames: impl FnMut(&Walk) -> Result<Vec<Picture>>,
    maker: &str,
) -> Result<Outcome> {
    let (size, pairs) = walk::SIZES[usize::from(settings.short)];
    let (mut figures, mut faults) = (Vec::new(), Vec::new());
    for (family, floors) in walk::FLOORS {
        let walk = Walk::new(family, size, pairs)?;
        let (found, least) = (walk.quality(&frames(&walk)?), floors[usize::from(settings.short)]);
        if found < least {
            faults.push(format!("{family}: {found:.2} dB, which is less than {least:.1}"));
        }
        figures.push(Figure { name: family.to_string(), value: found, unit: "dB".into(), better: Better::Higher });
    }
    let outcome = if faults.is_empty() {
        Outcome::pass(format!(
            "{} frames of {maker} half way between anchors are as near to the true ones as they must be (PSNR)",
            pairs * walk::FLOORS.len()
        ))
    } else {
        Outcome::fail(
            format!("frames of {maker} are too far from the true ones: {}", faults.join("; ")),
            "Update the graphics driver if the frames are the adapter's, and report it with this page",
        )
    };
    Ok(outcome.with_figures(figures))
}

/// Steps of a rollout that is judged.
const STEPS: usize = 3;

/// The embedded world makes pictures that depend on the controls, and a saved state continues to the bit.
pub(super) fn world(_: &Settings) -> Result<Outcome> {
    let ort = Ort::find(&LibrarySearch::for_tools())?;
    let device = Device::cpu(&ort, CpuOptions { threads: None, deterministic: true })?;
    let bundle = Bundle::embedded(&OpenOptions::default())?;
    let world = World::load(&device, &bundle, WorldOptions::default())?;
    judge_world(&world)
}

/// An operating point of four passes and one picture per latent, at the world's own window.
pub(super) fn point(world: &World) -> OperatingPoint {
    OperatingPoint {
        global_window: world.global_window(),
        schedule: Schedule::Stock,
        cache_mode: CacheMode::Separate,
        latents_per_second: 15,
        pictures_per_latent: 1,
        ..Preset::Decoded60.operating_point()
    }
}

/// A rollout with a seed picture: the first frame of a desert.
pub(super) fn seeded(world: &std::sync::Arc<World>) -> Result<Rollout> {
    let mut rollout = Rollout::new(world, &point(world), 7)?;
    rollout.append(Walk::new(scenes::Family::Desert, world.render_size(), 1)?.halves().first().expect("one pair"))?;
    Ok(rollout)
}

/// Controls that look up or down by so many counts of a mouse.
fn look(counts: f32) -> Result<ControlInput> {
    ControlInput::new([0.0, counts], KeySet::default(), 0.0)
}

/// Steps with the same controls; returns state and latent.
fn steps(rollout: &mut Rollout, counts: f32, number: usize) -> Result<(Vec<u8>, Vec<f32>)> {
    for _ in 0..number {
        rollout.step(&look(counts)?)?;
    }
    Ok((rollout.save()?, rollout.latent()?.to_vec()))
}

/// Steps a world's rollout twice, from a saved state, and with other controls.
pub(super) fn judge_world(world: &std::sync::Arc<World>) -> Result<Outcome> {
    const REMEDY: &str = "Update the graphics driver and DirectML.dll if the world is the adapter's, and report it";
    let mut first = seeded(world)?;
    let began = std::time::Instant::now();
    first.step(&look(20.0)?)?;
    let saved = first.save()?;
    let truth = steps(&mut first, 20.0, STEPS - 1)?;
    let seconds = began.elapsed().as_secs_f64() / STEPS as f64;
    let again = steps(&mut seeded(world)?, 20.0, STEPS)?;
    let mut restored = Rollout::new(world, &point(world), 1)?;
    restored.restore(&saved)?;
    let restored = steps(&mut restored, 20.0, STEPS - 1)?;
    let other = steps(&mut seeded(world)?, -20.0, STEPS)?;
    let mut faults = Vec::new();
    if again != truth {
        faults.push("the same steps give other bits");
    }
    if restored != truth {
        faults.push("a saved state continues to other bits");
    }
    if other.1 == truth.1 {
        faults.push("other controls give the same latent");
    }
    if truth.1.iter().any(|v| !v.is_finite()) {
        faults.push("a latent has a number that is not finite");
    }
    let outcome = if faults.is_empty() {
        Outcome::pass(format!("{STEPS} steps repeat to the bit, also from a saved state, and follow the controls"))
    } else {
        Outcome::fail(faults.join("; "), REMEDY)
    };
    Ok(outcome.fact("device", world.device().describe()).figure(
        "step, with every result read",
        1e3 * seconds,
        "ms",
        Better::Lower,
    ))
}
