//! Graphics adapters of this machine, from DXGI.

use windows::Win32::Foundation::LUID;
use windows::Win32::Graphics::Direct3D::D3D_FEATURE_LEVEL_11_0;
use windows::Win32::Graphics::Direct3D12::{D3D12CreateDevice, ID3D12Device};
use windows::Win32::Graphics::Dxgi::{
    CreateDXGIFactory2, DXGI_ADAPTER_DESC1, DXGI_ADAPTER_FLAG_SOFTWARE, DXGI_CREATE_FACTORY_FLAGS,
    DXGI_ERROR_NOT_FOUND, IDXGIAdapter1, IDXGIDevice, IDXGIFactory4,
};
use windows::core::Interface;

use super::failure::failed;
use crate::{Error, ErrorKind, Result};

/// An adapter on which a device can be created.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Adapter {
    /// DXGI's LUID, high part first: identifies the adapter until the machine restarts.
    pub luid: u64,
    /// Human-readable name.
    pub description: String,
    /// PCI vendor id.
    pub vendor: u32,
    /// PCI device id.
    pub device: u32,
    /// Bytes of dedicated video memory.
    pub memory: u64,
    /// Whether it is a software adapter that runs on the CPU.
    pub software: bool,
    /// Driver version as Windows shows it, e.g. `32.0.23033.1002`; `None` if the system does not report it.
    pub driver: Option<String>,
}

/// Lists the adapters that support Direct3D 12, in the system's order of preference.
///
/// # Errors
/// `Device` when DXGI does not start.
pub fn adapters() -> Result<Vec<Adapter>> {
    let mut found = Vec::new();
    for_each_adapter(|adapter, described| {
        if supports_d3d12(adapter) {
            found.push(described);
        }
        true
    })?;
    Ok(found)
}

/// The adapter with `luid`; without a LUID the first hardware adapter, else the first adapter.
pub(super) fn find(luid: Option<u64>) -> Result<(IDXGIAdapter1, Adapter)> {
    let mut fallback = None;
    let mut chosen = None;
    for_each_adapter(|adapter, described| {
        let fits = luid.map_or(!described.software, |luid| luid == described.luid);
        let found = Some((adapter.clone(), described));
        if fits {
            chosen = found;
        } else if luid.is_none() && fallback.is_none() {
            fallback = found;
        }
        !fits
    })?;
    chosen.or(fallback).ok_or_else(|| match luid {
        Some(luid) => Error::new(ErrorKind::InvalidArgument, format!("no adapter has the LUID {luid:#x}"))
            .field("luid")
            .remedy("Use one that the list of adapters gives"),
        None => Error::new(ErrorKind::Unsupported, "this machine has no adapter").remedy("Use a CPU device"),
    })
}

/// Calls `visit` with each adapter until it returns `false`.
fn for_each_adapter(mut visit: impl FnMut(&IDXGIAdapter1, Adapter) -> bool) -> Result<()> {
    // SAFETY: the call takes flags only.
    let factory: IDXGIFactory4 =
        unsafe { CreateDXGIFactory2(DXGI_CREATE_FACTORY_FLAGS(0)) }.map_err(|e| failed("CreateDXGIFactory2", &e))?;
    for index in 0.. {
        // SAFETY: a live factory; any index is allowed.
        let adapter = match unsafe { factory.EnumAdapters1(index) } {
            Ok(adapter) => adapter,
            Err(e) if e.code() == DXGI_ERROR_NOT_FOUND => break,
            Err(e) => return Err(failed("IDXGIFactory1::EnumAdapters1", &e)),
        };
        // SAFETY: a live adapter; the call fills a struct of its own.
        let desc = unsafe { adapter.GetDesc1() }.map_err(|e| failed("IDXGIAdapter1::GetDesc1", &e))?;
        if !visit(&adapter, describe(&desc, driver(&adapter))) {
            break;
        }
    }
    Ok(())
}

/// The version of an adapter's user-mode driver.
fn driver(adapter: &IDXGIAdapter1) -> Option<String> {
    // SAFETY: a live adapter and a static identifier; the call fills a number of its own.
    let version = unsafe { adapter.CheckInterfaceSupport(&IDXGIDevice::IID) }.ok()?;
    let part = |index: u32| version >> (16 * index) & 0xffff;
    (version != 0).then(|| format!("{}.{}.{}.{}", part(3), part(2), part(1), part(0)))
}

fn describe(desc: &DXGI_ADAPTER_DESC1, driver: Option<String>) -> Adapter {
    let length = desc.Description.iter().position(|&c| c == 0).unwrap_or(desc.Description.len());
    Adapter {
        luid: luid_number(desc.AdapterLuid),
        description: String::from_utf16_lossy(&desc.Description[..length]),
        vendor: desc.VendorId,
        device: desc.DeviceId,
        memory: desc.DedicatedVideoMemory as u64,
        software: desc.Flags & DXGI_ADAPTER_FLAG_SOFTWARE.0 as u32 != 0,
        driver,
    }
}

/// A LUID as a 64-bit number.
pub(super) fn luid_number(luid: LUID) -> u64 {
    u64::from(luid.HighPart.cast_unsigned()) << 32 | u64::from(luid.LowPart)
}

/// Whether an adapter supports Direct3D 12; creates no device.
fn supports_d3d12(adapter: &IDXGIAdapter1) -> bool {
    // SAFETY: a live adapter; with a null output pointer the call only checks whether a device can be created.
    unsafe { D3D12CreateDevice::<_, ID3D12Device>(adapter, D3D_FEATURE_LEVEL_11_0, std::ptr::null_mut()) }.is_ok()
}
