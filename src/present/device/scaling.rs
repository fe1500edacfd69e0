//! Scaling of frames to their size: AMD's upscaler before frame generation, or a spatial filter after it.

use super::resource_cache::FrameInputs;
use super::upsampler::{LowResolutionAnchor, Upsampler};
use super::{DeviceDrawer, PendingFrame, Plan, Presenter};
use crate::ffx::{Api, Choice, Version};
use crate::{Error, ErrorKind, Result};

/// AMD's upscaler and its state.
pub(super) struct Upscaling {
    upsampler: Option<Upsampler>,
    api: Api,
    choice: Choice,
    /// If set, a failure is an error; otherwise frames are resized spatially.
    is_required: bool,
    /// The failure after which it is not used any more.
    failed: Option<Error>,
}

/// How frames are scaled from the size of the anchors to their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScaledBy<'a> {
    /// Not scaled: the sizes are equal.
    Nothing,
    /// A spatial filter resizes each frame on its own.
    Space,
    /// A provider of AMD's upscales anchors temporally.
    Amd(&'a Version),
}

impl DeviceDrawer {
    /// From now on a provider of AMD's upscaler in `api` upscales anchors to the size of frames before frames are generated between them. It is used
    /// only if frames are larger than anchors and anchors do not bring all frames of their interval with them, because its history goes from anchor
    /// to anchor. If the provider fails, frames are resized spatially; with `is_required`, drawing fails instead.
    pub fn use_fsr_upscaler(&mut self, api: &Api, choice: Choice, is_required: bool) {
        self.upscaling = Some(Upscaling { upsampler: None, api: *api, choice, is_required, failed: None });
    }

    /// The upsampler, if it is in use.
    pub(super) fn upsampler(&self) -> Option<&Upsampler> {
        self.upscaling.as_ref().and_then(|upscaling| upscaling.upsampler.as_ref())
    }

    /// How frames are scaled, as of the last [`prepare`](Self::prepare).
    pub fn scaled_by(&self) -> ScaledBy<'_> {
        match (self.upsampler(), &self.output_pass) {
            (Some(upsampler), _) => ScaledBy::Amd(upsampler.version()),
            (None, Some(output_pass)) if output_pass.resizes() => ScaledBy::Space,
            _ => ScaledBy::Nothing,
        }
    }

    /// The failure after which the upscaler is not used any more, if it failed.
    pub fn upscaler_failed(&self) -> Option<&Error> {
        self.upscaling.as_ref().and_then(|upscaling| upscaling.failed.as_ref())
    }

    /// Creates or drops the upsampler for anchors of the size `wanted`; returns the resulting size of anchors. `decoded`: anchors bring all frames.
    pub(super) fn set_upsampled_size(&mut self, wanted: (u32, u32), decoded: bool) -> Result<(u32, u32)> {
        let Some(upscaling) = self.upscaling.as_mut().filter(|upscaling| upscaling.failed.is_none()) else {
            return Ok(self.size);
        };
        let is_larger = wanted != self.size && wanted.0 >= self.size.0 && wanted.1 >= self.size.1;
        if is_larger && decoded && upscaling.is_required {
            let why = "the upscaler goes from anchor to anchor, and these bring all frames with them";
            return Err(Error::new(ErrorKind::Unsupported, why)
                .field("upscaler")
                .remedy("Have frames generated, or let them be resized in space"));
        }
        if !is_larger || decoded {
            upscaling.upsampler = None;
            return Ok(self.size);
        }
        if upscaling.upsampler.as_ref().is_some_and(|upsampler| upsampler.to() == wanted) {
            return Ok(wanted);
        }
        // Freed first: there may not be enough memory for both.
        upscaling.upsampler = None;
        match Upsampler::new(&self.gpu, &upscaling.api, upscaling.choice, self.size, wanted) {
            Ok(made) => {
                upscaling.upsampler = Some(made);
                Ok(wanted)
            }
            Err(why) if upscaling.is_required || why.kind() == ErrorKind::DeviceRemoved => Err(why),
            Err(why) => {
                log::warn!("frames are resized in space, as there is no upscaler of AMD's: {why}");
                upscaling.failed = Some(why);
                Ok(self.size)
            }
        }
    }

    /// Replaces a frame's inputs by upscaled ones if the upsampler is in use.
    pub(super) fn larger(
        &mut self,
        inputs: FrameInputs,
        pending: &PendingFrame,
        presenter: &Presenter,
        interval_ms: f32,
    ) -> Result<FrameInputs> {
        let upsampler = self.upscaling.as_mut().and_then(|upscaling| upscaling.upsampler.as_mut());
        let Some(upsampler) = upsampler else { return Ok(inputs) };
        let why = match upsample(upsampler, &inputs, pending, interval_ms) {
            Ok(larger) => return Ok(larger),
            Err(why) => why,
        };
        let upscaling = self.upscaling.as_mut().filter(|upscaling| !upscaling.is_required);
        let Some(upscaling) = upscaling.filter(|_| why.kind() != ErrorKind::DeviceRemoved) else { return Err(why) };
        log::warn!("frames are resized in space from now on, as the upscaler fails: {why}");
        (upscaling.upsampler, upscaling.failed) = (None, Some(why));
        // Allocates memory for frames of the anchors' size. The device caches the pipelines already.
        self.work_at(self.size)?;
        self.scale_to(pending.size.unwrap_or(self.size), presenter.keeps_shape())?;
        // The overlay mask had the upscaled size.
        self.cache.bring(pending, presenter.options().motion, false)
    }
}

/// The inputs with upscaled anchors.
fn upsample(
    upsampler: &mut Upsampler,
    inputs: &FrameInputs,
    pending: &PendingFrame,
    interval_ms: f32,
) -> Result<FrameInputs> {
    let place = pending.plan.place(pending.epoch);
    let before = place.and_then(|(stream, number)| Some((stream, number.checked_sub(1)?)));
    let slot = pending.plan.slot();
    let previous = match &inputs.previous {
        // The pair's motion leads back to this anchor, so there is none that leads from it.
        Some(picture) => {
            Some(upsampler.anchor(&LowResolutionAnchor { place: before, picture, lead: None, interval_ms })?)
        }
        None => None,
    };
    let lead = inputs.guidance.as_ref().filter(|_| !slot.cut).map(|guidance| (guidance, slot.projection()));
    let current = upsampler.anchor(&LowResolutionAnchor { place, picture: &inputs.current, lead, interval_ms })?;
    let guidance = match (&pending.plan, &inputs.guidance, place) {
        (Plan::Interpolate { .. } | Plan::Extrapolate { .. }, Some(guidance), Some(place)) => {
            Some(upsampler.guidance(place, guidance)?)
        }
        _ => None,
    };
    let previous_depth = inputs.previous_depth.as_ref().and(before).and_then(|before| upsampler.depth(before));
    let (rendered, overlay) = (inputs.guidance.clone(), inputs.overlay.clone());
    Ok(FrameInputs { previous, current, guidance, rendered, previous_depth, overlay })
}
