//! Finds and loads AMD's libraries, and chooses providers of each release, with the double in `tests/ffx-double`. On Windows, or in the
//! lab.
#![cfg(windows)]

use std::ffi::c_void;
use std::os::windows::ffi::OsStrExt;
use std::sync::Mutex;

use cairn::ffx::bindings::{CreateFrameGeneration, Dimensions, DispatchFrameGeneration, ResourceState, SurfaceFormat};
use cairn::ffx::{
    Chain, Choice, Context, Dialect, Effect, Family, FileVersion, Generator, Library, LibraryKind, LoadOptions,
    RequirementKind, requirements,
};
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::{D3D12_FENCE_FLAG_NONE, ID3D12Fence};
use cairn::gpu::windows::Win32::System::LibraryLoader::{GetProcAddress, LoadLibraryW};
use cairn::gpu::windows::core::{Interface, PCWSTR, s};
use cairn::{ErrorKind, Result};
use test_support::d3d12::engine;
use test_support::d3d12::resources::{recorded_list, run_list};
use test_support::ffx::double_folder::{ANALYTIC, ANALYTIC_20, DoubleFolder, ML, in_new_process, system};
use test_support::ffx::frame_textures::Textures;

mod load_paths;

fn head() -> CreateFrameGeneration {
    let size = Dimensions { width: 640, height: 360 };
    CreateFrameGeneration {
        display_size: size,
        max_render_size: size,
        back_buffer_format: SurfaceFormat::R8G8B8A8_UNORM,
        ..Default::default()
    }
}

/// A frame generation context of that library, on a device of our own.
fn made(library: &Library, choice: Choice) -> Result<Context<CreateFrameGeneration>> {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let api = library.api(Effect::FrameGeneration)?;
    // SAFETY: a live device, which the context keeps alive.
    unsafe { Context::create(api, gpu.device().as_raw(), choice, head(), |chain| chain) }
}

#[test]
fn a_folder_of_2_1_is_used_through_its_loader() {
    in_new_process("a_folder_of_2_1_is_used_through_its_loader", || {
        let double = DoubleFolder::empty()
            .with(LibraryKind::Loader, &["loader"])
            .with(LibraryKind::FrameGeneration, &["sdk 2.1", ML, ANALYTIC]);
        let library = double.load().expect("loaded");
        assert_eq!(library.serves(Effect::FrameGeneration), Some(LibraryKind::Loader));
        let missing = library.api(Effect::Upscaling).expect_err("it is not there");
        assert_eq!(missing.kind(), ErrorKind::RuntimeMissing);
        assert_eq!(missing.offending_field(), Some(LibraryKind::Upscaler.file_name()));
        for (choice, runs) in [
            (Choice::Any, "4.0.1"),
            (Choice::Require(Family::Ml), "4.0.1"),
            (Choice::Require(Family::Analytic), "3.1.6"),
        ] {
            let context = made(&library, choice).expect("a context");
            let provider = context.provider();
            assert_eq!(
                (provider.version.name.as_str(), provider.verified, provider.dialect),
                (runs, true, Dialect::Sdk21)
            );
        }
        assert_eq!(double.violations(), [""; 0]);
        let destroyed = double.calls().iter().filter(|call| call.starts_with("destroy")).count();
        assert_eq!(destroyed, 6, "by the loader and by the library behind it: {:?}", double.calls());
    });
}

#[test]
fn a_loader_that_would_find_another_library_of_the_same_name_is_not_used() {
    in_new_process("a_loader_that_would_find_another_library_of_the_same_name_is_not_used", || {
        let engine = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.0", ANALYTIC_20]);
        let first = engine.load().expect("an engine's own");
        assert_eq!(first.serves(Effect::FrameGeneration), Some(LibraryKind::FrameGeneration));
        let ours = DoubleFolder::empty()
            .with(LibraryKind::Loader, &["loader"])
            .with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]);
        let library = ours.load().expect("loaded");
        assert_eq!(library.serves(Effect::FrameGeneration), Some(LibraryKind::FrameGeneration));
        let loader = library.files().iter().find(|file| file.kind == LibraryKind::Loader).expect("it is reported");
        let fault = loader.fault.as_ref().expect("it is not used");
        assert!(fault.cause().contains(&*engine.0.file_name().expect("a name").to_string_lossy()), "{fault}");
        assert_eq!(made(&library, Choice::Any).expect("a context").provider().version.name, "4.0.1");
        assert_eq!(made(&first, Choice::Any).expect("a context").provider().version.name, "3.1.5");
        assert_eq!([engine.violations(), ours.violations()], [[""; 0]; 2]);
    });
}

