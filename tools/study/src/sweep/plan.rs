//! Plan of a sweep: every combination of its axes in every scene, and their folders.
//!
//! ```text
//! OUT/forest-41/seed.png, script.txt, truth/    inputs of all points of a scene, and their truth
//! OUT/forest-41/g384-refined-10-.../            a rollout with its manifest and, as series.csv, its measurements
//! OUT/NAME.html, NAME.md, NAME.csv              of the sweep NAME.toml
//! ```

use std::path::{Path, PathBuf};

use cairn::bundle::Bundle;
use cairn::world::WorldTime;
use cairn::{Error, Result};
use scenes::{Family, LANDSCAPES};

use super::file::{self, File};
use super::measure::{Cost, Measure};
use super::point::{Point, refused};
use crate::compare::plan::FIRST_SEED;
use crate::compare::walk::RATE;
use crate::device::DeviceChoice;
use crate::experiment::held_out;
use crate::metrics::{Net, SSIM_WINDOW};
use crate::scene_id::{SceneId, landscape};
use crate::seed_picture::MAX_SIDE;
use crate::sets;
use crate::settings::{Formats, Settings as Rollout};
use crate::workers::{check_jobs, usual_jobs};

/// Maximum number of scenes of a family.
const MAX_SCENES_PER_FAMILY: u64 = 100;
/// Settings of a sweep: everything that affects a number, and the number of parallel rollouts.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The file it was read from.
    pub(super) file: PathBuf,
    /// Families of the scenes.
    pub(super) families: Vec<Family>,
    /// Number of scenes of each family.
    pub(super) scenes_per_family: u64,
    /// Decimal seconds of world time.
    pub(super) seconds: String,
    /// `[width, height]` of the compared frames.
    pub(super) size: [u32; 2],
    /// The bundle; `None` for the library's own.
    pub(super) world: Option<PathBuf>,
    /// Threads per pass.
    pub(super) threads: usize,
    /// Device of the world.
    pub(super) device: DeviceChoice,
    /// Whether LPIPS is measured; its weights are fetched if they are missing.
    pub(super) lpips: bool,
    /// Measure that ranks points.
    pub(super) measure: Measure,
    /// Measure of cost.
    pub(super) cost: Cost,
    /// Budgets in the unit of the cost.
    pub(super) budgets: Vec<f64>,
    /// Every combination of the axes.
    pub(super) points: Vec<Point>,
    /// Number of rollouts that run in parallel.
    pub(super) jobs: usize,
    /// The output folder.
    pub(super) out: PathBuf,
    /// Another folder for the report and its drawings, without the rollouts.
    pub(super) publish: Option<PathBuf>,
}

/// One rollout: a point in a scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell<'a> {
    pub(super) scene: SceneId,
    pub(super) point: &'a Point,
}

impl Cell<'_> {
    /// Unique name of the cell; with slashes, its folder.
    pub(super) fn name(&self) -> String {
        format!("{}-{}/{}", self.scene.family, self.scene.seed, self.point.folder_name())
    }

    pub(super) fn folder(&self, out: &Path) -> PathBuf {
        self.scene.folder(out).join(self.point.folder_name())
    }

    /// Number of frames to be made.
    pub(super) fn planned(&self, settings: &Settings) -> Result<u64> {
        let checked = self.rollout(settings).check()?;
        Ok(checked.point.counts(checked.duration).presented)
    }

    /// The rollout that makes the cell.
    pub(super) fn rollout(&self, settings: &Settings) -> Rollout {
        let out = &settings.out;
        Rollout {
            world: settings.world.clone(),
            seed_picture: Some(self.scene.seed_picture(out)),
            script: Some(self.scene.script(out, false)),
            latents: None,
            preset: None,
            operating_point: self.point.point.to_string(),
            seconds: settings.seconds.clone(),
            seed: self.scene.seed,
            size: settings.size,
            upscaler: "lanczos".into(),
            formats: Formats { png: true, ..Formats::default() },
            threads: Some(settings.threads),
            device: settings.device,
            generator: self.point.generator,
        }
    }
}

/// Replaces an option's name in an error by the file's item.
fn as_item(error: Error) -> Error {
    let item = match error.offending_field().map(|field| field.trim_start_matches("--").to_owned()) {
        Some(item) if item == "seeds" => "places".to_owned(),
        Some(item) => item,
        None => return error,
    };
    error.field(item)
}

