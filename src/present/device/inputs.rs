//! Inputs of a frame in textures.

use windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_STATE_COMMON, ID3D12Resource};

use crate::framegen::densify::{DEPTH, MOTION};
use crate::framegen::shader::{GuidanceTextures, TexturePair};
use crate::gpu::compute::ResourceWithState;
use crate::gpu::{Gpu, writable_texture};
use crate::guidance::MotionOrigin;
use crate::{Error, ErrorKind, Result};

/// Inputs of a frame. All textures are in the state COMMON between lists.
pub(super) struct FrameInputs {
    pub(super) previous: Option<ID3D12Resource>,
    /// The later anchor of a pair, the last anchor, or the picture to copy.
    pub(super) current: ID3D12Resource,
    pub(super) guidance: Option<OwnedGuidance>,
    /// Guidance at the anchors' original resolution; set only if the anchors were upscaled.
    pub(super) original_guidance: Option<OwnedGuidance>,
    /// Depth of the previous anchor, and its tile size in pixels.
    pub(super) previous_depth: Option<(ID3D12Resource, u32)>,
    /// The static overlay mask.
    pub(super) overlay: Option<ID3D12Resource>,
}

/// Motion and depth in textures, with a reference to each.
#[derive(Clone)]
pub(super) struct OwnedGuidance {
    pub(super) motion: ID3D12Resource,
    /// Tile size of motion, in pixels.
    pub(super) motion_tile: u32,
    pub(super) depth: ID3D12Resource,
    /// Tile size of depth, in pixels.
    pub(super) depth_tile: u32,
    /// Where the motion came from.
    pub(super) motion_origin: MotionOrigin,
}

impl FrameInputs {
    /// Textures for interpolation.
    pub(super) fn pair(&self) -> Result<TexturePair<'_>> {
        let previous = self.previous.as_ref().map(in_common_state).ok_or_else(missing_input)?;
        let previous_depth = self.previous_depth.as_ref().map(|(depth, tile)| (in_common_state(depth), *tile));
        Ok(TexturePair {
            previous,
            current: in_common_state(&self.current),
            guidance: self.guidance()?,
            previous_depth,
            cut: false,
        })
    }

    /// Motion, depth and overlay mask for a generator.
    pub(super) fn guidance(&self) -> Result<GuidanceTextures<'_>> {
        let guidance = self.guidance.as_ref().ok_or_else(missing_input)?;
        Ok(GuidanceTextures { hud: self.overlay.as_ref().map(in_common_state), ..guidance.textures() })
    }
}

impl OwnedGuidance {
    /// For pictures of `size`; `tiles` are the tile sizes of motion and depth in pixels.
    pub(super) fn new(gpu: &Gpu, size: (u32, u32), tiles: [u32; 2]) -> Result<Self> {
        let texture = |tile: u32, format| {
            let size = (size.0.div_ceil(tile), size.1.div_ceil(tile));
            writable_texture(gpu, size, format, D3D12_RESOURCE_STATE_COMMON)
        };
        let [motion_tile, depth_tile] = tiles;
        let (motion, depth) = (texture(motion_tile, MOTION)?, texture(depth_tile, DEPTH)?);
        Ok(Self { motion, motion_tile, depth, depth_tile, motion_origin: MotionOrigin::default() })
    }

    /// As input of a generator, without an overlay mask.
    pub(super) fn textures(&self) -> GuidanceTextures<'_> {
        GuidanceTextures {
            motion: in_common_state(&self.motion),
            motion_tile: self.motion_tile,
            depth: in_common_state(&self.depth),
            depth_tile: self.depth_tile,
            motion_origin: self.motion_origin,
            hud: None,
        }
    }
}

/// A resource of our own: between command lists it is in the state COMMON.
pub(super) fn in_common_state(resource: &ID3D12Resource) -> ResourceWithState<'_> {
    ResourceWithState { resource, state: D3D12_RESOURCE_STATE_COMMON }
}

/// Cannot happen: the cache provides all inputs that a plan needs.
pub(super) fn missing_input() -> Error {
    Error::new(ErrorKind::InvalidState, "what the frame is made of is not there")
}
