"""How much each matrix of a world's layers loses in 8 or 4 bits, and which of them to keep in 16: `docs/bundle.md`, section 4.

Passes of the f32 transformer run from the same past and inputs with one matrix rounded at a time, then with one layer, then with all. The past comes
from walks of the world itself, which begin with a picture of a gradient and have random controls, so that nothing but the bundle is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from onnx import TensorProto, helper

from . import archive
from .errors import BuildError
from .geometry import Geometry
from .quantise import Quantisation, is_kept, restored, rounded
from .reader import read_manifest
from .stored import StoredWeights
from .transformer import to_bfloat16
from .weights import Packed, stored_transformer
from .writer import build_graphs

# The largest error of a pass that the default of `--keep-16` was chosen for.
BOUND = 0.01
# Latents of a walk before the one that is measured.
PAST = 4
# The mask of a hidden key.
HIDDEN = -1e4
_SUFFIX = ".weight"

# Called with the current step, the passes done so far, and their total.
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Report:
    """Relative errors of a latent in the worst pass of a step, in the L2 norm, as root mean squares over the walks."""

    quantisation: Quantisation
    bound: float
    # By matrix, the largest first, and by layer: with nothing else rounded.
    matrices: dict[str, float]
    layers: dict[str, float]
    # Numbers of each matrix.
    sizes: dict[str, int]
    # With every matrix rounded.
    all: float
    # The names for `--keep-16`, and the error with every other matrix rounded.
    kept: tuple[str, ...]
    left: float

    @property
    def kept_share(self) -> float:
        """Share of the layers' numbers that the names keep in 16 bits."""
        kept = sum(size for name, size in self.sizes.items() if is_kept(name, self.kept))
        return kept / sum(self.sizes.values())


def measure(
    bundle: Path,
    bits: int,
    block: int = 32,
    bound: float = BOUND,
    *,
    walks: int = 4,
    threads: int = 0,
    progress: Progress = lambda what, done, total: None,
) -> Report:
    """Measures a bundle with 16-bit weights, a folder or an archive. Runs on the CPU; the matrices are held as float32.

    Raises `BuildError` for a bundle with smaller weights, for a bound that is not above 0, and without ONNX Runtime.
    """
    quantisation = Quantisation(bits, block, kept=())
    if not 0 < bound < 1:
        raise BuildError(f"{bound} is not above 0 and below 1", field="--bound", remedy="Give a share, such as 0.01.")
    if not 1 <= walks <= 64:
        raise BuildError(f"{walks} is outside 1 to 64", field="--walks", remedy="Give a number in that range.")
    with archive.verified_folder(bundle) as folder:
        return _Measurement(folder, quantisation, walks, threads, progress).report(bound)


