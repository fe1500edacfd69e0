"""The command line: `python -m cairn.build`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import NamedTuple

from . import archive, costs, measured, rates, sensitivity, table
from .checkpoint import open_checkpoint
from .errors import BuildError
from .geometry import PRESETS, RESIDUALS, Geometry
from .manifest import Licence
from .quantise import BLOCKS, KEPT, Quantisation
from .random_weights import RandomWeights
from .stored import rebuild
from .writer import build_bundle

HELP = """\
Makes world bundles for Cairn: a manifest, ONNX graphs, weights and checksums (docs/bundle.md).

A bundle is a folder, or one file with the suffix .cairn: name the output so, and it is packed.

examples:
  python -m cairn.build random --preset demo --seed 1 --out worlds/demo
  python -m cairn.build random --preset tiny --width 128 --heads 4 --out worlds/wider
  python -m cairn.build checkpoint ~/Waypoint-1.5-1B --out worlds/waypoint.cairn
  python -m cairn.build describe --preset 720p
  python -m cairn.build describe worlds/demo
  python -m cairn.build rates waypoint.cairn
  python -m cairn.build costs --preset 360p
  python -m cairn.build quantise waypoint.cairn --weights 8 --out waypoint-8bit.cairn
  python -m cairn.build sensitivity waypoint.cairn --weights 8 --bound 0.01
  python -m cairn.build rebuild waypoint.cairn --residual float32 --out waypoint-residual.cairn
  python -m cairn.build pack worlds/demo --out worlds/demo.cairn
"""

RATES_HELP = """\
Estimates how many latents a second a world makes on common GPUs, at each preset of the library: from what its graphs do, the
bytes that must move, and the makers' figures. Each cell is a range, from the worst to the best share of the limit that anybody
published. Bold is real time even at the low end, in brackets is the limit that no 16-bit program passes, and a dash says that
memory is too small. Nothing is measured here; docs/rates.md says what the estimate rests on. --reports puts rates that
cairn-check measured beside the estimates, and says how far off these were.
"""

COSTS_HELP = """\
Prints what one run of each node of a world's graphs costs, in float16 and at the stock window, as JSON: for each world and graph a
list of [name, operator, output, multiply-adds, bytes read, bytes written]. Nothing runs. Nodes that are computed when a graph is loaded are
left out.
"""

REBUILD_HELP = """\
Writes a bundle again with the graphs of this version of the builder, which may run faster than those it was built with. The numbers of its
weights stay the same; the files of weights may hold them in another order.
"""

QUANTISE_HELP = """\
Writes a bundle again with the matrices of the transformer's layers in 8 or 4 bits instead of 16: it needs less memory, on the CPU provider
and on DirectML. Its latents differ from the original's; docs/bundle.md has measured differences. Everything outside the layers stays in
16 bits, and so do the matrices that --keep-16 names.
"""

SENSITIVITY_HELP = """\
Measures how much each matrix of the transformer's layers loses in 8 or 4 bits, and proposes the list for `quantise --keep-16`. Passes of the f32
transformer run on the CPU from the same past with one matrix rounded at a time, then with one layer, then with all. The past comes from walks of
the world itself. The list keeps those matrices in 16 bits that take the most from the error for their size, until the measured error is at most
the bound. The bundle stays as it is.
"""

CHECKPOINT_HELP = """\
Reads a Waypoint-1.5 checkpoint as it is released:

  model.safetensors     or model.safetensors.index.json with its shards; float32, float16 or bfloat16
  config.yaml           shapes and rates
  taehv1_5.pth          the autoencoder, or taehv1_5.safetensors; elsewhere: --autoencoder

Every tensor must be known, present and of the right shape. Names are the released ones, or the engine's own after loading:
blocks without "transformer.", "mlp" for "dit_mlp", "cond_head" for the two half heads, "ctrl_mlpfusion.mlp.fc1" for
fc1_x beside fc1_c, "attn.qkv_proj" for q, k and v. The file of the autoencoder is read without torch, and nothing in
it is run.
"""

RANDOM_HELP = """\
Random weights make a world that runs like a trained one and shows no world. The same seed and shapes give the same
bytes on every machine.

