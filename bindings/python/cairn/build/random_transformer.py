"""Random weights of the transformer, with just enough structure that a rollout shows drifting patterns.

The model width D is two halves. Content is written to both with opposite signs, conditioning to both with the same sign. So a matrix that reads
with opposite signs sees content alone, one that reads with the same sign sees conditioning alone, and silu(z) - silu(-z) = z passes content
through the output unchanged. Half of the content is the state S (the patch as it comes in), half the prediction R:

- values read S, and a little of R; attention writes R;
- the first query head of a group looks at the position from which the pattern came, one latent ago: its query is the key's constant part,
  rotated in each rotation pair by the drift. It excites; the second head looks everywhere and inhibits, which keeps the pattern from growing
  uniform;
- the output is a multiple of S - (prediction), so that the flow moves the noisy latent to the prediction.

The attention to past frames thus carries most of the velocity, which the parity tests rely on.
"""

from __future__ import annotations

import math

import numpy as np

from .geometry import Geometry
from .stream import Stream
from .weights import Weight

# Scales, found by running worlds of several shapes. Relative to a unit of content unless said otherwise.
PULL = 2.2  # velocity over (state - prediction)
EXCITATION = 3.4  # all layers' local heads together
INHIBITION = 2.6  # all layers' wide heads together
CONTENT_IN_KEYS = 0.35  # content over constant part in queries and keys
PREDICTION_IN_VALUES = 0.3  # how much of R values read
WILDNESS = 0.12  # random part of the value and output matrices
MLP = 0.3  # all layers' MLPs together
CONTROL = 0.4  # all control layers together
BIAS = 2.0  # per-layer bias of the conditioning, and with `CONDITION`
CONDITION = 0.5  # how far the noise level moves it
SPIN = 0.5  # how far a latent's numbers turn into one another from one latent to the next, in radians
# Drift of the pattern, in tokens per latent: mean speed of each axis, and how much heads differ.
DRIFT = 0.45
SPREAD = 0.15
# Time frequencies at which a local and a wide layer tell latents apart, in radians per latent and per bucket.
LOWEST_TIME = 0.3
# How far back local heads attend, in latents: past the current frame, which is still noise.
LOOK = 2
# Rotation per bucket that separates the current frame from the best match, and the weight of such pairs.
SHARP_TIME = (0.5, 2.6)
TIME_WEIGHT = 2.0


