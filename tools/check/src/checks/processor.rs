//! What runs on the processor, on every system.

use cairn::bundle::Precision;
use cairn::framegen::cpu::CpuGenerator;
use cairn::runtime::{CpuOptions, Device, Ort};

use super::{Settings, seed, truth};
use crate::finding::{Checked, Finding};
use crate::report::Figure;

/// How much nearer to the truth than the mean of both anchors a generated frame must be, in dB.
pub(super) const GAIN: f64 = 1.0;

/// Generated frames beside true ones.
pub(super) fn frames(settings: &Settings) -> Checked {
    let mut generator = CpuGenerator::new();
    let mut least = f64::INFINITY;
    let mut figures = Vec::new();
    let cases = truth::cases(settings.quick)?;
    for case in &cases {
        let made = truth::generate(&mut generator, case)?;
        let [own, mean] = [&made, &truth::blend(case)?].map(|picture| truth::psnr(&case.middle, picture));
        least = least.min(own - mean);
        figures.push(Figure { name: format!("{}, generated", case.name), value: own, unit: "dB".to_owned() });
        figures.push(Figure {
            name: format!("{}, mean of both anchors", case.name),
            value: mean,
            unit: "dB".to_owned(),
        });
    }
    let sentence = format!(
        "Each of {} generated frames is at least {least:.1} dB nearer to the true frame than the mean of its two anchors",
        cases.len()
    );
    let short = format!(
        "A generated frame is {least:.1} dB nearer to the true frame than the mean of its anchors, and should be {GAIN} dB nearer at least"
    );
    let is_right = least >= GAIN;
    let found = Finding::judge(
        is_right,
        if is_right { sentence } else { short },
        "Send this report: the processor's generator does not depend on a driver",
    );
    Ok(found.figures(figures))
}

/// The world inside the library: repeated and restored rollouts have the same bits.
pub(super) fn world(settings: &Settings) -> Checked {
    let ort = Ort::find(&settings.libraries())?;
    let device = Device::cpu(&ort, CpuOptions { threads: None, deterministic: true })?;
    let world = seed::world(&device, Precision::F32)?;
    let mut first = seed::rollout(&world)?;
    seed::walk(&mut first, 0..1)?;
    let saved = first.save()?;
    let start = std::time::Instant::now();
    seed::walk(&mut first, 1..2)?;
    let took = start.elapsed().as_secs_f64() * 1e3;
    let mut restored = seed::restored(&world, &saved)?;
    seed::walk(&mut restored, 1..2)?;
    let latent_is_finite = first.latent()?.iter().all(|v| v.is_finite());
    let wanted = seed::unaltered_bits(&mut first)?;
    let is_same = seed::bits(&mut restored)? == wanted;
    let sentence = match (latent_is_finite, is_same) {
        (true, true) => {
            "The embedded world made two latents on the processor, and the second again from a saved state with the same bits"
        }
        (false, _) => "The embedded world's latent has a number that is not finite",
        (true, false) => "A latent made again from a saved state has other bits",
    };
    Ok(Finding::judge(latent_is_finite && is_same, sentence, "Use the onnxruntime library of Cairn's archive")
        .figure("a latent step on the processor", took, "ms")
        .picture("the world's picture after two steps, by the processor", &seed::picture(&mut first)?))
}
