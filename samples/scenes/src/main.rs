//! Draws the scenes: single pictures, contact sheets, and clips with their ground truth.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use cairn::Picture;
use cairn::guidance::DepthEncoding;
use cairn::world::{ControlScript, Key, WorldTime};
use clap::{Args, Parser, Subcommand, ValueEnum};
use scenes::edit::EditList;
use scenes::engine::{Engine, EngineOptions, MotionFormat};
use scenes::film::{FilmGrain, FilmOptions, MotionBlur};
use scenes::{Cast, Clip, ClipFrame, ClipOptions, Effects, FAMILIES, Family, Frame, LANDSCAPES, Quality, Scene, Start};

type Result<T, E = Box<dyn std::error::Error>> = std::result::Result<T, E>;

/// Procedural places with ground truth.
#[derive(Parser)]
#[command(after_help = "Examples:
  scenes sheet --out scenes.png
  scenes clip --scene forest --script samples/scripts/forest.txt --seconds 4 --out clip
  scenes clip --scene snow --size 256x128 --samples 1 --raw - | some-program
  scenes clip --scene sword --out clip --hud --edit '2 cut 10,20,90; 3..3.5 fade-out black; 3.5..4 fade-in black'
  scenes clip --scene desert --out clip --samples 1 --taa --blur 180 --grain 3
  scenes clip --scene forest --rate 60 --out clip --engine 4 --motion-format unorm16-root --dilate --depth reversed")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// One picture of the four landscapes or, with a cast, of all kinds of place; three moments of each.
    Sheet {
        /// The PNG to write.
        #[arg(long, default_value = "scenes.png")]
        out: PathBuf,
        /// Which place of each kind.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// What moves: all, none, or some of figures, birds, bodies, wind, doors, lights, particles, flashes, water with commas between.
        #[arg(long, default_value_t = Cast::none())]
        cast: Cast,
    },
    /// A walk as numbered PNG files with depth and motion, or as raw RGB.
    Clip(Box<ClipArguments>),
}

#[derive(Args)]
struct ClipArguments {
    /// forest, sword, desert, snow, indoors or town.
    #[arg(long)]
    scene: Family,
    /// Which place of that kind.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// What moves: all, none, or some of figures, birds, bodies, wind, doors, lights, particles, flashes, water with commas between.
    #[arg(long, default_value_t = Cast::none())]
    cast: Cast,
    /// Close the place by hills about 50 m from the origin, at which a walk stops. Landscapes only.
    #[arg(long)]
    level: bool,
    /// The control script; without one, the scene's own.
    #[arg(long)]
    script: Option<PathBuf>,
    /// How long, in seconds of world time.
    #[arg(long, default_value_t = 4.0)]
    seconds: f64,
    /// Where the walk starts, EAST,NORTH,YAW: metres from the origin, and degrees from north to the east. On the path
    /// at the origin unless given.
    #[arg(long, allow_hyphen_values = true)]
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
    /// The folder to write: NNNN.png, NNNN.depth.f32 and NNNN.motion.f32 (little-endian, dx dy), NNNN.hud.png with --hud, NNNN.engine-depth.f32 and
    /// NNNN.engine-motion.f32 with --engine, and frames.csv with each frame's time, shot and jitter.
    #[arg(long, conflicts_with = "raw", required_unless_present = "raw")]
    out: Option<PathBuf>,
    /// Write 8-bit RGB pictures one after the other to this file; `-` is standard output.
    #[arg(long)]
    raw: Option<PathBuf>,
    /// Write the controls of every latent step to this file, a line each: `dx dy scroll` and the codes of the keys held.
    #[arg(long)]
    controls: Option<PathBuf>,
    #[command(flatten)]
    effects: EffectArguments,
    #[command(flatten)]
    engine: EngineArguments,
}

