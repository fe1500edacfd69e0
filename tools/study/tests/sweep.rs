//! Sweeps through the program: a first run, a run after a kill, single jobs, and refused input.

mod common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Two points in one place.
const PLAN: &str = "scenes = [\"sword\"]\nseconds = 0.2\nsize = [128, 72]\nlpips = false\nbudgets = [1e-3, 1e6]\n\
                    [sweep]\nwindow = [128]\nsteps = [4, 6]\n";

/// A plan in a folder of its own, and the folder for everything.
struct Sweep {
    folder: tempfile::TempDir,
}

impl Sweep {
    fn new() -> Self {
        Self::of(PLAN)
    }

    fn of(plan: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("mine.toml"), plan).unwrap();
        Self { folder }
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    /// The folder of a point.
    fn cell(&self, steps: u32) -> PathBuf {
        self.out().join("sword-41").join(name(steps))
    }

    fn command(&self, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_study"));
        command.arg("sweep").arg(self.folder.path().join("mine.toml")).arg("--out").arg(self.out()).args(more);
        command
    }

    fn run(&self, more: &[&str]) -> (Option<i32>, String) {
        let Output { status, stdout, stderr } = self.command(more).arg("--quiet").output().expect("the program starts");
        (status.code(), String::from_utf8_lossy(&stdout).into_owned() + &String::from_utf8_lossy(&stderr))
    }

    /// The same without standard error, where ONNX Runtime may have remarks about a processor that it does not know.
    fn told(&self, more: &[&str]) -> (Option<i32>, String) {
        let Output { status, stdout, .. } = self.command(more).arg("--quiet").output().expect("the program starts");
        (status.code(), String::from_utf8_lossy(&stdout).into_owned())
    }

    /// Makes the missing rollouts. Returns the numbers of all rollouts and of kept ones.
    fn made(&self, more: &[&str]) -> [usize; 2] {
        let (status, text) = self.run(more);
        assert_eq!(status, Some(0), "{text}");
        let words: Vec<&str> = text.split_whitespace().collect();
        let before = |word: &str| words.iter().position(|w| *w == word).and_then(|at| words[at - 1].parse().ok());
        let kept = words.windows(4).find(|words| words[1..] == ["of", "them", "kept"]).map(|words| words[0].parse());
        [before("rollouts,").unwrap(), kept.unwrap().unwrap()]
    }

    /// Every rollout's line, without the time that it took.
    fn numbers(&self) -> Vec<String> {
        let text = fs::read_to_string(self.out().join("mine.csv")).unwrap();
        text.lines().map(|line| line.rsplit_once(',').unwrap().0.to_owned()).collect()
    }
}

fn name(steps: u32) -> String {
    format!("g128-refined-{steps}-separate-latents-15-pictures-1-generated-30-paper-cpu")
}

/// When each file of a cell was written.
fn times(cell: &Path) -> Vec<(PathBuf, std::time::SystemTime)> {
    let files = fs::read_dir(cell).unwrap().chain(fs::read_dir(cell.join("frames")).unwrap()).flatten();
    let mut all: Vec<_> = files.map(|entry| (entry.path(), entry.metadata().unwrap().modified().unwrap())).collect();
    all.sort();
    all
}

