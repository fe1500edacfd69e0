//! Conversion between pictures and latents: the encoder, and the streaming decoder with its memories.

use std::borrow::Borrow;

use crate::allocate;
use crate::bundle::Precision;
use crate::runtime::{Backup, BindingId, BufferId, ExecutionContext, FiniteCheckId};
use crate::world::convert::{self, Uploader};
use crate::world::graph_spec::Shapes;
use crate::world::resize::Bilinear;
use crate::world::world::World;
use crate::{Error, ErrorKind, Picture, Result};

/// One half of the decoder's double buffer: its memories after a latent, and the latent's pictures.
struct DecoderSide {
    /// The memories in the bundle's order, then the pictures.
    buffers: Vec<BufferId>,
}

impl DecoderSide {
    fn memories(&self) -> &[BufferId] {
        &self.buffers[..self.buffers.len() - 1]
    }

    fn pictures(&self) -> BufferId {
        self.buffers[self.buffers.len() - 1]
    }
}

/// The encoder's memories, a double buffer, if its graph takes them as inputs.
struct EncoderMemories {
    /// If the stream is kept, the current side has the state after the last appended picture, and the encoder writes the other.
    sides: [Vec<BufferId>; 2],
    /// Index of the side with the committed state.
    current: usize,
    /// `continued[i]` reads side i and writes the other.
    continued: [BindingId; 2],
    /// `fresh[i]` starts from zeroed memories and writes side i.
    fresh: [BindingId; 2],
    /// Finite checks of both sides, for [`ExecutionContext::find_not_finite`].
    finite_checks: [FiniteCheckId; 2],
    /// Whether each append continues from the encoder's state after the previous one.
    continues_stream: bool,
}

/// A decoded latent that is not committed yet.
pub(super) struct PendingDecode {
    /// The side with its memories and pictures.
    side: usize,
    /// Backup of the committed side, if decoding overwrote it.
    backup: Option<Backup>,
}

impl PendingDecode {
    /// Index of its side in [`Autoencoder::sides`].
    pub(super) fn side(&self) -> usize {
        self.side
    }
}

impl EncoderMemories {
    /// `None` if the graph takes no memories.
    fn new(
        context: &mut dyn ExecutionContext,
        world: &World,
        pictures: BufferId,
        latent: BufferId,
    ) -> Result<Option<Self>> {
        let element = crate::runtime::element_size(world.precision());
        let shapes = &world.manifest().geometry.autoencoder.encoder_memories;
        if shapes.is_empty() {
            return Ok(None);
        }
        let mut set = || -> Result<Vec<BufferId>> {
            let bytes = |m: &[u32; 3]| m.iter().map(|&n| n as usize).product::<usize>() * element;
            shapes.iter().map(|shape| context.buffer(bytes(shape))).collect()
        };
        let (zeroes, sides) = (set()?, [set()?, set()?]);
        let mut bind = |from: &[BufferId], to: &[BufferId]| {
            let tensors: Vec<_> = [&[pictures][..], from, &[latent], to].into_iter().flatten().copied().collect();
            context.bind(&world.encoder, &tensors)
        };
        let continued = [bind(&sides[0], &sides[1])?, bind(&sides[1], &sides[0])?];
        let fresh = [bind(&zeroes, &sides[0])?, bind(&zeroes, &sides[1])?];
        let precision = world.precision();
        let finite_checks =
            [context.add_finite_check(&[&sides[0]], precision)?, context.add_finite_check(&[&sides[1]], precision)?];
        Ok(Some(Self { sides, current: 0, continued, fresh, finite_checks, continues_stream: false }))
    }
}

/// A rollout's autoencoder.
///
/// The decoder alternates between two sides: it reads one side's memories and writes the other's, so that a failure leaves the
/// committed side unchanged.
pub(super) struct Autoencoder {
    shapes: Shapes,
    precision: Precision,
    /// Binding of an encoder without memories, which starts anew with each latent; `None` if the encoder has memories.
    stateless_encoder: Option<BindingId>,
    encoder_memories: Option<EncoderMemories>,
    encoder_pictures: BufferId,
    /// `decode[i]` reads side i and writes the other.
    decode: [BindingId; 2],
    sides: [DecoderSide; 2],
    /// Index of the side with the committed state.
    current: usize,
}

