//! A shim between the library and the double that changes one field of a call's structs, and classifies how the change was detected.

use std::collections::BTreeMap;
use std::ffi::{CStr, c_void};
use std::ops::RangeInclusive;
use std::os::windows::ffi::OsStrExt;
use std::sync::{Mutex, MutexGuard, PoisonError};

use cairn::ffx::{Api, LibraryKind};
use cairn::gpu::windows::Win32::System::LibraryLoader::{GetProcAddress, LoadLibraryW};
use cairn::gpu::windows::core::{PCSTR, PCWSTR};
use test_support::ffx::double_folder::DoubleFolder;

use crate::struct_table::{FieldType, Struct};

/// A change of one field.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mutant {
    pub(crate) id: u64,
    pub(crate) offset: usize,
    pub(crate) kind: FieldType,
    pub(crate) change: Change,
}

/// The kind of change. `Largest` sets all bits of a number; `Exchanged` swaps the field with the next one of the same kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Change {
    Zero,
    Largest,
    NotANumber,
    OneMore,
    Exchanged(usize),
}

/// Original bytes of the changed fields, with their addresses.
pub(crate) type Before = Vec<(*mut u8, Vec<u8>)>;

/// The five functions of a copy of the double.
#[derive(Clone, Copy)]
pub(crate) struct Functions {
    create: unsafe extern "C" fn(*mut c_void, *mut u8, *const c_void) -> u32,
    destroy: unsafe extern "C" fn(*mut c_void, *const c_void) -> u32,
    configure: unsafe extern "C" fn(*mut c_void, *mut u8) -> u32,
    query: unsafe extern "C" fn(*mut c_void, *mut u8) -> u32,
    dispatch: unsafe extern "C" fn(*mut c_void, *mut u8) -> u32,
}

/// State of the shim between the library and a copy of the double.
pub(crate) struct Shim {
    copy: Option<Functions>,
    /// The change to apply.
    pub(crate) mutant: Option<Mutant>,
    /// Whether the change altered a value.
    pub(crate) was_applied: bool,
    /// Whether a call returned an error.
    pub(crate) refused: bool,
}

pub(crate) static SHIM: Mutex<Shim> = Mutex::new(Shim { copy: None, mutant: None, was_applied: false, refused: false });

pub(crate) fn shim() -> MutexGuard<'static, Shim> {
    SHIM.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Forwards a call with the mutant in its chain, then restores the original bytes.
///
/// # Safety
/// A linked chain that may be written and that nobody else uses during the call.
unsafe fn forward(head: *mut u8, call: impl FnOnce(&Functions) -> u32) -> u32 {
    let mut state = shim();
    // SAFETY: the caller's promise.
    let before = state.mutant.map_or(Before::new(), |mutant| unsafe { mutant.change(head) });
    let code = call(&state.copy.expect("a copy was loaded"));
    state.was_applied |= !before.is_empty();
    state.refused |= code != 0;
    for (place, bytes) in before {
        // SAFETY: the bytes' original address.
        unsafe { place.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) };
    }
    code
}

impl Mutant {
    /// Changes the link with the mutant's struct id, if the chain has one.
    ///
    /// # Safety
    /// A linked chain that may be written and that nobody else uses during the call.
    unsafe fn change(&self, head: *mut u8) -> Before {
        let (mut before, mut at) = (Before::new(), head);
        while !at.is_null() {
            // SAFETY: a link of the chain: its id, and the address of the next.
            let (id, next) = unsafe { (at.cast::<u64>().read(), at.cast::<*mut u8>().add(1).read()) };
            if id == self.id {
                // SAFETY: the struct of that id has the field there, by its published layout.
                unsafe { self.apply(at, &mut before) };
                break;
            }
            at = next;
        }
        before
    }