#[test]
fn the_library_of_1_1_serves_effects_without_another_library() {
    let whole = ["sdk 1.1.4", "effect 0x10000", "effect 0x20000", ANALYTIC_20];
    let double =
        DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]).with(LibraryKind::Whole, &whole);
    let library = double.load().expect("loaded");
    assert_eq!(library.serves(Effect::FrameGeneration), Some(LibraryKind::FrameGeneration));
    assert_eq!(library.serves(Effect::Upscaling), Some(LibraryKind::Whole));
    assert_eq!(made(&library, Choice::Any).expect("a context").provider().version.name, "4.0.1");
    // If all effects have libraries of their own, the library of 1.1 is not loaded.
    let upscaler = ["sdk 2.1", "effect 0x10000", "offers 0xf600000001000003 4.0.3"];
    let double = double.with(LibraryKind::Upscaler, &upscaler);
    let library = double.load().expect("loaded");
    assert_eq!(
        Effect::ALL.map(|effect| library.serves(effect)),
        [LibraryKind::FrameGeneration, LibraryKind::Upscaler].map(Some)
    );
    assert!(library.files().iter().all(|file| file.kind != LibraryKind::Whole));
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn earlier_releases_get_the_structs_they_know() {
    for (part, release, verified) in [
        (LibraryKind::FrameGeneration, "sdk 2.0", true),
        (LibraryKind::Whole, "sdk 1.1.4", true),
        (LibraryKind::Whole, "sdk 1.1.0", false),
    ] {
        let double = DoubleFolder::empty().with(part, &[release, ANALYTIC_20]);
        let library = double.load().expect("loaded");
        assert_eq!(library.serves(Effect::FrameGeneration), Some(part), "{release}");
        let context = made(&library, Choice::Prefer(Family::Ml)).expect("a context");
        let provider = context.provider().clone();
        drop(context);
        assert_eq!((provider.version.name.as_str(), provider.verified), ("3.1.5", verified), "{release}");
        assert_eq!(provider.dialect, Dialect::Sdk11);
        let refused = made(&library, Choice::Require(Family::Ml)).expect_err("there is none");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("provider")));
        assert_eq!(double.violations(), [""; 0], "{release}");
    }
}

#[test]
fn the_double_detects_errors_of_creation() {
    // The library requires the struct with the host's release, but its version name suggests that it does not.
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ANALYTIC_20]);
    let refused = made(&double.load().expect("loaded"), Choice::Any).expect_err("refused");
    assert_eq!(refused.kind(), ErrorKind::InvalidArgument, "{refused}");
    assert_eq!(double.violations(), ["create: the release that the host was written for is missing"]);
    // And the other way round.
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.0", ANALYTIC]);
    drop(made(&double.load().expect("loaded"), Choice::Any).expect("ignored, as AMD's does"));
    assert_eq!(double.violations(), ["create: a release before 2.1 is told for which release the host was written"]);
    // An effect that the library does not have.
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.0", "effect 0x10000", ANALYTIC_20]);
    let refused = made(&double.load().expect("loaded"), Choice::Any).expect_err("refused");
    assert_eq!(refused.kind(), ErrorKind::Unsupported, "{refused}");
}

#[test]
fn a_driver_s_substitute_provider_is_detected() {
    let double = DoubleFolder::empty()
        .with(LibraryKind::FrameGeneration, &["sdk 2.1", ANALYTIC, "runs 0xf600000001000002 4.0.2"]);
    let library = double.load().expect("loaded");
    let context = made(&library, Choice::Prefer(Family::Analytic)).expect("a context");
    assert_eq!(context.provider().version.name, "4.0.2");
    drop(context);
    let refused = made(&library, Choice::Require(Family::Analytic)).expect_err("another runs");
    assert!(refused.cause().contains("4.0.2 (ml)"), "{refused}");
    assert_eq!(double.violations(), [""; 0]);
    let count = |call| double.calls().iter().filter(|line| line.starts_with(call)).count();
    assert_eq!((count("create"), count("destroy")), (2, 2));
}

