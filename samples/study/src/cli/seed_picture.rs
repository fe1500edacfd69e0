//! `study seed-picture`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::{Error, ErrorKind, MAX_SIDE, Result};
use clap::Args;

use super::{Subcommand, size};
use crate::landscape;
use crate::media::{RealDisk, encode_png, write_whole};

#[derive(Args)]
pub(super) struct SeedPictureArgs {
    /// The PNG file to write
    #[arg(long, value_name = "FILE", default_value = "seed.png")]
    out: PathBuf,
    /// Its width and height
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: String,
}

impl Subcommand for SeedPictureArgs {
    fn check(&self) -> Result<()> {
        let sides = size(&self.size)?;
        if sides.iter().any(|side| !(1..=MAX_SIDE).contains(side)) {
            return Err(Error::new(ErrorKind::InvalidArgument, format!("a picture cannot be {}", self.size))
                .field("--size")
                .remedy(format!("Use a width and a height from 1 to {MAX_SIDE}, such as 1280x720")));
        }
        Ok(())
    }

    fn run(&self) -> Result<ExitCode> {
        self.check()?;
        let [width, height] = size(&self.size)?;
        let picture = landscape::paint(width, height).map_err(|e| e.field("--size"))?;
        write_whole(&RealDisk, &self.out, &encode_png(&picture)?)?;
        println!("{}", self.out.display());
        Ok(ExitCode::SUCCESS)
    }
}
