//! First steps with Cairn: loads a world, appends a seed picture, and makes one second of latents.
//! `cargo run --release --example first_light`.

use cairn::bundle::{Bundle, OpenOptions};
use cairn::runtime::{CpuOptions, Device, Ort};
use cairn::world::{ControlInput, Preset, Rollout, World, WorldOptions};
use cairn::{LibrarySearch, Picture, Result};

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let console = provision::Console::new();
    provision::onnxruntime(&console)?;
    Ok(first_light()?)
}

// README.md shows what follows.
fn first_light() -> Result<()> {
    let device = Device::cpu(&Ort::find(&LibrarySearch::for_tools())?, CpuOptions::default())?;
    let world = World::load(&device, &Bundle::embedded(&OpenOptions::default())?, WorldOptions::default())?;
    let mut rollout = Rollout::new(&world, &Preset::Stock.operating_point(), 1)?;
    let mut picture = Picture::from_rgba(640, 360, vec![128; 640 * 360 * 4])?;
    rollout.append(&picture)?;
    for _ in 0..15 {
        rollout.step(&ControlInput::default())?;
        rollout.read_picture(3, &mut picture)?;
        println!("{:?} pixels, the first is {:?}", picture.size(), picture.pixels()[0]);
    }
    Ok(())
}
