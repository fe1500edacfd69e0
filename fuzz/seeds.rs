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
