//! The program as a person starts it: exit status and words.

use std::process::{Command, Output};

fn study(arguments: &[&str]) -> (i32, String) {
    let Output { status, stdout, stderr } =
        Command::new(env!("CARGO_BIN_EXE_study")).args(arguments).output().expect("the program starts");
    let text = String::from_utf8_lossy(&stdout).into_owned() + &String::from_utf8_lossy(&stderr);
    (status.code().expect("it ends by itself"), text)
}

#[test]
fn help_teaches_by_examples() {
    for arguments in [&["--help"][..], &["rollout", "--help"]] {
        let (status, text) = study(arguments);
        assert_eq!(status, 0);
        assert!(text.contains("Examples:") && text.contains("--preset coherence") && text.contains("Exit status"));
    }
}

#[test]
fn wrong_usage_ends_with_status_2_and_a_remedy() {
    for (arguments, words) in [
        (&["rollout", "--preset", "best"][..], "baseline-128"),
        (&["rollout", "--size", "0x1080"], "--size"),
        (&["rollout", "--size", "1920x65536"], "16384"),
        (&["rollout", "--formats", "avi"], "mp4"),
        (&["rollout", "--seconds", "nan"], "--seconds"),
        (&["rollout", "--steps", "3"], "refined"),
        (&["rollout", "--no-such-option"], "--no-such-option"),
        (&["dance"], "dance"),
        (&[], "Usage"),
    ] {
        let (status, text) = study(arguments);
        assert_eq!(status, 2, "{arguments:?}: {text}");
        assert!(text.contains(words), "{arguments:?}: {text}");
    }
}

#[test]
fn a_dry_run_checks_values_and_makes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let with = |more: &[&'static str]| {
        let common = ["--dry-run", "rollout", "--script", "/nowhere/script.txt", "--out", out.to_str().unwrap()];
        study(&common.iter().copied().chain(more.iter().copied()).collect::<Vec<_>>())
    };
    assert_eq!(with(&["--present", "generated:60", "--guidance", "picture"]), (0, String::new()));
    for (value, words) in [(["--guidance", "guess"], "--guidance"), (["--size", "0x9"], "--size")] {
        let (status, text) = with(&value);
        assert!(status == 2 && text.contains(words), "{value:?}: {text}");
    }
    assert!(!out.exists());
}

#[test]
fn a_file_that_is_not_there_ends_with_status_1() {
    for (arguments, words) in [
        (&["replay", "/nowhere/manifest.json"][..], "/nowhere/manifest.json"),
        (&["rollout", "--script", "/nowhere/script.txt", "--out", "/nowhere/out"], "/nowhere/script.txt"),
        (&["seed-picture", "--out", "/nowhere/seed.png"], "/nowhere/seed.png"),
    ] {
        let (status, text) = study(arguments);
        assert_eq!(status, 1, "{arguments:?}: {text}");
        assert!(text.contains(words) && text.contains("Check the path"), "{arguments:?}: {text}");
    }
}

#[test]
fn the_seed_picture_can_be_had() {
    let folder = tempfile::tempdir().unwrap();
    let make = |name: &str, more: &[&str]| {
        let path = folder.path().join(name);
        let (status, text) =
            study(&[&["seed-picture", "--size", "160x90", "--out", path.to_str().unwrap()], more].concat());
        assert_eq!(status, 0, "{text}");
        path
    };
    let picture = |path| image::open(path).unwrap().into_rgb8();
    let usual = picture(make("seed.png", &[]));
    assert_eq!(usual.dimensions(), (160, 90));
    let snow = picture(make("snow.png", &["--scene", "snow"]));
    assert_ne!(snow, usual);
    assert_ne!(picture(make("place.png", &["--scene", "snow", "--place", "42"])), snow, "another place than the level");
    let plain = std::fs::read(make("seed.ppm", &[])).unwrap();
    assert_eq!(plain, [&b"P6\n160 90\n255\n"[..], usual.as_raw()].concat(), "the same for those who cannot read PNG");
}
