//! Calls in a log callback that would wait for the callback's own thread return CAIRN_ERROR_BUSY, and the step continues.
#![cfg(feature = "embedded-world")]

use std::ffi::{c_char, c_void};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicPtr, AtomicU64, AtomicUsize, Ordering};

use cairn::abi::controls::cairn_controls;
use cairn::abi::device::{
    CAIRN_DEVICE_ENVIRONMENT, cairn_device_create_cpu, cairn_device_destroy, cairn_device_options,
};
use cairn::abi::images::cairn_picture;
use cairn::abi::logging::{CAIRN_LOG_INFO, CAIRN_LOG_OFF, cairn_set_log_callback};
use cairn::abi::results::{CAIRN_ERROR_BUSY, CAIRN_NOT_READY, CAIRN_OK, cairn_last_error};
use cairn::abi::rollout::{
    cairn_rollout, cairn_rollout_append, cairn_rollout_create, cairn_rollout_destroy, cairn_rollout_set_budget,
    cairn_rollout_step,
};
use cairn::abi::steps::{CAIRN_FOREVER, cairn_rollout_poll, cairn_rollout_submit, cairn_rollout_wait};
use cairn::abi::world::{cairn_world_destroy, cairn_world_load, cairn_world_options};

/// Data for the log callback.
#[derive(Default)]
struct CallbackData {
    rollout: AtomicPtr<cairn_rollout>,
    /// The ticket to wait for; 0 to submit a step first.
    ticket: AtomicU64,
    calls: AtomicUsize,
}

fn controls() -> cairn_controls {
    // SAFETY: zeroes are every field's default.
    cairn_controls { struct_size: size_of::<cairn_controls>() as u32, ..unsafe { std::mem::zeroed() } }
}

/// Tries to destroy the rollout whose step logs a message, and to wait for its steps.
unsafe extern "C" fn call_from_callback(_: u32, _: *const c_char, _: *const c_char, user: *mut c_void) {
    // SAFETY: the test gave a `CallbackData` that outlives the callback.
    let data = unsafe { &*user.cast::<CallbackData>() };
    let rollout = data.rollout.load(Ordering::SeqCst);
    if rollout.is_null() {
        return;
    }
    data.calls.fetch_add(1, Ordering::SeqCst);
    // SAFETY: handles are looked up, and results are the test's own.
    unsafe {
        assert_eq!(cairn_rollout_destroy(rollout), CAIRN_ERROR_BUSY);
        let mut ticket = data.ticket.load(Ordering::SeqCst);
        if ticket == 0 {
            assert_eq!(cairn_rollout_submit(rollout, &controls(), &mut ticket), CAIRN_OK);
        }
        for timeout in [CAIRN_FOREVER, 1_000_000_000] {
            assert_eq!(cairn_rollout_wait(rollout, ticket, timeout, null_mut(), null_mut()), CAIRN_ERROR_BUSY);
        }
        assert_eq!(cairn_rollout_poll(rollout, ticket, null_mut(), null_mut()), CAIRN_NOT_READY);
        assert_eq!(cairn_rollout_step(rollout, &controls(), null_mut()), CAIRN_ERROR_BUSY);
        data.ticket.store(ticket, Ordering::SeqCst);
    }
}

/// The last error's message.
fn last_error() -> String {
    let mut text = [0_u8; 512];
    // SAFETY: as many bytes as are there.
    unsafe { cairn_last_error(text.as_mut_ptr().cast(), text.len(), null_mut()) };
    String::from_utf8_lossy(&text).trim_end_matches('\0').to_owned()
}

macro_rules! ok {
    ($call:expr) => {{
        // SAFETY: handles are looked up, and all else is the test's own.
        let result = unsafe { $call };
        assert_eq!(result, CAIRN_OK, "{}", last_error());
    }};
}

/// A rollout with a seed picture and a budget that every latent exceeds, so that its steps log messages.
fn rollout(world: *const cairn::abi::world::cairn_world) -> *mut cairn_rollout {
    let mut rollout = null_mut();
    ok!(cairn_rollout_create(world, null(), &mut rollout));
    let grey = vec![128_u8; 320 * 180 * 4];
    let picture = cairn_picture {
        struct_size: size_of::<cairn_picture>() as u32,
        width: 320,
        height: 180,
        pixels: grey.as_ptr().cast(),
        size: grey.len() as u64,
        // SAFETY: zeroes are every field's default.
        ..unsafe { std::mem::zeroed() }
    };
    ok!(cairn_rollout_append(rollout, &picture, null_mut()));
    ok!(cairn_rollout_set_budget(rollout, 1, c"stock explicit:1:0.5:0".as_ptr()));
    rollout
}

#[test]
fn a_log_callback_does_not_wait_for_its_own_thread() {
    let (mut device, mut world) = (null_mut(), null_mut());
    let options = cairn_device_options {
        struct_size: size_of::<cairn_device_options>() as u32,
        flags: CAIRN_DEVICE_ENVIRONMENT,
        // SAFETY: zeroes are every field's default.
        ..unsafe { std::mem::zeroed() }
    };
    ok!(cairn_device_create_cpu(&options, &mut device));
    // SAFETY: zeroes are every field's default.
    let options =
        cairn_world_options { struct_size: size_of::<cairn_world_options>() as u32, ..unsafe { std::mem::zeroed() } };
    ok!(cairn_world_load(device, &options, &mut world));
    let data = CallbackData::default();
    ok!(cairn_set_log_callback(CAIRN_LOG_INFO, Some(call_from_callback), std::ptr::from_ref(&data).cast_mut().cast()));

    // A step on the rollout's own thread.
    let queued = rollout(world);
    data.rollout.store(queued, Ordering::SeqCst);
    for _ in 0..8 {
        let mut ticket = 0;
        ok!(cairn_rollout_submit(queued, &controls(), &mut ticket));
        data.ticket.store(ticket, Ordering::SeqCst);
        ok!(cairn_rollout_wait(queued, ticket, CAIRN_FOREVER, null_mut(), null_mut()));
    }
    assert!(data.calls.swap(0, Ordering::SeqCst) > 0, "a step logs a message");
    data.rollout.store(null_mut(), Ordering::SeqCst);
    ok!(cairn_rollout_destroy(queued));

    // A step on the host's thread, in whose callback another step is queued.
    let direct = rollout(world);
    data.rollout.store(direct, Ordering::SeqCst);
    for _ in 0..8 {
        data.ticket.store(0, Ordering::SeqCst);
        ok!(cairn_rollout_step(direct, &controls(), null_mut()));
        let ticket = data.ticket.load(Ordering::SeqCst);
        if ticket != 0 {
            break;
        }
    }
    assert!(data.calls.load(Ordering::SeqCst) > 0, "a step logs a message");
    data.rollout.store(null_mut(), Ordering::SeqCst);
    let ticket = data.ticket.load(Ordering::SeqCst);
    ok!(cairn_rollout_wait(direct, ticket, CAIRN_FOREVER, null_mut(), null_mut()));
    ok!(cairn_rollout_destroy(direct));

    ok!(cairn_set_log_callback(CAIRN_LOG_OFF, None, null_mut()));
    ok!(cairn_world_destroy(world));
    ok!(cairn_device_destroy(device));
}
