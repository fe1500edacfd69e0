//! The main job from end to end, on a small world with random weights.

mod common;

use std::collections::BTreeSet;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::ErrorKind;
use common::decoder::decode;
use common::small_disk::SmallDisk;
use common::worlds::{make, make_on, read_checked, short};
use media::{FileSystem, OutputFile, RealDisk};
use study::{DeviceChoice, Difference, Formats, Manifest, Overrides, Progress, Replay, Settings, replay};

fn replay_of(manifest: &Path, out: &Path, overrides: Overrides) -> cairn::Result<study::ReplayReport> {
    replay(&Replay {
        manifest,
        out: Some(out),
        overwrite: false,
        overrides,
        stop: &AtomicBool::new(false),
        progress: &Progress::quiet(),
    })
}

#[test]
fn a_rollout_is_complete_and_its_replay_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("first");
    let outcome = make(&Settings { device: DeviceChoice::Auto, ..short() }, &out);
    assert!(outcome.failure.is_none() && !outcome.interrupted, "{:?}", outcome.failure);
    let manifest = read_checked(&out);
    assert_eq!(manifest, outcome.manifest);
    // Where the world runs depends on the machine.
    if manifest.settings.device == DeviceChoice::Cpu {
        let why = outcome.fallback.expect("the processor needs a reason");
        assert!(why.cause().contains("not webgpu: ") && why.cause().contains("not d3d12: ") == cfg!(windows), "{why}");
    }
    assert!(manifest.complete && manifest.stopped_by.is_none());
    assert!(manifest.note.as_deref().is_some_and(|n| n.contains("random weights")));

    // 0.4 s at 15 latents a second: the seed's own and six, with a frame between every two.
    let counts = manifest.counts;
    assert_eq!((counts.latents, counts.anchors), (7, 7));
    assert_eq!((counts.presented, counts.planned, counts.generated), (13, 13, 6));
    assert_eq!(counts.passes, 1 + 6 * 5);
    let video = decode(&out.join("rollout.mp4"));
    assert_eq!((video.luma.len(), video.width, video.height, video.frames_per_second), (13, 161, 91, 30.0));
    assert!(video.luma.windows(2).all(|w| w[0] != w[1]), "every frame is new");
    assert_eq!(std::fs::read_dir(out.join("frames")).unwrap().count(), 13);
    let sheet = image::open(out.join("contact-sheet.png")).unwrap().to_rgb8();
    assert!(
        sheet.width() > 900 && sheet.pixels().map(|px| px.0).collect::<BTreeSet<_>>().len() > 1000,
        "the sheet shows something"
    );
    let kinds: BTreeSet<&str> = manifest.outputs.iter().map(|o| o.kind.as_str()).collect();
    assert_eq!(kinds, BTreeSet::from(["contact-sheet", "latents", "mp4", "png", "y4m"]));

    let again = replay_of(&out.join("manifest.json"), &folder.path().join("again"), Overrides::default()).unwrap();
    assert_eq!(again.differences, []);
    assert_eq!((again.equal, again.skipped.len()), (manifest.outputs.len(), 0));
}

#[test]
fn every_preset_makes_exactly_its_frames() {
    // At 0.2 s; decoded pictures before time zero are dropped.
    for (preset, latents, pictures, presented, generated, rate) in [
        ("coherence", 4, 4, 7, 3, 30.0),
        ("baseline-128", 4, 8, 7, 0, 30.0),
        ("baseline-112", 4, 8, 7, 0, 30.0),
        ("baseline-doubled", 7, 7, 7, 0, 30.0),
        ("decoded-60", 4, 16, 13, 0, 60.0),
        ("heavy", 4, 4, 7, 3, 30.0),
        ("stock", 4, 16, 13, 0, 60.0),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join(preset);
        let settings = Settings {
            operating_point: format!("{preset},g64,refined:4"),
            seconds: "0.2".into(),
            size: [64, 36],
            formats: Formats { mp4: true, ..Formats::default() },
            ..short()
        };
        let outcome = make(&settings, &out);
        let counts = outcome.manifest.counts;
        assert_eq!((counts.latents, counts.anchors), (latents, pictures), "{preset}");
        assert_eq!((counts.presented, counts.generated), (presented, generated), "{preset}");
        let video = decode(&out.join("rollout.mp4"));
        assert_eq!((video.luma.len() as u64, video.frames_per_second), (presented, rate), "{preset}");
        assert!(outcome.manifest.complete, "{preset}: {:?}", outcome.failure);
    }
}

