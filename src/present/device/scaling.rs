//! What brings frames to their size: AMD's upscaler before they are generated, or a filter afterwards.

use super::resource_cache::FrameInputs;
use super::upsampler::{Small, Upsampler};
use super::{DeviceDrawer, PendingFrame, Plan, Presenter};
use crate::ffx::{Api, Choice, Version};
use crate::{Error, ErrorKind, Result};

/// An upscaler of AMD's that is to be used.
pub(super) struct Upscaling {
    enlarger: Option<Upsampler>,
    api: Api,
    choice: Choice,
    /// Where nobody else is to do what it does.
    is_required: bool,
    /// Why it is not used any more.
    failed: Option<Error>,
}

/// What brings frames from the size of anchors to theirs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScaledBy<'a> {
    /// Nothing: they have it.
    Nothing,
    /// Each frame is resized, by itself.
    Space,
    /// A provider of AMD's makes anchors larger, each from those before it too.
    Amd(&'a Version),
}

impl DeviceDrawer {
    /// From now on anchors are made as large as frames by a provider of AMD's upscaler in `api`, before frames are generated between them.
    /// That is where frames are larger than anchors; and where these do not bring all frames with them, as it goes from anchor to anchor.
    /// Where the provider fails frames are resized in space, unless it `is_required`: then drawing fails.
    pub fn use_fsr_upscaler(&mut self, api: &Api, choice: Choice, is_required: bool) {
        self.upscaling = Some(Upscaling { enlarger: None, api: *api, choice, is_required, failed: None });
    }

    /// Who makes anchors larger.
    pub(super) fn enlarger(&self) -> Option<&Upsampler> {
        self.upscaling.as_ref().and_then(|upscaling| upscaling.enlarger.as_ref())
    }

    /// What brings frames to their size, as of the last [`prepare`](Self::prepare).
    pub fn scaled_by(&self) -> ScaledBy<'_> {
        match (self.enlarger(), &self.output_pass) {
            (Some(enlarger), _) => ScaledBy::Amd(enlarger.version()),
            (None, Some(output_pass)) if output_pass.resizes() => ScaledBy::Space,
            _ => ScaledBy::Nothing,
        }
    }

    /// Why the upscaler that it was given is not used any more, where it failed.
    pub fn upscaler_failed(&self) -> Option<&Error> {
        self.upscaling.as_ref().and_then(|upscaling| upscaling.failed.as_ref())
    }

    /// Has anchors made so large, where that is wanted and can be; the size that they have then.
    pub(super) fn enlarge_to(&mut self, wanted: (u32, u32), decoded: bool) -> Result<(u32, u32)> {
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
            upscaling.enlarger = None;
            return Ok(self.size);
        }
        if upscaling.enlarger.as_ref().is_some_and(|enlarger| enlarger.to() == wanted) {
            return Ok(wanted);
        }
        // First, as there may not be room for both.
        upscaling.enlarger = None;
        match Upsampler::new(&self.gpu, &upscaling.api, upscaling.choice, self.size, wanted) {
            Ok(made) => {
                upscaling.enlarger = Some(made);
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

    /// What a frame is made of, of larger anchors where these are made larger first.
    pub(super) fn larger(
        &mut self,
        inputs: FrameInputs,
        pending: &PendingFrame,
        presenter: &Presenter,
        interval_ms: f32,
    ) -> Result<FrameInputs> {
        let enlarger = self.upscaling.as_mut().and_then(|upscaling| upscaling.enlarger.as_mut());
        let Some(enlarger) = enlarger else { return Ok(inputs) };
        let why = match enlarge(enlarger, &inputs, pending, interval_ms) {
            Ok(larger) => return Ok(larger),
            Err(why) => why,
        };
        let upscaling = self.upscaling.as_mut().filter(|upscaling| !upscaling.is_required);
        let Some(upscaling) = upscaling.filter(|_| why.kind() != ErrorKind::DeviceRemoved) else { return Err(why) };
        log::warn!("frames are resized in space from now on, as the upscaler fails: {why}");
        (upscaling.enlarger, upscaling.failed) = (None, Some(why));
        // Makes memory for frames of the anchors' size; the pipelines are the device's and are there.
        self.work_at(self.size)?;
        self.scale_to(pending.size.unwrap_or(self.size), presenter.keeps_shape())?;
        // What lies over the anchors had the larger size.
        self.cache.bring(pending, presenter.options().motion, false)
    }
}

/// The same of larger anchors.
fn enlarge(
    enlarger: &mut Upsampler,
    inputs: &FrameInputs,
    pending: &PendingFrame,
    interval_ms: f32,
) -> Result<FrameInputs> {
    let place = pending.plan.place(pending.epoch);
    let before = place.and_then(|(stream, number)| Some((stream, number.checked_sub(1)?)));
    let slot = pending.plan.slot();
    let previous = match &inputs.previous {
        // The pair's motion leads away from it.
        Some(picture) => Some(enlarger.anchor(&Small { place: before, picture, lead: None, interval_ms })?),
        None => None,
    };
    let lead = inputs.guidance.as_ref().filter(|_| !slot.cut).map(|guidance| (guidance, slot.projection()));
    let current = enlarger.anchor(&Small { place, picture: &inputs.current, lead, interval_ms })?;
    let guidance = match (&pending.plan, &inputs.guidance, place) {
        (Plan::Interpolate { .. } | Plan::Extrapolate { .. }, Some(guidance), Some(place)) => {
            Some(enlarger.guidance(place, guidance)?)
        }
        _ => None,
    };
    let previous_depth = inputs.previous_depth.as_ref().and(before).and_then(|before| enlarger.depth(before));
    let (rendered, overlay) = (inputs.guidance.clone(), inputs.overlay.clone());
    Ok(FrameInputs { previous, current, guidance, rendered, previous_depth, overlay })
}