impl Settings {
    /// Reads a sweep from its file and checks it.
    ///
    /// # Errors
    /// `Io`; `InvalidArgument`, with file and item, for an invalid sweep; `Unsupported` for a device that this machine does not have.
    pub fn read(path: &Path, out: PathBuf, jobs: Option<usize>, publish: Option<PathBuf>) -> Result<Self> {
        let text = file::read(path)?;
        let read = Self::parse(&text, path).and_then(|settings| {
            let jobs = jobs.unwrap_or_else(|| settings.usual_jobs());
            let settings = Self { out, jobs, publish, ..settings };
            settings.check().map(|()| settings)
        });
        read.map_err(|e| file::in_file(&e, path))
    }

    /// Parses the text of the file at `path`.
    fn parse(text: &str, path: &Path) -> Result<Self> {
        let file = File::parse(text)?;
        let families = match file.scenes.as_slice() {
            [] => LANDSCAPES.to_vec(),
            names => {
                let read = |name: &String| {
                    landscape(name).map_or_else(
                        || {
                            refused(
                                format!("there is no scene {name:?}"),
                                "scenes",
                                "Use forest, sword, desert or snow",
                            )
                        },
                        Ok,
                    )
                };
                names.iter().map(read).collect::<Result<_>>()?
            }
        };
        let usual = if file.lpips { Measure::Horizon } else { Measure::Ssim };
        let beside = path.parent().unwrap_or(Path::new("."));
        Ok(Self {
            points: file.points()?,
            file: path.to_owned(),
            families,
            scenes_per_family: file.places,
            seconds: file.seconds.to_string(),
            size: file.size,
            world: file.world.as_ref().map(|world| beside.join(world)),
            threads: file.threads,
            device: file.device.parse().map_err(as_item)?,
            lpips: file.lpips,
            measure: file.measure.as_deref().map_or(Ok(usual), str::parse)?,
            cost: file.cost.parse()?,
            budgets: file.budgets,
            jobs: 1,
            out: PathBuf::new(),
            publish: None,
        })
    }

    /// Default number of parallel rollouts: the number of processors divided by the threads per pass.
    fn usual_jobs(&self) -> usize {
        match self.device {
            DeviceChoice::Cpu => usual_jobs(self.threads),
            _ => 1,
        }
    }

    /// Name of the sweep: its file's name.
    pub(super) fn name(&self) -> String {
        self.file.file_stem().map_or("sweep".into(), |stem| stem.to_string_lossy().into_owned())
    }

