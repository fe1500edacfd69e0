//! SVG charts of points over compute: joined lines, intervals, a stepped Pareto front, and budgets.

use std::fmt::Write as _;

use crate::document::escaped;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 150.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 48.0;
/// Okabe and Ito's palette, which colour-blind readers can tell apart.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#888888"];

/// One point.
#[derive(Clone)]
pub(super) struct Mark {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) interval: Option<[f64; 2]>,
    /// Tooltip.
    pub(super) words: String,
    /// Label beside the point.
    pub(super) label: String,
}

/// Points drawn in one colour.
pub(super) struct Group {
    pub(super) name: String,
    pub(super) marks: Vec<Mark>,
}

/// A chart.
pub(super) struct Chart<'a> {
    pub(super) x: &'a str,
    pub(super) y: &'a str,
    pub(super) groups: &'a [Group],
    /// Whether the points of a group are joined by a line, in order.
    pub(super) joined: bool,
    /// Points of the front, from left to right.
    pub(super) front: &'a [[f64; 2]],
    /// Positions of vertical lines.
    pub(super) budgets: &'a [f64],
}

/// Range of an axis with a margin.
fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in values.filter(|value| value.is_finite()) {
        low = low.min(value);
        high = high.max(value);
    }
    let room = if high > low { (high - low) * 0.06 } else { high.abs().max(1e-3) * 0.1 };
    (low <= high).then_some([low - room, high + room])
}

/// Formats with as many digits as distinguish the axis labels.
fn number(value: f64, span: f64) -> String {
    let digits = (2.0 - span.abs().max(1e-9).log10()).ceil().clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}

