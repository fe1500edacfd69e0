//! Small clips to interpolate: pictures that move, and the files they may come in.

use std::fmt::Write as _;
use std::path::Path;

use cairn::Picture;
use media::{RealDisk, Yuv420, encode_png, write_whole};

/// A textured picture that moves by 3 pixels a frame; another `place` is another picture altogether.
pub fn picture(size: (u32, u32), place: u32, number: u32) -> Picture {
    let mut picture = Picture::new(size.0, size.1).unwrap();
    let noise = |x: u32, y: u32| {
        let mixed = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ place.wrapping_mul(0xc2b2_ae3d);
        (mixed ^ mixed >> 15).wrapping_mul(0x2c1b_3c6d) >> 24
    };
    for (i, px) in picture.pixels_mut().iter_mut().enumerate() {
        let (x, y) = (i as u32 % size.0 + 3 * number + 1000 * place, i as u32 / size.0);
        // Patches of 8 x 8, with grain: large enough to be followed, small enough to be told apart.
        let value = |salt: u32| (3 * noise(x / 8 + salt, y / 8) + noise(x, y + salt)) as u8 / 4 + 20;
        px[..3].copy_from_slice(&[value(0), value(77), value(191)]);
    }
    picture
}

/// `count` of them.
pub fn walk(size: (u32, u32), count: u32) -> Vec<Picture> {
    (0..count).map(|number| picture(size, 1, number)).collect()
}

/// The pictures as a Y4M file's bytes, `rate` such as `30000:1001`.
pub fn y4m(pictures: &[Picture], rate: &str) -> Vec<u8> {
    let (width, height) = pictures[0].size();
    let mut header = String::new();
    write!(header, "YUV4MPEG2 W{width} H{height} F{rate} Ip A1:1 C420mpeg2 XCOLORMATRIX=BT709").unwrap();
    let mut bytes = (header + "\n").into_bytes();
    let mut planes = Yuv420::new(width, height).unwrap();
    for picture in pictures {
        planes.convert(picture).unwrap();
        bytes.extend_from_slice(b"FRAME\n");
        (0..3).for_each(|i| bytes.extend_from_slice(planes.plane(i)));
    }
    bytes
}

/// Stores the pictures as `1.png`, `2.png`, ..., so that their names in the order of letters are in another order.
pub fn store(folder: &Path, pictures: &[Picture]) {
    std::fs::create_dir_all(folder).unwrap();
    for (picture, number) in pictures.iter().zip(1..) {
        write_whole(&RealDisk, &folder.join(format!("{number}.png")), &encode_png(picture).unwrap()).unwrap();
    }
}

/// The pictures of a folder that a program numbered.
pub fn load(folder: &Path) -> Vec<Picture> {
    let numbered = (0..).map(|number| folder.join(format!("{number:06}.png")));
    numbered
        .take_while(|path| path.exists())
        .map(|path| {
            let image = image::open(path).unwrap().to_rgba8();
            Picture::from_rgba(image.width(), image.height(), image.into_raw()).unwrap()
        })
        .collect()
}
