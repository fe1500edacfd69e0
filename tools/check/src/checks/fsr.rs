//! AMD's frame generation: the self-test of its provider, and its frames against true ones.

use cairn::Result;
use cairn::ffx::{Choice, Effect, Library, LoadOptions};
use cairn::present::device::DeviceDrawer;

use super::adapters::gpu;
use super::frames::by_device;
use super::walk::{self, Walk};
use crate::outcome::{Better, Outcome};
use crate::settings::Settings;

/// AMD's libraries.
pub(super) fn library() -> Result<Library> {
    Library::load(&LoadOptions::from_environment())
}

/// Has AMD's provider make the drawer's frames half way; it must pass the self-test.
pub(super) fn choose(library: &Library, drawer: &mut DeviceDrawer) -> Result<()> {
    drawer.use_fsr(library.api(Effect::FrameGeneration)?, Choice::Any, true)
}

/// The provider passes its self-test, and its frames are nearer to the true ones than the anchors are.
pub(super) fn quality(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let library = library()?;
    let (size, pairs) = walk::SIZES[usize::from(settings.short)];
    let mut version = String::new();
    let (mut figures, mut faults) = (Vec::new(), Vec::new());
    for (family, _) in walk::FLOORS {
        let walk = Walk::new(family, size, pairs)?;
        let frames = by_device(&gpu, &walk, |drawer| {
            choose(&library, drawer)?;
            version = drawer.made_by_fsr().map(|version| version.name.clone()).unwrap_or_default();
            Ok(())
        })?;
        let held: Vec<_> = (0..pairs).map(|pair| walk.picture(pair).clone()).collect();
        let (found, held) = (walk.quality(&frames), walk.quality(&held));
        if found <= held {
            faults.push(format!("{family}: {found:.2} dB, and the anchor before it {held:.2} dB"));
        }
        figures.push((family, found));
    }
    let outcome = if faults.is_empty() {
        Outcome::pass(format!("AMD's provider {version} passes the self-test, and its frames are between the anchors"))
    } else {
        Outcome::fail(
            format!(
                "frames of AMD's provider {version} are farther from the true ones than the anchors: {}",
                faults.join("; ")
            ),
            "Use another release of AMD's libraries; Cairn's own generator does without",
        )
    };
    let outcome = outcome.fact("provider", version);
    Ok(figures.into_iter().fold(outcome, |outcome, (family, decibels)| {
        outcome.figure(family.to_string(), decibels, "dB", Better::Higher)
    }))
}
