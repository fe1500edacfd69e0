//! A hostile host on Direct3D 12, through the C interface: calls from callbacks, calls of many threads at once, and objects that end while the
//! device may still work for them. On Windows, or in the lab.
#![cfg(windows)]

use std::ffi::c_void;
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use cairn::abi::anchor::{cairn_anchor_create, cairn_anchor_destroy};
use cairn::abi::d3d12::{
    cairn_d3d12_preparation, cairn_d3d12_recording, cairn_device_create_d3d12, cairn_device_get_d3d12,
    cairn_presenter_prepare_d3d12, cairn_presenter_record_d3d12, cairn_presenter_release_d3d12,
    cairn_presenter_submit_d3d12,
};
use cairn::abi::device::{cairn_device, cairn_device_destroy, cairn_device_get_info, cairn_device_info};
use cairn::abi::images::cairn_picture;
use cairn::abi::presenter::*;
use cairn::abi::results::*;
use cairn::abi::statistics::{cairn_presenter_get_statistics, cairn_presenter_statistics};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::{IUnknown, Interface};
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::d3d12::engine::{Engine, reference_count, wait_for_counts};
use test_support::d3d12::textures::{Recording, TextureDesc};
use test_support::worlds;

const SIZE: (u32, u32) = (64, 48);
/// Nanoseconds between anchors.
const INTERVAL: u64 = 100_000_000;

/// A host's handles, which any thread uses at any time.
#[derive(Clone, Copy)]
struct Handles {
    device: *mut cairn_device,
    presenter: *mut cairn_presenter,
}

// SAFETY: handles are numbers.
unsafe impl Send for Handles {}
// SAFETY: as above.
unsafe impl Sync for Handles {}

impl Handles {
    fn create(engine: &Engine) -> Self {
        Self { device: device(engine), presenter: presenter() }
    }

    fn prepare(self) -> cairn_result {
        let wanted: cairn_d3d12_preparation = with_struct_size(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
        // SAFETY: handles are looked up; a struct of its size.
        unsafe { cairn_presenter_prepare_d3d12(self.presenter, self.device, &wanted) }
    }

    /// Submits the frame at `now`; with a fence and its value where it succeeds.
    fn submit(self, now: u64, target: &ID3D12Resource) -> (cairn_result, Option<(ID3D12Fence, u64)>) {
        let (mut fence, mut value) = (null_mut(), 0);
        let target = target.as_raw().cast();
        // SAFETY: handles are looked up; a live texture, and variables for the results.
        let result = unsafe {
            let (fence, value) = (&raw mut fence, &raw mut value);
            cairn_presenter_submit_d3d12(self.presenter, self.device, now, target, 0, 0, null_mut(), fence, value)
        };
        // SAFETY: a fence with a reference for us, or none.
        let fence = (result == CAIRN_OK).then(|| (unsafe { ID3D12Fence::from_raw(fence.cast()) }, value));
        (result, fence)
    }

    fn statistics(self) -> cairn_result {
        let mut done: cairn_presenter_statistics =
            with_struct_size(|done: &mut cairn_presenter_statistics| &mut done.struct_size);
        // SAFETY: handles are looked up; a struct of its size.
        unsafe { cairn_presenter_get_statistics(self.presenter, &mut done) }
    }

    /// Records the frame at `now` into an engine's list.
    fn record(self, now: u64, recording: &Recording, target: &ID3D12Resource) -> cairn_result {
        let mut given: cairn_d3d12_recording = with_struct_size(|r: &mut cairn_d3d12_recording| &mut r.struct_size);
        (given.list, given.target) = (recording.list().as_raw().cast(), target.as_raw().cast());
        (given.fence, given.fence_value) = (recording.fence().as_raw().cast(), 1);
        // SAFETY: handles are looked up; live objects.
        unsafe { cairn_presenter_record_d3d12(self.presenter, self.device, now, &given, null_mut()) }
    }

    fn release(self) -> cairn_result {
        // SAFETY: handles are looked up.
        unsafe { cairn_presenter_release_d3d12(self.presenter) }
    }

    /// Destroys both, in one of two orders.
    fn end(self, order: u32) -> [cairn_result; 2] {
        // SAFETY: handles are looked up.
        unsafe {
            match order {
                0 => [cairn_presenter_destroy(self.presenter), cairn_device_destroy(self.device)],
                _ => [cairn_device_destroy(self.device), cairn_presenter_destroy(self.presenter)],
            }
        }
    }

    fn destroy(self) {
        assert_eq!(self.end(0), [CAIRN_OK; 2]);
    }
}

fn device(engine: &Engine) -> *mut cairn_device {
    let (device, queue) = (engine.device.as_raw().cast(), engine.direct.as_raw().cast());
    // SAFETY: live objects, options of their size and a variable for the handle.
    create_handle(|to| unsafe { cairn_device_create_d3d12(device, queue, null_mut(), &tool_device_options(), to) })
}

/// A presenter of two anchors, four frames per anchor.
fn presenter() -> *mut cairn_presenter {
    let mut options: cairn_presenter_options = with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
    (options.multiplier, options.interval_ns) = (4, INTERVAL);
    // SAFETY: options of their size and a variable for the handle.
    let presenter = create_handle(|to| unsafe { cairn_presenter_create(&options, to) });
    for number in 0..2 {
        let picture = worlds::picture(SIZE.0, SIZE.1, 1 + number as u32);
        let mut given: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
        (given.width, given.height) = SIZE;
        (given.pixels, given.size) = (picture.rgba().as_ptr().cast(), picture.rgba().len() as u64);
        // SAFETY: a picture that lives during the call, and a variable for the handle.
        let anchor = create_handle(|to| unsafe { cairn_anchor_create(&given, number, 0, to) });
        // SAFETY: live handles.
        let pushed = unsafe { cairn_presenter_push(presenter, anchor, null(), number * INTERVAL) };
        // SAFETY: a live handle.
        assert_eq!([pushed, unsafe { cairn_anchor_destroy(anchor) }], [CAIRN_OK; 2]);
    }
    presenter
}

fn target(engine: &Engine) -> ID3D12Resource {
    TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&engine.device)
}

