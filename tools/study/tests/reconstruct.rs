//! Generated frames between true anchors against the true frames: the written files, and that their numbers are right.

mod common;

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::world::ControlScript;
use cairn::{ErrorKind, Picture};
use common::clips::load;
use common::decoder::decode;
use common::small_disk::SmallDisk;
use media::{FileSystem, OutputFile, RealDisk};
use scenes::{Clip, ClipOptions, Family, Scene};
use study::metrics::{psnr, ssim};
use study::{
    Difference, Formats, Overrides, Progress, ReconstructManifest, ReconstructOutcome, ReconstructSettings,
    Reconstruction, Replay, TruthOrPicture, reconstruct, replay,
};

/// Four anchors, three frames between every two.
fn short() -> ReconstructSettings {
    ReconstructSettings {
        size: [96, 54],
        seconds: "0.2".into(),
        formats: Formats { mp4: true, png: true, y4m: true },
        ..ReconstructSettings::default()
    }
}

fn make(settings: &ReconstructSettings, out: &Path) -> ReconstructOutcome {
    make_on(Arc::new(RealDisk), &AtomicBool::new(false), settings, out).unwrap_or_else(|e| panic!("{e}"))
}

fn make_on(
    disk: Arc<dyn FileSystem>,
    stop: &AtomicBool,
    settings: &ReconstructSettings,
    out: &Path,
) -> cairn::Result<ReconstructOutcome> {
    let progress = Progress::quiet();
    reconstruct(&Reconstruction { settings, out, overwrite: false, disk, stop, progress: &progress, limit: None })
}

/// The manifest, with every file it lists held against its checksum.
fn read_checked(out: &Path) -> ReconstructManifest {
    let manifest = ReconstructManifest::read(&out.join("manifest.json")).unwrap_or_else(|e| panic!("{e}"));
    for output in &manifest.outputs {
        let bytes = std::fs::read(out.join(&output.path)).unwrap_or_else(|e| panic!("{}: {e}", output.path));
        assert_eq!(study::sha256(&bytes), output.sha256, "{}", output.path);
    }
    manifest
}

fn replay_of(manifest: &Path, out: &Path, overrides: Overrides) -> cairn::Result<study::ReplayReport> {
    let stop = AtomicBool::new(false);
    let progress = Progress::quiet();
    replay(&Replay { manifest, out: Some(out), overwrite: false, overrides, stop: &stop, progress: &progress })
}

/// The true frames of seed 1 of a family, from the scenes themselves.
fn truth(family: Family, script: &str, rate: u32, size: [u32; 2], count: usize) -> Vec<Picture> {
    let scene = Scene::new(family, 1);
    let script = ControlScript::parse(script).unwrap();
    let [width, height] = size;
    let aspect = width as f32 / height as f32;
    let mut clip =
        Clip::new(&scene, &script, ClipOptions { width, height, rate, aspect, ..ClipOptions::default() }).unwrap();
    (0..count).map(|_| clip.frame().unwrap().picture).collect()
}

/// The rows of scores.csv below its head, in cells.
fn rows(out: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(out.join("scores.csv")).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn frames_stand_where_they_should_and_the_scores_are_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let script = include_str!("../../../samples/scripts/forest.txt");
    for (multiplier, rate) in [(2, 30), (4, 60), (6, 90)] {
        let out = folder.path().join(rate.to_string());
        let settings = ReconstructSettings { multiplier, ..short() };
        let outcome = make(&settings, &out);
        assert!(outcome.failure.is_none() && !outcome.interrupted, "{:?}", outcome.failure);
        let manifest = read_checked(&out);
        assert_eq!(manifest, outcome.manifest);
        assert!(manifest.complete && manifest.stopped_by.is_none());
        let frames = 3 * u64::from(multiplier) + 1;
        let counts = manifest.counts;
        assert_eq!(
            (counts.anchors, counts.presented, counts.planned, counts.generated),
            (4, frames, frames, frames - 4)
        );

        let video = decode(&out.join("reconstruct.mp4"));
        assert_eq!((video.luma.len() as u64, video.frames_per_second), (frames, f64::from(rate)));
        assert_eq!((video.width, video.height), (96, 54));
        let wide = decode(&out.join("comparison.mp4"));
        assert_eq!((wide.luma.len() as u64, wide.width, wide.frames_per_second), (frames, 3 * 96 + 8, f64::from(rate)));

        let truth = truth(Family::Forest, script, rate, settings.size, frames as usize);
        let (made, rows) = (load(&out.join("frames")), rows(&out));
        assert_eq!((made.len(), rows.len()), (truth.len(), truth.len()));
        for (i, ((made, truth), row)) in made.iter().zip(&truth).zip(&rows).enumerate() {
            if i % multiplier as usize == 0 {
                assert!(made == truth && row[2] == "anchor", "frame {i} at {rate}: {row:?}");
                continue;
            }
            assert_eq!(row[3], format!("{}/{multiplier}", i % multiplier as usize));
            let told = [&row[4], &row[5]].map(|cell| cell.parse::<f64>().unwrap());
            let quality = [psnr(truth, made).unwrap(), ssim(truth, made).unwrap()];
            assert!((told[0] - quality[0]).abs() < 1e-3 && (told[1] - quality[1]).abs() < 1e-5, "frame {i}: {row:?}");
        }
        let scores = manifest.scores.unwrap();
        let all = rows.iter().filter(|row| row[2] != "anchor").map(|row| row[4].parse::<f64>().unwrap());
        let mean = all.sum::<f64>() / counts.generated as f64;
        assert!((scores.psnr_db - mean).abs() < 1e-3 && scores.worst_psnr_db <= scores.median_psnr_db, "{scores:?}");
    }
}