presets:
"""


def parser() -> argparse.ArgumentParser:
    """The parser of all commands and their options."""
    raw = argparse.RawDescriptionHelpFormatter
    top = argparse.ArgumentParser(prog="python -m cairn.build", description=HELP, formatter_class=raw)
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    checkpoint = commands.add_parser(
        "checkpoint", help="from a checkpoint directory", description=CHECKPOINT_HELP, formatter_class=raw
    )
    checkpoint.add_argument("directory", type=Path, help="where model.safetensors and config.yaml are")
    checkpoint.add_argument("--autoencoder", type=Path, help="the autoencoder's file, where it is not in the directory")
    checkpoint.add_argument("--max-window", type=int, default=512, help="the largest global window to declare (512)")
    checkpoint.add_argument(
        "--rounding",
        choices=["bf16", "none"],
        default="bf16",
        help="noise levels, Fourier and RoPE frequencies: rounded to bfloat16 as the released engine runs (the default), or exact",
    )
    checkpoint.add_argument("--name", help="shown to people; the directory's name unless given")
    checkpoint.add_argument("--licence", default="Apache-2.0", help="SPDX expression of the weights (Apache-2.0)")
    checkpoint.add_argument("--licence-file", type=Path, help="its text; LICENSE in the directory unless given")
    _streaming(checkpoint)
    _residual(checkpoint)
    _joined(checkpoint)
    _output(checkpoint)

    presets = "".join(f"  {name:8} {what}\n" for name, (what, _) in PRESETS.items())
    random = commands.add_parser(
        "random", help="with seeded random weights", description=RANDOM_HELP + presets, formatter_class=raw
    )
    _geometry(random)
    _streaming(random)
    _residual(random)
    _joined(random)
    random.add_argument("--seed", type=int, default=1, help="0 to 2^64 - 1 (1)")
    random.add_argument("--name", help="shown to people")
    _output(random)

    describe = commands.add_parser("describe", help="table of sizes of a bundle or of shapes", formatter_class=raw)
    describe.add_argument("bundle", type=Path, nargs="?", help="a folder or a .cairn file; else give shapes")
    _geometry(describe)

    of_rates = commands.add_parser(
        "rates", help="what runs at what rate on which GPU", description=RATES_HELP, formatter_class=raw
    )
    of_rates.add_argument("bundles", type=Path, nargs="*", metavar="bundle", help="folders or .cairn files (or --preset)")
    of_rates.add_argument("--preset", choices=list(PRESETS), action="append", default=[], help="shapes instead; may come again")
    _weights(of_rates)
    of_rates.add_argument("--joined", action="store_true", help="with joined passes (operating point `joined`) of all worlds named")
    of_rates.add_argument("--summary", action="store_true", help="one short table: two presets, no limits")
    of_rates.add_argument("--by-bits", action="store_true", help="instead, a table of weights in 16, 8 and 4 bits at two presets")
    of_rates.add_argument("--points", action="store_true", help="instead, the published rates that the ranges come from")
    of_rates.add_argument(
        "--reports", type=Path, metavar="FOLDER", help="reports of cairn-check, with measured rates of samples/worlds/miniature.cairn"
    )

    of_nodes = commands.add_parser(
        "costs", help="what each node of the graphs costs", description=COSTS_HELP, formatter_class=raw
    )
    of_nodes.add_argument("bundles", type=Path, nargs="*", metavar="bundle", help="folders or .cairn files (or --preset)")
    of_nodes.add_argument("--preset", choices=list(PRESETS), action="append", default=[], help="shapes instead; may come again")

    _weights(of_nodes)

    again = commands.add_parser(
        "rebuild", help="an existing bundle again, with this version's graphs", description=REBUILD_HELP, formatter_class=raw
    )
    again.add_argument("bundle", type=Path, help="a folder or a .cairn file")
    _residual(again, "as in the bundle")
    _joined(again)
    again.add_argument("--out", type=Path, required=True, help="the folder, or the file *.cairn, to write")
    again.add_argument("--replace", action="store_true", help="replace the bundle that is there, once the new one is complete")
    again.add_argument("--quiet", action="store_true", help="no progress")

    smaller = commands.add_parser(
        "quantise", help="an existing bundle again, with smaller weights", description=QUANTISE_HELP, formatter_class=raw
    )
    smaller.add_argument("bundle", type=Path, help="a folder or a .cairn file with 16-bit weights")
    smaller.add_argument("--weights", type=int, choices=[8, 4], required=True, help="bits of a weight")
    smaller.add_argument("--block", type=int, choices=BLOCKS, default=32, help="rows of a column that share a scale (32)")
    smaller.add_argument(
        "--activations",
        type=int,
        choices=[16, 8],
        default=16,
        help="8 lets the CPU provider round activations to 8 bits in blocks, too, which is faster; DirectML does not (16)",
    )
    smaller.add_argument(
        "--keep-16",
        default=",".join(KEPT),
        metavar="LIST",
        help=f"layers or matrices that stay in 16 bits, with commas between them, or none ({','.join(KEPT)})",
    )
    _residual(smaller, "as in the bundle")
    _joined(smaller)
    smaller.add_argument("--out", type=Path, required=True, help="the folder, or the file *.cairn, to write")
    smaller.add_argument("--replace", action="store_true", help="replace the bundle that is there, once the new one is complete")
    smaller.add_argument("--quiet", action="store_true", help="no progress and no table")

    of_layers = commands.add_parser(
        "sensitivity", help="which layers to keep in 16 bits when quantising", description=SENSITIVITY_HELP, formatter_class=raw
    )
    of_layers.add_argument("bundle", type=Path, help="a folder or a .cairn file with 16-bit weights")
    of_layers.add_argument("--weights", type=int, choices=[8, 4], default=8, help="bits of a weight (8)")
    of_layers.add_argument("--block", type=int, choices=BLOCKS, default=32, help="rows of a column that share a scale (32)")
    of_layers.add_argument(
        "--bound", type=float, default=sensitivity.BOUND, help=f"the largest relative error of a pass ({sensitivity.BOUND})"
    )
    of_layers.add_argument("--walks", type=int, default=4, help="walks whose errors are averaged, 1 to 64 (4)")
    of_layers.add_argument("--threads", type=int, default=0, help="threads of a pass; 0 is one for each physical core (0)")
    of_layers.add_argument("--quiet", action="store_true", help="no progress")

    pack = commands.add_parser("pack", help="folder to .cairn file, or back", formatter_class=raw)
    pack.add_argument("bundle", type=Path, help="a folder to pack, or a .cairn file to unpack")
    pack.add_argument("--out", type=Path, required=True, help="what to write")
    pack.add_argument("--replace", action="store_true", help="replace what is there")
    return top


def _weights(command: argparse.ArgumentParser) -> None:
    command.add_argument("--weights", type=int, choices=[16, 8, 4], default=16, help="bits of a preset's weights (16); a bundle has its own")


def _streaming(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--streaming-encoder",
        action="store_true",
        help="the encoder is handed its memories, so that rollouts may keep its stream from one appended picture to the next",
    )


def _residual(command: argparse.ArgumentParser, default: str = "float16") -> None:
    command.add_argument(
        "--residual",
        choices=RESIDUALS,
        help=f"type of the sums of the residual stream in f16 graphs: float32 where float16 overflows or is not accurate enough ({default})",
    )


def _joined(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--joined",
        action="store_true",
        help="with joined graphs, which run the cache pass of a latent and the first denoise pass of the next at once (operating point `joined`)",
    )


def _output(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", type=Path, required=True, help="the folder, or the file *.cairn, to write")
    command.add_argument("--replace", action="store_true", help="replace the bundle that is there, once the new one is complete")
    command.add_argument("--precision", choices=["f32", "both"], default="both", help="graphs to write (both)")
    command.add_argument("--quiet", action="store_true", help="no progress and no table")


_SHAPES = {
    "layers": "transformer blocks",
    "width": "model width",
    "heads": "query heads",
    "kv_heads": "key/value heads",
    "mlp_ratio": "hidden width of the MLP over the width",
    "latent_channels": "channels of a latent",
    "latent_height": "rows of a latent",
    "latent_width": "columns of a latent",
    "local_window": "latents a local layer remembers",
    "global_window": "stock global window, in latents",
    "global_dilation": "a global layer remembers every n-th latent",
    "global_max_window": "largest global window declared",
    "global_period": "one layer in so many is global",
    "control_period": "one layer in so many sees the controls",
    "encoder_width": "channels inside the encoder",
}


def _geometry(command: argparse.ArgumentParser) -> None:
    command.add_argument("--preset", choices=list(PRESETS), help="shapes to start from (tiny)")
    shapes = command.add_argument_group("shapes", "each changes one number of the preset")
    for name, meaning in _SHAPES.items():
        shapes.add_argument("--" + name.replace("_", "-"), type=int, help=meaning)
    shapes.add_argument("--patch", type=int, nargs=2, metavar=("ROWS", "COLUMNS"), help="latent cells per token")
    shapes.add_argument("--decoder-widths", type=int, nargs=4, metavar="N", help="channels of the decoder's stages")
    shapes.add_argument("--render", type=int, nargs=2, metavar=("WIDTH", "HEIGHT"), help="square-pixel size of a picture")


def chosen_geometry(options: argparse.Namespace) -> Geometry:
    """The preset with the changes that the options ask for."""
    base = PRESETS[options.preset or "tiny"][1]
    changes = {n: v for n in _SHAPES if (v := getattr(options, n)) is not None}
    changes |= {n: tuple(v) for n in ("patch", "decoder_widths", "render") if (v := getattr(options, n)) is not None}
    if "render" not in changes and {"latent_height", "latent_width"} & changes.keys():
        changes["render"] = (0, 0)
    return base.with_(**changes)


class Printer:
    """Progress on standard error: rewritten in place on a terminal, elsewhere one line at most every two seconds. Counts bytes, or `unit`s."""

    def __init__(self, quiet: bool, unit: str | None = None):
        self.quiet = quiet
        self.unit = unit
        self.live = sys.stderr.isatty()
        self.last = 0.0
        self.started = time.monotonic()

    def __call__(self, what: str, done: int, total: int) -> None:
        now = time.monotonic()
        finished = done >= total
        if self.quiet or not (finished or now - self.last >= (0.1 if self.live else 2.0)):
            return
        self.last = now
        share = 100 * done / total if total else 100
        left = (now - self.started) * (total - done) / done if done else 0
        if self.unit is None:
            count = f"{done / 2**20:8.1f} of {total / 2**20:.1f} MiB"
        else:
            count = f"[{'#' * int(share / 5):20}] {done} of {total} {self.unit}"
        line = f"{share:5.1f} %  {count}  {left:4.0f} s left  {what}"
        print(f"\r{line[:118]:<118}" if self.live else line, end="" if self.live else "\n", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Ends the line that is being rewritten."""
        if self.live and not self.quiet:
            print(file=sys.stderr)


