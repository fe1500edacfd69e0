//! Pictures in the host's memory.

use std::ffi::c_void;

use super::results::{AbiResult, Failure};
use super::structs::{describe, read};
use crate::pixel_format::{PixelConverter, PixelFormat, swap_red_and_blue};
use crate::{Colours, Picture};

/// Four bytes to a pixel, red first; display-referred sRGB, alpha straight. The default.
pub const CAIRN_FORMAT_RGBA8: u32 = 0;
/// Four bytes to a pixel, blue first; otherwise the same.
pub const CAIRN_FORMAT_BGRA8: u32 = 1;
/// Four half floats to a pixel, red first: sRGB or linear 0 to 1, scRGB 0 to white_nits / 80; for targets only.
pub const CAIRN_FORMAT_RGBA16F: u32 = 2;

/// Four bytes to a pixel: ten bits each of red (lowest), green and blue, two of alpha; for targets only.
pub const CAIRN_FORMAT_RGB10A2: u32 = 3;

/// A picture in the host's memory, which the library reads during the call only.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_picture {
    /// sizeof(cairn_picture)
    pub struct_size: u32,
    /// CAIRN_FORMAT_RGBA8 or CAIRN_FORMAT_BGRA8
    pub format: u32,
    /// In pixels, 1 to 16384.
    pub width: u32,
    /// In pixels, 1 to 16384.
    pub height: u32,
    /// The top left pixel; rows run from top to bottom. Any alignment.
    pub pixels: *const c_void,
    /// Bytes that may be read from there.
    pub size: u64,
    /// Bytes from one row to the next; 0 for width * 4.
    pub row_pitch: u64,
}
describe!(cairn_picture, [], { struct_size, format, width, height, pixels, size, row_pitch });

/// Memory of the host into which the library writes a picture, during the call only. Bytes between rows are not changed.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct cairn_target {
    /// sizeof(cairn_target)
    pub struct_size: u32,
    /// CAIRN_FORMAT_RGBA8, CAIRN_FORMAT_BGRA8, CAIRN_FORMAT_RGBA16F or CAIRN_FORMAT_RGB10A2
    pub format: u32,
    /// In pixels; must be the picture's width.
    pub width: u32,
    /// In pixels; must be the picture's height.
    pub height: u32,
    /// The top left pixel; rows run from top to bottom. Any alignment.
    pub pixels: *mut c_void,
    /// Bytes that may be written from there.
    pub size: u64,
    /// Bytes from one row to the next; 0 for rows without a gap.
    pub row_pitch: u64,
}
describe!(cairn_target, [], { struct_size, format, width, height, pixels, size, row_pitch });

/// Layout of a picture in the host's memory.
#[derive(Debug, Clone, Copy)]
struct RowLayout {
    /// Bytes in a row.
    len: usize,
    count: usize,
    /// Bytes from one row to the next.
    pitch: usize,
}

impl RowLayout {
    /// Checks a layout; `field` names the struct, for messages.
    fn new(from: &cairn_picture, format: PixelFormat, field: &str) -> AbiResult<Self> {
        let cairn_picture { width, height, pixels, size, row_pitch: pitch, .. } = *from;
        let failure = |part: &str, why: String| Failure::argument(&format!("{field}.{part}"), why);
        let refuse = |part: &str, why: String| Err(failure(part, why));
        let sides = 1..=crate::MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) {
            let remedy = format!("Use 1 to {} each way", crate::MAX_SIDE);
            return Err(failure("width", format!("{width} x {height} pixels")).remedy(remedy));
        }
        if pixels.is_null() {
            return refuse("pixels", "a null pointer".into());
        }
        let row = u64::from(width) * format.bytes() as u64;
        let pitch = if pitch == 0 { row } else { pitch };
        if pitch < row {
            return refuse("row_pitch", format!("{pitch} bytes are less than a row of {row}"));
        }
        let needed = u128::from(pitch) * u128::from(height - 1) + u128::from(row);
        if u128::from(size) < needed || size > isize::MAX as u64 {
            return refuse("size", format!("{size} bytes, {needed} are needed"));
        }
        // The casts lose nothing: `size` is at least as large.
        Ok(Self { len: row as usize, count: height as usize, pitch: pitch as usize })
    }
}

