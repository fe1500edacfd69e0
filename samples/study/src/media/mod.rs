//! Where presented frames go: video that a browser plays, loose pictures, and raw video for other programs; and where
//! frames of others come from.
//!
//! Every file grows under a temporary name by whole units (a frame, a fragment) and gets its own name when it is
//! closed. A disk that fills up costs the unit being written, never what was complete before.

mod av1;
mod colour;
mod disk;
mod format;
mod from_yuv;
mod mp4;
mod mp4_boxes;
mod png;
mod recorder;
mod y4m;
mod y4m_reader;

pub use av1::{ASSEMBLY, ENCODER};
pub use colour::Yuv420;
pub use disk::{Disk, GrowingFile, RealDisk, Store, describe_io, write_whole};
pub use format::{FrameRate, VideoFormat};
pub use from_yuv::{Chroma, FromYuv, Layout, Matrix};
pub use mp4::Mp4Sink;
pub(crate) use png::encode_jpeg;
pub use png::{PngSink, encode_png, encode_small_png};
pub use recorder::{Frame, Recorded, Recorder, Sink, Written};
pub use y4m::Y4mSink;
pub use y4m_reader::{Y4M_MAGIC, Y4mHeader, Y4mReader};