def main(arguments: list[str] | None = None) -> int:
    """Runs one command. Returns 0 on success, and 2 with a message on standard error on failure."""
    options = parser().parse_args(arguments)
    try:
        return _COMMANDS[options.command](options)
    except BuildError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        where, cause = error.filename or "file system", error.strerror or error
        print(f"error: {where}: {cause}. Check the path and the space left.", file=sys.stderr)
        return 2


def _with_options(options: argparse.Namespace, geometry: Geometry) -> Geometry:
    geometry = geometry.with_(streaming_encoder=True) if options.streaming_encoder else geometry
    geometry = geometry.with_(joined=True) if options.joined else geometry
    return geometry if options.residual is None else geometry.with_(residual=options.residual)


def _build(options: argparse.Namespace, geometry: Geometry, source, **facts) -> int:
    progress = Printer(options.quiet)
    precisions = ("f32",) if options.precision == "f32" else ("f32", "f16")
    build_bundle(
        geometry, source, options.out, precisions=precisions, progress=progress, replace=options.replace, **facts
    )
    progress.close()
    if not options.quiet:
        print(table.describe(geometry))
        print(f"\nwrote {options.out}")
    return 0


def _checkpoint(options: argparse.Namespace) -> int:
    found = open_checkpoint(options.directory, options.autoencoder, options.max_window)
    licence_file = options.licence_file or options.directory / "LICENSE"
    if options.licence_file is not None or licence_file.is_file():
        licence = Licence.read(options.licence, licence_file)
    else:
        licence = Licence(options.licence)
    result = _build(
        options,
        _with_options(options, found.geometry),
        found,
        name=options.name or options.directory.resolve().name[:100],
        provenance={**found.provenance, "rounding": options.rounding},
        licence=licence,
        rounding=options.rounding,
    )
    if found.too_small and not options.quiet:
        print(f"{found.too_small} of the checkpoint's numbers are too small for float16 and became 0")
    return result


