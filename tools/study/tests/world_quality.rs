//! A world against the truth, through the program: the written files, and that the truth is that of the scenes.

mod common;

use std::process::{Command, Output};

use cairn::world::ControlScript;
use common::worlds::tiny;
use scenes::{Clip, ClipOptions, Family, Scene};
use study::metrics::psnr;

fn study(arguments: &[&str]) -> (i32, String) {
    let Output { status, stdout, stderr } = Command::new(env!("CARGO_BIN_EXE_study"))
        .arg("world-quality")
        .args(arguments)
        .output()
        .expect("the program starts");
    let text = String::from_utf8_lossy(&stderr).into_owned() + &String::from_utf8_lossy(&stdout);
    (status.code().expect("it ends by itself"), text)
}

/// PSNR of the first picture against that at `frame` fifteenths of a second, drawn anew.
fn standing_still(family: Family, script: &str, size: (u32, u32), frame: usize) -> f64 {
    let (scene, script) = (Scene::new(family, 41), ControlScript::parse(script).unwrap());
    let options = ClipOptions { width: size.0, height: size.1, rate: 15, ..ClipOptions::default() };
    let mut clip = Clip::new(&scene, &script, options).unwrap();
    let pictures: Vec<_> = (0..=frame).map(|_| clip.frame().unwrap().picture).collect();
    psnr(&pictures[frame], &pictures[0]).unwrap()
}

#[test]
fn a_quick_look_has_every_scene_and_every_column() {
    let out = tempfile::tempdir().unwrap();
    let (world, folder) = (tiny(), out.path().join("quality"));
    let (world, folder) = (world.to_str().unwrap(), folder.to_str().unwrap());
    let (status, text) = study(&["--quick", "--no-lpips", "--quiet", "--world", world, "--out", folder]);
    assert_eq!(status, 0, "{text}");
    assert!(text.contains("random weights") && text.contains("places 41: all on the held-out list"), "{text}");
    let last = text.lines().last().unwrap();
    assert!(last.starts_with("at 0.5 s: forest ") && last.matches("correlation").count() == 4, "{last}");

    let csv = std::fs::read_to_string(out.path().join("quality/world-quality.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().skip(1).map(|line| line.split(',').collect()).collect();
    // Four scenes; 0.5, 1, 2 and 5 s; the world and two baselines; and the stock schedule up to 2 s.
    assert_eq!(rows.len(), 4 * (4 * 3 + 3), "{csv}");
    let world = |what| rows.iter().find(|row| row[0] == "desert" && row[2] == "0.5" && row[3] == what).unwrap();
    assert_ne!(world("stock")[4], world("world")[4], "another schedule makes other pictures");
    let lasting = std::fs::read_to_string(out.path().join("quality/world-quality-lasting.csv")).unwrap();
    assert_eq!(lasting.lines().count(), 1 + 4 * 3, "four scenes; 1, 2 and 5 s: {lasting}");
    let row = rows.iter().find(|row| row[0] == "snow" && row[2] == "1" && row[3] == "repeat").unwrap();
    let expected = standing_still(Family::Snow, include_str!("../../../samples/scripts/snow.txt"), (128, 72), 15);
    assert!((row[4].parse::<f64>().unwrap() - expected).abs() < 1e-3, "{row:?}, {expected}");
    // The sheets show two places each: those where the world gains most over standing still, and the others.
    let gain = |scene: &str| {
        let sum = |what: &str| -> f64 {
            rows.iter().filter(|row| row[0] == scene && row[3] == what).map(|row| row[4].parse::<f64>().unwrap()).sum()
        };
        sum("world") - sum("repeat")
    };
    let mut ranked = ["forest", "sword", "desert", "snow"];
    ranked.sort_by(|a, b| gain(b).total_cmp(&gain(a)));
    let [first, second, third, fourth] = ranked;
    let expected = format!("best: {first} 41, {second} 41\nworst: {fourth} 41, {third} 41\n");
    assert!(text.contains(&expected), "{expected}{text}");
    for name in ["good", "bad"] {
        let sheet = image::open(out.path().join(format!("quality/world-quality-{name}.png"))).unwrap();
        assert_eq!(sheet.height(), 32 + 4 * (135 + 8));
    }
    // Looks away: one for each scene, at the only window this world has of its own.
    assert_eq!(text.lines().filter(|line| line.contains("  g16 ")).count(), 4, "{text}");
}

#[test]
fn places_that_a_world_may_have_seen_are_refused() {
    let (status, text) = study(&["--seeds", "41,1000"]);
    assert!(status == 2 && text.contains("1000") && text.contains("held-out.txt"), "{status}: {text}");
}
