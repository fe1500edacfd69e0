//! Figure 1: how frames are made in the two main branches.

use std::fmt::Write as _;

use cairn::world::OperatingPoint;
use scenes::Family;

use super::super::branch::Branch;
use super::super::plan::Settings;
use crate::document::escaped;

const WIDTH: u32 = 1060;
const HEIGHT: u32 = 400;
const BOX: [u32; 2] = [168, 64];

/// A box with its upper left corner at `[x, y]` and lines of text.
fn part(svg: &mut String, [x, y]: [u32; 2], colour: &str, words: &[String]) {
    // Writing to a string cannot fail.
    let _ = write!(
        svg,
        "<rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\" rx=\"8\" fill=\"{colour}33\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
        BOX[0], BOX[1]
    );
    let first = y + BOX[1] / 2 + 4 - 8 * (words.len() as u32 - 1);
    for (line, n) in words.iter().zip(0..) {
        let _ = write!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            x + BOX[0] / 2,
            first + 16 * n,
            escaped(line)
        );
    }
}

/// An arrow along a polyline.
fn arrow(svg: &mut String, points: &[[u32; 2]]) {
    let path: Vec<String> = points.iter().map(|[x, y]| format!("{x} {y}")).collect();
    let _ = write!(
        svg,
        "<path d=\"M{}\" fill=\"none\" stroke=\"#888\" stroke-width=\"1.5\" marker-end=\"url(#tip)\"/>",
        path.join("L")
    );
}

/// The drawing, with the context windows of the first scene.
pub(super) fn drawing(settings: &Settings) -> String {
    let family = settings.families.first().copied().unwrap_or(Family::Forest);
    let point = |branch: Branch| -> OperatingPoint { branch.point(family) };
    let (coherence, baseline) = (point(Branch::Coherence), point(Branch::Baseline));
    let world = |point: &OperatingPoint| {
        vec![
            format!("world, g{}", point.global_window),
            format!("{} + a cache pass", point.schedule),
            format!("{} latents a second", point.latents_per_second),
        ]
    };
    let words = |lines: &[&str]| lines.iter().map(|&line| line.to_owned()).collect::<Vec<_>>();
    let (blue, orange, green, grey) = ("#0072b2", "#d55e00", "#009e73", "#888888");
    let column = |n: u32| 8 + n * 218;
    let (upper, middle, lower) = (30, 150, 300);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" role=\"img\" \
         aria-label=\"From controls to frames\"><defs><marker id=\"tip\" viewBox=\"0 0 8 8\" refX=\"7\" refY=\"4\" markerWidth=\"7\" \
         markerHeight=\"7\" orient=\"auto\"><path d=\"M0 0L8 4L0 8z\" fill=\"#888\"/></marker></defs>"
    );
    let right = |x: u32| x + BOX[0];
    let centre = |y: u32| y + BOX[1] / 2;
    let below = |x: u32| x + BOX[0] / 2;
    part(&mut svg, [column(0), middle], grey, &words(&["seed picture,", "control script,", "seed of the noise"]));
    part(&mut svg, [column(1), upper], blue, &world(&coherence));
    part(&mut svg, [column(2), upper], blue, &words(&["decoder", "anchors I(t), I(t+1)"]));
    part(
        &mut svg,
        [column(2), middle],
        green,
        &words(&["guidance from latents", "motion -U(8 d)", "depth: a channel"]),
    );
    part(
        &mut svg,
        [column(3), upper],
        green,
        &[format!("generator: {}", settings.generator), "one frame half way".into(), "between two anchors".into()],
    );
    let shown =
        |point: &OperatingPoint, how: &str| vec![format!("{} frames a second", point.presented_rate()), how.to_owned()];
    part(&mut svg, [column(4), upper], blue, &shown(&coherence, "every second generated"));
    part(&mut svg, [column(1), lower], orange, &world(&baseline));
    part(
        &mut svg,
        [column(2), lower],
        orange,
        &["decoder".into(), format!("{} pictures of a latent", baseline.pictures_per_latent)],
    );
    part(&mut svg, [column(4), lower], orange, &shown(&baseline, "all of them decoded"));
    let from = right(column(0));
    for (y, to) in [(upper, column(1)), (lower, column(1))] {
        arrow(
            &mut svg,
            &[[from, centre(middle)], [from + 36, centre(middle)], [from + 36, centre(y)], [to, centre(y)]],
        );
    }
    for (from, to, y) in [(1, 2, upper), (2, 3, upper), (3, 4, upper), (1, 2, lower), (2, 4, lower)] {
        arrow(&mut svg, &[[right(column(from)), centre(y)], [column(to), centre(y)]]);
    }
    arrow(
        &mut svg,
        &[[below(column(1)), upper + BOX[1]], [below(column(1)), centre(middle)], [column(2), centre(middle)]],
    );
    arrow(
        &mut svg,
        &[[right(column(2)), centre(middle)], [below(column(3)), centre(middle)], [below(column(3)), upper + BOX[1]]],
    );
    let _ =
        write!(svg, "<text x=\"{}\" y=\"{}\">latents z(t), z(t+1)</text>", below(column(1)) + 8, centre(middle) - 8);
    svg + "</svg>"
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::compare::plan::tests::settings;

    #[test]
    fn the_drawing_tells_both_branches_of_the_scene() {
        let svg = drawing(&settings(Path::new("out")));
        for words in [
            "world, g384",
            "refined:10 + a cache pass",
            "world, g128",
            "refined:9 + a cache pass",
            "generator: cpu",
            "2 pictures of a latent",
        ] {
            assert!(svg.contains(words), "{words}");
        }
        assert_eq!(svg.matches("<rect").count(), 9);
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>"));
    }
}
