//! Anchors of sizes that crash AMD's libraries.

use cairn::abi::results::CAIRN_ERROR_RUNTIME_MISSING;

use super::*;

const SMALL: (u32, u32) = (37, 23);

/// Pushes a small anchor to a presenter.
fn push(presenter: *mut cairn_presenter, number: u64) {
    let picture = common::picture(SMALL.0, SMALL.1, 1 + number as u32);
    let mut given: cairn_picture = prepared(|picture: &mut cairn_picture| &mut picture.struct_size);
    (given.width, given.height) = SMALL;
    (given.pixels, given.size) = (picture.rgba().as_ptr().cast(), picture.rgba().len() as u64);
    // SAFETY: a picture that lives during the call, and a variable for the handle.
    let anchor = made(|to| unsafe { cairn_anchor_create(&given, number, 0, to) });
    // SAFETY: live handles.
    let pushed = unsafe { cairn_presenter_push(presenter, anchor, std::ptr::null(), number * INTERVAL) };
    // SAFETY: a live handle.
    assert_eq!([pushed, unsafe { cairn_anchor_destroy(anchor) }], [CAIRN_OK; 2]);
}

#[test]
fn anchors_that_are_too_small_for_amd_s_libraries_are_the_shaders() {
    let engine = engine::engine();
    let direct = device(&engine, &engine.direct);
    let rest = [D3D12_RESOURCE_STATE_COMMON; 2];
    for (fsr, expected) in [(CAIRN_PREFER_AUTO, CAIRN_OK), (CAIRN_PREFER_REQUIRE, CAIRN_ERROR_UNSUPPORTED)] {
        let mut options: cairn_presenter_options = prepared(|o: &mut cairn_presenter_options| &mut o.struct_size);
        (options.multiplier, options.interval_ns, options.fsr) = (4, INTERVAL, fsr);
        // SAFETY: options of their size and a variable for the handle.
        let presenter = made(|to| unsafe { cairn_presenter_create(&options, to) });
        (0..2).for_each(|number| push(presenter, number));
        let texture = Wanted { size: SMALL, ..Wanted::default() }.make(&engine.device);
        let recording = Recording::on(&engine.device, &engine.direct);
        let now = INTERVAL * 3 / 2;
        let call = Call { presenter, device: direct, now, recording: &recording, target: &texture, states: rest };
        let wanted: cairn_d3d12_preparation = prepared(|p: &mut cairn_d3d12_preparation| &mut p.struct_size);
        // SAFETY: live handles, and a struct that lives during the call.
        let result = unsafe { cairn_presenter_prepare_d3d12(presenter, direct, &wanted) };
        if !amd::makes_half_way(SIZE) && fsr == CAIRN_PREFER_REQUIRE {
            assert_eq!(result, CAIRN_ERROR_RUNTIME_MISSING, "there are none");
        } else {
            assert_eq!(result, expected);
        }
        if result == CAIRN_OK {
            let (recorded, frame) = call.record();
            assert_eq!((recorded, frame.source, frame.t), (CAIRN_OK, CAIRN_FRAME_GENERATED, 0.5));
            recording.submit(&engine.direct);
            let pixels = textures::read(&engine.device, &engine.direct, &texture, rest[0]);
            let memory = drawn_in(presenter, now, SMALL);
            assert!(pixels.iter().zip(memory.rgba()).all(|(a, b)| a.abs_diff(*b) <= 1), "what is drawn into memory");
            let (name, why) = generator(presenter);
            let reason =
                if amd::makes_half_way(SIZE) { "37 x 23 pixels: a side is too short" } else { "were not found" };
            assert!(name == "shader" && why.contains(reason), "{name}: {why}");
        }
        end([presenter], []);
    }
    end([], [direct]);
}
