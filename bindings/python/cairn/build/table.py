"""The cost of a world of given shapes, before it is built: parameters, tensors, ring bytes and peak memory."""

from __future__ import annotations

from .conditioning import CONTROLS, PASS, parts, weights_of
from .geometry import Geometry
from .graph import Graph
from .quantise import Quantisation, counts as quantised_counts, unpacked_bytes
from .sizes import value_sizes
from .weights import autoencoder_weights, transformer_weights
from .writer import build_graphs, layouts

# The paper's context windows; the table shows those that the world's dilation and largest window allow.
WINDOWS = (112, 128, 384, 512)
_BYTES = {"f32": 4, "f16": 2}


def windows(g: Geometry) -> list[int]:
    """The windows to show: those of the paper, the stock preset's and the largest, as far as the world allows them."""
    wanted = {*WINDOWS, g.global_window, g.global_max_window}
    return sorted(w for w in wanted if w <= g.global_max_window and w % g.global_dilation == 0)


def ring_bytes(g: Geometry, window: int, precision: str) -> int:
    """Bytes of all layers' past keys and values."""
    numbers = sum(g.past_tokens(i, window) * g.kv_width * 2 for i in range(g.layers))
    return numbers * _BYTES[precision]


def slab_bytes(g: Geometry, precision: str) -> int:
    """Bytes of one latent's keys and values of all layers."""
    return g.layers * g.tokens * g.kv_width * 2 * _BYTES[precision]


def activation_peak(graph: Graph, dimensions: dict[str, int]) -> tuple[int, int]:
    """The largest sum in bytes of the intermediate values alive at the same time, and the size of the largest value.

    Nodes run in the graph's order; a value lives from the node that makes it to the last node that reads it. Casts of weights are counted with
    the weights, and a reshape with its input. The conditioning is left out: it does not run in
    passes, and its values are small.
    """
    model, sizes = value_sizes(graph, dimensions)
    weights = {i.name for i in model.graph.initializer}
    last_use: dict[str, int] = {}
    owner: dict[str, str] = {}
    for at, node in enumerate(model.graph.node):
        for name in node.input:
            last_use[owner.get(name, name)] = at
        if node.op_type == "Reshape":
            owner[node.output[0]] = owner.get(node.input[0], node.input[0])
    for value in model.graph.output:
        last_use[owner.get(value.name, value.name)] = len(model.graph.node)
    given = weights | {i.name for i in model.graph.input}
    alive: dict[str, int] = {}
    peak = largest = 0
    for at, (node, part) in enumerate(zip(model.graph.node, parts(model.graph))):
        if part != PASS or node.op_type == "Cast" and node.input[0] in weights:
            continue
        for name in node.output:
            if owner.get(name, name) == name:
                alive[name] = sizes[name][1]
                largest = max(largest, alive[name])
        peak = max(peak, sum(alive.values()))
        for name in [n for n in alive if last_use.get(n, -1) <= at]:
            del alive[name]
    return peak, largest


def weight_bytes(graphs: dict[str, Graph], of_parts: tuple[str, ...] = (PASS, CONTROLS)) -> int:
    """Bytes of all weights in a device's memory: as stored, or float32 if a graph casts them, which happens once, when it is loaded. Those of
    what depends on noise levels alone are there only while that is computed."""
    total = 0
    for graph in graphs.values():
        model = graph.model()
        cast = {n.input[0] for n in model.graph.node if n.op_type == "Cast"}
        held = set().union(*(weights_of(model.graph, part) for part in of_parts))
        placed = [graph.weights[name] for name in graph.used_weights if name in held]
        total += sum(p.weight.count * 4 if p.weight.name in cast else p.length for p in placed)
    return total


def describe(g: Geometry, quantisation: Quantisation | None = None) -> str:
    """The table, as text."""
    transformer, autoencoder = transformer_weights(g), autoencoder_weights(g)
    counts = [sum(w.count for w in group) for group in (transformer, autoencoder)]
    width, height = g.decoded
    groups = layouts(g, quantisation)
    columns = ["weights", "K/V ring", "K/V step", "largest", "alive"] + ([] if quantisation is None else ["unpacked"]) + ["peak"]
    lines = [
        f"tokens     {g.tokens} ({g.grid[0]} x {g.grid[1]}), latent {g.latent_channels} x {g.latent_height} x {g.latent_width}, "
        f"decoded {width} x {height}, render {g.render[0]} x {g.render[1]}",
        f"layers     {g.layers} ({sum(map(g.is_global, range(g.layers)))} global), width {g.width}, heads {g.heads} over "
        f"{g.kv_heads}, local window {g.local_window}, global every {g.global_dilation}th up to {g.global_max_window}",
        f"{'':11}{'parameters':>16}{'tensors':>10}{'stored, MiB':>14}",
        *(
            f"{name:11}{count:16,}{len(group):10}{sum(p.length for p in placed.values()) / 2**20:14.1f}"
            for name, count, group, placed in zip(("transformer", "autoencoder"), counts, (transformer, autoencoder), groups)
        ),
        *([] if quantisation is None else [_describe_bits(g, quantisation)]),
        "",
        f"{'MiB':11}" + "".join(f"{column:>13}" for column in columns),
    ]
    for precision in _BYTES:
        graphs = build_graphs(g, precision, quantisation=quantisation)
        weights = weight_bytes(graphs)
        unpacked = unpacked_bytes(g, quantisation, precision)
        others = max(activation_peak(graphs[k], {})[0] for k in ("encoder", "decoder"))
        for window in windows(g):
            alive, largest = activation_peak(graphs["transformer"], g.dimensions(window))
            alive = max(alive, others)
            row = [weights, ring_bytes(g, window, precision), slab_bytes(g, precision), largest, alive]
            row += [] if quantisation is None else [unpacked]
            row.append(sum(row[:3]) + alive + unpacked)
            lines.append(f"{precision} g{window:<6}" + "".join(f"{v / 2**20:13.1f}" for v in row))
    lines.append("\nalive: all intermediate values at the worst moment; peak: weights, ring, one step's K/V and alive together.")
    if quantisation is not None:
        lines.append("unpacked: the largest matrix that a pass unpacks from fewer bits; it is part of the peak.")
    return "\n".join(lines)


def _describe_bits(g: Geometry, quantisation: Quantisation) -> str:
    smaller, all_of_them = quantised_counts(g, quantisation)
    kept = ", ".join(quantisation.kept) or "no layer"
    activations = "" if quantisation.activation_bits == 16 else ", activations in 8 bits on the CPU"
    return (
        f"weights    {100 * smaller / all_of_them:.0f} % of the transformer's in {quantisation.bits} bits, blocks of {quantisation.block}"
        f"{activations}; in 16 bits: {kept}"
    )
