//! The cost of the C interface for a host: the overhead of a call, presenter queries, the size of the shared library and its load time.
//! `cargo xtask bench` runs it, against the library that is built beside it.
//!
//! Calls go through symbols looked up in the library, as a host's do, and are compared with a call that does nothing.
//! Without `--bench`, as under `cargo test`, everything runs a few times and the results mean nothing.

use std::error::Error;
use std::ffi::c_void;
use std::path::PathBuf;
use std::time::Instant;

use libloading::Library;

/// Calls in one measurement. The shortest of many measurements counts, because other load only adds time.
const CALLS: u32 = 20_000;
const MEASUREMENTS: u32 = 50;

#[repr(C)]
struct Picture {
    struct_size: u32,
    format: u32,
    width: u32,
    height: u32,
    pixels: *const c_void,
    size: u64,
    row_pitch: u64,
}

type Version = unsafe extern "C" fn() -> u32;
type AnchorCreate = unsafe extern "C" fn(*const Picture, u64, u32, *mut *mut c_void) -> i32;
type GetInfo = unsafe extern "C" fn(*const c_void, *mut u32) -> i32;
type PresenterCreate = unsafe extern "C" fn(*const c_void, *mut *mut c_void) -> i32;
type Push = unsafe extern "C" fn(*const c_void, *const c_void, *const c_void, u64) -> i32;
type Query = unsafe extern "C" fn(*const c_void, u64, *mut u64) -> i32;

fn main() -> Result<(), Box<dyn Error>> {
    let path = library()?;
    let size = std::fs::metadata(&path)?.len();
    println!("shared library: {:.1} MiB at {}", size as f64 / f64::from(1 << 20), path.display());
    let start = Instant::now();
    // SAFETY: the library of this package, whose initialisers have no side effects.
    let library = unsafe { Library::new(&path) }?;
    // SAFETY: the type is the header's, here and below.
    let version = unsafe { library.get::<Version>(b"cairn_version\0") }?;
    // SAFETY: takes nothing.
    unsafe { version() };
    println!("loaded and first called in {:.2} ms", start.elapsed().as_secs_f64() * 1e3);

    // SAFETY: as above.
    let (anchor_create, get_info, presenter_create, push, query) = unsafe {
        (
            library.get::<AnchorCreate>(b"cairn_anchor_create\0")?,
            library.get::<GetInfo>(b"cairn_anchor_get_info\0")?,
            library.get::<PresenterCreate>(b"cairn_presenter_create\0")?,
            library.get::<Push>(b"cairn_presenter_push\0")?,
            library.get::<Query>(b"cairn_presenter_query\0")?,
        )
    };
    let pixels = [0_u8; 4 * 16];
    let picture = Picture {
        struct_size: size_of::<Picture>() as u32,
        format: 0,
        width: 4,
        height: 4,
        pixels: pixels.as_ptr().cast(),
        size: 64,
        row_pitch: 0,
    };
    let mut presenter = std::ptr::null_mut();
    let mut anchor = std::ptr::null_mut();
    // cairn_presenter_options: struct_size, multiplier 4, no size, 60 ms between anchors, and zeroes.
    let options = [64_u64 | 4 << 32, 0, 60_000_000, 0, 0, 0, 0, 0];
    let check = |result: i32, what: &str| if result == 0 { Ok(()) } else { Err(format!("{what} answers {result}")) };
    // SAFETY: the structs are as the header has them.
    unsafe {
        check(presenter_create(options.as_ptr().cast(), &mut presenter), "cairn_presenter_create")?;
        for i in 0..3 {
            check(anchor_create(&picture, i, 0, &mut anchor), "cairn_anchor_create")?;
            check(push(presenter, anchor, std::ptr::null(), i * 60_000_000), "cairn_presenter_push")?;
        }
    }
    // cairn_anchor_info has 56 bytes and cairn_frame as many.
    let (mut info, mut frame) = ([56_u32; 14], [56_u64; 7]);
    let mut now = 0_u64;
    // SAFETY: the handles are alive and the structs have the room they name.
    let calls: [(&str, &mut dyn FnMut() -> i32); 4] = unsafe {
        [
            ("cairn_version, which does nothing", &mut || (version() == 0).into()),
            ("cairn_anchor_get_info, refused", &mut || (get_info(std::ptr::null(), std::ptr::null_mut()) == 0).into()),
            ("cairn_anchor_get_info", &mut || get_info(anchor, info.as_mut_ptr())),
            ("cairn_presenter_query", &mut || {
                now = (now + 1_000_003) % 180_000_000;
                query(presenter, now, frame.as_mut_ptr())
            }),
        ]
    };
    let measurements = if std::env::args().any(|argument| argument == "--bench") { MEASUREMENTS } else { 1 };
    let mut nothing = 0.0;
    for (name, call) in calls {
        let mut best = f64::INFINITY;
        for _ in 0..measurements {
            let start = Instant::now();
            let failed: i32 = (0..CALLS).map(|_| call()).sum();
            best = best.min(start.elapsed().as_nanos() as f64 / f64::from(CALLS));
            check(failed, name)?;
        }
        if nothing == 0.0 {
            nothing = best;
        }
        println!("{name:<36} {best:7.1} ns, {:5.1} times nothing", best / nothing);
    }
    Ok(())
}

/// The shared library that cargo built together with this program.
fn library() -> Result<PathBuf, Box<dyn Error>> {
    let name = format!("{}cairn{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let program = std::env::current_exe()?;
    let beside = program.parent().ok_or("the program lies in no folder")?.join(&name);
    if beside.is_file() { Ok(beside) } else { Err(format!("{} is not there", beside.display()).into()) }
}
