//! Generates frames of pictures in memory on a Direct3D 12 device, for tools, which have no textures. Windows only.
//!
//! Each frame is uploaded, generated and read back, and the caller waits for it. Engines use
//! [`present::device`](crate::present::device).

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::fsr::{FsrGenerator, PairParams};
use super::shader::{
    DESCRIPTORS, GuidanceTextures, ShaderGenerator, TexturePair, WORD_OF_CUT, WORD_OF_UNCOVERED, WORD_OF_UNEXPLAINED,
};
use super::{Anchor, AnchorId, AnchorPair, FrameGenerator, GenerateReport, Outcome, Phases};
use crate::ffx::{Api, Choice, Version};
use crate::gpu::compute::{CommandRing, ResourceWithState};
use crate::gpu::{Gpu, Heap, MappedBuffer, read_buffer, read_texture, texture_from_picture, writable_texture};
use crate::guidance::{DepthMap, Guidance, MotionOrigin};
use crate::{Error, ErrorKind, Picture, Result};

/// 32-bit words of a report.
const WORDS: usize = WORD_OF_UNEXPLAINED as usize + 1;
const STATE: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COMMON;

/// Generates frames of pictures in memory on a device: with the library's shaders at any phase, or with a provider of AMD's half way
/// between two anchors. Shaders extrapolate in either case.
pub struct DeviceGenerator {
    gpu: Gpu,
    /// AMD's library and the choice of provider; `None` for the shaders.
    amd: Option<(Api, Choice)>,
    interval_ms: f32,
    resources: Option<Resources>,
}

/// Resources for one size.
struct Resources {
    size: (u32, u32),
    shader: ShaderGenerator,
    fsr: Option<FsrGenerator>,
    frames: CommandRing,
    target: ID3D12Resource,
    /// The later anchor of the last pair.
    last: Option<Picture>,
    /// Its index in the provider's sequence, which no later pair has again: the provider gives its last frame for its last index.
    index: u64,
}

/// Anchors and their guidance in textures.
struct UploadedInputs {
    pictures: Vec<ID3D12Resource>,
    motion: ID3D12Resource,
    depth: ID3D12Resource,
    tiles: [u32; 2],
    motion_origin: MotionOrigin,
    previous_depth: Option<(ID3D12Resource, u32)>,
    overlay: Option<ID3D12Resource>,
}

impl DeviceGenerator {
    /// A generator with the library's shaders.
    pub fn of_shaders(gpu: &Gpu) -> Self {
        Self { gpu: gpu.clone(), amd: None, interval_ms: 1000.0 / 15.0, resources: None }
    }

    /// A generator with a provider of AMD's; `interval_ms` is the time between anchors, in milliseconds of the world's time.
    pub fn of_amd(gpu: &Gpu, api: &Api, choice: Choice, interval_ms: f32) -> Self {
        Self { gpu: gpu.clone(), amd: Some((*api, choice)), interval_ms, resources: None }
    }

    /// The provider of AMD's in use; `None` with the shaders, and before the first frame.
    pub fn provider(&self) -> Option<&Version> {
        self.resources.as_ref()?.fsr.as_ref().map(FsrGenerator::version)
    }

    /// The resources for pictures of `size`, created if needed.
    fn resources(&mut self, size: (u32, u32)) -> Result<&mut Resources> {
        if self.resources.as_ref().is_none_or(|resources| resources.size != size) {
            // Freed first: there may not be enough memory for both.
            self.resources = None;
            let gpu = &self.gpu;
            let fsr = self.amd.map(|(api, choice)| FsrGenerator::new(gpu, &api, choice, size, size)).transpose()?;
            self.resources = Some(Resources {
                size,
                shader: ShaderGenerator::new(gpu, size)?,
                fsr,
                frames: CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?,
                target: writable_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, STATE)?,
                last: None,
                index: 0,
            });
        }
        self.resources.as_mut().ok_or_else(|| Error::new(ErrorKind::InvalidState, "nothing was made"))
    }

    /// Uploads pictures, guidance, the depth of the previous anchor, and the overlay mask.
    fn upload(
        &self,
        pictures: &[&Picture],
        guidance: &Guidance,
        previous: Option<&DepthMap>,
        overlay: Option<&[u8]>,
    ) -> Result<UploadedInputs> {
        let size = guidance.size();
        let overlay = overlay.map(|mask| upload(&self.gpu, mask, size, DXGI_FORMAT_R8_UNORM)).transpose()?;
        let pictures =
            pictures.iter().map(|picture| Ok(texture_from_picture(&self.gpu, picture)?.0)).collect::<Result<_>>()?;
        let [motion, depth] = guidance_textures(&self.gpu, guidance)?;
        let previous = previous.map(|map| Ok::<_, Error>((depth_texture(&self.gpu, map)?, map.tile())));
        Ok(UploadedInputs {
            pictures,
            motion,
            depth,
            tiles: [guidance.motion().tile(), guidance.depth().tile()],
            motion_origin: guidance.origin(),
            previous_depth: previous.transpose()?,
            overlay,
        })
    }
}

