//! The library as a host loads it: after its last object is destroyed none of its threads remains, and it can be unloaded, loaded
//! again and used again. It is one test, since it counts the threads of the process.

use std::ffi::c_void;
use std::path::PathBuf;
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use cairn::abi::controls::cairn_controls;
use cairn::abi::device::{CAIRN_DEVICE_ENVIRONMENT, cairn_device_options};
use cairn::abi::images::{cairn_picture, cairn_target};
use cairn::abi::presenter::{CAIRN_FRAME_GENERATED, cairn_frame, cairn_presenter, cairn_presenter_options};
use cairn::abi::results::{CAIRN_NOT_READY, CAIRN_OK, cairn_result};
use cairn::abi::threads::{cairn_job, cairn_scheduler, cairn_thread_options};
#[cfg(feature = "embedded-world")]
use cairn::abi::world::cairn_world_options;
#[cfg(windows)]
use test_support::d3d12::engine::{Engine, reference_count, wait_for_counts};
#[cfg(windows)]
use test_support::d3d12::textures;

/// Size of the pictures: large enough for threads to share the work.
const SIZE: [u32; 2] = [320, 180];

/// Path of the library from this build.
fn path() -> PathBuf {
    let name = if cfg!(windows) { "cairn.dll" } else { "libcairn.so" };
    let program = std::env::current_exe().expect("a path");
    program.with_file_name(name)
}

/// Calls a function of a loaded library. Its type is that of the same function in the library linked into this program.
macro_rules! call {
    ($library:expr, $module:ident::$name:ident($($argument:expr),*)) => {{
        #[allow(unused_assignments, reason = "the first value is there for its type")]
        let mut function: unsafe extern "C" fn($(any!($argument)),*) -> cairn_result = cairn::abi::$module::$name;
        // SAFETY: the library has the interface of the one linked into this program, which is of the same build.
        function = unsafe { *$library.get(concat!(stringify!($name), "\0").as_bytes()).expect(stringify!($name)) };
        // SAFETY: arguments are as the header has them.
        unsafe { function($($argument),*) }
    }};
}

macro_rules! any {
    ($argument:expr) => {
        _
    };
}

macro_rules! assert_ok {
    ($library:expr, $module:ident::$name:ident($($argument:expr),*)) => {
        assert_eq!(call!($library, $module::$name($($argument),*)), CAIRN_OK, "{}: {}", stringify!($name), last_error($library))
    };
}

/// The last error's message.
fn last_error(library: &libloading::Library) -> String {
    let mut text = [0_u8; 512];
    call!(library, results::cairn_last_error(text.as_mut_ptr().cast(), text.len(), null_mut()));
    String::from_utf8_lossy(&text).trim_end_matches('\0').to_owned()
}

fn zeroed<T>() -> T {
    // SAFETY: used for structs of the header, in which zeroes are every field's default.
    unsafe { std::mem::zeroed() }
}

fn picture(pixels: &[u8]) -> cairn_picture {
    cairn_picture {
        struct_size: size_of::<cairn_picture>() as u32,
        width: SIZE[0],
        height: SIZE[1],
        pixels: pixels.as_ptr().cast(),
        size: pixels.len() as u64,
        ..zeroed()
    }
}

/// Device options for tests: environment variables may name libraries, as for a tool.
fn options() -> cairn_device_options {
    cairn_device_options {
        struct_size: size_of::<cairn_device_options>() as u32,
        flags: CAIRN_DEVICE_ENVIRONMENT,
        ..zeroed()
    }
}

/// A generated frame of the anchors from `push`.
fn present(library: &libloading::Library, push: impl Fn(*mut cairn_presenter)) -> Vec<u8> {
    present_and(library, push, || {})
}

