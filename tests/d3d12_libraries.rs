//! How the library finds ONNX Runtime and DirectML in a program that loads `cairn.dll`: beside the library in the engines' layouts, by a
//! path, and nowhere that the host did not allow. On Windows, or in the lab, whose drive C: has none of this machine's files.
#![cfg(windows)]

use std::ffi::{CString, c_char};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::ptr::{null, null_mut};
use std::sync::OnceLock;

use cairn::abi::d3d12::{ID3D12CommandQueue, ID3D12Device};
use cairn::abi::device::{CAIRN_DEVICE_ENVIRONMENT, cairn_device, cairn_device_options};
use cairn::abi::results::{CAIRN_ERROR_RUNTIME_MISSING, CAIRN_OK, cairn_result};
use cairn::gpu::windows::Win32::Foundation::HMODULE;
use cairn::gpu::windows::Win32::System::LibraryLoader::{
    GetModuleFileNameW, GetModuleHandleW, GetProcAddress, LoadLibraryW,
};
use cairn::gpu::windows::core::{Interface, PCSTR, PCWSTR};
use test_support::d3d12::engine::Engine;
use test_support::worlds;

/// Names of Microsoft's libraries.
const RUNTIME: [&str; 2] = ["onnxruntime.dll", "DirectML.dll"];
/// A library of the system that ONNX Runtime needs.
const NEEDED: &str = "MSVCP140.dll";

/// An empty folder for one test, on drive C:. It is not removed: libraries in it are loaded.
fn create_folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("cairn-libraries-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// Puts a file into a folder, which is created.
fn link_file(from: &Path, folder: &Path, name: &str) -> PathBuf {
    std::fs::create_dir_all(folder).expect("a folder");
    let to = folder.join(name);
    // On one drive a hard link takes no space.
    if std::fs::hard_link(from, &to).is_err() {
        std::fs::copy(from, &to).unwrap_or_else(|e| panic!("{}: {e}", from.display()));
    }
    to
}

/// Puts Microsoft's libraries into a folder.
fn link_runtime(folder: &Path) {
    static FIRST: OnceLock<PathBuf> = OnceLock::new();
    let first = FIRST.get_or_init(|| {
        let (ort, first) = (worlds::ort(), create_folder("runtime"));
        for name in RUNTIME {
            link_file(&ort.path().with_file_name(name), &first, name);
        }
        first
    });
    for name in RUNTIME {
        link_file(&first.join(name), folder, name);
    }
}

/// The library under test, which the build puts beside the test programs.
fn library() -> PathBuf {
    let program_path = std::env::current_exe().expect("the program's path");
    let found =
        program_path.ancestors().skip(1).take(2).map(|place| place.join("cairn.dll")).find(|path| path.is_file());
    found.expect("cairn.dll is not there: cargo build --package cairn --lib, for the same target")
}

/// The variable with the path of the library that the program loads.
const LIBRARY: &str = "CAIRN_TEST_LIBRARY";
/// The variable that makes the program allow environment variables to name libraries.
const ALLOWS: &str = "CAIRN_TEST_ALLOWS_ENVIRONMENT";
/// The variable with the path of ONNX Runtime for the program's options.
const NAMES: &str = "CAIRN_TEST_NAMES";

/// A command for the program that uses the library, without variables of Cairn's.
fn program(folder: &Path, library: &Path) -> Command {
    let program_path = std::env::current_exe().expect("the program's path");
    let mut command = Command::new(link_file(&program_path, folder, "game.exe"));
    command.args(["--exact", "the_program_that_loads_the_library", "--nocapture"]).current_dir("C:\\");
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().to_uppercase().starts_with("CAIRN_") {
            command.env_remove(name);
        }
    }
    command.env(LIBRARY, library);
    command
}

/// The lines that the program printed about its devices.
fn printed_lines(command: &mut Command) -> Vec<String> {
    let ended = command.output().expect("a process");
    let (out, err) = (String::from_utf8_lossy(&ended.stdout), String::from_utf8_lossy(&ended.stderr));
    assert!(ended.status.success() && out.contains("1 passed"), "{}: {out}\n{err}", ended.status);
    out.lines().filter_map(|line| line.strip_prefix("> ")).map(str::to_owned).collect()
}

/// Checks that the program creates a device of each kind with ONNX Runtime and DirectML from `folder`, and with their dependencies from the
/// system.
fn assert_finds(command: &mut Command, folder: &Path) {
    let lines = printed_lines(command);
    let system = PathBuf::from(std::env::var_os("SystemRoot").expect("Windows says where it is")).join("System32");
    let files = RUNTIME.map(|name| folder.join(name)).into_iter().chain([system.join(NEEDED)]);
    let files = files.zip(RUNTIME.into_iter().chain([NEEDED]));
    let files = files.map(|(file, name)| format!("{name} is {}", file.display()));
    let expected: Vec<String> = ["cpu 0", "d3d12 0"].map(str::to_owned).into_iter().chain(files).collect();
    let lower = |lines: &[String]| lines.iter().map(|line| line.to_lowercase()).collect::<Vec<_>>();
    assert_eq!(lower(&lines), lower(&expected));
}

