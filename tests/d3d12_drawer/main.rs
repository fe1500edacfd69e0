//! A presenter's frames from the device, compared with those from the processor. On Windows, or in the lab.
#![cfg(windows)]

use std::sync::Arc;

use cairn::Picture;
use cairn::bundle::Precision;
use cairn::gpu::Target;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::guidance::{DepthMap, Guidance, MotionField, MotionOrigin, paper};
use cairn::present::presenter::{FrameSource, PresenterOptions, extract};
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{GuidanceSource, KeptAnchor, World, WorldOptions};
use gpu_testing::high_dynamic_range;
use gpu_testing::presenters::{
    INTERVAL, KINDS, PRESENT, PresenterPair, constant_motion, count_differences, device_of, moving, options, record,
};
use half::f16;
use test_support::d3d12::engine::{self, Engine};
use test_support::d3d12::textures::{self, Recording, TextureDesc};
use test_support::worlds;

mod late;
mod waits;

#[test]
fn frames_of_a_rollout_equal_the_processors() {
    let engine = Engine::create();
    let gpu = device_of(&engine, &engine.direct);
    let options_of_device = DirectMlOptions { deterministic: true, ..Default::default() };
    let device = Device::directml(&worlds::ort(), &gpu, options_of_device).expect("DirectML");
    let precision = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
    let world = World::load(&device, &worlds::bundle("tiny"), precision).expect("a world");
    let mut rollout = worlds::seeded(&world, &worlds::point(&world), 7);
    let anchors: Vec<_> = (0..3)
        .map(|i| {
            rollout.step(&worlds::controls(i)).expect("a step");
            Arc::new(KeptAnchor::of(&mut rollout, false).expect("an anchor"))
        })
        .collect();
    let size = anchors[0].size();
    let bytes_read = || rollout.statistics().bytes.read;
    // Motion that the device computes from latents, and motion that came with the anchors.
    let given: Vec<_> = anchors
        .windows(2)
        .map(|pair| Arc::new(extract(GuidanceSource::PictureFlow, &pair[0], &pair[1]).expect("guidance")))
        .collect();
    for is_given in [false, true] {
        let mut both =
            PresenterPair::of_latents(&gpu, size, &options(GuidanceSource::Paper), anchors[0].latent_shape());
        both.push(&anchors[0], None, 0);
        for (frame, kind) in (0..12).zip(KINDS.iter().cycle()) {
            let now = INTERVAL + frame * INTERVAL / 4;
            let next = 1 + frame as usize / 4;
            if let Some(anchor) = anchors.get(next).filter(|_| frame % 4 == 0) {
                both.push(anchor, is_given.then_some(&given[next - 1]), now);
            }
            let before = bytes_read();
            let shown = both.compare_after(&engine, now, *kind, frame % 2 == 1, || {
                let read = bytes_read() - before;
                assert_eq!(read, 0, "bytes that were read back for a frame");
            });
            // The shown content is one interval old, interpolated at this time's phase; the frame is due now.
            let content =
                (shown.previous - anchors[0].number()) * INTERVAL + (f64::from(shown.t) * INTERVAL as f64) as u64;
            assert_eq!((content, shown.due.since_ns), (now - INTERVAL, now), "an interval of latency: {shown:?}");
            let source = match frame % 4 {
                0 => FrameSource::Anchor,
                _ if frame > 8 => FrameSource::Extrapolated,
                _ => FrameSource::Generated,
            };
            assert_eq!(shown.source, source, "{shown:?}");
        }
        both.check();
    }
}

#[test]
fn optical_flow_runs_on_the_device() {
    let engine = Engine::create();
    let gpu = device_of(&engine, &engine.direct);
    let size = (96, 64);
    let mut both = PresenterPair::new(&gpu, size, &options(GuidanceSource::PictureFlow));
    for number in 0..4 {
        let anchor = Arc::new(KeptAnchor::of_picture(moving(size, number, 2 + number), number, false));
        both.push(&anchor, None, number * INTERVAL);
        for quarter in 0..if number > 0 { 4 } else { 0 } {
            let now = number * INTERVAL + quarter * INTERVAL / 4;
            both.compare(&engine, now, KINDS[quarter as usize], false);
        }
    }
    both.check();
}

