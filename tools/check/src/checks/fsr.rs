//! AMD's FSR, where its libraries are there.

use cairn::ffx::{Api, Choice, Effect, Library, LoadOptions};
use cairn::framegen::device::DeviceGenerator;
use cairn::framegen::fsr::FsrGenerator;
use cairn::gpu::Gpu;

use super::{DRIVER, Settings, truth};
use crate::finding::{Checked, Finding};
use crate::report::Figure;

/// AMD's libraries. They stay loaded. Only signed ones are used, unless `CAIRN_FFX_UNSIGNED` is 1.
pub(super) fn library(settings: &Settings) -> cairn::Result<Library> {
    let mut options = LoadOptions::from_environment();
    if let Some(folder) = settings.libraries().ffx {
        options.directory = Some(folder);
    }
    Library::load(&options)
}

/// AMD's frame generation.
pub(super) fn api(settings: &Settings) -> Result<Api, Finding> {
    Ok(*library(settings)?.api(Effect::FrameGeneration)?)
}

/// The provider that the library prefers, with the test that it must pass.
pub(super) fn generator(gpu: &Gpu, api: &Api, size: (u32, u32)) -> Result<FsrGenerator, Finding> {
    Ok(FsrGenerator::new(gpu, api, Choice::default(), size, size)?)
}

/// The self-test: frames of known motion.
pub(super) fn self_test(settings: &Settings) -> Checked {
    let api = api(settings)?;
    let generator = generator(&settings.gpu()?, &api, (640, 360))?;
    Ok(Finding::pass(format!(
        "AMD's provider {} generates the frame of known motion that Cairn's self-test asks for",
        generator.version().name
    )))
}

/// Its frames beside true ones.
pub(super) fn quality(settings: &Settings) -> Checked {
    let api = api(settings)?;
    let gpu = settings.gpu()?;
    let mut figures = Vec::new();
    let (mut least, mut shown) = (f64::INFINITY, Vec::new());
    let cases = truth::cases(settings.quick)?;
    for case in &cases {
        // A generator for each case: the provider has no history of another.
        let mut amd = DeviceGenerator::of_amd(&gpu, &api, Choice::default(), 1000.0 / 15.0);
        let mut shaders = DeviceGenerator::of_shaders(&gpu);
        let made = truth::generate(&mut amd, case)?;
        let [by_amd, own, mean] = [&made, &truth::generate(&mut shaders, case)?, &truth::blend(case)?]
            .map(|picture| truth::psnr(&case.middle, picture));
        least = least.min(by_amd - mean);
        for (name, value) in [("FSR", by_amd), ("Cairn's shaders", own), ("mean of both anchors", mean)] {
            figures.push(Figure { name: format!("{}, {name}", case.name), value, unit: "dB".to_owned() });
        }
        shown.push((case, made));
    }
    let sentence = format!(
        "The farthest of {} frames by FSR is {least:.1} dB nearer to the true frame than the mean of its anchors",
        cases.len()
    );
    let mut finding = Finding::judge(least > 0.0, sentence, DRIVER).figures(figures);
    for (case, made) in &shown {
        finding = finding
            .picture(format!("{}: by FSR", case.name), made)
            .picture(format!("{}: true", case.name), &case.middle);
    }
    Ok(finding)
}
