//! The plugin in the stand-in for Unity, over a real device and with every version of the interface, through the recorder of Direct3D's calls. On
//! Windows, or in the lab.
#![cfg(windows)]

use std::ffi::{CString, c_char, c_int, c_void};
use std::ptr::{null, null_mut, without_provenance_mut};
use std::time::{Duration, SystemTime};

use cairn::abi::anchor::{cairn_anchor_create, cairn_anchor_destroy};
use cairn::abi::device::{cairn_device, cairn_device_destroy};
use cairn::abi::images::{CAIRN_FORMAT_RGBA16F, cairn_picture, cairn_target};
use cairn::abi::presenter::*;
use cairn::abi::results::{
    CAIRN_ERROR_INVALID_ARGUMENT, CAIRN_ERROR_INVALID_HANDLE, CAIRN_NOT_READY, CAIRN_OK, cairn_result,
};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::core::Interface;
// The plugin is linked into this program.
use cairn_unity as plugin;
use cairn_unity::*;
use test_support::c_interface::{create_handle, with_struct_size};
use test_support::d3d12::amd;
use test_support::d3d12::engine;
use test_support::d3d12::object_counts;
use test_support::d3d12::textures::{self, TextureDesc};

#[path = "host/strictness.rs"]
mod strictness;
#[path = "host/unity.rs"]
mod unity;

use unity::UnityHandle;

/// Size of frames. Its row size is not a multiple of the copy alignment, and AMD's libraries accept it.
const SIZE: (u32, u32) = (101, 67);
/// Nanoseconds between anchors.
const INTERVAL: u64 = 100_000_000;
/// Where Unity leaves a texture that a shader has read.
const READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE;

/// A presenter with two anchors, four frames to an anchor, in the given colour space.
fn presenter(colour_space: u32) -> *mut cairn_presenter {
    let mut options: cairn_presenter_options = with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
    (options.multiplier, options.interval_ns, options.colour_space) = (4, INTERVAL, colour_space);
    // SAFETY: options with their struct size, and a writable handle.
    let presenter = create_handle(|to| unsafe { cairn_presenter_create(&options, to) });
    for number in 0..2 {
        let colour = |i: u32| {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            [(x * 255 / SIZE.0) as u8, (y * 255 / SIZE.1) as u8, ((x ^ y) * 8 * (1 + number as u32)) as u8, 255]
        };
        let pixels: Vec<u8> = (0..SIZE.0 * SIZE.1).flat_map(colour).collect();
        let mut picture: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
        (picture.width, picture.height) = SIZE;
        (picture.pixels, picture.size) = (pixels.as_ptr().cast(), pixels.len() as u64);
        // SAFETY: a picture that lives during the call, and a place for the handle.
        let anchor = create_handle(|to| unsafe { cairn_anchor_create(&picture, number, 0, to) });
        // SAFETY: live handles.
        let pushed = unsafe { cairn_presenter_push(presenter, anchor, null(), number * INTERVAL) };
        // SAFETY: a live handle.
        assert_eq!([pushed, unsafe { cairn_anchor_destroy(anchor) }], [CAIRN_OK; 2]);
    }
    presenter
}

/// The frame at `now`, drawn into memory.
fn draw(presenter: *mut cairn_presenter, now: u64) -> Vec<u8> {
    let mut pixels = vec![0; (SIZE.0 * SIZE.1 * 4) as usize];
    let mut target: cairn_target = with_struct_size(|target: &mut cairn_target| &mut target.struct_size);
    (target.width, target.height) = SIZE;
    (target.pixels, target.size) = (pixels.as_mut_ptr().cast(), pixels.len() as u64);
    // SAFETY: a live handle and a target that lives during the call.
    assert_eq!(unsafe { cairn_presenter_draw(presenter, now, &target, null_mut()) }, CAIRN_OK);
    pixels
}

