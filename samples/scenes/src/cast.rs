//! Which moving things a scene has.

use std::fmt;
use std::str::FromStr;

/// The moving things of a scene. Each is placed from the scene's seed along the walk of the family's script, and none changes the place itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Cast {
    /// Walking figures with limbs.
    pub figures: bool,
    /// A flock of birds with beating wings.
    pub birds: bool,
    /// A rolling ball, and boxes that fall and bounce.
    pub bodies: bool,
    /// Wind that bends grass, bushes and trees. Without effect where nothing grows.
    pub wind: bool,
    /// Gates and doors that open and close.
    pub doors: bool,
    /// Moving lights: a headlamp, and a lantern in the hand of the first figure (with [`figures`](Self::figures)).
    pub lights: bool,
    /// Smoke and sparks, and flakes or dust in the air: alpha-blended, without motion of their own.
    pub particles: bool,
    /// A weapon's muzzle that flashes in view, with its light on the surroundings.
    pub flashes: bool,
    /// A basin or puddles with rippling water that mirrors the scene.
    pub water: bool,
}

/// Names of the members with access to their switches.
type Member = (&'static str, fn(&mut Cast) -> &mut bool);

const MEMBERS: [Member; 9] = [
    ("figures", |cast| &mut cast.figures),
    ("birds", |cast| &mut cast.birds),
    ("bodies", |cast| &mut cast.bodies),
    ("wind", |cast| &mut cast.wind),
    ("doors", |cast| &mut cast.doors),
    ("lights", |cast| &mut cast.lights),
    ("particles", |cast| &mut cast.particles),
    ("flashes", |cast| &mut cast.flashes),
    ("water", |cast| &mut cast.water),
];

impl Cast {
    /// Nothing moves but the camera.
    pub const fn none() -> Self {
        Self::uniform(false)
    }

    /// Everything that can move does.
    pub const fn all() -> Self {
        Self::uniform(true)
    }

    const fn uniform(on: bool) -> Self {
        Self {
            figures: on,
            birds: on,
            bodies: on,
            wind: on,
            doors: on,
            lights: on,
            particles: on,
            flashes: on,
            water: on,
        }
    }
}

impl fmt::Display for Cast {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::none() || *self == Self::all() {
            return f.write_str(if self.figures { "all" } else { "none" });
        }
        let mut this = *self;
        let names: Vec<&str> = MEMBERS.iter().filter(|(_, has)| *has(&mut this)).map(|(name, _)| *name).collect();
        f.write_str(&names.join(","))
    }
}

impl FromStr for Cast {
    type Err = String;

    /// Reads `all`, `none`, or names of members with commas between them.
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "all" => return Ok(Self::all()),
            "none" => return Ok(Self::none()),
            _ => {}
        }
        let mut cast = Self::none();
        for name in text.split(',') {
            let Some((_, member)) = MEMBERS.iter().find(|(known, _)| *known == name.trim()) else {
                let known = MEMBERS.map(|(known, _)| known).join(", ");
                return Err(format!(
                    "{name} is no moving thing. Use all, none, or some of {known} with commas between"
                ));
            };
            *member(&mut cast) = true;
        }
        Ok(cast)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cast_is_read_as_it_is_written() {
        for text in ["all", "none", "figures", "birds,wind", "bodies,doors,lights"] {
            assert_eq!(text.parse::<Cast>().unwrap().to_string(), text);
        }
        assert!("figures,ghosts".parse::<Cast>().is_err() && "".parse::<Cast>().is_err());
    }
}
