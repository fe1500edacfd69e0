//! Frames of the presenter in textures of this adapter: against true frames and the processor's, in every format of a target, and after the
//! device was removed.

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::core::Interface;
use cairn::gpu::{Gpu, Target, read_texture, texture_from_picture};
use cairn::present::device::{DeviceDrawer, Preparation};
use cairn::present::presenter::Presenter;
use cairn::{Colours, ErrorKind, Picture, Result};
use half::f16;
use scenes::Family;

use super::adapters::gpu;
use super::processor::judge_quality;
use super::resources::{self, TestResource, writable_texture};
use super::walk::{self, Walk};
use crate::outcome::{Better, Outcome};
use crate::settings::Settings;

const REMEDY: &str = "Update the graphics driver; if it stays, report it with this page";
const COMMON: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COMMON;

/// The presenter's frames against the true ones.
pub(super) fn quality(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    judge_quality(settings, |walk| by_device(&gpu, walk, |_| Ok(())), "the adapter's shaders")
}

/// A presenter and a drawer of the device for frames of that size. `choose` sets the drawer up before it is prepared.
pub(super) fn device_presenter(
    gpu: &Gpu,
    size: (u32, u32),
    choose: impl FnOnce(&mut DeviceDrawer) -> Result<()>,
) -> Result<(Presenter, DeviceDrawer)> {
    let mut drawer = DeviceDrawer::new(gpu, size, Colours::Srgb)?;
    choose(&mut drawer)?;
    let presenter = walk::presenter(None)?;
    presenter.prepare(&mut drawer, &Preparation::new(size))?;
    Ok((presenter, drawer))
}

/// The frames half way by the device.
pub(super) fn by_device(
    gpu: &Gpu,
    walk: &Walk,
    choose: impl FnOnce(&mut DeviceDrawer) -> Result<()>,
) -> Result<Vec<Picture>> {
    let size = walk.size();
    let (presenter, mut drawer) = device_presenter(gpu, size, choose)?;
    walk.show(&presenter, |now| {
        let (texture, fence_point) = texture_from_picture(gpu, &Picture::new(size.0, size.1)?)?;
        fence_point.wait()?;
        let target = Target { texture: texture.clone(), before: COMMON, after: COMMON };
        let Some((shown, fence_point)) = presenter.submit(now, &mut drawer, &target)?.made() else {
            return Ok((None, None));
        };
        fence_point.wait()?;
        Ok((Some(shown), Some(read_texture(gpu, &texture, COMMON)?)))
    })
}

/// Formats of targets, with their bytes per pixel.
const FORMATS: [(DXGI_FORMAT, usize, &str); 5] = [
    (DXGI_FORMAT_R8G8B8A8_UNORM, 4, "RGBA8"),
    (DXGI_FORMAT_B8G8R8A8_UNORM, 4, "BGRA8"),
    (DXGI_FORMAT_R8G8B8A8_UNORM_SRGB, 4, "RGBA8 sRGB"),
    (DXGI_FORMAT_R10G10B10A2_UNORM, 4, "RGB10A2"),
    (DXGI_FORMAT_R16G16B16A16_FLOAT, 8, "RGBA16F"),
];

/// Largest part of the pixels that may differ from the processor's by more than a level of 255.
const FAR_PIXELS: f64 = 1e-3;

/// A frame in every format of a target equals the processor's.
pub(super) fn formats(settings: &Settings) -> Result<Outcome> {
    let gpu = gpu(settings)?;
    let walk = Walk::new(Family::Sword, settings.pick((320, 180), (96, 54)), 1)?;
    let wanted = walk.by_processor()?.remove(0);
    let size = walk.size();
    let mut faults = Vec::new();
    let mut outcome_facts = Vec::new();
    for (format, bytes, name) in FORMATS {
        let (presenter, mut drawer) = device_presenter(&gpu, size, |_| Ok(()))?;
        let mut rows = Vec::new();
        walk.show(&presenter, |now| {
            let texture = target_texture(&gpu, size, format);
            let target = Target { texture: texture.resource.clone(), before: COMMON, after: COMMON };
            let Some((shown, fence_point)) = presenter.submit(now, &mut drawer, &target)?.made() else {
                return Ok((None, None));
            };
            fence_point.wait()?;
            rows = resources::read_texture(&gpu, &texture, size.0 as usize * bytes);
            Ok((Some(shown), Some(wanted.clone())))
        })?;
        let found = rows.chunks_exact(bytes).map(|pixel| levels(format, pixel));
        let is_far = |(found, wanted): (&[f32; 3], &[u8; 4])| {
            (0..3).any(|c| (found[c] - f32::from(wanted[c])).abs() > 1.0 + 0.5)
        };
        let found: Vec<[f32; 3]> = found.collect();
        let far = found.iter().zip(wanted.pixels()).filter(|pair| is_far(*pair)).count();
        let part = far as f64 / found.len() as f64;
        outcome_facts.push((name, format!("{far} of {} pixels differ by more than a level", found.len())));
        if part > FAR_PIXELS || found.len() != wanted.pixels().len() {
            faults.push(format!("{name}: {far} of {} pixels differ from the processor's", found.len()));
        }
    }
    let outcome = if faults.is_empty() {
        Outcome::pass(format!("frames in {} formats equal the processor's", FORMATS.len()))
    } else {
        Outcome::fail(faults.join("; "), REMEDY)
    };
    Ok(outcome_facts.into_iter().fold(outcome, |outcome, (name, text)| outcome.fact(name, text)))
}

