//! Named operating points: the clock table of the experiments.

use crate::world::operating_point::{CacheMode, GuidanceSource, OperatingPoint, Presentation};
use crate::world::schedule::Schedule;

/// A named operating point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Preset {
    /// The paper's method: fewer and better anchors, every second frame generated.
    Coherence,
    /// The paper's baseline at g128: 30 native pictures per second.
    Baseline128,
    /// The paper's baseline at g112.
    Baseline112,
    /// The other interpretation of the baseline: twice as many latents, each for 1/30 s of the script. Its window is the scene's
    /// baseline window, g128 by default (`baseline-doubled,g112`). A held key may move up to twice as fast, because ring and RoPE
    /// clocks count latents.
    BaselineDoubled,
    /// The anchors of `coherence`, with all four decoded pictures shown and nothing generated.
    Decoded60,
    /// More context and more passes than the paper: for experiments, not in the main tables.
    Heavy,
    /// Waypoint's own settings.
    Stock,
}

impl Preset {
    /// Every preset.
    pub const ALL: [Self; 7] = [
        Self::Coherence,
        Self::Baseline128,
        Self::Baseline112,
        Self::BaselineDoubled,
        Self::Decoded60,
        Self::Heavy,
        Self::Stock,
    ];

    /// Its name in texts and on command lines.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coherence => "coherence",
            Self::Baseline128 => "baseline-128",
            Self::Baseline112 => "baseline-112",
            Self::BaselineDoubled => "baseline-doubled",
            Self::Decoded60 => "decoded-60",
            Self::Heavy => "heavy",
            Self::Stock => "stock",
        }
    }

    /// The preset of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.name() == name)
    }

    /// The preset's operating point.
    pub fn operating_point(self) -> OperatingPoint {
        let generated = Presentation::Generated { rate: 30, guidance: GuidanceSource::Paper };
        let (g, schedule, latents_per_second, pictures_per_latent, presentation) = match self {
            Self::Coherence => (384, Schedule::Refined(10), 15, 1, generated),
            Self::Baseline128 => (128, Schedule::Refined(9), 15, 2, Presentation::Native),
            Self::Baseline112 => (112, Schedule::Refined(9), 15, 2, Presentation::Native),
            Self::BaselineDoubled => (128, Schedule::Refined(9), 30, 1, Presentation::Native),
            Self::Decoded60 => (384, Schedule::Refined(10), 15, 4, Presentation::Native),
            Self::Heavy => (512, Schedule::Refined(12), 15, 1, generated),
            Self::Stock => (128, Schedule::Stock, 15, 4, Presentation::Native),
        };
        OperatingPoint {
            global_window: g,
            schedule,
            cache_mode: CacheMode::Separate,
            latents_per_second,
            pictures_per_latent,
            presentation,
        }
    }
}

impl From<Preset> for OperatingPoint {
    fn from(preset: Preset) -> Self {
        preset.operating_point()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::time::WorldTime;

    /// The clock table for 15 s: latents, pictures, dropped, presented, presented rate, passes, window.
    #[test]
    fn fifteen_seconds_have_the_counts_of_the_clock_table() {
        let table = [
            ("coherence", 226, 226, 0, 451, 30, 10, 384),
            ("baseline-128", 226, 452, 1, 451, 30, 9, 128),
            ("baseline-112", 226, 452, 1, 451, 30, 9, 112),
            ("baseline-doubled", 451, 451, 0, 451, 30, 9, 128),
            ("decoded-60", 226, 904, 3, 901, 60, 10, 384),
            ("heavy", 226, 226, 0, 451, 30, 12, 512),
            ("stock", 226, 904, 3, 901, 60, 4, 128),
        ];
        let sampler = crate::bundle::Sampler {
            schedule: vec![1.0, 0.9, 0.75, 0.3, 0.0],
            sigma_rounding: crate::bundle::Rounding::Bf16,
        };
        assert_eq!(table.len(), Preset::ALL.len());
        for (name, latents, pictures, dropped, presented, rate, passes, g) in table {
            let point = Preset::from_name(name).unwrap().operating_point();
            point.check().unwrap();
            let counts = point.counts(WorldTime::new(15, 1));
            assert_eq!((counts.latents, counts.steps), (latents, latents - 1), "{name}");
            assert_eq!((counts.pictures, counts.dropped), (pictures, dropped), "{name}");
            assert_eq!((counts.presented, point.presented_rate()), (presented, rate), "{name}");
            assert_eq!(point.schedule.table(&sampler).unwrap().passes(), passes, "{name}");
            assert_eq!((point.global_window, point.cache_mode), (g, CacheMode::Separate), "{name}");
            if point.presentation == Presentation::Native {
                assert_eq!(counts.pictures - counts.dropped, counts.presented, "{name}");
            }
        }
    }

    #[test]
    fn only_presets_that_generate_have_guidance() {
        for preset in Preset::ALL {
            let generates = matches!(preset, Preset::Coherence | Preset::Heavy);
            let expected = Presentation::Generated { rate: 30, guidance: GuidanceSource::Paper };
            assert_eq!(preset.operating_point().presentation == expected, generates);
        }
    }
}
