//! The film of the demonstration: a walk through each level, with decoded pictures and generated frames side by side.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use cairn::framegen::cpu::CpuGenerator;
use cairn::framegen::{AnchorPair, FrameGenerator};
use cairn::guidance::{Guidance, picture_flow};
use cairn::present::upscale::{Filter, Upscaler};
use cairn::world::{ControlScript, OperatingPoint, Preset, Rollout, World, WorldOptions};
use cairn::{Error, ErrorKind, Picture, Result};
use scenes::Family;

use crate::device::DeviceChoice;
use crate::experiment::files::write_all;
use crate::picture::{canvas, paste, shrink};
use crate::progress::{Progress, check_stop};
use crate::text::{LARGE, SMALL, write};
use crate::{device, inputs, level, seed_picture};
use media::{FrameRate, Mp4Sink, RealDisk, Recorder, VideoFormat, describe_io, encode_small_png};

/// The film.
pub(crate) const FILM: &str = "levels/film.mp4";
/// Its contact sheet.
pub(crate) const SHEET: &str = "levels/sheet.png";

/// Size of a picture in the film.
const TILE: (u32, u32) = (480, 270);
const GAP: u32 = 16;
/// Height of the line above the pictures.
const HEAD: u32 = 48;
const SIZE: (u32, u32) = (2 * TILE.0 + 3 * GAP, HEAD + TILE.1 + GAP);
/// Frames a second.
const RATE: u32 = 60;
/// Duration of a title card in seconds.
const TITLE_SECONDS: f64 = 2.0;
const GROUND: [u8; 3] = [24, 26, 30];
const BRIGHT: [u8; 3] = [235, 235, 230];
const DIM: [u8; 3] = [150, 152, 156];
/// Columns of the contact sheet, as shares of a walk.
const SHOWN: [f64; 4] = [0.0, 0.25, 0.5, 1.0];
/// Size of a picture on the contact sheet.
const SMALL_TILE: (u32, u32) = (320, 180);

/// The levels with their titles, in the film's order.
const LEVELS: [(Family, &str); 4] = [
    (Family::Forest, "The forest"),
    (Family::Sword, "The meadow, over a sword"),
    (Family::Desert, "The desert"),
    (Family::Snow, "The snowfield"),
];

/// Size of the given picture on a title card.
const GIVEN: (u32, u32) = (288, 162);

/// Captions of the two pictures.
const LEFT: &str = "the world: all 60 frames a second";
const RIGHT: &str = "the world: 15 anchors a second; between them: Cairn";

/// Lines of a title card below the title.
const CARD: [&str; 4] = [
    "Given: one picture of this level, and the player's controls. Everything else is made.",
    "Left: the world makes all frames. Each latent step gives four pictures, 60 a second.",
    "Right: the world makes 15 anchors a second. Cairn generates the three frames between,",
    "from their optical flow.",
];

/// Settings of the film.
pub(crate) struct LevelsFilm<'a> {
    /// The bundle; `None` for the library's own.
    pub(crate) world: Option<&'a Path>,
    /// Where the world runs.
    pub(crate) device: DeviceChoice,
    /// World time of each walk in seconds.
    pub(crate) seconds: f64,
    pub(crate) out: &'a Path,
}

