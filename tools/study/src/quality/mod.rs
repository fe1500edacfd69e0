//! The quality table: generated frames against the true ones, beside other ways to make them.
//!
//! ```text
//! clips (anchors, truth, guidance) -> rows (pictures at a phase) -> measure (scores) -> table -> report, figure, claims
//!                 |                            |                        |
//!                 +----------------------- store -----------------------+
//! ```
//!
//! The unit of statistics is the clip: frames of one clip resemble each other, so they are averaged first, and
//! differences between rows are computed clip by clip.

mod claims;
mod clips;
mod figure;
mod limits;
mod measure;
mod report;
mod rows;
mod speed;
mod store;
mod table;

use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use cairn::{Error, ErrorKind, Result};

use crate::experiment::files::Files;
use crate::inputs;
use crate::media::{describe_io, encode_png};
use crate::metrics::{Lpips, Net};
use crate::progress::Progress;
use clips::Scale;
use measure::{Measurements, Plan};
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
/// The figure without the ending.
const NAME: &str = "quality";

/// Settings of the measurement, as texts from the command line.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The rows: ways to make frames, as a list of names.
    pub rows: String,
    /// The clips, as a list of names.
    pub clips: String,
    /// Scene seeds.
    pub seeds: Vec<u64>,
    /// The network of LPIPS: alex, vgg or none.
    pub lpips: String,
    /// Small clips, and only rows that need no other program.
    pub smoke: bool,
    /// Ignore stored scores and stored pictures of other programs.
    pub fresh: bool,
    /// Also measure times.
    pub speed: bool,
    /// Also write the report into the repository's docs.
    pub publish: bool,
    /// The output folder.
    pub out: PathBuf,
}

impl Settings {
    /// Checks the settings; reads no file.
    pub fn check(&self) -> Result<()> {
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
#[derive(Debug)]
pub struct Outcome {
    /// Files that were written, the report first.
    pub files: Vec<PathBuf>,
    /// Verdict on each claim, one line each.
    pub claims: Vec<String>,
    /// Number of claims that the table does not support.
    pub missed: usize,
    /// Number of scores that were computed now.
    pub computed: usize,
    /// Number of stored scores.
    pub kept: usize,
    /// Unavailable rows and clips, with reason and remedy.
    pub left_out: Vec<String>,
    /// Whether `stop` ended the measurement.
    pub interrupted: bool,
}

/// Measures, and writes table, report and figure.
///
/// # Errors
/// Invalid settings, a clip that cannot be made, a full disk. An unavailable row is no error.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<Outcome> {
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
    let files = files(&page, &mut measured, &store)?;
    let mut written = files.write(&settings.out)?;
    if settings.publish && !measured.interrupted {
        written.extend(files.publish(&[SUMMARY, FIGURE, REPORT])?);
    }
    Ok(Outcome {
        files: written,
        missed: claims.iter().filter(|claim| !claim.held).count(),
        claims: claims.iter().map(ToString::to_string).collect(),
        computed: measured.computed,
        kept: measured.kept,
        left_out: measured.left_out.iter().map(ToString::to_string).collect(),
        interrupted: measured.interrupted,
    })
}

/// Compares settings of the row `row` on seed 4 of the scenes; the result is a Markdown table, best PSNR first.
///
/// # Errors
/// A row without settings, or one that is not available or fails.
pub fn tune(row: &str, lpips: &str, progress: &Progress, stop: &AtomicBool) -> Result<String> {
    let cache = provision::cache_dir().map_err(|e| not_provided(&e))?;
    let lpips = net(lpips)?.map(|net| inputs::lpips(net, progress)).transpose()?;
    rows::tune::table(row, lpips.as_ref(), &Store::new(cache.join("quality"), true), progress, stop)
}

/// Input of the report besides the measurements.
struct Page<'a> {
    settings: &'a Settings,
    table: &'a Table,
    claims: &'a [claims::Claim],
    speed: Option<&'a speed::Speed>,
}

/// The report's files: the report first, the figure last.
fn files(page: &Page<'_>, measured: &mut Measurements, store: &Store) -> Result<Files> {
    let figure = figure::draw(measured, store)?;
    let text = report::text(page, measured, figure.as_ref().map(|f| f.caption.as_str()));
    let mut files = Files::default();
    files.add(REPORT, text);
    files.add(SUMMARY, page.table.csv());
    files.add(FRAMES, measure::csv(&measured.records));
    if let Some(figure) = &figure {
        files.add_picture(NAME, encode_png(&figure.picture)?, &figure.picture)?;
    }
    Ok(files)
}
