//! Where libraries are loaded from, and where not.

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
fn what_lies_in_the_working_folder_is_not_taken_and_what_was_loaded_stays() {
    let test = "places::what_lies_in_the_working_folder_is_not_taken_and_what_was_loaded_stays";
    alone(test, || {
        // A foreign file under the name that the loader passes to the system.
        let foreign = Stage::empty().with(Part::FrameGeneration, &["sdk 2.0", ANALYTIC_20]);
        std::env::set_current_dir(&foreign.0).expect("a folder");
        let stage = Stage::empty().with(Part::Loader, &["loader"]).with(Part::FrameGeneration, &["sdk 2.1", ML]);
        let library = stage.load().expect("loaded");
        assert_eq!(library.serves(Effect::FrameGeneration), Some(Part::Loader));
        let context = made(&library, Choice::Any).expect("a context");
        assert_eq!(context.provider().version.name, "4.0.1");
        assert_eq!(foreign.calls(), [""; 0]);
        drop((context, library));
        // They stay loaded: threads and a driver may still use them.
        for part in [Part::Loader, Part::FrameGeneration] {
            assert!(is_loaded(&stage.0.join(part.file_name())), "{part:?} stays");
            assert!(!is_loaded(&foreign.0.join(part.file_name())));
        }
        assert_eq!(stage.judgement(), [""; 0]);
    });
}

/// Dependencies of AMD's libraries, such as the Visual C++ runtime, are searched beside them and in the system.
#[test]
fn what_a_library_needs_is_not_taken_from_the_working_folder_and_named_where_it_is_missing() {
    let test = "places::what_a_library_needs_is_not_taken_from_the_working_folder_and_named_where_it_is_missing";
    alone(test, || {
        let stage = Stage::empty().with(Part::FrameGeneration, &["sdk 2.1", ML]);
        let path = stage.0.join(Part::FrameGeneration.file_name());
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
        let working = Stage::empty();
        std::fs::copy(stage::system("d3d12.dll"), working.0.join("d3dxx.dll")).expect("what it needs");
        std::env::set_current_dir(&working.0).expect("a folder");
        let refused = stage.load().expect_err("it is not there");
        assert_eq!(refused.kind(), ErrorKind::RuntimeMissing);
        assert!(refused.cause().contains("something that it needs is missing"), "{refused}");
        assert!(refused.remedy_text().is_some_and(|text| text.contains("Visual C++")), "{refused}");
        assert!(refused.offending_field().is_some_and(|file| file.ends_with(Part::FrameGeneration.file_name())));
        assert!(!is_loaded(&working.0.join("d3dxx.dll")));
    });
}

/// A library signed by somebody else, such as Microsoft, is rejected.
#[test]
fn a_file_of_another_signer_is_none_of_amd_s() {
    let signed = std::env::var_os("CAIRN_ONNXRUNTIME").expect("CAIRN_ONNXRUNTIME names a library of Microsoft's");
    let stage = Stage::empty().with_file(Part::FrameGeneration, Path::new(&signed));
    let options = LoadOptions { directory: Some(stage.0.clone()), signed: true };
    let refused = Library::load(&options).expect_err("another's");
    assert_eq!(refused.kind(), ErrorKind::RuntimeMissing);
    println!("{refused}");
    assert!(refused.cause().contains("signed by Microsoft Corporation"), "{refused}");
    assert!(!is_loaded(&stage.0.join(Part::FrameGeneration.file_name())), "it was not even loaded");
}
