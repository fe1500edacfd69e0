//! Shared test code of `world`: the manifest of a small world, and a seeded random number generator.

use crate::bundle::Manifest;

/// The parity geometry: 8 tokens, 4 local slots, dilation 4, 4 global slots at the stock window 16.
pub(crate) fn manifest() -> Manifest {
    serde_json::from_value(serde_json::json!({
        "schema_version": 1,
        "name": "test",
        "model_type": "waypoint-1.5",
        "geometry": {
            "layers": 8, "width": 64, "heads": 4, "kv_heads": 2, "head_width": 16, "mlp_ratio": 4,
            "latent": { "channels": 4, "height": 4, "width": 8 },
            "patch": [2, 2], "tokens": 8,
            "local": { "window": 4 },
            "global": { "window": 16, "dilation": 4, "max_window": 64, "period": 4, "offset": -1 },
            "control_period": 3,
            "rope": { "nyquist_fraction": 0.8, "time_base": 10000.0, "rounding": "none" },
            "autoencoder": { "temporal": 4, "spatial": 16, "memories": [] },
        },
        "sampler": { "schedule": [1.0, 0.9, 0.75, 0.3, 0.0], "sigma_rounding": "bf16" },
        "rates": { "latents_per_second": 15, "time_multiplier": 1 },
        "controls": { "mouse": 2, "buttons": 256, "scroll": 1 },
        "picture": { "decoded": [128, 64], "render": [128, 72], "range": [0.0, 1.0] },
        "graphs": { "f32": { "transformer": "t", "encoder": "e", "decoder": "d" } },
        "files": [],
        "licence": { "spdx": "MIT", "file": null },
        "provenance": {},
    }))
    .expect("the manifest is well formed")
}

/// SplitMix64, so that a failing test can be repeated with its seed.
pub(crate) struct TestRng(pub(crate) u64);

impl TestRng {
    pub(crate) fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number from 0 up to but not including `end`.
    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.next_u64() % end
    }
}
