//! Tests that check at run time whether the machine has what they need. Otherwise they are reported as skipped, by name.

use std::ffi::OsString;
use std::sync::OnceLock;

use libtest_mimic::{Arguments, Completion, Trial};

/// The environment variable with the folder of AMD's own libraries.
const VARIABLE: &str = "CAIRN_FFX_DIR";

/// The folder of AMD's own libraries. The variable is read once, since tests change it.
pub fn amd_folder() -> Option<&'static OsString> {
    static FOLDER: OnceLock<Option<OsString>> = OnceLock::new();
    FOLDER.get_or_init(|| std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty())).as_ref()
}

/// A test that runs on every machine.
pub fn always(name: &str, test: fn()) -> Trial {
    Trial::test(name, move || {
        test();
        Ok(())
    })
}

/// A test that needs AMD's own libraries, and is skipped without them.
pub fn with_amd(name: &str, test: fn()) -> Trial {
    let has_libraries = amd_folder().is_some();
    Trial::ignorable_test(name, move || {
        if !has_libraries {
            return Ok(Completion::ignored_with(format!("needs amd-dlls: {VARIABLE} names no folder")));
        }
        test();
        Ok(Completion::Completed)
    })
}

/// Trials of one kind, `always` or `with_amd`, named after their functions. A test that is in no list is dead code, of which the compiler
/// warns.
#[macro_export]
macro_rules! trials {
    ($kind:ident: $($test:ident),* $(,)?) => {
        vec![$($crate::trials::$kind(stringify!($test), $test)),*]
    };
}

/// Runs the tests that the command line selects, and ends the program.
pub fn run(trials: Vec<Trial>) {
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