/// As [`present`]; calls `check` before the presenter is destroyed.
fn present_and(library: &libloading::Library, push: impl Fn(*mut cairn_presenter), check: impl FnOnce()) -> Vec<u8> {
    let options = cairn_presenter_options {
        struct_size: size_of::<cairn_presenter_options>() as u32,
        interval_ns: 1_000,
        ..zeroed()
    };
    let mut presenter = null_mut();
    assert_ok!(library, presenter::cairn_presenter_create(&options, &mut presenter));
    push(presenter);
    let mut pixels = vec![0_u8; (SIZE[0] * SIZE[1] * 4) as usize];
    let target = cairn_target {
        struct_size: size_of::<cairn_target>() as u32,
        width: SIZE[0],
        height: SIZE[1],
        pixels: pixels.as_mut_ptr().cast(),
        size: pixels.len() as u64,
        ..zeroed()
    };
    let mut frame = cairn_frame { struct_size: size_of::<cairn_frame>() as u32, ..zeroed() };
    for now in [1_000, 1_500] {
        assert_ne!(
            call!(library, presenter::cairn_presenter_draw(presenter, now, &target, &mut frame)),
            CAIRN_NOT_READY
        );
    }
    assert_eq!(frame.source, CAIRN_FRAME_GENERATED, "a frame between two anchors");
    check();
    assert_ok!(library, presenter::cairn_presenter_destroy(presenter));
    pixels
}

/// A generated frame from two pictures of the host's own.
fn frame(library: &libloading::Library) -> Vec<u8> {
    present(library, |presenter| push(library, presenter))
}

/// Pushes two pictures of the host's own to a presenter.
fn push(library: &libloading::Library, presenter: *mut cairn_presenter) {
    for number in 0..2_u32 {
        let at = |i: u32| (i % SIZE[0] + 3 * number, i / SIZE[0]);
        let level = |(x, y): (u32, u32), c: u32| ((x * (7 + c) / 3) ^ (y * 5)) as u8;
        let pixels: Vec<u8> = (0..SIZE[0] * SIZE[1]).flat_map(|i| (0..4).map(move |c| level(at(i), c) | 1)).collect();
        let mut anchor = null_mut();
        assert_ok!(library, anchor::cairn_anchor_create(&picture(&pixels), number.into(), 0, &mut anchor));
        assert_ok!(library, presenter::cairn_presenter_push(presenter, anchor, null(), u64::from(number) * 1_000));
        assert_ok!(library, anchor::cairn_anchor_destroy(anchor));
    }
}

/// A generated frame between two latents of the embedded world.
#[cfg(feature = "embedded-world")]
fn world(library: &libloading::Library) -> Vec<u8> {
    let (mut device, mut world, mut rollout) = (null_mut(), null_mut(), null_mut());
    assert_ok!(library, device::cairn_device_create_cpu(&options(), &mut device));
    let options = cairn_world_options { struct_size: size_of::<cairn_world_options>() as u32, ..zeroed() };
    assert_ok!(library, world::cairn_world_load(device, &options, &mut world));
    assert_ok!(library, rollout::cairn_rollout_create(world, null(), &mut rollout));
    let grey = vec![128_u8; (SIZE[0] * SIZE[1] * 4) as usize];
    assert_ok!(library, rollout::cairn_rollout_append(rollout, &picture(&grey), null_mut()));
    let controls = cairn_controls { struct_size: size_of::<cairn_controls>() as u32, ..zeroed() };
    let pixels = present(library, |presenter| {
        for number in 0..2_u64 {
            // One step on this thread, one on the rollout's.
            if number == 0 {
                assert_ok!(library, rollout::cairn_rollout_step(rollout, &controls, null_mut()));
            } else {
                let mut ticket = 0;
                assert_ok!(library, steps::cairn_rollout_submit(rollout, &controls, &mut ticket));
                assert_ok!(library, steps::cairn_rollout_wait(rollout, ticket, u64::MAX, null_mut(), null_mut()));
            }
            let mut anchor = null_mut();
            assert_ok!(library, rollout::cairn_rollout_get_anchor(rollout, &mut anchor));
            assert_ok!(library, presenter::cairn_presenter_push(presenter, anchor, null(), number * 1_000));
            assert_ok!(library, anchor::cairn_anchor_destroy(anchor));
        }
    });
    assert_ok!(library, rollout::cairn_rollout_destroy(rollout));
    assert_ok!(library, world::cairn_world_destroy(world));
    assert_ok!(library, device::cairn_device_destroy(device));
    pixels
}

