//! Queries of the device memory that providers use.

use std::ffi::c_void;
use std::ptr::null_mut;

use super::bindings::{
    CreateFrameGeneration, CreateUpscale, Creates, FrameFlags, MemoryUsage, QueryFrameGenerationMemory,
    QueryFrameGenerationMemoryV2, QueryUpscaleMemory, QueryUpscaleMemoryV2, ReturnCode, SurfaceFormat,
};
use super::{Api, Chain, Context, FfxStruct};
use crate::Result;

/// The creation struct of an effect that reports device memory.
pub trait ReportsMemory: Creates {
    /// The query for an existing context.
    type Query: FfxStruct;
    /// The query before a context is created.
    type QueryV2: FfxStruct;

    /// The query struct for an existing context; the answer is written to `usage`.
    fn query(usage: *mut MemoryUsage) -> Self::Query;

    /// The query struct for a context created so on `device`. `hudless`: the format of HUD-less frames, `UNKNOWN` for none.
    fn query_v2(&self, device: *mut c_void, hudless: SurfaceFormat, usage: *mut MemoryUsage) -> Self::QueryV2;
}

impl ReportsMemory for CreateFrameGeneration {
    type Query = QueryFrameGenerationMemory;
    type QueryV2 = QueryFrameGenerationMemoryV2;

    fn query(usage: *mut MemoryUsage) -> Self::Query {
        QueryFrameGenerationMemory { usage, ..Default::default() }
    }

    fn query_v2(&self, device: *mut c_void, hudless: SurfaceFormat, usage: *mut MemoryUsage) -> Self::QueryV2 {
        QueryFrameGenerationMemoryV2 {
            device,
            max_render_size: self.max_render_size,
            display_size: self.display_size,
            create_flags: self.flags,
            frame_flags: FrameFlags::NO_SWAPCHAIN,
            back_buffer_format: self.back_buffer_format,
            hudless_format: hudless,
            usage,
            ..Default::default()
        }
    }
}

impl ReportsMemory for CreateUpscale {
    type Query = QueryUpscaleMemory;
    type QueryV2 = QueryUpscaleMemoryV2;

    fn query(usage: *mut MemoryUsage) -> Self::Query {
        QueryUpscaleMemory { usage, ..Default::default() }
    }

    fn query_v2(&self, device: *mut c_void, _hudless: SurfaceFormat, usage: *mut MemoryUsage) -> Self::QueryV2 {
        QueryUpscaleMemoryV2 {
            device,
            max_render_size: self.max_render_size,
            max_upscale_size: self.max_upscale_size,
            flags: self.flags,
            usage,
            ..Default::default()
        }
    }
}

/// Device memory that a context created with `head` and [`Choice::Any`](super::Choice::Any) would use on `device`: that of the default provider,
/// which another choice may not select. None if the library cannot say: SDK 2.0 and later can.
///
/// # Errors
/// The library's own errors.
///
/// # Safety
/// `device` is a live `ID3D12Device`.
pub unsafe fn memory_needed<Head: ReportsMemory>(
    api: &Api,
    device: *mut c_void,
    head: &Head,
    hudless: Option<SurfaceFormat>,
) -> Result<Option<MemoryUsage>> {
    let mut usage = MemoryUsage::default();
    let mut chain = Chain::new(head.query_v2(device, hudless.unwrap_or_default(), &mut usage));
    // SAFETY: no context; the device is as the caller promises, and the memory for the answer lives during the call.
    let is_known = is_known(unsafe { api.query(null_mut(), &mut chain) })?;
    Ok(is_known.then_some(usage))
}

impl<Head: ReportsMemory> Context<Head> {
    /// The context's device memory. None if its provider cannot say: SDK 1.1.2 and later can.
    ///
    /// # Errors
    /// The library's own errors.
    pub fn memory(&mut self) -> Result<Option<MemoryUsage>> {
        let mut usage = MemoryUsage::default();
        let mut chain = Chain::new(Head::query(&mut usage));
        // SAFETY: our own context, and memory for the answer that lives during the call.
        let is_known = is_known(unsafe { self.try_query(&mut chain) })?;
        Ok(is_known.then_some(usage))
    }
}

/// Whether the library knows the query. The fields of the query are valid, so a `PARAMETER` error also means that it does not. The frame
/// generator of SDK 1.1.0 and 1.1.1 answers every query with `ERROR`.
pub(super) fn is_known(answer: Result<(), super::api::Failure>) -> Result<bool> {
    match answer {
        Ok(()) => Ok(true),
        Err(failure) if failure.is_unknown_struct() => Ok(false),
        Err(failure) if [ReturnCode::PARAMETER, ReturnCode::ERROR].contains(&failure.code) => Ok(false),
        Err(failure) => Err(failure.error()),
    }
}
