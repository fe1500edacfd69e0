//! Half a minute of Big Buck Bunny: a real film of which every second picture is held back.

use std::path::PathBuf;
use std::process::Command;

use cairn::guidance::Guidance;
use cairn::{Error, ErrorKind, Picture, Result};
use provision::Progress;

use super::{Clip, Phase, Scale, Target, evenly};
use crate::quality::rows::program::{Scratch, not_provided, read_pictures, run};
use crate::quality::store::{Capture, Store};

/// The shots, each with its first and last picture. The first starts after the fade from black.
const SHOTS: [(&str, usize, usize); 4] =
    [("bunny-hills", 50, 284), ("bunny-brook", 285, 377), ("bunny-bird", 378, 552), ("bunny-burrow", 553, 719)];
/// A third of the film's own size.
const SIZE: (u32, u32) = (640, 360);
/// Filter of the conversion: colours by the film's own matrix, whole pictures, no interpolation.
const TO_RGB: &str =
    "scale=640:360:flags=lanczos+accurate_rnd+full_chroma_int:in_color_matrix=bt709:in_range=tv,format=rgb24";

/// A shot of the film. Anchors are every second picture, 12 a second.
pub(in crate::quality) struct Film {
    name: &'static str,
    first: usize,
    anchors: usize,
    targets: Vec<Target>,
    ffmpeg: PathBuf,
    video: PathBuf,
    capture: Capture,
}

impl Film {
    /// All shots.
    ///
    /// # Errors
    /// The film or ffmpeg is not available.
    pub(in crate::quality) fn shots(scale: Scale, progress: &dyn Progress) -> Result<Vec<Self>> {
        let ffmpeg = provision::baselines::ffmpeg(progress).map_err(|e| not_provided(&e))?;
        let video = provision::baselines::big_buck_bunny(progress).map_err(|e| not_provided(&e))?;
        let shot = |&(name, first, last): &(&'static str, usize, usize)| {
            let anchors = (last - first) / 2 + 1;
            let capture = Capture::of(&format!("{name} {first} to {last} {TO_RGB}"));
            let targets = evenly(anchors, scale);
            Self { name, first, anchors, targets, ffmpeg: ffmpeg.clone(), video: video.clone(), capture }
        };
        Ok(SHOTS.iter().map(shot).collect())
    }

    /// Picture `number` of the shot. If it is missing, the whole shot is decoded and stored.
    fn picture(&self, number: usize, store: &Store) -> Result<Picture> {
        store.picture(&self.capture, &number.to_string(), || {
            let mut pictures = self.decode()?;
            for (number, picture) in pictures.iter().enumerate() {
                store.picture(&self.capture, &number.to_string(), || Ok(picture.clone()))?;
            }
            Ok(pictures.swap_remove(number))
        })
    }

    fn decode(&self) -> Result<Vec<Picture>> {
        let scratch = Scratch::new()?;
        let output = scratch.path("shot.rgb");
        let pictures = 2 * self.anchors - 1;
        let mut command = Command::new(&self.ffmpeg);
        command.args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y", "-i"]).arg(&self.video);
        command.args(["-vf", &format!("select=gte(n\\,{}),{TO_RGB}", self.first), "-fps_mode", "passthrough"]);
        command.args(["-frames:v", &pictures.to_string(), "-f", "rawvideo"]).arg(&output);
        run("ffmpeg", &mut command)?;
        let made = read_pictures(&output, SIZE)?;
        if made.len() == pictures {
            return Ok(made);
        }
        let cause = format!("it gave {} pictures of {pictures} of {}", made.len(), self.name);
        Err(Error::new(ErrorKind::Unsupported, cause).field("ffmpeg"))
    }
}

impl Clip for Film {
    fn name(&self) -> &str {
        self.name
    }

    fn group(&self) -> &'static str {
        "bunny"
    }

    fn description(&self) -> String {
        let seconds = |picture: usize| picture as f64 / 24.0;
        format!(
            "Big Buck Bunny (Blender Foundation, CC BY 3.0), {:.1} s to {:.1} s, {}x{}, every second picture of 24 a second",
            seconds(self.first),
            seconds(self.first + 2 * self.anchors - 2),
            SIZE.0,
            SIZE.1
        )
    }

    fn targets(&self) -> &[Target] {
        &self.targets
    }

    fn anchors(&self) -> usize {
        self.anchors
    }

    fn anchor(&mut self, number: usize, store: &Store) -> Result<Picture> {
        self.picture(2 * number, store)
    }

    fn truth(&mut self, number: usize, phase: Phase, store: &Store) -> Result<Picture> {
        phase.must_be_half()?;
        self.picture(2 * number - 1, store)
    }

    fn guidance(&mut self, _number: usize, _store: &Store) -> Result<Option<Guidance>> {
        Ok(None)
    }
}
