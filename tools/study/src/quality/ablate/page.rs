//! The page of rules.

use std::fmt::Write as _;

use super::{AblationSettings, Input, Loss, Rule};
use crate::quality::clips::Clip;
use crate::statistics;

/// A rule that loses less than this on every clip is not worth its code: dB and LPIPS.
const WORTH: [f64; 2] = [0.03, 0.0003];

/// A rule's losses with one input on one clip, the mean over its frames.
struct OnClip<'a> {
    input: Input,
    clip: &'a str,
    lost: [f64; 3],
}

/// The page. `lines` are those of each rule's own file, in the order of [`Rule::all`].
pub(super) fn text(
    settings: &AblationSettings,
    losses: &[Loss],
    lines: &[Option<usize>],
    clips: &[Box<dyn Clip>],
    left_out: &[String],
) -> String {
    let names: Vec<&str> = clips.iter().map(|clip| clip.name()).collect();
    let mut out = String::from(
        "# What each rule of the generator gains\n\n\
         Beside warping and visibility, the generator and `picture_flow` have rules for special cases. Each one is left out here, all others \
         stay, and the frames in the middle between two anchors are compared with the true ones. A rule that gains nothing is removed from \
         the library, unless no clip has what it is for: none of these has letterbox bars.\n\n",
    );
    _ = write!(
        out,
        "- **gain**: the mean over clips, for each source of motion and depth: PSNR in dB, then LPIPS in thousandths. Plus: frames are nearer \
         to the truth with the rule. Minus: they are nearer without it.\n\
         - **most**, **least**: the clips with the largest and the smallest gain in PSNR.\n\
         - **worth it**: the rule gains {} dB or {} LPIPS on at least one clip.\n\
         - **time**: of a frame with the rule, over that of a frame without it (median). For rules of `picture_flow` the extraction counts too.\n\
         - **lines**: of the rule's own file without tests. Other rules are parts of a stage.\n\n",
        WORTH[0], WORTH[1]
    );
    out += "| rule | lines | time |";
    for input in Input::ALL {
        _ = write!(out, " gain, motion {} |", input.label());
    }
    out += " most | least | |\n|---|--:|--:|--:|--:|--:|--:|---|---|---|\n";
    for (rule, lines) in Rule::all().into_iter().zip(lines) {
        let of_clips = by_clip(losses, rule, &names);
        let lines = lines.map_or_else(|| "in a stage".to_owned(), |lines| lines.to_string());
        _ = write!(out, "| {} | {lines} | {:.2} |", rule.label(), median_time(losses, rule));
        for input in Input::ALL {
            let mean =
                |i: usize| statistics::mean(of_clips.iter().filter(|on| on.input == input).map(|on| Some(on.lost[i])));
            match (mean(0), mean(2)) {
                (Some(psnr), Some(lpips)) if lpips.is_nan() => _ = write!(out, " {psnr:+.3} |"),
                (Some(psnr), Some(lpips)) => _ = write!(out, " {psnr:+.3} / {:+.2} |", 1000.0 * lpips),
                _ => out += " |",
            }
        }
        let by_psnr = |a: &&OnClip<'_>, b: &&OnClip<'_>| a.lost[0].total_cmp(&b.lost[0]);
        let extreme = |found: Option<&OnClip<'_>>| {
            let name = |on: &OnClip<'_>| format!("{:+.2}, {}, {}", on.lost[0], on.clip, on.input.label());
            found.map(name).unwrap_or_default()
        };
        _ = writeln!(
            out,
            " {} | {} | {} |",
            extreme(of_clips.iter().max_by(by_psnr)),
            extreme(of_clips.iter().min_by(by_psnr)),
            if is_worth_it(&of_clips) { "worth it" } else { "**gains nothing**" }
        );
    }
    let seeds: Vec<String> = settings.seeds.iter().map(ToString::to_string).collect();
    _ = write!(
        out,
        "\nMeasured on {} clips: {}. Scenes have seed {}; LPIPS is that of `{}`. No clip of the sealed set is among them. Few clips have cuts or \
         fades, so that the gain of the rules for these is that on such a clip, and not the mean.\n",
        names.len(),
        names.join(", "),
        seeds.join(", "),
        settings.lpips
    );
    if !left_out.is_empty() {
        _ = writeln!(out, "\nLeft out: {}.", left_out.join("; "));
    }
    _ = write!(out, "\n```sh\ncargo run --release -p study -- ablate{}\n```\n", options(settings));
    out
}

