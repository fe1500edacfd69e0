//! Statistics of a graphics device's times, which systems without such a device report as zeros.

use std::time::Duration;

/// GPU time of frames or of a world's passes, each from its first to its last command. Work that the GPU runs at the same time is
/// included.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GpuTimeStatistics {
    /// Number of frames or passes measured.
    pub count: u64,
    /// Sum of their times.
    pub total: Duration,
    /// The longest time.
    pub longest: Duration,
    /// The latest time.
    pub last: Duration,
}
