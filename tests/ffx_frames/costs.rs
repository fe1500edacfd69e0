//! Costs of a frame in addition to the provider's: allocations, time and memory.

use std::time::{Duration, Instant};

use cairn::ffx::memory_needed;
use cairn::gpu::windows::core::Interface;
use test_support::allocations::{CountingAllocator, allocations};

use super::*;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn frames_are_recorded_without_allocating() {
    for release in [["sdk 2.0", ANALYTIC_20, "quiet"], ["sdk 2.1", ML, "quiet"]] {
        let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &release);
        let (gpu, library) = (gpu(), double.load().expect("loaded"));
        let mut generator =
            made(&gpu, &library, &TextureOptions { detect_pass_through: true, ..options() }).expect("a generator");
        let textures = panning(&gpu);
        textures.fill(&textures.color, moved(0));
        let lens =
            writable_texture(&gpu, (SIZE.width, SIZE.height), DXGI_FORMAT_R16G16_FLOAT, D3D12_RESOURCE_STATE_COMMON);
        textures.fill(&lens, |_, _| halves(0.0, 0.0));
        // All optional inputs, and a target that is copied to.
        let wanted =
            resources::texture_desc((SIZE.width, SIZE.height), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_FLAG_NONE);
        let state = D3D12_RESOURCE_STATE_COMMON;
        let target =
            TestResource { resource: resources::create_resource(&gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state };
        let pictures = GenerationTextures {
            output: target.with_state(),
            hudless: Some(textures.color.with_state()),
            distortion: Some(lens.with_state()),
            ..of(&textures)
        };
        let (mut counts, mut quickest) = (Vec::new(), Duration::MAX);
        for _ in 0..12 {
            let (before, start) = (allocations(), Instant::now());
            let fence_point = generator.generate(&pictures, &FrameParams::of(SIZE)).expect("generated");
            quickest = quickest.min(start.elapsed());
            counts.push(allocations() - before);
            fence_point.wait().expect("it has run");
            _ = generator.last_check();
        }
        println!("{}: generated in {quickest:?} with the double and Direct3D; allocations {counts:?}", release[0]);
        assert_eq!(counts[4..], [0; 8], "{}", release[0]);
        assert_eq!(double.violations(), [""; 0]);
    }
}

#[test]
fn memory_is_reported_before_and_after_creation_if_the_release_can() {
    let gpu = gpu();
    for (part, release, before, afterwards) in [
        (LibraryKind::Whole, ["sdk 1.1.0", ANALYTIC_20], false, false),
        (LibraryKind::Whole, ["sdk 1.1.4", ANALYTIC_20], false, true),
        (LibraryKind::FrameGeneration, ["sdk 2.0", ANALYTIC_20], true, true),
        (LibraryKind::FrameGeneration, ["sdk 2.1", ML], true, true),
    ] {
        let double = DoubleFolder::empty().with(part, &release);
        let library = double.load().expect("loaded");
        let api = library.api(Effect::FrameGeneration).expect("there");
        let large = Dimensions { width: 2 * SIZE.width, height: 2 * SIZE.height };
        let mut last = 0;
        for size in [SIZE, large] {
            let wanted =
                TextureOptions { self_test: false, ..TextureOptions::new(size, size, SurfaceFormat::R8G8B8A8_UNORM) };
            // SAFETY: a live device.
            let needed = unsafe { memory_needed(api, gpu.device().as_raw(), &wanted.head, None) }.expect("an answer");
            let mut generator = made(&gpu, &library, &wanted).expect("a generator");
            let memory = generator.memory().expect("an answer");
            assert_eq!((needed.is_some(), memory.provider.is_some()), (before, afterwards), "{}", release[0]);
            if let Some(reported) = memory.provider {
                assert!(reported.total > last && reported.aliasable <= reported.total, "{reported:?}");
                assert!(needed.is_none_or(|needed| needed.total == reported.total), "{needed:?} {reported:?}");
                last = reported.total;
            }
            assert!(memory.own >= u64::from(4 * size.width * size.height), "{memory:?}");
        }
        assert_eq!(double.violations(), [""; 0]);
    }
}
