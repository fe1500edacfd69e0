//! The built-in seed picture: the start of a walk through a scene.

use cairn::world::ControlScript;
use cairn::{Error, ErrorKind, Picture, Result};
use scenes::{Clip, ClipOptions, Family, Scene};

/// The family of the level whose start the built-in seed picture shows.
pub(crate) const FAMILY: Family = Family::Desert;
/// The largest side that is rendered.
pub(crate) const MAX_SIDE: u32 = 8192;

/// Refuses sides that are not from 1 to [`MAX_SIDE`].
///
/// # Errors
/// `InvalidArgument`.
pub(crate) fn check(width: u32, height: u32) -> Result<()> {
    if [width, height].iter().all(|side| (1..=MAX_SIDE).contains(side)) {
        return Ok(());
    }
    Err(Error::new(ErrorKind::InvalidArgument, format!("a place cannot be drawn {width}x{height}"))
        .remedy(format!("Use a width and a height from 1 to {MAX_SIDE}, such as 1280x720")))
}

/// Renders the start of a walk through `scene`: `width` x `height` pixels that show 16:9. The same bytes on every machine.
///
/// # Errors
/// As [`check`].
pub(crate) fn draw(scene: &Scene, width: u32, height: u32) -> Result<Picture> {
    check(width, height)?;
    let still = ControlScript::parse("cairn-controls 1\n1 end\n")?;
    let options = ClipOptions { width, height, ..ClipOptions::default() };
    let mut clip = Clip::new(scene, &still, options)?;
    Ok(clip.frame()?.picture)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::level;

    #[test]
    fn it_is_the_first_picture_of_any_walk() {
        let (scene, script) = (level::scene(FAMILY), ControlScript::parse("cairn-controls 1\n0..1 hold W\n1 end\n"));
        let script = script.unwrap();
        let options = ClipOptions { width: 160, height: 90, rate: 15, ..ClipOptions::default() };
        let walked = Clip::new(&scene, &script, options).unwrap().frame().unwrap().picture;
        assert_eq!(draw(&scene, 160, 90).unwrap().rgba(), walked.rgba());
        assert_ne!(draw(&Scene::new(FAMILY, level::SEED + 1), 160, 90).unwrap().rgba(), walked.rgba());
    }

    #[test]
    fn sides_are_checked() {
        for (width, height) in [(0, 90), (160, MAX_SIDE + 1)] {
            let scene = Scene::new(FAMILY, 41);
            assert_eq!(draw(&scene, width, height).unwrap_err().kind(), ErrorKind::InvalidArgument);
        }
    }
}
