"""The Waypoint-1.5 transformer as an ONNX graph: `docs/bundle.md`, section 4.

T tokens of width D, H query heads over G key/value heads of width d, P = d / 2 rotation pairs. In a float16 graph the
noise conditioner, the control embedding, RMS norms with their modulation, RoPE, softmax and the Euler step stay in float32.
"""

from __future__ import annotations

import numpy as np

from .geometry import FOURIER_WIDTH, Geometry
from .graph import Graph
from .weights import MODULATIONS, Placed

# The epsilon of an RMS norm without one: the step of float32 at 1.
RMS_EPSILON = float(np.finfo(np.float32).eps)
# No intermediate value may exceed this at the largest declared window, in float32.
INTERMEDIATE_LIMIT = 256 << 20
SIGMA_SCALE = 1000.0
FOURIER_BASE = 10000.0


def fourier_frequencies(rounding: str) -> np.ndarray:
    """`FOURIER_BASE ^ -(i / 255)`, i = 0 .. 255, in float32; `bf16` rounds them as the released engine does."""
    n = FOURIER_WIDTH // 2
    exact = (FOURIER_BASE ** -(np.arange(n, dtype=np.float64) / (n - 1))).astype(np.float32)
    if rounding == "none":
        return exact
    bits = exact.view(np.uint32)
    return ((bits + 0x7FFF + ((bits >> 16) & 1)) & np.uint32(0xFFFF0000)).view(np.float32)


