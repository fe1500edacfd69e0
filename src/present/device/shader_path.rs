//! Frames by compute shaders: the generator, and the output pass after it.

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;

use super::super::frame::FramePlan;
use super::inputs::{FrameInputs, in_common_state};
use super::output_pass::OutputPass;
use super::resource_cache::ResourceCache;
use crate::framegen::AnchorId;
use crate::framegen::shader::{ShaderGenerator, TexturePair};
use crate::gpu::Gpu;
use crate::gpu::compute::picture_formats::PictureFormat;
use crate::gpu::compute::{CommandRecorder, Output, ResourceWithState, Transfer};
use crate::{Colours, Result};

/// The shader generator, the pair that it is prepared for, and the output pass. They are created anew together for frames of another size.
pub(super) struct ShaderPath {
    generator: ShaderGenerator,
    /// Scales and converts pictures for targets that the generator does not write itself.
    output_pass: Option<OutputPass>,
    /// The pair that the generator is prepared for.
    pair: Option<PairKey>,
    /// Colours of the targets.
    colours: Colours,
}

/// Cache key of a prepared pair.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct PairKey {
    /// The later anchor.
    pub(super) anchor: AnchorId,
    /// Version of the overlay mask.
    pub(super) overlay: u64,
}

impl ShaderPath {
    /// For generated pictures of `size` and targets in `colours`.
    ///
    /// # Errors
    /// As for [`ShaderGenerator::new`].
    pub(super) fn new(gpu: &Gpu, size: (u32, u32), colours: Colours) -> Result<Self> {
        Ok(Self { generator: generator(gpu, size, colours)?, output_pass: None, pair: None, colours })
    }

    /// Creates a generator for another size and drops the output pass.
    ///
    /// # Errors
    /// As for [`ShaderGenerator::new`].
    pub(super) fn resize(&mut self, gpu: &Gpu, size: (u32, u32)) -> Result<()> {
        (self.output_pass, self.pair) = (None, None);
        self.generator = generator(gpu, size, self.colours)?;
        Ok(())
    }

    /// Sets up the output pass from pictures of the size `from` to frames of the size `to`, or drops it if the generator can write the frames.
    ///
    /// # Errors
    /// As for [`OutputPass::new`] and [`OutputPass::fit`].
    pub(super) fn set_output_size(
        &mut self,
        cache: &mut ResourceCache,
        gpu: &Gpu,
        from: (u32, u32),
        to: (u32, u32),
        letterbox: bool,
    ) -> Result<()> {
        if to == from && matches!(self.colours, Colours::Srgb | Colours::Linear) {
            self.output_pass = None;
            return Ok(());
        }
        let output_pass = match &mut self.output_pass {
            Some(output_pass) => output_pass,
            none => none.insert(OutputPass::new(gpu, from)?),
        };
        output_pass.fit(cache, to, letterbox)
    }

    /// Whether frames have another size than generated pictures.
    pub(super) fn resizes(&self) -> bool {
        self.output_pass.as_ref().is_some_and(OutputPass::resizes)
    }

    /// Submits the work that all frames of a pair share, unless the generator is prepared for this pair already.
    ///
    /// # Errors
    /// As for [`ShaderGenerator::prepare`].
    pub(super) fn prepare_pair(
        &mut self,
        cache: &mut ResourceCache,
        gpu: &Gpu,
        pair: &TexturePair<'_>,
        key: PairKey,
    ) -> Result<()> {
        // Textures are recycled, so pointer equality does not identify the pair.
        if self.pair == Some(key) && self.generator.is_prepared(pair)? {
            return Ok(());
        }
        self.pair = None;
        let mut frame = cache.begin()?;
        frame.begin_event(c"Cairn: what frames of a pair have in common");
        self.generator.prepare(&mut frame, pair)?;
        frame.end_event();
        frame.submit(gpu.frames())?;
        self.pair = Some(key);
        Ok(())
    }

    /// Records another copy of the last frame into `target`; `false` if it does not have this format any more.
    ///
    /// # Errors
    /// As for any frame.
    pub(super) fn record_again(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        format: PictureFormat,
        target: Output<'_>,
    ) -> Result<bool> {
        match &self.output_pass {
            None => self.generator.record_again(frame, target),
            Some(output_pass) => output_pass.again(frame, format, self.colours, target),
        }
    }

    /// Records the frame of a plan into `target`; with `half_way`, shows the provider's frame instead of generating one.
    ///
    /// # Errors
    /// As for any frame.
    pub(super) fn record(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        plan: &FramePlan,
        inputs: &FrameInputs,
        half_way: Option<&ID3D12Resource>,
        format: PictureFormat,
        target: Output<'_>,
    ) -> Result<()> {
        let Self { generator, output_pass, colours, .. } = self;
        match output_pass {
            None => generate(generator, frame, plan, inputs, half_way, target),
            Some(output_pass) => {
                let picture = Output::from(&output_pass.picture());
                generate(generator, frame, plan, inputs, half_way, picture)?;
                output_pass.record(frame, format, *colours, target)
            }
        }
    }

    /// The generator's report on the last frame, to copy from.
    pub(super) fn report(&self) -> ResourceWithState<'_> {
        self.generator.report()
    }
}

fn generator(gpu: &Gpu, size: (u32, u32), colours: Colours) -> Result<ShaderGenerator> {
    let transfer = if colours == Colours::Linear { Transfer::Linear } else { Transfer::Encoded };
    Ok(ShaderGenerator::new(gpu, size)?.with_target_transfer(transfer))
}

/// Records the picture of a plan; with `half_way`, shows that picture instead.
fn generate(
    generator: &mut ShaderGenerator,
    frame: &mut CommandRecorder<'_>,
    plan: &FramePlan,
    inputs: &FrameInputs,
    half_way: Option<&ID3D12Resource>,
    target: Output<'_>,
) -> Result<()> {
    if let Some(half_way) = half_way {
        return generator.show_anchor(frame, &in_common_state(half_way), target);
    }
    match plan {
        FramePlan::Copy { .. } => generator.show_anchor(frame, &in_common_state(&inputs.current), target),
        FramePlan::Interpolate { t, .. } => generator.interpolate(frame, &inputs.pair()?, *t, target),
        FramePlan::Extrapolate { t, .. } => {
            generator.extrapolate(frame, &in_common_state(&inputs.current), &inputs.guidance()?, false, *t, target)
        }
    }
}