class _Measurement:
    def __init__(self, folder: Path, quantisation: Quantisation, walks: int, threads: int, progress: Progress):
        self.quantisation = quantisation
        self.model = Transformer(folder, quantisation, threads)
        self.names = list(self.model.matrices)
        self.layers = list(dict.fromkeys(".".join(name.split(".")[:2]) for name in self.names))
        if not self.names:
            cause = f"no matrix of its layers has a multiple of {quantisation.block} rows"
            raise BuildError(cause, field="--block", remedy="Use smaller blocks.")
        self.progress = progress
        steps = len(self.model.levels)
        # The last term is a guess: how often the proposed list is measured.
        self.total = walks * (PAST * (steps + 1) + 1 + steps * (1 + len(self.names) + len(self.layers) + 2))
        self.done = 0
        self.walks = [self._walk(seed) for seed in range(walks)]
        self.truth = [[self._run(inputs, {}) for inputs in walk] for walk in self.walks]

    def _advance(self, what: str) -> None:
        self.done += 1
        # The progress is complete only at the end, which no single pass is.
        self.progress(what, min(self.done, self.total - 1), self.total)

    def _run(self, inputs: dict[str, np.ndarray], replaced: dict[str, np.ndarray], what: str = "16 bits") -> np.ndarray:
        latent = self.model.run(inputs, replaced)[0]
        self._advance(what)
        return latent

    def _walk(self, seed: int) -> list[dict[str, np.ndarray]]:
        """The inputs of the passes of a latent after a walk."""
        state, rng = _Walk(self.model, seed), np.random.default_rng(seed)
        state.commit(state.seed_latent())
        self._advance("the walks")
        for _ in range(PAST - 1):
            state.step(rng, lambda: self._advance("the walks"))
        return state.step(rng, lambda: self._advance("the walks"), is_last=True)

    def error(self, names: Iterable[str], what: str) -> float:
        """The error with these matrices rounded."""
        replaced = {name: self.model.rounded(name) for name in names}
        worst = [
            max(_relative(self._run(inputs, replaced, what), truth) for inputs, truth in zip(walk, truths))
            for walk, truths in zip(self.walks, self.truth)
        ]
        return float(np.sqrt(np.mean(np.square(worst))))

    def report(self, bound: float) -> Report:
        sizes = {name: self.model.matrices[name].size for name in self.names}
        errors = {name: self.error([name], name) for name in self.names}
        layers = {layer: self.error([n for n in self.names if is_kept(n, [layer])], layer) for layer in self.layers}
        everything = self.error(self.names, "all matrices")
        kept: list[str] = []
        left = everything
        # First those that take the most from the error for each number that stays in 16 bits.
        order = sorted(self.names, key=lambda name: errors[name] ** 2 / sizes[name], reverse=True)
        while left > bound and len(kept) < len(order):
            # Errors of matrices are nearly independent, so their squares add. The measured error corrects the estimate.
            ratio = left**2 / max(sum(errors[name] ** 2 for name in order[len(kept) :]), 1e-30)
            kept.append(order[len(kept)])
            while len(kept) < len(order) and ratio * sum(errors[name] ** 2 for name in order[len(kept) :]) > bound**2:
                kept.append(order[len(kept)])
            left = self.error(order[len(kept) :], f"{len(kept)} kept in 16 bits")
        fitting = [name for name in order if errors[name] <= bound]
        if len(kept) == len(order) and fitting:
            # The order ends with a matrix that is beyond the bound alone, though others are not.
            largest = max(fitting, key=lambda name: sizes[name])
            kept, left = [name for name in order if name != largest], errors[largest]
        self.progress("complete", self.total, self.total)
        ranked = dict(sorted(errors.items(), key=lambda item: item[1], reverse=True))
        return Report(self.quantisation, bound, ranked, layers, sizes, everything, _shortened(kept, self.names), left)


class Transformer:
    """The f32 transformer of a bundle with the matrices of its layers as inputs, at the narrowest window."""

    def __init__(self, folder: Path, quantisation: Quantisation, threads: int = 0):
        self.folder, self.quantisation = folder, quantisation
        self.geometry = g = archive.read_geometry(folder)
        manifest = read_manifest(folder)
        self.rounding = manifest["geometry"]["rope"]["rounding"]
        self.encoder_file = folder / manifest["graphs"]["f32"]["encoder"]
        levels = np.array(g.schedule, np.float32)
        levels = to_bfloat16(levels) if manifest["sampler"]["sigma_rounding"] == "bf16" else levels
        self.levels = list(zip(levels, levels[1:] - levels[:-1]))
        source = StoredWeights(g, folder)
        stored = {packed.whole.name: packed for packed in stored_transformer(g)}

        def array(packed: Packed) -> np.ndarray:
            return np.ascontiguousarray(packed.pack([source.get(part) for part in packed.parts]))

        taken = {name for name, packed in stored.items() if quantisation.quantises(packed.whole)}
        # Without the suffix, as `--keep-16` names them; in float16.
        self.matrices = {name.removesuffix(_SUFFIX): array(stored[name]) for name in stored if name in taken}
        self._whole = {f"{name}{_SUFFIX}.f32": matrix.astype(np.float32) for name, matrix in self.matrices.items()}
        self.threads = threads
        model = build_graphs(g, "f32", self.rounding)["transformer"].model()
        self._make_inputs(model.graph, taken)
        self._session = self._load(model.SerializeToString(), {n: array(p) for n, p in stored.items() if n not in taken})

    def _make_inputs(self, graph: Any, taken: set[str]) -> None:
        """Replaces stored matrices and their casts by float32 inputs with the names of the casts."""
        casts = {node.input[0]: node for node in graph.node if node.op_type == "Cast" and node.input[0] in taken}
        for tensor in [t for t in graph.initializer if t.name in taken]:
            cast = casts[tensor.name].output[0]
            assert cast == f"{tensor.name}.f32"
            graph.node.remove(casts[tensor.name])
            graph.input.append(helper.make_tensor_value_info(cast, TensorProto.FLOAT, list(tensor.dims)))
            graph.initializer.remove(tensor)

    def _load(self, model: bytes | str, weights: dict[str, np.ndarray] | None = None) -> Any:
        try:
            import onnxruntime
        except ImportError as error:
            remedy = "Install it: python -m pip install onnxruntime==1.24.4 (on Windows onnxruntime-directml==1.24.4)."
            raise BuildError("it is not installed, and runs the passes", field="onnxruntime", remedy=remedy) from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self.threads
        options.log_severity_level = 3
        for name, size in self.geometry.dimensions(self.geometry.global_dilation).items():
            options.add_free_dimension_override_by_name(name, size)
        if weights:
            # The arrays must live as long as the values.
            self._weights = weights
            self._values = [onnxruntime.OrtValue.ortvalue_from_numpy(array) for array in weights.values()]
            options.add_external_initializers(list(weights), self._values)
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

    def rounded(self, name: str) -> np.ndarray:
        """The matrix `name` as a bundle with smaller weights has it."""
        how = self.quantisation
        return restored(*rounded(self.matrices[name], how.bits, how.block), how.bits)

    def run(self, inputs: dict[str, np.ndarray], replaced: dict[str, np.ndarray]) -> list[np.ndarray]:
        """All outputs of a pass, with these matrices in place of the stored ones."""
        return self._session.run(None, self._whole | {f"{n}{_SUFFIX}.f32": m for n, m in replaced.items()} | inputs)

    def encode(self, pictures: np.ndarray) -> np.ndarray:
        """The latent of pictures `[4, 3, H, W]`, without a past."""
        session = self._load(str(self.encoder_file))
        feeds = {i.name: np.zeros(i.shape, np.float32) for i in session.get_inputs()} | {"rgb": pictures}
        return session.run(None, feeds)[0]