impl UploadedInputs {
    fn guidance(&self) -> GuidanceTextures<'_> {
        GuidanceTextures {
            motion: in_common_state(&self.motion),
            motion_tile: self.tiles[0],
            depth: in_common_state(&self.depth),
            depth_tile: self.tiles[1],
            motion_origin: self.motion_origin,
            hud: self.overlay.as_ref().map(in_common_state),
        }
    }
}

impl FrameGenerator for DeviceGenerator {
    fn name(&self) -> &str {
        if self.amd.is_some() { "fsr" } else { "shader" }
    }

    fn phases(&self) -> Phases {
        if self.amd.is_some() { Phases::OnlyHalf } else { Phases::Any }
    }

    fn generate(&mut self, pair: &AnchorPair<'_>, t: f32, out: &mut Picture) -> Result<GenerateReport> {
        super::pair::check_size(out.size(), pair.size(), "out")?;
        if !self.phases().contains(t) {
            let cause = format!("{} makes no frame at phase {t}", self.name());
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field("t").remedy("Use shader, or cpu"));
        }
        let inputs =
            self.upload(&[pair.previous(), pair.current()], pair.guidance(), pair.previous_depth(), pair.overlay())?;
        let (gpu, interval_ms) = (self.gpu.clone(), self.interval_ms);
        let resources = self.resources(pair.size())?;
        let textures = TexturePair {
            previous: in_common_state(&inputs.pictures[0]),
            current: in_common_state(&inputs.pictures[1]),
            guidance: inputs.guidance(),
            previous_depth: inputs.previous_depth.as_ref().map(|(depth, tile)| (in_common_state(depth), *tile)),
            cut: pair.is_cut(),
        };
        if let Some(fsr) = resources.fsr.as_mut().filter(|_| !pair.is_cut()) {
            // A pair that follows the last one gets the next index; any other pair skips an index, so that the provider resets its history.
            let follows = resources.last.take().is_some_and(|picture| picture == *pair.previous());
            resources.index += if follows { 1 } else { 2 };
            let anchor = AnchorId { epoch: 0, index: resources.index };
            let params = PairParams { anchor, projection: pair.guidance().depth().projection(), interval_ms };
            let (half_way, fence_point) = fsr.generate(&textures, &params)?;
            fence_point.wait()?;
            copy(&read_texture(&gpu, &half_way, STATE)?, out);
            resources.last = Some(pair.current().clone());
            return Ok(GenerateReport { outcome: Outcome::Generated, uncovered: 0.0, unexplained: 0.0 });
        }
        let mut frame = resources.frames.begin()?;
        resources.shader.generate(&mut frame, &textures, t, &in_common_state(&resources.target))?;
        frame.submit(gpu.frames())?.wait()?;
        resources.report(&gpu, out)
    }

    fn extrapolate(&mut self, anchor: &Anchor<'_>, t: f32, out: &mut Picture) -> Result<GenerateReport> {
        super::pair::check_size(out.size(), anchor.picture().size(), "out")?;
        let inputs = self.upload(&[anchor.picture()], anchor.guidance(), None, anchor.overlay())?;
        let gpu = self.gpu.clone();
        let resources = self.resources(anchor.picture().size())?;
        let mut frame = resources.frames.begin()?;
        let (picture, target) = (in_common_state(&inputs.pictures[0]), in_common_state(&resources.target));
        resources.shader.extrapolate(&mut frame, &picture, &inputs.guidance(), anchor.is_after_cut(), t, &target)?;
        frame.submit(gpu.frames())?.wait()?;
        let report = resources.report(&gpu, out)?;
        let is_held = t > 1.0 || anchor.is_after_cut();
        Ok(GenerateReport { outcome: if is_held { Outcome::Held } else { report.outcome }, ..report })
    }

    fn reset(&mut self) {
        if let Some(resources) = &mut self.resources {
            resources.last = None;
        }
    }
}

