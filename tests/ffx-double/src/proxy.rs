//! The swap chain object that the host gets: it implements some functions itself, and forwards others to the real swap chain.

use std::ffi::c_void;
use std::sync::Arc;

use windows::Win32::Foundation::{E_NOINTERFACE, E_NOTIMPL, HANDLE, HWND};
use windows::Win32::Graphics::Dxgi::Common::*;
use windows::Win32::Graphics::Dxgi::*;
use windows::core::{BOOL, GUID, HRESULT, IUnknown, Interface, OutRef, Ref, Result, implement};

use crate::OK;
use crate::library::Library;
use crate::swapchain::{FakeSwapchain, release_count, textures};

/// The host's swap chain object.
#[implement(IDXGISwapChain4)]
pub(crate) struct Proxy {
    pub(crate) swapchain: Arc<FakeSwapchain>,
}

/// Forwards a call to the real swap chain.
macro_rules! real {
    ($self:ident . $name:ident ( $($argument:expr),* )) => {
        // SAFETY: a live swap chain, and arguments unchanged.
        unsafe { $self.swapchain.real.$name($($argument),*) }
    };
}

#[allow(non_snake_case, reason = "DXGI's names")]
impl IDXGIObject_Impl for Proxy_Impl {
    fn SetPrivateData(&self, name: *const GUID, size: u32, data: *const c_void) -> Result<()> {
        real!(self.SetPrivateData(name, size, data))
    }

    fn SetPrivateDataInterface(&self, name: *const GUID, object: Ref<'_, IUnknown>) -> Result<()> {
        real!(self.SetPrivateDataInterface(name, object.as_ref()))
    }

    fn GetPrivateData(&self, name: *const GUID, size: *mut u32, data: *mut c_void) -> Result<()> {
        real!(self.GetPrivateData(name, size, data))
    }

    fn GetParent(&self, id: *const GUID, parent: *mut *mut c_void) -> Result<()> {
        // SAFETY: forwarded unchanged.
        unsafe {
            (self.swapchain.real.vtable().base__.base__.base__.base__.base__.base__.GetParent)(
                self.swapchain.real.as_raw(),
                id,
                parent,
            )
        }
        .ok()
    }
}

#[allow(non_snake_case, reason = "DXGI's names")]
impl IDXGIDeviceSubObject_Impl for Proxy_Impl {
    fn GetDevice(&self, id: *const GUID, device: *mut *mut c_void) -> Result<()> {
        // SAFETY: forwarded unchanged.
        unsafe {
            (self.swapchain.real.vtable().base__.base__.base__.base__.base__.GetDevice)(
                self.swapchain.real.as_raw(),
                id,
                device,
            )
        }
        .ok()
    }
}

#[allow(non_snake_case, reason = "DXGI's names")]
impl IDXGISwapChain_Impl for Proxy_Impl {
    fn Present(&self, sync: u32, flags: DXGI_PRESENT) -> HRESULT {
        self.swapchain.present(sync, flags).map_or_else(|e| e.code(), |()| HRESULT(0))
    }

    fn GetBuffer(&self, buffer: u32, id: *const GUID, to: *mut *mut c_void) -> Result<()> {
        let found = self.swapchain.state().buffers.get(buffer as usize).cloned();
        let found = found.ok_or(DXGI_ERROR_INVALID_CALL)?;
        // SAFETY: a live object, and the host's memory for the result.
        unsafe { found.query(id, to) }.ok()
    }

    fn SetFullscreenState(&self, _: BOOL, _: Ref<'_, IDXGIOutput>) -> Result<()> {
        Err(DXGI_ERROR_NOT_CURRENTLY_AVAILABLE.into())
    }

    fn GetFullscreenState(&self, full: *mut BOOL, output: OutRef<'_, IDXGIOutput>) -> Result<()> {
        if !full.is_null() {
            // SAFETY: the host's memory.
            unsafe { *full = false.into() };
        }
        output.write(None)
    }

    fn GetDesc(&self) -> Result<DXGI_SWAP_CHAIN_DESC> {
        real!(self.GetDesc())
    }

    fn ResizeBuffers(
        &self,
        count: u32,
        width: u32,
        height: u32,
        format: DXGI_FORMAT,
        flags: &DXGI_SWAP_CHAIN_FLAG,
    ) -> Result<()> {
        let mut state = self.swapchain.state();
        if let Some(at) = state.buffers.iter().position(|buffer| release_count(buffer.clone()) > 1) {
            let why = format!("buffer {at} is still held when buffers are resized");
            drop(state);
            Library::handle("resize", |library| library.report_violation("resize", &why, OK));
            return Err(DXGI_ERROR_INVALID_CALL.into());
        }
        real!(self.ResizeBuffers(0, width, height, format, *flags))?;
        let desc = real!(self.GetDesc1())?;
        let count = if count == 0 { state.buffers.len() as u32 } else { count };
        (state.buffers, state.generated) = textures(&self.swapchain.device, count, &desc)?;
        state.next = 0;
        Ok(())
    }

    fn ResizeTarget(&self, mode: *const DXGI_MODE_DESC) -> Result<()> {
        real!(self.ResizeTarget(mode))
    }

