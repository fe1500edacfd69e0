//! What the figures of the page do not show.

/// Paragraphs below the page's first one.
pub(super) const LIMITS: &str = "\
**What this is measured on.** Development sets: our own scenes, still ones and ones in which things move, film, and a game. Constants were not \
fitted to them, but rules were kept or removed by them, and their figures were read while the generator was developed. No constant was fitted \
to [the sealed set](quality-sealed.md), and no rule chosen by it. In the still scenes only the camera and a held item move, \
and with true motion and depth Cairn gets what no engine gives: exact ones. A cell is the mean of the few clips that its head counts, and claims \
are judged by such means, without an interval.

**Outside figures.** A measurement on footage that is not in this repository found Cairn behind others: with the motion and depth of a real \
engine, behind RIFE, and behind AMD's FSR in PSNR and SSIM, and nearer without that depth than with it; on fast hand-held film, behind RIFE, \
with smears that LPIPS rates worse than a blend of the anchors; around cuts and in fades, behind RIFE, and in fades by LPIPS behind a blend \
too; on animated film, behind RIFE; on smoke, behind RIFE in PSNR and SSIM. It found Cairn ahead of RIFE in a first-person game with a HUD. \
Since then `picture_flow` searches farther where pictures match poorly, forwards and back, which is meant for fast film, and rules that made \
frames with an engine's motion worse are gone; that footage was not measured again. Nothing was done about cuts, fades, animated film and \
smoke yet.
";
