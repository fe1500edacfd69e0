//! Writes the starting points of all targets to `corpus/<target>/`.

use std::path::Path;

#[allow(dead_code, reason = "the bodies are for the targets")]
mod bodies;
#[path = "../tests/support/mod.rs"]
mod support;

fn main() -> std::io::Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    for (target, seeds) in [
        ("manifest", bodies::seeds::manifest()),
        ("onnx", bodies::seeds::onnx()),
        ("control_script", bodies::seeds::control_script()),
        ("calls", calls()),
    ] {
        let folder = corpus.join(target);
        std::fs::create_dir_all(&folder)?;
        for (i, seed) in seeds.iter().enumerate() {
            std::fs::write(folder.join(format!("seed-{i}")), seed)?;
        }
        println!("{} seeds in {}", seeds.len(), folder.display());
    }
    Ok(())
}

/// Sequences of calls: bytes without a meaning of their own, each is some choice.
fn calls() -> Vec<Vec<u8>> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut byte = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 56) as u8
    };
    [64, 256, 1024].map(|length| (0..length).map(|_| byte()).collect()).to_vec()
}
