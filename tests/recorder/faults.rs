//! Every call to Direct3D fails in turn, once for lack of memory, or with all later ones since the device is removed, while a host makes a device,
//! a presenter and frames through the C interface: each call returns an error with a message or succeeds, and a failed call can be made again.
//! Frames are right, rules are kept, and no reference stays.

use std::ptr::{null, null_mut};

use cairn::Picture;
use cairn::abi::anchor::{cairn_anchor_create, cairn_anchor_destroy};
use cairn::abi::d3d12::{
    cairn_d3d12_preparation, cairn_device_create_d3d12, cairn_presenter_prepare_d3d12, cairn_presenter_submit_d3d12,
};
use cairn::abi::device::{cairn_device, cairn_device_destroy};
use cairn::abi::images::{cairn_picture, cairn_target};
use cairn::abi::presenter::*;
use cairn::abi::results::{
    CAIRN_ERROR_DEVICE, CAIRN_ERROR_DEVICE_REMOVED, CAIRN_ERROR_OUT_OF_MEMORY, CAIRN_OK, cairn_last_error, cairn_result,
};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::d3d12::engine::{Engine, reference_count, wait_for_counts};
use test_support::d3d12::recorder::{Failure, findings_of, set_failure, while_failing};
use test_support::d3d12::textures::{self, TextureDesc};
use test_support::worlds;

const SIZE: (u32, u32) = (64, 48);
/// Nanoseconds between anchors.
const INTERVAL: u64 = 100_000_000;
/// Times of an anchor and of two generated frames.
const TIMES: [u64; 3] = [INTERVAL, INTERVAL * 5 / 4, INTERVAL * 3 / 2];

/// Calls of the C interface with a failing call to Direct3D.
struct Trial<'a> {
    engine: &'a Engine,
    /// The frames by the processor.
    expected: &'a [Picture; 3],
    failure: Option<Failure>,
    /// Calls to Direct3D so far.
    calls: u64,
    /// Calls of the C interface that failed.
    failed: u32,
}

impl Trial<'_> {
    /// Makes a call, and once more if it fails: then it succeeds, unless the device was removed. Returns whether it succeeded.
    fn call(&mut self, what: &str, call: impl Fn() -> cairn_result) -> bool {
        let (result, calls) = while_failing(&call);
        self.calls = calls;
        if result == CAIRN_OK {
            return true;
        }
        self.failed += 1;
        let how = format!("{what} with {:?}: {result}, {}", self.failure, message());
        assert!(!message().is_empty(), "{how}");
        if let Some(Failure::Removal(_)) = self.failure {
            let (again, _) = while_failing(&call);
            assert_eq!([result, again], [CAIRN_ERROR_DEVICE_REMOVED; 2], "{how}");
            return false;
        }
        assert!([CAIRN_ERROR_OUT_OF_MEMORY, CAIRN_ERROR_DEVICE].contains(&result), "{how}");
        assert_eq!(call(), CAIRN_OK, "{how}; again: {}", message());
        true
    }

    fn run(&mut self) {
        let raw = (self.engine.device.as_raw().cast(), self.engine.direct.as_raw().cast());
        let mut device: *mut cairn_device = null_mut();
        let place = &raw mut device;
        // SAFETY: live objects, options of their size and a variable for the handle.
        let create = || unsafe { cairn_device_create_d3d12(raw.0, raw.1, null_mut(), &tool_device_options(), place) };
        if !self.call("a device", create) {
            return;
        }
        let presenter = presenter(CAIRN_PREFER_REQUIRE);
        self.frames(device, presenter);
        for (what, end) in [
            // SAFETY: live handles, each destroyed once.
            ("the presenter's end", &(|| unsafe { cairn_presenter_destroy(presenter) }) as &dyn Fn() -> cairn_result),
            // SAFETY: as above.
            ("the device's end", &|| unsafe { cairn_device_destroy(device) }),
        ] {
            let (ended, calls) = while_failing(end);
            self.calls = calls;
            assert_eq!(ended, CAIRN_OK, "{what} with {:?}", self.failure);
        }
    }

    fn frames(&mut self, device: *mut cairn_device, presenter: *mut cairn_presenter) {
        let wanted: cairn_d3d12_preparation = with_struct_size(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
        // SAFETY: live handles, and a struct of its size.
        if !self.call("a preparation", || unsafe { cairn_presenter_prepare_d3d12(presenter, device, &wanted) }) {
            return;
        }
        for (now, expected) in TIMES.into_iter().zip(self.expected) {
            let target = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&self.engine.device);
            let (mut fence, mut value) = (null_mut(), 0);
            let (to_fence, to_value) = (&raw mut fence, &raw mut value);
            let raw = target.as_raw().cast();
            // SAFETY: live handles and objects, and variables for the results.
            let submit = || unsafe {
                let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
                cairn_presenter_submit_d3d12(presenter, device, now, raw, 0, 0, &mut frame, to_fence, to_value)
            };
            if !self.call("a frame", submit) {
                return;
            }
            // SAFETY: a fence with a reference for us.
            let fence = unsafe { ID3D12Fence::from_raw(fence.cast()) };
            // SAFETY: a live fence.
            while unsafe { fence.GetCompletedValue() } < value {
                std::thread::yield_now();
            }
            let found = textures::read(&self.engine.device, &self.engine.direct, &target, D3D12_RESOURCE_STATE_COMMON);
            let is_right = found.iter().zip(expected.rgba()).all(|(a, b)| a.abs_diff(*b) <= 1);
            assert!(is_right, "the frame at {now} with {:?}", self.failure);
        }
    }
}