/// What is done to the pictures. Every frame gets it; depth and motion stay those of the world.
#[derive(Args)]
#[command(next_help_heading = "Effects on pictures")]
struct EffectArguments {
    /// Cuts and fades, separated by semicolons, with times in seconds: `2 cut EAST,NORTH,YAW`, `5..5.6 cross-fade EAST,NORTH,YAW`,
    /// `3..3.5 fade-out black`, `3.5..4 fade-in white`, `7..7.1 flash 0.8`. The first frame after a cut has no motion (NaN).
    #[arg(long = "edit", value_name = "EDITS")]
    edits: Vec<EditList>,
    /// Draw a head-up display with score, timer, health, ammunition, crosshair and minimap.
    #[arg(long)]
    hud: bool,
    /// Temporal anti-aliasing: a new frame counts at least 1/FRAMES. Jitters the camera; use it with --samples 1, as engines do.
    #[arg(long, value_name = "FRAMES", num_args = 0..=1, default_missing_value = "16", value_parser = clap::value_parser!(u32).range(1..=256))]
    taa: Option<u32>,
    /// Jitter the camera by less than a pixel: the Halton sequence (2, 3), repeated after PHASES frames. 8 with --taa unless given.
    #[arg(long, value_name = "PHASES", value_parser = clap::value_parser!(u32).range(1..=1024))]
    jitter: Option<u32>,
    /// Motion blur with a shutter of DEGREES, above 0 to 360: 180 opens it for half of the time between two frames, up to each frame's time.
    #[arg(long, value_name = "DEGREES")]
    blur: Option<f64>,
    /// Pictures that are averaged for a blurred one.
    #[arg(long, default_value_t = 8, requires = "blur", value_parser = clap::value_parser!(u32).range(2..=256))]
    blur_frames: u32,
    /// Film grain with this standard deviation, in 8-bit code values, up to 64.
    #[arg(long, value_name = "DEVIATION")]
    grain: Option<f32>,
    /// Seed of the grain.
    #[arg(long, default_value_t = 1, requires = "grain")]
    grain_seed: u64,
}

impl EffectArguments {
    fn effects(&self, rate: u32) -> Result<Effects> {
        let edits = self.edits.iter().cloned().try_fold(EditList::default(), EditList::joined)?;
        if self.blur.is_some_and(|degrees| !(degrees > 0.0 && degrees <= 360.0)) {
            return Err("--blur must be above 0 and at most 360 degrees".into());
        }
        if self.grain.is_some_and(|deviation| !(0.0..=64.0).contains(&deviation)) {
            return Err("--grain must be from 0 to 64".into());
        }
        let film = FilmOptions {
            blur: self.blur.map(|degrees| MotionBlur::shutter(degrees, rate, self.blur_frames)),
            anti_aliasing: self.taa,
            grain: self.grain.map(|deviation| FilmGrain { deviation, seed: self.grain_seed }),
        };
        Ok(Effects { edits, film, jitter: self.jitter, hud: self.hud })
    }
}

/// Motion and depth as an engine gives them, beside the truth.
#[derive(Args)]
#[command(next_help_heading = "Inputs as engines give them")]
struct EngineArguments {
    /// For every Nth frame, also write depth and motion as an engine gives them. Motion spans N frames: one-frame vectors composed by following them.
    #[arg(long, value_name = "N", requires = "out", value_parser = clap::value_parser!(u32).range(1..=64))]
    engine: Option<u32>,
    /// How the motion texture stores vectors.
    #[arg(long, value_enum, default_value = "float32", requires = "engine")]
    motion_format: Format,
    /// Give each pixel the vector of the nearest depth among its 3x3 neighbours.
    #[arg(long, requires = "engine")]
    dilate: bool,
    /// Leave the camera's jitter in the vectors.
    #[arg(long, requires = "engine")]
    keep_jitter: bool,
    /// Give skinned meshes the camera's motion only, as where an engine keeps no previous pose.
    #[arg(long, requires = "engine")]
    skinned_from_camera: bool,
    /// Pixels per side of the square that shares a vector: 1, 2, 8 or 16.
    #[arg(long, default_value_t = 1, requires = "engine", value_parser = texel)]
    motion_texel: u32,
    /// Encoding of depth.
    #[arg(long, value_enum, default_value = "device", requires = "engine")]
    depth: Depth,
}

