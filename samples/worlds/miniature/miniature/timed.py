"""Trains the world of the four levels in a given time, on one GPU and all cores of its machine.

Everything happens at once: the cores draw walks all the time, short ones first, while the GPU trains the autoencoder on those that are
there; then all walks are encoded, later ones as they come, and the transformer is trained on them. What is done when is planned by time:
learning rates fall to zero at the end, whenever that is. So what step n does depends on the clock too, unlike in the other trainings.

The folder's file `end` has the time of the end in seconds since 1970, and may be changed while the training runs. A training that was
killed goes on with its last state.
"""

from __future__ import annotations

import itertools
import json
import queue
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from . import begin, latents, levels, optimiser, perceptual, store, train_autoencoder, train_world
from .clips import Clip
from .shapes import Preset, Stage, TimedPlan

# Steps of a schedule that is planned by time.
POSITIONS = 40_000
# Steps that the GPU may be behind the host.
AHEAD = 4
# Seconds between two lines of the log, two writes of a state, and two looks for new walks.
SAY_EVERY, KEEP_EVERY, LOOK_EVERY = 10.0, 50.0, 1.0
# Clips of four pictures that a GPU encodes at once.
AT_ONCE = 64


@dataclass
class Clock:
    """Times of a training in seconds since 1970. Its start is kept in the folder, so that a training that was killed keeps its plan."""

    folder: Path
    seconds: float

    def __post_init__(self) -> None:
        began = self.folder / "began"
        if not began.is_file():
            began.write_text(str(time.time()))
            self._end.write_text(str(time.time() + self.seconds))
        self.began = float(began.read_text())

    @property
    def _end(self) -> Path:
        return self.folder / "end"

    @property
    def end(self) -> float:
        """When the training ends."""
        try:
            return float(self._end.read_text())
        except ValueError:  # it is being written
            return self.began + self.seconds

    @property
    def now(self) -> float:
        """Seconds since the start."""
        return time.time() - self.began


class Renderers:
    """Draws training walks on all cores, and lists those that are there."""

    def __init__(self, folder: Path, renderer: Path, plan: TimedPlan, size: tuple[int, int], until: Callable[[], float], say: Callable[[str], None]):
        self._folder, self._renderer, self._plan, self._size = folder / "clips", renderer, plan, size
        self._until, self._say = until, say
        self._numbers = itertools.count()
        self._lock = threading.Lock()
        self._first = plan.first_number
        self._short = plan.shown or size
        self.clips: list[Clip] = []
        self.failed = 0
        self._threads = [threading.Thread(target=self._draw, daemon=True) for _ in range(plan.renderers)]
        for thread in self._threads:
            thread.start()

    def _draw(self) -> None:
        while time.time() < self._until():
            with self._lock:
                number = next(self._numbers)
            size = self._short if number < self._plan.short.count else self._size
            try:
                clip = levels.draw_training_clip(self._renderer, self._folder, self._first + number, self._plan.seconds_of(number), size)
                levels.require_trainable([clip])
                with self._lock:
                    self.clips.append(clip)
            except Exception as error:
                self.failed += 1
                self._say(f"walk {number} was not drawn: {error}")
                time.sleep(min(10.0, self.failed))

    def seconds_drawn(self) -> float:
        """Seconds of world time that are there."""
        return sum((len(clip.pictures()) - 1) / 60 for clip in list(self.clips))


class Prefetch:
    """Batches on the device, made by threads ahead of their use: number n by `make(rng of n)`."""

    def __init__(self, seed: int, make: Callable[[np.random.Generator], Any], first: int, threads: int = 3, depth: int = 6):
        self._seed, self._make, self._numbers = seed, make, itertools.count(first)
        self._ready: queue.Queue = queue.Queue(depth)
        self._lock, self._stopped = threading.Lock(), False
        for _ in range(threads):
            threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while not self._stopped:
            with self._lock:
                number = next(self._numbers)
            try:
                item = jax.device_put(self._make(np.random.default_rng([self._seed, number])))
            except Exception as error:
                item = error
            while not self._stopped:
                try:
                    self._ready.put(item, timeout=0.5)
                    break
                except queue.Full:
                    pass

    def __next__(self) -> Any:
        item = self._ready.get(timeout=60)
        if isinstance(item, Exception):
            raise item
        return item

    def stop(self) -> None:
        """Ends the threads."""
        self._stopped = True