    fn GetContainingOutput(&self) -> Result<IDXGIOutput> {
        real!(self.GetContainingOutput())
    }

    fn GetFrameStatistics(&self, to: *mut DXGI_FRAME_STATISTICS) -> Result<()> {
        real!(self.GetFrameStatistics(to))
    }

    fn GetLastPresentCount(&self) -> Result<u32> {
        Ok(self.swapchain.state().shown as u32)
    }
}

#[allow(non_snake_case, reason = "DXGI's names")]
impl IDXGISwapChain1_Impl for Proxy_Impl {
    fn GetDesc1(&self) -> Result<DXGI_SWAP_CHAIN_DESC1> {
        let desc = real!(self.GetDesc1())?;
        let count = self.swapchain.state().buffers.len() as u32;
        Ok(DXGI_SWAP_CHAIN_DESC1 { BufferCount: count, Flags: self.swapchain.flags.0 as u32, ..desc })
    }

    fn GetFullscreenDesc(&self) -> Result<DXGI_SWAP_CHAIN_FULLSCREEN_DESC> {
        real!(self.GetFullscreenDesc())
    }

    fn GetHwnd(&self) -> Result<HWND> {
        real!(self.GetHwnd())
    }

    fn GetCoreWindow(&self, _: *const GUID, _: *mut *mut c_void) -> Result<()> {
        Err(E_NOINTERFACE.into())
    }

    fn Present1(&self, sync: u32, flags: DXGI_PRESENT, _: *const DXGI_PRESENT_PARAMETERS) -> HRESULT {
        self.Present(sync, flags)
    }

    fn IsTemporaryMonoSupported(&self) -> BOOL {
        false.into()
    }

    fn GetRestrictToOutput(&self) -> Result<IDXGIOutput> {
        Err(E_NOTIMPL.into())
    }

    fn SetBackgroundColor(&self, colour: *const DXGI_RGBA) -> Result<()> {
        real!(self.SetBackgroundColor(colour))
    }

    fn GetBackgroundColor(&self) -> Result<DXGI_RGBA> {
        real!(self.GetBackgroundColor())
    }

    fn SetRotation(&self, rotation: DXGI_MODE_ROTATION) -> Result<()> {
        real!(self.SetRotation(rotation))
    }

    fn GetRotation(&self) -> Result<DXGI_MODE_ROTATION> {
        real!(self.GetRotation())
    }
}

#[allow(non_snake_case, reason = "DXGI's names")]
impl IDXGISwapChain2_Impl for Proxy_Impl {
    fn SetSourceSize(&self, width: u32, height: u32) -> Result<()> {
        real!(self.SetSourceSize(width, height))
    }

    fn GetSourceSize(&self, width: *mut u32, height: *mut u32) -> Result<()> {
        real!(self.GetSourceSize(width, height))
    }

    fn SetMaximumFrameLatency(&self, most: u32) -> Result<()> {
        real!(self.SetMaximumFrameLatency(most))
    }

    fn GetMaximumFrameLatency(&self) -> Result<u32> {
        real!(self.GetMaximumFrameLatency())
    }

    fn GetFrameLatencyWaitableObject(&self) -> HANDLE {
        real!(self.GetFrameLatencyWaitableObject())
    }

    fn SetMatrixTransform(&self, matrix: *const DXGI_MATRIX_3X2_F) -> Result<()> {
        real!(self.SetMatrixTransform(matrix))
    }

    fn GetMatrixTransform(&self, matrix: *mut DXGI_MATRIX_3X2_F) -> Result<()> {
        real!(self.GetMatrixTransform(matrix))
    }
}

#[allow(non_snake_case, reason = "DXGI's names")]
impl IDXGISwapChain3_Impl for Proxy_Impl {
    fn GetCurrentBackBufferIndex(&self) -> u32 {
        self.swapchain.state().next
    }

    fn CheckColorSpaceSupport(&self, space: DXGI_COLOR_SPACE_TYPE) -> Result<u32> {
        real!(self.CheckColorSpaceSupport(space))
    }

    fn SetColorSpace1(&self, space: DXGI_COLOR_SPACE_TYPE) -> Result<()> {
        real!(self.SetColorSpace1(space))
    }

    fn ResizeBuffers1(
        &self,
        _: u32,
        _: u32,
        _: u32,
        _: DXGI_FORMAT,
        _: &DXGI_SWAP_CHAIN_FLAG,
        _: *const u32,
        _: *const Option<IUnknown>,
    ) -> Result<()> {
        // As AMD's swap chain does.
        Err(E_NOTIMPL.into())
    }
}

#[allow(non_snake_case, reason = "DXGI's names")]
impl IDXGISwapChain4_Impl for Proxy_Impl {
    fn SetHDRMetaData(&self, kind: DXGI_HDR_METADATA_TYPE, size: u32, data: *const c_void) -> Result<()> {
        // SAFETY: forwarded unchanged.
        unsafe { (self.swapchain.real.vtable().SetHDRMetaData)(self.swapchain.real.as_raw(), kind, size, data) }.ok()
    }
}
