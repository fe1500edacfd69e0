"""The encoder and the streaming decoder against a second implementation of TAEHV-1.5, in numpy, parallel over time."""

import numpy as np
import pytest
from conftest import TINY, relative, session

from cairn.build import PRESETS, build_bundle
from cairn.build.manifest import Licence
from cairn.build.random_weights import RandomWeights
from cairn.build.weights import autoencoder_weights


@pytest.fixture(scope="module")
def weights():
    source = RandomWeights(TINY, 1)
    return {w.name: source.get(w).astype(np.float64) for w in autoencoder_weights(TINY)}


def conv(w, x, name, stride=1):
    """[N, C, H, W] in float64, "same" padding."""
    kernel, bias = w[f"{name}.weight"], w.get(f"{name}.bias")
    size = kernel.shape[2]
    x = np.pad(x, [(0, 0), (0, 0), (size // 2,) * 2, (size // 2,) * 2])
    windows = np.lib.stride_tricks.sliding_window_view(x, (size, size), axis=(2, 3))[:, :, ::stride, ::stride]
    y = np.einsum("nchwij,ocij->nohw", windows, kernel)
    return y if bias is None else y + bias[:, None, None]


def relu(x):
    return np.maximum(x, 0)


def memory_block(w, x, name):
    """All frames at once: the frame before, zero before the first."""
    past = np.concatenate([np.zeros_like(x[:1]), x[:-1]])
    y = relu(conv(w, np.concatenate([x, past], axis=1), f"{name}.conv.0"))
    y = relu(conv(w, y, f"{name}.conv.2"))
    return relu(conv(w, y, f"{name}.conv.4") + x)


def encode(w, rgb):
    """[4 n, 3, H, W] -> [n, C, h, w]."""
    n, _, H, W = rgb.shape
    x = rgb.reshape(n, 3, H // 2, 2, W // 2, 2).transpose(0, 1, 3, 5, 2, 4).reshape(n, 12, H // 2, W // 2)
    x = relu(conv(w, x, "encoder.0"))
    for first, frames in ((2, 2), (7, 2), (12, 1)):
        x = x.reshape(len(x) // frames, -1, *x.shape[2:])
        x = conv(w, conv(w, x, f"encoder.{first}.conv"), f"encoder.{first + 1}", stride=2)
        for m in range(3):
            x = memory_block(w, x, f"encoder.{first + 2 + m}")
    return conv(w, x, "encoder.17")


def decode(w, latents):
    """[n, C, h, w] -> ([4 n, 3, H, W], the nine blocks' inputs over all their frames)."""
    x = relu(conv(w, np.tanh(latents / 3) * 3, "decoder.1"))
    inputs = []
    for first, frames in ((3, 1), (9, 2), (15, 2)):
        for m in range(3):
            inputs.append(x)
            x = memory_block(w, x, f"decoder.{first + m}")
        x = x.repeat(2, axis=2).repeat(2, axis=3)
        x = conv(w, x, f"decoder.{first + 4}.conv")
        x = x.reshape(len(x) * frames, -1, *x.shape[2:])
        x = conv(w, x, f"decoder.{first + 5}")
    x = conv(w, relu(x), "decoder.22")
    n, _, H, W = x.shape
    x = x.reshape(n, 3, 2, 2, H, W).transpose(0, 1, 4, 2, 5, 3).reshape(n, 3, 2 * H, 2 * W)
    return np.clip(x, 0, 1), inputs


def test_encoder_equals_the_numpy_one(tiny, weights):
    rgb = np.random.default_rng(1).random((4, 3, *reversed(TINY.decoded)))
    (latent,) = session(tiny, "encoder", "f32").run(None, {"rgb": rgb.astype(np.float32)})
    assert relative(latent, encode(weights, rgb)) < 1e-5


@pytest.fixture(scope="module")
def streaming(tmp_path_factory):
    """A bundle like `tiny` whose encoder takes its memories as inputs."""
    g = PRESETS["stream"][1]
    out = tmp_path_factory.mktemp("bundles") / "stream"
    licence = Licence("CC0-1.0", b"No rights reserved.\n")
    return g, build_bundle(g, RandomWeights(g, 1), out, name="stream", provenance={"seed": "1"}, licence=licence)


def test_streaming_encoder_equals_time_parallel_one(streaming, tiny, weights):
    g, bundle = streaming
    rgb = np.random.default_rng(4).random((16, 3, *reversed(g.decoded)))
    latents = encode(weights, rgb)
    encoder = session(bundle, "encoder", "f32")
    clip = session(tiny, "encoder", "f32")
    memories = [np.zeros((1, *shape), np.float32) for shape in g.encoder_memories]
    assert [i.shape for i in encoder.get_inputs()[1:]] == [list(memory.shape) for memory in memories]
    for q, latent in enumerate(latents):
        pictures = {"rgb": rgb[4 * q : 4 * q + 4].astype(np.float32)}
        found, *memories = encoder.run(None, pictures | {f"past_mem.{j}": m for j, m in enumerate(memories)})
        assert relative(found[0], latent) < 1e-5
        # Fresh memories give another latent, except for the first one.
        (fresh,) = clip.run(None, pictures)
        assert (relative(fresh[0], latent) < 1e-5) == (q == 0)


def test_streaming_decoder_equals_time_parallel_one(tiny, weights):
    latents = np.random.default_rng(2).standard_normal((4, TINY.latent_channels, TINY.latent_height, TINY.latent_width))
    pictures, inputs = decode(weights, latents)
    decoder = session(tiny, "decoder", "f32")
    memories = [np.zeros((1, *shape), np.float32) for shape in TINY.memories]
    for q, latent in enumerate(latents):
        feeds = {"latent": latent[None].astype(np.float32)} | {f"past_mem.{j}": m for j, m in enumerate(memories)}
        rgb, *memories = decoder.run(None, feeds)
        assert relative(rgb, pictures[4 * q : 4 * q + 4]) < 1e-5
        for memory, frames in zip(memories, inputs):
            per_latent = len(frames) // len(latents)
            assert relative(memory[0], frames[(q + 1) * per_latent - 1]) < 1e-5


def test_the_memories_matter(tiny):
    """Otherwise the tests above would pass for a decoder that ignores them."""
    decoder = session(tiny, "decoder", "f32")
    rng = np.random.default_rng(3)
    feeds = {i.name: rng.random(i.shape).astype(np.float32) for i in decoder.get_inputs()}
    rgb = decoder.run(None, feeds)[0]
    for j in range(9):
        changed = decoder.run(None, feeds | {f"past_mem.{j}": np.zeros_like(feeds[f"past_mem.{j}"])})[0]
        assert relative(changed, rgb) > 1e-3, j
