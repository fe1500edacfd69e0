//! The quality table: generated frames against the true ones, beside other ways to make them.
//!
//! ```text
//! clips (anchors, truth, guidance) -> rows (pictures at a phase) -> measure (scores) -> table -> report, figure, claims
//!                 |                            |                        |
//!                 +----------------------- store -----------------------+
//! ```
//!
//! The unit of statistics is the clip: frames of one clip resemble each other, so they are averaged first, and
//! differences between rows are taken clip by clip.

mod claims;
mod clips;
mod figure;
mod measure;
mod report;
mod rows;
mod speed;
mod store;
mod table;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use cairn::{Error, ErrorKind, Result};

use crate::inputs;
use crate::media::{RealDisk, describe_io, encode_png, write_whole};
use crate::metrics::{Lpips, Net};
use crate::progress::Progress;
use clips::Scale;
use measure::{Measured, Plan};
use rows::program::not_provided;
use store::Store;
use table::Table;

/// The table as Markdown.
const REPORT: &str = "quality.md";
/// The table as CSV.
const SUMMARY: &str = "quality.csv";
/// Every frame's scores.
const FRAMES: &str = "quality-frames.csv";
/// The same crop for every row.
const FIGURE: &str = "quality.png";

/// Settings of the measurement, as texts from the command line.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    pub(crate) rows: String,
    pub(crate) clips: String,
    pub(crate) seeds: Vec<u64>,
    /// The network of LPIPS: alex, vgg or none.
    pub(crate) lpips: String,
    /// Small clips, and only rows that need no other program.
    pub(crate) smoke: bool,
    /// Ignore stored scores and stored pictures of other programs.
    pub(crate) fresh: bool,
    /// Also measure times.
    pub(crate) speed: bool,
    /// Also write the report into the repository's docs.
    pub(crate) publish: bool,
    pub(crate) out: PathBuf,
}

impl Settings {
    /// Checks the settings; reads no file.
    pub(crate) fn check(&self) -> Result<()> {
        rows::parse(&self.rows)?;
        let clips = clips::parse(&self.clips)?;
        net(&self.lpips)?;
        if clips.is_empty() && !self.speed {
            return Err(Error::new(ErrorKind::InvalidArgument, "there is nothing to measure")
                .field("--clips")
                .remedy("Name clips, or take times with --speed"));
        }
        if self.seeds.is_empty() {
            return Err(Error::new(ErrorKind::InvalidArgument, "no seed is given")
                .field("--seeds")
                .remedy("List one or more numbers, such as 5,6,7"));
        }
        Ok(())
    }
}

/// Reads the name of a network of LPIPS.
fn net(name: &str) -> Result<Option<Net>> {
    match name {
        "alex" => Ok(Some(Net::Alex)),
        "vgg" => Ok(Some(Net::Vgg)),
        "none" => Ok(None),
        _ => Err(Error::new(ErrorKind::InvalidArgument, format!("LPIPS has no network {name:?}"))
            .field("--lpips")
            .remedy("Use alex, vgg or none")),
    }
}

/// Loads LPIPS. Missing weights are fetched if that is allowed.
fn open_lpips(settings: &Settings, progress: &Progress) -> Result<Option<Lpips>> {
    let Some(net) = net(&settings.lpips)? else { return Ok(None) };
    if settings.smoke { Lpips::find(net) } else { inputs::lpips(net, progress) }.map(Some)
}

/// Result of the measurement.
pub(crate) struct Outcome {
    /// Files that were written, the report first.
    pub(crate) files: Vec<PathBuf>,
    /// Verdict on each claim, one line each.
    pub(crate) claims: Vec<String>,
    /// Number of claims that the table does not support.
    pub(crate) missed: usize,
    /// Number of scores computed now, and of stored ones.
    pub(crate) computed: usize,
    pub(crate) kept: usize,
    /// Unavailable rows and clips, with reason and remedy.
    pub(crate) left_out: Vec<String>,
    pub(crate) interrupted: bool,
}

