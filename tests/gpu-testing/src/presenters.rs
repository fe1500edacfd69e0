//! A presenter's frames from the device, compared with those from the processor.

use std::sync::Arc;

use cairn::framegen::cpu::CpuGenerator;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::{FencePoint, Gpu, Target};
use cairn::guidance::{Guidance, paper};
use cairn::present::device::{DeviceDrawer, FrameResult, Preparation};
use cairn::present::pacing::Interval;
use cairn::present::presenter::{FrameInfo, Presenter, PresenterOptions};
use cairn::world::{GuidanceSource, KeptAnchor};
use cairn::{Colours, Picture};
use half::f16;

use crate::engine::Engine;
use crate::textures::{self, Recording, TextureDesc};

/// Nanoseconds between anchors.
pub const INTERVAL: u64 = 80_000_000;

/// Four frames per anchor.
pub fn options(motion: GuidanceSource) -> PresenterOptions {
    let interval = Some(Interval::of_ns(INTERVAL).expect("an interval"));
    PresenterOptions { interval, multiplier: 4, motion, ..PresenterOptions::default() }
}

/// The library's device on an engine's.
pub fn device_of(engine: &Engine, queue: &ID3D12CommandQueue) -> Gpu {
    Gpu::of_engine(&engine.device, queue, None).expect("the engine's device")
}

/// Format, flags and states of a target texture.
#[derive(Clone, Copy, Debug)]
pub struct TargetKind {
    /// Format of a pixel.
    pub format: DXGI_FORMAT,
    /// Allowed uses.
    pub flags: D3D12_RESOURCE_FLAGS,
    /// States before and after a frame is written.
    pub states: [D3D12_RESOURCE_STATES; 2],
}

/// A texture that can be a render target.
pub const RENDERED: D3D12_RESOURCE_FLAGS = D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET;
/// State of a swap chain's buffer when it is presented.
pub const PRESENT: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_PRESENT;
const DRAWN: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_RENDER_TARGET;
const READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;

/// Targets of swap chains, and an engine's own textures.
pub const KINDS: [TargetKind; 5] = [
    TargetKind { format: DXGI_FORMAT_R8G8B8A8_UNORM, flags: RENDERED, states: [PRESENT, PRESENT] },
    TargetKind { format: DXGI_FORMAT_B8G8R8A8_UNORM, flags: RENDERED, states: [DRAWN, PRESENT] },
    TargetKind { format: DXGI_FORMAT_R10G10B10A2_UNORM, flags: D3D12_RESOURCE_FLAG_NONE, states: [READ, READ] },
    TargetKind { format: DXGI_FORMAT_R16G16B16A16_FLOAT, flags: RENDERED, states: [DRAWN, DRAWN] },
    TargetKind { format: DXGI_FORMAT_R8G8B8A8_UNORM_SRGB, flags: RENDERED, states: [PRESENT, DRAWN] },
];

/// A presenter whose frames the processor makes, and one whose frames the device makes; both get the same input.
pub struct PresenterPair {
    /// The processor's.
    pub host: Presenter,
    /// The device's.
    pub device: Presenter,
    /// What makes the device's frames.
    pub drawer: DeviceDrawer,
    /// Compared pixels.
    pub pixels: usize,
    /// Pixels that differ by more than a level of 255.
    pub differences: usize,
}

impl PresenterPair {
    /// Presenters of pictures of `size`.
    pub fn new(gpu: &Gpu, size: (u32, u32), options: &PresenterOptions) -> Self {
        Self::of_latents(gpu, size, options, [0; 3])
    }

    /// As [`PresenterPair::new`], with motion from latents of that shape.
    pub fn of_latents(gpu: &Gpu, size: (u32, u32), options: &PresenterOptions, latent: [u32; 3]) -> Self {
        let device = Presenter::new(options.clone(), None).expect("a presenter");
        let mut drawer = DeviceDrawer::new(gpu, size, Colours::Srgb).expect("a drawer");
        let wanted = Preparation { latent, ..Preparation::new(options.size.unwrap_or(size)) };
        device.prepare(&mut drawer, &wanted).expect("it is prepared");
        Self {
            host: Presenter::new(options.clone(), Some(Box::new(CpuGenerator::new()))).expect("a presenter"),
            device,
            drawer,
            pixels: 0,
            differences: 0,
        }
    }

    /// Passes an anchor to both.
    pub fn push(&self, anchor: &Arc<KeptAnchor>, guidance: Option<&Arc<Guidance>>, now: u64) {
        for presenter in [&self.host, &self.device] {
            assert!(presenter.push(anchor.clone(), guidance.cloned(), now).expect("it is accepted"));
        }
    }

    /// Compares the frames of both at `now`, pixel by pixel. The device submits it (if `own`) or records it into an engine's list.
    pub fn compare(&mut self, engine: &Engine, now: u64, kind: TargetKind, own: bool) -> FrameInfo {
        self.compare_after(engine, now, kind, own, || ())
    }

