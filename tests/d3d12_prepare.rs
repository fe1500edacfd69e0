//! A presenter's preparation on a loading thread, after which its frames create no objects. On Windows, or in the lab.
#![cfg(windows)]

use std::ffi::c_void;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use cairn::Picture;
use cairn::abi::anchor::{cairn_anchor, cairn_anchor_create, cairn_anchor_destroy};
use cairn::abi::d3d12::{
    CAIRN_MAX_LISTS, CAIRN_PREPARE_SUBMIT_ONLY, cairn_d3d12_preparation, cairn_d3d12_recording,
    cairn_device_create_d3d12, cairn_presenter_prepare_d3d12, cairn_presenter_record_d3d12,
    cairn_presenter_submit_d3d12,
};
use cairn::abi::device::{cairn_device, cairn_device_destroy};
use cairn::abi::images::cairn_picture;
use cairn::abi::presenter::*;
use cairn::abi::results::*;
use cairn::abi::statistics::{cairn_presenter_get_statistics, cairn_presenter_statistics};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::core::Interface;
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::d3d12::engine::Engine;
use test_support::d3d12::object_counts::{self, CreatedObjects};
use test_support::d3d12::textures::{self, Recording, TextureDesc};
use test_support::worlds;

/// Anchors' size.
const SIZE: (u32, u32) = (75, 46);
/// Another size of frames.
const LARGE: (u32, u32) = (150, 92);
/// Nanoseconds between anchors.
const INTERVAL: u64 = 100_000_000;
const REST: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_COMMON;

/// Lets one test run at a time: they share the hooks.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An engine with a presenter whose anchors arrive on time.
struct Host {
    engine: Engine,
    device: *mut cairn_device,
    presenter: *mut cairn_presenter,
    anchors: u64,
}

/// A presenter for use on a loading thread.
#[derive(Clone, Copy)]
struct Handles(*mut cairn_presenter, *mut cairn_device);

// SAFETY: handles are numbers.
unsafe impl Send for Handles {}

impl Handles {
    fn prepare(self, wanted: &cairn_d3d12_preparation) -> cairn_result {
        // SAFETY: live handles, and a struct that lives during the call.
        unsafe { cairn_presenter_prepare_d3d12(self.0, self.1, wanted) }
    }
}

fn preparation() -> cairn_d3d12_preparation {
    with_struct_size(|wanted: &mut cairn_d3d12_preparation| &mut wanted.struct_size)
}

fn device_of(engine: &Engine) -> *mut cairn_device {
    let (device, queue) = (engine.device.as_raw().cast(), engine.direct.as_raw().cast());
    // SAFETY: live objects and a variable for the handle.
    create_handle(|to| unsafe { cairn_device_create_d3d12(device, queue, null_mut(), &tool_device_options(), to) })
}

impl Host {
    fn new(shader: u32, size: (u32, u32), motion: u32) -> Self {
        let engine = Engine::create();
        object_counts::install(&engine.device);
        let device = device_of(&engine);
        let mut options: cairn_presenter_options =
            with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
        (options.multiplier, options.interval_ns, options.shader, options.motion) = (4, INTERVAL, shader, motion);
        (options.width, options.height) = size;
        // SAFETY: options of their size and a variable for the handle.
        let presenter = create_handle(|to| unsafe { cairn_presenter_create(&options, to) });
        let mut host = Self { engine, device, presenter, anchors: 0 };
        (0..2).for_each(|_| host.push());
        host
    }

    fn push(&mut self) {
        let picture = anchor_picture(self.anchors);
        let mut given: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
        (given.width, given.height) = SIZE;
        (given.pixels, given.size) = (picture.rgba().as_ptr().cast(), picture.rgba().len() as u64);
        // SAFETY: a picture that lives during the call, and a variable for the handle.
        let anchor: *mut cairn_anchor = create_handle(|to| unsafe { cairn_anchor_create(&given, self.anchors, 0, to) });
        let now = self.anchors * INTERVAL;
        // SAFETY: live handles.
        let pushed = unsafe { cairn_presenter_push(self.presenter, anchor, std::ptr::null(), now) };
        // SAFETY: a live handle.
        assert_eq!([pushed, unsafe { cairn_anchor_destroy(anchor) }], [CAIRN_OK; 2]);
        self.anchors += 1;
    }

