//! Cache of the frames' inputs on the device: pictures, motion, depth and overlay masks.

use std::sync::{Arc, Weak};

use half::f16;
use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::super::frame::{FramePlan, FrameRequest, OverlayMask, StreamAnchor};
use super::super::motion::Extractors;
use super::inputs::{FrameInputs, OwnedGuidance, in_common_state, missing_input};
use crate::framegen::AnchorId;
use crate::framegen::densify::{DEPTH, MOTION};
use crate::framegen::shader;
use crate::gpu::compute::{CommandRecorder, CommandRing, FRAMES_IN_FLIGHT, GpuTimeStatistics, ResourceWithState};
use crate::gpu::{Gpu, Heap, MappedBuffer, writable_texture};
use crate::guidance::paper::LatentBuffer;
use crate::guidance::{Guidance, MotionOrigin, paper, picture_flow};
use crate::world::{GuidanceSource, KeptAnchor};
use crate::{Error, ErrorKind, Result};

/// Cached pictures: those of a pair, and of the anchors before and after it.
const PICTURES: usize = 4;
/// Cached pairs of motion and depth.
const PAIRS: usize = 3;
/// Descriptors per list: the generator needs the most.
const DESCRIPTORS: u32 = shader::DESCRIPTORS;
/// Tile size of uniform depth, in pixels.
const UNIFORM_DEPTH_TILE: u32 = 16;
/// Alignment of pictures in an upload heap, in bytes.
const ALIGNMENT: usize = D3D12_TEXTURE_DATA_PLACEMENT_ALIGNMENT as usize;
const PITCH: usize = D3D12_TEXTURE_DATA_PITCH_ALIGNMENT as usize;

/// Uploads or extracts missing pictures, motion and depth, on the queue for frames and in lists of its own. [`new`](Self::new) and
/// [`prepare`](Self::prepare) allocate all memory. Nothing here waits for an anchor: one that has not arrived is never shown.
pub(super) struct ResourceCache {
    gpu: Gpu,
    size: (u32, u32),
    ring: CommandRing,
    /// Upload memory of each slot of the ring.
    staging: [MappedBuffer; FRAMES_IN_FLIGHT],
    pictures: Vec<PictureTexture>,
    pairs: Vec<PairTextures>,
    /// The static overlay mask.
    overlay: OverlayTexture,
    /// Number of uploads of overlay masks.
    overlay_version: u64,
    extractors: Extractors,
    /// Result buffer of the extractors on the CPU.
    extracted: Option<Guidance>,
    /// The paper's extractor, and the shape of the latents that it was made for.
    latent_extractor: Option<(paper::GpuExtractor, [u32; 3])>,
    picture_extractor: Option<picture_flow::GpuExtractor>,
    /// Number of requests: the time stamp of the least-recently-used order.
    clock: u64,
}

/// Cached copy of an anchor's picture that was not made on the device.
struct PictureTexture {
    /// The anchor, and the number of its picture.
    key: Option<(Weak<KeptAnchor>, usize)>,
    texture: ID3D12Resource,
    /// Time of the last use, in requests.
    used: u64,
}

/// The static overlay mask, at the size at which frames are generated.
struct OverlayTexture {
    key: Option<Weak<OverlayMask>>,
    texture: ID3D12Resource,
    size: (u32, u32),
}

/// Motion and depth of a pair.
struct PairTextures {
    key: Option<GuidanceKey>,
    /// The textures in use, of those below.
    textures: OwnedGuidance,
    /// One texture per tile size of [`TILES`], since the guidance's tile size is not known in advance.
    motion: Vec<ID3D12Resource>,
    /// As `motion`.
    depth: Vec<ID3D12Resource>,
    /// Time of the last use, in requests.
    used: u64,
}

/// Tile sizes of guidance, in pixels.
const TILES: [u32; 3] = [1, 8, 16];

