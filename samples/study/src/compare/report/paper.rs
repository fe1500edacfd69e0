//! What the paper published: "Fewer, Better Frames", Tables 6 to 8. Order of the branches: coherence, baseline.

use scenes::Family;

/// A scene's published means.
pub(super) struct Published {
    /// LPIPS between anchors.
    pub(super) anchor_lpips: [f64; 2],
    /// LPIPS between presented frames.
    pub(super) adjacent_lpips: [f64; 2],
    /// SSIM between anchors.
    pub(super) anchor_ssim: [f64; 2],
    /// SSIM between presented frames.
    pub(super) adjacent_ssim: [f64; 2],
    /// Seconds until a turn was seen.
    pub(super) onset: [f64; 2],
}

/// The figures of a kind of place.
pub(super) fn published(family: Family) -> Published {
    let [anchor_lpips, adjacent_lpips, anchor_ssim, adjacent_ssim, onset] = match family {
        Family::Forest => [[0.0747, 0.0931], [0.0449, 0.0677], [0.5047, 0.5404], [0.7123, 0.6118], [0.467, 1.767]],
        Family::Sword => [[0.0664, 0.0753], [0.0404, 0.0568], [0.5729, 0.5779], [0.7192, 0.6014], [3.767, 2.300]],
        Family::Desert => [[0.0590, 0.0765], [0.0365, 0.0562], [0.6529, 0.6386], [0.7815, 0.6833], [0.533, 2.100]],
        Family::Snow => [[0.0763, 0.0959], [0.0480, 0.0660], [0.6364, 0.6324], [0.7856, 0.7283], [0.133, 1.567]],
    };
    Published { anchor_lpips, adjacent_lpips, anchor_ssim, adjacent_ssim, onset }
}