    fn shared(&self) -> Handles {
        Handles(self.presenter, self.device)
    }

    /// Prepares the presenter as an engine does, on another thread.
    fn prepare(&self, wanted: cairn_d3d12_preparation) {
        let shared = self.shared();
        let wanted = SendPreparation(wanted);
        let result = std::thread::scope(|scope| scope.spawn(move || wanted.prepare(shared)).join());
        assert_eq!(result.expect("it returns"), CAIRN_OK);
    }

    /// The frame at `now` in a texture of that size and format, recorded or (if `own`) submitted, the objects that this thread created for it, and
    /// its pixels.
    fn frame(
        &self,
        now: u64,
        size: (u32, u32),
        format: DXGI_FORMAT,
        own: bool,
    ) -> (cairn_frame, CreatedObjects, Vec<u8>) {
        let texture = TextureDesc { size, format, ..TextureDesc::default() }.create(&self.engine.device);
        let target = texture.as_raw().cast();
        let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
        let (presenter, device) = (self.presenter, self.device);
        let made = if own {
            let (mut fence, mut value) = (null_mut(), 0);
            // SAFETY: live handles and objects, and variables for the results.
            let (result, made) = object_counts::count_created(|| unsafe {
                cairn_presenter_submit_d3d12(presenter, device, now, target, 0, 0, &mut frame, &mut fence, &mut value)
            });
            assert_eq!(result, CAIRN_OK);
            // SAFETY: a reference for us.
            drop(unsafe { ID3D12Fence::from_raw(fence.cast()) });
            made
        } else {
            let list = Recording::on(&self.engine.device, &self.engine.direct);
            let mut recording: cairn_d3d12_recording =
                with_struct_size(|recording: &mut cairn_d3d12_recording| &mut recording.struct_size);
            (recording.list, recording.target) = (list.list().as_raw().cast(), target);
            (recording.fence, recording.fence_value) = (list.fence().as_raw().cast(), 1);
            // SAFETY: live handles and objects, and a variable for the frame.
            let (result, made) = object_counts::count_created(|| unsafe {
                cairn_presenter_record_d3d12(presenter, device, now, &recording, &mut frame)
            });
            assert_eq!(result, CAIRN_OK);
            list.submit(&self.engine.direct);
            textures::wait(&self.engine.device, &self.engine.direct);
            made
        };
        (frame, made, textures::read(&self.engine.device, &self.engine.direct, &texture, REST))
    }

    fn statistics(&self) -> cairn_presenter_statistics {
        let mut done: cairn_presenter_statistics =
            with_struct_size(|done: &mut cairn_presenter_statistics| &mut done.struct_size);
        // SAFETY: a live handle, and a variable for the figures.
        assert_eq!(unsafe { cairn_presenter_get_statistics(self.presenter, &mut done) }, CAIRN_OK);
        done
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // SAFETY: live handles.
        let ended = unsafe { [cairn_presenter_destroy(self.presenter), cairn_device_destroy(self.device)] };
        assert_eq!(ended, [CAIRN_OK; 2]);
    }
}

/// A preparation for another thread.
struct SendPreparation(cairn_d3d12_preparation);

// SAFETY: the pointers in it are shared between threads as the test describes.
unsafe impl Send for SendPreparation {}

impl SendPreparation {
    fn prepare(self, shared: Handles) -> cairn_result {
        shared.prepare(&self.0)
    }
}

