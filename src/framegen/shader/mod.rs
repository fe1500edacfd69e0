//! The generator in compute shaders, on a Direct3D 12 device.
//!
//! It computes the same as the [`cpu`](super::cpu) generator, whose modules document the purpose of each step. Its shaders are
//! `frame_*.hlsl`; `frame.hlsli` holds shared code. The CPU works tile by tile, in bands and with fast paths; the shaders work per pixel. A
//! splat is an atomic minimum of its key, the upper word in one dispatch and the lower word in a second, so that both generators keep the
//! same pixel. Cuts, letterbox bars and the camera motion are found on the device, and later dispatches read them there: the CPU reads
//! nothing back. The finished picture is copied into its target, so the target need not allow unordered access.

mod kernels;
mod layout;
mod memory;
mod steps;

use windows::Win32::Graphics::Dxgi::Common::*;

use super::cpu::{HOLE, PHASE_ONE, PREVIOUS_ONLY};
use crate::gpu::Gpu;
use crate::gpu::compute::picture_formats::{self, PictureFormat};
use crate::gpu::compute::{CommandRecorder, Output, ResourceWithState, Table, Transfer, View};
use crate::guidance::MotionOrigin;
use crate::{Error, ErrorKind, MAX_SIDE, Result};
use kernels::Kernels;
use layout::{Constants, Layout};
use memory::Memory;
use steps::Steps;

/// Formats of motion and of depth.
const MOTION: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32G32_FLOAT];
const DEPTH: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R32_FLOAT, DXGI_FORMAT_R16_FLOAT];

/// Motion and depth in textures, as [`Guidance`](crate::guidance::Guidance) holds them.
#[derive(Clone, Copy)]
pub struct GuidanceTextures<'a> {
    /// R16G16 or R32G32 (FLOAT): motion from the current anchor to the previous one, in pixels, y down.
    pub motion: ResourceWithState<'a>,
    /// Tile size of motion in pixels: 1, 8 or 16.
    pub motion_tile: u32,
    /// R32 or R16 (FLOAT): device depth of the current anchor, 0 near.
    pub depth: ResourceWithState<'a>,
    /// Tile size of depth in pixels: 1, 8 or 16.
    pub depth_tile: u32,
    /// Where the motion came from.
    pub motion_origin: MotionOrigin,
    /// R8 (UNORM): mask of a static overlay over the current anchor, such as a HUD, not 0 where there is one. Without it, an overlay is detected
    /// from colours that do not move, as letterbox bars always are.
    pub hud: Option<ResourceWithState<'a>>,
}

/// Two consecutive anchors in textures, as [`AnchorPair`](super::AnchorPair) holds them.
///
/// Both pictures are of one format: R8G8B8A8 or B8G8R8A8 (UNORM, UNORM_SRGB or typeless), R10G10B10A2 (UNORM or typeless) or R16G16B16A16
/// (FLOAT or typeless). An sRGB format gives the same frames as the one without, at a little more cost: every read is converted back from
/// linear. Float values may be outside [0, 1], and may be linear ([`ShaderGenerator::with_transfer`]).
#[derive(Clone, Copy)]
pub struct TexturePair<'a> {
    /// The earlier anchor.
    pub previous: ResourceWithState<'a>,
    /// The later anchor.
    pub current: ResourceWithState<'a>,
    /// Motion from the later anchor back to the earlier one, and the later one's depth.
    pub guidance: GuidanceTextures<'a>,
    /// The earlier anchor's depth with its tile size, if it is known and has the later one's projection.
    pub previous_depth: Option<(ResourceWithState<'a>, u32)>,
    /// Whether the caller states a cut between the two. If not, the generator detects cuts.
    pub cut: bool,
}

/// Generates frames of one size on a Direct3D 12 device. Its memory, about 50 bytes per pixel, and its pipelines are created with it;
/// recording creates nothing. Frames that use it must run one after the other, for example on one queue.
///
/// Threads: one at a time; may move between them.
pub struct ShaderGenerator {
    gpu: Gpu,
    kernels: Kernels,
    layout: Layout,
    memory: Memory,
    transfer: Transfer,
    /// Transfer function of targets in half floats, if it differs from that of the anchors.
    target_transfer: Option<Transfer>,
    /// The pair whose phase-independent results are in memory.
    prepared: Option<PairIdentity>,
    /// Format of the last finished picture.
    last: Option<PictureFormat>,
}

