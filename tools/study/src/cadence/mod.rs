//! Few anchors and many frames: 10 to 60 a second beside 15 to 30, 15 to 60 and 30 to 60, scored against the truth frame by frame.
//!
//! ```text
//! measure (walks and rollouts, frames at every phase) -> report (tables, CSV, page), figure
//! ```

mod figure;
mod measure;
mod report;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::Result;
use cairn::bundle::Bundle;
use cairn::runtime::{CpuOptions, Device};
use cairn::world::{OperatingPoint, Preset, World, WorldOptions};
use scenes::FAMILIES;

use crate::inputs;
use crate::media::{RealDisk, describe_io, encode_small_png, write_whole};
use crate::metrics::Net;
use crate::motion::Place;
use crate::progress::Progress;
use crate::world_quality::held_out;
use measure::Tools;

/// Scene seeds that are walked, for each kind of place.
const SEEDS: [u64; 3] = [41, 42, 43];

/// Settings of the measurement.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    /// The bundle; `None` for the library's own.
    pub(crate) world: Option<PathBuf>,
    /// Scene seeds; empty for the usual ones.
    pub(crate) seeds: Vec<u64>,
    /// One place of each kind, and few intervals of each.
    pub(crate) quick: bool,
    /// Whether LPIPS is measured; its weights are fetched if they are missing.
    pub(crate) lpips: bool,
    /// Also writes the page and the picture into the repository's docs.
    pub(crate) publish: bool,
    pub(crate) out: PathBuf,
}

/// Result of the measurement.
pub(crate) struct Outcome {
    /// Summary for the terminal.
    pub(crate) text: String,
    /// Files that were written.
    pub(crate) files: Vec<PathBuf>,
}

impl Settings {
    /// Checks the settings; reads no file.
    ///
    /// # Errors
    /// `InvalidArgument` for a scene seed that is not held out.
    pub(crate) fn check(&self) -> Result<()> {
        held_out::require(&self.seeds)
    }

    fn seeds(&self) -> &[u64] {
        match (self.seeds.is_empty(), self.quick) {
            (false, _) => &self.seeds,
            (true, true) => &SEEDS[..1],
            (true, false) => &SEEDS,
        }
    }

    /// The command line that measures the same.
    fn command(&self) -> String {
        let mut command = String::from("cargo run --release -p study -- cadence --publish");
        if self.quick {
            command += " --quick";
        }
        if !self.seeds.is_empty() {
            let seeds: Vec<String> = self.seeds.iter().map(u64::to_string).collect();
            command += &format!(" --seeds {}", seeds.join(","));
        }
        if !self.lpips {
            command += " --no-lpips";
        }
        command
    }
}

/// Measures all cadences.
///
/// # Errors
/// An unusable world, missing weights of LPIPS, errors of making latents, and `Cancelled`.
pub(crate) fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Outcome> {
    settings.check()?;
    let lpips = settings.lpips.then(|| inputs::lpips(Net::Alex, progress)).transpose()?;
    let (ort, _) = inputs::onnxruntime(progress)?;
    let (bundle, _) = inputs::world(settings.world.as_deref(), progress)?;
    let device = Device::cpu(&ort, CpuOptions { threads: None, deterministic: true })?;
    let point = point(&bundle);
    let options = WorldOptions { global_window: Some(point.global_window), ..WorldOptions::default() };
    let world = World::load(&device, &bundle, options)?;
    let (lpips, quick) = (lpips.as_ref(), settings.quick);
    let tools = Tools { world: &world, point: &point, lpips, quick, progress, stop };

    let seeds = settings.seeds();
    let places: Vec<Place> =
        FAMILIES.into_iter().flat_map(|family| seeds.iter().map(move |&seed| Place { family, seed })).collect();
    let (mut records, mut strips) = (Vec::new(), None);
    for &place in &places {
        let (scored, shown) = tools.score(place)?;
        records.extend(scored);
        strips = strips.or(Some((place, shown)));
    }
    let found = report::Found { settings, world: &bundle.manifest().name, places: &places, records: &records };
    let figure = match &strips {
        Some((place, strips)) => Some((figure::caption(*place), encode_small_png(&figure::draw(strips)?)?)),
        None => None,
    };
    let caption = figure.as_ref().map(|(caption, _)| caption.as_str());
    let png = figure.as_ref().map(|(_, png)| png.clone());

    let mut files = vec![
        (settings.out.join("cadence.md"), report::page(&found, caption, "cadence.png").into_bytes()),
        (settings.out.join("cadence.csv"), report::csv(&records).into_bytes()),
    ];
    files.extend(png.clone().map(|png| (settings.out.join("cadence.png"), png)));
    if settings.publish {
        let docs = provision::repository().join("docs");
        files.push((docs.join("cadence.md"), report::page(&found, caption, "images/cadence.png").into_bytes()));
        files.extend(png.map(|png| (docs.join("images/cadence.png"), png)));
    }
    for (path, bytes) in &files {
        let folder = path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(|e| describe_io("it cannot be made", folder, &e))?;
        write_whole(&RealDisk, path, bytes)?;
    }
    let files = files.into_iter().map(|(path, _)| path).collect();
    Ok(Outcome { text: report::summary(&found), files })
}

/// The operating point: the paper's, with every decoded picture used, and the largest context window that the world supports up to the
/// paper's.
fn point(bundle: &Arc<Bundle>) -> OperatingPoint {
    let point = Preset::Decoded60.operating_point();
    OperatingPoint { global_window: point.global_window.min(bundle.geometry().global.max_window), ..point }
}