/// Cache key of motion and depth.
#[derive(Clone)]
enum GuidanceKey {
    /// The guidance that was pushed with an anchor.
    Pushed(Weak<Guidance>),
    /// The later anchor of the pair that guidance was extracted from.
    Extracted(AnchorId),
}

/// Data to copy into a texture: tightly packed rows.
struct Upload<'a> {
    bytes: &'a [u8],
    size: (u32, u32),
    format: DXGI_FORMAT,
    to: ID3D12Resource,
}

impl ResourceCache {
    pub(super) fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let format = DXGI_FORMAT_R8G8B8A8_UNORM;
        let state = D3D12_RESOURCE_STATE_COMMON;
        let picture =
            || Ok(PictureTexture { key: None, texture: writable_texture(gpu, size, format, state)?, used: 0 });
        let staging = || MappedBuffer::new(gpu, Heap::Upload, max_upload_bytes(size));
        let staging: Vec<_> = (0..FRAMES_IN_FLIGHT).map(|_| staging()).collect::<Result<_>>()?;
        Ok(Self {
            gpu: gpu.clone(),
            size,
            ring: CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?,
            staging: staging.try_into().map_err(|_| missing_input())?,
            pictures: (0..PICTURES).map(|_| picture()).collect::<Result<_>>()?,
            pairs: (0..PAIRS).map(|_| PairTextures::new(gpu, size)).collect::<Result<_>>()?,
            overlay: OverlayTexture::new(gpu, size)?,
            overlay_version: 0,
            extractors: Extractors::default(),
            extracted: None,
            latent_extractor: None,
            picture_extractor: None,
            clock: 0,
        })
    }

    /// Creates the extractor for `source`. `latent` is the latents' shape `[channels, height, width]`, all 0 if it is unknown.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`, or `Device` when the driver refuses a shader.
    pub(super) fn prepare(&mut self, source: GuidanceSource, latent: [u32; 3]) -> Result<()> {
        match source {
            GuidanceSource::PictureFlow if self.picture_extractor.is_none() => {
                match picture_flow::GpuExtractor::new(&self.gpu, self.size) {
                    Ok(made) => self.picture_extractor = Some(made),
                    // The extractor on the CPU takes over.
                    Err(error) if error.kind() == ErrorKind::Unsupported => {}
                    Err(error) => return Err(error),
                }
            }
            GuidanceSource::Paper
                if latent != [0; 3] && self.latent_extractor.as_ref().is_none_or(|(_, of)| *of != latent) =>
            {
                let made = paper::GpuExtractor::new(&self.gpu, latent.map(|n| n as usize), false)?;
                self.latent_extractor = Some((made, latent));
            }
            _ => {}
        }
        if self.picture_extractor.is_none() && self.extracted.is_none() {
            self.extracted = Some(Guidance::new(self.size.0, self.size.1, paper::PROJECTION)?);
        }
        Ok(())
    }

    /// Returns the inputs of a frame. For a plain copy of an anchor, guidance that leads to it is included only if `with_guidance` is set and there
    /// is any.
    ///
    /// # Errors
    /// `InvalidArgument` if latents are needed and the anchors have none; `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn inputs(&mut self, request: &FrameRequest, with_guidance: bool) -> Result<FrameInputs> {
        let FrameRequest { plan, overlay, motion, .. } = request;
        self.clock += 1;
        let (previous, current, id) = match plan {
            FramePlan::Copy { previous, current, id, picture } => {
                let has_guidance = !current.cut && (current.guidance.is_some() || previous.is_some());
                let guidance = match with_guidance && has_guidance {
                    true => Some(self.guidance(*motion, previous.as_ref(), current, *id)?),
                    false => None,
                };
                let current = self.picture(&current.anchor, *picture)?;
                return Ok(FrameInputs {
                    previous: None,
                    current,
                    guidance,
                    original_guidance: None,
                    previous_depth: None,
                    overlay: None,
                });
            }
            FramePlan::Interpolate { previous, current, id, .. } => (Some(previous), current, *id),
            FramePlan::Extrapolate { previous, last, id, .. } => (previous.as_ref(), last, *id),
        };
        let guidance = self.guidance(*motion, previous, current, id)?;
        let overlay = overlay.as_ref().map(|overlay| self.overlay(overlay)).transpose()?;
        let last_picture = |of: &StreamAnchor| of.anchor.count() - 1;
        let picture = self.picture(&current.anchor, last_picture(current))?;
        let mut inputs = FrameInputs {
            previous: None,
            current: picture,
            guidance: Some(guidance),
            original_guidance: None,
            previous_depth: None,
            overlay,
        };
        if let (FramePlan::Interpolate { .. }, Some(previous)) = (plan, previous) {
            inputs.previous = Some(self.picture(&previous.anchor, last_picture(previous))?);
            if let Some(pushed) = &previous.guidance {
                let textures = self.pushed_guidance(pushed)?;
                inputs.previous_depth = Some((textures.depth, textures.depth_tile));
            }
        }
        Ok(inputs)
    }

    /// Version of the overlay mask: it changes with each upload.
    pub(super) fn overlay_version(&self) -> u64 {
        self.overlay_version
    }

    /// Motion and depth from the anchor `current`, whose identity is `id`, back to the one before.
    fn guidance(
        &mut self,
        motion: GuidanceSource,
        previous: Option<&StreamAnchor>,
        current: &StreamAnchor,
        id: AnchorId,
    ) -> Result<OwnedGuidance> {
        match &current.guidance {
            Some(pushed) => self.pushed_guidance(pushed),
            None => {
                let previous = &previous.ok_or_else(missing_input)?.anchor;
                self.extracted_guidance(motion, previous, &current.anchor, id)
            }
        }
    }

    /// Sets the size at which frames are generated.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn set_generation_size(&mut self, size: (u32, u32)) -> Result<()> {
        if self.overlay.size != size {
            let bytes = max_upload_bytes(self.size).max(overlay_bytes(size));
            for staging in self.staging.iter_mut().filter(|staging| staging.len() < bytes) {
                *staging = MappedBuffer::new(&self.gpu, Heap::Upload, bytes)?;
            }
            self.overlay = OverlayTexture::new(&self.gpu, size)?;
        }
        Ok(())
    }

    /// Begins a list of this ring for other preparatory work.
    pub(super) fn begin(&mut self) -> Result<CommandRecorder<'_>> {
        self.ring.begin()
    }

    /// Device time of the lists that have run.
    pub(super) fn gpu_time(&mut self) -> GpuTimeStatistics {
        self.ring.gpu_time()
    }

    /// A picture of an anchor: its own texture if it was made on this device, else a cached copy.
    fn picture(&mut self, anchor: &Arc<KeptAnchor>, picture: usize) -> Result<ID3D12Resource> {
        let made_here = anchor.texture(picture).filter(|(texture, _)| self.gpu.owns(*texture, "").is_ok());
        if let Some((texture, _)) = made_here {
            return Ok(texture.clone());
        }
        let matches = |cached: &PictureTexture| {
            cached.key.as_ref().is_some_and(|(of, number)| of.as_ptr() == Arc::as_ptr(anchor) && *number == picture)
        };
        let at = match self.pictures.iter().position(matches) {
            Some(at) => {
                self.pictures[at].used = self.clock;
                return Ok(self.pictures[at].texture.clone());
            }
            None => oldest(self.pictures.iter().map(|cached| cached.used)),
        };
        let pixels = anchor.read(picture)?;
        let to = self.pictures[at].texture.clone();
        self.pictures[at].key = None;
        let upload =
            Upload { bytes: pixels.rgba(), size: self.size, format: DXGI_FORMAT_R8G8B8A8_UNORM, to: to.clone() };
        self.submit(&[upload])?;
        let cached = &mut self.pictures[at];
        (cached.key, cached.used) = (Some((Arc::downgrade(anchor), picture)), self.clock);
        Ok(to)
    }

    /// The static overlay mask, uploaded once.
    fn overlay(&mut self, overlay: &Arc<OverlayMask>) -> Result<ID3D12Resource> {
        let OverlayTexture { key, texture, size } = &mut self.overlay;
        if key.as_ref().is_some_and(|key| key.as_ptr() == Arc::as_ptr(overlay)) {
            return Ok(texture.clone());
        }
        *key = None;
        let (to, size) = (texture.clone(), *size);
        let resized = (size != overlay.size).then(|| overlay.resized(size));
        let bytes = resized.as_deref().unwrap_or(&overlay.mask);
        self.submit(&[Upload { bytes, size, format: DXGI_FORMAT_R8_UNORM, to: to.clone() }])?;
        self.overlay_version += 1;
        self.overlay.key = Some(Arc::downgrade(overlay));
        Ok(to)
    }

    /// Guidance that was pushed with an anchor.
    fn pushed_guidance(&mut self, pushed: &Arc<Guidance>) -> Result<OwnedGuidance> {
        let matches = |key: &GuidanceKey| matches!(key, GuidanceKey::Pushed(of) if of.as_ptr() == Arc::as_ptr(pushed));
        match self.cached_pair(matches) {
            Ok(cached) => Ok(cached),
            Err(at) => self.upload_pair(at, pushed, GuidanceKey::Pushed(Arc::downgrade(pushed))),
        }
    }

    /// Extracted motion and depth of a pair without guidance: on the device if possible, else on the CPU.
    fn extracted_guidance(
        &mut self,
        source: GuidanceSource,
        previous: &Arc<KeptAnchor>,
        current: &Arc<KeptAnchor>,
        id: AnchorId,
    ) -> Result<OwnedGuidance> {
        let matches = |key: &GuidanceKey| matches!(key, GuidanceKey::Extracted(other) if *other == id);
        let at = match self.cached_pair(matches) {
            Ok(cached) => return Ok(cached),
            Err(at) => at,
        };
        let key = GuidanceKey::Extracted(id);
        let is_extracted = match source {
            GuidanceSource::PictureFlow => self.extract_from_pictures(at, previous, current)?,
            GuidanceSource::Paper => self.extract_from_latents(at, previous, current)?,
            // A few cells: the CPU is done before a list would be.
            GuidanceSource::LatentFlow => false,
        };
        if is_extracted {
            let pair = &mut self.pairs[at];
            (pair.key, pair.used) = (Some(key), self.clock);
            return Ok(pair.textures.clone());
        }
        let mut extracted = match self.extracted.take() {
            Some(extracted) => extracted,
            None => Guidance::new(self.size.0, self.size.1, paper::PROJECTION)?,
        };
        self.extractors.fill(source, previous, current, &mut extracted)?;
        let uploaded = self.upload_pair(at, &extracted, key);
        self.extracted = Some(extracted);
        uploaded
    }

    /// Extracts optical flow on the device; `false` if the pictures are too large for it.
    fn extract_from_pictures(
        &mut self,
        at: usize,
        previous: &Arc<KeptAnchor>,
        current: &Arc<KeptAnchor>,
    ) -> Result<bool> {
        if self.picture_extractor.is_none() {
            return Ok(false);
        }
        let previous = self.picture(previous, previous.count() - 1)?;
        let current = self.picture(current, current.count() - 1)?;
        let pair = &mut self.pairs[at];
        pair.key = None;
        pair.select([1, UNIFORM_DEPTH_TILE], MotionOrigin::OpticalFlow)?;
        let textures = pair.textures.clone();
        let mut frame = self.ring.begin()?;
        frame.begin_event(c"Cairn: motion from pictures");
        let (motion, depth) = (in_common_state(&textures.motion), in_common_state(&textures.depth));
        let Some(extractor) = &self.picture_extractor else { return Ok(false) };
        extractor.record(&mut frame, &in_common_state(&previous), &in_common_state(&current), &motion, &depth)?;
        frame.end_event();
        frame.submit(self.gpu.frames())?;
        Ok(true)
    }

    /// Runs the paper's extractor on the device; `false` if it is not prepared for the latents or they are not on this device.
    fn extract_from_latents(&mut self, at: usize, previous: &KeptAnchor, current: &KeptAnchor) -> Result<bool> {
        let (Some(z0), Some(z1)) = (previous.latent_buffer(), current.latent_buffer()) else { return Ok(false) };
        let here = [z0.0, z1.0].iter().all(|buffer| self.gpu.owns(*buffer, "").is_ok());
        let (shape, half) = (current.latent_shape(), z1.2);
        if !here || previous.latent_shape() != shape || z0.2 != half {
            return Ok(false);
        }
        if self.latent_extractor.as_ref().is_none_or(|(_, of)| *of != shape) {
            return Ok(false);
        }
        let pair = &mut self.pairs[at];
        pair.key = None;
        pair.select([1, 1], MotionOrigin::LatentGradient)?;
        let textures = pair.textures.clone();
        let mut frame = self.ring.begin()?;
        frame.begin_event(c"Cairn: motion from latents");
        let latent = |buffer| LatentBuffer { buffer: in_common_state(buffer), first: 0 };
        let (motion, depth) = (in_common_state(&textures.motion), in_common_state(&textures.depth));
        let Some((extractor, _)) = &mut self.latent_extractor else { return Ok(false) };
        extractor.set_half_precision(half);
        extractor.record(&mut frame, &latent(z0.0), &latent(z1.0), &motion, &depth)?;
        frame.end_event();
        frame.submit(self.gpu.frames())?;
        Ok(true)
    }

    /// The cached textures of a pair, or else the index of the entry to replace.
    fn cached_pair(&mut self, matches: impl Fn(&GuidanceKey) -> bool) -> std::result::Result<OwnedGuidance, usize> {
        let at = self.pairs.iter().position(|pair| pair.key.as_ref().is_some_and(&matches));
        let at = at.ok_or_else(|| oldest(self.pairs.iter().map(|pair| pair.used)))?;
        self.pairs[at].used = self.clock;
        Ok(self.pairs[at].textures.clone())
    }

    fn upload_pair(&mut self, at: usize, guidance: &Guidance, key: GuidanceKey) -> Result<OwnedGuidance> {
        let (motion, depth) = (guidance.motion(), guidance.depth());
        let pair = &mut self.pairs[at];
        pair.key = None;
        pair.select([motion.tile(), depth.tile()], guidance.origin())?;
        let textures = pair.textures.clone();
        let uploads = [
            Upload {
                bytes: bytemuck::must_cast_slice::<[f16; 2], u8>(motion.vectors()),
                size: (motion.columns(), motion.rows()),
                format: MOTION,
                to: textures.motion.clone(),
            },
            Upload {
                bytes: bytemuck::must_cast_slice::<f32, u8>(depth.depth()),
                size: (depth.columns(), depth.rows()),
                format: DEPTH,
                to: textures.depth.clone(),
            },
        ];
        self.submit(&uploads)?;
        let pair = &mut self.pairs[at];
        (pair.key, pair.used) = (Some(key), self.clock);
        Ok(textures)
    }

    /// Submits a list with these copies.
    fn submit(&mut self, uploads: &[Upload<'_>]) -> Result<()> {
        let slot = self.ring.next_slot();
        let mut frame = self.ring.begin()?;
        let memory = &mut self.staging[slot];
        frame.begin_event(c"Cairn: an anchor from memory");
        let mut at = 0;
        for upload in uploads {
            upload.record(&mut frame, memory, at)?;
            at += upload.bytes_in_memory();
        }
        frame.end_event();
        frame.submit(self.gpu.frames())?;
        Ok(())
    }
}

