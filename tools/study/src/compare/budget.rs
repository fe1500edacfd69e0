//! Cost of a branch: passes, arithmetic and memory traffic counted from the graphs, and measured time.
//!
//! ```text
//! work of a branch = passes * pass(g) + encode + (latents + primes) * decode
//! ```
//!
//! Passes and latents come from the manifest; `pass(g)`, `encode` and `decode` are the work of one run of the bundle's graphs. The first
//! latent is decoded `primes` more times to fill the decoder's memory. Frame generation and scaling run outside of graphs and appear in
//! the times only. A branch that shows the latents of another is charged for making them.

use cairn::bundle::{Bundle, Precision};
use cairn::world::{OperatingPoint, Presentation, WorldTime};
use cairn::{Error, ErrorKind, Result};

use super::branch::Branch;
use super::plan::Cell;
use crate::device::DeviceChoice;
use crate::manifest::Manifest;

/// Cost of one cell per second of world time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Budget {
    /// Latents, including the seed's own.
    pub(crate) latents: f64,
    /// Passes of the transformer.
    pub(crate) passes: f64,
    /// Presented frames.
    pub(crate) presented: f64,
    /// Presented frames that the world decoded and that are shown unchanged.
    pub(crate) native: f64,
    /// Floating-point operations of the graphs' matrix products: two per multiply-add.
    pub(crate) flops: f64,
    /// Bytes that the graphs' nodes read and write.
    pub(crate) bytes: f64,
    /// Measured times.
    pub(crate) times: Times,
}

/// Seconds of computing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Times {
    /// Denoise and cache passes, and copies into the ring.
    pub(crate) world: f64,
    /// Decoding latents, and reading and resizing pictures.
    pub(crate) decode: f64,
    /// Motion and depth.
    pub(crate) guidance: f64,
    /// Frames between anchors.
    pub(crate) generation: f64,
    /// Scaling from the world's size to that of the comparison.
    pub(crate) upscaling: f64,
}

impl Times {
    /// Sum of all stages.
    pub(crate) fn sum(&self) -> f64 {
        self.world + self.decode + self.guidance + self.generation + self.upscaling
    }
}

/// The budgets of all cells, in their order.
///
/// # Errors
/// As [`Bundle::cost`]; `InvalidState` if the cell whose latents are decoded is missing.
pub(super) fn budgets(cells: &[(Cell, Manifest)], bundle: &Bundle) -> Result<Vec<Budget>> {
    cells
        .iter()
        .map(|(cell, manifest)| {
            let source = match cell.branch.shares_latents_of() {
                None => manifest,
                Some(branch) => source(cells, *cell, branch)?,
            };
            budget(manifest, source, bundle)
        })
        .collect()
}

/// Manifest of the same scene in another branch.
fn source(cells: &[(Cell, Manifest)], cell: Cell, branch: Branch) -> Result<&Manifest> {
    let wanted = Cell { branch, ..cell };
    let found = cells.iter().find(|(other, _)| *other == wanted).map(|(_, manifest)| manifest);
    found.ok_or_else(|| Error::new(ErrorKind::InvalidState, format!("{cell} is there, {wanted} is not")))
}

/// Graphics devices run the half-precision graphs where a bundle has them.
pub(crate) fn is_half(manifest: &Manifest, bundle: &Bundle) -> bool {
    manifest.settings.device != DeviceChoice::Cpu && bundle.has(Precision::F16)
}

/// Budget of the cell of `manifest`, whose latents were made by the cell of `source`.
///
/// # Errors
/// As [`Bundle::cost`].
pub(crate) fn budget(manifest: &Manifest, source: &Manifest, bundle: &Bundle) -> Result<Budget> {
    let point: OperatingPoint = source.settings.operating_point.parse()?;
    let shown: OperatingPoint = manifest.settings.operating_point.parse()?;
    let seconds = WorldTime::parse(&manifest.settings.seconds)?.seconds();
    let generates = matches!(shown.presentation, Presentation::Generated { .. });
    let work =
        bundle.cost(if is_half(manifest, bundle) { Precision::F16 } else { Precision::F32 }, point.global_window)?;
    let primes = u64::from(bundle.geometry().autoencoder.temporal - 1);
    let (passes, decodes) = (source.counts.passes as f64, (manifest.counts.latents + primes) as f64);
    let sum = |of: fn(&cairn::bundle::GraphCost) -> u64| {
        let of_latents = source.counts.latents as f64 * of(&work.controls) as f64;
        passes * of(&work.pass) as f64 + of_latents + of(&work.encode) as f64 + decodes * of(&work.decode) as f64
    };
    let time = |manifest: &Manifest, stages: &[&str]| {
        stages.iter().filter_map(|stage| manifest.timings.get(*stage)).fold(0.0, |sum, time| sum + time) / seconds
    };
    Ok(Budget {
        latents: manifest.counts.latents as f64 / seconds,
        passes: passes / seconds,
        presented: manifest.counts.presented as f64 / seconds,
        native: (manifest.counts.presented - manifest.counts.generated) as f64 / seconds,
        flops: 2.0 * sum(|work| work.multiply_adds) / seconds,
        bytes: sum(|work| work.bytes) / seconds,
        times: Times {
            world: time(source, &["encode", "denoise", "cache", "commit"]),
            decode: time(manifest, &["decode", "resize"]),
            // Without generated frames, motion is computed for the contact sheet only.
            guidance: time(manifest, if generates { &["guidance"] } else { &[] }),
            generation: time(manifest, &["generation"]),
            upscaling: time(manifest, &["upscaling"]),
        },
    })
}
