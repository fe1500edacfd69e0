//! `study score`.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use cairn::{Error, ErrorKind, Picture, Result};
use clap::Args;

use super::{Subcommand, progress, stop_on_interrupt};
use crate::inputs::lpips;
use crate::metrics::{Lpips, Net, psnr, ssim};
use crate::picture::decode;
use media::{RealDisk, describe_io, write_whole};

pub(super) const EXAMPLES: &str = "\
Examples:
  study score truth.png mine.png
      Peak signal-to-noise ratio, structural similarity and LPIPS of one picture.

  study score out/truth out/mine --vgg --csv out/mine.csv
      Every picture of a folder against the one of the same name, with LPIPS by VGG16 as well.

PSNR is in dB and larger is nearer, infinite for equal pictures; SSIM is 1 for equal pictures; LPIPS is 0 for them. Means are
plain means over the pictures. The weights of LPIPS (64 MB) are fetched once.

Exit status: 0 well, 1 failed, 2 wrong usage or unusable pictures, 130 interrupted.";

#[derive(Args)]
pub(super) struct ScoreArgs {
    /// The true picture, PNG or JPEG, or a folder of them
    truth: PathBuf,
    /// The picture that is scored, or a folder with the same file names
    candidate: PathBuf,
    /// LPIPS with VGG16 as well; about twenty times the work
    #[arg(long)]
    vgg: bool,
    /// Without LPIPS
    #[arg(long, conflicts_with = "vgg")]
    no_lpips: bool,
    /// Write a line for every picture to this file as well
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Print the means only
    #[arg(long)]
    quiet: bool,
}

/// One column of the table.
enum Measure {
    Psnr,
    Ssim,
    Lpips(Lpips),
}

impl Measure {
    fn name(&self) -> &'static str {
        match self {
            Self::Psnr => "psnr",
            Self::Ssim => "ssim",
            Self::Lpips(lpips) => match lpips.net() {
                Net::Alex => "lpips_alex",
                Net::Vgg => "lpips_vgg",
            },
        }
    }

    fn of(&self, truth: &Picture, picture: &Picture) -> Result<f64> {
        match self {
            Self::Psnr => psnr(truth, picture),
            Self::Ssim => ssim(truth, picture),
            Self::Lpips(lpips) => lpips.compare(truth, picture),
        }
    }

    fn format_value(&self, value: f64) -> String {
        let digits = if matches!(self, Self::Psnr) { 2 } else { 4 };
        format!("{value:>12.digits$}")
    }
}

