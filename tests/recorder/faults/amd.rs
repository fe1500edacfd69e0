//! Frames of a presenter with AMD's generator and upscaler: required, or in the place of the library's own where they work.

use std::ffi::CString;
use std::ptr::null_mut;

use cairn::Picture;
use cairn::abi::anchor::{cairn_anchor_create, cairn_anchor_destroy};
use cairn::abi::d3d12::{
    cairn_d3d12_preparation, cairn_device_create_d3d12, cairn_presenter_prepare_d3d12, cairn_presenter_submit_d3d12,
};
use cairn::abi::device::{cairn_device, cairn_device_destroy};
use cairn::abi::guidance::{
    cairn_guidance, cairn_guidance_create_from_host, cairn_guidance_data, cairn_guidance_destroy,
};
use cairn::abi::images::cairn_picture;
use cairn::abi::presenter::*;
use cairn::abi::results::CAIRN_OK;
use cairn::abi::statistics::{cairn_presenter_get_statistics, cairn_presenter_statistics};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::d3d12::textures::{self, TextureDesc};
use test_support::ffx::failing_calls::FailingCalls;

use super::{Failure, Reach, Source, Trial, fail_each, text_of};

/// Size of anchors, and of the frames, which the upscaler makes larger.
const ANCHOR: (u32, u32) = (128, 96);
const SIZE: (u32, u32) = (192, 144);
/// Motion of the picture from anchor to anchor, in pixels to the right.
const STEP: f32 = 8.0;
/// Nanoseconds between anchors.
const INTERVAL: u64 = 100_000_000;
/// Times of frames half way between anchors, and the number of anchors that the picture has moved until then.
const FRAMES: [(u64, f32); 2] = [(INTERVAL * 3 / 2, 0.5), (INTERVAL * 5 / 2, 1.5)];
/// Columns and rows of an anchor that nothing enters from outside.
const INNER: [std::ops::Range<u32>; 2] = [32..96, 16..80];
/// Largest difference of a channel from the true frame: of the double's frames, of the library's, and of AMD's own.
const TOLERANCE: u8 = 24;

/// The pattern at some size, moved by `by` pixels of an anchor.
fn pattern(size: (u32, u32), by: f32) -> Picture {
    let wave = |phase: f32| (128.0 + 90.0 * phase.sin()) as u8;
    let mut picture = Picture::new(size.0, size.1).expect("a picture");
    let scale = [size.0 as f32 / ANCHOR.0 as f32, size.1 as f32 / ANCHOR.1 as f32];
    for (pixel, place) in picture.pixels_mut().iter_mut().zip(0..) {
        let (x, y) = (place % size.0, place / size.0);
        let (x, y) = ((x as f32 + 0.5) / scale[0] - 0.5 - by, (y as f32 + 0.5) / scale[1] - 0.5);
        *pixel = [wave(x * 0.11), wave(y * 0.13 + x * 0.05), wave(x * 0.07 - y * 0.09), 255];
    }
    picture
}

/// Largest difference of a channel in the inner part.
fn difference(found: &[u8], expected: &Picture) -> u8 {
    let is_inner = |place: u32| {
        let (x, y) = (place % SIZE.0 * ANCHOR.0 / SIZE.0, place / SIZE.0 * ANCHOR.1 / SIZE.1);
        INNER[0].contains(&x) && INNER[1].contains(&y)
    };
    let pixels = found.as_chunks::<4>().0.iter().zip(expected.pixels()).zip(0..);
    let inner = pixels.filter(|(_, place)| is_inner(*place)).map(|(pair, _)| pair);
    inner.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b))).max().unwrap_or(u8::MAX)
}

/// The pattern's exact motion, and one depth.
fn guidance() -> *mut cairn_guidance {
    let count = (ANCHOR.0 * ANCHOR.1) as usize;
    let motion = [half::f16::from_f32(-STEP).to_bits(), 0].repeat(count);
    let depth = vec![0.5_f32; count];
    let mut data: cairn_guidance_data = with_struct_size(|data: &mut cairn_guidance_data| &mut data.struct_size);
    (data.width, data.height) = ANCHOR;
    (data.motion, data.motion_count) = (motion.as_ptr(), motion.len() as u64);
    (data.depth, data.depth_count) = (depth.as_ptr(), depth.len() as u64);
    // SAFETY: arrays that live during the call, and a variable for the handle.
    create_handle(|to| unsafe { cairn_guidance_create_from_host(&data, to) })
}

/// A presenter of two anchors, two frames per anchor.
fn presenter(preference: u32, calls: &FailingCalls) -> *mut cairn_presenter {
    let mut options: cairn_presenter_options = with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
    (options.multiplier, options.interval_ns, options.capacity) = (2, INTERVAL, 8);
    (options.width, options.height) = SIZE;
    options.fsr = preference;
    options.upscaler = if calls.has_upscaler { preference } else { CAIRN_PREFER_AUTO };
    // SAFETY: options of their size and a variable for the handle.
    let presenter = create_handle(|to| unsafe { cairn_presenter_create(&options, to) });
    (0..2).for_each(|number| push(presenter, number));
    presenter
}

