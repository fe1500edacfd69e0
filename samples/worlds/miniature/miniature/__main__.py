"""The command line: `python -m miniature`."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HELP = """\
Trains the miniature world from nothing, with fixed seeds. Every command goes on where it was interrupted, from one folder; `all`
runs them one after the other. A command that has done its work ends with status 0, one that --minutes ended before that with 3.
"""
UNFINISHED = 3
# The world inside the library.
PRESET_NAMES = ("cpu", "gpu", "further", "longer", "balanced", "levels", "levels-smoke", "levels-further", "levels-further-smoke", "levels-longer", "levels-longer-smoke", "smoke")
SHIPPED = Path(__file__).resolve().parents[2] / "miniature.cairn"
# Bytes of a piece of `result`.
RESULT_PIECE = 15_500_000
# Number of walks that are rendered in parallel.
DRAWN_AT_ONCE = 3


def default_folder() -> Path:
    """Default folder of states and clips."""
    cache = os.environ.get("CAIRN_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "cairn" / "miniature-training"


def parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    top = argparse.ArgumentParser(prog="python -m miniature", description=HELP)
    top.add_argument("--folder", type=Path, default=default_folder(), help="states and clips (%(default)s)")
    top.add_argument("--preset", choices=PRESET_NAMES, default="cpu", help="sizes and steps (cpu)")
    top.add_argument("--renderer", type=Path, help="the scenes program (`scenes` in the folder unless given)")
    top.add_argument("--bundle", type=Path, default=SHIPPED, help="the world that `begin` and `--share` take (%(default)s)")
    top.add_argument("--share", type=share, default=1.0, metavar="S", help="`checkpoint`: S of the trained weights, the rest of --bundle's (1)")
    top.add_argument("--minutes", type=float, default=float("inf"), help="stop training after so many minutes, to go on later")
    top.add_argument("--until", type=int, default=sys.maxsize, metavar="N", help="`autoencoder`, `world`: end at step N of the plan; `clips`: end with clip N (the last)")
    top.add_argument("--walks", type=int, default=8, choices=range(1, 9), metavar="N", help="scores: held-out walks of each level (8)")
    top.add_argument("--seconds", type=float, default=15.0, help="`score-world`: length of a walk, at most 60 (%(default)s)")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (_, what) in COMMANDS.items():
        commands.add_parser(name, help=what)
    commands.add_parser("all", help="all of these, in this order")
    for name, (_, what) in MOVING.items():
        commands.add_parser(name, help=what)
    return top


def share(text: str) -> float:
    """A number from 0 to 1."""
    if not 0.0 <= (value := float(text)) <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is not from 0 to 1")
    return value


class Job:
    """Folder, options and preset of a run."""

    def __init__(self, options: argparse.Namespace):
        from .shapes import PRESETS

        self.folder: Path = options.folder
        self.renderer: Path = options.renderer or options.folder / "scenes"
        self.bundle: Path = options.bundle
        self.minutes: float = options.minutes
        self.until: int = options.until
        self.share: float = options.share
        self.walks: int = options.walks
        self.seconds: float = options.seconds
        self.preset = PRESETS[options.preset]
        self.geometry = self.preset.geometry
        self.autoencoder = self.folder / "autoencoder.npz"
        self.world = self.folder / "world.npz"

    def say(self, line: str) -> None:
        """Prints a line and keeps it in the folder's log."""
        print(line, flush=True)
        with (self.folder / "training.log").open("a", encoding="utf-8") as file:
            file.write(line + "\n")


def draw_clips(job: Job) -> bool:
    """Renders the clips of the autoencoder."""
    from . import clips, levels

    render = levels.draw_training_clip if job.preset.levels else clips.render
    for number in job.preset.clips[: job.until]:
        render(job.renderer, job.folder / "clips", number, job.preset.autoencoder.seconds, job.geometry.decoded)
    return True


def train_autoencoder(job: Job) -> bool:
    """Trains the autoencoder on the existing clips."""
    from . import clips, levels, train_autoencoder

    found = clips.ready(job.folder / "clips", job.geometry.decoded)
    if job.preset.levels:
        levels.require_trainable(found)
    if len(found) < job.preset.autoencoder.clips:
        job.say(f"{len(found)} of {job.preset.autoencoder.clips} clips are there: the weights will be others than with all")
    plan = job.preset.autoencoder
    state = train_autoencoder.train(job.autoencoder, job.geometry, plan, found, job.minutes, job.say, job.until)
    return int(state.step) >= min(plan.steps, job.until)


