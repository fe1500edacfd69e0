//! The comparison through the program: every branch of one scene, and which parts a second run keeps or makes again.

mod common;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn compare(out: &Path, more: &[&str]) -> (Option<i32>, String) {
    let Output { status, stdout, stderr } = command(out, more).output().expect("the program starts");
    let text = String::from_utf8_lossy(&stdout).into_owned() + &String::from_utf8_lossy(&stderr);
    (status.code(), text)
}

fn command(out: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_study"));
    command.args(["compare", "--scene", "forest", "--seconds", "0.2", "--size", "128x72", "--no-lpips", "--quiet"]);
    command.arg("--out").arg(out).args(more);
    command
}

/// When each file below `folder` was written.
fn times(folder: &Path) -> Vec<(String, std::time::SystemTime)> {
    let mut all: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .flatten()
        .flat_map(|entry| match entry.file_type().unwrap().is_dir() {
            true => times(&entry.path()),
            false => vec![(entry.path().display().to_string(), entry.metadata().unwrap().modified().unwrap())],
        })
        .collect();
    all.sort();
    all
}

/// The lines of a report that neither a clock nor a commit decides.
fn figures(out: &Path) -> Vec<String> {
    let text = fs::read_to_string(out.join("report.md")).unwrap();
    let measured = text.split("## Seconds of computing").next().unwrap().to_owned();
    let changes = |line: &&str| line.contains("kept from before") || line.starts_with("*Made at commit ");
    measured.lines().filter(|line| !changes(line)).map(str::to_owned).collect()
}

