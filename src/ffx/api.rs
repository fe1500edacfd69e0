//! The five functions of ffx-api, and the meaning of their return codes.

use std::ffi::{CStr, c_void};
use std::fmt;
use std::ptr::{null, null_mut};

#[cfg(windows)]
use super::Header;
use super::bindings::{
    Configure, CreateContext, DestroyContext, Dispatch, EffectId, Query, RawContext, ReturnCode, StructId,
};
use super::diagnosis::Diagnosis;
use super::{Chain, FfxStruct, exception, message};
use crate::{Error, ErrorKind, Result};

/// The functions of one library.
#[derive(Debug, Clone, Copy)]
pub struct Api {
    create: CreateContext,
    destroy: DestroyContext,
    configure: Configure,
    query: Query,
    dispatch: Dispatch,
}

impl Api {
    /// The names of the functions, as a library exports them.
    pub const EXPORTS: [&CStr; 5] =
        [c"ffxCreateContext", c"ffxDestroyContext", c"ffxConfigure", c"ffxQuery", c"ffxDispatch"];

    /// Looks the functions up by name with `find`.
    ///
    /// # Errors
    /// The names for which `find` returned null.
    ///
    /// # Safety
    /// `find` returns ffx-api's functions of these names, which stay valid for the life of the process.
    pub unsafe fn from_exports(mut find: impl FnMut(&CStr) -> *const c_void) -> Result<Self, Vec<&'static CStr>> {
        let found = Self::EXPORTS.map(&mut find);
        let missing: Vec<_> =
            Self::EXPORTS.into_iter().zip(found).filter(|(_, at)| at.is_null()).map(|(name, _)| name).collect();
        if !missing.is_empty() {
            return Err(missing);
        }
        let [create, destroy, configure, query, dispatch] = found;
        // SAFETY: each is the function of its name, by the caller's promise, and none is null.
        Ok(unsafe {
            Self {
                create: std::mem::transmute::<*const c_void, CreateContext>(create),
                destroy: std::mem::transmute::<*const c_void, DestroyContext>(destroy),
                configure: std::mem::transmute::<*const c_void, Configure>(configure),
                query: std::mem::transmute::<*const c_void, Query>(query),
                dispatch: std::mem::transmute::<*const c_void, Dispatch>(dispatch),
            }
        })
    }

    /// `ffxCreateContext`, with the library's own allocator.
    ///
    /// # Safety
    /// The chain's pointers are valid, as its fields describe, as long as the context lives.
    pub(super) unsafe fn create<Head: FfxStruct>(&self, chain: &mut Chain<Head>) -> Result<RawContext, Failure> {
        let mut context = null_mut();
        let (place, head) = (&raw mut context, chain.as_ptr());
        // SAFETY: a linked chain; its pointers are as the caller promises.
        let code = call_library(|| unsafe { (self.create)(place, head, null()) });
        check_chain_call("ffxCreateContext", code, chain)?;
        if context.is_null() {
            let messages = "it says that it succeeded, and gave no context".to_owned();
            let (call, code) = ("ffxCreateContext", ReturnCode::OK);
            return Err(Failure {
                call,
                code,
                passed: format!("{chain:?}"),
                messages,
                diagnosis: Diagnosis::of(chain, code),
            });
        }
        Ok(context)
    }

    /// `ffxDestroyContext`.
    ///
    /// # Safety
    /// A context of this library that the device no longer uses, and that is not used again.
    pub(super) unsafe fn destroy(&self, mut context: RawContext) -> Result<(), Failure> {
        let place = &raw mut context;
        // SAFETY: as the caller promises.
        let code = call_library(|| unsafe { (self.destroy)(place, null()) });
        check_call("ffxDestroyContext", code, || (String::new(), Diagnosis::OF_DESTROY))
    }

    /// `ffxConfigure`.
    ///
    /// # Safety
    /// A live context of this library, or null; the chain's pointers are valid, as its fields describe.
    pub(super) unsafe fn configure<Head: FfxStruct>(
        &self,
        mut context: RawContext,
        chain: &mut Chain<Head>,
    ) -> Result<(), Failure> {
        let (context, head) = (or_null(&mut context), chain.as_ptr());
        // SAFETY: as the caller promises.
        let code = call_library(|| unsafe { (self.configure)(context, head) });
        check_chain_call("ffxConfigure", code, chain)
    }

    /// `ffxQuery`.
    ///
    /// # Safety
    /// As [`Self::configure`]; the memory for answers may be written.
    pub(super) unsafe fn query<Head: FfxStruct>(
        &self,
        mut context: RawContext,
        chain: &mut Chain<Head>,
    ) -> Result<(), Failure> {
        let (context, head) = (or_null(&mut context), chain.as_ptr());
        // SAFETY: as the caller promises.
        let code = call_library(|| unsafe { (self.query)(context, head) });
        check_chain_call("ffxQuery", code, chain)
    }

    /// `ffxDispatch`.
    ///
    /// # Safety
    /// A live context of this library; command list and resources are as the fields describe, and live until the list has run.
    pub(super) unsafe fn dispatch<Head: FfxStruct>(
        &self,
        mut context: RawContext,
        chain: &mut Chain<Head>,
    ) -> Result<(), Failure> {
        let (place, head) = (&raw mut context, chain.as_ptr());
        // SAFETY: as the caller promises.
        let code = call_library(|| unsafe { (self.dispatch)(place, head) });
        check_chain_call("ffxDispatch", code, chain)
    }
}

