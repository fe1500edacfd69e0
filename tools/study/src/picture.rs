//! Decodes and resizes pictures.

use std::io::{BufRead, Cursor, Seek};

use cairn::{Error, ErrorKind, MAX_SIDE, Picture, Result};
use image::imageops::FilterType;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits, RgbaImage};

/// Maximum memory of a decoded picture, in bytes.
const MAX_DECODED: u64 = 2 << 30;

/// Reads a PNG or JPEG file of any size, rotated by its EXIF orientation, over black where it is transparent.
///
/// # Errors
/// `InvalidArgument` for another kind of file, or a picture larger than [`MAX_SIDE`].
pub(crate) fn decode(bytes: &[u8]) -> Result<Picture> {
    let (decoder, orientation) = open(Cursor::new(bytes))?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(no_picture)?;
    image.apply_orientation(orientation);
    let mut image = image.into_rgba8();
    for px in image.pixels_mut() {
        let alpha = u32::from(px.0[3]);
        for c in &mut px.0[..3] {
            *c = ((u32::from(*c) * alpha + 127) / 255) as u8;
        }
        px.0[3] = 255;
    }
    let (width, height) = image.dimensions();
    Picture::from_rgba(width, height, image.into_raw())
}

/// The size that [`decode`] would return; reads only the file's header.
///
/// # Errors
/// As [`decode`].
pub(crate) fn size(file: impl BufRead + Seek) -> Result<(u32, u32)> {
    let (decoder, orientation) = open(file)?;
    let (width, height) = decoder.dimensions();
    let turned = matches!(
        orientation,
        Orientation::Rotate90 | Orientation::Rotate270 | Orientation::Rotate90FlipH | Orientation::Rotate270FlipH
    );
    Ok(if turned { (height, width) } else { (width, height) })
}

fn open<'a>(file: impl BufRead + Seek + 'a) -> Result<(impl ImageDecoder + 'a, Orientation)> {
    let mut reader = ImageReader::new(file).with_guessed_format().map_err(no_picture)?;
    if reader.format().is_none() {
        return Err(no_picture("it starts like neither a PNG nor a JPEG file"));
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_DECODED);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(no_picture)?;
    let orientation = decoder.orientation().map_err(no_picture)?;
    Ok((decoder, orientation))
}

fn no_picture(cause: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::InvalidArgument, format!("it is no picture that can be read: {cause}"))
        .remedy(format!("Use a PNG or JPEG file of at most {MAX_SIDE} x {MAX_SIDE} pixels"))
}

/// `picture` scaled to cover `size`, with the excess cropped equally on both sides.
///
/// # Errors
/// As [`Picture::new`].
pub(crate) fn cover(picture: &Picture, size: (u32, u32)) -> Result<Picture> {
    let (width, height) = (u64::from(picture.width()), u64::from(picture.height()));
    let (to_width, to_height) = (u64::from(size.0), u64::from(size.1));
    // The largest part of the picture with the aspect of `size`.
    let (part_width, part_height) = if width * to_height > height * to_width {
        (((height * to_width) / to_height).max(1), height)
    } else {
        (width, ((width * to_height) / to_width).max(1))
    };
    let image = to_image(picture)?;
    let (x, y) = ((width - part_width) / 2, (height - part_height) / 2);
    let part = image::imageops::crop_imm(&image, x as u32, y as u32, part_width as u32, part_height as u32);
    let scaled = image::imageops::resize(&*part, size.0, size.1, FilterType::Lanczos3);
    Picture::from_rgba(size.0, size.1, scaled.into_raw())
}

/// An opaque picture of one colour to draw on.
///
/// # Errors
/// As [`Picture::new`].
pub(crate) fn canvas((width, height): (u32, u32), [red, green, blue]: [u8; 3]) -> Result<Picture> {
    let mut canvas = Picture::new(width, height)?;
    canvas.pixels_mut().fill([red, green, blue, 255]);
    Ok(canvas)
}

/// Copies `tile` to `at`.
pub(crate) fn paste(out: &mut Picture, tile: &Picture, at: (u32, u32)) {
    let width = out.width() as usize;
    for (y, pixels) in tile.pixels().chunks_exact(tile.width() as usize).enumerate() {
        let start = (at.1 as usize + y) * width + at.0 as usize;
        out.pixels_mut()[start..start + pixels.len()].copy_from_slice(pixels);
    }
}

/// `picture` at a smaller size, averaged.
///
/// # Errors
/// As [`Picture::new`].
pub(crate) fn shrink(picture: &Picture, size: (u32, u32)) -> Result<Picture> {
    let scaled = image::imageops::resize(&to_image(picture)?, size.0, size.1, FilterType::Triangle);
    Picture::from_rgba(size.0, size.1, scaled.into_raw())
}

fn to_image(picture: &Picture) -> Result<RgbaImage> {
    RgbaImage::from_raw(picture.width(), picture.height(), picture.rgba().to_vec())
        .ok_or_else(|| Error::new(ErrorKind::InvalidArgument, format!("{picture:?} has a wrong number of bytes")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<u8> {
        let image = RgbaImage::from_fn(width, height, |x, y| image::Rgba(pixel(x, y)));
        let mut bytes = Vec::new();
        image.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
        bytes
    }

    #[test]
    fn a_wide_picture_loses_its_sides_and_a_high_one_top_and_bottom() {
        let red_middle = |at: u32, of: u32| if at >= of / 4 && at < of * 3 / 4 { [255, 0, 0, 255] } else { [0; 4] };
        let wide = decode(&png(80, 20, |x, _| red_middle(x, 80))).unwrap();
        let high = decode(&png(20, 80, |_, y| red_middle(y, 80))).unwrap();
        for picture in [wide, high] {
            let out = cover(&picture, (32, 18)).unwrap();
            assert_eq!(out.size(), (32, 18));
            assert!(out.pixels().iter().all(|px| px[0] > 250 && px[1] == 0), "only the middle is left");
        }
    }

    #[test]
    fn transparency_lies_on_black() {
        let picture = decode(&png(1, 1, |_, _| [200, 100, 50, 128])).unwrap();
        assert_eq!(picture.pixels()[0], [100, 50, 25, 255]);
    }

    #[test]
    fn what_is_no_picture_is_refused_with_a_remedy() {
        let mut cut = png(40, 40, |x, y| [x as u8, y as u8, 0, 255]);
        cut.truncate(60);
        for bytes in [&b""[..], b"hello", &cut] {
            let error = decode(bytes).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidArgument);
            assert!(error.to_string().contains("PNG or JPEG"), "{error}");
        }
    }

    #[test]
    fn a_picture_that_claims_a_huge_size_is_refused_before_it_is_allocated() {
        let mut bytes = png(4, 4, |_, _| [9; 4]);
        // Width and height of the IHDR chunk, and its checksum.
        bytes[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
        let crc = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.to_be_bytes());
        assert!(decode(&bytes).unwrap_err().to_string().contains("16384"));
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0u32, |crc, &b| {
            (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        })
    }
}