#[test]
fn a_comparison_is_made_once_and_goes_on_where_it_was_broken_off() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("compare");
    let (status, text) = compare(&out, &[]);
    assert_eq!(status, Some(0), "{text}");
    let place = out.join("forest-41");
    for (branch, frames) in [
        ("coherence", 7),
        ("coherence-best", 7),
        ("baseline", 7),
        ("baseline-doubled", 7),
        ("heavy", 7),
        ("decoded-60", 13),
        ("truth", 7),
    ] {
        assert_eq!(fs::read_dir(place.join(branch).join("frames")).unwrap().count(), frames, "{branch}");
        assert!(place.join(branch).join("manifest.json").exists(), "{branch}");
    }
    for words in
        ["g128", "g384", "g512", "0.0449 / 0.0677", "Radeon RX 9070 XT", "cannot be told: too short a walk, 0.2 s"]
    {
        assert!(text.contains(words), "{words}: {text}");
    }
    // Every table and figure of the paper that its forest has a part in, and every file that the report has beside it.
    for number in 2..=7 {
        assert!(text.contains(&format!("## Table {number}: ")), "table {number}");
    }
    for number in ["1", "2", "3"] {
        assert!(text.contains(&format!("## Figure {number}: ")), "figure {number}");
    }
    let named = text.lines().filter_map(|line| line.strip_prefix("![")?.split_once("](")?.1.strip_suffix(')'));
    let named: Vec<&str> = named.collect();
    assert!(named.len() >= 6 && named.iter().all(|path| out.join(path).metadata().unwrap().len() > 0), "{named:?}");
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("<video") && page.matches("data:image/jpeg").count() == 3 && !page.contains("src=\"http"));
    let video = fs::read(place.join("side-by-side.mp4")).unwrap();
    assert_eq!(video.get(4..8), Some(&b"ftyp"[..]));
    // The same latents: at the times of the anchors both show the same picture, bit for bit.
    let frame =
        |branch: &str, number: u32| fs::read(place.join(branch).join(format!("frames/{number:06}.png"))).unwrap();
    for anchor in 0..=3 {
        let decoded = frame("decoded-60", 4 * anchor);
        assert!(["coherence", "coherence-best"].iter().all(|b| frame(b, 2 * anchor) == decoded), "anchor {anchor}");
    }
    assert_ne!(frame("coherence", 1), frame("coherence-best", 1), "between them each has its own motion");
    assert_ne!(frame("coherence", 1), frame("decoded-60", 2), "between them one is generated, the other decoded");
    let series = fs::read_to_string(place.join("series.csv")).unwrap();
    assert_eq!(series.lines().count(), 2 + 7 * 7, "a line for each frame of truth and branches");

    // Nothing is made again; the report may be put elsewhere, without the rollouts.
    let (first, before) = (figures(&out), times(&place.join("coherence")));
    let filmed = fs::metadata(place.join("side-by-side.mp4")).unwrap().modified().unwrap();
    let published = folder.path().join("published");
    let (status, text) = compare(&out, &["--publish", published.to_str().unwrap()]);
    assert!(status == Some(0) && text.contains("6 of them kept"), "{text}");
    assert_eq!(fs::metadata(place.join("side-by-side.mp4")).unwrap().modified().unwrap(), filmed);
    // The published report is the same text with compressed figures, without the page.
    let report = |folder: &Path| fs::read_to_string(folder.join("report.md")).unwrap();
    assert_eq!(report(&published), report(&out));
    assert!(report(&out).lines().nth(2).unwrap().starts_with("*Made at commit "), "{}", report(&out));
    let size = |folder: &Path, path: &str| fs::metadata(folder.join(path)).unwrap().len();
    for path in &named {
        let (small, full) = (size(&published, path), size(&out, path));
        assert!(
            small > 0 && if path.ends_with(".jpg") { small < full } else { small == full },
            "{path}: {small} {full}"
        );
    }
    assert!(!published.join("report.html").exists());
    assert_eq!((times(&place.join("coherence")), figures(&out)), (before.clone(), first.clone()));

    // What is missing is made again, and nothing else; the figures are the same.
    fs::remove_file(place.join("baseline/frames/000003.png")).unwrap();
    let half = fs::read_to_string(place.join("heavy/manifest.json"))
        .unwrap()
        .replace("\"complete\": true", "\"complete\": false");
    fs::write(place.join("heavy/manifest.json"), half).unwrap();
    for file in ["series.csv", "seed.png", "script.txt", "truth/frames/000002.png"] {
        fs::remove_file(place.join(file)).unwrap();
    }
    let (status, text) = compare(&out, &["--jobs", "1"]);
    assert!(status == Some(0) && text.contains("4 of them kept"), "{text}");
    assert_eq!((times(&place.join("coherence")), figures(&out)), (before, first));

    // What a newer program wrote is not replaced.
    for manifest in ["baseline/manifest.json", "truth/manifest.json", "side-by-side.json"] {
        let manifest = place.join(manifest);
        let own = fs::read_to_string(&manifest).unwrap();
        let newer = own.replace("\"manifest_version\": 1", "\"manifest_version\": 2");
        assert_ne!(newer, own);
        fs::write(&manifest, &newer).unwrap();
        let (status, text) = compare(&out, &[]);
        assert!(status == Some(1) && text.contains("version 2") && text.contains("wrote it"), "{text}");
        assert_eq!(fs::read_to_string(&manifest).unwrap(), newer);
        fs::write(&manifest, own).unwrap();
    }
}

#[test]
fn a_scene_that_is_not_there_is_told_with_those_that_are() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("compare");
    for scene in ["moon", "", "forest-41", "forest,snow"] {
        let mut program = Command::new(env!("CARGO_BIN_EXE_study"));
        let program = program.args(["compare", "--scene", scene, "--no-lpips", "--quiet", "--out"]).arg(&out);
        let Output { status, stderr, .. } = program.output().expect("the program starts");
        let text = String::from_utf8_lossy(&stderr);
        assert!(status.code() == Some(2) && text.contains(&format!("no scene {scene:?}")), "{status}: {text}");
        assert!(text.contains("--scene") && text.contains("Use forest, sword, desert, snow or all"), "{text}");
        assert!(!out.exists(), "{text}");
    }
}

