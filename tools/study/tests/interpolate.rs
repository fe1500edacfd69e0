//! Frame interpolation of existing videos: outputs, and errors for bad input.

mod common;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::{ErrorKind, Picture};
use common::clips::{load, picture, store, walk, y4m};
use common::decoder::{decode, psnr as luma_psnr};
use common::small_disk::SmallDisk;
use media::{FileSystem, FrameRate, OutputFile, RealDisk, Yuv420};
use study::metrics::psnr;
use study::{GeneratorChoice, Interpolation, Progress, Report, interpolate};

const SIZE: (u32, u32) = (128, 72);

struct Request<'a> {
    multiplier: u32,
    rate: Option<u64>,
    overwrite: bool,
    disk: Arc<dyn FileSystem>,
    stop: &'a AtomicBool,
}

static NEVER: AtomicBool = AtomicBool::new(false);

impl Default for Request<'_> {
    fn default() -> Self {
        Self { multiplier: 2, rate: None, overwrite: false, disk: Arc::new(RealDisk), stop: &NEVER }
    }
}

fn make(input: &Path, out: Option<&Path>, asked: Request<'_>) -> cairn::Result<Report> {
    interpolate(&Interpolation {
        input,
        multiplier: asked.multiplier,
        rate: asked.rate.map(|rate| FrameRate::new(rate, 1).unwrap()),
        generator: GeneratorChoice::Cpu,
        out,
        overwrite: asked.overwrite,
        disk: asked.disk,
        stop: asked.stop,
        progress: &Progress::quiet(),
    })
}

/// Pictures through a folder of PNG files and back: nothing but the interpolation changes a bit.
fn through(pictures: &[Picture], multiplier: u32) -> (Vec<Picture>, Report) {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (folder.path().join("in"), folder.path().join("out"));
    store(&input, pictures);
    let report = make(&input, Some(&out), Request { multiplier, ..Request::default() }).unwrap();
    assert!(report.failure.is_none(), "{:?}", report.failure);
    let made = load(&out);
    assert_eq!(made.len() as u64, report.frames_out);
    assert_eq!(made.len(), pictures.len() * multiplier as usize, "the length stays");
    for (i, frame) in pictures.iter().enumerate() {
        assert!(made[i * multiplier as usize] == *frame, "frame {i} stands where it stood");
    }
    (made, report)
}

#[test]
fn the_rate_is_multiplied_exactly_and_the_length_stays() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("walk.y4m");
    let frames = walk(SIZE, 7);
    std::fs::write(&input, y4m(&frames, "30000:1001")).unwrap();
    let report = make(&input, None, Request { multiplier: 3, ..Request::default() }).unwrap();
    assert!(report.failure.is_none() && !report.interrupted);
    assert_eq!((report.frames_in, report.frames_out, report.generated), (7, 21, 12));
    assert_eq!((report.cuts, report.repeats), (0, 0));
    assert_eq!(report.new_rate.to_string(), "90000/1001");
    assert_eq!(report.out, folder.path().canonicalize().unwrap().join("walk-3x.mp4"));
    let video = decode(&report.out);
    assert_eq!((video.width, video.height, video.luma.len()), (SIZE.0, SIZE.1, 21));
    assert!((video.frames_per_second - 90_000.0 / 1001.0).abs() < 1e-9);
    assert!((video.duration_seconds - 21.0 * 1001.0 / 90_000.0).abs() < 1e-9);
    let mut planes = Yuv420::new(SIZE.0, SIZE.1).unwrap();
    for (i, frame) in frames.iter().enumerate() {
        planes.convert(frame).unwrap();
        let quality = luma_psnr(&video.luma[3 * i], planes.plane(0));
        assert!(quality > 30.0, "frame {i}: {quality:.1} dB");
    }
    assert!(report.stages.iter().all(|(_, time)| time.as_nanos() > 0), "{:?}", report.stages);
}