#[test]
fn stored_latents_are_shown_again_at_another_rate() {
    let folder = tempfile::tempdir().unwrap();
    let formats = Formats { png: true, ..Formats::default() };
    let first = folder.path().join("first");
    make(&Settings { formats, ..short() }, &first);
    let decoded = |name: &str, latents| {
        let out = folder.path().join(name);
        let operating_point = "decoded-60,g64,refined:4".into();
        // Neither noise nor controls matter any more.
        let script = folder.path().join("script.txt");
        std::fs::write(&script, "cairn-controls 1\n0..1 hold S\n").unwrap();
        (make(&Settings { formats, latents, operating_point, seed: 9, script: Some(script), ..short() }, &out), out)
    };
    let stored = first.join("latents.safetensors");
    let (outcome, out) = decoded("decoded", Some(stored.clone()));
    let manifest = read_checked(&out);
    assert!(manifest.complete && outcome.failure.is_none());
    assert_eq!(std::fs::read(out.join("latents.safetensors")).unwrap(), std::fs::read(&stored).unwrap());
    // Its latents cost a cache pass each, and no denoising.
    assert_eq!((manifest.counts.latents, manifest.counts.passes), (7, 7));
    let frame = |out: &Path, number: u32| std::fs::read(out.join(format!("frames/{number:06}.png"))).unwrap();
    for anchor in 0..7 {
        assert_eq!(frame(&first, 2 * anchor), frame(&out, 4 * anchor), "anchor {anchor}");
    }
    let again = replay_of(&out.join("manifest.json"), &folder.path().join("again"), Overrides::default()).unwrap();
    assert_eq!(again.differences, []);

    let (_, other) = decoded("other", None);
    assert_ne!(frame(&other, 4), frame(&out, 4), "without them the walk is another");
    let short_of = Settings { latents: Some(stored), seconds: "2".into(), ..short() };
    let error = make_on(Arc::new(RealDisk), &AtomicBool::new(false), &short_of, &folder.path().join("no")).unwrap_err();
    assert!(error.to_string().contains("7 latents are stored, 31 are needed"), "{error}");
}

#[test]
fn a_replay_says_what_differs() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("first");
    let script = folder.path().join("script.txt");
    std::fs::write(&script, "cairn-controls 1\n0..1 hold W\n").unwrap();
    let formats = Formats { png: true, ..Formats::default() };
    let settings = Settings { script: Some(script.clone()), seconds: "0.1".into(), formats, ..short() };
    make(&settings, &out);
    let path = out.join("manifest.json");
    let mut manifest = read_checked(&out);

    // Another output and another version than the manifest tells.
    manifest.versions.cpu_features = vec!["vacuum-tubes".into()];
    let frame = manifest.outputs.iter().position(|o| o.path == "frames/000001.png").unwrap();
    manifest.outputs[frame].sha256 = "0".repeat(64);
    std::fs::write(&path, serde_json::to_vec(&manifest).unwrap()).unwrap();
    let compared = replay_of(&path, &folder.path().join("second"), Overrides::default()).unwrap();
    let failures: Vec<_> = compared.differences.iter().filter(|d| d.is_failure()).collect();
    assert!(
        matches!(failures[..], [Difference::Output { path, .. }] if path == "frames/000001.png"),
        "{:?}",
        compared.differences
    );
    let told: Vec<String> = compared.differences.iter().map(ToString::to_string).collect();
    assert!(told.iter().any(|d| d.contains("vacuum-tubes")), "{told:?}");

    // Another script, at the same place and at another.
    let other = folder.path().join("other.txt");
    std::fs::write(&other, "cairn-controls 1\n0..1 hold S\n").unwrap();
    let overrides = Overrides { script: Some(other.clone()), ..Overrides::default() };
    let compared = replay_of(&path, &folder.path().join("third"), overrides).unwrap();
    assert!(
        matches!(&compared.differences[..], [Difference::Input { name: "script", how }] if how.contains("other.txt"))
    );
    assert!(!folder.path().join("third").exists(), "another rollout is not made");
    std::fs::remove_file(&script).unwrap();
    let error = replay_of(&path, &folder.path().join("fourth"), Overrides::default()).unwrap_err();
    assert!(error.kind() == ErrorKind::Io && error.to_string().contains("script.txt"), "{error}");
    let error = replay_of(&path, &out, Overrides::default()).unwrap_err();
    assert!(error.to_string().contains("--out"), "{error}");
}

/// Raises a flag when a file of a name is made, as a person would at that moment.
struct StopAt<'a> {
    name: &'static str,
    stop: &'a AtomicBool,
}

impl FileSystem for StopAt<'static> {
    fn create(&self, path: &Path) -> io::Result<Box<dyn OutputFile>> {
        if path.file_name().is_some_and(|name| name == self.name) {
            self.stop.store(true, Ordering::SeqCst);
        }
        RealDisk.create(path)
    }
}

