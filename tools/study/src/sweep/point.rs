//! One combination of a sweep's axes.

use cairn::world::{OperatingPoint, Presentation};
use cairn::{Error, ErrorKind, Result};

use crate::generator::GeneratorChoice;
use crate::manifest::sha256;

/// Maximum number of points of a sweep.
pub(super) const MOST_POINTS: usize = 1_000;
/// Maximum length of a point's name; longer ones end in a digest.
pub(super) const LONGEST: usize = 120;

/// One combination of the axes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Point {
    pub(super) point: OperatingPoint,
    pub(super) generator: GeneratorChoice,
}

impl std::fmt::Display for Point {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.point.presentation {
            Presentation::Native => write!(f, "{}", self.point),
            Presentation::Generated { .. } => write!(f, "{},{}", self.point, self.generator),
        }
    }
}

impl Point {
    /// Folder name of the point, made from all its settings.
    pub(super) fn folder_name(&self) -> String {
        let name = self.to_string().replace([':', ','], "-");
        if name.len() <= LONGEST {
            return name;
        }
        let digest = sha256(name.as_bytes());
        format!("{}-{}", &name[..LONGEST - 13], &digest[..12])
    }

    /// Presented frames per anchor.
    pub(super) fn multiplier(&self) -> u32 {
        self.point.presented_rate() / self.point.latents_per_second.max(1)
    }
}

/// An error that names an item of the file.
pub(super) fn refused<T>(cause: String, field: &str, remedy: &str) -> Result<T> {
    Err(Error::new(ErrorKind::InvalidArgument, cause).field(field).remedy(remedy))
}
