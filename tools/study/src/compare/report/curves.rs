//! Curves of a scene over world time, and bars of budgets, as SVG.

use std::fmt::Write as _;

use super::super::series::{Column, Series};
use super::super::walk::RATE;
use crate::document::escaped;
use crate::statistics::mean;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 240.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 150.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 32.0;
/// Samples averaged for a point of a curve: half a second.
const SMOOTH: usize = RATE as usize / 2;
/// Okabe and Ito's palette, which colour-blind readers can tell apart: one colour for the truth, and one for each branch.
const COLOURS: [&str; 7] = ["#888888", "#0072b2", "#d55e00", "#e69f00", "#cc79a7", "#009e73", "#56b4e9"];

/// Start of an SVG of that height. Inside the page its type is known; as a file of its own it needs the namespace.
fn opening(height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" role=\"img\">"
    )
}

/// Curves of one column, a line per stream that has it; empty if none has.
pub(super) fn curves(series: &[Series], column: Column) -> String {
    let lines: Vec<(usize, Vec<(f64, f64)>)> = series
        .iter()
        .enumerate()
        .map(|(i, series)| {
            let values: Vec<Option<f64>> = series.column(column).collect();
            let points = values.chunks(SMOOTH).enumerate().filter_map(|(n, chunk)| {
                let time = (n * SMOOTH) as f64 + (chunk.len() - 1) as f64 / 2.0;
                Some((time / f64::from(RATE), mean(chunk.iter().copied()).filter(|value| value.is_finite())?))
            });
            (i, points.collect::<Vec<_>>())
        })
        .filter(|(_, points)| !points.is_empty())
        .collect();
    let all = || lines.iter().flat_map(|(_, points)| points);
    let (Some(end), Some(top)) =
        (all().map(|(time, _)| *time).max_by(f64::total_cmp), all().map(|(_, v)| *v).max_by(f64::total_cmp))
    else {
        return String::new();
    };
    let (end, top) = (end.max(1e-9), if top > 0.0 { top } else { 1.0 });
    let x = |time: f64| LEFT + time / end * (WIDTH - LEFT - RIGHT);
    let y = |value: f64| HEIGHT - BOTTOM - value / top * (HEIGHT - TOP - BOTTOM);
    let mut svg = opening(HEIGHT);
    for quarter in 0..=4 {
        let share = f64::from(quarter) / 4.0;
        let (at, over) = (y(top * share), x(end * share));
        // Writing to a string cannot fail.
        let _ = write!(
            svg,
            "<path d=\"M{LEFT} {at:.1}H{:.1}\" stroke=\"#8884\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{:.3}</text>\
             <text x=\"{over:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{:.1} s</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            at + 4.0,
            top * share,
            HEIGHT - 12.0,
            end * share
        );
    }
    for (row, (i, points)) in lines.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let path: Vec<String> =
            points.iter().map(|(time, value)| format!("{:.1} {:.1}", x(*time), y(*value))).collect();
        let key = TOP + 16.0 * (row as f64 + 0.5);
        let _ = write!(
            svg,
            "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>\
             <path d=\"M{:.1} {key:.1}h16\" stroke=\"{colour}\" stroke-width=\"3\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            path.join("L"),
            WIDTH - RIGHT + 10.0,
            WIDTH - RIGHT + 32.0,
            key + 4.0,
            escaped(&series[*i].name)
        );
    }
    svg + "</svg>"
}

/// A bar per name, followed by its value.
pub(super) fn bars(values: &[(&str, f64)], unit: &str) -> String {
    let most = values.iter().map(|(_, value)| *value).filter(|v| v.is_finite()).fold(0.0, f64::max).max(1e-12);
    let height = 24 * values.len();
    let mut svg = opening(height as f64);
    for (row, (name, value)) in values.iter().enumerate() {
        let (y, width) = (24 * row, value.max(0.0) / most * (WIDTH - 280.0));
        let _ = write!(
            svg,
            "<text x=\"0\" y=\"{}\">{}</text><rect x=\"130\" y=\"{}\" width=\"{width:.1}\" height=\"16\" fill=\"{}\"/>\
             <text x=\"{:.1}\" y=\"{}\">{value:.2} {}</text>",
            y + 16,
            escaped(name),
            y + 4,
            COLOURS[(row + 1) % COLOURS.len()],
            136.0 + width,
            y + 16,
            escaped(unit)
        );
    }
    svg + "</svg>"
}

#[cfg(test)]
mod tests {
    use super::super::super::series::Row;
    use super::*;

    fn series(name: &str, values: impl Iterator<Item = Option<f64>>) -> Series {
        let row = |value| {
            let mut row = Row::default();
            row[Column::Lpips as usize] = value;
            row
        };
        Series { name: name.into(), rows: values.map(row).collect() }
    }

    #[test]
    fn every_stream_that_was_measured_has_a_line_inside_the_frame() {
        let all = [
            series("truth", (0..61).map(|_| None)),
            series("a<b", (0..61).map(|n| Some(f64::from(n) / 100.0))),
            series("flat", (0..61).map(|_| Some(0.0))),
        ];
        let svg = curves(&all, Column::Lpips);
        assert!(
            svg.matches("stroke-width=\"2\"").count() == 2 && svg.contains("a&lt;b") && !svg.contains("truth"),
            "{svg}"
        );
        let path = svg.split("<path d=\"M").find(|part| part.contains("fill=\"none\"")).unwrap();
        for point in path.split('"').next().unwrap().split('L') {
            let (x, y) = point.split_once(' ').unwrap();
            let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
            assert!((LEFT..=WIDTH - RIGHT).contains(&x) && (TOP..=HEIGHT - BOTTOM).contains(&y), "{point}");
        }
        assert_eq!(curves(&all[..1], Column::Lpips), "");
    }

    #[test]
    fn the_longest_bar_is_the_largest_value() {
        let svg = bars(&[("one", 1.0), ("two", 2.0)], "GFLOP");
        assert!(
            svg.contains("width=\"220.0\"") && svg.contains("width=\"440.0\"") && svg.contains("2.00 GFLOP"),
            "{svg}"
        );
    }
}