#[test]
fn an_engines_motion_is_used_and_detected_cuts_are_counted() {
    let engine = Engine::create();
    let gpu = device_of(&engine, &engine.direct);
    let size = (75, 46);
    let mut both = PresenterPair::new(&gpu, size, &options(GuidanceSource::PictureFlow));
    for number in 0..5 {
        let anchor = Arc::new(KeptAnchor::of_picture(moving(size, number, 3), number, false));
        // Tiled and per-pixel motion in turn, so that textures change.
        let mut motion = MotionField::tiled(size.0, size.1, if number % 2 == 0 { 8 } else { 1 }).expect("a field");
        motion.vectors_mut().fill([f16::from_f32(3.0), f16::ZERO]);
        let mut depth = DepthMap::new(size.0, size.1, paper::PROJECTION).expect("a depth map");
        depth.fill(0.5);
        let guidance = Arc::new(Guidance::from_parts(motion, depth, MotionOrigin::OpticalFlow).expect("guidance"));
        both.push(&anchor, (number > 0).then_some(&guidance), number * INTERVAL);
        for quarter in 0..if number > 0 { 4 } else { 0 } {
            let now = number * INTERVAL + quarter * INTERVAL / 4;
            let shown = both.compare(&engine, now, KINDS[(number + quarter) as usize % KINDS.len()], quarter == 2);
            assert_eq!((shown.previous, shown.repeated), (number - 1, false), "{shown:?}");
        }
    }
    // The same frame again, in the same format and in another.
    let again = 4 * INTERVAL + INTERVAL * 3 / 4;
    for (kind, own) in [(KINDS[0], false), (KINDS[0], true), (KINDS[3], false)] {
        assert!(both.compare(&engine, again, kind, own).repeated);
    }
    both.check();

    // This picture has nothing in common with the one before it, but is not marked as a cut: only the generator detects it.
    let mut other = worlds::picture(size.0, size.1, 3);
    other.pixels_mut().reverse();
    both.push(&Arc::new(KeptAnchor::of_picture(other, 5, false)), None, 5 * INTERVAL);
    let before = both.device.statistics();
    let texture = TextureDesc { size, ..TextureDesc::default() }.create(&engine.device);
    let target = Target { texture: texture.clone(), before: PRESENT, after: PRESENT };
    let now = 5 * INTERVAL + INTERVAL / 2;
    let (shown, fence_point) =
        both.device.submit(now, &mut both.drawer, &target).expect("it is made").made().expect("a frame");
    assert_eq!(shown.source, FrameSource::Generated, "the cut is not detected yet");
    fence_point.wait().expect("it has run");
    both.device.collect_reports(&mut both.drawer);
    let after = both.device.statistics();
    let counts = (after.generated - before.generated, after.held - before.held, after.cuts - before.cuts);
    assert_eq!(counts, (0, 1, 1), "a copied anchor does not count as generated");
    let mut expected = None;
    let times = [both.drawer.gpu_time(), both.drawer.gpu_time_of_anchors()];
    // All frames; and one list for each of the six pictures and the five motion fields uploaded, and for each pair of frames.
    assert_eq!(times.map(|spent| spent.count), [20, 16], "each has its time: {times:?}");
    assert!(times.iter().all(|spent| !spent.total.is_zero() && spent.longest <= spent.total), "{times:?}");
    assert_eq!(both.drawer.in_flight(), 0);
    let shown = both.host.draw(now, size, |picture| expected = Some(picture.clone())).expect("drawn").expect("a frame");
    assert_eq!((shown.source, shown.cut), (FrameSource::Held, true), "the processor finds it as well");
    let held = textures::read(&engine.device, &engine.direct, &texture, PRESENT);
    assert!(held == expected.expect("a picture").rgba(), "and shows the same anchor");
}

