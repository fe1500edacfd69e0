//! The library's shaders, compared with the processor's results.

use std::sync::Arc;

use cairn::framegen::device::DeviceGenerator;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_R16G16_FLOAT;
use cairn::present::presenter::PresenterOptions;
use cairn::world::{GuidanceSource, KeptAnchor};
use gpu_testing::engine::Engine;
use gpu_testing::flow::{self, Extraction};
use gpu_testing::frame_cases::Random;
use gpu_testing::presenters::{INTERVAL, KINDS, PresenterPair, constant_motion, moving, options};
use gpu_testing::{generator, high_dynamic_range, paper_guidance};
use half::f16;

use super::processor::GAIN;
use super::{DRIVER, Settings, truth};
use crate::finding::{Checked, Finding};
use crate::report::Figure;

/// Decoded pictures, resized.
pub(super) fn resize(settings: &Settings) -> Checked {
    let found = gpu_testing::resize::compare(&settings.gpu()?);
    Ok(Finding::pass(format!(
        "Of {} bytes of resized pictures {} differ from the processor's, by one level of 255",
        found.bytes, found.unequal
    ))
    .figure("bytes that differ by a level", found.unequal as f64, "bytes"))
}

/// The paper's guidance, from latents.
pub(super) fn guidance(settings: &Settings) -> Checked {
    let values = paper_guidance::compare(&settings.gpu()?);
    Ok(Finding::pass(format!(
        "{values} values of motion and depth from latents are within two half-float steps of the processor's"
    )))
}

/// Motion between two pictures.
pub(super) fn optical_flow(settings: &Settings) -> Checked {
    let (pairs, far) = compare_flow(&settings.gpu()?, settings.quick);
    Ok(Finding::pass(format!(
        "In {pairs} pairs of pictures 99 % of the motion vectors are within a quarter of a pixel of the processor's, and 90 % within 0.01 px"
    ))
    .figure("vectors more than a quarter of a pixel off, of the worst pair", far, "%"))
}

/// Motion of pairs of pictures; their number, and the largest share of vectors that are far from the processor's, in percent.
pub(super) fn compare_flow(gpu: &Gpu, is_quick: bool) -> (usize, f64) {
    let sizes = [(160, 90), (97, 61), (320, 180), (131, 33)];
    let sizes = if is_quick { &sizes[..2] } else { &sizes[..] };
    let mut worst = 0.0_f64;
    for (seed, size) in (0..).zip(sizes) {
        let mut extraction = Extraction::new(gpu, *size, DXGI_FORMAT_R16G16_FLOAT, 8);
        let [previous, current] = flow::moving_scene(&mut Random(seed), *size);
        let what = format!("{size:?}");
        flow::compare_scene(&mut extraction, [&previous, &current], &what);
        let found = extraction.vectors([&previous, &current]);
        let apart = flow::distances(&found, &flow::expected(&previous, &current));
        let far = apart.iter().filter(|distance| **distance > 0.25).count();
        worst = worst.max(100.0 * far as f64 / apart.len() as f64);
    }
    (sizes.len(), worst)
}

/// Random cases through both generators.
pub(super) fn frames(settings: &Settings) -> Checked {
    let gpu = settings.gpu()?;
    compare_frames(&gpu, settings.quick)
}

/// Frames of random cases; fails if too many pixels differ.
pub(super) fn compare_frames(gpu: &Gpu, is_quick: bool) -> Checked {
    let [bytes, halves] = if is_quick { [12, 6] } else { [70, 26] };
    let all = [generator::compare::<[u8; 4]>(gpu, 0..bytes), generator::compare::<[f16; 4]>(gpu, 0..halves)];
    let count = |of: fn(&gpu_testing::comparison::Differences) -> usize| {
        all.iter().map(|found| of(&found.interpolated) + of(&found.extrapolated)).sum::<usize>()
    };
    let [pixels, unequal, far] = [count(|all| all.pixels), count(|all| all.unequal), count(|all| all.far)];
    let sentence = format!(
        "Of {pixels} pixels in {} generated frames of random pictures {unequal} are not the processor's, {far} by more than a level of 255",
        2 * (bytes + halves)
    );
    let found = Finding::judge(all.iter().all(generator::FrameComparison::is_within_tolerance), sentence, DRIVER);
    let found = found.figure("pixels that are not equal", 100.0 * unequal as f64 / pixels as f64, "%").figure(
        "pixels that differ by more than a level",
        100.0 * far as f64 / pixels as f64,
        "%",
    );
    if found.verdict == crate::finding::Verdict::Fail { Err(found) } else { Ok(found) }
}

