//! Frames in an engine's textures, by a presenter.

use std::ptr::{null, null_mut};

use cairn::Picture;
use cairn::abi::anchor::{cairn_anchor_create, cairn_anchor_destroy};
use cairn::abi::d3d12::{
    cairn_d3d12_preparation, cairn_device_create_d3d12, cairn_presenter_prepare_d3d12, cairn_presenter_submit_d3d12,
};
use cairn::abi::device::{cairn_device, cairn_device_destroy};
use cairn::abi::images::{cairn_picture, cairn_target};
use cairn::abi::presenter::*;
use cairn::abi::results::CAIRN_OK;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::d3d12::textures::{self, TextureDesc};
use test_support::worlds;

use super::{Failure, Reach, Source, Trial, fail_each};

const SIZE: (u32, u32) = (64, 48);
/// Nanoseconds between anchors.
const INTERVAL: u64 = 100_000_000;
/// Times of an anchor and of two generated frames.
const TIMES: [u64; 3] = [INTERVAL, INTERVAL * 5 / 4, INTERVAL * 3 / 2];

/// A host's device, presenter and frames.
fn show(trial: &mut Trial<'_>, expected: &[Picture; 3]) {
    let raw = (trial.engine.device.as_raw().cast(), trial.engine.direct.as_raw().cast());
    let mut device: *mut cairn_device = null_mut();
    let place = &raw mut device;
    // SAFETY: live objects, options of their size and a variable for the handle.
    let create = || unsafe { cairn_device_create_d3d12(raw.0, raw.1, null_mut(), &tool_device_options(), place) };
    if !trial.call("a device", create) {
        return;
    }
    let presenter = presenter(CAIRN_PREFER_REQUIRE);
    frames(trial, expected, device, presenter);
    // SAFETY: live handles, each destroyed once.
    trial.end("the presenter's end", || unsafe { cairn_presenter_destroy(presenter) });
    // SAFETY: as above.
    trial.end("the device's end", || unsafe { cairn_device_destroy(device) });
}

fn frames(trial: &mut Trial<'_>, expected: &[Picture; 3], device: *mut cairn_device, presenter: *mut cairn_presenter) {
    let wanted: cairn_d3d12_preparation = with_struct_size(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
    // SAFETY: live handles, and a struct of its size.
    if !trial.call("a preparation", || unsafe { cairn_presenter_prepare_d3d12(presenter, device, &wanted) }) {
        return;
    }
    for (now, expected) in TIMES.into_iter().zip(expected) {
        let target = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&trial.engine.device);
        let (mut fence, mut value) = (null_mut(), 0);
        let (to_fence, to_value) = (&raw mut fence, &raw mut value);
        let raw = target.as_raw().cast();
        // SAFETY: live handles and objects, and variables for the results.
        let submit = || unsafe {
            let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
            cairn_presenter_submit_d3d12(presenter, device, now, raw, 0, 0, &mut frame, to_fence, to_value)
        };
        if !trial.call("a frame", submit) {
            return;
        }
        // SAFETY: a fence with a reference for us.
        let fence = unsafe { ID3D12Fence::from_raw(fence.cast()) };
        // SAFETY: a live fence.
        while unsafe { fence.GetCompletedValue() } < value {
            std::thread::yield_now();
        }
        let found = textures::read(&trial.engine.device, &trial.engine.direct, &target, D3D12_RESOURCE_STATE_COMMON);
        let is_right = found.iter().zip(expected.rgba()).all(|(a, b)| a.abs_diff(*b) <= 1);
        assert!(is_right, "the frame at {now} with {:?}", trial.failure);
    }
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

/// Lets about twenty calls fail.
fn fail_frames(failure: fn(u64) -> Failure) {
    let on_processor = presenter(CAIRN_PREFER_NEVER);
    let expected = TIMES.map(|now| drawn(on_processor, now));
    // SAFETY: a live handle, destroyed once.
    assert_eq!(unsafe { cairn_presenter_destroy(on_processor) }, CAIRN_OK);
    fail_each(Source::Direct3d, Reach::Host, failure, 20, |trial| show(trial, &expected));
}

#[test]
fn each_call_may_fail_once() {
    fail_frames(Failure::Once);
}

#[test]
fn the_device_may_be_removed_at_each_call() {
    fail_frames(Failure::Removal);
}
