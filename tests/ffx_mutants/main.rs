//! Mutation test: each field of each ffx-api struct is changed on its way to the double of AMD's libraries, which must detect it by
//! its return code or its picture. Undetected changes are in a list, with reasons. On Windows, or in the lab.
#![cfg(windows)]

use cairn::ffx::bindings::{
    Coordinates, CreateFlags, CreateFrameGeneration, Dimensions, Rect, Resource, ResourceState, SurfaceFormat,
    TransferFunction,
};
use cairn::ffx::{Api, Camera, Choice, Family, Frame, FrameParams, Generator, LibraryKind};
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use test_support::d3d12::resources::TestResource;
use test_support::d3d12::textures::borrowed;
use test_support::ffx::double_folder::{ANALYTIC_20, DoubleFolder, ML};
use test_support::ffx::frame_textures::Textures;

mod mutants;
mod mutants_upscale;
mod struct_table;
use mutants::{Mutant, Report, api, mutants as mutants_of, shim, try_mutant};

const SIZE: Dimensions = Dimensions { width: 80, height: 64 };

/// Textures of a frame with all optional inputs.
struct Scene {
    gpu: Gpu,
    textures: Textures,
    /// The previous frame and this one.
    shown: [TestResource; 2],
    hudless: [TestResource; 2],
    lens: TestResource,
    output: TestResource,
    allocator: ID3D12CommandAllocator,
    /// Closed between frames.
    list: ID3D12GraphicsCommandList,
}

impl Scene {
    fn new() -> Self {
        let gpu = Gpu::on_adapter(None).expect("a device");
        let textures = Textures::new(&gpu, SIZE);
        let [shown, hudless] = [0, 1].map(|interface| {
            [0, 5].map(|moved| {
                let made = Textures::new(&gpu, SIZE).color;
                textures.fill(&made, |x, y| {
                    let at = |phase: u32| ((x + moved) * phase * 5 + y * (9 - phase)) as u8;
                    if interface == 0 && y > 56 { [255, 0, 255, 255] } else { [at(1), at(2), at(3), 255] }
                });
                made
            })
        });
        let half = |v: f32| half::f16::from_f32(v).to_le_bytes();
        let halves = |x: f32, y: f32| [half(x)[0], half(x)[1], half(y)[0], half(y)[1]];
        let lens = Textures::new(&gpu, SIZE).motion;
        textures.fill(&lens, |x, _| halves(x as f32 / 512.0, 0.03));
        textures.fill(&textures.depth, |x, y| (0.25 + 0.5 * ((x / 4 + y / 3) % 2) as f32).to_le_bytes());
        textures.fill(&textures.motion, |x, y| halves((x / 4) as f32 - 3.0, (y / 3) as f32 - 2.0));
        let output = Textures::new(&gpu, SIZE).output;
        let kind = gpu.frames().kind();
        // SAFETY: a live device.
        let allocator: ID3D12CommandAllocator =
            unsafe { gpu.device().CreateCommandAllocator(kind) }.expect("an allocator");
        // SAFETY: a live device and allocator.
        let list: ID3D12GraphicsCommandList =
            unsafe { gpu.device().CreateCommandList(0, kind, &allocator, None) }.expect("a list");
        // SAFETY: an open list.
        unsafe { list.Close() }.expect("a closed list");
        Self { gpu, textures, shown, hudless, lens, output, allocator, list }
    }

    fn generator(&self, api: &Api, family: Family) -> cairn::Result<Generator> {
        let head = CreateFrameGeneration {
            flags: CreateFlags::MOTION_JITTER | CreateFlags::DEPTH_INVERTED | CreateFlags::HIGH_DYNAMIC_RANGE,
            display_size: SIZE,
            max_render_size: SIZE,
            back_buffer_format: SurfaceFormat::R8G8B8A8_UNORM,
            ..Default::default()
        };
        let hudless = Some(SurfaceFormat::R8G8B8A8_UNORM);
        // SAFETY: a live device, which outlives the generator.
        unsafe { Generator::create(api, self.gpu.device().as_raw(), Choice::Require(family), head, hudless) }
    }

    /// Runs a list, always the same one, and waits.
    fn run(&self, record: impl FnOnce(&ID3D12GraphicsCommandList)) {
        // SAFETY: the previously recorded work has run.
        unsafe {
            self.allocator.Reset().expect("it is not in use");
            self.list.Reset(&self.allocator, None).expect("it is closed");
        }
        record(&self.list);
        // SAFETY: an open list.
        unsafe { self.list.Close() }.expect("a closed list");
        let lists = [self.list.cast().expect("a list")];
        self.gpu.frames().submit(&lists).expect("a submission").wait().expect("it is done");
    }

    /// Generates from two frames, the second with the mutant; returns the picture or the error.
    fn pair(&self, generator: &mut Generator, mutant: Option<Mutant>) -> cairn::Result<Vec<[u8; 4]>> {
        let mut answer = Ok(());
        self.run(|list| {
            let resource = |kept: &TestResource| Resource::of(&kept.resource, ResourceState::UNORDERED_ACCESS);
            for number in 0..2 {
                // Both frames write the same texture.
                write_barrier(list, &self.output.resource);
                let frame = self.textures.frame(list, number == 0);
                let frame = Frame {
                    color: resource(&self.shown[number]),
                    output: resource(&self.output),
                    hudless: resource(&self.hudless[number]),
                    distortion: resource(&self.lens),
                    params: FrameParams {
                        jitter: Coordinates { x: 0.25, y: -0.5 },
                        motion_scale: Coordinates { x: 1.5, y: 1.25 },
                        camera: Camera { position: [3.0, 4.0, 5.0], ..Camera::default() },
                        rect: Rect { left: 1, top: 2, width: 78, height: 59 },
                        transfer: TransferFunction::PQ,
                        luminance: [0.0, 10.0],
                        ..frame.params
                    },
                    ..frame
                };
                shim().mutant = mutant.filter(|_| number == 1);
                // SAFETY: an open list of the generator's device, and textures that live until it has run.
                answer = unsafe { generator.record(&frame) };
                shim().mutant = None;
            }
        });
        answer?;
        Ok(self.textures.pixels(&self.output))
    }
}

