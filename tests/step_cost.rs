//! The cost of a latent step besides ONNX Runtime's own work: transferred bytes and allocations.

use cairn::Picture;
use cairn::bundle::Precision;
use cairn::world::{CacheMode, OperatingPoint, World, WorldOptions};
use test_support::allocations::{CountingAllocator, allocations};
use test_support::worlds::{self, controls, point, seeded, world};

// ONNX Runtime has an allocator of its own.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn a_latent_step_allocates_nothing_once_warm() {
    let (device, bundle) = (worlds::device(), worlds::bundle("tiny"));
    for precision in [Precision::F32, Precision::F16] {
        let options = WorldOptions { precision: Some(precision), ..Default::default() };
        let world = World::load(&device, &bundle, options).expect("a world");
        let joined = WorldOptions { precision: Some(precision), joined: true, ..Default::default() };
        let joined = World::load(&device, &worlds::bundle("joined"), joined).expect("a world");
        for (world, cache_mode) in [
            (&world, CacheMode::Separate),
            (&world, CacheMode::Fused),
            (&world, CacheMode::Interval(2)),
            (&joined, CacheMode::Joined),
        ] {
            let mut rollout = seeded(world, &OperatingPoint { cache_mode, pictures_per_latent: 4, ..point(world) }, 1);
            let mut picture = Picture::new(1, 1).expect("a picture");
            let mut cost = Vec::with_capacity(12);
            for i in 0..12 {
                let input = controls(i);
                let before = allocations();
                rollout.step(&input).expect("a step");
                for i in 0..4 {
                    rollout.read_picture(i, &mut picture).expect("a picture");
                }
                assert!(rollout.latent().expect("a latent").iter().all(|v| v.is_finite()));
                cost.push(allocations() - before);
            }
            // Three of twelve warm up: they cross a write step of the global layers and both latents of an interval.
            assert_eq!(cost[3..], [0; 9], "{precision:?}, {cache_mode}: {cost:?}");
        }
    }
}

#[test]
fn a_latent_step_transfers_only_the_new_slabs_and_its_inputs() {
    for name in ["tiny", "window"] {
        let (world, bundle) = (world(name), worlds::bundle(name));
        let g = bundle.geometry().clone();
        let mut rollout = seeded(&world, &point(&world), 1);
        let latent = g.latent_len() as u64 * 4;
        let rope = 2 * u64::from(g.tokens * g.head_width / 2) * 4;
        let keys = |buckets: u32| u64::from((buckets + 1) * g.tokens) * 4;
        let masks = keys(g.local.window) + keys(g.global.window / g.global.dilation);
        let (passes, controls_bytes) = (5, bundle.manifest().controls.len() as u64 * 4);
        // Six vectors for each layer, and two for the output.
        let conditioning = u64::from((6 * g.layers + 2) * g.width) * 4;
        for i in 0..20 {
            let plan = rollout.planner().plan_step(&controls(i)).expect("a plan");
            let info = rollout.step(&controls(i)).expect("a step");
            assert_eq!(info.bytes.read, 0, "nothing is read back unless requested");
            // The conditioning of the schedule was uploaded when the rollout was made.
            assert_eq!(info.bytes.uploaded, latent + rope + masks + controls_bytes + passes * 8);
            assert_eq!(info.bytes.copied, info.ring_bytes + latent + passes * (4 + conditioning));
            let slab = u64::from(g.kv_heads * g.tokens * g.head_width) * 4;
            let layers = (0..g.layers).filter(|&layer| !g.is_global(layer) || plan.global.slot.is_some()).count();
            assert_eq!(info.ring_bytes, layers as u64 * 2 * slab, "{name}, latent {i}");
        }
    }
}