fn wait(fence: &ID3D12Fence, value: u64) {
    // SAFETY: without an event it waits.
    unsafe { fence.SetEventOnCompletion(value, Default::default()) }.expect("it is reached");
}

fn references(engine: &Engine) -> [u32; 2] {
    [reference_count(&engine.device), reference_count(&engine.direct)]
}

/// The arguments of a preparation's callbacks.
struct CallbackData {
    handles: Handles,
    engine: Engine,
    calls: AtomicU32,
}

impl CallbackData {
    /// Calls everything that a callback may call, and what it may not.
    fn call_all(&self) {
        let Handles { device, presenter } = self.handles;
        self.calls.fetch_add(1, Ordering::SeqCst);
        // SAFETY: handles are looked up.
        let destroyed = unsafe { [cairn_presenter_destroy(presenter), cairn_device_destroy(device)] };
        assert_eq!(destroyed, [CAIRN_ERROR_BUSY; 2]);
        assert_eq!(self.handles.prepare(), CAIRN_ERROR_BUSY);
        assert_eq!(self.handles.statistics(), CAIRN_OK);
        // The nearest anchor is shown meanwhile.
        let target = target(&self.engine);
        let (submitted, fence) = self.handles.submit(INTERVAL, &target);
        assert_eq!(submitted, CAIRN_OK);
        let (fence, value) = fence.expect("a fence");
        wait(&fence, value);
        let (mut own, mut queue) = (null_mut(), null_mut());
        // SAFETY: handles are looked up, and variables for the results.
        assert_eq!(unsafe { cairn_device_get_d3d12(device, &mut own, &mut queue) }, CAIRN_OK);
        for object in [own.cast::<c_void>(), queue.cast()] {
            // SAFETY: a reference for us.
            drop(unsafe { IUnknown::from_raw(object) });
        }
        // Other objects come and go, and frames are prepared for them.
        let other = Handles::create(&self.engine);
        assert_eq!(other.prepare(), CAIRN_OK);
        other.destroy();
    }
}

unsafe extern "C" fn load(_: *mut c_void, _: u64, user: *mut c_void) -> u64 {
    // SAFETY: the test's data, which outlive the call.
    unsafe { &*user.cast::<CallbackData>() }.call_all();
    0
}

unsafe extern "C" fn store(_: *const c_void, _: u64, user: *mut c_void) {
    // SAFETY: as above.
    unsafe { &*user.cast::<CallbackData>() }.call_all();
}