/// A target of that format, which a swap chain may have: shaders need not be able to write it.
fn target_texture(gpu: &Gpu, size: (u32, u32), format: DXGI_FORMAT) -> TestResource {
    let wanted = resources::texture_desc(size, format, D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET);
    TestResource { resource: resources::create_resource(gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, COMMON), state: COMMON }
}

/// Red, green and blue of a texel in levels of 255.
fn levels(format: DXGI_FORMAT, texel: &[u8]) -> [f32; 3] {
    match format {
        DXGI_FORMAT_B8G8R8A8_UNORM => [2, 1, 0].map(|c| f32::from(texel[c])),
        DXGI_FORMAT_R10G10B10A2_UNORM => {
            let word = u32::from_le_bytes([texel[0], texel[1], texel[2], texel[3]]);
            [0, 10, 20].map(|shift| (word >> shift & 1023) as f32 * 255.0 / 1023.0)
        }
        DXGI_FORMAT_R16G16B16A16_FLOAT => {
            [0, 2, 4].map(|c| f16::from_le_bytes([texel[c], texel[c + 1]]).to_f32() * 255.0)
        }
        _ => [0, 1, 2].map(|c| f32::from(texel[c])),
    }
}

/// A removed device is reported as such, everything on it can be dropped, and a new device works.
pub(super) fn removal(settings: &Settings) -> Result<Outcome> {
    let first = gpu(settings)?;
    let walk = Walk::new(Family::Desert, (96, 54), 1)?;
    let truth = by_device(&first, &walk, |_| Ok(()))?;
    let Ok(device) = first.device().cast::<ID3D12Device5>() else {
        return Ok(Outcome::cannot_tell(
            "this Direct3D 12 cannot remove a device on request",
            "Use Windows 10 1809 or later, or the Agility SDK",
        ));
    };
    let (presenter, mut drawer) = device_presenter(&first, walk.size(), |_| Ok(()))?;
    let target = writable_texture(&first, walk.size(), DXGI_FORMAT_R8G8B8A8_UNORM, COMMON);
    // SAFETY: a live device, which this process alone uses.
    unsafe { device.RemoveDevice() };
    let told = walk.show(&presenter, |now| {
        let target = Target { texture: target.resource.clone(), before: COMMON, after: COMMON };
        let shown = presenter.submit(now, &mut drawer, &target)?.made();
        if let Some((_, fence_point)) = &shown {
            fence_point.wait()?;
        }
        Ok((shown.map(|(shown, _)| shown), Some(Picture::new(1, 1)?)))
    });
    let told = match told {
        Err(e) if e.kind() == ErrorKind::DeviceRemoved => e,
        Err(e) => return Ok(Outcome::fail(format!("a removed device is reported as another failure: {e}"), REMEDY)),
        Ok(_) => return Ok(Outcome::fail("a removed device still makes frames", REMEDY)),
    };
    drop((presenter, drawer, target, device, first));
    let second = gpu(settings)?;
    let again = by_device(&second, &walk, |_| Ok(()))?;
    Ok(if again == truth {
        Outcome::pass("a removed device is reported, and a new one makes the same frames")
            .fact("report", told.to_string())
    } else {
        Outcome::fail("after a removed device a new one makes other frames", REMEDY)
    })
}

/// Growth of the adapter's memory that a process may keep over all lives, in bytes: pools of a driver.
const KEPT: u64 = 64 << 20;

/// Devices, presenters and drawers come and go; each makes the same frame, and memory comes back.
pub(super) fn lives(settings: &Settings) -> Result<Outcome> {
    let lives = settings.pick(200, 5);
    let walk = Walk::new(Family::Desert, (96, 54), 1)?;
    let mut truth = None;
    let mut used = Vec::new();
    // One device stays, so that the memory of the process can be asked for between two lives.
    let observer = gpu(settings)?;
    let began = std::time::Instant::now();
    for life in 0..lives {
        let gpu = gpu(settings)?;
        let frames = by_device(&gpu, &walk, |_| Ok(()))?;
        drop(gpu);
        if truth.get_or_insert_with(|| frames.clone()) != &frames {
            return Ok(Outcome::fail(format!("the frame of life {life} is another than that of the first"), REMEDY));
        }
        used.push(observer.budget()?.map(|budget| budget.used));
    }
    let each = 1e3 * began.elapsed().as_secs_f64() / f64::from(lives);
    // The first lives fill the driver's pools.
    let growth = match (used[used.len() / 10], used.last().copied().flatten()) {
        (Some(from), Some(to)) => Some(to.saturating_sub(from)),
        _ => None,
    };
    let outcome = match growth {
        Some(growth) if growth > KEPT => {
            Outcome::fail(format!("{lives} lives left {} MiB of the adapter's memory in use", growth >> 20), REMEDY)
        }
        Some(growth) => Outcome::pass(format!(
            "{lives} lives of device and presenter made the same frame, and left {} MiB in use",
            growth >> 20
        )),
        None => Outcome::cannot_tell(
            format!("{lives} lives made the same frame, but the system does not report the adapter's memory"),
            "Use Windows 10 or 11 with the driver of the graphics card's maker",
        ),
    };
    Ok(outcome.figure("life", each, "ms", Better::Lower))
}
