//! The processor time of recording a frame with FSR, without AMD's library: `cargo bench --bench fsr`.
//!
//! A stub that does nothing replaces AMD's library, so that only Cairn's part is measured: checking and writing every field, in the structs
//! of both kinds of release. The result is in microseconds per frame, with the budget of 20 and the number of allocations.
//! Without `--bench`, as under `cargo test`, everything runs a few times and nothing is measured.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ffi::{CStr, c_char, c_void};
use std::time::Instant;

use cairn::ffx::bindings::{
    CreateFrameGeneration, Dimensions, Resource, ResourceDescription, ResourceState, ResourceType, SurfaceFormat,
};
use cairn::ffx::{Api, Choice, Family, Frame, FrameParams, Generator};

/// Frames in one measurement. The shortest of many measurements counts, because other load only adds time.
const FRAMES: u32 = 2_000;
const MEASUREMENTS: u32 = 50;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: the system's allocator, unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

unsafe extern "C" fn create(context: *mut *mut c_void, _: *mut c_void, _: *const c_void) -> u32 {
    // SAFETY: memory for the context.
    unsafe { *context = std::ptr::dangling_mut() };
    0
}

unsafe extern "C" fn destroy(_: *mut *mut c_void, _: *const c_void) -> u32 {
    0
}

/// Accepts configurations and dispatches.
unsafe extern "C" fn accept(_: *mut *mut c_void, _: *const c_void) -> u32 {
    0
}

/// Answers the query for versions with one version of each kind, and refuses other queries.
unsafe extern "C" fn query(_: *mut *mut c_void, head: *mut u8) -> u32 {
    const GET_VERSIONS: u64 = 4;
    const UNKNOWN_STRUCT: u32 = 2;
    let offers: [(u64, &CStr); 2] = [(0xf600_0000_0100_0001, c"4.0.1"), (0xf600_0000_00c0_1005, c"3.1.5")];
    // SAFETY: the id at 0; the count, the ids and the names at 32, 40 and 48, with room for more than two.
    unsafe {
        if head.cast::<u64>().read() != GET_VERSIONS {
            return UNKNOWN_STRUCT;
        }
        let (ids, names) = (*head.add(40).cast::<*mut u64>(), *head.add(48).cast::<*mut *const c_char>());
        for (index, (id, name)) in offers.into_iter().enumerate() {
            *ids.add(index) = id;
            *names.add(index) = name.as_ptr();
        }
        **head.add(32).cast::<*mut u64>() = offers.len() as u64;
    }
    0
}

fn api() -> Api {
    let find = |name: &CStr| match name.to_bytes() {
        b"ffxCreateContext" => create as *const c_void,
        b"ffxDestroyContext" => destroy as *const c_void,
        b"ffxQuery" => query as *const c_void,
        _ => accept as *const c_void,
    };
    // SAFETY: functions of these types, which stay.
    unsafe { Api::from_exports(find) }.expect("all are there")
}

fn main() -> cairn::Result<()> {
    let is_measured = std::env::args().any(|arg| arg == "--bench");
    let (frames, measurements) = if is_measured { (FRAMES, MEASUREMENTS) } else { (3, 1) };
    let size = Dimensions { width: 1920, height: 1080 };
    let head = CreateFrameGeneration {
        display_size: size,
        max_render_size: size,
        back_buffer_format: SurfaceFormat::R8G8B8A8_UNORM,
        ..Default::default()
    };
    // The addresses are never dereferenced.
    let resource = |address: usize, format| Resource {
        resource: std::ptr::without_provenance_mut(address),
        description: ResourceDescription {
            kind: ResourceType::TEXTURE_2D,
            format,
            width: size.width,
            height: size.height,
            depth: 1,
            mips: 1,
            ..Default::default()
        },
        state: ResourceState::COMPUTE_READ,
    };
    let frame = Frame {
        command_list: std::ptr::dangling_mut(),
        color: resource(0x100, SurfaceFormat::R8G8B8A8_UNORM),
        output: resource(0x200, SurfaceFormat::R8G8B8A8_UNORM),
        depth: resource(0x300, SurfaceFormat::R32_FLOAT),
        motion: resource(0x400, SurfaceFormat::R16G16_FLOAT),
        hudless: resource(0x500, SurfaceFormat::R8G8B8A8_UNORM),
        distortion: resource(0x600, SurfaceFormat::R16G16_FLOAT),
        params: FrameParams::of(size),
    };
    for (name, family) in [("motion and depth in one struct", Family::Ml), ("the camera apart", Family::Analytic)] {
        // SAFETY: the stub dereferences no address.
        let mut generator =
            unsafe { Generator::create(&api(), std::ptr::dangling_mut(), Choice::Require(family), head, None) }?;
        // SAFETY: as above, here and below. The first call allocates the settings for lens distortion.
        unsafe { generator.record(&frame) }?;
        let before = ALLOCATIONS.get();
        let mut best = f64::INFINITY;
        for _ in 0..measurements {
            let start = Instant::now();
            for _ in 0..frames {
                // SAFETY: as above.
                unsafe { generator.record(&frame) }?;
            }
            best = best.min(start.elapsed().as_secs_f64() / f64::from(frames));
        }
        let allocations = ALLOCATIONS.get() - before;
        if is_measured {
            let micros = best * 1e6;
            println!("record, {name}: {micros:.2} us, {:.3} of the budget, {allocations} allocations", micros / 20.0);
        }
    }
    Ok(())
}
