//! `study seed-picture`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::{Error, ErrorKind, Picture, Result};
use clap::Args;
use scenes::{Family, Scene};

use super::{Subcommand, size};
use crate::{level, seed_picture, sets};
use media::{RealDisk, encode_png, write_whole};

#[derive(Args)]
pub(super) struct SeedPictureArgs {
    /// The file to write, .png or .ppm
    #[arg(long, value_name = "FILE", default_value = "seed.png")]
    out: PathBuf,
    /// What kind of place: forest, sword, desert or snow
    #[arg(long, value_name = "SCENE", default_value = seed_picture::FAMILY.name())]
    scene: String,
    /// Another scene of that kind, by its seed [default: the level that the embedded world knows]
    #[arg(long, value_name = "N")]
    place: Option<u64>,
    /// Its width and height; 16:9 is shown
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: String,
}

impl SeedPictureArgs {
    fn family(&self) -> Result<Family> {
        self.scene.parse().map_err(|why: String| Error::new(ErrorKind::InvalidArgument, why).field("--scene"))
    }
}

impl Subcommand for SeedPictureArgs {
    fn check(&self) -> Result<()> {
        self.family()?;
        sets::require_unsealed(self.place.as_slice(), "--place")?;
        let [width, height] = size(&self.size)?;
        seed_picture::check(width, height).map_err(|e| e.field("--size"))
    }

    fn run(&self) -> Result<ExitCode> {
        self.check()?;
        let [width, height] = size(&self.size)?;
        let family = self.family()?;
        let scene = self.place.map_or_else(|| level::scene(family), |seed| Scene::new(family, seed));
        let picture = seed_picture::draw(&scene, width, height)?;
        let ppm = self.out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ppm"));
        write_whole(&RealDisk, &self.out, &if ppm { as_ppm(&picture) } else { encode_png(&picture)? })?;
        println!("{}", self.out.display());
        Ok(ExitCode::SUCCESS)
    }
}

/// As a binary PPM file (P6), which needs no library to read; alpha is dropped.
fn as_ppm(picture: &Picture) -> Vec<u8> {
    let mut file = format!("P6\n{} {}\n255\n", picture.width(), picture.height()).into_bytes();
    file.extend(picture.pixels().iter().flat_map(|px| &px[..3]));
    file
}