#[test]
fn frames_of_another_size_and_shape_are_scaled_on_the_device() {
    let engine = Engine::create();
    let gpu = device_of(&engine, &engine.direct);
    let size = (96, 64);
    for letterbox in [false, true] {
        let first = Some((150, 100));
        let wanted = PresenterOptions { size: first, letterbox, ..options(GuidanceSource::PictureFlow) };
        let mut both = PresenterPair::new(&gpu, size, &wanted);
        for number in 0..2 {
            let anchor = Arc::new(KeptAnchor::of_picture(moving(size, number, 3), number, false));
            both.push(&anchor, (number > 0).then_some(&constant_motion(size, 3.0)), number * INTERVAL);
        }
        // Larger, smaller, other aspect ratios, down to a pixel, and the anchors' own size.
        let sizes = [(97, 33), (31, 64), (1, 1), (250, 40), (96, 64), (20, 200), (192, 128)].map(Some);
        for (i, to) in (0..).zip([first].into_iter().chain(sizes).chain([None, first])) {
            both.resize(to);
            let (now, kind) = (INTERVAL + i % 4 * INTERVAL / 4, KINDS[i as usize % KINDS.len()]);
            let shown = both.compare(&engine, now, kind, i % 2 == 1);
            assert_eq!((shown.previous, shown.repeated), (0, false), "{to:?}: {shown:?}");
            // The same frame again, in the same format and in another.
            assert!(both.compare(&engine, now, kind, false).repeated);
            assert!(both.compare(&engine, now, KINDS[(i as usize + 1) % KINDS.len()], true).repeated);
        }
        both.check();
    }
}

#[test]
fn frames_have_the_colours_of_targets_beyond_white() {
    high_dynamic_range::compare(&Engine::create());
}

