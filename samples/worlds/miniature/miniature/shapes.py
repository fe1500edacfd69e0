"""The shapes of the miniature: Waypoint-1.5's numbers where they are not sizes, and sizes that two cores can train."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cairn.build.geometry import Geometry

# 256 x 128 decoded, 320 x 180 in square pixels; windows, dilation, periods, patch, head width and schedule are the released ones.
WORLD = Geometry(
    layers=8,
    width=256,
    heads=4,
    kv_heads=2,
    latent_channels=32,
    latent_height=8,
    latent_width=16,
    encoder_width=32,
    decoder_widths=(96, 64, 32, 32),
)

# Length of the clips that the autoencoder is trained on.
CLIP_SECONDS = 2.0

# 64 x 32 decoded and two layers of each kind: the whole path in minutes.
SMOKE = Geometry(
    layers=4,
    width=32,
    heads=2,
    kv_heads=1,
    latent_channels=8,
    latent_height=2,
    latent_width=4,
    encoder_width=8,
    decoder_widths=(16, 16, 8, 8),
)


@dataclass(frozen=True)
class AutoencoderPlan:
    """How the autoencoder is trained."""

    clips: int  # rendered for it, two seconds each
    steps: int
    batch: int  # sequences a step
    latents: int  # in a sequence
    crop: tuple[int, int]  # width and height of what is cut out
    rate: float
    seconds: float = CLIP_SECONDS  # length of a clip
    perceptual: float = 0.0  # weight of LPIPS (AlexNet)
    adversary: float = 0.0  # the discriminator's pull on the pictures, over that of all other losses
    adversary_from: int = 0  # the step from which the discriminator learns,
    adversary_alone: int = 0  # and how many steps later the decoder begins to learn from it
    equivariance: float = 0.0  # weight of the difference between latents of shifted pictures and shifted latents


@dataclass(frozen=True)
class Stage:
    """A part of the curriculum."""

    steps: int
    frames: int  # in a window
    batch: int  # windows a step
    noisy: int  # noisy copies of a window
    windows: tuple[int, ...] = (128,)  # global windows g to train for
    together: int = 1  # windows computed side by side: on a CPU one, whose activations stay in its caches
    few_step: bool = False  # frames as the schedules' few steps lead to them, not as truth and noise mixed
    means: float = 0.0  # how much a channel's mean counts beside single numbers, in frames that are made of noise alone
    more_of: str = ""  # a kind of place whose windows are taken more often, and
    times: float = 1.0  # how many times as often as another's


@dataclass(frozen=True)
class Walks:
    """Walks of one length that are rendered for the transformer."""

    count: int
    seconds: float
    from_stage: int = 0  # the first stage that windows of them are taken for


@dataclass(frozen=True)
class WorldPlan:
    """How the transformer is trained."""

    walks: tuple[Walks, ...]  # in the order of their numbers
    rate: float
    decay: float
    stages: tuple[Stage, ...]
    muon_rate: float = 3e-3

    @property
    def count(self) -> int:
        """Of all walks."""
        return sum(walks.count for walks in self.walks)

    def seconds_of(self, walk: int) -> float:
        """How long walk number `walk` is."""
        for walks in self.walks:
            walk -= walks.count
            if walk < 0:
                return walks.seconds
        raise IndexError(f"the plan has {self.count} walks")

    def count_at(self, step: int) -> int:
        """How many walks, from the first on, the windows of a step are taken from."""
        begun = [sum(stage.steps for stage in self.stages[:n]) <= step for n in range(len(self.stages))]
        return sum(walks.count for walks in self.walks if begun[walks.from_stage])

    @property
    def steps(self) -> int:
        """Of all stages."""
        return sum(stage.steps for stage in self.stages)

    def stage(self, step: int) -> Stage:
        """The part of the curriculum that a step belongs to."""
        for stage in self.stages:
            step -= stage.steps
            if step < 0:
                return stage
        return self.stages[-1]


@dataclass(frozen=True)
class Preset:
    """One size of the whole undertaking."""

    geometry: Geometry
    autoencoder: AutoencoderPlan
    world: WorldPlan
    # Number of the first clip: a training that goes on from a bundle draws places that the bundle has not seen.
    first: int = 0
    # Clips of the four levels, not of endless places.
    levels: bool = False

    @property
    def clips(self) -> range:
        """Numbers of the autoencoder's clips; those of the walks follow."""
        return range(self.first, self.first + self.autoencoder.clips)


# The windows that the released model and its studies are run at.
WINDOWS = (112, 128, 384, 512)

