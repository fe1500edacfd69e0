//! Three frames between two, by two generators: the second one is shown frames at twice the rate, every other of them the first one's.
//! Windows only.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::bindings::{Coordinates, CreateFlags, Dimensions, MemoryUsage};
use super::textures::{GROUP, Memory, Pictures, TextureGenerator, TextureOptions, motion_size_at, texture};
use super::{Api, Shot};
use crate::gpu::compute::{CommandRing, Kernel, ResourceWithState, Shape, View};
use crate::gpu::{FencePoint, Gpu};
use crate::{Error, ErrorKind, Result};

/// Generates the frames at a quarter, the half and three quarters between a frame and the one before: one generator makes the half,
/// and a second one the quarters, from the frame before to the half and from the half to the frame. Motion is halved for it, and
/// moved on with what moves for the half.
///
/// It costs two generators' memory and three generated frames, and faults of the half are in the quarters again. AMD advises
/// frames at 60 a second and more for its analytic provider and at 30 for the one by a network. A stream of 15 a second is
/// below both, doubled or not: what moves far between two frames is then found less often. Other phases than these are for the
/// generators of [`framegen`](crate::framegen).
///
/// Threads: one at a time; may move between them.
pub struct FourfoldGenerator {
    /// First: it waits until nothing that follows is used any more.
    ring: CommandRing,
    half: TextureGenerator,
    quarters: TextureGenerator,
    /// Of frames without interface, the one half way; made for the first that is given.
    bare: Option<Bare>,
    gpu: Gpu,
    api: Api,
    halfway: Kernel,
    /// Of the frame before.
    jitter: Coordinates,
    /// Motion and depth half way, of the size rendered at.
    between: Option<(Dimensions, [ID3D12Resource; 2])>,
    options: TextureOptions,
}

/// What makes frames without interface half way, and where they are.
struct Bare {
    generator: TextureGenerator,
    half: ID3D12Resource,
}

/// What shaders write.
const WRITTEN: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// Formats of motion and depth half way.
const FORMATS: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32_FLOAT];

/// Descriptors of a frame.
const ROOM: u32 = 4;

impl FourfoldGenerator {
    /// Makes both generators on `gpu`; the second one is of the kind that the first one has become, and is not tested again.
    ///
    /// # Errors
    /// As of [`TextureGenerator::new`].
    pub fn new(gpu: &Gpu, api: &Api, options: &TextureOptions) -> Result<Self> {
        let half = TextureGenerator::new(gpu, api, options)?;
        let choice = half.provider().version.family().map_or(options.choice, super::Choice::Require);
        let second = TextureOptions { choice, self_test: false, ..*options };
        Ok(Self {
            ring: CommandRing::new(gpu, gpu.frames(), ROOM)?,
            quarters: TextureGenerator::new(gpu, api, &second)?,
            half,
            bare: None,
            gpu: gpu.clone(),
            api: *api,
            halfway: Kernel::new(
                gpu,
                include_bytes!("../gpu/shaders/fsr_halfway.dxbc"),
                Shape { constants: 5, inputs: 2, outputs: 2 },
            )?,
            jitter: Coordinates::default(),
            between: None,
            options: second,
        })
    }

    /// The generator of the frames half way; the other one is of the same provider.
    pub fn half(&mut self) -> &mut TextureGenerator {
        &mut self.half
    }

    /// What both keep on the device, and with the second what is between them.
    ///
    /// # Errors
    /// What the library answers.
    pub fn memory(&mut self) -> Result<[Memory; 2]> {
        let [half, mut quarters] = [self.half.memory()?, self.quarters.memory()?];
        for texture in self.between.iter().flat_map(|(_, textures)| textures) {
            // SAFETY: a live device and resource.
            let size = unsafe { self.gpu.device().GetResourceAllocationInfo(0, &[texture.GetDesc()]) };
            quarters.own += size.SizeInBytes;
        }
        if let Some(bare) = &mut self.bare {
            let more = bare.generator.memory()?;
            // SAFETY: a live device and resource.
            let size = unsafe { self.gpu.device().GetResourceAllocationInfo(0, &[bare.half.GetDesc()]) };
            quarters.own += more.own + size.SizeInBytes;
            quarters.provider = quarters
                .provider
                .zip(more.provider)
                .map(|(a, b)| MemoryUsage { total: a.total + b.total, aliasable: a.aliasable + b.aliasable });
        }
        Ok([half, quarters])
    }

