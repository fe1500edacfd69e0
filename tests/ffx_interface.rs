//! The report of AMD's requirements through the C interface. On Windows, or in the lab.
#![cfg(windows)]

use std::ffi::CStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use cairn::abi::device::{CAIRN_DEVICE_D3D12, CAIRN_DEVICE_ENVIRONMENT, cairn_device_options};
use cairn::abi::requirements::*;
use cairn::abi::results::{CAIRN_OK, cairn_result};
use cairn::ffx::LibraryKind;
use cairn::gpu::windows::Win32::System::LibraryLoader::{GetProcAddress, LoadLibraryW};
use cairn::gpu::windows::core::{PCWSTR, s};
use test_support::ffx::double_folder::{self, ANALYTIC, DoubleFolder};

/// The type of the C function that reports requirements.
type Report = unsafe extern "C" fn(
    u32,
    *const cairn_device_options,
    *mut cairn_requirement,
    usize,
    u32,
    *mut u32,
) -> cairn_result;

/// Device flags of a host that lets the environment name libraries, and of one that does not.
const TOOL: u32 = CAIRN_DEVICE_ENVIRONMENT;
const GAME: u32 = 0;

/// All rows of the report, for a tool.
fn rows() -> Vec<cairn_requirement> {
    rows_of(cairn_device_requirements, TOOL)
}

fn rows_of(report: Report, flags: u32) -> Vec<cairn_requirement> {
    // SAFETY: as below.
    let mut options: cairn_device_options = unsafe { std::mem::zeroed() };
    (options.struct_size, options.flags) = (size_of::<cairn_device_options>() as u32, flags);
    // SAFETY: structs of the interface are plain data, for which zero is a value.
    let mut rows: [cairn_requirement; 32] = unsafe { std::mem::zeroed() };
    let stride = size_of::<cairn_requirement>();
    rows.iter_mut().for_each(|row| row.struct_size = stride as u32);
    let mut count = 0;
    // SAFETY: options of their size, an array of that stride and length, and memory for the count.
    let result = unsafe { report(CAIRN_DEVICE_D3D12, &options, rows.as_mut_ptr(), stride, 32, &mut count) };
    assert_eq!(result, CAIRN_OK);
    rows[..count as usize].to_vec()
}

fn text(characters: &[std::ffi::c_char]) -> String {
    // SAFETY: the library ends its texts with a NUL.
    unsafe { CStr::from_ptr(characters.as_ptr()) }.to_string_lossy().into_owned()
}

#[test]
fn the_report_lists_amd_s_libraries_and_missing_requirements() {
    double_folder::in_new_process("the_report_lists_amd_s_libraries_and_missing_requirements", report);
}

fn report() {
    let double = DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", ANALYTIC]);
    // SAFETY: this process runs one test, and no other thread reads the environment now.
    unsafe { std::env::set_var("CAIRN_FFX_DIR", &double.0) };
    let rows = rows();
    let of = |what| rows.iter().filter(|row| row.what == what).collect::<Vec<_>>();
    assert_eq!((rows[0].what, rows[0].status), (CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_MET));
    for what in [CAIRN_REQUIREMENT_ONNXRUNTIME, CAIRN_REQUIREMENT_MEMORY] {
        assert_eq!(of(what).len(), 1);
    }
    let [library] = of(CAIRN_REQUIREMENT_FSR_LIBRARIES)[..] else { panic!("{} rows", rows.len()) };
    assert_eq!(library.status, CAIRN_REQUIREMENT_MET);
    assert!(text(&library.found).contains(LibraryKind::FrameGeneration.file_name()), "{}", text(&library.found));
    let [provider] = of(CAIRN_REQUIREMENT_FSR_PROVIDER)[..] else { panic!("{} rows", rows.len()) };
    assert_eq!(text(&provider.found), "3.1.6 (analytic)");
    for what in [CAIRN_REQUIREMENT_FSR_SYSTEM, CAIRN_REQUIREMENT_FSR_DIRECT3D, CAIRN_REQUIREMENT_FSR_SHADER_MODEL] {
        let [row] = of(what)[..] else { panic!("{} rows", rows.len()) };
        println!("{} (needed: {})", text(&row.found), text(&row.needed));
        assert!([CAIRN_REQUIREMENT_MET, CAIRN_REQUIREMENT_OPTIONAL].contains(&row.status));
        assert!(text(&row.needed).contains("ml") && !text(&row.found).is_empty());
    }
    // A missing library of AMD's does not prevent device creation.
    // SAFETY: as above.
    unsafe { std::env::set_var("CAIRN_FFX_DIR", std::env::temp_dir().join("cairn-ffx-there-is-none")) };
    let rows = self::rows();
    let status = |what| rows.iter().find(|row| row.what == what).map(|row| row.status);
    assert_eq!(status(CAIRN_REQUIREMENT_FSR_LIBRARIES), Some(CAIRN_REQUIREMENT_OPTIONAL));
    assert_eq!(status(CAIRN_REQUIREMENT_FSR_PROVIDER), Some(CAIRN_REQUIREMENT_OPTIONAL));
}