/// A generated frame in a texture of an engine's device. Unless `is_waited_for`, the device may still work on it at the end.
#[cfg(windows)]
fn device_frame(library: &libloading::Library, engine: &Engine, is_waited_for: bool) {
    use cairn::gpu::windows::Win32::Graphics::Direct3D12::{D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET, ID3D12Fence};
    use cairn::gpu::windows::core::Interface;

    let flags = D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET;
    let target = textures::TextureDesc { size: SIZE.into(), flags, ..Default::default() }.create(&engine.device);
    let (mut device, mut presenter) = (null_mut(), null_mut());
    let (own, queue) = (engine.device.as_raw().cast(), engine.direct.as_raw().cast());
    assert_ok!(library, d3d12::cairn_device_create_d3d12(own, queue, null_mut(), &options(), &mut device));
    let options = cairn_presenter_options {
        struct_size: size_of::<cairn_presenter_options>() as u32,
        interval_ns: 1_000,
        ..zeroed()
    };
    assert_ok!(library, presenter::cairn_presenter_create(&options, &mut presenter));
    push(library, presenter);
    let preparation = cairn::abi::d3d12::cairn_d3d12_preparation {
        struct_size: size_of::<cairn::abi::d3d12::cairn_d3d12_preparation>() as u32,
        ..zeroed()
    };
    assert_ok!(library, d3d12::cairn_presenter_prepare_d3d12(presenter, device, &preparation));
    let mut frame = cairn_frame { struct_size: size_of::<cairn_frame>() as u32, ..zeroed() };
    let (mut fence, mut value) = (null_mut(), 0);
    for now in [1_000, 1_500] {
        let target = target.as_raw().cast();
        assert_ok!(
            library,
            d3d12::cairn_presenter_submit_d3d12(
                presenter, device, now, target, 0, 0, &mut frame, &mut fence, &mut value
            )
        );
        // SAFETY: a fence whose reference the call passed to us.
        let fence = unsafe { ID3D12Fence::from_raw(fence.cast()) };
        if is_waited_for {
            // SAFETY: without an event it waits.
            unsafe { fence.SetEventOnCompletion(value, Default::default()) }.expect("the frame is there");
        }
    }
    assert_eq!(
        (frame.source, frame.flags),
        (CAIRN_FRAME_GENERATED, 0),
        "a frame between two anchors, as it was prepared"
    );
    assert_ok!(library, presenter::cairn_presenter_destroy(presenter));
    assert_ok!(library, device::cairn_device_destroy(device));
}

/// As [`frame`], with `count` threads of the library's own.
fn frame_on(library: &libloading::Library, count: u32) -> Vec<u8> {
    let options =
        cairn_thread_options { struct_size: size_of::<cairn_thread_options>() as u32, threads: count, ..zeroed() };
    assert_ok!(library, threads::cairn_set_threads(&options));
    let before = threads();
    let check = || wait_for_threads(before + count as usize, "the number that was set");
    present_and(library, |presenter| push(library, presenter), check)
}

static JOBS: AtomicUsize = AtomicUsize::new(0);

/// A host's job system: a thread for each job.
unsafe extern "C" fn run(user: *mut c_void, jobs: u32, job: cairn_job, data: *mut c_void) {
    assert!(user.is_null());
    let (job, data) = (job.expect("a job"), data.addr());
    // SAFETY: the library's own job and data, and this call has not returned.
    let call = move || unsafe { job(std::ptr::without_provenance_mut(data)) };
    JOBS.fetch_add(jobs as usize, Ordering::SeqCst);
    std::thread::scope(|scope| (0..jobs).for_each(|_| _ = scope.spawn(call)));
}

/// As [`frame`], with the host's job system.
fn frame_on_jobs(library: &libloading::Library) -> Vec<u8> {
    let scheduler = cairn_scheduler {
        struct_size: size_of::<cairn_scheduler>() as u32,
        concurrency: 4,
        run: Some(run),
        user: null_mut(),
    };
    assert_ok!(library, threads::cairn_set_scheduler(&scheduler));
    let before = threads();
    let check = || wait_for_threads(before, "the library starts none of its own");
    let pixels = present_and(library, |presenter| push(library, presenter), check);
    assert!(JOBS.swap(0, Ordering::SeqCst) > 0, "the host's job system ran jobs");
    assert_ok!(library, threads::cairn_set_scheduler(null()));
    pixels
}