#[cfg(windows)]
impl Api {
    /// Forwards a struct of the library's own to `ffxDispatch`.
    ///
    /// # Safety
    /// A live context of this library; the library has just passed the struct to a callback for dispatch.
    pub(super) unsafe fn forward(&self, mut context: RawContext, head: *const Header) -> ReturnCode {
        let place = &raw mut context;
        // SAFETY: as the caller promises.
        call_library(|| unsafe { (self.dispatch)(place, head) })
    }
}

/// The context argument of a call that accepts none: the handle's address, or null.
fn or_null(context: &mut RawContext) -> *mut RawContext {
    if context.is_null() { null_mut() } else { context }
}

/// Makes a call, after clearing the messages recorded on this thread. AMD's libraries throw C++ exceptions where Direct3D fails, for example since
/// the device is removed: that is `RUNTIME_ERROR`, with a message.
fn call_library(call: impl Fn() -> ReturnCode + Copy) -> ReturnCode {
    message::clear();
    exception::catch(call).unwrap_or_else(|| {
        message::record(log::Level::Error, "the call threw a C++ exception");
        ReturnCode::RUNTIME_ERROR
    })
}

fn check_chain_call<Head: FfxStruct>(call: &'static str, code: ReturnCode, chain: &Chain<Head>) -> Result<(), Failure> {
    check_call(call, code, || (format!("{chain:?}"), Diagnosis::of(chain, code)))
}

fn check_call(
    call: &'static str,
    code: ReturnCode,
    describe: impl FnOnce() -> (String, Diagnosis),
) -> Result<(), Failure> {
    if code == ReturnCode::OK {
        return Ok(());
    }
    let (passed, diagnosis) = describe();
    Err(Failure { call, code, passed, messages: message::collected(), diagnosis })
}

/// A failed call.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub(super) call: &'static str,
    pub(super) code: ReturnCode,
    /// All structs of the chain with their fields, as text.
    pub(super) passed: String,
    /// The library's messages during the call; may be empty.
    pub(super) messages: String,
    /// The most likely cause.
    diagnosis: Diagnosis,
}

impl Failure {
    /// Whether the failure means that the library does not know a struct of the chain.
    pub(super) fn is_unknown_struct(&self) -> bool {
        matches!(self.code, ReturnCode::UNKNOWN_STRUCT | ReturnCode::STRUCT_TOO_NEW)
    }

    /// The failure as an error, with the field that most likely caused it.
    pub(super) fn error(&self) -> Error {
        let (kind, meaning, remedy) = meaning(self.code);
        let Diagnosis { field, why } = &self.diagnosis;
        let mut cause = format!("{} answered {} ({:?}): {meaning}; {field}: {why}", self.call, self.code.0, self.code);
        if !self.messages.is_empty() {
            cause = format!("{cause}; the library says: {}", self.messages);
        }
        if !self.passed.is_empty() {
            cause = format!("{cause}; it was given {}", self.passed);
        }
        Error::new(kind, cause).field(*field).remedy(remedy)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.error().fmt(f)
    }
}

/// A return code's error kind, meaning and remedy.
fn meaning(code: ReturnCode) -> (ErrorKind, &'static str, &'static str) {
    match code {
        ReturnCode::OK => (ErrorKind::Device, "an answer that does not fit what it did", REPORT),
        ReturnCode::ERROR => (ErrorKind::Device, "it failed, and says no more", REPORT),
        ReturnCode::UNKNOWN_STRUCT => {
            (ErrorKind::Unsupported, "it does not know one of the structs", "Use a newer release of AMD's libraries")
        }
        ReturnCode::RUNTIME_ERROR => (
            ErrorKind::Device,
            "Direct3D, or the effect itself, failed",
            "See whether the device was removed, memory is short, or formats and sizes do not fit together",
        ),
        ReturnCode::NO_PROVIDER => (
            ErrorKind::Unsupported,
            "no provider for this effect is there",
            "Put the effect's own library beside the loader, or use another adapter or driver",
        ),
        ReturnCode::MEMORY => (ErrorKind::OutOfMemory, "memory could not be had", "Use smaller sizes"),
        ReturnCode::PARAMETER => (
            ErrorKind::InvalidArgument,
            "a pointer is null, a resource is empty, or a value is none of its set",
            "Compare what it was given with what it needs",
        ),
        ReturnCode::STRUCT_TOO_NEW => (
            ErrorKind::Unsupported,
            "one of the structs is newer than the provider",
            "Use a newer release of AMD's libraries, or a newer driver",
        ),
        _ => (ErrorKind::Device, "an answer that is not known", "Use a release of AMD's libraries from 1.1 to 2.4"),
    }
}

const REPORT: &str = "Look at the log for what the library said";

/// The effect of a context.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Effect {
    /// Frame generation.
    FrameGeneration,
    /// Upscaling.
    Upscaling,
}

impl Effect {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::FrameGeneration, Self::Upscaling];

    /// The id of the struct that creates its contexts.
    pub fn create(self) -> StructId {
        match self {
            Self::FrameGeneration => StructId::FRAME_GENERATION,
            Self::Upscaling => StructId::UPSCALE,
        }
    }

    /// The effect that a struct belongs to; None for other effects.
    pub fn of(id: StructId) -> Option<Self> {
        match id.effect() {
            EffectId::FRAME_GENERATION | EffectId::SWAPCHAIN => Some(Self::FrameGeneration),
            EffectId::UPSCALE => Some(Self::Upscaling),
            _ => None,
        }
    }
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FrameGeneration => "frame generation",
            Self::Upscaling => "upscaling",
        })
    }
}
