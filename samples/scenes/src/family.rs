//! The four families of scenes, with their light and atmosphere.

use std::fmt;
use std::str::FromStr;

use glam::Vec3;

/// A family of scenes: one kind of landscape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Family {
    /// A path between trunks under shallow fog.
    Forest,
    /// A hillside path with a sword held in view.
    Sword,
    /// A road between cacti, mesas on the horizon.
    Desert,
    /// Tracks through bright snow and firs.
    Snow,
}

/// The four landscapes, in the order they are shown: the kinds of place of the paper's experiment and of the embedded world.
pub const LANDSCAPES: [Family; 4] = [Family::Forest, Family::Sword, Family::Desert, Family::Snow];

/// Light and atmosphere of a scene. Colours are linear RGB.
#[derive(Debug, Clone, Copy)]
pub struct Weather {
    /// Unit vector towards the sun.
    pub sun: Vec3,
    /// Light of the sun.
    pub sun_light: Vec3,
    /// Light of the sky from above.
    pub sky_light: Vec3,
    /// Light reflected by the ground.
    pub ground_light: Vec3,
    /// Colour of the sky at the zenith.
    pub zenith: Vec3,
    /// Colour of the sky at the horizon, and of fog.
    pub horizon: Vec3,
    /// Fog density per metre.
    pub fog: f32,
    /// Cloud cover, 0 to 1.
    pub clouds: f32,
    /// Exposure: factor on linear light; its reciprocal is the linear value that becomes full white.
    pub exposure: f32,
}

impl Family {
    /// Light and atmosphere of this family; `rotation` is added to the sun's azimuth, in radians.
    pub fn weather(self, rotation: f32) -> Weather {
        let sun = |azimuth: f32, height: f32| {
            let (sh, ch) = height.to_radians().sin_cos();
            let (sa, ca) = (azimuth.to_radians() + rotation).sin_cos();
            Vec3::new(sa * ch, sh, ca * ch)
        };
        match self {
            Self::Forest => Weather {
                sun: sun(-48.0, 38.0),
                sun_light: Vec3::new(3.3, 2.8, 2.0),
                sky_light: Vec3::new(0.46, 0.56, 0.60),
                ground_light: Vec3::new(0.13, 0.12, 0.07),
                zenith: Vec3::new(0.42, 0.58, 0.72),
                horizon: Vec3::new(0.62, 0.69, 0.66),
                fog: 0.017,
                clouds: 0.5,
                exposure: 1.0,
            },
            Self::Sword => Weather {
                sun: sun(-62.0, 34.0),
                sun_light: Vec3::new(3.6, 3.0, 2.2),
                sky_light: Vec3::new(0.42, 0.54, 0.74),
                ground_light: Vec3::new(0.16, 0.15, 0.08),
                zenith: Vec3::new(0.16, 0.34, 0.72),
                horizon: Vec3::new(0.66, 0.76, 0.86),
                fog: 0.0022,
                clouds: 0.55,
                exposure: 0.84,
            },
            Self::Desert => Weather {
                sun: sun(55.0, 42.0),
                sun_light: Vec3::new(3.8, 3.2, 2.4),
                sky_light: Vec3::new(0.40, 0.50, 0.68),
                ground_light: Vec3::new(0.34, 0.25, 0.15),
                zenith: Vec3::new(0.14, 0.33, 0.68),
                horizon: Vec3::new(0.80, 0.76, 0.68),
                fog: 0.0016,
                clouds: 0.22,
                exposure: 0.70,
            },
            Self::Snow => Weather {
                sun: sun(40.0, 24.0),
                sun_light: Vec3::new(2.5, 2.15, 1.75),
                sky_light: Vec3::new(0.42, 0.52, 0.70),
                ground_light: Vec3::new(0.32, 0.35, 0.42),
                zenith: Vec3::new(0.30, 0.46, 0.70),
                horizon: Vec3::new(0.74, 0.79, 0.85),
                fog: 0.006,
                clouds: 0.62,
                exposure: 0.72,
            },
        }
    }

    /// Its name, lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Forest => "forest",
            Self::Sword => "sword",
            Self::Desert => "desert",
            Self::Snow => "snow",
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Family {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        LANDSCAPES
            .into_iter()
            .find(|f| f.name() == text)
            .ok_or_else(|| format!("{text} is no scene. Use forest, sword, desert or snow"))
    }
}
