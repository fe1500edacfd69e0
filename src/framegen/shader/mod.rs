//! The generator in compute shaders, on an engine's own Direct3D device.
//!
//! It computes what the [`cpu`](super::cpu) generator does, whose modules say what each step is for; its shaders are
//! `frame_*.hlsl`, and `frame.hlsli` holds what they share. What the processor does tile by tile with bands and short cuts, they do
//! place by place: a claim lands by an atomic minimum of its key, the upper word in one dispatch and the lower in a second, so that
//! the winner is the same. Cuts, bars and the way of the camera are found on the device, and later dispatches read them there:
//! nothing comes back to the processor. A finished picture is copied into its target, which thus need not be one that shaders write.

mod kernels;
mod layout;
mod memory;
mod steps;

use windows::Win32::Graphics::Dxgi::Common::*;

use crate::gpu::Gpu;
use crate::gpu::compute::pictures::{self, Format};
use crate::gpu::compute::{CommandRecorder, Output, ResourceWithState, Table, Transfer, View};
use crate::{Error, ErrorKind, MAX_SIDE, Result};
use kernels::Kernels;
use layout::{Constants, Layout};
use memory::Memory;
use steps::Steps;

/// The whole way between two anchors.
const WHOLE: i32 = 1 << 12;
/// The mark of a place of the previous anchor that no pixel of the current one comes from.
const ORPHAN: u32 = 254;
/// The mark of a place between the anchors that nothing lands on.
const HOLE: u32 = 255;
/// Formats of motion and of depth.
const MOTION: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R16G16_FLOAT, DXGI_FORMAT_R32G32_FLOAT];
const DEPTH: [DXGI_FORMAT; 2] = [DXGI_FORMAT_R32_FLOAT, DXGI_FORMAT_R16_FLOAT];

/// Motion and depth in textures, as [`Guidance`](crate::guidance::Guidance) holds them.
#[derive(Clone, Copy)]
pub struct GuidanceTextures<'a> {
    /// R16G16 or R32G32 (FLOAT): from the current anchor to the previous one, in pixels, y down.
    pub motion: ResourceWithState<'a>,
    /// Pixels to a side for which it has one vector: 1, 8 or 16.
    pub motion_tile: u32,
    /// R32 or R16 (FLOAT): device depth of the current anchor, 0 near.
    pub depth: ResourceWithState<'a>,
    /// Pixels to a side for which it has one value: 1, 8 or 16.
    pub depth_tile: u32,
    /// Whether depth is known to be one and the same everywhere ([`DepthMap::even`](crate::guidance::DepthMap::even)), as beside motion
    /// that was found in pictures: edges are then known to a pixel or two, and frames a little soft there.
    pub depth_is_even: bool,
    /// R8 (UNORM), where an engine knows it: what is not 0 lies over the current anchor's picture and stands still, like a HUD. Without
    /// it, such is told from colours that do not move, as letterbox bars are in any case.
    pub hud: Option<ResourceWithState<'a>>,
}

/// Two consecutive anchors in textures, as [`AnchorPair`](super::AnchorPair) holds them.
///
/// Both pictures are of one format: R8G8B8A8 or B8G8R8A8 (UNORM, UNORM_SRGB or typeless), R10G10B10A2 (UNORM or typeless) or R16G16B16A16
/// (FLOAT or typeless). What is typed as sRGB gives the same frames as what is not, at a little more cost: every read of it is brought back from
/// light. Numbers of floats may lie beyond [0, 1], and may be light ([`ShaderGenerator::with_transfer`]).
#[derive(Clone, Copy)]
pub struct TexturePair<'a> {
    /// The earlier anchor.
    pub previous: ResourceWithState<'a>,
    /// The later anchor.
    pub current: ResourceWithState<'a>,
    /// From the later back to the earlier.
    pub guidance: GuidanceTextures<'a>,
    /// The earlier anchor's depth with its tile, where it is known and of the same camera as the later's.
    pub previous_depth: Option<(ResourceWithState<'a>, u32)>,
    /// Whether a cut is known to lie between the two. Where this is not stated, cuts are looked for.
    pub cut: bool,
}

/// Generates frames of one size on a Direct3D device. Its memory is about 50 bytes to a pixel and is made with it, as are its
/// pipelines; recording makes nothing. Frames that use it run one after the other: on one queue, as ever.
///
/// Threads: one at a time; may move between them.
pub struct ShaderGenerator {
    gpu: Gpu,
    kernels: Kernels,
    layout: Layout,
    memory: Memory,
    transfer: Transfer,
    /// Of targets in half floats, where it is another than that of anchors.
    target_transfer: Option<Transfer>,
    /// The pair of which the memory knows all that does not depend on the phase.
    prepared: Option<Prepared>,
    /// How the finished picture is held that was made last.
    last: Option<Format>,
}

