//! Branches of the comparison: the operating points at which one world is run.

use cairn::world::{GuidanceSource, OperatingPoint, Presentation, Preset};
use scenes::Family;

/// One operating point; all branches share seed picture, controls and noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Branch {
    /// The paper's main branch: fewer and better anchors, every second frame generated.
    Coherence,
    /// The paper's baseline: two decoded pictures of each latent, nothing generated.
    Baseline,
    /// The other reading of "about 30 frames a second natively": twice as many latents.
    BaselineDoubled,
    /// The latents of [`Coherence`](Self::Coherence), with all four decoded pictures shown.
    Decoded60,
    /// More context and more passes: a probe, in no main table.
    Heavy,
}

impl Branch {
    /// Every branch. One that shows latents of another comes after it.
    pub(crate) const ALL: [Self; 5] =
        [Self::Coherence, Self::Baseline, Self::BaselineDoubled, Self::Heavy, Self::Decoded60];

    /// Name of the branch and of its folder.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Coherence => "coherence",
            Self::Baseline => "baseline",
            Self::BaselineDoubled => "baseline-doubled",
            Self::Decoded60 => "decoded-60",
            Self::Heavy => "heavy",
        }
    }

    /// The preset of the branch; the baseline's depends on the scene, as in the paper.
    pub(crate) fn preset(self, family: Family) -> Preset {
        match self {
            Self::Coherence => Preset::Coherence,
            Self::Baseline if family == Family::Forest => Preset::Baseline128,
            Self::Baseline => Preset::Baseline112,
            Self::BaselineDoubled => Preset::BaselineDoubled,
            Self::Decoded60 => Preset::Decoded60,
            Self::Heavy => Preset::Heavy,
        }
    }

    /// Operating point of the branch in a scene of that kind. The doubled baseline uses the context window of the scene's baseline.
    pub(crate) fn point(self, family: Family) -> OperatingPoint {
        let mut point = self.preset(family).operating_point();
        if self == Self::BaselineDoubled {
            point.global_window = Self::Baseline.preset(family).operating_point().global_window;
        }
        point
    }

    /// The branch whose latents this one shows, if it makes none of its own.
    pub(crate) fn shares_latents_of(self) -> Option<Self> {
        (self == Self::Decoded60).then_some(Self::Coherence)
    }

    /// Purpose of the branch.
    pub(crate) fn role(self) -> &'static str {
        match self {
            Self::Coherence => "the paper's operating point",
            Self::Baseline => "the paper's baseline",
            Self::BaselineDoubled => "the baseline's other reading: twice as many latents, keys as held",
            Self::Decoded60 => "the latents of coherence, every decoded picture shown",
            Self::Heavy => "a probe, not in the main comparison",
        }
    }
}

/// Cadence and presentation as the paper's Table 2 words them.
pub(crate) fn cadence(point: &OperatingPoint) -> String {
    let shown = point.presented_rate();
    match point.presentation {
        Presentation::Native => format!("{} latents -> {shown} native pictures a second", point.latents_per_second),
        Presentation::Generated { guidance, .. } => {
            let motion = match guidance {
                GuidanceSource::Paper | GuidanceSource::LatentFlow => "motion from latents",
                _ => "motion from pictures",
            };
            format!("{} anchors -> {shown} frames a second, {motion}", point.latents_per_second)
        }
    }
}

#[cfg(test)]
mod tests {
    use cairn::world::WorldTime;

    use super::*;

    #[test]
    fn every_branch_has_the_papers_window_and_counts() {
        let table = [
            (Branch::Coherence, [384, 384], 226, 451),
            (Branch::Baseline, [128, 112], 226, 451),
            (Branch::BaselineDoubled, [128, 112], 451, 451),
            (Branch::Decoded60, [384, 384], 226, 901),
            (Branch::Heavy, [512, 512], 226, 451),
        ];
        assert_eq!(table.len(), Branch::ALL.len());
        for (branch, windows, latents, presented) in table {
            for (family, window) in [Family::Forest, Family::Desert].into_iter().zip(windows) {
                let point = branch.point(family);
                point.check().unwrap();
                let counts = point.counts(WorldTime::new(15, 1));
                assert_eq!((point.global_window, counts.latents, counts.presented), (window, latents, presented));
            }
        }
    }

    #[test]
    fn latents_are_shared_by_branches_that_make_the_same() {
        for branch in Branch::ALL {
            let place = |b: Branch| Branch::ALL.iter().position(|other| *other == b).unwrap();
            if let Some(source) = branch.shares_latents_of() {
                assert!(place(source) < place(branch));
                let [a, b] = [source, branch].map(|b| b.point(Family::Snow));
                assert_eq!(
                    (a.global_window, &a.schedule, a.cache_mode, a.latents_per_second),
                    (b.global_window, &b.schedule, b.cache_mode, b.latents_per_second)
                );
            }
        }
    }

    #[test]
    fn cadences_read_as_in_the_papers_table() {
        assert_eq!(
            cadence(&Branch::Coherence.point(Family::Snow)),
            "15 anchors -> 30 frames a second, motion from latents"
        );
        assert_eq!(cadence(&Branch::Baseline.point(Family::Snow)), "15 latents -> 30 native pictures a second");
    }
}
