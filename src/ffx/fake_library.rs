//! A fake ffx-api library for unit tests, with separate state for each test thread.

use std::cell::RefCell;
use std::ffi::{CStr, c_void};
use std::ptr::null_mut;

use super::bindings::*;
use super::{Api, Header};

/// The fake library's behaviour and its record of calls.
#[derive(Default)]
pub(super) struct FakeLibrary {
    /// Its providers.
    pub(super) providers: Vec<(u64, &'static CStr)>,
    /// The provider that a context reports; None if it cannot.
    pub(super) running_provider: Option<(u64, &'static CStr)>,
    /// Structs that it rejects, each with the code returned.
    pub(super) rejects: Vec<(StructId, ReturnCode)>,
    /// The message that it sends when it rejects a struct.
    pub(super) message: &'static str,
    /// Whether creation succeeds with a null context.
    pub(super) returns_null_context: bool,
    /// Every call: its name, the ids of its chain, and the returned code.
    pub(super) calls: Vec<(&'static str, Vec<u64>, u32)>,
    /// The provider id that the last context requested.
    pub(super) requested_version: Option<u64>,
    /// The registered message callback.
    pub(super) callback: Option<MessageCallback>,
}

thread_local! {
    pub(super) static FAKE: RefCell<FakeLibrary> = RefCell::default();
}

/// Records a call; returns the code configured for the chain's structs.
unsafe fn read(call: &'static str, mut at: *const Header) -> ReturnCode {
    let mut ids = Vec::new();
    while !at.is_null() {
        // SAFETY: a linked chain.
        let header = unsafe { &*at };
        ids.push(header.id());
        at = header.next();
    }
    let (code, say) = FAKE.with_borrow_mut(|fake| {
        let refused = fake.rejects.iter().find(|(id, _)| ids.contains(id));
        let code = refused.map_or(ReturnCode::OK, |(_, code)| *code);
        fake.calls.push((call, ids.iter().map(|id| id.0).collect(), code.0));
        (
            code,
            fake.callback
                .filter(|_| code != ReturnCode::OK && !fake.message.is_empty())
                .map(|callback| (callback, fake.message)),
        )
    });
    if let Some((callback, text)) = say {
        let units: Vec<u16> = text.encode_utf16().chain([0]).collect();
        // SAFETY: ends with a zero.
        unsafe { callback(0, units.as_ptr()) };
    }
    code
}

unsafe extern "C-unwind" fn create(
    context: *mut RawContext,
    head: *mut Header,
    _: *const AllocationCallbacks,
) -> ReturnCode {
    // SAFETY: a linked chain.
    let code = unsafe { read("create", head) };
    let mut at: *const Header = head;
    while !at.is_null() {
        // SAFETY: a linked chain, and the id tells a link's type.
        unsafe {
            if (*at).id() == StructId::OVERRIDE_VERSION {
                let id = (*at.cast::<OverrideVersion>()).version_id;
                FAKE.with_borrow_mut(|fake| fake.requested_version = Some(id));
            }
            at = (*at).next();
        }
    }
    if code == ReturnCode::OK && !FAKE.with_borrow(|fake| fake.returns_null_context) {
        // SAFETY: the caller's memory for the handle.
        unsafe { *context = 0x77 as RawContext };
    }
    code
}

unsafe extern "C-unwind" fn destroy(_: *mut RawContext, _: *const AllocationCallbacks) -> ReturnCode {
    // SAFETY: no chain.
    unsafe { read("destroy", null_mut()) }
}

unsafe extern "C-unwind" fn configure(_: *mut RawContext, head: *const Header) -> ReturnCode {
    // SAFETY: a linked chain.
    let code = unsafe { read("configure", head) };
    // SAFETY: the id tells the struct's type.
    let callback = unsafe {
        match (*head).id() {
            StructId::GLOBAL_DEBUG_1 => (*head.cast::<ConfigureGlobalDebug1>()).message,
            StructId::GLOBAL_DEBUG => (*head.cast::<ConfigureGlobalDebug>()).message,
            _ => return code,
        }
    };
    if code == ReturnCode::OK {
        FAKE.with_borrow_mut(|fake| fake.callback = callback);
    }
    code
}

unsafe extern "C-unwind" fn query(_: *mut RawContext, head: *mut Header) -> ReturnCode {
    // SAFETY: a linked chain.
    let code = unsafe { read("query", head) };
    // SAFETY: the id tells the struct's type, and its arrays have the stated capacity.
    unsafe {
        if code != ReturnCode::OK {
            return code;
        }
        match (*head).id() {
            StructId::GET_VERSIONS => FAKE.with_borrow(|fake| {
                let query = &*head.cast::<QueryVersions>();
                let capacity = usize::try_from(*query.count).expect("small");
                for (index, (id, name)) in fake.providers.iter().take(capacity).enumerate() {
                    *query.ids.add(index) = *id;
                    *query.names.add(index) = name.as_ptr();
                }
                // As AMD's: at most the caller's capacity, so that a query for the count alone returns 0.
                *query.count = fake.providers.len().min(capacity) as u64;
                code
            }),
            StructId::GET_PROVIDER_VERSION => FAKE.with_borrow(|fake| match fake.running_provider {
                Some((id, name)) => {
                    let query = &mut *head.cast::<QueryProviderVersion>();
                    (query.version_id, query.version_name) = (id, name.as_ptr());
                    code
                }
                None => ReturnCode::UNKNOWN_STRUCT,
            }),
            _ => ReturnCode::UNKNOWN_STRUCT,
        }
    }
}

unsafe extern "C-unwind" fn dispatch(_: *mut RawContext, head: *const Header) -> ReturnCode {
    // SAFETY: a linked chain.
    unsafe { read("dispatch", head) }
}

pub(super) fn api() -> Api {
    let find = |name: &CStr| -> *const c_void {
        match name.to_bytes() {
            b"ffxCreateContext" => create as CreateContext as _,
            b"ffxDestroyContext" => destroy as DestroyContext as _,
            b"ffxConfigure" => configure as Configure as _,
            b"ffxQuery" => query as Query as _,
            _ => dispatch as Dispatch as _,
        }
    };
    // SAFETY: functions of these types, which stay.
    unsafe { Api::from_exports(find) }.expect("all are there")
}

pub(super) fn head() -> CreateFrameGeneration {
    let size = Dimensions { width: 640, height: 360 };
    CreateFrameGeneration {
        display_size: size,
        max_render_size: size,
        back_buffer_format: SurfaceFormat::R8G8B8A8_UNORM,
        ..Default::default()
    }
}

/// The ids of the creation chains of all contexts.
pub(super) fn creations() -> Vec<Vec<u64>> {
    FAKE.with_borrow(|fake| {
        fake.calls.iter().filter(|(call, ..)| *call == "create").map(|(_, ids, _)| ids.clone()).collect()
    })
}

pub(super) fn count(call: &str) -> usize {
    FAKE.with_borrow(|fake| fake.calls.iter().filter(|(name, ..)| *name == call).count())
}

pub(super) const ANALYTIC_20: (u64, &CStr) = (0xf600_0000_00c0_1005, c"3.1.5");
pub(super) const ANALYTIC: (u64, &CStr) = (0xf600_0000_00c0_1006, c"3.1.6");
pub(super) const ML: (u64, &CStr) = (0xf600_0000_0100_0001, c"4.0.1");
