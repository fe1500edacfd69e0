"""Makes ms_ssim.csv: TensorFlow's values for the larger pairs of pictures of the tests.

    cargo test -p study --test metrics          # leaves the pairs in target/tmp/large-metric-pairs
    pip install tensorflow-cpu==2.21.0 pillow numpy
    python tools/study/tests/goldens/ms_ssim.py target/tmp/large-metric-pairs > ms_ssim.csv
"""

import hashlib
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import tensorflow as tf
from PIL import Image


def main() -> None:
    folder = Path(sys.argv[1])
    packages = ("tensorflow_cpu", "numpy")
    print("# Made by ms_ssim.py beside this file, with " + ", ".join(f"{p} {version(p)}" for p in packages))
    print("pair;sum;ms_ssim")
    for name in sorted(path.name.removesuffix(".truth.png") for path in folder.glob("*.truth.png")):
        pair = [np.asarray(Image.open(folder / f"{name}.{role}.png").convert("RGB")) for role in ("truth", "candidate")]
        sum_ = hashlib.sha256(b"".join(picture.tobytes() for picture in pair)).hexdigest()[:16]
        truth, candidate = (tf.constant(picture[None], tf.float32) for picture in pair)
        # Like ours, the function's mean over channels is the mean of the channels' products.
        value = float(tf.image.ssim_multiscale(truth, candidate, max_val=255.0).numpy()[0])
        print(f"{name};{sum_};{value:.8f}")


if __name__ == "__main__":
    main()
