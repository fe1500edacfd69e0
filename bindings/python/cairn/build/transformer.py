"""The Waypoint-1.5 transformer as an ONNX graph: `docs/bundle.md`, section 4.

T tokens of width D, H query heads over G key/value heads of width d, P = d / 2 rotation pairs. In a float16 graph the
noise conditioner, the control embedding, RMS norms with their modulation, RoPE and the Euler step stay in float32, and with
`Geometry.residual` "float32" also the gates and the sums of the residual stream.

The joined graph runs two latents at once, B = 2: the cache pass of one and the first denoise pass of the next, which sees the keys and values of
the first in each layer. The other graph runs one, B = 1.
"""

from __future__ import annotations

import numpy as np

from .geometry import FOURIER_WIDTH, Geometry
from .graph import Graph
from .quantise import Quantisation
from .weights import MODULATIONS, Placed

# The epsilon of an RMS norm without one: the step of float32 at 1.
RMS_EPSILON = float(np.finfo(np.float32).eps)
# Added to a mean of squares that is divided by: far below any but that of zeros, and a normal number of float32.
SMALLEST_SQUARE = 1e-30
# No intermediate value may exceed this at the largest declared window, in float32.
INTERMEDIATE_LIMIT = 256 << 20
SIGMA_SCALE = 1000.0
# Elements of one constant of ones: data in a model is at most 64 KiB.
ONES_LIMIT = 16384
FOURIER_BASE = 10000.0


def to_bfloat16(values: np.ndarray) -> np.ndarray:
    """float32 numbers rounded to bfloat16, ties to even, still as float32."""
    bits = values.view(np.uint32)
    return ((bits + 0x7FFF + ((bits >> 16) & 1)) & np.uint32(0xFFFF0000)).view(np.float32)


def fourier_frequencies(rounding: str) -> np.ndarray:
    """`FOURIER_BASE ^ -(i / 255)`, i = 0 .. 255, in float32; `bf16` rounds them as the released engine does."""
    n = FOURIER_WIDTH // 2
    exact = (FOURIER_BASE ** -(np.arange(n, dtype=np.float64) / (n - 1))).astype(np.float32)
    return exact if rounding == "none" else to_bfloat16(exact)


