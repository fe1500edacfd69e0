use std::time::Duration;

use super::*;
use crate::framegen::GenerateReport;
use crate::framegen::cpu::CpuGenerator;
use crate::framegen::{Anchor, AnchorPair};
use crate::guidance::paper;
use crate::world::GuidanceSource;

const MS: u64 = 1_000_000;
const WIDTH: u32 = 48;
const HEIGHT: u32 = 32;

/// A picture with structure that moves by two pixels from anchor to anchor.
fn anchor(number: u64, cut: bool) -> Arc<KeptAnchor> {
    let mut picture = Picture::new(WIDTH, HEIGHT).unwrap();
    for (i, pixel) in picture.pixels_mut().iter_mut().enumerate() {
        let (x, y) = (i as u64 % u64::from(WIDTH) + 2 * number, i as u64 / u64::from(WIDTH));
        *pixel = [(x * 9 % 200) as u8, (y * 7) as u8, ((x / 4 + y / 4) % 2 * 90) as u8, 255];
    }
    Arc::new(KeptAnchor::of_picture(picture, number, cut))
}

fn options() -> PresenterOptions {
    PresenterOptions { interval: Some(Interval::of_ns(60 * MS).unwrap()), ..PresenterOptions::default() }
}

fn presenter(options: PresenterOptions) -> Presenter {
    Presenter::new(options, Some(Box::new(CpuGenerator::new()))).unwrap()
}

fn draw(presenter: &Presenter, now: u64) -> (FrameInfo, Picture) {
    let mut out = None;
    let size = presenter.size().unwrap();
    let shown = presenter.draw(now, size, |picture| out = Some(picture.clone())).unwrap().unwrap();
    (shown, out.unwrap())
}

#[test]
fn anchors_are_shown_unchanged_and_frames_between_them_come_from_the_generator() {
    let presenter = presenter(options());
    assert_eq!(presenter.query(0), None);
    let anchors = [anchor(0, true), anchor(1, false)];
    for (i, anchor) in anchors.iter().enumerate() {
        assert!(presenter.push(anchor.clone(), None, i as u64 * 60 * MS).unwrap());
    }
    let (shown, picture) = draw(&presenter, 60 * MS);
    assert_eq!((shown.source, shown.previous, shown.t), (FrameSource::Anchor, 0, 0.0));
    assert_eq!(&picture, anchors[0].picture().unwrap());
    let (shown, picture) = draw(&presenter, 90 * MS);
    assert_eq!((shown.source, shown.previous, shown.current, shown.t), (FrameSource::Generated, 0, 1, 0.5));
    let guidance = extract(GuidanceSource::PictureFlow, &anchors[0], &anchors[1]).unwrap();
    let pair = AnchorPair::new(anchors[0].picture().unwrap(), anchors[1].picture().unwrap(), &guidance).unwrap();
    let mut expected = Picture::new(WIDTH, HEIGHT).unwrap();
    CpuGenerator::new().generate(&pair, 0.5, &mut expected).unwrap();
    assert_eq!(picture, expected);
    // Pushed guidance replaces extracted guidance.
    let still = Arc::new(Guidance::new(WIDTH, HEIGHT, paper::PROJECTION).unwrap());
    presenter.reset();
    presenter.push(anchors[0].clone(), None, 1_000 * MS).unwrap();
    presenter.push(anchors[1].clone(), Some(still), 1_060 * MS).unwrap();
    assert_ne!(draw(&presenter, 1_090 * MS).1, expected);
}

#[test]
fn a_frame_that_is_drawn_again_is_not_made_again() {
    let presenter = presenter(PresenterOptions { size: Some((96, 64)), ..options() });
    presenter.push(anchor(0, true), None, 0).unwrap();
    presenter.push(anchor(1, false), None, 60 * MS).unwrap();
    let (first, picture) = draw(&presenter, 90 * MS);
    let spent = presenter.statistics().generate;
    let (again, same) = draw(&presenter, 119 * MS);
    assert_eq!((first.repeated, again.repeated), (false, true));
    assert!(picture == same && picture.size() == (96, 64));
    let statistics = presenter.statistics();
    assert_eq!((statistics.generate, statistics.generated, statistics.repeated), (spent, 2, 1));
    // After a reset the frame is made anew, although the anchors' numbers are the same.
    presenter.reset();
    presenter.push(anchor(0, true), None, 200 * MS).unwrap();
    presenter.push(anchor(1, false), None, 260 * MS).unwrap();
    assert!(!draw(&presenter, 290 * MS).0.repeated);
}

