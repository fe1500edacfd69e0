//! Where presented frames go: video that a browser plays, loose pictures, and raw video for other programs.
//!
//! Every file grows under a temporary name by whole units (a frame, a fragment) and gets its own name when it is
//! closed. A disk that fills up costs the unit being written, never what was complete before.

mod av1;
mod colour;
mod disk;
mod format;
mod mp4;
mod mp4_boxes;
mod png;
mod recorder;
mod y4m;

pub use av1::{ASSEMBLY, ENCODER};
pub use colour::Yuv420;
pub use disk::{Disk, GrowingFile, RealDisk, Store, describe_io, write_whole};
pub use format::{FrameRate, VideoFormat};
pub use mp4::Mp4Sink;
pub use png::{PngSink, encode_png};
pub use recorder::{Frame, Recorded, Recorder, Sink, Written};
pub use y4m::Y4mSink;
