//! A world on a test's device, whose memory the host cannot read, gives the bits of the processor.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

use super::{Rollout, worlds};
use crate::bundle::Precision;
use crate::runtime::fake::{self, FakeCounts};
use crate::runtime::{CpuOptions, Device};
use crate::world::{World, WorldOptions};

const CPU: CpuOptions = CpuOptions { threads: Some(2), deterministic: true };

fn load(device: &Device) -> Arc<World> {
    let options = WorldOptions { precision: Some(Precision::F32), ..WorldOptions::default() };
    World::load(device, &worlds::bundle("tiny"), options).expect("a world")
}

/// Appends, steps, saves, restores, rests and resets; returns the bits of every state, and the bytes that each step moved.
fn play(world: &Arc<World>, counts: &FakeCounts) -> (Vec<Vec<u8>>, Vec<(u64, u64)>) {
    let (mut bits, mut moved) = (Vec::new(), Vec::new());
    let mut steps = |rollout: &mut Rollout, bits: &mut Vec<Vec<u8>>, numbers: std::ops::Range<u64>| {
        for i in numbers {
            let before = counts.waits.load(Relaxed);
            let info = rollout.step(&worlds::controls(i)).expect("a step");
            assert_eq!(info.bytes.read, 0, "step {i} reads nothing back");
            // For its finite check.
            assert!(counts.waits.load(Relaxed) - before <= 1, "step {i} waits once");
            moved.push((info.bytes.uploaded, info.bytes.copied));
            bits.push(worlds::fingerprint(rollout).expect("bits"));
        }
    };
    let mut rollout = worlds::seeded(world, &worlds::point(world), 7);
    bits.push(worlds::fingerprint(&mut rollout).expect("bits"));
    steps(&mut rollout, &mut bits, 0..3);
    rollout.append(&worlds::picture(20, 10, 2)).expect("another picture");
    let saved = rollout.save().expect("a state");
    steps(&mut rollout, &mut bits, 3..5);
    rollout.rest().expect("a rest");
    steps(&mut rollout, &mut bits, 5..6);
    rollout.restore(&saved).expect("its own state");
    steps(&mut rollout, &mut bits, 3..5);
    let mut other = Rollout::new(world, &worlds::point(world), 1).expect("a rollout");
    other.restore(&saved).expect("the state fits");
    steps(&mut other, &mut bits, 3..5);
    rollout.reset().expect("a reset");
    bits.push(rollout.save().expect("a state"));
    (bits, moved)
}

#[test]
fn a_device_whose_memory_cannot_be_read_gives_the_bits_of_the_processor() {
    let counts = Arc::new(FakeCounts::default());
    let ort = worlds::ort();
    let fake = fake::device(&ort, CPU, &counts).expect("a device");
    assert!(fake.is_gpu() && fake.available_memory().is_none());
    let (found, moved) = play(&load(&fake), &counts);
    let (expected, moved_on_cpu) = play(&load(&Device::cpu(&ort, CPU).expect("a CPU device")), &FakeCounts::default());
    assert_eq!(found.len(), expected.len());
    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert!(found == expected, "state {i} has other bits");
    }
    // A restored state continues with the same bits.
    assert!(expected[4..6] == expected[7..9] && expected[4..6] == expected[9..11]);
    assert_eq!(moved, moved_on_cpu, "bytes uploaded and copied in each step");
    // Each step runs four denoise passes, a cache pass and the decoder.
    let runs = counts.runs.load(Relaxed);
    assert!(runs >= moved.len() as u64 * 6, "{runs} runs in {} steps", moved.len());
    assert!(counts.longest_queue.load(Relaxed) > 6, "a step's work is submitted before it is waited for");
}