#[derive(Clone, Copy, ValueEnum)]
enum Format {
    /// Exact.
    Float32,
    /// 16-bit floats, parts of the picture's size, as Unity.
    Half,
    /// 16 bits, as Unreal Engine 4.
    Unorm16,
    /// The square root in 16 bits, as Unreal Engine 5.
    Unorm16Root,
    /// The square root in 8 bits, as CryENGINE 3.
    Unorm8Root,
}

#[derive(Clone, Copy, ValueEnum)]
enum Depth {
    /// Direct3D's: 0 near, 1 far.
    Device,
    /// 1 near, 0 far.
    Reversed,
    /// Metres along the view axis.
    Linear,
}

fn texel(text: &str) -> Result<u32, String> {
    match text {
        "1" | "2" | "8" | "16" => Ok(text.parse().unwrap_or(1)),
        _ => Err(format!("vectors are not in squares of {text} pixels. Use 1, 2, 8 or 16")),
    }
}

impl EngineArguments {
    fn engine(&self) -> Result<Option<(u32, Engine)>> {
        let Some(frames) = self.engine else { return Ok(None) };
        let options = EngineOptions {
            frames,
            format: match self.motion_format {
                Format::Float32 => MotionFormat::Float32,
                Format::Half => MotionFormat::Half,
                Format::Unorm16 => MotionFormat::Unorm16,
                Format::Unorm16Root => MotionFormat::Unorm16Root,
                Format::Unorm8Root => MotionFormat::Unorm8Root,
            },
            dilate: self.dilate,
            keep_jitter: self.keep_jitter,
            skinned_from_camera: self.skinned_from_camera,
            texel: self.motion_texel,
            depth: DepthEncoding {
                inverted: matches!(self.depth, Depth::Reversed),
                linear: matches!(self.depth, Depth::Linear),
            },
        };
        Ok(Some((frames, Engine::new(options)?)))
    }
}

/// Latent steps per second of world time, for `--controls`.
const LATENTS_PER_SECOND: u32 = 15;

