//! The small world of the tests, and short rollouts of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use media::{FileSystem, RealDisk};
use study::{Formats, Job, JobOutcome, Manifest, Progress, Settings, run_job};

/// The random world `tiny`, an absolute path.
pub fn tiny() -> PathBuf {
    test_world("tiny")
}

/// One of the tests' worlds, an absolute path: in the folder that `CAIRN_TEST_BUNDLE` names, else the one `cargo xtask setup` keeps.
pub fn test_world(name: &str) -> PathBuf {
    match std::env::var_os("CAIRN_TEST_BUNDLE").filter(|folder| !folder.is_empty()) {
        // With its drive on Windows, as plans that name it lie on another.
        Some(folder) => std::path::absolute(PathBuf::from(folder).join(name)).expect("a path"),
        None => provision::bundle(name, &provision::Console::new()).unwrap_or_else(|e| panic!("{e}")),
    }
}

/// A short `coherence` at a small size, with the largest window the world has.
pub fn short() -> Settings {
    Settings {
        world: Some(tiny()),
        operating_point: "coherence,g64,refined:4".into(),
        seconds: "0.4".into(),
        size: [161, 91],
        formats: Formats { mp4: true, png: true, y4m: true },
        threads: Some(1),
        ..Settings::default()
    }
}

/// Makes a rollout on the computer's own disk.
pub fn make(settings: &Settings, out: &Path) -> JobOutcome {
    make_on(Arc::new(RealDisk), &AtomicBool::new(false), settings, out).unwrap_or_else(|e| panic!("{e}"))
}

pub fn make_on(
    disk: Arc<dyn FileSystem>,
    stop: &AtomicBool,
    settings: &Settings,
    out: &Path,
) -> cairn::Result<JobOutcome> {
    run_job(&Job { settings, out, overwrite: false, disk, stop, progress: &Progress::quiet(), limit: None })
}

/// The manifest of a rollout, with every file it lists held against its checksum.
pub fn read_checked(out: &Path) -> Manifest {
    let manifest = Manifest::read(&out.join("manifest.json")).unwrap_or_else(|e| panic!("{e}"));
    for output in &manifest.outputs {
        let bytes = std::fs::read(out.join(&output.path)).unwrap_or_else(|e| panic!("{}: {e}", output.path));
        assert_eq!(bytes.len() as u64, output.size, "{}", output.path);
        assert_eq!(study::sha256(&bytes), output.sha256, "{}", output.path);
    }
    manifest
}
