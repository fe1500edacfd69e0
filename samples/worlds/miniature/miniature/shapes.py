"""The shapes of the miniature: Waypoint-1.5's numbers where they are not sizes, and sizes that two cores can train."""

from __future__ import annotations

from dataclasses import dataclass, replace
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

# Width and height in square pixels, at which pictures are shown.
SHOWN = (320, 180)
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
    crop: tuple[int, int]  # width and height of a training crop, in pixels
    rate: float
    seconds: float = CLIP_SECONDS  # length of a clip
    perceptual: float = 0.0  # weight of LPIPS (AlexNet)
    adversary: float = 0.0  # norm of the discriminator's gradient at the pictures, over that of all other losses
    adversary_from: int = 0  # step at which the discriminator starts to learn
    adversary_alone: int = 0  # steps after that until the decoder learns from it
    equivariance: float = 0.0  # weight of the difference between latents of shifted pictures and shifted latents
    half: bool = False  # whether the networks compute in bfloat16, for a GPU
    fixed_encoder: bool = False  # whether the decoder alone learns, so that latents stay what they are
    decoded: tuple[int, int] | None = None  # width and height that the networks compute, where `crop` has the size of shown pictures


@dataclass(frozen=True)
class Stage:
    """One stage of the curriculum."""

    steps: int
    frames: int  # in a window
    batch: int  # windows a step
    noisy: int  # noisy copies of a window
    windows: tuple[int, ...] = (128,)  # global windows g to train for
    together: int = 1  # windows computed side by side: on a CPU one, whose activations stay in its caches
    few_step: bool = False  # noisy frames come from sampler steps of the schedules, not from mixing truth and noise
    mixed: int = 0  # noisy copies of a few-step stage that are mixtures of truth and noise all the same, which keeps details
    means: float = 0.0  # weight of the error of channel means, in frames that start from pure noise
    more_of: str = ""  # family whose windows are sampled more often
    times: float = 1.0  # how many times as often as those of another family
    wide: bool = False  # all blocks at once and in bfloat16, for a GPU, which has the memory and no caches to spare
    # Norm of the gradient of a discriminator of latents, over that of the other losses; at 0 the discriminator alone learns. None has none.
    adversary: float | None = None


@dataclass(frozen=True)
class Walks:
    """Walks of one length that are rendered for the transformer."""

    count: int
    seconds: float
    from_stage: int = 0  # first stage that samples windows of them


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
        """Number of all walks."""
        return sum(walks.count for walks in self.walks)

    def seconds_of(self, walk: int) -> float:
        """Length of walk number `walk` in seconds."""
        for walks in self.walks:
            walk -= walks.count
            if walk < 0:
                return walks.seconds
        raise IndexError(f"the plan has {self.count} walks")

    def count_at(self, step: int) -> int:
        """Number of walks, from the first on, that step `step` samples windows from."""
        begun = [sum(stage.steps for stage in self.stages[:n]) <= step for n in range(len(self.stages))]
        return sum(walks.count for walks in self.walks if begun[walks.from_stage])

    @property
    def steps(self) -> int:
        """Steps of all stages."""
        return sum(stage.steps for stage in self.stages)

    def stage(self, step: int) -> Stage:
        """The stage of a step."""
        for stage in self.stages:
            step -= stage.steps
            if step < 0:
                return stage
        return self.stages[-1]


@dataclass(frozen=True)
class TimedPlan:
    """How `timed` trains on one GPU: both networks, planned by time."""

    renderers: int  # walks drawn at once
    short: Walks  # drawn first
    cycle: tuple[float, ...]  # lengths of the walks after these in seconds, in turn
    first_clips: int  # walks that are there before a training begins
    autoencoder: AutoencoderPlan
    autoencoder_share: float  # of the whole time, at whose end the transformer's training begins
    stages: tuple[tuple[float, Stage], ...]  # and their shares of the transformer's time
    rate: float = 1.2e-3
    muon_rate: float = 2.5e-3
    decay: float = 0.05
    draw_until: float = 45.0  # seconds before the end at which drawing ends
    cool_down: float = 0.4  # share of a training over which its rate falls to zero
    spare: float = 3.0  # seconds that the last write takes
    compilers: int = 3  # programs compiled at once
    side_by_side: bool = False  # whether both networks train at once, on latents of the autoencoder that they begin with
    first_number: int = 0  # of the first walk that is drawn
    shown: tuple[int, int] | None = None  # size of the short walks, which then are the autoencoder's alone, if it is not the decoded one

    @property
    def judged(self) -> bool:
        """Whether a discriminator judges latents."""
        return any(stage.adversary is not None for _, stage in self.stages)

    def seconds_of(self, walk: int) -> float:
        """Length of walk number `walk` in seconds."""
        if walk < self.short.count:
            return self.short.seconds
        return self.cycle[(walk - self.short.count) % len(self.cycle)]


