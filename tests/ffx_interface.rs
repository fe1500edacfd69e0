//! The report of what AMD's libraries need, as a host in C asks for it. On Windows, or in the lab.
#![cfg(windows)]

use std::ffi::CStr;

use cairn::abi::device::CAIRN_DEVICE_D3D12;
use cairn::abi::requirements::*;
use cairn::abi::results::CAIRN_OK;
use cairn::ffx::Part;

#[path = "ffx/stage.rs"]
#[allow(dead_code, reason = "each test program uses its part")]
mod stage;
use stage::{ANALYTIC, Stage};

/// All rows, as a host gets them.
fn rows() -> Vec<cairn_requirement> {
    // SAFETY: structs of the interface are plain data, for which zero is a value.
    let mut rows: [cairn_requirement; 32] = unsafe { std::mem::zeroed() };
    let stride = size_of::<cairn_requirement>();
    rows.iter_mut().for_each(|row| row.struct_size = stride as u32);
    let mut count = 0;
    // SAFETY: an array of that stride and length, and a place for the count.
    let result = unsafe {
        cairn_device_requirements(CAIRN_DEVICE_D3D12, std::ptr::null(), rows.as_mut_ptr(), stride, 32, &mut count)
    };
    assert_eq!(result, CAIRN_OK);
    rows[..count as usize].to_vec()
}

fn text(characters: &[std::ffi::c_char]) -> String {
    // SAFETY: the library ends its texts with a NUL.
    unsafe { CStr::from_ptr(characters.as_ptr()) }.to_string_lossy().into_owned()
}

#[test]
fn a_host_learns_which_of_amd_s_libraries_are_there_and_what_they_lack() {
    let stage = Stage::empty().with(Part::FrameGeneration, &["sdk 2.1", ANALYTIC]);
    // SAFETY: this program has one test, and no other thread reads the environment now.
    unsafe { std::env::set_var("CAIRN_FFX_DIR", &stage.0) };
    let rows = rows();
    let of = |what| rows.iter().filter(|row| row.what == what).collect::<Vec<_>>();
    assert_eq!((rows[0].what, rows[0].status), (CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_MET));
    for what in [CAIRN_REQUIREMENT_ONNXRUNTIME, CAIRN_REQUIREMENT_MEMORY] {
        assert_eq!(of(what).len(), 1);
    }
    let [library] = of(CAIRN_REQUIREMENT_FSR_LIBRARIES)[..] else { panic!("{} rows", rows.len()) };
    assert_eq!(library.status, CAIRN_REQUIREMENT_MET);
    assert!(text(&library.found).contains(Part::FrameGeneration.file_name()), "{}", text(&library.found));
    let [provider] = of(CAIRN_REQUIREMENT_FSR_PROVIDER)[..] else { panic!("{} rows", rows.len()) };
    assert_eq!(text(&provider.found), "3.1.6 (analytic)");
    for what in [CAIRN_REQUIREMENT_FSR_SYSTEM, CAIRN_REQUIREMENT_FSR_DIRECT3D, CAIRN_REQUIREMENT_FSR_SHADER_MODEL] {
        let [row] = of(what)[..] else { panic!("{} rows", rows.len()) };
        println!("{} (needed: {})", text(&row.found), text(&row.needed));
        assert!([CAIRN_REQUIREMENT_MET, CAIRN_REQUIREMENT_OPTIONAL].contains(&row.status));
        assert!(text(&row.needed).contains("ml") && !text(&row.found).is_empty());
    }
    // What is missing of AMD's keeps no device from being made.
    // SAFETY: as above.
    unsafe { std::env::set_var("CAIRN_FFX_DIR", std::env::temp_dir().join("cairn-ffx-there-is-none")) };
    let rows = self::rows();
    let status = |what| rows.iter().find(|row| row.what == what).map(|row| row.status);
    assert_eq!(status(CAIRN_REQUIREMENT_FSR_LIBRARIES), Some(CAIRN_REQUIREMENT_OPTIONAL));
    assert_eq!(status(CAIRN_REQUIREMENT_FSR_PROVIDER), Some(CAIRN_REQUIREMENT_OPTIONAL));
}