fn anchor_picture(number: u64) -> Picture {
    let mut picture = worlds::picture(SIZE.0, SIZE.1, 1);
    let shift = 3 * number as usize % SIZE.0 as usize;
    picture.rgba_mut().chunks_exact_mut(4 * SIZE.0 as usize).for_each(|row| row.rotate_left(4 * shift));
    picture
}

fn text(text: &[std::ffi::c_char]) -> String {
    let bytes: Vec<u8> = text.iter().take_while(|c| **c != 0).map(|c| c.cast_unsigned()).collect();
    String::from_utf8(bytes).expect("text")
}

#[test]
fn prepared_frames_create_no_objects() {
    let _alone = alone();
    let (plain, halves) = (DXGI_FORMAT_R8G8B8A8_UNORM, DXGI_FORMAT_R16G16B16A16_FLOAT);
    for (shader, size, format) in [
        (CAIRN_PREFER_AUTO, SIZE, plain),
        (CAIRN_PREFER_AUTO, LARGE, plain),
        (CAIRN_PREFER_AUTO, LARGE, halves),
        (CAIRN_PREFER_NEVER, LARGE, plain),
    ] {
        let mut host = Host::new(shader, if size == SIZE { (0, 0) } else { size }, 0);
        host.prepare(cairn_d3d12_preparation { format: format.0.cast_unsigned(), ..preparation() });
        for quarter in 4..24 {
            if quarter % 4 == 0 && quarter > 4 {
                host.push();
            }
            if quarter == 13 {
                // The overlay mask is set and removed.
                let mask = vec![1_u8; (SIZE.0 * SIZE.1) as usize];
                // SAFETY: a live handle, and a mask that lives during the call.
                let set =
                    unsafe { cairn_presenter_set_overlay(host.presenter, mask.as_ptr(), mask.len(), SIZE.0, SIZE.1) };
                assert_eq!(set, CAIRN_OK);
            }
            let (frame, made, _) = host.frame(quarter * INTERVAL / 4, size, format, quarter % 2 == 1);
            let what = format!("{size:?}, frame {quarter}: {frame:?}");
            assert_eq!((made, frame.flags & CAIRN_FRAME_UNPREPARED), (CreatedObjects::default(), 0), "{what}");
        }
        let done = host.statistics();
        assert_eq!((done.objects_made, done.unprepared), (0, 0));
        assert!(done.shown_generated >= 12, "{}", done.shown_generated);
        let expected = if shader == CAIRN_PREFER_AUTO { "shader" } else { "cpu" };
        assert_eq!(text(&done.generator), expected);
    }
}