/// Checks that the program creates no device, and that the messages contain `parts`.
fn assert_misses(command: &mut Command, parts: &[&str]) {
    let lines = printed_lines(command);
    let missing = format!("{CAIRN_ERROR_RUNTIME_MISSING}");
    for (line, kind) in lines.iter().zip(["cpu", "d3d12"]) {
        assert!(line.starts_with(&format!("{kind} {missing} ")), "{lines:?}");
        for part in parts {
            assert!(line.contains(part), "{line:?} does not say {part:?}");
        }
    }
    assert_eq!(lines[2..4], RUNTIME.map(|name| format!("{name} is not loaded")), "{lines:?}");
}

/// Not a test itself, but the other tests' program: creates devices with the given library, and prints the results.
#[test]
fn the_program_that_loads_the_library() {
    let Some(library) = std::env::var_os(LIBRARY) else { return };
    type Exported = unsafe extern "system" fn() -> isize;
    type CreateCpu = unsafe extern "C" fn(*const cairn_device_options, *mut *mut cairn_device) -> cairn_result;
    type CreateD3d12 = unsafe extern "C" fn(
        *mut ID3D12Device,
        *mut ID3D12CommandQueue,
        *mut ID3D12CommandQueue,
        *const cairn_device_options,
        *mut *mut cairn_device,
    ) -> cairn_result;
    type Destroy = unsafe extern "C" fn(*mut cairn_device) -> cairn_result;
    type LastError = unsafe extern "C" fn(*mut c_char, usize, *mut usize) -> cairn_result;
    let path: Vec<u16> = std::os::windows::ffi::OsStrExt::encode_wide(&*library).chain([0]).collect();
    // SAFETY: a path that ends with a zero, of the library under test, which stays loaded.
    let module = unsafe { LoadLibraryW(PCWSTR(path.as_ptr())) }.expect("the library loads");
    let function = |name: &std::ffi::CStr| {
        // SAFETY: a loaded module and a name that ends with a zero.
        unsafe { GetProcAddress(module, PCSTR(name.as_ptr().cast())) }.expect("it is exported")
    };
    // SAFETY: the functions of these names, as the header declares them.
    let (create_cpu, create_d3d12, destroy, last_error) = unsafe {
        (
            std::mem::transmute::<Exported, CreateCpu>(function(c"cairn_device_create_cpu")),
            std::mem::transmute::<Exported, CreateD3d12>(function(c"cairn_device_create_d3d12")),
            std::mem::transmute::<Exported, Destroy>(function(c"cairn_device_destroy")),
            std::mem::transmute::<Exported, LastError>(function(c"cairn_last_error")),
        )
    };
    let message = || {
        let mut text = [0_u8; 4096];
        let mut length = 0;
        // SAFETY: a buffer of the given size, and a variable for the length.
        unsafe { last_error(text.as_mut_ptr().cast(), text.len(), &mut length) };
        String::from_utf8_lossy(&text[..length.min(text.len())]).replace('\n', " ")
    };
    let named = std::env::var(NAMES).ok().map(|path| CString::new(path).expect("no NUL"));
    let allows = std::env::var_os(ALLOWS).is_some();
    let options = cairn_device_options {
        struct_size: size_of::<cairn_device_options>() as u32,
        threads: 1,
        flags: if allows { CAIRN_DEVICE_ENVIRONMENT } else { 0 },
        reserved: 0,
        onnxruntime: named.as_ref().map_or(null(), |path| path.as_ptr()),
        ffx: null(),
        webgpu: null(),
    };
    let options = if allows || named.is_some() { &raw const options } else { null() };
    let print_result = |kind: &str, result: cairn_result, device: *mut cairn_device| {
        if result == CAIRN_OK {
            println!("> {kind} {result}");
        } else {
            println!("> {kind} {result} {}", message());
        }
        // SAFETY: null or a live handle.
        assert_eq!(unsafe { destroy(device) }, CAIRN_OK);
    };
    let mut device = null_mut();
    // SAFETY: null or options of their size, and a variable for the handle.
    print_result("cpu", unsafe { create_cpu(options, &mut device) }, device);
    let engine = Engine::create();
    let mut device = null_mut();
    let (d3d12, queue) = (engine.device.as_raw().cast(), engine.direct.as_raw().cast());
    // SAFETY: live objects, null or options of their size, and a variable for the handle.
    print_result("d3d12", unsafe { create_d3d12(d3d12, queue, null_mut(), options, &mut device) }, device);
    for name in RUNTIME.into_iter().chain([NEEDED]) {
        match loaded(name) {
            Some(path) => println!("> {name} is {}", path.display()),
            None => println!("> {name} is not loaded"),
        }
    }
}

/// The path of a library that is loaded in this process.
fn loaded(name: &str) -> Option<PathBuf> {
    let name: Vec<u16> = name.encode_utf16().chain([0]).collect();
    // SAFETY: a name that ends with a zero; no reference is taken.
    let module: HMODULE = unsafe { GetModuleHandleW(PCWSTR(name.as_ptr())) }.ok()?;
    let mut path = vec![0; 1 << 15];
    // SAFETY: a loaded module and memory of the slice's length.
    let length = unsafe { GetModuleFileNameW(Some(module), &mut path) } as usize;
    Some(String::from_utf16_lossy(&path[..length]).into())
}

