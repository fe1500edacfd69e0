//! Handles: numbers that look like pointers and are never dereferenced.
//!
//! ```text
//! bits 56..64  kind of object, 1 ...      a real pointer has zeroes here
//! bits 24..56  generation of the slot     starts at a random number, so that a guess or another library's handle fails
//! bits  0..24  slot
//! ```

use std::any::Any;
use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;
use std::ops::Deref;
use std::sync::Arc;

use crate::locks::{Mutex, MutexGuard, RwLock};

use super::gate::{CallKind, Gate};
use super::results::{
    AbiResult, CAIRN_ERROR_BUSY, CAIRN_ERROR_INVALID_HANDLE, CAIRN_ERROR_OUT_OF_MEMORY, CAIRN_ERROR_POISONED, CAIRN_OK,
    Failure,
};
use crate::tasks::PoolLease;

const SLOT_BITS: u32 = 24;
const GENERATION_BITS: u32 = 32;
const _: () = assert!(size_of::<usize>() == 8, "handles need pointers of 64 bits");

/// Kinds of objects; the number is part of the handle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    Device = 1,
    World,
    Rollout,
    Anchor,
    Script,
    Recorder,
    Guidance,
    Presenter,
    Swapchain,
}

/// The opaque type that a handle points to in the header.
pub(super) trait Handle {
    const KIND: Kind;
    /// Its name in the header.
    const NAME: &'static str;
    type Object: Object;
}

/// An object behind a handle.
pub(super) trait Object: Any + Send + Sync {
    /// Called when the handle is destroyed: ends calls on the object that are waiting.
    fn close(&self) {}

    /// Whether the calling thread belongs to the object: then this is a callback of the object's work there, and destroying the object
    /// would wait for itself.
    fn is_on_own_thread(&self) -> bool {
        false
    }
}

static TABLE: RwLock<Table> = RwLock::new(Table { slots: Vec::new(), free: Vec::new() });

struct Table {
    slots: Vec<Slot>,
    free: Vec<u32>,
}

struct Slot {
    generation: u32,
    /// The first generation. When the counter wraps around to it, the slot is not used again.
    first: u32,
    entry: Option<Entry>,
}

struct Entry {
    kind: Kind,
    gate: Arc<Gate>,
    object: Arc<dyn Object>,
    /// Keeps the threads that share the library's work. The last field: they end after the last object.
    _threads: PoolLease,
}

/// A call's reference to an object. The object's destruction waits until it is dropped; a panic while it lives poisons the object.
pub(super) struct ObjectGuard<T> {
    // Dropped before the gate is left, so that the thread that waits there to destroy the object has the last reference.
    object: Arc<T>,
    is_nested: bool,
    _call: CallGuard,
}

/// A call that has entered a gate, and leaves it when dropped.
struct CallGuard {
    gate: Arc<Gate>,
    kind: CallKind,
    was_panicking: bool,
}

impl<T> ObjectGuard<T> {
    /// Whether this call comes from a callback of another call on the object: waiting for a lock of that call would deadlock.
    pub(super) fn is_nested(&self) -> bool {
        self.is_nested
    }

    /// Locks a part of the object. A nested call does not wait, because the outer call may hold the lock, but fails.
    pub(super) fn lock_part<'a, M>(&self, part: &'a Mutex<M>) -> AbiResult<MutexGuard<'a, M>> {
        if !self.is_nested {
            return Ok(part.lock());
        }
        part.try_lock().ok_or_else(busy_in_callback)
    }

    /// Shares ownership of the object, which then outlives its handle.
    pub(super) fn share(&self) -> Arc<T> {
        self.object.clone()
    }
}

/// The failure of a callback that needs a lock of the call it comes from.
pub(super) fn busy_in_callback() -> Failure {
    Failure::new(CAIRN_ERROR_BUSY, "the object is in use: this is a callback of a call on it")
        .remedy("Call it after that call")
}

impl<T> Deref for ObjectGuard<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.object
    }
}

impl Drop for CallGuard {
    fn drop(&mut self) {
        if std::thread::panicking() && !self.was_panicking {
            self.gate.poison();
        }
        self.gate.leave(self.kind);
    }
}

/// Inserts an object, which may be shared, and returns its handle. The caller destroys the handle.
pub(super) fn insert<H: Handle>(object: impl Into<Arc<H::Object>>) -> AbiResult<*mut H> {
    let full = || {
        Failure::new(CAIRN_ERROR_OUT_OF_MEMORY, "there is no room for another handle").remedy("Destroy some objects")
    };
    let entry = Entry { kind: H::KIND, gate: Arc::default(), object: object.into(), _threads: PoolLease::new() };
    let mut table = TABLE.write();
    let slot = match table.free.pop() {
        Some(slot) => slot,
        None => {
            let slot = u32::try_from(table.slots.len()).ok().filter(|slot| *slot < 1 << SLOT_BITS).ok_or_else(full)?;
            // Reserved here, so that freeing a slot never allocates.
            let spare = table.slots.len() + 1 - table.free.len();
            table.free.try_reserve(spare).map_err(|_| full())?;
            table.slots.try_reserve(1).map_err(|_| full())?;
            let first = RandomState::new().hash_one(slot) as u32;
            table.slots.push(Slot { generation: first, first, entry: None });
            slot
        }
    };
    let free = &mut table.slots[slot as usize];
    free.entry = Some(entry);
    Ok(encode::<H>(free.generation, slot))
}

