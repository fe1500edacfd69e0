//! Frames under Direct3D's debug layer, and with its GPU-based validation.

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface as _;
use gpu_testing::engine::Engine;
use gpu_testing::{high_dynamic_range, paper_guidance, resize};

use super::{Settings, shaders};
use crate::finding::{Checked, Finding};

/// Messages in the report.
const SHOWN: usize = 3;

/// The debug layer's interface, where it is installed. Asking for it loads the layer.
pub(super) fn debug_interface() -> Option<ID3D12Debug> {
    let mut debug: Option<ID3D12Debug> = None;
    // SAFETY: the variable lives during the call.
    unsafe { D3D12GetDebugInterface(&mut debug) }.ok()?;
    debug
}

/// Frames under the debug layer.
pub(super) fn messages(settings: &Settings) -> Checked {
    run(settings, false)
}

/// The same with GPU-based validation.
pub(super) fn gpu_based_validation(settings: &Settings) -> Checked {
    run(settings, true)
}

fn missing(what: &str) -> Finding {
    Finding::cannot_tell(what, "Add the optional feature Graphics Tools in the settings of Windows")
}

fn run(settings: &Settings, validates_on_gpu: bool) -> Checked {
    let debug = debug_interface().ok_or_else(|| missing("The debug layer is not installed"))?;
    // SAFETY: a live interface, before a device is made.
    unsafe { debug.EnableDebugLayer() };
    if validates_on_gpu {
        let newer: ID3D12Debug1 =
            debug.cast().map_err(|_| missing("The debug layer is too old for GPU-based validation"))?;
        // SAFETY: as above.
        unsafe { newer.SetEnableGPUBasedValidation(true) };
    }
    let gpu = settings.gpu()?;
    let queue: ID3D12InfoQueue =
        gpu.device().cast().map_err(|_| missing("The device has no queue for the debug layer's messages"))?;
    // No limit: a dropped message would be a fault that nobody sees.
    // SAFETY: a live interface.
    unsafe { queue.SetMessageCountLimit(u64::MAX) }.map_err(|e| missing(&format!("The debug layer fails: {e}")))?;
    make_mistake(&gpu);
    if faults(&queue).is_empty() {
        return Ok(missing(
            "The debug layer does not report a mistake that was made on purpose, so its silence shows nothing",
        ));
    }
    // SAFETY: as above.
    unsafe { queue.ClearStoredMessages() };

    let engine = Engine::of(&gpu);
    resize::compare(&gpu);
    paper_guidance::compare(&gpu);
    shaders::compare_flow(&gpu, true);
    shaders::compare_frames(&gpu, true)?;
    shaders::compare_formats(&engine, true);
    high_dynamic_range::compare(&engine);
    let faults = faults(&queue);
    let kind = if validates_on_gpu { "The debug layer with GPU-based validation" } else { "The debug layer" };
    let count = faults.len();
    if count == 0 {
        return Ok(Finding::pass(format!(
            "{kind} reports a mistake made on purpose, and neither an error nor a warning about resizing, guidance, frames and formats"
        )));
    }
    let shown: Vec<&str> = faults.iter().take(SHOWN).map(String::as_str).collect();
    Ok(Finding::fail(format!("{kind} has {count} messages; the first: {}", shown.join(" | ")), "Send this report")
        .figure("messages of errors and warnings", count as f64, "messages"))
}

/// A buffer of no bytes, which the layer must report.
fn make_mistake(gpu: &Gpu) {
    let heap = D3D12_HEAP_PROPERTIES { Type: D3D12_HEAP_TYPE_DEFAULT, ..Default::default() };
    let desc = D3D12_RESOURCE_DESC { Dimension: D3D12_RESOURCE_DIMENSION_BUFFER, ..Default::default() };
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: descriptions and variable live during the call, which refuses them.
    let refused = unsafe {
        gpu.device().CreateCommittedResource(
            &heap,
            D3D12_HEAP_FLAG_NONE,
            &desc,
            D3D12_RESOURCE_STATE_COMMON,
            None,
            &mut made,
        )
    };
    drop((refused, made));
}

/// The layer's messages about errors and warnings.
fn faults(queue: &ID3D12InfoQueue) -> Vec<String> {
    // SAFETY: a live interface.
    let count = unsafe { queue.GetNumStoredMessages() };
    (0..count).filter_map(|index| message(queue, index)).collect()
}

fn message(queue: &ID3D12InfoQueue, index: u64) -> Option<String> {
    let mut length = 0;
    // SAFETY: without memory the call returns the length.
    unsafe { queue.GetMessage(index, None, &mut length) }.ok()?;
    // In words, so that the struct at the start is aligned.
    let mut memory = vec![0_u64; length.div_ceil(8)];
    let at = memory.as_mut_ptr().cast::<D3D12_MESSAGE>();
    // SAFETY: memory of that length.
    unsafe { queue.GetMessage(index, Some(at), &mut length) }.ok()?;
    // SAFETY: the call has written the struct.
    let found = unsafe { &*at };
    let is_fault = [D3D12_MESSAGE_SEVERITY_CORRUPTION, D3D12_MESSAGE_SEVERITY_ERROR, D3D12_MESSAGE_SEVERITY_WARNING]
        .contains(&found.Severity);
    // SAFETY: the text of that length, in the same memory.
    let text = unsafe { std::slice::from_raw_parts(found.pDescription, found.DescriptionByteLength) };
    let text = String::from_utf8_lossy(text).trim_end_matches('\0').to_owned();
    is_fault.then(|| format!("{} (message {})", text, found.ID.0))
}