#[test]
fn pixels_in_the_overlay_mask_are_static() {
    const COLOUR: [u8; 4] = [255, 0, 255, 255];
    let engine = Engine::create();
    let gpu = device_of(&engine, &engine.direct);
    let size = (95, 70);
    let is_overlay = |i: usize| (30..57).contains(&(i % 95)) && (20..31).contains(&(i / 95));
    let ground = |x: usize, y: usize| {
        [((x * 37 + y * 101) % 200) as u8, ((x * 59 + y * 23) % 120 + 80) as u8, ((x * y + x) % 180) as u8, 255]
    };
    let mut both = PresenterPair::new(&gpu, size, &options(GuidanceSource::PictureFlow));
    for number in 0..2 {
        let mut picture = Picture::new(size.0, size.1).expect("a picture");
        for (i, pixel) in picture.pixels_mut().iter_mut().enumerate() {
            *pixel = if is_overlay(i) { COLOUR } else { ground(i % 95 + 12 - 12 * number, i / 95) };
        }
        let guidance = (number > 0).then(|| constant_motion(size, -12.0));
        let anchor = Arc::new(KeptAnchor::of_picture(picture, number as u64, false));
        both.push(&anchor, guidance.as_ref(), number as u64 * INTERVAL);
    }
    let count = (size.0 * size.1) as usize;
    let mask_of =
        |over: &dyn Fn(usize) -> bool| Some((size, (0..count).map(|i| u8::from(over(i))).collect::<Vec<_>>()));
    // The frame at a time from each generator, with this overlay mask.
    let mut frames_at = |now: u64, overlay: Option<((u32, u32), Vec<u8>)>| {
        for presenter in [&both.host, &both.device] {
            presenter.set_overlay(overlay.clone()).expect("an overlay");
        }
        let texture = TextureDesc { size, ..TextureDesc::default() }.create(&engine.device);
        let target = Target { texture: texture.clone(), before: PRESENT, after: PRESENT };
        let (_, fence_point) =
            both.device.submit(now, &mut both.drawer, &target).expect("it is made").made().expect("a frame");
        fence_point.wait().expect("it is there");
        let of_device = textures::read(&engine.device, &engine.direct, &texture, PRESENT);
        let mut of_host = Vec::new();
        both.host.draw(now, size, |picture| of_host.extend_from_slice(picture.rgba())).expect("it is drawn");
        [("shader", of_device), ("cpu", of_host)]
    };
    for (generator, found) in frames_at(INTERVAL * 5 / 4, mask_of(&is_overlay)) {
        for (i, pixel) in found.as_chunks::<4>().0.iter().enumerate() {
            let expected = if is_overlay(i) { COLOUR } else { ground(i % 95 + 9, i / 95) };
            assert_eq!(*pixel, expected, "{generator}: pixel {i}");
        }
    }
    // With everything masked as static, nothing moves; without a mask the ground moves again.
    let still = frames_at(INTERVAL * 3 / 2, mask_of(&|_| true));
    let again = frames_at(INTERVAL * 7 / 4, None);
    let moved = |pixels: &[u8], shift: usize| {
        let pairs = pixels.as_chunks::<4>().0.iter().enumerate();
        pairs.filter(|(i, pixel)| !is_overlay(*i) && **pixel == ground(i % 95 + 12 - shift, i / 95)).count()
    };
    let ground_pixels = (0..count).filter(|i| !is_overlay(*i)).count();
    for ((generator, still), (_, again)) in still.iter().zip(&again) {
        let counts = [moved(still, 6), moved(again, 9)];
        assert!(
            counts[0] * 2 < ground_pixels && counts[1] * 10 > 9 * ground_pixels,
            "{generator}: {counts:?} of {ground_pixels}"
        );
    }
    // In extrapolated frames the colours cannot show what is static, as there is no other picture: only the mask does.
    for (generator, found) in frames_at(INTERVAL * 9 / 4, mask_of(&is_overlay)) {
        let pixels = found.as_chunks::<4>().0.iter().enumerate();
        let wrong = pixels.filter(|(i, pixel)| is_overlay(*i) != (**pixel == COLOUR)).count();
        assert_eq!(wrong, 0, "{generator}: beyond the last anchor");
    }
}

#[test]
fn a_dropped_list_leaves_no_frame_that_is_copied_later() {
    let engine = Engine::create();
    let gpu = device_of(&engine, &engine.direct);
    let size = (75, 46);
    // At the generator's own size, and scaled.
    for frames in [None, Some((150, 92))] {
        let mut both = PresenterPair::new(&gpu, size, &options(GuidanceSource::PictureFlow));
        for number in 0..2 {
            let anchor = Arc::new(KeptAnchor::of_picture(moving(size, number, 3), number, false));
            both.push(&anchor, (number > 0).then(|| constant_motion(size, 3.0)).as_ref(), number * INTERVAL);
        }
        both.resize(frames);
        let wanted = both.host.size().expect("a size");
        for (quarter, drops) in [(0, 1), (1, 1), (2, 3)] {
            let now = INTERVAL + quarter * INTERVAL / 4;
            for _ in 0..drops {
                let texture = TextureDesc { size: wanted, ..TextureDesc::default() }.create(&engine.device);
                let target = Target { texture, before: PRESENT, after: PRESENT };
                let dropped = Recording::on(&engine.device, &engine.direct);
                let shown = record(&both.device, now, &mut both.drawer, &dropped, &target).made();
                dropped.drop_list();
                let of_host = both.host.draw(now, wanted, |_| ()).expect("it is drawn");
                assert_eq!(shown, of_host);
            }
            assert!(both.compare(&engine, now, KINDS[0], false).repeated);
            // This time the list runs.
            assert!(both.compare(&engine, now, KINDS[0], quarter == 1).repeated);
            both.check();
        }
        assert_eq!(both.device.statistics().cuts, 0, "a list that never ran reports no cut");
    }
}
