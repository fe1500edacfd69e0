"""Pictures between anchors, by MVTools' FlowFPS in VapourSynth.

    python flowfps.py WIDTH HEIGHT MULTIPLIER INTERVAL IN OUT [SETTINGS]

IN holds consecutive anchors as raw 8-bit RGB; OUT gets the MULTIPLIER - 1 pictures between anchors INTERVAL and
INTERVAL + 1. MVTools works on YUV: here 4:4:4 of 16 bits, full range, so that nothing is lost by that.
SETTINGS are changes to the constants below, as JSON: {"RENDER": {"mask": 0}}.
"""

import json
import sys
from pathlib import Path

import numpy as np
import vapoursynth as vs

core = vs.core
# Chosen on the scenes' seed for tuning, see `study quality --tune flowfps`: blocks of 8 with half overlap, searched again as
# blocks of 4, exhaustively and at quarter pixels.
SUPER = {"pel": 4}
ANALYSE = {"blksize": 8, "overlap": 4, "search": 3, "searchparam": 8}
REFINE = {"blksize": 4, "overlap": 2, "search": 3, "searchparam": 4}
RENDER = {"mask": 2}


def source(pictures: np.ndarray) -> vs.VideoNode:
    """A clip of pictures, one a second."""
    count, height, width, _ = pictures.shape
    blank = core.std.BlankClip(width=width, height=height, format=vs.RGB24, length=count, fpsnum=1, fpsden=1)

    def fill(n: int, f: vs.VideoFrame) -> vs.VideoFrame:
        frame = f.copy()
        for plane in range(3):
            np.asarray(frame[plane])[:] = pictures[n, :, :, plane]
        return frame

    return core.std.ModifyFrame(blank, blank, fill)


def main() -> None:
    width, height, multiplier, interval = map(int, sys.argv[1:5])
    for name, changes in json.loads("".join(sys.argv[7:8]) or "{}").items():
        {"ANALYSE": ANALYSE, "REFINE": REFINE, "RENDER": RENDER}[name].update(changes)
    clip = source(np.fromfile(sys.argv[5], np.uint8).reshape(-1, height, width, 3))
    yuv = core.resize.Bicubic(clip, format=vs.YUV444P16, matrix_s="709", range_s="full")
    pyramid = core.mv.Super(yuv, **SUPER)
    vectors = [core.mv.Analyse(pyramid, isb=isb, **ANALYSE) for isb in (True, False)]
    vectors = [core.mv.Recalculate(pyramid, v, **REFINE) for v in vectors]
    out = core.mv.FlowFPS(yuv, pyramid, *vectors, num=multiplier, den=1, **RENDER)
    rgb = core.resize.Bicubic(out, format=vs.RGB24, matrix_in_s="709", range_in_s="full")
    with Path(sys.argv[6]).open("wb") as file:
        for n in range(interval * multiplier + 1, (interval + 1) * multiplier):
            frame = rgb.get_frame(n)
            file.write(np.stack([np.asarray(frame[plane]) for plane in range(3)], -1).tobytes())


if __name__ == "__main__":
    main()
