"""Cairn from Python: a generative world, with its anchors as numpy arrays.

    import cairn

    with cairn.Device.cpu() as device, device.load_world() as world, world.rollout(seed=1) as rollout:
        rollout.append(picture)  # uint8, [height, width, 4]
        for _ in range(15):
            rollout.step(cairn.Controls(keys=["W"], mouse=(4, 0)))
            print(rollout.anchor().picture().shape)

The shared library is loaded at first use; `python -m cairn doctor` checks whether it works here. `cairn.build` makes world bundles, and does
not need the library.
"""

from .controls import KEYS, Controls, Recorder, Script, key_code
from .errors import (
    Busy,
    Cancelled,
    DeviceError,
    DeviceRemoved,
    Error,
    FileError,
    InternalError,
    InvalidArgument,
    InvalidBundle,
    InvalidHandle,
    InvalidState,
    LibraryMissing,
    OutOfMemory,
    Poisoned,
    RuntimeMissing,
    StructSize,
    Unsupported,
)
from .film import Film, Strip
from .logs import log_to
from .presenter import Frame, Guidance, GuidanceInfo, Presenter, PresenterStatistics
from .rollout import Anchor, AnchorInfo, Rollout, RolloutInfo, RolloutStatistics, StepInfo
from .threads import set_threads
from .world import (
    Adapter,
    Device,
    Requirement,
    World,
    WorldInfo,
    WorldMemory,
    adapters,
    requirements,
)

__all__ = [
    "KEYS",
    "Adapter",
    "Anchor",
    "AnchorInfo",
    "Busy",
    "Cancelled",
    "Controls",
    "Device",
    "DeviceError",
    "DeviceRemoved",
    "Error",
    "FileError",
    "Film",
    "Frame",
    "Guidance",
    "GuidanceInfo",
    "InternalError",
    "InvalidArgument",
    "InvalidBundle",
    "InvalidHandle",
    "InvalidState",
    "LibraryMissing",
    "OutOfMemory",
    "Poisoned",
    "Presenter",
    "PresenterStatistics",
    "Recorder",
    "Requirement",
    "Rollout",
    "RolloutInfo",
    "RolloutStatistics",
    "RuntimeMissing",
    "Script",
    "StepInfo",
    "Strip",
    "StructSize",
    "Unsupported",
    "World",
    "WorldInfo",
    "WorldMemory",
    "adapters",
    "key_code",
    "log_to",
    "requirements",
    "set_threads",
]
