//! The quality table: generated frames against the true ones, beside other ways to make them.
//!
//! ```text
//! clips (anchors, truth, guidance) -> rows (pictures at a phase) -> measure (scores) -> table -> report, figure, claims
//!                 |                            |                        |
//!                 +----------------------- store -----------------------+
//! ```
//!
//! A sealed measurement opens the set that no tuning sees: it appends a line to the ledger before it writes anything.
//!
//! The unit of statistics is the clip: frames of one clip resemble each other, so they are averaged first, and
//! differences between rows are computed clip by clip.

mod ablate;
mod claims;
mod clips;
mod figure;
mod floors;
mod ledger;
mod limits;
mod measure;
mod published;
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
use crate::metrics::{Lpips, Net};
use crate::progress::Progress;
use crate::sets;
pub use ablate::{AblationOutcome, AblationSettings, ablate};
use claims::Tally;
use clips::Scale;
pub use floors::{FloorSettings, FloorsOutcome, floors};
use ledger::{Entry, LEDGER, Ledger, OWN_LEDGER, Sources};
use measure::{Measurements, Plan};
use media::{describe_io, encode_png};
use rows::Kind;
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
/// The table of the sealed set as Markdown.
const SEALED_REPORT: &str = "quality-sealed.md";
/// The table of the sealed set as CSV.
const SEALED_SUMMARY: &str = "quality-sealed.csv";

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
    /// Small clips of two scored frames, for a check that everything works.
    pub smoke: bool,
    /// Ignore stored scores and stored pictures of other programs.
    pub fresh: bool,
    /// Also measure times.
    pub speed: bool,
    /// Also write the report into the repository's docs.
    pub publish: bool,
    /// Measures the sealed set, of which `clips` names clips, and appends a line to the ledger.
    pub sealed: bool,
    /// A file with a sealed set of one's own, whose ledger is beside it; `None` for the repository's.
    pub own_set: Option<PathBuf>,
    /// The output folder.
    pub out: PathBuf,
}

impl Settings {
    /// Checks the settings; reads no file besides that of a set of one's own.
    pub fn check(&self) -> Result<()> {
        rows::parse(&self.rows)?;
        let clips = self.kinds()?;
        net(&self.lpips)?;
        if self.sealed && (self.smoke || self.speed) {
            return Err(Error::new(ErrorKind::InvalidArgument, "the sealed set is not for trials and times")
                .field("--sealed")
                .remedy("Leave --smoke and --speed out"));
        }
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
        if !self.sealed {
            sets::require_unsealed(&self.seeds, "--seeds")?;
        }
        Ok(())
    }

    /// The kinds of clips that are measured.
    ///
    /// # Errors
    /// `InvalidArgument` for an unknown clip, and for a sealed one unless the sealed set is opened.
    fn kinds(&self) -> Result<Vec<clips::Kind>> {
        match (self.sealed, &self.own_set) {
            (false, _) => clips::parse(&self.clips),
            (true, None) => clips::parse_sealed(&self.clips, &sets::sealed()?),
            (true, Some(file)) => clips::parse_sealed(&self.clips, &sets::own(file)?),
        }
    }

