//! Text and graph over the picture: status, help, messages and frame times.

use std::collections::VecDeque;

use cairn::Picture;
use cairn::present::presenter::FrameSource;

use super::controls::HELP;
use crate::text::{Font, LARGE, SMALL, fit, write};

const BRIGHT: [u8; 3] = [240, 240, 235];
const DIM: [u8; 3] = [176, 180, 186];
const MARGIN: u32 = 8;
/// Number of bars of the graph, each two pixels wide.
const BARS: usize = 128;
/// Height of the graph in pixels.
const GRAPH: u32 = 64;
/// Full scales of the graph, in milliseconds.
const SCALES: [f32; 6] = [50.0, 100.0, 200.0, 400.0, 800.0, 1600.0];

/// The help that is shown; the key H goes from one to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Help {
    Line,
    Keys,
    /// Nothing is drawn over the picture but that the world is loading or paused.
    Nothing,
}

impl Help {
    pub(super) fn next(self) -> Self {
        match self {
            Self::Line => Self::Keys,
            Self::Keys => Self::Nothing,
            Self::Nothing => Self::Line,
        }
    }
}

/// Times between frames, with the source of each.
#[derive(Debug, Default)]
pub(super) struct FrameTimes(VecDeque<(f32, FrameSource)>);

impl FrameTimes {
    /// Adds a frame that came `milliseconds` after the one before.
    pub(super) fn add(&mut self, milliseconds: f32, source: FrameSource) {
        if self.0.len() == BARS {
            self.0.pop_front();
        }
        self.0.push_back((milliseconds, source));
    }

    fn sorted(&self) -> Vec<f32> {
        let mut times: Vec<f32> = self.0.iter().map(|(time, _)| *time).collect();
        times.sort_unstable_by(f32::total_cmp);
        times
    }

    /// The smallest scale that nine of ten frames fit, in milliseconds.
    fn scale(&self) -> f32 {
        let times = self.sorted();
        let most = times.get(times.len() * 9 / 10).copied().unwrap_or(0.0);
        SCALES.into_iter().find(|scale| *scale >= most).unwrap_or(SCALES[SCALES.len() - 1])
    }