def score_autoencoder(job: Job) -> bool:
    """Scores the autoencoder on held-out scenes, or on held-out walks through the levels."""
    from . import levels, perceptual, score, store

    shown = job.preset.timed and job.preset.timed.shown
    parameters, folder, size = store.mean_parameters(job.autoencoder), job.folder / "held-out", shown or job.geometry.decoded
    if job.preset.levels:
        found = levels.held_out_clips(job.renderer, folder, job.walks, score.WALK_SECONDS, size)
        what = f"{job.walks} held-out walks of each level, {score.WALK_SECONDS:g} s, at {size[0]}x{size[1]}"
    else:
        found = score.held_out_clips(job.renderer, folder, size)
        what = f"held-out seed {score.SEED}"
    networks = {}
    try:
        if min(size) >= perceptual.SMALLEST:
            networks = {name: perceptual.load(name) for name in perceptual.NETWORKS}
    except perceptual.MissingWeights as error:
        job.say(f"no LPIPS: {error}")
    scorer = score.Scorer(parameters, networks, job.geometry.decoded)
    figures = {clip.path.name: scorer.scores(clip) for clip in found}
    job.say(f"autoencoder, {what}")
    for family in dict.fromkeys(clip.family for clip in found):
        job.say(f"{family:8} {score.Scores.mean([figures[clip.path.name] for clip in found if clip.family == family])}")
    job.say(f"mean     {score.Scores.mean(list(figures.values()))}")
    return True


def score_world(job: Job) -> bool:
    """Rolls the bundle out on held-out walks through the levels."""
    from . import rollouts

    bundle = job.folder / "bundle" if (job.folder / "bundle").is_dir() else job.bundle
    job.say(f"{bundle}: {job.walks} held-out walks of each level, {job.seconds:g} s")
    rollouts.held_out(bundle, job.renderer, job.folder / "rollouts", job.walks, job.seconds, job.say)
    return True


def encode_walks(job: Job) -> bool:
    """Renders and encodes the walks of the transformer, and deletes the pictures."""
    from . import clips, latents, levels, store

    parameters = store.mean_parameters(job.autoencoder)
    digest = hashlib.sha256(b"".join(parameters[name].tobytes() for name in sorted(parameters))).hexdigest()
    folder, mark = job.folder / "latents", job.folder / "latents" / "autoencoder.sha256"
    if mark.is_file() and mark.read_text() != digest:
        raise SystemExit(f"error: {folder} holds latents of another autoencoder. Remove it to have them made again.")
    folder.mkdir(parents=True, exist_ok=True)
    mark.write_text(digest)
    encoder, plan = latents.Encoder(parameters), job.preset.world
    # The autoencoder's clips serve as short walks.
    for clip in clips.ready(job.folder / "clips", job.geometry.decoded):
        path = folder / f"{clip.path.name}.npz"
        if not path.is_file():
            latents.encode_clip(encoder, clip, path)
    def draw(walk: int) -> tuple[clips.Clip, Path] | None:
        if job.preset.levels:
            number = job.preset.first + walk
            drawn = levels.training_walk(number, plan.seconds_of(walk))
            path = folder / f"{drawn.family}-{drawn.seed}-{number}.npz"
            path.with_suffix(".txt").write_text(drawn.script, encoding="utf-8")
            if path.is_file():
                return None
            clip = levels.draw_training_clip(job.renderer, job.folder / "walks", number, plan.seconds_of(walk), job.geometry.decoded)
            levels.require_trainable([clip])
            return clip, path
        number = job.preset.clips.stop + walk
        family, seed = clips.clip_name(number)
        path = folder / f"{family}-{seed}.npz"
        if path.is_file():
            return None
        return clips.render(job.renderer, job.folder / "walks", number, plan.seconds_of(walk), job.geometry.decoded), path

    # The next walks are rendered while one is encoded.
    with ThreadPoolExecutor(DRAWN_AT_ONCE) as pool:
        coming = deque(pool.submit(draw, walk) for walk in range(min(DRAWN_AT_ONCE, plan.count)))
        for walk in range(plan.count):
            drawn = coming.popleft().result()
            if walk + DRAWN_AT_ONCE < plan.count:
                coming.append(pool.submit(draw, walk + DRAWN_AT_ONCE))
            if drawn is not None:
                clip, path = drawn
                latents.encode_clip(encoder, clip, path, mirror=not job.preset.levels)
                clips.remove(clip)
                job.say(f"walk {walk + 1}/{plan.count}: {path.stem}")
    return True