@dataclass(frozen=True)
class Preset:
    """Sizes and plans of one training."""

    geometry: Geometry
    autoencoder: AutoencoderPlan
    world: WorldPlan
    # Number of the first clip. A training that continues from a bundle uses scenes that the bundle was not trained on.
    first: int = 0
    # Whether the clips show the four fixed levels instead of a new scene each.
    levels: bool = False
    # Plan of `timed`.
    timed: TimedPlan | None = None

    @property
    def clips(self) -> range:
        """Numbers of the autoencoder's clips; those of the walks follow."""
        return range(self.first, self.first + self.autoencoder.clips)


# Context windows of the released model and its studies, in latents.
WINDOWS = (112, 128, 384, 512)

# On a GPU: more scenes, larger batches, and steps for some hours. The network sizes are the same, so the bundle has the same size.
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
    """Long windows only, at learning rates below those of `further`, which keeps the pictures sharp. Uses the same scenes, because
    rendering new ones takes as long as half the training.
    """
    windows = (112, 128, 384, 384, 384, 512)
    stage = Stage(steps=steps, frames=256, batch=1, noisy=1, windows=windows, few_step=True, means=16.0, **taken)
    none = AutoencoderPlan(clips=0, steps=0, batch=4, latents=3, crop=(128, 128), rate=1.5e-3)
    plan = WorldPlan(walks=(Walks(32, 18.0),), rate=0.3e-3, muon_rate=0.6e-3, decay=0.05, stages=(stage,))
    return Preset(WORLD, none, plan, first=300)


# The autoencoder of the levels, sharp by LPIPS and a discriminator.
SHARP = AutoencoderPlan(
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
)


def timed(batches: tuple[int, ...], frames: tuple[int, ...], **taken: Any) -> TimedPlan:
    """The plan of `timed` with these batches of the autoencoder and of each stage, and these lengths of the stages' windows."""
    few = {"few_step": True, "means": 4.0, "windows": WINDOWS}
    kinds = ((0.17, 4, {}), (0.23, 3, {}), (0.35, 2, few), (0.25, 2, few))
    first, *others = batches
    stages = tuple(
        (share, Stage(steps=0, frames=length, batch=batch, noisy=noisy, together=batch, wide=True, **more))
        for (share, noisy, more), batch, length in zip(kinds, others, frames)
    )
    return TimedPlan(autoencoder=replace(SHARP, batch=first, crop=(256, 128), half=True), autoencoder_share=0.42, stages=stages, **taken)


def further_by_time(batch: int, frames: int, windows: int) -> TimedPlan:
    """The plan of a second, short training of the levels; the batch of the decoder, and the length and number of windows of the transformer."""
    decoder = replace(SHARP, batch=batch, crop=(256, 128), half=True, fixed_encoder=True, equivariance=0.0)
    decoder = replace(decoder, rate=0.5e-3, adversary=0.5, adversary_from=0, adversary_alone=4000)
    stage = Stage(steps=0, frames=frames, batch=windows, noisy=3, together=windows, wide=True, few_step=True, mixed=2, means=4.0, windows=WINDOWS)
    return TimedPlan(
        renderers=15,
        short=Walks(15, 1.0),
        cycle=(6.6,),
        first_clips=24,
        autoencoder=decoder,
        autoencoder_share=1.0,
        stages=((1.0, stage),),
        rate=0.8e-3,
        muon_rate=1.6e-3,
        cool_down=0.7,
        draw_until=20.0,
        side_by_side=True,
    )


def longer_by_time(batches: tuple[int, int, int, int], frames: tuple[int, int, int]) -> TimedPlan:
    """The plan of a third training of the levels: the decoder for pictures as they are shown, and beside it the transformer in windows at all
    noise levels, then in few steps with a discriminator of latents, then in long windows; the batch of the decoder, and the batch and
    the length of the windows of each stage.
    """
    decode, *batches = batches
    decoder = replace(SHARP, batch=decode, crop=SHOWN, decoded=WORLD.decoded, half=True, fixed_encoder=True, equivariance=0.0)
    decoder = replace(decoder, rate=0.5e-3, adversary=0.6, adversary_from=0, adversary_alone=4000)
    few = {"few_step": True, "mixed": 2, "means": 4.0, "adversary": 0.3}
    kinds = ((0.35, {"adversary": 0.0}), (0.4, few), (0.25, few))
    stages = tuple(
        (share, Stage(steps=0, frames=length, batch=batch, noisy=3, together=batch, wide=True, windows=WINDOWS, **more))
        for (share, more), batch, length in zip(kinds, batches, frames)
    )
    return TimedPlan(
        renderers=12,
        short=Walks(160, 1.0),
        cycle=(8.0, 8.0, 20.0),
        first_clips=24,
        autoencoder=decoder,
        autoencoder_share=0.45,
        stages=stages,
        cool_down=0.6,
        draw_until=20.0,
        side_by_side=True,
        first_number=10_000,
        shown=SHOWN,
        compilers=5,
    )


