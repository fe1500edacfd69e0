"""Estimates which world runs at which rate on which GPU, from the graphs' arithmetic, the bytes that must move, and data sheets.

    seconds of a run       max(2 x multiply-adds / peak, bytes / bandwidth)
    bytes of a pass        weights and past keys and values, read once, and the latent's own, written: fewer cannot move
    limit of a latent      passes of the preset x seconds of a pass + seconds of the decoder
    estimate of a latent   from the larger of limit / worst share, and nodes x `SLOW_KERNEL_SECONDS`
                           to the larger of limit / best share, and nodes x `fast_kernel_seconds()`

Weights of fewer bits need less memory, and fewer bytes must move. But products are counted at the float16 rate, because a provider unpacks the
weights and multiplies in float16. The low end assumes that it unpacks each matrix into memory, so that a pass also writes all of them there and
reads them again. The high end and the limit assume that it unpacks them within the product.

Data sheets do not say what share of its peak a GPU reaches. `published.py` lists every rate of Waypoint-1.5 that others published with the
GPU's name; the worst and the best of those in 16 bits bound the estimate. Rates that were measured with Cairn come from reports
(`measured.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

from .conditioning import CONTROLS, PASS, parts
from .costs import node_costs
from .geometry import PRESETS, Geometry
from .graph import Graph
from .measured import PRESET, WORLD, Measured, Reports, is_same
from .published import POINTS, Point
from .quantise import Quantisation, unpacked_bytes, unpacked_numbers
from .table import activation_peak, ring_bytes, slab_bytes, weight_bytes
from .transformer import build_transformer
from .writer import build_graphs, layouts


@dataclass(frozen=True)
class Gpu:
    """A GPU, with the numbers of its maker's data sheet."""

    name: str
    teraflops: float  # dense float16 products with float32 sums, on matrix units where there are any, 1e12 a second
    bandwidth: float  # of its memory, 1e9 bytes a second
    memory: float  # GiB; of one without memory of its own, what a game may well use
    shares_memory: bool = False  # has no memory of its own


# Matrix units: GeForce, twice float32's rate with float32 sums (as the white papers of Ada and Blackwell list them; Ampere's the
# same); Radeon RX 7000, twice float32's; RX 9000, as listed ("peak half precision matrix"); Arc, half the listed int8 rate.
# The page of estimates has a row for each of these.
GPUS = (
    Gpu("Radeon 780M (in a laptop's processor)", 16.6, 90, 8, shares_memory=True),
    Gpu("Radeon RX 7600", 43.5, 288, 8),
    Gpu("Radeon RX 7900 XTX", 122.8, 960, 24),
    Gpu("Radeon RX 9060 XT 16 GB", 103, 322, 16),
    Gpu("Radeon RX 9070 XT", 195, 645, 16),
    Gpu("GeForce RTX 3060", 25.5, 360, 12),
    Gpu("GeForce RTX 4060", 30.2, 272, 8),
    Gpu("GeForce RTX 4070", 58.3, 504, 12),
    Gpu("GeForce RTX 4090", 165.2, 1008, 24),
    Gpu("GeForce RTX 5070", 61.7, 672, 12),
    Gpu("GeForce RTX 5090", 209.5, 1792, 32),
    Gpu("Arc B580", 116.5, 456, 12),
)

# GPUs of published rates only. 4080 Laptop: 7,424 cores at up to 2.28 GHz and 192 bits of GDDR6 (NVIDIA's page of laptops; at most, as a
# laptop's maker may set fewer watts). 4090 D: 14,592 cores at 2.52 GHz. 3090: GA102 white paper. H100: data sheet, SXM; PCIe is slower.
GPUS_OF_POINTS = (
    Gpu("GeForce RTX 4080 Laptop", 67.7, 432, 12),
    Gpu("GeForce RTX 4090 D", 147.1, 1008, 24),
    Gpu("GeForce RTX 3090", 71.0, 936, 24),
    Gpu("H100", 989.4, 3350, 80),
)


