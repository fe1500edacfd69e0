//! The truth of a walk, and a rollout's distance from it, twice a second.

use std::sync::Arc;

use cairn::world::{OperatingPoint, World};
use cairn::{Picture, Result};
use serde::{Deserialize, Serialize};

use super::super::endurance::PictureStatistics;
use super::super::place::{Course, TestWalk};
use super::super::walk::{begin, picture_of, step, step_at};
use crate::metrics::{Lpips, Score};
use crate::statistics::mean;

/// Pictures of a second that are compared.
pub(super) const PER_SECOND: u32 = 2;

/// A picture of a rollout beside the true one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Sample {
    pub(super) score: Score,
    pub(super) statistics: PictureStatistics,
}

/// Those of a walk, in the order of time: the first one is half a second after the start.
pub(super) type Samples = Vec<Sample>;

/// A true walk.
pub(super) struct Walk {
    first: Picture,
    /// True pictures, for a sample each.
    pictures: Vec<Picture>,
    pub(super) truth: Truth,
}

/// Values of a true walk.
pub(super) struct Truth {
    /// Scores of the first picture, repeated.
    pub(super) repeat: Samples,
    /// Statistics of the true pictures.
    pub(super) statistics: Vec<PictureStatistics>,
}

/// The latent steps that are sampled.
fn sampled(point: &OperatingPoint, seconds: u32) -> impl Iterator<Item = u64> + '_ {
    (1..=seconds * PER_SECOND).map(|number| step_at(point, f64::from(number) / f64::from(PER_SECOND)))
}

fn sample(truth: &Picture, picture: &Picture, lpips: Option<&Lpips>) -> Result<Sample> {
    let lpips = lpips.map(|lpips| lpips.compare(truth, picture)).transpose()?;
    Ok(Sample { score: Score::new(truth, picture, lpips)?, statistics: PictureStatistics::of(picture) })
}

impl Walk {
    /// Draws the true walk.
    ///
    /// # Errors
    /// `InvalidArgument` for an operating point whose rate no walk has; errors of `proceed`, which is called for each picture.
    pub(super) fn new(
        course: &Course,
        size: (u32, u32),
        point: &OperatingPoint,
        seconds: u32,
        lpips: Option<&Lpips>,
        proceed: &dyn Fn() -> Result<()>,
    ) -> Result<Self> {
        let mut clip = course.clip(size, point.latents_per_second)?;
        let first = clip.next_frame()?.frame.picture;
        let (mut pictures, mut at) = (Vec::new(), 1);
        for wanted in sampled(point, seconds) {
            proceed()?;
            for _ in at..wanted {
                clip.advance()?;
            }
            pictures.push(clip.next_frame()?.frame.picture);
            at = wanted + 1;
        }
        let repeat = pictures.iter().map(|truth| sample(truth, &first, lpips)).collect::<Result<_>>()?;
        let statistics = pictures.iter().map(PictureStatistics::of).collect();
        Ok(Self { first, pictures, truth: Truth { repeat, statistics } })
    }
}

impl Truth {
    /// The LPIPS at which nothing of the first picture remains: its mean distance from the second half of the walk.
    pub(super) fn lpips_of_lost(&self) -> Option<f64> {
        mean(self.repeat[self.repeat.len() / 2..].iter().map(|sample| sample.score.lpips))
    }
}

/// Makes the walk in `world`. `on_latent` is called for each latent, and its error ends the rollout.
///
/// # Errors
/// Errors of making latents, and of `on_latent`.
pub(super) fn rollout(
    place: TestWalk,
    course: &Course,
    walk: &Walk,
    world: &Arc<World>,
    point: &OperatingPoint,
    lpips: Option<&Lpips>,
    on_latent: &dyn Fn() -> Result<()>,
) -> Result<Samples> {
    let mut rollout = begin(place, &walk.first, world, point)?;
    let (mut samples, mut made) = (Vec::new(), 0);
    let seconds = walk.pictures.len() as u32 / PER_SECOND;
    for (truth, wanted) in walk.pictures.iter().zip(sampled(point, seconds)) {
        for q in made + 1..=wanted {
            step(&mut rollout, &course.script, point, q)?;
            on_latent()?;
        }
        made = wanted;
        samples.push(sample(truth, &picture_of(&mut rollout, world, point)?, lpips)?);
    }
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use cairn::world::Preset;

    use super::*;

    #[test]
    fn samples_are_at_each_half_second() {
        let point = Preset::Stock.operating_point();
        let rate = u64::from(point.latents_per_second);
        let steps: Vec<u64> = sampled(&point, 3).collect();
        assert_eq!(steps.len(), 6);
        assert_eq!((steps[1], steps[3], steps[5]), (rate, 2 * rate, 3 * rate));
    }
}
