//! Cache of the frames' inputs on the device: pictures, motion, depth and overlay masks.

use std::sync::{Arc, Weak};

use half::f16;
use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::super::motion::{Extractors, MotionSource};
use super::super::presenter::{Overlay, PendingFrame, Plan, Slot};
use super::{nothing_brought, resting};
use crate::framegen::shader::{self, GuidanceTextures};
use crate::gpu::compute::{CommandRecorder, CommandRing, FRAMES_IN_FLIGHT, ResourceWithState, Spent};
use crate::gpu::{Gpu, Heap, Shared, written_texture};
use crate::guidance::paper::LatentBuffer;
use crate::guidance::{Guidance, paper, picture_flow};
use crate::world::KeptAnchor;
use crate::{Error, ErrorKind, Result};

/// Cached pictures: those of a pair, and of the anchors before and after it.
const PICTURES: usize = 4;
/// Cached pairs of motion and depth.
const PAIRS: usize = 3;
/// Descriptors per list: the generator needs the most.
const DESCRIPTORS: u32 = shader::DESCRIPTORS;
/// Tile size in pixels of constant depth.
const EVEN: u32 = 16;
/// Alignment of pictures in an upload heap, in bytes.
const ALIGNMENT: usize = D3D12_TEXTURE_DATA_PLACEMENT_ALIGNMENT as usize;
const PITCH: usize = D3D12_TEXTURE_DATA_PITCH_ALIGNMENT as usize;

/// Uploads or extracts missing pictures, motion and depth, on the queue for frames and in lists of its own. [`new`](Self::new) and
/// [`prepare`](Self::prepare) allocate all memory. Nothing here waits for an anchor: one that has not arrived is never shown.
pub(super) struct ResourceCache {
    gpu: Gpu,
    size: (u32, u32),
    ring: CommandRing,
    /// What lists of the ring copy from, by their places in it.
    staging: [Shared; FRAMES_IN_FLIGHT],
    pictures: Vec<PictureTexture>,
    pairs: Vec<PairTextures>,
    /// The static overlay mask.
    overlay: OverlayTexture,
    /// Version of the overlay mask: counts uploads.
    pub(super) overlays: u64,
    extractors: Extractors,
    /// Result buffer of the extractors on the CPU.
    found: Option<Guidance>,
    /// The paper's extractor, and the latent shape that it was made for.
    from_latents: Option<(paper::GpuExtractor, [u32; 3])>,
    from_pictures: Option<picture_flow::GpuExtractor>,
    /// Number of requests: the time stamp of the least-recently-used order.
    clock: u64,
}

/// Cached copy of an anchor's picture that was not made on the device.
struct PictureTexture {
    of: Option<(Weak<KeptAnchor>, usize)>,
    texture: ID3D12Resource,
    used: u64,
}

/// The static overlay mask, at the size at which frames are generated.
struct OverlayTexture {
    of: Option<Weak<Overlay>>,
    texture: ID3D12Resource,
    size: (u32, u32),
}

/// Motion and depth of a pair.
struct PairTextures {
    of: Option<Pair>,
    textures: Textures,
    /// One texture per tile size of [`TILES`], since the guidance's tile size is not known in advance.
    motion: Vec<ID3D12Resource>,
    depth: Vec<ID3D12Resource>,
    used: u64,
}

/// Tile sizes of guidance, in pixels.
const TILES: [u32; 3] = [1, 8, 16];

/// Cache key of motion and depth: the guidance that came with an anchor, or epoch and anchor index of extracted guidance.
#[derive(Clone)]
enum Pair {
    Given(Weak<Guidance>),
    Found(u64, u64),
}

#[derive(Clone)]
pub(super) struct Textures {
    pub(super) motion: ID3D12Resource,
    pub(super) motion_tile: u32,
    pub(super) depth: ID3D12Resource,
    pub(super) depth_tile: u32,
    /// Whether depth is known to be the same everywhere.
    pub(super) depth_is_even: bool,
}

