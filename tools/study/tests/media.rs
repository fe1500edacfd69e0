//! Videos and pictures: sound for programs that know nothing of this one, and complete when the disk is not.

mod common;

use std::path::Path;
use std::sync::Arc;

use cairn::{ErrorKind, Picture};
use common::decoder::{decode, psnr};
use common::small_disk::SmallDisk;
use media::{
    FileSystem, FrameRate, Matrix, Mp4Sink, PngSink, RealDisk, Recorder, RecorderReport, Sink, VideoFormat, Y4mSink,
    Yuv420, write_whole,
};

const SIZE: (u32, u32) = (161, 91);

/// Ten frames a second.
fn format() -> VideoFormat {
    VideoFormat::new(SIZE, FrameRate::new(10, 1).unwrap())
}

/// A smooth picture that moves.
fn picture(number: u64) -> Picture {
    let mut picture = Picture::new(SIZE.0, SIZE.1).unwrap();
    for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
        let (x, y) = ((i as u32 % SIZE.0) as f32 + 4.0 * number as f32, (i as u32 / SIZE.0) as f32);
        let wave = |fx: f32, fy: f32| (127.0 + 80.0 * (x / fx).sin() * (y / fy).cos()) as u8;
        px[..3].copy_from_slice(&[wave(23.0, 17.0), wave(31.0, 12.0), wave(15.0, 40.0)]);
    }
    picture
}

fn record(sinks: Vec<Box<dyn Sink>>, frames: u64) -> RecorderReport {
    let recorder = Recorder::start(sinks, SIZE).unwrap();
    for number in 0..frames {
        if !recorder.push(picture(number)) {
            break;
        }
    }
    recorder.finish().unwrap()
}

fn mp4(disk: &dyn FileSystem, path: &Path) -> Box<dyn Sink> {
    Box::new(Mp4Sink::create(disk, path, &format(), 2).unwrap())
}

#[test]
fn the_video_is_what_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.mp4");
    let recorded = record(vec![mp4(&RealDisk, &path)], 23);
    assert!(recorded.failure.is_none(), "{:?}", recorded.failure);
    assert_eq!((recorded.frames, recorded.written[0].frames), (23, 23));
    let video = decode(&path);
    assert_eq!((video.width, video.height), SIZE);
    assert_eq!(video.frames_per_second, 10.0);
    assert_eq!(video.duration_seconds, 2.3);
    assert_eq!(video.luma.len(), 23);
    let keys: Vec<usize> = (0..23).filter(|&i| video.keys[i]).collect();
    assert_eq!(keys, [0, 10, 20], "one can seek to every second");
    let mut planes = Yuv420::new(SIZE.0, SIZE.1).unwrap();
    for (number, luma) in video.luma.iter().enumerate() {
        planes.convert(&picture(number as u64)).unwrap();
        let quality = psnr(luma, planes.plane(0));
        assert!(quality > 36.0, "frame {number}: {quality:.1} dB");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
}

#[test]
fn the_same_frames_make_the_same_files() {
    let make = || {
        let folder = tempfile::tempdir().unwrap();
        let [video, raw] = ["v.mp4", "v.y4m"].map(|name| folder.path().join(name));
        let y4m = Y4mSink::create(&RealDisk, &raw, &format()).unwrap();
        record(vec![mp4(&RealDisk, &video), Box::new(y4m)], 7);
        (std::fs::read(video).unwrap(), std::fs::read(raw).unwrap())
    };
    assert!(make() == make());
}

#[test]
fn y4m_holds_the_planes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.y4m");
    record(vec![Box::new(Y4mSink::create(&RealDisk, &path, &format()).unwrap())], 3);
    let bytes = std::fs::read(&path).unwrap();
    let end = bytes.iter().position(|&b| b == b'\n').unwrap();
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert_eq!(header, "YUV4MPEG2 W161 H91 F10:1 Ip A1:1 C420mpeg2 XCOLORRANGE=LIMITED");
    let frame = 6 + 161 * 91 + 2 * 81 * 46;
    assert_eq!(bytes.len(), end + 1 + 3 * frame);
    let mut planes = Yuv420::with_matrix(SIZE.0, SIZE.1, Matrix::Bt601).unwrap();
    planes.convert(&picture(2)).unwrap();
    let last = &bytes[bytes.len() - frame..];
    assert!(last.starts_with(b"FRAME\n") && last[6..].starts_with(planes.plane(0)) && last.ends_with(planes.plane(2)));
}

