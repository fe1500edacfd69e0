//! Folders that libraries are loaded from, and folders that they are not loaded from.

use std::path::Path;

use super::*;
use cairn::gpu::windows::Win32::System::LibraryLoader::GetModuleHandleW;

/// Whether a file is loaded in this process.
fn is_loaded(file: &Path) -> bool {
    let path: Vec<u16> = file.as_os_str().encode_wide().chain([0]).collect();
    // SAFETY: a path that ends with a zero.
    unsafe { GetModuleHandleW(PCWSTR(path.as_ptr())) }.is_ok()
}

#[test]
fn nothing_is_loaded_from_the_working_folder_and_libraries_stay_loaded() {
    let test = "load_paths::nothing_is_loaded_from_the_working_folder_and_libraries_stay_loaded";
    in_new_process(test, || {
        // A foreign file under the name that the loader passes to the system.
        let foreign = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.0", ANALYTIC_20]);
        std::env::set_current_dir(&foreign.0).expect("a folder");
        let double = DoubleFolder::empty()
            .with(LibraryKind::Loader, &["loader"])
            .with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]);
        let library = double.load().expect("loaded");
        assert_eq!(library.serves(Effect::FrameGeneration), Some(LibraryKind::Loader));
        let context = made(&library, Choice::Any).expect("a context");
        assert_eq!(context.provider().version.name, "4.0.1");
        assert_eq!(foreign.calls(), [""; 0]);
        drop((context, library));
        // They stay loaded: threads and a driver may still use them.
        for part in [LibraryKind::Loader, LibraryKind::FrameGeneration] {
            assert!(is_loaded(&double.0.join(part.file_name())), "{part:?} stays");
            assert!(!is_loaded(&foreign.0.join(part.file_name())));
        }
        assert_eq!(double.violations(), [""; 0]);
    });
}

/// Dependencies of AMD's libraries, such as the Visual C++ runtime, are searched beside them and in the system.
#[test]
fn a_missing_dependency_is_reported_and_not_loaded_from_the_working_folder() {
    let test = "load_paths::a_missing_dependency_is_reported_and_not_loaded_from_the_working_folder";
    in_new_process(test, || {
        let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]);
        let path = double.0.join(LibraryKind::FrameGeneration.file_name());
        let mut bytes = std::fs::read(&path).expect("the double");
        let (needed, other) = (b"d3d12.dll\0", b"d3dxx.dll\0");
        let places: Vec<_> = (0..bytes.len() - needed.len())
            .filter(|at| bytes[*at..*at + needed.len()].eq_ignore_ascii_case(needed))
            .collect();
        assert!(!places.is_empty(), "the double needs Direct3D 12");
        for at in places {
            bytes[at..at + other.len()].copy_from_slice(other);
        }
        std::fs::write(&path, bytes).expect("the double that needs another");
        let working = DoubleFolder::empty();
        std::fs::copy(system("d3d12.dll"), working.0.join("d3dxx.dll")).expect("what it needs");
        std::env::set_current_dir(&working.0).expect("a folder");
        let refused = double.load().expect_err("it is not there");
        assert_eq!(refused.kind(), ErrorKind::RuntimeMissing);
        assert!(refused.cause().contains("something that it needs is missing"), "{refused}");
        assert!(refused.remedy_text().is_some_and(|text| text.contains("Visual C++")), "{refused}");
        assert!(refused.offending_field().is_some_and(|file| file.ends_with(LibraryKind::FrameGeneration.file_name())));
        assert!(!is_loaded(&working.0.join("d3dxx.dll")));
    });
}

/// A library signed by somebody else, such as Microsoft, is rejected.
#[test]
fn a_file_of_another_signer_is_refused() {
    let signed = std::env::var_os("CAIRN_ONNXRUNTIME").expect("CAIRN_ONNXRUNTIME names a library of Microsoft's");
    let double = DoubleFolder::empty().with_file(LibraryKind::FrameGeneration, Path::new(&signed));
    let options = LoadOptions { directory: Some(double.0.clone()), signed: true };
    let refused = Library::load(&options).expect_err("another's");
    assert_eq!(refused.kind(), ErrorKind::RuntimeMissing);
    println!("{refused}");
    assert!(refused.cause().contains("signed by Microsoft Corporation"), "{refused}");
    assert!(!is_loaded(&double.0.join(LibraryKind::FrameGeneration.file_name())), "it was not even loaded");
}
