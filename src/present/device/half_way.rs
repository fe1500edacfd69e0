//! Frames half way between two anchors by a provider of AMD's.

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;

use super::super::frame::FramePlan;
use super::inputs::FrameInputs;
use crate::ffx::{Api, Choice, Version};
use crate::framegen::fsr::{FsrGenerator, PairParams};
use crate::framegen::shader::GuidanceTextures;
use crate::gpu::Gpu;
use crate::{Error, ErrorKind, Result};

/// AMD's frame generator and its state.
pub(super) struct HalfWayGenerator {
    api: Api,
    choice: Choice,
    /// If set, a failure is an error; otherwise the shaders take over.
    is_required: bool,
    generator: Option<FsrGenerator>,
    /// The failure after which it is not used any more.
    failure: Option<Error>,
    /// Whether it made the last generated frame; true before the first one.
    made_last: bool,
}

impl HalfWayGenerator {
    /// For generated pictures of `size`, with motion and depth of the size `guidance`.
    ///
    /// # Errors
    /// As of [`FsrGenerator::new`].
    pub(super) fn new(
        gpu: &Gpu,
        api: &Api,
        choice: Choice,
        is_required: bool,
        size: (u32, u32),
        guidance: (u32, u32),
    ) -> Result<Self> {
        let generator = Some(FsrGenerator::new(gpu, api, choice, size, guidance)?);
        Ok(Self { api: *api, choice, is_required, generator, failure: None, made_last: true })
    }

    /// Creates the provider anew for another size, unless it has failed.
    ///
    /// # Errors
    /// `DeviceRemoved`; as of [`FsrGenerator::new`] if the provider is required.
    pub(super) fn resize(&mut self, gpu: &Gpu, size: (u32, u32), guidance: (u32, u32)) -> Result<()> {
        if self.failure.is_some() {
            return Ok(());
        }
        // Freed first: there may not be enough memory for both.
        self.generator = None;
        match FsrGenerator::new(gpu, &self.api, self.choice, size, guidance) {
            Ok(made) => self.generator = Some(made),
            Err(error) if self.is_required || error.kind() == ErrorKind::DeviceRemoved => return Err(error),
            Err(error) => {
                log::warn!("frames are made by shaders from now on, as there is no fsr of another size: {error}");
                self.failure = Some(error);
            }
        }
        Ok(())
    }

    /// The provider's frame of a plan; `None` if the plan is not the frame half way between two anchors, or the provider has failed.
    ///
    /// # Errors
    /// `DeviceRemoved`; as of [`FsrGenerator::generate`] if the provider is required.
    pub(super) fn generate(
        &mut self,
        plan: &FramePlan,
        inputs: &FrameInputs,
        interval_ms: f32,
    ) -> Result<Option<ID3D12Resource>> {
        let FramePlan::Interpolate { current, id, t, .. } = plan else { return Ok(None) };
        let Some(generator) = self.generator.as_mut().filter(|_| *t == 0.5) else { return Ok(None) };
        let params = PairParams { anchor: *id, projection: current.projection(), interval_ms };
        let mut pair = inputs.pair()?;
        if let Some(original) = &inputs.original_guidance {
            pair.guidance = GuidanceTextures { hud: pair.guidance.hud, ..original.textures() };
        }
        // The provider runs on the queue for frames, so later work on that queue needs no wait.
        match generator.generate(&pair, &params) {
            Ok((half_way, _)) => Ok(Some(half_way)),
            Err(error) if self.is_required || error.kind() == ErrorKind::DeviceRemoved => Err(error),
            Err(error) => {
                log::warn!("frames are made by shaders from now on, as fsr fails: {error}");
                (self.generator, self.failure) = (None, Some(error));
                Ok(None)
            }
        }
    }

    /// Records whether the provider made the last generated frame.
    pub(super) fn set_made_last(&mut self, made_last: bool) {
        self.made_last = made_last;
    }

    /// The provider that made the last generated frame, or will make the first one half way; `None` if shaders did or will.
    pub(super) fn version_in_use(&self) -> Option<&Version> {
        self.generator.as_ref().filter(|_| self.made_last).map(FsrGenerator::version)
    }

    /// The failure after which the provider is not used any more.
    pub(super) fn failure(&self) -> Option<&Error> {
        self.failure.as_ref()
    }
}