impl LevelsFilm<'_> {
    /// Makes the film and its contact sheet. Returns their paths.
    ///
    /// # Errors
    /// An unusable world, errors of making latents, `Io`; `Cancelled` when `stop` was set.
    pub(crate) fn make(&self, progress: &Progress, stop: &AtomicBool) -> Result<Vec<PathBuf>> {
        let (ort, _) = inputs::onnxruntime(progress)?;
        let (bundle, _) = inputs::world(self.world, progress)?;
        let point = Preset::Decoded60.operating_point();
        point.check_for(bundle.geometry())?;
        let options = WorldOptions { global_window: Some(point.global_window), ..WorldOptions::default() };
        let world = device::load(self.device, &ort, None, &bundle, &options)?.world;

        let film = self.out.join(FILM);
        let folder = film.parent().unwrap_or(self.out);
        std::fs::create_dir_all(folder).map_err(|e| describe_io("it cannot be made", folder, &e))?;
        let quantiser = VideoFormat::SMALL;
        let format = VideoFormat { quantiser, ..VideoFormat::new(SIZE, FrameRate::new(RATE.into(), 1)?) };
        let sink = Mp4Sink::create(&RealDisk, &film, &format, 0)?;
        let recorder = Recorder::start(vec![Box::new(sink)], SIZE)?;
        let mut sheet = Sheet::new()?;
        let mut made = Ok(());
        for (row, (family, title)) in (0..).zip(LEVELS) {
            progress.phase(title);
            let walk = LevelWalk { family, title, point: &point, seconds: self.seconds, row };
            made = walk.film(&world, &recorder, &mut sheet, stop);
            if made.is_err() {
                break;
            }
        }
        // A recorder that failed, because the disk is full for example, also ends the walk.
        if let Some(failure) = recorder.finish()?.failure {
            return Err(failure);
        }
        made?;
        write_all(vec![(self.out.join(SHEET), encode_small_png(&sheet.0)?)])?;
        Ok(vec![film, self.out.join(SHEET)])
    }
}

/// One walk of the film.
struct LevelWalk<'a> {
    family: Family,
    title: &'static str,
    point: &'a OperatingPoint,
    seconds: f64,
    /// Row of the contact sheet.
    row: u32,
}

impl LevelWalk<'_> {
    fn film(&self, world: &Arc<World>, recorder: &Recorder, sheet: &mut Sheet, stop: &AtomicBool) -> Result<()> {
        let (width, height) = world.render_size();
        let point = self.point;
        let seed = seed_picture::draw(&level::scene(self.family), width, height)?;
        let card = title_card(self.title, &seed)?;
        for _ in 0..(TITLE_SECONDS * f64::from(RATE)) as u32 {
            push(recorder, card.clone())?;
        }
        let script = ControlScript::parse(self.family.script())?;
        let mut rollout = Rollout::new(world, point, 1)?;
        rollout.append(&seed)?;
        let last = point.pictures_per_latent - 1;
        let read = |rollout: &mut Rollout, i: u32| {
            let mut picture = Picture::new(width, height)?;
            rollout.read_picture(i, &mut picture)?;
            Ok::<_, Error>(picture)
        };
        let mut before = read(&mut rollout, last)?;
        let mut guidance = Guidance::new(width, height, picture_flow::PROJECTION)?;
        let (mut flow, mut generator) = (picture_flow::Extractor::new(), CpuGenerator::new());
        let mut upscaler = Upscaler::new((width, height), TILE, Filter::Lanczos3)?;
        let mut frames = Frames { recorder, upscaler: &mut upscaler, title: self.title };
        frames.push(&before, &before)?;
        let steps = (self.seconds * f64::from(point.latents_per_second)).round() as u64;
        sheet.add(self.row, 0, self.title, &before)?;
        for q in 1..=steps {
            check_stop(stop)?;
            let (start, end) = point.span_of_latent(q);
            rollout.step(&script.span(start, end)?)?;
            let anchor = read(&mut rollout, last)?;
            flow.extract(&before, &anchor, &mut guidance)?;
            for i in 0..=last {
                let decoded = read(&mut rollout, i)?;
                if i == last {
                    frames.push(&decoded, &anchor)?;
                } else {
                    let mut between = Picture::new(width, height)?;
                    let phase = (i + 1) as f32 / point.pictures_per_latent as f32;
                    generator.generate(&AnchorPair::new(&before, &anchor, &guidance)?, phase, &mut between)?;
                    frames.push(&decoded, &between)?;
                }
            }
            for (column, share) in (0..).zip(SHOWN) {
                if column > 0 && (share * steps as f64).round() as u64 == q {
                    sheet.add(self.row, column, self.title, &anchor)?;
                }
            }
            before = anchor;
        }
        Ok(())
    }
}