#[test]
fn nothing_is_generated_across_a_cut() {
    for (second, states_it) in [(anchor(1, true), true), (anchor(7, false), false)] {
        let presenter = presenter(PresenterOptions { multiplier: 4, ..options() });
        let first = anchor(0, true);
        presenter.push(first.clone(), None, 0).unwrap();
        presenter.push(second.clone(), None, 60 * MS).unwrap();
        for (step, expected) in [(1, &first), (2, &second), (3, &second)] {
            let (shown, picture) = draw(&presenter, 60 * MS + step * 15 * MS);
            assert_eq!((shown.source, shown.cut), (FrameSource::Held, true), "stated: {states_it}");
            assert_eq!(&picture, expected.picture().unwrap());
        }
        // Nor is it extrapolated: no motion leads to this anchor.
        let (shown, picture) = draw(&presenter, 135 * MS);
        assert_eq!((shown.source, shown.cut, &picture), (FrameSource::Held, true, second.picture().unwrap()));
    }
}

#[test]
fn frames_are_extrapolated_for_late_anchors_unless_the_options_forbid_it() {
    for extrapolate in [true, false] {
        let presenter = presenter(PresenterOptions { extrapolate, ..options() });
        let last = anchor(1, false);
        presenter.push(anchor(0, true), None, 0).unwrap();
        presenter.push(last.clone(), None, 60 * MS).unwrap();
        let sources = [(120, FrameSource::Anchor), (150, FrameSource::Extrapolated), (210, FrameSource::Held)];
        let mut pictures = Vec::new();
        for (ms, source) in sources {
            let (shown, picture) = draw(&presenter, ms * MS);
            let expected = if source == FrameSource::Anchor { source } else { FrameSource::Held };
            assert_eq!(shown.source, if extrapolate { source } else { expected }, "{ms}");
            pictures.push(picture);
        }
        assert_eq!(pictures.iter().all(|picture| picture == last.picture().unwrap()), !extrapolate);
        assert_eq!(pictures[1] == pictures[2], !extrapolate);
    }
}

#[test]
fn without_a_generator_the_nearer_anchor_is_held() {
    let presenter = Presenter::new(PresenterOptions { multiplier: 3, ..options() }, None).unwrap();
    let anchors = [anchor(0, true), anchor(1, false)];
    presenter.push(anchors[0].clone(), None, 0).unwrap();
    presenter.push(anchors[1].clone(), None, 60 * MS).unwrap();
    for (ms, nearer) in [(80, 0), (100, 1), (150, 1)] {
        let (shown, picture) = draw(&presenter, ms * MS);
        assert_eq!((shown.source, shown.cut), (FrameSource::Held, false));
        assert_eq!(&picture, anchors[nearer].picture().unwrap());
    }
}

/// Supports only t = 1/2 and paints everything green.
struct Halfway;

impl FrameGenerator for Halfway {
    fn name(&self) -> &str {
        "halfway"
    }

    fn phases(&self) -> Phases {
        Phases::OnlyHalf
    }

    fn generate(&mut self, _: &AnchorPair<'_>, t: f32, out: &mut Picture) -> Result<GenerateReport> {
        assert_eq!(t, 0.5);
        out.pixels_mut().fill([0, 255, 0, 255]);
        Ok(GenerateReport { outcome: Outcome::Generated, uncovered: 0.0, unexplained: 0.0 })
    }

    fn extrapolate(&mut self, _: &Anchor<'_>, _: f32, out: &mut Picture) -> Result<GenerateReport> {
        out.pixels_mut().fill([255, 0, 0, 255]);
        Ok(GenerateReport { outcome: Outcome::Held, uncovered: 0.0, unexplained: 0.0 })
    }

    fn reset(&mut self) {}
}

#[test]
fn a_generator_of_middle_frames_makes_only_those() {
    let presenter = Presenter::new(PresenterOptions { multiplier: 4, ..options() }, Some(Box::new(Halfway))).unwrap();
    presenter.push(anchor(0, true), None, 0).unwrap();
    presenter.push(anchor(1, false), None, 60 * MS).unwrap();
    let sources = [15, 30, 45].map(|ms| draw(&presenter, (60 + ms) * MS).0.source);
    assert_eq!(sources, [FrameSource::Held, FrameSource::Generated, FrameSource::Held]);
    // The frame's source follows the generator's report.
    assert_eq!(draw(&presenter, 135 * MS).0.source, FrameSource::Held);
}

#[test]
fn at_most_capacity_anchors_wait() {
    let presenter = presenter(PresenterOptions { capacity: 2, ..options() });
    assert!(presenter.push(anchor(0, true), None, 0).unwrap());
    assert!(presenter.push(anchor(1, false), None, 0).unwrap());
    assert!(presenter.push(anchor(2, false), None, 0).unwrap());
    assert!(!presenter.push(anchor(3, false), None, 0).unwrap());
    assert_eq!((presenter.waiting(0), presenter.statistics().anchors), (2, 3));
    // Anchor 1 is due and does not wait any more.
    assert!(presenter.push(anchor(3, false), None, 120 * MS).unwrap());
    for now in (0..2_000).map(|ms| ms * MS) {
        draw(&presenter, now);
    }
}