class RandomTransformer:
    """Makes each tensor of `weights.transformer_weights`, in float32."""

    def __init__(self, g: Geometry, stream: Stream):
        self.g = g
        self.stream = stream
        self.half = g.width // 2
        self.state = self.half // 2

    def get(self, weight: Weight) -> np.ndarray:
        """The numbers of one tensor."""
        g, name = self.g, weight.name
        unit = 1 / math.sqrt(weight.fan_in)
        if name.startswith("blocks."):
            _, layer, part = name.split(".", 2)
            return self.block(int(layer), part, weight)
        if name == "patchify.weight":
            return self.patchify(weight)
        if name == "cond_head.bias_in":
            return self.normal(weight, BIAS)
        if name.startswith("cond_head.cond_proj."):
            return self.modulation(int(name.split(".")[2]), weight)
        if name == "denoise_step_emb.mlp.fc2.weight":
            return self.normal(weight, CONDITION * unit / 0.6)
        if name == "out_norm.fc.weight":
            return self.normal(weight, 0.05 * unit)
        if name == "unpatchify.weight":
            return self.unpatchify()
        if name == "unpatchify.bias":
            return self.normal(weight, 0.02)
        return self.normal(weight, unit)

    def block(self, layer: int, part: str, weight: Weight) -> np.ndarray:
        """One tensor of one layer."""
        g, unit = self.g, 1 / math.sqrt(weight.fan_in)
        controlled = sum(g.sees_controls(i) for i in range(g.layers))
        if part == "attn.k_proj.weight":
            return self.keys(layer)
        if part == "attn.q_proj.weight":
            return self.queries(layer)
        if part == "attn.v_proj.weight":
            return self.values(layer)
        if part == "attn.out_proj.weight":
            return self.mixer(layer)
        if part == "attn.v_lamb":
            return np.clip(0.5 + self.normal(weight, 0.15), 0.1, 0.9)
        if part == "mlp.fc2.weight":
            return self.writer(weight, 1.7 * MLP / math.sqrt(g.layers) * unit)
        if part == "ctrl_mlpfusion.fc2.weight":
            return self.writer(weight, 1.7 * CONTROL / math.sqrt(controlled) * unit)
        return self.normal(weight, unit)

    # Helpers.

    def normal(self, weight: Weight, deviation: float) -> np.ndarray:
        """Random numbers of the tensor's own stream."""
        return self.stream.normal(weight.name, weight.shape, deviation)

    def paired(self, name: str, columns: int, deviation: float, sign: int) -> np.ndarray:
        """[D, columns]; the second half of its rows is `sign` times the first."""
        top = self.stream.normal(name, (self.half, columns), deviation)
        return np.concatenate([top, np.float32(sign) * top, np.zeros((self.g.width - 2 * self.half, columns), np.float32)])

    def writer(self, weight: Weight, deviation: float) -> np.ndarray:
        """[in, D]: writes content, to the prediction with weight 1 and to the state with weight 0.1."""
        into = self.stream.normal(weight.name, (weight.shape[0], self.half), deviation)
        into[:, : self.state] *= np.float32(0.1)
        return self.spread(into)

    def spread(self, content: np.ndarray) -> np.ndarray:
        """[rows, half] -> [rows, D]: the second half is the first with opposite sign."""
        rest = np.zeros((len(content), self.g.width - 2 * self.half), np.float32)
        return np.concatenate([content, -content, rest], axis=1)

    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """For each element of the state: the index of its patch value, and its sign."""
        at = np.arange(self.state) % self.g.patch_width
        return at, self.stream.signs("state signs", self.state)

    # Tensors.

    def patchify(self, weight: Weight) -> np.ndarray:
        """Copies the patch into the state, repeated as often as it fits."""
        at, sign = self.places()
        into = np.zeros((self.g.patch_width, self.half), np.float32)
        into[at, np.arange(self.state)] = sign
        return np.ascontiguousarray(self.spread(into).T).reshape(weight.shape)

    def unpatchify(self) -> np.ndarray:
        """PULL times the mean over copies of state plus prediction."""
        at, sign = self.places()
        copies = np.bincount(at, minlength=self.g.patch_width).astype(np.float32)
        out = np.zeros((self.half, self.g.patch_width), np.float32)
        share = np.float32(PULL) * sign / copies[at]
        out[np.arange(self.state), at] = share
        out[np.arange(self.state) + self.state, at] = share
        # z arrives as silu(z) - silu(-z).
        rest = np.zeros((self.g.width - 2 * self.half, self.g.patch_width), np.float32)
        return np.concatenate([out, -out, rest])

    def modulation(self, j: int, weight: Weight) -> np.ndarray:
        """Scale, shift and gate are equal for both halves. Shifts carry the constant part, gates are about 1."""
        unit = 1 / math.sqrt(weight.fan_in)
        # The input is silu(bias + a little): about 1.2 in square mean, 0.8 in mean, for a bias of 2.
        deviation = {0: 0.1, 1: 0.8, 2: 0.15}[j % 3] * unit
        one = self.stream.normal(weight.name, (self.g.width, self.half), deviation)
        if j % 3 == 2:
            one += np.float32(1.25 / self.g.width)
        return np.concatenate([one, one, np.zeros((self.g.width, self.g.width - 2 * self.half), np.float32)], axis=1)

    def pair_frequencies(self) -> np.ndarray:
        """Radians per token column, per token row and per latent of each rotation pair: [3, P], zero elsewhere."""
        g = self.g
        P = g.head_width // 2
        rows, columns = g.grid
        n = (P // 4 + 1) // 2
        steps = [1 + (min(rows, columns) * g.nyquist_fraction / 2 - 1) * i / max(n - 1, 1) for i in range(n)]
        xy = [math.pi * steps[j // 2] for j in range(P // 4)]
        t = [g.time_base ** -(2 * (j // 2) / (P // 2)) for j in range(P // 2)]
        out = np.zeros((3, P))
        out[0, : P // 4] = [2 * f / columns for f in xy]
        out[1, P // 4 : P // 2] = [2 * f / rows for f in xy]
        out[2, P // 2 :] = t
        return out

    def telling(self, layer: int) -> np.ndarray:
        """How well each rotation pair distinguishes positions and times in this layer's ring: [P], 0 for not at all."""
        x, y, t = self.pair_frequencies()
        turn = t * (self.g.global_dilation if self.g.is_global(layer) else 1)
        sharp = (turn >= SHARP_TIME[0]) & (turn <= SHARP_TIME[1])
        return np.where(sharp, TIME_WEIGHT, ((x != 0) | (y != 0) | (turn >= LOWEST_TIME)).astype(np.float64))

    def constant_part(self, layer: int, kv_head: int) -> np.ndarray:
        """[half, d]: reads conditioning into the distinguishing pairs of a key."""
        d = self.g.head_width
        part = self.stream.normal(f"blocks.{layer}.attn.constant.{kv_head}", (self.half, d), 1 / math.sqrt(self.half))
        return part * np.repeat(self.telling(layer), 2).astype(np.float32)

    def content_part(self, name: str) -> np.ndarray:
        """[half, d]: reads content into all pairs equally."""
        return self.stream.normal(name, (self.half, self.g.head_width), CONTENT_IN_KEYS / math.sqrt(self.half))

    def both(self, constant: np.ndarray, content: np.ndarray) -> np.ndarray:
        """[D, d] that reads conditioning with equal signs and content with opposite ones."""
        rest = np.zeros((self.g.width - 2 * self.half, constant.shape[1]), np.float32)
        return np.concatenate([constant + content, constant - content, rest])

    def keys(self, layer: int) -> np.ndarray:
        """[D, G d]."""
        heads = [
            self.both(self.constant_part(layer, h), self.content_part(f"blocks.{layer}.attn.k.{h}"))
            for h in range(self.g.kv_heads)
        ]
        return np.concatenate(heads, axis=1)

    def queries(self, layer: int) -> np.ndarray:
        """[D, H d]: in each group, one head looks back along the drift, one looks everywhere, the others are random."""
        g, heads = self.g, []
        telling = np.repeat(self.telling(layer) > 0, 2)
        for h in range(g.heads):
            kv_head, role = divmod(h, g.group)
            content = self.content_part(f"blocks.{layer}.attn.q.{h}")
            if role == 0:
                constant = self.turned(self.constant_part(layer, kv_head), self.look_back(layer, kv_head))
            else:
                name = f"blocks.{layer}.attn.wide.{h}"
                constant = self.stream.normal(name, (self.half, g.head_width), 1 / math.sqrt(self.half))
                if role == 1 and not telling.all():
                    constant = constant * (~telling).astype(np.float32)
            heads.append(self.both(constant, content))
        return np.concatenate(heads, axis=1)

    def look_back(self, layer: int, kv_head: int) -> np.ndarray:
        """The rotation of each pair that points to the pattern's position LOOK latents (or buckets) ago: [P]."""
        x, y, t = self.pair_frequencies()
        direction = self.stream.signs("drift", 2).astype(np.float64)
        jitter = self.stream.normal(f"blocks.{layer}.attn.drift.{kv_head}", (2,), SPREAD).astype(np.float64)
        columns, rows = direction * DRIFT + jitter
        ago = LOOK * (self.g.global_dilation if self.g.is_global(layer) else 1)
        return -(LOOK * (columns * x + rows * y) + ago * t)

    def turned(self, matrix: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Rotates each pair of columns 2j, 2j + 1 by the j-th angle."""
        cos, sin = (np.array([f(a) for a in angles], np.float32) for f in (exact_cos, exact_sin))
        a, b = matrix[:, 0::2], matrix[:, 1::2]
        out = np.empty_like(matrix)
        out[:, 0::2] = a * cos - b * sin
        out[:, 1::2] = b * cos + a * sin
        return out

    def values(self, layer: int) -> np.ndarray:
        """[D, G d]: element j of a value reads element j of the state, repeated as often as it fits, and a little of R."""
        g = self.g
        read = self.stream.normal(f"blocks.{layer}.attn.v", (self.half, g.kv_width), WILDNESS / math.sqrt(self.half))
        at = np.arange(g.kv_width)
        read[at % self.state, at] += np.float32(1)
        read[self.state + at % self.state, at] += np.float32(PREDICTION_IN_VALUES)
        # Content comes with both signs: half of each.
        return self.both(np.zeros_like(read), read * np.float32(0.5))

    def mixer(self, layer: int) -> np.ndarray:
        """[H d, D]: the first head of a group pulls the prediction towards what it has read, the second pushes it away."""
        g = self.g
        reads = max(1.0, g.kv_width / self.state)
        scale = 1 / (g.layers * reads)
        blocks = []
        for h in range(g.heads):
            kv_head, role = divmod(h, g.group)
            name = f"blocks.{layer}.attn.o.{h}"
            into = self.stream.normal(name, (g.head_width, self.half), WILDNESS * scale * EXCITATION / math.sqrt(g.head_width))
            into[:, : self.state] *= np.float32(0.1)
            at = (kv_head * g.head_width + np.arange(g.head_width)) % self.state
            amount = {0: -EXCITATION, 1: INHIBITION}.get(role, 0.0) * scale
            here, beside, other = self.spin(at)
            rows = np.arange(g.head_width)
            into[rows, self.state + at] += np.float32(amount) * here
            into[rows, self.state + other] += np.float32(amount) * beside
            blocks.append(self.spread(into))
        return np.concatenate(blocks)

    def spin(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rotates neighbouring values of the patch into one another by SPIN: cosine, sine and the neighbour's index.

        Without it, a still world's past would contain no more information than its present.
        """
        place, sign = self.places()
        other = np.minimum(at ^ 1, self.state - 1)
        way = self.stream.signs("spin", self.g.patch_width // 2 + 1)[place[at] // 2]
        sine = np.where(other == at, 0.0, np.where(place[at] % 2 == 0, 1.0, -1.0) * exact_sin(SPIN)).astype(np.float32)
        return np.full(len(at), exact_cos(SPIN), np.float32), sine * way * sign[at] * sign[other], other


def exact_sin(x: float) -> float:
    """Sine computed with additions and multiplications only, so that every machine gives the same bits; accurate to about 1e-12."""
    x = math.remainder(x, 2 * math.pi)
    term, total = x, x
    for k in range(1, 14):
        term = term * (-x * x) / ((2 * k) * (2 * k + 1))
        total += term
    return total


def exact_cos(x: float) -> float:
    """Cosine, computed likewise."""
    return exact_sin(x + math.pi / 2)