/// The same frame as numbers in a colour space: red first, without alpha.
fn draw_in(presenter: *mut cairn_presenter, now: u64, colour_space: u32) -> Vec<f64> {
    if colour_space == CAIRN_COLOUR_SRGB {
        return numbers(&draw(presenter, now), DXGI_FORMAT_R8G8B8A8_TYPELESS);
    }
    let mut halves = vec![0; (SIZE.0 * SIZE.1 * 8) as usize];
    let mut target: cairn_target = with_struct_size(|target: &mut cairn_target| &mut target.struct_size);
    (target.width, target.height, target.format) = (SIZE.0, SIZE.1, CAIRN_FORMAT_RGBA16F);
    (target.pixels, target.size) = (halves.as_mut_ptr().cast(), halves.len() as u64);
    // SAFETY: a live handle and a target that lives during the call.
    assert_eq!(unsafe { cairn_presenter_draw(presenter, now, &target, null_mut()) }, CAIRN_OK);
    numbers(&halves, DXGI_FORMAT_R16G16B16A16_FLOAT)
}

/// State of the plugin and its text.
fn state() -> (cairn_result, String) {
    let (mut text, mut length) = ([0_u8; 512], 0);
    // SAFETY: the buffer has the stated capacity, and `length` can be written.
    let result = unsafe { cairn_unity_state(text.as_mut_ptr().cast(), text.len(), &mut length) };
    (result, String::from_utf8_lossy(&text[..length]).into_owned())
}

/// A device, a presenter and its view, as C# makes them.
struct Scene {
    device: *mut cairn_device,
    presenter: *mut cairn_presenter,
    view: *mut cairn_unity_view,
}

impl Scene {
    fn new() -> Self {
        Self::of(CAIRN_COLOUR_SRGB)
    }

    fn of(colour_space: u32) -> Self {
        Self::with_pipelines(colour_space, null())
    }

    /// Prepared with a file that keeps compiled pipelines.
    fn with_pipelines(colour_space: u32, file: *const c_char) -> Self {
        amd::allow_double();
        // SAFETY: the handle's variable can be written.
        let device = create_handle(|to| unsafe { cairn_unity_create_device(to) });
        let presenter = presenter(colour_space);
        // SAFETY: live handles, and a text that lives during the call.
        assert_eq!(unsafe { cairn_unity_prepare(device, presenter, SIZE.0, SIZE.1, SIZE.0, SIZE.1, file) }, CAIRN_OK);
        // SAFETY: live handles and a writable view.
        let view = create_handle(|to| unsafe { cairn_unity_view_create(device, presenter, to) });
        Self { device, presenter, view }
    }

    /// Sets time and texture of the next frame.
    fn set(&self, now: u64, texture: Option<&ID3D12Resource>) -> cairn_result {
        let texture = texture.map_or(null_mut(), Interface::as_raw);
        // SAFETY: a live texture, or null.
        unsafe { cairn_unity_view_set(self.view, now, texture) }
    }

    /// Result of the last event, number of frames shown, the last frame made, and the message.
    fn get(&self) -> (cairn_result, u64, cairn_frame, String) {
        let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
        let (mut shown, mut text, mut length) = (0, [0_u8; 1024], 0);
        let room = text.as_mut_ptr().cast();
        // SAFETY: all outputs can be written.
        let result = unsafe { cairn_unity_view_get(self.view, &mut shown, &mut frame, room, text.len(), &mut length) };
        (result, shown, frame, String::from_utf8_lossy(&text[..length]).into_owned())
    }

    /// Issues both events in one frame of Unity's.
    fn show(&self, unity: &UnityHandle) {
        unity.event(cairn_unity_get_make_event(), self.view.cast());
        unity.event(cairn_unity_get_show_event(), self.view.cast());
        unity.end_frame();
    }

    fn end(self) {
        // SAFETY: live handles.
        let ended = unsafe {
            [
                cairn_unity_view_destroy(self.view),
                cairn_presenter_destroy(self.presenter),
                cairn_device_destroy(self.device),
            ]
        };
        assert_eq!(ended, [CAIRN_OK; 3]);
    }
}

/// A texture with the format of a RenderTexture of Unity's.
fn texture(unity: &UnityHandle, size: (u32, u32), levels: u16) -> ID3D12Resource {
    texture_from_picture(unity, size, levels, DXGI_FORMAT_R8G8B8A8_TYPELESS)
}

fn texture_from_picture(unity: &UnityHandle, size: (u32, u32), levels: u16, format: DXGI_FORMAT) -> ID3D12Resource {
    let wanted = TextureDesc {
        size,
        format,
        flags: D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET,
        state: READ,
        levels,
        ..TextureDesc::default()
    };
    let made = wanted.create(&unity.device());
    unity.own(&made, READ);
    made
}