/// Draws and pushes the frames of a walk.
struct Frames<'a> {
    recorder: &'a Recorder,
    upscaler: &'a mut Upscaler,
    title: &'static str,
}

impl Frames<'_> {
    fn push(&mut self, left: &Picture, right: &Picture) -> Result<()> {
        let mut frame = canvas(SIZE, GROUND)?;
        write(&mut frame, self.title, (GAP, 4), SMALL, BRIGHT);
        for (column, picture, caption) in [(0, left, LEFT), (1, right, RIGHT)] {
            let x = GAP + column * (TILE.0 + GAP);
            let mut tile = Picture::new(TILE.0, TILE.1)?;
            self.upscaler.upscale(picture, &mut tile)?;
            paste(&mut frame, &tile, (x, HEAD));
            write(&mut frame, caption, (x, 26), SMALL, DIM);
        }
        push(self.recorder, frame)
    }
}

fn push(recorder: &Recorder, frame: Picture) -> Result<()> {
    match recorder.push(frame) {
        true => Ok(()),
        false => Err(Error::new(ErrorKind::Io, "the film cannot be written")),
    }
}

/// Title card: shows the given picture, and says which frames the world makes and which Cairn generates.
fn title_card(title: &str, seed: &Picture) -> Result<Picture> {
    let mut card = canvas(SIZE, GROUND)?;
    write(&mut card, title, (GAP, 16), LARGE, BRIGHT);
    for (line, text) in (0..).zip(CARD) {
        write(&mut card, text, (GAP, 56 + 20 * line), SMALL, BRIGHT);
    }
    paste(&mut card, &shrink(seed, GIVEN)?, (GAP, 150));
    write(&mut card, "the given picture", (GAP + GIVEN.0 + GAP, 150), SMALL, DIM);
    Ok(card)
}

/// Contact sheet: a row for each level, a column for each moment.
struct Sheet(Picture);

impl Sheet {
    fn new() -> Result<Self> {
        let (columns, rows) = (SHOWN.len() as u32, LEVELS.len() as u32);
        canvas((GAP + columns * (SMALL_TILE.0 + GAP), GAP + rows * (SMALL_TILE.1 + HEAD)), GROUND).map(Self)
    }

    fn add(&mut self, row: u32, column: u32, title: &str, picture: &Picture) -> Result<()> {
        let (x, y) = (GAP + column * (SMALL_TILE.0 + GAP), GAP + row * (SMALL_TILE.1 + HEAD));
        if column == 0 {
            write(&mut self.0, title, (x, y), SMALL, BRIGHT);
        }
        paste(&mut self.0, &shrink(picture, SMALL_TILE)?, (x, y + 20));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_fits_its_picture() {
        let fits = |text: &str, width: u32| text.len() as u32 * SMALL.width <= width;
        assert!([LEFT, RIGHT].into_iter().all(|caption| fits(caption, TILE.0)));
        assert!(CARD.into_iter().all(|line| fits(line, SIZE.0 - 2 * GAP)));
        let (width, height) = SIZE;
        assert!(width.is_multiple_of(2) && height.is_multiple_of(2), "as the video encoder wants");
    }

    #[test]
    fn a_title_card_shows_the_given_picture_below_the_title() {
        let mut seed = Picture::new(320, 180).unwrap();
        seed.pixels_mut().iter_mut().for_each(|px| *px = [200, 10, 10, 255]);
        let card = title_card("The snowfield", &seed).unwrap();
        assert_eq!(card.size(), SIZE);
        let reds = card.pixels().iter().filter(|px| px[0] > 150 && px[1] < 60).count();
        assert_eq!(reds as u32, GIVEN.0 * GIVEN.1);
        let bright = |rows: std::ops::Range<u32>| {
            let row = |y: u32| &card.pixels()[(y * SIZE.0) as usize..((y + 1) * SIZE.0) as usize];
            rows.flat_map(row).filter(|px| px[..3] == BRIGHT).count()
        };
        assert!(bright(16..40) > 100 && bright(56..130) > 500 && bright(131..149) == 0);
    }
}
