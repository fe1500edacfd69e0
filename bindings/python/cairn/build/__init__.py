"""The bundle builder: makes a world bundle of a Waypoint-1.5 checkpoint, or of seeded random weights.

The format is specified in `docs/bundle.md`. From a shell: `python -m cairn.build --help`. It needs packages that the rest of `cairn` does not
need; the extra `build` installs them.
"""

from .. import _builder

_builder.require()

from .errors import BuildError
from .geometry import Geometry, PRESETS
from .writer import build_bundle

__all__ = ["BuildError", "Geometry", "PRESETS", "build_bundle"]