#[test]
fn a_failed_call_reports_the_library_s_message() {
    let double = DoubleFolder::empty()
        .with(LibraryKind::FrameGeneration, &["sdk 2.1", ML, "answers create 3 no memory für this"]);
    let failed = made(&double.load().expect("loaded"), Choice::Any).expect_err("it fails");
    assert_eq!((failed.kind(), failed.offending_field()), (ErrorKind::Device, Some("device")));
    for part in ["ffxCreateContext answered 3 (RUNTIME_ERROR)", "no memory für this", "R8G8B8A8_UNORM", "width: 640"] {
        assert!(failed.cause().contains(part), "{part}: {failed}");
    }
    for (call, kind) in [("query 4", ErrorKind::Unsupported), ("query 1", ErrorKind::Device)] {
        let double =
            DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML, &format!("answers {call} why")]);
        let failed = made(&double.load().expect("loaded"), Choice::Any).expect_err("it fails");
        assert_eq!(failed.kind(), kind, "{failed}");
        assert!(failed.cause().contains("ffxQuery answered") && failed.cause().contains("GET_VERSIONS"), "{failed}");
    }
}

/// Messages that were logged in this process.
static LOG: Mutex<Vec<(log::Level, String)>> = Mutex::new(Vec::new());

/// Logger that records the messages of cairn::ffx.
struct LogRecorder;

impl log::Log for LogRecorder {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.target() == "cairn::ffx"
    }

    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata()) {
            LOG.lock().expect("no panic").push((record.level(), record.args().to_string()));
        }
    }

    fn flush(&self) {}
}

#[test]
fn library_messages_and_failed_destruction_are_logged() {
    in_new_process("library_messages_and_failed_destruction_are_logged", || {
        log::set_logger(&LogRecorder).expect("the only one");
        log::set_max_level(log::LevelFilter::Info);
        let logged = |level, text: &str| {
            LOG.lock().expect("no panic").iter().any(|(of, line)| *of == level && line.contains(text))
        };
        for (release, said) in [(["sdk 2.0", ANALYTIC_20], "für 2.0"), (["sdk 2.1", ML], "für 2.1")] {
            let answers = format!("answers destroy 3 the word {said}");
            let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &[release[0], release[1], &answers]);
            drop(made(&double.load().expect("loaded"), Choice::Any).expect("a context"));
            assert!(logged(log::Level::Error, &format!("the word {said}")), "the library's own words");
            assert!(logged(log::Level::Error, "a context is lost, with its memory: "), "the consequence");
            assert!(logged(log::Level::Error, "ffxDestroyContext answered 3 (RUNTIME_ERROR)"));
            LOG.lock().expect("no panic").clear();
        }
        // A missing family is logged as a warning, and the provider in use as information.
        let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.0", ANALYTIC_20]);
        drop(made(&double.load().expect("loaded"), Choice::Prefer(Family::Ml)).expect("a context"));
        assert!(logged(log::Level::Warn, "no provider of frame generation is Ml; there is 3.1.5 (analytic)"));
        assert!(logged(log::Level::Info, "frame generation: 3.1.5 (analytic)"));
    });
}

#[test]
fn ten_thousand_contexts_leak_nothing() {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML, ANALYTIC, "quiet"]);
    let library = double.load().expect("loaded");
    let (api, gpu) = (library.api(Effect::FrameGeneration).expect("there"), Gpu::on_adapter(None).expect("a device"));
    let device = gpu.device();
    let before = engine::reference_count(device);
    for cycle in 0..10_000 {
        let choice = if u32::is_multiple_of(cycle, 2) { Choice::Any } else { Choice::Require(Family::Analytic) };
        // SAFETY: a live device, which outlives the generator.
        let made = unsafe { Generator::create(api, device.as_raw(), choice, head(), None) }.expect("a generator");
        assert!(engine::reference_count(device) > before, "the double holds the device as long as the context lives");
        drop(made);
    }
    assert_eq!(engine::reference_count(device), before);
    assert_eq!(double.violations(), [""; 0]);
}