impl Resources {
    /// Reads the last frame and its report.
    fn report(&self, gpu: &Gpu, out: &mut Picture) -> Result<GenerateReport> {
        copy(&read_texture(gpu, &self.target, STATE)?, out);
        let mut bytes = [0; 4 * WORDS];
        read_buffer(gpu, self.shader.report().resource, &mut bytes)?;
        let word = |at: u32| bytes.as_chunks::<4>().0[at as usize];
        let is_cut = word(WORD_OF_CUT) != [0; 4];
        let pixels = f64::from(self.size.0) * f64::from(self.size.1);
        Ok(GenerateReport {
            outcome: if is_cut { Outcome::CutFallback } else { Outcome::Generated },
            uncovered: (f64::from(u32::from_le_bytes(word(WORD_OF_UNCOVERED))) / pixels) as f32,
            unexplained: f32::from_le_bytes(word(WORD_OF_UNEXPLAINED)),
        })
    }
}

impl std::fmt::Debug for DeviceGenerator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "DeviceGenerator({})", self.name())
    }
}

fn in_common_state(resource: &ID3D12Resource) -> ResourceWithState<'_> {
    ResourceWithState { resource, state: STATE }
}

fn copy(from: &Picture, to: &mut Picture) {
    to.pixels_mut().copy_from_slice(from.pixels());
}

/// Uploads motion and depth to textures, in the state COMMON.
pub(crate) fn guidance_textures(gpu: &Gpu, guidance: &Guidance) -> Result<[ID3D12Resource; 2]> {
    let motion = guidance.motion();
    let vectors = bytemuck::must_cast_slice::<[half::f16; 2], u8>(motion.vectors());
    let motion = upload(gpu, vectors, (motion.columns(), motion.rows()), DXGI_FORMAT_R16G16_FLOAT)?;
    Ok([motion, depth_texture(gpu, guidance.depth())?])
}

fn depth_texture(gpu: &Gpu, map: &DepthMap) -> Result<ID3D12Resource> {
    let bytes = bytemuck::must_cast_slice::<f32, u8>(map.depth());
    upload(gpu, bytes, (map.columns(), map.rows()), DXGI_FORMAT_R32_FLOAT)
}

/// A texture with these tightly packed rows.
fn upload(gpu: &Gpu, bytes: &[u8], size: (u32, u32), format: DXGI_FORMAT) -> Result<ID3D12Resource> {
    let row = bytes.len() / size.1 as usize;
    let pitch = row.next_multiple_of(D3D12_TEXTURE_DATA_PITCH_ALIGNMENT as usize);
    let mut memory = MappedBuffer::new(gpu, Heap::Upload, pitch * size.1 as usize)?;
    bytes.chunks_exact(row).enumerate().for_each(|(y, bytes)| memory.write(y * pitch, bytes));
    let to = writable_texture(gpu, size, format, STATE)?;
    let rows =
        D3D12_SUBRESOURCE_FOOTPRINT { Format: format, Width: size.0, Height: size.1, Depth: 1, RowPitch: pitch as u32 };
    let rows = D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: rows };
    let mut ring = CommandRing::new(gpu, gpu.frames(), 1)?;
    let mut frame = ring.begin()?;
    let from = ResourceWithState { resource: memory.resource(), state: D3D12_RESOURCE_STATE_GENERIC_READ };
    frame.copy_rows(&from, rows, &in_common_state(&to))?;
    frame.submit(gpu.frames())?.wait()?;
    Ok(to)
}