def _random(options: argparse.Namespace) -> int:
    if not 0 <= options.seed < 1 << 64:
        raise BuildError(f"{options.seed} is outside 0 .. 2^64 - 1", field="--seed", remedy="Choose a seed in that range.")
    geometry = _with_options(options, chosen_geometry(options))
    return _build(
        options,
        geometry,
        RandomWeights(geometry, options.seed),
        name=options.name or f"Random {options.preset or 'tiny'} world, seed {options.seed}",
        provenance={"tool": "cairn.build", "weights": "random: they show no trained world", "seed": str(options.seed)},
        licence=Licence("CC0-1.0"),
    )


def _describe(options: argparse.Namespace) -> int:
    if options.bundle is not None:
        shapes = ["preset", *_SHAPES, "patch", "decoder_widths", "render"]
        for name in (name for name in shapes if getattr(options, name) is not None):
            option = "--" + name.replace("_", "-")
            raise BuildError("a bundle has its own shapes", field=option, remedy=f"Leave out {option}, or the bundle.")
        print(table.describe(archive.read_geometry(options.bundle), archive.read_quantisation(options.bundle)))
    else:
        print(table.describe(chosen_geometry(options)))
    return 0


def _rates(options: argparse.Namespace) -> int:
    if options.points:
        print(rates.evidence())
        return 0
    named = _named_worlds(options)
    if options.by_bits:
        for option, given in (("--weights", options.weights != 16), ("--summary", options.summary), ("--reports", options.reports)):
            if given:
                raise BuildError("the table of bits has all of them and nothing else", field=option, remedy=f"Leave out {option}.")
        if any(world.quantisation is not None for world in named):
            raise BuildError("a bundle has fewer bits already", field="--by-bits", remedy="Name the bundle that it was made from.")
        suffix = ", joined passes" if options.joined else ""
        worlds = [rates.in_each_precision(world.name + suffix, world.geometry.with_(joined=options.joined)) for world in named]
        print(rates.by_bits(worlds))
        return 0
    if options.joined:
        named = [world._replace(name=f"{world.name}, joined passes", geometry=world.geometry.with_(joined=True)) for world in named]
    worlds = [rates.World(world.name, world.geometry, world.quantisation) for world in named]
    if options.reports is None:
        print((rates.summary if options.summary else rates.table)(worlds))
        return 0
    if options.joined:
        raise BuildError("the reports are of separate cache passes", field="--reports", remedy="Leave out --joined.")
    if options.summary:
        raise BuildError("the short table has no measured rates", field="--reports", remedy="Leave out --summary.")
    if not any(world.name == measured.WORLD for world in worlds):
        raise BuildError(
            f"the reports are of the world {measured.WORLD}, which is not named",
            field="--reports",
            remedy="Name samples/worlds/miniature.cairn as well.",
        )
    print(rates.table(worlds, measured.read(options.reports)))
    return 0