#[test]
fn files_that_cannot_be_used_are_reported_with_the_reason() {
    let text = DoubleFolder::empty();
    std::fs::write(text.0.join("text"), "this is no library").expect("a file");
    let no_library = text.0.join("text");
    let double = DoubleFolder::empty()
        .with_file(LibraryKind::FrameGeneration, &no_library)
        .with_file(LibraryKind::Upscaler, &system("version.dll"))
        .with(LibraryKind::Whole, &["sdk 1.1.4", ANALYTIC_20]);
    let library = double.load().expect("one can be used");
    assert_eq!(library.serves(Effect::FrameGeneration), Some(LibraryKind::Whole));
    let fault = |part| {
        let file = library.files().iter().find(|file| file.kind == part).expect("it was found");
        file.fault.as_ref().map(ToString::to_string).unwrap_or_default()
    };
    assert!(
        fault(LibraryKind::FrameGeneration).contains("no library for 64-bit Windows"),
        "{}",
        fault(LibraryKind::FrameGeneration)
    );
    assert!(
        fault(LibraryKind::Upscaler).contains("does not export ffxCreateContext, ffxDestroyContext"),
        "{}",
        fault(LibraryKind::Upscaler)
    );
    assert_eq!(fault(LibraryKind::Whole), "");
    // A library for another processor, by the machine type in its header.
    let of_another = DoubleFolder::empty().with(LibraryKind::Whole, &["sdk 1.1.4", ANALYTIC_20]);
    let path = of_another.0.join(LibraryKind::Whole.file_name());
    let mut bytes = std::fs::read(&path).expect("the double");
    let header = u32::from_le_bytes(bytes[0x3c..0x40].try_into().expect("4 bytes")) as usize;
    for (number, name) in [(0x014c_u16, "32-bit x86"), (0xaa64, "64-bit ARM"), (0x1234, "type 0x1234")] {
        bytes[header + 4..][..2].copy_from_slice(&number.to_le_bytes());
        std::fs::write(&path, &bytes).expect("a file");
        let refused = of_another.load().expect_err(name);
        assert_eq!(refused.kind(), ErrorKind::RuntimeMissing);
        assert!(refused.cause().contains(name) && refused.cause().contains("of 64-bit x86"), "{refused}");
    }
    // The system's library has a version, the double has none.
    let version = |part| library.files().iter().find(|file| file.kind == part).and_then(|file| file.version);
    assert!(version(LibraryKind::Upscaler).is_some_and(|version| version > FileVersion([1, 0, 0, 0])));
    assert_eq!(version(LibraryKind::Whole), None);

    // If no file can be used, the error has the reason of the first.
    let broken = DoubleFolder::empty()
        .with_file(LibraryKind::FrameGeneration, &no_library)
        .load()
        .expect_err("nothing can be used");
    assert_eq!(broken.kind(), ErrorKind::RuntimeMissing);
    assert!(
        broken.offending_field().is_some_and(|file| file.ends_with(LibraryKind::FrameGeneration.file_name())),
        "{broken}"
    );
    let lonely =
        DoubleFolder::empty().with(LibraryKind::Loader, &["loader"]).load().expect_err("a loader alone is of no use");
    assert_eq!(
        (lonely.kind(), lonely.offending_field()),
        (ErrorKind::RuntimeMissing, Some(LibraryKind::Loader.file_name()))
    );
    let nothing = DoubleFolder::empty().load().expect_err("nothing is there");
    assert_eq!(nothing.kind(), ErrorKind::RuntimeMissing);
    // Without a folder, this program's folder is searched; it has no library, and the error names the folder.
    let own = std::env::current_exe().expect("our own path");
    let nowhere = Library::load(&LoadOptions::default()).expect_err("nothing is there");
    let place = own.parent().expect("a folder").display().to_string();
    assert!(nowhere.cause().contains(&place), "{nowhere}");
}

#[test]
fn unsigned_files_are_not_loaded_if_signatures_are_required() {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.0", ANALYTIC_20]);
    let options = LoadOptions { directory: Some(double.0.clone()), signed: true };
    let refused = Library::load(&options).expect_err("it has no signature");
    assert_eq!(refused.kind(), ErrorKind::RuntimeMissing);
    assert!(refused.cause().contains("it has no signature"), "{refused}");
    assert!(double.load().is_ok());
}

