//! An independent AV1 decoder (rav1d) over an independent MP4 reader (re_mp4).

use std::path::Path;
use std::ptr::NonNull;

use rav1d::include::dav1d::data::Dav1dData;
use rav1d::include::dav1d::dav1d::{Dav1dContext, Dav1dSettings};
use rav1d::include::dav1d::headers::{DAV1D_CHR_VERTICAL, DAV1D_COLOR_PRI_BT709, DAV1D_MC_BT709, DAV1D_TRC_SRGB};
use rav1d::include::dav1d::picture::Dav1dPicture;
use rav1d::src::lib::{
    dav1d_close, dav1d_data_create, dav1d_default_settings, dav1d_get_picture, dav1d_open, dav1d_picture_unref,
    dav1d_send_data,
};

/// A decoded video.
pub struct Video {
    pub width: u32,
    pub height: u32,
    pub frames_per_second: f64,
    pub duration_seconds: f64,
    /// Which frames decoding can start at.
    pub keys: Vec<bool>,
    /// Luma of every frame, rows without padding.
    pub luma: Vec<Vec<u8>>,
}

/// Reads and decodes a whole MP4 file, and checks how its colour is described.
pub fn decode(path: &Path) -> Video {
    let bytes = std::fs::read(path).expect("the video is there");
    let mp4 = re_mp4::Mp4::read_bytes(&bytes).expect("the container is sound");
    assert_eq!(mp4.tracks().len(), 1);
    let track = mp4.tracks().values().next().unwrap();
    let re_mp4::StsdBoxContent::Av01(av01) = &track.trak(&mp4).mdia.minf.stbl.stsd.contents else {
        panic!("not AV1");
    };
    assert_eq!(av01.av1c.profile, 0);
    let mut decoder = Decoder::open();
    let mut luma = Vec::new();
    let mut times = Vec::new();
    for sample in &track.samples {
        let data = &bytes[sample.offset as usize..][..sample.size as usize];
        luma.extend(decoder.decode(data, (track.width.into(), track.height.into())));
        times.push(sample.decode_timestamp);
        assert_eq!(sample.decode_timestamp, sample.composition_timestamp);
    }
    let ticks = times.windows(2).map(|w| w[1] - w[0]).collect::<std::collections::BTreeSet<_>>();
    assert!(ticks.len() <= 1, "the frame rate is not constant: {ticks:?}");
    let tick = ticks.first().copied().unwrap_or(1);
    Video {
        width: track.width.into(),
        height: track.height.into(),
        frames_per_second: track.timescale as f64 / tick as f64,
        duration_seconds: track.duration as f64 / track.timescale as f64,
        keys: track.samples.iter().map(|s| s.is_sync).collect(),
        luma,
    }
}

struct Decoder(Option<Dav1dContext>);

impl Decoder {
    fn open() -> Self {
        let mut settings = std::mem::MaybeUninit::<Dav1dSettings>::uninit();
        // SAFETY: the pointer is valid for a write.
        unsafe { dav1d_default_settings(NonNull::from(&mut settings).cast()) };
        // SAFETY: the call above has written it.
        let mut settings = unsafe { settings.assume_init() };
        settings.n_threads = 1;
        settings.max_frame_delay = 1;
        let mut context = None;
        // SAFETY: both pointers are valid for the call.
        let result = unsafe { dav1d_open(Some(NonNull::from(&mut context)), Some(NonNull::from(&mut settings))) };
        assert_eq!(result.0, 0);
        Self(context)
    }

    /// Decodes one sample, which must be exactly one picture.
    fn decode(&mut self, sample: &[u8], size: (u32, u32)) -> Vec<Vec<u8>> {
        let mut data = Dav1dData::default();
        // SAFETY: `data` is valid for a write.
        let bytes = unsafe { dav1d_data_create(Some(NonNull::from(&mut data)), sample.len()) };
        assert!(!bytes.is_null());
        // SAFETY: the buffer has the sample's length and nobody else sees it yet.
        unsafe { std::ptr::copy_nonoverlapping(sample.as_ptr(), bytes, sample.len()) };
        // SAFETY: the context is open and `data` was made by the library.
        let sent = unsafe { dav1d_send_data(self.0, Some(NonNull::from(&mut data))) };
        assert_eq!(sent.0, 0, "the decoder refuses the sample");
        let mut planes = Vec::new();
        let mut picture = Dav1dPicture::default();
        loop {
            // SAFETY: the context is open and `picture` is valid for a write.
            let got = unsafe { dav1d_get_picture(self.0, Some(NonNull::from(&mut picture))) };
            if got.0 != 0 {
                break;
            }
            assert_eq!((picture.p.w as u32, picture.p.h as u32), size);
            // SAFETY: a decoded picture points to its sequence header.
            let header = unsafe { picture.seq_hdr.unwrap().as_ref() };
            assert_eq!((header.pri, header.trc), (DAV1D_COLOR_PRI_BT709, DAV1D_TRC_SRGB));
            assert_eq!((header.mtrx, header.chr, header.color_range), (DAV1D_MC_BT709, DAV1D_CHR_VERTICAL, 0));
            let (width, height, stride) = (size.0 as usize, size.1 as usize, picture.stride[0]);
            let first = picture.data[0].unwrap().cast::<u8>().as_ptr();
            let mut luma = Vec::with_capacity(width * height);
            for row in 0..height {
                // SAFETY: row `row` of the luma plane begins `row * stride` bytes behind its first byte.
                let start = unsafe { first.offset(row as isize * stride) };
                // SAFETY: a row holds at least `width` bytes, and the picture is alive.
                luma.extend_from_slice(unsafe { std::slice::from_raw_parts(start, width) });
            }
            planes.push(luma);
            // SAFETY: the picture came from the decoder.
            unsafe { dav1d_picture_unref(Some(NonNull::from(&mut picture))) };
        }
        assert_eq!(planes.len(), 1, "one sample is one picture");
        planes
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        // SAFETY: the context is open and is closed only here.
        unsafe { dav1d_close(Some(NonNull::from(&mut self.0))) };
    }
}

/// Peak signal-to-noise ratio of two planes, in dB.
pub fn psnr(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
    10.0 * (255.0 * 255.0 * a.len() as f64 / sum.max(1e-9)).log10()
}