    /// The ledger of the sealed set.
    fn ledger(&self) -> Ledger {
        Ledger::new(match &self.own_set {
            None => provision::repository().join(LEDGER),
            Some(file) => file.with_file_name(OWN_LEDGER),
        })
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
    open_lpips_of(net, !settings.smoke, progress).map(Some)
}

fn open_lpips_of(net: Net, fetch: bool, progress: &Progress) -> Result<Lpips> {
    if fetch { inputs::lpips(net, progress) } else { Lpips::find(net) }
}

/// Result of the measurement.
#[derive(Debug)]
pub struct QualityOutcome {
    /// Files that were written, the report first.
    pub files: Vec<PathBuf>,
    /// Verdict on each claim, one line each.
    pub claims: Vec<String>,
    /// How many claims held, were missed and were not judged.
    pub tally: String,
    /// Number of missed claims.
    pub missed: usize,
    /// Number of scores that were computed now.
    pub computed: usize,
    /// Number of stored scores.
    pub kept: usize,
    /// Unavailable rows and clips, with reason and remedy.
    pub left_out: Vec<String>,
    /// Notes on the opening of the sealed set.
    pub notes: Vec<String>,
    /// Whether `stop` ended the measurement.
    pub interrupted: bool,
}

/// Measures, and writes table, report and figure.
///
/// # Errors
/// Invalid settings, a clip that cannot be made, a full disk, a ledger that was changed. An unavailable row is no error.
pub fn run(settings: &Settings, progress: &Progress, stop: &AtomicBool) -> Result<QualityOutcome> {
    settings.check()?;
    let cache = provision::cache_dir().map_err(|e| not_provided(&e))?;
    let store = Store::new(cache.join("quality"), !settings.fresh);
    let plan = Plan {
        rows: rows::parse(&settings.rows)?,
        clips: settings.kinds()?,
        seeds: settings.seeds.clone(),
        scale: if settings.smoke { Scale::Smoke } else { Scale::Full },
    };
    if settings.sealed {
        // A ledger that cannot be continued is found before hours of work.
        settings.ledger().read()?;
    }
    let lpips = if plan.clips.is_empty() { Ok(None) } else { open_lpips(settings, progress) };
    let mut measured = measure::run(&plan, lpips, &store, progress, stop)?;
    if measured.interrupted {
        return Ok(interrupted(settings, &measured));
    }
    let table = Table::new(&measured.records);
    let opening = if settings.sealed { Some(open_sealed(settings, &table, &measured)?) } else { None };
    let mut claims = claims::judge(&table);
    let speed = if settings.speed {
        let speed = speed::measure(&store, progress, stop)?;
        claims.extend(speed.judge());
        Some(speed)
    } else {
        None
    };

    fs::create_dir_all(&settings.out).map_err(|e| describe_io("cannot be made", &settings.out, &e))?;
    let page = Page { settings, table: &table, claims: &claims, speed: speed.as_ref(), opening: opening.as_ref() };
    let files = files(&page, &mut measured, &store)?;
    let mut written = files.write(&settings.out)?;
    if settings.publish {
        let names = page.names();
        // This row alone runs a world.
        let is_paper = measured.rows.iter().any(|(kind, _)| *kind == Kind::Paper);
        let world = is_paper.then(|| inputs::world(None, progress)).transpose()?;
        let digest = world.as_ref().map(|(bundle, _)| bundle.digest());
        written.extend(files.publish(&[names.summary, FIGURE, names.report], digest)?);
    }
    let tally = Tally::of(&claims);
    Ok(QualityOutcome {
        files: written,
        tally: tally.to_string(),
        missed: tally.missed,
        claims: claims.iter().map(ToString::to_string).collect(),
        computed: measured.computed,
        kept: measured.kept,
        left_out: measured.left_out.iter().map(ToString::to_string).collect(),
        notes: opening.map(|opening| opening.notes()).unwrap_or_default(),
        interrupted: false,
    })
}

/// The outcome of a run that was ended. No page is written: a page of a part would replace one of the whole.
fn interrupted(settings: &Settings, measured: &Measurements) -> QualityOutcome {
    let (left_out, note) = match settings.sealed {
        // An opening that has no line in the ledger must not show what it measured.
        true => (Vec::new(), "nothing of the sealed set was shown, so the ledger has no line of this run"),
        false => (
            measured.left_out.iter().map(ToString::to_string).collect(),
            "no page was written, because some frames are not scored yet",
        ),
    };
    QualityOutcome {
        files: Vec::new(),
        tally: Tally::of(&[]).to_string(),
        missed: 0,
        claims: Vec::new(),
        computed: measured.computed,
        kept: measured.kept,
        left_out,
        notes: vec![note.into()],
        interrupted: true,
    }
}

/// An opening of the sealed set that is in the ledger.
struct Opening {
    entry: Entry,
    /// Its number in the ledger, from 1.
    number: usize,
}

impl Opening {
    fn notes(&self) -> Vec<String> {
        let warning = self.entry.sources.warning().map(str::to_owned);
        warning.into_iter().chain([format!("opening {} of the sealed set: commit the ledger", self.number)]).collect()
    }
}

/// Appends what was measured to the ledger. Nothing of it may be written or printed before.
fn open_sealed(settings: &Settings, table: &Table, measured: &Measurements) -> Result<Opening> {
    let entry = Entry {
        date: ledger::now(),
        sources: Sources::of(provision::repository())?,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        rows: measured.rows.iter().map(|(kind, _)| kind.name().to_owned()).collect(),
        lpips: if measured.lpips.is_some() { settings.lpips.clone() } else { "none".into() },
        left_out: measured.left_out.iter().map(|left_out| left_out.name.clone()).collect(),
        results: ledger::results(table),
    };
    let number = settings.ledger().append(&entry)?;
    Ok(Opening { entry, number })
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
    /// `None` unless the sealed set was opened.
    opening: Option<&'a Opening>,
}

/// Names of the report's files.
struct Names {
    report: &'static str,
    summary: &'static str,
}

impl Page<'_> {
    fn names(&self) -> Names {
        match self.opening {
            Some(_) => Names { report: SEALED_REPORT, summary: SEALED_SUMMARY },
            None => Names { report: REPORT, summary: SUMMARY },
        }
    }
}

/// The report's files: the report first, the figure last. Of the sealed set nobody sees a picture or a frame's score.
fn files(page: &Page<'_>, measured: &mut Measurements, store: &Store) -> Result<Files> {
    let is_sealed = page.opening.is_some();
    let figure = if is_sealed { None } else { figure::draw(measured, store)? };
    let text = report::text(page, measured, figure.as_ref().map(|f| f.caption.as_str()));
    let mut files = Files::default();
    let names = page.names();
    files.add(names.report, text);
    files.add(names.summary, page.table.csv());
    if !is_sealed {
        files.add(FRAMES, measure::csv(&measured.records));
    }
    if let Some(figure) = &figure {
        files.add_picture(NAME, encode_png(&figure.picture)?, &figure.picture)?;
    }
    Ok(files)
}
