//! Frames between anchors: walks ahead, makes four frames for each anchor, and prints the source of each frame.
//! `cargo run --release --example frames_between`.

use std::sync::Arc;

use cairn::bundle::{Bundle, OpenOptions};
use cairn::framegen::cpu::CpuGenerator;
use cairn::present::presenter::{Presenter, PresenterOptions};
use cairn::runtime::{CpuOptions, Device, Ort};
use cairn::world::{ControlInput, KeptAnchor, Key, OperatingPoint, Rollout, World, WorldOptions};
use cairn::{LibrarySearch, Picture, Result};

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let console = provision::Console::new();
    provision::onnxruntime(&console)?;
    Ok(frames_between()?)
}

fn frames_between() -> Result<()> {
    let device = Device::cpu(&Ort::find(&LibrarySearch::for_tools())?, CpuOptions::default())?;
    let world = World::load(&device, &Bundle::embedded(&OpenOptions::default())?, WorldOptions::default())?;
    let point: OperatingPoint = "stock,pictures:1".parse()?;
    let mut rollout = Rollout::new(&world, &point, 1)?;
    rollout.append(&Picture::from_rgba(640, 360, vec![128; 640 * 360 * 4])?)?;
    let walk = ControlInput::new([0.0, 0.0], Key::from_name("W").into_iter().collect(), 0.0)?;
    let (width, height) = world.render_size();
    let mut shown = Picture::new(width, height)?;
    let (mut now, frame_ns) = (0, 1_000_000_000 / u64::from(point.latents_per_second) / 4);

    // The book shows the following lines.
    let presenter = Presenter::new(
        PresenterOptions { multiplier: 4, ..PresenterOptions::default() },
        Some(Box::new(CpuGenerator::new())),
    )?;
    for number in 0..5 {
        rollout.step(&walk)?;
        presenter.push(Arc::new(KeptAnchor::of(&mut rollout, number == 0)?), None, now)?;
        for _ in 0..4 {
            let frame = presenter.draw(now, world.render_size(), |picture| shown.clone_from(picture))?;
            println!("{:3} ms: {:?}", now / 1_000_000, frame.map(|frame| frame.source));
            now += frame_ns;
        }
    }
    println!("the last frame's first pixel is {:?}", shown.pixels()[0]);
    Ok(())
}