class _Walk:
    """Keys and values of a walk's latents; the ring of a global layer has one slot, which the first latent fills."""

    def __init__(self, model: Transformer, seed: int):
        self.model, self.seed, self.count = model, seed, 0
        g = self.geometry = model.geometry
        self.slots = {False: g.local_window, True: 1}
        self.past = {
            f"past.{i}.{half}": np.zeros((1, g.kv_heads, self.slots[g.is_global(i)] * g.tokens, g.head_width), np.float32)
            for i in range(g.layers)
            for half in "kv"
        }
        self.controls = np.zeros((1, g.control_width), np.float32)

    def seed_latent(self) -> np.ndarray:
        """The latent of a picture with a gradient, in another direction for each walk."""
        width, height = self.geometry.decoded
        y, x = np.mgrid[0:1:height * 1j, 0:1:width * 1j]
        angle = 0.7 + 1.9 * self.seed
        ramp = 0.5 + 0.3 * (np.cos(angle) * (x - 0.5) + np.sin(angle) * (y - 0.5))
        picture = np.stack([np.roll(ramp, channel * width // 7, axis=1) for channel in range(3)])
        return self.model.encode(np.repeat(picture[None].astype(np.float32), 4, axis=0))

    def inputs(self, x: np.ndarray, sigma: float, dsigma: float) -> dict[str, np.ndarray]:
        g = self.geometry
        cos, sin = rope_tables(g, self.count * g.time_multiplier, self.model.rounding)
        one = lambda value: np.array([value], np.float32)  # noqa: E731
        feeds = {"x": x, "sigma": one(sigma), "dsigma": one(dsigma), "rope_cos": cos, "rope_sin": sin, "controls": self.controls}
        for is_global, name in ((False, "local_mask"), (True, "global_mask")):
            visible = np.arange(self.slots[is_global]) < self.count
            keys = np.append(np.repeat(visible, g.tokens), np.ones(g.tokens, bool))
            feeds[name] = np.where(keys, 0, HIDDEN).astype(np.float32)[None, None, None]
        return feeds | self.past

    def commit(self, latent: np.ndarray) -> None:
        """Runs the cache pass of a latent, and stores its keys and values in the next slot."""
        g = self.geometry
        outputs = self.model.run(self.inputs(latent, 0.0, 0.0), {})[1:]
        for i, (name, slab) in enumerate(zip(self.past, outputs)):
            if self.count < self.slots[g.is_global(i // 2)]:
                at = self.count * g.tokens
                self.past[name] = self.past[name].copy()
                self.past[name][:, :, at : at + g.tokens] = slab
        self.count += 1

    def step(self, rng: np.random.Generator, advance: Callable[[], None], is_last: bool = False) -> list[dict[str, np.ndarray]]:
        """Makes the next latent with random controls, and commits it unless it is the last. Returns the inputs of its denoise passes."""
        g, passes = self.geometry, []
        self.controls = np.zeros((1, g.control_width), np.float32)
        self.controls[0, :2] = rng.normal(0, 8, 2)
        # The letters W, A, S and D.
        self.controls[0, 2 + rng.choice([87, 65, 83, 68])] = 1
        x = rng.standard_normal((1, g.latent_channels, g.latent_height, g.latent_width)).astype(np.float32)
        for sigma, dsigma in self.model.levels:
            passes.append(self.inputs(x, sigma, dsigma))
            x = self.model.run(passes[-1], {})[0]
            advance()
        if not is_last:
            self.commit(x)
            advance()
        return passes


def rope_tables(g: Geometry, time: int, rounding: str) -> tuple[np.ndarray, np.ndarray]:
    """Cosines and sines of one latent at a RoPE time, `[1, 1, T, head_width / 2]`: `docs/bundle.md`, section 5."""
    pairs, (rows, columns) = g.head_width // 2, g.grid
    count = (pairs // 4 + 1) // 2
    f_xy = np.repeat(np.linspace(1, min(rows, columns) * g.nyquist_fraction / 2, count) * np.pi, 2)[: pairs // 4]
    f_t = g.time_base ** -(2 * (np.arange(pairs // 2) // 2) / (pairs // 2))
    if rounding == "bf16":
        f_xy, f_t = (to_bfloat16(f.astype(np.float32)).astype(np.float64) for f in (f_xy, f_t))
    row, column = np.divmod(np.arange(g.tokens), columns)
    parts = ((2 * column + 1) / columns - 1, f_xy), ((2 * row + 1) / rows - 1, f_xy), (np.full(g.tokens, float(time)), f_t)
    angle = np.concatenate([position[:, None] * frequencies for position, frequencies in parts], axis=1)
    return np.cos(angle).astype(np.float32)[None, None], np.sin(angle).astype(np.float32)[None, None]


def _relative(found: np.ndarray, truth: np.ndarray) -> float:
    found, truth = found.astype(np.float64), truth.astype(np.float64)
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def _shortened(kept: Iterable[str], names: list[str]) -> tuple[str, ...]:
    """The shortest names that cover the matrices `kept` and no others, in the order of the layers."""
    kept = set(kept)
    found: list[str] = []
    for name in names:
        if name not in kept or is_kept(name, found):
            continue
        parts = name.split(".")
        prefixes = [".".join(parts[:count]) for count in range(2, len(parts) + 1)]
        found.append(next(p for p in prefixes if all(other in kept for other in names if is_kept(other, [p]))))
    return tuple(found)


def table(report: Report) -> str:
    """The errors, as text: of each matrix, the largest first, of each layer, and of the proposed list."""
    percent = lambda error: f"{100 * error:.3f} %"  # noqa: E731
    bits, width = report.quantisation.bits, max(len(name) for name in report.matrices)
    lines = [f"{f'in {bits} bits':{width}}{'numbers':>14}{'error':>11}  in 16 bits"]
    for name, error in report.matrices.items():
        mark = "  yes" if is_kept(name, report.kept) else ""
        lines.append(f"{name:{width}}{report.sizes[name]:14,}{percent(error):>11}{mark}")
    lines += ["", f"{'layer':{width}}{'numbers':>14}{'error':>11}"]
    for layer, error in report.layers.items():
        numbers = sum(size for name, size in report.sizes.items() if is_kept(name, [layer]))
        lines.append(f"{layer:{width}}{numbers:14,}{percent(error):>11}")
    lines += ["", f"all of them: {percent(report.all)}"]
    if all(is_kept(name, report.kept) for name in report.matrices):
        least = min(report.matrices.values())
        lines.append(f"for at most {percent(report.bound)}: nothing can be quantised; the least error of one matrix is {percent(least)}")
    else:
        kept = ",".join(report.kept) or "none"
        lines.append(f"for at most {percent(report.bound)}: --keep-16 {kept}")
        lines.append(f"with it: {percent(report.left)}; {100 * report.kept_share:.1f} % of the layers' numbers stay in 16 bits")
    lines.append("error: of a latent in the worst pass of a step, relative, without the rounding of activations to 8 bits")
    return "\n".join(lines)
