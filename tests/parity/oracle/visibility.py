"""Attention between frames: a frames-by-frames table for each of the two kinds of layer.

A frame is identified by its ring clock: the number of frames committed before it. The released engine keeps a ring of slots and hides
the slot that the current frame will overwrite. The same rules without slots:

* local layer, window L: a frame sees the L - 1 frames committed last.
* global layer, dilation d, B = g / d buckets: only frames whose clock divides by d are ever kept, as bucket clock / d.
  The current frame belongs to bucket ceil(clock / d). If its clock divides by d, it sees the B - 1 buckets before its
  own; if not, it sees the B buckets before the one that comes next.

Every frame sees all of itself.
"""

import numpy as np


def local_table(query_clocks: np.ndarray, kept_clocks: np.ndarray, window: int) -> np.ndarray:
    """`[queries, kept]`, true where the query sees the kept frame in a local layer."""
    age = query_clocks[:, None] - kept_clocks[None, :]
    return (age >= 1) & (age <= window - 1)


def global_table(query_clocks: np.ndarray, kept_clocks: np.ndarray, window: int, dilation: int) -> np.ndarray:
    """`[queries, kept]`, true where the query sees the kept frame in a global layer."""
    buckets = window // dilation
    query_bucket = -(-query_clocks // dilation)
    will_be_kept = query_clocks % dilation == 0
    reach = np.where(will_be_kept, buckets - 1, buckets)
    age = query_bucket[:, None] - (kept_clocks // dilation)[None, :]
    return (kept_clocks % dilation == 0)[None, :] & (age >= 1) & (age <= reach[:, None])