/// What tells one pair from another: its textures, and what is said of them.
type Prepared = ([usize; INPUTS], Constants);

/// In a generator's [report](ShaderGenerator::report) the word that is 1 where a cut lies between the anchors, and else 0.
pub const WORD_OF_CUT: u32 = 0;
/// The word that counts the pixels that nothing visible in the current anchor lands on.
pub const WORD_OF_UNCOVERED: u32 = 6;
/// The word with the share, a float from 0 to 1, for which no counterpart was found in the previous anchor; 0 where none was sought.
pub const WORD_OF_UNEXPLAINED: u32 = 29;
/// Descriptors that a frame of it takes; half of them where it only prepares a pair or makes a frame of one that is prepared.
pub const DESCRIPTORS: u32 = 24;
/// Textures that shaders read.
const INPUTS: usize = 6;

impl ShaderGenerator {
    /// Makes it ready for pictures of `size`, 1 to [`MAX_SIDE`](crate::MAX_SIDE) to a side and about 64 million pixels.
    ///
    /// # Errors
    /// `InvalidArgument` for another size, `Unsupported` for one that does not fit into the buffers of Direct3D; `OutOfMemory`,
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
            transfer: Transfer::Shown,
            target_transfer: None,
            prepared: None,
            last: None,
        })
    }

    /// The same for anchors whose numbers stand for light in another way than [`Transfer::Shown`], and for targets in half floats like them.
    pub fn with_transfer(self, transfer: Transfer) -> Self {
        Self { transfer, ..self }
    }

    /// The same for targets in half floats whose numbers stand for light in another way than those of anchors: anchors in sRGB and a window
    /// in scRGB.
    pub fn with_target_transfer(self, transfer: Transfer) -> Self {
        Self { target_transfer: Some(transfer), ..self }
    }

    /// `shader`.
    pub fn name(&self) -> &str {
        "shader"
    }

    /// Records the picture at phase `t` of `pair`, 0 being the previous anchor and 1 the current one, into `target`: a texture
    /// of the generator's size in a format of anchors; it need not be one that shaders write. Of light in anchors half floats get light,
    /// unless told otherwise, and other formats what is shown for it in sRGB, up to white. Across a cut the nearer anchor is shown.
    ///
    /// Of a pair that several pictures are made of, [`prepare`](Self::prepare) and [`interpolate`](Self::interpolate) do the same with
    /// less work.
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
        let seen = self.look_at_pair(pair)?;
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        frame.fits(DESCRIPTORS)?;
        let table = frame.bind(&seen.inputs, &self.memory.views(true))?;
        let shown = frame.bind(&seen.inputs, &self.memory.views(false))?;
        // It may be one of the inputs, and must rest in one state then.
        target.takes(frame)?;
        self.explore(frame, &table, &seen);
        self.show(frame, &shown, &seen, at, written, target)
    }

    /// Records all that frames between the anchors of `pair` have in common: [`interpolate`](Self::interpolate) makes any number of them,
    /// in this frame or in later ones of the same queue, until another pair is prepared or anything else is made. The pair's textures
    /// must hold the same until then.
    ///
    /// # Errors
    /// As for [`generate`](Self::generate).
    pub fn prepare(&mut self, frame: &mut CommandRecorder<'_>, pair: &TexturePair<'_>) -> Result<()> {
        let seen = self.look_at_pair(pair)?;
        let table = frame.bind(&seen.inputs, &self.memory.views(true))?;
        self.explore(frame, &table, &seen);
        Ok(())
    }

    /// Records the picture at phase `t` of the pair that was prepared last, as [`generate`](Self::generate) does, to the bit. A prepared
    /// frame that was dropped instead of run leaves pictures of no meaning.
    ///
    /// # Errors
    /// `InvalidArgument` for a pair of which another is prepared, or none; as for [`generate`](Self::generate).
    pub fn interpolate<'t>(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        pair: &TexturePair<'_>,
        t: f32,
        target: impl Into<Output<'t>>,
    ) -> Result<()> {
        let target = target.into();
        let at = self.phase(t)?;
        let seen = self.look_at_pair(pair)?;
        if self.prepared != Some(seen.prepared()) {
            return Err(Error::new(ErrorKind::InvalidArgument, "the pair is not the one that was prepared last")
                .field("pair")
                .remedy("Record prepare for it first"));
        }
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        let table = frame.bind(&seen.inputs, &self.memory.views(false))?;
        target.takes(frame)?;
        self.show(frame, &table, &seen, at, written, target)
    }

    /// Records the picture `t` anchor intervals after an anchor, as if its motion went on, into `target`. Bounded to one interval:
    /// later than that, and after a cut (`is_after_cut`), a picture is held.
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
        let phase = ((t.min(1.0) * WHOLE as f32 + 0.5) as i32).clamp(1, WHOLE);
        let seen = self.look(current, guidance)?;
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        let beyond = Constants {
            is_stated: is_after_cut.into(),
            landing_phase: WHOLE + phase,
            mark: HOLE,
            at_tiles: self.layout.at_place_tiles,
            ..self.constants(&seen, &written)
        };
        let table = frame.bind(&seen.inputs, &self.memory.views(false))?;
        // It may be one of the inputs, and must rest in one state then.
        target.takes(frame)?;
        self.prepared = None;
        let kernels = &self.kernels;
        let mut steps = self.steps(frame, &table);
        steps.begin(beyond);
        steps.by_one(&kernels.seen, beyond);
        steps.by_tiles(&kernels.given, beyond);
        steps.by_tiles(&kernels.field, beyond);
        steps.land(beyond);
        steps.fill(beyond);
        steps.by_tiles(&kernels.beyond, beyond);
        steps.paint(beyond);
        self.copy(frame, &written, target)
    }

    /// Records `picture` as it is, of the generator's size in a format of anchors, into `target`, as for
    /// [`generate`](Self::generate): what is shown at an anchor's own time.
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
        let anchor = pictures::anchor(&self.gpu, picture, self.layout.constants.size, self.transfer, "picture")?;
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        let inputs = [View::Texture(*picture, anchor.viewed); INPUTS];
        let table = frame.bind(&inputs, &self.memory.views(false))?;
        // It may be the anchor, and must rest in one state then.
        target.takes(frame)?;
        self.prepared = None;
        // As the later one of two with a cut between them, of which nothing else is read.
        let seen = Seen { constants: self.layout.constants, inputs, anchor };
        let shown = Constants {
            is_pair: 1,
            is_stated: 1,
            cut_shows_current: 1,
            is_float: anchor.is_float.into(),
            is_light: anchor.is_light.into(),
            mark: HOLE,
            at_tiles: self.layout.at_place_tiles,
            ..self.constants(&seen, &written)
        };
        let mut steps = self.steps(frame, &table);
        steps.begin(shown);
        steps.by_tiles(&self.kernels.render, shown);
        self.copy(frame, &written, target)
    }

    /// Whether frames of `pair` can be made without preparing it.
    ///
    /// # Errors
    /// As for [`generate`](Self::generate).
    pub fn is_prepared(&self, pair: &TexturePair<'_>) -> Result<bool> {
        Ok(self.prepared == Some(self.look_at_pair(pair)?.prepared()))
    }

    /// Records the picture that was made last once more, into `target`; whether that is possible: where the target's format is that of the
    /// last one, in which the finished picture is held.
    ///
    /// # Errors
    /// As for [`show_anchor`](Self::show_anchor).
    pub fn again<'t>(&mut self, frame: &mut CommandRecorder<'_>, target: impl Into<Output<'t>>) -> Result<bool> {
        let target = target.into();
        let written = target.format(&self.gpu, frame, self.layout.constants.size)?;
        if self.last != Some(written) {
            return Ok(false);
        }
        self.copy(frame, &written, target)?;
        Ok(true)
    }

    /// A buffer in which the device leaves what happened in the frame that was made last, for whoever wants to copy it from there:
    /// [`WORD_OF_CUT`], [`WORD_OF_UNCOVERED`] and [`WORD_OF_UNEXPLAINED`] say in which words of four bytes. The next frame overwrites it.
    pub fn report(&self) -> ResourceWithState<'_> {
        self.memory.small()
    }

    /// A phase inside (0, 1).
    fn phase(&self, t: f32) -> Result<Phase> {
        if !(t > 0.0 && t < 1.0) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a phase of {t} is not inside (0, 1)"))
                .field("t")
                .remedy("Show an anchor itself at phases 0 and 1"));
        }
        Ok(Phase { phase: ((t * WHOLE as f32 + 0.5) as i32).clamp(1, WHOLE - 1), cut_shows_current: t >= 0.5 })
    }

    /// Looks at what frames between two anchors are made of, so that nothing is recorded of what cannot be.
    fn look_at_pair<'t>(&self, pair: &TexturePair<'t>) -> Result<Seen<'t>> {
        let mut seen = self.look(&pair.current, &pair.guidance)?;
        let size = seen.constants.size;
        if pictures::anchor(&self.gpu, &pair.previous, size, self.transfer, "previous")?.viewed != seen.anchor.viewed {
            return Err(Error::new(ErrorKind::InvalidArgument, "the anchors are of two formats").field("previous"));
        }
        seen.inputs[0] = View::Texture(pair.previous, seen.anchor.viewed);
        if let Some((depth, tile)) = &pair.previous_depth {
            seen.inputs[4] = pictures::guidance(&self.gpu, depth, size, *tile, &DEPTH, "previous_depth")?;
            seen.constants.past_tile = *tile;
        }
        seen.constants.is_pair = 1;
        seen.constants.is_stated = pair.cut.into();
        Ok(seen)
    }

    /// Looks at an anchor and what is known of it.
    fn look<'t>(&self, current: &ResourceWithState<'t>, guidance: &GuidanceTextures<'t>) -> Result<Seen<'t>> {
        let size = self.layout.constants.size;
        let anchor = pictures::anchor(&self.gpu, current, size, self.transfer, "current")?;
        let (tile, formats) = (guidance.motion_tile, &MOTION);
        let motion = pictures::guidance(&self.gpu, &guidance.motion, size, tile, formats, "motion")?;
        let (tile, formats) = (guidance.depth_tile, &DEPTH);
        let depth = pictures::guidance(&self.gpu, &guidance.depth, size, tile, formats, "depth")?;
        let mut hud = depth;
        if let Some(given) = &guidance.hud {
            hud = pictures::guidance(&self.gpu, given, size, 1, &[DXGI_FORMAT_R8_UNORM], "hud")?;
        }
        let picture = View::Texture(*current, anchor.viewed);
        let constants = Constants {
            guidance_tiles: [guidance.motion_tile, guidance.depth_tile],
            has_hud: guidance.hud.is_some().into(),
            is_even: guidance.depth_is_even.into(),
            is_float: anchor.is_float.into(),
            is_light: anchor.is_light.into(),
            ..self.layout.constants
        };
        // What is not there is another of its kind, which nobody reads.
        Ok(Seen { constants, inputs: [picture, picture, motion, depth, depth, hud], anchor })
    }

    /// Records what does not depend on the phase: cuts, bars, the way of the camera, motion, and what is in the previous anchor.
    fn explore(&mut self, frame: &mut CommandRecorder<'_>, table: &Table, seen: &Seen<'_>) {
        self.prepared = Some(seen.prepared());
        let kernels = &self.kernels;
        let in_previous = Constants { mark: ORPHAN, at_tiles: seen.constants.at_owner_tiles, ..seen.constants };
        let mut steps = self.steps(frame, table);
        steps.begin(in_previous);
        steps.by_lines(&kernels.lines, in_previous);
        steps.find_cut(in_previous);
        steps.by_one(&kernels.seen, in_previous);
        steps.by_tiles(&kernels.given, in_previous);
        steps.by_tiles(&kernels.field, in_previous);
        steps.land(in_previous);
        steps.by_ends(&kernels.leave, in_previous);
        steps.by_ends(&kernels.join, in_previous);
        steps.by_tiles(&kernels.free, in_previous);
        steps.fill(in_previous);
    }

    /// Records a frame between two anchors that were explored.
    fn show(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        table: &Table,
        seen: &Seen<'_>,
        Phase { phase, cut_shows_current }: Phase,
        written: Format,
        target: Output<'_>,
    ) -> Result<()> {
        let between = Constants {
            phase,
            landing_phase: phase,
            nearer_is_current: (phase >= WHOLE / 2).into(),
            cut_shows_current: cut_shows_current.into(),
            borrows: 1,
            mark: HOLE,
            at_tiles: self.layout.at_place_tiles,
            ..self.constants(seen, &written)
        };
        let mut steps = self.steps(frame, table);
        steps.land(between);
        steps.fill(between);
        steps.by_tiles(&self.kernels.render, between);
        steps.paint(between);
        self.copy(frame, &written, target)
    }

    /// The constants of a frame that is written in a format.
    fn constants(&self, seen: &Seen<'_>, written: &Format) -> Constants {
        let transfer = self.target_transfer.unwrap_or(self.transfer);
        Constants {
            written: written.written,
            pitch: pictures::pitch(seen.constants.size[0], written.bytes),
            writes_light: (transfer == Transfer::Light && written.holds_light()).into(),
            ..seen.constants
        }
    }

    fn steps<'f, 'g>(&'f self, frame: &'f mut CommandRecorder<'g>, table: &'f Table) -> Steps<'f, 'g> {
        Steps { frame, table, kernels: &self.kernels, layout: &self.layout }
    }

    /// Copies the finished picture into its target.
    fn copy(&mut self, frame: &mut CommandRecorder<'_>, written: &Format, target: Output<'_>) -> Result<()> {
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

/// Where between the anchors a frame is.
#[derive(Clone, Copy)]
struct Phase {
    /// In parts of [`WHOLE`].
    phase: i32,
    /// Whether the current anchor is shown there across a cut.
    cut_shows_current: bool,
}

/// What a frame is made of.
struct Seen<'t> {
    constants: Constants,
    inputs: [View<'t>; INPUTS],
    anchor: Format,
}

impl Seen<'_> {
    fn prepared(&self) -> Prepared {
        (self.inputs.each_ref().map(View::address), self.constants)
    }
}