#[test]
fn libraries_are_found_beside_cairn_in_every_layout() {
    let library_path = library();
    // The library's folder, its name, and the program's folder.
    for (name, place, file, program_folder) in [
        ("plain", "library", "cairn.dll", "program"),
        ("unity", r"Game_Data\Plugins\x86_64", "cairn_unity.dll", "."),
        ("unreal", r"Game\Plugins\Cairn\Binaries\ThirdParty\Cairn\Win64", "cairn.dll", r"Game\Binaries\Win64"),
        ("letters", "a folder Ж 状態", "cairn.dll", "another folder Ж"),
    ] {
        let root = create_folder(name);
        let folder = root.join(place);
        link_runtime(&folder);
        assert_finds(&mut program(&root.join(program_folder), &link_file(&library_path, &folder, file)), &folder);
    }
}

#[test]
fn libraries_are_found_beside_the_program() {
    let root = create_folder("program");
    let folder = root.join("program");
    link_runtime(&folder);
    assert_finds(&mut program(&folder, &link_file(&library(), &root.join("library"), "cairn.dll")), &folder);
}

#[test]
fn libraries_are_found_at_the_path_in_the_options() {
    let root = create_folder("named");
    let folder = root.join("a folder Ж 状態");
    link_runtime(&folder);
    let mut command = program(&root.join("program"), &link_file(&library(), &root.join("library"), "cairn.dll"));
    assert_finds(command.env(NAMES, folder.join(RUNTIME[0])), &folder);
}

#[test]
fn environment_variables_count_only_if_the_host_allows_it() {
    let root = create_folder("environment");
    let library_path = link_file(&library(), &root.join("library"), "cairn.dll");
    let folder = root.join("named");
    link_runtime(&folder);
    let cache = root.join("cache");
    let cached = cache.join("cairn").join("onnxruntime-1.24.4");
    link_runtime(&cached);
    let program_folder = root.join("program");
    for (variable, value, place) in [
        ("CAIRN_ONNXRUNTIME", folder.join(RUNTIME[0]), &folder),
        ("CAIRN_CACHE_DIR", cache.clone(), &cached),
        ("LOCALAPPDATA", cache, &cached),
    ] {
        let mut command = program(&program_folder, &library_path);
        command.env(variable, value);
        let named = variable == "CAIRN_ONNXRUNTIME";
        assert_misses(
            &mut command,
            if named { &["CAIRN_ONNXRUNTIME is set, but this host"] } else { &["was not found"] },
        );
        assert_finds(command.env(ALLOWS, "1"), place);
    }
    // A variable does not override the files beside the library either.
    let beside = root.join("beside");
    link_runtime(&beside);
    let mut command = program(&program_folder, &link_file(&library(), &beside, "cairn.dll"));
    assert_finds(command.env("CAIRN_ONNXRUNTIME", folder.join(RUNTIME[0])), &beside);
}

/// On Windows `/proc/self/maps` is a path on the current drive, where anybody may write a file that names any folder. Wine maps paths with
/// this prefix to Linux on every drive, so this test also checks that the library does not contain the name.
#[test]
fn a_file_called_proc_self_maps_is_not_read() {
    let root = create_folder("planted");
    let planted = root.join("planted");
    link_runtime(&planted);
    let folder = Path::new(r"C:\proc\self");
    std::fs::create_dir_all(folder).expect("a folder");
    let path = planted.display().to_string().replace('\\', "/");
    let line = format!("0-7fffffffffffffff r-xp 00000000 00:00 0 {}/cairn.dll\n", path.trim_start_matches("C:"));
    std::fs::write(folder.join("maps"), line).expect("a file");
    let mut command = program(&root.join("program"), &link_file(&library(), &root.join("library"), "cairn.dll"));
    assert_misses(&mut command, &["was not found", r"library\onnxruntime.dll"]);
    std::fs::remove_dir_all(r"C:\proc").expect("it was there");
    let bytes = std::fs::read(library()).expect("the library");
    assert!(!bytes.windows(6).any(|part| part == b"/proc/"), "the library names a file of Linux");
}

/// ONNX Runtime needs Visual C++'s runtime: from its own folder or the system's, never from the program's or the working folder.
#[test]
fn dependencies_of_onnx_runtime_come_from_its_folder_or_the_system() {
    let root = create_folder("needs");
    let folder = root.join("library");
    link_runtime(&folder);
    let program_folder = root.join("program");
    let mut command = program(&program_folder, &link_file(&library(), &folder, "cairn.dll"));
    // Any library will do: the test only checks which one was loaded.
    link_file(&library(), &program_folder, NEEDED);
    link_file(&library(), &root.join("working"), NEEDED);
    assert_finds(command.current_dir(root.join("working")).env(NAMES, folder.join(RUNTIME[0])), &folder);
}