/// Pushes an anchor, with its guidance.
fn push(presenter: *mut cairn_presenter, number: u64) {
    let picture = pattern(ANCHOR, STEP * number as f32);
    let mut given: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
    (given.width, given.height) = ANCHOR;
    (given.pixels, given.size) = (picture.rgba().as_ptr().cast(), picture.rgba().len() as u64);
    // SAFETY: a picture that lives during the call, and a variable for the handle.
    let anchor = create_handle(|to| unsafe { cairn_anchor_create(&given, number, 0, to) });
    let guidance = if number > 0 { guidance() } else { null_mut() };
    // SAFETY: live handles.
    let pushed = unsafe { cairn_presenter_push(presenter, anchor, guidance, number * INTERVAL) };
    // SAFETY: live handles, or null.
    let ended = unsafe { [cairn_anchor_destroy(anchor), cairn_guidance_destroy(guidance)] };
    assert_eq!((pushed, ended), (CAIRN_OK, [CAIRN_OK; 2]));
}

/// A host's device, presenter and frames.
fn show(trial: &mut Trial<'_>, preference: u32, calls: &FailingCalls) {
    let raw = (trial.engine.device.as_raw().cast(), trial.engine.direct.as_raw().cast());
    let folder = CString::new(calls.folder.0.to_str().expect("text")).expect("no NUL");
    let mut options = tool_device_options();
    options.ffx = folder.as_ptr();
    // SAFETY: live objects, options of their size and a variable for the handle.
    let device: *mut cairn_device =
        create_handle(|to| unsafe { cairn_device_create_d3d12(raw.0, raw.1, null_mut(), &options, to) });
    let presenter = presenter(preference, calls);
    frames(trial, device, presenter);
    // SAFETY: live handles, each destroyed once.
    trial.end("the presenter's end", || unsafe { cairn_presenter_destroy(presenter) });
    // SAFETY: as above.
    trial.end("the device's end", || unsafe { cairn_device_destroy(device) });
}

fn frames(trial: &mut Trial<'_>, device: *mut cairn_device, presenter: *mut cairn_presenter) {
    let mut wanted: cairn_d3d12_preparation = with_struct_size(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
    (wanted.anchor_width, wanted.anchor_height) = ANCHOR;
    // SAFETY: live handles, and a struct of its size.
    if !trial.call("a preparation", || unsafe { cairn_presenter_prepare_d3d12(presenter, device, &wanted) }) {
        return;
    }
    for (number, (now, by)) in (0..).zip(FRAMES) {
        if number > 0 {
            push(presenter, number + 1);
        }
        let target = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&trial.engine.device);
        let (mut fence, mut value) = (null_mut(), 0);
        let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
        let to_frame = &raw mut frame;
        let (to_fence, to_value) = (&raw mut fence, &raw mut value);
        let raw = target.as_raw().cast();
        // SAFETY: live handles and objects, and variables for the results.
        let submit =
            || unsafe { cairn_presenter_submit_d3d12(presenter, device, now, raw, 0, 0, to_frame, to_fence, to_value) };
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
        let difference = difference(&found, &pattern(SIZE, STEP * by));
        let [generator, why] = reported(presenter);
        assert!(difference <= TOLERANCE, "{difference} off at {now} with {:?}, by {generator} ({why})", trial.failure);
        match trial.failure {
            None => assert!(generator.starts_with("fsr ") && why.is_empty(), "{generator}: {why}"),
            Some(_) => assert_eq!(generator.starts_with("fsr "), why.is_empty(), "{generator}: {why}"),
        }
    }
}

/// The generator of the last frame, and why it is not AMD's.
fn reported(presenter: *mut cairn_presenter) -> [String; 2] {
    let mut done: cairn_presenter_statistics =
        with_struct_size(|done: &mut cairn_presenter_statistics| &mut done.struct_size);
    // SAFETY: a live handle, and memory for the statistics.
    assert_eq!(unsafe { cairn_presenter_get_statistics(presenter, &mut done) }, CAIRN_OK);
    [text_of(&done.generator), text_of(&done.preference)]
}

/// Lets about `count` calls fail.
fn fail(is_of_amd: bool, preference: u32, failure: fn(u64) -> Failure, count: u64) {
    let calls = FailingCalls::of_process();
    let source = if is_of_amd { Source::Amd(calls) } else { Source::BeneathAmd(calls) };
    // Where AMD's libraries are not required, the library's own shaders make the frames.
    let reach = if is_of_amd && preference == CAIRN_PREFER_AUTO { Reach::Nobody } else { Reach::Host };
    fail_each(source, reach, failure, count, |trial| show(trial, preference, calls));
    if !calls.is_amds {
        assert_eq!(calls.folder.violations(), [""; 0]);
    }
}

#[test]
fn each_call_of_required_libraries_may_fail_once() {
    fail(true, CAIRN_PREFER_REQUIRE, Failure::Once, 2);
}

#[test]
fn each_call_of_required_libraries_may_throw() {
    fail(true, CAIRN_PREFER_REQUIRE, Failure::Throwing, 2);
}

#[test]
fn required_libraries_may_fail_for_ever_from_each_call_on() {
    fail(true, CAIRN_PREFER_REQUIRE, Failure::ForEver, 1);
}

#[test]
fn shaders_make_frames_where_a_call_of_amds_libraries_fails_once() {
    fail(true, CAIRN_PREFER_AUTO, Failure::Once, 1);
}

#[test]
fn shaders_make_frames_where_amds_libraries_fail_for_ever() {
    fail(true, CAIRN_PREFER_AUTO, Failure::ForEver, 1);
}

#[test]
fn each_call_to_direct3d_beneath_may_fail_once() {
    fail(false, CAIRN_PREFER_REQUIRE, Failure::Once, 2);
}

#[test]
fn the_device_may_be_removed_at_each_call_beneath() {
    fail(false, CAIRN_PREFER_REQUIRE, Failure::Removal, 3);
}