# Seconds of a node where each starts a kernel of its own, for the low end. An assumption, not a measurement.
SLOW_KERNEL_SECONDS = 5e-6
# Elementary operators that a fused one replaces. The published programs have graphs of their own, so their operators are counted unfused.
ELEMENTARY = {"SimplifiedLayerNormalization": 6, "RotaryEmbedding": 16, "FusedMatMul": 3}
# Latents per second for real time: Waypoint-1.5's, and the miniature's.
REAL_TIME = 15
# Bits of weights that worlds are compared in.
BITS = (16, 8, 4)
# GPU memory reserved for the game engine.
ENGINES_SHARE = 0.25


@dataclass(frozen=True)
class Preset:
    """The work that a preset of the library needs of the transformer for one latent."""

    name: str
    window: int
    passes: int  # with the cache pass


# The same as `cairn::world::Preset`; a test compares the two.
PRESETS_OF_THE_LIBRARY = (
    Preset("stock", 128, 5),
    Preset("baseline112", 112, 10),
    Preset("baseline128", 128, 10),
    Preset("coherence", 384, 11),
    Preset("heavy", 512, 13),
)


def multiply_adds(graph: Graph, dimensions: dict[str, int], part: str = PASS) -> int:
    """Multiply-adds of `MatMul`, `FusedMatMul` and `Conv` in one run, which `Bundle::cost` counts in Rust."""
    return sum(node.multiply_adds for node in node_costs(graph, dimensions, part))


@dataclass(frozen=True)
class Run:
    """The cost of one run of a graph."""

    flops: float
    bytes: float

    def seconds(self, gpu: Gpu) -> float:
        """Lower bound of its duration."""
        return max(self.flops / (gpu.teraflops * 1e12), self.bytes / (gpu.bandwidth * 1e9))