#[test]
fn invalid_arguments_are_refused() {
    let field = |error: Error| error.offending_field().map(str::to_owned);
    let presenter = Presenter::new(PresenterOptions { interval: None, ..options() }, None).unwrap();
    assert_eq!(field(presenter.push(anchor(0, true), None, 0).unwrap_err()), Some("anchor".into()));
    let presenter = self::presenter(PresenterOptions { motion: GuidanceSource::Paper, ..options() });
    presenter.push(anchor(0, true), None, 0).unwrap();
    let small = Arc::new(KeptAnchor::of_picture(Picture::new(8, 8).unwrap(), 1, false));
    assert_eq!(field(presenter.push(small, None, 0).unwrap_err()), Some("anchor".into()));
    let small = Arc::new(Guidance::new(8, 8, paper::PROJECTION).unwrap());
    assert_eq!(field(presenter.push(anchor(1, false), Some(small), 0).unwrap_err()), Some("guidance".into()));
    presenter.push(anchor(1, false), None, 60 * MS).unwrap();
    assert!(presenter.draw(90 * MS, (WIDTH, HEIGHT), |_| ()).is_err(), "no latents");
    assert!(presenter.draw(120 * MS, (8, 8), |_| ()).is_err(), "another size");
    assert!(presenter.draw(120 * MS, (WIDTH, HEIGHT), |_| ()).unwrap().is_some());
    for wrong in [
        PresenterOptions { multiplier: 0, ..options() },
        PresenterOptions { size: Some((0, 4)), ..options() },
        PresenterOptions { capacity: 0, ..options() },
        PresenterOptions { capacity: usize::MAX, ..options() },
    ] {
        assert!(Presenter::new(wrong, None).is_err());
    }
}

#[test]
fn the_stream_continues_after_a_change_of_size() {
    let fixed = presenter(PresenterOptions { size: Some((30, 20)), ..options() });
    let changing = presenter(options());
    for presenter in [&fixed, &changing] {
        presenter.push(anchor(0, true), None, 0).unwrap();
        presenter.push(anchor(1, false), None, 60 * MS).unwrap();
    }
    let (first, whole) = draw(&changing, 90 * MS);
    changing.resize(Some((30, 20))).unwrap();
    let (second, small) = draw(&changing, 91 * MS);
    // The same frame in another size.
    assert_eq!((first.due, second.repeated), (second.due, false));
    assert!(small == draw(&fixed, 91 * MS).1);
    changing.resize(None).unwrap();
    assert!(draw(&changing, 92 * MS).1 == whole);
    for size in [(0, 5), (5, 0), (16_385, 1)] {
        assert_eq!(changing.resize(Some(size)).unwrap_err().offending_field(), Some("size"));
    }
}

#[test]
fn letterboxed_anchors_keep_their_aspect_ratio() {
    let size = Some((40, 90));
    let stretched = presenter(PresenterOptions { size, ..options() });
    let framed = presenter(PresenterOptions { size, letterbox: true, ..options() });
    let mut area = (0, 0);
    for presenter in [&stretched, &framed] {
        presenter.push(anchor(0, true), None, 0).unwrap();
        presenter.push(anchor(1, false), None, 60 * MS).unwrap();
        area = presenter.anchor_size().unwrap();
    }
    let (_, whole) = draw(&stretched, 90 * MS);
    let (_, bars) = draw(&framed, 90 * MS);
    let height = (40.0 * f64::from(area.1) / f64::from(area.0)).round() as usize;
    let (above, row) = ((90 - height) / 2, 40 * 4);
    let black = |pixels: &[u8]| pixels.as_chunks::<4>().0.iter().all(|pixel| *pixel == [0, 0, 0, 255]);
    let (bars, whole) = (bars.rgba(), whole.rgba());
    assert!(height < 90 && black(&bars[..above * row]) && black(&bars[(above + height) * row..]));
    assert!(!black(&bars[above * row..][..row]) && !black(&bars[(above + height - 1) * row..][..row]));
    assert!(!black(&whole[..row]) && bars != whole);
    // Frames of the anchors' aspect ratio have no bars.
    for presenter in [&stretched, &framed] {
        presenter.resize(Some((2 * area.0, 2 * area.1))).unwrap();
    }
    assert!(draw(&stretched, 92 * MS).1 == draw(&framed, 92 * MS).1);
}