fn pixels(unity: &UnityHandle, texture: &ID3D12Resource) -> Vec<u8> {
    textures::read(&unity.device(), &unity.queue(), texture, unity.state_of(texture))
}

/// Whether two pictures differ by at most one level.
fn alike(one: &[u8], other: &[u8]) -> bool {
    one.len() == other.len() && one.iter().zip(other).all(|(a, b)| a.abs_diff(*b) <= 1)
}

/// A frame that a target is expected to show.
#[derive(Clone, PartialEq)]
enum Expected {
    /// The pixels that the CPU draws.
    Drawn(Vec<u8>),
    /// A picture that AMD's libraries make halfway between anchors and that the CPU cannot draw.
    MadeByAmd,
}

impl Expected {
    fn at(presenter: *mut cairn_presenter, now: u64) -> Self {
        if now % INTERVAL == INTERVAL / 2 && amd::generates_frames(SIZE) {
            return Self::MadeByAmd;
        }
        Self::Drawn(draw(presenter, now))
    }

    fn is_in(&self, unity: &UnityHandle, target: &ID3D12Resource) -> bool {
        let found = pixels(unity, target);
        match self {
            Self::Drawn(pixels) => alike(&found, pixels),
            Self::MadeByAmd => amd::has_detail(&found),
        }
    }
}

/// Whether a target shows the frame at `now`.
fn is_shown(unity: &UnityHandle, target: &ID3D12Resource, presenter: *mut cairn_presenter, now: u64) -> bool {
    Expected::at(presenter, now).is_in(unity, target)
}

#[test]
fn frames_are_shown_by_every_version_of_the_interface() {
    for version in 5..=8 {
        let unity = UnityHandle::start(version);
        unity.load();
        assert_eq!(state(), (CAIRN_OK, format!("IUnityGraphicsD3D12v{version}")));
        let (make, show) = (cairn_unity_get_make_event(), cairn_unity_get_show_event());
        if version > 5 {
            // On the submission thread and on the render thread, without a flush and without a wait for worker threads.
            assert_eq!((unity.configured(make), unity.configured(show)), (Some([1, 0, 0]), Some([0, 0, 0])));
        }
        let scene = Scene::new();
        let target = texture(&unity, SIZE, 1);
        assert_eq!(scene.get().0, CAIRN_NOT_READY);
        let frames = [
            (INTERVAL, CAIRN_FRAME_ANCHOR),
            (INTERVAL * 5 / 4, CAIRN_FRAME_GENERATED),
            (INTERVAL * 3 / 2, CAIRN_FRAME_GENERATED),
            (INTERVAL * 2, CAIRN_FRAME_ANCHOR),
            (INTERVAL * 9 / 4, CAIRN_FRAME_EXTRAPOLATED),
        ];
        for ((now, source), count) in frames.into_iter().zip(1..) {
            assert_eq!(scene.set(now, Some(&target)), CAIRN_OK);
            // Unity reads the texture before, and leaves it in a state that only Unity knows.
            unity.transition(&target, if count % 2 == 0 { READ } else { D3D12_RESOURCE_STATE_RENDER_TARGET });
            scene.show(&unity);
            let (result, shown, frame, message) = scene.get();
            assert_eq!((result, shown, frame.source), (CAIRN_OK, count, source), "v{version}: {message} {frame:?}");
            assert!(is_shown(&unity, &target, scene.presenter, now), "v{version}: frame {count}");
        }
        // Every function that the version has and the plugin needs is called, and no other.
        let whole = [("GetDevice", 5), ("GetFrameFence", 5), ("GetCommandQueue", 5), ("ConfigureEvent", 6)];
        for (name, least) in whole {
            assert_eq!(unity.calls(name) > 0, version >= least, "v{version}: {name}");
        }
        let recorded =
            ["CommandRecordingState", "RequestResourceState", "NotifyResourceState", "GetNextFrameFenceValue"];
        let calls = recorded.map(|name| unity.calls(name));
        let (by_list, by_recording) = if version == 8 { (0, [5; 4]) } else { (5, [0; 4]) };
        assert_eq!((unity.calls("ExecuteCommandList"), calls), (by_list, by_recording), "v{version}");
        assert_eq!(unity.take_violations(), Vec::<String>::new(), "v{version}");
        scene.end();
    }
}