impl PairTextures {
    fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let textures = |format| {
            let tiled = |tile: u32| (size.0.div_ceil(tile), size.1.div_ceil(tile));
            let texture = |tile| writable_texture(gpu, tiled(tile), format, D3D12_RESOURCE_STATE_COMMON);
            TILES.into_iter().map(texture).collect::<Result<Vec<_>>>()
        };
        let (motion, depth) = (textures(MOTION)?, textures(DEPTH)?);
        let [motion_tile, depth_tile] = [TILES[0]; 2];
        let first = [&motion, &depth].map(|textures| textures[0].clone());
        let [first_motion, first_depth] = first;
        let textures = OwnedGuidance {
            motion: first_motion,
            motion_tile,
            depth: first_depth,
            depth_tile,
            motion_origin: MotionOrigin::default(),
        };
        Ok(Self { key: None, textures, motion, depth, used: 0 })
    }

    /// Selects the textures for these tile sizes of motion and depth, for motion of this origin.
    fn select(&mut self, [motion_tile, depth_tile]: [u32; 2], motion_origin: MotionOrigin) -> Result<()> {
        let index = |tile| TILES.iter().position(|known| *known == tile).ok_or_else(|| no_tile(tile));
        let motion = self.motion[index(motion_tile)?].clone();
        let depth = self.depth[index(depth_tile)?].clone();
        self.textures = OwnedGuidance { motion, motion_tile, depth, depth_tile, motion_origin };
        Ok(())
    }
}

