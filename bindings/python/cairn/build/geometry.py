"""Shapes of a world, with a check of their arithmetic: `docs/bundle.md`, section 3."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from .errors import BuildError

# The noise conditioner's Fourier features and hidden width are constants of the architecture, not of the geometry.
FOURIER_WIDTH = 512
CONDITIONER_RATIO = 4
# Three blocks of three memory layers in the decoder. Each block changes the resolution by two; pixel shuffle by another factor.
AUTOENCODER_PATCH = 2
AUTOENCODER_STRIDE = 8
AUTOENCODER_TEMPORAL = 4
STAGES = 3
MEMORIES_PER_STAGE = 3
# Types that the residual stream of an f16 graph can have.
RESIDUALS = ("float16", "float32")
BUTTONS = 256
# Largest side of a picture or a memory, and the largest number of channels of a memory.
SIDE_LIMIT = 16384
# How many times as large as a decoded picture the rendered one may be, on each side.
RENDER_SCALE_LIMIT = 8
HEAD_WIDTH_LIMIT = 1024
PATCH_LIMIT = 64
TOKENS_LIMIT = 65536
# Latent cells on a side, for the pictures' sake: each cell is 16 pixels wide.
_CELLS = SIDE_LIMIT // (AUTOENCODER_PATCH * AUTOENCODER_STRIDE)
# The least and the largest of each whole number. The library refuses all others: `docs/bundle.md`, section 3.
BOUNDS = {
    "layers": (1, 512),
    "width": (8, 65536),
    "heads": (1, 4096),
    "kv_heads": (1, 4096),
    "latent_channels": (1, 4096),
    "latent_height": (1, _CELLS),
    "latent_width": (1, _CELLS),
    "mlp_ratio": (1, 64),
    "local_window": (1, 65536),
    "global_window": (1, 65536),
    "global_dilation": (1, 4096),
    "global_max_window": (1, 65536),
    "global_period": (1, 4096),
    "global_offset": (-4096, 4096),
    "control_period": (1, 4096),
    "latents_per_second": (1, 1000),
    "time_multiplier": (1, 1000),
    "encoder_width": (1, SIDE_LIMIT),
}
# Of the real numbers: each is above the first and at most the second.
REAL_BOUNDS = {"nyquist_fraction": (0, 1), "time_base": (1, 10**9)}


@dataclass(frozen=True)
class Geometry:
    """All numbers that determine the shapes of one world. Sizes are in the units of `docs/bundle.md`."""

    layers: int
    width: int
    heads: int
    kv_heads: int
    latent_channels: int
    latent_height: int
    latent_width: int
    patch: tuple[int, int] = (2, 2)
    mlp_ratio: int = 4
    local_window: int = 16
    global_window: int = 128
    global_dilation: int = 8
    global_max_window: int = 512
    global_period: int = 4
    global_offset: int = -1
    control_period: int = 3
    nyquist_fraction: float = 0.8
    time_base: float = 10000.0
    buttons: int = BUTTONS
    latents_per_second: int = 15
    time_multiplier: int = 1
    schedule: tuple[float, ...] = (1.0, 0.9, 0.75, 0.3, 0.0)
    encoder_width: int = 64
    decoder_widths: tuple[int, int, int, int] = (256, 128, 64, 64)
    render: tuple[int, int] = field(default=(0, 0))
    # Whether the encoder's graph takes its memories as inputs, so that a rollout can continue its stream.
    streaming_encoder: bool = False
    # Type of the transformer's residual stream in f16 graphs: "float16" or "float32".
    residual: str = "float16"
    # Whether there are joined graphs, which run the cache pass of one latent and the first denoise pass of the next at once.
    joined: bool = False

    def __post_init__(self) -> None:
        for name, (low, high) in BOUNDS.items():
            self._within(name, getattr(self, name), low, high)
        for name, (low, high) in REAL_BOUNDS.items():
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or isinstance(value, bool) or not low < value <= high:
                raise BuildError(f"{value!r:.50} is not above {low} and at most {high}", field=name, remedy="Give a number in that range.")
        if self.buttons != BUTTONS:
            raise BuildError(f"{self.buttons!r} is not {BUTTONS}", field="buttons", remedy="Leave it out.")
        # A size of 0 stands for square pixels.
        for name, count, low, high in (("patch", 2, 1, PATCH_LIMIT), ("decoder_widths", 4, 1, SIDE_LIMIT), ("render", 2, 0, SIDE_LIMIT)):
            value = getattr(self, name)
            if len(value) != count:
                raise BuildError(f"{value!r:.50} is not {count} whole numbers", field=name, remedy="Give them.")
            for number in value:
                self._within(name, number, low, high)
        self._divides("width", self.width, "heads", self.heads)
        self._divides("heads", self.heads, "kv_heads", self.kv_heads)
        self._divides("width / heads", self.head_width, "8", 8)
        self._within("width / heads", self.head_width, 8, HEAD_WIDTH_LIMIT)
        self._divides("latent_height", self.latent_height, "patch rows", self.patch[0])
        self._divides("latent_width", self.latent_width, "patch columns", self.patch[1])
        self._within("tokens", self.tokens, 1, TOKENS_LIMIT)
        self._divides("global_window", self.global_window, "global_dilation", self.global_dilation)
        self._divides("global_max_window", self.global_max_window, "global_dilation", self.global_dilation)
        if self.global_max_window < self.global_window:
            raise BuildError(
                f"{self.global_max_window} is below the stock window {self.global_window}",
                field="global_max_window",
                remedy="Declare at least the stock window.",
            )
        steps = list(zip(self.schedule, self.schedule[1:]))
        if not 2 <= len(self.schedule) <= 64 or self.schedule[-1] != 0 or self.schedule[0] > 1 or any(
            not a > b for a, b in steps
        ):
            raise BuildError(
                f"{self.schedule!r:.100} does not fall strictly from at most 1 to exactly 0",
                field="schedule",
                remedy="Give 2 to 64 falling noise levels, such as 1 0.9 0.75 0.3 0.",
            )
        if self.residual not in RESIDUALS:
            raise BuildError(f"{self.residual!r} is none of {', '.join(RESIDUALS)}", field="residual", remedy="Choose one of these.")
        if 0 in self.render:
            object.__setattr__(self, "render", square_pixels(self.decoded))
        for side, decoded in zip(self.render, self.decoded):
            self._within("render", side, 1, min(SIDE_LIMIT, RENDER_SCALE_LIMIT * decoded))

    @staticmethod
    def _within(name: str, value: object, low: int, high: int) -> None:
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise BuildError(f"{value!r:.50} is not a whole number from {low} to {high}", field=name, remedy="Give one in that range.")

    @staticmethod
    def _divides(name: str, value: int, by_name: str, by: int) -> None:
        if value % by:
            raise BuildError(f"{value} is not a multiple of {by_name} ({by})", field=name, remedy="Change one of the two.")

    @property
    def head_width(self) -> int:
        """Width of one head."""
        return self.width // self.heads

    @property
    def group(self) -> int:
        """Query heads that share one key/value head."""
        return self.heads // self.kv_heads

    @property
    def kv_width(self) -> int:
        """Width of one token's keys, or of its values."""
        return self.kv_heads * self.head_width

    @property
    def grid(self) -> tuple[int, int]:
        """Token rows and columns."""
        return self.latent_height // self.patch[0], self.latent_width // self.patch[1]

    @property
    def tokens(self) -> int:
        """Tokens of one latent."""
        return self.grid[0] * self.grid[1]

    @property
    def patch_width(self) -> int:
        """Number of latent values in one token."""
        return self.latent_channels * self.patch[0] * self.patch[1]

    @property
    def spatial(self) -> int:
        """Decoded pixels per latent cell in each direction."""
        return AUTOENCODER_PATCH * AUTOENCODER_STRIDE

    @property
    def decoded(self) -> tuple[int, int]:
        """`(width, height)` of the autoencoder's pictures."""
        return self.latent_width * self.spatial, self.latent_height * self.spatial

    @property
    def control_width(self) -> int:
        """Width of the control vector: mouse, buttons and scroll."""
        return 2 + self.buttons + 1

    @property
    def memories(self) -> list[tuple[int, int, int]]:
        """`(channels, height, width)` of the decoder's memories, in order."""
        return [
            (self.decoder_widths[stage], self.latent_height << stage, self.latent_width << stage)
            for stage in range(STAGES)
            for _ in range(MEMORIES_PER_STAGE)
        ]

    @property
    def encoder_memories(self) -> list[tuple[int, int, int]]:
        """`(channels, height, width)` of the encoder's memories if they are inputs of its graph; otherwise none."""
        if not self.streaming_encoder:
            return []
        return [
            (self.encoder_width, self.latent_height << halvings, self.latent_width << halvings)
            for halvings in reversed(range(STAGES))
            for _ in range(MEMORIES_PER_STAGE)
        ]

    def is_global(self, layer: int) -> bool:
        """Whether `layer` attends to the dilated window."""
        return (layer - self.global_offset) % self.global_period == 0

    def sees_controls(self, layer: int) -> bool:
        """Whether `layer` has a control fusion."""
        return layer % self.control_period == 0

    def past_tokens(self, layer: int, window: int) -> int:
        """Ring positions of `layer` with a global window of `window` latents."""
        buckets = window // self.global_dilation if self.is_global(layer) else self.local_window
        return buckets * self.tokens

    def dimensions(self, window: int, latents: int = 1) -> dict[str, int]:
        """The symbolic dimensions of a graph that runs `latents` latents at a global window of `window` latents."""
        local = self.local_window * self.tokens
        wide = window // self.global_dilation * self.tokens
        return {
            "local_past": local,
            "local_keys": local + latents * self.tokens,
            "global_past": wide,
            "global_keys": wide + latents * self.tokens,
        }

    def with_(self, **changes) -> "Geometry":
        """A changed copy, which is checked again."""
        return replace(self, **changes)