#[test]
fn frames_are_generated_with_each_release() {
    for (part, lines) in [
        (LibraryKind::Whole, ["sdk 1.1.0", ANALYTIC_20]),
        (LibraryKind::Whole, ["sdk 1.1.4", ANALYTIC_20]),
        (LibraryKind::FrameGeneration, ["sdk 2.0", ANALYTIC_20]),
        (LibraryKind::FrameGeneration, ["sdk 2.1", ANALYTIC]),
        (LibraryKind::FrameGeneration, ["sdk 2.1", ML]),
        (LibraryKind::FrameGeneration, ["sdk 2.1", "offers 0xf600000001000002 4.0.2"]),
    ] {
        let double = DoubleFolder::empty().with(part, &lines);
        let library = double.load().expect("loaded");
        let gpu = Gpu::on_adapter(None).expect("a device");
        let (api, device) = (library.api(Effect::FrameGeneration).expect("there"), gpu.device().as_raw());
        // SAFETY: a live device, which outlives the generator.
        let mut generator = unsafe { Generator::create(api, device, Choice::Any, head(), None) }.expect("a generator");
        let size = head().display_size;
        let textures = Textures::new(&gpu, size);
        textures.fill(&textures.depth, |_, _| 0.5_f32.to_le_bytes());
        textures.fill(&textures.motion, |_, _| [0; 4]);
        for (number, reset) in (1_u8..).zip([false, false, true, false]) {
            let pixel = |x: u32, y: u32| [40 * number, (x & 0xff) as u8, (y & 0xff) as u8, 255];
            textures.fill(&textures.color, pixel);
            run_list(&gpu, |list| {
                // SAFETY: an open list of the generator's device, and textures that live until it has run.
                unsafe { generator.record(&textures.frame(list, reset)) }.expect("recorded");
            });
            // The picture is right only if list, textures and states were described correctly.
            for (index, found) in (0..).zip(textures.generated()) {
                // AMD's library writes red into alpha.
                let [red, rest @ .., _] = pixel(index % size.width, index / size.width);
                let starts = number == 1 || reset;
                let as_expected = if starts { found[0] == red } else { (red - 39..red).contains(&found[0]) };
                let near = found[1..3].iter().zip(rest).all(|(a, b)| a.abs_diff(b) <= 1);
                assert!(as_expected && near, "pixel {index} of frame {number}: {found:?}");
            }
        }
        assert!(gpu.removed().is_none());
        drop(generator);
        assert_eq!(double.violations(), [""; 0]);
        let frames = double.calls().iter().filter(|call| *call == "dispatch 20003 0").count();
        assert_eq!(frames, 4, "{:?}", double.calls());
    }
}

#[test]
fn the_double_detects_too_many_frames_in_flight() {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]);
    let (library, gpu) = (double.load().expect("loaded"), Gpu::on_adapter(None).expect("a device"));
    let (api, device) = (library.api(Effect::FrameGeneration).expect("there"), gpu.device().as_raw());
    // SAFETY: a live device, which outlives the generator.
    let mut generator = unsafe { Generator::create(api, device, Choice::Any, head(), None) }.expect("a generator");
    let textures = Textures::new(&gpu, head().display_size);
    run_list(&gpu, |list| {
        // SAFETY: an open list of the generator's device, and textures that live until it has run.
        let mut record = || unsafe { generator.record(&textures.frame(list, false)) };
        (0..4).for_each(|_| record().expect("recorded"));
        assert_eq!(record().expect_err("refused").kind(), ErrorKind::InvalidArgument);
        assert_eq!(double.violations(), ["dispatch: 4 frames are under way"]);
    });
}

#[test]
fn the_double_detects_a_context_that_ends_before_its_frame() {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]);
    let (library, gpu) = (double.load().expect("loaded"), Gpu::on_adapter(None).expect("a device"));
    let (api, device) = (library.api(Effect::FrameGeneration).expect("there"), gpu.device().as_raw());
    let textures = Textures::new(&gpu, head().display_size);
    let record = || {
        // SAFETY: a live device, which outlives the generator.
        let mut generator = unsafe { Generator::create(api, device, Choice::Any, head(), None) }.expect("a generator");
        let list = recorded_list(&gpu, |list| {
            // SAFETY: an open list of the generator's device, and textures that live until it has run.
            unsafe { generator.record(&textures.frame(list, false)) }.expect("recorded");
        });
        (generator, list)
    };
    // A list that is never submitted keeps nothing under way.
    drop(record());
    assert_eq!(double.violations(), [""; 0]);
    let (generator, (_allocator, list)) = record();
    // SAFETY: a live device.
    let gate: ID3D12Fence = unsafe { gpu.device().CreateFence(0, D3D12_FENCE_FLAG_NONE) }.expect("a fence");
    // SAFETY: a live queue and fence.
    unsafe { gpu.frames().d3d12().Wait(&gate, 1) }.expect("a wait");
    let frame = gpu.frames().submit(&[list]).expect("a submission");
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(std::time::Duration::from_millis(50));
            // SAFETY: a live fence.
            unsafe { gate.Signal(1) }.expect("a signal");
        });
        drop(generator);
    });
    frame.wait().expect("it is done");
    assert_eq!(double.violations(), ["destroy: 1 frames are under way"]);
}

