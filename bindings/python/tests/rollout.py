"""A minimal rollout for tests of graphs: one ring per kind of layer, written in order."""

import numpy as np
from conftest import session


def rope(g, time: float):
    """The tables of docs/bundle.md, section 5, written from that page."""
    P = g.head_width // 2
    rows, columns = g.grid
    n = (P // 4 + 1) // 2
    f_xy = np.repeat(np.linspace(1, min(rows, columns) * g.nyquist_fraction / 2, n) * np.pi, 2)[: P // 4]
    j = np.arange(P // 2)
    f_t = g.time_base ** -(2 * (j // 2) / (P // 2))
    r, c = np.divmod(np.arange(rows * columns), columns)
    angle = np.concatenate(
        [
            ((2 * c + 1) / columns - 1)[:, None] * f_xy,
            ((2 * r + 1) / rows - 1)[:, None] * f_xy,
            np.broadcast_to(time * f_t, (rows * columns, P // 2)),
        ],
        axis=1,
    )
    return np.cos(angle).astype(np.float32)[None, None], np.sin(angle).astype(np.float32)[None, None]


class Rollout:
    """One world in one precision. `past` and `seen` are the ring; latents are numbered by `clock`."""

    def __init__(self, bundle, g, precision="f32", window=None):
        self.g = g
        self.window = window or g.global_window
        self.kind = {"f32": np.float32, "f16": np.float16}[precision]
        self.model = session(bundle, "transformer", precision, g.dimensions(self.window))
        size = lambda i: (1, g.kv_heads, g.past_tokens(i, self.window), g.head_width)  # noqa: E731
        self.past = [[np.zeros(size(i), self.kind) for _ in "kv"] for i in range(g.layers)]
        self.seen = {False: np.zeros(g.local_window, bool), True: np.zeros(self.window // g.global_dilation, bool)}
        self.clock = 0

    def slot(self, wide):
        """Slot of the current latent, and whether it is written."""
        dilation = self.g.global_dilation if wide else 1
        return (self.clock + dilation - 1) // dilation % len(self.seen[wide]), self.clock % dilation == 0

    def run(self, x, sigma, dsigma, controls=None, blind=False):
        """All outputs of one pass."""
        g = self.g
        cos, sin = rope(g, self.clock)
        feeds = {
            "x": x.astype(self.kind),
            "sigma": np.array([sigma], np.float32),
            "dsigma": np.array([dsigma], np.float32),
            "rope_cos": cos,
            "rope_sin": sin,
            "controls": np.zeros((1, g.control_width), np.float32) if controls is None else controls,
        }
        for wide, name in ((False, "local_mask"), (True, "global_mask")):
            visible = self.seen[wide] & (not blind)
            slot, writes = self.slot(wide)
            if writes:
                visible[slot] = False
            keys = np.concatenate([np.repeat(visible, g.tokens), np.ones(g.tokens, bool)])
            feeds[name] = np.where(keys, 0, -1e4).astype(self.kind)[None, None, None]
        for i, (k, v) in enumerate(self.past):
            feeds[f"past.{i}.k"], feeds[f"past.{i}.v"] = k, v
        return self.model.run(None, feeds)

    def commit(self, outputs):
        """Stores K and V of a pass in the ring."""
        T = self.g.tokens
        for i in range(self.g.layers):
            slot, writes = self.slot(self.g.is_global(i))
            if writes:
                for j in (0, 1):
                    self.past[i][j][:, :, slot * T : slot * T + T] = outputs[1 + 2 * i + j]
        for wide, seen in self.seen.items():
            slot, writes = self.slot(wide)
            seen[slot] |= writes
        self.clock += 1

    def step(self, noise, controls=None, watch=None):
        """One latent by the stock schedule; `watch` is called with (noise level, v, v without a past)."""
        x, levels = noise, self.g.schedule
        for sigma, lower in zip(levels, levels[1:]):
            if watch is not None:
                full, blind = (x - self.run(x, sigma, -1.0, controls, blind=b)[0] for b in (False, True))
                watch(sigma, full, blind)
            x = self.run(x, sigma, lower - sigma, controls)[0].astype(np.float32)
        self.commit(self.run(x, 0.0, 0.0, controls))
        return x

    def noise(self, rng):
        """A latent of noise."""
        g = self.g
        return rng.standard_normal((1, g.latent_channels, g.latent_height, g.latent_width)).astype(np.float32)
