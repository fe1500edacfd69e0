//! Generates frames of pictures in memory on a Direct3D 12 device: for tools, which have no textures. Windows only.
//!
//! Each frame is uploaded, generated and read back, and the caller waits for it. Engines use
//! [`present::device`](crate::present::device).

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::fsr::{FsrGenerator, PairFacts};
use super::shader::{
    DESCRIPTORS, GuidanceTextures, ShaderGenerator, TexturePair, WORD_OF_CUT, WORD_OF_UNCOVERED, WORD_OF_UNEXPLAINED,
};
use super::{Anchor, AnchorPair, FrameGenerator, GenerateReport, Outcome, Phases};
use crate::ffx::{Api, Choice};
use crate::gpu::compute::{CommandRing, ResourceWithState};
use crate::gpu::{Gpu, Heap, Shared, read_buffer, read_texture, texture_of, written_texture};
use crate::guidance::{DepthMap, Guidance};
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
    made: Option<Made>,
}

/// Resources for one size.
struct Made {
    size: (u32, u32),
    shader: ShaderGenerator,
    fsr: Option<FsrGenerator>,
    frames: CommandRing,
    target: ID3D12Resource,
    /// The later anchor of the last pair, and its number in the provider's sequence.
    last: Option<(Picture, u64)>,
}

/// Anchors and their guidance in textures.
struct UploadedInputs {
    pictures: Vec<ID3D12Resource>,
    motion: ID3D12Resource,
    depth: ID3D12Resource,
    tiles: [u32; 2],
    depth_is_even: bool,
    previous_depth: Option<(ID3D12Resource, u32)>,
    overlay: Option<ID3D12Resource>,
}

impl DeviceGenerator {
    /// A generator with the library's shaders.
    pub fn of_shaders(gpu: &Gpu) -> Self {
        Self { gpu: gpu.clone(), amd: None, interval_ms: 1000.0 / 15.0, made: None }
    }

    /// A generator with a provider of AMD's; `interval_ms` is the time between anchors, in milliseconds of the world's time.
    pub fn of_amd(gpu: &Gpu, api: &Api, choice: Choice, interval_ms: f32) -> Self {
        Self { gpu: gpu.clone(), amd: Some((*api, choice)), interval_ms, made: None }
    }

    /// The resources for pictures of `size`, created if needed.
    fn made(&mut self, size: (u32, u32)) -> Result<&mut Made> {
        if self.made.as_ref().is_none_or(|made| made.size != size) {
            // Freed first: there may not be enough memory for both.
            self.made = None;
            let gpu = &self.gpu;
            let fsr = self.amd.map(|(api, choice)| FsrGenerator::new(gpu, &api, choice, size, size)).transpose()?;
            self.made = Some(Made {
                size,
                shader: ShaderGenerator::new(gpu, size)?,
                fsr,
                frames: CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?,
                target: written_texture(gpu, size, DXGI_FORMAT_R8G8B8A8_UNORM, STATE)?,
                last: None,
            });
        }
        self.made.as_mut().ok_or_else(|| Error::new(ErrorKind::InvalidState, "nothing was made"))
    }

    /// Uploads pictures, guidance, depth and overlay.
    fn bring(
        &self,
        pictures: &[&Picture],
        guidance: &Guidance,
        previous: Option<&DepthMap>,
        overlay: Option<&[u8]>,
    ) -> Result<UploadedInputs> {
        let size = guidance.size();
        let overlay = overlay.map(|mask| upload(&self.gpu, mask, size, DXGI_FORMAT_R8_UNORM)).transpose()?;
        let pictures = pictures.iter().map(|picture| Ok(texture_of(&self.gpu, picture)?.0)).collect::<Result<_>>()?;
        let [motion, depth] = textures_of(&self.gpu, guidance)?;
        let previous = previous.map(|map| Ok::<_, Error>((of_depth(&self.gpu, map)?, map.tile())));
        Ok(UploadedInputs {
            pictures,
            motion,
            depth,
            tiles: [guidance.motion().tile(), guidance.depth().tile()],
            depth_is_even: guidance.depth().even().is_some(),
            previous_depth: previous.transpose()?,
            overlay,
        })
    }
}