class Log:
    """Mean metrics of the last steps, printed from time to time; the host waits for the GPU only where it is `AHEAD` steps behind."""

    def __init__(self, clock: Clock, say: Callable[[str], None]):
        self._clock, self._say = clock, say
        self._pending: deque = deque()
        self._since: list[dict] = []
        self._printed = time.time()

    def add(self, figures: dict, name: str, number: int, more: str = "") -> None:
        """Adds a step's metrics."""
        self._pending.append(figures)
        if len(self._pending) <= AHEAD:
            return
        done = self._pending.popleft()
        jax.block_until_ready(done)
        self._since.append(done)
        now = time.time()
        if now - self._printed > SAY_EVERY:
            values = jax.device_get(self._since)
            text = "  ".join(f"{key} {np.mean([v[key] for v in values]):.4g}" for key in values[0])
            pace = len(values) / (now - self._printed)
            self._say(f"{self._clock.now:5.0f} s  {name} step {number}  {text}  {pace:.1f} steps/s{more}")
            self._since, self._printed = [], now


class Encoded:
    """Latents of all walks that were drawn, encoded by threads as they come, and of those that were there before."""

    def __init__(
        self, parameters: dict, clips: Callable[[], list[Clip]], say: Callable[[str], None], found: dict[str, dict] | None = None, threads: int = 4
    ):
        self._encoder, self._clips, self._say = latents.Encoder(parameters, AT_ONCE), clips, say
        self._begun: set[Path] = set()
        self._lock, self._stopped = threading.Lock(), False
        self._found: dict[str, dict] = dict(found or {})
        for _ in range(threads):
            threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while not self._stopped:
            with self._lock:
                clip = next((c for c in self._clips() if c.path not in self._begun), None)
                if clip is not None:
                    self._begun.add(clip.path)
            if clip is None:
                time.sleep(LOOK_EVERY)
                continue
            try:
                arrays = latents.encode(self._encoder, clip, mirror=False)
                with self._lock:
                    self._found[clip.path.name] = arrays
            except Exception as error:
                self._say(f"{clip.path.name} was not encoded: {error}")

    def __len__(self) -> int:
        return len(self._found)

    def walks(self) -> latents.Walks:
        """Those that are there."""
        with self._lock:
            return latents.Walks(dict(self._found))

    def stop(self) -> None:
        """Ends the threads."""
        self._stopped = True