fn size(text: &str) -> Result<(u32, u32), String> {
    let parse = |t: &str| t.parse::<u32>().ok().filter(|n| (1..=8192).contains(n));
    text.split_once('x')
        .and_then(|(w, h)| Some((parse(w)?, parse(h)?)))
        .ok_or_else(|| format!("{text} is no size. Write WIDTHxHEIGHT, each 1 to 8192, such as 640x360"))
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Sheet { out, seed, cast } => sheet(&out, seed, cast),
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

fn save(path: &Path, picture: &Picture) -> Result<()> {
    let rgb: Vec<u8> = picture.pixels().iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    Ok(image::save_buffer(path, &rgb, picture.width(), picture.height(), image::ColorType::Rgb8)?)
}

fn sheet(out: &Path, seed: u64, cast: Cast) -> Result<()> {
    const GAP: u32 = 6;
    let (w, h) = (384, 216);
    let families = if cast == Cast::none() { &LANDSCAPES[..] } else { &FAMILIES[..] };
    let (columns, rows) = (3, families.len() as u32);
    let mut sheet = Picture::new(columns * (w + GAP) - GAP, rows * (h + GAP) - GAP)?;
    let width = sheet.width() as usize;
    for (row, family) in families.iter().copied().enumerate() {
        let scene = Scene::with_cast(family, seed, cast);
        let script = ControlScript::parse(family.script())?;
        let options =
            ClipOptions { width: w, height: h, rate: 30, quality: Quality { samples: 3 }, ..Default::default() };
        let mut walk = Clip::new(&scene, &script, options)?;
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

fn clip(a: &ClipArguments) -> Result<()> {
    let script = match &a.script {
        Some(path) => {
            let bytes = fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
            ControlScript::parse_bytes(&bytes)?
        }
        None => ControlScript::parse(a.scene.script())?,
    };
    if !(0.0..=3600.0).contains(&a.seconds) {
        return Err("--seconds must be from 0 to 3600".into());
    }
    if a.level && !LANDSCAPES.contains(&a.scene) {
        return Err(format!(
            "--level closes landscapes, and {} has walls. Use it with forest, sword, desert or snow",
            a.scene
        )
        .into());
    }
    let make = if a.level { Scene::level } else { Scene::with_cast };
    let scene = make(a.scene, a.seed, a.cast);
    let options = ClipOptions {
        width: a.size.0,
        height: a.size.1,
        rate: a.rate,
        quality: Quality { samples: a.samples },
        start: a.start,
        ..Default::default()
    };
    let effects = a.effects.effects(a.rate.max(1))?;
    let mut engine = a.engine.engine()?;
    // Raw pictures without effects need no depth and no motion.
    let picture_only = a.raw.is_some() && effects == Effects::default();
    let mut walk = Clip::with_effects(&scene, &script, options, effects).map_err(|error| error.field("--rate"))?;
    if let Some(path) = &a.controls {
        fs::write(path, controls(&script, a.seconds)?).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    let mut list = String::from("frame,seconds,shot,jitter_x,jitter_y,engine_reset\n");
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
        if let Some(raw) = raw.as_mut().filter(|_| picture_only) {
            let (now, _) = walk.advance()?;
            write_rgb(raw, &scenes::render_picture(&scene, &now, a.size.0, a.size.1, options.quality))?;
            continue;
        }
        let ClipFrame { frame, now, before, hud, .. } = walk.next_frame()?;
        if let Some(raw) = &mut raw {
            write_rgb(raw, &frame.picture)?;
        } else if let Some(out) = &a.out {
            write_frame(out, n, &frame)?;
            if let Some(mask) = hud {
                let path = out.join(format!("{n:04}.hud.png"));
                image::save_buffer(path, &mask, a.size.0, a.size.1, image::ColorType::L8)?;
            }
            let mut reset = "";
            if let Some((every, engine)) = &mut engine {
                let inputs = engine.push(&frame, &now, &before);
                if n % u64::from(*every) == 0 {
                    reset = if inputs.reset { "1" } else { "0" };
                    let motion = &inputs.motion.vectors;
                    write_numbers(&out.join(format!("{n:04}.engine-depth.f32")), inputs.depth.iter().copied())?;
                    write_numbers(
                        &out.join(format!("{n:04}.engine-motion.f32")),
                        motion.iter().flat_map(|m| [m.x, m.y]),
                    )?;
                }
            }
            writeln!(
                list,
                "{n},{:.6},{},{},{},{reset}",
                n as f64 / f64::from(a.rate),
                now.shot,
                now.jitter.x,
                now.jitter.y
            )?;
        }
    }
    if let Some(out) = &a.out {
        fs::write(out.join("frames.csv"), list)?;
    }
    if let Some(raw) = &mut raw {
        raw.flush()?;
    }
    let seconds = start.elapsed().as_secs_f64();
    eprintln!("{count} frames in {seconds:.1} s, {:.1} a second", count as f64 / seconds);
    Ok(())
}

/// Controls of each latent step of the first `seconds` of a script.
fn controls(script: &ControlScript, seconds: f64) -> Result<String> {
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

/// Writes a picture's 8-bit RGB, row by row.
fn write_rgb(out: &mut dyn Write, picture: &Picture) -> Result<()> {
    let rgb: Vec<u8> = picture.pixels().iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    Ok(out.write_all(&rgb)?)
}

fn write_frame(out: &Path, n: u64, frame: &Frame) -> Result<()> {
    save(&out.join(format!("{n:04}.png")), &frame.picture)?;
    write_numbers(&out.join(format!("{n:04}.depth.f32")), frame.depth.iter().copied())?;
    write_numbers(&out.join(format!("{n:04}.motion.f32")), frame.motion.iter().flat_map(|m| [m.x, m.y]))
}

/// Writes little-endian 32-bit floats.
fn write_numbers(path: &Path, numbers: impl Iterator<Item = f32>) -> Result<()> {
    Ok(fs::write(path, numbers.flat_map(f32::to_le_bytes).collect::<Vec<u8>>())?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn controls_are_listed_for_each_latent_step() {
        let script = ControlScript::parse("cairn-controls 1\n0..0.1 hold W SHIFT\n0..0.2 mouse 30 -3\n").unwrap();
        assert_eq!(controls(&script, 0.2).unwrap(), "10 -1 0 16 87\n10 -1 0 16 87\n10 -1 0\n");
        assert_eq!(controls(&script, 0.0).unwrap(), "");
    }
}
