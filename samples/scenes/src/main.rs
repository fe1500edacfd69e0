//! Draws the scenes: single pictures, contact sheets, and clips with their ground truth.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use cairn::Picture;
use cairn::world::{ControlScript, Key, WorldTime};
use clap::{Args, Parser, Subcommand};
use scenes::{Clip, ClipOptions, Family, Frame, LANDSCAPES, MAX_RATE, Quality, Scene, Start};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Procedural places with ground truth.
#[derive(Parser)]
#[command(after_help = "Examples:
  scenes sheet --out scenes.png
  scenes clip --scene forest --script samples/scripts/forest.txt --seconds 4 --out clip
  scenes clip --scene snow --size 256x128 --samples 1 --raw - | some-program")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// One picture of all four scenes, three moments of each.
    Sheet {
        /// The PNG to write.
        #[arg(long, default_value = "scenes.png")]
        out: PathBuf,
        /// Which place of each kind.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// A walk as numbered PNG files with depth and motion, or as raw RGB.
    Clip(ClipArguments),
}

#[derive(Args)]
struct ClipArguments {
    /// forest, sword, desert or snow.
    #[arg(long)]
    scene: Family,
    /// Which place of that kind.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The control script; without one, the scene's own.
    #[arg(long)]
    script: Option<PathBuf>,
    /// How long, in seconds of world time.
    #[arg(long, default_value_t = 4.0)]
    seconds: f64,
    /// Where the walk starts, EAST,NORTH,YAW: metres from the origin, and degrees from north to the east. On the path
    /// at the origin unless given.
    #[arg(long, value_parser = start, allow_hyphen_values = true)]
    start: Option<Start>,
    /// Pictures per second, 1 to 960.
    #[arg(long, default_value_t = 30)]
    rate: u32,
    /// Pixels, WIDTHxHEIGHT; 16:9 is shown whatever the ratio.
    #[arg(long, default_value = "640x360", value_parser = size)]
    size: (u32, u32),
    /// Colour samples per pixel and axis, 1 to 8.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=8))]
    samples: u32,
    /// The folder to write: NNNN.png, NNNN.depth.f32 and NNNN.motion.f32 (little-endian, dx dy).
    #[arg(long, conflicts_with = "raw", required_unless_present = "raw")]
    out: Option<PathBuf>,
    /// Write 8-bit RGB pictures one after the other to this file; `-` is standard output.
    #[arg(long)]
    raw: Option<PathBuf>,
    /// Write the controls of every latent step to this file, a line each: `dx dy scroll` and the codes of the keys held.
    #[arg(long)]
    controls: Option<PathBuf>,
}

/// Latent steps per second of world time, for `--controls`.
const LATENTS_PER_SECOND: u32 = 15;

fn size(text: &str) -> Result<(u32, u32), String> {
    let parse = |t: &str| t.parse::<u32>().ok().filter(|n| (1..=8192).contains(n));
    text.split_once('x')
        .and_then(|(w, h)| Some((parse(w)?, parse(h)?)))
        .ok_or_else(|| format!("{text} is no size. Write WIDTHxHEIGHT, each 1 to 8192, such as 640x360"))
}

/// Maximum distance of a walk's start from the origin, east or north, in metres: the finely meshed ground.
const FARTHEST_START: f32 = 96.0;

fn start(text: &str) -> Result<Start, String> {
    let wrong = || format!("{text} is no start. Write EAST,NORTH,YAW in metres, at most {FARTHEST_START}, and degrees");
    let numbers: Vec<f32> = text.split(',').map(|t| t.parse().map_err(|_| wrong())).collect::<Result<_, _>>()?;
    let &[east, north, yaw] = numbers.as_slice() else { return Err(wrong()) };
    let inside = [east, north].iter().all(|metres| metres.abs() <= FARTHEST_START) && yaw.is_finite();
    inside.then(|| Start { at: glam::Vec2::new(east, north), yaw: yaw.to_radians() }).ok_or_else(wrong)
}

/// Script of a scene.
fn own_script(family: Family) -> &'static str {
    match family {
        Family::Forest => include_str!("../../scripts/forest.txt"),
        Family::Sword => include_str!("../../scripts/sword.txt"),
        Family::Desert => include_str!("../../scripts/desert.txt"),
        Family::Snow => include_str!("../../scripts/snow.txt"),
    }
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Sheet { out, seed } => sheet(&out, seed),
        Command::Clip(arguments) => clip(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
    }
}

fn save(path: &Path, picture: &Picture) -> Outcome<()> {
    let rgb: Vec<u8> = picture.pixels().iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    Ok(image::save_buffer(path, &rgb, picture.width(), picture.height(), image::ColorType::Rgb8)?)
}

