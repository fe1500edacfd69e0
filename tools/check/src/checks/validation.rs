//! The library's shaders under Direct3D's debug layer, with GPU-based validation where there is one.

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::core::Interface;
use cairn::{Error, ErrorKind, Result};

use super::{adapters, frames, shaders, walk};
use crate::outcome::Outcome;
use crate::settings::Settings;

/// Most messages that a report repeats.
const SHOWN: usize = 8;

/// Runs every shader and a presenter's frames with the debug layer on; its errors and warnings of corruption are failures.
pub(super) fn run(settings: &Settings) -> Result<Outcome> {
    let mut debug: Option<ID3D12Debug> = None;
    // SAFETY: the variable lives during the call.
    let found = unsafe { D3D12GetDebugInterface(&mut debug) };
    let Some(debug) = debug.filter(|_| found.is_ok()) else {
        return Ok(Outcome::cannot_tell(
            "the debug layer is not installed",
            "In Windows' settings add the optional feature Graphics Tools, and run this again",
        ));
    };
    // Before any device: the layer is of the process.
    // SAFETY: a live interface.
    unsafe { debug.EnableDebugLayer() };
    let validation = debug.cast::<ID3D12Debug1>();
    if let Ok(validation) = &validation {
        // SAFETY: a live interface; no device was made yet.
        unsafe { validation.SetEnableGPUBasedValidation(true) };
    }
    let gpu = adapters::gpu(settings)?;
    let Ok(queue) = gpu.device().cast::<ID3D12InfoQueue>() else {
        return Ok(Outcome::cannot_tell(
            "the debug layer was turned on, but the device has no queue of its messages",
            "Repair the optional feature Graphics Tools",
        ));
    };
    // SAFETY: a live queue; the default of some thousand messages would drop later ones.
    unsafe { queue.SetMessageCountLimit(u64::MAX) }.map_err(|e| failed(&e))?;
    let results = [
        shaders::resize_on(&gpu)?,
        shaders::flow_on(&gpu, (160, 90))?,
        shaders::generator_on(&gpu, settings.pick(8, 2))?,
    ];
    let walk = walk::Walk::new(scenes::Family::Desert, (96, 54), 1)?;
    frames::by_device(&gpu, &walk, |_| Ok(()))?;
    let messages = messages(&queue)?;
    let with = if validation.is_ok() { "with" } else { "without" };
    let wrong: Vec<&Outcome> =
        results.iter().filter(|outcome| outcome.verdict == crate::verdict::Verdict::Fail).collect();
    let outcome = if let Some(first) = messages.first() {
        Outcome::fail(
            format!("the debug layer {with} GPU-based validation has {} complaints: {first}", messages.len()),
            "Report it with this page: it is a fault of Cairn or of the driver",
        )
    } else if let Some(first) = wrong.first() {
        Outcome::fail(format!("under the debug layer {}", first.found), "Update the graphics driver, and report it")
    } else {
        Outcome::pass(format!("every shader ran without a complaint of the debug layer {with} GPU-based validation"))
    };
    let shown = messages.iter().take(SHOWN).enumerate();
    Ok(shown.fold(outcome, |outcome, (i, text)| outcome.fact(format!("complaint {}", i + 1), text)))
}

fn failed(e: &cairn::gpu::windows::core::Error) -> Error {
    Error::new(ErrorKind::Device, format!("the debug layer's messages: {}", e.message()))
}

/// Errors and corruptions that the layer has reported.
fn messages(queue: &ID3D12InfoQueue) -> Result<Vec<String>> {
    let mut found = Vec::new();
    // SAFETY: a live queue.
    let count = unsafe { queue.GetNumStoredMessages() };
    for index in 0..count {
        let mut bytes = 0;
        // SAFETY: a live queue and a variable; without a buffer the call gives the size.
        unsafe { queue.GetMessage(index, None, &mut bytes) }.map_err(|e| failed(&e))?;
        // Aligned as the struct at its start must be.
        let mut buffer = vec![0_u64; bytes.div_ceil(size_of::<u64>())];
        let message = buffer.as_mut_ptr().cast::<D3D12_MESSAGE>();
        // SAFETY: a live queue, and a buffer of the size that it gave.
        unsafe { queue.GetMessage(index, Some(message), &mut bytes) }.map_err(|e| failed(&e))?;
        // SAFETY: the call above filled it.
        let message = unsafe { &*message };
        if ![D3D12_MESSAGE_SEVERITY_CORRUPTION, D3D12_MESSAGE_SEVERITY_ERROR].contains(&message.Severity) {
            continue;
        }
        // SAFETY: text of that length, with its final zero, in the buffer.
        let text = unsafe { std::slice::from_raw_parts(message.pDescription, message.DescriptionByteLength) };
        found.push(String::from_utf8_lossy(text).trim_end_matches('\0').to_owned());
    }
    Ok(found)
}
