//! Shader resources and their views.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;
use windows::core::Interface;

use crate::gpu::{Gpu, failed_on};
use crate::{Error, ErrorKind, MAX_SIDE, Result};

/// A resource and its state outside of a frame: all subresources are in that state before and after the frame's commands. The frame
/// holds a reference until they have run.
#[derive(Clone, Copy)]
pub struct ResourceWithState<'a> {
    /// A resource of the device.
    pub resource: &'a ID3D12Resource,
    /// On a compute queue it must be a state that such a queue supports.
    pub state: D3D12_RESOURCE_STATES,
}

/// A resource with the view through which a shader accesses it.
#[derive(Clone, Copy)]
pub(crate) enum View<'a> {
    /// A range of a buffer as `ByteAddressBuffer` or `RWByteAddressBuffer`.
    Buffer(ResourceWithState<'a>, WordRange),
    /// The first mip level of a 2D texture.
    Texture(ResourceWithState<'a>, DXGI_FORMAT),
}

/// A range of 32-bit words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct WordRange {
    pub(crate) first: u32,
    pub(crate) count: u32,
}

/// A checked texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Texture {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// View format: for a typeless texture the variant without sRGB.
    pub(crate) format: DXGI_FORMAT,
}

impl<'a> View<'a> {
    /// The resource with its state.
    pub(super) fn resource(&self) -> ResourceWithState<'a> {
        match *self {
            Self::Buffer(given, _) | Self::Texture(given, _) => given,
        }
    }

    /// Address of its resource, which identifies the resource as long as it lives.
    pub(crate) fn address(&self) -> usize {
        self.resource().resource.as_raw() as usize
    }

    /// Writes its shader resource view.
    pub(super) fn describe_input(&self, device: &ID3D12Device, at: D3D12_CPU_DESCRIPTOR_HANDLE) {
        let mut wanted = D3D12_SHADER_RESOURCE_VIEW_DESC {
            Shader4ComponentMapping: D3D12_DEFAULT_SHADER_4_COMPONENT_MAPPING,
            ..Default::default()
        };
        match *self {
            Self::Buffer(_, WordRange { first, count }) => {
                wanted.Format = DXGI_FORMAT_R32_TYPELESS;
                wanted.ViewDimension = D3D12_SRV_DIMENSION_BUFFER;
                wanted.Anonymous.Buffer = D3D12_BUFFER_SRV {
                    FirstElement: u64::from(first),
                    NumElements: count,
                    StructureByteStride: 0,
                    Flags: D3D12_BUFFER_SRV_FLAG_RAW,
                };
            }
            Self::Texture(_, format) => {
                wanted.Format = format;
                wanted.ViewDimension = D3D12_SRV_DIMENSION_TEXTURE2D;
                wanted.Anonymous.Texture2D = D3D12_TEX2D_SRV { MipLevels: 1, ..Default::default() };
            }
        }
        // SAFETY: a live device and resource, a view description that fits the resource, and a descriptor in a heap of ours.
        unsafe { device.CreateShaderResourceView(self.resource().resource, Some(&wanted), at) };
    }

    /// Writes its unordered access view.
    pub(super) fn describe_output(&self, device: &ID3D12Device, at: D3D12_CPU_DESCRIPTOR_HANDLE) {
        let mut wanted = D3D12_UNORDERED_ACCESS_VIEW_DESC::default();
        match *self {
            Self::Buffer(_, WordRange { first, count }) => {
                wanted.Format = DXGI_FORMAT_R32_TYPELESS;
                wanted.ViewDimension = D3D12_UAV_DIMENSION_BUFFER;
                wanted.Anonymous.Buffer = D3D12_BUFFER_UAV {
                    FirstElement: u64::from(first),
                    NumElements: count,
                    Flags: D3D12_BUFFER_UAV_FLAG_RAW,
                    ..Default::default()
                };
            }
            Self::Texture(_, format) => {
                wanted.Format = format;
                wanted.ViewDimension = D3D12_UAV_DIMENSION_TEXTURE2D;
            }
        }
        // SAFETY: as above.
        unsafe { device.CreateUnorderedAccessView(self.resource().resource, None, Some(&wanted), at) };
    }
}

