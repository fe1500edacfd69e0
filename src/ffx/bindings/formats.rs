//! Pixel formats and resource states, and their values in DXGI and Direct3D 12. Plain numbers, so that they exist on every system.

use super::open_set;

/// Lists each format once: its ffx-api number, and the DXGI formats that map to it. It maps back to the first of these.
macro_rules! formats {
    ($( $word:ident = $value:literal: $($dxgi:literal),*; )*) => {
        open_set! {
            /// A pixel format.
            SurfaceFormat: u32 {
                $( #[doc = concat!("Number ", stringify!($value), ".")] $word = $value, )*
            }
        }

        /// Each format with the DXGI formats that map to it.
        const FORMATS: &[(SurfaceFormat, &[u32])] = &[$( (SurfaceFormat::$word, &[$($dxgi),*]) ),*];
    };
}

formats! {
    UNKNOWN = 0: 0;
    R32G32B32A32_TYPELESS = 1: 1;
    R32G32B32A32_UINT = 2: 3;
    R32G32B32A32_FLOAT = 3: 2;
    R16G16B16A16_FLOAT = 4: 10;
    R32G32B32_FLOAT = 5: 6;
    R32G32_FLOAT = 6: 16;
    // The stencil of a format with 24 or 32 bits of depth.
    R8_UINT = 7: 62, 47, 22;
    // Depth of 24 bits, with its stencil.
    R32_UINT = 8: 42, 44, 45, 46;
    R8G8B8A8_TYPELESS = 9: 27;
    R8G8B8A8_UNORM = 10: 28;
    R8G8B8A8_SNORM = 11: 31;
    R8G8B8A8_SRGB = 12: 29;
    B8G8R8A8_TYPELESS = 13: 90;
    B8G8R8A8_UNORM = 14: 87;
    B8G8R8A8_SRGB = 15: 91;
    R11G11B10_FLOAT = 16: 26;
    R10G10B10A2_UNORM = 17: 24;
    R16G16_FLOAT = 18: 34;
    R16G16_UINT = 19: 36;
    R16G16_SINT = 20: 38;
    R16_FLOAT = 21: 54;
    R16_UINT = 22: 57;
    R16_UNORM = 23: 56, 55;
    R16_SNORM = 24: 58;
    R8_UNORM = 25: 61, 65;
    R8G8_UNORM = 26: 49;
    R8G8_UINT = 27: 50;
    // Depth of 32 bits, with and without stencil.
    R32_FLOAT = 28: 41, 40, 19, 20, 21;
    R9G9B9E5 = 29: 67;
    R16G16B16A16_TYPELESS = 30: 9;
    R32G32_TYPELESS = 31: 15;
    R10G10B10A2_TYPELESS = 32: 23;
    R16G16_TYPELESS = 33: 33;
    R16_TYPELESS = 34: 53;
    R8_TYPELESS = 35: 60;
    R8G8_TYPELESS = 36: 48;
    R32_TYPELESS = 37: 39;
}

impl SurfaceFormat {
    /// The format for a DXGI_FORMAT; [`Self::UNKNOWN`] if ffx-api has none.
    pub fn from_dxgi(dxgi: u32) -> Self {
        FORMATS.iter().find(|(_, known)| known.contains(&dxgi)).map_or(Self::UNKNOWN, |(format, _)| *format)
    }

    /// Its DXGI_FORMAT; DXGI_FORMAT_UNKNOWN, 0, for an unknown number.
    pub fn to_dxgi(self) -> u32 {
        FORMATS.iter().find(|(format, _)| *format == self).map_or(0, |(_, known)| known[0])
    }

    /// The group of formats that may be combined for pictures with and without HUD: bits and encoding. None for a format that a
    /// frame generator does not accept.
    pub fn precision(self) -> Option<FormatPrecision> {
        Some(match self {
            Self::R32G32B32A32_TYPELESS | Self::R32G32B32A32_FLOAT | Self::R32G32B32_FLOAT => FormatPrecision::Float32,
            Self::R16G16B16A16_TYPELESS | Self::R16G16B16A16_FLOAT => FormatPrecision::Float16,
            Self::R11G11B10_FLOAT => FormatPrecision::Float11,
            Self::R9G9B9E5 => FormatPrecision::SharedExponent,
            Self::R10G10B10A2_TYPELESS | Self::R10G10B10A2_UNORM => FormatPrecision::Unorm10,
            Self::R8G8B8A8_TYPELESS | Self::R8G8B8A8_UNORM | Self::B8G8R8A8_TYPELESS | Self::B8G8R8A8_UNORM => {
                FormatPrecision::Unorm8
            }
            Self::R8G8B8A8_SRGB | Self::B8G8R8A8_SRGB => FormatPrecision::Srgb8,
            Self::R8G8B8A8_SNORM => FormatPrecision::Snorm8,
            _ => return None,
        })
    }
}

/// Groups of formats that a frame generator can copy between.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FormatPrecision {
    /// Floats of 32 bits.
    Float32,
    /// Floats of 16 bits.
    Float16,
    /// Floats of 11 and 10 bits.
    Float11,
    /// 9-bit mantissas with a shared exponent.
    SharedExponent,
    /// 10 bits, 0 to 1.
    Unorm10,
    /// 8 bits, 0 to 1.
    Unorm8,
    /// 8 bits, sRGB.
    Srgb8,
    /// 8 bits, -1 to 1.
    Snorm8,
}