/// Loads the library, uses it on a separate thread, and unloads it after that thread has ended: on Linux the thread's local data keep the
/// library loaded until then.
fn load_and_run<T: Send>(work: impl FnOnce(&libloading::Library) -> T + Send) -> T {
    let before = threads();
    // SAFETY: the library of this very build, which does nothing when it is loaded.
    let library = unsafe { libloading::Library::new(path()) }.expect("the library of this build");
    let made = std::thread::scope(|scope| scope.spawn(|| work(&library)).join()).expect("no panic");
    wait_for_threads(before, "no thread of the library remains after its last object");
    library.close().expect("unloaded");
    assert_eq!(threads(), before);
    made
}

#[test]
fn the_library_can_be_unloaded_and_loaded_again() {
    let first = load_and_run(frame);
    assert!(!is_loaded(), "no object is left, so the library can be unloaded");
    for _ in 0..20 {
        assert!(load_and_run(frame) == first, "the same frame");
        assert!(!is_loaded());
    }
    for count in [1, 2, 7] {
        assert!(load_and_run(|library| frame_on(library, count)) == first, "the same frame on {count} threads");
    }
    assert!(load_and_run(frame_on_jobs) == first, "the same frame on a host's job system");
    assert!(!is_loaded());
    #[cfg(target_os = "linux")]
    {
        // SAFETY: the library of this very build, which does nothing when it is loaded.
        let library = unsafe { libloading::Library::new(path()) }.expect("the library of this build");
        assert_ne!(
            call!(&library, anchor::cairn_anchor_destroy(null_mut::<()>().wrapping_byte_add(1).cast())),
            CAIRN_OK
        );
        library.close().expect("unloaded");
        assert!(is_loaded(), "this thread's last error keeps it loaded");
        assert!(load_and_run(frame) == first);
    }
    #[cfg(feature = "embedded-world")]
    {
        let first = load_and_run(world);
        for _ in 0..3 {
            assert!(load_and_run(world) == first, "the same world and the same frame");
            load_and_run(frame);
        }
        assert!(is_loaded(), "ONNX Runtime keeps it loaded");
    }
    #[cfg(windows)]
    {
        let engine = Engine::create();
        let references = || [reference_count(&engine.device), reference_count(&engine.direct)];
        let before = references();
        for is_waited_for in [true, false, true, false] {
            load_and_run(|library| device_frame(library, &engine, is_waited_for));
            wait_for_counts(references, before);
        }
    }
}

/// Waits until the process has `expected` threads: a joined thread, or a driver's, may still be ending.
fn wait_for_threads(expected: usize, why: &str) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while threads() != expected && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(threads(), expected, "{why}");
}

/// Threads of this process.
#[cfg(target_os = "linux")]
fn threads() -> usize {
    std::fs::read_dir("/proc/self/task").expect("the threads").count()
}

#[cfg(target_os = "linux")]
fn is_loaded() -> bool {
    let maps = std::fs::read_to_string("/proc/self/maps").expect("the list of mappings");
    maps.contains(&path().canonicalize().expect("a path").display().to_string())
}

#[cfg(windows)]
fn threads() -> usize {
    use windows::Win32::Foundation::CloseHandle;
    use windows::Win32::System::Diagnostics::ToolHelp::{
        CreateToolhelp32Snapshot, TH32CS_SNAPTHREAD, THREADENTRY32, Thread32First, Thread32Next,
    };
    // SAFETY: a snapshot of all threads, and an entry of the size that it says.
    unsafe {
        let snapshot = CreateToolhelp32Snapshot(TH32CS_SNAPTHREAD, 0).expect("a snapshot");
        let mut entry = THREADENTRY32 { dwSize: size_of::<THREADENTRY32>() as u32, ..Default::default() };
        let (mut count, mut found) = (0, Thread32First(snapshot, &mut entry));
        while found.is_ok() {
            count += usize::from(entry.th32OwnerProcessID == std::process::id());
            found = Thread32Next(snapshot, &mut entry);
        }
        CloseHandle(snapshot).expect("closed");
        count
    }
}

#[cfg(windows)]
fn is_loaded() -> bool {
    use windows::Win32::System::LibraryLoader::GetModuleHandleW;
    // SAFETY: a static name.
    unsafe { GetModuleHandleW(windows::core::w!("cairn.dll")) }.is_ok()
}
