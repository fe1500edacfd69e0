//! A library other than ONNX Runtime 1.24 is refused before its interface is used, with cause, field and remedy.

use std::path::{Path, PathBuf};
use std::process::Command;

use cairn::runtime::Ort;
use cairn::{ErrorKind, LibrarySearch};
use test_support::worlds;

/// A folder for this test, removed when the test ends.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("cairn-ort-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder");
        Self(path)
    }

    /// A library compiled from the C code `source`.
    fn library(&self, name: &str, source: &str) -> PathBuf {
        let (c, so) = (self.0.join(format!("{name}.c")), self.0.join(format!("lib{name}.so")));
        std::fs::write(&c, source).expect("a source file");
        let done = Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(&so).arg(&c).status().expect("a C compiler");
        assert!(done.success());
        so
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Failing to remove the folder is not a test failure.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// C code of a library that reports `version` as ONNX Runtime does, and has no other functions.
fn fake_source(version: &str) -> String {
    format!(
        "static const void* get_api(unsigned v) {{ (void)v; return 0; }}
         static const char* version(void) {{ return {version}; }}
         static const struct {{ const void* (*a)(unsigned); const char* (*b)(void); }} base = {{ get_api, version }};
         const void* OrtGetApiBase(void) {{ return &base; }}"
    )
}

/// Checks that a library is refused, and that the error contains `cause`.
fn assert_refused(path: &Path, cause: &str) {
    let error = Ort::load(path).expect_err("not an ONNX Runtime to use");
    let text = error.to_string();
    assert_eq!(error.kind(), ErrorKind::RuntimeMissing, "{text}");
    assert!(text.contains(cause), "{text:?} does not say {cause:?}");
    assert!(error.offending_field().is_some_and(|field| field.contains(path.file_name().unwrap().to_str().unwrap())));
    assert!(text.contains("cargo xtask setup"), "{text:?} has no remedy");
}

#[test]
fn other_libraries_are_refused_and_onnx_runtime_1_24_then_loads() {
    let folder = Folder::new("gate");
    assert_refused(&folder.0.join("nowhere.so"), "cannot be opened");
    assert_refused(&folder.0, "is not a file");
    let text = folder.0.join("text.so");
    std::fs::write(&text, "not a library").expect("a file");
    assert_refused(&text, "cannot be loaded as a library");
    assert_refused(&folder.library("nothing", "int nothing;"), "does not export OrtGetApiBase");
    assert_refused(&folder.library("null", "const void* OrtGetApiBase(void) { return 0; }"), "OrtGetApiBase is null");
    assert_refused(&folder.library("mute", &fake_source("0")), "does not say its version");
    assert_refused(&folder.library("old", &fake_source("\"1.17.3\"")), "1.17.3 is older than the 1.24.x");
    assert_refused(&folder.library("near", &fake_source("\"1.9.0\"")), "1.9.0 is older than the 1.24.x");
    assert_refused(&folder.library("new", &fake_source("\"1.25.0\"")), "1.25.0 is newer than the 1.24.x");
    assert_refused(&folder.library("next", &fake_source("\"2.0.0\"")), "2.0.0 is newer than the 1.24.x");
    assert_refused(&folder.library("odd", &fake_source("\"nightly\"")), "nightly is other than the 1.24.x");
    assert_refused(&folder.library("hollow", &fake_source("\"1.24.4\"")), "does not offer interface version 24");

    // Refused libraries do not prevent loading the real one; a process can have only one.
    let ort = worlds::ort();
    assert!(ort.version().starts_with("1.24."), "{ort:?}");
    assert_eq!(Ort::load(ort.path()).expect("the same file again").path(), ort.path());
    let copy = folder.0.join("copy.so");
    std::fs::copy(ort.path(), &copy).expect("a copy");
    let error = Ort::load(&copy).expect_err("a second one");
    assert_eq!(error.kind(), ErrorKind::Unsupported, "{error}");
    let named = LibrarySearch { onnxruntime: Some(text), ..LibrarySearch::for_tools() };
    assert_eq!(Ort::find(&named).expect_err("the named path has priority").kind(), ErrorKind::Unsupported);
}
