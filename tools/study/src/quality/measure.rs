//! Makes and scores the pictures of every row.

use std::cell::OnceCell;
use std::fmt;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::guidance::Guidance;
use cairn::{Error, ErrorKind, Picture, Result};

use super::clips::{self, Clip, Phase, Scale};
use super::rows::{self, Interval, Row};
use super::store::{Store, digest, digest_picture};
use crate::metrics::{Features, Lpips, Score};
use crate::progress::Progress;

/// Part of every stored score's key; changed when the same pictures would get another score.
const SCORES: &str = "psnr, ssim 1";

/// Score of one picture of one row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Record {
    pub(super) clip: String,
    pub(super) group: String,
    /// Whether the scenes rendered the clip.
    pub(super) is_rendered: bool,
    pub(super) row: rows::Kind,
    /// Number of the anchor at the interval's end.
    pub(super) anchor: usize,
    pub(super) phase: Phase,
    /// Multiples of the anchors' rate to whose means it belongs.
    pub(super) multipliers: Vec<u32>,
    pub(super) score: Score,
}

/// A row or a clip that is not available.
#[derive(Debug, Clone)]
pub(super) struct Unavailable {
    pub(super) name: String,
    pub(super) why: String,
}

impl fmt::Display for Unavailable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.name, self.why)
    }
}

/// Plan of the measurement.
pub(super) struct Plan {
    pub(super) rows: Vec<rows::Kind>,
    pub(super) clips: Vec<clips::Kind>,
    pub(super) seeds: Vec<u64>,
    pub(super) scale: Scale,
}

/// All measurements.
pub(super) struct Measurements {
    pub(super) records: Vec<Record>,
    pub(super) left_out: Vec<Unavailable>,
    pub(super) rows: Vec<(rows::Kind, Box<dyn Row>)>,
    pub(super) clips: Vec<Box<dyn Clip>>,
    /// `None` if LPIPS is not measured.
    pub(super) lpips: Option<Lpips>,
    pub(super) computed: usize,
    pub(super) kept: usize,
    pub(super) interrupted: bool,
}

