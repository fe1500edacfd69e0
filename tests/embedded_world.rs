//! The embedded world: it equals the file in the repository, needs no file beside the library, and follows its controls.
#![cfg(feature = "embedded-world")]

use cairn::Picture;
use cairn::bundle::{Bundle, OpenOptions};
use cairn::world::{ControlInput, KeySet, Rollout, World, WorldOptions};
use test_support::worlds::{desert_picture, device, point};

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/worlds/miniature.cairn");

#[test]
fn the_embedded_world_equals_the_file_in_the_repository() {
    let embedded = Bundle::embedded(&OpenOptions::default()).expect("it is inside");
    assert_eq!(embedded.digest(), Bundle::open(FILE.as_ref()).expect("the file").digest());
    let size = std::fs::metadata(FILE).expect("the file").len();
    assert!(size <= 40 << 20, "{size} bytes are too many for a library");
    let manifest = embedded.manifest();
    assert_eq!((manifest.name.as_str(), manifest.licence.spdx.as_str()), ("Miniature", "MIT OR Apache-2.0"));
    assert_eq!((manifest.picture.render, embedded.geometry().global.window), ([320, 180], 128));
}

/// By how much blue exceeds red on average: positive for sky.
fn sky(picture: &Picture) -> f64 {
    picture.pixels().iter().map(|px| f64::from(px[2]) - f64::from(px[0])).sum::<f64>() / picture.pixels().len() as f64
}

#[test]
fn the_scene_is_stable_and_follows_the_controls() {
    let bundle = Bundle::embedded(&OpenOptions::default()).expect("it is inside");
    let world = World::load(&device(), &bundle, WorldOptions::default()).expect("a world");
    let seed = desert_picture();
    let look = |counts: f32| {
        let controls = ControlInput::new([0.0, counts], KeySet::default(), 0.0).expect("controls");
        let mut rollout = Rollout::new(&world, &point(&world), 1).expect("a rollout");
        rollout.append(&seed).expect("a seed");
        for _ in 0..8 {
            rollout.step(&controls).expect("a step");
        }
        let mut picture = seed.clone();
        rollout.read_picture(0, &mut picture).expect("a picture");
        picture
    };
    let [up, still, down] = [-20.0, 0.0, 20.0].map(look);
    let apart = seed.pixels().iter().zip(still.pixels()).flat_map(|(a, b)| (0..3).map(|c| a[c].abs_diff(b[c])));
    let apart = apart.map(f64::from).sum::<f64>() / (3.0 * seed.pixels().len() as f64);
    assert!(apart < 20.0, "without controls the scene is the same: {apart}");
    let [up, still, down] = [&up, &still, &down].map(sky);
    assert!(up > still + 5.0 && still > down + 5.0, "looking up shows more of the sky: {up} {still} {down}");
}