impl Subcommand for ScoreArgs {
    fn run(&self) -> Result<ExitCode> {
        let pairs = pairs(&self.truth, &self.candidate)?;
        let measures = self.measures()?;
        let stop = stop_on_interrupt()?;
        let widest = pairs.iter().map(|pair| pair.name.chars().count()).max().unwrap_or(0).max("picture".len());
        let heads: String = measures.iter().fold(String::new(), |mut line, measure| {
            let _ = write!(line, "{:>12}", measure.name());
            line
        });
        println!("{:widest$}{heads}", "picture");
        let mut csv = format!("picture,{}\n", measures.iter().map(Measure::name).collect::<Vec<_>>().join(","));
        let mut sums = vec![0.0; measures.len()];
        for pair in &pairs {
            if stop.load(Ordering::SeqCst) {
                return Ok(ExitCode::from(130));
            }
            let (truth, picture) = (read(&pair.truth)?, read(&pair.candidate)?);
            let (mut line, mut row) = (String::new(), quoted(&pair.name));
            for (measure, sum) in measures.iter().zip(&mut sums) {
                let value = measure.of(&truth, &picture).map_err(|e| in_pair(&e, pair))?;
                *sum += value;
                line += &measure.format_value(value);
                let _ = write!(row, ",{value}");
            }
            if !self.quiet {
                println!("{:widest$}{line}", pair.name);
            }
            csv += &row;
            csv.push('\n');
        }
        let means: String =
            measures.iter().zip(&sums).map(|(m, sum)| m.format_value(sum / pairs.len() as f64)).collect();
        println!("{:widest$}{means}", "mean");
        if let Some(path) = &self.csv {
            write_whole(&RealDisk, path, csv.as_bytes())?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

impl ScoreArgs {
    fn measures(&self) -> Result<Vec<Measure>> {
        let mut measures = vec![Measure::Psnr, Measure::Ssim];
        if self.no_lpips {
            return Ok(measures);
        }
        let nets = [Net::Alex, Net::Vgg].into_iter().take(if self.vgg { 2 } else { 1 });
        for net in nets {
            measures.push(Measure::Lpips(lpips(net, &progress(self.quiet))?));
        }
        Ok(measures)
    }
}

/// Two files that are compared.
#[derive(Debug)]
struct Pair {
    name: String,
    truth: PathBuf,
    candidate: PathBuf,
}

/// Two files, or the pictures of two folders by their names, in the order of the names.
fn pairs(truth: &Path, candidate: &Path) -> Result<Vec<Pair>> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match (truth.is_dir(), candidate.is_dir()) {
        (false, false) => {
            Ok(vec![Pair { name: name(candidate), truth: truth.to_owned(), candidate: candidate.to_owned() }])
        }
        (true, true) => {
            let (true_names, names) = (pictures(truth)?, pictures(candidate)?);
            if let Some(alone) = true_names.symmetric_difference(&names).next() {
                let without = if names.contains(alone) { truth } else { candidate };
                return Err(Error::new(ErrorKind::InvalidArgument, format!("there is no {alone} to compare with"))
                    .field(without.display().to_string())
                    .remedy("Give both folders pictures of the same names"));
            }
            if names.is_empty() {
                return Err(Error::new(ErrorKind::InvalidArgument, "the folder has no PNG or JPEG files")
                    .field(truth.display().to_string()));
            }
            let pair = |name: String| Pair { truth: truth.join(&name), candidate: candidate.join(&name), name };
            Ok(names.into_iter().map(pair).collect())
        }
        (is_folder, _) => {
            let (folder, file) = if is_folder { (truth, candidate) } else { (candidate, truth) };
            // A file that is not there is worth more words than that it is no folder.
            std::fs::metadata(file).map_err(|e| describe_io("it cannot be read", file, &e))?;
            Err(Error::new(ErrorKind::InvalidArgument, format!("{} is a folder and this is none", folder.display()))
                .field(file.display().to_string())
                .remedy("Give two pictures, or two folders"))
        }
    }
}

/// Names of the pictures in a folder.
fn pictures(folder: &Path) -> Result<BTreeSet<String>> {
    let entries = std::fs::read_dir(folder).map_err(|e| describe_io("it cannot be read", folder, &e))?;
    let mut names = BTreeSet::new();
    for entry in entries {
        let path = entry.map_err(|e| describe_io("it cannot be read", folder, &e))?.path();
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        if ["png", "jpg", "jpeg"].iter().any(|known| ending == *known) {
            names.extend(path.file_name().and_then(|name| name.to_str()).map(str::to_owned));
        }
    }
    Ok(names)
}

fn read(path: &Path) -> Result<Picture> {
    let bytes = std::fs::read(path).map_err(|e| describe_io("it cannot be read", path, &e))?;
    decode(&bytes).map_err(|e| e.field(path.display().to_string()))
}

/// Says which pair an error is about.
fn in_pair(error: &Error, pair: &Pair) -> Error {
    Error::new(error.kind(), error.to_string()).field(pair.candidate.display().to_string())
}

/// A name as a field of a CSV file.
fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_with_a_comma_stays_one_field() {
        assert_eq!(quoted("a.png"), "a.png");
        assert_eq!(quoted("a \"b\", c.png"), "\"a \"\"b\"\", c.png\"");
    }
}