/// The pixel format of the header's number; `field` names the struct, for messages.
fn texel(number: u32, field: &str) -> AbiResult<PixelFormat> {
    match number {
        CAIRN_FORMAT_RGBA8 => Ok(PixelFormat::Rgba8),
        CAIRN_FORMAT_BGRA8 => Ok(PixelFormat::Bgra8),
        CAIRN_FORMAT_RGBA16F => Ok(PixelFormat::Rgba16F),
        CAIRN_FORMAT_RGB10A2 => Ok(PixelFormat::Rgb10A2),
        other => Err(Failure::argument(&format!("{field}.format"), format!("{other} is no format of this library"))),
    }
}

/// Copies the host's picture.
///
/// # Safety
/// `from` is null or points to a readable struct whose pixels can be read as it says.
pub(super) unsafe fn read_picture(from: *const cairn_picture, name: &str) -> AbiResult<Picture> {
    // SAFETY: the caller's promise is the same.
    let from = unsafe { read(from, name) }?;
    let format = texel(from.format, name)?;
    if !matches!(format, PixelFormat::Rgba8 | PixelFormat::Bgra8) {
        return Err(Failure::argument(&format!("{name}.format"), "this format is for targets only"));
    }
    let rows = RowLayout::new(&from, format, name)?;
    let mut picture = Picture::new(from.width, from.height)?;
    for (i, row) in picture.rgba_mut().chunks_exact_mut(rows.len).enumerate() {
        // SAFETY: row `i` lies within the size that was checked, and the picture is memory of our own.
        unsafe { from.pixels.cast::<u8>().add(i * rows.pitch).copy_to_nonoverlapping(row.as_mut_ptr(), rows.len) };
        if format == PixelFormat::Bgra8 {
            swap_red_and_blue(row);
        }
    }
    Ok(picture)
}

/// The host's memory for a picture of a known size, checked before the work that produces the picture.
#[derive(Debug)]
pub(super) struct Target {
    pixels: *mut u8,
    rows: RowLayout,
    format: PixelFormat,
    colours: Colours,
}

impl Target {
    /// # Safety
    /// `to` is null or points to a readable struct whose pixels can be written as it says, as long as this lives.
    pub(super) unsafe fn new(to: *const cairn_target, size: (u32, u32), name: &str) -> AbiResult<Self> {
        // SAFETY: the caller's promise is the same.
        let cairn_target { struct_size, format, width, height, pixels, size: bytes, row_pitch } =
            unsafe { read(to, name) }?;
        let layout = cairn_picture { struct_size, format, width, height, pixels, size: bytes, row_pitch };
        let format = texel(format, name)?;
        let rows = RowLayout::new(&layout, format, name)?;
        if (width, height) != size {
            let why = format!("{width} x {height} pixels where {} x {} come", size.0, size.1);
            return Err(Failure::argument(&format!("{name}.width"), why));
        }
        Ok(Self { pixels: pixels.cast(), rows, format, colours: Colours::Srgb })
    }

    /// The same memory, for a picture in colour space `colours`. Fails if the format cannot hold it.
    pub(super) fn in_colours(self, colours: Colours) -> AbiResult<Self> {
        if !colours.fits(self.format) {
            let remedy = match colours {
                Colours::Hdr10 { .. } => "Use CAIRN_FORMAT_RGB10A2",
                _ => "Use CAIRN_FORMAT_RGBA16F",
            };
            let why = format!("it does not hold {colours:?}");
            return Err(Failure::argument("target.format", why).remedy(remedy));
        }
        Ok(Self { colours, ..self })
    }

    /// Writes a picture of the size that was checked.
    pub(super) fn write(self, picture: &Picture) {
        let Self { pixels, rows, format, colours } = self;
        let converter = PixelConverter::new(format, colours);
        let from = picture.rgba().chunks_exact(picture.width() as usize * 4);
        for (i, row) in from.take(rows.count).enumerate() {
            // SAFETY: row `i` lies within the size that was checked; nobody else uses it, by the promise of `new`.
            let to = unsafe {
                let to = pixels.add(i * rows.pitch);
                to.write_bytes(0, rows.len);
                std::slice::from_raw_parts_mut(to, rows.len)
            };
            converter.row(row, to);
        }
    }
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::super::results::CAIRN_ERROR_INVALID_ARGUMENT;
    use super::*;