#[test]
fn what_is_generated_lies_between() {
    let (made, report) = through(&walk(SIZE, 3), 3);
    assert_eq!(report.generated, 4);
    // Three pixels a frame, three frames of one: the truth between is the same texture one pixel on.
    let size = (3 * SIZE.0, SIZE.1);
    let wide = picture(size, 1, 0);
    for number in [1, 2, 4, 5] {
        let inner = |x: u32| 12 <= x && x + 24 < SIZE.0;
        let mut error = 0.0;
        let mut count = 0.0;
        for (i, px) in made[number].pixels().iter().enumerate() {
            let (x, y) = (i as u32 % SIZE.0, i as u32 / SIZE.0);
            if inner(x) {
                let truth = wide.pixels()[(y * size.0 + x + number as u32) as usize];
                error += (0..3).map(|c| (f64::from(px[c]) - f64::from(truth[c])).powi(2)).sum::<f64>();
                count += 3.0;
            }
        }
        let quality = 10.0 * (255.0 * 255.0 * count / error.max(1e-9)).log10();
        assert!(quality > 30.0, "frame {number}: {quality:.1} dB");
    }
}

#[test]
fn nothing_is_smeared_over_a_cut() {
    let clip: Vec<Picture> = [(1, 0), (1, 1), (9, 0), (9, 1), (5, 7)].map(|(p, n)| picture(SIZE, p, n)).into();
    let (made, report) = through(&clip, 4);
    assert_eq!((report.cuts, report.repeats), (2, 0));
    assert_eq!(report.generated, 2 * 3);
    for (before, after) in [(1, 2), (3, 4)] {
        for part in 1..4 {
            let nearer = if part < 2 { before } else { after };
            assert!(made[4 * before + part] == clip[nearer], "{part} quarters after frame {before}");
        }
    }
}

#[test]
fn repeated_frames_stay_as_they_are() {
    let still = picture(SIZE, 1, 0);
    let clip = [still.clone(), still.clone(), still.clone(), picture(SIZE, 1, 1)];
    let (made, report) = through(&clip, 2);
    assert_eq!((report.repeats, report.generated, report.cuts), (2, 1, 0));
    assert!(made[..5].iter().all(|frame| *frame == still));
}

/// Where a picture only becomes brighter or darker, nothing may come out that is brighter or darker than both.
fn lies_within(made: &Picture, a: &Picture, b: &Picture, slack: u8) -> f64 {
    let inside = made.pixels().iter().zip(a.pixels()).zip(b.pixels()).filter(|((m, a), b)| {
        (0..3).all(|c| m[c] >= a[c].min(b[c]).saturating_sub(slack) && m[c] <= a[c].max(b[c]).saturating_add(slack))
    });
    inside.count() as f64 / made.pixels().len() as f64
}

#[test]
fn a_fade_and_a_flash_stay_between_their_neighbours() {
    let scene = picture(SIZE, 1, 0);
    let lit = |share: f32, add: f32| {
        let mut out = scene.clone();
        for px in out.pixels_mut() {
            px[..3].iter_mut().for_each(|c| *c = (f32::from(*c) * share + add).clamp(0.0, 255.0) as u8);
        }
        out
    };
    for (name, clip) in [
        ("fade to black", [1.0, 0.75, 0.5, 0.25, 0.0].map(|share| lit(share, 0.0)).to_vec()),
        ("fade from white", [0.0, 0.5, 1.0].map(|share| lit(share, 255.0 * (1.0 - share))).to_vec()),
        ("flash", vec![scene.clone(), lit(0.2, 200.0), scene.clone()]),
        ("white frame", vec![scene.clone(), lit(0.0, 255.0), scene.clone()]),
    ] {
        let (made, report) = through(&clip, 2);
        for (i, pair) in clip.windows(2).enumerate() {
            let share = lies_within(&made[2 * i + 1], &pair[0], &pair[1], 8);
            assert!(share > 0.98, "{name}: {share:.3} of frame {i}, {} cuts", report.cuts);
        }
    }
}