    /// As [`PresenterPair::compare`]; calls `made` after the device's frame and before the processor's.
    pub fn compare_after(
        &mut self,
        engine: &Engine,
        now: u64,
        kind: TargetKind,
        own: bool,
        made: impl FnOnce(),
    ) -> FrameInfo {
        let size = self.host.size().expect("a size");
        let TargetKind { format, flags, states: [before, after] } = kind;
        let texture =
            TextureDesc { size, format, flags, state: before, ..TextureDesc::default() }.create(&engine.device);
        let target = Target { texture: texture.clone(), before, after };
        let found = if own {
            let (shown, fence_point) =
                self.device.submit(now, &mut self.drawer, &target).expect("it is made").made().expect("a frame");
            fence_point.wait().expect("it is there");
            Some(shown)
        } else {
            let recording = Recording::on(&engine.device, &engine.direct);
            let shown = record(&self.device, now, &mut self.drawer, &recording, &target).made();
            recording.submit(&engine.direct);
            textures::wait(&engine.device, &engine.direct);
            shown
        };
        made();
        let mut expected = None;
        let shown = self.host.draw(now, size, |picture| expected = Some(picture.clone())).expect("it is drawn");
        let expected = expected.expect("a picture");
        assert_eq!(found, shown, "both show the same");
        let held = textures::read(&engine.device, &engine.direct, &texture, after);
        let differences = count_differences(&held, &expected, format);
        self.pixels += (size.0 * size.1) as usize;
        self.differences += differences;
        let shown = shown.expect("a frame");
        if differences > 0 {
            println!("{differences} pixels of {size:?} are more than a level off: {shown:?} {kind:?}");
        }
        shown
    }

    /// Sets the size of the frames, and prepares for it.
    pub fn resize(&mut self, size: Option<(u32, u32)>) {
        for presenter in [&self.host, &self.device] {
            presenter.resize(size).expect("a size");
        }
        let frames = self.device.size().expect("anchors have come");
        self.device.prepare(&mut self.drawer, &Preparation::new(frames)).expect("it is prepared");
    }

    /// Checks that at most one of a thousand compared pixels differs by more than a level.
    pub fn check(&self) {
        println!("{} of {} pixels are more than a level off", self.differences, self.pixels);
        assert!(self.differences * 1000 <= self.pixels, "{} of {} pixels", self.differences, self.pixels);
    }
}

/// Records a frame into an engine's list, whose fence signals when the list has run.
pub fn record(
    presenter: &Presenter,
    now: u64,
    drawer: &mut DeviceDrawer,
    recording: &Recording,
    target: &Target,
) -> FrameResult<FrameInfo> {
    let until = FencePoint::of_engine(drawer.gpu(), recording.fence(), 1).expect("a fence of the device");
    presenter.record(now, drawer, recording.list(), target, &until).expect("it is recorded")
}

/// The number of a texture's pixels that differ from the picture by more than a level of 255.
pub fn count_differences(held: &[u8], picture: &Picture, format: DXGI_FORMAT) -> usize {
    let levels: Vec<[f32; 4]> = match format {
        DXGI_FORMAT_B8G8R8A8_UNORM => {
            held.as_chunks::<4>().0.iter().map(|&[b, g, r, a]| [r, g, b, a].map(f32::from)).collect()
        }
        DXGI_FORMAT_R10G10B10A2_UNORM => {
            let words = held.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
            let ten = |word: u32, at: u32| (word >> at & 1023) as f32 * 255.0 / 1023.0;
            words.map(|w| [ten(w, 0), ten(w, 10), ten(w, 20), (w >> 30) as f32 * 85.0]).collect()
        }
        DXGI_FORMAT_R16G16B16A16_FLOAT => {
            let level = |bytes: &[u8]| f16::from_le_bytes([bytes[0], bytes[1]]).to_f32() * 255.0;
            held.chunks(8).map(|p| std::array::from_fn(|c| level(&p[2 * c..2 * c + 2]))).collect()
        }
        _ => held.as_chunks::<4>().0.iter().map(|pixel| pixel.map(f32::from)).collect(),
    };
    assert_eq!(levels.len(), picture.pixels().len(), "a pixel each");
    // The tolerance is one level of 255, plus half a step of ten bits or of half floats.
    let near = |(found, wanted): (&[f32; 4], &[u8; 4])| {
        found.iter().zip(wanted).all(|(a, b)| (a - f32::from(*b)).abs() <= 1.0 + 0.13)
    };
    levels.iter().zip(picture.pixels()).filter(|pair| !near(*pair)).count()
}

/// A picture whose contents move by `step` pixels per number.
pub fn moving(size: (u32, u32), number: u64, step: u64) -> Picture {
    let mut picture = Picture::new(size.0, size.1).expect("a picture");
    for (i, pixel) in (0u64..).zip(picture.pixels_mut()) {
        let (x, y) = (i % u64::from(size.0) + step * number, i / u64::from(size.0));
        *pixel = [(x * 9 % 200) as u8, (y * 7 % 251) as u8, ((x / 4 + y / 4) % 2 * 90) as u8, 255];
    }
    picture
}

/// Guidance with the horizontal motion `pixels` everywhere, and a constant depth.
pub fn constant_motion(size: (u32, u32), pixels: f32) -> Arc<Guidance> {
    let mut guidance = Guidance::new(size.0, size.1, paper::PROJECTION).expect("guidance");
    guidance.motion_mut().vectors_mut().fill([f16::from_f32(pixels), f16::ZERO]);
    guidance.depth_mut().depth_mut().fill(0.5);
    Arc::new(guidance)
}
