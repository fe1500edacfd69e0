//! Unfinished work: lists that are submitted late, and anchors that the device has not finished.

use super::*;
use cairn::world::GuidanceSource;

/// Records frames of three pairs of anchors in lists that an engine holds back until all are recorded, and then submits in the given
/// `order`. Returns the number of wrong pixels of each frame.
fn wrong_pixels(order: impl Fn(&mut Vec<usize>)) -> Vec<usize> {
    let engine = Engine::create();
    let gpu = device_of(&engine, &engine.direct);
    let size = (96, 64);
    let mut both = PresenterPair::new(&gpu, size, &options(GuidanceSource::PictureFlow));
    let mut held = Vec::new();
    for number in 0..4 {
        let anchor = Arc::new(KeptAnchor::of_picture(moving(size, number, 2 + 3 * number), number, false));
        both.push(&anchor, None, number * INTERVAL);
        if number == 0 {
            continue;
        }
        let now = number * INTERVAL + INTERVAL / 4;
        let texture = TextureDesc { size, ..TextureDesc::default() }.create(&engine.device);
        let target = Target { texture: texture.clone(), before: PRESENT, after: PRESENT };
        let recording = Recording::on(&engine.device, &engine.direct);
        let made = record(&both.device, now, &mut both.drawer, &recording, &target);
        assert!(made.made().is_some());
        textures::wait(&engine.device, &engine.direct);
        let mut expected = None;
        both.host.draw(now, size, |picture| expected = Some(picture.clone())).expect("it is drawn");
        held.push((recording, texture, expected.expect("a picture")));
    }
    let mut places: Vec<usize> = (0..held.len()).collect();
    order(&mut places);
    places.iter().for_each(|place| held[*place].0.submit(&engine.direct));
    textures::wait(&engine.device, &engine.direct);
    let read = |texture| textures::read(&engine.device, &engine.direct, texture, PRESENT);
    held.iter()
        .map(|(_, texture, expected)| count_differences(&read(texture), expected, DXGI_FORMAT_R8G8B8A8_UNORM))
        .collect()
}

#[test]
fn lists_that_an_engine_submits_late_show_the_recorded_frames() {
    for (name, is_reversed) in [("in order", false), ("the last first", true)] {
        let wrong = wrong_pixels(|places| {
            if is_reversed {
                places.reverse()
            }
        });
        assert!(wrong.iter().all(|count| count * 1000 <= 96 * 64), "{name}: {wrong:?} pixels of each are wrong");
    }
}

/// A fence that holds back a queue, at most until the test ends.
struct Gate(ID3D12Fence);

impl Gate {
    fn open(&self) {
        // SAFETY: a live fence.
        unsafe { self.0.Signal(1) }.expect("a signal");
    }
}

/// Signals the gate if an assertion fails, before the presenters are dropped: they wait for the queue that the gate holds back.
struct OpensOnFailure<'a>(&'a Gate);

impl Drop for OpensOnFailure<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.open();
        }
    }
}

impl Drop for Gate {
    fn drop(&mut self) {
        self.open();
    }
}

#[test]
fn an_unfinished_anchor_is_late_and_no_queue_waits_for_it() {
    let engine = Engine::create();
    let gpu = device_of(&engine, &engine.direct);
    waits::count(&engine.direct);
    let options_of_device = DirectMlOptions { deterministic: true, ..Default::default() };
    let device = Device::directml(&worlds::ort(), &gpu, options_of_device).expect("DirectML");
    let precision = WorldOptions { precision: Some(Precision::F16), ..WorldOptions::default() };
    let world = World::load(&device, &worlds::bundle("tiny"), precision).expect("a world");
    let mut rollout = worlds::seeded(&world, &worlds::point(&world), 7);
    let gate = Gate(engine::fence(&engine.device));
    // The last anchor's copy is held back.
    let anchors: Vec<_> = (0..3)
        .map(|i| {
            rollout.step(&worlds::controls(i)).expect("a step");
            if i == 2 {
                // SAFETY: a live queue and fence.
                unsafe { gpu.anchors().d3d12().Wait(&gate.0, 1) }.expect("it takes a wait");
            }
            Arc::new(KeptAnchor::of(&mut rollout, false).expect("an anchor"))
        })
        .collect();
    assert_eq!([0, 1, 2].map(|i: usize| anchors[i].is_complete() || i < 2), [true, true, false]);
    while !anchors[..2].iter().all(|anchor| anchor.is_complete()) {
        std::thread::yield_now();
    }
    let latent = anchors[0].latent_shape();
    for motion in [GuidanceSource::PictureFlow, GuidanceSource::Paper] {
        let mut both = PresenterPair::of_latents(&gpu, anchors[0].size(), &options(motion), latent);
        let _opens = OpensOnFailure(&gate);
        (0..2).for_each(|i| both.push(&anchors[i], None, i as u64 * INTERVAL));
        for quarter in 4..12 {
            if quarter == 8 {
                // An anchor whose copy is not done is not counted, on the processor's side either.
                both.push(&anchors[2], None, 2 * INTERVAL);
                for presenter in [&both.host, &both.device] {
                    assert_eq!((presenter.statistics().anchors, presenter.arriving()), (2, 1));
                }
            }
            // Each frame is compared as soon as the queue has made it: it waits for nothing.
            let shown = both.compare(&engine, quarter * INTERVAL / 4, KINDS[0], quarter % 2 == 0);
            let source = match quarter {
                4 | 8 => FrameSource::Anchor,
                5..8 => FrameSource::Generated,
                _ => FrameSource::Extrapolated,
            };
            assert_eq!(shown.source, source, "{shown:?}");
        }
        both.check();
        assert_eq!(waits::counted(), 0, "the engine's queue waits for nothing");
        if motion == GuidanceSource::Paper {
            // The anchor arrives, is due when the presenter notices it, and is shown then.
            gate.open();
            while !anchors[2].is_complete() {
                std::thread::yield_now();
            }
            let shown = both.compare(&engine, 13 * INTERVAL / 4, KINDS[0], false);
            assert_eq!((shown.source, shown.previous), (FrameSource::Anchor, anchors[2].number()), "{shown:?}");
            assert_eq!((both.device.statistics().late, both.device.arriving()), (1, 0));
        }
    }
    assert_eq!(waits::counted(), 0);
    // A wait of this queue is counted.
    // SAFETY: a live queue and fence.
    unsafe { engine.direct.Wait(&gate.0, 1) }.expect("it takes a wait");
    assert_eq!(waits::counted(), 1);
    textures::wait(&engine.device, &engine.direct);
}