#[test]
fn an_overlay_has_the_size_of_the_anchors() {
    let presenter = presenter(options());
    let of = |size: (u32, u32)| Some((size, vec![1; (size.0 * size.1) as usize]));
    assert_eq!(presenter.set_overlay(Some(((2, 2), vec![1; 3]))).unwrap_err().offending_field(), Some("overlay"));
    presenter.set_overlay(of((3, 5))).unwrap();
    let refused = presenter.push(anchor(0, true), None, 0).unwrap_err();
    assert_eq!(refused.offending_field(), Some("anchor"));
    presenter.set_overlay(None).unwrap();
    presenter.push(anchor(0, true), None, 0).unwrap();
    let size = presenter.anchor_size().unwrap();
    presenter.set_overlay(of(size)).unwrap();
    assert_eq!(presenter.set_overlay(of((3, 5))).unwrap_err().kind(), ErrorKind::InvalidArgument);
    // After a reset another size is allowed.
    presenter.reset();
    presenter.set_overlay(of((3, 5))).unwrap();
}

#[test]
fn fewer_frames_are_made_over_budget() {
    let presenter = presenter(PresenterOptions { multiplier: 4, ..options() });
    assert_eq!(presenter.set_budget(Some(Duration::ZERO)).unwrap_err().offending_field(), Some("budget"));
    presenter.set_budget(Some(Duration::from_millis(2))).unwrap();
    let push = |number: u64| presenter.push(anchor(number, number == 0), None, number * 60 * MS).unwrap();
    (0..2).for_each(|number| assert!(push(number)));
    let shown = |at: u64| {
        if at.is_multiple_of(4) {
            push(at / 4 + 1);
        }
        let (shown, _) = draw(&presenter, 60 * MS + at * 15 * MS);
        (shown.source, shown.t, shown.repeated)
    };
    assert_eq!(shown(1), (FrameSource::Generated, 0.25, false));
    // Two intervals of four frames, each over the budget.
    presenter.record_device_time(8, Duration::from_millis(24));
    let done = presenter.statistics();
    assert_eq!((done.made_to_anchor, done.budget_changes), (2, 1));
    assert_eq!(shown(2), (FrameSource::Generated, 0.5, false));
    assert_eq!(shown(3), (FrameSource::Generated, 0.5, true));
    assert_eq!(shown(4), (FrameSource::Anchor, 0.0, false));
    assert_eq!(shown(5), (FrameSource::Held, 0.0, true));
    let at = presenter.query(60 * MS + 5 * 15 * MS).unwrap();
    assert_eq!((at.due.position, at.source, at.previous), (5, FrameSource::Held, 1));
    assert_eq!(shown(6), (FrameSource::Generated, 0.5, false));
    // Without a budget all frames are made again.
    presenter.set_budget(None).unwrap();
    assert_eq!(shown(7), (FrameSource::Generated, 0.75, false));
    let done = presenter.statistics();
    assert_eq!((done.generated, done.held, done.shown_anchors), (5, 1, 1));
}

#[test]
fn frames_follow_a_rollouts_governor_while_it_exists() {
    let presenter = presenter(PresenterOptions { multiplier: 4, ..options() });
    let governor = |multiplier, frame| Arc::new(world::Governor::with_passes(Some(frame), multiplier, vec![4, 1]));
    let other = governor(2, Duration::from_millis(2));
    assert_eq!(presenter.follow(Some(&other)).unwrap_err().offending_field(), Some("budget.multiplier"));
    let followed = governor(4, Duration::from_micros(2_100));
    presenter.follow(Some(&followed)).unwrap();
    (0..2).for_each(|number| assert!(presenter.push(anchor(number, number == 0), None, number * 60 * MS).unwrap()));
    let shown = |at: u64| {
        let (shown, _) = draw(&presenter, 60 * MS + at * 15 * MS);
        (shown.source, shown.t, shown.repeated)
    };
    assert_eq!(shown(1), (FrameSource::Generated, 0.25, false));
    // A latent takes 4 ms for 4 frames, and each frame takes 4 ms: 5 ms per frame with a budget of 2.1 ms.
    for _ in 0..3 {
        presenter.record_device_time(4, Duration::from_millis(16));
        followed.record_latent(world::LatentTime::undivided(Duration::from_millis(4), 4), None);
    }
    let done = presenter.statistics();
    // Fewer passes do not suffice; one frame instead of four needs 2 ms.
    assert_eq!((done.made_to_anchor, done.budget_changes), (1, 1));
    assert_eq!((followed.statistics().passes, followed.statistics().frames), (4, 12));
    assert_eq!(shown(2).0, FrameSource::Held);
    drop(followed);
    assert_eq!(shown(3), (FrameSource::Generated, 0.75, false));
    let followed = governor(4, Duration::from_millis(2));
    presenter.follow(Some(&followed)).unwrap();
    presenter.set_budget(None).unwrap();
    presenter.record_device_time(4, Duration::from_millis(16));
    assert_eq!(followed.statistics().frames, 0, "it is followed no more");
}
