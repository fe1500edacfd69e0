//! Pictures to latents and back: the encoder, and the streaming decoder with its memories.

use crate::bundle::Precision;
use crate::runtime::{Backup, BindingId, BufferId, Lane};
use crate::world::contract::Shapes;
use crate::world::numbers::{self, Uploader};
use crate::world::resize::Bilinear;
use crate::world::world::World;
use crate::{Picture, Result};

/// A set of the decoder's memories and the pictures that were decoded with them.
struct Side {
    /// The memories in the bundle's order, then the pictures.
    buffers: Vec<BufferId>,
}

impl Side {
    fn memories(&self) -> &[BufferId] {
        &self.buffers[..self.buffers.len() - 1]
    }

    fn rgb(&self) -> BufferId {
        self.buffers[self.buffers.len() - 1]
    }
}

/// A latent that was decoded and does not count yet.
pub(super) struct Decoding {
    /// Where its memories and pictures are.
    side: usize,
    /// The side that counts, where that was written.
    backup: Option<Backup>,
}

impl Decoding {
    /// Which of [`Autoencoder::sides`] it is in.
    pub(super) fn side(&self) -> usize {
        self.side
    }
}

/// A rollout's autoencoder.
///
/// The decoder goes back and forth between two sides: it reads one side's memories and writes the other's, so that a
/// failure leaves the side that counts as it was.
pub(super) struct Autoencoder {
    shapes: Shapes,
    precision: Precision,
    encode: BindingId,
    encoder_rgb: BufferId,
    /// `decode[i]` reads side i and writes the other.
    decode: [BindingId; 2],
    sides: [Side; 2],
    /// The side that counts.
    current: usize,
}

impl Autoencoder {
    /// Binds both graphs: `latent` is what the encoder writes and the decoder reads.
    pub(super) fn new(lane: &mut dyn Lane, world: &World, latent: BufferId) -> Result<Self> {
        let element = crate::runtime::element_size(world.precision());
        let pictures_bytes = world.shapes.pictures * world.shapes.picture_len() * element;
        let encoder_rgb = lane.buffer(pictures_bytes)?;
        let encode = lane.bind(&world.encoder, &[encoder_rgb, latent])?;
        let shapes = &world.manifest().geometry.autoencoder.memories;
        let mut side = || -> Result<Side> {
            let bytes = |m: &[u32; 3]| m.iter().map(|&n| n as usize).product::<usize>() * element;
            let sizes = shapes.iter().map(bytes).chain([pictures_bytes]);
            Ok(Side { buffers: sizes.map(|bytes| lane.buffer(bytes)).collect::<Result<_>>()? })
        };
        let sides = [side()?, side()?];
        let mut bind = |from: &Side, to: &Side| {
            let tensors: Vec<_> =
                [&[latent][..], from.memories(), &[to.rgb()], to.memories()].into_iter().flatten().copied().collect();
            lane.bind(&world.decoder, &tensors)
        };
        let decode = [bind(&sides[0], &sides[1])?, bind(&sides[1], &sides[0])?];
        let (shapes, precision) = (world.shapes, world.precision());
        Ok(Self { shapes, precision, encode, encoder_rgb, decode, sides, current: 0 })
    }

    /// Makes the latent of a still: `picture`, of any size, resized and repeated for each picture of a latent.
    pub(super) fn encode(&self, lane: &mut dyn Lane, picture: &Picture) -> Result<()> {
        let [height, width] = self.shapes.decoded;
        let mut rgb = numbers::zeroed(self.shapes.pictures * self.shapes.picture_len())?;
        let (first, rest) = rgb.split_at_mut(self.shapes.picture_len());
        Bilinear::new(picture.size(), (width as u32, height as u32)).to_planes(picture, first);
        rest.chunks_exact_mut(first.len()).for_each(|copy| copy.copy_from_slice(first));
        Uploader::new(self.precision, rgb.len())?.upload(lane, self.encoder_rgb, &rgb)?;
        lane.run(self.encode)
    }

    /// Decodes the latent, after decoding it `prime` times for the memories' sake alone, for [`commit`](Self::commit) or
    /// [`undo`](Self::undo). Nothing waits for it, and nobody has looked at its numbers. When it fails, the side that counts is as it
    /// was.
    pub(super) fn decode(&self, lane: &mut dyn Lane, prime: u32) -> Result<Decoding> {
        // One run writes the side that does not count. More runs come back to the one that does.
        let backup = if prime > 0 { Some(lane.back_up(&self.sides[self.current].buffers)?) } else { None };
        let side = 1 - (self.current + prime as usize) % 2;
        let decoding = Decoding { side, backup };
        let mut runs = 0..=prime;
        match runs.try_for_each(|run| lane.run(self.decode[(self.current + run as usize) % 2])) {
            Ok(()) => Ok(decoding),
            Err(error) => {
                self.undo(lane, decoding)?;
                Err(error)
            }
        }
    }

    /// Lets what was decoded count.
    pub(super) fn commit(&mut self, decoding: Decoding) {
        self.current = decoding.side;
    }

    /// Takes back what was decoded.
    pub(super) fn undo(&self, lane: &mut dyn Lane, decoding: Decoding) -> Result<()> {
        decoding.backup.map_or(Ok(()), |backup| lane.put_back(backup))
    }

    /// Fills `planes`, `[3, H, W]`, with picture `i` of the last decoded latent.
    pub(super) fn read(&self, lane: &dyn Lane, i: usize, planes: &mut [f32]) -> Result<()> {
        numbers::read(lane, self.precision, self.sides[self.current].rgb(), i * self.shapes.picture_len(), planes)
    }

    /// Where the last decoded pictures are, `[pictures, 3, H, W]`.
    #[cfg(windows)]
    pub(super) fn pictures(&self) -> BufferId {
        self.sides[self.current].rgb()
    }

    /// Memories and pictures of both sides.
    pub(super) fn sides(&self) -> [&[BufferId]; 2] {
        [&self.sides[0].buffers, &self.sides[1].buffers]
    }

    /// The buffers that make up the decoder's state and last pictures, in the order of the bundle's memories, pictures
    /// last.
    pub(super) fn state(&self) -> impl Iterator<Item = BufferId> + '_ {
        self.sides[self.current].buffers.iter().copied()
    }
}
