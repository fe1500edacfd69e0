//! Frames in an engine's textures, by its own command lists. On Windows, or in the lab.
#![cfg(windows)]

use std::ptr::null_mut;

use cairn::Picture;
use cairn::abi::anchor::{cairn_anchor, cairn_anchor_create, cairn_anchor_destroy};
use cairn::abi::d3d12::{
    cairn_d3d12_preparation, cairn_d3d12_recording, cairn_device_create_d3d12, cairn_presenter_prepare_d3d12,
    cairn_presenter_record_d3d12, cairn_presenter_release_d3d12, cairn_presenter_submit_d3d12,
};
use cairn::abi::device::{cairn_device, cairn_device_destroy, cairn_device_get_info, cairn_device_info};
use cairn::abi::images::{cairn_picture, cairn_target};
use cairn::abi::presenter::*;
use cairn::abi::results::{
    CAIRN_ERROR_DEVICE_REMOVED, CAIRN_ERROR_INVALID_ARGUMENT, CAIRN_ERROR_STRUCT_SIZE, CAIRN_ERROR_UNSUPPORTED,
    CAIRN_NOT_READY, CAIRN_OK, CAIRN_QUEUE_FULL, cairn_result,
};
use cairn::abi::statistics::{cairn_presenter_get_statistics, cairn_presenter_statistics};
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::core::Interface;
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::d3d12::amd;
use test_support::d3d12::engine::{self, Engine};
use test_support::d3d12::textures::{self, Recording, TextureDesc};
use test_support::worlds;

mod lists;
mod small_anchors;

/// Frames' size; a row is not a multiple of the copy alignment, and AMD's libraries accept the size.
const SIZE: (u32, u32) = (101, 67);
/// Nanoseconds between anchors.
const INTERVAL: u64 = 100_000_000;

fn device(engine: &Engine, queue: &ID3D12CommandQueue) -> *mut cairn_device {
    amd::allow_double();
    let (device, queue) = (engine.device.as_raw().cast(), queue.as_raw().cast());
    // SAFETY: live objects, options of their size and a variable for the handle.
    create_handle(|to| unsafe { cairn_device_create_d3d12(device, queue, null_mut(), &tool_device_options(), to) })
}

fn anchor(number: u64, kind: u32) -> *mut cairn_anchor {
    let picture = worlds::picture(SIZE.0, SIZE.1, kind);
    let mut given: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
    (given.width, given.height) = SIZE;
    (given.pixels, given.size) = (picture.rgba().as_ptr().cast(), picture.rgba().len() as u64);
    // SAFETY: a picture that lives during the call, and a variable for the handle.
    create_handle(|to| unsafe { cairn_anchor_create(&given, number, 0, to) })
}

/// A presenter of two anchors, four frames per anchor.
fn presenter(colour_space: u32, shader: u32) -> *mut cairn_presenter {
    let mut options: cairn_presenter_options = with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
    (options.multiplier, options.interval_ns) = (4, INTERVAL);
    (options.colour_space, options.shader) = (colour_space, shader);
    // SAFETY: options of their size and a variable for the handle.
    let presenter = create_handle(|to| unsafe { cairn_presenter_create(&options, to) });
    (0..2).for_each(|number| push(presenter, number, number * INTERVAL));
    presenter
}

fn push(presenter: *mut cairn_presenter, number: u64, now: u64) {
    let anchor = anchor(number, 1 + number as u32 % 7);
    // SAFETY: live handles.
    let pushed = unsafe { cairn_presenter_push(presenter, anchor, std::ptr::null(), now) };
    // SAFETY: a live handle.
    assert_eq!([pushed, unsafe { cairn_anchor_destroy(anchor) }], [CAIRN_OK; 2]);
}