def train_world(job: Job) -> bool:
    """Trains the transformer on the existing latents."""
    from . import latents, train_world

    walks, plan = latents.Walks.read(job.folder / "latents"), job.preset.world
    wanted = job.preset.autoencoder.clips + plan.count
    if len(walks.walks) < wanted:
        job.say(f"{len(walks.walks)} of {wanted} clips and walks are there: the weights will be others than with all")
    state = train_world.train(job.world, job.geometry, plan, walks, job.minutes, job.say, job.preset.clips, job.until)
    return int(state.step) >= min(plan.steps, job.until)


def write_checkpoint(job: Job) -> bool:
    """Writes both networks in the released layout; the transformer is interpolated between the bundle's and the trained one."""
    from . import begin, export, store

    world = store.mean_parameters(job.world)
    if job.share < 1.0:
        before, _ = begin.weights(job.bundle, job.geometry)
        world = {name: job.share * value + (1.0 - job.share) * before[name] for name, value in world.items()}
        job.say(f"checkpoint: {job.share} of the trained weights, the rest of {job.bundle.name}")
    export.write_checkpoint(job.folder / "checkpoint", job.geometry, world, store.mean_parameters(job.autoencoder))
    return True


def build_bundle(job: Job) -> bool:
    """Builds the bundle with `cairn.build`, like one of released weights."""
    from cairn.build import cli

    arguments = ["checkpoint", str(job.folder / "checkpoint"), "--out", str(job.folder / "bundle"), "--replace", "--quiet"]
    arguments += ["--rounding", "none", "--name", "Miniature", "--licence", "MIT OR Apache-2.0"]
    return cli.main(arguments) == 0


def write_held_out_walks(job: Job) -> bool:
    """Writes the scripts of the held-out walks beside the package."""
    from . import levels

    print(f"{len(levels.write_held_out_walks())} scripts in {levels.SCRIPTS}")
    return True


def begin(job: Job) -> bool:
    """Writes initial states with a bundle's weights."""
    from . import begin

    for state in (job.autoencoder, job.world):
        if state.is_file():
            raise SystemExit(f"error: {state} is there already. Name another folder with --folder, or remove it.")
    begin.states(job.bundle, job.geometry, job.preset.autoencoder, job.autoencoder, job.world)
    job.say(f"begun with the weights of {job.bundle.name}")
    return True


def train_timed(job: Job) -> bool:
    """Trains both networks on one GPU within --minutes, or until the time in the folder's file `end`."""
    import jax

    from . import timed

    if job.preset.timed is None:
        raise SystemExit("error: this preset has no plan by time. Use --preset levels")
    if not 0 < job.minutes < float("inf"):
        raise SystemExit("error: `timed` needs --minutes")
    job.say(f"devices: {jax.devices()}, JAX {jax.__version__}, {os.cpu_count()} cores")
    timed.train(job.folder, job.renderer, job.bundle, job.preset, 60 * job.minutes, job.say)
    return True


def write_result(job: Job) -> bool:
    """Writes the mean parameters of both networks in float16, in pieces."""
    import numpy as np

    from . import pieces, store

    arrays = {}
    for part, state in (("autoencoder", job.autoencoder), ("world", job.world)):
        if state.is_file():
            arrays |= {f"{part}/{name}": value.astype(np.float16) for name, value in store.mean_parameters(state).items()}
    path = job.folder / "result.npz"
    np.savez(path, **arrays)
    print(f"{len(pieces.split(path, job.folder / 'result', RESULT_PIECE))} pieces in {job.folder / 'result'}")
    return True