/// Inputs of a frame. All textures are in the state COMMON between lists.
pub(super) struct FrameInputs {
    pub(super) previous: Option<ID3D12Resource>,
    /// The later anchor of a pair, the last anchor, or the picture to copy.
    pub(super) current: ID3D12Resource,
    pub(super) guidance: Option<Textures>,
    /// Guidance at the anchors' original resolution; set only if the anchors were upscaled.
    pub(super) rendered: Option<Textures>,
    pub(super) previous_depth: Option<(ID3D12Resource, u32)>,
    /// The static overlay mask.
    pub(super) overlay: Option<ID3D12Resource>,
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
        let picture = || Ok(PictureTexture { of: None, texture: written_texture(gpu, size, format, state)?, used: 0 });
        let staging = || Shared::new(gpu, Heap::Upload, most_bytes(size));
        let staging: Vec<_> = (0..FRAMES_IN_FLIGHT).map(|_| staging()).collect::<Result<_>>()?;
        Ok(Self {
            gpu: gpu.clone(),
            size,
            ring: CommandRing::new(gpu, gpu.frames(), DESCRIPTORS)?,
            staging: staging.try_into().map_err(|_| nothing_brought())?,
            pictures: (0..PICTURES).map(|_| picture()).collect::<Result<_>>()?,
            pairs: (0..PAIRS).map(|_| PairTextures::new(gpu, size)).collect::<Result<_>>()?,
            overlay: OverlayTexture::new(gpu, size)?,
            overlays: 0,
            extractors: Extractors::default(),
            found: None,
            from_latents: None,
            from_pictures: None,
            clock: 0,
        })
    }

    /// Creates the extractor for `source`. `latent` is the latents' shape `[channels, height, width]`, all 0 if it is unknown.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`, or `Device` when the driver refuses a shader.
    pub(super) fn prepare(&mut self, source: MotionSource, latent: [u32; 3]) -> Result<()> {
        match source {
            MotionSource::PictureFlow if self.from_pictures.is_none() => {
                match picture_flow::GpuExtractor::new(&self.gpu, self.size) {
                    Ok(made) => self.from_pictures = Some(made),
                    // The extractor on the CPU takes over.
                    Err(why) if why.kind() == ErrorKind::Unsupported => {}
                    Err(why) => return Err(why),
                }
            }
            MotionSource::Paper
                if latent != [0; 3] && self.from_latents.as_ref().is_none_or(|(_, of)| *of != latent) =>
            {
                let made = paper::GpuExtractor::new(&self.gpu, latent.map(|n| n as usize), false)?;
                self.from_latents = Some((made, latent));
            }
            _ => {}
        }
        if self.from_pictures.is_none() && self.found.is_none() {
            self.found = Some(Guidance::new(self.size.0, self.size.1, paper::PROJECTION)?);
        }
        Ok(())
    }

    /// Returns the inputs of a frame; `motion` selects the extractor for anchors without guidance. For a plain copy of an anchor, guidance that
    /// leads to it is included only if `also_leads` is set and there is any.
    pub(super) fn bring(
        &mut self,
        PendingFrame { plan, epoch, overlay, .. }: &PendingFrame,
        motion: MotionSource,
        also_leads: bool,
    ) -> Result<FrameInputs> {
        self.clock += 1;
        let (previous, current, index) = match plan {
            Plan::Copy { previous, current, index, picture } => {
                let leads = also_leads && !current.cut && (current.guidance.is_some() || previous.is_some());
                let guidance = match leads {
                    true => Some(self.bring_guidance(motion, previous.as_ref(), current, (*epoch, *index))?),
                    false => None,
                };
                let current = self.bring_picture(&current.anchor, *picture)?;
                return Ok(FrameInputs {
                    previous: None,
                    current,
                    guidance,
                    rendered: None,
                    previous_depth: None,
                    overlay: None,
                });
            }
            Plan::Interpolate { previous, current, index, .. } => (Some(previous), current, *index),
            Plan::Extrapolate { previous, last, index, .. } => (previous.as_ref(), last, *index),
        };
        let guidance = self.bring_guidance(motion, previous, current, (*epoch, index))?;
        let overlay = overlay.as_ref().map(|overlay| self.bring_overlay(overlay)).transpose()?;
        let last = |slot: &Slot| slot.anchor.count() - 1;
        let picture = self.bring_picture(&current.anchor, last(current))?;
        let mut inputs = FrameInputs {
            previous: None,
            current: picture,
            guidance: Some(guidance),
            rendered: None,
            previous_depth: None,
            overlay,
        };
        if let (Plan::Interpolate { .. }, Some(previous)) = (plan, previous) {
            inputs.previous = Some(self.bring_picture(&previous.anchor, last(previous))?);
            if let Some(given) = &previous.guidance {
                let textures = self.bring_given(given)?;
                inputs.previous_depth = Some((textures.depth, textures.depth_tile));
            }
        }
        Ok(inputs)
    }

    /// Motion and depth from an anchor back to the one before.
    fn bring_guidance(
        &mut self,
        motion: MotionSource,
        previous: Option<&Slot>,
        current: &Slot,
        key: (u64, u64),
    ) -> Result<Textures> {
        match &current.guidance {
            Some(given) => self.bring_given(given),
            None => {
                let previous = &previous.ok_or_else(nothing_brought)?.anchor;
                self.bring_found(motion, previous, &current.anchor, key)
            }
        }
    }

    /// Sets the size at which frames are generated.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn work_at(&mut self, size: (u32, u32)) -> Result<()> {
        if self.overlay.size != size {
            let bytes = most_bytes(self.size).max(overlay_bytes(size));
            for staging in self.staging.iter_mut().filter(|staging| staging.len() < bytes) {
                *staging = Shared::new(&self.gpu, Heap::Upload, bytes)?;
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
    pub(super) fn spent(&mut self) -> Spent {
        self.ring.spent()
    }

    /// A picture of an anchor: its own texture if it was made on this device, else a cached copy.
    fn bring_picture(&mut self, anchor: &Arc<KeptAnchor>, picture: usize) -> Result<ID3D12Resource> {
        let made_here = anchor.texture(picture).filter(|(texture, _)| self.gpu.owns(*texture, "").is_ok());
        if let Some((texture, _)) = made_here {
            return Ok(texture.clone());
        }
        let is = |kept: &PictureTexture| {
            kept.of.as_ref().is_some_and(|(of, i)| of.as_ptr() == Arc::as_ptr(anchor) && *i == picture)
        };
        let at = match self.pictures.iter().position(is) {
            Some(at) => {
                self.pictures[at].used = self.clock;
                return Ok(self.pictures[at].texture.clone());
            }
            None => oldest(self.pictures.iter().map(|kept| kept.used)),
        };
        let found = anchor.read(picture)?;
        let to = self.pictures[at].texture.clone();
        self.pictures[at].of = None;
        let upload =
            Upload { bytes: found.rgba(), size: self.size, format: DXGI_FORMAT_R8G8B8A8_UNORM, to: to.clone() };
        self.submit(&[upload])?;
        let kept = &mut self.pictures[at];
        (kept.of, kept.used) = (Some((Arc::downgrade(anchor), picture)), self.clock);
        Ok(to)
    }

    /// The static overlay mask, uploaded once.
    fn bring_overlay(&mut self, overlay: &Arc<Overlay>) -> Result<ID3D12Resource> {
        let OverlayTexture { of, texture, size } = &mut self.overlay;
        if of.as_ref().is_some_and(|of| of.as_ptr() == Arc::as_ptr(overlay)) {
            return Ok(texture.clone());
        }
        *of = None;
        let (to, size) = (texture.clone(), *size);
        let larger = (size != overlay.size).then(|| overlay.at(size));
        let bytes = larger.as_deref().unwrap_or(&overlay.mask);
        self.submit(&[Upload { bytes, size, format: DXGI_FORMAT_R8_UNORM, to: to.clone() }])?;
        self.overlays += 1;
        self.overlay.of = Some(Arc::downgrade(overlay));
        Ok(to)
    }

    /// Guidance that came with an anchor.
    fn bring_given(&mut self, given: &Arc<Guidance>) -> Result<Textures> {
        let is = |of: &Pair| matches!(of, Pair::Given(of) if of.as_ptr() == Arc::as_ptr(given));
        match self.pair(is) {
            Ok(there) => Ok(there),
            Err(at) => self.upload_pair(at, given, Pair::Given(Arc::downgrade(given))),
        }
    }

    /// Extracted motion and depth of a pair without guidance: on the device where possible, else on the CPU.
    fn bring_found(
        &mut self,
        source: MotionSource,
        previous: &Arc<KeptAnchor>,
        current: &Arc<KeptAnchor>,
        (epoch, index): (u64, u64),
    ) -> Result<Textures> {
        let is = |of: &Pair| matches!(of, Pair::Found(e, i) if (*e, *i) == (epoch, index));
        let at = match self.pair(is) {
            Ok(there) => return Ok(there),
            Err(at) => at,
        };
        let key = Pair::Found(epoch, index);
        let is_found = match source {
            MotionSource::PictureFlow => self.find_from_pictures(at, previous, current)?,
            MotionSource::Paper => self.find_from_latents(at, previous, current)?,
            // A few cells: the CPU is done before a list would be.
            MotionSource::LatentFlow => false,
        };
        if is_found {
            let kept = &mut self.pairs[at];
            (kept.of, kept.used) = (Some(key), self.clock);
            return Ok(kept.textures.clone());
        }
        let mut found = match self.found.take() {
            Some(found) => found,
            None => Guidance::new(self.size.0, self.size.1, paper::PROJECTION)?,
        };
        self.extractors.fill(source, previous, current, &mut found)?;
        let brought = self.upload_pair(at, &found, key);
        self.found = Some(found);
        brought
    }

    /// Extracts optical flow on the device; `false` if the pictures are too large for it.
    fn find_from_pictures(&mut self, at: usize, previous: &Arc<KeptAnchor>, current: &Arc<KeptAnchor>) -> Result<bool> {
        if self.from_pictures.is_none() {
            return Ok(false);
        }
        let previous = self.bring_picture(previous, previous.count() - 1)?;
        let current = self.bring_picture(current, current.count() - 1)?;
        let kept = &mut self.pairs[at];
        kept.of = None;
        kept.choose([1, EVEN], true)?;
        let textures = kept.textures.clone();
        let mut frame = self.ring.begin()?;
        frame.stage(c"Cairn: motion from pictures");
        let (motion, depth) = (resting(&textures.motion), resting(&textures.depth));
        let Some(extractor) = &self.from_pictures else { return Ok(false) };
        extractor.record(&mut frame, &resting(&previous), &resting(&current), &motion, &depth)?;
        frame.end_stage();
        frame.submit(self.gpu.frames())?;
        Ok(true)
    }

    /// Runs the paper's extractor on the device; `false` if it is not prepared for the latents or they are not on this device.
    fn find_from_latents(&mut self, at: usize, previous: &KeptAnchor, current: &KeptAnchor) -> Result<bool> {
        let (Some(z0), Some(z1)) = (previous.latent_buffer(), current.latent_buffer()) else { return Ok(false) };
        let here = [z0.0, z1.0].iter().all(|buffer| self.gpu.owns(*buffer, "").is_ok());
        let (shape, half) = (current.latent_shape(), z1.2);
        if !here || previous.latent_shape() != shape || z0.2 != half {
            return Ok(false);
        }
        if self.from_latents.as_ref().is_none_or(|(_, of)| *of != shape) {
            return Ok(false);
        }
        let kept = &mut self.pairs[at];
        kept.of = None;
        kept.choose([1, 1], false)?;
        let textures = kept.textures.clone();
        let mut frame = self.ring.begin()?;
        frame.stage(c"Cairn: motion from latents");
        let latent = |buffer| LatentBuffer { buffer: resting(buffer), first: 0 };
        let (motion, depth) = (resting(&textures.motion), resting(&textures.depth));
        let Some((extractor, _)) = &mut self.from_latents else { return Ok(false) };
        extractor.reads_halves(half);
        extractor.record(&mut frame, &latent(z0.0), &latent(z1.0), &motion, &depth)?;
        frame.end_stage();
        frame.submit(self.gpu.frames())?;
        Ok(true)
    }

    /// The cached textures of a pair, or else the index of the entry to replace.
    fn pair(&mut self, is: impl Fn(&Pair) -> bool) -> std::result::Result<Textures, usize> {
        let at = self.pairs.iter().position(|kept| kept.of.as_ref().is_some_and(&is));
        let at = at.ok_or_else(|| oldest(self.pairs.iter().map(|kept| kept.used)))?;
        self.pairs[at].used = self.clock;
        Ok(self.pairs[at].textures.clone())
    }

    fn upload_pair(&mut self, at: usize, guidance: &Guidance, key: Pair) -> Result<Textures> {
        let (motion, depth) = (guidance.motion(), guidance.depth());
        let kept = &mut self.pairs[at];
        kept.of = None;
        kept.choose([motion.tile(), depth.tile()], depth.even().is_some())?;
        let textures = kept.textures.clone();
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
        let kept = &mut self.pairs[at];
        (kept.of, kept.used) = (Some(key), self.clock);
        Ok(textures)
    }

    /// Submits a list with these copies.
    fn submit(&mut self, uploads: &[Upload<'_>]) -> Result<()> {
        let slot = self.ring.place();
        let mut frame = self.ring.begin()?;
        let memory = &mut self.staging[slot];
        frame.stage(c"Cairn: an anchor from memory");
        let mut at = 0;
        for upload in uploads {
            upload.record(&mut frame, memory, at)?;
            at += upload.bytes_in_memory();
        }
        frame.end_stage();
        frame.submit(self.gpu.frames())?;
        Ok(())
    }
}

const MOTION: DXGI_FORMAT = DXGI_FORMAT_R16G16_FLOAT;
const DEPTH: DXGI_FORMAT = DXGI_FORMAT_R32_FLOAT;

impl Textures {
    /// For pictures of `size`; `tiles` are the tile sizes of motion and depth in pixels.
    pub(super) fn new(gpu: &Gpu, size: (u32, u32), tiles: [u32; 2]) -> Result<Self> {
        let texture = |tile: u32, format| {
            let size = (size.0.div_ceil(tile), size.1.div_ceil(tile));
            written_texture(gpu, size, format, D3D12_RESOURCE_STATE_COMMON)
        };
        let [motion_tile, depth_tile] = tiles;
        let (motion, depth) = (texture(motion_tile, MOTION)?, texture(depth_tile, DEPTH)?);
        Ok(Self { motion, motion_tile, depth, depth_tile, depth_is_even: false })
    }

    /// As input of a generator.
    pub(super) fn as_guidance(&self) -> GuidanceTextures<'_> {
        GuidanceTextures {
            motion: resting(&self.motion),
            motion_tile: self.motion_tile,
            depth: resting(&self.depth),
            depth_tile: self.depth_tile,
            depth_is_even: self.depth_is_even,
            hud: None,
        }
    }
}

impl PairTextures {
    fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let textures = |format| {
            let tiled = |tile: u32| (size.0.div_ceil(tile), size.1.div_ceil(tile));
            let texture = |tile| written_texture(gpu, tiled(tile), format, D3D12_RESOURCE_STATE_COMMON);
            TILES.into_iter().map(texture).collect::<Result<Vec<_>>>()
        };
        let (motion, depth) = (textures(MOTION)?, textures(DEPTH)?);
        let [motion_tile, depth_tile] = [TILES[0]; 2];
        let first = [&motion, &depth].map(|textures| textures[0].clone());
        let [first_motion, first_depth] = first;
        let textures =
            Textures { motion: first_motion, motion_tile, depth: first_depth, depth_tile, depth_is_even: false };
        Ok(Self { of: None, textures, motion, depth, used: 0 })
    }

    /// Selects the textures for these tile sizes of motion and depth.
    fn choose(&mut self, [motion_tile, depth_tile]: [u32; 2], depth_is_even: bool) -> Result<()> {
        let place = |tile| TILES.iter().position(|known| *known == tile).ok_or_else(|| no_tile(tile));
        let motion = self.motion[place(motion_tile)?].clone();
        let depth = self.depth[place(depth_tile)?].clone();
        self.textures = Textures { motion, motion_tile, depth, depth_tile, depth_is_even };
        Ok(())
    }
}

impl OverlayTexture {
    fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let texture = written_texture(gpu, size, DXGI_FORMAT_R8_UNORM, D3D12_RESOURCE_STATE_COMMON)?;
        Ok(Self { of: None, texture, size })
    }
}

/// Bytes of the largest upload for anchors of that size: a picture, motion and depth per pixel, or an overlay mask.
fn most_bytes(size: (u32, u32)) -> usize {
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
    fn record(&self, frame: &mut CommandRecorder<'_>, memory: &mut Shared, at: usize) -> Result<()> {
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
        frame.copy_rows(&from, rows, &resting(&self.to))
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
