//! Presenters that upscale anchors with AMD's upscaler.

use super::*;

/// About three times the anchors' size, but no whole multiple: pixels do not align.
pub(crate) const LARGE: (u32, u32) = (400, 300);

/// A folder with doubles for both effects.
pub(crate) fn with_upscaler(lines: &[&str]) -> DoubleFolder {
    let lines: Vec<_> = ["sdk 2.1", "effect 0x10000", UPSCALER].iter().chain(lines).copied().collect();
    DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]).with(LibraryKind::Upscaler, &lines)
}

impl Stream {
    /// Uses that stage's provider to upscale anchors.
    fn use_upscaler(&mut self, double: &DoubleFolder, is_required: bool) {
        let library = double.load().expect("loaded");
        self.drawer.use_fsr_upscaler(library.api(Effect::Upscaling).expect("there"), Choice::Any, is_required);
    }

    fn scaled_by(&self) -> String {
        match self.drawer.scaled_by() {
            ScaledBy::Nothing => "nothing".to_owned(),
            ScaledBy::Space => "space".to_owned(),
            ScaledBy::Amd(version) => version.name.clone(),
        }
    }

    /// Draws the frame at time `t` after the anchor before the last; returns its source and its maximum error at its size.
    fn error(&mut self, t: f64, own: bool) -> (FrameSource, u8) {
        let (shown, pixels) = self.draw(t, own, true);
        let place = STEP * (i32::try_from(self.anchors).expect("few") - 2) + (f64::from(STEP) * t) as i32;
        let size = self.presenter.size().expect("anchors have come");
        (shown.source, off(&pixels.expect("it has run"), &drawn(size, place)))
    }
}

/// Number of upscaled anchors.
pub(crate) fn upscaled_anchors(double: &DoubleFolder) -> usize {
    double.calls().iter().filter(|call| call.starts_with("dispatch 10001 ")).count()
}

#[test]
fn anchors_are_upscaled_before_frames_are_generated() {
    let double = with_upscaler(&[]);
    let mut stream = Stream::of_size(4, Some(LARGE));
    stream.use_fsr(&double, true).expect("a provider");
    stream.use_upscaler(&double, true);
    stream.push([1, 1]);
    for (pair, tiles) in [[1, 1], [8, 1], [16, 16], [1, 16]].into_iter().enumerate() {
        stream.push(tiles);
        for (quarter, made) in [(0, None), (1, None), (2, version()), (3, None)] {
            let (source, error) = stream.error(quarter as f64 / 4.0, (pair + quarter) % 2 == 0);
            assert_eq!(source, if quarter == 0 { FrameSource::Anchor } else { FrameSource::Generated });
            assert!(error <= 8, "{tiles:?}, {quarter} of 4: {error} off");
            if quarter > 0 {
                assert_eq!(stream.made_by(), made, "{tiles:?}, {quarter} of 4");
            }
        }
        assert_eq!((stream.scaled_by().as_str(), upscaled_anchors(&double)), ("4.0.3", pair + 2), "once to an anchor");
    }
    // Extrapolation starts from the upscaled anchor.
    let (source, error) = stream.error(1.25, true);
    assert!(source == FrameSource::Extrapolated && error <= 8, "{source:?}: {error} off");
    // Another size; no scaling; and a smaller size, which is resized spatially.
    for (size, by) in [((192, 144), "4.0.3"), (SIZE, "nothing"), ((64, 48), "space"), (LARGE, "4.0.3")] {
        stream.presenter.resize(Some(size)).expect("a size");
        stream.push([1, 1]);
        let (_, error) = stream.error(0.5, false);
        assert!(error <= 8, "{size:?}: {error} off");
        assert_eq!((stream.scaled_by().as_str(), stream.made_by()), (by, version()), "{size:?}");
    }
    drop(stream);
    assert_eq!(double.violations(), [""; 0]);
}

