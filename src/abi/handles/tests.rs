use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, Ordering};

use super::super::boundary::call;
use super::super::results::{CAIRN_ERROR_INTERNAL, cairn_result};
use super::*;

/// Sets its flag when it is dropped.
struct DropFlag(Arc<AtomicBool>);

impl Object for DropFlag {}

impl Drop for DropFlag {
    fn drop(&mut self) {
        self.0.store(true, Ordering::SeqCst);
    }
}

enum First {}
enum Second {}

impl Handle for First {
    const KIND: Kind = Kind::Device;
    const NAME: &'static str = "first";
    type Object = DropFlag;
}

impl Handle for Second {
    const KIND: Kind = Kind::World;
    const NAME: &'static str = "second";
    type Object = DropFlag;
}

fn new_object() -> (*mut First, Arc<AtomicBool>) {
    let dropped = Arc::new(AtomicBool::new(false));
    (insert::<First>(DropFlag(dropped.clone())).unwrap(), dropped)
}

fn code<T>(result: AbiResult<T>) -> cairn_result {
    result.map_or_else(|failure| failure.code, |_| CAIRN_OK)
}

#[test]
fn a_handle_lives_until_it_is_destroyed() {
    let (handle, dropped) = new_object();
    assert!(enter(handle).is_ok());
    assert_eq!(destroy(handle).unwrap(), CAIRN_OK);
    assert!(dropped.load(Ordering::SeqCst));
    assert_eq!(code(enter(handle)), CAIRN_ERROR_INVALID_HANDLE);
    assert_eq!(code(destroy(handle)), CAIRN_ERROR_INVALID_HANDLE);
    assert_eq!(destroy(std::ptr::null_mut::<First>()).unwrap(), CAIRN_OK);
    // The slot is reused, with another handle.
    let (next, _) = new_object();
    assert_ne!(next, handle);
    assert_eq!(code(enter(handle)), CAIRN_ERROR_INVALID_HANDLE);
    destroy(next).unwrap();
}

#[test]
fn refuses_handles_of_another_kind_and_made_up_ones() {
    let (handle, _) = new_object();
    let number = handle.addr();
    let local = 0_u64;
    assert_eq!(code(enter(handle.cast::<Second>())), CAIRN_ERROR_INVALID_HANDLE);
    // The other kind, with an existing slot and generation.
    let forged = (number & ((1 << 56) - 1)) | (Kind::World as usize) << 56;
    assert_eq!(code(enter(std::ptr::without_provenance::<Second>(forged))), CAIRN_ERROR_INVALID_HANDLE);
    for bit in 0..64 {
        let guess = std::ptr::without_provenance::<First>(number ^ 1 << bit);
        assert_eq!(code(enter(guess)), CAIRN_ERROR_INVALID_HANDLE, "bit {bit}");
    }
    for guess in [0, 1, 7, 4096, usize::MAX, std::ptr::from_ref(&local).addr()] {
        assert_eq!(code(enter(std::ptr::without_provenance::<First>(guess))), CAIRN_ERROR_INVALID_HANDLE);
    }
    assert!(enter(handle).is_ok());
    destroy(handle).unwrap();
}

#[test]
fn destroying_waits_for_calls_in_flight_and_is_refused_within_one() {
    let (handle, dropped) = new_object();
    let address = handle.addr();
    let inside = Barrier::new(2);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let entered = enter(std::ptr::without_provenance::<First>(address)).unwrap();
            assert_eq!(code(destroy(std::ptr::without_provenance_mut::<First>(address))), CAIRN_ERROR_BUSY);
            inside.wait();
            std::thread::sleep(std::time::Duration::from_millis(20));
            assert!(!dropped.load(Ordering::SeqCst));
            drop(entered);
        });
        inside.wait();
        destroy(handle).unwrap();
        assert!(dropped.load(Ordering::SeqCst));
    });
}

#[test]
fn exclusive_calls_exclude_each_other() {
    let (handle, _) = new_object();
    let first = enter_serialized(handle).unwrap();
    assert_eq!(code(enter_serialized(handle)), CAIRN_ERROR_BUSY);
    assert!(enter(handle).is_ok());
    drop(first);
    assert!(enter_serialized(handle).is_ok());
    destroy(handle).unwrap();
}

#[test]
fn a_panic_poisons_the_objects_of_its_call() {
    let (handle, dropped) = new_object();
    let (other, _) = new_object();
    let result = call("f", || {
        let _object = enter(handle)?;
        panic!("a fault made by this test")
    });
    assert_eq!(result, CAIRN_ERROR_INTERNAL);
    assert_eq!(code(enter(handle)), CAIRN_ERROR_POISONED);
    assert!(enter_before_destruction(handle).is_ok());
    assert!(enter(other).is_ok());
    assert_eq!(destroy(handle).unwrap(), CAIRN_OK);
    assert!(dropped.load(Ordering::SeqCst));
    destroy(other).unwrap();
}

#[test]
fn slots_are_reused_by_threads_that_create_and_destroy() {
    // Miri is slow.
    let times = if cfg!(miri) { 25 } else { 10_000 };
    let before = TABLE.read().slots.len();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for _ in 0..times {
                    let (handle, dropped) = new_object();
                    assert!(enter(handle).is_ok());
                    destroy(handle).unwrap();
                    assert!(dropped.load(Ordering::SeqCst));
                }
            });
        }
    });
    // Other tests run at the same time.
    assert!(TABLE.read().slots.len() <= before + 32);
}