# On a GPU: more places, larger batches, and the steps of some hours. The sizes are the same, so that what it makes ships the same.
GPU = Preset(
    WORLD,
    AutoencoderPlan(clips=400, steps=30_000, batch=16, latents=4, crop=(256, 128), rate=1.5e-3),
    WorldPlan(
        walks=(Walks(1120, 12.0), Walks(80, 36.0)),
        rate=1.5e-3,
        decay=0.05,
        stages=(
            Stage(steps=40_000, frames=16, batch=64, noisy=4, together=64),
            Stage(steps=10_000, frames=64, batch=16, noisy=4, together=16),
            Stage(steps=1_000, frames=512, batch=4, noisy=2, windows=WINDOWS, together=4),
            Stage(steps=4_000, frames=64, batch=16, noisy=4, together=16, few_step=True),
            Stage(steps=500, frames=256, batch=4, noisy=2, windows=WINDOWS, together=4, few_step=True),
        ),
    ),
)

def further_still(steps: int, **taken: Any) -> Preset:
    """Long windows alone, at rates below those of `further`, so that what is sharp stays. The same places: drawing others takes as
    long as half the training.
    """
    windows = (112, 128, 384, 384, 384, 512)
    stage = Stage(steps=steps, frames=256, batch=1, noisy=1, windows=windows, few_step=True, means=16.0, **taken)
    none = AutoencoderPlan(clips=0, steps=0, batch=4, latents=3, crop=(128, 128), rate=1.5e-3)
    plan = WorldPlan(walks=(Walks(32, 18.0),), rate=0.3e-3, muon_rate=0.6e-3, decay=0.05, stages=(stage,))
    return Preset(WORLD, none, plan, first=300)


PRESETS = {
    "gpu": GPU,
    "cpu": Preset(
        WORLD,
        AutoencoderPlan(clips=120, steps=4000, batch=4, latents=3, crop=(128, 128), rate=1.5e-3),
        WorldPlan(
            # Those of 18 s were drawn when six places had turned out too few for long windows.
            walks=(Walks(120, 6.0), Walks(6, 36.0), Walks(24, 18.0, from_stage=8)),
            rate=1.5e-3,
            decay=0.05,
            stages=(
                Stage(steps=2400, frames=16, batch=4, noisy=2),
                Stage(steps=200, frames=64, batch=1, noisy=2),
                Stage(steps=32, frames=512, batch=1, noisy=1, windows=WINDOWS),
                Stage(steps=300, frames=64, batch=1, noisy=2, few_step=True),
                Stage(steps=60, frames=256, batch=1, noisy=1, windows=WINDOWS, few_step=True),
                Stage(steps=1138, frames=64, batch=1, noisy=2, few_step=True),
                Stage(steps=20, frames=256, batch=1, noisy=1, windows=WINDOWS, few_step=True),
                Stage(steps=300, frames=64, batch=1, noisy=2, few_step=True),
                # From here on the long walks are thirty.
                Stage(steps=300, frames=64, batch=1, noisy=2, few_step=True),
                Stage(steps=60, frames=256, batch=1, noisy=1, windows=WINDOWS, few_step=True),
                Stage(steps=300, frames=64, batch=1, noisy=2, few_step=True),
            ),
        ),
    ),
    # From the bundle that is there (`begin`): new places. Long windows, in which a rollout's first picture is as far away as it becomes.
    "further": Preset(
        WORLD,
        AutoencoderPlan(clips=0, steps=0, batch=4, latents=3, crop=(128, 128), rate=1.5e-3),
        WorldPlan(
            walks=(Walks(32, 18.0),),
            rate=0.5e-3,
            muon_rate=1e-3,
            decay=0.05,
            stages=(
                Stage(steps=150, frames=64, batch=1, noisy=2, few_step=True, means=16.0),
                Stage(steps=140, frames=256, batch=1, noisy=1, windows=(112, 128, 384, 384, 384, 512), few_step=True, means=16.0),
            ),
        ),
        first=300,
    ),
    # From the world that `further` left, which turns dark in snow: long windows alone, half of them of snow.
    "longer": further_still(220, more_of="snow", times=3.0),
    # And from what that left, which turns light in forests: the same with windows of all kinds.
    "balanced": further_still(300),
    # From the bundle that is there: a wider autoencoder, sharp in four levels.
    "levels": Preset(
        WORLD.with_(encoder_width=48, decoder_widths=(192, 96, 48, 32)),
        AutoencoderPlan(
            clips=480,
            steps=40_000,
            batch=2,
            latents=3,
            crop=(128, 128),
            rate=0.8e-3,
            seconds=1.0,
            perceptual=1.0,
            adversary=0.3,
            adversary_from=2500,
            adversary_alone=500,
            equivariance=0.05,
        ),
        WorldPlan(walks=(), rate=1.5e-3, decay=0.05, stages=()),
        levels=True,
    ),
    "smoke": Preset(
        SMOKE,
        AutoencoderPlan(clips=4, steps=30, batch=2, latents=2, crop=(64, 32), rate=2e-3),
        WorldPlan(
            walks=(Walks(3, 2.4), Walks(1, 3.2)),
            rate=2e-3,
            decay=0.05,
            stages=(
                Stage(steps=12, frames=16, batch=2, noisy=2),
                Stage(steps=4, frames=48, batch=1, noisy=1, windows=WINDOWS),
                Stage(steps=2, frames=16, batch=1, noisy=1, few_step=True),
            ),
        ),
    ),
}
