//! The rules that can be left out, with what the page says about them.

use std::fs;

use cairn::Result;
use cairn::framegen::cpu;
use cairn::guidance::picture_flow;

use media::describe_io;

/// A rule of the generator or of `picture_flow`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    Generator(cpu::Rule),
    Flow(picture_flow::Rule),
}

impl Rule {
    /// All rules, in the order of the page.
    pub(super) fn all() -> Vec<Self> {
        let generator = cpu::Rule::ALL.into_iter().map(Self::Generator);
        generator.chain(picture_flow::Rule::ALL.into_iter().map(Self::Flow)).collect()
    }

    /// What it does, as a short clause.
    pub(super) fn label(self) -> &'static str {
        use cpu::Rule as G;
        use picture_flow::Rule as F;
        match self {
            Self::Generator(G::CutDetection) => "cut detection",
            Self::Generator(G::LetterboxBars) => "letterbox bars are static",
            Self::Generator(G::MatchAsDepth) => "match as depth order, where depth is constant",
            Self::Generator(G::EdgeDilation) => "nearer surfaces dilated over their anti-aliased edges",
            Self::Generator(G::PreviousDepth) => "the previous anchor's depth",
            Self::Generator(G::NeighboursMotion) => "reprojected pixels follow a moving neighbour",
            Self::Generator(G::CameraFit) => "camera fit: perspective-correct phases",
            Self::Generator(G::FillByLikeness) => "hole filling by likeness of brightness",
            Self::Generator(G::CrackClosing) => "cracks of a pixel closed",
            Self::Generator(G::ForegroundEdges) => "edge pixels follow the foreground",
            Self::Generator(G::StaticOverlays) => "static overlays found, where there is no mask of them",
            Self::Generator(G::EdgeAntialiasing) => "anti-aliasing of edges without depth",
            Self::Generator(G::Inpainting) => "inpainting of pixels that are hidden in both anchors",
            Self::Flow(F::WideSearch) => "`picture_flow`: wide search on small levels",
            Self::Flow(F::RepeatedSearch) => "`picture_flow`: repeated search from smoothed motion",
            Self::Flow(F::GlobalModel) => "`picture_flow`: global model of motion",
            Self::Flow(F::ConsistencyCheck) => "`picture_flow`: forward-backward check",
            Self::Flow(F::FillByGradient) => "`picture_flow`: holes filled along the gradient",
        }
    }

    /// The source file that holds the rule and nothing else, relative to the repository's root.
    fn file(self) -> Option<&'static str> {
        use cpu::Rule as G;
        use picture_flow::Rule as F;
        match self {
            Self::Generator(G::CutDetection) => Some("src/framegen/cpu/cut.rs"),
            Self::Generator(G::LetterboxBars) => Some("src/framegen/cpu/letterbox.rs"),
            Self::Generator(G::PreviousDepth) => Some("src/framegen/cpu/reprojection.rs"),
            Self::Generator(G::CameraFit) => Some("src/framegen/cpu/camera_fit.rs"),
            Self::Generator(G::StaticOverlays) => Some("src/framegen/cpu/static_overlay.rs"),
            Self::Generator(G::EdgeAntialiasing) => Some("src/framegen/cpu/edge_antialiasing.rs"),
            Self::Generator(G::Inpainting) => Some("src/framegen/cpu/inpaint.rs"),
            Self::Flow(F::WideSearch) => Some("src/guidance/picture_flow/wide.rs"),
            Self::Flow(F::GlobalModel) => Some("src/guidance/picture_flow/model.rs"),
            Self::Flow(F::ConsistencyCheck) => Some("src/guidance/picture_flow/consistency.rs"),
            _ => None,
        }
    }

    /// Lines of [`Self::file`] before its tests; `None` for a rule within a stage.
    ///
    /// # Errors
    /// `Io` where the repository's sources are not at hand.
    pub(super) fn lines(self) -> Result<Option<usize>> {
        let Some(file) = self.file() else { return Ok(None) };
        let path = provision::repository().join(file);
        let text = fs::read_to_string(&path).map_err(|e| describe_io("cannot be read", &path, &e))?;
        let code = text.split_once("\n#[cfg(test)]\nmod tests {").map_or(&*text, |(code, _)| code);
        Ok(Some(code.lines().count()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rule_has_a_label_of_its_own_and_its_file_exists() {
        let mut labels: Vec<&str> = Rule::all().into_iter().map(Rule::label).collect();
        labels.sort_unstable();
        labels.dedup();
        assert_eq!(labels.len(), Rule::all().len());
        for rule in Rule::all() {
            let lines = rule.lines().unwrap();
            assert_eq!(lines.is_some(), rule.file().is_some(), "{}", rule.label());
            // A rule is more than its imports.
            assert!(lines.is_none_or(|lines| lines > 40), "{}: {lines:?} lines", rule.label());
        }
    }
}
