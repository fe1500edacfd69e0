//! The world inside the library, and the picture with which a rollout begins.

use std::sync::Arc;

use cairn::bundle::{Bundle, OpenOptions, Precision};
use cairn::runtime::Device;
use cairn::world::{
    CacheMode, ControlInput, Key, KeySet, OperatingPoint, Preset, Rollout, Schedule, World, WorldOptions,
};
use cairn::{Picture, Result};

use crate::finding::Finding;

/// A binary PPM of 320 x 180 pixels: the start of the path through the level of the desert.
const PLACE: &[u8] = include_bytes!("../../../../samples/worlds/place.ppm");
const HEADER: &[u8] = b"P6\n320 180\n255\n";

/// The picture of the place.
pub(super) fn place() -> Result<Picture> {
    let pixels = PLACE.strip_prefix(HEADER).unwrap_or_default();
    Picture::from_rgba(320, 180, pixels.chunks_exact(3).flat_map(|px| [px[0], px[1], px[2], 255]).collect())
}

/// The embedded world on a device.
pub(super) fn world(device: &Device, precision: Precision) -> std::result::Result<Arc<World>, Finding> {
    let bundle = Bundle::embedded(&OpenOptions::default())?;
    let options = WorldOptions { precision: Some(precision), ..WorldOptions::default() };
    Ok(World::load(device, &bundle, options)?)
}

/// The operating point of the checks: four passes and one picture per latent, at the world's own window.
pub(super) fn point(world: &World) -> OperatingPoint {
    OperatingPoint {
        global_window: world.global_window(),
        schedule: Schedule::Stock,
        cache_mode: CacheMode::Separate,
        latents_per_second: 15,
        pictures_per_latent: 1,
        ..Preset::Decoded60.operating_point()
    }
}

/// A rollout that begins in the place, whose picture it encodes.
pub(super) fn rollout(world: &Arc<World>) -> Result<Rollout> {
    let mut rollout = Rollout::new(world, &point(world), 7)?;
    rollout.append(&place()?)?;
    Ok(rollout)
}

/// A rollout that goes on from a saved state.
pub(super) fn restored(world: &Arc<World>, state: &[u8]) -> Result<Rollout> {
    let mut rollout = Rollout::new(world, &point(world), 1)?;
    rollout.restore(state)?;
    Ok(rollout)
}

/// A rollout in the place: from a saved state if there is one, else it encodes the picture.
#[cfg(windows)]
pub(super) fn begin(world: &Arc<World>, state: Option<&[u8]>) -> Result<Rollout> {
    state.map_or_else(|| rollout(world), |state| restored(world, state))
}

/// Makes the steps of a walk that turns.
pub(super) fn walk(rollout: &mut Rollout, steps: std::ops::Range<u64>) -> Result<()> {
    for i in steps {
        let mut keys = KeySet::NONE;
        keys.insert(Key(b'W'));
        rollout.step(&ControlInput::new([3.0 + (i % 3) as f32, 0.0], keys, 0.0)?)?;
    }
    Ok(())
}

/// The bits of a rollout: its saved state, its latent and its picture.
pub(super) fn unaltered_bits(rollout: &mut Rollout) -> Result<Vec<u8>> {
    let mut all = rollout.save()?;
    all.extend(rollout.latent()?.iter().flat_map(|v| v.to_bits().to_le_bytes()));
    all.extend_from_slice(picture(rollout)?.rgba());
    Ok(all)
}

/// The same, of the rollout that is checked against another.
pub(super) fn bits(rollout: &mut Rollout) -> Result<Vec<u8>> {
    let mut all = unaltered_bits(rollout)?;
    gpu_testing::fault::alter(&mut all);
    Ok(all)
}

/// The picture of the last step.
pub(super) fn picture(rollout: &mut Rollout) -> Result<Picture> {
    let mut picture = Picture::new(1, 1)?;
    rollout.read_picture(0, &mut picture)?;
    Ok(picture)
}
