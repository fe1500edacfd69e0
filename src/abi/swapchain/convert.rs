//! Converts the header's swap chain options and frames to types of `ffx`.

use super::*;
use crate::abi::results::AbiResult;
use crate::ffx::bindings::{Coordinates, CreateFlags, Dimensions, Rect, SurfaceFormat};
use crate::ffx::{Camera, Choice, Family, FrameParams};

pub(super) fn choice(provider: u32) -> Choice {
    match provider {
        CAIRN_FSR_PREFER_ML => Choice::Prefer(Family::Ml),
        CAIRN_FSR_PREFER_ANALYTIC => Choice::Prefer(Family::Analytic),
        CAIRN_FSR_REQUIRE_ML => Choice::Require(Family::Ml),
        CAIRN_FSR_REQUIRE_ANALYTIC => Choice::Require(Family::Analytic),
        _ => Choice::Any,
    }
}

/// Creation flags of the generator. CAIRN_SWAPCHAIN_UNTRIED is none of them.
pub(super) fn flags(of_host: u32) -> CreateFlags {
    [
        (CAIRN_SWAPCHAIN_ASYNC, CreateFlags::ASYNC_WORKLOAD),
        (CAIRN_SWAPCHAIN_SHOWN_MOTION, CreateFlags::DISPLAY_RESOLUTION_MOTION),
        (CAIRN_SWAPCHAIN_JITTERED_MOTION, CreateFlags::MOTION_JITTER),
        (CAIRN_SWAPCHAIN_INVERTED_DEPTH, CreateFlags::DEPTH_INVERTED),
        (CAIRN_SWAPCHAIN_INFINITE_DEPTH, CreateFlags::DEPTH_INFINITE),
        (CAIRN_SWAPCHAIN_HDR, CreateFlags::HIGH_DYNAMIC_RANGE),
        (CAIRN_SWAPCHAIN_CHECKED, CreateFlags::DEBUG_CHECKING),
    ]
    .into_iter()
    .filter(|(flag, _)| of_host & flag != 0)
    .map(|(_, flag)| flag)
    .collect()
}

/// Format of frames without user interface; `None` for 0.
pub(super) fn hudless(dxgi: u32) -> AbiResult<Option<SurfaceFormat>> {
    match SurfaceFormat::from_dxgi(dxgi) {
        _ if dxgi == 0 => Ok(None),
        SurfaceFormat::UNKNOWN => {
            let why = format!("DXGI format {dxgi} is none that AMD's library has a word for");
            Err(Failure::argument("options.hudless_format", why))
        }
        known => Ok(Some(known)),
    }
}

/// Parameters of a frame, without its textures.
pub(super) fn frame_params(frame: &cairn_swapchain_frame) -> FrameParams {
    let or = |value: f32, default: f32| if value == 0.0 { default } else { value };
    let side = |length: u32| i32::try_from(length).unwrap_or(i32::MAX);
    let camera = match frame.vertical_fov {
        0.0 => Camera::default(),
        fov => Camera {
            position: frame.position,
            up: frame.up,
            right: frame.right,
            forward: frame.forward,
            near: frame.near_plane,
            far: frame.far_plane,
            fov,
            metres: or(frame.metres, 1.0),
        },
    };
    FrameParams {
        jitter: Coordinates { x: frame.jitter_x, y: frame.jitter_y },
        motion_scale: Coordinates { x: or(frame.motion_scale_x, 1.0), y: or(frame.motion_scale_y, 1.0) },
        frame_time: frame.frame_time_ms,
        camera,
        reset: frame.flags & CAIRN_SWAPCHAIN_RESET != 0,
        rect: Rect {
            left: side(frame.world_left),
            top: side(frame.world_top),
            width: side(frame.world_width),
            height: side(frame.world_height),
        },
        ..FrameParams::of(Dimensions { width: frame.render_width, height: frame.render_height })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> cairn_swapchain_frame {
        // SAFETY: zeroes are valid in every field.
        unsafe { std::mem::zeroed() }
    }

    #[test]
    fn converts_every_field_of_a_frame() {
        let distinct = cairn_swapchain_frame {
            flags: CAIRN_SWAPCHAIN_RESET,
            render_width: 1,
            render_height: 2,
            world_left: 3,
            world_top: 4,
            world_width: 5,
            world_height: u32::MAX,
            jitter_x: 7.0,
            jitter_y: 8.0,
            motion_scale_x: 9.0,
            motion_scale_y: 10.0,
            frame_time_ms: 11.0,
            vertical_fov: 12.0,
            near_plane: 13.0,
            far_plane: 14.0,
            metres: 15.0,
            position: [16.0, 17.0, 18.0],
            up: [19.0, 20.0, 21.0],
            right: [22.0, 23.0, 24.0],
            forward: [25.0, 26.0, 27.0],
            ..frame()
        };
        let FrameParams { render_size, jitter, motion_scale, frame_time, camera, reset, rect, .. } =
            frame_params(&distinct);
        assert_eq!((render_size.width, render_size.height, reset), (1, 2, true));
        assert_eq!([rect.left, rect.top, rect.width, rect.height], [3, 4, 5, i32::MAX]);
        assert_eq!([jitter.x, jitter.y, motion_scale.x, motion_scale.y, frame_time], [7.0, 8.0, 9.0, 10.0, 11.0]);
        let Camera { position, up, right, forward, near, far, fov, metres } = camera;
        assert_eq!([fov, near, far, metres], [12.0, 13.0, 14.0, 15.0]);
        assert_eq!([position, up, right, forward].concat(), (16..28).map(|n| n as f32).collect::<Vec<_>>());
    }

    #[test]
    fn zero_is_the_default() {
        let FrameParams { motion_scale, camera, reset, .. } = frame_params(&frame());
        assert_eq!((motion_scale.x, motion_scale.y, camera, reset), (1.0, 1.0, Camera::default(), false));
        let known = cairn_swapchain_frame { vertical_fov: 0.5, far_plane: 9.0, ..frame() };
        let camera = frame_params(&known).camera;
        assert_eq!((camera.metres, camera.far), (1.0, 9.0));
        assert_eq!((choice(0), flags(0), hudless(0).unwrap()), (Choice::Any, CreateFlags::empty(), None));
    }

    #[test]
    fn converts_flags_providers_and_formats() {
        // The first seven bits are AMD's flags unchanged; the eighth is Cairn's.
        for bit in 0..7 {
            assert_eq!(flags(1 << bit).bits(), 1 << bit);
        }
        assert_eq!(flags(CAIRN_SWAPCHAIN_UNTRIED), CreateFlags::empty());
        let all = [CAIRN_FSR_PREFER_ML, CAIRN_FSR_PREFER_ANALYTIC, CAIRN_FSR_REQUIRE_ML, CAIRN_FSR_REQUIRE_ANALYTIC];
        let names = ["ml", "analytic", "require-ml", "require-analytic"];
        for (number, name) in all.into_iter().zip(names) {
            assert_eq!(choice(number), name.parse().unwrap());
        }
        // DXGI_FORMAT_R16G16B16A16_FLOAT, and one that AMD's library does not support.
        assert_eq!(hudless(10).unwrap(), Some(SurfaceFormat::R16G16B16A16_FLOAT));
        assert!(hudless(35).unwrap_err().to_string().contains("35"));
    }
}