/// Prepares a presenter for frames on a device, with up to `lists` lists that are recorded but have not run.
fn prepare(presenter: *mut cairn_presenter, device: *mut cairn_device, lists: u32) {
    let mut wanted: cairn_d3d12_preparation = with_struct_size(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
    wanted.lists = lists;
    // SAFETY: live handles, and a struct of its size.
    assert_eq!(unsafe { cairn_presenter_prepare_d3d12(presenter, device, &wanted) }, CAIRN_OK);
}

/// Destroys a test's presenters and devices.
fn destroy<const P: usize, const D: usize>(presenters: [*mut cairn_presenter; P], devices: [*mut cairn_device; D]) {
    // SAFETY: live handles; lists recorded by presenters have run or never will.
    let ended = presenters.map(|presenter| unsafe { cairn_presenter_destroy(presenter) });
    assert_eq!(ended, [CAIRN_OK; P]);
    // SAFETY: live handles.
    assert_eq!(devices.map(|device| unsafe { cairn_device_destroy(device) }), [CAIRN_OK; D]);
}

/// The frame at `now`, drawn into memory by the processor.
fn draw(presenter: *mut cairn_presenter, now: u64) -> Picture {
    draw_at_size(presenter, now, SIZE)
}

/// As [`draw`], for frames of another size.
fn draw_at_size(presenter: *mut cairn_presenter, now: u64, size: (u32, u32)) -> Picture {
    let mut picture = Picture::new(size.0, size.1).expect("a picture");
    let mut target: cairn_target = with_struct_size(|target: &mut cairn_target| &mut target.struct_size);
    (target.width, target.height) = size;
    (target.pixels, target.size) = (picture.rgba_mut().as_mut_ptr().cast(), picture.rgba().len() as u64);
    // SAFETY: a live handle and a target that lives during the call.
    assert_eq!(unsafe { cairn_presenter_draw(presenter, now, &target, null_mut()) }, CAIRN_OK);
    picture
}

/// The presenter's statistics.
fn statistics(presenter: *mut cairn_presenter) -> cairn_presenter_statistics {
    let mut done: cairn_presenter_statistics =
        with_struct_size(|done: &mut cairn_presenter_statistics| &mut done.struct_size);
    // SAFETY: a live handle, and a variable for the figures.
    assert_eq!(unsafe { cairn_presenter_get_statistics(presenter, &mut done) }, CAIRN_OK);
    done
}

/// The name of the last frame's generator, and the reason why a preferred one was not used.
fn generator(presenter: *mut cairn_presenter) -> (String, String) {
    let done = statistics(presenter);
    let text = |text: &[std::ffi::c_char]| {
        let bytes: Vec<u8> = text.iter().take_while(|c| **c != 0).map(|c| c.cast_unsigned()).collect();
        String::from_utf8(bytes).expect("text")
    };
    (text(&done.generator), text(&done.preference))
}

/// Arguments of [`cairn_presenter_record_d3d12`].
struct Call<'a> {
    presenter: *mut cairn_presenter,
    device: *mut cairn_device,
    now: u64,
    recording: &'a Recording,
    target: &'a ID3D12Resource,
    states: [D3D12_RESOURCE_STATES; 2],
}

impl Call<'_> {
    fn record(&self) -> (cairn_result, cairn_frame) {
        let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
        let mut recording: cairn_d3d12_recording = with_struct_size(|r: &mut cairn_d3d12_recording| &mut r.struct_size);
        [recording.state_before, recording.state_after] = self.states.map(|state| state.0.cast_unsigned());
        recording.list = self.recording.list().as_raw().cast();
        recording.target = self.target.as_raw().cast();
        (recording.fence, recording.fence_value) = (self.recording.fence().as_raw().cast(), 1);
        (self.record_as(&recording, &mut frame), frame)
    }

    /// Records the frame with a given recording struct.
    fn record_as(&self, recording: &cairn_d3d12_recording, frame: &mut cairn_frame) -> cairn_result {
        let Self { presenter, device, now, .. } = *self;
        // SAFETY: live handles and objects, and a variable for the frame.
        unsafe { cairn_presenter_record_d3d12(presenter, device, now, recording, frame) }
    }

    /// Submits the frame into another target, in a list of the presenter's own.
    fn submit(&self, target: &ID3D12Resource) -> (cairn_result, cairn_frame, Option<(ID3D12Fence, u64)>) {
        let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
        let [before, after] = self.states.map(|state| state.0.cast_unsigned());
        let (target, mut fence, mut value) = (target.as_raw().cast(), null_mut(), 0);
        let (presenter, device, now) = (self.presenter, self.device, self.now);
        // SAFETY: live handles and objects, and variables for the results.
        let result = unsafe {
            cairn_presenter_submit_d3d12(
                presenter, device, now, target, before, after, &mut frame, &mut fence, &mut value,
            )
        };
        // SAFETY: a fence that is not null comes with a reference for us.
        let fence = (!fence.is_null()).then(|| unsafe { ID3D12Fence::from_raw(fence.cast()) });
        (result, frame, fence.map(|fence| (fence, value)))
    }
}

