//! Parts of loading a world: what it needs of memory, the transformers, and the progress that is reported.

use std::cell::Cell;
use std::time::Duration;

use super::transformer::{SharedConditioning, Transformer, TransformerSource};
use super::world::WorldOptions;
use crate::bundle::{
    Bundle, ConditioningModels, GraphKind, MemoryNeed, Passes, Precision, Processor, available_memory,
};
use crate::runtime::{Device, DeviceKind};
use crate::{Error, ErrorKind, Result};

/// Compares the memory that a world needs with what there is.
pub(super) struct MemoryFit<'a> {
    pub(super) device: &'a Device,
    pub(super) bundle: &'a Bundle,
    pub(super) options: &'a WorldOptions,
    /// Of the world's graphs.
    pub(super) precision: Precision,
}

impl MemoryFit<'_> {
    /// The passes of a transformer in `slices` slices.
    pub(super) fn passes(&self, slices: u32) -> Passes {
        // Of an f32 graph no weight is a session's input: it casts all of them.
        let shared_weights = self.device.kind() == DeviceKind::Direct3d12 && self.precision == Precision::F16;
        if self.options.joined { Passes::Joined { shared_weights } } else { Passes::Slices(slices) }
    }

    /// The memory that a world needs at a global window of `g` latents.
    ///
    /// # Errors
    /// `OutOfMemory`, with figures, if there is less; `InvalidArgument` for a window that the bundle does not support.
    pub(super) fn check(&self, precision: Precision, g: u32, passes: Passes) -> Result<MemoryNeed> {
        let processor = if self.device.is_gpu() { Processor::Gpu } else { Processor::Cpu };
        let need = self.bundle.memory_need_in(precision, processor, g, passes)?;
        // Available memory already excludes the loaded bundle.
        let limit = self.options.memory_limit.or_else(|| Some(available_memory()?.saturating_add(need.bundle)));
        limit.map_or(Ok(()), |limit| need.check_fits(limit))?;
        self.device.available_memory().map_or(Ok(()), |available| need.check_fits_on_device(available))?;
        Ok(need)
    }

    /// The global window of the world and the memory it needs: the widest that fits if the options allow a narrower one, else the requested one.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub(super) fn window(&self) -> Result<(u32, MemoryNeed)> {
        let geometry = self.bundle.geometry();
        let requested = self.options.global_window.unwrap_or(geometry.global.window);
        let fits = |g| self.check(self.precision, g, self.passes(self.options.slices.unwrap_or(1)));
        match self.options.fit_window {
            true => widest(requested, geometry.global.dilation, fits),
            false => Ok((requested, fits(requested)?)),
        }
    }

    /// Checks that the f32 transformer fits, which the check of float16 holds for a while.
    ///
    /// # Errors
    /// As [`check`](Self::check), with the field `check_precision`.
    pub(super) fn check_reference(&self) -> Result<()> {
        let narrowest = self.bundle.geometry().global.dilation;
        self.check(Precision::F32, narrowest, Passes::Whole).map(drop).map_err(|error| {
            let remedy = "Free memory, or load it without the check, which holds the f32 transformer for a while";
            error.field("check_precision").remedy(remedy)
        })
    }
}

/// Reports the number of sessions, before each one is made.
pub(super) struct SessionProgress<'a> {
    total: Cell<u64>,
    report: &'a dyn Fn(u64) -> Result<()>,
}

impl<'a> SessionProgress<'a> {
    /// `total`: the sessions known so far.
    pub(super) fn new(total: u64, report: &'a dyn Fn(u64) -> Result<()>) -> Self {
        Self { total: Cell::new(total), report }
    }

    /// Counts `sessions` more.
    fn add(&self, sessions: u64) {
        self.total.set(self.total.get() + sessions);
    }

    /// Reports that the next session is made, or that none is left.
    ///
    /// # Errors
    /// The host's, which end the load.
    pub(super) fn next(&self) -> Result<()> {
        (self.report)(self.total.get())
    }
}

/// The transformers of a world.
pub(super) struct Transformers {
    pub(super) transformer: Transformer,
    pub(super) joined: Option<Transformer>,
    /// Time of the longest slice, if the options limit it and leave the number of slices to the load.
    pub(super) longest_slice: Option<Duration>,
}