#[test]
fn odd_and_tiny_sizes_go_through() {
    for size in [(1, 1), (2, 1), (1, 9), (7, 5), (33, 17)] {
        let clip: Vec<Picture> = (0..3).map(|n| picture(size, 1, n)).collect();
        through(&clip, 2);
        let folder = tempfile::tempdir().unwrap();
        let (input, out) = (folder.path().join("in.y4m"), folder.path().join("out.y4m"));
        std::fs::write(&input, y4m(&clip, "15:1")).unwrap();
        let report = make(&input, Some(&out), Request::default()).unwrap();
        assert!(report.failure.is_none() && report.frames_out == 6, "{size:?}: {:?}", report.failure);
        // What it wrote it can read.
        assert_eq!(make(&out, Some(&folder.path().join("again")), Request::default()).unwrap().frames_in, 6);
        if size.0 < 16 {
            let error = make(&input, None, Request::default()).unwrap_err();
            assert!(error.to_string().contains("16 x 16"), "{error}");
        }
    }
}

#[test]
fn every_kind_of_y4m_shows_the_same_picture() {
    let grey = |value: u8| [value; 3];
    let folder = tempfile::tempdir().unwrap();
    // Limited range, white and black.
    for (kind, chroma) in [("mono", 0), ("420jpeg", 8), ("420paldv", 8), ("422", 16), ("444", 32)] {
        let mut bytes = format!("YUV4MPEG2 C{kind} H4 F10:1 W4\n").into_bytes();
        for luma in [235, 16] {
            bytes.extend_from_slice(b"FRAME\n");
            bytes.extend([luma; 16]);
            bytes.extend(vec![128; chroma]);
        }
        let (input, out) = (folder.path().join(format!("{kind}.y4m")), folder.path().join(kind));
        std::fs::write(&input, bytes).unwrap();
        make(&input, Some(&out), Request::default()).unwrap();
        let made = load(&out);
        assert_eq!(made.len(), 4, "{kind}");
        assert!(made[0].pixels().iter().all(|px| px[..3] == grey(255)), "{kind}");
        assert!(made[2].pixels().iter().all(|px| px[..3] == grey(0)), "{kind}");
    }
}

#[test]
fn a_video_that_ends_in_the_midst_of_a_frame_is_used_until_there() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cut-short.y4m");
    let bytes = y4m(&walk(SIZE, 4), "15:1");
    std::fs::write(&input, &bytes[..bytes.len() - 1000]).unwrap();
    let report = make(&input, None, Request::default()).unwrap();
    let error = report.failure.as_ref().expect("the end is missing").to_string();
    assert!(error.contains("cut-short.y4m") && error.contains("frame 3") && error.contains("3 frames"), "{error}");
    assert_eq!((report.frames_in, report.frames_out), (3, 6));
    assert_eq!(decode(&report.out).luma.len(), 6);

    // With less than two frames there is nothing to make.
    std::fs::write(&input, &bytes[..bytes.len() * 3 / 8]).unwrap();
    let error = make(&input, None, Request { overwrite: true, ..Request::default() }).unwrap_err();
    assert!(error.to_string().contains("frame 1"), "{error}");
}

fn refused(input: &Path, out: Option<&Path>, kind: ErrorKind, words: &[&str]) {
    let error = make(input, out, Request::default()).unwrap_err();
    assert_eq!(error.kind(), kind, "{error}");
    for word in words {
        assert!(error.to_string().contains(word), "{word:?} is not in: {error}");
    }
}

