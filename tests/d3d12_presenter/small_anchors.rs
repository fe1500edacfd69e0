//! Anchors that are too small for AMD's libraries, which crash on them.

use cairn::abi::results::CAIRN_ERROR_RUNTIME_MISSING;

use super::*;

const SMALL: (u32, u32) = (37, 23);

/// Pushes a small anchor to a presenter.
fn push(presenter: *mut cairn_presenter, number: u64) {
    let picture = worlds::picture(SMALL.0, SMALL.1, 1 + number as u32);
    let mut given: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
    (given.width, given.height) = SMALL;
    (given.pixels, given.size) = (picture.rgba().as_ptr().cast(), picture.rgba().len() as u64);
    // SAFETY: a picture that lives during the call, and a variable for the handle.
    let anchor = create_handle(|to| unsafe { cairn_anchor_create(&given, number, 0, to) });
    // SAFETY: live handles.
    let pushed = unsafe { cairn_presenter_push(presenter, anchor, std::ptr::null(), number * INTERVAL) };
    // SAFETY: a live handle.
    assert_eq!([pushed, unsafe { cairn_anchor_destroy(anchor) }], [CAIRN_OK; 2]);
}

#[test]
fn shaders_generate_frames_too_small_for_amds_libraries() {
    let engine = Engine::create();
    let direct = device(&engine, &engine.direct);
    let rest = [D3D12_RESOURCE_STATE_COMMON; 2];
    for (fsr, expected) in [(CAIRN_PREFER_AUTO, CAIRN_OK), (CAIRN_PREFER_REQUIRE, CAIRN_ERROR_UNSUPPORTED)] {
        let mut options: cairn_presenter_options =
            with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
        (options.multiplier, options.interval_ns, options.fsr) = (4, INTERVAL, fsr);
        // SAFETY: options of their size and a variable for the handle.
        let presenter = create_handle(|to| unsafe { cairn_presenter_create(&options, to) });
        (0..2).for_each(|number| push(presenter, number));
        let texture = TextureDesc { size: SMALL, ..TextureDesc::default() }.create(&engine.device);
        let recording = Recording::on(&engine.device, &engine.direct);
        let now = INTERVAL * 3 / 2;
        let call = Call { presenter, device: direct, now, recording: &recording, target: &texture, states: rest };
        let wanted: cairn_d3d12_preparation = with_struct_size(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
        // SAFETY: live handles, and a struct that lives during the call.
        let result = unsafe { cairn_presenter_prepare_d3d12(presenter, direct, &wanted) };
        if !amd::generates_frames(SIZE) && fsr == CAIRN_PREFER_REQUIRE {
            assert_eq!(result, CAIRN_ERROR_RUNTIME_MISSING, "AMD's libraries are missing");
        } else {
            assert_eq!(result, expected);
        }
        if result == CAIRN_OK {
            let (recorded, frame) = call.record();
            assert_eq!((recorded, frame.source, frame.t), (CAIRN_OK, CAIRN_FRAME_GENERATED, 0.5));
            recording.submit(&engine.direct);
            let pixels = textures::read(&engine.device, &engine.direct, &texture, rest[0]);
            let memory = draw_at_size(presenter, now, SMALL);
            assert!(pixels.iter().zip(memory.rgba()).all(|(a, b)| a.abs_diff(*b) <= 1), "the frame in memory");
            let (name, why) = generator(presenter);
            let reason =
                if amd::generates_frames(SIZE) { "37 x 23 pixels: a side is too short" } else { "were not found" };
            assert!(name == "shader" && why.contains(reason), "{name}: {why}");
        }
        destroy([presenter], []);
    }
    destroy([], [direct]);
}