impl ResourceWithState<'_> {
    /// Checks that it is a buffer of at least `bytes` bytes.
    ///
    /// # Errors
    /// `InvalidArgument`, of `field`, if it belongs to another device, is no buffer, or is shorter.
    pub(crate) fn buffer(&self, gpu: &Gpu, bytes: u64, field: &str) -> Result<()> {
        gpu.owns(self.resource, field)?;
        // SAFETY: a live resource.
        let found = unsafe { self.resource.GetDesc() };
        let why = if found.Dimension != D3D12_RESOURCE_DIMENSION_BUFFER {
            "it is no buffer".to_owned()
        } else if found.Width < bytes {
            format!("it has {} bytes, less than the {bytes} that are used", found.Width)
        } else {
            return Ok(());
        };
        Err(Error::new(ErrorKind::InvalidArgument, why).field(field))
    }
}

/// Checks a texture that a shader writes in one of `formats`.
///
/// # Errors
/// `InvalidArgument`, of `field`, if it belongs to another device, has another format, more than one sample, level or layer, or does not
/// allow unordered access; `Unsupported` if the device cannot store that format from a shader.
pub(crate) fn texture(
    gpu: &Gpu,
    given: &ResourceWithState<'_>,
    formats: &[DXGI_FORMAT],
    field: &str,
) -> Result<Texture> {
    gpu.owns(given.resource, field)?;
    // SAFETY: a live resource.
    let found = unsafe { given.resource.GetDesc() };
    let refuse = |why: String, remedy: &str| {
        Err(Error::new(ErrorKind::InvalidArgument, why).field(field).remedy(remedy.to_owned()))
    };
    let one = found.SampleDesc.Count == 1 && found.MipLevels == 1 && found.DepthOrArraySize == 1;
    if found.Dimension != D3D12_RESOURCE_DIMENSION_TEXTURE2D || !one {
        return refuse("it is no texture of two dimensions with one sample, level and layer".to_owned(), "Use one");
    }
    let format = untyped(found.Format);
    if !formats.contains(&format) {
        return refuse(format!("DXGI format {} is not written", found.Format.0), "Use a format that is documented");
    }
    if found.Flags & D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS == D3D12_RESOURCE_FLAG_NONE {
        let remedy = "Make it with D3D12_RESOURCE_FLAG_ALLOW_UNORDERED_ACCESS, or write into one that is and copy";
        return refuse("it was not made to be written by shaders".to_owned(), remedy);
    }
    let (Ok(width), height) = (u32::try_from(found.Width), found.Height) else {
        return refuse(format!("it is {} pixels wide", found.Width), "Use a smaller one");
    };
    if width > MAX_SIDE || height > MAX_SIDE {
        return refuse(format!("it has {width} x {height} pixels"), "Use a smaller one");
    }
    if !stores(gpu, format)? {
        let why = format!("this device cannot write DXGI format {} from a shader", format.0);
        return Err(Error::new(ErrorKind::Unsupported, why).field(field).remedy("Use another format"));
    }
    Ok(Texture { width, height, format })
}

/// The format that a shader writes to a typeless texture.
pub(crate) fn untyped(format: DXGI_FORMAT) -> DXGI_FORMAT {
    match format {
        DXGI_FORMAT_R8G8B8A8_TYPELESS => DXGI_FORMAT_R8G8B8A8_UNORM,
        DXGI_FORMAT_B8G8R8A8_TYPELESS => DXGI_FORMAT_B8G8R8A8_UNORM,
        DXGI_FORMAT_R10G10B10A2_TYPELESS => DXGI_FORMAT_R10G10B10A2_UNORM,
        DXGI_FORMAT_R16G16B16A16_TYPELESS => DXGI_FORMAT_R16G16B16A16_FLOAT,
        other => other,
    }
}

/// Whether shaders can write a format on this device.
fn stores(gpu: &Gpu, format: DXGI_FORMAT) -> Result<bool> {
    let mut support = D3D12_FEATURE_DATA_FORMAT_SUPPORT { Format: format, ..Default::default() };
    let (output, size) = ((&raw mut support).cast(), size_of_val(&support) as u32);
    // SAFETY: a live device, and an output struct of that size that lives during the call.
    unsafe { gpu.device().CheckFeatureSupport(D3D12_FEATURE_FORMAT_SUPPORT, output, size) }
        .map_err(|e| failed_on(gpu.device(), "ID3D12Device::CheckFeatureSupport", &e))?;
    Ok(support.Support2.contains(D3D12_FORMAT_SUPPORT2_UAV_TYPED_STORE))
}