/// Lists each state with its ffx-api and Direct3D 12 values.
macro_rules! states {
    ($( $(#[$about:meta])* $word:ident = $value:literal: $d3d12:literal; )*) => {
        open_set! {
            /// The state of a resource.
            ResourceState: u32 {
                $( $(#[$about])* $word = $value, )*
            }
        }

        /// Each state with its Direct3D 12 value.
        const STATES: &[(ResourceState, u32)] = &[$( (ResourceState::$word, $d3d12) ),*];
    };
}

states! {
    /// The common state.
    COMMON = 1: 0;
    /// Unordered access by shaders.
    UNORDERED_ACCESS = 2: 0x8;
    /// Read by compute shaders.
    COMPUTE_READ = 4: 0x40;
    /// Read by pixel shaders.
    PIXEL_READ = 8: 0x80;
    /// Read by shaders.
    PIXEL_COMPUTE_READ = 12: 0xc0;
    /// Copied from.
    COPY_SOURCE = 16: 0x800;
    /// Read by anything.
    GENERIC_READ = 20: 0xac3;
    /// Copied to.
    COPY_DESTINATION = 32: 0x400;
    /// Arguments of indirect draws.
    INDIRECT_ARGUMENT = 64: 0x200;
    /// About to be presented.
    PRESENT = 128: 0;
    /// Render target.
    RENDER_TARGET = 256: 0x4;
    /// Depth target. SDK 2.0 and later.
    DEPTH_ATTACHMENT = 512: 0x10;
}

impl ResourceState {
    /// The state for D3D12_RESOURCE_STATES. None for states that ffx-api lacks, such as depth read.
    pub fn from_d3d12(states: u32) -> Option<Self> {
        STATES.iter().find(|(_, known)| *known == states).map(|(state, _)| *state)
    }

    /// Its Direct3D 12 value. None for an unknown number.
    pub fn to_d3d12(self) -> Option<u32> {
        STATES.iter().find(|(state, _)| *state == self).map(|(_, known)| *known)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_there_and_back() {
        for &(format, dxgi) in FORMATS {
            assert_eq!(SurfaceFormat::from_dxgi(format.to_dxgi()), format);
            for &one in dxgi {
                assert_eq!(SurfaceFormat::from_dxgi(one), format);
            }
        }
        // ffx-api has no R8G8B8A8_UINT and no R16G16_UNORM.
        assert_eq!([30, 35, 1000].map(SurfaceFormat::from_dxgi), [SurfaceFormat::UNKNOWN; 3]);
        assert_eq!(SurfaceFormat(1000).to_dxgi(), 0);
        assert_eq!(format!("{:?} {:?}", SurfaceFormat::R8_UNORM, SurfaceFormat(1000)), "R8_UNORM 0x3e8");
        // The numbers have no gap, and no DXGI format maps to two formats.
        for (number, (format, _)) in (0..).zip(FORMATS) {
            assert_eq!(format.0, number);
        }
        let mut all: Vec<u32> = FORMATS.iter().flat_map(|(_, dxgi)| *dxgi).copied().collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
    }

    #[test]
    fn states_there_and_back() {
        for &(state, d3d12) in STATES {
            assert_eq!(state.to_d3d12(), Some(d3d12));
            let back = ResourceState::from_d3d12(d3d12);
            assert_eq!(back, Some(if state == ResourceState::PRESENT { ResourceState::COMMON } else { state }));
        }
        // ffx-api has no DEPTH_READ, and no such combined states.
        assert_eq!([0x20, 0xc, 0x60].map(ResourceState::from_d3d12), [None; 3]);
        assert_eq!(ResourceState(3).to_d3d12(), None);
    }

    #[test]
    fn formats_of_one_precision_can_be_combined() {
        use SurfaceFormat as F;
        assert_eq!(F::R8G8B8A8_UNORM.precision(), F::B8G8R8A8_UNORM.precision());
        assert_ne!(F::R8G8B8A8_UNORM.precision(), F::R8G8B8A8_SRGB.precision());
        assert_eq!([F::R8_UNORM, F::R32G32B32A32_UINT, F::UNKNOWN, F(99)].map(F::precision), [None; 4]);
    }
}