class World:
    """The cost of a world's graphs in float16, with its weights in 16 bits or as `quantisation` stores them.

    Of a world with joined graphs, a latent has joined passes: the cache pass of the latent before and the first denoise pass are one.
    """

    def __init__(self, name: str, g: Geometry, quantisation: Quantisation | None = None):
        self.name, self.geometry = name, g
        self._graphs = build_graphs(g, "f16", quantisation=quantisation)
        weights = layouts(g, quantisation)[0]
        self._joined = build_transformer(g, "f16", weights, quantisation=quantisation, joined=True) if g.joined else None
        self._unpacked = unpacked_bytes(g, quantisation, "f16")
        self._weights = {kind: weight_bytes({kind: graph}) for kind, graph in self._graphs.items()}
        pictures = 3 * math.prod(g.decoded) * 4
        self.decode = Run(2.0 * multiply_adds(self._graphs["decoder"], {}), self._weights["decoder"] + pictures)
        of_controls = weight_bytes({"transformer": self._graphs["transformer"]}, (CONTROLS,))
        self._weights_of_a_pass = weight_bytes({"transformer": self._graphs["transformer"]}, (PASS,))
        adds = multiply_adds(self._graphs["transformer"], g.dimensions(g.global_window), CONTROLS)
        # Once in a step, and with joined passes once more for both of their latents.
        self._embedding = (1, Run(2.0 * adds, of_controls)) if self._joined is None else (2, Run(3.0 * adds, of_controls))
        # Bytes of all matrices that a pass unpacks, in float16, written once and read once.
        self._unpacking = 2 * 2 * unpacked_numbers(g, quantisation)
        self._passes: dict[int, Run] = {}
        self._memory: dict[int, float] = {}

    def one_pass(self, window: int) -> Run:
        """A denoise or cache pass of the transformer at global window `window`."""
        g = self.geometry
        if window not in self._passes:
            moved = self._weights_of_a_pass + ring_bytes(g, window, "f16") + slab_bytes(g, "f16")
            self._passes[window] = Run(2.0 * multiply_adds(self._graphs["transformer"], g.dimensions(window)), moved)
        return self._passes[window]

    def joined_pass(self, window: int) -> Run:
        """A cache pass and a denoise pass at once: weights and past are read once for both."""
        flops = 2.0 * multiply_adds(self._joined, self.geometry.dimensions(window, 2))
        return Run(flops, self.one_pass(window).bytes + slab_bytes(self.geometry, "f16"))

    def passes(self, preset: Preset) -> list[tuple[int, Run]]:
        """Number and cost of each kind of pass of a latent."""
        if self._joined is None:
            return [(preset.passes, self.one_pass(preset.window))]
        return [(preset.passes - 2, self.one_pass(preset.window)), (1, self.joined_pass(preset.window))]

    def kernels(self, preset: Preset, fused: dict[str, int] | None = None) -> int:
        """Kernels of one latent, estimated from the nodes of the graphs: `fused` has the number of elementary operators that a node stands for."""
        weight = {"Reshape": 0, "Cast": 0} | (fused or {})

        def count(graph: Graph, part: str = PASS) -> int:
            nodes = graph.model().graph
            return sum(weight.get(n.op_type, 1) for n, own in zip(nodes.node, parts(nodes)) if own == part)

        graphs = [self._graphs["transformer"], self._joined]
        of_passes = sum(number * count(graph) for (number, _), graph in zip(self.passes(preset), graphs))
        embedding = sum(count(graph, CONTROLS) for graph in graphs if graph is not None)
        return of_passes + embedding + count(self._graphs["decoder"])

    def memory(self, window: int) -> float:
        """GiB for weights, past keys and values, intermediate values, and one matrix that is unpacked to 16 bits."""
        g = self.geometry
        if window not in self._memory:
            dimensions = {"transformer": g.dimensions(window)}
            alive = max(activation_peak(graph, dimensions.get(kind, {}))[0] for kind, graph in self._graphs.items())
            if self._joined is not None:
                alive += activation_peak(self._joined, g.dimensions(window, 2))[0]
            slabs = slab_bytes(g, "f16") * (1 if self._joined is None else 3)
            total = sum(self._weights.values()) + ring_bytes(g, window, "f16") + slabs + alive + self._unpacked
            self._memory[window] = total / 2**30
        return self._memory[window]

    def flops(self, preset: Preset) -> float:
        """Floating-point operations per latent."""
        return sum(number * one.flops for number, one in [*self.passes(preset), self._embedding]) + self.decode.flops

    def limit(self, gpu: Gpu, preset: Preset, unpacks: bool = False) -> float:
        """Latents per second that no program can exceed, or with `unpacks`, no program that unpacks quantised matrices into memory."""
        more = self._unpacking if unpacks else 0
        passes = sum(number * Run(one.flops, one.bytes + more).seconds(gpu) for number, one in self.passes(preset))
        times, embedding = self._embedding
        return 1.0 / (passes + times * embedding.seconds(gpu) + self.decode.seconds(gpu))

    def estimate(self, gpu: Gpu, preset: Preset) -> tuple[float, float]:
        """Lowest and highest latents per second to expect of a GPU that does nothing else."""
        limit, nodes, (worst, best) = self.limit(gpu, preset), self.kernels(preset), shares()
        return (
            min(worst * self.limit(gpu, preset, unpacks=True), 1.0 / (SLOW_KERNEL_SECONDS * nodes)),
            min(best * limit, 1.0 / (fast_kernel_seconds() * nodes)),
        )

    def fits(self, gpu: Gpu, preset: Preset) -> bool:
        """Whether it fits into the memory that an engine leaves."""
        return self.memory(preset.window) <= (1 - ENGINES_SHARE) * gpu.memory


@cache
def _world(model: str, latents: int) -> World:
    """Waypoint-1.5's `model` at its stock window, or where the runtime keeps `latents` past latents in every layer."""
    g = PRESETS[model][1]
    if latents:
        g = replace(g, local_window=latents, global_window=latents * g.global_dilation)
    return World(model, g)


@cache
def limit_of(point: Point) -> float:
    """Latents per second that no 16-bit program exceeds, for the GPU, model, history and stages of a published rate."""
    gpu = next(gpu for gpu in (*GPUS, *GPUS_OF_POINTS) if gpu.name == point.gpu)
    world, passes = _world(point.model, point.latents), len(PRESETS[point.model][1].schedule)
    decoder = world.decode.seconds(gpu) if point.decoder else 0.0
    return 1.0 / (passes * world.one_pass(world.geometry.global_window).seconds(gpu) + decoder)