    fn source(bytes: &[u8]) -> cairn_picture {
        cairn_picture {
            struct_size: size_of::<cairn_picture>() as u32,
            format: CAIRN_FORMAT_RGBA8,
            width: 2,
            height: 2,
            pixels: bytes.as_ptr().cast(),
            size: bytes.len() as u64,
            row_pitch: 0,
        }
    }

    #[test]
    fn pictures_are_copied_in_both_channel_orders_with_any_pitch() {
        let bytes: Vec<u8> = (1..=23).collect();
        let from = cairn_picture { format: CAIRN_FORMAT_BGRA8, row_pitch: 15, ..source(&bytes) };
        // SAFETY: 15 + 8 bytes are there.
        let picture = unsafe { read_picture(&from, "picture") }.unwrap();
        assert_eq!(picture.rgba(), [3, 2, 1, 4, 7, 6, 5, 8, 18, 17, 16, 19, 22, 21, 20, 23]);
        let mut back = [0_u8; 24];
        let to = cairn_target {
            struct_size: size_of::<cairn_target>() as u32,
            format: CAIRN_FORMAT_BGRA8,
            width: 2,
            height: 2,
            pixels: back.as_mut_ptr().cast(),
            size: 24,
            row_pitch: 16,
        };
        // SAFETY: the bytes are there.
        unsafe { Target::new(&to, (2, 2), "target") }.unwrap().write(&picture);
        assert_eq!(back[..8], bytes[..8]);
        assert_eq!(back[8..16], [0; 8]);
        assert_eq!(back[16..], bytes[15..]);
    }

    #[test]
    fn half_floats_are_written_as_srgb_or_as_linear_light() {
        let picture = Picture::from_rgba(1, 1, vec![0, 128, 255, 51]).unwrap();
        for (colours, middle) in [(Colours::Srgb, 128.0 / 255.0), (Colours::Linear, 0.215_86)] {
            let mut back = [0_u16; 4];
            let to = cairn_target {
                struct_size: size_of::<cairn_target>() as u32,
                format: CAIRN_FORMAT_RGBA16F,
                width: 1,
                height: 1,
                pixels: back.as_mut_ptr().cast(),
                size: 8,
                row_pitch: 0,
            };
            // SAFETY: the bytes are there.
            let target = |to: &cairn_target| unsafe { Target::new(to, (1, 1), "target") };
            target(&to).unwrap().in_colours(colours).unwrap().write(&picture);
            let [red, green, blue, alpha] = back.map(|bits| f16::from_bits(bits).to_f32());
            assert_eq!((red, blue), (0.0, 1.0));
            assert!((green - middle).abs() < 3e-4 && (alpha - 0.2).abs() < 1e-4, "{green} {alpha}");
            let eight = cairn_target { format: CAIRN_FORMAT_RGBA8, ..to };
            assert_eq!(target(&eight).unwrap().in_colours(colours).is_err(), colours == Colours::Linear);
            assert!(target(&cairn_target { size: 7, ..to }).is_err());
        }
    }

    #[test]
    fn refuses_invalid_layouts() {
        let bytes = [0_u8; 16];
        let good = source(&bytes);
        // SAFETY: 16 bytes are there, and a refused picture is not read.
        let result = |picture: cairn_picture| unsafe { read_picture(&picture, "p") }.map_err(|f| f.code);
        assert!(result(good).is_ok());
        for bad in [
            cairn_picture { width: 0, ..good },
            cairn_picture { height: 0, ..good },
            cairn_picture { width: 16_385, ..good },
            cairn_picture { height: u32::MAX, ..good },
            cairn_picture { pixels: std::ptr::null(), ..good },
            cairn_picture { size: 15, ..good },
            cairn_picture { size: u64::MAX, ..good },
            cairn_picture { row_pitch: 7, ..good },
            cairn_picture { row_pitch: 9, ..good },
            cairn_picture { row_pitch: u64::MAX, ..good },
            cairn_picture { format: CAIRN_FORMAT_RGBA16F, ..good },
            cairn_picture { format: CAIRN_FORMAT_RGB10A2, ..good },
            cairn_picture { format: 4, ..good },
            cairn_picture { width: 3, ..good },
        ] {
            assert_eq!(result(bad).unwrap_err(), CAIRN_ERROR_INVALID_ARGUMENT, "{bad:?}");
        }
    }
}