def attention_chunks(g: Geometry, layer: int) -> tuple[int, int]:
    """The number of parts of a layer's attention: over key/value heads, then over query rows.

    The fewest parts whose scores, `heads in the part x rows x keys`, stay within the limit at the largest window.
    """
    keys = g.past_tokens(layer, g.global_max_window) + g.tokens
    rows = g.group * g.tokens
    for parts in (n for n in range(1, g.kv_heads + 1) if g.kv_heads % n == 0):
        if 4 * (g.kv_heads // parts) * max(rows, g.head_width) * keys <= INTERMEDIATE_LIMIT:
            return parts, 1
    for parts in (n for n in range(1, rows + 1) if rows % n == 0):
        if 4 * (rows // parts) * keys <= INTERMEDIATE_LIMIT:
            return g.kv_heads, parts
    return g.kv_heads, rows


def build_transformer(g: Geometry, precision: str, weights: dict[str, Placed], fourier_rounding: str = "none") -> Graph:
    """The whole graph; its inputs and outputs are those of `docs/bundle.md`, in order."""
    return _Transformer(g, precision, weights).build(fourier_rounding)


class _Transformer:
    def __init__(self, g: Geometry, precision: str, weights: dict[str, Placed]):
        self.g = g
        self.graph = Graph("transformer", precision, weights)

    def build(self, fourier_rounding: str) -> Graph:
        g, o, F = self.g, self.graph, self.graph.precision
        T, D, P = g.tokens, g.width, g.head_width // 2
        rows, columns = g.grid
        latent = [1, g.latent_channels, g.latent_height, g.latent_width]

        x = o.input("x", F, latent)
        sigma = o.input("sigma", "f32", [1])
        dsigma = o.input("dsigma", "f32", [1])
        self.cos = o.input("rope_cos", "f32", [1, 1, T, P])
        self.sin = o.input("rope_sin", "f32", [1, 1, T, P])
        controls = o.input("controls", "f32", [1, g.control_width])
        masks = {wide: o.input(f"{n}_mask", F, [1, 1, 1, f"{n}_keys"]) for wide, n in ((False, "local"), (True, "global"))}
        past = []
        for i in range(g.layers):
            shape = [1, g.kv_heads, "global_past" if g.is_global(i) else "local_past", g.head_width]
            past.append((o.input(f"past.{i}.k", F, shape), o.input(f"past.{i}.v", F, shape)))
        self.masks = {wide: o.cast(mask, "f32") for wide, mask in masks.items()}

        cond = self.noise_conditioner(sigma, fourier_rounding)  # [1, D] f32
        modulations = self.modulations(cond)  # per layer six [1, D] f32
        ctrl = self.control_embedding(controls)  # [1, D]

        h = o.node(
            "Conv",
            [x, o.weight("patchify.weight")],
            "patchify",
            kernel_shape=list(g.patch),
            strides=list(g.patch),
        )  # [1, D, rows, columns]
        h = o.transpose(o.reshape(h, [1, D, T], "patchify.flat"), [0, 2, 1], "tokens")  # [1, T, D]

        first_value = None
        presents = []
        for i in range(g.layers):
            s0, b0, g0, s1, b1, g1 = modulations[i]
            block = f"blocks.{i}"
            y, k, v, first_value = self.attention(i, self.modulated_norm(h, s0, b0, f"{block}.attn.norm"), past[i], first_value)
            presents.append((k, v))
            h = o.add(h, o.mul(y, o.cast(g0, F), f"{block}.attn.gated"), f"{block}.attn.sum")
            if g.sees_controls(i):
                h = o.add(h, self.control_fusion(block, h, ctrl), f"{block}.ctrl.sum")
            y = o.linear(self.modulated_norm(h, s1, b1, f"{block}.mlp.norm"), f"{block}.mlp.fc1", f"{block}.mlp.hidden")
            y = o.linear(o.silu(y, f"{block}.mlp.act"), f"{block}.mlp.fc2", f"{block}.mlp.out")
            h = o.add(h, o.mul(y, o.cast(g1, F), f"{block}.mlp.gated"), f"{block}.mlp.sum")

        v = self.velocity(h, cond)  # [1, C, h, w]
        step = o.mul(dsigma, o.cast(v, "f32"), "step")
        x_next = o.cast(o.add(o.cast(x, "f32"), step, "moved"), F)
        o.output(x_next, "x_next", latent)
        slab = [1, g.kv_heads, T, g.head_width]
        for i, (k, value) in enumerate(presents):
            o.output(k, f"present.{i}.k", slab)
            o.output(value, f"present.{i}.v", slab)
        return o

    def noise_conditioner(self, sigma: str, rounding: str) -> str:
        """sigma -> Fourier features -> MLP: [1, D], in float32."""
        o = self.graph
        frequencies = o.constant("fourier.frequencies", fourier_frequencies(rounding)[None, :])
        scaled = o.mul(o.reshape(sigma, [1, 1], "sigma.row"), o.number(SIGMA_SCALE, "f32"), "sigma.scaled")
        phase = o.mul(scaled, frequencies, "fourier.phase")
        waves = o.concat([o.node("Sin", [phase], "fourier.sin"), o.node("Cos", [phase], "fourier.cos")], 1, "fourier")
        waves = o.mul(waves, o.number(float(np.float32(np.sqrt(2.0))), "f32"), "fourier.unit")
        hidden = o.silu(o.linear(waves, "denoise_step_emb.mlp.fc1", "sigma.hidden"), "sigma.act")
        return o.linear(hidden, "denoise_step_emb.mlp.fc2", "cond")

    def modulations(self, cond: str) -> list[list[str]]:
        """Scale, shift and gate of both sublayers for every layer, each [1, D] f32.

        The six matrices are shared by all layers, so each multiplies all layers' vectors at once: [L, D] x [D, D].
        """
        g, o = self.g, self.graph
        biased = o.add(cond, o.weight("cond_head.bias_in", "f32"), "cond.biased")  # [L, D]
        h = o.cast(o.silu(biased, "cond.act"), o.precision)
        columns = []
        for j, meaning in enumerate(MODULATIONS):
            label = "cond." + meaning.replace(" ", ".")
            m = o.cast(o.linear(h, f"cond_head.cond_proj.{j}", label), "f32")
            columns.append(o.split(m, g.layers, 0, f"{label}.layer"))
        return [[column[i] for column in columns] for i in range(g.layers)]

    def control_embedding(self, controls: str) -> str:
        """Mouse, buttons and scroll -> one normalised vector [1, D]. In float32, because mouse counts have no bound."""
        o = self.graph
        hidden = o.silu(o.linear(controls, "ctrl_emb.mlp.fc1", "ctrl.hidden"), "ctrl.act")
        return o.cast(self.rms_norm(o.linear(hidden, "ctrl_emb.mlp.fc2", "ctrl.emb"), "ctrl.norm"), o.precision)

    def rms_norm(self, x: str, label: str) -> str:
        """x / sqrt(mean(x^2) + eps) over the last axis, in float32, without a gain."""
        o = self.graph
        x = o.cast(x, "f32")
        axes = o.constant("axes.last", np.array([-1], np.int64))
        mean = o.node("ReduceMean", [o.mul(x, x, f"{label}.square"), axes], f"{label}.mean", keepdims=1)
        root = o.node("Sqrt", [o.add(mean, o.number(RMS_EPSILON, "f32"), f"{label}.eps")], f"{label}.root")
        return o.div(x, root, label)

    def modulated_norm(self, x: str, scale: str, shift: str, label: str) -> str:
        """rms_norm(x) * (1 + scale) + shift, in the graph's precision."""
        o = self.graph
        gain = o.add(scale, o.number(1.0, "f32"), f"{label}.gain")
        y = o.add(o.mul(self.rms_norm(x, f"{label}.rms"), gain, f"{label}.scaled"), shift, f"{label}.shifted")
        return o.cast(y, o.precision)

    def heads(self, x: str, count: int, label: str) -> str:
        """[1, T, count * d] -> [1, count, T, d]."""
        g, o = self.g, self.graph
        split = o.reshape(x, [1, g.tokens, count, g.head_width], f"{label}.split")
        return o.transpose(split, [0, 2, 1, 3], label)

    def rope(self, x: str, heads: int, label: str) -> str:
        """Rotates interleaved pairs and stores the halves side by side, in the released engine's order."""
        g, o = self.g, self.graph
        P = g.head_width // 2
        pairs = o.reshape(x, [1, heads, g.tokens, P, 2], f"{label}.pairs")
        halves = o.split(pairs, 2, 4, f"{label}.half")
        a, b = (o.reshape(half, [1, heads, g.tokens, P], f"{label}.{n}") for half, n in zip(halves, "ab"))
        y0 = o.sub(o.mul(a, self.cos, f"{label}.a.cos"), o.mul(b, self.sin, f"{label}.b.sin"), f"{label}.y0")
        y1 = o.add(o.mul(b, self.cos, f"{label}.b.cos"), o.mul(a, self.sin, f"{label}.a.sin"), f"{label}.y1")
        return o.concat([y0, y1], 3, label)

    def attention(self, layer: int, x: str, past: tuple[str, str], first_value: str | None):
        """One layer's attention over its ring and the current frame: (output [1, T, D], k, v, layer 0's v)."""
        g, o, F = self.g, self.graph, self.graph.precision
        name = f"blocks.{layer}.attn"
        q = self.heads(o.linear(x, f"{name}.q_proj", f"{name}.q"), g.heads, f"{name}.q.heads")
        k = self.heads(o.linear(x, f"{name}.k_proj", f"{name}.k"), g.kv_heads, f"{name}.k.heads")
        v = o.linear(x, f"{name}.v_proj", f"{name}.v")  # [1, T, G d]
        if first_value is None:
            first_value = v
        else:
            toward = o.mul(o.weight(f"{name}.v_lamb"), o.sub(first_value, v, f"{name}.v.from0"), f"{name}.v.lamb")
            v = o.add(v, toward, f"{name}.v.mixed")
        v = self.heads(v, g.kv_heads, f"{name}.v.heads")
        q = self.rope(self.rms_norm(q, f"{name}.q.norm"), g.heads, f"{name}.q.rope")
        k = o.cast(self.rope(self.rms_norm(k, f"{name}.k.norm"), g.kv_heads, f"{name}.k.rope"), F)

        # The queries of one group become adjacent rows, so that K and V need not be repeated; scaled by d^-1/2.
        q = o.mul(q, o.number(float(g.head_width**-0.5), "f32"), f"{name}.q.scaled")
        q = o.cast(o.reshape(q, [1, g.kv_heads, g.group * g.tokens, g.head_width], f"{name}.q.rows"), F)
        y = self.attend(layer, q, (k, v), past, name)
        y = o.reshape(y, [1, g.heads, g.tokens, g.head_width], f"{name}.y.heads")
        y = o.reshape(o.transpose(y, [0, 2, 1, 3], f"{name}.y.tokens"), [1, g.tokens, g.width], f"{name}.y")
        return o.linear(y, f"{name}.out_proj", f"{name}.out"), k, v, first_value

    def attend(self, layer: int, q: str, current: tuple[str, str], past: tuple[str, str], name: str) -> str:
        """softmax(q K^T + mask) V, where K and V are the past followed by the current frame, in parts: [1, G, rows, d]."""
        g, o = self.g, self.graph
        head_parts, row_parts = attention_chunks(g, layer)
        mask = self.masks[g.is_global(layer)]

        def cut(value: str, label: str) -> list[str]:
            return o.split(value, head_parts, 1, f"{name}.{label}.part")

        outputs = []
        parts = zip(cut(q, "q"), cut(past[0], "past.k"), cut(current[0], "k"), cut(past[1], "past.v"), cut(current[1], "v"))
        for q_part, past_k, k, past_v, v in parts:
            keys = o.transpose(o.concat([past_k, k], 2, f"{name}.keys"), [0, 1, 3, 2], f"{name}.keys.turned")
            values = o.concat([past_v, v], 2, f"{name}.values")
            rows = []
            for row in o.split(q_part, row_parts, 2, f"{name}.q.row"):
                scores = o.add(o.cast(o.matmul(row, keys, f"{name}.scores"), "f32"), mask, f"{name}.masked")
                shares = o.cast(o.node("Softmax", [scores], f"{name}.shares", axis=-1), o.precision)
                rows.append(o.matmul(shares, values, f"{name}.mix"))
            outputs.append(o.concat(rows, 2, f"{name}.mix.rows"))
        return o.concat(outputs, 1, f"{name}.mix.heads")

    def control_fusion(self, block: str, h: str, ctrl: str) -> str:
        """fc2(silu(fc1_x rms(h) + fc1_c rms(ctrl))): [1, T, D], added without a gate."""
        o, name = self.graph, f"{block}.ctrl_mlpfusion"
        normed = o.cast(self.rms_norm(h, f"{block}.ctrl.norm"), o.precision)
        mixed = o.add(
            o.linear(normed, f"{name}.fc1_x", f"{block}.ctrl.x"),
            o.linear(ctrl, f"{name}.fc1_c", f"{block}.ctrl.c"),
            f"{block}.ctrl.mixed",
        )
        return o.linear(o.silu(mixed, f"{block}.ctrl.act"), f"{name}.fc2", f"{block}.ctrl.out")

    def velocity(self, h: str, cond: str) -> str:
        """Output norm, SiLU and unpatchify: [1, T, D] -> [1, C, h, w]."""
        g, o = self.g, self.graph
        act = o.cast(o.silu(cond, "out.cond"), o.precision)
        scale, shift = o.split(o.cast(o.linear(act, "out_norm.fc", "out.modulation"), "f32"), 2, 1, "out.part")
        y = o.silu(self.modulated_norm(h, scale, shift, "out.norm"), "out.act")
        y = o.add(o.linear(y, "unpatchify", "unpatchify.cells"), o.weight("unpatchify.bias"), "unpatchify.biased")
        rows, columns = g.grid
        # A token's values are ordered (c, row in patch, column in patch).
        y = o.reshape(y, [rows, columns, g.latent_channels, *g.patch], "unpatchify.grid")
        y = o.transpose(y, [2, 0, 3, 1, 4], "unpatchify.turned")
        return o.reshape(y, [1, g.latent_channels, g.latent_height, g.latent_width], "v")