/// A frame's pixels in the format's layout, as Direct3D's documentation defines it.
fn expected(picture: &Picture, format: DXGI_FORMAT, linear: bool) -> Vec<u8> {
    let unit = |level: u8| f64::from(level) / 255.0;
    let colour = |level: u8| match unit(level) {
        v if !linear => v,
        v if v <= 0.04045 => v / 12.92,
        v => ((v + 0.055) / 1.055).powf(2.4),
    };
    let pixels = picture.rgba().as_chunks::<4>().0.iter();
    match format {
        DXGI_FORMAT_B8G8R8A8_UNORM => pixels.flat_map(|&[r, g, b, a]| [b, g, r, a]).collect(),
        DXGI_FORMAT_R10G10B10A2_UNORM => {
            let level = |v: u8, top: f64| (unit(v) * top).round() as u32;
            let word = |&[r, g, b, a]: &[u8; 4]| {
                level(r, 1023.0) | level(g, 1023.0) << 10 | level(b, 1023.0) << 20 | level(a, 3.0) << 30
            };
            pixels.flat_map(|pixel| word(pixel).to_le_bytes()).collect()
        }
        DXGI_FORMAT_R16G16B16A16_FLOAT => pixels
            .flat_map(|&[r, g, b, a]| [colour(r), colour(g), colour(b), unit(a)])
            .flat_map(|v| half::f16::from_f64(v).to_le_bytes())
            .collect(),
        _ => picture.rgba().to_vec(),
    }
}

#[test]
fn frames_of_the_processor_are_recorded_into_targets_of_every_format_and_state() {
    let engine = Engine::create();
    let (direct, compute) = (device(&engine, &engine.direct), device(&engine, &engine.compute));
    let (rendered, written) = (D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET, D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS);
    let (present, plain) = (D3D12_RESOURCE_STATE_PRESENT, D3D12_RESOURCE_FLAG_NONE);
    let (target, copied) = (D3D12_RESOURCE_STATE_RENDER_TARGET, D3D12_RESOURCE_STATE_COPY_DEST);
    let (shader, access) = (D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE, D3D12_RESOURCE_STATE_UNORDERED_ACCESS);
    for (kind, format, flags, states, linear) in [
        // Targets of a swap chain, which no shader may write, and one that the engine has drawn into.
        (direct, DXGI_FORMAT_R8G8B8A8_UNORM, rendered, [present, present], false),
        (direct, DXGI_FORMAT_B8G8R8A8_UNORM, rendered, [target, present], false),
        (direct, DXGI_FORMAT_R8G8B8A8_UNORM_SRGB, rendered, [present, target], false),
        (direct, DXGI_FORMAT_R10G10B10A2_UNORM, plain, [shader, copied], false),
        (direct, DXGI_FORMAT_R16G16B16A16_FLOAT, rendered, [target, target], false),
        (compute, DXGI_FORMAT_R16G16B16A16_FLOAT, written, [present, shader], true),
        (compute, DXGI_FORMAT_R8G8B8A8_TYPELESS, written, [access, access], false),
    ] {
        let queue = if kind == direct { &engine.direct } else { &engine.compute };
        let colours = if linear { CAIRN_COLOUR_LINEAR } else { CAIRN_COLOUR_SRGB };
        let presenter = presenter(colours, CAIRN_PREFER_NEVER);
        let texture = TextureDesc { size: SIZE, format, flags, state: states[0], ..TextureDesc::default() }
            .create(&engine.device);
        prepare(presenter, kind, 5);
        let frames = [
            (INTERVAL, CAIRN_FRAME_ANCHOR),
            (INTERVAL * 5 / 4, CAIRN_FRAME_GENERATED),
            (INTERVAL * 3 / 2, CAIRN_FRAME_GENERATED),
            (INTERVAL * 2, CAIRN_FRAME_ANCHOR),
            (INTERVAL * 9 / 4, CAIRN_FRAME_EXTRAPOLATED),
        ];
        let mut kept = Vec::new();
        for (i, (now, source)) in frames.into_iter().enumerate() {
            let recording = Recording::on(&engine.device, queue);
            if i > 0 {
                recording.barrier(&texture, states[1], states[0]);
            }
            let call = Call { presenter, device: kind, now, recording: &recording, target: &texture, states };
            let (result, frame) = call.record();
            assert_eq!((result, frame.source), (CAIRN_OK, source), "{format:?}: {frame:?}");
            // An anchor that came at 0 is due one interval later, and so on.
            let first = frame.since_ns / INTERVAL - 1;
            assert_eq!((frame.previous, frame.since_ns), (first, now), "one interval of latency: {frame:?}");
            recording.submit(queue);
            kept.push(recording);
        }
        let pixels = textures::read(&engine.device, queue, &texture, states[1]);
        let (name, why) = generator(presenter);
        assert!(name == "cpu" && why.contains("not to be used"), "{name}: {why}");
        let memory = draw(self::presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_NEVER), INTERVAL * 9 / 4);
        assert!(pixels == expected(&memory, format, linear), "{format:?}: the frame in memory");
        destroy([presenter], []);
    }
    destroy([], [direct, compute]);
}