/// Measures, and writes table, report and figure.
///
/// # Errors
/// Invalid settings, a clip that cannot be made, a full disk. An unavailable row is no error.
pub(crate) fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Outcome> {
    settings.check()?;
    let cache = provision::cache_dir().map_err(|e| not_provided(&e))?;
    let store = Store::new(cache.join("quality"), !settings.fresh);
    let plan = Plan {
        rows: rows::parse(&settings.rows)?,
        clips: clips::parse(&settings.clips)?,
        seeds: settings.seeds.clone(),
        scale: if settings.smoke { Scale::Smoke } else { Scale::Full },
    };
    let lpips = if plan.clips.is_empty() { Ok(None) } else { open_lpips(settings, progress) };
    let mut measured = measure::run(&plan, lpips, &store, progress, stop)?;
    let table = Table::new(&measured.records);
    let mut claims = claims::judge(&table);
    let speed = if settings.speed && !measured.interrupted {
        let speed = speed::measure(&store, progress, stop)?;
        claims.extend(speed.judge());
        Some(speed)
    } else {
        None
    };

    fs::create_dir_all(&settings.out).map_err(|e| describe_io("cannot be made", &settings.out, &e))?;
    let page = Page { settings, table: &table, claims: &claims, speed: speed.as_ref() };
    let mut files = write(&settings.out, &page, &mut measured, &store)?;
    if settings.publish && !measured.interrupted {
        files.extend(publish(&settings.out)?);
    }
    Ok(Outcome {
        files,
        missed: claims.iter().filter(|claim| !claim.held).count(),
        claims: claims.iter().map(ToString::to_string).collect(),
        computed: measured.computed,
        kept: measured.kept,
        left_out: measured.left_out.iter().map(ToString::to_string).collect(),
        interrupted: measured.interrupted,
    })
}

/// Input of the report besides the measurements.
struct Page<'a> {
    settings: &'a Settings,
    table: &'a Table,
    claims: &'a [claims::Claim],
    speed: Option<&'a speed::Speed>,
}

fn write(out: &Path, page: &Page<'_>, measured: &mut Measured, store: &Store) -> Result<Vec<PathBuf>> {
    let mut files = vec![out.join(REPORT), out.join(SUMMARY), out.join(FRAMES)];
    let figure = figure::draw(measured, store)?;
    if let Some(figure) = &figure {
        let path = out.join(FIGURE);
        write_whole(&RealDisk, &path, &encode_png(&figure.picture)?)?;
        files.push(path);
    }
    let text = report::text(page, measured, figure.as_ref().map(|f| f.caption.as_str()));
    write_whole(&RealDisk, &files[0], text.as_bytes())?;
    write_whole(&RealDisk, &files[1], page.table.csv().as_bytes())?;
    write_whole(&RealDisk, &files[2], measure::csv(&measured.records).as_bytes())?;
    Ok(files)
}

/// Copies report, table and figure into the repository's docs, where the figure has a folder of its own.
fn publish(out: &Path) -> Result<Vec<PathBuf>> {
    let docs = provision::repository().join("docs");
    let mut files = Vec::new();
    for (name, place) in
        [(SUMMARY, docs.join(SUMMARY)), (FIGURE, docs.join("images").join(FIGURE)), (REPORT, docs.join(REPORT))]
    {
        let from = out.join(name);
        if !from.is_file() {
            continue;
        }
        let mut bytes = fs::read(&from).map_err(|e| describe_io("cannot be read", &from, &e))?;
        if name == REPORT {
            bytes = String::from_utf8_lossy(&bytes)
                .replace(&format!("]({FIGURE})"), &format!("](images/{FIGURE})"))
                .into_bytes();
        }
        write_whole(&RealDisk, &place, &bytes)?;
        files.push(place);
    }
    Ok(files)
}