#[test]
fn failures_are_reported_and_harm_nothing() {
    for version in [5, 8] {
        let unity = UnityHandle::start(version);
        unity.load();
        let scene = Scene::new();
        let target = texture(&unity, SIZE, 1);
        // First nothing is set; then a texture of another size than the frames, one with mip maps, and no texture.
        scene.show(&unity);
        assert_eq!(scene.get().0, CAIRN_NOT_READY);
        for (wrong, part) in
            [(texture(&unity, (SIZE.0 + 1, SIZE.1), 1), "target"), (texture(&unity, SIZE, 2), "mip maps")]
        {
            assert_eq!(scene.set(INTERVAL, Some(&wrong)), CAIRN_OK);
            scene.show(&unity);
            let (result, shown, _, message) = scene.get();
            assert_eq!((result, shown), (CAIRN_ERROR_INVALID_ARGUMENT, 0), "{message}");
            assert!(message.contains(part), "{message}");
        }
        // SAFETY: an object of another kind.
        let refused = unsafe { cairn_unity_view_set(scene.view, 0, unity.queue().as_raw()) };
        assert_eq!(refused, CAIRN_ERROR_INVALID_ARGUMENT);
        assert_eq!(scene.set(INTERVAL, Some(&target)), CAIRN_OK);
        let (make, show) = (cairn_unity_get_make_event(), cairn_unity_get_show_event());
        let view: *mut c_void = scene.view.cast();
        // A frame that was not made is not shown; unknown events and data do nothing.
        let events: [(c_int, *mut c_void); 6] = [
            (make - 1, view),
            (show + 1, view),
            (make, null_mut()),
            (show, null_mut()),
            (make, without_provenance_mut(7)),
            (show, (&raw const refused).cast_mut().cast()),
        ];
        for (event, data) in events {
            unity.event(event, data);
        }
        unity.end_frame();
        assert_eq!(scene.get().1, 0);
        scene.show(&unity);
        assert_eq!((scene.get().0, scene.get().1), (CAIRN_OK, 1), "it goes on: {}", scene.get().3);
        assert!(is_shown(&unity, &target, scene.presenter, INTERVAL));

        // First the presenter is destroyed, then the view itself.
        // SAFETY: a live handle.
        assert_eq!(unsafe { cairn_presenter_destroy(scene.presenter) }, CAIRN_OK);
        unity.event(make, view);
        let (result, _, _, message) = scene.get();
        assert!(result == CAIRN_ERROR_INVALID_HANDLE && message.contains("cairn_presenter"), "{message}");
        // SAFETY: live handles, of which none is used again.
        let ended = unsafe { [cairn_unity_view_destroy(scene.view), cairn_device_destroy(scene.device)] };
        assert_eq!(ended, [CAIRN_OK; 2]);
        unity.event(make, view);
        unity.event(show, view);
        unity.end_frame();
        assert_eq!(unity.take_violations(), Vec::<String>::new());
    }
}

#[test]
fn devices_come_and_go_and_nothing_of_them_is_kept() {
    for version in [5, 8] {
        let unity = UnityHandle::start(version);
        let (device, queue) = (unity.device(), unity.queue());
        let target = texture(&unity, SIZE, 1);
        let count =
            || [engine::reference_count(&device), engine::reference_count(&queue), engine::reference_count(&target)];
        let before = count();
        // Loading twice has the effect of loading once.
        unity.load();
        unity.load();
        assert_eq!(unity.calls("UnregisterDeviceEventCallback"), 1);
        // A device that was lost and created again; one that was reset.
        for (goes, comes) in [(1, 0), (2, 3)] {
            let scene = Scene::new();
            assert_eq!(scene.set(INTERVAL, Some(&target)), CAIRN_OK);
            scene.show(&unity);
            assert_eq!(scene.get().1, 1, "{}", scene.get().3);
            unity.device_event(goes);
            assert_eq!(state().0, CAIRN_NOT_READY);
            scene.show(&unity);
            assert_eq!(scene.get().1, 1, "there is nothing to draw with");
            unity.device_event(comes);
            unity.device_event(comes);
            assert_eq!(state().0, CAIRN_OK);
            // A view forgets its settings with the device.
            scene.show(&unity);
            assert_eq!(scene.get().1, 1);
            assert_eq!(scene.set(INTERVAL * 3 / 2, Some(&target)), CAIRN_OK);
            scene.show(&unity);
            assert_eq!(scene.get().1, 2, "{}", scene.get().3);
            assert!(is_shown(&unity, &target, scene.presenter, INTERVAL * 3 / 2));
            scene.end();
        }
        // Unloading with work in flight and a view that still exists.
        let scene = Scene::new();
        for frame in 4..8 {
            assert_eq!(scene.set(INTERVAL * frame / 4, Some(&target)), CAIRN_OK);
            scene.show(&unity);
        }
        unity.unload();
        assert_eq!((state().0, scene.get().1), (CAIRN_NOT_READY, 4));
        scene.end();
        unity.wait_ignoring_loss();
        unity.unload();
        engine::wait_for_counts(count, before);
        assert_eq!(unity.take_violations(), Vec::<String>::new());
    }
}