impl UploadedInputs {
    fn guidance(&self) -> GuidanceTextures<'_> {
        GuidanceTextures {
            motion: resting(&self.motion),
            motion_tile: self.tiles[0],
            depth: resting(&self.depth),
            depth_tile: self.tiles[1],
            depth_is_even: self.depth_is_even,
            hud: self.overlay.as_ref().map(resting),
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
            let why = format!("{} makes no frame at phase {t}", self.name());
            return Err(Error::new(ErrorKind::InvalidArgument, why).field("t").remedy("Use shader, or cpu"));
        }
        let brought =
            self.bring(&[pair.previous(), pair.current()], pair.guidance(), pair.previous_depth(), pair.overlay())?;
        let (gpu, interval_ms) = (self.gpu.clone(), self.interval_ms);
        let made = self.made(pair.size())?;
        let textures = TexturePair {
            previous: resting(&brought.pictures[0]),
            current: resting(&brought.pictures[1]),
            guidance: brought.guidance(),
            previous_depth: brought.previous_depth.as_ref().map(|(depth, tile)| (resting(depth), *tile)),
            cut: pair.is_cut(),
        };
        if let Some(fsr) = made.fsr.as_mut().filter(|_| !pair.is_cut()) {
            // A pair that follows the last one gets the next number; any other pair skips a number, so that the provider resets its history.
            let number = made
                .last
                .take()
                .map_or(1, |(picture, number)| number + if picture == *pair.previous() { 1 } else { 2 });
            let facts = PairFacts { place: (0, number), projection: pair.guidance().depth().projection(), interval_ms };
            let (half, fence_point) = fsr.generate(&textures, &facts)?;
            fence_point.wait()?;
            copy(&read_texture(&gpu, &half, STATE)?, out);
            made.last = Some((pair.current().clone(), number));
            return Ok(GenerateReport { outcome: Outcome::Generated, uncovered: 0.0, unexplained: 0.0 });
        }
        let mut frame = made.frames.begin()?;
        made.shader.generate(&mut frame, &textures, t, &resting(&made.target))?;
        frame.submit(gpu.frames())?.wait()?;
        made.report(&gpu, out)
    }

    fn extrapolate(&mut self, anchor: &Anchor<'_>, t: f32, out: &mut Picture) -> Result<GenerateReport> {
        super::pair::check_size(out.size(), anchor.picture().size(), "out")?;
        let brought = self.bring(&[anchor.picture()], anchor.guidance(), None, anchor.overlay())?;
        let gpu = self.gpu.clone();
        let made = self.made(anchor.picture().size())?;
        let mut frame = made.frames.begin()?;
        let (picture, target) = (resting(&brought.pictures[0]), resting(&made.target));
        made.shader.extrapolate(&mut frame, &picture, &brought.guidance(), anchor.is_after_cut(), t, &target)?;
        frame.submit(gpu.frames())?.wait()?;
        let report = made.report(&gpu, out)?;
        let is_held = t > 1.0 || anchor.is_after_cut();
        Ok(GenerateReport { outcome: if is_held { Outcome::Held } else { report.outcome }, ..report })
    }

    fn reset(&mut self) {
        if let Some(made) = &mut self.made {
            made.last = None;
        }
    }
}

impl Made {
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

fn resting(resource: &ID3D12Resource) -> ResourceWithState<'_> {
    ResourceWithState { resource, state: STATE }
}

fn copy(from: &Picture, to: &mut Picture) {
    to.pixels_mut().copy_from_slice(from.pixels());
}

/// Uploads motion and depth to textures, in the state COMMON.
pub(crate) fn textures_of(gpu: &Gpu, guidance: &Guidance) -> Result<[ID3D12Resource; 2]> {
    let motion = guidance.motion();
    let vectors = bytemuck::must_cast_slice::<[half::f16; 2], u8>(motion.vectors());
    let motion = upload(gpu, vectors, (motion.columns(), motion.rows()), DXGI_FORMAT_R16G16_FLOAT)?;
    Ok([motion, of_depth(gpu, guidance.depth())?])
}

fn of_depth(gpu: &Gpu, map: &DepthMap) -> Result<ID3D12Resource> {
    let bytes = bytemuck::must_cast_slice::<f32, u8>(map.depth());
    upload(gpu, bytes, (map.columns(), map.rows()), DXGI_FORMAT_R32_FLOAT)
}

/// A texture with these tightly packed rows.
fn upload(gpu: &Gpu, bytes: &[u8], size: (u32, u32), format: DXGI_FORMAT) -> Result<ID3D12Resource> {
    let row = bytes.len() / size.1 as usize;
    let pitch = row.next_multiple_of(D3D12_TEXTURE_DATA_PITCH_ALIGNMENT as usize);
    let mut memory = Shared::new(gpu, Heap::Upload, pitch * size.1 as usize)?;
    bytes.chunks_exact(row).enumerate().for_each(|(y, bytes)| memory.write(y * pitch, bytes));
    let to = written_texture(gpu, size, format, STATE)?;
    let rows =
        D3D12_SUBRESOURCE_FOOTPRINT { Format: format, Width: size.0, Height: size.1, Depth: 1, RowPitch: pitch as u32 };
    let rows = D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: 0, Footprint: rows };
    let mut ring = CommandRing::new(gpu, gpu.frames(), 1)?;
    let mut frame = ring.begin()?;
    let from = ResourceWithState { resource: memory.resource(), state: D3D12_RESOURCE_STATE_GENERIC_READ };
    frame.copy_rows(&from, rows, &resting(&to))?;
    frame.submit(gpu.frames())?.wait()?;
    Ok(to)
}
