//! The paper's Table 5: what each branch retains and loses, scene by scene. The paper bases it on visual inspection; here it is based on
//! measurements.

use scenes::Family;

use super::super::branch::Branch;
use super::super::plan::Settings;
use super::super::score::SceneScores;
use super::super::summary::RolloutMetrics;
use super::measured::of_branch;
use super::paper::evidence;
use super::{Block, Table};

/// Change of brightness or warmth that counts as a drift, in steps of 0 to 255.
const DRIFT: f64 = 4.0;

pub(super) fn table(settings: &Settings, scored: &[SceneScores]) -> Vec<Block> {
    let rows = settings.families.iter().map(|&family| {
        let [keeps, fails, figure] = evidence(family);
        vec![
            family.name().to_owned(),
            keeps.to_owned(),
            description(scored, family, Branch::Coherence),
            fails.to_owned(),
            description(scored, family, Branch::Baseline),
            figure.to_owned(),
        ]
    });
    let head = [
        "scene",
        "paper: coherence retains",
        "here: coherence",
        "paper: the baseline fails by",
        "here: baseline",
        "figure",
    ];
    vec![
        Block::heading("Table 5: evidence scene by scene"),
        Block::Table(Table::new(head.len(), &head, rows.collect())),
        Block::text(
            "The paper's words are of somebody who looked at its videos. Ours are read off the figures below: when a walk is \
             lost, how near it is to the truth, and where its brightness or its colours go. Neither is measured by the other. A horizon \
             depends on which pictures of a latent are shown, as decoded-60 shows under \"Against the renderer's truth\".",
        ),
    ]
}

/// Describes a branch in a scene by its measurements.
fn description(scored: &[SceneScores], family: Family, branch: Branch) -> String {
    let of = |value: fn(&RolloutMetrics) -> Option<f64>| {
        of_branch(scored, family, branch, value).map(|estimate| estimate.mean)
    };
    let mut parts = Vec::new();
    if let Some(horizon) = of(|f| f.horizon) {
        parts.push(format!("horizon {horizon:.1} s"));
    }
    if let Some(lpips) = of(|f| f.lpips) {
        parts.push(format!("LPIPS {lpips:.3} to the truth"));
    }
    for (value, up, down) in
        [(of(|f| f.brightness_drift), "brighter", "darker"), (of(|f| f.warmth_drift), "warmer", "colder")]
    {
        if let Some(drift) = value.filter(|drift| drift.abs() >= DRIFT) {
            parts.push(format!("{} by {:.0} at worst", if drift > 0.0 { up } else { down }, drift.abs()));
        }
    }
    if parts.is_empty() { "not measured".into() } else { parts.join(", ") }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::scene_id::SceneId;

    #[test]
    fn figures_are_told_in_words() {
        let scene = |seed, drift| SceneScores {
            scene: SceneId { family: Family::Snow, seed },
            key: String::new(),
            truth: RolloutMetrics::default(),
            branches: vec![(
                Branch::Baseline,
                RolloutMetrics {
                    horizon: Some(3.0),
                    lpips: Some(0.25),
                    brightness_drift: Some(drift),
                    warmth_drift: Some(-20.0),
                    ..RolloutMetrics::default()
                },
            )],
            series: Vec::new(),
            same_before_turn: true,
            file: PathBuf::new(),
        };
        let scored = [scene(41, 1.0), scene(42, 3.0)];
        let text = description(&scored, Family::Snow, Branch::Baseline);
        assert_eq!(text, "horizon 3.0 s, LPIPS 0.250 to the truth, colder by 20 at worst");
        assert_eq!(description(&scored, Family::Snow, Branch::Coherence), "not measured");
    }
}
