//! An engine releases or changes resources while frames are in flight.

use super::*;

/// Blocks the frame queue until it is opened. Keep it until the queue has finished: a driver may still access a fence that its
/// queue waits for after the CPU has signalled it.
struct Gate(ID3D12Fence);

impl Gate {
    fn before(gpu: &Gpu) -> Self {
        // SAFETY: values only.
        let fence: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
        let gate = FencePoint::of_engine(gpu, &fence, 1).expect("its own");
        gpu.frames().wait(&gate).expect("it waits");
        Self(fence)
    }

    fn open(&self) {
        // SAFETY: a live fence.
        unsafe { self.0.Signal(1) }.expect("a signal");
    }
}

#[test]
fn a_target_released_by_the_engine_is_held_until_its_frame_has_run() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    let textures = panning(&gpu);
    textures.fill(&textures.color, moved(0));
    let wanted =
        resources::texture_desc((SIZE.width, SIZE.height), DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_FLAG_NONE);
    let targets = [
        &wanted,
        &resources::texture_desc(
            (SIZE.width, SIZE.height),
            DXGI_FORMAT_R8G8B8A8_UNORM,
            D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS,
        ),
    ]
    .map(|wanted| {
        let state = D3D12_RESOURCE_STATE_COMMON;
        TestResource { resource: resources::create_resource(&gpu, D3D12_HEAP_TYPE_DEFAULT, wanted, state), state }
    });
    for target in targets {
        let own = engine::reference_count(&target.resource);
        let gate = Gate::before(&gpu);
        let fence_point = generator
            .generate(&GenerationTextures { output: target.with_state(), ..of(&textures) }, &FrameParams::of(SIZE))
            .expect("generated");
        // The frame holds a reference of its own.
        assert!(engine::reference_count(&target.resource) > own, "it is held");
        gate.open();
        fence_point.wait().expect("it has run");
        // Until the ring reuses the frame's slot.
        for _ in 0..3 {
            generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated").wait().expect("it has run");
        }
        engine::wait_for_counts(|| [engine::reference_count(&target.resource)], [own]);
    }
    // All are released, with the generator, while the frame waits.
    let gate = Gate::before(&gpu);
    _ = generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated");
    drop(textures);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(std::time::Duration::from_millis(50));
            gate.open();
        });
        drop(generator);
    });
    assert!(gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn sizes_may_change_from_frame_to_frame() {
    double_folder::in_new_process("faults::sizes_may_change_from_frame_to_frame", change_sizes);
}

fn change_sizes() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    // Changing render sizes, as with dynamic resolution: the history is kept from frame to frame.
    let mut generator = made(&gpu, &library, &options()).expect("a generator");
    let textures = panning(&gpu);
    for (number, part) in [1, 2, 1, 4, 2, 1].into_iter().enumerate() {
        let rendered = Dimensions { width: SIZE.width / part, height: SIZE.height / part };
        let small = Textures::new(&gpu, rendered);
        small.fill(&small.depth, |_, _| 0.5_f32.to_le_bytes());
        small.fill(&small.motion, |_, _| halves(-STEP as f32 / part as f32, 0.0));
        let at = STEP * i32::try_from(number).expect("small");
        textures.fill(&textures.color, moved(at));
        let pictures =
            GenerationTextures { depth: small.depth.with_state(), motion: small.motion.with_state(), ..of(&textures) };
        generator.generate(&pictures, &FrameParams::of(rendered)).expect("generated").wait().expect("it has run");
        if number > 0 {
            let error = off(&textures.generated(), INNER, moved(at - HALF));
            assert!(error <= 2, "frame {number}, rendered at 1/{part}: {error}");
        }
    }
    // Another display size: a new generator, while frames of the previous one are in flight.
    let gate = Gate::before(&gpu);
    _ = generator.generate(&of(&textures), &FrameParams::of(SIZE)).expect("generated");
    let size = Dimensions { width: SIZE.width / 2, height: SIZE.height * 3 / 4 };
    let mut smaller = made(
        &gpu,
        &library,
        &TextureOptions { self_test: false, ..TextureOptions::new(size, size, SurfaceFormat::R8G8B8A8_UNORM) },
    )
    .expect("a generator");
    let small = Textures::new(&gpu, size);
    gate.open();
    small.fill(&small.depth, |_, _| 0.5_f32.to_le_bytes());
    let pictures = of(&small);
    for number in [0, 1] {
        small.fill(&small.color, moved(number));
        smaller.generate(&pictures, &FrameParams::of(size)).expect("generated").wait().expect("it has run");
    }
    let refused = smaller.generate(&of(&textures), &FrameParams::of(size)).expect_err("of the size before");
    assert_eq!(refused.offending_field(), Some("color"));
    drop(generator);
    assert!(gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn two_generators_on_one_device_do_not_disturb_one_another() {
    double_folder::in_new_process("faults::two_generators_on_one_device_do_not_disturb_one_another", run_two);
}

fn run_two() {
    let (double, library) = set_up_double(&[]);
    let gpu = gpu();
    std::thread::scope(|scope| {
        for direction in [1, -1] {
            let (gpu, library) = (&gpu, &library);
            scope.spawn(move || {
                let mut generator = made(gpu, library, &options()).expect("a generator");
                let textures = panning(gpu);
                textures.fill(&textures.motion, |_, _| halves(-(STEP * direction) as f32, 0.0));
                for number in 0..6 {
                    textures.fill(&textures.color, moved(STEP * direction * number));
                    let params = FrameParams { reset: number == 0, ..FrameParams::of(SIZE) };
                    generator.generate(&of(&textures), &params).expect("generated").wait().expect("it has run");
                    if number > 0 {
                        let error = off(&textures.generated(), INNER, moved(direction * (STEP * number - HALF)));
                        assert!(error <= 2, "direction {direction}, frame {number}: {error}");
                    }
                }
            });
        }
    });
    assert!(gpu.removed().is_none());
    assert_eq!(double.violations(), [""; 0]);
}