/// The last error's message.
fn message() -> String {
    let mut text = [0; 512];
    let mut length = 0;
    // SAFETY: a buffer of that size and a variable.
    unsafe { cairn_last_error(text.as_mut_ptr(), text.len(), &mut length) };
    let bytes: Vec<u8> = text.iter().take_while(|c| **c != 0).map(|c| c.cast_unsigned()).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// A presenter of two anchors, four frames per anchor.
fn presenter(shader: u32) -> *mut cairn_presenter {
    let mut options: cairn_presenter_options = with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
    (options.multiplier, options.interval_ns) = (4, INTERVAL);
    options.shader = shader;
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

/// The frame at `now` by the processor.
fn drawn(presenter: *mut cairn_presenter, now: u64) -> Picture {
    let mut picture = Picture::new(SIZE.0, SIZE.1).expect("a picture");
    let mut target: cairn_target = with_struct_size(|target: &mut cairn_target| &mut target.struct_size);
    (target.width, target.height) = SIZE;
    (target.pixels, target.size) = (picture.rgba_mut().as_mut_ptr().cast(), picture.rgba().len() as u64);
    // SAFETY: a live handle and a target that lives during the call.
    assert_eq!(unsafe { cairn_presenter_draw(presenter, now, &target, null_mut()) }, CAIRN_OK);
    picture
}

/// Calls that fail in a short run are this far apart; `CAIRN_EVERY_FAILURE` lets all fail.
const SHORT_STEP: usize = 7;

/// Lets calls fail in turn until a trial has none.
fn fail_each(failure: fn(u64) -> Failure) {
    let step = if std::env::var_os("CAIRN_EVERY_FAILURE").is_some() { 1 } else { SHORT_STEP };
    let found = findings_of(|| {
        let engine = Engine::create();
        let on_processor = presenter(CAIRN_PREFER_NEVER);
        let expected = TIMES.map(|now| drawn(on_processor, now));
        // SAFETY: a live handle, destroyed once.
        assert_eq!(unsafe { cairn_presenter_destroy(on_processor) }, CAIRN_OK);
        let references = || [reference_count(&engine.device), reference_count(&engine.direct)];
        let before = references();
        let trial = |failure| {
            set_failure(failure);
            let mut trial = Trial { engine: &engine, expected: &expected, failure, calls: 0, failed: 0 };
            trial.run();
            wait_for_counts(references, before);
            (trial.calls, trial.failed)
        };
        let (all, failed) = trial(None);
        assert_eq!(failed, 0, "nothing fails");
        assert!(all > 50, "{all} calls were counted");
        let mut failures = 0;
        for call in (1..=all).step_by(step) {
            failures += trial(Some(failure(call))).1;
        }
        println!("{all} calls; {failures} calls of the C interface failed");
        assert!(failures > 0, "failures reach the host");
    });
    assert_eq!(found, [], "rules are kept");
}

#[test]
fn each_call_may_fail_once() {
    fail_each(Failure::Once);
}

#[test]
fn the_device_may_be_removed_at_each_call() {
    fail_each(Failure::Removal);
}