/// Identity of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PairIdentity {
    /// Addresses of the textures.
    textures: [usize; INPUTS],
    constants: Constants,
}

/// Word of a generator's [report](ShaderGenerator::report) that is 1 if there is a cut between the anchors, else 0.
pub const WORD_OF_CUT: u32 = 0;
/// Word with the number of pixels to which no visible pixel of the current anchor is warped.
pub const WORD_OF_UNCOVERED: u32 = 6;
/// Word with the share of pixels, a float from 0 to 1, without a counterpart in the previous anchor; 0 if no cut detection was run.
pub const WORD_OF_UNEXPLAINED: u32 = 29;
/// Descriptors per frame; half as many for [`prepare`](ShaderGenerator::prepare) or [`interpolate`](ShaderGenerator::interpolate) alone.
pub const DESCRIPTORS: u32 = 24;
/// Number of textures that shaders read.
const INPUTS: usize = 6;

impl ShaderGenerator {
    /// Creates a generator for pictures of `size`, 1 to [`MAX_SIDE`](crate::MAX_SIDE) per side and at most about 64 million pixels.
    ///
    /// # Errors
    /// `InvalidArgument` for another size, `Unsupported` for one that exceeds the buffers of Direct3D; `OutOfMemory`,
    /// `DeviceRemoved`, or `Device` when the driver refuses a shader.
    pub fn new(gpu: &Gpu, size: (u32, u32)) -> Result<Self> {
        let sides = 1..=MAX_SIDE;
        if !sides.contains(&size.0) || !sides.contains(&size.1) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("frames of {} x {} pixels", size.0, size.1))
                .field("size")
                .remedy(format!("Use a width and a height from 1 to {MAX_SIDE}")));
        }
        let layout = Layout::new(size);
        let memory = Memory::new(gpu, &layout)?;
        Ok(Self {
            gpu: gpu.clone(),
            kernels: Kernels::new(gpu)?,
            layout,
            memory,
            transfer: Transfer::Encoded,
            target_transfer: None,
            prepared: None,
            last: None,
        })
    }

    /// Sets the transfer function of anchors, [`Transfer::Encoded`] by default, and of targets in half floats.
    pub fn with_transfer(self, transfer: Transfer) -> Self {
        Self { transfer, ..self }
    }

    /// Sets another transfer function for targets in half floats than for anchors: for example anchors in sRGB and a window in scRGB.
    pub fn with_target_transfer(self, transfer: Transfer) -> Self {
        Self { target_transfer: Some(transfer), ..self }
    }

    /// The generator's name, `shader`.
    pub fn name(&self) -> &str {
        "shader"
    }

    /// Records the picture at phase `t` of `pair`, 0 being the previous anchor and 1 the current one, into `target`: a texture
    /// of the generator's size in a format of anchors; it need not allow unordered access. For linear anchors, targets in half floats get linear
    /// values unless set otherwise, and other formats get sRGB values, clamped at white. Across a cut the nearer anchor is shown.
    ///
    /// For several pictures of a pair, [`prepare`](Self::prepare) and [`interpolate`](Self::interpolate) give the same result with less work.
    ///
    /// # Errors
    /// `InvalidArgument` when `t` is not inside (0, 1), or for a texture of another size, format or device; as for any frame.
    /// Nothing is recorded then.
    pub fn generate<'t>(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        pair: &TexturePair<'_>,
        t: f32,
        target: impl Into<Output<'t>>,
    ) -> Result<()> {
        let target = target.into();
        let at = self.phase(t)?;
        let checked = self.check_pair(pair)?;
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        frame.check_descriptors(DESCRIPTORS)?;
        let table = frame.bind(&checked.inputs, &self.memory.views(true))?;
        let frame_table = frame.bind(&checked.inputs, &self.memory.views(false))?;
        // The target may be one of the inputs and must then be in one state.
        target.check_state(frame)?;
        self.record_pair(frame, &table, &checked);
        self.record_frame(frame, &frame_table, &checked, at, written, target)
    }

    /// Records the work that all frames between the anchors of `pair` share. [`interpolate`](Self::interpolate) then makes any number of them,
    /// in this frame or in later ones of the same queue, until another pair is prepared or another kind of frame is made. The pair's textures
    /// must not change until then.
    ///
    /// # Errors
    /// As for [`generate`](Self::generate).
    pub fn prepare(&mut self, frame: &mut CommandRecorder<'_>, pair: &TexturePair<'_>) -> Result<()> {
        let checked = self.check_pair(pair)?;
        let table = frame.bind(&checked.inputs, &self.memory.views(true))?;
        self.record_pair(frame, &table, &checked);
        Ok(())
    }

    /// Records the picture at phase `t` of the last prepared pair; the result is identical to that of [`generate`](Self::generate). If the
    /// frame with the preparation was dropped instead of run, pictures are undefined.
    ///
    /// # Errors
    /// `InvalidArgument` if the pair is not the last prepared one; as for [`generate`](Self::generate).
    pub fn interpolate<'t>(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        pair: &TexturePair<'_>,
        t: f32,
        target: impl Into<Output<'t>>,
    ) -> Result<()> {
        let target = target.into();
        let at = self.phase(t)?;
        let checked = self.check_pair(pair)?;
        if self.prepared != Some(checked.identity()) {
            return Err(Error::new(ErrorKind::InvalidArgument, "the pair is not the one that was prepared last")
                .field("pair")
                .remedy("Record prepare for it first"));
        }
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        let table = frame.bind(&checked.inputs, &self.memory.views(false))?;
        target.check_state(frame)?;
        self.record_frame(frame, &table, &checked, at, written, target)
    }

    /// Records the picture extrapolated `t` anchor intervals after an anchor along its motion, into `target`. Limited to one interval:
    /// after that, and after a cut (`is_after_cut`), a picture is held.
    ///
    /// # Errors
    /// `InvalidArgument` when `t` is not above 0 and finite, and as for [`generate`](Self::generate).
    pub fn extrapolate<'t>(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        current: &ResourceWithState<'_>,
        guidance: &GuidanceTextures<'_>,
        is_after_cut: bool,
        t: f32,
        target: impl Into<Output<'t>>,
    ) -> Result<()> {
        let target = target.into();
        if !(t > 0.0 && t.is_finite()) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("{t} intervals after an anchor"))
                .field("t")
                .remedy("Pass a positive number of anchor intervals"));
        }
        let phase = ((t.min(1.0) * PHASE_ONE as f32 + 0.5) as i32).clamp(1, PHASE_ONE);
        let checked = self.check_inputs(current, guidance)?;
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        let extrapolated = Constants {
            is_cut_stated: is_after_cut.into(),
            splat_phase: PHASE_ONE + phase,
            inherited_tag: HOLE.into(),
            at_splat_tiles: self.layout.at_frame_tiles,
            ..self.constants(&checked, &written)
        };
        let table = frame.bind(&checked.inputs, &self.memory.views(false))?;
        // The target may be one of the inputs and must then be in one state.
        target.check_state(frame)?;
        self.prepared = None;
        let kernels = &self.kernels;
        let mut steps = self.steps(frame, &table);
        steps.begin(extrapolated);
        steps.once(&kernels.camera_fit, extrapolated);
        steps.per_tile(&kernels.guidance_tiles, extrapolated);
        steps.per_tile(&kernels.field, extrapolated);
        steps.splat(extrapolated);
        steps.fill_holes(extrapolated);
        steps.per_tile(&kernels.extrapolate, extrapolated);
        steps.inpaint(extrapolated);
        self.copy(frame, &written, target)
    }

    /// Records `picture` unchanged, of the generator's size in a format of anchors, into `target`, as for
    /// [`generate`](Self::generate): for a frame at an anchor's own time.
    ///
    /// # Errors
    /// `InvalidArgument` for a texture of another size, format or device; as for any frame. Nothing is recorded then.
    pub fn show_anchor<'t>(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        picture: &ResourceWithState<'_>,
        target: impl Into<Output<'t>>,
    ) -> Result<()> {
        let target = target.into();
        let anchor = picture_formats::anchor(&self.gpu, picture, self.layout.constants.size, self.transfer, "picture")?;
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        let inputs = [View::Texture(*picture, anchor.view_format); INPUTS];
        let table = frame.bind(&inputs, &self.memory.views(false))?;
        // The target may be the anchor and must then be in one state.
        target.check_state(frame)?;
        self.prepared = None;
        // Uses the path for a cut between two anchors, which reads only the later anchor.
        let checked = CheckedInputs { constants: self.layout.constants, inputs, anchor };
        let constants = Constants {
            is_pair: 1,
            is_cut_stated: 1,
            cut_shows_current: 1,
            is_float: anchor.is_float.into(),
            is_linear: anchor.is_linear.into(),
            inherited_tag: HOLE.into(),
            at_splat_tiles: self.layout.at_frame_tiles,
            ..self.constants(&checked, &written)
        };
        let mut steps = self.steps(frame, &table);
        steps.begin(constants);
        steps.per_tile(&self.kernels.interpolate, constants);
        self.copy(frame, &written, target)
    }

    /// Whether `pair` is prepared.
    ///
    /// # Errors
    /// As for [`generate`](Self::generate).
    pub fn is_prepared(&self, pair: &TexturePair<'_>) -> Result<bool> {
        Ok(self.prepared == Some(self.check_pair(pair)?.identity()))
    }

    /// Records another copy of the last picture into `target`; `false` if the target's format differs from the one in which the finished picture
    /// is stored.
    ///
    /// # Errors
    /// As for [`show_anchor`](Self::show_anchor).
    pub fn record_again<'t>(&mut self, frame: &mut CommandRecorder<'_>, target: impl Into<Output<'t>>) -> Result<bool> {
        let target = target.into();
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        if self.last != Some(written) {
            return Ok(false);
        }
        self.copy(frame, &written, target)?;
        Ok(true)
    }

    /// The buffer with the report of the last frame, to copy from: [`WORD_OF_CUT`], [`WORD_OF_UNCOVERED`] and [`WORD_OF_UNEXPLAINED`] are indices
    /// of its 32-bit words. The next frame overwrites it.
    pub fn report(&self) -> ResourceWithState<'_> {
        self.memory.small()
    }

    /// Converts a phase inside (0, 1) to fixed point.
    fn phase(&self, t: f32) -> Result<Phase> {
        if !(t > 0.0 && t < 1.0) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a phase of {t} is not inside (0, 1)"))
                .field("t")
                .remedy("Show an anchor itself at phases 0 and 1"));
        }
        Ok(Phase { phase: ((t * PHASE_ONE as f32 + 0.5) as i32).clamp(1, PHASE_ONE - 1), cut_shows_current: t >= 0.5 })
    }

    /// Checks the inputs of a pair before anything is recorded.
    fn check_pair<'t>(&self, pair: &TexturePair<'t>) -> Result<CheckedInputs<'t>> {
        let mut checked = self.check_inputs(&pair.current, &pair.guidance)?;
        let size = checked.constants.size;
        if picture_formats::anchor(&self.gpu, &pair.previous, size, self.transfer, "previous")?.view_format
            != checked.anchor.view_format
        {
            return Err(Error::new(ErrorKind::InvalidArgument, "the anchors are of two formats").field("previous"));
        }
        checked.inputs[0] = View::Texture(pair.previous, checked.anchor.view_format);
        if let Some((depth, tile)) = &pair.previous_depth {
            checked.inputs[4] = picture_formats::guidance(&self.gpu, depth, size, *tile, &DEPTH, "previous_depth")?;
            checked.constants.previous_depth_tile = *tile;
        }
        checked.constants.is_pair = 1;
        checked.constants.is_cut_stated = pair.cut.into();
        Ok(checked)
    }

    /// Checks an anchor and its guidance.
    fn check_inputs<'t>(
        &self,
        current: &ResourceWithState<'t>,
        guidance: &GuidanceTextures<'t>,
    ) -> Result<CheckedInputs<'t>> {
        let size = self.layout.constants.size;
        let anchor = picture_formats::anchor(&self.gpu, current, size, self.transfer, "current")?;
        let (tile, formats) = (guidance.motion_tile, &MOTION);
        let motion = picture_formats::guidance(&self.gpu, &guidance.motion, size, tile, formats, "motion")?;
        let (tile, formats) = (guidance.depth_tile, &DEPTH);
        let depth = picture_formats::guidance(&self.gpu, &guidance.depth, size, tile, formats, "depth")?;
        let mut hud = depth;
        if let Some(given) = &guidance.hud {
            hud = picture_formats::guidance(&self.gpu, given, size, 1, &[DXGI_FORMAT_R8_UNORM], "hud")?;
        }
        let picture = View::Texture(*current, anchor.view_format);
        let constants = Constants {
            guidance_tiles: [guidance.motion_tile, guidance.depth_tile],
            has_hud: guidance.hud.is_some().into(),
            is_optical_flow: guidance.motion_origin.is_optical_flow().into(),
            // With a mask it is known where an overlay is.
            finds_overlays: guidance.hud.is_none().into(),
            is_float: anchor.is_float.into(),
            is_linear: anchor.is_linear.into(),
            ..self.layout.constants
        };
        // A missing input is replaced by another texture of its kind that no shader reads.
        Ok(CheckedInputs { constants, inputs: [picture, picture, motion, depth, depth, hud], anchor })
    }

    /// Records the phase-independent work: cuts, letterbox bars, camera motion, the motion field, and splatting into the previous anchor.
    fn record_pair(&mut self, frame: &mut CommandRecorder<'_>, table: &Table, checked: &CheckedInputs<'_>) {
        self.prepared = Some(checked.identity());
        let kernels = &self.kernels;
        let in_previous = Constants {
            inherited_tag: PREVIOUS_ONLY.into(),
            at_splat_tiles: checked.constants.at_previous_tiles,
            ..checked.constants
        };
        let mut steps = self.steps(frame, table);
        steps.begin(in_previous);
        steps.per_line(&kernels.letterbox, in_previous);
        steps.find_cut(in_previous);
        steps.once(&kernels.camera_fit, in_previous);
        steps.per_tile(&kernels.guidance_tiles, in_previous);
        steps.per_tile(&kernels.field, in_previous);
        steps.splat(in_previous);
        steps.fill_holes(in_previous);
    }

    /// Records the phase-dependent work of a prepared pair.
    fn record_frame(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        table: &Table,
        checked: &CheckedInputs<'_>,
        Phase { phase, cut_shows_current }: Phase,
        written: PictureFormat,
        target: Output<'_>,
    ) -> Result<()> {
        let constants = Constants {
            phase,
            splat_phase: phase,
            nearer_is_current: (phase >= PHASE_ONE / 2).into(),
            cut_shows_current: cut_shows_current.into(),
            splats_inherited: 1,
            inherited_tag: HOLE.into(),
            at_splat_tiles: self.layout.at_frame_tiles,
            ..self.constants(checked, &written)
        };
        let mut steps = self.steps(frame, table);
        steps.splat(constants);
        steps.fill_holes(constants);
        steps.per_tile(&self.kernels.interpolate, constants);
        steps.inpaint(constants);
        self.copy(frame, &written, target)
    }

    /// The constants for a frame in a target format.
    fn constants(&self, checked: &CheckedInputs<'_>, written: &PictureFormat) -> Constants {
        let transfer = self.target_transfer.unwrap_or(self.transfer);
        Constants {
            target_format: written.written,
            pitch: picture_formats::pitch(checked.constants.size[0], written.bytes),
            writes_linear: (transfer == Transfer::Linear && written.can_hold_linear()).into(),
            ..checked.constants
        }
    }

    /// The steps of a frame with these bindings.
    fn steps<'f, 'g>(&'f self, frame: &'f mut CommandRecorder<'g>, table: &'f Table) -> Steps<'f, 'g> {
        Steps { frame, table, kernels: &self.kernels, layout: &self.layout }
    }

    /// Copies the finished picture into its target.
    fn copy(&mut self, frame: &mut CommandRecorder<'_>, written: &PictureFormat, target: Output<'_>) -> Result<()> {
        self.last = None;
        target.copy(frame, &self.memory.picture(), written.rows(self.layout.constants.size))?;
        self.last = Some(*written);
        Ok(())
    }
}

impl std::fmt::Debug for ShaderGenerator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.layout.constants.size;
        write!(f, "ShaderGenerator({width} x {height})")
    }
}

/// Fixed-point time of a frame between the anchors.
#[derive(Clone, Copy)]
struct Phase {
    /// Numerator over [`PHASE_ONE`].
    phase: i32,
    /// Whether the current anchor is shown at this phase if there is a cut.
    cut_shows_current: bool,
}

/// Checked inputs of a frame.
struct CheckedInputs<'t> {
    constants: Constants,
    inputs: [View<'t>; INPUTS],
    anchor: PictureFormat,
}

impl CheckedInputs<'_> {
    fn identity(&self) -> PairIdentity {
        PairIdentity { textures: self.inputs.each_ref().map(View::address), constants: self.constants }
    }
}
