//! Upscaling with a fake library: the handling of each call's return code, and the suspected fields.

use super::super::bindings::*;
use super::super::fake_library::{FAKE, FakeLibrary, api};
use super::*;

const RENDERED: Dimensions = Dimensions { width: 640, height: 360 };
const SHOWN: Dimensions = Dimensions { width: 1280, height: 720 };

fn picture(address: usize, Dimensions { width, height }: Dimensions) -> Resource {
    let description = ResourceDescription {
        kind: ResourceType::TEXTURE_2D,
        format: SurfaceFormat::R16G16B16A16_FLOAT,
        width,
        height,
        depth: 1,
        mips: 1,
        ..Default::default()
    };
    Resource { resource: address as *mut c_void, description, state: ResourceState::COMPUTE_READ }
}

fn upscaler() -> Upscaler {
    let newest = (0xf600_0000_0100_0003, c"4.0.3");
    FAKE.set(FakeLibrary { providers: vec![newest], running_provider: Some(newest), ..FakeLibrary::default() });
    let head = CreateUpscale { max_render_size: RENDERED, max_upscale_size: SHOWN, ..Default::default() };
    // SAFETY: the fake library uses no device.
    unsafe { Upscaler::create(&api(), 0x1000 as *mut c_void, Choice::Any, head) }.expect("an upscaler")
}

fn frame() -> UpscaleFrame {
    let none = Resource::default();
    UpscaleFrame {
        command_list: 0x10 as *mut c_void,
        color: picture(0x100, RENDERED),
        depth: picture(0x200, RENDERED),
        motion: picture(0x300, RENDERED),
        exposure: none,
        reactive: none,
        transparency: none,
        output: picture(0x400, SHOWN),
        params: UpscaleParams::of(RENDERED, SHOWN),
    }
}

#[test]
fn every_error_names_the_call_the_suspected_field_and_the_arguments() {
    let mut upscaler = upscaler();
    type Call = fn(&mut Upscaler) -> Result<()>;
    let calls: [(Call, StructId, &str, &str, [&str; 2]); 6] = [
        (
            // SAFETY: the fake library reads ids only.
            |upscaler| unsafe { upscaler.record(&frame()) },
            StructId::UPSCALE_DISPATCH,
            "ffxDispatch",
            "upscale_size",
            ["color", "command_list"],
        ),
        (
            |upscaler| {
                let [opaque, color, output] = [0x500, 0x600, 0x700].map(|address| picture(address, RENDERED));
                let mask = ReactiveMask::of(RENDERED);
                // SAFETY: as above.
                unsafe { upscaler.find_reactive(0x10 as *mut c_void, opaque, color, output, &mask) }
            },
            StructId::UPSCALE_REACTIVE_MASK,
            "ffxDispatch",
            "threshold: 0.2",
            ["color", "command_list"],
        ),
        (
            |_| Upscaler::render_size(&api(), SHOWN, QualityMode::QUALITY).map(drop),
            StructId::UPSCALE_RENDER_SIZE,
            "ffxQuery",
            "display_width: 1280",
            ["mode", "device"],
        ),
        (
            |_| Upscaler::jitter_phases(&api(), 640, 1280).map(drop),
            StructId::UPSCALE_JITTER_PHASES,
            "ffxQuery",
            "render_width: 640",
            ["render_width", "device"],
        ),
        (
            |_| Upscaler::jitter(&api(), 3, 32).map(drop),
            StructId::UPSCALE_JITTER_OFFSET,
            "ffxQuery",
            "count: 32",
            ["phases", "device"],
        ),
        (|upscaler| upscaler.memory().map(drop), StructId::UPSCALE_MEMORY, "ffxQuery", "usage", ["", "device"]),
    ];
    for (act, id, call, passed, [of_value, of_work]) in calls {
        for code in (1..=8).chain([u32::MAX]) {
            FAKE.with_borrow_mut(|fake| fake.rejects = vec![(id, ReturnCode(code))]);
            let answer = act(&mut upscaler);
            // An unknown memory query is not an error.
            if id == StructId::UPSCALE_MEMORY && [1, 2, 6, 7].contains(&code) {
                assert!(answer.is_ok(), "{code}");
                continue;
            }
            let failed = answer.expect_err("it fails");
            let field = match code {
                2 | 4 | 7 => "provider",
                5 => "device",
                6 => of_value,
                _ => of_work,
            };
            assert_eq!(failed.offending_field(), Some(field), "{failed}");
            assert!(failed.cause().starts_with(&format!("{call} answered {code} ")), "{failed}");
            assert!(failed.cause().contains(passed) && failed.remedy_text().is_some(), "{passed}: {failed}");
        }
    }
}

#[test]
fn the_debug_view_is_refused() {
    FAKE.set(FakeLibrary::default());
    let flags = UpscaleCreateFlags::DEBUG_VISUALIZATION;
    let head = CreateUpscale { flags, max_render_size: RENDERED, max_upscale_size: SHOWN, ..Default::default() };
    // SAFETY: the fake library uses no device.
    let refused = unsafe { Upscaler::create(&api(), 0x1000 as *mut c_void, Choice::Any, head) }.expect_err("refused");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some("flags")));
    assert!(FAKE.with_borrow(|fake| fake.calls.is_empty()), "the library was not asked");
}