def take_result(job: Job) -> bool:
    """Writes states with the parameters that `result` wrote."""
    import numpy as np

    from . import optimiser, pieces, store, train_world

    path = job.folder / "result.npz"
    pieces.join(job.folder / "result", path)
    with np.load(path) as file:
        for part, state, by_muon in (("autoencoder", job.autoencoder, lambda _: False), ("world", job.world, train_world.by_muon)):
            names = [key for key in file.files if key.startswith(f"{part}/")]
            found = {key.partition("/")[2]: file[key].astype(np.float32) for key in names}
            if found:
                store.save(state, optimiser.start(found, by_muon), {"seconds": 0.0, "flops": 0.0})
                print(f"{state}: {len(found)} tensors")
    return True


def cut(job: Job) -> bool:
    """Splits both states into the folder `pieces`."""
    from . import pieces

    for state in (job.autoencoder, job.world):
        if state.is_file():
            written = pieces.split(state, job.folder / "pieces")
            print(f"{state.name}: {len(written)} pieces in {job.folder / 'pieces'}")
    return True


def put_together(job: Job) -> bool:
    """Joins both states from the folder `pieces`."""
    from . import pieces

    for state in (job.autoencoder, job.world):
        if (job.folder / "pieces" / f"{state.name}.pieces").is_file():
            pieces.join(job.folder / "pieces", state)
            print(f"{state}: whole")
    return True


COMMANDS = {
    "clips": (draw_clips, "draw the clips of the autoencoder"),
    "autoencoder": (train_autoencoder, "train the autoencoder on the clips that are there"),
    "score-autoencoder": (score_autoencoder, "PSNR, LPIPS and detail of the autoencoder on places, or walks through its levels, that it has never seen"),
    "walks": (encode_walks, "draw the walks of the transformer, and keep them as latents"),
    "world": (train_world, "train the transformer on the latents that are there"),
    "checkpoint": (write_checkpoint, "write both networks in Waypoint-1.5's released layout"),
    "bundle": (build_bundle, "make the bundle of the checkpoint, with cairn.build"),
}
# Commands that start from a bundle or transfer states; not part of `all`.
MOVING = {
    "score-world": (score_world, "roll the bundle out on held-out walks through the levels, with Cairn's library"),
    "held-out-walks": (write_held_out_walks, "write the scripts of the held-out walks, which `study world-quality` reads"),
    "begin": (begin, "take the weights of a bundle, to train them further with --preset further"),
    "timed": (train_timed, "train both networks on one GPU within --minutes: draws, encodes and trains at once"),
    "result": (write_result, "write what `timed` trained, in float16 and in pieces below 16 MB"),
    "take": (take_result, "make states of what `result` wrote"),
    "pieces": (cut, "cut the training states into pieces below 15 MiB"),
    "join": (put_together, "put the training states together of such pieces"),
}


def main(arguments: list[str] | None = None) -> int:
    """Runs one command, or all."""
    options = parser().parse_args(arguments)
    job = Job(options)
    if job.preset.first and options.command in {"all", *COMMANDS} and not job.world.is_file():
        raise SystemExit(f"error: {job.world} is not there, and --preset {options.preset} goes on from a world. Run `begin` first.")
    import jax

    # Compiling takes as long as dozens of steps, so compiled programs are cached beside the states.
    jax.config.update("jax_compilation_cache_dir", str(options.folder / "compiled"))
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in COMMANDS if options.command == "all" else [options.command]:
        if not (COMMANDS | MOVING)[name][0](job):
            return UNFINISHED
    return 0


def keep_memory() -> None:
    """Restarts the program with allocator settings that keep freed memory, in large pages: the next step needs the same memory, and
    mapping and clearing it again takes a quarter of the time. Only the GNU C library has these settings, and reads them at the start.
    """
    if sys.platform == "linux" and "GLIBC_TUNABLES" not in os.environ:
        settings = ("hugetlb=1", "mmap_max=0", f"trim_threshold={1 << 40}", "arena_max=1")
        os.environ["GLIBC_TUNABLES"] = ":".join(f"glibc.malloc.{setting}" for setting in settings)
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


if __name__ == "__main__":
    keep_memory()
    sys.exit(main())