/// AMD's upscaler 4.0.2 requires colour, depth, motion and an exposure, whatever it was created for.
#[test]
fn an_upscaler_that_requires_an_exposure_gets_one() {
    let double = with_upscaler(&["requires 0xf"]);
    let mut stream = Stream::of_size(2, Some(LARGE));
    stream.use_upscaler(&double, true);
    (0..2).for_each(|_| stream.push([1, 1]));
    let error = stream.error(0.5, true).1;
    assert!(error <= 8, "{error} off");
    assert_eq!((stream.scaled_by().as_str(), upscaled_anchors(&double)), ("4.0.3", 2));
    drop(stream);
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn upscaled_anchors_use_the_history_of_earlier_ones() {
    let double = with_upscaler(&[]);
    let mut stream = Stream::of_size(2, Some(LARGE));
    stream.use_upscaler(&double, true);
    (0..2).for_each(|_| stream.push([1, 1]));
    assert!(stream.error(0.0, true).1 <= 8, "the first alone");
    assert!(stream.error(0.5, true).1 <= 8);
    assert_eq!(upscaled_anchors(&double), 2);
    // The engine drops its list, and anchors are skipped: the pair's earlier anchor is upscaled first.
    stream.push([8, 8]);
    assert_eq!(stream.draw(0.5, false, false).0.source, FrameSource::Generated);
    assert_eq!(upscaled_anchors(&double), 3);
    (0..3).for_each(|_| stream.push([1, 1]));
    assert!(stream.error(0.5, false).1 <= 8);
    assert_eq!(upscaled_anchors(&double), 5);
    // Frames that show an anchor itself keep the history too.
    stream.push([1, 1]);
    assert!(stream.error(1.0, true).1 <= 8);
    assert_eq!(upscaled_anchors(&double), 6);
    drop(stream);
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn frames_are_resized_spatially_without_an_upscaler() {
    // An upscaler whose creation fails, and one that fails at its third anchor.
    for (lines, right) in [("answers create 3 no", 0), ("breaks 3", 2)] {
        for is_required in [false, true] {
            let double = with_upscaler(&[lines]);
            let mut stream = Stream::of_size(2, Some(LARGE));
            stream.use_fsr(&double, true).expect("a provider");
            stream.use_upscaler(&double, is_required);
            (0..2).for_each(|_| stream.push([1, 1]));
            for pair in 0..3 {
                let now = (stream.anchors - 1) * INTERVAL + INTERVAL / 2;
                let made_larger = right >= pair + 2;
                if is_required && !made_larger {
                    let texture = TextureDesc { size: LARGE, ..TextureDesc::default() }.create(&stream.engine.device);
                    let target = Target { texture, before: REST, after: REST };
                    let prepared = stream.prepare();
                    let made = prepared.and_then(|()| stream.presenter.submit(now, &mut stream.drawer, &target));
                    made.expect_err("nobody else may");
                    assert!(stream.drawer.upscaler_failed().is_none());
                    break;
                }
                let (source, error) = stream.error(0.5, pair % 2 == 0);
                assert!(source == FrameSource::Generated && error <= 8, "{lines}, pair {pair}: {error} off");
                assert_eq!(stream.scaled_by(), if made_larger { "4.0.3" } else { "space" }, "{lines}, pair {pair}");
                assert_eq!(stream.drawer.upscaler_failed().is_none(), made_larger);
                assert_eq!(stream.made_by(), version());
                stream.push([1, 1]);
            }
            drop(stream);
            assert_eq!(double.violations(), [""; 0]);
        }
    }
}

#[test]
fn a_static_overlay_stands_still_in_a_provider_s_frames() {
    for size in [None, Some(LARGE)] {
        let double = with_upscaler(&[]);
        let mut stream = Stream::of_size(2, size);
        stream.use_fsr(&double, true).expect("a provider");
        if size.is_some() {
            stream.use_upscaler(&double, true);
        }
        (0..2).for_each(|_| stream.push([1, 1]));
        let column = |x: u32| (40..56).contains(&x);
        let mask = (0..SIZE.0 * SIZE.1).map(|place| u8::from(column(place % SIZE.0))).collect();
        stream.presenter.set_overlay(Some((SIZE, mask))).expect("a mask");
        let (_, half) = stream.draw(0.5, true, true);
        let (_, anchor) = stream.draw(1.0, true, true);
        assert_eq!(stream.made_by(), version());
        let (width, height) = size.unwrap_or(SIZE);
        let (half, anchor) = (half.expect("it has run"), anchor.expect("it has run"));
        let pixels = half.as_chunks::<4>().0.iter().zip(anchor.as_chunks::<4>().0).zip(0..);
        let (mut over, mut beside) = (0, 0);
        for ((half, anchor), place) in pixels {
            let x = place % width * SIZE.0 / width;
            let off = half.iter().zip(anchor).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
            if column(x) {
                over = over.max(off);
            } else if INNER.contains(&x) && place / width < height {
                beside = beside.max(off);
            }
        }
        assert!(over <= 1 && beside > 30, "{size:?}: {over} under the mask, {beside} beside it");
        drop(stream);
        assert_eq!(double.violations(), [""; 0]);
    }
}

#[test]
fn two_presenters_at_once_have_providers_of_their_own() {
    let double = with_upscaler(&[]);
    let mut streams = [Stream::of_size(2, None), Stream::of_size(2, Some(LARGE))];
    for stream in &mut streams {
        stream.use_fsr(&double, true).expect("a provider");
        stream.use_upscaler(&double, true);
        stream.push([1, 1]);
    }
    for pair in 0..3 {
        for stream in &mut streams {
            stream.push([1, 1]);
        }
        // Both draw at once, each on its own device.
        let errors = std::thread::scope(|scope| {
            let drawn = streams.each_mut().map(|stream| scope.spawn(move || stream.error(0.5, pair % 2 == 0).1));
            drawn.map(|drawn| drawn.join().expect("no panic"))
        });
        assert!(errors.iter().all(|error| *error <= 8), "pair {pair}: {errors:?}");
        assert!(streams.iter().all(|stream| stream.made_by() == version()));
    }
    drop(streams);
    assert_eq!(double.violations(), [""; 0]);
}
