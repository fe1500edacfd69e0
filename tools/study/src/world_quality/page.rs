//! The page `docs/world.md`.

use std::path::PathBuf;

use cairn::{Picture, Result};

use crate::experiment::files::{docs, write_all};
use crate::experiment::provenance::stamped;
use crate::media::{JpegQuality, encode_jpeg};

const INTRODUCTION: &str = "\
# The world inside the library

A world model [as small as a game's texture](../samples/worlds/miniature/README.md), with Waypoint-1.5's architecture. It was trained on walks through
[procedural places](scenes.md), rendered with the controls that caused them. This page tests it on places and walks that it was not trained on: it
gets the first true picture and the controls, and makes all other pictures. They are compared with rendered pictures of the same walk, and with two
baselines: repeating the last true picture, and the autoencoder's reconstruction of that picture, which has the same blur as the world's own pictures.

**Where it loses:** the list below the first table names each kind of place and time at which a still picture is nearer to the truth than the world.
By LPIPS most of that is the autoencoder's blur: the reconstruction of the last true picture is as far behind that picture as the world is. Nothing was
done about it here, because the autoencoder was made small on purpose; a larger one would have to be trained.

## Its best places

True pictures above, the world's below, in the places where it gains most over repeating the first picture.

![truth and the world's pictures, side by side](images/world-good.jpg)

## Its worst places

![truth and the world's pictures, side by side](images/world-bad.jpg)

## Figures

PSNR in dB, SSIM and LPIPS (AlexNet) are means over the places of a kind. Turning and tilting compare the mean motion of the world's pictures, as optical flow finds it, with the
scene's own: correlation over all latent steps, size (1 is as far as in truth) and the share of steps in the same direction. Flicker is the mean change of brightness from
picture to picture. The table by seconds shows how long a rollout stays good: brightness, contrast (standard deviation) and detail (difference of neighbours) of pictures of 64 x 36, the
mean over the second that ends there, over those of the truth; *farthest* and *least* are the worst place's, *±* is the standard error of the mean over the places.
*True places* is the standard deviation of the true pictures' brightness from place to place: a world cannot predict places that the walk has not
reached, so even one that keeps its mean brightness differs by this much in a single place. *Turning* is that since the line above. For the last table
the camera turns away by 120 degrees in the first place of each kind, waits, and turns back; *at most* is the score of the autoencoder's
reconstruction, *another place* that of a wrong place.

```text
";

/// Writes the page and its pictures, which are compressed, into the repository's docs.
///
/// # Errors
/// `Io`.
pub(super) fn publish(command: &str, text: &str, good: &Picture, bad: &Picture) -> Result<Vec<PathBuf>> {
    let docs = docs();
    let tables = text.trim_end();
    let page = format!("{INTRODUCTION}{tables}\n```\n\nThis page was written by:\n\n```sh\n{command}\n```\n");
    write_all(vec![
        (docs.join("world.md"), stamped(&page).into_bytes()),
        (docs.join("images/world-good.jpg"), encode_jpeg(good, JpegQuality::Repository)?),
        (docs.join("images/world-bad.jpg"), encode_jpeg(bad, JpegQuality::Repository)?),
    ])
}