/// Frames that are drawn into memory, or for another queue, do not make the last picture of a texture's upload memory the current one.
#[test]
fn a_frame_that_was_also_drawn_into_memory_is_recorded_with_its_own_pixels() {
    let engine = Engine::create();
    let (direct, compute) = (device(&engine, &engine.direct), device(&engine, &engine.compute));
    let rest = [D3D12_RESOURCE_STATE_COMMON; 2];
    let texture = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&engine.device);
    let presenter = presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_NEVER);
    prepare(presenter, direct, 0);
    let record = |device, queue, now| {
        let recording = Recording::on(&engine.device, queue);
        let call = Call { presenter, device, now, recording: &recording, target: &texture, states: rest };
        let (result, frame) = call.record();
        assert_eq!(result, CAIRN_OK);
        recording.submit(queue);
        (frame, textures::read(&engine.device, queue, &texture, rest[0]))
    };
    let (first, second) = (INTERVAL, INTERVAL * 5 / 4);
    let (_, anchor) = record(direct, &engine.direct, first);
    let drawn = draw(presenter, second);
    let (frame, pixels) = record(direct, &engine.direct, second);
    assert_eq!(frame.flags & CAIRN_FRAME_REPEATED, CAIRN_FRAME_REPEATED, "the picture is not made again");
    assert!(pixels == drawn.rgba() && pixels != anchor, "the frame that is due");
    // The same with a picture for a queue that is not prepared, between two for the one that is.
    let (_, unprepared) = record(compute, &engine.compute, INTERVAL * 2);
    let (_, prepared) = record(direct, &engine.direct, INTERVAL * 2);
    assert!(unprepared == prepared && prepared != pixels);
    destroy([presenter], [direct, compute]);
}

#[test]
fn a_device_reports_its_memory_budget() {
    let engine = Engine::create();
    let direct = device(&engine, &engine.direct);
    let mut info: cairn_device_info = with_struct_size(|info: &mut cairn_device_info| &mut info.struct_size);
    // SAFETY: a live handle, and a variable for the result.
    assert_eq!(unsafe { cairn_device_get_info(direct, &mut info) }, CAIRN_OK);
    let budget = Gpu::of_engine(&engine.device, &engine.direct, None).expect("a device").budget().expect("DXGI");
    match budget {
        // Other processes may use some in the meantime.
        Some(budget) => assert!(info.memory_budget_mib > 0 && budget.granted >> 20 > 0, "{budget:?}"),
        None => assert_eq!((info.memory_budget_mib, info.memory_used_mib), (0, 0)),
    }
    destroy([], [direct]);
}

