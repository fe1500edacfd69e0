//! Per-frame measurements: each stream against the truth, against its own earlier frames, and against the decoder's own pictures in between.
//!
//! All streams are sampled [`RATE`] times a second, so that each has a frame at every sample; of `decoded-60` it is every second frame. LPIPS
//! uses AlexNet; the network's features of a frame are computed once and used for all its comparisons. Memory does not grow with the
//! length of the video: three frames of each stream are held.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use cairn::{Picture, Result};

use super::paths::frame;
use super::walk::{RATE, STRIDE};
use crate::manifest::read_bounded;
use crate::metrics::{Features, Lpips, MS_SSIM_SIDE, ms_ssim, psnr, ssim};
use crate::picture::decode;
use crate::progress::Progress;

/// The largest frame, in bytes of its file.
const MAX_FRAME: u64 = 512 << 20;

/// A measurement of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Column {
    /// Against the truth, in dB.
    Psnr,
    /// Against the truth.
    Ssim,
    /// Against the truth, if the frame is large enough.
    MsSsim,
    /// Against the truth.
    Lpips,
    /// LPIPS of the stream's first frame against this frame's truth: how much of the first view is still valid.
    HeldLpips,
    /// To the frame before.
    AdjacentLpips,
    /// To the frame before.
    AdjacentSsim,
    /// To the previous anchor, at every second frame.
    AnchorLpips,
    /// To the previous anchor, at every second frame.
    AnchorSsim,
    /// Of a generated frame against the decoder's picture of the same latents and time, in dB.
    DecoderPsnr,
    /// As above.
    DecoderSsim,
    /// As above.
    DecoderLpips,
    /// Mean of red, 0 to 255.
    Red,
    /// Mean of green.
    Green,
    /// Mean of blue.
    Blue,
}

impl Column {
    const ALL: [(Self, &'static str); 15] = [
        (Self::Psnr, "psnr_db"),
        (Self::Ssim, "ssim"),
        (Self::MsSsim, "ms_ssim"),
        (Self::Lpips, "lpips"),
        (Self::HeldLpips, "held_lpips"),
        (Self::AdjacentLpips, "adjacent_lpips"),
        (Self::AdjacentSsim, "adjacent_ssim"),
        (Self::AnchorLpips, "anchor_lpips"),
        (Self::AnchorSsim, "anchor_ssim"),
        (Self::DecoderPsnr, "decoder_psnr_db"),
        (Self::DecoderSsim, "decoder_ssim"),
        (Self::DecoderLpips, "decoder_lpips"),
        (Self::Red, "red"),
        (Self::Green, "green"),
        (Self::Blue, "blue"),
    ];
}

/// Values of one frame, one per column; `None` where a column does not apply.
pub(crate) type Row = [Option<f64>; Column::ALL.len()];

/// All frames of a stream, from world time zero.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Series {
    /// Its branch, or `truth`.
    pub(crate) name: String,
    /// Frame by frame.
    pub(crate) rows: Vec<Row>,
}

impl Series {
    /// Values of a column, frame by frame.
    pub(crate) fn column(&self, column: Column) -> impl Iterator<Item = Option<f64>> + Clone + '_ {
        self.rows.iter().map(move |row| row[column as usize])
    }
}

/// Frames in a folder, sampled [`RATE`] times a second.
#[derive(Debug, Clone)]
pub(crate) struct Stream {
    /// Its branch, or `truth`.
    pub(crate) name: String,
    pub(crate) folder: PathBuf,
    /// Number of frames from one sample to the next.
    pub(crate) step: u64,
}

/// Streams and settings for measuring one scene.
pub(crate) struct Comparison<'a> {
    pub(crate) truth: &'a Stream,
    pub(crate) streams: &'a [Stream],
    /// Streams whose odd frames are generated, each with the one that has the decoder's pictures of the same latents.
    pub(crate) decoder: &'a [[&'a str; 2]],
    /// Number of samples.
    pub(crate) count: u64,
    /// `None` if LPIPS is not measured.
    pub(crate) lpips: Option<&'a Lpips>,
}