#[test]
fn callbacks_of_a_preparation_may_call_everything_but_what_they_are_called_from() {
    let engine = Engine::create();
    let before = references(&engine);
    let handles = Handles::create(&engine);
    let (device, direct, compute) = (engine.device.clone(), engine.direct.clone(), engine.compute.clone());
    let data = CallbackData { handles, engine: Engine { device, direct, compute }, calls: AtomicU32::new(0) };
    let mut wanted: cairn_d3d12_preparation = with_struct_size(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
    wanted.load = Some(load);
    wanted.store = Some(store);
    wanted.user = (&raw const data).cast_mut().cast();
    // SAFETY: live handles, a struct of its size, and data that outlive the call.
    assert_eq!(unsafe { cairn_presenter_prepare_d3d12(handles.presenter, handles.device, &wanted) }, CAIRN_OK);
    // The other is called only where the driver can store pipelines.
    assert!(data.calls.load(Ordering::SeqCst) > 0, "the one that loads pipelines was called");
    let target = target(&engine);
    let (submitted, fence) = handles.submit(INTERVAL * 3 / 2, &target);
    assert_eq!(submitted, CAIRN_OK);
    let (fence, value) = fence.expect("a fence");
    wait(&fence, value);
    drop((fence, target));
    handles.destroy();
    drop(data);
    wait_for_counts(|| references(&engine), before);
}

#[test]
fn calls_of_many_threads_at_once_leave_everything_consistent() {
    let engine = Engine::create();
    let before = references(&engine);
    let handles = Handles::create(&engine);
    assert_eq!(handles.prepare(), CAIRN_OK);
    let is_over = AtomicBool::new(false);
    let submitted = AtomicU32::new(0);
    let until_over = |work: &dyn Fn(u64)| (0..).take_while(|_| !is_over.load(Ordering::SeqCst)).for_each(work);
    std::thread::scope(|scope| {
        // Frames of two threads.
        for part in 0..2 {
            let (engine, submitted, until_over) = (&engine, &submitted, &until_over);
            scope.spawn(move || {
                let target = target(engine);
                until_over(&|number| {
                    let (result, fence) = handles.submit(INTERVAL + (part + 2 * number) * INTERVAL / 64, &target);
                    assert!([CAIRN_OK, CAIRN_ERROR_BUSY, CAIRN_QUEUE_FULL].contains(&result), "a frame: {result}");
                    if let Some((fence, value)) = fence {
                        submitted.fetch_add(1, Ordering::SeqCst);
                        wait(&fence, value);
                    }
                });
            });
        }
        // Lists that never run.
        scope.spawn(|| {
            let target = target(&engine);
            until_over(&|_| {
                let recording = Recording::on(&engine.device, &engine.direct);
                let result = handles.record(INTERVAL, &recording, &target);
                assert!([CAIRN_OK, CAIRN_ERROR_BUSY, CAIRN_QUEUE_FULL].contains(&result), "a list: {result}");
                recording.drop_list();
            });
        });
        // Preparations, statistics, and the end of all uses.
        for _ in 0..2 {
            scope.spawn(|| {
                until_over(&|_| {
                    let result = handles.prepare();
                    assert!([CAIRN_OK, CAIRN_ERROR_BUSY].contains(&result), "a preparation: {result}");
                    assert_eq!(handles.statistics(), CAIRN_OK);
                    let result = handles.release();
                    assert!([CAIRN_OK, CAIRN_ERROR_BUSY].contains(&result), "a release: {result}");
                });
            });
        }
        // Other devices and presenters of the same queue.
        scope.spawn(|| {
            until_over(&|_| {
                let other = Handles::create(&engine);
                assert_eq!(other.prepare(), CAIRN_OK);
                let mut info: cairn_device_info =
                    with_struct_size(|info: &mut cairn_device_info| &mut info.struct_size);
                // SAFETY: a live handle and a struct of its size.
                assert_eq!(unsafe { cairn_device_get_info(other.device, &mut info) }, CAIRN_OK);
                other.destroy();
            });
        });
        std::thread::sleep(Duration::from_secs(3));
        is_over.store(true, Ordering::SeqCst);
    });
    assert!(submitted.load(Ordering::SeqCst) > 0, "frames were made");
    let target = target(&engine);
    let (result, fence) = handles.submit(INTERVAL * 3 / 2, &target);
    assert_eq!(result, CAIRN_OK);
    let (fence, value) = fence.expect("a fence");
    wait(&fence, value);
    drop((fence, target));
    handles.destroy();
    wait_for_counts(|| references(&engine), before);
}

#[test]
fn objects_end_in_any_order_right_after_a_frame_was_submitted() {
    let engine = Engine::create();
    let before = references(&engine);
    let target = target(&engine);
    let with_target = references(&engine);
    for order in [0, 1, 0, 1] {
        let handles = Handles::create(&engine);
        assert_eq!(handles.prepare(), CAIRN_OK);
        let (result, fence) = handles.submit(INTERVAL * 3 / 2, &target);
        assert_eq!(result, CAIRN_OK);
        let (fence, value) = fence.expect("a fence");
        let results = std::thread::scope(|scope| {
            // Calls that come too late find no handle, or are early enough.
            let late = scope.spawn(move || [(); 50].map(|()| handles.statistics()));
            assert_eq!(handles.end(order), [CAIRN_OK; 2]);
            late.join().expect("no panic")
        });
        let is_expected = |result: &cairn_result| [CAIRN_OK, CAIRN_ERROR_INVALID_HANDLE].contains(result);
        assert!(results.iter().all(is_expected), "{results:?}");
        wait(&fence, value);
        drop(fence);
        wait_for_counts(|| references(&engine), with_target);
    }
    drop(target);
    wait_for_counts(|| references(&engine), before);
}