#[test]
fn both_sources_of_motion_beat_the_nearer_anchor() {
    let folder = tempfile::tempdir().unwrap();
    // One second, so that the walker is on the way.
    let formats = Formats { y4m: true, ..Formats::default() };
    let settings = ReconstructSettings { size: [192, 108], seconds: "1".into(), multiplier: 2, formats, ..short() };
    let score = |guidance, name: &str| {
        let settings = ReconstructSettings { guidance, ..settings.clone() };
        make(&settings, &folder.path().join(name)).manifest.scores.unwrap()
    };
    let picture = score(TruthOrPicture::Picture, "picture");
    let exact = score(TruthOrPicture::Truth, "truth");
    for scores in [picture, exact] {
        assert!(scores.psnr_db > scores.psnr_of_anchor_db + 2.0, "{scores:?}");
    }
    assert_eq!(exact.psnr_of_anchor_db, picture.psnr_of_anchor_db, "the truth is the same");
    assert!(exact.psnr_db != picture.psnr_db, "the motion is another");
}

#[test]
fn a_replay_makes_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("first");
    let outcome =
        make(&ReconstructSettings { scene: "sword".into(), guidance: TruthOrPicture::Truth, ..short() }, &out);
    let path = out.join("manifest.json");
    let again = replay_of(&path, &folder.path().join("again"), Overrides::default()).unwrap();
    assert_eq!(again.differences, []);
    assert_eq!((again.equal, again.skipped.len()), (outcome.manifest.outputs.len(), 0));

    let world = Overrides { world: Some("world.cairn".into()), ..Overrides::default() };
    let error = replay_of(&path, &folder.path().join("world"), world).unwrap_err();
    assert!(error.to_string().contains("--world"), "{error}");

    let write = |manifest: &ReconstructManifest| {
        std::fs::write(&path, serde_json::to_vec(manifest).unwrap()).unwrap();
    };
    let mut manifest = outcome.manifest.clone();
    let table = manifest.outputs.iter().position(|output| output.path == "scores.csv").unwrap();
    manifest.outputs[table].sha256 = "0".repeat(64);
    write(&manifest);
    let compared = replay_of(&path, &folder.path().join("changed"), Overrides::default()).unwrap();
    assert!(
        matches!(&compared.differences[..], [Difference::Output { path, .. }] if path == "scores.csv"),
        "{:?}",
        compared.differences
    );

    // The walk would differ, so nothing is made, and the reason is reported.
    manifest.script.sha256 = "0".repeat(64);
    write(&manifest);
    let elsewhere = folder.path().join("elsewhere");
    let compared = replay_of(&path, &elsewhere, Overrides::default()).unwrap();
    assert!(matches!(&compared.differences[..], [Difference::Input { name: "script", .. }]) && !elsewhere.exists());

    manifest.job = "sing".into();
    write(&manifest);
    let error = replay_of(&path, &elsewhere, Overrides::default()).unwrap_err();
    assert!(error.kind() == ErrorKind::Unsupported && error.to_string().contains("sing"), "{error}");
}