#[test]
fn unprepared_frames_show_anchors_and_create_no_pipelines() {
    let _alone = alone();
    let host = Host::new(CAIRN_PREFER_AUTO, (0, 0), 0);
    let plain = DXGI_FORMAT_R8G8B8A8_UNORM;
    let mut objects = 0;
    let mut unprepared = 0;
    // As in an engine that does not prepare.
    for quarter in 4..8 {
        for own in [false, true] {
            let (frame, made, pixels) = host.frame(quarter * INTERVAL / 4, SIZE, plain, own);
            let source = if quarter == 4 { CAIRN_FRAME_ANCHOR } else { CAIRN_FRAME_HELD };
            assert_eq!((frame.source, frame.flags & CAIRN_FRAME_UNPREPARED), (source, CAIRN_FRAME_UNPREPARED));
            let nearest = anchor_picture(u64::from(quarter >= 6));
            assert!(pixels == nearest.rgba(), "frame {quarter} is the nearest anchor");
            assert_eq!((made.compiled, made.loaded), (0, 0), "{frame:?}");
            objects += made.objects;
            unprepared += 1;
        }
    }
    let done = host.statistics();
    assert_eq!((text(&done.generator).as_str(), done.unprepared), ("cpu", unprepared));
    assert!(text(&done.preference).contains("cairn_presenter_prepare_d3d12"), "{}", text(&done.preference));
    // Memory for copying anchors, and a list: few objects, and the statistics count them.
    assert!(objects > 0 && done.objects_made > 0, "{objects}, {}", done.objects_made);

    host.prepare(preparation());
    let generated = |quarter: u64, size| {
        let (frame, made, _) = host.frame(quarter * INTERVAL / 4, size, plain, false);
        ((frame.source, frame.flags & CAIRN_FRAME_UNPREPARED), made.compiled + made.loaded)
    };
    assert_eq!(generated(7, SIZE), ((CAIRN_FRAME_GENERATED, 0), 0));
    // Targets of another size create objects until that size is prepared.
    // SAFETY: a live handle.
    assert_eq!(unsafe { cairn_presenter_resize(host.presenter, LARGE.0, LARGE.1) }, CAIRN_OK);
    assert_eq!(generated(7, LARGE), ((CAIRN_FRAME_HELD, CAIRN_FRAME_UNPREPARED), 0));
    host.prepare(preparation());
    assert_eq!(generated(7, LARGE), ((CAIRN_FRAME_GENERATED, 0), 0));
    // And in a format that takes more memory than was prepared.
    host.prepare(cairn_d3d12_preparation { format: plain.0.cast_unsigned(), ..preparation() });
    let wide = |own| host.frame(INTERVAL * 7 / 4, LARGE, DXGI_FORMAT_R16G16B16A16_FLOAT, own).0;
    assert_eq!(
        [wide(false), wide(true)].map(|frame| frame.flags & CAIRN_FRAME_UNPREPARED),
        [CAIRN_FRAME_UNPREPARED; 2]
    );
    assert_eq!(generated(6, LARGE), ((CAIRN_FRAME_GENERATED, 0), 0));
    // A preparation for submitted frames only allows no recording.
    host.prepare(cairn_d3d12_preparation { flags: CAIRN_PREPARE_SUBMIT_ONLY, ..preparation() });
    assert_eq!(generated(5, LARGE), ((CAIRN_FRAME_HELD, CAIRN_FRAME_UNPREPARED), 0));
    let (frame, made, _) = host.frame(INTERVAL * 5 / 4, LARGE, plain, true);
    assert_eq!((frame.source, frame.flags, made), (CAIRN_FRAME_GENERATED, 0, CreatedObjects::default()));
}

#[test]
fn invalid_preparations_are_refused() {
    let _alone = alone();
    let host = Host::new(CAIRN_PREFER_AUTO, (0, 0), 0);
    let shared = host.shared();
    // SAFETY: a variable for the handle.
    let empty = create_handle(|to| unsafe { cairn_presenter_create(std::ptr::null(), to) });
    let no_anchor = Handles(empty, host.device);
    assert_eq!(no_anchor.prepare(&preparation()), CAIRN_NOT_READY);
    let sized = cairn_d3d12_preparation { anchor_width: 64, anchor_height: 32, ..preparation() };
    assert_eq!(no_anchor.prepare(&sized), CAIRN_OK, "the sizes are given");
    for (what, wanted) in [
        ("a format of depths", cairn_d3d12_preparation { format: 40, ..preparation() }),
        ("no format", cairn_d3d12_preparation { format: u32::MAX, ..preparation() }),
        ("half a size", cairn_d3d12_preparation { width: 64, ..preparation() }),
        ("too large", cairn_d3d12_preparation { width: 16385, height: 1, ..preparation() }),
        ("too many lists", cairn_d3d12_preparation { lists: CAIRN_MAX_LISTS + 1, ..preparation() }),
        ("a flag", cairn_d3d12_preparation { flags: 2, ..preparation() }),
    ] {
        assert_eq!(shared.prepare(&wanted), CAIRN_ERROR_INVALID_ARGUMENT, "{what}");
    }
    let mut other = preparation();
    other.struct_size += 1;
    assert_eq!(shared.prepare(&other), CAIRN_ERROR_STRUCT_SIZE);
    // Impossible frames leave the preparation unchanged.
    host.prepare(preparation());
    let huge = cairn_d3d12_preparation { width: 16384, height: 16384, ..preparation() };
    assert!(shared.prepare(&huge) <= CAIRN_OK);
    // SAFETY: a live handle.
    assert_eq!(unsafe { cairn_presenter_destroy(empty) }, CAIRN_OK);
}