fn sheet(out: &Path, seed: u64) -> Outcome<()> {
    const GAP: u32 = 6;
    let (w, h) = (384, 216);
    let (columns, rows) = (3, LANDSCAPES.len() as u32);
    let mut sheet = Picture::new(columns * (w + GAP) - GAP, rows * (h + GAP) - GAP)?;
    let width = sheet.width() as usize;
    for (row, family) in LANDSCAPES.into_iter().enumerate() {
        let scene = Scene::new(family, seed);
        let script = ControlScript::parse(own_script(family))?;
        let options =
            ClipOptions { width: w, height: h, rate: 30, quality: Quality { samples: 3 }, ..Default::default() };
        let mut walk = Clip::new(&scene, &script, options).ok_or("30 pictures a second are in range")?;
        let mut column = 0;
        for n in 0..=240 {
            let (now, before) = walk.advance()?;
            if n % 120 == 0 {
                let frame = scenes::render(&scene, &now, &before, w, h, options.quality);
                for (y, line) in frame.picture.pixels().chunks(w as usize).enumerate() {
                    let at = (row * (h + GAP) as usize + y) * width + column * (w + GAP) as usize;
                    sheet.pixels_mut()[at..at + w as usize].copy_from_slice(line);
                }
                column += 1;
            }
        }
        eprintln!("{family}: {} things, {} triangles", scene.objects, scene.triangles());
    }
    save(out, &sheet)?;
    eprintln!("wrote {}", out.display());
    Ok(())
}

fn clip(a: &ClipArguments) -> Outcome<()> {
    let script = match &a.script {
        Some(path) => {
            let bytes = fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
            ControlScript::parse_bytes(&bytes)?
        }
        None => ControlScript::parse(own_script(a.scene))?,
    };
    if !(0.0..=3600.0).contains(&a.seconds) {
        return Err("--seconds must be from 0 to 3600".into());
    }
    if let Some(path) = &a.controls {
        fs::write(path, controls(&script, a.seconds)?).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    let scene = Scene::new(a.scene, a.seed);
    let options = ClipOptions {
        width: a.size.0,
        height: a.size.1,
        rate: a.rate,
        quality: Quality { samples: a.samples },
        start: a.start,
        ..Default::default()
    };
    let mut walk = Clip::new(&scene, &script, options).ok_or_else(|| format!("--rate must be from 1 to {MAX_RATE}"))?;
    let mut raw: Option<Box<dyn Write>> = match &a.raw {
        Some(path) if path.as_os_str() == "-" => Some(Box::new(BufWriter::new(std::io::stdout().lock()))),
        Some(path) => {
            Some(Box::new(BufWriter::new(File::create(path).map_err(|e| format!("{}: {e}", path.display()))?)))
        }
        None => None,
    };
    if let Some(out) = &a.out {
        fs::create_dir_all(out).map_err(|e| format!("{}: {e}", out.display()))?;
    }
    let count = (a.seconds * f64::from(a.rate)).round() as u64 + 1;
    let start = Instant::now();
    for n in 0..count {
        let frame = walk.frame()?;
        if let Some(raw) = &mut raw {
            let rgb: Vec<u8> = frame.picture.pixels().iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
            raw.write_all(&rgb)?;
        } else if let Some(out) = &a.out {
            write_frame(out, n, &frame)?;
        }
    }
    if let Some(raw) = &mut raw {
        raw.flush()?;
    }
    let seconds = start.elapsed().as_secs_f64();
    eprintln!("{count} frames in {seconds:.1} s, {:.1} a second", count as f64 / seconds);
    Ok(())
}

/// Controls of each latent step of the first `seconds` of a script.
fn controls(script: &ControlScript, seconds: f64) -> Outcome<String> {
    let mut lines = String::new();
    for q in 0..(seconds * f64::from(LATENTS_PER_SECOND)).round() as u64 {
        let span = (WorldTime::new(q, LATENTS_PER_SECOND), WorldTime::new(q + 1, LATENTS_PER_SECOND));
        let input = script.span(span.0, span.1)?;
        let [dx, dy] = input.mouse();
        write!(lines, "{dx} {dy} {}", input.scroll())?;
        for key in (0..=u8::MAX).filter(|&code| input.keys().contains(Key(code))) {
            write!(lines, " {key}")?;
        }
        lines.push('\n');
    }
    Ok(lines)
}

fn write_frame(out: &Path, n: u64, frame: &Frame) -> Outcome<()> {
    save(&out.join(format!("{n:04}.png")), &frame.picture)?;
    let depth: Vec<u8> = frame.depth.iter().flat_map(|d| d.to_le_bytes()).collect();
    fs::write(out.join(format!("{n:04}.depth.f32")), depth)?;
    let motion: Vec<u8> = frame.motion.iter().flat_map(|m| [m.x, m.y]).flat_map(f32::to_le_bytes).collect();
    fs::write(out.join(format!("{n:04}.motion.f32")), motion)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_is_two_distances_and_an_angle() {
        let found = start("-12.5,96,180").unwrap();
        assert_eq!((found.at.x, found.at.y, found.yaw), (-12.5, 96.0, std::f32::consts::PI));
        for wrong in ["", "1,2", "1,2,3,4", "a,0,0", "97,0,0", "0,-97,0", "NaN,0,0", "0,0,inf"] {
            assert!(start(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn controls_are_listed_for_each_latent_step() {
        let script = ControlScript::parse("cairn-controls 1\n0..0.1 hold W SHIFT\n0..0.2 mouse 30 -3\n").unwrap();
        assert_eq!(controls(&script, 0.2).unwrap(), "10 -1 0 16 87\n10 -1 0 16 87\n10 -1 0\n");
        assert_eq!(controls(&script, 0.0).unwrap(), "");
    }
}