#[test]
fn shaders_generate_frames_unless_they_are_disabled() {
    let engine = Engine::create();
    let direct = device(&engine, &engine.direct);
    let required = presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_REQUIRE);
    let rest = [D3D12_RESOURCE_STATE_COMMON; 2];
    let texture = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&engine.device);
    let half_way_generator = amd::generator_name(SIZE, &engine.device);
    for (preference, name) in [(CAIRN_PREFER_AUTO, &*half_way_generator), (CAIRN_PREFER_NEVER, "cpu")] {
        let presenter = presenter(CAIRN_COLOUR_SRGB, preference);
        let now = INTERVAL * 3 / 2;
        prepare(presenter, direct, 0);
        let memory = draw(presenter, now);
        assert_eq!(generator(presenter).0, "cpu", "frames in memory come from the processor");
        let recording = Recording::on(&engine.device, &engine.direct);
        let call = Call { presenter, device: direct, now, recording: &recording, target: &texture, states: rest };
        assert_eq!(call.record().0, CAIRN_OK);
        recording.submit(&engine.direct);
        assert_eq!(generator(presenter).0, name);
        // In a list of the presenter's own, after the previous one.
        let own = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&engine.device);
        let (result, frame, fence) = call.submit(&own);
        assert_eq!((result, frame.source, frame.t), (CAIRN_OK, CAIRN_FRAME_GENERATED, 0.5));
        let (fence, value) = fence.expect("a fence");
        // SAFETY: a live fence.
        while unsafe { fence.GetCompletedValue() } < value {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        for texture in [&texture, &own] {
            let pixels = textures::read(&engine.device, &engine.direct, texture, rest[0]);
            let is_same = pixels.iter().zip(memory.rgba()).all(|(a, b)| a.abs_diff(*b) <= 1);
            let is_from_amd = !["shader", "cpu"].contains(&name) && amd::has_detail(&pixels);
            assert!(is_same || is_from_amd, "{name}: within a level of the frame in memory");
        }
        let done = statistics(presenter);
        assert_eq!((done.anchors, done.waiting, done.under_way, done.shown_generated), (2, 1, 0, 3), "{name}");
        // A frame from the processor took no time on the device; the shaders' second frame was a repetition of the first. Only shaders have a
        // list with the work that all frames of a pair share.
        let (frames, lists) = match name {
            "cpu" => (0, 0),
            "shader" => (2, 4),
            _ => (2, 3),
        };
        assert_eq!((done.device_frames, done.device_lists), (frames, lists), "{name}");
        assert_eq!(done.device_frames_ns > 0, frames > 0);
        assert!(
            done.device_frame_longest_ns <= done.device_frames_ns
                && done.device_list_longest_ns <= done.device_lists_ns
        );
        // The presenter holds a target until it is released, and not afterwards.
        drop((recording, fence));
        let alone = engine::reference_count(&own);
        // SAFETY: a live handle.
        assert_eq!(unsafe { cairn_presenter_release_d3d12(presenter) }, CAIRN_OK);
        let held = u32::from(name != "cpu");
        engine::wait_for_counts(|| [engine::reference_count(&own)], [alone - held]);
        destroy([presenter], []);
    }
    // Linear light, which the processor computes from the same values; a level near white is more than two levels of linear light.
    let bright = presenter(CAIRN_COLOUR_LINEAR, CAIRN_PREFER_AUTO);
    prepare(bright, direct, 0);
    let now = INTERVAL * 5 / 4;
    let halves = DXGI_FORMAT_R16G16B16A16_FLOAT;
    let texture = TextureDesc { size: SIZE, format: halves, ..TextureDesc::default() }.create(&engine.device);
    let recording = Recording::on(&engine.device, &engine.direct);
    let call = Call { presenter: bright, device: direct, now, recording: &recording, target: &texture, states: rest };
    assert_eq!(call.record().0, CAIRN_OK);
    recording.submit(&engine.direct);
    assert_eq!(generator(bright).0, "shader");
    let found = textures::read(&engine.device, &engine.direct, &texture, rest[0]);
    let shown = draw(presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_NEVER), now);
    let number = |bytes: &[u8; 2]| half::f16::from_le_bytes(*bytes).to_f32();
    let wanted = expected(&shown, halves, true);
    let pairs = found.as_chunks::<2>().0.iter().zip(wanted.as_chunks::<2>().0);
    let apart = pairs.map(|(a, b)| (number(a) - number(b)).abs()).fold(0.0, f32::max);
    assert!(found.len() == wanted.len() && apart <= 2.4 / 255.0, "{apart}");
    destroy([bright], []);

    // Required shaders cannot draw into memory.
    let mut pixels = vec![0_u8; (4 * SIZE.0 * SIZE.1) as usize];
    let mut target: cairn_target = with_struct_size(|target: &mut cairn_target| &mut target.struct_size);
    (target.width, target.height) = SIZE;
    (target.pixels, target.size) = (pixels.as_mut_ptr().cast(), pixels.len() as u64);
    // SAFETY: a live handle and a target that lives during the call.
    let refused = unsafe { cairn_presenter_draw(required, INTERVAL, &target, null_mut()) };
    assert_eq!(refused, CAIRN_ERROR_UNSUPPORTED);
    destroy([required], [direct]);
}