#[test]
fn a_thread_prepares_while_another_one_records() {
    let _alone = alone();
    let host = Host::new(CAIRN_PREFER_AUTO, (0, 0), 0);
    host.prepare(preparation());
    let (expected, shared) = (host.frame(INTERVAL * 3 / 2, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, false).2, host.shared());
    let ended = AtomicBool::new(false);
    let ended = &ended;
    std::thread::scope(|scope| {
        // Two threads, which sometimes prepare at the same time.
        let threads: Vec<_> = (0..2)
            .map(|_| {
                scope.spawn(move || {
                    let shared = { shared };
                    let mut results = Vec::new();
                    while !ended.load(Ordering::SeqCst) {
                        results.push(shared.prepare(&cairn_d3d12_preparation { lists: 2, ..preparation() }));
                    }
                    results
                })
            })
            .collect();
        for i in 0..40 {
            let (frame, made, pixels) = host.frame(INTERVAL * 3 / 2, SIZE, DXGI_FORMAT_R8G8B8A8_UNORM, i % 2 == 0);
            assert_eq!((frame.source, frame.flags & CAIRN_FRAME_UNPREPARED), (CAIRN_FRAME_GENERATED, 0), "{i}");
            assert!(pixels == expected, "frame {i}");
            assert_eq!(made, CreatedObjects::default(), "frame {i}");
        }
        ended.store(true, Ordering::SeqCst);
        let results: Vec<_> = threads.into_iter().flat_map(|thread| thread.join().expect("it ends")).collect();
        assert!(results.iter().all(|result| [CAIRN_OK, CAIRN_ERROR_BUSY].contains(result)), "{results:?}");
        assert!(results.contains(&CAIRN_OK));
    });
    assert_eq!(host.statistics().unprepared, 0);
}

/// A host's storage for compiled pipelines, and the numbers of loads and stores.
#[derive(Default)]
struct PipelineStore {
    bytes: Vec<u8>,
    /// A size to report instead of the true one.
    reported_size: Option<u64>,
    loads: u32,
    stores: u32,
}

unsafe extern "C" fn load(bytes: *mut c_void, capacity: u64, user: *mut c_void) -> u64 {
    // SAFETY: the test's own, which nobody else uses meanwhile.
    let storage = unsafe { &mut *user.cast::<PipelineStore>() };
    let count = storage.bytes.len() as u64;
    if !bytes.is_null() {
        assert_eq!(capacity, count, "the size that was reported");
        storage.loads += 1;
        // SAFETY: the buffer has room for that many bytes.
        unsafe { bytes.cast::<u8>().copy_from_nonoverlapping(storage.bytes.as_ptr(), storage.bytes.len()) };
        return storage.reported_size.unwrap_or(count);
    }
    count
}

unsafe extern "C" fn store(bytes: *const c_void, size: u64, user: *mut c_void) {
    // SAFETY: the test's own, which nobody else uses meanwhile.
    let storage = unsafe { &mut *user.cast::<PipelineStore>() };
    storage.stores += 1;
    // SAFETY: that many bytes may be read during the call.
    storage.bytes = unsafe { std::slice::from_raw_parts(bytes.cast::<u8>(), size as usize) }.to_vec();
}

