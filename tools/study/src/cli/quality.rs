//! `study quality`.

use std::path::PathBuf;
use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::{CELLS_KEPT, Subcommand, print_outcome, progress, stop_on_interrupt};
use crate::quality::{self, FloorSettings, Settings};

pub(super) const EXAMPLES: &str = "\
Examples:
  study quality --smoke
      Everything small and alone, in a minute: does the whole path work?

  study quality --seeds 4 --clips forest,snow --rows built-in
      While the generator is worked on. Seed 4 is there for that; 5 to 7 are kept for the table.

  study quality --floors
      A dozen small frames against the least scores that are committed, in seconds; with --write, these scores anew.

  study quality --clips none --speed --check
      Times alone, with the ratios that are claimed.

  study quality --tune minterpolate
      Settings of another program, compared on seed 4: is the row as good as it can be?

  study quality --speed --publish
      The page docs/quality.md, from the clips and seeds it is made of.

  study quality --sealed --rows all --check
      The sealed set, which every other command refuses: for a claim that is to be published, not while something is tuned.
      Each run appends a line with date, commit and results to docs/sealed-ledger.csv, which is committed.

What was made and scored once is kept in the user's cache and not made again while nothing it depends on changes, so a run
that was ended goes on where it stopped. The folder --out gets quality.md, quality.csv, quality-frames.csv with every frame,
and quality.png, the same place as every row shows it.

Exit status: 0 well, 1 failed or, with --check, a claim missed, 2 wrong usage, 130 interrupted.";

#[derive(Args)]
pub(super) struct QualityArgs {
    /// Ways to make the frames: all, built-in, or a list of repeat, blend, minterpolate, flowfps, rife, rife4,
    /// fsr-flow, fsr-engine, fsr, none, paper, cairn-flow, cairn-engine, cairn-truth
    #[arg(long, value_name = "LIST", default_value = "all")]
    rows: String,
    /// What they are made from: all, none, scenes, moving, real, or a list of forest, sword, desert, snow, moving-forest and so
    /// on, moving-indoors, moving-town, bunny, bikes, vizdoom, vizdoom-player; with --sealed, clips of the sealed set
    #[arg(long, value_name = "LIST", default_value = "all")]
    clips: String,
    /// Seeds of the scenes
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [5, 6, 7])]
    seeds: Vec<u64>,
    /// Network of LPIPS: alex, vgg or none; its weights are fetched once (64 MB)
    #[arg(long, value_name = "NET", default_value = "alex")]
    lpips: String,
    /// Two frames of one scene at a small size and what needs no other program, to see that everything works
    #[arg(long, conflicts_with_all = ["rows", "clips", "seeds", "speed", "publish", "drivers"])]
    smoke: bool,
    /// Two frames of the game's clip by every row that another program makes, to see that these programs work
    #[arg(long, conflicts_with_all = ["rows", "clips", "seeds", "speed", "publish"])]
    drivers: bool,
    /// Some fifty fixed frames of each of our rows against the committed floors in tools/study/floors.csv, and the page's claims
    /// against the same frames, in minutes; fails where one is worse
    #[arg(long, conflicts_with_all = ["rows", "clips", "seeds", "lpips", "smoke", "drivers", "check", "speed", "fresh", "publish", "sealed", "tune"])]
    floors: bool,
    /// Write the floors from what is made now, instead of comparing
    #[arg(long, requires = "floors")]
    write: bool,
    /// Open the sealed set, and append the results to its ledger
    #[arg(long, conflicts_with_all = ["seeds", "smoke", "speed"])]
    sealed: bool,
    /// A sealed set of your own in TOML, with its scripts and its ledger beside it: to try how --sealed works
    #[arg(long, value_name = "FILE", requires = "sealed", conflicts_with = "publish")]
    own_set: Option<PathBuf>,
    /// Hold the table against what is claimed, and fail where it does not bear a claim out
    #[arg(long)]
    check: bool,
    /// Take times at 1920x1080 on two threads as well, which wants an idle machine; with --clips none, nothing else
    #[arg(long)]
    speed: bool,
    /// Score everything again, and let other programs make their pictures again
    #[arg(long)]
    fresh: bool,
    /// Write docs/quality.md, its table and its figure as well
    #[arg(long)]
    publish: bool,
    /// Folder for report, tables and figure; an earlier report in it is replaced
    #[arg(long, value_name = "DIR", default_value = "target/quality")]
    out: PathBuf,
    /// Compare settings of one row, minterpolate, flowfps or rife4, on the scenes' seed 4, and print the table
    #[arg(long, value_name = "ROW", conflicts_with_all = ["rows", "clips", "seeds", "smoke", "drivers", "check", "speed", "fresh", "sealed", "publish"])]
    tune: Option<String>,
    /// No progress, no summary
    #[arg(long)]
    quiet: bool,
}

impl QualityArgs {
    fn settings(&self) -> Settings {
        let (rows, clips, seeds) = if self.smoke {
            ("built-in".into(), "forest".into(), vec![4])
        } else if self.drivers {
            ("minterpolate,flowfps,rife,rife4".into(), "vizdoom".into(), vec![4])
        } else {
            (self.rows.clone(), self.clips.clone(), self.seeds.clone())
        };
        let Self { speed, fresh, publish, sealed, .. } = *self;
        let smoke = self.smoke || self.drivers;
        let (lpips, own_set, out) = (self.lpips.clone(), self.own_set.clone(), self.out.clone());
        Settings { rows, clips, seeds, lpips, smoke, speed, fresh, publish, sealed, own_set, out }
    }
}

impl QualityArgs {
    /// Compares with the floors, or writes them.
    fn floors(&self) -> Result<ExitCode> {
        let settings = FloorSettings { write: self.write, out: self.out.join("floors"), fetch: true };
        let outcome = quality::floors(&settings, &progress(self.quiet), stop_on_interrupt()?)?;
        if outcome.interrupted {
            return Ok(ExitCode::from(130));
        }
        print_outcome(&outcome.lines.iter().map(|line| format!("{line}\n")).collect::<String>(), &outcome.files);
        Ok(ExitCode::from(u8::from(outcome.failed > 0)))
    }
}

impl Subcommand for QualityArgs {
    fn check(&self) -> Result<()> {
        self.settings().check()
    }

    fn run(&self) -> Result<ExitCode> {
        if self.floors {
            return self.floors();
        }
        if let Some(row) = &self.tune {
            print!("{}", quality::tune(row, &self.lpips, &progress(self.quiet), stop_on_interrupt()?)?);
            return Ok(ExitCode::SUCCESS);
        }
        let outcome = quality::run(&self.settings(), &progress(self.quiet), stop_on_interrupt()?)?;
        for left_out in &outcome.left_out {
            eprintln!("left out: {left_out}");
        }
        for note in &outcome.notes {
            eprintln!("note: {note}");
        }
        if !self.quiet {
            println!("{} scores computed, {} kept from earlier runs", outcome.computed, outcome.kept);
            for file in &outcome.files {
                println!("  {}", file.display());
            }
        }
        if outcome.interrupted {
            eprintln!("interrupted: {CELLS_KEPT}");
            return Ok(ExitCode::from(130));
        }
        if self.check {
            outcome.claims.iter().for_each(|claim| println!("{claim}"));
            println!("{}", outcome.tally);
        }
        Ok(ExitCode::from(u8::from(self.check && outcome.missed > 0)))
    }
    fn when_interrupted(&self) -> &'static str {
        CELLS_KEPT
    }
}