/// The options of the command that measures the same.
fn options(settings: &AblationSettings) -> String {
    let AblationSettings { clips, seeds, lpips, smoke, publish, .. } = settings;
    if *smoke {
        return " --smoke".to_owned();
    }
    let seeds = seeds.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
    let given = [("--clips", clips, "all"), ("--seeds", &seeds, "5"), ("--lpips", lpips, "alex")];
    let mut options = if *publish { " --publish".to_owned() } else { String::new() };
    for (option, value, _) in given.into_iter().filter(|(_, value, usual)| *value != usual) {
        _ = write!(options, " {option} {value}");
    }
    options
}

/// The means over the frames of each clip, for each input.
fn by_clip<'a>(losses: &[Loss], rule: Rule, clips: &[&'a str]) -> Vec<OnClip<'a>> {
    let mut found = Vec::new();
    for input in Input::ALL {
        for clip in clips {
            let of = || losses.iter().filter(|loss| loss.rule == rule && loss.input == input && loss.clip == *clip);
            let mean = |i: usize| statistics::mean(of().map(|loss| Some(loss.lost[i])));
            if let (Some(psnr), Some(ssim), Some(lpips)) = (mean(0), mean(1), mean(2)) {
                found.push(OnClip { input, clip, lost: [psnr, ssim, lpips] });
            }
        }
    }
    found
}

fn is_worth_it(of_clips: &[OnClip<'_>]) -> bool {
    of_clips.iter().any(|on| on.lost[0] >= WORTH[0] || on.lost[2] >= WORTH[1])
}

fn median_time(losses: &[Loss], rule: Rule) -> f64 {
    let mut times: Vec<f64> = losses.iter().filter(|loss| loss.rule == rule).map(|loss| loss.time).collect();
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Every rule's losses in every frame.
pub(super) fn csv(losses: &[Loss]) -> String {
    let mut text = "rule,motion,clip,psnr_lost,ssim_lost,lpips_lost,time\n".to_owned();
    for Loss { rule, input, clip, lost: [psnr, ssim, lpips], time } in losses {
        let rule = rule.label().replace(',', ";");
        let lpips = if lpips.is_nan() { String::new() } else { format!("{lpips:.6}") };
        _ = writeln!(text, "{rule},{},{clip},{psnr:.4},{ssim:.6},{lpips},{time:.3}", input.name());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loss(rule: Rule, clip: &str, psnr: f64, lpips: f64) -> Loss {
        Loss { rule, input: Input::Flow, clip: clip.into(), lost: [psnr, 0.0, lpips], time: 1.0 }
    }

    #[test]
    fn a_rule_is_worth_it_where_one_clip_gains() {
        let rule = Rule::all()[0];
        let worth = |losses: &[Loss]| is_worth_it(&by_clip(losses, rule, &["a", "b"]));
        assert!(!worth(&[loss(rule, "a", 0.02, 0.0), loss(rule, "b", -1.0, 0.0002)]));
        assert!(worth(&[loss(rule, "a", -2.0, 0.0), loss(rule, "b", 0.04, 0.0)]));
        assert!(worth(&[loss(rule, "a", -2.0, 0.0004)]));
        // One good frame of a clip is not enough, and other rules do not count.
        assert!(!worth(&[
            loss(rule, "a", 0.05, 0.0),
            loss(rule, "a", -0.05, 0.0),
            loss(Rule::all()[1], "b", 9.0, 9.0)
        ]));
    }

    #[test]
    fn times_are_medians() {
        let rule = Rule::all()[2];
        let losses: Vec<Loss> =
            [3.0, 1.0, 2.0].into_iter().map(|time| Loss { time, ..loss(rule, "a", 0.0, 0.0) }).collect();
        assert_eq!(median_time(&losses, rule), 2.0);
        assert!(median_time(&losses, Rule::all()[0]).is_nan());
    }
}