#[test]
fn frames_continue_after_resizing_minimising_and_late_anchors() {
    let engine = Engine::create();
    let direct = device(&engine, &engine.direct);
    let presenter = presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_AUTO);
    let (flags, states) = (D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET, [D3D12_RESOURCE_STATE_PRESENT; 2]);
    let half_way_generator = amd::generator_name(SIZE, &engine.device);
    let target = |size, format| TextureDesc { size, format, flags, ..TextureDesc::default() }.create(&engine.device);
    // A window's border is dragged: the swap chain is resized again and again, with another size and format each time, and an engine
    // may drop a list then.
    let formats = [DXGI_FORMAT_R8G8B8A8_UNORM, DXGI_FORMAT_B8G8R8A8_UNORM, DXGI_FORMAT_R16G16B16A16_FLOAT];
    let mut kept = Vec::new();
    for i in 0..24_u32 {
        let size = if i % 4 == 3 { SIZE } else { (1 + i * 37 % 90, 1 + i * 53 % 70) };
        // SAFETY: a live handle.
        assert_eq!(unsafe { cairn_presenter_resize(presenter, size.0, size.1) }, CAIRN_OK);
        prepare(presenter, direct, 0);
        let texture = target(size, formats[i as usize % 3]);
        let recording = Recording::on(&engine.device, &engine.direct);
        let now = INTERVAL + u64::from(i) * INTERVAL / 24;
        let call = Call { presenter, device: direct, now, recording: &recording, target: &texture, states };
        assert_eq!(call.record().0, CAIRN_OK, "{size:?}");
        // Positions are quarters: an anchor (whose generator is still the half way frame's), one quarter, the half, and another quarter.
        let is_half = (12..18).contains(&i);
        let name = if i < 6 || is_half { &*half_way_generator } else { "shader" };
        assert_eq!(generator(presenter).0, name, "{size:?}");
        if i % 5 != 2 {
            recording.submit(&engine.direct);
        }
        // SAFETY: a live handle.
        assert_eq!(unsafe { cairn_presenter_release_d3d12(presenter) }, CAIRN_OK);
        assert_eq!(engine::reference_count(&texture), 1, "a swap chain can be resized: nothing else holds its buffer");
        if i % 5 != 2 && i % 3 == 0 {
            let pixels = textures::read(&engine.device, &engine.direct, &texture, states[1]);
            let memory = draw_at_size(presenter, now, size);
            let apart = pixels.iter().zip(memory.rgba()).map(|(a, b)| a.abs_diff(*b)).max();
            let is_from_amd = name != "shader" && is_half && amd::has_detail(&pixels);
            assert!(apart <= Some(1) || is_from_amd, "{size:?}: {apart:?} levels from the frame in memory");
        }
        kept.push((recording, texture));
    }
    // SAFETY: a live handle.
    assert_eq!(unsafe { cairn_presenter_resize(presenter, 0, 0) }, CAIRN_OK);
    prepare(presenter, direct, 0);
    let frame_at = |presenter, now| {
        let texture = target(SIZE, formats[0]);
        let recording = Recording::on(&engine.device, &engine.direct);
        let call = Call { presenter, device: direct, now, recording: &recording, target: &texture, states };
        let (result, frame) = call.record();
        assert_eq!(result, CAIRN_OK);
        recording.submit(&engine.direct);
        (frame, textures::read(&engine.device, &engine.direct, &texture, states[1]))
    };
    // Minimised: anchors arrive, and no frame is drawn. Then the frame that is due is shown, one interval after its anchors came.
    (2..30).for_each(|number| push(presenter, number, number * INTERVAL));
    let now = 29 * INTERVAL + INTERVAL / 2;
    let (frame, pixels) = frame_at(presenter, now);
    assert_eq!((frame.source, frame.previous, frame.t, frame.since_ns), (CAIRN_FRAME_GENERATED, 28, 0.5, now));
    assert_eq!(generator(presenter).0, half_way_generator);
    let memory = draw(presenter, now);
    let is_same = pixels.iter().zip(memory.rgba()).all(|(a, b)| a.abs_diff(*b) <= 1);
    assert!(is_same || (half_way_generator != "shader" && amd::has_detail(&pixels)), "the frame in memory");
    // No anchor arrives: motion is extrapolated for an interval and then held, or held at once; no call waits.
    for quarter in 0..12 {
        let (frame, _) = frame_at(presenter, 30 * INTERVAL + quarter * INTERVAL / 4);
        let source = match quarter {
            0 => CAIRN_FRAME_ANCHOR,
            1..=3 => CAIRN_FRAME_EXTRAPOLATED,
            _ => frame.source,
        };
        assert_eq!((frame.source, frame.previous), (source, 29), "{frame:?}");
        let stands = (CAIRN_FRAME_HELD, CAIRN_FRAME_REPEATED);
        assert!(quarter < 6 || (frame.source, frame.flags) == stands, "{frame:?}");
    }
    let mut options: cairn_presenter_options = with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
    (options.multiplier, options.interval_ns, options.flags) = (4, INTERVAL, CAIRN_PRESENTER_HOLD_LATE);
    // SAFETY: options of their size and a variable for the handle.
    let holding = create_handle(|to| unsafe { cairn_presenter_create(&options, to) });
    (0..2).for_each(|number| push(holding, number, number * INTERVAL));
    prepare(holding, direct, 0);
    let (anchor, shown) = frame_at(holding, 2 * INTERVAL);
    let (late, held) = frame_at(holding, 2 * INTERVAL + INTERVAL / 2);
    assert_eq!((anchor.source, late.source), (CAIRN_FRAME_ANCHOR, CAIRN_FRAME_HELD));
    assert!(shown == held, "the last anchor");
    // The late anchor arrives, and is due when it arrives.
    push(presenter, 30, 33 * INTERVAL);
    let (frame, _) = frame_at(presenter, 33 * INTERVAL);
    assert_eq!((frame.source, frame.previous), (CAIRN_FRAME_ANCHOR, 30), "{frame:?}");
    drop(kept);
    destroy([presenter, holding], [direct]);
}

