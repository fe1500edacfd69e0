//! The page `docs/world.md`.

use std::path::PathBuf;

use cairn::{Picture, Result};

use crate::experiment::files::{docs, write_all};
use crate::experiment::provenance::stamped;
use media::{JpegQuality, encode_jpeg};

const INTRODUCTION: &str = "\
# The world inside the library

**The world knows four levels, and is judged on walks through them that it has not seen.** A level is [a procedural place](scenes.md) of 100 m by
100 m that hills close: a forest, a meadow seen over a sword, a desert and a snowfield. Training refused the held-out walks by their SHA-256. The row
*unseen* is for places outside the levels, which the world was not trained on: it can only guess what a walk comes to there.

The world is [as small as a game's texture](../samples/worlds/miniature/README.md), with Waypoint-1.5's architecture, trained on one GPU for 26
minutes. It gets the first true picture and the controls, and makes all other pictures. They are compared with rendered pictures of the same
walk, and with two baselines: repeating the last true picture, and the autoencoder's reconstruction of that picture.

**Where it loses:** the first table says which goals it misses, and by how much. The list below the second names each row and time at
which a still picture is nearer to the truth than the world. Pictures are softer than the true ones from the start, also because the network decodes 256 x 128
pixels of the 320 x 180 that are shown. Within seconds brightness and colour drift where the walk comes to what it has not shown; then the place is mostly of the right
kind, but seldom the right spot, and after a look away it is another one. No more than 26 minutes of a GPU could be used.
On three walks of each level, the second half of them brought LPIPS at half a second from .33 to .28 and detail in the first second from .60 to .68; brightness after
fifteen seconds became worse, 23 % off where it was 13 %.

## Its best walks

True pictures above, the world's below, in the walks where it gains most over repeating the first picture.

![truth and the world's pictures, side by side](images/world-good.jpg)

## Its worst walks

![truth and the world's pictures, side by side](images/world-bad.jpg)

## Figures

A figure is the mean over the walks of a row, *levels* over those of all four; in brackets is its 95 % interval, for shares of
yes and no Wilson's. PSNR is in
dB, LPIPS is that of AlexNet.

- **By second**: brightness, colour, contrast (standard deviation) and detail (difference of neighbouring pixels) over the second that ends there. Colour is off by
  the largest difference of the mean red, green or blue, in units of a byte; contrast and detail are those of the world over the truth's. The last picture and its
  reconstruction have the detail of the walk's start.
- **Kind and patch**: linear classifiers (ridge regression on the features of LPIPS's network) learnt from true pictures of the levels, taken every 5 m in
  twelve directions: which kind of place it is, and on which of the level's 16 patches of 25 m the walker stands. The shares are those of three pictures a second since the line above.
- **Discrepancy**: squared maximum mean discrepancy, with a Gaussian kernel, between the world's pictures and the true ones of the same seconds of the same walk,
  in the means of the features of LPIPS's network; 0 is the same distribution. Beside it: the true pictures of another walk through the same level.
- **Pose**: a search over the renderer's poses finds the one whose true picture is nearest. *World* is its distance from where the
  controls lead, *truth* the same for the true picture, so the search's own error, and *start* the distance of the walk's start, which is where repeating the first picture stays.
  Then: PSNR of the picture against the true picture of the pose found for it. Distances are medians.
- **Memory**: the camera turns away by 120 degrees at the walk's start, waits, and turns back. The place is right if the picture is nearer, by LPIPS, to the true one than to the
  starts of the level's other held-out walks and to the view while turned away. *At most* is the score of the reconstruction.
- **Controls**: mean motion of the world's pictures, as optical flow finds it, against the scene's own: across (turning), down (tilting), and out of the centre (walking);
  correlation over all latent steps, and size, 1 is as far. *Standing* is the mean length of the motion while the true walker stands still. Flicker is the mean change of brightness from picture to picture.

```text
";

/// Writes the page of the bundle with digest `world`, and its pictures, which are compressed, into the repository's docs.
///
/// # Errors
/// `Io`.
pub(super) fn publish(command: &str, text: &str, [good, bad]: [&Picture; 2], world: &str) -> Result<Vec<PathBuf>> {
    let docs = docs();
    let tables = text.trim_end();
    let page = format!("{INTRODUCTION}{tables}\n```\n\nThis page was written by:\n\n```sh\n{command}\n```\n");
    write_all(vec![
        (docs.join("world.md"), stamped(&page, Some(world)).into_bytes()),
        (docs.join("images/world-good.jpg"), encode_jpeg(good, JpegQuality::Repository)?),
        (docs.join("images/world-bad.jpg"), encode_jpeg(bad, JpegQuality::Repository)?),
    ])
}
