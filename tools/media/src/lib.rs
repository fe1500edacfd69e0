//! Writes presented frames as browser-playable video, as PNG pictures, or as raw video for other programs; and reads videos of other programs.
//!
//! Every file grows under a temporary name by complete units (a frame, a fragment) and is renamed when it is closed. A full disk costs only the
//! unit that is being written.
#![warn(missing_docs)]

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
pub use disk::{FileSystem, GrowingFile, OutputFile, RealDisk, describe_io, write_whole};
pub use format::{FrameRate, VideoFormat};
pub use from_yuv::{Chroma, FromYuv, Layout, Matrix};
pub use mp4::Mp4Sink;
pub use png::{JpegQuality, PngSink, encode_jpeg, encode_png, encode_small_png};
pub use recorder::{Frame, Recorder, RecorderReport, Sink, WrittenFile};
pub use y4m::Y4mSink;
pub use y4m_reader::{Y4M_MAGIC, Y4mHeader, Y4mReader, parse as y4m_header};
