//! AMD's upscaler for anchors, before frames are generated between them.

use super::super::frame::{FramePlan, FrameRequest};
use super::inputs::FrameInputs;
use super::upsampler::{LowResolutionAnchor, Upsampler};
use crate::ffx::{Api, Choice, Version};
use crate::framegen::AnchorId;
use crate::gpu::Gpu;
use crate::{Error, ErrorKind, Result};

/// AMD's upscaler and its state.
pub(super) struct Upscaling {
    upsampler: Option<Upsampler>,
    api: Api,
    choice: Choice,
    /// If set, a failure is an error; otherwise frames are resized spatially.
    is_required: bool,
    /// The failure after which it is not used any more.
    failure: Option<Error>,
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

/// Result of an attempt to upscale a frame's inputs.
pub(super) enum UpscaleResult {
    /// The upscaler is not in use.
    Inactive,
    /// Inputs with upscaled anchors.
    Upscaled(FrameInputs),
    /// It failed and is not used any more.
    Failed,
}

impl Upscaling {
    /// With a provider in `api`. Nothing is created yet.
    pub(super) fn new(api: &Api, choice: Choice, is_required: bool) -> Self {
        Self { upsampler: None, api: *api, choice, is_required, failure: None }
    }

    /// The version of the upscaler, if it is in use.
    pub(super) fn version_in_use(&self) -> Option<&Version> {
        self.upsampler.as_ref().map(Upsampler::version)
    }

    /// The failure after which it is not used any more.
    pub(super) fn failure(&self) -> Option<&Error> {
        self.failure.as_ref()
    }

    /// Whether it is in use and has not upscaled this anchor yet.
    pub(super) fn lacks(&self, anchor: AnchorId) -> bool {
        self.upsampler.as_ref().is_some_and(|upsampler| !upsampler.has(anchor))
    }

    /// Creates or drops the upsampler from anchors of the size `from` to the size `to`; returns the resulting size of anchors. `brings_all`:
    /// anchors bring all frames of their interval.
    ///
    /// # Errors
    /// `Unsupported` if the upscaler is required and anchors bring all frames; `DeviceRemoved`; as of [`Upsampler::new`] if it is required.
    pub(super) fn resize(
        &mut self,
        gpu: &Gpu,
        from: (u32, u32),
        to: (u32, u32),
        brings_all: bool,
    ) -> Result<(u32, u32)> {
        if self.failure.is_some() {
            return Ok(from);
        }
        let enlarges = to != from && to.0 >= from.0 && to.1 >= from.1;
        if enlarges && brings_all && self.is_required {
            let cause = "the upscaler goes from anchor to anchor, and these bring all frames with them";
            return Err(Error::new(ErrorKind::Unsupported, cause)
                .field("upscaler")
                .remedy("Have frames generated, or let them be resized in space"));
        }
        if !enlarges || brings_all {
            self.upsampler = None;
            return Ok(from);
        }
        if self.upsampler.as_ref().is_some_and(|upsampler| upsampler.to() == to) {
            return Ok(to);
        }
        // Freed first: there may not be enough memory for both.
        self.upsampler = None;
        match Upsampler::new(gpu, &self.api, self.choice, from, to) {
            Ok(made) => {
                self.upsampler = Some(made);
                Ok(to)
            }
            Err(error) if self.is_required || error.kind() == ErrorKind::DeviceRemoved => Err(error),
            Err(error) => {
                log::warn!("frames are resized in space, as there is no upscaler of AMD's: {error}");
                self.failure = Some(error);
                Ok(from)
            }
        }
    }

    /// Upscales the anchors and the guidance of a frame's inputs.
    ///
    /// # Errors
    /// `DeviceRemoved`; errors of the upscaler if it is required.
    pub(super) fn upscale(&mut self, inputs: &FrameInputs, request: &FrameRequest) -> Result<UpscaleResult> {
        let Some(upsampler) = &mut self.upsampler else { return Ok(UpscaleResult::Inactive) };
        match upsample(upsampler, inputs, request) {
            Ok(upscaled) => Ok(UpscaleResult::Upscaled(upscaled)),
            Err(error) if self.is_required || error.kind() == ErrorKind::DeviceRemoved => Err(error),
            Err(error) => {
                log::warn!("frames are resized in space from now on, as the upscaler fails: {error}");
                (self.upsampler, self.failure) = (None, Some(error));
                Ok(UpscaleResult::Failed)
            }
        }
    }
}

/// The inputs with upscaled anchors.
fn upsample(upsampler: &mut Upsampler, inputs: &FrameInputs, request: &FrameRequest) -> Result<FrameInputs> {
    let (plan, interval_ms) = (&request.plan, request.interval_ms());
    let id = plan.anchor_id();
    let id_before = id.and_then(AnchorId::before);
    let anchor = plan.anchor();
    let previous = match &inputs.previous {
        // The pair's motion leads back to this anchor; the motion from it to the anchor before is not known here.
        Some(picture) => {
            Some(upsampler.anchor(&LowResolutionAnchor { id: id_before, picture, guidance: None, interval_ms })?)
        }
        None => None,
    };
    let guidance = inputs.guidance.as_ref().filter(|_| !anchor.cut).map(|guidance| (guidance, anchor.projection()));
    let current = upsampler.anchor(&LowResolutionAnchor { id, picture: &inputs.current, guidance, interval_ms })?;
    let guidance = match (plan, &inputs.guidance, id) {
        (FramePlan::Interpolate { .. } | FramePlan::Extrapolate { .. }, Some(guidance), Some(id)) => {
            Some(upsampler.guidance(id, guidance)?)
        }
        _ => None,
    };
    let previous_depth = inputs.previous_depth.as_ref().and(id_before).and_then(|id| upsampler.depth(id));
    let (original_guidance, overlay) = (inputs.guidance.clone(), inputs.overlay.clone());
    Ok(FrameInputs { previous, current, guidance, original_guidance, previous_depth, overlay })
}
