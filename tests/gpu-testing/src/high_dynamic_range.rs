//! Frames in HDR10 and scRGB, compared with the formulas of these colour spaces.

use std::sync::Arc;

use cairn::Colours;
use cairn::framegen::FrameGenerator;
use cairn::framegen::cpu::CpuGenerator;
use cairn::gpu::Target;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::present::device::{DeviceDrawer, Preparation};
use cairn::present::presenter::Presenter;
use cairn::world::{GuidanceSource, KeptAnchor};
use half::f16;

use crate::engine::Engine;
use crate::presenters::{INTERVAL, PRESENT, RENDERED, constant_motion, device_of, moving, options};
use crate::textures::{self, TextureDesc};

/// Makes frames in HDR10 and in scRGB, and checks that at most one pixel of a thousand differs from the formulas of these colour spaces by more
/// than 1.5 steps of ten bits, or 0.004 of scRGB. Returns the number of compared pixels.
pub fn compare(engine: &Engine) -> usize {
    let gpu = device_of(engine, &engine.direct);
    let mut pixels = 0;
    let size = (75, 46);
    let anchors = [0, 1].map(|number| Arc::new(KeptAnchor::of_picture(moving(size, number, 3), number, false)));
    let push = |to: &Presenter| {
        for (number, anchor) in (0..).zip(&anchors) {
            to.push(anchor.clone(), (number > 0).then(|| constant_motion(size, 3.0)), number * INTERVAL)
                .expect("it is accepted");
        }
    };
    let light = |level: u8| match f64::from(level) / 255.0 {
        v if v <= 0.04045 => v / 12.92,
        v => ((v + 0.055) / 1.055).powf(2.4),
    };
    let pq = |nits: f64| {
        let power = (nits / 10_000.0).powf(0.159_301_757_812_5);
        ((0.835_937_5 + 18.851_562_5 * power) / (1.0 + 18.687_5 * power)).powf(78.843_75)
    };
    for (colours, format) in [
        (Colours::Hdr10 { white_nits: 203.0 }, DXGI_FORMAT_R10G10B10A2_UNORM),
        (Colours::ScRgb { white_nits: 160.0 }, DXGI_FORMAT_R16G16B16A16_FLOAT),
    ] {
        let cpu: Option<Box<dyn FrameGenerator>> = Some(Box::new(CpuGenerator::new()));
        let [host, device] = [cpu, None].map(|g| Presenter::new(options(GuidanceSource::PictureFlow), g).expect("one"));
        [&host, &device].into_iter().for_each(push);
        let mut drawer = DeviceDrawer::new(&gpu, size, colours).expect("a drawer");
        device.prepare(&mut drawer, &Preparation::new(size)).expect("it is prepared");
        for now in [INTERVAL, INTERVAL * 3 / 2] {
            let texture =
                TextureDesc { size, format, flags: RENDERED, ..TextureDesc::default() }.create(&engine.device);
            let target = Target { texture: texture.clone(), before: PRESENT, after: PRESENT };
            let (_, fence_point) =
                device.submit(now, &mut drawer, &target).expect("it is made").made().expect("a frame");
            fence_point.wait().expect("it is there");
            let held = textures::read(&engine.device, &engine.direct, &texture, PRESENT);
            let mut wanted = Vec::new();
            host.draw(now, size, |picture| wanted = picture.pixels().to_vec()).expect("it is drawn");
            let off = |i: usize, pixel: &[u8; 4]| {
                let rgb = [pixel[0], pixel[1], pixel[2]].map(light);
                let of = |row: [f64; 3]| row.iter().zip(rgb).map(|(a, b)| a * b).sum::<f64>();
                match colours {
                    Colours::Hdr10 { white_nits } => {
                        let word = u32::from_le_bytes(std::array::from_fn(|byte| held[4 * i + byte]));
                        let wide = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]];
                        let levels = wide.map(|row| pq(of(row) * f64::from(white_nits)) * 1023.0);
                        let found = [0, 10, 20].map(|at| f64::from(word >> at & 1023));
                        word >> 30 != 3 || levels.iter().zip(found).any(|(a, b)| (a - b).abs() > 1.5)
                    }
                    _ => {
                        let half =
                            |c: usize| f16::from_le_bytes([held[8 * i + 2 * c], held[8 * i + 2 * c + 1]]).to_f64();
                        // 160 nits are twice the 80 nits that 1 stands for.
                        half(3) != 1.0 || (0..3).any(|c| (half(c) - 2.0 * rgb[c]).abs() > 0.004)
                    }
                }
            };
            let differences = (0..).zip(&wanted).filter(|(i, pixel)| off(*i, pixel)).count();
            pixels += wanted.len();
            assert!(differences * 1000 <= wanted.len(), "{differences} pixels of {colours:?} at {now}");
        }
        // A target whose format cannot hold such values is refused.
        let plain = TextureDesc { size, flags: RENDERED, ..TextureDesc::default() }.create(&engine.device);
        let target = Target { texture: plain, before: PRESENT, after: PRESENT };
        let refused = device.submit(INTERVAL, &mut drawer, &target).expect_err("eight bits");
        assert_eq!(refused.offending_field(), Some("target"));
    }
    pixels
}