def attention_chunks(g: Geometry, layer: int, latents: int = 1) -> tuple[int, int]:
    """The number of parts of a layer's attention: over key/value heads, then over query rows.

    The fewest parts whose scores, `heads in the part x rows x keys`, stay within the limit at the largest window.
    """
    keys = g.past_tokens(layer, g.global_max_window) + latents * g.tokens
    rows = g.group * latents * g.tokens
    for parts in (n for n in range(1, g.kv_heads + 1) if g.kv_heads % n == 0):
        if 4 * (g.kv_heads // parts) * max(rows, g.head_width) * keys <= INTERMEDIATE_LIMIT:
            return parts, 1
    # Rows of two latents are divided between query heads, because each of these has rows of both.
    most = rows if latents == 1 else g.group
    for parts in (n for n in range(1, most + 1) if most % n == 0):
        if 4 * (rows // parts) * keys <= INTERMEDIATE_LIMIT:
            return g.kv_heads, parts
    return g.kv_heads, most


def build_transformer(
    g: Geometry,
    precision: str,
    weights: dict[str, Placed],
    fourier_rounding: str = "none",
    quantisation: Quantisation | None = None,
    *,
    joined: bool = False,
) -> Graph:
    """The whole graph, or the joined one; its inputs and outputs are those of `docs/bundle.md`, in order."""
    kind = _JoinedTransformer if joined else _Transformer
    return kind(g, precision, weights, quantisation).build(fourier_rounding)


class _Transformer:
    # B, and the graph's name.
    latents, name = 1, "transformer"

    def __init__(self, g: Geometry, precision: str, weights: dict[str, Placed], quantisation: Quantisation | None):
        self.g = g
        self.graph = Graph(self.name, precision, weights, quantisation)

    @property
    def residual(self) -> str:
        """Kind of the residual stream."""
        return "f32" if self.g.residual == "float32" else self.graph.precision

    def build(self, fourier_rounding: str) -> Graph:
        g, o, F, R = self.g, self.graph, self.graph.precision, self.residual
        T, D, P = g.tokens, g.width, g.head_width // 2
        rows, columns = g.grid
        B = self.latents
        latent = [1, g.latent_channels, g.latent_height, g.latent_width]

        x = o.input("x", F, latent)
        both = self.with_finished(x, latent)
        sigma = o.input("sigma", "f32", [B])
        dsigma = o.input("dsigma", "f32", [1])
        tables = [o.input(f"rope_{n}", "f32", [1, 1, B * T, P]) for n in ("cos", "sin")]
        controls = o.input("controls", "f32", [B, g.control_width])
        self.masks = {wide: o.input(f"{n}_mask", F, [1, B, 1, f"{n}_keys"]) for wide, n in ((False, "local"), (True, "global"))}
        past = []
        for i in range(g.layers):
            shape = [1, g.kv_heads, "global_past" if g.is_global(i) else "local_past", g.head_width]
            past.append((o.input(f"past.{i}.k", F, shape), o.input(f"past.{i}.v", F, shape)))
        self.cos, self.sin = (o.reshape(table, [B * T, P], f"{table}.table") for table in tables)

        cond = self.noise_conditioner(sigma, fourier_rounding)  # [B, D] f32
        modulations = self.modulations(cond)  # per layer six [B, D] f32
        ctrl = self.control_embedding(controls)  # [B, D]

        h = o.node(
            "Conv",
            [both, o.weight("patchify.weight")],
            "patchify",
            kernel_shape=list(g.patch),
            strides=list(g.patch),
        )  # [B, D, rows, columns]
        h = o.transpose(o.reshape(h, [B, D, T], "patchify.flat"), [0, 2, 1], "tokens")  # [B, T, D]
        h = o.cast(h, R)

        presents = []
        for i in range(g.layers):
            block = f"blocks.{i}"
            s0, b0, g0, s1, b1, g1 = modulations[i]
            y, k, v = self.attention(i, self.modulated_norm(h, s0, b0, f"{block}.attn.norm"), past[i])
            presents.append((k, v))
            h = o.add(h, o.mul(o.cast(y, R), g0, f"{block}.attn.gated"), f"{block}.attn.sum")
            if g.sees_controls(i):
                h = o.add(h, o.cast(self.control_fusion(block, h, ctrl), R), f"{block}.ctrl.sum")
            y = o.linear(self.modulated_norm(h, s1, b1, f"{block}.mlp.norm"), f"{block}.mlp.fc1", f"{block}.mlp.hidden")
            y = o.linear(o.silu(y, f"{block}.mlp.act"), f"{block}.mlp.fc2", f"{block}.mlp.out")
            h = o.add(h, o.mul(o.cast(y, R), g1, f"{block}.mlp.gated"), f"{block}.mlp.sum")

        v = self.velocity(*self.unfinished(h, cond))  # [1, C, h, w]
        step = o.mul(dsigma, o.cast(v, "f32"), "step")
        x_next = o.cast(o.add(o.cast(x, "f32"), step, "moved"), F)
        o.output(x_next, "x_next", latent)
        slab = [1, g.kv_heads, T, g.head_width]
        for i, (k, value) in enumerate(presents):
            o.output(k, f"present.{i}.k", slab)
            o.output(value, f"present.{i}.v", slab)
        return o

    def with_finished(self, x: str, latent: list[int]) -> str:
        """The latents that are run: [B, C, h, w]."""
        return x

    def unfinished(self, h: str, cond: str) -> tuple[str, str]:
        """Tokens [1, T, D] and condition [1, D] of the latent that is denoised."""
        return h, cond

    def noise_conditioner(self, sigma: str, rounding: str) -> str:
        """sigma -> Fourier features -> MLP: [B, D], in float32."""
        o = self.graph
        frequencies = o.constant("fourier.frequencies", fourier_frequencies(rounding)[None, :])
        scaled = o.mul(o.reshape(sigma, [self.latents, 1], "sigma.row"), o.number(SIGMA_SCALE, "f32"), "sigma.scaled")
        phase = o.mul(scaled, frequencies, "fourier.phase")
        waves = o.concat([o.node("Sin", [phase], "fourier.sin"), o.node("Cos", [phase], "fourier.cos")], 1, "fourier")
        waves = o.mul(waves, o.number(float(np.float32(np.sqrt(2.0))), "f32"), "fourier.unit")
        hidden = o.silu(o.linear(waves, "denoise_step_emb.mlp.fc1", "sigma.hidden"), "sigma.act")
        return o.linear(hidden, "denoise_step_emb.mlp.fc2", "cond")

    def modulations(self, cond: str) -> list[list[str]]:
        """Scale plus one, shift and gate of both sublayers for every layer: [D] f32, [1, 1, D] f32 and [1, 1, D] of the residual stream's kind.

        The six matrices are shared by all layers, so that one product gives all vectors: [L, D] x [6, D, D].
        """
        g, o = self.g, self.graph
        L, D, n = g.layers, g.width, len(MODULATIONS)
        biased = o.add(cond, o.weight("cond_head.bias_in", "f32"), "cond.biased")  # [L, D]
        h = o.cast(o.silu(biased, "cond.act"), o.precision)
        all_gates = o.matmul(h, o.weight("cond_head.cond_proj.weight"), "cond.modulations")  # [6, L, D]
        is_scale = np.array([m.endswith("scale") for m in MODULATIONS], np.float32)
        one = o.constant("scale.one", is_scale[:, None, None])
        gates = o.cast(all_gates, self.residual)
        all_norms = o.add(o.cast(all_gates, "f32"), one, "cond.gains")

        def vectors(j: int) -> list[str]:
            label = "cond." + MODULATIONS[j].replace(" ", ".")
            meaning = o.slice(gates if MODULATIONS[j].endswith("gate") else all_norms, j, j + 1, 0, label)
            parts = o.split(meaning, L, 1, f"{label}.layer")
            return [o.reshape(part, [D], f"{label}.vector") for part in parts] if is_scale[j] else parts

        columns = [vectors(j) for j in range(n)]
        return [[column[i] for column in columns] for i in range(L)]

    def control_embedding(self, controls: str) -> str:
        """Mouse, buttons and scroll -> normalised vectors [B, D]. In float32, because mouse counts have no bound.

        The large product is of the graph's precision, so that its matrix need not be stored in float32: its rows are divided by their root mean
        square, which is multiplied again after it. A divided number is at most the root of its row's length.
        """
        o = self.graph
        hidden = o.silu(o.linear(controls, "ctrl_emb.mlp.fc1", "ctrl.hidden"), "ctrl.act")
        last_axis = o.constant("ctrl.axis", np.array([1], np.int64))
        square = o.node("ReduceMean", [o.mul(hidden, hidden, "ctrl.squares"), last_axis], "ctrl.square", keepdims=1)
        size = o.node("Sqrt", [o.add(square, o.number(SMALLEST_SQUARE, "f32"), "ctrl.square.raised")], "ctrl.size")
        unit = o.cast(o.node("Div", [hidden, size], "ctrl.unit"), o.precision)
        embedding = o.cast(o.linear(unit, "ctrl_emb.mlp.fc2", "ctrl.emb.unit"), "f32")
        embedding = o.mul(embedding, size, "ctrl.emb")
        return o.cast(self.rms_norm(embedding, self.ones(self.g.width), "ctrl.norm"), o.precision)

    def rms_norm(self, x: str, gain: str, label: str) -> str:
        """gain * x / sqrt(mean(x^2) + eps) over the last axis, in float32: squares could overflow in float16."""
        o = self.graph
        return o.node("SimplifiedLayerNormalization", [o.cast(x, "f32"), gain], label, axis=-1, epsilon=RMS_EPSILON)

    def ones(self, width: int) -> str:
        """The gain of a norm without one: [width] f32."""
        o = self.graph
        parts = [min(width - start, ONES_LIMIT) for start in range(0, width, ONES_LIMIT)]
        return o.concat([o.constant(f"ones.{n}", np.ones(n, np.float32)) for n in parts], 0, "ones")

    def modulated_norm(self, x: str, gain: str, shift: str, label: str) -> str:
        """rms_norm(x) * gain + shift for all latents, in the graph's precision."""
        return self.modulated_norm_of_one(x, gain, shift, label)

    def modulated_norm_of_one(self, x: str, gain: str, shift: str, label: str) -> str:
        """The same for one latent, whose gain is a vector: [1, T, D]."""
        o = self.graph
        return o.cast(o.add(self.rms_norm(x, gain, f"{label}.scaled"), shift, f"{label}.shifted"), o.precision)

    def attention(self, layer: int, x: str, past: tuple[str, str]):
        """One layer's attention over its ring and the current latents: (output [B, T, D], k, v)."""
        g, o, F = self.g, self.graph, self.graph.precision
        H, G, T, d = g.heads, g.kv_heads, self.latents * g.tokens, g.head_width
        name = f"blocks.{layer}.attn"
        rows = o.reshape(o.linear(x, f"{name}.qkv_proj", f"{name}.qkv"), [1, T, H + 2 * G, d], f"{name}.qkv.heads")
        heads = o.transpose(rows, [0, 2, 1, 3], f"{name}.heads")  # [1, H + 2 G, T, d]
        turning, v = o.split_sizes(heads, [H + G, G], 1, f"{name}.part")
        v = self.mixed_values(layer, v)
        turning = self.rms_norm(turning, self.ones(d), f"{name}.qk.norm")
        # Pairs of elements j and P + j, as the weights are stored. From position 0: the tables are of this frame's tokens.
        start = o.constant("rope.start", np.zeros(1, np.int64))
        turned = o.node("RotaryEmbedding", [turning, start, self.cos, self.sin], f"{name}.qk.rope", interleaved=0)
        q, k = (o.cast(part, F) for part in o.split_sizes(turned, [H, G], 1, f"{name}.turned"))

        # The queries of one group become adjacent rows, so that K and V need not be repeated.
        q = o.reshape(q, [1, G, g.group * T, d], f"{name}.q.rows")
        y = self.attend(layer, q, (k, v), past, name)
        y = o.reshape(y, [1, H, T, d], f"{name}.y.heads")
        y = o.reshape(o.transpose(y, [0, 2, 1, 3], f"{name}.y.tokens"), [self.latents, g.tokens, g.width], f"{name}.y")
        return o.linear(y, f"{name}.out_proj", f"{name}.out"), self.finished(k), self.finished(v)

    def finished(self, slab: str) -> str:
        """K or V of the latent that may be committed: [1, G, T, d]."""
        return slab

    def mixed_values(self, layer: int, v: str) -> str:
        """v + lamb (v0 - v), where v0 is layer 0's v: [1, G, T, d]."""
        o, name = self.graph, f"blocks.{layer}.attn"
        if layer == 0:
            self.first_value = v
            return v
        toward = o.mul(o.weight(f"{name}.v_lamb"), o.sub(self.first_value, v, f"{name}.v.from0"), f"{name}.v.lamb")
        return o.add(v, toward, f"{name}.v.mixed")

    def attend(self, layer: int, q: str, current: tuple[str, str], past: tuple[str, str], name: str) -> str:
        """softmax(d^-1/2 q K^T + mask) V, where K and V are the past followed by the current latents, in parts: [1, G, rows, d]."""
        g, o = self.g, self.graph
        head_parts, row_parts = attention_chunks(g, layer, self.latents)
        mask = self.masks[g.is_global(layer)]

        def cut(value: str, label: str) -> list[str]:
            return o.split(value, head_parts, 1, f"{name}.{label}.part")

        outputs = []
        parts = zip(cut(q, "q"), cut(past[0], "past.k"), cut(current[0], "k"), cut(past[1], "past.v"), cut(current[1], "v"))
        for q_part, past_k, k, past_v, v in parts:
            keys = o.concat([past_k, k], 2, f"{name}.keys")
            values = o.concat([past_v, v], 2, f"{name}.values")
            rows = []
            for row in o.split(q_part, row_parts, 2, f"{name}.q.row"):
                scores = o.matmul_turned(row, keys, g.head_width**-0.5, f"{name}.scores")
                shares = o.node("Softmax", [self.masked(scores, mask, g.kv_heads // head_parts, f"{name}.masked")], f"{name}.shares", axis=-1)
                rows.append(o.matmul(shares, values, f"{name}.mix"))
            outputs.append(o.concat(rows, 2, f"{name}.mix.rows"))
        return o.concat(outputs, 1, f"{name}.mix.heads")

    def masked(self, scores: str, mask: str, heads: int, label: str) -> str:
        """scores + mask, for `heads` key/value heads."""
        return self.graph.add(scores, mask, label)

    def control_fusion(self, block: str, h: str, ctrl: str) -> str:
        """fc2(silu(fc1_x rms(h) + fc1_c rms(ctrl))): [B, T, D], added without a gate."""
        o, name = self.graph, f"{block}.ctrl_mlpfusion"
        normed = o.cast(self.rms_norm(h, self.ones(self.g.width), f"{block}.ctrl.norm"), o.precision)
        mixed = o.add(
            o.linear(normed, f"{name}.fc1_x", f"{block}.ctrl.x"),
            self.of_each_latent(o.linear(ctrl, f"{name}.fc1_c", f"{block}.ctrl.c")),
            f"{block}.ctrl.mixed",
        )
        return o.linear(o.silu(mixed, f"{block}.ctrl.act"), f"{name}.fc2", f"{block}.ctrl.out")

    def of_each_latent(self, vectors: str) -> str:
        """Vectors [B, n] in a shape that is added to tokens [B, T, n]."""
        return vectors

    def velocity(self, h: str, cond: str) -> str:
        """Output norm, SiLU and unpatchify: [1, T, D] -> [1, C, h, w]."""
        g, o = self.g, self.graph
        act = o.cast(o.silu(cond, "out.cond"), o.precision)
        scale, shift = o.split(o.cast(o.linear(act, "out_norm.fc", "out.modulation"), "f32"), 2, 1, "out.part")
        gain = o.reshape(o.add(scale, o.number(1.0, "f32"), "out.gain"), [g.width], "out.gain.vector")
        y = o.silu(self.modulated_norm_of_one(h, gain, shift, "out.norm"), "out.act")
        y = o.add(o.linear(y, "unpatchify", "unpatchify.cells"), o.weight("unpatchify.bias"), "unpatchify.biased")
        rows, columns = g.grid
        # A token's values are ordered (c, row in patch, column in patch).
        y = o.reshape(y, [rows, columns, g.latent_channels, *g.patch], "unpatchify.grid")
        y = o.transpose(y, [2, 0, 3, 1, 4], "unpatchify.turned")
        return o.reshape(y, [1, g.latent_channels, g.latent_height, g.latent_width], "v")


class _JoinedTransformer(_Transformer):
    """Two latents in one pass: the finished one, then the one that is denoised."""

    latents, name = 2, "joined"

    def with_finished(self, x: str, latent: list[int]) -> str:
        finished = self.graph.input("finished", self.graph.precision, latent)
        return self.graph.concat([finished, x], 0, "latents")

    def unfinished(self, h: str, cond: str) -> tuple[str, str]:
        o = self.graph
        return o.slice(h, 1, 2, 0, "unfinished"), o.slice(cond, 1, 2, 0, "unfinished.cond")

    def finished(self, slab: str) -> str:
        return self.graph.slice(slab, 0, self.g.tokens, 2, f"{slab}.finished")

    def modulations(self, cond: str) -> list[list[str]]:
        """As in the other graph, all [B, 1, D], from one product [L B, D] x [6, D, D]."""
        g, o = self.g, self.graph
        L, D, n, B = g.layers, g.width, len(MODULATIONS), self.latents
        biases = o.reshape(o.weight("cond_head.bias_in", "f32"), [L, 1, D], "cond.biases")
        biased = o.add(o.reshape(cond, [1, B, D], "cond.latents"), biases, "cond.biased")
        h = o.cast(o.silu(biased, "cond.act"), o.precision)
        h = o.reshape(h, [L * B, D], "cond.rows")
        all_gates = o.matmul(h, o.weight("cond_head.cond_proj.weight"), "cond.modulations")  # [6, L B, D]
        is_scale = np.array([m.endswith("scale") for m in MODULATIONS], np.float32)
        one = o.constant("scale.one", is_scale[:, None, None])
        gates = o.cast(all_gates, self.residual)
        all_norms = o.add(o.cast(all_gates, "f32"), one, "cond.gains")

        def vectors(j: int) -> list[str]:
            label = "cond." + MODULATIONS[j].replace(" ", ".")
            meaning = o.slice(gates if MODULATIONS[j].endswith("gate") else all_norms, j, j + 1, 0, label)
            return [o.reshape(part, [B, 1, D], f"{label}.vectors") for part in o.split(meaning, L, 1, f"{label}.layer")]

        columns = [vectors(j) for j in range(n)]
        return [[column[i] for column in columns] for i in range(L)]

    def modulated_norm(self, x: str, gain: str, shift: str, label: str) -> str:
        o = self.graph
        scaled = o.mul(self.rms_norm(x, self.ones(self.g.width), f"{label}.unit"), gain, f"{label}.scaled")
        return o.cast(o.add(scaled, shift, f"{label}.shifted"), o.precision)

    def masked(self, scores: str, mask: str, heads: int, label: str) -> str:
        """Rows are ordered by query head, then by latent, whose mask differs."""
        g, o = self.g, self.graph
        each = o.reshape(scores, [-1, self.latents, g.tokens, 0], f"{label}.latents")
        return o.reshape(o.add(each, mask, f"{label}.each"), [1, heads, -1, 0], label)

    def of_each_latent(self, vectors: str) -> str:
        return self.graph.reshape(vectors, [self.latents, 1, -1], f"{vectors}.latents")
