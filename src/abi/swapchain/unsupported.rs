//! AMD's swap chain on systems other than Windows: every constructor fails.

use std::ffi::c_void;

use super::{
    DXGI_SWAP_CHAIN_DESC, DXGI_SWAP_CHAIN_DESC1, DXGI_SWAP_CHAIN_FULLSCREEN_DESC, ID3D12GraphicsCommandList,
    ID3D12Resource, IDXGIFactory, IDXGISwapChain, IDXGISwapChain4, cairn_swapchain_frame, cairn_swapchain_options,
    cairn_swapchain_pacing, cairn_swapchain_statistics,
};
use crate::abi::results::{AbiResult, Failure};
use crate::runtime::Device;

/// AMD's swap chain does not exist here, so neither do its threads.
pub(super) fn is_presenting_thread() -> bool {
    false
}

/// Has no values, so its methods are never called.
pub(in crate::abi) enum SwapchainObject {}

/// # Safety
/// None.
pub(super) unsafe fn wrap(
    _: &Device,
    _: &cairn_swapchain_options,
    _: &mut *mut IDXGISwapChain,
) -> AbiResult<SwapchainObject> {
    Err(Failure::no_d3d12())
}

/// # Safety
/// None.
pub(super) unsafe fn create(
    _: &Device,
    _: &cairn_swapchain_options,
    _: *mut IDXGIFactory,
    _: *const DXGI_SWAP_CHAIN_DESC,
) -> AbiResult<SwapchainObject> {
    Err(Failure::no_d3d12())
}

/// # Safety
/// None.
pub(super) unsafe fn create_for_window(
    _: &Device,
    _: &cairn_swapchain_options,
    _: *mut IDXGIFactory,
    _: *mut c_void,
    _: *const DXGI_SWAP_CHAIN_DESC1,
    _: *const DXGI_SWAP_CHAIN_FULLSCREEN_DESC,
) -> AbiResult<SwapchainObject> {
    Err(Failure::no_d3d12())
}

impl SwapchainObject {
    pub(super) fn dxgi(&self) -> *mut IDXGISwapChain4 {
        match *self {}
    }

    pub(super) fn external_references(&self) -> u32 {
        match *self {}
    }

    /// # Safety
    /// None.
    pub(super) unsafe fn prepare(
        &mut self,
        _: *mut ID3D12GraphicsCommandList,
        _: &cairn_swapchain_frame,
    ) -> AbiResult<()> {
        match *self {}
    }

    /// # Safety
    /// None.
    pub(super) unsafe fn set_interface(&mut self, _: *mut ID3D12Resource, _: u32, _: u32) -> AbiResult<()> {
        match *self {}
    }

    pub(super) fn set_pacing(&mut self, _: Option<&cairn_swapchain_pacing>) -> AbiResult<()> {
        match *self {}
    }

    pub(super) fn pause(&mut self) -> AbiResult<()> {
        match *self {}
    }

    pub(super) fn wait(&mut self) -> AbiResult<()> {
        match *self {}
    }

    pub(super) fn fit(&mut self) -> AbiResult<()> {
        match *self {}
    }

    pub(super) fn statistics(&mut self) -> AbiResult<cairn_swapchain_statistics> {
        match *self {}
    }
}
