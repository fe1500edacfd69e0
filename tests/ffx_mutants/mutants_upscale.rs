//! Mutants of the upscaler's structs.

use cairn::ffx::bindings::{
    Coordinates, CreateUpscale, Dimensions, ReactiveFlags, Resource, ResourceState, UpscaleCreateFlags, UpscaleFlags,
};
use cairn::ffx::{Api, Choice, LibraryKind, ReactiveMask, UpscaleFrame, UpscaleParams, Upscaler};
use cairn::gpu::Gpu;
use cairn::gpu::windows::core::Interface;
use test_support::d3d12::resources::{TestResource, run_list};
use test_support::ffx::double_folder::DoubleFolder;
use test_support::ffx::frame_textures::Textures;

use crate::mutants::{Mutant, Report, api, mutants, shim, try_mutant};
use crate::struct_table;

const RENDERED: Dimensions = Dimensions { width: 16, height: 12 };
const SHOWN: Dimensions = Dimensions { width: 32, height: 24 };

/// Textures of an upscaled frame with all optional inputs.
struct Scene {
    gpu: Gpu,
    /// The previous frame and this one.
    rendered: [Textures; 2],
    masks: [TestResource; 2],
    exposure: TestResource,
    shown: Textures,
    /// The computed reactive mask.
    found: TestResource,
}

impl Scene {
    fn new() -> Self {
        let gpu = Gpu::on_adapter(None).expect("a device");
        let rendered = [0, 2].map(|moved| {
            let made = Textures::new(&gpu, RENDERED);
            made.fill(&made.color, |x, y| {
                let at = |phase: u32| (40 + (x + moved) * phase * 5 + y * (9 - phase)) as u8;
                [at(1), at(2), at(3), 255]
            });
            made.fill(&made.depth, |x, y| (0.25 + 0.5 * ((x / 4 + y / 3) % 2) as f32).to_le_bytes());
            let half = |v: f32| half::f16::from_f32(v).to_le_bytes();
            made.fill(&made.motion, |x, y| {
                let [a, b] = [half((x / 4) as f32 - 1.5), half((y / 3) as f32 - 1.0)];
                [a[0], a[1], b[0], b[1]]
            });
            made
        });
        let masks = [0.05, 0.07].map(|step| {
            let mask = Textures::new(&gpu, RENDERED).depth;
            rendered[0].fill(&mask, |x, y| (step * ((x + y) % 8) as f32).to_le_bytes());
            mask
        });
        let one = Textures::new(&gpu, Dimensions { width: 1, height: 1 });
        one.fill(&one.depth, |_, _| 5.0_f32.to_le_bytes());
        let (shown, found) = (Textures::new(&gpu, SHOWN), Textures::new(&gpu, RENDERED).depth);
        Self { gpu, rendered, masks, exposure: one.depth, shown, found }
    }

    fn upscaler(&self, api: &Api) -> cairn::Result<Upscaler> {
        let flags = UpscaleCreateFlags::MOTION_JITTER
            | UpscaleCreateFlags::DEPTH_INVERTED
            | UpscaleCreateFlags::NON_LINEAR_COLOR;
        let head = CreateUpscale { flags, max_render_size: RENDERED, max_upscale_size: SHOWN, ..Default::default() };
        // SAFETY: a live device, which outlives the upscaler.
        unsafe { Upscaler::create(api, self.gpu.device().as_raw(), Choice::Any, head) }
    }