/// Prepares a presenter on a device of its own; returns the created objects, and the numbers of loads and stores.
fn prepare_with(storage: &mut PipelineStore) -> (CreatedObjects, [u32; 2]) {
    let host = Host::new(CAIRN_PREFER_AUTO, LARGE, 0);
    (storage.loads, storage.stores) = (0, 0);
    let user = std::ptr::from_mut(storage).cast();
    let wanted = cairn_d3d12_preparation { load: Some(load), store: Some(store), user, ..preparation() };
    let (result, made) = object_counts::count_created(|| host.shared().prepare(&wanted));
    assert_eq!(result, CAIRN_OK);
    // The pipelines work, whether compiled or loaded.
    let (frame, recorded, _) = host.frame(INTERVAL * 3 / 2, LARGE, DXGI_FORMAT_R8G8B8A8_UNORM, false);
    assert_eq!((frame.source, recorded), (CAIRN_FRAME_GENERATED, CreatedObjects::default()));
    // A second presenter of the device shares them.
    let mut options: cairn_presenter_options = with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
    (options.interval_ns, options.width, options.height) = (INTERVAL, LARGE.0, LARGE.1);
    // SAFETY: options of their size and a variable for the handle.
    let second = create_presenter(&options);
    let sized = cairn_d3d12_preparation { anchor_width: SIZE.0, anchor_height: SIZE.1, ..wanted };
    let calls = [storage.loads, storage.stores];
    let (result, again) = object_counts::count_created(|| Handles(second, host.device).prepare(&sized));
    assert_eq!((result, again.compiled, again.loaded), (CAIRN_OK, 0, 0), "pipelines are the device's");
    assert_eq!(storage.stores, calls[1], "there is nothing new to store");
    // SAFETY: a live handle.
    assert_eq!(unsafe { cairn_presenter_destroy(second) }, CAIRN_OK);
    (made, calls)
}

fn create_presenter(options: &cairn_presenter_options) -> *mut cairn_presenter {
    // SAFETY: options of their size and a variable for the handle.
    create_handle(|to| unsafe { cairn_presenter_create(options, to) })
}

#[test]
fn stored_pipelines_are_loaded_in_the_next_run() {
    let _alone = alone();
    object_counts::set_driver_changed(false);
    let mut storage = PipelineStore::default();
    let (first, calls) = prepare_with(&mut storage);
    assert!(first.compiled >= 24 && first.loaded == 0, "{first:?}");
    assert_eq!(calls, [0, 1], "nothing is stored yet, so everything is compiled and stored");
    // The next run compiles nothing, and stores nothing new.
    let (second, calls) = prepare_with(&mut storage);
    assert_eq!((second.compiled, second.loaded, calls), (0, first.compiled, [1, 0]));
    let good = storage.bytes.clone();

    // Damaged bytes are not an error: everything is compiled and stored again.
    let damaged = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = good.clone();
        change(&mut bytes);
        PipelineStore { bytes, ..PipelineStore::default() }
    };
    let last = good.len() - 1;
    for mut storage in [
        damaged(&|bytes| bytes[0] ^= 1),
        damaged(&|bytes| bytes[20] ^= 1),
        damaged(&|bytes| bytes[last / 2] ^= 1),
        damaged(&|bytes| bytes[last] ^= 1),
        damaged(&|bytes| bytes.truncate(last)),
        damaged(&|bytes| bytes.truncate(1)),
        damaged(&|bytes| bytes.push(0)),
        PipelineStore { reported_size: Some(u64::MAX), ..damaged(&|_| ()) },
        PipelineStore { reported_size: Some(1), ..damaged(&|_| ()) },
    ] {
        let (made, calls) = prepare_with(&mut storage);
        assert_eq!((made.compiled, made.loaded, calls), (first.compiled, 0, [1, 1]));
        assert!(storage.bytes == good, "the stored bytes are valid again");
    }
    // A new driver version refuses the blobs of the earlier one.
    object_counts::set_driver_changed(true);
    let (made, calls) = prepare_with(&mut storage);
    object_counts::set_driver_changed(false);
    assert_eq!((made.compiled, made.loaded, calls), (first.compiled, 0, [1, 1]));
}
