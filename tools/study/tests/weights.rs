//! Worlds with other weights beside the first one, through the program.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use common::worlds::{test_world, tiny};

fn study(arguments: &[&str]) -> (i32, String) {
    let Output { status, stdout, stderr } =
        Command::new(env!("CARGO_BIN_EXE_study")).arg("weights").args(arguments).output().expect("the program starts");
    let text = String::from_utf8_lossy(&stderr).into_owned() + &String::from_utf8_lossy(&stdout);
    (status.code().expect("it ends by itself"), text)
}

/// A copy of `world` with another name, and so another digest.
fn renamed(world: &Path, folder: &Path) -> PathBuf {
    let copy = folder.join("renamed");
    std::fs::create_dir(&copy).unwrap();
    for entry in std::fs::read_dir(world).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, copy.join(path.file_name().unwrap())).unwrap();
    }
    let manifest = copy.join("cairn-world.json");
    let mut fields: serde_json::Value = serde_json::from_slice(&std::fs::read(&manifest).unwrap()).unwrap();
    fields["name"] = "another name".into();
    std::fs::write(&manifest, serde_json::to_vec(&fields).unwrap()).unwrap();
    copy
}

#[test]
fn a_world_beside_itself_differs_in_nothing_and_goes_on_where_it_was() {
    let out = tempfile::tempdir().unwrap();
    let (world, folder) = (tiny(), out.path().join("weights"));
    let same = renamed(&world, out.path());
    let (world, same, folder_name) = (world.to_str().unwrap(), same.to_str().unwrap(), folder.to_str().unwrap());
    let arguments =
        ["--world", world, same, "--walks", "1", "--seconds", "2", "--no-lpips", "--quiet", "--out", folder_name];
    let (status, text) = study(&[&arguments[..], &["--jobs", "2"]].concat());
    assert_eq!(status, 0, "{text}");
    assert!(text.contains("4 held-out walks of 2 s"), "{text}");
    let last = text.lines().last().unwrap();
    assert!(last.starts_with("| renamed ") && last.contains("+0.00 [+0.00, +0.00]") && last.ends_with("- |"), "{last}");
    assert!(!text.contains("horizon"), "it needs LPIPS: {text}");

    let csv = std::fs::read_to_string(folder.join("weights.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().skip(1).map(|line| line.split(',').collect()).collect();
    // Four walks, two worlds and the first picture, two pictures of each of two seconds.
    assert_eq!(rows.len(), 4 * 3 * 4, "{csv}");
    let of = |what: &str| -> Vec<&Vec<&str>> { rows.iter().filter(|row| row[1].contains(what)).collect() };
    assert_eq!(of("repeat").len(), 4 * 4);
    assert!(of("repeat").iter().all(|row| row[2].parse::<f64>().unwrap() <= 2.0), "{csv}");
    // The worlds differ from the first picture, and walks from each other.
    let psnr = |what: &str| -> Vec<&str> { of(what).iter().map(|row| row[3]).collect() };
    assert_ne!(psnr("repeat")[..4], psnr("repeat")[4..8]);
    assert_ne!(psnr("repeat"), psnr("renamed"));

    // A rollout that was kept is not made again, one that is missing is, and no number depends on the jobs.
    let kept = |walk: &str| {
        let files = std::fs::read_dir(folder.join("rollouts")).unwrap().map(|entry| entry.unwrap().path());
        files.filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with(walk)).collect::<Vec<_>>()
    };
    let [missing, other] = ["sword-0", "snow-0"].map(|walk| kept(walk)[0].clone());
    let before = std::fs::read(&missing).unwrap();
    std::fs::remove_file(&missing).unwrap();
    let written = std::fs::metadata(&other).unwrap().modified().unwrap();
    let (status, again) = study(&[&arguments[..], &["--jobs", "1"]].concat());
    assert_eq!((status, again), (0, text));
    assert!(std::fs::read(&missing).unwrap() == before, "the rollout made again differs");
    assert_eq!(std::fs::metadata(&other).unwrap().modified().unwrap(), written);
}

#[test]
fn worlds_of_another_kind_and_walks_that_do_not_exist_are_refused() {
    let (tiny, other) = (tiny(), test_world("window"));
    let (status, text) = study(&["--no-lpips", "--world", tiny.to_str().unwrap(), other.to_str().unwrap()]);
    assert!(
        status == 2 && text.contains("window is not the first world") && text.contains("quantise"),
        "{status}: {text}"
    );
    let (status, text) = study(&["--walks", "9"]);
    assert!(status == 2 && text.contains("--walks") && text.contains("8 held-out walks"), "{status}: {text}");
    let (status, text) = study(&["--preset", "best"]);
    assert!(status == 2 && text.contains("coherence"), "{status}: {text}");
}
