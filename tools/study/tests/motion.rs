//! Every source of motion against the truth, through the program.

mod common;

use std::process::{Command, Output};

use cairn::world::ControlScript;
use common::worlds::tiny;
use scenes::{Clip, ClipOptions, Family, Scene};
use study::metrics::psnr;

fn study(arguments: &[&str]) -> (i32, String) {
    let Output { status, stdout, stderr } =
        Command::new(env!("CARGO_BIN_EXE_study")).arg("motion").args(arguments).output().expect("the program starts");
    let text = String::from_utf8_lossy(&stderr).into_owned() + &String::from_utf8_lossy(&stdout);
    (status.code().expect("it ends by itself"), text)
}

/// PSNR, against the frame between them, of the mean of the anchors 13 and 14 of the snow's walk, drawn anew.
fn blended(size: (u32, u32)) -> f64 {
    let script = ControlScript::parse(include_str!("../../../samples/scripts/snow.txt")).unwrap();
    let scene = Scene::new(Family::Snow, 41);
    let options = ClipOptions { width: size.0, height: size.1, rate: 30, ..ClipOptions::default() };
    let mut clip = Clip::new(&scene, &script, options).unwrap();
    let pictures: Vec<_> = (0..=28).map(|_| clip.frame().unwrap().picture).collect();
    let mut mean = pictures[26].clone();
    for (to, other) in mean.rgba_mut().iter_mut().zip(pictures[28].rgba()) {
        *to = (u16::from(*to) + u16::from(*other)).div_ceil(2) as u8;
    }
    psnr(&pictures[27], &mean).unwrap()
}

#[test]
fn a_quick_look_has_every_source_and_motion_makes_nearer_frames() {
    let out = tempfile::tempdir().unwrap();
    let (world, folder) = (tiny(), out.path().join("motion"));
    let (world, folder) = (world.to_str().unwrap(), folder.to_str().unwrap());
    // Without --check: what this world's random autoencoder makes of the anchors says nothing about sources of motion.
    let (status, text) = study(&["--quick", "--no-lpips", "--quiet", "--world", world, "--out", folder]);
    assert_eq!(status, 0, "{text}");
    assert!(text.contains("`picture` gives the most accurate frames, and `best` selects it"), "{text}");

    let csv = std::fs::read_to_string(out.path().join("motion/motion.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().skip(1).map(|line| line.split(',').collect()).collect();
    // Four scenes, two frames, two kinds of anchors, and twelve pairs of motion and depth.
    assert_eq!(rows.len(), 4 * 2 * 2 * 12, "{csv}");
    let mean = |motion: &str, depth: &str, column: usize| {
        let all = rows.iter().filter(|row| row[2] == "drawn" && row[4] == motion && row[5] == depth);
        let all: Vec<f64> = all.map(|row| row[column].parse().unwrap()).collect();
        assert_eq!(all.len(), 8, "{motion} {depth}");
        all.iter().sum::<f64>() / 8.0
    };
    let (off, near, quality) = (6, 7, 8);
    // The truth is off by the rounding of half floats alone.
    assert!(mean("truth", "truth", off) < 0.01 && mean("truth", "truth", near) == 1.0);
    assert!(mean("picture-flow", "flat", off) < 0.5 * mean("none", "flat", off));
    assert!(mean("controls", "level ground", off) < mean("none", "flat", off));
    let quality_of = |motion, depth| mean(motion, depth, quality);
    let (none, found, truth) =
        (quality_of("none", "flat"), quality_of("picture-flow", "flat"), quality_of("truth", "truth"));
    assert!(truth > none && found > none, "{none} {found} {truth}");
    // In pictures this small, found motion makes frames as near as the true one does.
    assert!(truth > found - 0.1, "{found} {truth}");
    // Motion that is fitted to the truth is no farther off than none.
    assert!(mean("paper-calibrated", "paper", off) < mean("paper", "paper", off) + 0.01);
    // No motion is the mean of the anchors, which are the renderer's.
    let none = rows.iter().find(|r| r[0] == "snow" && r[2] == "drawn" && r[3] == "14" && r[4] == "none").unwrap();
    let (made, expected) = (none[quality].parse::<f64>().unwrap(), blended((128, 72)));
    assert!((made - expected).abs() < 0.05, "{made} {expected}");

    let page = std::fs::read_to_string(out.path().join("motion/motion.md")).unwrap();
    for name in ["`none`", "`paper`", "`paper-calibrated`", "`latent-flow`", "`controls`", "`picture-flow`", "`truth`"]
    {
        assert!(page.contains(&format!("- {name}: ")), "{name}");
    }
    assert!(page.contains("(motion.png)"), "{page}");
    let figure = image::open(out.path().join("motion/motion.png")).unwrap();
    assert_eq!(figure.height(), 32 + 7 * (135 + 8));
}

#[test]
fn places_that_a_world_may_have_seen_are_refused() {
    let (status, text) = study(&["--seeds", "41,1000"]);
    assert!(status == 2 && text.contains("1000") && text.contains("held-out.txt"), "{status}: {text}");
}