class _NamedWorld(NamedTuple):
    """A bundle or a preset that the command line names."""

    name: str
    geometry: Geometry
    quantisation: Quantisation | None
    bundle: Path | None = None


def _named_worlds(options: argparse.Namespace) -> list[_NamedWorld]:
    """The bundles and presets. Their names differ."""
    worlds = [_NamedWorld(_bundle_name(b), archive.read_geometry(b), archive.read_quantisation(b), b) for b in options.bundles]
    quantisation = None if options.weights == 16 else Quantisation(options.weights)
    suffix = "" if quantisation is None else f", {options.weights}-bit weights"
    worlds += [_NamedWorld(name + suffix, PRESETS[name][1], quantisation) for name in options.preset]
    if not worlds:
        raise BuildError("no world is named", field="bundle", remedy="Name a bundle, or shapes: --preset 360p --preset 720p.")
    names = [world.name for world in worlds]
    for name in (name for name in names if names.count(name) > 1):
        raise BuildError(f"several worlds are called {name}", field="bundle", remedy="Rename one of the bundles, or name each world once.")
    return worlds


def _bundle_name(bundle: Path) -> str:
    return bundle.resolve().name.removesuffix(archive.SUFFIX)


def _costs(options: argparse.Namespace) -> int:
    found = {}
    for world in _named_worlds(options):
        graphs = None if world.bundle is None else costs.stored_graphs(world.bundle)
        found[world.name] = costs.world_costs(world.geometry, world.quantisation, graphs)
    print(json.dumps(found))
    return 0