    pub(super) fn scenes(&self) -> impl Iterator<Item = SceneId> + '_ {
        let seeds = FIRST_SEED..FIRST_SEED.saturating_add(self.scenes_per_family);
        self.families.iter().flat_map(move |&family| seeds.clone().map(move |seed| SceneId { family, seed }))
    }

    /// All cells, scene by scene.
    pub(super) fn cells(&self) -> impl Iterator<Item = Cell<'_>> + '_ {
        self.scenes().flat_map(|scene| self.points.iter().map(move |point| Cell { scene, point }))
    }

    /// Number of samples of a stream, from world time zero to the end.
    pub(super) fn sample_count(&self) -> Result<u64> {
        Ok(WorldTime::parse(&self.seconds)?.whole_steps(RATE) + 1)
    }

    /// Checks the settings; reads no other file.
    fn check(&self) -> Result<()> {
        if !(1..=MAX_SCENES_PER_FAMILY).contains(&self.scenes_per_family) {
            let remedy = format!("Use 1 to {MAX_SCENES_PER_FAMILY}");
            return refused(format!("{} places of a kind cannot be swept", self.scenes_per_family), "places", &remedy);
        }
        if (1..self.families.len()).any(|n| self.families[..n].contains(&self.families[n])) {
            return refused("a scene is named twice".into(), "scenes", "Name each once");
        }
        check_jobs(self.jobs)?;
        let least = if self.lpips { Net::Alex.smallest_side() } else { SSIM_WINDOW as u32 };
        if self.size.iter().any(|side| !(least..=MAX_SIDE).contains(side)) {
            return refused(
                format!("streams cannot be compared at {}x{}", self.size[0], self.size[1]),
                "size",
                &format!("Use a width and a height from {least} to {MAX_SIDE}, such as [320, 180]"),
            );
        }
        if self.measure.needs_lpips() && !self.lpips {
            return refused(
                format!("{} is made of LPIPS, which the sweep leaves out", self.measure),
                "measure",
                "Use ssim or psnr, or have LPIPS measured",
            );
        }
        if self.budgets.iter().any(|budget| !(*budget > 0.0 && budget.is_finite())) {
            return refused("a budget is a positive number".into(), "budgets", "Leave others out");
        }
        let seeds: Vec<u64> = self.scenes().map(|scene| scene.seed).collect();
        held_out::require(&seeds).map_err(as_item)?;
        sets::require_unsealed(&seeds, "places")?;
        for point in &self.points {
            let named = |e: Error| {
                let cause = format!("{point}: {}", e.cause());
                let named = Error::new(e.kind(), cause).field(e.offending_field().unwrap_or("sweep"));
                e.remedy_text().map_or(named.clone(), |remedy| named.remedy(remedy))
            };
            point.point.check().map_err(named)?;
            let rate = point.point.presented_rate();
            if !rate.is_multiple_of(RATE) {
                return refused(
                    format!("{point} shows {rate} frames a second"),
                    "sweep.multiplier",
                    "Streams are looked at 30 times a second: let anchor rate times multiplier be a multiple of 30",
                );
            }
        }
        self.cells().try_for_each(|cell| cell.rollout(self).check().map(drop)).map_err(as_item)
    }

    /// Fails if the world does not support the settings.
    ///
    /// # Errors
    /// `InvalidArgument`, naming the item.
    pub(super) fn check_for(&self, bundle: &Bundle) -> Result<()> {
        let check = |point: &Point| {
            point.point.check_for(bundle.geometry())?;
            point.point.schedule.table(&bundle.manifest().sampler).map(drop)
        };
        self.points.iter().try_for_each(check).map_err(|e| file::in_file(&e, &self.file))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::BTreeSet;

    use cairn::ErrorKind;
    use cairn::bundle::{OpenOptions, Precision};

    use super::super::point::LONGEST;
    use super::*;

    pub(in crate::sweep) fn parse(text: &str) -> Result<Settings> {
        let text = format!("seconds = 0.2\nsize = [64, 36]\nlpips = false\n{text}");
        let settings = Settings { out: "out".into(), ..Settings::parse(&text, Path::new("plans/mine.toml"))? };
        settings.check().map(|()| settings)
    }

    #[test]
    fn every_combination_is_one_point_and_each_is_there_once() {
        let settings = parse(
            "scenes = [\"snow\"]\nplaces = 2\n[sweep]\nwindow = [112, 384]\nsteps = [4, 10]\nmultiplier = [2, 4]\n\
             motion = [\"paper\", \"best\", \"picture\"]\n",
        )
        .unwrap();
        // The motion named "best" is the same as one of the others.
        assert_eq!(settings.points.len(), 2 * 2 * 2 * 2);
        assert_eq!(settings.cells().count(), 2 * 16);
        let folders: BTreeSet<PathBuf> = settings.cells().map(|cell| cell.folder(&settings.out)).collect();
        let names: BTreeSet<PathBuf> = settings.cells().map(|cell| settings.out.join(cell.name())).collect();
        assert_eq!((folders.len(), &folders), (32, &names));
        let one = "out/snow-42/g384-refined-4-separate-latents-15-pictures-1-generated-60-paper-cpu";
        assert!(folders.contains(Path::new(one)), "{folders:?}");
        assert_eq!((settings.name(), settings.measure, settings.seconds), ("mine".into(), Measure::Ssim, "0.2".into()));
    }

    #[test]
    fn the_examples_budgets_separate_its_points_on_the_embedded_world() {
        let bundle = Bundle::embedded(&OpenOptions::default()).unwrap();
        let page = include_str!("../../../../docs/sweep.md");
        let (_, example) = page.split_once("```toml\n").unwrap();
        let settings = Settings::parse(example.split_once("```").unwrap().0, Path::new("mine.toml")).unwrap();
        let seconds = WorldTime::parse(&settings.seconds).unwrap();
        // As `compare::budget` counts a rollout, without the few passes that the first latent is spared.
        let gflop = |point: &Point| {
            let work = bundle.cost(Precision::F32, point.point.global_window).unwrap();
            let passes = point.point.schedule.table(&bundle.manifest().sampler).unwrap().passes() as u64 + 1;
            let latents = point.point.counts(seconds).latents;
            let decodes = latents + u64::from(bundle.geometry().autoencoder.temporal - 1);
            let of_latent = passes * work.pass.multiply_adds + work.controls.multiply_adds;
            let products = latents * of_latent + decodes * work.decode.multiply_adds;
            2e-9 * (products + work.encode.multiply_adds) as f64 / seconds.seconds()
        };
        let costs: Vec<f64> = settings.points.iter().map(gflop).collect();
        let affordable: Vec<usize> =
            settings.budgets.iter().map(|budget| costs.iter().filter(|cost| *cost <= budget).count()).collect();
        assert_eq!((costs.len(), &affordable[..]), (12, &[2, 7][..]), "{costs:?}");
        let help = format!("budgets = {:?} ", settings.budgets.iter().map(|b| *b as u32).collect::<Vec<_>>());
        assert!(include_str!("../cli/sweep.rs").contains(&help), "the program's help has others than {help}");
    }

    #[test]
    fn what_changes_nothing_is_no_point_of_its_own() {
        // A point that presents anchors only depends on neither motion nor generator.
        let native = "base = \"coherence,latents:30,generated:60\"\n[sweep]\nmultiplier = [1]\nmotion = [\"paper\", \"picture\"]\n";
        let settings = parse(native).unwrap();
        assert_eq!(settings.points.len(), 1);
        assert_eq!(settings.points[0].to_string(), "g384,refined:10,separate,latents:30,pictures:1,native");
        assert_eq!(settings.points[0].multiplier(), 1);
        // Ten anchors a second, six frames per anchor.
        let sixty = parse("[sweep]\nanchor_rate = [10, 15]\nmultiplier = [6]\n").unwrap();
        let rates = sixty.points.iter().map(|p| (p.point.latents_per_second, p.point.presented_rate(), p.multiplier()));
        assert_eq!(rates.collect::<Vec<_>>(), [(10, 60, 6), (15, 90, 6)]);
        // Changing only the anchor rate keeps the number of frames per anchor.
        let doubled = parse("[sweep]\nanchor_rate = [30]\n").unwrap();
        assert_eq!(doubled.points[0].point.presented_rate(), 60);
    }

    #[test]
    fn a_world_lies_beside_its_plan() {
        let settings = parse("world = \"worlds/w.cairn\"\n").unwrap();
        assert_eq!(settings.world.as_deref(), Some(Path::new("plans/worlds/w.cairn")));
    }

    #[test]
    fn long_names_stay_apart() {
        let long = |last: &str| {
            let levels: Vec<String> = (0..30).map(|n| format!("{:.2}", 1.0 - f64::from(n) / 50.0)).collect();
            let text = format!("[sweep]\nschedule = [\"explicit:{}:{last}:0\"]\n", levels.join(":"));
            let settings = parse(&text).unwrap();
            settings.points[0].folder_name()
        };
        let (one, other) = (long("0.2"), long("0.1"));
        assert!(one != other && one.len() == LONGEST && one.starts_with("g384-explicit-1"), "{one} {other}");
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        for (text, field) in [
            ("nonsense = 1\n", "sweep"),
            ("[sweep]\nwindows = [1]\n", "sweep"),
            ("base = \"best\"\n", "base"),
            ("scenes = [\"moon\"]\n", "scenes"),
            ("scenes = [\"snow\", \"snow\"]\n", "scenes"),
            ("places = 0\n", "places"),
            ("places = 9000000000000000000\n", "places"),
            ("threads = 0\n", "threads"),
            ("device = \"gpu\"\n", "device"),
            ("budgets = [-1.0]\n", "budgets"),
            ("measure = \"horizon\"\n", "measure"),
            ("measure = \"beauty\"\n", "measure"),
            ("cost = \"euro\"\n", "cost"),
            ("[sweep]\nsteps = [4]\nschedule = [\"stock\"]\n", "sweep.steps"),
            ("[sweep]\nanchor_rate = [10]\n", "sweep.multiplier"),
            ("[sweep]\nanchor_rate = [0]\n", "sweep.anchor_rate"),
            ("[sweep]\nmultiplier = [0]\n", "sweep.multiplier"),
            ("[sweep]\nmotion = [\"guess\"]\n", "sweep.motion"),
            ("[sweep]\ncache = [\"interval:0\"]\n", "sweep.cache"),
            ("[sweep]\ngenerator = [\"hand\"]\n", "sweep.generator"),
        ] {
            let error = parse(text).unwrap_err();
            let found = (error.kind(), error.offending_field());
            assert_eq!(found, (ErrorKind::InvalidArgument, Some(field)), "{text}: {error}");
        }
        let many: Vec<String> = (1..200).map(|n| (8 * n).to_string()).collect();
        let many = format!("[sweep]\nwindow = [{0}]\nanchor_rate = [{0}]\nsteps = [{0}]\n", many.join(", "));
        assert!(parse(&many).unwrap_err().to_string().contains("too many"));
    }
}