/// Imitates a host that does not keep the creation chain: it is overwritten while the context exists.
#[test]
fn the_double_detects_a_creation_chain_that_was_freed() {
    type Create = unsafe extern "C" fn(*mut *mut c_void, *mut u64, *const c_void) -> u32;
    type Destroy = unsafe extern "C" fn(*mut *mut c_void, *const c_void) -> u32;
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.0", ANALYTIC_20]);
    let path: Vec<u16> =
        double.0.join(LibraryKind::FrameGeneration.file_name()).as_os_str().encode_wide().chain([0]).collect();
    // SAFETY: a path that ends with a zero, of the double, which exports functions of these names and types.
    let (create, destroy) = unsafe {
        let module = LoadLibraryW(PCWSTR(path.as_ptr())).expect("the copy loads");
        let find = |name| GetProcAddress(module, name).expect("it is exported");
        type Found = unsafe extern "system" fn() -> isize;
        (
            std::mem::transmute::<Found, Create>(find(s!("ffxCreateContext"))),
            std::mem::transmute::<Found, Destroy>(find(s!("ffxDestroyContext"))),
        )
    };
    let gpu = Gpu::on_adapter(None).expect("a device");
    for stays in [true, false] {
        let mut backend = [2, 0, gpu.device().as_raw() as u64];
        // Flags and width, height and width, height and format.
        let halves = |low: u64, high: u64| low | high << 32;
        let next = backend.as_mut_ptr() as u64;
        let mut head = [0x2_0001, next, halves(0, 640), halves(360, 640), halves(360, 10)];
        let mut context = std::ptr::null_mut();
        // SAFETY: a linked chain of both structs, and memory for the context.
        assert_eq!(unsafe { create(&mut context, head.as_mut_ptr(), std::ptr::null()) }, 0);
        if !stays {
            backend[0] = 0;
        }
        // SAFETY: the context that was made.
        assert_eq!(unsafe { destroy(&mut context, std::ptr::null()) }, 0);
        std::hint::black_box((head, backend));
    }
    assert_eq!(double.violations(), ["destroy: the chain that the context was made with is gone"]);
}

#[test]
fn the_double_detects_errors_of_a_frame() {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ML]);
    let mut context = made(&double.load().expect("loaded"), Choice::Any).expect("a context");
    let mut picture = Chain::new(DispatchFrameGeneration { frame_id: 7, ..Default::default() });
    // SAFETY: the double refuses pointers that are null.
    let refused = unsafe { context.dispatch(&mut picture) }.expect_err("refused");
    assert_eq!(refused.kind(), ErrorKind::InvalidArgument);
    let found = double.violations();
    for fault in ["no command list", "frame 7 after None and None", "0 frames, reset 0", "color: there is no resource"]
    {
        assert!(found.iter().any(|line| line.contains(fault)), "{fault}: {found:?}");
    }
}