/// Changes that cannot be detected: a field, its changes, and the reason.
const UNNOTICED: [(&str, &[&str], &str); 15] = [
    ("frameTimeDelta", &["largest", "onemore", "exchanged"], "any time above 0 is one, and half of it is half of it"),
    ("cameraNear", &["onemore", "exchanged"], POSSIBLE),
    ("cameraFar", &["onemore"], POSSIBLE),
    ("cameraFovAngleVertical", &["onemore"], POSSIBLE),
    ("viewSpaceToMetersFactor", &["largest", "onemore", "exchanged"], POSSIBLE),
    ("cameraPosition.x", &["zero", "largest", "onemore", "exchanged"], "a camera may be anywhere"),
    ("cameraPosition.y", &["zero", "largest", "onemore", "exchanged"], "a camera may be anywhere"),
    ("cameraPosition.z", &["zero", "largest", "onemore"], "a camera may be anywhere"),
    ("fpMessage", &["zero"], "that nobody listens is a choice"),
    ("debugLevel", &["zero", "largest", "onemore"], "how much is said is a choice"),
    ("maxRenderSize.width", &["onemore"], "frames may be smaller than the largest"),
    ("maxRenderSize.height", &["onemore"], "frames may be smaller than the largest"),
    ("maxUpscaleSize.width", &["onemore"], "frames may be smaller than the largest"),
    ("maxUpscaleSize.height", &["onemore"], "frames may be smaller than the largest"),
    ("version", &["onemore"], "the next release is there too"),
];

/// The reason for the camera's lens parameters.
const POSSIBLE: &str = "another camera has it, and the double's picture does not depend on the camera";

#[test]
fn every_changed_field_is_detected_or_has_no_effect() {
    let scene = Scene::new();
    let mut report = Report::default();
    for (role, family, prepare_structs) in [
        (["sdk 2.1", ML, "quiet", "survives"], Family::Ml, struct_table::prepare_structs_v2()),
        (["sdk 2.0", ANALYTIC_20, "quiet", "survives"], Family::Analytic, struct_table::prepare_structs()),
    ] {
        let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &role);
        let api = api(&double, LibraryKind::FrameGeneration);
        let mut generator = scene.generator(&api, family).expect("a generator");
        let truth = scene.pair(&mut generator, None).expect("generated");
        assert_eq!(scene.pair(&mut generator, None).expect("generated"), truth, "it does the same each time");
        assert_eq!(double.violations(), [""; 0]);
        let mut verdicts = 0;
        // Structs that all releases share are tested once.
        let frame_structs = if family == Family::Ml { struct_table::frame_structs() } else { Vec::new() };
        for (name, mutant) in prepare_structs.iter().chain(&frame_structs).flat_map(mutants_of) {
            let found = try_mutant(&double, &truth, &mut verdicts, || scene.pair(&mut generator, Some(mutant)));
            found.into_iter().for_each(|found| report.add(name.clone(), found));
        }
        assert_eq!(scene.pair(&mut generator, None).expect("generated"), truth, "nothing of them is left");
        if family == Family::Ml {
            for (name, mutant) in struct_table::creation_structs().iter().flat_map(mutants_of) {
                let found = try_mutant(&double, &truth, &mut verdicts, || {
                    shim().mutant = Some(mutant);
                    let made = scene.generator(&api, family);
                    shim().mutant = None;
                    // A rejected call needs no picture.
                    if shim().refused { made.map(|_| Vec::new()) } else { scene.pair(&mut made?, None) }
                });
                found.into_iter().for_each(|found| report.add(name.clone(), found));
            }
        }
    }
    mutants_upscale::try_all(&mut report);
    println!("mutants: {:?}", report.counts);
    let reason = |name: &str| {
        let (field, change) = name.split_once('.')?.1.split_once(' ')?;
        let is_it = |entry: &&(&str, &[&str], &str)| entry.0 == field && entry.1.contains(&change);
        UNNOTICED.iter().find(is_it).map(|(_, _, why)| *why)
    };
    for name in &report.missed {
        println!("not noticed: {name}: {}", reason(name).unwrap_or("?"));
    }
    let unexplained: Vec<_> = report.missed.iter().filter(|name| reason(name).is_none()).collect();
    assert!(unexplained.is_empty(), "{unexplained:?}");
    let listed =
        UNNOTICED.iter().flat_map(|(field, changes, _)| changes.iter().map(move |change| format!(".{field} {change}")));
    let stale: Vec<_> = listed.filter(|entry| !report.missed.iter().any(|name| name.ends_with(entry))).collect();
    assert!(stale.is_empty(), "these are noticed: {stale:?}");
    assert!(scene.gpu.removed().is_none());
}

/// Separates accesses of a texture that dispatches before and after it write.
fn write_barrier(list: &ID3D12GraphicsCommandList, texture: &ID3D12Resource) {
    let barrier = D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_UAV,
        Anonymous: D3D12_RESOURCE_BARRIER_0 {
            UAV: std::mem::ManuallyDrop::new(D3D12_RESOURCE_UAV_BARRIER { pResource: borrowed(texture) }),
        },
        ..Default::default()
    };
    // SAFETY: an open list and a live texture.
    unsafe { list.ResourceBarrier(&[barrier]) };
}