/// A process that is killed takes nothing with it but its own cell.
#[cfg(target_os = "linux")]
#[test]
fn a_killed_rollout_is_named_and_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("compare");
    let program = command(&out, &["--jobs", "1"]).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let (id, since) = (program.id(), std::time::Instant::now());
    let child = loop {
        let children = fs::read_to_string(format!("/proc/{id}/task/{id}/children")).unwrap_or_default();
        if let Some(child) = children.split_whitespace().next() {
            break child.to_owned();
        }
        assert!(since.elapsed().as_secs() < 120, "no rollout was begun");
        std::thread::sleep(std::time::Duration::from_millis(2));
    };
    assert!(Command::new("kill").args(["-9", &child]).status().unwrap().success());
    let Output { status, stderr, .. } = program.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&stderr);
    assert_eq!(status.code(), Some(1), "{text}");
    assert!(
        text.contains("forest 41, coherence") && text.contains("signal: 9") && text.contains("same command"),
        "{text}"
    );
    let (status, text) = compare(&out, &[]);
    assert!(status == Some(0) && text.contains("0 of them kept"), "{text}");
}

/// A disk that takes nothing more, where a place's seed, the series or the report should go: `/dev/full` stands for it.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_and_what_was_whole_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("compare");
    let place = out.join("forest-41");
    let rollout = place.join("coherence/manifest.json");
    for (file, made) in [("forest-41/seed.png", false), ("forest-41/series.csv", true), ("report.html", true)] {
        let part = out.join(format!("{file}.part"));
        fs::create_dir_all(part.parent().unwrap()).unwrap();
        std::os::unix::fs::symlink("/dev/full", &part).unwrap();
        let (status, text) = compare(&out, &[]);
        assert_eq!(status, Some(1), "{file}: {text}");
        assert!(text.contains("No space left") && text.contains("Free some space") && text.contains(file), "{text}");
        assert_eq!((rollout.exists(), out.join(file).exists()), (made, false), "{file}");
    }
    let made = times(&place);
    let (status, text) = compare(&out, &[]);
    assert!(status == Some(0) && text.contains("6 of them kept"), "{text}");
    let again = times(&place);
    assert!(made.iter().all(|file| again.contains(file)), "what was whole is not made again");
}

/// A rollout's process that may not write larger files fails, and the message has its error and its name.
#[cfg(target_os = "linux")]
#[test]
fn what_a_rollout_cannot_write_is_told_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("compare");
    let whole = command(&out, &["--jobs", "1"]);
    // Seed picture and frames are smaller than 90 KB, the latents of the doubled baseline are not.
    let mut limited = Command::new("sh");
    limited
        .args(["-c", "trap '' XFSZ; ulimit -f 180; exec \"$@\"", "sh"])
        .arg(whole.get_program())
        .args(whole.get_args());
    let Output { status, stderr, .. } = limited.output().expect("a shell");
    let text = String::from_utf8_lossy(&stderr);
    assert_eq!(status.code(), Some(1), "{text}");
    for words in ["forest 41, ", "File too large", "Choose a disk that takes larger files", "same command again"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert!(!out.join("report.md").exists(), "nothing is told of half a comparison");
    let (status, text) = compare(&out, &[]);
    assert!(status == Some(0) && text.contains("6 rollouts, "), "{text}");
}

#[test]
fn a_world_without_the_windows_is_refused_before_anything_is_made() {
    let out = tempfile::tempdir().unwrap();
    let tiny = common::worlds::tiny();
    let (status, text) = compare(&out.path().join("compare"), &["--world", tiny.to_str().unwrap()]);
    assert!(status == Some(2) && text.contains("global_window"), "{status:?}: {text}");
    assert!(!out.path().join("compare").exists());
}

#[test]
fn weights_that_are_missing_are_told_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let (out, nowhere) = (folder.path().join("compare"), folder.path().join("no-weights"));
    let mut program = Command::new(env!("CARGO_BIN_EXE_study"));
    program
        .args(["compare", "--scene", "forest", "--seconds", "0.2", "--size", "128x72", "--quiet", "--out"])
        .arg(&out);
    let Output { status, stderr, .. } = program.env("CAIRN_LPIPS", &nowhere).output().expect("the program starts");
    let text = String::from_utf8_lossy(&stderr);
    assert!(status.code() == Some(1) && text.contains("no-weights"), "{status}: {text}");
    assert!(!out.exists(), "{text}");
}
