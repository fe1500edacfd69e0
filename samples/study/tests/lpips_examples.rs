//! LPIPS of the example pictures of its own repository (PerceptualSimilarity): `ex_ref.png`, `ex_p0.png` and `ex_p1.png`
//! of its folder `imgs`.
//!
//! They are not ours to pass on: the tests are skipped, by name, where the environment variable `CAIRN_LPIPS_EXAMPLES` names
//! no folder that has them:
//!
//! ```text
//! CAIRN_LPIPS_EXAMPLES=PerceptualSimilarity/imgs cargo test -p study --test lpips_examples
//! ```

mod common;

use std::path::{Path, PathBuf};

use cairn::Picture;
use common::weights::lpips;
use libtest_mimic::{Arguments, Completion, Failed, Trial};
use study::metrics::Net;

/// The network, and the distances of the two distorted pictures from the reference.
const GOLDEN: [(Net, [f64; 2]); 2] = [(Net::Alex, [0.72188, 0.13757]), (Net::Vgg, [0.56861, 0.42166])];

/// Where the pictures are.
const VARIABLE: &str = "CAIRN_LPIPS_EXAMPLES";

fn main() {
    let trial = |(net, golden)| {
        Trial::ignorable_test(format!("lpips_with_{net}_of_its_own_examples"), move || {
            match std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty()) {
                Some(folder) => check(&PathBuf::from(folder), net, golden).map(|()| Completion::Completed),
                None => Ok(Completion::ignored_with(format!("needs lpips-examples: {VARIABLE} names no folder"))),
            }
        })
    };
    libtest_mimic::run(&Arguments::from_args(), GOLDEN.into_iter().map(trial).collect()).exit();
}

fn check(folder: &Path, net: Net, golden: [f64; 2]) -> Result<(), Failed> {
    let read = |name: &str| -> Result<Picture, Failed> {
        let path = folder.join(name);
        let image = image::open(&path).map_err(|e| format!("{}: {e}", path.display()))?.into_rgba8();
        Ok(Picture::from_rgba(image.width(), image.height(), image.into_raw())?)
    };
    let reference = read("ex_ref.png")?;
    for (name, golden) in ["ex_p0.png", "ex_p1.png"].into_iter().zip(golden) {
        let found = lpips(net).compare(&reference, &read(name)?)?;
        println!("{net}, {name}: {found:.6}");
        if (found - golden).abs() > 1e-4 {
            return Err(format!("{name}: {found}, published {golden}").into());
        }
    }
    Ok(())
}