#[test]
fn a_sweep_is_made_once_and_nothing_whole_again() {
    let sweep = Sweep::new();
    let (status, text) = sweep.run(&["--jobs", "2"]);
    assert_eq!(status, Some(0), "{text}");
    for words in [
        "# Sweep mine",
        "none is so cheap",
        "The operating point for a budget",
        "Is more compute better?",
        "Where more compute is worse",
        "Of 1 steps",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    for steps in [4, 6] {
        assert!(sweep.cell(steps).join("manifest.json").exists() && sweep.cell(steps).join("series.csv").exists());
        assert_eq!(fs::read_dir(sweep.cell(steps).join("frames")).unwrap().count(), 7);
    }
    let numbers = sweep.numbers();
    assert!(
        numbers.len() == 3 && numbers[1].starts_with("sword,41,128,refined:4,4,separate,15,2,paper,cpu,"),
        "{numbers:?}"
    );
    assert_ne!(numbers[1], numbers[2]);
    let named = text.lines().filter_map(|line| line.strip_prefix("![")?.rsplit_once("](")?.1.strip_suffix(')'));
    let named: Vec<&str> = named.collect();
    assert!(named.len() >= 3 && named.iter().all(|path| sweep.out().join(path).exists()), "{named:?}");
    let page = fs::read_to_string(sweep.out().join("mine.html")).unwrap();
    assert!(page.matches("<svg").count() == named.len() && !page.contains("src="), "drawings are inside");

    // Nothing is made again, and a copy of the report may be put elsewhere.
    let before = (times(&sweep.cell(4)), times(&sweep.cell(6)));
    let published = sweep.folder.path().join("published");
    assert_eq!(sweep.made(&["--publish", published.to_str().unwrap()]), [2, 2]);
    assert_eq!((times(&sweep.cell(4)), times(&sweep.cell(6))), before);
    for name in named.iter().chain(&["mine.html", "mine.md", "mine.csv"]) {
        assert_eq!(fs::read(published.join(name)).unwrap(), fs::read(sweep.out().join(name)).unwrap(), "{name}");
    }

    // A sweep that has a point in common takes it over; one that measures anew makes no rollout.
    fs::write(sweep.folder.path().join("mine.toml"), PLAN.replace("[4, 6]", "[5, 6]")).unwrap();
    assert_eq!(sweep.made(&[]), [2, 1]);
    fs::write(sweep.folder.path().join("mine.toml"), PLAN).unwrap();
    fs::remove_file(sweep.cell(4).join("series.csv")).unwrap();
    assert_eq!(sweep.made(&[]), [2, 1]);
    let frames = |cell: &[(PathBuf, std::time::SystemTime)]| {
        cell.iter().filter(|(path, _)| !path.ends_with("series.csv")).cloned().collect::<Vec<_>>()
    };
    assert_eq!(frames(&times(&sweep.cell(4))), frames(&before.0));
    assert_eq!(sweep.numbers(), numbers);

    // A page names the commits that made its rollouts, which their manifests have, not the one that publishes it.
    let manifest = sweep.cell(4).join("manifest.json");
    let mut kept: serde_json::Value = serde_json::from_slice(&fs::read(&manifest).unwrap()).unwrap();
    let own = kept["versions"]["source"]["generator"].as_str().unwrap().to_owned();
    kept["versions"]["source"] = serde_json::json!({"commit": "`0000001` of 2026-01-01", "generator": "0011"});
    fs::write(&manifest, serde_json::to_vec_pretty(&kept).unwrap()).unwrap();
    assert_eq!(sweep.made(&["--publish", published.to_str().unwrap()]), [2, 2]);
    let page = fs::read_to_string(published.join("mine.md")).unwrap();
    let line = page.lines().nth(2).unwrap();
    assert!(line.starts_with("*Made at commit ") && line.contains("and at commit "), "{line}");
    assert!(line.contains("`0000001` of 2026-01-01; generator sources `0011`") && line.contains(&own), "{line}");

    // What a newer program wrote is not replaced.
    let newer = fs::read_to_string(&manifest).unwrap().replace("\"manifest_version\": 1", "\"manifest_version\": 2");
    fs::write(&manifest, &newer).unwrap();
    for more in [&[][..], &["--list-jobs"], &["--only", &format!("sword-41/{}", name(4))]] {
        let (status, text) = sweep.run(more);
        assert!(status == Some(1) && text.contains("version 2") && text.contains("wrote it"), "{text}");
    }
    assert_eq!(fs::read_to_string(&manifest).unwrap(), newer);
}

/// A killed worker loses only its current rollout, and the final numbers equal those of an undisturbed sweep.
#[cfg(target_os = "linux")]
#[test]
fn a_killed_worker_is_named_and_the_sweep_goes_on_to_the_same_numbers() {
    use std::process::Stdio;

    let (killed, peaceful) = (Sweep::new(), Sweep::new());
    let mut program =
        killed.command(&["--jobs", "1", "--quiet"]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    // In the middle of its frames.
    let (frame, since) = (killed.cell(4).join("frames/000001.png"), std::time::Instant::now());
    while !frame.exists() {
        assert!(since.elapsed().as_secs() < 300 && program.try_wait().unwrap().is_none(), "no frame came");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let id = program.id();
    let children = fs::read_to_string(format!("/proc/{id}/task/{id}/children")).unwrap();
    let child = children.split_whitespace().next().expect("a worker makes frames");
    assert!(Command::new("kill").args(["-9", child]).status().unwrap().success());
    let Output { status, stderr, .. } = program.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&stderr);
    assert!(status.code() == Some(1) && text.contains(&name(4)), "{status}: {text}");
    assert!(text.contains("signal: 9") && text.contains("Run the same command again"), "{text}");
    assert!(!killed.out().join("mine.md").exists(), "nothing is told of half a sweep");

    assert_eq!(killed.made(&[]), [2, 0]);
    assert_eq!(peaceful.made(&[]), [2, 0]);
    assert_eq!(killed.numbers(), peaceful.numbers());
    for steps in [4, 6] {
        for frame in 0..7 {
            let bytes = |sweep: &Sweep| fs::read(sweep.cell(steps).join(format!("frames/{frame:06}.png"))).unwrap();
            assert_eq!(bytes(&killed), bytes(&peaceful), "{steps} steps, frame {frame}");
        }
    }
}

#[test]
fn jobs_are_listed_and_each_can_be_made_by_itself() {
    let sweep = Sweep::new();
    let list = || -> serde_json::Value {
        let (status, text) = sweep.told(&["--list-jobs"]);
        assert_eq!(status, Some(0), "{text}");
        serde_json::from_str(&text).unwrap()
    };
    let first = list();
    assert_eq!((first["list_version"].as_u64(), first["threads"].as_u64()), (Some(1), Some(1)));
    let of = |list: &serde_json::Value, item: &str| {
        list["jobs"].as_array().unwrap().iter().map(|job| job[item].clone()).collect::<Vec<_>>()
    };
    let names: Vec<String> = [4, 6].map(|steps| format!("sword-41/{}", name(steps))).into();
    assert_eq!(of(&first, "name"), names);
    assert_eq!((of(&first, "frames"), of(&first, "whole")), (vec![7.into(); 2], vec![false.into(); 2]));
    assert_eq!(
        of(&first, "operating_point")[0],
        "g128,refined:4,separate,latents:15,pictures:1,generated:30:paper,cpu"
    );
    assert!(!sweep.cell(4).exists(), "nothing is made");

    // Twice at the same time: one makes it, the other waits and finds it.
    let both = [(); 2].map(|()| sweep.command(&["--only", &names[1], "--quiet"]).spawn().unwrap());
    for mut one in both {
        assert!(one.wait().unwrap().success());
    }
    assert_eq!(of(&list(), "whole"), [false, true]);
    let before = times(&sweep.cell(6));
    let (status, text) = sweep.told(&["--only", &names[1]]);
    assert_eq!((status, text.as_str(), times(&sweep.cell(6))), (Some(0), "", before));
    let (status, text) = sweep.run(&["--only", "sword-41/g9"]);
    assert!(status == Some(2) && text.contains("--list-jobs"), "{text}");
}

#[test]
fn weights_that_are_missing_are_told_before_anything_is_made() {
    let sweep = Sweep::of(&PLAN.replace("lpips = false", "lpips = true"));
    let nowhere = sweep.folder.path().join("no-weights");
    // The sweep, and a node of a cluster that was given one of its jobs.
    for more in [&[][..], &["--only", &format!("sword-41/{}", name(4))]] {
        let program = sweep.command(more).arg("--quiet").env("CAIRN_LPIPS", &nowhere).output();
        let Output { status, stderr, .. } = program.expect("the program starts");
        let text = String::from_utf8_lossy(&stderr);
        assert!(status.code() == Some(1) && text.contains("no-weights"), "{more:?}: {status}: {text}");
        assert!(!sweep.cell(4).exists(), "{more:?}");
    }
}

/// A disk that takes nothing more, where a manifest or the series should go: `/dev/full` stands for it.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_and_the_sweep_goes_on_when_there_is_room() {
    let sweep = Sweep::of(&PLAN.replace("[4, 6]", "[4]"));
    for (file, kept) in [("seed.png", false), (&format!("{}/series.csv", name(4)) as &str, true)] {
        let part = sweep.out().join("sword-41").join(format!("{file}.part"));
        fs::create_dir_all(part.parent().unwrap()).unwrap();
        std::os::unix::fs::symlink("/dev/full", &part).unwrap();
        let (status, text) = sweep.run(&[]);
        assert_eq!(status, Some(1), "{text}");
        assert!(text.contains("No space left") && text.contains("Free some space") && text.contains(file), "{text}");
        assert_eq!(sweep.cell(4).join("manifest.json").exists(), kept, "what was whole is kept");
    }
    let made = times(&sweep.cell(4));
    // It was made in the run before, and measured in this one.
    assert_eq!(sweep.made(&[]), [1, 0]);
    let again = times(&sweep.cell(4));
    assert!(made.iter().all(|file| again.contains(file)), "the rollout was made once");
}

#[test]
fn what_makes_no_sense_is_refused_before_anything_is_made() {
    for (plan, status, words) in [
        (PLAN.replace("[128]", "[12]"), 2, &["mine.toml: global_window", "g12"][..]),
        (PLAN.replace("[4, 6]", "[3]"), 2, &["mine.toml", "refined:3"]),
        (PLAN.replace("[4, 6]", "[4]\nmultiplier = [1]"), 2, &["mine.toml: sweep.multiplier", "15 frames a second"]),
        (PLAN.replace("window", "windows"), 2, &["mine.toml: sweep", "windows", "line"]),
        (PLAN.replace("lpips = false", "measure = \"lpips\"\nlpips = false"), 2, &["mine.toml: measure"]),
        (PLAN.replace("seconds = 0.2", "seconds = \"soon\""), 2, &["mine.toml: seconds", "soon"]),
        (PLAN.replace("lpips", "world = \"none.cairn\"\nlpips"), 1, &["none.cairn"]),
    ] {
        let sweep = Sweep::of(&plan);
        let (found, text) = sweep.run(&[]);
        assert_eq!(found, Some(status), "{plan}: {text}");
        assert!(words.iter().all(|words| text.contains(words)), "{words:?}: {text}");
        assert!(!sweep.out().exists(), "{plan}");
    }
    let (status, text) = Sweep::new().run(&["--jobs", "0"]);
    assert!(status == Some(2) && text.contains("--jobs"), "{text}");
    let tiny = common::worlds::tiny();
    let sweep = Sweep::of(&PLAN.replace("lpips", &format!("world = {tiny:?}\nlpips")));
    let (status, text) = sweep.run(&[]);
    assert!(status == Some(2) && text.contains("g128") && !sweep.out().exists(), "{text}");
}

#[test]
fn the_sweeps_that_come_with_it_make_sense() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("sweeps");
    let mut seen = 0;
    for plan in fs::read_dir(folder).unwrap().flatten() {
        let out = tempfile::tempdir().unwrap();
        let listed = Command::new(env!("CARGO_BIN_EXE_study"))
            .arg("sweep")
            .arg(plan.path())
            .args(["--list-jobs", "--quiet", "--out"])
            .arg(out.path())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&listed.stdout).into_owned() + &String::from_utf8_lossy(&listed.stderr);
        assert!(listed.status.success() && text.contains("\"whole\": false"), "{:?}: {text}", plan.path());
        seen += 1;
    }
    assert!(seen >= 3);
}