/// Inserts an object, as [`insert`] does, and writes its handle to `to`.
///
/// # Safety
/// `to` can be written.
pub(super) unsafe fn insert_to<H: Handle>(object: impl Into<Arc<H::Object>>, to: *mut *mut H) -> AbiResult {
    let handle = insert(object)?;
    // SAFETY: the caller's promise.
    unsafe { to.write(handle) };
    Ok(CAIRN_OK)
}

/// Gets the object of `handle` for a call that may run at the same time as others.
pub(super) fn enter<H: Handle>(handle: *const H) -> AbiResult<ObjectGuard<H::Object>> {
    start_call(handle, CallKind::Concurrent, Poisoned::Refused)
}

/// Gets the object of `handle` for a question that precedes its destruction, also if an earlier call has poisoned it.
pub(super) fn enter_before_destruction<H: Handle>(handle: *const H) -> AbiResult<ObjectGuard<H::Object>> {
    start_call(handle, CallKind::Concurrent, Poisoned::Accepted)
}

/// Gets the object of `handle` for a call that excludes other serialized calls.
pub(super) fn enter_serialized<H: Handle>(handle: *mut H) -> AbiResult<ObjectGuard<H::Object>> {
    start_call(handle.cast_const(), CallKind::Serialized, Poisoned::Refused)
}

/// Whether a call may use an object that an earlier call has poisoned.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Poisoned {
    Accepted,
    Refused,
}

fn start_call<H: Handle>(handle: *const H, kind: CallKind, poisoned: Poisoned) -> AbiResult<ObjectGuard<H::Object>> {
    let table = TABLE.read();
    let entry = table.find(handle)?;
    let (gate, object) = (entry.gate.clone(), entry.object.clone());
    if poisoned == Poisoned::Refused && gate.is_poisoned() {
        return Err(Failure::new(
            CAIRN_ERROR_POISONED,
            format!("an earlier call on this {} failed by a fault of the library", H::NAME),
        )
        .remedy("Destroy it"));
    }
    let is_on_own_thread = object.is_on_own_thread();
    let object =
        (object as Arc<dyn Any + Send + Sync>).downcast().map_err(|_| invalid_handle::<H>("is of another kind"))?;
    // Still under the table's lock, so that destroying on another thread either comes first or waits for this call.
    let is_nested = gate.has_call_of_this_thread() || is_on_own_thread;
    if kind == CallKind::Serialized && is_on_own_thread || !gate.enter(kind) {
        return Err(busy::<H>("another call is using it"));
    }
    Ok(ObjectGuard { object, is_nested, _call: CallGuard { gate, kind, was_panicking: std::thread::panicking() } })
}

/// Destroys a handle: later calls do not find it, and this waits for calls in flight. The object is dropped when no other object
/// refers to it.
pub(super) fn destroy<H: Handle>(handle: *mut H) -> AbiResult {
    if handle.is_null() {
        return Ok(CAIRN_OK);
    }
    let entry = {
        let mut table = TABLE.write();
        let entry = table.find(handle.cast_const())?;
        if entry.gate.has_call_of_this_thread() || entry.object.is_on_own_thread() {
            return Err(busy::<H>("this is a callback of a call on it").remedy("Destroy it after that call"));
        }
        table.remove(handle.cast_const())
    };
    if let Some(entry) = entry {
        entry.object.close();
        entry.gate.wait_empty();
    }
    Ok(CAIRN_OK)
}

impl Table {
    fn find<H: Handle>(&self, handle: *const H) -> AbiResult<&Entry> {
        if handle.is_null() {
            return Err(invalid_handle::<H>("is null"));
        }
        let (kind, generation, slot) = decode(handle);
        let slot = self.slots.get(slot).filter(|slot| slot.generation == generation);
        match slot.and_then(|slot| slot.entry.as_ref()) {
            Some(entry) if kind != entry.kind as u8 => Err(invalid_handle::<H>("never was one")),
            Some(entry) if entry.kind != H::KIND => Err(invalid_handle::<H>("is of another kind")),
            Some(entry) => Ok(entry),
            None => Err(invalid_handle::<H>("was destroyed, or never was one")),
        }
    }

    fn remove<H>(&mut self, handle: *const H) -> Option<Entry> {
        let (_, _, index) = decode(handle);
        let slot = self.slots.get_mut(index)?;
        let entry = slot.entry.take();
        slot.generation = slot.generation.wrapping_add(1);
        if slot.generation != slot.first {
            self.free.push(index as u32);
        }
        entry
    }
}

fn encode<H: Handle>(generation: u32, slot: u32) -> *mut H {
    let kind = (H::KIND as usize) << (SLOT_BITS + GENERATION_BITS);
    std::ptr::without_provenance_mut(kind | (generation as usize) << SLOT_BITS | slot as usize)
}

/// Kind, generation and slot.
fn decode<H>(handle: *const H) -> (u8, u32, usize) {
    let value = handle.addr();
    ((value >> (SLOT_BITS + GENERATION_BITS)) as u8, (value >> SLOT_BITS) as u32, value & ((1 << SLOT_BITS) - 1))
}

fn invalid_handle<H: Handle>(why: &str) -> Failure {
    Failure::new(CAIRN_ERROR_INVALID_HANDLE, format!("the handle of a {} {why}", H::NAME))
}

fn busy<H: Handle>(why: &str) -> Failure {
    Failure::new(CAIRN_ERROR_BUSY, format!("the {} is in use: {why}", H::NAME))
}

#[cfg(test)]
mod tests;
