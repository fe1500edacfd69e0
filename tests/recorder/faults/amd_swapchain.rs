//! AMD's swap chain: each of its functions, and frames that it presents. A frame whose generation fails is presented twice.

use std::ffi::CString;
use std::ptr::{null, null_mut};

use cairn::abi::d3d12::cairn_device_create_d3d12;
use cairn::abi::device::{cairn_device, cairn_device_destroy};
use cairn::abi::results::CAIRN_OK;
use cairn::abi::swapchain::{
    CAIRN_SWAPCHAIN_UNTRIED, cairn_swapchain, cairn_swapchain_create_for_window, cairn_swapchain_destroy,
    cairn_swapchain_fit, cairn_swapchain_frame, cairn_swapchain_get_dxgi, cairn_swapchain_get_statistics,
    cairn_swapchain_options, cairn_swapchain_pacing, cairn_swapchain_pause, cairn_swapchain_prepare,
    cairn_swapchain_set_interface, cairn_swapchain_set_pacing, cairn_swapchain_statistics, cairn_swapchain_wait,
};
use cairn::ffx::bindings::Dimensions;
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::*;
use cairn::gpu::windows::core::Interface as _;
use test_support::c_interface::{create_handle, tool_device_options, with_struct_size};
use test_support::d3d12::resources::{TestResource, run_list};
use test_support::ffx::failing_calls::FailingCalls;
use test_support::ffx::frame_textures::{Textures, copy};
use test_support::ffx::window::{PRESENT, SIZE, STEP, Window, description, factory, moved, panning};

use super::{Failure, Reach, Source, Trial, fail_each};

/// Size of the buffers after they were resized.
const RESIZED: Dimensions = Dimensions { width: 160, height: 80 };

/// A host that draws into a window.
struct Host<'a, 'b> {
    trial: &'a mut Trial<'b>,
    swapchain: *mut cairn_swapchain,
    gpu: Gpu,
    frames: i32,
    /// Frames that were prepared and presented.
    prepared: u64,
    /// Whether the device was removed.
    is_lost: bool,
}

/// The host's device, swap chain and frames.
fn present(trial: &mut Trial<'_>, calls: &FailingCalls) {
    let window = Window::open();
    let gpu = Gpu::of_engine(&trial.engine.device, &trial.engine.direct, None).expect("the engine's device");
    let raw = (trial.engine.device.as_raw().cast(), trial.engine.direct.as_raw().cast());
    let folder = CString::new(calls.folder.0.to_str().expect("text")).expect("no NUL");
    let mut options = tool_device_options();
    options.ffx = folder.as_ptr();
    // SAFETY: live objects, options of their size and a variable for the handle.
    let device: *mut cairn_device =
        create_handle(|to| unsafe { cairn_device_create_d3d12(raw.0, raw.1, null_mut(), &options, to) });
    let mut options: cairn_swapchain_options = with_struct_size(|o: &mut cairn_swapchain_options| &mut o.struct_size);
    // The frames of the self-test are those of the presenter's trials.
    options.flags = CAIRN_SWAPCHAIN_UNTRIED;
    let (factory, desc) = (factory(), description());
    let mut swapchain = null_mut();
    let place = &raw mut swapchain;
    let create = || {
        let (raw, desc) = (factory.as_raw().cast(), (&raw const desc).cast());
        // SAFETY: live objects, valid structs, and memory for the handle.
        unsafe { cairn_swapchain_create_for_window(device, &options, raw, window.0.0, desc, null(), place) }
    };
    if trial.call("a swap chain", create) {
        let mut host = Host { trial, swapchain, gpu, frames: 0, prepared: 0, is_lost: false };
        host.run();
        // SAFETY: a live handle, destroyed once.
        trial.end("the swap chain's end", || unsafe { cairn_swapchain_destroy(swapchain) });
    }
    // SAFETY: a live handle, destroyed once.
    trial.end("the device's end", || unsafe { cairn_device_destroy(device) });
    // AMD's library does not destroy a swap chain if its functions fail for ever, and the swap chain's threads go on in the window.
    if matches!(trial.failure, Some(Failure::ForEver(_))) {
        std::mem::forget(window);
    }
}

impl Host<'_, '_> {
    /// All calls of a swap chain's life.
    fn run(&mut self) {
        let swapchain = self.swapchain;
        let textures = panning(&self.gpu, SIZE);
        (0..2).for_each(|_| self.frame(&textures, SIZE));
        self.statistics();
        let interface = Textures::new(&self.gpu, SIZE);
        interface.fill(&interface.color, |_, _| [9, 8, 7, 255]);
        let (picture, state) = (interface.color.resource.as_raw().cast(), interface.color.state.0.cast_unsigned());
        // SAFETY: a live handle and objects that live until another interface is set, here and below.
        self.trial.call("an interface", || unsafe { cairn_swapchain_set_interface(swapchain, picture, state, 0) });
        self.frame(&textures, SIZE);
        // SAFETY: as above.
        self.trial.call("no interface", || unsafe { cairn_swapchain_set_interface(swapchain, null_mut(), 0, 0) });
        let mut pacing: cairn_swapchain_pacing = with_struct_size(|p: &mut cairn_swapchain_pacing| &mut p.struct_size);
        (pacing.safety_margin_ms, pacing.variance_factor) = (0.01, 0.3);
        // SAFETY: a live handle, and a struct of its size.
        self.trial.call("pacing", || unsafe { cairn_swapchain_set_pacing(swapchain, &pacing) });
        // SAFETY: a live handle, here and below.
        self.trial.call("a wait", || unsafe { cairn_swapchain_wait(swapchain) });
        // SAFETY: as above.
        self.trial.call("a pause", || unsafe { cairn_swapchain_pause(swapchain) });
        let dxgi = self.dxgi();
        // SAFETY: a live swap chain whose buffers nobody holds.
        let resized = self.trial.attempt(|| unsafe {
            dxgi.ResizeBuffers(3, RESIZED.width, RESIZED.height, DXGI_FORMAT_UNKNOWN, DXGI_SWAP_CHAIN_FLAG(0))
        });
        drop(dxgi);
        if self.is_removed(resized.is_ok()) {
            return;
        }
        // SAFETY: as above.
        let is_fitted = self.trial.call("the new size", || unsafe { cairn_swapchain_fit(swapchain) });
        if self.is_removed(is_fitted) {
            return;
        }
        let textures = panning(&self.gpu, RESIZED);
        (0..2).for_each(|_| self.frame(&textures, RESIZED));
        self.statistics();
    }

