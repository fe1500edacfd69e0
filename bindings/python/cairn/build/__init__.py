"""The bundle builder: a Waypoint-1.5 checkpoint, or seeded random weights, becomes a world bundle.

`docs/bundle.md` is the norm for what comes out. From a shell: `python -m cairn.build --help`. It needs packages that nothing else here
does: the extra `build` brings them.
"""

from . import _needs

_needs.require()

from .errors import BuildError
from .geometry import Geometry, PRESETS
from .writer import build_bundle

__all__ = ["BuildError", "Geometry", "PRESETS", "build_bundle"]