#[test]
fn frames_are_shown_where_the_submission_thread_is_behind() {
    for version in [6, 8] {
        let unity = UnityHandle::start(version);
        unity.load();
        unity.lag();
        let scene = Scene::new();
        let target = texture(&unity, SIZE, 1);
        let mut before: Option<Expected> = None;
        for frame in 0..4 {
            let now = INTERVAL * (4 + frame) / 4;
            assert_eq!(scene.set(now, Some(&target)), CAIRN_OK);
            scene.show(&unity);
            // At the first `show` no frame was made yet. Later ones show the frame made before.
            let (result, shown, _, message) = scene.get();
            assert_eq!((result, shown), (CAIRN_OK, frame), "v{version}: {message}");
            if let Some(before) = &before {
                assert!(before.is_in(&unity, &target), "v{version}: frame {frame}");
            }
            before = Some(Expected::at(scene.presenter, now));
        }
        assert_eq!(unity.take_violations(), [""; 0], "v{version}");
        scene.end();
    }
}

#[test]
fn a_frame_is_shown_by_a_list_of_the_plugin_s_where_unity_has_none_open() {
    let unity = UnityHandle::start(8);
    unity.load();
    let scene = Scene::new();
    let target = texture(&unity, SIZE, 1);
    for (count, has_none) in (0..).zip([false, true, true, false, true]) {
        unity.has_no_list(has_none);
        let now = INTERVAL * (4 + count) / 4;
        assert_eq!(scene.set(now, Some(&target)), CAIRN_OK);
        scene.show(&unity);
        let (result, shown, _, message) = scene.get();
        assert_eq!((result, shown), (CAIRN_OK, count + 1), "{message}");
        assert!(is_shown(&unity, &target, scene.presenter, now), "frame {count}");
    }
    assert_eq!((unity.calls("ExecuteCommandList"), unity.calls("CommandRecordingState")), (3, 5));
    assert_eq!(unity.take_violations(), [""; 0]);
    scene.end();
}

#[test]
fn compiled_pipelines_are_in_a_file_in_the_next_run() {
    let unity = UnityHandle::start(8);
    unity.load();
    // The lab's driver has no pipeline cache of its own.
    object_counts::install(&unity.device());
    let folder = std::env::temp_dir().join(format!("cairn-unity-pipelines-{}", std::process::id()));
    let path = folder.join("Cairn").join("pipelines.bin");
    let name = CString::new(path.to_str().expect("UTF-8")).expect("no NUL");
    // Each device is one run of the game: its compiled pipelines are lost with it.
    let run = || {
        Scene::with_pipelines(CAIRN_COLOUR_SRGB, name.as_ptr()).end();
        std::fs::read(&path).expect("the file")
    };
    let first = run();
    assert!(first.len() > 1024, "{} bytes", first.len());
    // The next run compiles nothing new and leaves the file alone.
    let long_ago = SystemTime::UNIX_EPOCH + Duration::from_secs(1 << 30);
    let written = || std::fs::metadata(&path).and_then(|file| file.modified()).expect("a file");
    let file = std::fs::File::options().write(true).open(&path).expect("the file");
    file.set_modified(long_ago).expect("a time");
    drop(file);
    assert!(run() == first && written() == long_ago, "it was loaded, and nothing was stored");
    // A damaged file is replaced.
    std::fs::write(&path, &first[..first.len() - 1]).expect("a damaged file");
    assert!(run() == first);
    std::fs::remove_dir_all(&folder).expect("ours");
}

