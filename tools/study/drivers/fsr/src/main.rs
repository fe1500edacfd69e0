//! Makes frames half way between anchors with AMD's FSR, as `cairn::framegen` uses it, for the process that it reads requests from.

use std::process::ExitCode;

#[cfg(windows)]
fn main() -> ExitCode {
    use std::io::{self, BufReader, BufWriter};

    let (from, to) = (BufReader::new(io::stdin().lock()), BufWriter::new(io::stdout().lock()));
    match driver::run(from, to) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

#[cfg(not(windows))]
fn main() -> ExitCode {
    eprintln!("error: AMD's FSR needs Direct3D 12, which is available on Windows only; build this program for Windows");
    ExitCode::FAILURE
}

#[cfg(windows)]
mod driver {
    use std::io::{Read, Write};

    use cairn::ffx::bindings::CreateFrameGeneration;
    use cairn::ffx::{Choice, Effect, Library, LoadOptions};
    use cairn::framegen::device::DeviceGenerator;
    use cairn::framegen::{AnchorPair, FrameGenerator};
    use cairn::gpu::Gpu;
    use cairn::guidance::{Guidance, picture_flow};
    use cairn::{Picture, Result};
    use fsr_driver::{INTERVAL_MS, Request, write_frame, write_greeting};

    /// Answers requests until the input ends.
    pub(super) fn run(mut from: impl Read, mut to: impl Write) -> Result<()> {
        let opened = open();
        let version = opened.as_ref().map(|(version, _)| version.clone()).map_err(Clone::clone);
        write_greeting(&version, &mut to)?;
        let (_, mut generator) = opened?;
        while let Some(request) = Request::read(&mut from)? {
            if request.starts {
                generator.reset();
            }
            write_frame(&generate(&mut generator, &request), &mut to)?;
        }
        Ok(())
    }

    /// The provider's version and its generator, after the provider has made one small frame.
    fn open() -> Result<(String, DeviceGenerator)> {
        let library = Library::load(&LoadOptions::from_environment())?;
        let api = library.api(Effect::FrameGeneration)?;
        let mut generator = DeviceGenerator::of_amd(&Gpu::on_adapter(None)?, api, Choice::Any, INTERVAL_MS);
        let side = CreateFrameGeneration::SHORTEST_SIDE;
        let (picture, guidance) = (Picture::new(side, side)?, Guidance::new(side, side, picture_flow::PROJECTION)?);
        let pair = AnchorPair::new(&picture, &picture, &guidance)?;
        generator.generate(&pair, 0.5, &mut Picture::new(side, side)?)?;
        let version = generator.provider().map(|version| version.name.clone()).unwrap_or_default();
        Ok((version, generator))
    }

    fn generate(generator: &mut DeviceGenerator, request: &Request) -> Result<Picture> {
        let pair = AnchorPair::new(&request.previous, &request.current, &request.guidance)?;
        let mut frame = Picture::new(pair.size().0, pair.size().1)?;
        generator.generate(&pair, 0.5, &mut frame)?;
        Ok(frame)
    }
}