    /// Generates the three frames, on the device's queue for frames, in the order in which they are shown; the moment when all are
    /// there. The half goes to `pictures.output`, which shaders can read, and the quarters to the two others.
    ///
    /// Frames without interface cost a third generator, which makes the one half way of them; the first that is given starts anew. A
    /// lens is taken to distort alike at the half and at the frame.
    ///
    /// # Errors
    /// As of [`TextureGenerator::generate`]. What of the three was submitted before is then of no use, and the next starts anew.
    pub fn generate(
        &mut self,
        pictures: &Pictures<'_>,
        quarters: [ResourceWithState<'_>; 2],
        shot: &Shot,
    ) -> Result<FencePoint> {
        let done = self.all(pictures, quarters, shot);
        if done.is_err() {
            self.half.forget();
            self.quarters.forget();
            self.forget_bare();
        }
        done
    }

    fn all(
        &mut self,
        pictures: &Pictures<'_>,
        quarters: [ResourceWithState<'_>; 2],
        shot: &Shot,
    ) -> Result<FencePoint> {
        let head = &self.options.head;
        let motion_size = motion_size_at(head, shot.render_size);
        let rendered = shot.render_size;
        if (motion_size.width, motion_size.height) != (rendered.width, rendered.height) {
            let why = "motion has another size than depth";
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("motion"));
        }
        let is_inverted = head.flags.contains(CreateFlags::DEPTH_INVERTED);
        let follows = self.half.follows()
            && (pictures.hudless.is_none() || self.bare.as_ref().is_some_and(|bare| bare.generator.follows()));
        let starts = shot.reset || !follows;
        let shot = &Shot { reset: starts, ..*shot };
        let bare = match &pictures.hudless {
            Some(hudless) => Some(self.bare(hudless, pictures, shot)?),
            None => {
                self.forget_bare();
                None
            }
        };
        let bare = bare.as_ref().map(|resource| ResourceWithState { resource, state: WRITTEN });
        self.half.generate(pictures, shot)?;
        let between = self.between(rendered)?.clone();
        let [motion, depth] = between.each_ref().map(|resource| ResourceWithState { resource, state: WRITTEN });
        self.carry(pictures, [&motion, &depth], shot, is_inverted)?;
        // Half of the way, in half of the time.
        let Coordinates { x, y } = shot.motion_scale;
        let halved =
            Shot { motion_scale: Coordinates { x: x / 2.0, y: y / 2.0 }, frame_time: shot.frame_time / 2.0, ..*shot };
        // Motion to the half holds half of what jitter has changed by: as if the half were seen with the mean of both.
        let before = std::mem::replace(&mut self.jitter, shot.jitter);
        let mean = Coordinates { x: (before.x + shot.jitter.x) / 2.0, y: (before.y + shot.jitter.y) / 2.0 };
        let [first, last] = quarters;
        let to_half = Pictures { color: pictures.output, output: first, motion, depth, hudless: bare, ..*pictures };
        self.quarters.generate(&to_half, &Shot { jitter: mean, ..halved })?;
        self.quarters.generate(&Pictures { output: last, ..*pictures }, &halved)
    }

    /// The frame without interface half way.
    fn bare(
        &mut self,
        hudless: &ResourceWithState<'_>,
        pictures: &Pictures<'_>,
        shot: &Shot,
    ) -> Result<ID3D12Resource> {
        let TextureOptions { mut head, hudless: format, .. } = self.options;
        let bare = match &mut self.bare {
            Some(bare) => bare,
            none => {
                self.gpu.owns(hudless.resource, "hudless")?;
                head.back_buffer_format = format.unwrap_or(head.back_buffer_format);
                let options = TextureOptions { head, hudless: None, ..self.options };
                // SAFETY: a live resource.
                let wanted = unsafe { hudless.resource.GetDesc() }.Format;
                none.insert(Bare {
                    generator: TextureGenerator::new(&self.gpu, &self.api, &options)?,
                    half: texture(&self.gpu, head.display_size, wanted)?,
                })
            }
        };
        let output = ResourceWithState { resource: &bare.half, state: WRITTEN };
        let pictures = Pictures { color: *hudless, output, hudless: None, ..*pictures };
        // What the provider says of it is of the colour; here that is the frame without interface.
        bare.generator.generate(&pictures, shot).map_err(|why| match why.offending_field() {
            Some("color") => why.field("hudless"),
            _ => why,
        })?;
        Ok(bare.half.clone())
    }

    /// Of frames without interface the next one starts anew.
    fn forget_bare(&mut self) {
        if let Some(bare) = &mut self.bare {
            bare.generator.forget();
        }
    }

    /// Textures for what is half way.
    fn between(&mut self, size: Dimensions) -> Result<&[ID3D12Resource; 2]> {
        let fits = |(had, _): &(Dimensions, _)| (had.width, had.height) == (size.width, size.height);
        // What is under way holds those before.
        let textures = match self.between.take().filter(fits) {
            Some((_, textures)) => textures,
            None => [texture(&self.gpu, size, FORMATS[0])?, texture(&self.gpu, size, FORMATS[1])?],
        };
        Ok(&self.between.insert((size, textures)).1)
    }

    /// Moves motion and depth on to where they are half way.
    fn carry(
        &mut self,
        pictures: &Pictures<'_>,
        [motion, depth]: [&ResourceWithState<'_>; 2],
        shot: &Shot,
        is_inverted: bool,
    ) -> Result<()> {
        // SAFETY: live resources.
        let formats = [&pictures.motion, &pictures.depth].map(|of| unsafe { of.resource.GetDesc() }.Format);
        let read = |format| match format {
            DXGI_FORMAT_R32_TYPELESS | DXGI_FORMAT_D32_FLOAT => DXGI_FORMAT_R32_FLOAT,
            DXGI_FORMAT_R16_TYPELESS | DXGI_FORMAT_D16_UNORM => DXGI_FORMAT_R16_UNORM,
            other => other,
        };
        let size = shot.render_size;
        let scale = [shot.motion_scale.x, shot.motion_scale.y].map(f32::to_bits);
        let constants = [size.width, size.height, scale[0], scale[1], u32::from(is_inverted)];
        let groups = [size.width.div_ceil(GROUP), size.height.div_ceil(GROUP), 1];
        let mut frame = self.ring.begin()?;
        let inputs =
            [View::Texture(pictures.motion, read(formats[0])), View::Texture(pictures.depth, read(formats[1]))];
        let outputs = [View::Texture(*motion, FORMATS[0]), View::Texture(*depth, FORMATS[1])];
        frame.run(&self.halfway, &constants, &inputs, &outputs, groups)?;
        frame.submit(self.gpu.frames()).map(drop)
    }
}

impl std::fmt::Debug for FourfoldGenerator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "FourfoldGenerator({:?}, {:?})", self.half, self.quarters)
    }
}