/// Loads the transformer and, if the options have joined passes, the joined graph.
pub(super) fn load_transformers(
    source: &TransformerSource<'_>,
    memory: &MemoryFit<'_>,
    progress: &SessionProgress<'_>,
) -> Result<Transformers> {
    let options = memory.options;
    let proceed = || progress.next();
    // All conditioning first: its sessions are dropped, and their weights freed, before the passes' weights are loaded.
    let models = source.conditioning_models(GraphKind::Transformer)?;
    let joined_models = options.joined.then(|| source.conditioning_models(GraphKind::Joined)).transpose()?;
    let count =
        |models: &ConditioningModels| u64::from(models.of_levels.is_some()) + u64::from(models.of_controls.is_some());
    progress.add(count(&models) + joined_models.as_ref().map_or(0, count));
    let load = |kind, models, shared: &SharedConditioning| source.load_conditioning(kind, models, shared, &proceed);
    let conditioning = load(GraphKind::Transformer, &models, &SharedConditioning::default())?;
    let of_joined = joined_models.as_ref().map(|models| load(GraphKind::Joined, models, &conditioning)).transpose()?;
    let (transformer, longest_slice) = match (options.slices, options.longest_submission) {
        (None, Some(limit)) => {
            let fits = |slices| memory.check(memory.precision, source.global_window, memory.passes(slices)).is_ok();
            let counted = Cell::new(1);
            let proceed = |slices: u32| {
                // Sessions of the transformer in fewer slices were made as well.
                if counted.replace(slices) != slices {
                    progress.add(slices.into());
                }
                progress.next()
            };
            let (transformer, longest) = source.load_within(limit, &conditioning, &fits, &proceed)?;
            (transformer, Some(longest))
        }
        (slices, _) => (source.load(slices.unwrap_or(1), &conditioning, &proceed)?, None),
    };
    let joined = of_joined.map(|conditioning| {
        progress.next()?;
        source.load_joined(&transformer, &conditioning)
    });
    Ok(Transformers { joined: joined.transpose()?, transformer, longest_slice })
}

/// The widest window up to `wanted`, in steps of the dilation, that fits, and the result of `fits` for it. A wider window never needs
/// less memory, so the windows are bisected.
fn widest<T>(wanted: u32, dilation: u32, fits: impl Fn(u32) -> Result<T>) -> Result<(u32, T)> {
    let too_wide = |e: &Error| e.kind() == ErrorKind::OutOfMemory;
    let refused = match fits(wanted) {
        Err(e) if too_wide(&e) && dilation > 0 && wanted > dilation => e,
        found => return found.map(|found| (wanted, found)),
    };
    // If even the narrowest window does not fit, none does.
    let mut best = match fits(dilation) {
        Err(e) if too_wide(&e) => return Err(refused),
        found => (dilation, found?),
    };
    let (mut low, mut high) = (1, wanted / dilation);
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        match fits(middle * dilation) {
            Err(e) if too_wide(&e) => high = middle,
            found => (low, best) = (middle, (middle * dilation, found?)),
        }
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_window_that_fits_is_found() {
        let limited_to = |widest: u32| {
            move |g: u32| match g {
                g if g > widest => Err(Error::new(ErrorKind::OutOfMemory, format!("g{g}"))),
                g => Ok(2 * g),
            }
        };
        for (wanted, limit, expected) in
            [(512, 600, 512), (512, 511, 504), (512, 100, 96), (512, 8, 8), (8, 8, 8), (16, 15, 8)]
        {
            assert_eq!(widest(wanted, 8, limited_to(limit)).unwrap(), (expected, 2 * expected), "{wanted} of {limit}");
        }
        // The error is the one of the requested window.
        assert_eq!(widest(64, 8, limited_to(7)).unwrap_err().cause(), "g64");
        let failing = |_: u32| Err::<u32, _>(Error::new(ErrorKind::Device, "lost"));
        assert_eq!(widest(64, 8, failing).unwrap_err().kind(), ErrorKind::Device);
    }
}
