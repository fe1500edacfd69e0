//! The five functions, and what their answers mean.

use std::ffi::{CStr, c_void};
use std::fmt;
use std::ptr::{null, null_mut};

#[cfg(windows)]
use super::Header;
use super::bindings::{
    Configure, CreateContext, DestroyContext, Dispatch, EffectId, Query, RawContext, ReturnCode, StructId,
};
use super::diagnose::Diagnosis;
use super::{Chain, Described, message};
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

    /// The functions that `find` gives by name.
    ///
    /// # Errors
    /// Names that it has not.
    ///
    /// # Safety
    /// What `find` gives are ffx-api's functions of these names, and they stay for the life of the process.
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

    /// `ffxCreateContext`, with memory of the library's own.
    ///
    /// # Safety
    /// What the chain points to is what its fields say, and lives as long as the context.
    pub(super) unsafe fn create<Head: Described>(&self, chain: &mut Chain<Head>) -> Result<RawContext, Failure> {
        let mut context = null_mut();
        let head = chain.as_ptr();
        // SAFETY: a linked chain, and the caller's promise about what it points to.
        let code = asked(|| unsafe { (self.create)(&mut context, head, null()) });
        done("ffxCreateContext", code, chain)?;
        if context.is_null() {
            let says = "it says that it succeeded, and gave no context".to_owned();
            let (call, code) = ("ffxCreateContext", ReturnCode::OK);
            return Err(Failure {
                call,
                code,
                passed: format!("{chain:?}"),
                says,
                diagnose: Diagnosis::of(chain, code),
            });
        }
        Ok(context)
    }

    /// `ffxDestroyContext`.
    ///
    /// # Safety
    /// A context of this library's, which nothing on the device uses, and which is not used again.
    pub(super) unsafe fn destroy(&self, mut context: RawContext) -> Result<(), Failure> {
        // SAFETY: as the caller promises.
        let code = asked(|| unsafe { (self.destroy)(&mut context, null()) });
        answered("ffxDestroyContext", code, || (String::new(), Diagnosis::OF_END))
    }

    /// `ffxConfigure`.
    ///
    /// # Safety
    /// A live context of this library's, or null; what the chain points to is what its fields say.
    pub(super) unsafe fn configure<Head: Described>(
        &self,
        mut context: RawContext,
        chain: &mut Chain<Head>,
    ) -> Result<(), Failure> {
        let (context, head) = (or_null(&mut context), chain.as_ptr());
        // SAFETY: as the caller promises.
        let code = asked(|| unsafe { (self.configure)(context, head) });
        done("ffxConfigure", code, chain)
    }

    /// `ffxQuery`.
    ///
    /// # Safety
    /// As of [`Self::configure`], and the places for answers may be written.
    pub(super) unsafe fn query<Head: Described>(
        &self,
        mut context: RawContext,
        chain: &mut Chain<Head>,
    ) -> Result<(), Failure> {
        let (context, head) = (or_null(&mut context), chain.as_ptr());
        // SAFETY: as the caller promises.
        let code = asked(|| unsafe { (self.query)(context, head) });
        done("ffxQuery", code, chain)
    }

    /// `ffxDispatch`.
    ///
    /// # Safety
    /// A live context of this library's; command list and resources are what the fields say, and live until the list has run.
    pub(super) unsafe fn dispatch<Head: Described>(
        &self,
        mut context: RawContext,
        chain: &mut Chain<Head>,
    ) -> Result<(), Failure> {
        let head = chain.as_ptr();
        // SAFETY: as the caller promises.
        let code = asked(|| unsafe { (self.dispatch)(&mut context, head) });
        done("ffxDispatch", code, chain)
    }
}

#[cfg(windows)]
impl Api {
    /// Hands a struct that the library made on to `ffxDispatch`.
    ///
    /// # Safety
    /// A live context of this library's; the struct is one that the library has just handed over to be dispatched.
    pub(super) unsafe fn forward(&self, mut context: RawContext, head: *const Header) -> ReturnCode {
        // SAFETY: as the caller promises.
        asked(|| unsafe { (self.dispatch)(&mut context, head) })
    }
}

/// A context as a call takes it that may be given none: its address, or null.
fn or_null(context: &mut RawContext) -> *mut RawContext {
    if context.is_null() { null_mut() } else { context }
}

/// Calls, with what was said before on this thread put aside.
fn asked(call: impl FnOnce() -> ReturnCode) -> ReturnCode {
    message::forget();
    call()
}

fn done<Head: Described>(call: &'static str, code: ReturnCode, chain: &Chain<Head>) -> Result<(), Failure> {
    answered(call, code, || (format!("{chain:?}"), Diagnosis::of(chain, code)))
}

fn answered(call: &'static str, code: ReturnCode, told: impl FnOnce() -> (String, Diagnosis)) -> Result<(), Failure> {
    if code == ReturnCode::OK {
        return Ok(());
    }
    let (passed, diagnose) = told();
    Err(Failure { call, code, passed, says: message::last(), diagnose })
}

/// A call that did not succeed.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub(super) call: &'static str,
    pub(super) code: ReturnCode,
    /// Every field of every struct.
    pub(super) passed: String,
    /// What the library said meanwhile; may be nothing.
    pub(super) says: String,
    /// What most likely made it fail.
    diagnose: Diagnosis,
}

impl Failure {
    /// Whether the library does not know a struct that it was given.
    pub(super) fn is_unknown_struct(&self) -> bool {
        matches!(self.code, ReturnCode::UNKNOWN_STRUCT | ReturnCode::STRUCT_TOO_NEW)
    }

    /// The failure as an error, of the field that most likely was its cause.
    pub(super) fn error(&self) -> Error {
        let (kind, meaning, remedy) = meaning(self.code);
        let Diagnosis { field, why } = &self.diagnose;
        let mut cause = format!("{} answered {} ({:?}): {meaning}; {field}: {why}", self.call, self.code.0, self.code);
        if !self.says.is_empty() {
            cause = format!("{cause}; the library says: {}", self.says);
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

/// Whose fault a code is, what it means, and what to do.
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

/// What a context is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Effect {
    /// Frames between two.
    FrameGeneration,
    /// Larger frames.
    Upscaling,
}

impl Effect {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::FrameGeneration, Self::Upscaling];

    /// The struct that makes its contexts.
    pub fn create(self) -> StructId {
        match self {
            Self::FrameGeneration => StructId::FRAME_GENERATION,
            Self::Upscaling => StructId::UPSCALE,
        }
    }

    /// The effect that a struct belongs to; None for what belongs to another.
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
