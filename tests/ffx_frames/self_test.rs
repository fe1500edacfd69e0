//! The self-test with every kind of depth, motion and size, and sizes that are rejected without it.

use cairn::ffx::bindings::CreateFrameGeneration;

use super::*;

#[test]
fn the_self_test_detects_errors_with_every_kind_of_depth_motion_and_size() {
    let gpu = gpu();
    let flags = |flags| TextureOptions { head: CreateFrameGeneration { flags, ..options().head }, ..options() };
    let (inverted, infinite) = (CreateFlags::DEPTH_INVERTED, CreateFlags::DEPTH_INFINITE);
    let half = Dimensions { width: SIZE.width / 2, height: SIZE.height / 2 };
    let smaller = TextureOptions::new(SIZE, half, SurfaceFormat::R8G8B8A8_UNORM);
    let smallest = Dimensions { width: 64, height: 64 };
    let smallest = TextureOptions::new(smallest, smallest, SurfaceFormat::R8G8B8A8_UNORM);
    for (tested, plays, why) in [
        (flags(inverted), "plays farthest", "the order of depths is wrong"),
        (flags(inverted | infinite), "plays farthest", "the order of depths is wrong"),
        (flags(infinite), "plays farthest", "the order of depths is wrong"),
        (flags(CreateFlags::MOTION_JITTER), "plays jitter", "jitter that motion holds is added once more"),
        (flags(CreateFlags::DISPLAY_RESOLUTION_MOTION), "plays upside-down", "against vertical motion"),
        (smaller, "plays farthest", "the order of depths is wrong"),
        (smallest, "plays farthest", "the order of depths is wrong"),
        (smallest, "plays upside-down", "against vertical motion"),
    ] {
        let tested = TextureOptions { self_test: true, ..tested };
        let (double, library) = set_up_double(&[]);
        let generator = made(&gpu, &library, &tested).unwrap_or_else(|why| panic!("{tested:?}: {why}"));
        assert!(generator.refused().is_empty());
        drop(generator);
        assert_eq!(double.violations(), [""; 0]);
        let (_, library) = set_up_double(&[plays]);
        let refused = made(&gpu, &library, &tested).expect_err(plays);
        assert!(refused.cause().contains(why), "{plays}: {refused}");
    }
}

/// AMD's libraries crash on smaller pictures, and so does the double.
#[test]
fn pictures_with_a_side_of_less_than_64_pixels_are_refused_before_any_call() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    for (width, height) in [(63, 96), (128, 63), (1, 1)] {
        let size = Dimensions { width, height };
        let small = TextureOptions::new(size, size, SurfaceFormat::R8G8B8A8_UNORM);
        let refused = made(&gpu, &library, &small).expect_err("too small");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("display_size")));
    }
    assert_eq!(double.calls(), [""; 0]);
    assert_eq!(double.violations(), [""; 0]);
}
