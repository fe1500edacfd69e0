//! Tests that find out when they run whether the machine has what they need, and are reported as skipped, by name, where it has not.

use std::ffi::OsString;
use std::sync::OnceLock;

use libtest_mimic::{Arguments, Completion, Trial};

/// Names the folder of AMD's own libraries.
const VARIABLE: &str = "CAIRN_FFX_DIR";

/// The variable as the program was started with it: tests change it.
#[allow(dead_code, reason = "each test program uses its part")]
pub(crate) fn amd_folder() -> Option<&'static OsString> {
    static FOLDER: OnceLock<Option<OsString>> = OnceLock::new();
    FOLDER.get_or_init(|| std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty())).as_ref()
}

/// A test that runs on every machine.
#[allow(dead_code, reason = "each test program uses its part")]
pub(crate) fn always(name: &str, test: fn()) -> Trial {
    Trial::test(name, move || {
        test();
        Ok(())
    })
}

/// A test that runs where there are AMD's own libraries.
pub(crate) fn with_amd(name: &str, test: fn()) -> Trial {
    let has_libraries = amd_folder().is_some();
    Trial::ignorable_test(name, move || {
        if !has_libraries {
            return Ok(Completion::ignored_with(format!("needs amd-dlls: {VARIABLE} names no folder")));
        }
        test();
        Ok(Completion::Completed)
    })
}

/// Trials of a kind, `always` or `with_amd`, named as their functions. A test that no list has is dead code, which is a warning.
macro_rules! trials {
    ($kind:ident: $($test:ident),* $(,)?) => {
        vec![$($crate::trials::$kind(stringify!($test), $test)),*]
    };
}

/// Runs tests as the command line says, and ends the program.
pub(crate) fn run(trials: Vec<Trial>) {
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
