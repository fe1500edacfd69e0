//! Costs of a frame beside the provider's: allocations, time and memory.

use std::time::{Duration, Instant};

use cairn::ffx::memory_needed;
use cairn::gpu::windows::core::Interface;

use super::*;

#[path = "../d3d12/allocations.rs"]
mod allocations;
use allocations::ALLOCATIONS;

#[test]
fn frames_are_recorded_without_allocating() {
    for release in [["sdk 2.0", ANALYTIC_20, "quiet"], ["sdk 2.1", ML, "quiet"]] {
        let stage = Stage::empty().with(Part::FrameGeneration, &release);
        let (gpu, library) = (gpu(), stage.load().expect("loaded"));
        let mut generator = made(&gpu, &library, &TextureOptions { watch: true, ..options() }).expect("a generator");
        let textures = panning(&gpu);
        textures.fill(&textures.color, moved(0));
        let lens = texture(&gpu, (SIZE.width, SIZE.height), DXGI_FORMAT_R16G16_FLOAT, D3D12_RESOURCE_STATE_COMMON);
        textures.fill(&lens, |_, _| halves(0.0, 0.0));
        // All optional inputs, and a target that is copied to.
        let wanted = pictures::flat((SIZE.width, SIZE.height), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_FLAG_NONE);
        let state = D3D12_RESOURCE_STATE_COMMON;
        let target = Kept { resource: pictures::made(&gpu, D3D12_HEAP_TYPE_DEFAULT, &wanted, state), state };
        let pictures = Pictures {
            output: target.resting(),
            hudless: Some(textures.color.resting()),
            distortion: Some(lens.resting()),
            ..of(&textures)
        };
        let (mut counts, mut quickest) = (Vec::new(), Duration::MAX);
        for _ in 0..12 {
            let (before, start) = (ALLOCATIONS.get(), Instant::now());
            let fence_point = generator.generate(&pictures, &FrameParams::of(SIZE)).expect("generated");
            quickest = quickest.min(start.elapsed());
            counts.push(ALLOCATIONS.get() - before);
            fence_point.wait().expect("it has run");
            _ = generator.seen();
        }
        println!("{}: generated in {quickest:?} with the double and Direct3D; allocations {counts:?}", release[0]);
        assert_eq!(counts[4..], [0; 8], "{}", release[0]);
        assert_eq!(stage.judgement(), [""; 0]);
    }
}

#[test]
fn memory_is_reported_before_and_afterwards_where_the_release_can_say() {
    let gpu = gpu();
    for (part, release, before, afterwards) in [
        (Part::Whole, ["sdk 1.1.0", ANALYTIC_20], false, false),
        (Part::Whole, ["sdk 1.1.4", ANALYTIC_20], false, true),
        (Part::FrameGeneration, ["sdk 2.0", ANALYTIC_20], true, true),
        (Part::FrameGeneration, ["sdk 2.1", ML], true, true),
    ] {
        let stage = Stage::empty().with(part, &release);
        let library = stage.load().expect("loaded");
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
            if let Some(told) = memory.provider {
                assert!(told.total > last && told.aliasable <= told.total, "{told:?}");
                assert!(needed.is_none_or(|needed| needed.total == told.total), "{needed:?} {told:?}");
                last = told.total;
            }
            assert!(memory.own >= u64::from(4 * size.width * size.height), "{memory:?}");
        }
        assert_eq!(stage.judgement(), [""; 0]);
    }
}
