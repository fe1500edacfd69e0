use super::*;

const MS: u64 = 1_000_000;

fn pacer(multiplier: u32, delay_ns: u64, catch_up: bool) -> Pacer {
    let pacing = Pacing { multiplier, delay_ns, catch_up };
    Pacer::new(Interval::of_ns(60 * MS).unwrap(), pacing).unwrap()
}

fn frame(pacer: &mut Pacer, now: u64) -> DueFrame {
    pacer.due(now).unwrap().frame
}

#[test]
fn steady_anchors_give_a_steady_stream() {
    for multiplier in [1, 2, 3, 4, 6] {
        let mut pacer = pacer(multiplier, 60 * MS, false);
        assert_eq!(pacer.due(0), None);
        let step = 60 * MS / u64::from(multiplier);
        let end = if cfg!(miri) { 1_300 } else { 5_000 };
        for now in (1_000 * MS..end * MS).step_by(MS as usize) {
            if (now - 1_000 * MS).is_multiple_of(60 * MS) {
                pacer.push(now);
            }
            let position = (now.saturating_sub(1_060 * MS)) / step;
            let due = pacer.due(now).unwrap();
            assert_eq!(due.position, position);
            assert_eq!(
                (due.since_ns, due.until_ns),
                (1_060 * MS + position * step, 1_060 * MS + (position + 1) * step)
            );
            let (anchor, part) = (position / u64::from(multiplier), (position % u64::from(multiplier)) as u32);
            let expected = match part {
                0 => DueFrame::Anchor(anchor),
                step => DueFrame::Interpolate { previous: anchor, step },
            };
            assert_eq!(due.frame, expected, "{now}");
        }
        assert_eq!((pacer.late(), pacer.slipped_ns()), (0, 0));
    }
}

#[test]
fn a_late_anchor_is_extrapolated_then_held_and_due_on_arrival() {
    let mut pacer = pacer(2, 60 * MS, false);
    pacer.push(0);
    pacer.push(60 * MS);
    assert_eq!(frame(&mut pacer, 119 * MS), DueFrame::Interpolate { previous: 0, step: 1 });
    assert_eq!(frame(&mut pacer, 120 * MS), DueFrame::Anchor(1));
    assert_eq!(frame(&mut pacer, 150 * MS), DueFrame::Extrapolate { last: 1, step: 1 });
    assert_eq!(frame(&mut pacer, 180 * MS), DueFrame::Extrapolate { last: 1, step: 2 });
    assert_eq!(frame(&mut pacer, 210 * MS), DueFrame::Stalled { last: 1 });
    pacer.push(300 * MS);
    assert_eq!((pacer.late(), pacer.slipped_ns()), (1, 120 * MS));
    assert_eq!(frame(&mut pacer, 300 * MS), DueFrame::Anchor(2));
    assert_eq!(pacer.due(300 * MS).unwrap().until_ns, 330 * MS);
}

#[test]
fn an_anchor_within_its_delay_changes_nothing() {
    let mut pacer = pacer(2, 60 * MS, false);
    pacer.push(0);
    pacer.push(120 * MS);
    assert_eq!((pacer.late(), pacer.slipped_ns()), (0, 0));
    assert_eq!(frame(&mut pacer, 120 * MS), DueFrame::Anchor(1));
}

#[test]
fn delay_after_a_stall_is_caught_up_step_by_step() {
    for catch_up in [false, true] {
        let mut pacer = pacer(2, 60 * MS, catch_up);
        pacer.push(0);
        pacer.push(180 * MS);
        assert_eq!(pacer.slipped_ns(), 60 * MS);
        // From here on anchors arrive on schedule.
        for i in 2..40 {
            pacer.push(i * 60 * MS);
        }
        let due = pacer.due(39 * 60 * MS).unwrap();
        let behind = if catch_up { 60 * MS } else { 120 * MS };
        assert_eq!(due.position, (39 * 60 * MS - behind) / (30 * MS));
    }
}

#[test]
fn intervals_of_fractional_nanoseconds_do_not_drift() {
    let pacing = Pacing { multiplier: 3, delay_ns: 0, catch_up: false };
    let mut pacer = Pacer::new(Interval::per_second(15).unwrap(), pacing).unwrap();
    // An hour; under Miri, which is slow, a minute.
    let (seconds, positions) = if cfg!(miri) { (60, 200) } else { (3_600, 10_000) };
    for _ in 0..15 * seconds + 1 {
        pacer.push(0);
    }
    let end = seconds * SECOND;
    assert_eq!(pacer.due(end - 1).unwrap().position, 45 * seconds - 1);
    let due = pacer.due(end).unwrap();
    assert_eq!((due.position, due.since_ns), (45 * seconds, end));
    for position in 0..positions {
        let start = pacer.interval.start(position, 7);
        assert_eq!(pacer.interval.position(start, 7), position);
        assert_eq!(pacer.interval.position(start - 1, 7), position.saturating_sub(1));
    }
}

#[test]
fn jumping_clocks_are_tolerated() {
    let mut pacer = pacer(6, 0, true);
    pacer.push(u64::MAX - 5);
    assert!(pacer.due(0).is_some());
    assert_eq!(pacer.due(u64::MAX).unwrap().until_ns, u64::MAX);
    pacer.push(3);
    assert_eq!(pacer.waiting(u64::MAX), 1);
    pacer.reset();
    assert_eq!(pacer.due(u64::MAX), None);
    let mut pacer = self::pacer(2, 0, false);
    pacer.push(0);
    assert!(matches!(pacer.due(u64::MAX).unwrap().frame, DueFrame::Stalled { last: 0 }));
    pacer.push(u64::MAX);
    assert_eq!(frame(&mut pacer, u64::MAX), DueFrame::Anchor(1));
}

#[test]
fn invalid_pacing_is_refused() {
    assert!(Interval::per_second(0).is_err());
    assert!(Interval::of_ns(0).is_err() && Interval::of_ns(MAX_INTERVAL_NS + 1).is_err());
    let interval = Interval::of_ns(1).unwrap();
    for (multiplier, delay_ns) in [(0, 0), (65, 0), (2, MAX_INTERVAL_NS + 1)] {
        assert!(Pacer::new(interval, Pacing { multiplier, delay_ns, catch_up: false }).is_err());
    }
}