impl Chart<'_> {
    /// The SVG; empty without points.
    pub(super) fn draw(&self) -> String {
        let marks = || self.groups.iter().flat_map(|group| &group.marks);
        let ys = marks().flat_map(|mark| [mark.y].into_iter().chain(mark.interval.into_iter().flatten()));
        let xs = marks().map(|mark| mark.x).chain(self.budgets.iter().copied());
        let (Some([left, right]), Some([low, high])) = (range(xs), range(ys)) else { return String::new() };
        let x = |value: f64| LEFT + (value - left) / (right - left) * (WIDTH - LEFT - RIGHT);
        let y = |value: f64| HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM);
        let (end, floor) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" role=\"img\">"
        );
        // Writing to a string cannot fail.
        for quarter in 0..=4 {
            let share = f64::from(quarter) / 4.0;
            let (at, over) = (low + (high - low) * share, left + (right - left) * share);
            let _ = write!(
                svg,
                "<path d=\"M{LEFT} {:.1}H{end}\" stroke=\"#8884\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                y(at),
                LEFT - 6.0,
                y(at) + 4.0,
                number(at, high - low),
                x(over),
                floor + 18.0,
                number(over, right - left)
            );
        }
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text x=\"12\" y=\"{:.1}\" text-anchor=\"middle\" transform=\"rotate(-90 12 {:.1})\">{}</text>",
            f64::midpoint(LEFT, end),
            HEIGHT - 10.0,
            escaped(self.x),
            f64::midpoint(TOP, floor),
            f64::midpoint(TOP, floor),
            escaped(self.y)
        );
        for budget in self.budgets {
            let at = x(*budget);
            let _ = write!(
                svg,
                "<path d=\"M{at:.1} {TOP}V{floor}\" stroke=\"#8888\" stroke-dasharray=\"4 4\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                at + 4.0,
                floor - 6.0,
                number(*budget, right - left)
            );
        }
        if let Some([first_x, first_y]) = self.front.first() {
            let mut path = format!("M{:.1} {:.1}", x(*first_x), y(*first_y));
            for [at, value] in &self.front[1..] {
                let _ = write!(path, "H{:.1}V{:.1}", x(*at), y(*value));
            }
            let _ = write!(svg, "<path d=\"{path}H{end}\" fill=\"none\" stroke=\"#8888\" stroke-width=\"2\"/>");
        }
        for (row, (group, colour)) in self.groups.iter().zip(COLOURS.iter().cycle()).enumerate() {
            if self.joined && group.marks.len() > 1 {
                let path: Vec<String> =
                    group.marks.iter().map(|mark| format!("{:.1} {:.1}", x(mark.x), y(mark.y))).collect();
                let _ = write!(
                    svg,
                    "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
                    path.join("L")
                );
            }
            for mark in &group.marks {
                let (at, value) = (x(mark.x), y(mark.y));
                if let Some([low, high]) = mark.interval {
                    let _ = write!(svg, "<path d=\"M{at:.1} {:.1}V{:.1}\" stroke=\"{colour}\"/>", y(low), y(high));
                }
                let _ = write!(
                    svg,
                    "<circle cx=\"{at:.1}\" cy=\"{value:.1}\" r=\"4\" fill=\"{colour}\"><title>{}</title></circle>",
                    escaped(&mark.words)
                );
                if !mark.label.is_empty() {
                    let _ = write!(
                        svg,
                        "<text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                        at + 6.0,
                        value - 6.0,
                        escaped(&mark.label)
                    );
                }
            }
            let key = TOP + 16.0 * (row as f64 + 0.5);
            if key < floor && !group.name.is_empty() {
                let _ = write!(
                    svg,
                    "<circle cx=\"{:.1}\" cy=\"{key:.1}\" r=\"4\" fill=\"{colour}\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                    end + 16.0,
                    end + 26.0,
                    key + 4.0,
                    escaped(&group.name)
                );
            }
        }
        svg + "</svg>"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mark(x: f64, y: f64) -> Mark {
        Mark { x, y, interval: Some([y - 0.1, y + 0.1]), words: "a < b".into(), label: "1".into() }
    }

    #[test]
    fn all_marks_are_inside_and_joined_in_their_order() {
        let groups = [
            Group { name: "g<128".into(), marks: vec![mark(1.0, 0.5), mark(2.0, 0.7), mark(3.0, 0.6)] },
            Group { name: "g384".into(), marks: vec![mark(2.5, 0.4)] },
        ];
        let front = [[1.0, 0.5], [2.0, 0.7]];
        let chart = Chart { x: "GFLOP", y: "SSIM", groups: &groups, joined: true, front: &front, budgets: &[2.2] };
        let svg = chart.draw();
        assert!(
            svg.starts_with("<svg") && svg.ends_with("</svg>") && svg.contains("g&lt;128") && !svg.contains("a < b")
        );
        // Four points and two legend entries; one line, because the other group has a single point.
        assert_eq!((svg.matches("<circle").count(), svg.matches("stroke-width=\"1.5\"").count()), (6, 1), "{svg}");
        assert_eq!(svg.matches("stroke-dasharray").count(), 1);
        let places = svg.split("<circle cx=\"").skip(1).filter(|part| part.contains("<title>")).map(|part| {
            let (x, rest) = part.split_once("\" cy=\"").unwrap();
            (x.parse::<f64>().unwrap(), rest.split_once('"').unwrap().0.parse::<f64>().unwrap())
        });
        let places: Vec<(f64, f64)> = places.collect();
        for (x, y) in &places {
            assert!((LEFT..=WIDTH - RIGHT).contains(x) && (TOP..=HEIGHT - BOTTOM).contains(y), "{x} {y}");
        }
        // Larger x costs more; a higher point has a larger value.
        assert!(places[0].0 < places[1].0 && places[1].0 < places[2].0 && places[1].1 < places[2].1, "{places:?}");
        assert!(places[3].1 > places[0].1);
    }

    #[test]
    fn one_point_is_a_drawing_and_none_is_not() {
        let one = [Group { name: "all".into(), marks: vec![mark(5.0, 1.0)] }];
        let chart = Chart { x: "x", y: "y", groups: &one, joined: false, front: &[], budgets: &[] };
        assert!(!chart.draw().contains("NaN") && chart.draw().contains("<circle"));
        let none = [Group { name: "none".into(), marks: Vec::new() }];
        assert_eq!(Chart { groups: &none, ..chart }.draw(), "");
    }
}