impl OverlayTexture {
    fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let texture = writable_texture(gpu, size, DXGI_FORMAT_R8_UNORM, D3D12_RESOURCE_STATE_COMMON)?;
        Ok(Self { key: None, texture, size })
    }
}

/// Bytes of the largest upload for anchors of that size: a picture, motion and depth per pixel, or an overlay mask.
fn max_upload_bytes(size: (u32, u32)) -> usize {
    let [picture, mask] = [4, 1].map(|pixel| bytes_of(size, pixel));
    // Motion and depth have four bytes per pixel each.
    (2 * picture).max(mask)
}

fn overlay_bytes(size: (u32, u32)) -> usize {
    bytes_of(size, 1)
}

/// Bytes of a picture in an upload heap.
fn bytes_of(size: (u32, u32), pixel: usize) -> usize {
    ((size.0 as usize * pixel).next_multiple_of(PITCH) * size.1 as usize).next_multiple_of(ALIGNMENT)
}

impl Upload<'_> {
    fn row(&self) -> usize {
        self.bytes.len() / self.size.1 as usize
    }

    fn bytes_in_memory(&self) -> usize {
        (self.row().next_multiple_of(PITCH) * self.size.1 as usize).next_multiple_of(ALIGNMENT)
    }

    /// Writes the rows to byte `at` of `memory` and records the copy from there.
    fn record(&self, frame: &mut CommandRecorder<'_>, memory: &mut MappedBuffer, at: usize) -> Result<()> {
        let pitch = self.row().next_multiple_of(PITCH);
        for (y, row) in self.bytes.chunks_exact(self.row()).enumerate() {
            memory.write(at + y * pitch, row);
        }
        let rows = D3D12_SUBRESOURCE_FOOTPRINT {
            Format: self.format,
            Width: self.size.0,
            Height: self.size.1,
            Depth: 1,
            RowPitch: u32::try_from(pitch).map_err(|_| too_wide(pitch))?,
        };
        let rows = D3D12_PLACED_SUBRESOURCE_FOOTPRINT { Offset: at as u64, Footprint: rows };
        let from = ResourceWithState { resource: memory.resource(), state: D3D12_RESOURCE_STATE_GENERIC_READ };
        frame.copy_rows(&from, rows, &in_common_state(&self.to))
    }
}

/// Index of the least recently used entry.
fn oldest(used: impl Iterator<Item = u64>) -> usize {
    used.enumerate().min_by_key(|(_, used)| *used).map_or(0, |(at, _)| at)
}

fn no_tile(tile: u32) -> Error {
    Error::new(ErrorKind::InvalidArgument, format!("guidance in tiles of {tile} pixels")).field("guidance")
}

fn too_wide(pitch: usize) -> Error {
    Error::new(ErrorKind::InvalidArgument, format!("a row of {pitch} bytes cannot be copied"))
}