/// The report function of a copy of the library.
fn report_of(library: &Path) -> Report {
    use std::os::windows::ffi::OsStrExt;
    let path: Vec<u16> = library.as_os_str().encode_wide().chain([0]).collect();
    // SAFETY: a path that ends with a zero, of the library under test, which stays loaded.
    let found = unsafe {
        let module = LoadLibraryW(PCWSTR(path.as_ptr())).expect("the library loads");
        GetProcAddress(module, s!("cairn_device_requirements")).expect("it is exported")
    };
    // SAFETY: the function of that name.
    unsafe { std::mem::transmute::<unsafe extern "system" fn() -> isize, Report>(found) }
}

/// The row that says where AMD's library was found or searched.
fn found_by(report: Report, flags: u32) -> String {
    let rows = rows_of(report, flags);
    let row = rows.iter().find(|row| row.what == CAIRN_REQUIREMENT_FSR_LIBRARIES).expect("a row");
    text(&row.found)
}

/// Environment variable that passes the folders of the test below to its program.
const PLACES: &str = "CAIRN_FFX_TEST_PLACES";

#[test]
fn libraries_are_loaded_from_the_given_folder_then_the_library_s_then_the_program_s() {
    let test = "libraries_are_loaded_from_the_given_folder_then_the_library_s_then_the_program_s";
    if let Some(places) = std::env::var_os(PLACES) {
        return check_load_order(&std::env::split_paths(&places).collect::<Vec<_>>());
    }
    // Folders: a program with AMD's library, a library of ours with one, a library of ours alone, a folder to name with one, and a
    // folder without any.
    let with = |release| DoubleFolder::empty().with(LibraryKind::FrameGeneration, &["sdk 2.1", release]);
    let (program, beside, given) = (with(ANALYTIC), with(ANALYTIC), with(ANALYTIC));
    let empty = DoubleFolder::empty();
    let own = double_folder::double_library().with_file_name("cairn.dll");
    std::fs::copy(&own, beside.0.join("cairn.dll")).expect("cairn.dll: cargo build --package cairn --lib");
    let alone = own.parent().expect("a folder").to_owned();
    let copy = program.0.join("program.exe");
    std::fs::copy(std::env::current_exe().expect("our own path"), &copy).expect("a copy");
    let [program, beside, given, empty] = [program, beside, given, empty].map(|double| double.0);
    let places = [program, beside, alone, given, empty];
    let places = std::env::join_paths(places).expect("paths");
    let mut command = Command::new(copy);
    command.args(["--exact", test, "--nocapture"]).env(PLACES, places).env_remove("CAIRN_FFX_DIR");
    let ended = command.output().expect("a process");
    let (out, err) = (String::from_utf8_lossy(&ended.stdout), String::from_utf8_lossy(&ended.stderr));
    assert!(ended.status.success() && out.contains("1 passed"), "{}: {out}\n{err}", ended.status);
}

/// Runs in the program that has one of AMD's libraries beside it.
fn check_load_order(places: &[PathBuf]) {
    let [program, beside, alone, given, empty] = places else { panic!("{places:?}") };
    // The library finds the files and rejects them: AMD has not signed them.
    let is_in = |found: &str, place: &Path| {
        let file = place.join(LibraryKind::FrameGeneration.file_name());
        assert!(found.starts_with(&*file.display().to_string()), "{found}, and not {}", file.display());
        assert!(found.contains("only AMD's own files are to be loaded"), "{found}");
    };
    let [with_one, without] = [beside, alone].map(|place| report_of(&place.join("cairn.dll")));
    // No folder is named: beside the library, then beside the program.
    is_in(&found_by(with_one, GAME), beside);
    is_in(&found_by(without, GAME), program);
    // The folder named by the environment is used alone, and only if the host allows it.
    // SAFETY: this process runs one test, and no other thread reads the environment now.
    unsafe { std::env::set_var("CAIRN_FFX_DIR", given) };
    for report in [with_one, without] {
        is_in(&found_by(report, TOOL), given);
    }
    is_in(&found_by(with_one, GAME), beside);
    is_in(&found_by(without, GAME), program);
    // SAFETY: as above.
    unsafe { std::env::set_var("CAIRN_FFX_DIR", empty) };
    for report in [with_one, without] {
        let found = found_by(report, TOOL);
        assert!(found.contains("were not found") && found.contains(&*empty.display().to_string()), "{found}");
    }
    // An empty variable counts as unset.
    // SAFETY: as above.
    unsafe { std::env::set_var("CAIRN_FFX_DIR", "") };
    is_in(&found_by(with_one, TOOL), beside);
}