#[test]
fn folders_that_cannot_be_used_are_refused_before_anything_is_made() {
    use ErrorKind::{InvalidArgument, Io};
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in");
    refused(&input, None, Io, &["in", "Check the path"]);
    std::fs::create_dir(&input).unwrap();
    refused(&input, None, InvalidArgument, &["no picture", "PNG or JPEG"]);
    store(&input, &walk(SIZE, 1));
    refused(&input, None, InvalidArgument, &["one picture", "two or more"]);
    refused(&input.join("1.png"), None, InvalidArgument, &["1.png", "Name the folder"]);

    store(&input, &walk(SIZE, 12));
    std::fs::write(input.join("10.png"), media::encode_png(&picture((64, 36), 1, 0)).unwrap()).unwrap();
    refused(&input, None, InvalidArgument, &["10.png", "64 x 36", "1.png", "128 x 72"]);
    std::fs::write(input.join("10.png"), b"hello").unwrap();
    refused(&input, None, InvalidArgument, &["10.png", "PNG or JPEG"]);
    #[cfg(unix)]
    {
        std::fs::remove_file(input.join("10.png")).unwrap();
        std::os::unix::fs::symlink("nowhere.png", input.join("10.png")).unwrap();
        refused(&input, None, Io, &["10.png", "Check the path"]);
    }
    let made = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(made, 1, "nothing is made");
}

#[test]
fn files_that_are_no_video_are_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("clip.y4m");
    let one = y4m(&walk(SIZE, 1), "15:1");
    let head = one.iter().position(|byte| *byte == b'\n').unwrap();
    for (bytes, word) in [
        (Vec::new(), "empty"),
        (one.clone(), "frame"),
        (one[..=head].to_vec(), "frame"),
        (one[..head / 2].to_vec(), "header"),
        (b"YUV4MPEG2 W128 H72 F0:0\nFRAME\n".to_vec(), "frame rate"),
        (b"YUV4MPEG2 W99999999 H99999999 F15:1\nFRAME\n".to_vec(), "99999999"),
    ] {
        std::fs::write(&input, bytes).unwrap();
        let error = make(&input, None, Request::default()).unwrap_err().to_string();
        assert!(error.contains("clip.y4m") && error.contains(word), "{error}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is made");
}

#[test]
fn a_picture_that_is_damaged_inside_costs_what_follows() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (folder.path().join("in"), folder.path().join("out.mp4"));
    store(&input, &walk(SIZE, 5));
    let path = input.join("4.png");
    let bytes = std::fs::read(&path).unwrap();
    // The head, by which the folder is judged, is whole.
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let report = make(&input, Some(&out), Request::default()).unwrap();
    assert!(report.failure.unwrap().to_string().contains("4.png"));
    assert_eq!((report.frames_in, decode(&out).luma.len()), (3, 6));
}

#[test]
fn other_files_beside_the_pictures_are_left_aside_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in");
    store(&input, &walk(SIZE, 2));
    std::fs::write(input.join("notes.txt"), "when it rained").unwrap();
    std::fs::create_dir(input.join("2.5.png")).unwrap();
    let report = make(&input, None, Request::default()).unwrap();
    assert_eq!(report.frames_in, 2);
    let told = report.notes.join("\n");
    assert!(told.contains("notes.txt") && told.contains("--rate") && told.contains("2 beside"), "{told}");
    assert_eq!(report.new_rate.to_string(), "60");
    let again = Request { rate: Some(15), overwrite: true, ..Request::default() };
    assert_eq!(make(&input, None, again).unwrap().new_rate.to_string(), "30");
}