@cache
def shares() -> tuple[float, float]:
    """The worst and the best share of the limit among the published rates in 16 bits."""
    reached = [point.rate / limit_of(point) for point in POINTS if point.bits == 16]
    return min(reached), max(reached)


@cache
def fast_kernel_seconds() -> float:
    """Seconds of an elementary operator at the published 16-bit rate that passes most of them per second. Those programs fuse or record them."""
    stock, counted = PRESETS_OF_THE_LIBRARY[0], [point for point in POINTS if point.bits == 16 and point.decoder]
    return 1.0 / max(point.rate * _world(point.model, 0).kernels(stock, ELEMENTARY) for point in counted)


def evidence() -> str:
    """The published rates and their shares of the limit, in Markdown."""
    lines = ["| GPU | model | precision | program | latents a second | limit | share |", "|---|---|---|---|--:|--:|--:|"]
    for point in sorted(POINTS, key=lambda point: (-point.bits, point.rate / limit_of(point))):
        share = f"{100 * point.rate / limit_of(point):.0f} %" + ("" if point.bits == 16 else " *")
        stages = "" if point.decoder else ", without the decoder"
        lines.append(
            f"| {point.gpu} | {point.model} | {point.precision} | {point.program}{stages} ({point.source}) "
            f"| {point.rate:.1f} | {_short(limit_of(point))} | {share} |"
        )
    return "\n".join(lines)


def table(worlds: list[World], reports: Reports | None = None) -> str:
    """Latents per second of every GPU, world and preset, in Markdown; measured ones from `reports`, which need the world
    that these are of, beside the estimates and in a list."""
    out = []
    for world in worlds:
        width, height = world.geometry.decoded
        out += [f"### {world.name}, {width} x {height} decoded", ""]
        cache = "joined" if world.geometry.joined else "+ 1"
        columns = [f"{p.name}<br>g{p.window}, {p.passes - 1} {cache} passes" for p in PRESETS_OF_THE_LIBRARY]
        rows = [
            ("TFLOP a latent", [f"{world.flops(p) / 1e12:.2g}" for p in PRESETS_OF_THE_LIBRARY]),
            ("kernels a latent", [f"{world.kernels(p):,}" for p in PRESETS_OF_THE_LIBRARY]),
            ("memory, GiB", [f"{world.memory(p.window):.2g}" for p in PRESETS_OF_THE_LIBRARY]),
            *((gpu.name, [_cell(world, gpu, p, limit=True) for p in PRESETS_OF_THE_LIBRARY]) for gpu in GPUS),
        ]
        if reports is not None and reports.measured and world.name == WORLD:
            at = 1 + PRESETS_OF_THE_LIBRARY.index(preset_of_reports())
            columns.insert(at, f"{PRESET}<br>measured")
            for name, cells in rows:
                cells.insert(at, _measured_cell(world, name, reports))
        out += [_markdown(columns, rows), ""]
    if reports is not None:
        out += ["### Measured", "", measured_list(next(world for world in worlds if world.name == WORLD), reports), ""]
    return "\n".join(out)


def preset_of_reports() -> Preset:
    """The preset that reports measure."""
    return next(preset for preset in PRESETS_OF_THE_LIBRARY if preset.name == PRESET)


def gpu_of(measured: Measured) -> Gpu | None:
    """The GPU with a data sheet here that a report is of."""
    same = (
        gpu
        for gpu in (*GPUS, *GPUS_OF_POINTS)
        if is_same(gpu.name, gpu.memory, gpu.shares_memory, measured.adapter, measured.memory)
    )
    return next(same, None)


def how_far_off(low: float, high: float, rate: float) -> str:
    """How far a measured rate is from the estimated range."""
    if rate < low:
        return f"{low / rate:.1f} times slower than the low end"
    if rate > high:
        return f"{rate / high:.1f} times faster than the high end"
    return f"in the range, {rate / high:.2f} of the high end"