    /// # Safety
    /// `head` is a struct of the mutant's id, which may be written.
    unsafe fn apply(&self, head: *mut u8, before: &mut Before) {
        let size = self.kind.size();
        let bytes = |offset: usize| {
            // SAFETY: a field of the struct.
            unsafe { std::slice::from_raw_parts(head.add(offset), size) }.to_vec()
        };
        let old = bytes(self.offset);
        let new = match self.change {
            Change::Zero => vec![0; size],
            Change::Largest if self.kind == FieldType::Float => f32::MAX.to_le_bytes().to_vec(),
            Change::Largest if self.kind == FieldType::Signed => i32::MAX.to_le_bytes().to_vec(),
            Change::Largest => vec![0xff; size],
            Change::NotANumber => f32::NAN.to_le_bytes().to_vec(),
            Change::OneMore if self.kind == FieldType::Float => {
                let value = f32::from_le_bytes(old[..].try_into().expect("4 bytes"));
                (value + 1.0).to_le_bytes().to_vec()
            }
            Change::OneMore => {
                let mut wide = [0; 8];
                wide[..size].copy_from_slice(&old);
                u64::from_le_bytes(wide).wrapping_add(1).to_le_bytes()[..size].to_vec()
            }
            Change::Exchanged(other) => bytes(other),
        };
        if new == old {
            return;
        }
        let mut write = |offset: usize, new: &[u8], old: Vec<u8>| {
            // SAFETY: a field of the struct, of that size.
            unsafe {
                head.add(offset).copy_from_nonoverlapping(new.as_ptr(), size);
                before.push((head.add(offset), old));
            }
        };
        if let Change::Exchanged(other) = self.change {
            write(other, &old, new.clone());
        }
        write(self.offset, &new, old);
    }
}

unsafe extern "C" fn create(context: *mut c_void, head: *mut u8, callbacks: *const c_void) -> u32 {
    // SAFETY: forwarded unchanged, except for the mutant.
    unsafe { forward(head, |copy| (copy.create)(context, head, callbacks)) }
}

unsafe extern "C" fn destroy(context: *mut c_void, callbacks: *const c_void) -> u32 {
    // SAFETY: forwarded unchanged.
    unsafe { forward(std::ptr::null_mut(), |copy| (copy.destroy)(context, callbacks)) }
}

unsafe extern "C" fn configure(context: *mut c_void, head: *mut u8) -> u32 {
    // SAFETY: forwarded unchanged, except for the mutant.
    unsafe { forward(head, |copy| (copy.configure)(context, head)) }
}

unsafe extern "C" fn query(context: *mut c_void, head: *mut u8) -> u32 {
    // SAFETY: forwarded unchanged, except for the mutant.
    unsafe { forward(head, |copy| (copy.query)(context, head)) }
}

unsafe extern "C" fn dispatch(context: *mut c_void, head: *mut u8) -> u32 {
    // SAFETY: forwarded unchanged, except for the mutant.
    unsafe { forward(head, |copy| (copy.dispatch)(context, head)) }
}

/// The shim's functions, in front of a copy of the double.
pub(crate) fn api(double: &DoubleFolder, part: LibraryKind) -> Api {
    let path = double.0.join(part.file_name());
    let path: Vec<u16> = path.as_os_str().encode_wide().chain([0]).collect();
    // SAFETY: a path that ends with a zero, of the double.
    let module = unsafe { LoadLibraryW(PCWSTR(path.as_ptr())) }.expect("the copy loads");
    let find = |name: &CStr| {
        // SAFETY: a loaded module and a name that ends with a zero.
        unsafe { GetProcAddress(module, PCSTR(name.as_ptr().cast())) }.expect("it is exported")
    };
    let [create_name, destroy_name, configure_name, query_name, dispatch_name] = Api::EXPORTS;
    type Found = unsafe extern "system" fn() -> isize;
    // SAFETY: ffx-api's functions by their names; structs and contexts are addresses here.
    let copy = unsafe {
        Functions {
            create: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *mut u8, *const c_void) -> u32>(
                find(create_name),
            ),
            destroy: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *const c_void) -> u32>(find(
                destroy_name,
            )),
            configure: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *mut u8) -> u32>(find(
                configure_name,
            )),
            query: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *mut u8) -> u32>(find(query_name)),
            dispatch: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *mut u8) -> u32>(find(
                dispatch_name,
            )),
        }
    };
    shim().copy = Some(copy);
    let ours = |name: &CStr| -> *const c_void {
        match name {
            name if name == create_name => create as *const c_void,
            name if name == destroy_name => destroy as *const c_void,
            name if name == configure_name => configure as *const c_void,
            name if name == query_name => query as *const c_void,
            _ => dispatch as *const c_void,
        }
    };
    // SAFETY: functions that forward to ffx-api's of their names, and are static.
    unsafe { Api::from_exports(ours) }.expect("all are there")
}