/// Movie rendering, a minimised window, a device that is far behind: lists run frames after they were recorded.
#[test]
fn a_list_shows_the_frame_that_it_was_recorded_with_however_late_it_runs() {
    // Values of the frame fence that are too low by as many frames as are in flight, and one that does not grow at all.
    let too_low = [(5, 3, 2), (8, 3, 2), (8, 2, u64::MAX)];
    for (version, delay, early) in [(5, u64::MAX, 0), (6, 3, 0), (8, 3, 0), (8, u64::MAX, 0)].into_iter().chain(too_low)
    {
        let unity = UnityHandle::start(version);
        unity.load();
        let scene = Scene::new();
        unity.delay(delay);
        unity.early(early);
        let targets: Vec<_> = (0..12).map(|_| texture(&unity, SIZE, 1)).collect();
        let (mut expected, mut made, mut last) = (Vec::new(), 0, Expected::Drawn(Vec::new()));
        for (target, count) in targets.iter().zip(0_u64..) {
            let now = INTERVAL * (4 + count) / 4;
            assert_eq!(scene.set(now, Some(target)), CAIRN_OK);
            scene.show(&unity);
            let (result, shown, frame, message) = scene.get();
            assert_eq!((result, shown), (CAIRN_OK, count + 1), "v{version}, {delay}: {message}");
            // If all textures of the ring are in use, the last frame is shown again.
            if frame.since_ns.max(1) != made {
                (made, last) = (frame.since_ns.max(1), Expected::at(scene.presenter, now));
            }
            expected.push(last.clone());
        }
        let differ = expected.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(differ >= 4, "v{version}, {delay}: {differ} of the frames differ from the one before");
        unity.delay(0);
        unity.wait_ignoring_loss();
        for ((target, expected), count) in targets.iter().zip(&expected).zip(0..) {
            assert!(expected.is_in(&unity, target), "v{version}, {delay}: the list of frame {count}");
        }
        assert_eq!(unity.take_violations(), [""; 0], "v{version}, {delay}");
        scene.end();
    }
}

/// A texture's pixels as numbers, red first, without alpha.
fn numbers(bytes: &[u8], format: DXGI_FORMAT) -> Vec<f64> {
    // An unsigned float with five exponent bits, biased by 15.
    let float = |bits: u32, mantissa: u32| {
        let part = f64::from(bits & ((1 << mantissa) - 1)) / f64::from(1 << mantissa);
        match bits >> mantissa {
            0 => part * 2.0_f64.powi(-14),
            exponent => (1.0 + part) * 2.0_f64.powi(exponent as i32 - 15),
        }
    };
    let words = |pixel: &[u8]| u32::from_le_bytes(pixel[..4].try_into().expect("four bytes"));
    match format {
        DXGI_FORMAT_R16G16B16A16_FLOAT => {
            let half = |pixel: &[u8], i: usize| float(words(&[pixel[2 * i], pixel[2 * i + 1], 0, 0]), 10);
            bytes.chunks(8).flat_map(|pixel| [0, 1, 2].map(|i| half(pixel, i))).collect()
        }
        DXGI_FORMAT_R11G11B10_FLOAT => {
            let parts = |word: u32| [float(word & 2047, 6), float(word >> 11 & 2047, 6), float(word >> 22, 5)];
            bytes.chunks(4).flat_map(|pixel| parts(words(pixel))).collect()
        }
        DXGI_FORMAT_B8G8R8A8_TYPELESS => {
            bytes.chunks(4).flat_map(|pixel| [2, 1, 0].map(|i| f64::from(pixel[i]) / 255.0)).collect()
        }
        _ => bytes.chunks(4).flat_map(|pixel| [0, 1, 2].map(|i| f64::from(pixel[i]) / 255.0)).collect(),
    }
}

