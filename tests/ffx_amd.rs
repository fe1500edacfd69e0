//! AMD's own libraries, in the folder that `CAIRN_FFX_DIR` names. On Windows, or in the lab.
#![cfg(windows)]

use std::path::PathBuf;

use cairn::ErrorKind;
use cairn::ffx::bindings::{CreateFlags, CreateFrameGeneration, Dimensions, SurfaceFormat};
use cairn::ffx::{Choice, Context, Effect, Family, FileVersion, Library, LoadOptions, Part, versions};
use cairn::gpu::Gpu;
use cairn::gpu::windows::core::Interface;

fn options(signed: bool) -> LoadOptions {
    let directory = std::env::var_os("CAIRN_FFX_DIR").map(PathBuf::from);
    LoadOptions { directory: Some(directory.expect("CAIRN_FFX_DIR names a folder")), signed }
}

fn head() -> CreateFrameGeneration {
    let size = Dimensions { width: 640, height: 360 };
    CreateFrameGeneration {
        flags: CreateFlags::DEBUG_CHECKING,
        display_size: size,
        max_render_size: size,
        back_buffer_format: SurfaceFormat::R8G8B8A8_UNORM,
        ..Default::default()
    }
}

#[test]
#[ignore = "needs amd-dlls"]
fn they_are_found_and_loaded_with_their_versions() {
    let library = Library::load(&options(false)).expect("loaded");
    for file in library.files() {
        println!("{:?} {} {:?}", file.part, file.path.display(), file.version);
        assert!(file.fault.is_none(), "{:?}", file.fault);
        assert!(file.version.is_some_and(|version| version >= FileVersion([1, 0, 0, 0])), "{file:?}");
    }
    let split = library.files().iter().any(|file| file.part == Part::Loader);
    let door = if split { Part::Loader } else { Part::Whole };
    assert!([Some(door), Some(Part::FrameGeneration)].contains(&library.serves(Effect::FrameGeneration)));
}

#[test]
#[ignore = "needs amd-dlls"]
fn their_signature_is_amd_s() {
    match Library::load(&options(true)) {
        Ok(library) => {
            for file in library.files() {
                println!("{:?} is signed by {:?}", file.part, file.signer);
                assert!(file.signer.as_ref().is_some_and(|signer| signer.starts_with("Advanced Micro Devices")));
            }
        }
        // A machine that does not know the root of AMD's certificate cannot tell; that it is not one without a signature, it can.
        Err(refused) => {
            println!("{refused}");
            assert!(refused.cause().contains("Advanced Micro Devices"), "{refused}");
            assert!(refused.cause().contains("root"), "{refused}");
        }
    }
}

#[test]
#[ignore = "needs amd-dlls"]
fn a_provider_is_chosen_made_and_says_what_it_is() {
    let library = Library::load(&options(false)).expect("loaded");
    let gpu = Gpu::on_adapter(None).expect("a device");
    let (api, device) = (library.api(Effect::FrameGeneration).expect("there"), gpu.device().as_raw());
    // SAFETY: a live device.
    let offered = unsafe { versions(api, Effect::FrameGeneration, device) }.expect("some");
    println!("offered: {offered:?}");
    for (choice, family) in [
        (Choice::Any, None),
        (Choice::Prefer(Family::Ml), None),
        (Choice::Require(Family::Analytic), Some(Family::Analytic)),
        (Choice::Require(Family::Ml), Some(Family::Ml)),
    ] {
        // SAFETY: a live device, which outlives the context.
        let made = unsafe { Context::create(api, device, choice, head(), |chain| chain) };
        if family.is_some_and(|family| offered.iter().all(|version| version.family() != Some(family))) {
            let refused = made.expect_err("there is none");
            println!("{choice:?}: {refused}");
            assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("provider")));
            continue;
        }
        let context = made.expect("a context");
        println!("{choice:?}: {:?}", context.provider());
        assert!(context.provider().verified);
        if let Some(family) = family {
            assert_eq!(context.provider().version.family(), Some(family));
        }
    }
    assert!(gpu.removed().is_none());
}