#[test]
fn an_interrupted_rollout_is_valid_and_can_be_replayed() {
    static STOP: AtomicBool = AtomicBool::new(false);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("first");
    let settings = Settings { seconds: "600".into(), ..short() };
    let disk = Arc::new(StopAt { name: "000004.png.part", stop: &STOP });
    let outcome = make_on(disk, &STOP, &settings, &out).unwrap();
    assert!(outcome.interrupted && outcome.failure.is_none());
    let manifest = read_checked(&out);
    assert!(!manifest.complete && manifest.stopped_by.as_deref() == Some("interrupted"));
    let presented = manifest.counts.presented;
    assert!((5..20).contains(&presented), "{presented} frames");
    assert_eq!(decode(&out.join("rollout.mp4")).luma.len() as u64, presented);
    let leftovers =
        std::fs::read_dir(&out).unwrap().flatten().filter(|e| e.path().extension().is_some_and(|e| e == "part"));
    assert_eq!(leftovers.count(), 0);
    let again = replay_of(&out.join("manifest.json"), &folder.path().join("again"), Overrides::default()).unwrap();
    assert_eq!(again.differences, []);
    assert_eq!(again.equal, manifest.outputs.len());
}

#[test]
fn a_full_disk_leaves_whole_files_and_a_valid_manifest() {
    let folder = tempfile::tempdir().unwrap();
    for room in [2_000, 60_000, 250_000] {
        let out = folder.path().join(room.to_string());
        let settings = Settings { seconds: "2".into(), ..short() };
        let error = match make_on(Arc::new(SmallDisk::new(room)), &AtomicBool::new(false), &settings, &out) {
            Ok(outcome) => outcome.failure.expect("the disk is too small"),
            Err(error) => error,
        };
        assert!(error.kind() == ErrorKind::Io && error.to_string().contains("Free some space"), "{error}");
        if !out.join("manifest.json").exists() {
            assert!(room < 10_000, "there was room for the first manifest");
            continue;
        }
        let manifest = Manifest::read(&out.join("manifest.json")).unwrap();
        assert!(!manifest.complete && manifest.stopped_by.is_some());
        if out.join("rollout.mp4").exists() {
            assert!(!decode(&out.join("rollout.mp4")).luma.is_empty());
        }
        for entry in std::fs::read_dir(out.join("frames")).unwrap() {
            image::open(entry.unwrap().path()).expect("a picture that is there is whole");
        }
    }
}

#[test]
fn what_cannot_be_is_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        Some(path)
    };
    let nowhere = Some(folder.path().join("nowhere"));
    let base = short;
    let cases = [
        (Settings { size: [0, 91], ..base() }, ErrorKind::InvalidArgument, "--size"),
        (Settings { size: [65_536, 91], ..base() }, ErrorKind::InvalidArgument, "16384"),
        (
            Settings { seed_picture: write("no.png", b"no picture"), ..base() },
            ErrorKind::InvalidArgument,
            "PNG or JPEG",
        ),
        (Settings { seed_picture: nowhere.clone(), ..base() }, ErrorKind::Io, "nowhere"),
        (Settings { script: write("new.txt", b"cairn-controls 2\n"), ..base() }, ErrorKind::Unsupported, "version 2"),
        (
            Settings { script: write("bad.txt", b"cairn-controls 1\n0 jump\n"), ..base() },
            ErrorKind::InvalidArgument,
            "line 2",
        ),
        (Settings { script: nowhere.clone(), ..base() }, ErrorKind::Io, "nowhere"),
        (Settings { world: nowhere.clone(), ..base() }, ErrorKind::Io, "nowhere"),
        (Settings { operating_point: "coherence,g63".into(), ..base() }, ErrorKind::InvalidArgument, "g63"),
        (Settings { operating_point: "coherence,g999996".into(), ..base() }, ErrorKind::InvalidArgument, "up to 64"),
    ];
    for (settings, kind, words) in cases {
        let out = folder.path().join("out");
        let error = make_on(Arc::new(RealDisk), &AtomicBool::new(false), &settings, &out).unwrap_err();
        assert_eq!(error.kind(), kind, "{error}");
        assert!(error.to_string().contains(words), "{error}");
        assert!(!out.exists(), "{error}: nothing is made");
    }
    let taken = folder.path().join("taken");
    std::fs::create_dir(&taken).unwrap();
    std::fs::write(taken.join("mine.txt"), "precious").unwrap();
    let error = make_on(Arc::new(RealDisk), &AtomicBool::new(false), &base(), &taken).unwrap_err();
    assert!(error.to_string().contains("--overwrite"), "{error}");
}