/// A presenter's frames in the formats and sizes of targets.
pub(super) fn formats(settings: &Settings) -> Checked {
    let engine = Engine::of(&settings.gpu()?);
    let (pixels, differences) = compare_formats(&engine, settings.quick);
    let hdr = high_dynamic_range::compare(&engine);
    Ok(Finding::pass(format!(
        "Frames in five formats, at sizes of their own and scaled: {differences} of {pixels} pixels differ from the processor's by more than a level of \
         255; {hdr} pixels in HDR10 and scRGB follow the formulas of both"
    ))
    .figure("pixels that differ by more than a level", 100.0 * differences as f64 / pixels as f64, "%"))
}

/// Frames by optical flow and by given motion, in all formats, and scaled; numbers of pixels and of those that differ.
pub(super) fn compare_formats(engine: &Engine, is_quick: bool) -> (usize, usize) {
    let gpu = gpu_testing::presenters::device_of(engine, &engine.direct);
    let size = (96, 64);
    let mut own = PresenterPair::new(&gpu, size, &options(GuidanceSource::PictureFlow));
    for number in 0..if is_quick { 2 } else { 4 } {
        let anchor = Arc::new(KeptAnchor::of_picture(moving(size, number, 2 + number), number, false));
        own.push(&anchor, None, number * INTERVAL);
        for quarter in 0..if number > 0 { 4 } else { 0 } {
            let kind = KINDS[(number + quarter) as usize % KINDS.len()];
            own.compare(engine, number * INTERVAL + quarter * INTERVAL / 4, kind, quarter % 2 == 0);
        }
    }
    own.check();
    let wanted = PresenterOptions { size: Some((150, 100)), letterbox: true, ..options(GuidanceSource::PictureFlow) };
    let mut scaled = PresenterPair::new(&gpu, size, &wanted);
    for number in 0..2 {
        let anchor = Arc::new(KeptAnchor::of_picture(moving(size, number, 3), number, false));
        scaled.push(&anchor, (number > 0).then(|| constant_motion(size, 3.0)).as_ref(), number * INTERVAL);
    }
    for (i, to) in (0..).zip([(97, 33), (250, 40), (192, 128)]) {
        scaled.resize(Some(to));
        scaled.compare(engine, INTERVAL + i % 4 * INTERVAL / 4, KINDS[i as usize % KINDS.len()], i % 2 == 1);
    }
    scaled.check();
    (own.pixels + scaled.pixels, own.differences + scaled.differences)
}

/// Generated frames beside true ones, by the device.
pub(super) fn truth(settings: &Settings) -> Checked {
    let mut generator = DeviceGenerator::of_shaders(&settings.gpu()?);
    let cases = truth::cases(settings.quick)?;
    let mut least = f64::INFINITY;
    let mut figures = Vec::new();
    let mut shown = Vec::new();
    for case in &cases {
        let made = truth::generate(&mut generator, case)?;
        let [own, mean] = [&made, &truth::blend(case)?].map(|picture| truth::psnr(&case.middle, picture));
        least = least.min(own - mean);
        let figure =
            |kind: &str, value| Figure { name: format!("{}, {kind}", case.name), value, unit: "dB".to_owned() };
        figures.extend([figure("generated", own), figure("mean of both anchors", mean)]);
        shown.push((case, made));
    }
    let sentence = if least >= GAIN {
        format!(
            "Each of {} generated frames is at least {least:.1} dB nearer to the true frame than the mean of its two anchors",
            cases.len()
        )
    } else {
        format!(
            "A generated frame is {least:.1} dB nearer to the true frame than the mean of its anchors, and should be {GAIN} dB nearer"
        )
    };
    let mut finding = Finding::judge(least >= GAIN, sentence, DRIVER).figures(figures);
    for (case, made) in &shown {
        finding = finding
            .picture(format!("{}: generated", case.name), made)
            .picture(format!("{}: true", case.name), &case.middle);
    }
    Ok(finding)
}
