//! Calls of ffx-api that fail on purpose, in a double of AMD's loader in front of the libraries of the effects: doubles of them, or AMD's own.

use std::ffi::c_void;
use std::path::Path;
use std::sync::OnceLock;

use cairn::ffx::LibraryKind;
use cairn::gpu::windows::Win32::Foundation::HMODULE;
use cairn::gpu::windows::core::{PCSTR, s};

use super::double_folder::{DoubleFolder, ML};
use crate::trials::amd_folder;

#[link(name = "kernel32")]
unsafe extern "system" {
    fn GetModuleHandleA(name: PCSTR) -> HMODULE;
    fn GetProcAddress(module: HMODULE, name: PCSTR) -> *const c_void;
}

/// AMD's upscaler, as a line of the double's configuration.
const UPSCALER: &str = "offers 0xf600000001000003 4.0.3";

/// How a call fails; the numbers are the double's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Manner {
    /// For lack of memory.
    Once = 0,
    /// With all later ones.
    ForEver = 1,
    /// By a C++ exception.
    Throwing = 2,
}

/// A folder with a double of AMD's loader. One for the whole process: the loader finds the libraries of effects by their names.
pub struct FailingCalls {
    /// The folder.
    pub folder: DoubleFolder,
    /// Whether the libraries of the effects are AMD's own.
    pub is_amds: bool,
    /// Whether there is an upscaler.
    pub has_upscaler: bool,
}

impl FailingCalls {
    /// The folder, with AMD's own libraries behind the loader where `CAIRN_FFX_DIR` names them.
    pub fn of_process() -> &'static Self {
        static FOLDER: OnceLock<FailingCalls> = OnceLock::new();
        FOLDER.get_or_init(|| {
            let effects = [LibraryKind::FrameGeneration, LibraryKind::Upscaler];
            let folder = DoubleFolder::empty()
                .with(LibraryKind::Loader, &["sdk 2.1", "loader", "effect 0x10000", "effect 0x20000", "quiet"]);
            let Some(own) = amd_folder().map(Path::new) else {
                let [frames, upscaler] = effects;
                let folder = folder.with(frames, &["sdk 2.1", ML, "quiet"]);
                let folder = folder.with(upscaler, &["sdk 2.1", "effect 0x10000", UPSCALER, "quiet"]);
                return Self { folder, is_amds: false, has_upscaler: true };
            };
            let [has_frames, has_upscaler] = effects.map(|kind| own.join(kind.file_name()).is_file());
            assert!(has_frames, "{} has no {}", own.display(), LibraryKind::FrameGeneration.file_name());
            let folder = effects
                .into_iter()
                .filter(|kind| own.join(kind.file_name()).is_file())
                .fold(folder, |folder, kind| folder.with_file(kind, &own.join(kind.file_name())));
            Self { folder, is_amds: true, has_upscaler }
        })
    }

    /// While [`while_failing`](Self::while_failing) runs something, call number `call`, from 1 on, fails in that manner; 0 for none. Calls are
    /// counted anew.
    pub fn set(&self, call: u64, manner: Manner) {
        // SAFETY: the double's function.
        let set = unsafe { function::<unsafe extern "C" fn(u64, u32)>(s!("DoubleFailCall")) };
        // SAFETY: numbers only.
        set.into_iter().for_each(|set| unsafe { set(call, manner as u32) });
    }

    /// Runs something with failing calls; returns its result, and the number of counted calls so far.
    pub fn while_failing<T>(&self, work: impl FnOnce() -> T) -> (T, u64) {
        // SAFETY: the double's function.
        let arm = || unsafe { function::<unsafe extern "C" fn(u32) -> u64>(s!("DoubleArmFailure")) };
        // SAFETY: numbers only.
        arm().into_iter().for_each(|arm| _ = unsafe { arm(1) });
        let result = work();
        // SAFETY: as above.
        (result, arm().map_or(0, |arm| unsafe { arm(0) }))
    }

    /// Destroys the contexts that are alive; returns their number, and how many calls to destroy one have failed.
    pub fn destroy_contexts(&self) -> (u64, u64) {
        // SAFETY: the double's functions.
        let functions = unsafe {
            function::<unsafe extern "C" fn() -> u64>(s!("DoubleDestroyAll")).zip(function::<
                unsafe extern "C" fn() -> u64,
            >(s!(
                "DoubleFailedDestroys"
            )))
        };
        // SAFETY: no arguments.
        functions.map_or((0, 0), |(all, failed)| unsafe { (all(), failed()) })
    }
}

/// A function of the loader; `None` until the library has loaded it.
///
/// # Safety
/// `F` is the type of the function with that name.
unsafe fn function<F: Copy>(name: PCSTR) -> Option<F> {
    assert_eq!(size_of::<F>(), size_of::<usize>(), "a function");
    // SAFETY: a name that ends.
    let module = unsafe { GetModuleHandleA(s!("amd_fidelityfx_loader_dx12.dll")) };
    if module.is_invalid() {
        return None;
    }
    // SAFETY: a name that ends; a module that is never unloaded.
    let found = unsafe { GetProcAddress(module, name) };
    assert!(!found.is_null(), "the loader is the double");
    // SAFETY: the caller's promise; both are addresses of functions.
    Some(unsafe { std::mem::transmute_copy(&found) })
}