#[test]
fn the_input_and_earlier_outputs_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("clip.y4m");
    let bytes = y4m(&walk(SIZE, 2), "15:1");
    std::fs::write(&input, &bytes).unwrap();
    let around = folder.path().join("../").join(folder.path().file_name().unwrap()).join("clip.y4m");
    for out in [&input, &around] {
        let asked = Request { overwrite: true, ..Request::default() };
        let error = make(&input, Some(out), asked).unwrap_err();
        assert!(error.to_string().contains("its own input"), "{error}");
    }
    let pictures = folder.path().join("pictures");
    store(&pictures, &walk(SIZE, 2));
    refused(&pictures, Some(&pictures), ErrorKind::InvalidArgument, &["its own input"]);
    refused(&input, Some(&pictures), ErrorKind::InvalidArgument, &["is there already", "--overwrite"]);
    refused(&input, Some(&folder.path().join("clip.avi")), ErrorKind::InvalidArgument, &[".avi", ".mp4"]);
    refused(&input, Some(Path::new("/nowhere/at/all.mp4")), ErrorKind::Io, &["/nowhere/at/all.mp4"]);
    assert!(std::fs::read(&input).unwrap() == bytes);

    // An earlier run's pictures go, and nothing else does.
    make(&input, Some(&pictures), Request { overwrite: true, multiplier: 4, ..Request::default() }).unwrap();
    assert_eq!(load(&pictures).len(), 8);
    make(&input, Some(&pictures), Request { overwrite: true, ..Request::default() }).unwrap();
    assert_eq!(load(&pictures).len(), 4);
    assert!(pictures.join("1.png").exists());
}

#[test]
fn a_full_disk_leaves_what_can_be_played() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("clip.y4m");
    std::fs::write(&input, y4m(&walk(SIZE, 60), "15:1")).unwrap();
    for room in [100, 20_000, 60_000] {
        let out = folder.path().join(format!("{room}.mp4"));
        let asked = Request { disk: Arc::new(SmallDisk::new(room)), ..Request::default() };
        let report = make(&input, Some(&out), asked).unwrap();
        let error = report.failure.expect("the disk is too small").to_string();
        assert!(error.contains("Free some space"), "{error}");
        assert_eq!(report.has_output, out.exists());
        if out.exists() {
            assert!(!decode(&out).luma.is_empty());
        }
        assert!(!out.with_extension("mp4.part").exists());
    }
    assert!(folder.path().join("60000.mp4").exists(), "there was room for the beginning");
}

/// Asks to stop when a picture of a number is begun, as a person would at that moment.
struct StopAt(&'static AtomicBool);

impl FileSystem for StopAt {
    fn create(&self, path: &Path) -> std::io::Result<Box<dyn OutputFile>> {
        if path.ends_with("000005.png.part") {
            self.0.store(true, Ordering::SeqCst);
        }
        RealDisk.create(path)
    }
}

#[test]
fn what_is_finished_at_an_interruption_is_kept() {
    static STOP: AtomicBool = AtomicBool::new(false);
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (folder.path().join("clip.y4m"), folder.path().join("out"));
    std::fs::write(&input, y4m(&walk(SIZE, 200), "15:1")).unwrap();
    let report = make(&input, Some(&out), Request { disk: Arc::new(StopAt(&STOP)), stop: &STOP, ..Request::default() });
    let report = report.unwrap();
    assert!(report.interrupted && report.failure.is_none(), "{:?}", report.failure);
    assert!((6..30).contains(&report.frames_out), "{} frames", report.frames_out);
    assert_eq!(load(&out).len() as u64, report.frames_out);
}

#[test]
fn jpeg_pictures_are_read_too() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (folder.path().join("in"), folder.path().join("out"));
    std::fs::create_dir(&input).unwrap();
    for number in 0..2 {
        let frame = picture(SIZE, 1, number);
        let rgb: Vec<u8> = frame.pixels().iter().flat_map(|px| [px[0], px[1], px[2]]).collect();
        let path = input.join(format!("shot {number}.JPG"));
        image::save_buffer(path, &rgb, SIZE.0, SIZE.1, image::ColorType::Rgb8).unwrap();
    }
    make(&input, Some(&out), Request::default()).unwrap();
    let made = load(&out);
    assert_eq!(made.len(), 4);
    assert!(psnr(&picture(SIZE, 1, 0), &made[0]).unwrap() > 20.0);
}