#[test]
fn a_device_time_budget_limits_generated_frames() {
    let engine = Engine::create();
    let direct = device(&engine, &engine.direct);
    let presenter = presenter(CAIRN_COLOUR_SRGB, CAIRN_PREFER_AUTO);
    let texture = TextureDesc { size: SIZE, ..TextureDesc::default() }.create(&engine.device);
    prepare(presenter, direct, 0);
    let states = [D3D12_RESOURCE_STATE_COMMON; 2];
    let mut at = 4;
    // Draws `count` frames from `at` on, a quarter of an interval apart; returns their sources.
    let mut frames = |count: u64| -> Vec<u32> {
        let one = |_| {
            if at % 4 == 0 && at > 4 {
                push(presenter, at / 4, at * INTERVAL / 4);
            }
            let recording = Recording::on(&engine.device, &engine.direct);
            let now = at * INTERVAL / 4;
            let call = Call { presenter, device: direct, now, recording: &recording, target: &texture, states };
            let (result, frame) = call.record();
            assert_eq!(result, CAIRN_OK);
            recording.submit(&engine.direct);
            textures::wait(&engine.device, &engine.direct);
            at += 1;
            frame.source
        };
        (0..count).map(one).collect()
    };
    let (anchor, generated) = (CAIRN_FRAME_ANCHOR, CAIRN_FRAME_GENERATED);
    // An hour suffices for all of them, a nanosecond for none.
    // SAFETY: a live handle.
    assert_eq!(unsafe { cairn_presenter_set_budget(presenter, 3_600_000_000_000) }, CAIRN_OK);
    assert_eq!(frames(16), [anchor, generated, generated, generated].repeat(4));
    assert_eq!((statistics(presenter).made_to_anchor, statistics(presenter).budget_changes), (4, 0));
    // SAFETY: a live handle.
    assert_eq!(unsafe { cairn_presenter_set_budget(presenter, 1) }, CAIRN_OK);
    frames(32);
    assert_eq!((statistics(presenter).made_to_anchor, statistics(presenter).budget_changes), (1, 2));
    let held = CAIRN_FRAME_HELD;
    assert_eq!(frames(8), [anchor, held, held, held].repeat(2), "only anchors");
    // SAFETY: a live handle.
    assert_eq!(unsafe { cairn_presenter_set_budget(presenter, 0) }, CAIRN_OK);
    assert_eq!(frames(4), [anchor, generated, generated, generated]);
    destroy([presenter], [direct]);
}