PRESETS = {
    "gpu": GPU,
    "cpu": Preset(
        WORLD,
        AutoencoderPlan(clips=120, steps=4000, batch=4, latents=3, crop=(128, 128), rate=1.5e-3),
        WorldPlan(
            # The walks of 18 s were added because six scenes were too few for long windows.
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
                # From here on there are thirty long walks.
                Stage(steps=300, frames=64, batch=1, noisy=2, few_step=True),
                Stage(steps=60, frames=256, batch=1, noisy=1, windows=WINDOWS, few_step=True),
                Stage(steps=300, frames=64, batch=1, noisy=2, few_step=True),
            ),
        ),
    ),
    # Continues from a bundle (`begin`) on new scenes. Long windows reach the largest distance from a rollout's first picture.
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
    # Continues from the result of `further`, which darkens in snow: long windows only, half of them of snow.
    "longer": further_still(220, more_of="snow", times=3.0),
    # Continues from the result of `longer`, which brightens in forests: long windows of all families.
    "balanced": further_still(300),
    # Continues from a bundle with a wider autoencoder, for sharp pictures of the four levels.
    "levels": Preset(
        WORLD.with_(encoder_width=48, decoder_widths=(192, 96, 48, 32)),
        SHARP,
        WorldPlan(walks=(), rate=1.5e-3, decay=0.05, stages=()),
        levels=True,
        timed=timed((8, 32, 12, 12, 3), (16, 64, 64, 256), renderers=14, short=Walks(120, 2.0), cycle=(8.0, 8.0, 20.0), first_clips=40),
    ),
    # Goes on from what `levels` trained: the decoder and the transformer side by side, whose latents stay what they are.
    "levels-further": Preset(
        WORLD.with_(encoder_width=48, decoder_widths=(192, 96, 48, 32)),
        SHARP,
        WorldPlan(walks=(), rate=1.5e-3, decay=0.05, stages=()),
        levels=True,
        timed=further_by_time(8, 96, 8),
    ),
    # Goes on from what `levels-further` trained: a decoder for pictures as they are shown, and a transformer whose predictions are judged.
    "levels-longer": Preset(
        WORLD.with_(encoder_width=48, decoder_widths=(192, 96, 48, 32)),
        SHARP,
        WorldPlan(walks=(Walks(32, 20.8),), rate=1.5e-3, decay=0.05, stages=()),
        first=1000,
        levels=True,
        timed=longer_by_time((8, 12, 8, 2), (64, 96, 256)),
    ),
    "levels-longer-smoke": Preset(
        WORLD.with_(encoder_width=48, decoder_widths=(192, 96, 48, 32)),
        SHARP,
        WorldPlan(walks=(Walks(2, 2.2),), rate=1.5e-3, decay=0.05, stages=()),
        first=1000,
        levels=True,
        timed=replace(longer_by_time((1, 2, 1, 1), (16, 16, 32)), renderers=1, short=Walks(2, 1.0), cycle=(2.2, 2.4), first_clips=1),
    ),
    "levels-further-smoke": Preset(
        WORLD.with_(encoder_width=48, decoder_widths=(192, 96, 48, 32)),
        SHARP,
        WorldPlan(walks=(), rate=1.5e-3, decay=0.05, stages=()),
        levels=True,
        timed=replace(further_by_time(1, 16, 1), renderers=1, short=Walks(400, 1.6), first_clips=2),
    ),
    # The path of `timed` with networks of full size and the smallest batches.
    "levels-smoke": Preset(
        WORLD.with_(encoder_width=48, decoder_widths=(192, 96, 48, 32)),
        SHARP,
        WorldPlan(walks=(), rate=1.5e-3, decay=0.05, stages=()),
        levels=True,
        timed=timed((1, 1, 1, 1, 1), (16, 16, 16, 32), renderers=1, short=Walks(4, 2.2), cycle=(2.2, 2.4), first_clips=1),
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