/// Opens clips and rows, and scores each row on each clip.
///
/// # Errors
/// A clip or a row that fails while it works; disk errors. Unavailable clips and rows are left out and listed.
pub(super) fn run(
    plan: &Plan,
    lpips: Result<Option<Lpips>>,
    store: &Store,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<Measurements> {
    let mut measured = Measurements {
        records: Vec::new(),
        left_out: Vec::new(),
        rows: Vec::new(),
        clips: Vec::new(),
        lpips: None,
        computed: 0,
        kept: 0,
        interrupted: false,
    };
    progress.phase("opening rows and clips");
    match lpips {
        Ok(lpips) => measured.lpips = lpips,
        Err(error) => measured.left_out.push(Unavailable { name: "LPIPS".into(), why: error.to_string() }),
    }
    for &kind in plan.rows.iter().filter(|_| !plan.clips.is_empty()) {
        match kind.open(progress) {
            Ok(row) => measured.rows.push((kind, row)),
            Err(error) => measured.left_out.push(Unavailable { name: kind.name().into(), why: error.to_string() }),
        }
    }
    for kind in &plan.clips {
        match kind.open(&plan.seeds, plan.scale, progress) {
            Ok(clips) => measured.clips.extend(clips),
            Err(error) => measured.left_out.push(Unavailable { name: kind.name(), why: error.to_string() }),
        }
    }
    if !plan.clips.is_empty() && (measured.rows.is_empty() || measured.clips.is_empty()) {
        let why: Vec<String> = measured.left_out.iter().map(ToString::to_string).collect();
        return Err(Error::new(ErrorKind::Unsupported, format!("nothing is left to compare: {}", why.join("; "))));
    }

    let intervals: usize = measured.clips.iter().map(|clip| clip.targets().len()).sum();
    progress.begin((intervals * measured.rows.len()) as u64);
    let mut done = 0;
    for number in 0..measured.clips.len() {
        for target in 0..measured.clips[number].targets().len() {
            if stop.load(Ordering::SeqCst) {
                measured.interrupted = true;
                progress.end();
                return Ok(measured);
            }
            measured.interval(number, target, store, &mut || {
                done += 1;
                progress.frames(done);
            })?;
        }
    }
    progress.end();
    Ok(measured)
}

/// The two anchors of an interval, and the cache key of results that depend on them.
struct IntervalEnds {
    previous: Picture,
    current: Picture,
    key: String,
}

impl Measurements {
    /// Scores every row on one interval.
    fn interval(&mut self, clip: usize, target: usize, store: &Store, done: &mut dyn FnMut()) -> Result<()> {
        let Self { clips, rows, records, lpips, computed, kept, .. } = self;
        let measures = format!("{SCORES} {}", lpips.as_ref().map_or_else(String::new, |l| l.net().to_string()));
        let clip = clips[clip].as_mut();
        let target = clip.targets()[target].clone();
        let (previous, current) = (clip.anchor(target.anchor - 1, store)?, clip.anchor(target.anchor, store)?);
        let key = digest([digest_picture(&previous).as_bytes(), digest_picture(&current).as_bytes()]);
        let ends = IntervalEnds { previous, current, key };
        let exact = guidance(clip, target.anchor, store)?;
        let of_engine = if rows.iter().any(|(kind, _)| kind.needs_engine()) {
            engine_guidance(clip, target.anchor)?
        } else {
            [None, None]
        };
        let truths = target.phases().into_iter().map(|phase| Truth::new(clip, target.anchor, phase, store));
        let truths = truths.collect::<Result<Vec<_>>>()?;

        for (kind, row) in rows.iter_mut() {
            let guidance = if kind.needs_engine() { &of_engine } else { &exact };
            if !(kind.needs_guidance() && guidance[1].is_none()) {
                let wanted: Vec<&Truth> = truths.iter().filter(|truth| kind.can_do(truth.phase)).collect();
                let version = row_key(*kind, row.as_ref(), guidance);
                let name = |truth: &Truth| {
                    digest([&measures, kind.name(), &version, &ends.key, &truth.key].map(str::as_bytes))
                };
                let known =
                    wanted.iter().map(|truth| Ok(store.stored_line(&name(truth))?.and_then(|line| parse(&line))));
                let mut scores = known.collect::<Result<Vec<Option<Score>>>>()?;
                let missing: Vec<usize> = (0..scores.len()).filter(|i| scores[*i].is_none()).collect();
                *kept += scores.len() - missing.len();
                *computed += missing.len();
                if !missing.is_empty() {
                    let phases: Vec<Phase> = missing.iter().map(|i| wanted[*i].phase).collect();
                    let made = pictures(*kind, row.as_mut(), clip, target.anchor, &ends, guidance, &phases, store)?;
                    for (i, picture) in missing.into_iter().zip(made) {
                        let score = wanted[i].score(picture, lpips.as_ref())?;
                        store.store_line(&name(wanted[i]), &line(score))?;
                        scores[i] = Some(score);
                    }
                }
                for (truth, score) in wanted.iter().zip(scores) {
                    let multipliers =
                        target.multipliers.iter().copied().filter(|m| truth.phase.belongs_to(*m)).collect();
                    records.extend(score.map(|score| Record {
                        clip: clip.name().into(),
                        group: clip.group().into(),
                        is_rendered: clip.is_rendered(),
                        row: *kind,
                        anchor: target.anchor,
                        phase: truth.phase,
                        multipliers,
                        score,
                    }));
                }
            }
            done();
        }
        Ok(())
    }

    /// The anchors before and after an interval of `clip`.
    pub(super) fn ends(&mut self, clip: &str, anchor: usize, store: &Store) -> Result<[Picture; 2]> {
        let unknown = || Error::new(ErrorKind::InvalidArgument, format!("there is no clip {clip:?}"));
        let clip = self.clips.iter_mut().find(|c| c.name() == clip).ok_or_else(unknown)?;
        Ok([clip.anchor(anchor - 1, store)?, clip.anchor(anchor, store)?])
    }

    /// The true picture of `clip` at `phase` before anchor `anchor`, then the picture of every row that can make it.
    pub(super) fn show(
        &mut self,
        clip: &str,
        anchor: usize,
        phase: Phase,
        store: &Store,
    ) -> Result<Vec<(Option<rows::Kind>, Picture)>> {
        let Self { clips, rows, .. } = self;
        let Some(clip) = clips.iter_mut().find(|c| c.name() == clip) else { return Ok(Vec::new()) };
        let clip = clip.as_mut();
        let (previous, current) = (clip.anchor(anchor - 1, store)?, clip.anchor(anchor, store)?);
        let key = digest([digest_picture(&previous).as_bytes(), digest_picture(&current).as_bytes()]);
        let ends = IntervalEnds { previous, current, key };
        let (exact, of_engine) = (guidance(clip, anchor, store)?, engine_guidance(clip, anchor)?);
        let mut shown = vec![(None, clip.truth(anchor, phase, store)?)];
        for (kind, row) in rows.iter_mut() {
            let guidance = if kind.needs_engine() { &of_engine } else { &exact };
            if kind.can_do(phase) && !(kind.needs_guidance() && guidance[1].is_none()) {
                let made = pictures(*kind, row.as_mut(), clip, anchor, &ends, guidance, &[phase], store)?;
                shown.extend(made.into_iter().map(|picture| (Some(*kind), picture)));
            }
        }
        Ok(shown)
    }
}

/// True motion and depth of the two anchors of an interval, if known.
pub(super) fn guidance(clip: &mut dyn Clip, anchor: usize, store: &Store) -> Result<[Option<Guidance>; 2]> {
    // The first anchor has no predecessor and so no motion.
    let before = if anchor >= 2 { clip.guidance(anchor - 1, store)? } else { None };
    Ok([before, clip.guidance(anchor, store)?])
}

/// An engine's motion and depth of the two anchors of an interval, if one drew the clip.
pub(super) fn engine_guidance(clip: &mut dyn Clip, anchor: usize) -> Result<[Option<Guidance>; 2]> {
    let before = if anchor >= 2 { clip.engine_guidance(anchor - 1)? } else { None };
    Ok([before, clip.engine_guidance(anchor)?])
}

/// Motion and depth of the anchors from `first` to the one before the interval's earlier one, without those before the last gap.
fn history(kind: rows::Kind, clip: &mut dyn Clip, first: usize, anchor: usize, store: &Store) -> Result<Vec<Guidance>> {
    let mut known = Vec::new();
    // The first anchor of the clip and of the history have no predecessor there.
    for number in (first + 1..anchor - 1).rev() {
        let guidance = if kind.needs_engine() { clip.engine_guidance(number)? } else { clip.guidance(number, store)? };
        let Some(guidance) = guidance else { break };
        known.push(guidance);
    }
    known.reverse();
    Ok(known)
}

/// Changes with everything besides the anchors that affects a row's pictures of an interval, the motion and depth that it gets among it. A row
/// of this program changes with its build, which has the clips.
fn row_key(kind: rows::Kind, row: &dyn Row, guidance: &[Option<Guidance>; 2]) -> String {
    if !kind.needs_guidance() || kind.is_built_in() {
        return row.key();
    }
    let mut parts = vec![row.key().into_bytes()];
    for given in guidance.iter().flatten() {
        let vectors = given.motion().vectors().iter().flatten();
        parts.push(vectors.flat_map(|value| value.to_le_bytes()).collect());
        parts.push(given.depth().depth().iter().flat_map(|value| value.to_le_bytes()).collect());
        parts.push(format!("{:?}", given.depth().projection()).into_bytes());
    }
    digest(parts.iter().map(Vec::as_slice))
}

/// A row's pictures: stored ones are read, the others are made and stored.
#[expect(clippy::too_many_arguments, reason = "one place that two callers share, with everything about one interval")]
fn pictures(
    kind: rows::Kind,
    row: &mut dyn Row,
    clip: &mut dyn Clip,
    anchor: usize,
    ends: &IntervalEnds,
    guidance: &[Option<Guidance>; 2],
    phases: &[Phase],
    store: &Store,
) -> Result<Vec<Picture>> {
    let version = row_key(kind, row, guidance);
    let name = |phase: &Phase| digest([&version, &ends.key, &phase.to_string()].map(|part| part.as_bytes()));
    let names: Vec<String> = phases.iter().map(name).collect();
    // This program makes its own pictures faster than it reads them, and they change with every build.
    if !kind.is_built_in() {
        let kept: Result<Vec<Option<Picture>>> = names.iter().map(|name| store.stored_row(kind.name(), name)).collect();
        if let Some(kept) = kept?.into_iter().collect() {
            return Ok(kept);
        }
    }
    let before_it = kind.margin().max(kind.history());
    let (first, last) = (anchor.saturating_sub(1 + before_it), (anchor + kind.margin()).min(clip.anchors() - 1));
    let mut anchors = Vec::new();
    for number in first..=last {
        anchors.push(match number {
            n if n + 1 == anchor => ends.previous.clone(),
            n if n == anchor => ends.current.clone(),
            n => clip.anchor(n, store)?,
        });
    }
    let history = if kind.needs_guidance() { history(kind, clip, first, anchor, store)? } else { Vec::new() };
    let [before, guidance] = guidance.each_ref().map(Option::as_ref);
    let overlay = if kind.needs_guidance() { clip.overlay(anchor, store)? } else { None };
    let interval = Interval {
        anchors: &anchors,
        at: anchor - 1 - first,
        guidance,
        before,
        overlay: overlay.as_deref(),
        history: &history,
    };
    let made = row.make(&interval, phases)?;
    if made.len() != phases.len() || made.iter().any(|picture| picture.size() != ends.current.size()) {
        return Err(Error::new(
            ErrorKind::InvalidState,
            format!("{} gave other pictures than it was asked for", kind.name()),
        ));
    }
    if !kind.is_built_in() {
        for (name, picture) in names.iter().zip(&made) {
            store.store_row(kind.name(), name, picture)?;
        }
    }
    Ok(made)
}

/// A true picture and the mask of scored pixels.
pub(super) struct Truth {
    phase: Phase,
    picture: Picture,
    counts: Option<Vec<bool>>,
    /// Its LPIPS features, computed at first use.
    features: OnceCell<Features>,
    key: String,
}

impl Truth {
    pub(super) fn new(clip: &mut dyn Clip, anchor: usize, phase: Phase, store: &Store) -> Result<Self> {
        let (picture, counts) = (clip.truth(anchor, phase, store)?, clip.scored(anchor, phase, store)?);
        let mask: Vec<u8> = counts.iter().flatten().map(|counts| u8::from(*counts)).collect();
        let key = digest([phase.to_string().as_bytes(), digest_picture(&picture).as_bytes(), &mask]);
        Ok(Self { phase, picture, counts, features: OnceCell::new(), key })
    }

    /// Scores `picture`, with LPIPS if available. Pixels that are not scored are first made equal to the truth, for every row.
    pub(super) fn score(&self, mut picture: Picture, lpips: Option<&Lpips>) -> Result<Score> {
        if let Some(counts) = &self.counts {
            for ((pixel, truth), counts) in picture.pixels_mut().iter_mut().zip(self.picture.pixels()).zip(counts) {
                if !counts {
                    *pixel = *truth;
                }
            }
        }
        let lpips = match lpips {
            Some(lpips) => {
                if self.features.get().is_none() {
                    // Cannot fail: this is the only owner.
                    let _ = self.features.set(lpips.features(&self.picture)?);
                }
                self.features.get().map(|truth| lpips.distance_to(truth, &picture)).transpose()?
            }
            None => None,
        };
        Score::new(&self.picture, &picture, lpips)
    }
}

/// A score as stored text, exact to the last bit.
fn line(score: Score) -> String {
    let lpips = score.lpips.map_or_else(|| "-".to_owned(), |v| v.to_string());
    format!("{} {} {lpips}", score.psnr, score.ssim)
}

fn parse(line: &str) -> Option<Score> {
    let mut words = line.split_whitespace();
    let (psnr, ssim) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let lpips = match words.next()? {
        "-" => None,
        value => Some(value.parse().ok()?),
    };
    Some(Score { psnr, ssim, lpips })
}

/// Every frame's scores as a CSV file.
pub(super) fn csv(records: &[Record]) -> String {
    let mut text = "clip,row,anchor,phase,multipliers,psnr,ssim,lpips\n".to_owned();
    for r in records {
        let multipliers: Vec<String> = r.multipliers.iter().map(ToString::to_string).collect();
        let lpips = r.score.lpips.map_or_else(String::new, |v| format!("{v:.5}"));
        let (row, Score { psnr, ssim, .. }) = (r.row.name(), r.score);
        _ = writeln!(
            text,
            "{},{row},{},{},{},{psnr:.4},{ssim:.5},{lpips}",
            r.clip,
            r.anchor,
            r.phase,
            multipliers.join(" ")
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::MAX_PSNR;

    #[test]
    fn a_score_survives_its_line() {
        for lpips in [None, Some(0.1 + 0.2)] {
            let score = Score { psnr: 1.0 / 3.0, ssim: 0.987_654_321_012_345, lpips };
            assert_eq!(parse(&line(score)), Some(score));
        }
        assert_eq!((parse("31.5 0.9"), parse("31.5 x -"), parse("")), (None, None, None));
    }

    #[test]
    fn another_programs_pictures_follow_the_motion_and_depth_that_it_gets() {
        struct Other;
        impl Row for Other {
            fn version(&self) -> String {
                "other 1".into()
            }

            fn make(&mut self, _interval: &Interval<'_>, _phases: &[Phase]) -> Result<Vec<Picture>> {
                Ok(Vec::new())
            }
        }
        let guidance = |depth: f32| {
            let mut guidance = Guidance::new(2, 2, cairn::guidance::picture_flow::PROJECTION).unwrap();
            guidance.depth_mut().fill(depth);
            [None, Some(guidance)]
        };
        let key = |kind, depth| row_key(kind, &Other, &guidance(depth));
        assert_eq!(key(rows::Kind::Fsr, 0.5), key(rows::Kind::Fsr, 0.5));
        assert_ne!(key(rows::Kind::Fsr, 0.5), key(rows::Kind::Fsr, 0.25));
        let mut moved = guidance(0.5);
        moved[1].as_mut().unwrap().motion_mut().vectors_mut()[3] = [half::f16::ONE; 2];
        assert_ne!(key(rows::Kind::Fsr, 0.5), row_key(rows::Kind::Fsr, &Other, &moved));
        // These depend on pictures alone, or are this program's.
        for kind in [rows::Kind::Rife, rows::Kind::FsrFlow, rows::Kind::Truth] {
            assert_eq!(key(kind, 0.5), "other 1");
        }
    }

    #[test]
    fn pixels_that_do_not_count_are_left_out_of_every_measure() {
        let picture = Picture::from_rgba(16, 16, (0..1024).map(|i| (i * 37 % 251) as u8).collect()).unwrap();
        let mut other = picture.clone();
        other.pixels_mut()[3] = [0, 255, 9, 255];
        let mut counts = vec![true; 256];
        let mut truth = Truth {
            phase: Phase::HALF,
            picture,
            counts: Some(counts.clone()),
            features: OnceCell::new(),
            key: String::new(),
        };
        assert!(truth.score(other.clone(), None).unwrap().psnr < MAX_PSNR);
        counts[3] = false;
        truth.counts = Some(counts);
        let score = truth.score(other, None).unwrap();
        assert!(score.psnr == MAX_PSNR && (score.ssim - 1.0).abs() < 1e-9);
    }
}
