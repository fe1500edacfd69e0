//! Keeps finished walks, so that a measurement that was stopped goes on where it was.

use std::path::PathBuf;

use cairn::{Picture, Result};

use super::place::TestWalk;
use super::walk::{Shown, WalkScores};
use crate::experiment::result_cache::{ResultCache, read};
use crate::picture::{decode, paste};
use media::encode_png;

/// Changes when walks are measured in another way.
const VERSION: u32 = 1;

/// The folder of kept walks.
pub(super) struct Store(ResultCache);

impl Store {
    /// Walks in `folder` that were measured with exactly the inputs that `parts` describe.
    pub(super) fn new(folder: PathBuf, parts: &[String]) -> Self {
        Self(ResultCache::new(folder, VERSION, parts))
    }

    /// The walk through `place`, with its pictures; `None` unless it was kept whole.
    ///
    /// # Errors
    /// `Io`.
    pub(super) fn find(&self, place: TestWalk) -> Result<Option<(WalkScores, Shown)>> {
        let name = place.key();
        let (Some(scores), Some(picture)) = (self.0.find::<WalkScores>(&name)?, read(&self.0.path(&name, "png"))?)
        else {
            return Ok(None);
        };
        // A damaged picture counts as absent.
        let shown = decode(&picture).and_then(|picture| columns(&picture, scores.horizons.len()));
        Ok(shown.ok().map(|shown| (scores, shown)))
    }

    /// Keeps a walk.
    ///
    /// # Errors
    /// `Io`.
    pub(super) fn keep(&self, place: TestWalk, scores: &WalkScores, shown: &Shown) -> Result<()> {
        let name = place.key();
        let picture = (self.0.path(&name, "png"), encode_png(&strip(shown)?)?);
        self.0.store(&name, scores, vec![picture])
    }
}

/// One picture with a column for each pair and its first picture on top.
fn strip(shown: &Shown) -> Result<Picture> {
    let (width, height) = shown.first().map_or((1, 1), |pair| pair[0].size());
    let mut strip = Picture::new(width * shown.len().max(1) as u32, 2 * height)?;
    for (column, pair) in (0..).zip(shown) {
        for (row, picture) in (0..).zip(pair) {
            paste(&mut strip, picture, (column * width, row * height));
        }
    }
    Ok(strip)
}

/// The pairs of a [`strip`].
fn columns(strip: &Picture, count: usize) -> Result<Shown> {
    let (width, height) = (strip.width() / count.max(1) as u32, strip.height() / 2);
    let part = |column: u32, row: u32| {
        let mut picture = Picture::new(width, height)?;
        for (y, out) in (0..).zip(picture.pixels_mut().chunks_exact_mut(width as usize)) {
            let start = ((row * height + y) * strip.width() + column * width) as usize;
            out.copy_from_slice(&strip.pixels()[start..start + width as usize]);
        }
        Ok(picture)
    };
    (0..count as u32).map(|column| Ok([part(column, 0)?, part(column, 1)?])).collect()
}

#[cfg(test)]
mod tests {
    use scenes::Family;

    use super::*;
    use crate::metrics::Score;
    use crate::world_quality::endurance::PictureStatistics;
    use crate::world_quality::walk::Horizon;

    fn picture(colour: u8) -> Picture {
        let mut picture = Picture::new(32, 18).unwrap();
        picture.pixels_mut().iter_mut().enumerate().for_each(|(i, px)| *px = [colour, i as u8, 7, 255]);
        picture
    }

    #[test]
    fn a_kept_walk_is_found_with_the_same_inputs_only() {
        let folder = tempfile::tempdir().unwrap();
        let store = |parts: &[&str]| {
            Store::new(folder.path().into(), &parts.iter().map(|p| (*p).to_owned()).collect::<Vec<_>>())
        };
        let still = PictureStatistics { brightness: 9.0, colour: [1.0, 2.0, 0.25], contrast: 3.0, detail: 4.0 };
        let score = Score { psnr: 20.25, ssim: 0.5, lpips: Some(0.1) };
        let horizon = |seconds| Horizon { seconds, world: score, repeat: score, reconstruction: score };
        let scores = WalkScores { horizons: vec![horizon(0.5), horizon(1.0)], ..WalkScores::empty(still) };
        let shown: Shown = vec![[picture(1), picture(2)], [picture(3), picture(4)]];
        let (place, other) = (TestWalk::Level(Family::Snow, 3), TestWalk::Unseen(Family::Snow, 3));
        let first = store(&["world", "60 s"]);
        assert!(first.find(place).unwrap().is_none());
        first.keep(place, &scores, &shown).unwrap();
        assert!(store(&["world", "60 s"]).find(place).unwrap() == Some((scores, shown)));
        assert!(first.find(other).unwrap().is_none() && store(&["world", "15 s"]).find(place).unwrap().is_none());
        std::fs::write(folder.path().join("snow-3.json"), b"{\"key\"").unwrap();
        assert!(first.find(place).unwrap().is_none(), "a record that is cut off is made again");
    }
}