def square_pixels(decoded: tuple[int, int]) -> tuple[int, int]:
    """The size of a decoded picture with square pixels: Waypoint squeezes 16:9 to 2:1; other shapes are square already."""
    width, height = decoded
    if width == 2 * height:
        # 1024 x 512 becomes 1280 x 720, 512 x 256 becomes 640 x 360: the released pairs. Even sizes, for video.
        return width * 5 // 4 // 2 * 2, height * 45 // 32 // 2 * 2
    return width, height


def _waypoint(rows: int, columns: int) -> Geometry:
    return Geometry(
        layers=24, width=2048, heads=32, kv_heads=16, latent_channels=32, latent_height=rows, latent_width=columns
    )


_TINY = Geometry(
    layers=8,
    width=64,
    heads=4,
    kv_heads=2,
    latent_channels=4,
    latent_height=4,
    latent_width=8,
    local_window=4,
    global_window=16,
    global_dilation=4,
    global_max_window=64,
    encoder_width=16,
    decoder_widths=(32, 16, 16, 16),
    render=(128, 72),
)

# Presets of `random --preset`: name, purpose, geometry.
PRESETS: dict[str, tuple[str, Geometry]] = {
    "tiny": ("8 tokens, windows 4 / 4 / 16: tests of a few milliseconds", _TINY),
    "window": (
        "tiny with the real windows 16 / 8 / 128",
        _TINY.with_(local_window=16, global_window=128, global_dilation=8, global_max_window=128),
    ),
    "stream": ("tiny with an encoder that is handed its memories", _TINY.with_(streaming_encoder=True)),
    "joined": ("tiny with joined graphs", _TINY.with_(joined=True)),
    "demo": (
        "128 tokens, 512 x 256 decoded, up to g512: runs on two processor cores",
        Geometry(
            layers=8,
            width=256,
            heads=4,
            kv_heads=2,
            latent_channels=16,
            latent_height=16,
            latent_width=32,
            encoder_width=32,
            decoder_widths=(64, 48, 32, 32),
            render=(640, 360),
        ),
    ),
    "360p": ("the released small model's shapes, 1.28 billion parameters", _waypoint(16, 32)),
    "720p": ("the released model's shapes, 1.28 billion parameters", _waypoint(32, 64)),
}