/// Every render-texture format that the package offers, in projects of both colour spaces.
#[test]
fn frames_go_into_floats_and_bytes_as_light_or_srgb() {
    let all = [
        DXGI_FORMAT_R16G16B16A16_FLOAT,
        DXGI_FORMAT_R11G11B10_FLOAT,
        DXGI_FORMAT_R8G8B8A8_TYPELESS,
        DXGI_FORMAT_B8G8R8A8_TYPELESS,
    ];
    for (colour_space, formats) in [(CAIRN_COLOUR_SRGB, &all[..]), (CAIRN_COLOUR_LINEAR, &all[..2])] {
        let unity = UnityHandle::start(8);
        unity.load();
        let scene = Scene::of(colour_space);
        let targets: Vec<_> =
            formats.iter().map(|format| (texture_from_picture(&unity, SIZE, 1, *format), *format)).collect();
        // An anchor and a generated frame.
        for now in [INTERVAL, INTERVAL * 5 / 4] {
            for (target, format) in &targets {
                assert_eq!(scene.set(now, Some(target)), CAIRN_OK);
                scene.show(&unity);
                let (result, _, frame, message) = scene.get();
                assert_eq!((result, frame.flags & CAIRN_FRAME_UNPREPARED), (CAIRN_OK, 0), "{format:?}: {message}");
                let expected = draw_in(scene.presenter, now, colour_space);
                let found = numbers(&pixels(&unity, target), *format);
                assert_eq!(found.len(), expected.len());
                for (found, expected) in found.iter().zip(&expected) {
                    // Half a step of the format plus one level of eight bits.
                    let step = if *format == DXGI_FORMAT_R11G11B10_FLOAT { expected / 64.0 } else { expected / 2048.0 };
                    let apart = (found - expected).abs();
                    assert!(apart <= step + 0.012, "{format:?}, {colour_space}: {found} for {expected}");
                }
            }
        }
        assert_eq!(unity.take_violations(), [""; 0], "{colour_space}");
        scene.end();
    }
}

#[test]
fn textures_that_the_queue_uses_are_released_when_it_has_finished() {
    for version in [5, 8] {
        let unity = UnityHandle::start(version);
        let (device, queue) = (unity.device(), unity.queue());
        let targets = [DXGI_FORMAT_R8G8B8A8_TYPELESS, DXGI_FORMAT_B8G8R8A8_TYPELESS]
            .map(|format| texture_from_picture(&unity, SIZE, 1, format));
        let count = || {
            let [one, other] = &targets;
            [
                engine::reference_count(&device),
                engine::reference_count(&queue),
                engine::reference_count(one),
                engine::reference_count(other),
            ]
        };
        let before = count();
        unity.load();
        let scene = Scene::new();
        assert_eq!(scene.set(INTERVAL, Some(&targets[0])), CAIRN_OK);
        scene.show(&unity);
        unity.wait_ignoring_loss();
        // One frame is in flight in each texture. With the second texture set, the first has none left.
        let gate = unity.hold();
        for (place, target) in (5..).zip(&targets) {
            assert_eq!(scene.set(INTERVAL * place / 4, Some(target)), CAIRN_OK);
            scene.show(&unity);
        }
        assert_eq!((scene.get().0, scene.get().1), (CAIRN_OK, 3), "v{version}: {}", scene.get().3);
        // SAFETY: a live handle.
        assert_eq!(unsafe { cairn_unity_view_destroy(scene.view) }, CAIRN_OK);
        assert_eq!(unity.take_violations(), [""; 0], "v{version}");
        drop(gate);
        // As many frames as may be in flight.
        (0..4).for_each(|_| unity.end_frame());
        unity.wait_ignoring_loss();
        // Ending another view finds that they have executed.
        // SAFETY: live handles and a writable view.
        unsafe {
            let other = create_handle(|to| cairn_unity_view_create(scene.device, scene.presenter, to));
            assert_eq!(cairn_unity_view_destroy(other), CAIRN_OK);
        }
        engine::wait_for_counts(|| [count()[2], count()[3]], [before[2], before[3]]);
        // The presenter holds the textures of its frames and is destroyed after them.
        // SAFETY: live handles.
        let ended = unsafe { [cairn_presenter_destroy(scene.presenter), cairn_device_destroy(scene.device)] };
        assert_eq!(ended, [CAIRN_OK; 2]);
        unity.wait_ignoring_loss();
        unity.unload();
        engine::wait_for_counts(count, before);
        assert_eq!(unity.take_violations(), [""; 0], "v{version}");
    }
}