def _measured_cell(world: World, gpu: str, reports: Reports) -> str:
    low_high = {gpu.name: world.estimate(gpu, preset_of_reports()) for gpu in GPUS}
    of_gpu = [measured for measured in reports.measured if (found := gpu_of(measured)) is not None and found.name == gpu]
    return "<br>".join(f"{_short(one.rate)}: {how_far_off(*low_high[gpu], one.rate)}" for one in of_gpu)


def measured_list(world: World, reports: Reports) -> str:
    """The measured rates of `world`, each beside its estimate, and the reports that have none, in Markdown."""
    lines = []
    if reports.measured:
        lines += ["| GPU | driver | report | passes | estimated | measured | the estimate |", "|---|---|---|---|--:|--:|---|"]
    else:
        lines += ["No report of a graphics adapter has been sent yet. [Reports](hardware.md#send-a-report) says how to send one."]
    for one in reports.measured:
        gpu = gpu_of(one)
        estimated, off = "-", "none: no data sheet of this GPU is in the tables"
        if gpu is not None:
            low, high = world.estimate(gpu, preset_of_reports())
            estimated, off = f"{_short(low)} to {_short(high)}", how_far_off(low, high, one.rate)
        adapter, driver = (text.replace("|", "\\|") for text in (one.adapter, one.driver))
        lines.append(
            f"| {adapter} | {driver} | `hardware/{one.file}` | {one.passes} | {estimated} | {_short(one.rate)} | {off} |"
        )
    if reports.unused:
        lines += ["", "Not used: " + "; ".join(f"`hardware/{file}`, {why}" for file, why in reports.unused) + "."]
    return "\n".join(lines)


def summary(worlds: list[World]) -> str:
    """The same table for two presets and without the limits, in Markdown."""
    shown = [(world, p) for world in worlds for p in PRESETS_OF_THE_LIBRARY if p.name in ("stock", "coherence")]
    rows = [(gpu.name, [_cell(world, gpu, p, limit=False) for world, p in shown]) for gpu in GPUS]
    return _markdown([f"{world.name}<br>{p.name}" for world, p in shown], rows)


def in_each_precision(name: str, g: Geometry) -> list[World]:
    """The world with weights in each of `BITS`."""
    return [World(name, g, None if bits == 16 else Quantisation(bits)) for bits in BITS]


def by_bits(worlds: list[list[World]]) -> str:
    """Memory, and latents per second of every GPU at two presets, of worlds with weights in each of `BITS`, in Markdown."""
    presets = [preset for preset in PRESETS_OF_THE_LIBRARY if preset.name in ("stock", "coherence")]
    out = []
    for same in worlds:
        width, height = same[0].geometry.decoded
        shown = [(world, preset) for preset in presets for world in same]
        columns = [f"{preset.name}<br>{bits} bits" for preset in presets for bits in BITS]
        rows = [
            ("memory, GiB", [f"{world.memory(preset.window):.1f}" for world, preset in shown]),
            *((gpu.name, [_cell(world, gpu, preset, limit=False) for world, preset in shown]) for gpu in GPUS),
        ]
        out += [f"### {same[0].name} by bits of its weights, {width} x {height} decoded", "", _markdown(columns, rows), ""]
    return "\n".join(out)


def _markdown(columns: list[str], rows: list[tuple[str, list[str]]]) -> str:
    lines = ["| | " + " | ".join(columns) + " |", "|---|" + "--:|" * len(columns)]
    return "\n".join(lines + [f"| {name} | " + " | ".join(cells) + " |" for name, cells in rows])


def _cell(world: World, gpu: Gpu, preset: Preset, limit: bool) -> str:
    if not world.fits(gpu, preset):
        return "-"
    low, high = world.estimate(gpu, preset)
    text = f"{_short(low)} to {_short(high)}" + (f" ({_short(world.limit(gpu, preset))})" if limit else "")
    return f"**{text}**" if low >= REAL_TIME else text


def _short(value: float) -> str:
    return f"{value:.1f}" if value < 10 else f"{value:,.0f}"