#[test]
fn requirements_are_reported_with_what_was_found() {
    let gpu = Gpu::on_adapter(None).expect("a device");
    let text = DoubleFolder::empty();
    std::fs::write(text.0.join("text"), "this is no library").expect("a file");
    let double = DoubleFolder::empty()
        .with(LibraryKind::FrameGeneration, &["sdk 2.1", ML, ANALYTIC])
        .with_file(LibraryKind::Upscaler, &text.0.join("text"));
    let report =
        |double: &DoubleFolder| requirements(&LoadOptions { directory: Some(double.0.clone()), signed: false }, &gpu);
    let rows = report(&double);
    let of = |what| rows.iter().filter(|row| row.what == what).collect::<Vec<_>>();
    let [made, broken] = of(RequirementKind::Libraries)[..] else { panic!("{rows:?}") };
    assert!(made.met && made.found.contains(LibraryKind::FrameGeneration.file_name()), "{made:?}");
    assert!(!broken.met && broken.found.contains("not used") && broken.found.contains("64-bit"), "{broken:?}");
    let [provider] = of(RequirementKind::Provider)[..] else { panic!("{rows:?}") };
    assert!(provider.met && provider.found == "4.0.1 (ml), 3.1.6 (analytic)", "{provider:?}");
    for what in [RequirementKind::System, RequirementKind::Direct3d, RequirementKind::ShaderModel] {
        let [row] = of(what)[..] else { panic!("{rows:?}") };
        println!("{row:?}");
        assert!(row.found.bytes().any(|byte| byte.is_ascii_digit()), "{row:?}");
    }
    assert!(of(RequirementKind::Direct3d)[0].found.to_lowercase().contains("d3d12"));

    let rows = report(&DoubleFolder::empty());
    let [libraries, provider] = &rows[..2] else { panic!("{rows:?}") };
    assert_eq!((libraries.what, libraries.met), (RequirementKind::Libraries, false));
    assert_eq!((provider.what, provider.met), (RequirementKind::Provider, false));
    assert!(libraries.found.contains("not found") && provider.found.contains("not found"), "{rows:?}");
}

/// Compares numbers of formats and states with Microsoft's constants.
#[test]
fn format_and_state_numbers_are_microsoft_s() {
    use cairn::gpu::windows::Win32::Graphics::Direct3D12 as d3d12;
    use cairn::gpu::windows::Win32::Graphics::Dxgi::Common as dxgi;
    for (format, known) in [
        (SurfaceFormat::R16G16B16A16_FLOAT, dxgi::DXGI_FORMAT_R16G16B16A16_FLOAT),
        (SurfaceFormat::R11G11B10_FLOAT, dxgi::DXGI_FORMAT_R11G11B10_FLOAT),
        (SurfaceFormat::R10G10B10A2_UNORM, dxgi::DXGI_FORMAT_R10G10B10A2_UNORM),
        (SurfaceFormat::R8G8B8A8_UNORM, dxgi::DXGI_FORMAT_R8G8B8A8_UNORM),
        (SurfaceFormat::R8G8B8A8_SRGB, dxgi::DXGI_FORMAT_R8G8B8A8_UNORM_SRGB),
        (SurfaceFormat::B8G8R8A8_SRGB, dxgi::DXGI_FORMAT_B8G8R8A8_UNORM_SRGB),
        (SurfaceFormat::R16G16_FLOAT, dxgi::DXGI_FORMAT_R16G16_FLOAT),
        (SurfaceFormat::R32_FLOAT, dxgi::DXGI_FORMAT_D32_FLOAT_S8X24_UINT),
        (SurfaceFormat::R32_FLOAT, dxgi::DXGI_FORMAT_D32_FLOAT),
        (SurfaceFormat::R32_UINT, dxgi::DXGI_FORMAT_D24_UNORM_S8_UINT),
        (SurfaceFormat::R16_UNORM, dxgi::DXGI_FORMAT_D16_UNORM),
        (SurfaceFormat::R9G9B9E5, dxgi::DXGI_FORMAT_R9G9B9E5_SHAREDEXP),
    ] {
        assert_eq!(SurfaceFormat::from_dxgi(known.0.cast_unsigned()), format, "{known:?}");
    }
    for (state, known) in [
        (ResourceState::UNORDERED_ACCESS, d3d12::D3D12_RESOURCE_STATE_UNORDERED_ACCESS),
        (ResourceState::COMPUTE_READ, d3d12::D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE),
        (ResourceState::GENERIC_READ, d3d12::D3D12_RESOURCE_STATE_GENERIC_READ),
        (ResourceState::COPY_SOURCE, d3d12::D3D12_RESOURCE_STATE_COPY_SOURCE),
        (ResourceState::COPY_DESTINATION, d3d12::D3D12_RESOURCE_STATE_COPY_DEST),
        (ResourceState::RENDER_TARGET, d3d12::D3D12_RESOURCE_STATE_RENDER_TARGET),
        (ResourceState::DEPTH_ATTACHMENT, d3d12::D3D12_RESOURCE_STATE_DEPTH_WRITE),
    ] {
        assert_eq!(state.to_d3d12(), Some(known.0.cast_unsigned()));
    }
}