    fn median(&self) -> f32 {
        let times = self.sorted();
        times.get(times.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Everything that is drawn over a picture.
pub(super) struct Overlay<'a> {
    pub(super) status: &'a str,
    /// Over the middle of the picture; empty for none.
    pub(super) message: &'a str,
    pub(super) help: Help,
    pub(super) graph: Option<&'a FrameTimes>,
}

/// The keys in one line.
const HELP_LINE: &str =
    "W A S D walk   Shift run   mouse look   1-4 level   F + - frames   G view   T graph   R record   H all keys";

impl Overlay<'_> {
    /// Draws it.
    pub(super) fn draw(&self, out: &mut Picture) {
        let (width, height) = out.size();
        let room = width.saturating_sub(2 * MARGIN);
        if self.help != Help::Nothing {
            band(out, (0, 0), (width, SMALL.height + 8));
            write(out, &fit(self.status, room, SMALL), (MARGIN, 4), SMALL, BRIGHT);
        }
        match self.help {
            Help::Line => {
                let top = height.saturating_sub(SMALL.height + 8);
                band(out, (0, top), (width, SMALL.height + 8));
                write(out, &fit(HELP_LINE, room, SMALL), (MARGIN, top + 4), SMALL, DIM);
            }
            Help::Keys => keys(out),
            Help::Nothing => {}
        }
        if let Some(times) = self.graph {
            graph(out, times);
        }
        if !self.message.is_empty() {
            message(out, self.message);
        }
    }
}

/// Darkens an area, clipped to the picture.
fn band(out: &mut Picture, at: (u32, u32), size: (u32, u32)) {
    let (width, height) = out.size();
    for y in at.1..(at.1 + size.1).min(height) {
        for x in at.0..(at.0 + size.0).min(width) {
            let pixel = &mut out.pixels_mut()[(y * width + x) as usize];
            pixel[..3].iter_mut().for_each(|value| *value /= 4);
        }
    }
}

/// All keys, in two columns.
fn keys(out: &mut Picture) {
    let line = SMALL.height + 4;
    let key = HELP.iter().map(|(key, _)| key.len()).max().unwrap_or(0) as u32 + 2;
    let text = HELP.iter().map(|(_, action)| action.len()).max().unwrap_or(0) as u32;
    let (left, top) = (MARGIN, SMALL.height + 8 + MARGIN);
    band(out, (left, top), ((key + text) * SMALL.width + 2 * MARGIN, HELP.len() as u32 * line + 2 * MARGIN));
    for (row, (name, action)) in (0..).zip(HELP) {
        let y = top + MARGIN + row * line;
        write(out, name, (left + MARGIN, y), SMALL, BRIGHT);
        write(out, action, (left + MARGIN + key * SMALL.width, y), SMALL, DIM);
    }
}

/// A line over the middle, in the largest font that fits.
fn message(out: &mut Picture, text: &str) {
    let (width, height) = out.size();
    let room = width.saturating_sub(4 * MARGIN);
    let fits = |font: Font| text.chars().count() as u32 * font.width <= room;
    let font = if fits(LARGE) { LARGE } else { SMALL };
    let text = fit(text, room, font);
    let length = text.chars().count() as u32 * font.width;
    let at = ((width - length.min(width)) / 2, (height.saturating_sub(font.height)) / 2);
    band(
        out,
        (at.0.saturating_sub(MARGIN), at.1.saturating_sub(MARGIN)),
        (length + 2 * MARGIN, font.height + 2 * MARGIN),
    );
    write(out, &text, at, font, BRIGHT);
}

/// Colour of a frame's bar.
pub(super) fn colour(source: FrameSource) -> [u8; 3] {
    match source {
        FrameSource::Anchor => [240, 240, 240],
        FrameSource::Decoded => [64, 192, 240],
        FrameSource::Generated => [80, 200, 96],
        FrameSource::Extrapolated => [240, 208, 48],
        FrameSource::Held => [224, 64, 64],
    }
}

/// Draws the graph above the help line: a bar for each frame, as high as the time before it.
fn graph(out: &mut Picture, times: &FrameTimes) {
    let (width, height) = out.size();
    let size = (2 * BARS as u32 + 2 * MARGIN, GRAPH + SMALL.height + 2 * MARGIN);
    let (Some(left), Some(top)) =
        (width.checked_sub(size.0 + MARGIN), height.checked_sub(size.1 + SMALL.height + 8 + MARGIN))
    else {
        return;
    };
    band(out, (left, top), size);
    let scale = times.scale();
    let base = top + size.1 - MARGIN;
    let label = format!("{:.1} ms, full height {scale:.0} ms", times.median());
    write(out, &label, (left + MARGIN, top + MARGIN / 2), SMALL, DIM);
    for (i, (time, source)) in (0..).zip(&times.0) {
        let bar = ((time / scale).clamp(0.0, 1.0) * GRAPH as f32).round() as u32;
        for y in base - bar..base {
            for x in [0, 1].map(|x| left + MARGIN + 2 * i + x) {
                out.pixels_mut()[(y * width + x) as usize][..3].copy_from_slice(&colour(*source));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::canvas;

    fn drawn(overlay: &Overlay<'_>, size: (u32, u32)) -> Picture {
        let mut out = canvas(size, [200, 200, 200]).unwrap();
        overlay.draw(&mut out);
        out
    }

    fn count(picture: &Picture, colour: [u8; 3]) -> usize {
        picture.pixels().iter().filter(|px| px[..3] == colour).count()
    }

    #[test]
    fn nothing_is_drawn_over_a_picture_without_help() {
        let out = drawn(&Overlay { status: "forest", message: "", help: Help::Nothing, graph: None }, (640, 360));
        assert_eq!(count(&out, [200; 3]), 640 * 360);
    }

    #[test]
    fn status_help_and_message_are_readable() {
        let overlay = |help| Overlay { status: "forest", message: "paused", help, graph: None };
        let line = drawn(&overlay(Help::Line), (1280, 720));
        assert!(count(&line, BRIGHT) > 100 && count(&line, DIM) > 500);
        let keys = drawn(&overlay(Help::Keys), (1280, 720));
        assert!(count(&keys, DIM) > 2 * count(&line, DIM), "all keys have more text than the line");
        assert!(HELP_LINE.len() as u32 * SMALL.width <= 1280 - 2 * MARGIN);
    }

    #[test]
    fn a_bar_is_as_high_as_the_time_of_its_frame() {
        let mut times = FrameTimes::default();
        for _ in 0..200 {
            times.add(25.0, FrameSource::Generated);
        }
        times.add(50.0, FrameSource::Held);
        let out = drawn(&Overlay { status: "", message: "", help: Help::Line, graph: Some(&times) }, (640, 360));
        assert_eq!(times.scale(), 50.0);
        assert_eq!(count(&out, colour(FrameSource::Held)) as u32, 2 * GRAPH);
        assert_eq!(count(&out, colour(FrameSource::Generated)) as u32, 2 * (BARS as u32 - 1) * GRAPH / 2);
    }

    #[test]
    fn small_windows_clip_everything() {
        let mut times = FrameTimes::default();
        times.add(9999.0, FrameSource::Anchor);
        for size in [(1, 1), (40, 20), (200, 90)] {
            for help in [Help::Line, Help::Keys] {
                drawn(&Overlay { status: "forest", message: "loading the world", help, graph: Some(&times) }, size);
            }
        }
        assert_eq!(times.scale(), 1600.0);
    }
}