def _rebuild(options: argparse.Namespace) -> int:
    progress = Printer(options.quiet)
    facts = {"residual": options.residual, "joined": options.joined}
    rebuild(options.bundle, options.out, progress=progress, replace=options.replace, **facts)
    progress.close()
    if not options.quiet:
        print(f"wrote {options.out}")
    return 0


def _quantise(options: argparse.Namespace) -> int:
    kept = () if options.keep_16 == "none" else tuple(name.strip() for name in options.keep_16.split(","))
    quantisation = Quantisation(options.weights, options.block, options.activations, kept)
    progress = Printer(options.quiet)
    facts = {"quantisation": quantisation, "residual": options.residual, "joined": options.joined}
    rebuild(options.bundle, options.out, progress=progress, replace=options.replace, **facts)
    progress.close()
    if not options.quiet:
        print(table.describe(archive.read_geometry(options.out), quantisation))
        print(f"\nwrote {options.out}")
    return 0


def _sensitivity(options: argparse.Namespace) -> int:
    progress = Printer(options.quiet, "passes")
    report = sensitivity.measure(
        options.bundle,
        options.weights,
        options.block,
        options.bound,
        walks=options.walks,
        threads=options.threads,
        progress=progress,
    )
    progress.close()
    print(sensitivity.table(report))
    return 0


def _pack(options: argparse.Namespace) -> int:
    if options.bundle.is_dir():
        archive.pack(options.bundle, options.out, options.replace)
    else:
        archive.unpack(options.bundle, options.out, options.replace)
    print(f"wrote {options.out}")
    return 0


_COMMANDS = {
    "checkpoint": _checkpoint,
    "random": _random,
    "describe": _describe,
    "rates": _rates,
    "costs": _costs,
    "rebuild": _rebuild,
    "quantise": _quantise,
    "sensitivity": _sensitivity,
    "pack": _pack,
}
