//! A world on DirectML: its loading, a rollout, a seed and a step.

use std::cell::RefCell;
use std::ffi::CString;
use std::ptr::{null, null_mut};

use cairn::abi::controls::cairn_controls;
use cairn::abi::d3d12::cairn_device_create_d3d12;
use cairn::abi::device::{CAIRN_DEVICE_DETERMINISTIC, cairn_device, cairn_device_destroy};
use cairn::abi::images::cairn_picture;
use cairn::abi::results::CAIRN_OK;
use cairn::abi::rollout::{cairn_rollout_append, cairn_rollout_create, cairn_rollout_destroy, cairn_rollout_step};
use cairn::abi::state::cairn_rollout_save;
use cairn::abi::world::{cairn_world, cairn_world_destroy, cairn_world_load, cairn_world_options};
use cairn::gpu::windows::core::Interface;
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::worlds::{self, bundle_path};

use super::{Failure, Reach, Source, Trial, fail_each};

/// A host's world. `expected` is the rollout's state, from the first trial on, in which nothing fails.
fn walk(trial: &mut Trial<'_>, expected: &RefCell<Vec<u8>>) {
    let raw = (trial.engine.device.as_raw().cast(), trial.engine.direct.as_raw().cast());
    let mut options = tool_device_options();
    options.flags |= CAIRN_DEVICE_DETERMINISTIC;
    // SAFETY: live objects, options of their size and a variable for the handle.
    let device: *mut cairn_device =
        create_handle(|to| unsafe { cairn_device_create_d3d12(raw.0, raw.1, null_mut(), &options, to) });
    let path = CString::new(bundle_path("tiny").to_str().expect("text")).expect("no NUL");
    let mut options: cairn_world_options = with_struct_size(|o: &mut cairn_world_options| &mut o.struct_size);
    options.path = path.as_ptr();
    let mut world: *mut cairn_world = null_mut();
    let place = &raw mut world;
    // SAFETY: a live handle, options of their size, and a variable for the handle.
    if trial.call("a world", || unsafe { cairn_world_load(device, &options, place) }) {
        roll_out(trial, world, expected);
        // SAFETY: a live handle, destroyed once.
        trial.end("the world's end", || unsafe { cairn_world_destroy(world) });
    }
    // SAFETY: a live handle, destroyed once.
    trial.end("the device's end", || unsafe { cairn_device_destroy(device) });
}

fn roll_out(trial: &mut Trial<'_>, world: *mut cairn_world, expected: &RefCell<Vec<u8>>) {
    let mut rollout = null_mut();
    let place = &raw mut rollout;
    // SAFETY: a live handle and a variable for the handle.
    if !trial.call("a rollout", || unsafe { cairn_rollout_create(world, null(), place) }) {
        return;
    }
    let seed = worlds::picture(40, 30, 1);
    let mut picture: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
    (picture.width, picture.height) = seed.size();
    (picture.pixels, picture.size) = (seed.rgba().as_ptr().cast(), seed.rgba().len() as u64);
    let mut controls: cairn_controls = with_struct_size(|controls: &mut cairn_controls| &mut controls.struct_size);
    (controls.mouse_dx, controls.keys[1]) = (3.0, 1 << 23);
    // SAFETY: a live handle, and a picture that lives during the call.
    let is_whole = trial.call("a seed", || unsafe { cairn_rollout_append(rollout, &picture, null_mut()) })
        // SAFETY: a live handle, and a struct of its size.
        && trial.call("a step", || unsafe { cairn_rollout_step(rollout, &controls, null_mut()) });
    if is_whole {
        let mut size = 0;
        // SAFETY: a live handle and a variable.
        assert_eq!(unsafe { cairn_rollout_save(rollout, null_mut(), 0, &mut size) }, CAIRN_OK);
        let mut state = vec![0; size];
        let (bytes, place) = (state.as_mut_ptr().cast(), &raw mut size);
        // SAFETY: a live handle, a buffer of that size and a variable.
        let save = || unsafe { cairn_rollout_save(rollout, bytes, state.len(), place) };
        if trial.call("its state", save) {
            let mut expected = expected.borrow_mut();
            if expected.is_empty() {
                *expected = state;
            } else {
                assert!(*expected == state, "the rollout's state with {:?}", trial.failure);
            }
        }
    }
    // SAFETY: a live handle, destroyed once.
    trial.end("the rollout's end", || unsafe { cairn_rollout_destroy(rollout) });
}

/// Lets about six calls fail.
fn fail_world(failure: fn(u64) -> Failure) {
    let expected = RefCell::new(Vec::new());
    fail_each(Source::Direct3d, Reach::Host, failure, 6, |trial| walk(trial, &expected));
}

#[test]
fn each_call_may_fail_once() {
    fail_world(Failure::Once);
}

#[test]
fn the_device_may_be_removed_at_each_call() {
    fail_world(Failure::Removal);
}