/// How a mutant was detected: by return code, by rule violation or by picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Detection {
    ByReturnCode,
    ByViolation,
    ByPicture,
    Undetected,
}

/// Ranges of existing struct ids: general, upscaling and frame generation.
pub(crate) const NUMBERED: [RangeInclusive<u64>; 3] = [1..=7, 0x1_0000..=0x1_000b, 0x2_0001..=0x2_000e];

/// All mutants of a struct: each change of each field that its kind allows.
pub(crate) fn mutants(of: &Struct) -> Vec<(String, Mutant)> {
    let mut found = Vec::new();
    for (index, (field, offset, kind)) in of.fields.iter().enumerate() {
        let (offset, kind) = (*offset, *kind);
        let next = of.fields[index + 1..].iter().find(|(_, _, other)| *other == kind).map(|(_, offset, _)| *offset);
        let exchange = next.map(Change::Exchanged);
        let changes: Vec<_> = match kind {
            FieldType::Answer => Vec::new(),
            FieldType::Pointer => vec![Change::Zero],
            FieldType::Float => [Change::Zero, Change::Largest, Change::NotANumber, Change::OneMore]
                .into_iter()
                .chain(exchange)
                .collect(),
            FieldType::Id if NUMBERED.iter().any(|of_effect| of_effect.contains(&(of.id + 1))) => {
                vec![Change::Zero, Change::Largest]
            }
            FieldType::Id => vec![Change::Zero, Change::Largest, Change::OneMore],
            FieldType::Number(_) | FieldType::Signed => {
                [Change::Zero, Change::Largest, Change::OneMore].into_iter().chain(exchange).collect()
            }
        };
        found.extend(changes.into_iter().map(|change| {
            let name = match change {
                Change::Exchanged(_) => "exchanged".to_owned(),
                other => format!("{other:?}").to_lowercase(),
            };
            (format!("{}.{field} {name}", of.name), Mutant { id: of.id, offset, kind, change })
        }));
    }
    found
}

/// Number of mutants by kind of detection, and the names of undetected ones.
#[derive(Default)]
pub(crate) struct Report {
    pub(crate) counts: BTreeMap<Detection, usize>,
    pub(crate) missed: Vec<String>,
}

impl Report {
    pub(crate) fn add(&mut self, name: String, noticed: Detection) {
        *self.counts.entry(noticed).or_default() += 1;
        if noticed == Detection::Undetected {
            self.missed.push(name);
        }
    }
}

/// Tries one mutant; `act` returns the picture or the error. None if the mutant altered nothing.
pub(crate) fn try_mutant(
    double: &DoubleFolder,
    truth: &[[u8; 4]],
    verdicts: &mut usize,
    act: impl FnOnce() -> cairn::Result<Vec<[u8; 4]>>,
) -> Option<Detection> {
    (shim().was_applied, shim().refused) = (false, false);
    let picture = act();
    let before = std::mem::replace(verdicts, double.violations().len());
    let state = shim();
    state.was_applied.then_some(match picture {
        Err(_) => Detection::ByReturnCode,
        Ok(_) if state.refused => Detection::ByReturnCode,
        Ok(_) if *verdicts > before => Detection::ByViolation,
        Ok(picture) if picture != truth => Detection::ByPicture,
        Ok(_) => Detection::Undetected,
    })
}