    /// Whether this call or an earlier one failed, as only a removed device's may: frames are then neither presented nor counted.
    fn is_removed(&mut self, succeeded: bool) -> bool {
        let is_removal = matches!(self.trial.failure, Some(Failure::Removal(_)));
        assert!(succeeded || is_removal, "with {:?}", self.trial.failure);
        self.is_lost |= !succeeded;
        self.is_lost
    }

    /// The DXGI swap chain, with a new reference.
    fn dxgi(&self) -> IDXGISwapChain4 {
        let mut dxgi = null_mut();
        // SAFETY: memory for the pointer, which comes with a reference of ours.
        unsafe {
            assert_eq!(cairn_swapchain_get_dxgi(self.swapchain, &mut dxgi), CAIRN_OK);
            IDXGISwapChain4::from_raw(dxgi.cast())
        }
    }

    /// Draws, prepares and presents a frame.
    fn frame(&mut self, textures: &Textures, size: Dimensions) {
        textures.fill(&textures.color, moved(STEP * self.frames));
        let dxgi = self.dxgi();
        // SAFETY: a live swap chain.
        let buffer: ID3D12Resource = unsafe { dxgi.GetBuffer(dxgi.GetCurrentBackBufferIndex()) }.expect("a buffer");
        let mut frame: cairn_swapchain_frame = with_struct_size(|f: &mut cairn_swapchain_frame| &mut f.struct_size);
        let Textures { depth, motion, .. } = textures;
        (frame.depth, frame.depth_state) = (depth.resource.as_raw().cast(), depth.state.0.cast_unsigned());
        (frame.motion, frame.motion_state) = (motion.resource.as_raw().cast(), motion.state.0.cast_unsigned());
        (frame.render_width, frame.render_height) = (size.width, size.height);
        frame.frame_time_ms = 1000.0 / 15.0;
        let (swapchain, mut is_prepared) = (self.swapchain, false);
        run_list(&self.gpu, |list| {
            // SAFETY: a live handle, an open list, and textures that live.
            let prepare = || unsafe { cairn_swapchain_prepare(swapchain, list.as_raw().cast(), &frame) };
            is_prepared = self.trial.call("a frame", prepare);
            copy(list, &textures.color, &TestResource { resource: buffer.clone(), state: PRESENT });
        });
        if self.is_removed(is_prepared) {
            return;
        }
        // SAFETY: a live swap chain, whose lists have run.
        let presented = self.trial.attempt(|| unsafe { dxgi.Present(0, DXGI_PRESENT(0)) });
        if self.is_removed(presented.is_ok()) {
            return;
        }
        self.frames += 1;
        self.prepared += 1;
    }

    /// Every frame was generated, or a failure is reported.
    fn statistics(&mut self) {
        if self.is_lost {
            return;
        }
        let mut done: cairn_swapchain_statistics =
            with_struct_size(|s: &mut cairn_swapchain_statistics| &mut s.struct_size);
        let (swapchain, place) = (self.swapchain, &raw mut done);
        // SAFETY: a live handle, and a struct of its size.
        assert!(self.trial.call("statistics", || unsafe { cairn_swapchain_get_statistics(swapchain, place) }));
        let is_whole = done.generated == self.prepared && done.failed == 0;
        let is_missing = done.generated < self.prepared && done.failed != 0;
        let failure = self.trial.failure;
        assert!(
            is_whole || (failure.is_some() && is_missing),
            "{} of {} frames with {failure:?}: {}",
            done.generated,
            self.prepared,
            done.failed
        );
    }
}

/// Broken rules of the double's after generation could not be turned off, was not waited for, or its generator could not be destroyed,
/// since that call failed.
const FAILED_ENDS: [&str; 4] = [
    "its swap chain still generates frames",
    "it was not waited for",
    "frames are under way",
    "its generator is still there",
];

fn fail(failure: fn(u64) -> Failure, count: u64) {
    let calls = FailingCalls::of_process();
    let source = if matches!(failure(1), Failure::Removal(_)) { Source::BeneathAmd(calls) } else { Source::Amd(calls) };
    fail_each(source, Reach::Host, failure, count, |trial| present(trial, calls));
    if !calls.is_amds {
        let mut violations = calls.folder.violations();
        violations.retain(|line| !FAILED_ENDS.iter().any(|end| line.contains(end)));
        assert_eq!(violations, [""; 0]);
    }
}

#[test]
fn each_call_of_its_functions_may_fail_once() {
    fail(Failure::Once, 2);
}

#[test]
fn each_call_of_its_functions_may_throw() {
    fail(Failure::Throwing, 2);
}

#[test]
fn its_functions_may_fail_for_ever_from_each_call_on() {
    fail(Failure::ForEver, 2);
}

#[test]
fn the_device_may_be_removed_at_each_call_to_direct3d() {
    fail(Failure::Removal, 4);
}
