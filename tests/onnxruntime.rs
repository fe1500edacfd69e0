//! A library other than ONNX Runtime from 1.24 on is refused before its interface is used, with cause, field and remedy; one that computes
//! wrongly is refused, too. The newest version that is tested gives the same latent as the oldest.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

#[cfg(target_os = "linux")]
use cairn::bundle::Precision;
use cairn::runtime::Ort;
#[cfg(target_os = "linux")]
use cairn::runtime::{CpuOptions, Device};
#[cfg(target_os = "linux")]
use cairn::world::{World, WorldOptions};
use cairn::{ErrorKind, LibrarySearch};
use test_support::child_test::run_test;
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
        let mut compiler = Command::new("cc");
        let done =
            compiler.args(["-shared", "-fPIC", "-o"]).arg(&so).arg(&c).arg("-ldl").status().expect("a C compiler");
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
fn other_libraries_are_refused_and_onnx_runtime_then_loads() {
    let folder = Folder::new("gate");
    assert_refused(&folder.0.join("nowhere.so"), "cannot be opened");
    assert_refused(&folder.0, "is not a file");
    let text = folder.0.join("text.so");
    std::fs::write(&text, "not a library").expect("a file");
    // ERROR_BAD_EXE_FORMAT, from which the remedy follows.
    assert_refused(&text, if cfg!(windows) { "damaged (0x800700c1)" } else { "cannot be loaded as a library" });
    assert_refused(&folder.library("nothing", "int nothing;"), "does not export OrtGetApiBase");
    assert_refused(&folder.library("null", "const void* OrtGetApiBase(void) { return 0; }"), "OrtGetApiBase is null");
    assert_refused(&folder.library("mute", &fake_source("0")), "does not say its version");
    assert_refused(&folder.library("old", &fake_source("\"1.17.3\"")), "1.17.3 is older than 1.24");
    assert_refused(&folder.library("near", &fake_source("\"1.9.0\"")), "1.9.0 is older than 1.24");
    assert_refused(&folder.library("next", &fake_source("\"2.0.0\"")), "2.0.0 is unknown to this build");
    assert_refused(&folder.library("odd", &fake_source("\"nightly\"")), "nightly is unknown to this build");
    assert_refused(&folder.library("hollow", &fake_source("\"1.24.4\"")), "1.24.4 does not offer interface version 24");
    assert_refused(&folder.library("new", &fake_source("\"1.40.0\"")), "1.40.0 does not offer interface version 24");

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

/// Makes a test the child process of itself, and names the library that the child loads.
const LIBRARY: &str = "CAIRN_TEST_LIBRARY";

/// Runs this program's test `name` in a process of its own, because a process can load one ONNX Runtime only.
fn in_child(name: &str, variables: &[(&str, &Path)]) -> Output {
    run_test(name, |command| {
        command.envs(variables.iter().copied());
    })
}

/// C code of a library that passes all calls to the ONNX Runtime at `real`, except the first two runs: one writes no result, and one fails.
fn faulty_source(real: &Path) -> String {
    format!(
        "#include <dlfcn.h>
         #include <stdint.h>
         #include <string.h>
         enum {{ CREATE_STATUS = 0, RUN_WITH_BINDING = 133, ENTRIES = 415 }};
         typedef struct {{ const void* (*api)(uint32_t); const char* (*version)(void); }} Base;
         static void* table[ENTRIES];
         static void* (*create_status)(int, const char*);
         static void* (*real_run)(void*, const void*, const void*);
         static void* run(void* session, const void* options, const void* binding) {{
             static int runs;
             if (++runs == 1) return 0;
             return runs == 2 ? create_status(1, \"a fault made by this test\") : real_run(session, options, binding);
         }}
         static const Base* real(void) {{
             const Base* (*get)(void);
             void* symbol = dlsym(dlopen({real:?}, RTLD_NOW | RTLD_LOCAL), \"OrtGetApiBase\");
             memcpy(&get, &symbol, sizeof get);
             return get();
         }}
         static const void* get_api(uint32_t version) {{
             void* (*wrapped)(void*, const void*, const void*) = run;
             memcpy(table, real()->api(version), sizeof table);
             memcpy(&create_status, &table[CREATE_STATUS], sizeof create_status);
             memcpy(&real_run, &table[RUN_WITH_BINDING], sizeof real_run);
             memcpy(&table[RUN_WITH_BINDING], &wrapped, sizeof wrapped);
             return table;
         }}
         static const char* version(void) {{ return real()->version(); }}
         const void* OrtGetApiBase(void) {{ static const Base base = {{ get_api, version }}; return &base; }}"
    )
}

#[test]
fn a_library_that_computes_wrongly_is_refused_until_it_computes_rightly() {
    const NAME: &str = "a_library_that_computes_wrongly_is_refused_until_it_computes_rightly";
    let real = provision::onnxruntime(&provision::Silent).expect("ONNX Runtime");
    let Some(faulty) = std::env::var_os(LIBRARY).map(PathBuf::from) else {
        let folder = Folder::new("faulty");
        let library = folder.library("faulty", &faulty_source(&real));
        in_child(NAME, &[(LIBRARY, &library)]);
        return;
    };
    assert_refused(&faulty, "1.24.4 fails its self-test: its CPU provider gives a wrong sum");
    assert_eq!(Ort::load(&real).expect_err("the process has started another").kind(), ErrorKind::Unsupported);
    assert_refused(
        &faulty,
        "1.24.4 fails its self-test: ONNX Runtime could not run a graph: a fault made by this test",
    );
    let ort = Ort::load(&faulty).expect("its third run is right");
    assert_eq!(Ort::load(&faulty).expect("the same file again").path(), ort.path());
    assert_eq!(Ort::load(&real).expect_err("the process uses another").kind(), ErrorKind::Unsupported);
}

#[test]
#[cfg(target_os = "linux")]
fn the_newest_version_gives_the_same_latent() {
    const NAME: &str = "the_newest_version_gives_the_same_latent";
    /// Names the file that gets a child's latent.
    const LATENT: &str = "CAIRN_TEST_LATENT";
    if let Some(file) = std::env::var_os(LATENT) {
        let library = std::env::var_os(LIBRARY).expect("the library to load");
        let ort = Ort::load(Path::new(&library)).expect("a version to use");
        let device = Device::cpu(&ort, CpuOptions { threads: Some(2), deterministic: true }).expect("a CPU device");
        assert!(device.describe().contains(ort.version()));
        let options = WorldOptions { precision: Some(Precision::F32), ..WorldOptions::default() };
        let world = World::load(&device, &worlds::bundle("tiny"), options).expect("a world");
        let mut rollout = worlds::seeded(&world, &worlds::point(&world), 7);
        rollout.step(&worlds::controls(0)).expect("a step");
        let latent: Vec<u8> = rollout.latent().expect("a latent").iter().flat_map(|v| v.to_le_bytes()).collect();
        std::fs::write(file, latent).expect("a file");
        println!("made with {}.", ort.version());
        return;
    }
    let folder = Folder::new("newest");
    let libraries = [provision::onnxruntime(&provision::Silent), provision::newest_onnxruntime(&provision::Silent)];
    let [oldest, newest] = [provision::ONNXRUNTIME_VERSION, provision::NEWEST_ONNXRUNTIME_VERSION];
    let latents = [oldest, newest].into_iter().zip(libraries).map(|(version, library)| {
        let file = folder.0.join(version);
        let output = in_child(NAME, &[(LIBRARY, &library.expect("ONNX Runtime")), (LATENT, &file)]);
        assert!(String::from_utf8_lossy(&output.stdout).contains(&format!("made with {version}.")));
        let bytes = std::fs::read(file).expect("a latent");
        bytes.chunks_exact(4).map(|v| f32::from_le_bytes([v[0], v[1], v[2], v[3]])).collect::<Vec<_>>()
    });
    let [expected, found] = latents.collect::<Vec<_>>().try_into().expect("two latents");
    assert!(!expected.is_empty() && expected.len() == found.len() && expected.iter().all(|v| v.is_finite()));
    let error = worlds::relative_error(&found, &expected);
    println!("{newest} beside {oldest}: a relative error of {error:e}");
    assert!(error <= 1e-5, "{newest} beside {oldest}: a relative error of {error:e}");
}