impl Autoencoder {
    /// Binds both graphs; the encoder writes `latent` and the decoder reads it.
    pub(super) fn new(context: &mut dyn ExecutionContext, world: &World, latent: BufferId) -> Result<Self> {
        let element = crate::runtime::element_size(world.precision());
        let pictures_bytes = world.shapes.pictures * world.shapes.picture_len() * element;
        let encoder_pictures = context.buffer(pictures_bytes)?;
        let memories = EncoderMemories::new(context, world, encoder_pictures, latent)?;
        let stateless_encoder = match memories {
            Some(_) => None,
            None => Some(context.bind(&world.encoder, &[encoder_pictures, latent])?),
        };
        let shapes = &world.manifest().geometry.autoencoder.memories;
        let mut side = || -> Result<DecoderSide> {
            let bytes = |m: &[u32; 3]| m.iter().map(|&n| n as usize).product::<usize>() * element;
            let sizes = shapes.iter().map(bytes).chain([pictures_bytes]);
            Ok(DecoderSide { buffers: sizes.map(|bytes| context.buffer(bytes)).collect::<Result<_>>()? })
        };
        let sides = [side()?, side()?];
        let mut bind = |from: &DecoderSide, to: &DecoderSide| {
            let tensors: Vec<_> = [&[latent][..], from.memories(), &[to.pictures()], to.memories()]
                .into_iter()
                .flatten()
                .copied()
                .collect();
            context.bind(&world.decoder, &tensors)
        };
        let decode = [bind(&sides[0], &sides[1])?, bind(&sides[1], &sides[0])?];
        let (shapes, precision) = (world.shapes, world.precision());
        Ok(Self {
            shapes,
            precision,
            stateless_encoder,
            encoder_memories: memories,
            encoder_pictures,
            decode,
            sides,
            current: 0,
        })
    }

    /// Encodes pictures of any size to a latent: as many as a latent has, or one, which is repeated. Each is resized first. If the
    /// encoder's stream is kept, waits and returns whether the new memories are finite;
    /// [`commit_encoding`](Self::commit_encoding) makes them current. Otherwise returns true.
    pub(super) fn encode(&self, context: &mut dyn ExecutionContext, pictures: &[impl Borrow<Picture>]) -> Result<bool> {
        if pictures.len() != 1 && pictures.len() != self.shapes.pictures {
            let cause = format!("{} pictures make no latent", pictures.len());
            return Err(Error::new(ErrorKind::InvalidArgument, cause)
                .field("pictures")
                .remedy(format!("Give 1 or {}", self.shapes.pictures)));
        }
        let [height, width] = self.shapes.decoded;
        let mut rgb = allocate::zeroed(self.shapes.pictures * self.shapes.picture_len())?;
        for (i, planes) in rgb.chunks_exact_mut(self.shapes.picture_len()).enumerate() {
            let picture: &Picture = pictures[i % pictures.len()].borrow();
            Bilinear::new(picture.size(), (width as u32, height as u32)).to_planes(picture, planes);
        }
        Uploader::new(self.precision, rgb.len())?.upload(context, self.encoder_pictures, &rgb)?;
        match &self.encoder_memories {
            Some(memories) if memories.continues_stream => {
                context.run(memories.continued[memories.current])?;
                Ok(context.find_not_finite(memories.finite_checks[1 - memories.current])?.is_none())
            }
            Some(memories) => context.run(memories.fresh[1 - memories.current]).map(|()| true),
            None => self.stateless_encoder.map_or(Ok(()), |binding| context.run(binding)).map(|()| true),
        }
    }