/// A picture and its LPIPS features.
struct LoadedFrame {
    picture: Picture,
    features: Option<Features>,
}

impl LoadedFrame {
    fn read(path: &Path, lpips: Option<&Lpips>) -> Result<Self> {
        let bytes = read_bounded(path, MAX_FRAME)?;
        let picture = decode(&bytes).map_err(|e| e.field(path.display().to_string()))?;
        Ok(Self { features: lpips.map(|lpips| lpips.features(&picture)).transpose()?, picture })
    }

    fn lpips(&self, other: &Self, lpips: Option<&Lpips>) -> Result<Option<f64>> {
        match (lpips, &self.features, &other.features) {
            (Some(lpips), Some(a), Some(b)) => lpips.distance(a, b).map(Some),
            _ => Ok(None),
        }
    }
}

/// Earlier frames of one stream that are still needed.
#[derive(Default)]
struct History {
    first: Option<LoadedFrame>,
    /// The frames one and two samples ago.
    before: [Option<LoadedFrame>; STRIDE as usize],
}

impl Comparison<'_> {
    /// Measures every frame. Returns the truth's own series, then that of each stream in order.
    ///
    /// # Errors
    /// `Io` for a missing frame, `InvalidArgument` for a file that is no picture or has another size; `Cancelled` when `stop` was set.
    pub(crate) fn measure(&self, progress: &Progress, stop: &AtomicBool) -> Result<Vec<Series>> {
        let all: Vec<&Stream> = std::iter::once(self.truth).chain(self.streams).collect();
        let mut series: Vec<Series> =
            all.iter().map(|stream| Series { name: stream.name.clone(), rows: Vec::new() }).collect();
        let mut histories: Vec<History> = all.iter().map(|_| History::default()).collect();
        progress.each_frame(self.count, stop, |number| {
            let seen = all
                .iter()
                .map(|stream| LoadedFrame::read(&frame(&stream.folder, number * stream.step), self.lpips))
                .collect::<Result<Vec<LoadedFrame>>>()?;
            for (i, series) in series.iter_mut().enumerate() {
                let mut row = self.row(number, &seen[i], &histories[i])?;
                if i > 0 {
                    self.against_truth(&seen[0], &seen[i], &histories[i], &mut row)?;
                }
                let decoded = self.decoder.iter().find(|[generated, _]| series.name == *generated);
                if let Some([_, decoded]) = decoded
                    && !number.is_multiple_of(STRIDE)
                    && let Some(reference) = all.iter().position(|stream| stream.name == *decoded)
                {
                    let (a, b) = (&seen[reference], &seen[i]);
                    row[Column::DecoderPsnr as usize] = Some(psnr(&a.picture, &b.picture)?);
                    row[Column::DecoderSsim as usize] = Some(ssim(&a.picture, &b.picture)?);
                    row[Column::DecoderLpips as usize] = a.lpips(b, self.lpips)?;
                }
                series.rows.push(row);
            }
            for (history, seen) in histories.iter_mut().zip(seen) {
                if history.first.is_none() {
                    // A copy, because the frame moves into the history.
                    history.first =
                        Some(LoadedFrame { picture: seen.picture.clone(), features: seen.features.clone() });
                }
                let [one, two] = &mut history.before;
                *two = one.take();
                *one = Some(seen);
            }
            Ok(())
        })?;
        Ok(series)
    }

    /// Measurements of a stream against its own earlier frames.
    fn row(&self, number: u64, seen: &LoadedFrame, history: &History) -> Result<Row> {
        let mut row = Row::default();
        let [one, two] = &history.before;
        let anchor = two.as_ref().filter(|_| number.is_multiple_of(STRIDE));
        for (before, lpips, similarity) in [
            (one.as_ref(), Column::AdjacentLpips, Column::AdjacentSsim),
            (anchor, Column::AnchorLpips, Column::AnchorSsim),
        ] {
            if let Some(before) = before {
                row[lpips as usize] = before.lpips(seen, self.lpips)?;
                row[similarity as usize] = Some(ssim(&before.picture, &seen.picture)?);
            }
        }
        let pixels = seen.picture.pixels();
        for (channel, column) in [Column::Red, Column::Green, Column::Blue].into_iter().enumerate() {
            let sum: u64 = pixels.iter().map(|px| u64::from(px[channel])).sum();
            row[column as usize] = Some(sum as f64 / pixels.len() as f64);
        }
        Ok(row)
    }

    fn against_truth(&self, truth: &LoadedFrame, seen: &LoadedFrame, history: &History, row: &mut Row) -> Result<()> {
        row[Column::Psnr as usize] = Some(psnr(&truth.picture, &seen.picture)?);
        row[Column::Ssim as usize] = Some(ssim(&truth.picture, &seen.picture)?);
        if truth.picture.width().min(truth.picture.height()) >= MS_SSIM_SIDE {
            row[Column::MsSsim as usize] = Some(ms_ssim(&truth.picture, &seen.picture)?);
        }
        row[Column::Lpips as usize] = truth.lpips(seen, self.lpips)?;
        row[Column::HeldLpips as usize] = truth.lpips(history.first.as_ref().unwrap_or(seen), self.lpips)?;
        Ok(())
    }
}

