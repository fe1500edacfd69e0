//! The check before ONNX Runtime is used: a library other than ONNX Runtime 1.24 is refused with cause, field and remedy, and
//! is never called.

use std::path::{Path, PathBuf};
use std::process::Command;

use cairn::runtime::Ort;
use cairn::{ErrorKind, LibrarySearch};

mod common;

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

/// The interface of an ONNX Runtime that reports `version` and has no functions.
fn fake(version: &str) -> String {
    format!(
        "static const void* get_api(unsigned v) {{ (void)v; return 0; }}
         static const char* version(void) {{ return {version}; }}
         static const struct {{ const void* (*a)(unsigned); const char* (*b)(void); }} base = {{ get_api, version }};
         const void* OrtGetApiBase(void) {{ return &base; }}"
    )
}

fn refused(path: &Path, cause: &str) {
    let error = Ort::load(path).expect_err("not an ONNX Runtime to use");
    let text = error.to_string();
    assert_eq!(error.kind(), ErrorKind::RuntimeMissing, "{text}");
    assert!(text.contains(cause), "{text:?} does not say {cause:?}");
    assert!(error.offending_field().is_some_and(|field| field.contains(path.file_name().unwrap().to_str().unwrap())));
    assert!(text.contains("cargo xtask setup"), "{text:?} has no remedy");
}

#[test]
fn what_is_not_onnx_runtime_1_24_is_refused_and_then_the_right_one_loads() {
    let folder = Folder::new("gate");
    refused(&folder.0.join("nowhere.so"), "cannot be opened");
    refused(&folder.0, "is not a file");
    let text = folder.0.join("text.so");
    std::fs::write(&text, "not a library").expect("a file");
    refused(&text, "cannot be loaded as a library");
    refused(&folder.library("nothing", "int nothing;"), "does not export OrtGetApiBase");
    refused(&folder.library("null", "const void* OrtGetApiBase(void) { return 0; }"), "OrtGetApiBase is null");
    refused(&folder.library("mute", &fake("0")), "does not say its version");
    refused(&folder.library("old", &fake("\"1.17.3\"")), "1.17.3 is older than the 1.24.x");
    refused(&folder.library("near", &fake("\"1.9.0\"")), "1.9.0 is older than the 1.24.x");
    refused(&folder.library("new", &fake("\"1.25.0\"")), "1.25.0 is newer than the 1.24.x");
    refused(&folder.library("next", &fake("\"2.0.0\"")), "2.0.0 is newer than the 1.24.x");
    refused(&folder.library("odd", &fake("\"nightly\"")), "nightly is other than the 1.24.x");
    refused(&folder.library("hollow", &fake("\"1.24.4\"")), "does not offer interface version 24");

    // Refused libraries do not prevent loading the real one; a process can have only one.
    let ort = common::ort();
    assert!(ort.version().starts_with("1.24."), "{ort:?}");
    assert_eq!(Ort::load(ort.path()).expect("the same file again").path(), ort.path());
    let copy = folder.0.join("copy.so");
    std::fs::copy(ort.path(), &copy).expect("a copy");
    let error = Ort::load(&copy).expect_err("a second one");
    assert_eq!(error.kind(), ErrorKind::Unsupported, "{error}");
    let named = LibrarySearch { onnxruntime: Some(text), ..LibrarySearch::for_tools() };
    assert_eq!(Ort::find(&named).expect_err("the path that is named wins").kind(), ErrorKind::Unsupported);
}