class Training:
    """The whole training."""

    def __init__(self, folder: Path, renderer: Path, bundle: Path, preset: Preset, seconds: float, say: Callable[[str], None]):
        assert preset.timed is not None
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.bundle, self.preset, self.plan, self.say = folder, bundle, preset, preset.timed, say
        self.geometry = preset.geometry
        self.clock = Clock(folder, seconds)
        until = lambda: self.clock.end - self.plan.draw_until
        self.renderers = Renderers(folder, renderer, self.plan, self.geometry.decoded, until, self.tell)
        # Compiles in the order of use.
        self._compiler = ThreadPoolExecutor(self.plan.compilers)
        self._saving = threading.Lock()
        self._state_path = {"autoencoder": folder / "autoencoder.npz", "world": folder / "world.npz"}
        # States at the ends of stages, to compare.
        self._state_path |= {f"after-{number}": folder / f"after-{number}.npz" for number in range(len(self.plan.stages))}

    def tell(self, line: str) -> None:
        """A line of the log with its time."""
        self.say(f"{self.clock.now:5.0f} s  {line}")

    # -- parts that both trainings use

    def _keep(self, name: str, state: optimiser.State) -> None:
        """Writes a state, on a thread."""
        threading.Thread(target=self._save, args=(name, jax.device_get(state))).start()

    def _save(self, name: str, state: optimiser.State, flops: float = 0.0) -> None:
        with self._saving:
            store.save(self._state_path[name], state, {"seconds": self.clock.now, "flops": flops})

    def _compile(self, name: str, lower: Callable[[], Any]) -> Any:
        """A future of a compiled program."""

        def work():
            began = time.time()
            try:
                program = lower().compile()
                self.tell(f"compiled {name} in {time.time() - began:.0f} s")
                return program
            except Exception as error:
                self.tell(f"{name} was not compiled: {str(error)[:300]}")
                raise

        return self._compiler.submit(work)

    # -- the autoencoder

    def _pictures(self) -> list[Clip]:
        """The clips that the autoencoder is trained on."""
        clips = self.renderers.clips[:]
        return [clip for clip in clips if (clip.width, clip.height) == self.plan.shown] if self.plan.shown else clips

    def autoencoder(self) -> dict[str, np.ndarray]:
        """Trains the autoencoder and returns its mean parameters."""
        done = self.folder / "autoencoder.done"
        path, plan = self._state_path["autoencoder"], self.plan.autoencoder
        state, _ = store.load(path)
        if done.is_file():
            return store.mean_parameters(path)
        settings = optimiser.Settings(rate=plan.rate, steps=POSITIONS, warm_up=POSITIONS // 40, cool_down=self.plan.cool_down)
        weights = perceptual.load("alex") if plan.perceptual else None
        width, height = plan.crop
        shape = (plan.batch, plan.latents, 4, height, width, 3)
        arguments = (settings, plan, weights, state, jax.ShapeDtypeStruct(shape, np.uint8), jax.random.key(0), np.int32(0))
        program = self._compile("autoencoder", lambda: train_autoencoder.step.lower(*arguments))
        program = program.result()
        if not self.plan.side_by_side:
            self._compile_world()
        while len(self._pictures()) < self.plan.first_clips:
            time.sleep(0.2)
        from_, until = self.clock.now, self.plan.autoencoder_share * (self.clock.end - self.clock.began) - self.plan.spare
        self.tell(f"autoencoder: begins with {len(self._pictures())} clips, ends at {until:.0f} s")
        batches = Prefetch(train_autoencoder.SEED, lambda rng: train_autoencoder.sample(rng, self._pictures(), plan), int(state.step))
        log, kept, number, key = Log(self.clock, self.say), time.time(), int(state.step), jax.random.key(train_autoencoder.SEED)
        began = self._first_second("autoencoder", from_)
        while (now := self.clock.now) < until:
            at = np.int32(POSITIONS * min(1.0, (now - began) / (until - began)))
            state, figures = program(weights, state, next(batches), jax.random.fold_in(key, number), at)
            number += 1
            log.add(figures, "autoencoder", number, f"  {len(self._pictures())} clips")
            if time.time() - kept > KEEP_EVERY:
                self._keep("autoencoder", state)
                kept = time.time()
        batches.stop()
        state = jax.device_get(state)
        flops = train_autoencoder.flops(self.geometry, plan) * number
        self._save("autoencoder", state, flops)
        done.write_text("")
        self.tell(f"autoencoder: {number} steps, {flops:.3g} FLOP")
        return {name: value for name, value in state.mean.items() if not name.startswith(train_autoencoder.adversary.PREFIX)}

    def _first_second(self, name: str, now: float) -> float:
        """When a part first began, in seconds from the start: kept, so that a schedule goes on after a kill."""
        file = self.folder / f"{name}.began"
        if not file.is_file():
            file.write_text(str(now))
        return float(file.read_text())

    # -- the transformer

    def _compile_world(self) -> None:
        """Begins to compile the encoder, and the programs of all stages."""
        self._programs = []
        state, _ = store.load(self._state_path["world"])
        parameters = store.mean_parameters(self._state_path["autoencoder"])
        self.world_settings = optimiser.Settings(
            rate=self.plan.rate, muon_rate=self.plan.muon_rate, decay=self.plan.decay, steps=POSITIONS, warm_up=POSITIONS // 50, cool_down=self.plan.cool_down
        )
        g = self.geometry
        width, height = g.decoded

        def encoder():
            quads = jax.ShapeDtypeStruct((AT_ONCE, 4, height, width, 3), np.uint8)
            return latents._encode.lower({name: jnp.asarray(value) for name, value in parameters.items()}, quads)

        self._encoder = self._compile("encoder", encoder)
        for number, (_, stage) in enumerate(self.plan.stages):
            window = (stage.batch, stage.frames, g.latent_height, g.latent_width, g.latent_channels)
            array = lambda *shape: jax.ShapeDtypeStruct(shape, np.float16)
            arguments = (self.world_settings, g, stage, np.int32(stage.windows[0]), state, array(*window), array(*window))
            arguments += (array(stage.batch, stage.frames, 2 + g.buttons + 1), jax.random.key(0), np.int32(0))
            lower = lambda arguments=arguments: train_world.step.lower(*arguments)
            self._programs.append(self._compile(f"stage {number}: {stage.frames} frames", lower))

    def _stages(self, share: float) -> Iterator[int]:
        """Numbers of the stages, the planned one first, then earlier and later ones, for where a program is missing."""
        planned, total = 0, 0.0
        for number, (part, _) in enumerate(self.plan.stages):
            if total <= share:
                planned = number
            total += part
        yield planned
        yield from range(planned - 1, -1, -1)
        yield from range(planned + 1, len(self.plan.stages))

    def world(self, parameters: dict[str, np.ndarray]) -> None:
        """Encodes the walks and trains the transformer until the end."""
        if not hasattr(self, "_programs"):
            self._compile_world()
        path = self._state_path["world"]
        found = latents.Walks.read(self.folder / "latents", levels.require_trainable_latents) if (self.folder / "latents").is_dir() else None
        decoded = lambda: [clip for clip in self.renderers.clips[:] if (clip.width, clip.height) == self.geometry.decoded]
        encoded = Encoded(parameters, decoded, self.tell, dict(zip(found.names, found.walks)) if found else None)
        while len(encoded) < self.plan.first_clips:
            time.sleep(0.2)
        while not any(program.done() and not program.exception() for program in self._programs):
            time.sleep(0.2)
        began = self._first_second("world", self.clock.now)
        self.tell(f"world: begins with {len(encoded)} walks")
        state, _ = store.load(path)
        log, kept, number, key = Log(self.clock, self.say), time.time(), int(state.step), jax.random.key(train_world.SEED)
        broken: set[int] = set()
        batches: Prefetch | None = None
        # What the threads that make batches see.
        self._walks = encoded.walks()
        current, looked = -1, time.time()
        flops = 0.0
        while (now := self.clock.now) < (until := self.clock.end - self.clock.began - self.plan.spare):
            share = (now - began) / (until - began)
            usable = lambda n: n not in broken and self._programs[n].done() and not self._programs[n].exception() and self._walks.steps.max() >= self.plan.stages[n][1].frames
            stage_number = next((n for n in self._stages(share) if usable(n)), None)
            if stage_number is None:
                time.sleep(1.0)
                self._walks = encoded.walks()
                continue
            stage = self.plan.stages[stage_number][1]
            if time.time() - looked > LOOK_EVERY:
                self._walks, looked = encoded.walks(), time.time()
            if stage_number != current:
                if current >= 0:
                    self._save(f"after-{current}", jax.device_get(state))
                if batches is not None:
                    batches.stop()
                batches = Prefetch(train_world.SEED, self._maker(stage), number)
                self.tell(f"stage {stage_number}: {stage}")
                current = stage_number
            latents_, others, controls, window = next(batches)
            at = np.int32(POSITIONS * min(1.0, share))
            try:
                state, figures = self._programs[current].result()(window, state, latents_, others, controls, jax.random.fold_in(key, number), at)
                log.add(figures, "world", number + 1, f"  {len(self._walks.walks)} walks")
            except Exception as error:
                self.tell(f"stage {current} failed: {str(error)[:300]}")
                broken.add(current)
                current = -1
                time.sleep(1.0)
                state, _ = store.load(path)
                continue
            number += 1
            flops += train_world.flops(self.geometry, stage)
            if time.time() - kept > KEEP_EVERY:
                self._keep("world", state)
                kept = time.time()
        if batches is not None:
            batches.stop()
        encoded.stop()
        self._save("world", jax.device_get(state), flops)
        walks = encoded.walks()
        self.tell(f"world: {number} steps, {flops:.3g} FLOP, {len(walks.walks)} walks, {walks.steps.sum() / 15:.0f} s of them")

    def _maker(self, stage: Stage) -> Callable[[np.random.Generator], Any]:
        def make(rng: np.random.Generator):
            return *train_world.batch(rng, self._walks, stage), np.int32(rng.choice(stage.windows))

        return make

    def _say_errors(self, work: Callable[[], Any]) -> None:
        """What goes wrong on a thread, in the log."""
        try:
            work()
        except Exception:
            self.say(traceback.format_exc())

    def run(self) -> None:
        """Trains to the end, or goes on where a training was killed."""
        networks = self._state_path["autoencoder"], self._state_path["world"]
        if not all(path.is_file() for path in networks):
            begin.states(self.bundle, self.geometry, self.plan.autoencoder, *networks, self.plan.judged)
            self.tell(f"begun with the weights of {self.bundle.name}")
        if self.plan.side_by_side:
            parameters = store.mean_parameters(self._state_path["autoencoder"])
            self._compile_world()
            decoder = threading.Thread(target=self._say_errors, args=(self.autoencoder,))
            decoder.start()
            self.world(parameters)
            decoder.join()
        else:
            self.world(self.autoencoder())
        (self.folder / "done").write_text(json.dumps({"seconds": self.clock.now}))


def train(folder: Path, renderer: Path, bundle: Path, preset: Preset, seconds: float, say: Callable[[str], None]) -> None:
    """Trains `preset` within `seconds` from now, or to the folder's own end."""
    try:
        Training(folder, renderer, bundle, preset, seconds, say).run()
    except BaseException:
        say(traceback.format_exc())
        raise
