//! Figure of one interval from 10 to 60 frames a second: true frames above generated ones, for the renderer's anchors and the world's own.

use cairn::{Picture, Result};

use super::measure::{Source, Strip};
use crate::experiment::tiles::{Layout, Tiles};
use crate::scene_id::SceneId;

const LAYOUT: Layout = Layout { tile: (160, 90), gap: 6, left: 128 };

/// Caption of the figure.
pub(super) fn caption(scene: SceneId) -> String {
    format!(
        "{scene}: the first interval that was scored. Left and right are the anchors; between them the true frames above and the \
         generated ones below, with motion from pictures."
    )
}

/// Draws the strips, two rows each.
pub(super) fn draw(strips: &[Strip]) -> Result<Picture> {
    let columns = strips.iter().map(|strip| strip.truth.len()).max().unwrap_or(0).max(1);
    let label = |n: usize| match n {
        0 => "anchor".to_owned(),
        n if n + 1 == columns => "next anchor".to_owned(),
        n => format!("{n}/{}", columns - 1),
    };
    let labels: Vec<String> = (0..columns).map(label).collect();
    let mut tiles = Tiles::new(LAYOUT, &labels, 2 * strips.len().max(1) as u32)?;
    for (strip, first) in strips.iter().zip((0..).step_by(2)) {
        let truth = match strip.source {
            Source::Drawn => "renderer",
            Source::World => "decoder",
        };
        tiles.row(first, truth, &strip.truth)?;
        tiles.row(first + 1, "made", &strip.made)?;
    }
    Ok(tiles.finish())
}