    /// Makes the memories of the last encoding current, if the encoder's stream is kept.
    pub(super) fn commit_encoding(&mut self) {
        if let Some(memories) = self.encoder_memories.as_mut().filter(|memories| memories.continues_stream) {
            memories.current = 1 - memories.current;
        }
    }

    /// Whether appended pictures continue the encoder's stream.
    pub(super) fn keeps_stream(&self) -> bool {
        self.encoder_memories.as_ref().is_some_and(|memories| memories.continues_stream)
    }

    /// Sets whether appended pictures continue the encoder's stream. One that is kept starts anew, with zeroed memories.
    pub(super) fn keep_stream(&mut self, context: &mut dyn ExecutionContext, continues_stream: bool) -> Result<()> {
        match &mut self.encoder_memories {
            Some(memories) if memories.continues_stream || continues_stream => {
                context.clear(&memories.sides[memories.current])?;
                memories.continues_stream = continues_stream;
                Ok(())
            }
            None if continues_stream => Err(Error::new(
                ErrorKind::Unsupported,
                "the bundle's encoder is not handed its memories, so that each appended picture starts anew",
            )
            .field("keep")
            .remedy("Build the bundle with --streaming-encoder")),
            _ => Ok(()),
        }
    }

    /// Decodes the latent. Before that, decodes it `prime` times only to fill the memories; [`commit`](Self::commit) or
    /// [`undo`](Self::undo) must follow. Does not wait, and does not check for finite values. If it fails, the committed side is
    /// unchanged.
    pub(super) fn decode(&self, context: &mut dyn ExecutionContext, prime: u32) -> Result<PendingDecode> {
        // The first run writes the side that is not committed, the second overwrites the committed one, and so on.
        let backup = if prime > 0 { Some(context.back_up(&self.sides[self.current].buffers)?) } else { None };
        let side = 1 - (self.current + prime as usize) % 2;
        let decoding = PendingDecode { side, backup };
        let mut runs = 0..=prime;
        match runs.try_for_each(|run| context.run(self.decode[(self.current + run as usize) % 2])) {
            Ok(()) => Ok(decoding),
            Err(error) => {
                self.undo(context, decoding)?;
                Err(error)
            }
        }
    }

    /// Makes the decoded side the committed one.
    pub(super) fn commit(&mut self, decoding: PendingDecode) {
        self.current = decoding.side;
    }

    /// Restores the committed side if decoding overwrote it.
    pub(super) fn undo(&self, context: &mut dyn ExecutionContext, decoding: PendingDecode) -> Result<()> {
        decoding.backup.map_or(Ok(()), |backup| context.restore_backup(backup))
    }

    /// Fills `planes`, `[3, H, W]`, with picture `i` of the last decoded latent.
    pub(super) fn read(&self, context: &dyn ExecutionContext, i: usize, planes: &mut [f32]) -> Result<()> {
        convert::read(
            context,
            self.precision,
            self.sides[self.current].pictures(),
            i * self.shapes.picture_len(),
            planes,
        )
    }

    /// Buffer of the last decoded pictures, `[pictures, 3, H, W]`.
    pub(super) fn pictures(&self) -> BufferId {
        self.sides[self.current].pictures()
    }

    /// Buffers of decoded pictures of both sides, of which the decoder writes one or the other.
    pub(super) fn pictures_of_both_sides(&self) -> [BufferId; 2] {
        self.sides.each_ref().map(DecoderSide::pictures)
    }

    /// Memories and pictures of both sides.
    pub(super) fn sides(&self) -> [&[BufferId]; 2] {
        [&self.sides[0].buffers, &self.sides[1].buffers]
    }

    /// The decoder's memories in the bundle's order, then the last pictures.
    pub(super) fn decoder_state(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.sides[self.current].buffers.iter().copied()
    }

    /// The encoder's current memories; empty if its stream is not kept.
    pub(super) fn encoder_state(&self) -> impl Iterator<Item = BufferId> + '_ {
        let kept = self.encoder_memories.iter().filter(|memories| memories.continues_stream);
        kept.flat_map(|memories| memories.sides[memories.current].iter().copied())
    }
}
