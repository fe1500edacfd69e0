//! From few anchors to many frames, against the truth, through the program.

mod common;

use std::process::{Command, Output};

use cairn::world::ControlScript;
use common::worlds::tiny;
use scenes::{Clip, ClipOptions, Family, Scene};
use study::metrics::psnr;

fn study(arguments: &[&str]) -> (i32, String) {
    let Output { status, stdout, stderr } =
        Command::new(env!("CARGO_BIN_EXE_study")).arg("cadence").args(arguments).output().expect("the program starts");
    let text = String::from_utf8_lossy(&stderr).into_owned() + &String::from_utf8_lossy(&stdout);
    (status.code().expect("it ends by itself"), text)
}

/// PSNR of the anchor at 54/60 s against the frame at `frame` sixtieths, drawn anew: the score of a repeated anchor.
fn repeated(size: (u32, u32), frame: usize) -> f64 {
    let script = ControlScript::parse(include_str!("../../../samples/scripts/snow.txt")).unwrap();
    let scene = Scene::new(Family::Snow, 41);
    let options = ClipOptions { width: size.0, height: size.1, rate: 60, ..ClipOptions::default() };
    let mut clip = Clip::new(&scene, &script, options).unwrap();
    let pictures: Vec<_> = (0..=60).map(|_| clip.frame().unwrap().picture).collect();
    psnr(&pictures[frame], &pictures[54]).unwrap()
}

#[test]
fn a_quick_look_has_every_phase_of_every_cadence() {
    let out = tempfile::tempdir().unwrap();
    let (world, folder) = (tiny(), out.path().join("cadence"));
    let (world, folder) = (world.to_str().unwrap(), folder.to_str().unwrap());
    let (status, text) = study(&["--quick", "--no-lpips", "--quiet", "--world", world, "--out", folder]);
    assert_eq!(status, 0, "{text}");

    let csv = std::fs::read_to_string(out.path().join("cadence/cadence.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let count = |anchors: &str, cadence: &str, motion: &str| {
        rows.iter().filter(|row| (row[2], row[3], row[4]) == (anchors, cadence, motion)).count()
    };
    // Four scenes. Of the renderer one interval each; of the world all intervals of a second, without true motion.
    for (cadence, between, intervals) in [("10-60", 5, 10), ("15-60", 3, 15), ("15-30", 1, 15), ("30-60", 1, 30)] {
        for motion in ["repeat", "picture-flow", "truth"] {
            assert_eq!(count("drawn", cadence, motion), 4 * between, "{cadence} {motion}");
            let own = if motion == "truth" { 0 } else { 4 * between * intervals };
            assert_eq!(count("world", cadence, motion), own, "{cadence} {motion}");
        }
    }
    // What is repeated at 1/6 and at 3/6 is the anchor at 0.9 s, and the truth is the renderer's at that sixtieth.
    for (part, frame) in [("1", 55), ("3", 57)] {
        let is = |row: &&Vec<&str>| row[0] == "snow" && row[2..5] == ["drawn", "10-60", "repeat"] && row[6] == part;
        let row = rows.iter().find(is).unwrap();
        let (scored, expected) = (row[7].parse::<f64>().unwrap(), repeated((128, 72), frame));
        assert!((scored - expected).abs() < 0.01, "{part}: {scored} {expected}");
    }
    let mean = |cadence: &str, motion: &str| {
        let all = rows.iter().filter(|row| row[2..5] == ["drawn", cadence, motion]);
        let all: Vec<f64> = all.map(|row| row[7].parse().unwrap()).collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    // Made frames are nearer than repeated ones, and the nearer the closer the anchors are.
    assert!(mean("10-60", "picture-flow") > mean("10-60", "repeat"));
    assert!(mean("30-60", "picture-flow") > mean("10-60", "picture-flow"));
    // In pictures this small, found motion makes frames as near as the true one does.
    let (found, truth) = (mean("10-60", "picture-flow"), mean("10-60", "truth"));
    assert!(truth > found - 0.1, "{found} {truth}");

    let page = std::fs::read_to_string(out.path().join("cadence/cadence.md")).unwrap();
    for words in ["10 -> 60", "15 -> 60", "15 -> 30", "30 -> 60", "| 5/6 ", "(cadence.png)"] {
        assert!(page.contains(words), "{words}");
    }
    let figure = image::open(out.path().join("cadence/cadence.png")).unwrap();
    assert_eq!((figure.width(), figure.height()), (128 + 7 * 166, 32 + 4 * 96));
}

#[test]
fn places_that_a_world_may_have_seen_are_refused() {
    let (status, text) = study(&["--seeds", "41,1000"]);
    assert!(status == 2 && text.contains("1000") && text.contains("held-out.txt"), "{status}: {text}");
}