/// All series as CSV; `key` identifies their inputs.
pub(crate) fn to_csv(key: &str, series: &[Series]) -> String {
    let mut text = format!("# {key}\nstream,frame,seconds");
    Column::ALL.iter().for_each(|(_, name)| text += &format!(",{name}"));
    text.push('\n');
    for series in series {
        for (number, row) in series.rows.iter().enumerate() {
            // Writing to a string cannot fail.
            let _ = write!(text, "{},{number},{:.6}", series.name, number as f64 / f64::from(RATE));
            for value in row {
                let _ = match value {
                    Some(value) => write!(text, ",{value}"),
                    None => write!(text, ","),
                };
            }
            text.push('\n');
        }
    }
    text
}

/// Series written earlier under the same key; `None` if the key differs or the text is invalid.
pub(crate) fn from_csv(key: &str, text: &str) -> Option<Vec<Series>> {
    let mut lines = text.lines();
    if lines.next()?.strip_prefix("# ")? != key {
        return None;
    }
    let columns = Column::ALL.iter().map(|(_, name)| *name);
    if !lines.next()?.split(',').eq(["stream", "frame", "seconds"].into_iter().chain(columns)) {
        return None;
    }
    let mut all: Vec<Series> = Vec::new();
    for line in lines {
        let mut cells = line.split(',');
        let name = cells.next()?;
        let number: usize = cells.next()?.parse().ok()?;
        cells.next()?;
        if all.last().is_none_or(|series| series.name != name) {
            all.push(Series { name: name.to_owned(), rows: Vec::new() });
        }
        let series = all.last_mut()?;
        let mut row = Row::default();
        for value in &mut row {
            *value = match cells.next()? {
                "" => None,
                text => Some(text.parse().ok()?),
            };
        }
        if cells.next().is_some() || number != series.rows.len() {
            return None;
        }
        series.rows.push(row);
    }
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::FRAMES;
    use media::encode_png;

    /// Frames of a gradient whose brightness and position are given by `shown`.
    fn stream(folder: &Path, name: &str, step: u64, shown: impl Fn(u64) -> u32, count: u64) -> Stream {
        let folder = folder.join(name);
        std::fs::create_dir_all(folder.join(FRAMES)).unwrap();
        for number in 0..count {
            let mut picture = Picture::new(48, 40).unwrap();
            for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
                let x = i as u32 % 48 + shown(number);
                *px = [(x * 37 % 200) as u8, (x * 11 % 90) as u8, 40, 255];
            }
            std::fs::write(frame(&folder, number), encode_png(&picture).unwrap()).unwrap();
        }
        Stream { name: name.into(), folder, step }
    }

    fn measured(held: bool) -> Vec<Series> {
        let folder = tempfile::tempdir().unwrap();
        let truth = stream(folder.path(), "truth", 1, |n| n as u32, 7);
        let streams = [
            stream(folder.path(), "coherence", 1, |n| if held { n as u32 / 2 * 2 } else { n as u32 }, 7),
            stream(folder.path(), "decoded-60", 2, |n| n as u32 / 2, 13),
        ];
        let decoder = [["coherence", "decoded-60"]];
        let comparison = Comparison { truth: &truth, streams: &streams, decoder: &decoder, count: 7, lpips: None };
        comparison.measure(&Progress::quiet(), &AtomicBool::new(false)).unwrap()
    }

    #[test]
    fn frames_of_the_same_time_are_compared() {
        let [truth, coherence, decoded] = measured(false).try_into().unwrap();
        // Both show the truth, one of them at twice the rate.
        for series in [&coherence, &decoded] {
            assert!(series.column(Column::Psnr).all(|v| v == Some(f64::INFINITY)), "{}", series.name);
            assert_eq!(
                series.column(Column::AdjacentSsim).collect::<Vec<_>>(),
                truth.column(Column::AdjacentSsim).collect::<Vec<_>>()
            );
        }
        assert!(truth.column(Column::Psnr).all(|v| v.is_none()));
        let places = |column| coherence.column(column).map(|v: Option<f64>| u8::from(v.is_some())).collect::<Vec<_>>();
        assert_eq!(places(Column::AdjacentSsim), [0, 1, 1, 1, 1, 1, 1]);
        assert_eq!(places(Column::AnchorSsim), [0, 0, 1, 0, 1, 0, 1]);
        assert_eq!(places(Column::DecoderSsim), [0, 1, 0, 1, 0, 1, 0]);
        assert!(decoded.column(Column::DecoderPsnr).all(|v| v.is_none()));
    }

    /// Frames that `shown` makes from the true frames of a scene's walk.
    fn walked(folder: &Path, name: &str, shown: impl Fn(&[Picture], usize) -> Picture) -> Stream {
        let scene = scenes::Scene::new(scenes::Family::Sword, 3);
        let script =
            cairn::world::ControlScript::parse("cairn-controls 1\n0..9 hold W\n0..9 mouse 90 0\n9 end\n").unwrap();
        let options = scenes::ClipOptions { width: 112, height: 64, rate: RATE, ..Default::default() };
        let mut clip = scenes::Clip::new(&scene, &script, options).unwrap();
        let true_frames: Vec<Picture> = (0..9).map(|_| clip.frame().unwrap().picture).collect();
        let folder = folder.join(name);
        std::fs::create_dir_all(folder.join(FRAMES)).unwrap();
        for number in 0..true_frames.len() {
            let bytes = encode_png(&shown(&true_frames, number)).unwrap();
            std::fs::write(frame(&folder, number as u64), bytes).unwrap();
        }
        Stream { name: name.into(), folder, step: 1 }
    }

    /// Pitfalls of the mean change, with the real network: holding every second frame improves the mean and no other metric.
    #[test]
    fn held_and_blended_frames_do_not_win() {
        let folder = tempfile::tempdir().unwrap();
        let truth = walked(folder.path(), "truth", |all, n| all[n].clone());
        let streams = [
            walked(folder.path(), "good", |all, n| all[n].clone()),
            walked(folder.path(), "held", |all, n| all[n / 2 * 2].clone()),
            walked(folder.path(), "blended", |all, n| {
                let mut out = all[n].clone();
                if n % 2 == 1 {
                    let pair = all[n - 1].rgba().iter().zip(all[n + 1].rgba());
                    out.rgba_mut().iter_mut().zip(pair).for_each(|(out, (a, b))| *out = a.midpoint(*b));
                }
                out
            }),
        ];
        let lpips = crate::inputs::lpips(crate::metrics::Net::Alex, &Progress::quiet()).unwrap();
        let comparison = Comparison { truth: &truth, streams: &streams, decoder: &[], count: 9, lpips: Some(&lpips) };
        let series = comparison.measure(&Progress::quiet(), &AtomicBool::new(false)).unwrap();
        let figures = |n: usize| super::super::summary::summarise(&series[n], &series[0]);
        let [good, held, blended] = [1, 2, 3].map(figures);
        assert!(held.adjacent_lpips < good.adjacent_lpips, "the trap: {held:?}");
        assert_eq!((good.adjacent_error, good.anchor_error), (Some(0.0), Some(0.0)));
        assert!(held.adjacent_error > blended.adjacent_error && blended.adjacent_error > Some(0.0), "{blended:?}");
        assert_eq!(held.asymmetry, Some(f64::INFINITY));
        assert!(good.asymmetry.unwrap() < 1.3, "{good:?}");
        // At the anchors' own rate no stream has an advantage.
        assert_eq!((held.anchor_lpips, blended.anchor_lpips), (good.anchor_lpips, good.anchor_lpips));
        assert!(good.odd_lpips < blended.odd_lpips && blended.odd_lpips < held.odd_lpips, "{blended:?} {held:?}");
    }

    /// Three frames of each stream are held for any length. Runs in a process of its own, because the peak memory is measured.
    #[cfg(target_os = "linux")]
    #[test]
    fn memory_does_not_grow_with_the_length() {
        const VARIABLE: &str = "CAIRN_STUDY_TEST_FRAMES";
        const NAME: &str = "compare::series::tests::memory_does_not_grow_with_the_length";
        if let Ok(count) = std::env::var(VARIABLE) {
            let count: u64 = count.parse().unwrap();
            let folder = tempfile::tempdir().unwrap();
            let truth = stream(folder.path(), "truth", 1, |n| n as u32 % 5, 1);
            // All samples read the same file, to save disk space.
            let big = Picture::new(480, 270).unwrap();
            for n in 0..count {
                std::fs::write(frame(&truth.folder, n), encode_png(&big).unwrap()).unwrap();
            }
            let streams = [truth.clone()];
            let comparison = Comparison { truth: &truth, streams: &streams, decoder: &[], count, lpips: None };
            comparison.measure(&Progress::quiet(), &AtomicBool::new(false)).unwrap();
            let status = std::fs::read_to_string("/proc/self/status").unwrap();
            let most = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
            println!("most {}", most.trim().trim_end_matches(" kB"));
            return;
        }
        let most = |count: u32| -> u64 {
            let program = std::env::current_exe().unwrap();
            let ran = std::process::Command::new(program)
                .args(["--exact", NAME, "--nocapture", "--test-threads=1"])
                .env(VARIABLE, count.to_string())
                .output()
                .unwrap();
            let text = String::from_utf8_lossy(&ran.stdout).into_owned();
            text.lines().find_map(|line| line.split_once("most ")?.1.parse().ok()).unwrap_or_else(|| panic!("{text}"))
        };
        let (few, many) = (most(4), most(44));
        // A frame has 518 KB; if they were kept, 40 more of two streams would take 41 MB.
        assert!(many < few + 12_000, "{few} kB for 4 frames, {many} kB for 44");
    }

    #[test]
    fn a_held_stream_shows_in_every_second_frame() {
        let series = measured(true);
        let adjacent: Vec<f64> = series[1].column(Column::AdjacentSsim).flatten().collect();
        assert!(adjacent.iter().step_by(2).all(|v| *v == 1.0) && adjacent.iter().skip(1).step_by(2).all(|v| *v < 1.0));
    }

    #[test]
    fn series_are_read_again_under_their_key_alone() {
        let series = measured(false);
        let text = to_csv("key", &series);
        assert_eq!(from_csv("key", &text).unwrap(), series);
        assert!(from_csv("other", &text).is_none());
        assert!(from_csv("key", &text[..text.len() - 9]).is_none());
        assert!(from_csv("key", &text.replace("psnr_db", "psnr")).is_none());
        assert!(from_csv("key", "").is_none());
    }
}