    /// Upscales two frames, the second with the mutant; returns the picture or the error.
    fn pair(&self, upscaler: &mut Upscaler, mutant: Option<Mutant>) -> cairn::Result<Vec<[u8; 4]>> {
        let mut answer = Ok(());
        run_list(&self.gpu, |list| {
            let resource = |kept: &TestResource| Resource::of(&kept.resource, ResourceState::UNORDERED_ACCESS);
            for (number, rendered) in self.rendered.iter().enumerate() {
                let frame = UpscaleFrame {
                    command_list: list.as_raw(),
                    color: resource(&rendered.color),
                    depth: resource(&rendered.depth),
                    motion: resource(&rendered.motion),
                    exposure: resource(&self.exposure),
                    reactive: resource(&self.masks[0]),
                    transparency: resource(&self.masks[1]),
                    output: resource(&self.shown.output),
                    params: UpscaleParams {
                        jitter: Coordinates { x: 0.25, y: -0.4 },
                        motion_scale: Coordinates { x: 1.5, y: 1.25 },
                        sharpness: Some(0.5),
                        pre_exposure: 2.0,
                        reset: number == 0,
                        encoding: UpscaleFlags::COLOR_SRGB,
                        ..UpscaleParams::of(RENDERED, SHOWN)
                    },
                };
                shim().mutant = mutant.filter(|_| number == 1);
                // SAFETY: an open list of the upscaler's device, and textures that live until it has run.
                answer = unsafe { upscaler.record(&frame) };
                shim().mutant = None;
            }
        });
        answer?;
        Ok(self.shown.generated())
    }

    /// Computes a reactive mask; returns it or the error.
    fn mask(&self, upscaler: &mut Upscaler, mutant: Option<Mutant>) -> cairn::Result<Vec<[u8; 4]>> {
        let mut answer = Ok(());
        let output = &self.found;
        run_list(&self.gpu, |list| {
            let resource = |kept: &TestResource| Resource::of(&kept.resource, ResourceState::UNORDERED_ACCESS);
            let [opaque, color] = self.rendered.each_ref().map(|rendered| resource(&rendered.color));
            let mask = ReactiveMask {
                scale: 2.5,
                // Bright pixels are below the threshold, dark ones above.
                threshold: 0.2,
                value: 0.8,
                flags: ReactiveFlags::TONEMAP | ReactiveFlags::THRESHOLD | ReactiveFlags::COMPONENTS_MAX,
                ..ReactiveMask::of(RENDERED)
            };
            shim().mutant = mutant;
            // SAFETY: an open list of the upscaler's device, and textures that live until it has run.
            answer = unsafe { upscaler.find_reactive(list.as_raw(), opaque, color, resource(output), &mask) };
            shim().mutant = None;
        });
        answer?;
        Ok(self.rendered[0].pixels(output))
    }
}

/// Tries all mutants of the upscaler's structs.
pub(crate) fn try_all(report: &mut Report) {
    let scene = Scene::new();
    let role = ["effect 0x10000", "sdk 2.1", "offers 0xf600000001000003 4.0.3", "quiet"];
    let double = DoubleFolder::empty().with(LibraryKind::Upscaler, &role);
    let api = api(&double, LibraryKind::Upscaler);
    let mut upscaler = scene.upscaler(&api).expect("an upscaler");
    let truth = scene.pair(&mut upscaler, None).expect("upscaled");
    assert_eq!(scene.pair(&mut upscaler, None).expect("upscaled"), truth, "it does the same each time");
    let mut verdicts = 0;
    for (name, mutant) in struct_table::upscale_structs().iter().flat_map(mutants) {
        let found = try_mutant(&double, &truth, &mut verdicts, || scene.pair(&mut upscaler, Some(mutant)));
        found.into_iter().for_each(|found| report.add(name.clone(), found));
    }
    let mask = scene.mask(&mut upscaler, None).expect("found");
    assert!(mask.iter().any(|pixel| *pixel != mask[0]), "it says something");
    for (name, mutant) in struct_table::mask_structs().iter().flat_map(mutants) {
        let found = try_mutant(&double, &mask, &mut verdicts, || scene.mask(&mut upscaler, Some(mutant)));
        found.into_iter().for_each(|found| report.add(name.clone(), found));
    }
    for (name, mutant) in struct_table::upscaler_creation_structs().iter().flat_map(mutants) {
        let found = try_mutant(&double, &truth, &mut verdicts, || {
            shim().mutant = Some(mutant);
            let made = scene.upscaler(&api);
            shim().mutant = None;
            // A rejected call needs no picture.
            if shim().refused { made.map(|_| Vec::new()) } else { scene.pair(&mut made?, None) }
        });
        found.into_iter().for_each(|found| report.add(name.clone(), found));
    }
    assert!(scene.gpu.removed().is_none());
}