#[test]
fn png_holds_the_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let recorded = record(vec![Box::new(PngSink::new(Arc::new(RealDisk), folder.path()))], 2);
    assert_eq!(recorded.written.len(), 2);
    let back = image::open(folder.path().join("000001.png")).unwrap().to_rgba8();
    assert!(back.as_raw() == picture(1).rgba());
}

/// With any amount of free space, the files on disk can be played, and there are no others.
#[test]
fn a_full_disk_leaves_a_playable_video() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.mp4");
    record(vec![mp4(&RealDisk, &whole)], 23);
    let len = std::fs::metadata(&whole).unwrap().len() as i64;
    let mut seen = std::collections::BTreeSet::new();
    // From no room at all to one byte too few for the index.
    for room in (0..6).map(|i| len * i / 6).chain([len - 1]) {
        let path = folder.path().join(format!("{room}.mp4"));
        let recorded = record(vec![mp4(&SmallDisk::new(room), &path)], 23);
        let failure = recorded.failure.expect("the disk was too small");
        assert_eq!(failure.kind(), ErrorKind::Io);
        assert!(failure.to_string().contains("Free some space"), "{failure}");
        let frames = recorded.written.first().map_or(0, |w| w.frames);
        assert_eq!(path.exists(), frames > 0);
        if frames > 0 {
            assert_eq!(decode(&path).luma.len() as u64, frames, "with room for {room} of {len} bytes");
        }
        assert!(!path.with_extension("mp4.part").exists());
        seen.insert(frames);
    }
    assert!(seen.contains(&0) && seen.contains(&23) && seen.len() > 3, "{seen:?}");
}

#[test]
fn a_full_disk_leaves_whole_pictures_and_raw_frames() {
    let folder = tempfile::tempdir().unwrap();
    let raw = folder.path().join("v.y4m");
    let disk = SmallDisk::new(125_000);
    let y4m = Y4mSink::create(&disk, &raw, &format()).unwrap();
    let recorded = record(vec![Box::new(y4m), Box::new(PngSink::new(Arc::new(disk), folder.path()))], 20);
    assert!(recorded.failure.is_some() && recorded.frames < 20);
    let frame = 6 + 161 * 91 + 2 * 81 * 46;
    let bytes = std::fs::read(&raw).unwrap();
    let header = bytes.iter().position(|&b| b == b'\n').unwrap() + 1;
    assert_eq!((bytes.len() - header) % frame, 0);
    let mut pictures = 0;
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "png") {
            image::open(&path).expect("a picture that is there is whole");
            pictures += 1;
        }
        assert!(path.extension().is_none_or(|e| e != "part"), "{path:?}");
    }
    assert_eq!(pictures, recorded.written.iter().filter(|w| w.kind == "png").count());
}

#[test]
fn a_small_file_that_does_not_reach_the_medium_leaves_the_older_one_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.png");
    let disk = SmallDisk::failing_once_at_sync();
    write_whole(&RealDisk, &path, b"older").unwrap();
    let error = write_whole(&disk, &path, b"newer").unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Io);
    assert!(error.to_string().contains("Free some space"), "{error}");
    let names = |folder: &Path| -> Vec<_> {
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect()
    };
    assert_eq!(names(folder.path()), ["p.png"]);
    assert_eq!(std::fs::read(&path).unwrap(), b"older");
    write_whole(&disk, &path, b"newer").unwrap();
    assert_eq!(names(folder.path()), ["p.png"]);
    assert_eq!(std::fs::read(&path).unwrap(), b"newer");
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    let error = Mp4Sink::create(&RealDisk, Path::new("/nowhere/at/all.mp4"), &format(), 1).err().unwrap();
    assert!(error.to_string().contains("/nowhere/at/all.mp4"), "{error}");
}
