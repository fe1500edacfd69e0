//! Methods without motion.

use cairn::{Picture, Result};

use super::{Interval, Row};
use crate::quality::clips::Phase;

/// The nearer anchor.
pub(super) struct Repeat;

impl Row for Repeat {
    fn version(&self) -> String {
        "nearer anchor, the earlier one at 1/2".into()
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        let nearer = |p: &Phase| if p.value() <= 0.5 { interval.previous() } else { interval.current() };
        Ok(phases.iter().map(|phase| nearer(phase).clone()).collect())
    }
}

/// The weighted mean of both anchors, rounded to the nearest code value.
pub(super) struct Blend;

impl Row for Blend {
    fn version(&self) -> String {
        "weighted mean in code values".into()
    }

    fn make(&mut self, interval: &Interval<'_>, phases: &[Phase]) -> Result<Vec<Picture>> {
        phases.iter().map(|phase| blend(interval.previous(), interval.current(), phase.value())).collect()
    }
}

fn blend(previous: &Picture, current: &Picture, t: f32) -> Result<Picture> {
    let pairs = previous.rgba().iter().zip(current.rgba());
    let mixed = pairs.map(|(a, b)| (f32::from(*a) * (1.0 - t) + f32::from(*b) * t).round() as u8).collect();
    Picture::from_rgba(current.width(), current.height(), mixed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anchors_are_repeated_and_mixed_by_phase() {
        let grey = |v: u8| Picture::from_rgba(1, 1, vec![v, v, v, 255]).unwrap();
        let anchors = [grey(9), grey(100), grey(200)];
        let interval = Interval { anchors: &anchors, at: 1, guidance: None, before: None, overlay: None, history: &[] };
        let phases: Vec<Phase> = Phase::all(4).collect();
        let values = |row: &mut dyn Row| -> Vec<u8> {
            row.make(&interval, &phases).unwrap().iter().map(|p| p.rgba()[0]).collect()
        };
        assert_eq!(values(&mut Repeat), [100, 100, 200]);
        assert_eq!(values(&mut Blend), [125, 150, 175]);
    }
}
