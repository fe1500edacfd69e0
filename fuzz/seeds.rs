//! Writes the seed inputs of all fuzz targets to `corpus/<target>/`.

use std::path::Path;

use study::fuzz_targets::seeds as study;
use test_support::fuzz_targets::seeds;

fn main() -> std::io::Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    for (target, contents) in [
        ("manifest", seeds::manifest()),
        ("onnx", seeds::onnx()),
        ("control_script", seeds::control_script()),
        ("calls", calls()),
        ("y4m", study::y4m()),
        ("seed_picture", study::seed_picture()),
        ("lpips_weights", study::lpips_weights()),
        ("saved_state", seeds::saved_state()),
    ] {
        let folder = corpus.join(target);
        std::fs::create_dir_all(&folder)?;
        for (i, seed) in contents.iter().enumerate() {
            std::fs::write(folder.join(format!("seed-{i}")), seed)?;
        }
        println!("{} seeds in {}", contents.len(), folder.display());
    }
    Ok(())
}

/// Random call sequences: each byte selects one of the possible choices.
fn calls() -> Vec<Vec<u8>> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut byte = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 56) as u8
    };
    [64, 256, 1024].map(|length| (0..length).map(|_| byte()).collect()).to_vec()
}
