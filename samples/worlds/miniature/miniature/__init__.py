"""Training of the miniature world: Waypoint-1.5's architecture, small, on walks through the procedural scenes.

Needs JAX and numpy, and `cairn.build` on the Python path for shapes and names. From a shell: `python -m miniature --help`.
"""