/// Raises a flag when a picture of a number is begun, as a person would at that moment.
struct StopAt(&'static AtomicBool);

impl FileSystem for StopAt {
    fn create(&self, path: &Path) -> io::Result<Box<dyn OutputFile>> {
        if path.ends_with("000004.png.part") {
            self.0.store(true, Ordering::SeqCst);
        }
        RealDisk.create(path)
    }
}

#[test]
fn what_is_finished_at_an_interruption_is_valid_and_can_be_replayed() {
    static STOP: AtomicBool = AtomicBool::new(false);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("first");
    let settings = ReconstructSettings { seconds: "20".into(), ..short() };
    let outcome = make_on(Arc::new(StopAt(&STOP)), &STOP, &settings, &out).unwrap();
    assert!(outcome.interrupted && outcome.failure.is_none(), "{:?}", outcome.failure);
    let manifest = read_checked(&out);
    assert!(!manifest.complete && manifest.stopped_by.as_deref() == Some("interrupted"));
    let presented = manifest.counts.presented;
    assert!((5..40).contains(&presented), "{presented} frames");
    assert_eq!(decode(&out.join("reconstruct.mp4")).luma.len() as u64, presented);
    assert_eq!(rows(&out).len() as u64, presented);
    let again = replay_of(&out.join("manifest.json"), &folder.path().join("again"), Overrides::default()).unwrap();
    assert_eq!((again.differences, again.equal), (Vec::new(), manifest.outputs.len()));
}

#[test]
fn a_full_disk_leaves_whole_files_and_a_manifest_that_says_so() {
    let folder = tempfile::tempdir().unwrap();
    for room in [500, 12_000, 120_000] {
        let out = folder.path().join(room.to_string());
        let settings = ReconstructSettings { seconds: "1".into(), ..short() };
        let error = match make_on(Arc::new(SmallDisk::new(room)), &AtomicBool::new(false), &settings, &out) {
            Ok(outcome) => outcome.failure.expect("the disk is too small"),
            Err(error) => error,
        };
        assert!(error.kind() == ErrorKind::Io && error.to_string().contains("Free some space"), "{error}");
        if out.join("manifest.json").exists() {
            let manifest = ReconstructManifest::read(&out.join("manifest.json")).unwrap();
            assert!(!manifest.complete && manifest.stopped_by.is_some());
        }
        for name in ["reconstruct.mp4", "comparison.mp4"].map(|name| out.join(name)) {
            assert!(!name.exists() || !decode(&name).luma.is_empty(), "{}", name.display());
        }
    }
}

#[test]
fn odd_and_small_sizes_go_through() {
    let folder = tempfile::tempdir().unwrap();
    for size in [[16, 16], [17, 33], [101, 57]] {
        let out = folder.path().join(size[0].to_string());
        let settings = ReconstructSettings { size, seconds: "0.07".into(), multiplier: 3, ..short() };
        let outcome = make(&settings, &out);
        assert!(outcome.failure.is_none() && outcome.manifest.complete, "{size:?}: {:?}", outcome.failure);
        let video = decode(&out.join("reconstruct.mp4"));
        assert_eq!((video.width, video.height, video.luma.len()), (size[0], size[1], 4));
        let shown = image::open(out.join("comparison.png")).unwrap();
        assert!(shown.width() >= 3 * size[0] && shown.height() > 2 * size[1]);
    }
}

#[test]
fn what_cannot_be_is_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (settings, words) in [
        (ReconstructSettings { scene: "moon".into(), ..short() }, "--scene"),
        (ReconstructSettings { size: [96, 0], ..short() }, "--size"),
        (ReconstructSettings { size: [9000, 54], ..short() }, "--size"),
        (ReconstructSettings { multiplier: 1, ..short() }, "--multiplier"),
        (ReconstructSettings { multiplier: 9, ..short() }, "--multiplier"),
        (ReconstructSettings { seconds: "nan".into(), ..short() }, "--seconds"),
        (ReconstructSettings { seconds: "0".into(), ..short() }, "--seconds"),
        (ReconstructSettings { formats: Formats::default(), ..short() }, "--formats"),
        (ReconstructSettings { size: [16, 16], lpips: true, ..short() }, "--lpips"),
    ] {
        let error = make_on(Arc::new(RealDisk), &AtomicBool::new(false), &settings, &out).unwrap_err();
        assert!(error.kind() == ErrorKind::InvalidArgument && error.to_string().contains(words), "{error}");
        assert!(!out.exists(), "{error}: nothing is made");
    }
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("mine.txt"), "precious").unwrap();
    let error = make_on(Arc::new(RealDisk), &AtomicBool::new(false), &short(), &out).unwrap_err();
    assert!(error.to_string().contains("--overwrite"), "{error}");
}
